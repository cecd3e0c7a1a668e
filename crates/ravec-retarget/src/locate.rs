//! Location of each pixel of the new picture: its cell, and its position in the cell.
//!
//! A cell of the new picture is a convex quadrilateral. A row of pixel centers crosses it in one stretch, which begins and ends
//! on two of its sides; where a stretch ends is computed from the two ends of the side alone, so that the neighbor begins at
//! the same number. Hence every pixel is in one cell, whatever the rounding.
//!
//! Within a cell, at `a + u e + v f + u v g`, a point is found by the quadratic for v. It is solved in the form that divides by
//! `k₁ + √(k₁² − 4 k₀ k₂)`, which is twice the area of the corner below and so never near 0.
//!
//! Cost: a square root and two divisions a pixel, four pixels at a time.

use crate::deformation::Deformation;
use crate::warp::WarpCell;
use fearless_simd::{f64x4, prelude::*};
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
            // the first pixel whose center is not left of x; a cast saturates
            let pixel = |x: f64| ((x - 0.5).ceil() as usize).min(self.columns);
            let (first, end) = (pixel(left), pixel(right));
            if first < end {
                into.push(Stretch { first, end, cell });
            }
        }
    }

    /// Inverse of the map of a cell.
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

/// Points that are turned back together.
pub(crate) const TOGETHER: usize = 4;

impl CellInverse {
    /// Where the points at the height `y` were whose x are `first`, `first` + 1 and so on: as many as `xs` and `ys` have, a
    /// multiple of [`TOGETHER`]. Those beyond the cell become anything.
    ///
    /// Both go up or down all along: lines of equal u, and those of equal v, are straight and do not cross in a cell that does
    /// not fold, so that a row crosses each once.
    #[inline(always)]
    pub(crate) fn sources<S: Simd>(&self, simd: S, first: f64, y: f64, [xs, ys]: [&mut [f64]; 2]) {
        let all = |value| f64x4::splat(simd, value);
        let (zero, one) = (all(0.0), all(1.0));
        let area = self.e.perp_dot(self.f);
        let k2 = self.g.perp_dot(self.f);
        let hy = y - self.a.y;
        let mut x = all(first) + f64x4::from_slice(simd, &[0.0, 1.0, 2.0, 3.0]);
        let places = xs
            .chunks_exact_mut(TOGETHER)
            .zip(ys.chunks_exact_mut(TOGETHER));
        for (xs, ys) in places {
            let hx = x - self.a.x;
            let k0 = hx * self.e.y - hy * self.e.x;
            let k1 = hx * self.g.y - hy * self.g.x + area;
            let root = (k1 * k1 - k0 * 4.0 * k2).max(zero).sqrt();
            let v = k0 * -2.0 / (k1 + root);
            let u = (hx - v * self.f.x) / (v * self.g.x + self.e.x);
            let within = |value: f64x4<S>| value.max(zero).min(one);
            (within(u) * self.extent.x + self.first.x).store_slice(xs);
            (within(v) * self.extent.y + self.first.y).store_slice(ys);
            x += TOGETHER as f64;
        }
    }

    /// First corner of the cell in the new picture.
    pub(crate) fn corner(&self) -> DVec2 {
        self.a
    }

    /// The cell as data.
    pub(crate) fn cell(&self) -> WarpCell {
        WarpCell {
            e: self.e,
            f: self.f,
            g: self.g,
            first: self.first,
            extent: self.extent,
        }
    }

    /// Footprint of a pixel at a point of the old picture: its size along x and along y, in old pixels.
    pub(crate) fn footprint(&self, source: DVec2) -> DVec2 {
        let uv = (source - self.first) / self.extent;
        let (e, f) = (self.e + uv.y * self.g, self.f + uv.x * self.g);
        let area = e.perp_dot(f);
        self.extent * dvec2(f.length(), e.length()) / area
    }
}
