//! The frames that a conversion leaves, one after the other as they come.

use super::FrameRange;
use super::convert::Params;
use super::pace::Pace;
use ravec_video::{FrameTime, Rational};

/// A conversion of one frame after the other: takes a range, and brings what is left to a constant rate.
///
/// `T` is the content of a frame, which repeated frames clone. Sizes and encodings are left to the caller.
pub struct Conversion<T> {
    range: FrameRange,
    pace: Option<Pace<T>>,
    seconds_per_tick: f64,
    /// Number of the next frame.
    next: u64,
    /// Stamp of the first frame of the clip.
    origin: Option<i64>,
}

impl<T: Clone> Conversion<T> {
    /// A conversion of a clip with this time base.
    pub fn new(params: &Params, time_base: Rational) -> Self {
        Self {
            range: params.frames.unwrap_or_default(),
            pace: params.rate.map(|rate| Pace::new(time_base, rate)),
            seconds_per_tick: time_base.to_f64(),
            next: 0,
            origin: None,
        }
    }

    /// The same, if the next frame has this number and the first one had this stamp.
    #[must_use]
    pub(super) fn starting_at(self, next: u64, origin: i64) -> Self {
        Self {
            next,
            origin: Some(origin),
            ..self
        }
    }

    /// Takes the next frame and gives those that are settled by it, with their stamps: ticks as before, or numbers at the new rate.
    /// `None` for a frame behind the range; the frames that are left then come from [`finish`](Self::finish).
    pub fn push(&mut self, time: FrameTime, frame: T) -> Option<Vec<(FrameTime, T)>> {
        let origin = *self.origin.get_or_insert(time.start);
        let seconds = time.start.saturating_sub(origin) as f64 * self.seconds_per_tick;
        let number = self.next;
        if self.range.is_behind(number, seconds) {
            return None;
        }
        self.next += 1;
        if self.range.is_before(number, seconds) {
            return Some(Vec::new());
        }
        Some(match &mut self.pace {
            Some(pace) => pace.push(time, frame),
            None => vec![(time, frame)],
        })
    }

    /// The frames up to the end of the last one.
    pub fn finish(&mut self) -> Vec<(FrameTime, T)> {
        self.pace.as_mut().map_or_else(Vec::new, Pace::finish)
    }
}

/// A frame of a clip whose rate is constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FramePlace {
    /// Number of the frame, from 0.
    pub number: u64,
    /// Seconds from the first frame.
    pub seconds: f64,
    /// Seconds from one frame to the next.
    pub interval: f64,
}

impl FramePlace {
    /// The place of a frame behind a conversion: that of the first frame that shows it or, where a lower rate leaves it out, of the
    /// frame that is shown in its stead. `None` for a frame out of the range.
    ///
    /// Exact where frames are evenly spaced; else the times of frames are taken as given, and the first frame of a range in seconds
    /// is estimated.
    pub fn behind(self, params: &Params) -> Option<Self> {
        let range = params.frames.unwrap_or_default();
        if range.is_before(self.number, self.seconds) || range.is_behind(self.number, self.seconds)
        {
            return None;
        }
        let (first, origin) = range.start_at(self.interval);
        let seconds = (self.seconds - origin).max(0.0);
        let Some(rate) = params.rate.map(Rational::to_f64) else {
            return Some(Self {
                number: self.number.saturating_sub(first),
                seconds,
                interval: self.interval,
            });
        };
        // stamps are multiples of a tick
        let shown_from = (seconds * rate - 1e-6).ceil().max(0.0);
        let is_left_out = shown_from > (seconds + self.interval) * rate - 1e-6;
        let number = (shown_from - f64::from(u8::from(is_left_out))).max(0.0);
        Some(Self {
            number: number as u64,
            seconds: number / rate,
            interval: rate.recip(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn params(frames: &str, rate: Option<&str>) -> Params {
        Params {
            frames: Some(frames.parse().unwrap()),
            rate: rate.map(|rate| rate.parse().unwrap()),
            ..Params::default()
        }
    }

    /// The numbers of the frames that are left of 40 at 25 frames a second.
    fn left(params: &Params) -> Vec<u64> {
        let mut conversion = Conversion::new(params, Rational::new(1, 100).unwrap());
        let mut left = Vec::new();
        for number in 0..40 {
            let time = FrameTime {
                start: 7 + 4 * number,
                duration: 4,
            };
            let Some(frames) = conversion.push(time, number as u64) else {
                break;
            };
            left.extend(frames);
        }
        left.extend(conversion.finish());
        left.into_iter().map(|(_, number)| number).collect()
    }

    #[test]
    fn places_are_those_of_the_frames_that_are_left() {
        for range in ["..", "3..", "5..31", "0.4s..", "0.4s..1.2s", "..0.8s"] {
            for rate in [
                None,
                Some("25"),
                Some("50"),
                Some("12.5"),
                Some("30"),
                Some("8"),
                Some("24000/1001"),
            ] {
                let params = params(range, rate);
                let left = left(&params);
                for number in 0..40 {
                    let place = FramePlace {
                        number,
                        seconds: number as f64 / 25.0,
                        interval: 0.04,
                    };
                    let found = place.behind(&params).map(|place| place.number as usize);
                    let expected = left.iter().position(|of| *of == number);
                    let first = *left.first().unwrap();
                    if expected.is_some() || rate.is_none() {
                        assert_eq!(found, expected, "{range} {rate:?} {number}");
                    } else if let Some(found) = found {
                        // the last frame before it, which may be the last of all
                        assert!(
                            number > first && left[found] < number,
                            "{range} {rate:?} {number}"
                        );
                        assert!(left.get(found + 1).is_none_or(|next| *next > number));
                    }
                }
            }
        }
    }

    #[test]
    fn frames_out_of_the_range_have_no_place() {
        let place = |number| FramePlace {
            number,
            seconds: number as f64 / 25.0,
            interval: 0.04,
        };
        let params = params("10..20", Some("50"));
        assert_eq!(place(9).behind(&params), None);
        assert_eq!(place(20).behind(&params), None);
        let found = place(12).behind(&params).unwrap();
        assert_eq!((found.number, found.interval), (4, 0.02));
        assert!((found.seconds - 0.08).abs() < 1e-9);
    }
}
