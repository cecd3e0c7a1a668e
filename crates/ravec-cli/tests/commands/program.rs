//! Runs the program and looks at how it ended.

use crate::pictures::bmp;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

pub fn ravec(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(arguments)
        .current_dir(folder)
        .env_remove("RAVEC_LOG")
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

pub fn code(output: &Output) -> i32 {
    output.status.code().unwrap()
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Asserts an exit code and one sentence on standard error that names all the words; nothing on standard output.
#[track_caller]
pub fn assert_refused(output: &Output, expected: i32, words: &[&str]) {
    let text = stderr(output);
    assert_eq!(code(output), expected, "{text}");
    assert_eq!(stdout(output), "");
    assert!(text.starts_with("ravec: error: "), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    for word in words {
        assert!(text.contains(word), "no `{word}` in: {text}");
    }
}

/// A folder with two pictures, `a.bmp` and `b.bmp`, that differ in one pixel.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let ramp = |col: usize, row: usize| [(7 * col) as u8, (9 * row) as u8, 100];
    std::fs::write(folder.path().join("a.bmp"), bmp(32, 24, ramp)).unwrap();
    let spot = |col, row| {
        if (col, row) == (5, 6) {
            [255; 3]
        } else {
            ramp(col, row)
        }
    };
    std::fs::write(folder.path().join("b.bmp"), bmp(32, 24, spot)).unwrap();
    folder
}

/// A small photo-like picture as `photo.jpg` and, with noise, as `noisy.jpg`, both of 160 x 120 pixels.
pub fn photos(folder: &Path) {
    for (name, noise) in [("photo.jpg", "0"), ("noisy.jpg", "15")] {
        let arguments = "-q scenes --out . --scene still-life --width 160 --height 120 --jpeg 95";
        let mut arguments: Vec<_> = arguments.split(' ').collect();
        arguments.extend(["--noise-sigma", noise]);
        let output = ravec(folder, &arguments);
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        std::fs::rename(folder.join("still-life.jpg"), folder.join(name)).unwrap();
    }
    std::fs::remove_file(folder.join("still-life.json")).unwrap();
}

/// Runs the arguments, separated by spaces, and asserts success. Gives what was printed.
#[track_caller]
pub fn done(folder: &Path, arguments: &str) -> String {
    let output = ravec(folder, &arguments.split(' ').collect::<Vec<_>>());
    assert_eq!(code(&output), 0, "{arguments}: {}", stderr(&output));
    stdout(&output)
}

/// Runs the arguments, separated by spaces, with a report, and gives it.
#[track_caller]
pub fn report(folder: &Path, arguments: &str) -> Value {
    let text = done(folder, &format!("-q --json - {arguments}"));
    let report: Value = serde_json::from_str(&text).unwrap();
    for field in [
        "operation",
        "version",
        "inputs",
        "outputs",
        "parameters",
        "seed",
        "timings",
        "figures",
        "warnings",
    ] {
        assert!(report.get(field).is_some(), "no {field} in {text}");
    }
    report
}

/// The arguments, separated by spaces, give the same bytes in `out` on one thread and on three.
#[track_caller]
pub fn assert_same_on_any_threads(folder: &Path, arguments: &str, out: &str) {
    let bytes = |threads| {
        done(folder, &format!("-q --threads {threads} {arguments}"));
        std::fs::read(folder.join(out)).unwrap()
    };
    assert!(bytes(1) == bytes(3), "{arguments}");
}

pub fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files
}
