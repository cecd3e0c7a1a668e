//! `complete` on files.

use super::*;
use crate::ErrorKind;
use ravec::raster::{Rect, Size, Srgb};
use ravec_media::Picture;

fn tile(col: usize, row: usize) -> Srgb<u8> {
    Srgb(if col % 16 < 2 || row % 12 < 2 {
        [210, 205, 190]
    } else {
        [100, 60, 50]
    })
}

fn write(folder: &Path, name: &str, image: impl Into<AnyImage>) -> PathBuf {
    let path = folder.join(name);
    ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default()).unwrap();
    path
}

fn done(
    input: &Path,
    mask: Option<&PathBuf>,
    output: &Path,
    params: &Params,
) -> Result<Report, JobError> {
    let files = Files {
        mask: mask.cloned(),
        ..Files::default()
    };
    run(input, &files, output, params)
}

/// Files of [`run`] beside the picture and the output.
#[derive(Clone, Default)]
struct Files {
    mask: Option<PathBuf>,
    photos: Vec<PathBuf>,
    replay: Option<PathBuf>,
    recorded: Option<RecordedSteps>,
    steps: Option<PathBuf>,
}

fn run(input: &Path, files: &Files, output: &Path, params: &Params) -> Result<Report, JobError> {
    let operation = Complete {
        input: input.to_path_buf(),
        mask: files.mask.clone(),
        features: None,
        sources: files.photos.clone(),
        replay: files.replay.clone(),
        recorded: files.recorded.clone(),
        steps: files.steps.clone(),
        output: output.to_path_buf(),
        params: params.clone(),
    };
    operation.run(&Context::default())
}

fn folder() -> (tempfile::TempDir, PathBuf, PathBuf, Size) {
    let folder = tempfile::tempdir().unwrap();
    let size = Size::new(96, 72).unwrap();
    let hole = Rect::new(40, 30, 18, 16);
    let stained = Image::from_fn(size, |col, row| {
        if hole.contains(col, row) {
            Srgb([0, 0, 0])
        } else {
            tile(col, row)
        }
    });
    let mask = Image::from_fn(size, |col, row| {
        Srgb([255 * u8::from(hole.contains(col, row)); 3])
    });
    let (input, mask) = (
        write(folder.path(), "in.png", stained),
        write(folder.path(), "mask.png", mask),
    );
    (folder, input, mask, size)
}

#[test]
fn a_stain_on_tiles_goes_and_the_report_says_how() {
    let (folder, input, mask, _) = folder();
    let output = folder.path().join("out.png");
    let report = done(&input, Some(&mask), &output, &Params::default()).unwrap();
    assert_eq!(report.figures["hole_px"], 18.0 * 16.0);
    assert_eq!(report.details.as_ref().unwrap()["hole_px"], 18 * 16);
    assert!(report.figures["offsets"] >= 1.0 && report.warnings.is_empty());
    let found = ravec_media::read(&output, &ravec_media::Limits::default())
        .unwrap()
        .image
        .convert::<Srgb<u8>>();
    let off = (0..96 * 72).filter(|index| {
        let (col, row) = (index % 96, index / 96);
        found[(col, row)].0[0].abs_diff(tile(col, row).0[0]) > 8
    });
    // seams cost a pixel here and there
    assert!(off.count() < 9);
}

#[test]
fn an_empty_mask_gives_the_picture_back_with_a_note() {
    let (folder, input, _, size) = folder();
    let mask = write(folder.path(), "black.png", Image::new(size, Srgb([0u8; 3])));
    let output = folder.path().join("out.png");
    let report = done(&input, Some(&mask), &output, &Params::default()).unwrap();
    assert_eq!(
        report.warnings,
        ["the mask is empty: the picture is as it was"]
    );
    let image = |path: &Path| {
        ravec_media::read(path, &ravec_media::Limits::default())
            .unwrap()
            .image
    };
    assert_eq!(image(&output), image(&input));
}

#[test]
fn what_cannot_be_done_has_its_sentence_and_its_kind() {
    let (folder, input, mask, size) = folder();
    let output = folder.path().join("out.png");
    let small = write(
        folder.path(),
        "small.png",
        Image::new(Size::new(9, 9).unwrap(), Srgb([0u8; 3])),
    );
    let white = write(
        folder.path(),
        "white.png",
        Image::new(size, Srgb([255u8; 3])),
    );
    let plane = |text: &str| Params {
        planes: vec![text.parse().unwrap()],
        ..Params::default()
    };
    for (mask, params, kind, part) in [
        (Some(&small), Params::default(), ErrorKind::Input, "96 x 72"),
        (
            Some(&white),
            Params::default(),
            ErrorKind::Input,
            "radius of 0.0 pixels",
        ),
        (
            None,
            Params::default(),
            ErrorKind::Request,
            "`mask` or `polygons`",
        ),
        (
            Some(&mask),
            plane("0,0,90,70,90,0,0,70"),
            ErrorKind::Request,
            "crosses itself",
        ),
        (
            Some(&mask),
            plane("0,0,90,0,20,15,0,70"),
            ErrorKind::Request,
            "horizon",
        ),
        (
            Some(&mask),
            plane("500,0,590,0,590,70,500,70"),
            ErrorKind::Request,
            "outside",
        ),
        (
            Some(&mask),
            plane("0,0,90,0"),
            ErrorKind::Request,
            "4 corners",
        ),
        (
            Some(&mask),
            Params {
                search: 1,
                ..Params::default()
            },
            ErrorKind::Request,
            "`search`",
        ),
    ] {
        let error = done(&input, mask, &output, &params).unwrap_err();
        assert_eq!(error.kind(), kind, "{error}");
        assert!(error.to_string().contains(part), "{error}");
    }
    assert!(!output.exists());
}

