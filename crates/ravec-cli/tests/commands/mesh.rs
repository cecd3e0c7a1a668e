//! `ravec mesh`: what each operation says and writes.

use crate::meshes::{cuboid, parts, sheet, torus};
use crate::program::{
    assert_refused, assert_same_on_any_threads, code, done, ravec, report, stderr, stdout,
};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    parts(folder.path());
    std::fs::write(folder.path().join("box.obj"), cuboid(2.0, 3.0, 4.0).obj()).unwrap();
    folder
}

#[track_caller]
fn figure(report: &Value, name: &str) -> f64 {
    let figure = &report["figures"][name];
    figure
        .as_f64()
        .unwrap_or_else(|| panic!("no {name} in {report}"))
}

/// Runs arguments with `input` on standard input and gives what comes out on standard output.
#[track_caller]
fn piped(folder: &Path, arguments: &str, input: Vec<u8>) -> Vec<u8> {
    use std::io::Write as _;
    let mut child = Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(arguments.split(' '))
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let feeding = std::thread::spawn(move || stdin.write_all(&input));
    let output = child.wait_with_output().unwrap();
    feeding.join().unwrap().unwrap();
    assert_eq!(code(&output), 0, "{arguments}: {}", stderr(&output));
    output.stdout
}

#[test]
fn info_says_what_is_in_a_file() {
    let folder = folder();
    let said = done(folder.path(), "mesh info box.obj");
    assert!(
        said.contains("read box.obj (OBJ, 12 triangles, 8 vertices)"),
        "{said}"
    );
    assert!(said.contains("volume          24\n"), "{said}");
    let report = report(folder.path(), "mesh info box.obj");
    assert_eq!(report["operation"], "mesh info");
    assert_eq!(report["inputs"][0]["format"], "OBJ");
    assert_eq!(report["inputs"][0]["triangles"], 12);
    assert_eq!(report["inputs"][0]["vertices"], 8);
    assert_eq!(report["inputs"][0]["unit"], Value::Null);
    for (name, value) in [
        ("triangles", 12.0),
        ("edges", 18.0),
        ("parts", 1.0),
        ("closed", 1.0),
        ("genus", 0.0),
        ("area", 52.0),
        ("size_z", 4.0),
        ("side_min", 2.0),
    ] {
        assert_eq!(figure(&report, name), value, "{name}");
    }
}

#[test]
fn check_ends_with_one_if_there_are_defects_and_says_where() {
    let folder = folder();
    let said = done(folder.path(), "mesh check box.obj");
    assert!(said.starts_with("passed: solid, closed\n"), "{said}");

    let output = ravec(folder.path(), &["mesh", "check", "sheet.obj"]);
    assert_eq!((code(&output), stderr(&output)), (1, String::new()));
    let said = stdout(&output);
    for words in [
        "boundary loops: 1\n",
        "- a loop of 32 edges, 32 long",
        "boundary edges: 32\n",
        "  and 22 more",
        "not passed: not solid, not closed\n",
    ] {
        assert!(said.contains(words), "no `{words}` in {said}");
    }
    done(folder.path(), "mesh check sheet.obj --open");

    let output = ravec(folder.path(), &["-q", "mesh", "check", "sheet.obj"]);
    let nothing = (1, String::new(), String::new());
    assert_eq!((code(&output), stdout(&output), stderr(&output)), nothing);
}

#[test]
fn the_report_of_a_check_holds_the_places() {
    let folder = folder();
    // a second box that reaches into the first one
    let (mut mesh, second) = (cuboid(2.0, 2.0, 2.0), cuboid(1.0, 1.0, 3.0));
    let shift = mesh.places.len() as u32;
    let places = second.places.iter().map(|p| p.map(|x| x + 0.5));
    mesh.places.extend(places);
    let triangles = second.triangles.iter().map(|t| t.map(|v| v + shift));
    mesh.triangles.extend(triangles);
    std::fs::write(folder.path().join("two.obj"), mesh.obj()).unwrap();
    let check = |more: &str| {
        let line = format!("-q --json r.json mesh check two.obj{more}");
        let output = ravec(folder.path(), &line.split(' ').collect::<Vec<_>>());
        let text = std::fs::read_to_string(folder.path().join("r.json")).unwrap();
        let report: Value = serde_json::from_str(&text).unwrap();
        (code(&output), report)
    };
    let (ended, report) = check(" --list 3");
    assert_eq!((ended, &report["passed"]), (1, &Value::Bool(false)));
    let finding = &report["findings"][0];
    assert_eq!(finding["what"], "self-intersections");
    assert_eq!(finding["defect"], true);
    assert_eq!(finding["count"], figure(&report, "self_intersections"));
    let places = finding["places"].as_array().unwrap();
    assert_eq!(places.len(), 3);
    assert_eq!(places[0]["note"], "crossing");
    assert_eq!(places[0]["triangles"].as_array().unwrap().len(), 2);
    assert_eq!(report["parameters"]["list"], 3);
    let (ended, report) = check(" --no-intersections");
    assert_eq!((ended, &report["passed"]), (0, &Value::Bool(true)));
    assert_eq!(report["findings"].as_array().unwrap().len(), 0);
}

