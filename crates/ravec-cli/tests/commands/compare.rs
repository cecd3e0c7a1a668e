//! `ravec compare`, and how inputs are refused.

use crate::pictures::bmp;
use crate::program::{assert_refused, code, folder, ravec, stderr, stdout};
use serde_json::Value;

#[test]
fn compare_prints_figures_and_writes_them_as_json() {
    let folder = folder();
    let output = ravec(
        folder.path(),
        &["compare", "a.bmp", "b.bmp", "--json", "r.json"],
    );
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(stdout(&output).contains("psnr_db"), "{}", stdout(&output));
    assert_eq!(stderr(&output), "");
    let text = std::fs::read_to_string(folder.path().join("r.json")).unwrap();
    let report: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["operation"], "compare");
    assert_eq!(report["inputs"][0]["width"], 32);
    assert_eq!(report["inputs"][1]["path"], "b.bmp");
    assert!(report["figures"]["psnr_db"].as_f64().unwrap() > 20.0);
    assert!(!report["timings"].as_array().unwrap().is_empty());
}

#[test]
fn json_on_standard_output_is_all_there_is() {
    let folder = folder();
    let output = ravec(folder.path(), &["compare", "a.bmp", "a.bmp", "--json", "-"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let report: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(
        report["figures"]["psnr_db"],
        Value::Null,
        "equal pictures: infinite"
    );
}

#[test]
fn the_figures_do_not_depend_on_the_threads() {
    let folder = folder();
    let figures = |threads: &str| {
        let arguments = [
            "compare",
            "a.bmp",
            "b.bmp",
            "--json",
            "-",
            "--threads",
            threads,
        ];
        let report: Value =
            serde_json::from_str(&stdout(&ravec(folder.path(), &arguments))).unwrap();
        report["figures"].clone()
    };
    assert_eq!(figures("1"), figures("3"));
}

#[test]
fn inputs_that_are_no_pictures_are_refused_with_one_sentence() {
    let folder = folder();
    std::fs::write(folder.path().join("empty.png"), "").unwrap();
    std::fs::write(
        folder.path().join("text.png"),
        "Dear diary, today I am a picture.\n",
    )
    .unwrap();
    let whole = bmp(32, 24, |_, _| [1, 2, 3]);
    std::fs::write(folder.path().join("cut.bmp"), &whole[..40]).unwrap();
    let vast = [
        &bmp(0, 0, |_, _| [0; 3])[..18],
        &60_000u32.to_le_bytes(),
        &60_000u32.to_le_bytes(),
        &whole[26..],
    ]
    .concat();
    std::fs::write(folder.path().join("vast.bmp"), vast).unwrap();
    for name in [
        "empty.png",
        "text.png",
        "cut.bmp",
        "missing.png",
        "vast.bmp",
        ".",
    ] {
        let output = ravec(
            folder.path(),
            &["compare", "a.bmp", name, "--json", "r.json"],
        );
        assert_refused(&output, 3, &[name]);
        assert!(
            !folder.path().join("r.json").exists(),
            "no report of a failed run"
        );
    }
    let output = ravec(folder.path(), &["compare", "vast.bmp", "a.bmp"]);
    assert_refused(&output, 3, &["60000", "--max-pixels"]);
}

#[test]
fn a_picture_beyond_the_limit_names_the_flag_that_raises_it() {
    let folder = folder();
    let output = ravec(
        folder.path(),
        &["compare", "a.bmp", "b.bmp", "--max-pixels", "700"],
    );
    assert_refused(&output, 3, &["a.bmp", "--max-pixels"]);
    let output = ravec(
        folder.path(),
        &["compare", "a.bmp", "b.bmp", "--max-bytes", "1k"],
    );
    assert_refused(&output, 3, &["a.bmp", "--max-bytes"]);
}

#[test]
fn pictures_of_different_sizes_cannot_be_compared() {
    let folder = folder();
    std::fs::write(folder.path().join("c.bmp"), bmp(31, 24, |_, _| [0; 3])).unwrap();
    let output = ravec(folder.path(), &["compare", "a.bmp", "c.bmp"]);
    assert_refused(&output, 3, &["32 x 24", "31 x 24"]);
}
