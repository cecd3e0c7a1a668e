//! `ravec offset` from the outside.

use crate::meshes::{Mesh, cuboid, parts, sheet};
use crate::program::{
    assert_refused, assert_same_on_any_threads, code, done, files, ravec, report, stderr, stdout,
};
use std::path::Path;

/// A folder with `part.stl`, a torus, `box.stl` of 4 x 3 x 2, and an open `sheet.obj`.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    parts(folder.path());
    std::fs::write(folder.path().join("box.stl"), cuboid(4.0, 3.0, 2.0).stl()).unwrap();
    folder
}

#[track_caller]
fn refused(folder: &Path, line: &str, expected: i32, words: &[&str]) {
    let before = files(folder);
    let output = ravec(folder, &line.split(' ').collect::<Vec<_>>());
    assert_refused(&output, expected, words);
    assert_eq!(files(folder), before, "{line}");
}

/// Minimum and maximum distance of the corners of a mesh in text form from a box at the origin.
fn distances_to_box(off: &str, size: [f64; 3]) -> [f64; 2] {
    let numbers = |line: &str| -> Vec<f64> {
        let parts = line.split_whitespace();
        parts.map(|part| part.parse().unwrap()).collect()
    };
    let mut lines = off.lines().skip(1);
    let counts = numbers(lines.next().unwrap());
    let distances = lines.take(counts[0] as usize).map(|line| {
        let place = numbers(line);
        let beyond = (0..3).map(|axis| (place[axis] - size[axis]).max(-place[axis]));
        let beyond: Vec<_> = beyond.collect();
        let outside: f64 = beyond.iter().map(|d| d.max(0.0).powi(2)).sum();
        let inside = beyond.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if inside < 0.0 {
            -inside
        } else {
            outside.sqrt()
        }
    });
    distances.fold([f64::INFINITY, 0.0], |[least, most], d| {
        [least.min(d), most.max(d)]
    })
}

#[test]
fn every_side_of_a_box_keeps_the_distance_and_is_solid() {
    let folder = folder();
    for (side, distance, solid_inside) in [
        ("both", "0.4", false),
        ("outer", "0.4", false),
        ("inner", "0.4", true),
        ("inner", "-0.4", true),
    ] {
        let line = format!(
            "offset box.stl -o out.off --distance {distance} --tolerance 0.02 --side {side}"
        );
        let report = report(folder.path(), &line);
        assert_eq!(report["operation"], "offset");
        assert_eq!(report["passed"], true, "{line}: {report}");
        assert_eq!(report["figures"]["certified"], 1.0);
        assert_eq!(report["figures"]["solid"], 1.0);
        let off = std::fs::read_to_string(folder.path().join("out.off")).unwrap();
        let [least, most] = distances_to_box(&off, [4.0, 3.0, 2.0]);
        assert!(least >= 0.38 && most <= 0.42, "{line}: {least} to {most}");
        let info = self::report(folder.path(), "mesh info out.off");
        let grown = info["figures"]["size_x"].as_f64().unwrap() > 4.0;
        assert_eq!(grown, !solid_inside, "{line}");
        done(folder.path(), "mesh check out.off");
    }
}

#[test]
fn a_shell_has_the_surface_of_its_input_and_walls_of_the_distance() {
    let folder = folder();
    done(
        folder.path(),
        "offset box.stl -o out.ply -d 0.25 -t 0.01 --side shell",
    );
    let figures =
        |name: &str| report(folder.path(), &format!("mesh info {name}"))["figures"].clone();
    let (shell, block) = (figures("out.ply"), figures("box.stl"));
    assert_eq!(shell["max_x"], block["max_x"]);
    assert_eq!(shell["parts"], 2.0);
    let wall = 24.0 - 3.5 * 2.5 * 1.5;
    let volume = shell["volume"].as_f64().unwrap();
    assert!((volume - wall).abs() < 0.5, "{volume} instead of {wall}");
    done(folder.path(), "mesh check out.ply");
}

