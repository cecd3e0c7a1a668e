//! `video paste`: the foreground of a clip in another one, on the plane of each.

use super::{
    AlphaSource, Edit, EditFrame, EditInputs, EditOutput, FrameEdit, OpenEdit, ShotEdit,
    ShotFrames, ShotParams, SideData, SideInput, SideInputs, SidePictures, map_of, read_track,
    write_frames,
};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::{Operation, paths};
use crate::plane::Quad;
use crate::report::Report;
use crate::shot::{ShotTrack, encoded};
use crate::track::exclusions::{Exclusions, MaskFiles};
use crate::video::{Encoding, FrameRange, clip_folders, clip_outputs};
use ravec::matting::Colors;
use ravec::planar::Homography;
use ravec::raster::{AnyImage, Mask, Plane, Size};
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
  ravec video paste clip.y4m --plate empty.png --matte alpha.y4m --into wall.y4m -o pasted.y4m

The foreground of each frame is taken as lying on the plane: it goes to the reference frame of its clip, from --quad to --into-quad, and \
with the second track to the frame of the second clip. So its place, size and perspective follow both planes. What --into-matte \
shows stays in front of it. Times and sound are those of the second clip.

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
            [
                &self.track,
                &self.regions,
                &self.into_track,
                &self.into_matte,
            ],
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

    /// Writes the second clip, with its times and its sound, and the foreground of the first one. It ends where the first of both
    /// ends.
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
        let inputs = self.edit_inputs();
        let OpenEdit {
            clip,
            output,
            edit,
            alpha,
        } = OpenEdit::new(self, &inputs, &mut report, context)?;
        let into = SideInput::open(&self.into, &mut report, context)?;
        let (scene, front) = self.scene(edit.size, into.size(), &mut report, context)?;
        let files = EditOutput {
            size: Some(into.size()),
            ..inputs.output(&output, "paste")
        };
        match into {
            SideInput::Still(_) => {
                let frames = Frames::of(edit, alpha, scene, front, into)?;
                frames.write(self, &files, clip, &mut report, context)?;
            }
            SideInput::Clip { clip: into, .. } => {
                // the times and the sound are those of the second clip
                let frames = clip.info().frames;
                let files = EditOutput {
                    input: &self.into,
                    range: frames
                        .map_or_else(FrameRange::default, |n| FrameRange::between(&(0..n))),
                    ..files
                };
                let mut first = SideInput::of(clip, &self.input);
                let mut sides = SideInputs {
                    alpha: Some(alpha),
                    front,
                    ..SideInputs::default()
                };
                write_frames(
                    self,
                    &files,
                    *into,
                    &mut report,
                    context,
                    |shot| {
                        let image = first.frame(shot.index)?;
                        let side = sides.of(shot.index, &image, context)?;
                        Ok((image, side))
                    },
                    |shot, (image, side)| {
                        let index = shot.index;
                        let frame = edit.frame(index, &image, side.alpha, context)?;
                        let into = encoded(&shot.image);
                        scene.paste(index, &frame, &into, side.front.as_ref(), context)
                    },
                )?;
            }
        }
        Ok(report)
    }
}

impl ShotEdit for Paste {
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
        self.check()?;
        let into = SideInput::open(&self.into, report, context)?;
        let (scene, front) = self.scene(edit.size, into.size(), report, context)?;
        Frames::of(edit, alpha, scene, front, into)
    }
}

/// Frames of the second clip with the foreground of the first one.
struct Frames {
    edit: Edit,
    scene: Scene,
    into: SidePictures<Colors>,
}

impl Frames {
    fn of(
        edit: Edit,
        alpha: AlphaSource,
        scene: Scene,
        front: Option<Exclusions>,
        into: SideInput,
    ) -> Result<ShotFrames, JobError> {
        let pixels = SidePictures::new(&into, |image| Ok(encoded(image)))?;
        Ok(ShotFrames {
            sides: SideInputs {
                alpha: Some(alpha),
                picture: Some(into),
                front,
                ..SideInputs::default()
            },
            edit: Box::new(Self {
                edit,
                scene,
                into: pixels,
            }),
        })
    }
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
        let Some(into) = &side.picture else {
            return Ok(frame.colors);
        };
        let (into, front) = (self.into.of(into)?, side.front.as_ref());
        self.scene.paste(index, &frame, &into, front, context)
    }
}

