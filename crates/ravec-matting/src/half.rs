//! Planes at half the size, on which everything smooth is computed: sums of neighborhoods and their spread into places without
//! data.

use fearless_simd::{Level as Vectors, Simd, dispatch};
use ravec_raster::{Plane, Reduction, Size, gaussian_blur, halved};
use rayon::prelude::*;

/// A plane at half the size, each value the average of four.
pub(crate) fn halve(plane: &Plane) -> Plane {
    halved(plane, Reduction::Area)
}

/// Value at full size of a row of a plane at half the size, linear between its pixels. `out` has one value for each column of the
/// full size.
pub(crate) fn doubled_row(half: &Plane, row: usize, scratch: &mut Vec<f32>, out: &mut [f32]) {
    dispatch!(Vectors::new(), simd => doubled_row_on(simd, half, row, scratch, out));
}

#[inline(always)]
fn doubled_row_on<S: Simd>(
    _simd: S,
    half: &Plane,
    row: usize,
    scratch: &mut Vec<f32>,
    out: &mut [f32],
) {
    let last = half.height() - 1;
    let near = (row / 2).min(last);
    let far = if row.is_multiple_of(2) {
        near.saturating_sub(1)
    } else {
        (near + 1).min(last)
    };
    scratch.clear();
    scratch.extend(
        half.row(near)
            .iter()
            .zip(half.row(far))
            .map(|(near, far)| 0.75 * near + 0.25 * far),
    );
    let end = scratch.len() - 1;
    let near = |at: usize| 0.75 * scratch[at];
    // between the ends, without a condition for each pixel
    if out.len() >= 4 {
        let inner = (out.len() / 2).min(end);
        for (pair, window) in out[2..2 * inner]
            .as_chunks_mut()
            .0
            .iter_mut()
            .zip(scratch.windows(3))
        {
            let [before, here, after] = [window[0], window[1], window[2]];
            *pair = [0.75 * here + 0.25 * before, 0.75 * here + 0.25 * after];
        }
    }
    let ends = [0, out.len().saturating_sub(1) / 2, (out.len() / 2).min(end)];
    for col in ends {
        let at = col.min(end);
        let (before, after) = (scratch[at.saturating_sub(1)], scratch[(at + 1).min(end)]);
        if let Some(first) = out.get_mut(2 * col) {
            *first = near(at) + 0.25 * before;
        }
        if let Some(second) = out.get_mut(2 * col + 1) {
            *second = near(at) + 0.25 * after;
        }
    }
}

/// A plane of the given size from one at half of it.
pub(crate) fn doubled(half: &Plane, size: Size) -> Plane {
    let mut full = Plane::new(size, 0.0);
    full.par_rows_mut()
        .enumerate()
        .for_each_init(Vec::new, |scratch, (row, out)| {
            doubled_row(half, row, scratch, out);
        });
    full
}

/// Averages of `sums` where `weight` has been collected; `sums` are values times weight. Each is smoothed with `sigma_px`, and places
/// without weight take what coarser levels say (push and pull: Gortler et al., *The Lumigraph*, 1996). `pull` is the weight
/// that the coarser level has everywhere.
pub(crate) fn spread<const N: usize>(
    weight: &Plane,
    sums: [Plane; N],
    sigma_px: f64,
    pull: f32,
) -> [Plane; N] {
    let smooth = |plane: &Plane| {
        if sigma_px > 0.0 {
            gaussian_blur(plane, sigma_px)
        } else {
            plane.clone()
        }
    };
    let weight = smooth(weight);
    let sums = sums.map(|plane| smooth(&plane));
    pull_up(&weight, sums, pull)
}

fn pull_up<const N: usize>(weight: &Plane, mut sums: [Plane; N], pull: f32) -> [Plane; N] {
    let size = weight.size();
    if size.width() <= 2 && size.height() <= 2 {
        let total: f64 = weight.pixels().iter().map(|w| f64::from(*w)).sum();
        for plane in &mut sums {
            let sum: f64 = plane.pixels().iter().map(|value| f64::from(*value)).sum();
            let mean = if total > 0.0 {
                (sum / total) as f32
            } else {
                0.0
            };
            plane.pixels_mut().fill(mean);
        }
        return sums;
    }
    let coarse_weight = halve(weight);
    let coarse = sums.each_ref().map(halve);
    let coarse = pull_up(&coarse_weight, coarse, pull);
    for (plane, coarse) in sums.iter_mut().zip(&coarse) {
        plane
            .par_rows_mut()
            .zip(weight.par_rows())
            .enumerate()
            .for_each_init(
                || (Vec::new(), vec![0.0; size.width()]),
                |(scratch, below), (row, (out, weight))| {
                    doubled_row(coarse, row, scratch, below);
                    for ((out, weight), below) in out.iter_mut().zip(weight).zip(&*below) {
                        *out = (*out + pull * below) / (weight + pull);
                    }
                },
            );
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_stays_and_fills_everything() {
        let size = Size::new(37, 21).unwrap();
        let weight = Plane::from_fn(
            size,
            |col, row| if col == 5 && row == 3 { 1.0 } else { 0.0 },
        );
        let sums = [weight.map(|w| 7.0 * w)];
        let [filled] = spread(&weight, sums, 1.5, 1e-3);
        assert!(
            filled
                .pixels()
                .iter()
                .all(|value| (value - 7.0).abs() < 1e-3)
        );
    }

    #[test]
    fn rows_of_any_width_are_doubled_as_defined() {
        for width in 1..24 {
            let half = halve(&Plane::from_fn(Size::new(width, 6).unwrap(), |col, row| {
                ((7 * col + 3 * row) % 11) as f32
            }));
            for row in 0..6 {
                let mut out = vec![f32::NAN; width];
                doubled_row(&half, row, &mut Vec::new(), &mut out);
                let last = [half.width() - 1, half.height() - 1];
                let beside = |at: usize, last: usize| {
                    let near = (at / 2).min(last);
                    let far = if at.is_multiple_of(2) {
                        near.saturating_sub(1)
                    } else {
                        (near + 1).min(last)
                    };
                    [near, far]
                };
                let [near, far] = beside(row, last[1]);
                let line = |col: usize| 0.75 * half[(col, near)] + 0.25 * half[(col, far)];
                for (col, found) in out.iter().enumerate() {
                    let [near, far] = beside(col, last[0]);
                    let expected = 0.75 * line(near) + 0.25 * line(far);
                    assert!((found - expected).abs() < 1e-5, "{col} of {width}");
                }
            }
        }
    }

    #[test]
    fn linear_planes_double_to_linear_planes() {
        let full = Plane::from_fn(Size::new(16, 12).unwrap(), |col, row| {
            col as f32 + 10.0 * row as f32
        });
        let back = doubled(&halve(&full), full.size());
        for row in 1..11 {
            for col in 1..15 {
                assert!((back[(col, row)] - full[(col, row)]).abs() < 1e-4);
            }
        }
    }
}
