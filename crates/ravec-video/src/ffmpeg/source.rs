//! Frames that FFmpeg decodes.

use super::nut::{NutError, NutReader};
use super::probe::Probe;
use super::process::{Ended, Process, Programs, input_arguments};
use super::salvage::{Salvage, tolerant};
use super::stamps::Stamps;
use crate::error::VideoError;
use crate::frame::{Frame, FramePicture};
use crate::info::ClipInfo;
use crate::limits::VideoLimits;
use crate::source::{Damage, FrameSource};
use crate::time::{FrameTime, Rational, rescale};
use crate::turn::turned;
use ravec_memory::Reservation;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Stdio};

/// Frames up to which going forward reads on instead of starting anew: a start costs some 50 ms.
const READ_ON: u64 = 48;
/// Frames that are held at a time: the one that is given, the next one, and what turns it.
const FRAMES_IN_MEMORY: u64 = 3;
/// Bytes of the buffer for the heads of frames. Contents are read around it.
const BUFFER: usize = 1 << 12;

/// A clip that FFmpeg decodes in a child process.
///
/// See the page of the module for the guarantees.
#[derive(Debug)]
pub struct FfmpegSource {
    programs: Programs,
    passthrough: [&'static str; 2],
    path: PathBuf,
    limits: VideoLimits,
    probe: Probe,
    run: Option<Run>,
    /// The frame that comes next, which waits for the stamp after it.
    ahead: Option<Decoded>,
    /// Index of the next frame that is given.
    position: u64,
    /// Frames of the clip up to its end, once that was met.
    length: Option<u64>,
    /// Stamp of the last frame that was read, in the order of the clip.
    last: Option<i64>,
    stamps: Option<Stamps>,
    /// True once the packets have been listed, with or without success.
    listed: bool,
    /// True if decoding goes on behind damage, because it begins with it.
    lenient: bool,
    /// The frames that are given, once damage was met and whole frames are known to follow.
    salvage: Option<Salvage>,
    /// True if the run decodes from the beginning, and so has met no damage before its frames.
    counted: bool,
    /// Number of the next decoded frame of a run, with those that are left out.
    decoded: u64,
    damage: Option<Damage>,
    _memory: Reservation,
}

/// A child that decodes.
#[derive(Debug)]
struct Run {
    /// Before the process, so that its pipe is closed first.
    frames: Option<NutReader<BufReader<ChildStdout>>>,
    process: Process,
    time_base: Rational,
}

#[derive(Debug)]
struct Decoded {
    picture: FramePicture,
    /// In FFmpeg's clock.
    stamp: i64,
}

/// The first frame of a run.
#[derive(Debug, Clone, Copy)]
enum Start {
    /// The frame of this number.
    Index(u64),
    /// The same by its stamp, by way of the key frame at `key`.
    Stamp { index: u64, stamp: i64, key: i64 },
}

impl FfmpegSource {
    /// Opens a file. `needed_for` names its format in the message for a missing FFmpeg, such as `this kind of clip`.
    ///
    /// # Errors
    /// [`VideoError::FfmpegMissing`], and those of files that FFmpeg cannot read, that have no frames, or that break the
    /// limits.
    pub fn open(path: &Path, needed_for: &str, limits: &VideoLimits) -> Result<Self, VideoError> {
        let programs = Programs::locate(needed_for)?;
        let probe = Probe::of_file(&programs, path, limits)?;
        let bytes = probe.layout.frame_bytes(probe.stored_size);
        let memory = limits
            .pictures
            .memory
            .reserve(bytes.saturating_mul(FRAMES_IN_MEMORY))?;
        let mut source = Self {
            passthrough: programs.passthrough()?,
            programs,
            path: std::path::absolute(path)?,
            limits: limits.clone(),
            probe,
            run: None,
            ahead: None,
            position: 0,
            length: None,
            last: None,
            stamps: None,
            listed: false,
            lenient: false,
            salvage: None,
            counted: false,
            decoded: 0,
            damage: None,
            _memory: memory,
        };
        source.start_at_the_beginning()?;
        Ok(source)
    }

