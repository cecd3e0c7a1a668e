//! Gaussian blur and first derivatives.
//!
//! The kernel of standard deviation σ is sampled at whole pixels up to a distance of ⌈4σ⌉ and divided by its sum. What
//! is cut off has less than 6.4e-5 of the whole weight, so a pixel of an image with values in 0 to 1 differs by less than
//! 1.3e-4 from the blur with the endless kernel. Outside the image its border pixels go on.
//!
//! The plain idea:
//!
//! ```text
//! for each pixel: sum over rows j and columns i of k[i] k[j] image[clamp(col + i), clamp(row + j)]
//! ```
//!
//! Departures: (1) one pass over columns, one over rows; (2) strips of rows do both passes while their rows are in the
//! cache, in parallel; (3) symmetric taps share a multiplication; (4) sums of [`LANES`] neighbors stay in registers,
//! in the widest vectors of the machine, with equal results on all.
//!
//! Cost: O(σ) a pixel; memory one strip of at most 24σ + 64 rows a thread beside the result.

use crate::average::Average;
use crate::chunks::for_each_chunk;
use crate::image::{Image, Plane};
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;

/// Rows of a strip that are not kernel overlap. Smaller repeats more of the horizontal pass, larger leaves the cache.
pub(crate) const STRIP_ROWS: usize = 64;

/// Neighboring sums that are kept in registers: two to eight vectors, by the machine.
const LANES: usize = 32;

/// The largest standard deviation, beyond which a blur is computed as if it were this. With it the kernel has 80 001
/// taps, more than any picture that fits into memory has columns to distinguish.
const MAX_SIGMA_PX: f64 = 10_000.0;

/// The image blurred by a gaussian of standard deviation `sigma_px` in pixels.
///
/// More softens more and costs more; 0, less, or not a number leaves the image as it is; above 10 000 counts as 10 000.
///
/// ```
/// use ravec_raster::{Plane, Size, gaussian_blur};
///
/// let mut dot = Plane::new(Size::new(9, 9)?, 0.0);
/// dot[(4, 4)] = 1.0;
/// // the peak of a gaussian of variance 1 in the plane is 1 / 2π
/// let peak = gaussian_blur(&dot, 1.0)[(4, 4)];
/// assert!((peak - 0.159).abs() < 1e-3);
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
pub fn gaussian_blur<P: Average>(image: &Image<P>, sigma_px: f64) -> Image<P> {
    if sigma_px.is_nan() || sigma_px <= 0.0 {
        return image.clone();
    }
    let kernel = half_kernel(sigma_px.min(MAX_SIGMA_PX));
    let reach = kernel.len() - 1;
    let (width, height) = (image.width(), image.height());
    let row_len = width * P::CHANNELS;
    // with wide kernels, higher strips keep the repeated part of the horizontal pass below a half
    let strip_rows = STRIP_ROWS.max(4 * reach);
    let mut result = Image::new(image.size(), P::ZERO);
    for_each_chunk(result.pixels_mut(), width * strip_rows, |first, pixels| {
        let first = first / width;
        let rows = pixels.len() / width;
        let above = first.saturating_sub(reach);
        let below = (first + rows + reach).min(height);
        let mut wide = vec![0.0; (below - above) * row_len];
        let mut padded = Vec::with_capacity((width + 2 * reach) * P::CHANNELS);
        for (out, row) in wide.chunks_exact_mut(row_len).zip(above..below) {
            pad(image.row(row), reach, &mut padded);
            let center = reach * P::CHANNELS;
            let taps: Vec<_> = (0..=reach)
                .map(|tap| tap * P::CHANNELS)
                .map(|step| (&padded[center - step..], &padded[center + step..]))
                .collect();
            weigh(out, &kernel, &taps);
        }
        let line = |row: usize| &wide[(row.clamp(above, below - 1) - above) * row_len..][..row_len];
        for (out, row) in P::numbers_mut(pixels)
            .chunks_exact_mut(row_len)
            .zip(first..)
        {
            let taps: Vec<_> = (0..=reach)
                .map(|tap| (line(row.saturating_sub(tap)), line(row + tap)))
                .collect();
            weigh(out, &kernel, &taps);
        }
    });
    result
}

