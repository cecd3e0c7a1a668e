//! A regular grid of two-color pixels over an image.

use crate::fit::{Blocks, FlatThreshold, Search, fit_block_column, fit_block_row};
use crate::pixel::TwoColorPixel;
use crate::split_table::MAX_EXACT_SIDE;
use crate::sweep::MAX_LANES;
use fearless_simd::Level;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Color, Image, Oklab, Size};
use rayon::prelude::*;
use std::ops::Range;

/// Search method for the best line of a block.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FitMethod {
    /// Exact up to 16 pixels a side, coarse to fine above.
    #[default]
    Auto,
    /// Over all splits: the optimum. Sides up to 32.
    Exact,
    /// Exact on a reduction of the block, then refined: faster, and within a few per cent of the optimum. Sides from 8.
    CoarseToFine,
}

/// The largest side that [`FitMethod::Auto`] fits exactly.
const AUTO_EXACT_SIDE: usize = 16;

/// The largest block that can be fitted.
pub(crate) const MAX_SIDE: usize = 64;

/// The smallest block whose reduction is worth fitting.
const MIN_COARSE_SIDE: usize = 8;

/// Parameters of the division of an image into fitted blocks.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitParams {
    /// Side N of a block in pixels, 2 to 64 (default 8). Larger blocks store less and abstract more.
    pub block_px: usize,
    /// Search method for the best line (default [`FitMethod::Auto`]).
    pub method: FitMethod,
    /// Oklab contrast below which a block is flat, 0 to 1 (default 0.01, about half of what the eye can distinguish). 0
    /// gives every block a line that is not constant; more gives fewer lines.
    pub flat_contrast: f32,
}

impl Default for FitParams {
    fn default() -> Self {
        Self {
            block_px: 8,
            method: FitMethod::Auto,
            flat_contrast: 0.01,
        }
    }
}

/// Why an image could not be fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// The block's side is out of range.
    #[error(
        "the block size is {got} pixels a side: choose 2 to 64 (exact search 2 to 32, coarse to fine 8 to 64)"
    )]
    BlockSize {
        /// The requested side.
        got: usize,
    },
    /// The smallest and the largest block do not fit each other.
    #[error(
        "the block sizes are {min} to {max} pixels: choose a smallest of 2 to 32, and a largest that is this times a power of two, up to 64"
    )]
    Sizes {
        /// The requested smallest side.
        min: usize,
        /// The largest side.
        max: usize,
    },
    /// The caller cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A regular grid of two-color pixels. Blocks are numbered `(col, row)`; those of the last column and row may reach
/// beyond the image.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoColorField {
    image_size: Size,
    block_px: usize,
    blocks: Vec<TwoColorPixel>,
}

impl TwoColorField {
    /// Fits every block of `image`.
    ///
    /// # Errors
    /// [`FitError::BlockSize`] for a side that the method cannot fit, [`FitError::Cancelled`] soon after `progress` is.
    pub fn fit<P: Color>(
        image: &Image<P>,
        params: &FitParams,
        progress: &Progress,
    ) -> Result<Self, FitError> {
        Self::fit_with(Level::new(), image, params, progress)
    }

    /// [`fit`](Self::fit) with a given instruction set. The result is the same for all of them.
    ///
    /// # Errors
    /// As [`fit`](Self::fit).
    pub fn fit_with<P: Color>(
        level: Level,
        image: &Image<P>,
        params: &FitParams,
        progress: &Progress,
    ) -> Result<Self, FitError> {
        Self::fit_rows(level, image, params, progress)
    }

    fn fit_rows(
        level: Level,
        image: &dyn Blocks,
        params: &FitParams,
        progress: &Progress,
    ) -> Result<Self, FitError> {
        let size = image.size();
        let grid = size.cells(params.block_px.max(1));
        Ok(Self {
            image_size: size,
            block_px: params.block_px,
            blocks: fit_block_rows(level, image, params, 0..grid.height(), progress)?,
        })
    }

    /// A field of blocks that were fitted elsewhere, row by row.
    ///
    /// # Panics
    /// If `blocks` has not one entry for each block of the grid.
    pub fn from_blocks(image_size: Size, block_px: usize, blocks: Vec<TwoColorPixel>) -> Self {
        assert_eq!(
            blocks.len(),
            image_size.cells(block_px).pixels(),
            "one entry a block"
        );
        Self {
            image_size,
            block_px,
            blocks,
        }
    }

