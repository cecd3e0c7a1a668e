//! Pins and bans against a naive search of all choices.

use super::*;
use crate::choose::tests::{descriptors, grid, params};
use crate::choose::{ChooseParams, choose, choose_by_hand};
use crate::rules::Rules;
use crate::tiling::Tiling;
use proptest::prelude::*;
use ravec_progress::Progress;

fn run(
    tiling: &Tiling,
    photos: &Photos,
    rules: &Rules,
    by_hand: &ByHand,
    params: &ChooseParams,
) -> Result<Vec<u32>, ChooseError> {
    let progress = Progress::none();
    let choice = choose_by_hand(tiling, photos, rules, by_hand, params, &progress)?;
    assert!(choice.cost >= choice.bound - 1e-6);
    Ok(choice.photos)
}

/// The plain definition: what is wrong with a choice, in words.
fn wrong(
    tiling: &Tiling,
    groups: &[u32],
    rules: &Rules,
    by_hand: &ByHand,
    banned: &[u32],
    chosen: &[u32],
) -> Option<String> {
    let group = |photo: u32| groups[photo as usize];
    let pin = |tile: usize| by_hand.pins.iter().find(|pin| pin.tile == tile);
    let centers = tiling.centers();
    let mut used: Vec<u32> = Vec::new();
    for (tile, &photo) in chosen.iter().enumerate() {
        used.push(group(photo));
        if let Some(pin) = pin(tile) {
            if pin.photo != photo {
                return Some(format!("tile {tile} is pinned to {}", pin.photo));
            }
            continue;
        }
        let here = by_hand.bans.iter().filter(|ban| ban.tile == tile);
        let mut bans = here.map(|ban| ban.photo).chain(banned.iter().copied());
        if bans.any(|ban| group(ban) == group(photo)) {
            return Some(format!("{photo} is banned at {tile}"));
        }
        let twins: Vec<usize> = (0..chosen.len())
            .filter(|&other| group(chosen[other]) == group(photo))
            .collect();
        if rules
            .max_uses
            .is_some_and(|most| twins.len() > most as usize)
        {
            return Some(format!("{photo} is used too often"));
        }
        let near = |other: usize| {
            let [dx, dy] = [0, 1].map(|i| centers[other][i] - centers[tile][i]);
            dx.hypot(dy) < rules.min_repeat_distance * (1.0 - 1e-9)
        };
        if twins.iter().any(|&other| other != tile && near(other)) {
            return Some(format!("{photo} repeats near {tile}"));
        }
    }
    let all = (0..groups.len() as u32).filter(|&photo| {
        let banned = banned.iter().any(|&ban| group(ban) == group(photo));
        !banned && !used.contains(&group(photo))
    });
    (rules.use_all && all.count() > 0).then(|| "not all are used".to_owned())
}

