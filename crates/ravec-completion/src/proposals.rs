//! Offsets worth trying: from where, relative to a hole, might its content be copied?
//!
//! Three sources. *Rings*: the known pixels around the whole hole are laid over the sheet at all shifts; what fits is a
//! place where the whole surroundings look alike. *Discs*: the same for small discs on the rim, for pictures in which
//! nothing repeats as a whole. *Periods*: shifts at which the sheet looks like itself; on walls and floors they are what
//! counts.
//!
//! All of them are correlations, computed by Fourier transforms on a reduced sheet and refined by direct sums on the full
//! one.
//!
//! Cost: a dozen transforms for the ring, eight for each disc, six for the periods, all of the reduced sheet.

use crate::canvas::{HOLE, KNOWN, SOURCE, STEADY};
use crate::fourier::{Fourier, Spectrum};
use crate::sheet::{Feature, Sheet, distance_sq};
use glam::IVec2;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// A shift from a pixel of the hole to its source, with how well it fits where it was found: smaller is better.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Proposal {
    pub(crate) offset: IVec2,
    pub(crate) score: f32,
}

/// What was found.
#[derive(Debug, Default)]
pub(crate) struct Proposals {
    pub(crate) ring: Vec<Proposal>,
    pub(crate) discs: Vec<Proposal>,
    pub(crate) periods: Vec<Proposal>,
}

/// Places where the whole surroundings of a hole fit best.
const RING_MINIMA: usize = 20;
/// Discs on the rim, and the best places of each.
const DISCS: usize = 16;
const DISC_MINIMA: usize = 4;
/// Highest peaks of the autocorrelation.
const PERIODS: usize = 12;
/// The known ring around a hole is this wide: enough to see a pattern, not enough to see past it.
const RING_PX: i32 = 8;
/// Most pixels of a ring that direct sums look at.
const RING_SAMPLES: usize = 1500;
/// Offsets this near to a better one are left out.
const APART_PX: i32 = 3;
/// Reduced sheets have at most this many pixels, if the hole is large enough to survive.
const MAX_PIXELS: usize = 160_000;

/// A sheet reduced by a power of two.
struct Reduced {
    factor: i32,
    width: usize,
    height: usize,
    /// Channels first: ink and gradients, 0 where unknown.
    channels: [Vec<f32>; CHANNELS],
    states: Vec<u8>,
}

const CHANNELS: usize = 6;
/// Channels that are colors; the rest are gradients.
const COLORS: usize = 4;

