use super::*;
use crate::estimate::estimate;
use crate::strategies::{homography, noisy_pairs};
use glam::dvec2;
use proptest::prelude::*;
use ravec_scenes::Seed;

const CORNERS: [DVec2; 4] = [
    DVec2::ZERO,
    DVec2::new(1000.0, 0.0),
    DVec2::new(1000.0, 700.0),
    DVec2::new(0.0, 700.0),
];

/// Pairs with noise, of which the given share is replaced by unrelated points, and which of them were not.
fn contaminated(
    h: &Homography,
    count: i64,
    outliers: f64,
    sigma_px: f64,
    seed: Seed,
) -> (Vec<PointPair>, Vec<bool>) {
    let (seed, corners) = (seed.fork(1), CORNERS.map(|c| h.apply(c)));
    let low = corners.iter().fold(corners[0], |a, &b| a.min(b));
    let high = corners.iter().fold(corners[0], |a, &b| a.max(b));
    let mut pairs = noisy_pairs(h, count, sigma_px, seed);
    let good: Vec<bool> = (0..count).map(|i| seed.unit(i, 7, 0) >= outliers).collect();
    for (i, pair) in pairs.iter_mut().enumerate().filter(|(i, _)| !good[*i]) {
        let at = dvec2(seed.unit(i as i64, 8, 0), seed.unit(i as i64, 9, 0));
        pair.dst = low + at * (high - low);
    }
    (pairs, good)
}

fn corner_error(found: &Homography, truth: &Homography) -> f64 {
    CORNERS
        .iter()
        .map(|&c| found.apply(c).distance(truth.apply(c)))
        .sum::<f64>()
        / 4.0
}

fn planted() -> Homography {
    let quad = [
        dvec2(60.0, 20.0),
        dvec2(980.0, 120.0),
        dvec2(900.0, 640.0),
        dvec2(10.0, 690.0),
    ];
    Homography::from_pairs(&CORNERS, &quad).unwrap()
}

#[test]
fn sixty_per_cent_outliers_cost_at_most_a_fifth_of_the_accuracy() {
    let truth = planted();
    let (mut robust, mut ideal) = (0.0, 0.0);
    for seed in 0..40 {
        let (pairs, good) = contaminated(&truth, 1000, 0.6, 1.0, Seed(seed));
        let inliers: Vec<_> = pairs
            .iter()
            .zip(good)
            .filter(|(_, good)| *good)
            .map(|(p, _)| *p)
            .collect();
        let found = estimate_robust(&pairs, &RobustParams::default()).unwrap();
        robust += corner_error(&found.dst_from_src, &truth);
        ideal += corner_error(&estimate(&inliers).unwrap(), &truth);
        // the median of 400 residuals is good to 5 %, three times that is safe
        assert!((found.sigma_px - 1.0).abs() < 0.15, "{}", found.sigma_px);
    }
    assert!(robust < 1.2 * ideal, "{robust} {ideal}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_planted_map_is_found_among_outliers(h in homography(), seed in 0u64..1000, outliers in 0.0f64..0.7) {
        let (pairs, good) = contaminated(&h, 300, outliers, 0.5, Seed(seed));
        let found = estimate_robust(&pairs, &RobustParams { seed, ..RobustParams::default() }).unwrap();
        prop_assert!(corner_error(&found.dst_from_src, &h) < 4.0, "{}", corner_error(&found.dst_from_src, &h));
        let right = found.inliers.iter().zip(&good).filter(|(a, b)| a == b).count();
        // one inlier in a hundred lies beyond the cutoff
        prop_assert!(right >= 285, "{right}");
    }

    #[test]
    fn the_first_order_distance_is_the_distance_for_small_noise(h in homography(), seed in 0u64..1000) {
        for pair in noisy_pairs(&h, 5, 0.01, Seed(seed)) {
            // the definition: the nearest perfect pair, by Newton's steps on the src point
            let mut p = pair.src;
            for _ in 0..20 {
                let a = h.jacobian(p);
                let gradient = (p - pair.src) + a.transpose() * (h.apply(p) - pair.dst);
                p -= (DMat2::IDENTITY + a.transpose() * a).inverse() * gradient;
            }
            let truth = p.distance_squared(pair.src) + h.apply(p).distance_squared(pair.dst);
            let found = residual_sq(&h.matrix(), &pair);
            prop_assert!((found - truth).abs() <= 1e-3 * truth + 1e-15, "{found} {truth}");
        }
    }
}

#[test]
fn equal_seeds_give_equal_bytes_and_order_helps() {
    let (pairs, good) = contaminated(&planted(), 500, 0.7, 1.0, Seed(3));
    let params = RobustParams::default();
    let first = estimate_robust(&pairs, &params).unwrap();
    assert_eq!(first, estimate_robust(&pairs, &params).unwrap());
    let mut sorted: Vec<_> = pairs.iter().zip(good).collect();
    sorted.sort_by_key(|(_, good)| !good);
    let sorted: Vec<_> = sorted.into_iter().map(|(pair, _)| *pair).collect();
    let again = estimate_robust(&sorted, &params).unwrap();
    assert!(corner_error(&again.dst_from_src, &first.dst_from_src) < 0.5);
}

#[test]
fn unrelated_points_agree_on_nothing() {
    let (pairs, _) = contaminated(&planted(), 200, 1.1, 0.0, Seed(5));
    let params = RobustParams {
        max_samples: 2000,
        min_inliers: 12,
        ..RobustParams::default()
    };
    let found = estimate_robust(&pairs, &params);
    assert!(
        matches!(found, Err(HomographyError::NoConsensus { needed: 12, .. })),
        "{found:?}"
    );
}

#[test]
fn pairs_on_a_line_among_others_are_no_plane() {
    let mut pairs = noisy_pairs(&planted(), 100, 0.0, Seed(2));
    for (i, pair) in pairs.iter_mut().enumerate() {
        if i % 3 == 0 {
            pair.dst = dvec2(
                1000.0 * Seed(9).unit(i as i64, 0, 0),
                700.0 * Seed(9).unit(i as i64, 0, 1),
            );
        } else {
            let noise = dvec2(
                Seed(4).gaussian(i as i64, 0, 0),
                Seed(4).gaussian(i as i64, 0, 1),
            );
            pair.src.y = 0.5 * pair.src.x + 20.0;
            pair.dst = pair.src + 0.2 * noise;
        }
    }
    let found = estimate_robust(&pairs, &RobustParams::default());
    let refused = matches!(
        found,
        Err(HomographyError::Degenerate { .. } | HomographyError::NoConsensus { .. })
    );
    assert!(refused, "{found:?}");
}

#[test]
fn bad_input_is_refused() {
    let pair = PointPair::new(DVec2::ZERO, DVec2::ONE);
    let params = RobustParams::default();
    assert_eq!(
        estimate_robust(&[pair; 3], &params),
        Err(HomographyError::TooFew { got: 3 })
    );
    assert!(estimate_robust(&[pair; 30], &params).is_err());
    let mut pairs = noisy_pairs(&planted(), 20, 0.0, Seed(2));
    pairs[7].src.y = f64::NAN;
    assert_eq!(
        estimate_robust(&pairs, &params),
        Err(HomographyError::NonFinite)
    );
}
