//! Why an operation did not succeed, and the exit code that says so.

use ravec::boolean::{BooleanError, ParseExprError};
use ravec::completion::CompleteError;
use ravec::mesh::{ReadMeshError, WriteMeshError};
use ravec::offset::OffsetError;
use ravec::planar::{HomographyError, MatchError, ProportionError, SnapError};
use ravec::progress::Cancelled;
use ravec::raster::Size;
use ravec::retarget::RetargetError;
use ravec::twocolor::brush::StrokeError;
use ravec::twocolor::{EnlargeError, FitError, RenderError};
use ravec_catalogue::CatalogueError;
use ravec_media::{DecodeError, EncodeError, ReadError, WriteError};
use std::path::{Path, PathBuf};

/// Why an operation did not succeed. The message says what, where, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JobError {
    /// A parameter is out of its range.
    #[error("{name} is {value}, but must be {range}")]
    Parameter {
        /// The parameter, as its flag is called.
        name: &'static str,
        /// Requested value.
        value: String,
        /// Supported values.
        range: &'static str,
    },
    /// An input cannot be read or is no valid picture.
    #[error("cannot read {}: {}", input_name(.path), plain(.cause))]
    Read {
        /// The file; `-` is standard input.
        path: PathBuf,
        /// Description of the defect.
        cause: DecodeError,
    },
    /// Two inputs must have the same size and have not.
    #[error(
        "{} has {a_size} pixels and {} has {b_size}: give two pictures of the same size",
        input_name(.a),
        input_name(.b)
    )]
    SizesDiffer {
        /// The first file.
        a: PathBuf,
        /// Its size.
        a_size: Size,
        /// The second file.
        b: PathBuf,
        /// Its size.
        b_size: Size,
    },
    /// An output cannot be written.
    #[error("cannot write {}: {}", output_name(.path), plain(.cause))]
    Write {
        /// The file; `-` is standard output.
        path: PathBuf,
        /// Description of the defect.
        cause: EncodeError,
    },
    /// An output would take the place of an input.
    #[error("cannot write {}: it is an input, which stays as it is; choose another name", output_name(.path))]
    OverwritesInput {
        /// The file.
        path: PathBuf,
    },
    /// Two outputs would go to the same place.
    #[error("{} cannot take two outputs: give each its own file", output_name(.path))]
    OutputTwice {
        /// The file; `-` is standard output.
        path: PathBuf,
    },
    /// Two inputs would come from standard input.
    #[error("standard input can be read only once: give a file for the other input")]
    InputTwice,
    /// An input cannot be read or is no valid mesh.
    #[error("cannot read {}: {}", input_name(.path), read_reason(.cause))]
    ReadMesh {
        /// The file; `-` is standard input.
        path: PathBuf,
        /// Description of the defect.
        cause: ReadMeshError,
    },
    /// A mesh has no triangles where some are needed.
    #[error("cannot use {}: the mesh has no triangles", input_name(.path))]
    NoTriangles {
        /// The file; `-` is standard input.
        path: PathBuf,
    },
    /// A mesh cannot be written.
    #[error("cannot write {}: {}", output_name(.path), write_reason(.cause))]
    WriteMesh {
        /// The file; `-` is standard output.
        path: PathBuf,
        /// Description of the defect.
        cause: WriteMeshError,
    },
    /// The extension of an output does not say which format a mesh is to have.
    #[error(
        "cannot write {}: its extension does not name a mesh format; known are {}",
        output_name(.path),
        crate::mesh::known_extensions()
    )]
    UnknownMeshFormat {
        /// The file.
        path: PathBuf,
    },
    /// There is no such offset of a mesh.
    #[error("cannot offset {}: {cause}", input_name(.path))]
    Offset {
        /// The file; `-` is standard input.
        path: PathBuf,
        /// Why not.
        cause: OffsetError,
    },
    /// An expression over meshes cannot be read.
    #[error("cannot read the expression: {cause}\n{caret}")]
    Expression {
        /// Description of the defect.
        cause: ParseExprError,
        /// The expression, and a caret under the place.
        caret: String,
    },
    /// Meshes cannot be combined.
    #[error("cannot combine the meshes: {cause}")]
    Boolean {
        /// Why not.
        cause: BooleanError,
    },
    /// Two photos could not be laid on each other.
    #[error("cannot match {} with {}: {cause}", input_name(.first), input_name(.second))]
    NoMatch {
        /// The first photo; `-` is standard input.
        first: PathBuf,
        /// The second photo.
        second: PathBuf,
        /// Why not.
        cause: MatchError,
    },
    /// Four corners are no rectangle in perspective.
    #[error(
        "the corners of --quad are no rectangle in perspective: {cause}; give them in turn, around a convex shape"
    )]
    Quad {
        /// Why not.
        cause: HomographyError,
    },
    /// Four corners lie beside the picture.
    #[error("--quad is {quad}, which lies outside the picture of {size} pixels")]
    Outside {
        /// The corners.
        quad: String,
        /// The picture's size.
        size: Size,
    },
    /// The proportions of a rectangle are not known.
    #[error("cannot find the proportions of --quad: {cause} (--focal or --aspect)")]
    Proportions {
        /// Why not.
        cause: ProportionError,
    },
    /// A grid finds nothing to snap to.
    #[error("cannot snap on {}: {cause}", input_name(.path))]
    NoSnap {
        /// Input picture; `-` is standard input.
        path: PathBuf,
        /// Why not.
        cause: SnapError,
    },
    /// A hole cannot be filled.
    #[error("cannot complete {}: {cause}", input_name(.path))]
    Complete {
        /// Input picture; `-` is standard input.
        path: PathBuf,
        /// Why not.
        cause: CompleteError,
    },
    /// A picture cannot get another format.
    #[error("cannot retarget {}: {cause}", input_name(.path))]
    Retarget {
        /// Input picture; `-` is standard input.
        path: PathBuf,
        /// Why not.
        cause: RetargetError,
    },
    /// Strokes cannot be read or make no sense.
    #[error("cannot use the strokes in {}: {reason}", input_name(.path))]
    Strokes {
        /// The file.
        path: PathBuf,
        /// Description of the defect.
        reason: String,
    },
    /// Steps cannot be read or make no sense.
    #[error("cannot use the steps in {}: {reason}", input_name(.path))]
    Steps {
        /// The file.
        path: PathBuf,
        /// Description of the defect.
        reason: String,
    },
    /// Something cannot be done with a catalogue of photos.
    #[error(transparent)]
    Catalogue(CatalogueError),
    /// The fit refuses its input.
    #[error(transparent)]
    Fit(FitError),
    /// The rendering refuses its input.
    #[error(transparent)]
    Render(RenderError),
    /// The caller cancelled the work.
    #[error("interrupted; nothing half-written is left")]
    Cancelled,
}