    /// Decodes the first frame. Of a clip whose beginning is damaged, the whole frames behind it are given; if there are
    /// none for sure, it is decoded again without the promise to stop at damage.
    fn start_at_the_beginning(&mut self) -> Result<(), VideoError> {
        self.launch(Start::Index(0))?;
        self.ahead = match self.decode() {
            Ok(Some(frame)) => Some(frame),
            Ok(None) => self.start_behind("it has no frame at its beginning".to_owned())?,
            Err(VideoError::Damaged { reason }) => self.start_behind(reason)?,
            Err(error) => return Err(error),
        };
        if self.ahead.is_none() {
            return Err(VideoError::Damaged {
                reason: "it has no frame that can be decoded".to_owned(),
            });
        }
        Ok(())
    }

    /// The first frame behind a damaged beginning.
    fn start_behind(&mut self, reason: String) -> Result<Option<Decoded>, VideoError> {
        (self.damage, self.length) = (None, None);
        let salvage = Salvage::of_file(&self.programs, &self.path, &self.probe, &self.limits)?;
        if salvage.kept() == 0 {
            self.lenient = true;
        } else {
            self.damage = Some(Damage {
                frames: salvage.first_lost().unwrap_or(0),
                reason,
                lost: salvage.lost_between(),
            });
            self.length = Some(salvage.kept());
            self.listed = true;
            self.salvage = Some(salvage);
        }
        self.launch(Start::Index(0))?;
        self.decode()
    }

    /// Ends the running child and starts another one.
    fn launch(&mut self, start: Start) -> Result<(), VideoError> {
        self.run = None;
        self.ahead = None;
        self.last = None;
        let probe = &self.probe;
        let mut command = self.programs.ffmpeg();
        if self.salvage.is_some() {
            command.args(tolerant());
        } else {
            if !self.lenient {
                // damage ends decoding instead of being painted over
                command.args(["-xerror", "-err_detect", "explode"]);
            }
            command.arg("-copyts");
        }
        command.arg("-noautorotate");
        command.args([
            "-max_pixels",
            &self
                .limits
                .pictures
                .max_pixels
                .min(i32::MAX as u64)
                .to_string(),
        ]);
        if let Some(decoder) = probe.decoder {
            command.args(["-c:v", decoder]);
        }
        if let Start::Stamp { key, .. } = start {
            let micro = Rational::new(1, 1_000_000).unwrap_or(Rational::ONE);
            let seconds = rescale(key, probe.info.time_base, micro) as f64 / 1e6;
            command.args([
                "-noaccurate_seek",
                "-seek_timestamp",
                "1",
                "-ss",
                &format!("{seconds:.6}"),
            ]);
        }
        command.args(input_arguments(&self.path)?);
        command.args(["-map", &format!("0:{}", probe.track)]);
        let filters = self.filters(start);
        if !filters.is_empty() {
            command.args(["-filter:v", &filters.join(",")]);
        }
        command.args([
            "-autoscale",
            "0",
            "-c:v",
            "rawvideo",
            "-pix_fmt",
            &probe.layout.name,
        ]);
        command.args(["-sws_flags", "accurate_rnd+full_chroma_int+bitexact"]);
        command.args(self.passthrough);
        command.args(["-enc_time_base", &probe.info.time_base.to_string()]);
        command.args(["-avoid_negative_ts", "disabled", "-flush_packets", "1"]);
        command.args(["-f", "nut", "pipe:1"]);
        let mut process = Process::start(command.stdin(Stdio::null()).stdout(Stdio::piped()))?;
        let stdout = process.take_stdout();
        let frames = match stdout {
            Some(stdout) => match NutReader::open(BufReader::with_capacity(BUFFER, stdout)) {
                Ok(frames) => frames,
                Err(error) => return Err(self.broken_pipe(process, &error)),
            },
            None => None,
        };
        let time_base = match &frames {
            Some(frames) => {
                let (num, den) = frames.time_base();
                Rational::new(num, den).unwrap_or(Rational::ONE)
            }
            None => Rational::ONE,
        };
        self.run = Some(Run {
            frames,
            process,
            time_base,
        });
        let (Start::Index(index) | Start::Stamp { index, .. }) = start;
        self.position = index;
        self.decoded = self.decoded_number(index);
        self.counted = matches!(start, Start::Index(_));
        Ok(())
    }

