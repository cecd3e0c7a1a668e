//! Light over the time of a shot: exposure that drifts or flickers, fades, and a moving bar of the sensor.

use crate::clip::track::{Moment, Track};
use serde::{Deserialize, Serialize};

/// Light of a shot. It applies to the finished frame, in linear light, before noise: `gain·c + offset + bar`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// Factor of the light, at least 0.
    pub gain: Track,
    /// Offset of each channel, in linear light.
    pub offset: Track,
    /// Height of a horizontal sine wave that is added and rolls down the frame, in linear light: 0 for none.
    pub bar: f64,
    /// Periods of that wave a second.
    pub bar_hz: f64,
    /// Frames at the beginning over which the shot appears from black.
    pub fade_in: usize,
    /// Frames at the end over which the shot goes to black.
    pub fade_out: usize,
}

impl Default for Light {
    fn default() -> Self {
        Self {
            gain: Track::Constant(1.0),
            offset: Track::Constant(0.0),
            bar: 0.0,
            bar_hz: 0.5,
            fade_in: 0,
            fade_out: 0,
        }
    }
}

/// Light of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FrameLight {
    /// Factor of the linear light, fades included.
    pub gain: f64,
    /// Offset of each channel after that.
    pub offset: f64,
    /// Height of the rolling bar: row `r` of `h` gets `bar·sin(2π(r + ½)/h − bar_phase_rad)` on top.
    pub bar: f64,
    /// Its phase.
    pub bar_phase_rad: f64,
}

impl Light {
    /// The light of frame `local` of a shot of `frames` frames.
    pub(crate) fn at(&self, moment: Moment, local: usize, frames: usize) -> FrameLight {
        let ramp = |passed: usize, length: usize| {
            if length == 0 {
                1.0
            } else {
                (passed as f64 / length as f64).min(1.0)
            }
        };
        let left = frames.saturating_sub(1).saturating_sub(local);
        let fade = ramp(local, self.fade_in) * ramp(left, self.fade_out);
        FrameLight {
            gain: fade * self.gain.at(moment),
            offset: fade * self.offset.at(moment),
            bar: fade * self.bar,
            bar_phase_rad: std::f64::consts::TAU * self.bar_hz * moment.secs,
        }
    }
}

impl FrameLight {
    /// Gain and offset of a row of a frame of `height` rows.
    pub fn of_row(&self, row: usize, height: usize) -> (f32, f32) {
        let turn = std::f64::consts::TAU * (row as f64 + 0.5) / height as f64;
        let offset = self.offset + self.bar * (turn - self.bar_phase_rad).sin();
        (self.gain as f32, offset as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fades_begin_and_end_in_black() {
        let light = Light {
            fade_in: 4,
            fade_out: 2,
            offset: Track::Constant(0.1),
            bar: 0.05,
            ..Light::default()
        };
        let at = |local: usize| {
            let share = local as f64 / 9.0;
            light.at(Moment { share, secs: share }, local, 10)
        };
        for local in [0, 9] {
            assert_eq!(
                (at(local).gain, at(local).offset, at(local).bar),
                (0.0, 0.0, 0.0)
            );
        }
        assert_eq!(
            (at(2).gain, at(4).gain, at(7).gain, at(8).gain),
            (0.5, 1.0, 1.0, 0.5)
        );
        let (gain, offset) = at(5).of_row(0, 1);
        assert_eq!(gain, 1.0);
        assert!((f64::from(offset) - 0.1).abs() <= 0.05 + 1e-6);
    }
}
