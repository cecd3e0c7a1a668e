//! Trackers led through a clip: forward from the reference frame, then backward in blocks.
//!
//! The next frame is decoded while the last one is tracked. Backward, a block of frames is read forward and tracked in reverse,
//! while the block before it is read.
//!
//! Guarantees: memory for two blocks of frames, whatever the length of the clip; equal tracks on any number of threads.

use super::exclusions::Exclusions;
use crate::context::Context;
use crate::error::JobError;
use crate::report::{Report, Timing};
use crate::video::{FrameRange, read_error, seek_start};
use ravec::planar::track::{PlaneTracker, Track, TrackedFrame};
use ravec::progress::Phase;
use ravec::raster::{AnyImage, Mask, Size};
use ravec_video::{Clip, Frame, FrameSource as _, FrameTime};
use rayon::iter::{IntoParallelRefMutIterator as _, ParallelIterator as _};
use std::path::Path;
use std::time::{Duration, Instant};

/// Bytes of a block of frames that is read to be tracked backward; two are held.
const BLOCK_BYTES: usize = 128 << 20;
/// Frames of a block at most: between two checks of them a run cannot be cancelled while it reads.
const MAX_BLOCK: usize = 500;

/// A frame as it is tracked.
pub(crate) struct Shot {
    /// Its number in the clip.
    pub index: u64,
    pub image: AnyImage,
    pub time: FrameTime,
    /// Pixels that do not belong to the plane.
    pub exclude: Option<Mask>,
}

/// The frames of a range of a clip, with their masks.
pub(crate) struct Reader<'a> {
    clip: Clip,
    path: &'a Path,
    range: FrameRange,
    /// Number of the first frame of the range.
    first: u64,
    /// The frame that is read next, where it is there already: streams cannot go back.
    held: Option<Frame>,
    /// Stamp of the first frame of the clip.
    origin: i64,
    next: u64,
    exclusions: Option<Exclusions>,
    /// Time spent on reading and decoding.
    spent: Duration,
}

impl<'a> Reader<'a> {
    /// Goes to the first frame of the range.
    ///
    /// # Errors
    /// [`JobError::ReadClip`], [`JobError::EmptyRange`].
    pub fn new(mut clip: Clip, path: &'a Path, range: FrameRange) -> Result<Self, JobError> {
        let start = Instant::now();
        let Some(first) = seek_start(&mut clip, path, &range)? else {
            return Err(JobError::EmptyRange {
                path: path.to_path_buf(),
                range: range.to_string(),
            });
        };
        Ok(Self {
            clip,
            path,
            range,
            first: first.index,
            held: Some(first.frame),
            origin: first.origin,
            next: first.index,
            exclusions: None,
            spent: start.elapsed(),
        })
    }

    /// Number of the first frame of the range.
    pub fn first(&self) -> u64 {
        self.first
    }

    /// The clip.
    pub fn clip(&self) -> &Clip {
        &self.clip
    }

    /// Reads masks along with the frames.
    pub fn exclude(&mut self, exclusions: Exclusions) {
        self.exclusions = Some(exclusions);
    }

    /// The masks.
    pub fn exclusions(&self) -> Option<&Exclusions> {
        self.exclusions.as_ref()
    }

    /// End of the range in seconds from the start of the clip, if it ends before the clip.
    pub fn end_secs(&self) -> Option<f64> {
        self.range.end_secs(self.clip.info(), self.origin)
    }

    /// Time spent on reading and decoding so far, in seconds.
    pub fn spent_secs(&self) -> f64 {
        self.spent.as_secs_f64()
    }

    /// Makes the frame `index` the next one.
    pub fn seek(&mut self, index: u64) -> Result<(), JobError> {
        if index == self.next {
            return Ok(());
        }
        let start = Instant::now();
        self.held = None;
        self.next = index;
        let done = self.clip.seek(index).map_err(read_error(self.path));
        self.spent += start.elapsed();
        done
    }

    /// The next frame of the range; nothing behind its end.
    pub fn next(&mut self) -> Result<Option<Shot>, JobError> {
        let start = Instant::now();
        let shot = self.read();
        self.spent += start.elapsed();
        shot
    }

    fn read(&mut self) -> Result<Option<Shot>, JobError> {
        let frame = match self.held.take() {
            Some(frame) => Some(frame),
            None => self.clip.next_frame().map_err(read_error(self.path))?,
        };
        let Some(Frame { picture, time }) = frame else {
            return Ok(None);
        };
        let index = self.next;
        let ticks = time.start.saturating_sub(self.origin);
        let seconds = ticks as f64 * self.clip.info().time_base.to_f64();
        if self.range.is_behind(index, seconds) {
            return Ok(None);
        }
        self.next += 1;
        let exclude = match &mut self.exclusions {
            Some(exclusions) => exclusions.of(index)?,
            None => None,
        };
        Ok(Some(Shot {
            index,
            image: picture.into_image(),
            time,
            exclude,
        }))
    }

    /// Up to `count` frames.
    pub fn block(&mut self, count: u64, context: &Context) -> Result<Vec<Shot>, JobError> {
        let mut shots = Vec::new();
        while (shots.len() as u64) < count {
            context.progress.check()?;
            match self.next()? {
                Some(shot) => shots.push(shot),
                None => break,
            }
        }
        Ok(shots)
    }