impl JobError {
    /// The exit code of a program that ends with this error: 2 for a parameter, the extension of an output or files that
    /// get in each other's way, 3 for an input, 4 for an output, 130 for a cancellation, 1 for anything else.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Parameter { .. }
            | Self::OverwritesInput { .. }
            | Self::OutputTwice { .. }
            | Self::InputTwice
            | Self::UnknownMeshFormat { .. }
            | Self::Expression { .. }
            | Self::Quad { .. }
            | Self::Outside { .. }
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
            | Self::Write {
                cause: EncodeError::UnknownExtension | EncodeError::Quality { .. },
                ..
            } => 2,
            Self::Read { .. }
            | Self::ReadMesh { .. }
            | Self::NoTriangles { .. }
            | Self::Offset {
                cause: OffsetError::NotClosed { .. },
                ..
            }
            | Self::Boolean {
                cause: BooleanError::OutOfRange { .. },
            }
            | Self::SizesDiffer { .. }
            | Self::Complete { .. }
            | Self::Strokes { .. }
            | Self::Steps { .. } => 3,
            Self::Write { .. }
            | Self::WriteMesh { .. }
            | Self::Offset {
                cause: OffsetError::Storage { .. },
                ..
            } => 4,
            Self::Offset { .. }
            | Self::Boolean { .. }
            | Self::NoMatch { .. }
            | Self::Proportions { .. }
            | Self::NoSnap { .. }
            | Self::Retarget { .. }
            | Self::Fit(_)
            | Self::Render(_) => 1,
            Self::Catalogue(cause) => Self::catalogue_code(cause),
            Self::Cancelled => 130,
        }
    }
}

impl From<Cancelled> for JobError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<FitError> for JobError {
    fn from(error: FitError) -> Self {
        match error {
            FitError::Cancelled(_) => Self::Cancelled,
            other => Self::Fit(other),
        }
    }
}

