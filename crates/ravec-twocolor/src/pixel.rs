//! The two-color pixel itself.

use crate::line::Line;
use ravec_raster::{LinearRgba, Oklab};

/// Light beyond this, either way, counts as not a number: squares of its Oklab colour still fit an `f32`, and the
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

/// Whether all four values are numbers that can be reckoned with.
#[inline(always)]
pub(crate) fn is_countable(pixel: LinearRgba) -> bool {
    pixel.0.iter().all(|v| v.abs() <= MAX_LIGHT)
}

/// A square block of an image, replaced by a line and the colour on each side of it.
///
/// The line's origin is the centre of the block, also where the image's border clips the block. A block without a line
/// is *flat*: both colours are the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoColorPixel {
    /// Where the colours meet, in pixels from the block's centre; nothing for a flat block.
    pub line: Option<Line>,
    /// The colours of side 0 and side 1.
    pub colors: [Oklab; 2],
    /// The alphas of side 0 and side 1, 0 to 1.
    pub alphas: [f32; 2],
    /// The mean squared distance (Oklab, alpha-weighted) of the block's pixels from the colour of their side.
    pub error: f32,
}

impl TwoColorPixel {
    /// A block of one colour.
    pub fn flat(color: Oklab, alpha: f32, error: f32) -> Self {
        Self {
            line: None,
            colors: [color; 2],
            alphas: [alpha; 2],
            error,
        }
    }

    /// Whether the block has a single colour.
    pub fn is_flat(&self) -> bool {
        self.line.is_none()
    }

    /// The Oklab distance between the two colours; 0 for a flat block.
    pub fn contrast(&self) -> f32 {
        let [c0, c1] = self.colors.map(|color| color.0);
        c0.iter()
            .zip(c1)
            .map(|(a, b)| (a - b) * (a - b))
            .sum::<f32>()
            .sqrt()
    }
}
