//! Alignment of small patches of one picture in another, to a fraction of a pixel.
//!
//! ```text
//! for each point: cut a patch around it, and the patch around its image bent by the homography's derivatives
//!     bring both to mean 0 and deviation 1
//!     shift the second until the squares of the differences are least (Gauss and Newton)
//! ```
//!
//! Corners of pictures are extrapolated from points in the middle, so a tenth of a pixel at a point matters. Features know
//! their place to a third of a pixel; the pixels around them say more.
//!
//! Source: Baker and Matthews, "Lucas-Kanade 20 years on", 2004 (the inverse form: derivatives of the first patch only).
//!
//! Guarantees: a patch whose shift does not settle, or that does not look alike, is left out. Does not guarantee: that what
//! looks alike is the same thing. Cost: about 5 microseconds a patch and step.

use crate::estimate::PointPair;
use crate::homography::Homography;
use glam::{DMat2, DVec2, dvec2};
use ravec_raster::{Plane, Pyramid, Reduction, gaussian_blur};
use rayon::prelude::*;

/// Side of a patch in samples. Smaller patches see less; larger ones are less flat under the local derivatives.
const SIDE: usize = 15;

/// Steps after which a patch that still moves is given up. Good ones settle in three to six.
const MAX_STEPS: usize = 12;

/// A patch has settled when it moves less than this, in pixels of the coarser picture.
const SETTLED_PX: f64 = 0.005;

/// The least correlation of the settled patches. Shadow, noise and blur lower it; patches of something else stay below.
const MIN_CORRELATION: f64 = 0.75;

/// The blur before patches are cut: bilinear sampling of a sharp picture would pull shifts towards whole pixels.
const BLUR_PX: f64 = 0.8;

/// A picture at all its sizes, softened for sampling.
pub(crate) struct Sizes(Pyramid<f32>);

impl Sizes {
    pub(crate) fn new(plane: &Plane) -> Self {
        Self(Pyramid::with_levels(
            gaussian_blur(plane, BLUR_PX),
            Reduction::Area,
            5,
        ))
    }

    fn contains(&self, p: DVec2) -> bool {
        let size = self.0.level(0).size();
        p.cmpge(DVec2::ZERO).all() && p.x <= size.width() as f64 && p.y <= size.height() as f64
    }
}

/// For each of the `points` in the first picture where it is found in the second one, within `reach_px` (in pixels of the
/// coarser picture) of where `second_from_first` says; in the order of the points.
pub(crate) fn align_patches(
    first: &Sizes,
    second: &Sizes,
    second_from_first: &Homography,
    points: &[DVec2],
    reach_px: f64,
) -> Vec<PointPair> {
    points
        .par_iter()
        .with_min_len(32)
        .filter_map(|&point| align(first, second, second_from_first, point, reach_px))
        .collect()
}

type Patch = [f64; SIDE * SIDE];

fn align(
    first: &Sizes,
    second: &Sizes,
    h: &Homography,
    point: DVec2,
    reach_px: f64,
) -> Option<PointPair> {
    let start = h.try_apply(point)?;
    let local = h.jacobian(point);
    let scale = local.determinant().abs().sqrt();
    // one sample is one pixel of the picture that sees less
    let step = scale.recip().max(1.0);
    let (first_level, second_level) = (level_of(first, step), level_of(second, scale.max(1.0)));
    let samples = local * step;
    let half = 0.5 * (SIDE - 1) as f64;
    let corner = |m: &DMat2, x: f64, y: f64| *m * dvec2(x * half, y * half);
    let inside = |sizes: &Sizes, center: DVec2, m: &DMat2| {
        [(1.0, 1.0), (-1.0, 1.0)].iter().all(|&(x, y)| {
            let c = corner(m, x, y);
            sizes.contains(center + c) && sizes.contains(center - c)
        })
    };
    let straight = DMat2::from_diagonal(DVec2::splat(step));
    if !inside(first, point, &straight) {
        return None;
    }
    let mut template = cut(first, first_level, point, &straight);
    let slopes = slopes(&template);
    let deviation = normalize(&mut template)?;
    // derivatives of the normalized template by a shift along its axes
    let slopes = slopes.map(|g| g / deviation);
    let mut matrix = DMat2::ZERO;
    for g in &slopes {
        matrix.x_axis += *g * g.x;
        matrix.y_axis += *g * g.y;
    }
    let (trace, determinant) = (matrix.x_axis.x + matrix.y_axis.y, matrix.determinant());
    // an edge says nothing along itself
    if determinant <= 0.01 * trace * trace {
        return None;
    }
    let solve = matrix.inverse();
    let mut shift = DVec2::ZERO;
    for _ in 0..MAX_STEPS {
        let center = start + samples * shift;
        if shift.length() > reach_px || !inside(second, center, &samples) {
            return None;
        }
        let mut patch = cut(second, second_level, center, &samples);
        normalize(&mut patch)?;
        let mut sum = DVec2::ZERO;
        let mut product = 0.0;
        for ((t, p), g) in template.iter().zip(&patch).zip(&slopes) {
            sum += *g * (p - t);
            product += p * t;
        }
        let move_by = solve * sum;
        shift -= move_by;
        if move_by.length() < SETTLED_PX {
            let similar = product / (SIDE * SIDE) as f64 >= MIN_CORRELATION;
            return similar.then(|| PointPair::new(point, start + samples * shift));
        }
    }
    None
}

