//! Searches where an alignment has nothing to start from: shifts of the whole frame, and of parts of it.

use crate::camera::picture::Picture;
use glam::{DMat3, dvec2};
use ravec_raster::Plane;

/// Shifts that leave less than this share of the frame are not tried.
const MIN_OVERLAP: f64 = 0.4;

/// Differences are clipped at this multiple of the mean absolute detail, so that moving objects have no say.
const CLIP: f32 = 1.5;

/// The motion, in normalized coordinates, by the shift of whole coarse pixels under which the details of two pictures differ
/// least; shifts of up to `reach` (a share of the longer side) along each axis are tried.
pub(super) fn best_shift(before: &Picture, after: &Picture, reach: f64) -> DMat3 {
    let (a, b) = (scaled(before), scaled(after));
    let (width, height) = (a.width() as isize, a.height() as isize);
    let longest = (reach * width.max(height) as f64).ceil() as isize;
    let most = |side: isize| longest.min((side as f64 * (1.0 - MIN_OVERLAP)) as isize);
    let (most_x, most_y) = (most(width), most(height));
    let mut best = (f32::INFINITY, 0, 0);
    for dy in -most_y..=most_y {
        for dx in -most_x..=most_x {
            let overlap = (width - dx.abs()) * (height - dy.abs());
            if (overlap as f64) < MIN_OVERLAP * (width * height) as f64 {
                continue;
            }
            let mut sum = 0.0;
            for row in 0.max(-dy)..height.min(height - dy) {
                let from = 0.max(-dx) as usize;
                let to = width.min(width - dx) as usize;
                let shifted = (from as isize + dx) as usize;
                let line = &a.row(row as usize)[from..to];
                let other = &b.row((row + dy) as usize)[shifted..shifted + line.len()];
                sum += line
                    .iter()
                    .zip(other)
                    .map(|(p, q)| (p - q).abs().min(CLIP))
                    .sum::<f32>();
            }
            // of equals the shortest shift
            let length = (dx * dx + dy * dy) as f32;
            let score = sum / overlap as f32 + 1e-5 * length;
            if score < best.0 {
                best = (score, dx, dy);
            }
        }
    }
    let frame = after.frame().at_level(after.levels.len() - 1);
    DMat3::from_translation(dvec2(best.1 as f64, best.2 as f64) / frame.half)
}

fn scaled(picture: &Picture) -> Plane {
    let factor = picture.contrast.max(1e-4).recip();
    let mut plane = picture.detail.clone();
    for value in plane.pixels_mut() {
        *value *= factor;
    }
    plane
}

/// Side of the windows that are looked for, in pixels of the level.
const WINDOW: usize = 12;

/// Largest motion of a window along each axis, in pixels of the level: with the default working size 9 % of the width.
const REACH: isize = 10;

/// Correlation from which a window is found. Chance alone reaches 0.8 among all shifts of smooth windows.
const FOUND: f32 = 0.88;

/// Deviation of luma below which a window is plain.
const MIN_CONTRAST: f32 = 0.012;

/// The share of the textured windows of `before` that are found near their place in `after`, each by itself; nothing if fewer
/// than four are textured. Objects that pass close are found, those of another shot are not.
pub(super) fn found_share(before: &Picture, after: &Picture) -> Option<f64> {
    let level = before.levels.len().min(2) - 1;
    let (a, b) = (&before.levels[level], &after.levels[level]);
    let (mut windows, mut found) = (0, 0);
    for top in (0..a.height().saturating_sub(WINDOW - 1)).step_by(WINDOW) {
        for left in (0..a.width().saturating_sub(WINDOW - 1)).step_by(WINDOW) {
            let mut window = [0.0; WINDOW * WINDOW];
            cut(a, left, top, &mut window);
            let deviation = center(&mut window);
            if deviation < MIN_CONTRAST {
                continue;
            }
            windows += 1;
            if best_correlation(b, &window, deviation, left, top) >= FOUND {
                found += 1;
            }
        }
    }
    (windows >= 4).then(|| f64::from(found) / f64::from(windows))
}

fn cut(plane: &Plane, left: usize, top: usize, window: &mut [f32; WINDOW * WINDOW]) {
    for (row, line) in window.chunks_exact_mut(WINDOW).enumerate() {
        line.copy_from_slice(&plane.row(top + row)[left..left + WINDOW]);
    }
}

/// Takes out the mean and returns the deviation.
fn center(window: &mut [f32; WINDOW * WINDOW]) -> f32 {
    let n = window.len() as f32;
    let mean = window.iter().sum::<f32>() / n;
    for value in window.iter_mut() {
        *value -= mean;
    }
    (window.iter().map(|v| v * v).sum::<f32>() / n).sqrt()
}

fn best_correlation(
    plane: &Plane,
    window: &[f32; WINDOW * WINDOW],
    deviation: f32,
    left: usize,
    top: usize,
) -> f32 {
    let span = |at: usize, side: usize| {
        let last = (side - WINDOW) as isize;
        let at = at as isize;
        (at - REACH).max(0) as usize..=(at + REACH).min(last) as usize
    };
    let n = window.len() as f32;
    let mut best = 0.0f32;
    for y in span(top, plane.height()) {
        for x in span(left, plane.width()) {
            let (mut sum, mut squares, mut product) = (0.0, 0.0, 0.0);
            for (row, line) in window.chunks_exact(WINDOW).enumerate() {
                for (w, p) in line.iter().zip(&plane.row(y + row)[x..x + WINDOW]) {
                    sum += p;
                    squares += p * p;
                    product += w * p;
                }
            }
            let mean = sum / n;
            let other = (squares / n - mean * mean).max(0.0).sqrt();
            // half the contrast or twice as much is something else
            if other > 0.4 * deviation && other < 2.5 * deviation {
                best = best.max(product / n / (deviation * other));
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use ravec_raster::Size;
    use ravec_scenes::Seed;
    use ravec_scenes::texture::fractal;

    fn picture(shift: DVec2, seed: Seed) -> Picture {
        let size = Size::new(216, 120).unwrap();
        Picture::new(&Plane::from_fn(size, |col, row| {
            let p = dvec2(col as f64, row as f64) - shift;
            0.5 + 0.3 * fractal(p / 30.0, 1.0 / 30.0, 4, seed) as f32
        }))
    }

    #[test]
    fn a_planted_shift_is_found_within_half_a_coarse_pixel() {
        let before = picture(DVec2::ZERO, Seed(1));
        for (dx, dy) in [(0.0, 0.0), (32.0, 0.0), (-24.0, 16.0), (3.0, -29.0)] {
            let after = picture(dvec2(dx, dy), Seed(1));
            let motion = best_shift(&before, &after, 0.16);
            let found = motion.z_axis.truncate() * after.frame().half;
            assert!(
                (found - dvec2(dx, dy)).abs().max_element() <= 2.0,
                "{found}"
            );
        }
    }

    #[test]
    fn windows_of_the_same_scene_are_found_and_those_of_another_are_not() {
        let before = picture(DVec2::ZERO, Seed(1));
        let same = found_share(&before, &picture(dvec2(9.0, -7.0), Seed(1))).unwrap();
        let other = found_share(&before, &picture(DVec2::ZERO, Seed(2))).unwrap();
        assert!(same > 0.7 && other < 0.15, "{same} {other}");
    }
}
