//! Places of content followed through time where the camera moves, so that they do not jitter.
//!
//! ```text
//! for each vertex of a frame: what is there is followed to the keys around
//!     a straight line in time is fitted to its displacements against plain scaling in these; it gives that in the frame
//! ```
//!
//! Displacements against plain scaling are 0 on the border, so what is followed fades out towards it. The camera's own motion
//! stays in the result, at the scale of plain scaling.
//!
//! Guarantees: no fold. Where the camera stands nothing changes.

use super::options::mapped;
use super::path::Key;
use super::smooth::{inside, time_weight};
use super::world::Camera;
use crate::deformation::Deformation;
use crate::grid::Grid;
use crate::retargeter::as_vector;
use glam::{DMat3, DVec2, dvec2};
use std::collections::VecDeque;

/// Frames on each side through which content is followed. More takes out slower jitter, and lags behind content that comes and
/// goes.
pub(super) const FOLLOWED: usize = 10;

/// Cells from the border within which what is followed fades out.
const FADE: f64 = 2.0;

/// The bound on edges below which the change is made smaller. Keys have twice as much.
const MIN_SLACK: f64 = 0.005;

/// A key as seen from a frame.
struct Seen<'a> {
    field: Displacements<'a>,
    /// Maps points of the frame to that of the key; `None` is the identity.
    carry: Option<DMat3>,
    /// Frames from the frame to the key.
    time: f64,
    weight: f64,
}

/// The deformation `own` of `frame` for target number `target`, with content where the `keys` around have it.
pub(super) fn followed(
    own: Deformation,
    keys: &VecDeque<Key>,
    target: usize,
    frame: usize,
    camera: &Camera,
) -> Deformation {
    let frames: Vec<usize> = keys.iter().map(|key| key.frame).collect();
    let near = (0..keys.len()).filter(|&k| frames[k].abs_diff(frame) <= FOLLOWED);
    let seen: Vec<Seen<'_>> = near
        .map(|k| Seen {
            field: Displacements::new(&keys[k].deformations[target]),
            carry: camera.to_from(frames[k], frame),
            time: frames[k] as f64 - frame as f64,
            weight: time_weight(&frames, k, frame, FOLLOWED),
        })
        .collect();
    if seen.iter().all(|key| key.carry.is_none()) {
        return own;
    }
    let grid = &own.grid;
    let field = Displacements::new(&own);
    let changes: Vec<DVec2> = grid
        .vertices
        .iter()
        .map(|&[col, row]| {
            let at = dvec2(col as f64, row as f64);
            let far = dvec2(grid.units[0] as f64, grid.units[1] as f64) - at;
            let fade = (at.min(far).min_element() / FADE).clamp(0.0, 1.0);
            match along_time(&seen, grid, at) {
                Some(there) => fade * (there - field.at(at)),
                None => DVec2::ZERO,
            }
        })
        .collect();
    changed(&own, &changes)
}

/// The displacement at a position in units, from a straight line in time; `None` if no key sees it.
fn along_time(seen: &[Seen<'_>], grid: &Grid, at: DVec2) -> Option<DVec2> {
    let unit_px = grid.unit_px();
    let (mut s0, mut s1, mut s2) = (0.0, 0.0, 0.0);
    let (mut sum, mut moment) = (DVec2::ZERO, DVec2::ZERO);
    for key in seen {
        let there = match &key.carry {
            None => Some(at),
            Some(matrix) => mapped(matrix, at * unit_px).map(|at| at / unit_px),
        };
        let Some(there) = there else { continue };
        let weight = key.weight * inside(there, grid.units);
        if weight > 0.0 {
            let value = weight * key.field.at(there);
            s0 += weight;
            s1 += weight * key.time;
            s2 += weight * key.time * key.time;
            sum += value;
            moment += key.time * value;
        }
    }
    // damped where all keys lie on one side, far away: a mean rather than a guess
    let s2 = s2 + 0.5 * s0;
    (s0 > 0.0).then(|| (s2 * sum - s1 * moment) / (s0 * s2 - s1 * s1))
}

/// Halvings of the interval in which the share of the changes is looked for.
const HALVINGS: usize = 8;

/// A deformation with as much of the changes as leaves no fold.
fn changed(own: &Deformation, changes: &[DVec2]) -> Deformation {
    let with = |share: f64| {
        let mut found = own.clone();
        for (at, &change) in found.vertices.iter_mut().zip(changes) {
            *at += share * change;
        }
        found
    };
    let mut found = with(1.0);
    if slack(&found) < MIN_SLACK {
        // slack is concave in the share
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if slack(&with(middle)) < MIN_SLACK {
                high = middle;
            } else {
                low = middle;
            }
        }
        found = with(low);
    }
    found.summary.least_area = found.least_area();
    found
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
