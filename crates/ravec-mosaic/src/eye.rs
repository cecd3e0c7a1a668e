//! Difference between mosaic and picture as seen from afar.
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

mod correlation;

pub(crate) use correlation::Correlation;

use crate::descriptor::Descriptor;
use crate::tiling::Tile;
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x8};

/// Half the width of the kernel in halves of a tile of common size. Beyond it the wider Gaussian has fallen below 2 % of its
/// peak.
const REACH: usize = 4;

/// Standard deviations of the blurs in halves of a tile, as they act on products of two blurred differences: half a tile and a
/// quarter of a tile, times the square root of 2.
const SIGMAS: [f64; 2] = [std::f64::consts::SQRT_2, std::f64::consts::FRAC_1_SQRT_2];

/// Weight of a blurred difference against that of a single tile, for each blur, at the strength 1.
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
    simd: Level,
    stride: usize,
    kernels: Kernels,
    /// For each channel, bordered by the reach in cells without difference on each side, and by [`LANES`] at the end.
    cells: [Vec<f32>; 3],
}

/// Cells that are multiplied together.
const LANES: usize = 8;

/// The kernel as quarters of all sizes see it.
#[derive(Debug, Clone)]
struct Kernels {
    /// Half the width of the kernel in cells.
    reach: usize,
    /// By the number of cells along a quarter of a tile, from 1.
    quarters: Vec<Quarter>,
}

/// The kernel as quarters of one size see it. It is a sum of products of a function across and the same one down, and so are
/// its sums over squares of cells.
#[derive(Debug, Clone)]
struct Quarter {
    /// Cells along a side.
    side: usize,
    /// For each cell before, in and behind a quarter, as far as the kernels reach, the sums of the two kernels over the cells of
    /// the quarter along one axis.
    sums: Vec<[f32; SIGMAS.len()]>,
    /// The same sums for each of the two kernels, [`LANES`] at a time, followed by zeros.
    lanes: Vec<[[f32; LANES]; SIGMAS.len()]>,
    /// The energy of each mode of a tile whose square is 1, with all cells of the tile.
    energies: [f32; MODES],
}

/// Walsh–Hadamard coefficients of the colors of four quarters, orthonormal: for each channel half the sum of the quarters, half of left
/// minus right, half of upper minus lower, and half of one diagonal minus the other. The energy is diagonal in this basis, as the
/// kernel between two quarters depends only on whether they differ across and down.
///
/// Those of a photo lie in one line of a cache, as photos are looked at in no order.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub(crate) struct Modes([f32; MODES]);

/// Four modes of three channels.
const MODES: usize = 12;

impl Modes {
    pub fn of(quarters: &[[f32; 3]; 4]) -> Self {
        let mut modes = [0.0; MODES];
        for (modes, values) in modes.chunks_exact_mut(3).zip(walsh_hadamard(quarters)) {
            modes.copy_from_slice(&values);
        }
        Self(modes)
    }

    /// The difference from others.
    pub fn less(&self, other: &Self) -> Self {
        let mut difference = self.0;
        for (value, other) in difference.iter_mut().zip(&other.0) {
            *value -= other;
        }
        Self(difference)
    }

    /// The quarters, to rounding.
    fn quarters(&self) -> [[f32; 3]; 4] {
        let mode = |m: usize| [0, 1, 2].map(|c| self.0[3 * m + c]);
        walsh_hadamard(&[mode(0), mode(1), mode(2), mode(3)])
    }
}

/// The orthonormal Walsh–Hadamard transform of four quarters, which is its own inverse.
fn walsh_hadamard([a, b, c, d]: &[[f32; 3]; 4]) -> [[f32; 3]; 4] {
    let of = |signs: [f32; 4]| {
        [0, 1, 2].map(|channel| {
            let [s, t, u, v] = signs;
            0.5 * (s * a[channel] + t * b[channel] + u * c[channel] + v * d[channel])
        })
    };
    [
        of([1.0, 1.0, 1.0, 1.0]),
        of([1.0, -1.0, 1.0, -1.0]),
        of([1.0, 1.0, -1.0, -1.0]),
        of([1.0, -1.0, -1.0, 1.0]),
    ]
}

