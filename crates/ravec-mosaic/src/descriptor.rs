//! Descriptors: the appearance of a tile from afar, as polynomial coefficients and the means of its quarters.
//!
//! Each channel of Oklab is approximated by a polynomial of bounded total degree in an orthonormal basis. The squared
//! distance of two approximated tiles, averaged over the tile, is then the squared Euclidean distance of their
//! coefficients, and coefficients are ordered by degree, so that a prefix gives a lower bound.
//!
//! Source: Pavić, v. Ceumern, Kobbelt, "`GIzMOs`: Genuine Image Mosaics with Adaptive Tiling", 2009. We differ in the weights:
//! the plain distance is not what the eye sees from a distance (see [`Weights`]).

use crate::basis::{Axis, products};
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x8};
use ravec_raster::color::{LINEAR_FROM_SRGB8, oklab_from_linear};
use ravec_raster::{Image, Oklab, Pixel, Srgb};
use std::collections::HashMap;
use std::sync::Arc;

/// The highest total degree of descriptors.
pub const MAX_DEGREE: usize = 5;

/// Appearance of a tile or a photo from afar, in Oklab.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Descriptor {
    /// For each product of polynomials, by total degree, the coefficients of the three channels. The first is the mean color.
    pub coefficients: Vec<[f32; 3]>,
    /// The mean colors of the quarters: upper left, upper right, lower left, lower right.
    pub quarters: [[f32; 3]; 4],
}

/// A part of a picture, in pixels, not necessarily whole ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Left border.
    pub left: f64,
    /// Upper border.
    pub top: f64,
    /// Extent to the right.
    pub width: f64,
    /// Extent downwards.
    pub height: f64,
}

impl Frame {
    /// All of an image.
    pub fn of<P: Pixel>(image: &Image<P>) -> Self {
        Self {
            left: 0.0,
            top: 0.0,
            width: image.width() as f64,
            height: image.height() as f64,
        }
    }

    /// The largest frame with the proportions `aspect` (width by height) in the middle of an image of the given size.
    pub fn centered(width: f64, height: f64, aspect: f64) -> Self {
        let (w, h) = if width > aspect * height {
            (aspect * height, height)
        } else {
            (width, width / aspect)
        };
        Self {
            left: (width - w) / 2.0,
            top: (height - h) / 2.0,
            width: w,
            height: h,
        }
    }
}

/// Functions on each side of a tile: polynomials, and the means of both halves.
const FUNCTIONS: usize = MAX_DEGREE + 3;

impl Descriptor {
    /// Descriptor of a part of an image, with polynomials up to a total degree of `degree` (0 to [`MAX_DEGREE`]; more is
    /// taken as that).
    pub fn of(image: &Image<Oklab>, frame: Frame, degree: usize) -> Self {
        let split = |pixels: &[Oklab], planes: &mut [Vec<f32>; 3]| {
            for (at, pixel) in pixels.iter().enumerate() {
                for (plane, value) in planes.iter_mut().zip(pixel.0) {
                    plane[at] = value;
                }
            }
        };
        Self::of_rows(image, frame, degree, split)
    }

    /// Descriptor of an image by a function that puts pixels of a row into one plane for each channel of Oklab.
    fn of_rows<P: Pixel>(
        image: &Image<P>,
        frame: Frame,
        degree: usize,
        split: impl FnMut(&[P], &mut [Vec<f32>; 3]),
    ) -> Self {
        let across = axis(frame.left, frame.width, image.width());
        let down = axis(frame.top, frame.height, image.height());
        Self::along(image, (&across, &down), degree, split)
    }

    /// Descriptor of what two axes touch of an image.
    fn along<P: Pixel>(
        image: &Image<P>,
        (across, down): (&Axis, &Axis),
        degree: usize,
        mut split: impl FnMut(&[P], &mut [Vec<f32>; 3]),
    ) -> Self {
        let simd = Level::new();
        let columns = across.pixels().len();
        let mut planes = [(); 3].map(|()| vec![0.0; columns.next_multiple_of(LANES)]);
        let mut sums = [[[0.0; FUNCTIONS]; FUNCTIONS]; 3];
        for (row, down) in (down.first..).zip(down.pixels_of()) {
            let pixels = &image.row(row)[across.first..][..columns];
            split(pixels, &mut planes);
            dispatch!(simd, simd => add_row(simd, &planes, across.pixels_of(), down, &mut sums));
        }
        let of = |j: usize, i: usize| sums.map(|sums| sums[j][i]);
        let degree = degree.min(MAX_DEGREE);
        let mut coefficients = Vec::with_capacity(products(degree));
        for total in 0..=degree {
            for j in 0..=total {
                coefficients.push(of(j, total - j));
            }
        }
        let (first, second) = (MAX_DEGREE + 1, MAX_DEGREE + 2);
        Self {
            coefficients,
            quarters: [
                of(first, first),
                of(first, second),
                of(second, first),
                of(second, second),
            ],
        }
    }
}

