//! Catalogues and mosaics of drawn photos, in temporary folders.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

use ravec_catalogue::{
    Catalogue, CatalogueError, MosaicParams, MosaicWorker, Outputs, add, clean, mosaic,
    mosaic_in_pieces, remove, stats,
};
use ravec_media::{Limits, Picture, WriteOptions, read, write};
use ravec_memory::MemoryBudget;
use ravec_mosaic::{ChooseParams, Crop, Rules, scaled_photo, violations};
use ravec_pieces::{Cluster, Executor, FolderStore, PartStore};
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Image, Size, Srgb};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A photo with a color, a slope and some structure of its own.
fn photo(number: usize, width: usize, height: usize) -> Image<Srgb<u8>> {
    let tone = |i: usize| ((number * (37 + 22 * i) + 11 * i) % 200) as f64;
    let turn = number as f64;
    Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
        let (x, y) = (col as f64 / width as f64, row as f64 / height as f64);
        let slope = 40.0 * (x * turn.cos() + y * turn.sin());
        let wave = 30.0 * ((6.0 + turn % 5.0) * (x + y * (turn * 0.7).sin())).sin();
        Srgb([0, 1, 2].map(|i| (tone(i) + 20.0 + slope + wave).clamp(0.0, 255.0) as u8))
    })
}

fn save(path: &Path, image: &Image<Srgb<u8>>) {
    write(
        path,
        &Picture::from_image(image.clone()),
        &WriteOptions::default(),
    )
    .unwrap();
}

/// A folder with photos of 120 × 90 pixels and their catalogue.
fn studio(photos: usize) -> (tempfile::TempDir, Catalogue) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("photos")).unwrap();
    for number in 0..photos {
        let kind = if number % 2 == 0 { "png" } else { "jpg" };
        let path = folder.path().join(format!("photos/{number:03}.{kind}"));
        save(&path, &photo(number, 120, 90));
    }
    let mut catalogue =
        Catalogue::open_or_make(&folder.path().join("photos.ravec"), &Progress::none()).unwrap();
    put(&mut catalogue, folder.path());
    (folder, catalogue)
}

fn put(catalogue: &mut Catalogue, folder: &Path) -> ravec_catalogue::Added {
    let paths = [folder.join("photos")];
    add(catalogue, &paths, &Limits::default(), &Progress::none()).unwrap()
}

fn params(columns: usize, rows: usize, tile: (usize, usize), crop: Crop) -> MosaicParams {
    MosaicParams {
        columns,
        rows: Some(rows),
        tile: Size::new(tile.0, tile.1).unwrap(),
        crop,
        rules: Rules {
            min_repeat_distance: 2.0,
            ..Rules::default()
        },
        choose: ChooseParams::default(),
        quality: 92,
        kept_bytes: 1 << 16,
        adaptive: None,
        pins: Vec::new(),
        bans: Vec::new(),
        preview_px: None,
    }
}

fn picture() -> AnyImage {
    photo(7, 300, 200).into()
}

fn make(
    catalogue: &Catalogue,
    picture: &AnyImage,
    output: &Path,
    params: &MosaicParams,
) -> Result<ravec_catalogue::Mosaic, CatalogueError> {
    let outputs = Outputs {
        picture: Some(output),
        deep_zoom: None,
    };
    mosaic(
        catalogue,
        picture,
        &outputs,
        params,
        &Limits::default(),
        &Progress::none(),
    )
}

#[test]
fn every_tile_is_the_scaled_photo_bit_for_bit() {
    let (folder, catalogue) = studio(80);
    let whole = params(12, 9, (24, 18), Crop::Never);
    for (name, params) in [
        ("a.png", &whole),
        ("b.tif", &params(9, 6, (20, 20), Crop::Center)),
    ] {
        let output = folder.path().join(name);
        let made = make(&catalogue, &picture(), &output, params).unwrap();
        let written = read(&output, &Limits::default())
            .unwrap()
            .convert::<Srgb<u8>>();
        assert_eq!(written.size(), made.size);
        for (at, path) in made.photos.iter().enumerate() {
            let (col, row) = (at % made.tiles.0, at / made.tiles.0);
            let photo = read(path, &Limits::default())
                .unwrap()
                .convert::<Srgb<u8>>();
            let genuine = scaled_photo(&photo, params.tile, params.crop).unwrap();
            let tile = written
                .crop(
                    col * params.tile.width(),
                    row * params.tile.height(),
                    params.tile,
                )
                .unwrap();
            assert_eq!(tile, genuine, "tile {at} of {name}");
        }
        assert!(made.nearest_repeat.is_none_or(|distance| distance >= 2.0));
        let groups: Vec<u32> = (0..made.fitting as u32).collect();
        let centers: Vec<[f64; 2]> = (0..made.photos.len())
            .map(|at| [(at % made.tiles.0) as f64, (at / made.tiles.0) as f64])
            .collect();
        assert_eq!(
            violations(&params.rules, &centers, &made.choice.photos, &groups),
            [""; 0]
        );
    }
}

