//! Texture of the plate as a cue: foreground hides it, even where the colors agree.

use crate::approximate::exp;
use crate::half::{halved_of, rows_of};
use crate::window::largest_within;
use fearless_simd::{Level as Vectors, Simd, dispatch};
use ravec_raster::{Plane, gaussian_blur};
use rayon::prelude::*;

/// Standard deviation of a window, in pixels of half the size (3 pixels of the frame).
const SIGMA_PX: f64 = 1.5;
/// Pixels of a frame in a window: 4πσ², with σ in pixels of the frame.
const WINDOW_PX: f32 = 113.0;
/// Factor of the variance for windows in which alpha is not constant.
const UNEVEN: f32 = 4.0;
/// Variance of a cue that has seen a perfect fit: windows are larger than details.
const MIN_VARIANCE: f32 = 0.12;
/// Variance of what the fit leaves from which alpha counts as uneven within a window, and the least share of [`MIN_VARIANCE`] below.
const UNEVEN_RESIDUAL: f32 = 12.0;
const MIN_UNEVEN: f32 = 0.05;
/// Variance of a cue for each unit of one over the variance of the texture: compression removes what is as weak as the noise, as
/// foreground would.
const WEAK: f32 = 1.0;

/// Share of a window that must be known for a cue.
const MIN_KNOWN: f32 = 0.5;

/// Alpha of windows by the contrast of the plate, at half the size.
pub(crate) struct TextureCue {
    /// One less the slope of the frame on the plate.
    pub alpha: Plane,
    /// One over the variance of it; 0 where the plate has no texture.
    pub precision: Plane,
}

/// Fits, in each window, a slope of the frame on the plate that all channels share. Both are in units of the noise. Windows whose
/// plate is not known, as `is_known` says by 0 and 1, have no cue.
pub(crate) fn texture_cue(frame: &[Plane; 3], plate: &[Plane; 3], is_known: &Plane) -> TextureCue {
    let size = is_known.size();
    let means = halved_of(size, |row, lines| {
        let frame = frame.each_ref().map(|plane| plane.row(row));
        let plate = plate.each_ref().map(|plane| plane.row(row));
        dispatch!(Vectors::new(), simd => products(simd, frame, plate, lines));
    });
    let means = means.map(|plane| gaussian_blur(&plane, SIGMA_PX));
    let mut cue = [(); 2].map(|()| Plane::new(size.cells(2), 0.0));
    rows_of(&mut cue)
        .into_par_iter()
        .enumerate()
        .for_each(|(row, [alpha, precision])| {
            let means = means.each_ref().map(|plane| plane.row(row));
            dispatch!(Vectors::new(), simd => slopes(simd, means, alpha, precision));
        });
    let [alpha, mut precision] = cue;
    if is_known.pixels().iter().any(|&known| known < 1.0) {
        let [known] = halved_of(size, |row, [line]| line.copy_from_slice(is_known.row(row)));
        let known = gaussian_blur(&known, SIGMA_PX);
        for (precision, known) in precision.pixels_mut().iter_mut().zip(known.pixels()) {
            let share = ((known - MIN_KNOWN) / (1.0 - MIN_KNOWN)).clamp(0.0, 1.0);
            *precision *= share * share;
        }
    }
    TextureCue { alpha, precision }
}

/// Precision from which a cue says that the texture shines through.
const SURE_PRECISION: f32 = 8.0;
/// Radius around a veil, in pixels of half the size, in which windows may contain some of it.
const VEIL_RADIUS: usize = 4;

impl TextureCue {
    /// Share of opaque foreground by the cue, at half the size: 0 where the texture of the plate shines through, and around veils, at
    /// whose borders no window has one alpha.
    pub fn opacity(&self) -> Plane {
        let mut opacity = self.alpha.clone();
        let mut veil = self.alpha.clone();
        let cues = self.alpha.pixels().iter().zip(self.precision.pixels());
        let outputs = opacity.pixels_mut().iter_mut().zip(veil.pixels_mut());
        for ((opacity, veil), (alpha, precision)) in outputs.zip(cues) {
            let sure = (precision - SURE_PRECISION).max(0.0);
            let likelihood = |off: f32| exp(-0.5 * sure * off * off);
            *opacity = likelihood(1.0 - alpha);
            *veil = (1.0 - *opacity) * (1.0 - likelihood(*alpha));
        }
        let veil = largest_within(&veil, VEIL_RADIUS);
        for (opacity, veil) in opacity.pixels_mut().iter_mut().zip(veil.pixels()) {
            *opacity *= 1.0 - veil;
        }
        opacity
    }
}

/// Quantities whose means describe a window: the products frame · plate, plate · plate and frame · frame, summed over the channels,
/// and the channels of the frame and of the plate.
const QUANTITIES: usize = 9;

/// The quantities of a row.
#[inline(always)]
fn products<S: Simd>(
    _simd: S,
    frame: [&[f32]; 3],
    plate: [&[f32]; 3],
    lines: &mut [Vec<f32>; QUANTITIES],
) {
    let width = lines[0].len();
    let [f0, f1, f2] = frame.map(|line| &line[..width]);
    let [p0, p1, p2] = plate.map(|line| &line[..width]);
    let [mixed, plates, frames, channels @ ..] = lines;
    let sums = mixed.iter_mut().zip(plates).zip(frames).enumerate();
    for (col, ((mixed, plates), frames)) in sums {
        *mixed = f0[col] * p0[col] + f1[col] * p1[col] + f2[col] * p2[col];
        *plates = p0[col] * p0[col] + p1[col] * p1[col] + p2[col] * p2[col];
        *frames = f0[col] * f0[col] + f1[col] * f1[col] + f2[col] * f2[col];
    }
    for (out, line) in channels.iter_mut().zip([f0, f1, f2, p0, p1, p2]) {
        out.copy_from_slice(line);
    }
}

/// Alpha and precision of a row from the means of its windows.
#[inline(always)]
fn slopes<S: Simd>(
    _simd: S,
    means: [&[f32]; QUANTITIES],
    alpha: &mut [f32],
    precision: &mut [f32],
) {
    let width = alpha.len();
    let [mixed, plates, frames, f0, f1, f2, p0, p1, p2] = means.map(|line| &line[..width]);
    for (col, (alpha, precision)) in alpha.iter_mut().zip(precision).enumerate() {
        let (f, p) = ([f0[col], f1[col], f2[col]], [p0[col], p1[col], p2[col]]);
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let covariance = mixed[col] - dot(f, p);
        // less the noise of the plate, of which little is known
        let variance = (plates[col] - dot(p, p)).max(0.0);
        let total = frames[col] - dot(f, f);
        let slope = covariance / (variance + 1.0);
        let residual = (total - slope * covariance).max(3.0) / 3.0;
        *alpha = (1.0 - slope).clamp(0.0, 1.0);
        let noise = UNEVEN * residual / WINDOW_PX + WEAK;
        let uneven = (residual / UNEVEN_RESIDUAL).clamp(MIN_UNEVEN, 1.0);
        let spread = noise / variance.max(1e-6) + MIN_VARIANCE * uneven;
        *precision = 1.0 / spread;
    }
}
