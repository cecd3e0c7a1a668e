//! Mesh files that are none, flags that make no sense, outputs that may not be.

use crate::meshes::{cuboid, parts, torus};
use crate::program::{assert_refused, code, done, files, ravec, report, stderr};
use std::path::Path;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    parts(folder.path());
    folder
}

/// Each operation with the file for its input.
fn readers(name: &str) -> Vec<String> {
    vec![
        format!("mesh info {name}"),
        format!("mesh check {name}"),
        format!("mesh convert {name} -o out.ply"),
        format!("mesh compare {name} part.stl"),
        format!("mesh compare part.stl {name}"),
        format!("mesh render {name} -o out.png"),
        format!("mesh render part.stl -o out.png --compare {name}"),
        format!("mesh simplify {name} -o out.ply --error 1%"),
        format!("offset {name} -o out.ply --distance 1%"),
    ]
}

#[track_caller]
fn refused(folder: &Path, line: &str, expected: i32, words: &[&str]) {
    let output = ravec(folder, &line.split(' ').collect::<Vec<_>>());
    assert_refused(&output, expected, words);
}

#[test]
fn files_that_are_no_meshes_are_refused_with_one_sentence_by_every_operation() {
    let folder = folder();
    let write = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    };
    let part = torus(2.0, 0.8, 12, 8).stl();
    write("empty.stl", b"");
    write("text.stl", b"Dear diary, today I am a mesh.\n");
    write("cut.stl", &part[..part.len() / 2]);
    write("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n");
    write("nan.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 nan 0\n3 0 1 2\n");
    write("vast.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\n\
        property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n1234");
    write("archive.3mf", b"PK\x03\x04 and then nothing");
    std::fs::create_dir(folder.path().join("dir.stl")).unwrap();
    let before = files(folder.path());
    for (name, words) in [
        ("empty.stl", "the file is empty"),
        ("text.stl", "does not look like a mesh file"),
        ("cut.stl", "cut off"),
        ("index.obj", "line 4"),
        ("nan.off", "line 5"),
        ("vast.ply", "--max-vertices"),
        ("archive.3mf", "3MF"),
        ("dir.stl", "directory"),
        ("missing.stl", "No such file or directory"),
    ] {
        for line in readers(name) {
            refused(folder.path(), &line, 3, &[name, words]);
        }
    }
    assert_eq!(files(folder.path()), before);
}

#[test]
fn a_mesh_without_triangles_is_no_surface_but_can_be_converted() {
    let folder = folder();
    std::fs::write(folder.path().join("none.off"), "OFF\n0 0 0\n").unwrap();
    for line in [
        "mesh compare none.off part.stl",
        "mesh compare part.stl none.off",
        "mesh render none.off -o out.png",
        "mesh render part.stl -o out.png --compare none.off",
        "offset none.off -o out.ply --distance 1",
    ] {
        refused(folder.path(), line, 3, &["none.off", "no triangles"]);
    }
    let report = report(folder.path(), "mesh convert none.off -o none.ply");
    assert!(
        report["warnings"][0]
            .as_str()
            .unwrap()
            .contains("no triangles")
    );
    let output = ravec(folder.path(), &["-q", "mesh", "check", "none.ply"]);
    assert_eq!(code(&output), 1);
    done(folder.path(), "-q mesh info none.ply");
    done(
        folder.path(),
        "-q mesh simplify none.ply -o less.ply --error 0",
    );
}

#[test]
fn a_wrong_extension_does_not_matter_for_reading() {
    let folder = folder();
    std::fs::copy(
        folder.path().join("part.stl"),
        folder.path().join("part.obj"),
    )
    .unwrap();
    std::fs::copy(folder.path().join("sheet.obj"), folder.path().join("sheet")).unwrap();
    for (name, format) in [("part.obj", "binary STL"), ("sheet", "OBJ")] {
        let report = report(folder.path(), &format!("mesh info {name}"));
        assert_eq!(report["inputs"][0]["format"], format);
    }
}

