//! Variants of formats that some programs write: other line ends, counts that were never filled in, words apart, straight
//! corners, and glTF files whose shape stands in extensions.

use std::io::Read;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use ravec_mesh::{CheckParams, TriMesh, check, measure};
use ravec_mesh_io::{
    MeshFile, MeshFormat, MeshLimits, ReadMeshError, ReadOptions, ReadWarning, WriteOptions,
    read_mesh, write_mesh,
};
use ravec_progress::Progress;
use ravec_scenes::solids::cuboid;

fn read(file: &[u8]) -> Result<MeshFile, ReadMeshError> {
    read_mesh(file, &ReadOptions::default(), &Progress::none())
}

/// As from a path, where the size is known.
fn read_sized(file: &[u8]) -> Result<MeshFile, ReadMeshError> {
    let options = ReadOptions {
        size: Some(file.len() as u64),
        ..ReadOptions::default()
    };
    read_mesh(file, &options, &Progress::none())
}

/// A block of 2 × 3 × 4.
fn block() -> TriMesh {
    cuboid([2.0, 3.0, 4.0].into()).mesh
}

fn written(format: MeshFormat) -> Vec<u8> {
    let mut file = Vec::new();
    let (options, progress) = (WriteOptions::default(), Progress::none());
    write_mesh(&block(), format, &options, &mut file, &progress).unwrap();
    file
}

fn volume(file: &MeshFile) -> f64 {
    measure(&file.mesh).volume
}

#[test]
fn text_formats_are_read_with_any_line_ends() {
    for format in [
        MeshFormat::StlAscii,
        MeshFormat::PlyAscii,
        MeshFormat::Obj,
        MeshFormat::Off,
    ] {
        let text = String::from_utf8(written(format)).unwrap();
        let plain = read(text.as_bytes()).unwrap();
        assert_eq!(plain.mesh.triangles().len(), 12);
        // every third line ends like that of another system
        let mixed: String = text
            .lines()
            .enumerate()
            .map(|(i, line)| line.to_owned() + ["\n", "\r", "\r\n"][i % 3])
            .collect();
        let cut = text.trim_end().replace('\n', "\r");
        for other in [
            text.replace('\n', "\r"),
            text.replace('\n', "\r\n"),
            mixed,
            cut,
        ] {
            let file = read(other.as_bytes()).unwrap();
            assert_eq!(file, plain, "{format}");
        }
    }
}

#[test]
fn binary_ply_is_read_with_any_line_ends_in_its_header() {
    let file = written(MeshFormat::PlyBinary);
    let end = b"end_header\n";
    let split = file.windows(end.len()).position(|part| part == end);
    let (header, data) = file.split_at(split.unwrap() + end.len());
    let header = std::str::from_utf8(header).unwrap();
    // the first number in the data may look like a line end
    for first in [None, Some(b'\n'), Some(b'\r')] {
        let mut data = data.to_vec();
        if let Some(first) = first {
            data[0] = first;
        }
        let plain = read(&[header.as_bytes(), &data].concat()).unwrap();
        for end in ["\r", "\r\n"] {
            let header = header.replace('\n', end);
            let other = read(&[header.as_bytes(), &data].concat()).unwrap();
            assert_eq!(other, plain, "{end:?} before {first:?}");
        }
    }
}

#[test]
fn a_stl_without_a_count_is_read_by_its_length() {
    let right = written(MeshFormat::StlBinary);
    let plain = read(&right).unwrap();
    let other_count = |announced: u32| {
        let mut file = right.clone();
        file[80..84].copy_from_slice(&announced.to_le_bytes());
        file
    };
    for announced in [0, u32::MAX, 11, 13, 1_000_000, 0xcdcd_cdcd] {
        let file = other_count(announced);
        for outcome in [read(&file), read_sized(&file)] {
            let outcome = outcome.unwrap();
            assert_eq!(outcome.mesh, plain.mesh, "{announced}");
            let announced = u64::from(announced);
            let expected = ReadWarning::OtherCount {
                announced,
                found: 12,
            };
            assert_eq!(outcome.warnings, [expected]);
        }
        assert_eq!(MeshFormat::sniff(&file), Some(MeshFormat::StlBinary));
    }
    // cut off inside of a triangle
    for announced in [13, 1_000_000] {
        let mut file = other_count(announced);
        file.truncate(file.len() - 20);
        for outcome in [read(&file), read_sized(&file)] {
            assert!(matches!(outcome, Err(ReadMeshError::Truncated { .. })));
        }
    }
    let mut unknown = other_count(u32::MAX);
    unknown.push(1);
    let file = read_sized(&unknown).unwrap();
    assert_eq!(file.mesh, plain.mesh);
    assert_eq!(file.warnings[1], ReadWarning::MoreBehindTheEnd);
}

