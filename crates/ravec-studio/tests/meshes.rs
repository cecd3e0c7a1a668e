//! Booleans of several meshes, driven by clicks and drags without a window.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

mod common;

use clap::Command;
use common::drag_through;
use egui::{Key, Modifiers, Pos2, Vec2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use glam::DVec3;
use ravec::mesh::{TriMesh, measure};
use ravec_jobs::mesh::boolean::Placement;
use ravec_jobs::{Context, Operation as _, Step, recipe};
use ravec_scenes::solids::cuboid;
use ravec_studio::{Edit, Studio};
use serde_json::json;
use std::path::Path;
use std::time::{Duration, Instant};

/// A bound on the time that background work may take, far beyond what it takes.
const HANG: Duration = Duration::from_mins(1);

fn write_mesh(path: &Path, mesh: &TriMesh) {
    let (positions, triangles) = (mesh.positions(), mesh.triangles());
    let mut lines = vec![
        "OFF".to_owned(),
        format!("{} {} 0", positions.len(), triangles.len()),
    ];
    let positions = positions.iter();
    lines.extend(positions.map(|at| format!("{} {} {}", at.x, at.y, at.z)));
    let triangles = triangles.iter();
    lines.extend(triangles.map(|[a, b, c]| format!("3 {a} {b} {c}")));
    std::fs::write(path, lines.join("\n")).unwrap();
}

type Window = Harness<'static, Studio>;

/// A studio with a block from −2 to 2 open, beside which is the file of a pin of 1 × 1 × 8 along z.
fn studio(folder: &Path) -> Window {
    std::fs::create_dir(folder.join("parts")).unwrap();
    write_mesh(&folder.join("block.off"), &cuboid(DVec3::splat(4.0)).mesh);
    let pin = cuboid(DVec3::new(1.0, 1.0, 8.0)).mesh;
    write_mesh(&folder.join("parts/pin.off"), &pin);
    let block = folder.join("block.off");
    let mut harness = Harness::builder()
        .with_size(Vec2::new(1200.0, 1000.0))
        .build_eframe(move |context| {
            let mut studio = Studio::new(&context.egui_ctx, None);
            studio.open(&block);
            studio
        });
    settle(&mut harness);
    harness
}

/// Lets the studio run until nothing is going on.
fn settle(harness: &mut Window) {
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

/// Lets the studio run until the result is there while the button is down: no fine picture is drawn before it is released.
fn settle_held(harness: &mut Window) {
    let start = Instant::now();
    let mut quiet = 0;
    while quiet < 4 {
        harness.step();
        let snapshot = harness.state().snapshot().unwrap();
        if snapshot.is_stale || snapshot.busy.is_some() {
            quiet = 0;
            std::thread::sleep(Duration::from_millis(5));
        } else {
            quiet += 1;
        }
        assert!(start.elapsed() < HANG, "the result never comes");
    }
}

fn click(harness: &mut Window, label: &str) {
    harness.get_by_label(label).click();
    settle(harness);
}

/// Replaces the text of a field.
fn enter(harness: &mut Window, label: &str, text: &str) {
    harness.get_by_label(label).focus();
    harness.step();
    harness.step();
    harness.key_press_modifiers(Modifiers::COMMAND, Key::A);
    harness.step();
    harness.get_by_label(label).type_text(text);
    harness.step();
    harness.key_press(Key::Enter);
    settle(harness);
}

fn add(harness: &mut Window, path: &Path) {
    click(harness, "Add a mesh…");
    harness
        .get_by_label("File")
        .type_text(path.to_str().unwrap());
    harness.step();
    click(harness, "Add a mesh: Add");
}

fn place(harness: &Window, label: &str) -> Pos2 {
    harness.get_by_label(label).rect().center()
}

fn drag(harness: &mut Window, from: Pos2, by: Vec2) {
    drag_through(harness, &[from, from + 0.5 * by, from + by]);
    harness.drop_at(from + by);
    settle(harness);
}

fn edit(harness: &Window) -> Edit {
    Edit::clone(harness.state().document().unwrap().edits.last().unwrap())
}

fn expression(harness: &Window) -> String {
    let edit = edit(harness);
    edit.fields["expression"].as_str().unwrap().to_owned()
}

/// The places of the parts that are not where their files say.
fn places(harness: &Window) -> Vec<Placement> {
    let edit = edit(harness);
    let places = edit.param("places").as_array();
    let texts = places.into_iter().flatten();
    texts
        .map(|text| text.as_str().unwrap().parse().unwrap())
        .collect()
}

fn volume(harness: &Window) -> f64 {
    let snapshot = harness.state().snapshot().unwrap();
    assert_eq!(snapshot.failure, None);
    let result = snapshot.result.unwrap();
    measure(&result.content.mesh().unwrap().mesh).volume
}

/// Saves the project and exports; the exported bytes are those of `ravec run` and of the command line.
fn assert_export_is_that_of_the_command_line(harness: &mut Window, folder: &Path) {
    harness.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(harness);
    click(harness, "Save the project: Save");
    click(harness, "Export…");
    click(harness, "Export the result: Export");
    let exported = folder.join("block-edited.ply");
    let studio =
        std::fs::read(&exported).unwrap_or_else(|_| panic!("{:?}", harness.state().message()));
    std::fs::remove_file(&exported).unwrap();
    let run = recipe::Run {
        file: folder.join("block.ravec.json"),
        params: recipe::Params::default(),
    };
    run.run(&Context::default()).unwrap();
    assert!(std::fs::read(&exported).unwrap() == studio);
    // what one would type
    let output = folder.join("typed.ply");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let mut words = vec![
        "ravec".to_owned(),
        "boolean".to_owned(),
        expression(harness),
    ];
    words.push(path("block.off"));
    words.push(path("parts/pin.off"));
    words.extend(["-o".to_owned(), path("typed.ply")]);
    for place in places(harness) {
        words.extend(["--place".to_owned(), place.to_string()]);
    }
    let command = Step::augment(Command::new("ravec"), Command::new);
    let matches = command.try_get_matches_from(words).unwrap();
    let step = Step::from_matches(&matches).unwrap().unwrap();
    step.operation().run(&Context::default()).unwrap();
    assert!(std::fs::read(output).unwrap() == studio);
}

#[test]
fn a_part_is_added_moved_and_turned_by_hand_and_exported() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    click(&mut harness, "Boolean");
    assert!((volume(&harness) - 64.0).abs() < 1e-9);
    add(&mut harness, &folder.path().join("parts/pin.off"));
    assert_eq!(expression(&harness), "a | b");
    assert!((volume(&harness) - 68.0).abs() < 1e-9);
    click(&mut harness, "Difference");
    assert_eq!(expression(&harness), "a - b");
    assert!((volume(&harness) - 60.0).abs() < 1e-9);
    // the arrow along x: nothing else moves
    let from = place(&harness, "Move b along x");
    let along = from - place(&harness, "Part b");
    drag(&mut harness, from, 60.0 * along.normalized());
    let moved = places(&harness);
    let [x, y, z] = moved[0].shift;
    assert!(x > 0.1 && y == 0.0 && z == 0.0, "{moved:?}");
    assert_eq!((moved.len(), moved[0].turn_deg), (1, [0.0; 3]));
    // the ring about y
    let from = place(&harness, "Turn b about y");
    let spoke = from - place(&harness, "Part b");
    drag(&mut harness, from, 40.0 * spoke.normalized().rot90());
    let turned = places(&harness);
    assert_eq!(turned[0].shift, moved[0].shift);
    let [x, y, z] = turned[0].turn_deg;
    assert!(x == 0.0 && y.abs() > 5.0 && z == 0.0, "{turned:?}");
    assert!(volume(&harness) < 64.0);
    assert_export_is_that_of_the_command_line(&mut harness, folder.path());
    // each drag is one step
    click(&mut harness, "Undo");
    assert_eq!(places(&harness), moved);
    click(&mut harness, "Undo");
    assert_eq!(places(&harness), []);
    assert!((volume(&harness) - 60.0).abs() < 1e-9);
    click(&mut harness, "Redo");
    assert_eq!(places(&harness), moved);
}

#[test]
fn the_part_follows_while_the_hand_moves() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    click(&mut harness, "Boolean");
    add(&mut harness, &folder.path().join("parts/pin.off"));
    let (from, center) = (place(&harness, "Move b along z"), place(&harness, "Part b"));
    let up = (from - center).normalized();
    drag_through(&mut harness, &[from, from + 30.0 * up, from + 60.0 * up]);
    settle_held(&mut harness);
    // the handle is below the hand, and the result that of this moment
    let tip = place(&harness, "Move b along z");
    let hand = from + 60.0 * up;
    // but for the perspective: the handle has one size on the screen, the way of the hand has not
    assert!(tip.distance(hand) < 4.0, "{tip} {hand}");
    let z = places(&harness)[0].shift[2];
    assert!(z > 0.5, "{z}");
    let inside = (4.0 - z).max(0.0) + 2.0;
    let expected = 64.0 + 8.0 - inside.min(4.0);
    assert!((volume(&harness) - expected).abs() < 1e-9);
    harness.hover_at(from);
    harness.step();
    harness.drop_at(from);
    settle(&mut harness);
    assert_eq!(places(&harness), []);
}

