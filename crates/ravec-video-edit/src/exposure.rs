//! Exposure of a frame against a plate: gain and offset of each channel.

/// Limit of Tukey's biweight in standard deviations.
const TUKEY: f32 = 4.685;
/// Rounds of reweighting.
const ROUNDS: usize = 7;
/// Values from which and below which a pixel may be clipped.
const CLIPPED: [f32; 2] = [0.01, 0.985];
/// Pairs below which nothing is fitted.
const MIN_PAIRS: usize = 40;
/// Pairs from which the robust standard deviation is estimated, at least, if there are as many.
const SCALE_PAIRS: usize = 4000;
/// Standard deviation of values without noise but the rounding of 8 bits.
const MIN_SIGMA: f32 = 0.5 / 255.0;
/// Weight that keeps an offset from standing for a gain, relative to that of all pairs.
const OFFSET_PULL: f64 = 1e-3;

/// Colors of the same place in a plate and in a frame, 0 to 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair {
    pub plate: [f32; 3],
    pub frame: [f32; 3],
}

/// Colors of a frame are `gain · plate + offset` in each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Factor of each channel.
    pub gain: [f32; 3],
    /// Value that is added to each channel.
    pub offset: [f32; 3],
}

impl Exposure {
    /// The exposure of the plate itself.
    pub const SAME: Self = Self {
        gain: [1.0; 3],
        offset: [0.0; 3],
    };

    /// A color of the plate as the frame shows it.
    pub fn applied(&self, color: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|c| self.gain[c] * color[c] + self.offset[c])
    }

    /// A color of the frame as the plate has it.
    pub fn undone(&self, color: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|c| (color[c] - self.offset[c]) / self.gain[c])
    }

    /// Fits by least squares with Tukey's biweight, so that foreground has no weight while it is less than half of the pairs.
    pub(crate) fn fit(pairs: &[Pair]) -> Self {
        let within = |value: &f32| (CLIPPED[0]..CLIPPED[1]).contains(value);
        let usable: Vec<&Pair> = pairs
            .iter()
            .filter(|pair| pair.plate.iter().chain(&pair.frame).all(within))
            .collect();
        if usable.len() < MIN_PAIRS {
            return Self::SAME;
        }
        let mut exposure = Self {
            gain: [0, 1, 2].map(|c| {
                let ratio = |pair: &&Pair| pair.frame[c] / pair.plate[c];
                median(usable.iter().map(ratio).collect())
            }),
            ..Self::SAME
        };
        for _ in 0..ROUNDS {
            let scale = exposure.scales(&usable);
            let Some(next) = exposure.refitted(&usable, scale) else {
                break;
            };
            exposure = next;
        }
        exposure
    }

    /// Robust standard deviation of the residuals, the mean of the channels.
    pub(crate) fn deviation(&self, pairs: &[Pair]) -> f32 {
        let pairs: Vec<&Pair> = pairs.iter().collect();
        self.scales(&pairs).iter().sum::<f32>() / 3.0
    }

    fn residual(&self, pair: &Pair, channel: usize) -> f32 {
        pair.frame[channel] - self.gain[channel] * pair.plate[channel] - self.offset[channel]
    }

    /// Robust standard deviation of each channel, from some of the pairs: it weighs them, and need not be exact.
    fn scales(&self, pairs: &[&Pair]) -> [f32; 3] {
        let step = (pairs.len() / SCALE_PAIRS).max(1);
        [0, 1, 2].map(|channel| {
            let sizes = pairs
                .iter()
                .step_by(step)
                .map(|pair| self.residual(pair, channel).abs());
            (1.4826 * median(sizes.collect())).max(MIN_SIGMA)
        })
    }

    /// One round of weighted least squares.
    fn refitted(&self, pairs: &[&Pair], scale: [f32; 3]) -> Option<Self> {
        // sums of 1, x, x², y, xy for each channel
        let mut sums = [[0.0f64; 5]; 3];
        for pair in pairs {
            let distance: f32 = (0..3)
                .map(|channel| (self.residual(pair, channel) / scale[channel]).powi(2))
                .sum();
            let share = 1.0 - distance / (3.0 * TUKEY * TUKEY);
            if share <= 0.0 {
                continue;
            }
            let weight = f64::from(share * share);
            for (channel, sums) in sums.iter_mut().enumerate() {
                let (x, y) = (
                    f64::from(pair.plate[channel]),
                    f64::from(pair.frame[channel]),
                );
                for (sum, value) in sums.iter_mut().zip([1.0, x, x * x, y, x * y]) {
                    *sum += weight * value;
                }
            }
        }
        let mut next = *self;
        for (channel, [n, x, xx, y, xy]) in sums.into_iter().enumerate() {
            let n = n * (1.0 + OFFSET_PULL);
            let determinant = n * xx - x * x;
            if determinant <= 1e-9 * n * n {
                return None;
            }
            let gain = (n * xy - x * y) / determinant;
            let offset = (xx * y - x * xy) / determinant;
            if !(0.05..20.0).contains(&gain) {
                return None;
            }
            next.gain[channel] = gain as f32;
            next.offset[channel] = offset as f32;
        }
        Some(next)
    }
}

/// The value in the middle, 0 if there are none.
pub(crate) fn median(mut values: Vec<f32>) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gain_and_offset_are_found_beside_foreground() {
        let truth = Exposure {
            gain: [1.1, 0.9, 1.02],
            offset: [0.02, -0.01, 0.0],
        };
        let pairs: Vec<Pair> = (0..2000)
            .map(|k| {
                let x = k as f32 / 2000.0;
                let plate = [
                    0.2 + 0.5 * x,
                    0.3 + 0.4 * (9.0 * x).sin().abs(),
                    0.7 - 0.4 * x,
                ];
                let frame = if k % 3 == 0 {
                    [0.5, 0.1 + 0.2 * x, 0.6]
                } else {
                    truth.applied(plate)
                };
                Pair { plate, frame }
            })
            .collect();
        let found = Exposure::fit(&pairs);
        for c in 0..3 {
            assert!((found.gain[c] - truth.gain[c]).abs() < 0.01, "{found:?}");
            assert!(
                (found.offset[c] - truth.offset[c]).abs() < 0.005,
                "{found:?}"
            );
        }
        let color = [0.3, 0.5, 0.7];
        let again = found.undone(found.applied(color));
        assert!((0..3).all(|c| (again[c] - color[c]).abs() < 1e-5));
    }

    #[test]
    fn a_few_pairs_or_one_color_leave_the_exposure() {
        let pair = Pair {
            plate: [0.5; 3],
            frame: [0.5; 3],
        };
        assert_eq!(Exposure::fit(&[pair; 5]), Exposure::SAME);
        assert_eq!(Exposure::fit(&[pair; 100]), Exposure::SAME);
    }
}
