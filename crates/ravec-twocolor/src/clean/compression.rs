//! Damage by block compression: found, measured, and bounded.
//!
//! JPEG rounds the cosine coefficients of 8 × 8 blocks to multiples of steps. Decoded pictures still show it: their
//! coefficients crowd at these multiples, and the borders of blocks jump. From the steps follow how strong the damage is,
//! and where the undamaged coefficients must lie: within half a step of the decoded ones. So a cleaned picture may move
//! each coefficient only so far, and detail that cleaning would take for noise stays.
//!
//! 1. Find the grid: the phase of columns, and of rows, at which neighbors differ most beyond their surroundings.
//! 2. For each low frequency, the step: the largest of whose multiples nearly all coefficients lie close to.
//! 3. Unknown steps follow the standard's table, scaled as the known ones are.
//! 4. After cleaning, each luma coefficient is drawn back to within [`FREEDOM`] of a step of the decoded one.
//!
//! Sources: ITU-T T.81, Annex K (the table); Yang, Galatsanos & Katsaggelos, 1993 (projection onto the quantization
//! constraint). We differ in the narrower bound, which is better on average than half a step.
//!
//! Non-guarantees: pictures scaled after compression are not recognized; chroma is cleaned but not bounded.

use super::dct::{Block, SIDE, forward, inverse};
use super::strip::encoded;
use crate::pixel::{countable, is_countable};
use fearless_simd::{Level, Simd, dispatch};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::color::{linear_from_srgb, srgb_from_linear};
use ravec_raster::{Image, LinearRgba, LinearRows, Plane, Rect, Size};
use rayon::prelude::*;

/// Luma quantization of quality 50 (T.81, table K.1), `[vertical][horizontal]`.
const STANDARD_STEPS: Block = [
    [16.0, 11.0, 10.0, 16.0, 24.0, 40.0, 51.0, 61.0],
    [12.0, 12.0, 14.0, 19.0, 26.0, 58.0, 60.0, 55.0],
    [14.0, 13.0, 16.0, 24.0, 40.0, 57.0, 69.0, 56.0],
    [14.0, 17.0, 22.0, 29.0, 51.0, 87.0, 80.0, 62.0],
    [18.0, 22.0, 37.0, 56.0, 68.0, 109.0, 103.0, 77.0],
    [24.0, 35.0, 55.0, 64.0, 81.0, 104.0, 113.0, 92.0],
    [49.0, 64.0, 78.0, 87.0, 103.0, 121.0, 120.0, 101.0],
    [72.0, 92.0, 95.0, 98.0, 112.0, 100.0, 103.0, 99.0],
];

/// The low frequencies whose steps are measured, `[vertical, horizontal]`.
const PROBED: [[usize; 2]; 9] = [
    [0, 1],
    [1, 0],
    [2, 0],
    [1, 1],
    [0, 2],
    [0, 3],
    [1, 2],
    [2, 1],
    [3, 0],
];

/// The side of the part of the picture that is examined. Enough for thousands of blocks.
const PROBE_SIDE: usize = 768;

/// Steps from the smallest that is worth cleaning to the coarsest of use.
const STEPS: std::ops::RangeInclusive<usize> = 5..=120;

/// Largest distance of a coefficient from a multiple of its step. Rounding pixels to integers moves coefficients by
/// about 0.3.
const CLOSE: f32 = 1.25;

/// Of the coefficients that do not lie close to multiples by mere chance, the share that must.
const MIN_CLOSE: f32 = 0.7;

/// Coefficients needed to judge a step.
const MIN_COEFFICIENTS: usize = 40;

/// Steps that must be found to call the picture compressed.
const MIN_STEPS_FOUND: usize = 3;

/// Noise in 8-bit steps that takes off the damage, relative to the mean of the standard's five lowest steps as scaled.
/// On photos at qualities 30 and 60 the best is 0.6 within a fifth.
const SIGMA_PER_STEP: f32 = 0.6;

