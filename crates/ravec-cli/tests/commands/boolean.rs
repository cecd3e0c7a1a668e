//! `ravec boolean` from the outside.

use crate::meshes::{cuboid, parts};
use crate::program::{
    assert_refused, assert_same_on_any_threads, code, done, files, ravec, report, stderr, stdout,
};
use std::path::Path;

/// A folder with `part.stl`, a torus, and `box.stl` of 4 x 3 x 2.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    parts(folder.path());
    std::fs::write(folder.path().join("box.stl"), cuboid(4.0, 3.0, 2.0).stl()).unwrap();
    folder
}

#[track_caller]
fn refused(folder: &Path, arguments: &[&str], expected: i32, words: &[&str]) {
    let before = files(folder);
    let output = ravec(folder, arguments);
    assert_refused(&output, expected, words);
    assert_eq!(files(folder), before, "{arguments:?}");
}

#[test]
fn the_three_words_and_the_expressions_agree() {
    let folder = folder();
    let volume = |line: &str| {
        let report = report(folder.path(), line);
        assert_eq!(report["operation"], "boolean");
        assert_eq!(report["passed"], true, "{line}: {report}");
        done(folder.path(), "mesh check out.ply");
        report["figures"]["volume"].as_f64().unwrap()
    };
    let [either, both, first] = [
        ("union", "a|b"),
        ("intersection", "a&b"),
        ("difference", "a-b"),
    ]
    .map(|(word, expression)| {
        let by_word = volume(&format!("boolean {word} part.stl box.stl -o out.ply"));
        let by_name = volume(&format!(
            "boolean {expression} a=part.stl b=box.stl -o out.ply"
        ));
        assert_eq!(by_word, by_name);
        by_word
    });
    assert!(
        (either - (first + 24.0)).abs() < 1e-9 * either,
        "{either} {both} {first}"
    );
    assert!(both > 0.0);
}

#[test]
fn mistakes_are_shown_with_a_caret_and_write_nothing() {
    let folder = folder();
    for (expression, words, caret) in [
        ("a | c", "no mesh named `c`", "    ^"),
        ("(a | b", "not closed", "^"),
        ("a b", "before `b`", "  ^"),
    ] {
        let before = files(folder.path());
        let line = [
            "boolean", expression, "part.stl", "box.stl", "-o", "out.ply",
        ];
        let output = ravec(folder.path(), &line);
        let told = stderr(&output);
        assert_eq!(code(&output), 2, "{told}");
        assert!(told.starts_with("ravec: error: "), "{told}");
        assert!(told.contains(words), "{told}");
        let pointed = format!("\n{expression}\n{caret}");
        assert!(told.trim_end().ends_with(&pointed), "{told}");
        assert_eq!(files(folder.path()), before);
    }
    let missing = ["boolean", "union", "part.stl", "no.stl", "-o", "out.ply"];
    refused(folder.path(), &missing, 3, &["no.stl"]);
}

#[test]
fn an_empty_result_is_no_error() {
    let folder = folder();
    let output = ravec(
        folder.path(),
        &["boolean", "a - a", "part.stl", "-o", "out.stl"],
    );
    assert_eq!(output.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&output.stderr).contains("the result is empty"));
    assert_eq!(
        std::fs::read(folder.path().join("out.stl")).unwrap().len(),
        84
    );
}

#[test]
fn a_report_goes_to_standard_output() {
    let folder = folder();
    let line = [
        "boolean", "union", "part.stl", "box.stl", "-o", "out.ply", "--report", "json",
    ];
    let output = ravec(folder.path(), &line);
    let report: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(report["result"].as_array().unwrap().len(), 2);
    assert_eq!(report["result"][0]["closed"], true);
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let folder = folder();
    assert_same_on_any_threads(
        folder.path(),
        "boolean difference part.stl box.stl -o out.ply",
        "out.ply",
    );
}

/// An OFF file over a grid of `n` squares with a side of one and this height.
fn relief(n: usize, height: impl Fn(usize, usize) -> f64) -> String {
    use std::fmt::Write as _;
    let mut text = format!("OFF\n{} {} 0\n", (n + 1) * (n + 1), 2 * n * n);
    for y in 0..=n {
        for x in 0..=n {
            writeln!(text, "{x} {y} {}", height(x, y)).unwrap();
        }
    }
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            writeln!(text, "3 {a} {} {}", a + 1, a + n + 2).unwrap();
            writeln!(text, "3 {a} {} {}", a + n + 2, a + n + 1).unwrap();
        }
    }
    text
}

#[test]
fn an_open_tube_gets_lids() {
    let folder = folder();
    let rim = |z: i32| format!("0 0 {z}\n4 0 {z}\n4 4 {z}\n0 4 {z}\n");
    let walls: Vec<String> = (0..4)
        .map(|i| {
            let next = (i + 1) % 4;
            format!("3 {i} {next} {}\n3 {i} {} {}\n", next + 4, next + 4, i + 4)
        })
        .collect();
    let tube = format!("OFF\n8 8 0\n{}{}{}", rim(0), rim(1), walls.concat());
    std::fs::write(folder.path().join("tube.off"), tube).unwrap();
    for rule in ["auto", "lid", "band"] {
        let closed = report(
            folder.path(),
            &format!("boolean union tube.off -o out.ply --close {rule}"),
        );
        assert_eq!(closed["passed"], true);
        assert_eq!(closed["figures"]["volume"], 16.0);
    }
    done(folder.path(), "mesh check out.ply");
    let base = [
        "boolean", "union", "tube.off", "-o", "out2.ply", "--close", "base",
    ];
    refused(folder.path(), &base, 3, &["no relief", "--close"]);
}

#[test]
fn a_sheet_is_trimmed_by_a_box_or_put_on_a_base() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("flat.off"), relief(10, |_, _| 0.0)).unwrap();
    std::fs::write(
        path("hills.off"),
        relief(10, |x, y| ((x * y) % 3) as f64 * 0.2),
    )
    .unwrap();
    let place = "--place b:4,4,-1";
    let cut = report(
        folder.path(),
        &format!("boolean a-b flat.off box.stl -o out.ply {place}"),
    );
    assert_eq!(cut["passed"], true, "{cut}");
    assert_eq!(cut["figures"]["trimmed"], 1.0);
    assert_eq!(cut["figures"]["solid"], 0.0);
    assert_eq!(cut["figures"]["area"], 88.0);
    assert!(
        cut["warnings"][0].as_str().unwrap().contains("open"),
        "{cut}"
    );
    let doubted = [
        "boolean", "b-a", "flat.off", "box.stl", "-o", "out.ply", "--place", "b:4,4,-1",
    ];
    let output = ravec(folder.path(), &doubted);
    assert_eq!(code(&output), 5);
    assert!(
        stderr(&output).contains("--close to base"),
        "{}",
        stderr(&output)
    );
    let model = report(
        folder.path(),
        "boolean union hills.off -o model.ply --close base",
    );
    assert_eq!(model["passed"], true, "{model}");
    done(folder.path(), "mesh check model.ply");
    let trim = [
        "boolean", "union", "flat.off", "box.stl", "-o", "no.ply", "--open", "trim",
    ];
    refused(folder.path(), &trim, 2, &["--open trim", "sheet - solid"]);
}