#[test]
fn numbers_move_and_turn_a_part() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    click(&mut harness, "Boolean");
    add(&mut harness, &folder.path().join("parts/pin.off"));
    // along x at the height of the upper face: half of its width is in the block
    enter(&mut harness, "Turn y", "90");
    enter(&mut harness, "Move z", "2");
    assert_eq!(edit(&harness).param("places"), &json!(["b:0,0,2,0,90,0"]));
    assert!((volume(&harness) - 70.0).abs() < 1e-9);
    enter(&mut harness, "Scale", "2");
    assert_eq!(edit(&harness).param("places"), &json!(["b:0,0,2,0,90,0,2"]));
    // 2 × 2 × 16, of which 4 × 2 × 1 is in the block
    assert!((volume(&harness) - 120.0).abs() < 1e-9);
    assert_export_is_that_of_the_command_line(&mut harness, folder.path());
    click(&mut harness, "Back to its place in the file");
    assert!((volume(&harness) - 68.0).abs() < 1e-9);
    click(&mut harness, "a: this mesh");
    enter(&mut harness, "Move x", "-2.25");
    assert_eq!(edit(&harness).param("places"), &json!(["a:-2.25,0,0"]));
    // a quarter of the pin is still in the block
    assert!((volume(&harness) - 71.0).abs() < 1e-9);
}

