//! Edits of a tracked shot: `video remove`, `replace`, `enhance`, `paste` and `overlay`. All but the last see the frames of a clip
//! with the plate, the matte and the map of each.

pub mod enhance;
pub mod overlay;
pub mod paste;
mod preview;
pub mod remove;
pub mod replace;

pub use preview::ShotPreview;

use crate::Operation;
use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::matte::FrameMattes;
use crate::pixel_centers::PixelCenters;
use crate::report::Report;
use crate::shot::{
    PlateInFrame, RegionFiles, ShotPlate, ShotTrack, TrackChoice, check_pad, check_plane,
    check_regions, encoded, is_deep,
};
use crate::track::exclusions::{Exclusions, MaskFiles};
use crate::track::follow::{Reader, Shot};
use crate::track::rewrite::{Target, rewrite_each};
use crate::video::{Encoding, FrameRange, folder_or_clip, is_clip, key_of, open_clip, read_error};
use ravec::matting::{Colors, PlateLight};
use ravec::planar::Homography;
use ravec::raster::{AnyImage, BlurCovariance, Mask, Plane, Sample as _, Size, Srgb};
use ravec_video::{Clip, FrameSource as _};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Alpha below which a pixel shows background alone.
const MAX_ALPHA: f32 = 0.012;

/// Geometry of a shot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct ShotParams {
    /// Pixels by which the plate is larger than a frame on each side
    #[cfg_attr(feature = "cli", arg(long, value_name = "PIXELS", default_value_t = 0))]
    pub pad: usize,
    /// Number of the plane of a track with several, from 1
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "NUMBER", requires = "track", default_value_t = 1)
    )]
    pub plane: usize,
    /// Convention of corners, and of a track of another program, which does not state its own
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = PixelCenters::Half))]
    pub pixel_centers: PixelCenters,
}

impl Default for ShotParams {
    fn default() -> Self {
        Self {
            pad: 0,
            plane: 1,
            pixel_centers: PixelCenters::Half,
        }
    }
}

/// Files and parameters that all edits have.
struct EditInputs<'a> {
    input: &'a Path,
    output: &'a Path,
    plate: &'a Path,
    track: Option<&'a Path>,
    regions: Option<&'a Path>,
    matte: &'a Path,
    params: &'a ShotParams,
    encoding: &'a Encoding,
}

impl<'a> EditInputs<'a> {
    /// Output of an edit whose frames have the times and the size of the input.
    fn output(&self, output: &'a Path, phase: &'static str) -> EditOutput<'a> {
        EditOutput {
            input: self.input,
            output,
            size: None,
            range: FrameRange::default(),
            encoding: self.encoding,
            phase,
        }
    }
}

/// Work of an edit on one frame. Frames do not depend on each other.
trait FrameEdit: Send + Sync {
    /// The result for a frame and its data of the side inputs.
    fn result(
        &self,
        index: u64,
        image: &AnyImage,
        side: SideData,
        context: &Context,
    ) -> Result<Colors, JobError>;
}

/// Frames of an edit.
struct ShotFrames {
    sides: SideInputs,
    edit: Box<dyn FrameEdit>,
}

impl ShotFrames {
    /// Writes the frames of a clip as the edit changes them.
    fn write<O: Operation>(
        self,
        operation: &O,
        files: &EditOutput<'_>,
        clip: Clip,
        report: &mut Report,
        context: &Context,
    ) -> Result<(), JobError> {
        let Self { mut sides, edit } = self;
        write_frames(
            operation,
            files,
            clip,
            report,
            context,
            |shot| sides.of(shot.index, &shot.image, context),
            |shot, side| edit.result(shot.index, &shot.image, side, context),
        )
    }
}

/// Inputs that an edit reads in step with its clip.
#[derive(Default)]
struct SideInputs {
    /// Frames for which they are read; all by default.
    range: FrameRange,
    /// Alpha of the foreground.
    alpha: Option<AlphaSource>,
    /// A picture or a clip.
    picture: Option<SideInput>,
    /// Matte of what stands in front in it.
    front: Option<Exclusions>,
}

