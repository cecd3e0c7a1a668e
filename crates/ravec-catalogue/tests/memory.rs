//! Memory that the operations on catalogues take, counted by the allocator: never more than the budget and a little, on any
//! number of threads, and with the same result.

use peak_alloc::PeakAlloc;
use ravec_catalogue::{Added, Catalogue, CatalogueError, MosaicParams, Outputs, add, mosaic};
use ravec_media::{Limits, Picture, WriteOptions, write};
use ravec_memory::MemoryBudget;
use ravec_mosaic::{ChooseParams, Crop, Rules};
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Image, Size, Srgb, Srgba};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// The count covers all threads.
static ALONE: Mutex<()> = Mutex::new(());

/// Memory allowed beside the budget: queues of threads, buffers of files, names.
const BESIDE: u64 = 3_000_000;

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The result of some work in a pool of threads, and the most bytes that it had allocated at one time.
fn counted<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> (T, u64) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    let pool = pool.build().unwrap();
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let result = pool.install(work);
    (result, (MEMORY.peak_usage() - before) as u64)
}

fn limits(budget: u64) -> Limits {
    Limits {
        memory: MemoryBudget::new(budget),
        ..Limits::default()
    }
}

fn pixel(number: usize, col: usize, row: usize) -> [u8; 3] {
    let tone = |i: usize| (number * (37 + 22 * i) + 11 * i) % 150;
    [0, 1, 2].map(|i| (tone(i) + (col * (i + 1) / 40 + row / 30) % 100) as u8)
}

/// A photo, in one of several formats by its number.
fn save(folder: &Path, number: usize, width: usize, height: usize) {
    let size = Size::new(width, height).unwrap();
    let opaque = |col, row| Srgb(pixel(number, col, row));
    let (image, ending): (AnyImage, _) = match number % 5 {
        0 => (Image::from_fn(size, opaque).into(), "jpg"),
        1 => {
            let glass = |col: usize, row: usize| {
                let [r, g, b] = pixel(number, col, row);
                Srgba([r, g, b, 128 + (col % 128) as u8])
            };
            (Image::from_fn(size, glass).into(), "png")
        }
        2 => (Image::from_fn(size, opaque).into(), "tif"),
        3 => (Image::from_fn(size, opaque).into(), "webp"),
        _ => (Image::from_fn(size, opaque).into(), "png"),
    };
    let path = folder.join(format!("{number:02}.{ending}"));
    write(path, &Picture::from_image(image), &WriteOptions::default()).unwrap();
}

/// Adds the photos of a folder to a new catalogue beside it.
fn add_all(photos: &Path, limits: &Limits) -> (Added, Catalogue) {
    let folder = tempfile::tempdir_in(photos.parent().unwrap())
        .unwrap()
        .keep();
    let path = folder.join("photos.ravec");
    let mut catalogue = Catalogue::open_or_make(&path, &Progress::none()).unwrap();
    let paths = [photos.to_path_buf()];
    let added = add(&mut catalogue, &paths, limits, &Progress::none()).unwrap();
    (added, catalogue)
}

#[test]
fn photos_that_are_added_share_the_budget_and_wait_for_one_another() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    for number in 0..10 {
        // WebP takes more for each pixel
        let part = if number % 5 == 3 { 2 } else { 1 };
        save(&photos, number, 1500 / part, 1100 / part);
    }
    let (all, taken) = counted(1, || add_all(&photos, &limits(1 << 30)));
    assert_eq!((all.0.new, all.0.unreadable.len()), (10, 0));
    let entries = all.1.entries(true).unwrap();
    // hardly more than one photo alone, and less than two
    let budget = 17_000_000;
    assert!(taken < budget && 2 * taken > budget, "{taken}");
    for threads in [1, 2, 4] {
        let limits = limits(budget);
        let ((added, catalogue), taken) = counted(threads, || add_all(&photos, &limits));
        assert_eq!(added, all.0, "{threads} threads");
        assert_eq!(catalogue.entries(true).unwrap(), entries);
        assert!(taken <= budget + BESIDE, "{threads} threads took {taken}");
        assert_eq!(limits.memory.used(), 0);
    }
}

#[test]
fn a_photo_is_refused_if_it_alone_exceeds_the_budget_and_is_added_with_more() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    for number in 0..10 {
        save(&photos, number, 200, 150);
    }
    save(&photos, 14, 3000, 3000);
    let path = folder.path().join("photos.ravec");
    let paths = [photos];
    for threads in [1, 2, 4] {
        let _ = std::fs::remove_file(&path);
        let mut catalogue = Catalogue::open_or_make(&path, &Progress::none()).unwrap();
        let budget = 4_000_000;
        let limits = limits(budget);
        let (added, taken) = counted(threads, || {
            add(&mut catalogue, &paths, &limits, &Progress::none()).unwrap()
        });
        assert_eq!(added.new, 10);
        let (name, reason) = &added.unreadable[0];
        assert!(
            name.ends_with("14.png") && reason.contains("`max_bytes`"),
            "{reason}"
        );
        assert!(taken <= budget + BESIDE, "{threads} threads took {taken}");
        // what a limit refuses is not remembered as broken
        let again = add(
            &mut catalogue,
            &paths,
            &Limits::default(),
            &Progress::none(),
        )
        .unwrap();
        assert_eq!((again.new, again.unchanged), (1, 10));
    }
}

