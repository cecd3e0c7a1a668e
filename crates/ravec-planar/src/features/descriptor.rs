//! Descriptors: the surroundings of a feature as 128 numbers.
//!
//! The window is sampled in the feature's own frame: 22 × 22 brightnesses make 20 × 20 gradients, which vote for 8
//! directions in the nearest of 4 × 4 fields. A field is three blurs wide. Where a vote goes and how much it counts
//! depends on the grid alone and is tabulated.

use crate::features::detect::Extremum;
use crate::features::orientation::turn;
use ravec_raster::Plane;
use std::sync::LazyLock;

/// Fields along a side, and directions in each.
const FIELDS: usize = 4;
const DIRECTIONS: usize = 8;

/// Gradients along a side of the window: four to a field, and two beyond the outer ones, which votes of the rim share.
const GRADIENTS: usize = 20;
const SAMPLES: usize = GRADIENTS + 2;

/// The distance of samples in units of the feature's blur: a quarter of a field, finer than the blurred picture's detail.
const STEP: f32 = 0.75;

/// Fields with a rim that takes the votes which fall outside.
const RIM: usize = FIELDS + 2;

/// Factor of an entry before it is rounded. The squares of the true entries sum to 1; few exceed ½.
const UNIT: f32 = 512.0;

/// Gradient directions around a feature. Two are the more alike, the larger their product.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Descriptor(pub(crate) [u8; 128]);

impl Descriptor {
    /// The cosine of the angle between two descriptors, 0 to 1 up to rounding by 2 %. 1 for equal ones.
    pub fn similarity(&self, other: &Self) -> f64 {
        let dot = |a: &[u8; 128], b: &[u8; 128]| -> f64 {
            a.iter()
                .zip(b)
                .map(|(&a, &b)| f64::from(a) * f64::from(b))
                .sum()
        };
        let norm = (dot(&self.0, &self.0) * dot(&other.0, &other.0)).sqrt();
        if norm > 0.0 {
            dot(&self.0, &other.0) / norm
        } else {
            0.0
        }
    }
}

/// Fields that a gradient votes for: the first of 2 × 2 fields (with rim), the shares of the four, times the window.
struct Vote {
    field: usize,
    shares: [f32; 4],
}

static VOTES: LazyLock<Vec<Vote>> = LazyLock::new(|| {
    let middle = (GRADIENTS - 1) as f32 / 2.0;
    let per_field = GRADIENTS as f32 / (FIELDS + 1) as f32;
    let mut votes = Vec::with_capacity(GRADIENTS * GRADIENTS);
    for j in 0..GRADIENTS {
        for i in 0..GRADIENTS {
            let (x, y) = (i as f32 - middle, j as f32 - middle);
            // in fields, with the center of the first one (of the rim) at 0
            let place = |v: f32| v / per_field + (RIM - 1) as f32 / 2.0;
            let (fx, fy) = (place(x), place(y));
            let (tx, ty) = (fx.fract(), fy.fract());
            // the window's standard deviation is half of its four fields
            let width = 0.5 * FIELDS as f32 * per_field;
            let weight = (-(x * x + y * y) / (2.0 * width * width)).exp();
            votes.push(Vote {
                field: fy as usize * RIM + fx as usize,
                shares: [
                    (1.0 - tx) * (1.0 - ty),
                    tx * (1.0 - ty),
                    (1.0 - tx) * ty,
                    tx * ty,
                ]
                .map(|s| s * weight),
            });
        }
    }
    votes
});

