use super::*;
use crate::closing::close;
use crate::params::CloseRule;
use glam::DVec3;
use ravec_scenes::solids::{cuboid, icosphere};

fn examined(mesh: &TriMesh) -> OperandReport {
    examined_by(mesh, Inside::Positive).report
}

fn examined_by(mesh: &TriMesh, inside: Inside) -> Examined {
    let closing = close(mesh, CloseRule::Auto, &Progress::none()).unwrap();
    examine(mesh, &closing, inside, &Progress::none()).unwrap()
}

fn turned(mesh: &TriMesh) -> TriMesh {
    let triangles = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]);
    TriMesh::new(mesh.positions().to_vec(), triangles.collect()).unwrap()
}

fn joined(parts: &[TriMesh]) -> TriMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for part in parts {
        let start = positions.len() as u32;
        positions.extend_from_slice(part.positions());
        triangles.extend(part.triangles().iter().map(|t| t.map(|v| v + start)));
    }
    TriMesh::new(positions, triangles).unwrap()
}

fn moved(mesh: &TriMesh, by: DVec3) -> TriMesh {
    let positions = mesh.positions().iter().map(|p| *p + by);
    TriMesh::new(positions.collect(), mesh.triangles().to_vec()).unwrap()
}

#[test]
fn of_a_clean_solid_nothing_is_assumed() {
    let report = examined(&icosphere(1.0, 3).mesh);
    assert!(report.closed && report.oriented);
    assert_eq!(report.assumptions, [""; 0]);
    assert_eq!((report.triangles, report.closing_triangles), (1280, 0));
}

#[test]
fn a_hollow_solid_is_not_inside_out_but_a_part_beside_it_is() {
    let [outer, inner] = [2.0, 1.0].map(|radius| icosphere(radius, 2).mesh);
    let inner = turned(&inner);
    let hollow = joined(&[outer.clone(), inner.clone()]);
    assert_eq!(examined(&hollow).reversed_parts, 0);
    let beside = joined(&[outer.clone(), moved(&inner, 5.0 * DVec3::X)]);
    let Examined { report, turn } = examined_by(&beside, Inside::Positive);
    assert_eq!((report.reversed_parts, report.turned_parts), (1, 1));
    assert_eq!(
        turn.iter().filter(|turned| **turned).count(),
        inner.triangles().len()
    );
    assert!(!turn[0]);
    let [outer, inner] = [&outer, &inner].map(|part| ravec_mesh::measure(part).volume);
    assert!((report.volume - (outer - inner)).abs() < 1e-9);
    assert_eq!(
        report.assumptions[0],
        "1 part is inside out and touches no other, and was turned (with a volume of -4.047 near (5, 0, 0))"
    );
    for inside in [Inside::Nonzero, Inside::OuterHull] {
        let Examined { report, turn } = examined_by(&beside, inside);
        assert_eq!((report.reversed_parts, report.turned_parts), (1, 0));
        assert!(turn.is_empty());
    }
}

#[test]
fn a_mesh_that_is_inside_out_is_turned_with_its_cavities() {
    let [outer, inner] = [2.0, 1.0].map(|radius| icosphere(radius, 2).mesh);
    let hollow = joined(&[outer, turned(&inner)]);
    let open = {
        let (positions, mut triangles) = cuboid(DVec3::ONE).mesh.into_parts();
        triangles.pop();
        TriMesh::new(positions, triangles).unwrap()
    };
    for solid in [cuboid(DVec3::ONE).mesh, hollow, open] {
        let right = examined(&solid);
        let Examined { report, turn } = examined_by(&turned(&solid), Inside::Positive);
        assert!(turn.iter().all(|turned| *turned) && !turn.is_empty());
        assert_eq!(report.assumptions[0], "it is inside out and was turned");
        assert!((report.volume - right.volume).abs() < 1e-12);
        assert_eq!(report.turned_parts, 1);
    }
}

#[test]
fn small_parts_far_from_the_middle_are_as_they_are() {
    let large = cuboid(DVec3::splat(2_f64.powi(40))).mesh;
    let small = moved(
        &cuboid(DVec3::splat(2.0)).mesh,
        DVec3::splat(2_f64.powi(41)),
    );
    for (small, turned_parts) in [(small.clone(), 0), (turned(&small), 1)] {
        let report = examined(&joined(&[large.clone(), small]));
        assert_eq!(report.turned_parts, turned_parts);
    }
}

#[test]
fn a_speck_that_touches_a_surface_belongs_to_it() {
    let cube = cuboid(DVec3::ONE).mesh;
    let corner = cube.bounds().max;
    // a small cube inside out, at a corner of the large one
    let speck = turned(&cuboid(DVec3::splat(0.25)).mesh);
    let speck = moved(&speck, corner - speck.bounds().min);
    assert_eq!(examined(&joined(&[cube, speck])).reversed_parts, 0);
}

#[test]
fn a_turned_triangle_and_one_without_area_are_told() {
    let cube = cuboid(DVec3::ONE).mesh;
    let (mut positions, mut triangles) = cube.into_parts();
    let [a, b, c] = triangles[0];
    triangles[0] = [a, c, b];
    let middle = positions.len() as u32;
    positions.push(DVec3::splat(0.25));
    triangles.push([a, middle, a]);
    let report = examined(&TriMesh::new(positions, triangles).unwrap());
    assert!(!report.closed && !report.oriented);
    assert_eq!(report.degenerate_triangles, 1);
    assert_eq!(report.closing_triangles, 2);
    let notes = report.assumptions.join("\n");
    assert!(
        notes.contains(
            "1 group of triangles faces the other way than all around it and was taken as turned"
        ),
        "{notes}"
    );
    assert!(!notes.contains("hole"), "{notes}");
    assert!(
        notes.contains("1 triangle without area was left out"),
        "{notes}"
    );
}

#[test]
fn triangles_that_cancel_are_told() {
    let cube = cuboid(DVec3::ONE).mesh;
    let (positions, mut triangles) = cube.into_parts();
    let backward: Vec<_> = triangles.iter().map(|&[a, b, c]| [b, a, c]).collect();
    triangles.extend(&backward[..11]);
    let report = examined(&TriMesh::new(positions, triangles).unwrap());
    let notes = report.assumptions.join("\n");
    assert!(notes.contains("22 triangles lie on another one"), "{notes}");
}

#[test]
fn a_hole_is_told_with_its_width_and_place() {
    let (positions, mut triangles) = cuboid(DVec3::ONE).mesh.into_parts();
    triangles.pop();
    let report = examined(&TriMesh::new(positions, triangles).unwrap());
    assert_eq!(report.assumptions.len(), 1);
    let notes = &report.assumptions[0];
    assert!(
        notes.starts_with("1 hole was closed by a surface of least area, 1.414 across at ("),
        "{notes}"
    );
}

#[test]
fn numbers_are_short() {
    for (x, text) in [
        (0.0, "0"),
        (0.03125, "0.03125"),
        (12.84, "12.84"),
        (-1.5, "-1.5"),
        (123456.0, "1.235e5"),
        (2e-7, "2.000e-7"),
        (99999.0, "99999"),
        (100.0, "100"),
    ] {
        assert_eq!(short(x), text);
    }
}
