//! The result of tracking: a pose with its uncertainty for each frame.

use crate::homography::Homography;
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Covariance of the four corners in square pixels, in the order x0, y0, x1, y1, x2, y2, x3, y3.
pub type CornerCovariance = [[f64; 8]; 8];

/// Trust in the pose of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrackState {
    /// The plane is seen, and its pose is measured.
    Tracked,
    /// The pose is measured, but little of the plane is seen, or its error may exceed a pixel.
    Weak,
    /// The plane is not found. The pose is that of the last frame in which it was, and means nothing.
    Lost,
}

/// The plane in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrackedFrame {
    /// Trust in the pose.
    pub state: TrackState,
    /// Map from the reference frame to this one.
    pub frame_from_reference: Homography,
    /// Corners of the quadrilateral in this frame, in pixels.
    pub corners: [DVec2; 4],
    /// Covariance of the corners: two standard deviations contain the error in about 95 % of the frames. Zero at the reference
    /// frame; large, not infinite, where the plane is lost.
    pub covariance: CornerCovariance,
    /// Share of the samples in view that agree with the pose, 0 to 1.
    pub inlier_share: f64,
    /// Share of the region's texture that is seen, inside the frame and not hidden, 0 to 1.
    pub visible: f64,
    /// Robust standard deviation of the residuals, in encoded values from 0 to 1.
    pub residual: f64,
    /// Factor of the light against the reference frame.
    pub gain: f64,
    /// Offset of the light against the reference frame, in encoded values from 0 to 1.
    pub bias: f64,
    /// Number of the keyframe that the frame was measured against, in the order of their creation; 0 is the reference.
    pub keyframe: usize,
}

impl TrackedFrame {
    /// Root mean square of the predicted standard deviations of the four corners' positions, in pixels.
    pub fn sigma_px(&self) -> f64 {
        let trace: f64 = (0..8).map(|k| self.covariance[k][k]).sum();
        (0.25 * trace).max(0.0).sqrt()
    }
}

/// A plane through a range of frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Columns of the frames.
    pub width: usize,
    /// Rows of the frames.
    pub height: usize,
    /// Corners of the quadrilateral in the reference frame, in pixels.
    pub quad: [DVec2; 4],
    /// Number of the reference frame in the clip, from 0.
    pub reference: u64,
    /// Number of the first tracked frame in the clip, from 0.
    pub first: u64,
    /// The frames from `first` on, one after the other.
    pub frames: Vec<TrackedFrame>,
}

impl Track {
    /// The frame with number `index` of the clip, if it was tracked.
    pub fn frame(&self, index: u64) -> Option<&TrackedFrame> {
        let offset = index.checked_sub(self.first)?;
        self.frames.get(usize::try_from(offset).ok()?)
    }
}
