//! Images of another size, resampled in linear light.
//!
//! When a picture shrinks, the kernel is stretched by the same factor, so that nothing aliases. Pixels that may not be
//! averaged (encoded, straight alpha) are turned into premultiplied linear light on the way, strip by strip, and back.
//! The resampling itself is that of `fast_image_resize`; we cut its work into fixed strips for the threads.
//!
//! Guarantees: a constant image stays constant to rounding; the same bytes on any number of threads; the same size gives
//! the same image, bit for bit. Does not guarantee: the same bytes on machines with other vector units, where sums round
//! differently. Catmull-Rom, Mitchell and Lanczos may overshoot: float pixels below 0 or above 1 are kept, integers clip.
//!
//! Cost: two passes of kernel width × max(1, shrink factor); memory a few strips beside the result.

use crate::average::Average;
use crate::image::Image;
use crate::pixel::{
    Color, LinearRgb, LinearRgba, Oklab, Pixel, PremulLinearRgba, Sample, Srgb, Srgba,
};
use crate::size::Size;
use fast_image_resize as fir;
use rayon::prelude::*;

/// The kernel of a [`resize`](crate::resize()).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum ResizeFilter {
    /// The pixel at the same relative place. Never a new value; aliases. For labels and for pixel art.
    Nearest,
    /// The mean of the pixels whose centers lie in the new pixel: exact areas for whole shrink factors. Blocky when
    /// growing.
    Box,
    /// A tent. Never overshoots; soft.
    Bilinear,
    /// Cubic, interpolating: sharper than bilinear, slight overshoot.
    CatmullRom,
    /// Cubic, between Catmull-Rom and a blur: little ringing.
    Mitchell,
    /// Windowed sinc: the sharpest, rings at hard edges.
    #[default]
    Lanczos3,
}

/// A pixel that [`resize`](crate::resize()) can handle, possibly by way of another one.
pub trait Resample: Pixel {
    /// The type in which pixels are averaged; of at most 4 channels.
    type Averaged: Average;
    /// These pixels, ready to be averaged: themselves, or others in a buffer.
    fn averaged<'a>(
        pixels: &'a [Self],
        buffer: &'a mut Vec<Self::Averaged>,
    ) -> &'a [Self::Averaged];
    /// A pixel from an average.
    fn from_averaged(average: Self::Averaged) -> Self;
}

macro_rules! resample_directly {
    ($($pixel:ty),*) => {
        $(impl Resample for $pixel {
            type Averaged = Self;
            #[inline]
            fn averaged<'a>(pixels: &'a [Self], _: &'a mut Vec<Self>) -> &'a [Self] {
                pixels
            }
            #[inline(always)]
            fn from_averaged(average: Self) -> Self {
                average
            }
        })*
    };
}

macro_rules! resample_by {
    ($([$($t:ident)?] $pixel:ty => $averaged:ty),*) => {
        $(impl $(<$t: Sample>)? Resample for $pixel {
            type Averaged = $averaged;
            #[inline]
            fn averaged<'a>(pixels: &'a [Self], buffer: &'a mut Vec<$averaged>) -> &'a [$averaged] {
                buffer.clear();
                buffer.extend(pixels.iter().map(|pixel| <$averaged>::from_linear(pixel.to_linear())));
                buffer
            }
            #[inline(always)]
            fn from_averaged(average: $averaged) -> Self {
                Self::from_linear(average.to_linear())
            }
        })*
    };
}

resample_directly!(f32, [f32; 2], LinearRgb, PremulLinearRgba, Oklab);
resample_by!([T] Srgb<T> => LinearRgb, [T] Srgba<T> => PremulLinearRgba, [] LinearRgba => PremulLinearRgba);

/// Rows of the result that are made at once. Fewer cost more kernel rows twice, more leave threads idle on small
/// pictures; bytes do not depend on it beyond rounding, but it is fixed so that they do not depend on threads at all.
const ROWS_PER_STRIP: usize = 32;

