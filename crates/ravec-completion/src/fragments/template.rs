//! Templates of the search: the known pixels of a target fragment, weighted.
//!
//! The measure is `Σ w |T − S|² + Σ g |∇T − ∇S|² + Σ f (F − E)²` over the fragment: colors with the weight `w` of known
//! pixels, which falls off towards the rim; gradients of the luminance with `g`, which is 0 where a neighbor is unknown;
//! features with `f`, also where colors are unknown, because structure may be marked across a hole.
//!
//! Direct sums (see [`super::direct`]) are the definition; the search by transforms must agree with them.

use super::level::{Channels, GRADIENT_WEIGHT, Level, MAX_VALUES};
use super::target::Shape;
use glam::IVec2;

/// Numbers that a vector holds at most.
pub(super) const LANES: usize = 8;
/// The weight falls off over this share of the radius. Without it a fragment would be as much about its rim as about its
/// middle.
const SOFT: f32 = 0.4;

/// A pixel of a target, as far as it is known.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TargetPixel {
    /// Belongs to the picture: a source must be known there.
    pub(super) inside: bool,
    /// Its values are known.
    pub(super) known: bool,
    /// Values; features also where it is not known.
    pub(super) values: [f32; MAX_VALUES],
}

/// A weighted window with a frame of one pixel.
pub(super) struct Template {
    pub(super) width: usize,
    pub(super) height: usize,
    /// From the window's corner to the middle of the fragment.
    pub(super) middle: IVec2,
    pub(super) channels: Channels,
    /// Length of the rows of the planes below: whole vectors.
    pub(super) stride: usize,
    /// Values, then two gradients.
    pub(super) values: Vec<Vec<f32>>,
    /// Weights of colors, gradients, features.
    pub(super) weights: [Vec<f32>; 3],
    /// `true` for each known pixel.
    known: Vec<bool>,
    /// For each row the part of it that a source must cover, from and to; empty if none.
    pub(super) rows: Vec<(usize, usize)>,
    /// For each row the part of it that has weights, from and to; empty if none.
    pub(super) weighted: Vec<(usize, usize)>,
}

impl Template {
    /// The template of a fragment of a radius, from the pixels at steps from its middle.
    pub(super) fn new(
        shape: Shape,
        radius: i32,
        channels: Channels,
        pixel: impl Fn(IVec2) -> TargetPixel,
    ) -> Self {
        let side = (2 * radius + 3) as usize;
        let middle = IVec2::splat(radius + 1);
        let mut template = Self::empty(side, side, middle, channels);
        let colors = channels.colors();
        for row in 0..side {
            let (mut from, mut to) = (side, 0);
            for col in 0..side {
                let step = IVec2::new(col as i32, row as i32) - middle;
                let found = pixel(step);
                let at = row * template.stride + col;
                for (plane, value) in template.values.iter_mut().zip(&found.values).take(colors) {
                    plane[at] = if found.known { *value } else { 0.0 };
                }
                if channels.features {
                    template.values[colors][at] = found.values[colors];
                }
                template.known[at] = found.known;
                let share = shape.distance(step.as_dvec2()) as f32 / (radius as f32 + 0.5);
                if share > 1.0 || !found.inside {
                    continue;
                }
                let weight = ((1.0 - share) / SOFT + 0.05).min(1.0);
                from = from.min(col);
                to = col + 1;
                template.weights[0][at] = if found.known { weight } else { 0.0 };
                template.weights[2][at] = if channels.features { weight } else { 0.0 };
            }
            template.rows[row] = if to > from { (from, to) } else { (0, 0) };
        }
        template.find_gradients();
        template.find_weighted();
        template
    }

    fn empty(width: usize, height: usize, middle: IVec2, channels: Channels) -> Self {
        let stride = width.next_multiple_of(LANES) + LANES;
        let plane = || vec![0.0; stride * height + LANES];
        Self {
            width,
            height,
            middle,
            channels,
            stride,
            values: (0..channels.values() + 2).map(|_| plane()).collect(),
            weights: [plane(), plane(), plane()],
            known: vec![false; stride * height],
            rows: vec![(0, 0); height],
            weighted: vec![(0, 0); height],
        }
    }

