//! Order of decoding and order of display.

use super::atom::damaged;
use super::movie::{Movie, Track};
use crate::error::VideoError;
use crate::limits::VideoLimits;
use crate::time::Rational;
use ravec_memory::{Reservation, with_room};

/// Rank of a sample that is decoded and not shown.
const NOT_SHOWN: u32 = (1 << 31) - 1;
/// The bit of a step at which decoding can start.
const SYNC: u32 = 1 << 31;

/// Bytes of the smallest picture: a length, the kind, and a bit of a slice.
const MIN_SAMPLE_BYTES: u32 = 5;

/// A sample in the order of decoding.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    pub(super) offset: u64,
    pub(super) size: u32,
    rank_and_sync: u32,
}

impl Step {
    /// Number of its frame in the order of display.
    pub(super) fn rank(&self) -> Option<u32> {
        let rank = self.rank_and_sync & !SYNC;
        (rank != NOT_SHOWN).then_some(rank)
    }

    /// True if the file says that decoding can start here.
    pub(super) fn sync(&self) -> bool {
        self.rank_and_sync & SYNC != 0
    }
}

/// A frame in the order of display.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shown {
    /// Ticks of the track from the start of the presentation.
    pub(super) start: i64,
    pub(super) duration: u64,
    /// Number of its sample in the order of decoding.
    pub(super) step: u32,
}

/// The samples of a video track in both orders.
pub(super) struct Timeline {
    pub(super) steps: Vec<Step>,
    pub(super) shown: Vec<Shown>,
    /// Number of the sample entry of all samples, from 1.
    pub(super) entry: u32,
    _memory: Reservation,
}

/// Time of display and duration of a sample.
#[derive(Clone, Copy)]
struct Stamp {
    shown: i64,
    duration: u32,
    step: u32,
}

impl Timeline {
    /// Expands the tables of a track.
    ///
    /// # Errors
    /// [`VideoError::TooManyFrames`] and [`VideoError::OverBudget`] before memory is taken, [`VideoError::Unsupported`] for
    /// edit lists and tables that are not played from start to end, [`VideoError::Damaged`] without samples.
    pub(super) fn of(
        movie: &Movie,
        track: &Track,
        limits: &VideoLimits,
    ) -> Result<Self, VideoError> {
        if (1..MIN_SAMPLE_BYTES).contains(&track.tables.common_size) {
            return Err(damaged("its frames have fewer bytes than any picture"));
        }
        let max_frames = limits.max_frames.min(u64::from(NOT_SHOWN));
        let count = movie
            .samples(track)
            .filter(|sample| sample.size > 0)
            .take(
                usize::try_from(max_frames)
                    .unwrap_or(usize::MAX)
                    .saturating_add(1),
            )
            .count();
        if count as u64 > max_frames {
            return Err(VideoError::TooManyFrames {
                limit: limits.max_frames,
            });
        }
        let memory = &limits.pictures.memory;
        let (mut steps, mut reserved) = with_room(memory, count)?;
        let (mut stamps, scratch) = with_room(memory, count)?;
        let mut entry = None;
        for sample in movie.samples(track).filter(|sample| sample.size > 0) {
            if *entry.get_or_insert(sample.entry()) != sample.entry() {
                return Err(unsupported("a clip that changes its codec settings midway"));
            }
            stamps.push(Stamp {
                shown: sample.shown(),
                duration: sample.duration,
                step: steps.len() as u32,
            });
            let sync = if sample.sync() { SYNC } else { 0 };
            steps.push(Step {
                offset: sample.offset,
                size: sample.size,
                rank_and_sync: NOT_SHOWN | sync,
            });
        }
        let Some(entry) = entry else {
            return Err(damaged("its video track has no frames"));
        };
        stamps.sort_by_key(|stamp| (stamp.shown, stamp.step));
        let (mut shown, more) = with_room(memory, count)?;
        reserved.absorb(more);
        present(&stamps, &segments(movie, track)?, &mut shown);
        drop((stamps, scratch));
        for (rank, frame) in shown.iter().enumerate() {
            let step = &mut steps[frame.step as usize];
            step.rank_and_sync = step.rank_and_sync & SYNC | rank as u32;
        }
        Ok(Self {
            steps,
            shown,
            entry,
            _memory: reserved,
        })
    }

    /// True if the stamps are evenly spaced.
    pub(super) fn even(&self) -> bool {
        let gap = |pair: &[Shown]| pair[1].start - pair[0].start;
        let mut gaps = self.shown.windows(2).map(gap);
        let first = gaps.next();
        gaps.all(|gap| Some(gap) == first)
    }

    /// Ticks from the first frame to the end of the last one.
    pub(super) fn duration(&self) -> u64 {
        let (Some(first), Some(last)) = (self.shown.first(), self.shown.last()) else {
            return 0;
        };
        last.start.abs_diff(first.start) + last.duration
    }

    /// Frames a second: exact if even, else the mean.
    pub(super) fn rate(&self, timescale: u32) -> Option<Rational> {
        let first = self.shown.first()?;
        let gap = match self.shown.get(1) {
            Some(second) => second.start.abs_diff(first.start),
            None => first.duration,
        };
        if self.even() {
            return Rational::new(timescale, u32::try_from(gap).ok()?).map(Rational::reduced);
        }
        let seconds = self.duration() as f64 / f64::from(timescale);
        Rational::nearest(self.shown.len() as f64 / seconds, 1001)
    }
}

