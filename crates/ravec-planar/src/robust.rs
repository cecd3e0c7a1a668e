//! The homography that most of a contaminated set of pairs agrees on.
//!
//! ```text
//! repeat until it is unlikely that a better model was missed:
//!     draw four pairs, the first of the list first; the homography through them
//!     score it against all pairs, and give up as soon as it cannot win any more
//!     if it is the best so far: improve it by weighted least squares over all pairs
//! find the noise from the residuals, and fit the inliers
//! ```
//!
//! Departures from the plain idea: (1) samples whose four points cannot be seen by one camera are refused by signs of areas,
//! before anything is computed; (2) no threshold decides who is an inlier, see `magsac`; (3) the residual is the
//! first-order distance of a pair to the nearest pair that fits perfectly, so that noise on both sides counts rightly.
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers.
//!
//! Sources: Chum and Matas, "Matching with PROSAC", 2005 (order of samples); Chum, Matas and Kittler, "Locally optimized
//! RANSAC", 2003; Barath et al., "MAGSAC++", 2020 (scores and weights); Hartley and Zisserman, section 4.2.6 (distance).
//!
//! Guarantees: equal pairs, parameters and seed give equal bytes. Does not guarantee: that the consensus is the right one
//! when another plane has more pairs.
//! Cost: samples × pairs, typically some hundred samples; memory a few numbers a pair.

use crate::estimate::{Frames, PointPair, matrix_of, unknowns_of};
use crate::homography::{Homography, HomographyError};
use crate::magsac::{K_SQ, Kernel};
use crate::random::SplitMix;
use glam::{DMat2, DMat3, DVec2};
use ravec_numeric::NormalEquations;
use serde::{Deserialize, Serialize};

/// Parameters of the fit to contaminated pairs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RobustParams {
    /// The largest standard deviation of the noise of a coordinate that is thought possible, in pixels, above 0
    /// (default 2.5). Pairs off by more than three times as much have no say. Larger forgives a plane that is not quite
    /// one; smaller distinguishes close outliers.
    pub max_sigma_px: f64,
    /// Probability with which a sample without outliers is drawn, below 1 (default 0.9999). More draws more.
    pub confidence: f64,
    /// Samples after which the search ends in any case, at least 1 (default 20 000). With a tenth of inliers among the
    /// pairs, that is how many it takes for a confidence of 0.86.
    pub max_samples: usize,
    /// Pairs that must agree, at least 5 (default 8). With fewer, chance finds models in unrelated points.
    pub min_inliers: usize,
    /// Seed of the samples (default 0).
    pub seed: u64,
}

impl Default for RobustParams {
    fn default() -> Self {
        Self {
            max_sigma_px: 2.5,
            confidence: 0.9999,
            max_samples: 20_000,
            min_inliers: 8,
            seed: 0,
        }
    }
}

/// The model that most of the contaminated pairs agree on.
#[derive(Debug, Clone, PartialEq)]
pub struct RobustFit {
    /// The homography.
    pub dst_from_src: Homography,
    /// For each pair whether it fits: within three standard deviations of the noise that was found.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub inlier_count: usize,
    /// The standard deviation of the noise of a coordinate, estimated from the inliers, in pixels.
    pub sigma_px: f64,
    /// Number of samples drawn.
    pub samples: usize,
}

/// Improvements of a new best model before the search goes on. More find the optimum of its neighborhood more exactly, but
/// the last one is polished to the end anyway.
const LOCAL_STEPS: usize = 3;

/// Steps of the last fit. It ends when the inliers settle, usually after four.
const FINAL_STEPS: usize = 12;

/// The noise is not believed to be below this, in pixels: rounded coordinates would make it zero.
const MIN_SIGMA_PX: f64 = 1e-3;

/// Pairs scored before it is asked whether the model can still win.
const BATCH: usize = 128;

