//! The mismatch at all positions of a level, by Fourier transforms of blocks.
//!
//! The plain idea: `Σ w |T − S(·+u)|² = Σ w T² − 2 Σ (w T) ⋆ S + w ⋆ S²` for all shifts `u`, where `⋆` is a correlation, that
//! is a product of spectra; the same for gradients and features with their weights.
//!
//! Departures: the level is cut into blocks that overlap by as much as a template is wide, so that a template is
//! transformed once in the size of a block, all work on a block stays in the cache, and blocks go to threads. Means are
//! taken off first, so that squares do not drown differences in rounding. Spectra hold real and imaginary parts apart,
//! which vectors like better, and columns as lines.
//!
//! Guarantees: the same bits on any number of threads. Does not guarantee: the same last bits on machines with other vector
//! units.
//!
//! Cost: 0.6 ms of one core for a block of 192² positions and a query; 1.8 × 4 bytes for each pixel and channel that
//! is kept.

use super::level::{Channels, GRADIENT_WEIGHT, Level};
use super::template::Template;
use fearless_simd::{Level as Vectors, Simd, dispatch};
use glam::IVec2;
use ravec_numeric::{Complex32, Fourier, FourierScratch};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Side of the blocks whose spectra are kept: transforms of this length are fast, and a block with its spectrum stays in
/// the cache of a core.
pub(super) const KEPT_SIDE: usize = 256;

/// The transforms of blocks.
pub(super) struct Transform {
    side: usize,
    fourier: Fourier,
}

/// Scratch memory of a thread.
pub(super) struct Scratch {
    real: Vec<f32>,
    spectrum: Vec<Complex32>,
    fourier: FourierScratch,
    sum: Vec<f32>,
}

impl Transform {
    /// Transforms of blocks of a side, a multiple of 64.
    pub(super) fn new(side: usize) -> Self {
        Self {
            side,
            fourier: Fourier::new(side, side),
        }
    }

    /// Positions of a block in each direction that belong to it alone.
    pub(super) fn step(&self) -> usize {
        self.side / 4 * 3
    }

    /// Positions that are computed: one more on each side, for the minima along borders.
    pub(super) fn field(&self) -> usize {
        self.step() + 2
    }

    /// Longest side of a template.
    pub(super) fn longest(&self) -> usize {
        Self::fits(self.side)
    }

    /// The transforms of the smallest blocks for templates of a side.
    pub(super) fn with_longest(template: usize) -> Self {
        let mut side = 256;
        while Self::fits(side) < template {
            side *= 2;
        }
        Self::new(side)
    }

    /// Longest side of a template for blocks of a side.
    fn fits(side: usize) -> usize {
        side / 4 - 1
    }

    /// Horizontal frequencies.
    fn bins(&self) -> usize {
        self.fourier.bins()
    }

    /// Numbers of a spectrum: real parts, then imaginary parts.
    fn numbers(&self) -> usize {
        2 * self.bins() * self.side
    }

    pub(super) fn scratch(&self) -> Scratch {
        Scratch {
            real: vec![0.0; self.side * self.side],
            spectrum: vec![Complex32::ZERO; self.bins() * self.side],
            fourier: self.fourier.scratch(),
            sum: vec![0.0; self.numbers()],
        }
    }

    /// The spectrum of the block in `scratch.real`, of which only the first `rows` rows are not 0.
    fn forward(&self, scratch: &mut Scratch, rows: usize, out: &mut [f32]) {
        let Scratch {
            real,
            spectrum,
            fourier,
            ..
        } = scratch;
        self.fourier
            .forward_with(&mut real[..rows * self.side], spectrum, fourier);
        let (re, im) = out.split_at_mut(self.bins() * self.side);
        for ((re, im), value) in re.iter_mut().zip(im).zip(spectrum.iter()) {
            *re = value.re;
            *im = value.im;
        }
    }

