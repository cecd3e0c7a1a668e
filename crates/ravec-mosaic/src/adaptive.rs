//! A picture cut into large tiles where it is homogeneous and small ones where it has detail.
//!
//! Tiles lie on a lattice of a third of the side of a tile of common size, have sides from two to eight thirds, and begin
//! anywhere on the lattice, so that no grid is seen. There are at most as many as a grid would have.
//!
//! 1. *Error*: for each side and each place, how far the photos are that could be there, and how much detail of the picture is
//!    more than any photo of that side is asked to show, times the area. Where the picture is
//!    homogeneous and photos match well, a large tile has hardly more error than the small ones in its place.
//! 2. *Placement*: with a price for each tile, the picture is filled from above, always where it is filled least. Of the tiles
//!    that fit there, at either end of the gap, the one with the least error and price for its area is placed. A tile that
//!    would leave a gap of one unit is not, so hardly any tiles are there only to fill gaps.
//! 3. *Price*: the lowest for which there are not too many tiles, by bisection.
//!
//! Source: Pavić, v. Ceumern, Kobbelt, "`GIzMOs`: Genuine Image Mosaics with Adaptive Tiling", 2009. We differ in the order:
//! placing the best tile anywhere leaves gaps all over, which took two thirds of the tiles and more error than the grid; and in
//! the price, which gives the number of tiles instead of a threshold on homogeneity.
//!
//! Guarantees: each unit is covered once; the same tiling for the same seed on any number of threads. Does not guarantee: the
//! least error; where a picture is so small that no placement has few enough tiles, the tiles are those of the grid.
//! Cost: a search among the photos for each side and place, some 50 for each tile.

use crate::choose::Photos;
use crate::look::{Frame, Look, parts};
use crate::tiling::{Tile, Tiling};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Oklab};
use rayon::prelude::*;

/// Units along a side of a tile of common size.
pub const ADAPTIVE_UNITS: usize = 3;

/// Sides of tiles in units, the smallest first. Larger ones show more of a photo than of the picture.
const SIDES: [usize; 6] = [2, 3, 4, 5, 6, 8];

/// Which of the nearest photos says how well a place is matched. The very nearest are wanted by the neighbors as well.
const NEAREST: usize = 6;

/// The power of the side by which the error of an area counts more in larger tiles: it is coarser there, and stays when that of
/// small ones is blurred away by the distance. On three photos, 0 lost 2.7 dB against a grid after a blur by half a tile, 1 lost
/// 0.6 dB, 2 and 3 lost 0.3 dB; more gains nothing and leaves hardly any large tiles.
const COARSE: i32 = 3;

/// How much the seed changes the choice between tiles that are about equally good.
const JITTER: f32 = 0.1;

/// Steps of the bisection; the number of tiles hardly changes any more after these.
const STEPS: usize = 24;

/// The errors of all tiles that could be.
struct Errors {
    columns: usize,
    rows: usize,
    seed: u64,
    /// For each of [`SIDES`] by the upper left units, row by row.
    of_sides: Vec<Vec<f32>>,
}

