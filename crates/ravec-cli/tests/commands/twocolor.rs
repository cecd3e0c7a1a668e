//! `ravec twocolor`.

use crate::pictures::{GREY, RGB, RGBA, png, png_kind, png_size};
use crate::program::{
    assert_refused, assert_same_on_any_threads, code, done, files, photos, ravec, report, stderr,
};
use std::path::Path;
use std::process::{Command, Stdio};

fn photo() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    photos(folder.path());
    folder
}

fn read(folder: &tempfile::TempDir, name: &str) -> Vec<u8> {
    std::fs::read(folder.path().join(name)).unwrap()
}

#[test]
fn the_output_has_the_asked_size_and_the_format_of_its_name() {
    let folder = photo();
    for (arguments, size) in [
        ("", (160, 120)),
        ("--scale 2.5", (400, 300)),
        ("--scale 0.25 --mosaic", (40, 30)),
        ("--adaptive --size 4 --max-size 16", (160, 120)),
        ("--size 64 --whole-pixels", (160, 120)),
        ("--size 2", (160, 120)),
    ] {
        let arguments = format!("-q twocolor photo.jpg -o out.png {arguments}");
        done(folder.path(), arguments.trim());
        assert_eq!(png_size(&read(&folder, "out.png")), size, "{arguments}");
    }
    for (name, start) in [
        ("out.jpeg", &b"\xff\xd8\xff"[..]),
        ("out.WEBP", b"RIFF"),
        ("out.tif", b"II*\0"),
        ("out.bmp", b"BM"),
        ("out.exr", b"\x76\x2f\x31\x01"),
        ("out.hdr", b"#?"),
    ] {
        done(folder.path(), &format!("-q twocolor photo.jpg -o {name}"));
        assert!(read(&folder, name).starts_with(start), "{name}");
    }
}

#[test]
fn the_report_has_files_parameters_and_figures() {
    let folder = photo();
    let report = report(
        folder.path(),
        "twocolor photo.jpg -o out.png --svg out.svg --size 16",
    );
    assert_eq!(report["operation"], "twocolor");
    assert_eq!(report["parameters"]["size"], 16);
    assert_eq!(report["parameters"]["scale"], 1.0);
    assert_eq!(report["inputs"][0]["format"], "JPEG");
    assert_eq!(report["outputs"][0]["width"], 160);
    assert_eq!(report["outputs"][1]["format"], "SVG");
    let figure = |name: &str| report["figures"][name].as_f64().unwrap();
    assert_eq!(figure("blocks"), 80.0, "10 x 8 blocks of 16");
    assert!(figure("flat_blocks") <= 80.0 && figure("values") <= 8.0 * 80.0);
    assert!(figure("psnr_db") > 15.0, "{}", figure("psnr_db"));
    assert_eq!(figure("svg_bytes"), read(&folder, "out.svg").len() as f64);
}

#[test]
fn the_result_does_not_depend_on_the_threads() {
    let folder = photo();
    for arguments in ["", "--adaptive", "--size 24", "--scale 3"] {
        let arguments = format!("twocolor photo.jpg -o out.png --svg out.svg {arguments}");
        assert_same_on_any_threads(folder.path(), arguments.trim(), "out.png");
        assert_same_on_any_threads(folder.path(), arguments.trim(), "out.svg");
    }
}

#[test]
fn standard_input_and_output_are_files_like_others() {
    let folder = photo();
    let piped = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_ravec"))
            .args(arguments)
            .current_dir(folder.path())
            .stdin(std::fs::File::open(folder.path().join("photo.jpg")).unwrap())
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        assert_eq!(stderr(&output), "");
        output.stdout
    };
    done(folder.path(), "twocolor photo.jpg -o out.jpg --svg out.svg");
    // nothing but the picture, in the format of the input
    assert!(piped(&["twocolor", "-", "-o", "-"]) == read(&folder, "out.jpg"));
    assert!(piped(&["twocolor", "-", "--svg", "-"]) == read(&folder, "out.svg"));
    piped(&["twocolor", "-", "-o", "-", "--json", "r.json"]);
    let report: serde_json::Value = serde_json::from_slice(&read(&folder, "r.json")).unwrap();
    assert_eq!(report["inputs"][0]["path"], "-");
    assert_eq!(report["outputs"][0]["format"], "JPEG");
    assert!(!folder.path().join("-").exists());
}

