//! Memory that readers take, counted by the allocator: never more than the budget and a little, whatever the file.

mod bombs;

use std::sync::Mutex;

use glam::{DVec2, DVec3};
use peak_alloc::PeakAlloc;
use ravec_memory::MemoryBudget;
use ravec_mesh::TriMesh;
use ravec_mesh_io::{
    Attributes, MeshFile, MeshFormat, MeshLimits, ReadMeshError, ReadOptions, WriteOptions,
    read_mesh, write_mesh_with,
};
use ravec_progress::Progress;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// The allocator counts for all threads.
static ALONE: Mutex<()> = Mutex::new(());

/// Bytes that may be taken beside the budget: small things that do not grow with the file, and the threads of the test.
const BESIDE: u64 = 150_000;

struct Read {
    outcome: Result<MeshFile, ReadMeshError>,
    /// The most that was allocated at one time, and reserved.
    allocated: u64,
    reserved: u64,
    /// Bytes that the mesh takes.
    kept: u64,
}

fn read(file: &[u8], budget: u64, weld_tolerance: Option<f64>) -> Read {
    let memory = MemoryBudget::new(budget);
    let options = ReadOptions {
        limits: MeshLimits {
            memory: memory.clone(),
            ..MeshLimits::default()
        },
        size: Some(file.len() as u64),
        colors: true,
        texture: true,
        weld_tolerance,
    };
    let progress = Progress::none();
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let outcome = read_mesh(file, &options, &progress);
    Read {
        outcome,
        allocated: (MEMORY.peak_usage() - before) as u64,
        reserved: memory.peak(),
        kept: memory.used(),
    }
}

#[test]
fn hostile_files_never_take_more_than_the_budget() {
    let _alone = ALONE.lock().unwrap();
    for (name, bomb) in bombs::all() {
        let file = bomb();
        for budget in [1_000_000, 10_000_000, 50_000_000] {
            // welding comes after reading, and is the same for all
            let welds = [None, Some(0.5)];
            for &weld in &welds[..=usize::from(budget > 10_000_000)] {
                let read = read(&file, budget, weld);
                let allocated = read.allocated;
                assert!(
                    allocated <= budget + BESIDE,
                    "{name} with {budget} takes {allocated}: {:?}",
                    read.outcome.map(|file| file.mesh.positions().len())
                );
                assert!(read.reserved <= budget);
                let refused = matches!(read.outcome, Err(ReadMeshError::OverBudget(_)));
                assert!(
                    refused || budget > 1_000_000 || bombs::is_small(name),
                    "{name} is no bomb: {:?}",
                    read.outcome.map(|file| file.mesh.positions().len())
                );
                if read.outcome.is_err() {
                    assert_eq!(read.kept, 0, "{name}");
                }
            }
        }
    }
}

/// A closed surface whose coordinates have all their digits.
fn ordinary(rings: u32) -> TriMesh {
    let around = 2 * rings;
    let positions = (0..rings * around).map(|i| {
        let (ring, at) = (i / around, i % around);
        let (polar, turn) = (
            std::f64::consts::PI * (f64::from(ring) + 0.5) / f64::from(rings),
            std::f64::consts::TAU * f64::from(at) / f64::from(around),
        );
        let radius = 40.0 + (7.0 * turn).sin() + (5.0 * polar).cos();
        radius
            * DVec3::new(
                polar.sin() * turn.cos(),
                polar.sin() * turn.sin(),
                polar.cos(),
            )
    });
    let triangles = (0..(rings - 1) * around).flat_map(|i| {
        let beside = i / around * around + (i + 1) % around;
        [
            [i, i + around, beside],
            [beside, i + around, beside + around],
        ]
    });
    TriMesh::new(positions.collect(), triangles.collect()).unwrap()
}

