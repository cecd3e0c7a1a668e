//! Adaptive octrees and the closed surfaces that are dual to them.
//!
//! An [`Octree`] is split by its owner, cell by cell, as deep as needed; neighbors may differ by any number of levels.
//! [`for_each_minimal_edge`] walks the edges that hold no shorter one, with the leaves around each. From those on which a
//! sign changes, [`Contour`] makes the combinatorics of a closed surface: polygons around the edges, with vertices in the
//! leaves. Where the vertices lie is its caller's business.
//!
//! All coordinates are integers on the lattice of the finest level ([`MAX_LEVEL`]), so that corners are equal or not, without
//! rounding; [`Frame`] says where the lattice lies in space. Corners have names ([`Corner::code`]) that do not depend on the
//! tree, so that what is known of them outlives any split.

mod contour;
mod edges;
mod faces;
mod key;
mod set;
mod tree;

pub use contour::{Contour, DualEdge, Polygon};
pub use edges::{MinimalEdge, for_each_minimal_edge, minimal_edges, minimal_edges_near};
pub use faces::for_each_minimal_face;
pub use key::{CellKey, Corner, Frame, MAX_LEVEL};
pub use set::CellSet;
pub use tree::{NodeId, Octree};
