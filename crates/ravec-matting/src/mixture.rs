//! Pixels as mixtures of two sides, each with a mean color and a covariance: alpha by the color alone, and the colors of both sides.

use crate::approximate::exp;
use crate::field::ColorField;
use crate::half::doubled_row;
use crate::posterior::LEVELS;
use crate::symmetric::{adjugate, product};
use fearless_simd::{Level as Vectors, Simd, dispatch};
use std::ops::Range;

/// Variance that is added to that of both sides, relative to the noise: their models are never exact.
const MIN_SPREAD: f32 = 1.0;

/// Color models of both sides at the pixels of a row of a picture, foreground first, in units of the noise.
#[derive(Default)]
pub(crate) struct ModelRow {
    /// The row that the models stand for.
    row: Option<usize>,
    mean: [[Vec<f32>; 3]; 2],
    covariance: [[Vec<f32>; 6]; 2],
    scratch: Vec<f32>,
    /// Exponents and densities of the levels of a span, and the largest exponents.
    levels: Vec<f32>,
}

impl ModelRow {
    /// Sets the row, of `width` pixels. The fields of one object must be those of one pair of sides.
    pub fn fill(&mut self, fields: [&ColorField; 2], row: usize, width: usize) {
        if self.row.replace(row) == Some(row) {
            return;
        }
        for (side, field) in fields.into_iter().enumerate() {
            let lines = self.mean[side].iter_mut().chain(&mut self.covariance[side]);
            for (line, plane) in lines.zip(field.mean.iter().chain(&field.covariance)) {
                line.resize(width, 0.0);
                doubled_row(plane, row, &mut self.scratch, line);
            }
        }
    }

    /// Mean and variance of alpha of a range of pixels by their colors.
    pub fn estimate(
        &mut self,
        cols: Range<usize>,
        colors: [&[f32]; 3],
        mean: &mut [f32],
        variance: &mut [f32],
    ) {
        let mut levels = std::mem::take(&mut self.levels);
        levels.resize((2 * LEVELS + 1) * cols.len(), 0.0);
        let models = self.within(cols);
        dispatch!(Vectors::new(), simd => models.estimate(simd, colors, &mut levels, mean, variance));
        self.levels = levels;
    }

    /// The most likely colors of both sides that compose to the colors of a range of pixels: what the models leave is shared in
    /// proportion to their parts of it. `pairs` holds a line for each channel of the foreground, and then of the background.
    pub fn split(&self, cols: Range<usize>, colors: [&[f32]; 3], alpha: &[f32], pairs: &mut [f32]) {
        let models = self.within(cols);
        dispatch!(Vectors::new(), simd => models.split(simd, colors, alpha, pairs));
    }

    fn within(&self, cols: Range<usize>) -> Models<'_> {
        Models {
            mean: self
                .mean
                .each_ref()
                .map(|side| side.each_ref().map(|line| &line[cols.clone()])),
            covariance: self
                .covariance
                .each_ref()
                .map(|side| side.each_ref().map(|line| &line[cols.clone()])),
        }
    }
}