#[test]
fn what_exceeds_a_limit_names_the_flag_that_raises_it() {
    let folder = folder();
    for (limit, flag) in [
        ("2303", "--max-triangles"),
        ("1k", "--max-vertices"),
        ("9k", "--max-bytes"),
    ] {
        for line in readers("part.stl") {
            refused(
                folder.path(),
                &format!("{line} {flag} {limit}"),
                3,
                &["part.stl", flag],
            );
        }
    }
    // before or behind the operation
    refused(
        folder.path(),
        "mesh --max-triangles 9 info part.stl",
        3,
        &["--max-triangles"],
    );
    done(
        folder.path(),
        "mesh info part.stl --max-triangles 2304 --max-vertices 1152",
    );
}

#[test]
fn flags_that_make_no_sense_are_refused_before_anything_is_read() {
    let folder = folder();
    let before = files(folder.path());
    for (line, words) in [
        ("convert none -o out.xyz", "out.xyz"),
        ("convert none -o out", "known are .stl"),
        ("convert none -o out.glb --ascii", "--ascii"),
        ("convert none -o out.ply --weld=-1", "--weld"),
        ("convert none -o out.ply --weld much", "a length is"),
        ("convert none -o out.ply --format png", "png"),
        ("compare none none --tolerance 0", "--tolerance"),
        ("compare none none --within=-1", "--within"),
        ("render none -o out.stl", "out.stl"),
        ("render none -o out.png --width 0", "--width"),
        ("render none -o out.png --view up", "a view is"),
        ("render none -o out.png --section w", "a section is"),
        ("render none -o out.png --range 1", "--compare"),
        ("render none -o out.png --color blue", "hexadecimal"),
        ("render none -o out.png --perspective=180", "--perspective"),
        ("simplify none -o out.ply", "--triangles"),
        ("simplify none -o out.ply --error=-1", "--error"),
        ("simplify none -o out.txt --error 1", "out.txt"),
        (
            "simplify none -o out.ply --error 1 --feature-angle 200",
            "--feature-angle",
        ),
        ("check none --list many", "--list"),
    ] {
        let line = format!("mesh {line}");
        let output = ravec(folder.path(), &line.split(' ').collect::<Vec<_>>());
        let said = stderr(&output);
        assert_eq!(code(&output), 2, "{line}: {said}");
        assert!(
            said.starts_with("ravec: error: ") && said.contains(words),
            "{line}: {said}"
        );
    }
    assert_eq!(files(folder.path()), before);
}

#[test]
fn inputs_are_never_written_over_and_outputs_need_a_place() {
    let folder = folder();
    let before = files(folder.path());
    for line in [
        "mesh convert part.stl -o part.stl",
        "mesh convert part.stl -o ./part.stl --format ply",
        "mesh simplify part.stl -o part.stl --error 1%",
        "mesh render part.stl -o out.png --compare other.ply --json other.ply",
        "mesh info part.stl --json part.stl",
    ] {
        refused(
            folder.path(),
            line,
            2,
            &["it is an input", "choose another name"],
        );
    }
    refused(
        folder.path(),
        "mesh convert part.stl -o - --json -",
        2,
        &["two outputs"],
    );
    for line in [
        "mesh convert none -o no/out.ply",
        "mesh render none -o no/out.png",
        "mesh simplify none -o no/out.ply --error 1",
    ] {
        refused(folder.path(), line, 4, &["its folder does not exist"]);
    }
    assert_eq!(files(folder.path()), before);
}