/// The weights of pixels along a side of a frame.
fn axis(begin: f64, length: f64, pixels: usize) -> Axis {
    Axis::polynomials_and_parts((begin, begin + length), pixels, MAX_DEGREE, 2)
}

/// A side of a frame, as bits, and the pixels of the image along it.
type Side = (u64, u64, usize);

/// Makes descriptors of 8-bit photos one after the other: those of one camera have the same sides, whose weights are kept.
#[derive(Debug, Clone, Default)]
pub struct Describer {
    axes: HashMap<Side, Arc<Axis>>,
}

impl Describer {
    /// Maximum number of sides that are kept.
    const MAX_AXES: usize = 64;

    /// [`Descriptor::of`] the image in Oklab, bit for bit, faster.
    pub fn describe(&mut self, image: &Image<Srgb<u8>>, frame: Frame, degree: usize) -> Descriptor {
        let simd = Level::new();
        let convert = |pixels: &[Srgb<u8>], planes: &mut [Vec<f32>; 3]| {
            for (at, pixel) in pixels.iter().enumerate() {
                for (plane, value) in planes.iter_mut().zip(pixel.0) {
                    plane[at] = LINEAR_FROM_SRGB8[value as usize];
                }
            }
            dispatch!(simd, simd => oklab_from_planes(simd, planes));
        };
        let across = self.axis(frame.left, frame.width, image.width());
        let down = self.axis(frame.top, frame.height, image.height());
        Descriptor::along(image, (&across, &down), degree, convert)
    }

    fn axis(&mut self, begin: f64, length: f64, pixels: usize) -> Arc<Axis> {
        let side = (begin.to_bits(), length.to_bits(), pixels);
        if self.axes.len() >= Self::MAX_AXES && !self.axes.contains_key(&side) {
            self.axes.clear();
        }
        let entry = self.axes.entry(side);
        Arc::clone(entry.or_insert_with(|| Arc::new(axis(begin, length, pixels))))
    }
}

/// Planes are as long as a multiple of this, so that whole vectors are converted; what is beyond the row is black and stays so.
const LANES: usize = 8;

/// Oklab of linear light, in place.
#[inline(always)]
fn oklab_from_planes<S>(_simd: S, planes: &mut [Vec<f32>; 3]) {
    let [red, green, blue] = planes.each_mut().map(Vec::as_mut_slice);
    for ((red, green), blue) in red.iter_mut().zip(green).zip(blue) {
        [*red, *green, *blue] = oklab_from_linear([*red, *green, *blue]);
    }
}

/// Adds a row of pixels, times the functions across and down, to the sums: for each channel and function down those across.
#[inline(always)]
fn add_row<S: Simd>(
    simd: S,
    planes: &[Vec<f32>; 3],
    across: &[[f32; FUNCTIONS]],
    down: &[f32; FUNCTIONS],
    sums: &mut [[[f32; FUNCTIONS]; FUNCTIONS]; 3],
) {
    let [lightness, a, b] = planes;
    let mut lines = [f32x8::splat(simd, 0.0); 3];
    for (((weights, &l), &a), &b) in across.iter().zip(lightness).zip(a).zip(b) {
        let weights = f32x8::from_slice(simd, weights);
        lines[0] += weights * l;
        lines[1] += weights * a;
        lines[2] += weights * b;
    }
    for (sums, line) in sums.iter_mut().zip(lines) {
        for (sums, &weight) in sums.iter_mut().zip(down) {
            (f32x8::from_slice(simd, sums) + line * weight).store_slice(sums);
        }
    }
}

/// The means of `count` × `count` equal parts of a frame, row by row.
pub(crate) fn parts(image: &Image<Oklab>, frame: Frame, count: usize) -> Vec<[f32; 3]> {
    let (right, bottom) = (frame.left + frame.width, frame.top + frame.height);
    let across = Axis::parts(frame.left, right, image.width(), count);
    let down = Axis::parts(frame.top, bottom, image.height(), count);
    project(image, &across, &down)
}

/// The sums over pixels, times the functions across and down: for each function down those across.
fn project(image: &Image<Oklab>, across: &Axis, down: &Axis) -> Vec<[f32; 3]> {
    let width = across.functions;
    let mut result = vec![[0.0f32; 3]; width * down.functions];
    let mut line = vec![[0.0f32; 3]; width];
    for (row, down) in (down.first..).zip(down.pixels()) {
        line.fill([0.0; 3]);
        for (pixel, weights) in image.row(row)[across.first..].iter().zip(across.pixels()) {
            for (sum, weight) in line.iter_mut().zip(weights) {
                for (sum, value) in sum.iter_mut().zip(pixel.0) {
                    *sum += weight * value;
                }
            }
        }
        for (sums, weight) in result.chunks_exact_mut(width).zip(down) {
            for (sums, line) in sums.iter_mut().zip(&line) {
                for (sum, value) in sums.iter_mut().zip(line) {
                    *sum += weight * value;
                }
            }
        }
    }
    result
}

