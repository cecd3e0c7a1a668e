//! A matte and what is known about it beforehand.

use ravec_progress::Cancelled;
use ravec_raster::{Image, Plane, Size};

/// sRGB-encoded colors, 0 to 1. Mattes are solved on encoded values: noise is about even there, and the values of files
/// need no conversion.
pub type Colors = Image<[f32; 3]>;

/// Alpha and the colors of the foreground.
#[derive(Debug, Clone, PartialEq)]
pub struct Matte {
    /// Share of the foreground in each pixel, 0 to 1.
    pub alpha: Plane,
    /// sRGB-encoded colors of the foreground, 0 to 1, without those of the background. Where alpha is 0 they continue the
    /// nearest foreground, or hold the colors of the picture.
    pub foreground: Colors,
}

/// Knowledge about a pixel from a trimap or strokes. An image holds it as a byte, see [`Self::of`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Constraint {
    /// Alpha is to be found.
    Unknown,
    /// Alpha is exactly 0.
    Background,
    /// Alpha is exactly 1.
    Foreground,
}

impl Constraint {
    /// Knowledge from the grey value of a trimap or a stroke: up to 63 background, from 192 foreground. JPEG and smooth
    /// borders leave room on both sides.
    pub fn of(value: u8) -> Self {
        match value {
            0..=63 => Self::Background,
            64..=191 => Self::Unknown,
            192.. => Self::Foreground,
        }
    }
}

/// Constraints of the pixels of a picture, as grey values that [`Constraint::of`] reads.
pub type Constraints = Image<u8>;

/// Reasons why there is no matte.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MattingError {
    /// Two images that belong together have different sizes.
    #[error("the {what} has {found} pixels, the picture has {expected}")]
    SizesDiffer {
        /// The image of the other size.
        what: &'static str,
        /// Its size.
        found: Size,
        /// The size that is needed.
        expected: Size,
    },
    /// A trimap or strokes lack one of the sides.
    #[error("no pixel is marked as {0}: mark at least one")]
    Unmarked(&'static str),
    /// A parameter is out of range.
    #[error("`{field}` is {value}, but must be {range}")]
    Parameter {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// Its range.
        range: &'static str,
    },
    /// The work was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