#[test]
fn tiles_off_the_grid_are_scaled_photos_too_and_cover_the_mosaic() {
    let (folder, catalogue) = studio(80);
    for (name, tile, crop) in [
        ("a.png", (24, 18), Crop::Never),
        ("b.png", (21, 21), Crop::Center),
    ] {
        let output = folder.path().join(name);
        let params = MosaicParams {
            adaptive: Some(3),
            ..params(12, 9, tile, crop)
        };
        let made = make(&catalogue, &picture(), &output, &params).unwrap();
        let written = read(&output, &Limits::default())
            .unwrap()
            .convert::<Srgb<u8>>();
        let mut covered = 0;
        for (path, place) in made.photos.iter().zip(&made.places) {
            let photo = read(path, &Limits::default())
                .unwrap()
                .convert::<Srgb<u8>>();
            let size = place.size().unwrap();
            let tile = written.crop(place.col, place.row, size).unwrap();
            assert_eq!(Some(tile), scaled_photo(&photo, size, crop), "{place:?}");
            covered += place.pixels();
        }
        assert_eq!(covered, made.size.pixels());
        assert!(made.photos.len() <= 108 && made.nearest_repeat.is_none_or(|far| far >= 2.0));
        assert!(made.places.iter().any(|place| place.col % tile.0 != 0));
    }
    let odd = MosaicParams {
        adaptive: Some(0),
        ..params(4, 3, (20, 20), Crop::Center)
    };
    let error = make(&catalogue, &picture(), &folder.path().join("c.png"), &odd);
    assert!(error.unwrap_err().to_string().contains("multiples of 3"));
}

#[test]
fn one_thread_and_many_make_the_same_mosaic() {
    let (folder, catalogue) = studio(40);
    let path = catalogue.path().to_path_buf();
    let bytes = |threads: usize| {
        let output = folder.path().join(format!("{threads}.png"));
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let params = params(8, 6, (16, 12), Crop::Never);
        pool.install(|| {
            make(
                &Catalogue::open(&path, &Progress::none()).unwrap(),
                &picture(),
                &output,
                &params,
            )
        })
        .unwrap();
        std::fs::read(output).unwrap()
    };
    assert_eq!(bytes(1), bytes(4));
}

#[test]
fn a_second_run_knows_what_was_added_moved_and_changed() {
    let (folder, mut catalogue) = studio(6);
    let photos = folder.path().join("photos");
    assert_eq!(put(&mut catalogue, folder.path()).unchanged, 6);

    std::fs::rename(photos.join("000.png"), photos.join("moved.png")).unwrap();
    std::fs::copy(photos.join("002.png"), photos.join("copy.png")).unwrap();
    save(&photos.join("004.png"), &photo(50, 120, 90));
    ravec_files::write_atomically(&photos.join("bad.jpg"), |writer| {
        std::io::Write::write_all(writer, b"\xff\xd8\xff no picture")
    })
    .unwrap();
    let added = put(&mut catalogue, folder.path());
    assert_eq!(
        (added.moved, added.copies, added.changed, added.new),
        (1, 1, 1, 0)
    );
    assert_eq!((added.unchanged, added.unreadable.len()), (4, 1));
    let entries = catalogue.entries(false).unwrap();
    assert_eq!(entries.len(), 7);
    assert!(
        entries
            .iter()
            .any(|entry| entry.path.ends_with("moved.png"))
    );
    assert_eq!(stats(&catalogue).unwrap().unreadable, 1);

    assert_eq!(
        remove(&mut catalogue, &[photos.join("moved.png")]).unwrap(),
        1
    );
    assert_eq!(
        remove(&mut catalogue, &[folder.path().to_path_buf()]).unwrap(),
        6
    );
    assert!(catalogue.entries(true).unwrap().is_empty());
}

