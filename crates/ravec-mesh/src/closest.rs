//! The point of a triangle that is closest to a given point.
//!
//! Source: Ericson, *Real-Time Collision Detection*, 2005, section 5.1.5. We differ in three ways. (1) All lengths are
//! taken relative to a corner and the distance is never taken from the rounded closest point, so that a triangle of
//! size 1e-6 at coordinates of 1e6 has exact distances. (2) Over the face the distance is taken along the normal. (3) A
//! triangle whose first corner is too sharp for the formulas is turned to its bluntest corner, and one that is (nearly)
//! a segment is measured by its edges, with its face only as an improvement.
//!
//! Guarantees: no NaN for finite input; the error of the distance is a few roundings of the larger of the distance to
//! the farthest corner and the triangle's size, also for needles, caps, segments and points. Does not guarantee: products
//! of four lengths that overflow (lengths beyond 1e75) give no useful answer.

use glam::DVec3;

/// A part of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Feature {
    /// The corner with this index, 0 to 2.
    Vertex(u8),
    /// The open edge from the corner with this index, 0 to 2, to the next one.
    Edge(u8),
    /// The open face.
    Face,
}

/// The point of a triangle that is closest to a given point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestOnTriangle {
    /// The place, rounded.
    pub point: DVec3,
    /// The part of the triangle it lies on.
    pub feature: Feature,
    /// The squared distance to the given point; more accurate than the distance to the rounded `point`.
    pub distance_sq: f64,
}

/// Smallest squared sine of the angle at the first corner for which the fast formulas are used.
///
/// Their error grows as its inverse: at 1e-3 three digits of sixteen are lost. A larger value sends more triangles down
/// the slow path for nothing.
const BLUNT: f64 = 1e-3;

/// The point of the triangle with these corners that is closest to `p`.
///
/// A triangle without area answers with an edge or a corner; of equally close parts the one with the lower index.
// the corners are not handed over as a copy, which takes a tenth of the time of an offset
#[inline]
pub fn closest_on_triangle(p: DVec3, corners: &[DVec3; 3]) -> ClosestOnTriangle {
    let &[a, b, c] = corners;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (aa, bb, d) = (ab.length_squared(), ac.length_squared(), ab.dot(ac));
    let area_sq = aa * bb - d * d;
    if area_sq > BLUNT * (aa * bb) {
        closest_on_blunt(p, corners, [ab, ac, ap], [aa, bb, d, area_sq])
    } else {
        closest_on_sharp(p, corners)
    }
}

/// The squared distance between `p` and the triangle with these corners: that of [`closest_on_triangle`], bit for bit.
#[inline]
pub fn distance_sq_to_triangle(p: DVec3, corners: &[DVec3; 3]) -> f64 {
    closest_on_triangle(p, corners).distance_sq
}

/// A corner as the answer: exactly there, and equally far as seen from all triangles that share it.
#[inline]
fn at_corner(p: DVec3, corners: &[DVec3; 3], corner: u8) -> ClosestOnTriangle {
    let point = corners[corner as usize];
    ClosestOnTriangle {
        point,
        feature: Feature::Vertex(corner),
        distance_sq: (p - point).length_squared(),
    }
}

/// The closest point if the angle at the first corner is neither small nor nearly straight.
#[inline(always)]
#[expect(
    clippy::needless_bitwise_bool,
    reason = "all parts are asked at once: the answers are hard to predict, and a wrong guess costs more than all of them"
)]
fn closest_on_blunt(
    p: DVec3,
    corners: &[DVec3; 3],
    [ab, ac, ap]: [DVec3; 3],
    [ab_sq, ac_sq, ab_ac, area_sq]: [f64; 4],
) -> ClosestOnTriangle {
    let (along_b, along_c) = (ab.dot(ap), ac.dot(ap));
    // The same products as seen from the other two corners.
    let (b_along_b, b_along_c) = (along_b - ab_sq, along_c - ab_ac);
    let (c_along_b, c_along_c) = (along_b - ab_ac, along_c - ac_sq);
    let weight_c = ab_sq * along_c - ab_ac * along_b;
    let weight_b = ac_sq * along_b - ab_ac * along_c;
    let (from_b, from_c) = (b_along_c - b_along_b, c_along_b - c_along_c);
    let at_a = (along_b <= 0.0) & (along_c <= 0.0);
    let at_b = (b_along_b >= 0.0) & (b_along_c <= b_along_b);
    let at_c = (c_along_c >= 0.0) & (c_along_b <= c_along_c);
    let on_ab = (weight_c <= 0.0) & (along_b >= 0.0) & (b_along_b <= 0.0);
    let on_ca = (weight_b <= 0.0) & (along_c >= 0.0) & (c_along_c <= 0.0);
    let on_bc = (area_sq - weight_b - weight_c <= 0.0) & (from_b >= 0.0) & (from_c >= 0.0);
    if at_a | at_b | at_c {
        let corner = if at_a { 0 } else { 2 - u8::from(at_b) };
        return at_corner(p, corners, corner);
    }
    if on_ab | on_ca | on_bc {
        let (from, along, share, edge) = if on_ab {
            (DVec3::ZERO, ab, along_b / ab_sq, 0)
        } else if on_ca {
            (DVec3::ZERO, ac, along_c / ac_sq, 2)
        } else {
            (ab, ac - ab, from_b / (from_b + from_c), 1)
        };
        let offset = from + along * share;
        return ClosestOnTriangle {
            point: corners[0] + offset,
            feature: Feature::Edge(edge),
            distance_sq: (ap - offset).length_squared(),
        };
    }
    let normal = ab.cross(ac);
    let height = normal.dot(ap);
    let normal_sq = normal.length_squared();
    ClosestOnTriangle {
        point: p - normal * (height / normal_sq),
        feature: Feature::Face,
        distance_sq: height * height / normal_sq,
    }
}