/// Largest move of a coefficient, in steps. Half a step is what is certain; most errors are smaller, and on photos 0.15
/// to 0.2 is best in both PSNR and SSIM.
const FREEDOM: f32 = 0.15;

/// Quantization of the luma of a picture by block compression, as the file of the picture says it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockQuantization {
    /// Steps of the cosine coefficients in 8-bit units, `[vertical][horizontal]` frequency.
    pub steps: [[u16; SIDE]; SIDE],
    /// First column and row at which a block begins.
    pub grid: [usize; 2],
}

/// Estimated compression of a picture.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Compression {
    /// First column and row of the grid of blocks.
    phase: [usize; 2],
    /// The quantization steps of luma, in 8-bit units, `[vertical][horizontal]`.
    steps: Block,
}

/// Luma as JPEG has it, 0 to 255, from linear light.
#[inline(always)]
fn luma(color: LinearRgba) -> f32 {
    let [r, g, b] = encoded(countable(color).rgb());
    255.0 * (0.299 * r + 0.587 * g + 0.114 * b)
}

/// [`luma`] of the pixels of a row.
#[inline(always)]
fn lumas<S: Simd>(_simd: S, pixels: &[LinearRgba], out: &mut [f32]) {
    for (out, &pixel) in out.iter_mut().zip(pixels) {
        *out = luma(pixel);
    }
}

impl Compression {
    /// The compression that a file says, if it is coarse enough to be worth cleaning.
    pub(super) fn known(quantization: &BlockQuantization) -> Option<Self> {
        let steps = quantization.steps;
        let coarse = PROBED
            .iter()
            .filter(|&&[v, u]| usize::from(steps[v][u]) >= *STEPS.start());
        (coarse.count() >= MIN_STEPS_FOUND).then(|| Self {
            phase: quantization.grid.map(|first| first % SIDE),
            steps: steps.map(|row| row.map(|step| f32::from(step.max(1)))),
        })
    }

    /// Looks for the traces of compression in the middle of the picture.
    pub(super) fn find(image: &dyn LinearRows) -> Option<Self> {
        let size = image.size();
        let width = size.width().min(PROBE_SIDE);
        let height = size.height().min(PROBE_SIDE);
        let [left, top] = [(size.width() - width) / 2, (size.height() - height) / 2];
        let mut part = Plane::new(Size::new(width, height).ok()?, 0.0);
        let simd = Level::new();
        part.for_each_row(|row, part| {
            let mut run = vec![LinearRgba::default(); width];
            image.read_linear(top + row, left, &mut run);
            dispatch!(simd, simd => lumas(simd, &run, part));
        });
        let phase = [
            grid_phase(&part, |x, y| [x, y]),
            grid_phase(&part, |x, y| [y, x]),
        ];
        let steps = quantization_steps(&part, phase)?;
        Some(Self {
            phase: [(left + phase[0]) % SIDE, (top + phase[1]) % SIDE],
            steps,
        })
    }

    /// The noise, in 8-bit steps, whose cleaning takes off this damage best.
    pub(super) fn sigma(&self) -> f32 {
        let lowest = PROBED[..5].iter().map(|&[v, u]| self.steps[v][u]);
        SIGMA_PER_STEP * lowest.sum::<f32>() / 5.0
    }

    /// `region` grown to whole blocks, clipped to the image.
    pub(super) fn whole_blocks(&self, region: Rect, image: Size) -> Rect {
        let grow = |begin: usize, end: usize, phase: usize, limit: usize| {
            let first = begin.saturating_sub((begin + SIDE - phase) % SIDE);
            let last = (end + (phase + SIDE - end % SIDE) % SIDE).min(limit);
            (first, last)
        };
        let (left, right) = grow(region.col, region.right(), self.phase[0], image.width());
        let (top, bottom) = grow(region.row, region.bottom(), self.phase[1], image.height());
        Rect::new(left, top, right - left, bottom - top)
    }

