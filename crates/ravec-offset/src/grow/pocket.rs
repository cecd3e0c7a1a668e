//! Pockets: parts of space farther from the triangles than the surface that contain no corner of a cell.
//!
//! At a maximum of the distance, no half-space contains the directions to all closest points, so two of them differ by at least
//! 109°. Corners around such a place show this, and then the cell must be proved free of pockets.
//!
//! Guarantees: if the directions at the corners differ, no point of an accepted cell is farther than the surface by more than
//! half of the tolerance. Does not guarantee: that the corners show every pocket; randomly rotated rooms hardly higher than the
//! tolerance are all found in tests.

use super::{Cell, CornerValue, is_sheet};
use crate::domain::Near;
use glam::DVec3;

/// Largest cosine between directions to closest points that may surround a pocket.
const SPREAD_OF_POCKET: f64 = -0.1;

/// Depth of a pocket that may remain, as a share of the tolerance.
const SHALLOW: f64 = 0.5;

/// Number of triangles up to which a cell cannot hide a room from its corners.
const FEW_TRIANGLES: usize = 6;

impl Cell<'_> {
    /// Returns whether triangles may enclose a room without a corner in it.
    pub(super) fn is_crowd(&self, triangles: &[u32]) -> bool {
        let field = self.setting.field;
        let normals = || -> Vec<DVec3> { triangles.iter().map(|&t| field.normal(t)).collect() };
        triangles.len() > FEW_TRIANGLES && !(field.is_oriented() && is_sheet(&normals()))
    }

    /// Returns whether the cell may hold a pocket, if all corners have the same sign; `center` belongs to its center. In a
    /// crowded cell the directions at the corners are not consulted.
    pub(super) fn may_hold_a_pocket(
        &self,
        center: Near,
        corners: &[CornerValue; 8],
        is_crowded: bool,
    ) -> bool {
        let field = self.setting.field;
        // pockets are in cells nearer than the surface, or on the other side of the triangles
        if corners[0].value * field.level >= 0.0 {
            return false;
        }
        let points: [DVec3; 8] =
            std::array::from_fn(|octant| self.setting.frame.point(self.key.corner(octant)));
        let is_on_side = |i: &usize| (corners[*i].value + field.level) * field.level > 0.0;
        let away = |i: usize| field.near_of(points[i], corners[i].triangle).away;
        let differ = || {
            let aways: Vec<DVec3> = (0..8).filter(is_on_side).map(away).collect();
            let mut pairs = (1..aways.len()).flat_map(|i| (0..i).map(move |j| [i, j]));
            pairs.any(|[i, j]| aways[i].dot(aways[j]) < SPREAD_OF_POCKET)
        };
        if !is_crowded && !differ() {
            return false;
        }
        let mut triangles: Vec<u32> = corners.iter().map(|corner| corner.triangle).collect();
        triangles.push(center.triangle);
        triangles.sort_unstable();
        triangles.dedup();
        let distances: Vec<[f64; 8]> = triangles
            .into_iter()
            .map(|triangle| points.map(|p| field.near_of(p, triangle).distance))
            .collect();
        // the distance to one triangle is convex, and so is the mean of two: over the cell they are
        // largest at a corner
        let most = field.radius() + SHALLOW * self.setting.tolerance;
        let holds_none =
            |a: &[f64; 8], b: &[f64; 8]| a.iter().zip(b).all(|(a, b)| 0.5 * (a + b) <= most);
        !(0..distances.len()).any(|i| {
            distances[..=i]
                .iter()
                .any(|other| holds_none(&distances[i], other))
        })
    }
}
