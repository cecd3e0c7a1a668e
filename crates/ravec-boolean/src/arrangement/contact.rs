//! Exact contact of two triangles, and its points.
//!
//! Two triangles in different planes meet in nothing, a point or a segment. Its ends are corners of one that lie in the
//! other, or places where an edge of one goes through the other; which of these they are is decided by the signs of
//! determinants of the corners alone, so that no place has to be computed. Triangles in one plane are not taken apart
//! here: that they meet is all that is said.

use glam::{DVec2, DVec3};
use ravec_mesh::{OrientedPlane, Sign, orient2d, orient3d};

use super::soup::Facet;

/// A point where triangles meet, by what it is made of. One place may have several such names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum Crossing {
    /// A vertex.
    Vertex(u32),
    /// An edge and another edge, the lower vertex of each and the lower edge first.
    Edges([u32; 2], [u32; 2]),
    /// An edge goes through the inside of a triangle.
    EdgeTriangle([u32; 2], u32),
}

/// Contact of two triangles beyond the corners and edges that they share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Contact {
    /// They lie in one plane and meet there.
    Coplanar,
    /// They meet in a single point.
    Point(Crossing),
    /// They meet in a segment.
    Segment(Crossing, Crossing),
}

/// The points found so far: two at most, if the signs are right.
#[derive(Default)]
struct Ends {
    found: [Option<Crossing>; 2],
}

impl Ends {
    fn add(&mut self, crossing: Crossing) {
        if self.found[0] == Some(crossing) {
            return;
        }
        if self.found[0].is_none() {
            self.found[0] = Some(crossing);
        } else {
            debug_assert!(
                self.found[1].is_none() || self.found[1] == Some(crossing),
                "two triangles in different planes meet in a segment at most"
            );
            self.found[1] = Some(crossing);
        }
    }
}

