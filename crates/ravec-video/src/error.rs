//! Errors of reading and writing clips.

use ravec_media::{EncodeError, ReadError, WriteError};
use ravec_memory::OverBudget;
use ravec_progress::Cancelled;
use ravec_raster::Size;
use std::io;

/// Why a clip could not be read or written. The path is named by the caller.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VideoError {
    /// The file system fails.
    #[error("{}", ravec_files::message_without_code(.0))]
    Io(#[from] io::Error),
    /// The file has no content.
    #[error("the file is empty")]
    Empty,
    /// The content is that of no known format.
    #[error(
        "the file is no clip in a known format (MP4, MOV, Y4M, GIF, APNG, numbered pictures, or what FFmpeg reads)"
    )]
    UnknownFormat,
    /// The extension of an output is that of no known format.
    #[error(
        "no video format has the extension `{extension}` (mp4, mov, y4m, gif, apng, a pattern such as frame_%04d.png, or what FFmpeg writes)"
    )]
    UnknownExtension {
        /// The extension, maybe empty.
        extension: String,
    },
    /// The file has sound or data, and no frames.
    #[error("the file has no video track ({tracks})")]
    NoVideo {
        /// Tracks that it has, such as `1 audio track`.
        tracks: String,
    },
    /// The file is damaged before the first frame.
    #[error("the file is damaged: {reason}")]
    Damaged {
        /// Reason, in a few words.
        reason: String,
    },
    /// A property of the file is not supported.
    #[error("{feature} is not supported{}", hint.as_ref().map(|hint| format!(": {hint}")).unwrap_or_default())]
    Unsupported {
        /// The property.
        feature: String,
        /// A way around it.
        hint: Option<String>,
    },
    /// A frame has more pixels than allowed.
    #[error(
        "a frame has {width} x {height} pixels, more than the limit of {limit} (raise `max_pixels`)"
    )]
    TooManyPixels {
        /// Columns.
        width: u64,
        /// Rows.
        height: u64,
        /// Allowed pixels.
        limit: u64,
    },
    /// The clip has more frames than allowed.
    #[error("the clip has more than {limit} frames (raise `max_frames`)")]
    TooManyFrames {
        /// Allowed frames.
        limit: u64,
    },
    /// Reading takes more memory than allowed.
    #[error("the frames need {} bytes, more than the limit of {} of which {} are in use (raise `max_bytes`)", .0.needed, .0.limit, .0.used)]
    OverBudget(#[from] OverBudget),
    /// A frame has another size than the first one.
    #[error("frame {frame} has {found} pixels, the frames before it {expected}")]
    SizeChanged {
        /// Number of the frame, from 0.
        frame: u64,
        /// Its size.
        found: Size,
        /// The size of the frames before it.
        expected: Size,
    },
    /// FFmpeg is needed and not installed.
    #[error(
        "{needed_for} needs FFmpeg, which was not found: install it, or name the program in the environment variable RAVEC_FFMPEG"
    )]
    FfmpegMissing {
        /// The format or codec.
        needed_for: String,
    },
    /// FFmpeg ended with an error.
    #[error("FFmpeg failed: {message}")]
    FfmpegFailed {
        /// The last line that it printed.
        message: String,
    },
    /// The options cannot be had together, or not in this format.
    #[error("{0}")]
    Options(String),
    /// A clip without frames was to be written.
    #[error("there are no frames to write")]
    NoFrames,
    /// A numbered picture cannot be read.
    #[error(transparent)]
    ReadPicture(#[from] ReadError),
    /// A numbered picture cannot be written.
    #[error(transparent)]
    WritePicture(#[from] WriteError),
    /// A picture cannot be encoded.
    #[error(transparent)]
    EncodePicture(#[from] EncodeError),
    /// The caller cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
