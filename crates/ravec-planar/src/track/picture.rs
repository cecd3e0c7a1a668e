//! A frame as the tracker sees it: smoothed values at several sizes, with what must not be used marked.
//!
//! ```text
//! mean of the encoded channels, 0 to 1, of the pixels around the plane
//! mark pixels with a channel at either end of the range, transparent ones and excluded ones
//! blur both by σ = 1; halve both from level to level
//! where the marks exceed a share, the value is NaN
//! ```

use fearless_simd::{Level as SimdLevel, Simd, dispatch};
use glam::DVec2;
use ravec_raster::color::srgb_from_linear;
use ravec_raster::{AnyImage, Image, LinearRgb, LinearRgba, Mask, Pixel, Size, Srgb, Srgba};

/// Taps of the blur before sampling, σ = 1: bilinear samples of a sharp picture would pull the plane towards whole pixels.
const TAPS: [f32; 7] = [
    0.004_433_05,
    0.054_005_58,
    0.242_036_23,
    0.399_050_28,
    0.242_036_23,
    0.054_005_58,
    0.004_433_05,
];
const RADIUS: usize = 3;

/// Share of marked neighbors from which a value is not used, at the finest level and at the others.
const MAX_MARKED: [f32; 2] = [0.15, 0.3];

/// Steps of 255 from either end of the range at which a channel counts as clipped.
const CLIPPED_STEPS: f32 = 2.5;

/// A pixel as the tracker reads it.
trait TrackPixel: Pixel {
    /// The mean of the encoded channels, 0 to 1, and true if it must not be used.
    fn read(self) -> (f32, bool);
}

fn from_unit(channels: [f32; 3]) -> (f32, bool) {
    let [r, g, b] = channels;
    let low = r.min(g).min(b);
    let high = r.max(g).max(b);
    let end = CLIPPED_STEPS / 255.0;
    let mean = (r + g + b) * (1.0 / 3.0);
    // also marks what is not a number
    let marked = !(low > end && high < 1.0 - end);
    (
        if mean.is_finite() {
            mean.clamp(0.0, 1.0)
        } else {
            0.0
        },
        marked,
    )
}

impl TrackPixel for Srgb<u8> {
    #[inline(always)]
    fn read(self) -> (f32, bool) {
        let [r, g, b] = self.0;
        let sum = u16::from(r) + u16::from(g) + u16::from(b);
        let marked = r.min(g).min(b) <= 2 || r.max(g).max(b) >= 253;
        (f32::from(sum) * (1.0 / 765.0), marked)
    }
}

impl TrackPixel for Srgba<u8> {
    #[inline(always)]
    fn read(self) -> (f32, bool) {
        let [r, g, b, a] = self.0;
        let (value, marked) = Srgb([r, g, b]).read();
        (value, marked || a < 128)
    }
}

impl TrackPixel for Srgb<u16> {
    #[inline(always)]
    fn read(self) -> (f32, bool) {
        from_unit(self.0.map(|v| f32::from(v) * (1.0 / 65535.0)))
    }
}

impl TrackPixel for Srgba<u16> {
    #[inline(always)]
    fn read(self) -> (f32, bool) {
        let [r, g, b, a] = self.0;
        let (value, marked) = Srgb([r, g, b]).read();
        (value, marked || a < 32768)
    }
}

impl TrackPixel for LinearRgb {
    #[inline(always)]
    fn read(self) -> (f32, bool) {
        from_unit(self.0.map(srgb_from_linear))
    }
}

impl TrackPixel for LinearRgba {
    #[inline(always)]
    fn read(self) -> (f32, bool) {
        let [r, g, b, a] = self.0;
        let (value, marked) = LinearRgb([r, g, b]).read();
        (value, marked || a.is_nan() || a < 0.5)
    }
}

/// A part of a frame in whole pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

impl Window {
    pub fn whole(size: Size) -> Self {
        Self {
            left: 0,
            top: 0,
            width: size.width(),
            height: size.height(),
        }
    }

    /// The part of a frame that contains points and a margin around them, its left and top multiples of the pixel of the coarsest
    /// of `levels`. At least one such pixel wide and high, at the border if the points are beyond it.
    pub fn around(points: &[DVec2], margin: f64, size: Size, levels: usize) -> Self {
        let step = 1usize << (levels - 1);
        let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min) - margin;
        let high = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max) + margin;
        let span = |low: f64, high: f64, length: usize| {
            let last = (length - 1) / step * step;
            // casts saturate, and NaN becomes 0
            let first = (low.max(0.0) as usize / step * step).min(last);
            let end = (high.max(0.0).ceil() as usize).min(length);
            (first, end.max((first + step).min(length)) - first)
        };
        let (left, width) = span(low.x, high.x, size.width());
        let (top, height) = span(low.y, high.y, size.height());
        Self {
            left,
            top,
            width,
            height,
        }
    }
}