fn at(pairs: &[(usize, u32)], tiles: usize, photos: usize) -> Vec<TilePhoto> {
    let within = |&(tile, photo): &(usize, u32)| TilePhoto {
        tile: tile % tiles,
        photo: photo % photos as u32,
    };
    pairs.iter().map(within).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn a_choice_around_pins_and_bans_is_found_if_there_is_one(
        columns in 1usize..4, rows in 1usize..3, count in 1usize..5, seed in 0u64..100_000,
        max_uses in proptest::option::of(1u32..4), use_all: bool, spread: bool, twins: bool,
        pins in proptest::collection::vec((0usize..6, 0u32..4), 0..3),
        bans in proptest::collection::vec((0usize..6, 0u32..4), 0..4),
        banned in proptest::option::of(0u32..4),
    ) {
        let tiles = grid(columns, rows, seed);
        let mut groups: Vec<u32> = (0..count as u32).collect();
        if twins && count > 1 {
            groups[count - 1] = 0;
        }
        let mut photos = Photos::new(&descriptors(count, seed + 1), groups.clone(), &params(0.0));
        let banned: Vec<u32> = banned.map(|photo| photo % count as u32).into_iter().collect();
        for &photo in &banned {
            photos.ban(photo);
        }
        let rules = Rules { max_uses, min_repeat_distance: if spread { 1.3 + 0.2 * columns as f64 } else { 0.0 }, use_all };
        let by_hand = ByHand { pins: at(&pins, columns * rows, count), bans: at(&bans, columns * rows, count) };
        let all = (0..count.pow((columns * rows) as u32)).map(|code| -> Vec<u32> {
            (0..columns * rows).map(|tile| (code / count.pow(tile as u32) % count) as u32).collect()
        });
        let cost = |chosen: &[u32]| -> f64 {
            let costs = chosen.iter().zip(&tiles.tiles).map(|(&photo, tile)| f64::from(photos.cost(tile, photo)));
            costs.sum()
        };
        let possible = all.filter(|chosen| wrong(&tiles, &groups, &rules, &by_hand, &banned, chosen).is_none());
        let least = possible.map(|chosen| cost(&chosen)).reduce(f64::min);
        match choose_by_hand(&tiles, &photos, &rules, &by_hand, &params(0.0), &Progress::none()) {
            Ok(choice) => {
                prop_assert_eq!(wrong(&tiles, &groups, &rules, &by_hand, &banned, &choice.photos), None);
                // sums of the same few numbers in another order
                let least = least.unwrap();
                prop_assert!((choice.cost - cost(&choice.photos)).abs() < 1e-9);
                prop_assert!(choice.cost >= least - 1e-9 && choice.bound <= least + 1e-9);
                if !spread && (max_uses.is_some() || use_all) {
                    prop_assert!((choice.cost - least).abs() < 1e-6, "{} {least}", choice.cost);
                }
            }
            Err(ChooseError::PinnedAndBanned { .. }) => {
                prop_assert!(by_hand.pins.iter().any(|pin| by_hand.bans.contains(pin)));
            }
            Err(ChooseError::PinnedTwice { tile }) => {
                let here = by_hand.pins.iter().filter(|pin| pin.tile == tile);
                prop_assert!(here.count() > 1);
            }
            Err(error) => prop_assert_eq!(least, None, "{}", error),
        }
    }

    #[test]
    fn pins_and_bans_hold_on_every_mosaic(
        columns in 6usize..14, rows in 5usize..12, seed in 0u64..100_000,
        distance in 0.0f64..4.0, max_uses in proptest::option::of(4u32..9), use_all: bool, blend in 0.0f64..1.0,
        pins in proptest::collection::btree_map(0usize..30, 0u32..60, 0..6),
        bans in proptest::collection::vec((0usize..200, 0u32..60), 0..40),
        banned in proptest::collection::vec(0u32..60, 0..5),
    ) {
        let tiles = grid(columns, rows, seed);
        // every fourth photo has a twin
        let groups: Vec<u32> = (0..60).map(|photo| photo / 4 * 3 + (photo % 4).min(2)).collect();
        let mut photos = Photos::new(&descriptors(60, seed + 1), groups.clone(), &params(blend));
        for &photo in &banned {
            photos.ban(photo);
        }
        let rules = Rules { max_uses, min_repeat_distance: distance, use_all };
        let pins: Vec<TilePhoto> = pins.into_iter().map(|(tile, photo)| TilePhoto { tile, photo }).collect();
        let mut bans = at(&bans, columns * rows, 60);
        bans.retain(|ban| !pins.contains(ban));
        let by_hand = ByHand { pins, bans };
        match run(&tiles, &photos, &rules, &by_hand, &params(blend)) {
            Ok(chosen) => prop_assert_eq!(wrong(&tiles, &groups, &rules, &by_hand, &banned, &chosen), None),
            Err(ChooseError::TooMany { .. } | ChooseError::NotAllUsed) => prop_assert!(use_all),
            Err(error) => prop_assert!(max_uses.is_some(), "{}", error),
        }
    }

    #[test]
    fn a_banned_photo_is_as_one_that_is_not_there(
        seed in 0u64..100_000, blend in 0.0f64..1.0, max_uses in proptest::option::of(3u32..9), use_all: bool,
        distance in 0.0f64..3.0, banned in proptest::collection::btree_set(0u32..40, 0..6),
    ) {
        let tiles = grid(9, 8, seed);
        let library = descriptors(40, seed + 1);
        let rules = Rules { max_uses, min_repeat_distance: distance, use_all };
        let params = ChooseParams { candidates: 12, ..params(blend) };
        let mut photos = Photos::new(&library, (0..40).collect(), &params);
        for &photo in &banned {
            photos.ban(photo);
        }
        let kept: Vec<u32> = (0..40).filter(|photo| !banned.contains(photo)).collect();
        let descriptors: Vec<_> = kept.iter().map(|&photo| library[photo as usize].clone()).collect();
        let without = Photos::new(&descriptors, (0..kept.len() as u32).collect(), &params);
        let progress = Progress::none();
        let with_bans = choose(&tiles, &photos, &rules, &params, &progress);
        let expected = choose(&tiles, &without, &rules, &params, &progress);
        match (with_bans, expected) {
            (Ok(found), Ok(expected)) => {
                let expected: Vec<u32> = expected.photos.iter().map(|&photo| kept[photo as usize]).collect();
                prop_assert_eq!(found.photos, expected);
            }
            (found, expected) => prop_assert_eq!(found.is_ok(), expected.is_ok()),
        }
    }

    #[test]
    fn the_nearest_photos_of_a_tile_are_those_of_a_search_of_all(
        seed in 0u64..100_000, count in 1usize..50, banned in proptest::collection::vec(0u32..60, 0..5),
    ) {
        let groups: Vec<u32> = (0..60).map(|photo| photo / 2).collect();
        let mut photos = Photos::new(&descriptors(60, seed), groups, &params(0.0));
        for &photo in &banned {
            photos.ban(photo);
        }
        let tile = &grid(1, 1, seed + 1).tiles[0];
        let mut all: Vec<(f32, u32)> = (0..60u32)
            .filter(|photo| banned.iter().all(|ban| ban / 2 != photo / 2))
            .map(|photo| (photos.cost(tile, photo), photo))
            .collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut seen = Vec::new();
        all.retain(|(_, photo)| !seen.contains(&(photo / 2)) && { seen.push(photo / 2); true });
        all.truncate(count);
        let found: Vec<(f32, u32)> = photos.nearest(tile, count).iter().map(|near| (near.distance_sq, near.photo)).collect();
        prop_assert_eq!(found, all);
    }
}