    /// Warns of damage, and of masks that end before the frames do.
    pub fn warn(&self, report: &mut Report) {
        if let Some(damage) = self.clip.damage() {
            report.record_dropped(format!("{}: {damage}", self.path.display()));
        }
        let end = self.exclusions.as_ref().and_then(Exclusions::end);
        if let Some((path, end)) = end {
            report.warn(format!(
                "{} has no mask for frame {end}: from there on nothing is excluded",
                path.display()
            ));
        }
    }
}

/// Gets the number of each frame and the planes in it, as soon as they are tracked.
pub(crate) type Watch<'a> = &'a (dyn Fn(u64, &[TrackedFrame]) + Sync);

/// A [`Watch`] for runs that nobody watches.
pub(crate) fn unwatched(_frame: u64, _planes: &[TrackedFrame]) {}

/// Trackers of several planes that see the same frames.
pub(crate) struct Followers<'a> {
    pub trackers: Vec<PlaneTracker>,
    /// Frames before which the picture changes.
    pub cuts: Vec<u64>,
    /// Time spent on tracking.
    pub spent: Duration,
    /// Told of each frame.
    pub watch: Watch<'a>,
}

impl Followers<'_> {
    /// The planes in a frame. `before` is the frame that was tracked before it.
    pub fn push(&mut self, shot: &Shot, before: u64) -> Vec<TrackedFrame> {
        let start = Instant::now();
        // a cut lies before its frame, from whichever side it is crossed
        let cut = self.cuts.contains(&shot.index.max(before));
        let tracked = self.trackers.par_iter_mut().map(|tracker| {
            if cut {
                tracker.cut();
            }
            tracker.push(&shot.image, shot.exclude.as_ref())
        });
        let tracked: Vec<TrackedFrame> = tracked.collect();
        self.spent += start.elapsed();
        (self.watch)(shot.index, &tracked);
        tracked
    }

    /// Follows the planes through the range of `reader`, whose next frame is the one behind `reference`, then backward.
    ///
    /// # Errors
    /// [`JobError::ReadClip`], [`JobError::Cancelled`].
    pub fn follow(
        &mut self,
        reader: &mut Reader<'_>,
        reference: u64,
        phase: &Phase,
        context: &Context,
    ) -> Result<Found, JobError> {
        let mut forward = Vec::new();
        let mut before = reference;
        let mut current = reader.next()?;
        while let Some(shot) = current {
            context.progress.check()?;
            let (next, found) = rayon::join(|| reader.next(), || self.push(&shot, before));
            forward.push(found);
            before = shot.index;
            phase.advance(1);
            current = next?;
        }
        let mut backward = Vec::new();
        if reference > reader.first() {
            for tracker in &mut self.trackers {
                tracker.rewind();
            }
            let size = reader.clip().info().size;
            let count = block_frames(size, reader.exclusions());
            before = reference;
            let mut end = reference;
            let mut block = Vec::new();
            while end > reader.first() || !block.is_empty() {
                let start = end.saturating_sub(count).max(reader.first());
                let read = || -> Result<Vec<Shot>, JobError> {
                    if start == end {
                        return Ok(Vec::new());
                    }
                    reader.seek(start)?;
                    reader.block(end - start, context)
                };
                let track = || -> Result<(), JobError> {
                    for shot in block.drain(..).rev() {
                        context.progress.check()?;
                        backward.push(self.push(&shot, before));
                        before = shot.index;
                        phase.advance(1);
                    }
                    Ok(())
                };
                let (next, tracked) = rayon::join(read, track);
                tracked?;
                block = next?;
                end = start;
            }
        }
        backward.reverse();
        Ok(Found { forward, backward })
    }

    /// The tracks of all planes, keyframes refined together.
    pub fn tracks(&mut self, found: Found, reference: u64, size: Size) -> Vec<Track> {
        let start = Instant::now();
        let first = reference - found.backward.len() as u64;
        let count = self.trackers.len();
        let mut lists: Vec<Vec<TrackedFrame>> = vec![Vec::new(); count];
        let itself = self.trackers.iter().map(PlaneTracker::reference_frame);
        let itself = std::iter::once(itself.collect());
        let frames = found.backward.into_iter().chain(itself);
        for planes in frames.chain(found.forward) {
            for (list, frame) in lists.iter_mut().zip(planes) {
                list.push(frame);
            }
        }
        let tracks = self.trackers.iter_mut().zip(lists);
        let tracks = tracks.map(|(tracker, mut frames)| {
            let quad = tracker.reference_frame().corners;
            tracker.refine(&mut frames);
            Track {
                width: size.width(),
                height: size.height(),
                quad,
                reference,
                first,
                frames,
            }
        });
        let tracks = tracks.collect();
        self.spent += start.elapsed();
        tracks
    }

    /// Records the times of reading and tracking, which overlap.
    pub fn record_times(&self, reader: &Reader<'_>, report: &mut Report) {
        for (phase, duration_secs) in [
            ("decode", reader.spent_secs()),
            ("track", self.spent.as_secs_f64()),
        ] {
            report.timings.push(Timing {
                phase,
                duration_secs,
            });
        }
    }
}

/// Frames of all planes, in the order of time, without the reference frame.
pub(crate) struct Found {
    forward: Vec<Vec<TrackedFrame>>,
    backward: Vec<Vec<TrackedFrame>>,
}

/// Frames that are read at once.
pub(crate) fn block_frames(size: Size, exclusions: Option<&Exclusions>) -> u64 {
    // the widest samples: four floats
    let bytes = 16 * size.pixels() + exclusions.map_or(0, Exclusions::bytes);
    (BLOCK_BYTES / bytes.max(1)).clamp(1, MAX_BLOCK) as u64
}
