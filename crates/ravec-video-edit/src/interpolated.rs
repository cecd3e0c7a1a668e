//! A frame on its plate, and a plate in a frame: the same plane at about the same scale, interpolated by the kernel of Lanczos with
//! three lobes.
//!
//! The kernel runs in the widest vectors of the machine, with equal results on all: first down the columns, then across.

use crate::Colors;
use fearless_simd::{Level, dispatch, f32x4, f32x8, prelude::*};
use glam::{DVec2, DVec3, dvec2};
use ravec_planar::{Beyond, Homography, warp};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Mask, Size, SizeError};
use std::sync::LazyLock;

/// Pixels that the kernel reads along each axis.
const TAPS: usize = 6;
/// Padding of a picture with a replicated border: half a kernel, and one pixel for clamped positions.
const BORDER_PX: usize = TAPS / 2 + 1;
/// Pixels of the picture between samples, at most.
const MAX_SPACING_PX: f64 = 1.25;
/// Samples along each axis of a pixel, at most.
const MAX_SAMPLES: usize = 4;
/// Positions between two pixels that have weights of their own.
const PHASES: usize = 256;

/// Weights for each phase, of sum 1.
static WEIGHTS: LazyLock<Vec<[f32; TAPS]>> = LazyLock::new(|| {
    let lanczos = |x: f64| {
        let sinc = |x: f64| if x.abs() < 1e-9 { 1.0 } else { x.sin() / x };
        let angle = std::f64::consts::PI * x;
        if x.abs() < 3.0 {
            sinc(angle) * sinc(angle / 3.0)
        } else {
            0.0
        }
    };
    (0..=PHASES)
        .map(|phase| {
            let at = phase as f64 / PHASES as f64;
            let weights: [f64; TAPS] = std::array::from_fn(|tap| lanczos(tap as f64 - 2.0 - at));
            let sum: f64 = weights.iter().sum();
            weights.map(|weight| (weight / sum) as f32)
        })
        .collect()
});

/// A picture prepared for views of it. Pixels that are excluded and those that are not finite are left out.
#[derive(Clone)]
pub struct Interpolator {
    /// Colors, and 1 for pixels that are not excluded; the outer part of a kernel reads the colors of the others.
    pixels: Image<[f32; 4]>,
    /// For the first pixel of each kernel: 1 if the inner part of the kernel meets an excluded pixel. `None` if there are none.
    excluded: Option<Image<u8>>,
    bounds: Bounds,
}

/// Clamping range of sample positions, and their offset in the padded picture.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    /// Sample positions are clamped to this range.
    low: DVec2,
    high: DVec2,
    /// Width of the padding in pixels.
    shift: f64,
}

impl Bounds {
    /// Those of a picture that ends at its border.
    const NONE: Self = Self {
        low: DVec2::NEG_INFINITY,
        high: DVec2::INFINITY,
        shift: 0.0,
    };
}

impl Interpolator {
    /// Prepares `colors` without the pixels of `excluded`.
    pub fn new(colors: &Colors, excluded: Option<&Mask>) -> Self {
        let is_excluded =
            |at: (usize, usize)| excluded.is_some_and(|mask| mask.at(at.0, at.1) > 0.0);
        let mut pixels = Image::new(colors.size(), [0.0; 4]);
        pixels.for_each_row(|row, out| {
            for (col, (out, [r, g, b])) in out.iter_mut().zip(colors.row(row)).enumerate() {
                let share = f32::from(u8::from(!is_excluded((col, row))));
                *out = [*r, *g, *b, share];
            }
        });
        Self {
            excluded: excluded
                .filter(|mask| !mask.is_empty())
                .map(|_| touched(&pixels)),
            pixels,
            bounds: Bounds::NONE,
        }
    }

    /// Prepares `colors` with a replicated border.
    pub(crate) fn continued(colors: &Colors) -> Result<Self, SizeError> {
        let (width, height) = (colors.width(), colors.height());
        let size = Size::new(width + 2 * BORDER_PX, height + 2 * BORDER_PX)?;
        let mut pixels = Image::new(size, [0.0; 4]);
        pixels.for_each_row(|row, out| {
            let line = colors.row(row.saturating_sub(BORDER_PX).min(height - 1));
            for (col, out) in out.iter_mut().enumerate() {
                let [r, g, b] = line[col.saturating_sub(BORDER_PX).min(width - 1)];
                *out = [r, g, b, 1.0];
            }
        });
        Ok(Self {
            pixels,
            excluded: None,
            bounds: Bounds {
                low: DVec2::splat(-0.5),
                high: dvec2(width as f64 + 0.5, height as f64 + 0.5),
                shift: BORDER_PX as f64,
            },
        })
    }

