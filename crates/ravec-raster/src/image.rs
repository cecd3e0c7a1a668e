//! The image: a rectangle of pixels of one type.

use crate::chunks::for_each_chunk;
use crate::pixel::{Color, Pixel, Sample, Srgb, Srgba};
use crate::size::{Size, SizeError};
use rayon::prelude::*;
use std::any::TypeId;

/// A rectangle of pixels, row by row from the top, without padding.
///
/// Column and row are integers `(col, row)`; a position `(x, y)` is real, y down, and the center of pixel `(col, row)` is
/// at `(col + 0.5, row + 0.5)`.
///
/// ```
/// use ravec_raster::{Image, Size, Srgb};
///
/// let ramp = Image::from_fn(Size::new(4, 2)?, |col, row| Srgb([64 * col as u8, 128 * row as u8, 0]));
/// assert_eq!(ramp[(3, 1)], Srgb([192, 128, 0]));
/// assert_eq!(ramp.row(0).len(), 4);
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Image<P> {
    size: Size,
    pixels: Vec<P>,
}

/// Pixels of a task of [`Image::map`]: large enough that starting it costs nothing beside the work.
const MAP_CHUNK: usize = 4096;

/// A single channel of reals: a luminance, a gradient, a weight.
pub type Plane = Image<f32>;

impl<P: Pixel> Image<P> {
    /// An image filled with `pixel`.
    pub fn new(size: Size, pixel: P) -> Self {
        Self {
            size,
            pixels: vec![pixel; size.pixels()],
        }
    }

    /// An image filled by `pixel_at(col, row)`, row by row in one thread.
    pub fn from_fn(size: Size, mut pixel_at: impl FnMut(usize, usize) -> P) -> Self {
        let mut pixels = Vec::with_capacity(size.pixels());
        for row in 0..size.height() {
            pixels.extend((0..size.width()).map(|col| pixel_at(col, row)));
        }
        Self { size, pixels }
    }

    /// An image of `width` columns from its pixels, row by row.
    ///
    /// # Errors
    /// [`SizeError`] if the pixels are not a whole positive number of rows.
    pub fn from_vec(width: usize, pixels: Vec<P>) -> Result<Self, SizeError> {
        let height = pixels.len().checked_div(width).unwrap_or(0);
        let size = Size::new(width, height)?;
        if size.pixels() != pixels.len() {
            return Err(SizeError {
                width: width as u64,
                height: height as u64,
            });
        }
        Ok(Self { size, pixels })
    }

    /// Columns and rows.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Columns, at least 1.
    pub fn width(&self) -> usize {
        self.size.width()
    }

    /// Rows, at least 1.
    pub fn height(&self) -> usize {
        self.size.height()
    }

    /// All pixels, row by row.
    pub fn pixels(&self) -> &[P] {
        &self.pixels
    }

    /// All pixels, row by row.
    pub fn pixels_mut(&mut self) -> &mut [P] {
        &mut self.pixels
    }

    /// The pixels themselves.
    pub fn into_pixels(self) -> Vec<P> {
        self.pixels
    }

    /// One row.
    ///
    /// # Panics
    /// If `row` is not below the height.
    pub fn row(&self, row: usize) -> &[P] {
        let width = self.width();
        &self.pixels[row * width..][..width]
    }

    /// One row.
    ///
    /// # Panics
    /// If `row` is not below the height.
    pub fn row_mut(&mut self, row: usize) -> &mut [P] {
        let width = self.width();
        &mut self.pixels[row * width..][..width]
    }

    /// The rows from the top.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[P]> {
        self.pixels.chunks_exact(self.width())
    }

    /// The rows from the top, to be worked on by several threads.
    pub fn par_rows(&self) -> impl IndexedParallelIterator<Item = &[P]> {
        self.pixels.par_chunks_exact(self.width())
    }

    /// The rows from the top, to be written by several threads.
    pub fn par_rows_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [P]> {
        let width = self.width();
        self.pixels.par_chunks_exact_mut(width)
    }

    /// Calls `work(row, pixels)` for every row, in parallel.
    ///
    /// ```
    /// use ravec_raster::{Plane, Size};
    ///
    /// let mut ramp = Plane::new(Size::new(3, 5)?, 0.0);
    /// ramp.for_each_row(|row, pixels| pixels.fill(row as f32));
    /// assert_eq!(ramp.row(4), [4.0; 3]);
    /// # Ok::<(), ravec_raster::SizeError>(())
    /// ```
    pub fn for_each_row(&mut self, work: impl Fn(usize, &mut [P]) + Sync) {
        let width = self.width();
        for_each_chunk(&mut self.pixels, width, |first, pixels| {
            work(first / width, pixels);
        });
    }

    /// Strips of `rows` rows (the last may be lower), to be written by several threads.
    ///
    /// # Panics
    /// If `rows` is 0.
    pub fn par_strips_mut(&mut self, rows: usize) -> impl IndexedParallelIterator<Item = &mut [P]> {
        let width = self.width();
        self.pixels.par_chunks_mut(width * rows)
    }

    /// The pixel at a position, or nothing outside the image.
    pub fn get(&self, col: usize, row: usize) -> Option<P> {
        (col < self.width() && row < self.height()).then(|| self[(col, row)])
    }

    /// The nearest pixel of the image to any integer position: the border goes on outside.
    #[inline]
    pub fn clamped(&self, col: isize, row: isize) -> P {
        let col = col.clamp(0, self.width() as isize - 1) as usize;
        let row = row.clamp(0, self.height() as isize - 1) as usize;
        self.pixels[row * self.width() + col]
    }

    /// The image with `f` applied to each pixel, in parallel.
    pub fn map<Q: Pixel>(&self, f: impl Fn(P) -> Q + Sync + Send) -> Image<Q> {
        let mut pixels = bytemuck::zeroed_vec(self.pixels.len());
        for_each_chunk(&mut pixels, MAP_CHUNK, |first, chunk| {
            for (target, &pixel) in chunk.iter_mut().zip(&self.pixels[first..]) {
                *target = f(pixel);
            }
        });
        Image {
            size: self.size,
            pixels,
        }
    }

    /// The part that begins at `(col, row)`, clipped to the image.
    ///
    /// # Errors
    /// [`SizeError`] if nothing of the image lies in the part.
    pub fn crop(&self, col: usize, row: usize, size: Size) -> Result<Self, SizeError> {
        let width = size.width().min(self.width().saturating_sub(col));
        let height = size.height().min(self.height().saturating_sub(row));
        let size = Size::new(width, height)?;
        let mut pixels = Vec::with_capacity(width * height);
        for y in row..row + height {
            pixels.extend_from_slice(&self.row(y)[col..col + width]);
        }
        Ok(Self { size, pixels })
    }
}

