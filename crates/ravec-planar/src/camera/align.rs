//! Robust direct alignment of a picture to a template.
//!
//! ```text
//! for each level from coarse to fine, until it settles:
//!     residual of each sample: (picture at the image of its place − bias) / gain − luma of the template
//!     scale: 1.25 · the mean absolute residual of the block that two fifths of the blocks fit better than
//!     weight: Tukey's of the residual, times that of its block by the mean of its clipped residuals
//!     step of gain, bias and motion by the weighted normal equations; compose the motion with the inverse step
//! ```
//!
//! Source: Baker and Matthews, "Lucas-Kanade 20 years on", 2004 (the inverse compositional form). We differ in: robust
//! weights, for which the matrix is summed anew in each step.
//!
//! The covariance is that of the sandwich over blocks, H⁻¹ (Σ s sᵀ) H⁻¹ with the score s of a block: residuals of neighbors
//! are not independent, and the plain σ² H⁻¹ is several times too small.

use crate::camera::picture::{Frame, Picture};
use crate::camera::template::{LIGHT, Level, Row, Template, UNKNOWNS};
use glam::{DMat3, DVec2};
use ravec_numeric::solve_positive;
use ravec_raster::Plane;

/// Light and motion between a template and a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    /// Normalized coordinates of the picture from those of the template.
    pub picture_from_template: DMat3,
    pub gain: f64,
    pub bias: f64,
}

impl Pose {
    pub fn still() -> Self {
        Self::from_motion(DMat3::IDENTITY)
    }

    pub fn from_motion(picture_from_template: DMat3) -> Self {
        Self {
            picture_from_template,
            gain: 1.0,
            bias: 0.0,
        }
    }
}

/// An alignment.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub pose: Pose,
    /// Share of the textured blocks in view that look alike.
    pub share: f64,
    /// Textured blocks in view, as a share of all blocks.
    pub judged: f64,
    /// Share of the samples in view.
    pub overlap: f64,
    /// Robust deviation of the residuals, in luma of the template.
    pub sigma: f64,
    /// Standard deviation of the corners, in working pixels.
    pub corner_sigma: f64,
    /// The residuals' deviation as a share of that of the luma.
    pub noise: f64,
}

/// Tukey's constant: 95 % efficiency with Gaussian noise.
const TUKEY: f32 = 4.685;

/// The scale is that of the block at this place among all, the best first. The median of all residuals would be that of the
/// foreground as soon as it covers two fifths.
const SCALE_QUANTILE: f32 = 0.4;

/// The scale of residuals never falls below this (0.4 of 255 steps): rounding of 8 bits alone makes as much.
const MIN_SIGMA: f32 = 0.0015;

/// Range of the gain. A picture whose contrast falls below a third is a fade, not an exposure.
const GAIN: [f64; 2] = [0.3, 3.0];

/// Steps at a level. Most settle in three.
const MAX_STEPS: usize = 8;

/// A level has settled when the corners move by less, in pixels of the level, at the finest level and at others. The next step
/// would be a fraction of it.
const SETTLED_PX: [f64; 2] = [0.008, 0.05];

/// Residuals up to these count in the first steps from afar, however small the median: where little texture stands before a
/// plain background, the median knows only noise.
const FAR_LIMIT: [f32; 2] = [0.06, 0.03];

/// A step that moves the corners by more than this share of half the diagonal has diverged.
const MAX_STEP: f64 = 0.5;

/// Correlation from which a block looks alike. Noise, blur and reflections lower it; chance rarely reaches it.
const MIN_CORRELATION: f32 = 0.65;

/// Samples in view below which a block is not judged.
const MIN_BLOCK_SAMPLES: usize = 12;

/// Deviation of luma below which a block is plain.
const MIN_CONTRAST: f32 = 0.008;

/// Two motions look different in a block if their difference has at least this part of the energy of the noise, and they are
/// distinguished by at least the second number of blocks.
const MIN_CHANGE: f32 = 0.1;
const MIN_EVIDENCE: usize = 3;

