//! Mattes of frames whose background is known.
//!
//! The steps, each a module of its own:
//!
//! 1. *Light* (`light`): gain, offset, shift and blur of the plate in the frame, and the noise; from here on colors are in units of
//!    the noise.
//! 2. *Detection*: the normalized squared difference χ² is large where there is foreground. All that follows is done in the rectangle
//!    around it.
//! 3. *Texture cue* (`texture`): foreground hides the texture of the plate, even where colors agree.
//! 4. *Foreground field* (`field`): mean and covariance of the foreground's colors from what is certain nearby.
//! 5. *Likelihood* (`posterior`) of nine values of alpha under noise and covariance.
//! 6. *Pooling*: certain neighbors give ambiguous pixels a prior.
//! 7. Alpha between median and mean of the posterior. Steps 4 to 7 are done once more with it, and specks are cleared
//!    (`speckles`).
//! 8. *Shadows* (`shadow`), if they are to be told from the rest.
//!
//! Source: Chuang et al., *A Bayesian approach to digital matting*, 2001, with a known background instead of its model.

use crate::field::{ColorField, color_field};
use crate::half::{doubled, halve, spread};
use crate::light::PlateLight;
use crate::matte::{Colors, Constraint, Constraints, Matte, MattingError};
use crate::posterior::{Evidence, Likelihood, Prior};
use crate::shadow::{Shadows, shadow_factor};
use crate::speckles::clear_specks;
use crate::texture::{TextureCue, texture_cue};
use ravec_progress::Progress;
use ravec_raster::{Image, Plane, Rect, Size, gaussian_blur};
use serde::{Deserialize, Serialize};

/// χ² of three channels above which a pixel is foreground for certain, by itself and smoothed.
const CERTAIN: f32 = 20.0;
const CERTAIN_SMOOTH: f32 = 30.0;
/// Smoothed χ² above which a pixel may be foreground.
const SUSPECT_SMOOTH: f32 = 10.0;
/// Pixels around a region that [`plate_matte_near`] looks at.
pub const NEAR_PX: usize = 24;
/// Pixels by which the rectangle is larger than what is suspect.
const MARGIN_PX: usize = 16;
/// Radius of the window whose largest difference stands for opaque foreground at the start.
const START_RADIUS: usize = 3;
/// Standard deviations of the windows of the foreground field in the two passes, in pixels of half the size.
const FIELD_SIGMA_PX: [f64; 2] = [2.0, 1.0];
/// Standard deviation of the pooling, in pixels of half the size.
const POOL_SIGMA_PX: f64 = 2.5;
/// Weight of distant places in the pooling.
const POOL_PULL: f32 = 0.01;
/// Largest share that a prior gives to one end.
const MAX_SHARE: f32 = 0.98;
/// Squared contrast, in units of the noise, at which a pixel counts half in the pooling.
const POOL_CONTRAST: f32 = 60.0;
/// Variance, in units of that of the noise, above which a pixel counts less in the pooling.
const SURE_VARIANCE: f32 = 50.0;
/// Variance, in units of that of the noise, of a plate that is not known.
const UNKNOWN_VARIANCE: f32 = 1e7;

/// Parameters of [`plate_matte`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
pub struct PlateParams {
    /// Set alpha to 0 up to this value, and to 1 from one less it, 0 to 0.25
    #[cfg_attr(feature = "clap", arg(long, value_name = "ALPHA", default_value_t = Self::default().snap))]
    pub snap: f32,
    /// Shadows that the foreground casts on the plate
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Shadows::Foreground))]
    pub shadows: Shadows,
}

impl Default for PlateParams {
    fn default() -> Self {
        Self {
            snap: 0.02,
            shadows: Shadows::Foreground,
        }
    }
}

impl PlateParams {
    fn check(&self) -> Result<(), MattingError> {
        if (0.0..=0.25).contains(&self.snap) {
            return Ok(());
        }
        Err(MattingError::Parameter {
            field: "snap",
            value: f64::from(self.snap),
            range: "0 to 0.25",
        })
    }
}

