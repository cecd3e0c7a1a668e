//! Mattes of pictures by a trimap or strokes, without a known background.
//!
//! The steps:
//!
//! 1. *Color models*: for each side a mean and a covariance at every place, spread from the marked pixels into the unknown ones.
//! 2. *Likelihood* of nine values of alpha under both models and the noise; the mean and the variance of alpha follow.
//! 3. *Matting Laplacian*: alpha follows the edges of the picture, and the mean of step 2 as far as its variance allows.
//! 4. Steps 1 to 3 again, with the pixels that are almost certain as further samples of their side.
//! 5. *Colors*: the most likely foreground and background that compose to the picture.
//!
//! Sources: Chuang et al., *A Bayesian approach to digital matting*, 2001 (likelihood and colors); Levin et al., *A closed-form
//! solution to natural image matting*, 2008 (Laplacian).

use crate::approximate::{exp, ln};
use crate::field::{ColorField, color_field};
use crate::half::doubled;
use crate::laplacian::{DataTerm, MattingLaplacian, Unknowns};
use crate::matte::{Colors, Constraint, Constraints, Matte, MattingError};
use crate::posterior::LEVELS;
use crate::symmetric::{adjugate, product};
use ravec_progress::Progress;
use ravec_raster::{Image, Plane};

/// Noise of a picture: that of good photographs, which the steps of 8 bits set a floor for.
const NOISE: f32 = 1.0 / 255.0;
/// Variance that is added to that of both sides, relative to the noise: their models are never exact.
const MIN_SPREAD: f32 = 1.0;
/// Radius of the samples of the marked pixels, at half the size.
const MARKED_SIGMA_PX: f64 = 6.0;
/// Radius of the samples once the unknown pixels take part.
const REFINED_SIGMA_PX: f64 = 1.5;
/// Number of times that the models are estimated.
const PASSES: usize = 2;
/// Power of alpha in the weight of a sample: only pixels that are nearly of one side show its color.
const SAMPLE_POWER: i32 = 40;
/// Weight below which a pixel is no sample.
const MIN_SAMPLE: f32 = 1e-4;
/// Variance of alpha at which the weight of a sample is half.
const SAMPLE_VARIANCE: f32 = 3e-4;
/// Weight of the likelihood against the Laplacian, times the variance of alpha.
const DATA_WEIGHT: f32 = 2e-4;
/// Variance of alpha that is added to that of the likelihood: its models have errors in common.
const DATA_VARIANCE: f32 = 0.03;
/// Steps of the solver between passes, and after the last one.
const PASS_STEPS: usize = 30;
const LAST_STEPS: usize = 100;

/// A matte by a trimap or strokes.
#[derive(Debug, Clone, PartialEq)]
pub struct StillMatte {
    /// Alpha and foreground.
    pub matte: Matte,
    /// sRGB-encoded colors of the background, without those of the foreground.
    pub background: Colors,
}

/// Solves for alpha, foreground and background of a picture in which some pixels of both sides are marked, by a trimap or by strokes.
/// Colors are clamped to 0 to 1, and NaN counts as 0.
///
/// Alpha is exactly 1 and 0 at the marked pixels. `alpha · foreground + (1 − alpha) · background` is the picture, up to rounding and
/// to colors that would leave 0 to 1. The work grows with the number of unknown pixels; memory is about 120 bytes for each of them
/// and 150 for each pixel.
///
/// # Errors
/// [`MattingError::SizesDiffer`]; [`MattingError::Unmarked`] if a side has no marked pixel; [`MattingError::Cancelled`].
pub fn still_matte(
    picture: &Colors,
    constraints: &Constraints,
    progress: &Progress,
) -> Result<StillMatte, MattingError> {
    check(picture, constraints)?;
    progress.check()?;
    let picture = &picture.map(|color| color.map(in_range));
    let planes = [0, 1, 2].map(|channel| picture.map(|color| color[channel] / NOISE));
    let unknowns = Unknowns::new(picture.size(), |col, row| {
        Constraint::of(constraints[(col, row)]) == Constraint::Unknown
    });
    let laplacian = MattingLaplacian::new(picture, &unknowns);
    let mut alpha = constraints.map(|value| match Constraint::of(value) {
        Constraint::Foreground => 1.0,
        Constraint::Background => 0.0,
        Constraint::Unknown => 0.5,
    });
    let mut sides = Sides::from_marked(&planes, &alpha);
    let phase = progress.phase("matte", PASSES as u64);
    for pass in 1..=PASSES {
        progress.check()?;
        let estimates = sides.estimates(&planes, &unknowns);
        for (at, estimate) in unknowns.positions().zip(&estimates) {
            alpha[at] = estimate.mean;
        }
        let data = DataTerm {
            alpha: estimates.iter().map(|one| one.mean).collect(),
            weight: estimates
                .iter()
                .map(|one| DATA_WEIGHT / (one.variance + DATA_VARIANCE))
                .collect(),
        };
        let steps = if pass < PASSES {
            PASS_STEPS
        } else {
            LAST_STEPS
        };
        laplacian.solve(&data, &mut alpha, steps, progress)?;
        if pass < PASSES {
            sides = Sides::refined(&planes, &alpha, &unknowns, &estimates);
        }
        phase.advance(1);
    }
    progress.check()?;
    let [foreground, background] = sides.colors(picture, &alpha, &unknowns);
    Ok(StillMatte {
        matte: Matte { alpha, foreground },
        background,
    })
}