/// Rows of the source in a block of the horizontal pass: as many as fit a cache as floats, and a multiple of 8, as the kernels process
/// four rows together.
fn rows_per_block(width: usize) -> usize {
    const PIXELS: usize = 1 << 13;
    (PIXELS / width).next_multiple_of(8).max(8)
}

/// The picture at another size.
///
/// The outlines of both images coincide, so positions scale by the ratio of the sizes: `(x, y)` goes to
/// `(x · new width / old width, y · new height / old height)`.
///
/// ```
/// use ravec_raster::{Image, ResizeFilter, Size, Srgb, resize};
///
/// let stripes = Image::from_fn(Size::new(8, 8)?, |col, _| Srgb([if col % 2 == 0 { 0u8 } else { 255 }; 3]));
/// let small = resize(&stripes, Size::new(4, 4)?, ResizeFilter::Box);
/// // half the light of white, which is 188 encoded and not 128
/// assert_eq!(small[(1, 1)], Srgb([188; 3]));
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
pub fn resize<P: Resample>(image: &Image<P>, size: Size, filter: ResizeFilter) -> Image<P> {
    if image.size() == size {
        return image.clone();
    }
    let kernel = match filter {
        ResizeFilter::Nearest => return nearest(image, size),
        ResizeFilter::Box => (fir::FilterType::Box, 0.5),
        ResizeFilter::Bilinear => (fir::FilterType::Bilinear, 1.0),
        ResizeFilter::CatmullRom => (fir::FilterType::CatmullRom, 2.0),
        ResizeFilter::Mitchell => (fir::FilterType::Mitchell, 2.0),
        ResizeFilter::Lanczos3 => (fir::FilterType::Lanczos3, 3.0),
    };
    let first = P::from_averaged(P::Averaged::ZERO);
    let mut result = Image::new(size, first);
    result
        .par_strips_mut(ROWS_PER_STRIP)
        .enumerate()
        .for_each_init(Scratch::default, |scratch, (index, pixels)| {
            resize_strip(image, size, kernel, scratch, index * ROWS_PER_STRIP, pixels);
        });
    result
}

fn nearest<P: Pixel>(image: &Image<P>, size: Size) -> Image<P> {
    // the old pixel in which the center of the new one lies, in whole numbers
    let at = |index: usize, new: usize, old: usize| ((2 * index + 1) * old) / (2 * new);
    let cols: Vec<usize> = (0..size.width())
        .map(|col| at(col, size.width(), image.width()))
        .collect();
    let mut result = Image::new(size, image.pixels()[0]);
    result.for_each_row(|row, out| {
        let source = image.row(at(row, size.height(), image.height()));
        for (pixel, &col) in out.iter_mut().zip(&cols) {
            *pixel = source[col];
        }
    });
    result
}

/// Scratch space of a thread, reused from strip to strip.
struct Scratch<A> {
    resizer: fir::Resizer,
    buffer: Vec<A>,
}

impl<A> Default for Scratch<A> {
    fn default() -> Self {
        Self {
            resizer: fir::Resizer::new(),
            buffer: Vec::new(),
        }
    }
}

