//! The warp as data, for devices other than the CPU: which old pixels each pixel of some new rows sees.

use super::{Span, TILE, lengths};
use crate::deformation::Deformation;
use crate::locate::{CellInverse, Locator, TOGETHER};
use fearless_simd::{Level, dispatch};
use glam::{DVec2, dvec2};
use ravec_raster::Size;
use std::ops::Range;

/// Some rows of a warp: spans of pixels that lie in one cell, row by row.
///
/// A pixel `k` of a span lies at `corner + (k, 0)` from the corner of its cell in the new picture. With that, `u` and `v` of
/// `u e + v f + u v g` give its place in the old one, `first + (u, v) · extent`; its footprint there is `width + k step`.
#[derive(Debug, Clone, Default)]
pub struct WarpPlan {
    /// Cells that the rows cross.
    pub cells: Vec<WarpCell>,
    /// Spans of all rows, from left to right in each.
    pub spans: Vec<WarpSpan>,
    /// First span of each row, and the number of all.
    pub row_starts: Vec<usize>,
    /// Rows of the old picture that the pixels see.
    pub source_rows: Range<usize>,
}

/// A cell: a rectangle of the old picture, a quadrilateral of the new one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarpCell {
    /// Sides of the quadrilateral from its first corner, in new pixels.
    pub e: DVec2,
    /// See `e`.
    pub f: DVec2,
    /// By how much the fourth corner is off that of a parallelogram.
    pub g: DVec2,
    /// First corner of the rectangle, in old pixels.
    pub first: DVec2,
    /// Its size.
    pub extent: DVec2,
}

/// Pixels of a row that lie in one cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarpSpan {
    /// First column.
    pub first: usize,
    /// Number of pixels.
    pub count: usize,
    /// Index of the cell in the plan.
    pub cell: usize,
    /// Center of the first pixel from the first corner of the cell, in new pixels.
    pub corner: DVec2,
    /// Footprint of the first pixel along x and along y, in old pixels, at least 1.
    pub width: DVec2,
    /// Its change from one pixel to the next.
    pub step: DVec2,
}

impl Deformation {
    /// The plan of some rows of [`warp`](Deformation::warp).
    ///
    /// # Panics
    /// If the new picture has fewer rows.
    pub fn warp_plan(&self, rows: Range<usize>) -> WarpPlan {
        assert!(
            rows.end <= self.size().height(),
            "rows {rows:?} of {}",
            self.size()
        );
        dispatch!(Level::new(), simd => Planner::new(self, rows).plan(|inverse, first, y, places| {
            inverse.sources(simd, first, y, places);
        }))
    }
}

struct Planner<'a> {
    locator: Locator<'a>,
    source_unit: DVec2,
    source_size: Size,
    width: usize,
    /// Columns of a tile, at whose borders spans are cut as on the CPU.
    columns: usize,
    rows: Range<usize>,
    cells: Vec<u32>,
}

impl<'a> Planner<'a> {
    fn new(deformation: &'a Deformation, rows: Range<usize>) -> Self {
        let (source_size, size) = (deformation.source_size(), deformation.size());
        let locator = Locator::new(deformation, DVec2::ONE, size.width());
        let shrink = (lengths(source_size) / lengths(size)).max(DVec2::ONE);
        Self {
            cells: locator.cells_in(rows.start, rows.len()),
            locator,
            source_unit: deformation.grid.unit_px(),
            source_size,
            width: size.width(),
            columns: (TILE[1] as f64 / shrink.x).ceil() as usize,
            rows,
        }
    }

    fn plan(self, sources: impl Fn(&CellInverse, f64, f64, [&mut [f64]; 2])) -> WarpPlan {
        let inverses: Vec<CellInverse> = self
            .cells
            .iter()
            .map(|&cell| self.locator.inverse(cell, self.source_unit))
            .collect();
        let mut plan = WarpPlan {
            cells: inverses.iter().map(CellInverse::cell).collect(),
            ..WarpPlan::default()
        };
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut stretches = Vec::new();
        for row in self.rows.clone() {
            plan.row_starts.push(plan.spans.len());
            let y = row as f64 + 0.5;
            self.locator.stretches(row, &self.cells, &mut stretches);
            stretches.sort_by_key(|stretch| stretch.first);
            for stretch in &stretches {
                // cells are numbered as in the deformation, in order
                let Ok(cell) = self.cells.binary_search(&stretch.cell) else {
                    continue;
                };
                let inverse = &inverses[cell];
                let place = |col: usize| {
                    let (mut xs, mut ys) = ([0.0; TOGETHER], [0.0; TOGETHER]);
                    sources(inverse, col as f64 + 0.5, y, [&mut xs, &mut ys]);
                    dvec2(xs[0], ys[0])
                };
                let mut first = stretch.first;
                while first < stretch.end {
                    let end = ((first / self.columns + 1) * self.columns).min(stretch.end);
                    let ends = [first, end - 1].map(place);
                    let span = Span::between(
                        row,
                        first,
                        end - first,
                        ends.map(|at| inverse.footprint(at)),
                    );
                    let reach = super::REACH
                        * span
                            .width
                            .y
                            .max((span.width + span.step * span.count as f64).y);
                    low = low.min(ends[0].y.min(ends[1].y) - reach);
                    high = high.max(ends[0].y.max(ends[1].y) + reach);
                    plan.spans.push(WarpSpan {
                        first,
                        count: end - first,
                        cell,
                        corner: dvec2(first as f64 + 0.5, y) - inverse.corner(),
                        width: span.width,
                        step: span.step,
                    });
                    first = end;
                }
            }
        }
        plan.row_starts.push(plan.spans.len());
        let last = self.source_size.height() as f64 - 1.0;
        // a row more at each end, for what is rounded
        let inside = |row: f64| row.clamp(0.0, last) as usize;
        plan.source_rows = inside(low - 2.0)..inside(high + 2.0) + 1;
        debug_assert!(
            plan.spans
                .iter()
                .all(|span| span.first + span.count <= self.width)
        );
        plan
    }
}