/// The size at which `pixels` pixels of the full picture are about one.
fn level_of(sizes: &Sizes, pixels: f64) -> usize {
    (pixels.log2().round() as usize).min(sizes.0.levels().len() - 1)
}

/// Samples around a center, at the steps that the columns of `m` are.
fn cut(sizes: &Sizes, level: usize, center: DVec2, m: &DMat2) -> Patch {
    let plane = sizes.0.level(level);
    let shrink = 0.5f64.powi(level as i32);
    let half = 0.5 * (SIDE - 1) as f64;
    let (u, v) = (m.x_axis * shrink, m.y_axis * shrink);
    // relative to the center of the first pixel
    let origin = center * shrink - u * half - v * half - 0.5;
    let (width, height) = (plane.width(), plane.height());
    let pixels = plane.pixels();
    let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
    let mut patch = [0.0; SIDE * SIDE];
    for (j, line) in patch.chunks_exact_mut(SIDE).enumerate() {
        let start = origin + v * j as f64;
        for (i, value) in line.iter_mut().enumerate() {
            let p = start + u * i as f64;
            let (x, y) = (p.x.clamp(0.0, right), p.y.clamp(0.0, bottom));
            let (col, row) = (
                (x as usize).min(width.saturating_sub(2)),
                (y as usize).min(height.saturating_sub(2)),
            );
            let (tx, ty) = (x - col as f64, y - row as f64);
            let at = row * width + col;
            let (next, below) = (usize::from(width > 1), if height > 1 { width } else { 0 });
            let [a, b] = [pixels[at], pixels[at + next]].map(f64::from);
            let [c, d] = [pixels[at + below], pixels[at + below + next]].map(f64::from);
            let (top, bottom) = (a + tx * (b - a), c + tx * (d - c));
            *value = top + ty * (bottom - top);
        }
    }
    patch
}

/// Central differences, one-sided at the rim.
fn slopes(patch: &Patch) -> [DVec2; SIDE * SIDE] {
    std::array::from_fn(|k| {
        let (i, j) = (k % SIDE, k / SIDE);
        let along = |at: usize, step: usize, place: usize| {
            let (low, high) = (usize::from(place > 0), usize::from(place < SIDE - 1));
            (patch[at + high * step] - patch[at - low * step]) / (low + high) as f64
        };
        dvec2(along(k, 1, i), along(k, SIDE, j))
    })
}

/// Brings a patch to mean 0 and deviation 1 and returns its deviation before; nothing if it is flat or not finite.
fn normalize(patch: &mut Patch) -> Option<f64> {
    let n = patch.len() as f64;
    let mean = patch.iter().sum::<f64>() / n;
    let variance = patch.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    let deviation = variance.sqrt();
    // half an encoded step of 255
    if deviation.is_nan() || deviation < 0.002 {
        return None;
    }
    for value in patch.iter_mut() {
        *value = (*value - mean) / deviation;
    }
    Some(deviation)
}
