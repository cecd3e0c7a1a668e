//! Likelihood of values of alpha in each pixel, and what follows from it and a prior.

use crate::approximate::{exp, ln};
use crate::field::ColorField;
use crate::half::doubled_row;
use crate::texture::TextureCue;
use fearless_simd::{Level as Vectors, Simd, dispatch};
use ravec_raster::{Plane, Size};
use rayon::prelude::*;

/// Number of values of alpha that are compared: 0, 1/8, …, 1.
pub(crate) const LEVELS: usize = 9;
const STEP: f32 = 1.0 / (LEVELS - 1) as f32;
/// Variance that is added to that of the foreground, relative to the noise: its field is never exact.
const MIN_SPREAD: f32 = 0.2;
/// Share of the median in alpha; the rest is the mean. The median keeps flat places flat, the mean gives details their value.
const MEDIAN_SHARE: f32 = 0.7;

/// Inputs of the likelihood, in units of the noise.
pub(crate) struct Evidence<'a> {
    pub frame: &'a [Plane; 3],
    pub plate: &'a [Plane; 3],
    /// Variance of a pixel of pure background.
    pub variance: &'a Plane,
    pub field: &'a ColorField,
    pub cue: &'a TextureCue,
}

/// Logarithms of the likelihoods of the levels: each row of the picture has a row for each level.
pub(crate) struct Likelihood {
    size: Size,
    values: Vec<f32>,
    /// Squared distance between foreground and background, in units of the noise.
    pub contrast: Plane,
}

/// Shares of the levels 0 and 1 before a pixel is looked at.
pub(crate) struct Prior {
    pub background: Plane,
    pub foreground: Plane,
}

impl Likelihood {
    pub fn of(evidence: &Evidence<'_>) -> Self {
        let size = evidence.variance.size();
        let width = size.width();
        let mut values = vec![0.0f32; LEVELS * size.pixels()];
        let mut contrast = Plane::new(size, 0.0);
        values
            .par_chunks_mut(LEVELS * width)
            .zip(contrast.par_rows_mut())
            .enumerate()
            .for_each_init(
                || Row::new(width),
                |scratch, (row, (values, contrast))| {
                    scratch.fill(evidence, row);
                    let variance = evidence.variance.row(row);
                    dispatch!(Vectors::new(), simd => scratch.likelihood(simd, variance, values, contrast));
                },
            );
        Self {
            size,
            values,
            contrast,
        }
    }

    /// Foreground colors, in units of the noise: the most likely ones where the picture shows `alpha` of them.
    pub fn foreground(evidence: &Evidence<'_>, alpha: &Plane) -> [Plane; 3] {
        let size = evidence.variance.size();
        let mut colors = [(); 3].map(|()| Plane::new(size, 0.0));
        let rows = transposed(&mut colors, size.width());
        rows.into_par_iter().enumerate().for_each_init(
            || Row::new(size.width()),
            |scratch, (row, mut out)| {
                scratch.fill(evidence, row);
                let plate = evidence.plate.each_ref().map(|plane| plane.row(row));
                for (col, alpha) in alpha.row(row).iter().enumerate() {
                    let shift = scratch.correction(*alpha, evidence.variance[(col, row)], col);
                    for channel in 0..3 {
                        out[channel][col] =
                            plate[channel][col] + scratch.direction[channel][col] + shift[channel];
                    }
                }
            },
        );
        colors
    }

    /// Calls `f` for each row with the probabilities of the levels under the prior and the rows of the output.
    fn for_rows<const N: usize>(
        &self,
        prior: Option<&Prior>,
        outputs: &mut [Plane; N],
        f: impl Fn(&[f32], [&mut [f32]; N]) + Sync,
    ) {
        let width = self.size.width();
        let rows: Vec<Vec<&mut [f32]>> = transposed(outputs, width);
        self.values
            .par_chunks(LEVELS * width)
            .zip(rows)
            .enumerate()
            .for_each_init(
                || vec![0.0f32; (LEVELS + 2) * width],
                |scratch, (row, (values, outputs))| {
                    let (chances, sums) = scratch.split_at_mut(LEVELS * width);
                    let prior =
                        prior.map(|prior| (prior.background.row(row), prior.foreground.row(row)));
                    dispatch!(Vectors::new(), simd => chances_of(simd, values, prior, chances, sums));
                    let mut rows = outputs.into_iter();
                    f(
                        chances,
                        [(); N].map(|()| rows.next().expect("one row for each output")),
                    );
                },
            );
    }

    /// Probabilities of the levels 0 and 1, without a prior.
    pub fn ends(&self) -> [Plane; 2] {
        let mut ends = [Plane::new(self.size, 0.0), Plane::new(self.size, 0.0)];
        self.for_rows(None, &mut ends, |chances, [background, foreground]| {
            let width = background.len();
            background.copy_from_slice(&chances[..width]);
            foreground.copy_from_slice(&chances[(LEVELS - 1) * width..]);
        });
        ends
    }

