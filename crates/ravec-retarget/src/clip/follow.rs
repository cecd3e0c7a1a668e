//! Places of content followed through time where the camera moves: what is left of jitter is taken out.
//!
//! ```text
//! for each vertex of a key: what is there is followed to the keys around
//!     its displacement against plain scaling, averaged over them, takes the place of its own
//! ```
//!
//! Displacements against plain scaling are 0 on the border, so the correction fades out towards it. The camera's own motion
//! stays in the result, at the scale of plain scaling.
//!
//! Guarantees: the bounds that exclude folds hold; where the camera stands nothing changes.

use super::options::mapped;
use super::path::Key;
use super::smooth::{inside, time_shares};
use super::world::Camera;
use crate::deformation::Deformation;
use crate::grid::Grid;
use crate::retargeter::as_vector;
use glam::{DMat3, DVec2, dvec2};
use std::collections::VecDeque;
use std::sync::Arc;

/// Frames on each side through which content is followed. More takes out slower jitter, and lags behind content that comes and
/// goes.
pub(super) const FOLLOWED: usize = 8;

/// Cells from the border within which the correction fades out.
const FADE: f64 = 2.0;

/// The bound on edges below which a correction is made smaller.
const MIN_SLACK: f64 = 0.01;

/// The deformations of key number `index`, with content where it is on average.
pub(super) fn followed(
    keys: &VecDeque<Key>,
    index: usize,
    camera: &Camera,
) -> Arc<Vec<Deformation>> {
    let key = &keys[index];
    let frames: Vec<usize> = keys.iter().map(|key| key.frame).collect();
    let shares = time_shares(&frames, index, FOLLOWED);
    let carries: Vec<Option<DMat3>> = shares
        .iter()
        .map(|&(other, _)| camera.to_from(keys[other].frame, key.frame))
        .collect();
    if carries.iter().all(Option::is_none) {
        return key.deformations.clone();
    }
    let found = key.deformations.iter().enumerate();
    let found = found.map(|(target, own)| {
        let others = shares.iter().map(|&(other, share)| {
            let field = Displacements::new(&keys[other].deformations[target]);
            (field, share)
        });
        let others: Vec<_> = others.zip(&carries).collect();
        let grid = &own.grid;
        let field = Displacements::new(own);
        let corrections: Vec<DVec2> = (0..grid.vertices.len())
            .map(|vertex| {
                let [col, row] = grid.vertices[vertex];
                let at = dvec2(col as f64, row as f64);
                let (mut sum, mut total) = (DVec2::ZERO, 0.0);
                for ((other, share), carry) in &others {
                    let there = match carry {
                        None => Some(at),
                        Some(matrix) => {
                            mapped(matrix, at * grid.unit_px()).map(|at| at / grid.unit_px())
                        }
                    };
                    if let Some(there) = there {
                        let weight = share * inside(there, grid.units);
                        if weight > 0.0 {
                            sum += weight * other.at(there);
                            total += weight;
                        }
                    }
                }
                let far = dvec2(grid.units[0] as f64, grid.units[1] as f64) - at;
                let fade = (at.min(far).min_element() / FADE).clamp(0.0, 1.0);
                // the key itself sees every vertex
                fade * (sum / total - field.at(at))
            })
            .collect();
        corrected(own, &corrections)
    });
    Arc::new(found.collect())
}

/// A deformation with as much of the corrections as leaves no fold.
fn corrected(own: &Deformation, corrections: &[DVec2]) -> Deformation {
    let mut found = own.clone();
    for share in [1.0, 0.5, 0.25, 0.125] {
        for ((at, &own), &correction) in found
            .vertices
            .iter_mut()
            .zip(&own.vertices)
            .zip(corrections)
        {
            *at = own + share * correction;
        }
        if slack(&found) >= MIN_SLACK {
            found.summary.least_area = found.least_area();
            return found;
        }
    }
    own.clone()
}

/// The least by which an edge is longer than it is oblique, in units of plain scaling.
fn slack(found: &Deformation) -> f64 {
    let grid = &found.grid;
    let unit = grid.unit_px() * as_vector(found.size) / as_vector(grid.image_size);
    let slacks = grid.edges.iter().map(|edge| {
        let [from, to] = edge.ends.map(|end| found.vertices[end as usize]);
        let along = (to - from) / unit;
        if edge.across {
            along.x - along.y.abs()
        } else {
            along.y - along.x.abs()
        }
    });
    slacks.fold(f64::INFINITY, f64::min)
}

/// Displacements of the vertices of a regular grid against plain scaling.
struct Displacements<'a> {
    grid: &'a Grid,
    /// Row by row.
    values: Vec<DVec2>,
}

impl<'a> Displacements<'a> {
    fn new(found: &'a Deformation) -> Self {
        let grid = &*found.grid;
        let factor = as_vector(found.size) / as_vector(grid.image_size);
        let mut values = vec![DVec2::ZERO; found.vertices.len()];
        for (vertex, &at) in found.vertices.iter().enumerate() {
            let [col, row] = grid.vertices[vertex];
            let plain = grid.position_px(vertex as u32) * factor;
            values[row * (grid.units[0] + 1) + col] = at - plain;
        }
        Self { grid, values }
    }

    /// That at a position in units, between four vertices; beyond the border the last ones go on.
    fn at(&self, at: DVec2) -> DVec2 {
        let [cols, rows] = self.grid.units;
        let at = at.clamp(DVec2::ZERO, dvec2(cols as f64, rows as f64));
        let (col, row) = (
            (at.x as usize).min(cols.saturating_sub(1)),
            (at.y as usize).min(rows.saturating_sub(1)),
        );
        let (u, v) = (at.x - col as f64, at.y - row as f64);
        let value = |col: usize, row: usize| self.values[row * (cols + 1) + col];
        value(col, row)
            .lerp(value(col + 1, row), u)
            .lerp(value(col, row + 1).lerp(value(col + 1, row + 1), u), v)
    }
}
