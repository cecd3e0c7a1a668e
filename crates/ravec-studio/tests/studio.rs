//! The studio, driven by clicks, drags and keys without a window.

use egui::{Key, Modifiers, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use ravec::raster::{AnyImage, Image, Size, Srgb};
use ravec_jobs::{Context, Operation as _, recipe};
use ravec_media::{Picture, WriteOptions};
use ravec_studio::Studio;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A bound on the time that background work may take, far beyond what it takes.
const HANG: Duration = Duration::from_mins(1);

fn photo(folder: &Path) -> PathBuf {
    let image: Image<Srgb<u8>> = Image::from_fn(Size::new(160, 120).unwrap(), |col, row| {
        let disc = (col as f64 - 60.0).hypot(row as f64 - 50.0) < 30.0;
        Srgb(if disc {
            [220, 120, 60]
        } else {
            [40, 60 + (row / 2) as u8, 110]
        })
    });
    let path = folder.join("photo.png");
    let picture = Picture::from_image(AnyImage::from(image));
    ravec_media::write(&path, &picture, &WriteOptions::default()).unwrap();
    path
}

fn write_mesh(path: &Path, mesh: &ravec::mesh::TriMesh) {
    let (positions, triangles) = (mesh.positions(), mesh.triangles());
    let mut lines = vec![
        "OFF".to_owned(),
        format!("{} {} 0", positions.len(), triangles.len()),
    ];
    let positions = positions.iter();
    lines.extend(positions.map(|at| format!("{} {} {}", at.x, at.y, at.z)));
    let triangles = triangles.iter();
    lines.extend(triangles.map(|[a, b, c]| format!("3 {a} {b} {c}")));
    let text = lines.join("\n");
    std::fs::write(path, text).unwrap();
}

/// A studio with a photo open.
fn studio(folder: &Path, autosave: Option<&Path>) -> Harness<'static, Studio> {
    let photo = photo(folder);
    let autosave = autosave.map(Path::to_path_buf);
    let mut harness = Harness::builder()
        .with_size(Vec2::new(1200.0, 800.0))
        .build_eframe(move |context| {
            let mut studio = Studio::new(&context.egui_ctx, autosave.as_deref());
            studio.open(&photo);
            studio
        });
    settle(&mut harness);
    harness
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

fn drag(harness: &mut Harness<'_, Studio>, points: &[Pos2]) {
    harness.hover_at(points[0]);
    harness.step();
    harness.drag_at(points[0]);
    harness.step();
    for &point in &points[1..] {
        harness.hover_at(point);
        harness.step();
    }
    harness.drop_at(points[points.len() - 1]);
    settle(harness);
}

/// The screen position of a point of a picture that is fit into the canvas.
fn on_screen(harness: &Harness<'_, Studio>, x: f32, y: f32) -> Pos2 {
    let area = harness.get_by_label("Canvas").rect();
    let size = size(harness);
    let size = Vec2::new(size[0] as f32, size[1] as f32);
    let zoom = (area.size() / size).min_elem() * 0.96;
    area.center() + zoom * (Vec2::new(x, y) - 0.5 * size)
}

fn size(harness: &Harness<'_, Studio>) -> [usize; 2] {
    harness
        .state()
        .snapshot()
        .unwrap()
        .shown()
        .unwrap()
        .clone()
        .size()
}

#[test]
fn a_picture_is_opened_and_shown() {
    let folder = tempfile::tempdir().unwrap();
    let harness = studio(folder.path(), None);
    assert_eq!(size(&harness), [160, 120]);
    assert!(harness.state().document().unwrap().edits.is_empty());
}

#[test]
fn a_side_that_is_dragged_retargets_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    click(&mut harness, "Retarget");
    let (from, to) = (
        on_screen(&harness, 160.0, 60.0),
        on_screen(&harness, 100.0, 60.0),
    );
    drag(&mut harness, &[from, from.lerp(to, 0.4), to]);
    let [width, height] = size(&harness);
    assert!(
        width.abs_diff(100) <= 1 && height == 120,
        "{width} x {height}"
    );
    // one gesture is one step
    click(&mut harness, "Undo");
    assert_eq!(size(&harness), [160, 120]);
    click(&mut harness, "Redo");
    assert_eq!(size(&harness)[0], width);
}

