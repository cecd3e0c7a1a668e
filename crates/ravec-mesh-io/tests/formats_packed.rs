//! Files as other programs write them: 3MF and glTF.

use std::io::{Cursor, Read, Write as _};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use ravec_memory::MemoryBudget;
use ravec_mesh_io::{
    LengthUnit, MeshFile, MeshFormat, Place, ReadMeshError, ReadOptions, ReadWarning, read_mesh,
    read_mesh_with_buffers,
};
use ravec_progress::Progress;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

fn read(file: &[u8]) -> Result<MeshFile, ReadMeshError> {
    read_mesh(file, &ReadOptions::default(), &Progress::none())
}

fn places(file: &MeshFile) -> Vec<[f64; 3]> {
    file.mesh
        .positions()
        .iter()
        .map(glam::DVec3::to_array)
        .collect()
}

fn archive(entries: &[(&str, &str)]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in entries {
        archive
            .start_file(*name, SimpleFileOptions::default())
            .unwrap();
        archive.write_all(content.as_bytes()).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

fn model(resources: &str, build: &str) -> Vec<u8> {
    let model = format!(
        "<?xml version=\"1.0\"?><model unit=\"inch\" xmlns=\"c\" xmlns:p=\"http://x/production/2015\">\
         <resources>{resources}</resources><build>{build}</build></model>"
    );
    archive(&[("3D/3dmodel.model", &model)])
}

const TRIANGLE: &str = "<object id=\"1\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" y=\"0\" z=\"0\"/>\
    <vertex x=\"0\" y=\"1\" z=\"0\"/></vertices><triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\"/></triangles></mesh></object>";

#[test]
fn a_3mf_item_places_its_object_and_its_components() {
    // A quarter turn about z inside of a shift; beside it the same object mirrored.
    let both = "<object id=\"2\"><components><component objectid=\"1\" transform=\"0 1 0 -1 0 0 0 0 1 0 0 5\"/>\
        <component objectid=\"1\" transform=\"-1 0 0 0 1 0 0 0 1 0 0 0\"/></components></object>";
    let item = "<item objectid=\"2\" transform=\"1 0 0 0 1 0 0 0 1 10 20 30\"/>";
    let file = read(&model(&(TRIANGLE.to_owned() + both), item)).unwrap();
    assert_eq!(
        (file.format, file.unit),
        (MeshFormat::ThreeMf, Some(LengthUnit::Inch))
    );
    let expected = [
        [10.0, 20.0, 35.0],
        [10.0, 21.0, 35.0],
        [9.0, 20.0, 35.0],
        [10.0, 20.0, 30.0],
        [9.0, 20.0, 30.0],
        [10.0, 21.0, 30.0],
    ];
    assert_eq!(places(&file), expected);
    assert_eq!(file.mesh.triangles(), [[0, 1, 2], [3, 5, 4]]);
    let up = |triangle| {
        let [a, b, c] = file.mesh.corners(triangle);
        (b - a).cross(c - a).z
    };
    assert!(up(0) > 0.0 && up(1) > 0.0);
}

#[test]
fn a_3mf_model_may_be_spread_over_parts_and_be_found_by_a_relation() {
    let part = format!("<model><resources>{TRIANGLE}</resources></model>");
    let root = "<model unit=\"meter\"><resources><object id=\"1\"><components>\
        <component objectid=\"1\" p:path=\"/3D/Objects/A.model\"/></components></object></resources>\
        <build><item objectid=\"1\"/><item objectid=\"1\" p:path=\"/3d/objects/a.model\"/></build></model>";
    let relations = "<Relationships><Relationship Type=\"http://x/thumbnail\" Target=\"/no.png\"/>\
        <Relationship Type=\"http://x/3dmodel\" Target=\"/other.model\"/></Relationships>";
    let entries = [
        ("_rels/.rels", relations),
        ("3D/Objects/a.model", &part),
        ("Other.model", root),
    ];
    let file = read(&archive(&entries)).unwrap();
    assert_eq!(file.unit, Some(LengthUnit::Meter));
    assert_eq!(file.mesh.triangles(), [[0, 1, 2], [3, 4, 5]]);
    match read(&archive(&[entries[0], entries[2]])) {
        Err(ReadMeshError::Syntax { what, .. }) => assert!(what.contains("A.model"), "{what}"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn what_a_3mf_file_has_besides_triangles_is_remarked() {
    let materials = "<basematerials id=\"7\"><base name=\"a\"/></basematerials><slicestack/>";
    let file = read(&model(&(materials.to_owned() + TRIANGLE), "")).unwrap();
    let ignored = |what| ReadWarning::Ignored { what };
    let expected = [
        ignored("materials and colors"),
        ignored("slices"),
        ReadWarning::NoTriangles,
    ];
    assert_eq!(file.warnings, expected);
    let known = "<model requiredextensions=\"p b\" xmlns:p=\"http://x/production/1\" xmlns:b=\"http://x/beamlattice/2\"/>";
    let file = read(&archive(&[("3D/3dmodel.model", known)])).unwrap();
    assert_eq!(file.warnings, [ReadWarning::NoTriangles]);
    for (declared, named) in [
        (" xmlns:s=\"http://x/booleans/1\"", "booleans"),
        ("", "extension s,"),
    ] {
        let text = format!(
            "<model requiredextensions=\"p s\" xmlns:p=\"http://x/production/1\"{declared}/>"
        );
        match read(&archive(&[("3D/3dmodel.model", &text)])) {
            Err(ReadMeshError::Unsupported { what, .. }) => assert!(what.contains(named), "{what}"),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn faults_of_a_3mf_file_are_named() {
    let item = "<item objectid=\"1\"/>";
    let broken = |from: &str, to: &str| model(&TRIANGLE.replacen(from, to, 1), item);
    let own = "<object id=\"1\"><components><component objectid=\"1\"/></components></object>";
    let mut deep = TRIANGLE.to_owned();
    for id in 2..200 {
        let component = format!("<component objectid=\"{}\"/>", id - 1);
        let object = format!("<object id=\"{id}\"><components>{component}</components></object>");
        deep.push_str(&object);
    }
    for (file, expected) in [
        (
            broken("<vertex x=\"0\" ", "<vertex "),
            "lacks a number for x",
        ),
        (broken("v2=\"1\"", "v2=\"-1\""), "lacks an index for v1"),
        (
            broken("<object id=\"1\">", "<object>"),
            "no number for its id",
        ),
        (broken("<object id=\"1\">", ""), "outside of any object"),
        (
            broken("</vertices>", "</triangles>"),
            "in the part 3D/3dmodel.model",
        ),
        (model("", item), "there is no such object"),
        (model(own, item), "a component of itself"),
        (
            model(&deep, "<item objectid=\"199\"/>"),
            "nested more than 64 deep",
        ),
        (
            model("<component objectid=\"1\"/>", ""),
            "outside of any object",
        ),
        (model(TRIANGLE, "<item/>"), "lacks its number"),
        (
            model(TRIANGLE, "<item objectid=\"1\" transform=\"1 0 0\"/>"),
            "twelve numbers",
        ),
        (
            model(
                TRIANGLE,
                "<item objectid=\"1\" transform=\"inf 0 0 0 1 0 0 0 1 0 0 0\"/>",
            ),
            "twelve numbers",
        ),
        (
            archive(&[("3D/3dmodel.model", "<model unit=\"ell\"/>")]),
            "`ell` is not a unit",
        ),
        (
            archive(&[("readme.txt", "hello")]),
            "does not hold a 3D model",
        ),
    ] {
        let Err(error @ ReadMeshError::Syntax { .. }) = read(&file) else {
            panic!("{expected}: {:?}", read(&file));
        };
        assert!(
            error.to_string().contains(expected),
            "{error}, not {expected}"
        );
    }
    let wrong_index = read(&broken("v2=\"1\"", "v2=\"3\""));
    assert!(matches!(
        wrong_index,
        Err(ReadMeshError::NoSuchVertex {
            index: 3,
            vertices: 3,
            ..
        })
    ));
    let infinite = read(&broken("x=\"1\"", "x=\"1e999\""));
    assert!(matches!(
        infinite,
        Err(ReadMeshError::NotFinite { vertex: 1, .. })
    ));
    let far = model(
        TRIANGLE,
        "<item objectid=\"1\" transform=\"1e308 0 0 0 1 0 0 0 1 1e308 0 0\"/>",
    );
    assert!(matches!(
        read(&far),
        Err(ReadMeshError::NotFinite { vertex: 1, .. })
    ));
    let cut = archive(&[("3D/3dmodel.model", "<model><resources>")]);
    assert!(matches!(read(&cut), Err(ReadMeshError::Truncated { .. })));
    let mut damaged = model(TRIANGLE, item);
    damaged.truncate(damaged.len() - 30);
    assert!(matches!(
        read(&damaged),
        Err(ReadMeshError::Unsupported { .. })
    ));
}

/// Four points of a unit square and some indices, as the parts of a buffer.
fn data() -> Vec<u8> {
    let points = [
        [0.0_f32, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
    ];
    let mut data: Vec<u8> = points
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    data.extend([0_u8, 1, 2, 0, 2, 3, 0, 0]);
    data.extend([0_u16, 1, 3, 2].iter().flat_map(|i| i.to_le_bytes()));
    data.extend([0_u32, 1, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    data
}

const DATA: &str = r#""bufferViews":[{"buffer":0,"byteLength":80}],"accessors":[
    {"bufferView":0,"componentType":5126,"type":"VEC3","count":4},
    {"bufferView":0,"byteOffset":48,"componentType":5121,"type":"SCALAR","count":6},
    {"bufferView":0,"byteOffset":56,"componentType":5123,"type":"SCALAR","count":4},
    {"bufferView":0,"byteOffset":64,"componentType":5125,"type":"SCALAR","count":4}]"#;

/// A file with `rest` and the data, which `uri` gives the place of.
fn gltf_at(rest: &str, uri: &str) -> Vec<u8> {
    format!("{{\"asset\":{{\"version\":\"2.0\"}},{DATA},\"buffers\":[{{\"byteLength\":80{uri}}}],{rest}}}").into_bytes()
}

fn gltf(rest: &str) -> Vec<u8> {
    let encoded = STANDARD.encode(data());
    gltf_at(
        rest,
        &format!(",\"uri\":\"data:application/gltf-buffer;base64,{encoded}\""),
    )
}

fn glb(json: &[u8], data: &[u8]) -> Vec<u8> {
    let mut json = json.to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + json.len() as u32 + data.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json[..]), (b"BIN\0", data)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

fn one_mesh(primitive: &str) -> String {
    format!("\"nodes\":[{{\"mesh\":0}}],\"meshes\":[{{\"primitives\":[{{{primitive}}}]}}]")
}

#[test]
fn gltf_triangles_strips_and_fans_are_read_with_indices_of_all_types() {
    for (primitive, expected) in [
        (
            "\"attributes\":{\"POSITION\":0},\"indices\":1",
            &[[0, 1, 2], [0, 2, 3]][..],
        ),
        (
            "\"attributes\":{\"POSITION\":0},\"indices\":2,\"mode\":5",
            &[[0, 1, 3], [3, 1, 2]],
        ),
        (
            "\"attributes\":{\"POSITION\":0},\"indices\":3,\"mode\":6",
            &[[0, 1, 2], [0, 2, 3]],
        ),
        (
            "\"attributes\":{\"POSITION\":0},\"mode\":6",
            &[[0, 1, 2], [0, 2, 3]],
        ),
        ("\"attributes\":{\"POSITION\":0}", &[[0, 1, 2]]),
    ] {
        let file = read(&gltf(&one_mesh(primitive))).unwrap();
        assert_eq!(
            (file.format, file.unit),
            (MeshFormat::Gltf, Some(LengthUnit::Meter))
        );
        assert_eq!(file.mesh.triangles(), expected, "{primitive}");
        assert_eq!(places(&file)[2], [1.0, 1.0, 0.0]);
        let packed = read(&glb(&gltf_at(&one_mesh(primitive), ""), &data())).unwrap();
        assert_eq!(packed.format, MeshFormat::Glb);
        assert_eq!(packed.mesh, file.mesh);
    }
}

#[test]
fn gltf_nodes_place_their_meshes_and_primitives_share_their_vertices() {
    let primitives = "{\"attributes\":{\"POSITION\":0},\"indices\":1},{\"attributes\":{\"POSITION\":0,\"NORMAL\":0},\
        \"indices\":3,\"mode\":1},{\"attributes\":{\"POSITION\":0},\"material\":0,\"indices\":3,\"mode\":6}";
    // The mirrored child of a node that is turned a quarter about z, doubled and shifted.
    let nodes = "{\"mesh\":0},{\"children\":[2],\"translation\":[10,0,0],\"scale\":[2,2,2],\
        \"rotation\":[0,0,0.5,0.5]},{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,0,0,-1,0,0,0,3,1]},{\"mesh\":0}";
    let rest = format!(
        "\"scene\":1,\"scenes\":[{{}},{{\"nodes\":[0,1]}}],\"nodes\":[{nodes}],\"meshes\":[{{\"primitives\":[{primitives}]}}]"
    );
    let file = read(&gltf(&rest)).unwrap();
    let found = places(&file);
    assert_eq!(found.len(), 8, "the third node is not in the scene");
    assert_eq!(found[2], [1.0, 1.0, 0.0]);
    for (got, wanted) in found[4..].iter().zip([
        [10.0, 0.0, 6.0],
        [10.0, 2.0, 6.0],
        [8.0, 2.0, 6.0],
        [8.0, 0.0, 6.0],
    ]) {
        assert!(
            got.iter()
                .zip(wanted)
                .all(|(got, wanted)| (got - wanted).abs() < 1e-12),
            "{got:?}"
        );
    }
    let square = [[0, 1, 2], [0, 2, 3]];
    let mirrored = [[5, 4, 6], [6, 4, 7]];
    assert_eq!(file.mesh.triangles()[..4], [square, square].concat());
    assert_eq!(file.mesh.triangles()[4..], [mirrored, mirrored].concat());
    let ignored = |what| ReadWarning::Ignored { what };
    assert_eq!(
        file.warnings,
        [
            ignored("normals"),
            ignored("points and lines"),
            ignored("materials")
        ]
    );
}

#[test]
fn gltf_positions_may_be_quantized_interleaved_and_sparse() {
    // Rows of 8 bytes: three numbers of 16 bits and a gap.
    let rows: [[i16; 4]; 3] = [[0, 0, 0, 9], [32767, 0, 0, 9], [0, -32768, 0, 9]];
    let mut data: Vec<u8> = rows
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    data.extend([2, 0, 0, 0]);
    data.extend([0_i16, 32767, 0, 9].iter().flat_map(|x| x.to_le_bytes()));
    let encoded = STANDARD.encode(&data);
    let file = |sparse: &str| {
        format!(
            "{{\"extensionsRequired\":[\"KHR_mesh_quantization\"],\
             \"buffers\":[{{\"byteLength\":36,\"uri\":\"data:;base64,{encoded}\"}}],\"bufferViews\":[\
             {{\"buffer\":0,\"byteLength\":24,\"byteStride\":8}},{{\"buffer\":0,\"byteOffset\":24,\"byteLength\":12}}],\
             \"accessors\":[{{\"bufferView\":0,\"componentType\":5122,\"normalized\":true,\"type\":\"VEC3\",\"count\":3{sparse}}}],{}}}",
            one_mesh("\"attributes\":{\"POSITION\":0}")
        )
    };
    let plain = read(file("").as_bytes()).unwrap();
    assert_eq!(
        places(&plain),
        [[0.0; 3], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    );
    let sparse = ",\"sparse\":{\"count\":1,\"indices\":{\"bufferView\":1,\"componentType\":5121},\
        \"values\":{\"bufferView\":1,\"byteOffset\":4}}";
    let sparse = read(file(sparse).as_bytes()).unwrap();
    assert_eq!(
        places(&sparse),
        [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    );
}

#[test]
fn gltf_data_in_other_files_are_asked_for() {
    let rest = one_mesh("\"attributes\":{\"POSITION\":0},\"indices\":1");
    let file = gltf_at(&rest, ",\"uri\":\"my%20data.bin\"");
    match read(&file) {
        Err(ReadMeshError::Unsupported { what, .. }) => {
            assert!(what.contains("my%20data.bin"), "{what}");
        }
        other => panic!("{other:?}"),
    }
    let mut asked = Vec::new();
    let mut resolver = |address: &str| {
        asked.push(address.to_owned());
        Ok(Box::new(Cursor::new(data())) as Box<dyn Read>)
    };
    let options = ReadOptions::default();
    let progress = Progress::none();
    let found = read_mesh_with_buffers(&file[..], &mut resolver, &options, &progress).unwrap();
    assert_eq!(found.mesh.triangles().len(), 2);
    assert_eq!(asked, ["my data.bin"]);
    let mut missing = |_: &str| Err(std::io::ErrorKind::NotFound.into());
    let outcome = read_mesh_with_buffers(&file[..], &mut missing, &options, &progress);
    assert!(matches!(outcome, Err(ReadMeshError::Io(_))));
    let mut endless = |_: &str| Ok(Box::new(std::io::repeat(0)) as Box<dyn Read>);
    let mut small = options;
    small.limits.memory = MemoryBudget::new(1_000_000);
    let outcome = read_mesh_with_buffers(&file[..], &mut endless, &small, &progress);
    assert!(matches!(
        outcome,
        Err(ReadMeshError::OverBudget(over)) if over.limit == 1_000_000
    ));
}

/// The members of a glTF file with a mesh, and the file.
fn square() -> (String, Vec<u8>) {
    let mesh = one_mesh("\"attributes\":{\"POSITION\":0},\"indices\":1");
    let file = gltf(&mesh);
    (mesh, file)
}

/// The file with another text in the place of `from`.
fn broken(file: &[u8], from: &str, to: &str) -> Vec<u8> {
    let text = String::from_utf8(file.to_vec()).unwrap();
    assert!(text.contains(from), "{from}");
    text.replacen(from, to, 1).into_bytes()
}

/// Checks that each file is refused for its syntax, with the words that are expected.
fn check_faults(files: &[(Vec<u8>, &str)]) {
    for (file, expected) in files {
        let Err(error @ ReadMeshError::Syntax { .. }) = read(file) else {
            panic!("{expected}: {:?}", read(file));
        };
        assert!(
            error.to_string().contains(expected),
            "{error}, not {expected}"
        );
    }
}

#[test]
fn faults_in_the_scene_of_a_gltf_file_are_named() {
    let (mesh, square) = square();
    let broken = |from, to| broken(&square, from, to);
    check_faults(&[
        (broken("{\"asset\"", "{\"asset"), "the JSON is not right"),
        (
            broken("\"mesh\":0", "\"mesh\":1"),
            "mesh 1: there is no such mesh",
        ),
        (
            broken("\"mesh\":0", "\"mesh\":0,\"children\":[1]"),
            "node 1: there is no such node",
        ),
        (
            gltf(&mesh.replace("\"mesh\":0", "\"mesh\":0,\"children\":[1,1]},{")),
            "node 1: it has two parents",
        ),
    ]);
}

#[test]
fn faults_of_accessors_are_named() {
    let (_, square) = square();
    let broken = |from, to| broken(&square, from, to);
    check_faults(&[
        (
            broken("\"POSITION\":0", "\"POSITION\":1"),
            "must be of type VEC3",
        ),
        (
            broken("\"POSITION\":0", "\"POSITION\":9"),
            "accessor 9: there is no such",
        ),
        (
            broken("\"indices\":1", "\"indices\":0"),
            "must be of type SCALAR",
        ),
        (broken("5121", "5120"), "without a sign"),
        (broken("5126", "1"), "component type"),
        (
            broken("\"indices\":1", "\"indices\":1,\"mode\":7"),
            "no known mode",
        ),
    ]);
}

#[test]
fn faults_of_views_and_buffers_are_named() {
    let (mesh, square) = square();
    let broken = |from, to| broken(&square, from, to);
    check_faults(&[
        (broken("\"count\":4", "\"count\":7"), "beyond the end"),
        (
            broken("\"count\":4", "\"count\":18446744073709551615"),
            "beyond the end",
        ),
        (
            broken("\"byteOffset\":48", "\"byteOffset\":480"),
            "beyond the end",
        ),
        (
            broken(
                "\"byteLength\":80}],\"accessors\"",
                "\"byteLength\":81}],\"accessors\"",
            ),
            "inside of a buffer",
        ),
        (
            broken(
                "\"byteLength\":80}],\"accessors\"",
                "\"byteLength\":80,\"byteStride\":4}],\"accessors\"",
            ),
            "overlap",
        ),
        (broken("{\"bufferView\":0,", "{"), "no data of its own"),
        (
            broken("{\"bufferView\":0,", "{\"bufferView\":1,"),
            "does not exist",
        ),
        (
            broken("base64,", "base64,!"),
            "buffer 0: its data are not base64",
        ),
        (gltf_at(&mesh, ""), "neither data nor an address"),
    ]);
}

#[test]
fn damaged_and_unsupported_gltf_files_are_told_apart() {
    let (mesh, square) = square();
    let broken = |from, to| broken(&square, from, to);
    let wrong_index = broken("\"count\":4", "\"count\":3");
    assert!(matches!(
        read(&wrong_index),
        Err(ReadMeshError::NoSuchVertex {
            index: 3,
            vertices: 3,
            place: Place::Item {
                of: "mesh",
                index: 0
            },
            ..
        })
    ));
    let short = broken(
        "\"buffers\":[{\"byteLength\":80",
        "\"buffers\":[{\"byteLength\":81",
    );
    assert!(matches!(read(&short), Err(ReadMeshError::Truncated { .. })));
    let packed = gltf(&format!(
        "\"extensionsRequired\":[\"KHR_draco_mesh_compression\"],{mesh}"
    ));
    assert!(matches!(
        read(&packed),
        Err(ReadMeshError::Unsupported { .. })
    ));
    let whole = glb(&gltf_at(&mesh, ""), &data());
    let mut old = whole.clone();
    old[4] = 1;
    assert!(matches!(read(&old), Err(ReadMeshError::Unsupported { .. })));
    assert!(matches!(
        read(&whole[..whole.len() - 1]),
        Err(ReadMeshError::Truncated { .. })
    ));
    let mut other = whole;
    other[16] = b'j';
    assert!(matches!(read(&other), Err(ReadMeshError::Syntax { .. })));
}

/// A tetrahedron of volume 1/6 · size³, as the rows of an object.
fn tetrahedra(sizes: &[u32]) -> String {
    let (mut vertices, mut triangles) = (String::new(), String::new());
    for (i, size) in sizes.iter().enumerate() {
        for [x, y, z] in [[0, 0, 0], [*size, 0, 0], [0, *size, 0], [0, 0, *size]] {
            let vertex = format!("<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>");
            vertices.push_str(&vertex);
        }
        for corners in [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] {
            let [a, b, c] = corners.map(|corner| 4 * i + corner);
            let triangle = format!("<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>");
            triangles.push_str(&triangle);
        }
    }
    format!("<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>")
}

#[test]
fn volumes_by_ranges_of_triangles_are_parts_negative_or_left_out() {
    let object = format!("<object id=\"1\">{}</object>", tetrahedra(&[8, 2, 3, 4, 5]));
    let volume = |at: usize, name: &str, keys: &str| {
        format!(
            "<volume firstid=\"{}\" lastid=\"{}\"><metadata type=\"volume\" key=\"name\" value=\"{name}\"/>{keys}</volume>",
            4 * at,
            4 * at + 3
        )
    };
    let kind = |kind: &str| format!("<metadata key=\"volume_type\" value=\"{kind}\"/>");
    let volumes = [
        volume(0, "body", &kind("ModelPart")),
        volume(1, "hole &amp; co", &kind("NegativeVolume")),
        volume(2, "dense", "<metadata key=\"modifier\" value=\"1\"/>"),
        volume(3, "block", &kind("SupportBlocker")),
        volume(4, "later", &kind("SomethingNew")),
    ]
    .concat();
    let settings = format!(
        "<config><object id=\"1\"><metadata type=\"object\" key=\"name\" value=\"bracket\"/>{volumes}</object></config>"
    );
    let model = format!(
        "<model xmlns=\"c\"><resources>{object}</resources><build><item objectid=\"1\"/>\
         <item objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 20 0 0\"/></build></model>"
    );
    for path in [
        "Metadata/Slic3r_PE_model.config",
        "metadata/slic3r_pe_model.config",
    ] {
        let entries = [("3D/3dmodel.model", &*model), (path, &*settings)];
        let file = read(&archive(&entries)).unwrap();
        assert_eq!(file.mesh.triangles().len(), 8);
        assert_eq!(file.mesh.bounds().max.x, 28.0);
        assert_eq!(file.negative.bounds().max.x, 22.0);
        let objects: Vec<_> = file.objects.iter().collect();
        let found = objects
            .iter()
            .map(|o| (&*o.name, o.triangles.clone(), o.negative.clone()));
        let found: Vec<_> = found.collect();
        assert_eq!(found, [("bracket", 0..4, 0..4), ("bracket", 4..8, 4..8)]);
        let told: Vec<_> = file.warnings.iter().map(ToString::to_string).collect();
        assert_eq!(
            told,
            [
                "left out 1 modifier (dense)",
                "left out 1 support blocker (block)",
                "left out 1 unknown volume (later)",
                "kept 1 negative volume (hole & co) apart from the mesh, for subtraction",
            ]
        );
    }
    let broken = [
        ("3D/3dmodel.model", &*model),
        ("Metadata/model_settings.config", "<config><object"),
    ];
    let file = read(&archive(&broken)).unwrap();
    assert_eq!(file.mesh.triangles().len(), 40);
    assert!(file.warnings[0].to_string().contains("cannot be read"));
}

#[test]
fn volumes_by_components_are_parts_negative_or_left_out() {
    let leaf = |id: u32, kind: &str, size: u32| {
        format!(
            "<object id=\"{id}\" type=\"{kind}\">{}</object>",
            tetrahedra(&[size])
        )
    };
    let leaves =
        leaf(1, "model", 8) + &leaf(2, "other", 2) + &leaf(3, "other", 3) + &leaf(4, "support", 4);
    let objects = format!("<model xmlns=\"c\"><resources>{leaves}</resources></model>");
    let component =
        |id: u32| format!("<component p:path=\"/3D/Objects/a.model\" objectid=\"{id}\"/>");
    let components = [1, 2, 3, 4].map(component).concat();
    let model = format!(
        "<model xmlns=\"c\" xmlns:p=\"http://x/production/2015\"><resources><object id=\"9\"><components>{components}</components></object>\
         </resources><build><item objectid=\"9\" printable=\"1\"/><item objectid=\"9\" printable=\"0\"/></build></model>"
    );
    let settings = "<config><object id=\"9\"><metadata key=\"name\" value=\"plate\"/>\
        <part id=\"1\" subtype=\"normal_part\"/>\
        <part id=\"2\" subtype=\"negative_part\"><metadata key=\"name\" value=\"slot\"/></part>\
        <part id=\"3\" subtype=\"modifier_part\"><mesh_stat edges_fixed=\"0\"/></part></object></config>";
    let entries = [
        ("3D/3dmodel.model", &*model),
        ("3D/Objects/a.model", &*objects),
        ("Metadata/model_settings.config", settings),
    ];
    let file = read(&archive(&entries)).unwrap();
    assert_eq!(
        (file.mesh.triangles().len(), file.negative.triangles().len()),
        (4, 4)
    );
    assert_eq!(file.negative.bounds().max.x, 2.0);
    assert_eq!((file.objects.len(), &*file.objects[0].name), (1, "plate"));
    let told: Vec<_> = file.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(
        told,
        [
            "left out 1 modifier",
            "left out 1 support object",
            "left out 1 unprintable item (plate)",
            "kept 1 negative volume (slot) apart from the mesh, for subtraction",
        ]
    );
}

#[test]
fn objects_of_a_3mf_file_are_written_with_their_names() {
    let object = |id: u32, name: &str| {
        format!(
            "<object id=\"{id}\" name=\"{name}\">{}</object>",
            tetrahedra(&[id])
        )
    };
    let file = read(&model(
        &(object(1, "a &lt; b") + &object(2, "") + &object(3, "unused")),
        "<item objectid=\"2\"/><item objectid=\"1\"/>",
    ))
    .unwrap();
    let attributes = ravec_mesh_io::Attributes {
        objects: &file.objects,
        ..ravec_mesh_io::Attributes::default()
    };
    let options = ravec_mesh_io::WriteOptions {
        unit: file.unit,
        ..ravec_mesh_io::WriteOptions::default()
    };
    let mut bytes = Vec::new();
    let progress = ravec_progress::Progress::none();
    ravec_mesh_io::write_mesh_with(
        &file.mesh,
        attributes,
        MeshFormat::ThreeMf,
        &options,
        &mut bytes,
        &progress,
    )
    .unwrap();
    let again = read(&bytes).unwrap();
    assert_eq!(
        (again.objects, again.mesh),
        (file.objects.clone(), file.mesh)
    );
    let names: Vec<_> = file.objects.iter().map(|object| &*object.name).collect();
    assert_eq!(names, ["", "a < b"]);
}
