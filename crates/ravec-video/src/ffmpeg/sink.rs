//! Frames that FFmpeg encodes.

use super::encoders::{Choice, choose};
use super::layout::Layout;
use super::nut::{NutTrack, write_head, write_headers};
use super::process::{Process, Programs, file_argument};
use crate::color::{ColorInfo, Range, Siting, SitingAxis};
use crate::error::VideoError;
use crate::frame::Frame;
use crate::sink::{EncodeOptions, FrameSink, SinkFormat};
use crate::time::Rational;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::{ChildStdin, Stdio};

/// Seconds, times the numerator of the time base, that are added to all time stamps: the pipe has no negative ones, and
/// encoders that reorder frames need some before the first.
const LEAD: i64 = 10;

/// Encodes frames with FFmpeg in a child process into a file that [`assemble`](super::assemble) turns into the output.
///
/// See the page of the module for the guarantees.
#[derive(Debug)]
pub struct FfmpegSink {
    /// Before the process, so that its pipe is closed first.
    input: Option<BufWriter<ChildStdin>>,
    process: Process,
    format: SinkFormat,
    layout: Layout,
    color: ColorInfo,
    /// Ticks that are added to stamps.
    lead: i64,
    last: Option<i64>,
    frames: u64,
}

impl FfmpegSink {
    /// Begins to encode to the file `part`, which is replaced. `extension` is that of the output, and decides on the usual
    /// codec.
    ///
    /// # Errors
    /// [`VideoError::FfmpegMissing`]; [`VideoError::Options`] for a codec that is unknown, that this FFmpeg cannot encode, or
    /// that cannot keep the samples although `lossless` is asked for.
    pub fn create(
        part: &Path,
        extension: &str,
        format: &SinkFormat,
        options: &EncodeOptions,
    ) -> Result<Self, VideoError> {
        let extension = extension.to_ascii_lowercase();
        let programs = Programs::locate(&format!("writing .{extension}"))?;
        let choice = choose(&programs, &extension, format.pixels, format.size, options)?;
        let color = written_color(format, &choice.layout);
        let track = track(format, &choice.layout)?;
        let base = Rational::new(track.time_base.0, track.time_base.1).unwrap_or(Rational::ONE);

        let mut command = programs.ffmpeg();
        command.args(color_arguments(color, &choice.layout));
        command.args([
            "-f",
            "nut",
            "-i",
            "pipe:0",
            "-map",
            "0:v:0",
            "-c:v",
            choice.encoder,
        ]);
        command.args(["-pix_fmt", &choice.layout.name]);
        command.args(&choice.arguments);
        command.args(color_arguments(color, &choice.layout));
        command.args(programs.passthrough()?);
        command.args(["-copyts", "-avoid_negative_ts", "disabled"]);
        command.args([
            "-enc_time_base",
            &encoder_clock(&choice, format, base).to_string(),
        ]);
        command.args([
            "-map_metadata",
            "-1",
            "-fflags",
            "+bitexact",
            "-flags:v",
            "+bitexact+global_header",
        ]);
        command
            .args(["-f", part_format(&choice), "-y"])
            .arg(file_argument(part)?);
        let mut process = Process::start(command.stdin(Stdio::piped()).stdout(Stdio::null()))?;
        let input = process
            .take_stdin()
            .map(|stdin| BufWriter::with_capacity(1 << 14, stdin));
        let mut sink = Self {
            input,
            process,
            layout: choice.layout,
            color,
            lead: LEAD * i64::from(base.den()),
            format: SinkFormat {
                time_base: base,
                ..format.clone()
            },
            last: None,
            frames: 0,
        };
        sink.send(|input| write_headers(input, &track))?;
        Ok(sink)
    }

    /// Writes to the child. A pipe that breaks means that the child has ended, and it says why.
    fn send(
        &mut self,
        write: impl FnOnce(&mut BufWriter<ChildStdin>) -> std::io::Result<()>,
    ) -> Result<(), VideoError> {
        let Some(input) = &mut self.input else {
            return Err(VideoError::FfmpegFailed {
                message: "it ended before the last frame".to_owned(),
            });
        };
        let Err(error) = write(input) else {
            return Ok(());
        };
        if let Some(input) = self.input.take() {
            // without a last attempt to write what the buffer has
            drop(input.into_parts());
        }
        let ended = self.process.wait()?;
        if ended.lines.is_empty() && !ended.killed() {
            return Err(error.into());
        }
        Err(ended.into_error())
    }
}

