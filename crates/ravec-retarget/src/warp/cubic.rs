//! Old pixels weighed by the cubic of Catmull and Rom along x and along y.
//!
//! ```text
//! for each row of the tile:
//!     find the first old pixel that each pixel sees along x and along y, the weights along y, and what all weights add up to
//!     for each pixel, for each four columns that it sees, which are sixteen numbers:
//!         add up the rows, each by its weight
//!         add that by the weights of the columns
//! ```
//!
//! Lookups are done for many pixels together; weights of columns are computed once for each of the four numbers of an
//! old pixel, so that nothing need be moved between lanes.
//!
//! Guarantees: nothing is fused and every sum has its order, so the bits are the same at any width of vectors.
//! Cost: a multiplication and an addition for each sixteen numbers seen.

use super::window::Window;
use super::{REACH, Span};
use fearless_simd::{f32x4, f32x16, prelude::*};
use glam::DVec2;
use std::ops::Range;

/// Numbers in four old pixels.
const FOUR: usize = 16;

/// Memory that is used again from row to row.
#[derive(Default)]
pub(super) struct Taps {
    x: AxisTaps,
    y: AxisTaps,
    /// One over what all weights of a pixel add up to.
    norms: Vec<f32>,
}

/// The old pixels that each pixel of a row sees along an axis.
#[derive(Default)]
struct AxisTaps {
    /// The reach of the cubic in old pixels.
    reaches: Vec<f64>,
    first: Vec<i32>,
    /// The distance from the place examined to the center of the first one, for the cubic.
    starts: Vec<f32>,
    /// That from one to the next.
    steps: Vec<f32>,
    weights: Vec<f32>,
    sums: Vec<f32>,
}

/// Light of each pixel of `spans` in the window, at the places `xs` and `ys` in the old picture.
#[inline(always)]
pub(super) fn cubic<S: Simd>(
    simd: S,
    window: &Window,
    spans: &[Span],
    [xs, ys]: [&[f64]; 2],
    taps: &mut Taps,
    light: &mut [[f32; 4]],
) {
    let origin = window.origin();
    let mut done = 0;
    for row in spans.chunk_by(|a, b| a.row == b.row) {
        let count: usize = row.iter().map(|span| span.count).sum();
        let here = done..done + count;
        taps.find(row, [&xs[here.clone()], &ys[here.clone()]], origin);
        let light = &mut light[here];
        let mut first = 0;
        for span in row {
            let pixels = first..first + span.count;
            filter(simd, window, taps, span.most(), pixels.clone(), light);
            first = pixels.end;
        }
        done += count;
    }
}

/// Fills the `pixels` of a row, which see at most `[columns, rows]` old ones.
#[inline(always)]
fn filter<S: Simd>(
    simd: S,
    window: &Window,
    taps: &Taps,
    [columns, rows]: [usize; 2],
    pixels: Range<usize>,
    light: &mut [[f32; 4]],
) {
    let (numbers, stride) = window.numbers();
    let count = light.len();
    let Range { start, end } = pixels;
    let [x, y] = [&taps.x, &taps.y];
    let firsts = x.first[start..end].iter().zip(&y.first[start..end]);
    let cubics = x.starts[start..end].iter().zip(&x.steps[start..end]);
    let results = light[start..end].iter_mut().zip(&taps.norms[start..end]);
    let each = firsts.zip(cubics).zip(results).zip(start..);
    for ((((&first_x, &first_y), (&start, &step)), (light, &norm)), pixel) in each {
        let sight = Sight {
            numbers: &numbers[first_y as usize * stride + 4 * first_x as usize..],
            stride,
            weights: &y.weights[pixel..],
            pixels: count,
            rows,
            start,
            step,
        };
        let mut sum = f32x16::splat(simd, 0.0);
        let mut column = 0;
        while column + 4 < columns {
            sum = sight.fours::<S, 2>(simd, column, sum);
            column += 8;
        }
        if column < columns {
            sum = sight.fours::<S, 1>(simd, column, sum);
        }
        (quarters(sum) * norm).store_slice(light);
    }
}

/// View of a pixel.
struct Sight<'a> {
    /// The window from the first old pixel on.
    numbers: &'a [f32],
    stride: usize,
    /// Those of the rows, `pixels` apart.
    weights: &'a [f32],
    pixels: usize,
    rows: usize,
    start: f32,
    step: f32,
}