/// One size of a frame.
#[derive(Debug, Clone)]
pub(super) struct Level {
    /// Number of halvings.
    pub index: usize,
    /// Place of the first pixel, in pixels of the level.
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
    /// Values, NaN where they must not be used.
    pub values: Vec<f32>,
}

/// A frame, or a part of it, at several sizes, finest first.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub window: Window,
    pub levels: Vec<Level>,
}

/// Memory of pictures that are no longer used.
#[derive(Debug, Clone, Default)]
pub(super) struct Buffers {
    free: Vec<Vec<f32>>,
}

impl Buffers {
    fn take(&mut self, length: usize) -> Vec<f32> {
        let mut buffer = self.free.pop().unwrap_or_default();
        buffer.clear();
        buffer.resize(length, 0.0);
        buffer
    }

    fn give(&mut self, buffer: Vec<f32>) {
        self.free.push(buffer);
    }

    pub fn recycle(&mut self, picture: Picture) {
        self.free
            .extend(picture.levels.into_iter().map(|level| level.values));
    }
}

impl Picture {
    /// The part of a frame in a window, at up to `levels` sizes. Pixels that `exclude` covers by half are marked.
    pub fn new(
        frame: &AnyImage,
        exclude: Option<&Mask>,
        window: Window,
        levels: usize,
        buffers: &mut Buffers,
    ) -> Self {
        let mut values = buffers.take(window.width * window.height);
        let mut marks = buffers.take(window.width * window.height);
        let mut any =
            ravec_raster::with_image!(frame, image => read(image, window, &mut values, &mut marks));
        if let Some(exclude) = exclude {
            any |= mark_excluded(exclude, window, &mut marks);
        }
        let (width, height) = (window.width, window.height);
        let mut scratch = buffers.take(width * height);
        blur(&mut values, &mut scratch, width);
        if any {
            blur(&mut marks, &mut scratch, width);
        }
        buffers.give(scratch);
        let first = Level {
            index: 0,
            left: window.left,
            top: window.top,
            width,
            height,
            values,
        };
        let picture = Self::from_finest(first, any.then_some(&marks), window, levels, buffers);
        buffers.give(marks);
        picture
    }

    fn from_finest(
        first: Level,
        marks: Option<&Vec<f32>>,
        window: Window,
        count: usize,
        buffers: &mut Buffers,
    ) -> Self {
        let mut levels = vec![first];
        let mut marked: Vec<Vec<f32>> = Vec::new();
        for index in 1..count {
            let last = &levels[index - 1];
            let (width, height) = (last.width / 2, last.height / 2);
            if width == 0 || height == 0 {
                break;
            }
            let mut values = buffers.take(width * height);
            halve(&last.values, last.width, &mut values, width, height);
            if let Some(finest) = marks {
                let mut halved = buffers.take(width * height);
                let before = marked.last().unwrap_or(finest);
                halve(before, last.width, &mut halved, width, height);
                marked.push(halved);
            }
            levels.push(Level {
                index,
                left: last.left / 2,
                top: last.top / 2,
                width,
                height,
                values,
            });
        }
        if let Some(finest) = marks {
            let all = std::iter::once(finest).chain(&marked);
            for (index, (level, marks)) in levels.iter_mut().zip(all).enumerate() {
                let limit = MAX_MARKED[usize::from(index > 0)];
                for (value, &mark) in level.values.iter_mut().zip(marks) {
                    *value = if mark > limit { f32::NAN } else { *value };
                }
            }
        }
        for buffer in marked {
            buffers.give(buffer);
        }
        Self { window, levels }
    }

    /// The level that shows as much as a level of a template, if the frame shows the plane larger by `zoom` halvings.
    pub fn level(&self, index: usize, zoom: i32) -> &Level {
        let wanted = index as i32 + zoom;
        &self.levels[(wanted.max(0) as usize).min(self.levels.len() - 1)]
    }

