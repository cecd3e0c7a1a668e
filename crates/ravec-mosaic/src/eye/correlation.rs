//! Correlation of the difference between mosaic and picture with the kernel of the eye, at each tile.
//!
//! Direct binary search looks at each place many times and changes it rarely, so the correlation is kept and each change is added
//! to it around the tile that changes, rather than summed over the surroundings of each tile that is looked at. Between two tiles the
//! kernel is a sum of products of a matrix across and one down, each of them two by two: from the even and odd modes of one tile
//! along the axis to those of the other.
//!
//! Cost: of a look, none; of a change, some hundred products for each tile within reach of the kernel.

use super::{Kernels, MODES, Modes, Pull, SIGMAS};
use crate::tiling::{Tile, Tiling};
use rayon::prelude::*;
use std::ops::Range;

/// No tile covers a unit.
const NO_TILE: u32 = u32::MAX;

/// From the modes of one tile along an axis, even and odd, to those of another, for each of the two kernels.
type Axis = [[[f32; 2]; 2]; SIGMAS.len()];

/// The correlation of mosaic less picture with the kernel of the eye, for the modes of each tile.
#[derive(Debug, Clone)]
pub(crate) struct Correlation<'a> {
    tiling: &'a Tiling,
    /// Cells along half a unit.
    cells: usize,
    kernels: Kernels,
    /// Sums of the kernels over pairs of halves of tiles: for a half with `a` cells and one with `b` cells,
    /// `halves[(a - 1) * largest + b - 1]` by the cells from the first one to the second, from the least one within reach.
    halves: Vec<Vec<[f32; SIGMAS.len()]>>,
    /// The tile on each unit.
    owner: Vec<u32>,
    /// For each tile, the correlation without the tile itself.
    of_tiles: Vec<[f32; MODES]>,
}

impl<'a> Correlation<'a> {
    /// A mosaic that is the picture. `cells` are those along half a unit; `strength` is that of the blend.
    pub fn new(tiling: &'a Tiling, cells: usize, strength: f64) -> Self {
        let largest = tiling.tiles.iter().map(|tile| tile.side).max();
        let largest = cells * largest.unwrap_or(1);
        let kernels = Kernels::new(cells * tiling.units, largest, strength);
        let pairs = (1..=largest).flat_map(|a| (1..=largest).map(move |b| (a, b)));
        let halves = pairs.map(|(a, b)| kernels.halves(a, b)).collect();
        let mut owner = vec![NO_TILE; tiling.columns * tiling.rows];
        for (number, tile) in (0..).zip(&tiling.tiles) {
            for row in tile.row..tile.row + tile.side {
                owner[row * tiling.columns + tile.col..][..tile.side].fill(number);
            }
        }
        Self {
            tiling,
            cells,
            kernels,
            halves,
            owner,
            of_tiles: vec![[0.0; MODES]; tiling.tiles.len()],
        }
    }

    /// Sets the residuals of all tiles: the modes of their photos, less those of the picture.
    pub fn set(&mut self, residuals: &[Modes]) {
        let of_tile = |tile: usize| {
            let mut sum = [0.0; MODES];
            self.around(tile, |other| {
                self.add(tile, other, &residuals[other], &mut sum);
            });
            sum
        };
        self.of_tiles = (0..residuals.len()).into_par_iter().map(of_tile).collect();
    }

    /// Dependence of the energy on the photo of a tile where the picture is `wanted`.
    pub fn pull(&self, tile: usize, wanted: Modes) -> Pull {
        Pull {
            wanted,
            linear: self.of_tiles[tile].map(|value| 2.0 * value),
            quadratic: self.kernels.quarters[self.quarter(tile) - 1].energies,
        }
    }

    /// The dependence as [`pull`](Self::pull) has it, after `change` was added to the residual of another tile.
    pub fn pull_after(&self, tile: usize, wanted: Modes, other: usize, change: &Modes) -> Pull {
        let mut sum = self.of_tiles[tile];
        self.add(tile, other, change, &mut sum);
        Pull {
            linear: sum.map(|value| 2.0 * value),
            ..self.pull(tile, wanted)
        }
    }

    /// Adds `change` to the residual of a tile; calls `changed` for each tile whose dependence is another one.
    pub fn change(&mut self, tile: usize, change: &Modes, mut changed: impl FnMut(usize)) {
        let mut of_tiles = std::mem::take(&mut self.of_tiles);
        self.around(tile, |other| {
            if self.add(other, tile, change, &mut of_tiles[other]) {
                changed(other);
            }
        });
        self.of_tiles = of_tiles;
    }

