//! Order of filling: the pixels along the rim of the open area, by their priority.
//!
//! First come places of which much is known for sure, and at which structure runs into the hole: confidence times strength.
//! Confidence is 1 for pixels of the picture and falls with every step that was taken on the way; strength is the gradient
//! along the rim, as edges that cross the rim have it, and features count as the strongest of edges.
//!
//! Source: Criminisi, Pérez and Toyama, "Region filling and object removal by exemplar-based image inpainting", 2004.

use super::paste::neighbors;
use super::retouch::Retouch;
use crate::canvas::{HOLE, KNOWN};
use glam::DVec2;
use ravec_raster::{Image, Rect};

/// Radius around a rim pixel within which structure is measured.
const REACH_PX: usize = 4;
/// The priority of a place without any structure, against one with a step from black to white.
const PLAIN: f64 = 0.02;
/// Number of pixels in each direction from which confidence is taken.
const SAMPLES: usize = 9;
/// A mean squared gradient in the weaker direction above which there is structure enough for a small fragment.
const STRUCTURED: f64 = 4e-4;

/// The rim, with the priorities of its pixels.
pub(super) struct Rim {
    /// For each pixel how sure its color is.
    confidence: Image<f32>,
    pixels: Vec<((usize, usize), f64)>,
}

impl Rim {
    pub(super) fn new(retouch: &Retouch, radius: usize) -> Self {
        let canvas = &retouch.canvas;
        let mut rim = Self {
            confidence: canvas
                .states
                .map(|s| if s & KNOWN != 0 { 1.0 } else { 0.0 }),
            pixels: Vec::new(),
        };
        if let Some(bounds) = retouch.index.hole.bounding_box() {
            rim.update(retouch, bounds, radius);
        }
        rim
    }

    /// Looks again at what has changed.
    pub(super) fn update(&mut self, retouch: &Retouch, changed: Rect, radius: usize) {
        let canvas = &retouch.canvas;
        let size = canvas.states.size();
        let near = changed.grown(radius.max(REACH_PX) + 1).clipped(size);
        self.pixels
            .retain(|&((col, row), _)| !near.contains(col, row));
        for row in near.row..near.bottom() {
            for col in near.col..near.right() {
                let open = canvas.states[(col, row)] & HOLE != 0;
                let known = |place| canvas.states[place] & KNOWN != 0;
                if open && neighbors((col, row), canvas).any(known) {
                    let priority = self.priority(retouch, (col, row), radius);
                    self.pixels.push(((col, row), priority));
                }
            }
        }
    }

    /// The next place: that with the highest priority, of equals the uppermost, leftmost one.
    pub(super) fn next(&self) -> Option<(usize, usize)> {
        let best = self.pixels.iter().max_by(|a, b| {
            a.1.total_cmp(&b.1)
                .then((b.0.1, b.0.0).cmp(&(a.0.1, a.0.0)))
        });
        best.map(|pixel| pixel.0)
    }

    /// Does not come back to a place, as nothing can be done about it now.
    pub(super) fn give_up(&mut self, place: (usize, usize)) {
        self.pixels.retain(|pixel| pixel.0 != place);
    }

    /// Pixels in a rectangle that have become known are as sure as the fragment that they came with.
    pub(super) fn settle(
        &mut self,
        retouch: &Retouch,
        place: (usize, usize),
        radius: usize,
        changed: Rect,
    ) {
        let sure = self.mean_confidence(place, radius) as f32;
        for row in changed.row..changed.bottom() {
            for col in changed.col..changed.right() {
                let confidence = &mut self.confidence[(col, row)];
                if *confidence == 0.0 && retouch.canvas.states[(col, row)] & KNOWN != 0 {
                    *confidence = sure;
                }
            }
        }
    }

    fn mean_confidence(&self, (col, row): (usize, usize), radius: usize) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0f64);
        for k in 0..SAMPLES * SAMPLES {
            let step = |k: usize| (2 * radius * k / (SAMPLES - 1)) as isize - radius as isize;
            let (x, y) = (
                col.wrapping_add_signed(step(k % SAMPLES)),
                row.wrapping_add_signed(step(k / SAMPLES)),
            );
            if let Some(confidence) = self.confidence.get(x, y) {
                sum += f64::from(confidence);
                count += 1.0;
            }
        }
        sum / count.max(1.0)
    }

    fn priority(&self, retouch: &Retouch, place: (usize, usize), radius: usize) -> f64 {
        let canvas = &retouch.canvas;
        let around = Rect::new(place.0, place.1, 1, 1)
            .grown(REACH_PX)
            .clipped(canvas.states.size());
        // towards what is known
        let mut normal = DVec2::ZERO;
        let mut gradients: Vec<DVec2> = Vec::new();
        for row in around.row..around.bottom() {
            for col in around.col..around.right() {
                if canvas.states[(col, row)] & KNOWN != 0 {
                    normal += DVec2::new(col as f64 - place.0 as f64, row as f64 - place.1 as f64);
                    gradients.extend(gradient(retouch, col, row));
                }
            }
        }
        let along = normal.normalize_or_zero().perp();
        let strength = gradients
            .iter()
            .map(|g| g.dot(along).abs())
            .fold(0.0, f64::max);
        let feature = retouch
            .index
            .features
            .as_ref()
            .map_or(0.0, |mask| f64::from(mask.at(place.0, place.1)));
        self.mean_confidence(place, radius) * (PLAIN + strength + feature)
    }
}

/// The gradient of the mean color at a pixel, where it is known.
fn gradient(retouch: &Retouch, col: usize, row: usize) -> Option<DVec2> {
    let canvas = &retouch.canvas;
    let value = |col: usize, row: usize| {
        let known = canvas.states.get(col, row).is_some_and(|s| s & KNOWN != 0);
        known.then(|| {
            let [r, g, b, _] = canvas.inks[(col, row)];
            f64::from(r + g + b) / 3.0
        })
    };
    let x = value(col + 1, row)? - value(col.wrapping_sub(1), row)?;
    let y = value(col, row + 1)? - value(col, row.wrapping_sub(1))?;
    Some(0.5 * DVec2::new(x, y))
}

/// The radius for a fragment at a place: the given one where what is known around has structure in all directions, half as
/// much again where it has not.
pub(super) fn local_radius(retouch: &Retouch, place: (usize, usize), radius: u32) -> u32 {
    let around = Rect::new(place.0, place.1, 1, 1)
        .grown(radius as usize)
        .clipped(retouch.canvas.states.size());
    let (mut xx, mut xy, mut yy, mut count) = (0.0, 0.0, 0.0, 0.0f64);
    for row in (around.row..around.bottom()).step_by(2) {
        for col in (around.col..around.right()).step_by(2) {
            if let Some(g) = gradient(retouch, col, row) {
                xx += g.x * g.x;
                xy += g.x * g.y;
                yy += g.y * g.y;
                count += 1.0;
            }
        }
    }
    let weaker = 0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt());
    if weaker > STRUCTURED * count {
        radius
    } else {
        radius + radius / 2
    }
}
