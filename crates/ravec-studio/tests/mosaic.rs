//! Photo mosaics in the studio, driven by clicks and keys without a window.

use egui::{Key, Modifiers, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use ravec::raster::{AnyImage, Image, Size, Srgb};
use ravec_jobs::{Context, Operation as _, recipe};
use ravec_media::{Limits, Picture, WriteOptions, read, write};
use ravec_scenes::Seed;
use ravec_scenes::swatches::swatches;
use ravec_studio::Edit;
use ravec_studio::Studio;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A bound on the time that background work may take, far beyond what it takes.
const HANG: Duration = Duration::from_mins(1);

/// Pixels of a tile that the tool starts with.
const TILE: [usize; 2] = [64, 48];

/// A folder with a picture, and procedural photos in `photos`.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    let options = WriteOptions::default();
    for number in 0..120 {
        let (image, _) = swatches(Size::new(96, 72).unwrap(), Seed(number));
        let image: Image<Srgb<u8>> = image.convert();
        let path = photos.join(format!("{number:02}.png"));
        write(&path, &Picture::from_image(AnyImage::from(image)), &options).unwrap();
    }
    let image: Image<Srgb<u8>> = Image::from_fn(Size::new(160, 120).unwrap(), |col, row| {
        Srgb([col as u8, 60 + row as u8, 110])
    });
    let path = folder.path().join("photo.png");
    write(&path, &Picture::from_image(AnyImage::from(image)), &options).unwrap();
    folder
}

/// Lets the studio run until nothing is going on.
fn settle(harness: &mut Harness<'_, Studio>) {
    let start = Instant::now();
    let mut quiet = 0;
    while quiet < 4 {
        harness.step();
        if harness.state().is_busy() {
            quiet = 0;
            std::thread::sleep(Duration::from_millis(5));
        } else {
            quiet += 1;
        }
        assert!(start.elapsed() < HANG, "the studio hangs");
    }
}

fn click(harness: &mut Harness<'_, Studio>, label: &str) {
    harness.get_by_label(label).click();
    settle(harness);
}

fn type_into(harness: &mut Harness<'_, Studio>, label: &str, text: &str) {
    harness.get_by_label(label).focus();
    harness.step();
    harness.get_by_label(label).type_text(text);
    settle(harness);
}

fn edit(harness: &Harness<'_, Studio>) -> Edit {
    Edit::clone(&harness.state().document().unwrap().edits[0])
}

/// Paths of the photos of all tiles, row by row.
fn photos(harness: &Harness<'_, Studio>) -> Vec<PathBuf> {
    let snapshot = harness.state().snapshot().unwrap();
    assert_eq!(snapshot.failure, None);
    let report = &snapshot.reports[&edit(harness).id];
    let photos = report.result.as_ref().unwrap()["photos"].clone();
    serde_json::from_value(photos).unwrap()
}

fn size(harness: &Harness<'_, Studio>) -> [usize; 2] {
    harness.state().snapshot().unwrap().size().unwrap()
}

/// Clicks the middle of a tile of a mosaic that is fit into the canvas.
fn click_tile(harness: &mut Harness<'_, Studio>, [col, row]: [usize; 2]) {
    let area = harness.get_by_label("Canvas").rect();
    let size = size(harness).map(|side| side as f32);
    let size = Vec2::new(size[0], size[1]);
    let zoom = (area.size() / size).min_elem() * 0.96;
    let middle = |index: usize, side: usize| (index as f32 + 0.5) * side as f32;
    let at = Vec2::new(middle(col, TILE[0]), middle(row, TILE[1]));
    let at: Pos2 = area.center() + zoom * (at - 0.5 * size);
    harness.hover_at(at);
    harness.step();
    harness.drag_at(at);
    harness.step();
    harness.drop_at(at);
    settle(harness);
}

/// A studio with a mosaic of 10 × 10 tiles from a catalogue that it has made.
fn mosaic(folder: &Path) -> Harness<'static, Studio> {
    let photo = folder.join("photo.png");
    let mut harness = Harness::builder()
        .with_size(Vec2::new(1400.0, 1400.0))
        .build_eframe(move |context| {
            let mut studio = Studio::new(&context.egui_ctx, None);
            studio.open(&photo);
            studio
        });
    settle(&mut harness);
    click(&mut harness, "Mosaic");
    // nothing is wrong before there is a catalogue
    assert_eq!(harness.state().snapshot().unwrap().failure, None);
    assert_eq!(size(&harness), [160, 120]);
    let photos = folder.join("photos");
    type_into(&mut harness, "Folder of photos", photos.to_str().unwrap());
    click(&mut harness, "Make the catalogue");
    let catalogue = folder.join("photos.ravec");
    assert!(catalogue.is_file());
    assert_eq!(
        edit(&harness).fields["catalogue"],
        catalogue.to_str().unwrap()
    );
    harness
}

