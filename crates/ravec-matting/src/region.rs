//! Alpha and foreground of a rectangle of a frame, in units of the noise.

use crate::detect::{CERTAIN, CERTAIN_SMOOTH, Difference, MARGIN_PX};
use crate::field::{ColorField, color_field};
use crate::half::{halved_of, spread};
use crate::light::PlateLight;
use crate::matte::{Colors, Constraint, MattingError};
use crate::plate::{PlateFrame, PlateParams, UNKNOWN_VARIANCE};
use crate::posterior::{Evidence, Likelihood, Prior};
use crate::shadow::{Shadows, shadow_factor};
use crate::speckles::clear_specks;
use crate::texture::{TextureCue, texture_cue};
use crate::window::largest_within;
use fearless_simd::{Level as Vectors, Simd, dispatch};
use ravec_progress::Progress;
use ravec_raster::{Plane, Rect, Size};

/// Radius of the window whose largest difference stands for opaque foreground at the start.
const START_RADIUS: usize = 3;
/// Standard deviations of the windows of the foreground field in the two passes, in pixels of half the size.
const FIELD_SIGMA_PX: [f64; 2] = [2.0, 1.0];
/// Standard deviation of the pooling, in pixels of half the size.
const POOL_SIGMA_PX: f64 = 2.5;
/// Weight of distant places in the pooling.
const POOL_PULL: f32 = 0.01;
/// Squared contrast, in units of the noise, at which a pixel counts half in the pooling.
const POOL_CONTRAST: f32 = 60.0;
/// Weight of the background in the pooling, beside that of the neighbors.
const BACKGROUND_WEIGHT: f32 = 0.1;
/// Variance, in units of that of the noise, above which a pixel counts less in the pooling.
const SURE_VARIANCE: f32 = 50.0;

/// A rectangle of a frame in which there is foreground.
pub(crate) struct Region {
    rect: Rect,
    frame: [Plane; 3],
    plate: [Plane; 3],
    variance: Plane,
    /// Alpha to start with.
    start: Plane,
}

impl Region {
    /// The part of a frame in a rectangle that is not empty, with its plate in the light of the frame. `None` for a rectangle that
    /// leaves the frame.
    pub fn new(
        rect: Rect,
        input: &PlateFrame<'_>,
        light: &PlateLight,
        background: &Colors,
        variance: &Plane,
        difference: &Difference,
    ) -> Option<Self> {
        let size = rect.size()?;
        let variance = variance.crop(rect.col, rect.row, size).ok()?;
        let frame = light.whitened(input.frame, rect)?;
        let mut plate = light.whitened(background, rect)?;
        // what is not known differs from nothing
        for (plate, frame) in plate.iter_mut().zip(&frame) {
            let pixels = plate.pixels_mut().iter_mut().zip(frame.pixels());
            for ((plate, frame), variance) in pixels.zip(variance.pixels()) {
                *plate = if *variance > 0.5 * UNKNOWN_VARIANCE {
                    *frame
                } else {
                    *plate
                };
            }
        }
        let chi_squared = difference.chi_squared.crop(rect.col, rect.row, size).ok()?;
        let smooth = difference.smooth.crop(rect.col, rect.row, size).ok()?;
        let mut start = start_of(&chi_squared, &smooth);
        hold(rect, input, &mut start);
        Some(Self {
            rect,
            frame,
            plate,
            variance,
            start,
        })
    }

