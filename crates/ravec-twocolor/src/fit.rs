//! The fit of some blocks of an image that lie in a row or in a column.

use crate::coarse_to_fine;
use crate::field::MAX_SIDE;
use crate::pixel::{MAX_LIGHT, TwoColorPixel, countable};
use crate::split_sums::SplitSums;
use crate::split_table::{SplitTable, split_table};
use crate::sweep::{Batch, MAX_LANES, OPAQUE, WEIGHTED};
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch};
use ravec_raster::color::oklab_from_linear;
use ravec_raster::{Color, Image, LinearRgba, LinearRows, Oklab};

/// Below which contrast a block counts as one color.
///
/// A block is flat when its two colors lower the error by less than two colors with this Oklab distance would on an
/// evenly split block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FlatThreshold(pub f32);

impl FlatThreshold {
    /// Returns `true` if a block of `weight` pixels with the best split's `gain` has one color only. So has a block
    /// with NaN.
    pub(crate) fn is_flat(self, gain: f32, weight: f32) -> bool {
        // half the block on each side of the mean
        let least = 0.25 * self.0 * self.0 * weight;
        gain.is_nan() || gain <= least
    }
}

/// Search method for the best line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Search {
    /// Over all splits.
    Exact,
    /// Over those near the best of a reduction.
    CoarseToFine,
}

/// Channels of a pixel of as many blocks as a vector has lanes at most.
pub(crate) type Lanes = [[f32; MAX_LANES]; OPAQUE];

/// An image from which blocks are read into the lanes of vectors. Fits take a `&dyn Blocks`, so that they are compiled once and
/// not for each pixel type.
pub(crate) trait Blocks: LinearRows {
    /// Reads a row of `blocks` blocks that begins at `(left, row)`, in linear light: each entry of `out` gets one pixel of all of
    /// them. Returns false, perhaps midway, if a pixel is not opaque.
    fn read_lanes(&self, row: usize, left: usize, blocks: usize, out: &mut [Lanes]) -> bool;
}

impl<P: Color> Blocks for Image<P> {
    fn read_lanes(&self, row: usize, left: usize, blocks: usize, out: &mut [Lanes]) -> bool {
        let side = out.len();
        let pixels = &self.row(row)[left..][..blocks * side];
        for (lane, run) in pixels.chunks_exact(side).enumerate().take(MAX_LANES) {
            for (slot, &pixel) in out.iter_mut().zip(run) {
                let [r, g, b, alpha] = pixel.to_linear().0;
                // an alpha that is not a number makes the pixel transparent
                if P::HAS_ALPHA && !(1.0..=MAX_LIGHT).contains(&alpha) {
                    return false;
                }
                slot[0][lane] = r;
                slot[1][lane] = g;
                slot[2][lane] = b;
            }
        }
        true
    }
}

/// Fits the blocks of block row `block_row`, from left to right.
///
/// `out` holds one entry a block; its length is the number of blocks.
pub(crate) fn fit_block_row(
    level: Level,
    image: &dyn Blocks,
    side: usize,
    search: Search,
    block_row: usize,
    flat: FlatThreshold,
    out: &mut [TwoColorPixel],
) {
    dispatch!(level, simd => fit_row(simd, image, side, search, block_row, flat, out));
}

#[inline(always)]
fn fit_row<S: Simd>(
    simd: S,
    image: &dyn Blocks,
    side: usize,
    search: Search,
    block_row: usize,
    flat: FlatThreshold,
    out: &mut [TwoColorPixel],
) {
    let lanes = Batch::<S, OPAQUE>::LANES;
    let top = block_row * side;
    let size = image.size();
    let whole_rows = top + side <= size.height();
    let whole_blocks = if whole_rows { size.width() / side } else { 0 };
    let mut opaque = Batch::<S, OPAQUE>::new(simd, side * side);
    let mut row = vec![Lanes::default(); side];
    // most pictures never need it
    let mut weighted = None;

    for (batch, out) in out.chunks_mut(lanes).enumerate() {
        let first = batch * lanes;
        let is_whole = first + out.len() <= whole_blocks;
        let corner = [first * side, top];
        if is_whole && gather_opaque(simd, &mut opaque, image, corner, out.len(), &mut row) {
            to_oklab(&mut opaque);
            match search {
                Search::Exact => {
                    let table = split_table(side);
                    let found = opaque.best_split(table);
                    for (lane, pixel) in out.iter_mut().enumerate() {
                        *pixel = opaque_pixel(table, &found.lane(lane), flat);
                    }
                }
                Search::CoarseToFine => {
                    coarse_to_fine::fit_opaque(
                        simd,
                        &mut opaque,
                        side,
                        out.len(),
                        flat,
                        |lane, pixel| out[lane] = pixel,
                    );
                }
            }
        } else {
            let weighted =
                weighted.get_or_insert_with(|| Batch::<S, WEIGHTED>::new(simd, side * side));
            let corner = |lane: usize| ((first + lane) * side, top);
            gather_weighted(simd, weighted, image, side, out.len(), corner);
            fit_weighted(simd, weighted, side, search, flat, out);
        }
    }
}

