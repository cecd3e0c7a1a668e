//! A shot edited like one picture: background plates, removal, replacement, enhancement, paste.

mod exposure;
mod plate;

pub use exposure::Exposure;
pub use plate::{Plate, PlateModes, PlateSamples, ShotFrame};

use ravec_progress::Cancelled;
use ravec_raster::{Image, Size};

/// sRGB-encoded colors, 0 to 1.
pub type Colors = Image<[f32; 3]>;

/// Reasons why a shot is not edited.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VideoEditError {
    /// A frame differs in size from the first one.
    #[error("a frame has {found} pixels, the first one has {expected}")]
    SizesDiffer {
        /// Size of the frame.
        found: Size,
        /// Size of the first frame.
        expected: Size,
    },
    /// A plate would be larger than an image may be.
    #[error("a plate of {frame} and {pad_px} pixels more on each side is too large")]
    PlateTooLarge {
        /// Size of the frames.
        frame: Size,
        /// Pixels on each side.
        pad_px: usize,
    },
    /// There is no frame.
    #[error("there are no frames")]
    NoFrames,
    /// The work was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
