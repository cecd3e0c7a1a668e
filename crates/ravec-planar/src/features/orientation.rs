//! The directions of a feature: peaks of the histogram of its gradients.

use crate::features::detect::Extremum;
use ravec_raster::Plane;
use std::sync::LazyLock;

/// Bins of the histogram: ten degrees each.
const BINS: usize = 36;

/// Of the highest peak, for others to count as directions of their own.
const PEAK_SHARE: f32 = 0.8;

/// Positions of gradients, in units of the feature's blur, and their weights: a disc of three times the window's
/// standard deviation of 1.5, at a distance of 0.6, at which the blurred picture has no finer detail.
static DISC: LazyLock<Vec<[f32; 3]>> = LazyLock::new(|| {
    const STEP: f32 = 0.6;
    let sites = (-7i8..=7)
        .flat_map(|j| (-7i8..=7).map(move |i| [f32::from(i) * STEP, f32::from(j) * STEP]));
    sites
        .map(|[x, y]| [x, y, x * x + y * y])
        .filter(|site| site[2] <= 4.5f32.powi(2))
        .map(|[x, y, square]| [x, y, (-square / (2.0 * 1.5 * 1.5)).exp()])
        .collect()
});

/// The angle of (x, y) as a share of the full turn, 0 to 1, from x towards y, to 1.5e-5 of a turn.
///
/// Source of the polynomial: Abramowitz and Stegun, *Handbook of Mathematical Functions*, 4.4.47, shortened.
#[inline(always)]
pub(super) fn turn(x: f32, y: f32) -> f32 {
    let (a, b) = (x.abs(), y.abs());
    let t = a.min(b) / a.max(b).max(f32::MIN_POSITIVE);
    let s = t * t;
    let mut angle = ((((0.020_835_1 * s - 0.085_133) * s + 0.180_141) * s - 0.330_299_5) * s
        + 0.999_866)
        * t
        * (0.5 / std::f32::consts::PI);
    if b > a {
        angle = 0.25 - angle;
    }
    if x < 0.0 {
        angle = 0.5 - angle;
    }
    if y < 0.0 {
        angle = 1.0 - angle;
    }
    angle
}

/// The directions of an extremum in radians, from 0 to 2π; usually one.
pub(super) fn orientations(plane: &Plane, extremum: &Extremum) -> Vec<f32> {
    let sigma = extremum.sigma();
    let (right, bottom) = (plane.width() as isize - 1, plane.height() as isize - 1);
    let mut bins = [0.0f32; BINS];
    for &[x, y, weight] in DISC.iter() {
        let col = (extremum.col + sigma * x).round() as isize;
        let row = (extremum.row + sigma * y).round() as isize;
        if col < 1 || row < 1 || col >= right || row >= bottom {
            continue;
        }
        let (col, row) = (col as usize, row as usize);
        let line = plane.row(row);
        let gx = line[col + 1] - line[col - 1];
        let gy = plane.row(row + 1)[col] - plane.row(row - 1)[col];
        let height = weight * (gx * gx + gy * gy).sqrt();
        let at = turn(gx, gy) * BINS as f32;
        let (bin, share) = (at as usize, at.fract());
        bins[bin % BINS] += height * (1.0 - share);
        bins[(bin + 1) % BINS] += height * share;
    }
    // twice [1 4 6 4 1] / 16 around the circle
    for _ in 0..2 {
        let old = bins;
        let at = |k: usize| old[k % BINS];
        for (k, bin) in bins.iter_mut().enumerate() {
            let k = k + BINS;
            *bin = (at(k - 2) + at(k + 2) + 4.0 * (at(k - 1) + at(k + 1)) + 6.0 * at(k)) / 16.0;
        }
    }
    let highest = bins.iter().fold(0.0f32, |a, &b| a.max(b));
    let mut angles = Vec::with_capacity(2);
    for k in 0..BINS {
        let (before, here, after) = (bins[(k + BINS - 1) % BINS], bins[k], bins[(k + 1) % BINS]);
        if here > before && here >= after && here >= PEAK_SHARE * highest {
            // the vertex of the parabola through the three
            let off = 0.5 * (before - after) / (before - 2.0 * here + after);
            angles.push(
                (k as f32 + off).rem_euclid(BINS as f32) * (std::f32::consts::TAU / BINS as f32),
            );
        }
    }
    angles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_polynomial_is_the_arctangent() {
        for k in 0..3600 {
            let angle = f64::from(k) * std::f64::consts::TAU / 3600.0;
            let found = f64::from(turn(angle.cos() as f32, angle.sin() as f32));
            let off = (found - angle / std::f64::consts::TAU + 0.5).rem_euclid(1.0) - 0.5;
            assert!(off.abs() < 1.5e-5, "{angle}: {off}");
        }
        assert_eq!(turn(0.0, 0.0), 0.0);
    }

    #[test]
    fn a_slope_has_the_direction_of_its_gradient() {
        for k in 0..24 {
            let angle = (k as f32 + 0.3) * std::f32::consts::TAU / 24.0;
            let size = ravec_raster::Size::new(41, 41).unwrap();
            let slope = Plane::from_fn(size, |col, row| {
                0.01 * (angle.cos() * col as f32 + angle.sin() * row as f32)
            });
            let middle = Extremum {
                octave: 0,
                col: 20.0,
                row: 20.0,
                level: 1.5,
                response: 1.0,
            };
            let found = orientations(&slope, &middle);
            // all gradients are equal: the smoothed histogram is symmetric about them up to the linear shares of two bins
            assert!(
                found.len() == 1 && (found[0] - angle).abs() < 0.02,
                "{angle} {found:?}"
            );
        }
    }
}
