//! Content carried from frame to frame: along the motion of the camera, fading with time.
//!
//! A measurement belongs to a place of the scene. Seen from another frame it is where the homographies between both frames
//! take it, and counts in full within [`PLATEAU`] of the look-ahead, less from there on, and not beyond.

use super::options::{corner_motion, mapped};
use crate::grid::Grid;
use glam::{DMat3, DVec2};
use ravec_raster::Size;
use std::collections::VecDeque;

/// Share of the look-ahead within which content counts in full. Less lets deformations follow sooner; with 1 they would
/// change in steps as content comes and goes.
const PLATEAU: f64 = 0.6;

/// Motions that are smaller than this share of a cell from frame to frame are those of the estimate: the camera stands.
/// Over a look-ahead of one second an eighth of a cell stays uncompensated at most.
const STILL_SHARE: f64 = 0.005;

/// By how much the largest value over time must exceed the mean for something to pass: below the first it is noise, from the
/// second on it counts in full.
const PASSING: [f64; 2] = [0.15, 0.35];

/// The weight of content at a distance of `frames`, for a look-ahead: 1 to 0.
pub(super) fn fading(frames: usize, look_ahead: usize) -> f64 {
    let share = frames as f64 / (look_ahead as f64 + 1.0);
    let beyond = ((share - PLATEAU) / (1.0 - PLATEAU)).clamp(0.0, 1.0);
    0.5 + 0.5 * (std::f64::consts::PI * beyond).cos()
}

/// A map from one frame to another; `None` is the identity.
pub(super) type Carry = Option<DMat3>;

/// Motions of the camera over the last frames of a shot.
#[derive(Debug, Clone, Default)]
pub(super) struct Camera {
    /// Number of the frame to which the first step leads.
    first: usize,
    steps: VecDeque<Carry>,
    /// The largest displacement of a corner by each step, in pixels.
    speeds: VecDeque<f64>,
}

impl Camera {
    /// For a shot that begins with frame `first`.
    pub(super) fn new(first: usize) -> Self {
        Self {
            first: first + 1,
            ..Self::default()
        }
    }

    /// Adds the motion to the next frame.
    pub(super) fn push(&mut self, frame_from_previous: DMat3, size: Size, cell_px: f64) {
        let speed = corner_motion(&frame_from_previous, size);
        let still = speed < STILL_SHARE * cell_px;
        self.steps
            .push_back((!still).then_some(frame_from_previous));
        self.speeds.push_back(if still { 0.0 } else { speed });
    }

    /// Forgets the motions that lead to frames up to `frame`.
    pub(super) fn forget(&mut self, frame: usize) {
        while self.first <= frame && !self.steps.is_empty() {
            self.steps.pop_front();
            self.speeds.pop_front();
            self.first += 1;
        }
    }

    /// Maps points of frame `from` to frame `to`.
    pub(super) fn to_from(&self, to: usize, from: usize) -> Carry {
        if to < from {
            return self.to_from(from, to).map(|matrix| matrix.inverse());
        }
        let steps = (from + 1..=to).filter_map(|frame| self.steps[frame - self.first]);
        steps.reduce(|sum, step| step * sum)
    }

    /// The largest displacement of a corner by the motions that lead to `frames`, in pixels a frame; unknown motions count as
    /// none.
    pub(super) fn speed(&self, frames: std::ops::RangeInclusive<usize>) -> f64 {
        frames
            .filter_map(|frame| self.speeds.get(frame.checked_sub(self.first)?))
            .copied()
            .fold(0.0, f64::max)
    }
}

/// A number for each unit of the grid, measured in one frame and valid for some.
#[derive(Debug, Clone)]
pub(super) struct UnitMap {
    /// The frame in whose coordinates it is.
    pub(super) frame: usize,
    /// The first and the last frame for which it is valid.
    pub(super) valid: [usize; 2],
    pub(super) values: Vec<f64>,
}

impl UnitMap {
    /// Frames between this and `frame`.
    pub(super) fn distance(&self, frame: usize) -> usize {
        let [first, last] = self.valid;
        first.saturating_sub(frame).max(frame.saturating_sub(last))
    }
}

/// View of the content from one frame.
pub(super) struct View<'a> {
    pub(super) camera: &'a Camera,
    pub(super) grid: &'a Grid,
    pub(super) frame: usize,
    pub(super) look_ahead: usize,
}

