//! What is left of the difference between mosaic and picture when one steps back.
//!
//! From afar neighboring tiles melt into one another: what one tile is too dark may be made up for by its neighbors being
//! too bright. The energy of a mosaic therefore has, beside the sum over tiles of how far each photo is from its tile, the
//! squared difference of mosaic and picture after blurs by half a tile and by a quarter of a tile. With its gradient known on
//! a grid of cells of half a unit, the change of the energy by another photo costs a few dozen products.
//!
//! This takes the place of error diffusion, which hands the error of a tile on to those that come later: here all tiles
//! answer for all others, and the limits on repeats hold while they do.
//!
//! Source: the model of the eye is that of direct binary search in halftoning (Analoui, Allebach, 1992).

use crate::look::Look;

/// Half the width of the kernel in halves of a tile of common size. Beyond it the wider Gaussian has fallen below 2 % of its
/// peak.
const REACH: usize = 4;

/// Standard deviations of the blurs in halves of a tile, as they act on products of two blurred differences: half a tile and a
/// quarter of a tile, times the square root of 2.
const SIGMAS: [f64; 2] = [std::f64::consts::SQRT_2, std::f64::consts::FRAC_1_SQRT_2];

/// How much a blurred difference counts against that of a single tile, for each blur, at the strength 1.
const WEIGHT: f64 = 32.0;

/// A tile on the grid of cells: where it begins, and how many cells a quarter of it has in each direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Footprint {
    pub col: usize,
    pub row: usize,
    pub quarter: usize,
}

impl Footprint {
    fn cells(self, index: usize) -> impl Iterator<Item = (usize, usize)> {
        let (col, row) = (
            self.col + (index % 2) * self.quarter,
            self.row + (index / 2) * self.quarter,
        );
        (row..row + self.quarter)
            .flat_map(move |row| (col..col + self.quarter).map(move |col| (col, row)))
    }
}

/// Colors of four quarters, less those of the picture.
pub(crate) type Residual = [[f32; 3]; 4];

/// The difference of mosaic and picture on a grid of cells.
#[derive(Debug, Clone)]
pub(crate) struct Eye {
    stride: usize,
    /// Half the width of the kernel in cells.
    reach: usize,
    /// Row by row.
    kernel: Vec<f32>,
    /// Bordered by the reach in cells without difference on each side.
    cells: Vec<[f32; 3]>,
}

/// How the energy depends on the residual of one tile, all others held.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pull {
    linear: [[f32; 3]; 4],
    quadratic: [[f32; 4]; 4],
}

impl Pull {
    /// The part of the energy that depends on the residual of the tile.
    pub fn energy(&self, residual: &Residual) -> f32 {
        let mut sum = 0.0f32;
        for (a, here) in residual.iter().enumerate() {
            for c in 0..3 {
                let mut field = 2.0 * self.linear[a][c];
                for (b, there) in residual.iter().enumerate() {
                    field += self.quadratic[a][b] * there[c];
                }
                sum += here[c] * field;
            }
        }
        sum
    }
}

impl Eye {
    /// A mosaic of `columns` × `rows` cells that is the picture; `units` cells are half a tile of common size.
    pub fn new(columns: usize, rows: usize, units: usize, strength: f64) -> Self {
        let reach = REACH * units;
        let side = 2 * reach + 1;
        let mut kernel = vec![0.0f32; side * side];
        // the share of a cell in a tile
        let share = 1.0 / (4 * units * units) as f64;
        for sigma in SIGMAS {
            let sigma = sigma * units as f64;
            let line: Vec<f64> = (0..side)
                .map(|at| (-(at as f64 - reach as f64).powi(2) / (2.0 * sigma * sigma)).exp())
                .collect();
            let total: f64 = line.iter().sum();
            for (kernel, a) in kernel.chunks_exact_mut(side).zip(&line) {
                for (kernel, b) in kernel.iter_mut().zip(&line) {
                    *kernel += (WEIGHT * strength * a * b / (total * total) * share) as f32;
                }
            }
        }
        let stride = columns + 2 * reach;
        Self {
            stride,
            reach,
            kernel,
            cells: vec![[0.0; 3]; stride * (rows + 2 * reach)],
        }
    }

    fn side(&self) -> usize {
        2 * self.reach + 1
    }