#[test]
fn coordinates_beyond_the_format_leave_the_older_output_as_it_was() {
    let folder = folder();
    let mut text = String::from("OFF\n3 1 0\n");
    text.push_str("0 0 0\n1e300 0 0\n0 1 0\n3 0 1 2\n");
    std::fs::write(folder.path().join("far.off"), text).unwrap();
    std::fs::write(folder.path().join("out.stl"), "old").unwrap();
    refused(
        folder.path(),
        "mesh convert far.off -o out.stl",
        4,
        &["out.stl", "32-bit"],
    );
    assert_eq!(
        std::fs::read(folder.path().join("out.stl")).unwrap(),
        b"old"
    );
    done(folder.path(), "-q mesh convert far.off -o far.ply");
    refused(
        folder.path(),
        "mesh convert far.off -o out.stl --from-unit meter --unit micron --precision single",
        4,
        &["out.stl"],
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_output_error() {
    let folder = folder();
    refused(
        folder.path(),
        "mesh convert part.stl -o /dev/full --format ply",
        4,
        &["/dev/full", "No space left"],
    );
    let full = std::fs::File::options()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(["mesh", "convert", "part.stl", "-o", "-"])
        .current_dir(folder.path())
        .stdout(full)
        .output()
        .unwrap();
    assert_refused(&output, 4, &["standard output", "No space left"]);
}

#[test]
fn data_of_a_gltf_file_beside_it_are_no_place_for_an_output() {
    let folder = folder();
    std::fs::write(folder.path().join("box.obj"), cuboid(1.0, 1.0, 1.0).obj()).unwrap();
    done(folder.path(), "-q mesh convert box.obj -o box.gltf");
    let path = folder.path().join("box.gltf");
    let mut gltf: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let length = gltf["buffers"][0]["byteLength"].as_u64().unwrap();
    gltf["buffers"][0]["uri"] = "box.bin".into();
    std::fs::write(&path, gltf.to_string()).unwrap();
    refused(
        folder.path(),
        "mesh info box.gltf",
        3,
        &["box.gltf", "box.bin"],
    );
    std::fs::write(folder.path().join("box.bin"), vec![0; length as usize]).unwrap();
    // all indices are 0 then, which is a mesh all the same
    done(folder.path(), "-q mesh info box.gltf");
    refused(
        folder.path(),
        "mesh convert box.gltf -o box.bin --format ply",
        2,
        &["it is an input"],
    );
}

#[test]
fn standard_input_that_is_no_mesh_is_given_up_while_it_still_comes() {
    use std::io::Write as _;
    let folder = folder();
    for bytes in [
        &[0; 4096][..],
        &b"y\n".repeat(2048),
        &[b' '; 4096],
        &[b'{'; 4096],
    ] {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_ravec"))
            .args(["mesh", "info", "-"])
            .current_dir(folder.path())
            .stdin(std::process::Stdio::piped())
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let mut input = child.stdin.take().unwrap();
        // the pipe breaks as soon as nobody reads any more; else this would write 4 GiB
        let written = (0..1 << 20)
            .take_while(|_| input.write_all(bytes).is_ok())
            .count();
        drop(input);
        let output = child.wait_with_output().unwrap();
        assert_refused(
            &output,
            3,
            &["standard input", "does not look like a mesh file"],
        );
        assert!(written < 1024, "{written} blocks");
    }
}

#[test]
fn a_small_file_that_becomes_a_large_mesh_is_refused_with_the_flag_that_allows_it() {
    let folder = folder();
    std::fs::write(folder.path().join("large.obj"), "v 0 0 0\n".repeat(300_000)).unwrap();
    for line in readers("large.obj") {
        let line = format!("{line} --max-bytes 5M");
        refused(
            folder.path(),
            &line,
            3,
            &["large.obj", "5000000", "--max-bytes"],
        );
    }
    done(folder.path(), "-q mesh info large.obj --max-bytes 30M");
}

#[test]
fn control_characters_of_a_mesh_file_do_not_reach_the_terminal() {
    let folder = folder();
    let evil = "\u{1b}]0;title\u{7}";
    let blank = " ".repeat(2000);
    let write = |name: &str, text: String| {
        std::fs::write(folder.path().join(name), text).unwrap();
    };
    write("word.stl", format!("solid a\n{blank}{evil}\n"));
    write("word.ply", format!("ply\nformat ascii 1.0\n{evil}\n"));
    write("word.obj", format!("v 0 0 0\n{blank}\nf {evil}\n"));
    write("word.off", format!("OFF\n{blank}\n{evil}\n"));
    write(
        "word.gltf",
        "{\"buffers\":[{\"byteLength\":1,\"uri\":\"\\u001b]0;title\\u0007\"}]}".to_owned(),
    );
    for name in ["word.stl", "word.ply", "word.obj", "word.off", "word.gltf"] {
        let output = ravec(folder.path(), &["mesh", "info", name]);
        assert_eq!(code(&output), 3, "{name}");
        let said = stderr(&output);
        assert!(said.contains("\\u{1b}]0;title\\u{7}"), "{name}: {said}");
        assert!(!said.contains(['\u{1b}', '\u{7}']), "{name}: {said}");
    }
}
