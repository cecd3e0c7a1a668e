//! What the tools need to know of the picture under a stroke, worked out cell by cell as strokes reach them.

use super::path::Path;
use super::stroke::{Stroke, StrokeError};
use crate::dense::{WindowParams, map_windows};
use crate::operator::{Mode, OperatorParams, Sides, operate};
use glam::DVec2;
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Rect, Size};
use rayon::prelude::*;

/// Side of a cell in pixels: small, so that few windows outside a round brush are fitted; large enough for whole batches.
const SIDE: usize = 32;

/// The sides of the window around a pixel, as plain numbers: own color, other color, coverage, quality.
type Packed = [f32; 8];

/// A cell: the windows of its pixels, and for some tools what its pixels become.
struct Cell {
    sides: Image<Packed>,
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
}

impl Cells {
    /// No cell is filled yet.
    pub fn new(size: Size, stroke: &Stroke) -> Self {
        let pointwise = |params: &OperatorParams| {
            params.iterations == 1 && !matches!(params.mode, Mode::Clean | Mode::Stamp)
        };
        Self {
            size,
            columns: size.cells(SIDE).width(),
            filled: std::iter::repeat_with(|| None)
                .take(size.cells(SIDE).pixels())
                .collect(),
            windows: WindowParams {
                window_px: stroke.window_px,
                ..WindowParams::default()
            },
            regional: stroke.operator().filter(|params| !pointwise(params)),
        }
    }

    /// Fills the cells of `region` that the path reaches.
    pub fn ensure(
        &mut self,
        image: &Image<LinearRgba>,
        path: &Path,
        region: Rect,
        progress: &Progress,
    ) -> Result<(), StrokeError> {
        // the noise of the whole picture, once, not of every cell
        if let Some(params) = &mut self.regional
            && params.mode == Mode::Clean
            && params.noise_sigma.is_none()
        {
            params.noise_sigma = Some(crate::clean::estimate_noise(image, progress)?.typical());
        }
        let rows = region.row / SIDE..=(region.bottom() - 1) / SIDE;
        let missing: Vec<usize> = rows
            .flat_map(|y| (region.col / SIDE..=(region.right() - 1) / SIDE).map(move |x| (x, y)))
            .filter(|&(x, y)| reaches(path, self.rect(x, y)))
            .map(|(x, y)| y * self.columns + x)
            .filter(|&cell| self.filled[cell].is_none())
            .collect();
        let filled: Vec<(usize, Cell)> = missing
            .into_par_iter()
            .map(|cell| {
                progress.check()?;
                let rect = self.rect(cell % self.columns, cell / self.columns);
                let quiet = Progress::none();
                let sides = map_windows(image, rect, &self.windows, &quiet, |_, _, window| {
                    let Sides {
                        own,
                        other,
                        coverage,
                        quality,
                    } = Sides::of(window);
                    [
                        own[0], own[1], own[2], other[0], other[1], other[2], coverage, quality,
                    ]
                })?;
                let target = match &self.regional {
                    Some(params) => Some(operate(image, rect, params, &quiet)?),
                    None => None,
                };
                Ok((cell, Cell { sides, target }))
            })
            .collect::<Result<_, StrokeError>>()?;
        for (index, cell) in filled {
            self.filled[index] = Some(cell);
        }
        Ok(())
    }

    fn rect(&self, x: usize, y: usize) -> Rect {
        Rect::new(x * SIDE, y * SIDE, SIDE, SIDE).intersection(Rect::of(self.size))
    }

    fn at(&self, col: usize, row: usize) -> Option<(&Cell, [usize; 2])> {
        let cell = self.filled[row / SIDE * self.columns + col / SIDE].as_ref()?;
        Some((cell, [col % SIDE, row % SIDE]))
    }

    /// The sides of the window around a pixel, if its cell is filled.
    pub fn sides(&self, col: usize, row: usize) -> Option<Sides> {
        let (cell, [x, y]) = self.at(col, row)?;
        let [a, b, c, d, e, f, coverage, quality] = cell.sides[(x, y)];
        Some(Sides {
            own: [a, b, c],
            other: [d, e, f],
            coverage,
            quality,
        })
    }

    /// What a pixel becomes, if the tool works on regions.
    pub fn target(&self, col: usize, row: usize) -> Option<LinearRgba> {
        let (cell, [x, y]) = self.at(col, row)?;
        cell.target.as_ref().map(|target| target[(x, y)])
    }
}

/// Whether the path comes within its radius of a rectangle of pixels.
fn reaches(path: &Path, rect: Rect) -> bool {
    let near = path.near(rect);
    if near.is_empty() {
        return false;
    }
    let middle = DVec2::new(rect.col as f64, rect.row as f64)
        + 0.5 * DVec2::new(rect.width as f64, rect.height as f64);
    let half_diagonal = 0.5 * (rect.width as f64).hypot(rect.height as f64);
    near.profile(near.nearest(middle).distance - half_diagonal) > 0.0
}
