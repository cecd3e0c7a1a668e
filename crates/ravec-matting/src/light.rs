//! Light of a frame against the plate: gain and offset of each channel, a small shift, and blur.
//!
//! A frame is taken as `gain · plate + offset` plus a linear combination of the first and second derivatives of the plate,
//! which a shift below a pixel and a blur of a few tenths of a pixel are to second order. The eleven numbers are fitted by
//! least squares with Tukey's biweight, so that foreground, which fits nowhere, has no weight. Where the second derivatives ask for
//! more blur than that, the plate is blurred by it and the fit done again, until nothing is missing: frames of a camera in motion.

use crate::matte::Colors;
use fearless_simd::{Level as Vectors, Simd, dispatch};
use ravec_numeric::solve_positive;
use ravec_raster::{BlurCovariance, Image, Plane, Rect, elliptic_gaussian_blur};
use rayon::prelude::*;

/// Samples that the fit reads at most.
const MAX_SAMPLES: usize = 6000;
/// Rounds of reweighting.
const ROUNDS: usize = 6;
/// Limit of Tukey's biweight in standard deviations.
const TUKEY: f32 = 4.685;
/// Standard deviation of values in 8 bit that have no noise but rounding, 0.5 of a step with room.
const MIN_SIGMA: f32 = 0.5 / 255.0;
/// Difference to the plate up to which a sample may be background in another light.
const DRIFT: f32 = 8.0 / 255.0;
/// Quantile of differences, and where a normal distribution has it in standard deviations.
const WIDE_QUANTILE: f32 = 0.85;
const WIDE_SIGMAS: f32 = 1.44;
/// Factor of the standard deviation of drift: means over neighbors do not reduce it, as they do noise.
const DRIFT_WEIGHT: f32 = 3.0;
/// Quantile of the differences of windows, and where a normal distribution has it in standard deviations.
const DRIFT_QUANTILE: f32 = 0.7;
const DRIFT_SIGMAS: f32 = 1.036;
/// Pixels of a window of drift: three in a row and in a column, each the second one.
const WINDOW_PIXELS: f32 = 9.0;
/// Largest variance of a blur, in square pixels, that second derivatives describe.
const MAX_LINEAR_BLUR: f64 = 0.5;
/// Fits of a blur that is larger.
const BLUR_ROUNDS: usize = 6;
/// Variance that is missing when a fit of the blur ends, in square pixels.
const BLUR_TOLERANCE: f64 = 0.15;
/// Largest ratio of the residuals with and without a blur at which the blur is accepted.
const MIN_BLUR_GAIN: f32 = 0.97;
/// Unknowns: gains, offsets, two first and three second derivatives.
const UNKNOWNS: usize = 11;

/// Photometric and geometric difference between a frame and its plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateLight {
    /// Factor of each channel.
    pub gain: [f32; 3],
    /// Value that is added to each channel.
    pub offset: [f32; 3],
    /// Blur of the plate before anything else; none for blurs that the derivatives describe.
    pub blur: BlurCovariance,
    /// Factors of the derivatives of the plate: x, y, xx, xy, yy.
    pub derivatives: [f32; 5],
    /// Standard deviation of the noise of each channel.
    pub sigma: [f32; 3],
    /// Variance that is added for each unit of the squared gradient, in units of the variance of the noise: the plate is
    /// not exact at its edges.
    pub edge_variance: f32,
}

/// First and second differences of a pixel of the plate in one channel.
fn derivatives(plate: &Colors, col: usize, row: usize, channel: usize) -> [f32; 5] {
    let (width, height) = (plate.width(), plate.height());
    let (west, east) = (col.saturating_sub(1), (col + 1).min(width - 1));
    let (north, south) = (row.saturating_sub(1), (row + 1).min(height - 1));
    let rows = [plate.row(north), plate.row(row), plate.row(south)];
    let at = |row: usize, col: usize| rows[row][col][channel];
    [
        0.5 * (at(1, east) - at(1, west)),
        0.5 * (at(2, col) - at(0, col)),
        at(1, east) - 2.0 * at(1, col) + at(1, west),
        0.25 * (at(2, east) - at(2, west) - at(0, east) + at(0, west)),
        at(2, col) - 2.0 * at(1, col) + at(0, col),
    ]
}

