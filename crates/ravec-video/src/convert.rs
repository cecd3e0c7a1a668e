//! Conversion between planes of luma and chroma and red, green and blue.
//!
//! All arithmetic is that of the standards (ITU-R BT.601, 709, 2020) on encoded values in 32-bit floats, rounded once.
//! Chroma is interpolated linearly between the places that its siting names, and filtered by a triangle, or by a box where it
//! lies midway, before it is reduced.
//!
//! Guarantees: gray comes back as gray; 8-bit colors come back exactly through 4:4:4 planes of 10 bits or more; a flat field
//! keeps its color through any subsampling. Does not guarantee: exact colors through 8-bit planes, which do not hold them all.
//! Cost: some 2 ns a pixel in one thread; rows are shared by the threads of the caller's pool.

use crate::color::{ColorInfo, Range, SitingAxis, Subsampling};
use crate::yuv::{SamplePlane, YuvFormat, YuvImage, with_plane};
use ravec_raster::{AnyImage, Color, Image, Pixel, Sample, Size, Srgb, Srgba, with_image};
use rayon::prelude::*;

/// Affine map from codes to the unit range, per kind of plane.
#[derive(Clone, Copy)]
struct Codes {
    luma_black: f32,
    luma_span: f32,
    chroma_zero: f32,
    chroma_span: f32,
    max: f32,
}

impl Codes {
    fn new(range: Range, depth: u32) -> Self {
        let max = ((1u32 << depth) - 1) as f32;
        let unit = (1u32 << (depth - 8)) as f32;
        let chroma_zero = 128.0 * unit;
        match range {
            Range::Limited => Self {
                luma_black: 16.0 * unit,
                luma_span: 219.0 * unit,
                chroma_zero,
                chroma_span: 224.0 * unit,
                max,
            },
            Range::Full => Self {
                luma_black: 0.0,
                luma_span: max,
                chroma_zero,
                chroma_span: max,
                max,
            },
        }
    }
}

/// Position of the first chroma sample in luma samples, for `step` luma samples a chroma sample.
fn offset(siting: SitingAxis, step: usize) -> f32 {
    let last = (step - 1) as f32;
    match siting {
        SitingAxis::First => 0.0,
        SitingAxis::Center => last / 2.0,
        SitingAxis::Last => last,
    }
}

/// Chroma samples on both sides of a luma sample, and the weight of the second.
fn neighbors(at: usize, siting: SitingAxis, step: usize, len: usize) -> (usize, usize, f32) {
    let position = (at as f32 - offset(siting, step)) / step as f32;
    let position = position.clamp(0.0, (len - 1) as f32);
    let first = position as usize;
    (first, (first + 1).min(len - 1), position - first as f32)
}

/// Luma samples that make up a chroma sample, relative to its first luma sample, with weights that sum up to 1.
fn taps(siting: SitingAxis, step: usize) -> Vec<(isize, f32)> {
    if step == 1 {
        return vec![(0, 1.0)];
    }
    let step = step as isize;
    let center = match siting {
        SitingAxis::Center => return (0..step).map(|at| (at, 1.0 / step as f32)).collect(),
        SitingAxis::First => 0,
        SitingAxis::Last => step - 1,
    };
    let weight = |at: isize| (step - at.abs()) as f32 / (step * step) as f32;
    (1 - step..step)
        .map(|at| (center + at, weight(at)))
        .collect()
}

/// Reads one row of samples as floats.
fn load_row(plane: &SamplePlane, row: usize, into: &mut [f32]) {
    with_plane!(plane, plane => {
        for (value, sample) in into.iter_mut().zip(plane.row(row)) {
            *value = f32::from(*sample);
        }
    });
}

/// One row of a chroma plane at the resolution of luma.
struct ChromaRow {
    coarse: Vec<f32>,
    other: Vec<f32>,
    fine: Vec<f32>,
}

impl ChromaRow {
    fn new(width: usize) -> Self {
        Self {
            coarse: vec![0.0; width],
            other: vec![0.0; width],
            fine: vec![0.0; width],
        }
    }