#[test]
fn what_makes_no_sense_is_said() {
    let tiles = grid(3, 2, 1);
    let photos = Photos::new(&descriptors(4, 2), (0..4).collect(), &params(0.0));
    let rules = Rules {
        min_repeat_distance: 0.0,
        ..Rules::default()
    };
    let said = |pins: &[(usize, u32)], bans: &[(usize, u32)], photos: &Photos| {
        let list = |pairs: &[(usize, u32)]| -> Vec<TilePhoto> {
            let pairs = pairs.iter();
            pairs
                .map(|&(tile, photo)| TilePhoto { tile, photo })
                .collect()
        };
        let by_hand = ByHand {
            pins: list(pins),
            bans: list(bans),
        };
        run(&tiles, photos, &rules, &by_hand, &params(0.0)).unwrap_err()
    };
    assert_eq!(
        said(&[(6, 0)], &[], &photos),
        ChooseError::NoSuchTile { tile: 6, tiles: 6 }
    );
    assert_eq!(
        said(&[], &[(0, 4)], &photos),
        ChooseError::NoSuchPhoto {
            photo: 4,
            photos: 4
        }
    );
    assert_eq!(
        said(&[(1, 0), (1, 2)], &[], &photos),
        ChooseError::PinnedTwice { tile: 1 }
    );
    assert_eq!(
        said(&[(1, 0)], &[(1, 0)], &photos),
        ChooseError::PinnedAndBanned { tile: 1 }
    );
    let everything = [(2, 0), (2, 1), (2, 2), (2, 3)];
    assert_eq!(
        said(&[], &everything, &photos),
        ChooseError::NothingLeft { tile: 2 }
    );
    let mut none = photos.clone();
    for photo in 0..4 {
        none.ban(photo);
    }
    assert_eq!(
        said(&[(0, 1)], &[], &none),
        ChooseError::NothingLeft { tile: 1 }
    );
}

#[test]
fn photos_that_must_all_be_used_need_tiles_that_may_have_them() {
    let tiles = grid(2, 1, 1);
    let photos = Photos::new(&descriptors(2, 2), vec![0, 1], &params(0.0));
    let bans = [0, 1].map(|tile| TilePhoto { tile, photo: 1 });
    let by_hand = ByHand {
        bans: bans.to_vec(),
        ..ByHand::default()
    };
    for distance in [0.0, 5.0] {
        let rules = Rules {
            use_all: true,
            min_repeat_distance: distance,
            ..Rules::default()
        };
        let found = run(&tiles, &photos, &rules, &by_hand, &params(0.0));
        assert_eq!(found, Err(ChooseError::NotAllUsed));
    }
}

#[test]
fn a_pinned_photo_may_be_banned_everywhere_else() {
    let tiles = grid(4, 4, 3);
    let mut photos = Photos::new(&descriptors(9, 4), (0..9).collect(), &params(0.3));
    photos.ban(5);
    let rules = Rules {
        min_repeat_distance: 0.0,
        ..Rules::default()
    };
    let pins = vec![TilePhoto { tile: 6, photo: 5 }];
    let by_hand = ByHand {
        pins,
        ..ByHand::default()
    };
    let chosen = run(&tiles, &photos, &rules, &by_hand, &params(0.3)).unwrap();
    let with: Vec<usize> = (0..16).filter(|&tile| chosen[tile] == 5).collect();
    assert_eq!(with, [6]);
}
