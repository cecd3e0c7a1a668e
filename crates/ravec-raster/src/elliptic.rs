//! Gaussian blur whose width depends on the direction, as that of a camera in motion.
//!
//! A gaussian in the plane is one along an axis of the grid after one along a slanted line (Geusebroek et al., *Fast anisotropic Gauss
//! filtering*, 2003). The slanted line runs along the axis of the smaller variance, so that it meets each row or column once; between
//! two pixels it is interpolated linearly.

use crate::average::Average;
use crate::chunks::for_each_chunk;
use crate::filter::{STRIP_ROWS, pad, sum_weighed};
use crate::image::Image;

/// Variance below which a sampled gaussian is too coarse; three taps have it exactly.
const MIN_SAMPLED_VARIANCE: f64 = 0.4;
/// Largest variance of an axis, beyond which a blur is computed as if it were this.
const MAX_VARIANCE: f64 = 1e6;

/// Covariance of a blur, in square pixels. The default blurs nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BlurCovariance {
    /// Variance along rows.
    pub xx: f64,
    /// Covariance of rows and columns.
    pub xy: f64,
    /// Variance along columns.
    pub yy: f64,
}

impl BlurCovariance {
    /// The covariance of a picture that is enlarged `factor` times.
    pub fn enlarged(self, factor: f64) -> Self {
        let square = factor * factor;
        Self {
            xx: square * self.xx,
            xy: square * self.xy,
            yy: square * self.yy,
        }
    }

    /// Covariance of this blur after another one.
    pub fn after(self, other: Self) -> Self {
        Self {
            xx: self.xx + other.xx,
            xy: self.xy + other.xy,
            yy: self.yy + other.yy,
        }
    }

    /// Variance along the direction in which it is largest.
    pub fn max_variance(self) -> f64 {
        self.eigenvalues()[0]
    }

    /// The nearest covariance without negative variances: what would sharpen is left out.
    pub fn without_sharpening(self) -> Self {
        let [large, small] = self.eigenvalues();
        if small >= 0.0 {
            return self;
        }
        if large.is_nan() || large <= 0.0 {
            return Self::default();
        }
        // the projection on the direction of the larger one
        let half = 0.5 * (self.xx - self.yy);
        let length = half.hypot(self.xy);
        let (cosine, sine) = (half / length, self.xy / length);
        Self {
            xx: 0.5 * large * (1.0 + cosine),
            xy: 0.5 * large * sine,
            yy: 0.5 * large * (1.0 - cosine),
        }
    }

    fn eigenvalues(self) -> [f64; 2] {
        let mean = 0.5 * (self.xx + self.yy);
        let distance = (0.5 * (self.xx - self.yy)).hypot(self.xy);
        [mean + distance, mean - distance]
    }
}

/// A pixel of a kernel: columns and rows from its center, and weight.
#[derive(Debug, Clone, Copy)]
struct Tap {
    col: isize,
    row: isize,
    weight: f32,
}

/// The image blurred by a gaussian of the given covariance; outside of the image its border pixels go on.
///
/// Directions that would be sharpened stay as they are; variances above 10⁶ count as 10⁶. Compared with the kernel of the plane the
/// variance along rows and columns is exact to 0.3 square pixels, since the slanted line is interpolated between pixels.
///
/// ```
/// use ravec_raster::{BlurCovariance, Plane, Size, elliptic_gaussian_blur};
///
/// let mut dot = Plane::new(Size::new(9, 9)?, 0.0);
/// dot[(4, 4)] = 1.0;
/// let along_rows = BlurCovariance { xx: 2.0, ..BlurCovariance::default() };
/// let line = elliptic_gaussian_blur(&dot, along_rows);
/// assert!(line[(6, 4)] > 0.05 && line[(4, 6)] == 0.0);
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
pub fn elliptic_gaussian_blur<P: Average>(
    image: &Image<P>,
    covariance: BlurCovariance,
) -> Image<P> {
    let BlurCovariance { xx, xy, yy } = covariance.without_sharpening();
    if !(xx + yy).is_finite() || xx + yy <= 0.0 {
        return image.clone();
    }
    let (xx, yy) = (xx.min(MAX_VARIANCE), yy.min(MAX_VARIANCE));
    let rows_first = xx >= yy;
    let (large, small) = if rows_first { (xx, yy) } else { (yy, xx) };
    let slope = if small > 1e-9 {
        (xy / small).clamp(-1e3, 1e3)
    } else {
        0.0
    };
    // steps along the axis of the larger and of the smaller variance
    let tap = |along: isize, across: isize, weight: f64| {
        let (col, row) = if rows_first {
            (along, across)
        } else {
            (across, along)
        };
        let weight = weight as f32;
        Tap { col, row, weight }
    };
    let straight = kernel((large - slope * xy).max(0.0))
        .map(|(step, weight)| tap(step, 0, weight))
        .collect::<Vec<_>>();
    let slanted = kernel(small)
        .flat_map(|(step, weight)| {
            let along = slope * step as f64;
            let (whole, part) = (along.floor(), along - along.floor());
            let first = whole as isize;
            [
                tap(first, step, weight * (1.0 - part)),
                tap(first + 1, step, weight * part),
            ]
        })
        .filter(|tap| tap.weight > 0.0)
        .collect::<Vec<_>>();
    weighed(&weighed(image, &straight), &slanted)
}