/// Dependence of the energy on the photo of one tile, all others fixed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pull {
    /// The picture in the tile.
    wanted: Modes,
    linear: [f32; MODES],
    quadratic: [f32; MODES],
}

impl Pull {
    /// The part of the energy that depends on the photo of the tile.
    #[inline]
    pub fn energy(&self, photo: &Modes) -> f32 {
        // four sums for the lanes of a vector
        let mut sums = [0.0f32; 4];
        for at in (0..MODES).step_by(4) {
            for (lane, sum) in sums.iter_mut().enumerate() {
                let residual = photo.0[at + lane] - self.wanted.0[at + lane];
                let field = self.quadratic[at + lane] * residual + self.linear[at + lane];
                *sum += residual * field;
            }
        }
        (sums[0] + sums[2]) + (sums[1] + sums[3])
    }

    /// A number that no photo is below, rounding included.
    pub fn least(&self) -> f32 {
        // the vertices of the parabolas
        let modes = self.linear.iter().zip(&self.quadratic);
        let least: f32 = (modes)
            .map(|(&l, &q)| {
                if l == 0.0 {
                    0.0
                } else {
                    l * l / (4.0 * q.max(0.0))
                }
            })
            .sum();
        -1.001 * least
    }
}

impl Eye {
    /// A mosaic of `columns` × `rows` cells that is the picture; `units` cells are half a tile of common size, and no quarter
    /// of a tile has more than `largest` cells along a side.
    pub fn new(columns: usize, rows: usize, units: usize, largest: usize, strength: f64) -> Self {
        let kernels = Kernels::new(units, largest, strength);
        let stride = columns + 2 * kernels.reach;
        let cells = stride * (rows + 2 * kernels.reach) + LANES;
        Self {
            simd: Level::new(),
            stride,
            cells: [(); 3].map(|()| vec![0.0; cells]),
            kernels,
        }
    }

    /// Sets the residual of a tile.
    pub fn put(&mut self, tile: Footprint, residual: &Residual) {
        let reach = self.kernels.reach;
        for (index, value) in residual.iter().enumerate() {
            for (col, row) in tile.cells(index) {
                let at = (row + reach) * self.stride + col + reach;
                for (cells, value) in self.cells.iter_mut().zip(value) {
                    cells[at] = *value;
                }
            }
        }
    }

    /// Dependence of the energy on the photo of a tile where the picture is `wanted`. The residual of the tile is set to 0.
    pub fn lift(&mut self, tile: Footprint, wanted: Modes) -> Pull {
        self.put(tile, &[[0.0; 3]; 4]);
        let quarter = &self.kernels.quarters[tile.quarter - 1];
        let first = tile.row * self.stride + tile.col;
        let mut linear = [[0.0f32; 3]; 4];
        for (channel, cells) in self.cells.iter().enumerate() {
            let cells = &cells[first..];
            let sums = dispatch!(self.simd, simd => quarter.correlate(simd, cells, self.stride));
            for (linear, sum) in linear.iter_mut().zip(sums) {
                linear[channel] = sum;
            }
        }
        Pull {
            wanted,
            linear: Modes::of(&linear).0.map(|value| 2.0 * value),
            quadratic: quarter.energies,
        }
    }
}

impl Kernels {
    /// The kernels for quarters with up to `largest` cells along a side, where `units` cells are half a tile of common size.
    fn new(units: usize, largest: usize, strength: f64) -> Self {
        let reach = REACH * units;
        // the share of a cell in a tile
        let share = 1.0 / (4 * units * units) as f64;
        let lines =
            SIGMAS.map(|sigma| kernel(sigma * units as f64, reach, WEIGHT * strength * share));
        Self {
            reach,
            quarters: (1..=largest)
                .map(|side| Quarter::new(side, &lines))
                .collect(),
        }
    }
}

