//! Pairs of triangles that may meet, without a copy of the triangles.
//!
//! As [`super::BoxTree`], but the corners stay where they are: what is answered are candidates, whose boxes touch in single
//! precision, rounded outward. Those that would not touch in double precision are few.
//!
//! Guarantees: nothing that touches is missed; the order of the pairs is the same each time and on any number of threads.
//! Cost: 28 bytes a triangle, and about 26 for nodes.

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use super::build::{self, Effort, Prim};
use super::frame::Frame;
use super::node::Node;
use super::pairs::Pairing;
use super::range;
use crate::Aabb;

/// Triangles between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 14;

/// Boxes over triangles that are kept elsewhere. Triangles have slots, one after the other in the order of the leaves, so that
/// those near to each other have slots near to each other.
#[derive(Debug, Clone)]
pub struct CandidateTree {
    frame: Frame,
    bounds: Aabb,
    /// The root comes first; there is none if there are no triangles.
    nodes: Vec<Node>,
    /// By slot.
    prims: Vec<Prim>,
}

impl CandidateTree {
    /// The boxes over triangles 0 to `count`, whose corners `corners` gives and `bounds` holds, built in the caller's thread
    /// pool.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    ///
    /// # Panics
    /// If there are more than about a billion triangles.
    pub fn try_new(
        bounds: Aabb,
        count: usize,
        corners: impl Fn(u32) -> [DVec3; 3] + Sync,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        progress.check()?;
        let frame = Frame::around(bounds);
        let mut prims: Vec<Prim> = (0..count as u32)
            .into_par_iter()
            .map(|triangle| {
                if (triangle as usize).is_multiple_of(STRIDE) {
                    progress.check()?;
                }
                Ok(Prim::new(&frame, corners(triangle), triangle))
            })
            .collect::<Result<_, Cancelled>>()?;
        let nodes = build::nodes(&mut prims, Effort::Quick, progress)?;
        Ok(Self {
            frame,
            bounds,
            nodes,
            prims,
        })
    }

    /// The number of triangles.
    pub fn len(&self) -> usize {
        self.prims.len()
    }

    /// Returns `true` if there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.prims.is_empty()
    }

    /// The box that was said to hold all triangles.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The triangle in a slot.
    ///
    /// # Panics
    /// If there is no such slot.
    #[inline]
    pub fn triangle(&self, slot: u32) -> u32 {
        self.prims[slot as usize].triangle
    }

    /// Calls `visit` with each triangle whose box touches `bounds`, and with few others, in no particular order.
    pub fn for_each_near(&self, bounds: &Aabb, mut visit: impl FnMut(u32)) {
        if bounds.is_empty() || self.is_empty() {
            return;
        }
        let local = self.frame.local_box(bounds.min, bounds.max);
        range::any(
            |at| {
                let node = &self.nodes[at];
                (&node.children, node.touching(&local))
            },
            |slot| {
                let prim = &self.prims[slot as usize];
                if prim.bounds.touches(&local) {
                    visit(prim.triangle);
                }
                false
            },
        );
    }

    /// Applies `keep` to the pairs of slots whose triangles' boxes touch, and to few others, in the caller's thread
    /// pool, and returns the results that it keeps.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn filter_near_pairs<T: Send>(
        &self,
        progress: &Progress,
        keep: impl Fn(u32, u32) -> Option<T> + Sync,
    ) -> Result<Vec<T>, Cancelled> {
        Pairing(&self.nodes).filter(progress, |slot, others, kept| {
            let here = &self.prims[slot as usize].bounds;
            for other in others {
                if here.touches(&self.prims[other as usize].bounds) {
                    kept.extend(keep(slot, other));
                }
            }
        })
    }

    /// The number of bytes this structure holds on to.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.prims)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TriMesh;
    use crate::bvh::tests::soup;
    use proptest::prelude::*;

    fn tree(mesh: &TriMesh) -> CandidateTree {
        let count = mesh.triangles().len();
        CandidateTree::try_new(mesh.bounds(), count, |t| mesh.corners(t), &Progress::none())
            .unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn nothing_that_touches_is_missed_and_nothing_comes_twice(mesh in soup(150), part in 0..150_u32) {
            let tree = tree(&mesh);
            let count = mesh.triangles().len() as u32;
            let bounds = |t| Aabb::around(mesh.corners(t));
            let named = |a: u32, b: u32| {
                let [a, b] = [a, b].map(|slot| tree.triangle(slot));
                Some((a.min(b), a.max(b)))
            };
            let mut found = tree.filter_near_pairs(&Progress::none(), named).unwrap();
            found.sort_unstable();
            prop_assert!(found.windows(2).all(|two| two[0] < two[1]));
            let mut near = Vec::new();
            for a in 0..count {
                near.extend((a + 1..count).filter(|&b| bounds(a).touches(&bounds(b))).map(|b| (a, b)));
            }
            prop_assert!(near.iter().all(|pair| found.binary_search(pair).is_ok()));
            // single precision is some 1e-7 of the whole
            let slack = 1e-6 * tree.bounds().diagonal();
            let nearly = |&(a, b): &(u32, u32)| bounds(a).grown(slack).touches(&bounds(b));
            prop_assert!(found.iter().all(nearly));

            if part < count {
                let mut found = Vec::new();
                tree.for_each_near(&bounds(part), |t| found.push(t));
                found.sort_unstable();
                prop_assert!(found.windows(2).all(|two| two[0] < two[1]));
                let touches = |t: &u32| bounds(*t).touches(&bounds(part));
                prop_assert!((0..count).filter(touches).all(|t| found.binary_search(&t).is_ok()));
            }
        }
    }

    #[test]
    fn an_empty_tree_has_no_candidates_and_a_cancelled_one_is_not_built() {
        let tree = tree(&TriMesh::default());
        assert!(tree.is_empty() && tree.bounds().is_empty());
        tree.for_each_near(&Aabb::around([DVec3::ZERO]), |_| panic!("there are none"));
        let progress = Progress::none();
        progress.cancel();
        let corners = |_| [DVec3::ZERO, DVec3::X, DVec3::Y];
        assert!(CandidateTree::try_new(Aabb::around(corners(0)), 1, corners, &progress).is_err());
        let found = tree.filter_near_pairs(&progress, |a, b| Some((a, b)));
        assert_eq!(found, Err(Cancelled));
    }
}
