//! Broken and odd files: a right result or one clear sentence.

use crate::pictures::{GREY, RGB, RGBA, animated_png, bmp, png, png_size, tiff};
use crate::program::{assert_refused, code, done, files, folder, photos, ravec, report, stderr};
use std::path::Path;

/// Every operation on pictures refuses `name` with the words, and leaves the folder as it was.
#[track_caller]
fn assert_nobody_reads(folder: &Path, name: &str, words: &[&str]) {
    let before = files(folder);
    for arguments in [
        &["twocolor", name, "-o", "out.png", "--json", "r.json"][..],
        &["brush", name, "-o", "out.png", "--everywhere"],
        &["compare", name, name],
        &["planes", name, "-o", "out.png"],
        &["snap", name, "--quad", "0,0,9,0,9,9,0,9", "-o", "out.png"],
        &[
            "rectify",
            name,
            "--quad",
            "0,0,9,0,9,9,0,9",
            "-o",
            "out.png",
        ],
        &[
            "demo",
            "--image",
            name,
            "--max-side",
            "64",
            "--out",
            "gallery",
        ],
    ] {
        let output = ravec(folder, arguments);
        assert_refused(&output, 3, &[&[name], words].concat());
        assert!(!stderr(&output).contains("os error"), "{}", stderr(&output));
    }
    assert_eq!(files(folder), before);
}

#[test]
fn what_is_no_picture_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (name, content, word) in [
        ("empty.png", &b""[..], "empty"),
        (
            "text.png",
            b"Dear diary, today I am a picture.\n",
            "known are PNG, JPEG",
        ),
        ("moving.png", b"GIF89a\x04\0\x04\0", "looks like GIF"),
        (
            "phone.jpg",
            b"\0\0\0\x18ftypheic\0\0\0\0mif1heic",
            "looks like HEIC",
        ),
        ("paper.png", b"%PDF-1.7", "looks like PDF"),
        ("start.png", b"\x89PNG\r\n\x1a\n", "PNG data is damaged"),
        ("start.jpg", b"\xff\xd8\xff\xe0", "JPEG data is damaged"),
    ] {
        std::fs::write(folder.path().join(name), content).unwrap();
        assert_nobody_reads(folder.path(), name, &[word]);
    }
    assert_nobody_reads(folder.path(), "missing.png", &["cannot read"]);
    // some take a folder as a clip of its pictures, which are broken here
    assert_nobody_reads(folder.path(), ".", &["cannot read"]);
}

#[test]
fn files_that_end_early_are_refused_or_filled_in_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    photos(folder.path());
    for name in [
        "whole.png",
        "whole.tif",
        "whole.webp",
        "whole.bmp",
        "whole.exr",
        "whole.hdr",
    ] {
        done(
            folder.path(),
            &format!("-q twocolor photo.jpg -o {name} --size 2"),
        );
        let whole = std::fs::read(folder.path().join(name)).unwrap();
        for length in [9, 40, whole.len() / 2] {
            let name = format!("cut-{length}-{name}");
            std::fs::write(folder.path().join(&name), &whole[..length]).unwrap();
            assert_nobody_reads(folder.path(), &name, &[]);
        }
    }
    // half a JPEG is what an interrupted transfer leaves, and worth having
    let whole = std::fs::read(folder.path().join("photo.jpg")).unwrap();
    std::fs::write(folder.path().join("half.jpg"), &whole[..whole.len() / 2]).unwrap();
    let half = report(folder.path(), "twocolor half.jpg -o out.png");
    assert!(
        half["warnings"][0].as_str().unwrap().contains("ends early"),
        "{half}"
    );
}

