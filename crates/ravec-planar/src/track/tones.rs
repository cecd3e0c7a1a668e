//! Curves that give a picture the tones of another one.

use ravec_numeric::solve_positive;
use ravec_raster::color::{linear_from_srgb, luminance, srgb_from_linear};
use ravec_raster::{Image, LinearRgb, Mask};

/// A parabola of encoded values that every channel goes through.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tones {
    coefficients: [f64; 3],
}

impl Default for Tones {
    fn default() -> Self {
        Self {
            coefficients: [0.0, 1.0, 0.0],
        }
    }
}

/// Rounds of the robust fit, and Tukey's constant in deviations.
const ROUNDS: usize = 6;
const TUKEY: f64 = 4.685;

/// The deviation of residuals is at least a step of 255.
const MIN_SIGMA: f64 = 1.0 / 255.0;

/// Pixels that the curve is fitted to, at most, and at least.
const MAX_PIXELS: usize = 20_000;
const MIN_PIXELS: usize = 200;

/// Values at either end of the range are clipped and say nothing of a curve.
const CLIPPED: f64 = 0.015;

impl Tones {
    /// The curve that leads from the encoded luminance of `from` to that of `to`, of the same size, where `region` covers both;
    /// no change where there is too little to fit a rising curve to.
    pub fn fit(from: &Image<LinearRgb>, to: &Image<LinearRgb>, region: &Mask) -> Self {
        let encoded = |pixel: &LinearRgb| f64::from(srgb_from_linear(luminance(pixel.0)));
        let usable = |v: f64| v > CLIPPED && v < 1.0 - CLIPPED;
        let coverage = region.coverage().pixels();
        let inside = coverage.iter().filter(|&&c| c > 0.5).count();
        let stride = inside.div_ceil(MAX_PIXELS).max(1);
        let pairs: Vec<[f64; 2]> = from
            .pixels()
            .iter()
            .zip(to.pixels())
            .zip(coverage)
            .filter(|&(_, &c)| c > 0.5)
            .step_by(stride)
            .map(|((a, b), _)| [encoded(a), encoded(b)])
            .filter(|&[a, b]| usable(a) && usable(b))
            .collect();
        if pairs.len() < MIN_PIXELS {
            return Self::default();
        }
        let mut curve = Self::default();
        let mut sigma = f64::INFINITY;
        for _ in 0..ROUNDS {
            let Some(next) = curve.step(&pairs, sigma) else {
                return Self::default();
            };
            curve = next;
            let mut residuals: Vec<f64> = pairs
                .iter()
                .map(|&[a, b]| (b - curve.at(a)).abs())
                .collect();
            let middle = residuals.len() / 2;
            let (_, median, _) = residuals.select_nth_unstable_by(middle, f64::total_cmp);
            sigma = (*median / 0.6745).max(MIN_SIGMA);
        }
        if curve.rises(&pairs) {
            curve
        } else {
            Self::default()
        }
    }

    /// One round of weighted least squares.
    fn step(&self, pairs: &[[f64; 2]], sigma: f64) -> Option<Self> {
        let (mut matrix, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
        for &[a, b] in pairs {
            let t = (b - self.at(a)) / (TUKEY * sigma);
            let weight = (1.0 - t * t).max(0.0).powi(2);
            let powers = [1.0, a, a * a];
            for i in 0..3 {
                right[i] += weight * powers[i] * b;
                for j in 0..3 {
                    matrix[i][j] += weight * powers[i] * powers[j];
                }
            }
        }
        // a picture of one tone determines no curve
        let ridge = 1e-6 * matrix[0][0];
        for (i, row) in matrix.iter_mut().enumerate() {
            row[i] += ridge;
            right[i] += ridge * self.coefficients[i];
        }
        solve_positive(&matrix, &right).map(|coefficients| Self { coefficients })
    }

    /// True if the curve rises over the values that it was fitted to.
    fn rises(&self, pairs: &[[f64; 2]]) -> bool {
        let [_, linear, square] = self.coefficients;
        pairs.iter().all(|&[a, _]| linear + 2.0 * square * a > 0.05)
    }

    /// The value on the curve, 0 to 1.
    fn at(&self, value: f64) -> f64 {
        let [constant, linear, square] = self.coefficients;
        constant + value * (linear + value * square)
    }

    /// A picture after the curve. Clipped values stay clipped.
    pub fn applied(&self, image: &Image<LinearRgb>) -> Image<LinearRgb> {
        if *self == Self::default() {
            return image.clone();
        }
        image.map(|pixel| {
            LinearRgb(pixel.0.map(|linear| {
                let value = f64::from(srgb_from_linear(linear));
                if (0.01..=0.99).contains(&value) {
                    linear_from_srgb(self.at(value).clamp(0.011, 0.989) as f32)
                } else {
                    linear
                }
            }))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;
    use ravec_scenes::Seed;

    fn gray(size: Size, value: impl Fn(usize, usize) -> f64 + Sync) -> Image<LinearRgb> {
        Image::from_fn(size, |col, row| {
            LinearRgb([linear_from_srgb(value(col, row) as f32); 3])
        })
    }

    fn ramp(col: usize, row: usize) -> f64 {
        0.1 + 0.7 * ((col * 7 + row * 13) % 101) as f64 / 101.0
    }

    #[test]
    fn a_planted_curve_is_found_under_noise_and_a_foreign_object() {
        let size = Size::new(120, 90).unwrap();
        let curve = |v: f64| 0.9 * v.powf(1.2) + 0.05;
        let from = gray(size, ramp);
        let to = gray(size, |col, row| {
            if col < 36 {
                0.5
            } else {
                curve(ramp(col, row)) + 0.01 * Seed(1).gaussian(col as i64, row as i64, 0)
            }
        });
        let found = Tones::fit(&from, &to, &Mask::full(size));
        for v in [0.1, 0.3, 0.5, 0.7, 0.8] {
            // the parabola itself is 0.004 off
            assert!(
                (found.at(v) - curve(v)).abs() < 0.012,
                "{v} {}",
                found.at(v)
            );
        }
        let toned = found.applied(&from);
        let value = srgb_from_linear(toned[(50, 40)].0[0]);
        assert!((f64::from(value) - found.at(ramp(50, 40))).abs() < 1e-3);
    }

    #[test]
    fn negatives_and_plain_pictures_keep_their_tones() {
        let size = Size::new(60, 40).unwrap();
        let from = gray(size, ramp);
        let negative = gray(size, |col, row| 1.0 - ramp(col, row));
        assert_eq!(
            Tones::fit(&from, &negative, &Mask::full(size)),
            Tones::default()
        );
        assert_eq!(
            Tones::fit(&from, &from, &Mask::empty(size)),
            Tones::default()
        );
        let plain = gray(size, |_, _| 0.4);
        let found = Tones::fit(&plain, &plain, &Mask::full(size));
        assert!((found.at(0.4) - 0.4).abs() < 1e-6);
        assert_eq!(Tones::default().applied(&from), from);
    }
}
