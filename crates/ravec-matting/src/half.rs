//! Planes at half the size, on which everything smooth is computed: sums of neighborhoods and their spread into places without
//! data.

use ravec_raster::{Plane, Reduction, Size, gaussian_blur, halved};
use rayon::prelude::*;

/// A plane at half the size, each value the average of four.
pub(crate) fn halve(plane: &Plane) -> Plane {
    halved(plane, Reduction::Area)
}

/// Value at full size of a row of a plane at half the size, linear between its pixels. `out` has one value for each column of the
/// full size.
pub(crate) fn doubled_row(half: &Plane, row: usize, scratch: &mut Vec<f32>, out: &mut [f32]) {
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
    for (col, pair) in out.chunks_mut(2).enumerate() {
        let col = col.min(end);
        let (before, after) = (scratch[col.saturating_sub(1)], scratch[(col + 1).min(end)]);
        pair[0] = 0.75 * scratch[col] + 0.25 * before;
        if let Some(second) = pair.get_mut(1) {
            *second = 0.75 * scratch[col] + 0.25 * after;
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