    /// Gradients where all four neighbors are known, with the weights of the colors.
    fn find_gradients(&mut self) {
        let count = self.channels.values();
        let (planes, gradients) = self.values.split_at_mut(count);
        for row in 1..self.height - 1 {
            for col in 1..self.width - 1 {
                let at = row * self.stride + col;
                let around = [at - 1, at + 1, at - self.stride, at + self.stride];
                if !self.known[at] || around.iter().any(|&i| !self.known[i]) {
                    continue;
                }
                let luma = &planes[0];
                gradients[0][at] = GRADIENT_WEIGHT * (luma[around[1]] - luma[around[0]]);
                gradients[1][at] = GRADIENT_WEIGHT * (luma[around[3]] - luma[around[2]]);
                self.weights[1][at] = self.weights[0][at];
            }
        }
    }

    /// Finds the pixels with weight. Gradients have none where colors have none.
    fn find_weighted(&mut self) {
        for (row, weighted) in self.weighted.iter_mut().enumerate() {
            let at = row * self.stride;
            let [colors, _, features] = &self.weights;
            let has_weight = |col: &usize| colors[at + col] > 0.0 || features[at + col] > 0.0;
            let from = (0..self.width).find(has_weight);
            let to = (0..self.width).rev().find(has_weight);
            *weighted = from.zip(to).map_or((0, 0), |(from, last)| (from, last + 1));
        }
    }

    /// The template for levels of half the size: means of the known ones of 2 × 2 pixels. A position of its corner is half
    /// of one of this one's.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2) + 1, self.height.div_ceil(2) + 1);
        let mut half = Self::empty(width, height, self.middle / 2, self.channels);
        let colors = self.channels.colors();
        for row in 0..height {
            let (mut from, mut to) = (width, 0);
            for col in 0..width {
                let (mut known, mut needed) = (0.0f32, 0);
                let at = row * half.stride + col;
                let mut cells = Vec::with_capacity(4);
                for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (x, y) = (2 * col + x, 2 * row + y);
                    if x < self.width && y < self.height {
                        cells.push(y * self.stride + x);
                        needed += u8::from(self.rows[y].0 <= x && x < self.rows[y].1);
                    }
                }
                for &cell in &cells {
                    known += f32::from(self.known[cell]);
                    half.weights[0][at] += self.weights[0][cell];
                    half.weights[2][at] += self.weights[2][cell];
                    for (to, from) in half.values.iter_mut().zip(&self.values).take(colors) {
                        to[at] += from[cell];
                    }
                    if self.channels.features {
                        half.values[colors][at] += 0.25 * self.values[colors][cell];
                    }
                }
                for plane in &mut half.values[..colors] {
                    plane[at] /= known.max(1.0);
                }
                // what is known only in part is known less well
                half.weights[0][at] *= 0.25 * known;
                half.known[at] = known > 1.0;
                if !half.known[at] {
                    half.weights[0][at] = 0.0;
                }
                if needed > 1 {
                    from = from.min(col);
                    to = col + 1;
                } else {
                    half.weights[0][at] = 0.0;
                    half.weights[2][at] = 0.0;
                }
            }
            half.rows[row] = if to > from { (from, to) } else { (0, 0) };
        }
        half.find_gradients();
        half.find_weighted();
        half
    }

    /// The sum of the weights of colors, in pixels of this level.
    pub(super) fn weight(&self) -> f64 {
        self.weights[0].iter().map(|&w| f64::from(w)).sum()
    }

    /// Kind of weights of a plane: 0 for colors, 1 for gradients, 2 for features.
    pub(super) fn weight_of(&self, plane: usize) -> usize {
        if plane < self.channels.colors() {
            0
        } else if plane < self.channels.values() {
            2
        } else {
            1
        }
    }

    /// Returns `true` if a source with the window's corner at `corner` is known as far as the fragment reaches.
    pub(super) fn valid(&self, level: &Level, corner: IVec2) -> bool {
        let (width, height) = (level.width as i32, level.height as i32);
        self.rows.iter().enumerate().all(|(row, &(from, to))| {
            if to == 0 {
                return true;
            }
            let (y, x) = (corner.y + row as i32, corner.x + from as i32);
            if y < 0 || y >= height || x < 0 || corner.x + to as i32 > width {
                return false;
            }
            let mut at = y as usize * level.width + x as usize;
            let mut left = to - from;
            // runs beyond 255 pixels are coded in pieces
            loop {
                let run = usize::from(level.runs[at]);
                if run >= left {
                    return true;
                }
                if run < usize::from(u8::MAX) {
                    return false;
                }
                at += run;
                left -= run;
            }
        })
    }
}