fn edge(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Returns `true` if all signs of corners that are not shared are the same and not zero.
fn strictly_apart(signs: [Sign; 3], shared: [bool; 3]) -> bool {
    let mut own = signs
        .iter()
        .zip(shared)
        .filter(|(_, s)| !s)
        .map(|(&s, _)| s);
    let first = own.next();
    first.is_none_or(|f| f != Sign::Zero && own.all(|s| s == f))
}

/// The rounding of the two products in [`are_clearly_apart`], relative to the product of the largest components of what goes
/// into them, which are differences of coordinates and a sum of such: 132 and 12 roundings of half an ulp. Smaller is wrong, larger
/// asks other tests more often.
const EDGE_FILTER: f64 = 2e-14;
const VERTEX_FILTER: f64 = 2e-15;

/// Products below this may have lost digits to underflow.
const TINY: f64 = 1e-290;

/// Returns `true` if two triangles that share one or two corners are seen at once to meet in nothing else. That holds
/// for nearly all neighbors, whether they lie in one plane or not.
fn are_clearly_apart(
    shared: usize,
    (p, shared_p): ([DVec3; 3], [bool; 3]),
    (q, shared_q): ([DVec3; 3], [bool; 3]),
) -> bool {
    let index = |shared: [bool; 3], is: bool| shared.iter().position(|&s| s == is).unwrap_or(0);
    let size = |v: DVec3| v.abs().max_element();
    match shared {
        // Seen from a corner, all of one is on one side of a plane, all of the other on the other side. The plane halves the
        // directions to their middles; any plane would do.
        1 => {
            let (i, j) = (index(shared_p, true), index(shared_q, true));
            let at = p[i];
            let [p, q] = [(p, i), (q, j)].map(|(t, i)| [1, 2].map(|k| t[(i + k) % 3] - at));
            let normal = (q[0] + q[1]) - (p[0] + p[1]);
            let limit = VERTEX_FILTER * size(normal);
            let height = |v: DVec3| (normal.dot(v), (limit * size(v)).max(TINY));
            p.into_iter().map(height).all(|(at, limit)| at < -limit)
                && q.into_iter().map(height).all(|(at, limit)| at > limit)
        }
        // Half-planes on either side of an edge would have one normal if they were one.
        2 => {
            let (i, j) = (index(shared_p, false), index(shared_q, false));
            let at = p[(i + 1) % 3];
            let edge = p[(i + 2) % 3] - at;
            let (p, q) = (p[i] - at, q[j] - at);
            let limit = EDGE_FILTER * (size(edge) * size(p)) * (size(edge) * size(q));
            edge.cross(p).dot(edge.cross(q)) < -limit.max(TINY)
        }
        _ => false,
    }
}

/// Returns `true` if a side of `p` at its shared corners parts two triangles as they are seen along the normal of `p`.
/// That holds for nearly all neighbors, and without asking how far they are from lying in one plane.
fn are_side_by_side(
    normal: DVec3,
    shared: usize,
    (p, shared_p): ([DVec3; 3], [bool; 3]),
    (q, shared_q): ([DVec3; 3], [bool; 3]),
) -> bool {
    if shared == 0 || shared == 3 {
        return false;
    }
    let n = normal.abs();
    let axis = (0..3).fold(0, |best, k| if n[k] > n[best] { k } else { best });
    let [a, b, c] = p.map(|p| flat(p, axis));
    let turn = orient2d(a, b, c);
    turn != Sign::Zero
        && (0..3).any(|i| {
            let j = (i + 1) % 3;
            // all shared corners are ends of this side, so that the other triangle is beyond it but for these
            let ends = usize::from(shared_p[i]) + usize::from(shared_p[j]);
            let (from, to) = ([a, b, c][i], [a, b, c][j]);
            ends == shared
                && (0..3).all(|k| shared_q[k] || orient2d(from, to, flat(q[k], axis)) == -turn)
        })
}

/// The contact of two triangles; `None` if they share at most corners and an edge.
pub(crate) fn contact(a: &Facet, b: &Facet) -> Option<Contact> {
    let (s, t) = (a.vertices, b.vertices);
    let shared_s = s.map(|v| t.contains(&v));
    let shared_t = t.map(|v| s.contains(&v));
    let shared = shared_s.iter().filter(|&&s| s).count();
    let (p, q) = (a.corners, b.corners);
    if are_clearly_apart(shared, (p, shared_s), (q, shared_t)) {
        return None;
    }
    let plane = OrientedPlane::through(p[0], p[1], p[2]);
    if are_side_by_side(plane.normal(), shared, (p, shared_s), (q, shared_t)) {
        return None;
    }
    let sides_of_t: [Sign; 3] = std::array::from_fn(|i| {
        if shared_t[i] {
            Sign::Zero
        } else {
            plane.side(q[i])
        }
    });
    if shared == 3 {
        return Some(Contact::Coplanar);
    }
    if strictly_apart(sides_of_t, shared_t) {
        return None;
    }
    if sides_of_t == [Sign::Zero; 3] {
        return overlap(a, b).then_some(Contact::Coplanar);
    }
    let plane = OrientedPlane::through(q[0], q[1], q[2]);
    let sides_of_s: [Sign; 3] = std::array::from_fn(|i| {
        if shared_s[i] {
            Sign::Zero
        } else {
            plane.side(p[i])
        }
    });
    if strictly_apart(sides_of_s, shared_s) {
        return None;
    }
    let mut ends = Ends::default();
    gather(a, b, sides_of_s, shared_s, &mut ends);
    gather(b, a, sides_of_t, shared_t, &mut ends);
    match ends.found {
        [Some(first), Some(second)] => Some(Contact::Segment(first.min(second), first.max(second))),
        [Some(Crossing::Vertex(v)), None] if s.contains(&v) && t.contains(&v) => None,
        [Some(only), None] => Some(Contact::Point(only)),
        _ => None,
    }
}

/// The points of the border of `a` that lie in `b`, given on which sides of the plane of `b` the corners of `a` are.
fn gather(a: &Facet, b: &Facet, sides: [Sign; 3], shared: [bool; 3], ends: &mut Ends) {
    let (s, t) = (a.vertices, b.vertices);
    let (p, q) = (a.corners, b.corners);
    for i in 0..3 {
        if sides[i] == Sign::Zero && (shared[i] || holds(q, p[i])) {
            ends.add(Crossing::Vertex(s[i]));
        }
        let j = (i + 1) % 3;
        if sides[i] == Sign::Zero || sides[j] != -sides[i] {
            continue;
        }
        let around: [Sign; 3] = std::array::from_fn(|k| orient3d(p[i], p[j], q[k], q[(k + 1) % 3]));
        if around.contains(&Sign::Positive) && around.contains(&Sign::Negative) {
            continue;
        }
        let e = edge(s[i], s[j]);
        let zero = |k: usize| around[k] == Sign::Zero;
        ends.add(match [zero(0), zero(1), zero(2)] {
            [false, false, false] => Crossing::EdgeTriangle(e, b.triangle),
            [true, true, _] => Crossing::Vertex(t[1]),
            [_, true, true] => Crossing::Vertex(t[2]),
            [true, _, true] => Crossing::Vertex(t[0]),
            [true, ..] => edges(e, edge(t[0], t[1])),
            [_, true, _] => edges(e, edge(t[1], t[2])),
            [_, _, true] => edges(e, edge(t[2], t[0])),
        });
    }
}

fn edges(e: [u32; 2], f: [u32; 2]) -> Crossing {
    Crossing::Edges(e.min(f), e.max(f))
}

/// The axis along which most of a triangle is seen, exactly not edge-on.
pub(crate) fn view([a, b, c]: [DVec3; 3]) -> usize {
    let n = (b - a).cross(c - a).abs();
    let mut axes = [0, 1, 2];
    axes.sort_by(|&i, &j| n[j].total_cmp(&n[i]));
    axes.into_iter()
        .find(|&k| orient2d(flat(a, k), flat(b, k), flat(c, k)) != Sign::Zero)
        .unwrap_or(axes[0])
}

/// A place as seen against `axis`.
pub(crate) fn flat(p: DVec3, axis: usize) -> DVec2 {
    DVec2::new(p[(axis + 1) % 3], p[(axis + 2) % 3])
}

/// Returns `true` if a point of the plane of a triangle is in the triangle or on its border.
fn holds(triangle: [DVec3; 3], point: DVec3) -> bool {
    let axis = view(triangle);
    let [a, b, c] = triangle.map(|p| flat(p, axis));
    let p = flat(point, axis);
    let signs = [orient2d(a, b, p), orient2d(b, c, p), orient2d(c, a, p)];
    !(signs.contains(&Sign::Positive) && signs.contains(&Sign::Negative))
}

/// Returns `true` if two triangles in one plane meet in more than the corners and the edge that they share.
fn overlap(a: &Facet, b: &Facet) -> bool {
    let (mut s, mut t) = (a.vertices, b.vertices);
    let axis = view(a.corners);
    let at = |v: u32| {
        let named = |f: &Facet| f.vertices.iter().position(|&w| w == v);
        let place = named(a).map_or_else(|| named(b).map(|i| b.corners[i]), |i| Some(a.corners[i]));
        flat(place.expect("asked of corners alone"), axis)
    };
    for corners in [&mut s, &mut t] {
        if orient2d(at(corners[0]), at(corners[1]), at(corners[2])) == Sign::Negative {
            corners.swap(1, 2);
        }
    }
    // Convex shapes are apart where an edge of one has all of the other on its outside. Points of contact on that edge
    // must then be shared: the other's corners on the edge's line.
    for (s, t) in [(s, t), (t, s)] {
        for i in 0..3 {
            let (u, v) = (s[i], s[(i + 1) % 3]);
            let sides = t.map(|w| {
                if w == u || w == v {
                    Sign::Zero
                } else {
                    orient2d(at(u), at(v), at(w))
                }
            });
            if sides.contains(&Sign::Positive) {
                continue;
            }
            let on: Vec<u32> = (0..3)
                .filter(|&k| sides[k] == Sign::Zero)
                .map(|k| t[k])
                .collect();
            return match on[..] {
                [w] => w != u && w != v && between(at(u), at(v), at(w)),
                [w, x] => {
                    let same = (w == u && x == v) || (w == v && x == u);
                    !same && segments_touch_beyond(&at, [u, v], [w, x])
                }
                _ => false,
            };
        }
    }
    true
}

/// Returns `true` if `w`, which is on the line through `u` and `v`, is between them.
fn between(u: DVec2, v: DVec2, w: DVec2) -> bool {
    let (low, high) = (u.min(v), u.max(v));
    w.cmpge(low).all() && w.cmple(high).all()
}

/// Returns `true` if two segments on one line that are not the same meet in more than an end that they share.
fn segments_touch_beyond(at: &impl Fn(u32) -> DVec2, [u, v]: [u32; 2], [w, x]: [u32; 2]) -> bool {
    let strange = |p: u32, [q, r]: [u32; 2]| p != q && p != r && between(at(q), at(r), at(p));
    strange(w, [u, v]) || strange(x, [u, v]) || strange(u, [w, x]) || strange(v, [w, x])
}

#[cfg(test)]
mod tests {
    use super::super::soup::Soup;
    use super::*;
    use crate::closing::Closing;
    use proptest::prelude::*;
    use ravec_mesh::{TriMesh, TriTri, intersection};
    use ravec_progress::Progress;

    fn soup(corners: [[i32; 3]; 6]) -> Soup {
        let positions = corners
            .map(|c| DVec3::from_array(c.map(f64::from)))
            .to_vec();
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [3, 4, 5]]).unwrap();
        Soup::of(&[&mesh], &[Closing::default()], &[], &Progress::none()).unwrap()
    }

    /// The contact of triangles `a` and `b` of a soup.
    fn met(soup: &Soup, a: u32, b: u32) -> Option<Contact> {
        let [a, b] = [a, b].map(|triangle| Facet {
            triangle,
            vertices: soup.triangles[triangle as usize],
            corners: soup.corners(triangle),
        });
        contact(&a, &b)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn contacts_are_found_where_triangles_meet(corners in prop::array::uniform6([0_i32..4, 0_i32..4, 0_i32..4])) {
            let soup = soup(corners);
            // flat ones are left out
            if soup.triangles.len() < 2 {
                return Ok(());
            }
            let found = met(&soup, 0, 1);
            let kind = intersection(&soup.corners(0), &soup.corners(1));
            match kind {
                TriTri::Disjoint | TriTri::Neighbors => prop_assert_eq!(found, None),
                TriTri::CoplanarOverlap | TriTri::Same => prop_assert_eq!(found, Some(Contact::Coplanar)),
                TriTri::Crossing | TriTri::Touch => prop_assert!(found.is_some()),
            }
            // the same in any order
            prop_assert_eq!(found.is_some(), met(&soup, 1, 0).is_some());
        }
    }

    #[test]
    fn the_ends_of_a_segment_have_their_names() {
        // a floor and a blade that goes through it and stands out over one edge
        let soup = soup([
            [0, 0, 0],
            [4, 0, 0],
            [0, 4, 0],
            [1, 1, -1],
            [1, 1, 1],
            [1, -9, 0],
        ]);
        let found = met(&soup, 0, 1);
        let expected = Contact::Segment(
            Crossing::EdgeTriangle([0, 1], 1),
            Crossing::EdgeTriangle([3, 4], 0),
        );
        assert_eq!(found, Some(expected));
    }
}