#[test]
fn every_format_is_written_and_read_again() {
    let folder = folder();
    let formats = [
        ("a.stl", "", "binary STL"),
        ("b.stl", " --ascii", "ASCII STL"),
        ("a.ply", "", "binary PLY"),
        ("b.ply", " --ascii", "ASCII PLY"),
        ("a.obj", "", "OBJ"),
        ("a.off", "", "OFF"),
        ("a.3mf", "", "3MF"),
        ("a.glb", "", "GLB"),
        ("a.gltf", "", "glTF"),
    ];
    let mut last = "box.obj".to_owned();
    for (name, flags, format) in formats {
        done(
            folder.path(),
            &format!("mesh convert {last} -o {name}{flags}"),
        );
        let report = report(folder.path(), &format!("mesh info {name}"));
        assert_eq!(report["inputs"][0]["format"], format);
        assert_eq!(figure(&report, "vertices"), 8.0, "{name}");
        assert_eq!(figure(&report, "triangles"), 12.0, "{name}");
        if let Some(volume) = report["figures"]["volume"].as_f64() {
            // 3MF is in millimeters if nobody says otherwise, glTF in meters
            let scale = if format.starts_with("gl") || format == "GLB" {
                1e-9
            } else {
                1.0
            };
            assert!((volume / scale - 24.0).abs() < 1e-5, "{name}: {volume}");
        } else {
            panic!("{name} is not closed");
        }
        last = name.to_owned();
    }
}

#[test]
fn flags_say_the_format_whatever_the_name() {
    let folder = folder();
    for (flag, name, format) in [
        ("stl-ascii", "a.bin", "ASCII STL"),
        ("3mf", "b.stl", "3MF"),
        ("gltf", "c", "glTF"),
    ] {
        let line = format!("mesh convert box.obj -o {name} --format {flag}");
        let report = report(folder.path(), &line);
        assert_eq!(report["outputs"][0]["format"], format);
        let report = crate::program::report(folder.path(), &format!("mesh info {name}"));
        assert_eq!(report["inputs"][0]["format"], format);
    }
}

#[test]
fn streams_take_the_place_of_files() {
    let folder = folder();
    let part = || std::fs::read(folder.path().join("part.stl")).unwrap();
    // the format of the input
    assert!(piped(folder.path(), "mesh convert - -o -", part()) == part_rewritten(folder.path()));
    let obj = piped(folder.path(), "mesh convert - -o - --format obj", part());
    assert!(
        obj.starts_with(b"v "),
        "{}",
        String::from_utf8_lossy(&obj[..20])
    );
    let off = piped(
        folder.path(),
        "mesh simplify - -o - --triangles 90 --format off",
        obj,
    );
    assert!(off.starts_with(b"OFF\n"));
    let png = piped(
        folder.path(),
        "mesh render - -o - --width 32 --height 32",
        off.clone(),
    );
    assert!(png.starts_with(b"\x89PNG"));
    let said = piped(
        folder.path(),
        "mesh compare part.stl - --tolerance 1% --json -",
        off,
    );
    let report: Value = serde_json::from_slice(&said).unwrap();
    assert_eq!(report["inputs"][1]["path"], "-");
    let output = ravec(folder.path(), &["mesh", "compare", "-", "-"]);
    assert_refused(&output, 2, &["standard input", "once"]);
    let output = ravec(folder.path(), &["mesh", "info", "-"]);
    assert_refused(&output, 3, &["standard input", "empty"]);
}

