//! The distance between two triangles.
//!
//! Triangles that meet are at distance zero, and whether they meet is decided exactly. Others are closest either at a
//! corner of one of them or between two edges that pass each other, so that the least of six distances of corners to
//! triangles and nine of edges to edges is the answer. Edges that are closest at an end are among the former; what is
//! left is the place where the lines through both edges are closest, if that lies within both.
//!
//! Guarantees: exactly zero if and only if the triangles have a point in common; otherwise the error is a few roundings
//! of the larger of the distance and the triangles' size, also for needles, segments, points, and edges that are nearly
//! parallel; never less than the true distance by more than that. Does not guarantee: lengths beyond 1e75 give no useful
//! answer.
//! Cost: about 0.15 µs.

use glam::DVec3;

use crate::closest::distance_sq_to_triangle;
use crate::tri_intersect::{TriTri, intersection};

/// The squared distance between the triangles with the corners `a` and `b`; zero if they meet.
pub fn triangle_distance_sq(a: [DVec3; 3], b: [DVec3; 3]) -> f64 {
    if intersection(&a, &b) != TriTri::Disjoint {
        return 0.0;
    }
    let mut best = f64::INFINITY;
    for i in 0..3 {
        best = best
            .min(distance_sq_to_triangle(a[i], &b))
            .min(distance_sq_to_triangle(b[i], &a));
    }
    for i in 0..3 {
        let along_a = a[(i + 1) % 3] - a[i];
        for j in 0..3 {
            let along_b = b[(j + 1) % 3] - b[j];
            best = best.min(passing_distance_sq(b[j] - a[i], along_a, along_b));
        }
    }
    // Apart, if only by less than the smallest number.
    best.max(f64::MIN_POSITIVE)
}

/// The squared distance of two edges where the lines through them are closest; infinite if that is not within both.
///
/// `between` leads from the start of the one to the start of the other.
///
/// All is taken from cross products: those of nearly parallel edges at an angle t are right to eps / t, the place is found
/// to eps / t of the length, and an error of the place counts only t times.
#[inline]
fn passing_distance_sq(between: DVec3, along_a: DVec3, along_b: DVec3) -> f64 {
    let normal = along_a.cross(along_b);
    let normal_sq = normal.length_squared();
    let at_a = between.cross(along_b).dot(normal);
    let at_b = between.cross(along_a).dot(normal);
    let within = 0.0 < at_a && at_a < normal_sq && 0.0 < at_b && at_b < normal_sq;
    if within {
        let (at_a, at_b) = (at_a / normal_sq, at_b / normal_sq);
        (between + along_b * at_b - along_a * at_a).length_squared()
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The smallest distance found by interval search along both weights of `a`; the distance to `b` is convex there.
    fn distance_by_search([a, b, c]: [DVec3; 3], other: [DVec3; 3]) -> f64 {
        fn lowest(f: impl Fn(f64) -> f64) -> f64 {
            let (mut low, mut high) = (0.0_f64, 1.0_f64);
            for _ in 0..80 {
                let (x, y) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
                if f(x) <= f(y) {
                    high = y;
                } else {
                    low = x;
                }
            }
            f(low).min(f(0.0)).min(f(1.0))
        }
        // As the triangle of all (from + (to - from) t) the function of s, t is convex in t for each s, and the minimum
        // over t is convex in s.
        lowest(|s| {
            let (from, to) = (a.lerp(b, s), a.lerp(c, s));
            lowest(|t| distance_sq_to_triangle(from.lerp(to, t), &other).sqrt())
        })
    }

    fn place() -> impl Strategy<Value = DVec3> {
        prop_oneof![
            [-2_i32..3, -2_i32..3, -2_i32..3].prop_map(|at| DVec3::from_array(at.map(f64::from))),
            [-2.0..2.0, -2.0..2.0, -2.0..2.0].prop_map(DVec3::from_array),
        ]
    }

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        [place(), place(), place()]
    }

    proptest! {
        #[test]
        fn the_distance_is_the_smallest_of_all(
            a in triangle(), b in triangle(), apart in place(), flatness in 0_i32..12,
        ) {
            let squeeze = DVec3::new(1.0, 10_f64.powi(-flatness), 1.0);
            let b = b.map(|at| at * squeeze + apart);
            let distance = triangle_distance_sq(a, b).sqrt();
            let expected = distance_by_search(a, b);
            // The search ends at 1e-13 of the size, but loses half of the digits around a distance of zero.
            let tolerance = if expected < 1e-5 { 1e-7 } else { 1e-11 };
            prop_assert!((distance - expected).abs() <= tolerance, "{distance} but {expected}");
            prop_assert_eq!(distance == 0.0, intersection(&a, &b) != TriTri::Disjoint);
            // The same whichever way it is asked.
            let [b0, b1, b2] = b;
            let again = triangle_distance_sq([b2, b0, b1], a).sqrt();
            prop_assert!((distance - again).abs() <= 1e-14 * (1.0 + distance));
        }
    }

    #[test]
    fn each_pair_of_parts_has_its_distance() {
        let flat = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0];
        let up = |x: f64, y: f64, z: f64| {
            let tip = DVec3::new(x, y, z);
            [tip, tip + DVec3::Z, tip + DVec3::new(0.0, -0.1, 1.0)]
        };
        // Corner above the face, corner before a corner, corner beside an edge.
        assert_eq!(triangle_distance_sq(flat, up(1.0, 1.0, 2.0)), 4.0);
        assert_eq!(triangle_distance_sq(flat, up(-3.0, -4.0, 0.0)), 25.0);
        assert_eq!(triangle_distance_sq(flat, up(2.0, -3.0, 0.0)), 9.0);
        // Two edges that pass each other, and two that are parallel.
        let across = [
            DVec3::new(2.0, -1.0, 1.0),
            DVec3::new(2.0, -1.0, -1.0),
            DVec3::new(2.0, -5.0, 0.0),
        ];
        assert_eq!(triangle_distance_sq(flat, across), 1.0);
        let beside = flat.map(|at| DVec3::new(at.x, -at.y - 1.5, at.z));
        assert_eq!(triangle_distance_sq(flat, beside), 2.25);
    }

    #[test]
    fn triangles_that_pierce_or_touch_are_at_distance_zero_and_others_never() {
        let flat = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0];
        let pierce = [
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(1.0, 1.0, -1.0),
            DVec3::new(9.0, 9.0, 0.0),
        ];
        assert_eq!(triangle_distance_sq(flat, pierce), 0.0);
        let touch = [
            DVec3::new(2.0, 2.0, 0.0),
            DVec3::splat(3.0),
            DVec3::splat(4.0),
        ];
        assert_eq!(triangle_distance_sq(flat, touch), 0.0);
        assert_eq!(triangle_distance_sq(flat, flat), 0.0);
        let above = flat.map(|at| at + DVec3::Z * 1e-300);
        assert!(triangle_distance_sq(flat, above) > 0.0);
    }

    #[test]
    fn nearly_parallel_needles_keep_their_distance() {
        // Two needles that cross at an angle of 1e-9, a height of 1e-3 apart.
        let a = [DVec3::X * -1.0, DVec3::X, DVec3::X];
        for angle in [1e-3, 1e-6, 1e-9, 1e-12] {
            let tip = DVec3::new(1.0, angle, 1e-3);
            let end = DVec3::new(-1.0, -angle, 1e-3);
            let distance = triangle_distance_sq(a, [tip, end, end]).sqrt();
            assert!((distance - 1e-3).abs() < 1e-15, "{distance} at {angle}");
        }
    }
}
