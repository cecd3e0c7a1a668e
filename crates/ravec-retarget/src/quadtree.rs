//! Cells of different sizes: large where the picture is even, small where something is.
//!
//! A block of units stays whole if the adaptive two-color field fits it with one pixel, all its units matter about the same,
//! and no straight run ends in it. Blocks that meet differ by a factor of two at most.
//!
//! Cost: one visit of each unit per level.

use crate::analysis::{Analysis, cancelled};
use crate::forms::GridRun;
use crate::params::RetargetError;
use ravec_progress::Progress;
use ravec_twocolor::{AdaptiveField, AdaptiveParams};

/// The largest cell, in units a side. Larger ones save few unknowns more.
const MAX_SPAN: usize = 8;

/// The largest difference of importance within a cell. Larger lets soft objects share a cell with their surroundings.
const MAX_SPREAD: f64 = 0.15;

/// The pixels of the smallest two-color pixels that decide.
const FINEST_PX: usize = 8;

/// The span of the cell over each unit, row by row.
pub(crate) fn spans(
    analysis: &Analysis,
    importance: &[f64],
    runs: &[GridRun],
    symmetric: bool,
    progress: &Progress,
) -> Result<Vec<usize>, RetargetError> {
    let params = AdaptiveParams {
        min_block_px: FINEST_PX,
        max_block_px: FINEST_PX * MAX_SPAN,
        ..AdaptiveParams::default()
    };
    let field = AdaptiveField::fit(&analysis.image, &params, progress).map_err(cancelled)?;
    let mut tree = Tree {
        units: analysis.units,
        spans: vec![1; importance.len()],
    };
    let mut ends = vec![false; importance.len()];
    for end in runs.iter().flat_map(|run| run.ends) {
        let col = (end.x.max(0.0) as usize).min(tree.units[0] - 1);
        let row = (end.y.max(0.0) as usize).min(tree.units[1] - 1);
        ends[row * tree.units[0] + col] = true;
    }
    let image = analysis.image.size();
    let whole = |tree: &Tree, col: usize, row: usize, span: usize| {
        let units = || tree.within(col, row, span);
        let (low, high) = units().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), unit| {
            (low.min(importance[unit]), high.max(importance[unit]))
        });
        let fitted = units().all(|unit| {
            let center = |k: usize| k * analysis.unit_px + analysis.unit_px / 2;
            let col = center(unit % tree.units[0]).min(image.width() - 1);
            let row = center(unit / tree.units[0]).min(image.height() - 1);
            field.leaf_at(col, row).side_px >= span * analysis.unit_px
        });
        fitted && high - low <= MAX_SPREAD && !units().any(|unit| ends[unit])
    };
    let mut span = 1;
    while span < MAX_SPAN {
        // four blocks of one span become one of the next
        for row in (0..tree.units[1]).step_by(2 * span) {
            for col in (0..tree.units[0]).step_by(2 * span) {
                let same = tree
                    .within(col, row, 2 * span)
                    .all(|unit| tree.spans[unit] == span);
                if same && whole(&tree, col, row, 2 * span) {
                    tree.set(col, row, 2 * span);
                }
            }
        }
        span *= 2;
    }
    tree.balance(symmetric);
    Ok(tree.spans)
}

struct Tree {
    units: [usize; 2],
    spans: Vec<usize>,
}

impl Tree {
    /// The units of a block, as far as they are in the grid.
    fn within(&self, col: usize, row: usize, span: usize) -> impl Iterator<Item = usize> + use<> {
        let [cols, rows] = self.units;
        (row..(row + span).min(rows))
            .flat_map(move |y| (col..(col + span).min(cols)).map(move |x| y * cols + x))
    }

    fn set(&mut self, col: usize, row: usize, span: usize) {
        for unit in self.within(col, row, span) {
            self.spans[unit] = span;
        }
    }

    /// Cuts blocks until those that meet differ by a factor of two at most; with `symmetric`, those at opposite borders
    /// count as meeting and have one size.
    fn balance(&mut self, symmetric: bool) {
        let [cols, rows] = self.units;
        loop {
            let mut cut = Vec::new();
            for row in 0..rows {
                for col in 0..cols {
                    let span = self.spans[row * cols + col];
                    let neighbors = [
                        (col > 0).then(|| (col - 1, row)),
                        (col + 1 < cols).then_some((col + 1, row)),
                        (row > 0).then(|| (col, row - 1)),
                        (row + 1 < rows).then_some((col, row + 1)),
                    ];
                    let finer = neighbors
                        .into_iter()
                        .flatten()
                        .any(|(x, y)| span > 2 * self.spans[y * cols + x]);
                    let opposite = [
                        (col == 0 || col + 1 == cols).then(|| (cols - 1 - col, row)),
                        (row == 0 || row + 1 == rows).then(|| (col, rows - 1 - row)),
                    ];
                    let unlike = symmetric
                        && opposite
                            .into_iter()
                            .flatten()
                            .any(|(x, y)| span > self.spans[y * cols + x]);
                    if finer || unlike {
                        cut.push((col / span * span, row / span * span, span / 2));
                    }
                }
            }
            if cut.is_empty() {
                return;
            }
            for (col, row, span) in cut {
                // a block is named once for each of its units
                if self.spans[row * cols + col] > span {
                    self.set(col, row, 2 * span);
                    self.within(col, row, 2 * span)
                        .for_each(|unit| self.spans[unit] = span);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balanced_blocks_are_aligned_and_differ_by_a_factor_of_two_at_most() {
        for symmetric in [false, true] {
            let mut tree = Tree {
                units: [21, 13],
                spans: vec![1; 21 * 13],
            };
            for (col, row) in [(0, 0), (8, 0), (0, 8), (8, 8), (16, 8)] {
                tree.set(col, row, 8);
            }
            tree.balance(symmetric);
            for row in 0..13 {
                for col in 0..21 {
                    let span = tree.spans[row * 21 + col];
                    let corner = (row / span * span) * 21 + col / span * span;
                    assert_eq!(tree.spans[corner], span);
                    if col + 1 < 21 {
                        let next = tree.spans[row * 21 + col + 1];
                        assert!(span <= 2 * next && next <= 2 * span);
                    }
                    if symmetric && col == 0 {
                        assert_eq!(span, tree.spans[row * 21 + 20]);
                    }
                }
            }
        }
    }
}
