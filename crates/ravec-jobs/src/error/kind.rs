//! The kinds of errors, by which a program chooses its exit code or a language its exception.

use super::JobError;
use ravec::boolean::BooleanError;
use ravec::completion::CompleteError;
use ravec::mesh_io::{ReadMeshError, WriteMeshError};
use ravec::offset::OffsetError;
use ravec::planar::track::TrackError;
use ravec::retarget::RetargetError;
use ravec_catalogue::CatalogueError;
use ravec_media::{DecodeError, EncodeError};
use ravec_video::VideoError;
use std::io;

/// The part of a run that an error is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ErrorKind {
    /// The request: a parameter, the extension of an output, or files that get in each other's way.
    Request,
    /// An input: it cannot be read, is invalid, or exceeds a limit.
    Input,
    /// An output: it cannot be written.
    Output,
    /// The operation: no result for valid inputs.
    Failure,
    /// The caller cancelled the run.
    Cancelled,
}

impl JobError {
    /// The kind of the error of the system behind this one, such as a file that is not there; [`io::ErrorKind::OutOfMemory`] where memory
    /// was lacking. `None` if the reason is another one.
    pub fn io_kind(&self) -> Option<io::ErrorKind> {
        match self {
            Self::Read {
                cause: DecodeError::Io(error),
                ..
            }
            | Self::Write {
                cause: EncodeError::Io(error),
                ..
            }
            | Self::ReadClip {
                cause: VideoError::Io(error),
                ..
            }
            | Self::WriteClip {
                cause: VideoError::Io(error),
                ..
            }
            | Self::ReadMesh {
                cause: ReadMeshError::Io(error),
                ..
            }
            | Self::WriteMesh {
                cause: WriteMeshError::Io(error),
                ..
            } => Some(error.kind()),
            Self::Read {
                cause: DecodeError::OutOfMemory { .. } | DecodeError::TooManyBytes { .. },
                ..
            }
            | Self::ReadClip {
                cause: VideoError::OverBudget(_),
                ..
            }
            | Self::ReadMesh {
                cause: ReadMeshError::OverBudget(_),
                ..
            }
            | Self::Boolean {
                cause: BooleanError::OutOfMemory { .. },
            } => Some(io::ErrorKind::OutOfMemory),
            Self::Step { cause, .. } => cause.io_kind(),
            _ => None,
        }
    }

    /// The kind of the error.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Parameter { .. }
            | Self::Device { .. }
            | Self::Missing { .. }
            | Self::ResultSize { .. }
            | Self::NameTwice { .. }
            | Self::NotInMemory { .. }
            | Self::Simplify { .. }
            | Self::RenderMesh { .. }
            | Self::OverwritesInput { .. }
            | Self::OutputTwice { .. }
            | Self::InputTwice
            | Self::UnknownMeshFormat { .. }
            | Self::Expression { .. }
            | Self::Quad { .. }
            | Self::Outside { .. }
            | Self::Correct { .. }
            | Self::Track {
                cause: TrackError::Quad(_),
                ..
            }
            | Self::Offset {
                cause:
                    OffsetError::Distance { .. }
                    | OffsetError::DistanceSize { .. }
                    | OffsetError::DistanceTooSmall { .. }
                    | OffsetError::Tolerance { .. }
                    | OffsetError::SinglePrecision { .. }
                    | OffsetError::BeyondSinglePrecision
                    | OffsetError::NormalDeviation { .. },
                ..
            }
            | Self::Boolean {
                cause: BooleanError::NothingToTrim,
            }
            | Self::Complete {
                cause:
                    CompleteError::QuadCrosses { .. }
                    | CompleteError::Plane { .. }
                    | CompleteError::PlaneOutside { .. }
                    | CompleteError::Radius { .. }
                    | CompleteError::Fragment { .. },
                ..
            }
            | Self::Retarget {
                cause: RetargetError::Parameter { .. } | RetargetError::Factor { .. },
                ..
            }
            | Self::WriteClip {
                cause: VideoError::UnknownExtension { .. } | VideoError::Options(_),
                ..
            }
            | Self::Write {
                cause: EncodeError::UnknownExtension | EncodeError::Quality { .. },
                ..
            } => ErrorKind::Request,
            Self::Read { .. }
            | Self::ReadClip { .. }
            | Self::EmptyRange { .. }
            | Self::ReadMesh { .. }
            | Self::NoTriangles { .. }
            | Self::Offset {
                cause: OffsetError::NotClosed { .. },
                ..
            }
            | Self::Boolean {
                cause: BooleanError::OutOfRange { .. } | BooleanError::NotARelief { .. },
            }
            | Self::SizesDiffer { .. }
            | Self::Complete { .. }
            | Self::ClipTooShort { .. }
            | Self::Strokes { .. }
            | Self::TrackFile { .. }
            | Self::Track {
                cause: TrackError::MaskSize { .. },
                ..
            }
            | Self::Steps { .. }
            | Self::Recipe { .. }
            | Self::NoIntermediate { .. } => ErrorKind::Input,
            Self::Write { .. }
            | Self::WriteClip { .. }
            | Self::WriteMesh { .. }
            | Self::Offset {
                cause: OffsetError::Storage { .. },
                ..
            } => ErrorKind::Output,
            Self::Offset { .. }
            | Self::Boolean { .. }
            | Self::NoMatch { .. }
            | Self::Proportions { .. }
            | Self::NoSnap { .. }
            | Self::Track { .. }
            | Self::TrackLost { .. }
            | Self::Photo { .. }
            | Self::Retarget { .. }
            | Self::Fit(_)
            | Self::Filter(_)
            | Self::Shot(_)
            | Self::Render(_) => ErrorKind::Failure,
            Self::Catalogue(cause) => catalogue_kind(cause),
            Self::Step { cause, .. } => cause.kind(),
            Self::Cancelled => ErrorKind::Cancelled,
        }
    }
}

fn catalogue_kind(cause: &CatalogueError) -> ErrorKind {
    match cause {
        CatalogueError::TooLarge { .. }
        | CatalogueError::TooManyPixels { .. }
        | CatalogueError::NoThirds { .. }
        | CatalogueError::NoGrid
        | CatalogueError::NoSuchTile { .. }
        | CatalogueError::NoSuchPlace { .. }
        | CatalogueError::PinnedTwice { .. }
        | CatalogueError::PinnedAndBanned { .. }
        | CatalogueError::Protected { .. } => ErrorKind::Request,
        CatalogueError::Change { .. } | CatalogueError::Busy { writing: true, .. } => {
            ErrorKind::Output
        }
        CatalogueError::Choose(_)
        | CatalogueError::NothingLeft { .. }
        | CatalogueError::Piece { .. }
        | CatalogueError::Threads { .. } => ErrorKind::Failure,
        CatalogueError::Write(error) if matches!(error.cause, EncodeError::UnknownExtension) => {
            ErrorKind::Request
        }
        _ => ErrorKind::Input,
    }
}