impl FrameSink for FfmpegSink {
    fn write(&mut self, frame: &Frame) -> Result<(), VideoError> {
        if frame.picture.size() != self.format.size {
            return Err(VideoError::SizeChanged {
                frame: self.frames,
                found: frame.picture.size(),
                expected: self.format.size,
            });
        }
        let start = frame.time.start.saturating_add(self.lead);
        // two frames at the same moment are one tick apart
        let stamp = self
            .last
            .map_or(start, |last| start.max(last.saturating_add(1)));
        let pts = u64::try_from(stamp)
            .ok()
            .filter(|pts| *pts < 1 << 55)
            .ok_or_else(|| {
                VideoError::Options(format!(
                    "frame {} has a time that is out of range",
                    self.frames
                ))
            })?;
        self.last = Some(stamp);
        self.frames += 1;
        let (layout, color) = (self.layout.clone(), self.color);
        let bytes = layout.frame_bytes(self.format.size);
        self.send(|input| {
            write_head(input, pts, bytes)?;
            layout.write_frame(input, &frame.picture, color)
        })
    }

    fn finish(mut self: Box<Self>) -> Result<(), VideoError> {
        if self.frames == 0 {
            return Err(VideoError::Options(
                "a clip needs at least one frame".to_owned(),
            ));
        }
        self.send(|input| input.flush())?;
        self.input = None;
        let ended = self.process.wait()?;
        if ended.status.success() {
            Ok(())
        } else {
            Err(ended.into_error())
        }
    }
}

/// The meaning of the planes that are written.
fn written_color(format: &SinkFormat, layout: &Layout) -> ColorInfo {
    let color = format.yuv_color();
    ColorInfo {
        range: layout.implied_range().unwrap_or(color.range),
        ..color
    }
}

fn track(format: &SinkFormat, layout: &Layout) -> Result<NutTrack, VideoError> {
    let too_large =
        || VideoError::Options(format!("frames of {} pixels are too large", format.size));
    let side = |side: usize| u32::try_from(side).map_err(|_| too_large());
    let fourcc = layout.fourcc().ok_or_else(|| VideoError::Unsupported {
        feature: format!("the pixel layout {}", layout.name),
        hint: None,
    })?;
    let pair = |rational: Rational| {
        let rational = rational.reduced();
        (rational.num(), rational.den())
    };
    let time_base = pair(format.time_base);
    if time_base.0.max(time_base.1) > i32::MAX as u32 {
        return Err(VideoError::Options(format!(
            "the time base {} is out of range",
            format.time_base
        )));
    }
    Ok(NutTrack {
        width: side(format.size.width())?,
        height: side(format.size.height())?,
        pixel_aspect: pair(format.pixel_aspect),
        time_base,
        rate: format.rate.map(pair),
        fourcc,
    })
}

/// The clock of the encoder: that of the stamps, except for codecs that only have rates.
fn encoder_clock(choice: &Choice, format: &SinkFormat, base: Rational) -> Rational {
    let rates_only = matches!(
        choice.codec,
        "mpeg4" | "mpeg2video" | "mpeg1video" | "theora"
    );
    match format.rate {
        Some(rate) if rates_only => rate.recip().reduced(),
        _ => base,
    }
}

/// The container of parts: NUT has exact stamps and any codec. It leaves out what WebM stores beside the frames: their alpha.
fn part_format(choice: &Choice) -> &'static str {
    if choice.codec.starts_with("vp") && choice.layout.alpha() {
        "matroska"
    } else {
        "nut"
    }
}

/// The meaning of samples, for the decoder of raw frames and for the encoder alike, so that nothing is converted between them.
fn color_arguments(color: ColorInfo, layout: &Layout) -> Vec<String> {
    let mut arguments = Vec::new();
    let mut add = |name: &str, code: u8| {
        arguments.extend([name.to_owned(), code.to_string()]);
    };
    if layout.yuv_format().is_none() {
        // the matrix of red, green and blue, all codes
        add("-colorspace", 0);
        add("-color_range", 2);
    } else if color.tagged {
        add("-colorspace", color.matrix_code());
        add(
            "-color_range",
            if color.range == Range::Full { 2 } else { 1 },
        );
    } else if layout.implied_range().is_some() || color.range == Range::Full {
        add("-color_range", 2);
    }
    add("-color_primaries", color.primaries);
    add("-color_trc", color.transfer);
    if layout
        .yuv_format()
        .is_some_and(|format| format.subsampling.log2_steps().is_some())
    {
        add("-chroma_sample_location", siting_code(color.siting));
    }
    arguments
}

/// The numbers of FFmpeg for the places of chroma.
fn siting_code(siting: Siting) -> u8 {
    match (siting.x, siting.y) {
        (SitingAxis::First, SitingAxis::Center) => 1,
        (SitingAxis::Center, SitingAxis::Center) => 2,
        (SitingAxis::First, SitingAxis::First) => 3,
        (SitingAxis::Center, SitingAxis::First) => 4,
        (SitingAxis::First, SitingAxis::Last) => 5,
        (SitingAxis::Center, SitingAxis::Last) => 6,
        // no code: unspecified
        (SitingAxis::Last, _) => 0,
    }
}
