//! A square of the picture: depth, then color, then lines, then the mean over the samples of each pixel.
//!
//! The plain idea: for each triangle, for each sample within it, keep the triangle if it is nearer than what is there.
//! Corners are rounded to a 256th of a sample, so that edge functions are exact, and samples on an edge belong to the
//! triangle on one side of it: neighbors leave no gap and share no sample. Of equally near triangles the first stays.
//! A sample is shaded once, after the last triangle.

use glam::{DVec2, Vec3};

use super::camera::Projected;
use super::lines::{Kind, Line, signed_area};
use super::scene::Scene;

/// Pixels along a side. Buffers of a tile fit into the second level of a cache.
pub(super) const TILE_PX: u32 = 64;

/// A tile's place and buffers; they reach a margin beyond the tile, so that lines find the depth at their middle.
pub(super) struct Tile<'a> {
    scene: &'a Scene<'a>,
    /// The sample at the start of the buffers.
    origin: [i64; 2],
    size: [usize; 2],
    /// Samples around the tile.
    margin: usize,
    depth: Vec<f32>,
    triangle: Vec<u32>,
    ink: Vec<f32>,
    ink_kind: Vec<Kind>,
}

/// No triangle.
const NONE: u32 = u32::MAX;

impl<'a> Tile<'a> {
    /// The tile that starts at pixel `from` and has `size` pixels.
    pub fn new(scene: &'a Scene<'a>, from: [u32; 2], size: [u32; 2]) -> Self {
        let side = scene.samples_per_side;
        let margin = scene.margin();
        let origin = from.map(|px| i64::from(px * side) - margin as i64);
        let size = size.map(|px| (px * side) as usize + 2 * margin);
        let count = size[0] * size[1];
        Self {
            scene,
            origin,
            size,
            margin,
            depth: vec![f32::NEG_INFINITY; count],
            triangle: vec![NONE; count],
            ink: Vec::new(),
            ink_kind: Vec::new(),
        }
    }

    /// The samples from the first to before the last that a range of coordinates reaches, along one axis.
    fn samples(&self, axis: usize, low: f64, high: f64) -> std::ops::Range<usize> {
        let origin = self.origin[axis] as f64;
        let size = self.size[axis] as f64;
        let from = (low - origin - 0.5).ceil().clamp(0.0, size) as usize;
        let to = ((high - origin - 0.5).floor() + 1.0).clamp(0.0, size) as usize;
        from..to
    }

    /// Puts a triangle in wherever it is nearest.
    pub fn draw(&mut self, triangle: u32) {
        let corners = self.scene.mesh.triangles()[triangle as usize];
        let mut at = corners.map(|vertex| self.scene.projected[vertex as usize]);
        let mut beyond = self.scene.beyond(corners);
        let area = edge(at[0], at[1], at[2].x, at[2].y);
        if area == 0.0 || area.is_nan() {
            return;
        }
        if area < 0.0 {
            at.swap(1, 2);
            beyond.swap(1, 2);
        }
        let [a, b, c] = at;
        let columns = self.samples(0, a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x));
        let rows = self.samples(1, a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        let owns = [owns_border(b, c), owns_border(c, a), owns_border(a, b)];
        let per_area = 1.0 / area.abs();
        let cut = beyond.iter().any(|&d| d > 0.0);
        for row in rows {
            let y = self.origin[1] as f64 + row as f64 + 0.5;
            for column in columns.clone() {
                let x = self.origin[0] as f64 + column as f64 + 0.5;
                let weights = [edge(b, c, x, y), edge(c, a, x, y), edge(a, b, x, y)];
                let inside = (0..3).all(|i| weights[i] > 0.0 || weights[i] == 0.0 && owns[i]);
                if !inside {
                    continue;
                }
                let key = (weights[0] * a.key + weights[1] * b.key + weights[2] * c.key) * per_area;
                let sample = row * self.size[0] + column;
                if key as f32 <= self.depth[sample] {
                    continue;
                }
                // The sign of the distance from the cut survives the division that is left out.
                let is_beyond = cut
                    && (0..3)
                        .map(|i| weights[i] * at[i].inverse_w * beyond[i])
                        .sum::<f64>()
                        > 0.0;
                if !is_beyond {
                    self.depth[sample] = key as f32;
                    self.triangle[sample] = triangle;
                }
            }
        }
    }

