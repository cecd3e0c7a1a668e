//! Properties of the picture under a stroke that the tools need, computed cell by cell as strokes reach them.

use super::canvas::Canvas;
use super::path::Path;
use super::stroke::{Stroke, StrokeError};
use crate::clean::NoiseLevel;
use crate::dense::{WindowParams, map_windows};
use crate::filter_error::FilterError;
use crate::operator::{Mode, OperatorParams, operate_with};
use crate::pointwise::Sides;
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Rect, Size};
use rayon::prelude::*;
use std::ops::Range;

/// Side of a cell in pixels: small, so that few windows outside a round brush are fitted; large enough for whole batches.
const SIDE: usize = 32;

/// The most cells that one task hands to a regional operator.
const LONGEST_RUN: usize = 4;

/// The sides of the window around a pixel but for its own color, as plain numbers: other color, coverage, quality, variance,
/// remoteness.
type Packed = [f32; 7];

/// A cell: the windows of its pixels, and for some tools what its pixels become.
struct Cell {
    /// Own colors, which are read along the way to each pixel; the last number is 0.
    own: Vec<[f32; 4]>,
    others: Vec<Packed>,
    target: Option<Image<LinearRgba>>,
}

/// The cells of a picture, filled where needed.
pub(crate) struct Cells {
    size: Size,
    columns: usize,
    filled: Vec<Option<Cell>>,
    windows: WindowParams,
    /// The operator whose result is not a function of one window.
    regional: Option<OperatorParams>,
    /// The noise that a cleaning operator removes, once known.
    noise: Option<NoiseLevel>,
}

impl Cells {
    /// No cell is filled yet.
    pub fn new(size: Size, stroke: &Stroke) -> Self {
        let mut cells = Self::none(size, stroke);
        cells.filled.resize_with(size.cells(SIDE).pixels(), || None);
        cells
    }

    /// The settings, without cells.
    fn none(size: Size, stroke: &Stroke) -> Self {
        let pointwise = |params: &OperatorParams| {
            params.iterations == 1 && !matches!(params.mode, Mode::Clean | Mode::Stamp)
        };
        Self {
            size,
            columns: size.cells(SIDE).width(),
            filled: Vec::new(),
            windows: WindowParams {
                window_px: stroke.window_px,
                ..WindowParams::default()
            },
            regional: stroke.operator().filter(|params| !pointwise(params)),
            noise: None,
        }
    }

    /// Returns `true` if the cells of a stroke are the same windows, and nothing else.
    pub fn suit(&self, stroke: &Stroke) -> bool {
        let other = Self::none(self.size, stroke);
        self.regional.is_none()
            && other.regional.is_none()
            && self.windows.window_px == other.windows.window_px
    }

    /// Empties the cells whose windows reach `region`, whose pixels have changed.
    pub fn forget(&mut self, region: Rect) {
        if region.is_empty() {
            return;
        }
        let reach = self.windows.window_px / 2;
        let cells = |first: usize, end: usize, length: usize| {
            first.saturating_sub(reach) / SIDE..=(end - 1 + reach).min(length - 1) / SIDE
        };
        for y in cells(region.row, region.bottom(), self.size.height()) {
            for x in cells(region.col, region.right(), self.size.width()) {
                self.filled[y * self.columns + x] = None;
            }
        }
    }

    /// Fills the cells of `region` that the path reaches.
    pub fn ensure(
        &mut self,
        canvas: &mut Canvas,
        path: &Path,
        region: Rect,
        progress: &Progress,
    ) -> Result<(), StrokeError> {
        // the noise of the whole picture, once, not of every cell
        if let Some(params) = &self.regional
            && self.noise.is_none()
        {
            self.noise = canvas.noise_for(params, progress)?;
        }
        self.fill(&canvas.before, path, region, progress)
    }

    /// Fills the cells of `region` that the path reaches with the windows of `image`. The noise is known where it is needed.
    pub fn fill(
        &mut self,
        image: &Image<LinearRgba>,
        path: &Path,
        region: Rect,
        progress: &Progress,
    ) -> Result<(), StrokeError> {
        let rows = region.row / SIDE..=(region.bottom() - 1) / SIDE;
        let missing: Vec<usize> = rows
            .flat_map(|y| (region.col / SIDE..=(region.right() - 1) / SIDE).map(move |x| (x, y)))
            .filter(|&(x, y)| {
                let cell = self.rect(x, y);
                path.near(cell).reaches(cell)
            })
            .map(|(x, y)| y * self.columns + x)
            .filter(|&cell| self.filled[cell].is_none())
            .collect();
        let runs = self.runs(&missing);
        let targets: Vec<Vec<Image<LinearRgba>>> = runs
            .into_par_iter()
            .map(|run| self.targets_of(image, run, progress))
            .collect::<Result<_, StrokeError>>()?;
        let mut targets = targets.into_iter().flatten();
        let filled: Vec<(usize, Option<Image<LinearRgba>>)> = missing
            .into_iter()
            .map(|cell| (cell, targets.next()))
            .collect();
        let filled: Vec<(usize, Cell)> = filled
            .into_par_iter()
            .map(|(cell, target)| {
                progress.check()?;
                Ok((cell, self.cell(image, cell, target)?))
            })
            .collect::<Result<_, StrokeError>>()?;
        for (index, cell) in filled {
            self.filled[index] = Some(cell);
        }
        Ok(())
    }

