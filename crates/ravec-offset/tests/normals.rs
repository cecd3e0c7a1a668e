//! Tilt of the facets of simplified offsets against the surface that they represent.

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

/// A ball, divided so often, whose radius changes from vertex to vertex, by up to this.
fn ball(divisions: u32, roughness: f64) -> TriMesh {
    let ball = turned(&icosphere(1.0, divisions).mesh);
    let rough = |p: DVec3| {
        let seed = (p.dot(DVec3::new(12.9898, 78.233, 37.719)).sin() * 43758.5453).fract();
        (1.0 + roughness * seed) * p
    };
    let positions = ball.positions().iter().map(|&p| rough(p)).collect();
    TriMesh::new(positions, ball.triangles().to_vec()).unwrap()
}

#[test]
fn rough_meshes_have_leeway_unless_somebody_asks_for_a_limit() {
    let off = |mesh: TriMesh, max_normal_deviation_deg| {
        let params = OffsetParams {
            max_normal_deviation_deg,
            ..params(Side::Outer, 0.06, 0.003, true)
        };
        let (found, _) = sound_offset("a ball", &mesh, &params);
        turned_by_more(&mesh, &found.mesh, 4.0)
    };
    // a ball bends by 3.5 radians along its diagonal
    let smooth = off(ball(5, 0.0), None);
    assert!(smooth <= 0.01, "{smooth} of the area");
    // more than five
    let [rough, limited] = [None, Some(4.0)].map(|limit| off(ball(4, 0.012), limit));
    assert!(rough > 0.03, "{rough} of the area");
    assert!(limited <= 0.01, "{limited} of the area");
}
