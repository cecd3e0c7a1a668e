//! A hierarchy of boxes over triangles, for all questions of the kind "which triangles are near".
//!
//! The plain idea of every query: a box that is farther away than the best triangle so far holds nothing better. The
//! departures from it:
//!
//! 1. A node has up to eight children, whose boxes lie side by side, one axis after the other, so that eight of them are
//!    measured by a few vector instructions.
//! 2. Each node has a second set of boxes, turned to the surface below it, by which distances are measured: plates that fit
//!    a smooth surface much more closely than boxes along the axes.
//! 3. Boxes are `f32` in a local frame (centered on the mesh and scaled by a power of two to a size of about 1), rounded
//!    outward, so that they lose nothing to large coordinates. Triangles stay `f64`.
//! 4. A query point is rounded, too, and the radius of the search is widened by what that moved it. Boxes are thus never
//!    skipped wrongly, and every answer is that of a linear scan over the exact triangles, bit for bit.
//! 5. Triangles are stored in the order of the leaves, each with its three corners, so that a leaf is one piece of memory.
//!
//! Guarantees: the answers do not depend on the shape of the tree, on hints or on the number of threads; among equally
//! near triangles the one with the lowest index wins; any soup will do, also an empty one. Does not guarantee: sizes or
//! distances beyond 1e75 overflow.
//!
//! Cost: building O(n log n), about 0.9 s a million triangles and core, so it can be cancelled ([`Bvh::try_new`]); 72 + 8 bytes a triangle for corners and names, about
//! 52 for boxes. A query near the surface takes about a microsecond at a million triangles, one from a distance of many
//! triangles two or three.

mod build;
mod candidates;
mod closest;
mod frame;
mod node;
mod pairs;
mod range;
mod turned;
mod winding;

use std::ops::Deref;

use fearless_simd::Level;
use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use crate::{Aabb, TriMesh};
use build::{Effort, Prim};
use frame::Frame;
use node::Node;
use turned::TurnedNode;

pub use candidates::CandidateTree;
pub use closest::Closest;
pub use range::RayHit;
pub use winding::{WindingNumbers, winding_number};

/// Boxes over the triangles of a mesh: what touches a box, and which triangles may meet. It keeps a copy of the corners, so
/// that the mesh may go.
#[derive(Debug, Clone)]
pub struct BoxTree {
    frame: Frame,
    /// The root comes first; there is none if there are no triangles.
    nodes: Vec<Node>,
    /// The corners of the triangles in the order of the leaves: by slot.
    corners: Vec<[DVec3; 3]>,
    /// The triangle in a slot.
    triangle_of: Vec<u32>,
    /// The slot of a triangle.
    slot_of: Vec<u32>,
}

/// A search structure over the triangles of a mesh, for distances too: a [`BoxTree`] and more.
#[derive(Debug, Clone)]
pub struct Bvh {
    boxes: BoxTree,
    /// The same nodes with boxes that are turned to the surface.
    turned: Vec<TurnedNode>,
    /// The vector instructions that this machine has. Answers do not depend on them.
    vectors: Level,
}

impl Deref for Bvh {
    type Target = BoxTree;

    #[inline]
    fn deref(&self) -> &BoxTree {
        &self.boxes
    }
}

impl Bvh {
    /// The structure over all triangles of `mesh`, built in the caller's thread pool.
    ///
    /// # Panics
    /// If there are more than about a billion triangles.
    pub fn new(mesh: &TriMesh) -> Self {
        Self::try_new(mesh, &Progress::none()).expect("nobody can cancel it")
    }

    /// As [`Self::new`], for meshes of which that takes more than a moment.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn try_new(mesh: &TriMesh, progress: &Progress) -> Result<Self, Cancelled> {
        let boxes = BoxTree::build(mesh, Effort::Thorough, progress)?;
        let turned = turned::turned(&boxes.nodes, &boxes.frame, &boxes.corners, progress)?;
        Ok(Self {
            boxes,
            turned,
            vectors: Level::new(),
        })
    }

    /// The number of bytes this structure holds on to.
    pub fn memory_bytes(&self) -> usize {
        self.boxes.memory_bytes() + size_of_val(&*self.turned)
    }
}

