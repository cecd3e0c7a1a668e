//! The two-color pixel itself.

use crate::line::Line;
use ravec_raster::{LinearRgba, Oklab};

/// Light beyond this, either way, counts as not a number: squares of its Oklab color still fit an `f32`, and the
/// brightest file formats end at 65 504.
pub(crate) const MAX_LIGHT: f32 = 1e9;

/// A pixel as fits see it: one that is not a number counts as fully transparent.
#[inline(always)]
pub(crate) fn countable(pixel: LinearRgba) -> LinearRgba {
    if is_countable(pixel) {
        pixel
    } else {
        LinearRgba::default()
    }
}

/// Returns `true` if all four values are small enough to compute with.
#[inline(always)]
pub(crate) fn is_countable(pixel: LinearRgba) -> bool {
    pixel.0.iter().all(|v| v.abs() <= MAX_LIGHT)
}

/// A square block of an image, replaced by a line and the color on each side of it.
///
/// The line's origin is the center of the block, also where the image's border clips the block. A block without a line
/// is *flat*: both colors are the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoColorPixel {
    /// The line at which the colors meet, in pixels from the block's center; nothing for a flat block.
    pub line: Option<Line>,
    /// The colors of side 0 and side 1.
    pub colors: [Oklab; 2],
    /// The alphas of side 0 and side 1, 0 to 1.
    pub alphas: [f32; 2],
    /// The mean squared distance (Oklab, alpha-weighted) of the block's pixels from the color of their side.
    pub error: f32,
}

impl TwoColorPixel {
    /// A block of one color.
    pub fn flat(color: Oklab, alpha: f32, error: f32) -> Self {
        Self {
            line: None,
            colors: [color; 2],
            alphas: [alpha; 2],
            error,
        }
    }

    /// Returns `true` if the block has a single color.
    pub fn is_flat(&self) -> bool {
        self.line.is_none()
    }

    /// The Oklab distance between the two colors; 0 for a flat block.
    pub fn contrast(&self) -> f32 {
        let [c0, c1] = self.colors.map(|color| color.0);
        c0.iter()
            .zip(c1)
            .map(|(a, b)| (a - b) * (a - b))
            .sum::<f32>()
            .sqrt()
    }
}
