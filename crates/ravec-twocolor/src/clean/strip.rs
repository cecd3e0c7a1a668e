//! The pixels under a strip of windows, laid out so that neighboring windows lie in neighboring lanes.
//!
//! Windows stand at multiples of the stride `s`, over the image mirrored at its borders, so that every pixel is covered
//! by equally many. Column `X = i·s + f` of a padded row is entry `i` of its *phase* `f`: pixel `dx` of the windows
//! `i, i + 1, …` is then the run of entries from `i + dx / s` of phase `dx % s`.

use crate::pixel::{countable, is_countable};
use crate::sweep::MAX_LANES;
use fearless_simd::prelude::*;
use ravec_raster::color::{linear_from_srgb, srgb_from_linear};
use ravec_raster::{LinearRgba, LinearRows, Rect};

/// Opponent channels: luma, then two of chroma.
pub(super) const CHANNELS: usize = 3;

const INV_SQRT_2: f32 = std::f32::consts::FRAC_1_SQRT_2;
const INV_SQRT_3: f32 = 0.577_350_26;
const INV_SQRT_6: f32 = 0.408_248_3;

/// Orthonormal opponent colors of encoded values: (R + G + B)/√3, (R − B)/√2, (R − 2G + B)/√6.
#[inline(always)]
pub(super) fn opponent_from_rgb([r, g, b]: [f32; 3]) -> [f32; 3] {
    [
        (r + g + b) * INV_SQRT_3,
        (r - b) * INV_SQRT_2,
        (r - 2.0 * g + b) * INV_SQRT_6,
    ]
}

/// The inverse of [`opponent_from_rgb`]: its transpose.
#[inline(always)]
pub(super) fn rgb_from_opponent([y, u, v]: [f32; 3]) -> [f32; 3] {
    let (y, u, v) = (y * INV_SQRT_3, u * INV_SQRT_2, v * INV_SQRT_6);
    [y + u + v, y - 2.0 * v, y - u + v]
}

/// sRGB-encoded values of linear light. Spelled out, as a function that `map` calls is not compiled for the vectors of its caller.
#[inline(always)]
pub(super) fn encoded([r, g, b]: [f32; 3]) -> [f32; 3] {
    [
        srgb_from_linear(r),
        srgb_from_linear(g),
        srgb_from_linear(b),
    ]
}

/// The inverse of [`encoded`].
#[inline(always)]
fn decoded([r, g, b]: [f32; 3]) -> [f32; 3] {
    [
        linear_from_srgb(r),
        linear_from_srgb(g),
        linear_from_srgb(b),
    ]
}

/// The windows that reach into a strip of rows, and how the pixels under them are read and written.
#[derive(Debug, Clone, Copy)]
pub struct CleanStrip {
    /// The rows that are cleaned.
    pub target: Rect,
    /// Side of a window in pixels.
    pub side: usize,
    /// Distance of neighboring windows in pixels.
    pub stride: usize,
    /// Columns, and rows, that the padded strip begins before the target.
    pub lead: [usize; 2],
    /// Windows in a row of windows, and rows of windows. The first one stands at the first pixel of the padded strip.
    pub windows: [usize; 2],
}

impl CleanStrip {
    /// The windows over `target`, a part of an image.
    ///
    /// # Panics
    /// If the stride is 0.
    pub fn new(target: Rect, side: usize, stride: usize) -> Self {
        let lead = [
            lead(target.col, side, stride),
            lead(target.row, side, stride),
        ];
        // windows start at multiples of the stride from the lead on, as long as they reach the target
        let windows = [
            (lead[0] + target.width).div_ceil(stride),
            (lead[1] + target.height).div_ceil(stride),
        ];
        Self {
            target,
            side,
            stride,
            lead,
            windows,
        }
    }

    /// Pictures that are thinner than this are cleaned in a way of their own, with work in proportion to their pixels.
    pub const MIN_SIDE: usize = 8;

    /// The same without the rows of windows that only repeat the first one, because the mirrored image repeats its one or two
    /// rows below them.
    pub(super) fn without_repeats(mut self, image_height: usize) -> Self {
        let repeats = image_height == 1 || (image_height == 2 && self.stride.is_multiple_of(2));
        if repeats && self.lead[1] + self.target.height <= self.side {
            self.windows[1] = 1;
        }
        self
    }

    /// Columns and rows of the padded strip: all that lies under windows.
    pub fn padded(&self) -> [usize; 2] {
        self.windows
            .map(|count| (count - 1) * self.stride + self.side)
    }