    /// Alpha under a prior.
    pub fn alpha(&self, prior: &Prior) -> Plane {
        let mut alpha = [Plane::new(self.size, 0.0)];
        self.for_rows(Some(prior), &mut alpha, |chances, [alpha]| {
            dispatch!(Vectors::new(), simd => between_median_and_mean(simd, chances, alpha));
        });
        let [alpha] = alpha;
        alpha
    }
}

/// Columns whose sums stay in registers.
const LANES: usize = 16;

/// Alpha of a row from the probabilities of its levels.
#[inline(always)]
fn between_median_and_mean<S: Simd>(_simd: S, chances: &[f32], alpha: &mut [f32]) {
    let width = alpha.len();
    for (block, alpha) in alpha.chunks_mut(LANES).enumerate() {
        let mut sum = [0.0f32; LANES];
        let mut mean = [0.0f32; LANES];
        let mut median = [f32::NAN; LANES];
        for level in 0..LEVELS {
            let chances = &chances[level * width + block * LANES..][..alpha.len()];
            // the ends are values of their own, those between stand for a range
            let range = if level == 0 || level == LEVELS - 1 {
                0.0
            } else {
                1.0
            };
            for (lane, chance) in chances.iter().enumerate() {
                let before = sum[lane];
                mean[lane] += chance * level as f32;
                sum[lane] += chance;
                let within = (0.5 - before) / chance.max(1e-12) - 0.5;
                let is_here = before < 0.5 && sum[lane] >= 0.5;
                let here = level as f32 + range * within;
                median[lane] = if is_here { here } else { median[lane] };
            }
        }
        for (lane, alpha) in alpha.iter_mut().enumerate() {
            let mean = mean[lane] * STEP;
            let median = median[lane] * STEP;
            let median = if median.is_nan() { mean } else { median };
            *alpha = (MEDIAN_SHARE * median + (1.0 - MEDIAN_SHARE) * mean).clamp(0.0, 1.0);
        }
    }
}

/// The rows of several planes of the same size, one list for each row.
fn transposed<const N: usize>(planes: &mut [Plane; N], width: usize) -> Vec<Vec<&mut [f32]>> {
    let mut rows: Vec<Vec<&mut [f32]>> = Vec::new();
    for plane in planes {
        for (row, cells) in plane.pixels_mut().chunks_mut(width).enumerate() {
            match rows.get_mut(row) {
                Some(cell) => cell.push(cells),
                None => rows.push(vec![cells]),
            }
        }
    }
    rows
}

/// Probabilities from logarithms of likelihoods and the shares of the ends. `sums` has room for two rows.
#[inline(always)]
fn chances_of<S: Simd>(
    _simd: S,
    values: &[f32],
    prior: Option<(&[f32], &[f32])>,
    chances: &mut [f32],
    sums: &mut [f32],
) {
    let width = values.len() / LEVELS;
    let (largest, total) = sums.split_at_mut(width);
    let total = &mut total[..width];
    largest.copy_from_slice(&values[..width]);
    for level in 1..LEVELS {
        for (largest, value) in largest.iter_mut().zip(&values[level * width..]) {
            *largest = largest.max(*value);
        }
    }
    total.fill(0.0);
    for level in 0..LEVELS {
        let out = &mut chances[level * width..][..width];
        let values = &values[level * width..][..width];
        for ((out, value), largest) in out.iter_mut().zip(values).zip(&*largest) {
            *out = exp(value - largest);
        }
        if let Some((background, foreground)) = prior {
            match level {
                0 => multiply(out, background),
                _ if level == LEVELS - 1 => multiply(out, foreground),
                _ => {
                    for ((out, background), foreground) in
                        out.iter_mut().zip(background).zip(foreground)
                    {
                        let left = (1.0 - background - foreground).max(1e-6);
                        *out *= left / (LEVELS - 2) as f32;
                    }
                }
            }
        }
        for (total, out) in total.iter_mut().zip(&*out) {
            *total += out;
        }
    }
    for level in 0..LEVELS {
        for (out, total) in chances[level * width..][..width].iter_mut().zip(&*total) {
            *out /= total.max(1e-30);
        }
    }
}

#[inline(always)]
fn multiply(values: &mut [f32], factors: &[f32]) {
    for (value, factor) in values.iter_mut().zip(factors) {
        *value *= factor;
    }
}

/// A row of the evidence at full size.
struct Row {
    scratch: Vec<f32>,
    difference: [Vec<f32>; 3],
    direction: [Vec<f32>; 3],
    covariance: [Vec<f32>; 6],
    cue: [Vec<f32>; 2],
}

impl Row {
    fn new(width: usize) -> Self {
        let line = || vec![0.0; width];
        Self {
            scratch: Vec::new(),
            difference: [(); 3].map(|()| line()),
            direction: [(); 3].map(|()| line()),
            covariance: [(); 6].map(|()| line()),
            cue: [(); 2].map(|()| line()),
        }
    }

