//! `ravec brush`.

use crate::pictures::{RGB, png, png_size};
use crate::program::{
    assert_refused, assert_same_on_any_threads, code, done, files, photos, ravec, report, stderr,
};
use std::io::Write as _;
use std::process::{Command, Stdio};

const OPERATORS: [&str; 6] = [
    "abstract",
    "smooth",
    "sharpen",
    "clean",
    "antialias",
    "stamp",
];

const STROKES: &str = r#"{"version": 1, "width": 160, "height": 120, "strokes": [
    {"tool": {"operator": {"mode": "smooth"}}, "points": [[40, 30], [90, 50]], "radius_px": 20},
    {"tool": {"color": {"rgb": [192, 48, 32]}}, "points": [[80, 60]], "radius_px": 15, "hardness": 1},
    {"tool": "burn", "points": [[20, 90], [120, 100]], "radius_px": 9, "accumulate": true},
    {"tool": {"clone": {"offset": [30, -20]}}, "points": [[60, 80]], "radius_px": 12},
    {"tool": "mask", "points": [[80, 60]], "radius_px": 25}]}"#;

fn photo() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    photos(folder.path());
    std::fs::write(folder.path().join("strokes.json"), STROKES).unwrap();
    std::fs::write(folder.path().join("points.json"), "[[40, 30], [90, 50]]").unwrap();
    folder
}

fn read(folder: &tempfile::TempDir, name: &str) -> Vec<u8> {
    std::fs::read(folder.path().join(name)).unwrap()
}

#[test]
fn every_mode_works_everywhere_or_along_points_on_any_threads() {
    let folder = photo();
    for mode in OPERATORS {
        let arguments = format!("brush noisy.jpg -o out.png --everywhere --mode {mode}");
        assert_same_on_any_threads(folder.path(), &arguments, "out.png");
        assert_eq!(png_size(&read(&folder, "out.png")), (160, 120), "{mode}");
    }
    let tools = [
        "color",
        "dodge",
        "burn",
        "saturation",
        "recolor",
        "clone --offset -30,10",
    ];
    for mode in OPERATORS.iter().chain(&tools) {
        let arguments = format!("brush photo.jpg -o out.png --stroke points.json --mode {mode}");
        assert_same_on_any_threads(folder.path(), &arguments, "out.png");
        let report = report(folder.path(), &arguments);
        assert_eq!(report["figures"]["strokes"], 1.0);
        assert!(
            report["figures"]["touched_pixels"].as_f64().unwrap() > 500.0,
            "{mode}"
        );
        assert_eq!(report["warnings"].as_array().unwrap().len(), 0, "{mode}");
    }
}

#[test]
fn strokes_with_settings_paint_and_select_and_can_be_undone() {
    let folder = photo();
    let arguments = "brush photo.jpg -o out.png --stroke strokes.json --mask mask.png";
    assert_same_on_any_threads(folder.path(), arguments, "out.png");
    assert_same_on_any_threads(folder.path(), arguments, "mask.png");
    let all = report(folder.path(), arguments);
    assert_eq!(all["operation"], "brush");
    assert_eq!(all["figures"]["strokes"], 5.0);
    assert_eq!(all["outputs"][0]["path"], "mask.png");
    assert_eq!(png_size(&read(&folder, "mask.png")), (160, 120));
    let undone = report(folder.path(), &format!("{arguments} --undo 5"));
    assert_eq!(undone["figures"]["touched_pixels"], 0.0);
    done(
        folder.path(),
        "-q brush photo.jpg -o same.png --stroke strokes.json --undo 99",
    );
    let same = report(folder.path(), "compare photo.jpg same.png");
    assert_eq!(same["figures"]["identical"], 1.0);
}