/// The homography that most `pairs` agree on. They should come best first: the earlier are drawn earlier, which makes the
/// search quicker but does not change what counts as agreement.
///
/// # Errors
/// [`HomographyError::TooFew`], [`HomographyError::NonFinite`], [`HomographyError::NoConsensus`] if no homography explains
/// [`RobustParams::min_inliers`] pairs, [`HomographyError::Degenerate`] if those that agree lie on a line.
///
/// ```
/// use glam::dvec2;
/// use ravec_planar::{Homography, PointPair, RobustParams, estimate_robust};
///
/// let shift = dvec2(12.0, -5.0);
/// let mut pairs: Vec<_> = (0..40)
///     .map(|i| dvec2((i * 37 % 100) as f64, (i * 53 % 90) as f64))
///     .map(|p| PointPair::new(p, p + shift))
///     .collect();
/// // every other pair is wrong
/// for (i, pair) in pairs.iter_mut().enumerate().step_by(2) {
///     pair.dst = dvec2((i * 71 % 97) as f64, (i * 29 % 83) as f64);
/// }
/// let found = estimate_robust(&pairs, &RobustParams::default())?;
/// assert!(found.dst_from_src.apply(dvec2(50.0, 50.0)).distance(dvec2(62.0, 45.0)) < 1e-6);
/// assert_eq!(found.inlier_count, 20);
/// # Ok::<(), ravec_planar::HomographyError>(())
/// ```
pub fn estimate_robust(
    pairs: &[PointPair],
    params: &RobustParams,
) -> Result<RobustFit, HomographyError> {
    let frames = Frames::of(pairs)?;
    let kernel = Kernel::new(params.max_sigma_px.max(MIN_SIGMA_PX));
    let needed = params.min_inliers.max(5);
    let mut sampler = Sampler::new(pairs.len(), params);
    let mut residuals = vec![0.0; pairs.len()];
    let mut best: Option<(Homography, f64)> = None;
    let mut fewest_samples = params.max_samples.max(1);
    let mut samples = 0;
    while samples < fewest_samples {
        samples += 1;
        let Some(model) = sampler.next_model(pairs) else {
            continue;
        };
        let to_beat = best.map_or(0.0, |(_, score)| score);
        let Some(score) = score(&model, pairs, &kernel, to_beat) else {
            continue;
        };
        // new best: climb
        let (mut model, mut score_now) = (model, score);
        for _ in 0..LOCAL_STEPS {
            residuals_sq(&model, pairs, &mut residuals);
            let Some(next) = weighted_step(&model, pairs, &frames, |i| kernel.weight(residuals[i]))
            else {
                break;
            };
            match self::score(&next, pairs, &kernel, score_now) {
                Some(better) => (model, score_now) = (next, better),
                None => break,
            }
        }
        best = Some((model, score_now));
        residuals_sq(&model, pairs, &mut residuals);
        let inliers = residuals
            .iter()
            .filter(|&&r| r < kernel.cutoff_sq())
            .count();
        fewest_samples =
            fewest_samples.min(samples_needed(inliers, pairs.len(), params.confidence));
    }
    let none = HomographyError::NoConsensus {
        inliers: 0,
        pairs: pairs.len(),
        needed,
    };
    let (model, _) = best.ok_or(none)?;
    let fit = polish(model, pairs, &frames, &kernel, &mut residuals, samples);
    if fit.inlier_count < needed {
        return Err(HomographyError::NoConsensus {
            inliers: fit.inlier_count,
            pairs: pairs.len(),
            needed,
        });
    }
    check_spread(&fit, pairs)?;
    Ok(fit)
}

/// Samples after which, with this many inliers, a sample of four of them was drawn with the given confidence.
fn samples_needed(inliers: usize, pairs: usize, confidence: f64) -> usize {
    let good = (inliers as f64 / pairs as f64).powi(4);
    let needed =
        (1.0 - confidence).max(f64::MIN_POSITIVE).ln() / (1.0 - good).max(f64::MIN_POSITIVE).ln();
    if needed.is_nan() {
        usize::MAX
    } else {
        needed.ceil().max(1.0) as usize
    }
}

/// Draws samples of four from a growing head of the list, as PROSAC does.
struct Sampler {
    random: SplitMix,
    pairs: usize,
    /// Samples drawn so far, the head they come from, and how many samples that head is good for.
    drawn: usize,
    head: usize,
    head_ends: usize,
    /// Expected number of [`RobustParams::max_samples`] uniform samples that fall into the head.
    expected: f64,
}

impl Sampler {
    fn new(pairs: usize, params: &RobustParams) -> Self {
        let share: f64 = (0..4)
            .map(|i| (4 - i) as f64 / (pairs - i) as f64)
            .product();
        Self {
            random: SplitMix::new(params.seed),
            pairs,
            drawn: 0,
            head: 4,
            head_ends: 1,
            expected: params.max_samples as f64 * share,
        }
    }

    fn next_sample(&mut self) -> [usize; 4] {
        self.drawn += 1;
        while self.drawn > self.head_ends && self.head < self.pairs {
            let grown = self.expected * (self.head + 1) as f64 / (self.head + 1 - 4) as f64;
            self.head_ends += (grown - self.expected).ceil().max(1.0) as usize;
            self.expected = grown;
            self.head += 1;
        }
        if self.drawn > self.head_ends {
            return self.random.distinct(self.pairs);
        }
        // the newest pair of the head and three others
        let [a, b, c] = if self.head > 4 {
            self.random.distinct(self.head - 1)
        } else {
            [0, 1, 2]
        };
        [a, b, c, self.head - 1]
    }

