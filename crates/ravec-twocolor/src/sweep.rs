//! The exact fit: the rotating sweep over all splits, for as many blocks at a time as the machine has lanes.
//!
//! Plain idea, for one block of `n` mean-free pixels `P`:
//!
//! ```text
//! S[k] = sum of the first k pixels of the initial order
//! for (k, pixel) in events:
//!     S[k] = S[k − 1] + P[pixel]
//!     gain = |S[k]|² (1/k + 1/(n − k))          since S of side 1 is −S[k]
//!     keep the largest gain and its event
//! ```
//!
//! Departures: (1) every value is a vector over blocks; (2) blocks with transparency or clipped by the border carry their
//! weights along as two more sums; (3) no fused multiply-add, so that every instruction set gives the same bits.
//!
//! Notation: `n` pixels of a block, `k` of them on side 0, `S` sum of mean-free colors over side 0.
//!
//! Everything that holds vectors is inlined into the function that enables the instruction set, closures too (a closure that
//! is not costs a factor of five), and arrays of vectors are walked by loops, since the library's `map` is not inlined.
//!
//! Cost: one load, add, store and gain per split; about 2 ns a split and pass whatever the width, because loads and
//! stores are the limit. The running sums drift by about 1e-6 of the block's contrast over the half turn (1e-5 in the worst
//! blocks), so they choose the split, but its gain and colors are added up afresh.

use crate::split_sums::SplitSums;
use crate::split_table::{SECTORS, SplitTable};
use fearless_simd::prelude::*;
use std::ops::Range;

/// The most lanes of any instruction set.
pub(crate) const MAX_LANES: usize = 16;

/// Weight of a difference of 1 in alpha against a difference of 1 in lightness.
pub(crate) const ALPHA_WEIGHT: f32 = 1.0;

/// Weights below this count as nothing: less than half a step of 16-bit alpha.
pub(crate) const NO_WEIGHT: f32 = 1.0 / 131_072.0;

/// Results of the sweep, one entry per lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// Index into the table's events.
    pub event: [u32; MAX_LANES],
    /// Decrease of the squared error by the best split, below that of one color. At least 0.
    pub gain: [f32; MAX_LANES],
    /// The squared error of one color.
    pub energy: [f32; MAX_LANES],
    /// The mean color of the block.
    pub mean: [[f32; MAX_LANES]; 3],
    /// The sum of the mean-free colors of side 0.
    pub sum_0: [[f32; MAX_LANES]; 3],
}

impl Found {
    /// Result for the block in one lane.
    pub fn lane(&self, lane: usize) -> SplitSums {
        SplitSums {
            event: self.event[lane],
            gain: self.gain[lane],
            energy: self.energy[lane],
            mean: self.mean.map(|values| values[lane]),
            sum_0: self.sum_0.map(|values| values[lane]),
            ..SplitSums::default()
        }
    }
}

/// The best split of each sector of angles, one entry a sector and lane.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Starts {
    /// Indices into the table's events.
    pub event: [[u32; MAX_LANES]; SECTORS],
    /// Their gains.
    pub gain: [[f32; MAX_LANES]; SECTORS],
}

/// The blocks being worked on, one a lane.
pub(crate) struct Batch<S: Simd, const CHANNELS: usize> {
    simd: S,
    /// For each pixel of the block its channels.
    pub pixels: Vec<[S::f32s; CHANNELS]>,
    prefixes: Vec<[S::f32s; CHANNELS]>,
}

/// Channels of an opaque pixel: the color.
pub(crate) const OPAQUE: usize = 3;
/// Channels of a weighted pixel: the color times its weight, the weight (alpha, or 0 outside the image), and 1 inside
/// the image.
pub(crate) const WEIGHTED: usize = 5;

impl<S: Simd, const CHANNELS: usize> Batch<S, CHANNELS> {
    /// Blocks in a batch.
    pub const LANES: usize = S::f32s::LEN;

    /// Room for blocks of `pixel_count` pixels.
    #[inline(always)]
    pub fn new(simd: S, pixel_count: usize) -> Self {
        let zero = [S::f32s::splat(simd, 0.0); CHANNELS];
        Self {
            simd,
            pixels: vec![zero; pixel_count],
            prefixes: vec![zero; pixel_count + 1],
        }
    }

