//! A shot edited like one picture: background plates, removal, replacement, enhancement, paste.
//!
//! A plane that is tracked through a shot makes of each edit one on a picture: with the map to each frame, the frames lie on the plane
//! one above the other.
//!
//! | task | start at |
//! | --- | --- |
//! | a picture of the background without what moves before it | [`PlateSamples`] |
//! | one plate of several planes | [`plate_regions`], [`joined_plate`] |
//! | strokes of a few frames in all of them | [`CarriedStroke`] |
//! | a frame without its foreground | [`Removal`] |
//! | the foreground as a layer, over another background or in another clip | [`Layer`] |
//! | another background, as frames show it | [`Backdrop`] |
//! | a soft frame with the detail of a photo | [`Enhancement`], [`Tone`] |
//!
//! ```
//! use ravec_planar::Homography;
//! use ravec_progress::Progress;
//! use ravec_raster::{Image, Size, SizeError};
//! use ravec_video_edit::{Colors, PlateSamples, ShotFrame};
//!
//! // a wall, and a bar that passes
//! let size = Size::new(64, 48)?;
//! let wall = |col: usize, row: usize| [0.5 + 0.2 * (0.3 * col as f32).sin(), 0.4, 0.3 + 0.004 * row as f32];
//! let frame = |index: usize| -> Colors {
//!     Image::from_fn(size, |col, row| {
//!         if (6 * index..6 * index + 8).contains(&col) { [0.9, 0.1, 0.1] } else { wall(col, row) }
//!     })
//! };
//! let mut samples = PlateSamples::new(size, 0, Some(9))?;
//! for index in 0..9 {
//!     samples.add(&ShotFrame::new(&frame(index), &Homography::IDENTITY))?;
//! }
//! let mut modes = samples.modes(&Progress::none())?;
//! for index in 0..9 {
//!     modes.add(&ShotFrame::new(&frame(index), &Homography::IDENTITY))?;
//! }
//! let plate = modes.plate();
//! assert!((plate.colors[(20, 20)][0] - wall(20, 20)[0]).abs() < 0.01);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Conventions
//!
//! - Colors are sRGB-encoded, 0 to 1 ([`Colors`]), as files hold them: noise is about even there, and no light is lost by conversions.
//! - Maps lead from the reference frame to a frame; pixel centers are at half-integers.
//! - Alpha is the share of foreground, 0 to 1.
//!
//! # Guarantees
//!
//! - The same input gives the same bytes on any number of threads; work runs in the caller's `rayon` pool.
//! - A layer over its own background is the frame; a removal leaves pixels far from the foreground as they are.
//! - Memory is bounded by the size of a frame, whatever the length of the shot.
//!
//! # Not guaranteed
//!
//! - Foreground that covers a place in most frames is on the plate unless it is marked.
//! - Colors that a background has only where foreground covers it most of the time may be taken for foreground.
//!
//! # Sources
//!
//! Pavić et al., *2D video editing for 3D effects*, 2008.

mod backdrop;
mod enhance;
mod exposure;
mod grain;
mod interpolated;
mod layer;
mod plate;
mod removal;
mod strokes;

pub use backdrop::Backdrop;
pub use enhance::{Enhancement, Tone};
pub use exposure::Exposure;
pub use interpolated::Interpolator;
pub use layer::{Layer, contact_shadow};
pub use plate::{Plate, PlateModes, PlateSamples, ShotFrame, joined_plate, plate_regions};
pub use removal::Removal;
pub use strokes::{CarriedStroke, StrokeFollower};

use ravec_progress::Cancelled;
use ravec_raster::{Image, Size, SizeError};

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
    /// A picture with its border is larger than an image may be.
    #[error(transparent)]
    Size(#[from] SizeError),
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
