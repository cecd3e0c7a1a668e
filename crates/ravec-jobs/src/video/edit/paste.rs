//! `video paste`: the foreground of a clip in another one, on the plane of each.

use super::{Along, Edit, ShotFiles, ShotParams, Written, check, map_of, read_track, written};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::{Operation, paths};
use crate::plane::Quad;
use crate::report::Report;
use crate::shot::encoded;
use crate::track::exclusions::{Exclusions, MaskFiles};
use crate::video::{Encoding, clip_folders, clip_outputs, folder_or_clip, open_clip};
use ravec::planar::Homography;
use ravec::raster::Size;
use ravec::video_edit::{Layer, contact_shadow};
use ravec_video::FrameSource as _;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Paste the foreground of a clip into another one, in the perspective of the planes of both
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Paste {
    /// Clip from which the foreground is cut
    pub input: PathBuf,
    /// Output: a file, a folder that is there, or a pattern such as out_%04d.png
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Clip or picture into which it is pasted
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub into: PathBuf,
    /// Track of the plane in that clip, as ravec track writes it to a .json file [default: the camera stands still]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub into_track: Option<PathBuf>,
    /// Matte of what stands in front in that clip
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub into_matte: Option<PathBuf>,
    /// Picture of the background of the first clip, as ravec plate makes it: its colors leave the rim of the foreground
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub plate: PathBuf,
    /// Matte of the foreground, as ravec matte makes it: a clip, or one picture for all frames
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub matte: PathBuf,
    /// Track of the background of the first clip, as ravec track writes it to a .json file [default: the camera stands still]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub track: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec video paste clip.y4m --plate empty.png --matte alpha.y4m --into wall.y4m -o pasted.y4m

The foreground of each frame is taken as lying on the plane: it goes to the reference frame of its clip, from --quad to --into-quad, and \
with the second track to the frame of the second clip. So its place, size and perspective follow both planes. What --into-matte \
shows stays in front of it.

Figures: frames.";

/// Parameters of [`Paste`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Geometry of the shot.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub shot: ShotParams,
    /// Corners of a rectangle on the plane in the reference frame of the first clip [default: those of the frame]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", allow_hyphen_values = true)
    )]
    pub quad: Option<Quad>,
    /// Corners in the reference frame of the second clip to which they go [default: the same]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", allow_hyphen_values = true)
    )]
    pub into_quad: Option<Quad>,
    /// Darkness of a contact shadow on the ground, 0 (none) to 1
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "SHARE", default_value_t = 0.0)
    )]
    pub shadow: f32,
    /// Encoding of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

/// Height of a contact shadow relative to that of what casts it, and its softness in pixels.
const SHADOW_HEIGHT: f32 = 0.12;
const SHADOW_SOFTNESS_PX: f64 = 5.0;

impl Operation for Paste {
    const NAME: &'static str = "video paste";

    fn inputs(&self) -> Vec<&Path> {
        let mut inputs = paths(
            &self.input,
            [&self.track, &self.into_track, &self.into_matte],
        );
        let others = [&self.plate, &self.matte, &self.into];
        inputs.extend(others.map(PathBuf::as_path));
        inputs
    }

    fn outputs(&self) -> Vec<&Path> {
        clip_outputs(&self.output)
    }

    fn folders(&self) -> Vec<&Path> {
        clip_folders(&self.output)
    }

