//! The triangles in a box, in a ball and along a ray.

use std::array;

use arrayvec::ArrayVec;
use fearless_simd::{dispatch, prelude::*};
use glam::{DVec2, DVec3};

use super::node::{Boxes, Child, Children, STACK, WIDTH, lanes};
use super::{BoxTree, Bvh};
use crate::closest::{closest_on_triangle, distance_sq_to_triangle};
use crate::{Aabb, Sign, orient2d, triangle_distance_sq};

/// A place where a line meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// The triangle that is met.
    pub triangle: u32,
    /// Parameter along the ray: the place is `origin + t * direction`, with a relative error of a few roundings unless
    /// the ray is nearly parallel to the triangle.
    pub t: f64,
    /// `true` if the ray goes through from the back to the front: the way the normal points.
    pub outward: bool,
}

/// Number of slabs that are tried between two triangles before their distance is computed, which costs more than all of
/// them.
const SLABS: usize = 3;

impl BoxTree {
    /// Calls `visit` with each triangle whose box touches `bounds`, in no particular order.
    pub fn for_each_touching(&self, bounds: &Aabb, mut visit: impl FnMut(u32)) {
        if bounds.is_empty() {
            return;
        }
        let local = self.frame.local_box(bounds.min, bounds.max);
        self.descend(
            |at| {
                let node = &self.nodes[at];
                (&node.children, node.boxes.touching(&local))
            },
            |slot| {
                if Aabb::around(self.corners[slot as usize]).touches(bounds) {
                    visit(self.triangle_of[slot as usize]);
                }
            },
        );
    }

    /// Calls `visit` with the slots of all leaves whose boxes, and those above them, pass `test`: what the node of an index
    /// holds, and a bit for each lane of it that is looked into.
    #[inline(always)]
    fn descend<'a>(&self, test: impl Fn(usize) -> (&'a Children, u32), mut visit: impl FnMut(u32)) {
        self.any(test, |slot| {
            visit(slot);
            false
        });
    }

    /// As [`Self::descend`] until `visit` is true for a slot; whether that happened.
    #[inline(always)]
    fn any<'a>(
        &self,
        test: impl Fn(usize) -> (&'a Children, u32),
        visit: impl FnMut(u32) -> bool,
    ) -> bool {
        !self.is_empty() && any(test, visit)
    }
}

/// Calls `visit` with the slots of all leaves of a tree whose boxes, and those above them, pass `test`, until it is true for one;
/// whether that happened. There must be a root.
#[inline(always)]
pub(super) fn any<'a>(
    test: impl Fn(usize) -> (&'a Children, u32),
    mut visit: impl FnMut(u32) -> bool,
) -> bool {
    let mut stack = ArrayVec::<u32, STACK>::new();
    stack.push(0);
    while let Some(node) = stack.pop() {
        let (children, passes) = test(node as usize);
        for lane in lanes(passes & children.mask()) {
            match children.get(lane) {
                Child::Node(child) => stack.push(child),
                Child::Leaf { first, count } => {
                    if (first..first + count).any(&mut visit) {
                        return true;
                    }
                }
            }
        }
    }
    false
}

impl Bvh {
    /// Calls `visit` with each triangle that is no farther than `max_distance` from `p`, and its squared distance, in no
    /// particular order. There are none if either is not a number, or `p` is not finite.
    pub fn for_each_within(&self, p: DVec3, max_distance: f64, mut visit: impl FnMut(u32, f64)) {
        if !p.is_finite() || max_distance.is_nan() || max_distance < 0.0 {
            return;
        }
        let local = self.frame.local_point(p);
        let max_sq = max_distance * max_distance;
        let reach_sq = self.frame.reach_sq(&local, max_sq);
        dispatch!(self.vectors, simd => self.descend(
            #[inline(always)]
            |at| {
                let node = &self.turned[at];
                let near = node.distances_sq(simd, local.at).simd_le(reach_sq);
                (&node.children, near.to_bitmask() as u32)
            },
            #[inline(always)]
            |slot| {
                let distance_sq = distance_sq_to_triangle(p, &self.corners[slot as usize]);
                if distance_sq <= max_sq {
                    visit(self.triangle_of[slot as usize], distance_sq);
                }
            },
        ));
    }