/// Steps and weights of a gaussian along a line, of sum 1.
fn kernel(variance: f64) -> impl Iterator<Item = (isize, f64)> {
    let reach = if variance < MIN_SAMPLED_VARIANCE {
        isize::from(variance > 0.0)
    } else {
        (4.0 * variance.sqrt()).ceil() as isize
    };
    let raw = move |step: isize| match step {
        0 if variance < MIN_SAMPLED_VARIANCE => 1.0 - variance,
        _ if variance < MIN_SAMPLED_VARIANCE => 0.5 * variance,
        _ => (-0.5 * (step * step) as f64 / variance).exp(),
    };
    let sum: f64 = (-reach..=reach).map(raw).sum();
    (-reach..=reach).map(move |step| (step, raw(step) / sum))
}

/// Sum of shifted images by the taps of a kernel.
fn weighed<P: Average>(image: &Image<P>, taps: &[Tap]) -> Image<P> {
    if let [Tap { col: 0, row: 0, .. }] = taps {
        return image.clone();
    }
    let (width, height) = (image.width(), image.height());
    let reach = |steps: fn(&Tap) -> isize| {
        let steps = taps.iter().map(|tap| steps(tap).unsigned_abs());
        steps.max().unwrap_or(0)
    };
    // farther away the border goes on
    let cols = reach(|tap| tap.col).min(width);
    let rows = reach(|tap| tap.row);
    let row_len = width * P::CHANNELS;
    let mut result = Image::new(image.size(), P::ZERO);
    let strip_rows = STRIP_ROWS.max(4 * rows);
    for_each_chunk(result.pixels_mut(), width * strip_rows, |first, pixels| {
        let first = first / width;
        let above = first.saturating_sub(rows);
        let below = (first + pixels.len() / width + rows).min(height);
        let padded = |row: usize| {
            let mut padded = Vec::with_capacity((width + 2 * cols) * P::CHANNELS);
            pad(image.row(row), cols, &mut padded);
            padded
        };
        let lines: Vec<Vec<f32>> = (above..below).map(padded).collect();
        for (out, row) in P::numbers_mut(pixels)
            .chunks_exact_mut(row_len)
            .zip(first..)
        {
            let shifted = taps.iter().map(|tap| {
                let row = row.saturating_add_signed(tap.row).clamp(above, below - 1);
                let step = tap.col.clamp(-(cols as isize), cols as isize);
                let start = cols.saturating_add_signed(step) * P::CHANNELS;
                (tap.weight, &lines[row - above][start..][..row_len])
            });
            sum_weighed(out, &shifted.collect::<Vec<_>>());
        }
    });
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plane, Size};

    fn moments(plane: &Plane) -> [f64; 4] {
        let (x0, y0) = (
            plane.width() as f64 / 2.0 - 0.5,
            plane.height() as f64 / 2.0 - 0.5,
        );
        let mut sums = [0.0; 4];
        for row in 0..plane.height() {
            for col in 0..plane.width() {
                let value = f64::from(plane[(col, row)]);
                let (x, y) = (col as f64 - x0, row as f64 - y0);
                for (sum, power) in sums.iter_mut().zip([1.0, x * x, x * y, y * y]) {
                    *sum += value * power;
                }
            }
        }
        sums
    }

    #[test]
    fn the_blur_of_a_dot_has_the_covariance() {
        let size = Size::new(81, 81).unwrap();
        let mut dot = Plane::new(size, 0.0);
        dot[(40, 40)] = 1.0;
        for (xx, xy, yy) in [
            (9.0, 0.0, 1.0),
            (0.2, 0.0, 16.0),
            (12.0, 5.0, 4.0),
            (3.0, -3.0, 8.0),
            (10.0, 10.0, 10.0),
            (0.3, 0.1, 0.1),
        ] {
            let blurred = elliptic_gaussian_blur(&dot, BlurCovariance { xx, xy, yy });
            let [sum, sxx, sxy, syy] = moments(&blurred);
            assert!((sum - 1.0).abs() < 1e-5);
            for (found, expected) in [(sxx, xx), (sxy, xy), (syy, yy)] {
                assert!((found - expected).abs() < 0.3, "{found} for {expected}");
            }
            assert!(blurred.pixels().iter().all(|value| *value >= 0.0));
        }
    }

    #[test]
    fn round_blurs_are_those_of_the_separable_filter() {
        let size = Size::new(31, 23).unwrap();
        let plane = Plane::from_fn(size, |col, row| ((7 * col + 11 * row) % 17) as f32 / 17.0);
        let round = BlurCovariance {
            xx: 2.25,
            xy: 0.0,
            yy: 2.25,
        };
        let found = elliptic_gaussian_blur(&plane, round);
        let expected = crate::gaussian_blur(&plane, 1.5);
        for (found, expected) in found.pixels().iter().zip(expected.pixels()) {
            assert!((found - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn sharpening_is_left_out_and_constants_stay() {
        let negative = BlurCovariance {
            xx: -1.0,
            xy: 0.0,
            yy: 4.0,
        };
        let kept = negative.without_sharpening();
        assert!(kept.xx.abs() < 1e-12 && (kept.yy - 4.0).abs() < 1e-12);
        let none = BlurCovariance {
            xx: -1.0,
            xy: 0.5,
            yy: -2.0,
        };
        assert_eq!(none.without_sharpening(), BlurCovariance::default());
        // kernels larger than the image, and one pixel
        for (width, height) in [(5, 3), (1, 1), (1, 9)] {
            let flat = Plane::new(Size::new(width, height).unwrap(), 0.25);
            let wide = BlurCovariance {
                xx: 90.0,
                xy: 60.0,
                yy: 50.0,
            };
            let blurred = elliptic_gaussian_blur(&flat, wide);
            assert!(blurred.pixels().iter().all(|v| (v - 0.25).abs() < 1e-5));
        }
    }

    /// The definition: shifted pixels, each clamped to the image.
    fn weighed_naive(image: &Image<[f32; 3]>, taps: &[Tap]) -> Image<[f32; 3]> {
        Image::from_fn(image.size(), |col, row| {
            let (col, row) = (col as isize, row as isize);
            let shifted = |tap: &Tap| image.clamped(col + tap.col, row + tap.row);
            taps.iter()
                .fold([0.0; 3], |sum, tap| sum.plus(tap.weight, shifted(tap)))
        })
    }

    #[test]
    fn sums_are_those_of_the_definition() {
        for (width, height) in [(1, 1), (3, 90), (70, 40), (33, 150)] {
            let image = Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
                [0, 1, 2].map(|c| ((col * 37 + row * 91 + c * col * row * 13) % 101) as f32 / 101.0)
            });
            for seed in 0..6 {
                let step = |at: isize, range: isize| (at * 7919 + seed * 131).rem_euclid(range);
                let taps: Vec<Tap> = (0..9)
                    .map(|at| Tap {
                        col: step(at, 41 * (seed + 1)) - 20,
                        row: step(at + 5, 23) - 11,
                        weight: 0.01 * (at + 3) as f32,
                    })
                    .collect();
                assert_eq!(weighed(&image, &taps), weighed_naive(&image, &taps));
            }
        }
    }
}