impl From<EnlargeError> for JobError {
    fn from(error: EnlargeError) -> Self {
        match error {
            EnlargeError::Scale(error) => error.into(),
            EnlargeError::Fit(error) => error.into(),
            other => Self::Parameter {
                name: "--scale",
                value: other.to_string(),
                range: "smaller",
            },
        }
    }
}

impl JobError {
    /// Describes a defect in the strokes of a file.
    pub(crate) fn from_strokes(path: &Path, error: StrokeError) -> Self {
        match error {
            StrokeError::Cancelled(_) => Self::Cancelled,
            StrokeError::Fit(error) => error.into(),
            other => Self::Strokes {
                path: path.to_path_buf(),
                reason: other.to_string(),
            },
        }
    }
}

impl JobError {
    /// Why the picture in a file cannot get another format.
    pub(crate) fn from_retargeting(path: &Path, cause: RetargetError) -> Self {
        match cause {
            RetargetError::Cancelled(_) => Self::Cancelled,
            cause => Self::Retarget {
                path: path.to_path_buf(),
                cause,
            },
        }
    }

    /// Why a hole of the picture in a file cannot be filled.
    pub(crate) fn from_completing(path: &Path, cause: CompleteError) -> Self {
        match cause {
            CompleteError::Cancelled(_) => Self::Cancelled,
            cause => Self::Complete {
                path: path.to_path_buf(),
                cause,
            },
        }
    }
}

impl JobError {
    /// Classifies an error of reading a mesh file.
    pub(crate) fn from_reading(path: &Path, cause: ReadMeshError) -> Self {
        match cause {
            ReadMeshError::Cancelled => Self::Cancelled,
            cause => Self::ReadMesh {
                path: path.to_path_buf(),
                cause,
            },
        }
    }

    /// Classifies an error of writing a mesh file.
    pub(crate) fn from_writing(path: &Path, cause: WriteMeshError) -> Self {
        match cause {
            WriteMeshError::Cancelled => Self::Cancelled,
            cause => Self::WriteMesh {
                path: path.to_path_buf(),
                cause,
            },
        }
    }
}

impl JobError {
    /// Why there is no offset of the mesh in a file.
    pub(crate) fn from_offset(path: &Path, cause: OffsetError) -> Self {
        let path = path.to_path_buf();
        match cause {
            OffsetError::Cancelled(_) => Self::Cancelled,
            OffsetError::NoTriangles => Self::NoTriangles { path },
            cause => Self::Offset { path, cause },
        }
    }
}

impl From<RenderError> for JobError {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Cancelled(_) => Self::Cancelled,
            other => Self::Render(other),
        }
    }
}

impl From<ReadError> for JobError {
    fn from(ReadError { path, cause }: ReadError) -> Self {
        Self::Read { path, cause }
    }
}

impl From<WriteError> for JobError {
    fn from(WriteError { path, cause }: WriteError) -> Self {
        Self::Write { path, cause }
    }
}

/// That a file cannot be read is what the sentence says already.
fn read_reason(cause: &ReadMeshError) -> String {
    match cause {
        ReadMeshError::Io(cause) => plain(cause),
        cause => cause.to_string(),
    }
}

/// That a file cannot be written is what the sentence says already.
fn write_reason(cause: &WriteMeshError) -> String {
    match cause {
        WriteMeshError::Io(cause) => plain(cause),
        cause => cause.to_string(),
    }
}

/// A path that is read, for a message.
fn input_name(path: &Path) -> String {
    name(path, "standard input")
}

/// A path that is written, for a message.
fn output_name(path: &Path) -> String {
    name(path, "standard output")
}

fn name(path: &Path, stream: &str) -> String {
    if path.as_os_str() == "-" {
        stream.to_owned()
    } else {
        path.display().to_string()
    }
}

