//! Why a mesh file was not read or written.

use std::fmt;
use std::io;

use ravec_memory::OverBudget;
use ravec_mesh::{RowsError, WeldError};
use ravec_progress::Cancelled;

use crate::MeshFormat;

/// Place in a file, in the form in which a person looks it up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// A line of a text file, counted from 1.
    Line(u64),
    /// A byte of a binary file (or of an entry unpacked from an archive), counted from 0.
    Byte(u64),
    /// An item of a list inside the file, counted from 0.
    Item {
        /// Kind of the elements of the list.
        of: &'static str,
        /// Index of the element.
        index: u64,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
            Self::Item { of, index } => write!(f, "{of} {index}"),
        }
    }
}

/// Why a file could not be read as a mesh.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadMeshError {
    /// The bytes could not be had.
    #[error("the file cannot be read: {0}")]
    Io(io::Error),
    /// There are no bytes.
    #[error("the file is empty")]
    Empty,
    /// The first bytes are those of no format that is read here.
    #[error(
        "this does not look like a mesh file: the formats read are STL, PLY, OBJ, OFF, 3MF, GLB and glTF"
    )]
    UnknownFormat,
    /// The file breaks the rules of its format.
    #[error("{format}, {place}: {what}")]
    Syntax {
        /// The format it was read as.
        format: MeshFormat,
        /// Place in the file.
        place: Place,
        /// Description of the defect.
        what: String,
    },
    /// The file ends too early.
    #[error(
        "{format}: the file ends at {place}, in the middle of {inside}; it is cut off, get it again from where it came"
    )]
    Truncated {
        /// The format it was read as.
        format: MeshFormat,
        /// Place of the end.
        place: Place,
        /// The incomplete structure.
        inside: String,
    },
    /// A coordinate is infinite or not a number.
    #[error(
        "{format}, {place}: vertex {vertex} is at ({}, {}, {}), which is not a place; repair or remove it",
        at[0], at[1], at[2]
    )]
    NotFinite {
        /// The format it was read as.
        format: MeshFormat,
        /// Place in the file.
        place: Place,
        /// The vertex, counted from 0 in the order of the file.
        vertex: u64,
        /// Its coordinates.
        at: [f64; 3],
    },
    /// A face names a vertex that does not exist.
    #[error(
        "{format}, {place}: a face has vertex {index} for a corner, but there are only {vertices} vertices"
    )]
    NoSuchVertex {
        /// The format it was read as.
        format: MeshFormat,
        /// Place in the file.
        place: Place,
        /// The index as it stands in the file.
        index: i64,
        /// Number of vertices.
        vertices: u64,
    },
    /// The file holds more than the caller allows.
    #[error("the file has more than {limit} {what} (raise `max_{what}`)")]
    TooMany {
        /// `"triangles"` or `"vertices"`: which of the limits.
        what: &'static str,
        /// The limit.
        limit: u64,
    },
    /// Reading takes more memory than the caller allows.
    #[error(
        "reading the file takes {} bytes of memory or more, and the limit is {} for all files together (raise `max_bytes`)",
        .0.used.saturating_add(.0.needed), .0.limit
    )]
    OverBudget(OverBudget),
    /// The file is right but uses a feature that is not read here.
    #[error("{format}: {what}")]
    Unsupported {
        /// The format it was read as.
        format: MeshFormat,
        /// The unsupported feature, and advice.
        what: String,
    },
    /// The caller does not want the mesh any more.
    #[error("cancelled")]
    Cancelled,
}

impl ReadMeshError {
    pub(super) fn syntax(format: MeshFormat, place: Place, what: impl Into<String>) -> Self {
        Self::Syntax {
            format,
            place,
            what: what.into(),
        }
    }
}

impl From<io::Error> for ReadMeshError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<OverBudget> for ReadMeshError {
    fn from(over: OverBudget) -> Self {
        Self::OverBudget(over)
    }
}

impl From<WeldError> for ReadMeshError {
    fn from(error: WeldError) -> Self {
        match error {
            WeldError::OverBudget(over) => Self::OverBudget(over),
            WeldError::Cancelled(_) => Self::Cancelled,
        }
    }
}

impl From<Cancelled> for ReadMeshError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

/// Why a mesh could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteMeshError {
    /// The bytes could not be put where they belong.
    #[error("the file cannot be written: {0}")]
    Io(io::Error),
    /// A coordinate does not fit the 32-bit floats of the format.
    #[error(
        "{format} holds 32-bit floats, and vertex {vertex} at {value} is beyond them; scale the mesh or choose PLY, OBJ or OFF"
    )]
    BeyondF32 {
        /// The format.
        format: MeshFormat,
        /// Index of the vertex.
        vertex: usize,
        /// The coordinate.
        value: f64,
    },
    /// The mesh is too large for the counters of the format.
    #[error("{format} cannot hold a file of {bytes} bytes; choose PLY")]
    TooLarge {
        /// The format.
        format: MeshFormat,
        /// Size of the file.
        bytes: u64,
    },
    /// The caller does not want the file any more.
    #[error("cancelled")]
    Cancelled,
}

impl From<io::Error> for WriteMeshError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<RowsError> for WriteMeshError {
    fn from(error: RowsError) -> Self {
        match error {
            RowsError::Io(error) => Self::Io(error),
            RowsError::Cancelled => Self::Cancelled,
            // only a visitor stops a walk, and the writers know why theirs did
            other => Self::Io(io::Error::other(other)),
        }
    }
}

impl From<Cancelled> for WriteMeshError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