#[test]
fn corners_are_pairs_of_numbers_or_none() {
    let corners = |text: &str| text.parse::<Corners>();
    assert_eq!(corners("none"), Ok(Corners::default()));
    assert_eq!(corners(""), Ok(Corners::default()));
    assert_eq!(
        corners("1, 2.5,-3,4").unwrap().0,
        [DVec2::new(1.0, 2.5), DVec2::new(-3.0, 4.0)]
    );
    for wrong in ["1", "1,2,3", "1,x", "nan,1", "1,,2,3"] {
        assert!(corners(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn a_polygon_is_a_mask_as_well() {
    let (folder, input, _, _) = folder();
    let params = Params {
        polygons: vec!["40,30,58,30,58,46,40,46".parse().unwrap()],
        ..Params::default()
    };
    let output = folder.path().join("out.png");
    let report = done(&input, None, &output, &params).unwrap();
    assert_eq!(report.figures["hole_px"], 18.0 * 16.0);
}

#[test]
fn steps_are_written_replayed_to_the_same_bytes_and_undone() {
    let (folder, input, mask, _) = folder();
    let at = |name: &str| folder.path().join(name);
    let first = Files {
        mask: Some(mask.clone()),
        steps: Some(at("steps.json")),
        ..Files::default()
    };
    let params = Params {
        radius: Some(12),
        ..Params::default()
    };
    let report = run(&input, &first, &at("a.png"), &params).unwrap();
    assert_eq!(report.figures["open_px"], 0.0);
    let steps = report.figures["steps"];
    assert!(steps >= 2.0);
    let again = Files {
        mask: Some(mask),
        replay: Some(at("steps.json")),
        steps: Some(at("again.json")),
        ..Files::default()
    };
    run(&input, &again, &at("b.png"), &Params::default()).unwrap();
    let bytes = |name: &str| std::fs::read(at(name)).unwrap();
    assert_eq!(bytes("a.png"), bytes("b.png"));
    assert_eq!(bytes("steps.json"), bytes("again.json"));
    let inline = Files {
        replay: None,
        recorded: Some(serde_json::from_slice(&bytes("steps.json")).unwrap()),
        ..again.clone()
    };
    run(&input, &inline, &at("d.png"), &Params::default()).unwrap();
    assert_eq!(bytes("a.png"), bytes("d.png"));
    let both = Files {
        replay: again.replay.clone(),
        ..inline
    };
    assert!(run(&input, &both, &at("e.png"), &Params::default()).is_err());
    let undo = Params {
        undo: steps as usize,
        ..Params::default()
    };
    let report = run(&input, &again, &at("c.png"), &undo).unwrap();
    assert_eq!(report.figures["open_px"], 18.0 * 16.0);
    let image = |path: &Path| {
        ravec_media::read(path, &ravec_media::Limits::default())
            .unwrap()
            .image
    };
    assert_eq!(image(&at("c.png")), image(&input));
}

#[test]
fn a_target_is_filled_from_another_photo() {
    let (folder, input, mask, size) = folder();
    let whole = write(folder.path(), "whole.png", Image::from_fn(size, tile));
    let files = Files {
        mask: Some(mask),
        photos: vec![whole],
        ..Files::default()
    };
    let params = Params {
        targets: vec!["49,38".parse().unwrap()],
        radius: Some(16),
        ..Params::default()
    };
    let output = folder.path().join("out.png");
    let report = run(&input, &files, &output, &params).unwrap();
    assert_eq!(
        (report.figures["open_px"], report.figures["buffers"]),
        (0.0, 2.0)
    );
    let found: Image<Srgb<u8>> = ravec_media::read(&output, &ravec_media::Limits::default())
        .unwrap()
        .image
        .convert();
    assert_eq!(found, Image::from_fn(size, tile));
}

#[test]
fn what_fragments_cannot_do_has_its_sentence_and_its_kind() {
    let (folder, input, mask, _) = folder();
    let output = folder.path().join("out.png");
    let broken = folder.path().join("broken.json");
    let other = folder.path().join("other.json");
    crate::files::write_text(&broken, "{").unwrap();
    crate::files::write_text(&other, r#"{"width": 9, "height": 9, "steps": []}"#).unwrap();
    let file = |replay: &Path| Files {
        replay: Some(replay.to_path_buf()),
        ..Files::default()
    };
    let with = |change: &dyn Fn(&mut Params)| {
        let mut params = Params::default();
        change(&mut params);
        params
    };
    for (files, params, kind, part) in [
        (
            Files::default(),
            with(&|p| p.radius = Some(1)),
            ErrorKind::Request,
            "2 to 124",
        ),
        (
            Files::default(),
            with(&|p| p.radius = Some(60)),
            ErrorKind::Request,
            "largest usable radius",
        ),
        (
            Files::default(),
            with(&|p| p.scales = vec![9.0]),
            ErrorKind::Request,
            "0.25 to 4",
        ),
        (
            Files::default(),
            with(&|p| p.targets = vec!["500,1".parse().unwrap()]),
            ErrorKind::Request,
            "outside",
        ),
        (
            Files::default(),
            with(&|p| (p.engine, p.mirror) = (Some(Engine::Offsets), true)),
            ErrorKind::Request,
            "`mirror`",
        ),
        (
            file(&broken),
            Params::default(),
            ErrorKind::Input,
            "form of steps",
        ),
        (file(&other), Params::default(), ErrorKind::Input, "9 x 9"),
    ] {
        let files = Files {
            mask: Some(mask.clone()),
            ..files
        };
        let error = run(&input, &files, &output, &params).unwrap_err();
        assert_eq!(error.kind(), kind, "{error}");
        assert!(error.to_string().contains(part), "{error}");
    }
    assert!(!output.exists());
}