/// Fills the rows of the result from `first_row` on. `kernel` is the filter and its reach in its own unit.
fn resize_strip<P: Resample>(
    image: &Image<P>,
    size: Size,
    (filter, reach): (fir::FilterType, f64),
    Scratch { resizer, buffer }: &mut Scratch<P::Averaged>,
    first_row: usize,
    pixels: &mut [P],
) {
    let rows = pixels.len() / size.width();
    let scale = image.height() as f64 / size.height() as f64;
    // the stripe of the source that maps to the strip, and the rows that any kernel in it can touch, with one to spare
    let top = first_row as f64 * scale;
    let height = rows as f64 * scale;
    let margin = reach * scale.max(1.0) + 1.0;
    let first = (top - margin).floor().max(0.0) as usize;
    let end = ((top + height + margin).ceil() as usize).min(image.height());
    let source = &image.pixels()[first * image.width()..end * image.width()];
    let source_rows = end - first;
    let algorithm = fir::ResizeOptions::new()
        .resize_alg(fir::ResizeAlg::Convolution(filter))
        .use_alpha(false);

    // The two passes are two calls: within one call the library keeps only the rows between the first kernel's start
    // and the last kernel's end, and a cubic or sinc kernel that falls on a pixel center is shorter than its neighbors.
    let mut wide: Vec<P::Averaged>;
    let source: &[P::Averaged] = if image.width() == size.width() {
        P::averaged(source, buffer)
    } else {
        wide = vec![P::Averaged::ZERO; size.width() * source_rows];
        let rows = rows_per_block(image.width());
        let blocks = source.chunks(rows * image.width());
        for (source, wide) in blocks.zip(wide.chunks_mut(rows * size.width())) {
            convolve(
                resizer,
                P::Averaged::CHANNELS,
                (
                    P::Averaged::numbers(P::averaged(source, buffer)),
                    image.width(),
                ),
                (P::Averaged::numbers_mut(wide), size.width()),
                &algorithm,
            );
        }
        &wide
    };
    let mut high: Vec<P::Averaged>;
    let strip: &[P::Averaged] = if image.height() == size.height() {
        let offset = (first_row - first) * size.width();
        &source[offset..][..pixels.len()]
    } else {
        high = vec![P::Averaged::ZERO; pixels.len()];
        let top = top - first as f64;
        let height = height.min(source_rows as f64 - top);
        convolve(
            resizer,
            P::Averaged::CHANNELS,
            (P::Averaged::numbers(source), size.width()),
            (P::Averaged::numbers_mut(&mut high), size.width()),
            &algorithm.crop(0.0, top, size.width() as f64, height),
        );
        &high
    };
    for (pixel, &average) in pixels.iter_mut().zip(strip) {
        *pixel = P::from_averaged(average);
    }
}

/// One pass from pixels of one width to those of another. The number of channels is an argument at run time, so that
/// the kernels are compiled once, and not for each type of pixel in each crate that resizes.
fn convolve(
    resizer: &mut fir::Resizer,
    channels: usize,
    source: (&[f32], usize),
    target: (&mut [f32], usize),
    options: &fir::ResizeOptions,
) {
    match channels {
        1 => convolve_typed::<fir::pixels::F32>(resizer, source, target, options),
        2 => convolve_typed::<fir::pixels::F32x2>(resizer, source, target, options),
        3 => convolve_typed::<fir::pixels::F32x3>(resizer, source, target, options),
        _ => convolve_typed::<fir::pixels::F32x4>(resizer, source, target, options),
    }
}