    /// Inks a line wherever it is seen.
    pub fn ink(&mut self, line: &Line) {
        if self.ink.is_empty() {
            self.ink = vec![0.0; self.depth.len()];
            self.ink_kind = vec![Kind::Wire; self.depth.len()];
        }
        // Everything behind the cut of a solid is inside it, and hidden by the cap.
        let hidden_by_cap = self.scene.is_capped() && line.kind != Kind::Cut;
        let [a, b] = line.ends;
        let (from, to) = (DVec2::new(a.x, a.y), DVec2::new(b.x, b.y));
        let along = to - from;
        let length_sq = along.length_squared();
        let half = 0.5 * self.scene.line_width(line.kind);
        let reach = half + 0.5;
        let rows = self.samples(1, a.y.min(b.y) - reach, a.y.max(b.y) + reach);
        for row in rows {
            let y = self.origin[1] as f64 + row as f64 + 0.5;
            let (mut low, mut high) = (a.x.min(b.x) - reach, a.x.max(b.x) + reach);
            // Where a steep line passes this row.
            let spread = reach * length_sq.sqrt() / along.y.abs();
            if spread.is_finite() {
                let middle = a.x + (y - a.y) * along.x / along.y;
                low = low.max(middle - spread);
                high = high.min(middle + spread);
            }
            for column in self.samples(0, low, high) {
                let p = DVec2::new(self.origin[0] as f64 + column as f64 + 0.5, y);
                let t = if length_sq > 0.0 {
                    ((p - from).dot(along) / length_sq).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                let middle = from + t * along;
                let cover = (reach - p.distance(middle)).clamp(0.0, 1.0) as f32;
                let sample = row * self.size[0] + column;
                let known = (self.ink_kind[sample], self.ink[sample]);
                if cover <= 0.0 || (line.kind, cover) <= known {
                    continue;
                }
                let key = a.key + t * (b.key - a.key) + line.bias;
                // Nothing far in front of the line is drawn on.
                let beside = key + line.slope * (reach + 1.0);
                if f64::from(self.depth[sample]) <= beside
                    && self.is_seen(middle, key)
                    && !(hidden_by_cap && self.is_cap(sample))
                {
                    self.ink[sample] = cover;
                    self.ink_kind[sample] = line.kind;
                }
            }
        }
    }

    /// Returns `true` if the surface is no nearer than `key` at the sample of `middle` or at one next to it.
    fn is_seen(&self, middle: DVec2, key: f64) -> bool {
        let range = |axis: usize, at: f64| {
            let at = at.floor() as i64 - self.origin[axis];
            let last = self.size[axis] as i64 - 1;
            (at - 1).clamp(0, last) as usize..=(at + 1).clamp(0, last) as usize
        };
        range(1, middle.y).any(|row| {
            let mut columns = range(0, middle.x);
            columns.any(|column| f64::from(self.depth[row * self.size[0] + column]) <= key)
        })
    }

    fn is_cap(&self, sample: usize) -> bool {
        let triangles = self.scene.mesh.triangles();
        let corners = triangles.get(self.triangle[sample] as usize);
        corners.is_some_and(|&corners| signed_area(&self.scene.projected, corners) > 0.0)
    }

    /// The pixels, row by row, as premultiplied linear light.
    pub fn pixels(&self) -> Vec<[f32; 4]> {
        let side = self.scene.samples_per_side as usize;
        let inner = self.size.map(|size| (size - 2 * self.margin) / side);
        let share = 1.0 / (side * side) as f32;
        let mut pixels = Vec::with_capacity(inner[0] * inner[1]);
        for row in 0..inner[1] {
            for column in 0..inner[0] {
                let first = (self.margin + row * side) * self.size[0] + self.margin + column * side;
                let samples =
                    (0..side).flat_map(|r| (0..side).map(move |c| first + r * self.size[0] + c));
                let triangle = self.triangle[first];
                // Within a triangle one shade will do for the pixel.
                let whole = samples
                    .clone()
                    .all(|sample| self.triangle[sample] == triangle);
                let middle = first + (side / 2) * self.size[0] + side / 2;
                let shade = whole.then(|| self.shade(middle));
                let mut sum = [0.0; 4];
                for sample in samples {
                    let (light, alpha) =
                        self.inked(sample, shade.unwrap_or_else(|| self.shade(sample)));
                    for (sum, x) in sum.iter_mut().zip([light.x, light.y, light.z, alpha]) {
                        *sum += share * x;
                    }
                }
                pixels.push(sum);
            }
        }
        pixels
    }

    /// Light and cover of a sample without lines.
    fn shade(&self, sample: usize) -> (Vec3, f32) {
        let triangle = self.triangle[sample];
        if triangle == NONE {
            return self.scene.background();
        }
        let x = self.origin[0] as f64 + (sample % self.size[0]) as f64 + 0.5;
        let y = self.origin[1] as f64 + (sample / self.size[0]) as f64 + 0.5;
        let [a, b, c] = self.scene.mesh.triangles()[triangle as usize]
            .map(|vertex| self.scene.projected[vertex as usize]);
        let weights = [edge(b, c, x, y), edge(c, a, x, y), edge(a, b, x, y)];
        let front = weights[0] + weights[1] + weights[2] < 0.0;
        // As distances shrink with depth, so do the weights of what is far.
        let weights = [
            weights[0] * a.inverse_w,
            weights[1] * b.inverse_w,
            weights[2] * c.inverse_w,
        ];
        let sum = weights[0] + weights[1] + weights[2];
        let weights = weights.map(|weight| (weight / sum) as f32);
        (self.scene.light(triangle, weights, front, [x, y]), 1.0)
    }

    /// The lines over what a sample shows.
    fn inked(&self, sample: usize, (light, alpha): (Vec3, f32)) -> (Vec3, f32) {
        match self.ink.get(sample) {
            Some(&cover) if cover > 0.0 => {
                let ink = self.scene.line_color(self.ink_kind[sample]);
                (light.lerp(ink, cover), alpha + cover * (1.0 - alpha))
            }
            _ => (light, alpha),
        }
    }
}

/// Twice the area of a, b and the point: positive to the right of the line as the picture shows it.
#[inline]
fn edge(a: Projected, b: Projected, x: f64, y: f64) -> f64 {
    (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)
}

/// Returns `true` if a point on the line from a to b counts as inside: so for exactly one of the two directions.
#[inline]
fn owns_border(a: Projected, b: Projected) -> bool {
    b.y > a.y || b.y == a.y && b.x < a.x
}
