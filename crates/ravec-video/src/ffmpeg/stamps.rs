//! The time stamps of all frames of a clip, and those from which a decoder can start, without decoding.

use super::probe::Probe;
use super::process::{Process, Programs, input_arguments};
use crate::error::VideoError;
use crate::limits::VideoLimits;
use ravec_memory::ReservedVec;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::Stdio;

/// Bytes of a line of the list of packets.
const MAX_LINE: u64 = 256;

/// Time stamps in FFmpeg's clock, in the order in which frames are shown.
#[derive(Debug)]
pub(super) struct Stamps {
    frames: ReservedVec<i64>,
    keys: ReservedVec<i64>,
}

impl Stamps {
    /// Lists the packets of the track. `None` if they do not say for sure which frames there are: stamps that are missing or
    /// repeated, packets without content, or a number that is not the stated one.
    pub(super) fn of_file(
        programs: &Programs,
        path: &Path,
        probe: &Probe,
        limits: &VideoLimits,
    ) -> Result<Option<Self>, VideoError> {
        if !probe.frame_a_packet {
            return Ok(None);
        }
        let mut command = programs.ffprobe();
        command.args(["-select_streams", &probe.track.to_string()]);
        command.args([
            "-show_entries",
            "packet=pts,size,flags",
            "-print_format",
            "csv=p=0",
        ]);
        command.args(input_arguments(path)?);
        let mut process = Process::start(command.stdin(Stdio::null()).stdout(Stdio::piped()))?;
        let Some(stdout) = process.take_stdout() else {
            return Ok(None);
        };
        let found = Self::read(BufReader::new(stdout), limits)?;
        let Some(found) = found else {
            return Ok(None);
        };
        let ended = process.wait()?;
        let stated = probe.info.frames.unwrap_or(found.frames.len() as u64);
        let sure =
            ended.status.success() && ended.lines.is_empty() && stated == found.frames.len() as u64;
        Ok(sure.then_some(found))
    }

    fn read(mut lines: impl BufRead, limits: &VideoLimits) -> Result<Option<Self>, VideoError> {
        let memory = &limits.pictures.memory;
        let mut stamps = Self {
            frames: ReservedVec::new(memory),
            keys: ReservedVec::new(memory),
        };
        let mut line = String::new();
        loop {
            line.clear();
            // a line that is cut at the limit is not understood
            if (&mut lines).take(MAX_LINE).read_line(&mut line)? == 0 {
                break;
            }
            match packet(line.trim()) {
                Packet::Unsure => return Ok(None),
                Packet::Nothing => {}
                Packet::Frame { pts, key } => {
                    limits.check_frame(stamps.frames.len() as u64)?;
                    stamps.frames.push(pts)?;
                    if key {
                        stamps.keys.push(pts)?;
                    }
                }
            }
        }
        stamps.frames.sort_unstable();
        stamps.keys.sort_unstable();
        let repeated = stamps.frames.windows(2).any(|pair| pair[0] == pair[1]);
        Ok((!repeated && !stamps.frames.is_empty()).then_some(stamps))
    }

    /// Number of frames.
    pub(super) fn len(&self) -> u64 {
        self.frames.len() as u64
    }

    /// The stamp of a frame.
    pub(super) fn stamp(&self, index: u64) -> Option<i64> {
        self.frames.get(usize::try_from(index).ok()?).copied()
    }

    /// The stamp of the last key frame at or before a stamp.
    pub(super) fn key_before(&self, stamp: i64) -> Option<i64> {
        let count = self.keys.partition_point(|key| *key <= stamp);
        self.keys[..count].last().copied()
    }
}

enum Packet {
    /// A frame that is shown.
    Frame { pts: i64, key: bool },
    /// A packet that is only decoded.
    Nothing,
    /// A packet of which it is not clear.
    Unsure,
}

/// One line: stamp, size and flags.
fn packet(line: &str) -> Packet {
    if line.is_empty() {
        return Packet::Nothing;
    }
    let mut fields = line.split(',');
    let (Some(pts), Some(size), Some(flags)) = (fields.next(), fields.next(), fields.next()) else {
        return Packet::Unsure;
    };
    let (Ok(pts), Ok(size)) = (pts.parse::<i64>(), size.parse::<u64>()) else {
        return Packet::Unsure;
    };
    if size == 0 || flags.contains('C') {
        return Packet::Unsure;
    }
    if flags.contains('D') {
        return Packet::Nothing;
    }
    let key = flags.contains('K');
    Packet::Frame { pts, key }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Option<Stamps> {
        Stamps::read(text.as_bytes(), &VideoLimits::default()).unwrap()
    }

    #[test]
    fn packets_become_frames_in_their_order() {
        let stamps = read("0,900,K_\n30,20,__\n10,5,__\n20,5,__\n40,800,K__\n\n50,9,_D\n").unwrap();
        assert_eq!(stamps.len(), 5);
        let found: Vec<_> = (0..6).map(|index| stamps.stamp(index)).collect();
        assert_eq!(
            found,
            [Some(0), Some(10), Some(20), Some(30), Some(40), None]
        );
        assert_eq!(stamps.key_before(39), Some(0));
        assert_eq!(stamps.key_before(40), Some(40));
        assert_eq!(stamps.key_before(-1), None);
    }

    #[test]
    fn lists_that_are_not_sure_are_not_used() {
        let long = format!("{}\n", "1".repeat(10_000));
        for unsure in [
            "",
            "N/A,9,K_\n",
            "0,9,K_\n0,9,__\n",
            "0,0,K_\n",
            "0\n",
            "0,9,KC\n",
            &long,
        ] {
            assert!(read(unsure).is_none(), "{unsure}");
        }
    }

    #[test]
    fn more_frames_than_allowed_are_refused() {
        let limits = VideoLimits {
            max_frames: 2,
            ..VideoLimits::default()
        };
        let error = Stamps::read(&b"0,9,K_\n1,9,__\n2,9,__\n"[..], &limits).unwrap_err();
        assert!(matches!(error, VideoError::TooManyFrames { limit: 2 }));
    }
}