    fn tile(&self, tile: usize) -> &Tile {
        &self.tiling.tiles[tile]
    }

    /// Cells along a quarter of a tile.
    fn quarter(&self, tile: usize) -> usize {
        self.tile(tile).footprint(self.cells).quarter
    }

    /// Calls `visit` for each other tile on units within reach of the kernel.
    fn around(&self, tile: usize, mut visit: impl FnMut(usize)) {
        let (here, of_unit) = (self.tile(tile), 2 * self.cells);
        let reach = self.kernels.reach.div_ceil(of_unit);
        let along = |begin: usize, units: usize| -> Range<usize> {
            begin.saturating_sub(reach)..(begin + here.side + reach).min(units)
        };
        let (columns, rows) = (
            along(here.col, self.tiling.columns),
            along(here.row, self.tiling.rows),
        );
        for row in rows.clone() {
            for col in columns.clone() {
                let other = self.owner[row * self.tiling.columns + col];
                if other == NO_TILE || other as usize == tile {
                    continue;
                }
                // once for each tile: at its first unit within reach
                let there = self.tile(other as usize);
                if row == there.row.max(rows.start) && col == there.col.max(columns.start) {
                    visit(other as usize);
                }
            }
        }
    }

    /// Adds the correlation of the residual of `other` to that at `tile`; returns whether the kernel reaches that far.
    fn add(&self, tile: usize, other: usize, residual: &Modes, sum: &mut [f32; MODES]) -> bool {
        let [here, there] = [tile, other].map(|tile| self.tile(tile).footprint(self.cells));
        let (a, b) = (here.quarter, there.quarter);
        let axis = |from: usize, to: usize| self.axis(a, b, to as isize - from as isize);
        let (Some(across), Some(down)) = (axis(here.col, there.col), axis(here.row, there.row))
        else {
            return false;
        };
        let (sums, _) = sum.as_chunks_mut::<3>();
        let (residuals, _) = residual.0.as_chunks::<3>();
        for (to, sum) in sums.iter_mut().enumerate() {
            for (from, residual) in residuals.iter().enumerate() {
                let weight = across[0][to % 2][from % 2] * down[0][to / 2][from / 2]
                    + across[1][to % 2][from % 2] * down[1][to / 2][from / 2];
                for (sum, value) in sum.iter_mut().zip(residual) {
                    *sum += weight * value;
                }
            }
        }
        true
    }

    /// The kernels along one axis from a tile with `b` cells in a half, whose first cell is `cells` behind that of a tile with `a`
    /// cells in a half, to that; none beyond the reach of the kernel.
    fn axis(&self, a: usize, b: usize, cells: isize) -> Option<Axis> {
        let halves = &self.halves[(a - 1) * self.kernels.quarters.len() + b - 1];
        let first = (self.kernels.reach + b - 1) as isize;
        let at = |to: usize, from: usize| -> Option<&[f32; SIGMAS.len()]> {
            let cells = cells + (from * b) as isize - (to * a) as isize;
            halves.get(usize::try_from(cells + first).ok()?)
        };
        let pairs = [at(0, 0), at(0, 1), at(1, 0), at(1, 1)];
        if pairs.iter().all(Option::is_none) {
            return None;
        }
        let pairs = pairs.map(|pair| pair.copied().unwrap_or_default());
        let mut axis = Axis::default();
        for (kernel, axis) in axis.iter_mut().enumerate() {
            let [near, right, left, far] = pairs.map(|pair| 0.5 * pair[kernel]);
            *axis = [
                [near + right + left + far, near - right + left - far],
                [near + right - left - far, near - right - left + far],
            ];
        }
        Some(axis)
    }
}

impl Kernels {
    /// Sums over the cells of two halves of tiles, of `a` and `b` cells, by the cells from the first one to the second.
    fn halves(&self, a: usize, b: usize) -> Vec<[f32; SIGMAS.len()]> {
        let sums = &self.quarters[a - 1].sums;
        let window = |end: usize| -> [f32; SIGMAS.len()] {
            let mut total = [0.0; SIGMAS.len()];
            for sums in &sums[(end + 1).saturating_sub(b)..(end + 1).min(sums.len())] {
                for (total, value) in total.iter_mut().zip(sums) {
                    *total += value;
                }
            }
            total
        };
        (0..sums.len() + b - 1).map(window).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Eye, residual};
    use super::*;
    use crate::descriptor::Descriptor;

