//! A field of foreground colors: for each place a mean and a covariance, from what is certain nearby.

use crate::half::{halve, spread};
use ravec_raster::Plane;

/// Weight of the coarser level of the spread.
const PULL: f32 = 0.002;

/// Colors of the foreground at half the size of a picture, in units of the noise.
pub(crate) struct ColorField {
    /// Mean of each channel.
    pub mean: [Plane; 3],
    /// Covariance without that of the noise: xx, yy, zz, xy, xz, yz.
    pub covariance: [Plane; 6],
}

/// Channels of the entries of a covariance.
pub(crate) const ENTRIES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// Collects `colors` with `weight` over windows of `sigma_px` at half the size.
pub(crate) fn color_field(colors: &[Plane; 3], weight: &Plane, sigma_px: f64) -> ColorField {
    let size = weight.size();
    let weighted = |f: &dyn Fn(usize) -> f32| {
        let mut plane = Plane::new(size, 0.0);
        for (at, (out, weight)) in plane
            .pixels_mut()
            .iter_mut()
            .zip(weight.pixels())
            .enumerate()
        {
            // most places have no weight
            if *weight > 0.0 {
                *out = weight * f(at);
            }
        }
        halve(&plane)
    };
    let value = |channel: usize, at: usize| colors[channel].pixels()[at];
    let first = [0, 1, 2].map(|channel| weighted(&|at| value(channel, at)));
    let second = ENTRIES.map(|(a, b)| weighted(&|at| value(a, at) * value(b, at)));
    let [a, b, c] = first;
    let [d, e, f, g, h, i] = second;
    let [m0, m1, m2, xx, yy, zz, xy, xz, yz] =
        spread(&halve(weight), [a, b, c, d, e, f, g, h, i], sigma_px, PULL);
    let mean = [m0, m1, m2];
    let mut covariance = [xx, yy, zz, xy, xz, yz];
    for (plane, (a, b)) in covariance.iter_mut().zip(ENTRIES) {
        for (at, value) in plane.pixels_mut().iter_mut().enumerate() {
            *value -= mean[a].pixels()[at] * mean[b].pixels()[at];
            if a == b {
                // colors are in units of the noise, which is in the samples too
                *value = (*value - 1.0).max(0.0);
            }
        }
    }
    ColorField { mean, covariance }
}
