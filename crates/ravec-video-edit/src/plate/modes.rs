//! The most frequent color of each pixel among samples, by mean shift.
//!
//! Source: Comaniciu and Meer, *Mean shift: a robust approach toward feature space analysis*, 2002; the kernel is the biweight, which
//! ends at its radius.

use fearless_simd::{Level, Simd, dispatch};

/// Mean-shift steps from each start.
const STEPS: usize = 4;
/// Starts that are tried at most.
const MAX_STARTS: usize = 12;
/// Share of the samples that ends the search: no other mode can be denser.
const ENOUGH: f32 = 0.6;

/// Share of the radius around a mode in which no search starts.
const KNOWN: f32 = 0.25;
/// Samples that are weighed at once.
const LANES: usize = 8;
/// A value far from all colors, in steps of 8 bits.
const FAR: f32 = 1e9;

/// Colors of a pixel in several frames, by channel.
#[derive(Default)]
pub(crate) struct Samples {
    channels: [Vec<f32>; 3],
    /// Number of the layer of each sample.
    layers: Vec<u16>,
}

/// A color around which samples are dense.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mode {
    pub color: [f32; 3],
    /// Samples at the color, each weighted by the kernel.
    pub density: f32,
}

impl Samples {
    pub fn clear(&mut self) {
        self.channels.iter_mut().for_each(Vec::clear);
        self.layers.clear();
    }

    pub fn push(&mut self, color: [f32; 3], layer: usize) {
        self.layers.push(u16::try_from(layer).unwrap_or(u16::MAX));
        for (channel, value) in self.channels.iter_mut().zip(color) {
            channel.push(value);
        }
    }

    pub fn len(&self) -> usize {
        self.channels[0].len()
    }

    pub fn color(&self, index: usize) -> [f32; 3] {
        self.channels.each_ref().map(|channel| channel[index])
    }

    /// The densest mode within `radius`; `guess` is tried first.
    pub fn densest(&self, guess: [f32; 3], radius: f32) -> Option<Mode> {
        dispatch!(Level::new(), simd => self.densest_on(simd, guess, radius))
    }

    #[inline(always)]
    fn densest_on<S: Simd>(&self, simd: S, guess: [f32; 3], radius: f32) -> Option<Mode> {
        let count = self.len();
        if count == 0 {
            return None;
        }
        let starts = count.min(MAX_STARTS);
        let mut best: Option<Mode> = None;
        for index in 0..=starts {
            let start = match index.checked_sub(1) {
                None => guess,
                Some(start) => self.color(start * count / starts),
            };
            let mode = self.climbed(simd, start, radius);
            if best.is_none_or(|best| mode.density > best.density) {
                best = Some(mode);
                if mode.density > ENOUGH * count as f32 {
                    break;
                }
            }
        }
        best
    }

    /// Layers whose samples lie within `radius` of a color.
    pub fn frames_near(&self, color: [f32; 3], radius: f32) -> Vec<u16> {
        let scale = 1.0 / (radius * radius);
        let near = |index: usize| {
            let sample = self.color(index);
            biweight([0, 1, 2].map(|c| sample[c] - color[c]), scale) > 0.0
        };
        let found = (0..self.len()).filter(|&index| near(index));
        found.map(|index| self.layers[index]).collect()
    }

    /// Modes that are reached from up to `starts` samples, at least half of `radius` apart.
    pub fn modes(&self, radius: f32, starts: usize) -> Vec<Mode> {
        dispatch!(Level::new(), simd => self.modes_on(simd, radius, starts))
    }