impl<P: Color> Image<P> {
    /// The same picture in another pixel type, in parallel. In its own type it is a copy, bit for bit.
    pub fn convert<Q: Color>(&self) -> Image<Q> {
        if TypeId::of::<P>() == TypeId::of::<Q>() {
            return Image {
                size: self.size,
                pixels: bytemuck::cast_slice(&self.pixels).to_vec(),
            };
        }
        self.map(|pixel| Q::from_linear(pixel.to_linear()))
    }

    /// Returns `true` if every pixel is fully opaque.
    pub fn is_opaque(&self) -> bool {
        !P::HAS_ALPHA
            || self
                .pixels
                .par_iter()
                .all(|pixel| pixel.to_linear().alpha() >= 1.0)
    }
}

impl<T: Sample> Image<Srgb<T>> {
    /// The same encoded values in another kind of sample, rounded to the nearest. Faster than [`convert`](Self::convert), which goes by
    /// linear light.
    ///
    /// ```
    /// use ravec_raster::{Image, Size, Srgb};
    ///
    /// let image = Image::new(Size::new(2, 2)?, Srgb([0u8, 51, 255]));
    /// assert_eq!(image.with_samples::<f32>()[(1, 1)], Srgb([0.0, 0.2, 1.0]));
    /// # Ok::<(), ravec_raster::SizeError>(())
    /// ```
    pub fn with_samples<U: Sample>(&self) -> Image<Srgb<U>> {
        self.map(|Srgb(values)| Srgb(values.map(|value| U::from_unit(value.to_unit()))))
    }
}

impl<T: Sample> Image<Srgba<T>> {
    /// The same encoded values and alpha in another kind of sample, rounded to the nearest.
    pub fn with_samples<U: Sample>(&self) -> Image<Srgba<U>> {
        self.map(|Srgba(values)| Srgba(values.map(|value| U::from_unit(value.to_unit()))))
    }
}

impl<P: Pixel> std::ops::Index<(usize, usize)> for Image<P> {
    type Output = P;

    /// The pixel at `(col, row)`.
    ///
    /// # Panics
    /// Outside the image.
    fn index(&self, (col, row): (usize, usize)) -> &P {
        &self.row(row)[col]
    }
}

impl<P: Pixel> std::ops::IndexMut<(usize, usize)> for Image<P> {
    fn index_mut(&mut self, (col, row): (usize, usize)) -> &mut P {
        &mut self.row_mut(row)[col]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel::{LinearRgba, Srgb, Srgba};

    fn numbered(width: usize, height: usize) -> Image<u16> {
        Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            (10 * row + col) as u16
        })
    }

    #[test]
    fn pixels_lie_row_by_row() {
        let image = numbered(3, 2);
        assert_eq!(image.pixels(), [0, 1, 2, 10, 11, 12]);
        assert_eq!(image[(2, 1)], 12);
        assert_eq!(
            (image.get(2, 1), image.get(3, 0), image.get(0, 2)),
            (Some(12), None, None)
        );
        assert_eq!(image.clamped(-5, 9), 10);
    }

    #[test]
    fn a_crop_is_clipped_to_the_image() {
        let part = numbered(5, 4).crop(3, 2, Size::new(9, 9).unwrap()).unwrap();
        assert_eq!(part.pixels(), [23, 24, 33, 34]);
        assert!(numbered(5, 4).crop(5, 0, Size::new(1, 1).unwrap()).is_err());
    }

    #[test]
    fn pixels_must_make_whole_rows() {
        assert!(Image::from_vec(3, vec![0u8; 7]).is_err());
        assert!(Image::from_vec(0, vec![0u8; 7]).is_err());
        assert!(Image::from_vec(3, Vec::<u8>::new()).is_err());
        assert_eq!(Image::from_vec(3, vec![0u8; 6]).unwrap().height(), 2);
    }

    #[test]
    fn conversion_keeps_color_and_alpha() {
        let image = Image::new(Size::new(2, 2).unwrap(), Srgba([200u8, 100, 50, 128]));
        assert_eq!(image.convert::<LinearRgba>().convert::<Srgba<u8>>(), image);
        assert!(!image.is_opaque());
        assert!(image.convert::<Srgb<u8>>().is_opaque());
    }
}