    /// Sets the residual of a tile.
    pub fn put(&mut self, tile: Footprint, residual: &Residual) {
        for (index, value) in residual.iter().enumerate() {
            for (col, row) in tile.cells(index) {
                self.cells[(row + self.reach) * self.stride + col + self.reach] = *value;
            }
        }
    }

    /// How the energy depends on the residual of a tile, which is set to 0.
    pub fn lift(&mut self, tile: Footprint) -> Pull {
        self.put(tile, &[[0.0; 3]; 4]);
        let mut pull = Pull {
            linear: [[0.0; 3]; 4],
            quadratic: [[0.0; 4]; 4],
        };
        for (index, linear) in pull.linear.iter_mut().enumerate() {
            for (col, row) in tile.cells(index) {
                for (dy, weights) in self.kernel.chunks_exact(self.side()).enumerate() {
                    let line = &self.cells[(row + dy) * self.stride + col..][..weights.len()];
                    for (weight, cell) in weights.iter().zip(line) {
                        for (sum, value) in linear.iter_mut().zip(cell) {
                            *sum += weight * value;
                        }
                    }
                }
            }
        }
        for (a, sums) in pull.quadratic.iter_mut().enumerate() {
            for (b, sum) in sums.iter_mut().enumerate() {
                *sum = self.between(tile, a, b);
            }
        }
        pull
    }

    /// The sum of the kernel between the cells of two quarters.
    fn between(&self, tile: Footprint, a: usize, b: usize) -> f32 {
        let mut sum = 0.0;
        for (x, y) in tile.cells(a) {
            for (u, v) in tile.cells(b) {
                let (dx, dy) = (x + self.reach, y + self.reach);
                let side = self.side();
                if dx >= u && dy >= v && dx - u < side && dy - v < side {
                    sum += self.kernel[(dy - v) * side + dx - u];
                }
            }
        }
        sum
    }

    /// The whole energy of the blurred difference.
    #[cfg(test)]
    pub fn energy(&self) -> f64 {
        let rows = self.cells.len() / self.stride;
        let mut sum = 0.0;
        for row in self.reach..rows - self.reach {
            for col in self.reach..self.stride - self.reach {
                for (dy, weights) in self.kernel.chunks_exact(self.side()).enumerate() {
                    for (dx, &weight) in weights.iter().enumerate() {
                        let there = self.cells
                            [(row + dy - self.reach) * self.stride + col + dx - self.reach];
                        let here = self.cells[row * self.stride + col];
                        let product: f32 = here.iter().zip(there).map(|(a, b)| a * b).sum();
                        sum += f64::from(weight) * f64::from(product);
                    }
                }
            }
        }
        sum
    }
}

/// The quarters of a photo less those of its tile.
pub(crate) fn residual(photo: &[[f32; 3]; 4], tile: &Look) -> Residual {
    let mut result = *photo;
    for (result, tile) in result.iter_mut().zip(&tile.quarters) {
        for (result, tile) in result.iter_mut().zip(tile) {
            *result -= tile;
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some(seed: u32) -> Residual {
        let number = |i: u32| ((seed * 31 + i * 17) % 23) as f32 / 23.0 - 0.5;
        [0, 1, 2, 3].map(|q| [0, 1, 2].map(|c| number(3 * q + c)))
    }

    #[test]
    fn the_change_of_the_energy_is_that_of_the_pull() {
        let tile = |col, row, quarter| Footprint { col, row, quarter };
        for units in [1, 2] {
            let mut eye = Eye::new(12, 10, units, 0.7);
            eye.put(tile(0, 0, 1), &some(1));
            eye.put(tile(2, 0, 1), &some(2));
            eye.put(tile(8, 4, 2), &some(3));
            for at in [tile(2, 2, 1), tile(4, 2, 2), tile(10, 0, 1)] {
                let pull = eye.lift(at);
                let without = eye.energy();
                eye.put(at, &some(5));
                let change = eye.energy() - without;
                let error = (change - f64::from(pull.energy(&some(5)))).abs();
                // sums of some hundred products in single precision
                assert!(error < 1e-4 * change.abs().max(1.0), "{error} of {change}");
                eye.put(at, &[[0.0; 3]; 4]);
            }
        }
    }
}
