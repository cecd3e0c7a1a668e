//! Parameters, report and errors of Booleans.

use ravec_mesh::{Coordinates, TriMesh};

/// The places that count as inside a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum Inside {
    /// Those with a winding number above one half: where it is closed, those that it goes around counterclockwise.
    ///
    /// The winding number is the generalized one, which an open mesh has, too. A mesh that is inside out as a whole is turned
    /// first, and so are closed parts that are inside out and clear of all others.
    #[default]
    Positive,
    /// Those that it goes around in either direction, for meshes with parts that are inside out.
    Nonzero,
    /// Those that cannot be reached from outside: cavities are filled, directions do not matter.
    OuterHull,
}

/// Closing of the boundary of an open mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum CloseRule {
    /// Fills each loop of the boundary by itself, or two by a band between them where that takes less area and does not
    /// repeat the mesh's own wall.
    #[default]
    Auto,
    /// Fills each loop by itself, as a lid on each end of a tube.
    Lid,
    /// Joins loops that face each other by a band, nearest first, as the missing inner wall of a ring; others get lids.
    Band,
    /// Puts a relief that is open below on a flat base: walls go straight down along z from its boundary, to 2% of the diagonal of
    /// its bounding box below its lowest point.
    Base,
}

/// Treatment of open sheets: meshes with a boundary of which every part is a thin surface that its closing only covers once
/// more, such as a terrain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum OpenRule {
    /// Trims sheets where the result lies in them alone, as in sheet - solid and sheet & solid, unless `close` says how to close
    /// them; closes all other open meshes.
    #[default]
    Auto,
    /// Trims all open meshes: the result is the part of their surfaces that the expression keeps, and stays open.
    Trim,
    /// Closes all open meshes, sheets too.
    Close,
}

/// Parameters of a Boolean.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct BooleanParams {
    /// The places that count as inside each mesh.
    pub inside: Inside,
    /// Closing of open meshes.
    pub close: CloseRule,
    /// Open meshes that are trimmed instead of closed.
    pub open: OpenRule,
    /// Precision of the coordinates of the result (default double). With single precision the result is rounded to 32-bit
    /// floats and repaired on these, so that the report holds for a file that stores nothing else.
    pub coordinates: Coordinates,
    /// Give each vertex of the result a place of its own (default false), for formats such as STL whose readers join
    /// vertices at equal places. Where solids touch in an edge or a vertex, both are drawn back by some millionths of the
    /// largest coordinate.
    pub separate: bool,
    /// The most memory to use, in bytes; no limit if not given. The need is estimated from the number of triangles, and
    /// once more when it is known how many of them meet; an estimate may be too low where very many meet in one place.
    pub memory_bytes: Option<u64>,
}

/// Origin of a triangle of the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Origin {
    /// Index of the mesh.
    pub mesh: u32,
    /// Index of the triangle in that mesh; none for a triangle that closes a hole of it.
    pub triangle: Option<u32>,
    /// `true` if it is seen from its other side in the result.
    pub reversed: bool,
    /// `true` if it is that triangle, whole and unchanged but for rounding to [`BooleanParams::coordinates`], and not a
    /// piece of it.
    pub whole: bool,
}

/// Places that a mesh goes around clockwise, and that are therefore outside: a part of it that is inside out.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DroppedPart {
    /// Their volume.
    pub volume: f64,
    /// Center of their bounding box.
    pub center: [f64; 3],
}

/// Findings about an input mesh.
#[expect(
    clippy::struct_excessive_bools,
    reason = "independent findings of a report"
)]
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct OperandReport {
    /// Triangles that came in.
    pub triangles: u64,
    /// `true` if each edge is used as often in one direction as in the other, at the exact places of the vertices.
    pub closed: bool,
    /// `true` if no edge is used twice in one direction by two triangles that could be turned to agree.
    pub oriented: bool,
    /// Pairs of its triangles that meet where they should not.
    pub self_intersections: u64,
    /// Triangles without area, which were left out.
    pub degenerate_triangles: u64,
    /// Triangles that were added to close holes and seams.
    pub closing_triangles: u64,
    /// Connected parts of it that are inside out and in no other part.
    pub reversed_parts: u64,
    /// Connected parts of it that were turned since they are inside out: all of them, or those clear of all others.
    pub turned_parts: u64,
    /// Notable places that it goes around clockwise, the largest first: they count as outside under [`Inside::Positive`], and the
    /// mesh goes around them since other parts are inside out.
    pub dropped_parts: Vec<DroppedPart>,
    /// `true` if it is an open sheet: thin, with a boundary, and covered once more by what closes it.
    pub sheet: bool,
    /// `true` if it was trimmed as an open surface, and not closed.
    pub trimmed: bool,
    /// Volume that it encloses once it is closed and turned; places that it goes around twice count twice.
    pub volume: f64,
    /// Assumptions about it, as sentences; empty for a clean solid.
    pub assumptions: Vec<String>,
    /// Reasons why the result is probably not what was meant, as sentences with a remedy.
    pub doubts: Vec<String>,
}

