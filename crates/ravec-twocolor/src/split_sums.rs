//! The best split of a block as a device finds it, and the data that a sweep on such a device needs.
//!
//! Fits on another device than the CPU run the sweep of the exact fit (`SweepTable`) and return what it found
//! (`SplitSums`). Lines, colors and the decision for flat blocks follow here, by the code of the fit on the CPU, so that equal
//! sums give equal two-color pixels.

use crate::fit::{FlatThreshold, opaque_pixel, weighted_pixel};
use crate::pixel::{MAX_LIGHT, TwoColorPixel};
use crate::split_table::{SplitTable, split_table};

/// Result of the sweep over the splits of one block.
///
/// Opaque blocks that lie wholly inside the image have `weights` and `insides` of zero.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SplitSums {
    /// Number of the best split: an index into [`SweepTable::events`].
    pub event: u32,
    /// Decrease of the squared error by the split, below that of one color. At least 0.
    pub gain: f32,
    /// Squared error of one color.
    pub energy: f32,
    /// Mean color of the block in Oklab, weighted by alpha.
    pub mean: [f32; 3],
    /// Sum of the differences from the mean over side 0, weighted by alpha.
    pub sum_0: [f32; 3],
    /// Sum of the alphas of the block and of side 0.
    pub weights: [f32; 2],
    /// Number of pixels inside the image in the block and in side 0.
    pub insides: [f32; 2],
}

impl SplitSums {
    /// The two-color pixel of an opaque block of `side` pixels that lies wholly inside the image.
    ///
    /// # Panics
    /// If `side` is not within 2 to 32, or if there is no such split.
    pub fn opaque_pixel(&self, side: usize, flat_contrast: f32) -> TwoColorPixel {
        opaque_pixel(split_table(side), self, FlatThreshold(flat_contrast))
    }

    /// The two-color pixel of a block with transparency or beyond the border of the image.
    ///
    /// # Panics
    /// As [`opaque_pixel`](Self::opaque_pixel).
    pub fn weighted_pixel(&self, side: usize, flat_contrast: f32) -> TwoColorPixel {
        weighted_pixel(split_table(side), self, FlatThreshold(flat_contrast))
    }
}

/// The splits of a block in the order in which the sweep visits them.
///
/// The sum over the first `k` pixels of the initial order is prefix `k`. Each event `[k, pixel]` renews prefix `k` as prefix
/// `k − 1` plus the pixel; that is the sum over side 0 of a split that was not visited before.
#[derive(Debug, Clone, Copy)]
pub struct SweepTable(&'static SplitTable);

impl SweepTable {
    /// The table for blocks of `side` × `side` pixels.
    ///
    /// # Panics
    /// If `side` is not within 2 to 32.
    pub fn new(side: usize) -> Self {
        Self(split_table(side))
    }

    /// Row-major indices of the pixels in the order of the start.
    pub fn initial_order(&self) -> &'static [u16] {
        &self.0.initial_order
    }

    /// Prefix and pixel of each event.
    pub fn events(&self) -> impl ExactSizeIterator<Item = [u16; 2]> + use<> {
        let events = self.0.events.iter();
        events.map(|event| [event.prefix, event.pixel])
    }

    /// By prefix `k`, the factor `1/k + 1/(N² − k)` that makes a gain of a squared sum; 0 where a side is empty.
    pub fn gain_weights(&self) -> &'static [f32] {
        &self.0.gain_weights
    }

    /// The number of the first event of each sector of angles, and of the end of the last one. The fit coarse to fine starts
    /// from the best events of two sectors.
    pub fn sectors(&self) -> Vec<u32> {
        let firsts = self.0.sectors.iter().map(|range| range.start);
        let all = firsts.chain([self.0.events.len()]);
        all.map(|event| event as u32).collect()
    }

    /// By event, a line `[n.x, n.y, d]` with that split. Side 0 is where `n·p < d`, from the block's center.
    pub fn lines(&self) -> impl ExactSizeIterator<Item = [f32; 3]> + use<> {
        let lines = self.0.lines.iter();
        lines.map(|line| [line.normal[0], line.normal[1], line.offset])
    }
}

/// Light beyond this, either way, counts as not a number: its pixel counts as fully transparent.
pub const MAX_FITTED_LIGHT: f32 = MAX_LIGHT;

/// Weights below this count as nothing.
pub const MIN_FITTED_WEIGHT: f32 = crate::sweep::NO_WEIGHT;
