//! `video info`: properties of a clip.

use super::clip::{open_clip, pixels_in_words, read_error};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::Operation;
use crate::report::Report;
use ravec_video::{Clip, ClipInfo, FrameSource as _, Rational};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Describe a clip: size, rate, codec, colors, sound
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Info {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png, or `-` for Y4M on standard input
    pub input: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec video info clip.mp4
  ravec video info clip.mp4 --count --json info.json

The result has the properties that the file states: container, codec, size, rotation, pixels with layout, depth, matrix, range and \
siting, pixel_aspect, time_base (seconds a tick), rate, frames, duration (ticks), other_tracks. With --count all frames are read: \
counted has their number, the ticks of the first and the end of the last, and damage, if there is any.

Figures: width, height, frames, duration_secs and frames_per_sec, as far as known.";

/// Parameters of [`Info`].
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Read all frames: count them, and find out whether the clip is damaged and its rate variable
    #[cfg_attr(feature = "cli", arg(long))]
    pub count: bool,
}

impl Operation for Info {
    const NAME: &'static str = "video info";

    const PRINTS_RESULT: bool = true;

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    /// Describes the clip. The result has the fields of [`ClipInfo`], and `counted` if frames were counted.
    ///
    /// # Errors
    /// [`JobError::ReadClip`], [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { input, params } = self;
        let mut report = Report::of(self, params);
        let mut clip = open_clip(input, None, &mut report, context)?;
        let info = clip.info().clone();
        let mut result = json!(info);
        result["layout"] = json!(pixels_in_words(&info));
        let mut frames = info.frames;
        let mut seconds = info.duration_secs();
        if params.count {
            let counted = count(&mut clip, &info, self, context)?;
            frames = Some(counted.frames);
            seconds = Some(counted.ticks() as f64 * info.time_base.to_f64());
            result["counted"] = json!({
                "frames": counted.frames,
                "first": counted.first,
                "end": counted.end,
                "variable_rate": counted.variable,
                "damage": clip.damage(),
            });
            if let Some(damage) = clip.damage() {
                report.record_dropped(format!("{}: {damage}", input.display()));
            }
        }
        report.result = Some(result);
        let figures = [
            ("width", Some(info.size.width() as f64)),
            ("height", Some(info.size.height() as f64)),
            ("frames", frames.map(|frames| frames as f64)),
            ("duration_secs", seconds),
            ("frames_per_sec", info.rate.map(Rational::to_f64)),
        ];
        for (name, figure) in figures {
            if let Some(figure) = figure {
                report.figures.insert(name, figure);
            }
        }
        Ok(report)
    }
}

/// Frames that were read.
#[derive(Default)]
struct Counted {
    frames: u64,
    first: i64,
    end: i64,
    duration: u64,
    variable: bool,
}

impl Counted {
    fn ticks(&self) -> i64 {
        self.end.saturating_sub(self.first)
    }
}

fn count(
    clip: &mut Clip,
    info: &ClipInfo,
    operation: &Info,
    context: &Context,
) -> Result<Counted, JobError> {
    let phase = context.progress.phase("count", info.frames.unwrap_or(1));
    let mut counted = Counted::default();
    while let Some(frame) = clip.next_frame().map_err(read_error(&operation.input))? {
        context.progress.check()?;
        let time = frame.time;
        if counted.frames == 0 {
            (counted.first, counted.duration) = (time.start, time.duration);
        } else {
            // stamps of a constant rate may be rounded to a tick
            let step = time.start.saturating_sub(counted.end).unsigned_abs();
            counted.variable |= step > 1 || time.duration.abs_diff(counted.duration) > 1;
        }
        counted.end = time.start.saturating_add_unsigned(time.duration);
        counted.frames += 1;
        phase.advance(1);
    }
    Ok(counted)
}
