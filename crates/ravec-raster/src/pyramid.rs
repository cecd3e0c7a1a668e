//! A picture at ever coarser scales.
//!
//! Each level has half the pixels of the one below in each direction, rounded up, down to a single pixel. The factor is
//! exactly 2 for every size: coarse pixel `c` covers the fine pixels `2c` and `2c + 1`, and a position is halved from
//! level to level (`x_in_coarse = x_in_fine / 2`). At an odd border the last coarse pixel covers the one fine pixel that
//! there is (area), or continues the border (gaussian).
//!
//! Source: Burt and Adelson, "The Laplacian Pyramid as a Compact Image Code", 1983. We differ in the kernel: with pixel
//! centers at one half, a factor of 2 needs an even kernel, here the binomial 1 3 3 1, else levels shift by half a pixel.
//!
//! Cost: 1/3 of the picture in memory beside it; O(pixels).

use crate::average::Average;
use crate::image::Image;
use crate::size::Size;
use rayon::prelude::*;

/// Filter that makes a level from the finer one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Reduction {
    /// The mean of 2 × 2 pixels. Exact means over areas, a little aliasing.
    #[default]
    Area,
    /// Weights 1 3 3 1 in each direction (standard deviation 0.87 fine pixels). Smoother, less aliasing.
    Gaussian,
}

/// A picture and its reductions, finest first.
///
/// ```
/// use ravec_raster::{Plane, Pyramid, Reduction, Size};
///
/// let pyramid = Pyramid::new(Plane::new(Size::new(5, 3)?, 1.0), Reduction::Area);
/// let sizes: Vec<_> = pyramid.levels().iter().map(|level| level.size().to_string()).collect();
/// assert_eq!(sizes, ["5 x 3", "3 x 2", "2 x 1", "1 x 1"]);
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Pyramid<P> {
    levels: Vec<Image<P>>,
}

impl<P: Average> Pyramid<P> {
    /// All levels down to 1 × 1.
    pub fn new(image: Image<P>, reduction: Reduction) -> Self {
        Self::with_levels(image, reduction, usize::MAX)
    }

    /// At most `max_levels` levels, the picture itself included (0 is taken as 1).
    pub fn with_levels(image: Image<P>, reduction: Reduction, max_levels: usize) -> Self {
        let mut levels = vec![image];
        while levels.len() < max_levels {
            let Some(coarse) = levels.last().filter(|last| last.size().pixels() > 1) else {
                break;
            };
            levels.push(halved(coarse, reduction));
        }
        Self { levels }
    }

    /// All levels, finest first; at least one.
    pub fn levels(&self) -> &[Image<P>] {
        &self.levels
    }

    /// Level `index`, 0 the picture itself; the coarsest if there is none so high.
    pub fn level(&self, index: usize) -> &Image<P> {
        &self.levels[index.min(self.levels.len() - 1)]
    }
}

/// The picture at half the size in each direction, rounded up. See [`Pyramid`] for the geometry.
pub fn halved<P: Average>(image: &Image<P>, reduction: Reduction) -> Image<P> {
    let (width, height) = (image.width(), image.height());
    let size: Size = image.size().cells(2);
    let mut result = Image::new(size, P::ZERO);
    match reduction {
        Reduction::Area => result.for_each_row(|row, out| {
            // an odd last row or column stands twice, which leaves its mean as it is
            let upper = image.row(2 * row);
            let lower = image.row((2 * row + 1).min(height - 1));
            for (col, pixel) in out.iter_mut().enumerate() {
                let (a, b) = (2 * col, (2 * col + 1).min(width - 1));
                let sum = P::ZERO.plus(0.25, upper[a]).plus(0.25, upper[b]);
                *pixel = sum.plus(0.25, lower[a]).plus(0.25, lower[b]);
            }
        }),
        Reduction::Gaussian => result.par_rows_mut().enumerate().for_each_init(
            || vec![P::ZERO; width],
            |mixed, (row, out)| {
                let tap = |index: usize, offset: isize, length: usize| {
                    (2 * index as isize + offset).clamp(0, length as isize - 1) as usize
                };
                mixed.fill(P::ZERO);
                for (offset, weight) in BINOMIAL {
                    let source = image.row(tap(row, offset, height));
                    for (sum, &pixel) in mixed.iter_mut().zip(source) {
                        *sum = sum.plus(weight, pixel);
                    }
                }
                for (col, pixel) in out.iter_mut().enumerate() {
                    *pixel = BINOMIAL.iter().fold(P::ZERO, |sum, &(offset, weight)| {
                        sum.plus(weight, mixed[tap(col, offset, width)])
                    });
                }
            },
        ),
    }
    result
}

/// Offsets from fine pixel `2c` and their weights: the binomial 1 3 3 1, symmetric about the coarse center.
const BINOMIAL: [(isize, f32); 4] = [(-1, 0.125), (0, 0.375), (1, 0.375), (2, 0.125)];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use proptest::prelude::*;

    const BOTH: [Reduction; 2] = [Reduction::Area, Reduction::Gaussian];

    proptest! {
        #[test]
        fn levels_halve_down_to_one_pixel_and_keep_a_constant(w in 1usize..70, h in 1usize..70) {
            for reduction in BOTH {
                let image = Image::new(Size::new(w, h).unwrap(), [0.5f32, -2.0]);
                let pyramid = Pyramid::new(image, reduction);
                for pair in pyramid.levels().windows(2) {
                    prop_assert_eq!(pair[1].size(), pair[0].size().cells(2));
                }
                prop_assert_eq!(pyramid.level(usize::MAX).size().pixels(), 1);
                // all weights are sums of powers of two: exact
                prop_assert!(pyramid.levels().iter().all(|l| l.pixels().iter().all(|&p| p == [0.5, -2.0])));
            }
        }
    }

    #[test]
    fn a_ramp_is_halved_without_a_shift() {
        let ramp = Plane::from_fn(Size::new(32, 16).unwrap(), |col, row| {
            (col as f32 + 0.5) + 100.0 * (row as f32 + 0.5)
        });
        for reduction in BOTH {
            let coarse = halved(&ramp, reduction);
            for (col, row) in (1..7).flat_map(|row| (1..15).map(move |col| (col, row))) {
                let truth = 2.0 * (col as f32 + 0.5) + 200.0 * (row as f32 + 0.5);
                assert_eq!(coarse[(col, row)], truth);
            }
        }
    }

    #[test]
    fn an_odd_border_is_the_mean_of_what_there_is() {
        let image =
            Image::from_vec(3, vec![1.0f32, 2.0, 4.0, 3.0, 6.0, 8.0, 5.0, 7.0, 9.0]).unwrap();
        assert_eq!(
            halved(&image, Reduction::Area).pixels(),
            [3.0, 6.0, 6.0, 9.0]
        );
    }

    #[test]
    fn the_number_of_levels_can_be_limited() {
        let image = Plane::new(Size::new(64, 64).unwrap(), 0.0);
        assert_eq!(
            Pyramid::with_levels(image.clone(), Reduction::Area, 3)
                .levels()
                .len(),
            3
        );
        assert_eq!(
            Pyramid::with_levels(image, Reduction::Area, 0)
                .levels()
                .len(),
            1
        );
    }

    #[test]
    fn one_thread_and_many_give_the_same_bytes() {
        let image = Plane::from_fn(Size::new(101, 77).unwrap(), |col, row| {
            ((col * row) as f32).sin()
        });
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| Pyramid::new(image.clone(), Reduction::Gaussian))
        };
        assert_eq!(on(1), on(4));
    }
}
