//! Plates, mattes and edits of a shot by clicks and drags, without a window.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

mod common;
#[path = "common/desk.rs"]
mod desk;

use desk::{click, drag, on_screen, settle};
use egui::accesskit::Role;
use egui::{Key, Modifiers, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use ravec::raster::{Image, Size, Srgb, Srgba};
use ravec_jobs::{Context, Operation as _, recipe};
use ravec_scenes::Seed;
use ravec_scenes::clip::{Clip, ClipId, clip};
use ravec_studio::{Content, Edit, Studio};
use ravec_video::FrameSource as _;
use std::path::Path;
use std::sync::Arc;

const FRAMES: usize = 12;

/// A ball that moves before a meadow, open in a studio, and its truth.
fn meadow(folder: &Path) -> (Clip, Harness<'static, Studio>) {
    let size = Size::new(160, 120).unwrap();
    let mut truth = clip(ClipId::StillDisc, size, FRAMES, Seed(4));
    truth.noise_sigma = 1.0;
    let shot = folder.join("shot");
    std::fs::create_dir(&shot).unwrap();
    for index in 0..FRAMES {
        let picture = ravec_media::Picture::from_image(truth.frame(index).stored());
        let path = shot.join(format!("f_{index:04}.png"));
        ravec_media::write(&path, &picture, &ravec_media::WriteOptions::default()).unwrap();
    }
    let mut harness = Harness::builder()
        .with_size(Vec2::new(1400.0, 1000.0))
        .build_eframe(move |context| {
            let mut studio = Studio::new(&context.egui_ctx, None);
            studio.open(&shot);
            studio
        });
    settle(&mut harness);
    (truth, harness)
}

fn go_to(harness: &mut Harness<'_, Studio>, frame: usize) {
    harness.key_press(Key::Home);
    settle(harness);
    for _ in 0..frame {
        harness.key_press(Key::ArrowRight);
        settle(harness);
    }
}

/// Selects an edit, whose name is that of its tool.
fn select(harness: &mut Harness<'_, Studio>, label: &str) {
    let buttons = harness.get_all_by_role_and_label(Role::Button, label);
    buttons.last().unwrap().click();
    settle(harness);
}

/// What the canvas shows.
fn shown(harness: &Harness<'_, Studio>) -> Image<Srgba<u8>> {
    let snapshot = harness.state().snapshot().unwrap();
    assert!(snapshot.failure.is_none(), "{:?}", snapshot.failure);
    let Content::Picture(picture) = snapshot.result.unwrap().content else {
        panic!("a frame is a picture");
    };
    picture.convert()
}

/// Largest difference to an image over the pixels that `looked_at` selects.
fn largest(
    found: &Image<Srgba<u8>>,
    truth: &Image<Srgb<u8>>,
    looked_at: impl Fn(usize, usize) -> bool,
) -> u8 {
    let mut largest = 0;
    for row in 0..truth.height() {
        for col in 0..truth.width() {
            if looked_at(col, row) {
                let pairs = found[(col, row)].0.into_iter().zip(truth[(col, row)].0);
                largest = pairs.fold(largest, |largest, (a, b)| largest.max(a.abs_diff(b)));
            }
        }
    }
    largest
}

/// Saves the project, exports, and asserts that `ravec run` writes the same bytes.
fn exported(harness: &mut Harness<'_, Studio>, folder: &Path) -> std::path::PathBuf {
    harness.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(harness);
    if harness.query_by_label("Save the project: Save").is_some() {
        click(harness, "Save the project: Save");
    }
    click(harness, "Export…");
    click(harness, "Export the result: Export");
    let output = folder.join("shot-edited.mp4");
    let studio =
        std::fs::read(&output).unwrap_or_else(|_| panic!("{:?}", harness.state().message()));
    std::fs::remove_file(&output).unwrap();
    let run = recipe::Run {
        file: folder.join("shot.ravec.json"),
        params: recipe::Params::default(),
    };
    run.run(&Context::default()).unwrap();
    assert!(std::fs::read(&output).unwrap() == studio);
    output
}

#[test]
fn a_ball_is_removed_by_one_click_and_exported_as_it_is_run() {
    let folder = tempfile::tempdir().unwrap();
    let (truth, mut harness) = meadow(folder.path());
    click(&mut harness, "Remove the foreground");
    // plate and matte have come along
    let document = harness.state().document().unwrap();
    let operations: Vec<_> = (document.edits.iter())
        .map(|edit| edit.operation.clone())
        .collect();
    assert_eq!(operations, ["plate", "matte", "video remove"]);
    for index in [0, 5, 9] {
        go_to(&mut harness, index);
        let frame = truth.frame(index);
        assert!(frame.alpha.pixels().iter().any(|alpha| *alpha > 0.9));
        let plate: Image<Srgb<u8>> = frame.plate.convert();
        let wrong = largest(&shown(&harness), &plate, |_, _| true);
        assert!(wrong < 25, "{wrong} in frame {index}");
    }
    let output = exported(&mut harness, folder.path());
    let clip = ravec_video::Clip::open(&output, &ravec_video::OpenOptions::default()).unwrap();
    assert_eq!(clip.info().frames, Some(FRAMES as u64));
}

#[test]
fn a_stroke_answers_on_its_frame_and_holds_in_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let (truth, mut harness) = meadow(folder.path());
    click(&mut harness, "Remove the foreground");
    select(&mut harness, "Matte");
    go_to(&mut harness, 4);
    // background over the whole ball: it is not removed any more
    click(&mut harness, "Mark background");
    let alpha = truth.frame(4).alpha;
    let inside = |col: usize, row: usize| alpha[(col, row)] > 0.5;
    let cells = (0..120).flat_map(|row| (0..160).map(move |col| (col, row)));
    let ball: Vec<_> = cells.filter(|&(col, row)| inside(col, row)).collect();
    let center = |k: fn(&(usize, usize)) -> usize| {
        ball.iter().map(k).sum::<usize>() as f32 / ball.len() as f32
    };
    let center = [center(|cell| cell.0), center(|cell| cell.1)];
    for _ in 0..12 {
        harness.key_press(Key::CloseBracket);
        harness.step();
    }
    let way =
        [[-2.0, 0.0], [2.0, 0.0]].map(|[x, y]| on_screen(&harness, center[0] + x, center[1] + y));
    drag(&mut harness, &way);
    assert!(harness.query_by_label("Stroke 1 in frame 4").is_some());
    select(&mut harness, "Remove the foreground");
    let stored = truth.frame(4).stored();
    let wrong = largest(&shown(&harness), &stored, inside);
    assert!(wrong < 12, "{wrong}");
    // undo, and it is gone again
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    settle(&mut harness);
    let plate: Image<Srgb<u8>> = truth.frame(4).plate.convert();
    let wrong = largest(&shown(&harness), &plate, |_, _| true);
    assert!(wrong < 25, "{wrong}");
}

