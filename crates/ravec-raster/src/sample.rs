//! The value of an image at a real position, and its mean over a real rectangle.
//!
//! A kernel weighs the pixels by the distance of their centers from the position; its weights are divided by their sum,
//! so that a constant image stays constant to rounding. Outside the image its border pixels go on without end.
//!
//! Sources: Keys, "Cubic convolution interpolation", 1981 (Catmull-Rom is its a = −1/2); Duchon, 1979 (Lanczos).
//!
//! Guarantees: constants are reproduced by every kernel, linear ramps by bilinear and Catmull-Rom (away from the
//! border); at a pixel center every kernel gives that pixel. Does not guarantee: anti-aliasing. A kernel looks at
//! pixels near the position only; to shrink a picture use [`area_average`](Image::area_average) or
//! [`resize`](crate::resize()). Catmull-Rom and Lanczos overshoot at edges.
//!
//! Cost: 1, 4, 16 and 36 pixels for the four kernels; the area for the mean.

use crate::average::Average;
use crate::image::Image;
use crate::pixel::Pixel;
use glam::DVec2;

/// Interpolation between pixel centers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Interpolation {
    /// The pixel in which the position lies. Blocky, and never a new value.
    Nearest,
    /// Linear between 2 × 2 pixels. Never overshoots, softens a little.
    #[default]
    Bilinear,
    /// Cubic over 4 × 4 pixels. Sharper, overshoots at edges by up to 7 % of their height.
    CatmullRom,
    /// Windowed sinc over 6 × 6 pixels. Sharpest, rings at edges.
    Lanczos3,
}

impl<P: Pixel> Image<P> {
    /// The pixel in which `at` lies; the nearest one outside the image. A coordinate that is not a number reads as 0.
    #[inline]
    pub fn nearest(&self, at: DVec2) -> P {
        self.clamped(at.x.floor() as isize, at.y.floor() as isize)
    }
}

impl<P: Average> Image<P> {
    /// The value at a real position, by the chosen kernel.
    ///
    /// Outside the image the border goes on. A coordinate that is not a number reads as one left of or above the image.
    #[inline]
    pub fn sample(&self, at: DVec2, interpolation: Interpolation) -> P {
        match interpolation {
            Interpolation::Nearest => self.nearest(at),
            Interpolation::Bilinear => self.bilinear(at),
            Interpolation::CatmullRom => self.catmull_rom(at),
            Interpolation::Lanczos3 => self.lanczos3(at),
        }
    }

    /// The value at a real position, linear between 2 × 2 pixels.
    #[inline]
    pub fn bilinear(&self, at: DVec2) -> P {
        self.weighted(at, |t| [1.0 - t, t])
    }

    /// The value at a real position, cubic over 4 × 4 pixels.
    #[inline]
    pub fn catmull_rom(&self, at: DVec2) -> P {
        self.weighted(at, |t| {
            // the four cubics of Keys at distances 1 + t, t, 1 − t, 2 − t; they sum to 1 by construction
            let (t2, t3) = (t * t, t * t * t);
            [
                -0.5 * t3 + t2 - 0.5 * t,
                1.5 * t3 - 2.5 * t2 + 1.0,
                -1.5 * t3 + 2.0 * t2 + 0.5 * t,
                0.5 * t3 - 0.5 * t2,
            ]
        })
    }

    /// The value at a real position, by a windowed sinc over 6 × 6 pixels.
    #[inline]
    pub fn lanczos3(&self, at: DVec2) -> P {
        self.weighted(at, |t| {
            let mut weights = [0.0; 6];
            for (index, weight) in weights.iter_mut().enumerate() {
                *weight = lanczos3(t + 2.0 - index as f64);
            }
            let sum: f64 = weights.iter().sum();
            weights.map(|weight| weight / sum)
        })
    }

