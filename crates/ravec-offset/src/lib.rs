//! Offset surfaces of any triangles, within a tolerance that is proved.
//!
//! The points at a distance from a set of triangles lie on pieces of spheres around their corners, cylinders around their edges
//! and planes beside them. An octree is split until one vertex a cell stands for the pieces in it (`refine`, `cell`); the surface
//! dual to it is cut into triangles that do not meet each other (`extract`); every triangle is proved to keep the distance
//! (`certify`), and better than that across creases (`crest`), and cells whose triangles are not, or meet others, are split again
//! (`mend`), tile by tile if memory is limited (`tile`, `store`). Triangles are merged at the end, as far as the same proof
//! allows (`simplify`), those that lie badly are turned (`smooth`), and what is left is measured (`measure`), if need be piece by
//! piece (`pieces`). If a file is to hold 32-bit floats, vertices are put on these before any of that is decided (`grid`). Sheets
//! are made thick by the same means (`thicken`).
//!
//! Sources: Pavić and Kobbelt, *High-Resolution Volumetric Computation of Offset Surfaces with Feature Preservation*,
//! Eurographics 2008; Schaefer, Ju and Warren, *Manifold Dual Contouring*, TVCG 2007; Ju and Udeshi, *Intersection-free
//! Contouring on an Octree Grid*, Pacific Graphics 2006. Here cells are split by error and not by size, so their number grows
//! with the surface's curvature and creases and not with its area.
//!
//! Guarantees, for what [`OffsetReport`] says of them: every point of the result is at the distance from the triangles, within
//! the tolerance (`certified`); it is closed, manifold and oriented, also once vertices in one place are merged (`solid`); no two
//! triangles meet where they should not (`self_intersections` is 0). The same result for any number of threads; before triangles
//! are merged also for any limit of memory.
//!
//! Does not guarantee: that every point of the true offset has a point of the result within the tolerance. It is so in all
//! tests, for crests from 7° on; a more acute crest, and in thick sheets one below a right angle, may be cut farther from its
//! tip, and a part of the surface that is shallower than half the tolerance within a cell may be missed.
//!
//! Cost: about six searches for the closest triangle for each leaf of the tree and one for each vertex, and for each triangle a
//! proof that costs less than one. A round of mending looks at what changed and what is near it. Where memory is limited tiles
//! are read and written in each round that concerns them, and what they share with others is grown for each.
//! Simplification takes at most ten searches or so for each vertex that goes.

mod cell;
mod cells;
mod certify;
mod crest;
mod enclosed;
mod extract;
mod field;
mod finish;
mod grid;
mod judge;
mod measure;
mod mend;
mod offset;
mod outermost;
mod params;
mod pieces;
mod proof;
mod refine;
mod scope;
mod simplify;
mod smooth;
mod space;
mod store;
mod stored;
mod thicken;
mod tile;

pub use cells::{OffsetCell, offset_cells};
pub use offset::{Offset, OffsetReport, StoredOffset, offset, offset_stored};
pub use params::{Coordinates, OffsetError, OffsetParams, OpenRule, Side};
pub use store::{NewStorage, Storage};
pub use stored::OffsetSurface;
