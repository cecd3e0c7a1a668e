//! Damage by cameras and transmission: noise with a known law.
//!
//! All noise is a function of the seed and the position of a sample, so a damaged picture can be made again, in any
//! number of threads.

use crate::random::Seed;
use ravec_raster::{Image, LinearRgb, Srgb};
use serde::{Deserialize, Serialize};

/// Adds Gaussian noise of standard deviation `sigma` (in 8-bit steps) to each encoded sample by itself, then rounds and
/// clips: `clip(round(c + N(0, sigma)))`.
///
/// This is what denoising papers mean by "σ = 25". Rounding adds a variance of 1/12; clipping narrows the noise near
/// black and white. A `sigma` of 0 (or below) changes nothing.
pub fn add_gaussian_noise(image: &Image<Srgb<u8>>, sigma: f64, seed: Seed) -> Image<Srgb<u8>> {
    let sigma = sigma.max(0.0);
    damage(image, |Srgb(rgb), x, y| {
        let mut channel = 0;
        Srgb(rgb.map(|v| {
            let noise = sigma * seed.gaussian(x, y, channel);
            channel += 1;
            // the cast saturates
            (f64::from(v) + noise).round() as u8
        }))
    })
}

/// A sensor whose noise grows with the light: photons are counted, electronics add their own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SensorNoise {
    /// Linear light (white = 1) of one counted photon, above 0: 1e-4 is a good sensor in daylight, 1e-2 a phone at night.
    pub gain: f64,
    /// Standard deviation of the electronics in linear light, at least 0.
    pub read: f64,
}

impl SensorNoise {
    /// Variance of a sample whose true linear value is `signal`.
    pub fn variance(&self, signal: f64) -> f64 {
        self.gain * signal.max(0.0) + self.read * self.read
    }
}

/// Replaces each sample of linear light by a noisy measurement of it: Poisson counts times the gain plus Gaussian noise.
///
/// Mean and variance are exactly `signal` and [`SensorNoise::variance`] (counts of more than 40 photons are drawn from
/// the rounded Gaussian, whose variance is larger by 1/12 of a photon). Nothing is clipped: dark samples may become
/// negative. Samples that are negative or not finite count as black.
pub fn add_sensor_noise(
    image: &Image<LinearRgb>,
    noise: &SensorNoise,
    seed: Seed,
) -> Image<LinearRgb> {
    damage(image, |LinearRgb(rgb), x, y| {
        let mut channel = 0;
        LinearRgb(rgb.map(|v| {
            let signal = if v.is_finite() {
                f64::from(v).max(0.0)
            } else {
                0.0
            };
            let counted = if noise.gain > 0.0 {
                noise.gain * poisson(signal / noise.gain, seed, x, y, 2 * channel)
            } else {
                signal
            };
            let read = noise.read * seed.gaussian(x, y, 2 * channel + 1);
            channel += 1;
            (counted + read) as f32
        }))
    })
}

/// A Poisson deviate of the given mean.
fn poisson(mean: f64, seed: Seed, x: i64, y: i64, channel: u64) -> f64 {
    if mean > 40.0 {
        return (mean + mean.sqrt() * seed.gaussian(x, y, channel))
            .round()
            .max(0.0);
    }
    // inversion: walk up the distribution until it exceeds a uniform number
    let uniform = seed.unit(x, y, 2 * channel);
    let (mut count, mut probability) = (0.0, (-mean).exp());
    let mut total = probability;
    // beyond this the tail is below the resolution of the uniform number
    while total <= uniform && count < 200.0 {
        count += 1.0;
        probability *= mean / count;
        total += probability;
    }
    count
}

/// Turns a share of the pixels (0 to 1) black or white, half of them each.
pub fn add_salt_and_pepper(image: &Image<Srgb<u8>>, share: f64, seed: Seed) -> Image<Srgb<u8>> {
    damage(image, |pixel, x, y| {
        let u = seed.unit(x, y, 0);
        if u < 0.5 * share {
            Srgb([0; 3])
        } else if u < share {
            Srgb([255; 3])
        } else {
            pixel
        }
    })
}

