//! Blocks of different sizes: large where two colors are enough, small where they are not.
//!
//! A quadtree from `max_block_px` down to `min_block_px`. A block is cut into four where its error exceeds a threshold;
//! then blocks are cut further until neighbors across an edge differ by at most one level, as a deformation grid on top
//! of them needs.
//!
//! Guarantees: the leaves tile the image; balanced (see [`AdaptiveField::validation_errors`]); a leaf's error is within the
//! threshold unless it has the smallest size. Cost: a fit of the image at every level. Memory: the fits of all levels while
//! building, the leaves after.

use crate::field::{FitError, FitMethod, FitParams, TwoColorField};
use crate::pixel::TwoColorPixel;
use crate::placed::{BlockField, PlacedBlock};
use crate::subpixel::refine_in;
use ravec_progress::Progress;
use ravec_raster::{Color, Image, LinearRows, Size};
use rayon::prelude::*;
use std::ops::Range;

/// Parameters of the division of an image into blocks of different sizes.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdaptiveParams {
    /// Side of the smallest blocks in pixels, 2 to 32 (default 4).
    pub min_block_px: usize,
    /// Side of the largest blocks: `min_block_px` times a power of two, at most 64 (default 32).
    pub max_block_px: usize,
    /// A block is cut where the root mean square Oklab distance of its pixels from their side's color exceeds this, 0 to 1
    /// (default 0.06). Less follows more texture with more blocks.
    pub max_error: f32,
    /// Oklab contrast below which a block is flat, as for [`FitParams::flat_contrast`] (default 0.01).
    pub flat_contrast: f32,
}

impl Default for AdaptiveParams {
    fn default() -> Self {
        Self {
            min_block_px: 4,
            max_block_px: 32,
            max_error: 0.06,
            flat_contrast: 0.01,
        }
    }
}

/// A leaf of the quadtree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leaf {
    /// First column in pixels.
    pub col_px: usize,
    /// First row in pixels.
    pub row_px: usize,
    /// Pixels a side; the image's border may clip it.
    pub side_px: usize,
    /// The two-color pixel of the leaf.
    pub pixel: TwoColorPixel,
}

/// A balanced quadtree of two-color pixels over an image.
#[derive(Debug, Clone, PartialEq)]
pub struct AdaptiveField {
    image_size: Size,
    min_block_px: usize,
    max_block_px: usize,
    leaves: Vec<Leaf>,
    /// The leaf over each cell of the smallest size, row by row.
    leaf_of_cell: Vec<u32>,
}

impl AdaptiveField {
    /// Fits `image`.
    ///
    /// # Errors
    /// [`FitError::Sizes`] if the block sizes do not fit each other, [`FitError::Cancelled`] soon after `progress` is.
    pub fn fit<P: Color>(
        image: &Image<P>,
        params: &AdaptiveParams,
        progress: &Progress,
    ) -> Result<Self, FitError> {
        let (min, max) = (params.min_block_px, params.max_block_px);
        let ratio = max / min.max(1);
        if !(2..=32).contains(&min) || max > 64 || min * ratio != max || !ratio.is_power_of_two() {
            return Err(FitError::Sizes { min, max });
        }
        let levels: Vec<TwoColorField> = (0..=ratio.trailing_zeros())
            .map(|level| {
                let fit = FitParams {
                    block_px: max >> level,
                    method: FitMethod::Auto,
                    flat_contrast: params.flat_contrast,
                };
                TwoColorField::fit(image, &fit, progress)
            })
            .collect::<Result<_, _>>()?;
        let mut cells = Cells::new(image.size(), min, levels.len() - 1);
        // a quarter of a good block may be worse than the whole, so what balancing cuts is examined again
        loop {
            cells.cut(&levels, params.max_error);
            if !cells.balance() {
                break;
            }
        }
        let (leaves, leaf_of_cell) = cells.leaves(&levels);
        Ok(Self {
            image_size: image.size(),
            min_block_px: min,
            max_block_px: max,
            leaves,
            leaf_of_cell,
        })
    }

    /// Moves the line of every leaf to where it lies between pixel centers, as
    /// [`TwoColorField::refine_lines`] does.
    ///
    /// # Errors
    /// [`FitError::Cancelled`] soon after `progress` is.
    ///
    /// # Panics
    /// If `image` has another size than the fitted one.
    pub fn refine_lines<P: Color>(
        &mut self,
        image: &Image<P>,
        progress: &Progress,
    ) -> Result<(), FitError> {
        assert_eq!(
            image.size(),
            self.image_size,
            "the image is not the one that was fitted"
        );
        self.refine_rows(image, progress)
    }

    fn refine_rows(&mut self, image: &dyn LinearRows, progress: &Progress) -> Result<(), FitError> {
        let phase = progress.phase("refine", self.leaves.len() as u64);
        Ok(self.leaves.par_chunks_mut(64).try_for_each(|leaves| {
            progress.check()?;
            for leaf in leaves.iter_mut() {
                leaf.pixel =
                    refine_in(image, [leaf.col_px, leaf.row_px], leaf.side_px, &leaf.pixel);
            }
            phase.advance(leaves.len() as u64);
            Ok::<(), ravec_progress::Cancelled>(())
        })?)
    }

