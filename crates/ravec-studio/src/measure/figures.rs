//! Figures of gestures.

use serde::Serialize;
use std::fmt;
use std::time::Duration;

/// Figures of a measurement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measurement {
    /// Subject of the measurement.
    pub about: String,
    /// Columns and rows of the picture that was opened; zeros for a mesh.
    pub size: [usize; 2],
    /// Renderer of the window: `no window`, or the name of the adapter.
    pub drawn_by: String,
    /// Threads that compute.
    pub threads: usize,
    /// Gestures in the order in which they came first.
    pub gestures: Vec<GestureFigures>,
}

/// Figures of all gestures of a name.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GestureFigures {
    /// The name.
    pub name: String,
    /// Events of the hand.
    pub events: usize,
    /// Those that were followed by a picture: the ones that have times.
    pub shown: usize,
    /// Those that change nothing, such as a motion shorter than the distance of the points of a stroke.
    pub without_effect: usize,
    /// Those that wanted a picture and got none.
    pub without_picture: usize,
    /// Median of the times from event to shown picture in milliseconds.
    pub median_ms: Option<f64>,
    /// 99th percentile of these times.
    pub percentile_99_ms: Option<f64>,
    /// The longest of these times.
    pub maximum_ms: Option<f64>,
    /// The longest time from the last event of a gesture until the whole result is shown and nothing is going on.
    pub settled_ms: f64,
    /// Frames of the window.
    pub frames: usize,
    /// The longest time of the window's thread in one frame.
    pub longest_frame_ms: f64,
    /// Frames in which no part of the picture was drawn.
    pub blank_frames: usize,
}

/// Record of the gestures of a name.
#[derive(Debug, Clone, Default)]
pub(super) struct Record {
    pub name: String,
    pub without_effect: usize,
    pub without_picture: usize,
    pub times: Vec<Duration>,
    pub settled: Duration,
    pub frames: usize,
    pub longest_frame: Duration,
    pub blank_frames: usize,
}

impl Record {
    pub fn figures(&self) -> GestureFigures {
        let mut times = self.times.clone();
        times.sort();
        GestureFigures {
            name: self.name.clone(),
            events: times.len() + self.without_effect + self.without_picture,
            shown: times.len(),
            without_effect: self.without_effect,
            without_picture: self.without_picture,
            median_ms: quantile(&times, 0.5).map(milliseconds),
            percentile_99_ms: quantile(&times, 0.99).map(milliseconds),
            maximum_ms: times.last().copied().map(milliseconds),
            settled_ms: milliseconds(self.settled),
            frames: self.frames,
            longest_frame_ms: milliseconds(self.longest_frame),
            blank_frames: self.blank_frames,
        }
    }
}

/// The smallest time that is not below a share of the others.
fn quantile(sorted: &[Duration], share: f64) -> Option<Duration> {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.max(1) - 1).copied()
}

fn milliseconds(time: Duration) -> f64 {
    // microseconds are exact enough
    (time.as_secs_f64() * 1e6).round() / 1e3
}

impl fmt::Display for Measurement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size;
        writeln!(f, "{}", self.about)?;
        if width > 0 {
            write!(f, "{width} x {height} pixels, ")?;
        }
        writeln!(f, "{}, {} threads", self.drawn_by, self.threads)?;
        writeln!(f, "times in ms from event to shown picture")?;
        writeln!(
            f,
            "{:36} {:>7} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8} {:>6}",
            "gesture", "events", "shown", "median", "99 %", "longest", "settled", "frame", "blank"
        )?;
        for one in &self.gestures {
            let time = |time: Option<f64>| time.map_or("-".to_owned(), |time| format!("{time:.1}"));
            writeln!(
                f,
                "{:36} {:>7} {:>7} {:>8} {:>8} {:>8} {:>8.1} {:>8.1} {:>6}",
                one.name,
                one.events,
                one.shown,
                time(one.median_ms),
                time(one.percentile_99_ms),
                time(one.maximum_ms),
                one.settled_ms,
                one.longest_frame_ms,
                one.blank_frames,
            )?;
            if one.without_picture > 0 {
                writeln!(f, "  {} events without a picture", one.without_picture)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_times_that_were_measured() {
        let times: Vec<_> = (1..=200).map(Duration::from_millis).collect();
        let ms = |share| quantile(&times, share).map(milliseconds);
        assert_eq!(ms(0.5), Some(100.0));
        assert_eq!(ms(0.99), Some(198.0));
        assert_eq!(quantile(&times[..1], 0.99), Some(times[0]));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
