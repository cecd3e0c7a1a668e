//! Growth of the time of each reader with the file: a table of files of one, two, four and eight times a size.
//!
//! Twice the file should take about twice the time. The last column is the mean factor from one size to the next, of
//! the times that are long enough to compare; a factor above 2.2 fails.

#![allow(clippy::format_push_string, reason = "texts are made once")]

use std::fmt::Write as _;
use std::io::{Cursor, Write as _};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use glam::DVec3;
use ravec_mesh::{CheckParams, TriMesh, check, measure, weld};
use ravec_mesh_io::{MeshFormat, ReadOptions, WriteOptions, read_mesh, write_mesh};
use ravec_progress::Progress;

/// The largest factor of the time for twice the file.
const BAR: f64 = 2.2;

/// Times below this are not judged: a cache more or less makes up the factor.
const SHORT: Duration = Duration::from_millis(8);

/// A name, what makes a file of so many times the size, and how often it is read.
type Row = (&'static str, Box<dyn Fn(usize) -> Vec<u8>>);

fn main() -> ExitCode {
    let mut failed = false;
    println!(
        "{:34} {:>10} {:>9} {:>9} {:>9} {:>9} {:>7}",
        "file", "bytes", "1", "2", "4", "8", "factor"
    );
    for (name, make) in rows() {
        let files = [1, 2, 4, 8].map(&make);
        let times = [0, 1, 2, 3].map(|i| {
            shortest(|| {
                let options = ReadOptions {
                    size: Some(files[i].len() as u64),
                    texture: true,
                    ..ReadOptions::default()
                };
                drop(read_mesh(&files[i][..], &options, &Progress::none()));
            })
        });
        failed |= show(name, files[0].len(), times);
    }
    for (name, work) in works() {
        let meshes = [1, 2, 4, 8].map(|times| parts(6_000 * times));
        let times = [0, 1, 2, 3].map(|i| shortest(|| work(&meshes[i])));
        failed |= show(name, 0, times);
    }
    ExitCode::from(u8::from(failed))
}

/// The shortest of some runs.
fn shortest(mut work: impl FnMut()) -> Duration {
    let runs = (0..5).map(|_| {
        let start = Instant::now();
        work();
        start.elapsed()
    });
    runs.min().unwrap_or_default()
}

/// Prints a row. Says whether it is above the bar.
fn show(name: &str, bytes: usize, times: [Duration; 4]) -> bool {
    let judged: Vec<f64> = times
        .iter()
        .filter(|&&time| time >= SHORT)
        .map(Duration::as_secs_f64)
        .collect();
    let factor = match *judged {
        [first, .., last] => (last / first).powf(1.0 / (judged.len() - 1) as f64),
        _ => 0.0,
    };
    print!("{name:34} {bytes:10}");
    for time in times {
        print!(" {:7.1}ms", 1000.0 * time.as_secs_f64());
    }
    let above = factor > BAR;
    println!(" {factor:7.2}{}", if above { " above the bar" } else { "" });
    above
}

/// A wavy sheet of about `triangles`.
fn sheet(triangles: usize) -> TriMesh {
    let side = ((triangles / 2) as f64).sqrt() as u32;
    let row = side + 1;
    let positions = (0..row * row).map(|i| {
        let (x, y) = (f64::from(i % row) * 0.731, f64::from(i / row) * 0.577);
        DVec3::new(x, y, (x * 0.3).sin() * (y * 0.2).cos())
    });
    let cells = (0..row * side).filter(|i| i % row < side);
    let triangles = cells.flat_map(|i| [[i, i + 1, i + row], [i + row, i + 1, i + row + 1]]);
    TriMesh::new(positions.collect(), triangles.collect()).expect("the indices are in range")
}

/// A mesh of `count` tetrahedra, apart from one another.
fn parts(count: usize) -> TriMesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..count as u32 {
        let at = DVec3::new(
            f64::from(i % 100),
            f64::from(i / 100 % 100),
            f64::from(i / 10_000),
        );
        positions.extend([DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| 2.0 * at + p));
        let corners = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        triangles.extend(corners.map(|t| t.map(|v| 4 * i + v)));
    }
    TriMesh::new(positions, triangles).expect("the indices are in range")
}

fn written(format: MeshFormat, mesh: &TriMesh) -> Vec<u8> {
    let mut file = Vec::new();
    let (options, progress) = (WriteOptions::default(), Progress::none());
    write_mesh(mesh, format, &options, &mut file, &progress).expect("memory takes everything");
    file
}

fn packed(parts: &[(String, String)]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, text) in parts {
        let options = zip::write::SimpleFileOptions::default();
        archive
            .start_file(name, options)
            .expect("memory takes everything");
        archive
            .write_all(text.as_bytes())
            .expect("memory takes everything");
    }
    archive
        .finish()
        .expect("memory takes everything")
        .into_inner()
}

const OBJECT: &str = "<object id=\"1\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" y=\"0\" z=\"0\"/>\
    <vertex x=\"0\" y=\"1\" z=\"0\"/></vertices><triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\"/></triangles></mesh></object>";

