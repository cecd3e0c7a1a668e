//! Metrics of the visible difference between two pictures.
//!
//! Pictures are compared as shown: alpha is laid over middle gray (encoded 0.5) in linear light, colors are cut off at
//! black and white, NaN reads as black. Opaque pictures are not touched by the first. The loss that this hides is
//! reported beside it: [`Comparison::alpha_max_abs`] and [`Comparison::identical`].
//!
//! Sums are kept in `f64` over fixed strips that are added in order, so figures are the same on any number of threads.
//!
//! Cost: O(pixels); memory 4 bytes a pixel and one strip a thread beside the pictures. Differing colors cost most, by
//! CIEDE2000.

use crate::chunks::for_each_chunk;
use crate::color::{linear_from_srgb, srgb_from_linear};
use crate::delta_e::{ciede2000, delta_e_oklab, lab_from_linear};
use crate::image::{Image, Plane};
use crate::pixel::{Color, LinearRgba};
use crate::size::Size;
use crate::ssim::{REACH, Slab};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// The difference of two pictures of one size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Peak signal-to-noise ratio in decibels, over red, green and blue together, of the encoded values with white as
    /// peak: what 8-bit programs call PSNR. Infinite if nothing that is shown differs.
    pub psnr_db: f64,
    /// Mean structural similarity (Wang 2004) of the encoded luma (weights 0.299, 0.587, 0.114), at most 1. Windows that
    /// reach over the border are left out if the picture is larger than 10 pixels in both directions.
    pub ssim: f64,
    /// Mean CIEDE2000 difference; about 1 is just noticeable.
    pub delta_e_mean: f64,
    /// The CIEDE2000 difference that 95 % of the pixels do not exceed (nearest rank).
    pub delta_e_p95: f64,
    /// The largest CIEDE2000 difference.
    pub delta_e_max: f64,
    /// Mean Euclidean distance in Oklab; about 0.02 is noticeable.
    pub delta_e_oklab_mean: f64,
    /// The largest difference of an encoded red, green or blue value, 0 to 1 (times 255: steps of 8 bits).
    pub max_abs: f64,
    /// The largest difference of alpha, 0 to 1.
    pub alpha_max_abs: f64,
    /// `true` if all pixels are equal in linear light with straight alpha, also where they are transparent, beyond
    /// white or not a number.
    pub identical: bool,
}

/// Why two pictures could not be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MetricError {
    /// Only pictures of one size can be compared pixel by pixel.
    #[error("pictures of {left} and {right} pixels cannot be compared: resize or crop one of them")]
    Sizes {
        /// Size of the first picture.
        left: Size,
        /// Size of the second.
        right: Size,
    },
    /// The caller no longer wants the result.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// All figures at once.
///
/// ```
/// use ravec_raster::{Image, Size, Srgb, compare};
///
/// let a = Image::new(Size::new(32, 32)?, Srgb([100u8, 100, 100]));
/// let b = Image::new(Size::new(32, 32)?, Srgb([101u8, 101, 101]));
/// let found = compare(&a, &b)?;
/// // one step of 255: 20 log10 255
/// assert!((found.psnr_db - 48.13).abs() < 0.01);
/// assert!((found.max_abs * 255.0 - 1.0).abs() < 1e-3);
/// assert_eq!(compare(&a, &a)?.psnr_db, f64::INFINITY);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`MetricError::Sizes`] if the sizes differ.
pub fn compare<A: Color, B: Color>(a: &Image<A>, b: &Image<B>) -> Result<Comparison, MetricError> {
    compare_with_progress(a, b, &Progress::none())
}

/// [`compare`] for large pictures: reports the phase "compare" in rows and can be cancelled.
///
/// # Errors
/// [`MetricError::Sizes`] if the sizes differ, [`MetricError::Cancelled`] soon after `progress` is cancelled.
pub fn compare_with_progress<A: Color, B: Color>(
    a: &Image<A>,
    b: &Image<B>,
    progress: &Progress,
) -> Result<Comparison, MetricError> {
    check_sizes(a, b)?;
    let size = a.size();
    let phase = progress.phase("compare", size.height() as u64);
    let mut delta_e = Plane::new(size, 0.0);
    let strips: Result<Vec<Sums>, Cancelled> = delta_e
        .par_strips_mut(ROWS_PER_STRIP)
        .enumerate()
        .map(|(index, out)| {
            let mut sums = Sums::default();
            let first = index * ROWS_PER_STRIP;
            let rows = out.len() / size.width();
            let (mut seen_a, mut seen_b) = (SeenRow::new(size.width()), SeenRow::new(size.width()));
            let mut slab = Slab::new(size.width());
            let halo = Halo::around(first, rows, size.height());
            for row in halo.above..halo.below {
                progress.check()?;
                seen_a.read(a.row(row));
                seen_b.read(b.row(row));
                slab.push(&seen_a.luma, &seen_b.luma);
                if (first..first + rows).contains(&row) {
                    let out = &mut out[(row - first) * size.width()..][..size.width()];
                    sums.add_stored(a.row(row), b.row(row));
                    sums.add_seen(&seen_a, &seen_b, out);
                }
            }
            let (inner_cols, inner_rows) = interior(size);
            let mut similarity = vec![0.0; size.width()];
            for row in (first..first + rows).filter(|row| inner_rows.contains(row)) {
                progress.check()?;
                slab.similarity(row - halo.above, &mut similarity);
                let inner = &similarity[inner_cols.clone()];
                sums.similarity += inner.iter().map(|&value| f64::from(value)).sum::<f64>();
            }
            phase.advance(rows as u64);
            Ok(sums)
        })
        .collect();
    let mut total = Sums::default();
    strips?.iter().for_each(|strip| total.add(strip));

    let pixels = size.pixels() as f64;
    let (inner_cols, inner_rows) = interior(size);
    let mut differences = delta_e.into_pixels();
    let rank = (0.95 * pixels).ceil() as usize;
    let (_, p95, _) = differences.select_nth_unstable_by(rank.max(1) - 1, f32::total_cmp);
    Ok(Comparison {
        psnr_db: total.psnr_db(size),
        ssim: total.similarity / (inner_cols.len() * inner_rows.len()) as f64,
        delta_e_mean: total.delta_e / pixels,
        delta_e_p95: f64::from(*p95),
        delta_e_max: total.delta_e_max,
        delta_e_oklab_mean: total.delta_e_oklab / pixels,
        max_abs: total.max_abs,
        alpha_max_abs: total.alpha_max_abs,
        identical: !total.different,
    })
}

