//! Texture of the plate as a cue: foreground hides it, even where the colors agree.

use crate::half::halve;
use ravec_raster::{Plane, gaussian_blur};

/// Standard deviation of a window, in pixels of half the size (3 pixels of the frame).
const SIGMA_PX: f64 = 1.5;
/// Pixels of a frame in a window: 4πσ², with σ in pixels of the frame.
const WINDOW_PX: f32 = 113.0;
/// Factor of the variance for windows in which alpha is not constant.
const UNEVEN: f32 = 4.0;
/// Variance of a cue that has seen a perfect fit: windows are larger than details.
const MIN_VARIANCE: f32 = 0.12;

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
    let smooth = |plane: &Plane| gaussian_blur(&halve(plane), SIGMA_PX);
    let size = frame[0].size();
    let products = |a: &[Plane; 3], b: &[Plane; 3]| {
        let mut sum = Plane::new(size, 0.0);
        let [a0, a1, a2] = a.each_ref().map(Plane::pixels);
        let [b0, b1, b2] = b.each_ref().map(Plane::pixels);
        for (at, out) in sum.pixels_mut().iter_mut().enumerate() {
            *out = a0[at] * b0[at] + a1[at] * b1[at] + a2[at] * b2[at];
        }
        smooth(&sum)
    };
    let (frame_plate, plate_plate, frame_frame) = (
        products(frame, plate),
        products(plate, plate),
        products(frame, frame),
    );
    let (frame, plate) = (frame.each_ref().map(smooth), plate.each_ref().map(smooth));
    let mut alpha = Plane::new(frame_plate.size(), 0.0);
    let mut precision = alpha.clone();
    for at in 0..alpha.pixels().len() {
        let mean = |a: &[Plane; 3], b: &[Plane; 3]| {
            (0..3)
                .map(|c| a[c].pixels()[at] * b[c].pixels()[at])
                .sum::<f32>()
        };
        let covariance = frame_plate.pixels()[at] - mean(&frame, &plate);
        // less the noise of the plate, of which little is known
        let variance = (plate_plate.pixels()[at] - mean(&plate, &plate)).max(0.0);
        let total = frame_frame.pixels()[at] - mean(&frame, &frame);
        let slope = covariance / (variance + 1.0);
        let residual = (total - slope * covariance).max(3.0) / 3.0;
        alpha.pixels_mut()[at] = (1.0 - slope).clamp(0.0, 1.0);
        let noise = UNEVEN * residual / WINDOW_PX + WEAK;
        let spread = noise / variance.max(1e-6) + MIN_VARIANCE;
        precision.pixels_mut()[at] = 1.0 / spread;
    }
    if is_known.pixels().iter().any(|&known| known < 1.0) {
        let known = smooth(is_known);
        for (precision, known) in precision.pixels_mut().iter_mut().zip(known.pixels()) {
            let share = ((known - MIN_KNOWN) / (1.0 - MIN_KNOWN)).clamp(0.0, 1.0);
            *precision *= share * share;
        }
    }
    TextureCue { alpha, precision }
}
