//! A picture cut into tiles.
//!
//! Tiles are squares of whole units, where a square has the proportions of a photo: a tile of common size has one unit on a
//! grid, and more in an adaptive tiling (see the module `adaptive`).

use crate::descriptor::{Descriptor, Frame};
use crate::eye::Footprint;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Oklab};
use rayon::prelude::*;

/// A tile that wants a photo.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile {
    /// Descriptor of the picture there.
    pub descriptor: Descriptor,
    /// The first unit across.
    pub col: usize,
    /// The first unit down.
    pub row: usize,
    /// Units along a side, at least 1.
    pub side: usize,
    /// `true` if an edge runs through it (see [`mark_features`](crate::mark_features)).
    pub feature: bool,
}

impl Tile {
    /// The tile with side, column and row `place` in units of `tiling`.
    pub(crate) fn of(
        picture: &Image<Oklab>,
        tiling: &Tiling,
        frame: Frame,
        (side, col, row): (usize, usize, usize),
        degree: usize,
    ) -> Self {
        let mut tile = Self {
            descriptor: Descriptor::default(),
            col,
            row,
            side,
            feature: false,
        };
        tile.descriptor = Descriptor::of(picture, tiling.part(frame, &tile), degree);
        tile
    }

    /// The cells of the tile, of which `cells` are half a unit.
    pub(crate) fn footprint(&self, cells: usize) -> Footprint {
        Footprint {
            col: 2 * cells * self.col,
            row: 2 * cells * self.row,
            quarter: cells * self.side,
        }
    }
}

/// A picture cut into tiles.
#[derive(Debug, Clone, PartialEq)]
pub struct Tiling {
    /// The tiles, which cover each unit once.
    pub tiles: Vec<Tile>,
    /// Units across.
    pub columns: usize,
    /// Units down.
    pub rows: usize,
    /// Units along a side of a tile of common size.
    pub units: usize,
    /// Photos that a choice may start from, one for each tile, or none at all. They belong to the photos that the tiling was made
    /// for.
    pub start: Vec<u32>,
}

impl Tiling {
    /// The centers of the tiles, in sides of a tile of common size.
    pub fn centers(&self) -> Vec<[f64; 2]> {
        self.tiles.iter().map(|tile| self.center(tile)).collect()
    }

    /// The center of a tile, in sides of a tile of common size.
    pub(crate) fn center(&self, tile: &Tile) -> [f64; 2] {
        let center = |begin: usize| (begin as f64 + tile.side as f64 / 2.0) / self.units as f64;
        [center(tile.col), center(tile.row)]
    }

    /// The part of a frame of the picture that a tile is.
    pub(crate) fn part(&self, frame: Frame, tile: &Tile) -> Frame {
        let unit = (
            frame.width / self.columns as f64,
            frame.height / self.rows as f64,
        );
        Frame {
            left: frame.left + unit.0 * tile.col as f64,
            top: frame.top + unit.1 * tile.row as f64,
            width: unit.0 * tile.side as f64,
            height: unit.1 * tile.side as f64,
        }
    }

    /// Adds the tile of `side` units that begins at this column and row of units, as it looks in a frame of the picture, with
    /// polynomials up to `degree`.
    pub fn describe(
        &mut self,
        picture: &Image<Oklab>,
        frame: Frame,
        [col, row]: [usize; 2],
        side: usize,
        degree: usize,
    ) {
        let tile = Tile::of(picture, self, frame, (side, col, row), degree);
        self.tiles.push(tile);
    }

    /// The tiles on each unit, row by row of units; a tiling that covers the picture exactly has one everywhere.
    pub fn covered(&self) -> Vec<u32> {
        let mut covered = vec![0; self.columns * self.rows];
        for tile in &self.tiles {
            for row in tile.row..tile.row + tile.side {
                for count in &mut covered[row * self.columns + tile.col..][..tile.side] {
                    *count += 1;
                }
            }
        }
        covered
    }
}

/// The tiles of a frame of the picture, row by row, with polynomials up to `degree`.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn grid_tiles(
    picture: &Image<Oklab>,
    frame: Frame,
    columns: usize,
    rows: usize,
    degree: usize,
    progress: &Progress,
) -> Result<Tiling, Cancelled> {
    let phase = progress.phase("describe", (columns * rows) as u64);
    let side = (frame.width / columns as f64, frame.height / rows as f64);
    let tiles = (0..columns * rows)
        .into_par_iter()
        .map(|at| {
            progress.check()?;
            let (col, row) = (at % columns, at / columns);
            let part = Frame {
                left: frame.left + side.0 * col as f64,
                top: frame.top + side.1 * row as f64,
                width: side.0,
                height: side.1,
            };
            phase.advance(1);
            Ok(Tile {
                descriptor: Descriptor::of(picture, part, degree),
                col,
                row,
                side: 1,
                feature: false,
            })
        })
        .collect::<Result<_, Cancelled>>()?;
    Ok(Tiling {
        tiles,
        columns,
        rows,
        units: 1,
        start: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    #[test]
    fn tiles_come_row_by_row_and_the_mean_of_their_colors_is_that_of_the_picture() {
        let picture = Image::from_fn(Size::new(31, 17).unwrap(), |col, row| {
            Oklab([(col * 3 + row * 5) as f32 / 170.0, col as f32 / 31.0, 0.0])
        });
        let tiling = grid_tiles(&picture, Frame::of(&picture), 4, 3, 2, &Progress::none()).unwrap();
        let tiles = &tiling.tiles;
        assert_eq!((tiles[5].col, tiles[5].row, tiles.len()), (1, 1, 12));
        assert_eq!(tiling.centers()[5], [1.5, 1.5]);
        assert_eq!(tiling.covered(), [1; 12]);
        for channel in 0..2 {
            let mean: f32 = tiles
                .iter()
                .map(|tile| tile.descriptor.coefficients[0][channel])
                .sum();
            let truth: f32 = picture.pixels().iter().map(|pixel| pixel.0[channel]).sum();
            assert!((mean / 12.0 - truth / (31.0 * 17.0)).abs() < 1e-5);
        }
    }
}