    /// A batch of the same pixels.
    #[inline(always)]
    pub fn clone_pixels(&self) -> Self {
        Self {
            simd: self.simd,
            pixels: self.pixels.clone(),
            prefixes: self.prefixes.clone(),
        }
    }

    /// Visits every event, keeping in each lane and sector the one with the largest gain (the first of equal ones).
    /// `sectors` are consecutive ranges that cover all events; `gain_of(k, S[k])` is the gain of a split;
    /// `keep(sector, gain, event)` receives the best of each.
    #[inline(always)]
    fn sweep(
        &mut self,
        table: &SplitTable,
        sectors: &[Range<usize>],
        gain_of: impl Fn(usize, &[S::f32s; CHANNELS]) -> S::f32s,
        mut keep: impl FnMut(usize, S::f32s, S::f32s),
    ) {
        let simd = self.simd;
        let mut sum = [S::f32s::splat(simd, 0.0); CHANNELS];
        self.prefixes[0] = sum;
        for (k, &pixel) in table.initial_order.iter().enumerate() {
            for (s, p) in sum.iter_mut().zip(self.pixels[pixel as usize]) {
                *s += p;
            }
            self.prefixes[k + 1] = sum;
        }

        // event numbers are exact in f32: there are fewer than 2^24 of them
        let mut number = S::f32s::splat(simd, 0.0);
        let pixels = self.pixels.as_slice();
        let prefixes = self.prefixes.as_mut_slice();
        for (sector, range) in sectors.iter().enumerate() {
            let mut best_gain = S::f32s::splat(simd, 0.0);
            let mut best_event = number;
            for event in &table.events[range.clone()] {
                let k = event.prefix as usize;
                let mut sum = prefixes[k - 1];
                for (s, p) in sum.iter_mut().zip(pixels[event.pixel as usize]) {
                    *s += p;
                }
                prefixes[k] = sum;
                let gain = gain_of(k, &sum);
                let better = gain.simd_gt(best_gain);
                best_gain = better.select(gain, best_gain);
                best_event = better.select(number, best_event);
                number += 1.0;
            }
            keep(sector, best_gain, best_event);
        }
    }

    /// The sums over side 0 of one event a lane, added up afresh: the running sums have drifted.
    #[inline(always)]
    fn sum_of_side_0(&self, table: &SplitTable, events: &[u32; MAX_LANES]) -> [S::f32s; CHANNELS] {
        let simd = self.simd;
        let zero = S::f32s::splat(simd, 0.0);
        let (mut normal_x, mut normal_y, mut offset) = (zero, zero, zero);
        for lane in 0..Self::LANES {
            let line = &table.lines[events[lane] as usize];
            normal_x[lane] = line.normal[0];
            normal_y[lane] = line.normal[1];
            offset[lane] = line.offset;
        }
        let half = 0.5 * (table.side as f32 - 1.0);
        let mut sum = [zero; CHANNELS];
        for (dy, row) in self.pixels.chunks_exact(table.side).enumerate() {
            let limit = offset - normal_y * (dy as f32 - half);
            for (dx, pixel) in row.iter().enumerate() {
                let on_0 = (normal_x * (dx as f32 - half)).simd_lt(limit);
                for (s, &p) in sum.iter_mut().zip(pixel) {
                    *s += on_0.select(p, zero);
                }
            }
        }
        sum
    }
}

#[inline(always)]
fn lanes<S: Simd>(vector: S::f32s) -> [f32; MAX_LANES] {
    let mut array = [0.0; MAX_LANES];
    vector.store_slice(&mut array[..S::f32s::LEN]);
    array
}

#[inline(always)]
fn numbers<S: Simd>(events: S::f32s) -> [u32; MAX_LANES] {
    lanes::<S>(events).map(|number| number as u32)
}

