//! A field of foreground colors: for each place a mean and a covariance, from what is certain nearby.

use crate::half::{halved_of, spread};
use fearless_simd::{Level as Vectors, Simd, dispatch};
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

/// Collects `colors` with `weight`, times `share` at half the size, over windows of `sigma_px` at half the size.
pub(crate) fn color_field(
    colors: &[Plane; 3],
    weight: &Plane,
    share: Option<&Plane>,
    sigma_px: f64,
) -> ColorField {
    let mut sums = halved_of(weight.size(), |row, lines| {
        let weight = weight.row(row);
        // most rows of a large picture have no weight
        if weight.iter().all(|weight| *weight == 0.0) {
            for line in lines {
                line.fill(0.0);
            }
            return;
        }
        let colors = colors.each_ref().map(|plane| plane.row(row));
        dispatch!(Vectors::new(), simd => weighted(simd, weight, colors, lines));
    });
    if let Some(share) = share {
        for sum in &mut sums {
            for (sum, share) in sum.pixels_mut().iter_mut().zip(share.pixels()) {
                *sum *= share;
            }
        }
    }
    let [weight, sums @ ..] = sums;
    let [m0, m1, m2, xx, yy, zz, xy, xz, yz] = spread(&weight, sums, sigma_px, PULL);
    let mean = [m0, m1, m2];
    let mut covariance = [xx, yy, zz, xy, xz, yz];
    for (plane, (a, b)) in covariance.iter_mut().zip(ENTRIES) {
        let means = mean[a].pixels().iter().zip(mean[b].pixels());
        // colors are in units of the noise, which is in the samples too
        let (noise, least) = if a == b {
            (1.0, 0.0)
        } else {
            (0.0, f32::NEG_INFINITY)
        };
        for (value, (a, b)) in plane.pixels_mut().iter_mut().zip(means) {
            *value = (*value - a * b - noise).max(least);
        }
    }
    ColorField { mean, covariance }
}

/// A row of the weight and of the products of the weight with the channels and with the entries.
#[inline(always)]
fn weighted<S: Simd>(_simd: S, weight: &[f32], colors: [&[f32]; 3], lines: &mut [Vec<f32>; 10]) {
    let [out, first @ ..] = lines;
    out.copy_from_slice(weight);
    let (first, second) = first.split_at_mut(3);
    for (out, color) in first.iter_mut().zip(colors) {
        for ((out, weight), color) in out.iter_mut().zip(weight).zip(color) {
            *out = weight * color;
        }
    }
    for (out, (a, b)) in second.iter_mut().zip(ENTRIES) {
        let products = first[a].iter().zip(colors[b]);
        for (out, (weighted, color)) in out.iter_mut().zip(products) {
            *out = weighted * color;
        }
    }
}
