//! The two-color pixel itself.

use crate::line::Line;
use ravec_raster::Oklab;

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
