//! Keyframes whose maps are known, tied with noise of known covariance.

use super::*;
use glam::{DMat3, dvec2};
use ravec_scenes::Seed;

const CORNERS: [DVec2; 4] = [
    dvec2(0.0, 0.0),
    dvec2(640.0, 0.0),
    dvec2(640.0, 480.0),
    dvec2(0.0, 480.0),
];

/// A camera on its way around; the last keyframe is near the first.
fn truth() -> Vec<Homography> {
    let view = |(x, y, turn, zoom, tilt): (f64, f64, f64, f64, f64)| {
        let mut slant = DMat3::IDENTITY;
        slant.x_axis.z = tilt;
        slant.y_axis.z = -0.5 * tilt;
        let placed = DMat3::from_scale_angle_translation(DVec2::splat(zoom), turn, dvec2(x, y));
        Homography::from_matrix(placed * slant).unwrap()
    };
    vec![
        Homography::IDENTITY,
        view((-250.0, 20.0, 0.1, 1.1, 1e-4)),
        view((-420.0, -180.0, 0.2, 1.3, 2e-4)),
        view((-200.0, -330.0, 0.05, 1.2, -1e-4)),
        view((40.0, -150.0, -0.1, 0.9, -2e-4)),
    ]
}

const PAIRS: [(usize, usize); 7] = [(0, 1), (1, 2), (2, 3), (4, 3), (0, 4), (3, 1), (0, 3)];

fn covariance(seed: Seed, index: usize) -> Matrix {
    let root = Matrix::from_fn(|i, j| seed.gaussian(i as i64, j as i64, index as u64));
    (root * root.transpose() * 0.2 + Matrix::identity()) * 0.01
}

/// Ties of the pairs, with noise drawn by their covariances.
fn ties(maps: &[Homography], seed: Seed, noise: f64) -> Vec<Tie> {
    let one = |(index, &(from, to)): (usize, &(usize, usize))| {
        let points = [
            dvec2(120.0, 80.0),
            dvec2(560.0, 100.0),
            dvec2(520.0, 400.0),
            dvec2(100.0, 380.0),
        ];
        let covariance = covariance(Seed(1), index);
        let factor = covariance.cholesky().unwrap().l();
        let draw = factor * Vector::from_fn(|k, _| seed.gaussian(k as i64, index as i64, 5));
        let map = maps[to] * maps[from].inverse();
        let images = vector_of(&points.map(|p| map.apply(p))) + draw * noise;
        Tie {
            from,
            to,
            to_from: Homography::from_pairs(&points, &points_of(&images)).unwrap(),
            points,
            covariance: covariance_of(&covariance),
        }
    };
    PAIRS.iter().enumerate().map(one).collect()
}

/// Starts some pixels off.
fn starts(maps: &[Homography]) -> Vec<Homography> {
    let off = |(index, &map): (usize, &Homography)| {
        let shift = dvec2(3.0, -2.0) * index as f64;
        Homography::from_translation(shift).unwrap() * map
    };
    maps.iter().enumerate().map(off).collect()
}

/// Displacement of the images of the reference's corners in a keyframe.
fn error(found: &Homography, truth: &Homography) -> Vector {
    vector_of(&CORNERS.map(|p| found.apply(p))) - vector_of(&CORNERS.map(|p| truth.apply(p)))
}

#[test]
fn derivatives_agree_with_finite_differences() {
    let maps = truth();
    let basis = Basis::new(&CORNERS).unwrap();
    let ties = ties(&maps, Seed(2), 30.0);
    for tie in &ties {
        let tie = Whitened::new(tie, maps.len()).unwrap();
        let derivatives = tie.derivatives(&basis, &maps);
        for (keyframe, analytic) in [tie.tie.from, tie.tie.to].into_iter().zip(derivatives) {
            for k in 0..8 {
                let at = |amount: f64| {
                    let mut step = Vector::zeros();
                    step[k] = amount;
                    let mut moved = maps.clone();
                    moved[keyframe] = basis.displaced(&step).unwrap() * moved[keyframe];
                    tie.residual(&moved).unwrap()
                };
                let slope = (at(1e-3) - at(-1e-3)) / 2e-3;
                let column = analytic.column(k);
                assert!(
                    (slope - column).norm() < 1e-5 * (1.0 + column.norm()),
                    "{k}"
                );
            }
        }
    }
}

#[test]
fn exact_ties_give_the_exact_maps_and_loops_close() {
    let maps = truth();
    let found = tie_keyframes(&starts(&maps), &CORNERS, &ties(&maps, Seed(1), 0.0)).unwrap();
    assert_eq!(found.keyframe_from_reference[0], Homography::IDENTITY);
    for (a, b) in found.keyframe_from_reference.iter().zip(&maps) {
        assert!(error(a, b).amax() < 1e-5, "{}", error(a, b).amax());
    }
    assert!(found.chi_square < 1e-9 && found.weights.iter().all(|&w| w == 1.0));
    assert_eq!(found.degrees_of_freedom, 8 * 7 - 8 * 4);
}