impl View<'_> {
    /// For each unit the largest of what `maps` say, carried here and faded.
    pub(super) fn largest<'m>(&self, maps: impl Iterator<Item = &'m UnitMap>) -> Vec<f64> {
        let mut largest = vec![0.0; self.grid.units[0] * self.grid.units[1]];
        for (weight, values) in self.carried(maps) {
            for (largest, value) in largest.iter_mut().zip(values) {
                *largest = f64::max(*largest, weight * value.unwrap_or(0.0));
            }
        }
        largest
    }

    /// For each unit the mean over time of what `maps` say, carried here; where something passes that exceeds it by far, the
    /// largest. So noise of single frames does not add up, and the path of an object has the importance of the object.
    pub(super) fn passing<'m>(&self, maps: impl Iterator<Item = &'m UnitMap>) -> Vec<f64> {
        let maps = self.carried(maps);
        (0..self.grid.units[0] * self.grid.units[1])
            .map(|unit| {
                let seen = || {
                    maps.iter()
                        .filter_map(move |(weight, values)| Some((*weight, values[unit]?)))
                };
                let largest =
                    seen().fold(0.0, |most, (weight, value)| f64::max(most, weight * value));
                let total: f64 = seen().map(|(weight, _)| weight).sum();
                if total <= 0.0 {
                    return 0.0;
                }
                // from the largest down, so that equal values have that mean to the last bit
                let below: f64 = seen()
                    .map(|(weight, value)| weight * (largest - value))
                    .sum();
                let mean = largest - below / total;
                let excess = largest - mean;
                let [low, high] = PASSING;
                mean + excess.max(0.0) * ((excess - low) / (high - low)).clamp(0.0, 1.0)
            })
            .collect()
    }

    /// The values of each map that counts here, where it sees a unit, and its weight.
    fn carried<'m>(&self, maps: impl Iterator<Item = &'m UnitMap>) -> Vec<(f64, Vec<Option<f64>>)> {
        let weighed = maps.map(|map| {
            let weight = fading(map.distance(self.frame), self.look_ahead);
            (weight, map)
        });
        weighed
            .filter(|(weight, _)| *weight > 0.0)
            .map(|(weight, map)| {
                let values = match self.camera.to_from(map.frame, self.frame) {
                    None => map.values.iter().copied().map(Some).collect(),
                    Some(matrix) => (0..map.values.len())
                        .map(|unit| self.sampled(&map.values, &matrix, unit))
                        .collect(),
                };
                (weight, values)
            })
            .collect()
    }

    /// The value under the middle of a unit, between the middles of four; `None` outside of the frame.
    fn sampled(&self, values: &[f64], map_from_here: &DMat3, unit: usize) -> Option<f64> {
        let [cols, rows] = self.grid.units;
        let middle = DVec2::new((unit % cols) as f64 + 0.5, (unit / cols) as f64 + 0.5);
        let unit_px = self.grid.unit_px();
        let at = mapped(map_from_here, middle * unit_px)?;
        sample(values, [cols, rows], at / unit_px)
    }
}