#[test]
fn the_strength_of_noise_is_found_or_taken_as_given() {
    let folder = photo();
    let clean = "brush noisy.jpg -o out.png --mode clean --everywhere";
    let found = report(folder.path(), clean);
    let sigma = found["figures"]["noise_sigma_steps"].as_f64().unwrap();
    assert!(
        (8.0..22.0).contains(&sigma),
        "15 steps were added, {sigma} found"
    );
    assert!(found["figures"]["compressed"].is_number());
    let given = report(folder.path(), &format!("{clean} --noise-sigma 15"));
    assert_eq!(given["figures"]["noise_sigma_steps"], 15.0);
    assert_eq!(given["parameters"]["noise_sigma"], 15.0);
    let psnr = |name: &str| {
        let report = report(folder.path(), &format!("compare photo.jpg {name}"));
        report["figures"]["psnr_db"].as_f64().unwrap()
    };
    assert!(psnr("out.png") > psnr("noisy.jpg") + 2.0);
}

#[test]
fn antialias_enlarges_and_stamps_have_a_seed() {
    let folder = photo();
    done(
        folder.path(),
        "-q brush photo.jpg -o out.png --mode antialias --everywhere --scale 1.5",
    );
    assert_eq!(png_size(&read(&folder, "out.png")), (240, 180));
    let stamps = |seed: u32| {
        let arguments =
            format!("brush photo.jpg -o out.png --mode stamp --everywhere --seed {seed}");
        assert_eq!(report(folder.path(), &arguments)["seed"], seed);
        read(&folder, "out.png")
    };
    assert!(stamps(3) == stamps(3) && stamps(3) != stamps(4));
}

#[test]
fn strokes_come_from_standard_input() {
    let folder = photo();
    done(
        folder.path(),
        "-q brush photo.jpg -o file.png --mode dodge --stroke points.json",
    );
    let mut child = Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args([
            "-q",
            "brush",
            "photo.jpg",
            "-o",
            "-",
            "--mode",
            "dodge",
            "--stroke",
            "-",
        ])
        .args(["--json", "r.json"])
        .current_dir(folder.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child
        .stdin
        .take()
        .unwrap()
        .write_all(&read(&folder, "points.json"))
        .unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    done(
        folder.path(),
        "-q brush photo.jpg -o file.jpg --mode dodge --stroke points.json",
    );
    assert!(output.stdout == read(&folder, "file.jpg"));
}

#[test]
fn windows_larger_than_the_picture_are_fine() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("points.json"), "[[0, 0]]").unwrap();
    let samples: Vec<u8> = (0..60).map(|i| (i * 37 % 256) as u8).collect();
    for (width, height) in [(1, 1), (1, 20), (20, 1), (3, 2)] {
        let file = png(
            width,
            height,
            8,
            RGB,
            &samples[..(3 * width * height) as usize],
        );
        std::fs::write(folder.path().join("in.png"), file).unwrap();
        for place in ["--everywhere", "--stroke points.json --radius 4096"] {
            for mode in OPERATORS {
                let arguments =
                    format!("-q brush in.png -o out.png --mode {mode} --window 15 {place}");
                done(folder.path(), &arguments);
                assert_eq!(png_size(&read(&folder, "out.png")), (width, height));
            }
        }
    }
}

#[test]
fn strokes_outside_the_picture_and_lost_selections_are_warned_about() {
    let folder = photo();
    std::fs::write(
        folder.path().join("far.json"),
        "[[-500, -500], [900, -400]]",
    )
    .unwrap();
    let far = report(
        folder.path(),
        "brush photo.jpg -o out.png --mode burn --stroke far.json",
    );
    assert!(
        far["warnings"][0].as_str().unwrap().contains("outside"),
        "{far}"
    );
    assert_eq!(far["figures"]["touched_pixels"], 0.0);
    let lost = report(
        folder.path(),
        "brush photo.jpg -o out.png --mode mask --stroke points.json",
    );
    assert!(
        lost["warnings"][0].as_str().unwrap().contains("`mask`"),
        "{lost}"
    );
}