impl Sight<'_> {
    /// Adds four columns, so often, from `column` on.
    #[inline(always)]
    fn fours<S: Simd, const FOURS: usize>(
        &self,
        simd: S,
        column: usize,
        mut sum: f32x16<S>,
    ) -> f32x16<S> {
        let mut seen = [f32x16::splat(simd, 0.0); FOURS];
        let (mut from, mut at) = (4 * column, 0);
        for _ in 0..self.rows {
            let numbers = &self.numbers[from..from + FOURS * FOUR];
            let weight = self.weights[at];
            for (seen, numbers) in seen.iter_mut().zip(numbers.chunks_exact(FOUR)) {
                *seen += f32x16::from_slice(simd, numbers) * weight;
            }
            from += self.stride;
            at += self.pixels;
        }
        let columns = [
            0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0,
        ];
        let mut x = (f32x16::from_slice(simd, &columns) + column as f32) * self.step + self.start;
        for seen in seen {
            let x_abs = x.abs();
            let outer = (-x_abs + 2.0).max(f32x16::splat(simd, 0.0));
            let left = outer - 1.0;
            let inner = left.max(f32x16::splat(simd, 0.0));
            let weight = outer * outer * left + inner * inner * (inner * -4.0 + 2.0);
            sum += seen * weight;
            x += 4.0 * self.step;
        }
        sum
    }
}

impl Span {
    /// The most old pixels that one of them sees along x and along y.
    #[inline(always)]
    fn most(&self) -> [usize; 2] {
        let last = self.width + self.step * (self.count - 1) as f64;
        let seen = 2.0 * REACH * self.width.max(last);
        // casts instead of calls to round up
        seen.to_array()
            .map(|seen| seen as usize + usize::from(seen > f64::from(seen as u32)))
    }
}

impl Taps {
    /// For the pixels of a row, which look at `places` of the old picture.
    #[inline(always)]
    fn find(&mut self, row: &[Span], places: [&[f64]; 2], origin: DVec2) {
        let most = row.iter().map(Span::most);
        let [columns, rows] = most.fold([0, 0], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
        self.x.find(row, places[0], origin.x, |width| width.x);
        self.y.find(row, places[1], origin.y, |width| width.y);
        self.x.weigh(columns);
        self.y.weigh(rows);
        let sums = self.x.sums.iter().zip(&self.y.sums);
        self.norms.clear();
        self.norms.extend(sums.map(|(x, y)| 1.0 / (x * y)));
    }
}

impl AxisTaps {
    #[inline(always)]
    fn find(&mut self, row: &[Span], places: &[f64], origin: f64, along: impl Fn(DVec2) -> f64) {
        let count = places.len();
        self.reaches.clear();
        for span in row {
            let (width, step) = (along(span.width), along(span.step));
            let reaches = (0..span.count as u32).map(|k| REACH * (width + step * f64::from(k)));
            self.reaches.extend(reaches);
        }
        self.first.resize(count, 0);
        self.starts.resize(count, 0.0);
        self.steps.resize(count, 0.0);
        let found = self
            .first
            .iter_mut()
            .zip(&mut self.starts)
            .zip(&mut self.steps);
        let wanted = places.iter().zip(&self.reaches);
        for (((first, start), step), (&at, &reach)) in found.zip(wanted) {
            let at = at - origin;
            // a cast instead of a call to round: it is positive
            *first = (at - reach + 0.5) as i32;
            *step = REACH as f32 / reach as f32;
            *start = (f64::from(*first) + 0.5 - at) as f32 * *step;
        }
    }

    /// The weights of the first `most` old pixels: one after the other, each for all pixels of the row.
    #[inline(always)]
    fn weigh(&mut self, most: usize) {
        let count = self.starts.len();
        self.weights.resize(most * count, 0.0);
        self.sums.clear();
        self.sums.resize(count, 0.0);
        let (starts, steps) = (&self.starts[..count], &self.steps[..count]);
        for (tap, weights) in self.weights.chunks_exact_mut(count).enumerate() {
            let sums = &mut self.sums[..count];
            for k in 0..count {
                let weight = catmull_rom(tap as f32 * steps[k] + starts[k]);
                weights[k] = weight;
                sums[k] += weight;
            }
        }
    }
}

/// The sum of each four numbers that stand four apart.
#[inline(always)]
fn quarters<S: Simd>(sum: f32x16<S>) -> f32x4<S> {
    let (low, high) = sum.split();
    let (low, high) = (low + high).split();
    low + high
}

/// Twice the interpolating cubic of Catmull and Rom, which is made of two that begin where it bends.
#[inline(always)]
fn catmull_rom(x: f32) -> f32 {
    let above_0 = |x: f32| if x > 0.0 { x } else { 0.0 };
    let outer = above_0(2.0 - x.abs());
    let left = outer - 1.0;
    let inner = above_0(left);
    outer * outer * left + inner * inner * (2.0 - 4.0 * inner)
}
