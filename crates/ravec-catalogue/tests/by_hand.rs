//! Mosaics with photos that are set by hand, previews from memory, and candidates of tiles.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

use ravec_catalogue::{
    Ban, Catalogue, CatalogueError, Mosaic, MosaicParams, Outputs, PhotoSet, Pin, add, mosaic,
    mosaic_in_memory,
};
use ravec_media::{Limits, Picture, WriteOptions, read, write};
use ravec_mosaic::{ChooseParams, Crop, Rules, scaled_photo};
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Image, Rect, Size, Srgb};
use std::path::{Path, PathBuf};

const TILE: (usize, usize) = (16, 12);

/// A photo with a color and a slope of its own.
fn photo(number: usize, width: usize, height: usize) -> Image<Srgb<u8>> {
    let tone = |i: usize| ((number * (37 + 22 * i) + 11 * i) % 200) as f64;
    let turn = number as f64;
    Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
        let (x, y) = (col as f64 / width as f64, row as f64 / height as f64);
        let slope = 40.0 * (x * turn.cos() + y * turn.sin());
        Srgb([0, 1, 2].map(|i| (tone(i) + 30.0 + slope).clamp(0.0, 255.0) as u8))
    })
}

/// A folder with photos of which the last is a copy of the first at another size, and their catalogue.
fn collection() -> (tempfile::TempDir, Catalogue, Vec<PathBuf>) {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().canonicalize().unwrap().join("photos");
    std::fs::create_dir(&photos).unwrap();
    let paths: Vec<PathBuf> = (0..30)
        .map(|number| {
            let path = photos.join(format!("{number:02}.png"));
            let image = match number {
                28 => photo(28, 90, 90),
                29 => photo(0, 160, 120),
                _ => photo(number, 80, 60),
            };
            let picture = Picture::from_image(image);
            write(&path, &picture, &WriteOptions::default()).unwrap();
            path
        })
        .collect();
    let file = folder.path().join("photos.ravec");
    let mut catalogue = Catalogue::open_or_make(&file, &Progress::none()).unwrap();
    add(
        &mut catalogue,
        &[photos],
        &Limits::default(),
        &Progress::none(),
    )
    .unwrap();
    (folder, catalogue, paths)
}

fn params() -> MosaicParams {
    MosaicParams {
        columns: 9,
        rows: Some(8),
        tile: Size::new(TILE.0, TILE.1).unwrap(),
        crop: Crop::Never,
        rules: Rules {
            min_repeat_distance: 2.0,
            ..Rules::default()
        },
        choose: ChooseParams::default(),
        adaptive: None,
        quality: 92,
        kept_bytes: 1 << 16,
        pins: Vec::new(),
        bans: Vec::new(),
        preview_px: None,
    }
}

fn picture() -> AnyImage {
    photo(7, 180, 120).into()
}

fn run(
    catalogue: &Catalogue,
    params: &MosaicParams,
) -> Result<(Mosaic, Image<Srgb<u8>>), CatalogueError> {
    let (limits, progress) = (Limits::default(), Progress::none());
    mosaic_in_memory(catalogue, &picture(), None, params, &limits, &progress)
}

fn pin(col: usize, row: usize, photo: &Path) -> Pin {
    let photo = photo.to_path_buf();
    Pin { col, row, photo }
}

fn ban(tile: Option<[usize; 2]>, photo: &Path) -> Ban {
    let photo = photo.to_path_buf();
    Ban { tile, photo }
}

#[test]
fn pins_and_bans_hold_and_other_tiles_keep_the_limits() {
    let (_folder, catalogue, paths) = collection();
    let (free, _) = run(&catalogue, &params()).unwrap();
    let at = |made: &Mosaic, col: usize, row: usize| made.photos[9 * row + col].clone();
    let (banned, banned_here) = (at(&free, 3, 4), at(&free, 0, 0));
    let pinned = paths
        .iter()
        .find(|path| **path != at(&free, 5, 2) && **path != banned && **path != banned_here)
        .unwrap();
    let by_hand = MosaicParams {
        pins: vec![pin(5, 2, pinned), pin(6, 2, pinned)],
        bans: vec![ban(None, &banned), ban(Some([0, 0]), &banned_here)],
        ..params()
    };
    let (made, image) = run(&catalogue, &by_hand).unwrap();
    for (col, row) in [(5, 2), (6, 2)] {
        assert_eq!(&at(&made, col, row), pinned);
        // the tile is the scaled photo, bit for bit
        let photo = read(pinned, &Limits::default())
            .unwrap()
            .convert::<Srgb<u8>>();
        let genuine = scaled_photo(&photo, by_hand.tile, Crop::Never).unwrap();
        let tile = image.crop(TILE.0 * col, TILE.1 * row, by_hand.tile);
        assert_eq!(tile.unwrap(), genuine);
    }
    assert!(free.photos.contains(&banned) && !made.photos.contains(&banned));
    assert_ne!(at(&made, 0, 0), banned_here);
    // no two tiles within a distance of 2 but those that are pinned have the same photo
    for a in 0..72usize {
        for b in 0..a {
            let [dx, dy] = [(a % 9).abs_diff(b % 9), (a / 9).abs_diff(b / 9)];
            let near = (dx as f64).hypot(dy as f64) < 2.0;
            let both_pinned = (b, a) == (23, 24);
            assert!(!near || both_pinned || made.photos[a] != made.photos[b]);
        }
    }
}

