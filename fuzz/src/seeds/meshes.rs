//! Meshes as our own writers write them, and in the ways of other programs.

use super::Seed;
use glam::{DVec2, DVec3};
use ravec::mesh::TriMesh;
use ravec::mesh_io::{Attributes, MeshFormat, WriteOptions, write_mesh_with};
use ravec::progress::Progress;
use std::io::{Cursor, Write as _};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

fn octahedron() -> TriMesh {
    let places = [1.0, -1.0].map(|s| {
        [
            DVec3::new(s, 0.0, 0.0),
            DVec3::new(0.0, s, 0.25),
            DVec3::new(0.0, 0.0, 1.5 * s),
        ]
    });
    let triangles = (0..8_u32).map(|signs| {
        let corner = |axis: u32| axis + 3 * (signs >> axis & 1);
        let [x, y, z] = [0, 1, 2].map(corner);
        if signs.count_ones().is_multiple_of(2) {
            [x, y, z]
        } else {
            [y, x, z]
        }
    });
    TriMesh::new(places.concat(), triangles.collect()).expect("indices are in range")
}

fn written(format: MeshFormat) -> Vec<u8> {
    let attributes = Attributes {
        colors: &[[1, 20, 200, 255]; 6],
        texture: &[[DVec2::X; 3]; 8],
    };
    let mut file = Vec::new();
    write_mesh_with(
        &octahedron(),
        attributes,
        format,
        &WriteOptions::default(),
        &mut file,
        &Progress::none(),
    )
    .expect("memory takes any mesh");
    file
}

pub fn seeds() -> Vec<Seed> {
    let mut seeds: Vec<Seed> = [
        ("stl", "binary", MeshFormat::StlBinary),
        ("stl", "ascii", MeshFormat::StlAscii),
        ("ply", "binary", MeshFormat::PlyBinary),
        ("ply", "ascii", MeshFormat::PlyAscii),
        ("obj", "plain", MeshFormat::Obj),
        ("off", "plain", MeshFormat::Off),
        ("threemf_package", "plain", MeshFormat::ThreeMf),
        ("gltf", "binary", MeshFormat::Glb),
        ("gltf", "text", MeshFormat::Gltf),
    ]
    .into_iter()
    .map(|(target, name, format)| (target, name.to_owned(), written(format)))
    .collect();
    for (target, name, text) in TEXTS {
        seeds.push((target, (*name).to_owned(), text.as_bytes().to_vec()));
    }
    seeds.push(("ply", "big-endian".into(), big_endian_ply()));
    for (name, parts) in MODELS {
        seeds.push((
            "threemf_model",
            (*name).to_owned(),
            parts.join("\n====\n").into_bytes(),
        ));
        let names = ["3D/3dmodel.model", "3D/Objects/a.model", "_rels/.rels"];
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        for (entry, part) in names.iter().zip(*parts) {
            archive
                .start_file(*entry, SimpleFileOptions::default())
                .expect("memory takes any archive");
            archive
                .write_all(part.as_bytes())
                .expect("memory takes any archive");
        }
        let file = archive
            .finish()
            .expect("memory takes any archive")
            .into_inner();
        seeds.push(("threemf_package", (*name).to_owned(), file));
    }
    seeds
}

fn big_endian_ply() -> Vec<u8> {
    let mut file = b"ply\nformat binary_big_endian 1.0\ncomment c\nelement vertex 4\nproperty double x\nproperty float y\n\
        property short z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement tristrips 1\n\
        property list int int vertex_indices\nend_header\n"
        .to_vec();
    for (x, y, z) in [
        (0.0_f64, 0.0_f32, 0_i16),
        (1.0, 0.0, 0),
        (0.0, 1.0, 0),
        (1.0, 1.0, 3),
    ] {
        file.extend(x.to_be_bytes());
        file.extend(y.to_be_bytes());
        file.extend(z.to_be_bytes());
        file.extend([1, 2, 3]);
    }
    for index in [8_i32, 0, 1, 2, 3, -1, 3, 2, 1] {
        file.extend(index.to_be_bytes());
    }
    file
}