fn check(picture: &Colors, constraints: &Constraints) -> Result<(), MattingError> {
    if constraints.size() != picture.size() {
        return Err(MattingError::SizesDiffer {
            what: "trimap",
            found: constraints.size(),
            expected: picture.size(),
        });
    }
    for (side, name) in [
        (Constraint::Foreground, "foreground"),
        (Constraint::Background, "background"),
    ] {
        let mut marks = constraints.pixels().iter();
        if !marks.any(|value| Constraint::of(*value) == side) {
            return Err(MattingError::Unmarked(name));
        }
    }
    Ok(())
}

/// Mean and variance of alpha by the color of a pixel alone.
#[derive(Debug, Clone, Copy, Default)]
struct Estimate {
    mean: f32,
    variance: f32,
}

/// Color of one side at a pixel, in units of the noise.
struct Side {
    mean: [f32; 3],
    /// Entries xx, yy, zz, xy, xz, yz.
    covariance: [f32; 6],
}

/// The color models of both sides.
struct Sides {
    foreground: ColorField,
    background: ColorField,
}

impl Sides {
    /// Samples are the pixels of alpha 0 and 1.
    fn from_marked(planes: &[Plane; 3], alpha: &Plane) -> Self {
        let of = |value: f32| alpha.map(|alpha| if alpha == value { 1.0 } else { 0.0 });
        Self {
            foreground: color_field(planes, &of(1.0), MARKED_SIGMA_PX),
            background: color_field(planes, &of(0.0), MARKED_SIGMA_PX),
        }
    }

    /// Samples are all pixels of which alpha and the likelihood are nearly certain.
    fn refined(
        planes: &[Plane; 3],
        alpha: &Plane,
        unknowns: &Unknowns,
        estimates: &[Estimate],
    ) -> Self {
        let mut certainty = Plane::new(alpha.size(), 1.0);
        for (at, estimate) in unknowns.positions().zip(estimates) {
            certainty[at] = 1.0 / (1.0 + estimate.variance / SAMPLE_VARIANCE);
        }
        let samples = |share: &Plane| {
            let mut weight = share.map(|share| share.powi(SAMPLE_POWER));
            for (weight, certainty) in weight.pixels_mut().iter_mut().zip(certainty.pixels()) {
                *weight = if *weight < MIN_SAMPLE {
                    0.0
                } else {
                    *weight * certainty
                };
            }
            weight
        };
        let foreground = samples(alpha);
        let background = samples(&alpha.map(|alpha| 1.0 - alpha));
        Self {
            foreground: color_field(planes, &foreground, REFINED_SIGMA_PX),
            background: color_field(planes, &background, REFINED_SIGMA_PX),
        }
    }

    fn at(&self, col: usize, row: usize) -> [Side; 2] {
        let sample = Bilinear::at_half(&self.foreground.mean[0], col, row);
        [&self.foreground, &self.background].map(|field| Side {
            mean: field.mean.each_ref().map(|plane| sample.of(plane)),
            covariance: field.covariance.each_ref().map(|plane| sample.of(plane)),
        })
    }

    /// Mean and variance of alpha of the unknown pixels.
    fn estimates(&self, planes: &[Plane; 3], unknowns: &Unknowns) -> Vec<Estimate> {
        let mut estimates = vec![Estimate::default(); unknowns.len()];
        unknowns.for_spans(&mut estimates, 1, |span, estimates| {
            for (col, estimate) in (span.col..).zip(estimates) {
                let color = [0, 1, 2].map(|channel| planes[channel][(col, span.row)]);
                *estimate = self.estimate(color, col, span.row);
            }
        });
        estimates
    }

    fn estimate(&self, color: [f32; 3], col: usize, row: usize) -> Estimate {
        let sides = self.at(col, row);
        let logarithms: [f32; LEVELS] =
            std::array::from_fn(|level| Mixture::of(&sides, level_alpha(level)).likelihood(color));
        let largest = logarithms.iter().copied().fold(f32::MIN, f32::max);
        let mut moments = [0.0f32; 3];
        for (level, logarithm) in logarithms.iter().enumerate() {
            let chance = exp(logarithm - largest);
            let alpha = level_alpha(level);
            moments[0] += chance;
            moments[1] += chance * alpha;
            moments[2] += chance * alpha * alpha;
        }
        let mean = moments[1] / moments[0];
        Estimate {
            mean,
            variance: (moments[2] / moments[0] - mean * mean).max(0.0),
        }
    }