    /// Writes the second clip with the foreground of the first one; it ends with the first one.
    ///
    /// Figures: `frames`.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Quad`], [`JobError::Outside`], [`JobError::Read`], [`JobError::ReadClip`],
    /// [`JobError::WriteClip`], [`JobError::SizesDiffer`], [`JobError::TrackFile`], [`JobError::Along`], what
    /// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let params = &self.params;
        let mut report = Report::of(self, params);
        check(&params.shot)?;
        if !(0.0..=1.0).contains(&params.shadow) {
            return Err(JobError::Parameter {
                field: "shadow",
                value: params.shadow.to_string(),
                range: "0 to 1",
            });
        }
        let output = folder_or_clip(&self.output, &self.inputs(), context)?;
        context.check_files(&self.inputs(), &[&output])?;
        let clip = open_clip(&self.input, None, &mut report, context)?;
        let size = clip.info().size;
        let paths = ShotFiles {
            input: &self.input,
            plate: Some(&self.plate),
            track: self.track.as_deref(),
            matte: &self.matte,
        };
        let mut edit = Edit::open(&paths, size, &params.shot, &mut report, context)?;
        let mut into = Along::open(&self.into, &mut report, context)?;
        let into_size = into.size();
        let into_track = match &self.into_track {
            // the plane number is that of the first track
            Some(path) => {
                let first = ShotParams {
                    plane: 1,
                    ..params.shot.clone()
                };
                Some(read_track(path, &first, &mut report, context)?)
            }
            None => None,
        };
        let mut front = match &self.into_matte {
            Some(path) => {
                let masks = MaskFiles {
                    input: &self.into,
                    exclude: Some(path),
                    strokes: None,
                };
                Some(Exclusions::open(
                    &masks,
                    into_size,
                    0,
                    &mut report,
                    context,
                )?)
            }
            None => None,
        };
        let into_from_reference = self.map_between_references(size, into_size)?;
        let files = Written {
            input: &self.input,
            output: &output,
            size: Some(into_size),
            encoding: &params.encoding,
            phase: "paste",
        };
        // borrowed for this thread alone: clips cannot be shared
        let (edit, into, front) = (&mut edit, &mut into, &mut front);
        written(self, &files, clip, &mut report, context, |shot| {
            let frame = edit.frame(shot.index, &shot.image, context)?;
            let behind = into.frame(shot.index)?.ok_or_else(|| JobError::Along {
                path: self.into.clone(),
                frame: shot.index,
            })?;
            let behind = encoded(&behind);
            let into_map = map_of(into_track.as_ref(), self.into_track.as_deref(), shot.index)?;
            let output_from_frame = into_map * into_from_reference * frame.map.inverse();
            let progress = context.progress.silent();
            let layer = Layer::new(&frame.colors, &frame.alpha, &frame.background)?;
            let layer = layer.warped(&output_from_frame.inverse(), into_size, &progress)?;
            let shaded = if params.shadow > 0.0 {
                let light =
                    contact_shadow(&layer, SHADOW_HEIGHT, SHADOW_SOFTNESS_PX, params.shadow);
                ravec::matting::Colors::from_fn(into_size, |col, row| {
                    behind[(col, row)].map(|value| value * light[(col, row)])
                })
            } else {
                behind.clone()
            };
            let pasted = layer.over(&shaded)?;
            let Some(front) = front else {
                return Ok(pasted);
            };
            let Some(mask) = front.of(shot.index)? else {
                return Ok(pasted);
            };
            Ok(ravec::matting::Colors::from_fn(into_size, |col, row| {
                let share = mask.at(col, row);
                let (front, back) = (behind[(col, row)], pasted[(col, row)]);
                [0, 1, 2].map(|c| share * front[c] + (1.0 - share) * back[c])
            }))
        })?;
        Ok(report)
    }
}

impl Paste {
    /// Map from the reference frame of the first clip to that of the second one.
    fn map_between_references(&self, size: Size, into: Size) -> Result<Homography, JobError> {
        let params = &self.params;
        let centers = params.shot.pixel_centers;
        let (from, to) = match (&params.quad, &params.into_quad) {
            (Some(from), Some(to)) => (from.check(centers, size)?, to.check(centers, into)?),
            (None, None) => return Ok(Homography::IDENTITY),
            _ => {
                return Err(JobError::Missing {
                    fields: &["quad", "into_quad"],
                    expected: "the corners of a rectangle on each of the planes",
                });
            }
        };
        Homography::from_pairs(&from, &to).map_err(|cause| JobError::Quad { cause })
    }
}
