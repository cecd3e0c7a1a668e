//! Properties of a clip that its timeline needs.

use ravec_video::{Clip, ClipInfo, FrameSource as _, Rational};

/// Seconds a frame where a clip does not say it.
const DEFAULT_SECONDS: f64 = 1.0 / 25.0;

/// Frames of a clip that is decoded once from its start for all small copies and thumbnails, while frames are read beside it: some
/// twenty seconds of 1080p.
const MAX_FRAMES_IN_ORDER: u64 = 2000;

/// Properties of a clip that is open.
#[derive(Debug, Clone, PartialEq)]
pub struct ClipFacts {
    /// Number of frames, at least 1.
    pub frames: u64,
    /// True if the number of frames is what the file states or was counted; else it is an estimate that changes.
    pub is_exact: bool,
    /// Columns and rows of a frame, upright.
    pub size: [usize; 2],
    /// Mean time from one frame to the next, in seconds.
    pub seconds_per_frame: f64,
    /// Seconds a tick of the time stamps.
    pub time_base: Rational,
    /// Width by height of a pixel.
    pub pixel_aspect: Rational,
    /// True if a frame far away is read as fast as the next one.
    pub seeks_fast: bool,
    /// Remarks on the clip, a sentence each.
    pub warnings: Vec<String>,
}

impl ClipFacts {
    /// The facts of a clip that was opened.
    pub(super) fn of(clip: &Clip) -> Self {
        let info = clip.info();
        let seconds_per_frame = seconds_per_frame(info);
        let estimate = info
            .duration_secs()
            .map(|seconds| (seconds / seconds_per_frame).round().clamp(1.0, 1e12) as u64);
        Self {
            frames: info.frames.or(estimate).unwrap_or(1).max(1),
            is_exact: info.frames.is_some(),
            size: [info.size.width(), info.size.height()],
            seconds_per_frame,
            time_base: info.time_base,
            pixel_aspect: info.pixel_aspect,
            seeks_fast: matches!(
                info.container,
                ravec_video::Container::Y4m | ravec_video::Container::Pictures
            ),
            warnings: clip.warnings().to_vec(),
        }
    }

    /// True if reading from the start reaches all places earlier than seeking them one by one.
    pub(super) fn is_read_in_order(&self) -> bool {
        !self.seeks_fast && self.frames <= MAX_FRAMES_IN_ORDER
    }

    /// The time of a frame at the mean rate, in seconds from the first one.
    pub fn seconds_at(&self, frame: u64) -> f64 {
        frame as f64 * self.seconds_per_frame
    }

    /// The number of the last frame.
    pub fn last(&self) -> u64 {
        self.frames.saturating_sub(1)
    }
}

fn seconds_per_frame(info: &ClipInfo) -> f64 {
    let by_rate = info.rate.map(|rate| rate.recip().to_f64());
    let by_count = info
        .duration_secs()
        .zip(info.frames)
        .map(|(seconds, frames)| seconds / frames.max(1) as f64);
    by_rate
        .or(by_count)
        .filter(|seconds| seconds.is_finite() && *seconds > 1e-6)
        .unwrap_or(DEFAULT_SECONDS)
}
