//! Self-intersections of a mesh.
//!
//! Pairs of triangles whose boxes touch are decided by [`intersection`](crate::intersection). Neighbors that share just
//! a corner or an edge are as they should be and are not counted; what counts is any contact beyond that, including
//! overlaps within a plane, repeated triangles and mere touching. Corners are the same if they are at the same place, so
//! that the answer is that of the welded mesh. A triangle without area is no obstacle by itself and is left out: what it
//! covers, its neighbors at the same edges do, too, and the check lists it under its own name.
//!
//! Guarantees: the exact answer for the coordinates as they are stored; the same on any number of threads; full counts,
//! however few pairs are listed. Cost: about half a second a million triangles and core, plus what is found.

use std::collections::BinaryHeap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{Aabb, BoxTree, TriTri, intersection, on_one_line};

/// Two triangles of a mesh that meet where they should not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct IntersectingPair {
    /// The triangle with the lower index.
    pub first: u32,
    /// The one with the higher index.
    pub second: u32,
    /// Kind of contact: anything but [`TriTri::Disjoint`] and [`TriTri::Neighbors`].
    pub kind: TriTri,
}

/// Number and places of the self-intersections of a mesh.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SelfIntersections {
    /// All pairs of triangles that meet where they should not: the sum of the four numbers that follow.
    pub count: u64,
    /// Pairs whose interiors cross.
    pub crossing: u64,
    /// Pairs that overlap within a plane.
    pub overlapping: u64,
    /// Pairs with the same three corners. Other programs often leave them out (libigl, CGAL).
    pub coincident: u64,
    /// Pairs that touch beyond common corners, while their interiors stay apart.
    pub touching: u64,
    /// The first of the pairs, in ascending order.
    pub pairs: Vec<IntersectingPair>,
}

/// Counts from several threads.
#[derive(Default)]
struct Counts([AtomicU64; 4]);

impl Counts {
    fn add(&self, kind: TriTri) {
        let at = match kind {
            TriTri::Disjoint | TriTri::Neighbors => return,
            TriTri::Crossing => 0,
            TriTri::CoplanarOverlap => 1,
            TriTri::Same => 2,
            TriTri::Touch => 3,
        };
        self.0[at].fetch_add(1, Ordering::Relaxed);
    }
}

/// The smallest items seen by any thread, at most `limit` of them.
struct Smallest {
    limit: usize,
    kept: Mutex<BinaryHeap<IntersectingPair>>,
    /// While full, the names of the largest that is kept: what is larger need not wait for the lock.
    bar: AtomicU64,
}

impl Smallest {
    fn new(limit: usize) -> Self {
        Self {
            limit,
            kept: Mutex::default(),
            bar: AtomicU64::new(if limit == 0 { 0 } else { u64::MAX }),
        }
    }

    fn offer(&self, pair: IntersectingPair) {
        let name = |pair: &IntersectingPair| u64::from(pair.first) << 32 | u64::from(pair.second);
        if name(&pair) >= self.bar.load(Ordering::Relaxed) {
            return;
        }
        // a thread that panicked while it held the lock left a valid heap
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.push(pair);
        if kept.len() > self.limit {
            kept.pop();
        }
        if let (true, Some(largest)) = (kept.len() >= self.limit, kept.peek()) {
            self.bar.store(name(largest), Ordering::Relaxed);
        }
    }

    fn sorted(self) -> Vec<IntersectingPair> {
        let kept = self.kept.into_inner();
        kept.unwrap_or_else(PoisonError::into_inner)
            .into_sorted_vec()
    }
}

/// The contact of triangles `a` and `b`, if they meet where they should not.
#[inline]
fn improper(tree: &BoxTree, a: u32, b: u32) -> Option<IntersectingPair> {
    let (first, second) = (a.min(b), a.max(b));
    let (x, y) = (tree.corners(first), tree.corners(second));
    let kind = intersection(x, y);
    if !kind.is_improper() && kind != TriTri::Same {
        return None;
    }
    // only now, as it is rarely needed
    if on_one_line(x[0], x[1], x[2]) || on_one_line(y[0], y[1], y[2]) {
        return None;
    }
    Some(IntersectingPair {
        first,
        second,
        kind,
    })
}

