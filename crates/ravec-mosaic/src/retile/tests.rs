//! The search on small pictures.

use super::*;
use crate::descriptor::Descriptor;
use proptest::prelude::*;
use ravec_raster::Size;

const COLUMNS: usize = 5;
const ROWS: usize = 4;
const UNITS: usize = 3;

fn empty() -> Tiling {
    Tiling {
        tiles: Vec::new(),
        columns: UNITS * COLUMNS,
        rows: UNITS * ROWS,
        units: UNITS,
        start: Vec::new(),
    }
}

/// The energy of tiles with photos: that of each beside those that are left when those before it are taken out.
fn energy(source: Source<'_>, empty: &Tiling, tiled: Vec<(Tile, u32)>) -> f32 {
    let mut mosaic = Mosaic::new(source, empty, 2.0, &ChooseParams::default());
    for (tile, photo) in tiled {
        mosaic.insert(tile, photo);
    }
    (0..mosaic.next).map(|number| mosaic.take(number).2).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_energy_falls_and_no_tiles_are_added(waves in 1.0f32..9.0, seed: u64) {
        let descriptors: Vec<Descriptor> = (0..60)
            .map(|number| {
                let photo = Image::from_fn(Size::new(8, 8).unwrap(), |col, row| {
                    let slope = (number % 5) as f32 * 0.02 * (col as f32 - row as f32);
                    Oklab([number as f32 / 60.0 + slope, 0.01 * (number % 7) as f32, 0.0])
                });
                Descriptor::of(&photo, Frame::of(&photo), 3)
            })
            .collect();
        let params = ChooseParams::default();
        let photos = Photos::new(&descriptors, (0..60).collect(), &params);
        let picture = Image::from_fn(Size::new(16 * COLUMNS, 16 * ROWS).unwrap(), |col, row| {
            Oklab([0.5 + 0.4 * (waves * (col * row) as f32 / 900.0).sin(), 0.03, 0.0])
        });
        let empty = empty();
        let source = Source { picture: &picture, frame: Frame::of(&picture), degree: 3, photos: &photos };
        let places: Vec<Place> = (0..COLUMNS * ROWS)
            .map(|at| (UNITS, UNITS * (at % COLUMNS), UNITS * (at / COLUMNS)))
            .collect();
        let mut grid = Mosaic::new(source, &empty, 2.0, &params);
        for &place in &places {
            grid.put(place);
        }
        let before = energy(source, &empty, grid.tiles.into_values().collect());
        let most = places.len();
        let Tiled { tiles, photos } =
            retile(source, &empty, &places, most, 2.0, &params, seed, &Progress::none()).unwrap();
        let count = tiles.len();
        prop_assert!(count <= most);
        let tiling = Tiling { tiles: tiles.clone(), ..empty.clone() };
        prop_assert!(tiling.covered().iter().all(|&times| times == 1));
        let after = energy(source, &empty, tiles.into_iter().zip(photos).collect());
        // fewer tiles may have more energy, by no more than their price, which is not known here
        prop_assert!(count < most || after <= before * (1.0 + 1e-3), "{after} after {before}");
    }
}

#[test]
fn plans_cover_what_is_free_in_a_window() {
    let photos = Photos::new(&[], Vec::new(), &ChooseParams::default());
    let picture = Image::new(Size::new(15, 12).unwrap(), Oklab([0.5, 0.0, 0.0]));
    let source = Source {
        picture: &picture,
        frame: Frame::of(&picture),
        degree: 0,
        photos: &photos,
    };
    let empty = empty();
    let mut mosaic = Mosaic::new(source, &empty, 2.0, &ChooseParams::default());
    // a tile that stays, in the corner of the window
    for row in 2..5 {
        mosaic.owner[row * 15 + 1..row * 15 + 4].fill(0);
    }
    let window = Window {
        left: 1,
        top: 2,
        right: 10,
        bottom: 11,
    };
    let mut random = Random(7);
    let mut plans = 0;
    for _ in 0..200 {
        let Some(plan) = mosaic.plan(window, &mut random) else {
            continue;
        };
        plans += 1;
        let mut times = vec![0; 15 * 12];
        for (side, col, row) in plan {
            assert!((2..=MAX_SIDE).contains(&side));
            for row in row..row + side {
                for times in &mut times[row * 15 + col..][..side] {
                    *times += 1;
                }
            }
        }
        for (at, times) in times.into_iter().enumerate() {
            let (col, row) = (at % 15, at / 15);
            let free = (1..10).contains(&col) && (2..11).contains(&row) && mosaic.owner[at] == FREE;
            assert_eq!(times, i32::from(free));
        }
    }
    assert!(plans > 20, "{plans} of 200");
}
