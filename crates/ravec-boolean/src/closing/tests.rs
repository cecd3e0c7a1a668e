use super::*;
use glam::DVec3;
use proptest::prelude::*;
use ravec_mesh::winding_number;
use ravec_scenes::Seed;
use ravec_scenes::solids::{Solid, all, cuboid, cylinder, icosphere};

fn closed(mesh: &TriMesh) -> (TriMesh, Closing) {
    closed_by(mesh, CloseRule::Auto)
}

fn closed_by(mesh: &TriMesh, rule: CloseRule) -> (TriMesh, Closing) {
    let closing = close(mesh, rule, &Progress::none()).unwrap();
    let triangles = [mesh.triangles(), &closing.triangles].concat();
    let positions = [mesh.positions(), &closing.added].concat();
    let full = TriMesh::new(positions, triangles).unwrap();
    (full, closing)
}

/// The mesh without the triangles that `leave_out` picks by their corners.
fn without(mesh: &TriMesh, leave_out: impl Fn([DVec3; 3]) -> bool) -> TriMesh {
    let kept = (0..mesh.triangles().len() as u32).filter(|&t| !leave_out(mesh.corners(t)));
    let kept = kept.map(|t| mesh.triangles()[t as usize]);
    TriMesh::new(mesh.positions().to_vec(), kept.collect()).unwrap()
}