/// The message of an error without the number that the system has for it.
pub(crate) fn plain(cause: &impl std::fmt::Display) -> String {
    let text = cause.to_string();
    match text.rfind(" (os error ") {
        Some(at) if text.ends_with(')') => text[..at].to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;

    fn unreadable(cause: DecodeError) -> JobError {
        let path = PathBuf::from("a.png");
        JobError::from(ReadError { path, cause })
    }

    fn unwritable(path: &str, cause: EncodeError) -> JobError {
        let path = PathBuf::from(path);
        JobError::from(WriteError { path, cause })
    }

    #[test]
    fn each_error_has_its_code_and_one_sentence() {
        let size = |width| Size::new(width, 1).unwrap();
        let no_file = io::Error::from_raw_os_error(2);
        let cases = [
            (
                JobError::Parameter {
                    name: "--width",
                    value: "0".to_owned(),
                    range: "1 to 65535",
                },
                2,
                "--width is 0, but must be 1 to 65535",
            ),
            (
                unreadable(DecodeError::Empty),
                3,
                "cannot read a.png: the file is empty",
            ),
            (
                unreadable(no_file.into()),
                3,
                "cannot read a.png: No such file or directory",
            ),
            (
                JobError::SizesDiffer {
                    a: "a".into(),
                    a_size: size(1),
                    b: "-".into(),
                    b_size: size(2),
                },
                3,
                "a has 1 x 1 pixels and standard input has 2 x 1: give two pictures of the same size",
            ),
            (
                unwritable("a.png", io::Error::other("disk full").into()),
                4,
                "cannot write a.png: disk full",
            ),
            (
                unwritable("a.jpg", EncodeError::Quality { quality: 0 }),
                2,
                "cannot write a.jpg: JPEG quality is 1 to 100, not 0",
            ),
            (
                unwritable("-", io::Error::other("no reader").into()),
                4,
                "cannot write standard output: no reader",
            ),
            (
                JobError::OverwritesInput {
                    path: "a.png".into(),
                },
                2,
                "cannot write a.png: it is an input, which stays as it is; choose another name",
            ),
            (
                JobError::OutputTwice { path: "-".into() },
                2,
                "standard output cannot take two outputs: give each its own file",
            ),
            (
                JobError::InputTwice,
                2,
                "standard input can be read only once: give a file for the other input",
            ),
            (
                JobError::from_reading(Path::new("a.stl"), ReadMeshError::Empty),
                3,
                "cannot read a.stl: the file is empty",
            ),
            (
                JobError::from_reading(Path::new("a.stl"), io::Error::from_raw_os_error(2).into()),
                3,
                "cannot read a.stl: No such file or directory",
            ),
            (
                JobError::NoTriangles { path: "-".into() },
                3,
                "cannot use standard input: the mesh has no triangles",
            ),
            (
                JobError::from_writing(Path::new("-"), io::Error::other("disk full").into()),
                4,
                "cannot write standard output: disk full",
            ),
            (
                JobError::UnknownMeshFormat {
                    path: "a.png".into(),
                },
                2,
                "cannot write a.png: its extension does not name a mesh format; known are .stl, .ply, .obj, .off, .3mf, \
                 .glb, .gltf",
            ),
            (
                JobError::NoMatch {
                    first: "a".into(),
                    second: "b".into(),
                    cause: MatchError::TooFewMatches { matches: 2 },
                },
                1,
                "cannot match a with b: only 2 features of the photos match, too few to trust",
            ),
            (
                JobError::from_offset(Path::new("a"), OffsetError::NoTriangles),
                3,
                "cannot use a: the mesh has no triangles",
            ),
            (
                JobError::from_offset(Path::new("a"), OffsetError::Distance { got: -1.0 }),
                2,
                "cannot offset a: the distance is -1, but must be a number above 0",
            ),
            (
                JobError::from_offset(Path::new("a"), OffsetError::NotClosed { boundary_edges: 4 }),
                3,
                "cannot offset a: the mesh is not closed (4 boundary edges), so it has no inside: choose side both or \
                 outer, or close it first",
            ),
            (
                JobError::from_offset(Path::new("a"), OffsetError::Empty { distance: 9.0 }),
                1,
                "cannot offset a: no point of that side is 9 away from the mesh: choose a smaller distance",
            ),
            (
                JobError::from_offset(Path::new("a"), OffsetError::Cancelled(Cancelled)),
                130,
                "interrupted; nothing half-written is left",
            ),
            (
                JobError::from_reading(Path::new("a"), ReadMeshError::Cancelled),
                130,
                "interrupted; nothing half-written is left",
            ),
            (
                Cancelled.into(),
                130,
                "interrupted; nothing half-written is left",
            ),
        ];
        for (error, code, sentence) in cases {
            assert_eq!(error.to_string(), sentence);
            assert_eq!(error.exit_code(), code, "{sentence}");
        }
    }
}