/// Weak prior of a step's deviation, in half diagonals: what nothing determines stays where it is.
const PRIOR: f64 = 0.3;

/// Scratch memory of an alignment.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    /// Residuals in luma of the template; NaN out of view.
    residuals: Vec<f32>,
    sorted: Vec<f32>,
    other: Vec<f32>,
}

/// The map of normalized coordinates that a vector of unknowns stands for.
pub(super) fn increment(step: &[f64; UNKNOWNS]) -> DMat3 {
    let [_, _, tx, ty, turn, zoom, stretch, shear, px, py] = *step;
    DMat3::from_cols_array(&[
        1.0 + zoom + stretch,
        turn + shear,
        -px,
        shear - turn,
        1.0 + zoom - stretch,
        -py,
        tx,
        ty,
        1.0,
    ])
}

/// Improves a pose at the levels above the finest, from `coarsest` down, with at most a shift, a turn and a zoom: few pixels
/// determine few numbers, and the rest changes little from frame to frame. Nothing if it diverges.
pub(super) fn approach(
    template: &Template,
    picture: &Picture,
    start: Pose,
    unknowns: usize,
    scratch: &mut Scratch,
) -> Option<Pose> {
    let mut pose = start;
    for (index, level) in template.levels.iter().enumerate().skip(1).rev() {
        let plane = &picture.levels[index];
        if index + 1 == template.levels.len() {
            for _ in 0..2 {
                step(level, plane, &mut pose, 2, FAR_LIMIT[0], scratch)?;
            }
        }
        settle(level, plane, &mut pose, unknowns.min(4), true, scratch)?;
    }
    Some(pose)
}

/// Aligns `picture` to the finest level of `template` with a motion of `unknowns` (2, 4, 6 or 8) numbers beyond the start,
/// which is `far` if residuals may come from the motion that is still to be found. Nothing if it diverges.
pub(super) fn align(
    template: &Template,
    picture: &Picture,
    start: Pose,
    unknowns: usize,
    far: bool,
    scratch: &mut Scratch,
) -> Option<Fit> {
    let (level, plane) = (&template.levels[0], &picture.levels[0]);
    let mut pose = start;
    let corner_sigma = settle(level, plane, &mut pose, unknowns, far, scratch)?;
    let sigma = residuals(level, plane, &pose, scratch)?;
    Some(judge(level, pose, sigma, corner_sigma, scratch))
}

/// Steps until the corners hardly move; the standard deviation of the corners.
fn settle(
    level: &Level,
    plane: &Plane,
    pose: &mut Pose,
    unknowns: usize,
    far: bool,
    scratch: &mut Scratch,
) -> Option<f64> {
    let settled_px = SETTLED_PX[usize::from(!level.local_bias)];
    let mut corner_sigma = f64::INFINITY;
    for index in 0..MAX_STEPS {
        let floor = FAR_LIMIT.get(index).filter(|_| far).copied().unwrap_or(0.0);
        let (moved, sigma) = step(level, plane, pose, unknowns, floor, scratch)?;
        corner_sigma = sigma;
        if moved * level.frame.half < settled_px && (!far || index > 0) {
            break;
        }
    }
    Some(corner_sigma)
}

/// Misfit of a pose at a level, 0 to 1: the mean over blocks of the residuals, clipped at the contrast of the block. All
/// blocks have the same say, or an object of high contrast would outvote a plain background.
pub(super) fn cost(level: &Level, plane: &Plane, pose: &Pose, scratch: &mut Scratch) -> f64 {
    if residuals(level, plane, pose, scratch).is_none() {
        return 1.0;
    }
    let mut total = 0.0;
    for block in &level.blocks {
        let values = &level.values[block.start..block.end];
        let residuals = &mut scratch.residuals[block.start..block.end];
        let n = values.len() as f32;
        let mean = values.iter().sum::<f32>() / n;
        let contrast = values.iter().map(|v| (v - mean).abs()).sum::<f32>() / n;
        center(residuals);
        let limit = contrast.max(2.0 * MIN_SIGMA).recip();
        // what is out of view counts as half wrong, or a shift that leaves nothing would be best
        let clipped = |r: &f32| {
            if r.is_nan() {
                0.5
            } else {
                (r.abs() * limit).min(1.0)
            }
        };
        total += residuals.iter().map(clipped).sum::<f32>() / n;
    }
    f64::from(total) / level.blocks.len().max(1) as f64
}

