//! Results and their report.

use crate::store::OffsetSurface;
use ravec_mesh::TriMesh;
use serde::{Deserialize, Serialize};

/// Report of an offset: properties of the result and of the work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OffsetReport {
    /// Every facet is proved to keep the distance within the tolerance.
    pub certified: bool,
    /// Facets without such a proof.
    pub uncertified_facets: u64,
    /// The surface is closed, manifold and consistently oriented, also after vertices at the same position are merged.
    pub solid: bool,
    /// Pairs of triangles that intersect.
    pub self_intersections: u64,
    /// Triangles of the result.
    pub triangles: u64,
    /// Triangles before simplification.
    pub extracted_triangles: u64,
    /// Leaves of the octree; 0 if the surface was built from the moved triangles, without an octree.
    pub cells: u64,
    /// Finest level of the octree; the root is level 0.
    pub deepest_level: u8,
    /// Tiles in which the octree was grown: 1 if all of it fits in memory.
    pub tiles: u64,
    /// Rounds of repair.
    pub rounds: u32,
    /// Leaves split by repair.
    pub split_cells: u64,
    /// Corners of the finest cells set inside by repair, where sheets are closer than cells can separate.
    pub filled_corners: u64,
    /// Lower bound of the distance of all points of the surface: proved, and exact up to a thousandth of the tolerance. For a
    /// shell, this bound and the two below concern the inner surface.
    pub least_distance: f64,
    /// Upper bound of the distance of all points of the surface: proved.
    pub most_distance: f64,
    /// Largest distance of a corner or a center of a facet. The true maximum is between this and `most_distance`.
    pub most_distance_found: f64,
    /// Creases: edges at which both the facets and the normals of the true surface beside the edge turn by more than 20°.
    pub feature_edges: u64,
    /// For a thickened sheet: its own triangles are one of the skins, unchanged but for their orientation.
    pub sheet_kept: Option<bool>,
}

/// An offset surface in memory.
#[derive(Debug, Clone)]
pub struct Offset {
    /// The surface. Triangles are counterclockwise seen from outside of the offset solid.
    pub mesh: TriMesh,
    /// The report.
    pub report: OffsetReport,
}

/// An offset surface that need not be in memory.
#[derive(Debug)]
pub struct StoredOffset {
    /// The surface. Triangles are counterclockwise seen from outside of the offset solid.
    pub surface: OffsetSurface,
    /// The report.
    pub report: OffsetReport,
}

/// Extremes of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Measured {
    /// Facets that are not proved to be within the limits.
    pub unproved: u64,
    /// Proved minimum distance.
    pub least: f64,
    /// Proved maximum distance.
    pub most: f64,
    /// Largest distance of a corner or a center of a facet.
    pub max_found: f64,
}

impl Measured {
    /// Combines two parts of a surface.
    pub fn and(self, other: Self) -> Self {
        Self {
            unproved: self.unproved + other.unproved,
            least: self.least.min(other.least),
            most: self.most.max(other.most),
            max_found: self.max_found.max(other.max_found),
        }
    }
}

/// Properties of a chunk of the finished surface.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct ChunkFacts {
    pub measured: Measured,
    pub feature_edges: u64,
    pub is_closed_manifold: bool,
}
