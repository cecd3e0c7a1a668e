//! Files as other programs write them: STL, PLY, OBJ and OFF.

use ravec_mesh_io::{
    MeshFile, MeshFormat, Place, ReadMeshError, ReadOptions, ReadWarning, read_mesh,
};
use ravec_progress::Progress;

fn read(file: &[u8]) -> Result<MeshFile, ReadMeshError> {
    read_mesh(file, &ReadOptions::default(), &Progress::none())
}

/// The place of a fault, and what is wrong.
fn fault(file: &[u8]) -> (Place, String) {
    match read(file) {
        Err(ReadMeshError::Syntax { place, what, .. }) => (place, what),
        other => panic!("{other:?} is not an error of syntax"),
    }
}

fn ignored(what: &'static str) -> ReadWarning {
    ReadWarning::Ignored { what }
}

#[test]
fn obj_faces_may_count_from_either_end_and_go_on_in_the_next_line() {
    let text = b"# a pyramid\nmtllib stone.mtl\no pyramid\nv 0 0 0 1.0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0\nv 0 1 0\n\
        vt 0 0\nvn 0 0 1\ng base\nusemtl stone\ns off\nf 4/1/1 3/1/1 2/1/1 1/1/1 # a comment\n\
        v .5 5e-1 1E0\nf -5// -4//1 \\\n  -1/1\nf 2 3 5\nl 1 2 3\np 1";
    let file = read(text).unwrap();
    assert_eq!(file.format, MeshFormat::Obj);
    assert_eq!(file.mesh.positions()[4].to_array(), [0.5, 0.5, 1.0]);
    assert_eq!(
        file.mesh.triangles(),
        [[3, 2, 1], [3, 1, 0], [0, 1, 4], [1, 2, 4]]
    );
    let cut = ReadWarning::PolygonsCut {
        polygons: 1,
        triangles: 2,
    };
    let expected = [
        ignored("materials"),
        ignored("colors"),
        ignored("texture coordinates"),
        ignored("normals"),
        ignored("lines"),
        ignored("points"),
        cut,
    ];
    assert_eq!(file.warnings, expected);
}

#[test]
fn obj_faces_may_stand_before_their_vertices() {
    let file = read(b"f 1 2 3\nf 3 2\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").unwrap();
    assert_eq!(file.mesh.triangles(), [[0, 1, 2]]);
    assert_eq!(file.warnings, [ReadWarning::FacesLeftOut { faces: 1 }]);
}

#[test]
fn a_concave_polygon_is_covered_exactly_once() {
    // An L of area 3, with its corners counted from the hollow one on.
    let text = b"v 1 1 0\nv 1 2 0\nv 0 2 0\nv 0 0 0\nv 2 0 0\nv 2 1 0\nf 1 2 3 4 5 6\n";
    let file = read(text).unwrap();
    let areas = (0..4).map(|t| {
        let [a, b, c] = file.mesh.corners(t);
        0.5 * (b - a).cross(c - a).z
    });
    let areas: Vec<f64> = areas.collect();
    assert!(areas.iter().all(|&area| area > 0.0), "{areas:?}");
    assert_eq!(areas.iter().sum::<f64>(), 3.0);
}

