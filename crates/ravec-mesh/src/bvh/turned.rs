//! Boxes that are turned to the surface.
//!
//! A box along the axes around a patch of a surface at a slant is mostly empty, and its nearest corner is nearer to a point
//! than the patch by about half the patch's size. From a point at a distance of many triangles all boxes around its foot
//! thus look nearer than what they hold, dozens of them. A box with one side along the patch is a plate, as thick as the
//! patch is curved, and the distance to it is nearly that to the patch.
//!
//! The plain idea: each node has axes of its own, one of them the mean normal of the triangles below it, along which the
//! boxes of its children are measured as others are. The departures from it:
//!
//! 1. The axes across the normal follow the longest edge or one of the common axes, whichever makes the boxes the smallest;
//!    and if the common axes make them smaller still, as for a heap of triangles, these are kept.
//! 2. That is decided on a sample of the triangles.
//! 3. A node of more than [`FLAT`] triangles keeps the common axes: it is rarely flat.
//!
//! Guarantees: no distance to a box exceeds that to its content by more than [`Frame::widened_sq`] allows for, whatever
//! the triangles: needles, points, or all of them different.
//! Cost: 288 bytes a node; building 0.2 µs a triangle and core; 18 operations a node visited.
//!
//! [`Frame::widened_sq`]: super::frame::Frame::widened_sq

use std::ops::Range;

use fearless_simd::{f32x8, prelude::*};
use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use super::frame::{Frame, LocalBox};
use super::node::{Boxes, Child, Children, Node, WIDTH};

/// Most triangles below a node that has axes of its own. Beyond that nothing is gained.
const FLAT: usize = 512;

/// Triangles of a node by which axes are compared.
const SAMPLE: usize = 32;

/// The share of its extent by which a box is grown, against what a point is off after it was turned in `f32`.
///
/// An offset q from the center is turned with an error below 2.6e-7 |q| along each axis: a rounding of each coordinate, one
/// of each product and two of the sum. |q| is at most the distance from the box and √3 times its extent. The latter makes
/// 4.5e-7 of the extent, to be covered here; the former is left to [`Frame::widened_sq`]. The corners of a triangle may be
/// farther by its size: [`Frame::turned_slack`].
pub(super) const GROWTH: f64 = 1e-6;

/// Error bound of double precision at a size of about 1: some 1e-16.
const EXACT: f64 = 1e-14;

/// The extent of the local frame.
const LOCAL_EXTENT: f64 = 2.0;

/// A node with boxes along axes of its own.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub(super) struct TurnedNode {
    boxes: Boxes,
    pub children: Children,
    turn: Turn,
}

/// A change of axes.
#[derive(Debug, Clone, Copy)]
struct Turn {
    /// Unit vectors at right angles, but for their rounding.
    axes: [[f32; 3]; 3],
    /// The origin, in the local frame.
    center: [f32; 3],
}

impl TurnedNode {
    /// The squared distance from a point in the local frame to each box; infinite where there is none.
    #[inline(always)]
    pub fn distances_sq<S: Simd>(&self, simd: S, at: [f32; 3]) -> f32x8<S> {
        self.boxes.distances_sq(simd, self.turn.apply(at))
    }

    /// The squared distance from the smallest box around a triangle in the local frame to each box; infinite where there
    /// is none.
    #[inline(always)]
    pub fn distances_sq_to<S: Simd>(&self, simd: S, triangle: [[f32; 3]; 3]) -> f32x8<S> {
        let [a, b, c] = triangle.map(|corner| self.turn.apply(corner));
        let min = [0, 1, 2].map(|axis| a[axis].min(b[axis]).min(c[axis]));
        let max = [0, 1, 2].map(|axis| a[axis].max(b[axis]).max(c[axis]));
        self.boxes.distances_sq_to(simd, &LocalBox { min, max })
    }