/// The motion of the plane of the second clip.
pub struct SceneMotion {
    track: Option<ShotTrack>,
}

impl SceneMotion {
    /// The map from the reference frame of the second clip to frame `index`, as warping has it, with the center of the first pixel at
    /// (0.5, 0.5); `None` for frames that its track lacks.
    pub fn frame_from_reference(&self, index: u64) -> Option<Homography> {
        match &self.track {
            Some(track) => track.map(index).copied(),
            None => Some(Homography::IDENTITY),
        }
    }
}

/// The clip into which a foreground is pasted.
struct Scene {
    size: Size,
    track: Option<ShotTrack>,
    track_path: Option<PathBuf>,
    /// Map from the reference frame of the first clip to that of this one.
    into_from_reference: Homography,
    shadow: f32,
}

impl Scene {
    /// A frame of this clip with the foreground of the same frame of the first one, behind what stands in front.
    fn paste(
        &self,
        index: u64,
        frame: &EditFrame,
        into: &Colors,
        front: Option<&Mask>,
        context: &Context,
    ) -> Result<Colors, JobError> {
        let into_map = map_of(self.track.as_ref(), self.track_path.as_deref(), index)?;
        let into_from_frame = into_map * self.into_from_reference * frame.map.inverse();
        let progress = context.progress.silent();
        let layer = Layer::new(&frame.colors, &frame.alpha, &frame.background)?;
        let mut layer = layer.warped(&into_from_frame.inverse(), self.size, &progress)?;
        let mut light = Plane::new(self.size, 1.0);
        if self.shadow > 0.0 {
            light = contact_shadow(&layer, SHADOW_HEIGHT, SHADOW_SOFTNESS_PX, self.shadow);
        }
        if let Some(front) = front {
            layer = layer.behind(front.coverage())?;
            // the shadow lies behind it, too
            for (light, front) in light.pixels_mut().iter_mut().zip(front.coverage().pixels()) {
                *light += front * (1.0 - *light);
            }
        }
        let shaded = Colors::from_fn(self.size, |col, row| {
            into[(col, row)].map(|value| value * light[(col, row)])
        });
        Ok(layer.over(&shaded)?)
    }
}

impl Paste {
    /// Refuses parameters out of range.
    fn check(&self) -> Result<(), JobError> {
        let shadow = self.params.shadow;
        if (0.0..=1.0).contains(&shadow) {
            return Ok(());
        }
        Err(JobError::Parameter {
            field: "shadow",
            value: shadow.to_string(),
            range: "0 to 1",
        })
    }

    /// Reads the track of the second clip; without one its plane stands still.
    ///
    /// # Errors
    /// [`JobError::TrackFile`], and those of reading a file.
    pub fn scene_motion(&self, context: &Context) -> Result<SceneMotion, JobError> {
        let mut report = Report::of(self, &self.params);
        let track = self.scene_track(&mut report, context)?;
        Ok(SceneMotion { track })
    }

    fn scene_track(
        &self,
        report: &mut Report,
        context: &Context,
    ) -> Result<Option<ShotTrack>, JobError> {
        let Some(path) = &self.into_track else {
            return Ok(None);
        };
        // the plane number is that of the first track
        let first = ShotParams {
            plane: 1,
            ..self.params.shot.clone()
        };
        read_track(path, &first, report, context).map(Some)
    }

    /// The second clip, and the matte of what stands in front in it.
    fn scene(
        &self,
        size: Size,
        into: Size,
        report: &mut Report,
        context: &Context,
    ) -> Result<(Scene, Option<Exclusions>), JobError> {
        let params = &self.params;
        let track = self.scene_track(report, context)?;
        let front = match &self.into_matte {
            Some(path) => {
                let masks = MaskFiles {
                    input: &self.into,
                    exclude: Some(path),
                    strokes: None,
                };
                Some(Exclusions::open(&masks, into, 0, report, context)?)
            }
            None => None,
        };
        let scene = Scene {
            size: into,
            track,
            track_path: self.into_track.clone(),
            into_from_reference: self.map_between_references(size, into)?,
            shadow: params.shadow,
        };
        Ok((scene, front))
    }

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