#[inline(always)]
fn squared_length<V: Copy + std::ops::Mul<Output = V> + std::ops::Add<Output = V>>(v: &[V]) -> V {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

#[inline(always)]
fn found<S: Simd>(
    gain: S::f32s,
    event: [u32; MAX_LANES],
    energy: S::f32s,
    mean: [S::f32s; 3],
    sum_0: [S::f32s; 3],
) -> Found {
    Found {
        event,
        gain: lanes::<S>(gain),
        energy: lanes::<S>(energy),
        mean: mean.map(lanes::<S>),
        sum_0: sum_0.map(lanes::<S>),
    }
}

impl<S: Simd> Batch<S, OPAQUE> {
    /// The best split of each block. Overwrites the pixels with their differences from the block's mean.
    #[inline(always)]
    pub fn best_split(&mut self, table: &SplitTable) -> Found {
        let (mean, energy) = self.center();
        let mut event = [0; MAX_LANES];
        let weights = table.gain_weights.as_slice();
        self.sweep(
            table,
            std::slice::from_ref(&(0..table.events.len())),
            #[inline(always)]
            |k, sum| squared_length(sum) * weights[k],
            #[inline(always)]
            |_, _, best| {
                event = numbers::<S>(best);
            },
        );
        let sum_0 = self.sum_of_side_0(table, &event);
        let mut weight = S::f32s::splat(self.simd, 0.0);
        for lane in 0..Self::LANES {
            weight[lane] = weights[table.events[event[lane] as usize].prefix as usize];
        }
        let gain = squared_length(&sum_0) * weight;
        found::<S>(gain, event, energy, mean, sum_0)
    }

    /// The best split of each block within each sector of angles. Overwrites the pixels.
    #[inline(always)]
    pub fn best_by_sector(&mut self, table: &SplitTable) -> Starts {
        self.center();
        let weights = table.gain_weights.as_slice();
        let mut starts = Starts::default();
        self.sweep(
            table,
            &table.sectors,
            #[inline(always)]
            |k, sum| squared_length(sum) * weights[k],
            #[inline(always)]
            |sector, gain, event| {
                starts.gain[sector] = lanes::<S>(gain);
                starts.event[sector] = numbers::<S>(event);
            },
        );
        starts
    }

    /// Takes the mean off the pixels; returns it and the energy that is left.
    #[inline(always)]
    pub fn center(&mut self) -> ([S::f32s; 3], S::f32s) {
        let zero = S::f32s::splat(self.simd, 0.0);
        let inverse_count = 1.0 / self.pixels.len() as f32;
        let mut mean = [zero; 3];
        // the gain takes both sides' sums as opposite, so the mean is taken off twice: once leaves an error of its rounding
        for _ in 0..2 {
            let mut total = [zero; 3];
            for pixel in &self.pixels {
                for (t, &p) in total.iter_mut().zip(pixel) {
                    *t += p;
                }
            }
            let mut step = total;
            for s in &mut step {
                *s *= inverse_count;
            }
            for pixel in &mut self.pixels {
                for (p, m) in pixel.iter_mut().zip(step) {
                    *p -= m;
                }
            }
            for (m, s) in mean.iter_mut().zip(step) {
                *m += s;
            }
        }
        let mut energy = zero;
        for pixel in &self.pixels {
            energy += squared_length(pixel);
        }
        (mean, energy)
    }
}

/// Results of the sweep over weighted pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FoundWeighted {
    /// The colors, as for opaque pixels, with weighted sums and means; gain and energy include those of alpha.
    pub found: Found,
    /// The sum of the weights, and of those of side 0.
    pub weight: [[f32; MAX_LANES]; 2],
    /// The pixels inside the image, and those of side 0.
    pub inside: [[f32; MAX_LANES]; 2],
}

impl FoundWeighted {
    /// Result for the block in one lane.
    pub fn lane(&self, lane: usize) -> SplitSums {
        SplitSums {
            weights: self.weight.map(|values| values[lane]),
            insides: self.inside.map(|values| values[lane]),
            ..self.found.lane(lane)
        }
    }
}

/// The sums of a batch of weighted blocks, and the gain that follows from them.
pub(crate) struct WeightedSums<V> {
    /// The weighted mean color.
    pub mean: [V; 3],
    /// The mean weight inside the image.
    pub mean_alpha: V,
    /// The sum of the weights.
    pub weight: V,
    /// The number of pixels inside the image.
    pub inside: V,
    /// The squared error of one color and one alpha.
    pub energy: V,
}

/// The inverse of a weight, 0 where there is none.
#[inline(always)]
fn inverse<S: Simd>(simd: S, weight: S::f32s) -> S::f32s {
    let known = weight.simd_gt(NO_WEIGHT);
    known.select(
        S::f32s::splat(simd, 1.0) / weight,
        S::f32s::splat(simd, 0.0),
    )
}

