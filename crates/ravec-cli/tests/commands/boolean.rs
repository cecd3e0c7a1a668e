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