    fn fill(&mut self, evidence: &Evidence<'_>, row: usize) {
        for channel in 0..3 {
            let (frame, plate) = (
                evidence.frame[channel].row(row),
                evidence.plate[channel].row(row),
            );
            for ((out, frame), plate) in self.difference[channel].iter_mut().zip(frame).zip(plate) {
                *out = frame - plate;
            }
            let direction = &mut self.direction[channel];
            doubled_row(
                &evidence.field.mean[channel],
                row,
                &mut self.scratch,
                direction,
            );
            for (out, plate) in direction.iter_mut().zip(plate) {
                *out -= plate;
            }
        }
        for (out, plane) in self.covariance.iter_mut().zip(&evidence.field.covariance) {
            doubled_row(plane, row, &mut self.scratch, out);
        }
        doubled_row(
            &evidence.cue.alpha,
            row,
            &mut self.scratch,
            &mut self.cue[0],
        );
        doubled_row(
            &evidence.cue.precision,
            row,
            &mut self.scratch,
            &mut self.cue[1],
        );
    }

    /// Update of the mean foreground color by the pixel (a Kalman gain): α·Σ·(noise + α²·Σ)⁻¹ times the residual.
    fn correction(&self, alpha: f32, variance: f32, col: usize) -> [f32; 3] {
        let [xx, yy, zz, xy, xz, yz] = self.covariance.each_ref().map(|line| line[col]);
        let sigma = [
            [xx + MIN_SPREAD, xy, xz],
            [xy, yy + MIN_SPREAD, yz],
            [xz, yz, zz + MIN_SPREAD],
        ];
        let residual = [0, 1, 2].map(|c| self.difference[c][col] - alpha * self.direction[c][col]);
        let mut total = [[0.0; 3]; 3];
        for (a, line) in total.iter_mut().enumerate() {
            for (b, value) in line.iter_mut().enumerate() {
                *value = alpha * alpha * sigma[a][b] + if a == b { variance } else { 0.0 };
            }
        }
        let cofactor = |a: usize, b: usize| {
            let (p, q, r, s) = ((a + 1) % 3, (a + 2) % 3, (b + 1) % 3, (b + 2) % 3);
            total[p][r] * total[q][s] - total[p][s] * total[q][r]
        };
        let determinant: f32 = (0..3)
            .map(|k| total[0][k] * cofactor(0, k))
            .sum::<f32>()
            .max(1e-6);
        let solved = [0, 1, 2]
            .map(|a| (0..3).map(|b| cofactor(a, b) * residual[b]).sum::<f32>() / determinant);
        [0, 1, 2].map(|a| alpha * (0..3).map(|b| sigma[a][b] * solved[b]).sum::<f32>())
    }

    /// Gaussian likelihood of the difference under the noise and the spread of the foreground, times that of the cue.
    #[inline(always)]
    fn likelihood<S: Simd>(
        &self,
        _simd: S,
        variance: &[f32],
        values: &mut [f32],
        contrast: &mut [f32],
    ) {
        let width = variance.len();
        let [d0, d1, d2] = self.difference.each_ref().map(|line| &line[..width]);
        let [e0, e1, e2] = self.direction.each_ref().map(|line| &line[..width]);
        let [xx, yy, zz, xy, xz, yz] = self.covariance.each_ref().map(|line| &line[..width]);
        let [cue, precision] = self.cue.each_ref().map(|line| &line[..width]);
        for level in 0..LEVELS {
            let a = level as f32 * STEP;
            let aa = a * a;
            let out = &mut values[level * width..][..width];
            for col in 0..width {
                let (r0, r1, r2) = (
                    d0[col] - a * e0[col],
                    d1[col] - a * e1[col],
                    d2[col] - a * e2[col],
                );
                let noise = variance[col] + aa * MIN_SPREAD;
                let (cxx, cyy, czz) = (
                    noise + aa * xx[col],
                    noise + aa * yy[col],
                    noise + aa * zz[col],
                );
                let (cxy, cxz, cyz) = (aa * xy[col], aa * xz[col], aa * yz[col]);
                // the inverse by cofactors
                let (ixx, iyy, izz) = (
                    cyy * czz - cyz * cyz,
                    cxx * czz - cxz * cxz,
                    cxx * cyy - cxy * cxy,
                );
                let (ixy, ixz, iyz) = (
                    cxz * cyz - cxy * czz,
                    cxy * cyz - cxz * cyy,
                    cxy * cxz - cxx * cyz,
                );
                let determinant = (cxx * ixx + cxy * ixy + cxz * ixz).max(1e-6);
                let square = r0 * (ixx * r0 + 2.0 * (ixy * r1 + ixz * r2))
                    + r1 * (iyy * r1 + 2.0 * iyz * r2)
                    + izz * r2 * r2;
                let off = a - cue[col];
                out[col] =
                    -0.5 * (square / determinant + ln(determinant) + off * off * precision[col]);
            }
        }
        for col in 0..width {
            contrast[col] = e0[col] * e0[col] + e1[col] * e1[col] + e2[col] * e2[col];
        }
    }
}
