//! Laws of set algebra and membership, on curved solids in general and in special position.

use crate::support::{
    assert_members, assert_sound, cuboid, difference, intersection, run, symmetric_difference,
    union,
};
use glam::{DMat3, DVec3};
use proptest::prelude::*;
use ravec_boolean::{BooleanError, BooleanParams, Expr, Inside, boolean};
use ravec_mesh::{TriMesh, measure};
use ravec_progress::Progress;
use ravec_scenes::solids::{cone, cylinder, icosphere, torus};

fn moved(mesh: &TriMesh, turn: DMat3, shift: DVec3) -> TriMesh {
    let positions = mesh.positions().iter().map(|&p| turn * p + shift).collect();
    TriMesh::new(positions, mesh.triangles().to_vec()).unwrap()
}

fn solid(kind: usize) -> TriMesh {
    match kind {
        0 => icosphere(1.0, 2).mesh,
        1 => torus(0.9, 0.35, 24, 12).mesh,
        2 => cylinder(0.6, 1.7, 17).mesh,
        3 => cone(0.8, 1.5, 13).mesh,
        _ => cuboid(DVec3::splat(-0.6), DVec3::splat(0.7)),
    }
}

fn turn(angles: [f64; 3]) -> DMat3 {
    DMat3::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2])
}

prop_compose! {
    fn placed()(kind in 0_usize..5, angles in [0.0..6.3, 0.0..6.3, 0.0..6.3], shift in [-0.7..0.7, -0.7..0.7, -0.7..0.7]) -> TriMesh {
        moved(&solid(kind), turn(angles), DVec3::from_array(shift))
    }
}

/// Points all over a cube around the solids, off any plane that matters.
fn places() -> Vec<DVec3> {
    let step = |i: u64, by: f64| ((i as f64 * by).fract() - 0.5) * 4.1;
    (1..300)
        .map(|i| DVec3::new(step(i, 0.754_877), step(i, 0.569_840), step(i, 0.362_511)))
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn pairs_obey_the_laws(a in placed(), b in placed()) {
        let (va, vb) = (measure(&a).volume, measure(&b).volume);
        let meshes = [a, b];
        let exprs = [union(), intersection(), difference(), symmetric_difference()];
        let results = exprs.each_ref().map(|expr| run(&meshes, expr));
        let places = places();
        for (expr, result) in exprs.iter().zip(&results) {
            assert_sound(result);
            assert_members(&meshes, expr, result, &places);
            for (triangle, origin) in result.mesh.triangles().iter().zip(&result.origins) {
                let source = &meshes[origin.mesh as usize];
                let mut before = source.corners(origin.triangle.unwrap());
                let mut now = triangle.map(|v| result.mesh.positions()[v as usize]);
                let normal = |c: [DVec3; 3]| (c[1] - c[0]).cross(c[2] - c[0]).normalize_or_zero();
                if origin.whole {
                    let order = |p: &DVec3, q: &DVec3| p.to_array().partial_cmp(&q.to_array()).unwrap();
                    before.sort_by(order);
                    now.sort_by(order);
                    prop_assert_eq!(before, now);
                } else {
                    // rounded corners stay within a few ulps of the plane
                    let n = normal(before);
                    for p in now {
                        prop_assert!(n.dot(p - before[0]).abs() < 1e-14);
                    }
                }
            }
        }
        let [u, i, d, s] = results.map(|r| r.report.volume);
        // a few roundings of coordinates around 1 on areas around 10
        prop_assert!((va + vb - u - i).abs() < 1e-13);
        prop_assert!((va - i - d).abs() < 1e-13);
        prop_assert!((u - i - s).abs() < 1e-13);
    }

    #[test]
    fn the_order_of_meshes_and_nesting_do_not_matter(a in placed(), b in placed(), c in placed()) {
        let meshes = [a, b, c];
        let m = Expr::Mesh;
        let same: [[Expr; 2]; 4] = [
            // a - (b | c) = (a - b) & (a - c)
            [
                Expr::Difference(vec![m(0), Expr::Union(vec![m(1), m(2)])]),
                Expr::Intersection(vec![
                    Expr::Difference(vec![m(0), m(1)]),
                    Expr::Difference(vec![m(0), m(2)]),
                ]),
            ],
            // a | b | c = c | (b | a)
            [
                Expr::Union(vec![m(0), m(1), m(2)]),
                Expr::Union(vec![m(2), Expr::Union(vec![m(1), m(0)])]),
            ],
            // a & (a | b) = a & a
            [
                Expr::Intersection(vec![m(0), Expr::Union(vec![m(0), m(1)])]),
                Expr::Intersection(vec![m(0), m(0)]),
            ],
            // (a ^ b) ^ c = a ^ (b ^ c)
            [
                Expr::SymmetricDifference(vec![Expr::SymmetricDifference(vec![m(0), m(1)]), m(2)]),
                Expr::SymmetricDifference(vec![m(0), Expr::SymmetricDifference(vec![m(1), m(2)])]),
            ],
        ];
        for [one, other] in same {
            let (one, other) = (run(&meshes, &one), run(&meshes, &other));
            assert_sound(&one);
            prop_assert!((one.report.volume - other.report.volume).abs() < 1e-13);
        }
    }
}