    /// The same picture, of which the pixels of `excluded` are left out as well.
    #[must_use]
    pub fn without(&self, excluded: &Mask) -> Self {
        let mut pixels = self.pixels.clone();
        pixels.for_each_row(|row, out| {
            for (col, [_, _, _, share]) in out.iter_mut().enumerate() {
                if excluded.at(col, row) > 0.0 {
                    *share = 0.0;
                }
            }
        });
        Self {
            excluded: Some(touched(&pixels)),
            pixels,
            bounds: self.bounds,
        }
    }

    /// The same picture in other colors.
    #[must_use]
    pub fn recolored(mut self, color: impl Fn([f32; 3]) -> [f32; 3] + Sync) -> Self {
        self.pixels.for_each_row(|_, row| {
            for [r, g, b, _] in row {
                [*r, *g, *b] = color([*r, *g, *b]);
            }
        });
        self
    }

    /// The picture seen through a map from the output: colors times the share of it that is known, and this share.
    ///
    /// The larger singular value of the map at `points` of the output selects the filter: one Lanczos sample per pixel, the mean of up to
    /// 4 × 4, or the elliptical filter of [`warp`](fn@ravec_planar::warp) above a factor of 5 and where a point lies behind the horizon.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn seen(
        &self,
        image_from_output: &Homography,
        points: &[DVec2],
        size: Size,
        progress: &Progress,
    ) -> Result<Image<[f32; 4]>, Cancelled> {
        progress.check()?;
        match samples(image_from_output, points) {
            Some(1) => Ok(self.view(image_from_output, size)),
            Some(samples) => Ok(self.averaged(image_from_output, size, samples)),
            None => self.filtered(image_from_output, size, progress),
        }
    }

    /// The picture seen through the elliptical filter.
    fn filtered(
        &self,
        image_from_output: &Homography,
        size: Size,
        progress: &Progress,
    ) -> Result<Image<[f32; 4]>, Cancelled> {
        let shift = DVec2::splat(self.bounds.shift);
        let shift = Homography::from_translation(shift).unwrap_or(Homography::IDENTITY);
        let map = shift * *image_from_output;
        if self.excluded.is_none() && self.bounds.shift > 0.0 {
            return warp(&self.pixels, &map, size, Beyond::Border, progress);
        }
        let known = self.pixels.map(|pixel| {
            let known = pixel[3] > 0.0;
            if known { pixel } else { [0.0; 4] }
        });
        warp(&known, &map, size, Beyond::Pixel([0.0; 4]), progress)
    }

    /// Colors seen through a map from the output, and 1 where the kernel lies in the picture and meets no pixel that is excluded; 0
    /// elsewhere.
    ///
    /// Nothing is averaged: the map must not reduce the picture by more than a little. A shift by whole pixels keeps colors exactly.
    pub fn view(&self, image_from_output: &Homography, size: Size) -> Image<[f32; 4]> {
        let matrix = image_from_output.matrix();
        let mut output = Image::new(size, [0.0; 4]);
        let level = Level::new();
        output.for_each_row(|row, out| {
            let start = matrix * DVec3::new(0.5, row as f64 + 0.5, 1.0);
            dispatch!(level, simd => self.view_row(simd, start, matrix.x_axis, out));
        });
        output
    }

    /// The mean of `samples` × `samples` views within each pixel of the output, for maps that reduce the picture by about as much:
    /// colors times the share of samples that are known, and this share.
    fn averaged(
        &self,
        image_from_output: &Homography,
        size: Size,
        samples: usize,
    ) -> Image<[f32; 4]> {
        let matrix = image_from_output.matrix();
        let spacing = 1.0 / samples as f64;
        let weight = (spacing * spacing) as f32;
        let mut output = Image::new(size, [0.0; 4]);
        let level = Level::new();
        output.for_each_row(|row, out| {
            let mut line = vec![[0.0; 4]; samples * out.len()];
            for sample in 0..samples {
                line.fill([0.0; 4]);
                let y = row as f64 + (sample as f64 + 0.5) * spacing;
                let start = matrix * DVec3::new(0.5 * spacing, y, 1.0);
                let step = matrix.x_axis * spacing;
                dispatch!(level, simd => self.view_row(simd, start, step, &mut line));
                for (out, line) in out.iter_mut().zip(line.chunks_exact(samples)) {
                    for pixel in line {
                        for (sum, value) in out.iter_mut().zip(pixel) {
                            *sum += weight * value;
                        }
                    }
                }
            }
        });
        output
    }

    /// The pixels of a row of a view: homogeneous points from `start` in steps of `step`.
    #[inline(always)]
    fn view_row<S: Simd>(&self, simd: S, start: DVec3, step: DVec3, out: &mut [[f32; 4]]) {
        for (col, out) in out.iter_mut().enumerate() {
            let at = start + step * col as f64;
            if at.z <= 0.0 {
                continue;
            }
            let scale = 1.0 / at.z;
            let Bounds { low, high, shift } = self.bounds;
            let x = (at.x * scale).max(low.x).min(high.x) + shift;
            let y = (at.y * scale).max(low.y).min(high.y) + shift;
            let color = self.color(simd, x, y);
            // a sum is finite only if all of its pixels are
            if let Some([r, g, b, share]) = color
                && share > 0.0
                && (r + g + b).is_finite()
            {
                *out = [r, g, b, 1.0];
            }
        }
    }

    /// The color at a point, `None` if the kernel leaves the picture or meets an excluded pixel.
    #[inline(always)]
    fn color<S: Simd>(&self, simd: S, x: f64, y: f64) -> Option<[f32; 4]> {
        let [x, y] = [
            Position::new(x, self.pixels.width())?,
            Position::new(y, self.pixels.height())?,
        ];
        // cameras that stand still need no kernel, and have no border
        if let (Some(col), Some(row)) = (x.on_pixel(), y.on_pixel()) {
            return self.pixels.get(col, row);
        }
        let (col, row) = (
            x.first(self.pixels.width())?,
            y.first(self.pixels.height())?,
        );
        let excluded = self.excluded.as_ref();
        if excluded.is_some_and(|excluded| excluded[(col, row)] != 0) {
            return None;
        }
        let (across, down) = (&WEIGHTS[x.phase], &WEIGHTS[y.phase]);
        // two columns in each
        let mut columns = [f32x8::splat(simd, 0.0); TAPS / 2];
        for (row, down) in (row..).zip(down) {
            let values = self.pixels.row(row)[col..col + TAPS].as_flattened();
            for (sum, values) in columns.iter_mut().zip(values.as_chunks::<8>().0) {
                *sum += f32x8::from_slice(simd, values) * *down;
            }
        }
        let mut sum = f32x4::splat(simd, 0.0);
        for (columns, across) in columns.into_iter().zip(across.as_chunks::<2>().0) {
            let (left, right) = columns.split();
            sum += left * across[0];
            sum += right * across[1];
        }
        let mut color = [0.0; 4];
        sum.store_slice(&mut color);
        let [r, g, b, _] = color;
        Some([r, g, b, 1.0])
    }
}