    /// Sums `N` × `N` pixels around `at`; `weights(t)` are those of the pixels from left to right, `t` in 0 to 1 the way
    /// from the center of the middle-left pixel to the next one.
    #[inline]
    fn weighted<const N: usize>(&self, at: DVec2, weights: impl Fn(f64) -> [f64; N]) -> P {
        // far outside, all taps read the border; `max` also turns NaN into a number
        let far = N as f64;
        let x = at.x.max(-far).min(self.width() as f64 + far) - 0.5;
        let y = at.y.max(-far).min(self.height() as f64 + far) - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (wx, wy) = (weights(x - x0), weights(y - y0));
        let reach = N as isize / 2 - 1;
        let (col, row) = (x0 as isize - reach, y0 as isize - reach);
        let inside = col >= 0
            && row >= 0
            && col as usize + N <= self.width()
            && row as usize + N <= self.height();
        let mut sum = P::ZERO;
        for (j, &wy) in wy.iter().enumerate() {
            let mut line = P::ZERO;
            if inside {
                let pixels = &self.row(row as usize + j)[col as usize..][..N];
                for (&pixel, &wx) in pixels.iter().zip(&wx) {
                    line = line.plus(wx as f32, pixel);
                }
            } else {
                for (i, &wx) in wx.iter().enumerate() {
                    line = line.plus(wx as f32, self.clamped(col + i as isize, row + j as isize));
                }
            }
            sum = sum.plus(wy as f32, line);
        }
        sum
    }

    /// The mean over the rectangle between two opposite corners, each pixel weighed by the exact area in which it
    /// meets the rectangle. Outside the image the border goes on. Sums are kept in `f64`.
    ///
    /// A rectangle without area gives the pixel at its center; a coordinate that is not a number reads as one left of
    /// or above the image.
    pub fn area_average(&self, corner: DVec2, opposite: DVec2) -> P {
        let (low, high) = (corner.min(opposite), corner.max(opposite));
        let cols = shares(low.x, high.x, self.width());
        let rows = shares(low.y, high.y, self.height());
        let (Some((first_col, wx)), Some((first_row, wy))) = (cols, rows) else {
            return self.nearest((low + high) * 0.5);
        };
        let mut mean = P::ZERO;
        for (channel, out) in P::numbers_mut(std::slice::from_mut(&mut mean))
            .iter_mut()
            .enumerate()
        {
            let mut sum = 0.0;
            for (row, &wy) in (first_row..).zip(&wy) {
                let numbers = P::numbers(&self.row(row)[first_col..][..wx.len()]);
                let values = numbers[channel..].iter().step_by(P::CHANNELS);
                sum += wy
                    * values
                        .zip(&wx)
                        .map(|(&v, &wx)| wx * f64::from(v))
                        .sum::<f64>();
            }
            *out = sum as f32;
        }
        mean
    }
}

/// sinc(x) · sinc(x / 3) for |x| < 3.
fn lanczos3(x: f64) -> f64 {
    if x.abs() < 1e-9 {
        return 1.0;
    }
    if x.abs() >= 3.0 {
        return 0.0;
    }
    let a = std::f64::consts::PI * x;
    3.0 * a.sin() * (a / 3.0).sin() / (a * a)
}