/// A frame, its background and what else is known.
#[derive(Debug, Clone, Copy)]
pub struct PlateFrame<'a> {
    /// The frame.
    pub frame: &'a Colors,
    /// The background as the frame would show it, in any light that a gain and an offset of each channel describe.
    pub plate: &'a Colors,
    /// Share of certainty of each pixel of the plate, 0 to 1; `None` for 1 everywhere.
    pub known: Option<&'a Plane>,
    /// Strokes in this frame.
    pub strokes: Option<&'a Constraints>,
}

impl<'a> PlateFrame<'a> {
    /// A frame before a plate that is known everywhere.
    pub fn new(frame: &'a Colors, plate: &'a Colors) -> Self {
        Self {
            frame,
            plate,
            known: None,
            strokes: None,
        }
    }

    fn check(&self) -> Result<Size, MattingError> {
        let expected = self.frame.size();
        let sizes = [
            ("plate", Some(self.plate.size())),
            ("certainty of the plate", self.known.map(Plane::size)),
            ("picture of strokes", self.strokes.map(Image::size)),
        ];
        for (what, found) in sizes {
            if let Some(found) = found.filter(|found| *found != expected) {
                return Err(MattingError::SizesDiffer {
                    what,
                    found,
                    expected,
                });
            }
        }
        Ok(expected)
    }

    fn stroke(&self, col: usize, row: usize) -> Constraint {
        self.strokes.map_or(Constraint::Unknown, |strokes| {
            Constraint::of(strokes[(col, row)])
        })
    }
}

/// A matte before a plate.
#[derive(Debug, Clone)]
pub struct PlateMatte {
    /// Alpha and foreground.
    pub matte: Matte,
    /// The plate in the light of the frame, sRGB-encoded: `alpha · foreground + (1 − alpha) · background` is the frame.
    pub background: Colors,
    /// Light of the frame.
    pub light: PlateLight,
}

/// Solves for alpha and foreground of a frame with a known background.
///
/// Alpha is exactly 0 and 1 where strokes say so, and 0 in a frame that differs from its plate only by light and noise. With the
/// foreground over the plate the frame comes back, but for shadows that are softened or dropped.
/// The same input gives the same bytes on any number of threads. Foreground that has the colors of the plate and no texture of
/// its own, over a plate without texture, cannot be seen: strokes help. So do they for foreground less than five pixels across
/// that is far from any other, which counts as noise.
///
/// # Errors
/// [`MattingError::SizesDiffer`], [`MattingError::Parameter`], [`MattingError::Cancelled`].
pub fn plate_matte(
    input: &PlateFrame<'_>,
    params: &PlateParams,
    progress: &Progress,
) -> Result<PlateMatte, MattingError> {
    input.check()?;
    params.check()?;
    progress.check()?;
    let usable = |col: usize, row: usize| {
        let known = input.known.is_none_or(|known| known[(col, row)] >= 0.5);
        known && input.stroke(col, row) != Constraint::Foreground
    };
    let light = PlateLight::fit(input.frame, input.plate, Some(&usable));
    solve(input, light, params, progress)
}

/// Solves a part of a frame again, in place, after its strokes have changed inside of `region`, with the light of the solution
/// `found`. Its cost is that of the region and of [`NEAR_PX`] pixels around it.
///
/// Inside of the region the result approximates that of [`plate_matte`], which sees foreground further away, too; outside nothing
/// changes.
///
/// # Errors
/// Those of [`plate_matte`], and [`MattingError::SizesDiffer`] for a solution of another size.
pub fn plate_matte_near(
    input: &PlateFrame<'_>,
    params: &PlateParams,
    found: &mut PlateMatte,
    region: Rect,
    progress: &Progress,
) -> Result<(), MattingError> {
    let size = input.check()?;
    params.check()?;
    progress.check()?;
    if found.background.size() != size {
        return Err(MattingError::SizesDiffer {
            what: "solution",
            found: found.background.size(),
            expected: size,
        });
    }
    let region = region.intersection(Rect::of(size));
    // even corners, so that halves have the same grid as in the whole frame
    let (left, top) = (
        region.col.saturating_sub(NEAR_PX) & !1,
        region.row.saturating_sub(NEAR_PX) & !1,
    );
    let right = (region.right() + NEAR_PX).min(size.width());
    let bottom = (region.bottom() + NEAR_PX).min(size.height());
    let Ok(part) = Size::new(right.saturating_sub(left), bottom.saturating_sub(top)) else {
        return Ok(());
    };
    if region.is_empty() {
        return Ok(());
    }
    // the part lies in the frame
    let (Ok(frame), Ok(plate)) = (
        input.frame.crop(left, top, part),
        input.plate.crop(left, top, part),
    ) else {
        return Ok(());
    };
    let known = input
        .known
        .and_then(|known| known.crop(left, top, part).ok());
    let strokes = input
        .strokes
        .and_then(|strokes| strokes.crop(left, top, part).ok());
    let near = PlateFrame {
        frame: &frame,
        plate: &plate,
        known: known.as_ref(),
        strokes: strokes.as_ref(),
    };
    let solved = solve(&near, found.light, params, progress)?;
    for row in region.row..region.bottom() {
        for col in region.col..region.right() {
            let from = (col - left, row - top);
            found.matte.alpha[(col, row)] = solved.matte.alpha[from];
            found.matte.foreground[(col, row)] = solved.matte.foreground[from];
        }
    }
    Ok(())
}

