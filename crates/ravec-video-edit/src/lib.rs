//! A shot edited like one picture: background plates, removal, replacement, enhancement, paste.

mod enhance;
mod exposure;
mod grain;
mod interpolated;
mod layer;
mod plate;
mod removal;

pub use enhance::{Enhancement, Tone};
pub use exposure::Exposure;
pub use interpolated::interpolated;
pub use layer::{Layer, contact_shadow};
pub use plate::{Plate, PlateModes, PlateSamples, ShotFrame};
pub use removal::Removal;

use ravec_progress::Cancelled;
use ravec_raster::{Image, Size};

/// sRGB-encoded colors, 0 to 1.
pub type Colors = Image<[f32; 3]>;

/// Reasons why a shot is not edited.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VideoEditError {
    /// Images that belong together differ in size.
    #[error("an image has {found} pixels, the frame has {expected}")]
    SizesDiffer {
        /// Size of the image.
        found: Size,
        /// Size of the frame.
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

fn same_size(found: Size, expected: Size) -> Result<(), VideoEditError> {
    if found == expected {
        return Ok(());
    }
    Err(VideoEditError::SizesDiffer { found, expected })
}