    /// Draws the luma coefficients of `cleaned`, the pixels of `region` of `image`, back to what the decoded ones allow.
    /// Blocks that do not lie wholly in the region stay as they are.
    pub(super) fn bound(
        &self,
        image: &dyn LinearRows,
        region: Rect,
        cleaned: &mut Image<LinearRgba>,
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        let lead = |begin: usize, phase: usize| (phase + SIDE - begin % SIDE) % SIDE;
        let [first_col, first_row] = [
            lead(region.col, self.phase[0]),
            lead(region.row, self.phase[1]),
        ];
        let width = region.width;
        let rows = (first_row * width).min(cleaned.pixels().len());
        cleaned.pixels_mut()[rows..]
            .par_chunks_exact_mut(SIDE * width)
            .enumerate()
            .try_for_each(|(i, rows)| {
                progress.check()?;
                let top = region.row + first_row + i * SIDE;
                for left in (first_col..width.saturating_sub(SIDE - 1)).step_by(SIDE) {
                    self.bound_block(image, [region.col + left, top], rows, left, width);
                }
                Ok(())
            })
    }

    fn bound_block(
        &self,
        image: &dyn LinearRows,
        [col, row]: [usize; 2],
        cleaned: &mut [LinearRgba],
        left: usize,
        width: usize,
    ) {
        let decoded: Block = std::array::from_fn(|y| {
            let mut run = [LinearRgba::default(); SIDE];
            image.read_linear(row + y, col, &mut run);
            run.map(luma)
        });
        let moved: Block = std::array::from_fn(|y| {
            std::array::from_fn(|x| luma(cleaned[y * width + left + x]) - decoded[y][x])
        });
        let mut excess = forward(&moved);
        for (row, steps) in excess.iter_mut().zip(&self.steps) {
            for (value, step) in row.iter_mut().zip(steps) {
                let bound = FREEDOM * step;
                *value = value.clamp(-bound, bound) - *value;
            }
        }
        // the same change of all three encoded values changes luma alone
        for (y, row) in inverse(&excess).iter().enumerate() {
            for (x, change) in row.iter().enumerate() {
                let pixel = &mut cleaned[y * width + left + x];
                if pixel.alpha() > 0.0 && is_countable(*pixel) {
                    let rgb = pixel
                        .rgb()
                        .map(|v| linear_from_srgb(srgb_from_linear(v) + change / 255.0));
                    *pixel = LinearRgba::from_rgb_alpha(rgb, pixel.alpha());
                }
            }
        }
    }
}

/// The phase of the grid along the first axis that `at` gives.
fn grid_phase(luma: &Plane, at: fn(usize, usize) -> [usize; 2]) -> usize {
    let [along, across] = at(luma.width(), luma.height());
    let mut jumps = [0.0f64; SIDE];
    let mut counts = [0.0f64; SIDE];
    let value = |i: usize, j: usize| {
        let [x, y] = at(i, j);
        luma[(x, y)]
    };
    for j in (0..across).step_by(2) {
        for i in 2..along.saturating_sub(1) {
            let jump = (value(i, j) - value(i - 1, j)).abs();
            let around =
                (value(i - 1, j) - value(i - 2, j)).abs() + (value(i + 1, j) - value(i, j)).abs();
            jumps[i % SIDE] += f64::from(jump - 0.5 * around);
            counts[i % SIDE] += 1.0;
        }
    }
    (0..SIDE)
        .max_by(|&a, &b| {
            (jumps[a] / counts[a].max(1.0)).total_cmp(&(jumps[b] / counts[b].max(1.0)))
        })
        .unwrap_or(0)
}