/// The kernel at distances 0, 1, …, ⌈4σ⌉, of sum 1 when both sides are counted.
fn half_kernel(sigma_px: f64) -> Vec<f32> {
    let reach = (4.0 * sigma_px).ceil() as usize;
    let raw: Vec<f64> = (0..=reach)
        .map(|i| (-0.5 * (i as f64 / sigma_px).powi(2)).exp())
        .collect();
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    raw.iter().map(|weight| (weight / sum) as f32).collect()
}

/// The floats of a row with its first and last pixel repeated `reach` times.
pub(crate) fn pad<P: Average>(row: &[P], reach: usize, padded: &mut Vec<f32>) {
    let numbers = P::numbers(row);
    padded.clear();
    for _ in 0..reach {
        padded.extend_from_slice(&numbers[..P::CHANNELS]);
    }
    padded.extend_from_slice(numbers);
    for _ in 0..reach {
        padded.extend_from_slice(&numbers[numbers.len() - P::CHANNELS..]);
    }
}

/// `out[i] = k[0] · center[i] + Σ k[tap] · (before[i] + after[i])`, where `taps` are the two slices of each distance.
pub(crate) fn weigh(out: &mut [f32], kernel: &[f32], taps: &[(&[f32], &[f32])]) {
    fill(out, &SymmetricTaps { kernel, taps });
}

/// `out[i] = Σ weight · row[i]` over rows as long as `out`, each with its weight.
pub(crate) fn sum_weighed(out: &mut [f32], rows: &[(f32, &[f32])]) {
    fill(out, &WeightedRows(rows));
}

/// Weighted sums along a row.
trait RowSums {
    /// The sums of `N` neighbors from `start`.
    fn sums<const N: usize>(&self, start: usize) -> [f32; N];
}

/// Taps on both sides of a center with equal weights.
struct SymmetricTaps<'a> {
    kernel: &'a [f32],
    taps: &'a [(&'a [f32], &'a [f32])],
}

impl RowSums for SymmetricTaps<'_> {
    #[inline(always)]
    fn sums<const N: usize>(&self, start: usize) -> [f32; N] {
        let mut sums = [0.0f32; N];
        for (sum, value) in sums.iter_mut().zip(&self.taps[0].0[start..start + N]) {
            *sum = self.kernel[0] * value;
        }
        for (&weight, (before, after)) in self.kernel.iter().zip(self.taps).skip(1) {
            let (before, after) = (&before[start..start + N], &after[start..start + N]);
            for ((sum, a), b) in sums.iter_mut().zip(before).zip(after) {
                *sum += weight * (a + b);
            }
        }
        sums
    }
}

/// Rows and their weights.
struct WeightedRows<'a>(&'a [(f32, &'a [f32])]);

impl RowSums for WeightedRows<'_> {
    #[inline(always)]
    fn sums<const N: usize>(&self, start: usize) -> [f32; N] {
        let mut sums = [0.0f32; N];
        for (weight, row) in self.0 {
            for (sum, value) in sums.iter_mut().zip(&row[start..start + N]) {
                *sum += weight * value;
            }
        }
        sums
    }
}

/// Fills a row with sums, in the widest vectors of the machine.
fn fill(out: &mut [f32], row: &impl RowSums) {
    dispatch!(Level::new(), simd => fill_on(simd, out, row));
}

#[inline(always)]
fn fill_on<S: Simd>(_simd: S, out: &mut [f32], row: &impl RowSums) {
    let (chunks, rest) = out.as_chunks_mut::<LANES>();
    for (index, chunk) in chunks.iter_mut().enumerate() {
        *chunk = row.sums(index * LANES);
    }
    if rest.is_empty() {
        return;
    }
    // the last lanes of a row, some of them once more
    let count = out.len();
    if let Some(last) = out.last_chunk_mut::<LANES>() {
        *last = row.sums(count - LANES);
        return;
    }
    for (at, value) in out.iter_mut().enumerate() {
        [*value] = row.sums(at);
    }
}

/// The first derivatives of a plane, in units of its values a pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Gradient {
    /// Change to the right.
    pub gx: Plane,
    /// Change downwards.
    pub gy: Plane,
}

impl Gradient {
    /// Half the difference of the two neighbors. Exact for linear and quadratic planes; passes all noise across its
    /// direction. At the border the missing neighbor is the pixel itself, so that slopes there read as half.
    pub fn central(plane: &Plane) -> Self {
        Self::with_cross(plane, [0.0, 1.0, 0.0])
    }