#[test]
fn obj_faults_name_their_line() {
    assert_eq!(fault(b"v 1 2 3\n\nv 1 2\n").0, Place::Line(3));
    assert_eq!(fault(b"v 1 2 3\nf 1 1 x/2\n").0, Place::Line(2));
    assert_eq!(fault(b"v 1 2 3\nf 1 \\\n1 \\\nx").0, Place::Line(2));
    assert_eq!(fault(b"v 1 2 3\n\xff\xfe\n").0, Place::Line(2));
    for (text, written, line) in [
        ("v 0 0 0\nf 1 2 1", 2, 2),
        ("v 0 0 0\nf 0 1 1", 0, 2),
        ("v 0 0 0\n\nf 1 1 -2", -2, 3),
    ] {
        match read(text.as_bytes()) {
            Err(ReadMeshError::NoSuchVertex {
                place,
                index,
                vertices,
                ..
            }) => assert_eq!((place, index, vertices), (Place::Line(line), written, 1)),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn off_is_read_with_its_prefixes_and_without_its_first_word() {
    let body = "4 2 0\n0 0 0{v}\n1 0 0{v}\n0 1 0{v}\n0 0 1{v}\n3 0 1 2{f}\n4 0 1 2 3{f}\n";
    let plain = [[0, 1, 2]];
    for (head, vertex, face, left_out) in [
        ("OFF\n", "", "", &[][..]),
        ("OFF ", "", "", &[]),
        ("OFF", "", "", &[]),
        ("", "", "", &[]),
        ("# c\nOFF # c\n\n", " # c", " # c", &[]),
        ("COFF\n", " 1 0 0 1", " 0.5 0.5 0.5", &["colors"]),
        ("NOFF\n", " 0 0 1", "", &["normals"]),
        (
            "STCNOFF\n",
            " 0 0 1 1 1 1 1 0 0",
            "",
            &["texture coordinates", "colors", "normals"],
        ),
    ] {
        let text = head.to_owned() + &body.replace("{v}", vertex).replace("{f}", face);
        let file = read(text.as_bytes()).unwrap_or_else(|error| panic!("{head}: {error}"));
        assert_eq!(file.format, MeshFormat::Off);
        assert_eq!(file.mesh.triangles()[..1], plain);
        assert_eq!(file.mesh.triangles().len(), 3);
        let mut expected: Vec<_> = left_out.iter().map(|&what| ignored(what)).collect();
        expected.push(ReadWarning::PolygonsCut {
            polygons: 1,
            triangles: 2,
        });
        assert_eq!(file.warnings, expected, "{head}");
    }
}

#[test]
fn off_faults_name_their_line() {
    assert_eq!(fault(b"OFF\n1 x 0\n").0, Place::Line(2));
    assert_eq!(fault(b"OFF\n1\n").0, Place::Line(2));
    assert_eq!(fault(b"OFF\n1 0 0\n0 0\n").0, Place::Line(3));
    assert_eq!(fault(b"OFF\n1 1 0\n0 0 0\n-3 0 0 0").0, Place::Line(4));
    assert_eq!(fault(b"OFF\n1 1 0\n0 0 0\n3 0 0").0, Place::Line(4));
    for unsupported in [
        &b"4OFF\n0 0 0\n"[..],
        b"nOFF\n3\n0 0 0\n",
        b"OFF BINARY\n1 1 1",
    ] {
        assert!(matches!(
            read(unsupported),
            Err(ReadMeshError::Unsupported { .. })
        ));
    }
    for cut in [
        &b"OFF"[..],
        b"OFF\n2 0 0\n0 0 0\n",
        b"OFF\n1 2 0\n0 0 0\n3 0 0 0\n",
    ] {
        assert!(matches!(read(cut), Err(ReadMeshError::Truncated { .. })));
    }
    let more = read(b"OFF\n1 1 0\n0 0 0\n3 0 0 0\n3 0 0 0\n").unwrap();
    assert_eq!(more.warnings, [ReadWarning::MoreBehindTheEnd]);
}

#[test]
fn ascii_stl_faults_name_their_line() {
    let facet = |corners: usize, end: &str| {
        let corners = "vertex 0 0 0\n".repeat(corners);
        format!("solid\nfacet normal 0 0 1\nouter loop\n{corners}{end}").into_bytes()
    };
    let end = "endloop\nendfacet\nendsolid";
    assert!(read(&facet(3, end)).is_ok());
    assert_eq!(fault(&facet(2, end)).0, Place::Line(6));
    assert_eq!(fault(&facet(4, end)).0, Place::Line(7));
    assert_eq!(fault(&facet(3, "facet normal 0 0 1")).0, Place::Line(7));
    assert_eq!(fault(&facet(3, "endsolid")).0, Place::Line(7));
    assert_eq!(fault(&facet(3, "outer loop")).0, Place::Line(7));
    assert_eq!(fault(&facet(3, "loop")).0, Place::Line(7));
    assert_eq!(fault(b"solid\nvertex 0 0 0").0, Place::Line(2));
    assert_eq!(fault(b"solid\nfacet\nsmooth").0, Place::Line(3));
    assert_eq!(fault(&facet(1, "vertex 0 0 z")).0, Place::Line(5));
    for cut in [
        facet(3, ""),
        facet(1, "vertex 0"),
        facet(0, ""),
        b"solid\nfacet".to_vec(),
    ] {
        assert!(matches!(read(&cut), Err(ReadMeshError::Truncated { .. })));
    }
    let unended = read(&facet(3, "endloop\nendfacet\n")).unwrap();
    assert_eq!(unended.warnings, [ReadWarning::NoEnd]);
}

#[test]
fn the_solids_of_an_ascii_stl_are_one_mesh_and_their_normals_do_not_matter() {
    let facet = "facet normal nan nan nan\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let text =
        format!("solid a vertex 1 2 3\n{facet}endsolid a vertex\nsolid\n{facet}{facet}endsolid\n");
    let file = read(text.as_bytes()).unwrap();
    assert_eq!(file.mesh.triangles(), [[0, 1, 2]; 3]);
    assert_eq!(file.warnings, []);
}

#[test]
fn bytes_behind_a_binary_stl_are_remarked() {
    let mut file = vec![0; 84 + 50];
    file[80] = 1;
    file.push(7);
    assert_eq!(
        read(&file).unwrap().warnings,
        [ReadWarning::MoreBehindTheEnd]
    );
    file[80] = 2;
    match read(&file) {
        Err(ReadMeshError::Truncated { place, inside, .. }) => {
            assert_eq!(place, Place::Byte(135));
            assert_eq!(inside, "triangle 1 of 2");
        }
        other => panic!("{other:?}"),
    }
}

/// A number in one of the types of PLY.
fn encoded(kind: &str, encoding: &str, value: i32) -> Vec<u8> {
    let mut bytes = match kind {
        "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
        "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
        "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
        "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
        "int" | "int32" => value.to_le_bytes().to_vec(),
        "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
        "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
        _ => f64::from(value).to_le_bytes().to_vec(),
    };
    if encoding == "binary_big_endian" {
        bytes.reverse();
    }
    bytes
}

#[test]
fn ply_is_read_in_all_types_and_encodings() {
    const WHOLE: [&str; 6] = ["int8", "uchar", "short", "uint16", "int", "uint32"];
    const REAL: [&str; 8] = [
        "char", "uint8", "int16", "ushort", "int32", "uint", "float", "double",
    ];
    const PLACES: [[i32; 3]; 4] = [[0, 0, 0], [7, 0, 0], [7, 5, 0], [0, 5, 0]];
    const FACES: [&[i32]; 2] = [&[0, 1, 2], &[3, 2, 1, 0]];
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for coordinate in REAL {
            for (count, index) in WHOLE.iter().flat_map(|c| WHOLE.map(|i| (*c, i))) {
                for extra in [false, true] {
                    let property = |line: &'static str| if extra { line } else { "" };
                    let mut file = format!(
                        "ply\nformat {encoding} 1.0\ncomment x\nelement vertex 4\nproperty {coordinate} z\n{}\
                         property {coordinate} x\nproperty {coordinate} y\n{}\
                         element face 2\n{}property list {count} {index} vertex_indices\nend_header\n",
                        property("property uchar red\n"),
                        property("element thing 1\nproperty list uchar int things\n"),
                        property("property list short double texcoord\n"),
                    )
                    .into_bytes();
                    let mut put = |kind: &str, value: i32, last: bool| {
                        if encoding == "ascii" {
                            file.extend(value.to_string().bytes());
                            file.push(if last { b'\n' } else { b' ' });
                        } else {
                            file.extend(encoded(kind, encoding, value));
                        }
                    };
                    for [x, y, z] in PLACES {
                        put(coordinate, z, false);
                        if extra {
                            put("uchar", 200, false);
                        }
                        put(coordinate, x, false);
                        put(coordinate, y, true);
                    }
                    if extra {
                        put("uchar", 2, false);
                        put("int", -1, false);
                        put("int", 7, true);
                    }
                    for face in FACES {
                        if extra {
                            put("short", 1, false);
                            put("double", 3, false);
                        }
                        put(count, face.len() as i32, false);
                        for (i, &corner) in face.iter().enumerate() {
                            put(index, corner, i + 1 == face.len());
                        }
                    }
                    let name = format!("{encoding} {coordinate} {count} {index} {extra}");
                    let found = read(&file).unwrap_or_else(|error| panic!("{name}: {error}"));
                    let places = found.mesh.positions().iter().map(glam::DVec3::to_array);
                    let expected = PLACES.map(|at| at.map(f64::from));
                    assert_eq!(places.collect::<Vec<_>>(), expected, "{name}");
                    assert_eq!(
                        found.mesh.triangles(),
                        [[0, 1, 2], [3, 2, 1], [3, 1, 0]],
                        "{name}"
                    );
                    assert_eq!(found.warnings.len(), 1 + 3 * usize::from(extra), "{name}");
                }
            }
        }
    }
}

#[test]
fn ply_strips_and_faces_before_vertices_are_read() {
    let text = "ply\nformat ascii 1.0\nelement tristrips 1\nproperty list int int vertex_indices\n\
        element vertex 5\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
        9 0 1 2 3 -1 2 3 4 -1\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n1 2 0\n";
    let file = read(text.as_bytes()).unwrap();
    assert_eq!(file.mesh.triangles(), [[0, 1, 2], [2, 1, 3], [2, 3, 4]]);
}

#[test]
fn ply_faults_name_their_place() {
    let header = |lines: &str| format!("ply\nformat ascii 1.0\n{lines}\nend_header\n");
    let vertex = "element vertex 1\nproperty float x\nproperty float y\nproperty float z";
    let face = "element face 1\nproperty list uchar int vertex_indices";
    for (text, line) in [
        ("ply\nformat utf8 1.0\n".to_owned(), 2),
        ("ply\nelement vertex 0\nend_header\n".to_owned(), 4),
        (header("element vertex -1"), 3),
        (header("property float x"), 3),
        (header("element vertex 1\nproperty real x"), 4),
        (header("element vertex 1\nproperty list uchar x"), 4),
        (header("elephant 1"), 3),
        (
            header("element vertex 1\nproperty float x\nproperty float y"),
            7,
        ),
        (header("element face 1\nproperty int vertex_indices"), 6),
        (header(vertex) + "0 0\n", 8),
        (header(vertex) + "0 0 z\n", 8),
        (header(&format!("{vertex}\n{face}")) + "0 0 0\n3 0 0\n", 11),
        (
            header(&format!("{vertex}\n{face}")) + "0 0 0\n3 0 0 0.5\n",
            11,
        ),
        (
            header(&format!("{vertex}\n{face}")) + "0 0 0\n-3 0 0 0\n",
            11,
        ),
    ] {
        assert_eq!(fault(text.as_bytes()).0, Place::Line(line), "{text}");
    }
    let binary = header(&format!("{vertex}\n{face}")).replace("ascii", "binary_little_endian");
    let begin = binary.len() as u64;
    let mut file = [
        binary.as_bytes(),
        &[0; 12],
        &[3, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0],
    ]
    .concat();
    match read(&file) {
        Err(ReadMeshError::NoSuchVertex { place, index, .. }) => {
            assert_eq!((place, index), (Place::Byte(begin + 12), 2));
        }
        other => panic!("{other:?}"),
    }
    file.truncate(file.len() - 1);
    assert!(matches!(read(&file), Err(ReadMeshError::Truncated { .. })));
    let count = file.len() - 12;
    let short = String::from_utf8(file[..begin as usize].to_vec())
        .unwrap()
        .replace("uchar int", "char int");
    let mut file = [short.as_bytes(), &file[begin as usize..]].concat();
    file[count - 1] = 0xff;
    assert_eq!(fault(&file).1, "-1 is not the length of a list");
}

#[test]
fn coordinates_that_are_no_numbers_are_named() {
    let nan = f32::NAN.to_le_bytes();
    let mut stl = [0; 84 + 100];
    stl[80] = 2;
    stl[84 + 50 + 28..][..4].copy_from_slice(&nan);
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let mut ply = [header.as_bytes(), &[0; 24]].concat();
    ply[header.len() + 12..][..4].copy_from_slice(&nan);
    let ply_place = Place::Byte(header.len() as u64 + 12);
    for (file, at, number) in [
        (&stl[..], Place::Byte(84 + 50 + 24), 4),
        (&ply[..], ply_place, 1),
        (b"v 0 0 0\nv 0 inf 0\n", Place::Line(2), 1),
        (b"OFF\n1 0 0\n1e999 0 0\n", Place::Line(3), 0),
        (
            b"solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex -NaN 0 0\n",
            Place::Line(5),
            1,
        ),
    ] {
        match read(file) {
            Err(ReadMeshError::NotFinite { place, vertex, .. }) => {
                assert_eq!((place, vertex), (at, number));
            }
            other => panic!("{other:?}"),
        }
    }
}