    /// Returns `true` if any triangle comes closer to the given one than `distance`, by its exact distance.
    ///
    /// Fast where the answer is no and the given triangle is small, or parallel to what is near.
    pub fn comes_within(&self, facet: [DVec3; 3], distance: f64) -> bool {
        let middle = (facet[0] + facet[1] + facet[2]) / 3.0;
        let radius = facet
            .iter()
            .map(|&corner| corner.distance(middle))
            .fold(0.0, f64::max);
        let reach = distance + radius;
        if !(reach.is_finite() && middle.is_finite()) || distance <= 0.0 {
            return false;
        }
        let local = facet.map(|corner| self.frame.local_point(corner));
        let slack = local.iter().map(|point| point.slack).fold(0.0, f64::max)
            + self.frame.turned_slack(2.0 * radius);
        let reach_sq = self.frame.widened_sq(distance, slack);
        let local = local.map(|point| point.at);
        // most often the slab that parts one triangle from the facet parts the next one, too, and the first lies along it
        let mut slab = Slab::new((facet[1] - facet[0]).cross(facet[2] - facet[0]), facet);
        dispatch!(self.vectors, simd => self.any(
            #[inline(always)]
            |at| {
                let node = &self.turned[at];
                let near = node.distances_sq_to(simd, local).simd_le(reach_sq);
                (&node.children, near.to_bitmask() as u32)
            },
            #[inline(always)]
            |slot| {
                let corners = &self.corners[slot as usize];
                if slab.is_beside(corners, distance) {
                    return false;
                }
                let nearest = closest_on_triangle(middle, corners);
                if nearest.distance_sq >= reach * reach {
                    return false;
                }
                let (mut above, mut below) = (middle, nearest.point);
                for _ in 0..SLABS {
                    let other = Slab::new(above - below, facet);
                    if other.is_beside(corners, distance) {
                        slab = other;
                        return false;
                    }
                    let nearest = closest_on_triangle(below, &facet);
                    if nearest.distance_sq < distance * distance {
                        return true;
                    }
                    above = nearest.point;
                    below = closest_on_triangle(above, corners).point;
                }
                triangle_distance_sq(facet, *corners) < distance * distance
            },
        ))
    }

    /// The triangles that the ray from `origin` along `direction` goes through, in the order of the ray; equally far ones
    /// by index. The length of `direction` is the unit of `t`.
    ///
    /// A ray through an edge or a corner meets as many triangles as one beside it. So it meets a closed surface an even
    /// number of times if it starts outside, and an odd number of times if it starts in a solid. Triangles that lie along
    /// the ray, or without area, are not met. None are met if `direction` is zero, or anything is not finite.
    pub fn ray_hits(&self, origin: DVec3, direction: DVec3) -> Vec<RayHit> {
        let mut hits = Vec::new();
        self.for_each_hit(origin, direction, |hit| hits.push(hit));
        hits.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.triangle.cmp(&b.triangle)));
        hits
    }

    /// Winding number of the triangles around `origin`, counted along a ray from there, whose `direction` does not
    /// matter for closed and oriented meshes: the number of triangles it leaves through, less those it enters through.
    /// Of these meshes it is the winding number, and exact; of others it says nothing. 0 where [`Self::ray_hits`] meets
    /// none.
    pub fn ray_turns(&self, origin: DVec3, direction: DVec3) -> i32 {
        let mut turns = 0;
        self.for_each_hit(origin, direction, |hit| {
            turns += if hit.outward { 1 } else { -1 };
        });
        turns
    }

    #[inline]
    fn for_each_hit(&self, origin: DVec3, direction: DVec3, mut visit: impl FnMut(RayHit)) {
        let longest = direction.abs().max_element();
        if !(origin.is_finite() && longest > 0.0 && longest.is_finite()) {
            return;
        }
        let ray = Ray::new(origin, direction);
        let (from, along) = (self.frame.to_local(origin), direction / longest);
        // The error of the slabs' arithmetic, in double precision, is some 1e-16 of the farthest coordinate.
        let slack = 1e-14 * (4.0 + from.abs().max_element());
        self.descend(
            |at| {
                let node = &self.nodes[at];
                (&node.children, meeting(&node.boxes, from, along, slack))
            },
            |slot| {
                if let Some((t, outward)) = ray.meets(self.corners[slot as usize]) {
                    visit(RayHit {
                        triangle: self.triangle_of[slot as usize],
                        t,
                        outward,
                    });
                }
            },
        );
    }
}

