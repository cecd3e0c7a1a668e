//! Results in 32-bit floats: the verdict is that of a reader of the file.

use glam::{DMat3, DVec3};
use ravec_boolean::{Boolean, BooleanParams, Expr, boolean};
use ravec_mesh::{CheckParams, Coordinates, MeshCheck, TriMesh, check, weld};
use ravec_progress::Progress;
use ravec_scenes::Seed;
use ravec_scenes::solids::{cylinder, icosphere};

use crate::support::{cuboid, difference, intersection, symmetric_difference, union};

/// Evaluates for a file of 32-bit floats whose readers join vertices at equal places.
fn for_stl(meshes: &[TriMesh], expr: &Expr) -> Boolean {
    let params = BooleanParams {
        coordinates: Coordinates::Single,
        separate: true,
        ..BooleanParams::default()
    };
    boolean(meshes, expr, &params, &Progress::none()).unwrap()
}

/// The check of the mesh as a reader of STL sees it.
fn as_read(mesh: &TriMesh) -> MeshCheck {
    let floats = mesh.positions().iter().map(|p| p.as_vec3().as_dvec3());
    let read = TriMesh::new(floats.collect(), mesh.triangles().to_vec()).unwrap();
    let params = CheckParams {
        self_intersections: true,
        list_limit: 3,
    };
    check(&weld(&read, 0.0).mesh, &params, &Progress::none()).unwrap()
}

/// Compares the verdict with that of a reader.
fn assert_verdict_holds(result: &Boolean, name: &str) {
    let report = &result.report;
    for p in result.mesh.positions() {
        assert_eq!(p.as_vec3().as_dvec3(), *p, "{name}");
    }
    let found = as_read(&result.mesh);
    let is_empty = result.mesh.triangles().is_empty();
    assert_eq!(
        report.solid,
        is_empty || found.is_solid(),
        "{name}: {report:?} {found:?}"
    );
}

/// A random rotation.
fn turn(seed: Seed) -> DMat3 {
    let angle = |channel| seed.between(0, 0, channel, 0.0, std::f64::consts::TAU);
    DMat3::from_euler(glam::EulerRot::ZYX, angle(0), angle(1), angle(2))
}

fn turned(mesh: &TriMesh, by: DMat3, shift: DVec3) -> TriMesh {
    let positions = mesh.positions().iter().map(|&p| by * p + shift);
    TriMesh::new(positions.collect(), mesh.triangles().to_vec()).unwrap()
}

/// Two bodies with common faces or a common edge, the expression over them, and the volume of the result.
fn pair(kind: usize, seed: Seed) -> ([TriMesh; 2], Expr, f64) {
    let between = |low, high, channel| seed.between(1, 0, channel, low, high);
    let (x, y, z) = (
        between(20.0, 60.0, 0),
        between(20.0, 60.0, 1),
        between(2.0, 9.0, 2),
    );
    let plate = cuboid(DVec3::ZERO, DVec3::new(x, y, z));
    let (radius, height) = (between(2.0, 8.0, 3), between(1.0, 12.0, 4));
    let slices = 8 + (seed.bits(0, 0, 5) % 60) as u32;
    let pin = |height: f64, base: f64| {
        let at = DVec3::new(
            between(9.0, x - 9.0, 6),
            between(9.0, y - 9.0, 7),
            base + 0.5 * height,
        );
        cylinder(radius, height, slices).shifted(at).mesh
    };
    let slice = std::f64::consts::TAU / f64::from(slices);
    let disc = 0.5 * f64::from(slices) * radius * radius * slice.sin();
    let block = x * y * z;
    let corner = DVec3::new(x, y, z);
    match kind {
        // a boss stands on the plate
        0 => ([plate, pin(height, z)], union(), block + disc * height),
        // a hole as deep as the plate
        1 => ([plate, pin(z, 0.0)], difference(), block - disc * z),
        // a pocket that is open at the top
        2 => (
            [plate, pin(0.5 * z, 0.5 * z)],
            difference(),
            block - disc * 0.5 * z,
        ),
        // a block that ends where the plate does, on three sides
        3 => {
            let part = cuboid(0.25 * corner, corner);
            ([plate, part], difference(), block * (1.0 - 0.75f64.powi(3)))
        }
        // blocks side by side
        4 => {
            let beside = cuboid(DVec3::new(x, 0.0, 0.0), DVec3::new(x + height, y, z));
            ([plate, beside], union(), block + height * y * z)
        }
        // blocks that touch in an edge
        5 => {
            let beside = cuboid(DVec3::new(x, y, 0.0), DVec3::new(x + height, y + 5.0, z));
            ([plate, beside], union(), block + height * 5.0 * z)
        }
        // what is in one of two balls
        6 => {
            let ball = icosphere(radius, 2).mesh;
            let volume = ravec_mesh::measure(&ball).volume;
            let beside = turned(&ball, DMat3::IDENTITY, DVec3::new(0.6 * radius, 0.1, 0.2));
            let both = boolean(
                &[ball.clone(), beside.clone()],
                &intersection(),
                &BooleanParams::default(),
                &Progress::none(),
            );
            let common = both.unwrap().report.volume;
            (
                [ball, beside],
                symmetric_difference(),
                2.0 * (volume - common),
            )
        }
        // a cavity that touches the outer surface in an edge
        _ => {
            let roof = TriMesh::new(
                vec![
                    DVec3::new(5.0, 0.25 * y, 0.5 * z),
                    DVec3::new(5.0, 0.75 * y, 0.5 * z),
                    DVec3::new(9.0, 0.25 * y, 0.5 * z),
                    DVec3::new(9.0, 0.75 * y, 0.5 * z),
                    DVec3::new(7.0, 0.25 * y, z),
                    DVec3::new(7.0, 0.75 * y, z),
                ],
                vec![
                    [0, 1, 3],
                    [0, 3, 2],
                    [0, 4, 5],
                    [0, 5, 1],
                    [2, 3, 5],
                    [2, 5, 4],
                    [0, 2, 4],
                    [1, 5, 3],
                ],
            );
            let volume = 0.5 * 4.0 * 0.5 * z * 0.5 * y;
            ([plate, roof.unwrap()], difference(), block - volume)
        }
    }
}

