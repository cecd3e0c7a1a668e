//! Likelihood of values of alpha in each pixel, and what follows from it and a prior.

use crate::approximate::exp;
use crate::field::ColorField;
use crate::half::{doubled_row, rows_of};
use crate::symmetric::{adjugate, product};
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
/// Largest share that a prior gives to one end.
const MAX_SHARE: f32 = 0.98;

/// Inputs of the likelihood, in units of the noise.
pub(crate) struct Evidence<'a> {
    pub frame: &'a [Plane; 3],
    pub plate: &'a [Plane; 3],
    /// Variance of a pixel of pure background.
    pub variance: &'a Plane,
    pub field: &'a ColorField,
    pub cue: &'a TextureCue,
}

/// Likelihoods of the levels, up to a factor of each pixel: each row of the picture has a row for each level.
pub(crate) struct Likelihood {
    values: Vec<f32>,
    /// Probabilities of the levels 0 and 1, without a prior.
    pub ends: [Plane; 2],
    /// Squared distance between foreground and background, in units of the noise.
    pub contrast: Plane,
}

/// Shares of the levels 0 and 1 before a pixel is looked at, at half the size.
pub(crate) struct Prior {
    pub background: Plane,
    pub foreground: Plane,
}

impl Likelihood {
    /// Room for the likelihoods of a picture.
    pub fn new(size: Size) -> Self {
        Self {
            values: vec![0.0; LEVELS * size.pixels()],
            ends: [(); 2].map(|()| Plane::new(size, 0.0)),
            contrast: Plane::new(size, 0.0),
        }
    }

    /// Computes the likelihoods under the evidence, which has the size of the picture.
    pub fn update(&mut self, evidence: &Evidence<'_>) {
        let width = self.contrast.width();
        let ends_rows = rows_of(&mut self.ends);
        self.values
            .par_chunks_mut(LEVELS * width)
            .zip(ends_rows)
            .zip(self.contrast.par_rows_mut())
            .enumerate()
            .for_each_init(
                || (Row::new(width), vec![0.0f32; (LEVELS + 1) * width]),
                |(evidence_row, scratch), (row, ((values, [background, foreground]), contrast))| {
                    evidence_row.fill(evidence, row);
                    let variance = evidence.variance.row(row);
                    dispatch!(Vectors::new(), simd => {
                        evidence_row.contrast(simd, contrast);
                        evidence_row.likelihood(simd, variance, values, scratch);
                        ends(simd, values, background, foreground);
                    });
                },
            );
    }

    /// Foreground colors, in units of the noise: the most likely ones where the picture shows `alpha` of them.
    pub fn foreground(evidence: &Evidence<'_>, alpha: &Plane) -> [Plane; 3] {
        let size = evidence.variance.size();
        let mut colors = [(); 3].map(|()| Plane::new(size, 0.0));
        rows_of(&mut colors)
            .into_par_iter()
            .enumerate()
            .for_each_init(
                || Row::new(size.width()),
                |scratch, (row, colors)| {
                    scratch.fill(evidence, row);
                    let variance = evidence.variance.row(row);
                    let plate = evidence.plate.each_ref().map(|plane| plane.row(row));
                    let alpha = alpha.row(row);
                    dispatch!(Vectors::new(), simd => scratch.foreground(simd, alpha, variance, plate, colors));
                },
            );
        colors
    }

    /// Alpha under a prior.
    pub fn alpha(&self, prior: &Prior) -> Plane {
        let size = self.contrast.size();
        let width = size.width();
        let mut alpha = Plane::new(size, 0.0);
        alpha
            .par_rows_mut()
            .zip(self.values.par_chunks(LEVELS * width))
            .enumerate()
            .for_each_init(
                || (Vec::new(), [(); 2].map(|()| vec![0.0; width])),
                |(scratch, [background, foreground]), (row, (alpha, values))| {
                    doubled_row(&prior.background, row, scratch, background);
                    doubled_row(&prior.foreground, row, scratch, foreground);
                    dispatch!(Vectors::new(), simd => {
                        limit_shares(simd, background, foreground);
                        between_median_and_mean(simd, values, background, foreground, alpha);
                    });
                },
            );
        alpha
    }
}

/// Limits the share of either end and that of both.
#[inline(always)]
fn limit_shares<S: Simd>(_simd: S, background: &mut [f32], foreground: &mut [f32]) {
    let limit = |share: f32| 0.5 * (1.0 - MAX_SHARE) + MAX_SHARE * share.clamp(0.0, 1.0);
    for (background, foreground) in background.iter_mut().zip(foreground) {
        let shares = [limit(*background), limit(*foreground)];
        let scale = MAX_SHARE / (shares[0] + shares[1]).max(MAX_SHARE);
        [*background, *foreground] = shares.map(|share| share * scale);
    }
}

/// Columns whose sums stay in registers.
const LANES: usize = 16;