    /// The twin of a node along the axes of the local frame.
    fn straight(node: &Node) -> Self {
        let growth = GROWTH * LOCAL_EXTENT;
        let mut boxes = Boxes::EMPTY;
        for lane in 0..node.len() {
            let LocalBox { min, max } = node.boxes.get(lane);
            let low = DVec3::from_array(min.map(f64::from)) - growth;
            let high = DVec3::from_array(max.map(f64::from)) + growth;
            boxes.set(lane, &LocalBox::around(low, high));
        }
        Self {
            boxes,
            children: node.children,
            turn: Turn {
                axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                center: [0.0; 3],
            },
        }
    }

    /// The twin of a node along the axes that fit best; `triangles` are in the local frame, those of its children in
    /// `ranges`.
    fn fitted(node: &Node, triangles: &[[DVec3; 3]], ranges: &[Range<usize>]) -> Self {
        let (low, high) = span(triangles.iter().flatten().copied());
        let center = (0.5 * (low + high)).to_array().map(|x| x as f32);
        let step = triangles.len().div_ceil(SAMPLE);
        let sampled_area = |turn: &Turn| -> f64 {
            let boxes = turn.spans(triangles, ranges, step);
            boxes
                .map(|(low, high)| {
                    let size = high - low;
                    size.x * size.y + size.y * size.z + size.z * size.x
                })
                .sum()
        };
        let normal = mean_normal(triangles);
        let along = [longest_edge(triangles), DVec3::X, DVec3::Y, DVec3::Z];
        let mut turn = Turn::new([DVec3::X, DVec3::Y, DVec3::Z], center);
        let mut least = sampled_area(&turn);
        for along in along {
            let Some(axes) = normal.and_then(|normal| axes(normal, along)) else {
                continue;
            };
            let other = Turn::new(axes, center);
            let area = sampled_area(&other);
            if area < least {
                (turn, least) = (other, area);
            }
        }
        let mut spans = [(DVec3::ZERO, DVec3::ZERO); WIDTH];
        let mut extent = 0.0_f64;
        for (span, (low, high)) in spans.iter_mut().zip(turn.spans(triangles, ranges, 1)) {
            *span = (low, high);
            extent = extent.max(low.abs().max(high.abs()).max_element());
        }
        let growth = GROWTH * extent + EXACT;
        let mut boxes = Boxes::EMPTY;
        for (lane, &(low, high)) in spans[..ranges.len()].iter().enumerate() {
            boxes.set(lane, &LocalBox::around(low - growth, high + growth));
        }
        Self {
            boxes,
            children: node.children,
            turn,
        }
    }
}

impl Turn {
    fn new(axes: [DVec3; 3], center: [f32; 3]) -> Self {
        Self {
            axes: axes.map(|axis| axis.to_array().map(|x| x as f32)),
            center,
        }
    }

    #[inline(always)]
    fn apply(&self, at: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = at;
        let (x, y, z) = (x - self.center[0], y - self.center[1], z - self.center[2]);
        let along = |axis: [f32; 3]| axis[0] * x + axis[1] * y + axis[2] * z;
        [
            along(self.axes[0]),
            along(self.axes[1]),
            along(self.axes[2]),
        ]
    }

    /// The least and largest coordinates of the triangles of each range, or of each `step`-th.
    fn spans(
        &self,
        triangles: &[[DVec3; 3]],
        ranges: &[Range<usize>],
        step: usize,
    ) -> impl Iterator<Item = (DVec3, DVec3)> {
        let exact = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let ([x, y, z], center) = (self.axes.map(exact), exact(self.center));
        ranges.iter().map(move |range| {
            let corners = triangles[range.clone()].iter().step_by(step).flatten();
            span(corners.map(|&at| {
                let offset = at - center;
                DVec3::new(x.dot(offset), y.dot(offset), z.dot(offset))
            }))
        })
    }
}