/// The space beside a triangle and across a direction: what lies below or above it is at least that far from the triangle.
#[derive(Debug, Clone, Copy)]
struct Slab {
    /// A unit vector, or zero.
    across: DVec3,
    /// A corner of the triangle, and what it reaches along the direction from there.
    origin: DVec3,
    lowest: f64,
    highest: f64,
}

impl Slab {
    #[inline]
    fn new(across: DVec3, triangle: [DVec3; 3]) -> Self {
        let (across, origin) = (across.normalize_or_zero(), triangle[0]);
        let [_, b, c] = triangle.map(|corner| across.dot(corner - origin));
        Self {
            across,
            origin,
            lowest: b.min(c).min(0.0),
            highest: b.max(c).max(0.0),
        }
    }

    /// Returns `true` if this is enough to see that another triangle is no nearer than a distance above zero.
    #[inline]
    fn is_beside(&self, other: &[DVec3; 3], distance: f64) -> bool {
        let [a, b, c] = other.map(|corner| self.across.dot(corner - self.origin));
        self.lowest - a.max(b).max(c) >= distance || a.min(b).min(c) - self.highest >= distance
    }
}

/// The boxes that a ray in the local frame meets, when they are grown by `slack`. The largest component of `along` is
/// 1.
#[inline]
fn meeting(boxes: &Boxes, from: DVec3, along: DVec3, slack: f64) -> u32 {
    let mut enter = [0.0_f64; WIDTH];
    let mut leave = [f64::INFINITY; WIDTH];
    for axis in 0..3 {
        let (from, along) = (from[axis], along[axis]);
        // Below this the ray drifts by less than the slack on its way through the mesh.
        let drifts = along.abs() > 1e-20;
        let per_along = 1.0 / along;
        for lane in 0..WIDTH {
            let bounds = boxes.get(lane);
            let low = f64::from(bounds.min[axis]) - slack - from;
            let high = f64::from(bounds.max[axis]) + slack - from;
            if drifts {
                let (first, second) = (low * per_along, high * per_along);
                enter[lane] = enter[lane].max(first.min(second));
                leave[lane] = leave[lane].min(first.max(second));
            } else if low > 0.0 || high < 0.0 {
                leave[lane] = -1.0;
            }
        }
    }
    let meets: [u32; WIDTH] = array::from_fn(|lane| u32::from(enter[lane] <= leave[lane]) << lane);
    meets.into_iter().sum()
}

/// A ray, and the projection along it.
///
/// Source: Woop, Benthin and Wald, *Watertight Ray/Triangle Intersection*, 2013. Corners are sheared so that the ray is
/// the third axis, and the triangle is met if the origin is inside its projection. The projection of a corner depends
/// on nothing but its place, so that neighbors agree on their common edge. We differ in: signs in the projection are
/// exact, and an origin on the border counts as moved by less than anything to the right, and by less than that upward.
struct Ray {
    origin: DVec3,
    /// The axes in the order of the sheared coordinates; the last one is the longest of the direction.
    axes: [usize; 3],
    /// Shear of the first two coordinates for each unit of the third.
    shear: DVec2,
    /// The direction along the third axis.
    length: f64,
}