/// The value at a position in units, between the middles of four; `None` outside.
fn sample(values: &[f64], [cols, rows]: [usize; 2], at: DVec2) -> Option<f64> {
    if !(at.x >= 0.0 && at.y >= 0.0 && at.x <= cols as f64 && at.y <= rows as f64) {
        return None;
    }
    let at = (at - 0.5).clamp(
        DVec2::ZERO,
        DVec2::new((cols - 1) as f64, (rows - 1) as f64),
    );
    let (col, row) = (at.x as usize, at.y as usize);
    let (u, v) = (at.x - col as f64, at.y - row as f64);
    let (right, below) = ((col + 1).min(cols - 1), (row + 1).min(rows - 1));
    let value = |col: usize, row: usize| values[row * cols + col];
    let upper = (1.0 - u) * value(col, row) + u * value(right, row);
    let lower = (1.0 - u) * value(col, below) + u * value(right, below);
    Some((1.0 - v) * upper + v * lower)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec2;

    fn shift(x: f64, y: f64) -> DMat3 {
        DMat3::from_translation(dvec2(x, y))
    }

    fn size() -> Size {
        Size::new(80, 40).unwrap()
    }

    #[test]
    fn motions_add_up_both_ways_and_those_of_the_estimate_are_none() {
        let mut camera = Camera::new(5);
        for k in 0..6 {
            camera.push(shift(f64::from(k), -1.0), size(), 10.0);
        }
        camera.push(shift(0.04, 0.0), size(), 10.0);
        // the steps 1, 2 and 3 lead from frame 6 to frame 9
        let there = camera.to_from(9, 6).unwrap();
        assert!(
            mapped(&there, dvec2(1.0, 1.0))
                .unwrap()
                .distance(dvec2(7.0, -2.0))
                < 1e-12
        );
        let back = camera.to_from(6, 9).unwrap();
        assert!(
            mapped(&back, dvec2(7.0, -2.0))
                .unwrap()
                .distance(dvec2(1.0, 1.0))
                < 1e-12
        );
        assert_eq!(camera.to_from(7, 7), None);
        assert_eq!(camera.to_from(12, 11), None);
        camera.forget(8);
        assert_eq!(camera.to_from(9, 8), Some(shift(3.0, -1.0)));
        assert!((camera.speed(9..=12) - 26f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn content_fades_without_a_step() {
        assert_eq!(fading(0, 25), 1.0);
        assert_eq!(fading(15, 25), 1.0);
        assert!(fading(26, 25) < 1e-12);
        for frames in 0..40 {
            let step = fading(frames, 25) - fading(frames + 1, 25);
            assert!((0.0..0.16).contains(&step), "{frames}: {step}");
        }
    }

    #[test]
    fn a_map_is_seen_where_the_camera_takes_it() {
        let grid = Grid::new(size(), [8, 4], |_, _| 1);
        let mut camera = Camera::new(0);
        // content moves by a unit to the right in each frame
        for _ in 0..3 {
            camera.push(shift(10.0, 0.0), size(), 10.0);
        }
        let mut values = vec![0.0; 32];
        values[8 + 2] = 1.0;
        let map = UnitMap {
            frame: 0,
            valid: [0, 0],
            values,
        };
        for frame in 0..4 {
            let view = View {
                camera: &camera,
                grid: &grid,
                frame,
                look_ahead: 10,
            };
            let found = view.largest([&map].into_iter());
            for (unit, value) in found.into_iter().enumerate() {
                let expected = f64::from(u8::from(unit == 8 + 2 + frame));
                assert!((value - expected).abs() < 1e-9, "{frame} {unit}: {value}");
            }
        }
    }

    #[test]
    fn between_middles_values_are_interpolated_and_outside_there_is_none() {
        let values = [1.0, 3.0, 5.0, 7.0];
        assert_eq!(sample(&values, [2, 2], dvec2(1.0, 1.0)), Some(4.0));
        assert_eq!(sample(&values, [2, 2], dvec2(0.0, 0.0)), Some(1.0));
        assert_eq!(sample(&values, [2, 2], dvec2(2.0, 0.5)), Some(3.0));
        assert_eq!(sample(&values, [2, 2], dvec2(-0.1, 0.5)), None);
        assert_eq!(sample(&values, [2, 2], dvec2(f64::NAN, 0.5)), None);
    }

    #[test]
    fn what_passes_counts_in_full_and_noise_does_not() {
        let grid = Grid::new(size(), [8, 4], |_, _| 1);
        let mut camera = Camera::new(0);
        let maps: Vec<UnitMap> = (0..10)
            .map(|frame| {
                if frame > 0 {
                    camera.push(DMat3::IDENTITY, size(), 10.0);
                }
                let mut values = vec![0.3; 32];
                // unit 3 flickers a little, unit 5 is important once, unit 7 always
                values[3] += if frame % 2 == 0 { 0.05 } else { -0.05 };
                values[5] = if frame == 4 { 1.0 } else { 0.1 };
                values[7] = 0.9;
                UnitMap {
                    frame,
                    valid: [frame; 2],
                    values,
                }
            })
            .collect();
        let view = View {
            camera: &camera,
            grid: &grid,
            frame: 5,
            look_ahead: 20,
        };
        let found = view.passing(maps.iter());
        assert_eq!((found[0], found[7]), (0.3, 0.9));
        assert!((found[3] - 0.3).abs() < 1e-9 && (found[5] - 1.0).abs() < 1e-9);
    }
}