    /// The first field rows of the block whose spectrum is in `scratch.sum`, into `scratch.real`.
    fn inverse(&self, scratch: &mut Scratch) {
        let Scratch {
            real,
            spectrum,
            fourier,
            sum,
        } = scratch;
        let (re, im) = sum.split_at(self.bins() * self.side);
        let scale = 1.0 / (self.side * self.side) as f32;
        for ((value, re), im) in spectrum.iter_mut().zip(re).zip(im) {
            *value = Complex32::new(scale * re, scale * im);
        }
        let rows = &mut real[..self.field() * self.side];
        self.fourier.inverse_with(spectrum, rows, fourier);
    }
}

/// Channels of a level that are correlated: values, gradients, and the squares of colors, gradients and features.
fn kept(channels: Channels) -> usize {
    channels.values() + 2 + 2 + usize::from(channels.features)
}

/// A level in the form that searches need, without its spectra.
struct Parts<'a> {
    level: &'a Level,
    channels: Channels,
    means: &'a [f32],
}

impl Parts<'_> {
    /// One of the [`kept`] numbers for pixels of a row from `from` on.
    fn row(&self, part: usize, from: usize, row: usize, out: &mut [f32]) {
        let level = self.level;
        let (at, luma) = (row * level.width + from, level.luma_index(from, row));
        let values = self.channels.values();
        let plane = |plane: usize| {
            let line = if plane == 0 {
                &level.luma[luma..]
            } else {
                &level.planes[plane - 1][at..]
            };
            (line, self.means[plane])
        };
        if part < values {
            let (line, mean) = plane(part);
            for (out, value) in out.iter_mut().zip(line) {
                *out = value - mean;
            }
            return;
        }
        let stride = level.width + 2;
        let across = || level.luma[luma - 1..].iter().zip(&level.luma[luma + 1..]);
        let down = || {
            level.luma[luma - stride..]
                .iter()
                .zip(&level.luma[luma + stride..])
        };
        let squares = |planes: std::ops::Range<usize>, out: &mut [f32]| {
            out.fill(0.0);
            for (line, mean) in planes.map(plane) {
                for (out, value) in out.iter_mut().zip(line) {
                    *out += (value - mean) * (value - mean);
                }
            }
        };
        match part - values {
            0 => {
                for (out, (a, b)) in out.iter_mut().zip(across()) {
                    *out = GRADIENT_WEIGHT * (b - a);
                }
            }
            1 => {
                for (out, (a, b)) in out.iter_mut().zip(down()) {
                    *out = GRADIENT_WEIGHT * (b - a);
                }
            }
            2 => squares(0..self.channels.colors(), out),
            3 => {
                let square = |(a, b): (&f32, &f32)| (GRADIENT_WEIGHT * (b - a)).powi(2);
                for (out, (x, y)) in out.iter_mut().zip(across().zip(down())) {
                    *out = square(x) + square(y);
                }
            }
            _ => squares(values - 1..values, out),
        }
    }

    fn spectrum(
        &self,
        transform: &Transform,
        scratch: &mut Scratch,
        origin: IVec2,
        part: usize,
        out: &mut [f32],
    ) {
        let (width, height) = (self.level.width as i32, self.level.height as i32);
        let mut rows = 0;
        let side = transform.side;
        for (dy, line) in scratch.real.chunks_exact_mut(side).enumerate() {
            line.fill(0.0);
            let y = origin.y + dy as i32;
            if y < 0 || y >= height {
                continue;
            }
            rows = dy + 1;
            let from = (-origin.x).max(0);
            let to = (width - origin.x).min(side as i32);
            if from < to {
                let col = (origin.x + from) as usize;
                self.row(part, col, y as usize, &mut line[from as usize..to as usize]);
            }
        }
        transform.forward(scratch, rows, out);
    }
}

/// A level with what searches of it need.
pub(super) struct Blocks {
    step: usize,
    across: usize,
    down: usize,
    means: Vec<f32>,
    /// For each block the spectra of what is [`kept`]; none if they are to be computed when they are needed.
    spectra: Option<Vec<Vec<f32>>>,
}

