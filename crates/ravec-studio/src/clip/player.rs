//! Playing: the frame that is due at a time.

use std::ops::Range;

/// Speeds that a choice offers, in seconds of the clip a second.
pub const SPEEDS: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

/// Part of a frame by which a time may be early: the times of a window are rounded.
const ROUNDING: f64 = 1e-6;

/// Plays the frames of a range by a clock that its caller reads.
///
/// The frame that is due depends on the time alone: what cannot be shown in time is dropped, and nothing is delayed. All times are
/// seconds of one clock, whatever its start.
#[derive(Debug, Clone, PartialEq)]
pub struct Player {
    speed: f64,
    /// True if the range begins again at its end.
    pub loops: bool,
    origin: Option<Origin>,
}

/// A moment of playing from which the later ones are counted.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Origin {
    /// Time of the clock.
    time: f64,
    /// Place in the clip, in frames.
    place: f64,
}

impl Default for Player {
    fn default() -> Self {
        Self {
            speed: 1.0,
            loops: true,
            origin: None,
        }
    }
}

impl Player {
    /// True while it plays.
    pub fn is_playing(&self) -> bool {
        self.origin.is_some()
    }

    /// Seconds of the clip a second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Plays from a frame on.
    pub fn play(&mut self, now: f64, frame: u64) {
        self.origin = Some(Origin {
            time: now,
            place: frame as f64,
        });
    }

    /// Stops.
    pub fn pause(&mut self) {
        self.origin = None;
    }

    /// Goes on from another frame, if it plays.
    pub fn move_to(&mut self, now: f64, frame: u64) {
        if self.is_playing() {
            self.play(now, frame);
        }
    }

    /// Plays at another speed, 0.25 to 4, from the place where it is.
    pub fn set_speed(&mut self, speed: f64, now: f64, seconds_per_frame: f64) {
        if let Some(place) = self.place(now, seconds_per_frame) {
            self.origin = Some(Origin { time: now, place });
        }
        self.speed = if speed.is_finite() {
            speed.clamp(SPEEDS[0], SPEEDS[SPEEDS.len() - 1])
        } else {
            1.0
        };
    }

    /// Frames a second of the clock.
    fn pace(&self, seconds_per_frame: f64) -> f64 {
        self.speed / seconds_per_frame.max(1e-6)
    }

    fn place(&self, now: f64, seconds_per_frame: f64) -> Option<f64> {
        let Origin { time, place } = self.origin?;
        Some(place + (now - time).max(0.0) * self.pace(seconds_per_frame))
    }

    /// The frame that is due, or `None` if it does not play. Behind the end of the range it begins again if it
    /// [`loops`](Self::loops); else it stops, and the last frame is due once more. A place outside of the range moves to its start.
    pub fn due(&mut self, now: f64, seconds_per_frame: f64, range: &Range<u64>) -> Option<u64> {
        let mut place = self.place(now, seconds_per_frame)? + ROUNDING;
        let (start, end) = (range.start as f64, range.end as f64);
        if range.is_empty() {
            self.pause();
            return None;
        }
        let begins = self.origin.is_some_and(|origin| {
            // a range that was moved away, or the end of it from which playing starts over
            origin.place < start || origin.place >= end
        });
        if begins {
            place = start;
        } else if place >= end {
            if !self.loops {
                self.pause();
                return Some(range.end - 1);
            }
            place = start + (place - start) % (end - start);
        } else {
            return Some(place as u64);
        }
        self.origin = Some(Origin { time: now, place });
        Some((place as u64).clamp(range.start, range.end - 1))
    }

    /// Seconds from `now` until another frame is due, if it plays.
    pub fn next_in(&self, now: f64, seconds_per_frame: f64) -> Option<f64> {
        let place = self.place(now, seconds_per_frame)?;
        let next = (place + ROUNDING).floor() + 1.0;
        Some((next - place) / self.pace(seconds_per_frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: f64 = 1.0 / 25.0;

    /// The frames that are due at times that lie `step` apart.
    fn dues(player: &mut Player, step: f64, count: usize, range: Range<u64>) -> Vec<Option<u64>> {
        let at = |k: usize| 100.0 + step * k as f64;
        (0..count)
            .map(|k| player.due(at(k), FRAME, &range))
            .collect()
    }

    fn playing(frame: u64, loops: bool) -> Player {
        let mut player = Player {
            loops,
            ..Player::default()
        };
        player.play(100.0, frame);
        player
    }

    #[test]
    fn every_frame_is_due_at_its_time() {
        let found = dues(&mut playing(3, false), FRAME, 6, 0..8);
        let truth = [Some(3), Some(4), Some(5), Some(6), Some(7), Some(7)];
        assert_eq!(found, truth);
        // it has stopped at the end
        let mut player = playing(3, false);
        dues(&mut player, FRAME, 6, 0..8);
        assert!(!player.is_playing());
        assert_eq!(player.due(200.0, FRAME, &(0..8)), None);
    }

    #[test]
    fn frames_are_dropped_and_never_delayed() {
        let found = dues(&mut playing(0, false), 3.0 * FRAME, 4, 0..100);
        assert_eq!(found, [Some(0), Some(3), Some(6), Some(9)]);
    }

    #[test]
    fn a_range_is_looped_without_drift() {
        let mut player = playing(10, true);
        let found = dues(&mut player, FRAME, 9, 10..14);
        let truth = [10, 11, 12, 13, 10, 11, 12, 13, 10].map(Some);
        assert_eq!(found, truth);
        // one call a long time later is at the same place as many calls
        let mut seldom = playing(10, true);
        let (now, range) = (100.0 + 1001.5 * FRAME, 10..14);
        assert_eq!(seldom.due(now, FRAME, &range), Some(11));
    }

    #[test]
    fn playing_starts_over_at_the_end_and_outside_of_the_range() {
        for frame in [3, 20, 99] {
            let mut player = playing(frame, false);
            assert_eq!(player.due(100.0, FRAME, &(10..20)), Some(10), "{frame}");
            assert_eq!(player.due(100.0 + FRAME, FRAME, &(10..20)), Some(11));
        }
        assert_eq!(playing(3, true).due(100.0, FRAME, &(7..7)), None);
    }

    #[test]
    fn speed_changes_the_pace_from_where_it_is() {
        let mut player = playing(0, false);
        let range = 0..1000;
        assert_eq!(player.due(101.0, FRAME, &range), Some(25));
        player.set_speed(4.0, 101.0, FRAME);
        assert_eq!(player.due(101.0, FRAME, &range), Some(25));
        assert_eq!(player.due(102.0, FRAME, &range), Some(125));
        player.set_speed(0.25, 102.0, FRAME);
        assert_eq!(player.due(106.0, FRAME, &range), Some(150));
        player.set_speed(1e9, 106.0, FRAME);
        assert_eq!(player.speed(), 4.0);
        player.set_speed(f64::NAN, 106.0, FRAME);
        assert_eq!(player.speed(), 1.0);
    }

    #[test]
    fn the_time_until_the_next_frame_leads_to_it() {
        let mut player = playing(0, false);
        let mut now = 100.0;
        for frame in 0..50 {
            assert_eq!(player.due(now, FRAME, &(0..100)), Some(frame));
            now += player.next_in(now, FRAME).unwrap();
        }
        player.pause();
        assert_eq!(player.next_in(now, FRAME), None);
    }

    #[test]
    fn a_clock_that_goes_back_does_no_harm() {
        let mut player = playing(5, true);
        assert_eq!(player.due(50.0, FRAME, &(0..10)), Some(5));
    }
}
