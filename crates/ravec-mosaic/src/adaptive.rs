//! A picture cut into tiles of several sizes off the grid: large ones where photos match well, small ones where it has detail.
//!
//! Tiles lie on a lattice of a third of the side of a tile of common size, have sides from two to six thirds, and begin
//! anywhere on the lattice, so that no grid is seen. There are at most as many as a grid would have.
//!
//! 1. *Start*: the picture is filled from above with tiles of about the common size, always where it is filled least, at
//!    either end of the gap there. A tile that would leave a gap of one unit is not placed, so hardly any tiles are there only
//!    to fill gaps. The price of a tile, found by bisection, makes their number that of the grid.
//! 2. *Search* (see the module `retile`): tiles give way to others as long as the energy of tiles and photos falls. Where the
//!    picture is homogeneous and photos match well, a large tile has hardly more of it than the small ones in its place.
//!
//! Source: Pavić, v. Ceumern, Kobbelt, "`GIzMOs`: Genuine Image Mosaics with Adaptive Tiling", 2009. We differ in the
//! order: placing the best tile anywhere leaves gaps all over, which took two thirds of the tiles and more error than
//! the grid; and in the measure: the homogeneity of the picture and the distance of the nearest photo predict too
//! little of the cost of a tile among others that compete for the same photos.
//!
//! Guarantees: each unit is covered once; the same tiling for the same seed on any number of threads. Does not guarantee: the
//! least error; where a picture is so small that no placement has few enough tiles, the tiles are those of the grid.

use crate::choose::{ChooseParams, Photos};
use crate::descriptor::Frame;
use crate::retile::{Place, Source, Tiled, retile};
use crate::rules::Rules;
use crate::tiling::Tiling;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Oklab};

/// Units along a side of a tile of common size.
pub const ADAPTIVE_UNITS: usize = 3;

/// Sides of the first tiles in units.
const SIDES: [usize; 3] = [2, 3, 4];

/// Weight of the seed in the choice between the first tiles.
const JITTER: f32 = 0.6;

/// Steps of the bisection; the number of tiles hardly changes any more after these.
const STEPS: usize = 24;

/// Cuts a frame of the picture into at most `columns` × `rows` tiles of several sizes, with polynomials up to `degree`. Of the
/// rules the distance of repeats matters.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
#[expect(
    clippy::too_many_arguments,
    reason = "tiles and photos are chosen together"
)]
pub fn adaptive_tiles(
    picture: &Image<Oklab>,
    frame: Frame,
    [columns, rows]: [usize; 2],
    degree: usize,
    photos: &Photos,
    rules: &Rules,
    params: &ChooseParams,
    seed: u64,
    progress: &Progress,
) -> Result<Tiling, Cancelled> {
    let empty = Tiling {
        tiles: Vec::new(),
        columns: ADAPTIVE_UNITS * columns,
        rows: ADAPTIVE_UNITS * rows,
        units: ADAPTIVE_UNITS,
        start: Vec::new(),
    };
    let start = Start {
        columns: empty.columns,
        rows: empty.rows,
        seed,
    };
    let most = columns * rows;
    let places = start.cheapest_cover(most).unwrap_or_else(|| {
        let at = |at: usize| {
            let (col, row) = (at % columns, at / columns);
            (ADAPTIVE_UNITS, ADAPTIVE_UNITS * col, ADAPTIVE_UNITS * row)
        };
        (0..most).map(at).collect()
    });
    let source = Source {
        picture,
        frame,
        degree,
        photos,
    };
    let Tiled { tiles, photos } = retile(
        source,
        &empty,
        &places,
        most,
        rules.min_repeat_distance,
        params,
        seed,
        progress,
    )?;
    Ok(Tiling {
        tiles,
        start: photos,
        ..empty
    })
}

/// Covers by tiles of about the common size.
struct Start {
    columns: usize,
    rows: usize,
    seed: u64,
}

impl Start {
    /// A cover by at most `most` tiles with the lowest price for which there is one.
    fn cheapest_cover(&self, most: usize) -> Option<Vec<Place>> {
        // prices beyond these let the area alone or the size alone decide
        let (mut low, mut high) = (1e-3f32, 1e3f32);
        let mut best = None;
        for _ in 0..STEPS {
            let price = (low * high).sqrt();
            let cover = self.cover(price);
            if cover.len() <= most {
                high = price;
                best = Some(cover);
            } else {
                low = price;
            }
        }
        best
    }

    /// The cover with a price for each tile.
    fn cover(&self, price: f32) -> Vec<Place> {
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
        if row == 0 || first == 0 {
            // tiles of any size along two borders take all others off the grid
            let drawn = (jitter(self.seed, [0, first, row]) + 0.5) * SIDES.len() as f32;
            let side = SIDES[(drawn as usize).min(SIDES.len() - 1)];
            if side <= room && leaves_none(side) {
                return (side, first);
            }
        }
        let mut best = None;
        for side in SIDES {
            if side > room || !leaves_none(side) {
                continue;
            }
            // the energy of a tile that is like all others, see `tile_cost`
            let cost = (side as f32 / ADAPTIVE_UNITS as f32).powi(5);
            for col in [first, first + gap - side] {
                let jitter = 1.0 + JITTER * jitter(self.seed, [side, col, row]);
                let density = (cost + price) / (side * side) as f32 * jitter;
                if best.is_none_or(|(least, _, _)| density < least) {
                    best = Some((density, side, col));
                }
            }
        }
        // in a corner of 2 x 3 units, say, a gap cannot be helped
        best.map_or((room.min(2), first), |(_, side, col)| (side, col))
    }
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
    use crate::descriptor::Descriptor;
    use proptest::prelude::*;
    use ravec_raster::Size;

    fn photos(count: usize) -> Photos {
        let descriptors: Vec<Descriptor> = (0..count)
            .map(|number| {
                let gray = number as f32 / count as f32;
                let photo = Image::new(Size::new(4, 4).unwrap(), Oklab([gray, 0.0, 0.0]));
                Descriptor::of(&photo, Frame::of(&photo), 3)
            })
            .collect();
        Photos::new(
            &descriptors,
            (0..count as u32).collect(),
            &ChooseParams::default(),
        )
    }

    fn tiling(picture: &Image<Oklab>, sides: [usize; 2], seed: u64) -> Tiling {
        let (rules, params) = (Rules::default(), ChooseParams::default());
        let (frame, photos) = (Frame::of(picture), photos(200));
        let none = Progress::none();
        adaptive_tiles(
            picture, frame, sides, 3, &photos, &rules, &params, seed, &none,
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