fn rows() -> Vec<Row> {
    let mut rows: Vec<Row> = Vec::new();
    for (name, format) in [
        ("STL, binary", MeshFormat::StlBinary),
        ("STL, ASCII", MeshFormat::StlAscii),
        ("PLY, binary", MeshFormat::PlyBinary),
        ("PLY, ASCII", MeshFormat::PlyAscii),
        ("OBJ", MeshFormat::Obj),
        ("OFF", MeshFormat::Off),
        ("3MF", MeshFormat::ThreeMf),
        ("GLB", MeshFormat::Glb),
        ("glTF", MeshFormat::Gltf),
    ] {
        rows.push((
            name,
            Box::new(move |times| written(format, &sheet(60_000 * times))),
        ));
    }
    rows.push(("STL, ASCII, chosen to collide", Box::new(colliding)));
    rows.push((
        "OBJ, polygons",
        Box::new(|times| {
            let mut text = String::new();
            for i in 0..40_000 * times {
                let (x, y) = ((i as f64 * 0.7).sin(), (i as f64 * 0.7).cos());
                writeln!(text, "v {x} {y} {}", i / 40).expect("memory takes everything");
            }
            for first in (1..40_000 * times).step_by(40) {
                let corners: Vec<String> = (first..first + 40).map(|i| i.to_string()).collect();
                writeln!(text, "f {}", corners.join(" ")).expect("memory takes everything");
            }
            text.into_bytes()
        }),
    ));
    rows.push((
        "OBJ, one polygon",
        Box::new(|times| {
            format!(
                "v 0 0 0\nv 1 0 0\nvt 0 0\nf{}\n",
                " 1/1 2/1".repeat(600_000 * times)
            )
            .into_bytes()
        }),
    ));
    rows.push((
        "3MF, objects",
        Box::new(|times| {
            let mut text = format!("<model><resources>{OBJECT}");
            for id in 2..8_000 * times {
                text += &OBJECT.replacen("\"1\"", &format!("\"{id}\""), 1);
            }
            text += "</resources><build>";
            for id in 1..8_000 * times {
                text += &format!("<item objectid=\"{id}\"/>");
            }
            text += "</build></model>";
            packed(&[("3D/3dmodel.model".to_owned(), text)])
        }),
    ));
    rows.push((
        "3MF, parts",
        Box::new(|times| {
            let mut text = format!("<model><resources>{OBJECT}</resources><build>");
            let mut parts = Vec::new();
            for i in 0..1_000 * times {
                text += &format!("<item objectid=\"1\" path=\"/3D/{i}.model\"/>");
                let part = format!("<model><resources>{OBJECT}</resources></model>");
                parts.push((format!("3D/{i}.model"), part));
            }
            parts.push(("3D/3dmodel.model".to_owned(), text + "</build></model>"));
            packed(&parts)
        }),
    ));
    rows.push(("3MF, used without being there", Box::new(|times| {
        let empty = "<component objectid=\"2\"/>".repeat(8_000 * times);
        let items = "<item objectid=\"3\"/>".repeat(8_000 * times);
        let text = format!(
            "<model><resources>{OBJECT}<object id=\"2\"/>\
             <object id=\"3\"><components><component objectid=\"1\"/>{empty}</components></object></resources>\
             <build>{items}</build></model>"
        );
        packed(&[("3D/3dmodel.model".to_owned(), text)])
    })));
    rows.push(("glTF, nodes", Box::new(|times| scene(25_000 * times, 1))));
    rows.push((
        "glTF, nodes and primitives",
        Box::new(|times| scene(10_000 * times, 10_000 * times)),
    ));
    rows.push((
        "glTF, child of child",
        Box::new(|times| {
            let nodes: Vec<String> = (1..50_000 * times)
                .map(|i| format!("{{\"children\":[{i}]}}"))
                .collect();
            format!("{{\"nodes\":[{},{{}}]}}", nodes.join(",")).into_bytes()
        }),
    ));
    rows
}

/// Nodes that show one mesh with so many primitives, of which only the first has triangles.
fn scene(nodes: usize, primitives: usize) -> Vec<u8> {
    let view = "{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}";
    let empty = view.replace(":3,", ":0,");
    format!(
        "{{\"buffers\":[{{\"byteLength\":36,\"uri\":\"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":36}}],\"accessors\":[{view},{empty}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}}}}{}]}}],\"nodes\":[{{\"mesh\":0}}{}]}}",
        ",{\"attributes\":{\"POSITION\":1}}".repeat(primitives - 1),
        ",{\"mesh\":0}".repeat(nodes - 1),
    )
    .into_bytes()
}

/// Vertices that have one hash if their words are mixed one after the other with known constants.
fn colliding(times: usize) -> Vec<u8> {
    const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
    let stir = |hash: u64, word: u64| (hash.rotate_left(23) ^ word).wrapping_mul(SPREAD);
    let mut text = "solid\n".to_owned();
    let mut count = 0;
    for i in 1_u64.. {
        let (x, y) = (i as f64, 0.5_f64);
        let z = stir(stir(0, x.to_bits()), y.to_bits()).rotate_left(23) ^ 0x4d;
        let z = f64::from_bits(z);
        if !z.is_finite() {
            continue;
        }
        count += 1;
        write!(
            text,
            " outer loop vertex {x} {y} {z:e} vertex 0 0 0 vertex 1 0 0 endloop"
        )
        .expect("memory takes everything");
        if count == 20_000 * times {
            break;
        }
    }
    text += "endsolid\n";
    text.into_bytes()
}

/// The name of an operation on a mesh, and what it does.
type Work = (&'static str, fn(&TriMesh));

fn works() -> [Work; 4] {
    [
        ("check of many parts", |mesh| {
            drop(check(mesh, &CheckParams::default(), &Progress::none()));
        }),
        ("measures of many parts", |mesh| {
            assert!(measure(mesh).area > 0.0);
        }),
        ("welding of many parts", |mesh| drop(weld(mesh, 0.0))),
        ("welding within a tolerance", |mesh| drop(weld(mesh, 0.01))),
    ]
}
