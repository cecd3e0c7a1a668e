use super::*;
use crate::ErrorKind;
use crate::mesh::{read_mesh_file, write_mesh_file};
use glam::{DVec2, DVec3};
use ravec::mesh::{TriMesh, measure};
use ravec::mesh_io::{
    Attributes, Precision, ReadOptions, WriteOptions, read_mesh, write_mesh_with,
};
use ravec::progress::Progress;
use ravec_scenes::solids::{cuboid, icosphere};
use std::ffi::OsString;
use std::io::Write as _;

struct Studio {
    folder: tempfile::TempDir,
}

fn block(size: [f64; 3], at: [f64; 3]) -> TriMesh {
    cuboid(size.into()).shifted(at.into()).mesh
}

impl Studio {
    /// A block from −2 to 2, a pin through it along z, and a block beside them.
    fn new() -> Self {
        let studio = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        studio.put("block.off", &block([4.0; 3], [0.0; 3]), None);
        studio.put("pin.off", &block([1.0, 1.0, 8.0], [0.25, 0.0, 0.0]), None);
        studio.put("far.off", &block([1.0; 3], [9.0, 0.0, 0.0]), None);
        studio.put("none.off", &TriMesh::default(), None);
        studio
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn put(&self, name: &str, mesh: &TriMesh, unit: Option<LengthUnit>) {
        let mut target = MeshTarget::of(&self.at(name), MeshFormat::Off).unwrap();
        target.unit = unit;
        write_mesh_file(&self.at(name), mesh, &target, &Progress::none()).unwrap();
    }

    /// Files as on the command line.
    fn files(&self, line: &str) -> Vec<NamedFile> {
        let file = |word: &str| {
            let mut file = NamedFile::from(OsString::from(word));
            file.path = self.at(file.path.to_str().unwrap());
            file
        };
        line.split(' ').map(file).collect()
    }

    fn operation(&self, expression: &str, line: &str, out: &str) -> Boolean {
        Boolean {
            expression: expression.to_owned(),
            files: self.files(line),
            output: self.at(out),
            origins: None,
            picture: None,
            params: Params::default(),
        }
    }

    fn run(&self, expression: &str, line: &str, out: &str) -> Result<Report, JobError> {
        self.operation(expression, line, out)
            .run(&Context::default())
    }

    fn mesh(&self, name: &str) -> TriMesh {
        let limits = crate::mesh::MeshLimits::default();
        let file = read_mesh_file(&self.at(name), &limits, &Progress::none());
        file.unwrap().mesh
    }
}

#[test]
fn expressions_and_words_give_the_volumes_of_boxes() {
    let studio = Studio::new();
    for (expression, line, volume) in [
        ("a | b", "block.off pin.off", 64.0 + 4.0),
        ("x & y", "x=block.off y=pin.off", 4.0),
        ("b - a", "block.off pin.off", 4.0),
        ("(a | c) - b ^ c", "block.off pin.off far.off", 60.0),
        ("union", "block.off pin.off far.off", 69.0),
        ("intersection", "block.off pin.off", 4.0),
        ("difference", "block.off pin.off far.off", 60.0),
        ("symmetric-difference", "block.off pin.off", 64.0),
        ("union", "union=block.off union2=pin.off", 64.0),
    ] {
        let report = studio.run(expression, line, "out.ply").unwrap();
        assert_eq!(report.passed, Some(true), "{expression}");
        let found = measure(&studio.mesh("out.ply")).volume;
        assert!((found - volume).abs() < 1e-9, "{expression}: {found}");
        assert!((report.figures["volume"] - volume).abs() < 1e-9);
        assert_eq!(report.figures["solid"], 1.0);
    }
}

#[test]
fn meshes_are_combined_at_their_places() {
    let studio = Studio::new();
    let placed = |expression: &str, line: &str, places: &[&str]| {
        let mut operation = studio.operation(expression, line, "out.ply");
        let places = places.iter().map(|place| place.parse().unwrap());
        operation.params.places = places.collect();
        let report = operation.run(&Context::default()).unwrap();
        assert_eq!(report.passed, Some(true), "{expression} {report:?}");
        measure(&studio.mesh("out.ply")).volume
    };
    let line = "block.off pin.off far.off";
    for (expression, places, volume) in [
        // the far cube, of side 1 about (9, 0, 0), by half into the right face of the block
        ("a | c", &["c:-7,0,0"][..], 64.5),
        // the pin of 1 x 1 x 8 lies along x and reaches 2 out of the block on both sides
        ("a | b", &["b:0,0,0,0,90,0"], 68.0),
        ("a - b", &["b:-0.25,0,2,0,90,0"], 62.0),
        // as large as the block and on it
        ("a & c", &["c:-9,0,0,0,0,0,4"], 64.0),
        ("a | b", &["b:20,0,0", "a:0,0,0,0,0,0,0.5"], 16.0),
        // turned by an eighth about z, the corner of the cube reaches into the block
        ("a & c", &["c:-7,0,0,0,0,45"], 0.5),
        // both move together
        ("a - b", &["a:1,2,3,0,0,90", "b:0.75,2.25,3"], 60.0),
    ] {
        let found = placed(expression, line, places);
        assert!((found - volume).abs() < 1e-9, "{places:?}: {found}");
    }
}

#[test]
fn a_mesh_at_its_own_place_comes_out_byte_by_byte() {
    let studio = Studio::new();
    studio.run("a - b", "block.off pin.off", "out.ply").unwrap();
    let plain = std::fs::read(studio.at("out.ply")).unwrap();
    let mut operation = studio.operation("a - b", "block.off pin.off", "out.ply");
    operation.params.places = vec!["b:0,0,0,0,0,0,1".parse().unwrap()];
    operation.run(&Context::default()).unwrap();
    assert!(std::fs::read(studio.at("out.ply")).unwrap() == plain);
}

#[test]
fn a_place_is_in_the_unit_of_the_first_mesh() {
    let studio = Studio::new();
    studio.put(
        "inches.3mf",
        &block([4.0; 3], [0.0; 3]),
        Some(LengthUnit::Inch),
    );
    let millimeters = block([25.4; 3], [0.0; 3]);
    studio.put("cube.3mf", &millimeters, Some(LengthUnit::Millimeter));
    let mut operation = studio.operation("a | b", "inches.3mf cube.3mf", "out.3mf");
    operation.params.places = vec!["b:2,0,0".parse().unwrap()];
    let report = operation.run(&Context::default()).unwrap();
    assert!((report.figures["volume"] - 64.5).abs() < 1e-9);
}

#[test]
fn a_wrong_place_is_refused_before_anything_is_read() {
    let studio = Studio::new();
    for (places, reason) in [
        (
            &["c:1,2,3"][..],
            "`places` is c:1,2,3, but must be the place of a mesh that has this name",
        ),
        (
            &["b:1,0,0", "b:2,0,0"],
            "must be the only place of the mesh",
        ),
    ] {
        let mut operation = studio.operation("a | b", "missing.off pin.off", "out.ply");
        operation.params.places = places.iter().map(|place| place.parse().unwrap()).collect();
        let error = operation.run(&Context::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Request);
        assert!(error.to_string().contains(reason), "{error}");
    }
    let mut operation = studio.operation("a | b", "block.off pin.off", "out.ply");
    operation.params.places = vec!["b:0,0,0,0,0,0,1e308".parse().unwrap()];
    let error = operation.run(&Context::default()).unwrap_err();
    assert!(error.to_string().contains("stay finite"), "{error}");
    assert!(!studio.at("out.ply").exists());
}

#[test]
fn an_empty_result_is_an_empty_mesh_and_a_note() {
    let studio = Studio::new();
    for out in [
        "out.stl", "out.ply", "out.obj", "out.off", "out.3mf", "out.glb",
    ] {
        let report = studio.run("a & b", "block.off far.off", out).unwrap();
        assert_ne!(report.passed, Some(false));
        let told = report.warnings.join("\n");
        assert!(told.contains("the result is empty"), "{told}");
        assert_eq!(report.outputs[0].triangles, Some(0), "{out}");
        assert!(studio.at(out).exists());
    }
}

#[test]
fn what_is_wrong_with_an_expression_is_shown_by_a_caret_before_anything_is_read() {
    let studio = Studio::new();
    let error = studio
        .run("a | (b - ", "x.off y.off", "out.ply")
        .unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Request);
    assert_eq!(
        error.to_string(),
        "cannot read the expression: expected the name of a mesh or an opening parenthesis after `-`, but the expression ends\n\
         a | (b - \n         ^"
    );
    let error = studio
        .run("a | part", "x.off y.off", "out.ply")
        .unwrap_err();
    let told = error.to_string();
    assert!(
        told.contains("no mesh named `part` (there are a, b)"),
        "{told}"
    );
    assert!(told.ends_with("a | part\n    ^"), "{told}");
    assert!(!studio.at("out.ply").exists());
}