    /// The blocks of some rows of the field of `image`, row by row: those that [`fit`](Self::fit) gives there.
    ///
    /// # Errors
    /// As [`fit`](Self::fit).
    ///
    /// # Panics
    /// If the grid has fewer rows.
    pub fn fit_some_rows<P: Color>(
        image: &Image<P>,
        params: &FitParams,
        block_rows: Range<usize>,
        progress: &Progress,
    ) -> Result<Vec<TwoColorPixel>, FitError> {
        fit_block_rows(Level::new(), image, params, block_rows, progress)
    }

    /// The size of the image that was fitted.
    pub fn image_size(&self) -> Size {
        self.image_size
    }

    /// The side of a block in pixels.
    pub fn block_px(&self) -> usize {
        self.block_px
    }

    /// Columns and rows of blocks.
    pub fn grid_size(&self) -> Size {
        self.image_size.cells(self.block_px)
    }

    /// The block at `(col, row)` of the grid.
    ///
    /// # Panics
    /// Outside the grid.
    pub fn block(&self, col: usize, row: usize) -> &TwoColorPixel {
        let width = self.grid_size().width();
        assert!(col < width, "column {col} of {width}");
        &self.blocks[row * width + col]
    }

    pub(crate) fn blocks_mut(&mut self) -> &mut [TwoColorPixel] {
        &mut self.blocks
    }

    /// All blocks, row by row.
    pub fn blocks(&self) -> &[TwoColorPixel] {
        &self.blocks
    }
}

/// The blocks of some rows of the grid.
fn fit_block_rows(
    level: Level,
    image: &dyn Blocks,
    params: &FitParams,
    block_rows: Range<usize>,
    progress: &Progress,
) -> Result<Vec<TwoColorPixel>, FitError> {
    let (size, side) = (image.size(), params.block_px);
    let search = match params.method {
        FitMethod::Auto if (2..=AUTO_EXACT_SIDE).contains(&side) => Search::Exact,
        FitMethod::Auto if (AUTO_EXACT_SIDE..=MAX_SIDE).contains(&side) => Search::CoarseToFine,
        FitMethod::Exact if (2..=MAX_EXACT_SIDE).contains(&side) => Search::Exact,
        FitMethod::CoarseToFine if (MIN_COARSE_SIDE..=MAX_SIDE).contains(&side) => {
            Search::CoarseToFine
        }
        _ => return Err(FitError::BlockSize { got: side }),
    };
    let grid = size.cells(side);
    assert!(
        block_rows.end <= grid.height(),
        "rows {block_rows:?} of {}",
        grid.height()
    );
    let empty = TwoColorPixel::flat(Oklab::default(), 0.0, 0.0);
    let mut blocks = vec![empty; grid.width() * block_rows.len()];
    let flat = FlatThreshold(params.flat_contrast);
    let phase = progress.phase("fit", block_rows.len() as u64);
    // a column that the border clips is fitted on its own, many of its blocks at once
    let whole = [size.width() / side, size.height() / side];
    let clipped = whole[0] < grid.width() && whole[0] > 0;
    blocks
        .par_chunks_mut(grid.width())
        .enumerate()
        .try_for_each(|(index, out)| {
            progress.check()?;
            let row = block_rows.start + index;
            let alone = clipped && row < whole[1];
            let out = &mut out[..grid.width() - usize::from(alone)];
            fit_block_row(level, image, side, search, row, flat, out);
            phase.advance(1);
            Ok::<(), Cancelled>(())
        })?;
    let column_rows = block_rows.start..block_rows.end.min(whole[1]);
    if clipped && !column_rows.is_empty() {
        let mut column = vec![empty; column_rows.len()];
        column
            .par_chunks_mut(MAX_LANES)
            .enumerate()
            .try_for_each(|(chunk, out)| {
                progress.check()?;
                let first = [whole[0], column_rows.start + chunk * MAX_LANES];
                fit_block_column(level, image, side, search, first, flat, out);
                Ok::<(), Cancelled>(())
            })?;
        for (row, pixel) in blocks.chunks_mut(grid.width()).zip(column) {
            row[whole[0]] = pixel;
        }
    }
    Ok(blocks)
}
