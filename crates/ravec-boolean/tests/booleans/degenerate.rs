//! Solids on a small grid, turned so that nothing is along an axis: corners on faces, edges in edges, faces in faces.

use crate::support::{assert_members, assert_sound, cuboid, run};
use glam::{DQuat, DVec3};
use proptest::prelude::*;
use ravec_boolean::{BooleanParams, Expr, Inside, OpenRule, boolean};
use ravec_mesh::{TriMesh, measure};
use ravec_progress::Progress;
use ravec_scenes::solids::{cylinder, icosphere};

/// A rotation by a Pythagorean angle about one axis and then another, times 25: whole numbers stay whole.
fn turned(p: DVec3) -> DVec3 {
    let q = DVec3::new(3.0 * p.x - 4.0 * p.y, 4.0 * p.x + 3.0 * p.y, 5.0 * p.z);
    DVec3::new(5.0 * q.x, 3.0 * q.y - 4.0 * q.z, 4.0 * q.y + 3.0 * q.z)
}

/// The scale of [`turned`].
const TURNED: f64 = 25.0;

prop_compose! {
    fn small_box()(lo in [0_i32..4, 0_i32..4, 0_i32..4], size in [1_i32..4, 1_i32..4, 1_i32..4]) -> ([i32; 3], [i32; 3]) {
        (lo, std::array::from_fn(|k| lo[k] + size[k]))
    }
}

