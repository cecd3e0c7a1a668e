//! `ravec match`, `ravec rectify`, `ravec snap` and `ravec planes`.

use crate::pictures::bmp;
use crate::program::{
    assert_refused, assert_same_on_any_threads, code, done, ravec, report, stderr, stdout,
};
use serde_json::Value;
use std::path::Path;

/// Fields of 20 x 20 pixels, 5 x 4 of them from (30, 30) on, as `board.bmp`.
fn board() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let field = |col: usize, row: usize| {
        let inside = (30..130).contains(&col) && (30..110).contains(&row);
        let light = ((col + 70) / 20 + (row + 70) / 20).is_multiple_of(2);
        [if inside && light { 210 } else { 90 }; 3]
    };
    std::fs::write(folder.path().join("board.bmp"), bmp(160, 140, field)).unwrap();
    folder
}

/// The corner of a building as `building.png`, and what is known about it.
fn building(folder: &Path) -> Value {
    done(
        folder,
        "-q scenes --out . --scene building --width 960 --height 720 --seed 3",
    );
    let text = std::fs::read_to_string(folder.join("building.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

const ROUGH: &str = "27,32,133,28,131,113,28,107";

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn snap_prints_the_refined_corners_as_json() {
    let folder = board();
    let said = done(
        folder.path(),
        &format!("snap board.bmp --quad {ROUGH} --grid 5x4"),
    );
    let result: Value = serde_json::from_str(&said).unwrap();
    let truth = [[30.0, 30.0], [130.0, 30.0], [130.0, 110.0], [30.0, 110.0]];
    for (corner, truth) in result["quad"].as_array().unwrap().iter().zip(truth) {
        for k in 0..2 {
            assert!((number(&corner[k]) - truth[k]).abs() < 0.2, "{said}");
        }
    }
    // the same in the report, and quietly
    let arguments = format!("snap board.bmp --quad {ROUGH} --grid 5x4 -o drawn.png");
    let report = report(folder.path(), &arguments);
    assert_eq!(report["result"], result);
    assert_eq!(report["outputs"][0]["path"], "drawn.png");
    assert_eq!(report["parameters"]["grid"], "5x4");
    let quiet = done(folder.path(), &format!("-q snap board.bmp --quad {ROUGH}"));
    let counted: Value = serde_json::from_str(&quiet).unwrap();
    assert_eq!(
        (&counted["columns"], &counted["rows"]),
        (&5.into(), &4.into())
    );
    assert_same_on_any_threads(folder.path(), &arguments, "drawn.png");
}

#[test]
fn rectify_shows_the_rectangle_and_tells_the_map() {
    let folder = board();
    let arguments =
        "rectify board.bmp --quad 30,30,130,30,130,110,30,110 -o front.png --aspect 5:4 --width 50";
    let report = report(folder.path(), arguments);
    assert_eq!(
        (
            &report["outputs"][0]["width"],
            &report["outputs"][0]["height"]
        ),
        (&50.into(), &40.into())
    );
    let map = report["result"]["image_from_straight"].as_array().unwrap();
    for (found, truth) in map
        .iter()
        .zip([2.0, 0.0, 30.0, 0.0, 2.0, 30.0, 0.0, 0.0, 1.0])
    {
        assert!((number(found) - truth).abs() < 1e-9, "{report}");
    }
    assert_eq!(report["result"]["aspect_from"], "hand");
    assert_same_on_any_threads(folder.path(), arguments, "front.png");
    // seen from straight on, no focal length is needed
    let said = done(
        folder.path(),
        "rectify board.bmp --quad 30,30,130,30,130,110,30,110 -o whole.png --whole",
    );
    assert!(
        said.contains("aspect") && said.contains("whole.png (PNG, 160 x 140"),
        "{said}"
    );
}

#[test]
fn planes_and_what_follows_from_them_fit_a_building() {
    let folder = tempfile::tempdir().unwrap();
    let truth = building(folder.path());
    let said = done(folder.path(), "planes building.png -o drawn.png");
    let result: Value = serde_json::from_str(&said).unwrap();
    let planes = result["planes"].as_array().unwrap();
    assert!(planes.len() >= 2, "{said}");
    let focal = |value: &Value| {
        let text = value.to_string();
        let at = text
            .find("\"focal_px\":")
            .expect("the truth has a focal length")
            + 11;
        let digits: String = text[at..]
            .chars()
            .take_while(|c| !",}".contains(*c))
            .collect();
        digits.parse::<f64>().unwrap()
    };
    let focal = focal(&truth);
    assert!(
        (number(&result["focal_px"]) / focal - 1.0).abs() < 0.08,
        "{said} {focal}"
    );
    assert!(folder.path().join("drawn.png").is_file());
    // the best one from straight on: with the lens known its sides are at right angles
    let quad: Vec<String> = planes[0]["quad"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|corner| [corner[0].to_string(), corner[1].to_string()])
        .collect();
    let arguments = format!(
        "rectify building.png -o front.png --focal {focal}px --quad {}",
        quad.join(",")
    );
    let report = report(folder.path(), &arguments);
    let angle = number(&report["figures"]["angle_deg"]);
    assert!((angle - 90.0).abs() < 3.0, "{report}");
    assert_same_on_any_threads(
        folder.path(),
        "planes building.png -o again.png",
        "again.png",
    );
}

#[test]
fn match_writes_nine_numbers_and_refuses_what_does_not_match() {
    let folder = tempfile::tempdir().unwrap();
    done(
        folder.path(),
        "-q scenes --out . --scene still-life --width 640 --height 480",
    );
    done(
        folder.path(),
        "-q rectify still-life.png -o moved.png --quad 40,30,600,50,590,440,30,430 --aspect 1.4 --width 560",
    );
    let report = report(folder.path(), "match moved.png still-life.png -o h.txt");
    assert!(number(&report["figures"]["inliers"]) > 20.0);
    let text = std::fs::read_to_string(folder.path().join("h.txt")).unwrap();
    let h: Vec<f64> = text
        .split_whitespace()
        .map(|word| word.parse().unwrap())
        .collect();
    assert_eq!(h.len(), 9);
    // the upper left corner of the moved picture is the first corner of the quadrilateral
    assert!(
        (h[2] / h[8] - 40.0).abs() < 0.5 && (h[5] / h[8] - 30.0).abs() < 0.5,
        "{text}"
    );
    // an even picture matches nothing
    let even = bmp(90, 80, |_, _| [80; 3]);
    std::fs::write(folder.path().join("even.bmp"), even).unwrap();
    let output = ravec(
        folder.path(),
        &["match", "even.bmp", "still-life.png", "-o", "none.txt"],
    );
    assert_refused(&output, 1, &["even.bmp", "still-life.png"]);
    assert!(!folder.path().join("none.txt").exists());
}

#[test]
fn wrong_corners_are_refused_with_a_sentence() {
    let folder = board();
    let refused = |quad: &str, words: &[&str]| {
        for command in ["snap", "rectify"] {
            let output = ravec(
                folder.path(),
                &[command, "board.bmp", "--quad", quad, "-o", "out.png"],
            );
            assert_eq!(code(&output), 2, "{quad}: {}", stderr(&output));
            assert_eq!(stdout(&output), "");
            let text = stderr(&output);
            assert!(text.starts_with("ravec: error: "), "{text}");
            for word in words {
                assert!(text.contains(word), "no `{word}` in: {text}");
            }
        }
    };
    refused("1,2,3", &["these are 3 numbers", "eight numbers"]);
    refused("1,2,3,4,5,6,7,eight", &["not all of these are numbers"]);
    refused("1,2,3,4,5,6,7,NaN", &["infinite or none"]);
    // crossing itself, folded in, flat, all in one place
    for quad in [
        "30,30,130,110,130,30,30,110",
        "30,30,130,30,60,50,30,110",
        "30,30,60,60,90,90,30,110",
        "30,30,30,30,30,30,30,30",
    ] {
        refused(quad, &["--quad", "rectangle in perspective"]);
    }
    refused(
        "230,30,330,30,330,110,230,110",
        &["outside the picture", "160 x 140"],
    );
    assert!(!folder.path().join("out.png").exists());
}

#[test]
fn other_wrong_flags_and_hopeless_pictures_are_refused() {
    let folder = board();
    let refused = |arguments: &str, expected: i32, words: &[&str]| {
        let output = ravec(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
        let text = stderr(&output);
        assert_eq!(code(&output), expected, "{arguments}: {text}");
        for word in words {
            assert!(text.contains(word), "{arguments}: no `{word}` in: {text}");
        }
    };
    let quad = "--quad 30,30,130,30,130,110,30,110";
    refused(&format!("snap board.bmp {quad} --grid 0x3"), 2, &["4x6"]);
    refused(
        &format!("snap board.bmp {quad} --reach 50"),
        2,
        &["--reach is 50", "0 to 20"],
    );
    refused(
        &format!("rectify board.bmp -o o.png {quad} --aspect 0"),
        2,
        &["3:2"],
    );
    refused(
        &format!("rectify board.bmp -o o.png {quad} --focal 0mm"),
        2,
        &["28mm"],
    );
    refused(
        &format!("rectify board.bmp -o o.png {quad} --width 0"),
        2,
        &["--width is 0"],
    );
    refused(
        &format!("rectify board.bmp -o o.png {quad} --margin=-1"),
        2,
        &["--margin is -1"],
    );
    refused(
        &format!("rectify board.bmp -o o.png {quad} --beyond blue"),
        2,
        &["transparent"],
    );
    refused(
        &format!("rectify board.bmp -o o.png {quad} --width 60000"),
        2,
        &["--max-pixels"],
    );
    refused("planes board.bmp --most 0", 2, &["--most is 0", "1 to 12"]);
    // one pair of sides is parallel: the proportions are anybody's guess
    let parallel = "rectify board.bmp -o o.png --quad 50,30,110,30,150,110,10,110";
    refused(parallel, 1, &["parallel", "--focal"]);
    let even = bmp(90, 80, |_, _| [80; 3]);
    std::fs::write(folder.path().join("even.bmp"), even).unwrap();
    refused(
        "snap even.bmp --quad 10,10,80,10,80,70,10,70 --grid 3x3",
        1,
        &["even.bmp", "no edges"],
    );
    let none = report(folder.path(), "planes even.bmp");
    assert_eq!(none["result"]["planes"], Value::Array(Vec::new()));
    assert!(!folder.path().join("o.png").exists());
}