#[test]
fn expressions_are_typed_and_wrong_ones_are_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    click(&mut harness, "Boolean");
    add(&mut harness, &folder.path().join("parts/pin.off"));
    add(&mut harness, &folder.path().join("block.off"));
    assert_eq!(expression(&harness), "a | b | c");
    enter(&mut harness, "Expression", "b - (a & c)");
    assert_eq!(expression(&harness), "b - (a & c)");
    assert!((volume(&harness) - 4.0).abs() < 1e-9);
    enter(&mut harness, "Expression", "b - part");
    let failure = harness.state().snapshot().unwrap().failure.unwrap();
    assert!(
        failure.message.contains("no mesh named `part`"),
        "{failure:?}"
    );
    assert!(harness.query_by_label(&failure.message).is_some());
    click(&mut harness, "Undo");
    assert!((volume(&harness) - 4.0).abs() < 1e-9);
    click(&mut harness, "Symmetric difference");
    assert_eq!(expression(&harness), "a ^ b ^ c");
    // the blocks are one and the same
    assert!((volume(&harness) - 8.0).abs() < 1e-9);
    click(&mut harness, "Remove part c");
    assert_eq!(expression(&harness), "a ^ b");
    assert!((volume(&harness) - 64.0).abs() < 1e-9);
    add(&mut harness, &folder.path().join("parts/none.off"));
    let failure = harness.state().snapshot().unwrap().failure.unwrap();
    assert!(failure.message.contains("none.off"), "{failure:?}");
    // the last good result stays
    let snapshot = harness.state().snapshot().unwrap();
    let shown = snapshot.result.unwrap();
    assert!((measure(&shown.content.mesh().unwrap().mesh).volume - 64.0).abs() < 1e-9);
}

#[test]
fn a_click_selects_the_part_below_it_and_a_drag_beside_handles_turns_the_view() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = studio(folder.path());
    click(&mut harness, "Boolean");
    add(&mut harness, &folder.path().join("parts/pin.off"));
    enter(&mut harness, "Move x", "12");
    assert!(harness.query_by_label("Move b along x").is_some());
    let at = place(&harness, "Part a");
    harness.hover_at(at);
    harness.step();
    harness.drag_at(at);
    harness.step();
    harness.drop_at(at);
    settle(&mut harness);
    assert!(harness.query_by_label("Move b along x").is_none());
    let tip = place(&harness, "Move a along z");
    let b = place(&harness, "Part b");
    // not on a handle: the view turns, and the edit stays
    let corner = harness.get_by_label("Mesh canvas").rect().left_top() + vec2(30.0, 30.0);
    let before = edit(&harness);
    drag(&mut harness, corner, vec2(80.0, 10.0));
    assert_eq!(edit(&harness), before);
    assert!(place(&harness, "Part b").distance(b) > 5.0);
    assert_ne!(place(&harness, "Move a along z"), tip);
    // on a handle: the edit changes, and the view stays
    let b = place(&harness, "Part b");
    let from = place(&harness, "Turn a about z");
    let spoke = from - place(&harness, "Part a");
    drag_through(
        &mut harness,
        &[from, from + 30.0 * spoke.normalized().rot90()],
    );
    settle_held(&mut harness);
    assert_eq!(place(&harness, "Part b"), b);
    assert_eq!(places(&harness)[1].name, "a");
    harness.drop_at(from);
    settle(&mut harness);
}
