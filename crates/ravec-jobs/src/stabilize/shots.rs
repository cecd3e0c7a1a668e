//! The whole picture followed through a clip, each shot against its own first frame.
//!
//! A cut is where the motion of the camera breaks off and the tracker of the shot does not find its picture either. If the
//! former shot is found again within a few frames, what lay between were foreign frames, such as a flash, and no shot.
//!
//! Guarantee: memory for the trackers of two shots, whatever the length of the clip, beside the poses.

use crate::error::JobError;
use crate::track::Precision;
use crate::track::summary::in_words;
use ravec::planar::camera::{CameraMotion, CameraMotionParams};
use ravec::planar::track::{
    PathFrame, PlaneTracker, TrackParams, TrackRegion, TrackState, TrackedFrame,
};
use ravec::raster::{AnyImage, Srgb};
use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

/// The most frames between two parts of a shot.
const MAX_FOREIGN: usize = 4;

/// The shots of a clip up to some frame.
pub(super) struct Shots<'a> {
    path: &'a Path,
    precision: Precision,
    /// True if poses are improved once the shot is known; else they are used at once.
    refine: bool,
    camera: Option<CameraMotion>,
    current: Option<Shot>,
    /// The shot before it.
    former: Option<Shot>,
    /// The frames, each in the shot that it belongs to.
    poses: Vec<TrackedFrame>,
    /// First frames of the shots.
    starts: Vec<usize>,
    /// Frames that belong to no shot.
    foreign: Vec<[u64; 2]>,
    /// Time spent on tracking.
    pub(super) spent: Duration,
}

struct Shot {
    tracker: PlaneTracker,
    first: usize,
}

impl<'a> Shots<'a> {
    pub(super) fn new(path: &'a Path, precision: Precision, refine: bool) -> Self {
        Self {
            path,
            precision,
            refine,
            camera: None,
            current: None,
            former: None,
            poses: Vec::new(),
            starts: Vec::new(),
            foreign: Vec::new(),
            spent: Duration::ZERO,
        }
    }

    /// The pose of the next frame in its shot.
    ///
    /// # Errors
    /// [`JobError::Track`] if the first frame has nothing to follow.
    pub(super) fn push(&mut self, image: &AnyImage) -> Result<TrackedFrame, JobError> {
        let start = Instant::now();
        let found = self.pose(image)?;
        self.poses.push(found.clone());
        self.spent += start.elapsed();
        Ok(found)
    }

    fn pose(&mut self, image: &AnyImage) -> Result<TrackedFrame, JobError> {
        let breaks_off = self.breaks_off(image);
        let Some(current) = &mut self.current else {
            return self.begin(image);
        };
        let found = current.tracker.push(image, None);
        if !breaks_off || found.state == TrackState::Tracked {
            return Ok(found);
        }
        if let Some(again) = self.former_again(image) {
            return Ok(again);
        }
        // a frame without any texture begins no shot
        Ok(self.begin(image).unwrap_or(found))
    }

    /// True if the camera cannot have moved from the last frame to this one.
    fn breaks_off(&mut self, image: &AnyImage) -> bool {
        if self.camera.is_none() {
            self.camera = CameraMotion::new(image.size(), &CameraMotionParams::default()).ok();
        }
        self.camera.as_mut().is_some_and(|camera| {
            let motion = match image {
                AnyImage::Srgb8(image) => camera.push(image),
                AnyImage::Srgb16(image) => camera.push(image),
                AnyImage::Linear(image) => camera.push(image),
                other => camera.push(&other.convert::<Srgb<u8>>()),
            };
            motion.cut
        })
    }

    /// Begins a shot with the next frame.
    fn begin(&mut self, image: &AnyImage) -> Result<TrackedFrame, JobError> {
        let params = TrackParams {
            precision: self.precision,
        };
        let corners = super::whole(image.size());
        let tracker = PlaneTracker::new(image, corners, &TrackRegion::Frame, None, &params);
        let tracker = tracker.map_err(|cause| JobError::Track {
            path: self.path.to_path_buf(),
            cause,
        })?;
        let found = tracker.reference_frame();
        let first = self.poses.len();
        self.starts.push(first);
        let before = self.current.replace(Shot { tracker, first });
        if let Some(done) = std::mem::replace(&mut self.former, before) {
            let end = self.former.as_ref().map_or(first, |shot| shot.first);
            self.finish(done, end);
        }
        Ok(found)
    }

