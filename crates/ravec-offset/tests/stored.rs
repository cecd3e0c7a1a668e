//! Surfaces that are made in less memory than they take: they are the same, and come out of the file they are kept in.

mod support;

use glam::DVec3;
use ravec_mesh::{CheckParams, MeshRows, TriMesh, check};
use ravec_mesh_io::{MeshFormat, WriteOptions, write_mesh, write_rows};
use ravec_offset::{
    Coordinates, OffsetError, OffsetParams, OpenRule, Side, Storage, offset, offset_stored,
};
use ravec_progress::Progress;
use ravec_scenes::solids::{icosphere, sheet, torus};
use std::io::{self, Cursor};
use support::verdict::params;

/// Memory limit under which surfaces of these small meshes have some thousand triangles at once.
const LITTLE: u64 = 66 << 20;

#[expect(clippy::unnecessary_wraps, reason = "others may fail")]
fn storage() -> io::Result<Box<dyn Storage>> {
    Ok(Box::new(Cursor::new(Vec::new())))
}

fn limited(asked: &OffsetParams) -> OffsetParams {
    OffsetParams {
        memory_bytes: Some(LITTLE),
        ..asked.clone()
    }
}

/// Two balls with holes, one in the other, and a third one beside them.
fn nested() -> TriMesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for (radius, shift) in [
        (1.0, DVec3::ZERO),
        (0.5, DVec3::splat(0.1)),
        (0.3, DVec3::X),
    ] {
        let ball = icosphere(radius, 3).mesh;
        let first = positions.len() as u32;
        let shift = if radius < 0.4 { 1.5 * shift } else { shift };
        positions.extend(ball.positions().iter().map(|&p| p + shift));
        let rest = ball.triangles()[1..].iter();
        triangles.extend(rest.map(|corners| corners.map(|v| v + first)));
    }
    TriMesh::new(positions, triangles).unwrap()
}

#[test]
fn what_is_written_from_the_file_is_what_would_be_in_memory() {
    let ring = torus(1.0, 0.4, 24, 16).mesh;
    for (name, mesh, side, coordinates) in [
        ("ring", &ring, Side::Both, Coordinates::Double),
        ("ring", &ring, Side::Inner, Coordinates::Single),
        ("balls", &nested(), Side::Outer, Coordinates::Double),
    ] {
        let asked = OffsetParams {
            coordinates,
            ..params(side, 0.08, 0.0016, false)
        };
        let whole = offset(mesh, &asked, &Progress::none()).unwrap();
        let stored = offset_stored(mesh, &limited(&asked), &storage, &Progress::none()).unwrap();
        assert!(!stored.surface.is_in_memory(), "{name}");
        let (one, other) = (&whole.report, &stored.report);
        assert!(one.certified && one.solid && other.certified && other.solid);
        assert_eq!(one.feature_edges, other.feature_edges);
        assert_eq!(
            one.most_distance_found.to_bits(),
            other.most_distance_found.to_bits()
        );
        assert!((one.least_distance - other.least_distance).abs() <= 1e-3 * asked.tolerance);
        for format in [
            MeshFormat::StlBinary,
            MeshFormat::PlyBinary,
            MeshFormat::Obj,
            MeshFormat::ThreeMf,
            MeshFormat::Glb,
        ] {
            let (mut files, none) = ([vec![], vec![]], Progress::none());
            let options = WriteOptions::default();
            write_mesh(&whole.mesh, format, &options, &mut files[0], &none).unwrap();
            write_rows(&stored.surface, format, &options, &mut files[1], &none).unwrap();
            assert!(files[0] == files[1], "{name} as {format}");
        }
        assert_eq!(
            stored.surface.triangle_count(),
            whole.mesh.triangles().len()
        );
        let again = stored.surface.into_mesh(&Progress::none()).unwrap();
        assert!(again == whole.mesh, "{name}");
    }
}

#[test]
fn pieces_are_simplified_as_well_as_the_whole() {
    let mesh = torus(1.0, 0.4, 24, 16).mesh;
    let asked = params(Side::Outer, 0.08, 0.0016, true);
    let whole = offset(&mesh, &asked, &Progress::none()).unwrap();
    let made = offset(&mesh, &limited(&asked), &Progress::none()).unwrap();
    assert!(made.report.certified && made.report.solid);
    assert_eq!(
        made.report.extracted_triangles,
        whole.report.extracted_triangles
    );
    let [one, other] = [&whole, &made].map(|offset| offset.mesh.triangles().len() as f64);
    assert!(other < 1.1 * one, "{one} and {other}");
    let found = check(&made.mesh, &CheckParams::default(), &Progress::none()).unwrap();
    assert!(found.is_solid());
}

#[test]
fn a_shell_and_a_thick_sheet_are_made_in_little_memory_too() {
    let shell = params(Side::Shell, 0.08, 0.0016, false);
    let thick = OffsetParams {
        open: OpenRule::Thicken,
        ..params(Side::Both, 0.1, 0.004, true)
    };
    for (mesh, asked) in [
        (torus(1.0, 0.4, 24, 16).mesh, shell),
        (sheet(3.0, 2.0, 2, 2).mesh, thick),
    ] {
        let whole = offset(&mesh, &asked, &Progress::none()).unwrap();
        let stored = offset_stored(&mesh, &limited(&asked), &storage, &Progress::none()).unwrap();
        assert!(stored.surface.is_in_memory());
        assert!(stored.report.certified && stored.report.solid);
        let made = stored.surface.into_mesh(&Progress::none()).unwrap();
        if !asked.simplify {
            assert!(made == whole.mesh);
        }
    }
}

#[test]
fn a_storage_that_fails_is_an_error_that_says_why() {
    let asked = limited(&params(Side::Both, 0.08, 0.0016, false));
    let mesh = torus(1.0, 0.4, 24, 16).mesh;
    let none = || Err(io::Error::other("no room on this ship"));
    let error = offset_stored(&mesh, &asked, &none, &Progress::none()).unwrap_err();
    let sentence = "cannot keep the surface outside of memory: no room on this ship";
    assert_eq!(error.to_string(), sentence);
    // one that is full at once
    let full = || Ok(Box::new(Cursor::new(vec![0_u8; 64].into_boxed_slice())) as Box<dyn Storage>);
    let error = offset_stored(&mesh, &asked, &full, &Progress::none()).unwrap_err();
    assert!(matches!(error, OffsetError::Storage { .. }), "{error}");
}