impl BoxTree {
    /// The boxes over all triangles of `mesh`, built in the caller's thread pool in half the time of a [`Bvh`]: for a few
    /// questions about each triangle, such as all pairs once.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    ///
    /// # Panics
    /// If there are more than about a billion triangles.
    pub fn try_new(mesh: &TriMesh, progress: &Progress) -> Result<Self, Cancelled> {
        Self::build(mesh, Effort::Quick, progress)
    }

    fn build(mesh: &TriMesh, effort: Effort, progress: &Progress) -> Result<Self, Cancelled> {
        progress.check()?;
        let frame = Frame::around(mesh.bounds());
        let mut prims: Vec<Prim> = (0..mesh.triangles().len() as u32)
            .into_par_iter()
            .map(|triangle| Prim::new(&frame, mesh.corners(triangle), triangle))
            .collect();
        let nodes = build::nodes(&mut prims, effort, progress)?;
        let triangle_of: Vec<u32> = prims.par_iter().map(|prim| prim.triangle).collect();
        let corners: Vec<[DVec3; 3]> = triangle_of.par_iter().map(|&t| mesh.corners(t)).collect();
        progress.check()?;
        let mut slot_of = vec![0; triangle_of.len()];
        for (slot, &triangle) in triangle_of.iter().enumerate() {
            slot_of[triangle as usize] = slot as u32;
        }
        Ok(Self {
            frame,
            nodes,
            corners,
            triangle_of,
            slot_of,
        })
    }

    /// The number of triangles.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Returns `true` if there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The places of the corners of `triangle`, named as in the mesh.
    ///
    /// # Panics
    /// If there is no such triangle.
    #[inline]
    pub fn corners(&self, triangle: u32) -> &[DVec3; 3] {
        &self.corners[self.slot_of[triangle as usize] as usize]
    }

    /// The smallest box around all triangles; empty if there are none.
    pub fn bounds(&self) -> Aabb {
        Aabb::around(self.corners.iter().flatten().copied())
    }

    /// The number of bytes this structure holds on to.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&*self.nodes)
            + size_of_val(&*self.corners)
            + size_of_val(&*self.triangle_of)
            + size_of_val(&*self.slot_of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_tree_that_is_cancelled_at_any_look_is_not_built() {
        // enough triangles for several threads
        let at = |k: u32| DVec3::new(f64::from(k % 100), f64::from(k / 100), f64::from(k % 7));
        let row = (0..9900).filter(|k| k % 100 < 99);
        let triangles = row.flat_map(|k| [[k, k + 1, k + 101], [k, k + 101, k + 100]]);
        let mesh = TriMesh::new((0..10_000).map(at).collect(), triangles.collect()).unwrap();
        let mut look = 1;
        while look < 500 {
            assert!(Bvh::try_new(&mesh, &Progress::cancelled_at(look)).is_err());
            look += look.div_ceil(3);
        }
        let bvh = Bvh::new(&mesh);
        assert!(WindingNumbers::try_new(&bvh, &Progress::cancelled_at(100)).is_err());
    }

    /// Soups of up to `most` triangles: large and small ones, some of them repeated, flat or far away.
    pub(super) fn soup(most: usize) -> impl Strategy<Value = TriMesh> {
        let place = [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_map(DVec3::from_array);
        let grid =
            [-2_i32..3, -2_i32..3, -2_i32..3].prop_map(|at| DVec3::from_array(at.map(f64::from)));
        let corner = prop_oneof![place.clone(), grid];
        let large = [corner.clone(), corner.clone(), corner];
        let small = (place.clone(), [place.clone(), place.clone(), place])
            .prop_map(|(at, corners)| corners.map(|corner| at + 0.1 * corner));
        let shift = prop_oneof![Just(0.0), Just(1e6)];
        let corners = prop::collection::vec(prop_oneof![large, small], 0..most);
        (corners, shift).prop_map(|(corners, shift)| {
            let positions = corners.iter().flatten().map(|&at| at + shift).collect();
            let triangles = (0..corners.len() as u32)
                .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
                .collect();
            TriMesh::new(positions, triangles).unwrap()
        })
    }
}
