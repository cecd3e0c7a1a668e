//! The other direction: the surface leaves out nothing of the true offset, creases and corners least of all.

mod support;

use glam::{DMat3, DVec2, DVec3, EulerRot, dvec2, dvec3};
use ravec_mesh::{Bvh, TriMesh};
use ravec_offset::{OffsetParams, Side};
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
    assert_all_covered(name, mesh, &found.mesh, &asked);
}

fn assert_all_covered(name: &str, mesh: &TriMesh, surface: &TriMesh, asked: &OffsetParams) {
    let size = mesh.bounds().diagonal().max(2.0 * asked.distance);
    let spacing = (0.4 * asked.distance).max(size / 50.0).min(size / 25.0);
    let covered = coverage_by_oracle(mesh, surface, asked, spacing);
    let (samples, gaps) = (covered.samples, covered.gaps.len());
    assert!(samples > 100, "{name}, {asked:?}: {samples}");
    // simplification keeps corners where three sheets meet by samples only, not by a proof
    let allowed = if asked.simplify { 1.1 } else { 1.0 };
    let mut gaps_beyond = covered.gaps.iter();
    if let Some(gap) = gaps_beyond.find(|gap| gap.miss > allowed * asked.tolerance) {
        let share = gap.miss / asked.tolerance;
        panic!(
            "{name}, {asked:?}: {gaps} of {samples} places are not close to it, up to {share} of the tolerance: {gap:?}"
        );
    }
}

