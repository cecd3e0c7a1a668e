//! Summed-area tables: sums over any rectangle at the cost of four look-ups.
//!
//! Source: Crow, "Summed-area tables for texture mapping", 1984.
//!
//! Sums are kept in `f64`. Guarantees: a rectangle's sum is within about 2⁻⁵² of the sum over the whole image of its
//! absolute values times a small number, so means of whole photographs are good to 12 digits, and variances from sums of
//! squares stay usable. Integers up to 2⁵³ in total are summed without error.
//!
//! Cost: O(pixels) once, 8 bytes a pixel; O(1) a query.

use crate::image::{Image, Plane};
use crate::pixel::Pixel;
use crate::rect::Rect;
use crate::size::Size;
use rayon::prelude::*;

/// The table of one channel.
///
/// ```
/// use ravec_raster::{Integral, Plane, Rect, Size};
///
/// let plane = Plane::from_fn(Size::new(4, 3)?, |col, row| (col + 10 * row) as f32);
/// let table = Integral::new(&plane);
/// assert_eq!(table.sum(Rect::new(1, 1, 2, 2)), 11.0 + 12.0 + 21.0 + 22.0);
/// assert_eq!(table.mean(Rect::new(3, 2, 9, 9)), Some(23.0));
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Integral {
    size: Size,
    /// Entry (col, row) of a table with one column and row more: the sum of all pixels left of and above it.
    sums: Vec<f64>,
}

impl Integral {
    /// The table of a plane.
    pub fn new(plane: &Plane) -> Self {
        Self::of(plane, f64::from)
    }

    /// The table of a value of each pixel: a channel, a square, a product.
    pub fn of<P: Pixel>(image: &Image<P>, value: impl Fn(P) -> f64 + Sync) -> Self {
        let stride = image.width() + 1;
        let mut sums = vec![0.0; stride * (image.height() + 1)];
        sums[stride..]
            .par_chunks_exact_mut(stride)
            .zip(image.par_rows())
            .for_each(|(line, row)| {
                let mut sum = 0.0;
                for (entry, &pixel) in line[1..].iter_mut().zip(row) {
                    sum += value(pixel);
                    *entry = sum;
                }
            });
        for row in 1..=image.height() {
            let (above, here) = sums.split_at_mut(row * stride);
            let above = &above[(row - 1) * stride..];
            for (entry, sum) in here[..stride].iter_mut().zip(above) {
                *entry += sum;
            }
        }
        Self {
            size: image.size(),
            sums,
        }
    }

    /// Columns and rows of the image.
    pub fn size(&self) -> Size {
        self.size
    }

    /// The sum over the part of `rect` that lies in the image; 0 if there is none.
    pub fn sum(&self, rect: Rect) -> f64 {
        let rect = rect.clipped(self.size);
        if rect.is_empty() {
            return 0.0;
        }
        let at = |col: usize, row: usize| self.sums[row * (self.size.width() + 1) + col];
        (at(rect.right(), rect.bottom()) - at(rect.col, rect.bottom()))
            - (at(rect.right(), rect.row) - at(rect.col, rect.row))
    }

    /// The mean over the part of `rect` that lies in the image, if there is one.
    pub fn mean(&self, rect: Rect) -> Option<f64> {
        let rect = rect.clipped(self.size);
        (!rect.is_empty()).then(|| self.sum(rect) / rect.pixels() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_agree_with_the_double_loop(
            (w, h) in (1usize..12, 1usize..12),
            (col, row, cols, rows) in (0usize..14, 0usize..14, 0usize..14, 0usize..14),
            seed in 0u32..1000,
        ) {
            // whole numbers: the table is exact
            let plane = Plane::from_fn(Size::new(w, h).unwrap(), |col, row| {
                (((row * w + col) as u32 + seed).wrapping_mul(2_654_435_761) >> 12) as f32
            });
            let rect = Rect::new(col, row, cols, rows);
            let table = Integral::new(&plane);
            let squares = Integral::of(&plane, |v| f64::from(v).powi(2));
            let inside = rect.clipped(plane.size());
            let values: Vec<f64> = (inside.row..inside.bottom())
                .flat_map(|r| (inside.col..inside.right()).map(move |c| (c, r)))
                .map(|at| f64::from(plane[at]))
                .collect();
            let sum: f64 = values.iter().sum();
            prop_assert_eq!(table.sum(rect), sum);
            prop_assert_eq!(squares.sum(rect), values.iter().map(|v| v * v).sum::<f64>());
            let mean = (!values.is_empty()).then(|| sum / values.len() as f64);
            prop_assert_eq!(table.mean(rect), mean);
        }
    }

    #[test]
    fn one_thread_and_many_give_the_same_bits() {
        let plane = Plane::from_fn(Size::new(60, 90).unwrap(), |col, row| {
            ((col * row) as f32).sin()
        });
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| Integral::new(&plane))
        };
        assert_eq!(on(1), on(4));
    }
}