#[test]
fn sizes_that_cannot_be_are_refused_before_memory_is_taken() {
    let folder = folder();
    for (name, width, height, words) in [
        ("none.png", 0, 0, &["damaged"][..]),
        ("line.png", 0, 5, &["damaged"]),
        (
            "huge.png",
            100_000,
            100_000,
            &["100000 x 100000", "--max-pixels"],
        ),
        ("vast.png", 0x7fff_ffff, 0x7fff_ffff, &["--max-"]),
    ] {
        let file = png(width, height, 8, RGB, &[]);
        std::fs::write(folder.path().join(name), file).unwrap();
        assert_nobody_reads(folder.path(), name, words);
    }
    let zero = bmp(0, 0, |_, _| [0; 3]);
    std::fs::write(folder.path().join("none.bmp"), zero).unwrap();
    assert_nobody_reads(folder.path(), "none.bmp", &[]);
    for (limit, flag) in [("767", "--max-pixels"), ("1k", "--max-bytes")] {
        let arguments = ["twocolor", "a.bmp", "-o", "out.png", flag, limit];
        assert_refused(&ravec(folder.path(), &arguments), 3, &["a.bmp", flag]);
    }
    done(
        folder.path(),
        "-q twocolor a.bmp -o out.png --max-pixels 768",
    );
}

#[test]
fn a_wrong_extension_does_not_matter_for_reading() {
    let folder = tempfile::tempdir().unwrap();
    photos(folder.path());
    std::fs::rename(
        folder.path().join("photo.jpg"),
        folder.path().join("photo.png"),
    )
    .unwrap();
    std::fs::rename(folder.path().join("noisy.jpg"), folder.path().join("noisy")).unwrap();
    for name in ["photo.png", "noisy"] {
        let report = report(folder.path(), &format!("twocolor {name} -o out.bmp"));
        assert_eq!(report["inputs"][0]["format"], "JPEG");
    }
}

#[test]
fn only_the_first_frame_of_an_animation_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let file = animated_png(6, 4, &[90; 72]);
    std::fs::write(folder.path().join("in.png"), file).unwrap();
    let report = report(folder.path(), "brush in.png -o out.png --everywhere");
    let warning = report["warnings"][0].as_str().unwrap();
    assert!(warning.contains("only its first frame"), "{warning}");
}

#[test]
fn amounts_of_ink_become_colors_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let inks: Vec<u8> = (0..12 * 8).flat_map(|_| [0, 255, 255, 0]).collect();
    std::fs::write(
        folder.path().join("in.tif"),
        tiff([12, 8], [4, 8, 1, 5], &inks),
    )
    .unwrap();
    let seen = report(folder.path(), "twocolor in.tif -o out.png");
    assert!(
        seen["warnings"][0].as_str().unwrap().contains("CMYK"),
        "{seen}"
    );
    // magenta and yellow are red
    std::fs::write(
        folder.path().join("red.png"),
        png(12, 8, 8, RGB, &[255, 0, 0].repeat(96)),
    )
    .unwrap();
    let compared = report(folder.path(), "compare red.png out.png");
    assert!(
        compared["figures"]["max_difference_steps"]
            .as_f64()
            .unwrap()
            < 40.0,
        "{compared}"
    );
}

#[test]
fn numbers_that_are_none_are_replaced_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut samples = vec![0.25f32; 3 * 20 * 15];
    (samples[0], samples[100], samples[200]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
    let mixed = samples.clone();
    samples.fill(f32::NAN);
    for (name, samples, words) in [
        (
            "mixed.tif",
            mixed,
            "1 NaN samples were set to 0 and 2 infinite",
        ),
        ("none.tif", samples, "900 NaN"),
    ] {
        let data: Vec<u8> = samples.iter().flat_map(|v| v.to_le_bytes()).collect();
        let file = tiff([20, 15], [3, 32, 3, 2], &data);
        std::fs::write(folder.path().join(name), file).unwrap();
        std::fs::write(folder.path().join("points.json"), "[[5, 5], [15, 10]]").unwrap();
        for arguments in [
            "twocolor IN -o out.png --svg out.svg",
            "twocolor IN -o out.png --adaptive",
            "brush IN -o out.png --everywhere --mode smooth",
            "brush IN -o out.png --everywhere --mode sharpen",
            "brush IN -o out.png --everywhere --mode clean",
            "brush IN -o out.png --everywhere --mode stamp",
            "brush IN -o out.png --everywhere --mode antialias --scale 2",
            "brush IN -o out.png --mode dodge --stroke points.json",
            "compare IN IN",
        ] {
            let report = report(folder.path(), &arguments.replace("IN", name));
            let warning = report["warnings"][0].as_str().unwrap();
            assert!(warning.contains(words), "{warning}");
        }
        let svg = std::fs::read_to_string(folder.path().join("out.svg")).unwrap();
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }
}

