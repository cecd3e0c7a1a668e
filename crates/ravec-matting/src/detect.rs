//! Detection of foreground: the squared difference of a frame to its plate, and bounding rectangles of what is significant.

use crate::light::PlateLight;
use crate::matte::{Colors, Constraint, Constraints};
use fearless_simd::{Level as Vectors, Simd, dispatch};
use ravec_raster::{Plane, Rect, Size, gaussian_blur};

/// χ² of three channels above which a pixel is foreground for certain, by itself and smoothed.
pub(crate) const CERTAIN: f32 = 20.0;
pub(crate) const CERTAIN_SMOOTH: f32 = 30.0;
/// Smoothed χ² above which a pixel may be foreground.
const SUSPECT_SMOOTH: f32 = 10.0;
/// Largest χ², so that sums of it stay finite.
const MAX_CHI_SQUARED: f32 = 1e6;
/// Pixels of a side of the cells of which rectangles consist. It is even, so that halves of all rectangles have the same grid.
const CELL_PX: usize = 8;
/// Cells by which a rectangle is larger than what is suspect.
const MARGIN_CELLS: usize = 2;
/// Pixels of the margin.
pub(crate) const MARGIN_PX: usize = MARGIN_CELLS * CELL_PX;
/// Suspect pixels below which what is connected counts as noise: fewer are no solid part of a foreground.
const MIN_SUSPECTS: usize = 14;

/// The squared difference of a frame to its plate, in units of its variance: χ² of three channels.
pub(crate) struct Difference {
    /// χ² of each pixel.
    pub chi_squared: Plane,
    /// χ², blurred by one pixel.
    pub smooth: Plane,
}

/// Statistics of a cell.
#[derive(Clone, Copy, Default)]
struct Cell {
    suspects: usize,
    is_certain: bool,
    is_marked: bool,
}

impl Cell {
    fn plus(self, other: Self) -> Self {
        Self {
            suspects: self.suspects + other.suspects,
            is_certain: self.is_certain || other.is_certain,
            is_marked: self.is_marked || other.is_marked,
        }
    }

    fn may_be_foreground(self) -> bool {
        self.suspects > 0 || self.is_marked
    }

    /// Returns `true` for what is large and different enough to be foreground by itself.
    fn is_foreground(self) -> bool {
        self.is_marked || (self.is_certain && self.suspects >= MIN_SUSPECTS)
    }
}

impl Difference {
    /// Compares a frame with its plate in the light of the frame.
    pub fn new(frame: &Colors, background: &Colors, variance: &Plane, light: &PlateLight) -> Self {
        let width = frame.width();
        let scale: Vec<f32> = (0..3 * width).map(|at| 1.0 / light.sigma[at % 3]).collect();
        let mut chi_squared = Plane::new(frame.size(), 0.0);
        chi_squared.for_each_row(|row, out| {
            let (frame, plate) = (
                frame.row(row).as_flattened(),
                background.row(row).as_flattened(),
            );
            let variance = variance.row(row);
            dispatch!(Vectors::new(), simd => compare(simd, frame, plate, &scale, variance, out));
        });
        Self {
            smooth: gaussian_blur(&chi_squared, 1.0),
            chi_squared,
        }
    }

    /// Rectangles that contain all foreground, and a margin around it. They do not overlap. There are none for a frame without
    /// foreground.
    pub fn regions(&self, strokes: Option<&Constraints>) -> Vec<Rect> {
        let size = self.chi_squared.size();
        let grid = size.cells(CELL_PX);
        let cells = self.cells(strokes);
        let suspects = cells.iter().map(|cell| cell.may_be_foreground());
        let mut rects: Vec<Rect> = components(suspects.collect(), grid)
            .into_iter()
            .filter(|component| {
                component
                    .iter()
                    .fold(Cell::default(), |sum, &at| sum.plus(cells[at]))
                    .is_foreground()
            })
            .map(|component| grown(bounds(&component, grid), MARGIN_CELLS, grid))
            .collect();
        // what overlaps becomes one, until nothing does
        loop {
            let count = rects.len();
            let mut covered = vec![false; grid.pixels()];
            for rect in &rects {
                for row in rect.row..rect.bottom() {
                    covered[row * grid.width()..][rect.col..rect.right()].fill(true);
                }
            }
            rects = components(covered, grid)
                .into_iter()
                .map(|component| bounds(&component, grid))
                .collect();
            if rects.len() == count {
                break;
            }
        }
        rects
            .into_iter()
            .map(|cells| {
                Rect::new(
                    cells.col * CELL_PX,
                    cells.row * CELL_PX,
                    cells.width * CELL_PX,
                    cells.height * CELL_PX,
                )
                .clipped(size)
            })
            .collect()
    }

    /// The cells of the frame, row by row.
    fn cells(&self, strokes: Option<&Constraints>) -> Vec<Cell> {
        let grid = self.chi_squared.size().cells(CELL_PX);
        let mut cells = vec![Cell::default(); grid.pixels()];
        for row in 0..self.chi_squared.height() {
            let line = &mut cells[row / CELL_PX * grid.width()..][..grid.width()];
            let values = self.chi_squared.row(row).chunks(CELL_PX);
            let smooth = self.smooth.row(row).chunks(CELL_PX);
            for (cell, (values, smooth)) in line.iter_mut().zip(values.zip(smooth)) {
                let suspects = smooth.iter().filter(|smooth| **smooth > SUSPECT_SMOOTH);
                cell.suspects += suspects.count();
                cell.is_certain |= values
                    .iter()
                    .zip(smooth)
                    .any(|(value, smooth)| *value > CERTAIN && *smooth > CERTAIN_SMOOTH);
            }
            let Some(strokes) = strokes else { continue };
            for (cell, strokes) in line.iter_mut().zip(strokes.row(row).chunks(CELL_PX)) {
                let is_foreground = |stroke: &u8| Constraint::of(*stroke) == Constraint::Foreground;
                cell.is_marked |= strokes.iter().any(is_foreground);
            }
        }
        cells
    }
}

