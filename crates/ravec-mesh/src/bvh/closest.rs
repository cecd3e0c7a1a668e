//! The triangle closest to a point.

use glam::DVec3;

use super::Bvh;
use super::node::{Child, STACK, WIDTH, mask_of};
use crate::closest::{Feature, closest_on_triangle, distance_sq_to_triangle};

/// The place of a mesh that is closest to a given point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closest {
    /// The triangle it lies on; of equally close ones the one with the lowest index.
    pub triangle: u32,
    /// The place, rounded.
    pub point: DVec3,
    /// The part of that triangle it lies on.
    pub feature: Feature,
    /// The squared distance; more accurate than the distance to the rounded `point`.
    pub distance_sq: f64,
}

/// The best so far.
#[derive(Debug, Clone, Copy)]
pub(super) struct Best {
    pub distance_sq: f64,
    pub triangle: u32,
    pub slot: u32,
}

impl Best {
    /// Nothing found yet within the squared distance.
    pub const fn within(distance_sq: f64) -> Self {
        Self {
            distance_sq,
            triangle: u32::MAX,
            slot: u32::MAX,
        }
    }
}

/// Boxes that are still to be looked into.
///
/// An entry is one number: the bits of the squared distance, which for what is not negative are in the order of the values,
/// above the place of the box, its node times eight and its lane.
struct Stack {
    entries: [u64; STACK],
    len: usize,
}

impl Stack {
    #[inline]
    fn new() -> Self {
        Self {
            entries: [0; STACK],
            len: 0,
        }
    }

    /// Keeps the entries from `base` on sorted, the nearest last.
    #[inline]
    fn insert(&mut self, base: usize, distance_sq: f32, place: u32) {
        let entry = u64::from(distance_sq.to_bits()) << 32 | u64::from(place);
        let mut at = self.len;
        while at > base && self.entries[at - 1] < entry {
            self.entries[at] = self.entries[at - 1];
            at -= 1;
        }
        self.entries[at] = entry;
        self.len += 1;
    }

    #[inline]
    fn pop(&mut self) -> Option<(f32, u32)> {
        self.len = self.len.checked_sub(1)?;
        let entry = self.entries[self.len];
        Some((f32::from_bits((entry >> 32) as u32), entry as u32))
    }
}

impl Bvh {
    /// The place closest to `p`; `None` if there are no triangles or `p` is not finite.
    pub fn closest(&self, p: DVec3) -> Option<Closest> {
        self.finish(p, self.search(p, Best::within(f64::INFINITY)))
    }

    /// As [`Self::closest`], and with the same answer, but faster if `hint` is a triangle close to the answer.
    ///
    /// # Panics
    /// If there is no triangle `hint`.
    pub fn closest_with_hint(&self, p: DVec3, hint: u32) -> Option<Closest> {
        self.finish(p, self.search(p, self.hinted(p, hint)))
    }

    /// The place closest to `p`, unless it is farther than `max_distance`, which may be infinite.
    pub fn closest_within(&self, p: DVec3, max_distance: f64) -> Option<Closest> {
        if max_distance.is_nan() || max_distance < 0.0 {
            return None;
        }
        self.finish(p, self.search(p, Best::within(max_distance * max_distance)))
    }

    /// The hint as the best so far.
    #[inline]
    pub(super) fn hinted(&self, p: DVec3, hint: u32) -> Best {
        let slot = self.slot_of[hint as usize];
        Best {
            distance_sq: distance_sq_to_triangle(p, self.corners[slot as usize]),
            triangle: hint,
            slot,
        }
    }

    /// The best of `best` and all triangles.
    ///
    /// Down the nearest of the boxes first, until none of those that were left aside is near enough.
    fn search(&self, p: DVec3, mut best: Best) -> Best {
        if self.is_empty() || !p.is_finite() {
            return best;
        }
        let local = self.frame.local_point(p);
        let mut reach_sq = self.frame.reach_sq(&local, best.distance_sq);
        let mut stack = Stack::new();
        let mut at = 0;
        loop {
            let node = &self.turned[at as usize];
            let distances_sq = node.distances_sq(local.at);
            let base = stack.len;
            let mut near = node.children.mask() & mask_of(|lane| distances_sq[lane] <= reach_sq);
            while near != 0 {
                let lane = near.trailing_zeros();
                near &= near - 1;
                stack.insert(
                    base,
                    distances_sq[lane as usize % WIDTH],
                    at * WIDTH as u32 + lane,
                );
            }
            at = loop {
                let Some((distance_sq, place)) = stack.pop() else {
                    return best;
                };
                if distance_sq > reach_sq {
                    continue;
                }
                let node = &self.turned[place as usize / WIDTH];
                match node.children.get(place as usize % WIDTH) {
                    Child::Node(node) => break node,
                    Child::Leaf { first, count } => {
                        let before = best.distance_sq;
                        self.try_leaf(p, first, count, &mut best);
                        if best.distance_sq < before {
                            reach_sq = self.frame.reach_sq(&local, best.distance_sq);
                        }
                    }
                }
            }
        }
    }

