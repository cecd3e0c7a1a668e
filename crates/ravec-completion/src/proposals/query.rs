//! Queries to a reduced sheet: the fit of a weighted window at all shifts.
//!
//! Cost: a dozen transforms of the reduced sheet to prepare it, ten for each query.

use crate::canvas::{HOLE, KNOWN, SOURCE, STEADY};
use crate::sheet::{Feature, Sheet};
use glam::IVec2;
use ravec_numeric::{Fourier, Spectrum};
use rayon::prelude::*;

/// A sheet reduced by a power of two.
pub(super) struct Reduced {
    pub(super) factor: i32,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Channels first: ink and gradients, 0 where unknown.
    pub(super) channels: [Vec<f32>; CHANNELS],
    pub(super) states: Vec<u8>,
}

pub(super) const CHANNELS: usize = 6;
/// Channels that are colors; the rest are gradients.
pub(super) const COLORS: usize = 4;

impl Reduced {
    pub(super) fn new(sheet: &Sheet, factor: usize) -> Self {
        let (width, height) = (sheet.width.div_ceil(factor), sheet.height.div_ceil(factor));
        let cells: Vec<(Feature, u8)> = (0..width * height)
            .into_par_iter()
            .with_min_len(1024)
            .map(|cell| {
                let (col, row) = (cell % width * factor, cell / width * factor);
                let (mut sum, mut all, mut any, mut known) = ([0.0f32; 8], u8::MAX, 0u8, 0.0f32);
                for y in row..(row + factor).min(sheet.height) {
                    for x in col..(col + factor).min(sheet.width) {
                        let index = y * sheet.width + x;
                        all &= sheet.states[index];
                        any |= sheet.states[index];
                        if sheet.is(index, KNOWN) {
                            known += 1.0;
                            for (sum, value) in sum.iter_mut().zip(&sheet.features[index]) {
                                *sum += value;
                            }
                        }
                    }
                }
                let scale = if known > 0.0 { 1.0 / known } else { 0.0 };
                (
                    sum.map(|value| value * scale),
                    all & (KNOWN | SOURCE | STEADY) | any & HOLE,
                )
            })
            .collect();
        Self {
            factor: factor as i32,
            width,
            height,
            channels: std::array::from_fn(|channel| {
                cells.iter().map(|(f, _)| f[channel]).collect()
            }),
            states: cells.iter().map(|&(_, state)| state).collect(),
        }
    }

    pub(super) fn weight(&self, col: i32, row: i32, bits: u8) -> f32 {
        if col < 0 || row < 0 || col >= self.width as i32 || row >= self.height as i32 {
            return 0.0;
        }
        f32::from(self.states[row as usize * self.width + col as usize] & bits == bits)
    }
}

/// The spectra of a reduced sheet that every query needs.
pub(super) struct Prepared {
    pub(super) reduced: Reduced,
    pub(super) fourier: Fourier,
    /// Source pixels.
    pub(super) source: Spectrum,
    /// Channels, 0 where there is no source.
    pub(super) channels: [Spectrum; CHANNELS],
    /// Squared colors, squared gradients.
    pub(super) energies: [Spectrum; 2],
    /// Offset subtracted from each channel first, so that squares do not drown differences in rounding.
    pub(super) means: [f32; CHANNELS],
}

impl Prepared {
    /// Transforms that are by `margins` wider and higher than the sheet, as much as the largest window is.
    pub(super) fn new(reduced: Reduced, margins: [usize; 2]) -> Self {
        let fourier = Fourier::new(reduced.width + margins[0], reduced.height + margins[1]);
        let padded = |value: &(dyn Fn(usize) -> f32 + Sync)| {
            let mut rows = vec![0.0; fourier.width() * reduced.height];
            for (row, line) in rows.chunks_exact_mut(fourier.width()).enumerate() {
                for (col, out) in line[..reduced.width].iter_mut().enumerate() {
                    let index = row * reduced.width + col;
                    if reduced.states[index] & SOURCE != 0 {
                        *out = value(index);
                    }
                }
            }
            fourier.forward(rows)
        };
        let count = reduced
            .states
            .iter()
            .filter(|&&s| s & SOURCE != 0)
            .count()
            .max(1);
        let means: [f32; CHANNELS] = std::array::from_fn(|channel| {
            let sum: f64 = reduced.channels[channel]
                .iter()
                .zip(&reduced.states)
                .filter(|(_, state)| **state & SOURCE != 0)
                .map(|(&value, _)| f64::from(value))
                .sum();
            (sum / count as f64) as f32
        });
        let energy = |from: usize, to: usize| {
            padded(&|index| {
                (from..to)
                    .map(|channel| (reduced.channels[channel][index] - means[channel]).powi(2))
                    .sum()
            })
        };
        let source = padded(&|_| 1.0);
        let channels = std::array::from_fn(|channel| {
            padded(&|index| reduced.channels[channel][index] - means[channel])
        });
        let energies = [energy(0, COLORS), energy(COLORS, CHANNELS)];
        Self {
            reduced,
            fourier,
            source,
            channels,
            energies,
            means,
        }
    }

    /// The transform of a window of the reduced sheet that begins at `corner`.
    fn template(&self, corner: IVec2, size: IVec2, value: impl Fn(i32, i32) -> f32) -> Spectrum {
        let width = self.fourier.width();
        let mut rows = vec![0.0; width * size.y as usize];
        for (dy, line) in rows.chunks_exact_mut(width).enumerate() {
            for (dx, out) in line[..size.x as usize].iter_mut().enumerate() {
                *out = value(corner.x + dx as i32, corner.y + dy as i32);
            }
        }
        self.fourier.forward(rows)
    }