/// Data of the side inputs for one frame.
#[derive(Default)]
struct SideData {
    alpha: Option<Plane>,
    picture: Option<Arc<AnyImage>>,
    front: Option<Mask>,
}

impl SideInputs {
    /// Reads what belongs to a frame. Frames are read forward fastest.
    ///
    /// # Errors
    /// [`JobError::ClipTooShort`], [`JobError::ReadClip`].
    fn of(
        &mut self,
        index: u64,
        image: &AnyImage,
        context: &Context,
    ) -> Result<SideData, JobError> {
        if self.range.contains(index) != Some(true) {
            return Ok(SideData::default());
        }
        let alpha = self.alpha.as_mut();
        let picture = self.picture.as_mut();
        let front = self.front.as_mut();
        Ok(SideData {
            alpha: alpha
                .map(|alpha| alpha.of(index, image, context))
                .transpose()?,
            picture: picture.map(|picture| picture.frame(index)).transpose()?,
            front: front.map(|front| front.of(index)).transpose()?.flatten(),
        })
    }
}

/// An edit of a shot.
trait ShotEdit: Operation {
    /// Files and parameters that all edits have.
    fn edit_inputs(&self) -> EditInputs<'_>;

    /// Opens what only this edit has, and records its figures.
    fn frames(
        &self,
        edit: Edit,
        alpha: AlphaSource,
        report: &mut Report,
        context: &Context,
    ) -> Result<ShotFrames, JobError>;
}

/// A shot with its plate and its track.
struct Edit {
    size: Size,
    plate: ShotPlate,
    track: Option<ShotTrack>,
    track_path: Option<PathBuf>,
}

/// Source of the alpha of frames.
enum AlphaSource {
    /// A clip or a picture.
    File { masks: Exclusions, path: PathBuf },
    /// Mattes that an operation would write, solved frame by frame.
    Live(FrameMattes),
}

impl AlphaSource {
    fn of(&mut self, index: u64, image: &AnyImage, context: &Context) -> Result<Plane, JobError> {
        match self {
            Self::File { masks, path } => {
                let alpha = masks.of(index)?.map(Mask::into_coverage);
                alpha.ok_or_else(|| JobError::ClipTooShort {
                    path: path.clone(),
                    frame: index,
                })
            }
            Self::Live(mattes) => {
                let progress = context.progress.silent();
                Ok(mattes.solve(index, image, &progress, context)?.alpha)
            }
        }
    }
}

/// A frame with all that an edit needs.
struct EditFrame {
    colors: Colors,
    alpha: Plane,
    /// Map from the reference frame.
    map: Homography,
    /// The plate as the frame shows it, in its light.
    background: Colors,
    /// Blur of the plate in the frame.
    blur: BlurCovariance,
    /// The plate as the frame shows it, in its own light.
    plate: Arc<PlateInFrame>,
}

impl Edit {
    /// Reads plate and track of a shot whose frames have `size`, and opens its matte. `live` takes the place of the file of the matte.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::SizesDiffer`], [`JobError::TrackFile`], those of reading.
    fn open(
        inputs: &EditInputs<'_>,
        size: Size,
        live: Option<FrameMattes>,
        report: &mut Report,
        context: &Context,
    ) -> Result<(Self, AlphaSource), JobError> {
        let plate_size = |b_size: Size| JobError::SizesDiffer {
            a: inputs.input.to_path_buf(),
            a_size: size,
            b: inputs.plate.to_path_buf(),
            b_size,
        };
        let picture = files::read(inputs.plate, report, context)?.image;
        let mut plate = ShotPlate::new(&picture, inputs.params.pad);
        if plate.frame_size() != Some(size) {
            return Err(plate_size(picture.size()));
        }
        if let (Some(regions), Some(track)) = (inputs.regions, inputs.track) {
            let track = &track_choice(track, inputs.params);
            let files = RegionFiles { regions, track };
            plate = plate.with_regions(inputs.plate, &files, report, context)?;
        }
        let track = if let Some(path) = inputs.track {
            Some(read_track(path, inputs.params, report, context)?)
        } else {
            plate = plate.standing(context)?;
            None
        };
        let alpha = if let Some(live) = live {
            AlphaSource::Live(live)
        } else {
            let masks = MaskFiles {
                input: inputs.input,
                exclude: Some(inputs.matte),
                strokes: None,
            };
            AlphaSource::File {
                masks: Exclusions::open(&masks, size, 0, report, context)?,
                path: inputs.matte.to_path_buf(),
            }
        };
        let edit = Self {
            size,
            plate,
            track,
            track_path: inputs.track.map(Path::to_path_buf),
        };
        Ok((edit, alpha))
    }

