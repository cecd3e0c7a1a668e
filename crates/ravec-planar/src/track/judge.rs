//! Verdict on an alignment: what of the plane is seen, and how exact the pose is.

use crate::track::align::{
    COLUMNS, MOTION, Pose, Scratch, Settled, displacements, normal_matrix, project, scores,
};
use crate::track::offsets::Matrix;
use crate::track::template::Samples;
use glam::{DMat3, DVec2};
use nalgebra::{Cholesky, SMatrix, SVector};

/// Correlation from which a group looks alike, as a share of what noise leaves of it, and the range of that limit.
const ALIKE: f32 = 0.7;
const ALIKE_RANGE: [f32; 2] = [0.35, 0.7];

/// Deviation of residuals, in values of the template, up to which they are taken for noise: that of a sensor is below after the blur.
const MAX_NOISE: f32 = 0.02;

/// Samples in view below which a group is not judged.
const MIN_GROUP: usize = 8;

/// Factor of the standard deviations by the sandwich: residuals of neighboring groups are not independent either, and the
/// template is exact only to its own blur.
const SIGMAS: f64 = 1.4;

/// Standard deviation of a corner that is never undercut, in pixels: interpolation alone makes as much.
const MIN_SIGMA_PX: f64 = 0.002;

/// Variance of the relative blur, in square pixels, from which its length adds to the uncertainty, and the share of the length: the
/// mean over an exposure in which the motion changes is not the place where the picture is sharpest.
const FREE_BLUR: f64 = 4.0;
const BLUR_SIGMA: f64 = 0.08;

/// Visible part of the plane.
#[derive(Debug, Clone)]
pub(super) struct Verdict {
    /// Share of the texture of the template that is in view and alike.
    pub visible: f64,
    /// Share of the texture in view that is alike.
    pub alike: f64,
    /// Share of the samples that are in view.
    pub in_view: f64,
    /// Share of the samples in view with more than half of the full weight.
    pub inlier_share: f64,
    /// Weights of the groups for the next frame.
    pub groups: Vec<f32>,
}

/// Sums of a group.
#[derive(Clone, Copy, Default)]
struct Sums {
    n: f32,
    t: f32,
    y: f32,
    tt: f32,
    yy: f32,
    ty: f32,
    /// Number, sum and energy of all samples, in view or not.
    all: [f32; 3],
}

impl Sums {
    fn add_any(&mut self, t: f32) {
        let [n, sum, energy] = &mut self.all;
        *n += 1.0;
        *sum += t;
        *energy += t * t;
    }

    /// Energy of the texture of all samples.
    fn texture(&self) -> f32 {
        let [n, t, tt] = self.all;
        (tt - t * t / n.max(1.0)).max(0.0)
    }

    /// Correlation, and the energy of the template in view.
    fn correlation(&self) -> (f32, f32) {
        let n = self.n.max(1.0);
        let tt = self.tt - self.t * self.t / n;
        let yy = self.yy - self.y * self.y / n;
        let ty = self.ty - self.t * self.y / n;
        let product = tt.max(0.0) * yy.max(0.0);
        let value = if product > 0.0 {
            ty / product.sqrt()
        } else {
            0.0
        };
        (value, tt.max(0.0))
    }
}

/// Judges the state that [`settle`](crate::track::align::settle) left in `scratch`.
pub(super) fn judge(samples: &Samples, pose: &Pose, scale: f32, scratch: &Scratch) -> Verdict {
    let mut groups = vec![Sums::default(); samples.groups];
    let (mut seen, mut inliers) = (0usize, 0usize);
    let slope = pose.light.slope.map(|s| s as f32);
    let offset = (pose.light.bias + pose.light.gain * f64::from(samples.mean)) as f32;
    for block in &samples.blocks {
        let sums = &mut groups[block.group];
        for i in block.start..block.end {
            let t = samples.value[i];
            sums.add_any(t);
            let value = scratch.values[i];
            if value.is_nan() {
                continue;
            }
            let y = value - offset - slope[0] * samples.u[i] - slope[1] * samples.v[i];
            sums.n += 1.0;
            sums.t += t;
            sums.y += y;
            sums.tt += t * t;
            sums.yy += y * y;
            sums.ty += t * y;
            seen += 1;
            inliers += usize::from(scratch.weights[i] > 0.5);
        }
    }
    let noise = ((f64::from(scale) / pose.light.gain) as f32).min(MAX_NOISE);
    let noise = noise * noise;
    let (mut all, mut in_view, mut alike) = (0.0f64, 0.0f64, 0.0f64);
    let mut weights = vec![1.0f32; groups.len()];
    for (group, weight) in groups.iter().zip(&mut weights) {
        let (correlation, energy) = group.correlation();
        all += f64::from(group.texture());
        if group.n < MIN_GROUP as f32 {
            continue;
        }
        in_view += f64::from(energy);
        // half of the noise is in the template, half in the frame
        let expected = 1.0 - 0.5 * group.n * noise / energy.max(1e-12);
        let limit = (ALIKE * expected).clamp(ALIKE_RANGE[0], ALIKE_RANGE[1]);
        if correlation >= limit {
            alike += f64::from(energy);
        } else {
            *weight = 0.2;
        }
    }
    Verdict {
        visible: alike / all.max(1e-9),
        alike: alike / in_view.max(1e-9),
        in_view: seen as f64 / samples.len() as f64,
        inlier_share: inliers as f64 / seen.max(1) as f64,
        groups: weights,
    }
}