#[test]
fn ordinary_files_are_read_with_a_small_multiple_of_their_size() {
    let _alone = ALONE.lock().unwrap();
    // 100 000 vertices and 200 000 triangles, beyond any power of two by little, where lists have just grown
    for rings in [224, 260] {
        let mesh = ordinary(rings);
        let texture = vec![[DVec2::new(0.25, 0.75), DVec2::X, DVec2::Y]; mesh.triangles().len()];
        let colors = vec![[1, 2, 3, 4]; mesh.positions().len()];
        for (format, with, times) in [
            (MeshFormat::StlBinary, false, 2.5),
            (MeshFormat::StlAscii, false, 2.5),
            (MeshFormat::PlyBinary, false, 2.5),
            (MeshFormat::PlyBinary, true, 2.5),
            (MeshFormat::PlyAscii, false, 2.5),
            (MeshFormat::Obj, false, 2.5),
            (MeshFormat::Off, false, 2.5),
            // of the unpacked model
            (MeshFormat::ThreeMf, false, 2.5),
            // 32-bit floats become 64-bit ones
            (MeshFormat::Glb, false, 2.8),
            (MeshFormat::Gltf, false, 2.5),
        ] {
            let attributes = Attributes {
                colors: if with { &colors } else { &[] },
                texture: if with { &texture } else { &[] },
                objects: &[],
            };
            let mut file = Vec::new();
            let (options, progress) = (WriteOptions::default(), Progress::none());
            write_mesh_with(&mesh, attributes, format, &options, &mut file, &progress).unwrap();
            let size = match format {
                MeshFormat::ThreeMf => bombs::unpacked(&file).len() as u64 + file.len() as u64,
                _ => file.len() as u64,
            };
            // the buffers of a reader do not depend on the file
            let budget = (times * size as f64) as u64 + 700_000;
            let read = read(&file, budget, None);
            let found = read.outcome.unwrap_or_else(|error| {
                panic!("{format} of {size} bytes with {budget}: {error}");
            });
            assert_eq!(found.mesh.triangles().len(), mesh.triangles().len());
            assert!(
                read.allocated <= budget + BESIDE,
                "{format}: {}",
                read.allocated
            );
            // what is reserved is needed
            assert!(
                read.reserved as f64 <= 1.5 * read.allocated as f64 + 700_000.0,
                "{format}: {} reserved, {} taken",
                read.reserved,
                read.allocated
            );
            let kept = (24 * mesh.positions().len() + 12 * mesh.triangles().len()) as f64;
            assert!(
                (kept * 0.99..kept * 1.6).contains(&(read.kept as f64)),
                "{format}: {} for {kept}",
                read.kept
            );
        }
    }
}

#[test]
fn a_claim_of_a_header_takes_nothing() {
    let _alone = ALONE.lock().unwrap();
    let ply = |encoding| {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex 199999999\nproperty double x\nproperty double y\n\
             property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
             element face 199999999\nproperty list uint int vertex_indices\nend_header\n0 0 0\n"
        )
    };
    // it ends inside a triangle: a whole number of triangles would be read
    let mut stl = vec![0; 84 + 70];
    stl[80..84].copy_from_slice(&199_999_999_u32.to_le_bytes());
    let mut glb = b"glTF\x02\0\0\0\xff\xff\xff\xff\x02\0\0\0JSON{}".to_vec();
    glb.extend(b"\xf0\xff\xff\xffBIN\0");
    for file in [
        ply("ascii").into_bytes(),
        ply("binary_little_endian").into_bytes(),
        b"OFF\n199999999 199999999 0\n0 0 0\n".to_vec(),
        b"OFF\n1 1 0\n0 0 0\n199999999 0 0\n".to_vec(),
        stl,
        glb,
        b"{\"buffers\":[{\"byteLength\":4294967295,\"uri\":\"data:;base64,AAAA\"}]}".to_vec(),
    ] {
        let read = read(&file, 1 << 40, None);
        assert!(read.outcome.is_err());
        assert!(read.allocated < 600_000, "{}", read.allocated);
        assert!(read.reserved < 600_000, "{}", read.reserved);
    }
}
