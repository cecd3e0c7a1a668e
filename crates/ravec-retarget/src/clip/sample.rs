//! A frame's reduction, on which closed regions and motion are measured.

use crate::importance::barrier_size;
use ravec_raster::{AnyImage, Color, Image, LinearRgba, Oklab, with_image};

/// A measured frame.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    /// Number of the frame in the clip.
    pub(super) frame: usize,
    pub(super) small: Image<Oklab>,
}

impl Sample {
    /// Reduces a frame to some 200 pixels.
    pub(super) fn new(frame: usize, image: &AnyImage) -> Self {
        let small = with_image!(image, image => reduced(image));
        Self { frame, small }
    }
}

/// The means over boxes of whole pixels, in linear light over white.
///
/// Boxes differ by a pixel in size where the sides do not divide, which no measurement on them notices.
fn reduced<P: Color>(image: &Image<P>) -> Image<Oklab> {
    let size = barrier_size(image.size()).unwrap_or(image.size());
    let (cols, rows) = (size.width(), size.height());
    let first = |k: usize, count: usize, length: usize| (k * length).div_ceil(count);
    let ends: Vec<usize> = (1..=cols)
        .map(|col| first(col, cols, image.width()))
        .collect();
    let mut result = Image::new(size, Oklab([0.0; 3]));
    result.for_each_row(|row, out| {
        let top = first(row, rows, image.height());
        let bottom = first(row + 1, rows, image.height());
        let mut sums = vec![[0.0f32; 3]; cols];
        for y in top..bottom {
            let pixels = image.row(y);
            let mut from = 0;
            for (sum, &end) in sums.iter_mut().zip(&ends) {
                for &pixel in &pixels[from..end] {
                    let light = over_white::<P>(pixel.to_linear());
                    for (sum, light) in sum.iter_mut().zip(light) {
                        *sum += light;
                    }
                }
                from = end;
            }
        }
        let mut from = 0;
        for ((out, sum), &end) in out.iter_mut().zip(sums).zip(&ends) {
            let scale = 1.0 / ((end - from) * (bottom - top)) as f32;
            from = end;
            let [r, g, b] = sum.map(|v| {
                let mean = v * scale;
                if mean.is_finite() {
                    mean.clamp(0.0, 1e4)
                } else {
                    0.0
                }
            });
            *out = Oklab::from_linear(LinearRgba([r, g, b, 1.0]));
        }
    });
    result
}

#[inline(always)]
fn over_white<P: Color>(LinearRgba([r, g, b, alpha]): LinearRgba) -> [f32; 3] {
    if P::HAS_ALPHA {
        [r, g, b].map(|v| v * alpha + 1.0 - alpha)
    } else {
        [r, g, b]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{LinearRgb, Size, Srgba};

    #[test]
    fn boxes_hold_the_mean_of_their_pixels() {
        // 400 × 200: boxes of 2 × 2
        let image = Image::from_fn(Size::new(400, 200).unwrap(), |col, row| {
            LinearRgb([(col % 2) as f32, (row % 2) as f32, col as f32 / 400.0])
        });
        let found = reduced(&image).convert::<LinearRgb>();
        assert_eq!((found.width(), found.height()), (200, 100));
        for (k, pixel) in found.pixels().iter().enumerate() {
            let expected = [0.5, 0.5, (2 * (k % 200)) as f32 / 400.0 + 0.5 / 400.0];
            for (found, expected) in pixel.0.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-4, "{pixel:?} {expected}");
            }
        }
    }

    #[test]
    fn every_pixel_is_in_one_box_and_what_is_clear_is_white() {
        for (width, height) in [(1, 1), (3, 500), (401, 7), (640, 359)] {
            let clear = Image::new(Size::new(width, height).unwrap(), Srgba([9u8, 9, 9, 0]));
            for pixel in Sample::new(0, &clear.into()).small.pixels() {
                assert!((pixel.0[0] - 1.0).abs() < 1e-4, "{pixel:?}");
            }
        }
    }

    #[test]
    fn what_is_no_number_is_dark() {
        let broken = Image::new(Size::new(20, 10).unwrap(), LinearRgb([f32::NAN; 3]));
        assert!(reduced(&broken).pixels().iter().all(|p| p.0 == [0.0; 3]));
    }
}