/// The steps of all frequencies, if enough of the low ones show theirs.
fn quantization_steps(luma: &Plane, [left, top]: [usize; 2]) -> Option<Block> {
    let tops = (top..luma.height().saturating_sub(SIDE - 1)).step_by(SIDE);
    let corners: Vec<[usize; 2]> = tops
        .flat_map(|y| {
            (left..luma.width().saturating_sub(SIDE - 1))
                .step_by(SIDE)
                .map(move |x| [x, y])
        })
        .collect();
    let simd = Level::new();
    let probed: Vec<[f32; PROBED.len()]> = corners
        .par_iter()
        .map(|&corner| dispatch!(simd, simd => probed_of(simd, luma, corner)))
        .collect();
    let mut scales: Vec<f32> = PROBED
        .iter()
        .enumerate()
        .filter_map(|(index, &[v, u])| {
            let values: Vec<f32> = probed.iter().map(|values| values[index]).collect();
            quantization_step(&values).map(|step| step / STANDARD_STEPS[v][u])
        })
        .collect();
    if scales.len() < MIN_STEPS_FOUND {
        return None;
    }
    scales.sort_by(f32::total_cmp);
    let scale = scales[scales.len() / 2];
    Some(STANDARD_STEPS.map(|row| row.map(|step| (step * scale).max(1.0))))
}

/// The amounts of the probed coefficients of the block at a corner.
#[inline(always)]
fn probed_of<S: Simd>(_simd: S, luma: &Plane, [left, top]: [usize; 2]) -> [f32; PROBED.len()] {
    let mut block = [[0.0; SIDE]; SIDE];
    for (dy, row) in block.iter_mut().enumerate() {
        row.copy_from_slice(&luma.row(top + dy)[left..][..SIDE]);
    }
    let coefficients = forward(&block);
    let mut probed = [0.0; PROBED.len()];
    for (value, [v, u]) in probed.iter_mut().zip(PROBED) {
        *value = coefficients[v][u].abs();
    }
    probed
}

/// The largest step of whose multiples nearly all values, none below 0, lie close to.
fn quantization_step(values: &[f32]) -> Option<f32> {
    let simd = Level::new();
    STEPS.rev().map(|step| step as f32).find(|&step| {
        let (large, close) = dispatch!(simd, simd => close_to_multiples(simd, values, step));
        let by_chance = 2.0 * CLOSE / step;
        let least = by_chance + MIN_CLOSE * (1.0 - by_chance);
        large as usize >= MIN_COEFFICIENTS && close as f32 >= least * large as f32
    })
}

/// Added to a number below 2²² and subtracted again, it leaves the nearest whole number.
const TO_WHOLE: f32 = 12_582_912.0;

