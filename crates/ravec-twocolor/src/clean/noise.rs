//! Noise level of an image at each brightness.
//!
//! Noise fills all frequencies of a block alike, structure mostly the low ones. In each class of brightness, the blocks
//! with the least energy at low frequencies are the flattest, and since white noise is independent across frequencies,
//! choosing them does not bias what their high frequencies say: the noise.
//!
//! Source: Ponomarenko et al., "An automatic approach to lossy compression of AVIRIS images", 2007 (flat blocks by low
//! frequencies). We differ in doing it per class of brightness, so that sensor noise, which grows with the signal, is
//! known at each brightness.
//!
//! Structure fills all frequencies alike only by chance. Where the flattest blocks of a class do not look like white noise
//! and say far more than those that do, as in text over a gradient, the latter count. Pictures that were drawn (see
//! [`drawn`](super::drawn)) have no noise at all.
//!
//! Non-guarantee: a picture that is fine texture everywhere reads as noisier than it is, and noise that was blurred or
//! compressed away as less.

use super::compression::{BlockQuantization, Compression};
use super::dct::{SIDE, block_of, forward};
use super::drawn::is_drawn;
use super::strip::{CHANNELS, encoded, opponent_from_rgb};
use crate::pixel::is_countable;
use fearless_simd::{Level, Simd, dispatch};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Color, Image, LinearRgba, LinearRows};
use rayon::prelude::*;

/// Classes of brightness.
pub(super) const CLASSES: usize = 12;

/// The most blocks examined. More add nothing to the accuracy, which the picture's texture limits.
const MAX_BLOCKS: usize = 24_000;

/// Coefficients of a block that count as low frequencies.
const LOW_FREQUENCIES: f32 = 27.0;

/// The share of a class's blocks that count as flat. Less is noisier, more lets texture in.
const FLAT_SHARE: f64 = 0.1;

/// The energy of flat blocks at low frequencies over that at high ones, per coefficient, up to which they look like white
/// noise. In noisy photos it is 0.6 to 1.5.
const MAX_WHITE_RATIO: f32 = 2.0;

/// Noise in units where white is 1 that is too weak to be mistaken for structure: a third of an 8-bit step.
const FAINT: f32 = 0.33 / 255.0;

/// A class without white blocks is taken for structure if it is this many times as strong as all that have them, and
/// stronger than [`MIN_STRUCTURE`].
const STRUCTURE_EXCESS: f32 = 6.0;

/// One and a half 8-bit steps, as luma.
const MIN_STRUCTURE: f32 = 1.5 / 255.0;

/// The brightness range of the luma channel, `(R + G + B)/√3`.
pub(super) const LUMA_RANGE: f32 = 1.732_050_8;

/// The noise of each opponent channel over the brightness range, as standard deviations in units where white is 1.
#[derive(Debug, Clone, PartialEq)]
pub struct NoiseLevel {
    /// At `CLASSES` brightnesses, evenly spaced from black to white.
    sigma: [[f32; CLASSES]; CHANNELS],
    /// Compression of the picture, if it was compressed.
    pub(super) compression: Option<Compression>,
}

impl NoiseLevel {
    /// The same noise everywhere, `sigma` in steps of 8-bit encoded values.
    pub fn uniform(sigma: f32) -> Self {
        Self {
            sigma: [[sigma / 255.0; CLASSES]; CHANNELS],
            compression: None,
        }
    }

    /// The typical noise of a sample, in steps of 8-bit encoded values: the root mean square over red, green and blue that a
    /// third of the brightnesses stay below, because texture only adds. The opponent transform keeps that mean, so it is also right where the channels have
    /// the same noise, as in a gray picture.
    pub fn typical(&self) -> f32 {
        let mut all: [f32; CLASSES] = std::array::from_fn(|class| {
            let squares = self.sigma.map(|channel| channel[class] * channel[class]);
            (squares.iter().sum::<f32>() / CHANNELS as f32).sqrt()
        });
        all.sort_by(f32::total_cmp);
        255.0 * all[CLASSES / 3]
    }

    /// Returns `true` if there is neither noise nor compression: cleaning leaves such a picture as it is.
    pub fn is_none(&self) -> bool {
        self.compression.is_none() && self.sigma.iter().flatten().all(|&sigma| sigma == 0.0)
    }

    /// Returns `true` if the picture shows the traces of block compression.
    pub fn is_compressed(&self) -> bool {
        self.compression.is_some()
    }

    /// The same level, but at least what takes off the damage of the compression.
    fn with_compression(self, compression: Compression) -> Self {
        let least = compression.sigma() / 255.0;
        Self {
            sigma: self
                .sigma
                .map(|channel| channel.map(|level| level.max(least))),
            compression: Some(compression),
        }
    }

    /// The same noise of a picture that shows no traces of compression.
    #[must_use]
    pub fn uncompressed(&self) -> Self {
        Self {
            sigma: self.sigma,
            compression: None,
        }
    }

    /// The standard deviations of the three opponent channels at evenly spaced brightnesses, from black to white, in units where
    /// white is 1. Between two brightnesses they are interpolated.
    pub fn sigma(&self) -> &[[f32; CLASSES]; CHANNELS] {
        &self.sigma
    }

