//! Boxes with whole coordinates, small beside large and far away, against exact volumes.

use crate::support::{assert_sound, cuboid, difference, intersection, run, union};
use glam::DVec3;
use num_bigint::BigInt;
use num_traits::FromPrimitive as _;
use proptest::prelude::*;
use ravec_boolean::Expr;
use ravec_mesh::TriMesh;

/// Steps of a unit, a power of two: coordinates of results are whole multiples of them, also where diagonals of faces cross.
const STEPS_LOG2: i32 = 200;

/// Six times the volume of a mesh, in cubic steps. Corners of pieces in a face are rounded within its plane, and those on an
/// edge along it, which takes nothing from the volume.
fn six_volumes(mesh: &TriMesh) -> BigInt {
    let whole = |x: f64| {
        let steps = x * 2_f64.powi(STEPS_LOG2);
        assert_eq!(steps, steps.round());
        BigInt::from_f64(steps).unwrap()
    };
    let triangles = (0..mesh.triangles().len() as u32).map(|t| {
        let [a, b, c] = mesh.corners(t).map(|p| p.to_array().map(whole));
        let minor = |i: usize, j: usize| &b[i] * &c[j] - &b[j] * &c[i];
        &a[0] * minor(1, 2) + &a[1] * minor(2, 0) + &a[2] * minor(0, 1)
    });
    triangles.sum()
}

/// Corners of a box.
type Span = [[i64; 3]; 2];

/// Volume of the places where a rule holds, cell by cell between all the planes of the faces.
fn volume(boxes: &[Span], rule: impl Fn(&dyn Fn(usize) -> bool) -> bool) -> BigInt {
    let planes: [Vec<i64>; 3] = std::array::from_fn(|k| {
        let mut planes: Vec<i64> = boxes.iter().flat_map(|b| [b[0][k], b[1][k]]).collect();
        planes.sort_unstable();
        planes.dedup();
        planes
    });
    let mut sum = BigInt::from(0);
    for x in planes[0].windows(2) {
        for y in planes[1].windows(2) {
            for z in planes[2].windows(2) {
                let low = [x[0], y[0], z[0]];
                let holds =
                    |b: usize| (0..3).all(|k| boxes[b][0][k] <= low[k] && low[k] < boxes[b][1][k]);
                if rule(&holds) {
                    let size = [x, y, z].map(|s| BigInt::from(s[1] - s[0]));
                    sum += size.iter().product::<BigInt>();
                }
            }
        }
    }
    sum
}

fn mesh([lo, hi]: Span) -> TriMesh {
    let place = |c: [i64; 3]| DVec3::from_array(c.map(|x| x as f64));
    cuboid(place(lo), place(hi))
}

fn check(boxes: &[Span], expr: &Expr) {
    let meshes: Vec<TriMesh> = boxes.iter().map(|&b| mesh(b)).collect();
    let result = run(&meshes, expr);
    let expected = volume(boxes, |holds| expr.eval(&|m| holds(m)));
    assert_eq!(
        six_volumes(&result.mesh),
        (&expected * 6) << (3 * STEPS_LOG2),
        "{expr:?} of {boxes:?}"
    );
    if expected > BigInt::from(0) {
        assert_sound(&result);
    }
}

#[test]
fn a_small_body_far_away_or_beside_a_large_one_does_not_vanish() {
    for exponent in [0, 10, 28, 29, 30, 31, 40, 50] {
        let far = 1_i64 << exponent;
        let unit = [[far; 3], [far + 1; 3]];
        let big = [[-far; 3], [-far / 2; 3]];
        let inside = [[-far / 4 * 3; 3], [-far / 4 * 3 + 1; 3]];
        for expr in [union(), intersection(), difference()] {
            check(&[unit, unit], &expr);
            check(&[big, unit], &expr);
            if exponent > 4 {
                check(&[big, inside], &expr);
            }
        }
    }
}

prop_compose! {
    /// A box with sides of any order of magnitude at a place of any.
    fn any_box()(
        place in prop::array::uniform3((0_u32..51, -4_i64..5)),
        size in prop::array::uniform3((0_u32..50, 1_i64..4)),
    ) -> Span {
        let lo = place.map(|(exponent, by)| (by << exponent) / 4);
        [lo, std::array::from_fn(|k| lo[k] + (size[k].1 << size[k].0).min(1 << 50))]
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn whole_boxes_of_any_size_anywhere_have_exact_volumes(
        boxes in prop::collection::vec(any_box(), 2..5),
        operator in 0..4,
    ) {
        let terms = (0..boxes.len()).map(Expr::Mesh).collect();
        let expr = match operator {
            0 => Expr::Union(terms),
            1 => Expr::Intersection(terms),
            2 => Expr::Difference(terms),
            _ => Expr::SymmetricDifference(terms),
        };
        check(&boxes, &expr);
    }

    #[test]
    fn boxes_with_a_common_corner_and_sizes_apart_have_exact_volumes(
        exponents in prop::collection::vec(0_u32..51, 2..4),
        signs in prop::collection::vec(prop::array::uniform3(prop::bool::ANY), 3),
        by in prop::array::uniform3(-2_i64..3),
    ) {
        let boxes: Vec<Span> = exponents.iter().zip(&signs).map(|(&exponent, signs)| {
            let size = 1_i64 << exponent;
            let lo: [i64; 3] = std::array::from_fn(|k| by[k] - if signs[k] { size } else { 0 });
            [lo, lo.map(|x| x + size)]
        }).collect();
        let terms: Vec<Expr> = (0..boxes.len()).map(Expr::Mesh).collect();
        for expr in [Expr::Union(terms.clone()), Expr::Difference(terms.clone()), Expr::SymmetricDifference(terms)] {
            check(&boxes, &expr);
        }
    }
}
