//! The mismatch of a fragment at one place, summed directly.
//!
//! The plain idea: for each pixel of the fragment the weighted squared differences of all values, as
//! [`super::template`] defines them. Departures: whole vectors of a row at a time; every other row first, so that a bad
//! place shows after half of the work; an end as soon as the sum exceeds what is good enough.
//!
//! Guarantees: the same bits on machines with vectors of any width, as sums run in eight lanes that are added in one order.

use super::level::{GRADIENT_WEIGHT, Level};
use super::template::{LANES, Template};
use fearless_simd::{Level as Vectors, Simd, dispatch};
use glam::IVec2;

/// Rows that are summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rows {
    /// All, the even ones first.
    All,
    /// The even ones, and twice their sum: half of the work, which distinguishes places of large fragments nearly as
    /// well.
    EvenTwice,
}

/// The weighted sum of squared differences with the template's corner at a valid position; infinity as soon as it must
/// exceed `bound`.
pub(super) fn mismatch(
    vectors: Vectors,
    template: &Template,
    level: &Level,
    corner: IVec2,
    rows: Rows,
    bound: f32,
) -> f32 {
    dispatch!(vectors, simd => mismatch_with(simd, template, level, corner, rows, bound))
}

#[inline(always)]
fn mismatch_with<S: Simd>(
    _simd: S,
    template: &Template,
    level: &Level,
    corner: IVec2,
    rows: Rows,
    bound: f32,
) -> f32 {
    let (odd, factor) = match rows {
        Rows::All => (1..template.height, 1.0),
        Rows::EvenTwice => (1..1, 2.0),
    };
    let values = template.channels.values();
    let stride = level.width + 2;
    let mut total = 0.0f32;
    for row in (0..template.height).step_by(2).chain(odd.step_by(2)) {
        let (from, to) = template.weighted[row];
        if to == 0 {
            continue;
        }
        let y = (corner.y + row as i32) as usize;
        let x = (corner.x + from as i32) as usize;
        let count = (to - from).next_multiple_of(LANES);
        let start = row * template.stride + from;
        let own = |plane: usize| vectors_of(&template.values[plane], start, count);
        let weights = |kind: usize| vectors_of(&template.weights[kind], start, count);
        let luma = |at: usize| vectors_of(&level.luma, at, count);
        let other = |plane: usize| vectors_of(&level.planes[plane - 1], y * level.width + x, count);
        let at = level.luma_index(x, y);
        let mut sums = [0.0f32; LANES];
        {
            let (w, g) = (weights(0), weights(1));
            let (t0, t1, t2) = (own(0), own(1), own(2));
            let (tx, ty) = (own(values), own(values + 1));
            let (s0, s1, s2) = (luma(at), other(1), other(2));
            let (left, right) = (luma(at - 1), luma(at + 1));
            let (up, down) = (luma(at - stride), luma(at + stride));
            for i in 0..w.len() {
                for k in 0..LANES {
                    let d0 = t0[i][k] - s0[i][k];
                    let d1 = t1[i][k] - s1[i][k];
                    let d2 = t2[i][k] - s2[i][k];
                    let dx = tx[i][k] - GRADIENT_WEIGHT * (right[i][k] - left[i][k]);
                    let dy = ty[i][k] - GRADIENT_WEIGHT * (down[i][k] - up[i][k]);
                    sums[k] +=
                        w[i][k] * (d0 * d0 + d1 * d1 + d2 * d2) + g[i][k] * (dx * dx + dy * dy);
                }
            }
        }
        for plane in 3..values {
            let (w, t, s) = (weights(template.weight_of(plane)), own(plane), other(plane));
            for i in 0..w.len() {
                for k in 0..LANES {
                    let d = t[i][k] - s[i][k];
                    sums[k] += w[i][k] * d * d;
                }
            }
        }
        total += ((sums[0] + sums[1]) + (sums[2] + sums[3]))
            + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
        if factor * total > bound {
            return f32::INFINITY;
        }
    }
    factor * total
}

/// `count` numbers from `start`, in whole vectors.
#[inline(always)]
fn vectors_of(plane: &[f32], start: usize, count: usize) -> &[[f32; LANES]] {
    plane[start..start + count].as_chunks::<LANES>().0
}