#[test]
fn bad_files_are_refused() {
    let studio = Studio::new();
    for (expression, line, out, kind) in [
        ("a", "missing.off", "out.ply", ErrorKind::Input),
        ("a | b", "block.off none.off", "out.ply", ErrorKind::Input),
        ("a | b", "block.off pin.off", "pin.off", ErrorKind::Request),
        ("a | b", "block.off pin.off", "out.png", ErrorKind::Request),
        ("a", "a=block.off a=pin.off", "out.ply", ErrorKind::Request),
    ] {
        let error = studio.run(expression, line, out).unwrap_err();
        assert_eq!(error.kind(), kind, "{line} {out}: {error}");
    }
    let far = block([1.0; 3], [1e31, 0.0, 0.0]);
    studio.put("beyond.off", &far, None);
    let error = studio
        .run("a | b", "block.off beyond.off", "out.ply")
        .unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Input, "{error}");
    let mut operation = studio.operation("a", "block.off", "out.ply");
    operation.origins = Some(studio.at("out.txt"));
    let error = operation.run(&Context::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Request);
}

#[test]
fn files_that_the_expression_does_not_name_are_not_read() {
    let studio = Studio::new();
    let report = studio
        .run("a - b", "block.off pin.off missing.off", "out.ply")
        .unwrap();
    assert_eq!(report.inputs.len(), 2);
    assert!(
        report.warnings[0].contains("missing.off is c"),
        "{:?}",
        report.warnings
    );
}