    /// The noise of the three opponent channels where the first one, `(R + G + B)/√3` of encoded values, is `luma`.
    #[inline(always)]
    pub(super) fn sigma_at(&self, luma: f32) -> [f32; CHANNELS] {
        let position = (luma * (1.0 / LUMA_RANGE)).clamp(0.0, 1.0) * (CLASSES - 1) as f32;
        let low = (position as usize).min(CLASSES - 2);
        let share = position - low as f32;
        self.sigma
            .map(|channel| channel[low] + share * (channel[low + 1] - channel[low]))
    }
}

/// One block: its brightness, and for each channel the energy at low frequencies and the mean at high ones.
#[derive(Clone, Copy)]
struct Probe {
    luma: f32,
    low: [f32; CHANNELS],
    high: [f32; CHANNELS],
}

/// Estimates the noise of an image from at most some 24 000 of its blocks. Pictures below 16 × 16 pixels count as clean.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub fn estimate_noise<P: Color>(
    image: &Image<P>,
    progress: &Progress,
) -> Result<NoiseLevel, Cancelled> {
    estimate_rows(image, None, progress)
}

/// [`estimate_noise`] of a picture whose file says how it was compressed. The pixels are asked only where that is too fine
/// to matter, as they may have been compressed before.
///
/// # Errors
/// As [`estimate_noise`].
pub fn estimate_noise_of_compressed<P: Color>(
    image: &Image<P>,
    quantization: &BlockQuantization,
    progress: &Progress,
) -> Result<NoiseLevel, Cancelled> {
    estimate_rows(image, Compression::known(quantization), progress)
}

/// Steps of the estimation, with the compression of the picture if it is known.
fn estimate_rows(
    image: &dyn LinearRows,
    known: Option<Compression>,
    progress: &Progress,
) -> Result<NoiseLevel, Cancelled> {
    let size = image.size();
    let (columns, rows) = (size.width() / SIDE, size.height() / SIDE);
    if columns < 2 || rows < 2 || (known.is_none() && is_drawn(image, progress)?) {
        return Ok(NoiseLevel::uniform(0.0));
    }
    // every row of blocks is read, but only every few columns, with a shift from row to row
    let step = (columns * rows).div_ceil(MAX_BLOCKS);
    let simd = Level::new();
    let phase = progress.phase("noise", rows as u64);
    let probes: Vec<Vec<Probe>> = (0..rows)
        .into_par_iter()
        .map(|row| {
            progress.check()?;
            phase.advance(1);
            let first = row * 7 % step;
            Ok((first..columns)
                .step_by(step)
                .filter_map(|col| probe(simd, image, col * SIDE, row * SIDE))
                .collect())
        })
        .collect::<Result<_, Cancelled>>()?;
    let level = level_of(probes.into_iter().flatten().collect());
    progress.check()?;
    Ok(match known.or_else(|| Compression::find(image)) {
        Some(compression) => level.with_compression(compression),
        None => level,
    })
}

/// Measures one block, unless clipping or transparency hides its noise.
fn probe(simd: Level, image: &dyn LinearRows, left: usize, top: usize) -> Option<Probe> {
    let mut pixels = [LinearRgba::default(); SIDE * SIDE];
    for (y, run) in pixels.chunks_exact_mut(SIDE).enumerate() {
        image.read_linear(top + y, left, run);
    }
    let hidden = |pixel: &LinearRgba| pixel.alpha() < 1.0 || !is_countable(*pixel);
    if pixels.iter().any(hidden) {
        return None;
    }
    dispatch!(simd, simd => probe_of(simd, &pixels))
}

/// [`probe`] of the pixels of a block, row by row.
#[inline(always)]
fn probe_of<S: Simd>(_simd: S, pixels: &[LinearRgba; SIDE * SIDE]) -> Option<Probe> {
    let mut channels = [[0.0f32; SIDE * SIDE]; CHANNELS];
    let mut clipped = 0u32;
    let [first, second, third] = &mut channels;
    let planes = first.iter_mut().zip(second).zip(third);
    for (((first, second), third), pixel) in planes.zip(pixels) {
        let color = encoded(pixel.rgb());
        let mut is_clipped = 0;
        for value in color {
            is_clipped |= u32::from(value <= 0.0) | u32::from(value >= 1.0);
        }
        clipped += is_clipped;
        [*first, *second, *third] = opponent_from_rgb(color);
    }
    if clipped as usize > SIDE * SIDE / 8 {
        return None;
    }
    let mut found = Probe {
        luma: 0.0,
        low: [0.0; CHANNELS],
        high: [0.0; CHANNELS],
    };
    for (c, channel) in channels.iter().enumerate() {
        let coefficients = forward(&block_of(channel));
        if c == 0 {
            found.luma = coefficients[0][0] / SIDE as f32;
        }
        let mut high_count = 0;
        for (v, row) in coefficients.iter().enumerate() {
            for (u, &value) in row.iter().enumerate() {
                if u + v >= SIDE - 1 {
                    found.high[c] += value * value;
                    high_count += 1;
                } else if u + v > 0 {
                    found.low[c] += value * value;
                }
            }
        }
        found.high[c] /= high_count as f32;
    }
    Some(found)
}

