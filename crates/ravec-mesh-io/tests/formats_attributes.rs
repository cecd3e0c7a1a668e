//! Colors and texture coordinates, read and written.

use glam::{DVec2, DVec3};
use ravec_mesh::TriMesh;
use ravec_mesh_io::{
    Attributes, MeshFile, MeshFormat, ReadMeshError, ReadOptions, ReadWarning, WriteOptions,
    read_mesh, write_mesh_with,
};
use ravec_progress::Progress;

fn written(mesh: &TriMesh, attributes: Attributes<'_>, format: MeshFormat) -> Vec<u8> {
    let mut bytes = Vec::new();
    let (options, progress) = (WriteOptions::default(), Progress::none());
    write_mesh_with(mesh, attributes, format, &options, &mut bytes, &progress).unwrap();
    bytes
}

#[test]
fn colors_of_ply_vertices_are_read_and_written_if_they_are_asked_for() {
    let corners = vec![DVec3::ZERO, DVec3::X, DVec3::new(0.0, 0.1, 0.0)];
    let mesh = TriMesh::new(corners, vec![[0, 1, 2]]).unwrap();
    let colors = [[255, 0, 7, 255], [1, 2, 3, 4], [0, 0, 0, 0]];
    let asked = ReadOptions {
        colors: true,
        ..ReadOptions::default()
    };
    for format in [MeshFormat::PlyBinary, MeshFormat::PlyAscii, MeshFormat::Off] {
        let attributes = Attributes {
            colors: &colors,
            ..Attributes::default()
        };
        let bytes = written(&mesh, attributes, format);
        let file = read_mesh(&bytes[..], &asked, &Progress::none()).unwrap();
        assert_eq!(file.mesh, mesh, "{format}");
        if format == MeshFormat::Off {
            assert_eq!(file.colors, [[0; 4]; 0]);
            continue;
        }
        assert_eq!(file.colors, colors, "{format}");
        assert_eq!(file.warnings, []);
        let plain = read_mesh(&bytes[..], &ReadOptions::default(), &Progress::none()).unwrap();
        assert_eq!(plain.colors, [[0; 4]; 0]);
        assert_eq!(plain.warnings, [ReadWarning::Ignored { what: "colors" }]);
    }
}

#[test]
fn colors_of_ply_files_may_be_fractions_and_stand_in_any_columns() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float blue\nproperty float x\nproperty ushort green\n\
                property float y\nproperty float z\nproperty double red\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n\
                1 0 65535 0 0 0.5\n-3 1 257 0 0 2\nnan 0 0 1 0 0.001\n3 0 1 2\n";
    let asked = ReadOptions {
        colors: true,
        ..ReadOptions::default()
    };
    let file = read_mesh(text.as_bytes(), &asked, &Progress::none()).unwrap();
    assert_eq!(file.mesh.positions()[1], DVec3::X);
    assert_eq!(
        file.colors,
        [[128, 255, 255, 255], [255, 1, 0, 255], [0, 0, 0, 255]]
    );
}

fn read_textured(bytes: &[u8]) -> Result<MeshFile, ReadMeshError> {
    let asked = ReadOptions {
        texture: true,
        ..ReadOptions::default()
    };
    read_mesh(bytes, &asked, &Progress::none())
}

fn textured(mesh: &TriMesh, texture: &[[DVec2; 3]], format: MeshFormat) -> Vec<u8> {
    let attributes = Attributes {
        texture,
        ..Attributes::default()
    };
    written(mesh, attributes, format)
}

/// Two triangles of a square whose pieces of the texture meet along the first side only.
fn square() -> (TriMesh, [[DVec2; 3]; 2]) {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
    let mesh = TriMesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]).unwrap();
    let texture = [
        [DVec2::ZERO, DVec2::X, DVec2::ONE],
        [DVec2::ZERO, DVec2::new(0.25, 0.5), DVec2::new(-2.0, 0.125)],
    ];
    (mesh, texture)
}