/// The descriptor of an extremum that points to `angle` (radians).
pub(super) fn describe(plane: &Plane, extremum: &Extremum, angle: f32) -> Descriptor {
    let step = STEP * extremum.sigma();
    let (u, v) = (
        [step * angle.cos(), step * angle.sin()],
        [-step * angle.sin(), step * angle.cos()],
    );
    let mut window = [0.0f32; SAMPLES * SAMPLES];
    sample_window(plane, [extremum.col, extremum.row], u, v, &mut window);
    let mut fields = [[0.0f32; DIRECTIONS]; RIM * RIM];
    for (index, vote) in VOTES.iter().enumerate() {
        let at = (index / GRADIENTS + 1) * SAMPLES + index % GRADIENTS + 1;
        let gx = window[at + 1] - window[at - 1];
        let gy = window[at + SAMPLES] - window[at - SAMPLES];
        let height = (gx * gx + gy * gy).sqrt();
        let direction = turn(gx, gy) * DIRECTIONS as f32;
        let (first, share) = (direction as usize % DIRECTIONS, direction.fract());
        let second = (first + 1) % DIRECTIONS;
        let (low, high) = (height * (1.0 - share), height * share);
        for (field, part) in [0, 1, RIM, RIM + 1].into_iter().zip(vote.shares) {
            let bins = &mut fields[vote.field + field];
            bins[first] += part * low;
            bins[second] += part * high;
        }
    }
    let mut entries = [0.0f32; 128];
    for (index, entry) in entries.chunks_exact_mut(DIRECTIONS).enumerate() {
        let field = (index / FIELDS + 1) * RIM + index % FIELDS + 1;
        entry.copy_from_slice(&fields[field]);
    }
    Descriptor(rooted(&mut entries))
}

/// Entries above a fifth of the whole are cut, so that one strong edge does not drown the rest; then the root of each share.
fn rooted(entries: &mut [f32; 128]) -> [u8; 128] {
    let norm = entries.iter().map(|e| e * e).sum::<f32>().sqrt();
    for entry in entries.iter_mut() {
        *entry = entry.min(0.2 * norm);
    }
    let sum: f32 = entries.iter().sum();
    let scale = if sum > 0.0 { sum.recip() } else { 0.0 };
    // casts of NaN give 0, and of what is too large 255
    entries.map(|entry| ((entry * scale).sqrt() * UNIT + 0.5) as u8)
}

/// Brightnesses on a grid around a place (whole at pixel centers), with the given steps to the right and down.
fn sample_window(
    plane: &Plane,
    center: [f32; 2],
    u: [f32; 2],
    v: [f32; 2],
    out: &mut [f32; SAMPLES * SAMPLES],
) {
    let half = (SAMPLES - 1) as f32 / 2.0;
    let (width, height) = (plane.width(), plane.height());
    let reach = |k: usize| half * (u[k].abs() + v[k].abs());
    let inside = (0..2).all(|k| {
        let end = if k == 0 { width } else { height };
        center[k] - reach(k) >= 0.0 && center[k] + reach(k) < (end - 1) as f32
    });
    let pixels = plane.pixels();
    for (j, line) in out.chunks_exact_mut(SAMPLES).enumerate() {
        let b = j as f32 - half;
        for (i, value) in line.iter_mut().enumerate() {
            let a = i as f32 - half;
            let x = center[0] + a * u[0] + b * v[0];
            let y = center[1] + a * u[1] + b * v[1];
            *value = if inside {
                // beyond 2²⁴ columns steps are rounded to whole pixels and may lead past the last one but one
                let (col, row) = ((x as usize).min(width - 2), (y as usize).min(height - 2));
                let (tx, ty) = (x - col as f32, y - row as f32);
                let at = row * width + col;
                let top = pixels[at] + tx * (pixels[at + 1] - pixels[at]);
                let (p, q) = (pixels[at + width], pixels[at + width + 1]);
                top + ty * (p + tx * (q - p) - top)
            } else {
                plane.bilinear(glam::dvec2(x as f64 + 0.5, y as f64 + 0.5))
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    #[test]
    fn a_window_at_the_end_of_a_row_of_many_million_pixels_stays_in_the_picture() {
        // columns are even numbers there: each of two steps by more than one leads on by two
        let width = (1 << 24) + 5;
        let plane = Plane::new(Size::new(width, 3).unwrap(), 0.0);
        let mut window = [1.0; SAMPLES * SAMPLES];
        let step = [1.1 / 10.5, 0.0];
        sample_window(&plane, [(1 << 24) as f32, 1.9], step, step, &mut window);
        assert!(window.iter().all(|&value| value == 0.0));
    }
}
