//! Shifts at which a sheet looks like itself.
//!
//! The plain idea: the normalized correlation of the sheet with itself, of known pixels only; its peaks are the periods of
//! what repeats. Light and shade are taken off first.
//!
//! Cost: seven transforms of half as much again as the reduced sheet in each direction.

use super::query::{Prepared, Reduced, best_apart};
use super::{APART_PX, Proposal};
use crate::canvas::{KNOWN, SOURCE};
use crate::sheet::{Sheet, distance_sq};
use glam::IVec2;
use ravec_numeric::{Fourier, Spectrum};
use ravec_raster::{Plane, gaussian_blur};
use rayon::prelude::*;

/// Repetitions need this correlation to count.
const MIN_CORRELATION: f32 = 0.08;
/// And this share of the sheet must be there to be compared.
const MIN_OVERLAP: f32 = 0.08;
/// Shorter offsets are those of the grain.
const MIN_PERIOD_PX: i64 = 6;
/// The standard deviation of the mean that is taken off first, so that light and shade do not count.
const FLAT_SIGMA_PX: f64 = 12.0;

/// Shifts at which the sheet looks like itself: the highest local maxima of its masked normalized autocorrelation.
pub(super) fn periods(sheet: &Sheet, prepared: &Prepared, count: usize) -> Vec<Proposal> {
    let reduced = &prepared.reduced;
    let (width, height) = (reduced.width, reduced.height);
    let known = |index: usize| f32::from(reduced.states[index] & KNOWN != 0);
    let flat = flattened(reduced, &known);
    // half as much again as the sheet: shifts of up to half of it do not wrap onto one another
    let fourier = Fourier::new(width + width / 2, height + height / 2);
    let padded = |value: &dyn Fn(usize) -> f32| {
        let mut rows = vec![0.0; fourier.width() * height];
        for (row, line) in rows.chunks_exact_mut(fourier.width()).enumerate() {
            for (col, out) in line[..width].iter_mut().enumerate() {
                *out = value(row * width + col);
            }
        }
        fourier.forward(rows)
    };
    let values = padded(&|index| flat[index]);
    let squares = padded(&|index| flat[index] * flat[index]);
    let mask = padded(&known);
    let correlate = |a: &Spectrum, b: &Spectrum| {
        let mut sum = fourier.zero();
        sum.add_correlation(a, b, 1.0);
        fourier.inverse(sum)
    };
    let (products, overlap) = (correlate(&values, &values), correlate(&mask, &mask));
    let (here, there) = (correlate(&squares, &mask), correlate(&mask, &squares));
    let total = overlap[0].max(1.0);
    let (fw, fh) = (fourier.width(), fourier.height());
    let scores: Vec<f32> = (0..fw * fh)
        .map(|index| {
            let (col, row) = ((index % fw) as i32, (index / fw) as i32);
            let x = if col > fw as i32 / 2 {
                col - fw as i32
            } else {
                col
            };
            let y = if row > fh as i32 / 2 {
                row - fh as i32
            } else {
                row
            };
            let far = 2 * x.abs() > width as i32 || 2 * y.abs() > height as i32;
            // of sides beyond 46 340 pixels the squares exceed 32 bits
            let step = (reduced.factor * IVec2::new(x, y)).as_i64vec2();
            if far
                || overlap[index] < MIN_OVERLAP * total
                || step.length_squared() < MIN_PERIOD_PX * MIN_PERIOD_PX
            {
                return f32::INFINITY;
            }
            let norm = (here[index].max(0.0) * there[index].max(0.0)).sqrt();
            let correlation = products[index] / (norm + 1e-6 * total);
            if correlation > MIN_CORRELATION {
                -correlation
            } else {
                f32::INFINITY
            }
        })
        .collect();
    let limit = IVec2::new(width as i32, height as i32);
    let apart = (APART_PX / reduced.factor).max(1);
    let peaks = best_apart(&scores, fw, fh, count, apart, IVec2::ZERO, limit);
    let mut pixels: Vec<u32> = (0..sheet.inks.len() as u32)
        .filter(|&i| sheet.is(i as usize, KNOWN | SOURCE))
        .collect();
    // a stride without a common factor with the width, so that all columns are seen
    let step = (pixels.len() / 3000).max(1) | 1;
    pixels = pixels.into_iter().step_by(step).collect();
    peaks
        .par_iter()
        .filter_map(|&(offset, score)| {
            let reach = reduced.factor;
            let side = 2 * reach + 1;
            let best = (0..side * side)
                .filter_map(|k| {
                    let offset = offset * reduced.factor + IVec2::new(k % side, k / side) - reach;
                    overlapping(sheet, &pixels, offset).map(|score| (offset, score))
                })
                .min_by(|a, b| a.1.total_cmp(&b.1))?;
            Some(Proposal {
                offset: best.0,
                score,
            })
        })
        .collect()
}

/// The luminance without its mean over the surroundings, 0 where unknown.
fn flattened(reduced: &Reduced, known: &dyn Fn(usize) -> f32) -> Vec<f32> {
    let (width, height) = (reduced.width, reduced.height);
    let luminance = |index: usize| {
        let c = &reduced.channels;
        0.299 * c[0][index] + 0.587 * c[1][index] + 0.114 * c[2][index]
    };
    let plane = |value: &dyn Fn(usize) -> f32| {
        Plane::from_vec(width, (0..width * height).map(value).collect())
            .expect("whole rows of a sheet")
    };
    let sigma = FLAT_SIGMA_PX / f64::from(reduced.factor);
    let shares = gaussian_blur(&plane(known), sigma);
    let sums = gaussian_blur(&plane(&|index| known(index) * luminance(index)), sigma);
    (0..width * height)
        .map(|index| {
            if known(index) > 0.0 {
                luminance(index) - sums.pixels()[index] / shares.pixels()[index].max(1e-6)
            } else {
                0.0
            }
        })
        .collect()
}

/// As [`mismatch`], for offsets at which only some of the pixels have a partner.
fn overlapping(sheet: &Sheet, pixels: &[u32], offset: IVec2) -> Option<f32> {
    let (mut sum, mut count) = (0.0f32, 0u32);
    for &index in pixels {
        if let Some(other) = sheet.shifted(index as usize, offset)
            && sheet.is(other, KNOWN)
        {
            count += 1;
            sum += distance_sq(&sheet.features[index as usize], &sheet.features[other]);
        }
    }
    (count > 0).then(|| sum / count as f32)
}