fn params(columns: usize, rows: usize, tile: (usize, usize)) -> MosaicParams {
    MosaicParams {
        columns,
        rows: Some(rows),
        tile: Size::new(tile.0, tile.1).unwrap(),
        crop: Crop::Center,
        rules: Rules {
            min_repeat_distance: 0.0,
            ..Rules::default()
        },
        choose: ChooseParams::default(),
        quality: 90,
        kept_bytes: 128 << 20,
        adaptive: None,
        pins: Vec::new(),
        bans: Vec::new(),
        preview_px: None,
    }
}

fn picture() -> AnyImage {
    let size = Size::new(480, 360).unwrap();
    Image::from_fn(size, |col, row| Srgb(pixel(col / 60 + row / 50, col, row))).into()
}

/// Makes a mosaic as a picture and as a page, and returns their bytes.
fn made(
    catalogue: &Path,
    folder: &Path,
    params: &MosaicParams,
    limits: &Limits,
) -> Result<Vec<Vec<u8>>, CatalogueError> {
    let (path, zoom) = (folder.join("mosaic.png"), folder.join("zoom"));
    let outputs = Outputs {
        picture: Some(&path),
        deep_zoom: Some(&zoom),
    };
    let picture = picture();
    let catalogue = Catalogue::open_to_read(catalogue, &Progress::none())?;
    mosaic(
        &catalogue,
        &picture,
        &outputs,
        params,
        limits,
        &Progress::none(),
    )?;
    let names = ["mosaic.png", "zoom/index.html", "zoom/ravec-manifest.json"];
    Ok(names
        .map(|name| std::fs::read(folder.join(name)).unwrap())
        .to_vec())
}

#[test]
fn mosaics_of_large_tiles_are_painted_within_the_budget_and_the_same() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    for number in 0..10 {
        save(&photos, number, 800, 600);
    }
    let (_, catalogue) = add_all(&photos, &Limits::default());
    let catalogue = catalogue.path();
    // a row of tiles has 13 MB
    let params = params(6, 3, (1000, 750));
    let plenty = limits(1 << 30);
    let expected = made(catalogue, folder.path(), &params, &plenty).unwrap();
    let budget = 45_000_000;
    for threads in [1, 2, 4] {
        let limits = limits(budget);
        let (bytes, taken) = counted(threads, || {
            made(catalogue, folder.path(), &params, &limits).unwrap()
        });
        // what is compared is held beside the mosaic, after it
        assert!(taken <= budget + BESIDE, "{threads} threads took {taken}");
        assert!(bytes == expected, "{threads} threads");
        assert_eq!(limits.memory.used(), 0);
    }
    for budget in [100, 100_000, 1_000_000] {
        let error = made(catalogue, folder.path(), &params, &limits(budget)).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("`max_bytes`"), "{budget}: {text}");
    }
}

#[test]
fn the_choice_among_photos_for_many_tiles_is_within_what_is_reserved() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    for number in 0..200 {
        save(&photos, number, 48, 36);
    }
    let (_, catalogue) = add_all(&photos, &Limits::default());
    let catalogue = catalogue.path();
    let grid = params(60, 50, (6, 6));
    let adaptive = MosaicParams {
        adaptive: Some(1),
        ..params(16, 12, (6, 6))
    };
    for params in [grid, adaptive] {
        for threads in [1, 4] {
            let budget = MemoryBudget::new(1 << 30);
            let limits = Limits {
                memory: budget.clone(),
                ..Limits::default()
            };
            let (result, taken) =
                counted(threads, || made(catalogue, folder.path(), &params, &limits));
            result.unwrap();
            let tiles = (params.columns * params.rows.unwrap()) as u64;
            let of_tile = if params.adaptive.is_some() {
                30_000
            } else {
                3000
            };
            assert!(
                taken <= tiles * of_tile + 4 * BESIDE,
                "{threads} threads took {taken}"
            );
        }
    }
}

#[test]
fn mosaics_and_previews_of_more_pixels_than_allowed_are_refused() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    for number in 0..10 {
        save(&photos, number, 48, 36);
    }
    let (_, catalogue) = add_all(&photos, &Limits::default());
    let catalogue = catalogue.path();
    for preview_px in [None, Some(10)] {
        let params = MosaicParams {
            preview_px,
            ..params(100, 80, (4, 3))
        };
        let pixels = if preview_px.is_some() { 8000 } else { 96_000 };
        let most = |max_pixels| Limits {
            max_pixels,
            ..Limits::default()
        };
        made(catalogue, folder.path(), &params, &most(pixels)).unwrap();
        let error = made(catalogue, folder.path(), &params, &most(pixels - 1)).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("`max_pixels`"), "{text}");
    }
}
