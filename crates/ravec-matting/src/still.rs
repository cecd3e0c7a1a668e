//! Mattes of pictures by a trimap or strokes, without a known background.
//!
//! The steps:
//!
//! 1. *Color models*: for each side a mean and a covariance at every place, spread from the marked pixels into the unknown ones.
//! 2. *Likelihood* (`mixture`) of nine values of alpha under both models and the noise; the mean and the variance of alpha follow.
//! 3. *Matting Laplacian* (`laplacian`, `levels`): alpha follows the edges of the picture, and the mean of step 2 as far as its
//!    variance allows. The solver starts at coarse levels and takes few steps at each: what is left of the start is a regularizer.
//! 4. Steps 1 to 3 again, with the pixels that are almost certain as further samples of their side.
//! 5. *Colors*: the most likely foreground and background that compose to the picture.
//!
//! Sources: Chuang et al., *A Bayesian approach to digital matting*, 2001 (likelihood and colors); Levin et al., *A closed-form
//! solution to natural image matting*, 2008 (Laplacian).

use crate::field::{ColorField, color_field};
use crate::half::doubled_row;
use crate::laplacian::{DataTerm, Span, Unknowns};
use crate::levels::Levels;
use crate::matte::{Colors, Constraint, Constraints, Matte, MattingError};
use crate::mixture::ModelRow;
use ravec_progress::Progress;
use ravec_raster::{Image, Plane};
use rayon::prelude::*;
use std::ops::Range;

/// Noise of a picture: that of good photographs, which the steps of 8 bits set a floor for.
const NOISE: f32 = 1.0 / 255.0;
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
/// Steps of the solver at the finest level between passes, and after the last one.
const PASS_STEPS: usize = 6;
const LAST_STEPS: usize = 16;

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
    let clamped;
    let picture = if is_in_range(picture) {
        picture
    } else {
        clamped = picture.map(|color| color.map(in_range));
        &clamped
    };
    let planes = [0, 1, 2].map(|channel| picture.map(|color| color[channel] / NOISE));
    let unknowns = Unknowns::new(picture.size(), |col, row| {
        Constraint::of(constraints[(col, row)]) == Constraint::Unknown
    });
    let levels = Levels::new(picture, unknowns);
    let unknowns = levels.unknowns();
    let mut alpha = constraints.map(|value| match Constraint::of(value) {
        Constraint::Foreground => 1.0,
        Constraint::Background => 0.0,
        Constraint::Unknown => 0.5,
    });
    let mut sides = Sides::from_marked(&planes, &alpha);
    let phase = progress.phase("matte", PASSES as u64);
    for pass in 1..=PASSES {
        progress.check()?;
        let estimates = sides.estimates(&planes, unknowns);
        for (at, mean) in unknowns.positions().zip(&estimates.mean) {
            alpha[at] = *mean;
        }
        let weight = |variance: &f32| DATA_WEIGHT / (variance + DATA_VARIANCE);
        let data = DataTerm {
            weight: estimates.variance.iter().map(weight).collect(),
            alpha: estimates.mean,
        };
        let steps = if pass < PASSES {
            PASS_STEPS
        } else {
            LAST_STEPS
        };
        levels.solve(&data, &mut alpha, steps, progress)?;
        if pass < PASSES {
            // the memory of the models serves the new ones
            drop(sides);
            sides = Sides::refined(&planes, &alpha, unknowns, &estimates.variance);
        }
        phase.advance(1);
    }
    progress.check()?;
    let [foreground, background] = sides.colors(picture, &planes, &alpha, unknowns);
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