fn part_rewritten(folder: &Path) -> Vec<u8> {
    done(folder, "-q mesh convert part.stl -o again.stl");
    std::fs::read(folder.join("again.stl")).unwrap()
}

#[test]
fn compare_encloses_the_distance_and_judges_it() {
    let folder = folder();
    // tubes of radius 0.8 and 0.75 around the same circle, as polygons of 24 and 20 sides
    let report = report(
        folder.path(),
        "mesh compare part.stl other.ply --tolerance 0.02%",
    );
    let (lower, upper) = (
        figure(&report, "distance_lower"),
        figure(&report, "distance_upper"),
    );
    assert!(lower <= upper && upper - lower <= 2.1e-4 * figure(&report, "diagonal"));
    assert!(lower > 0.04 && upper < 0.08, "{lower} {upper}");
    for name in ["a_to_b_mean", "a_to_b_rms", "b_to_a_mean", "b_to_a_rms"] {
        let mean = figure(&report, name);
        assert!(mean > 0.03 && mean < upper, "{name}: {mean}");
    }
    assert_eq!(report["passed"], Value::Null);
    assert_eq!(report["findings"][0]["what"], "farthest place of A from B");

    done(folder.path(), "mesh compare part.stl part.stl --within 0");
    let line = "mesh compare part.stl other.ply --within 0.01";
    let output = ravec(folder.path(), &line.split(' ').collect::<Vec<_>>());
    assert_eq!((code(&output), stderr(&output)), (1, String::new()));
    assert!(stdout(&output).starts_with("not passed\n"));
}

#[test]
fn render_draws_what_is_asked_for() {
    let folder = folder();
    let small = "--width 80 --height 60";
    let picture = |flags: &str| {
        let line = format!("mesh render part.stl -o a.png {small}{flags}");
        let report = report(folder.path(), &line);
        assert_eq!(report["outputs"][0]["width"], 80);
        assert_eq!(report["outputs"][0]["format"], "PNG");
        std::fs::read(folder.path().join("a.png")).unwrap()
    };
    let plain = picture("");
    assert!(plain == picture(" --view iso --up z --zoom 1"));
    for flags in [
        " --view 10,-30",
        " --view -10,30",
        " --view top",
        " --up y",
        " --perspective",
        " --perspective=80",
        " --zoom 1.5",
        " --edges",
        " --no-features",
        " --no-outlines",
        " --line-width 4",
        " --line-color #ff0000",
        " --smooth-angle 0",
        " --section x",
        " --section=-y=40%",
        " --section 1,1,0=0.5 --hollow",
        " --color #00ff00",
        " --background #204060",
        " --transparent",
        " --samples 1",
        " --compare other.ply",
        " --compare other.ply --range 0.2%",
        " --compare other.ply --expected 0.05",
    ] {
        assert!(picture(flags) != plain, "{flags} changes nothing");
    }
    let report = report(
        folder.path(),
        &format!("mesh render part.stl -o a.jpg {small} --compare other.ply --range 0.1"),
    );
    assert_eq!(figure(&report, "color_high"), 0.1);
    assert!(figure(&report, "distance_max") > 0.04);
}