/// Target, name and content.
const TEXTS: &[(&str, &str, &str)] = &[
    (
        "stl",
        "ascii-two-solids",
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
        endsolid a\nsolid b\nfacet normal 0 0 1\nouter loop\nvertex 0 0 1e-3\nvertex 1 0 +1.5E+2\nvertex 0 1 .5\nendloop\nendfacet\nendsolid\n",
    ),
    (
        "ply",
        "ascii-polygons",
        "ply\nformat ascii 1.0\nobj_info i\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
        property float nx\nproperty list uchar float more\nelement face 3\nproperty uchar flags\nproperty list uchar uint vertex_indices\nend_header\n\
        0 0 0 1 0\n1 0 0 1 2 7 8\n1 1 0 1 0\n0 1 0 1 0\n.5 2 0 1 1 9\n1 5 0 1 2 4 3\n0 3 0 1 2\n0 2 0 1\n",
    ),
    (
        "obj",
        "relative",
        "# c\nmtllib m.mtl\no a\nv 0 0 0 1\nv 1 0 0 0.5 0.5 0.5\nv 1 1 \\\n 0\nv 0 1 0\nvt 0 0\nvt 1 0 0\nvt 1 1\nvn 0 0 1\n\
        usemtl m\ns off\ng one two\nf 1/1/1 2/2/1 3/3/1 4//1\nf -4 -3 -1\nf -4/-3/-1 -3/-2/-1 -2/-1/-1\nl 1 2\np 1\n",
    ),
    (
        "off",
        "colors",
        "STCNOFF # c\n4 2 0\n0 0 0 0 0 1 255 0 0 255 0 0\n1 0 0 0 0 1 0 255 0 255 1 0\n1 1 0 0 0 1 0 0 255 255 1 1\n\
        0 1 0 0 0 1 9 9 9 255 0 1\n4 0 1 2 3 0.5 0.5 0.5\n3 0 2 3\n",
    ),
    (
        "off",
        "counts-apart",
        "OFF\n\n# c\n3 1 3\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 7\n",
    ),
    (
        "gltf",
        "primitives",
        r#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_mesh_quantization"],"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"children":[1,2],"translation":[1,0,0],"rotation":[0,0,0.5,0.5],"scale":[2,2,2]},{"mesh":0},{"mesh":1,"matrix":[1,0,0,0,0,1,0,0,0,0,-1,0,0,0,3,1]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1},{"attributes":{"POSITION":0},"indices":2,"mode":5}]},
{"primitives":[{"attributes":{"POSITION":0,"NORMAL":0},"indices":3,"mode":6,"material":0},{"attributes":{"POSITION":4,"TEXCOORD_0":5}}]}],
"materials":[{}],"buffers":[{"byteLength":80,"uri":"data:application/gltf-buffer;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAACAPwAAgD8AAAAAAAAAAAAAgD8AAAAAAAECAAIDAAAAAAEAAwACAAAAAAABAAAAAgAAAAMAAAA="},{"byteLength":9,"uri":"more.bin"}],
"bufferViews":[{"buffer":0,"byteLength":80},{"buffer":0,"byteLength":48,"byteStride":12}],"accessors":[
{"bufferView":1,"componentType":5126,"type":"VEC3","count":4,"min":[0,0,0],"max":[1,1,0]},
{"bufferView":0,"byteOffset":48,"componentType":5121,"type":"SCALAR","count":6},
{"bufferView":0,"byteOffset":56,"componentType":5123,"type":"SCALAR","count":4},
{"bufferView":0,"byteOffset":64,"componentType":5125,"type":"SCALAR","count":4},
{"bufferView":1,"componentType":5122,"normalized":true,"type":"VEC3","count":3,"sparse":{"count":1,"indices":{"bufferView":0,"byteOffset":48,"componentType":5121},"values":{"bufferView":0,"byteOffset":56}}},
{"bufferView":0,"componentType":5121,"normalized":true,"type":"VEC2","count":3}]}"#,
    ),
];

/// Name, and the parts of the package.
const MODELS: &[(&str, &[&str])] = &[
    (
        "components",
        &[
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?><model unit=\"inch\" xml:lang=\"en\" xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\">\
        <metadata name=\"Title\">t &amp; &#x41;</metadata><resources><basematerials id=\"5\"><base name=\"a\" displaycolor=\"#FF0000\"/></basematerials>\
        <object id=\"1\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" y=\"0\" z=\"0\"/><vertex x=\"0\" y=\"1\" z=\"0\"/></vertices>\
        <triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\"/></triangles></mesh></object><object id=\"2\"><components>\
        <component objectid=\"1\" transform=\"0 1 0 -1 0 0 0 0 1 0 0 5\"/><component objectid=\"1\" transform=\"-1 0 0 0 1 0 0 0 1 0 0 0\"/></components></object>\
        <object id=\"3\"><components><component objectid=\"2\"/><component objectid=\"2\"/></components></object></resources>\
        <build><item objectid=\"3\" transform=\"1 0 0 0 1 0 0 0 1 10 20 30\"/><item objectid=\"1\"/></build></model>",
        ],
    ),
    (
        "parts",
        &[
            "<model unit=\"meter\" xmlns=\"c\" xmlns:p=\"http://x/production/2015\" requiredextensions=\"p\"><resources><object id=\"1\"><components>\
        <component objectid=\"1\" p:path=\"/3D/Objects/A.model\"/></components></object></resources>\
        <build><item objectid=\"1\"/><item objectid=\"1\" p:path=\"/3d/objects/a.model\"/></build></model>",
            "<model><resources><object id=\"1\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" y=\"0\" z=\"0\"/>\
        <vertex x=\"0\" y=\"1\" z=\"1e-3\"/></vertices><triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\"/></triangles></mesh></object></resources></model>",
            "<Relationships><Relationship Type=\"http://x/thumbnail\" Target=\"/no.png\"/><Relationship Type=\"http://x/3dmodel\" Target=\"/3D/3dmodel.model\"/></Relationships>",
        ],
    ),
    ("no-build", &[TRIANGLE_MODEL]),
];

const TRIANGLE_MODEL: &str = "<model><resources><object id=\"1\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/></vertices><triangles/></mesh></object>\
    <!-- c --><slicestack/></resources><build/></model>";