    /// Interpolates the row of `plane` that belongs to the luma row `row`.
    fn load(&mut self, plane: &SamplePlane, row: usize, layout: (Subsampling, ColorInfo)) {
        let (subsampling, color) = layout;
        let Some((log_x, log_y)) = subsampling.log2_steps() else {
            return;
        };
        let size = plane.size();
        let width = size.width();
        let (first, second, weight) = neighbors(row, color.siting.y, 1 << log_y, size.height());
        load_row(plane, first, &mut self.coarse[..width]);
        if weight > 0.0 {
            load_row(plane, second, &mut self.other[..width]);
            for (value, other) in self.coarse.iter_mut().zip(&self.other) {
                *value += weight * (other - *value);
            }
        }
        let coarse = &self.coarse[..width];
        if log_x == 0 {
            self.fine[..width].copy_from_slice(coarse);
            return;
        }
        let step = 1usize << log_x;
        if log_x == 1 && width > 2 {
            upsample_twice(coarse, color.siting.x, &mut self.fine);
            return;
        }
        for (col, value) in self.fine.iter_mut().enumerate() {
            let (first, second, weight) = neighbors(col, color.siting.x, step, width);
            *value = coarse[first] + weight * (coarse[second] - coarse[first]);
        }
    }
}

/// Linear interpolation to twice the resolution: the common case, without look-ups.
fn upsample_twice(coarse: &[f32], siting: SitingAxis, fine: &mut [f32]) {
    // weights of the samples before, at and after for the first and the second value
    let (even, odd) = match siting {
        SitingAxis::First => ([0.0, 1.0, 0.0], [0.0, 0.5, 0.5]),
        SitingAxis::Center => ([0.25, 0.75, 0.0], [0.0, 0.75, 0.25]),
        SitingAxis::Last => ([0.5, 0.5, 0.0], [0.0, 1.0, 0.0]),
    };
    let blend = |weights: [f32; 3], before: f32, here: f32, after: f32| {
        weights[0] * before + weights[1] * here + weights[2] * after
    };
    let last = coarse.len() - 1;
    for col in [0, last] {
        let (before, after) = (coarse[col.saturating_sub(1)], coarse[(col + 1).min(last)]);
        fine[2 * col] = blend(even, before, coarse[col], after);
        if let Some(value) = fine.get_mut(2 * col + 1) {
            *value = blend(odd, before, coarse[col], after);
        }
    }
    let inner = fine[2..].chunks_exact_mut(2).zip(coarse.windows(3));
    for (pair, around) in inner.take(last - 1) {
        pair[0] = blend(even, around[0], around[1], around[2]);
        pair[1] = blend(odd, around[0], around[1], around[2]);
    }
}

/// The colors of a frame: encoded sRGB of 8 bits for 8-bit planes, of 16 bits for deeper ones, with alpha if there is a plane
/// of it.
pub fn image_from_yuv(frame: &YuvImage) -> AnyImage {
    let format = frame.format();
    match (format.depth > 8, format.alpha) {
        (false, false) => decode::<u8, Srgb<u8>>(frame, |[r, g, b], _| Srgb([r, g, b])).into(),
        (false, true) => decode::<u8, Srgba<u8>>(frame, |[r, g, b], a| Srgba([r, g, b, a])).into(),
        (true, false) => decode::<u16, Srgb<u16>>(frame, |[r, g, b], _| Srgb([r, g, b])).into(),
        (true, true) => decode::<u16, Srgba<u16>>(frame, |[r, g, b], a| Srgba([r, g, b, a])).into(),
    }
}

trait Rounded: Sample {
    const MAX: f32;
    fn rounded(value: f32) -> Self;
}

impl Rounded for u8 {
    const MAX: f32 = 255.0;
    #[inline(always)]
    fn rounded(value: f32) -> Self {
        (value + 0.5) as Self
    }
}

impl Rounded for u16 {
    const MAX: f32 = 65535.0;
    #[inline(always)]
    fn rounded(value: f32) -> Self {
        (value + 0.5) as Self
    }
}

