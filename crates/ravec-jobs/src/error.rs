//! Why an operation did not succeed.

mod kind;
#[cfg(test)]
mod tests;

pub use kind::ErrorKind;

use ravec::boolean::{BooleanError, ParseExprError};
use ravec::completion::CompleteError;
use ravec::matting::MattingError;
use ravec::mesh::SimplifyError;
use ravec::mesh_io::{
    MeshFormat, ReadMeshError, ReadMeshFileError, UnknownMeshExtension, WriteMeshError,
    WriteMeshFileError,
};
use ravec::offset::OffsetError;
use ravec::planar::track::{CorrectError, PhotoError, TrackError};
use ravec::planar::{HomographyError, MatchError, ProportionError, SnapError};
use ravec::progress::Cancelled;
use ravec::raster::Size;
use ravec::retarget::RetargetError;
use ravec::twocolor::brush::StrokeError;
use ravec::twocolor::{EnlargeError, FilterError, FitError, RenderError};
use ravec::video_edit::VideoEditError;
use ravec_catalogue::CatalogueError;
pub(crate) use ravec_files::message_without_code as plain;
use ravec_media::{DecodeError, EncodeError, ReadError, WriteError};
use ravec_video::VideoError;
use std::path::{Path, PathBuf};

/// Why an operation did not succeed. The message says what, where, and what to do.
///
/// Messages name fields of an operation, of its parameters and of the [`Context`](crate::Context) in backquotes, as in
/// `` `size` is 65, but must be 2 to 64 ``, so that a program can show the names of its own flags or widgets instead.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JobError {
    /// A parameter is out of its range.
    #[error("`{field}` is {value}, but must be {range}")]
    Parameter {
        /// The field of the operation or of its parameters.
        field: &'static str,
        /// Requested value.
        value: String,
        /// Supported values.
        range: &'static str,
    },
    /// A field, or one of several, must be given and is not.
    #[error("{} is missing: {expected}", alternatives(.fields))]
    Missing {
        /// The fields, of which at least one must be given.
        fields: &'static [&'static str],
        /// Description of the value.
        expected: &'static str,
    },
    /// A result would have too many pixels.
    #[error(
        "the result would have {width:.0} x {height:.0} pixels, which is beyond `max_pixels`: {remedy}"
    )]
    ResultSize {
        /// Columns.
        width: f64,
        /// Rows.
        height: f64,
        /// Parameters to change.
        remedy: &'static str,
    },
    /// There is no such device, or it cannot be used.
    #[error("{cause}")]
    Device {
        /// Description of the problem, with its remedy.
        cause: String,
    },
    /// Two meshes of an expression have the same name.
    #[error("two meshes are named {name}: give each its own name")]
    NameTwice {
        /// The name.
        name: String,
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
    /// An input cannot be read or is no clip.
    #[error("cannot read {}: {cause}", input_name(.path))]
    ReadClip {
        /// The file; `-` is standard input.
        path: PathBuf,
        /// Description of the defect.
        cause: VideoError,
    },
    /// A clip cannot be written.
    #[error("cannot write {}: {cause}", output_name(.path))]
    WriteClip {
        /// The file; `-` is standard output.
        path: PathBuf,
        /// Description of the defect.
        cause: VideoError,
    },
    /// A clip has no frames in a range.
    #[error("{} has no frames in the range {range}: `ravec video info` says how many it has", input_name(.path))]
    EmptyRange {
        /// The file; `-` is standard input.
        path: PathBuf,
        /// The range.
        range: String,
    },
    /// A recipe cannot be read or is invalid.
    #[error("cannot use the recipe in {}: {reason}", input_name(.path))]
    Recipe {
        /// The file; `-` is standard input.
        path: PathBuf,
        /// Description of the defect.
        reason: String,
    },
    /// A step of a recipe failed.
    #[error("step {step}: {cause}")]
    Step {
        /// The number of the step, from 1.
        step: usize,
        /// Error of the step.
        cause: Box<JobError>,
    },
    /// An intermediate result is not there, or is of another kind.
    #[error("{} is not {expected}", .path.display())]
    NoIntermediate {
        /// The name, such as `@wide`.
        path: PathBuf,
        /// Description of the expected value.
        expected: &'static str,
    },
    /// An output cannot stay in memory.
    #[error("{} cannot stay in memory: this operation writes it piece by piece; give a file", .path.display())]
    NotInMemory {
        /// The name, such as `@wide`.
        path: PathBuf,
    },
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
        MeshFormat::known_extensions()
    )]
    UnknownMeshFormat {
        /// The file.
        path: PathBuf,
    },
    /// A mesh cannot be rendered with the parameters.
    #[error("cannot render the mesh: {cause}")]
    RenderMesh {
        /// Why not.
        cause: ravec::mesh_render::RenderError,
    },
    /// A mesh cannot be simplified.
    #[error("cannot simplify {}: {cause}", input_name(.path))]
    Simplify {
        /// The file; `-` is standard input.
        path: PathBuf,
        /// Why not.
        cause: SimplifyError,
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
        "the corners of `quad` are no rectangle in perspective: {cause}; give them in turn, around a convex shape"
    )]
    Quad {
        /// Why not.
        cause: HomographyError,
    },
    /// Four corners lie beside the picture.
    #[error("`quad` is {quad}, which lies outside the picture of {size} pixels")]
    Outside {
        /// The corners.
        quad: String,
        /// The picture's size.
        size: Size,
    },
    /// The proportions of a rectangle are not known.
    #[error("cannot find the proportions of `quad`: {cause} (`focal` or `aspect`)")]
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
    /// A plane cannot be tracked.
    #[error("cannot track {}: {cause}", input_name(.path))]
    Track {
        /// The clip.
        path: PathBuf,
        /// Why not.
        cause: TrackError,
    },
    /// A plane is not found in any frame but the reference.
    #[error(
        "cannot track {}: the plane is lost in all frames but the reference; give another `reference`, or corners with more texture",
        input_name(.path)
    )]
    TrackLost {
        /// The clip.
        path: PathBuf,
    },
    /// A track cannot be read, or is none of the clip.
    #[error("cannot use the track in {}: {reason}", input_name(.path))]
    TrackFile {
        /// The file.
        path: PathBuf,
        /// Description of the defect.
        reason: String,
    },
    /// A photo has no place on the plane.
    #[error("cannot lay {} on the plane: {cause}", input_name(.path))]
    Photo {
        /// The photo; `-` is standard input.
        path: PathBuf,
        /// Why not.
        cause: PhotoError,
    },
    /// Corners corrected by hand make no sense.
    #[error("cannot apply `corrections`: {cause}")]
    Correct {
        /// Why not.
        cause: CorrectError,
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
    /// An operator refuses its input.
    #[error(transparent)]
    Filter(FilterError),
    /// The rendering refuses its input.
    #[error(transparent)]
    Render(RenderError),
    /// A clip or matte that belongs to another clip has fewer frames.
    #[error("{} ends before frame {frame} of the clip that it belongs to", path.display())]
    ClipTooShort {
        /// The clip that ends.
        path: PathBuf,
        /// The first frame that it lacks.
        frame: u64,
    },
    /// The frames of a shot do not go together.
    #[error(transparent)]
    Shot(VideoEditError),
    /// The caller cancelled the work.
    #[error("interrupted; nothing half-written is left")]
    Cancelled,
}

