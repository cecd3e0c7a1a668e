//! Errors of an offset.

use super::Side;
use ravec_progress::Cancelled;

/// Error of an offset.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OffsetError {
    /// The mesh has no triangles.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// The size of the mesh is out of range.
    #[error(
        "the mesh measures {} across, but only sizes from 1e-40 to 1e40 can be offset: scale it first",
        Short(*diagonal)
    )]
    Size {
        /// Diagonal of the bounding box.
        diagonal: f64,
    },
    /// The distance is not a positive number.
    #[error("the distance is {got}, but must be a number above 0")]
    Distance {
        /// Requested value.
        got: f64,
    },
    /// The distance is out of range.
    #[error("the distance is {}, but only sizes from 1e-40 to 1e40 can be offset", Short(*got))]
    DistanceSize {
        /// Requested value.
        got: f64,
    },
    /// The distance is too small for any valid tolerance.
    #[error("the distance is {}, but for a mesh of this size and place must be above {}", Short(*got), Short(*least))]
    DistanceTooSmall {
        /// Requested value.
        got: f64,
        /// Largest distance that is too small.
        least: f64,
    },
    /// The tolerance is out of range.
    #[error(
        "the tolerance is {}, but must be at least {} and below half the distance, {}",
        Short(*got),
        Short(*least),
        Short(*most)
    )]
    Tolerance {
        /// Requested value.
        got: f64,
        /// Smallest tolerance for a mesh of this size.
        least: f64,
        /// Half the distance.
        most: f64,
    },
    /// The tolerance is too small for 32-bit floats.
    #[error(
        "the tolerance is {}, but must be at least {} for 32-bit floats to hold coordinates as large as these: write PLY, OBJ, \
         OFF or 3MF, which hold more, or move the mesh closer to the origin",
        Short(*got),
        Short(*least)
    )]
    SinglePrecision {
        /// Requested value.
        got: f64,
        /// Smallest tolerance for a mesh of this size and position.
        least: f64,
    },
    /// Coordinates of the result exceed the range of 32-bit floats.
    #[error(
        "coordinates of the result are beyond 3.4e38, where 32-bit floats end: write PLY, OBJ, OFF or 3MF, which hold more, \
         or scale the mesh"
    )]
    BeyondSinglePrecision,
    /// The normal deviation is out of range.
    #[error("the normal deviation is {got} degrees, but must be above 0 and at most 90")]
    NormalDeviation {
        /// Requested value.
        got: f64,
    },
    /// The memory limit is below the size of the mesh.
    #[error(
        "{} MiB of memory are not enough for this mesh: it takes at least {}", got >> 20, (least >> 20) + 1
    )]
    Memory {
        /// Requested limit in bytes.
        got: u64,
        /// Smallest limit for this mesh, in bytes.
        least: u64,
    },
    /// The storage of a surface that exceeds the memory limit failed.
    #[error("cannot keep the surface outside of memory: {cause}")]
    Storage {
        /// Error of the storage.
        cause: String,
    },
    /// A part that several processes share is lost.
    #[error(
        "part {part} of the work is lost: is its folder, or its bucket, the same for all machines?"
    )]
    MissingPart {
        /// Number of the part.
        part: u64,
    },
    /// A piece of the work failed in another process.
    #[error("a piece of the work failed: {cause}")]
    Piece {
        /// Error of the piece.
        cause: String,
    },
    /// The sheet is too rough for its size: the solids over its triangles meet in too many places.
    #[error(
        "the sheet is too rough to be thickened with a tolerance of {}: allow a larger one, or simplify or smooth the sheet first",
        Short(*tolerance)
    )]
    TooRough {
        /// Requested value.
        tolerance: f64,
    },
    /// The side requires a closed mesh.
    #[error(
        "the mesh is not closed ({boundary_edges} boundary edges), so it has no inside: choose side both or outer, or close it first"
    )]
    NotClosed {
        /// Number of edges with a triangle on one side only.
        boundary_edges: u64,
    },
    /// A thickened sheet has no choice of side.
    #[error(
        "a sheet is thickened on the side that its triangles face: side {side:?} does not go with it, choose both"
    )]
    SideOfSheet {
        /// Requested value.
        side: Side,
    },
    /// The sheet is not orientable.
    #[error(
        "the sheet has one side only, like a Möbius strip (seen near {place}), so it has no front: cut it open there"
    )]
    OneSided {
        /// Midpoint of an edge at which the orientations conflict.
        place: glam::DVec3,
    },
    /// No triangle has an area.
    #[error(
        "all {triangles} triangles are without area, so the sheet has no side: repair it first"
    )]
    NoArea {
        /// Number of triangles.
        triangles: u64,
    },
    /// The surface is empty.
    #[error("no point of that side is {} away from the mesh: choose a smaller distance", Short(*distance))]
    Empty {
        /// Requested value.
        distance: f64,
    },
    /// The caller cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Display of a number with at most six digits.
struct Short(f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let six = format!("{:.5e}", self.0);
        let short = six.parse().unwrap_or(self.0);
        if short == 0.0 || (1e-4..1e9).contains(&short.abs()) || !short.is_finite() {
            write!(f, "{short}")
        } else {
            write!(f, "{short:e}")
        }
    }
}