/// Cuts a frame of the picture into at most `columns` × `rows` tiles of several sizes, with polynomials up to `degree`.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn adaptive_tiles(
    picture: &Image<Oklab>,
    frame: Frame,
    [columns, rows]: [usize; 2],
    degree: usize,
    photos: &Photos,
    seed: u64,
    progress: &Progress,
) -> Result<Tiling, Cancelled> {
    let empty = Tiling {
        tiles: Vec::new(),
        columns: ADAPTIVE_UNITS * columns,
        rows: ADAPTIVE_UNITS * rows,
        units: ADAPTIVE_UNITS,
    };
    let tile = |side: usize, col: usize, row: usize| {
        let mut tile = Tile {
            look: Look::default(),
            col,
            row,
            side,
            feature: false,
        };
        tile.look = Look::of(picture, empty.part(frame, &tile), degree);
        tile
    };
    let squares = picture.map(|Oklab(color)| Oklab(color.map(|value| value * value)));
    let phase = progress.phase("tiles", (SIDES.len() * empty.rows) as u64);
    let error = |side: usize, row: usize, col: usize| {
        if row + side > empty.rows || col + side > empty.columns {
            return f32::INFINITY;
        }
        let share = side as f32 / ADAPTIVE_UNITS as f32;
        let tile = tile(side, col, row);
        let rest = rest(&tile.look, &squares, empty.part(frame, &tile));
        share.powi(2 + COARSE) * (photos.match_sq(&tile, NEAREST) + rest)
    };
    let errors = SIDES
        .iter()
        .map(|&side| {
            let lines: Vec<Vec<f32>> = (0..empty.rows)
                .into_par_iter()
                .map(|row| {
                    progress.check()?;
                    phase.advance(1);
                    Ok((0..empty.columns)
                        .map(|col| error(side, row, col))
                        .collect())
                })
                .collect::<Result<_, Cancelled>>()?;
            Ok(lines.concat())
        })
        .collect::<Result<_, Cancelled>>()?;
    let errors = Errors {
        columns: empty.columns,
        rows: empty.rows,
        seed,
        of_sides: errors,
    };
    let chosen = errors.cheapest_cover(columns * rows).unwrap_or_else(|| {
        let at = |at: usize| {
            let (col, row) = (at % columns, at / columns);
            (ADAPTIVE_UNITS, ADAPTIVE_UNITS * col, ADAPTIVE_UNITS * row)
        };
        (0..columns * rows).map(at).collect()
    });
    let tiles = chosen
        .into_par_iter()
        .map(|(side, col, row)| {
            progress.check()?;
            Ok(tile(side, col, row))
        })
        .collect::<Result<_, Cancelled>>()?;
    Ok(Tiling { tiles, ..empty })
}

impl Errors {
    /// A cover by at most `most` tiles, row by row, with the lowest price for which there is one: side, column and row of each.
    fn cheapest_cover(&self, most: usize) -> Option<Vec<(usize, usize, usize)>> {
        let finite = self.of_sides.iter().flatten().copied();
        let largest = finite
            .filter(|error| error.is_finite())
            .fold(1e-6, f32::max);
        // prices beyond these let the area alone or the error alone decide
        let (mut low, mut high) = (1e-6 * largest, 1e3 * largest);
        let mut best = None;
        for _ in 0..STEPS {
            let price = (low * high).sqrt();
            let mut cover = self.cover(price);
            if cover.len() <= most {
                high = price;
                cover.sort_unstable_by_key(|&(_, col, row)| (row, col));
                best = Some(cover);
            } else {
                low = price;
            }
        }
        best
    }

    /// The cover with a price for each tile.
    fn cover(&self, price: f32) -> Vec<(usize, usize, usize)> {
        // rows that are filled, for each column
        let mut filled = vec![0; self.columns];
        let mut tiles = Vec::new();
        // the leftmost of the columns that are filled least
        while let Some((first, row)) = (0..self.columns)
            .map(|col| (col, filled[col]))
            .min_by_key(|&(col, row)| (row, col))
            .filter(|&(_, row)| row < self.rows)
        {
            let gap = filled[first..].iter().take_while(|&&r| r == row).count();
            let (side, col) = self.best(first, gap, row, price);
            filled[col..col + side].fill(row + side);
            tiles.push((side, col, row));
        }
        tiles
    }

    /// The side and the column of the best tile in a gap.
    fn best(&self, first: usize, gap: usize, row: usize, price: f32) -> (usize, usize) {
        let below = self.rows - row;
        let room = gap.min(below);
        let leaves_none = |side: usize| gap - side != 1 && below - side != 1;
        let mut best = None;
        for (&side, errors) in SIDES.iter().zip(&self.of_sides) {
            if side > room || !leaves_none(side) {
                continue;
            }
            for col in [first, first + gap - side] {
                let jitter = 1.0 + JITTER * jitter(self.seed, [side, col, row]);
                let error = errors[row * self.columns + col];
                let density = (error + price) / (side * side) as f32 * jitter;
                if best.is_none_or(|(least, _, _)| density < least) {
                    best = Some((density, side, col));
                }
            }
        }
        // in a corner of 2 x 3 units, say, a gap cannot be helped
        best.map_or((room.min(2), first), |(_, side, col)| (side, col))
    }
}