/// Fills the residuals and returns their robust deviation; nothing if too few samples are in view.
fn residuals(level: &Level, plane: &Plane, pose: &Pose, scratch: &mut Scratch) -> Option<f32> {
    let m = pose.picture_from_template;
    // straight to pixels, relative to the center of the first one
    let to_pixels = DMat3::from_translation(level.frame.center - 0.5)
        * DMat3::from_scale(DVec2::splat(level.frame.half));
    let m = (to_pixels * m).to_cols_array().map(|v| v as f32);
    let (width, height) = (plane.width(), plane.height());
    let pixels = plane.pixels();
    let (right, bottom) = (width as f32 - 1.0, height as f32 - 1.0);
    let inverse_gain = (pose.gain as f32).recip();
    let offset = level.mean + pose.bias as f32;
    scratch.residuals.clear();
    let found = level.places.iter().zip(&level.values).map(|(&[u, v], t)| {
        let z = m[2] * u + m[5] * v + m[8];
        let x = (m[0] * u + m[3] * v + m[6]) / z;
        let y = (m[1] * u + m[4] * v + m[7]) / z;
        // also refuses what is not a number
        let inside = z > 0.01 && x >= 0.0 && y >= 0.0 && x < right && y < bottom;
        if !inside {
            return f32::NAN;
        }
        let (col, row) = (x as u32, y as u32);
        let (tx, ty) = (x - col as f32, y - row as f32);
        let at = row as usize * width + col as usize;
        let (upper, lower) = (&pixels[at..at + 2], &pixels[at + width..at + width + 2]);
        let top = upper[0] + tx * (upper[1] - upper[0]);
        let low = lower[0] + tx * (lower[1] - lower[0]);
        (top + ty * (low - top) - offset) * inverse_gain - t
    });
    scratch.residuals.extend(found);
    if level.local_bias {
        for block in &level.blocks {
            center(&mut scratch.residuals[block.start..block.end]);
        }
    }
    scratch.sorted.clear();
    for block in &level.blocks {
        let (mut sum, mut count) = (0.0, 0);
        for r in &scratch.residuals[block.start..block.end] {
            if !r.is_nan() {
                sum += r.abs();
                count += 1;
            }
        }
        if count >= MIN_BLOCK_SAMPLES {
            scratch.sorted.push(sum / count as f32);
        }
    }
    if scratch.sorted.is_empty() {
        return None;
    }
    let place = (SCALE_QUANTILE * scratch.sorted.len() as f32) as usize;
    let (_, mean, _) = scratch.sorted.select_nth_unstable_by(place, f32::total_cmp);
    Some((1.25 * *mean).max(MIN_SIGMA))
}

/// Subtracts the mean of the residuals in view, those far off clipped.
fn center(residuals: &mut [f32]) {
    let mean_of = |value: &dyn Fn(f32) -> f32| {
        let (mut sum, mut count) = (0.0, 0);
        for &r in residuals.iter().filter(|r| !r.is_nan()) {
            sum += value(r);
            count += 1;
        }
        sum / count.max(1) as f32
    };
    let mean = mean_of(&|r| r);
    let reach = 1.5 * mean_of(&|r| (r - mean).abs());
    let bias = mean + mean_of(&|r| (r - mean).clamp(-reach, reach));
    for r in residuals.iter_mut() {
        *r -= bias;
    }
}

