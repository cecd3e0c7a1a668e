//! Planes at half the size, on which everything smooth is computed: sums of neighborhoods and their spread into places without
//! data.

use fearless_simd::{Level as Vectors, Simd, dispatch};
use ravec_raster::{Plane, Size, gaussian_blur};
use rayon::prelude::*;

/// Planes at half the size, each value the average of four. `fill(row, lines)` writes a row of each at full size, so that nothing
/// at full size needs to be stored.
pub(crate) fn halved_of<const N: usize>(
    size: Size,
    fill: impl Fn(usize, &mut [Vec<f32>; N]) + Sync,
) -> [Plane; N] {
    let (width, last) = (size.width(), size.height() - 1);
    let half = size.cells(2);
    let mut planes = [(); N].map(|()| Plane::new(half, 0.0));
    let lines = || [(); N].map(|()| vec![0.0f32; width]);
    rows_of(&mut planes)
        .into_par_iter()
        .enumerate()
        .for_each_init(
            || (lines(), lines()),
            |(upper, lower), (row, outputs)| {
                fill(2 * row, upper);
                // an odd last row or column stands twice, which leaves its mean as it is
                fill((2 * row + 1).min(last), lower);
                for ((out, upper), lower) in outputs.into_iter().zip(upper).zip(lower) {
                    dispatch!(Vectors::new(), simd => average_of_four(simd, upper, lower, out));
                }
            },
        );
    planes
}

#[inline(always)]
fn average_of_four<S: Simd>(_simd: S, upper: &mut [f32], lower: &[f32], out: &mut [f32]) {
    for (upper, lower) in upper.iter_mut().zip(lower) {
        *upper += lower;
    }
    let (pairs, rest) = upper.as_chunks::<2>();
    for (out, [left, right]) in out.iter_mut().zip(pairs) {
        *out = 0.25 * (left + right);
    }
    if let ([last], Some(out)) = (rest, out.last_mut()) {
        *out = 0.5 * last;
    }
}

/// The rows of planes of the same size: for each row, one slice of each plane.
pub(crate) fn rows_of<const N: usize>(planes: &mut [Plane; N]) -> Vec<[&mut [f32]; N]> {
    let [height, width] = match planes.first() {
        Some(plane) => [plane.height(), plane.width()],
        None => [0, 1],
    };
    let mut rest = planes.each_mut().map(Plane::pixels_mut);
    (0..height)
        .map(|_| {
            rest.each_mut().map(|rest| {
                let (row, after) = std::mem::take(rest).split_at_mut(width);
                *rest = after;
                row
            })
        })
        .collect()
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
    let [coarse_weight] = halved_of(size, |row, [line]| line.copy_from_slice(weight.row(row)));
    let coarse = halved_of(size, |row, lines: &mut [Vec<f32>; N]| {
        for (line, plane) in lines.iter_mut().zip(&sums) {
            line.copy_from_slice(plane.row(row));
        }
    });
    let coarse = pull_up(&coarse_weight, coarse, pull);
    rows_of(&mut sums)
        .into_par_iter()
        .enumerate()
        .for_each_init(
            || (Vec::new(), vec![0.0; size.width()]),
            |(scratch, below), (row, sums)| {
                let weight = weight.row(row);
                for (sums, coarse) in sums.into_iter().zip(&coarse) {
                    doubled_row(coarse, row, scratch, below);
                    dispatch!(Vectors::new(), simd => averaged(simd, sums, weight, below, pull));
                }
            },
        );
    sums
}

/// Averages of a row of sums, with `pull` of those below it.
#[inline(always)]
fn averaged<S: Simd>(_simd: S, sums: &mut [f32], weight: &[f32], below: &[f32], pull: f32) {
    for ((out, weight), below) in sums.iter_mut().zip(weight).zip(below) {
        *out = (*out + pull * below) / (weight + pull);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{Reduction, halved};

    fn halve(plane: &Plane) -> Plane {
        let [half] = halved_of(plane.size(), |row, [line]| {
            line.copy_from_slice(plane.row(row));
        });
        half
    }

    #[test]
    fn halves_are_averages_of_four() {
        for (width, height) in [(1, 1), (1, 4), (7, 5), (20, 9), (33, 2)] {
            let size = Size::new(width, height).unwrap();
            let plane = Plane::from_fn(size, |col, row| ((7 * col + 3 * row) % 11) as f32);
            let half = halve(&plane);
            assert_eq!(half, halved(&plane, Reduction::Area), "{width} × {height}");
        }
    }

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