    /// Cells side by side, for an operator that reads around its region: so that cells share what lies between them. Nothing
    /// for the other tools.
    fn runs(&self, cells: &[usize]) -> Vec<Range<usize>> {
        if self.regional.is_none() {
            return vec![];
        }
        let row = |cell: usize| cell / self.columns;
        cells
            .chunk_by(|&a, &b| a + 1 == b && row(a) == row(b))
            .flat_map(|run| run.chunks(LONGEST_RUN))
            .map(|run| run[0]..run[0] + run.len())
            .collect()
    }

    /// The operator's results for several cells, computed side by side.
    fn targets_of(
        &self,
        image: &Image<LinearRgba>,
        run: Range<usize>,
        progress: &Progress,
    ) -> Result<Vec<Image<LinearRgba>>, StrokeError> {
        progress.check()?;
        let Some(params) = &self.regional else {
            return Ok(vec![]);
        };
        let rects: Vec<Rect> = run.map(|cell| self.rect_of(cell)).collect();
        let (Some(first), Some(last)) = (rects.first(), rects.last()) else {
            return Ok(vec![]);
        };
        let whole = Rect::new(first.col, first.row, last.right() - first.col, first.height);
        let quiet = Progress::none();
        let targets = operate_with(image, whole, params, self.noise.as_ref(), &quiet)?;
        let crop = |rect: &Rect| {
            let size = rect.size().ok_or(FilterError::EmptyRegion)?;
            let cropped = targets.crop(rect.col - whole.col, 0, size);
            cropped.map_err(|_| FilterError::EmptyRegion.into())
        };
        rects.iter().map(crop).collect()
    }

    /// The windows of a cell's pixels, and for some tools what its pixels become.
    fn cell(
        &self,
        image: &Image<LinearRgba>,
        cell: usize,
        target: Option<Image<LinearRgba>>,
    ) -> Result<Cell, StrokeError> {
        let rect = self.rect_of(cell);
        let sides = map_windows(
            image,
            rect,
            &self.windows,
            &Progress::none(),
            |_, _, window| {
                let Sides {
                    own: [l0, a0, b0],
                    other: [l1, a1, b1],
                    coverage,
                    quality,
                    variance,
                    remoteness,
                } = Sides::of(window, self.windows.window_px);
                [
                    l0, a0, b0, l1, a1, b1, coverage, quality, variance, remoteness,
                ]
            },
        )?;
        let mut own = vec![[0.0; 4]; SIDE * SIDE];
        let mut others = vec![[0.0; 7]; SIDE * SIDE];
        for row in 0..rect.height {
            let start = row * SIDE;
            let slots = own[start..].iter_mut().zip(&mut others[start..]);
            for (&[l, a, b, ref other @ ..], (own, others)) in sides.row(row).iter().zip(slots) {
                *own = [l, a, b, 0.0];
                *others = *other;
            }
        }
        Ok(Cell {
            own,
            others,
            target,
        })
    }

    fn rect_of(&self, cell: usize) -> Rect {
        self.rect(cell % self.columns, cell / self.columns)
    }

    fn rect(&self, x: usize, y: usize) -> Rect {
        Rect::new(x * SIDE, y * SIDE, SIDE, SIDE).intersection(Rect::of(self.size))
    }

    fn at(&self, col: usize, row: usize) -> Option<(&Cell, usize)> {
        let cell = self.filled[row / SIDE * self.columns + col / SIDE].as_ref()?;
        Some((cell, row % SIDE * SIDE + col % SIDE))
    }

    /// The color of the side of the window around a pixel that the pixel is on, and 0, if its cell is filled.
    pub fn own(&self, col: usize, row: usize) -> Option<[f32; 4]> {
        let (cell, pixel) = self.at(col, row)?;
        Some(cell.own[pixel])
    }

    /// The sides of the window around a pixel, if its cell is filled.
    pub fn sides(&self, col: usize, row: usize) -> Option<Sides> {
        let (cell, pixel) = self.at(col, row)?;
        let [l0, a0, b0, _] = cell.own[pixel];
        let [l1, a1, b1, coverage, quality, variance, remoteness] = cell.others[pixel];
        Some(Sides {
            own: [l0, a0, b0],
            other: [l1, a1, b1],
            coverage,
            quality,
            variance,
            remoteness,
        })
    }

    /// The new value of a pixel, if the tool works on regions.
    pub fn target(&self, col: usize, row: usize) -> Option<LinearRgba> {
        let (cell, pixel) = self.at(col, row)?;
        let target = cell.target.as_ref()?;
        Some(target[(pixel % SIDE, pixel / SIDE)])
    }
}