/// Mean of nine pixels of the window of five by five around one; those beyond the picture are its last ones.
fn window_mean(image: &Colors, col: usize, row: usize) -> [f32; 3] {
    let around = |at: usize, length: usize| [at.saturating_sub(2), at, (at + 2).min(length - 1)];
    let mut sum = [0.0; 3];
    for row in around(row, image.height()) {
        let line = image.row(row);
        for col in around(col, image.width()) {
            for (sum, value) in sum.iter_mut().zip(line[col]) {
                *sum += value;
            }
        }
    }
    sum.map(|sum| sum / WINDOW_PIXELS)
}

/// A pixel that the fit looks at.
struct Sample {
    frame: [f32; 3],
    plate: [f32; 3],
    derivatives: [[f32; 5]; 3],
    /// Means of the frame and of the plate over a window.
    means: [[f32; 3]; 2],
}

impl Sample {
    /// Difference of the means of the window in a light.
    fn mean_residual(&self, light: &PlateLight, channel: usize) -> f32 {
        let [frame, plate] = self.means.map(|mean| mean[channel]);
        frame - light.gain[channel] * plate - light.offset[channel]
    }

    fn residual(&self, light: &PlateLight, channel: usize) -> f32 {
        let shown = light.gain[channel] * self.plate[channel] + light.offset[channel];
        self.frame[channel] - shown - dot(&self.derivatives[channel], &light.derivatives)
    }

    /// Squared gradient, summed over the channels.
    fn gradient_squared(&self) -> f32 {
        self.derivatives
            .iter()
            .map(|d| d[0] * d[0] + d[1] * d[1])
            .sum()
    }
}

