//! Random geometry for the property tests of this crate.

use crate::estimate::PointPair;
use crate::homography::Homography;
use glam::{DMat3, DVec2, dvec2};
use proptest::prelude::*;
use ravec_scenes::Seed;

/// A point of a picture of 1000 × 700 pixels.
pub fn point() -> impl Strategy<Value = DVec2> {
    (0.0..1000.0, 0.0..700.0).prop_map(|(x, y)| dvec2(x, y))
}

/// A camera's change of view of a picture of 1000 × 700 pixels: turned, scaled by 0.5 to 2, sheared, shifted, tilted so that
/// depth changes by up to ±40 % from the center to a corner; mirrored in half of the cases. The whole picture lies in front.
pub fn homography() -> impl Strategy<Value = Homography> {
    (
        -3.0..3.0,
        0.5..2.0,
        -0.3..0.3,
        (-300.0..300.0, -300.0..300.0),
        (-0.4 / 600.0..0.4 / 600.0, -0.4 / 600.0..0.4 / 600.0),
        any::<bool>(),
    )
        .prop_map(
            |(angle, scale, shear, (x, y), (tilt_x, tilt_y), mirrored)| {
                let mut tilt = DMat3::IDENTITY;
                tilt.x_axis.z = tilt_x;
                tilt.y_axis.z = tilt_y;
                let mut sheared = DMat3::IDENTITY;
                sheared.y_axis.x = shear;
                let flip = if mirrored {
                    dvec2(-1.0, 1.0)
                } else {
                    DVec2::ONE
                };
                let center = dvec2(500.0, 350.0);
                Homography::from_matrix(
                    DMat3::from_translation(center + dvec2(x, y))
                        * DMat3::from_scale_angle_translation(flip * scale, angle, DVec2::ZERO)
                        * sheared
                        * tilt
                        * DMat3::from_translation(-center),
                )
                .expect("each factor is regular")
            },
        )
}

/// Points all over a picture of 1000 × 700 pixels and their images, both with noise.
pub fn noisy_pairs(h: &Homography, count: i64, sigma_px: f64, seed: Seed) -> Vec<PointPair> {
    (0..count)
        .map(|i| {
            let noise = |k| dvec2(seed.gaussian(i, 0, k), seed.gaussian(i, 1, k)) * sigma_px;
            let src = dvec2(
                seed.between(i, 2, 0, 0.0, 1000.0),
                seed.between(i, 3, 0, 0.0, 700.0),
            );
            PointPair::new(src + noise(0), h.apply(src) + noise(1))
        })
        .collect()
}