/// Solves a frame in a light that is known.
fn solve(
    input: &PlateFrame<'_>,
    light: PlateLight,
    params: &PlateParams,
    progress: &Progress,
) -> Result<PlateMatte, MattingError> {
    let size = input.frame.size();
    let (background, mut variance) = light.relit(input.plate);
    if let Some(known) = input.known {
        for (variance, known) in variance.pixels_mut().iter_mut().zip(known.pixels()) {
            *variance += UNKNOWN_VARIANCE * (1.0 - known.clamp(0.0, 1.0));
        }
    }
    let mut alpha = Plane::new(size, 0.0);
    let mut foreground = input.frame.clone();
    if let Some(part) = Part::detect(input, &light, &background, &variance) {
        progress.check()?;
        part.solve(input, &light, params, &mut alpha, &mut foreground, progress)?;
    }
    hold_strokes(input, &mut alpha, &mut foreground);
    Ok(PlateMatte {
        matte: Matte { alpha, foreground },
        background,
        light,
    })
}

/// Sets what strokes say.
fn hold_strokes(input: &PlateFrame<'_>, alpha: &mut Plane, foreground: &mut Colors) {
    let Some(strokes) = input.strokes else { return };
    for (at, stroke) in strokes.pixels().iter().enumerate() {
        match Constraint::of(*stroke) {
            Constraint::Unknown => {}
            Constraint::Background => alpha.pixels_mut()[at] = 0.0,
            Constraint::Foreground => {
                alpha.pixels_mut()[at] = 1.0;
                foreground.pixels_mut()[at] = input.frame.pixels()[at];
            }
        }
    }
}

/// The rectangle of a frame in which there may be foreground, in units of the noise.
struct Part {
    rect: Rect,
    frame: [Plane; 3],
    plate: [Plane; 3],
    variance: Plane,
    /// Alpha to start with.
    start: Plane,
}

