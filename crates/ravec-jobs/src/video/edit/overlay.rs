//! `video overlay`: a picture or clip with alpha over a clip, on a tracked plane if wanted, behind the foreground if wanted.

use super::{
    AlphaSource, EditOutput, FrameEdit, ShotFrames, SideData, SideInput, SideInputs, SidePictures,
    map_of,
};
use crate::context::Context;
use crate::error::JobError;
use crate::matte::FrameMattes;
use crate::operation::{Operation, paths};
use crate::pixel_centers::PixelCenters;
use crate::plane::Quad;
use crate::report::Report;
use crate::shot::{ShotTrack, TrackChoice, check_plane, encoded};
use crate::track::exclusions::{Exclusions, MaskFiles};
use crate::video::{Encoding, FrameRange, clip_folders, clip_outputs, folder_or_clip, open_clip};
use glam::{DVec2, dvec2};
use ravec::matting::Colors;
use ravec::planar::{Beyond, Homography, warp};
use ravec::raster::{AnyImage, Image, Size, Srgba};
use ravec_video::FrameSource as _;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Put a picture or clip over a clip: still, or on a tracked plane, in front of or behind the foreground
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Overlay {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png
    pub input: PathBuf,
    /// Output: a file, a folder that is there, or a pattern such as out_%04d.png
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// What is put over the clip: a picture, or a clip of which frame by frame is used. Its alpha is obeyed
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub image: PathBuf,
    /// Track of the plane that it lies on, as ravec track writes it to a .json file [default: it stands still]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub track: Option<PathBuf>,
    /// Matte of what stays in front, as ravec matte makes it: a clip, or one picture for all frames
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub matte: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec video overlay wall.y4m --image p.png --track wall.json --quad 9,9,60,9,60,40,9,40 -o b.y4m
  ravec video overlay clip.y4m --image p.png --matte alpha.y4m --blend multiply -o b.y4m

Without --quad, the picture covers as much of the frame as its shape allows. Blending works on encoded values, as programs for \
pictures do. Frames beyond --frames stay as they are.

Figures: frames.";

/// Parameters of [`Overlay`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Corners of the place of the picture, in the reference frame of the track, from its upper left one clockwise
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", allow_hyphen_values = true)
    )]
    pub quad: Option<Quad>,
    /// Way in which colors are mixed
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Blend::Normal))]
    pub blend: Blend,
    /// Opacity, 0 to 1
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "SHARE", default_value_t = 1.0)
    )]
    pub opacity: f32,
    /// Frames that get the picture, from 0: 100..200 (without frame 200), 100.., ..200
    #[cfg_attr(feature = "cli", arg(long, value_name = "RANGE"))]
    pub frames: Option<FrameRange>,
    /// Number of the plane of a track with several, from 1
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "NUMBER", requires = "track", default_value_t = 1)
    )]
    pub plane: usize,
    /// Convention of corners, and of a track of another program, which does not state its own
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = PixelCenters::Half))]
    pub pixel_centers: PixelCenters,
    /// Encoding of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            quad: None,
            blend: Blend::Normal,
            opacity: 1.0,
            frames: None,
            plane: 1,
            pixel_centers: PixelCenters::Half,
            encoding: Encoding::default(),
        }
    }
}

/// Ways in which colors are mixed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Blend {
    /// The colors of the picture
    #[default]
    Normal,
    /// Product: darkens, as a glaze or a shadow does
    Multiply,
    /// Product of the inverted colors: brightens, as light does
    Screen,
    /// Sum, at most white
    Add,
    /// Product in the shadows, product of the inverted colors in the lights
    Overlay,
    /// The darker value of each channel
    Darken,
    /// The brighter value of each channel
    Lighten,
}

