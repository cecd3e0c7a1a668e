//! Small pictures of luma, made cheaply from large frames.

use ravec_raster::color::{luminance, srgb_from_linear};
use ravec_raster::{LinearRgb, Pixel, Plane, Size, Srgb};

/// A pixel whose encoded luma, 0 to 1, can be averaged over a block.
pub trait LumaPixel: Pixel {
    /// The quantity that is averaged.
    fn light(self) -> f32;

    /// Encoded luma from the mean of [`LumaPixel::light`].
    fn encode(mean: f32) -> f32;
}

/// Encoded luma itself.
impl LumaPixel for f32 {
    fn light(self) -> f32 {
        self
    }

    fn encode(mean: f32) -> f32 {
        mean
    }
}

/// The weights of Rec. 709 on encoded values, which is what video calls luma.
impl LumaPixel for Srgb<u8> {
    fn light(self) -> f32 {
        luminance(self.0.map(f32::from))
    }

    fn encode(mean: f32) -> f32 {
        mean / 255.0
    }
}

/// The weights of Rec. 709 on encoded values, which is what video calls luma.
impl LumaPixel for Srgb<u16> {
    fn light(self) -> f32 {
        luminance(self.0.map(f32::from))
    }

    fn encode(mean: f32) -> f32 {
        mean / 65535.0
    }
}

/// The mean of linear light, encoded afterwards.
impl LumaPixel for LinearRgb {
    fn light(self) -> f32 {
        luminance(self.0)
    }

    fn encode(mean: f32) -> f32 {
        srgb_from_linear(mean)
    }
}

/// Encoded luma beyond this range is clipped, so that no sum overflows.
const RANGE: [f32; 2] = [-1.0, 4.0];

/// Means over blocks of `factor` × `factor` pixels. Rows and columns that fill no block are left out, so that a position in
/// the result times `factor` is one in the picture. A mean that is not a number becomes 0.
pub(super) fn reduced<P: LumaPixel>(
    size: Size,
    rows: &[P],
    factor: usize,
) -> Result<Plane, ravec_raster::SizeError> {
    let (width, height) = (size.width() / factor, size.height() / factor);
    let share = ((factor * factor) as f32).recip();
    let mut sums = vec![0.0f32; width * factor];
    let mut pixels = Vec::with_capacity(width * height);
    for block in rows.chunks_exact(size.width() * factor).take(height) {
        sums.fill(0.0);
        for row in block.chunks_exact(size.width()) {
            for (sum, &pixel) in sums.iter_mut().zip(row) {
                *sum += pixel.light();
            }
        }
        pixels.extend(sums.chunks_exact(factor).map(|column| {
            let luma = P::encode(column.iter().sum::<f32>() * share);
            if luma.is_nan() {
                0.0
            } else {
                luma.clamp(RANGE[0], RANGE[1])
            }
        }));
    }
    Plane::from_vec(width, pixels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Image;

    fn reduce<P: LumaPixel>(image: &Image<P>, factor: usize) -> Plane {
        reduced(image.size(), image.pixels(), factor).unwrap()
    }

    #[test]
    fn a_block_becomes_its_mean_and_the_rest_is_left_out() {
        let size = Size::new(7, 5).unwrap();
        let image = Plane::from_fn(size, |col, row| (col + 10 * row) as f32 / 100.0);
        let small = reduce(&image, 2);
        assert_eq!(small.size(), Size::new(3, 2).unwrap());
        // columns 2 and 3, rows 2 and 3
        assert!((small[(1, 1)] - 0.275).abs() < 1e-6);
    }

    #[test]
    fn all_kinds_of_pixels_agree_on_a_flat_color() {
        let size = Size::new(4, 4).unwrap();
        let eight = Image::new(size, Srgb([120u8; 3]));
        let deep = Image::new(size, Srgb([120u16 * 257; 3]));
        let expected = 120.0 / 255.0;
        for found in [
            reduce(&eight, 2)[(0, 0)],
            reduce(&deep, 2)[(0, 0)],
            reduce(&eight.convert::<LinearRgb>(), 2)[(0, 0)],
            reduce(&Plane::new(size, expected), 4)[(0, 0)],
        ] {
            assert!((found - expected).abs() < 1e-5, "{found}");
        }
    }

    #[test]
    fn numbers_that_are_none_become_finite() {
        let size = Size::new(2, 2).unwrap();
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
            assert!(reduce(&Plane::new(size, bad), 2)[(0, 0)].is_finite());
        }
    }
}