    /// Hands encoded opponent colors to `put(column, color)` for each pixel of row `y` of the padded strip; the image is mirrored at
    /// its borders.
    #[inline(always)]
    pub fn read_row(
        &self,
        image: &dyn LinearRows,
        y: usize,
        put: impl FnMut(usize, [f32; CHANNELS]),
    ) {
        RowReader::new(self, image).read(self, image, y, put);
    }

    /// Writes the target pixels in linear light, given their opponent colors by `cleaned(column, row)` of the padded strip;
    /// alpha, and what is fully transparent or not a number, as in `image`.
    #[inline(always)]
    pub fn write(
        &self,
        image: &dyn LinearRows,
        out: &mut [LinearRgba],
        cleaned: impl Fn(usize, usize) -> [f32; CHANNELS],
    ) {
        let target = self.target;
        let mut originals = vec![LinearRgba::default(); target.width];
        let mut colors = vec![[0.0f32; 3]; target.width];
        for (y, out) in out.chunks_exact_mut(target.width).enumerate() {
            for (x, slot) in colors.iter_mut().enumerate() {
                *slot = cleaned(x + self.lead[0], y + self.lead[1]);
            }
            for slot in &mut colors {
                *slot = decoded(rgb_from_opponent(*slot));
            }
            image.read_linear(target.row + y, target.col, &mut originals);
            for ((out, &original), color) in out.iter_mut().zip(&originals).zip(&colors) {
                let visible = original.alpha() > 0.0 && is_countable(original);
                *out = if visible {
                    LinearRgba::from_rgb_alpha(*color, original.alpha())
                } else {
                    original
                };
            }
        }
    }
}

/// Memory for the rows of a padded strip.
struct RowReader {
    /// Column of the image by that of the padded strip.
    columns: Vec<usize>,
    first: usize,
    row: Vec<LinearRgba>,
    opponents: Vec<[f32; CHANNELS]>,
}

impl RowReader {
    fn new(strip: &CleanStrip, image: &dyn LinearRows) -> Self {
        let before = strip.target.col as isize - strip.lead[0] as isize;
        let columns: Vec<usize> = (0..strip.padded()[0] as isize)
            .map(|x| mirrored(before + x, image.size().width()))
            .collect();
        let (first, end) = columns.iter().fold((usize::MAX, 0), |(low, high), &col| {
            (low.min(col), high.max(col + 1))
        });
        Self {
            columns,
            first,
            row: vec![LinearRgba::default(); end - first],
            opponents: vec![[0.0; CHANNELS]; end - first],
        }
    }

    #[inline(always)]
    fn read(
        &mut self,
        strip: &CleanStrip,
        image: &dyn LinearRows,
        y: usize,
        mut put: impl FnMut(usize, [f32; CHANNELS]),
    ) {
        let before = strip.target.row as isize - strip.lead[1] as isize;
        let row = &mut self.row;
        image.read_linear(
            mirrored(before + y as isize, image.size().height()),
            self.first,
            row,
        );
        let mut numbers = true;
        for &pixel in &*row {
            numbers &= is_countable(pixel);
        }
        if !numbers {
            for pixel in &mut *row {
                *pixel = countable(*pixel);
            }
        }
        if image.has_alpha() || !numbers {
            cover_transparent(row);
        }
        for (slot, pixel) in self.opponents.iter_mut().zip(&*row) {
            *slot = opponent_from_rgb(encoded(pixel.rgb()));
        }
        for (x, &col) in self.columns.iter().enumerate() {
            put(x, self.opponents[col - self.first]);
        }
    }
}

/// Buffers of the planes of a strip, reused by the next one.
#[derive(Default)]
pub(super) struct StripMemory {
    colors: [Vec<f32>; CHANNELS],
    sums: [Vec<f32>; CHANNELS],
    weights: [Vec<f32>; CHANNELS],
}

/// A strip of target rows with all windows that reach into it, in lanes.
pub(super) struct Strip {
    grid: CleanStrip,
    pub side: usize,
    pub stride: usize,
    /// Entries in a phase of a row.
    phase_len: usize,
    /// Windows in a row of windows, and rows of windows.
    pub windows: [usize; 2],
    /// Encoded opponent colors.
    pub colors: [Vec<f32>; CHANNELS],
    /// Weighted sums of the estimates.
    pub sums: [Vec<f32>; CHANNELS],
    /// Sums of the weights.
    pub weights: [Vec<f32>; CHANNELS],
}

/// The nearest coordinate of the mirrored image within 0..len; the border pixel itself is not repeated.
fn mirrored(position: isize, len: usize) -> usize {
    if len == 1 {
        return 0;
    }
    let period = 2 * (len as isize - 1);
    let folded = position.rem_euclid(period);
    folded.min(period - folded) as usize
}

