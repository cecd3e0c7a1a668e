//! Frames at another rate.

use ravec_video::{Frame, FrameTime, Rational};

/// Repeats or leaves out frames, so that they come at a constant rate: the frame that is shown at `k / rate` becomes frame `k`.
pub(super) struct Pace {
    time_base: Rational,
    rate: Rational,
    /// The latest frame, and its stamp in ticks from the first.
    latest: Option<Frame>,
    origin: i64,
    /// Number of the next frame that is given.
    next: u64,
}

impl Pace {
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
    fn give_before(&mut self, end: i64) -> Vec<Frame> {
        let Some(latest) = &self.latest else {
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
            frames.push(Frame {
                time,
                ..latest.clone()
            });
        }
        frames
    }

    /// Takes the next frame and gives those that are settled by it.
    pub fn push(&mut self, frame: Frame) -> Vec<Frame> {
        if self.latest.is_none() {
            self.origin = frame.time.start;
        }
        let frames = self.give_before(frame.time.start.saturating_sub(self.origin));
        self.latest = Some(frame);
        frames
    }

    /// The frames up to the end of the last one.
    pub fn finish(&mut self) -> Vec<Frame> {
        let end = self.latest.as_ref().map_or(0, |frame| {
            let end = frame
                .time
                .start
                .saturating_add_unsigned(frame.time.duration);
            end.saturating_sub(self.origin)
        });
        self.give_before(end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::{Image, Size, Srgb};
    use ravec_video::FramePicture;

    /// The gray values of the frames that come out.
    fn paced(times: &[(i64, u64)], rate: Rational) -> Vec<u8> {
        let mut pace = Pace::new(Rational::new(1, 100).unwrap(), rate);
        let mut frames = Vec::new();
        for (value, &(start, duration)) in times.iter().enumerate() {
            let image = Image::new(Size::new(1, 1).unwrap(), Srgb([value as u8; 3]));
            frames.extend(pace.push(Frame {
                picture: FramePicture::Image(image.into()),
                time: FrameTime { start, duration },
            }));
        }
        frames.extend(pace.finish());
        for (at, frame) in frames.iter().enumerate() {
            assert_eq!(frame.time.start, at as i64);
        }
        let value = |frame: &Frame| frame.picture.to_image().convert::<Srgb<u8>>()[(0, 0)].0[0];
        frames.iter().map(value).collect()
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