#[test]
fn strokes_stay_editable() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    let before = harness.state().snapshot().unwrap().shown().unwrap().clone();
    click(&mut harness, "Brush");
    let way = [(50.0, 45.0), (60.0, 50.0), (70.0, 55.0)].map(|(x, y)| on_screen(&harness, x, y));
    drag(&mut harness, &way);
    let document = harness.state().document().unwrap().clone();
    let strokes = document.edits[0].fields["strokes"]["strokes"]
        .as_array()
        .unwrap();
    assert_eq!(strokes.len(), 1);
    let points = strokes[0]["points"].as_array().unwrap();
    assert!(points.len() >= 3, "{points:?}");
    let after = harness.state().snapshot().unwrap().shown().unwrap().clone();
    let place = 50 * 160 + 60;
    assert_ne!(before.pixels()[place], after.pixels()[place]);
    // the keys change the radius, and with it nothing that is painted
    harness.hover_at(way[0]);
    harness.key_press(Key::CloseBracket);
    settle(&mut harness);
    let radius = harness.state().document().unwrap().edits[0]
        .param("radius")
        .as_f64()
        .unwrap();
    assert!(radius > 32.0);
    click(&mut harness, "Remove Brush");
    let cleared = harness.state().snapshot().unwrap().shown().unwrap().clone();
    assert_eq!(before.pixels()[place], cleared.pixels()[place]);
}

#[test]
fn an_edit_that_is_switched_off_has_no_effect() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    let before = harness.state().snapshot().unwrap().shown().unwrap().clone();
    click(&mut harness, "Two-color view");
    let drawn = harness.state().snapshot().unwrap().shown().unwrap().clone();
    assert_ne!(before.pixels(), drawn.pixels());
    click(&mut harness, "Use Two-color view");
    let off = harness.state().snapshot().unwrap().shown().unwrap().clone();
    assert_eq!(before.pixels(), off.pixels());
}

#[test]
fn an_export_has_the_bytes_that_the_saved_project_gives() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    click(&mut harness, "Filter");
    click(&mut harness, "Retarget");
    let (from, to) = (
        on_screen(&harness, 80.0, 120.0),
        on_screen(&harness, 80.0, 90.0),
    );
    drag(&mut harness, &[from, to]);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(&mut harness);
    click(&mut harness, "Save the project: Save");
    let project = folder.path().join("photo.ravec.json");
    assert!(project.exists(), "{:?}", harness.state().message());
    click(&mut harness, "Export…");
    click(&mut harness, "Export the picture: Export");
    let exported = folder.path().join("photo-edited.png");
    let studio =
        std::fs::read(&exported).unwrap_or_else(|_| panic!("{:?}", harness.state().message()));
    std::fs::remove_file(&exported).unwrap();
    let run = recipe::Run {
        file: project,
        params: recipe::Params::default(),
    };
    run.run(&Context::default()).unwrap();
    assert!(std::fs::read(&exported).unwrap() == studio);
}

#[test]
fn documents_survive_the_end_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let autosave = folder.path().join("autosave");
    let mut harness = studio(folder.path(), Some(&autosave));
    click(&mut harness, "Two-color view");
    let document = harness.state().document().unwrap().clone();
    // the file is written soon
    let start = Instant::now();
    let written = || {
        let runs = std::fs::read_dir(&autosave).unwrap().flatten();
        let files =
            runs.map(|run| std::fs::read_to_string(run.path().join("1.json")).unwrap_or_default());
        files.into_iter().any(|text| text.contains("twocolor"))
    };
    while !written() {
        assert!(start.elapsed() < HANG, "the document is not saved");
        std::thread::sleep(Duration::from_millis(5));
    }
    // without its end in good order
    drop(harness);
    let mut again =
        Harness::builder().build_eframe(|context| Studio::new(&context.egui_ctx, Some(&autosave)));
    settle(&mut again);
    assert_eq!(again.state().document().unwrap().edits, document.edits);
}