impl Ray {
    fn new(origin: DVec3, direction: DVec3) -> Self {
        let size = direction.abs();
        let z = if size.x >= size.y && size.x >= size.z {
            0
        } else {
            1 + usize::from(size.z > size.y)
        };
        let mut axes = [(z + 1) % 3, (z + 2) % 3, z];
        // Keeps the sense of rotation as seen along the ray.
        if direction[z] < 0.0 {
            axes.swap(0, 1);
        }
        let length = direction[z];
        Self {
            origin,
            axes,
            shear: DVec2::new(direction[axes[0]], direction[axes[1]]) / length,
            length,
        }
    }

    /// Parameter at which the triangle is met, and `true` if from its back.
    #[inline]
    fn meets(&self, corners: [DVec3; 3]) -> Option<(f64, bool)> {
        let offsets = corners.map(|corner| {
            let offset = corner - self.origin;
            let [x, y, z] = self.axes.map(|axis| offset[axis]);
            (DVec2::new(x, y) - self.shear * z, z)
        });
        let [(a, az), (b, bz), (c, cz)] = offsets;
        let side = side_of_origin(a, b);
        if side == Sign::Zero || side_of_origin(b, c) != side || side_of_origin(c, a) != side {
            return None;
        }
        let weights = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
        let depth = (weights[0] * az + weights[1] * bz + weights[2] * cz)
            / (weights[0] + weights[1] + weights[2]);
        // Rounding must not carry the place out of the triangle, nor make it no number.
        let depth = depth.max(az.min(bz).min(cz)).min(az.max(bz).max(cz));
        let t = depth / self.length;
        (t >= 0.0).then_some((t, side == Sign::Positive))
    }
}