impl Blocks {
    /// Blocks of a level. Spectra are computed now, if blocks have at most `waste` times as many pixels as the level; else
    /// when they are needed.
    pub(super) fn new(
        level: &Level,
        channels: Channels,
        transform: &Transform,
        waste: f64,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let mut blocks = Self {
            step: transform.step(),
            across: level.width.div_ceil(transform.step()),
            down: level.height.div_ceil(transform.step()),
            means: means(level, channels, progress)?,
            spectra: None,
        };
        let pixels = blocks.count() * transform.side * transform.side;
        if pixels as f64 <= waste * (level.width * level.height) as f64 {
            let spectra = (0..blocks.count())
                .into_par_iter()
                .map_init(
                    || transform.scratch(),
                    |scratch, block| {
                        progress.check()?;
                        Ok(blocks.spectra_of(level, channels, transform, scratch, block))
                    },
                )
                .collect::<Result<_, Cancelled>>()?;
            blocks.spectra = Some(spectra);
        }
        progress.check()?;
        Ok(blocks)
    }

    pub(super) fn count(&self) -> usize {
        self.across * self.down
    }

    /// The first position that is computed for a block. Its own begin one further on, those of the first block at −1, where
    /// the frame of a template lies outside the level.
    pub(super) fn first(&self, block: usize) -> IVec2 {
        IVec2::new(
            (block % self.across * self.step) as i32,
            (block / self.across * self.step) as i32,
        ) - 2
    }

    /// The `most` blocks that are nearest to a position, in their order; all without one, or if there are no more.
    pub(super) fn nearest(&self, position: Option<IVec2>, most: usize) -> Vec<usize> {
        let mut blocks: Vec<usize> = (0..self.count()).collect();
        if let Some(position) = position.filter(|_| blocks.len() > most) {
            let half = (self.step / 2) as i32;
            let distance_sq = |block: usize| {
                let away = self.first(block) + half - position;
                away.as_i64vec2().length_squared()
            };
            blocks.select_nth_unstable_by_key(most, |&block| (distance_sq(block), block));
            blocks.truncate(most);
            blocks.sort_unstable();
        }
        blocks
    }

    pub(super) fn bytes(&self) -> usize {
        let spectra = self.spectra.iter().flatten();
        4 * spectra.map(Vec::len).sum::<usize>()
    }

    fn spectra_of(
        &self,
        level: &Level,
        channels: Channels,
        transform: &Transform,
        scratch: &mut Scratch,
        block: usize,
    ) -> Vec<f32> {
        let parts = Parts {
            level,
            channels,
            means: &self.means,
        };
        let mut spectra = vec![0.0; kept(channels) * transform.numbers()];
        for (part, out) in spectra.chunks_exact_mut(transform.numbers()).enumerate() {
            parts.spectrum(transform, scratch, self.first(block), part, out);
        }
        spectra
    }

    /// The spectra of a template, each with the factor with which it enters the sum, and the part that does not depend on
    /// the position.
    pub(super) fn query(&self, template: &Template, transform: &Transform) -> Query {
        let channels = template.channels;
        let values = channels.values();
        let mean = |plane: usize| self.means.get(plane).copied().unwrap_or(0.0);
        let number = |part: usize, at: usize| -> f32 {
            if part < values + 2 {
                let weight = template.weights[template.weight_of(part)][at];
                if weight > 0.0 {
                    -2.0 * weight * (template.values[part][at] - mean(part))
                } else {
                    0.0
                }
            } else {
                template.weights[part - values - 2][at]
            }
        };
        let spectra = (0..kept(channels))
            .into_par_iter()
            .map_init(
                || transform.scratch(),
                |scratch, part| {
                    scratch.real.fill(0.0);
                    for (row, line) in scratch
                        .real
                        .chunks_exact_mut(transform.side)
                        .take(template.height)
                        .enumerate()
                    {
                        for (col, out) in line[..template.width].iter_mut().enumerate() {
                            *out = number(part, row * template.stride + col);
                        }
                    }
                    let mut out = vec![0.0; transform.numbers()];
                    transform.forward(scratch, template.height, &mut out);
                    out
                },
            )
            .collect();
        let mut constant = 0.0f64;
        for part in 0..values + 2 {
            let weights = &template.weights[template.weight_of(part)];
            for (value, weight) in template.values[part].iter().zip(weights) {
                constant += f64::from(*weight) * f64::from(value - mean(part)).powi(2);
            }
        }
        Query {
            spectra,
            constant: constant as f32,
        }
    }

