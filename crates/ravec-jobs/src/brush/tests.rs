//! Strokes and operators on files.

use super::*;
use crate::ErrorKind;
use ravec::raster::AnyImage;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        let image = Image::from_fn(Size::new(60, 40).unwrap(), |col, row| {
            let texture = ((col * 7 + row * 13) % 9) as u8;
            if col > 30 {
                Srgb([150 + texture, 140, 130])
            } else {
                Srgb([60, 70 + texture, 90])
            }
        });
        ravec_media::write(
            folder.path("in.png"),
            &Picture::from_image(image),
            &WriteOptions::default(),
        )
        .unwrap();
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, strokes: Option<&str>, params: &Params) -> Result<Report, JobError> {
        let path = self.path("strokes.json");
        if let Some(text) = strokes {
            files::write_text(&path, text).unwrap();
        }
        let operation = Brush {
            input: self.path("in.png"),
            output: self.path("out.png"),
            everywhere: strokes.is_none(),
            stroke: strokes.map(|_| path),
            strokes: None,
            mask: Some(self.path("mask.png")),
            params: params.clone(),
        };
        operation.run(&Context::default())
    }

    fn image(&self, name: &str) -> Image<Srgb<u8>> {
        match ravec_media::read(self.path(name), &ravec_media::Limits::default())
            .unwrap()
            .image
        {
            AnyImage::Srgb8(image) => image,
            other => panic!("{:?}", other.size()),
        }
    }
}

#[test]
fn every_operator_works_on_the_whole_picture() {
    let folder = Folder::new();
    for mode in [
        BrushMode::Abstract,
        BrushMode::Smooth,
        BrushMode::Sharpen,
        BrushMode::Clean,
        BrushMode::Antialias,
        BrushMode::Stamp,
    ] {
        folder
            .run(
                None,
                &Params {
                    mode,
                    ..Params::default()
                },
            )
            .unwrap();
        assert_eq!(folder.image("out.png").size(), Size::new(60, 40).unwrap());
    }
    let enlarged = Params {
        mode: BrushMode::Antialias,
        scale: 3.0,
        ..Params::default()
    };
    folder.run(None, &enlarged).unwrap();
    assert_eq!(folder.image("out.png").size(), Size::new(180, 120).unwrap());
}

#[test]
fn plain_points_are_a_stroke_with_the_flags_settings() {
    let folder = Folder::new();
    let params = Params {
        mode: BrushMode::Color,
        radius: 6.0,
        color: [250, 0, 0],
        ..Params::default()
    };
    let report = folder.run(Some("[[10, 20], [20, 20]]"), &params).unwrap();
    assert!(report.figures["touched_pixels"] > 100.0);
    let (before, after) = (folder.image("in.png"), folder.image("out.png"));
    assert_eq!(after[(15, 20)], Srgb([250, 0, 0]));
    for (row, col) in (0..40).flat_map(|row| (0..60).map(move |col| (row, col))) {
        let far = !(3..27).contains(&col) || !(13..27).contains(&row);
        assert!(!far || before[(col, row)] == after[(col, row)]);
    }
}

#[test]
fn lists_of_strokes_select_undo_and_warn() {
    let folder = Folder::new();
    let list = r#"{"version":1,"width":60,"height":40,"strokes":[
        {"tool":"mask","points":[[10,20]],"radius_px":5},
        {"tool":"burn","points":[[40,20]],"radius_px":5},
        {"tool":"dodge","points":[[400,20]],"radius_px":5}]}"#;
    let report = folder.run(Some(list), &Params::default()).unwrap();
    assert_eq!(report.warnings.len(), 1);
    assert_eq!(folder.image("mask.png")[(10, 20)], Srgb([255; 3]));
    assert_ne!(folder.image("out.png"), folder.image("in.png"));
    folder
        .run(
            Some(list),
            &Params {
                undo: 2,
                ..Params::default()
            },
        )
        .unwrap();
    assert_eq!(folder.image("out.png"), folder.image("in.png"));
}

#[test]
fn a_plain_list_of_strokes_was_drawn_on_this_picture() {
    let folder = Folder::new();
    let strokes = r#"[{"tool":"burn","points":[[40,20]],"radius_px":5}]"#;
    folder.run(Some(strokes), &Params::default()).unwrap();
    let plain = folder.image("out.png");
    let sized = format!(r#"{{"version":1,"width":60,"height":40,"strokes":{strokes}}}"#);
    folder.run(Some(&sized), &Params::default()).unwrap();
    assert_eq!(folder.image("out.png"), plain);
    assert_ne!(plain, folder.image("in.png"));
}

#[test]
fn strokes_that_make_no_sense_are_an_input_error() {
    let folder = Folder::new();
    for text in [
        "",
        "nonsense",
        "[[1]]",
        "[[NaN, 1]]",
        "[[1e999, 1]]",
        "[{}]",
        "[]",
        "{}",
        r#"{"version":7,"width":1,"height":1,"strokes":[]}"#,
    ] {
        let error = folder.run(Some(text), &Params::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input, "{text}: {error}");
        assert!(!folder.path("out.png").exists());
    }
}

#[test]
fn parameters_out_of_range_are_refused() {
    let folder = Folder::new();
    for wrong in [
        Params {
            strength: 2.0,
            ..Params::default()
        },
        Params {
            iterations: 0,
            ..Params::default()
        },
        Params {
            window: 8,
            ..Params::default()
        },
        Params {
            noise_sigma: Some(-1.0),
            ..Params::default()
        },
        Params {
            scale: 2.0,
            ..Params::default()
        },
        Params {
            radius: 0.0,
            ..Params::default()
        },
        Params {
            hardness: f64::NAN,
            ..Params::default()
        },
        Params {
            amount: 5.0,
            ..Params::default()
        },
        Params {
            quality: 101,
            ..Params::default()
        },
        Params {
            mode: BrushMode::Dodge,
            ..Params::default()
        },
    ] {
        let error = folder.run(None, &wrong).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Request, "{error}");
    }
}
