//! How far the facets of simplified offsets are turned away from the surface that they stand for.

mod support;

use glam::{DQuat, DVec3};
use ravec_mesh::{Bvh, TriMesh};
use ravec_offset::{OffsetParams, Side};
use ravec_scenes::solids::{crossing_plates, cuboid, cylinder, icosphere};
use support::verdict::{params, sound_offset};

/// The share of the area whose facets are turned by more than some degrees, at their middles, from what is nearest.
fn turned_by_more(mesh: &TriMesh, surface: &TriMesh, degrees: f64) -> f64 {
    let bvh = Bvh::new(mesh);
    let [mut more, mut all] = [0.0; 2];
    for t in 0..surface.triangles().len() as u32 {
        let [a, b, c] = surface.corners(t);
        let (middle, normal) = ((a + b + c) / 3.0, (b - a).cross(c - a));
        let closest = bvh.closest(middle).expect("there are triangles");
        all += normal.length();
        if normal.angle_between(middle - closest.point) > degrees.to_radians() {
            more += normal.length();
        }
    }
    more / all
}

/// A mesh that lies along no axis of the cells.
fn turned(mesh: &TriMesh) -> TriMesh {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    let positions = mesh.positions().iter().map(|&p| turn * p).collect();
    TriMesh::new(positions, mesh.triangles().to_vec()).unwrap()
}

#[test]
fn nearly_all_of_a_simplified_surface_faces_as_it_should() {
    let solids = [
        cuboid(DVec3::new(2.0, 1.5, 1.0)),
        cylinder(0.6, 1.0, 48),
        crossing_plates(2.0),
    ];
    for solid in solids {
        let mesh = turned(&solid.mesh);
        // a twentieth of the distance, and a fifth, with which more may be turned
        for tolerance in [0.003, 0.012] {
            let name = format!("{}, tolerance {tolerance}", solid.name);
            let of = |max_normal_deviation_deg| {
                let params = OffsetParams {
                    max_normal_deviation_deg,
                    ..params(Side::Outer, 0.06, tolerance, true)
                };
                let (found, _) = sound_offset(&name, &mesh, &params);
                (found.mesh, params.normal_deviation_deg())
            };
            let (surface, limit) = of(None);
            let off = turned_by_more(&mesh, &surface, limit);
            assert!(off <= 0.01, "{name}: {off} of the area");
            let (stricter, strict) = of(Some(0.5 * limit));
            let [off, less_off] = [&surface, &stricter].map(|s| turned_by_more(&mesh, s, strict));
            assert!(less_off <= 0.5 * off, "{name}: {less_off} and {off}");
            let [few, many] = [&surface, &stricter].map(|s| s.triangles().len());
            assert!(many > few, "{name}: {few} and {many} triangles");
        }
    }
}

/// A ball whose radius changes from vertex to vertex, so that its triangles are some degrees off.
fn rough_ball() -> TriMesh {
    let ball = turned(&icosphere(1.0, 4).mesh);
    let rough = |p: DVec3| {
        let seed = (p.dot(DVec3::new(12.9898, 78.233, 37.719)).sin() * 43758.5453).fract();
        (1.0 + 0.006 * seed) * p
    };
    let positions = ball.positions().iter().map(|&p| rough(p)).collect();
    TriMesh::new(positions, ball.triangles().to_vec()).unwrap()
}

#[test]
fn rough_meshes_have_leeway_unless_somebody_asks_for_a_limit() {
    let mesh = rough_ball();
    let of = |max_normal_deviation_deg| {
        let params = OffsetParams {
            max_normal_deviation_deg,
            ..params(Side::Outer, 0.06, 0.003, true)
        };
        let (found, _) = sound_offset("a rough ball", &mesh, &params);
        found.mesh
    };
    let (free, limited) = (of(None), of(Some(4.0)));
    let [off, less_off] = [&free, &limited].map(|s| turned_by_more(&mesh, s, 4.0));
    assert!(off > 0.03, "{off} of the area");
    assert!(less_off <= 0.01, "{less_off} of the area");
    let [few, many] = [&free, &limited].map(|s| s.triangles().len());
    assert!(many > few, "{few} and {many} triangles");
}