/// Weight of each degree in the comparison of descriptors.
///
/// From afar the eye sees the mean color of a tile well, its slope less, and finer structure not at all; so weights fall
/// with the degree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// The highest total degree that counts, 0 to [`MAX_DEGREE`].
    pub degree: usize,
    /// From 0, only colors count, for posters that are seen from afar, to 1, structure counts as much as color.
    pub detail: f64,
}

impl Weights {
    /// The factor on coefficients of a total degree: the square root of its weight in a squared distance.
    pub fn factor(&self, total: usize) -> f32 {
        self.detail.clamp(0.0, 1.0).powf(total as f64 / 2.0) as f32
    }

    /// The coefficients of a descriptor as one vector whose Euclidean distance is the weighted one.
    pub fn vector(&self, descriptor: &Descriptor) -> Vec<f32> {
        let mut vector = Vec::with_capacity(3 * products(self.degree));
        for total in 0..=self.degree.min(MAX_DEGREE) {
            let factor = self.factor(total);
            let range = products(total) - total - 1..products(total);
            for coefficient in descriptor.coefficients.get(range).unwrap_or_default() {
                vector.extend(coefficient.map(|value| factor * value));
            }
        }
        vector
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    fn ramp(width: usize, height: usize) -> Image<Oklab> {
        Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            let (x, y) = (col as f32 + 0.5, row as f32 + 0.5);
            Oklab([x / width as f32, y / height as f32, 0.25])
        })
    }

    #[test]
    fn the_squared_length_is_the_mean_square_of_a_polynomial() {
        // a ramp from 0 to 1 has the mean 1/2 and the mean square 1/3; steps of a hundredth take off 1e-5
        let image = ramp(100, 100);
        let descriptor = Descriptor::of(&image, Frame::of(&image), 3);
        let length: f32 = descriptor.coefficients.iter().map(|c| c[0] * c[0]).sum();
        assert!((length - 1.0 / 3.0).abs() < 1e-4, "{length}");
        let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
        assert!(close(descriptor.coefficients[0], [0.5, 0.5, 0.25]));
        assert!(close(descriptor.quarters[1], [0.75, 0.25, 0.25]));
    }

    #[test]
    fn a_frame_sees_what_its_crop_would_see() {
        let image = ramp(60, 40);
        let crop = image.crop(12, 8, Size::new(24, 16).unwrap()).unwrap();
        let frame = Frame {
            left: 12.0,
            top: 8.0,
            width: 24.0,
            height: 16.0,
        };
        let (a, b) = (
            Descriptor::of(&image, frame, 5),
            Descriptor::of(&crop, Frame::of(&crop), 5),
        );
        for (a, b) in a
            .coefficients
            .iter()
            .flatten()
            .zip(b.coefficients.iter().flatten())
        {
            assert!((a - b).abs() < 1e-6);
        }
    }

    #[test]
    fn eight_bits_look_as_their_oklab_does() {
        let image = Image::from_fn(Size::new(37, 23).unwrap(), |col, row| {
            Srgb([(7 * col) as u8, (11 * row) as u8, (col * row) as u8])
        });
        let frame = Frame {
            left: 3.5,
            top: 1.25,
            width: 30.0,
            height: 20.5,
        };
        let oklab = image.convert();
        let mut describer = Describer::default();
        for _ in 0..2 {
            let found = describer.describe(&image, frame, 4);
            assert_eq!(found, Descriptor::of(&oklab, frame, 4));
        }
        for width in 1..=30 {
            // more sides than are kept
            for height in 1..=3 {
                let (width, height) = (f64::from(width), f64::from(height));
                let frame = Frame {
                    width,
                    height,
                    ..frame
                };
                let found = describer.describe(&image, frame, 4);
                assert_eq!(found, Descriptor::of(&oklab, frame, 4));
            }
        }
        let quarters = parts(&oklab, frame, 2);
        assert_eq!(Descriptor::of(&oklab, frame, 4).quarters, quarters[..]);
    }

    #[test]
    fn lower_degrees_are_a_prefix() {
        let image = ramp(30, 30);
        let descriptor = Descriptor::of(&image, Frame::of(&image), 5);
        let vector = |degree| {
            Weights {
                degree,
                detail: 0.5,
            }
            .vector(&descriptor)
        };
        let long = vector(5);
        for degree in 0..5 {
            let short = vector(degree);
            assert_eq!(short.len(), 3 * (degree + 1) * (degree + 2) / 2);
            assert_eq!(long[..short.len()], short);
        }
    }
}