#[test]
fn a_near_duplicate_of_a_banned_photo_is_banned_too_and_may_be_pinned() {
    let (_folder, catalogue, paths) = collection();
    let (first, twin) = (&paths[0], &paths[29]);
    let params = MosaicParams {
        rules: Rules {
            use_all: true,
            min_repeat_distance: 0.0,
            ..Rules::default()
        },
        ..params()
    };
    let (free, _) = run(&catalogue, &params).unwrap();
    assert!(free.photos.contains(first) || free.photos.contains(twin));
    let bans = vec![ban(None, first)];
    let (made, _) = run(
        &catalogue,
        &MosaicParams {
            bans: bans.clone(),
            ..params.clone()
        },
    )
    .unwrap();
    assert!(!made.photos.contains(first) && !made.photos.contains(twin));
    let pins = vec![pin(8, 7, twin)];
    let (made, _) = run(
        &catalogue,
        &MosaicParams {
            bans,
            pins,
            ..params
        },
    )
    .unwrap();
    assert_eq!(&made.photos[71], twin);
    assert_eq!(made.photos.iter().filter(|path| *path == twin).count(), 1);
}

#[test]
fn what_makes_no_sense_is_said_in_words() {
    let (folder, catalogue, paths) = collection();
    let said = |pins: Vec<Pin>, bans: Vec<Ban>, adaptive: Option<u64>| {
        let tile = Size::new(24, 18).unwrap();
        let by_hand = MosaicParams {
            pins,
            bans,
            adaptive,
            tile,
            ..params()
        };
        run(&catalogue, &by_hand).unwrap_err().to_string()
    };
    let none = folder.path().join("none.png");
    let text = said(vec![pin(0, 0, &none)], vec![], None);
    assert!(
        text.contains("has no photo") && text.contains("none.png"),
        "{text}"
    );
    let text = said(vec![], vec![ban(None, &none)], None);
    assert!(
        text.contains("has no photo") && text.contains("none.png"),
        "{text}"
    );
    assert_eq!(
        said(vec![pin(9, 1, &paths[0])], vec![], None),
        "there is no tile 9,1: the grid has 9 columns and 8 rows, counted from 0"
    );
    assert_eq!(
        said(vec![], vec![ban(Some([2, 8]), &paths[0])], None),
        "there is no tile 2,8: the grid has 9 columns and 8 rows, counted from 0"
    );
    assert_eq!(
        said(
            vec![pin(1, 1, &paths[0]), pin(1, 1, &paths[1])],
            vec![],
            None
        ),
        "two photos are pinned to tile 1,1: remove one of the pins"
    );
    for tile in [None, Some([1, 1])] {
        let text = said(vec![pin(1, 1, &paths[3])], vec![ban(tile, &paths[3])], None);
        assert!(text.ends_with("03.png is both pinned and banned: remove the pin or the ban"));
    }
    let text = said(vec![pin(1, 1, &paths[28])], vec![], None);
    assert!(
        text.ends_with("28.png: it has other proportions than a tile"),
        "{text}"
    );
    let text = said(vec![pin(1, 1, &paths[3])], vec![], Some(1));
    assert!(text.contains("adaptive"), "{text}");
    let text = said(vec![], vec![ban(Some([1, 1]), &paths[3])], Some(1));
    assert!(text.contains("adaptive"), "{text}");
    let everything = paths.iter().map(|path| ban(Some([4, 3]), path));
    let text = said(vec![], everything.collect(), None);
    assert!(text.starts_with("no photo is left for tile 4,3"), "{text}");
}

#[test]
fn a_pinned_photo_that_is_broken_is_an_error_and_a_banned_one_is_not() {
    let (_folder, catalogue, paths) = collection();
    std::fs::remove_file(&paths[4]).unwrap();
    let pinned = MosaicParams {
        pins: vec![pin(1, 1, &paths[4])],
        ..params()
    };
    let text = run(&catalogue, &pinned).unwrap_err().to_string();
    assert!(text.ends_with("04.png: it is no longer there"), "{text}");
    let banned = MosaicParams {
        bans: vec![ban(None, &paths[4])],
        ..params()
    };
    let (made, _) = run(&catalogue, &banned).unwrap();
    assert!(!made.photos.contains(&paths[4]));
    // the same length and time, but no picture: it is found while it is painted
    let metadata = paths[5].metadata().unwrap();
    std::fs::write(&paths[5], vec![0; metadata.len() as usize]).unwrap();
    let file = std::fs::File::options().write(true).open(&paths[5]);
    file.unwrap()
        .set_modified(metadata.modified().unwrap())
        .unwrap();
    let pinned = MosaicParams {
        pins: vec![pin(1, 1, &paths[5])],
        ..params()
    };
    let text = run(&catalogue, &pinned).unwrap_err().to_string();
    assert!(text.ends_with("05.png: it cannot be read"), "{text}");
}

