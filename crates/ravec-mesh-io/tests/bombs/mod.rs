//! Files that make a reader take much more memory than they have bytes, or time.

#![allow(dead_code, reason = "each test uses some of them")]
#![allow(clippy::format_push_string, reason = "texts are made once")]

use std::io::{Cursor, Read as _, Write as _};

/// A name and what makes the file.
pub type Bomb = (&'static str, fn() -> Vec<u8>);

/// All of them.
pub fn all() -> Vec<Bomb> {
    [
        packages(),
        scenes(),
        buffers(),
        ply_files(),
        obj_files(),
        off_files(),
        stl_files(),
    ]
    .concat()
}

/// True for files that are refused for another reason than memory.
pub fn is_small(name: &str) -> bool {
    name.starts_with("small: ")
}

fn packed(parts: &[(&str, &[u8])]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in parts {
        let options = zip::write::SimpleFileOptions::default();
        archive.start_file(*name, options).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// The model of a 3MF file.
pub fn unpacked(file: &[u8]) -> Vec<u8> {
    let mut archive = zip::ZipArchive::new(Cursor::new(file)).unwrap();
    let mut model = Vec::new();
    let mut part = archive.by_name("3D/3dmodel.model").unwrap();
    part.read_to_end(&mut model).unwrap();
    model
}

fn model(text: &str) -> Vec<u8> {
    packed(&[("3D/3dmodel.model", text.as_bytes())])
}

const TRIANGLE: &str = "<object id=\"1\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" y=\"0\" z=\"0\"/>\
    <vertex x=\"0\" y=\"1\" z=\"0\"/></vertices><triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\"/></triangles></mesh></object>";

/// A model with `more` objects beside a triangle, and `items`.
pub fn built(more: &str, items: &str) -> Vec<u8> {
    model(&format!(
        "<model><resources>{TRIANGLE}{more}</resources><build>{items}</build></model>"
    ))
}

/// A model in `count` parts and one that uses them all.
pub fn many_parts(count: usize) -> Vec<u8> {
    let mut items = String::new();
    let part = format!("<model><resources>{TRIANGLE}</resources></model>");
    let names: Vec<String> = (0..count).map(|i| format!("3D/{i}.model")).collect();
    for name in &names {
        items += &format!("<item objectid=\"1\" path=\"/{name}\"/>");
    }
    let root = format!("<model><resources>{TRIANGLE}</resources><build>{items}</build></model>");
    let mut parts: Vec<(&str, &[u8])> = names
        .iter()
        .map(|name| (name.as_str(), part.as_bytes()))
        .collect();
    parts.push(("3D/3dmodel.model", root.as_bytes()));
    packed(&parts)
}

fn packages() -> Vec<Bomb> {
    vec![
        ("3MF: items", || {
            built("", &"<item objectid=\"1\"/>".repeat(600_000))
        }),
        ("3MF: components", || {
            let uses = "<component objectid=\"1\"/>".repeat(600_000);
            built(
                &format!("<object id=\"2\"><components>{uses}</components></object>"),
                "<item objectid=\"2\"/>",
            )
        }),
        ("3MF: components nested", || {
            let mut more = String::new();
            for id in 2..24 {
                let twice = format!("<component objectid=\"{}\"/>", id - 1).repeat(2);
                more += &format!("<object id=\"{id}\"><components>{twice}</components></object>");
            }
            built(&more, "<item objectid=\"23\"/>")
        }),
        ("3MF: empty objects", || {
            let objects: Vec<String> = (2..200_000)
                .map(|id| format!("<object id=\"{id}\"/>"))
                .collect();
            built(&objects.concat(), "<item objectid=\"1\"/>")
        }),
        ("3MF: objects of one id", || {
            built(
                &"<object id=\"2\"/>".repeat(300_000),
                "<item objectid=\"1\"/>",
            )
        }),
        ("3MF: vertices", || {
            let vertices = "<vertex x=\"0\" y=\"0\" z=\"0\"/>".repeat(2_500_000);
            built(
                &format!("<object id=\"2\"><mesh>{vertices}</mesh></object>"),
                "<item objectid=\"1\"/>",
            )
        }),
        ("3MF: triangles", || {
            let triangles = "<triangle v1=\"0\" v2=\"0\" v3=\"0\"/>".repeat(2_500_000);
            let vertex = "<vertex x=\"0\" y=\"0\" z=\"0\"/>";
            built(
                &format!("<object id=\"2\"><mesh>{vertex}{triangles}</mesh></object>"),
                "<item objectid=\"2\"/>",
            )
        }),
        ("3MF: text", || {
            built(&" ".repeat(60_000_000), "<item objectid=\"1\"/>")
        }),
        ("3MF: comment", || {
            built(
                &format!("<!--{}-->", "x".repeat(60_000_000)),
                "<item objectid=\"1\"/>",
            )
        }),
        ("3MF: attribute", || {
            built(
                &format!("<object id=\"7\" name=\"{}\"/>", "x".repeat(60_000_000)),
                "<item objectid=\"1\"/>",
            )
        }),
        ("3MF: attributes", || {
            model(&format!("<model {}>", "a=\"\" ".repeat(6_000_000)))
        }),
        ("3MF: required extensions", || {
            model(&format!(
                "<model requiredextensions=\"{}\" {}></model>",
                "a ".repeat(3_000_000),
                "xmlns:a=\"/material/\" ".repeat(1_000_000)
            ))
        }),
        ("small: 3MF: nested elements", || {
            model(&"<a>".repeat(5_000_000))
        }),
        ("small: 3MF: nested names", || {
            model(&format!("<{}>", "a".repeat(100_000)).repeat(500))
        }),
        ("small: 3MF: parts that are missing", || {
            let items: Vec<String> = (0..200_000)
                .map(|i| format!("<item objectid=\"1\" path=\"/3D/{i}.model\"/>"))
                .collect();
            built("", &items[..10].concat())
        }),
        ("3MF: names of parts", || {
            let items: Vec<String> = (0..300_000)
                .map(|i| format!("<item objectid=\"1\" path=\"/3D/{i}.model\"/>"))
                .collect();
            built("", &items.concat())
        }),
        ("3MF: directory", || directory(300_000, b"a")),
        ("3MF: long names in the directory", || {
            directory(2_000, "n".repeat(30_000).as_bytes())
        }),
        ("3MF: relations", || {
            let long = format!("<Relationship Target=\"{}\"/>", "x".repeat(60_000_000));
            packed(&[("_rels/.rels", long.as_bytes())])
        }),
        ("small: 3MF: parts that overlap", || overlapping(3000)),
    ]
}

/// An archive with `count` entries that are all the same bytes.
fn directory(count: u32, name: &[u8]) -> Vec<u8> {
    let local = [
        &b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0"[..],
        &(name.len() as u16).to_le_bytes(),
        &[0, 0],
        name,
    ];
    let mut file = local.concat();
    let start = file.len() as u32;
    for i in 0..count {
        file.extend(b"PK\x01\x02\x14\0\x14\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0");
        file.extend((name.len() as u16).to_le_bytes());
        file.extend([0; 16]);
        file.extend(name);
        let at = file.len() - name.len();
        file[at..][..name.len().min(4)].copy_from_slice(&i.to_le_bytes()[..name.len().min(4)]);
    }
    end(&mut file, count, start);
    file
}

/// The end of a directory, with the record that large archives have.
fn end(file: &mut Vec<u8>, count: u32, start: u32) {
    let at = file.len() as u64;
    let size = at - u64::from(start);
    file.extend(b"PK\x06\x06\x2c\0\0\0\0\0\0\0\x2d\0\x2d\0\0\0\0\0\0\0\0\0");
    file.extend(u64::from(count).to_le_bytes());
    file.extend(u64::from(count).to_le_bytes());
    file.extend(size.to_le_bytes());
    file.extend(u64::from(start).to_le_bytes());
    file.extend(b"PK\x06\x07\0\0\0\0");
    file.extend(at.to_le_bytes());
    file.extend(b"\x01\0\0\0");
    file.extend(b"PK\x05\x06\0\0\0\0\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\0\0");
}

/// An archive whose model is in many parts that are all the same bytes.
fn overlapping(count: u32) -> Vec<u8> {
    let items: Vec<String> = (0..count)
        .map(|i| format!("<item objectid=\"1\" path=\"{i}\"/>"))
        .collect();
    let text = format!(
        "<model><resources>{TRIANGLE}</resources><build>{}</build></model>",
        items.concat()
    );
    let mut file = model(&text);
    let end_at = file.len() - 22;
    let start = u32::from_le_bytes(file[end_at + 16..end_at + 20].try_into().unwrap());
    let entry = file[start as usize..end_at].to_vec();
    file.truncate(end_at);
    for i in 0..count {
        let name = i.to_string();
        let mut copy = entry.clone();
        copy[28..30].copy_from_slice(&(name.len() as u16).to_le_bytes());
        let long = copy.len();
        copy.splice(46..46 + "3D/3dmodel.model".len(), name.bytes());
        assert!(copy.len() < long);
        file.extend(copy);
    }
    end(&mut file, count + 1, start);
    file
}

/// A scene in JSON.
pub fn json(text: &str) -> Vec<u8> {
    format!("{{\"asset\":{{}},{text}}}").into_bytes()
}

/// `count` times `item`, with commas.
pub fn list(item: &str, count: usize) -> String {
    let mut list = format!("{item},").repeat(count);
    list.pop();
    format!("[{list}]")
}

/// A triangle in a buffer that a mesh may show.
pub const CORNERS: &str = "\"buffers\":[{\"byteLength\":36,\"uri\":\"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}],\
    \"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\
    \"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]";

fn scenes() -> Vec<Bomb> {
    vec![
        ("glTF: nodes", || {
            json(&format!("\"nodes\":{}", list("{}", 900_000)))
        }),
        ("glTF: nodes without names of fields", || {
            json(&format!(
                "\"nodes\":{}",
                list("[0,[],null,null,null,null,null,[],null]", 200_000)
            ))
        }),
        ("glTF: children", || {
            json(&format!(
                "\"nodes\":[{{\"children\":{}}}]",
                list("0", 2_000_000)
            ))
        }),
        ("glTF: child lists", || {
            json(&format!(
                "\"nodes\":{}",
                list("{\"children\":[0]}", 300_000)
            ))
        }),
        ("glTF: matrices", || {
            let matrix = list("0", 16);
            json(&format!(
                "\"nodes\":{}",
                list(&format!("{{\"matrix\":{matrix}}}"), 100_000)
            ))
        }),
        ("glTF: scenes", || {
            json(&format!("\"scenes\":{}", list("[]", 500_000)))
        }),
        ("glTF: roots", || {
            json(&format!(
                "\"scenes\":[{{\"nodes\":{}}}]",
                list("0", 2_000_000)
            ))
        }),
        ("glTF: meshes", || {
            json(&format!(
                "\"meshes\":{}",
                list("{\"primitives\":[{}]}", 200_000)
            ))
        }),
        ("glTF: primitives", || {
            json(&format!(
                "\"meshes\":[{{\"primitives\":{}}}]",
                list("{}", 400_000)
            ))
        }),
    ]
}

fn buffers() -> Vec<Bomb> {
    vec![
        ("glTF: accessors", || {
            let one = "{\"componentType\":5126,\"count\":0,\"type\":\"\",\"sparse\":{\"count\":0,\
                \"indices\":{\"bufferView\":0},\"values\":{\"bufferView\":0}}}";
            json(&format!("\"accessors\":{}", list(one, 50_000)))
        }),
        ("glTF: views", || {
            json(&format!(
                "\"bufferViews\":{}",
                list("[0,0,0,null]", 300_000)
            ))
        }),
        ("glTF: buffers", || {
            json(&format!(
                "\"buffers\":{}",
                list("{\"byteLength\":0,\"uri\":\"data:;base64,\"}", 100_000)
            ))
        }),
        ("glTF: address", || {
            json(&format!(
                "\"buffers\":[{{\"byteLength\":0,\"uri\":\"{}\"}}]",
                "x".repeat(20_000_000)
            ))
        }),
        ("glTF: name of a field", || {
            json(&format!("\"{}\":0", "x".repeat(20_000_000)))
        }),
        ("glTF: escapes", || {
            json(&format!("\"a\":\"{}\"", "\\n".repeat(10_000_000)))
        }),
        ("glTF: extensions", || {
            json(&format!(
                "\"extensionsRequired\":{}",
                list("\"KHR_texture_x\"", 500_000)
            ))
        }),
        ("glTF: base64", || {
            let text = "AAAA".repeat(8_000_000);
            json(&format!(
                "\"buffers\":[{{\"byteLength\":3,\"uri\":\"data:;base64,{text}\"}}]"
            ))
        }),
        ("glTF: nodes that show one mesh", || {
            json(&format!(
                "{CORNERS},\"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}}}}]}}],\"nodes\":{}",
                list("{\"mesh\":0}", 400_000)
            ))
        }),
        ("glTF: primitives that show one accessor", || {
            json(&format!(
                "{CORNERS},\"meshes\":[{{\"primitives\":{}}}]",
                list(
                    "{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":0}}",
                    200_000
                )
            ))
        }),
        ("small: glTF: nested lists", || {
            json(&format!("\"a\":{}", "[".repeat(5_000_000)))
        }),
        ("GLB: data", || {
            let text = "{\"buffers\":[{\"byteLength\":3}]} ";
            let mut file = b"glTF\x02\0\0\0\xff\xff\xff\xff".to_vec();
            file.extend((text.len() as u32).to_le_bytes());
            file.extend(b"JSON");
            file.extend(text.as_bytes());
            file.extend(60_000_000_u32.to_le_bytes());
            file.extend(b"BIN\0");
            file.resize(file.len() + 60_000_000, 0);
            file
        }),
    ]
}

fn ply(encoding: &str, rest: &str) -> Vec<u8> {
    let places = "property float x\nproperty float y\nproperty float z\n";
    format!("ply\nformat {encoding} 1.0\nelement vertex 1\n{places}{rest}").into_bytes()
}

fn ply_files() -> Vec<Bomb> {
    const FACE: &str = "element face 1\nproperty list uint uchar vertex_indices\nend_header\n";
    vec![
        ("PLY: properties", || {
            ply("ascii", &"property char a\n".repeat(400_000))
        }),
        ("PLY: elements", || {
            ply("ascii", &"element a 0\n".repeat(400_000))
        }),
        ("PLY: list in binary", || {
            let mut file = ply("binary_little_endian", FACE);
            file.extend([0; 12]);
            file.extend(40_000_000_u32.to_le_bytes());
            file.resize(file.len() + 40_000_000, 0);
            file
        }),
        ("PLY: list in text", || {
            let mut file = ply("ascii", FACE);
            file.extend(format!("0 0 0\n15000000{}\n", " 0".repeat(15_000_000)).bytes());
            file
        }),
        ("PLY: strip", || {
            let text = "element tristrips 1\nproperty list uint uchar vertex_indices\nend_header\n";
            let mut file = ply("binary_big_endian", text);
            file.extend([0; 12]);
            file.extend(20_000_000_u32.to_be_bytes());
            file.resize(file.len() + 20_000_000, 0);
            file
        }),
        ("PLY: quadrilaterals", || {
            let text =
                "element face 3000000\nproperty list uchar uchar vertex_indices\nend_header\n";
            let mut file = ply("binary_little_endian", text);
            file.extend([0; 12]);
            file.extend([4, 0, 0, 0, 0].repeat(3_000_000));
            file
        }),
        ("PLY: vertices of bytes with colors", || {
            let text = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000\nproperty uchar x\n\
                property uchar y\nproperty uchar z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
            let mut file = text.as_bytes().to_vec();
            file.resize(file.len() + 24_000_000, 7);
            file
        }),
        ("small: PLY: rows of nothing", || {
            b"ply\nformat ascii 1.0\nelement nothing 999999999999\nend_header\n".to_vec()
        }),
    ]
}

fn obj_files() -> Vec<Bomb> {
    vec![
        ("OBJ: polygon", || {
            format!("v 0 0 0\nf{}\n", " 1".repeat(15_000_000)).into_bytes()
        }),
        ("OBJ: polygon of many lines", || {
            format!("v 0 0 0\nf{}\n", " 1 1 1 1\\\n".repeat(4_000_000)).into_bytes()
        }),
        ("OBJ: vertices", || {
            "v 0 0 0\n".repeat(4_000_000).into_bytes()
        }),
        ("OBJ: triangles", || {
            format!("v 0 0 0\n{}", "f 1 1 1\n".repeat(5_000_000)).into_bytes()
        }),
        ("OBJ: quadrilaterals", || {
            format!("v 0 0 0\n{}", "f 1 1 1 1\n".repeat(3_000_000)).into_bytes()
        }),
        ("OBJ: texture", || {
            let coordinates = "vt 0\n".repeat(1_000_000);
            format!(
                "v 0 0 0\n{coordinates}{}",
                "f 1/1 1/1 1/1\n".repeat(1_000_000)
            )
            .into_bytes()
        }),
        ("OBJ: texture of polygons", || {
            format!(
                "v 0 0 0\nvt 0\nf 1 1 1\n{}",
                "f 1/1 1/1 1/1 1/1 1/1\n".repeat(1_000_000)
            )
            .into_bytes()
        }),
        ("OBJ: line", || {
            format!("v 0 0 0\n#{}", "x".repeat(60_000_000)).into_bytes()
        }),
        ("small: OBJ: comments", || {
            "# a\n".repeat(5_000_000).into_bytes()
        }),
    ]
}

fn off_files() -> Vec<Bomb> {
    vec![
        ("OFF: vertices", || {
            format!("OFF\n4000000 0 0\n{}", "0 0 0\n".repeat(4_000_000)).into_bytes()
        }),
        ("OFF: faces", || {
            format!(
                "OFF\n1 3000000 0\n0 0 0\n{}",
                "4 0 0 0 0\n".repeat(3_000_000)
            )
            .into_bytes()
        }),
        ("OFF: polygon", || {
            format!("OFF\n1 1 0\n0 0 0\n15000000{}\n", " 0".repeat(15_000_000)).into_bytes()
        }),
        ("OFF: counts", || {
            format!("OFF\n{}\n", "1 ".repeat(20_000_000)).into_bytes()
        }),
    ]
}

fn stl_files() -> Vec<Bomb> {
    vec![
        ("STL: triangles", || {
            let mut file = vec![b' '; 80];
            file.extend(1_500_000_u32.to_le_bytes());
            for i in 0..1_500_000_u32 {
                file.extend([0; 12]);
                for corner in 0..3_u32 {
                    for x in [i as f32, corner as f32, 1.0] {
                        file.extend(x.to_le_bytes());
                    }
                }
                file.extend([0; 2]);
            }
            file
        }),
        ("STL: triangles of one place", || {
            let mut file = vec![b' '; 80];
            file.extend(6_000_000_u32.to_le_bytes());
            file.resize(84 + 50 * 6_000_000, 0);
            file
        }),
        ("STL: text", || {
            let mut file = "solid\n".to_owned();
            for i in 0..400_000 {
                file +=
                    &format!("outer loop vertex {i} 0 0 vertex {i} 1 0 vertex {i} 0 1 endloop\n");
            }
            file.into_bytes()
        }),
        ("STL: word", || {
            format!("solid a\n{}", "x".repeat(60_000_000)).into_bytes()
        }),
        ("STL: line", || {
            format!("solid {}", "x".repeat(60_000_000)).into_bytes()
        }),
    ]
}