    /// Solves for alpha and foreground, and writes them into those of the frame.
    ///
    /// # Errors
    /// [`MattingError::Cancelled`].
    pub fn solve(
        &self,
        input: &PlateFrame<'_>,
        light: &PlateLight,
        params: &PlateParams,
        alpha: &mut Plane,
        foreground: &mut Colors,
        progress: &Progress,
    ) -> Result<(), MattingError> {
        let is_known = self
            .variance
            .map(|variance| f32::from(u8::from(variance <= 0.5 * UNKNOWN_VARIANCE)));
        let cue = texture_cue(&self.frame, &self.plate, &is_known);
        let opacity = self.opacity(input, &cue);
        let mut likelihood = Likelihood::new(self.variance.size());
        let mut found = self.start.clone();
        let mut field = None;
        for sigma_px in FIELD_SIGMA_PX {
            progress.check()?;
            let next = self.foreground_field(&found, &opacity, sigma_px);
            let evidence = self.evidence(&next, &cue);
            likelihood.update(&evidence);
            let prior = self.pooled(&likelihood);
            found = likelihood.alpha(&prior);
            hold(self.rect, input, &mut found);
            field = Some(next);
        }
        let Some(field) = field else { return Ok(()) };
        fade(&mut found, self.rect, input.frame.size());
        snap(&mut found, params.snap);
        clear_specks(&mut found, |col, row| {
            input.stroke(self.rect.col + col, self.rect.row + row) == Constraint::Foreground
        });
        let mut colors = Likelihood::foreground(&self.evidence(&field, &cue), &found);
        if params.shadows != Shadows::Foreground {
            self.separate_shadows(input, params.shadows, &mut found, &mut colors);
        }
        for row in 0..self.rect.height {
            let to = self.rect.row + row;
            alpha.row_mut(to)[self.rect.col..][..self.rect.width].copy_from_slice(found.row(row));
            let [r, g, b] = colors.each_ref().map(|plane| plane.row(row));
            let out = &mut foreground.row_mut(to)[self.rect.col..][..self.rect.width];
            for (out, ((r, g), b)) in out.iter_mut().zip(r.iter().zip(g).zip(b)) {
                *out = [
                    (r * light.sigma[0]).clamp(0.0, 1.0),
                    (g * light.sigma[1]).clamp(0.0, 1.0),
                    (b * light.sigma[2]).clamp(0.0, 1.0),
                ];
            }
        }
        Ok(())
    }

    /// Makes shadows black, with the alpha that is asked for. Strokes of foreground stay.
    fn separate_shadows(
        &self,
        input: &PlateFrame<'_>,
        shadows: Shadows,
        alpha: &mut Plane,
        colors: &mut [Plane; 3],
    ) {
        let factor = shadow_factor(&self.frame, &self.plate, &self.variance);
        for row in 0..self.rect.height {
            for col in 0..self.rect.width {
                let at = (col, row);
                let stroke = input.stroke(self.rect.col + col, self.rect.row + row);
                if factor[at] >= 1.0 || alpha[at] <= 0.0 || stroke == Constraint::Foreground {
                    continue;
                }
                alpha[at] = shadows.alpha(factor[at]);
                for color in colors.iter_mut() {
                    color[at] = 0.0;
                }
            }
        }
    }

    /// Share of opaque foreground by the cue, at half the size. Strokes of foreground are opaque.
    fn opacity(&self, input: &PlateFrame<'_>, cue: &TextureCue) -> Plane {
        let mut opacity = cue.opacity();
        if input.strokes.is_some() {
            for row in 0..self.rect.height {
                for col in 0..self.rect.width {
                    let stroke = input.stroke(self.rect.col + col, self.rect.row + row);
                    if stroke == Constraint::Foreground {
                        opacity[(col / 2, row / 2)] = 1.0;
                    }
                }
            }
        }
        opacity
    }

    fn evidence<'a>(&'a self, field: &'a ColorField, cue: &'a TextureCue) -> Evidence<'a> {
        Evidence {
            frame: &self.frame,
            plate: &self.plate,
            variance: &self.variance,
            field,
            cue,
        }
    }

    /// Colors of the frame where alpha is almost 1, and the texture of the plate hidden.
    fn foreground_field(&self, alpha: &Plane, opacity: &Plane, sigma_px: f64) -> ColorField {
        let weight = alpha.map(|alpha| {
            let squared = alpha * alpha;
            let fourth = squared * squared;
            let tenth = fourth * fourth * squared;
            if tenth < 1e-4 { 0.0 } else { tenth }
        });
        color_field(&self.frame, &weight, Some(opacity), sigma_px)
    }

    /// Shares of both ends from the neighbors that are sure, each with its contrast as weight.
    fn pooled(&self, likelihood: &Likelihood) -> Prior {
        let size = self.variance.size();
        let [weight, background, foreground] = halved_of(size, |row, lines| {
            let contrast = likelihood.contrast.row(row);
            let variance = self.variance.row(row);
            let ends = likelihood.ends.each_ref().map(|plane| plane.row(row));
            dispatch!(Vectors::new(), simd => weighted_ends(simd, contrast, variance, ends, lines));
        });
        let [background, foreground] =
            spread(&weight, [background, foreground], POOL_SIGMA_PX, POOL_PULL);
        Prior {
            background,
            foreground,
        }
    }
}