/// Report of a Boolean operation and of the properties of its result.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BooleanReport {
    /// One entry for each mesh, in their order.
    pub operands: Vec<OperandReport>,
    /// Meshes that the expression or their places made superfluous.
    pub pruned: Vec<u32>,
    /// Triangles of the result.
    pub triangles: u64,
    /// Those of them that are triangles of a mesh, whole and unchanged but for their direction.
    pub kept_triangles: u64,
    /// Pairs of triangles that cross or overlap.
    pub intersecting_pairs: u64,
    /// Rounds of repair after rounding to double precision; 0 if the rounded result was sound at once.
    pub repair_rounds: u32,
    /// The farthest that repair may have moved a vertex along an axis, beyond rounding to double precision.
    pub moved: f64,
    /// Largest change of a coordinate by rounding to [`BooleanParams::coordinates`]; 0 for double precision.
    pub rounded: f64,
    /// Vertices that were moved to give each a place of its own: see [`BooleanParams::separate`].
    pub separated: u64,
    /// Largest distance by which these were moved along an axis.
    pub separation: f64,
    /// Vertices that share the place of another although [`BooleanParams::separate`] asks for places of their own.
    pub shared_places: u64,
    /// Pairs of triangles of the result that meet where they should not: 0 unless repair failed.
    pub self_intersections: u64,
    /// `true` if the result is closed, manifold, consistently oriented and free of self-intersections, as a reader of a file with
    /// [`BooleanParams::coordinates`] and [`BooleanParams::separate`] sees it.
    pub solid: bool,
    /// `true` if the result is an open surface, trimmed by solids.
    pub trimmed: bool,
    /// Volume inside the result; 0 if it is an open surface.
    pub volume: f64,
    /// Area of the result.
    pub area: f64,
    /// Reasons why the result is probably not what was meant, as sentences with a remedy; those of the meshes are theirs.
    pub doubts: Vec<String>,
}

impl BooleanReport {
    /// Returns `true` if the result is a solid, nothing at all, or a trimmed surface, without self-intersections, and there is
    /// no doubt about it.
    #[must_use]
    pub fn passed(&self) -> bool {
        let is_sound = self.solid || self.triangles == 0 || self.trimmed;
        let doubts = self.operands.iter().map(|o| o.doubts.len()).sum::<usize>();
        is_sound && self.self_intersections == 0 && self.doubts.is_empty() && doubts == 0
    }
}

/// The result of an expression.
#[derive(Debug, Clone)]
pub struct Boolean {
    /// Its surface; triangles are counterclockwise seen from outside. Empty if nothing is inside.
    pub mesh: TriMesh,
    /// For each triangle where it comes from.
    pub origins: Vec<Origin>,
    /// Edges along which surfaces of the result were cut, as pairs of vertices.
    pub feature_edges: Vec<[u32; 2]>,
    /// Report on it.
    pub report: BooleanReport,
}

/// Why there is no result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BooleanError {
    /// The expression names a mesh that is not there.
    #[error("the expression names mesh {mesh}, but only {meshes} are given")]
    NoSuchMesh {
        /// The index that it names.
        mesh: usize,
        /// Number of meshes.
        meshes: usize,
    },
    /// A mesh cannot be put on a flat base.
    #[error(
        "mesh {mesh} is no relief, since seen along z its triangles face both ways: set `close` to lid or band"
    )]
    NotARelief {
        /// Index of the mesh.
        mesh: usize,
    },
    /// No open mesh can be trimmed.
    #[error(
        "nothing can be trimmed: `open` trim takes an open mesh in a difference or intersection with closed ones, as in sheet - solid"
    )]
    NothingToTrim,
    /// Coordinates are too large or too small for exact arithmetic.
    #[error(
        "mesh {mesh} has coordinates of up to {largest:e}, but exact arithmetic takes 1e-50 to 1e30: scale the meshes first"
    )]
    OutOfRange {
        /// Index of the mesh.
        mesh: usize,
        /// The largest coordinate by size.
        largest: f64,
    },
    /// More memory is needed than was allowed.
    #[error("this needs about {needed} bytes of memory, but only {allowed} are allowed")]
    OutOfMemory {
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        allowed: u64,
    },
    /// Coordinates exceed the range of 32-bit floats, which were asked for.
    #[error(
        "mesh {mesh} has coordinates of up to {largest:e}, beyond the range of 32-bit floats: scale it, or write a format with 64-bit \
         floats (PLY, OBJ, OFF, 3MF)"
    )]
    BeyondSinglePrecision {
        /// Index of the mesh.
        mesh: usize,
        /// The largest coordinate by size.
        largest: f64,
    },
    /// Every ray from a part of a surface meets an edge, so that it is not known what the part is in.
    #[error(
        "what lies around the part of a mesh at ({}, {}, {}) could not be decided: move or turn one of the meshes a little",
        at[0], at[1], at[2]
    )]
    Undecided {
        /// A place of that part.
        at: [f64; 3],
    },
    /// The caller cancelled.
    #[error("cancelled")]
    Cancelled,
}

impl From<ravec_progress::Cancelled> for BooleanError {
    fn from(_: ravec_progress::Cancelled) -> Self {
        Self::Cancelled
    }
}