    /// The homography through the next four pairs, if one camera could have seen them.
    fn next_model(&mut self, pairs: &[PointPair]) -> Option<Homography> {
        let chosen = self.next_sample().map(|i| pairs[i]);
        let (src, dst) = (chosen.map(|pair| pair.src), chosen.map(|pair| pair.dst));
        if !same_turns(&src, &dst) {
            return None;
        }
        Homography::from_pairs(&src, &dst).ok()
    }
}

/// Returns `true` if all triangles of the four points turn the same way on both sides, or all the other way (a mirror),
/// and none is a sliver, whose height noise would decide.
fn same_turns(src: &[DVec2; 4], dst: &[DVec2; 4]) -> bool {
    const TRIANGLES: [[usize; 3]; 4] = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
    // a height of 1.5 % of the longer sides
    const MIN_SINE: f64 = 0.015;
    let turn = |p: &[DVec2; 4], [a, b, c]: [usize; 3]| {
        let (u, v) = (p[b] - p[a], p[c] - p[a]);
        let area = u.perp_dot(v);
        let reach = u.length_squared().max(v.length_squared());
        if area.abs() > MIN_SINE * reach {
            area
        } else {
            0.0
        }
    };
    let products = TRIANGLES.map(|t| turn(src, t) * turn(dst, t));
    products.iter().all(|&p| p > 0.0) || products.iter().all(|&p| p < 0.0)
}

/// The squared first-order distance of a pair to the nearest pair that fits: the residual dᵀ(I + AAᵀ)⁻¹d, with d the
/// distance in dst and A the local map. Infinite behind the horizon.
#[inline(always)]
fn residual_sq(matrix: &DMat3, pair: &PointPair) -> f64 {
    let image = *matrix * pair.src.extend(1.0);
    let inverse = 1.0 / image.z;
    let mapped = image.truncate() * inverse;
    let off = pair.dst - mapped;
    // rows of A
    let (x, y) = (matrix.x_axis, matrix.y_axis);
    let (a, b) = (
        (x.x - mapped.x * x.z) * inverse,
        (y.x - mapped.x * y.z) * inverse,
    );
    let (c, d) = (
        (x.y - mapped.y * x.z) * inverse,
        (y.y - mapped.y * y.z) * inverse,
    );
    let (p, q, r) = (1.0 + a * a + b * b, a * c + b * d, 1.0 + c * c + d * d);
    let square =
        (r * off.x * off.x - 2.0 * q * off.x * off.y + p * off.y * off.y) / (p * r - q * q);
    if image.z > 0.0 { square } else { f64::INFINITY }
}

fn residuals_sq(model: &Homography, pairs: &[PointPair], out: &mut [f64]) {
    let matrix = model.matrix();
    for (out, pair) in out.iter_mut().zip(pairs) {
        *out = residual_sq(&matrix, pair);
    }
}

/// The sum of the pairs' gains, if it is above `to_beat`. Sums in a fixed order.
fn score(model: &Homography, pairs: &[PointPair], kernel: &Kernel, to_beat: f64) -> Option<f64> {
    let matrix = model.matrix();
    let mut sum = 0.0;
    let mut left = pairs.len();
    for batch in pairs.chunks(BATCH) {
        left -= batch.len();
        for pair in batch {
            sum += kernel.gain(residual_sq(&matrix, pair));
        }
        if sum + left as f64 <= to_beat {
            return None;
        }
    }
    (sum > to_beat).then_some(sum)
}

/// One step of weighted least squares on the first-order distance.
fn weighted_step(
    model: &Homography,
    pairs: &[PointPair],
    frames: &Frames,
    weight: impl Fn(usize) -> f64,
) -> Option<Homography> {
    let matrix = frames.apply(&model.matrix());
    let matrix = matrix * matrix.z_axis.z.recip();
    let mut sum = NormalEquations::default();
    // noise is equal on both sides in pixels, not in the frames
    let noise = frames.noise_ratio_sq();
    for (index, pair) in pairs.iter().enumerate() {
        let weight = weight(index);
        if weight <= 0.0 {
            continue;
        }
        let PointPair { src, dst } = frames.normalized(pair);
        let image = matrix * src.extend(1.0);
        let mapped = image.truncate() / image.z;
        let off = mapped - dst;
        let local = DMat2::from_cols(
            (matrix.x_axis.truncate() - mapped * matrix.x_axis.z) / image.z,
            (matrix.y_axis.truncate() - mapped * matrix.y_axis.z) / image.z,
        );
        // the lower triangular L with L·Lᵀ = (noise of dst) I + A·Aᵀ; residuals are whitened by its inverse
        let covariance = DMat2::from_diagonal(DVec2::splat(noise)) + local * local.transpose();
        let l00 = covariance.x_axis.x.sqrt();
        let l10 = covariance.x_axis.y / l00;
        let l11 = (covariance.y_axis.y - l10 * l10).sqrt();
        let [x, y, w] = (src.extend(1.0) / image.z).to_array();
        let (u, v) = (mapped.x, mapped.y);
        let by_x = [x, y, w, 0.0, 0.0, 0.0, -u * x, -u * y].map(|value| value / l00);
        let by_y = [0.0, 0.0, 0.0, x, y, w, -v * x, -v * y];
        let by_y = std::array::from_fn(|k| (by_y[k] - l10 * by_x[k]) / l11);
        let off_x = off.x / l00;
        sum.add(off_x, &by_x, weight);
        sum.add((off.y - l10 * off_x) / l11, &by_y, weight);
    }
    let step = sum.step(0.0)?;
    let unknowns = unknowns_of(&matrix);
    let moved = matrix_of(&std::array::from_fn(|k| unknowns[k] + step[k]));
    Homography::from_matrix(frames.undo(moved)).ok()
}

