//! Planes that are tracked by clicks and drags, without a window.

mod common;
#[path = "common/desk.rs"]
mod desk;

use desk::{click, drag, on_screen, settle};
use egui::{Key, Modifiers, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use ravec::planar::Homography;
use ravec::raster::{Image, Size, Srgb};
use ravec_jobs::{Context, Operation as _, recipe};
use ravec_scenes::Seed;
use ravec_scenes::clip::{Clip, ClipId, clip};
use ravec_studio::Studio;
use ravec_video::FrameSource as _;
use serde_json::Value;
use std::path::Path;

const FRAMES: usize = 9;

/// The frame in which the plane is drawn.
const REFERENCE: usize = 3;

/// Corners of a plane in that frame.
const PLANE: [[f32; 2]; 4] = [[80.0, 60.0], [240.0, 64.0], [236.0, 180.0], [84.0, 176.0]];

/// A wall that is filmed from the hand, open in a studio, and its truth.
fn wall(folder: &Path) -> (Clip, Harness<'static, Studio>) {
    let mut truth = clip(
        ClipId::HandheldWall,
        Size::new(320, 240).unwrap(),
        50,
        Seed(4),
    );
    truth.noise_sigma = 1.0;
    let shot = folder.join("shot");
    std::fs::create_dir(&shot).unwrap();
    for index in 0..FRAMES {
        let picture = ravec_media::Picture::from_image(truth.frame(index).stored());
        let path = shot.join(format!("f_{index:04}.png"));
        ravec_media::write(&path, &picture, &ravec_media::WriteOptions::default()).unwrap();
    }
    let mut harness = Harness::builder()
        .with_size(Vec2::new(1400.0, 900.0))
        .build_eframe(move |context| {
            let mut studio = Studio::new(&context.egui_ctx, None);
            studio.open(&shot);
            studio
        });
    settle(&mut harness);
    (truth, harness)
}

/// Moves the playhead by keys.
fn go_to(harness: &mut Harness<'_, Studio>, frame: usize) {
    harness.key_press(Key::Home);
    settle(harness);
    for _ in 0..frame {
        harness.key_press(Key::ArrowRight);
        settle(harness);
    }
}

fn place(harness: &Harness<'_, Studio>, [x, y]: [f32; 2]) -> Pos2 {
    on_screen(harness, x, y)
}

/// Draws the plane by four clicks.
fn draw_plane(harness: &mut Harness<'_, Studio>) {
    for corner in PLANE {
        let at = place(harness, corner);
        drag(harness, &[at]);
    }
}

/// Corners of the true plane in a frame.
fn truth_in(truth: &Clip, frame: usize) -> [[f64; 2]; 4] {
    let matrix = truth.frame_from_frame(frame, REFERENCE).unwrap();
    let map = Homography::from_matrix(matrix).unwrap();
    PLANE.map(|[x, y]| {
        let corner = map.apply([f64::from(x), f64::from(y)].into());
        [corner.x, corner.y]
    })
}

/// The corners of a frame in a file of a track, with the center of the first pixel at (0.5, 0.5).
fn written(track: &Path, frame: usize) -> [[f64; 2]; 4] {
    let file: Value = serde_json::from_slice(&std::fs::read(track).unwrap()).unwrap();
    let first = file["first"].as_u64().unwrap() as usize;
    let corners = &file["corners"][frame - first];
    let number = |k: usize| corners[k].as_f64().unwrap();
    std::array::from_fn(|k| [number(2 * k), number(2 * k + 1)])
}

fn largest_distance(a: &[[f64; 2]; 4], b: &[[f64; 2]; 4]) -> f64 {
    let pairs = a.iter().zip(b);
    pairs
        .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
        .fold(0.0, f64::max)
}

/// Saves the project, exports, and gives the bytes of the track; those of `ravec run` are the same.
fn exported(harness: &mut Harness<'_, Studio>, folder: &Path) -> Vec<u8> {
    harness.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(harness);
    if harness.query_by_label("Save the project: Save").is_some() {
        click(harness, "Save the project: Save");
    }
    click(harness, "Export…");
    let track = folder.join("shot-track.json");
    let studio =
        std::fs::read(&track).unwrap_or_else(|_| panic!("{:?}", harness.state().message()));
    std::fs::remove_file(&track).unwrap();
    let run = recipe::Run {
        file: folder.join("shot.ravec.json"),
        params: recipe::Params::default(),
    };
    run.run(&Context::default()).unwrap();
    assert!(std::fs::read(&track).unwrap() == studio);
    studio
}

#[test]
fn a_plane_is_drawn_tracked_corrected_and_exported() {
    let folder = tempfile::tempdir().unwrap();
    let (truth, mut harness) = wall(folder.path());
    click(&mut harness, "Track a plane");
    go_to(&mut harness, REFERENCE);
    draw_plane(&mut harness);
    // forward and backward from the frame in which it was drawn
    assert!(
        harness
            .query_by_label("9 tracked, 0 weak, 0 lost")
            .is_some()
    );
    assert!(harness.query_by_label("Stabilized plane").is_some());
    click(&mut harness, "Nuke (.nk)");
    let measured = exported(&mut harness, folder.path());
    let track = folder.path().join("shot-track.json");
    assert!(folder.path().join("shot-track.nk").exists());
    for frame in 0..FRAMES {
        let distance = largest_distance(&written(&track, frame), &truth_in(&truth, frame));
        assert!(distance < 0.5, "frame {frame}: {distance} px");
    }

    // a corner is dragged in another frame: there it stays, and the frames around it follow
    go_to(&mut harness, 6);
    let corners = truth_in(&truth, 6);
    let corner = corners[1].map(|value| value as f32);
    let target = [corner[0] + 4.0, corner[1] - 3.0];
    let way = [corner, [corner[0] + 2.0, corner[1]], target];
    let way = way.map(|at| place(&harness, at));
    drag(&mut harness, &way);
    assert!(harness.query_by_label("Corrected in frame 6").is_some());
    assert!(exported(&mut harness, folder.path()) != measured);
    let found = written(&track, 6)[1];
    let miss = (found[0] - f64::from(target[0])).hypot(found[1] - f64::from(target[1]));
    assert!(miss < 0.6, "the corner is {miss} px from the hand");
    assert!(largest_distance(&written(&track, 7), &truth_in(&truth, 7)) > 1.0);
    let still = largest_distance(&written(&track, REFERENCE), &truth_in(&truth, REFERENCE));
    assert!(still < 1e-2, "the reference moved by {still} px");

    // the correction goes, by hand or by undo, and the track is as it was measured
    click(&mut harness, "Remove the correction of frame 6");
    assert!(exported(&mut harness, folder.path()) == measured);
}

/// Types the name of a file into a field.
fn enter(harness: &mut Harness<'_, Studio>, label: &str, path: &Path) {
    harness.get_by_label(label).focus();
    harness.step();
    harness.step();
    harness
        .get_by_label(label)
        .type_text(&path.to_string_lossy());
    harness.step();
    harness.key_press(Key::Enter);
    settle(harness);
}

#[test]
fn strokes_and_a_photo_of_the_plane_are_given_in_the_panel() {
    let folder = tempfile::tempdir().unwrap();
    let (truth, mut harness) = wall(folder.path());
    // a stroke hides the lower part of the plane in one frame
    let strokes: Image<Srgb<u8>> = Image::from_fn(Size::new(320, 240).unwrap(), |_, row| {
        Srgb([if row > 150 { 255 } else { 128 }; 3])
    });
    std::fs::create_dir(folder.path().join("strokes")).unwrap();
    let photo = truth.frame(REFERENCE).stored();
    for (name, image) in [("strokes/s_0006.png", strokes), ("photo.png", photo)] {
        let picture = ravec_media::Picture::from_image(image);
        let path = folder.path().join(name);
        ravec_media::write(&path, &picture, &ravec_media::WriteOptions::default()).unwrap();
    }
    click(&mut harness, "Track a plane");
    go_to(&mut harness, REFERENCE);
    draw_plane(&mut harness);
    click(&mut harness, "Clip with the grid drawn on it (.mp4)");
    let grid = folder.path().join("shot-track-grid.mp4");
    let plain = exported(&mut harness, folder.path());
    let plain_grid = std::fs::read(&grid).unwrap();
    // the photo is drawn where the plane is shown, and changes no track
    enter(
        &mut harness,
        "Photo of the plane",
        &folder.path().join("photo.png"),
    );
    assert!(exported(&mut harness, folder.path()) == plain);
    assert!(std::fs::read(&grid).unwrap() != plain_grid);
    enter(&mut harness, "Strokes", &folder.path().join("strokes"));
    assert!(harness.query_by_label("Track again").is_none());
    assert!(exported(&mut harness, folder.path()) != plain);
    let track = folder.path().join("shot-track.json");
    assert!(largest_distance(&written(&track, 6), &truth_in(&truth, 6)) < 0.5);
}

#[test]
fn a_plane_that_nothing_is_seen_of_is_a_sentence_in_the_panel() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = wall(folder.path());
    click(&mut harness, "Track a plane");
    // corners in the wrong order
    for corner in [PLANE[0], PLANE[2], PLANE[1], PLANE[3]] {
        let at = place(&harness, corner);
        drag(&mut harness, &[at]);
    }
    assert!(harness.query_by_label("Track again").is_some());
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    settle(&mut harness);
    draw_plane(&mut harness);
    assert!(harness.query_by_label("Track again").is_none());
}