#[test]
fn bad_strokes_are_refused_with_the_place_and_the_reason() {
    let folder = photo();
    let stroke = |fields: &str| {
        format!(
            r#"{{"version":1,"width":160,"height":120,"strokes":[{{"tool":"dodge",{fields}}}]}}"#
        )
    };
    let before = files(folder.path());
    for (text, word) in [
        (String::new(), "it is empty"),
        ("Dear diary".to_owned(), "line 1 column 1"),
        ("[[1, 2],\n [3, 4],]".to_owned(), "line 2 column 9"),
        ("[[NaN, 3]]".to_owned(), "line 1 column 3"),
        ("[[1e999, 3]]".to_owned(), "out of range at line 1"),
        ("[[1, 2, 3]]".to_owned(), "line 1 column 9"),
        ("[]".to_owned(), "has no points"),
        ("[[1e300, 3]]".to_owned(), "stroke 1 has a point"),
        ("[".repeat(100_000), "line 1 column 2"),
        ("{\"version\": 1,\n\"width\": 4, \"hei".to_owned(), "line 2"),
        (
            stroke(r#""points":[[1,2]],"radius_px":-3"#),
            "stroke 1 has a radius",
        ),
        (
            stroke(r#""points":[[1,2]],"radius_px":1e300"#),
            "stroke 1 has a radius",
        ),
        (
            stroke(r#""points":[[1,2]],"radius_px":3,"sharp":1"#),
            "unknown field `sharp`",
        ),
        (stroke(r#""points":[[1,2]]"#), "missing field `radius_px`"),
        (
            stroke(r#""points":[],"radius_px":3"#),
            "stroke 1 has no points",
        ),
        (
            stroke("").replace("dodge\",", "hammer\""),
            "unknown variant `hammer`",
        ),
        (
            r#"{"version":7,"width":1,"height":1,"strokes":[]}"#.to_owned(),
            "version 7",
        ),
        (
            r#"{"version":1,"width":0,"height":1,"strokes":[]}"#.to_owned(),
            "0 x 1",
        ),
    ] {
        std::fs::write(folder.path().join("points.json"), &text).unwrap();
        let arguments = [
            "brush",
            "photo.jpg",
            "-o",
            "out.png",
            "--stroke",
            "points.json",
        ];
        assert_refused(&ravec(folder.path(), &arguments), 3, &["points.json", word]);
    }
    for name in ["missing.json", "photo.jpg", "."] {
        let arguments = ["brush", "noisy.jpg", "-o", "out.png", "--stroke", name];
        assert_refused(&ravec(folder.path(), &arguments), 3, &[name]);
    }
    assert_eq!(files(folder.path()), before);
}

#[test]
fn values_out_of_range_are_refused_with_the_range() {
    let folder = photo();
    for (arguments, words) in [
        ("--everywhere --strength NaN", &["--strength", "0 to 1"][..]),
        ("--everywhere --iterations 17", &["--iterations", "1 to 16"]),
        ("--everywhere --window 8", &["--window", "odd, 3 to 31"]),
        (
            "--everywhere --noise-sigma=-1",
            &["--noise-sigma is -1", "0 to 255"],
        ),
        ("--everywhere --scale 2", &["--scale", "antialias"]),
        (
            "--everywhere --mode dodge",
            &["--mode is dodge", "--everywhere"],
        ),
        (
            "--everywhere --mode antialias --scale 60 --max-pixels 20k",
            &["--scale", "--max-pixels"],
        ),
        (
            "--stroke points.json --radius 0",
            &["--radius", "up to 4096"],
        ),
        (
            "--stroke points.json --radius inf",
            &["--radius", "up to 4096"],
        ),
        (
            "--stroke points.json --hardness 7",
            &["--hardness", "0 to 1"],
        ),
        ("--stroke points.json --amount 9", &["--amount", "-1 to 4"]),
        (
            "--stroke points.json --quality 101",
            &["--quality", "1 to 100"],
        ),
    ] {
        let arguments = format!("brush photo.jpg -o out.png {arguments}");
        let arguments: Vec<_> = arguments.split(' ').collect();
        assert_refused(&ravec(folder.path(), &arguments), 2, words);
    }
    for arguments in [
        "",
        "--everywhere --stroke points.json",
        "--everywhere --mask mask.png",
        "--stroke points.json --color red",
        "--stroke points.json --offset 3",
        "--everywhere --mode hammer",
    ] {
        let arguments = format!("brush photo.jpg -o out.png {arguments}");
        let arguments: Vec<_> = arguments.trim().split(' ').collect();
        assert_eq!(code(&ravec(folder.path(), &arguments)), 2, "{arguments:?}");
    }
    assert!(!folder.path().join("out.png").exists());
}