    fn filters(&self, start: Start) -> Vec<String> {
        let mut filters = Vec::new();
        match start {
            Start::Index(0) => {}
            Start::Index(index) => {
                let number = self.decoded_number(index);
                filters.push(format!("select=gte(n\\,{number})"));
            }
            Start::Stamp { stamp, .. } => filters.push(format!("select=gte(pts\\,{stamp})")),
        }
        if self.shift() != 0 {
            filters.push(format!("setpts=PTS+{}", self.shift()));
        }
        filters
    }

    /// Number of the frame `index` among all that the decoder gives.
    fn decoded_number(&self, index: u64) -> u64 {
        let salvage = self.salvage.as_ref();
        salvage.map_or(index, |salvage| salvage.decoded_number(index))
    }

    /// Ticks that are added in the child, because no negative stamp goes through the pipe.
    fn shift(&self) -> i64 {
        if self.probe.start < 0 && self.salvage.is_none() {
            self.probe.start.saturating_mul(-2)
        } else {
            0
        }
    }

    fn broken_pipe(&self, mut process: Process, error: &NutError) -> VideoError {
        process.kill();
        match process.wait() {
            Ok(ended) if !ended.lines.is_empty() => VideoError::FfmpegFailed {
                message: self.without_path(&ended.message()),
            },
            _ => VideoError::FfmpegFailed {
                message: error.to_string(),
            },
        }
    }

    /// The message without the path, which the caller names.
    fn without_path(&self, message: &str) -> String {
        let path = self.path.display();
        let message = message
            .strip_prefix(&format!("file:{path}: "))
            .or_else(|| message.strip_prefix(&format!("Error opening input file file:{path}. ")))
            .unwrap_or(message);
        message.trim_end_matches('.').to_owned()
    }

    /// Decodes the frame `position`; `None` at the end, of which the reason is recorded.
    fn decode(&mut self) -> Result<Option<Decoded>, VideoError> {
        let probe = &self.probe;
        let Some(run) = self.run.as_mut() else {
            return Ok(None);
        };
        // a clip has one length, wherever its reading begins
        if self.length.is_some_and(|length| self.position >= length) {
            return Ok(None);
        }
        let found = loop {
            let found = match &mut run.frames {
                None => Ok(None),
                Some(frames) => read_frame(frames, probe),
            };
            let number = self.decoded;
            self.decoded += 1;
            let salvage = self.salvage.as_ref();
            if !matches!(found, Ok(Some(_))) || !salvage.is_some_and(|s| s.leaves_out(number)) {
                break found;
            }
        };
        match found {
            Ok(Some((picture, pts))) => {
                self.limits.check_frame(self.position)?;
                let stamp = rescale(pts, run.time_base, probe.info.time_base);
                let stamp = match &self.salvage {
                    // the clock of such a run begins with the clip
                    Some(_) => stamp.saturating_add(self.probe.start),
                    None => stamp.saturating_sub(self.shift()),
                };
                // stamps never decrease, whatever a file says
                let stamp = self.last.map_or(stamp, |last| stamp.max(last));
                self.last = Some(stamp);
                let picture = turned(picture, self.probe.info.rotation);
                Ok(Some(Decoded { picture, stamp }))
            }
            ended => {
                self.end(ended.err().as_ref())?;
                self.go_on()
            }
        }
    }

