//! Frames that FFmpeg encodes.

use super::encoders::{Choice, choose};
use super::layout::Layout;
use super::nut::{NutTrack, write_head, write_headers};
use super::process::{Process, Programs, file_argument};
use crate::color::{ColorInfo, Range, Siting, SitingAxis};
use crate::error::VideoError;
use crate::frame::Frame;
use crate::sink::{EncodeOptions, FrameSink, SinkFormat};
use crate::time::{Rational, rescale};
use ravec_raster::Size;
use std::ffi::OsString;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::{ChildStdin, Command, Stdio};

/// Encodes frames with FFmpeg in a child process into a file that [`assemble`](super::assemble) turns into the output.
///
/// See the page of the module for the guarantees.
#[derive(Debug)]
pub struct FfmpegSink {
    /// The call up to its output, and the output, until the first frame comes.
    call: Option<(Command, OsString)>,
    child: Option<Child>,
    track: NutTrack,
    layout: Layout,
    color: ColorInfo,
    size: Size,
    /// Time stamp of the first frame, at which the part begins.
    first: i64,
    last: Option<i64>,
    frames: u64,
}

#[derive(Debug)]
struct Child {
    /// Before the process, so that its pipe is closed first.
    input: Option<BufWriter<ChildStdin>>,
    process: Process,
}

impl FfmpegSink {
    /// Prepares to encode to the file `part`, which is replaced. `extension` is that of the output, and decides on the usual
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
        let tags = color_arguments(color, &choice.layout);

        let mut command = programs.ffmpeg();
        command.args(&tags);
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
        command.args(&tags);
        command.args(programs.passthrough()?);
        command.args(["-enc_time_base", &encoder_clock(&choice, format, &track)]);
        command.args(["-map_metadata", "-1", "-fflags", "+bitexact"]);
        command.args(["-flags:v", "+bitexact+global_header"]);
        command.args(part_format(&choice));
        Ok(Self {
            call: Some((command, file_argument(part)?)),
            child: None,
            track,
            layout: choice.layout,
            color,
            size: format.size,
            first: 0,
            last: None,
            frames: 0,
        })
    }

    /// Starts the child for a part that begins at `first`.
    fn start(&mut self, first: i64) -> Result<(), VideoError> {
        let Some((mut command, output)) = self.call.take() else {
            return Ok(());
        };
        let (num, den) = self.track.time_base;
        let comment = format!("comment={}", part_start(first, num, den));
        command.args(["-metadata", &comment, "-y"]).arg(output);
        let mut process = Process::start(command.stdin(Stdio::piped()).stdout(Stdio::null()))?;
        let stdin = process.take_stdin();
        let input = stdin.map(|stdin| BufWriter::with_capacity(1 << 14, stdin));
        self.child = Some(Child { input, process });
        self.first = first;
        let track = self.track;
        self.send(|input| write_headers(input, &track))
    }

    #[cfg(test)]
    pub(super) fn kill_child(&mut self) {
        self.child.iter_mut().for_each(|child| child.process.kill());
    }

    /// Writes to the child. A pipe that breaks means that the child has ended, and it says why.
    fn send(
        &mut self,
        write: impl FnOnce(&mut BufWriter<ChildStdin>) -> std::io::Result<()>,
    ) -> Result<(), VideoError> {
        let Some((child, input)) = self
            .child
            .as_mut()
            .and_then(|child| child.input.take().map(|input| (child, input)))
        else {
            return Err(VideoError::FfmpegFailed {
                message: "it ended before the last frame".to_owned(),
            });
        };
        let mut input = input;
        let Err(error) = write(&mut input) else {
            child.input = Some(input);
            return Ok(());
        };
        // without a last attempt to write what the buffer has
        drop(input.into_parts());
        let ended = child.process.wait()?;
        if ended.lines.is_empty() && !ended.killed() {
            return Err(error.into());
        }
        Err(ended.into_error())
    }
}

impl FrameSink for FfmpegSink {
    fn write(&mut self, frame: &Frame) -> Result<(), VideoError> {
        if frame.picture.size() != self.size {
            return Err(VideoError::SizeChanged {
                frame: self.frames,
                found: frame.picture.size(),
                expected: self.size,
            });
        }
        let start = frame.time.start;
        if self.call.is_some() {
            self.start(start)?;
        }
        // two frames at the same moment are one tick apart
        let stamp = self
            .last
            .map_or(start, |last| start.max(last.saturating_add(1)));
        let pts = stamp
            .checked_sub(self.first)
            .and_then(|pts| u64::try_from(pts).ok())
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
        let bytes = layout.frame_bytes(self.size);
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
        self.send(Write::flush)?;
        let Some(mut child) = self.child.take() else {
            return Ok(());
        };
        child.input = None;
        let ended = child.process.wait()?;
        if ended.status.success() {
            Ok(())
        } else {
            Err(ended.into_error())
        }
    }
}

/// The start of a part as it is noted in its file.
fn part_start(first: i64, num: u32, den: u32) -> String {
    format!("{first}*{num}/{den}")
}

/// Microseconds of a start that was noted by [`part_start`].
pub(super) fn read_part_start(text: &str) -> Option<i64> {
    let (first, base) = text.split_once('*')?;
    let base: Rational = base.parse().ok()?;
    let micro = Rational::new(1, 1_000_000)?;
    Some(rescale(first.parse().ok()?, base, micro))
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

/// The clock of the encoder: that of the stamps, except for codecs that only have rates, or coarse clocks.
fn encoder_clock(choice: &Choice, format: &SinkFormat, track: &NutTrack) -> String {
    let rates_only = matches!(
        choice.codec,
        "mpeg4" | "mpeg2video" | "mpeg1video" | "theora"
    );
    let (num, den) = track.time_base;
    match format.rate.map(Rational::reduced) {
        Some(rate) if rates_only => format!("{}/{}", rate.den(), rate.num()),
        None if choice.codec == "mpeg4" && den > 65_535 => "1/1000".to_owned(),
        _ => format!("{num}/{den}"),
    }
}

/// The container of parts. QuickTime has exact times of decoding for codecs that reorder frames, NUT takes all others, and
/// Matroska the alpha of VP8 and VP9, which is stored beside the frames.
fn part_format(choice: &Choice) -> &'static [&'static str] {
    match choice.codec {
        "h264" | "hevc" => &["-use_editlist", "0", "-f", "mov"],
        "vp8" | "vp9" if choice.layout.alpha() => &["-f", "matroska"],
        _ => &["-f", "nut"],
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_start_of_a_part_is_noted_exactly() {
        let note = part_start(-12_345_678_901, 1001, 30000);
        assert_eq!(note, "-12345678901*1001/30000");
        assert_eq!(read_part_start(&note), Some(-411_934_152_663_367));
        for wrong in ["", "5", "5*", "5*1/0", "x*1/25"] {
            assert_eq!(read_part_start(wrong), None);
        }
    }
}
