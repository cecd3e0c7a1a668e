//! Pockets: parts of space that are farther from the triangles than the surface, and have no corner of a cell in them.
//!
//! Where the distance is largest, what is closest lies in directions that no half-space holds, so that two of them differ by 109° at
//! least; corners around such a place see that. Then it takes a proof that there is none.
//!
//! Guarantee: if what corners see differs, no point of a cell that passes is farther than the surface by more than half of the
//! tolerance. Not guaranteed: that they see it; rooms turned at random, hardly higher than the tolerance, are all found in tests.

use crate::cell::{Cell, CornerValue};
use crate::field::Near;
use glam::DVec3;

/// Directions to what is closest that differ by more, as a cosine, may be those around a pocket.
const SPREAD_OF_POCKET: f64 = -0.1;

/// How much farther than the surface points of a cell may be that counts as free of pockets, as a share of the tolerance.
const SHALLOW: f64 = 0.5;

impl Cell<'_> {
    /// Whether a pocket may be in the cell, if all corners have the same sign; `center` is its middle.
    pub fn may_hold_a_pocket(&self, center: Near, corners: &[CornerValue; 8]) -> bool {
        let field = self.setting.field;
        // only what is nearer than the surface, or on the other side of the triangles, may have pockets in it
        if corners[0].value * field.level >= 0.0 {
            return false;
        }
        let points: [DVec3; 8] =
            std::array::from_fn(|octant| self.setting.frame.point(self.key.corner(octant)));
        // upward through the triangles, so that their two sides do not count as different
        let upward = |i: usize| {
            let away = field.near_of(points[i], corners[i].triangle).away;
            (corners[i].value + field.level).signum() * away
        };
        let upward: Vec<DVec3> = (0..8).map(upward).collect();
        let differ =
            |(i, a): (usize, &DVec3)| upward[..i].iter().any(|b| a.dot(*b) < SPREAD_OF_POCKET);
        if !upward.iter().enumerate().any(differ) {
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
        // the distance to one triangle is convex, and so is the mean of two: none of the cell's points is farther than the farthest
        // corner
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