    /// The frame `position` behind damage that ended a run, if whole frames follow. What follows is found out once.
    fn go_on(&mut self) -> Result<Option<Decoded>, VideoError> {
        let position = self.position;
        let (None, false, Some(damage)) = (&self.salvage, self.lenient, self.damage.clone()) else {
            return Ok(None);
        };
        let mut salvage = Salvage::of_file(&self.programs, &self.path, &self.probe, &self.limits)?;
        if self.counted {
            salvage = salvage.trusting(damage.frames);
        }
        if salvage.kept() <= damage.frames {
            return Ok(None);
        }
        self.damage = Some(Damage {
            frames: salvage.first_lost().unwrap_or(damage.frames),
            reason: damage.reason,
            lost: salvage.lost_between(),
        });
        self.length = Some(salvage.kept());
        self.stamps = None;
        self.listed = true;
        self.salvage = Some(salvage);
        let last = self.last;
        self.launch(Start::Index(position))?;
        self.last = last;
        self.decode()
    }

    /// Records why the child gives no frame `position`.
    fn end(&mut self, error: Option<&NutError>) -> Result<(), VideoError> {
        let Some(mut run) = self.run.take() else {
            return Ok(());
        };
        // closes the pipe: a child that still writes ends
        run.frames = None;
        let frames = self.position;
        if let Some(error @ (NutError::FrameSize { .. } | NutError::Damaged(_))) = error {
            let reason = match error {
                NutError::FrameSize { .. } => "the size of the frames changes".to_owned(),
                other => other.to_string(),
            };
            return self.end_with(frames, reason);
        }
        let ended = run.process.wait()?;
        if ended.killed() {
            let status = ended.status;
            return Err(VideoError::FfmpegFailed {
                message: format!("the program was stopped at frame {frames} ({status})"),
            });
        }
        match (damage_of(&ended), error) {
            // what there is to say is known
            _ if self.salvage.is_some() => {
                self.length = Some(frames);
                Ok(())
            }
            (Some(reason), _) => self.end_with(frames, self.without_path(&reason)),
            (None, Some(error)) => Err(VideoError::FfmpegFailed {
                message: error.to_string(),
            }),
            (None, None) => {
                self.length = Some(frames);
                Ok(())
            }
        }
    }

    fn end_with(&mut self, frames: u64, reason: String) -> Result<(), VideoError> {
        if frames == 0 {
            return Err(VideoError::Damaged { reason });
        }
        self.length = Some(frames);
        self.damage = Some(Damage {
            frames,
            reason,
            lost: None,
        });
        Ok(())
    }

    /// Ticks of a frame without a next one: up to the stated end of the track if that is near, else one period.
    fn last_duration(&self, start: i64) -> u64 {
        let base = self.probe.info.time_base;
        let period = self
            .probe
            .info
            .rate
            .map_or(1, |rate| rescale(1, rate.recip(), base).max(1));
        let rest = self.probe.end.and_then(|end| end.checked_sub(start));
        // damaged files state ends that are far behind their last frame
        match rest {
            Some(rest)
                if rest > 0 && rest <= period.saturating_mul(100) && self.damage.is_none() =>
            {
                rest as u64
            }
            _ => period as u64,
        }
    }

    /// Lists the time stamps once, and gives them if they can be relied on.
    fn list_stamps(&mut self) -> Result<Option<&Stamps>, VideoError> {
        if !self.listed {
            self.listed = true;
            if !self.lenient {
                let first = self.first_stamp()?;
                let stamps =
                    Stamps::of_file(&self.programs, &self.path, &self.probe, &self.limits)?;
                self.stamps = stamps.filter(|stamps| stamps.stamp(0) == first);
            }
        }
        Ok(self.stamps.as_ref())
    }

