//! Robust direct alignment of the plane in a frame to its template.
//!
//! The values y of the frame at the images of the samples are explained, all at once and by weighted least squares, as
//!
//! ```text
//! y ≈ gain · (T + ∇T · motion) + bias + slope · (u, v) + blur · (T_xx, T_xy, T_yy)
//! ```
//!
//! where T is the template. The motion is undone at the side of the template (the inverse compositional form), so that the
//! columns are the same in every step. The second derivatives stand for the relative blur of the two pictures to second order:
//! of motion, focus and scale, whatever the shutter was.
//!
//! Weights are Tukey's, times a weight for each block of samples by the mean of its clipped residuals: what hides the plane is
//! compact.
//!
//! Source: Baker and Matthews, "Lucas-Kanade 20 years on", 2004. We differ in: the columns for light and blur, and robust
//! weights, for which the matrix is summed anew in each step.

use crate::track::picture::Level;
use crate::track::template::Samples;
use fearless_simd::{Level as SimdLevel, Simd, dispatch};
use glam::{DMat3, DVec2, dvec2};
use ravec_numeric::solve_positive;

/// Motion, light and blur.
pub(super) const MOTION: usize = 8;
const LIGHT: usize = 8;
const BLUR: usize = 12;
pub(super) const COLUMNS: usize = 15;

/// Columns and the values that they explain.
const ALL: usize = COLUMNS + 1;

/// Entries of the upper triangle of the products of columns and values.
const PRODUCTS: usize = ALL * (ALL + 1) / 2;

/// Samples that are worked on at once.
const LANES: usize = 8;

/// Runs of lanes after which single-precision sums are added to double-precision ones.
const RUNS: usize = 48;

pub(super) type Products = [[f64; ALL]; ALL];

/// Tukey's constant: 95 % efficiency with Gaussian noise.
const TUKEY: f32 = 4.685;

/// The scale of residuals is never below half a step of 255: rounding alone makes 0.3.
const MIN_SCALE: f32 = 0.5 / 255.0;

/// Mean clipped residual of a block, as a share of Tukey's limit, up to which it has full weight, and from which it has none.
/// Gaussian residuals have 0.17.
const BLOCK_FIT: [f32; 2] = [0.3, 0.55];

/// The scale is that of the block at this place among all, the best first, if that is less than the scale of all residuals; the
/// factor makes a standard deviation of the mean absolute residual there. Blocks with fewer samples have no say.
const BLOCK_QUANTILE: f32 = 0.35;
const BLOCK_SIGMAS: f32 = 1.35;
const MIN_BLOCK_SAMPLES: f32 = 4.0;

/// Residuals that the scale is made from, at most.
const SCALE_SAMPLES: usize = 4096;

/// Standard deviations of weak priors: of a step of the motion, in units, and of blur in square pixels of the level.
const MOTION_PRIOR: f64 = 0.3;
const BLUR_PRIOR: f64 = 6.0;

/// Share of the samples that must be in view.
const MIN_IN_VIEW: f64 = 0.04;

/// Range of the gain.
const GAIN: [f64; 2] = [0.1, 10.0];

/// The plane in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    /// Pixels of the frame from units of the template, 1 at the lower right.
    pub frame_from_units: DMat3,
    pub light: Light,
    /// Coefficients of the second derivatives, in square pixels of the finest level.
    pub blur: [f64; 3],
}

/// Values of the frame from those of the template: `gain` · T + `bias` + `slope` · (u, v).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Light {
    pub gain: f64,
    pub bias: f64,
    pub slope: [f64; 2],
}

impl Light {
    pub const SAME: Self = Self {
        gain: 1.0,
        bias: 0.0,
        slope: [0.0; 2],
    };
}

impl Pose {
    pub fn new(frame_from_units: DMat3, light: Light) -> Self {
        Self {
            frame_from_units: frame_from_units * frame_from_units.z_axis.z.recip(),
            light,
            blur: [0.0; 3],
        }
    }
}

/// Parameters of a run of steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steps {
    /// Steps at most.
    pub max: usize,
    /// The run ends when the corners move by less, on average, in pixels.
    pub settled_px: f64,
    /// Numbers of the motion that are estimated: 2 for a shift, 4 with a turn and a zoom, 8 for a homography.
    pub motion: usize,
    /// True if blur is estimated.
    pub blur: bool,
    /// True if residuals of the first two steps may come from a motion that is still to be found.
    pub far: bool,
}