#[test]
fn a_solid_with_itself_is_itself() {
    let ball = icosphere(1.0, 2).mesh;
    let meshes = [ball.clone(), ball.clone()];
    for expr in [union(), intersection()] {
        let result = run(&meshes, &expr);
        assert_sound(&result);
        assert_eq!(result.mesh.triangles().len(), ball.triangles().len());
        assert_eq!(result.report.kept_triangles, ball.triangles().len() as u64);
    }
    for expr in [difference(), symmetric_difference()] {
        assert!(run(&meshes, &expr).mesh.triangles().is_empty());
    }
}

#[test]
fn solids_that_touch_come_out_apart() {
    let edge = [
        cuboid(DVec3::ZERO, DVec3::ONE),
        cuboid(DVec3::new(1.0, 1.0, 0.0), DVec3::new(2.0, 2.0, 1.0)),
    ];
    let corner = [
        cuboid(DVec3::ZERO, DVec3::ONE),
        cuboid(DVec3::ONE, DVec3::splat(2.0)),
    ];
    for meshes in [edge, corner] {
        let result = run(&meshes, &union());
        assert_sound(&result);
        assert_eq!(result.mesh.positions().len(), 16);
        assert_eq!(result.report.volume, 2.0);
    }
}

#[test]
fn a_mesh_that_overlaps_itself_loses_its_inner_walls() {
    let (a, b) = (
        cuboid(DVec3::ZERO, DVec3::splat(2.0)),
        cuboid(DVec3::ONE, DVec3::splat(3.0)),
    );
    let mut positions = a.positions().to_vec();
    positions.extend(b.positions());
    let mut triangles = a.triangles().to_vec();
    triangles.extend(b.triangles().iter().map(|t| t.map(|v| v + 8)));
    let both = TriMesh::new(positions, triangles).unwrap();
    let result = run(&[both], &Expr::Mesh(0));
    assert_sound(&result);
    // the sum over triangles is rounded
    assert!((result.report.volume - 15.0).abs() < 1e-13);
    assert!(result.report.operands[0].self_intersections > 0);
}

#[test]
fn what_is_inside_can_be_chosen() {
    // a box with a box inside out in it, another inside out beside it, and one that is half in it
    let parts = [
        (cuboid(DVec3::ZERO, DVec3::splat(3.0)), false),
        (cuboid(DVec3::ONE, DVec3::splat(2.0)), true),
        (cuboid(DVec3::splat(4.0), DVec3::splat(5.0)), true),
        (
            cuboid(DVec3::new(2.5, 0.25, 0.25), DVec3::new(5.0, 0.75, 0.75)),
            true,
        ),
    ];
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (part, inside_out) in parts {
        let first = positions.len() as u32;
        positions.extend(part.positions());
        triangles.extend(part.triangles().iter().map(|&[a, b, c]| {
            let t = if inside_out { [a, c, b] } else { [a, b, c] };
            t.map(|v| v + first)
        }));
    }
    let meshes = [TriMesh::new(positions, triangles).unwrap()];
    for (inside, volume) in [
        (Inside::Positive, 26.875),
        (Inside::Nonzero, 27.375),
        (Inside::OuterHull, 28.5),
    ] {
        let params = BooleanParams {
            inside,
            ..BooleanParams::default()
        };
        let result = boolean(&meshes, &Expr::Mesh(0), &params, &Progress::none()).unwrap();
        assert_sound(&result);
        assert_eq!(result.report.volume, volume, "{inside:?}");
        assert_eq!(result.report.passed(), inside != Inside::Positive);
    }
}

#[test]
fn far_away_tiny_and_huge_solids_are_no_harder() {
    for (scale, shift) in [(1.0, 1e6), (1e-12, 0.0), (1e9, 0.0), (1e-3, 1e3)] {
        let turned = turn([0.3, 0.5, 0.7]) * scale;
        let meshes = [
            moved(&solid(1), DMat3::IDENTITY * scale, DVec3::splat(shift)),
            moved(&solid(2), turned, DVec3::splat(shift)),
        ];
        let results = [union(), intersection()].map(|expr| run(&meshes, &expr));
        for result in &results {
            assert_sound(result);
        }
        let sum: f64 = meshes.iter().map(|m| measure(m).volume).sum();
        let [u, i] = results.map(|r| r.report.volume);
        // corners are a coordinate's ulp off, over surfaces of some square units
        let tolerance = 100.0 * f64::EPSILON * (shift + scale) * scale * scale;
        assert!(
            (sum - u - i).abs() < tolerance,
            "{scale} {shift}: {}",
            sum - u - i
        );
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let meshes = [
        solid(0),
        moved(&solid(1), turn([0.2, 0.4, 0.1]), DVec3::splat(0.3)),
        moved(&solid(4), turn([0.1, 0.2, 0.3]), DVec3::splat(-0.2)),
    ];
    let expr = Expr::Difference(vec![
        Expr::Union(vec![Expr::Mesh(0), Expr::Mesh(1)]),
        Expr::Mesh(2),
    ]);
    let in_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| run(&meshes, &expr))
    };
    let (one, four) = (in_threads(1), in_threads(4));
    assert_eq!(one.mesh, four.mesh);
    assert_eq!(one.origins, four.origins);
    assert_eq!(one.feature_edges, four.feature_edges);
}