/// The peak signal-to-noise ratio alone, [`Comparison::psnr_db`], in a fraction of the time of [`compare`].
///
/// # Errors
/// [`MetricError::Sizes`] if the sizes differ.
pub fn psnr_db<A: Color, B: Color>(a: &Image<A>, b: &Image<B>) -> Result<f64, MetricError> {
    check_sizes(a, b)?;
    let size = a.size();
    let strips: Vec<Sums> = (0..size.height().div_ceil(ROWS_PER_STRIP))
        .into_par_iter()
        .map(|index| {
            let mut sums = Sums::default();
            let (mut seen_a, mut seen_b) = (SeenRow::new(size.width()), SeenRow::new(size.width()));
            let first = index * ROWS_PER_STRIP;
            for row in first..(first + ROWS_PER_STRIP).min(size.height()) {
                seen_a.read(a.row(row));
                seen_b.read(b.row(row));
                sums.add_encoded(&seen_a, &seen_b);
            }
            sums
        })
        .collect();
    let mut total = Sums::default();
    for strip in &strips {
        total.add(strip);
    }
    Ok(total.psnr_db(size))
}

/// The structural similarity at each pixel, at most 1; see [`Comparison::ssim`]. At the border the picture goes on.
///
/// # Errors
/// [`MetricError::Sizes`] if the sizes differ.
pub fn ssim_map<A: Color, B: Color>(a: &Image<A>, b: &Image<B>) -> Result<Plane, MetricError> {
    check_sizes(a, b)?;
    let (width, height) = (a.width(), a.height());
    let mut result = Plane::new(a.size(), 0.0);
    for_each_chunk(result.pixels_mut(), width * ROWS_PER_STRIP, |first, out| {
        let first = first / width;
        let halo = Halo::around(first, out.len() / width, height);
        let (mut seen_a, mut seen_b) = (SeenRow::new(width), SeenRow::new(width));
        let mut slab = Slab::new(width);
        for row in halo.above..halo.below {
            seen_a.read(a.row(row));
            seen_b.read(b.row(row));
            slab.push(&seen_a.luma, &seen_b.luma);
        }
        for (row, out) in (first..).zip(out.chunks_exact_mut(width)) {
            slab.similarity(row - halo.above, out);
        }
    });
    Ok(result)
}

/// The CIEDE2000 difference at each pixel; see [`Comparison::delta_e_mean`].
///
/// # Errors
/// [`MetricError::Sizes`] if the sizes differ.
pub fn delta_e_map<A: Color, B: Color>(a: &Image<A>, b: &Image<B>) -> Result<Plane, MetricError> {
    check_sizes(a, b)?;
    let mut result = Plane::new(a.size(), 0.0);
    result
        .par_rows_mut()
        .zip(a.par_rows().zip(b.par_rows()))
        .for_each(|(out, (a, b))| {
            for (value, (&a, &b)) in out.iter_mut().zip(a.iter().zip(b)) {
                *value = delta_e(shown(a.to_linear()), shown(b.to_linear())) as f32;
            }
        });
    Ok(result)
}

/// Rows whose figures are summed together. Smaller repeats more of the ten rows that windows reach beyond a strip,
/// larger leaves threads idle on small pictures.
const ROWS_PER_STRIP: usize = 64;

fn check_sizes<A: Color, B: Color>(a: &Image<A>, b: &Image<B>) -> Result<(), MetricError> {
    if a.size() == b.size() {
        Ok(())
    } else {
        Err(MetricError::Sizes {
            left: a.size(),
            right: b.size(),
        })
    }
}

/// The columns and rows whose windows lie in the picture, or all if there would be none.
fn interior(size: Size) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
    let margin = if size.width().min(size.height()) > 2 * REACH {
        REACH
    } else {
        0
    };
    (
        margin..size.width() - margin,
        margin..size.height() - margin,
    )
}