#[test]
fn any_triangles_have_an_offset() {
    let folder = folder();
    // an open sheet, a box through it that is inside out, and all of it twice
    let mut soup = sheet(3);
    let add = |soup: &mut Mesh, mesh: Mesh, flip: bool| {
        let first = soup.places.len() as u32;
        soup.places.extend(mesh.places);
        let turned = |[a, b, c]: [u32; 3]| if flip { [a, c, b] } else { [a, b, c] };
        let moved = mesh
            .triangles
            .into_iter()
            .map(|t| turned(t.map(|v| v + first)));
        soup.triangles.extend(moved);
    };
    add(&mut soup, cuboid(1.0, 2.0, 1.0), true);
    add(&mut soup, sheet(3), true);
    // and triangles that are segments and points
    soup.triangles.extend([[0, 0, 5], [7, 7, 7]]);
    std::fs::write(folder.path().join("soup.obj"), soup.obj()).unwrap();
    for side in ["both", "outer"] {
        let line =
            format!("offset soup.obj -o out.stl --distance 0.2 --tolerance 5% --side {side}");
        refused(folder.path(), &line, 2, &["below half the distance"]);
        let line = line.replace("5%", "0.02");
        let report = report(folder.path(), &line);
        assert_eq!(report["passed"], true, "{side}: {report}");
        done(folder.path(), "mesh check out.stl");
        std::fs::remove_file(folder.path().join("out.stl")).unwrap();
    }
}

#[test]
fn a_file_of_32_bits_holds_what_was_judged() {
    let folder = folder();
    for line in [
        "part.stl -o out.stl --distance 2%",
        "part.stl -o out.glb --distance 0.5% --side shell",
        "part.stl -o out.stl --distance 5% --side inner --no-simplify",
        "sheet.obj -o out.stl --distance 0.2 --tolerance 0.01 --open thicken",
        "sheet.obj -o out.stl --distance 0.2 --tolerance 0.003 --open thicken",
    ] {
        let out = line.split(' ').nth(2).unwrap();
        let report = report(folder.path(), &format!("offset {line}"));
        assert_eq!(report["passed"], true, "{line}: {report}");
        done(folder.path(), &format!("mesh check {out}"));
        std::fs::remove_file(folder.path().join(out)).unwrap();
    }
}

#[test]
fn triangles_are_merged_unless_they_are_to_be_kept_and_threads_do_not_matter() {
    let folder = folder();
    let line = "offset box.stl -o out.ply --distance 10% --tolerance 0.2%";
    let merged = report(folder.path(), line);
    let kept = report(folder.path(), &format!("{line} --no-simplify"));
    let triangles = |report: &serde_json::Value| report["figures"]["triangles"].as_f64().unwrap();
    assert!(2.0 * triangles(&merged) < triangles(&kept));
    assert_eq!(
        kept["figures"]["triangles"],
        kept["figures"]["extracted_triangles"]
    );
    assert_eq!(kept["parameters"]["distance"], "10%");
    for line in [line, &format!("{line} --no-simplify")] {
        assert_same_on_any_threads(folder.path(), line, "out.ply");
    }
}

#[test]
fn the_summary_says_what_was_proved() {
    let folder = folder();
    let text = done(
        folder.path(),
        "offset box.stl -o out.stl --distance 0.5 --side outer",
    );
    for words in [
        "read box.stl",
        "wrote out.stl",
        "certified",
        "distance_least",
        "distance_most ",
        "feature_edges",
        "split_cells",
        "passed",
    ] {
        assert!(text.contains(words), "no `{words}` in: {text}");
    }
}