/// The turned twins of `nodes`, whose leaves hold `corners` by slot.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub(super) fn turned(
    nodes: &[Node],
    frame: &Frame,
    corners: &[[DVec3; 3]],
    progress: &Progress,
) -> Result<Vec<TurnedNode>, Cancelled> {
    let slots = slots(nodes);
    (nodes, &slots)
        .into_par_iter()
        .map_init(Vec::new, |triangles, (node, below)| {
            progress.check()?;
            if below.len() > FLAT {
                return Ok(TurnedNode::straight(node));
            }
            triangles.clear();
            let corners = &corners[below.start as usize..below.end as usize];
            triangles.extend(
                corners
                    .iter()
                    .map(|triangle| triangle.map(|at| frame.to_local(at))),
            );
            let ranges: [Range<usize>; WIDTH] = std::array::from_fn(|lane| {
                if lane < node.len() {
                    let slots = slots_of(node.child(lane), &slots);
                    (slots.start - below.start) as usize..(slots.end - below.start) as usize
                } else {
                    0..0
                }
            });
            Ok(TurnedNode::fitted(node, triangles, &ranges[..node.len()]))
        })
        .collect()
}

/// For each node the slots below it.
pub(super) fn slots(nodes: &[Node]) -> Vec<Range<u32>> {
    let mut slots = vec![0..0; nodes.len()];
    // Children come after their parents, and are in the order of their slots.
    for (at, node) in nodes.iter().enumerate().rev() {
        let (first, last) = (node.child(0), node.child(node.len() - 1));
        slots[at] = slots_of(first, &slots).start..slots_of(last, &slots).end;
    }
    slots
}

/// The slots of a child, given those of the nodes.
fn slots_of(child: Child, slots: &[Range<u32>]) -> Range<u32> {
    match child {
        Child::Node(node) => slots[node as usize].clone(),
        Child::Leaf { first, count } => first..first + count,
    }
}

/// The least and largest coordinates.
#[inline]
fn span(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| {
        (low.min(at), high.max(at))
    })
}

/// The unit vector in which the sum of areas points, if there is any; the two sides of a thin sheet are one sheet.
fn mean_normal(triangles: &[[DVec3; 3]]) -> Option<DVec3> {
    let sum = triangles.iter().fold(DVec3::ZERO, |sum, [a, b, c]| {
        let area = (b - a).cross(c - a);
        if area.dot(sum) < 0.0 {
            sum - area
        } else {
            sum + area
        }
    });
    // Small triangles have areas whose squares underflow.
    (sum / sum.abs().max_element()).try_normalize()
}

fn longest_edge(triangles: &[[DVec3; 3]]) -> DVec3 {
    let edges = triangles.iter().flat_map(|[a, b, c]| [b - a, c - b, a - c]);
    edges.fold(DVec3::ZERO, |longest, edge| {
        if edge.length_squared() > longest.length_squared() {
            edge
        } else {
            longest
        }
    })
}

