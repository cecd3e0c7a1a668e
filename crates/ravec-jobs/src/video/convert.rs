//! `video convert`: a clip in another format, size, rate or range.

use super::clip::{ClipOutput, OutputShape, check_clip_target, open_clip, read_error};
use super::conversion::Conversion;
use super::map::key_of;
use super::{Encoding, FrameRange};
use crate::context::Context;
use crate::error::JobError;
use crate::operation::Operation;
use crate::report::Report;
use crate::retarget::SizeSpec;
use ravec::raster::{AnyImage, ResizeFilter, Size, resize, with_image};
use ravec_video::{Clip, Frame, FramePicture, FrameSource as _, FrameTime, Rational};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Convert a clip to another format, size, rate or range of frames
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Convert {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png, or `-` for Y4M on standard input
    pub input: PathBuf,
    /// Output clip; its extension selects the format, a pattern such as out_%04d.png writes numbered pictures, `-` is Y4M on
    /// standard output
    pub output: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec video convert clip.y4m clip.mp4
  ravec video convert clip.mp4 small.gif --frames 2..6 --size 50%
  ravec video convert clip.mp4 frame_%04d.png
  ravec video convert frame_%04d.png clip.y4m --input-rate 24 --lossless
  ravec video convert clip.mp4 slow.mp4 --rate 50 --video-quality 90

MP4 and MOV with H.264, Y4M, numbered pictures, GIF and APNG need nothing else; other formats and codecs need FFmpeg. Sound and \
subtitles are copied where the format allows. A run that was interrupted goes on with --resume from its last whole chunk of 250 \
frames, and gives the same bytes.

Figures: frames, duration_secs.";

/// Parameters of [`Convert`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Frames to keep, from 0: 100..200 (without frame 200), 100.., ..200, or seconds, as in 1.5s..4s
    #[cfg_attr(feature = "cli", arg(long, value_name = "RANGE"))]
    pub frames: Option<FrameRange>,
    /// New size, as in 1280x720, 1280x, or 50%; a side that is left out follows the other one
    #[cfg_attr(feature = "cli", arg(long, value_name = "WxH"))]
    pub size: Option<SizeSpec>,
    /// New constant rate in frames a second, as in 25, 29.97 or 30000/1001: frames are repeated or left out, the duration
    /// stays
    #[cfg_attr(feature = "cli", arg(long, value_name = "RATE"))]
    pub rate: Option<Rational>,
    /// Rate of numbered pictures or Y4M, which takes the place of theirs [default: 25 for pictures]
    #[cfg_attr(feature = "cli", arg(long, value_name = "RATE"))]
    pub input_rate: Option<Rational>,
    /// Encoding of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

impl Params {
    /// Size of the frames that a conversion makes of those with this size.
    fn size_of(&self, size: Size, max_pixels: u64) -> Result<Size, JobError> {
        match &self.size {
            // pixels need not be square
            Some(wanted) => wanted.of(size, wanted.has_open_side(), max_pixels),
            None => Ok(size),
        }
    }

    /// A frame as the conversion makes it.
    ///
    /// # Errors
    /// [`JobError`] for a size with too many pixels, or of another shape.
    pub fn frame(&self, image: &AnyImage, context: &Context) -> Result<AnyImage, JobError> {
        let size = self.size_of(image.size(), context.limits.max_pixels)?;
        Ok(if size == image.size() {
            image.clone()
        } else {
            resized_image(image, size)
        })
    }
}

impl Operation for Convert {
    const NAME: &'static str = "video convert";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        vec![&self.output]
    }

    /// Converts the clip. Samples are copied as they are where the format of the output holds them.
    ///
    /// Figures: `frames` of the output, `duration_secs`.
    ///
    /// # Errors
    /// [`JobError::ReadClip`], [`JobError::WriteClip`], what [`check_files`](crate::check_files) refuses,
    /// [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            params,
        } = self;
        check_clip_target(output, context)?;
        context.check_files(&self.inputs(), &[])?;
        let mut report = Report::of(self, params);
        let mut clip = open_clip(input, params.input_rate, &mut report, context)?;
        report.check_output(output)?;
        let start = Instant::now();
        let info = clip.info().clone();
        let range = params.frames.unwrap_or_default();
        let size = params.size_of(info.size, context.limits.max_pixels)?;
        let Some(first) = seek_start(&mut clip, input, &range)? else {
            return Err(JobError::EmptyRange {
                path: input.clone(),
                range: range.to_string(),
            });
        };
        let base = info.time_base.to_f64();
        let shape = OutputShape {
            size,
            rate: params.rate,
            start_secs: first.frame.time.start as f64 * base,
            end_secs: range.end_secs(&info, first.origin),
            pixels: None,
        };
        let key = key_of(self);
        let mut written = ClipOutput::create(
            output,
            (input, &clip),
            &shape,
            &params.encoding,
            &key,
            context,
        )?;
        let total = range.frames(&info).unwrap_or(1);
        let phase = context.progress.phase("frames", total);
        let conversion = Conversion::new(params, info.time_base);
        let mut conversion = conversion.starting_at(first.index, first.origin);
        let mut next = Some(first.frame);
        while let Some(frame) = next {
            context.progress.check()?;
            let Some(frames) = conversion.push(frame.time, frame.picture) else {
                break;
            };
            for (time, picture) in frames {
                written.write(resized(picture, time, size, &written), &report)?;
            }
            phase.advance(1);
            next = clip.next_frame().map_err(read_error(input))?;
        }
        for (time, picture) in conversion.finish() {
            written.write(resized(picture, time, size, &written), &report)?;
        }
        if let Some(damage) = clip.damage() {
            report.record_dropped(format!("{}: {damage}", input.display()));
        }
        let (frames, seconds) = (written.frames(), written.duration_secs());
        written.finish(&mut report)?;
        report.add_time("frames", start);
        report.figures.insert("frames", frames as f64);
        report.figures.insert("duration_secs", seconds);
        Ok(report)
    }
}

