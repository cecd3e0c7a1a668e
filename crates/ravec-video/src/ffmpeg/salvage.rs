//! Frames behind damage that are whole.
//!
//! One pass decodes the clip without stopping and reads, in one stream, what the decoder complains of and which frames come
//! out. A complaint makes all frames suspect up to the next key frame that was surely decoded after it, because they may
//! refer to what is missing. What is not suspect is given by later passes, which count the frames in the same way.
//!
//! A packet that only the container calls damaged counts as a complaint, too: decoders take a frame whose end is missing
//! without a word. Where two streams are joined, the last frames of the first one are lost by that, though they may be whole.

use super::probe::Probe;
use super::process::{Process, Programs, add, input_arguments};
use crate::error::VideoError;
use crate::limits::VideoLimits;
use std::io::{BufRead, BufReader, Read as _};
use std::ops::Range;
use std::path::Path;
use std::process::Stdio;

/// Bytes of a line that are read at a time.
const MAX_LINE: u64 = 1024;

/// The most intervals of suspect frames; behind them all frames are.
const MAX_INTERVALS: usize = 10_000;

/// The frames of a damaged clip that are given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Salvage {
    /// Numbers of the decoded frames that are left out, in order, disjoint.
    left_out: Vec<Range<u64>>,
    /// Decoded frames.
    decoded: u64,
    /// Packets that gave no frame.
    failed: u64,
}

impl Salvage {
    /// Decodes the whole clip once.
    pub(super) fn of_file(
        programs: &Programs,
        path: &Path,
        probe: &Probe,
        limits: &VideoLimits,
    ) -> Result<Self, VideoError> {
        let mut command = programs.ffmpeg();
        // a thread for all, so that the order of the lines is that of the work
        command.args(["-loglevel", "level+info", "-nostats"]);
        command.args(tolerant());
        let most = limits.pictures.max_pixels.min(i32::MAX as u64);
        command.args(["-max_pixels", &most.to_string()]);
        if let Some(decoder) = probe.decoder {
            command.args(["-c:v", decoder]);
        }
        add(&mut command, input_arguments(path)?);
        command.args(["-map", &format!("0:{}", probe.track)]);
        command.args(["-filter:v", "showinfo=checksum=0"]);
        command.args(programs.passthrough()?);
        command.args(["-f", "null", "-"]);
        command.stdin(Stdio::null()).stdout(Stdio::null());
        let (mut process, log) = Process::start_with_log(&mut command)?;
        let mut scan = Scan::new(probe.reordered, programs.is_pipelined()?);
        let mut log = BufReader::new(log);
        let mut line = Vec::new();
        loop {
            line.clear();
            // the rest of a longer line is read as another one
            if (&mut log).take(MAX_LINE).read_until(b'\n', &mut line)? == 0 {
                break;
            }
            scan.line(&String::from_utf8_lossy(&line));
            limits.check_frame(scan.frames)?;
        }
        process.wait()?;
        Ok(scan.end())
    }

    /// The same with the first `frames` frames, which are known to be whole.
    pub(super) fn trusting(mut self, frames: u64) -> Self {
        for lost in &mut self.left_out {
            lost.start = lost.start.max(frames);
        }
        self.left_out.retain(|lost| lost.start < lost.end);
        self
    }

    /// Number of frames that are given.
    pub(super) fn kept(&self) -> u64 {
        self.decoded
            - self
                .left_out
                .iter()
                .map(|lost| lost.end - lost.start)
                .sum::<u64>()
    }

    /// Number of frames that are lost.
    pub(super) fn lost(&self) -> u64 {
        self.decoded - self.kept() + self.failed
    }

    /// The same, if frames that are given follow lost ones.
    pub(super) fn lost_between(&self) -> Option<u64> {
        let ends = self.first_lost().is_some_and(|first| first >= self.kept());
        (!ends).then(|| self.lost())
    }

    /// Frames before the first one that is lost.
    pub(super) fn first_lost(&self) -> Option<u64> {
        self.left_out.first().map(|lost| lost.start)
    }

    /// The decoded number of the frame `index` of those that are given.
    pub(super) fn decoded_number(&self, index: u64) -> u64 {
        self.left_out.iter().fold(index, |number, lost| {
            if lost.start <= number {
                number + (lost.end - lost.start)
            } else {
                number
            }
        })
    }

    /// Returns `true` if the decoded frame of this number is left out.
    pub(super) fn leaves_out(&self, decoded: u64) -> bool {
        self.left_out.iter().any(|lost| lost.contains(&decoded))
    }
}

