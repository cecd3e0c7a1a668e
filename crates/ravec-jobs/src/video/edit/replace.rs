//! `video replace`: another picture or clip on the plane of a shot, or behind its foreground.

use super::{
    AlphaSource, Edit, EditInputs, FrameEdit, OpenEdit, ShotEdit, ShotFrames, ShotParams, SideData,
    SideInput, SideInputs, SidePictures,
};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::{Operation, paths};
use crate::plane::Quad;
use crate::report::Report;
use crate::shot::encoded;
use crate::video::{Encoding, clip_folders, clip_outputs};
use glam::dvec2;
use ravec::matting::Colors;
use ravec::planar::Homography;
use ravec::raster::AnyImage;
use ravec::video_edit::{Backdrop, Layer};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Replace the background of a clip by a picture or another clip, on its plane or behind everything
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Replace {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png
    pub input: PathBuf,
    /// Output: a file, a folder that is there, or a pattern such as out_%04d.png
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Picture of the background, as ravec plate makes it: its colors leave the rim of the foreground
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub plate: PathBuf,
    /// Matte of the foreground, as ravec matte makes it: a clip, or one picture for all frames
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub matte: PathBuf,
    /// New background: a picture, or a clip at least as long
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub image: PathBuf,
    /// Track of the background, as ravec track writes it to a .json file [default: the camera stands still]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub track: Option<PathBuf>,
    /// Map of the planes of a plate, as ravec plate --regions writes it: gray values are numbers of planes of the track
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE", requires = "track"))]
    #[serde(default)]
    pub regions: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec video replace clip.y4m --plate empty.png --matte alpha.y4m --image photo.jpg -o new.y4m

With --quad, corners of a rectangle on the plane in the reference frame, the new background lies on the plane and moves with it: \
its own corners, or those of --image-quad, come to lie there. Without it, the new background fills the frame and stands still. Its \
colors are shown as they are.

Figures: frames.";

/// Parameters of [`Replace`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Geometry of the shot.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub shot: ShotParams,
    /// Corners of a rectangle on the plane in the reference frame [default: the new background stands still]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", allow_hyphen_values = true)
    )]
    pub quad: Option<Quad>,
    /// Corners in the new background that belong there [default: its own corners]
    #[cfg_attr(
        feature = "cli",
        arg(
            long,
            value_name = "X,Y,X,Y,X,Y,X,Y",
            allow_hyphen_values = true,
            requires = "quad"
        )
    )]
    pub image_quad: Option<Quad>,
    /// Encoding of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

impl Operation for Replace {
    const NAME: &'static str = "video replace";

    fn inputs(&self) -> Vec<&Path> {
        let mut inputs = paths(&self.input, [&self.track, &self.regions]);
        let others = [&self.plate, &self.matte, &self.image];
        inputs.extend(others.map(PathBuf::as_path));
        inputs
    }

    fn outputs(&self) -> Vec<&Path> {
        clip_outputs(&self.output)
    }

    fn folders(&self) -> Vec<&Path> {
        clip_folders(&self.output)
    }

    /// Writes the clip before its new background.
    ///
    /// Figures: `frames`.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Quad`], [`JobError::Outside`], [`JobError::Read`], [`JobError::ReadClip`],
    /// [`JobError::WriteClip`], [`JobError::SizesDiffer`], [`JobError::TrackFile`], [`JobError::ClipTooShort`], what
    /// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let mut report = Report::of(self, &self.params);
        let inputs = self.edit_inputs();
        let open = OpenEdit::new(self, &inputs, &mut report, context)?;
        let frames = self.frames(open.edit, open.alpha, &mut report, context)?;
        let files = inputs.output(&open.output, "replace");
        frames.write(self, &files, open.clip, &mut report, context)?;
        Ok(report)
    }
}

impl ShotEdit for Replace {
    fn edit_inputs(&self) -> EditInputs<'_> {
        EditInputs {
            input: &self.input,
            output: &self.output,
            plate: &self.plate,
            track: self.track.as_deref(),
            regions: self.regions.as_deref(),
            matte: &self.matte,
            params: &self.params.shot,
            encoding: &self.params.encoding,
        }
    }

    fn frames(
        &self,
        edit: Edit,
        alpha: AlphaSource,
        report: &mut Report,
        context: &Context,
    ) -> Result<ShotFrames, JobError> {
        let image = SideInput::open(&self.image, report, context)?;
        let place = Placement::new(&self.params, edit.size, image.size())?;
        let pictures = SidePictures::new(&image, |image| Ok(Backdrop::new(&encoded(image))?))?;
        Ok(ShotFrames {
            sides: SideInputs {
                alpha: Some(alpha),
                picture: Some(image),
                ..SideInputs::default()
            },
            edit: Box::new(Frames {
                edit,
                pictures,
                place,
            }),
        })
    }
}

/// Frames before another background.
struct Frames {
    edit: Edit,
    pictures: SidePictures<Backdrop>,
    place: Placement,
}

impl FrameEdit for Frames {
    fn result(
        &self,
        index: u64,
        image: &AnyImage,
        side: SideData,
        context: &Context,
    ) -> Result<Colors, JobError> {
        let frame = self.edit.frame(index, image, side.alpha, context)?;
        let Some(new) = &side.picture else {
            return Ok(frame.colors);
        };
        let new = self.pictures.of(new)?;
        let image_from_frame = self.place.image_from_frame(&frame.map);
        let progress = context.progress.silent();
        let new = new.view(&image_from_frame, self.edit.size, &progress)?;
        let layer = Layer::new(&frame.colors, &frame.alpha, &frame.background)?;
        Ok(layer.over(&new)?)
    }
}

/// Placement of the new background.
enum Placement {
    /// On the plane: map to the image from the reference frame.
    OnPlane(Homography),
    /// Behind everything, equal in all frames: map to the image from a frame.
    Behind(Homography),
}

impl Placement {
    fn new(
        params: &Params,
        frame: ravec::raster::Size,
        image: ravec::raster::Size,
    ) -> Result<Self, JobError> {
        let (width, height) = (image.width() as f64, image.height() as f64);
        let centers = params.shot.pixel_centers;
        let Some(quad) = &params.quad else {
            // as large as it must be to cover the frame, its middle in the middle
            let (w, h) = (frame.width() as f64, frame.height() as f64);
            let scale = (width / w).min(height / h);
            let shift = dvec2(width, height) * 0.5 - dvec2(w, h) * (0.5 * scale);
            let scaled = Homography::from_scale(dvec2(scale, scale));
            let shifted = Homography::from_translation(shift);
            let quad = |cause| JobError::Quad { cause };
            return Ok(Self::Behind(shifted.map_err(quad)? * scaled.map_err(quad)?));
        };
        let on_plane = quad.check(centers, frame)?;
        let in_image = match &params.image_quad {
            Some(quad) => quad.check(centers, image)?,
            None => [
                dvec2(0.0, 0.0),
                dvec2(width, 0.0),
                dvec2(width, height),
                dvec2(0.0, height),
            ],
        };
        let map = Homography::from_pairs(&on_plane, &in_image);
        Ok(Self::OnPlane(
            map.map_err(|cause| JobError::Quad { cause })?,
        ))
    }

    fn image_from_frame(&self, frame_from_reference: &Homography) -> Homography {
        match self {
            Self::OnPlane(map) => *map * frame_from_reference.inverse(),
            Self::Behind(map) => *map,
        }
    }
}