#[test]
fn an_empty_stl_stays_empty_and_padding_is_no_triangle() {
    let mut empty = vec![b' '; 84];
    empty[80..].fill(0);
    for outcome in [read(&empty), read_sized(&empty)] {
        let file = outcome.unwrap();
        assert_eq!(file.warnings, [ReadWarning::NoTriangles]);
    }
    let mut padded = written(MeshFormat::StlBinary);
    padded.extend([0; 500]);
    for outcome in [read(&padded), read_sized(&padded)] {
        let file = outcome.unwrap();
        assert_eq!(file.mesh.triangles().len(), 12);
        assert_eq!(file.warnings, [ReadWarning::MoreBehindTheEnd]);
    }
}

#[test]
fn triangles_that_no_header_announces_are_limited_too() {
    let mut file = written(MeshFormat::StlBinary);
    for announced in [0, u32::MAX] {
        file[80..84].copy_from_slice(&announced.to_le_bytes());
        for size in [None, Some(file.len() as u64)] {
            let options = ReadOptions {
                size,
                limits: MeshLimits {
                    max_triangles: 11,
                    ..MeshLimits::default()
                },
                ..ReadOptions::default()
            };
            let outcome = read_mesh(&file[..], &options, &Progress::none());
            assert!(matches!(
                outcome,
                Err(ReadMeshError::TooMany { limit: 11, .. })
            ));
        }
    }
}

#[test]
fn a_stl_that_comes_in_small_pieces_is_read_by_its_length() {
    struct Pieces<'a>(&'a [u8]);
    impl Read for Pieces<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            let count = self.0.len().min(7).min(buffer.len());
            buffer[..count].copy_from_slice(&self.0[..count]);
            self.0 = &self.0[count..];
            Ok(count)
        }
    }
    let mut file = written(MeshFormat::StlBinary);
    file[80..84].fill(0);
    let outcome = read_mesh(Pieces(&file), &ReadOptions::default(), &Progress::none());
    assert_eq!(outcome.unwrap().mesh.triangles().len(), 12);
}

#[test]
fn ends_of_ascii_stl_may_be_two_words_in_any_case() {
    let text = String::from_utf8(written(MeshFormat::StlAscii)).unwrap();
    let plain = read(text.as_bytes()).unwrap();
    let name = text.lines().next().unwrap().strip_prefix("solid").unwrap();
    let nameless = text.replace(name, "");
    let apart = text
        .replace("endsolid", "end solid")
        .replace("endloop", "end loop")
        .replace("endfacet", "end  facet");
    for other in [
        text.replace("endsolid", "end solid"),
        text.replace("endloop", "end\tloop"),
        apart.clone(),
        apart.to_uppercase(),
        nameless.replace("endsolid", "End Solid"),
        text.replace("outer loop", "OuterLoop"),
        text.replace("outer loop", "outer\nloop"),
    ] {
        assert_eq!(read(other.as_bytes()).unwrap(), plain, "{other}");
    }
    let wrong = text.replace("endloop", "end vertex");
    assert!(matches!(
        read(wrong.as_bytes()),
        Err(ReadMeshError::Syntax { .. })
    ));
}

/// A block of 2 × 2 × 2 whose walls have `extra` corners on each of the edges along x.
fn walls(extra: usize) -> (Vec<DVec3>, Vec<Vec<usize>>) {
    let steps = extra + 1;
    let rows = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)];
    let mut positions = Vec::new();
    for (y, z) in rows {
        for i in 0..=steps {
            positions.push(DVec3::new(2.0 * i as f64 / steps as f64, y, z));
        }
    }
    let row = |which: usize| which * (steps + 1)..=which * (steps + 1) + steps;
    let mut faces = Vec::new();
    for which in 0..4 {
        let next = (which + 1) % 4;
        faces.push(row(next).chain(row(which).rev()).collect());
    }
    faces.push([3, 2, 1, 0].map(|which| *row(which).start()).into());
    faces.push([0, 1, 2, 3].map(|which| *row(which).end()).into());
    (positions, faces)
}

