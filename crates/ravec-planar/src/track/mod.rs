//! One plane through a clip: where a quadrilateral of a reference frame lies in every other frame.
//!
//! Each frame is measured against the reference frame itself, or against a keyframe that is tied to it, so that errors do not
//! add up from frame to frame.
//!
//! # Conventions
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers. A frame that was exposed while things moved shows
//! the mean over its exposure, and its homography is the one through the mean positions.

mod align;
mod bridge;
mod follow;
mod judge;
mod keys;
mod offsets;
mod picture;
mod record;
mod search;
mod solve;
mod template;
mod ties;
mod tracker;
mod walk;

pub use record::{CornerCovariance, Track, TrackState, TrackedFrame};
pub use solve::{CorrectError, Correction};
pub use ties::{MAX_KEYFRAMES, Tie, TieError, TiedKeyframes, tie_keyframes};
pub use tracker::{PlaneTracker, Precision, TrackError, TrackParams, TrackRegion};