impl Part {
    /// Looks for differences, smooths them, and takes the rectangle around what is suspect. `None` for a frame without foreground.
    fn detect(
        input: &PlateFrame<'_>,
        light: &PlateLight,
        background: &Colors,
        variance: &Plane,
    ) -> Option<Self> {
        let size = variance.size();
        let scale = light.sigma.map(|sigma| 1.0 / sigma);
        let mut difference = Plane::new(size, 0.0);
        difference.for_each_row(|row, out| {
            let (frame, plate, variance) =
                (input.frame.row(row), background.row(row), variance.row(row));
            for (col, out) in out.iter_mut().enumerate() {
                let square: f32 = (0..3)
                    .map(|c| ((frame[col][c] - plate[col][c]) * scale[c]).powi(2))
                    .sum();
                *out = if square.is_finite() {
                    (square / variance[col]).min(1e6)
                } else {
                    0.0
                };
            }
        });
        let smooth = gaussian_blur(&difference, 1.0);
        let mut bounds: Option<[usize; 4]> = None;
        let mut certain = false;
        for row in 0..size.height() {
            for col in 0..size.width() {
                let marked = input.stroke(col, row) == Constraint::Foreground;
                let smooth = smooth[(col, row)];
                certain |= marked || (smooth > CERTAIN_SMOOTH && difference[(col, row)] > CERTAIN);
                if marked || smooth > SUSPECT_SMOOTH {
                    let [left, top, right, bottom] = bounds.unwrap_or([col, row, col, row]);
                    bounds = Some([left.min(col), top.min(row), right.max(col), bottom.max(row)]);
                }
            }
        }
        let [left, top, right, bottom] = bounds.filter(|_| certain)?;
        // even corners, so that halves of all parts have the same grid
        let (left, top) = (
            left.saturating_sub(MARGIN_PX) & !1,
            top.saturating_sub(MARGIN_PX) & !1,
        );
        let (right, bottom) = (
            (right + 1 + MARGIN_PX).min(size.width()),
            (bottom + 1 + MARGIN_PX).min(size.height()),
        );
        let part = Size::new(right - left, bottom - top).ok()?;
        let rect = Rect {
            col: left,
            row: top,
            width: part.width(),
            height: part.height(),
        };
        let frame = input.frame.crop(left, top, part).ok()?.map(finite);
        let mut plate = background.crop(left, top, part).ok()?.map(finite);
        let variance = variance.crop(left, top, part).ok()?;
        // what is not known differs from nothing
        for (at, variance) in variance.pixels().iter().enumerate() {
            if *variance > 0.5 * UNKNOWN_VARIANCE {
                plate.pixels_mut()[at] = frame.pixels()[at];
            }
        }
        let difference = difference.crop(left, top, part).ok()?;
        let smooth = smooth.crop(left, top, part).ok()?;
        let mut start = start_of(&difference, &smooth);
        for (row, cells) in (top..).zip(0..part.height()) {
            for col in 0..part.width() {
                match input.stroke(left + col, row) {
                    Constraint::Foreground => start[(col, cells)] = 1.0,
                    Constraint::Background => start[(col, cells)] = 0.0,
                    Constraint::Unknown => {}
                }
            }
        }
        Some(Self {
            rect,
            frame: light.whitened(&frame),
            plate: light.whitened(&plate),
            variance,
            start,
        })
    }

    fn solve(
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
        let mut found = self.start.clone();
        let mut field = None;
        for sigma_px in FIELD_SIGMA_PX {
            progress.check()?;
            let next = self.foreground_field(&found, sigma_px);
            let evidence = self.evidence(&next, &cue);
            let likelihood = Likelihood::of(&evidence);
            let prior = self.pooled(&likelihood);
            found = likelihood.alpha(&prior);
            self.hold(input, &mut found);
            field = Some(next);
        }
        let Some(field) = field else { return Ok(()) };
        for value in found.pixels_mut() {
            if *value <= params.snap {
                *value = 0.0;
            } else if *value >= 1.0 - params.snap {
                *value = 1.0;
            }
        }
        clear_specks(&mut found, |col, row| {
            input.stroke(self.rect.col + col, self.rect.row + row) == Constraint::Foreground
        });
        let mut colors = Likelihood::foreground(&self.evidence(&field, &cue), &found);
        if params.shadows != Shadows::Foreground {
            self.part_shadows(input, params.shadows, &mut found, &mut colors);
        }
        for row in 0..self.rect.height {
            let to = self.rect.row + row;
            alpha.row_mut(to)[self.rect.col..][..self.rect.width].copy_from_slice(found.row(row));
            for (col, out) in foreground.row_mut(to)[self.rect.col..][..self.rect.width]
                .iter_mut()
                .enumerate()
            {
                *out = [0, 1, 2].map(|c| (colors[c][(col, row)] * light.sigma[c]).clamp(0.0, 1.0));
            }
        }
        Ok(())
    }