fn dot(a: &[f32; 5], b: &[f32; 5]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Unknowns of a channel: gain, offset and the derivatives.
const CHANNEL_UNKNOWNS: usize = 7;

/// Normal equations of a channel.
#[derive(Clone, Copy, Default)]
struct ChannelSums {
    /// The upper triangle.
    matrix: [[f64; CHANNEL_UNKNOWNS]; CHANNEL_UNKNOWNS],
    right: [f64; CHANNEL_UNKNOWNS],
}

impl ChannelSums {
    /// Adds an equation of the first `N` unknowns.
    #[inline(always)]
    fn add<const N: usize>(&mut self, row: &[f32; CHANNEL_UNKNOWNS], value: f32, weight: f32) {
        let row = row.map(f64::from);
        let equations = self.matrix.iter_mut().zip(&mut self.right);
        for (a, (line, right)) in equations.enumerate().take(N) {
            let weighted = f64::from(weight) * row[a];
            *right += weighted * f64::from(value);
            for (sum, value) in line[a..N].iter_mut().zip(&row[a..N]) {
                *sum += weighted * value;
            }
        }
    }
}

/// The value in the middle of `values`, 0 if there are none. Changes their order.
fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

impl PlateLight {
    /// A frame that shows the plate as it is, with noise of a step of 8 bit.
    const SAME: Self = Self {
        gain: [1.0; 3],
        offset: [0.0; 3],
        blur: BlurCovariance {
            xx: 0.0,
            xy: 0.0,
            yy: 0.0,
        },
        derivatives: [0.0; 5],
        sigma: [2.0 * MIN_SIGMA; 3],
        edge_variance: 0.0,
    };

    /// Fits the light to the pixels that `usable` allows; all if it is `None`. Up to a third of them may be foreground. Both pictures
    /// must have the same size.
    pub fn fit(
        frame: &Colors,
        plate: &Colors,
        usable: Option<&dyn Fn(usize, usize) -> bool>,
    ) -> Self {
        let (sharp, scale) = Self::fit_linear(frame, plate, usable);
        let mut missing = sharp.linear_blur();
        if missing.max_variance() <= MAX_LINEAR_BLUR {
            return sharp;
        }
        let mut best = sharp;
        let mut limit = MIN_BLUR_GAIN * scale;
        let mut blur = BlurCovariance::default();
        for _ in 0..BLUR_ROUNDS {
            blur = blur.after(missing).without_sharpening();
            let blurred = elliptic_gaussian_blur(plate, blur);
            let (light, scale) = Self::fit_linear(frame, &blurred, usable);
            missing = light.linear_blur();
            if scale < limit {
                best = Self { blur, ..light };
                limit = scale;
            }
            if missing.max_variance().abs() < BLUR_TOLERANCE {
                break;
            }
        }
        best
    }

    /// Blur of the plate in the frame: the one before the derivatives and the one that they describe.
    pub fn total_blur(&self) -> BlurCovariance {
        self.blur.after(self.linear_blur()).without_sharpening()
    }

    /// The blur that the second derivatives stand for; negative where the frame is sharper.
    fn linear_blur(&self) -> BlurCovariance {
        let gain = f64::from(self.gain.iter().sum::<f32>()) / 3.0;
        let [_, _, xx, xy, yy] = self.derivatives.map(f64::from);
        BlurCovariance {
            xx: 2.0 * xx / gain,
            xy: xy / gain,
            yy: 2.0 * yy / gain,
        }
    }

    /// Fits everything but a blur beyond that of the derivatives. Gives the robust size of what is left, too, summed over the
    /// channels.
    fn fit_linear(
        frame: &Colors,
        plate: &Colors,
        usable: Option<&dyn Fn(usize, usize) -> bool>,
    ) -> (Self, f32) {
        let step = ((frame.size().pixels() as f64 / MAX_SAMPLES as f64)
            .sqrt()
            .ceil() as usize)
            .max(1);
        let mut samples = Vec::new();
        for row in (step / 2..frame.height()).step_by(step) {
            // every other row starts half a step later, so that no column of a pattern is missed
            let start = if (row / step).is_multiple_of(2) {
                step / 2
            } else {
                0
            };
            for col in (start..frame.width()).step_by(step) {
                let (color, behind) = (frame[(col, row)], plate[(col, row)]);
                let clipped = color
                    .iter()
                    .any(|value| *value >= 0.99 || !value.is_finite());
                if clipped || !behind.iter().all(|value| value.is_finite()) {
                    continue;
                }
                if usable.is_some_and(|usable| !usable(col, row)) {
                    continue;
                }
                let derivatives = [0, 1, 2].map(|channel| derivatives(plate, col, row, channel));
                let means = [frame, plate].map(|image| window_mean(image, col, row));
                samples.push(Sample {
                    frame: color,
                    plate: behind,
                    derivatives,
                    means,
                });
            }
        }
        if samples.len() < 4 * UNKNOWNS {
            return (Self::SAME, 0.0);
        }
        let mut light = Self::SAME;
        for round in 0..ROUNDS {
            let scale = light.scales(&samples);
            // gain and offset first: a shift that is fitted to a wrong light is none
            let with_derivatives = round >= 2;
            light = light
                .refitted(&samples, scale, with_derivatives)
                .unwrap_or(light);
        }
        (
            light.with_noise(&samples),
            light.scales(&samples).iter().sum(),
        )
    }

    /// Robust standard deviation of each channel.
    fn scales(&self, samples: &[Sample]) -> [f32; 3] {
        [0, 1, 2].map(|channel| {
            let mut sizes: Vec<f32> = samples
                .iter()
                .map(|sample| sample.residual(self, channel).abs())
                .collect();
            (1.4826 * median(&mut sizes)).max(MIN_SIGMA)
        })
    }

    /// One round of weighted least squares.
    fn refitted(
        &self,
        samples: &[Sample],
        scale: [f32; 3],
        with_derivatives: bool,
    ) -> Option<Self> {
        let mut channels = [ChannelSums::default(); 3];
        let squared = scale.map(|scale| 1.0 / (scale * scale));
        for sample in samples {
            let residual = [0, 1, 2].map(|channel| sample.residual(self, channel));
            let distance: f32 = (0..3)
                .map(|channel| residual[channel] * residual[channel] * squared[channel])
                .sum();
            // three channels: the biweight of the largest sphere that one channel would have
            let share = 1.0 - distance / (3.0 * TUKEY * TUKEY);
            if share <= 0.0 {
                continue;
            }
            for (channel, sums) in channels.iter_mut().enumerate() {
                let d = &sample.derivatives[channel];
                let row = [sample.plate[channel], 1.0, d[0], d[1], d[2], d[3], d[4]];
                let weight = share * share * squared[channel];
                if with_derivatives {
                    sums.add::<7>(&row, sample.frame[channel], weight);
                } else {
                    sums.add::<2>(&row, sample.frame[channel], weight);
                }
            }
        }
        let mut matrix = [[0.0f64; UNKNOWNS]; UNKNOWNS];
        let mut right = [0.0f64; UNKNOWNS];
        for (channel, sums) in channels.iter().enumerate() {
            let index = |k: usize| if k < 2 { 2 * channel + k } else { 4 + k };
            for a in 0..CHANNEL_UNKNOWNS {
                right[index(a)] += sums.right[a];
                for b in 0..CHANNEL_UNKNOWNS {
                    matrix[index(a)][index(b)] += sums.matrix[a.min(b)][a.max(b)];
                }
            }
        }
        // a plate without contrast leaves gain and offset, one without texture the derivatives open
        for (k, row) in matrix.iter_mut().enumerate() {
            let (pull, toward) = match k {
                0 | 2 | 4 => (1e-3 * row[k + 1], 1.0),
                1 | 3 | 5 => (1e-6 * row[k], 0.0),
                _ => (1e-3 * row[k] + 1.0, 0.0),
            };
            row[k] += pull + 1e-9;
            right[k] += pull * toward;
        }
        let solution = solve_positive(&matrix, &right)?;
        let value = |k: usize| solution[k] as f32;
        let light = Self {
            gain: [value(0), value(2), value(4)],
            offset: [value(1), value(3), value(5)],
            derivatives: [6, 7, 8, 9, 10].map(value),
            ..*self
        };
        let sane = light.gain.iter().all(|gain| (0.05..20.0).contains(gain));
        sane.then_some(light)
    }

    /// Noise of flat places, and what edges add.
    fn with_noise(mut self, samples: &[Sample]) -> Self {
        let mut gradients: Vec<f32> = samples.iter().map(Sample::gradient_squared).collect();
        let limit = median(&mut gradients);
        let scale = self.scales(samples);
        let fits =
            |sample: &&Sample| (0..3).all(|c| sample.residual(&self, c).abs() < TUKEY * scale[c]);
        let flat: Vec<_> = samples
            .iter()
            .filter(fits)
            .filter(|sample| sample.gradient_squared() <= limit)
            .collect();
        let edges: Vec<_> = samples
            .iter()
            .filter(fits)
            .filter(|sample| sample.gradient_squared() > limit)
            .collect();
        let spread = |of: &[&Sample], channel: usize| {
            let mut sizes: Vec<f32> = of
                .iter()
                .map(|sample| sample.residual(&self, channel).abs())
                .collect();
            1.4826 * median(&mut sizes)
        };
        let sigma = [0, 1, 2].map(|channel| {
            let narrow = spread(&flat, channel).max(MIN_SIGMA);
            let wide = narrow.max(self.wide_sigma(samples, limit, channel, narrow));
            wide.hypot(DRIFT_WEIGHT * self.drift(samples, limit, channel, narrow))
        });
        let mean_gradient = edges
            .iter()
            .map(|sample| sample.gradient_squared())
            .sum::<f32>()
            / edges.len().max(1) as f32;
        let excess: f32 = (0..3)
            .map(|channel| (spread(&edges, channel) / sigma[channel]).powi(2) - 1.0)
            .sum::<f32>()
            / 3.0;
        self.sigma = sigma;
        if mean_gradient > 1e-9 {
            self.edge_variance = (excess / mean_gradient).max(0.0);
        }
        self
    }

    /// Standard deviation of flat places by a high quantile. Light that changes in places and blocks of compression differ from the
    /// plate by a few steps in large areas, which a median does not see.
    fn wide_sigma(&self, samples: &[Sample], limit: f32, channel: usize, sigma: f32) -> f32 {
        let end = DRIFT.max(4.0 * sigma);
        let mut sizes: Vec<f32> = samples
            .iter()
            .filter(|sample| sample.gradient_squared() <= limit)
            .map(|sample| sample.residual(self, channel).abs())
            .filter(|size| *size < end)
            .collect();
        let at = (WIDE_QUANTILE * sizes.len() as f32) as usize;
        if at >= sizes.len() {
            return sigma;
        }
        *sizes.select_nth_unstable_by(at, f32::total_cmp).1 / WIDE_SIGMAS
    }

    /// Standard deviation of what the windows of flat places differ by beyond independent noise: blocks of compression, and light that
    /// changes in places.
    fn drift(&self, samples: &[Sample], limit: f32, channel: usize, sigma: f32) -> f32 {
        let mut sizes: Vec<f32> = samples
            .iter()
            .filter(|sample| sample.gradient_squared() <= limit)
            .map(|sample| sample.mean_residual(self, channel).abs())
            .filter(|size| *size < DRIFT)
            .collect();
        let at = (DRIFT_QUANTILE * sizes.len() as f32) as usize;
        if at >= sizes.len() {
            return 0.0;
        }
        let size = *sizes.select_nth_unstable_by(at, f32::total_cmp).1 / DRIFT_SIGMAS;
        (size * size - sigma * sigma / WINDOW_PIXELS)
            .max(0.0)
            .sqrt()
    }

    /// The plate in this light, and the variance of its difference to the frame relative to that of the noise.
    pub fn relit(&self, plate: &Colors) -> (Colors, Plane) {
        let blurred;
        let plate = if self.blur == BlurCovariance::default() {
            plate
        } else {
            blurred = elliptic_gaussian_blur(plate, self.blur);
            &blurred
        };
        let width = plate.width();
        let lit_row = LitRow {
            gain: (0..3 * width).map(|at| self.gain[at % 3]).collect(),
            offset: (0..3 * width).map(|at| self.offset[at % 3]).collect(),
            derivatives: self.derivatives,
            edge_variance: self.edge_variance,
        };
        let mut lit = Image::new(plate.size(), [0.0; 3]);
        let mut variance = Plane::new(plate.size(), 1.0);
        lit.par_rows_mut()
            .zip(variance.par_rows_mut())
            .enumerate()
            .for_each_init(
                || [(); 4].map(|()| Vec::new()),
                |[above, here, below, gradient], (row, (lit, variance))| {
                    let last = plate.height() - 1;
                    pad(plate.row(row.saturating_sub(1)), above);
                    pad(plate.row(row), here);
                    pad(plate.row((row + 1).min(last)), below);
                    gradient.resize(3 * width, 0.0);
                    let lines = [&**above, here, below];
                    let lit = lit.as_flattened_mut();
                    dispatch!(Vectors::new(), simd => {
                        lit_row.relight(simd, lines, lit, gradient);
                        lit_row.variance(simd, gradient, variance);
                    });
                },
            );
        (lit, variance)
    }

    /// Colors of a rectangle in units of the noise; 0 where they are not finite. `None` if the rectangle is empty or leaves the
    /// picture.
    pub(crate) fn whitened(&self, colors: &Colors, rect: Rect) -> Option<[Plane; 3]> {
        let size = rect
            .size()
            .filter(|_| rect.clipped(colors.size()) == rect)?;
        Some([0, 1, 2].map(|channel| {
            let scale = 1.0 / self.sigma[channel];
            let mut plane = Plane::new(size, 0.0);
            plane.for_each_row(|row, out| {
                let colors = &colors.row(rect.row + row)[rect.col..rect.right()];
                for (out, color) in out.iter_mut().zip(colors) {
                    let value = color[channel];
                    *out = if value.is_finite() {
                        value * scale
                    } else {
                        0.0
                    };
                }
            });
            plane
        }))
    }
}

/// The numbers of a row with its first and last pixel once more.
fn pad(row: &[[f32; 3]], padded: &mut Vec<f32>) {
    padded.clear();
    padded.extend(row.first().into_iter().flatten());
    padded.extend(row.as_flattened());
    padded.extend(row.last().into_iter().flatten());
}

/// A light with a factor and an offset for each number of a row.
struct LitRow {
    gain: Vec<f32>,
    offset: Vec<f32>,
    derivatives: [f32; 5],
    edge_variance: f32,
}

impl LitRow {
    /// The middle one of three padded rows in this light, and the squared gradient of each number.
    #[inline(always)]
    fn relight<S: Simd>(&self, _simd: S, rows: [&[f32]; 3], lit: &mut [f32], gradient: &mut [f32]) {
        let count = lit.len();
        let [above, here, below] =
            rows.map(|row| [&row[..count], &row[3..][..count], &row[6..][..count]]);
        let (gain, offset) = (&self.gain[..count], &self.offset[..count]);
        let gradient = &mut gradient[..count];
        let [fx, fy, fxx, fxy, fyy] = self.derivatives;
        for at in 0..count {
            let x = 0.5 * (here[2][at] - here[0][at]);
            let y = 0.5 * (below[1][at] - above[1][at]);
            let xx = here[2][at] - 2.0 * here[1][at] + here[0][at];
            let xy = 0.25 * (below[2][at] - below[0][at] - above[2][at] + above[0][at]);
            let yy = below[1][at] - 2.0 * here[1][at] + above[1][at];
            gradient[at] = x * x + y * y;
            lit[at] = gain[at] * here[1][at]
                + offset[at]
                + (x * fx + y * fy + xx * fxx + xy * fxy + yy * fyy);
        }
    }

    /// Variance of the difference of the pixels of a row.
    #[inline(always)]
    fn variance<S: Simd>(&self, _simd: S, gradient: &[f32], variance: &mut [f32]) {
        for (variance, [r, g, b]) in variance.iter_mut().zip(gradient.as_chunks::<3>().0) {
            *variance = 1.0 + self.edge_variance * (r + g + b);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    #[test]
    fn rows_in_another_light_are_those_of_single_pixels() {
        let light = PlateLight {
            gain: [0.9, 1.1, 1.0],
            offset: [0.01, -0.02, 0.0],
            derivatives: [0.3, -0.2, 0.1, 0.05, 0.2],
            edge_variance: 7.0,
            ..PlateLight::SAME
        };
        for (width, height) in [(1, 1), (2, 5), (9, 4), (37, 3)] {
            let plate = Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
                [0, 5, 11].map(|c| ((7 * col * col + 3 * row + c) % 13) as f32 / 13.0)
            });
            let (lit, variance) = light.relit(&plate);
            for row in 0..height {
                for col in 0..width {
                    let mut gradient = 0.0;
                    for c in 0..3 {
                        let d = derivatives(&plate, col, row, c);
                        gradient += d[0] * d[0] + d[1] * d[1];
                        let expected = light.gain[c] * plate[(col, row)][c]
                            + light.offset[c]
                            + dot(&d, &light.derivatives);
                        assert!((lit[(col, row)][c] - expected).abs() < 1e-5);
                    }
                    let expected = 1.0 + light.edge_variance * gradient;
                    assert!((variance[(col, row)] - expected).abs() < 1e-4);
                }
            }
        }
    }
}