#[test]
fn texture_coordinates_are_read_and_written_if_they_are_asked_for() {
    let (mesh, texture) = square();
    let places = |mesh: &TriMesh| -> Vec<[DVec3; 3]> {
        let triangles = mesh.triangles().iter();
        triangles
            .map(|t| t.map(|v| mesh.positions()[v as usize]))
            .collect()
    };
    for format in [MeshFormat::Obj, MeshFormat::Glb, MeshFormat::Gltf] {
        let bytes = textured(&mesh, &texture, format);
        let file = read_textured(&bytes).unwrap();
        assert_eq!(places(&file.mesh), places(&mesh), "{format}");
        assert_eq!(file.texture, texture, "{format}");
        assert_eq!(file.warnings, [], "{format}");
        // a vertex of glTF has one place in the texture: the third corner has two
        let vertices = if format == MeshFormat::Obj { 4 } else { 5 };
        assert_eq!(file.mesh.positions().len(), vertices, "{format}");
        let plain = read_mesh(&bytes[..], &ReadOptions::default(), &Progress::none()).unwrap();
        assert_eq!(plain.texture, [[DVec2::ZERO; 3]; 0]);
        let what = "texture coordinates";
        assert_eq!(plain.warnings, [ReadWarning::Ignored { what }]);
    }
    let file = read_textured(&textured(&mesh, &texture, MeshFormat::PlyBinary)).unwrap();
    assert_eq!((file.mesh, file.texture.len()), (mesh, 0));
}

#[test]
fn corners_of_obj_faces_may_lack_texture_and_polygons_keep_theirs() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0 0\nvt 1\n\
                f 1 2 3\nf 1/1 2/2/7 3/-1 4//5\nf 1/1 3/99 4/0\nf 1/2 2/2 3/2 4/2\nf 1//1 2//1 4//1\n";
    let file = read_textured(text.as_bytes()).unwrap();
    assert_eq!(file.texture.len(), file.mesh.triangles().len());
    let corners = file.mesh.triangles().iter().zip(&file.texture);
    let at: Vec<Vec<(u32, Option<DVec2>)>> = corners
        .map(|(corners, texture)| {
            let known = texture.map(|at| (!at.is_nan()).then_some(at));
            corners.iter().copied().zip(known).collect()
        })
        .collect();
    let (none, x) = (None, Some(DVec2::X));
    assert_eq!(at[0], [(0, none), (1, none), (2, none)]);
    // the quadrilateral, in two triangles
    let expected = [Some(DVec2::ZERO), x, x, none];
    for &(v, known) in at[1..3].iter().flatten() {
        assert_eq!(known, expected[v as usize], "vertex {v}");
    }
    assert_eq!(at[3], [(0, Some(DVec2::ZERO)), (2, none), (3, none)]);
    assert!(at[4..6].iter().flatten().all(|&(_, known)| known == x));
    assert_eq!(at[6], [(0, none), (1, none), (3, none)]);
    // what is not there is not there afterwards, either
    let again = read_textured(&textured(&file.mesh, &file.texture, MeshFormat::Obj)).unwrap();
    assert_eq!(
        format!("{:?}", again.texture),
        format!("{:?}", file.texture)
    );
}

#[test]
fn gltf_textures_have_a_place_for_each_vertex() {
    let (mesh, texture) = square();
    let bytes = textured(&mesh, &texture, MeshFormat::Gltf);
    let text = String::from_utf8(bytes).unwrap();
    let coordinates = "\"count\":5,\"type\":\"VEC2\"";
    assert!(text.contains(coordinates));
    let short = text.replace(coordinates, "\"count\":4,\"type\":\"VEC2\"");
    let error = read_textured(short.as_bytes()).unwrap_err();
    let told = error.to_string();
    assert!(
        told.contains("accessor 2") && told.contains("each vertex"),
        "{told}"
    );
    let deep = text.replace(coordinates, "\"count\":5,\"type\":\"VEC3\"");
    assert!(read_textured(deep.as_bytes()).is_err());
    // who does not want them is not bothered
    assert!(read_mesh(short.as_bytes(), &ReadOptions::default(), &Progress::none()).is_ok());
}

#[test]
fn texture_coordinates_that_are_nowhere_are_none() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt inf 0\nvt 1e300 0\nvt 0 nan\nf 1/1 2/2 3/3\n";
    let file = read_textured(text.as_bytes()).unwrap();
    let [[one, far, other]] = file.texture[..] else {
        panic!("one triangle");
    };
    assert!(one.is_nan() && other.is_nan());
    assert_eq!(far, DVec2::new(1e300, 0.0));
    // 32-bit floats do not reach as far, and all vertices need some
    let file = read_textured(&textured(&file.mesh, &file.texture, MeshFormat::Glb)).unwrap();
    assert_eq!(file.texture, [[DVec2::Y; 3]]);
}