fn decode<T: Rounded, P: Pixel>(
    frame: &YuvImage,
    pixel: impl Fn([T; 3], T) -> P + Sync,
) -> Image<P> {
    let (format, color, size) = (frame.format(), frame.color(), frame.size());
    let codes = Codes::new(color.range, format.depth);
    let (kr, kb) = color.matrix.luma_weights();
    let kg = 1.0 - kr - kb;
    // R = Y + red Cr, B = Y + blue Cb, G = Y - green_b Cb - green_r Cr, all on the scale of the result
    let chroma_scale = T::MAX / codes.chroma_span;
    let red = (2.0 * (1.0 - kr)) as f32 * chroma_scale;
    let blue = (2.0 * (1.0 - kb)) as f32 * chroma_scale;
    let green_b = (2.0 * (1.0 - kb) * kb / kg) as f32 * chroma_scale;
    let green_r = (2.0 * (1.0 - kr) * kr / kg) as f32 * chroma_scale;
    let luma_scale = T::MAX / codes.luma_span;
    let alpha_scale = T::MAX / codes.max;
    let mut image = Image::new(size, pixel([T::default(); 3], T::ONE));
    let width = size.width();
    let buffers = || {
        (
            vec![0f32; width],
            ChromaRow::new(width),
            ChromaRow::new(width),
            vec![codes.max; width],
        )
    };
    image.par_rows_mut().enumerate().for_each_init(
        buffers,
        |(luma, cb, cr, alpha), (row, pixels)| {
            load_row(frame.luma(), row, luma);
            if let Some(plane) = frame.alpha() {
                load_row(plane, row, alpha);
            }
            let layout = (format.subsampling, color);
            if let Some((plane_b, plane_r)) = frame.chroma() {
                cb.load(plane_b, row, layout);
                cr.load(plane_r, row, layout);
            } else {
                cb.fine.fill(codes.chroma_zero);
                cr.fine.fill(codes.chroma_zero);
            }
            let samples = luma.iter().zip(&cb.fine).zip(&cr.fine).zip(&*alpha);
            for (into, (((y, cb), cr), a)) in pixels.iter_mut().zip(samples) {
                let y = (y - codes.luma_black) * luma_scale;
                let (cb, cr) = (cb - codes.chroma_zero, cr - codes.chroma_zero);
                let rgb = [y + red * cr, y - green_b * cb - green_r * cr, y + blue * cb];
                *into = pixel(rgb.map(T::rounded), T::rounded(a * alpha_scale));
            }
        },
    );
    image
}

/// Planes of a picture. Colors of floats are encoded as sRGB and clipped; alpha is dropped if the format has none.
pub fn yuv_from_image(image: &AnyImage, format: YuvFormat, color: ColorInfo) -> YuvImage {
    with_image!(image, image => encode(image, format, color))
}

/// Rows of luma and color differences of one row of pixels, in units of 1.
struct UnitRow {
    luma: Vec<f32>,
    cb: Vec<f32>,
    cr: Vec<f32>,
}

impl UnitRow {
    fn new(width: usize) -> Self {
        Self {
            luma: vec![0.0; width],
            cb: vec![0.0; width],
            cr: vec![0.0; width],
        }
    }

    fn load<P: Color>(&mut self, pixels: &[P], color: ColorInfo) {
        let (kr, kb) = color.matrix.luma_weights();
        let weights = [kr as f32, (1.0 - kr - kb) as f32, kb as f32];
        let (blue, red) = (0.5 / (1.0 - weights[2]), 0.5 / (1.0 - weights[0]));
        let values = self.luma.iter_mut().zip(&mut self.cb).zip(&mut self.cr);
        for (pixel, ((luma, cb), cr)) in pixels.iter().zip(values) {
            let [r, g, b] = encoded(*pixel);
            *luma = weights[0] * r + weights[1] * g + weights[2] * b;
            *cb = (b - *luma) * blue;
            *cr = (r - *luma) * red;
        }
    }
}