impl Reduced {
    fn new(sheet: &Sheet, factor: usize) -> Self {
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

    fn weight(&self, col: i32, row: i32, bits: u8) -> f32 {
        if col < 0 || row < 0 || col >= self.width as i32 || row >= self.height as i32 {
            return 0.0;
        }
        f32::from(self.states[row as usize * self.width + col as usize] & bits == bits)
    }
}

/// The spectra of a reduced sheet that every query needs.
struct Prepared {
    reduced: Reduced,
    fourier: Fourier,
    /// Source pixels.
    source: Spectrum,
    /// Channels, 0 where there is no source.
    channels: [Spectrum; CHANNELS],
    /// Squared colors, squared gradients.
    energies: [Spectrum; 2],
    /// What is taken off each channel first, so that squares do not drown differences in rounding.
    means: [f32; CHANNELS],
}

impl Prepared {
    fn new(reduced: Reduced, margin: usize) -> Self {
        let fourier = Fourier::new(reduced.width + margin, reduced.height + margin);
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
    fn mismatch(
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
struct Map {
    width: usize,
    height: usize,
    mismatch: Vec<f32>,
    compared: Vec<f32>,
    covered: Vec<f32>,
    weight: f32,
    need: f32,
}

impl Map {
    /// The best shifts (positions of the window's corner on the sheet, cyclic), apart from one another.
    fn minima(
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
fn best_apart(
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

/// Looks for offsets around the hole of a sheet.
pub(crate) fn propose(sheet: &Sheet, progress: &Progress) -> Result<Proposals, Cancelled> {
    let mut found = Proposals::default();
    let Some((low, high)) = bounds(sheet) else {
        return Ok(found);
    };
    let short = (high - low).min_element() + 1;
    let mut factor = 1;
    while sheet.inks.len() / (factor * factor) > MAX_PIXELS && short as usize / factor >= 24 {
        factor *= 2;
    }
    progress.check()?;
    let reduced = Reduced::new(sheet, factor);
    let f = factor as i32;
    let ring = (RING_PX / f).max(3);
    let corner = (low / f - ring).max(IVec2::ZERO);
    let far = (high / f + ring).min(IVec2::new(reduced.width as i32, reduced.height as i32) - 1);
    let size = far - corner + 1;
    let prepared = Prepared::new(reduced, size.max_element() as usize);
    let reduced = &prepared.reduced;
    progress.check()?;

    let apart = (APART_PX / f).max(1);
    let limit = IVec2::new(reduced.width as i32, reduced.height as i32);
    {
        let map = prepared.mismatch(
            corner,
            size,
            &|x, y| reduced.weight(x, y, KNOWN),
            &|x, y| reduced.weight(x, y, HOLE),
        );
        let offsets = map.minima(RING_MINIMA, apart, 0.6, 0.4, corner, limit);
        let pixels = around(sheet, RING_SAMPLES);
        found.ring = refine(sheet, &offsets, f, &pixels);
    }
    progress.check()?;
    {
        let radius = ((high - low).max_element() / 5).clamp(8, 20);
        for middle in rim_points(sheet, DISCS, radius) {
            progress.check()?;
            let r = (radius / f).max(3);
            let middle_reduced = middle / f;
            let corner = middle_reduced - r;
            let size = IVec2::splat(2 * r + 1);
            let in_disc = |x: i32, y: i32| {
                let d = IVec2::new(x, y) - middle_reduced;
                d.length_squared() <= r * r
            };
            let weight = |x: i32, y: i32| {
                if in_disc(x, y) {
                    reduced.weight(x, y, KNOWN)
                } else {
                    0.0
                }
            };
            let needed = |x: i32, y: i32| f32::from(in_disc(x, y));
            let map = prepared.mismatch(corner, size, &weight, &needed);
            let offsets = map.minima(DISC_MINIMA, apart, 0.98, 0.98, corner, limit);
            let pixels: Vec<u32> = (0..(2 * radius + 1).pow(2))
                .filter_map(|i| {
                    let d = IVec2::new(i % (2 * radius + 1), i / (2 * radius + 1)) - radius;
                    let index = sheet.index(middle + d)?;
                    (d.length_squared() <= radius * radius && sheet.is(index, KNOWN))
                        .then_some(index as u32)
                })
                .collect();
            found.discs.extend(refine(sheet, &offsets, f, &pixels));
        }
    }
    progress.check()?;
    found.periods = periods(sheet, &prepared, PERIODS);
    Ok(found)
}

/// The smallest rectangle around the hole, both corners included.
pub(crate) fn bounds(sheet: &Sheet) -> Option<(IVec2, IVec2)> {
    sheet
        .hole()
        .map(|index| sheet.position(index))
        .fold(None, |bounds, at| {
            Some(bounds.map_or((at, at), |(low, high): (IVec2, IVec2)| {
                (low.min(at), high.max(at))
            }))
        })
}

/// Known pixels around the hole, at most about `samples` of them, evenly thinned.
pub(crate) fn around(sheet: &Sheet, samples: usize) -> Vec<u32> {
    let Some((low, high)) = bounds(sheet) else {
        return Vec::new();
    };
    let (low, high) = (low - RING_PX, high + RING_PX);
    let mut pixels: Vec<u32> = Vec::new();
    for y in low.y..=high.y {
        for x in low.x..=high.x {
            if let Some(index) = sheet.index(IVec2::new(x, y))
                && sheet.is(index, KNOWN)
            {
                pixels.push(index as u32);
            }
        }
    }
    let step = pixels.len().div_ceil(samples).max(1);
    pixels.into_iter().step_by(step).collect()
}

/// Looks around each offset of the reduced sheet for the best one of the full sheet.
fn refine(sheet: &Sheet, offsets: &[(IVec2, f32)], factor: i32, pixels: &[u32]) -> Vec<Proposal> {
    let reach = factor;
    let mut refined: Vec<Proposal> = offsets
        .par_iter()
        .filter_map(|&(offset, _)| {
            let side = 2 * reach + 1;
            (0..side * side)
                .filter_map(|k| {
                    let offset = offset * factor + IVec2::new(k % side, k / side) - reach;
                    let score = mismatch(sheet, pixels, offset)?;
                    Some(Proposal { offset, score })
                })
                .min_by(|a, b| a.score.total_cmp(&b.score))
        })
        .collect();
    refined.sort_by(|a, b| a.score.total_cmp(&b.score));
    let mut kept: Vec<Proposal> = Vec::new();
    for proposal in refined {
        if !kept
            .iter()
            .any(|k| (k.offset - proposal.offset).abs().max_element() < APART_PX.min(2))
        {
            kept.push(proposal);
        }
    }
    kept
}

/// The mean squared difference of pixels to those at an offset, as far as these are known; none if less than half are.
pub(crate) fn mismatch(sheet: &Sheet, pixels: &[u32], offset: IVec2) -> Option<f32> {
    if offset == IVec2::ZERO {
        return None;
    }
    let (mut sum, mut count) = (0.0f32, 0u32);
    for &index in pixels {
        let index = index as usize;
        let Some(other) = sheet.shifted(index, offset) else {
            continue;
        };
        if !sheet.is(other, SOURCE) {
            continue;
        }
        count += 1;
        let (a, b) = (&sheet.features[index], &sheet.features[other]);
        sum += if sheet.is(index, STEADY) {
            distance_sq(a, b)
        } else {
            (0..COLORS).map(|i| (a[i] - b[i]).powi(2)).sum()
        };
    }
    (count as usize * 2 >= pixels.len() && count > 0).then(|| sum / count as f32)
}

/// Points on the rim of the hole, about evenly spread: each is the one farthest from those before.
fn rim_points(sheet: &Sheet, count: usize, apart: i32) -> Vec<IVec2> {
    let rim: Vec<IVec2> = sheet
        .hole()
        .map(|index| sheet.position(index))
        .filter(|&at| {
            [IVec2::X, IVec2::NEG_X, IVec2::Y, IVec2::NEG_Y]
                .iter()
                .any(|&step| sheet.index(at + step).is_some_and(|i| sheet.is(i, KNOWN)))
        })
        .collect();
    let mut chosen = Vec::new();
    let mut nearest = vec![i64::MAX; rim.len()];
    let mut next = 0;
    while chosen.len() < count && next < rim.len() && nearest[next] >= i64::from(apart).pow(2) {
        let at = rim[next];
        chosen.push(at);
        for (distance, &other) in nearest.iter_mut().zip(&rim) {
            *distance = (*distance).min((other - at).as_i64vec2().length_squared());
        }
        next = (0..rim.len())
            .rev()
            .max_by_key(|&i| nearest[i])
            .unwrap_or(rim.len());
    }
    chosen
}

/// Repetitions need this correlation to count.
const MIN_CORRELATION: f32 = 0.08;
/// And this share of the sheet must be there to be compared.
const MIN_OVERLAP: f32 = 0.08;
/// Shorter offsets are those of the grain.
const MIN_PERIOD_PX: i32 = 6;
/// The standard deviation of the mean that is taken off first, so that light and shade do not count.
const FLAT_SIGMA_PX: f64 = 12.0;

/// Shifts at which the sheet looks like itself: the highest local maxima of its masked normalised autocorrelation.
fn periods(sheet: &Sheet, prepared: &Prepared, count: usize) -> Vec<Proposal> {
    use ravec_raster::{Plane, gaussian_blur};
    let reduced = &prepared.reduced;
    let (width, height) = (reduced.width, reduced.height);
    let known = |index: usize| f32::from(reduced.states[index] & KNOWN != 0);
    let luminance = |index: usize| {
        let c = &reduced.channels;
        0.299 * c[0][index] + 0.587 * c[1][index] + 0.114 * c[2][index]
    };
    let plane = |value: &dyn Fn(usize) -> f32| {
        Plane::from_vec(width, (0..width * height).map(value).collect())
            .expect("whole rows of a sheet")
    };
    let sigma = FLAT_SIGMA_PX / f64::from(reduced.factor);
    let shares = gaussian_blur(&plane(&known), sigma);
    let sums = gaussian_blur(&plane(&|index| known(index) * luminance(index)), sigma);
    let flat: Vec<f32> = (0..width * height)
        .map(|index| {
            if known(index) > 0.0 {
                luminance(index) - sums.pixels()[index] / shares.pixels()[index].max(1e-6)
            } else {
                0.0
            }
        })
        .collect();
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
            let long = IVec2::new(x, y).length_squared() * reduced.factor.pow(2);
            if far || overlap[index] < MIN_OVERLAP * total || long < MIN_PERIOD_PX * MIN_PERIOD_PX {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canvas::Canvas;
    use ravec_raster::{Image, Mask, Rect, Size, Srgb};

    fn sheet(pattern: impl Fn(usize, usize) -> [u8; 3], hole: Rect) -> Sheet {
        let size = Size::new(96, 80).unwrap();
        let image = Image::from_fn(size, |col, row| Srgb(pattern(col, row)));
        let mut canvas = Canvas::new(&image, &Mask::from_rect(size, hole));
        for row in hole.row..hole.bottom() {
            canvas.states.row_mut(row)[hole.col..hole.right()].fill(HOLE);
        }
        Sheet::window(&canvas, Rect::of(size))
    }

    fn noise(col: usize, row: usize) -> [u8; 3] {
        let value = (col as u64 * 7919 + row as u64 * 104_729).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        [40, 48, 56].map(|shift| (value >> shift) as u8)
    }

    #[test]
    fn a_planted_copy_of_the_surroundings_is_the_first_proposal() {
        let hole = Rect::new(55, 40, 16, 14);
        let around = hole.grown(10);
        let sheet = sheet(
            |col, row| {
                if around.contains(col + 40, row + 9) {
                    noise(col + 40, row + 9)
                } else {
                    noise(col, row)
                }
            },
            hole,
        );
        let found = propose(&sheet, &Progress::none()).unwrap();
        assert_eq!(found.ring[0].offset, IVec2::new(-40, -9));
        assert_eq!(found.ring[0].score, 0.0);
    }

    #[test]
    fn what_repeats_is_found_at_its_periods_only() {
        let pattern = |col: usize, row: usize| noise(col % 13, row % 17);
        let found = propose(
            &sheet(pattern, Rect::new(40, 30, 16, 14)),
            &Progress::none(),
        )
        .unwrap();
        let whole = |p: &Proposal| p.offset.x % 13 == 0 && p.offset.y % 17 == 0;
        assert_eq!(found.periods.len(), PERIODS);
        assert!(found.periods.iter().all(whole), "{:?}", found.periods);
    }

    #[test]
    fn the_transforms_agree_with_direct_sums() {
        let sheet = sheet(noise, Rect::new(40, 30, 12, 10));
        let prepared = Prepared::new(Reduced::new(&sheet, 1), 32);
        let reduced = &prepared.reduced;
        let (corner, size) = (IVec2::new(34, 24), IVec2::new(24, 22));
        let map = prepared.mismatch(
            corner,
            size,
            &|x, y| reduced.weight(x, y, KNOWN),
            &|x, y| reduced.weight(x, y, HOLE),
        );
        for to in [(0, 0), (5, 50), (60, 3), (72, 58), (30, 20)] {
            let mut sum = 0.0f64;
            for k in 0..size.x * size.y {
                let step = IVec2::new(k % size.x, k / size.x);
                let a = sheet.index(corner + step).unwrap();
                let b = sheet.index(IVec2::from(to) + step).unwrap();
                if !sheet.is(a, KNOWN) || !sheet.is(b, SOURCE) {
                    continue;
                }
                let channels = if sheet.is(a, STEADY) {
                    CHANNELS
                } else {
                    COLORS
                };
                for channel in 0..channels {
                    let d = sheet.features[a][channel] - sheet.features[b][channel];
                    sum += f64::from(d).powi(2);
                }
            }
            let found = f64::from(map.mismatch[to.1 as usize * map.width + to.0 as usize]);
            assert!((found - sum).abs() <= 1e-3 * sum, "{to:?}: {found} {sum}");
        }
    }
}