const KINDS: usize = 8;

#[test]
fn turned_bodies_with_common_faces_are_solid_in_32_bit_floats() {
    let count = std::env::var("RAVEC_PAIRS").map_or(24, |count| count.parse().unwrap());
    let mut failed = 0;
    for number in 0..count {
        let seed = Seed(11).fork(number);
        let kind = number as usize % KINDS;
        let (meshes, expr, volume) = pair(kind, seed);
        let (by, shift) = (turn(seed), DVec3::splat(seed.between(2, 0, 0, -90.0, 90.0)));
        let meshes = meshes.map(|mesh| turned(&mesh, by, shift));
        let result = for_stl(&meshes, &expr);
        let name = format!("pair {number} of kind {kind}");
        assert_verdict_holds(&result, &name);
        let error = (result.report.volume / volume - 1.0).abs();
        assert!(
            error < 1e-4,
            "{name}: {} instead of {volume}",
            result.report.volume
        );
        if !result.report.solid {
            eprintln!("{name} {:?}", result.report);
            failed += 1;
        }
    }
    assert!(40 * failed <= count, "{failed} of {count} are not solid");
}

#[test]
fn blocks_that_touch_in_an_edge_are_drawn_apart_where_readers_join_places() {
    let one = cuboid(DVec3::ZERO, DVec3::ONE);
    let other = cuboid(DVec3::new(1.0, 1.0, 0.0), DVec3::new(2.0, 2.0, 1.0));
    let corner = cuboid(DVec3::splat(-1.0), DVec3::ZERO);
    let meshes = [one, other, corner];
    let all = Expr::Union((0..3).map(Expr::Mesh).collect());
    let result = for_stl(&meshes, &all);
    assert!(
        as_read(&result.mesh).is_solid(),
        "{:?}",
        as_read(&result.mesh)
    );
    assert!(result.report.solid && result.report.separated == 6);
    assert!(result.report.separation <= 2e-6);
    assert!((result.report.volume - 3.0).abs() < 1e-5);
    // other formats keep them where they are
    let params = BooleanParams {
        coordinates: Coordinates::Single,
        ..BooleanParams::default()
    };
    let result = boolean(&meshes, &all, &params, &Progress::none()).unwrap();
    assert_eq!((result.report.volume, result.report.separated), (3.0, 0));
    assert!(result.report.solid && !as_read(&result.mesh).is_solid());
}

#[test]
fn triangles_of_32_bit_floats_stay_whole() {
    let one = cuboid(DVec3::ZERO, DVec3::splat(0.1f32.into()));
    let far = cuboid(DVec3::splat(1.0), DVec3::splat(1.1f32.into()));
    let result = for_stl(&[one.clone(), far], &union());
    assert_eq!(
        (result.report.kept_triangles, result.report.rounded),
        (24, 0.0)
    );
    // those of doubles are whole but for rounding
    let far = cuboid(DVec3::splat(1.0), DVec3::splat(1.1));
    let result = for_stl(&[one, far], &union());
    assert_eq!(result.report.kept_triangles, 24);
    assert!(result.report.rounded > 0.0 && result.report.rounded < 1e-7);
}
