//! Adaptive octrees and the closed surfaces that are dual to them.

mod contour;
mod edges;
mod key;
mod tree;

pub use contour::{Contour, DualEdge, Polygon};
pub use edges::{MinimalEdge, for_each_minimal_edge};
pub use key::{CellKey, Corner, Frame, MAX_LEVEL};
pub use tree::{NodeId, Octree};
