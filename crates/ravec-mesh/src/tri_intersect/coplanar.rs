//! Two triangles with area in one plane.

use glam::DVec3;

use super::{Common, TriTri};
use crate::predicates::{Projection, Sign};

/// Location of a point relative to a convex polygon or a segment.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    Outside,
    Border,
    Inside,
}

/// A view along an axis in which the triangle keeps its area, and its orientation there.
///
/// The triangle must not be degenerate; then one of the views shows it, and the one that faces the rounded normal
/// nearly always does.
pub(super) fn view(t: &[DVec3; 3], normal: DVec3) -> (Projection, Sign) {
    let first = Projection::facing(normal);
    let mut best = (first, first.orient(t[0], t[1], t[2]));
    for on in Projection::ALL {
        if best.1 != Sign::Zero {
            break;
        }
        best = (on, on.orient(t[0], t[1], t[2]));
    }
    best
}

/// The sides of `points` of each edge of `t`, from corner `i` to the next one; positive is inside.
fn sides<const N: usize>(
    t: &[DVec3; 3],
    (on, turn): (Projection, Sign),
    points: &[DVec3; N],
) -> [[Sign; N]; 3] {
    std::array::from_fn(|i| {
        let (from, to) = (t[i], t[(i + 1) % 3]);
        std::array::from_fn(|k| {
            let p = points[k];
            if p == from || p == to {
                Sign::Zero
            } else {
                turn * on.orient(from, to, p)
            }
        })
    })
}

/// Place of `p`, a point of the plane of `t`.
pub(super) fn place(t: &[DVec3; 3], view: (Projection, Sign), p: DVec3) -> Place {
    place_by(&sides(t, view, &[p]), 0)
}

fn place_by<const N: usize>(sides: &[[Sign; N]; 3], k: usize) -> Place {
    match sides.iter().map(|edge| edge[k]).min() {
        Some(Sign::Positive) => Place::Inside,
        Some(Sign::Zero) => Place::Border,
        _ => Place::Outside,
    }
}

/// Separation of two convex figures by a line along one of their edges: the larger, the farther.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Apart {
    Overlapping,
    Touching,
    Separate,
}

/// Separation, by the line of an edge with its own figure on the positive side, of that figure from points on `sides`.
fn apart_by(sides: &[Sign]) -> Apart {
    match sides.iter().max() {
        Some(Sign::Negative) => Apart::Separate,
        Some(Sign::Zero) => Apart::Touching,
        _ => Apart::Overlapping,
    }
}

pub(super) fn triangles(a: &[DVec3; 3], b: &[DVec3; 3], common: Common, normal: DVec3) -> TriTri {
    let view_a = view(a, normal);
    let turn_b = view_a.0.orient(b[0], b[1], b[2]);
    let of_b = sides(a, view_a, b);
    let of_a = sides(b, (view_a.0, turn_b), a);
    // two convex polygons are apart if and only if the line of an edge of one of them keeps them apart
    let edges = of_a.iter().chain(&of_b);
    let apart = edges.map(|edge| apart_by(edge)).max();
    match apart {
        Some(Apart::Separate) => TriTri::Disjoint,
        Some(Apart::Touching) => {
            // the ends of what they share on the line between them are corners
            let loose = (0..3).any(|k| {
                (!common.first[k] && place_by(&of_a, k) != Place::Outside)
                    || (!common.second[k] && place_by(&of_b, k) != Place::Outside)
            });
            if loose {
                TriTri::Touch
            } else {
                TriTri::Neighbors
            }
        }
        _ => TriTri::CoplanarOverlap,
    }
}

/// A segment with two different ends in the plane of the triangle `t`, which has area; `common_s` and `common_t` say
/// which ends and corners also belong to the other.
pub(super) fn segment_and_triangle(
    s: [DVec3; 2],
    common_s: [bool; 2],
    t: &[DVec3; 3],
    common_t: [bool; 3],
    view: (Projection, Sign),
) -> TriTri {
    let ends = sides(t, view, &s);
    let across: [Sign; 3] = t.map(|corner| {
        if corner == s[0] || corner == s[1] {
            Sign::Zero
        } else {
            view.0.orient(s[0], s[1], corner)
        }
    });
    let opposite = across.map(|side| -side);
    let lines = [apart_by(&across), apart_by(&opposite)];
    let apart = ends.iter().map(|edge| apart_by(edge)).chain(lines).max();
    match apart {
        Some(Apart::Separate) => TriTri::Disjoint,
        Some(Apart::Touching) => {
            let loose_end = (0..2).any(|k| !common_s[k] && place_by(&ends, k) != Place::Outside);
            let loose_corner = (0..3).any(|k| {
                !common_t[k] && across[k] == Sign::Zero && between(s, t[k]) != Place::Outside
            });
            if loose_end || loose_corner {
                TriTri::Touch
            } else {
                TriTri::Neighbors
            }
        }
        _ => TriTri::CoplanarOverlap,
    }
}

/// Place of `p`, a point of the line through the two different ends of `s`.
pub(super) fn between(s: [DVec3; 2], p: DVec3) -> Place {
    if p == s[0] || p == s[1] {
        return Place::Border;
    }
    // along a line each coordinate is monotone, so that boxes decide
    let inside = s[0].min(s[1]).cmple(p).all() && p.cmple(s[0].max(s[1])).all();
    if inside {
        Place::Inside
    } else {
        Place::Outside
    }
}