/// Samples along each axis of a pixel for a map with these points of the output; `None` where more than [`MAX_SAMPLES`] are needed, or
/// a point lies behind the horizon.
fn samples(image_from_output: &Homography, points: &[DVec2]) -> Option<usize> {
    if !image_from_output.is_in_front(points) {
        return None;
    }
    let stretches = points
        .iter()
        .map(|at| image_from_output.largest_stretch(*at));
    let samples = (stretches.fold(0.0, f64::max) / MAX_SPACING_PX).ceil();
    (samples <= MAX_SAMPLES as f64).then_some((samples as usize).max(1))
}

/// For the first pixel of each kernel: 1 if the inner part of the kernel meets an excluded pixel.
fn touched(pixels: &Image<[f32; 4]>) -> Image<u8> {
    let size = pixels.size();
    let mut across = Image::new(size, 0u8);
    across.for_each_row(|row, out| {
        let line = pixels.row(row);
        for offset in 1..TAPS - 1 {
            for (out, pixel) in out.iter_mut().zip(line.iter().skip(offset)) {
                *out |= u8::from(pixel[3] == 0.0);
            }
        }
    });
    let mut both = Image::new(size, 0u8);
    both.for_each_row(|row, out| {
        for row in (row + 1..row + TAPS - 1).take_while(|row| *row < size.height()) {
            for (out, across) in out.iter_mut().zip(across.row(row)) {
                *out |= across;
            }
        }
    });
    both
}

