//! Readers of meshes.

use super::{Outcome, limits};
use ravec::mesh::TriMesh;
use ravec::mesh_io::{
    MeshFile, MeshFormat, ReadMeshError, ReadOptions, WriteOptions, read_mesh,
    read_mesh_with_buffers, write_mesh,
};
use ravec::progress::Progress;
use std::io::Read;

/// Meshes up to this many triangles are also welded, measured and written.
const MAX_REWRITTEN: usize = 1 << 10;

fn options(input: &[u8]) -> ReadOptions {
    ReadOptions {
        limits: limits::meshes(),
        size: Some(input.len() as u64),
        ..ReadOptions::default()
    }
}

/// Reads with attributes, without any and welded, and compares the meshes.
pub fn read(input: &[u8]) -> Outcome {
    let progress = Progress::none();
    let plain = options(input);
    let all = ReadOptions {
        colors: true,
        texture: true,
        ..plain.clone()
    };
    // a file beside a glTF file, that is long enough for any index
    let mut beside = |_: &str| Ok(Box::new(std::io::repeat(1).take(4096)) as Box<dyn Read>);
    let read = read_mesh_with_buffers(input, &mut beside, &all, &progress);
    if let Err(ReadMeshError::Io(error)) = &read {
        panic!("bytes in memory cannot fail to be read: {error}");
    }
    if let Ok(file) = &read {
        judge(file);
        if file.mesh.triangles().len() <= MAX_REWRITTEN {
            judge_rewritten(&file.mesh);
        }
    }
    let without = read_mesh(input, &plain, &progress);
    if let (Ok(file), Ok(without)) = (&read, &without) {
        assert_eq!(file.mesh, without.mesh, "attributes change the mesh");
    }
    let welding = ReadOptions {
        weld_tolerance: Some(0.0),
        ..plain.clone()
    };
    if let Ok(welded) = read_mesh(input, &welding, &progress) {
        judge(&welded);
    }
    Outcome::of(&read)
}

/// Guarantees for every mesh that is read.
pub fn judge(file: &MeshFile) {
    judge_mesh(&file.mesh);
    let (vertices, triangles) = (file.mesh.positions().len(), file.mesh.triangles().len());
    let limits = limits::meshes();
    assert!(
        vertices as u64 <= limits.max_vertices,
        "{vertices} vertices"
    );
    assert!(
        triangles as u64 <= limits.max_triangles,
        "{triangles} triangles"
    );
    let (colors, texture) = (file.colors.len(), file.texture.len());
    assert!(colors == 0 || colors == vertices, "{colors} colors");
    assert!(
        texture == 0 || texture == triangles,
        "{texture} textured triangles"
    );
    for warning in &file.warnings {
        assert!(warning.to_string().len() > 5);
    }
}

fn judge_mesh(mesh: &TriMesh) {
    let vertices = mesh.positions().len();
    assert!(
        mesh.positions().iter().all(|at| at.is_finite()),
        "a coordinate is not finite"
    );
    assert!(
        mesh.triangles()
            .iter()
            .flatten()
            .all(|&index| (index as usize) < vertices),
        "an index is out of range"
    );
}

/// Whatever was read can be measured, written and read again as it was.
fn judge_rewritten(mesh: &TriMesh) {
    let progress = Progress::none();
    let _ = ravec::mesh::measure(mesh);
    let mut data = Vec::new();
    if write_mesh(
        mesh,
        MeshFormat::PlyBinary,
        &WriteOptions::default(),
        &mut data,
        &progress,
    )
    .is_ok()
    {
        let again =
            read_mesh(&data[..], &options(&data), &progress).expect("what we write we can read");
        assert_eq!(&again.mesh, mesh, "binary PLY keeps a mesh");
    }
}
