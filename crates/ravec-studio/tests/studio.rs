//! The studio, driven by clicks, drags and keys without a window.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

mod common;
#[path = "common/desk.rs"]
mod desk;

use desk::{HANG, click, drag, on_screen, settle, size};
use egui::{Key, Modifiers, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use ravec::raster::{AnyImage, Image, Size, Srgb};
use ravec_jobs::{Context, Operation as _, recipe};
use ravec_media::{Picture, WriteOptions};
use ravec_studio::Studio;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

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
    click(&mut harness, "Export the result: Export");
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
    click(&mut harness, "Export the result: Export");
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

/// Saves the project and exports; the exported bytes are those of `ravec run`.
fn assert_export_is_that_of_run(harness: &mut Harness<'_, Studio>, folder: &Path) {
    harness.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(harness);
    click(harness, "Save the project: Save");
    click(harness, "Export…");
    click(harness, "Export the result: Export");
    let exported = folder.join("photo-edited.png");
    let studio =
        std::fs::read(&exported).unwrap_or_else(|_| panic!("{:?}", harness.state().message()));
    let snapshot = harness.state().snapshot().unwrap();
    let shown = snapshot.result.unwrap();
    let written = ravec_media::read(&exported, &ravec_media::Limits::default()).unwrap();
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
fn painted_strokes_are_exported_as_they_are_shown() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    click(&mut harness, "Brush");
    for way in [
        [(30.0, 45.0), (60.0, 50.0), (100.0, 55.0)],
        [(90.0, 100.0), (60.0, 60.0), (30.0, 20.0)],
    ] {
        let way = way.map(|(x, y)| on_screen(&harness, x, y));
        drag(&mut harness, &way);
    }
    let strokes = &harness.state().document().unwrap().edits[0].fields["strokes"];
    assert_eq!(strokes["strokes"].as_array().unwrap().len(), 2);
    // a stroke in two motions is undone at once
    click(&mut harness, "Undo");
    let strokes = &harness.state().document().unwrap().edits[0].fields["strokes"];
    assert_eq!(strokes["strokes"].as_array().unwrap().len(), 1);
    click(&mut harness, "Redo");
    assert_export_is_that_of_run(&mut harness, folder.path());
}

#[test]
fn the_left_side_is_dragged_and_an_area_is_protected() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    click(&mut harness, "Retarget");
    click(&mut harness, "Protect areas");
    let area = [(35.0, 25.0), (85.0, 25.0), (85.0, 78.0), (35.0, 78.0)];
    let area = area.map(|(x, y)| on_screen(&harness, x, y));
    drag(&mut harness, &area);
    click(&mut harness, "Drag the frame");
    let (from, to) = (
        on_screen(&harness, 0.0, 60.0),
        on_screen(&harness, 50.0, 60.0),
    );
    drag(&mut harness, &[from, from.lerp(to, 0.5), to]);
    let edit = harness.state().document().unwrap().edits[0].clone();
    assert_eq!(edit.param("protect_polygons").as_array().unwrap().len(), 1);
    assert!(size(&harness)[0].abs_diff(110) <= 1, "{:?}", size(&harness));
    click(&mut harness, "Export also as 1:1");
    click(&mut harness, "Export also as 9:16");
    assert_export_is_that_of_run(&mut harness, folder.path());
    // further formats in files of their own
    for (name, size) in [("120x120", [120, 120]), ("68x120", [68, 120])] {
        let path = folder.path().join(format!("photo-edited-{name}.png"));
        let picture = ravec_media::read(&path, &ravec_media::Limits::default()).unwrap();
        let found = picture.image.size();
        assert_eq!([found.width(), found.height()], size);
    }
}

#[test]
fn the_drawing_of_two_color_pixels_is_written_by_exports_only() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    click(&mut harness, "Two-color view");
    click(&mut harness, "Show lines");
    click(&mut harness, "Export the drawing also (.svg)");
    let drawing = folder.path().join("photo.svg");
    assert!(!drawing.exists());
    assert_export_is_that_of_run(&mut harness, folder.path());
    assert!(std::fs::read_to_string(drawing).unwrap().contains("<svg"));
}