#[test]
fn cleaning_states_a_reason_for_each_photo_and_a_dry_run_changes_nothing() {
    let (folder, mut catalogue) = studio(5);
    let photos = folder.path().join("photos");
    save(&photos.join("tiny.png"), &photo(60, 40, 30));
    save(
        &photos.join("blank.png"),
        &Image::new(Size::new(100, 80).unwrap(), Srgb([250; 3])),
    );
    let bars = photo(61, 100, 100);
    let bars = Image::from_fn(bars.size(), |col, row| {
        if (15..85).contains(&row) {
            bars[(col, row)]
        } else {
            Srgb([0; 3])
        }
    });
    save(&photos.join("bars.png"), &bars);
    // the same photo, smaller and compressed
    save(&photos.join("twin.jpg"), &photo(3, 96, 72));
    put(&mut catalogue, folder.path());
    std::fs::remove_file(photos.join("000.png")).unwrap();

    let dry = clean(&mut catalogue, true, &Progress::none()).unwrap();
    let reasons: Vec<(String, &str)> = dry
        .iter()
        .map(|dropped| {
            let name = dropped
                .path
                .file_name()
                .unwrap()
                .to_string_lossy()
                .into_owned();
            (name, dropped.reason.split(' ').next().unwrap())
        })
        .collect();
    let expected = [
        ("000.png", "missing"),
        ("bars.png", "framed"),
        ("blank.png", "contentless"),
        ("tiny.png", "tiny"),
        ("twin.jpg", "near-duplicate"),
    ];
    assert_eq!(
        reasons,
        expected.map(|(name, reason)| (name.to_owned(), reason))
    );
    assert_eq!(catalogue.entries(false).unwrap().len(), 9);
    assert_eq!(
        clean(&mut catalogue, false, &Progress::none()).unwrap(),
        dry
    );
    assert_eq!(catalogue.entries(false).unwrap().len(), 4);
    // what was cleaned away is not added again
    assert_eq!(put(&mut catalogue, folder.path()).new, 0);
    assert_eq!(stats(&catalogue).unwrap().dropped.len(), 4);
}

#[test]
fn a_photo_that_disappears_is_named_and_others_take_its_place() {
    let (folder, catalogue) = studio(60);
    let output = folder.path().join("a.png");
    let params = params(9, 8, (20, 15), Crop::Never);
    let first = make(&catalogue, &picture(), &output, &params).unwrap();
    assert_eq!(first.warnings, [""; 0]);
    let gone = first.photos[5].clone();
    std::fs::remove_file(&gone).unwrap();
    let second = make(&catalogue, &picture(), &output, &params).unwrap();
    assert!(second.warnings.len() == 1 && second.warnings[0].contains(gone.to_str().unwrap()));
    assert!(!second.photos.contains(&gone));

    // broken, with the old size and time, so that it is noticed only when it is decoded
    let broken = second.photos[3].clone();
    let time = std::fs::metadata(&broken).unwrap().modified().unwrap();
    let length = std::fs::metadata(&broken).unwrap().len() as usize;
    ravec_files::write_atomically(&broken, |writer| {
        std::io::Write::write_all(writer, &vec![b'x'; length])
    })
    .unwrap();
    std::fs::File::options()
        .append(true)
        .open(&broken)
        .unwrap()
        .set_modified(time)
        .unwrap();
    let third = make(&catalogue, &picture(), &output, &params).unwrap();
    assert!(
        third
            .warnings
            .iter()
            .any(|warning| warning.contains(broken.to_str().unwrap()))
    );
    assert!(!third.photos.contains(&broken) && output.exists());
}

#[test]
fn what_cannot_be_made_is_said_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("a.png");
    let mut empty =
        Catalogue::open_or_make(&folder.path().join("empty.ravec"), &Progress::none()).unwrap();
    let square = params(4, 3, (16, 16), Crop::Never);
    let said = |catalogue: &Catalogue, params: &MosaicParams| {
        make(catalogue, &picture(), &output, params)
            .unwrap_err()
            .to_string()
    };
    assert!(said(&empty, &square).contains("has no photo that can be used"));
    let missing = [PathBuf::from("no/such/folder")];
    let error = add(&mut empty, &missing, &Limits::default(), &Progress::none()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "cannot add no/such/folder: No such file or directory"
    );

    let (_photos, catalogue) = studio(3);
    assert!(
        said(&catalogue, &square)
            .starts_with("none of the 3 photos has the proportions of a tile of 16 x 16")
    );
    let far = MosaicParams {
        rules: Rules::default(),
        ..params(8, 6, (16, 12), Crop::Never)
    };
    assert!(
        said(&catalogue, &far)
            .starts_with("too few photos (3 that differ) to keep repeats 5 tiles apart")
    );
    assert!(
        said(&catalogue, &params(400, 3, (4, 3), Crop::Never))
            .contains("too few for 400 x 3 tiles")
    );
    assert!(!output.exists());
}