    /// The former shot in this frame, if it goes on; then the frames of the current one belong to no shot.
    fn former_again(&mut self, image: &AnyImage) -> Option<TrackedFrame> {
        let between = self.current.as_ref()?.first..self.poses.len();
        if between.len() > MAX_FOREIGN {
            return None;
        }
        let former = self.former.as_mut()?;
        let found = former.tracker.push(image, None);
        if found.state == TrackState::Lost {
            return None;
        }
        self.current = self.former.take();
        self.starts.pop();
        self.leave_out(between);
        Some(found)
    }

    /// Takes frames for such that belong to no shot.
    fn leave_out(&mut self, frames: Range<usize>) {
        let last = frames.start.checked_sub(1).map(|at| self.poses[at].clone());
        for pose in &mut self.poses[frames.clone()] {
            if let Some(last) = &last {
                pose.clone_from(last);
            }
            pose.state = TrackState::Lost;
        }
        self.foreign
            .push([frames.start as u64, frames.end as u64 - 1]);
    }

    /// Improves the poses of a shot that ends before the frame `end`.
    fn finish(&mut self, mut shot: Shot, end: usize) {
        let poses = &mut self.poses[shot.first..end];
        if self.refine {
            shot.tracker.refine(poses);
        }
        // a frame that nothing is held still against
        let is_alone = poses
            .iter()
            .skip(1)
            .all(|pose| pose.state == TrackState::Lost);
        if is_alone && self.poses.len() > 1 {
            self.poses[shot.first].state = TrackState::Lost;
            let at = shot.first as u64;
            self.foreign.push([at, at]);
        }
    }

    /// The shots of the clip, which has ended.
    pub(super) fn end(mut self) -> Found {
        let total = self.poses.len();
        if let Some(former) = self.former.take() {
            let end = self.current.as_ref().map_or(total, |shot| shot.first);
            self.finish(former, end);
        }
        if let Some(current) = self.current.take() {
            self.finish(current, total);
        }
        self.foreign.sort_unstable();
        Found {
            poses: self.poses,
            starts: self.starts,
            foreign: self.foreign,
        }
    }
}

/// The shots of a clip.
pub(super) struct Found {
    pub(super) poses: Vec<TrackedFrame>,
    starts: Vec<usize>,
    foreign: Vec<[u64; 2]>,
}

impl Found {
    /// Number of cuts.
    pub(super) fn cuts(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The motion for a smooth path.
    pub(super) fn path_frames(&self) -> Vec<PathFrame> {
        let frames = self.poses.iter().enumerate();
        frames
            .map(|(at, pose)| PathFrame {
                frame_from_reference: (pose.state != TrackState::Lost)
                    .then_some(pose.frame_from_reference),
                cut: at > 0 && self.starts.binary_search(&at).is_ok(),
            })
            .collect()
    }

    /// Frames in which the picture is lost within a shot.
    pub(super) fn lost(&self) -> Vec<[u64; 2]> {
        let mut lost: Vec<[u64; 2]> = Vec::new();
        for (index, pose) in (0..).zip(&self.poses) {
            let is_foreign = self
                .foreign
                .iter()
                .any(|[first, last]| (*first..=*last).contains(&index));
            if pose.state != TrackState::Lost || is_foreign {
                continue;
            }
            match lost.last_mut() {
                Some([_, last]) if *last + 1 == index => *last = index,
                _ => lost.push([index, index]),
            }
        }
        lost
    }

    /// Sentences about cuts, and about frames that belong to no shot.
    pub(super) fn remarks(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        let cuts: Vec<String> = self
            .starts
            .iter()
            .skip(1)
            .map(ToString::to_string)
            .collect();
        if !cuts.is_empty() {
            remarks.push(format!(
                "the clip was taken for {} shots, each stabilized for itself: they begin at frame 0 and at {}",
                self.starts.len(),
                cuts.join(", ")
            ));
        }
        if !self.foreign.is_empty() {
            remarks.push(format!(
                "what belongs to no shot is left as it is: frames {}",
                in_words(&self.foreign)
            ));
        }
        remarks
    }
}