#[test]
fn meshes_in_other_units_are_scaled_to_the_first() {
    let studio = Studio::new();
    let inches = block([4.0; 3], [0.0; 3]);
    studio.put("inches.3mf", &inches, Some(LengthUnit::Inch));
    let millimeters = block([25.4, 25.4, 25.4 * 8.0], [0.0; 3]);
    studio.put("pin.3mf", &millimeters, Some(LengthUnit::Millimeter));
    let report = studio
        .run("a - b", "inches.3mf pin.3mf", "out.3mf")
        .unwrap();
    assert_eq!(report.outputs[0].unit, Some("inch"));
    assert!((report.figures["volume"] - 60.0).abs() < 1e-9);
    assert!(
        report.warnings[0].contains("scaled by"),
        "{:?}",
        report.warnings
    );
}

/// A copy turned by angles that no float represents.
fn askew(mesh: &TriMesh) -> TriMesh {
    let turn = glam::DMat3::from_euler(glam::EulerRot::ZYX, 0.3, 1.1, -0.7);
    let positions = mesh.positions().iter().map(|&p| turn * p);
    TriMesh::new(positions.collect(), mesh.triangles().to_vec()).unwrap()
}

#[test]
fn the_verdict_is_that_of_the_file() {
    let studio = Studio::new();
    let plate = block([9.0, 7.0, 2.0], [0.0; 3]);
    let pocket = block([3.0, 2.0, 1.0], [0.4, 0.2, 0.5]);
    studio.put("plate.off", &askew(&plate), None);
    studio.put("pocket.off", &askew(&pocket), None);
    // beside the block, with an edge in common
    studio.put("touching.off", &block([4.0; 3], [4.0, 4.0, 0.0]), None);
    for (expression, line, volume) in [
        ("a - b", "plate.off pocket.off", 120.0),
        ("a | b", "plate.off pocket.off", 126.0),
        ("a | b", "block.off touching.off", 128.0),
    ] {
        for (out, precision) in [
            ("out.stl", Precision::Exact),
            ("out.ply", Precision::Single),
            ("out.off", Precision::Exact),
            ("out.3mf", Precision::Exact),
            ("out.glb", Precision::Exact),
        ] {
            let mut operation = studio.operation(expression, line, out);
            operation.params.output.precision = precision;
            let report = operation.run(&Context::default()).unwrap();
            let check = crate::mesh::check::Check {
                input: studio.at(out),
                params: crate::mesh::check::Params::default(),
            };
            let found = check.run(&Context::default()).unwrap();
            assert_eq!(report.passed, found.passed, "{line} {out}");
            assert_eq!(report.verdict.solid, found.verdict.solid);
            assert_eq!(
                (report.passed, found.verdict.closed),
                (Some(true), Some(true))
            );
            let error = (measure(&studio.mesh(out)).volume - volume).abs();
            assert!(error < 1e-4, "{line} {out}: {error}");
            let drawn_apart = line.contains("touching") && out == "out.stl";
            assert_eq!(
                report.figures.contains_key("separated_vertices"),
                drawn_apart
            );
            assert_eq!(
                !report.verdict.changed.is_empty(),
                drawn_apart,
                "{report:?}"
            );
        }
    }
}

