//! Triangles without area: segments and points.
//!
//! The intersection of two convex figures is convex, and its extreme points are corners of either or points where edges
//! cross. They meet beyond the corners in common if one of those extreme points is not such a corner.

use glam::DVec3;

use super::coplanar::{self, Place};
use super::{Common, TriTri};
use crate::predicates::{OrientedPlane, Projection, Sign, on_one_line, orient3d};

/// The first and the last corner of a triangle without area along its line, as indices; the same if it is a point.
fn ends(t: &[DVec3; 3]) -> [usize; 2] {
    let before = |p: DVec3, q: DVec3| p.to_array() < q.to_array();
    let mut ends = [0, 0];
    for k in 1..3 {
        if before(t[k], t[ends[0]]) {
            ends[0] = k;
        }
        if before(t[ends[1]], t[k]) {
            ends[1] = k;
        }
    }
    ends
}

/// A triangle `a` without area and any triangle `b`, which do not have all corners in common.
pub(super) fn with_any(a: &[DVec3; 3], b: &[DVec3; 3], common: Common) -> TriTri {
    let [i, j] = ends(a);
    let plane = OrientedPlane::through(b[0], b[1], b[2]);
    let flat_b = plane.is_degenerate();
    let [k, l] = if flat_b { ends(b) } else { [0, 1] };
    let segment = [a[i], a[j]];
    let common_ends = [common.first[i], common.first[j]];
    let other = [b[k], b[l]];
    let common_other = [common.second[k], common.second[l]];
    match (a[i] != a[j], flat_b, b[k] != b[l]) {
        (false, false, _) => point_and_triangle(a[i], common.first[i], b, &plane),
        (false, true, true) => point_and_segment(a[i], common.first[i], other),
        (true, true, false) => point_and_segment(b[k], common.second[k], segment),
        // the same point would have all corners in common
        (false, true, false) => TriTri::Disjoint,
        (true, false, _) => segment_and_triangle(segment, common_ends, b, common.second, &plane),
        (true, true, true) => {
            let met = segments(segment, common_ends, other, common_other);
            // lines that cross share one point, which may be the middle corner of both
            if met == TriTri::CoplanarOverlap
                && common.first.contains(&true)
                && !on_one_line(segment[0], segment[1], other[0])
                && !on_one_line(segment[0], segment[1], other[1])
            {
                TriTri::Neighbors
            } else {
                met
            }
        }
    }
}

fn contact(place: Place, common: bool, inside: TriTri) -> TriTri {
    match place {
        Place::Outside => TriTri::Disjoint,
        _ if common => TriTri::Neighbors,
        Place::Border => TriTri::Touch,
        Place::Inside => inside,
    }
}

fn point_and_triangle(p: DVec3, common: bool, t: &[DVec3; 3], plane: &OrientedPlane) -> TriTri {
    if !common && plane.side(p) != Sign::Zero {
        return TriTri::Disjoint;
    }
    let place = coplanar::place(t, coplanar::view(t, plane.normal()), p);
    contact(place, common, TriTri::CoplanarOverlap)
}

fn point_and_segment(p: DVec3, common: bool, s: [DVec3; 2]) -> TriTri {
    if !on_one_line(s[0], s[1], p) {
        return TriTri::Disjoint;
    }
    contact(coplanar::between(s, p), common, TriTri::CoplanarOverlap)
}

fn segment_and_triangle(
    s: [DVec3; 2],
    common_s: [bool; 2],
    t: &[DVec3; 3],
    common_t: [bool; 3],
    plane: &OrientedPlane,
) -> TriTri {
    let view = coplanar::view(t, plane.normal());
    match s.map(|end| plane.side(end)) {
        [Sign::Zero, Sign::Zero] => coplanar::segment_and_triangle(s, common_s, t, common_t, view),
        [Sign::Zero, _] => contact(coplanar::place(t, view, s[0]), common_s[0], TriTri::Touch),
        [_, Sign::Zero] => contact(coplanar::place(t, view, s[1]), common_s[1], TriTri::Touch),
        [from, to] if from == to => TriTri::Disjoint,
        _ => {
            // the line of the segment passes each edge of the triangle on the same side, or meets it
            let passes: [Sign; 3] =
                std::array::from_fn(|k| orient3d(s[0], s[1], t[k], t[(k + 1) % 3]));
            let (positive, negative) = (
                passes.contains(&Sign::Positive),
                passes.contains(&Sign::Negative),
            );
            if positive && negative {
                return TriTri::Disjoint;
            }
            match passes.iter().filter(|&&side| side == Sign::Zero).count() {
                0 => TriTri::Crossing,
                1 => TriTri::Touch,
                _ => {
                    // both edges at one corner
                    let pierced = (0..3)
                        .find(|&k| passes[k] == Sign::Zero && passes[(k + 2) % 3] == Sign::Zero);
                    if pierced.is_some_and(|k| common_t[k]) {
                        TriTri::Neighbors
                    } else {
                        TriTri::Touch
                    }
                }
            }
        }
    }
}

/// Two segments, each with two different ends.
fn segments(s: [DVec3; 2], common_s: [bool; 2], t: [DVec3; 2], common_t: [bool; 2]) -> TriTri {
    if orient3d(s[0], s[1], t[0], t[1]) != Sign::Zero {
        return TriTri::Disjoint;
    }
    let view = Projection::ALL.into_iter().find(|on| {
        t.iter().any(|&p| on.orient(s[0], s[1], p) != Sign::Zero)
            || s.iter().any(|&p| on.orient(t[0], t[1], p) != Sign::Zero)
    });
    let Some(on) = view else {
        return collinear(s, common_s, t, common_t);
    };
    // in this view neither is a point: the line of the other would pass through it and then all four be on one line
    let of_t = t.map(|p| on.orient(s[0], s[1], p));
    let of_s = s.map(|p| on.orient(t[0], t[1], p));
    let product = (of_t[0] * of_t[1]).max(of_s[0] * of_s[1]);
    match product {
        Sign::Positive => TriTri::Disjoint,
        Sign::Negative => TriTri::CoplanarOverlap,
        Sign::Zero => {
            let met = |sides: [Sign; 2], ends: [DVec3; 2], common: [bool; 2], other: [DVec3; 2]| {
                (0..2)
                    .filter(|&k| sides[k] == Sign::Zero)
                    .find(|&k| coplanar::between(other, ends[k]) != Place::Outside)
                    .map(|k| common[k])
            };
            match met(of_t, t, common_t, s).or_else(|| met(of_s, s, common_s, t)) {
                Some(true) => TriTri::Neighbors,
                Some(false) => TriTri::Touch,
                None => TriTri::Disjoint,
            }
        }
    }
}

/// Two segments on one line, each with its ends in ascending order.
fn collinear(s: [DVec3; 2], common_s: [bool; 2], t: [DVec3; 2], common_t: [bool; 2]) -> TriTri {
    let key = |p: DVec3| p.to_array();
    let (start, start_common) = if key(s[0]) >= key(t[0]) {
        (s[0], common_s[0])
    } else {
        (t[0], common_t[0])
    };
    let (end, end_common) = if key(s[1]) <= key(t[1]) {
        (s[1], common_s[1])
    } else {
        (t[1], common_t[1])
    };
    if key(start) > key(end) {
        TriTri::Disjoint
    } else if start_common && end_common {
        TriTri::Neighbors
    } else if start == end {
        TriTri::Touch
    } else {
        TriTri::CoplanarOverlap
    }
}