#[test]
fn walls_with_straight_corners_make_a_solid_in_all_formats() {
    use std::fmt::Write as _;
    for extra in [1, 2, 5] {
        let (positions, faces) = walls(extra);
        let (mut obj, mut lists, mut points) = (String::new(), String::new(), String::new());
        for at in &positions {
            writeln!(obj, "v {} {} {}", at.x, at.y, at.z).unwrap();
            writeln!(points, "{} {} {}", at.x, at.y, at.z).unwrap();
        }
        for face in &faces {
            let words: Vec<String> = face.iter().map(ToString::to_string).collect();
            writeln!(lists, "{} {}", face.len(), words.join(" ")).unwrap();
            let words: Vec<String> = face.iter().map(|i| (i + 1).to_string()).collect();
            writeln!(obj, "f {}", words.join(" ")).unwrap();
        }
        let (vertices, count) = (positions.len(), faces.len());
        let off = format!("OFF\n{vertices} {count} 0\n{points}{lists}");
        let ply = format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty double x\nproperty double y\n\
             property double z\nelement face {count}\nproperty list uchar int vertex_indices\nend_header\n{points}{lists}"
        );
        for text in [obj, off, ply] {
            let file = read(text.as_bytes()).unwrap();
            let found = check(&file.mesh, &CheckParams::default(), &Progress::none()).unwrap();
            assert!(found.is_solid(), "{text}\n{found:?}");
            assert!((volume(&file) - 8.0).abs() < 1e-12);
        }
    }
}

/// A glTF file whose mesh is a block of 2 × 3 × 4, with accessors for a shift, a turn and a scale of each of three
/// instances, and `node` and `rest` in its node and behind all.
fn instanced(node: &str, rest: &str) -> Vec<u8> {
    let mesh = block();
    let mut data = Vec::new();
    for at in mesh.positions() {
        data.extend(at.as_vec3().to_array().iter().flat_map(|x| x.to_le_bytes()));
    }
    for corners in mesh.triangles() {
        data.extend(corners.iter().flat_map(|&i| (i as u16).to_le_bytes()));
    }
    let numbers = [0.0_f32, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 20.0, 0.0];
    data.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
    let scales = [1.0_f32, 1.0, 1.0, 2.0, 2.0, 2.0, -1.0, 1.0, 1.0];
    data.extend(scales.iter().flat_map(|x| x.to_le_bytes()));
    // a quarter about z, none, and half about x
    let turns = [[0_i16, 0, 23170, 23170], [0, 0, 0, 32767], [32767, 0, 0, 0]];
    data.extend(turns.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    let view = |at: usize, length: usize| {
        format!("{{\"buffer\":0,\"byteOffset\":{at},\"byteLength\":{length}}}")
    };
    let views = [
        view(0, 96),
        view(96, 72),
        view(168, 36),
        view(204, 36),
        view(240, 24),
    ];
    let accessor = |view: usize, code: u32, count: usize, kind: &str| {
        format!(
            "{{\"bufferView\":{view},\"componentType\":{code},\"count\":{count},\"type\":\"{kind}\"}}"
        )
    };
    let accessors = [
        accessor(0, 5126, 8, "VEC3"),
        accessor(1, 5123, 36, "SCALAR"),
        accessor(2, 5126, 3, "VEC3"),
        accessor(3, 5126, 3, "VEC3"),
        accessor(4, 5122, 3, "VEC4").replace("\"count\"", "\"normalized\":true,\"count\""),
        // sparse, above zeros: the block moved is as high as its only point
        "{\"componentType\":5126,\"count\":3,\"type\":\"VEC3\",\"sparse\":{\"count\":1,\
         \"indices\":{\"bufferView\":1,\"componentType\":5123},\"values\":{\"bufferView\":3}}}"
            .to_owned(),
        accessor(2, 5126, 2, "VEC3"),
    ];
    let encoded = STANDARD.encode(&data);
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"buffers\":[{{\"byteLength\":{},\"uri\":\"data:;base64,{encoded}\"}}],\
         \"bufferViews\":[{}],\"accessors\":[{}],\"nodes\":[{{\"mesh\":0{node}}}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}},\"indices\":1}}]}}]{rest}}}",
        data.len(),
        views.join(","),
        accessors.join(",")
    )
    .into_bytes()
}

fn placed_by(attributes: &str) -> String {
    format!(",\"extensions\":{{\"EXT_mesh_gpu_instancing\":{{\"attributes\":{{{attributes}}}}}}}")
}