    /// The central difference, averaged over three lines with weights 3, 10, 3 (Scharr 2000): angles are nearly
    /// independent of the direction of an edge, and there is less noise. The border is continued.
    pub fn scharr(plane: &Plane) -> Self {
        Self::with_cross(plane, [3.0 / 16.0, 10.0 / 16.0, 3.0 / 16.0])
    }

    /// The length of the gradient at each pixel.
    pub fn magnitude(&self) -> Plane {
        let mut result = Plane::new(self.gx.size(), 0.0);
        result
            .par_rows_mut()
            .zip(self.gx.par_rows().zip(self.gy.par_rows()))
            .for_each(|(out, (gx, gy))| {
                for (value, (x, y)) in out.iter_mut().zip(gx.iter().zip(gy)) {
                    *value = (x * x + y * y).sqrt();
                }
            });
        result
    }

    fn with_cross(plane: &Plane, cross: [f32; 3]) -> Self {
        let (width, height) = (plane.width(), plane.height());
        let mut gx = Plane::new(plane.size(), 0.0);
        let mut gy = gx.clone();
        gx.par_rows_mut()
            .zip(gy.par_rows_mut())
            .enumerate()
            .for_each_init(
                || (Vec::new(), Vec::new()),
                |(down, mixed), (row, (gx, gy))| {
                    let above = plane.row(row.saturating_sub(1));
                    let here = plane.row(row);
                    let below = plane.row((row + 1).min(height - 1));
                    // both with one pixel more on each side
                    let lines = above.iter().zip(here).zip(below);
                    padded_with(down, lines.clone().map(|((a, _), b)| 0.5 * (b - a)));
                    padded_with(
                        mixed,
                        lines.map(|((a, h), b)| 0.5 * (cross[0] * a + cross[1] * h + cross[2] * b)),
                    );
                    for col in 0..width {
                        gx[col] = mixed[col + 2] - mixed[col];
                        gy[col] = cross[0] * down[col]
                            + cross[1] * down[col + 1]
                            + cross[2] * down[col + 2];
                    }
                },
            );
        Self { gx, gy }
    }
}

