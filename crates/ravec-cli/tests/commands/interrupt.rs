//! Ctrl-C in the middle of the work, which takes far longer than a signal needs to arrive.
#![cfg(unix)]

use crate::meshes::torus;
use crate::pictures::bmp;
use crate::program::files;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// A folder with a large picture, and older files in the places of the outputs.
fn studio() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let texture = |col: usize, row: usize| {
        let mixed = (col * 73_856_093) ^ (row * 19_349_663);
        [mixed as u8, (mixed >> 8) as u8, (col / 9 * 40) as u8]
    };
    std::fs::write(folder.path().join("large.bmp"), bmp(1600, 1200, texture)).unwrap();
    let mesh = torus(2.0, 0.8, 400, 200).stl();
    std::fs::write(folder.path().join("large.stl"), mesh).unwrap();
    for name in ["out.png", "r.json"] {
        std::fs::write(folder.path().join(name), "old").unwrap();
    }
    folder
}

/// Starts the program, waits until it says `ready`, sends it `signal`, and gives its code and the rest of what it says.
fn interrupted(folder: &Path, arguments: &str, ready: &str, signal: &str) -> (Option<i32>, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(["-vv", "--json", "r.json"])
        .args(arguments.split(' '))
        .current_dir(folder)
        .env_remove("RAVEC_LOG")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap()).lines();
    let begun = said.by_ref().any(|line| line.unwrap().contains(ready));
    assert!(begun, "it never said `{ready}`");
    let sent = Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status();
    assert!(sent.unwrap().success());
    let rest: Vec<_> = said.map(Result::unwrap).collect();
    (child.wait().unwrap().code(), rest.join("\n"))
}

#[test]
fn work_that_is_interrupted_leaves_everything_as_it_was() {
    let folder = studio();
    let before = files(folder.path());
    let slow = "--everywhere --window 21 --iterations 16";
    for (arguments, signal) in [
        (format!("brush large.bmp -o out.png {slow}"), "-INT"),
        (format!("brush large.bmp -o out.png {slow}"), "-TERM"),
        (
            "demo --image large.bmp --max-side 1600 --out gallery".to_owned(),
            "-INT",
        ),
        (
            "mesh simplify large.stl -o out.ply --error 1%".to_owned(),
            "-INT",
        ),
        (
            "offset large.stl -o out.ply --distance 2% --tolerance 0.002%".to_owned(),
            "-INT",
        ),
        (
            "mesh compare large.stl large.stl --samples 90000000".to_owned(),
            "-TERM",
        ),
    ] {
        // the input is read, and the work on it begins
        let (code, said) = interrupted(folder.path(), &arguments, "phase done", signal);
        assert_eq!(code, Some(130), "{arguments}: {said}");
        assert!(said.contains("ravec: error: interrupted"), "{said}");
        assert_eq!(files(folder.path()), before, "{arguments}");
        for name in ["out.png", "r.json"] {
            assert_eq!(std::fs::read(folder.path().join(name)).unwrap(), b"old");
        }
    }
}

#[test]
fn scenes_that_are_interrupted_are_whole_or_absent() {
    let folder = studio();
    let arguments = "scenes --out scenes --scene disc --scene street --width 640 --height 480";
    let (code, said) = interrupted(folder.path(), arguments, "drawing street", "-INT");
    assert_eq!(code, Some(130), "{said}");
    let written = files(&folder.path().join("scenes"));
    let names: Vec<_> = written
        .iter()
        .map(|path| path.file_name().unwrap())
        .collect();
    assert_eq!(names, ["disc.json", "disc.png"]);
}
