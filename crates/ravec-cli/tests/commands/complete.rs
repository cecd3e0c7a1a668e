//! `ravec complete`: what stays, what is refused, and what is said.

use crate::pictures::bmp;
use crate::program::{assert_refused, code, ravec, report, stderr};

/// A folder with tiles, `in.bmp`, and the mask of a stain on them, `mask.bmp`.
fn tiles() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let inside = |col: usize, row: usize| (40..58).contains(&col) && (30..46).contains(&row);
    let tile = |col: usize, row: usize| match (inside(col, row), col % 16 < 2 || row % 12 < 2) {
        (true, _) => [0, 0, 0],
        (_, true) => [210, 205, 190],
        _ => [100, 60, 50],
    };
    std::fs::write(folder.path().join("in.bmp"), bmp(96, 72, tile)).unwrap();
    let mask = bmp(96, 72, |col, row| [255 * u8::from(inside(col, row)); 3]);
    std::fs::write(folder.path().join("mask.bmp"), mask).unwrap();
    std::fs::write(folder.path().join("small.bmp"), bmp(9, 9, |_, _| [0; 3])).unwrap();
    std::fs::write(
        folder.path().join("white.bmp"),
        bmp(96, 72, |_, _| [255; 3]),
    )
    .unwrap();
    std::fs::write(folder.path().join("black.bmp"), bmp(96, 72, |_, _| [0; 3])).unwrap();
    folder
}

#[test]
fn a_stain_goes_with_the_same_bytes_on_any_number_of_threads() {
    let folder = tiles();
    let written = |threads: &str, plane: &str| {
        let arguments = [
            "complete",
            "in.bmp",
            "--mask",
            "mask.bmp",
            "-o",
            "out.bmp",
            "--plane",
            plane,
            "--threads",
            threads,
        ];
        let output = ravec(folder.path(), &arguments);
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        std::fs::read(folder.path().join("out.bmp")).unwrap()
    };
    for plane in ["none", "", "-4,2,99,0,96,72,0,70"] {
        assert_eq!(written("1", plane), written("3", plane), "{plane}");
    }
}

#[test]
fn the_report_says_what_was_filled_and_how() {
    let folder = tiles();
    let found = report(
        folder.path(),
        "complete in.bmp --mask mask.bmp -o out.png --plane 0,0,96,0,96,72,0,72",
    );
    assert_eq!(found["figures"]["hole_px"], 288.0);
    assert_eq!(
        found["figures"]["plane_px"],
        288.0 - found["figures"]["thin_px"].as_f64().unwrap()
    );
    let nothing = report(folder.path(), "complete in.bmp --mask black.bmp -o out.png");
    assert_eq!(
        nothing["warnings"][0],
        "the mask is empty: the picture is as it was"
    );
}

#[test]
fn what_makes_no_sense_is_refused_with_one_sentence() {
    let folder = tiles();
    let run = |mask: &str, plane: &str| {
        ravec(
            folder.path(),
            &[
                "complete", "in.bmp", "-m", mask, "-o", "out.png", "--plane", plane,
            ],
        )
    };
    assert_refused(&run("small.bmp", "none"), 3, &["96 x 72", "9 x 9"]);
    assert_refused(
        &run("white.bmp", "none"),
        3,
        &["nothing to copy from", "radius"],
    );
    assert_refused(
        &run("mask.bmp", "0,0,90,70,90,0,0,70"),
        2,
        &["crosses itself"],
    );
    assert_refused(&run("mask.bmp", "0,0,90,0,20,15,0,70"), 2, &["horizon"]);
    assert_refused(
        &run("mask.bmp", "500,0,590,0,590,70,500,70"),
        2,
        &["outside"],
    );
    assert_refused(
        &run("mask.bmp", "0,0,90,0,90,70"),
        2,
        &["--plane", "4 corners"],
    );
    assert!(!folder.path().join("out.png").exists());
}