impl<V: Copy> WeightedSums<V> {
    #[inline(always)]
    fn gain<S: Simd<f32s = V>>(&self, simd: S, sum: &[V; WEIGHTED]) -> V
    where
        V: SimdFloat<S, Element = f32>,
    {
        let (weight_0, inside_0) = (sum[3], sum[4]);
        let colors =
            squared_length(sum) * (inverse(simd, weight_0) + inverse(simd, self.weight - weight_0));
        let off_alpha = weight_0 - inside_0 * self.mean_alpha;
        let alphas = off_alpha
            * off_alpha
            * (inverse(simd, inside_0) + inverse(simd, self.inside - inside_0));
        colors + alphas * ALPHA_WEIGHT
    }
}

impl<S: Simd> Batch<S, WEIGHTED> {
    /// The best split of each block where pixels have weights: the one that minimizes
    /// `Σ α |c − c_i|² + Σ (α − α_i)²` over the pixels inside the image.
    ///
    /// The colors of the pixels must be multiplied by their weight. Overwrites them.
    #[inline(always)]
    pub fn best_split(&mut self, table: &SplitTable) -> FoundWeighted {
        let simd = self.simd;
        let sums = self.center();
        let mut event = [0; MAX_LANES];
        self.sweep(
            table,
            std::slice::from_ref(&(0..table.events.len())),
            #[inline(always)]
            |_, sum| sums.gain(simd, sum),
            #[inline(always)]
            |_, _, best| {
                event = numbers::<S>(best);
            },
        );
        let sum_0 = self.sum_of_side_0(table, &event);
        let gain = sums.gain(simd, &sum_0);
        let [s0, s1, s2, weight_0, inside_0] = sum_0;
        FoundWeighted {
            found: found::<S>(gain, event, sums.energy, sums.mean, [s0, s1, s2]),
            weight: [sums.weight, weight_0].map(lanes::<S>),
            inside: [sums.inside, inside_0].map(lanes::<S>),
        }
    }

    /// The best split of each block within each sector of angles. Overwrites the pixels.
    #[inline(always)]
    pub fn best_by_sector(&mut self, table: &SplitTable) -> Starts {
        let simd = self.simd;
        let sums = self.center();
        let mut starts = Starts::default();
        self.sweep(
            table,
            &table.sectors,
            #[inline(always)]
            |_, sum| sums.gain(simd, sum),
            #[inline(always)]
            |sector, gain, event| {
                starts.gain[sector] = lanes::<S>(gain);
                starts.event[sector] = numbers::<S>(event);
            },
        );
        starts
    }

    /// Takes the weighted mean color off the pixels.
    #[inline(always)]
    pub fn center(&mut self) -> WeightedSums<S::f32s> {
        let simd = self.simd;
        let zero = S::f32s::splat(simd, 0.0);
        let (mut weight, mut inside) = (zero, zero);
        for pixel in &self.pixels {
            weight += pixel[3];
            inside += pixel[4];
        }
        let inverse_weight = inverse(simd, weight);
        let mean_alpha = weight * inverse(simd, inside);
        let mut mean = [zero; 3];
        for _ in 0..2 {
            let mut total = [zero; 3];
            for pixel in &self.pixels {
                for (t, &p) in total.iter_mut().zip(pixel) {
                    *t += p;
                }
            }
            let mut step = total;
            for s in &mut step {
                *s *= inverse_weight;
            }
            for pixel in &mut self.pixels {
                let alpha = pixel[3];
                for (p, m) in pixel.iter_mut().zip(step) {
                    *p -= alpha * m;
                }
            }
            for (m, s) in mean.iter_mut().zip(step) {
                *m += s;
            }
        }
        let mut energy = zero;
        for pixel in &self.pixels {
            let (alpha, is_inside) = (pixel[3], pixel[4]);
            let off_alpha = alpha - is_inside * mean_alpha;
            energy +=
                squared_length(pixel) * inverse(simd, alpha) + off_alpha * off_alpha * ALPHA_WEIGHT;
        }
        WeightedSums {
            mean,
            mean_alpha,
            weight,
            inside,
            energy,
        }
    }
}