    /// The map to a frame.
    fn map(&self, index: u64) -> Result<Homography, JobError> {
        map_of(self.track.as_ref(), self.track_path.as_deref(), index)
    }

    /// A frame with its alpha and its background. Without alpha there is no foreground.
    fn frame(
        &self,
        index: u64,
        image: &AnyImage,
        alpha: Option<Plane>,
        context: &Context,
    ) -> Result<EditFrame, JobError> {
        let map = self.map(index)?;
        let alpha = alpha.unwrap_or_else(|| Plane::new(self.size, 0.0));
        let colors = encoded(image);
        let shown = self.plate.in_frame(&map, index, self.size, context)?;
        let usable = |col: usize, row: usize| {
            shown.known[(col, row)] > 0.99 && alpha[(col, row)] < MAX_ALPHA
        };
        let light = PlateLight::fit(&colors, &shown.colors, Some(&usable));
        let (background, _) = light.relit(&shown.colors);
        Ok(EditFrame {
            map,
            alpha,
            blur: light.total_blur(),
            background: background.map(|color| color.map(|value| value.clamp(0.0, 1.0))),
            plate: shown,
            colors,
        })
    }
}

fn read_track(
    path: &Path,
    params: &ShotParams,
    report: &mut Report,
    context: &Context,
) -> Result<ShotTrack, JobError> {
    ShotTrack::read(&track_choice(path, params), report, context)
}

fn track_choice<'a>(path: &'a Path, params: &ShotParams) -> TrackChoice<'a> {
    TrackChoice {
        path,
        plane: params.plane,
        centers: params.pixel_centers,
    }
}

/// The map to a frame from the reference frame; the identity without a track.
fn map_of(
    track: Option<&ShotTrack>,
    path: Option<&Path>,
    index: u64,
) -> Result<Homography, JobError> {
    let Some(track) = track else {
        return Ok(Homography::IDENTITY);
    };
    track
        .map(index)
        .copied()
        .ok_or_else(|| JobError::TrackFile {
            path: path.unwrap_or(Path::new("")).to_path_buf(),
            reason: format!("it lacks frame {index}"),
        })
}

/// A picture or clip whose frames are read in step with those of another clip.
enum SideInput {
    Still(Arc<AnyImage>),
    Clip {
        clip: Box<Clip>,
        path: PathBuf,
        next: u64,
    },
}

impl SideInput {
    fn open(path: &Path, report: &mut Report, context: &Context) -> Result<Self, JobError> {
        if !is_clip(path, context) {
            let picture = files::read(path, report, context)?;
            return Ok(Self::Still(Arc::new(picture.image)));
        }
        Ok(Self::of(open_clip(path, None, report, context)?, path))
    }

    /// A clip that was opened from `path`.
    fn of(clip: Clip, path: &Path) -> Self {
        Self::Clip {
            clip: Box::new(clip),
            path: path.to_path_buf(),
            next: 0,
        }
    }

    fn size(&self) -> Size {
        match self {
            Self::Still(image) => image.size(),
            Self::Clip { clip, .. } => clip.info().size,
        }
    }

    /// The frame of this number; that of a picture is the picture.
    ///
    /// # Errors
    /// [`JobError::ClipTooShort`], [`JobError::ReadClip`].
    fn frame(&mut self, index: u64) -> Result<Arc<AnyImage>, JobError> {
        match self {
            Self::Still(image) => Ok(image.clone()),
            Self::Clip { clip, path, next } => {
                let failed = read_error(path);
                if index != *next {
                    clip.seek(index).map_err(&failed)?;
                }
                *next = index + 1;
                let frame = clip.next_frame().map_err(&failed)?;
                let frame = frame.ok_or_else(|| JobError::ClipTooShort {
                    path: path.clone(),
                    frame: index,
                })?;
                Ok(Arc::new(frame.picture.into_image()))
            }
        }
    }
}