#[test]
fn corners_of_a_plane_are_dragged() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    click(&mut harness, "Rectify");
    // a rectangle as a camera may see it
    for (from, to) in [
        ((120.0, 30.0), (110.0, 38.0)),
        ((120.0, 90.0), (112.0, 88.0)),
        ((40.0, 90.0), (36.0, 95.0)),
    ] {
        let [from, to] = [from, to].map(|(x, y)| on_screen(&harness, x, y));
        drag(&mut harness, &[from, from.lerp(to, 0.5), to]);
    }
    let edit = harness.state().document().unwrap().edits[0].clone();
    let quad = edit.param("quad").as_str().unwrap().split(',');
    let expected = [40.0, 30.0, 110.0, 38.0, 112.0, 88.0, 36.0, 95.0];
    for (found, expected) in quad.zip(expected) {
        let found: f64 = found.parse().unwrap();
        assert!((found - expected).abs() < 0.5, "{found} {expected}");
    }
    click(&mut harness, "Show the rectified picture on the canvas");
    assert_export_is_that_of_run(&mut harness, folder.path());
}

#[test]
fn fragments_are_set_by_clicks() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    click(&mut harness, "Complete");
    let area = [(50.0, 80.0), (70.0, 80.0), (70.0, 100.0), (50.0, 100.0)];
    let area = area.map(|(x, y)| on_screen(&harness, x, y));
    drag(&mut harness, &area);
    click(&mut harness, "Fragments");
    let at = on_screen(&harness, 60.0, 90.0);
    harness.hover_at(at);
    settle(&mut harness);
    harness.drag_at(at);
    harness.step();
    harness.drop_at(at);
    settle(&mut harness);
    let edit = harness.state().document().unwrap().edits[0].clone();
    let steps = edit.fields["recorded"]["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 1);
    assert_export_is_that_of_run(&mut harness, folder.path());
}

#[test]
fn documents_that_are_not_saved_come_back_after_quitting_and_closing() {
    use eframe::App as _;
    let folder = tempfile::tempdir().unwrap();
    let autosave = folder.path().join("autosave");
    let mut harness = studio(folder.path(), Some(&autosave));
    click(&mut harness, "Filter");
    let document = harness.state().document().unwrap().clone();
    click(&mut harness, "Retarget");
    harness.key_press_modifiers(Modifiers::COMMAND, Key::W);
    settle(&mut harness);
    assert_eq!(harness.state().documents(), 0);
    harness.key_press_modifiers(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::T);
    settle(&mut harness);
    assert_eq!(harness.state().document().unwrap().edits.len(), 2);
    click(&mut harness, "Remove Retarget");
    harness.state_mut().on_exit();
    drop(harness);
    let start = |autosave: &Path| {
        let autosave = autosave.to_path_buf();
        let mut again = Harness::builder()
            .build_eframe(move |context| Studio::new(&context.egui_ctx, Some(&autosave)));
        settle(&mut again);
        again
    };
    let mut again = start(&autosave);
    assert_eq!(again.state().document().unwrap().edits, document.edits);
    // once it is saved, quitting forgets it
    again.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(&mut again);
    click(&mut again, "Save the project: Save");
    again.state_mut().on_exit();
    drop(again);
    assert_eq!(start(&autosave).state().documents(), 0);
}

#[test]
fn files_of_all_kinds_are_opened_or_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path(), None);
    let size = Size::new(1, 1).unwrap();
    let pixel = folder.path().join("pixel.png");
    let picture = Picture::from_image(AnyImage::from(Image::new(size, Srgb([9u8, 8, 7]))));
    ravec_media::write(&pixel, &picture, &WriteOptions::default()).unwrap();
    harness.state_mut().open(&pixel);
    settle(&mut harness);
    assert_eq!(harness.state().snapshot().unwrap().size(), Some([1, 1]));
    for tool in [
        "Two-color view",
        "Brush",
        "Filter",
        "Retarget",
        "Rectify",
        "Complete",
    ] {
        click(&mut harness, tool);
    }
    for (name, content) in [
        ("empty.png", &b""[..]),
        ("empty.ply", b""),
        ("empty.mp4", b""),
        ("empty.json", b""),
        ("nan.off", b"OFF\n3 1 0\n0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n"),
        ("text.png", b"no picture"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let before = harness.state().documents();
        harness.state_mut().open(&path);
        settle(&mut harness);
        let message = if harness.state().documents() == before {
            harness.state().message().unwrap().0.to_owned()
        } else if let Some(failure) = harness.state().snapshot().unwrap().failure {
            failure.message
        } else {
            message_of_timeline(&harness)
        };
        assert!(message.contains(name), "{name}: {message}");
    }
}

/// The message of the timeline of a clip that cannot be opened.
fn message_of_timeline(harness: &Harness<'_, Studio>) -> String {
    let labels = harness.query_all_by_label_contains("empty.mp4");
    let texts: Vec<String> = labels.filter_map(|node| node.value()).collect();
    // beside the name of the document
    texts
        .into_iter()
        .max_by_key(String::len)
        .unwrap_or_default()
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