/// A Gaussian of standard deviation `sigma` in cells from −`reach` to `reach`, whose product with itself has the sum `total`.
fn kernel(sigma: f64, reach: usize, total: f64) -> Vec<f64> {
    let line: Vec<f64> = (0..=2 * reach)
        .map(|at| (-(at as f64 - reach as f64).powi(2) / (2.0 * sigma * sigma)).exp())
        .collect();
    let factor = total.sqrt() / line.iter().sum::<f64>();
    line.into_iter().map(|value| factor * value).collect()
}

impl Quarter {
    fn new(side: usize, lines: &[Vec<f64>; SIGMAS.len()]) -> Self {
        let width = lines[0].len();
        // the sum over the cells of a quarter of the kernel that is centered on the cell `at`, counted from the first that reaches it
        let sum = |line: &[f64], at: usize| -> f64 {
            (0..side)
                .filter_map(|cell| line.get((cell + width - 1).checked_sub(at)?))
                .sum()
        };
        let along =
            |line: &[f64]| -> Vec<f64> { (0..side + width - 1).map(|at| sum(line, at)).collect() };
        let sums = lines.each_ref().map(|line| along(line));
        // between the halves of a tile along one axis: of a half with itself, and with the other
        let reach = width / 2;
        let halves = sums.each_ref().map(|sums| {
            let of = |begin: usize| -> f64 { sums.iter().skip(begin).take(side).sum() };
            [of(reach), of(reach + side)]
        });
        // a mode is even or odd along each axis: its half goes with itself, and with or against the other
        let along = |half: &[f64; 2], odd: usize| match odd {
            0 => half[0] + half[1],
            _ => half[0] - half[1],
        };
        let energy = |mode: usize| -> f64 {
            let (across, down) = (mode % 2, mode / 2);
            (halves.iter())
                .map(|half| along(half, across) * along(half, down))
                .sum()
        };
        let mut energies = [0.0; MODES];
        for (mode, energies) in energies.chunks_exact_mut(3).enumerate() {
            energies.fill(energy(mode) as f32);
        }
        let at = |at: usize| sums.each_ref().map(|sums| sums[at] as f32);
        let lanes = |first: usize| {
            sums.each_ref().map(|sums| {
                let mut lanes = [0.0; LANES];
                for (lane, sum) in lanes.iter_mut().zip(&sums[first..]) {
                    *lane = *sum as f32;
                }
                lanes
            })
        };
        let around = side + width - 1;
        Self {
            side,
            sums: (0..around).map(at).collect(),
            lanes: (0..around).step_by(LANES).map(lanes).collect(),
            energies,
        }
    }

    /// The sums of the cells around a tile, times the kernel of each of its quarters. `cells` begin with the first one that reaches the
    /// tile, and have `stride` in a row.
    #[inline(always)]
    fn correlate<S: Simd>(&self, simd: S, cells: &[f32], stride: usize) -> [f32; 4] {
        let zero = f32x8::splat(simd, 0.0);
        let mut sums = [zero; 4];
        for down in 0..self.sums.len() + self.side {
            for half in 0..2 {
                let line = &cells[down * stride + half * self.side..];
                let mut across = [zero; SIGMAS.len()];
                for (cells, weights) in line.chunks_exact(LANES).zip(&self.lanes) {
                    let cells = f32x8::from_slice(simd, cells);
                    across[0] += f32x8::from_slice(simd, &weights[0]) * cells;
                    across[1] += f32x8::from_slice(simd, &weights[1]) * cells;
                }
                if let Some(weights) = self.sums.get(down) {
                    sums[half] += across[0] * weights[0] + across[1] * weights[1];
                }
                // the lower quarters begin further down
                if let Some(weights) = self.sums.get(down.wrapping_sub(self.side)) {
                    sums[2 + half] += across[0] * weights[0] + across[1] * weights[1];
                }
            }
        }
        let mut totals = [0.0; 4];
        for (total, sums) in totals.iter_mut().zip(sums) {
            let mut lanes = [0.0; LANES];
            sums.store_slice(&mut lanes);
            let [a, b, c, d, e, f, g, h] = lanes;
            *total = ((a + e) + (c + g)) + ((b + f) + (d + h));
        }
        totals
    }
}

