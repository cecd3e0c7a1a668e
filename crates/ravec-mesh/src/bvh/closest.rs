//! The triangle closest to a point.

use arrayvec::ArrayVec;
use fearless_simd::{dispatch, prelude::*};
use glam::DVec3;

use super::Bvh;
use super::node::{Child, STACK, WIDTH, lanes};
use crate::closest::{Feature, closest_on_triangle};

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
struct Best {
    found: Closest,
    slot: u32,
}

impl Best {
    /// Nothing found yet within the squared distance.
    const fn within(distance_sq: f64) -> Self {
        Self {
            found: Closest {
                triangle: u32::MAX,
                point: DVec3::NAN,
                feature: Feature::Face,
                distance_sq,
            },
            slot: u32::MAX,
        }
    }
}

/// The half space beyond the best point so far, as seen from the point of the search. Triangles in it are farther than
/// the best, and the test for it is cheaper than their distance.
#[derive(Debug, Clone, Copy)]
struct Beyond {
    from: DVec3,
    /// The unit vector to the best point; zero as long as there is none.
    toward: DVec3,
    /// Distance at which it begins; more than the distance of the best, by the rounding error.
    reach: f64,
    margin: f64,
}

impl Beyond {
    fn new(from: DVec3, best: &Best, margin: f64) -> Self {
        let mut beyond = Self {
            from,
            toward: DVec3::ZERO,
            reach: margin,
            margin,
        };
        if best.slot != u32::MAX {
            beyond.move_to(best);
        }
        beyond
    }

    #[inline(always)]
    fn move_to(&mut self, best: &Best) {
        self.toward = (best.found.point - self.from).normalize_or_zero();
        self.reach = best.found.distance_sq.sqrt() + self.margin;
    }

    #[inline(always)]
    fn holds(&self, corners: &[DVec3; 3]) -> bool {
        let [a, b, c] = corners.map(|corner| self.toward.dot(corner - self.from));
        a.min(b).min(c) > self.reach
    }
}

/// Boxes that are still to be looked into.
///
/// An entry is one number: the bits of the squared distance, which for what is not negative are in the order of the values,
/// above the place of the box, its node times eight and its lane.
struct Stack(ArrayVec<u64, STACK>);

impl Stack {
    /// Keeps the entries from `base` on sorted, the nearest last.
    #[inline(always)]
    fn insert(&mut self, base: usize, distance_sq: f32, place: u32) {
        let entry = u64::from(distance_sq.to_bits()) << 32 | u64::from(place);
        let mut at = self.0.len();
        self.0.push(entry);
        while at > base && self.0[at - 1] < entry {
            self.0[at] = self.0[at - 1];
            at -= 1;
        }
        self.0[at] = entry;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<(f32, u32)> {
        let entry = self.0.pop()?;
        Some((f32::from_bits((entry >> 32) as u32), entry as u32))
    }
}

impl Bvh {
    /// The place closest to `p`; `None` if there are no triangles or `p` is not finite.
    pub fn closest(&self, p: DVec3) -> Option<Closest> {
        self.search(p, Best::within(f64::INFINITY))
    }

    /// As [`Self::closest`], and with the same answer, but faster if `hint` is a triangle close to the answer.
    ///
    /// # Panics
    /// If there is no triangle `hint`.
    pub fn closest_with_hint(&self, p: DVec3, hint: u32) -> Option<Closest> {
        self.search(p, self.hinted(p, hint))
    }

    /// The place closest to `p`, unless it is farther than `max_distance`, which may be infinite.
    pub fn closest_within(&self, p: DVec3, max_distance: f64) -> Option<Closest> {
        if max_distance.is_nan() || max_distance < 0.0 {
            return None;
        }
        self.search(p, Best::within(max_distance * max_distance))
    }

    /// The hint as the best so far.
    #[inline]
    fn hinted(&self, p: DVec3, hint: u32) -> Best {
        let slot = self.slot_of[hint as usize];
        self.measured(p, slot, hint)
    }

    #[inline(always)]
    fn measured(&self, p: DVec3, slot: u32, triangle: u32) -> Best {
        let found = closest_on_triangle(p, &self.corners[slot as usize]);
        Best {
            found: Closest {
                triangle,
                point: found.point,
                feature: found.feature,
                distance_sq: found.distance_sq,
            },
            slot,
        }
    }

    /// The best of `best` and all triangles, if it is a triangle.
    ///
    /// Down the nearest of the boxes first, until none of those that were left aside is near enough.
    fn search(&self, p: DVec3, mut best: Best) -> Option<Closest> {
        if self.is_empty() || !p.is_finite() {
            return None;
        }
        dispatch!(self.vectors, simd => self.search_with(simd, p, &mut best));
        (best.slot != u32::MAX).then_some(best.found)
    }

    #[inline(always)]
    fn search_with<S: Simd>(&self, simd: S, p: DVec3, best: &mut Best) {
        let local = self.frame.local_point(p);
        let mut reach_sq = self.frame.reach_sq(&local, best.found.distance_sq);
        let mut beyond = Beyond::new(p, best, self.frame.rounding(&local));
        let mut stack = Stack(ArrayVec::new());
        let mut at = 0;
        loop {
            let node = &self.turned[at as usize];
            let distances_sq = node.distances_sq(simd, local.at);
            let base = stack.0.len();
            let near = distances_sq.simd_le(reach_sq).to_bitmask() as u32;
            let distances_sq: [f32; WIDTH] = distances_sq.into();
            for lane in lanes(near & node.children.mask()) {
                stack.insert(base, distances_sq[lane], at * WIDTH as u32 + lane as u32);
            }
            at = loop {
                let Some((distance_sq, place)) = stack.pop() else {
                    return;
                };
                if distance_sq > reach_sq {
                    continue;
                }
                let node = &self.turned[place as usize / WIDTH];
                match node.children.get(place as usize % WIDTH) {
                    Child::Node(node) => break node,
                    Child::Leaf { first, count } => {
                        let before = best.found.distance_sq;
                        self.try_leaf(p, first, count, best, &mut beyond);
                        if best.found.distance_sq < before {
                            reach_sq = self.frame.reach_sq(&local, best.found.distance_sq);
                        }
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn try_leaf(&self, p: DVec3, first: u32, count: u32, best: &mut Best, beyond: &mut Beyond) {
        for slot in first..first + count {
            // The hint, most often.
            if slot == best.slot || beyond.holds(&self.corners[slot as usize]) {
                continue;
            }
            let triangle = self.triangle_of[slot as usize];
            let other = self.measured(p, slot, triangle);
            let (least, distance_sq) = (best.found.distance_sq, other.found.distance_sq);
            if distance_sq < least || (distance_sq == least && triangle < best.found.triangle) {
                *best = other;
                beyond.move_to(best);
            }
        }
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
            let found = closest_on_triangle(p, &mesh.corners(triangle));
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