/// The evidence of a block, for the motion of a fit and against another motion of the same template, −1 to 1: where between the
/// two the truth lies, seen from the middle.
fn block_evidence(fitted: &[f32], other: &[f32], limit: f32) -> Option<f32> {
    let (mut gain, mut square, mut noise, mut count) = (0.0, 0.0, 0.0, 0);
    for (&f, &o) in fitted.iter().zip(other) {
        let outside = f.is_nan() || o.is_nan();
        if outside || f.abs().min(o.abs()) >= limit {
            continue;
        }
        gain += o * o - f * f;
        square += (o - f) * (o - f);
        noise += f * f;
        count += 1;
    }
    let visible = square > MIN_CHANGE * noise.max(count as f32 * MIN_SIGMA * MIN_SIGMA);
    (count >= MIN_BLOCK_SAMPLES && visible).then(|| (gain / square).clamp(-1.0, 1.0))
}

/// The mean evidence of the blocks in which two motions look different, −1 to 1, for `fitted` and against `other`; nothing if
/// there are too few such blocks, so that the motions cannot be told apart.
///
/// A block that shows noise e under the right motion shows e − s under the other one, where s is the difference of the two:
/// (Σ (e − s)² − Σ e²) / Σ s² is 1 but for noise, and −1 if the other one is right. A wrong motion that shadows or compression
/// feign is one that only weakly textured blocks ask for; here the sharp ones have the same say.
pub(super) fn evidence(
    template: &Template,
    picture: &Picture,
    fitted: &Pose,
    other: &Pose,
    scratch: &mut Scratch,
) -> Option<Evidence> {
    let (level, plane) = (&template.levels[0], &picture.levels[0]);
    let sigma = residuals(level, plane, fitted, scratch)?;
    let mut best = std::mem::take(&mut scratch.other);
    best.clone_from(&scratch.residuals);
    let seen = residuals(level, plane, other, scratch);
    let (mut sum, mut count) = (0.0, 0);
    for block in &level.blocks {
        let range = block.start..block.end;
        let (fitted, other) = (&best[range.clone()], &scratch.residuals[range]);
        if let Some(found) = block_evidence(fitted, other, TUKEY * sigma) {
            sum += f64::from(found);
            count += 1;
        }
    }
    scratch.other = best;
    seen?;
    let enough = count >= MIN_EVIDENCE.max(level.block_count / 50);
    enough.then(|| Evidence {
        mean: sum / count as f64,
        blocks: count,
    })
}

/// Evidence for a motion and against another one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evidence {
    /// The mean over blocks, −1 to 1.
    pub mean: f64,
    /// Blocks in which the motions look different.
    pub blocks: usize,
}

type Matrix = [[f64; UNKNOWNS]; UNKNOWNS];

/// Weighted normal equations, and the sum of the squares of the blocks' scores.
struct Sums {
    matrix: Matrix,
    right: [f64; UNKNOWNS],
    scores: Matrix,
}