/// The noise from the residuals, the inliers from the noise, the fit from the inliers, until they settle.
fn polish(
    start: Homography,
    pairs: &[PointPair],
    frames: &Frames,
    kernel: &Kernel,
    residuals: &mut [f64],
    samples: usize,
) -> RobustFit {
    let mut model = start;
    let mut inliers: Vec<bool> = Vec::new();
    let mut sigma_px = MIN_SIGMA_PX;
    for _ in 0..FINAL_STEPS {
        residuals_sq(&model, pairs, residuals);
        sigma_px = noise(residuals, kernel);
        let cutoff = K_SQ * sigma_px * sigma_px;
        let next: Vec<bool> = residuals.iter().map(|&r| r < cutoff).collect();
        if next == inliers {
            break;
        }
        inliers = next;
        match weighted_step(&model, pairs, frames, |i| f64::from(u8::from(inliers[i]))) {
            Some(moved) => model = moved,
            None => break,
        }
    }
    residuals_sq(&model, pairs, residuals);
    let cutoff = K_SQ * sigma_px * sigma_px;
    let inliers: Vec<bool> = residuals.iter().map(|&r| r < cutoff).collect();
    RobustFit {
        dst_from_src: model,
        inlier_count: inliers.iter().filter(|&&inlier| inlier).count(),
        inliers,
        sigma_px,
        samples,
    }
}

/// The standard deviation of a coordinate's noise: half of the residuals of two degrees of freedom lie below √(2 ln 2) of
/// it. The median is of those residuals that count at all, less the outliers among them, whose squares are spread evenly.
fn noise(residuals_sq: &[f64], kernel: &Kernel) -> f64 {
    let limit = kernel.cutoff_sq();
    let mut near: Vec<f64> = residuals_sq
        .iter()
        .copied()
        .filter(|&r| r < limit)
        .collect();
    let mut sigma_sq = limit / K_SQ;
    near.sort_unstable_by(f64::total_cmp);
    // each round looks at what the last one took for inliers, and converges from above
    for _ in 0..8 {
        let inside = near.partition_point(|&r| r < K_SQ * sigma_sq);
        if inside == 0 {
            break;
        }
        let median = near[inside / 2];
        let next = median / (2.0 * std::f64::consts::LN_2);
        if next >= sigma_sq {
            break;
        }
        sigma_sq = next;
    }
    sigma_sq.sqrt().max(MIN_SIGMA_PX)
}

/// Refuses inliers along a line: across it their noise decides everything.
fn check_spread(fit: &RobustFit, pairs: &[PointPair]) -> Result<(), HomographyError> {
    let inliers = || {
        pairs
            .iter()
            .zip(&fit.inliers)
            .filter(|(_, inlier)| **inlier)
            .map(|(pair, _)| pair)
    };
    for side in [|pair: &PointPair| pair.src, |pair: &PointPair| pair.dst] {
        let n = fit.inlier_count as f64;
        let center = inliers().map(side).sum::<DVec2>() / n;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for d in inliers().map(side).map(|p| p - center) {
            xx += d.x * d.x / n;
            xy += d.x * d.y / n;
            yy += d.y * d.y / n;
        }
        // the eigenvalues of the covariance: along and across
        let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
        let (along, across) = (mean + half, (mean - half).max(0.0));
        // three times the noise: what a line with noise shows is one
        if across.sqrt() < (3.0 * fit.sigma_px).max(1e-3 * along.sqrt()) {
            return Err(HomographyError::Degenerate {
                ratio: (across / along).sqrt(),
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