#[test]
fn a_result_in_millimeters_is_judged_in_the_meters_of_gltf() {
    let studio = Studio::new();
    let unit = Some(LengthUnit::Millimeter);
    studio.put(
        "plate.3mf",
        &askew(&block([90.0, 70.0, 20.0], [0.0; 3])),
        unit,
    );
    studio.put("pin.3mf", &askew(&block([9.0, 7.0, 20.0], [3.0; 3])), unit);
    let report = studio.run("a - b", "plate.3mf pin.3mf", "out.glb").unwrap();
    assert_eq!(report.passed, Some(true), "{report:?}");
    let volume = 90.0 * 70.0 * 20.0 - 9.0 * 7.0 * 17.0;
    let found = report.figures["volume"] * 1e9;
    assert!((found - volume).abs() < 1e-3 * volume, "{found}");
    assert!(report.figures["largest_rounding"] < 1e-8);
    let mesh = studio.mesh("out.glb");
    let full = ravec::mesh::CheckParams {
        self_intersections: true,
        list_limit: 0,
    };
    let found = ravec::mesh::check(&mesh, &full, &Progress::none()).unwrap();
    assert!(found.is_solid());
    assert_eq!(measure(&mesh).volume, report.figures["volume"]);
}

#[test]
fn open_meshes_are_closed_and_that_is_told() {
    let studio = Studio::new();
    let (positions, mut triangles) = block([4.0; 3], [0.0; 3]).into_parts();
    triangles.pop();
    let open = TriMesh::new(positions, triangles).unwrap();
    studio.put("open.off", &open, None);
    let report = studio.run("a - b", "open.off far.off", "out.ply").unwrap();
    assert_eq!(report.passed, Some(true));
    let told = report.warnings.join("\n");
    assert!(told.contains("open.off: 1 hole was closed"), "{told}");
    let inputs = report.result.unwrap();
    assert_eq!(inputs[0]["closed"], false);
    assert_eq!(inputs[0]["closing_triangles"], 1);
    assert_eq!(inputs[1]["assumptions"].as_array().unwrap().len(), 0);
    assert!((measure(&studio.mesh("out.ply")).volume - 64.0).abs() < 1e-9);
}

#[test]
fn colors_follow_into_ply_and_are_left_out_elsewhere() {
    let studio = Studio::new();
    let (red, blue) = ([255, 0, 0, 255], [0, 0, 255, 128]);
    let ball = icosphere(1.0, 2).shifted(DVec3::X).mesh;
    for (name, mesh, color) in [
        ("red.ply", icosphere(1.0, 2).mesh, red),
        ("blue.ply", ball, blue),
    ] {
        let colors = vec![color; mesh.positions().len()];
        let mut bytes = Vec::new();
        let options = WriteOptions {
            precision: Precision::Exact,
            unit: None,
        };
        let format = MeshFormat::PlyBinary;
        let attributes = Attributes {
            colors: &colors,
            ..Attributes::default()
        };
        write_mesh_with(
            &mesh,
            attributes,
            format,
            &options,
            &mut bytes,
            &Progress::none(),
        )
        .unwrap();
        ravec_files::write_atomically(&studio.at(name), |file| file.write_all(&bytes)).unwrap();
    }
    let report = studio.run("union", "red.ply blue.ply", "out.ply").unwrap();
    assert_eq!(report.warnings, [""; 0]);
    let asked = ReadOptions {
        colors: true,
        ..ReadOptions::default()
    };
    let bytes = std::fs::read(studio.at("out.ply")).unwrap();
    let file = read_mesh(&bytes[..], &asked, &Progress::none()).unwrap();
    assert_eq!(file.colors.len(), file.mesh.positions().len());
    for (at, color) in file.mesh.positions().iter().zip(&file.colors) {
        if at.x < 0.4 {
            assert_eq!(*color, red, "{at}");
        } else if at.x > 0.6 {
            assert_eq!(*color, blue, "{at}");
        }
    }
    let report = studio.run("union", "red.ply blue.ply", "out.off").unwrap();
    let told = report.warnings.join("\n");
    assert_eq!(told.matches("left out colors").count(), 2, "{told}");
}