#[test]
fn the_foreground_alone_is_a_result_with_alpha() {
    let folder = tempfile::tempdir().unwrap();
    let (truth, mut harness) = meadow(folder.path());
    click(&mut harness, "Matte");
    click(&mut harness, "The result is the foreground");
    go_to(&mut harness, 3);
    let found = shown(&harness);
    let alpha = truth.frame(3).alpha;
    for row in 0..120 {
        for col in 0..160 {
            let expected = alpha[(col, row)];
            if expected <= 0.0 || expected >= 1.0 {
                let wrong = (f32::from(found[(col, row)].0[3]) / 255.0 - expected).abs();
                assert!(wrong < 0.3, "{col} {row}: {wrong}");
            }
        }
    }
}

/// The lossless frames that `ravec run` writes for the document that is open.
fn frames_of_the_recipe(harness: &Harness<'_, Studio>, folder: &Path) -> Vec<Image<Srgba<u8>>> {
    let output = folder.join("recipe_%03d.png");
    let recipe = harness.state().document().unwrap().recipe(&output).unwrap();
    let file = folder.join("recipe.json");
    std::fs::write(&file, recipe.to_json().unwrap()).unwrap();
    let params = recipe::Params::default();
    let run = recipe::Run { file, params };
    run.run(&Context::default()).unwrap();
    let clip = ravec_video::Clip::open(&output, &ravec_video::OpenOptions::default());
    let mut clip = clip.unwrap();
    let frames = std::iter::from_fn(|| clip.next_frame().unwrap());
    frames
        .map(|frame| frame.picture.into_image().convert())
        .collect()
}