    #[inline(always)]
    fn modes_on<S: Simd>(&self, simd: S, radius: f32, starts: usize) -> Vec<Mode> {
        let starts = self.len().min(starts);
        let mut modes: Vec<Mode> = Vec::new();
        let near = |color: [f32; 3], other: &Mode, distance: f32| {
            let apart = [0, 1, 2].map(|c| color[c] - other.color[c]);
            biweight(apart, 1.0 / (distance * distance)) > 0.0
        };
        for start in 0..starts {
            let start = self.color(start * self.len() / starts);
            // it would lead to a mode that is known
            if modes.iter().any(|mode| near(start, mode, KNOWN * radius)) {
                continue;
            }
            let mode = self.climbed(simd, start, radius);
            if !modes
                .iter()
                .any(|other| near(mode.color, other, 0.5 * radius))
            {
                modes.push(mode);
            }
        }
        modes
    }

    /// The mode to which mean shift leads.
    #[inline(always)]
    fn climbed<S: Simd>(&self, _simd: S, start: [f32; 3], radius: f32) -> Mode {
        let mut mode = Mode {
            color: start,
            density: 0.0,
        };
        for _ in 0..STEPS {
            let [weight, r, g, b] = self.sums(mode.color, radius);
            if weight <= 0.0 {
                return mode;
            }
            let color = [r / weight, g / weight, b / weight];
            let moved = (0..3)
                .map(|c| (color[c] - mode.color[c]).abs())
                .sum::<f32>();
            mode = Mode {
                color,
                density: weight,
            };
            if moved < 0.01 * radius {
                break;
            }
        }
        mode
    }

    /// Weight of the samples around `center`, and their weighted sums.
    #[inline(always)]
    fn sums(&self, center: [f32; 3], radius: f32) -> [f32; 4] {
        let scale = 1.0 / (radius * radius);
        let [x, y, z] = self.channels.each_ref().map(|channel| channel.as_chunks());
        let mut sums = [[0.0f32; LANES]; 4];
        for ((x, y), z) in x.0.iter().zip(y.0).zip(z.0) {
            add(&mut sums, [x, y, z], center, scale);
        }
        // what lies far outside of the kernel has no weight
        let rest = |values: &[f32]| {
            let mut lanes = [FAR; LANES];
            lanes[..values.len()].copy_from_slice(values);
            lanes
        };
        if !x.1.is_empty() {
            let [x, y, z] = [rest(x.1), rest(y.1), rest(z.1)];
            add(&mut sums, [&x, &y, &z], center, scale);
        }
        sums.map(|lanes| lanes.iter().sum())
    }
}

/// Adds samples to sums of weights and of weighted channels.
#[inline(always)]
fn add(sums: &mut [[f32; LANES]; 4], [x, y, z]: [&[f32; LANES]; 3], center: [f32; 3], scale: f32) {
    let [weights, xs, ys, zs] = sums;
    for lane in 0..LANES {
        let apart = [
            x[lane] - center[0],
            y[lane] - center[1],
            z[lane] - center[2],
        ];
        let weight = biweight(apart, scale);
        weights[lane] += weight;
        xs[lane] += weight * x[lane];
        ys[lane] += weight * y[lane];
        zs[lane] += weight * z[lane];
    }
}

/// Tukey's biweight of a difference of colors; `scale` is one over the squared radius.
#[inline(always)]
pub(crate) fn biweight(difference: [f32; 3], scale: f32) -> f32 {
    let [x, y, z] = difference;
    let share = (1.0 - (x * x + y * y + z * z) * scale).max(0.0);
    share * share
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_densest_of_two_modes_wins_from_any_guess() {
        let mut samples = Samples::default();
        for k in 0..40 {
            let wave = 0.01 * ((k * 7) as f32).sin();
            let color = if k % 5 < 2 {
                [0.2 + wave; 3]
            } else {
                [0.6 - wave, 0.5, 0.4]
            };
            samples.push(color, k);
        }
        for guess in [[0.2; 3], [0.9; 3], [0.6, 0.5, 0.4]] {
            let mode = samples.densest(guess, 0.08).unwrap();
            assert!((mode.color[0] - 0.6).abs() < 0.005, "{mode:?}");
            assert!(mode.density > 20.0 && mode.density <= 24.0);
        }
        assert_eq!(Samples::default().densest([0.0; 3], 0.1), None);
    }
}