    /// All leaves, by their first row, then column.
    pub fn leaves(&self) -> &[Leaf] {
        &self.leaves
    }

    /// The side of the smallest blocks.
    pub fn min_block_px(&self) -> usize {
        self.min_block_px
    }

    /// The leaf that holds pixel `(col, row)`.
    ///
    /// # Panics
    /// Outside the image.
    pub fn leaf_at(&self, col: usize, row: usize) -> &Leaf {
        let cells = self.image_size.cells(self.min_block_px);
        let cell = row / self.min_block_px * cells.width() + col / self.min_block_px;
        &self.leaves[self.leaf_of_cell[cell] as usize]
    }

    /// Violated invariants of the tree; empty unless there is a bug. For tests.
    pub fn validation_errors(&self) -> Vec<String> {
        let mut errors = Vec::new();
        let cells = self.image_size.cells(self.min_block_px);
        let mut covered = vec![0u32; cells.pixels()];
        for leaf in &self.leaves {
            if !leaf.col_px.is_multiple_of(leaf.side_px)
                || !leaf.row_px.is_multiple_of(leaf.side_px)
            {
                errors.push(format!(
                    "({}, {}) is off the grid of its size",
                    leaf.col_px, leaf.row_px
                ));
            }
            for row in (leaf.row_px..leaf.row_px + leaf.side_px).step_by(self.min_block_px) {
                for col in (leaf.col_px..leaf.col_px + leaf.side_px).step_by(self.min_block_px) {
                    let (x, y) = (col / self.min_block_px, row / self.min_block_px);
                    if x < cells.width() && y < cells.height() {
                        covered[y * cells.width() + x] += 1;
                    }
                }
            }
        }
        if covered.iter().any(|&count| count != 1) {
            errors.push("the leaves do not tile the image".to_owned());
        }
        for (x, y, right, below) in neighbors(cells) {
            let side = |x: usize, y: usize| {
                self.leaf_at(x * self.min_block_px, y * self.min_block_px)
                    .side_px
            };
            for (nx, ny) in right.into_iter().chain(below) {
                let (a, b) = (side(x, y), side(nx, ny));
                if a > 2 * b || b > 2 * a {
                    errors.push(format!(
                        "blocks of {a} and {b} pixels meet at cell ({x}, {y})"
                    ));
                }
            }
        }
        errors
    }
}

/// A cell of a grid.
type Cell = (usize, usize);

/// Every cell with its right and its lower neighbor.
fn neighbors(cells: Size) -> impl Iterator<Item = (usize, usize, Option<Cell>, Option<Cell>)> {
    (0..cells.height()).flat_map(move |y| {
        (0..cells.width()).map(move |x| {
            let right = (x + 1 < cells.width()).then_some((x + 1, y));
            let below = (y + 1 < cells.height()).then_some((x, y + 1));
            (x, y, right, below)
        })
    })
}

/// The level of the leaf over each smallest cell; level 0 is the coarsest.
struct Cells {
    size: Size,
    min: usize,
    finest: usize,
    level: Vec<u8>,
}

impl Cells {
    /// The largest blocks everywhere.
    fn new(image: Size, min: usize, finest: usize) -> Self {
        let size = image.cells(min);
        Self {
            size,
            min,
            finest,
            level: vec![0; size.pixels()],
        }
    }

    /// Cuts every block whose error is too large, from the largest down.
    fn cut(&mut self, levels: &[TwoColorField], max_error: f32) {
        for (level, field) in levels[..self.finest].iter().enumerate() {
            let grid = field.grid_size();
            for (row, col) in
                (0..grid.height()).flat_map(|row| (0..grid.width()).map(move |col| (row, col)))
            {
                let span = field.block_px() / self.min;
                let first = (row * span) * self.size.width() + col * span;
                let error = field.block(col, row).error;
                if usize::from(self.level[first]) == level && error > max_error * max_error {
                    self.refine(col * span, row * span);
                }
            }
        }
    }

    /// Cuts the leaf over a cell into four.
    fn refine(&mut self, x: usize, y: usize) {
        let level = self.level[y * self.size.width() + x];
        let span = 1 << (self.finest - usize::from(level));
        let (left, top) = (x / span * span, y / span * span);
        for row in top..(top + span).min(self.size.height()) {
            for cell in &mut self.level[row * self.size.width()..]
                [left..(left + span).min(self.size.width())]
            {
                *cell = level + 1;
            }
        }
    }