#[test]
fn a_range_of_the_timeline_is_what_is_exported() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = wall(folder.path());
    click(&mut harness, "Two-color view");
    click(&mut harness, "Trim and encode");
    go_to(&mut harness, 2);
    harness.key_press(Key::I);
    go_to(&mut harness, 5);
    harness.key_press(Key::O);
    settle(&mut harness);
    click(&mut harness, "Take the range of the timeline");
    let snapshot = harness.state().snapshot().unwrap();
    assert!(snapshot.failure.is_none(), "{:?}", snapshot.failure);
    click(&mut harness, "Export…");
    click(&mut harness, "Export the result: Export");
    let output = folder.path().join("shot-edited.mp4");
    let clip = ravec_video::Clip::open(&output, &ravec_video::OpenOptions::default()).unwrap();
    assert_eq!(
        clip.info().frames,
        Some(4),
        "{:?}",
        harness.state().message()
    );
}

#[test]
fn a_clip_with_several_edits_is_exported_as_it_is_run() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = wall(folder.path());
    click(&mut harness, "Filter");
    click(&mut harness, "Retarget");
    let (from, to) = ([320.0, 120.0], [240.0, 120.0]);
    let way = [from, to].map(|at| place(&harness, at));
    drag(&mut harness, &way);
    harness.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(&mut harness);
    click(&mut harness, "Save the project: Save");
    click(&mut harness, "Export…");
    click(&mut harness, "Export the result: Export");
    let output = folder.path().join("shot-edited.mp4");
    let studio =
        std::fs::read(&output).unwrap_or_else(|_| panic!("{:?}", harness.state().message()));
    std::fs::remove_file(&output).unwrap();
    let run = recipe::Run {
        file: folder.path().join("shot.ravec.json"),
        params: recipe::Params::default(),
    };
    run.run(&Context::default()).unwrap();
    assert!(std::fs::read(&output).unwrap() == studio);
}