/// The mean square of what polynomials leave of a part of the picture: detail that no photo of this size is asked to show.
fn rest(look: &Look, squares: &Image<Oklab>, part: Frame) -> f32 {
    let all: f32 = parts(squares, part, 1).iter().flatten().sum();
    let seen: f32 = look
        .coefficients
        .iter()
        .flatten()
        .map(|value| value * value)
        .sum();
    (all - seen).max(0.0)
}

/// A number that follows from the seed and three others, −1/2 to 1/2.
fn jitter(seed: u64, numbers: [usize; 3]) -> f32 {
    let mut state = seed ^ 0x9e37_79b9_7f4a_7c15;
    for number in numbers {
        state = (state ^ number as u64).wrapping_mul(0xff51_afd7_ed55_8ccd);
        state ^= state >> 32;
    }
    (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose::ChooseParams;
    use proptest::prelude::*;
    use ravec_raster::Size;

    fn photos(count: usize) -> Photos {
        let looks: Vec<Look> = (0..count)
            .map(|number| {
                let grey = number as f32 / count as f32;
                let photo = Image::new(Size::new(4, 4).unwrap(), Oklab([grey, 0.0, 0.0]));
                Look::of(&photo, Frame::of(&photo), 3)
            })
            .collect();
        Photos::new(
            &looks,
            (0..count as u32).collect(),
            &ChooseParams::default(),
        )
    }

    fn tiling(picture: &Image<Oklab>, sides: [usize; 2], seed: u64) -> Tiling {
        let frame = Frame::of(picture);
        adaptive_tiles(
            picture,
            frame,
            sides,
            3,
            &photos(200),
            seed,
            &Progress::none(),
        )
        .unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn each_unit_is_covered_once_by_no_more_tiles_than_a_grid_has(
            columns in 1usize..9, rows in 1usize..9, waves in 0.0f32..3.0, seed: u64,
        ) {
            let size = Size::new(8 * columns, 8 * rows).unwrap();
            let picture = Image::from_fn(size, |col, row| {
                Oklab([0.5 + 0.3 * (waves * (col * row) as f32 / 20.0).sin(), 0.0, 0.0])
            });
            let tiling = tiling(&picture, [columns, rows], seed);
            prop_assert!(tiling.tiles.len() <= columns * rows);
            prop_assert!(tiling.covered().iter().all(|&times| times == 1));
            prop_assert_eq!(tiling.covered().len(), 9 * columns * rows);
        }
    }

    #[test]
    fn detail_gets_small_tiles_and_flat_ground_large_ones_off_the_grid() {
        // the left half is flat, the right half has stripes of 12 pixels
        let picture = Image::from_fn(Size::new(384, 192).unwrap(), |col, _| {
            let stripe = col >= 192 && col / 12 % 2 == 0;
            Oklab([if stripe { 0.9 } else { 0.3 }, 0.0, 0.0])
        });
        let found = tiling(&picture, [24, 12], 1);
        let of_half = |right: bool| {
            found
                .tiles
                .iter()
                .filter(move |tile| (tile.col >= 36) == right)
        };
        assert!(3 * of_half(false).count() < 2 * of_half(true).count());
        let odd = found.tiles.iter().filter(|tile| tile.col % 3 != 0);
        assert!(odd.count() > 5, "tiles lie off the grid");
        assert_ne!(found, tiling(&picture, [24, 12], 2), "the seed matters");
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .unwrap();
        assert_eq!(found, pool.install(|| tiling(&picture, [24, 12], 1)));
    }
}