/// χ² of a row. Differences that are not finite count as none.
#[inline(always)]
fn compare<S: Simd>(
    _simd: S,
    frame: &[f32],
    plate: &[f32],
    scale: &[f32],
    variance: &[f32],
    out: &mut [f32],
) {
    let (frame, plate, scale) = (
        frame.as_chunks::<3>().0,
        plate.as_chunks::<3>().0,
        scale.as_chunks::<3>().0,
    );
    let colors = frame.iter().zip(plate).zip(scale);
    for ((out, variance), ((frame, plate), scale)) in out.iter_mut().zip(variance).zip(colors) {
        let [r, g, b] = [
            (frame[0] - plate[0]) * scale[0],
            (frame[1] - plate[1]) * scale[1],
            (frame[2] - plate[2]) * scale[2],
        ];
        let square = r * r + g * g + b * b;
        let value = (square / variance).min(MAX_CHI_SQUARED);
        *out = if square < f32::INFINITY { value } else { 0.0 };
    }
}

/// The sets of cells of a grid that touch, by side or corner, as indices.
fn components(mut is_open: Vec<bool>, grid: Size) -> Vec<Vec<usize>> {
    let (width, height) = (grid.width(), grid.height());
    let mut found = Vec::new();
    for first in 0..is_open.len() {
        if !std::mem::take(&mut is_open[first]) {
            continue;
        }
        let mut component = vec![first];
        let mut next = 0;
        while let Some(&at) = component.get(next) {
            next += 1;
            let (col, row) = (at % width, at / width);
            for row in row.saturating_sub(1)..(row + 2).min(height) {
                for col in col.saturating_sub(1)..(col + 2).min(width) {
                    if std::mem::take(&mut is_open[row * width + col]) {
                        component.push(row * width + col);
                    }
                }
            }
        }
        found.push(component);
    }
    found
}

/// The smallest rectangle around cells of a grid.
fn bounds(component: &[usize], grid: Size) -> Rect {
    let width = grid.width();
    let [mut left, mut top, mut right, mut bottom] = [usize::MAX, usize::MAX, 0, 0];
    for at in component {
        let (col, row) = (at % width, at / width);
        (left, top) = (left.min(col), top.min(row));
        (right, bottom) = (right.max(col + 1), bottom.max(row + 1));
    }
    Rect::new(
        left,
        top,
        right.saturating_sub(left),
        bottom.saturating_sub(top),
    )
}

/// A rectangle with a margin, within the grid.
fn grown(rect: Rect, margin: usize, grid: Size) -> Rect {
    let (col, row) = (
        rect.col.saturating_sub(margin),
        rect.row.saturating_sub(margin),
    );
    Rect::new(
        col,
        row,
        rect.right() + margin - col,
        rect.bottom() + margin - row,
    )
    .clipped(grid)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A difference of `value` in each rectangle, and of 3 elsewhere.
    fn difference(size: Size, rects: &[Rect], value: f32) -> Difference {
        let chi_squared = Plane::from_fn(size, |col, row| {
            if rects.iter().any(|rect| rect.contains(col, row)) {
                value
            } else {
                3.0
            }
        });
        Difference {
            smooth: gaussian_blur(&chi_squared, 1.0),
            chi_squared,
        }
    }

    #[test]
    fn regions_contain_what_differs_with_a_margin_and_do_not_overlap() {
        let size = Size::new(203, 161).unwrap();
        for seed in 0..40usize {
            let rects: Vec<Rect> = (0..=seed % 7)
                .map(|at| {
                    let place = (seed * 31 + at * 67) * 2_654_435_761;
                    Rect::new(place / 64 % 190, place / 4096 % 150, 6, 5 + at)
                })
                .collect();
            let regions = difference(size, &rects, 60.0).regions(None);
            for (at, region) in regions.iter().enumerate() {
                assert!(region.col % 2 == 0 && region.row % 2 == 0 && !region.is_empty());
                for other in &regions[at + 1..] {
                    assert!(
                        region.intersection(*other).is_empty(),
                        "{region:?} {other:?}"
                    );
                }
            }
            for rect in rects {
                let near = Rect::new(
                    rect.col.saturating_sub(16),
                    rect.row.saturating_sub(16),
                    rect.right() + 16 - rect.col.saturating_sub(16),
                    rect.bottom() + 16 - rect.row.saturating_sub(16),
                )
                .clipped(size);
                assert!(
                    regions
                        .iter()
                        .any(|region| region.intersection(near) == near)
                );
            }
        }
    }

    #[test]
    fn faint_and_small_differences_are_no_foreground_but_strokes_are() {
        let size = Size::new(90, 70).unwrap();
        let (large, small) = (Rect::new(30, 20, 20, 20), Rect::new(30, 20, 2, 1));
        assert!(difference(size, &[], 3.0).regions(None).is_empty());
        assert!(difference(size, &[large], 15.0).regions(None).is_empty());
        assert!(difference(size, &[small], 150.0).regions(None).is_empty());
        assert_eq!(difference(size, &[large], 60.0).regions(None).len(), 1);
        let mut strokes = Constraints::new(size, 128);
        strokes[(70, 50)] = 255;
        let found = difference(size, &[], 3.0).regions(Some(&strokes));
        assert!(found.len() == 1 && found[0].contains(70, 50));
    }
}
