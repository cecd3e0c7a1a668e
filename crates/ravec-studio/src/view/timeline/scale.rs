//! Frames along the timeline.

use std::ops::Range;

/// Points of the screen between two labels of the ruler, at least.
const LABEL_SPACING: f64 = 90.0;

/// Frames that are seen when the timeline is zoomed in as far as it goes.
const MIN_FRAMES: f64 = 8.0;

/// The map between frames of a clip and the points of the screen. Every frame has a cell of the same width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Left end on the screen.
    pub left: f32,
    /// Width on the screen, positive.
    pub width: f32,
    /// The place at the left end, in frames.
    pub first: f64,
    /// Frames that are seen, positive.
    pub seen: f64,
    /// Frames of the clip, at least 1.
    pub frames: u64,
}

impl Scale {
    /// The scale on which a whole clip is seen.
    pub fn whole(left: f32, width: f32, frames: u64) -> Self {
        let frames = frames.max(1);
        Self {
            left,
            width: width.max(1.0),
            first: 0.0,
            seen: frames as f64,
            frames,
        }
    }

    /// The place at a position of the screen, in frames: frame 3 reaches from 3 to 4.
    pub fn place_at(&self, x: f32) -> f64 {
        self.first + f64::from(x - self.left) / f64::from(self.width) * self.seen
    }

    /// The frame at a position of the screen; left and right of the clip its first and last one.
    pub fn frame_at(&self, x: f32) -> u64 {
        (self.place_at(x).max(0.0) as u64).min(self.frames - 1)
    }

    /// The border between two frames that is nearest to a position of the screen, from 0 to the number of frames.
    pub fn border_at(&self, x: f32) -> u64 {
        (self.place_at(x).round().max(0.0) as u64).min(self.frames)
    }

    /// The position of a place on the screen.
    pub fn x_of(&self, place: f64) -> f32 {
        self.left + ((place - self.first) / self.seen * f64::from(self.width)) as f32
    }

    /// The position of the middle of a frame.
    pub fn middle_of(&self, frame: u64) -> f32 {
        self.x_of(frame as f64 + 0.5)
    }

    /// Points of the screen a frame.
    pub fn cell(&self) -> f64 {
        f64::from(self.width) / self.seen
    }

    /// The frames that are seen, at least in part.
    pub fn visible(&self) -> Range<u64> {
        let start = (self.first.max(0.0) as u64).min(self.frames);
        let end = ((self.first + self.seen).ceil().max(0.0) as u64).min(self.frames);
        start..end
    }

    /// The scale on which `factor` times fewer frames are seen, and the one below `x` stays.
    #[must_use]
    pub fn zoomed(self, factor: f64, x: f32) -> Self {
        let all = self.frames as f64;
        let place = self.place_at(x);
        let seen = (self.seen / factor).clamp(MIN_FRAMES.min(all), all);
        let share = f64::from(x - self.left) / f64::from(self.width);
        Self { seen, ..self }.from(place - share * seen)
    }

    /// The scale whose left end is at a place, or as near to it as the clip allows.
    #[must_use]
    pub fn from(self, first: f64) -> Self {
        let last = self.frames as f64 - self.seen;
        Self {
            first: first.clamp(0.0, last.max(0.0)),
            ..self
        }
    }

    /// The scale on which a frame is seen: the same if it is already.
    #[must_use]
    pub fn showing(self, frame: u64) -> Self {
        let place = frame as f64;
        if place >= self.first && place + 1.0 <= self.first + self.seen {
            return self;
        }
        self.from(place - 0.1 * self.seen)
    }

    /// Frames from one label of the ruler to the next.
    pub fn label_step(&self) -> u64 {
        let least = LABEL_SPACING / self.cell();
        let mut step = 1u64;
        loop {
            for factor in [1, 2, 5] {
                if (factor * step) as f64 >= least {
                    return factor * step;
                }
            }
            if step > u64::MAX / 100 {
                return step;
            }
            step *= 10;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_is_found_at_its_middle_and_its_borders() {
        for frames in [1, 2, 7, 100, 999, 5000] {
            for width in [1.0, 333.0, 1000.0, 2560.0] {
                let scale = Scale::whole(17.0, width, frames);
                for frame in 0..frames {
                    assert_eq!(scale.frame_at(scale.middle_of(frame)), frame, "{scale:?}");
                    assert_eq!(scale.border_at(scale.x_of(frame as f64)), frame);
                }
                assert_eq!(scale.border_at(scale.x_of(frames as f64)), frames);
                assert_eq!(scale.visible(), 0..frames);
            }
        }
    }

    #[test]
    fn positions_beside_the_clip_are_its_ends() {
        let scale = Scale::whole(100.0, 200.0, 50);
        assert_eq!((scale.frame_at(-1e9), scale.frame_at(99.0)), (0, 0));
        assert_eq!((scale.frame_at(301.0), scale.frame_at(1e9)), (49, 49));
        assert_eq!(scale.frame_at(f32::NAN), 0);
        assert_eq!((scale.border_at(-5.0), scale.border_at(1e9)), (0, 50));
    }

    #[test]
    fn zooming_keeps_the_frame_below_the_cursor_and_stays_in_the_clip() {
        let mut scale = Scale::whole(0.0, 1000.0, 1000);
        for x in [0.0, 130.0, 999.0] {
            let zoomed = scale.zoomed(4.0, x);
            assert!((zoomed.place_at(x) - scale.place_at(x)).abs() < 1e-6);
            assert_eq!(zoomed.seen, 250.0);
        }
        for (factor, x) in [
            (1e9, 500.0),
            (0.5, 0.0),
            (3.0, 1000.0),
            (1e-9, 3.0),
            (7.0, 10.0),
        ] {
            scale = scale.zoomed(factor, x);
            assert!(
                scale.first >= 0.0 && scale.first + scale.seen <= 1000.0,
                "{scale:?}"
            );
        }
        let short = Scale::whole(0.0, 1000.0, 3);
        assert_eq!(short.zoomed(100.0, 400.0), short);
    }

    #[test]
    fn a_frame_out_of_sight_is_shown() {
        let scale = Scale::whole(0.0, 1000.0, 1000).zoomed(10.0, 500.0);
        assert_eq!(scale.showing(500), scale);
        for frame in [0, 449, 560, 999] {
            let visible = scale.showing(frame).visible();
            assert!(visible.contains(&frame), "{frame} in {visible:?}");
        }
    }

    #[test]
    fn labels_of_the_ruler_do_not_touch() {
        for (frames, width) in [(10, 1000.0), (1000, 500.0), (u64::MAX / 2, 300.0), (1, 1.0)] {
            let scale = Scale::whole(0.0, width, frames);
            let step = scale.label_step();
            assert!(
                step as f64 * scale.cell() >= LABEL_SPACING * 0.999,
                "{scale:?}"
            );
        }
        assert_eq!(Scale::whole(0.0, 1000.0, 1000).label_step(), 100);
    }
}
