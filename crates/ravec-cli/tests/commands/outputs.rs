//! Outputs are whole or absent, and never take the place of an input.

use crate::pictures::{GREY, png};
use crate::program::{assert_refused, code, done, files, folder, ravec, stderr};
use std::path::Path;

fn write_points(folder: &Path) {
    std::fs::write(folder.join("points.json"), "[[5, 5], [15, 10]]").unwrap();
}

#[test]
fn an_input_is_never_written_over() {
    let folder = folder();
    write_points(folder.path());
    let contents = || {
        let files = files(folder.path());
        let read = |path| std::fs::read(path).unwrap();
        files.iter().map(read).collect::<Vec<_>>()
    };
    let before = contents();
    for arguments in [
        "twocolor a.bmp -o a.bmp",
        "twocolor a.bmp -o ./a.bmp",
        "twocolor a.bmp -o out.png --svg a.bmp",
        "twocolor a.bmp -o out.png --json a.bmp",
        "brush a.bmp -o a.bmp --everywhere",
        "brush a.bmp -o out.png --mode mask --stroke points.json --mask a.bmp",
        "brush a.bmp -o out.png --stroke points.json --json points.json",
        "compare a.bmp b.bmp --json b.bmp",
    ] {
        let output = ravec(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
        assert_refused(&output, 2, &["it is an input", "choose another name"]);
    }
    assert!(contents() == before);
}

#[test]
fn two_outputs_need_two_places() {
    let folder = folder();
    write_points(folder.path());
    let before = files(folder.path());
    for arguments in [
        "twocolor a.bmp -o out.png --svg out.png",
        "twocolor a.bmp -o out.png --json ./out.png",
        "twocolor a.bmp -o - --json -",
        "twocolor a.bmp -o - --svg -",
        "brush a.bmp -o out.png --mode mask --stroke points.json --mask out.png",
    ] {
        let output = ravec(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
        assert_refused(&output, 2, &["two outputs"]);
    }
    for arguments in ["compare - -", "brush - -o out.png --stroke -"] {
        let output = ravec(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
        assert_refused(&output, 2, &["standard input", "once"]);
    }
    assert_eq!(files(folder.path()), before);
}

#[test]
fn an_older_output_is_replaced_or_stays_as_it_was() {
    let folder = folder();
    let out = folder.path().join("out.png");
    std::fs::write(&out, "old").unwrap();
    let output = ravec(folder.path(), &["twocolor", "missing.bmp", "-o", "out.png"]);
    assert_eq!(code(&output), 3);
    assert_eq!(std::fs::read(&out).unwrap(), b"old");
    done(folder.path(), "twocolor a.bmp -o out.png");
    assert!(std::fs::read(&out).unwrap().starts_with(b"\x89PNG"));
    assert_eq!(files(folder.path()).len(), 3, "no temporary file");
}

/// Unwritable outputs are found before the inputs are read, which here would take a while to fail: they do not exist.
#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("dir.png")).unwrap();
    let before = files(folder.path());
    for (arguments, word) in [
        (
            "twocolor none -o no/out.png",
            "no/out.png: its folder does not exist",
        ),
        ("twocolor none -o dir.png", "dir.png: is a directory"),
        ("twocolor none -o a.bmp/out.png", "a.bmp/out.png"),
        ("twocolor none -o out.png --svg no/out.svg", "no/out.svg"),
        ("twocolor none -o out.png --json no/r.json", "no/r.json"),
        ("brush none -o no/out.png --everywhere", "no/out.png"),
        (
            "brush none -o out.png --stroke none --mask no/m.png",
            "no/m.png",
        ),
        ("compare none none --json no/r.json", "no/r.json"),
        ("demo --out a.bmp", "a.bmp: it is a file, not a folder"),
        (
            "scenes --out a.bmp/deep",
            "a.bmp/deep: what should be its folder is a file",
        ),
        ("man --out a.bmp", "a.bmp: it is a file, not a folder"),
    ] {
        let output = ravec(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
        assert_refused(&output, 4, &[word]);
    }
    for name in ["out.gif", "out", "out.svg"] {
        let output = ravec(folder.path(), &["twocolor", "none", "-o", name]);
        assert_refused(&output, 2, &[name, ".png", ".jpg"]);
    }
    assert_eq!(files(folder.path()), before);
}

#[test]
fn a_picture_too_long_for_its_format_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let line = png(66_000, 1, 8, GREY, &vec![99; 66_000]);
    std::fs::write(folder.path().join("line.png"), line).unwrap();
    for (out, limit) in [("out.jpg", "65535"), ("out.webp", "16384")] {
        let output = ravec(folder.path(), &["twocolor", "line.png", "-o", out]);
        assert_refused(&output, 4, &[out, limit, "66000 x 1"]);
        assert!(!folder.path().join(out).exists());
    }
    done(folder.path(), "-q twocolor line.png -o out.tif");
}

#[cfg(unix)]
#[test]
fn a_write_protected_folder_or_file_is_refused() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = folder();
    let closed = folder.path().join("closed");
    std::fs::create_dir(&closed).unwrap();
    std::fs::write(folder.path().join("fixed.png"), "old").unwrap();
    let protect = |path: &Path, mode| {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).unwrap();
    };
    protect(&folder.path().join("fixed.png"), 0o444);
    let output = ravec(folder.path(), &["twocolor", "a.bmp", "-o", "fixed.png"]);
    assert_refused(&output, 4, &["fixed.png"]);

    protect(&closed, 0o555);
    if std::fs::write(closed.join("probe"), "").is_ok() {
        eprintln!("skipped: this user may write into write-protected folders");
        return;
    }
    for arguments in [
        "twocolor a.bmp -o closed/out.png",
        "twocolor a.bmp --svg closed/out.svg",
        "compare a.bmp b.bmp --json closed/r.json",
        "demo --out closed",
        "scenes --out closed/deep",
    ] {
        let output = ravec(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
        assert_refused(&output, 4, &["closed", "write-protected"]);
    }
    protect(&closed, 0o755);
}

/// A device that is always full stands for a full disk.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_output_error() {
    let folder = folder();
    let full = |arguments: &str| {
        let arguments: Vec<_> = arguments.split(' ').collect();
        let output = ravec(folder.path(), &arguments);
        assert_eq!(code(&output), 4, "{}", stderr(&output));
        assert!(
            stderr(&output).contains("No space left"),
            "{}",
            stderr(&output)
        );
    };
    full("-q twocolor a.bmp --svg /dev/full");
    full("-q compare a.bmp b.bmp --json /dev/full");
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(["twocolor", "a.bmp", "-o", "-"])
        .current_dir(folder.path())
        .stdout(
            std::fs::File::options()
                .write(true)
                .open("/dev/full")
                .unwrap(),
        )
        .output()
        .unwrap();
    assert_refused(&output, 4, &["standard output", "No space left"]);
}
