use super::*;
use crate::ErrorKind;
use crate::mesh::{MeshTarget, read_mesh_file, write_mesh_file};
use glam::DVec3;
use ravec::mesh::{Bvh, vertex_distances, weld};
use ravec::mesh_io::MeshFormat;
use ravec::mesh_io::MeshLimits;
use ravec_scenes::solids::{cuboid, icosphere, sheet};
use std::path::PathBuf;

/// A folder with a box of 4 x 3 x 2 in some formats, and with other meshes.
struct Shop {
    folder: tempfile::TempDir,
}

impl Shop {
    fn new() -> Self {
        let shop = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let block = cuboid([4.0, 3.0, 2.0].into()).mesh;
        for name in ["box.off", "box.stl"] {
            shop.put(name, &block, None);
        }
        shop.put("box.3mf", &block, Some(LengthUnit::Centimeter));
        let inside_out: Vec<_> = block
            .triangles()
            .iter()
            .map(|&[a, b, c]| [a, c, b])
            .collect();
        let inside_out = TriMesh::new(block.positions().to_vec(), inside_out).unwrap();
        shop.put("inside-out.off", &inside_out, None);
        shop.put("sheet.off", &sheet(2.0, 1.0, 2, 2).mesh, None);
        shop.put("none.off", &TriMesh::default(), None);
        shop
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn put(&self, name: &str, mesh: &TriMesh, unit: Option<LengthUnit>) {
        let mut target = MeshTarget::of(&self.at(name), MeshFormat::Off).unwrap();
        target.unit = unit;
        write_mesh_file(&self.at(name), mesh, &target, &Progress::none()).unwrap();
    }

    fn get(&self, name: &str) -> TriMesh {
        let file = read_mesh_file(&self.at(name), &MeshLimits::default(), &Progress::none());
        file.unwrap().mesh
    }

    fn operation(&self, from: &str, to: &str, params: &Params) -> Offset {
        Offset {
            input: self.at(from),
            output: self.at(to),
            params: params.clone(),
        }
    }

    fn run(&self, from: &str, to: &str, params: &Params) -> Result<Report, JobError> {
        self.operation(from, to, params).run(&Context::default())
    }

    #[track_caller]
    fn refused(&self, from: &str, to: &str, params: &Params) -> (ErrorKind, String) {
        let error = self.run(from, to, params).unwrap_err();
        assert!(!self.at(to).exists());
        (error.kind(), error.to_string())
    }
}

fn params(distance: &str, side: Side) -> Params {
    Params {
        distance: distance.parse().unwrap(),
        side,
        ..Params::default()
    }
}

#[test]
fn a_box_grows_by_the_distance_within_the_tolerance_and_the_report_proves_it() {
    let shop = Shop::new();
    let asked = Params {
        tolerance: Some("0.02".parse().unwrap()),
        ..params("0.5", Side::Outer)
    };
    let report = shop.run("box.off", "out.ply", &asked).unwrap();
    assert_eq!(report.passed, Some(true));
    assert_eq!(report.warnings, [""; 0]);
    for (figure, value) in [
        ("certified", 1.0),
        ("solid", 1.0),
        ("uncertified_triangles", 0.0),
        ("self_intersections", 0.0),
        ("distance", 0.5),
        ("tolerance", 0.02),
    ] {
        assert_eq!(report.figures[figure], value, "{figure}");
    }
    let details = report.details.as_ref().unwrap();
    for (field, figure) in [
        ("extracted_triangles", "extracted_triangles"),
        ("rounds", "repair_rounds"),
        ("least_distance", "distance_least"),
    ] {
        assert_eq!(details[field].as_f64(), Some(report.figures[figure]));
    }
    let [least, found, most] =
        ["least", "most_found", "most"].map(|name| report.figures[&*format!("distance_{name}")]);
    assert!(0.48 <= least && least <= found && found <= most && most <= 0.52);
    // what is a crease of the box is round at a distance
    assert_eq!(report.figures["feature_edges"], 0.0);
    let inner = shop.run("box.off", "inner.ply", &params("0.5", Side::Inner));
    assert!(inner.unwrap().figures["feature_edges"] >= 12.0);
    let (out, block) = (shop.get("out.ply"), shop.get("box.off"));
    assert_eq!(report.figures["triangles"], out.triangles().len() as f64);
    let size = out.bounds().size();
    assert!((size - DVec3::new(5.0, 4.0, 3.0)).abs().max_element() <= 0.04);
    let distances = vertex_distances(&out, &Bvh::new(&block), &Progress::none()).unwrap();
    assert!(distances.iter().all(|d| (d - 0.5).abs() <= 0.02));
}

#[test]
fn a_block_of_lengths_means_the_same_in_every_unit() {
    let shop = Shop::new();
    // the file is in centimeters, the diagonal of the box is the root of 29
    let percent = format!("{}%", 50.0 / 29f64.sqrt());
    let mut outputs = Vec::new();
    for (distance, tolerance) in [("0.5", "0.05"), ("5mm", "500um"), (&percent, "0.5mm")] {
        let asked = Params {
            tolerance: Some(tolerance.parse().unwrap()),
            ..params(distance, Side::Inner)
        };
        let report = shop.run("box.3mf", "out.3mf", &asked).unwrap();
        assert!((report.figures["distance"] - 0.5).abs() < 1e-12);
        assert!((report.figures["tolerance"] - 0.05).abs() < 1e-12);
        assert_eq!(report.outputs[0].unit, Some("centimeter"));
        outputs.push(shop.get("out.3mf").triangles().len());
    }
    assert_eq!(outputs[0], outputs[1]);
    let (kind, text) = shop.refused("box.off", "out.off", &params("5mm", Side::Inner));
    assert_eq!(kind, ErrorKind::Request);
    assert!(text.contains("does not name its unit"), "{text}");
    let known = Params {
        unit: Some(LengthUnit::Inch),
        ..params("12.7mm", Side::Inner)
    };
    let report = shop.run("box.off", "out.off", &known).unwrap();
    assert!((report.figures["distance"] - 0.5).abs() < 1e-12);
}

#[test]
fn the_default_tolerance_is_a_twentieth_of_the_distance_but_at_most_a_thousandth_of_the_diagonal() {
    for (distance, tolerance) in [
        ("0.1", 0.005),
        ("50", 0.1),
        ("5%", 0.1),
        ("0.2%", 0.01),
        // far away, the mesh is small
        ("2000", 2.0),
    ] {
        let [_, default] = params(distance, Side::Both).of(100.0, None).unwrap();
        assert!((default - tolerance).abs() < 1e-12, "{distance}: {default}");
    }
}

#[test]
fn inward_a_negative_distance_is_the_same_as_a_positive_one() {
    let shop = Shop::new();
    for side in [Side::Inner, Side::Shell] {
        shop.run("box.off", "a.off", &params("0.25", side)).unwrap();
        shop.run("box.off", "b.off", &params("-0.25", side))
            .unwrap();
        assert_eq!(shop.get("a.off"), shop.get("b.off"));
    }
    let wall = shop.get("a.off");
    let volume = 24.0 - 3.5 * 2.5 * 1.5;
    assert!((measure(&wall).volume - volume).abs() < 0.02 * volume);
    for side in [Side::Both, Side::Outer] {
        let (kind, text) = shop.refused("box.off", "out.off", &params("-0.25", side));
        assert_eq!(kind, ErrorKind::Request);
        assert!(text.contains("`side` inner"), "{text}");
    }
}

#[test]
fn a_mesh_that_is_inside_out_is_turned_and_the_user_is_told() {
    let shop = Shop::new();
    for side in [Side::Inner, Side::Shell, Side::Outer] {
        let right = shop.run("box.off", "a.off", &params("0.25", side)).unwrap();
        let turned = shop.run("inside-out.off", "b.off", &params("0.25", side));
        let turned = turned.unwrap();
        assert_eq!(right.warnings, [""; 0]);
        assert!(
            turned.warnings[0].contains("inside out"),
            "{:?}",
            turned.warnings
        );
        assert_eq!(turned.passed, Some(true));
        let volumes = ["a.off", "b.off"].map(|name| measure(&shop.get(name)).volume);
        assert!((volumes[0] - volumes[1]).abs() < 0.1, "{volumes:?}");
    }
}

#[test]
fn what_is_said_holds_for_the_file_where_that_has_32_bits() {
    let shop = Shop::new();
    for side in [Side::Both, Side::Outer, Side::Inner, Side::Shell] {
        for from in ["box.stl", "box.3mf"] {
            // glTF is in meters, so that other numbers are rounded there
            for to in ["out.stl", "out.glb"] {
                let report = shop.run(from, to, &params("0.25", side)).unwrap();
                assert_eq!(report.passed, Some(true), "{side:?}, {from} to {to}");
                let read = weld(&shop.get(to), 0.0).mesh;
                let found = check(&read, &CheckParams::default(), &Progress::none()).unwrap();
                assert!(found.is_solid(), "{side:?}, {from} to {to}: {found:?}");
                assert_eq!(report.figures["triangles"], found.triangles as f64);
            }
        }
    }
    let report = shop
        .run("box.stl", "out.stl", &params("0.5", Side::Outer))
        .unwrap();
    let (out, block) = (shop.get("out.stl"), shop.get("box.stl"));
    let distances = vertex_distances(&out, &Bvh::new(&block), &Progress::none()).unwrap();
    let [least, most] = ["distance_least", "distance_most"].map(|name| report.figures[name]);
    assert!(distances.iter().all(|d| (least..=most).contains(d)));
    let report = shop.run("box.3mf", "out.glb", &params("5mm", Side::Outer));
    let report = report.unwrap();
    assert!((report.figures["distance"] - 0.005).abs() < 1e-15);
    assert!((report.figures["distance_most"] - 0.005).abs() <= report.figures["tolerance"]);

    // far from the origin, 32 bits hold less
    let positions = block.positions().iter().map(|p| *p + DVec3::splat(1e6));
    let far = TriMesh::new(positions.collect(), block.triangles().to_vec()).unwrap();
    shop.put("far.off", &far, None);
    let (kind, text) = shop.refused("far.off", "far.stl", &params("0.5", Side::Outer));
    assert_eq!(kind, ErrorKind::Request);
    assert!(text.contains("write PLY"), "{text}");
    let report = shop
        .run("far.off", "far.ply", &params("0.5", Side::Outer))
        .unwrap();
    assert_eq!(report.figures["certified"], 1.0);
}

#[test]
fn a_shell_of_balls_through_each_other_is_that_of_their_union() {
    let shop = Shop::new();
    let ball = icosphere(1.0, 2).mesh;
    let (mut positions, mut triangles) = ball.clone().into_parts();
    let first = positions.len() as u32;
    positions.extend(ball.positions().iter().map(|p| *p + DVec3::X));
    triangles.extend(ball.triangles().iter().map(|t| t.map(|v| v + first)));
    shop.put(
        "balls.off",
        &TriMesh::new(positions, triangles).unwrap(),
        None,
    );
    for side in [Side::Shell, Side::Outer] {
        let report = shop
            .run("balls.off", "out.off", &params("0.2", side))
            .unwrap();
        assert_eq!(report.passed, Some(true), "{:?}", report.warnings);
        assert_eq!(report.verdict.assumed.is_empty(), side == Side::Outer);
    }
}

#[test]
fn a_result_that_is_not_what_was_promised_is_called_that() {
    let asked = OffsetParams {
        distance: 0.2,
        tolerance: 0.05,
        ..OffsetParams::default()
    };
    let sound = library::offset(&icosphere(1.0, 1).mesh, &asked, &Progress::none()).unwrap();
    let done = library::OffsetReport {
        certified: false,
        solid: false,
        uncertified_facets: 7,
        self_intersections: 2,
        ..sound.report
    };
    let mut report = Report::new("test", &());
    record(&done, Side::Shell, &mut report);
    assert_eq!(report.passed, Some(false));
    let verdict = &report.verdict;
    assert_eq!((verdict.solid, verdict.proved), (Some(false), Some(false)));
    assert_eq!(report.findings[1].what, "self-intersections");
    assert!(report.warnings[0].contains("7 of its triangles"));
    assert!(report.warnings[1].contains("takes over the defects of its input"));
}

#[test]
fn what_cannot_be_offset_is_refused_with_a_reason_and_without_a_file() {
    let shop = Shop::new();
    let with = |distance: &str, tolerance: &str, side| Params {
        tolerance: Some(tolerance.parse().unwrap()),
        ..params(distance, side)
    };
    for (from, asked, kind, word) in [
        (
            "none.off",
            params("1", Side::Both),
            ErrorKind::Input,
            "has no triangles",
        ),
        (
            "sheet.off",
            params("0.1", Side::Inner),
            ErrorKind::Input,
            "not closed",
        ),
        (
            "sheet.off",
            params("0.1", Side::Shell),
            ErrorKind::Input,
            "not closed",
        ),
        (
            "box.off",
            params("3", Side::Inner),
            ErrorKind::Failure,
            "smaller distance",
        ),
        (
            "box.off",
            params("0", Side::Both),
            ErrorKind::Request,
            "`distance` is 0",
        ),
        (
            "box.off",
            params("-1%", Side::Both),
            ErrorKind::Request,
            "`distance` is -1%",
        ),
        (
            "box.off",
            with("1", "0", Side::Both),
            ErrorKind::Request,
            "`tolerance` is 0",
        ),
        (
            "box.off",
            with("1", "-1mm", Side::Both),
            ErrorKind::Request,
            "`tolerance` is -1mm",
        ),
        (
            "box.off",
            with("1", "0.5", Side::Both),
            ErrorKind::Request,
            "below half the distance",
        ),
        (
            "box.off",
            with("1", "1e-12", Side::Both),
            ErrorKind::Request,
            "at least",
        ),
        (
            "missing.off",
            params("1", Side::Both),
            ErrorKind::Input,
            "missing.off",
        ),
    ] {
        let (got, text) = shop.refused(from, "out.off", &asked);
        assert_eq!(got, kind, "{text}");
        assert!(text.contains(word), "no `{word}` in: {text}");
    }
    for deviation in [0.0, 90.5, f64::NAN] {
        let asked = Params {
            max_normal_deviation: Some(deviation),
            ..params("1", Side::Both)
        };
        let (kind, text) = shop.refused("box.off", "out.off", &asked);
        assert_eq!(kind, ErrorKind::Request);
        assert!(text.contains("`max_normal_deviation` is"), "{text}");
    }
    let (kind, text) = shop.refused("box.off", "out.png", &params("1", Side::Both));
    assert_eq!(kind, ErrorKind::Request, "{text}");
    let (kind, text) = shop.refused("box.off", "no/out.off", &params("1", Side::Both));
    assert_eq!(kind, ErrorKind::Output, "{text}");
}

#[test]
fn nothing_is_written_after_a_cancellation() {
    let shop = Shop::new();
    let context = Context::default();
    context.progress.cancel();
    let operation = shop.operation("box.off", "out.off", &Params::default());
    let error = operation.run(&context);
    assert!(matches!(error, Err(JobError::Cancelled)));
    assert!(!shop.at("out.off").exists());
}

#[test]
fn a_sheet_becomes_a_plate_on_either_side() {
    let shop = Shop::new();
    for (distance, name) in [(0.25, "up.off"), (-0.25, "down.off")] {
        let params = Params {
            distance: Length::Units(distance),
            tolerance: Some(Length::Units(0.02)),
            open: OpenRule::Thicken,
            ..Params::default()
        };
        let report = shop.run("sheet.off", name, &params).unwrap();
        assert_eq!(report.passed, Some(true));
        assert_eq!(report.figures["sheet_kept"], 1.0);
        let volume = measure(&shop.get(name)).volume;
        assert!((volume - 0.5).abs() < 1e-3, "{volume}");
    }
}