#[test]
fn simplify_reaches_its_goals() {
    let folder = folder();
    let line = "mesh simplify part.stl -o small.ply --triangles 300";
    let simple = report(folder.path(), line);
    assert!(figure(&simple, "triangles_after") <= 300.0);
    assert_eq!(
        simple["outputs"][0]["triangles"],
        simple["figures"]["triangles_after"].as_f64().unwrap() as u64
    );
    done(folder.path(), "mesh check small.ply");
    let line = "mesh simplify part.stl -o close.ply --error 1%";
    let close = report(folder.path(), line);
    let line = "mesh compare part.stl close.ply --within 1.1%";
    done(folder.path(), line);
    assert!(figure(&close, "largest_error") > 0.0);
    let output = ravec(
        folder.path(),
        &["mesh", "simplify", "part.stl", "-o", "x.ply"],
    );
    assert_eq!(code(&output), 2);
    assert!(
        stderr(&output).contains("--triangles"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn what_could_not_be_reached_is_a_warning() {
    let folder = folder();
    let line = "mesh simplify sheet.obj -o a.obj --triangles 2 --lock-boundary";
    let output = ravec(folder.path(), &line.split(' ').collect::<Vec<_>>());
    assert_eq!(code(&output), 0);
    let said = stderr(&output);
    assert!(said.starts_with("ravec: warning: "), "{said}");
    assert!(said.contains("triangles are left instead of 2"), "{said}");
}

#[test]
fn outputs_do_not_depend_on_the_threads() {
    let folder = folder();
    for (arguments, out) in [
        ("mesh simplify part.stl -o out.ply --error 0.5%", "out.ply"),
        (
            "mesh render part.stl -o out.png --width 90 --height 90 --compare other.ply",
            "out.png",
        ),
        ("mesh convert part.stl -o out.3mf", "out.3mf"),
    ] {
        assert_same_on_any_threads(folder.path(), arguments, out);
    }
}

#[test]
fn welding_joins_triangles_and_drops_those_that_collapse() {
    let folder = folder();
    // each triangle with corners of its own, as many programs write OBJ
    let (mut apart, mesh) = (sheet(0), torus(2.0, 0.8, 12, 8));
    apart.places.clear();
    for triangle in &mesh.triangles {
        let first = apart.places.len() as u32;
        apart
            .places
            .extend(triangle.map(|v| mesh.places[v as usize]));
        apart.triangles.push([first, first + 1, first + 2]);
    }
    std::fs::write(folder.path().join("apart.obj"), apart.obj()).unwrap();
    // corners at equal places are joined by themselves
    let report = report(folder.path(), "mesh check apart.obj");
    assert_eq!(figure(&report, "joined_vertices"), 576.0 - 96.0);
    assert_eq!(report["verdict"]["assumed"].as_array().unwrap().len(), 1);
    done(folder.path(), "-q mesh check apart.obj --weld 0");
    let report = crate::program::report(
        folder.path(),
        "mesh convert apart.obj -o a.obj --weld 0.001%",
    );
    assert_eq!(figure(&report, "welded_vertices"), 576.0 - 96.0);
    assert_eq!(figure(&report, "collapsed_triangles"), 0.0);
    done(folder.path(), "mesh check a.obj");
    let report =
        crate::program::report(folder.path(), "mesh convert apart.obj -o b.obj --weld 0.9");
    assert!(figure(&report, "collapsed_triangles") > 0.0);
}

#[test]
fn an_inch_is_exactly_its_millimeters() {
    let folder = folder();
    let at = folder.path();
    let of = |text: String, name: &str| std::fs::write(at.join(name), text).unwrap();
    of(cuboid(1.0, 0.5, 0.3).obj(), "inch.obj");
    of(cuboid(25.4, 12.7, 7.62).obj(), "mm.obj");
    done(at, "mesh convert inch.obj -o inch.3mf --from-unit inch");
    done(at, "mesh convert mm.obj -o mm.3mf --from-unit millimeter");
    for files in ["inch.3mf mm.3mf", "mm.3mf inch.3mf"] {
        let report = report(at, &format!("boolean a-b {files} -o out.3mf"));
        assert_eq!(figure(&report, "triangles"), 0.0, "{files}");
    }
}

#[test]
fn a_unit_that_a_format_cannot_name_is_remarked() {
    let folder = folder();
    let at = folder.path();
    done(at, "mesh convert box.obj -o inch.3mf --from-unit inch");
    done(at, "mesh convert box.obj -o mm.3mf --from-unit millimeter");
    for arguments in [
        "mesh convert inch.3mf -o out.stl",
        "mesh simplify inch.3mf -o out.ply --triangles 12",
        "boolean union inch.3mf box.obj -o out.off",
        "offset inch.3mf -o out.obj -d 0.5",
    ] {
        let warned = |arguments: &str| {
            let report = report(at, arguments);
            let warnings = report["warnings"].as_array().unwrap().clone();
            let said = |warning: &&Value| warning.as_str().unwrap().contains("names no unit");
            warnings.iter().filter(said).count()
        };
        assert_eq!(warned(arguments), 1, "{arguments}");
        assert_eq!(warned(&arguments.replace("inch", "mm")), 0);
        let keeps = arguments.rsplit_once("out.").unwrap().0.to_owned() + "out.3mf";
        if arguments.starts_with("mesh convert") {
            assert_eq!(warned(&keeps), 0);
            assert_eq!(warned(&format!("{arguments} --unit millimeter")), 0);
        }
    }
}