#[test]
fn gltf_instances_are_placed_by_what_is_given_of_shift_turn_and_scale() {
    for (attributes, expected) in [
        ("", 24.0),
        ("\"TRANSLATION\":2", 72.0),
        ("\"SCALE\":3", 24.0 * (1.0 + 8.0 + 1.0)),
        ("\"ROTATION\":4", 72.0),
        (
            "\"TRANSLATION\":2,\"ROTATION\":4,\"SCALE\":3,\"_ID\":0",
            240.0,
        ),
        ("\"TRANSLATION\":5", 72.0),
    ] {
        let file = read(&instanced(&placed_by(attributes), "")).unwrap();
        assert!((volume(&file) - expected).abs() < 1e-3, "{attributes}");
        assert_eq!(file.warnings, []);
    }
    // the second one is twice as large, and 10 to the right
    let file = read(&instanced(&placed_by("\"TRANSLATION\":2,\"SCALE\":3"), "")).unwrap();
    for (corner, at) in block()
        .positions()
        .iter()
        .zip(&file.mesh.positions()[8..16])
    {
        assert_eq!(*at, 2.0 * *corner + DVec3::new(10.0, 0.0, 0.0));
    }
    // a quarter turn about z
    let file = read(&instanced(&placed_by("\"ROTATION\":4"), "")).unwrap();
    for (corner, at) in block().positions().iter().zip(file.mesh.positions()) {
        assert!(at.distance(DVec3::new(-corner.y, corner.x, corner.z)) < 1e-12);
    }
    for (attributes, what) in [
        (
            "\"TRANSLATION\":2,\"SCALE\":6",
            "another number of instances",
        ),
        ("\"ROTATION\":2", "VEC4"),
        ("\"SCALE\":99", "no such accessor"),
    ] {
        let error = read(&instanced(&placed_by(attributes), "")).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
    }
}

#[test]
fn gltf_instances_count_for_the_limits() {
    let options = ReadOptions {
        limits: MeshLimits {
            max_triangles: 30,
            ..MeshLimits::default()
        },
        ..ReadOptions::default()
    };
    let file = instanced(&placed_by("\"TRANSLATION\":2"), "");
    let outcome = read_mesh(&file[..], &options, &Progress::none());
    assert!(matches!(
        outcome,
        Err(ReadMeshError::TooMany { limit: 30, .. })
    ));
}

#[test]
fn gltf_positions_that_are_only_sparse_are_zeros_elsewhere() {
    let file = instanced("", "");
    let text = String::from_utf8(file).unwrap();
    let sparse = text.replace("\"POSITION\":0},\"indices\":1", "\"POSITION\":5}");
    let file = read(sparse.as_bytes()).unwrap();
    assert_eq!(
        file.mesh.positions(),
        [DVec3::ONE, DVec3::ZERO, DVec3::ZERO]
    );
    // far more of them than bytes
    for count in ["300000000", "18446744073709551615"] {
        let huge = sparse.replace(
            "\"count\":3,\"type\":\"VEC3\",\"sparse\"",
            &format!("\"count\":{count},\"type\":\"VEC3\",\"sparse\""),
        );
        let outcome = read(huge.as_bytes());
        assert!(
            matches!(outcome, Err(ReadMeshError::TooMany { .. })),
            "{outcome:?}"
        );
    }
}

#[test]
fn gltf_extensions_that_may_change_the_shape_are_named_or_refused() {
    let with = |rest: &str| read(&instanced("", rest));
    let harmless = ",\"extensionsUsed\":[\"KHR_materials_ior\",\"KHR_lights_punctual\",\"EXT_texture_webp\",\
        \"KHR_draco_mesh_compression\",\"EXT_mesh_gpu_instancing\"]";
    assert_eq!(with(harmless).unwrap().warnings, []);
    let used = with(",\"extensionsUsed\":[\"KHR_materials_ior\",\"ACME_bend\"]").unwrap();
    let expected = ReadWarning::UnknownExtensions {
        names: vec!["ACME_bend".to_owned()],
        more: 0,
    };
    assert!(expected.to_string().contains("ACME_bend"));
    assert_eq!(used.warnings, [expected]);
    let error = with(",\"extensionsRequired\":[\"EXT_mesh_gpu_instancing\",\"ACME_bend\"]");
    assert!(error.unwrap_err().to_string().contains("`ACME_bend`"));
}

#[test]
fn gltf_poses_are_named_and_hidden_nodes_left_out() {
    let rest_pose = |of| ReadWarning::RestPose { of };
    for (node, expected) in [
        (",\"skin\":0", vec![rest_pose("skins")]),
        (",\"weights\":[0,0.5]", vec![rest_pose("morph targets")]),
        (",\"weights\":[0,0]", vec![]),
        (
            ",\"extensions\":{\"KHR_node_visibility\":{\"visible\":true}}",
            vec![],
        ),
    ] {
        let file = read(&instanced(node, "")).unwrap();
        assert_eq!(file.warnings, expected, "{node}");
        assert_eq!(file.mesh.triangles().len(), 12);
    }
    let hidden = ",\"extensions\":{\"KHR_node_visibility\":{\"visible\":false}}";
    let file = read(&instanced(hidden, "")).unwrap();
    let what = "nodes that the file hides";
    let expected = [ReadWarning::Ignored { what }, ReadWarning::NoTriangles];
    assert_eq!(file.warnings, expected);
}