/// The noise level from all probes.
fn level_of(mut probes: Vec<Probe>) -> NoiseLevel {
    if probes.len() < CLASSES {
        return NoiseLevel::uniform(0.0);
    }
    probes.sort_by(|a, b| a.luma.total_cmp(&b.luma));
    let per_class = probes.len().div_ceil(CLASSES);
    let classes: Vec<&[Probe]> = probes.chunks(per_class).collect();
    let luma: Vec<Flat> = classes.iter().map(|class| Flat::of(class, 0)).collect();
    let is_structure = structure(&luma);
    let mut sigma = [[0.0; CLASSES]; CHANNELS];
    for (c, sigma) in sigma.iter_mut().enumerate() {
        let mut points: Vec<(f32, f32)> = classes
            .iter()
            .map(|class| Flat::of(class, c))
            .map(|flat| (flat.luma, flat.noise))
            .collect();
        if is_structure.contains(&true) {
            bound_structure(&mut points, &is_structure);
        }
        // texture only adds: a class far above its neighbors on both sides is texture, not noise
        let raw: Vec<f32> = points.iter().map(|point| point.1).collect();
        for (i, point) in points.iter_mut().enumerate() {
            let mut near: Vec<f32> = raw[i.saturating_sub(2)..(i + 3).min(raw.len())].to_vec();
            near.sort_by(f32::total_cmp);
            point.1 = point.1.min(near[near.len() / 2]);
        }
        *sigma = std::array::from_fn(|i| at(&points, LUMA_RANGE * i as f32 / (CLASSES - 1) as f32));
    }
    NoiseLevel {
        sigma,
        compression: None,
    }
}

/// The flattest blocks of a class in one channel.
#[derive(Clone, Copy)]
struct Flat {
    /// Mean brightness of the whole class.
    luma: f32,
    noise: f32,
    /// Energy at low frequencies over that at high ones, per coefficient.
    ratio: f32,
}

impl Flat {
    fn of(class: &[Probe], channel: usize) -> Self {
        let luma = class.iter().map(|probe| probe.luma).sum::<f32>() / class.len() as f32;
        let mut order: Vec<&Probe> = class.iter().collect();
        order.sort_by(|a, b| a.low[channel].total_cmp(&b.low[channel]));
        let flat = ((class.len() as f64 * FLAT_SHARE).ceil() as usize)
            .max(8)
            .min(class.len());
        let low = order[flat / 2].low[channel] / LOW_FREQUENCIES;
        let mut high: Vec<f32> = order[..flat]
            .iter()
            .map(|probe| probe.high[channel])
            .collect();
        high.sort_by(f32::total_cmp);
        // the median and the first decile of χ² with 36 degrees of freedom are 0.9815 and 0.7123 of its mean; texture
        // among the blocks raises the median more
        let median = (high[flat / 2] / 0.9815).sqrt();
        let decile = (high[flat / 10] / 0.7123).sqrt();
        Self {
            luma,
            noise: median.min(decile),
            ratio: low / high[flat / 2].max(f32::MIN_POSITIVE),
        }
    }

    /// Returns `true` if the blocks say how strong the noise is: they look like noise, or there is hardly any.
    fn is_white(&self) -> bool {
        self.noise <= FAINT || self.ratio <= MAX_WHITE_RATIO
    }
}

/// For each class, by its luma: `true` if its flattest blocks are structure.
fn structure(classes: &[Flat]) -> Vec<bool> {
    let white = classes.iter().filter(|class| class.is_white());
    let Some(strongest) = white.map(|class| class.noise).reduce(f32::max) else {
        return vec![false; classes.len()];
    };
    let bound = (STRUCTURE_EXCESS * strongest).max(MIN_STRUCTURE);
    classes
        .iter()
        .map(|class| !class.is_white() && class.noise > bound)
        .collect()
}

/// Bounds the noise of classes that are structure by the strongest of the others.
fn bound_structure(points: &mut [(f32, f32)], is_structure: &[bool]) {
    let others = points.iter().zip(is_structure).filter(|(_, is)| !**is);
    let strongest = others.map(|(point, _)| point.1).fold(0.0, f32::max);
    for (point, _) in points.iter_mut().zip(is_structure).filter(|(_, is)| **is) {
        point.1 = point.1.min(strongest);
    }
}

/// Linear interpolation between points of rising brightness, constant beyond them.
fn at(points: &[(f32, f32)], luma: f32) -> f32 {
    let next = points.partition_point(|point| point.0 <= luma);
    match (next.checked_sub(1).map(|i| points[i]), points.get(next)) {
        (Some(low), Some(high)) => {
            low.1 + (luma - low.0) / (high.0 - low.0).max(1e-6) * (high.1 - low.1)
        }
        (Some(end), None) => end.1,
        (None, Some(end)) => end.1,
        (None, None) => 0.0,
    }
}