/// Fits some blocks of block column `block_col` from block row `first_row` down, as many as `out` has entries.
///
/// Together they fill the vectors, which a column that the image's border clips would leave nearly empty row by row.
pub(crate) fn fit_block_column(
    level: Level,
    image: &dyn Blocks,
    side: usize,
    search: Search,
    first: [usize; 2],
    flat: FlatThreshold,
    out: &mut [TwoColorPixel],
) {
    dispatch!(level, simd => fit_column(simd, image, side, search, first, flat, out));
}

#[inline(always)]
fn fit_column<S: Simd>(
    simd: S,
    image: &dyn Blocks,
    side: usize,
    search: Search,
    [block_col, first_row]: [usize; 2],
    flat: FlatThreshold,
    out: &mut [TwoColorPixel],
) {
    let mut weighted = Batch::<S, WEIGHTED>::new(simd, side * side);
    for (batch, out) in out.chunks_mut(Batch::<S, WEIGHTED>::LANES).enumerate() {
        let first = first_row + batch * Batch::<S, WEIGHTED>::LANES;
        let corner = |lane: usize| (block_col * side, (first + lane) * side);
        gather_weighted(simd, &mut weighted, image, side, out.len(), corner);
        fit_weighted(simd, &mut weighted, side, search, flat, out);
    }
}

/// Fits the blocks of a batch, of which `out` has as many as are wanted.
#[inline(always)]
fn fit_weighted<S: Simd>(
    simd: S,
    batch: &mut Batch<S, WEIGHTED>,
    side: usize,
    search: Search,
    flat: FlatThreshold,
    out: &mut [TwoColorPixel],
) {
    match search {
        Search::Exact => {
            let table = split_table(side);
            let found = batch.best_split(table);
            for (lane, pixel) in out.iter_mut().enumerate() {
                *pixel = weighted_pixel(table, &found.lane(lane), flat);
            }
        }
        Search::CoarseToFine => {
            coarse_to_fine::fit_weighted(simd, batch, side, out.len(), flat, |lane, pixel| {
                out[lane] = pixel;
            });
        }
    }
}

/// Puts linear light of blocks from `(left, top)` on into the lanes. Returns false, perhaps midway, if a pixel is not opaque or
/// not a number. `row` is memory for a row of their pixels.
#[inline(always)]
fn gather_opaque<S: Simd>(
    simd: S,
    batch: &mut Batch<S, OPAQUE>,
    image: &dyn Blocks,
    [left, top]: [usize; 2],
    blocks: usize,
    row: &mut [Lanes],
) -> bool {
    for (dy, pixels) in batch.pixels.chunks_exact_mut(row.len()).enumerate() {
        if !image.read_lanes(top + dy, left, blocks, row) {
            return false;
        }
        for (slot, pixel) in pixels.iter_mut().zip(&*row) {
            for (channel, lanes) in slot.iter_mut().zip(pixel) {
                *channel = S::f32s::from_slice(simd, &lanes[..S::f32s::LEN]);
            }
        }
    }
    // in whole vectors, after the fact: cheaper than a test of each pixel
    let mut countable = true;
    for pixel in &batch.pixels {
        for channel in pixel {
            for lane in 0..Batch::<S, OPAQUE>::LANES {
                countable &= (lane >= blocks) | (channel[lane].abs() <= MAX_LIGHT);
            }
        }
    }
    countable
}