/// A part of the track that is shown: from `from` to before `to`, beginning at `start` of the presentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Segment {
    from: i64,
    to: i64,
    start: i64,
    /// Ticks by which the end may be off, because it was rounded to ticks of the movie.
    slack: i64,
}

fn unsupported(feature: &str) -> VideoError {
    VideoError::Unsupported {
        feature: feature.to_owned(),
        hint: None,
    }
}

/// The parts of a track that its edit list shows.
fn segments(movie: &Movie, track: &Track) -> Result<Vec<Segment>, VideoError> {
    if track.edits.is_empty() {
        return Ok(vec![Segment {
            from: i64::MIN,
            to: i64::MAX,
            start: i64::MIN,
            slack: 0,
        }]);
    }
    let ticks = |duration: u64| {
        let product = u128::from(duration) * u128::from(track.timescale);
        let scale = u128::from(movie.timescale);
        i64::try_from((product + scale / 2) / scale).unwrap_or(i64::MAX)
    };
    let slack = ticks(1).max(1);
    let mut segments: Vec<Segment> = Vec::new();
    let mut start = 0i64;
    for edit in &track.edits {
        let length = ticks(edit.duration);
        if edit.media_time >= 0 {
            if !edit.normal_speed {
                return Err(unsupported("an edit list with another speed"));
            }
            let to = if edit.duration == 0 {
                i64::MAX
            } else {
                edit.media_time.saturating_add(length)
            };
            let previous = segments
                .last()
                .map_or(i64::MIN, |segment: &Segment| segment.to);
            if edit.media_time < previous.saturating_sub(slack) {
                return Err(unsupported("an edit list that repeats or reorders parts"));
            }
            segments.push(Segment {
                from: edit.media_time,
                to,
                start,
                slack,
            });
        }
        start = start.saturating_add(length);
    }
    Ok(segments)
}

/// The frames of the segments, from stamps in the order of display.
fn present(stamps: &[Stamp], segments: &[Segment], shown: &mut Vec<Shown>) {
    let mut segments = segments.iter();
    let Some(mut segment) = segments.next() else {
        return;
    };
    for (number, stamp) in stamps.iter().enumerate() {
        let end = match stamps.get(number + 1) {
            Some(next) => next.shown,
            None => stamp.shown.saturating_add(i64::from(stamp.duration)),
        };
        // the end of a segment is rounded: a frame that begins within the rounding, and is longer, is not in it
        let slack = |segment: &Segment| segment.slack.min(end.saturating_sub(stamp.shown) / 2);
        while stamp.shown >= segment.to.saturating_sub(slack(segment)) {
            let Some(next) = segments.next() else { return };
            segment = next;
        }
        // the frame that is on when the segment begins is shown from there on
        if stamp.shown < segment.from && end <= segment.from {
            continue;
        }
        let from = stamp.shown.max(segment.from);
        let to = if end.saturating_sub(segment.slack) <= segment.to {
            end
        } else {
            segment.to
        };
        shown.push(Shown {
            start: if segment.start == i64::MIN {
                from
            } else {
                from.saturating_sub(segment.from)
                    .saturating_add(segment.start)
            },
            duration: u64::try_from(to.saturating_sub(from)).unwrap_or(0),
            step: stamp.step,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(times: &[i64], segments: &[Segment]) -> Vec<(i64, u64, u32)> {
        let stamps: Vec<Stamp> = times
            .iter()
            .enumerate()
            .map(|(step, &shown)| Stamp {
                shown,
                duration: 10,
                step: step as u32,
            })
            .collect();
        let mut frames = Vec::new();
        present(&stamps, segments, &mut frames);
        frames
            .iter()
            .map(|frame| (frame.start, frame.duration, frame.step))
            .collect()
    }

    fn segment(from: i64, to: i64, start: i64) -> Segment {
        Segment {
            from,
            to,
            start,
            slack: 1,
        }
    }

    #[test]
    fn without_edits_stamps_stay() {
        let all = Segment {
            from: i64::MIN,
            to: i64::MAX,
            start: i64::MIN,
            slack: 0,
        };
        assert_eq!(
            shown(&[-5, 7, 20], &[all]),
            [(-5, 12, 0), (7, 13, 1), (20, 10, 2)]
        );
    }

    #[test]
    fn an_edit_moves_and_cuts_frames() {
        let times = [0, 10, 20, 30, 40];
        assert_eq!(
            shown(&times, &[segment(20, i64::MAX, 0)]),
            [(0, 10, 2), (10, 10, 3), (20, 10, 4)]
        );
        assert_eq!(
            shown(&times, &[segment(15, 38, 100)]),
            [(100, 5, 1), (105, 10, 2), (115, 8, 3)]
        );
        // an end that is rounded by one tick cuts nothing and adds nothing
        for end in [29, 30, 31] {
            assert_eq!(
                shown(&times, &[segment(10, end, 0)]),
                [(0, 10, 1), (10, 10, 2)],
                "{end}"
            );
        }
    }

    #[test]
    fn parts_that_are_left_out_are_not_shown() {
        let times = [0, 10, 20, 30, 40];
        let edits = [segment(0, 10, 0), segment(30, 50, 10)];
        assert_eq!(
            shown(&times, &edits),
            [(0, 10, 0), (10, 10, 3), (20, 10, 4)]
        );
    }
}