fn damage<P: ravec_raster::Pixel>(
    image: &Image<P>,
    f: impl Fn(P, i64, i64) -> P + Sync,
) -> Image<P> {
    let mut damaged = image.clone();
    damaged.for_each_row(|row, pixels| {
        for (col, pixel) in pixels.iter_mut().enumerate() {
            *pixel = f(*pixel, col as i64, row as i64);
        }
    });
    damaged
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    const SIDE: usize = 200;
    const COUNT: f64 = (3 * SIDE * SIDE) as f64;

    fn size() -> Size {
        Size::new(SIDE, SIDE).unwrap()
    }

    fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
        let mean = values.clone().sum::<f64>() / COUNT;
        (
            mean,
            values.map(|v| (v - mean).powi(2)).sum::<f64>() / COUNT,
        )
    }

    #[test]
    fn gaussian_noise_has_the_asked_deviation() {
        for sigma in [2.0, 15.0, 25.0] {
            let noisy = add_gaussian_noise(&Image::new(size(), Srgb([128u8; 3])), sigma, Seed(1));
            let (mean, variance) = moments(noisy.pixels().iter().flat_map(|p| p.0).map(f64::from));
            let expected = sigma * sigma + 1.0 / 12.0;
            // five standard errors; at 25 the range ends five deviations away, which clips nothing that counts
            assert!((mean - 128.0).abs() < 5.0 * sigma / COUNT.sqrt());
            assert!(
                (variance / expected - 1.0).abs() < 5.0 * (2.0 / COUNT).sqrt(),
                "{variance}"
            );
        }
    }

    #[test]
    fn no_noise_changes_nothing() {
        let image = Image::from_fn(size(), |c, r| Srgb([c as u8, r as u8, 9]));
        assert_eq!(add_gaussian_noise(&image, 0.0, Seed(1)), image);
        assert_eq!(add_gaussian_noise(&image, -3.0, Seed(1)), image);
        assert_eq!(add_salt_and_pepper(&image, 0.0, Seed(1)), image);
        let linear = image.convert::<LinearRgb>();
        assert_eq!(
            add_sensor_noise(
                &linear,
                &SensorNoise {
                    gain: 0.0,
                    read: 0.0
                },
                Seed(1)
            ),
            linear
        );
    }

    #[test]
    fn sensor_noise_follows_its_variance_function() {
        for noise in [
            SensorNoise {
                gain: 1e-2,
                read: 0.003,
            },
            SensorNoise {
                gain: 3e-4,
                read: 0.01,
            },
        ] {
            for signal in [0.0, 0.004, 0.1, 0.38, 0.9] {
                let noisy =
                    add_sensor_noise(&Image::new(size(), LinearRgb([signal; 3])), &noise, Seed(2));
                let (mean, variance) =
                    moments(noisy.pixels().iter().flat_map(|p| p.0).map(f64::from));
                let expected = noise.variance(f64::from(signal));
                assert!((mean - f64::from(signal)).abs() < 5.0 * (expected / COUNT).sqrt() + 1e-7);
                // few photons have heavy tails: kurtosis 3 + 1/mean, at most 28 here, widens the error of the variance
                // to sqrt(27 / n); rounding of counts adds gain² / 12
                let tolerance =
                    5.0 * (27.0 / COUNT).sqrt() * expected + noise.gain * noise.gain / 12.0;
                assert!(
                    (variance - expected).abs() < tolerance,
                    "{signal}: {variance} {expected}"
                );
            }
        }
    }

    #[test]
    fn light_that_is_not_a_number_counts_as_black() {
        let odd = Image::new(
            Size::new(1, 1).unwrap(),
            LinearRgb([f32::NAN, f32::INFINITY, -4.0]),
        );
        let noise = SensorNoise {
            gain: 0.01,
            read: 0.0,
        };
        assert_eq!(
            add_sensor_noise(&odd, &noise, Seed(3)).pixels(),
            [LinearRgb([0.0; 3])]
        );
    }

    #[test]
    fn salt_and_pepper_hit_the_asked_share() {
        let noisy = add_salt_and_pepper(&Image::new(size(), Srgb([100u8; 3])), 0.1, Seed(4));
        let share = |v: u8| {
            noisy.pixels().iter().filter(|p| p.0 == [v; 3]).count() as f64 / (SIDE * SIDE) as f64
        };
        // five standard errors of a share of 5 %
        let tolerance = 5.0 * (0.05f64 * 0.95).sqrt() / SIDE as f64;
        assert!((share(0) - 0.05).abs() < tolerance && (share(255) - 0.05).abs() < tolerance);
    }
}