/// A position along an axis: the pixel whose center is at or before it, and the phase beyond.
struct Position {
    whole: isize,
    phase: usize,
}

impl Position {
    /// `None` far outside.
    #[inline(always)]
    fn new(at: f64, length: usize) -> Option<Self> {
        let corner = at - 0.5;
        if !(corner > -1.0 && corner < length as f64) {
            return None;
        }
        // a positive number is truncated to the whole one below it
        let whole = (corner + 1.0) as isize - 1;
        let fraction = corner - whole as f64;
        Some(Self {
            whole,
            phase: (fraction * PHASES as f64 + 0.5) as usize,
        })
    }

    /// The pixel whose center is here, if there is one.
    #[inline(always)]
    fn on_pixel(&self) -> Option<usize> {
        let whole = match self.phase {
            0 => self.whole,
            PHASES => self.whole + 1,
            _ => return None,
        };
        usize::try_from(whole).ok()
    }

    /// The first pixel of the kernel, if all of it lies in a picture of this length.
    #[inline(always)]
    fn first(&self, length: usize) -> Option<usize> {
        let first = usize::try_from(self.whole - 2).ok()?;
        (first + TAPS <= length).then_some(first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_are_interpolated_and_borders_and_excluded_pixels_left_out() {
        let size = Size::new(48, 40).unwrap();
        let wave = |x: f64, y: f64| (0.5 + 0.3 * (0.5 * x).sin() * (0.4 * y).cos()) as f32;
        let frame = Colors::from_fn(size, |col, row| {
            [wave(col as f64 + 0.5, row as f64 + 0.5), 0.25, 0.75]
        });
        let map = Homography::from_translation(dvec2(2.3, -1.6)).unwrap();
        let mask = Mask::from_fn(size, |col, row| col == 30 && row == 20);
        let picture = Interpolator::new(&frame, Some(&mask));
        let found = picture.view(&map, size);
        let mut count = 0;
        for row in 0..size.height() {
            for col in 0..size.width() {
                let [r, g, b, known] = found[(col, row)];
                if known == 0.0 {
                    continue;
                }
                count += 1;
                let truth = wave(col as f64 + 2.8, row as f64 - 1.1);
                assert!(
                    (r - truth).abs() < 0.003 && (g - 0.25).abs() < 1e-5 && (b - 0.75).abs() < 1e-5
                );
            }
        }
        assert_eq!(found[(0, 0)][3], 0.0);
        assert_eq!(found[(28, 22)][3], 0.0);
        assert!(count > 1400, "{count}");
        // means of samples, without those that meet the excluded pixel
        let reduced = Homography::from_scale(DVec2::splat(2.0)).unwrap();
        assert_eq!(samples(&reduced, &[dvec2(9.0, 7.0)]), Some(2));
        let by = |factor: f64| Homography::from_scale(DVec2::splat(factor)).unwrap();
        assert_eq!(samples(&by(0.3), &[DVec2::ZERO]), Some(1));
        assert_eq!(samples(&by(6.0), &[DVec2::ZERO]), None);
        let mut tilted = glam::DMat3::IDENTITY;
        tilted.y_axis.z = -0.05;
        let tilted = Homography::from_matrix(tilted).unwrap();
        assert_eq!(samples(&tilted, &[dvec2(5.0, 30.0)]), None);
        let half = picture.averaged(&reduced, Size::new(24, 20).unwrap(), 2);
        for row in 3..17 {
            for col in 3..21 {
                let [r, g, _, share] = half[(col, row)];
                let near = (14..=16).contains(&col) && (9..=11).contains(&row);
                assert!(near || share == 1.0);
                if share > 0.0 {
                    let truth = wave(2.0 * col as f64 + 1.0, 2.0 * row as f64 + 1.0);
                    assert!((r / share - truth).abs() < 0.05 && (g / share - 0.25).abs() < 1e-5);
                }
            }
        }
        assert!(half[(15, 10)][3] < 1.0);
        let still = picture.view(&Homography::IDENTITY, size);
        assert_eq!(still[(47, 0)], [frame[(47, 0)][0], 0.25, 0.75, 1.0]);
        assert_eq!(
            still
                .pixels()
                .iter()
                .filter(|pixel| pixel[3] == 0.0)
                .count(),
            1
        );
    }
}
