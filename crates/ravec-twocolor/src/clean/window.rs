//! Estimates of a window for its pixels.
//!
//! Notation, per side of a window and channel: `n` pixels, centroid `p̄`, mean `m`, slope `g = M⁻¹ Σ (p − p̄)(y − m)` with
//! the scatter `M`, energy of the plane `E = gᵀMg`; `r` and `a` are the shares of the slope and of the residual that
//! stand out of the noise of variance `σ²`. The estimate of a pixel is
//! `m + r g·(p − p̄) + a (y − m − r g·(p − p̄))`.

use super::noise::{LUMA_RANGE, NoiseLevel};
use super::strip::{CHANNELS, Strip};
use crate::split_table::SplitTable;
use crate::sweep::{Batch, MAX_LANES, OPAQUE};
use fearless_simd::prelude::*;
use ravec_progress::{Cancelled, Progress};
use std::ops::{Add, Mul};

/// Thresholds and shrinkage factors of the Wiener filter of a window.
#[derive(Debug, Clone, Copy)]
pub struct WindowShrinkage;

impl WindowShrinkage {
    /// A split counts if its gain exceeds this multiple of the noise variance. The best of a thousand splits of pure noise
    /// gains about 15 on three channels; twice as much misses faint edges, half as much splits flat windows.
    pub const MIN_GAIN: f32 = 20.0;

    /// Added to the scatter so that a side one pixel wide has a slope. A tenth of a pixel²: far below that of any side that
    /// has a slope worth knowing.
    pub const SCATTER_FLOOR: f32 = 0.1;

    /// The multiple of the noise variance that a plane must have to keep any slope: two parameters' worth of noise, twice.
    pub const SLOPE_SHRINK: f32 = 4.0;

    /// Share of the noise variance that is taken off the residual of luma and of chroma. Below 1 keeps fine texture; chroma
    /// has less of it, and its noise is what the eye minds.
    pub const RESIDUAL_SHRINK: [f32; CHANNELS] = [0.9, 1.26, 1.26];

    /// The least noise variance, in units where white is 1: a hundredth of an 8-bit step. Keeps the weights finite.
    pub const MIN_VARIANCE: f32 = 1.5e-9;

    /// The brightness range of the luma channel, `(R + G + B)/√3`.
    pub const LUMA_RANGE: f32 = LUMA_RANGE;
}

/// Adds the estimates of all windows of the strip to its sums.
///
/// # Errors
/// [`Cancelled`] after at most one row of windows.
#[inline(always)]
pub(super) fn clean_windows<S: Simd>(
    simd: S,
    strip: &mut Strip,
    table: &SplitTable,
    noise: &NoiseLevel,
    progress: &Progress,
) -> Result<(), Cancelled> {
    let lanes = Batch::<S, OPAQUE>::LANES;
    let count = strip.side * strip.side;
    let mut batch = Batch::<S, OPAQUE>::new(simd, count);
    let mut on_0 = vec![S::f32s::splat(simd, 0.0); count];
    for j in 0..strip.windows[1] {
        progress.check()?;
        for i in (0..strip.windows[0]).step_by(lanes) {
            clean_batch(simd, strip, [i, j], table, noise, &mut batch, &mut on_0);
        }
    }
    Ok(())
}

/// The sums of one channel over a side.
#[derive(Clone, Copy)]
struct Moments<V> {
    /// Σ y
    y: V,
    /// Σ y²
    yy: V,
    /// Σ x y, with `(x, z)` the position from the window's center
    xy: V,
    /// Σ z y
    zy: V,
}

/// The sums of the positions over a side.
#[derive(Clone, Copy)]
struct Positions<V> {
    n: V,
    x: V,
    z: V,
    xx: V,
    xz: V,
    zz: V,
}

/// The sums over side 0, and the moments over the whole window.
struct SideSums<V> {
    positions: Positions<V>,
    moments: [Moments<V>; CHANNELS],
    all: [Moments<V>; CHANNELS],
}

/// The estimate of one channel over a side: `base + slope·p + keep·y`, and its weight.
#[derive(Clone, Copy)]
struct Estimate<V> {
    base: V,
    slope: [V; 2],
    keep: V,
    weight: V,
}

impl<V: Copy + Add<Output = V> + Mul<Output = V>> Estimate<V> {
    /// The estimate above `mean`, times its weight.
    #[inline(always)]
    fn weighted(self, mean: V) -> Self {
        let weight = self.weight;
        Self {
            base: weight * (mean + self.base),
            slope: [weight * self.slope[0], weight * self.slope[1]],
            keep: weight * self.keep,
            weight,
        }
    }
}

