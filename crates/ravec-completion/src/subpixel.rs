//! Offsets to a fraction of a pixel.
//!
//! A period is seldom a whole number of pixels, and a seam that is half a pixel off shows. So each offset takes one robust
//! Gauss-Newton step on known pixels around the hole, and keeps it only if they then match clearly better: pixels that
//! are copied as they are stay sharp.

use crate::canvas::{KNOWN, STEADY};
use crate::sheet::{Sheet, distance_sq};
use glam::{DVec2, IVec2};

/// A step is never longer than this in either direction: beyond it the neighbors would have been better offsets.
const LONGEST_PX: f64 = 0.7;
/// Differences beyond this many times their median count as wrong and little.
const ROBUST: f32 = 2.5;
/// A fraction must take away this share of the squared differences to be worth resampling for.
const WORTH: f64 = 0.1;

/// The offset, moved by the best fraction of a pixel; as it is if that does not help.
pub(crate) fn refined(sheet: &Sheet, pixels: &[u32], offset: IVec2) -> DVec2 {
    let mut pairs: Vec<(usize, usize, f32)> = Vec::new();
    for &index in pixels {
        let index = index as usize;
        let Some(other) = sheet.shifted(index, offset) else {
            continue;
        };
        let inside = {
            let at = sheet.position(other);
            at.x > 0 && at.y > 0 && at.x + 1 < sheet.width as i32 && at.y + 1 < sheet.height as i32
        };
        if inside && sheet.is(index, KNOWN | STEADY) && sheet.is(other, KNOWN | STEADY) {
            pairs.push((
                index,
                other,
                distance_sq(&sheet.features[index], &sheet.features[other]),
            ));
        }
    }
    if pairs.len() < 24 {
        return offset.as_dvec2();
    }
    let mut distances: Vec<f32> = pairs.iter().map(|p| p.2).collect();
    let middle = distances.len() / 2;
    let (_, &mut median, _) = distances.select_nth_unstable_by(middle, f32::total_cmp);
    let limit = (ROBUST * ROBUST * median).max(1e-8);
    let mut shift = DVec2::ZERO;
    // the second step corrects the first, whose gradients are those of the whole offset
    for _ in 0..2 {
        let (mut xx, mut xy, mut yy, mut bx, mut by) = (1e-9f64, 0.0f64, 1e-9f64, 0.0f64, 0.0f64);
        for &(a, b, distance) in &pairs {
            let weight = f64::from(limit / (limit + distance));
            let here = &sheet.inks[a];
            let there = sampled(sheet, b, shift);
            for channel in 0..3 {
                let gradient = |step: usize| {
                    let (up, down) = (sheet.inks[b + step][channel], sheet.inks[b - step][channel]);
                    f64::from(0.5 * (up - down))
                };
                let (gx, gy) = (gradient(1), gradient(sheet.width));
                let error = f64::from(here[channel] - there[channel]);
                xx += weight * gx * gx;
                xy += weight * gx * gy;
                yy += weight * gy * gy;
                bx += weight * gx * error;
                by += weight * gy * error;
            }
        }
        let determinant = xx * yy - xy * xy;
        // edges of one direction say nothing about shifts along them
        if determinant < 1e-3 * (xx + yy).powi(2) {
            let along = (bx * xx.sqrt() + by * yy.sqrt() * xy.signum()) / (xx + yy);
            let direction = DVec2::new(xx.sqrt(), yy.sqrt() * xy.signum()) / (xx + yy).sqrt();
            shift += direction * along / (xx + yy).sqrt();
        } else {
            shift += DVec2::new(yy * bx - xy * by, xx * by - xy * bx) / determinant;
        }
        shift = shift.clamp(DVec2::splat(-LONGEST_PX), DVec2::splat(LONGEST_PX));
    }
    let error = |shift: DVec2| -> f64 {
        pairs
            .iter()
            .map(|&(a, b, distance)| {
                let there = sampled(sheet, b, shift);
                let here = &sheet.inks[a];
                let sum: f32 = (0..3).map(|i| (here[i] - there[i]).powi(2)).sum();
                f64::from(sum * limit / (limit + distance))
            })
            .sum()
    };
    if error(shift) < (1.0 - WORTH) * error(DVec2::ZERO) {
        offset.as_dvec2() + shift
    } else {
        offset.as_dvec2()
    }
}

/// The ink beside a pixel, bilinear between the four around it (all on the sheet, for shifts below 1).
fn sampled(sheet: &Sheet, index: usize, shift: DVec2) -> [f32; 3] {
    let (fx, fy) = (shift.x.floor(), shift.y.floor());
    let start = (index as isize + fx as isize + fy as isize * sheet.width as isize) as usize;
    let (tx, ty) = ((shift.x - fx) as f32, (shift.y - fy) as f32);
    let at = |step: usize| -> &[f32; 4] {
        let feature: &[f32; 4] = &sheet.inks[(start + step).min(sheet.inks.len() - 1)];
        feature
    };
    let (a, b, c, d) = (at(0), at(1), at(sheet.width), at(sheet.width + 1));
    std::array::from_fn(|i| {
        (1.0 - ty) * ((1.0 - tx) * a[i] + tx * b[i]) + ty * ((1.0 - tx) * c[i] + tx * d[i])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canvas::{Canvas, HOLE};
    use crate::proposals::around;
    use ravec_progress::Progress;
    use ravec_raster::{Image, LinearRgb, Mask, Rect, Size};

    /// A hole in waves of the given lengths.
    fn waves(x_px: f64, y_px: f64) -> Sheet {
        let size = Size::new(90, 80).unwrap();
        let image = Image::from_fn(size, |col, row| {
            let turn = std::f64::consts::TAU;
            let value = 0.5
                + 0.1 * (turn * col as f64 / x_px).sin()
                + 0.1 * (turn * row as f64 / y_px).sin();
            LinearRgb([value as f32; 3])
        });
        let hole = Rect::new(40, 30, 16, 16);
        let mut canvas =
            Canvas::new(&image, &Mask::from_rect(size, hole), &Progress::none()).unwrap();
        for row in hole.row..hole.bottom() {
            canvas.states.row_mut(row)[hole.col..hole.right()].fill(HOLE);
        }
        Sheet::window(&canvas, Rect::of(size))
    }

    #[test]
    fn the_length_of_a_wave_is_found_to_a_twentieth_of_a_pixel() {
        let sheet = waves(18.4, 21.7);
        let found = refined(&sheet, &around(&sheet, usize::MAX), IVec2::new(18, 22));
        assert!(found.distance(DVec2::new(18.4, 21.7)) < 0.05, "{found}");
    }

    #[test]
    fn whole_offsets_stay_whole() {
        let sheet = waves(18.0, 22.0);
        let offset = IVec2::new(-18, 22);
        assert_eq!(
            refined(&sheet, &around(&sheet, usize::MAX), offset),
            offset.as_dvec2()
        );
    }
}
