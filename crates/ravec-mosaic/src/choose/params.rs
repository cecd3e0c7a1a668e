//! Parameters of a choice.

use crate::descriptor::Weights;

/// Comparison of tiles through which an edge runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Features {
    /// The highest total degree that counts, 0 to [`MAX_DEGREE`](crate::MAX_DEGREE); all degrees count as much as color.
    pub degree: usize,
    /// Weight of such a tile against others, above 0. More keeps its structure where neighbors make up for one another,
    /// and gives it the photos that others want as well.
    pub weight: f64,
}

/// Parameters of the comparison and choice of photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChooseParams {
    /// Weight of each degree.
    pub weights: Weights,
    /// Comparison of tiles with an edge; `None` compares them as all others.
    pub features: Option<Features>,
    /// Strength with which neighboring tiles compensate one another when seen from afar, 0 to 1. More is nearer to the
    /// picture from a distance, and less near in each single tile.
    pub blend: f64,
    /// Candidates of each tile, at least 1. More find better choices under strict rules and cost time.
    pub candidates: usize,
    /// Rounds of improvement; they end earlier when nothing changes. 0 leaves the start as it is.
    pub rounds: usize,
    /// Passes over the picture in which tiles of several sizes give way to others. Each takes a twentieth of the time of 20, which
    /// gain nearly all that can be had; 0 leaves the first tiles as they are.
    pub tiling_rounds: usize,
}

impl Default for ChooseParams {
    fn default() -> Self {
        Self {
            weights: Weights {
                degree: 3,
                detail: 1.0,
            },
            features: None,
            blend: 0.3,
            candidates: 128,
            rounds: 8,
            tiling_rounds: 20,
        }
    }
}