/// The side of the line from `a` to `b` on which the origin lies, moved as described above; zero if both are one.
#[inline]
fn side_of_origin(a: DVec2, b: DVec2) -> Sign {
    match orient2d(a, b, DVec2::ZERO) {
        Sign::Zero if a.y != b.y => Sign::of(a.y - b.y),
        Sign::Zero => Sign::of(b.x - a.x),
        sign => sign,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TriMesh;
    use crate::bvh::tests::soup;
    use proptest::prelude::*;

    fn triangles(mesh: &TriMesh) -> impl Iterator<Item = (u32, [DVec3; 3])> {
        (0..mesh.triangles().len() as u32).map(|t| (t, mesh.corners(t)))
    }

    fn place() -> impl Strategy<Value = DVec3> {
        [-2.0..2.0, -2.0..2.0, -2.0..2.0].prop_map(DVec3::from_array)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn ranges_hold_what_a_scan_finds(mesh in soup(150), p in place(), size in place(), radius in 0.0..2.0_f64) {
            let bvh = Bvh::new(&mesh);
            let p = p + bvh.bounds().min.max(DVec3::ZERO);
            let bounds = Aabb::new(p.min(p + size), p.max(p + size));
            let mut found = Vec::new();
            bvh.for_each_touching(&bounds, |t| found.push(t));
            found.sort_unstable();
            let expected: Vec<u32> = triangles(&mesh)
                .filter(|(_, corners)| Aabb::around(*corners).touches(&bounds))
                .map(|(t, _)| t)
                .collect();
            prop_assert_eq!(found, expected);

            let mut found = Vec::new();
            bvh.for_each_within(p, radius, |t, distance_sq| found.push((t, distance_sq)));
            found.sort_unstable_by_key(|&(t, _)| t);
            let expected: Vec<(u32, f64)> = triangles(&mesh)
                .map(|(t, corners)| (t, distance_sq_to_triangle(p, &corners)))
                .filter(|&(_, distance_sq)| distance_sq <= radius * radius)
                .collect();
            prop_assert_eq!(found, expected);
        }

        #[test]
        fn what_comes_within_a_distance_is_found(mesh in soup(60), facet in [place(), place(), place()], size in prop_oneof![Just(0.01), Just(1.0), Just(1e3)], distance in 0.01..3.0f64) {
            let bvh = Bvh::new(&mesh);
            let facet = facet.map(|corner| bvh.bounds().min.max(DVec3::ZERO) + size * corner);
            let nearest = triangles(&mesh)
                .map(|(_, corners)| triangle_distance_sq(facet, corners))
                .fold(f64::INFINITY, f64::min)
                .sqrt();
            if (nearest - distance).abs() > 1e-9 {
                prop_assert_eq!(bvh.comes_within(facet, distance), nearest < distance);
            }
        }

        #[test]
        fn rays_meet_what_the_equations_of_planes_say(mesh in soup(150), p in place(), direction in place()) {
            let bvh = Bvh::new(&mesh);
            let p = p + bvh.bounds().min.max(DVec3::ZERO);
            let hits = bvh.ray_hits(p, direction);
            prop_assert!(hits.is_sorted_by(|a, b| a.t <= b.t));
            for (t, [a, b, c]) in triangles(&mesh) {
                let hit = hits.iter().find(|hit| hit.triangle == t);
                // Depth at which the ray passes inside, as the least of three volumes, in units of the triangle's size.
                let volume = |from: DVec3, to: DVec3| direction.dot((from - p).cross(to - p));
                let volumes = [volume(a, b), volume(b, c), volume(c, a)];
                let normal = (b - a).cross(c - a);
                let t = (a - p).dot(normal) / direction.dot(normal);
                let inside = volumes.iter().all(|&v| v > 1e-7) || volumes.iter().all(|&v| v < -1e-7);
                let outside = volumes.iter().any(|&v| v > 1e-7) && volumes.iter().any(|&v| v < -1e-7);
                if inside && t > 1e-6 {
                    let hit = hit.expect("met");
                    prop_assert!((hit.t - t).abs() <= 1e-6 * (1.0 + t), "{} for {t}", hit.t);
                    prop_assert_eq!(hit.outward, direction.dot(normal) > 0.0);
                } else if outside || t < -1e-6 {
                    prop_assert!(hit.is_none());
                }
            }
        }
    }

    #[test]
    fn rays_through_edges_and_corners_of_a_box_leave_it_once() {
        let positions: Vec<DVec3> = (0..8)
            .map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)))
            .collect();
        let quads = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let triangles = quads
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect();
        let bvh = Bvh::new(&TriMesh::new(positions, triangles).unwrap());
        let center = DVec3::splat(0.5);
        for i in 0..125 {
            let to = DVec3::new(
                f64::from(i % 5) - 2.0,
                f64::from(i / 5 % 5) - 2.0,
                f64::from(i / 25) - 2.0,
            );
            let from_inside = bvh.ray_hits(center, to);
            let from_outside = bvh.ray_hits(center - 4.0 * to, to);
            assert_eq!(bvh.ray_turns(center - 4.0 * to, to), 0, "{to}");
            if to == DVec3::ZERO {
                assert!(from_inside.is_empty());
            } else {
                assert_eq!(bvh.ray_turns(center, to), 1, "{to}");
                let reach = 0.5 / to.abs().max_element();
                assert_eq!(from_inside.len(), 1, "{to}");
                assert!(from_inside[0].outward);
                assert!((from_inside[0].t - reach).abs() < 1e-15);
                assert_eq!(from_outside.len(), 2, "{to}");
                assert!(!from_outside[0].outward && from_outside[1].outward);
            }
        }
    }

    #[test]
    fn what_is_not_a_place_meets_nothing() {
        let mesh = TriMesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]]).unwrap();
        let bvh = Bvh::new(&mesh);
        let nan = DVec3::new(0.0, f64::NAN, 0.0);
        assert!(bvh.ray_hits(nan, DVec3::X).is_empty());
        assert!(bvh.ray_hits(DVec3::ZERO, nan).is_empty());
        assert!(bvh.ray_hits(DVec3::ZERO, DVec3::INFINITY).is_empty());
        bvh.for_each_within(nan, 1.0, |_, _| panic!("no place"));
        bvh.for_each_within(DVec3::ZERO, -1.0, |_, _| panic!("no ball"));
        bvh.for_each_touching(&Aabb::EMPTY, |_| panic!("no box"));
    }
}