/// State after a run of steps.
#[derive(Debug, Clone)]
pub(super) struct Settled {
    /// Products of the last step.
    pub products: Products,
    /// Robust standard deviation of the residuals.
    pub scale: f32,
    /// Solution of the last step.
    pub solution: [f64; COLUMNS],
}

/// Memory of an alignment: per sample.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    /// Values of the frame; NaN out of view.
    pub values: Vec<f32>,
    pub residuals: Vec<f32>,
    /// Weights, 0 out of view.
    pub weights: Vec<f32>,
    sorted: Vec<f32>,
}

/// The map of units that a motion stands for.
pub(super) fn increment(motion: &[f64; MOTION]) -> DMat3 {
    let [tx, ty, turn, zoom, stretch, shear, px, py] = *motion;
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

/// Derivatives of the place `increment(motion) · p` by the motion.
pub(super) fn displacements(p: DVec2) -> [DVec2; MOTION] {
    let (u, v) = (p.x, p.y);
    [
        dvec2(1.0, 0.0),
        dvec2(0.0, 1.0),
        dvec2(-v, u),
        dvec2(u, v),
        dvec2(u, -v),
        dvec2(v, u),
        dvec2(u * u, u * v),
        dvec2(u * v, v * v),
    ]
}

/// Applies a map of which `z` is positive where it may be used.
pub(super) fn project(m: &DMat3, p: DVec2) -> Option<DVec2> {
    let image = *m * p.extend(1.0);
    (image.z > 1e-3).then(|| image.truncate() / image.z)
}

/// The mean distance of the images of points under two maps; infinite if one has its horizon there.
pub(super) fn mean_distance(a: &DMat3, b: &DMat3, points: &[DVec2]) -> f64 {
    let sum: f64 = (points.iter())
        .map(|&p| {
            project(a, p)
                .zip(project(b, p))
                .map_or(f64::INFINITY, |(p, q)| p.distance(q))
        })
        .sum();
    sum / points.len() as f64
}

/// Improves a pose step by step. `corners` are the points, in units, whose motion says if it has settled; `prior` are weights of
/// the blocks in the first step. Nothing if it diverges or too little is in view.
pub(super) fn settle(
    samples: &Samples,
    level: &Level,
    pose: &mut Pose,
    steps: Steps,
    (corners, prior): (&[DVec2], Option<&[f32]>),
    scratch: &mut Scratch,
) -> Option<Settled> {
    let mut last = None;
    for index in 0..steps.max {
        sample(samples, level, &pose.frame_from_units, &mut scratch.values);
        let widen = if steps.far && index < 2 { 2.0 } else { 1.0 };
        let prior = prior.filter(|_| index == 0);
        let scale = weigh(samples, pose, widen, prior, scratch)?;
        let products = sum_products(samples, scratch);
        let (solution, moved) = step(samples, &products, scale, steps, pose, corners)?;
        last = Some(Settled {
            products,
            scale,
            solution,
        });
        if moved < steps.settled_px && (!steps.far || index > 0) {
            break;
        }
    }
    last
}

/// Values of the frame at the images of the samples.
pub(super) fn sample(
    samples: &Samples,
    level: &Level,
    frame_from_units: &DMat3,
    values: &mut Vec<f32>,
) {
    let shrink = f64::from(1u32 << level.index).recip();
    // straight to pixels of the level, relative to the center of the first one
    let origin = dvec2(level.left as f64 + 0.5, level.top as f64 + 0.5);
    let to_level = DMat3::from_translation(-origin) * DMat3::from_scale(DVec2::splat(shrink));
    let m = (to_level * *frame_from_units)
        .to_cols_array()
        .map(|v| v as f32);
    values.resize(samples.len(), 0.0);
    dispatch!(SimdLevel::new(), simd => sample_all(simd, (&samples.u, &samples.v), level, &m, values));
}

#[inline(always)]
fn sample_all<S: Simd>(
    _simd: S,
    (us, vs): (&[f32], &[f32]),
    level: &Level,
    m: &[f32; 9],
    values: &mut [f32],
) {
    let places = us.chunks(LANES).zip(vs.chunks(LANES));
    for ((us, vs), out) in places.zip(values.chunks_mut(LANES)) {
        let (mut u, mut v) = ([0.0f32; LANES], [0.0f32; LANES]);
        u[..us.len()].copy_from_slice(us);
        v[..vs.len()].copy_from_slice(vs);
        let (mut x, mut y) = ([0.0f32; LANES], [0.0f32; LANES]);
        for k in 0..LANES {
            let z = m[2] * u[k] + m[5] * v[k] + m[8];
            let near = if z > 0.02 { z.recip() } else { f32::NAN };
            x[k] = (m[0] * u[k] + m[3] * v[k] + m[6]) * near;
            y[k] = (m[1] * u[k] + m[4] * v[k] + m[7]) * near;
        }
        for (k, out) in out.iter_mut().enumerate() {
            *out = bilinear(level, x[k], y[k]);
        }
    }
}

#[inline(always)]
fn bilinear(level: &Level, x: f32, y: f32) -> f32 {
    let (right, bottom) = ((level.width - 1) as f32, (level.height - 1) as f32);
    // also refuses what is not a number
    if !(x >= 0.0 && y >= 0.0 && x < right && y < bottom) {
        return f32::NAN;
    }
    let (col, row) = (x as u32, y as u32);
    let (tx, ty) = (x - col as f32, y - row as f32);
    let at = row as usize * level.width + col as usize;
    let upper = &level.values[at..at + 2];
    let lower = &level.values[at + level.width..at + level.width + 2];
    let top = upper[0] + tx * (upper[1] - upper[0]);
    let low = lower[0] + tx * (lower[1] - lower[0]);
    top + ty * (low - top)
}

/// Coefficients of light and blur in the columns of some samples.
fn coefficients(samples: &Samples, pose: &Pose) -> [f32; 7] {
    let Pose { light, blur, .. } = pose;
    let mean = f64::from(samples.mean);
    let per_level = 0.25f64.powi(samples.level as i32);
    [
        light.gain,
        light.bias + light.gain * mean,
        light.slope[0],
        light.slope[1],
        blur[0] * per_level,
        blur[1] * per_level,
        blur[2] * per_level,
    ]
    .map(|c| c as f32)
}

/// Residuals and weights under a pose; the robust standard deviation of the residuals, or nothing if too little is in view.
fn weigh(
    samples: &Samples,
    pose: &Pose,
    widen: f32,
    prior: Option<&[f32]>,
    scratch: &mut Scratch,
) -> Option<f32> {
    let c = coefficients(samples, pose);
    scratch.residuals.resize(samples.len(), 0.0);
    dispatch!(SimdLevel::new(), simd => residuals(simd, samples, &c, &scratch.values, &mut scratch.residuals));
    let stride = samples.len().div_ceil(SCALE_SAMPLES);
    scratch.sorted.clear();
    let seen = scratch.residuals.iter().step_by(stride);
    (scratch.sorted).extend(seen.filter(|r| !r.is_nan()).map(|r| r.abs()));
    if (scratch.sorted.len() * stride) as f64 <= MIN_IN_VIEW * samples.len() as f64 {
        return None;
    }
    let middle = scratch.sorted.len() / 2;
    let (_, median, _) = (scratch.sorted).select_nth_unstable_by(middle, f32::total_cmp);
    let by_samples = 1.4826 * *median;
    let scale = by_samples.min(scale_of_blocks(samples, scratch));
    let scale = (scale * widen).max(MIN_SCALE);
    let inverse = (TUKEY * scale).recip();
    scratch.weights.resize(samples.len(), 0.0);
    for (index, block) in samples.blocks.iter().enumerate() {
        let residuals = &scratch.residuals[block.start..block.end];
        let weights = &mut scratch.weights[block.start..block.end];
        let (mut sum, mut count) = (0.0f32, 0.0f32);
        for (&r, w) in residuals.iter().zip(weights.iter_mut()) {
            let share = (r * inverse).abs();
            let seen = if share.is_nan() { 0.0 } else { 1.0 };
            let clipped = share.min(1.0);
            sum += clipped * seen;
            count += seen;
            let tail = 1.0 - clipped * clipped;
            *w = tail * tail * seen;
        }
        let mean = sum / count.max(1.0);
        let [full, none] = BLOCK_FIT;
        let mut fit = ((none - mean) / (none - full)).clamp(0.0, 1.0);
        if let Some(prior) = prior {
            fit *= prior[index];
        }
        if fit < 1.0 {
            for w in weights {
                *w *= fit;
            }
        }
    }
    Some(scale / widen)
}

/// The standard deviation of residuals by the blocks that fit best: the median of all residuals is that of what hides the plane
/// as soon as it covers half.
fn scale_of_blocks(samples: &Samples, scratch: &mut Scratch) -> f32 {
    scratch.sorted.clear();
    for block in &samples.blocks {
        let (mut sum, mut count) = (0.0f32, 0.0f32);
        for &r in &scratch.residuals[block.start..block.end] {
            let seen = if r.is_nan() { 0.0 } else { 1.0 };
            sum += if r.is_nan() { 0.0 } else { r.abs() };
            count += seen;
        }
        if count >= MIN_BLOCK_SAMPLES {
            scratch.sorted.push(sum / count);
        }
    }
    if scratch.sorted.is_empty() {
        return f32::INFINITY;
    }
    let place = (BLOCK_QUANTILE * scratch.sorted.len() as f32) as usize;
    let (_, mean, _) = (scratch.sorted).select_nth_unstable_by(place, f32::total_cmp);
    BLOCK_SIGMAS * *mean
}

#[inline(always)]
fn residuals<S: Simd>(
    _simd: S,
    samples: &Samples,
    c: &[f32; 7],
    values: &[f32],
    residuals: &mut [f32],
) {
    let n = residuals.len();
    let [xx, xy, yy] = [0, 1, 2].map(|k| &samples.second[k][..n]);
    let (t, u, v, y) = (
        &samples.value[..n],
        &samples.u[..n],
        &samples.v[..n],
        &values[..n],
    );
    for i in 0..n {
        let light = c[0] * t[i] + c[1] + c[2] * u[i] + c[3] * v[i];
        residuals[i] = y[i] - light - (c[4] * xx[i] + c[5] * xy[i] + c[6] * yy[i]);
    }
}

/// Weighted products of all pairs of columns.
fn sum_products(samples: &Samples, scratch: &Scratch) -> Products {
    let mut sums = [0.0f64; PRODUCTS];
    dispatch!(SimdLevel::new(), simd => add_products(simd, samples, scratch, &mut sums));
    // the upper triangle, row by row
    let at = |row: usize, col: usize| row * (2 * ALL + 1 - row) / 2 + col - row;
    std::array::from_fn(|row| std::array::from_fn(|col| sums[at(row.min(col), row.max(col))]))
}

/// The columns, and the value, of up to [`LANES`] samples from `start` on.
#[inline(always)]
fn columns(samples: &Samples, values: &[f32], start: usize, end: usize) -> [[f32; LANES]; ALL] {
    let load = |from: &[f32]| {
        let mut lanes = [0.0f32; LANES];
        if end - start == LANES {
            lanes.copy_from_slice(&from[start..start + LANES]);
        } else {
            lanes[..end - start].copy_from_slice(&from[start..end]);
        }
        lanes
    };
    let (u, v) = (load(&samples.u), load(&samples.v));
    let (gx, gy) = (load(&samples.gx), load(&samples.gy));
    let mut all = [[0.0f32; LANES]; ALL];
    for k in 0..LANES {
        let (u, v, gx, gy) = (u[k], v[k], gx[k], gy[k]);
        let radial = gx * u + gy * v;
        all[0][k] = gx;
        all[1][k] = gy;
        all[2][k] = gy * u - gx * v;
        all[3][k] = radial;
        all[4][k] = gx * u - gy * v;
        all[5][k] = gx * v + gy * u;
        all[6][k] = radial * u;
        all[7][k] = radial * v;
        all[9][k] = 1.0;
        all[10][k] = u;
        all[11][k] = v;
    }
    all[LIGHT] = load(&samples.value);
    for k in 0..3 {
        all[BLUR + k] = load(&samples.second[k]);
    }
    all[COLUMNS] = load(values);
    all
}

#[inline(always)]
fn add_products<S: Simd>(
    _simd: S,
    samples: &Samples,
    scratch: &Scratch,
    sums: &mut [f64; PRODUCTS],
) {
    let n = samples.len();
    let mut lanes = [[0.0f32; LANES]; PRODUCTS];
    let mut runs = 0;
    let mut start = 0;
    while start < n {
        let end = (start + LANES).min(n);
        let mut all = columns(samples, &scratch.values, start, end);
        let mut weights = [0.0f32; LANES];
        weights[..end - start].copy_from_slice(&scratch.weights[start..end]);
        for k in 0..LANES {
            // out of view: the weight is 0, and the value is not a number
            if weights[k] == 0.0 {
                all[COLUMNS][k] = 0.0;
            }
        }
        let mut at = 0;
        for i in 0..ALL {
            let mut left = [0.0f32; LANES];
            for k in 0..LANES {
                left[k] = weights[k] * all[i][k];
            }
            for right in &all[i..] {
                for k in 0..LANES {
                    lanes[at][k] += left[k] * right[k];
                }
                at += 1;
            }
        }
        runs += 1;
        start = end;
        if runs == RUNS || start == n {
            for (sum, lane) in sums.iter_mut().zip(&mut lanes) {
                *sum += lane.iter().map(|&v| f64::from(v)).sum::<f64>();
                *lane = [0.0; LANES];
            }
            runs = 0;
        }
    }
}

/// The normal matrix of the columns that are used, with priors; unused ones are decoupled.
pub(super) fn normal_matrix(
    products: &Products,
    scale: f64,
    gain: f64,
    blur: bool,
) -> [[f64; COLUMNS]; COLUMNS] {
    let used = if blur { COLUMNS } else { BLUR };
    let mut matrix = [[0.0; COLUMNS]; COLUMNS];
    for i in 0..used {
        matrix[i][..used].copy_from_slice(&products[i][..used]);
    }
    let noise = scale * scale;
    for (k, row) in matrix.iter_mut().enumerate() {
        row[k] += match k {
            _ if k < MOTION => noise / (gain * MOTION_PRIOR).powi(2),
            _ if k < BLUR => 1e-9,
            _ if blur => noise / (gain * BLUR_PRIOR).powi(2),
            _ => 1.0,
        };
    }
    matrix
}

/// Solves for all columns and applies the solution to the pose; the mean motion of the corners in pixels.
fn step(
    samples: &Samples,
    products: &Products,
    scale: f32,
    steps: Steps,
    pose: &mut Pose,
    corners: &[DVec2],
) -> Option<([f64; COLUMNS], f64)> {
    let mut matrix = normal_matrix(products, f64::from(scale), pose.light.gain, steps.blur);
    let used = if steps.blur { COLUMNS } else { BLUR };
    let mut right = [0.0; COLUMNS];
    right[..used].copy_from_slice(&products[COLUMNS][..used]);
    for k in steps.motion..MOTION {
        for row in &mut matrix {
            row[k] = 0.0;
        }
        matrix[k] = [0.0; COLUMNS];
        matrix[k][k] = 1.0;
        right[k] = 0.0;
    }
    let solution = solve_positive(&matrix, &right)?;
    let gain = solution[LIGHT];
    if !(GAIN[0]..GAIN[1]).contains(&gain) {
        return None;
    }
    let motion: [f64; MOTION] = std::array::from_fn(|k| solution[k] / gain);
    let before = pose.frame_from_units;
    let after = before * increment(&motion).inverse();
    let after = after * after.z_axis.z.recip();
    let moved = mean_distance(&before, &after, corners);
    if !moved.is_finite() || !after.is_finite() {
        return None;
    }
    pose.frame_from_units = after;
    pose.light = Light {
        gain,
        bias: solution[LIGHT + 1] - gain * f64::from(samples.mean),
        slope: [solution[LIGHT + 2], solution[LIGHT + 3]],
    };
    if steps.blur {
        let per_level = 4.0f64.powi(samples.level as i32);
        pose.blur = std::array::from_fn(|k| solution[BLUR + k] * per_level);
    }
    Some((solution, moved))
}

/// Weighted sums of residual · column over each group of blocks, after the last step: what makes the covariance.
pub(super) fn scores(
    samples: &Samples,
    settled: &Settled,
    blur: bool,
    scratch: &Scratch,
) -> Vec<[f64; COLUMNS]> {
    let mut all = vec![[0.0; COLUMNS]; samples.groups];
    let used = if blur { COLUMNS } else { BLUR };
    let solution = settled.solution.map(|c| c as f32);
    for block in &samples.blocks {
        let mut start = block.start;
        let mut sums = [0.0f32; COLUMNS];
        while start < block.end {
            let end = (start + LANES).min(block.end);
            let all = columns(samples, &scratch.values, start, end);
            for (k, &weight) in scratch.weights[start..end].iter().enumerate() {
                if weight == 0.0 {
                    continue;
                }
                let explained: f32 = (0..used).map(|c| solution[c] * all[c][k]).sum();
                let weighted = weight * (all[COLUMNS][k] - explained);
                for (sum, column) in sums[..used].iter_mut().zip(&all) {
                    *sum += weighted * column[k];
                }
            }
            start = end;
        }
        for (total, sum) in all[block.group].iter_mut().zip(sums) {
            *total += f64::from(sum);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacements_agree_with_finite_differences() {
        for p in [dvec2(0.0, 0.0), dvec2(0.4, -0.7), dvec2(-0.9, 0.2)] {
            for (k, derivative) in displacements(p).into_iter().enumerate() {
                let mut motion = [0.0; MOTION];
                motion[k] = 1e-6;
                let moved = project(&increment(&motion), p).unwrap();
                assert!(((moved - p) / 1e-6).distance(derivative) < 1e-5, "{k} {p}");
            }
        }
    }

    /// A quadratic picture, of which bilinear samples and central differences are exact up to a constant.
    fn picture(size: usize) -> Level {
        let values = (0..size * size).map(|at| {
            let (x, y) = ((at % size) as f32, (at / size) as f32);
            1e-4 * (x * x - 1.5 * x * y + 0.7 * y * y) + 0.003 * x
        });
        Level {
            index: 0,
            left: 0,
            top: 0,
            width: size,
            height: size,
            values: values.collect(),
        }
    }

    fn samples(level: &Level) -> Samples {
        let mut samples = Samples::default();
        let at = |col: usize, row: usize| level.values[row * level.width + col];
        for row in (4..60).step_by(3) {
            for col in (4..60).step_by(3) {
                samples.u.push((col as f32 + 0.5 - 32.0) / 32.0);
                samples.v.push((row as f32 + 0.5 - 32.0) / 32.0);
                samples.value.push(at(col, row));
                samples
                    .gx
                    .push(16.0 * (at(col + 1, row) - at(col - 1, row)));
                samples
                    .gy
                    .push(16.0 * (at(col, row + 1) - at(col, row - 1)));
                for second in &mut samples.second {
                    second.push(0.0);
                }
            }
        }
        samples
    }

    #[test]
    fn columns_are_the_derivatives_of_the_values() {
        let level = picture(64);
        let samples = samples(&level);
        let identity =
            DMat3::from_translation(DVec2::splat(32.0)) * DMat3::from_scale(DVec2::splat(32.0));
        let (mut before, mut after) = (Vec::new(), Vec::new());
        sample(&samples, &level, &identity, &mut before);
        for k in 0..MOTION {
            let mut motion = [0.0; MOTION];
            motion[k] = 2e-3;
            sample(
                &samples,
                &level,
                &(identity * increment(&motion)),
                &mut after,
            );
            for start in (0..samples.len()).step_by(LANES) {
                let end = (start + LANES).min(samples.len());
                let all = columns(&samples, &before, start, end);
                for i in start..end {
                    let slope = (after[i] - before[i]) / 2e-3;
                    let expected = all[k][i - start];
                    assert!((slope - expected).abs() < 0.02, "{k}: {slope} {expected}");
                }
            }
        }
    }

    #[test]
    fn products_are_those_of_a_plain_sum() {
        let level = picture(64);
        let samples = samples(&level);
        let identity =
            DMat3::from_translation(DVec2::splat(31.5)) * DMat3::from_scale(DVec2::splat(32.0));
        let mut scratch = Scratch::default();
        sample(&samples, &level, &identity, &mut scratch.values);
        scratch.weights = (0..samples.len()).map(|i| (i % 5) as f32 * 0.25).collect();
        let found = sum_products(&samples, &scratch);
        let mut plain = [[0.0f64; ALL]; ALL];
        for i in 0..samples.len() {
            let all = columns(&samples, &scratch.values, i, i + 1);
            for (a, row) in all.iter().zip(&mut plain) {
                for (b, entry) in all.iter().zip(row) {
                    *entry += f64::from(scratch.weights[i]) * f64::from(a[0]) * f64::from(b[0]);
                }
            }
        }
        for (found, plain) in found.iter().flatten().zip(plain.iter().flatten()) {
            assert!(
                (found - plain).abs() <= 1e-5 * plain.abs().max(1.0),
                "{found} {plain}"
            );
        }
    }
}