/// Color models of a range of pixels.
struct Models<'a> {
    mean: [[&'a [f32]; 3]; 2],
    /// Entries xx, yy, zz, xy, xz, yz.
    covariance: [[&'a [f32]; 6]; 2],
}

/// Distribution of the color of a pixel with a given alpha.
struct Mixture {
    residual: [f32; 3],
    /// Adjugate of the covariance: entries xx, yy, zz, xy, xz, yz.
    cofactors: [f32; 6],
    determinant: f32,
}

impl Models<'_> {
    /// The mixture of a pixel, with the difference of its color to the mean.
    #[inline(always)]
    fn mixture(&self, at: usize, alpha: f32, color: [f32; 3]) -> Mixture {
        let beta = 1.0 - alpha;
        let (front, back) = (alpha * alpha, beta * beta);
        let noise = 1.0 + MIN_SPREAD * (front + back);
        let [f, b] = &self.covariance;
        let covariance = [
            front * f[0][at] + back * b[0][at] + noise,
            front * f[1][at] + back * b[1][at] + noise,
            front * f[2][at] + back * b[2][at] + noise,
            front * f[3][at] + back * b[3][at],
            front * f[4][at] + back * b[4][at],
            front * f[5][at] + back * b[5][at],
        ];
        let [f, b] = &self.mean;
        let residual = [
            color[0] - alpha * f[0][at] - beta * b[0][at],
            color[1] - alpha * f[1][at] - beta * b[1][at],
            color[2] - alpha * f[2][at] - beta * b[2][at],
        ];
        // rounding must not make the determinant vanish: in exact numbers it is above 1
        let (cofactors, determinant) = adjugate(covariance);
        Mixture {
            residual,
            cofactors,
            determinant: determinant.max(1.0),
        }
    }

    #[inline(always)]
    fn estimate<S: Simd>(
        &self,
        _simd: S,
        colors: [&[f32]; 3],
        levels: &mut [f32],
        mean: &mut [f32],
        variance: &mut [f32],
    ) {
        let count = mean.len();
        let models = self.of_length(count);
        let [x, y, z] = colors.map(|line| &line[..count]);
        let (exponents, rest) = levels.split_at_mut(LEVELS * count);
        let (densities, largest) = rest.split_at_mut(LEVELS * count);
        let largest = &mut largest[..count];
        largest.fill(f32::MIN);
        for level in 0..LEVELS {
            let alpha = level_alpha(level);
            let exponents = &mut exponents[level * count..][..count];
            let densities = &mut densities[level * count..][..count];
            for at in 0..count {
                let mixture = models.mixture(at, alpha, [x[at], y[at], z[at]]);
                let [r0, r1, r2] = mixture.residual;
                let [s0, s1, s2] = product(&mixture.cofactors, mixture.residual);
                let inverse = 1.0 / mixture.determinant;
                exponents[at] = -0.5 * inverse * (r0 * s0 + r1 * s1 + r2 * s2);
                densities[at] = inverse.sqrt();
                largest[at] = largest[at].max(exponents[at]);
            }
        }
        // sums of the chances and of their products with alpha and its square
        let (total, densities) = (&mut *variance, &*densities);
        let mut squares = vec![0.0f32; count];
        mean.fill(0.0);
        total.fill(0.0);
        for level in 0..LEVELS {
            let alpha = level_alpha(level);
            let exponents = &exponents[level * count..][..count];
            let densities = &densities[level * count..][..count];
            for at in 0..count {
                let chance = exp(exponents[at] - largest[at]) * densities[at];
                total[at] += chance;
                mean[at] += chance * alpha;
                squares[at] += chance * alpha * alpha;
            }
        }
        for ((mean, variance), square) in mean.iter_mut().zip(variance).zip(&squares) {
            let total = *variance;
            *mean /= total;
            *variance = (square / total - *mean * *mean).max(0.0);
        }
    }

    #[inline(always)]
    fn split<S: Simd>(&self, _simd: S, colors: [&[f32]; 3], alpha: &[f32], pairs: &mut [f32]) {
        let count = alpha.len();
        let models = self.of_length(count);
        let [x, y, z] = colors.map(|line| &line[..count]);
        for (at, &alpha) in alpha.iter().enumerate() {
            let color = [x[at], y[at], z[at]];
            let mixture = models.mixture(at, alpha, color);
            let [s0, s1, s2] = product(&mixture.cofactors, mixture.residual);
            let scale = 1.0 / mixture.determinant;
            let whitened = [s0 * scale, s1 * scale, s2 * scale];
            let shares = [alpha, 1.0 - alpha];
            let mut found = [[0.0f32; 3]; 2];
            for (side, found) in found.iter_mut().enumerate() {
                let covariance = &models.covariance[side];
                let entries = [
                    covariance[0][at],
                    covariance[1][at],
                    covariance[2][at],
                    covariance[3][at],
                    covariance[4][at],
                    covariance[5][at],
                ];
                let gain = product(&entries, whitened);
                for channel in 0..3 {
                    let update = gain[channel] + MIN_SPREAD * whitened[channel];
                    found[channel] = models.mean[side][channel][at] + shares[side] * update;
                }
            }
            let norm = shares[0] * shares[0] + shares[1] * shares[1];
            for channel in 0..3 {
                let shown = shares[0] * found[0][channel] + shares[1] * found[1][channel];
                let rest = (color[channel] - shown) / norm;
                for (side, found) in found.iter().enumerate() {
                    pairs[(3 * side + channel) * count + at] = found[channel] + rest * shares[side];
                }
            }
        }
    }

    /// The same models, of which the compiler knows that all have the length.
    #[inline(always)]
    fn of_length(&self, count: usize) -> Self {
        Self {
            mean: self.mean.map(|side| side.map(|line| &line[..count])),
            covariance: self.covariance.map(|side| side.map(|line| &line[..count])),
        }
    }
}

/// The value of alpha that a level stands for.
fn level_alpha(level: usize) -> f32 {
    level as f32 / (LEVELS - 1) as f32
}