/// Largest difference between two images.
fn difference(a: &Image<Srgba<u8>>, b: &Image<Srgba<u8>>) -> u8 {
    assert_eq!(a.size(), b.size());
    let pairs = a.pixels().iter().zip(b.pixels());
    pairs
        .flat_map(|(a, b)| a.0.into_iter().zip(b.0))
        .map(|(a, b)| a.abs_diff(b))
        .max()
        .unwrap()
}

#[test]
fn frames_of_a_retargeted_clip_are_those_of_the_export() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = meadow(folder.path());
    // an edit before it, whose results are what is retargeted
    click(&mut harness, "Remove the foreground");
    click(&mut harness, "Retarget");
    click(&mut harness, "4:5");
    assert!(
        harness
            .query_by_label("Frames are those of the exported clip")
            .is_some()
    );
    let truth = frames_of_the_recipe(&harness, folder.path());
    assert_eq!(truth.len(), FRAMES);
    for index in [0, 5, 11] {
        go_to(&mut harness, index);
        let wrong = difference(&shown(&harness), &truth[index]);
        assert!(wrong <= 1, "{wrong} in frame {index}");
    }
    // clips have no adaptive grid: the sentence stands in the panel, and frames are stills
    click(&mut harness, "Adaptive");
    assert!(
        harness
            .query_by_label_contains("left out for clips")
            .is_some()
    );
}

#[test]
fn frames_behind_another_range_size_and_rate_are_those_of_the_export() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = meadow(folder.path());
    let whole = shown(&harness).size();
    click(&mut harness, "Trim and encode");
    enter(&mut harness, "Frames", "2..11");
    enter(&mut harness, "Size", "75%");
    click(&mut harness, "Retarget");
    click(&mut harness, "4:5");
    for (rate, count, places) in [
        ("", 9, [(2, 0), (7, 5), (10, 8)]),
        ("12.5", 5, [(2, 0), (6, 2), (10, 4)]),
        ("50", 18, [(2, 0), (7, 10), (10, 16)]),
    ] {
        select(&mut harness, "Trim and encode");
        enter(&mut harness, "Rate", rate);
        select(&mut harness, "Retarget");
        assert!(
            harness
                .query_by_label("Frames are those of the exported clip")
                .is_some()
        );
        let output = folder.path().join(format!("at{rate}"));
        std::fs::create_dir(&output).unwrap();
        let truth = frames_of_the_recipe(&harness, &output);
        assert_eq!(truth.len(), count, "{rate} a second");
        for (frame, index) in places {
            go_to(&mut harness, frame);
            let wrong = difference(&shown(&harness), &truth[index]);
            assert!(wrong <= 1, "{rate} a second: {wrong} in frame {frame}");
        }
        // frames out of the range are not retargeted
        go_to(&mut harness, 0);
        let size = shown(&harness).size();
        assert_eq!(4 * size.width(), 3 * whole.width());
        assert_eq!(4 * size.height(), 3 * whole.height());
    }
}

#[test]
fn what_is_missing_is_said_in_the_panel() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = meadow(folder.path());
    click(&mut harness, "Replace the background");
    assert!(
        harness
            .query_by_label("Give the file: New background")
            .is_some()
    );
    // a plate without a file has nothing to export
    harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    settle(&mut harness);
    click(&mut harness, "Background plate");
    assert!(harness.query_by_label("The plate is there").is_some());
    click(&mut harness, "Export…");
    let (text, wrong) = harness.state().message().unwrap();
    assert!(wrong && text.contains("Nothing would be written"), "{text}");
}