impl Blend {
    /// The mixed value of a channel, from those of the clip and of the picture, 0 to 1.
    fn mixed(self, below: f32, above: f32) -> f32 {
        match self {
            Self::Normal => above,
            Self::Multiply => below * above,
            Self::Screen => 1.0 - (1.0 - below) * (1.0 - above),
            Self::Add => (below + above).min(1.0),
            Self::Overlay if below < 0.5 => 2.0 * below * above,
            Self::Overlay => 1.0 - 2.0 * (1.0 - below) * (1.0 - above),
            Self::Darken => below.min(above),
            Self::Lighten => below.max(above),
        }
    }
}

impl Operation for Overlay {
    const NAME: &'static str = "video overlay";

    fn inputs(&self) -> Vec<&Path> {
        let mut inputs = paths(&self.input, [&self.track, &self.matte]);
        inputs.push(&self.image);
        inputs
    }

    fn outputs(&self) -> Vec<&Path> {
        clip_outputs(&self.output)
    }

    fn folders(&self) -> Vec<&Path> {
        clip_folders(&self.output)
    }

    /// Writes the clip with the picture over it.
    ///
    /// Figures: `frames`.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Quad`], [`JobError::Outside`], [`JobError::Read`], [`JobError::ReadClip`],
    /// [`JobError::WriteClip`], [`JobError::SizesDiffer`], [`JobError::TrackFile`], [`JobError::ClipTooShort`], what
    /// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let mut report = Report::of(self, &self.params);
        self.check()?;
        let output = folder_or_clip(&self.output, &self.inputs(), context)?;
        context.check_files(&self.inputs(), &[&output])?;
        let clip = open_clip(&self.input, None, &mut report, context)?;
        let frames = self.frames(clip.info().size, None, &mut report, context)?;
        let files = EditOutput {
            input: &self.input,
            output: &output,
            size: None,
            range: FrameRange::default(),
            encoding: &self.params.encoding,
            phase: "overlay",
        };
        frames.write(self, &files, clip, &mut report, context)?;
        Ok(report)
    }
}

impl Overlay {
    /// Refuses parameters out of range.
    fn check(&self) -> Result<(), JobError> {
        check_plane(self.params.plane)?;
        let opacity = self.params.opacity;
        if !(0.0..=1.0).contains(&opacity) {
            return Err(JobError::Parameter {
                field: "opacity",
                value: opacity.to_string(),
                range: "0 to 1",
            });
        }
        if let Some(frames) = self.params.frames
            && frames.contains(0).is_none()
        {
            return Err(JobError::Parameter {
                field: "frames",
                value: frames.to_string(),
                range: "numbers of frames, as in 100..200",
            });
        }
        Ok(())
    }

    /// Opens all but the clip, whose frames have `size`. `live` takes the place of the file of the matte.
    pub(super) fn frames(
        &self,
        size: Size,
        live: Option<FrameMattes>,
        report: &mut Report,
        context: &Context,
    ) -> Result<ShotFrames, JobError> {
        self.check()?;
        let params = &self.params;
        let image = SideInput::open(&self.image, report, context)?;
        let track = match &self.track {
            Some(path) => {
                let choice = TrackChoice {
                    path,
                    plane: params.plane,
                    centers: params.pixel_centers,
                };
                Some(ShotTrack::read(&choice, report, context)?)
            }
            None => None,
        };
        let front = match (&self.matte, live) {
            (None, _) => None,
            (Some(_), Some(live)) => Some(AlphaSource::Live(live)),
            (Some(path), None) => {
                let masks = MaskFiles {
                    input: &self.input,
                    exclude: Some(path),
                    strokes: None,
                };
                Some(AlphaSource::File {
                    masks: Exclusions::open(&masks, size, 0, report, context)?,
                    path: path.clone(),
                })
            }
        };
        let edit = Frames {
            image_from_reference: self.image_from_reference(size, image.size())?,
            size,
            pictures: SidePictures::new(&image, |image| Ok(premultiplied(image)))?,
            track,
            track_path: self.track.clone(),
            params: params.clone(),
        };
        let is_seen = params.opacity > 0.0;
        Ok(ShotFrames {
            sides: SideInputs {
                range: params.frames.unwrap_or_default(),
                alpha: front.filter(|_| is_seen),
                picture: is_seen.then_some(image),
                front: None,
            },
            edit: Box::new(edit),
        })
    }