/// The pictures of a [`SideInput`] as an edit needs them; that of a still is kept.
struct SidePictures<T> {
    convert: fn(&AnyImage) -> Result<T, JobError>,
    still: Option<T>,
}

impl<T: Clone> SidePictures<T> {
    /// Pictures of the frames of `input`.
    ///
    /// # Errors
    /// Those of `convert`.
    fn new(
        input: &SideInput,
        convert: fn(&AnyImage) -> Result<T, JobError>,
    ) -> Result<Self, JobError> {
        let still = match input {
            SideInput::Still(picture) => Some(convert(picture)?),
            SideInput::Clip { .. } => None,
        };
        Ok(Self { convert, still })
    }

    /// The picture of a frame.
    ///
    /// # Errors
    /// Those of `convert`.
    fn of(&self, frame: &AnyImage) -> Result<Cow<'_, T>, JobError> {
        Ok(match &self.still {
            Some(still) => Cow::Borrowed(still),
            None => Cow::Owned((self.convert)(frame)?),
        })
    }
}

/// An edit whose inputs are open.
struct OpenEdit {
    clip: Clip,
    /// The clip that is written.
    output: PathBuf,
    edit: Edit,
    alpha: AlphaSource,
}

impl OpenEdit {
    /// Checks parameters and files, and opens the inputs.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::ReadClip`], [`JobError::WriteClip`], those of [`Edit::open`], what
    /// [`check_files`](crate::check_files) refuses.
    fn new<O: Operation>(
        operation: &O,
        inputs: &EditInputs<'_>,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        check_plane(inputs.params.plane)?;
        check_pad(inputs.params.pad)?;
        check_regions(inputs.regions, inputs.track)?;
        let output = folder_or_clip(inputs.output, &operation.inputs(), context)?;
        context.check_files(&operation.inputs(), &[&output])?;
        let clip = open_clip(inputs.input, None, report, context)?;
        let (edit, alpha) = Edit::open(inputs, clip.info().size, None, report, context)?;
        Ok(Self {
            clip,
            output,
            edit,
            alpha,
        })
    }
}

/// Output of an edit.
struct EditOutput<'a> {
    /// The clip that is read, from which times and sound come.
    input: &'a Path,
    output: &'a Path,
    /// Size of the frames, unless it is that of the input.
    size: Option<Size>,
    /// Frames that are used.
    range: FrameRange,
    encoding: &'a Encoding,
    /// Name of the phase.
    phase: &'static str,
}

/// Writes the frames of a clip, each changed by `change`, which gets what `read` gives for it.
fn write_frames<O: Operation, S: Send>(
    operation: &O,
    files: &EditOutput<'_>,
    clip: Clip,
    report: &mut Report,
    context: &Context,
    read: impl FnMut(&Shot) -> Result<S, JobError> + Send,
    change: impl Fn(&Shot, S) -> Result<Colors, JobError> + Sync,
) -> Result<(), JobError> {
    let total = clip.info().frames;
    let mut reader = Reader::new(clip, files.input, files.range)?;
    let key = key_of(operation);
    let target = Target {
        input: files.input,
        output: files.output,
        size: files.size,
        encoding: files.encoding,
        key: &key,
        pixels: None,
        phase: (files.phase, total),
    };
    let change = |shot: &Shot, side: S| {
        let deep = is_deep(&shot.image);
        Ok((drawn(&change(shot, side)?, deep), ()))
    };
    let rewritten = rewrite_each(&target, &mut reader, report, context, read, change, drop)?;
    reader.warn(report);
    report.figures.insert("frames", rewritten.count as f64);
    rewritten.finish(report)
}

/// Colors with as many bits as the clip has.
fn drawn(colors: &Colors, deep: bool) -> AnyImage {
    if deep {
        AnyImage::Srgb16(colors.map(|color| Srgb(color.map(u16::from_unit))))
    } else {
        AnyImage::Srgb8(colors.map(|color| Srgb(color.map(u8::from_unit))))
    }
}

#[cfg(test)]
mod tests;
