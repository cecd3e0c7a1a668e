//! Scripts of gestures, played without a window.

use ravec_studio::measure::{Script, Stage, measure};
use std::path::Path;

fn scripts() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/scripts"))
}

#[test]
fn a_stroke_that_is_played_has_figures() {
    let script = Script::load(&scripts().join("tiny.json")).unwrap();
    let found = measure(&script, scripts(), Stage::Nowhere).unwrap();
    assert_eq!(found.size, [96, 64]);
    let names: Vec<_> = found.gestures.iter().map(|one| one.name.as_str()).collect();
    assert_eq!(names, ["stroke", "undo", "zoom"]);
    let stroke = &found.gestures[0];
    // a motion to the start, the press, 12 motions, the release
    assert_eq!(stroke.events, 15);
    assert_eq!(stroke.without_picture, 0, "{stroke:?}");
    assert!(stroke.shown >= 12, "{stroke:?}");
    let (median, longest) = (stroke.median_ms.unwrap(), stroke.maximum_ms.unwrap());
    assert!(0.0 < median && median <= longest, "{stroke:?}");
    assert!(stroke.frames >= 15 && stroke.longest_frame_ms > 0.0);
    for one in &found.gestures[1..] {
        assert!(one.shown > 0 && one.without_picture == 0, "{one:?}");
    }
    let text = found.to_string();
    assert!(
        text.contains("96 x 64") && text.contains("stroke"),
        "{text}"
    );
}

#[test]
fn the_picture_stays_while_its_size_changes() {
    let text = r#"{
        "version": 1,
        "open": {"scene": {"name": "portraits", "width": 300, "height": 200}},
        "steps": [
            {"do": "click", "control": "Retarget"},
            {"do": "drag", "points": [[1, 0.5], [0.6, 0.5]], "moves": 25, "rate_hz": 60, "measure": "side"}
        ]
    }"#;
    let script = Script::from_json(text).unwrap();
    let found = measure(&script, scripts(), Stage::Nowhere).unwrap();
    let side = &found.gestures[0];
    assert!(side.shown > 5, "{side:?}");
    assert_eq!(side.blank_frames, 0, "{side:?}");
}

#[test]
fn pictures_are_taken_in_a_window_only() {
    let text = r#"{
        "version": 1,
        "open": {"torus": {"triangles": 100}},
        "steps": [{"do": "picture", "name": "torus"}]
    }"#;
    let script = Script::from_json(text).unwrap();
    let refused = measure(&script, scripts(), Stage::Nowhere).unwrap_err();
    assert!(refused.contains("in a window"), "{refused}");
}

#[test]
fn a_control_that_is_not_there_is_an_error_in_words() {
    let text = r#"{
        "version": 1,
        "open": {"torus": {"triangles": 100}},
        "steps": [{"do": "click", "control": "Make coffee"}]
    }"#;
    let script = Script::from_json(text).unwrap();
    let refused = measure(&script, scripts(), Stage::Nowhere).unwrap_err();
    assert_eq!(refused, "step 1: there is no control \"Make coffee\"");
    let missing = r#"{"version": 1, "open": {"file": "none.png"}, "steps": []}"#;
    let script = Script::from_json(missing).unwrap();
    let refused = measure(&script, scripts(), Stage::Nowhere).unwrap_err();
    assert!(refused.contains("none.png"), "{refused}");
}

#[test]
fn the_scripts_that_come_with_the_program_are_read() {
    let files = std::fs::read_dir(scripts()).unwrap().flatten();
    let mut count = 0;
    for file in files {
        Script::load(&file.path()).unwrap_or_else(|reason| panic!("{reason}"));
        count += 1;
    }
    assert!(count >= 8, "{count}");
}