    /// The mismatch at all positions of a block, with one more on each side.
    pub(super) fn field<'a>(
        &self,
        level: &Level,
        query: &Query,
        channels: Channels,
        transform: &Transform,
        scratch: &'a mut Scratch,
        block: usize,
    ) -> Field<'a> {
        let computed;
        let spectra = if let Some(spectra) = &self.spectra {
            &spectra[block]
        } else {
            computed = self.spectra_of(level, channels, transform, scratch, block);
            &computed
        };
        dispatch!(Vectors::new(), simd => accumulate(simd, &query.spectra, spectra, &mut scratch.sum));
        transform.inverse(scratch);
        for value in &mut scratch.real[..transform.field() * transform.side] {
            *value += query.constant;
        }
        Field {
            values: &scratch.real,
            stride: transform.side,
            len: transform.field(),
        }
    }
}

/// The spectra of a template.
pub(super) struct Query {
    spectra: Vec<Vec<f32>>,
    constant: f32,
}

/// The mismatch at the positions of a block, the first of them one left of and above its own.
pub(super) struct Field<'a> {
    values: &'a [f32],
    stride: usize,
    len: usize,
}

impl Field<'_> {
    pub(super) fn row(&self, row: usize) -> &[f32] {
        &self.values[row * self.stride..][..self.len]
    }
}

/// The sum of `conj(a) · b` over all pairs of spectra.
#[inline(always)]
fn accumulate<S: Simd>(_simd: S, a: &[Vec<f32>], b: &[f32], sum: &mut [f32]) {
    const LANES: usize = 16;
    let half = sum.len() / 2;
    let (sum_re, sum_im) = sum.split_at_mut(half);
    let sums = sum_re
        .as_chunks_mut::<LANES>()
        .0
        .iter_mut()
        .zip(sum_im.as_chunks_mut::<LANES>().0);
    for (i, (sum_re, sum_im)) in sums.enumerate() {
        let (mut re, mut im) = ([0.0f32; LANES], [0.0f32; LANES]);
        for (a, b) in a.iter().zip(b.chunks_exact(2 * half)) {
            let at = |plane: &[f32], start: usize| -> [f32; LANES] {
                *plane[start..]
                    .first_chunk()
                    .expect("a spectrum is made of whole vectors")
            };
            let (ar, ai) = (at(a, LANES * i), at(a, half + LANES * i));
            let (br, bi) = (at(b, LANES * i), at(b, half + LANES * i));
            for k in 0..LANES {
                re[k] += ar[k] * br[k] + ai[k] * bi[k];
                im[k] += ar[k] * bi[k] - ai[k] * br[k];
            }
        }
        *sum_re = re;
        *sum_im = im;
    }
}

/// The means of the values of the sources; of all pixels, if there are none.
fn means(level: &Level, channels: Channels, progress: &Progress) -> Result<Vec<f32>, Cancelled> {
    (0..channels.values())
        .into_par_iter()
        .map(|plane| {
            let (mut sum, mut count) = (0.0f64, 0u64);
            for row in 0..level.height {
                progress.check()?;
                for col in 0..level.width {
                    let index = row * level.width + col;
                    if level.runs[index] > 0 {
                        count += 1;
                        sum += f64::from(if plane == 0 {
                            level.luma[level.luma_index(col, row)]
                        } else {
                            level.planes[plane - 1][index]
                        });
                    }
                }
            }
            Ok((sum / count.max(1) as f64) as f32)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_blocks_are_those_that_a_sort_finds(
            across in 1usize..30, down in 1usize..30, most in 1usize..200, x in -999i32..9999, y in -999i32..9999
        ) {
            let blocks = Blocks { step: 192, across, down, means: Vec::new(), spectra: None };
            let position = IVec2::new(x, y);
            let found = blocks.nearest(Some(position), most);
            let mut sorted: Vec<usize> = (0..across * down).collect();
            sorted.sort_by_key(|&block| {
                let away = blocks.first(block) + 96 - position;
                away.as_i64vec2().length_squared()
            });
            sorted.truncate(most);
            sorted.sort_unstable();
            prop_assert_eq!(found, sorted);
            prop_assert_eq!(blocks.nearest(None, most).len(), across * down);
        }
    }
}