    /// Colors of the foreground and the background.
    fn colors(&self, picture: &Colors, alpha: &Plane, unknowns: &Unknowns) -> [Colors; 2] {
        // a side that a pixel does not show continues from its samples
        let side = |field: &ColorField, whole: f32| {
            let mean = field
                .mean
                .each_ref()
                .map(|half| doubled(half, picture.size()));
            Image::from_fn(picture.size(), |col, row| {
                let at = (col, row);
                if alpha[at] == whole {
                    picture[at]
                } else {
                    shown([0, 1, 2].map(|channel| mean[channel][at]))
                }
            })
        };
        let mut foreground = side(&self.foreground, 1.0);
        let mut background = side(&self.background, 0.0);
        let mut pairs = vec![[[0.0; 3]; 2]; unknowns.len()];
        unknowns.for_spans(&mut pairs, 1, |span, pairs| {
            for (col, pair) in (span.col..).zip(pairs) {
                let at = (col, span.row);
                let sides = self.at(col, span.row);
                let color = picture[at].map(|value| value / NOISE);
                *pair = Mixture::of(&sides, alpha[at])
                    .split(&sides, color)
                    .map(shown);
            }
        });
        for (at, [front, back]) in unknowns.positions().zip(pairs) {
            foreground[at] = front;
            background[at] = back;
        }
        [foreground, background]
    }
}

/// A value from 0 to 1; NaN becomes 0.
fn in_range(value: f32) -> f32 {
    if value.is_nan() {
        0.0
    } else {
        value.clamp(0.0, 1.0)
    }
}

/// The value of alpha that a level stands for.
fn level_alpha(level: usize) -> f32 {
    level as f32 / (LEVELS - 1) as f32
}

/// A color in units of the noise as files hold it.
fn shown(color: [f32; 3]) -> [f32; 3] {
    color.map(|value| (value * NOISE).clamp(0.0, 1.0))
}

/// Places and shares of the four pixels at half the size around a pixel.
struct Bilinear {
    cols: [usize; 2],
    rows: [usize; 2],
}

impl Bilinear {
    fn at_half(half: &Plane, col: usize, row: usize) -> Self {
        let around = |at: usize, length: usize| {
            let near = (at / 2).min(length - 1);
            let far = if at.is_multiple_of(2) {
                near.saturating_sub(1)
            } else {
                (near + 1).min(length - 1)
            };
            [near, far]
        };
        Self {
            cols: around(col, half.width()),
            rows: around(row, half.height()),
        }
    }

    fn of(&self, half: &Plane) -> f32 {
        let [near, far] = self.rows.map(|row| {
            let [near, far] = self.cols.map(|col| half[(col, row)]);
            0.75 * near + 0.25 * far
        });
        0.75 * near + 0.25 * far
    }
}

/// Distribution of the color of a pixel with a given alpha.
struct Mixture {
    alpha: f32,
    mean: [f32; 3],
    /// Adjugate of the covariance: entries xx, yy, zz, xy, xz, yz.
    cofactors: [f32; 6],
    determinant: f32,
}

impl Mixture {
    fn of([foreground, background]: &[Side; 2], alpha: f32) -> Self {
        let beta = 1.0 - alpha;
        let (front, back) = (alpha * alpha, beta * beta);
        let noise = 1.0 + MIN_SPREAD * (front + back);
        let covariance: [f32; 6] = std::array::from_fn(|entry| {
            front * foreground.covariance[entry]
                + back * background.covariance[entry]
                + if entry < 3 { noise } else { 0.0 }
        });
        // rounding must not make the determinant vanish: in exact numbers it is above 1
        let (cofactors, determinant) = adjugate(covariance);
        Self {
            alpha,
            mean: [0, 1, 2].map(|c| alpha * foreground.mean[c] + beta * background.mean[c]),
            cofactors,
            determinant: determinant.max(1.0),
        }
    }

    /// Inverse covariance times the difference to the mean.
    fn whitened(&self, residual: [f32; 3]) -> [f32; 3] {
        product(&self.cofactors, residual).map(|value| value / self.determinant)
    }

    fn residual(&self, color: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|c| color[c] - self.mean[c])
    }

    /// Logarithm of the likelihood of a color, up to a constant.
    fn likelihood(&self, color: [f32; 3]) -> f32 {
        let residual = self.residual(color);
        -0.5 * (dot(residual, self.whitened(residual)) + ln(self.determinant))
    }

    /// The most likely colors of both sides that compose to `color`: what the models leave is shared in proportion to their parts of
    /// it.
    fn split(&self, sides: &[Side; 2], color: [f32; 3]) -> [[f32; 3]; 2] {
        let whitened = self.whitened(self.residual(color));
        let shares = [self.alpha, 1.0 - self.alpha];
        let mut colors: [[f32; 3]; 2] = std::array::from_fn(|index| {
            let (side, share) = (&sides[index], shares[index]);
            let gain = product(&side.covariance, whitened);
            [0, 1, 2].map(|c| side.mean[c] + share * (gain[c] + MIN_SPREAD * whitened[c]))
        });
        let norm = shares[0] * shares[0] + shares[1] * shares[1];
        for c in 0..3 {
            let rest = color[c] - shares[0] * colors[0][c] - shares[1] * colors[1][c];
            for (color, share) in colors.iter_mut().zip(shares) {
                color[c] += rest * share / norm;
            }
        }
        colors
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