/// Mean and variance of alpha by the colors of the unknown pixels alone.
struct Estimates {
    mean: Vec<f32>,
    variance: Vec<f32>,
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
            foreground: color_field(planes, &of(1.0), None, MARKED_SIGMA_PX),
            background: color_field(planes, &of(0.0), None, MARKED_SIGMA_PX),
        }
    }

    /// Samples are all pixels of which alpha and the likelihood are nearly certain.
    fn refined(planes: &[Plane; 3], alpha: &Plane, unknowns: &Unknowns, variance: &[f32]) -> Self {
        let mut certainty = Plane::new(alpha.size(), 1.0);
        for (at, variance) in unknowns.positions().zip(variance) {
            certainty[at] = 1.0 / (1.0 + variance / SAMPLE_VARIANCE);
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
            foreground: color_field(planes, &foreground, None, REFINED_SIGMA_PX),
            background: color_field(planes, &background, None, REFINED_SIGMA_PX),
        }
    }

    /// Sets the models of the row of a span, and gives its columns and its colors.
    fn span<'a>(
        &self,
        models: &mut ModelRow,
        span: Span,
        planes: &'a [Plane; 3],
    ) -> (Range<usize>, [&'a [f32]; 3]) {
        let fields = [&self.foreground, &self.background];
        models.fill(fields, span.row, planes[0].width());
        let cols = span.col..span.col + span.len;
        let colors = planes
            .each_ref()
            .map(|plane| &plane.row(span.row)[cols.clone()]);
        (cols, colors)
    }

    /// Mean and variance of alpha of the unknown pixels.
    fn estimates(&self, planes: &[Plane; 3], unknowns: &Unknowns) -> Estimates {
        // for each span all means and then all variances
        let mut moments = vec![0.0f32; 2 * unknowns.len()];
        unknowns.for_spans(
            &mut moments,
            2,
            ModelRow::default,
            |models, span, moments| {
                let (cols, colors) = self.span(models, span, planes);
                let (mean, variance) = moments.split_at_mut(span.len);
                models.estimate(cols, colors, mean, variance);
            },
        );
        let mut estimates = Estimates {
            mean: Vec::with_capacity(unknowns.len()),
            variance: Vec::with_capacity(unknowns.len()),
        };
        for span in unknowns.spans() {
            let (mean, variance) = moments[2 * span.start..][..2 * span.len].split_at(span.len);
            estimates.mean.extend_from_slice(mean);
            estimates.variance.extend_from_slice(variance);
        }
        estimates
    }

    /// Colors of the foreground and the background.
    fn colors(
        &self,
        picture: &Colors,
        planes: &[Plane; 3],
        alpha: &Plane,
        unknowns: &Unknowns,
    ) -> [Colors; 2] {
        // a side that a pixel does not show continues from its samples
        let side = |field: &ColorField, whole: f32| {
            let mut colors = Image::new(picture.size(), [0.0f32; 3]);
            colors.par_rows_mut().enumerate().for_each_init(
                || (Vec::new(), [(); 3].map(|()| vec![0.0; picture.width()])),
                |(scratch, mean), (row, out)| {
                    for (half, line) in field.mean.iter().zip(&mut *mean) {
                        doubled_row(half, row, scratch, line);
                    }
                    let alpha = alpha.row(row).iter().zip(picture.row(row));
                    for (col, (out, (alpha, color))) in out.iter_mut().zip(alpha).enumerate() {
                        *out = if *alpha == whole {
                            *color
                        } else {
                            shown([0, 1, 2].map(|channel| mean[channel][col]))
                        };
                    }
                },
            );
            colors
        };
        let mut foreground = side(&self.foreground, 1.0);
        let mut background = side(&self.background, 0.0);
        // for each span the channels of the foreground, and those of the background
        let mut pairs = vec![0.0f32; 6 * unknowns.len()];
        unknowns.for_spans(&mut pairs, 6, ModelRow::default, |models, span, pairs| {
            let (cols, colors) = self.span(models, span, planes);
            models.split(cols.clone(), colors, &alpha.row(span.row)[cols], pairs);
        });
        for span in unknowns.spans() {
            let lines = &pairs[6 * span.start..][..6 * span.len];
            let color = |side: usize, at: usize| {
                shown([0, 1, 2].map(|channel| lines[(3 * side + channel) * span.len + at]))
            };
            for at in 0..span.len {
                foreground[(span.col + at, span.row)] = color(0, at);
                background[(span.col + at, span.row)] = color(1, at);
            }
        }
        [foreground, background]
    }
}

/// Returns `true` if all values are from 0 to 1.
fn is_in_range(picture: &Colors) -> bool {
    let mut values = picture.pixels().as_flattened().iter();
    values.all(|value| (0.0..=1.0).contains(value))
}

/// A value from 0 to 1; NaN becomes 0.
fn in_range(value: f32) -> f32 {
    if value.is_nan() {
        0.0
    } else {
        value.clamp(0.0, 1.0)
    }
}

/// A color in units of the noise as files hold it.
fn shown(color: [f32; 3]) -> [f32; 3] {
    color.map(|value| (value * NOISE).clamp(0.0, 1.0))
}
