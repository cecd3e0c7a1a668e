//! The other direction: the surface leaves out nothing of the true offset, creases and corners least of all.

mod support;

use glam::{DVec3, dvec3};
use ravec_mesh::{Bvh, TriMesh};
use ravec_offset::Side;
use ravec_scenes::Seed;
use ravec_scenes::solids::{
    comb, cone, crossing_plates, cuboid, cylinder, icosphere, sheet, soup, torus, wedge,
};
use support::verdict::{coverage_by_oracle, params, sound_offset};

fn assert_covered(
    name: &str,
    mesh: &TriMesh,
    side: Side,
    (distance, tolerance, simplify): (f64, f64, bool),
) {
    let asked = params(side, distance, tolerance, simplify);
    let (found, _) = sound_offset(name, mesh, &asked);
    let spacing = (0.25 * distance).min(mesh.bounds().diagonal() / 40.0);
    let covered = coverage_by_oracle(mesh, &found.mesh, &asked, spacing);
    assert!(
        covered.samples > 100,
        "{name}, {asked:?}: {}",
        covered.samples
    );
    if let Some(gap) = covered.gaps.first() {
        let (count, of) = (covered.gaps.len(), covered.samples);
        let share = gap.miss / tolerance;
        panic!(
            "{name}, {asked:?}: {count} of {of} places farther than the tolerance, up to {share} of it: {gap:?}"
        );
    }
}

#[test]
fn offsets_of_solids_are_covered_on_either_side() {
    for (solid, inner) in [
        (cuboid(dvec3(2.0, 1.5, 1.0)), 0.2),
        (icosphere(1.0, 2), 0.2),
        (cylinder(0.8, 2.0, 24), 0.2),
        (cone(1.0, 1.6, 24), 0.1),
        (torus(1.0, 0.4, 24, 12), 0.1),
        (comb(3, 0.1, 0.16, 0.6), 0.03),
    ] {
        assert_covered(solid.name, &solid.mesh, Side::Outer, (0.2, 0.01, true));
        assert_covered(
            solid.name,
            &solid.mesh,
            Side::Inner,
            (inner, 0.05 * inner, true),
        );
        assert_covered(
            solid.name,
            &solid.mesh,
            Side::Both,
            (inner, 0.05 * inner, false),
        );
    }
}

#[test]
fn offsets_of_open_and_crossing_sheets_are_covered() {
    for simplify in [false, true] {
        for solid in [sheet(2.0, 1.5, 3, 2), crossing_plates(1.0)] {
            assert_covered(solid.name, &solid.mesh, Side::Both, (0.2, 0.01, simplify));
            assert_covered(
                solid.name,
                &solid.mesh,
                Side::Outer,
                (0.05, 0.004, simplify),
            );
        }
    }
}

#[test]
fn offsets_of_soups_are_covered() {
    for seed in 1..4 {
        let (soup, _) = soup(12, Seed(seed));
        for side in [Side::Both, Side::Outer] {
            assert_covered(&format!("soup {seed}"), &soup.mesh, side, (0.2, 0.02, true));
        }
    }
}

/// Two rectangles that meet at this angle along the z axis, open towards positive x.
fn valley(angle_rad: f64) -> TriMesh {
    let end = 2.0 * glam::DVec2::from_angle(0.5 * angle_rad);
    let at = |x: f64, y: f64, z: f64| dvec3(x, y, z);
    let positions = vec![
        at(0.0, 0.0, -0.5),
        at(0.0, 0.0, 0.5),
        at(end.x, end.y, -0.5),
        at(end.x, end.y, 0.5),
        at(end.x, -end.y, -0.5),
        at(end.x, -end.y, 0.5),
    ];
    TriMesh::new(positions, vec![[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]]).unwrap()
}

/// How far the surface is from where the crest between two planes is known to be, at most, in shares of the tolerance.
fn crest_miss(surface: &TriMesh, angle_rad: f64, half_length: f64, distance: f64) -> f64 {
    let bvh = Bvh::new(surface);
    let x = distance / (0.5 * angle_rad).sin();
    (0..=200)
        .map(|i| half_length * (f64::from(i) / 100.0 - 1.0))
        .map(|z| {
            bvh.closest(DVec3::new(x, 0.0, z))
                .unwrap()
                .distance_sq
                .sqrt()
        })
        .fold(0.0, f64::max)
}

const ANGLES_DEG: [f64; 8] = [10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 150.0];

#[test]
fn crests_between_two_sheets_are_where_they_belong_at_any_angle() {
    for degrees in ANGLES_DEG {
        let mesh = valley(degrees.to_radians());
        let (distance, tolerance) = (0.1, 0.004);
        for simplify in [false, true] {
            let asked = params(Side::Both, distance, tolerance, simplify);
            let (found, _) = sound_offset(&format!("valley of {degrees}"), &mesh, &asked);
            let miss = crest_miss(&found.mesh, degrees.to_radians(), 0.5, distance);
            let share = miss / tolerance;
            assert!(
                share <= 1.0,
                "{degrees} degrees, simplify {simplify}: {share}"
            );
        }
        assert_covered(
            &format!("valley of {degrees}"),
            &mesh,
            Side::Outer,
            (distance, tolerance, true),
        );
    }
}

#[test]
fn inner_crests_of_wedges_are_where_they_belong_at_any_angle() {
    for degrees in ANGLES_DEG {
        let angle = degrees.to_radians();
        let solid = wedge(angle, 1.0, 1.0);
        // half of what fits inside: the radius of the circle in the triangle
        let radius = 0.5 * angle.sin() / (1.0 + (0.5 * angle).sin());
        let (distance, tolerance) = (0.5 * radius, 0.03 * radius);
        for simplify in [false, true] {
            let asked = params(Side::Inner, distance, tolerance, simplify);
            let (found, _) = sound_offset(&format!("wedge of {degrees}"), &solid.mesh, &asked);
            let miss = crest_miss(&found.mesh, angle, 0.5 - distance, distance);
            let share = miss / tolerance;
            assert!(
                share <= 1.0,
                "{degrees} degrees, simplify {simplify}: {share}"
            );
        }
        assert_covered(
            &format!("wedge of {degrees}"),
            &solid.mesh,
            Side::Inner,
            (distance, tolerance, true),
        );
    }
}