    /// Cuts leaves until neighbors differ by at most one level. Each cut is forced, so the result is the smallest.
    /// Returns whether anything was cut.
    fn balance(&mut self) -> bool {
        let mut any = false;
        loop {
            let mut too_coarse = Vec::new();
            for (x, y, right, below) in neighbors(self.size) {
                let here = self.level[y * self.size.width() + x];
                for (nx, ny) in right.into_iter().chain(below) {
                    let there = self.level[ny * self.size.width() + nx];
                    if there > here + 1 {
                        too_coarse.push((x, y, here));
                    } else if here > there + 1 {
                        too_coarse.push((nx, ny, there));
                    }
                }
            }
            if too_coarse.is_empty() {
                return any;
            }
            any = true;
            for (x, y, level) in too_coarse {
                // another cell of the same leaf may have cut it already
                if self.level[y * self.size.width() + x] == level {
                    self.refine(x, y);
                }
            }
        }
    }

    /// The leaves with their fits, and the leaf over each cell.
    fn leaves(&self, levels: &[TwoColorField]) -> (Vec<Leaf>, Vec<u32>) {
        let mut leaves = Vec::new();
        let mut leaf_of_cell = vec![u32::MAX; self.level.len()];
        let width = self.size.width();
        for cell in 0..self.level.len() {
            if leaf_of_cell[cell] != u32::MAX {
                continue;
            }
            let level = usize::from(self.level[cell]);
            let span = 1 << (self.finest - level);
            let (x, y) = (cell % width, cell / width);
            for row in y..(y + span).min(self.size.height()) {
                leaf_of_cell[row * width..][x..(x + span).min(width)].fill(leaves.len() as u32);
            }
            leaves.push(Leaf {
                col_px: x * self.min,
                row_px: y * self.min,
                side_px: span * self.min,
                pixel: *levels[level].block(x / span, y / span),
            });
        }
        (leaves, leaf_of_cell)
    }
}

impl BlockField for AdaptiveField {
    fn image_size(&self) -> Size {
        self.image_size
    }

    fn blocks_in_rows(&self, rows: Range<usize>) -> impl Iterator<Item = PlacedBlock<'_>> {
        // leaves are sorted by their first row, and none is higher than the largest
        let first = rows.start.saturating_sub(self.max_block_px - 1);
        let begin = self.leaves.partition_point(|leaf| leaf.row_px < first);
        let end = self.leaves.partition_point(|leaf| leaf.row_px < rows.end);
        self.leaves[begin..end.max(begin)]
            .iter()
            .filter(move |leaf| leaf.row_px + leaf.side_px > rows.start)
            .map(placed)
    }
}

fn placed(leaf: &Leaf) -> PlacedBlock<'_> {
    PlacedBlock {
        col_px: leaf.col_px,
        row_px: leaf.row_px,
        side_px: leaf.side_px,
        pixel: &leaf.pixel,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use ravec_raster::Srgb;

    fn image(width: usize, height: usize, seed: usize) -> Image<Srgb<u8>> {
        Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            let busy = (col / 24 + row / 24 + seed).is_multiple_of(3);
            let v = if busy {
                (col * 83 + row * 47 + seed * col * row) % 256
            } else {
                90 + col / 8
            };
            Srgb([v as u8, (v / 2) as u8, 200])
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn the_leaves_tile_are_balanced_and_as_good_as_asked_for(
            width in 1usize..150,
            height in 1usize..150,
            seed in 0usize..100,
            max_error in 0.0f32..0.2,
            min_log in 1u32..4,
            depth in 0u32..3,
        ) {
            let params = AdaptiveParams {
                min_block_px: 1 << min_log,
                max_block_px: 1 << (min_log + depth),
                max_error,
                ..AdaptiveParams::default()
            };
            let field = AdaptiveField::fit(&image(width, height, seed), &params, &Progress::none()).unwrap();
            prop_assert_eq!(field.validation_errors(), Vec::<String>::new());
            for leaf in field.leaves() {
                prop_assert!(leaf.side_px == params.min_block_px || leaf.pixel.error <= max_error * max_error);
            }
        }
    }

    #[test]
    fn a_constant_image_keeps_the_largest_blocks_and_noise_the_smallest() {
        let constant = Image::new(Size::new(96, 64).unwrap(), Srgb([7u8, 80, 90]));
        let field =
            AdaptiveField::fit(&constant, &AdaptiveParams::default(), &Progress::none()).unwrap();
        assert_eq!(field.leaves().len(), 6);
        let noise = Image::from_fn(Size::new(64, 64).unwrap(), |col, row| {
            Srgb([((col * 97) ^ (row * 61)) as u8; 3])
        });
        let field =
            AdaptiveField::fit(&noise, &AdaptiveParams::default(), &Progress::none()).unwrap();
        assert_eq!(field.leaves().len(), 256);
    }

    #[test]
    fn sizes_that_do_not_fit_are_refused() {
        let constant = Image::new(Size::new(9, 9).unwrap(), Srgb([7u8, 80, 90]));
        for (min, max) in [(0, 8), (1, 8), (4, 12), (8, 4), (4, 128), (64, 64)] {
            let params = AdaptiveParams {
                min_block_px: min,
                max_block_px: max,
                ..AdaptiveParams::default()
            };
            let result = AdaptiveField::fit(&constant, &params, &Progress::none());
            assert_eq!(result, Err(FitError::Sizes { min, max }));
        }
    }
}