#[test]
fn a_ban_holds_in_adaptive_mosaics() {
    let (_folder, catalogue, _) = collection();
    let adaptive = MosaicParams {
        adaptive: Some(1),
        tile: Size::new(24, 18).unwrap(),
        choose: ChooseParams {
            tiling_rounds: 1,
            ..ChooseParams::default()
        },
        ..params()
    };
    let (free, _) = run(&catalogue, &adaptive).unwrap();
    let bans = vec![ban(None, &free.photos[0]), ban(None, &free.photos[7])];
    let with_bans = MosaicParams {
        bans: bans.clone(),
        ..adaptive
    };
    let (made, _) = run(&catalogue, &with_bans).unwrap();
    assert!(bans.iter().all(|ban| !made.photos.contains(&ban.photo)));
}

#[test]
fn a_mosaic_in_memory_has_the_pixels_of_the_file() {
    let (folder, catalogue, paths) = collection();
    let by_hand = MosaicParams {
        pins: vec![pin(2, 3, &paths[11])],
        bans: vec![ban(None, &paths[12])],
        ..params()
    };
    let (in_memory, image) = run(&catalogue, &by_hand).unwrap();
    let path = folder.path().join("a.png");
    let outputs = Outputs {
        picture: Some(&path),
        deep_zoom: None,
    };
    let (limits, progress) = (Limits::default(), Progress::none());
    let made = mosaic(
        &catalogue,
        &picture(),
        &outputs,
        &by_hand,
        &limits,
        &progress,
    )
    .unwrap();
    assert_eq!(made, in_memory);
    let written = read(&path, &limits).unwrap().convert::<Srgb<u8>>();
    assert_eq!(written, image);
}

#[test]
fn a_set_of_photos_gives_the_previews_that_the_catalogue_gives() {
    let (_folder, catalogue, paths) = collection();
    let (limits, progress) = (Limits::default(), Progress::none());
    let first = params();
    let mut set = PhotoSet::load(
        &catalogue,
        first.tile,
        first.crop,
        &limits.memory,
        &progress,
    )
    .unwrap();
    assert_eq!(set.len(), 29);
    for columns in [6, 9] {
        let preview = MosaicParams {
            columns,
            pins: vec![pin(2, 3, &paths[11])],
            bans: vec![ban(None, &paths[12])],
            preview_px: Some(70),
            ..params()
        };
        let kept = set
            .preview(&picture(), &preview, &limits, &progress)
            .unwrap();
        let made = run(&catalogue, &preview).unwrap();
        assert!(kept.1.width().max(kept.1.height()) <= 70);
        assert_eq!(kept, made);
    }
}

#[test]
fn candidates_have_the_distances_that_the_choice_compares() {
    let (_folder, catalogue, paths) = collection();
    let (limits, progress) = (Limits::default(), Progress::none());
    for adaptive in [None, Some(3)] {
        let alone = MosaicParams {
            rules: Rules {
                min_repeat_distance: 0.0,
                ..Rules::default()
            },
            choose: ChooseParams {
                blend: 0.0,
                tiling_rounds: 1,
                ..ChooseParams::default()
            },
            adaptive,
            tile: Size::new(24, 18).unwrap(),
            ..params()
        };
        let (made, _) = run(&catalogue, &alone).unwrap();
        let set = PhotoSet::load(
            &catalogue,
            alone.tile,
            alone.crop,
            &limits.memory,
            &progress,
        )
        .unwrap();
        let candidates = |place: Rect, count: usize, params: &MosaicParams| {
            set.candidates(&picture(), params, place, count, &limits.memory, &progress)
        };
        let mut cost = 0.0;
        for (photo, &place) in made.photos.iter().zip(&made.places) {
            let found = candidates(place, 5, &alone).unwrap();
            assert_eq!(found.len(), 5);
            // each tile alone has the nearest photo
            assert_eq!(&found[0].photo, photo);
            assert!(found.is_sorted_by(|a, b| a.distance <= b.distance));
            cost += found[0].distance.powi(2);
        }
        assert!((cost - made.choice.cost).abs() < 1e-6 * cost);
        // there are 28 groups, of which two are banned
        let tile = made.places[0];
        let mut bans = vec![ban(None, &paths[2])];
        if adaptive.is_none() {
            bans.push(ban(Some([0, 0]), &paths[3]));
        }
        let left = 28 - bans.len();
        let with_bans = MosaicParams {
            bans: bans.clone(),
            ..alone.clone()
        };
        let found = candidates(tile, 100, &with_bans).unwrap();
        assert_eq!(found.len(), left);
        let banned = |photo: &PathBuf| bans.iter().any(|ban| ban.photo == *photo);
        assert!(found.iter().all(|found| !banned(&found.photo)));
        let odd = Rect::new(5, 0, tile.width, tile.height);
        assert!(matches!(
            candidates(odd, 5, &alone),
            Err(CatalogueError::NoSuchPlace { .. })
        ));
    }
}