#[test]
fn depth_gray_and_alpha_survive() {
    let folder = tempfile::tempdir().unwrap();
    let samples: Vec<u8> = (0..20 * 10 * 8).map(|i| (i * 7 % 251) as u8).collect();
    for (depth, color, bytes) in [
        (8, GREY, 1),
        (16, GREY, 2),
        (8, RGB, 3),
        (16, RGB, 6),
        (8, RGBA, 4),
        (16, RGBA, 8),
    ] {
        let file = png(20, 10, depth, color, &samples[..20 * 10 * bytes]);
        std::fs::write(folder.path().join("in.png"), file).unwrap();
        done(folder.path(), "-q twocolor in.png -o out.png");
        let out = read(&folder, "out.png");
        assert_eq!(png_size(&out), (20, 10));
        assert_eq!(png_kind(&out), (depth, color));
    }
    // into a format without alpha: a warning, and a background
    let output = ravec(
        folder.path(),
        &["-q", "--json", "-", "twocolor", "in.png", "-o", "out.jpg"],
    );
    assert_eq!(code(&output), 0);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let warning = report["warnings"][0].as_str().unwrap();
    assert!(warning.contains("JPEG has no transparency"), "{warning}");
    assert_eq!(report["outputs"][0]["pixels"], "8 bit");
}

#[test]
fn pictures_smaller_than_a_block_or_a_pixel_wide_are_fine() {
    let folder = tempfile::tempdir().unwrap();
    let samples: Vec<u8> = (0..300).map(|i| (i * 37 % 256) as u8).collect();
    for (width, height) in [(1, 1), (1, 100), (100, 1), (3, 2)] {
        let file = png(
            width,
            height,
            8,
            RGB,
            &samples[..(3 * width * height) as usize],
        );
        std::fs::write(folder.path().join("in.png"), file).unwrap();
        for arguments in [
            "--size 2",
            "--size 64",
            "--adaptive",
            "--size 64 --svg out.svg",
        ] {
            done(
                folder.path(),
                &format!("-q twocolor in.png -o out.png {arguments}"),
            );
            assert_eq!(png_size(&read(&folder, "out.png")), (width, height));
        }
    }
}

#[test]
fn values_out_of_range_are_refused_with_the_range() {
    let folder = photo();
    let before = files(folder.path());
    for (arguments, words) in [
        ("--size 1", &["--size", "2 to 64"][..]),
        ("--size 65", &["--size", "2 to 64"]),
        ("--adaptive --size 64", &["--size", "2 to 32"]),
        ("--adaptive --size 5", &["--max-size", "power of two"]),
        ("--scale 0", &["--scale", "above 0"]),
        ("--scale NaN", &["--scale"]),
        ("--scale 1000", &["--scale", "--max-pixels"]),
        ("--max-error 2", &["--max-error", "0 to 1"]),
        ("--color-levels 1", &["--color-levels", "2 to 256"]),
        ("--quality 0", &["--quality", "1 to 100"]),
    ] {
        let arguments = format!("twocolor photo.jpg -o out.png {arguments}");
        let arguments: Vec<_> = arguments.split(' ').collect();
        assert_refused(&ravec(folder.path(), &arguments), 2, words);
    }
    let output = ravec(folder.path(), &["twocolor", "photo.jpg"]);
    assert_eq!(code(&output), 2);
    assert!(stderr(&output).contains("--svg"), "{}", stderr(&output));
    assert_eq!(files(folder.path()), before);
}

#[test]
fn quality_makes_jpeg_files_smaller_or_larger() {
    let folder = photo();
    let length = |quality: u32| {
        done(
            folder.path(),
            &format!("-q twocolor photo.jpg -o out.jpg --quality {quality}"),
        );
        std::fs::metadata(Path::new(folder.path()).join("out.jpg"))
            .unwrap()
            .len()
    };
    assert!(length(20) < length(92) && length(92) < length(100));
}