#[test]
fn what_is_not_as_promised_is_written_with_a_warning_and_a_code_of_its_own() {
    let folder = folder();
    // a box that is inside out reaches into another: it cannot be told from a cut
    let mut boxes = cuboid(2.0, 2.0, 2.0);
    let other = cuboid(2.0, 2.0, 2.0);
    let moved = other.places.iter().map(|p| p.map(|x| x + 1.0));
    boxes.places.extend(moved);
    let turned = other
        .triangles
        .iter()
        .map(|&[a, b, c]| [a + 8, c + 8, b + 8]);
    boxes.triangles.extend(turned);
    std::fs::write(folder.path().join("boxes.obj"), boxes.obj()).unwrap();
    let line = "offset boxes.obj -o out.obj --distance 0.2 --side shell --json r.json";
    let output = ravec(folder.path(), &line.split(' ').collect::<Vec<_>>());
    assert_eq!(code(&output), 5, "{}", stderr(&output));
    let said = stderr(&output);
    assert!(said.contains("--inside to nonzero or outer-hull"), "{said}");
    assert!(stdout(&output).starts_with("not passed: "));
    assert!(folder.path().join("out.obj").is_file());
    let json = std::fs::read_to_string(folder.path().join("r.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["passed"], false);
    assert_eq!(json["verdict"]["dropped"].as_array().unwrap().len(), 1);
}

#[test]
fn units_need_to_be_known() {
    let folder = folder();
    refused(
        folder.path(),
        "offset box.stl -o out.stl --distance 2mm",
        2,
        &["--distance is 2mm", "--unit"],
    );
    refused(
        folder.path(),
        "offset box.stl -o out.stl --distance 0.2 --tolerance 10um",
        2,
        &["--tolerance is 10um", "--unit"],
    );
    let inches = report(
        folder.path(),
        "offset box.stl -o out.3mf --distance 5.08mm --unit in",
    );
    assert!((inches["figures"]["distance"].as_f64().unwrap() - 0.2).abs() < 1e-12);
    assert_eq!(inches["outputs"][0]["unit"], "inch");
    // now the file says it
    let again = report(
        folder.path(),
        "offset out.3mf -o again.ply --distance 2.54mm",
    );
    assert!((again["figures"]["distance"].as_f64().unwrap() - 0.1).abs() < 1e-12);
}

#[test]
fn what_makes_no_sense_is_refused_with_one_sentence_and_without_a_file() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("folder.ply")).unwrap();
    let flags = |rest: &str| format!("offset box.stl -o out.ply {rest}");
    for (line, expected, words) in [
        (flags("--distance 0"), 2, "--distance is 0"),
        (
            flags("--distance=-1"),
            2,
            "--side both offsets an open mesh",
        ),
        (flags("--distance -2"), 2, "--side inner"),
        (flags("--distance -2% --side outer"), 2, "--side inner"),
        (flags("--distance 1 --tolerance 0"), 2, "--tolerance is 0"),
        (flags("--distance 1 --tolerance -1"), 2, "--tolerance is -1"),
        (
            flags("--distance 1 --tolerance 0.5"),
            2,
            "half the distance",
        ),
        (flags("--distance 1 --tolerance 1e-9"), 2, "at least"),
        (flags("--distance 1e-9"), 2, "must be above 1."),
        (flags("--distance 1e300"), 2, "the distance is 1e300"),
        (flags("--distance 1e-300"), 2, "must be above"),
        (flags("--distance 5 --side inner"), 1, "smaller distance"),
        (
            "offset box.stl -o folder.ply --distance 1".to_owned(),
            4,
            "is a directory",
        ),
        (
            "offset box.stl -o . --distance 1".to_owned(),
            4,
            "directory",
        ),
        (
            "offset folder.ply -o out.ply --distance 1".to_owned(),
            3,
            "directory",
        ),
        (
            "offset missing.stl -o out.ply --distance 1".to_owned(),
            3,
            "No such file",
        ),
        (
            "offset sheet.obj -o out.ply --distance 0.1 --side inner".to_owned(),
            3,
            "not closed",
        ),
        (
            "offset sheet.obj -o out.ply --distance 0.1 --side shell".to_owned(),
            3,
            "not closed",
        ),
        (
            "offset box.stl -o out.gif --distance 1".to_owned(),
            2,
            "known are .stl",
        ),
        (
            "offset box.stl -o box.stl --distance 1".to_owned(),
            2,
            "it is an input",
        ),
        (
            "offset box.stl -o no/out.stl --distance 1".to_owned(),
            4,
            "its folder does not exist",
        ),
    ] {
        refused(folder.path(), &line, expected, &[words]);
    }
    for rest in [
        "",
        "--distance two",
        "--distance nan",
        "--distance 1,5",
        "--distance 1 --side up",
    ] {
        let line = flags(rest);
        let output = ravec(folder.path(), &line.split_whitespace().collect::<Vec<_>>());
        assert_eq!(code(&output), 2, "{line}");
        assert!(!folder.path().join("out.ply").exists());
    }
}