/// The values of a row from `start`, with zeros beyond its end.
#[inline(always)]
fn lanes(row: &[f32], start: usize) -> [f32; LANES] {
    let row = &row[start..];
    if let Some(lanes) = row.first_chunk() {
        return *lanes;
    }
    let mut lanes = [0.0; LANES];
    lanes[..row.len()].copy_from_slice(row);
    lanes
}

/// Alpha of a row from the likelihoods of its levels and the shares of its ends.
#[inline(always)]
fn between_median_and_mean<S: Simd>(
    _simd: S,
    values: &[f32],
    background: &[f32],
    foreground: &[f32],
    alpha: &mut [f32],
) {
    let width = alpha.len();
    for (block, alpha) in alpha.chunks_mut(LANES).enumerate() {
        let start = block * LANES;
        let (background, foreground) = (lanes(background, start), lanes(foreground, start));
        let mut between = [0.0f32; LANES];
        for lane in 0..LANES {
            let left = (1.0 - background[lane] - foreground[lane]).max(1e-6);
            between[lane] = left / (LEVELS - 2) as f32;
        }
        let mut chances = [[0.0f32; LANES]; LEVELS];
        let mut total = [0.0f32; LANES];
        for (level, chances) in chances.iter_mut().enumerate() {
            let values = lanes(&values[level * width..][..width], start);
            let shares = match level {
                0 => &background,
                _ if level == LEVELS - 1 => &foreground,
                _ => &between,
            };
            for lane in 0..LANES {
                chances[lane] = values[lane] * shares[lane];
                total[lane] += chances[lane];
            }
        }
        let mut sum = [0.0f32; LANES];
        let mut mean = [0.0f32; LANES];
        // the level in which half of the total is reached, the sum before it and its part
        let mut middle = [0.0f32; LANES];
        let mut before_middle = [0.0f32; LANES];
        let mut part = [0.0f32; LANES];
        for (level, chances) in chances.iter().enumerate() {
            for lane in 0..LANES {
                let (before, chance) = (sum[lane], chances[lane]);
                mean[lane] += chance * level as f32;
                sum[lane] += chance;
                let half = 0.5 * total[lane];
                let is_middle = before < half && sum[lane] >= half;
                middle[lane] = if is_middle {
                    level as f32
                } else {
                    middle[lane]
                };
                before_middle[lane] = if is_middle {
                    before
                } else {
                    before_middle[lane]
                };
                part[lane] = if is_middle { chance } else { part[lane] };
            }
        }
        let mut found = [0.0f32; LANES];
        for lane in 0..LANES {
            let total = total[lane].max(1e-30);
            let level = middle[lane];
            // the ends are values of their own, those between stand for a range
            let within = (0.5 * total - before_middle[lane]) / part[lane].max(1e-12 * total) - 0.5;
            let is_end = level == 0.0 || level == (LEVELS - 1) as f32;
            let median = level + if is_end { 0.0 } else { within };
            let mean = mean[lane] / total;
            let mixed = MEDIAN_SHARE * median + (1.0 - MEDIAN_SHARE) * mean;
            found[lane] = (STEP * mixed).clamp(0.0, 1.0);
        }
        alpha.copy_from_slice(&found[..alpha.len()]);
    }
}