/// One step of light and `unknowns` numbers of motion: how far the corners move at most (in half diagonals), and the
/// standard deviation of the corners (in pixels of the level).
fn step(
    level: &Level,
    plane: &Plane,
    pose: &mut Pose,
    unknowns: usize,
    min_limit: f32,
    scratch: &mut Scratch,
) -> Option<(f64, f64)> {
    let sigma = residuals(level, plane, pose, scratch)?;
    let limit = (TUKEY * sigma).max(min_limit);
    let seen = &scratch.residuals;
    let sums = match unknowns {
        2 => accumulate::<4>(level, seen, limit),
        4 => accumulate::<6>(level, seen, limit),
        6 => accumulate::<8>(level, seen, limit),
        _ => accumulate::<UNKNOWNS>(level, seen, limit),
    };
    let mut matrix = sums.matrix;
    let prior = (f64::from(sigma) / PRIOR).powi(2);
    for (k, row) in matrix.iter_mut().enumerate() {
        row[k] += if k < LIGHT { 1e-6 } else { prior };
    }
    let found = solve(&matrix, &sums.right, unknowns)?;
    let moved = increment(&found);
    let apply = |m: &DMat3, p: DVec2| {
        let image = *m * p.extend(1.0);
        image.truncate() / image.z
    };
    let corners = level.frame.corners();
    let farthest = corners
        .iter()
        .map(|&p| apply(&moved, p).distance(p))
        .fold(0.0, f64::max);
    if farthest.is_nan() || farthest > MAX_STEP {
        return None;
    }
    let composed = pose.picture_from_template * moved.inverse();
    if !composed.is_finite() || composed.z_axis.z <= 0.0 {
        return None;
    }
    pose.picture_from_template = composed * composed.z_axis.z.recip();
    pose.bias += pose.gain * found[1];
    pose.gain = (pose.gain * (1.0 + found[0])).clamp(GAIN[0], GAIN[1]);
    let corner_sigma = corner_sigma(&matrix, &sums.scores, level.frame, unknowns)?;
    Some((farthest, corner_sigma))
}

/// The sums for the first `N` unknowns; of the matrices only the lower triangle is filled.
fn accumulate<const N: usize>(level: &Level, residuals: &[f32], limit: f32) -> Sums {
    let inverse = limit.recip();
    let mut sums = Sums {
        matrix: [[0.0; UNKNOWNS]; UNKNOWNS],
        right: [0.0; UNKNOWNS],
        scores: [[0.0; UNKNOWNS]; UNKNOWNS],
    };
    for block in &level.blocks {
        let range = block.start..block.end;
        let trust = trust(&residuals[range.clone()], limit);
        if trust <= 0.0 {
            continue;
        }
        let mut part: [Row; N] = [[0.0; 12]; N];
        let mut score: [f32; N] = [0.0; N];
        for (row, &r) in level.rows[range.clone()].iter().zip(&residuals[range]) {
            let t = r * inverse;
            let bend = 1.0 - t * t;
            // also skips what is out of view
            if bend > 0.0 {
                add(&mut part, &mut score, row, trust * bend * bend, r);
            }
        }
        if level.local_bias {
            eliminate_bias(&mut part, &mut score);
        }
        for i in 0..N {
            sums.right[i] += f64::from(score[i]);
            for j in 0..=i {
                sums.matrix[i][j] += f64::from(part[i][j]);
                sums.scores[i][j] += f64::from(score[i]) * f64::from(score[j]);
            }
        }
    }
    sums
}

/// Adds a weighted sample to the sums of a block: of the matrix the lower triangle, in whole vectors of four.
#[inline(always)]
fn add<const N: usize>(
    part: &mut [Row; N],
    score: &mut [f32; N],
    row: &Row,
    weight: f32,
    residual: f32,
) {
    for i in 0..N {
        let factor = weight * row[i];
        for j in 0..(i / 4 + 1) * 4 {
            part[i][j] += factor * row[j];
        }
        score[i] += factor * residual;
    }
}

/// Takes out of the sums of a block what a bias of its own would explain.
fn eliminate_bias<const N: usize>(part: &mut [Row; N], score: &mut [f32; N]) {
    let weight = part[1][1];
    if weight <= 0.0 {
        return;
    }
    let of_bias = score[1];
    let column: [f32; N] = std::array::from_fn(|i| if i == 0 { part[1][0] } else { part[i][1] });
    for i in 0..N {
        let factor = column[i] / weight;
        for j in 0..=i {
            part[i][j] -= factor * column[j];
        }
        score[i] -= factor * of_bias;
    }
}

/// The weight of a block, 0 to 1, by the mean of its clipped residuals: a moving object has some samples that fit by
/// chance, and they would pull.
fn trust(residuals: &[f32], limit: f32) -> f32 {
    let (mut sum, mut count) = (0.0, 0);
    for r in residuals.iter().filter(|r| !r.is_nan()) {
        sum += (r.abs() / limit).min(1.0);
        count += 1;
    }
    if count == 0 {
        return 0.0;
    }
    // Gaussian noise has a mean of 0.17
    (1.0 - (sum / count as f32 - 0.3).max(0.0) / 0.4).max(0.0)
}