/// Calls `visit`, from several threads and in no particular order, once with each pair of triangles that meet where they
/// should not.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn for_each_self_intersection(
    tree: &BoxTree,
    progress: &Progress,
    visit: impl Fn(IntersectingPair) + Sync,
) -> Result<(), Cancelled> {
    tree.filter_overlapping_pairs(progress, |a, b| {
        // a single task may hold very many pairs
        if !progress.is_cancelled()
            && let Some(pair) = improper(tree, a, b)
        {
            visit(pair);
        }
        None::<()>
    })?;
    progress.check()
}

/// Counts all pairs of triangles that meet where they should not, and lists the first `limit` of them.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn self_intersections(
    tree: &BoxTree,
    limit: usize,
    progress: &Progress,
) -> Result<SelfIntersections, Cancelled> {
    let (counts, smallest) = (Counts::default(), Smallest::new(limit));
    for_each_self_intersection(tree, progress, |pair| {
        counts.add(pair.kind);
        smallest.offer(pair);
    })?;
    let [crossing, overlapping, coincident, touching] = counts.0.map(AtomicU64::into_inner);
    Ok(SelfIntersections {
        count: crossing + overlapping + coincident + touching,
        crossing,
        overlapping,
        coincident,
        touching,
        pairs: smallest.sorted(),
    })
}