#[test]
fn texture_coordinates_follow_into_obj_and_gltf() {
    let studio = Studio::new();
    // both textures are projections, so that pieces of triangles show what their places say
    let projected = |at: DVec3, which: usize| match which {
        0 => DVec2::new(0.25 * at.x + 0.5 * at.y, at.z),
        _ => DVec2::new(0.125 * at.z, 3.0 - at.x),
    };
    let names = ["one.obj", "two.glb"];
    for (which, name) in names.into_iter().enumerate() {
        let mesh = cuboid(DVec3::splat(2.0 - which as f64 * 0.5));
        let mesh = mesh.shifted(DVec3::new(which as f64, 0.25, 0.125)).mesh;
        let corners = mesh.triangles().iter();
        let texture: Vec<[DVec2; 3]> = corners
            .map(|t| t.map(|v| projected(mesh.positions()[v as usize], which)))
            .collect();
        let attributes = Attributes {
            texture: &texture,
            ..Attributes::default()
        };
        let mut bytes = Vec::new();
        let format = MeshFormat::from_extension(&name[4..]).unwrap();
        let (options, progress) = (WriteOptions::default(), Progress::none());
        write_mesh_with(&mesh, attributes, format, &options, &mut bytes, &progress).unwrap();
        ravec_files::write_atomically(&studio.at(name), |file| file.write_all(&bytes)).unwrap();
    }
    for (output, tolerance) in [("out.obj", 1e-12), ("out.gltf", 1e-6)] {
        let report = studio.run("union", "one.obj two.glb", output).unwrap();
        assert_eq!(report.warnings, [""; 0]);
        let asked = ReadOptions {
            texture: true,
            ..ReadOptions::default()
        };
        let bytes = std::fs::read(studio.at(output)).unwrap();
        let file = read_mesh(&bytes[..], &asked, &Progress::none()).unwrap();
        let mut of_second = 0;
        for (corners, texture) in file.mesh.triangles().iter().zip(&file.texture) {
            let places = corners.map(|v| file.mesh.positions()[v as usize]);
            let shown = |which: usize| {
                let errors = (0..3).map(|i| (projected(places[i], which) - texture[i]).length());
                errors.fold(0.0, f64::max)
            };
            // what is to the right of the first cube is of the second
            let which = usize::from(places.iter().any(|p| p.x > 1.0 + 1e-6));
            of_second += which;
            assert!(shown(which) < tolerance, "{places:?} {texture:?}");
        }
        assert!(of_second > 8 && of_second + 8 < file.texture.len());
    }
    let context = Context::default().with_intermediates();
    let mut operation = studio.operation("union", "one.obj two.glb", "out.ply");
    operation.output = "@both".into();
    operation.run(&context).unwrap();
    let file = context.stored_mesh(&operation.output).unwrap();
    assert_eq!(file.texture.len(), file.mesh.triangles().len());
    let report = studio.run("union", "one.obj two.glb", "out.ply").unwrap();
    let told = report.warnings.join("\n");
    assert_eq!(
        told.matches("left out texture coordinates").count(),
        2,
        "{told}"
    );
}

#[test]
fn origins_lead_back_to_the_triangles_of_the_files() {
    let studio = Studio::new();
    let mut operation = studio.operation("a - drill", "block.off drill=pin.off", "out.ply");
    operation.picture = Some(studio.at("out.png"));
    for name in ["out.csv", "out.json"] {
        operation.origins = Some(studio.at(name));
        let report = operation.run(&Context::default()).unwrap();
        let triangles = report.figures["triangles"] as usize;
        let details = report.details.as_ref().unwrap();
        assert_eq!(details["triangles"], triangles);
        let result = report.result.as_ref().unwrap();
        assert_eq!(result[1]["name"], "drill");
        for field in ["triangles", "closed", "assumptions"] {
            assert_eq!(result[1][field], details["operands"][1][field]);
        }
        let text = std::fs::read_to_string(studio.at(name)).unwrap();
        if name == "out.csv" {
            let rows: Vec<_> = text.lines().skip(1).collect();
            assert_eq!(rows.len(), triangles);
            // the sides of the block are whole, the walls of the hole are pieces of the pin seen from inside
            assert_eq!(rows.iter().filter(|row| row.ends_with(",0,1")).count(), 8);
            assert!(
                rows.iter()
                    .all(|row| !row.starts_with("drill") || row.ends_with(",1,0"))
            );
        } else {
            let json: serde_json::Value = serde_json::from_str(&text).unwrap();
            assert_eq!(json["meshes"][1]["name"], "drill");
            let rows = json["triangles"].as_array().unwrap();
            assert_eq!(rows.len(), triangles);
            assert!(rows.iter().all(|row| row.as_array().unwrap().len() == 4));
        }
        let picture = ravec_media::read(studio.at("out.png"), &crate::Limits::default());
        assert_eq!(picture.unwrap().image.size().width(), 1000);
    }
}

#[test]
fn a_cancelled_run_leaves_nothing() {
    let studio = Studio::new();
    let context = Context::default();
    context.progress.cancel();
    let operation = studio.operation("a | b", "block.off pin.off", "out.ply");
    let error = operation.run(&context);
    assert!(matches!(error, Err(JobError::Cancelled)));
    assert!(!studio.at("out.ply").exists());
}