    /// Coverage of a mask at the sizes of this picture, blurred and halved as its values are.
    pub fn coverage(&self, mask: &Mask) -> Vec<Vec<f32>> {
        let Window {
            left,
            top,
            width,
            height,
        } = self.window;
        let mut finest = Vec::with_capacity(width * height);
        for row in top..top + height {
            finest.extend_from_slice(&mask.coverage().row(row)[left..left + width]);
        }
        let mut scratch = vec![0.0; width * height];
        blur(&mut finest, &mut scratch, width);
        let mut all = vec![finest];
        for (before, level) in self.levels.iter().zip(&self.levels[1..]) {
            let mut values = vec![0.0; level.width * level.height];
            halve(
                &all[all.len() - 1],
                before.width,
                &mut values,
                level.width,
                level.height,
            );
            all.push(values);
        }
        all
    }
}

/// Reads the values and marks of a window; true if anything is marked.
fn read<P: TrackPixel>(
    image: &Image<P>,
    window: Window,
    values: &mut [f32],
    marks: &mut [f32],
) -> bool {
    let level = SimdLevel::new();
    let mut any = false;
    let rows = values
        .chunks_exact_mut(window.width)
        .zip(marks.chunks_exact_mut(window.width));
    for (row, (values, marks)) in rows.enumerate() {
        let pixels = &image.row(window.top + row)[window.left..window.left + window.width];
        any |= dispatch!(level, simd => read_row(simd, pixels, values, marks));
    }
    any
}

#[inline(always)]
fn read_row<S: Simd, P: TrackPixel>(
    _simd: S,
    pixels: &[P],
    values: &mut [f32],
    marks: &mut [f32],
) -> bool {
    let mut any = false;
    for ((&pixel, value), mark) in pixels.iter().zip(values).zip(marks) {
        let (read, marked) = pixel.read();
        *value = read;
        *mark = f32::from(u8::from(marked));
        any |= marked;
    }
    any
}

fn mark_excluded(exclude: &Mask, window: Window, marks: &mut [f32]) -> bool {
    let mut any = false;
    for (row, marks) in marks.chunks_exact_mut(window.width).enumerate() {
        let covered = &exclude.coverage().row(window.top + row)[window.left..][..window.width];
        for (mark, &covered) in marks.iter_mut().zip(covered) {
            if covered >= 0.5 {
                *mark = 1.0;
                any = true;
            }
        }
    }
    any
}

/// Blurs by [`TAPS`]; the border is repeated.
fn blur(values: &mut [f32], scratch: &mut [f32], width: usize) {
    dispatch!(SimdLevel::new(), simd => blur_rows(simd, values, scratch, width));
    dispatch!(SimdLevel::new(), simd => blur_columns(simd, scratch, values, width));
}

#[inline(always)]
fn blur_rows<S: Simd>(_simd: S, from: &[f32], to: &mut [f32], width: usize) {
    let clamped = |row: &[f32], center: usize| {
        (0..7).fold(0.0, |sum, k| {
            let at = (center + k).saturating_sub(RADIUS).min(width - 1);
            sum + TAPS[k] * row[at]
        })
    };
    for (row, out) in from.chunks_exact(width).zip(to.chunks_exact_mut(width)) {
        if width <= 2 * RADIUS {
            for (col, out) in out.iter_mut().enumerate() {
                *out = clamped(row, col);
            }
            continue;
        }
        for col in (0..RADIUS).chain(width - RADIUS..width) {
            out[col] = clamped(row, col);
        }
        let inner = &mut out[RADIUS..width - RADIUS];
        let n = inner.len();
        let [a, b, c, d, e, f, g] = std::array::from_fn(|k| &row[k..k + n]);
        for i in 0..n {
            inner[i] = TAPS[3] * d[i]
                + TAPS[2] * (c[i] + e[i])
                + TAPS[1] * (b[i] + f[i])
                + TAPS[0] * (a[i] + g[i]);
        }
    }
}

#[inline(always)]
fn blur_columns<S: Simd>(_simd: S, from: &[f32], to: &mut [f32], width: usize) {
    let height = from.len() / width;
    for (row, out) in to.chunks_exact_mut(width).enumerate() {
        let [a, b, c, d, e, f, g]: [&[f32]; 7] = std::array::from_fn(|k| {
            let at = (row + k).saturating_sub(RADIUS).min(height - 1);
            &from[at * width..][..width]
        });
        for i in 0..width {
            out[i] = TAPS[3] * d[i]
                + TAPS[2] * (c[i] + e[i])
                + TAPS[1] * (b[i] + f[i])
                + TAPS[0] * (a[i] + g[i]);
        }
    }
}

