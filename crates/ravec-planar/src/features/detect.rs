//! Extrema of the differences of blurs, to a fraction of a pixel.

use crate::features::scale_space::{FIRST_SIGMA_PX, Octave, SCALES, ScaleSpace};
use crate::features::{Feature, FeatureParams};
use glam::dvec2;
use rayon::prelude::*;

/// An extremum in the pixels of its octave.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extremum {
    pub octave: usize,
    /// Column and row with fractions: whole at pixel centers.
    pub col: f32,
    pub row: f32,
    /// The blur's number with a fraction.
    pub level: f32,
    pub response: f32,
}

impl Extremum {
    /// The blur in pixels of the octave.
    pub(super) fn sigma(&self) -> f32 {
        FIRST_SIGMA_PX as f32 * (self.level / SCALES as f32).exp2()
    }

    /// The extremum in pixels of the picture.
    pub(super) fn feature(&self, angle: f32) -> Feature {
        let step = (1u64 << self.octave) as f64;
        Feature {
            // pixel 0 of each octave is pixel 0 of the picture, whose center is at one half
            at: dvec2(self.col as f64, self.row as f64) * step + 0.5,
            sigma_px: self.sigma() as f64 * step,
            angle_rad: angle as f64,
            response: self.response as f64,
        }
    }
}

/// Pixels next to the border in which the extended border, not the picture, makes extrema.
pub(super) const MARGIN: usize = 5;

/// Moves to a neighbor when the vertex of the parabola lies there.
const MAX_MOVES: usize = 5;

/// All extrema, by octave, level, row and column.
pub(super) fn extrema(space: &ScaleSpace, params: &FeatureParams) -> Vec<Extremum> {
    let mut found = Vec::new();
    for (number, octave) in space.octaves.iter().enumerate() {
        let (width, height) = (octave.blurred[0].width(), octave.blurred[0].height());
        for level in 1..=SCALES {
            let rows: Vec<Vec<Extremum>> = (MARGIN..height.saturating_sub(MARGIN))
                .into_par_iter()
                .with_min_len(16)
                .map(|row| {
                    let mut in_row = Vec::new();
                    candidates(octave, level, row, 0.5 * params.contrast as f32, |col| {
                        in_row.extend(refine(octave, [col, row, level], params).map(|e| {
                            Extremum {
                                octave: number,
                                ..e
                            }
                        }));
                    });
                    in_row
                })
                .collect();
            found.extend(rows.into_iter().flatten());
        }
        debug_assert!(width > 0);
    }
    found
}

/// Calls `found` with each column of a row that beats its 26 neighbors.
fn candidates(octave: &Octave, level: usize, row: usize, least: f32, mut found: impl FnMut(usize)) {
    let planes: [_; 3] = std::array::from_fn(|k| &octave.differences[level - 1 + k]);
    let rows: [[&[f32]; 3]; 3] =
        planes.map(|plane| std::array::from_fn(|k| plane.row(row - 1 + k)));
    let here = rows[1][1];
    for col in MARGIN..here.len().saturating_sub(MARGIN) {
        let value = here[col];
        if value.abs() < least || value.is_nan() {
            continue;
        }
        // the neighbors in the row decide most cases
        let sign = value.signum();
        let height = sign * value;
        if sign * here[col - 1] >= height || sign * here[col + 1] > height {
            continue;
        }
        let beats = |line: &[f32], strictly: bool| {
            line[col - 1..=col + 1].iter().all(|&other| {
                let other = sign * other;
                if strictly {
                    other < height
                } else {
                    other <= height
                }
            })
        };
        // of equal neighbors the last in the order of planes, rows and columns wins
        let wins = beats(rows[1][0], true)
            && beats(rows[1][2], false)
            && rows[0].iter().all(|line| beats(line, true))
            && rows[2].iter().all(|line| beats(line, false));
        if wins {
            found(col);
        }
    }
}

/// The vertex of the parabola through the neighbors of a pixel, if it is high enough and no edge.
fn refine(
    octave: &Octave,
    [mut col, mut row, mut level]: [usize; 3],
    params: &FeatureParams,
) -> Option<Extremum> {
    let (width, height) = (octave.blurred[0].width(), octave.blurred[0].height());
    for _ in 0..=MAX_MOVES {
        let at = |dc: isize, dr: isize, dl: isize| {
            let plane = &octave.differences[level.wrapping_add_signed(dl)];
            plane[(col.wrapping_add_signed(dc), row.wrapping_add_signed(dr))]
        };
        let here = at(0, 0, 0);
        let g = [
            0.5 * (at(1, 0, 0) - at(-1, 0, 0)),
            0.5 * (at(0, 1, 0) - at(0, -1, 0)),
            0.5 * (at(0, 0, 1) - at(0, 0, -1)),
        ];
        let xx = at(1, 0, 0) + at(-1, 0, 0) - 2.0 * here;
        let yy = at(0, 1, 0) + at(0, -1, 0) - 2.0 * here;
        let ss = at(0, 0, 1) + at(0, 0, -1) - 2.0 * here;
        let xy = 0.25 * (at(1, 1, 0) - at(-1, 1, 0) - at(1, -1, 0) + at(-1, -1, 0));
        let xs = 0.25 * (at(1, 0, 1) - at(-1, 0, 1) - at(1, 0, -1) + at(-1, 0, -1));
        let ys = 0.25 * (at(0, 1, 1) - at(0, -1, 1) - at(0, 1, -1) + at(0, -1, -1));
        let hessian = glam::Mat3::from_cols_array(&[xx, xy, xs, xy, yy, ys, xs, ys, ss]);
        let step = -(hessian.inverse() * glam::Vec3::from_array(g));
        if !step.is_finite() {
            return None;
        }
        if step.abs().max_element() <= 0.5 {
            let response = here + 0.5 * glam::Vec3::from_array(g).dot(step);
            // the ratio r of the curvatures in the plane: trace² / determinant = (r + 1)² / r
            let (trace, determinant, r) = (xx + yy, xx * yy - xy * xy, params.edge_ratio as f32);
            let round = determinant > 0.0 && trace * trace * r < (r + 1.0).powi(2) * determinant;
            return (round && response.abs() >= params.contrast as f32).then_some(Extremum {
                octave: 0,
                col: col as f32 + step.x,
                row: row as f32 + step.y,
                level: level as f32 + step.z,
                response,
            });
        }
        let moved = |from: usize, by: f32, low: usize, high: usize| {
            let to = from.wrapping_add_signed(by.round().clamp(-1.0, 1.0) as isize);
            (low..=high).contains(&to).then_some(to)
        };
        col = moved(col, step.x, MARGIN, width - 1 - MARGIN)?;
        row = moved(row, step.y, MARGIN, height - 1 - MARGIN)?;
        level = moved(level, step.z, 1, SCALES)?;
    }
    None
}