/// [`convolve`] for one of the pixels of the library. That it is named keeps the kernels of all others out of programs.
fn convolve_typed<F: fir::PixelTrait>(
    resizer: &mut fir::Resizer,
    (source, source_width): (&[f32], usize),
    (target, target_width): (&mut [f32], usize),
    options: &fir::ResizeOptions,
) {
    let channels = size_of::<F>() / size_of::<f32>();
    let source_rows = source.len() / (channels * source_width);
    let target_rows = target.len() / (channels * target_width);
    let source = fir::images::TypedImageRef::<F>::from_buffer(
        source_width as u32,
        source_rows as u32,
        bytemuck::cast_slice(source),
    );
    let target = fir::images::TypedImage::<F>::from_buffer(
        target_width as u32,
        target_rows as u32,
        bytemuck::cast_slice_mut(target),
    );
    let (Ok(source), Ok(mut target)) = (source, target) else {
        unreachable!("both buffers hold exactly their pixels, aligned as floats");
    };
    resizer
        .resize_typed(&source, &mut target, options)
        .expect("the pixel types agree and the stripe lies within the rows that were cut out");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use proptest::prelude::*;

    const ALL: [ResizeFilter; 6] = [
        ResizeFilter::Nearest,
        ResizeFilter::Box,
        ResizeFilter::Bilinear,
        ResizeFilter::CatmullRom,
        ResizeFilter::Mitchell,
        ResizeFilter::Lanczos3,
    ];

    fn size(width: usize, height: usize) -> Size {
        Size::new(width, height).unwrap()
    }

    fn noise(size: Size) -> Plane {
        Plane::from_fn(size, |col, row| {
            let mixed = (col as u32 * 7919 + row as u32 * 104_729).wrapping_mul(2_654_435_761);
            (mixed >> 8) as f32 / (1 << 24) as f32
        })
    }

    /// One axis by the definition: a kernel stretched when shrinking, normalized over the pixels that exist.
    fn axis_naive(values: &[f32], new: usize, kernel: impl Fn(f64) -> f64, reach: f64) -> Vec<f32> {
        let scale = values.len() as f64 / new as f64;
        let stretch = scale.max(1.0);
        (0..new)
            .map(|index| {
                let center = (index as f64 + 0.5) * scale;
                let weight = |i: usize| {
                    let d = (i as f64 + 0.5 - center) / stretch;
                    if d.abs() < reach { kernel(d) } else { 0.0 }
                };
                let sum: f64 = (0..values.len()).map(weight).sum();
                let total: f64 = (0..values.len())
                    .map(|i| weight(i) * f64::from(values[i]))
                    .sum();
                (total / sum) as f32
            })
            .collect()
    }

    fn naive(image: &Plane, size: Size, kernel: impl Fn(f64) -> f64 + Copy, reach: f64) -> Plane {
        let wide: Vec<f32> = image
            .rows()
            .flat_map(|row| axis_naive(row, size.width(), kernel, reach))
            .collect();
        let columns: Vec<Vec<f32>> = (0..size.width())
            .map(|col| {
                wide.iter()
                    .skip(col)
                    .step_by(size.width())
                    .copied()
                    .collect()
            })
            .map(|column: Vec<f32>| axis_naive(&column, size.height(), kernel, reach))
            .collect();
        Plane::from_fn(size, |col, row| columns[col][row])
    }

    fn keys(d: f64) -> f64 {
        let d = d.abs();
        if d < 1.0 {
            (1.5 * d - 2.5) * d * d + 1.0
        } else {
            ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0
        }
    }

    proptest! {
        #[test]
        fn a_constant_stays_constant(
            (w, h) in (1usize..40, 1usize..90), (u, v) in (1usize..40, 1usize..90)
        ) {
            let image = Image::new(size(w, h), LinearRgb([0.25, 1.0, -3.0]));
            let bytes = Image::new(size(w, h), Srgba([200u8, 100, 50, 77]));
            for filter in ALL {
                for pixel in resize(&image, size(u, v), filter).pixels() {
                    for (value, truth) in pixel.0.into_iter().zip([0.25, 1.0, -3.0f32]) {
                        prop_assert!((value - truth).abs() <= 1e-5, "{filter:?} {value} {truth}");
                    }
                }
                let resized = resize(&bytes, size(u, v), filter);
                prop_assert!(resized.pixels().iter().all(|&pixel| pixel == bytes[(0, 0)]));
            }
        }

        #[test]
        fn resampling_agrees_with_the_definition(
            (w, h) in (1usize..60, 1usize..90), (u, v) in (1usize..60, 1usize..90)
        ) {
            let image = noise(size(w, h));
            let found = resize(&image, size(u, v), ResizeFilter::Bilinear);
            let truth = naive(&image, size(u, v), |d| 1.0 - d.abs(), 1.0);
            for (a, b) in found.pixels().iter().zip(truth.pixels()) {
                // weights and values at most 1, sums of up to a few hundred terms in two passes
                prop_assert!((a - b).abs() < 1e-5);
            }
            let found = resize(&image, size(u, v), ResizeFilter::CatmullRom);
            let truth = naive(&image, size(u, v), keys, 2.0);
            for (a, b) in found.pixels().iter().zip(truth.pixels()) {
                prop_assert!((a - b).abs() < 3e-5, "{a} {b}");
            }
            let sinc = |x: f64| if x == 0.0 { 1.0 } else { let a = std::f64::consts::PI * x; a.sin() / a };
            let found = resize(&image, size(u, v), ResizeFilter::Lanczos3);
            let truth = naive(&image, size(u, v), |d| sinc(d) * sinc(d / 3.0), 3.0);
            for (a, b) in found.pixels().iter().zip(truth.pixels()) {
                prop_assert!((a - b).abs() < 3e-5, "{a} {b}");
            }
        }
    }

    #[test]
    fn strips_join_without_a_seam() {
        // a ramp is reproduced when growing and, by symmetry, when shrinking by a whole factor
        let ramp = Plane::from_fn(size(8, 1000), |_, row| row as f32 + 0.5);
        for (height, filter) in [
            (250, ResizeFilter::Bilinear),
            (1700, ResizeFilter::CatmullRom),
        ] {
            let resized = resize(&ramp, size(8, height), filter);
            let scale = 1000.0 / height as f32;
            for row in 10..height - 10 {
                let truth = (row as f32 + 0.5) * scale;
                assert!(
                    (resized[(3, row)] - truth).abs() < 2e-3,
                    "row {row} of {height}"
                );
            }
        }
    }

    #[test]
    fn a_strip_that_ends_on_a_pixel_center_keeps_its_rows() {
        // the center of row 31 of 42, the last of its strip, falls on that of row 7 of 10
        let image = Plane::new(size(1, 10), 0.25);
        let resized = resize(&image, size(2, 42), ResizeFilter::CatmullRom);
        assert!(resized.pixels().iter().all(|v| (v - 0.25).abs() < 1e-6));
    }

    #[test]
    fn shrinking_by_a_whole_factor_with_a_box_gives_exact_means() {
        let image = noise(size(12, 9));
        let small = resize(&image, size(4, 3), ResizeFilter::Box);
        for (col, row) in (0..3).flat_map(|row| (0..4).map(move |col| (col, row))) {
            let cell = (0..9).map(|i| image[(3 * col + i % 3, 3 * row + i / 3)]);
            assert!((small[(col, row)] - cell.sum::<f32>() / 9.0).abs() < 1e-6);
        }
    }

    #[test]
    fn the_color_of_transparent_pixels_does_not_bleed() {
        let image =
            Image::from_vec(2, vec![Srgba([255u8, 0, 0, 255]), Srgba([0, 255, 0, 0])]).unwrap();
        let pixel = resize(&image, size(1, 1), ResizeFilter::Box)[(0, 0)];
        assert_eq!(pixel, Srgba([255, 0, 0, 128]));
    }

    #[test]
    fn nearest_takes_the_pixel_under_the_new_center() {
        let image = Image::from_vec(4, vec![10.0f32, 20.0, 30.0, 40.0]).unwrap();
        assert_eq!(
            resize(&image, size(2, 1), ResizeFilter::Nearest).pixels(),
            [20.0, 40.0]
        );
        assert_eq!(
            resize(&image, size(8, 1), ResizeFilter::Nearest).pixels(),
            [10.0, 10.0, 20.0, 20.0, 30.0, 30.0, 40.0, 40.0]
        );
    }

    #[test]
    fn one_thread_and_many_give_the_same_bytes() {
        let image =
            noise(size(67, 230)).map(|v| Srgb([v, 1.0 - v, v * v].map(|v| (255.0 * v) as u8)));
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| resize(&image, size(131, 170), ResizeFilter::Lanczos3))
        };
        assert_eq!(on(1), on(5));
    }
}