/// The encoded color on a scale of 0 to 1. Integers are not decoded and encoded again.
#[inline(always)]
fn encoded<P: Color>(pixel: P) -> [f32; 3] {
    let bytes = bytemuck::bytes_of(&pixel);
    if std::mem::size_of::<P>() <= 4 {
        // three or four 8-bit samples
        return [0, 1, 2].map(|at| f32::from(bytes[at]) / 255.0);
    }
    if std::mem::size_of::<P>() <= 8 {
        let sample = |at: usize| u16::from_ne_bytes([bytes[2 * at], bytes[2 * at + 1]]);
        return [0, 1, 2].map(|at| f32::from(sample(at)) / 65535.0);
    }
    let Srgb(rgb) = Srgb::<f32>::from_linear(pixel.to_linear());
    rgb.map(|value| value.clamp(0.0, 1.0))
}

fn encode<P: Color>(image: &Image<P>, format: YuvFormat, color: ColorInfo) -> YuvImage {
    let size = image.size();
    let codes = Codes::new(color.range, format.depth);
    let luma = luma_plane(image, format.depth, &codes, color);
    let mut planes = vec![luma];
    if let Some((width, height)) = format.subsampling.chroma_size(size.width(), size.height()) {
        let chroma = Size::new(width, height).expect("not larger than the picture, and not zero");
        let (cb, cr) = chroma_planes(image, chroma, format, &codes, color);
        planes.extend([cb, cr]);
    }
    if format.alpha {
        let alpha = image.map(|pixel| pixel.to_linear().alpha().clamp(0.0, 1.0) * codes.max);
        planes.push(quantized(&alpha, format.depth, codes.max));
    }
    YuvImage::new(format, color, planes).expect("the planes were made for this format")
}

/// Codes of a plane of floats.
fn quantized(plane: &Image<f32>, depth: u32, max: f32) -> SamplePlane {
    if depth <= 8 {
        SamplePlane::U8(plane.map(|value| (value + 0.5).clamp(0.0, max) as u8))
    } else {
        SamplePlane::U16(plane.map(|value| (value + 0.5).clamp(0.0, max) as u16))
    }
}

fn luma_plane<P: Color>(
    image: &Image<P>,
    depth: u32,
    codes: &Codes,
    color: ColorInfo,
) -> SamplePlane {
    let size = image.size();
    let code =
        |value: f32| (value * codes.luma_span + codes.luma_black + 0.5).clamp(0.0, codes.max);
    let mut plane = SamplePlane::new(size, depth, 0);
    with_plane!(&mut plane, plane => {
        plane.par_rows_mut().enumerate().for_each_init(
            || UnitRow::new(size.width()),
            |units, (row, codes)| {
                units.load(image.row(row), color);
                for (into, value) in codes.iter_mut().zip(&units.luma) {
                    *into = code(*value) as _;
                }
            },
        );
    });
    plane
}