/// Saves the project and exports; the exported bytes are those of `ravec run`, and the pixels those that are shown.
fn assert_export_is_that_of_run(harness: &mut Harness<'_, Studio>, folder: &Path) {
    harness.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(harness);
    click(harness, "Save the project: Save");
    click(harness, "Export…");
    click(harness, "Export the result: Export");
    let exported = folder.join("photo-edited.png");
    let studio =
        std::fs::read(&exported).unwrap_or_else(|_| panic!("{:?}", harness.state().message()));
    let shown = harness.state().snapshot().unwrap().result.unwrap();
    let written = read(&exported, &Limits::default()).unwrap();
    assert_eq!(shown.content.picture().unwrap().image, written.image);
    std::fs::remove_file(&exported).unwrap();
    let run = recipe::Run {
        file: folder.join("photo.ravec.json"),
        params: recipe::Params::default(),
    };
    run.run(&Context::default()).unwrap();
    assert!(std::fs::read(&exported).unwrap() == studio);
}

#[test]
fn photos_are_pinned_and_banned_by_clicks_and_exported_as_they_are_shown() {
    let folder = folder();
    let mut harness = mosaic(folder.path());
    let free = photos(&harness);
    let columns = size(&harness)[0] / TILE[0];
    assert_eq!((columns, free.len() / columns), (40, 40));
    let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    let at = |photos: &[PathBuf], [col, row]: [usize; 2]| photos[row * columns + col].clone();

    let tile = [20, 10];
    click_tile(&mut harness, tile);
    assert!(harness.query_by_label("Tile 20,10").is_some());
    let all: Vec<PathBuf> = {
        let mut all = free.clone();
        all.sort();
        all.dedup();
        all
    };
    let pin = |harness: &Harness<'_, Studio>, photo: &Path| {
        let label = format!("Pin {}", name(photo));
        harness.query_by_label(&label).is_some().then_some(label)
    };
    let (wanted, label) = all
        .iter()
        .filter(|photo| **photo != at(&free, tile))
        .find_map(|photo| Some((photo.clone(), pin(&harness, photo)?)))
        .expect("candidates are listed");
    click(&mut harness, &label);
    assert_eq!(
        edit(&harness).param("pins"),
        &serde_json::json!([format!("20,10:{}", wanted.display())])
    );
    assert_eq!(at(&photos(&harness), tile), wanted);

    // another tile: its photo is not used any more
    let other = [30, 25];
    click_tile(&mut harness, other);
    let banned = at(&photos(&harness), other);
    click(&mut harness, "Ban its photo");
    let now = photos(&harness);
    assert!(now.iter().all(|photo| *photo != banned));
    assert_eq!(at(&now, tile), wanted);
    // each decision is a step
    click(&mut harness, "Undo");
    assert!(photos(&harness).contains(&banned));
    click(&mut harness, "Redo");
    assert!(!photos(&harness).contains(&banned));

    // and not here
    let here = at(&photos(&harness), other);
    click(&mut harness, "Not here: its photo");
    assert_ne!(at(&photos(&harness), other), here);
    assert_eq!(edit(&harness).param("bans").as_array().unwrap().len(), 2);
    assert_export_is_that_of_run(&mut harness, folder.path());

    click(&mut harness, "Unpin 20,10");
    assert!(edit(&harness).param("pins").is_null());
    click(&mut harness, &format!("Allow {}", name(&banned)));
    assert_eq!(edit(&harness).param("bans").as_array().unwrap().len(), 1);
}

#[test]
fn a_page_is_written_now_and_with_exports_but_not_while_editing() {
    let folder = folder();
    let mut harness = mosaic(folder.path());
    click(&mut harness, "Page that zooms into the photos");
    let page = folder.path().join("page");
    type_into(&mut harness, "Folder of the page", page.to_str().unwrap());
    click(&mut harness, "Write it with every export");
    assert_eq!(edit(&harness).fields["deep_zoom"], page.to_str().unwrap());
    assert!(!page.exists());
    click(&mut harness, "Write the page");
    let message = harness.query_by_label_contains("is written");
    assert!(message.is_some() && page.join("index.html").is_file());
    std::fs::remove_dir_all(&page).unwrap();
    assert_export_is_that_of_run(&mut harness, folder.path());
    assert!(page.join("index.html").is_file());
}

#[test]
fn a_folder_that_is_missing_is_an_error_in_words() {
    let folder = folder();
    let photo = folder.path().join("photo.png");
    let mut harness = Harness::builder()
        .with_size(Vec2::new(1400.0, 1000.0))
        .build_eframe(move |context| {
            let mut studio = Studio::new(&context.egui_ctx, None);
            studio.open(&photo);
            studio
        });
    settle(&mut harness);
    click(&mut harness, "Mosaic");
    let missing = folder.path().join("missing");
    type_into(&mut harness, "Folder of photos", missing.to_str().unwrap());
    click(&mut harness, "Make the catalogue");
    let said = harness.query_all_by_label_contains("cannot add").count();
    assert_eq!(said, 1);
    assert!(!edit(&harness).fields.contains_key("catalogue"));
}