/// The first cell that the interval touches and the share of the interval in it and each following one, when what lies
/// outside `0..cells` counts for the first or last cell. `None` for an interval without length.
fn shares(low: f64, high: f64, cells: usize) -> Option<(usize, Vec<f64>)> {
    let length = high - low;
    if !(length > 0.0 && length.is_finite()) {
        return None;
    }
    let last = cells - 1;
    let first = (low.floor().max(0.0) as usize).min(last);
    let end = (high.ceil().max(1.0) as usize).clamp(first + 1, cells);
    let share = |cell: usize| {
        let from = if cell == 0 { low } else { low.max(cell as f64) };
        let to = if cell == last {
            high
        } else {
            high.min((cell + 1) as f64)
        };
        (to - from).max(0.0) / length
    };
    Some((first, (first..end).map(share).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::pixel::LinearRgb;
    use crate::size::Size;
    use glam::dvec2;
    use proptest::prelude::*;

    const ALL: [Interpolation; 4] = [
        Interpolation::Nearest,
        Interpolation::Bilinear,
        Interpolation::CatmullRom,
        Interpolation::Lanczos3,
    ];

    fn noise(width: usize, height: usize, seed: u32) -> Plane {
        Plane::from_fn(Size::new(width, height).unwrap(), |col, row| {
            let mixed =
                (col as u32 * 7919 + row as u32 * 104_729 + seed).wrapping_mul(2_654_435_761);
            (mixed >> 8) as f32 / (1 << 24) as f32
        })
    }

    proptest! {
        #[test]
        fn a_constant_stays_constant(x in -20.0..30.0, y in -20.0..30.0, w in 1usize..9, h in 1usize..9) {
            let image = Image::new(Size::new(w, h).unwrap(), LinearRgb([0.25, 1.0, -3.0]));
            for interpolation in ALL {
                let found = image.sample(dvec2(x, y), interpolation);
                for (value, truth) in found.0.into_iter().zip([0.25, 1.0, -3.0f32]) {
                    // two passes of at most six rounded weights, sum of absolute weights below 1.6²
                    prop_assert!((value - truth).abs() <= 16.0 * f32::EPSILON * truth.abs());
                }
            }
        }

        #[test]
        fn a_linear_ramp_is_reproduced_between_pixels(x in 2.0f64..14.0, y in 2.0f64..14.0, a in -1.0f64..1.0, b in -1.0f64..1.0) {
            let ramp = |x: f64, y: f64| a * x + b * y + 1.0;
            let image = Plane::from_fn(Size::new(16, 16).unwrap(), |c, r| ramp(c as f64 + 0.5, r as f64 + 0.5) as f32);
            for found in [image.bilinear(dvec2(x, y)), image.catmull_rom(dvec2(x, y))] {
                // values up to 33, a few roundings each
                prop_assert!((f64::from(found) - ramp(x, y)).abs() <= 33.0 * 8.0 * f64::from(f32::EPSILON));
            }
        }

        #[test]
        fn the_area_average_agrees_with_the_sum_over_all_pixels(
            (w, h) in (1usize..9, 1usize..9), x in (-3.0f64..10.0, -3.0f64..10.0), y in (-3.0f64..10.0, -3.0f64..10.0)
        ) {
            let image = noise(w, h, 5);
            let (low, high) = (dvec2(x.0.min(x.1), y.0.min(y.1)), dvec2(x.0.max(x.1), y.0.max(y.1)));
            prop_assume!((high - low).min_element() > 1e-3);
            // the definition: the border really is continued by single pixels
            let overlap = |cell: isize, low: f64, high: f64| (high.min(cell as f64 + 1.0) - low.max(cell as f64)).max(0.0);
            let mut sum = 0.0;
            for row in -4..11 {
                for col in -4..11 {
                    let area = overlap(col, low.x, high.x) * overlap(row, low.y, high.y);
                    sum += area * f64::from(image.clamped(col, row));
                }
            }
            let truth = sum / ((high.x - low.x) * (high.y - low.y));
            let found = image.area_average(dvec2(x.0, y.1), dvec2(x.1, y.0));
            prop_assert!((f64::from(found) - truth).abs() < 1e-6, "{found} {truth}");
        }
    }

    #[test]
    fn at_a_pixel_center_every_kernel_gives_the_pixel() {
        let image = noise(7, 5, 1);
        for (col, row) in (0..5).flat_map(|row| (0..7).map(move |col| (col, row))) {
            for interpolation in ALL {
                let found = image.sample(dvec2(col as f64 + 0.5, row as f64 + 0.5), interpolation);
                assert!(
                    (found - image[(col, row)]).abs() < 1e-6,
                    "{interpolation:?}"
                );
            }
        }
    }

    #[test]
    fn bilinear_between_four_pixels_is_as_computed_by_hand() {
        let image = Image::from_vec(2, vec![0.0f32, 1.0, 2.0, 4.0]).unwrap();
        // a quarter of the way to the right, half way down: (0·¾ + 1·¼ + 2·¾ + 4·¼) / 2
        assert_eq!(image.bilinear(dvec2(0.75, 1.0)), 1.375);
    }

    #[test]
    fn positions_that_are_no_numbers_or_far_away_read_the_border() {
        let image = noise(4, 3, 9);
        for interpolation in ALL {
            let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
            assert!(near(
                image.sample(dvec2(f64::NAN, f64::NAN), interpolation),
                image[(0, 0)]
            ));
            assert!(near(
                image.sample(dvec2(f64::INFINITY, -1e300), interpolation),
                image[(3, 0)]
            ));
        }
        assert_eq!(
            image.area_average(dvec2(1.5, 1.5), dvec2(1.5, 9.0)),
            image[(1, 2)]
        );
        let _finite = image.area_average(dvec2(f64::NAN, 0.0), dvec2(f64::INFINITY, 1.0));
    }

    #[test]
    fn the_area_average_of_a_whole_image_is_its_mean() {
        let image = noise(13, 7, 3);
        let mean = image.pixels().iter().map(|&v| f64::from(v)).sum::<f64>() / 91.0;
        let found = image.area_average(dvec2(0.0, 0.0), dvec2(13.0, 7.0));
        assert!((f64::from(found) - mean).abs() < 1e-7);
    }
}