fn chroma_planes<P: Color>(
    image: &Image<P>,
    size: Size,
    format: YuvFormat,
    codes: &Codes,
    color: ColorInfo,
) -> (SamplePlane, SamplePlane) {
    let (log_x, log_y) = format.subsampling.log2_steps().unwrap_or((0, 0));
    let taps_x = taps(color.siting.x, 1 << log_x);
    let taps_y = taps(color.siting.y, 1 << log_y);
    let (width, rows) = (image.width(), image.height() as isize);
    let mut pairs = Image::new(size, [0f32; 2]);
    let buffers = || (UnitRow::new(width), vec![[0f32; 2]; width]);
    pairs
        .par_rows_mut()
        .enumerate()
        .for_each_init(buffers, |(units, sums), (row, pairs)| {
            sums.fill([0.0; 2]);
            for (at, weight) in &taps_y {
                let source = ((row << log_y) as isize + at).clamp(0, rows - 1);
                units.load(image.row(source as usize), color);
                for (sum, (cb, cr)) in sums.iter_mut().zip(units.cb.iter().zip(&units.cr)) {
                    *sum = [sum[0] + weight * cb, sum[1] + weight * cr];
                }
            }
            for (col, pair) in pairs.iter_mut().enumerate() {
                let mut value = [codes.chroma_zero; 2];
                for (at, weight) in &taps_x {
                    let source = ((col << log_x) as isize + at).clamp(0, width as isize - 1);
                    let weight = weight * codes.chroma_span;
                    value = [0, 1].map(|c| value[c] + weight * sums[source as usize][c]);
                }
                *pair = value;
            }
        });
    let plane =
        |channel: usize| quantized(&pairs.map(|pair| pair[channel]), format.depth, codes.max);
    (plane(0), plane(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{Matrix, Siting};

    fn color(matrix: Matrix, range: Range, siting: Siting) -> ColorInfo {
        ColorInfo {
            matrix,
            range,
            siting,
            ..ColorInfo::guess(100)
        }
    }

    fn all_colors() -> impl Iterator<Item = ColorInfo> {
        let matrices = [Matrix::Bt601, Matrix::Bt709, Matrix::Bt2020];
        let sitings = [Siting::LEFT, Siting::CENTER, Siting::TOP_LEFT];
        matrices.into_iter().flat_map(move |matrix| {
            [Range::Limited, Range::Full]
                .into_iter()
                .flat_map(move |range| {
                    sitings
                        .into_iter()
                        .map(move |siting| color(matrix, range, siting))
                })
        })
    }

    /// Colors from all over the cube.
    fn cube() -> Image<Srgb<u8>> {
        let size = Size::new(64, 64).unwrap();
        Image::from_fn(size, |col, row| {
            let at = 64 * row + col;
            Srgb([at % 16, at / 16 % 16, at / 256].map(|value| 17 * value as u8))
        })
    }

    #[test]
    fn codes_of_the_standards_for_white_black_and_red() {
        let pixel = |rgb: [u8; 3]| AnyImage::from(Image::new(Size::new(1, 1).unwrap(), Srgb(rgb)));
        let format = YuvFormat {
            subsampling: Subsampling::S444,
            ..YuvFormat::YUV420P8
        };
        let codes = |rgb, matrix| -> Vec<u8> {
            let frame = yuv_from_image(
                &pixel(rgb),
                format,
                color(matrix, Range::Limited, Siting::LEFT),
            );
            let first = |plane: &SamplePlane| match plane {
                SamplePlane::U8(plane) => plane[(0, 0)],
                SamplePlane::U16(_) => unreachable!("8 bits"),
            };
            frame.planes().iter().map(first).collect()
        };
        assert_eq!(codes([255; 3], Matrix::Bt709), [235, 128, 128]);
        assert_eq!(codes([0; 3], Matrix::Bt709), [16, 128, 128]);
        // the color bars of BT.601 and BT.709
        assert_eq!(codes([255, 0, 0], Matrix::Bt601), [81, 90, 240]);
        assert_eq!(codes([255, 0, 0], Matrix::Bt709), [63, 102, 240]);
        assert_eq!(codes([0, 0, 255], Matrix::Bt2020), [29, 240, 119]);
    }

    #[test]
    fn eight_bit_colors_come_back_exactly_through_ten_bits() {
        let image = AnyImage::from(cube());
        for color in all_colors() {
            let format = YuvFormat {
                subsampling: Subsampling::S444,
                depth: 10,
                alpha: false,
            };
            let back = image_from_yuv(&yuv_from_image(&image, format, color));
            let eight: Image<Srgb<u8>> = back.convert();
            assert_eq!(AnyImage::from(eight), image, "{color:?}");
        }
    }

    #[test]
    fn flat_fields_keep_their_color_within_a_step_through_any_subsampling() {
        let subsamplings = [
            Subsampling::S420,
            Subsampling::S422,
            Subsampling::S440,
            Subsampling::S411,
        ];
        for color in all_colors() {
            for subsampling in subsamplings {
                for rgb in [[200u8, 30, 60], [10, 240, 128], [77, 77, 77]] {
                    // odd sides
                    let image = Image::new(Size::new(7, 5).unwrap(), Srgb(rgb));
                    let format = YuvFormat {
                        subsampling,
                        ..YuvFormat::YUV420P8
                    };
                    let back = image_from_yuv(&yuv_from_image(&image.into(), format, color));
                    let back: Image<Srgb<u8>> = back.convert();
                    for pixel in back.pixels() {
                        for (found, truth) in pixel.0.iter().zip(rgb) {
                            assert!(found.abs_diff(truth) <= 2, "{pixel:?} {rgb:?} {color:?}");
                        }
                        assert_eq!(*pixel, back[(0, 0)]);
                    }
                }
            }
        }
    }

    /// Chroma by the definition: linear interpolation between the places of the samples.
    fn naive_chroma(
        plane: &Image<u8>,
        at: (usize, usize),
        steps: (usize, usize),
        siting: Siting,
    ) -> f32 {
        let coordinate = |at: usize, siting, step: usize, len: usize| {
            let first = match siting {
                SitingAxis::First => 0.0,
                SitingAxis::Center => (step as f32 - 1.0) / 2.0,
                SitingAxis::Last => step as f32 - 1.0,
            };
            ((at as f32 - first) / step as f32).clamp(0.0, len as f32 - 1.0)
        };
        let x = coordinate(at.0, siting.x, steps.0, plane.width());
        let y = coordinate(at.1, siting.y, steps.1, plane.height());
        let sample = |col: f32, row: f32| f32::from(plane.clamped(col as isize, row as isize));
        let (fx, fy) = (x.fract(), y.fract());
        let line =
            |row: f32| sample(x.floor(), row) * (1.0 - fx) + sample(x.floor() + 1.0, row) * fx;
        line(y.floor()) * (1.0 - fy) + line(y.floor() + 1.0) * fy
    }

    #[test]
    fn chroma_lies_where_its_siting_says() {
        let axes = [SitingAxis::First, SitingAxis::Center, SitingAxis::Last];
        let subsamplings = [
            Subsampling::S420,
            Subsampling::S422,
            Subsampling::S440,
            Subsampling::S411,
        ];
        for subsampling in subsamplings {
            let (log_x, log_y) = subsampling.log2_steps().unwrap();
            for (width, height) in [(13, 6), (8, 9), (1, 1), (2, 3), (3, 2), (5, 5)] {
                let (chroma_width, chroma_height) = subsampling.chroma_size(width, height).unwrap();
                let plane = Image::from_fn(
                    Size::new(chroma_width, chroma_height).unwrap(),
                    |col, row| (col * col * 31 + row * 57 + 11) as u8,
                );
                for siting in axes
                    .iter()
                    .flat_map(|x| axes.iter().map(|y| Siting { x: *x, y: *y }))
                {
                    let mut found = ChromaRow::new(width);
                    let info = color(Matrix::Bt601, Range::Full, siting);
                    for row in 0..height {
                        found.load(&SamplePlane::U8(plane.clone()), row, (subsampling, info));
                        for col in 0..width {
                            let truth =
                                naive_chroma(&plane, (col, row), (1 << log_x, 1 << log_y), siting);
                            assert!(
                                (found.fine[col] - truth).abs() < 1e-3,
                                "{subsampling:?} {siting:?} {col} {row}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn weights_of_the_reduction_sum_up_to_one_around_the_place_of_the_sample() {
        for siting in [SitingAxis::First, SitingAxis::Center, SitingAxis::Last] {
            for step in [1, 2, 4] {
                let taps = taps(siting, step);
                let sum: f32 = taps.iter().map(|(_, weight)| weight).sum();
                let mean: f32 = taps.iter().map(|(at, weight)| *at as f32 * weight).sum();
                assert!((sum - 1.0).abs() < 1e-6);
                assert!(
                    (mean - offset(siting, step)).abs() < 1e-6,
                    "{siting:?} {step}"
                );
            }
        }
    }

    #[test]
    fn alpha_is_kept() {
        let image = Image::from_fn(Size::new(16, 16).unwrap(), |col, row| {
            Srgba([9, 8, 7, (16 * row + col) as u8])
        });
        let format = YuvFormat {
            alpha: true,
            subsampling: Subsampling::S444,
            depth: 8,
        };
        let back = image_from_yuv(&yuv_from_image(
            &image.clone().into(),
            format,
            ColorInfo::guess(16),
        ));
        let AnyImage::Srgba8(back) = back else {
            panic!("alpha is lost");
        };
        for (found, truth) in back.pixels().iter().zip(image.pixels()) {
            assert_eq!(found.0[3], truth.0[3]);
        }
    }
}