#[inline(always)]
fn clean_batch<S: Simd>(
    simd: S,
    strip: &mut Strip,
    window: [usize; 2],
    table: &SplitTable,
    noise: &NoiseLevel,
    batch: &mut Batch<S, OPAQUE>,
    on_0: &mut [S::f32s],
) {
    let side = table.side;
    let half = 0.5 * (side as f32 - 1.0);
    let zero = S::f32s::splat(simd, 0.0);
    let one = S::f32s::splat(simd, 1.0);

    for (pixel, slot) in batch.pixels.iter_mut().enumerate() {
        let from = strip.run(window, pixel % side, pixel / side);
        for (channel, plane) in slot.iter_mut().zip(&strip.colors) {
            *channel = S::f32s::from_slice(simd, &plane[from..][..S::f32s::LEN]);
        }
    }
    let found = batch.best_split(table);
    let mut mean = [zero; CHANNELS];
    for (mean, found) in mean.iter_mut().zip(&found.mean) {
        *mean = S::f32s::from_slice(simd, &found[..S::f32s::LEN]);
    }
    let variance = variances(simd, noise, &found.mean[0]);

    // two sides if the gain stands out of the noise; else everything lies on side 0
    let (mut normal_x, mut normal_z, mut offset) = (zero, zero, one);
    for lane in 0..S::f32s::LEN {
        let least = WindowShrinkage::MIN_GAIN
            * (variance[0][lane] + variance[1][lane] + variance[2][lane])
            * (1.0 / 3.0);
        if found.gain[lane] > least {
            let line = &table.lines[found.event[lane] as usize];
            normal_x[lane] = line.normal[0];
            normal_z[lane] = line.normal[1];
            offset[lane] = line.offset;
        }
    }

    let SideSums {
        positions: positions_0,
        moments: moments_0,
        all: moments_all,
    } = side_sums(
        simd,
        side,
        &batch.pixels,
        [normal_x, normal_z, offset],
        on_0,
    );
    let positions_all = whole_window::<S>(simd, side);
    let positions_1 = Positions {
        n: positions_all.n - positions_0.n,
        x: positions_all.x - positions_0.x,
        z: positions_all.z - positions_0.z,
        xx: positions_all.xx - positions_0.xx,
        xz: positions_all.xz - positions_0.xz,
        zz: positions_all.zz - positions_0.zz,
    };
    for c in 0..CHANNELS {
        let moments_1 = Moments {
            y: moments_all[c].y - moments_0[c].y,
            yy: moments_all[c].yy - moments_0[c].yy,
            xy: moments_all[c].xy - moments_0[c].xy,
            zy: moments_all[c].zy - moments_0[c].zy,
        };
        let shrink = WindowShrinkage::RESIDUAL_SHRINK[c];
        let side_0 = estimate::<S>(simd, &positions_0, &moments_0[c], variance[c], shrink);
        let side_1 = estimate::<S>(simd, &positions_1, &moments_1, variance[c], shrink);
        let sides = [side_0.weighted(mean[c]), side_1.weighted(mean[c])];
        for dz in 0..side {
            let z = dz as f32 - half;
            // from the right, so that a pixel's estimates add up in the order of their windows wherever batches begin
            let rows = [
                sides[0].base + sides[0].slope[1] * z,
                sides[1].base + sides[1].slope[1] * z,
            ];
            for dx in (0..side).rev() {
                let x = dx as f32 - half;
                let at = dz * side + dx;
                let inside = on_0[at].simd_gt(0.5);
                let plane_0 = rows[0] + sides[0].slope[0] * x;
                let plane_1 = rows[1] + sides[1].slope[0] * x;
                let plane = inside.select(plane_0, plane_1);
                let keep = inside.select(sides[0].keep, sides[1].keep);
                let weight = inside.select(sides[0].weight, sides[1].weight);
                let from = strip.run(window, dx, dz);
                let value = plane + keep * batch.pixels[at][c];
                add_to(simd, &mut strip.sums[c][from..], value);
                add_to(simd, &mut strip.weights[c][from..], weight);
            }
        }
    }
}

/// The sums over side 0 of a line, given by its normal and offset, and over the whole window; `on_0` becomes 1 where a pixel is on
/// side 0 and else 0.
#[inline(always)]
fn side_sums<S: Simd>(
    simd: S,
    side: usize,
    pixels: &[[S::f32s; CHANNELS]],
    [normal_x, normal_z, offset]: [S::f32s; 3],
    on_0: &mut [S::f32s],
) -> SideSums<S::f32s> {
    let half = 0.5 * (side as f32 - 1.0);
    let zero = S::f32s::splat(simd, 0.0);
    let one = S::f32s::splat(simd, 1.0);
    let mut moments = [Moments {
        y: zero,
        yy: zero,
        xy: zero,
        zy: zero,
    }; CHANNELS];
    let mut positions = Positions {
        n: zero,
        x: zero,
        z: zero,
        xx: zero,
        xz: zero,
        zz: zero,
    };
    let mut all = moments;
    for (dz, (row, on_0)) in pixels
        .chunks_exact(side)
        .zip(on_0.chunks_exact_mut(side))
        .enumerate()
    {
        let z = dz as f32 - half;
        let limit = offset - normal_z * z;
        // within a row z is constant, so its moments are those of the row's sums
        let mut row_positions = [zero; 3];
        let mut row_y = [[zero; 2]; CHANNELS];
        for (dx, (pixel, on_0)) in row.iter().zip(on_0).enumerate() {
            let x = dx as f32 - half;
            let inside = (normal_x * x).simd_lt(limit).select(one, zero);
            *on_0 = inside;
            row_positions[0] += inside;
            row_positions[1] += inside * x;
            row_positions[2] += inside * (x * x);
            for c in 0..CHANNELS {
                let y = pixel[c];
                let y_0 = inside * y;
                row_y[c][0] += y_0;
                row_y[c][1] += y;
                moments[c].yy += y_0 * y;
                all[c].yy += y * y;
                moments[c].xy += y_0 * x;
                all[c].xy += y * x;
            }
        }
        let [n, x, xx] = row_positions;
        positions.n += n;
        positions.x += x;
        positions.xx += xx;
        positions.z += n * z;
        positions.xz += x * z;
        positions.zz += n * (z * z);
        for c in 0..CHANNELS {
            moments[c].y += row_y[c][0];
            moments[c].zy += row_y[c][0] * z;
            all[c].y += row_y[c][1];
            all[c].zy += row_y[c][1] * z;
        }
    }
    SideSums {
        positions,
        moments,
        all,
    }
}

