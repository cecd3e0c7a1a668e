//! `ravec demo`.

use crate::program::{done, photos, ravec, report};

#[test]
fn one_page_holds_all_its_pictures_and_the_figures_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    photos(folder.path());
    for (source, out) in [("", "street"), (" --image photo.jpg", "photo")] {
        let arguments = format!("demo --max-side 80 --out {out}/deep{source}");
        let report = report(folder.path(), &arguments);
        assert_eq!(report["operation"], "demo");
        let page = format!("{out}/deep/index.html");
        assert_eq!(report["outputs"][0]["path"], *page);
        for figure in [
            "twocolor_psnr_db",
            "mosaic_psnr_db",
            "clean_psnr_db",
            "noisy_psnr_db",
            "fit_megapixels_per_second",
        ] {
            assert!(
                report["figures"][figure].as_f64().unwrap() > 0.0,
                "{figure}"
            );
        }
        let html = std::fs::read_to_string(folder.path().join(page)).unwrap();
        assert!(html.contains("<html") && html.trim_end().ends_with("</html>"));
        let outside = ["src=\"http", "href=\"http", "<script src"];
        assert!(
            outside.iter().all(|link| !html.contains(link)),
            "needs no other file"
        );
    }
}

#[test]
fn it_says_where_the_page_is() {
    let folder = tempfile::tempdir().unwrap();
    photos(folder.path());
    let said = done(folder.path(), "demo --image photo.jpg --max-side 64");
    assert!(said.contains("wrote ravec-demo/index.html"), "{said}");
}

#[test]
fn a_side_out_of_range_and_a_photo_that_is_none_make_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("text.jpg"), "no photo").unwrap();
    for (arguments, code) in [
        (["demo", "--max-side", "63"], 2),
        (["demo", "--image", "text.jpg"], 3),
        (["demo", "--image", "missing.jpg"], 3),
        (["demo", "--out", "text.jpg"], 4),
        (["demo", "--out", "text.jpg/gallery"], 4),
    ] {
        let output = ravec(folder.path(), &arguments);
        crate::program::assert_refused(&output, code, &[]);
        assert!(!folder.path().join("ravec-demo").exists());
    }
}