/// Solves for light and the first `unknowns` numbers of motion; the others are 0.
fn solve(matrix: &Matrix, right: &[f64; UNKNOWNS], unknowns: usize) -> Option<[f64; UNKNOWNS]> {
    fn part<const N: usize>(matrix: &Matrix, right: &[f64; UNKNOWNS]) -> Option<[f64; UNKNOWNS]> {
        let small: [[f64; N]; N] = std::array::from_fn(|i| std::array::from_fn(|j| matrix[i][j]));
        let found = solve_positive(&small, &std::array::from_fn(|i| right[i]))?;
        let mut all = [0.0; UNKNOWNS];
        all[..N].copy_from_slice(&found);
        Some(all)
    }
    match unknowns {
        2 => part::<4>(matrix, right),
        4 => part::<6>(matrix, right),
        6 => part::<8>(matrix, right),
        _ => part::<10>(matrix, right),
    }
}

/// The root of the mean variance of the corners' places, in pixels of the level.
fn corner_sigma(matrix: &Matrix, scores: &Matrix, frame: Frame, unknowns: usize) -> Option<f64> {
    let mut total = 0.0;
    for corner in frame.corners() {
        let (u, v) = (corner.x, corner.y);
        let along = [
            [0.0, 0.0, 1.0, 0.0, -v, u, u, v, u * u, u * v],
            [0.0, 0.0, 0.0, 1.0, u, v, -v, u, u * v, v * v],
        ];
        for derivative in along {
            // unknowns that are not solved for stay out: the solution has zeros there
            let x = solve(matrix, &derivative, unknowns)?;
            for i in 0..UNKNOWNS {
                for j in 0..UNKNOWNS {
                    total += x[i] * scores[i.max(j)][i.min(j)] * x[j];
                }
            }
        }
    }
    Some((0.25 * total).max(0.0).sqrt() * frame.half)
}

/// Compares block by block what the samples of the template and of the picture look like.
fn judge(level: &Level, pose: Pose, sigma: f32, corner_sigma: f64, scratch: &Scratch) -> Fit {
    let floor = MIN_CONTRAST.max(sigma.min(4.0 * MIN_CONTRAST));
    let (mut visible, mut judged, mut good) = (0, 0usize, 0usize);
    for block in &level.blocks {
        let range = block.start..block.end;
        let pairs = level.values[range.clone()]
            .iter()
            .zip(&scratch.residuals[range]);
        let (mut n, mut sum) = (0, [0.0f32; 5]);
        for (&t, &r) in pairs.filter(|(_, r)| !r.is_nan()) {
            let p = t + r;
            n += 1;
            for (sum, value) in sum.iter_mut().zip([t, p, t * t, p * p, t * p]) {
                *sum += value;
            }
        }
        visible += n;
        let [t, p, tt, pp, tp] = sum.map(|s| s / n.max(1) as f32);
        let (var_t, var_p) = (tt - t * t, pp - p * p);
        if n >= MIN_BLOCK_SAMPLES && var_t > floor * floor {
            let product = (var_t * var_p.max(1e-9)).sqrt();
            judged += 1;
            good += usize::from((tp - t * p) / product >= MIN_CORRELATION);
        }
    }
    let square: f32 = level.values.iter().map(|v| v * v).sum();
    let contrast = (square / level.values.len().max(1) as f32).sqrt();
    Fit {
        pose,
        share: good as f64 / judged.max(1) as f64,
        judged: judged as f64 / level.block_count as f64,
        overlap: visible as f64 / level.values.len().max(1) as f64,
        sigma: f64::from(sigma),
        corner_sigma,
        noise: f64::from(sigma / contrast.max(MIN_SIGMA)),
    }
}
