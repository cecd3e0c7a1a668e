//! From a color for each position to a picture: rows in parallel, supersampled where needed.

use glam::{DVec2, Vec3};
use ravec_raster::color::LINEAR_FROM_SRGB8;
use ravec_raster::{Image, LinearRgb, Size};
use rayon::prelude::*;

/// Linear light of an encoded color written as `0xRRGGBB`: palettes read like those of a painting program.
#[inline]
pub(crate) fn hex(color: u32) -> Vec3 {
    let channel = |shift: u32| LINEAR_FROM_SRGB8[(color >> shift & 0xff) as usize];
    Vec3::new(channel(16), channel(8), channel(0))
}

/// The center of a pixel.
#[inline]
pub(crate) fn center(col: usize, row: usize) -> DVec2 {
    DVec2::new(col as f64 + 0.5, row as f64 + 0.5)
}

/// A picture whose pixel `(col, row)` is `color_at(center of the pixel)`.
pub(crate) fn paint(size: Size, color_at: impl Fn(DVec2) -> Vec3 + Sync) -> Image<LinearRgb> {
    let mut image = Image::new(size, LinearRgb([0.0; 3]));
    image.for_each_row(|row, pixels| {
        for (col, pixel) in pixels.iter_mut().enumerate() {
            *pixel = LinearRgb(color_at(center(col, row)).to_array());
        }
    });
    image
}

/// Differences between neighbors, in (gamma 2 encoded) units of 1, above which a pixel is sampled more densely.
/// Larger leaves visible steps on faint edges; smaller samples plain texture again without any gain.
const CONTRAST: f32 = 0.03;

/// A picture of `color_at(position, side)`, which gives the color of about a square of side `side` around a position.
///
/// One sample where a pixel differs little from its eight neighbors, `grid`² samples elsewhere, placed so that each
/// column and each row of a `grid`² × `grid`² raster holds one. Error where a straight border crosses a pixel: the
/// covered area is within 1/`grid` (0.3/`grid` is typical), times the difference of the colors. A detail that is
/// smaller than a pixel and that no pixel center sees is lost, unless `color_at` makes use of `side`.
pub(crate) fn paint_adaptive(
    size: Size,
    grid: usize,
    color_at: impl Fn(DVec2, f64) -> Vec3 + Sync,
) -> Image<LinearRgb> {
    let coarse = paint(size, |p| color_at(p, 1.0));
    let brightness = coarse.map(|LinearRgb(rgb)| LinearRgb(rgb.map(|v| v.max(0.0).sqrt())));
    let mut image = coarse;
    let step = 1.0 / grid as f64;
    image
        .par_rows_mut()
        .enumerate()
        .with_max_len(4)
        .for_each(|(row, pixels)| {
            for (col, pixel) in pixels.iter_mut().enumerate() {
                if !differs(&brightness, col, row) {
                    continue;
                }
                let corner = DVec2::new(col as f64, row as f64);
                let mut sum = Vec3::ZERO;
                for j in 0..grid {
                    for i in 0..grid {
                        let at = |major: usize, minor: usize| {
                            (major as f64 + (minor as f64 + 0.5) * step) * step
                        };
                        sum += color_at(corner + DVec2::new(at(i, j), at(j, i)), step);
                    }
                }
                *pixel = LinearRgb((sum / (grid * grid) as f32).to_array());
            }
        });
    image
}

fn differs(brightness: &Image<LinearRgb>, col: usize, row: usize) -> bool {
    let LinearRgb(own) = brightness[(col, row)];
    (-1..=1).any(|dy| {
        (-1..=1).any(|dx| {
            let LinearRgb(other) = brightness.clamped(col as isize + dx, row as isize + dy);
            own.iter().zip(other).any(|(a, b)| (a - b).abs() > CONTRAST)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::{HalfPlane, disc_coverage};

    #[test]
    fn adaptive_samples_of_a_border_are_within_the_stated_error() {
        let size = Size::new(24, 24).unwrap();
        for degrees in (0..180).step_by(7) {
            let h = HalfPlane::from_angle(f64::from(degrees).to_radians(), DVec2::new(12.2, 11.7));
            let sampled =
                paint_adaptive(size, 4, |p, _| Vec3::splat(f32::from(h.distance(p) < 0.0)));
            for row in 0..24 {
                for col in 0..24 {
                    let exact = h.coverage(center(col, row)) as f32;
                    assert!((sampled[(col, row)].0[0] - exact).abs() <= 0.25);
                }
            }
        }
    }

    #[test]
    fn smooth_parts_keep_one_sample() {
        let size = Size::new(9, 9).unwrap();
        let sides = paint_adaptive(size, 4, |p, side| {
            // a faint ramp, and a disc; the second channel marks the samples that were taken
            let inside = disc_coverage(DVec2::new(2.0, 2.0), 1.5, p) as f32;
            Vec3::new(0.5 + 0.001 * p.x as f32, 0.0, inside + 0.001 * side as f32)
        });
        assert!((sides[(8, 8)].0[2] - 0.001).abs() < 1e-6);
        assert_ne!(sides[(2, 3)].0[2], 0.001);
    }
}