#[test]
fn what_is_no_picture_is_an_error_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    let broken = folder.path().join("broken.png");
    std::fs::write(&broken, b"\x89PNG no more").unwrap();
    harness.state_mut().open(&folder.path().join("none.png"));
    settle(&mut harness);
    let (message, wrong) = harness.state().message().unwrap();
    assert!(wrong && message.contains("none.png"), "{message}");
    harness.state_mut().open(&broken);
    settle(&mut harness);
    let failure = harness.state().snapshot().unwrap().failure.unwrap();
    assert!(
        failure.message.contains("broken.png"),
        "{}",
        failure.message
    );
}

#[test]
fn tools_are_found_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::P);
    settle(&mut harness);
    click(&mut harness, "Add Rectify");
    assert_eq!(
        harness.state().document().unwrap().edits[0].operation,
        "rectify"
    );
}

#[test]
fn settings_change_an_edit_and_go_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    click(&mut harness, "Retarget");
    click(&mut harness, "Adaptive");
    let adaptive = |harness: &Harness<'_, Studio>| {
        let document = harness.state().document().unwrap();
        document.edits[0].param("adaptive").clone()
    };
    assert_eq!(adaptive(&harness), true);
    click(&mut harness, "Reset Adaptive");
    assert!(adaptive(&harness).is_null());
    // a value that the operation finds by itself is set by hand
    click(&mut harness, "Set Grid");
    let document = harness.state().document().unwrap();
    assert_eq!(document.edits[0].param("grid"), 201);
}

#[test]
fn a_mesh_is_offset_checked_and_exported() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = ravec_scenes::solids::cuboid([1.0, 2.0, 3.0].into()).mesh;
    let path = folder.path().join("box.off");
    write_mesh(&path, &mesh);
    let mut harness = studio(folder.path(), None);
    harness.state_mut().open(&path);
    settle(&mut harness);
    click(&mut harness, "Offset");
    let snapshot = harness.state().snapshot().unwrap();
    assert_eq!(snapshot.failure, None);
    let result = snapshot.result.unwrap();
    assert!(result.content.mesh().unwrap().mesh.triangles().len() > 12);
    click(&mut harness, "List defects");
    assert!(harness.query_by_label("No defects").is_some());
    harness.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(&mut harness);
    click(&mut harness, "Save the project: Save");
    click(&mut harness, "Export…");
    click(&mut harness, "Export the picture: Export");
    let exported = folder.path().join("box-edited.ply");
    let studio =
        std::fs::read(&exported).unwrap_or_else(|_| panic!("{:?}", harness.state().message()));
    std::fs::remove_file(&exported).unwrap();
    let run = recipe::Run {
        file: folder.path().join("box.ravec.json"),
        params: recipe::Params::default(),
    };
    run.run(&Context::default()).unwrap();
    assert!(std::fs::read(&exported).unwrap() == studio);
}

#[test]
fn an_area_that_is_drawn_is_filled() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    let before = harness.state().snapshot().unwrap().shown().unwrap().clone();
    click(&mut harness, "Complete");
    let corners = [
        (35.0, 30.0),
        (85.0, 30.0),
        (85.0, 75.0),
        (35.0, 75.0),
        (35.0, 31.0),
    ];
    let way = corners.map(|(x, y)| on_screen(&harness, x, y));
    drag(&mut harness, &way);
    let document = harness.state().document().unwrap().clone();
    let polygons = document.edits[0]
        .param("polygons")
        .as_array()
        .unwrap()
        .len();
    assert_eq!(polygons, 1);
    click(&mut harness, "Fill");
    let snapshot = harness.state().snapshot().unwrap();
    assert_eq!(snapshot.failure, None);
    let after = snapshot.shown().unwrap();
    assert_ne!(before.pixel(60, 50), after.pixel(60, 50));
    assert_eq!(before.pixel(10, 10), after.pixel(10, 10));
}

#[test]
fn the_window_may_be_of_any_size() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    click(&mut harness, "Brush");
    for size in [[1.0, 1.0], [40.0, 900.0], [3000.0, 30.0], [1200.0, 800.0]] {
        harness.set_size(size.into());
        settle(&mut harness);
    }
    assert_eq!(size(&harness), [160, 120]);
}
