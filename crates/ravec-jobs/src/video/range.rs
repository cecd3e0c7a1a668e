//! Ranges of frames as they are asked for.

use ravec_video::{ClipInfo, Rational};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// An end of a range.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    /// Number of a frame, from 0.
    Frame(u64),
    /// Seconds from the first frame.
    Seconds(f64),
}

/// A range of frames, from 0, as it is written on the command line: `100..200` without frame 200, `100..`, `..200`, or seconds,
/// `1.5s..4s`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct FrameRange {
    start: Option<End>,
    end: Option<End>,
}

impl FromStr for FrameRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "`{text}` is no range of frames: write 100..200, 100.., ..200, or seconds, as in 1.5s..4s"
            )
        };
        let end = |word: &str| match word.trim() {
            "" => Ok(None),
            word => match word.strip_suffix('s') {
                Some(seconds) => match seconds.parse::<f64>() {
                    Ok(seconds) if (0.0..=1e9).contains(&seconds) => {
                        Ok(Some(End::Seconds(seconds)))
                    }
                    _ => Err(wrong()),
                },
                None => word
                    .parse()
                    .map(|frame| Some(End::Frame(frame)))
                    .map_err(|_| wrong()),
            },
        };
        let (start, stop) = text.split_once("..").ok_or_else(wrong)?;
        let range = Self {
            start: end(start)?,
            end: end(stop)?,
        };
        let empty = match (range.start, range.end) {
            (Some(End::Frame(start)), Some(End::Frame(end))) => start >= end,
            (Some(End::Seconds(start)), Some(End::Seconds(end))) => start >= end,
            (_, Some(End::Frame(0))) => true,
            _ => false,
        };
        if empty {
            return Err(format!(
                "`{text}` has no frames: the end is not before the start"
            ));
        }
        Ok(range)
    }
}

impl fmt::Display for FrameRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = |end: Option<End>| match end {
            Some(End::Frame(frame)) => frame.to_string(),
            Some(End::Seconds(seconds)) => format!("{seconds}s"),
            None => String::new(),
        };
        write!(f, "{}..{}", text(self.start), text(self.end))
    }
}

impl TryFrom<String> for FrameRange {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<FrameRange> for String {
    fn from(range: FrameRange) -> Self {
        range.to_string()
    }
}

impl FrameRange {
    /// Frames by their numbers, without the last one.
    pub fn between(frames: &std::ops::Range<u64>) -> Self {
        Self {
            start: Some(End::Frame(frames.start)),
            end: Some(End::Frame(frames.end)),
        }
    }

    /// The number of the first frame, if it does not depend on time stamps.
    pub fn first_frame(&self) -> Option<u64> {
        match self.start {
            None => Some(0),
            Some(End::Frame(frame)) => Some(frame),
            Some(End::Seconds(_)) => None,
        }
    }

    /// Number of the first frame and its seconds from the start, in a clip whose frames are `interval` seconds apart.
    pub(super) fn start_at(&self, interval: f64) -> (u64, f64) {
        match self.start {
            None => (0, 0.0),
            Some(End::Frame(frame)) => (frame, frame as f64 * interval),
            Some(End::Seconds(seconds)) => {
                // stamps are multiples of a tick
                let frame = ((seconds - 1e-6) / interval).ceil().max(0.0);
                (frame as u64, frame * interval)
            }
        }
    }

    /// Returns `true` for a frame before the range: by its number, and its seconds from the first frame of the clip.
    pub fn is_before(&self, index: u64, seconds: f64) -> bool {
        match self.start {
            None => false,
            Some(End::Frame(start)) => index < start,
            // stamps are multiples of a tick
            Some(End::Seconds(start)) => seconds < start - 1e-6,
        }
    }

    /// True for a frame of the range; `None` if that depends on time stamps.
    pub fn contains(&self, index: u64) -> Option<bool> {
        let first = self.first_frame()?;
        match self.end {
            Some(End::Seconds(_)) => None,
            Some(End::Frame(end)) => Some((first..end).contains(&index)),
            None => Some(index >= first),
        }
    }

    /// Returns `true` for a frame behind the range.
    pub fn is_behind(&self, index: u64, seconds: f64) -> bool {
        match self.end {
            None => false,
            Some(End::Frame(end)) => index >= end,
            Some(End::Seconds(end)) => seconds >= end - 1e-6,
        }
    }

    /// Seconds from the start of the clip to the end of the range, if that is known: `origin` is the stamp of the first frame.
    pub fn end_secs(&self, info: &ClipInfo, origin: i64) -> Option<f64> {
        let origin = origin as f64 * info.time_base.to_f64();
        match self.end? {
            End::Seconds(seconds) => Some(origin + seconds),
            End::Frame(frame) => Some(origin + frame as f64 / info.rate?.to_f64()),
        }
    }

    /// Number of frames of the range in a clip, as far as known beforehand.
    pub fn frames(&self, info: &ClipInfo) -> Option<u64> {
        let rate = info.rate.map_or(0.0, Rational::to_f64);
        let frame = |end: End| match end {
            End::Frame(frame) => frame,
            End::Seconds(seconds) => (seconds * rate).ceil() as u64,
        };
        let by_time = info
            .duration_secs()
            .map(|seconds| (seconds * rate).round() as u64);
        let all = info.frames.or(by_time);
        let end = match (self.end.map(frame), all) {
            (Some(end), Some(all)) => end.min(all),
            (end, all) => end.or(all)?,
        };
        Some(end.saturating_sub(self.start.map_or(0, frame)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_frames_or_seconds() {
        let range: FrameRange = "2..4".parse().unwrap();
        let inside = |index| !range.is_before(index, 0.0) && !range.is_behind(index, 0.0);
        assert_eq!([1, 2, 3, 4].map(inside), [false, true, true, false]);
        let range: FrameRange = "0.5s..1s".parse().unwrap();
        let inside = |seconds| !range.is_before(9, seconds) && !range.is_behind(9, seconds);
        assert_eq!(
            [0.49, 0.5, 0.99, 1.0].map(inside),
            [false, true, true, false]
        );
        let range: FrameRange = "..".parse().unwrap();
        assert_eq!(range, FrameRange::default());
        for text in ["2..4", "..4", "2..", "0.5s..1s", "1s..100", ".."] {
            assert_eq!(text.parse::<FrameRange>().unwrap().to_string(), text);
        }
        for text in [
            "", "2", "4..2", "2..2", "a..b", "-1..", "1e99s..", "..0", "nans..", "1...3",
        ] {
            assert!(text.parse::<FrameRange>().is_err(), "{text}");
        }
    }
}
