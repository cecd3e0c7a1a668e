//! Straight line segments in pictures.

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A straight stretch of an edge, in pixels, x right, y down, pixel centers at half-integers.
///
/// It stands here because the crates that find segments and those that use them do not know one another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Segment {
    /// Its ends, in any order.
    pub ends: [DVec2; 2],
}

impl Segment {
    /// The middle, in pixels, x right, y down, pixel centers at half-integers.
    pub fn middle(&self) -> DVec2 {
        0.5 * (self.ends[0] + self.ends[1])
    }

    /// The length in pixels.
    pub fn length_px(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }
}