/// The closest point of a triangle whose first corner is sharp, straight or missing.
#[cold]
#[inline(never)]
fn closest_on_sharp(p: DVec3, corners: &[DVec3; 3]) -> ClosestOnTriangle {
    // The corner opposite the longest edge has the largest angle, at least 60 degrees.
    let length_sq = |i: usize| (corners[(i + 1) % 3] - corners[i]).length_squared();
    let [first, second, third] = [length_sq(0), length_sq(1), length_sq(2)];
    let longest = if first >= second && first >= third {
        0
    } else {
        1 + usize::from(third > second)
    };
    let turn = (longest + 2) % 3;
    let mut turned = *corners;
    turned.rotate_left(turn);
    let [a, b, c] = turned;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (ab_sq, ac_sq, ab_ac) = (ab.length_squared(), ac.length_squared(), ab.dot(ac));
    let area_sq = ab_sq * ac_sq - ab_ac * ab_ac;
    if area_sq <= BLUNT * (ab_sq * ac_sq) {
        return closest_on_cap(p, corners, a, [ab, ac, ap]);
    }
    let found = closest_on_blunt(p, &turned, [ab, ac, ap], [ab_sq, ac_sq, ab_ac, area_sq]);
    let back = |i: u8| (i + turn as u8) % 3;
    ClosestOnTriangle {
        feature: match found.feature {
            Feature::Vertex(i) => Feature::Vertex(back(i)),
            Feature::Edge(i) => Feature::Edge(back(i)),
            Feature::Face => Feature::Face,
        },
        ..found
    }
}