/// Arguments with which decoding goes on behind damage and gives no frame that the decoder knows to be damaged.
pub(super) fn tolerant() -> [&'static str; 4] {
    ["-err_detect", "explode", "-threads", "1"]
}

/// The state of reading the log.
struct Scan {
    frames: u64,
    failed: u64,
    left_out: Vec<Range<u64>>,
    /// Frames since the last complaint, unless that is over.
    since: Option<u64>,
    /// Frames after a complaint that may have been decoded before it.
    delay: u64,
}

impl Scan {
    /// `reordered` is the number of frames that the decoder holds back. Where FFmpeg is pipelined, decoded frames also wait
    /// in a queue.
    fn new(reordered: u64, pipelined: bool) -> Self {
        Self {
            frames: 0,
            failed: 0,
            left_out: Vec::new(),
            since: None,
            delay: reordered + if pipelined { 12 } else { 1 },
        }
    }

    fn line(&mut self, line: &str) {
        if line.contains("[Parsed_showinfo") {
            if line.contains("] n:") {
                self.frame(line.contains(" iskey:1"));
            }
            return;
        }
        if line.contains("Stream mapping:") {
            // complaints up to here are about the search for the streams
            self.since = None;
        }
        let is_failure = [
            "Error while decoding stream",
            "Error submitting packet to decoder",
        ]
        .iter()
        .any(|start| line.contains(start));
        self.failed += u64::from(is_failure);
        let signs = [
            "[error]",
            "[fatal]",
            "corrupt decoded frame",
            "corrupt input packet",
        ];
        if signs.iter().any(|sign| line.contains(sign)) {
            self.since = Some(0);
        }
    }

    fn frame(&mut self, is_key: bool) {
        let number = self.frames;
        self.frames += 1;
        let Some(since) = &mut self.since else {
            return;
        };
        *since += 1;
        if is_key && *since > self.delay {
            self.since = None;
            return;
        }
        let is_full = self.left_out.len() >= MAX_INTERVALS;
        match self.left_out.last_mut() {
            Some(last) if last.end == number || is_full => last.end = number + 1,
            _ => self.left_out.push(number..number + 1),
        }
    }

    fn end(self) -> Salvage {
        Salvage {
            left_out: self.left_out,
            decoded: self.frames,
            failed: self.failed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: &str = "[Parsed_showinfo_0 @ 0x5] [info] n:   3 pts: 9 iskey:1 type:I";
    const OTHER: &str = "[Parsed_showinfo_0 @ 0x5] [info] n:   3 pts: 9 iskey:0 type:P";
    const WRONG: &str = "[h264 @ 0x5] [error] error while decoding MB 14 11";
    const FLAGGED: &str = "[warning] a.ts: corrupt input packet in stream 0";

    fn scan(lines: &[&str]) -> Salvage {
        let mut scan = Scan::new(1, false);
        for line in lines {
            scan.line(line);
        }
        scan.end()
    }

    #[test]
    fn frames_are_suspect_up_to_a_key_frame_that_was_decoded_later() {
        // the first key frame may have been decoded before the complaint
        let lines = [
            KEY, OTHER, WRONG, OTHER, KEY, OTHER, OTHER, KEY, OTHER, WRONG, OTHER,
        ];
        let found = scan(&lines);
        assert_eq!(found.left_out, [2..6, 8..9]);
        assert_eq!((found.kept(), found.lost()), (4, 5));
        assert_eq!(found.first_lost(), Some(2));
        let numbers: Vec<_> = (0..5).map(|index| found.decoded_number(index)).collect();
        assert_eq!(numbers, [0, 1, 6, 7, 9]);
        assert_eq!(found.clone().trusting(3).left_out, [3..6, 8..9]);
        assert_eq!(found.clone().trusting(6).lost(), 1);
        for (number, is) in [(1, false), (2, true), (5, true), (6, false), (8, true)] {
            assert_eq!(found.leaves_out(number), is);
        }
    }

    #[test]
    fn flags_of_the_container_count_and_the_search_for_streams_does_not() {
        let lines = [
            WRONG,
            "[info] Stream mapping:",
            KEY,
            FLAGGED,
            OTHER,
            OTHER,
            OTHER,
            KEY,
            WRONG,
            OTHER,
        ];
        assert_eq!(scan(&lines).left_out, [1..4, 5..6]);
    }
}
