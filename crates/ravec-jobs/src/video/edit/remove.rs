//! `video remove`: foreground removed from a clip, so that its plate shows through.

use super::{
    AlphaSource, Edit, EditInputs, FrameEdit, OpenEdit, ShotEdit, ShotFrames, ShotParams, SideData,
    SideInputs,
};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::{Operation, paths};
use crate::report::Report;
use crate::video::{Encoding, clip_folders, clip_outputs};
use ravec::matting::Colors;
use ravec::raster::AnyImage;
use ravec::video_edit::Removal;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Remove the foreground of a clip: the plate shows through, in the light and with the grain of each frame
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Remove {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png
    pub input: PathBuf,
    /// Output: a file, a folder that is there, or a pattern such as out_%04d.png
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Picture of the background, as ravec plate makes it; where it is transparent, frames stay as they are
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub plate: PathBuf,
    /// Matte of what is removed, as ravec matte makes it: a clip, or one picture for all frames
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub matte: PathBuf,
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
  ravec video remove clip.y4m --plate empty.png --matte alpha.y4m -o clean.y4m
  ravec video remove clip.y4m --plate empty.png --matte alpha.y4m --grain none -o clean_%04d.png

Gain, offset, blur in any direction and small shifts of the plate are fitted to each frame. Pixels more than 8 pixels from the foreground stay as they \
are.

Figures: frames.";

/// Parameters of [`Remove`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Geometry of the shot.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub shot: ShotParams,
    /// Grain of what is filled in
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Grain::Matched))]
    pub grain: Grain,
    /// Encoding of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

/// Grain of what is filled in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Grain {
    /// That of the frame
    #[default]
    Matched,
    /// None: as clean as the plate
    None,
}

impl Operation for Remove {
    const NAME: &'static str = "video remove";

    fn inputs(&self) -> Vec<&Path> {
        let mut inputs = paths(&self.input, [&self.track, &self.regions]);
        inputs.extend([self.plate.as_path(), self.matte.as_path()]);
        inputs
    }

    fn outputs(&self) -> Vec<&Path> {
        clip_outputs(&self.output)
    }

    fn folders(&self) -> Vec<&Path> {
        clip_folders(&self.output)
    }

    /// Writes the clip without its foreground.
    ///
    /// Figures: `frames`.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Read`], [`JobError::ReadClip`], [`JobError::WriteClip`], [`JobError::SizesDiffer`],
    /// [`JobError::TrackFile`], [`JobError::ClipTooShort`], what [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let mut report = Report::of(self, &self.params);
        let inputs = self.edit_inputs();
        let open = OpenEdit::new(self, &inputs, &mut report, context)?;
        let frames = self.frames(open.edit, open.alpha, &mut report, context)?;
        let files = inputs.output(&open.output, "remove");
        frames.write(self, &files, open.clip, &mut report, context)?;
        Ok(report)
    }
}

impl ShotEdit for Remove {
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
        _report: &mut Report,
        _context: &Context,
    ) -> Result<ShotFrames, JobError> {
        let grain = self.params.grain;
        Ok(ShotFrames {
            sides: SideInputs {
                alpha: Some(alpha),
                ..SideInputs::default()
            },
            edit: Box::new(Frames { edit, grain }),
        })
    }
}

/// Frames without foreground.
struct Frames {
    edit: Edit,
    grain: Grain,
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
        let removal = Removal {
            frame: &frame.colors,
            alpha: &frame.alpha,
            background: &frame.background,
            known: &frame.plate.known,
            grain: (self.grain == Grain::Matched).then_some(index),
        };
        Ok(removal.result()?)
    }
}