/// Fills `line` with the values, the first and the last of them twice.
fn padded_with(line: &mut Vec<f32>, values: impl Iterator<Item = f32>) {
    line.clear();
    line.push(0.0);
    line.extend(values);
    line[0] = line[1];
    line.push(line[line.len() - 1]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel::PremulLinearRgba;
    use crate::size::Size;
    use proptest::prelude::*;

    fn noise(width: usize, height: usize, seed: u32) -> Image<[f32; 3]> {
        let value = |n: usize| {
            ((n as u32 + seed).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32
        };
        Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            [0, 1, 2].map(|channel| value(3 * (row * width + col) + channel))
        })
    }

    /// The definition: a double sum with the kernel in two dimensions.
    fn blur_naive(image: &Image<[f32; 3]>, sigma_px: f64) -> Image<[f32; 3]> {
        let reach = (4.0 * sigma_px).ceil() as isize;
        let bell =
            |i: isize, j: isize| (-0.5 * (i * i + j * j) as f64 / (sigma_px * sigma_px)).exp();
        let offsets = || (-reach..=reach).flat_map(|j| (-reach..=reach).map(move |i| (i, j)));
        let total: f64 = offsets().map(|(i, j)| bell(i, j)).sum();
        Image::from_fn(image.size(), |col, row| {
            let mut sums = [0.0f64; 3];
            for (i, j) in offsets() {
                let pixel = image.clamped(col as isize + i, row as isize + j);
                for (sum, value) in sums.iter_mut().zip(pixel) {
                    *sum += bell(i, j) * f64::from(value);
                }
            }
            sums.map(|sum| (sum / total) as f32)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn the_blur_agrees_with_the_double_sum(
            (w, h) in (1usize..40, 1usize..40), sigma_px in 0.1f64..4.0, seed in 0u32..1000
        ) {
            let image = noise(w, h, seed);
            let (fast, plain) = (gaussian_blur(&image, sigma_px), blur_naive(&image, sigma_px));
            for (a, b) in fast.pixels().iter().flatten().zip(plain.pixels().iter().flatten()) {
                // two passes of up to 33 rounded products of values and weights below 1
                prop_assert!((a - b).abs() <= 70.0 * f32::EPSILON, "{a} {b}");
            }
        }

        #[test]
        fn gradients_agree_with_their_stencils((w, h) in (1usize..12, 1usize..12), seed in 0u32..1000) {
            let plane = noise(w, h, seed).map(|pixel| pixel[0]);
            let (central, scharr) = (Gradient::central(&plane), Gradient::scharr(&plane));
            for (col, row) in (0..h).flat_map(|row| (0..w).map(move |col| (col, row))) {
                let at = |i: isize, j: isize| plane.clamped(col as isize + i, row as isize + j);
                let across = |f: &dyn Fn(isize) -> f32| (3.0 * f(-1) + 10.0 * f(0) + 3.0 * f(1)) / 16.0;
                let truths = [
                    (central.gx[(col, row)], (at(1, 0) - at(-1, 0)) / 2.0),
                    (central.gy[(col, row)], (at(0, 1) - at(0, -1)) / 2.0),
                    (scharr.gx[(col, row)], across(&|j| (at(1, j) - at(-1, j)) / 2.0)),
                    (scharr.gy[(col, row)], across(&|i| (at(i, 1) - at(i, -1)) / 2.0)),
                ];
                for (found, truth) in truths {
                    prop_assert!((found - truth).abs() <= 8.0 * f32::EPSILON);
                }
            }
        }
    }

    #[test]
    fn a_blur_over_many_strips_has_no_seam() {
        // rows depend on the row alone, so the blur in one dimension is the truth
        let image = Plane::from_fn(Size::new(3, 300).unwrap(), |_, row| {
            ((row * row) as f32 * 0.01).sin()
        });
        let column = Image::from_vec(300, image.rows().map(|row| row[0]).collect()).unwrap();
        let (tall, wide) = (gaussian_blur(&image, 2.5), gaussian_blur(&column, 2.5));
        for row in 0..300 {
            assert!((tall[(1, row)] - wide[(row, 0)]).abs() < 4e-6, "row {row}");
        }
    }

    #[test]
    fn a_kernel_wider_than_the_image_keeps_constants() {
        let image = Image::new(
            Size::new(5, 3).unwrap(),
            PremulLinearRgba([0.5, 0.25, 0.0, 1.0]),
        );
        for pixel in gaussian_blur(&image, 60.0).pixels() {
            for (value, truth) in pixel.0.into_iter().zip([0.5f32, 0.25, 0.0, 1.0]) {
                assert!((value - truth).abs() < 2e-5);
            }
        }
    }

    #[test]
    fn no_blur_is_asked_for_by_zero_negative_or_nan() {
        let image = noise(4, 4, 0);
        for sigma_px in [0.0, -1.0, f64::NAN] {
            assert_eq!(gaussian_blur(&image, sigma_px), image);
        }
    }

    #[test]
    fn what_the_kernel_leaves_out_is_as_stated() {
        for sigma_px in [0.3f64, 0.5, 1.0, 2.0, 7.3] {
            let bell = |i: usize| (-0.5 * (i as f64 / sigma_px).powi(2)).exp();
            let reach = (4.0 * sigma_px).ceil() as usize;
            let inside: f64 = 1.0 + 2.0 * (1..=reach).map(bell).sum::<f64>();
            let outside: f64 = 2.0 * (reach + 1..200).map(bell).sum::<f64>();
            assert!(outside / inside < 6.4e-5, "{sigma_px}");
        }
    }

    #[test]
    fn a_tilted_plane_has_its_slope_as_gradient() {
        let plane = Plane::from_fn(Size::new(9, 9).unwrap(), |col, row| {
            3.0 * col as f32 + 4.0 * row as f32
        });
        for gradient in [Gradient::central(&plane), Gradient::scharr(&plane)] {
            let at = (4, 4);
            assert_eq!((gradient.gx[at], gradient.gy[at]), (3.0, 4.0));
            assert_eq!(gradient.magnitude()[at], 5.0);
        }
    }

    #[test]
    fn one_thread_and_many_give_the_same_bytes() {
        let image = noise(50, 200, 3);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| gaussian_blur(&image, 1.7))
        };
        assert_eq!(on(1), on(4));
    }
}