/// Distance before `begin` of the first window that reaches it, on the grid of multiples of `stride`.
fn lead(begin: usize, side: usize, stride: usize) -> usize {
    // the first multiple of the stride above begin − side, possibly negative
    let first = (begin as isize - side as isize).div_euclid(stride as isize) + 1;
    (begin as isize - first * stride as isize) as usize
}

impl Strip {
    /// Reads the pixels under a strip into the buffers of another one.
    #[inline(always)]
    pub fn read<S: Simd>(
        _simd: S,
        image: &dyn LinearRows,
        grid: CleanStrip,
        memory: StripMemory,
    ) -> Self {
        let CleanStrip {
            side,
            stride,
            windows,
            ..
        } = grid;
        let [_, rows] = grid.padded();
        let phase_len = windows[0] + side.div_ceil(stride) + 2 * MAX_LANES;
        let len = rows * stride * phase_len;
        let mut strip = Self {
            grid,
            side,
            stride,
            phase_len,
            windows,
            colors: memory.colors,
            sums: memory.sums,
            weights: memory.weights,
        };
        let planes = strip.colors.iter_mut().chain(&mut strip.sums);
        for plane in planes.chain(&mut strip.weights) {
            plane.clear();
            plane.resize(len, 0.0);
        }
        let mut reader = RowReader::new(&grid, image);
        for y in 0..rows {
            reader.read(
                &grid,
                image,
                y,
                #[inline(always)]
                |x, color| {
                    let at = strip.entry(x % stride, y, x / stride);
                    for (plane, value) in strip.colors.iter_mut().zip(color) {
                        plane[at] = value;
                    }
                },
            );
        }
        strip
    }

    /// The buffers, for another strip.
    pub fn into_memory(self) -> StripMemory {
        StripMemory {
            colors: self.colors,
            sums: self.sums,
            weights: self.weights,
        }
    }

    /// The index of entry `i` of phase `phase` of padded row `y`.
    #[inline(always)]
    fn entry(&self, phase: usize, y: usize, i: usize) -> usize {
        (y * self.stride + phase) * self.phase_len + i
    }

    /// Index in each plane at which pixel `(dx, dy)` of the window `(i, j)` and its right neighbors begins.
    #[inline(always)]
    pub fn run(&self, [i, j]: [usize; 2], dx: usize, dy: usize) -> usize {
        self.entry(dx % self.stride, j * self.stride + dy, i + dx / self.stride)
    }

    /// Writes the cleaned target pixels.
    #[inline(always)]
    pub fn write(&self, image: &dyn LinearRows, out: &mut [LinearRgba]) {
        self.grid.write(
            image,
            out,
            #[inline(always)]
            |x, y| {
                let at = self.entry(x % self.stride, y, x / self.stride);
                let mut means = [0.0; CHANNELS];
                for ((mean, sums), weights) in means.iter_mut().zip(&self.sums).zip(&self.weights) {
                    *mean = sums[at] / weights[at];
                }
                means
            },
        );
    }
}

/// Gives fully transparent pixels the color of the last visible one in the row (the leading ones that of the first), so
/// that their meaningless colors make no edges.
fn cover_transparent(row: &mut [LinearRgba]) {
    let Some(first) = row.iter().find(|pixel| pixel.alpha() > 0.0) else {
        return;
    };
    let mut last = *first;
    for pixel in row {
        if pixel.alpha() > 0.0 {
            last = *pixel;
        } else {
            pixel.0[..3].copy_from_slice(&last.0[..3]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_opponent_transform_is_orthonormal() {
        for rgb in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.7, -0.2]] {
            let opponent = opponent_from_rgb(rgb);
            let length = |v: [f32; 3]| v.iter().map(|x| x * x).sum::<f32>();
            assert!((length(opponent) - length(rgb)).abs() < 1e-6);
            for (a, b) in rgb_from_opponent(opponent).into_iter().zip(rgb) {
                assert!((a - b).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn mirroring_does_not_repeat_the_border() {
        let mirror = |len: usize| (-4..7).map(|i| mirrored(i, len)).collect::<Vec<_>>();
        assert_eq!(mirror(4), [2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0]);
        assert_eq!(mirror(1), [0; 11]);
    }

    #[test]
    fn the_first_window_reaches_the_first_pixel_and_stands_on_the_grid() {
        for begin in 0..40 {
            for (side, stride) in [(8, 2), (8, 3), (5, 5), (8, 1)] {
                let first = begin as isize - lead(begin, side, stride) as isize;
                assert_eq!(first.rem_euclid(stride as isize), 0);
                assert!(first + side as isize > begin as isize);
                assert!(first + side as isize - stride as isize <= begin as isize);
            }
        }
    }
}