/// The noise variance of each channel at the brightness of each window.
#[inline(always)]
fn variances<S: Simd>(simd: S, noise: &NoiseLevel, luma: &[f32; MAX_LANES]) -> [S::f32s; CHANNELS] {
    let mut variance = [S::f32s::splat(simd, WindowShrinkage::MIN_VARIANCE); CHANNELS];
    for lane in 0..S::f32s::LEN {
        for (channel, sigma) in variance.iter_mut().zip(noise.sigma_at(luma[lane])) {
            channel[lane] = (sigma * sigma).max(WindowShrinkage::MIN_VARIANCE);
        }
    }
    variance
}

/// The positions of all pixels of a window, from the sums of 1 and of squares.
#[inline(always)]
fn whole_window<S: Simd>(simd: S, side: usize) -> Positions<S::f32s> {
    let n = side as f32;
    // Σ (i − (n−1)/2)² over a row
    let squares = n * (n * n - 1.0) / 12.0;
    Positions {
        n: S::f32s::splat(simd, n * n),
        x: S::f32s::splat(simd, 0.0),
        z: S::f32s::splat(simd, 0.0),
        xx: S::f32s::splat(simd, n * squares),
        xz: S::f32s::splat(simd, 0.0),
        zz: S::f32s::splat(simd, n * squares),
    }
}

#[inline(always)]
fn add_to<S: Simd>(simd: S, sums: &mut [f32], value: S::f32s) {
    let sums = &mut sums[..S::f32s::LEN];
    (S::f32s::from_slice(simd, sums) + value).store_slice(sums);
}

/// Steps 3 to 5 of the module above for one side and channel. An empty side gets no weight.
#[inline(always)]
fn estimate<S: Simd>(
    simd: S,
    positions: &Positions<S::f32s>,
    moments: &Moments<S::f32s>,
    variance: S::f32s,
    residual_shrink: f32,
) -> Estimate<S::f32s> {
    let zero = S::f32s::splat(simd, 0.0);
    let one = S::f32s::splat(simd, 1.0);
    let exists = positions.n.simd_gt(0.5);
    let n = positions.n.max(one);
    let inverse_n = one / n;
    let (center_x, center_z) = (positions.x * inverse_n, positions.z * inverse_n);
    let m = moments.y * inverse_n;

    // slope: M g = b
    let m_xx = positions.xx - positions.x * center_x + WindowShrinkage::SCATTER_FLOOR;
    let m_xz = positions.xz - positions.x * center_z;
    let m_zz = positions.zz - positions.z * center_z + WindowShrinkage::SCATTER_FLOOR;
    let (b_x, b_z) = (
        moments.xy - moments.y * center_x,
        moments.zy - moments.y * center_z,
    );
    let inverse_det = one / (m_xx * m_zz - m_xz * m_xz);
    let g_x = (m_zz * b_x - m_xz * b_z) * inverse_det;
    let g_z = (m_xx * b_z - m_xz * b_x) * inverse_det;
    let plane_energy = (g_x * b_x + g_z * b_z).max(zero);
    let noise_in_plane = variance * WindowShrinkage::SLOPE_SHRINK;
    let r = (one - noise_in_plane / plane_energy.max(noise_in_plane)).max(zero);

    // residual
    let total = (moments.yy - moments.y * m).max(zero);
    let left = (total - plane_energy * (one - (one - r) * (one - r))).max(zero);
    let freedom = (n - 1.0 - r * 2.0).max(one);
    let noise_in_residual = variance * residual_shrink;
    let a = one - noise_in_residual / (left / freedom).max(noise_in_residual);

    let expected = a * variance + (one - a + r * 2.0) * variance * inverse_n;
    let keep_plane = one - a;
    let (slope_x, slope_z) = (keep_plane * r * g_x, keep_plane * r * g_z);
    Estimate {
        base: keep_plane * m - slope_x * center_x - slope_z * center_z,
        slope: [slope_x, slope_z],
        keep: a,
        weight: exists.select(one / expected, zero),
    }
}
