//! `video frames`: frames of a clip as pictures.

use super::FrameRange;
use super::clip::{check_clip_target, open_clip, read_error};
use super::convert::seek_start;
use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::report::{FileReport, Report};
use ravec::raster::Size;
use ravec_media::{Picture, WriteOptions};
use ravec_video::{Frame, FrameSource as _, Pattern};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Write frames of a clip as numbered pictures
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Frames {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png, or `-` for Y4M on standard input
    pub input: PathBuf,
    /// Names of the pictures, with a place for the number of the frame, as in frame_%04d.png. A single frame needs no place
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "PATTERN"))]
    pub output: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec video frames clip.mp4 -o frame_%04d.png --every 4
  ravec video frames clip.mp4 -o still.png --at 5
  ravec video frames clip.mp4 -o still_%d.jpg --at 0 --at 7 --quality 90

The number in a name is that of the frame, from 0. The result lists the frames with their files and seconds.

Figures: frames.";

/// Parameters of [`Frames`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Frames to write, from 0: 100..200 (without frame 200), 100.., ..200, or seconds, as in 1.5s..4s
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "RANGE", conflicts_with = "at")
    )]
    pub frames: Option<FrameRange>,
    /// Write every N-th frame of the range
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", conflicts_with = "at", default_value_t = Self::default().every))]
    pub every: u64,
    /// Write this frame, from 0; may be repeated
    #[cfg_attr(feature = "cli", arg(long, value_name = "FRAME"))]
    pub at: Vec<u64>,
    /// Quality of JPEG pictures, 1 to 100: higher is larger and closer to the frame
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", default_value_t = Self::default().quality))]
    pub quality: u8,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            frames: None,
            every: 1,
            at: Vec::new(),
            quality: WriteOptions::default().quality,
        }
    }
}

impl Operation for Frames {
    const NAME: &'static str = "video frames";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        vec![&self.output]
    }

    /// Writes the frames. The result lists them: `frame`, `file` and `seconds` from the first frame of the clip.
    ///
    /// Figures: `frames`.
    ///
    /// # Errors
    /// [`JobError::Parameter`] for a name without a place for the number where there are several frames, [`JobError::ReadClip`],
    /// [`JobError::Write`], [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            params,
        } = self;
        self.check(context)?;
        context.check_files(&self.inputs(), &[])?;
        let mut report = Report::of(self, params);
        let mut clip = open_clip(input, None, &mut report, context)?;
        report.check_output(output)?;
        let size = clip.info().size;
        let base = clip.info().time_base.to_f64();
        let mut list = Vec::new();
        let origin = if params.at.is_empty() {
            let range = params.frames.unwrap_or_default();
            let total = range.frames(clip.info()).unwrap_or(1);
            let phase = context.progress.phase("frames", total);
            let first = seek_start(&mut clip, input, &range)?;
            let origin = first.as_ref().map_or(0, |first| first.origin);
            let mut next = first.map(|first| (first.index, first.frame));
            let start = next.as_ref().map_or(0, |(index, _)| *index);
            while let Some((index, frame)) = next {
                context.progress.check()?;
                let time = frame.time.start;
                if range.is_behind(index, time.saturating_sub(origin) as f64 * base) {
                    break;
                }
                if (index - start).is_multiple_of(params.every) {
                    let file = self.write(index, frame, &mut report, context)?;
                    list.push((index, file, time));
                }
                phase.advance(1);
                let frame = clip.next_frame().map_err(read_error(input))?;
                next = frame.map(|frame| (index + 1, frame));
            }
            origin
        } else {
            let first = clip.next_frame().map_err(read_error(input))?;
            let phase = context.progress.phase("frames", params.at.len() as u64);
            for &index in &params.at {
                context.progress.check()?;
                clip.seek(index).map_err(read_error(input))?;
                let Some(frame) = clip.next_frame().map_err(read_error(input))? else {
                    return Err(JobError::EmptyRange {
                        path: input.clone(),
                        range: index.to_string(),
                    });
                };
                let time = frame.time.start;
                let file = self.write(index, frame, &mut report, context)?;
                list.push((index, file, time));
                phase.advance(1);
            }
            first.map_or(0, |frame| frame.time.start)
        };
        if let Some(damage) = clip.damage() {
            report.record_dropped(format!("{}: {damage}", input.display()));
        }
        if list.is_empty() {
            return Err(JobError::EmptyRange {
                path: input.clone(),
                range: params.frames.unwrap_or_default().to_string(),
            });
        }
        if Pattern::parse(output).is_some() {
            report
                .outputs
                .push(pictures(output, size, list.len() as u64));
        }
        report.figures.insert("frames", list.len() as f64);
        let entry = |(frame, file, time): &(u64, PathBuf, i64)| {
            let seconds = time.saturating_sub(origin) as f64 * base;
            json!({ "frame": frame, "file": file.display().to_string(), "seconds": seconds })
        };
        report.result = Some(list.iter().map(entry).collect());
        Ok(report)
    }
}

/// Numbered pictures, as a report names them.
fn pictures(path: &Path, size: Size, frames: u64) -> FileReport {
    FileReport {
        path: path.display().to_string(),
        format: "pictures".to_owned(),
        width: Some(size.width()),
        height: Some(size.height()),
        frames: Some(frames),
        ..FileReport::default()
    }
}

impl Frames {
    fn check(&self, context: &Context) -> Result<(), JobError> {
        let params = &self.params;
        let wrong = |field, value: String, range| {
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        if params.every == 0 {
            return wrong("every", "0".to_owned(), "at least 1");
        }
        if !(1..=100).contains(&params.quality) {
            return wrong("quality", params.quality.to_string(), "1 to 100");
        }
        if Pattern::parse(&self.output).is_some() {
            return check_clip_target(&self.output, context);
        }
        if params.at.len() != 1 {
            let range = "a name with a place for the number, as in frame_%04d.png, where there are several frames";
            return wrong("output", self.output.display().to_string(), range);
        }
        files::check_target(&self.output, context)?;
        context.check_files(&[], &[&self.output])
    }

    fn write(
        &self,
        index: u64,
        frame: Frame,
        report: &mut Report,
        context: &Context,
    ) -> Result<PathBuf, JobError> {
        let options = WriteOptions {
            quality: self.params.quality,
            ..WriteOptions::default()
        };
        let picture = Picture::from_image(frame.picture.into_image());
        let Some(pattern) = Pattern::parse(&self.output) else {
            files::write(&self.output, &picture, &options, report, context)?;
            return Ok(self.output.clone());
        };
        let path = pattern.path(index);
        report.check_output(&path)?;
        report.time("write", || ravec_media::write(&path, &picture, &options))?;
        Ok(path)
    }
}