/// Number of values above half a step, and of those of them that lie close to a multiple of the step.
#[inline(always)]
fn close_to_multiples<S: Simd>(_simd: S, values: &[f32], step: f32) -> (u32, u32) {
    let (mut large, mut close) = (0, 0);
    let inverse = 1.0 / step;
    for &value in values {
        // the nearest multiple, or a farther one where both are more than CLOSE away
        let multiple = step * ((value * inverse + TO_WHOLE) - TO_WHOLE);
        let is_large = u32::from(value > 0.5 * step);
        large += is_large;
        close += is_large & u32::from((value - multiple).abs() <= CLOSE);
    }
    (large, close)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{Color as _, Sample as _, Srgb};

    /// A smooth picture with edges and some texture.
    fn picture(width: usize, height: usize) -> Plane {
        Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            let (x, y) = (col as f32, row as f32);
            let wave = 40.0 * (0.05 * x + 0.02 * y).sin() + 15.0 * (0.31 * x - 0.23 * y).cos();
            let edge = if (0.7 * x + y) % 90.0 < 40.0 {
                30.0
            } else {
                -30.0
            };
            128.0 + wave + edge + ((col * 31 + row * 17 + col * row) % 13) as f32 - 6.0
        })
    }

    /// Compressed as JPEG does at a scale of the standard's table, the grid beginning at `phase`, rounded to 8 bit.
    fn compressed(plane: &Plane, scale: f32, phase: [usize; 2]) -> Image<Srgb<u8>> {
        let mut coded = plane.clone();
        for top in (phase[1]..plane.height() - 7).step_by(SIDE) {
            for left in (phase[0]..plane.width() - 7).step_by(SIDE) {
                let block: Block = std::array::from_fn(|y| {
                    std::array::from_fn(|x| plane[(left + x, top + y)] - 128.0)
                });
                let mut coefficients = forward(&block);
                for (row, steps) in coefficients.iter_mut().zip(&STANDARD_STEPS) {
                    for (value, step) in row.iter_mut().zip(steps) {
                        *value = (*value / (step * scale)).round() * step * scale;
                    }
                }
                for (y, row) in inverse(&coefficients).iter().enumerate() {
                    for (x, value) in row.iter().enumerate() {
                        coded[(left + x, top + y)] = value + 128.0;
                    }
                }
            }
        }
        coded.map(|v| Srgb([u8::from_unit(v / 255.0); 3]))
    }

    #[test]
    fn steps_and_grid_of_a_compressed_picture_are_found() {
        for (scale, phase) in [(1.0, [0, 0]), (1.67, [3, 5]), (0.8, [7, 1])] {
            let found = Compression::find(&compressed(&picture(400, 320), scale, phase)).unwrap();
            assert_eq!(found.phase, phase);
            let ratio = found.steps[0][1] / (STANDARD_STEPS[0][1] * scale);
            assert!((ratio - 1.0).abs() < 0.12, "{ratio}");
        }
    }

    #[test]
    fn a_picture_that_was_never_compressed_is_not_taken_for_one() {
        let plain = picture(400, 320).map(|v| Srgb([u8::from_unit(v / 255.0); 3]));
        assert_eq!(Compression::find(&plain), None);
        assert_eq!(
            Compression::find(&plain.crop(0, 0, Size::new(9, 5).unwrap()).unwrap()),
            None
        );
    }

    #[test]
    fn a_region_grows_to_whole_blocks() {
        let compression = Compression {
            phase: [3, 5],
            steps: STANDARD_STEPS,
        };
        let image = Size::new(100, 60).unwrap();
        assert_eq!(
            compression.whole_blocks(Rect::new(4, 6, 1, 1), image),
            Rect::new(3, 5, 8, 8)
        );
        assert_eq!(
            compression.whole_blocks(Rect::new(0, 0, 100, 60), image),
            Rect::new(0, 0, 100, 60)
        );
        assert_eq!(
            compression.whole_blocks(Rect::new(11, 13, 8, 8), image),
            Rect::new(11, 13, 8, 8)
        );
        assert_eq!(
            compression.whole_blocks(Rect::new(1, 2, 1, 1), image),
            Rect::new(0, 0, 3, 5)
        );
    }

    #[test]
    fn bounding_leaves_no_coefficient_further_than_allowed() {
        let image = compressed(&picture(64, 64), 1.0, [0, 0]);
        let compression = Compression {
            phase: [0, 0],
            steps: STANDARD_STEPS,
        };
        let mut cleaned: Image<LinearRgba> =
            Image::new(image.size(), Srgb([90u8, 90, 90])).convert();
        compression
            .bound(
                &image,
                Rect::of(image.size()),
                &mut cleaned,
                &Progress::none(),
            )
            .unwrap();
        for top in (0..64).step_by(8) {
            for left in (0..64).step_by(8) {
                let moved: Block = std::array::from_fn(|y| {
                    std::array::from_fn(|x| {
                        luma(cleaned[(left + x, top + y)])
                            - luma(image[(left + x, top + y)].to_linear())
                    })
                });
                for (row, steps) in forward(&moved).iter().zip(&STANDARD_STEPS) {
                    for (value, step) in row.iter().zip(steps) {
                        assert!(value.abs() <= FREEDOM * step + 0.01);
                    }
                }
            }
        }
    }
}
