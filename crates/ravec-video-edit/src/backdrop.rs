//! A picture behind everything, as frames show it.

use crate::interpolated::Interpolator;
use crate::{Colors, VideoEditError};
use glam::{DVec2, dvec2};
use ravec_planar::Homography;
use ravec_progress::Progress;
use ravec_raster::Size;

/// A picture with a replicated border.
///
/// Magnified views are interpolated with a Lanczos kernel. Minified views average up to 4 × 4 such samples per pixel, which is sharper
/// and faster than an elliptical Gaussian. Minification by a factor above 5 and views that contain the horizon use the elliptical filter
/// of [`warp`](fn@ravec_planar::warp).
#[derive(Clone)]
pub struct Backdrop(Interpolator);

impl Backdrop {
    /// Prepares a picture.
    ///
    /// # Errors
    /// [`VideoEditError::Size`] for a picture at the largest size.
    pub fn new(colors: &Colors) -> Result<Self, VideoEditError> {
        Ok(Self(Interpolator::continued(colors)?))
    }

    /// The picture seen through a map from the output. Behind the horizon it is black.
    ///
    /// # Errors
    /// [`VideoEditError::Cancelled`].
    pub fn view(
        &self,
        picture_from_output: &Homography,
        size: Size,
        progress: &Progress,
    ) -> Result<Colors, VideoEditError> {
        let (w, h) = (size.width() as f64, size.height() as f64);
        let points = [
            DVec2::ZERO,
            dvec2(w, 0.0),
            dvec2(w, h),
            dvec2(0.0, h),
            dvec2(w, h) * 0.5,
        ];
        let seen = self.0.seen(picture_from_output, &points, size, progress)?;
        Ok(seen.map(|[r, g, b, _]| [r, g, b]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Image;

    fn wave(at: DVec2) -> f32 {
        (0.5 + 0.3 * (0.23 * at.x).sin() * (0.31 * at.y).cos()) as f32
    }

    fn picture() -> Colors {
        Image::from_fn(Size::new(160, 120).unwrap(), |col, row| {
            let value = wave(dvec2(col as f64 + 0.5, row as f64 + 0.5));
            [value, 0.25, 1.0 - value]
        })
    }

    /// The mean of the wave over a pixel of the output, by its definition.
    fn mean(map: &Homography, col: usize, row: usize) -> f32 {
        let fine = 16;
        let steps = (0..fine * fine).map(|step| {
            let (x, y) = (step % fine, step / fine);
            let within = dvec2(x as f64 + 0.5, y as f64 + 0.5) / f64::from(fine);
            wave(map.apply(dvec2(col as f64, row as f64) + within))
        });
        steps.sum::<f32>() / (fine * fine) as f32
    }

    #[test]
    fn pixels_are_the_mean_of_what_they_show_and_borders_go_on() {
        let backdrop = Backdrop::new(&picture()).unwrap();
        let progress = Progress::none();
        for (scale, bound) in [(0.4, 0.002), (1.0, 0.01), (1.8, 0.004), (3.1, 0.01)] {
            let map = Homography::from_scale(DVec2::splat(scale)).unwrap();
            let shift = Homography::from_translation(dvec2(7.3, 5.6)).unwrap();
            let map = shift * map;
            let size = Size::new((140.0 / scale) as usize, (100.0 / scale) as usize).unwrap();
            let found = backdrop.view(&map, size, &progress).unwrap();
            for row in 0..size.height() {
                for col in 0..size.width() {
                    let [r, g, b] = found[(col, row)];
                    let truth = mean(&map, col, row);
                    assert!((r - truth).abs() < bound, "{scale}: {r} {truth}");
                    assert!((g - 0.25).abs() < 1e-5 && (r + b - 1.0).abs() < 1e-5);
                }
            }
        }
        // far outside, the color of the nearest corner; in every filter
        for scale in [0.5, 2.0, 9.0] {
            let far = Homography::from_translation(dvec2(-400.0, -300.0)).unwrap();
            let map = far * Homography::from_scale(DVec2::splat(scale)).unwrap();
            let found = backdrop
                .view(&map, Size::new(3, 3).unwrap(), &progress)
                .unwrap();
            let corner = picture()[(0, 0)];
            for c in 0..3 {
                assert!((found[(1, 1)][c] - corner[c]).abs() < 1e-4, "{scale}");
            }
        }
    }

    #[test]
    fn strong_reductions_and_horizons_are_filtered() {
        let size = Size::new(64, 48).unwrap();
        let reduced = Homography::from_scale(DVec2::splat(6.0)).unwrap();
        let mut matrix = glam::DMat3::IDENTITY;
        matrix.y_axis.z = -0.05;
        let tilted = Homography::from_matrix(matrix).unwrap();
        let backdrop = Backdrop::new(&picture()).unwrap();
        for map in [reduced, tilted] {
            let found = backdrop.view(&map, size, &Progress::none()).unwrap();
            assert!((found[(5, 5)][1] - 0.25).abs() < 1e-3);
        }
    }
}