#[test]
fn covariances_are_those_of_the_errors() {
    let maps = truth();
    let (mut squares, mut fit, mut draws) = ([0.0; 5], 0.0, 0.0);
    for trial in 0..250 {
        let ties = ties(&maps, Seed(1000 + trial), 1.0);
        let found = tie_keyframes(&starts(&maps), &CORNERS, &ties).unwrap();
        fit += found.chi_square;
        draws += 1.0;
        for k in 1..5 {
            let off = error(&found.keyframe_from_reference[k], &maps[k]);
            let covariance = matrix_of(&found.covariance(k, &CORNERS).unwrap());
            squares[k] += off.dot(&(covariance.try_inverse().unwrap() * off));
        }
    }
    // the mean of 250 draws of χ² with 8 degrees has the deviation √(16 / 250) = 0.25; ties beyond the quantile, one in 100,
    // weigh less than they should
    for square in &squares[1..] {
        assert!((square / draws - 8.0).abs() < 1.0, "{}", square / draws);
    }
    assert!((fit / draws - 24.0).abs() < 1.5, "{}", fit / draws);
}

#[test]
fn more_ties_make_keyframes_more_certain_than_a_chain_does() {
    let maps = truth();
    let all = ties(&maps, Seed(4), 1.0);
    let chain = [0, 1, 2, 3].map(|k| all[k].clone());
    let sigma = |ties: &[Tie]| {
        let found = tie_keyframes(&maps, &CORNERS, ties).unwrap();
        matrix_of(&found.covariance(4, &CORNERS).unwrap()).trace()
    };
    assert!(sigma(&all) < 0.5 * sigma(&chain));
    // a chain is reproduced as it was measured
    let found = tie_keyframes(&starts(&maps), &CORNERS, &chain).unwrap();
    assert!(found.chi_square < 1e-9);
}

#[test]
fn a_wrong_tie_is_left_out() {
    let maps = truth();
    let mut wrong = ties(&maps, Seed(6), 1.0);
    let right = tie_keyframes(&maps, &CORNERS, &wrong).unwrap();
    // a window farther
    let shift = Homography::from_translation(dvec2(40.0, 0.0)).unwrap();
    wrong[6].to_from = shift * wrong[6].to_from;
    let found = tie_keyframes(&starts(&maps), &CORNERS, &wrong).unwrap();
    assert!(found.weights[6] < 0.01, "{:?}", found.weights);
    assert!(found.weights[..6].iter().all(|&w| w > 0.5));
    for k in 1..5 {
        let moved = error(
            &found.keyframe_from_reference[k],
            &right.keyframe_from_reference[k],
        );
        assert!(moved.amax() < 0.5, "{k}: {}", moved.amax());
    }
}

#[test]
fn a_reference_that_is_not_the_identity_is_factored_out() {
    let maps = truth();
    let ties = ties(&maps, Seed(7), 1.0);
    let plain = tie_keyframes(&maps, &CORNERS, &ties).unwrap();
    let shift = Homography::from_translation(dvec2(5.0, 9.0)).unwrap();
    let moved: Vec<Homography> = maps.iter().map(|&map| map * shift).collect();
    let found = tie_keyframes(&moved, &CORNERS, &ties).unwrap();
    for (a, b) in found
        .keyframe_from_reference
        .iter()
        .zip(&plain.keyframe_from_reference)
    {
        assert!(error(a, b).amax() < 1e-6);
    }
}

#[test]
fn each_kind_of_bad_input_has_its_own_error() {
    let maps = truth();
    let good = ties(&maps, Seed(1), 1.0);
    assert!(matches!(
        tie_keyframes(&[], &CORNERS, &good),
        Err(TieError::Count { got: 0 })
    ));
    let many = vec![Homography::IDENTITY; MAX_KEYFRAMES + 1];
    assert!(matches!(
        tie_keyframes(&many, &CORNERS, &good),
        Err(TieError::Count { .. })
    ));
    let line = [DVec2::ZERO, DVec2::X, DVec2::X * 2.0, DVec2::X * 3.0];
    assert_eq!(tie_keyframes(&maps, &line, &good), Err(TieError::Corners));
    let changed = |change: fn(&mut Tie)| {
        let mut bad = good.clone();
        change(&mut bad[2]);
        tie_keyframes(&maps, &CORNERS, &bad)
    };
    let bad = Err(TieError::Tie { index: 2, count: 5 });
    assert_eq!(changed(|tie| tie.to = 5), bad);
    assert_eq!(changed(|tie| tie.to = tie.from), bad);
    assert_eq!(changed(|tie| tie.covariance[3][3] = -1.0), bad);
    assert_eq!(changed(|tie| tie.covariance[3][3] = f64::NAN), bad);
    assert_eq!(changed(|tie| tie.points = [DVec2::ONE; 4]), bad);
    assert_eq!(changed(|tie| tie.points[0].x = f64::NAN), bad);
    assert_eq!(
        tie_keyframes(&maps, &CORNERS, &good[..2]),
        Err(TieError::Untied { keyframe: 3 })
    );
    // the reference alone needs no ties
    let alone = tie_keyframes(&maps[..1], &CORNERS, &[]).unwrap();
    assert_eq!(alone.covariance(0, &CORNERS), Some([[0.0; 8]; 8]));
}