/// Sets alpha of a rectangle to what strokes say.
fn hold(rect: Rect, input: &PlateFrame<'_>, alpha: &mut Plane) {
    if input.strokes.is_none() {
        return;
    }
    for row in 0..rect.height {
        for col in 0..rect.width {
            match input.stroke(rect.col + col, rect.row + row) {
                Constraint::Unknown => {}
                Constraint::Background => alpha[(col, row)] = 0.0,
                Constraint::Foreground => alpha[(col, row)] = 1.0,
            }
        }
    }
}

/// Fades alpha towards the sides of a rectangle within a frame. Nothing is suspect there, and what is as faint as the noise does not
/// end at a line.
fn fade(alpha: &mut Plane, rect: Rect, frame: Size) {
    let across = faded(rect.width, [rect.col > 0, rect.right() < frame.width()]);
    let down = faded(rect.height, [rect.row > 0, rect.bottom() < frame.height()]);
    alpha.for_each_row(|row, line| {
        for (alpha, across) in line.iter_mut().zip(&across) {
            *alpha *= across * down[row];
        }
    });
}

/// Factors that rise from each end of a line that is `inner` to the frame.
fn faded(length: usize, inner: [bool; 2]) -> Vec<f32> {
    let rise = |distance: usize| {
        let share = ((distance as f32 + 0.5) / MARGIN_PX as f32).min(1.0);
        share * share * (3.0 - 2.0 * share)
    };
    let factor = |at: usize| {
        let start = if inner[0] { rise(at) } else { 1.0 };
        let end = if inner[1] { rise(length - 1 - at) } else { 1.0 };
        start.min(end)
    };
    (0..length).map(factor).collect()
}

/// Sets alpha to 0 up to `limit`, and to 1 from one less it.
fn snap(alpha: &mut Plane, limit: f32) {
    for value in alpha.pixels_mut() {
        *value = if *value <= limit {
            0.0
        } else if *value >= 1.0 - limit {
            1.0
        } else {
            *value
        };
    }
}

/// The weight of a row in the pooling, and its product with the probabilities of both ends.
#[inline(always)]
fn weighted_ends<S: Simd>(
    _simd: S,
    contrast: &[f32],
    variance: &[f32],
    ends: [&[f32]; 2],
    lines: &mut [Vec<f32>; 3],
) {
    let [weight, shares @ ..] = lines;
    for (weight, (contrast, variance)) in weight.iter_mut().zip(contrast.iter().zip(variance)) {
        // where the plate is not known there is nothing to be sure of
        *weight = contrast / (contrast + POOL_CONTRAST) * (SURE_VARIANCE / variance).min(1.0);
    }
    for (out, end) in shares.iter_mut().zip(ends) {
        for (out, (weight, end)) in out.iter_mut().zip(weight.iter().zip(end)) {
            *out = weight * end;
        }
    }
    // where no neighbor is sure, nothing hides the background
    for (weight, background) in weight.iter_mut().zip(&mut shares[0]) {
        *weight += BACKGROUND_WEIGHT;
        *background += BACKGROUND_WEIGHT;
    }
}

/// The first alpha: the difference as a share of the largest one nearby, where there may be foreground at all.
fn start_of(chi_squared: &Plane, smooth: &Plane) -> Plane {
    let mut start = chi_squared.map(f32::sqrt);
    let largest = largest_within(&start, START_RADIUS);
    let limits = largest.pixels().iter().zip(smooth.pixels());
    let pixels = start.pixels_mut().iter_mut().zip(chi_squared.pixels());
    for ((start, chi_squared), (largest, smooth)) in pixels.zip(limits) {
        let is_certain = *smooth > CERTAIN_SMOOTH && *chi_squared > CERTAIN;
        let share = *start / largest.max(1e-6);
        *start = if is_certain { share } else { 0.0 };
    }
    start
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alpha_fades_towards_inner_sides_within_the_margin() {
        let frame = Size::new(100, 80).unwrap();
        let rect = Rect::new(0, 16, 64, 64);
        let mut alpha = Plane::new(Size::new(64, 64).unwrap(), 0.5);
        fade(&mut alpha, rect, frame);
        // the left side and the lower one are those of the frame
        assert_eq!([alpha[(0, 40)], alpha[(30, 63)], alpha[(30, 30)]], [0.5; 3]);
        assert!(alpha[(63, 40)] < 0.01 && alpha[(30, 0)] < 0.01);
        let row: Vec<f32> = (64 - MARGIN_PX..64).map(|col| alpha[(col, 40)]).collect();
        assert!(row.is_sorted_by(|a, b| a >= b), "{row:?}");
        assert_eq!(alpha[(63 - MARGIN_PX, 40)], 0.5);
    }
}