/// Linear light to Oklab, in place.
#[inline(always)]
fn to_oklab<S: Simd>(batch: &mut Batch<S, OPAQUE>) {
    for pixel in &mut batch.pixels {
        for lane in 0..Batch::<S, OPAQUE>::LANES {
            let [r, g, b] = pixel;
            [r[lane], g[lane], b[lane]] = oklab_from_linear([r[lane], g[lane], b[lane]]);
        }
    }
}

/// Puts weighted Oklab colors into the lanes, each with the block at its `corner`; what lies outside the image has no
/// weight.
#[inline(always)]
fn gather_weighted<S: Simd>(
    simd: S,
    batch: &mut Batch<S, WEIGHTED>,
    image: &dyn Blocks,
    side: usize,
    blocks: usize,
    corner: impl Fn(usize) -> (usize, usize),
) {
    for slot in &mut batch.pixels {
        *slot = [S::f32s::splat(simd, 0.0); WEIGHTED];
    }
    let size = image.size();
    let mut run = [LinearRgba::default(); MAX_SIDE];
    for lane in 0..blocks {
        let (left, top) = corner(lane);
        let right = (left + side).min(size.width());
        let run = &mut run[..right - left];
        for row in top..(top + side).min(size.height()) {
            let slots = &mut batch.pixels[(row - top) * side..][..right - left];
            image.read_linear(row, left, run);
            for (slot, &pixel) in slots.iter_mut().zip(&*run) {
                let [r, g, b, alpha] = countable(pixel).0;
                for (channel, value) in slot.iter_mut().zip([r, g, b, alpha, 1.0]) {
                    channel[lane] = value;
                }
            }
        }
    }
    // in whole vectors
    for [r, g, b, alpha, _] in &mut batch.pixels {
        for lane in 0..Batch::<S, WEIGHTED>::LANES {
            let cover = alpha[lane].clamp(0.0, 1.0);
            let color = oklab_from_linear([r[lane], g[lane], b[lane]]);
            [r[lane], g[lane], b[lane]] = color.map(|v| cover * v);
            alpha[lane] = cover;
        }
    }
}

fn color_at(sums: &SplitSums, scale: f32) -> Oklab {
    Oklab(std::array::from_fn(|c| {
        sums.mean[c] + sums.sum_0[c] * scale
    }))
}

/// The two-color pixel of an opaque block.
pub(crate) fn opaque_pixel(
    table: &SplitTable,
    sums: &SplitSums,
    flat: FlatThreshold,
) -> TwoColorPixel {
    let count = (table.side * table.side) as f32;
    let (gain, energy) = (sums.gain, sums.energy);
    if flat.is_flat(gain, count) {
        return TwoColorPixel::flat(color_at(sums, 0.0), 1.0, energy.max(0.0) / count);
    }
    let event = sums.event as usize;
    let count_0 = f32::from(table.events[event].prefix);
    TwoColorPixel {
        line: Some(table.lines[event].into()),
        colors: [
            color_at(sums, 1.0 / count_0),
            color_at(sums, -1.0 / (count - count_0)),
        ],
        alphas: [1.0; 2],
        error: (energy - gain).max(0.0) / count,
    }
}

/// The two-color pixel of a block whose pixels have weights.
pub(crate) fn weighted_pixel(
    table: &SplitTable,
    sums: &SplitSums,
    flat: FlatThreshold,
) -> TwoColorPixel {
    let [weight, weight_0] = sums.weights;
    let [inside, inside_0] = sums.insides;
    let (gain, energy) = (sums.gain, sums.energy);
    let share = |part: f32, whole: f32| {
        if whole > 0.0 {
            (part / whole).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    if flat.is_flat(gain, inside) {
        return TwoColorPixel::flat(
            color_at(sums, 0.0),
            share(weight, inside),
            energy.max(0.0) / inside.max(1.0),
        );
    }
    // a side without weight is invisible; it takes the mean color
    let scale = |weight: f32| if weight > 1e-6 { 1.0 / weight } else { 0.0 };
    TwoColorPixel {
        line: Some(table.lines[sums.event as usize].into()),
        colors: [
            color_at(sums, scale(weight_0)),
            color_at(sums, -scale(weight - weight_0)),
        ],
        alphas: [
            share(weight_0, inside_0),
            share(weight - weight_0, inside - inside_0),
        ],
        error: (energy - gain).max(0.0) / inside,
    }
}