#[test]
fn long_thin_and_wholly_transparent_pictures_are_fine() {
    let folder = tempfile::tempdir().unwrap();
    let samples: Vec<u8> = (0..60_000u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    std::fs::write(
        folder.path().join("tall.png"),
        png(3, 20_000, 8, GREY, &samples),
    )
    .unwrap();
    std::fs::write(
        folder.path().join("wide.png"),
        png(20_000, 3, 8, GREY, &samples),
    )
    .unwrap();
    std::fs::write(
        folder.path().join("clear.png"),
        png(60, 25, 8, RGBA, &[0; 6000]),
    )
    .unwrap();
    for (name, size) in [
        ("tall.png", (3, 20_000)),
        ("wide.png", (20_000, 3)),
        ("clear.png", (60, 25)),
    ] {
        for arguments in [
            "twocolor IN -o out.png",
            "twocolor IN -o out.png --adaptive",
            "brush IN -o out.png --everywhere --mode smooth",
            "brush IN -o out.png --everywhere --mode clean",
        ] {
            done(
                folder.path(),
                &format!("-q {}", arguments.replace("IN", name)),
            );
            let out = std::fs::read(folder.path().join("out.png")).unwrap();
            assert_eq!(png_size(&out), size, "{arguments}");
        }
    }
    let same = report(folder.path(), "compare clear.png clear.png");
    assert_eq!(same["figures"]["identical"], 1.0);
    let seen = report(folder.path(), "twocolor clear.png -o out.png");
    assert_eq!(seen["figures"]["flat_blocks"], seen["figures"]["blocks"]);
}

#[test]
fn too_many_threads_are_a_usage_error_and_more_than_cores_are_fine() {
    let folder = folder();
    for threads in ["0", "1025", "99999", "-1", "two"] {
        let threads = format!("--threads={threads}");
        let output = ravec(folder.path(), &["compare", "a.bmp", "b.bmp", &threads]);
        assert_eq!(code(&output), 2, "{threads}");
    }
    done(folder.path(), "compare a.bmp b.bmp --threads 64");
}

/// A stream is recognized by its first bytes, so that one without an end is refused at once and not when memory is full.
#[cfg(unix)]
#[test]
fn streams_without_an_end_are_refused_by_their_beginning() {
    let folder = folder();
    for arguments in [
        "twocolor - -o out.png",
        "compare a.bmp -",
        "complete a.bmp --mask - -o out.png",
        "mesh info -",
        "offset - --distance 2% -o out.ply",
    ] {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_ravec"))
            .args(arguments.split(' '))
            .args(["--max-bytes", "64G"])
            .current_dir(folder.path())
            .stdin(std::fs::File::open("/dev/zero").unwrap())
            .output()
            .unwrap();
        assert_refused(&output, 3, &["standard input"]);
    }
    for arguments in [
        ["twocolor", "/dev/zero", "-o", "out.png"],
        ["mesh", "info", "/dev/zero", "-q"],
    ] {
        assert_refused(&ravec(folder.path(), &arguments), 3, &["/dev/zero"]);
    }
}

/// All inputs of a run share the limit.
#[test]
fn two_pictures_that_fit_one_by_one_do_not_fit_together() {
    let folder = tempfile::tempdir().unwrap();
    let photo = crate::pictures::bmp(1000, 1000, |col, row| [col as u8, row as u8, 7]);
    for name in ["a.bmp", "b.bmp"] {
        std::fs::write(folder.path().join(name), &photo).unwrap();
    }
    done(folder.path(), "-q twocolor a.bmp -o out.png --max-bytes 5M");
    let arguments = ["compare", "a.bmp", "b.bmp", "--max-bytes", "5M"];
    let words = ["b.bmp", "--max-bytes", "are in use"];
    assert_refused(&ravec(folder.path(), &arguments), 3, &words);
    done(folder.path(), "-q compare a.bmp b.bmp --max-bytes 7M");
}
