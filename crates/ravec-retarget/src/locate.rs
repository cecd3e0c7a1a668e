//! Which cell each pixel of the new picture lies in, and where in it.
//!
//! A cell of the new picture is a convex quadrilateral. A row of pixel centres crosses it in one stretch, which begins and ends
//! on two of its sides; where a stretch ends is computed from the two ends of the side alone, so that the neighbour begins at
//! the same number. Hence every pixel is in one cell, whatever the rounding.
//!
//! Within a cell, at `a + u e + v f + u v g`, a point is found by the quadratic for v. It is solved in the form that divides by
//! `k₁ + √(k₁² − 4 k₀ k₂)`, which is twice the area of the corner below and so never near 0.
//!
//! Cost: a square root and three divisions a pixel.

use crate::deformation::Deformation;
use glam::{DVec2, dvec2};

/// Pixels `first..end` of a row that lie in a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stretch {
    pub(crate) first: usize,
    pub(crate) end: usize,
    pub(crate) cell: u32,
}

/// The borders of the cells in the new picture, scaled to an output of any size.
pub(crate) struct Locator<'a> {
    deformation: &'a Deformation,
    scale: DVec2,
    columns: usize,
    /// The sides of each cell as chains of vertices that include those that hang on them.
    sides: Vec<(u32, u32)>,
    side_ends: Vec<usize>,
    /// First and last height of each cell.
    heights: Vec<[f64; 2]>,
}

impl<'a> Locator<'a> {
    /// For an output that is `scale` times the new picture, `columns` wide.
    pub(crate) fn new(deformation: &'a Deformation, scale: DVec2, columns: usize) -> Self {
        let grid = &deformation.grid;
        let (mut sides, mut side_ends) = (Vec::new(), Vec::new());
        let mut heights = Vec::with_capacity(grid.cells.len());
        for cell in &grid.cells {
            let [a, b, c, d] = cell.corners;
            let first = sides.len();
            for ends in [[a, b], [c, d], [a, c], [b, d]] {
                let mut from = ends[0];
                for to in grid.within_side(ends).chain([ends[1]]) {
                    sides.push((from, to));
                    from = to;
                }
            }
            side_ends.push(sides.len());
            let ys = sides[first..]
                .iter()
                .flat_map(|&(from, to)| [from, to])
                .map(|vertex| deformation.vertices[vertex as usize].y * scale.y);
            heights.push(
                ys.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], y| {
                    [low.min(y), high.max(y)]
                }),
            );
        }
        Self {
            deformation,
            scale,
            columns,
            sides,
            side_ends,
            heights,
        }
    }

    /// The cells that a strip of rows crosses.
    pub(crate) fn cells_in(&self, first_row: usize, rows: usize) -> Vec<u32> {
        let (low, high) = (first_row as f64, (first_row + rows) as f64);
        (0..self.heights.len())
            .filter(|&k| self.heights[k][1] > low && self.heights[k][0] < high)
            .map(|k| k as u32)
            .collect()
    }

    fn vertex(&self, vertex: u32) -> DVec2 {
        self.deformation.vertices[vertex as usize] * self.scale
    }

    /// The stretches of a row, for those of `cells` that it crosses.
    pub(crate) fn stretches(&self, row: usize, cells: &[u32], into: &mut Vec<Stretch>) {
        into.clear();
        let y = row as f64 + 0.5;
        for &cell in cells {
            let index = cell as usize;
            if !(self.heights[index][0] <= y && y < self.heights[index][1]) {
                continue;
            }
            let start = if index == 0 {
                0
            } else {
                self.side_ends[index - 1]
            };
            let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
            for &(from, to) in &self.sides[start..self.side_ends[index]] {
                let (from, to) = (self.vertex(from), self.vertex(to));
                let (top, bottom) = if from.y <= to.y {
                    (from, to)
                } else {
                    (to, from)
                };
                if top.y <= y && y < bottom.y {
                    let x = top.x + (y - top.y) / (bottom.y - top.y) * (bottom.x - top.x);
                    left = left.min(x);
                    right = right.max(x);
                }
            }
            // the first pixel whose centre is not left of x; a cast saturates
            let pixel = |x: f64| ((x - 0.5).ceil() as usize).min(self.columns);
            let (first, end) = (pixel(left), pixel(right));
            if first < end {
                into.push(Stretch { first, end, cell });
            }
        }
    }

    /// How a cell is turned back.
    pub(crate) fn inverse(&self, cell: u32, source_unit: DVec2) -> CellInverse {
        let grid = &self.deformation.grid;
        let cell = &grid.cells[cell as usize];
        let [a, b, c, d] = self.deformation.corners(cell).map(|at| at * self.scale);
        let [width, height] = grid.extent(cell);
        CellInverse {
            a,
            e: b - a,
            f: c - a,
            g: a - b - c + d,
            first: dvec2(cell.first[0] as f64, cell.first[1] as f64) * source_unit,
            extent: dvec2(width as f64, height as f64) * source_unit,
        }
    }
}

/// A cell of the new picture on the way back to the old one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CellInverse {
    a: DVec2,
    e: DVec2,
    f: DVec2,
    g: DVec2,
    first: DVec2,
    extent: DVec2,
}

impl CellInverse {
    /// Where a point of the cell was.
    #[inline(always)]
    pub(crate) fn source(&self, at: DVec2) -> DVec2 {
        let h = at - self.a;
        let k0 = h.perp_dot(self.e);
        let k1 = self.e.perp_dot(self.f) + h.perp_dot(self.g);
        let k2 = self.g.perp_dot(self.f);
        let root = (k1 * k1 - 4.0 * k0 * k2).max(0.0).sqrt();
        let v = -2.0 * k0 / (k1 + root);
        let u = (h.x - self.f.x * v) / (self.e.x + self.g.x * v);
        self.first + self.extent * dvec2(u, v).clamp(DVec2::ZERO, DVec2::ONE)
    }

    /// How many pixels of the old picture, along x and along y, a pixel at a point of it sees.
    pub(crate) fn footprint(&self, source: DVec2) -> DVec2 {
        let uv = (source - self.first) / self.extent;
        let (e, f) = (self.e + uv.y * self.g, self.f + uv.x * self.g);
        let area = e.perp_dot(f);
        self.extent * dvec2(f.length(), e.length()) / area
    }
}