/// The closest point of a triangle that is nearly a segment or a point: the best of its corners and edges, or of its face
/// where that is seen to be closer still. Offsets of the face are taken from the bluntest corner, `a`.
fn closest_on_cap(
    p: DVec3,
    corners: &[DVec3; 3],
    a: DVec3,
    [ab, ac, ap]: [DVec3; 3],
) -> ClosestOnTriangle {
    let mut best = at_corner(p, corners, 0);
    let mut offer = |found: ClosestOnTriangle| {
        if found.distance_sq < best.distance_sq {
            best = found;
        }
    };
    let on = |from: DVec3, offset: DVec3, feature| ClosestOnTriangle {
        point: from + offset,
        feature,
        distance_sq: ((p - from) - offset).length_squared(),
    };
    for i in 1..3 {
        offer(at_corner(p, corners, i));
    }
    for i in 0..3_u8 {
        let (from, to) = (corners[i as usize], corners[(i as usize + 1) % 3]);
        let edge = to - from;
        let (along, length_sq) = (edge.dot(p - from), edge.length_squared());
        // False for an edge without length.
        if along > 0.0 && along < length_sq {
            offer(on(from, edge * (along / length_sq), Feature::Edge(i)));
        }
    }
    // Cross products keep twice the digits of the products of lengths that the fast formulas use.
    let normal = ab.cross(ac);
    let normal_sq = normal.length_squared();
    let weight_b = ap.cross(ac).dot(normal) / normal_sq;
    let weight_c = ab.cross(ap).dot(normal) / normal_sq;
    // False also where the weights are not numbers, for lack of area.
    if weight_b > 0.0 && weight_c > 0.0 && weight_b + weight_c < 1.0 {
        offer(on(a, ab * weight_b + ac * weight_c, Feature::Face));
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The smallest squared distance found by golden-section search along both weights: slow, but without cases.
    fn distance_sq_by_search(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
        fn lowest(f: impl Fn(f64) -> f64) -> f64 {
            let (mut low, mut high) = (0.0_f64, 1.0_f64);
            for _ in 0..100 {
                let (x, y) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
                if f(x) <= f(y) {
                    high = y;
                } else {
                    low = x;
                }
            }
            f(low).min(f(high)).min(f(0.0)).min(f(1.0))
        }
        let p = p - a;
        let (b, c) = (b - a, c - a);
        lowest(|s| {
            let (from, to) = (b * s, c * s);
            lowest(|t| (p - from - (to - from) * t).length_squared())
        })
    }

    fn place() -> impl Strategy<Value = DVec3> {
        // Small integers make coincident and collinear corners likely.
        prop_oneof![
            [-2_i32..3, -2_i32..3, -2_i32..3].prop_map(|v| DVec3::from_array(v.map(f64::from))),
            [-2.0..2.0, -2.0..2.0, -2.0..2.0].prop_map(DVec3::from_array),
        ]
    }

    /// The point of `corners` the answer claims, on the feature it claims.
    fn assert_on_feature(found: &ClosestOnTriangle, corners: [DVec3; 3]) {
        match found.feature {
            Feature::Vertex(i) => assert_eq!(found.point, corners[i as usize]),
            Feature::Edge(i) => {
                let (from, to) = (corners[i as usize], corners[(i as usize + 1) % 3]);
                let off = (found.point - from).cross(to - from).length();
                assert!(off <= 1e-12 * (to - from).length().max(1.0), "{off}");
            }
            Feature::Face => {
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                assert!(normal.length() > 0.0);
            }
        }
    }

    proptest! {
        #[test]
        fn the_distance_is_the_smallest_over_the_triangle(
            p in place(), a in place(), b in place(), c in place(), flatness in 0_i32..16, far in any::<bool>(),
        ) {
            // Needles and caps: the triangle squeezed along an axis, by up to 1e-15.
            let squeeze = DVec3::new(1.0, 10_f64.powi(-flatness), 1.0);
            let flat = [a, b, c].map(|v| DVec3::new(v.x, v.y, 0.0) * squeeze);
            let turned = flat.map(|v| glam::DQuat::from_rotation_x(0.7) * v);
            for corners in [[a, b, c], flat, turned] {
                let p = if far { p * 1e3 } else { p };
                let found = closest_on_triangle(p, &corners);
                assert_on_feature(&found, corners);
                let expected = distance_sq_by_search(p, corners).sqrt();
                let error = (found.distance_sq.sqrt() - expected).abs();
                // The search itself stops at 1e-8 of the size where the distance is zero.
                let tolerance = if expected < 1e-6 { 1e-8 } else { 1e-12 * (1.0 + expected) };
                prop_assert!(error <= tolerance, "{found:?} but {expected}");
                let direct = found.point.distance(p);
                prop_assert!((direct - found.distance_sq.sqrt()).abs() <= 1e-12 * (1.0 + p.length()), "{found:?}");
            }
        }

        #[test]
        fn small_triangles_far_from_the_origin_keep_their_digits(p in place(), a in place(), b in place(), c in place()) {
            // Steps of 2^-28 are exact at 2^20, so that the shifted triangle is the same one.
            let small = |v: DVec3| (v * 64.0).round() * (0.5_f64.powi(28));
            let shift = DVec3::new(1048576.0, -1048576.0, 524288.0);
            let here = closest_on_triangle(small(p), &[a, b, c].map(small));
            let there = closest_on_triangle(small(p) + shift, &[a, b, c].map(|v| small(v) + shift));
            prop_assert_eq!(here.distance_sq, there.distance_sq);
            prop_assert_eq!(here.feature, there.feature);
        }
    }

    #[test]
    fn every_feature_is_found_from_its_region() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for (p, feature, distance) in [
            (DVec3::new(-3.0, -4.0, 0.0), Feature::Vertex(0), 5.0),
            (
                DVec3::new(4.0, -1.0, 0.0),
                Feature::Vertex(1),
                10_f64.sqrt(),
            ),
            (
                DVec3::new(-1.0, 4.0, 0.0),
                Feature::Vertex(2),
                10_f64.sqrt(),
            ),
            (DVec3::new(0.5, -2.0, 0.0), Feature::Edge(0), 2.0),
            (DVec3::new(1.0, 1.0, 0.0), Feature::Edge(1), 0.5_f64.sqrt()),
            (DVec3::new(-2.0, 0.5, 0.0), Feature::Edge(2), 2.0),
            (DVec3::new(0.2, 0.2, -7.0), Feature::Face, 7.0),
        ] {
            for turn in 0..3_u8 {
                let mut turned = corners;
                turned.rotate_left(turn as usize);
                let found = closest_on_triangle(p, &turned);
                let renamed = match feature {
                    Feature::Vertex(i) => Feature::Vertex((i + 3 - turn) % 3),
                    Feature::Edge(i) => Feature::Edge((i + 3 - turn) % 3),
                    Feature::Face => Feature::Face,
                };
                assert_eq!(found.feature, renamed);
                assert!((found.distance_sq.sqrt() - distance).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn segments_and_points_count_as_triangles() {
        let p = DVec3::new(1.0, 2.0, 0.0);
        let point = closest_on_triangle(p, &[DVec3::ZERO; 3]);
        assert_eq!(
            (point.feature, point.distance_sq),
            (Feature::Vertex(0), 5.0)
        );
        let segment = closest_on_triangle(p, &[DVec3::ZERO, DVec3::X * 3.0, DVec3::X * 2.0]);
        assert_eq!((segment.point, segment.distance_sq), (DVec3::X, 4.0));
    }
}