#[test]
fn an_overlay_is_dragged_onto_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = meadow(folder.path());
    let logo = folder.path().join("logo.png");
    let picture: Image<Srgb<u8>> = Image::new(Size::new(20, 20).unwrap(), Srgb([250, 10, 240]));
    let picture = ravec_media::Picture::from_image(picture);
    ravec_media::write(&logo, &picture, &ravec_media::WriteOptions::default()).unwrap();
    click(&mut harness, "Overlay a picture");
    assert!(harness.query_by_label("Give the file: Picture").is_some());
    enter(&mut harness, "Picture", logo.to_str().unwrap());
    click(&mut harness, "Place by corners");
    // the lower right corner goes inward
    let way = [[120.0, 90.0], [110.0, 85.0], [95.0, 80.0]].map(|[x, y]| on_screen(&harness, x, y));
    drag(&mut harness, &way);
    let found = shown(&harness);
    assert_eq!(found[(50, 40)].0, [250, 10, 240, 255]);
    assert_ne!(found[(110, 80)].0, [250, 10, 240, 255]);
    // over the timeline it is a layer
    assert!(harness.query_all_by_label("Overlay a picture").count() >= 2);
    exported(&mut harness, folder.path());
}

/// Types into a field that takes the name of a file.
fn enter(harness: &mut Harness<'_, Studio>, label: &str, text: &str) {
    let field = harness.get_by_role_and_label(Role::TextInput, label);
    field.focus();
    harness.step();
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.key_press(Key::Backspace);
    harness.step();
    let field = harness.get_by_role_and_label(Role::TextInput, label);
    field.type_text(text);
    harness.step();
    harness.key_press(Key::Enter);
    settle(harness);
}

/// The last edit that pastes.
fn paste_of(harness: &Harness<'_, Studio>) -> Arc<Edit> {
    let mut edits = harness.state().document().unwrap().edits.iter();
    let found = edits.rfind(|edit| edit.operation == "video paste");
    found.unwrap().clone()
}

#[test]
fn a_pasted_foreground_is_dragged_by_its_corners_in_the_other_clip() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = meadow(folder.path());
    // another clip, of another size, whose plane goes to the right by 2 pixels a frame
    let scene = folder.path().join("scene");
    std::fs::create_dir(&scene).unwrap();
    let gray = [90, 90, 90];
    for index in 0..FRAMES {
        let image: Image<Srgb<u8>> = Image::new(Size::new(200, 150).unwrap(), Srgb(gray));
        let picture = ravec_media::Picture::from_image(image);
        let path = scene.join(format!("s_{index:04}.png"));
        ravec_media::write(&path, &picture, &ravec_media::WriteOptions::default()).unwrap();
    }
    let maps: Vec<[f64; 9]> = (0..FRAMES)
        .map(|index| [1.0, 0.0, 2.0 * index as f64, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        .collect();
    let track = folder.path().join("scene.json");
    let text = serde_json::json!({ "frame_from_reference": maps }).to_string();
    std::fs::write(&track, text).unwrap();

    click(&mut harness, "Paste into a clip");
    enter(&mut harness, "Into", scene.to_str().unwrap());
    enter(&mut harness, "Its track", track.to_str().unwrap());
    go_to(&mut harness, 5);
    click(&mut harness, "Place by corners");
    // the frame of 160 by 120 pixels lies 10 pixels to the right in frame 5; its corner comes inward, and its middle goes down
    let way = [[170.0, 120.0], [160.0, 115.0], [150.0, 100.0]];
    let way = way.map(|[x, y]| on_screen(&harness, x, y));
    drag(&mut harness, &way);
    let way = [[80.0, 60.0], [82.0, 70.0], [85.0, 80.0]].map(|[x, y]| on_screen(&harness, x, y));
    drag(&mut harness, &way);
    let edit = paste_of(&harness);
    let corners = edit.param("into_quad").as_str().unwrap().to_owned();
    let corners: Vec<f64> = corners.split(',').map(|x| x.parse().unwrap()).collect();
    let expected = [5.0, 20.0, 165.0, 20.0, 145.0, 120.0, 5.0, 140.0];
    for (found, expected) in corners.iter().zip(expected) {
        assert!((found - expected).abs() < 0.6, "{corners:?}");
    }
    // the ball lies on the gray scene
    let found = shown(&harness);
    assert_eq!((found.width(), found.height()), (200, 150));
    let pasted = found.pixels().iter().filter(|pixel| pixel.0[..3] != gray);
    assert!(pasted.count() > 100);
    exported(&mut harness, folder.path());
    // without corners it lies where it was in its own clip
    click(&mut harness, "Same place");
    let edit = paste_of(&harness);
    assert!(edit.param("into_quad").is_null() && edit.param("quad").is_null());
    shown(&harness);
}

#[test]
fn exports_wait_for_their_turn_in_the_queue() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = meadow(folder.path());
    click(&mut harness, "Filter");
    for _ in 0..2 {
        harness.get_by_label("Export…").click();
        harness.step();
        harness.step();
        harness.get_by_label("Export the result: Export").click();
        harness.step();
    }
    harness.get_by_label_contains("Render queue (").click();
    settle(&mut harness);
    let output = folder.path().join("shot-edited.mp4");
    assert!(output.exists());
    let again = format!("Again: {}", output.display());
    assert_eq!(harness.query_all_by_label(&again).count(), 2);
    let drop = format!("Drop: {}", output.display());
    harness.get_all_by_label(&drop).next().unwrap().click();
    settle(&mut harness);
    assert_eq!(harness.query_all_by_label(&again).count(), 1);
    std::fs::remove_file(&output).unwrap();
    click(&mut harness, &again);
    assert!(output.exists());
}

