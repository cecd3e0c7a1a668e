//! Pictures of mesh files.

use super::*;
use crate::ErrorKind;
use crate::mesh::{MeshTarget, write_mesh_file};
use ravec::mesh_io::MeshFormat;
use ravec::progress::Progress;
use ravec::raster::Srgba;
use ravec_scenes::solids::{cuboid, icosphere};
use std::path::PathBuf;

struct Studio {
    folder: tempfile::TempDir,
}

impl Studio {
    fn new() -> Self {
        let studio = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        for (name, mesh) in [
            ("box.off", cuboid([2.0, 1.0, 1.0].into()).mesh),
            ("ball.off", icosphere(1.0, 4).mesh),
            ("large.off", icosphere(1.2, 3).mesh),
            ("none.off", TriMesh::default()),
        ] {
            let target = MeshTarget::new(MeshFormat::Off);
            write_mesh_file(&studio.at(name), &mesh, &target, &Progress::none()).unwrap();
        }
        studio
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn rendered(
        &self,
        name: &str,
        other: Option<&str>,
        params: &Params,
    ) -> Result<(Image<Srgba<u8>>, Report), JobError> {
        let out = self.at("out.png");
        let operation = Render {
            input: self.at(name),
            output: out.clone(),
            compare: other.map(|name| self.at(name)),
            params: params.clone(),
        };
        let report = operation.run(&Context::default())?;
        let picture = ravec_media::read(&out, &crate::Limits::default()).unwrap();
        Ok((picture.convert(), report))
    }
}

fn small() -> Params {
    Params {
        width: 60,
        height: 40,
        ..Params::default()
    }
}

#[test]
fn the_mesh_is_in_the_middle_and_the_background_around_it() {
    let studio = Studio::new();
    let params = Params {
        view: Viewpoint(View::FRONT),
        ..small()
    };
    let (image, report) = studio.rendered("box.off", None, &params).unwrap();
    assert_eq!((image.width(), image.height()), (60, 40));
    assert_ne!(image.get(30, 20).unwrap().0, [255; 4]);
    assert_eq!(image.get(0, 0).unwrap().0, [255; 4]);
    assert_eq!(report.outputs[0].format, "PNG");
    let clear = Params {
        transparent: true,
        ..params
    };
    let (image, _) = studio.rendered("box.off", None, &clear).unwrap();
    assert_eq!(image.get(0, 0).unwrap().0[3], 0);
    assert_eq!(image.get(30, 20).unwrap().0[3], 255);
}

#[test]
fn a_cut_shows_its_color_where_the_solid_was_opened() {
    let studio = Studio::new();
    let params = Params {
        view: Viewpoint(View::RIGHT),
        section: Some("x=40%".parse().unwrap()),
        cut_color: [0, 0, 255],
        no_features: true,
        ..small()
    };
    let blue = |params: &Params| {
        let (image, _) = studio.rendered("box.off", None, params).unwrap();
        let [r, _, b, _] = image.get(30, 20).unwrap().0;
        b > r
    };
    assert!(blue(&params));
    let hollow = Params {
        hollow: true,
        ..params.clone()
    };
    assert!(!blue(&hollow), "the inside is red");
}

#[test]
fn colors_stand_for_distances_within_the_range() {
    let studio = Studio::new();
    let (_, report) = studio
        .rendered("ball.off", Some("large.off"), &small())
        .unwrap();
    let deviation = icosphere(1.2, 3).deviation + icosphere(1.0, 4).deviation;
    for name in ["distance_min", "distance_mean", "distance_max"] {
        assert!((report.figures[name] - 0.2).abs() <= deviation, "{name}");
    }
    assert_eq!(report.figures["color_low"], 0.0);
    let expected = Params {
        range: Some(Length::Units(0.05)),
        expected: Some(Length::Units(0.25)),
        ..small()
    };
    let (image, report) = studio
        .rendered("ball.off", Some("large.off"), &expected)
        .unwrap();
    let scale = (report.figures["color_low"], report.figures["color_high"]);
    assert_eq!(scale, (-0.05, 0.05));
    let [r, _, b, _] = image.get(30, 20).unwrap().0;
    assert!(b > r, "it falls short");
}

#[test]
fn shares_are_of_the_mesh_to_which_distances_are_measured() {
    let studio = Studio::new();
    let (large, ball) = (icosphere(1.2, 3), icosphere(1.0, 4));
    let expected = Params {
        expected: Some(Length::Percent(100.0 * 0.2 / ball.mesh.bounds().diagonal())),
        ..small()
    };
    let rendered = studio.rendered("large.off", Some("ball.off"), &expected);
    let (_, report) = rendered.unwrap();
    let deviation = large.deviation + ball.deviation;
    assert!(report.figures["color_high"] <= deviation);
    let ranged = Params {
        range: Some(Length::Percent(1.0)),
        ..expected
    };
    let (_, report) = studio
        .rendered("large.off", Some("ball.off"), &ranged)
        .unwrap();
    let share = 0.01 * ball.mesh.bounds().diagonal();
    assert!((report.figures["color_high"] - share).abs() < 1e-12);
}

#[test]
fn parameters_out_of_range_are_refused_before_reading() {
    let studio = Studio::new();
    for wrong in [
        Params {
            width: 0,
            ..small()
        },
        Params {
            width: 16_000,
            height: 16_000,
            ..small()
        },
        Params {
            perspective: Some(0.0),
            ..small()
        },
        Params {
            zoom: f64::NAN,
            ..small()
        },
        Params {
            feature_angle: -1.0,
            ..small()
        },
        Params {
            line_width: 0.0,
            ..small()
        },
        Params {
            samples: 9,
            ..small()
        },
        Params {
            quality: 0,
            ..small()
        },
        Params {
            range: Some(Length::Units(1.0)),
            ..small()
        },
        Params {
            expected: Some(Length::Units(1.0)),
            ..small()
        },
    ] {
        let error = studio.rendered("missing.off", None, &wrong).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Request, "{error}");
    }
    let error = studio.rendered("missing.off", None, &small()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Input, "{error}");
    let error = studio.rendered("none.off", None, &small()).unwrap_err();
    assert!(matches!(error, JobError::NoTriangles { .. }), "{error}");
}