impl From<MattingError> for JobError {
    fn from(error: MattingError) -> Self {
        match error {
            MattingError::Cancelled(_) => Self::Cancelled,
            MattingError::Parameter {
                field,
                value,
                range,
            } => Self::Parameter {
                field,
                value: value.to_string(),
                range,
            },
            MattingError::Unmarked(side) => Self::Parameter {
                field: "trimap",
                value: format!("without {side}"),
                range: "with pixels of foreground and of background, as strokes do",
            },
            other => Self::Parameter {
                field: "plate",
                value: other.to_string(),
                range: "of the size of the frames",
            },
        }
    }
}

impl From<VideoEditError> for JobError {
    fn from(error: VideoEditError) -> Self {
        match error {
            VideoEditError::Cancelled(_) => Self::Cancelled,
            other => Self::Shot(other),
        }
    }
}

impl JobError {
    /// The error of a step of a recipe. A cancellation is one wherever it comes from.
    pub(crate) fn in_step(self, step: usize) -> Self {
        match self {
            Self::Cancelled => Self::Cancelled,
            cause => Self::Step {
                step,
                cause: Box::new(cause),
            },
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

impl From<FilterError> for JobError {
    fn from(error: FilterError) -> Self {
        match error {
            FilterError::Cancelled(_) => Self::Cancelled,
            other => Self::Filter(other),
        }
    }
}

impl From<EnlargeError> for JobError {
    fn from(error: EnlargeError) -> Self {
        match error {
            EnlargeError::Scale(error) => error.into(),
            EnlargeError::Filter(error) => error.into(),
            other => Self::Parameter {
                field: "scale",
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
            StrokeError::Filter(error) => error.into(),
            other => Self::Strokes {
                path: path.to_path_buf(),
                reason: other.to_string(),
            },
        }
    }
}

impl JobError {
    /// Why the picture in a file cannot get another format.
    pub fn from_retargeting(path: &Path, cause: RetargetError) -> Self {
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

impl From<ReadMeshFileError> for JobError {
    fn from(error: ReadMeshFileError) -> Self {
        match error {
            ReadMeshFileError {
                cause: ReadMeshError::Cancelled,
                ..
            } => Self::Cancelled,
            ReadMeshFileError { path, cause } => Self::ReadMesh { path, cause },
        }
    }
}

impl From<WriteMeshFileError> for JobError {
    fn from(error: WriteMeshFileError) -> Self {
        match error {
            WriteMeshFileError {
                cause: WriteMeshError::Cancelled,
                ..
            } => Self::Cancelled,
            WriteMeshFileError { path, cause } => Self::WriteMesh { path, cause },
        }
    }
}

impl From<UnknownMeshExtension> for JobError {
    fn from(UnknownMeshExtension { path }: UnknownMeshExtension) -> Self {
        Self::UnknownMeshFormat { path }
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

/// Fields in backquotes, as alternatives.
fn alternatives(fields: &[&str]) -> String {
    let quoted: Vec<_> = fields.iter().map(|field| format!("`{field}`")).collect();
    quoted.join(" or ")
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
