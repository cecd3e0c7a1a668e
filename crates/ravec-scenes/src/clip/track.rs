//! Quantities that change over a shot, as closed formulas of the time.
//!
//! A track has no state: any moment may be asked for, in any order, also between two frames and a little before the first.

use crate::random::Seed;
use serde::{Deserialize, Serialize};

/// A moment of a shot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Share of the shot that has passed: 0 at its first frame, 1 at its last, 0 throughout a shot of one frame.
    pub share: f64,
    /// Seconds since the first frame of the shot.
    pub secs: f64,
}

/// A quantity over the time of a shot.
///
/// Motion across a scene is stated by the share of the shot, so that it covers the same way with any number of frames;
/// vibration and steps are stated in seconds, so that they keep their rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Track {
    /// One value.
    Constant(f64),
    /// Constant speed.
    Linear {
        /// Value at the first frame.
        from: f64,
        /// Value at the last frame.
        to: f64,
    },
    /// Starts and ends at rest (Hermite's cubic).
    Eased {
        /// Value at the first frame.
        from: f64,
        /// Value at the last frame.
        to: f64,
    },
    /// Starts at rest and gains speed evenly.
    Accelerated {
        /// Value at the first frame.
        from: f64,
        /// Value at the last frame.
        to: f64,
    },
    /// Leaves a value, is farthest in the middle of the shot, and comes back: `sin²(π·share)` of the way.
    Excursion {
        /// Value at the first and the last frame.
        rest: f64,
        /// Value in the middle of the shot.
        away: f64,
    },
    /// A sine wave.
    Wave {
        /// Its mean.
        mean: f64,
        /// Its height above the mean.
        amplitude: f64,
        /// Its period.
        period_secs: f64,
        /// Its phase at the first frame.
        phase_rad: f64,
    },
    /// A band-limited random motion of mean 0: a sum of [`SHAKE_WAVES`] sine waves.
    Shake {
        /// Its standard deviation over a long time; at most 3.47 times as much at any moment.
        deviation: f64,
        /// The lowest frequency.
        low_hz: f64,
        /// The highest frequency.
        high_hz: f64,
        /// Seed of phases and frequencies.
        seed: Seed,
    },
    /// The sum of tracks.
    Sum(Vec<Track>),
}

/// Waves of a [`Track::Shake`]: enough that no period shows within a clip.
pub const SHAKE_WAVES: usize = 6;

impl Track {
    /// The value at a moment.
    pub fn at(&self, moment: Moment) -> f64 {
        let share = moment.share;
        let between = |from: f64, to: f64, t: f64| from + (to - from) * t;
        match self {
            Self::Constant(value) => *value,
            Self::Linear { from, to } => between(*from, *to, share),
            Self::Eased { from, to } => {
                let t = share.clamp(0.0, 1.0);
                between(*from, *to, t * t * (3.0 - 2.0 * t))
            }
            Self::Accelerated { from, to } => between(*from, *to, share.max(0.0).powi(2)),
            Self::Excursion { rest, away } => {
                let s = (std::f64::consts::PI * share).sin();
                between(*rest, *away, s * s)
            }
            Self::Wave {
                mean,
                amplitude,
                period_secs,
                phase_rad,
            } => {
                let turn = std::f64::consts::TAU * moment.secs / period_secs;
                mean + amplitude * (turn + phase_rad).sin()
            }
            Self::Shake {
                deviation,
                low_hz,
                high_hz,
                seed,
            } => deviation * shake(moment.secs, *low_hz, *high_hz, *seed),
            Self::Sum(tracks) => tracks.iter().map(|track| track.at(moment)).sum(),
        }
    }

    /// The sum of two tracks.
    pub fn plus(self, other: Self) -> Self {
        Self::Sum(vec![self, other])
    }
}

/// A sum of waves of variance 1 whose heights fall with the frequency, as those of a hand do.
fn shake(secs: f64, low_hz: f64, high_hz: f64, seed: Seed) -> f64 {
    let (mut sum, mut squares) = (0.0, 0.0);
    for wave in 0..SHAKE_WAVES {
        // one frequency in each of equal bands of the logarithmic scale
        let band = (wave as f64 + seed.unit(wave as i64, 0, 0)) / SHAKE_WAVES as f64;
        let frequency_hz = low_hz * (high_hz / low_hz).powf(band);
        let height = (low_hz / frequency_hz).sqrt();
        let phase = std::f64::consts::TAU * seed.unit(wave as i64, 0, 1);
        sum += height * (std::f64::consts::TAU * frequency_hz * secs + phase).sin();
        squares += 0.5 * height * height;
    }
    sum / squares.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(share: f64) -> Moment {
        Moment {
            share,
            secs: 2.0 * share,
        }
    }

    #[test]
    fn motions_begin_and_end_where_they_say() {
        let (from, to) = (3.0, 7.0);
        for track in [
            Track::Linear { from, to },
            Track::Eased { from, to },
            Track::Accelerated { from, to },
        ] {
            assert_eq!((track.at(at(0.0)), track.at(at(1.0))), (from, to));
        }
        let back = Track::Excursion {
            rest: from,
            away: to,
        };
        assert_eq!(back.at(at(0.0)), from);
        assert!((back.at(at(0.5)) - to).abs() < 1e-12 && (back.at(at(1.0)) - from).abs() < 1e-12);
    }

    #[test]
    fn a_shake_has_its_deviation_its_bound_and_no_fast_part() {
        let (low_hz, high_hz) = (0.5, 4.0);
        let shake = |seed| Track::Shake {
            deviation: 2.0,
            low_hz,
            high_hz,
            seed: Seed(seed),
        };
        for seed in 0..5 {
            let track = shake(seed);
            let value = |secs: f64| track.at(Moment { share: 0.0, secs });
            let values: Vec<f64> = (0..40_000).map(|i| value(0.05 * f64::from(i))).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let square = values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64;
            // 2000 s hold a thousand periods of the slowest wave
            assert!(mean.abs() < 0.02 && (square.sqrt() - 2.0).abs() < 0.05);
            assert!(values.iter().all(|v| v.abs() <= 3.47 * 2.0));
            // Bernstein: the slope of a band-limited sum is at most its bound times the highest frequency
            let step = 1e-3;
            let steepest = 3.47 * 2.0 * std::f64::consts::TAU * high_hz;
            assert!((0..5000).all(|i| {
                let secs = step * f64::from(i);
                (value(secs + step) - value(secs)).abs() <= steepest * step
            }));
        }
        assert_ne!(shake(0).at(at(0.3)), shake(1).at(at(0.3)));
    }
}
