//! Mattes of frames whose background is known.
//!
//! The steps, each a module of its own:
//!
//! 1. *Light* (`light`): gain, offset, shift and blur of the plate in the frame, and the noise; from here on colors are in units of
//!    the noise.
//! 2. *Detection* (`detect`): the normalized squared difference χ² is large where there is foreground. All that follows is done in
//!    rectangles around it (`region`), so that its cost grows with the foreground.
//! 3. *Texture cue* (`texture`): foreground hides the texture of the plate, even where colors agree.
//! 4. *Foreground field* (`field`): mean and covariance of the foreground's colors from what is certain nearby, but for veils through
//!    which the texture shines.
//! 5. *Likelihood* (`posterior`) of nine values of alpha under noise and covariance.
//! 6. *Pooling*: certain neighbors give ambiguous pixels a prior.
//! 7. Alpha between median and mean of the posterior. Steps 4 to 7 are done once more with it, and specks are cleared
//!    (`speckles`).
//! 8. *Shadows* (`shadow`), if they are to be told from the rest.
//!
//! Source: Chuang et al., *A Bayesian approach to digital matting*, 2001, with a known background instead of its model.

use crate::detect::Difference;
use crate::light::PlateLight;
use crate::matte::{Colors, Constraint, Constraints, Matte, MattingError};
use crate::region::Region;
use crate::shadow::Shadows;
use ravec_progress::Progress;
use ravec_raster::{Image, Plane, Rect, Size};
use serde::{Deserialize, Serialize};

/// Pixels around a region that [`plate_matte_near`] looks at.
pub const NEAR_PX: usize = 24;
/// Variance, in units of that of the noise, of a plate that is not known.
pub(crate) const UNKNOWN_VARIANCE: f32 = 1e7;

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

    pub(crate) fn stroke(&self, col: usize, row: usize) -> Constraint {
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
    let difference = Difference::new(input.frame, &background, &variance, &light);
    for rect in difference.regions(input.strokes) {
        progress.check()?;
        let region = Region::new(rect, input, &light, &background, &variance, &difference);
        if let Some(region) = region {
            region.solve(input, &light, params, &mut alpha, &mut foreground, progress)?;
        }
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
