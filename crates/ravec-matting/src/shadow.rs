//! Shadows on a known background: places where the frame is a darker plate, texture included.
//!
//! In a window around each pixel the factor is fitted for each channel. It is a shadow where the factors are below 1 and nearly equal,
//! and what the fit leaves is noise: foreground would hide the texture of the plate.
//!
//! Before a plate without texture, gray foreground looks like a shadow; strokes hold it.

use ravec_raster::{Mask, Plane, gaussian_blur};
use serde::{Deserialize, Serialize};

/// Standard deviation of the window of the fit, in pixels.
const WINDOW_SIGMA_PX: f64 = 1.5;
/// Factors of a shadow: deeper ones leave too little of the plate to be told from black foreground.
const FACTORS: std::ops::RangeInclusive<f32> = 0.2..=0.97;
/// Largest quotient of the factors of two channels: the light of the sky is bluer than that of the sun.
const MAX_TINT: f32 = 1.3;
/// Mean squared residual, in units of the noise and of the interpolation of the plate, up to which a fit is one, where the plate is
/// black.
const MAX_RESIDUAL: f32 = 3.0;
/// Residual as a share of the plate that the change of the factor within a window may leave.
const CHANGE: f32 = 0.05;
/// Radius in pixels of what is too small or too thin to be a shadow: rims of the foreground are mixed with the plate, and look alike.
const MIN_RADIUS_PX: f64 = 2.0;

/// Treatment of shadows that the foreground casts on a known background.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Shadows {
    /// They are foreground like the rest
    #[default]
    Foreground,
    /// Black, with the alpha by which they darken: on a new background they lie on it
    Keep,
    /// Black, with half of that alpha
    Soften,
    /// They are background
    Drop,
}

/// Factor by which a shadow darkens the plate, in units of the noise: less than 1 in shadows, 1 elsewhere.
pub(crate) fn shadow_factor(frame: &[Plane; 3], plate: &[Plane; 3], variance: &Plane) -> Plane {
    let size = variance.size();
    let smooth = |of: &(dyn Fn(usize, usize) -> f32 + Sync)| {
        gaussian_blur(&Plane::from_fn(size, of), WINDOW_SIGMA_PX)
    };
    // sums of the window: the square of the plate, and its product with the frame
    let sums = [0, 1, 2].map(|c| {
        let (frame, plate) = (&frame[c], &plate[c]);
        [
            smooth(&|col, row| plate[(col, row)].powi(2)),
            smooth(&|col, row| plate[(col, row)] * frame[(col, row)]),
        ]
    });
    let factors = sums.each_ref().map(|[square, product]| {
        Plane::from_fn(size, |col, row| {
            product[(col, row)] / square[(col, row)].max(1e-6)
        })
    });
    let residual = smooth(&|col, row| {
        let square: f32 = (0..3)
            .map(|c| {
                let left = frame[c][(col, row)] - factors[c][(col, row)] * plate[c][(col, row)];
                left * left
            })
            .sum();
        square / (3.0 * variance[(col, row)].max(1e-6))
    });
    let bound = |col: usize, row: usize| {
        let square: f32 = sums.iter().map(|[square, _]| square[(col, row)]).sum();
        CHANGE * CHANGE * square / 3.0
    };
    let found = Mask::from_fn(size, |col, row| {
        let factors = [0, 1, 2].map(|c| factors[c][(col, row)]);
        let least = factors.into_iter().fold(f32::INFINITY, f32::min);
        let most = factors.into_iter().fold(0.0, f32::max);
        FACTORS.contains(&least)
            && FACTORS.contains(&most)
            && most <= MAX_TINT * least
            && residual[(col, row)] <= MAX_RESIDUAL + bound(col, row)
    });
    let found = found.erode(MIN_RADIUS_PX).dilate(MIN_RADIUS_PX);
    Plane::from_fn(size, |col, row| {
        if found.at(col, row) < 0.5 {
            return 1.0;
        }
        let sum: f32 = factors.iter().map(|factor| factor[(col, row)]).sum();
        (sum / 3.0).clamp(0.0, 1.0)
    })
}

impl Shadows {
    /// Alpha of black for a shadow that darkens by a factor.
    pub(crate) fn alpha(self, factor: f32) -> f32 {
        match self {
            Self::Foreground | Self::Keep => 1.0 - factor,
            Self::Soften => 0.5 * (1.0 - factor),
            Self::Drop => 0.0,
        }
    }
}
