//! Images that are read in linear light, whatever their pixel type.

use crate::image::Image;
use crate::pixel::{Color, LinearRgba};
use crate::size::Size;

/// An image that is read in linear light, whatever its pixel type.
///
/// Long algorithms take `&dyn LinearRows` rather than `&Image<P>`: they are compiled once, in their own crate, and not for
/// each pixel type in each crate that calls them. A call costs some nanoseconds, so read runs of pixels.
///
/// ```
/// use ravec_raster::{Image, LinearRgba, LinearRows, Size, Srgb};
///
/// fn light(image: &dyn LinearRows) -> f32 {
///     let mut row = vec![LinearRgba::default(); image.size().width()];
///     image.read_linear(0, 0, &mut row);
///     row.iter().map(|pixel| pixel.0[0]).sum()
/// }
///
/// let white = Image::new(Size::new(3, 1)?, Srgb([255u8; 3]));
/// assert_eq!(light(&white), 3.0);
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
pub trait LinearRows: Sync {
    /// Columns and rows.
    fn size(&self) -> Size;

    /// `true` if the pixel type stores alpha.
    fn has_alpha(&self) -> bool;

    /// Reads the pixels of `row` from `first_col` on, as many as `out` has, by [`Color::to_linear`].
    ///
    /// # Panics
    /// If some of them lie outside the image.
    fn read_linear(&self, row: usize, first_col: usize, out: &mut [LinearRgba]);
}

impl<P: Color> LinearRows for Image<P> {
    fn size(&self) -> Size {
        Self::size(self)
    }

    fn has_alpha(&self) -> bool {
        P::HAS_ALPHA
    }

    fn read_linear(&self, row: usize, first_col: usize, out: &mut [LinearRgba]) {
        let pixels = &self.row(row)[first_col..][..out.len()];
        for (out, pixel) in out.iter_mut().zip(pixels) {
            *out = pixel.to_linear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel::{LinearRgb, Srgba};

    #[test]
    fn runs_of_pixels_are_those_of_the_image() {
        let image = Image::from_fn(Size::new(5, 3).unwrap(), |col, row| {
            Srgba([40 * col as u8, 90 * row as u8, 7, 50 * col as u8])
        });
        let rows: &dyn LinearRows = &image;
        assert!(rows.has_alpha() && rows.size() == image.size());
        let mut run = [LinearRgba::default(); 3];
        rows.read_linear(2, 1, &mut run);
        assert_eq!(run, [1, 2, 3].map(|col| image[(col, 2)].to_linear()));
        assert!(!LinearRows::has_alpha(&image.convert::<LinearRgb>()));
    }
}
