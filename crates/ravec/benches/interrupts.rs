//! Time from a cancellation until work on meshes has stopped, at many moments of each reader, writer and operation.
//!
//! The last column is the longest of these times, the place of it in the work before it. A time above 50 ms on an idle
//! machine fails.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use glam::DVec3;
use ravec::mesh::{
    Bvh, CheckParams, HausdorffParams, Keep, SimplifyParams, TriMesh, check, hausdorff, simplify,
    try_weld, vertex_distances,
};
use ravec::mesh_io::{MeshFormat, ReadOptions, WriteOptions, read_mesh, write_mesh};
use ravec::mesh_render::{Camera, Paint, RenderParams, render};
use ravec::progress::Progress;

/// The longest that work may go on.
const BAR: Duration = Duration::from_millis(50);

/// Moments at which each work is cancelled, fewer of long ones.
const MOMENTS: f64 = 40.0;

/// Time for all moments of a work together, about.
const EACH: Duration = Duration::from_secs(8);

fn main() -> ExitCode {
    let mut failed = false;
    println!(
        "{:40} {:>10} {:>7} {:>10}",
        "work", "whole", "at", "longest"
    );
    for (what, mesh) in [
        ("a sheet", sheet(1_000_000)),
        ("60 000 parts", parts(60_000)),
    ] {
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
            let options = WriteOptions::default();
            failed |= show(&format!("write {what}, {name}"), &|progress| {
                drop(write_mesh(
                    &mesh,
                    format,
                    &options,
                    std::io::sink(),
                    progress,
                ));
            });
            let mut file = Vec::new();
            write_mesh(&mesh, format, &options, &mut file, &Progress::none())
                .expect("memory takes everything");
            for weld_tolerance in [None, Some(0.01)] {
                let welded = if weld_tolerance.is_some() {
                    ", welded"
                } else {
                    ""
                };
                let options = ReadOptions {
                    weld_tolerance,
                    ..ReadOptions::default()
                };
                failed |= show(&format!("read {what}, {name}{welded}"), &|progress| {
                    drop(read_mesh(&file[..], &options, progress));
                });
            }
        }
        failed |= operations(what, &mesh);
    }
    let file = format!("v 0 0 0\nvt 0 0\nf{}\n", " 1/1 1/1".repeat(3_000_000));
    failed |= show("read a polygon, OBJ", &|progress| {
        let options = ReadOptions {
            texture: true,
            ..ReadOptions::default()
        };
        drop(read_mesh(file.as_bytes(), &options, progress));
    });
    ExitCode::from(u8::from(failed))
}

/// A name, and what is done.
type Work<'a> = (&'a str, &'a dyn Fn(&Progress));

fn operations(what: &str, mesh: &TriMesh) -> bool {
    let (positions, triangles) = mesh.clone().into_parts();
    let moved = positions.into_iter().map(|p| 1.001 * p).collect();
    let other = TriMesh::new(moved, triangles).expect("these are finite");
    let of_other = Bvh::new(&other);
    let small = SimplifyParams {
        target_triangles: mesh.triangles().len() as u64 / 4,
        ..SimplifyParams::default()
    };
    let limited = SimplifyParams {
        max_error: 0.01,
        ..small
    };
    let look = RenderParams {
        camera: Camera::default(),
        ..RenderParams::default()
    };
    let works: [Work<'_>; 8] = [
        ("check", &|progress| {
            drop(check(mesh, &CheckParams::default(), progress));
        }),
        ("weld", &|progress| drop(try_weld(mesh, 0.0, progress))),
        ("weld within", &|progress| {
            drop(try_weld(mesh, 0.1, progress));
        }),
        ("build a hierarchy", &|progress| {
            drop(Bvh::try_new(mesh, progress));
        }),
        ("compare vertices", &|progress| {
            drop(vertex_distances(mesh, &of_other, progress));
        }),
        ("compare", &|progress| {
            let params = HausdorffParams {
                tolerance: 0.01,
                ..HausdorffParams::default()
            };
            let stopped = hausdorff(mesh, &other, &params, progress).is_err();
            assert!(!stopped || progress.is_cancelled());
        }),
        ("simplify", &|progress| {
            drop(simplify(
                mesh,
                &limited,
                &Keep::default(),
                |_| false,
                progress,
            ));
        }),
        ("render", &|progress| {
            drop(render(mesh, &Paint::Plain, &look, progress));
        }),
    ];
    let shown = works.map(|(name, work)| show(&format!("{name} {what}"), work));
    shown.into_iter().any(|failed| failed)
}

/// Cancels `work` at many moments, and prints how long it went on at most. Says whether that is above the bar.
fn show(name: &str, work: &dyn Fn(&Progress)) -> bool {
    let start = Instant::now();
    work(&Progress::none());
    let whole = start.elapsed();
    let mut longest = (Duration::ZERO, 0.0);
    let moments = (2.0 * EACH.as_secs_f64() / whole.as_secs_f64()).clamp(6.0, MOMENTS) as u32;
    for moment in 0..moments {
        let at = (f64::from(moment) + 0.5) / f64::from(moments);
        let progress = Progress::none();
        let after = std::thread::scope(|scope| {
            let handle = progress.clone();
            let canceler = scope.spawn(move || {
                std::thread::sleep(whole.mul_f64(at));
                handle.cancel();
                Instant::now()
            });
            work(&progress);
            let end = Instant::now();
            let cancelled = canceler.join().expect("sleeping does not panic");
            end.saturating_duration_since(cancelled)
        });
        if after > longest.0 {
            longest = (after, at);
        }
    }
    let above = longest.0 > BAR;
    println!(
        "{name:40} {:8.0}ms {:6.0}% {:8.1}ms{}",
        1000.0 * whole.as_secs_f64(),
        100.0 * longest.1,
        1000.0 * longest.0.as_secs_f64(),
        if above { " above the bar" } else { "" }
    );
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
fn parts(count: u32) -> TriMesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..count {
        let at = [i % 40, i / 40 % 40, i / 1600].map(f64::from);
        let at = 2.0 * DVec3::from_array(at);
        positions.extend([DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| at + p));
        let corners = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        triangles.extend(corners.map(|t| t.map(|v| 4 * i + v)));
    }
    TriMesh::new(positions, triangles).expect("the indices are in range")
}
