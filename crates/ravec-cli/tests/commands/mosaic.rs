//! `ravec library` and `ravec mosaic`: what is refused, and what is left behind.

use crate::pictures::bmp;
use crate::program::{assert_refused, code, ravec, stderr};
use std::path::Path;

/// A folder with thirty photos of 64 × 48 pixels in `photos`, their catalogue `c.ravec`, and a picture `in.bmp`.
pub fn studio() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("photos")).unwrap();
    for number in 0..30usize {
        let tone = |step: usize| (number * step % 30 * 6) as u8;
        let photo = bmp(64, 48, |col, row| {
            [tone(1) + (col / 2) as u8, tone(7) + row as u8, tone(11)]
        });
        std::fs::write(folder.path().join(format!("photos/{number:02}.bmp")), photo).unwrap();
    }
    let picture = bmp(96, 72, |col, row| [(2 * col) as u8, (3 * row) as u8, 90]);
    std::fs::write(folder.path().join("in.bmp"), picture).unwrap();
    let added = ravec(
        folder.path(),
        &["library", "add", "photos", "--catalogue", "c.ravec"],
    );
    assert_eq!(code(&added), 0, "{}", stderr(&added));
    folder
}

fn mosaic(folder: &Path, more: &[&str]) -> std::process::Output {
    let mut arguments = vec![
        "mosaic",
        "in.bmp",
        "--catalogue",
        "c.ravec",
        "-o",
        "out.png",
    ];
    arguments.extend_from_slice(more);
    ravec(folder, &arguments)
}

