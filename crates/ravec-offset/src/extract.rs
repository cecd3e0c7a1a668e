//! Step 3, extract: the polygons dual to the tree are cut into triangles.
//!
//! Source: Ju and Udeshi, *Intersection-free Contouring on an Octree Grid*, Pacific Graphics 2006: a dual edge that does
//! not pass through its minimal face gets a vertex in the face; a triangle that its edge does not pierce is replaced by a fan
//! around a vertex on that edge.
//!
//! Guarantees: closed, oriented, and manifold by its indices. Intersections remain only in cells with several vertices.

mod crossings;
mod cutter;
mod extraction;
mod face;
mod selection;
mod vertices;

pub(crate) use crossings::CrossingCache;
pub(crate) use extraction::{Extracted, extract};
pub(crate) use selection::Selection;

use cutter::Cutter;
use face::Face;
use vertices::vertices;