    /// Map to the picture from the reference frame.
    fn image_from_reference(&self, frame: Size, image: Size) -> Result<Homography, JobError> {
        let corners = |size: Size| {
            let (width, height) = (size.width() as f64, size.height() as f64);
            [
                dvec2(0.0, 0.0),
                dvec2(width, 0.0),
                dvec2(width, height),
                dvec2(0.0, height),
            ]
        };
        let place = if let Some(quad) = &self.params.quad {
            quad.check(self.params.pixel_centers, frame)?
        } else {
            // all of it in the middle
            let extent = |size: Size| dvec2(size.width() as f64, size.height() as f64);
            let (whole, own) = (extent(frame), extent(image));
            let scale = (whole / own).min_element();
            let first: DVec2 = 0.5 * (whole - scale * own);
            corners(image).map(|corner| first + scale * corner)
        };
        let map = Homography::from_pairs(&place, &corners(image));
        map.map_err(|cause| JobError::Quad { cause })
    }
}

/// Frames with the picture over them.
struct Frames {
    size: Size,
    pictures: SidePictures<Image<[f32; 4]>>,
    image_from_reference: Homography,
    track: Option<ShotTrack>,
    track_path: Option<PathBuf>,
    params: Params,
}

/// Encoded colors times alpha, and alpha.
fn premultiplied(image: &AnyImage) -> Image<[f32; 4]> {
    let pixels: Image<Srgba<f32>> = image.convert();
    pixels.map(|Srgba([r, g, b, alpha])| [alpha * r, alpha * g, alpha * b, alpha])
}

impl FrameEdit for Frames {
    fn result(
        &self,
        index: u64,
        image: &AnyImage,
        side: SideData,
        context: &Context,
    ) -> Result<Colors, JobError> {
        let colors = encoded(image);
        let params = &self.params;
        // beyond the range, or transparent
        let Some(picture) = &side.picture else {
            return Ok(colors);
        };
        let map = map_of(self.track.as_ref(), self.track_path.as_deref(), index)?;
        let premultiplied = self.pictures.of(picture)?;
        let image_from_frame = self.image_from_reference * map.inverse();
        let progress = context.progress.silent();
        let nothing = Beyond::Pixel([0.0; 4]);
        let laid = warp(
            &premultiplied,
            &image_from_frame,
            self.size,
            nothing,
            &progress,
        )?;
        let front = side.alpha;
        Ok(Colors::from_fn(self.size, |col, row| {
            let [r, g, b, alpha] = laid[(col, row)];
            let below = colors[(col, row)];
            let seen = 1.0 - front.as_ref().map_or(0.0, |front| front[(col, row)]);
            let share = (params.opacity * alpha * seen).clamp(0.0, 1.0);
            if share <= 0.0 {
                return below;
            }
            let above = [r, g, b].map(|value| (value / alpha).clamp(0.0, 1.0));
            [0, 1, 2]
                .map(|k| below[k] + share * (params.blend.mixed(below[k], above[k]) - below[k]))
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_agree_with_their_definitions_at_the_ends() {
        for below in [0.0, 0.25, 0.5, 1.0] {
            for (mode, black, white) in [
                (Blend::Normal, 0.0, 1.0),
                (Blend::Multiply, 0.0, below),
                (Blend::Screen, below, 1.0),
                (Blend::Add, below, 1.0),
                (Blend::Darken, 0.0, below),
                (Blend::Lighten, below, 1.0),
            ] {
                assert_eq!(mode.mixed(below, 0.0), black, "{mode:?} of {below}");
                assert_eq!(mode.mixed(below, 1.0), white, "{mode:?} of {below}");
            }
            // gray leaves everything
            assert!((Blend::Overlay.mixed(below, 0.5) - below).abs() < 1e-6);
        }
    }
}