/// Fit of a pose at a coarse level: the correlation of blocks, weighted by their texture, 0 to 1. Samples out of view count
/// a quarter.
pub(super) fn similarity(samples: &Samples, values: &[f32]) -> f64 {
    let (mut all, mut good) = (0.0f64, 0.0f64);
    for block in &samples.blocks {
        let mut sums = Sums::default();
        let range = block.start..block.end;
        for (&t, &y) in samples.value[range.clone()].iter().zip(&values[range]) {
            sums.add_any(t);
            if y.is_nan() {
                continue;
            }
            sums.n += 1.0;
            sums.t += t;
            sums.y += y;
            sums.tt += t * t;
            sums.yy += y * y;
            sums.ty += t * y;
        }
        let (correlation, energy) = sums.correlation();
        let count = (block.end - block.start) as f32;
        let seen = sums.n / count.max(1.0);
        let weight = energy.max((1.0 - seen) * sums.texture());
        all += f64::from(weight);
        good += f64::from(weight * (seen * correlation.max(0.0) + 0.25 * (1.0 - seen)));
    }
    good / all.max(1e-9)
}

/// Covariance of a pose.
#[derive(Debug, Clone)]
pub(super) struct PoseCovariance {
    /// Of the motion, in units of the template.
    motion: Matrix,
    /// Variance of a shift that all points share, in square pixels of the frame.
    shift: f64,
}

impl PoseCovariance {
    /// By the sandwich H⁻¹ (Σ s sᵀ) H⁻¹ over groups; `half` is the unit of the template in pixels, `blur` the variance of the
    /// relative blur in square pixels.
    pub fn new(
        samples: &Samples,
        settled: &Settled,
        pose: &Pose,
        (half, blur): (f64, f64),
        scratch: &Scratch,
    ) -> Option<Self> {
        let gain = pose.light.gain;
        let matrix = normal_matrix(&settled.products, f64::from(settled.scale), gain, true);
        let mut meat = SMatrix::<f64, COLUMNS, COLUMNS>::zeros();
        let mut seen = 0usize;
        for score in scores(samples, settled, true, scratch) {
            let score = SVector::from(score);
            meat += score * score.transpose();
            seen += usize::from(score.iter().any(|&v| v != 0.0));
        }
        // residuals of few groups have been fitted away in part
        let free = seen.saturating_sub(COLUMNS).max(1);
        meat *= seen as f64 / free as f64;
        let matrix = SMatrix::<f64, COLUMNS, COLUMNS>::from_fn(|row, col| matrix[row][col]);
        let inverse = Cholesky::new(matrix)?.inverse();
        let all = inverse * meat * inverse;
        let motion = all.fixed_view::<MOTION, MOTION>(0, 0) * (SIGMAS / gain).powi(2);
        // a box of length L has the variance L² / 12
        let length_sq = 12.0 * (blur - FREE_BLUR).max(0.0);
        let zoom = zoom_of(&pose.frame_from_units) / half;
        let shift = BLUR_SIGMA * BLUR_SIGMA * length_sq * zoom * zoom;
        (motion.iter().all(|v| v.is_finite()) && shift.is_finite())
            .then_some(Self { motion, shift })
    }

    /// Covariance of the images of four points, given in units, under the pose, in square pixels.
    pub fn of_points(&self, pose: &Pose, points: &[DVec2; 4]) -> Option<Matrix> {
        let jacobian = point_jacobian(&pose.frame_from_units, points)?;
        let mut covariance = jacobian * self.motion * jacobian.transpose();
        for i in 0..8 {
            covariance[(i, i)] += MIN_SIGMA_PX * MIN_SIGMA_PX;
            for j in 0..8 {
                if i % 2 == j % 2 {
                    covariance[(i, j)] += self.shift;
                }
            }
        }
        Some(covariance)
    }
}

/// The larger variance of the relative blur, in square pixels of the template.
pub(super) fn blur_variance(pose: &Pose) -> f64 {
    let [xx, xy, yy] = pose.blur;
    (xx + yy).abs() + ((xx - yy).powi(2) + xy * xy).sqrt()
}

/// Pixels of the frame to a unit, in the middle of the template.
pub(super) fn zoom_of(frame_from_units: &DMat3) -> f64 {
    let m = frame_from_units;
    let center = m.z_axis.truncate() / m.z_axis.z;
    let x = (m.x_axis.truncate() - center * m.x_axis.z) / m.z_axis.z;
    let y = (m.y_axis.truncate() - center * m.y_axis.z) / m.z_axis.z;
    x.perp_dot(y).abs().sqrt()
}

/// Derivatives of the images of points by the motion: x and y of one after the other.
fn point_jacobian(
    frame_from_units: &DMat3,
    points: &[DVec2; 4],
) -> Option<SMatrix<f64, 8, MOTION>> {
    let mut all = SMatrix::zeros();
    let m = frame_from_units;
    for (k, &point) in points.iter().enumerate() {
        let image = project(m, point)?;
        let z = (*m * point.extend(1.0)).z;
        for (column, d) in displacements(point).into_iter().enumerate() {
            let moved = *m * d.extend(0.0);
            let d = (moved.truncate() - image * moved.z) / z;
            all[(2 * k, column)] = d.x;
            all[(2 * k + 1, column)] = d.y;
        }
    }
    Some(all)
}