#[test]
fn a_stroke_right_after_the_tool() {
    let folder = tempfile::tempdir().unwrap();
    let (_, mut harness) = meadow(folder.path());
    click(&mut harness, "Matte");
    go_to(&mut harness, 4);
    let way = [[50.0, 40.0], [52.0, 45.0], [55.0, 60.0]].map(|[x, y]| on_screen(&harness, x, y));
    drag(&mut harness, &way);
    assert!(harness.query_by_label("Stroke 1 in frame 4").is_some());
}

#[test]
fn all_planes_of_a_track_are_on_the_plate_and_followed() {
    let folder = tempfile::tempdir().unwrap();
    let (truth, mut harness) = meadow(folder.path());
    // the meadow stands still; the other plane, of a camera that tilts, is wrong everywhere
    let maps = |speed: f64| -> Vec<[f64; 9]> {
        let map = |index| [1.0, 0.0, 0.0, 0.0, 1.0, speed * index as f64, 0.0, 0.0, 1.0];
        (0..FRAMES).map(map).collect()
    };
    let planes = [0.0, -4.0].map(|speed| serde_json::json!({"frame_from_reference": maps(speed)}));
    let track = folder.path().join("track.json");
    let text = serde_json::json!({ "planes": planes }).to_string();
    std::fs::write(&track, text).unwrap();

    click(&mut harness, "Background plate");
    assert!(harness.query_by_label("All planes of the track").is_none());
    enter(&mut harness, "Track", track.to_str().unwrap());
    click(&mut harness, "All planes of the track");
    assert!(harness.query_by_label("The plate is there").is_some());
    click(&mut harness, "Remove the foreground");
    let document = harness.state().document().unwrap();
    let named = |operation: &str| {
        let mut edits = document.edits.iter();
        let edit = edits.rfind(|edit| edit.operation == operation).unwrap();
        [edit.text_field("regions"), edit.text_field("track")].map(str::to_owned)
    };
    for operation in ["plate", "matte", "video remove"] {
        let expected = ["@regions", track.to_str().unwrap()];
        assert_eq!(named(operation), expected, "{operation}");
    }
    go_to(&mut harness, 6);
    let plate: Image<Srgb<u8>> = truth.frame(6).plate.convert();
    let wrong = largest(&shown(&harness), &plate, |_, _| true);
    assert!(wrong < 25, "{wrong}");
    exported(&mut harness, folder.path());
}