/// Each triangle with vertices of its own.
fn unwelded(mesh: &TriMesh) -> TriMesh {
    let corners = (0..mesh.triangles().len() as u32).flat_map(|t| mesh.corners(t));
    let triangles = (0..mesh.triangles().len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    TriMesh::new(corners.collect(), triangles.collect()).unwrap()
}

fn volume(mesh: &TriMesh) -> f64 {
    ravec_mesh::measure(mesh).volume
}

#[test]
fn a_closed_mesh_gets_no_triangles_welded_or_not() {
    for solid in all(Seed(1)).into_iter().filter(Solid::is_closed) {
        for mesh in [&solid.mesh, &unwelded(&solid.mesh)] {
            let closing = close(mesh, CloseRule::Auto, &Progress::none()).unwrap();
            assert!(
                closing.closed && closing.triangles.is_empty(),
                "{}",
                solid.name
            );
        }
    }
}

#[test]
fn a_box_without_a_face_gets_it_back() {
    let solid = cuboid(DVec3::new(1.0, 2.0, 3.0)).mesh;
    let top = solid.bounds().max.z;
    let open = without(&solid, |corners| corners.iter().all(|c| c.z == top));
    assert!(open.triangles().len() < solid.triangles().len());
    let (full, closing) = closed(&open);
    assert!(!closing.closed);
    assert_eq!(closing.holes.len(), 1);
    assert!((volume(&full) - 6.0).abs() < 1e-12);
    assert!((closing.holes[0].width - 5.0f64.sqrt()).abs() < 1e-12);
}

#[test]
fn a_cut_sphere_is_closed_where_it_winds_a_half() {
    // cut at half its radius: the rim zigzags over a row of triangles
    let sphere = icosphere(1.0, 4).mesh;
    let open = without(&sphere, |corners| corners.iter().all(|c| c.z > 0.5));
    let (full, closing) = closed(&open);
    assert_eq!(closing.holes.len(), 1);
    let mut judged = 0;
    for i in 0..9_i32.pow(3) {
        let at = |digit: i32| f64::from(i / digit % 9 - 4) * 0.237;
        let p = DVec3::new(at(1), at(9), at(81));
        let open = winding_number(&open, p);
        let full = winding_number(&full, p);
        assert!((full - full.round()).abs() < 1e-9, "{p}: {full}");
        // the rim is a tenth of the radius deep, and so is what lies between lid and level surface
        if (p.z - 0.5).abs() > 0.1 {
            judged += 1;
            assert_eq!(open > 0.5, full.round() > 0.5, "{p}: {open} and {full}");
        }
    }
    assert!(judged > 500);
}

/// A tube along z without ends.
fn tube(radius: f64, height: f64) -> TriMesh {
    let solid = cylinder(radius, height, 64).mesh;
    without(&solid, |[a, b, c]| a.z == b.z && b.z == c.z)
}

/// Numbers of loops of the holes that were closed.
fn loops(closing: &Closing) -> Vec<u32> {
    closing.holes.iter().map(|hole| hole.loops).collect()
}

#[test]
fn a_tube_gets_lids_however_short_it_is() {
    for height in [2.0, 0.5, 0.03, 0.01, 0.001] {
        let (full, closing) = closed(&tube(1.0, height));
        assert_eq!(loops(&closing), [1, 1], "{height}");
        assert_eq!(closing.seam_edges, 0, "{height}");
        let expected = volume(&cylinder(1.0, height, 64).mesh);
        assert!((volume(&full) - expected).abs() < 1e-9, "{height}");
    }
}

/// The wall between two polygons with equally many corners, counter-clockwise as seen from above, from low to high, in rows.
fn wall(low: &[DVec3], high: &[DVec3], rows: u32) -> TriMesh {
    let n = low.len() as u32;
    let place = |row: u32, i: usize| low[i].lerp(high[i], f64::from(row) / f64::from(rows));
    let positions = (0..=rows).flat_map(|row| (0..low.len()).map(move |i| (row, i)));
    let positions = positions.map(|(row, i)| place(row, i)).collect();
    let mut triangles = Vec::new();
    for row in 0..rows {
        for i in 0..n {
            let [a, b] = [i, (i + 1) % n].map(|i| row * n + i);
            triangles.extend([[a, b, b + n], [a, b + n, a + n]]);
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

/// A ring of places about the z axis.
fn ring(n: u32, z: f64, radius: impl Fn(u32) -> f64) -> Vec<DVec3> {
    let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
    (0..n)
        .map(|i| radius(i) * DVec3::new(angle(i).cos(), angle(i).sin(), z / radius(i)))
        .collect()
}

#[test]
fn walls_of_many_shapes_get_lids() {
    let square: Vec<DVec3> = (0..200)
        .map(|i| {
            let along = f64::from(i % 50) / 25.0 - 1.0;
            let corner =
                [[along, -1.0], [1.0, along], [-along, 1.0], [-1.0, -along]][i as usize / 50];
            DVec3::new(corner[0], corner[1], 0.0)
        })
        .collect();
    let raised: Vec<DVec3> = square.iter().map(|p| *p + 0.3 * DVec3::Z).collect();
    let gear = |i: u32| if i % 4 < 2 { 1.0 } else { 1.2 };
    let area = |polygon: &[DVec3]| -> f64 {
        let next = |i: usize| polygon[(i + 1) % polygon.len()];
        (0..polygon.len())
            .map(|i| 0.5 * polygon[i].cross(next(i)).z)
            .sum()
    };
    let prism = |low: Vec<DVec3>, high: Vec<DVec3>, rows: u32| {
        let [a, b] = [area(&low), area(&high)];
        let height = high[0].z - low[0].z;
        // the means of a frustum; both areas are the same for prisms
        (
            wall(&low, &high, rows),
            height * (a + b + (a * b).sqrt()) / 3.0,
        )
    };
    let flat =
        |polygon: Vec<DVec3>| -> Vec<DVec3> { polygon.iter().map(|p| p.with_z(0.0)).collect() };
    let cases = [
        prism(square, raised, 3),
        prism(flat(ring(80, 0.0, gear)), ring(80, 0.3, gear), 1),
        prism(flat(ring(80, 0.0, gear)), ring(80, 0.02, gear), 2),
        prism(flat(ring(40, 0.0, |_| 2.0)), ring(40, 0.5, |_| 1.5), 4),
        prism(flat(ring(300, 0.0, |_| 1.0)), ring(300, 0.2, |_| 1.0), 1),
    ];
    for (case, (open, expected)) in cases.into_iter().enumerate() {
        let (full, closing) = closed(&open);
        assert_eq!(loops(&closing), [1, 1], "{case}");
        let found = volume(&full);
        assert!(
            (found - expected).abs() < 1e-9,
            "{case}: {found} and not {expected}"
        );
    }
}

#[test]
fn a_zone_of_a_ball_gets_lids_and_a_ring_without_its_inner_wall_a_band() {
    let ball = icosphere(1.0, 4).mesh;
    let zone = without(&ball, |corners| corners.iter().any(|c| c.z.abs() > 0.35));
    let (full, closing) = closed(&zone);
    assert_eq!(loops(&closing), [1, 1]);
    assert!(volume(&full) > 1.5, "{}", volume(&full));

    // a washer of radii 2 and 3 that is 1 high
    let at = |radius: f64, z: f64| -> Vec<DVec3> {
        ring(48, 0.0, |_| radius)
            .iter()
            .map(|p| p.with_z(z))
            .collect()
    };
    let walls = |list: &[[(f64, f64); 2]]| {
        let parts = list
            .iter()
            .map(|&[(r0, z0), (r1, z1)]| wall(&at(r0, z0), &at(r1, z1), 1));
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for part in parts {
            let first = positions.len() as u32;
            positions.extend_from_slice(part.positions());
            triangles.extend(part.triangles().iter().map(|t| t.map(|v| v + first)));
        }
        TriMesh::new(positions, triangles).unwrap()
    };
    let [inside, outside, below, above] = [
        [(2.0, 1.0), (2.0, 0.0)],
        [(3.0, 0.0), (3.0, 1.0)],
        [(2.0, 0.0), (3.0, 0.0)],
        [(3.0, 1.0), (2.0, 1.0)],
    ];
    let expected = 24.0 * 5.0 * (std::f64::consts::TAU / 48.0).sin();
    for (open, bands) in [
        (walls(&[outside, below, above]), vec![2]),
        (walls(&[inside, below, above]), vec![2]),
        (walls(&[inside, outside]), vec![2, 2]),
    ] {
        for rule in [CloseRule::Auto, CloseRule::Band] {
            let (full, closing) = closed_by(&open, rule);
            assert_eq!(loops(&closing), bands, "{rule:?}");
            assert!(
                (volume(&full) - expected).abs() < 1e-9,
                "{rule:?} {}",
                volume(&full)
            );
        }
    }
    // flat ones, whose walls have less area than what is missing, and are not to be joined crosswise either
    let low = |height: f64| walls(&[[(2.0, height), (2.0, 0.0)], [(3.0, 0.0), (3.0, height)]]);
    for height in [0.5, 0.3, 0.02] {
        let (full, closing) = closed(&low(height));
        assert_eq!(loops(&closing), [2, 2], "{height}");
        assert!((volume(&full) - height * expected).abs() < 1e-9, "{height}");
    }
    let (_, lids) = closed_by(&walls(&[outside, below, above]), CloseRule::Lid);
    assert_eq!(loops(&lids), [1, 1]);
    // a band that is longer than wide is there for those who ask
    let long = |z: f64| {
        walls(&[
            [(2.0, 0.0), (3.0, 0.0)],
            [(3.0, 0.0), (3.0, z)],
            [(3.0, z), (2.0, z)],
        ])
    };
    assert_eq!(loops(&closed(&long(9.0)).1), [1, 1]);
    let (full, closing) = closed_by(&long(9.0), CloseRule::Band);
    assert_eq!(loops(&closing), [2]);
    assert!((volume(&full) - 9.0 * expected).abs() < 1e-9);
    // a tube has nothing that faces it but itself
    assert_eq!(
        loops(&closed_by(&tube(1.0, 0.5), CloseRule::Band).1),
        [1, 1]
    );
}

/// A sheet over a square grid with this height, facing up.
fn relief(n: u32, height: impl Fn(f64, f64) -> f64) -> TriMesh {
    let place = |k: u32| (f64::from(k % (n + 1)), f64::from(k / (n + 1)));
    let positions = (0..(n + 1) * (n + 1)).map(|k| {
        let (x, y) = place(k);
        DVec3::new(x, y, height(x, y))
    });
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..n {
            let a = i * (n + 1) + j;
            triangles.extend([[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
        }
    }
    TriMesh::new(positions.collect(), triangles).unwrap()
}

#[test]
fn a_sheet_folds_back_and_a_bowl_does_not() {
    let flat = relief(30, |_, _| 0.0);
    // with more corners than are triangulated at once
    let fine = relief(120, |_, _| 0.0);
    let terrain = relief(30, |x, y| 0.3 * (0.7 * x).sin() * (0.9 * y).cos());
    for (sheet, name) in [(flat, "flat"), (fine, "fine"), (terrain, "terrain")] {
        let (_, closing) = closed(&sheet);
        assert_eq!(closing.holes.len(), 1);
        assert!(closing.holes[0].folded, "{name}");
    }
    let bowl = without(&icosphere(1.0, 4).mesh, |corners| {
        corners.iter().any(|c| c.z > 0.3)
    });
    let cube = without(&cuboid(DVec3::ONE).mesh, |corners| {
        corners.iter().all(|c| c.z > 0.0)
    });
    for open in [bowl, cube, tube(1.0, 0.2)] {
        assert!(closed(&open).1.holes.iter().all(|hole| !hole.folded));
    }
}

#[test]
fn a_relief_is_put_on_a_base_below_its_lowest_point() {
    let height = |x: f64, y: f64| (0.7 * x).sin() * (0.9 * y).cos();
    let hole = |[a, b, c]: [DVec3; 3]| {
        [a, b, c]
            .iter()
            .all(|p| (4.0..=7.0).contains(&p.x) && (3.0..=6.0).contains(&p.y))
    };
    let whole = relief(20, height);
    for open in [without(&whole, hole), whole] {
        let (full, closing) = closed_by(&open, CloseRule::Base);
        let bounds = open.bounds();
        let level = bounds.min.z - 0.02 * bounds.diagonal();
        assert_eq!(full.bounds().min.z, level);
        let again = close(&full, CloseRule::Auto, &Progress::none()).unwrap();
        assert!(again.closed);
        // prisms down to the base
        let prisms = (0..open.triangles().len() as u32).map(|t| {
            let [a, b, c] = open.corners(t);
            0.5 * (b - a).cross(c - a).z * ((a.z + b.z + c.z) / 3.0 - level)
        });
        let expected: f64 = prisms.sum();
        assert!((volume(&full) - expected).abs() < 1e-9 * expected);
        assert!(!closing.added.is_empty());
    }
    assert!(
        close(&tube(1.0, 0.5), CloseRule::Base, &Progress::none())
            .unwrap()
            .is_no_relief
    );
}

/// The faces of the unit cube as panels of `n` × `n` squares, each with vertices of its own and moved outward by `gap`.
fn panels(n: [u32; 6], gap: f64) -> TriMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (face, n) in (0..).zip(n) {
        let axis = face / 2;
        let turned = |p: DVec3| DVec3::from_array(std::array::from_fn(|i| p[(i + 3 - axis) % 3]));
        let start = positions.len() as u32;
        let level = if face % 2 == 0 { -gap } else { 1.0 + gap };
        for i in 0..=n {
            for j in 0..=n {
                let share = |k: u32| f64::from(k) / f64::from(n);
                positions.push(turned(DVec3::new(level, share(i), share(j))));
            }
        }
        for i in 0..n {
            for j in 0..n {
                let [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]]
                    .map(|[i, j]| start + i * (n + 1) + j);
                if face % 2 == 0 {
                    triangles.extend([[a, c, b], [a, d, c]]);
                } else {
                    triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

#[test]
fn panels_that_nearly_meet_enclose_a_volume() {
    for n in [[3; 6], [1, 2, 3, 4, 5, 7], [1, 1, 16, 16, 8, 8]] {
        for gap in [0.0, 1e-8, 1e-5, 1e-3, 8e-3] {
            let open = panels(n, gap);
            let (full, closing) = closed(&open);
            // each panel takes a layer as thick as the gap with it, and the strips at most their square
            let expected = 1.0 + 6.0 * gap;
            let error = (volume(&full) - expected).abs();
            assert!(
                error <= 60.0 * gap * gap + 1e-12,
                "{n:?} {gap}: off by {error}"
            );
            let same = n.iter().all(|k| *k == n[0]);
            if gap == 0.0 && same {
                assert!(closing.closed);
            }
            // two panels are √2 gaps apart, but for the rounding of thirds and sevenths
            let width = closing.seam_width;
            assert!(width <= 1.5 * gap + 1e-15, "{n:?} {gap}: {width}");
        }
    }
}

#[test]
fn the_triangles_of_a_closing_have_the_boundary_that_is_missing_whatever_the_mesh() {
    // Moebius-like and other strange soups come from few vertices and random triangles
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let soups = (
        prop::collection::vec(prop::array::uniform3(0..4_i32), 3..12),
        prop::collection::vec(prop::array::uniform3(0..12_usize), 0..30),
        prop::sample::select(vec![0.0, 1e-6, 1e-3, 0.1]),
    );
    runner
        .run(&soups, |(places, triangles, jitter)| {
            let n = places.len();
            let positions = places.iter().enumerate().map(|(i, p)| {
                let p = DVec3::from_array(p.map(f64::from));
                p + jitter * DVec3::new((i as f64).sin(), (i as f64).cos(), (2.0 * i as f64).sin())
            });
            let triangles = triangles.iter().map(|t| t.map(|v| (v % n) as u32));
            let mesh = TriMesh::new(positions.collect(), triangles.collect()).unwrap();
            let (full, _) = closed(&mesh);
            let again = close(&full, CloseRule::Auto, &Progress::none()).unwrap();
            prop_assert!(again.closed && again.triangles.is_empty());
            Ok(())
        })
        .unwrap();
}

#[test]
fn the_result_does_not_depend_on_how_often_it_is_asked_for() {
    let open = panels([1, 2, 3, 4, 5, 7], 1e-3);
    let [a, b] = [0, 1].map(|_| {
        close(&open, CloseRule::Auto, &Progress::none())
            .unwrap()
            .triangles
    });
    assert_eq!(a, b);
}

#[test]
fn a_closing_stops_when_it_is_cancelled() {
    let open = panels([1, 2, 3, 4, 5, 7], 1e-3);
    for look in 1..40 {
        let progress = Progress::cancelled_at(look);
        assert!(
            close(&open, CloseRule::Auto, &progress).is_err(),
            "look {look}"
        );
    }
}