    /// Tiles of one and two units over 8 × 6 units.
    fn tiling(sides: &[usize], units: usize) -> Tiling {
        let mut tiling = Tiling {
            tiles: Vec::new(),
            columns: 8,
            rows: 6,
            units,
            start: Vec::new(),
        };
        let mut covered = [false; 48];
        for at in 0..48 {
            let (col, row) = (at % 8, at / 8);
            let side = sides[at % sides.len()].min(8 - col).min(6 - row);
            let units: Vec<usize> = (row..row + side)
                .flat_map(|row| (col..col + side).map(move |col| row * 8 + col))
                .collect();
            let units = match units.iter().any(|&unit| covered[unit]) {
                true if covered[at] => continue,
                true => vec![at],
                false => units,
            };
            let quarters = modes(at as u32 + 100).quarters();
            tiling.tiles.push(Tile {
                descriptor: Descriptor {
                    coefficients: Vec::new(),
                    quarters,
                },
                col,
                row,
                side: units.len().isqrt(),
                feature: false,
            });
            for unit in units {
                covered[unit] = true;
            }
        }
        tiling
    }

    fn modes(seed: u32) -> Modes {
        let number = |i: u32| ((seed * 31 + i * 17) % 23) as f32 / 23.0 - 0.5;
        Modes::of(&[0, 1, 2, 3].map(|q| [0, 1, 2].map(|c| number(3 * q + c))))
    }

    #[test]
    fn pulls_are_those_of_sums_over_cells_after_any_changes() {
        for (sides, units, cells) in [(&[1][..], 1, 2), (&[2, 1, 3, 1, 2], 2, 1), (&[2, 1], 1, 1)] {
            let tiling = tiling(sides, units);
            let tiles = &tiling.tiles;
            assert!(tiling.covered().iter().all(|&count| count == 1));
            let largest = tiles.iter().map(|tile| tile.side).max().unwrap();
            let mut eye = Eye::new(
                2 * cells * 8,
                2 * cells * 6,
                cells * units,
                cells * largest,
                0.7,
            );
            let mut correlation = Correlation::new(&tiling, cells, 0.7);
            let mut photos: Vec<Modes> = (0..tiles.len() as u32).map(modes).collect();
            let wanted = |tile: usize| Modes::of(&tiles[tile].descriptor.quarters);
            for (tile, photo) in tiles.iter().zip(&photos) {
                eye.put(tile.footprint(cells), &residual(photo, &tile.descriptor));
            }
            let residuals: Vec<Modes> = (0..tiles.len())
                .map(|tile| photos[tile].less(&wanted(tile)))
                .collect();
            correlation.set(&residuals);
            for step in 0..40 {
                let tile = step * 7 % tiles.len();
                let photo = modes(500 + step as u32);
                let change = photo.less(&photos[tile]);
                let other = (tile + 1 + step % (tiles.len() - 1)) % tiles.len();
                let ahead = correlation.pull_after(other, wanted(other), tile, &change);
                correlation.change(tile, &change, |_| {});
                photos[tile] = photo;
                let place = tiles[tile].footprint(cells);
                eye.put(place, &residual(&photo, &tiles[tile].descriptor));
                for tile in 0..tiles.len() {
                    let truth = eye.lift(tiles[tile].footprint(cells), wanted(tile));
                    let place = tiles[tile].footprint(cells);
                    eye.put(place, &residual(&photos[tile], &tiles[tile].descriptor));
                    let found = correlation.pull(tile, wanted(tile));
                    let largest = truth.linear.iter().fold(1.0f32, |a, b| a.max(b.abs()));
                    for (found, truth) in found.linear.iter().zip(&truth.linear) {
                        // sums of some thousand products in single precision
                        assert!((found - truth).abs() < 1e-5 * largest, "{found} {truth}");
                    }
                    assert_eq!(found.quadratic, truth.quadratic);
                    if tile == other {
                        let mut pairs = ahead.linear.iter().zip(&found.linear);
                        assert!(pairs.all(|(a, b)| (a - b).abs() < 1e-5 * largest));
                    }
                }
            }
        }
    }
}