    #[inline]
    fn try_leaf(&self, p: DVec3, first: u32, count: u32, best: &mut Best) {
        for slot in first..first + count {
            // The hint, most often.
            if slot == best.slot {
                continue;
            }
            let distance_sq = distance_sq_to_triangle(p, self.corners[slot as usize]);
            let triangle = self.triangle_of[slot as usize];
            if distance_sq < best.distance_sq
                || (distance_sq == best.distance_sq && triangle < best.triangle)
            {
                *best = Best {
                    distance_sq,
                    triangle,
                    slot,
                };
            }
        }
    }

    /// Works out the rest of the answer.
    #[inline]
    pub(super) fn finish(&self, p: DVec3, best: Best) -> Option<Closest> {
        let corners = *self.corners.get(best.slot as usize)?;
        let found = closest_on_triangle(p, corners);
        Some(Closest {
            triangle: best.triangle,
            point: found.point,
            feature: found.feature,
            distance_sq: found.distance_sq,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TriMesh;
    use crate::bvh::tests::soup;
    use proptest::prelude::*;

    /// The plain definition.
    fn closest_naive(mesh: &TriMesh, p: DVec3) -> Option<Closest> {
        let mut best: Option<Closest> = None;
        for triangle in 0..mesh.triangles().len() as u32 {
            let found = closest_on_triangle(p, mesh.corners(triangle));
            if best.is_none_or(|best| found.distance_sq < best.distance_sq) {
                best = Some(Closest {
                    triangle,
                    point: found.point,
                    feature: found.feature,
                    distance_sq: found.distance_sq,
                });
            }
        }
        best
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]
        #[test]
        fn the_closest_place_is_that_of_a_scan_whatever_the_hint_and_the_bound(
            mesh in soup(200),
            at in [-1.5..1.5, -1.5..1.5, -1.5..1.5].prop_map(DVec3::from_array),
            far in prop_oneof![Just(1.0), Just(1e3), Just(1e-3)],
            hint in any::<prop::sample::Index>(),
        ) {
            let bvh = Bvh::new(&mesh);
            let p = at * far + mesh.bounds().min.max(DVec3::ZERO);
            let expected = closest_naive(&mesh, p);
            prop_assert_eq!(bvh.closest(p), expected);
            let Some(found) = expected else { return Ok(()) };
            let hint = hint.index(bvh.len()) as u32;
            prop_assert_eq!(bvh.closest_with_hint(p, hint), expected);
            let distance = found.distance_sq.sqrt();
            if distance > 0.0 {
                prop_assert_eq!(bvh.closest_within(p, distance * 1.001), expected);
                prop_assert_eq!(bvh.closest_within(p, distance * 0.999), None);
            }
        }
    }

    #[test]
    fn nothing_is_closest_to_what_is_not_a_place() {
        let mesh = TriMesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]]).unwrap();
        let bvh = Bvh::new(&mesh);
        assert_eq!(bvh.closest(DVec3::NAN), None);
        assert_eq!(bvh.closest(DVec3::INFINITY), None);
        assert_eq!(bvh.closest_within(DVec3::ZERO, f64::NAN), None);
        assert_eq!(bvh.closest_within(DVec3::ZERO, -1.0), None);
        assert_eq!(Bvh::new(&TriMesh::default()).closest(DVec3::ZERO), None);
    }

    #[test]
    fn many_equal_triangles_are_searched_within_the_bounded_stack() {
        let positions = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        let mesh = TriMesh::new(positions, vec![[0, 1, 2]; 20_000]).unwrap();
        let found = Bvh::new(&mesh).closest(DVec3::new(0.2, 0.2, 1.0)).unwrap();
        assert_eq!((found.triangle, found.distance_sq), (0, 1.0));
    }
}
