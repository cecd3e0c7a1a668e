//! Frames at another rate.

use ravec_video::{FrameTime, Rational};

/// Repeats or leaves out frames, so that they come at a constant rate: the frame that is shown at `k / rate` becomes frame `k`.
pub(super) struct Pace<T> {
    time_base: Rational,
    rate: Rational,
    /// The latest frame.
    latest: Option<(FrameTime, T)>,
    /// Stamp of the first frame.
    origin: i64,
    /// Number of the next frame that is given.
    next: u64,
}

impl<T: Clone> Pace<T> {
    pub fn new(time_base: Rational, rate: Rational) -> Self {
        Self {
            time_base,
            rate,
            latest: None,
            origin: 0,
            next: 0,
        }
    }

    /// Frames of the new rate that are shown before the tick `end`.
    fn give_before(&mut self, end: i64) -> Vec<(FrameTime, T)> {
        let Some((_, latest)) = &self.latest else {
            return Vec::new();
        };
        let mut frames = Vec::new();
        // next / rate < end * base, in whole numbers
        let left = u128::from(self.rate.den()) * u128::from(self.time_base.den());
        let right =
            end.max(0) as u128 * u128::from(self.time_base.num()) * u128::from(self.rate.num());
        while u128::from(self.next) * left < right {
            let time = FrameTime {
                start: self.next as i64,
                duration: 1,
            };
            self.next += 1;
            frames.push((time, latest.clone()));
        }
        frames
    }

    /// Takes the next frame and gives those that are settled by it.
    pub fn push(&mut self, time: FrameTime, frame: T) -> Vec<(FrameTime, T)> {
        if self.latest.is_none() {
            self.origin = time.start;
        }
        let frames = self.give_before(time.start.saturating_sub(self.origin));
        self.latest = Some((time, frame));
        frames
    }

    /// The frames up to the end of the last one.
    pub fn finish(&mut self) -> Vec<(FrameTime, T)> {
        let end = self.latest.as_ref().map_or(0, |(time, _)| {
            let end = time.start.saturating_add_unsigned(time.duration);
            end.saturating_sub(self.origin)
        });
        self.give_before(end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The frames that come out, by their places in the input.
    fn paced(times: &[(i64, u64)], rate: Rational) -> Vec<usize> {
        let mut pace = Pace::new(Rational::new(1, 100).unwrap(), rate);
        let mut frames = Vec::new();
        for (index, &(start, duration)) in times.iter().enumerate() {
            frames.extend(pace.push(FrameTime { start, duration }, index));
        }
        frames.extend(pace.finish());
        for (at, (time, _)) in frames.iter().enumerate() {
            assert_eq!(time.start, at as i64);
        }
        frames.into_iter().map(|(_, index)| index).collect()
    }

    #[test]
    fn frames_are_repeated_and_left_out() {
        let even = [(7, 4), (11, 4), (15, 4), (19, 4)];
        let rate = |num| Rational::new(num, 1).unwrap();
        assert_eq!(paced(&even, rate(25)), [0, 1, 2, 3]);
        assert_eq!(paced(&even, rate(50)), [0, 0, 1, 1, 2, 2, 3, 3]);
        // shown at 0 and 8 hundredths
        assert_eq!(paced(&even, Rational::new(25, 2).unwrap()), [0, 2]);
        // a frame that stands for half a second
        assert_eq!(
            paced(&[(0, 10), (10, 50), (60, 10)], rate(10)),
            [0, 1, 1, 1, 1, 1, 2]
        );
        assert_eq!(paced(&[], rate(10)), [0; 0]);
    }
}