/// The first frame of a range.
pub(crate) struct First {
    pub index: u64,
    pub frame: Frame,
    /// Stamp of the first frame of the clip.
    pub origin: i64,
}

/// Goes to the first frame of a range; `None` if the clip has none.
pub(crate) fn seek_start(
    clip: &mut Clip,
    path: &Path,
    range: &FrameRange,
) -> Result<Option<First>, JobError> {
    let failed = read_error(path);
    let Some(mut frame) = clip.next_frame().map_err(&failed)? else {
        return Ok(None);
    };
    let (mut index, origin) = (0, frame.time.start);
    if let Some(start) = range.first_frame().filter(|start| *start > 1) {
        clip.seek(start).map_err(&failed)?;
        index = start;
        match clip.next_frame().map_err(&failed)? {
            Some(found) => frame = found,
            None => return Ok(None),
        }
    }
    let base = clip.info().time_base.to_f64();
    while range.is_before(index, frame.time.start.saturating_sub(origin) as f64 * base) {
        match clip.next_frame().map_err(&failed)? {
            Some(found) => frame = found,
            None => return Ok(None),
        }
        index += 1;
    }
    Ok(Some(First {
        index,
        frame,
        origin,
    }))
}

/// The frame in this size. Frames that are there already need no pixels.
fn resized(picture: FramePicture, time: FrameTime, size: Size, written: &ClipOutput) -> Frame {
    let picture = if picture.size() == size || written.is_done() {
        picture
    } else {
        FramePicture::Image(resized_image(&picture.into_image(), size))
    };
    Frame { picture, time }
}

/// A frame in this size.
fn resized_image(image: &AnyImage, size: Size) -> AnyImage {
    with_image!(image, image => resize(image, size, ResizeFilter::Lanczos3).into())
}
