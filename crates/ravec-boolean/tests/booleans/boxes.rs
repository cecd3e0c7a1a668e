//! All relative positions of two boxes on a grid, with all operators: volumes and members by counting unit cubes.

use crate::support::{
    assert_sound, cuboid, difference, intersection, run, symmetric_difference, union,
};
use glam::DVec3;
use ravec_boolean::Expr;

/// Cubes of the grid that are inside.
fn cubes(lo: [i32; 3], hi: [i32; 3]) -> Vec<bool> {
    let mut inside = Vec::new();
    for x in -1..5 {
        for y in -1..5 {
            for z in -1..5 {
                let at = [x, y, z];
                inside.push((0..3).all(|k| lo[k] <= at[k] && at[k] < hi[k]));
            }
        }
    }
    inside
}

/// The rule of an operator for members.
type Rule = fn(bool, bool) -> bool;

fn check(lo: [i32; 3], hi: [i32; 3]) {
    let place = |c: [i32; 3]| DVec3::from_array(c.map(f64::from));
    let meshes = [
        cuboid(place([0; 3]), place([3; 3])),
        cuboid(place(lo), place(hi)),
    ];
    let (a, b) = (cubes([0; 3], [3; 3]), cubes(lo, hi));
    let operators: [(Expr, Rule); 4] = [
        (union(), |a, b| a || b),
        (intersection(), |a, b| a && b),
        (difference(), |a, b| a && !b),
        (symmetric_difference(), |a, b| a != b),
    ];
    for (expr, operator) in operators {
        let result = run(&meshes, &expr);
        let inside: Vec<bool> = a.iter().zip(&b).map(|(&a, &b)| operator(a, b)).collect();
        let volume = inside.iter().filter(|&&x| x).count() as f64;
        assert!(
            (result.report.volume - volume).abs() < 1e-9,
            "{expr:?} of {lo:?} {hi:?}: {} for {volume}",
            result.report.volume
        );
        if volume > 0.0 {
            assert_sound(&result);
        } else {
            assert!(result.mesh.triangles().is_empty());
        }
    }
}

/// Along one axis a box may begin and end at or between the ends of the other, or beyond: all that counts.
const SPANS: [[i32; 2]; 10] = [
    [-1, 0],
    [-1, 1],
    [-1, 3],
    [-1, 4],
    [0, 2],
    [0, 3],
    [1, 2],
    [1, 3],
    [2, 4],
    [3, 4],
];

#[test]
fn every_position_of_two_boxes_gives_the_cubes_that_it_should() {
    // Up to exchanging axes, which the next test does for a few.
    for (i, x) in SPANS.iter().enumerate() {
        for (j, y) in SPANS.iter().enumerate().take(i + 1) {
            for z in SPANS.iter().take(j + 1) {
                check([x[0], y[0], z[0]], [x[1], y[1], z[1]]);
            }
        }
    }
}

#[test]
fn the_order_of_axes_does_not_matter() {
    for (lo, hi) in [
        ([3, 0, 1], [4, 3, 2]),
        ([0, 3, 1], [3, 4, 2]),
        ([1, 3, 0], [2, 4, 3]),
        ([3, 3, 0], [4, 4, 3]),
        ([0, 3, 3], [3, 4, 4]),
    ] {
        check(lo, hi);
    }
}
