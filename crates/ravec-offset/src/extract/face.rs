//! Faces between leaves.

use glam::DVec3;
use ravec_octree::{CellKey, Frame};

/// Share of the side of a face that a dual edge, or a vertex in the face, keeps from its border.
const FACE_MARGIN: f64 = 1e-7;

/// The square in which two leaves touch.
pub(super) struct Face {
    /// The axis across the face.
    pub axis: usize,
    pub low: DVec3,
    pub high: DVec3,
}

impl Face {
    pub fn between([a, b]: [CellKey; 2], frame: &Frame) -> Self {
        let small = if a.level >= b.level { a } else { b };
        let overlaps = |axis: usize| {
            a.at.0[axis] < b.at.0[axis] + b.side() && b.at.0[axis] < a.at.0[axis] + a.side()
        };
        let axis = (0..3)
            .find(|&axis| !overlaps(axis))
            .expect("leaves of a dual edge touch in a face");
        let plane = if a.at.0[axis] < b.at.0[axis] {
            b.at.0[axis]
        } else {
            a.at.0[axis]
        };
        let [mut low, mut high] = frame.bounds(small);
        let mut corner = small.at;
        corner.0[axis] = plane;
        low[axis] = frame.point(corner)[axis];
        high[axis] = low[axis];
        Self { axis, low, high }
    }

    /// Returns the face without its border.
    fn inner(&self) -> [DVec3; 2] {
        let mut margin = FACE_MARGIN * (self.high - self.low);
        margin[self.axis] = 0.0;
        [self.low + margin, self.high - margin]
    }

    pub fn is_crossed(&self, [a, b]: [DVec3; 2]) -> bool {
        let plane = self.low[self.axis];
        let (from, to) = (a[self.axis] - plane, b[self.axis] - plane);
        if from * to >= 0.0 {
            return false;
        }
        let mut p = a.lerp(b, from / (from - to));
        p[self.axis] = plane;
        let [low, high] = self.inner();
        p.cmpge(low).all() && p.cmple(high).all()
    }

    /// Returns the point of the face nearest to `p`, at a distance from its border.
    pub fn clamp(&self, p: DVec3, margin: f64) -> DVec3 {
        let mut margin = DVec3::splat(margin);
        margin[self.axis] = 0.0;
        p.clamp(self.low + margin, self.high - margin)
    }
}