    /// The stamp of the first frame by decoding.
    fn first_stamp(&mut self) -> Result<Option<i64>, VideoError> {
        if self.position != 0 || self.ahead.is_none() {
            self.launch(Start::Index(0))?;
            self.ahead = self.decode()?;
        }
        Ok(self.ahead.as_ref().map(|frame| frame.stamp))
    }

    /// Starts a child whose first frame is that of the index.
    fn restart(&mut self, index: u64) -> Result<(), VideoError> {
        let known = (self.length, self.damage.clone());
        if let Some(stamps) = self.list_stamps()? {
            if index >= stamps.len() {
                self.finish_at(index);
                return Ok(());
            }
            let stamp = stamps.stamp(index);
            let key = stamp.and_then(|stamp| stamps.key_before(stamp));
            if let Some((stamp, key)) = stamp.zip(key) {
                if self.launch(Start::Stamp { index, stamp, key }).is_ok()
                    && let Ok(Some(frame)) = self.decode()
                    && frame.stamp == stamp
                {
                    self.ahead = Some(frame);
                    return Ok(());
                }
                // the container does not find its own frames
                self.stamps = None;
                (self.length, self.damage) = known;
            }
        }
        self.launch(Start::Index(index))?;
        self.ahead = self.decode()?;
        Ok(())
    }

    fn finish_at(&mut self, index: u64) {
        self.run = None;
        self.ahead = None;
        self.position = index;
    }
}

/// The next frame and its stamp in the clock of the pipe.
fn read_frame(
    frames: &mut NutReader<BufReader<ChildStdout>>,
    probe: &Probe,
) -> Result<Option<(FramePicture, i64)>, NutError> {
    let size = probe.stored_size;
    let Some(head) = frames.next_head(probe.layout.frame_bytes(size))? else {
        return Ok(None);
    };
    let picture = probe
        .layout
        .read_frame(frames, head, size, probe.stored_color)?;
    Ok(Some((picture, head.pts)))
}

/// The reason of an early end; `None` for a clip that was read as a whole.
fn damage_of(ended: &Ended) -> Option<String> {
    if !ended.status.success() {
        return Some(ended.message());
    }
    // FFmpeg takes a file that is cut for one that ends, and says so on the side
    let signs = [
        "ended prematurely",
        "truncat",
        "corrupt",
        "partial file",
        "invalid data",
        "error while decoding",
        "error reading",
        "damaged",
        "premature end",
    ];
    let is_sign = |line: &&String| {
        let line = line.to_ascii_lowercase();
        signs.iter().any(|sign| line.contains(sign))
    };
    ended.lines.iter().rev().find(is_sign).cloned()
}

impl FrameSource for FfmpegSource {
    fn info(&self) -> &ClipInfo {
        &self.probe.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        let Some(frame) = self.ahead.take() else {
            return Ok(None);
        };
        let start = frame.stamp.saturating_sub(self.probe.start);
        self.position += 1;
        self.ahead = self.decode()?;
        let duration = match &self.ahead {
            Some(next) => next.stamp.saturating_sub(frame.stamp).max(0) as u64,
            None => self.last_duration(start),
        };
        Ok(Some(Frame {
            picture: frame.picture,
            time: FrameTime { start, duration },
        }))
    }

    fn seek(&mut self, index: u64) -> Result<(), VideoError> {
        if index == self.position && self.ahead.is_some() {
            return Ok(());
        }
        if let Some(length) = self.length
            && index >= length
        {
            self.finish_at(index);
            return Ok(());
        }
        if self.ahead.is_some() && index > self.position && index - self.position <= READ_ON {
            while self.position < index && self.ahead.is_some() {
                self.ahead = None;
                self.position += 1;
                self.ahead = self.decode()?;
            }
            return Ok(());
        }
        self.restart(index)
    }

    fn damage(&self) -> Option<&Damage> {
        self.damage.as_ref()
    }
}

#[cfg(test)]
#[path = "source_tests.rs"]
mod tests;