#[test]
fn an_interrupted_run_keeps_what_was_committed_and_goes_on_there() {
    let (folder, _) = studio(300);
    let paths = [folder.path().join("photos")];
    // later and later, until the second of two batches is interrupted
    let mut catalogue = (0..)
        .find_map(|run| {
            let path = folder.path().join(format!("{run}.ravec"));
            let mut catalogue = Catalogue::open_or_make(&path, &Progress::none()).unwrap();
            let progress = Progress::cancelled_at(400 + 100 * run);
            let stopped = add(&mut catalogue, &paths, &Limits::default(), &progress);
            assert!(matches!(stopped, Err(CatalogueError::Cancelled(_))));
            drop(catalogue);
            let catalogue = Catalogue::open(&path, &Progress::none()).unwrap();
            match catalogue.entries(true).unwrap().len() {
                0 => None,
                256 => Some(catalogue),
                photos => panic!("{photos} photos"),
            }
        })
        .unwrap();
    let rest = add(
        &mut catalogue,
        &paths,
        &Limits::default(),
        &Progress::none(),
    )
    .unwrap();
    assert_eq!((rest.unchanged, rest.new), (256, 44));
}

#[test]
fn two_writers_wait_for_one_another() {
    let (folder, catalogue) = studio(40);
    let path = folder.path().join("shared.ravec");
    drop(catalogue);
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                let mut catalogue = Catalogue::open_or_make(&path, &Progress::none()).unwrap();
                put(&mut catalogue, folder.path());
            });
        }
    });
    assert_eq!(
        Catalogue::open(&path, &Progress::none())
            .unwrap()
            .entries(true)
            .unwrap()
            .len(),
        40
    );
}

/// An executor in this process; every third part is lost as soon as it is written.
struct LossyExecutor {
    store: Arc<dyn PartStore>,
    pieces: Vec<(u64, Vec<u8>)>,
    lost: Arc<AtomicUsize>,
}

impl Executor for LossyExecutor {
    fn submit(&mut self, number: u64, piece: Vec<u8>) -> std::io::Result<()> {
        self.pieces.push((number, piece));
        Ok(())
    }

    fn next(&mut self, progress: &Progress) -> std::io::Result<(u64, Vec<u8>)> {
        let (number, piece) = self.pieces.pop().expect("a piece is out");
        let worker = MosaicWorker::new(Arc::clone(&self.store), MemoryBudget::default());
        let answer = worker.run(&piece, progress);
        if self.lost.fetch_add(1, Ordering::Relaxed).is_multiple_of(3) {
            self.store.remove(&format!("part-{number}"))?;
        }
        Ok((number, answer.map_err(std::io::Error::other)?))
    }
}

#[test]
fn mosaics_in_pieces_are_the_same_with_lost_parts() {
    let (folder, catalogue) = studio(90);
    let photos = folder.path().join("photos");
    std::fs::remove_file(photos.join("004.png")).unwrap();
    std::fs::write(photos.join("011.jpg"), b"no photo").unwrap();
    let mut asked = params(10, 8, (16, 12), Crop::Center);
    asked.rules.max_uses = Some(1);
    let parts = tempfile::tempdir().unwrap();
    let store: Arc<dyn PartStore> = Arc::new(FolderStore::new(parts.path()));
    let lost = Arc::new(AtomicUsize::new(0));
    let executor = LossyExecutor {
        store: Arc::clone(&store),
        pieces: vec![],
        lost: Arc::clone(&lost),
    };
    let cluster = Cluster::new(store, Box::new(executor));
    let (limits, none, picture) = (Limits::default(), Progress::none(), picture());
    // rows of tiles of 22 MB are painted in two parts, and are one strip of the TIFF file
    let large = params(10, 2, (1000, 750), Crop::Center);
    for (asked, name) in [(&asked, "png"), (&large, "tif")] {
        let [alone, together] =
            ["alone", "together"].map(|of| folder.path().join(of).with_extension(name));
        let [to_alone, to_together] = [&alone, &together].map(|path| Outputs {
            picture: Some(path),
            deep_zoom: None,
        });
        let expected = mosaic(&catalogue, &picture, &to_alone, asked, &limits, &none).unwrap();
        // the store of a work begins without parts
        for part in std::fs::read_dir(parts.path()).unwrap() {
            std::fs::remove_file(part.unwrap().path()).unwrap();
        }
        let made = mosaic_in_pieces(
            &catalogue,
            &picture,
            &to_together,
            asked,
            &limits,
            &cluster,
            &none,
        );
        assert_eq!(made.unwrap(), expected);
        assert!(!expected.warnings.is_empty());
        assert!(std::fs::read(&together).unwrap() == std::fs::read(&alone).unwrap());
    }
    assert!(lost.load(Ordering::Relaxed) > 2);
    let worker = MosaicWorker::new(Arc::clone(cluster.store()), MemoryBudget::default());
    for bytes in [&[][..], &[255; 30]] {
        let error = worker.run(bytes, &none).unwrap_err();
        assert!(matches!(error, CatalogueError::Piece { .. }), "{error}");
    }
}
