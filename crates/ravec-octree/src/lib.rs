//! Adaptive octrees and the closed surfaces dual to them.
//!
//! The owner of an [`Octree`] splits it cell by cell, as deep as needed; the levels of neighbors may differ by any number.
//! [`for_each_minimal_edge`] visits the edges that contain no shorter one, with the leaves around each. From those with a sign
//! change, [`Contour`] builds the connectivity of a closed surface: polygons around the edges, with vertices in the leaves. The
//! caller places the vertices.
//!
//! All coordinates are integers on the lattice of the finest level ([`MAX_LEVEL`]), so comparisons of corners are exact; a
//! [`Frame`] places the lattice in space. Codes of corners ([`Corner::code`]) do not depend on the tree, so data about corners
//! remains valid after any split.
//!
//! | word | meaning |
//! | --- | --- |
//! | root, cell, leaf | the cube of level 0; a cube of any level; a cell that is not split |
//! | corner | a point of the lattice |
//! | octant | one of the eight children of a cell, or its corner there: bit 0 for x, 1 for y, 2 for z |
//! | minimal edge, minimal face | an edge or face of a leaf that contains no smaller one |
//! | crossing | a minimal edge with a sign change |
//! | polygon, dual edge | the dual of a crossing; the dual of a minimal face that the surface passes through |

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