    /// The channel of a pixel, less its mean.
    fn channel(&self, channel: usize, col: i32, row: i32) -> f32 {
        self.reduced.channels[channel][row as usize * self.reduced.width + col as usize]
            - self.means[channel]
    }

    /// The mean squared difference of the weighted window to the sheet at all shifts, with the share of the weight that is
    /// compared and the share of `needed` that is source there.
    pub(super) fn mismatch(
        &self,
        corner: IVec2,
        size: IVec2,
        weight: &dyn Fn(i32, i32) -> f32,
        needed: &dyn Fn(i32, i32) -> f32,
    ) -> Map {
        let steady = |x: i32, y: i32| weight(x, y) * self.reduced.weight(x, y, STEADY);
        let weights = |channel: usize, x: i32, y: i32| {
            if channel < COLORS {
                weight(x, y)
            } else {
                steady(x, y)
            }
        };
        let of_sheet = |channel: usize, x: i32, y: i32| {
            let w = weights(channel, x, y);
            if w > 0.0 {
                w * self.channel(channel, x, y)
            } else {
                0.0
            }
        };
        let mut sum = self.fourier.zero();
        let own = self.template(corner, size, |x, y| {
            (0..CHANNELS)
                .map(|channel| {
                    let w = weights(channel, x, y);
                    if w > 0.0 {
                        w * self.channel(channel, x, y).powi(2)
                    } else {
                        0.0
                    }
                })
                .sum()
        });
        sum.add_correlation(&own, &self.source, 1.0);
        let plain = self.template(corner, size, weight);
        sum.add_correlation(&plain, &self.energies[0], 1.0);
        let gradients = self.template(corner, size, steady);
        sum.add_correlation(&gradients, &self.energies[1], 1.0);
        for channel in 0..CHANNELS {
            let values = self.template(corner, size, |x, y| of_sheet(channel, x, y));
            sum.add_correlation(&values, &self.channels[channel], -2.0);
        }
        let mut compared = self.fourier.zero();
        compared.add_correlation(&plain, &self.source, 1.0);
        let mut covered = self.fourier.zero();
        let need = self.template(corner, size, needed);
        covered.add_correlation(&need, &self.source, 1.0);
        let total = |f: &dyn Fn(i32, i32) -> f32| -> f32 {
            (0..size.x * size.y)
                .map(|i| f(corner.x + i % size.x, corner.y + i / size.x))
                .sum::<f32>()
                .max(1e-6)
        };
        Map {
            width: self.fourier.width(),
            height: self.fourier.height(),
            mismatch: self.fourier.inverse(sum),
            compared: self.fourier.inverse(compared),
            covered: self.fourier.inverse(covered),
            weight: total(weight),
            need: total(needed),
        }
    }
}

/// The outcome of a query at all shifts.
pub(super) struct Map {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) mismatch: Vec<f32>,
    pub(super) compared: Vec<f32>,
    pub(super) covered: Vec<f32>,
    pub(super) weight: f32,
    pub(super) need: f32,
}

impl Map {
    /// The best shifts (positions of the window's corner on the sheet, cyclic), apart from one another.
    pub(super) fn minima(
        &self,
        count: usize,
        apart: i32,
        compared: f32,
        covered: f32,
        corner: IVec2,
        limit: IVec2,
    ) -> Vec<(IVec2, f32)> {
        let score = |index: usize| {
            let share = self.compared[index] / self.weight;
            if share < compared || self.covered[index] / self.need < covered {
                f32::INFINITY
            } else {
                self.mismatch[index] / self.compared[index]
            }
        };
        let scores: Vec<f32> = (0..self.mismatch.len())
            .into_par_iter()
            .with_min_len(4096)
            .map(score)
            .collect();
        best_apart(
            &scores,
            self.width,
            self.height,
            count,
            apart,
            corner,
            limit,
        )
    }
}

/// The `count` smallest local minima of a cyclic map that keep apart, as offsets from `corner`.
pub(super) fn best_apart(
    scores: &[f32],
    width: usize,
    height: usize,
    count: usize,
    apart: i32,
    corner: IVec2,
    limit: IVec2,
) -> Vec<(IVec2, f32)> {
    let mut minima: Vec<(f32, u32)> = (0..scores.len())
        .into_par_iter()
        .with_min_len(4096)
        .filter(|&index| {
            let value = scores[index];
            if !value.is_finite() {
                return false;
            }
            let (col, row) = (index % width, index / width);
            (0..9).all(|k| {
                let (x, y) = (
                    (col + width + k % 3 - 1) % width,
                    (row + height + k / 3 - 1) % height,
                );
                let other = scores[y * width + x];
                value < other || value == other && index <= y * width + x || other.is_nan()
            })
        })
        .map(|index| (scores[index], index as u32))
        .collect();
    minima.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut chosen: Vec<(IVec2, f32)> = Vec::new();
    for (score, index) in minima {
        if chosen.len() >= count {
            break;
        }
        let mut at = IVec2::new(
            (index as usize % width) as i32,
            (index as usize / width) as i32,
        );
        // shifts beyond the largest are those to the left and above
        let wrap = |value: i32, limit: i32, len: usize| {
            if value > limit {
                value - len as i32
            } else {
                value
            }
        };
        at = IVec2::new(wrap(at.x, limit.x, width), wrap(at.y, limit.y, height)) - corner;
        let near = |other: &(IVec2, f32)| (other.0 - at).abs().max_element() <= apart;
        if at != IVec2::ZERO && !chosen.iter().any(near) {
            chosen.push((at, score));
        }
    }
    chosen
}