#[test]
fn a_missing_photo_is_a_warning_and_the_report_says_which_photo_is_where() {
    let folder = studio();
    std::fs::remove_file(folder.path().join("photos/07.bmp")).unwrap();
    let flags = [
        "--tiles",
        "4x3",
        "--tile-size",
        "32x24",
        "--min-repeat-distance",
        "2",
        "--json",
        "r.json",
    ];
    let made = mosaic(folder.path(), &flags);
    assert_eq!(code(&made), 0, "{}", stderr(&made));
    assert!(stderr(&made).contains("07.bmp: is no longer there; others took its place"));
    let text = std::fs::read_to_string(folder.path().join("r.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["result"]["photos"].as_array().unwrap().len(), 12);
    assert!(
        report["figures"]["nearest_repeat"]
            .as_f64()
            .is_none_or(|distance| distance >= 2.0)
    );
    assert_eq!(report["outputs"][0]["width"], 128);
}

#[test]
fn photos_are_pinned_and_banned_by_the_paths_that_the_catalogue_lists() {
    let folder = studio();
    let path = folder.path();
    let flags = [
        "--tiles",
        "4x3",
        "--tile-size",
        "32x24",
        "--min-repeat-distance",
        "0",
        "--json",
        "r.json",
    ];
    let photos = || -> Vec<String> {
        let text = std::fs::read_to_string(path.join("r.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        serde_json::from_value(report["result"]["photos"].clone()).unwrap()
    };
    assert_eq!(code(&mosaic(path, &flags)), 0);
    let free = photos();
    let listed = ravec(path, &["library", "list", "--catalogue", "c.ravec"]);
    let listed: serde_json::Value = serde_json::from_slice(&listed.stdout).unwrap();
    let listed = listed.as_array().unwrap().iter();
    let listed: Vec<&str> = listed
        .map(|photo| photo["path"].as_str().unwrap())
        .collect();
    let pinned = *listed
        .iter()
        .find(|photo| free.iter().all(|other| other != *photo))
        .unwrap();
    let banned = &free[0];
    let pin = format!("2,1:{pinned}");
    let ban_here = format!("3,2:{}", free[11]);
    let by_hand = ["--pin", &pin, "--ban", banned, "--ban", &ban_here];
    let made = mosaic(path, &[&flags[..], &by_hand].concat());
    assert_eq!(code(&made), 0, "{}", stderr(&made));
    let chosen = photos();
    assert_eq!(chosen[6], pinned);
    assert!(chosen.iter().all(|photo| photo != banned));
    assert_ne!(chosen[11], free[11]);
    // from the present folder
    let relative = mosaic(
        path,
        &[&flags[..], &["--pin", "0,0:photos/29.bmp"]].concat(),
    );
    assert_eq!(code(&relative), 0, "{}", stderr(&relative));
    assert!(photos()[0].ends_with("photos/29.bmp"));

    let refused = |more: &[&str], expected: i32, words: &str| {
        let made = mosaic(path, &[&flags[..], more].concat());
        assert_refused(&made, expected, &[words]);
    };
    refused(
        &["--ban", "none.bmp"],
        3,
        "has no photo none.bmp that can be used",
    );
    refused(&["--pin", "4,0:photos/00.bmp"], 2, "there is no tile 4,0");
    let both = ["--pin", "1,1:photos/03.bmp", "--ban", "photos/03.bmp"];
    refused(&both, 2, "photos/03.bmp is both pinned and banned");
    let adaptive = ["--adaptive", "--tile-size", "33x24", "--crop", "center"];
    let off_the_grid = [&adaptive[..], &["--pin", "1,1:photos/03.bmp"]].concat();
    let made = mosaic(path, &[&["--tiles", "4x3"], &off_the_grid[..]].concat());
    assert_refused(&made, 2, &["an adaptive mosaic have no columns and rows"]);
    let wrong = mosaic(path, &[&flags[..], &["--pin", "photos/03.bmp"]].concat());
    assert_eq!(code(&wrong), 2);
    assert!(stderr(&wrong).contains("write COL,ROW:PHOTO"));
}

#[test]
fn a_page_that_zooms_is_a_folder_and_a_preview_is_small() {
    let folder = studio();
    let path = folder.path();
    let zoom = [
        "mosaic",
        "in.bmp",
        "--catalogue",
        "c.ravec",
        "--deep-zoom",
        "zoom",
    ];
    let flags = [
        "--tiles",
        "4x3",
        "--tile-size",
        "320x240",
        "--min-repeat-distance",
        "2",
    ];
    let made = ravec(path, &[&zoom[..], &flags].concat());
    assert_eq!(code(&made), 0, "{}", stderr(&made));
    assert!(path.join("zoom/index.html").is_file());
    // 1280 x 720 pixels are 5 x 3 pieces on the level of 2048
    assert!(path.join("zoom/mosaic_files/11/4_2.jpg").is_file());
    // once more in the same place, and not with something else in it
    let made = ravec(path, &[&zoom[..], &flags].concat());
    assert_eq!(code(&made), 0, "{}", stderr(&made));
    std::fs::write(path.join("zoom/mosaic_files/letter.txt"), "x").unwrap();
    let made = ravec(path, &[&zoom[..], &flags].concat());
    assert_refused(&made, 4, &["zoom: mosaic_files/letter.txt in it is a file"]);
    assert!(path.join("zoom/mosaic_files/letter.txt").is_file());
    let wide = [
        "--tiles",
        "4x3",
        "--tile-size",
        "640x480",
        "--min-repeat-distance",
        "2",
    ];
    let made = mosaic(
        path,
        &[&wide[..], &["--preview", "--json", "r.json"]].concat(),
    );
    assert_eq!(code(&made), 0, "{}", stderr(&made));
    let text = std::fs::read_to_string(path.join("r.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["outputs"][0]["width"], 1600);

    let nowhere = ravec(path, &zoom[..4]);
    assert_eq!(code(&nowhere), 2);
    assert!(stderr(&nowhere).contains("--output"));
    let taken = [&zoom[..5], &["photos"]].concat();
    let made = ravec(path, &[&taken[..], &flags].concat());
    assert_refused(&made, 2, &["photos: photos of the catalogue are in it"]);
    std::fs::create_dir(path.join("other")).unwrap();
    std::fs::write(path.join("other/letter.txt"), "x").unwrap();
    let taken = [&zoom[..5], &["other"]].concat();
    let made = ravec(path, &[&taken[..], &flags].concat());
    assert_refused(
        &made,
        4,
        &["other: letter.txt in it is a file that is not of an earlier page"],
    );
}

#[test]
fn the_default_tile_can_be_cut_into_thirds_where_tiles_are_adaptive() {
    let folder = studio();
    let flags = "--tiles 3x2 --min-repeat-distance 0 --crop center --json r.json";
    for (adaptive, side) in [(&[][..], 64), (&["--adaptive"][..], 66)] {
        let flags: Vec<&str> = flags.split(' ').chain(adaptive.iter().copied()).collect();
        let made = mosaic(folder.path(), &flags);
        assert_eq!(code(&made), 0, "{}", stderr(&made));
        let text = std::fs::read_to_string(folder.path().join("r.json")).unwrap();
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(report["outputs"][0]["width"], 3 * side);
    }
}

#[test]
fn what_cannot_be_is_one_sentence_and_leaves_no_file() {
    let folder = studio();
    let path = folder.path();
    let before = std::fs::read_dir(path).unwrap().count();
    for (flags, expected, words) in [
        (
            &["--tiles", "200x3"][..],
            3,
            &["too few for 200 x 3 tiles"][..],
        ),
        (
            &["--tiles", "4x3", "--tile-size", "20"],
            3,
            &["proportions", "20 x 20", "--crop center"],
        ),
        (
            &[
                "--tiles",
                "9x9",
                "--tile-size",
                "20x15",
                "--min-repeat-distance",
                "9",
            ],
            1,
            &["too few photos (30 that differ)"],
        ),
        (
            &["--tiles", "8x8", "--tile-size", "20x15", "--max-uses", "2"],
            1,
            &["64 tiles need more than 30"],
        ),
        (
            &["--tiles", "4x3", "--tile-size", "20x15", "--use-all"],
            1,
            &["cannot all be used in 12 tiles"],
        ),
        (
            &["--tiles", "4x3", "--tile-size", "32x24", "--adaptive"],
            2,
            &["thirds of 32 x 24 pixels", "multiples of 3"],
        ),
        (
            &["--detail", "2"],
            2,
            &["--detail is 2, but must be 0 to 1"],
        ),
    ] {
        assert_refused(&mosaic(path, flags), expected, words);
    }
    let no = [
        "mosaic",
        "in.bmp",
        "--catalogue",
        "no.ravec",
        "-o",
        "out.png",
    ];
    assert_refused(&ravec(path, &no), 3, &["there is no catalogue no.ravec"]);
    let other = [
        "mosaic",
        "in.bmp",
        "--catalogue",
        "photos/01.bmp",
        "-o",
        "out.png",
    ];
    assert_refused(
        &ravec(path, &other),
        3,
        &["photos/01.bmp is not a catalogue of photos"],
    );
    let format = [
        "mosaic",
        "in.bmp",
        "--catalogue",
        "c.ravec",
        "-o",
        "out.webp",
    ];
    assert_refused(&ravec(path, &format), 2, &["out.webp", ".tif"]);
    let nowhere = ["library", "add", "nowhere", "--catalogue", "new.ravec"];
    assert_refused(&ravec(path, &nowhere), 3, &["cannot add nowhere"]);
    assert_eq!(std::fs::read_dir(path).unwrap().count(), before);
}

#[test]
fn an_empty_catalogue_and_photos_that_are_all_alike_are_refused() {
    let folder = studio();
    let path = folder.path();
    std::fs::create_dir(path.join("none")).unwrap();
    let empty = ravec(
        path,
        &["library", "add", "none", "--catalogue", "empty.ravec"],
    );
    assert_eq!(code(&empty), 0);
    let made = [
        "mosaic",
        "in.bmp",
        "--catalogue",
        "empty.ravec",
        "-o",
        "out.png",
    ];
    assert_refused(&ravec(path, &made), 3, &["has no photo that can be used"]);

    std::fs::create_dir(path.join("alike")).unwrap();
    for number in 0..3u8 {
        let photo = bmp(64, 48, |col, row| {
            [(3 * col) as u8, (5 * row) as u8, number]
        });
        std::fs::write(path.join(format!("alike/{number}.bmp")), photo).unwrap();
    }
    let alike = ravec(
        path,
        &["library", "add", "alike", "--catalogue", "alike.ravec"],
    );
    assert_eq!(code(&alike), 0);
    let made = [
        "mosaic",
        "in.bmp",
        "--catalogue",
        "alike.ravec",
        "-o",
        "out.png",
        "--tiles",
        "4x3",
        "--tile-size",
        "32x24",
    ];
    assert_refused(&ravec(path, &made), 1, &["too few photos (1 that differ)"]);
}