/// The rows that the windows of a strip can see.
struct Halo {
    above: usize,
    below: usize,
}

impl Halo {
    fn around(first: usize, rows: usize, height: usize) -> Self {
        Self {
            above: first.saturating_sub(REACH),
            below: (first + rows + REACH).min(height),
        }
    }
}

/// One row as it is seen.
struct SeenRow {
    linear: Vec<[f32; 3]>,
    encoded: Vec<[f32; 3]>,
    luma: Vec<f32>,
}

impl SeenRow {
    fn new(width: usize) -> Self {
        Self {
            linear: vec![[0.0; 3]; width],
            encoded: vec![[0.0; 3]; width],
            luma: vec![0.0; width],
        }
    }

    fn read<P: Color>(&mut self, row: &[P]) {
        for (seen, pixel) in self.linear.iter_mut().zip(row) {
            *seen = shown(pixel.to_linear());
        }
        // over plain numbers, so that the loop vectorises
        let linear = self.linear.as_flattened();
        for (encoded, &linear) in self.encoded.as_flattened_mut().iter_mut().zip(linear) {
            *encoded = srgb_from_linear(linear);
        }
        for (luma, [r, g, b]) in self.luma.iter_mut().zip(&self.encoded) {
            *luma = 0.299 * r + 0.587 * g + 0.114 * b;
        }
    }
}

/// A share of 0 to 1; NaN is 0.
#[inline(always)]
fn unit(value: f32) -> f32 {
    if value > 0.0 { value.min(1.0) } else { 0.0 }
}

/// The linear light that is seen of a pixel in front of middle gray.
#[inline(always)]
fn shown(pixel: LinearRgba) -> [f32; 3] {
    let alpha = unit(pixel.alpha());
    let color = pixel.rgb().map(unit);
    if alpha == 1.0 {
        color
    } else {
        let behind = (1.0 - alpha) * linear_from_srgb(0.5);
        color.map(|value| alpha * value + behind)
    }
}

fn delta_e(a: [f32; 3], b: [f32; 3]) -> f64 {
    if a == b {
        return 0.0;
    }
    ciede2000(
        lab_from_linear(a).map(f64::from),
        lab_from_linear(b).map(f64::from),
    )
}

/// Sums over the rows of a strip.
#[derive(Default)]
struct Sums {
    squares: f64,
    similarity: f64,
    delta_e: f64,
    delta_e_oklab: f64,
    delta_e_max: f64,
    max_abs: f64,
    alpha_max_abs: f64,
    different: bool,
}

impl Sums {
    /// Adds the figures that need the stored pixels.
    fn add_stored<A: Color, B: Color>(&mut self, a: &[A], b: &[B]) {
        for (&a, &b) in a.iter().zip(b) {
            let (a, b) = (a.to_linear(), b.to_linear());
            let mut pairs = a.0.iter().zip(b.0);
            self.different |= !pairs.all(|(&x, y)| x == y || (x.is_nan() && y.is_nan()));
            if A::HAS_ALPHA || B::HAS_ALPHA {
                let alpha = f64::from(unit(a.alpha()) - unit(b.alpha())).abs();
                self.alpha_max_abs = self.alpha_max_abs.max(alpha);
            }
        }
    }

    /// Adds the differences of encoded values.
    fn add_encoded(&mut self, a: &SeenRow, b: &SeenRow) {
        let encoded = a
            .encoded
            .as_flattened()
            .iter()
            .zip(b.encoded.as_flattened());
        for (&x, &y) in encoded {
            let difference = f64::from(x) - f64::from(y);
            self.squares += difference * difference;
            self.max_abs = self.max_abs.max(difference.abs());
        }
    }

    /// Adds what is seen, and writes the CIEDE2000 differences.
    fn add_seen(&mut self, a: &SeenRow, b: &SeenRow, delta_e_out: &mut [f32]) {
        self.add_encoded(a, b);
        let linear = a.linear.iter().zip(&b.linear);
        for (out, (&a, &b)) in delta_e_out.iter_mut().zip(linear) {
            if a != b {
                let difference = delta_e(a, b);
                *out = difference as f32;
                self.delta_e += difference;
                self.delta_e_max = self.delta_e_max.max(difference);
                self.delta_e_oklab += f64::from(delta_e_oklab(a, b));
            }
        }
    }

    fn psnr_db(&self, size: Size) -> f64 {
        let mean_square = self.squares / (3.0 * size.pixels() as f64);
        // log of a reciprocal: no error is infinitely good
        -10.0 * mean_square.log10()
    }

    fn add(&mut self, other: &Self) {
        self.squares += other.squares;
        self.similarity += other.similarity;
        self.delta_e += other.delta_e;
        self.delta_e_oklab += other.delta_e_oklab;
        self.delta_e_max = self.delta_e_max.max(other.delta_e_max);
        self.max_abs = self.max_abs.max(other.max_abs);
        self.alpha_max_abs = self.alpha_max_abs.max(other.alpha_max_abs);
        self.different |= other.different;
    }
}