#[test]
fn the_cut_is_marked() {
    // a drill through a plate: two rims
    let meshes = [
        cuboid(DVec3::new(-2.0, -2.0, -0.5), DVec3::new(2.0, 2.0, 0.5)),
        cylinder(0.6, 4.0, 12).mesh,
    ];
    let result = run(&meshes, &difference());
    assert_sound(&result);
    let edges = &result.feature_edges;
    assert!(edges.len() >= 24);
    for &[a, b] in edges {
        for v in [a, b] {
            assert_eq!(result.mesh.positions()[v as usize].z.abs(), 0.5);
        }
    }
    let uses = |v: u32| edges.iter().filter(|e| e.contains(&v)).count();
    assert!(edges.iter().flatten().all(|&v| uses(v) == 2));
}

#[test]
fn what_cannot_be_done_is_said() {
    let meshes = [cuboid(DVec3::ZERO, DVec3::ONE)];
    let run = |meshes: &[TriMesh], expr: &Expr, params: &BooleanParams, progress: &Progress| {
        boolean(meshes, expr, params, progress).map(|r| r.report.triangles)
    };
    let (params, progress) = (BooleanParams::default(), Progress::none());
    let unknown = run(&meshes, &Expr::Mesh(3), &params, &progress);
    assert_eq!(
        unknown,
        Err(BooleanError::NoSuchMesh { mesh: 3, meshes: 1 })
    );
    let huge = [cuboid(DVec3::ZERO, DVec3::splat(1e40))];
    let refused = run(&huge, &Expr::Mesh(0), &params, &progress);
    assert_eq!(
        refused,
        Err(BooleanError::OutOfRange {
            mesh: 0,
            largest: 1e40
        })
    );
    let tiny = [cuboid(DVec3::ZERO, DVec3::splat(1e-100))];
    let refused = run(&tiny, &Expr::Mesh(0), &params, &progress);
    assert!(matches!(
        refused,
        Err(BooleanError::OutOfRange { mesh: 0, .. })
    ));
    let little = BooleanParams {
        memory_bytes: Some(100),
        ..params.clone()
    };
    let refused = run(&meshes, &Expr::Mesh(0), &little, &progress);
    assert!(matches!(
        refused,
        Err(BooleanError::OutOfMemory { allowed: 100, .. })
    ));
    // two cubes take what their triangles take only if these do not meet
    let pair = |second: f64| {
        [
            cuboid(DVec3::ZERO, DVec3::ONE),
            cuboid(DVec3::splat(second), DVec3::splat(second + 1.0)),
        ]
    };
    let little = BooleanParams {
        memory_bytes: Some(24 * 250),
        ..params.clone()
    };
    let both = Expr::Union(vec![Expr::Mesh(0), Expr::Mesh(1)]);
    assert_eq!(run(&pair(2.0), &both, &little, &progress), Ok(24));
    assert!(matches!(
        run(&pair(0.5), &both, &little, &progress),
        Err(BooleanError::OutOfMemory { allowed: 6000, .. })
    ));
    assert_eq!(
        run(&[TriMesh::default()], &Expr::Mesh(0), &params, &progress),
        Ok(0)
    );
    progress.cancel();
    let stopped = run(&meshes, &Expr::Mesh(0), &params, &progress);
    assert_eq!(stopped, Err(BooleanError::Cancelled));
}

#[test]
fn coordinates_may_be_huge_multiples_tiny_or_mixed() {
    // faces in a common plane at zero, on a grid whose step is far above one; the same tiny; and with a speck of a coordinate
    for (scale, speck) in [
        (2_f64.powi(80), 0.0),
        (2_f64.powi(-150), 0.0),
        (1.0, 1e-200),
    ] {
        let at = |p: [f64; 3]| DVec3::from_array(p) * scale + DVec3::new(0.0, speck, 0.0);
        let meshes = [
            cuboid(at([0.0, 0.0, 0.0]), at([2.0, 2.0, 2.0])),
            cuboid(at([1.0, 1.0, 0.0]), at([3.0, 3.0, 2.0])),
        ];
        let [u, i] = [union(), intersection()].map(|expr| {
            let result = run(&meshes, &expr);
            assert_sound(&result);
            result.report.volume / scale / scale / scale
        });
        assert!(
            (u - 14.0).abs() < 1e-12 && (i - 2.0).abs() < 1e-12,
            "{scale}: {u} {i}"
        );
    }
}
