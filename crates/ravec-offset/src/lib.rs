//! Offset surfaces of any triangles, within a tolerance that is proved.
//!
//! The points at a distance from a set of triangles lie on spheres around corners, cylinders around edges and planes beside
//! faces. An octree is split until one vertex per cell represents the surface in it; the surface dual to the octree is cut into
//! triangles; each triangle is proved to keep the distance, more strictly across creases; and cells whose triangles are not
//! proved or intersect others are split again. Finally triangles are merged as far as the same proof allows, and the result is
//! measured. Sheets are thickened by the same means.
//!
//! ```
//! use glam::DVec3;
//! use ravec_mesh::TriMesh;
//! use ravec_offset::{OffsetParams, offset};
//! use ravec_progress::Progress;
//!
//! let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
//! let triangle = TriMesh::new(corners, vec![[0, 1, 2]])?;
//! let params = OffsetParams { distance: 0.2, tolerance: 0.01, ..OffsetParams::default() };
//! let grown = offset(&triangle, &params, &Progress::none())?;
//! assert!(grown.report.certified && grown.report.solid);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Modules
//!
//! The data passes the modules in this order; each uses only those above it.
//!
//! | module | step |
//! | --- | --- |
//! | `params` | parameters and errors |
//! | `domain` | the distance field, the grid of coordinates, enclosed space |
//! | `surface` | patches, proofs, reaches and edits: the data that the steps exchange |
//! | `grow` | the octree, split until one vertex per cell represents the surface |
//! | `extract` | polygons dual to the octree, cut into triangles |
//! | `prove` | facets keep the distance, triangles do not intersect; defects request edits |
//! | `store` | the surface as blocks, in memory or in a storage |
//! | `report` | results |
//! | `remote` | interface between the two steps below and other processes |
//! | `repair` | rounds of the steps above, until no defect remains |
//! | `finish` | simplification, measurement, checks |
//! | `task` | a checked offset with its inputs |
//! | `direct` | offsets that are small beside the features, without an octree |
//! | `thicken` | sheets |
//! | `offset`, `offset_cells`, `draft` | entry points |
//! | `pieces` | offsets whose steps other processes run |
//!
//! # Words
//!
//! | word | meaning |
//! | --- | --- |
//! | cell, leaf | a cube of the octree; a cell that is not split |
//! | corner | a point of the lattice, a corner of cells |
//! | floor, limit | the finest level to which content splits cells; the finest level of all |
//! | tile | a cell whose tree is grown on its own; all of space is one tile if memory allows |
//! | reach | a tile with the leaves that its surface depends on |
//! | workspace | the tiles under repair |
//! | crossing | an edge of the octree on which the sign changes, and the point of the surface on it |
//! | sheet | one of several layers of the surface in a cell; also an open mesh to be thickened |
//! | crowded leaf | a leaf with several sheets |
//! | polygon, facet | the dual of a crossing; a triangle of a polygon |
//! | patch | polygons and facets of a tile or a block |
//! | selection | the polygons to extract: all of a tile, or those near changes |
//! | proof | the fact that a facet keeps the distance within the tolerance; a report says `certified` if all facets have one |
//! | room | the proved distance below a facet: enough, or ample |
//! | defect | a facet without a proof, or a pair of facets that intersect |
//! | edit | a leaf to split or a corner to fill, requested to repair a defect |
//! | repair | rounds of edits until no defect remains |
//! | block | a cell with the polygons whose edges start in it: the unit of storage |
//! | chunk | consecutive blocks that are in memory together |
//! | component | a connected part of the surface |
//! | record | bytes in a storage |
//! | slab, skin, strip | the solid over a sheet; its upper or lower side; the triangles that join a sheet to its solid |
//!
//! # Sources
//!
//! Pavić and Kobbelt, *High-Resolution Volumetric Computation of Offset Surfaces with Feature Preservation*,
//! Eurographics 2008; Schaefer, Ju and Warren, *Manifold Dual Contouring*, TVCG 2007; Ju and Udeshi, *Intersection-free
//! Contouring on an Octree Grid*, Pacific Graphics 2006. Here cells are split by error and not by size, so their number grows
//! with the curvature and the creases of the surface and not with its area.
//!
//! # Guarantees
//!
//! As far as [`OffsetReport`] states them: every point of the result is at the distance from the triangles, within
//! the tolerance (`certified`); the surface is closed, manifold and oriented, also after vertices at equal positions are merged
//! (`solid`); no two triangles intersect (`self_intersections` is 0). The result is the same for any number of threads; before
//! triangles are merged, also for any limit of memory.
//!
//! Does not guarantee: that every point of the true offset has a point of the result within the tolerance. In all
//! tests it has, for crests from 7° on; a more acute crest, and in thick sheets one below a right angle, may be cut farther from
//! its tip, and a part of the surface that is shallower than half the tolerance within a cell may be missed.
//!
//! # Cost
//!
//! About six searches for the closest triangle per leaf of the tree and one per vertex, and for each triangle a
//! proof that costs less than one. A round of repair examines changes and their surroundings. With limited memory, each round
//! reads and writes the tiles that it affects, and data shared between tiles is computed for each. Simplification takes at most
//! about ten searches per removed vertex.
//!
//! A distance below 0.8 % of the diagonal would need cells in proportion to the lengths of edges over the distance. There the
//! surface of a closed mesh is built from its moved triangles, if these can be proved, at a cost that does not depend on the
//! distance.

mod direct;
mod domain;
mod draft;
mod extract;
mod finish;
mod grow;
mod offset;
mod offset_cells;
mod params;
mod pieces;
mod prove;
mod remote;
mod repair;
mod report;
mod store;
mod surface;
mod task;
mod thicken;

pub use draft::OffsetDrafts;
pub use offset::{offset, offset_stored};
pub use offset_cells::{OffsetCell, offset_cells};
pub use params::{Coordinates, OffsetError, OffsetParams, OpenRule, Side};
pub use pieces::{OffsetWorker, offset_in_pieces};
pub use report::{Offset, OffsetReport, StoredOffset};
pub use store::{NewStorage, OffsetSurface, Storage};