    /// Makes shadows black, with the alpha that is asked for. Strokes of foreground stay.
    fn part_shadows(
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

    fn evidence<'a>(&'a self, field: &'a ColorField, cue: &'a TextureCue) -> Evidence<'a> {
        Evidence {
            frame: &self.frame,
            plate: &self.plate,
            variance: &self.variance,
            field,
            cue,
        }
    }

    /// Colors of the frame where alpha is almost 1.
    fn foreground_field(&self, alpha: &Plane, sigma_px: f64) -> ColorField {
        let weight = alpha.map(|alpha| {
            let squared = alpha * alpha;
            let fourth = squared * squared;
            let tenth = fourth * fourth * squared;
            if tenth < 1e-4 { 0.0 } else { tenth }
        });
        color_field(&self.frame, &weight, sigma_px)
    }

    /// Shares of both ends from the neighbors that are sure, each with its contrast as weight.
    fn pooled(&self, likelihood: &Likelihood) -> Prior {
        let [background, foreground] = likelihood.ends();
        let mut weight = likelihood
            .contrast
            .map(|contrast| contrast / (contrast + POOL_CONTRAST));
        // where the plate is not known there is nothing to be sure of
        for (weight, variance) in weight.pixels_mut().iter_mut().zip(self.variance.pixels()) {
            *weight *= (SURE_VARIANCE / variance).min(1.0);
        }
        let weighted = |share: &Plane| {
            let mut sum = share.clone();
            for (sum, weight) in sum.pixels_mut().iter_mut().zip(weight.pixels()) {
                *sum *= weight;
            }
            halve(&sum)
        };
        let spread = spread(
            &halve(&weight),
            [weighted(&background), weighted(&foreground)],
            POOL_SIGMA_PX,
            POOL_PULL,
        );
        let size = self.variance.size();
        let [mut background, mut foreground] = spread.each_ref().map(|share| doubled(share, size));
        let limit = |share: f32| 0.5 * (1.0 - MAX_SHARE) + MAX_SHARE * share.clamp(0.0, 1.0);
        background
            .pixels_mut()
            .iter_mut()
            .for_each(|share| *share = limit(*share));
        foreground
            .pixels_mut()
            .iter_mut()
            .for_each(|share| *share = limit(*share));
        // both may not take all
        for (background, foreground) in background
            .pixels_mut()
            .iter_mut()
            .zip(foreground.pixels_mut())
        {
            let total = (*background + *foreground).max(MAX_SHARE) / MAX_SHARE;
            *background /= total;
            *foreground /= total;
        }
        Prior {
            background,
            foreground,
        }
    }

    fn hold(&self, input: &PlateFrame<'_>, alpha: &mut Plane) {
        if input.strokes.is_none() {
            return;
        }
        for row in 0..self.rect.height {
            for col in 0..self.rect.width {
                match input.stroke(self.rect.col + col, self.rect.row + row) {
                    Constraint::Unknown => {}
                    Constraint::Background => alpha[(col, row)] = 0.0,
                    Constraint::Foreground => alpha[(col, row)] = 1.0,
                }
            }
        }
    }
}

fn finite(color: [f32; 3]) -> [f32; 3] {
    color.map(|value| if value.is_finite() { value } else { 0.0 })
}

/// The first alpha: the difference as a share of the largest one nearby, where there may be foreground at all.
fn start_of(difference: &Plane, smooth: &Plane) -> Plane {
    let size = difference.size();
    let mut distance = difference.map(f32::sqrt);
    let largest = largest_within(&distance, START_RADIUS);
    for row in 0..size.height() {
        for col in 0..size.width() {
            let at = (col, row);
            distance[at] = if smooth[at] > SUSPECT_SMOOTH
                && difference[at] > CERTAIN
                && smooth[at] > CERTAIN_SMOOTH
            {
                distance[at] / largest[at].max(1e-6)
            } else {
                0.0
            };
        }
    }
    distance
}

/// Largest value of each square window.
fn largest_within(plane: &Plane, radius: usize) -> Plane {
    let size = plane.size();
    let mut across = plane.clone();
    across.for_each_row(|row, out| {
        let line = plane.row(row);
        for offset in 1..=radius {
            for col in offset..line.len() {
                out[col] = out[col].max(line[col - offset]);
                out[col - offset] = out[col - offset].max(line[col]);
            }
        }
    });
    let mut both = across.clone();
    both.for_each_row(|row, out| {
        for other in row.saturating_sub(radius)..(row + radius + 1).min(size.height()) {
            for (out, value) in out.iter_mut().zip(across.row(other)) {
                *out = out.max(*value);
            }
        }
    });
    both
}
