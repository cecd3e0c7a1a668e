use super::*;
use crate::descriptor::{Descriptor, Weights};
use crate::rules::violations;
use crate::tiling::Tile;
use proptest::prelude::*;
use ravec_progress::Cancelled;

pub(crate) fn descriptors(count: usize, seed: u64) -> Vec<Descriptor> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut number = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    (0..count)
        .map(|_| {
            let mean = [number(), 0.3 * number(), 0.3 * number()];
            let slope = [0.3 * number(), 0.1 * number(), 0.1 * number()];
            Descriptor {
                coefficients: vec![mean, slope, [0.0; 3]],
                quarters: [mean; 4],
            }
        })
        .collect()
}

pub(crate) fn grid(columns: usize, rows: usize, seed: u64) -> Tiling {
    let tiles = descriptors(columns * rows, seed)
        .into_iter()
        .enumerate()
        .map(|(at, descriptor)| Tile {
            descriptor,
            col: at % columns,
            row: at / columns,
            side: 1,
            feature: at % 3 == 0,
        })
        .collect();
    Tiling {
        tiles,
        columns,
        rows,
        units: 1,
        start: Vec::new(),
    }
}

pub(crate) fn params(blend: f64) -> ChooseParams {
    ChooseParams {
        weights: Weights {
            degree: 1,
            detail: 0.5,
        },
        features: (blend > 0.5).then_some(Features {
            degree: 0,
            weight: 3.0,
        }),
        blend,
        ..ChooseParams::default()
    }
}

/// The least cost of all choices that keep the rules.
fn brute_force(tiling: &Tiling, photos: &Photos, rules: &Rules) -> Option<f64> {
    let (tiles, centers) = (&tiling.tiles, tiling.centers());
    let count = photos.groups.len();
    let mut best: Option<f64> = None;
    for code in 0..count.pow(tiles.len() as u32) {
        let chosen: Vec<u32> = (0..tiles.len())
            .map(|tile| (code / count.pow(tile as u32) % count) as u32)
            .collect();
        if !violations(rules, &centers, &chosen, &photos.groups).is_empty() {
            continue;
        }
        let cost = chosen.iter().zip(tiles).map(|(&photo, tile)| {
            let query = photos.class(tile).vector(&tile.descriptor);
            f64::from(photos.class(tile).index.distance_sq(&query, photo))
        });
        let cost: f64 = cost.sum();
        best = Some(best.map_or(cost, |best| best.min(cost)));
    }
    best
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn no_choice_is_better_than_brute_force_and_limits_on_numbers_are_met_optimally(
        columns in 1usize..4, rows in 1usize..3, count in 1usize..5, seed in 0u64..100_000,
        max_uses in proptest::option::of(1u32..4), use_all: bool, spread: bool, twins: bool,
    ) {
        let tiles = grid(columns, rows, seed);
        let mut groups: Vec<u32> = (0..count as u32).collect();
        if twins && count > 1 {
            groups[count - 1] = 0;
        }
        let photos = Photos::new(&descriptors(count, seed + 1), groups, &params(0.0));
        let rules = Rules { max_uses, min_repeat_distance: if spread { 1.3 + 0.2 * columns as f64 } else { 0.0 }, use_all };
        let best = brute_force(&tiles, &photos, &rules);
        if let Ok(choice) = choose(&tiles, &photos, &rules, &params(0.0), &Progress::none()) {
            let centers = tiles.centers();
            prop_assert_eq!(violations(&rules, &centers, &choice.photos, &photos.groups), Vec::<String>::new());
            let best = best.unwrap();
            // sums of the same few numbers in another order
            prop_assert!(choice.cost >= best - 1e-9 && choice.bound <= best + 1e-9);
            if !spread {
                prop_assert!((choice.cost - best).abs() < 1e-9, "{} {best}", choice.cost);
            }
        } else {
            prop_assert_eq!(best, None);
        }
    }

    #[test]
    fn the_rules_hold_on_every_mosaic(
        columns in 6usize..14, rows in 5usize..12, seed in 0u64..100_000,
        distance in 0.0f64..4.0, max_uses in proptest::option::of(3u32..9), use_all: bool, blend in 0.0f64..1.0,
    ) {
        let tiles = grid(columns, rows, seed);
        // every third photo has a twin
        let groups: Vec<u32> = (0..60).map(|photo| photo * 3 / 4).collect();
        let mut order: Vec<u32> = groups.clone();
        order.dedup();
        let groups: Vec<u32> = groups
            .iter()
            .map(|group| order.iter().position(|other| other == group).unwrap() as u32)
            .collect();
        let photos = Photos::new(&descriptors(60, seed + 1), groups, &params(blend));
        let rules = Rules { max_uses, min_repeat_distance: distance, use_all };
        let centers = tiles.centers();
        match choose(&tiles, &photos, &rules, &params(blend), &Progress::none()) {
            Ok(choice) => {
                prop_assert_eq!(choice.photos.len(), tiles.tiles.len());
                prop_assert_eq!(violations(&rules, &centers, &choice.photos, &photos.groups), Vec::<String>::new());
                prop_assert!(choice.cost >= choice.bound - 1e-6);
            }
            Err(ChooseError::TooNear { .. }) => prop_assert!(max_uses.is_some()),
            Err(ChooseError::TooMany { .. }) => prop_assert!(use_all),
            Err(error) => prop_assert!(max_uses.is_some(), "{}", error),
        }
    }
}

#[test]
fn a_planted_photo_gets_its_tile() {
    let tiles = grid(4, 3, 5);
    let mut library = descriptors(300, 6);
    library[211] = tiles.tiles[7].descriptor.clone();
    let photos = Photos::new(&library, (0..300).collect(), &params(0.0));
    let choice = choose(
        &tiles,
        &photos,
        &Rules::default(),
        &params(0.0),
        &Progress::none(),
    )
    .unwrap();
    assert_eq!(choice.photos[7], 211);
}

#[test]
fn what_cannot_be_is_said() {
    let tiles = grid(3, 3, 1);
    let photos = |count: usize| {
        Photos::new(
            &descriptors(count, 2),
            (0..count as u32).collect(),
            &params(0.0),
        )
    };
    let run = |photos: &Photos, rules: Rules| {
        choose(&tiles, photos, &rules, &params(0.0), &Progress::none())
            .unwrap_err()
            .to_string()
    };
    let rules = Rules::default();
    assert_eq!(run(&photos(0), rules), "there is no photo to choose from");
    assert!(run(&photos(1), rules).starts_with("too few photos (1 that differ) to keep repeats 5"));
    let once = Rules {
        max_uses: Some(1),
        ..rules
    };
    assert!(run(&photos(8), once).starts_with("9 tiles need more than 8 different photos"));
    let all = Rules {
        use_all: true,
        ..rules
    };
    assert!(run(&photos(10), all).starts_with("10 different photos cannot all be used in 9"));
    let progress = Progress::none();
    progress.cancel();
    let cancelled = choose(&tiles, &photos(5), &rules, &params(0.0), &progress);
    assert_eq!(cancelled, Err(ChooseError::Cancelled(Cancelled)));
}
