//! A frame on its plate, and a plate in a frame: the same plane at about the same scale, interpolated by the kernel of Lanczos with
//! three lobes.

use crate::Colors;
use glam::{DVec2, DVec3};
use ravec_planar::Homography;
use ravec_raster::{Image, Mask, Size};
use std::sync::LazyLock;

/// Pixels that the kernel reads along each axis.
const TAPS: usize = 6;
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

/// Colors seen through a map from the output, and 1 where the kernel lies in the image and meets no pixel that is excluded; 0
/// elsewhere.
///
/// Pixels of `excluded` and those that are not finite are left out. Nothing is averaged: the map must not reduce the image by more than
/// a little. A shift by whole pixels keeps colors exactly.
pub fn interpolated(
    colors: &Colors,
    excluded: Option<&Mask>,
    image_from_output: &Homography,
    size: Size,
) -> Image<[f32; 4]> {
    let mask = excluded;
    let excluded = mask.map(|mask| touched(mask, colors.size()));
    let matrix = image_from_output.matrix();
    let mut output = Image::new(size, [0.0; 4]);
    output.for_each_row(|row, out| {
        let start = matrix * DVec3::new(0.5, row as f64 + 0.5, 1.0);
        for (col, out) in out.iter_mut().enumerate() {
            let at = start + matrix.x_axis * col as f64;
            if at.z <= 0.0 {
                continue;
            }
            let at = DVec2::new(at.x / at.z, at.y / at.z);
            let color = if let Some(pixel) = on_pixel(at, colors.size()) {
                let free = mask.is_none_or(|mask| mask.at(pixel.0, pixel.1) <= 0.0);
                free.then(|| colors[pixel])
            } else {
                let taps = Taps::at(at, colors.size()).filter(|taps| {
                    let first = (taps.col, taps.row);
                    excluded
                        .as_ref()
                        .is_none_or(|excluded| excluded[first] == 0)
                });
                taps.map(|taps| taps.interpolated(colors))
            };
            // a sum is finite only if all of its pixels are
            if let Some([r, g, b]) = color
                && (r + g + b).is_finite()
            {
                *out = [r, g, b, 1.0];
            }
        }
    });
    output
}

/// The pixel whose center lies at a point: cameras that stand still need no kernel, and have no border.
fn on_pixel(at: DVec2, size: Size) -> Option<(usize, usize)> {
    let corner = at - DVec2::splat(0.5);
    let nearest = corner.round();
    let same = (corner - nearest).abs().max_element() < 0.5 / PHASES as f64;
    let inside = nearest.x >= 0.0
        && nearest.y >= 0.0
        && nearest.x < size.width() as f64
        && nearest.y < size.height() as f64;
    (same && inside).then_some((nearest.x as usize, nearest.y as usize))
}

/// For the first pixel of each kernel: 1 if the inner part of the kernel meets the mask.
fn touched(mask: &Mask, size: Size) -> Image<u8> {
    Image::from_fn(size, |col, row| {
        let inner = (1..TAPS - 1).any(|r| {
            (1..TAPS - 1).any(|c| {
                let (col, row) = (col + c, row + r);
                col < size.width() && row < size.height() && mask.at(col, row) > 0.0
            })
        });
        u8::from(inner)
    })
}

/// The pixels that the kernel reads.
struct Taps {
    col: usize,
    row: usize,
    across: &'static [f32; TAPS],
    down: &'static [f32; TAPS],
}

impl Taps {
    /// `None` if the kernel leaves the frame.
    fn at(at: DVec2, size: Size) -> Option<Self> {
        let corner = at - DVec2::splat(0.5);
        let whole = corner.floor();
        let phase = |fraction: f64| &WEIGHTS[(fraction * PHASES as f64).round() as usize];
        let first = whole - DVec2::splat(2.0);
        let last = first + DVec2::splat((TAPS - 1) as f64);
        let inside = first.x >= 0.0
            && first.y >= 0.0
            && last.x < size.width() as f64
            && last.y < size.height() as f64;
        inside.then(|| Self {
            col: first.x as usize,
            row: first.y as usize,
            across: phase(corner.x - whole.x),
            down: phase(corner.y - whole.y),
        })
    }

    fn interpolated(&self, colors: &Colors) -> [f32; 3] {
        let mut sums = [0.0f32; 3];
        for (row, down) in (self.row..).zip(self.down) {
            let mut line = [0.0f32; 3];
            let pixels = &colors.row(row)[self.col..self.col + TAPS];
            for (pixel, across) in pixels.iter().zip(self.across) {
                for (sum, value) in line.iter_mut().zip(pixel) {
                    *sum += across * value;
                }
            }
            for (sum, value) in sums.iter_mut().zip(line) {
                *sum += down * value;
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec2;

    #[test]
    fn waves_are_interpolated_and_borders_and_excluded_pixels_left_out() {
        let size = Size::new(48, 40).unwrap();
        let wave = |x: f64, y: f64| (0.5 + 0.3 * (0.5 * x).sin() * (0.4 * y).cos()) as f32;
        let frame = Colors::from_fn(size, |col, row| {
            [wave(col as f64 + 0.5, row as f64 + 0.5), 0.25, 0.75]
        });
        let map = Homography::from_translation(dvec2(2.3, -1.6)).unwrap();
        let mask = Mask::from_fn(size, |col, row| col == 30 && row == 20);
        let found = interpolated(&frame, Some(&mask), &map, size);
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
        let still = interpolated(&frame, Some(&mask), &Homography::IDENTITY, size);
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