#[test]
fn offsets_of_solids_are_covered_on_either_side() {
    for (solid, inner) in [
        (cuboid(dvec3(2.0, 1.5, 1.0)), 0.2),
        (icosphere(1.0, 0), 0.2),
        (cylinder(0.8, 2.0, 8), 0.2),
        (cone(1.0, 1.6, 8), 0.1),
        (torus(1.0, 0.4, 12, 6), 0.1),
        (comb(2, 0.1, 0.16, 0.4), 0.03),
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

/// Boxes, given by their lowest and highest corners.
fn boxes(list: &[[DVec3; 2]]) -> TriMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for &[low, high] in list {
        let one = cuboid(high - low).shifted(0.5 * (low + high)).mesh;
        let first = positions.len() as u32;
        positions.extend(one.positions());
        triangles.extend(one.triangles().iter().map(|t| t.map(|v| v + first)));
    }
    TriMesh::new(positions, triangles).unwrap()
}

/// A cell of the search may be larger than all of a room inside, and have no corner in it.
#[test]
fn small_rooms_inside_are_found_beside_large_ones() {
    let large = [DVec3::ZERO, DVec3::ONE];
    for (name, size) in [
        ("cube", DVec3::splat(0.06)),
        ("rod", dvec3(0.06, 0.06, 1.0)),
        ("wall", dvec3(0.06, 1.0, 1.0)),
    ] {
        for place in [dvec3(1.5, 0.1, 0.0), dvec3(2.3, 0.37, -0.2)] {
            let mesh = boxes(&[large, [place, place + size]]);
            let asked = params(Side::Inner, 0.02, 0.002, false);
            let (found, checked) = sound_offset(name, &mesh, &asked);
            assert_eq!(checked.components, 2, "{name} at {place}");
            assert_all_covered(name, &mesh, &found.mesh, &asked);
        }
    }
}

/// Corners of the cells around it see only some of the sides of a small room, and none of them from within.
#[test]
fn rooms_hardly_higher_than_the_tolerance_are_found_however_they_are_turned() {
    let (distance, tolerance) = (0.1, 0.01);
    for seed in 0..20u32 {
        let turn = DMat3::from_euler(
            EulerRot::XYZ,
            0.7 * f64::from(seed),
            0.31 * f64::from(seed),
            0.13 * f64::from(seed),
        );
        // all but the shallowest have to be found
        let height = tolerance * (1.3 + 0.1 * f64::from(seed));
        let room = 2.0 * DVec3::splat(distance + height);
        let rooms = (0..6).map(|i| {
            let at = dvec3(f64::from(i % 3), f64::from(i / 3), 0.0) * 0.37 + 0.01 * f64::from(seed);
            [at - 0.5 * room, at + 0.5 * room]
        });
        let straight = boxes(&rooms.collect::<Vec<_>>());
        let turned = straight.positions().iter().map(|&p| turn * p).collect();
        let mesh = TriMesh::new(turned, straight.triangles().to_vec()).unwrap();
        let asked = params(Side::Inner, distance, tolerance, false);
        let (found, _) = sound_offset("rooms", &mesh, &asked);
        let covered = coverage_by_oracle(&mesh, &found.mesh, &asked, 0.4 * height);
        assert!(covered.samples > 100, "{}", covered.samples);
        let gap = covered.gaps.first();
        assert!(gap.is_none(), "seed {seed}, {height} high: {gap:?}");
    }
}

#[test]
fn slits_between_solids_are_found() {
    let large = [DVec3::ZERO, DVec3::ONE];
    for place in [dvec3(1.25, 0.0, 0.0), dvec3(1.25, 0.1, -0.2)] {
        let mesh = boxes(&[large, [place, place + DVec3::ONE]]);
        assert_covered("slit", &mesh, Side::Outer, (0.1, 0.01, true));
    }
}

#[test]
fn triangles_without_area_are_points_and_segments() {
    let ends = vec![DVec3::ZERO, dvec3(1.0, 0.2, -0.3)];
    for triangle in [[0, 0, 0], [0, 1, 1]] {
        let mesh = TriMesh::new(ends.clone(), vec![triangle]).unwrap();
        for side in [Side::Both, Side::Outer] {
            assert_covered("thin triangle", &mesh, side, (0.3, 0.03, true));
        }
    }
}

/// Two rectangles of this width that meet at this angle along the z axis, open towards positive x.
fn valley(angle_rad: f64, width: f64) -> TriMesh {
    let end = width * DVec2::from_angle(0.5 * angle_rad);
    let positions = [DVec2::ZERO, end, dvec2(end.x, -end.y)]
        .into_iter()
        .flat_map(|p| [p.extend(-HALF_LENGTH), p.extend(HALF_LENGTH)])
        .collect();
    TriMesh::new(positions, vec![[0, 2, 3], [0, 3, 1], [0, 1, 5], [0, 5, 4]]).unwrap()
}

const HALF_LENGTH: f64 = 0.2;

/// Largest distance of the surface from the known crest between two planes, in shares of the tolerance.
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

/// Asks for a crest along the z axis between −`half_length` and `half_length` to be within the tolerance, and for all else.
fn assert_crest(
    name: &str,
    mesh: &TriMesh,
    asked: &OffsetParams,
    angle_rad: f64,
    half_length: f64,
) {
    let (found, _) = sound_offset(name, mesh, asked);
    let miss = crest_miss(&found.mesh, angle_rad, half_length, asked.distance);
    let share = miss / asked.tolerance;
    assert!(share <= 1.0, "{name}, {asked:?}: {share} of the tolerance");
    assert_all_covered(name, mesh, &found.mesh, asked);
}

const ANGLES_DEG: [f64; 8] = [7.0, 10.0, 15.0, 20.0, 30.0, 60.0, 100.0, 150.0];

#[test]
fn crests_between_two_sheets_are_where_they_belong_at_any_angle() {
    for degrees in ANGLES_DEG {
        let angle = degrees.to_radians();
        let (distance, tolerance) = (0.1, 0.008);
        // wide enough for the crest to be above them
        let mesh = valley(angle, 1.2 * distance / (0.5 * angle).tan() + 0.1);
        for simplify in [false, true] {
            let asked = params(Side::Both, distance, tolerance, simplify);
            assert_crest(
                &format!("valley of {degrees}"),
                &mesh,
                &asked,
                angle,
                HALF_LENGTH,
            );
        }
    }
}

#[test]
fn inner_crests_of_wedges_are_where_they_belong_at_any_angle() {
    for degrees in ANGLES_DEG {
        let angle = degrees.to_radians();
        // an acute crest takes many cells for each bit of its length
        let depth = if degrees < 20.0 { 0.2 } else { 1.0 };
        let solid = wedge(angle, 1.0, depth);
        // half of what fits inside: the radius of the circle in the triangle
        let radius = 0.5 * angle.sin() / (1.0 + (0.5 * angle).sin());
        let (distance, tolerance) = (0.5 * radius, 0.03 * radius);
        for simplify in [false, true] {
            let asked = params(Side::Inner, distance, tolerance, simplify);
            let half_length = 0.5 * depth - distance;
            assert_crest(
                &format!("wedge of {degrees}"),
                &solid.mesh,
                &asked,
                angle,
                half_length,
            );
        }
    }
}

/// A cell shows such a crest by a corner of its own only if it is much smaller than what may be cut off. Splitting all cells down to
/// that makes two thirds more triangles.
#[test]
fn acute_crests_are_reached_from_cells_beside_them() {
    let degrees = 20.0_f64;
    let solid = wedge(degrees.to_radians(), 1.0, 1.0);
    let turn = DMat3::from_euler(EulerRot::XYZ, 0.5, 0.8, 0.3);
    let positions = solid.mesh.positions().iter().map(|&p| turn * p).collect();
    let mesh = TriMesh::new(positions, solid.mesh.triangles().to_vec()).unwrap();
    let (distance, tolerance) = (0.072_85, 0.004_37);
    let asked = params(Side::Inner, distance, tolerance, false);
    let (found, _) = sound_offset("turned wedge", &mesh, &asked);
    let crest = (1.0 - 2.0 * distance) / tolerance;
    let triangles = found.report.extracted_triangles as f64;
    assert!(triangles < 250.0 * crest, "{triangles} for {crest}");
}