#[test]
fn limits_in_messages_are_short_numbers_and_the_smaller_is_below_the_larger() {
    let folder = folder();
    let line = "offset box.stl -o out.ply --distance 0.3% --tolerance 1e-9";
    let output = ravec(folder.path(), &line.split(' ').collect::<Vec<_>>());
    let said = stderr(&output);
    let numbers: Vec<f64> = said
        .split([' ', ','])
        .filter_map(|word| word.trim().parse().ok())
        .collect();
    assert_eq!(numbers.len(), 3, "{said}");
    assert!(numbers[0] < numbers[1] && numbers[1] < numbers[2], "{said}");
    assert!(said.len() < 160, "{said}");
}

#[test]
fn files_that_are_cut_off_in_any_format_are_refused_without_a_partial_output() {
    let folder = folder();
    for format in [
        "stl",
        "stl-ascii",
        "ply",
        "ply-ascii",
        "obj",
        "off",
        "3mf",
        "glb",
        "gltf",
    ] {
        let line = format!("-q mesh convert box.stl -o - --format {format}");
        let output = ravec(folder.path(), &line.split(' ').collect::<Vec<_>>());
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        let whole = output.stdout;
        // a text of vertices and faces one after the other may be whole without its last lines
        let last = if format == "obj" { 30 } else { 97 };
        for percent in [3, 30, last] {
            let name = format!("cut-{percent}.{format}");
            let cut = &whole[..whole.len() * percent / 100];
            std::fs::write(folder.path().join(&name), cut).unwrap();
            let line = format!("offset {name} -o out.ply --distance 1%");
            refused(folder.path(), &line, 3, &[&name]);
        }
    }
}

#[test]
fn coordinates_that_are_no_numbers_are_refused_with_their_place() {
    let folder = folder();
    let mut stl = cuboid(1.0, 1.0, 1.0).stl();
    // the second corner of the third triangle: 84 bytes of header, 50 for each triangle, 12 for its normal
    let at = 84 + 2 * 50 + 12 + 12;
    stl[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(folder.path().join("nan.stl"), stl).unwrap();
    let text = cuboid(1.0, 1.0, 1.0).obj();
    let text = text.replacen("v 1 0 0", "v 1 inf 0", 1);
    std::fs::write(folder.path().join("inf.obj"), text).unwrap();
    for (name, words) in [
        ("nan.stl", ["byte ", "NaN"]),
        ("inf.obj", ["line 2", "vertex 1"]),
    ] {
        let line = format!("offset {name} -o out.ply --distance 1%");
        refused(folder.path(), &line, 3, &[name, words[0], words[1]]);
    }
}

#[test]
fn an_older_output_stays_as_it_was_when_there_is_no_new_one() {
    let folder = folder();
    std::fs::write(folder.path().join("out.ply"), "old").unwrap();
    for (rest, expected) in [("5 --side inner", 1), ("1 --tolerance 3", 2)] {
        let line = format!("offset box.stl -o out.ply --distance {rest}");
        refused(folder.path(), &line, expected, &[]);
        assert_eq!(
            std::fs::read(folder.path().join("out.ply")).unwrap(),
            b"old"
        );
    }
}