/// Halves by the taps 1, 3, 3, 1 in both directions; the border is repeated.
fn halve(from: &[f32], from_width: usize, to: &mut [f32], width: usize, height: usize) {
    dispatch!(SimdLevel::new(), simd => halve_rows(simd, from, from_width, to, (width, height)));
}

#[inline(always)]
fn halve_rows<S: Simd>(
    _simd: S,
    from: &[f32],
    from_width: usize,
    to: &mut [f32],
    (width, height): (usize, usize),
) {
    let from_height = from.len() / from_width;
    let mut column = vec![0.0f32; from_width];
    for row in 0..height {
        let [a, b, c, d]: [&[f32]; 4] = std::array::from_fn(|k| {
            let at = (2 * row + k).saturating_sub(1).min(from_height - 1);
            &from[at * from_width..][..from_width]
        });
        for i in 0..from_width {
            column[i] = 0.125 * (a[i] + d[i]) + 0.375 * (b[i] + c[i]);
        }
        let out = &mut to[row * width..][..width];
        let last = from_width - 1;
        let tap = |col: usize| {
            0.125 * (column[(2 * col).saturating_sub(1)] + column[(2 * col + 2).min(last)])
                + 0.375 * (column[2 * col] + column[2 * col + 1])
        };
        out[0] = tap(0);
        if width > 1 {
            out[width - 1] = tap(width - 1);
            for (quad, out) in column[1..]
                .windows(4)
                .step_by(2)
                .zip(&mut out[1..width - 1])
            {
                *out = 0.125 * (quad[0] + quad[3]) + 0.375 * (quad[1] + quad[2]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec2;

    fn gray(size: Size, value: impl Fn(f64, f64) -> f64) -> AnyImage {
        AnyImage::from(Image::from_fn(size, |col, row| {
            let v = value(col as f64 + 0.5, row as f64 + 0.5);
            LinearRgb([ravec_raster::color::linear_from_srgb(v as f32); 3])
        }))
    }

    #[test]
    fn a_slope_stays_a_slope_at_every_level() {
        let size = Size::new(96, 80).unwrap();
        let frame = gray(size, |x, y| 0.2 + 0.004 * x + 0.002 * y);
        let window = Window {
            left: 16,
            top: 8,
            width: 72,
            height: 64,
        };
        let picture = Picture::new(&frame, None, window, 3, &mut Buffers::default());
        assert_eq!(picture.levels.len(), 3);
        for (index, level) in picture.levels.iter().enumerate() {
            let scale = f64::from(1 << index);
            for row in 4..level.height - 4 {
                for col in 4..level.width - 4 {
                    let x = (level.left + col) as f64 + 0.5;
                    let y = (level.top + row) as f64 + 0.5;
                    let expected = 0.2 + 0.004 * x * scale + 0.002 * y * scale;
                    let found = f64::from(level.values[row * level.width + col]);
                    assert!(
                        (found - expected).abs() < 1e-5,
                        "{index} {found} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn clipped_and_excluded_pixels_are_marked() {
        let size = Size::new(40, 40).unwrap();
        let frame = gray(size, |x, _| if x < 10.0 { 1.0 } else { 0.5 });
        let exclude = Mask::from_fn(size, |_, row| row >= 30);
        let window = Window::whole(size);
        let picture = Picture::new(&frame, Some(&exclude), window, 2, &mut Buffers::default());
        let finest = &picture.levels[0].values;
        assert!(finest[20 * 40 + 5].is_nan() && finest[35 * 40 + 20].is_nan());
        assert!((finest[20 * 40 + 20] - 0.5).abs() < 1e-5);
        let coarse = &picture.levels[1].values;
        assert!(coarse[10 * 20 + 2].is_nan() && coarse[10 * 20 + 10].is_finite());
    }

    #[test]
    fn windows_stay_inside_and_start_at_whole_coarse_pixels() {
        let size = Size::new(101, 67).unwrap();
        for points in [
            [dvec2(-50.0, -50.0), dvec2(-20.0, 10.0)],
            [dvec2(20.0, 30.0), dvec2(60.0, 50.0)],
            [dvec2(500.0, 90.0), dvec2(900.0, 95.0)],
            [dvec2(f64::NAN, 0.0), dvec2(1.0, f64::INFINITY)],
        ] {
            let window = Window::around(&points, 7.0, size, 4);
            assert_eq!((window.left % 8, window.top % 8), (0, 0));
            assert!(window.width > 0 && window.left + window.width <= 101);
            assert!(window.height > 0 && window.top + window.height <= 67);
        }
    }
}