/// Axes at right angles: `along` as far as it is across `normal`, a unit vector, the one across both, and `normal`. `None`
/// where `along` is so close to `normal` that little but roundings would be left.
fn axes(normal: DVec3, along: DVec3) -> Option<[DVec3; 3]> {
    let across = along - along.dot(normal) * normal;
    let is_clear = across.length_squared() > 0.01 * along.length_squared();
    let first = across.try_normalize().filter(|_| is_clear)?;
    Some([first, normal.cross(first), normal])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::tests::soup;
    use crate::{Bvh, TriMesh, distance_sq_to_triangle, triangle_distance_sq};
    use fearless_simd::dispatch;
    use proptest::prelude::*;

    fn place() -> impl Strategy<Value = DVec3> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_map(DVec3::from_array)
    }

    /// Needles, caps, segments and points, some of them repeated, with a size and a place of all together.
    fn slivers() -> impl Strategy<Value = TriMesh> {
        let sliver = (place(), place(), -1.0..2.0_f64, place(), 0_i32..20).prop_map(
            |(a, b, share, off, flatness)| [a, b, a.lerp(b, share) + off * 10_f64.powi(-flatness)],
        );
        let point = place().prop_map(|at| [at; 3]);
        let segment = (place(), place()).prop_map(|(a, b)| [a, b, a]);
        let any = prop_oneof![4 => sliver, 1 => point, 1 => segment];
        let small = (place(), any.clone(), -6..0_i32)
            .prop_map(|(at, corners, size)| corners.map(|c| at + c * 10_f64.powi(size)));
        let repeated = (prop_oneof![any, small], 1..4_usize);
        let soup = prop::collection::vec(repeated, 1..60);
        (soup, -12..7_i32, prop_oneof![Just(0.0), Just(1e6)]).prop_map(|(soup, size, shift)| {
            let corners = soup
                .into_iter()
                .flat_map(|(corners, times)| std::iter::repeat_n(corners, times));
            let positions: Vec<DVec3> = corners
                .flatten()
                .map(|at| at * 10_f64.powi(size) + shift)
                .collect();
            let triangles = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
            TriMesh::new(positions, triangles.collect()).unwrap()
        })
    }

    /// The distance to a box, as it is compared, is no more than that to any of the triangles in it.
    fn assert_no_box_is_too_far(mesh: &TriMesh, at: DVec3, facet: [DVec3; 3]) {
        let bvh = Bvh::new(mesh);
        let size = bvh.bounds().size().max_element();
        let place = |at: DVec3| bvh.bounds().center() + at * size;
        let (p, facet) = (place(at), facet.map(place));
        let local = bvh.frame.local_point(p);
        let local_facet = facet.map(|corner| bvh.frame.local_point(corner));
        let facet_size = (facet[1] - facet[0])
            .length()
            .max((facet[2] - facet[0]).length());
        let slack = local_facet.iter().map(|c| c.slack).fold(0.0, f64::max)
            + bvh.frame.turned_slack(2.0 * facet_size);
        let slots = slots(&bvh.nodes);
        for (node, straight) in bvh.turned.iter().zip(&bvh.nodes) {
            let (distances_sq, facet_distances_sq): ([f32; WIDTH], [f32; WIDTH]) = dispatch!(bvh.vectors, simd => (
                node.distances_sq(simd, local.at).into(),
                node.distances_sq_to(simd, local_facet.map(|c| c.at)).into(),
            ));
            for lane in 0..straight.len() {
                for slot in slots_of(straight.child(lane), &slots) {
                    let corners = bvh.corners[slot as usize];
                    let exact_sq = distance_sq_to_triangle(p, &corners);
                    assert!(distances_sq[lane] <= bvh.frame.reach_sq(&local, exact_sq));
                    let exact = triangle_distance_sq(facet, corners).sqrt();
                    let reach_sq = bvh.frame.widened_sq(exact, slack);
                    assert!(facet_distances_sq[lane] <= reach_sq);
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        #[test]
        fn no_box_is_farther_than_its_triangles(
            mesh in prop_oneof![slivers(), soup(80)],
            at in place(),
            facet in [place(), place(), place()],
            facet_size in prop_oneof![Just(1e-4), Just(0.1), Just(1.0), Just(1e4)],
            far in prop_oneof![Just(0.0), Just(1e-3), Just(0.5), Just(2.0), Just(1e3), Just(1e9)],
        ) {
            if !mesh.triangles().is_empty() {
                assert_no_box_is_too_far(&mesh, at * far, facet.map(|corner| at * far + facet_size * corner));
            }
        }
    }

    #[test]
    fn a_slanted_plane_looks_as_far_as_it_is() {
        let (along, up) = (
            DVec3::new(1.0, 1.0, 0.0).normalize(),
            DVec3::new(-1.0, 1.0, 3.0).normalize(),
        );
        let at = |i: u32, j: u32| f64::from(i) * along + f64::from(j) * up;
        let positions = (0..16).flat_map(|j| (0..16).map(move |i| at(i, j)));
        let triangles = (0..15)
            .flat_map(|j| (0..15).map(move |i| j * 16 + i))
            .flat_map(|first| {
                [
                    [first, first + 1, first + 16],
                    [first + 1, first + 17, first + 16],
                ]
            });
        let mesh = TriMesh::new(positions.collect(), triangles.collect()).unwrap();
        let bvh = Bvh::new(&mesh);
        let height = 3.0;
        let p = at(5, 5) + height * along.cross(up);
        let least = bvh.frame.widened_sq(height * (1.0 - 1e-4), 0.0);
        for node in &bvh.turned {
            let at = bvh.frame.local_point(p).at;
            let distances_sq: [f32; WIDTH] =
                dispatch!(bvh.vectors, simd => node.distances_sq(simd, at).into());
            assert!(distances_sq.iter().all(|&sq| sq >= least));
        }
    }
}