/// Probabilities of the first and the last level of a row.
#[inline(always)]
fn ends<S: Simd>(_simd: S, values: &[f32], background: &mut [f32], foreground: &mut [f32]) {
    let width = background.len();
    // the sum of all levels
    foreground.fill(0.0);
    for values in values.chunks_exact(width) {
        for (sum, value) in foreground.iter_mut().zip(values) {
            *sum += value;
        }
    }
    let (first, last) = (&values[..width], &values[(LEVELS - 1) * width..]);
    let outputs = background.iter_mut().zip(foreground);
    for ((background, foreground), (first, last)) in outputs.zip(first.iter().zip(last)) {
        let scale = 1.0 / foreground.max(1e-30);
        *background = first * scale;
        *foreground = last * scale;
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
            let direction = &mut self.direction[channel];
            doubled_row(
                &evidence.field.mean[channel],
                row,
                &mut self.scratch,
                direction,
            );
            dispatch!(Vectors::new(), simd => {
                subtract(simd, frame, plate, &mut self.difference[channel]);
                subtract_from(simd, direction, plate);
            });
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

    /// Covariance of the difference of a pixel that shows `alpha` of the foreground.
    #[inline(always)]
    fn total(alpha: f32, variance: f32, sigma: [f32; 6]) -> [f32; 6] {
        let squared = alpha * alpha;
        let noise = variance + squared * MIN_SPREAD;
        let [xx, yy, zz, xy, xz, yz] = sigma;
        [
            noise + squared * xx,
            noise + squared * yy,
            noise + squared * zz,
            squared * xy,
            squared * xz,
            squared * yz,
        ]
    }

    /// The mean foreground color with its update by the pixel (a Kalman gain): α·Σ·(noise + α²·Σ)⁻¹ times the residual.
    #[inline(always)]
    fn foreground<S: Simd>(
        &self,
        _simd: S,
        alpha: &[f32],
        variance: &[f32],
        plate: [&[f32]; 3],
        colors: [&mut [f32]; 3],
    ) {
        let width = alpha.len();
        let variance = &variance[..width];
        let difference = self.difference.each_ref().map(|line| &line[..width]);
        let direction = self.direction.each_ref().map(|line| &line[..width]);
        let [xx, yy, zz, xy, xz, yz] = self.covariance.each_ref().map(|line| &line[..width]);
        let [p0, p1, p2] = plate.map(|line| &line[..width]);
        let [c0, c1, c2] = colors.map(|line| &mut line[..width]);
        for (col, &alpha) in alpha.iter().enumerate() {
            let sigma = [xx[col], yy[col], zz[col], xy[col], xz[col], yz[col]];
            let (cofactors, determinant) = adjugate(Self::total(alpha, variance[col], sigma));
            let direction = [direction[0][col], direction[1][col], direction[2][col]];
            let residual = [
                difference[0][col] - alpha * direction[0],
                difference[1][col] - alpha * direction[1],
                difference[2][col] - alpha * direction[2],
            ];
            let scale = alpha / determinant.max(1e-6);
            let solved = product(&cofactors, residual);
            let [mut s0, mut s1, mut s2] = product(&sigma, solved);
            s0 += MIN_SPREAD * solved[0];
            s1 += MIN_SPREAD * solved[1];
            s2 += MIN_SPREAD * solved[2];
            c0[col] = p0[col] + direction[0] + scale * s0;
            c1[col] = p1[col] + direction[1] + scale * s1;
            c2[col] = p2[col] + direction[2] + scale * s2;
        }
    }

    /// Squared distance of the foreground from the background.
    #[inline(always)]
    fn contrast<S: Simd>(&self, _simd: S, contrast: &mut [f32]) {
        let width = contrast.len();
        let [e0, e1, e2] = self.direction.each_ref().map(|line| &line[..width]);
        for (col, contrast) in contrast.iter_mut().enumerate() {
            *contrast = e0[col] * e0[col] + e1[col] * e1[col] + e2[col] * e2[col];
        }
    }

    /// Gaussian likelihood of the difference under the noise and the spread of the foreground, times that of the cue, up to a
    /// factor that all levels of a pixel share. `scratch` has room for a row more than `values`.
    #[inline(always)]
    fn likelihood<S: Simd>(
        &self,
        _simd: S,
        variance: &[f32],
        values: &mut [f32],
        scratch: &mut [f32],
    ) {
        let width = variance.len();
        let [d0, d1, d2] = self.difference.each_ref().map(|line| &line[..width]);
        let [e0, e1, e2] = self.direction.each_ref().map(|line| &line[..width]);
        let [xx, yy, zz, xy, xz, yz] = self.covariance.each_ref().map(|line| &line[..width]);
        let [cue, precision] = self.cue.each_ref().map(|line| &line[..width]);
        let (largest, densities) = scratch.split_at_mut(width);
        largest.fill(f32::NEG_INFINITY);
        for level in 0..LEVELS {
            let alpha = level as f32 * STEP;
            let exponent = &mut values[level * width..][..width];
            let density = &mut densities[level * width..][..width];
            for col in 0..width {
                let sigma = [xx[col], yy[col], zz[col], xy[col], xz[col], yz[col]];
                let (cofactors, determinant) = adjugate(Self::total(alpha, variance[col], sigma));
                let residual = [
                    d0[col] - alpha * e0[col],
                    d1[col] - alpha * e1[col],
                    d2[col] - alpha * e2[col],
                ];
                let [r0, r1, r2] = residual;
                let [s0, s1, s2] = product(&cofactors, residual);
                let inverse = 1.0 / determinant.max(1e-6);
                let off = alpha - cue[col];
                let square = (r0 * s0 + r1 * s1 + r2 * s2) * inverse;
                exponent[col] = -0.5 * (square + off * off * precision[col]);
                density[col] = inverse.sqrt();
                largest[col] = largest[col].max(exponent[col]);
            }
        }
        for level in 0..LEVELS {
            let density = &densities[level * width..][..width];
            let out = &mut values[level * width..][..width];
            for ((out, density), largest) in out.iter_mut().zip(density).zip(&*largest) {
                *out = exp(*out - largest) * density;
            }
        }
    }
}

#[inline(always)]
fn subtract<S: Simd>(_simd: S, a: &[f32], b: &[f32], out: &mut [f32]) {
    for (out, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
        *out = a - b;
    }
}

#[inline(always)]
fn subtract_from<S: Simd>(_simd: S, a: &mut [f32], b: &[f32]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a -= b;
    }
}