/// All pairs of triangles that meet where they should not and of which at least one is among `triangles`, ascending.
///
/// For the question whether a repair made things worse: costs as much as `triangles` have neighbors. Repetitions in
/// `triangles` change nothing.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
///
/// # Panics
/// If there is no such triangle.
pub fn intersections_with(
    tree: &BoxTree,
    triangles: &[u32],
    progress: &Progress,
) -> Result<Vec<IntersectingPair>, Cancelled> {
    let mut queried = triangles.to_vec();
    queried.sort_unstable();
    queried.dedup();
    let found: Vec<Vec<IntersectingPair>> = queried
        .par_iter()
        .map(|&triangle| {
            progress.check()?;
            let mut found = Vec::new();
            tree.for_each_touching(&Aabb::around(*tree.corners(triangle)), |other| {
                // a pair of two that are queried for is left to the lower one
                let twice = other < triangle && queried.binary_search(&other).is_ok();
                if other != triangle && !twice {
                    found.extend(improper(tree, triangle, other));
                }
            });
            Ok(found)
        })
        .collect::<Result<_, _>>()?;
    let mut pairs: Vec<IntersectingPair> = found.into_iter().flatten().collect();
    pairs.sort_unstable();
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bvh;
    use crate::TriMesh;
    use glam::DVec3;
    use proptest::prelude::*;

    /// The plain definition: every pair.
    fn pairs_naive(mesh: &TriMesh) -> Vec<IntersectingPair> {
        let count = mesh.triangles().len() as u32;
        let flat = |t: u32| {
            let [a, b, c] = mesh.corners(t);
            on_one_line(a, b, c)
        };
        let mut pairs = Vec::new();
        for first in 0..count {
            for second in first + 1..count {
                let kind = intersection(&mesh.corners(first), &mesh.corners(second));
                let meet = !matches!(kind, TriTri::Disjoint | TriTri::Neighbors);
                if meet && !flat(first) && !flat(second) {
                    pairs.push(IntersectingPair {
                        first,
                        second,
                        kind,
                    });
                }
            }
        }
        pairs
    }

    fn soup() -> impl Strategy<Value = TriMesh> {
        let place = prop_oneof![
            3 => [-3_i32..4, -3_i32..4, -3_i32..4].prop_map(|v| DVec3::from_array(v.map(f64::from))),
            1 => [-3.0..3.0, -3.0..3.0, -3.0..3.0].prop_map(DVec3::from_array),
        ];
        prop::collection::vec(place, 3..25).prop_flat_map(|positions| {
            let vertex = 0..positions.len() as u32;
            let triangles = prop::collection::vec([vertex.clone(), vertex.clone(), vertex], 0..50);
            triangles.prop_map(move |triangles| TriMesh::new(positions.clone(), triangles).unwrap())
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn the_search_finds_what_all_pairs_show(mesh in soup(), limit in 0_usize..20, queried in prop::collection::vec(any::<prop::sample::Index>(), 0..8)) {
            let expected = pairs_naive(&mesh);
            let bvh = Bvh::new(&mesh);
            let found = self_intersections(&bvh, limit, &Progress::none()).unwrap();
            prop_assert_eq!(found.count, expected.len() as u64);
            prop_assert_eq!(&found.pairs[..], &expected[..limit.min(expected.len())]);
            let of = |kind| expected.iter().filter(|pair| pair.kind == kind).count() as u64;
            prop_assert_eq!(found.crossing, of(TriTri::Crossing));
            prop_assert_eq!(found.overlapping, of(TriTri::CoplanarOverlap));
            prop_assert_eq!(found.coincident, of(TriTri::Same));
            prop_assert_eq!(found.touching, of(TriTri::Touch));
            if !bvh.is_empty() {
                let queried: Vec<u32> = queried.iter().map(|i| i.index(bvh.len()) as u32).collect();
                let local = intersections_with(&bvh, &queried, &Progress::none()).unwrap();
                let mut among = expected;
                among.retain(|pair| queried.contains(&pair.first) || queried.contains(&pair.second));
                prop_assert_eq!(local, among);
            }
        }
    }

    #[test]
    fn planted_defects_are_named() {
        let corners = |list: &[[f64; 3]]| list.iter().map(|&p| DVec3::from_array(p)).collect();
        let positions: Vec<DVec3> = corners(&[
            [0., 0., 0.],
            [4., 0., 0.],
            [0., 4., 0.],
            [4., 4., 0.],
            [1., 1., -1.],
            [1., 1., 1.],
            [9., 9., 1.],
            [3., 3., 0.],
        ]);
        // a floor, its neighbor, the floor again, a blade through it, a patch on it, and a segment
        let triangles = vec![
            [0, 1, 2],
            [1, 3, 2],
            [2, 1, 0],
            [4, 5, 6],
            [0, 1, 7],
            [0, 0, 5],
        ];
        let bvh = Bvh::new(&TriMesh::new(positions, triangles).unwrap());
        let found = self_intersections(&bvh, 100, &Progress::none()).unwrap();
        let listed = |kind| {
            let of_kind = found.pairs.iter().filter(move |pair| pair.kind == kind);
            of_kind
                .map(|pair| (pair.first, pair.second))
                .collect::<Vec<_>>()
        };
        assert_eq!(listed(TriTri::Same), [(0, 2)]);
        assert_eq!(listed(TriTri::CoplanarOverlap), [(0, 4), (1, 4), (2, 4)]);
        assert_eq!(listed(TriTri::Crossing), [(0, 3), (1, 3), (2, 3)]);
        assert_eq!(listed(TriTri::Touch), [(3, 4)]);
        assert_eq!(found.count, 8);
    }

    #[test]
    fn a_cancelled_search_stops() {
        let bvh = Bvh::new(&TriMesh::default());
        let progress = Progress::none();
        progress.cancel();
        assert_eq!(self_intersections(&bvh, 1, &progress), Err(Cancelled));
        let mesh = TriMesh::new(vec![DVec3::ZERO], vec![[0, 0, 0]]).unwrap();
        let bvh = Bvh::new(&mesh);
        assert_eq!(intersections_with(&bvh, &[0], &progress), Err(Cancelled));
    }
}