/// Expressions over four meshes.
fn expr() -> impl Strategy<Value = Expr> {
    let leaf = (0_usize..4).prop_map(Expr::Mesh);
    leaf.prop_recursive(3, 10, 4, |inner| {
        let terms = prop::collection::vec(inner, 2..5);
        (terms, 0..4).prop_map(|(terms, operator)| match operator {
            0 => Expr::Union(terms),
            1 => Expr::Intersection(terms),
            2 => Expr::Difference(terms),
            _ => Expr::SymmetricDifference(terms),
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]
    #[test]
    fn expressions_of_boxes_give_the_cubes_that_they_should(
        boxes in prop::array::uniform4(small_box()),
        expr in expr(),
    ) {
        let place = |c: [i32; 3]| DVec3::from_array(c.map(f64::from));
        let meshes = boxes.map(|(lo, hi)| {
            let straight = cuboid(place(lo), place(hi));
            let positions = straight.positions().iter().map(|&p| turned(p)).collect();
            TriMesh::new(positions, straight.triangles().to_vec()).unwrap()
        });
        let mut volume = 0;
        for x in 0..8 {
            for y in 0..8 {
                for z in 0..8 {
                    let inside = |m: usize| {
                        let (lo, hi) = boxes[m];
                        (0..3).all(|k| lo[k] <= [x, y, z][k] && [x, y, z][k] < hi[k])
                    };
                    volume += i32::from(expr.eval(&inside));
                }
            }
        }
        let result = run(&meshes, &expr);
        let volume = f64::from(volume) * TURNED.powi(3);
        // all corners of such results are whole, so that nothing is rounded
        prop_assert!((result.report.volume - volume).abs() < 1e-6, "{} for {}", result.report.volume, volume);
        if volume > 0.0 {
            assert_sound(&result);
        } else {
            prop_assert!(result.mesh.triangles().is_empty());
        }
    }

    #[test]
    fn tetrahedra_on_a_small_grid_are_united_soundly(
        corners in prop::collection::vec(prop::array::uniform4([0_i32..4, 0_i32..4, 0_i32..4]), 2..7),
        expr in expr(),
    ) {
        // as four meshes, some of them of several tetrahedra that may overlap
        let mut parts: [(Vec<DVec3>, Vec<[u32; 3]>); 4] = Default::default();
        for (i, tetrahedron) in corners.iter().enumerate() {
            let [a, b, c, d] = tetrahedron.map(|p| DVec3::from_array(p.map(f64::from)));
            let (positions, triangles) = &mut parts[i % 4];
            let v = positions.len() as u32;
            let (b, c) = if (b - a).cross(c - a).dot(d - a) > 0.0 { (c, b) } else { (b, c) };
            positions.extend([a, b, c, d]);
            triangles.extend([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]].map(|t| t.map(|k| k + v)));
        }
        let meshes = parts.map(|(positions, triangles)| TriMesh::new(positions, triangles).unwrap());
        let result = run(&meshes, &expr);
        if !result.mesh.triangles().is_empty() {
            assert_sound(&result);
        }
        // off all planes through grid points with small coefficients
        let step = |i: u64, by: f64| (i as f64 * by).fract() * 3.2 - 0.1;
        let places: Vec<DVec3> = (1..120)
            .map(|i| DVec3::new(step(i, 0.754_877), step(i, 0.569_840), step(i, 0.362_511)))
            .collect();
        assert_members(&meshes, &expr, &result, &places);
    }

    #[test]
    fn any_triangles_give_a_sound_result(
        places in prop::collection::vec(
            prop_oneof![
                4 => [0_i32..4, 0_i32..4, 0_i32..4].prop_map(|p| DVec3::from_array(p.map(f64::from))),
                1 => [0.0..3.0, 0.0..3.0, 0.0..3.0].prop_map(DVec3::from_array),
            ],
            4..14,
        ),
        triangles in prop::collection::vec([any::<prop::sample::Index>(), any::<prop::sample::Index>(), any::<prop::sample::Index>()], 1..24),
        expr in expr(),
    ) {
        let meshes: [TriMesh; 4] = std::array::from_fn(|m| {
            let own = triangles.iter().skip(m).step_by(4);
            let corners = own.map(|t| t.map(|i| i.index(places.len()) as u32));
            TriMesh::new(places.clone(), corners.collect()).unwrap()
        });
        for inside in [Inside::Positive, Inside::OuterHull] {
            let params = BooleanParams { inside, open: OpenRule::Close, ..BooleanParams::default() };
            let result = boolean(&meshes, &expr, &params, &Progress::none()).unwrap();
            if !result.mesh.triangles().is_empty() {
                assert_sound(&result);
            }
        }
        // open sheets that are trimmed have no more area than all of them
        let result = run(&meshes, &expr);
        let area: f64 = meshes.iter().map(|mesh| measure(mesh).area).sum();
        if result.report.trimmed {
            prop_assert!(result.report.area <= area * (1.0 + 1e-12));
        } else if !result.mesh.triangles().is_empty() {
            assert_sound(&result);
        }
    }

    /// Faces that are a few ulps off each other, and slightly turned: cuts run along slivers that doubles cannot hold.
    #[test]
    fn boxes_a_few_ulps_apart_are_repaired_where_rounding_makes_them_cross(
        shifts in prop::collection::vec(prop::array::uniform8([-3_i32..4, -3_i32..4, -3_i32..4]), 2..5),
        expr in expr(),
    ) {
        let straight = cuboid(DVec3::splat(1.0), DVec3::splat(2.0));
        let meshes: [TriMesh; 4] = std::array::from_fn(|m| {
            let shifts = &shifts[m % shifts.len()];
            let positions = straight.positions().iter().zip(shifts).map(|(&p, by)| {
                p + DVec3::from_array(by.map(f64::from)) * f64::EPSILON
            });
            TriMesh::new(positions.collect(), straight.triangles().to_vec()).unwrap()
        });
        let result = run(&meshes, &expr);
        if !result.mesh.triangles().is_empty() {
            assert_sound(&result);
        }
    }

    /// Copies that were turned there and back, as programs leave them: every triangle nearly lies on another.
    #[test]
    fn copies_a_few_ulps_apart_are_united_soundly(
        turns in prop::collection::vec(([-1.0..1.0, -1.0..1.0, -1.0..1.0], -16_i32..-11), 2..4),
        slide in prop_oneof![Just(0.0), 0.0..0.6],
        is_round in any::<bool>(),
        base in [-3.0..3.0, -3.0..3.0, -3.0..3.0],
        expr in expr(),
    ) {
        let base = DQuat::from_scaled_axis(DVec3::from_array(base));
        let whole = if is_round { icosphere(1.0, 2) } else { cylinder(1.0, 1.0, 24) }.mesh;
        let meshes: [TriMesh; 4] = std::array::from_fn(|m| {
            let (axis, exponent) = turns[m % turns.len()];
            let turn = DQuat::from_scaled_axis(DVec3::from_array(axis) * 10_f64.powi(exponent));
            let by = DVec3::new(slide, 0.5 * slide, 0.0) * (m % turns.len()) as f64;
            let positions = whole.positions().iter().map(|&p| base * (turn * (p + by)));
            TriMesh::new(positions.collect(), whole.triangles().to_vec()).unwrap()
        });
        let result = run(&meshes, &expr);
        if !result.mesh.triangles().is_empty() {
            assert_sound(&result);
        }
        prop_assert!(result.report.moved < 1e-7, "{}", result.report.moved);
    }
}