/// Weighted squared distance of a photo from its tile: tiles count by their area, in that of a tile of common size; and
/// as the errors of larger tiles are coarser and stay when one steps back, by the third power of their side beside.
pub(crate) fn tile_cost(tile: &Tile, units: usize, distance_sq: f32) -> f32 {
    (tile.side as f32 / units as f32).powi(5) * distance_sq
}

/// The quarters of a photo less those of its tile.
pub(crate) fn residual(photo: &Modes, tile: &Descriptor) -> Residual {
    let mut result = photo.quarters();
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

    /// The whole energy, by its definition: products of the differences of all pairs of cells.
    fn energy(eye: &Eye, units: usize, strength: f64) -> f64 {
        let reach = (REACH * units) as i64;
        let gaussian = |sigma: f64, at: i64| (-((at * at) as f64) / (2.0 * sigma * sigma)).exp();
        let weight = |dx: i64, dy: i64| -> f64 {
            let of = |sigma: f64| {
                let sigma = sigma * units as f64;
                let total: f64 = (-reach..=reach).map(|at| gaussian(sigma, at)).sum();
                gaussian(sigma, dx) * gaussian(sigma, dy) / (total * total)
            };
            WEIGHT * strength * SIGMAS.map(of).iter().sum::<f64>() / (4 * units * units) as f64
        };
        let stride = eye.stride;
        let cell = |at: usize| eye.cells.each_ref().map(|cells| cells[at]);
        let shown: Vec<(i64, i64, [f32; 3])> = (0..eye.cells[0].len())
            .filter(|&at| cell(at) != [0.0; 3])
            .map(|at| ((at % stride) as i64, (at / stride) as i64, cell(at)))
            .collect();
        let mut sum = 0.0;
        for (x, y, here) in &shown {
            for (u, v, there) in &shown {
                if (x - u).abs() <= reach && (y - v).abs() <= reach {
                    let product: f32 = here.iter().zip(there).map(|(a, b)| a * b).sum();
                    sum += weight(x - u, y - v) * f64::from(product);
                }
            }
        }
        sum
    }

    #[test]
    fn modes_keep_sums_of_squares_and_give_the_quarters_back() {
        let quarters = some(11);
        let modes = Modes::of(&quarters);
        let square = |values: &[f32]| values.iter().map(|v| v * v).sum::<f32>();
        let difference = square(&modes.0) - square(quarters.as_flattened());
        assert!(difference.abs() < 1e-6, "{difference}");
        let back = modes.quarters();
        let pairs = back.as_flattened().iter().zip(quarters.as_flattened());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6));
    }

    #[test]
    fn the_change_of_the_energy_is_that_of_the_pull() {
        let tile = |col, row, quarter| Footprint { col, row, quarter };
        for units in [1, 2] {
            let mut eye = Eye::new(12, 10, units, 2, 0.7);
            eye.put(tile(0, 0, 1), &some(1));
            eye.put(tile(2, 0, 1), &some(2));
            eye.put(tile(8, 4, 2), &some(3));
            for at in [tile(2, 2, 1), tile(4, 2, 2), tile(10, 0, 1)] {
                let tile = Descriptor {
                    coefficients: vec![],
                    quarters: some(7),
                };
                let pull = eye.lift(at, Modes::of(&tile.quarters));
                let without = energy(&eye, units, 0.7);
                let photo = Modes::of(&some(5));
                eye.put(at, &residual(&photo, &tile));
                let change = energy(&eye, units, 0.7) - without;
                let error = (change - f64::from(pull.energy(&photo))).abs();
                // sums of some hundred products in single precision
                assert!(error < 1e-4 * change.abs().max(1.0), "{error} of {change}");
                eye.put(at, &[[0.0; 3]; 4]);
            }
        }
    }
}
