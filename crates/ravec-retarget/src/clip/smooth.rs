//! Deformations of key times made steady: each shape is averaged over time where it is in the scene.
//!
//! ```text
//! where the camera stands: the mean of the vertices over the keys around
//! where it moves, for each edge of the grid:
//!     the mean of the edges of the keys around, at the place to which the camera takes it
//!     the deformation whose edges are nearest to these, in the measure of the energy: borders and straight runs hold
//! ```
//!
//! Means are symmetric in time. What is important has the same shape in all keys and keeps it; the rest changes slowly, in
//! the scene and not in the frame, so that the ground does not swim.
//!
//! Guarantees: the bounds that exclude folds hold as they do for the keys. Keys that do not differ stay as they are, to the
//! last bit.

use super::options::mapped;
use super::solve::Solution;
use super::world::Camera;
use crate::deformation::Deformation;
use crate::grid::Grid;
use glam::{DMat3, DVec2, dvec2};
use std::collections::VecDeque;
use std::sync::Arc;

/// A key time with what was solved for it.
#[derive(Debug, Clone)]
pub(super) struct RawKey {
    pub(super) frame: usize,
    pub(super) solution: Arc<Solution>,
}

/// The steady deformations of key number `index`, averaged over `radius` frames on each side.
pub(super) fn steady(
    keys: &VecDeque<RawKey>,
    index: usize,
    radius: usize,
    camera: &Camera,
) -> Arc<Vec<Deformation>> {
    let key = &keys[index];
    let shares = shares(keys, index, radius);
    let same = |&(other, _): &(usize, f64)| {
        Arc::ptr_eq(&keys[other].solution.deformations, &key.solution.deformations)
    };
    if shares.iter().all(same) {
        return key.solution.deformations.clone();
    }
    let carries: Vec<Option<DMat3>> = shares
        .iter()
        .map(|&(other, _)| camera.to_from(keys[other].frame, key.frame))
        .collect();
    let still = carries.iter().all(Option::is_none);
    let found = (0..key.solution.deformations.len())
        .map(|target| {
            let others = || {
                shares
                    .iter()
                    .map(|&(other, share)| (&keys[other].solution.deformations[target], share))
            };
            let mut found = key.solution.deformations[target].clone();
            if still {
                for (vertex, at) in found.vertices.iter_mut().enumerate() {
                    *at = others()
                        .map(|(other, share)| share * other.vertices[vertex])
                        .sum();
                }
            } else {
                let toward = mean_edges(others().zip(&carries), &found.grid);
                found.vertices = key.solution.nearest(target, &toward);
            }
            found.summary.object_scale = others()
                .map(|(other, share)| share * other.summary.object_scale)
                .sum();
            found.summary.least_area = found.least_area();
            found
        })
        .collect();
    Arc::new(found)
}

/// The keys within `radius` frames and their shares in the mean: a raised cosine, times the time for which a key stands.
fn shares(keys: &VecDeque<RawKey>, index: usize, radius: usize) -> Vec<(usize, f64)> {
    let middle = keys[index].frame;
    let mut found: Vec<(usize, f64)> = keys
        .iter()
        .enumerate()
        .filter(|(_, key)| key.frame.abs_diff(middle) <= radius)
        .map(|(other, key)| {
            let before = other.checked_sub(1).map_or(key.frame, |k| keys[k].frame);
            let after = keys.get(other + 1).map_or(key.frame, |next| next.frame);
            let share = key.frame.abs_diff(middle) as f64 / (radius + 1) as f64;
            let weight = 0.5 + 0.5 * (std::f64::consts::PI * share).cos();
            (other, weight * ((after - before) as f64).max(1.0))
        })
        .collect();
    let total: f64 = found.iter().map(|(_, weight)| weight).sum();
    for (_, weight) in &mut found {
        *weight /= total;
    }
    found
}

/// For each edge of the grid the mean of `others` at the place of the scene where it is.
fn mean_edges<'a>(
    others: impl Iterator<Item = ((&'a Deformation, f64), &'a Option<DMat3>)>,
    grid: &Grid,
) -> Vec<DVec2> {
    let unit_px = grid.unit_px();
    let mut sums = vec![(DVec2::ZERO, 0.0); grid.edges.len()];
    for ((other, share), carry) in others {
        let field = EdgeField::new(other, grid);
        for (edge, (sum, total)) in grid.edges.iter().zip(&mut sums) {
            let [from, to] = edge.ends.map(|end| grid.vertices[end as usize]);
            let middle = 0.5 * dvec2((from[0] + to[0]) as f64, (from[1] + to[1]) as f64);
            let at = match carry {
                None => Some(middle),
                Some(matrix) => mapped(matrix, middle * unit_px).map(|at| at / unit_px),
            };
            if let Some(at) = at {
                let weight = share * inside(at, grid.units);
                if weight > 0.0 {
                    *sum += weight * field.at(at, edge.across);
                    *total += weight;
                }
            }
        }
    }
    // the key itself sees every edge
    sums.into_iter().map(|(sum, total)| sum / total).collect()
}

/// 1 in a frame, half on its border, 0 half a cell beyond: what enters a frame does so gradually.
fn inside(at: DVec2, units: [usize; 2]) -> f64 {
    let far = dvec2(units[0] as f64, units[1] as f64) - at;
    (at.min(far).min_element() + 0.5).clamp(0.0, 1.0)
}

/// The edges of a deformed regular grid as two fields.
struct EdgeField {
    units: [usize; 2],
    /// Edges along x, row by row, then those along y.
    across: Vec<DVec2>,
    down: Vec<DVec2>,
}

impl EdgeField {
    fn new(deformation: &Deformation, grid: &Grid) -> Self {
        let [cols, rows] = grid.units;
        let mut field = Self {
            units: grid.units,
            across: vec![DVec2::ZERO; cols * (rows + 1)],
            down: vec![DVec2::ZERO; (cols + 1) * rows],
        };
        for edge in &grid.edges {
            let [from, to] = edge.ends.map(|end| deformation.vertices[end as usize]);
            let [col, row] = grid.vertices[edge.ends[0] as usize];
            if edge.across {
                field.across[row * cols + col] = to - from;
            } else {
                field.down[row * (cols + 1) + col] = to - from;
            }
        }
        field
    }

    /// The edge whose middle is at a position in units, between the middles of four; beyond the border the last ones go on.
    fn at(&self, at: DVec2, across: bool) -> DVec2 {
        let [cols, rows] = self.units;
        let (edges, width, height, at) = if across {
            (&self.across, cols, rows + 1, at - dvec2(0.5, 0.0))
        } else {
            (&self.down, cols + 1, rows, at - dvec2(0.0, 0.5))
        };
        let last = dvec2((width - 1) as f64, (height - 1) as f64);
        let at = at.clamp(DVec2::ZERO, last);
        let (col, row) = (at.x as usize, at.y as usize);
        let (u, v) = (at.x - col as f64, at.y - row as f64);
        let (right, below) = ((col + 1).min(width - 1), (row + 1).min(height - 1));
        let edge = |col: usize, row: usize| edges[row * width + col];
        edge(col, row)
            .lerp(edge(right, row), u)
            .lerp(edge(col, below).lerp(edge(right, below), u), v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Painted, RetargetParams, Retargeter};
    use ravec_progress::Progress;
    use ravec_raster::{Image, LinearRgb, Size};

    fn deformed() -> Deformation {
        let image = Image::from_fn(Size::new(160, 120).unwrap(), |col, row| {
            let inside = (col as f64 - 60.0).hypot(row as f64 - 50.0) < 25.0;
            LinearRgb([if inside { 0.1 } else { 0.7 }; 3])
        });
        let params = RetargetParams {
            grid_cells: Some(16),
            ..RetargetParams::default()
        };
        let none = Progress::none();
        let found = Retargeter::new(&image, Painted::default(), &params, &none).unwrap();
        found.solve(Size::new(100, 120).unwrap()).unwrap()
    }

    #[test]
    fn the_field_has_each_edge_at_its_middle() {
        let found = deformed();
        let field = EdgeField::new(&found, &found.grid);
        for edge in &found.grid.edges {
            let [from, to] = edge.ends.map(|end| found.grid.vertices[end as usize]);
            let middle = 0.5 * dvec2((from[0] + to[0]) as f64, (from[1] + to[1]) as f64);
            let [a, b] = edge.ends.map(|end| found.vertices[end as usize]);
            assert!(field.at(middle, edge.across).distance(b - a) < 1e-12);
        }
    }

    #[test]
    fn the_mean_of_one_deformation_over_a_pan_is_that_deformation_moved() {
        let found = deformed();
        let grid = &found.grid;
        // by two cells
        let carry = Some(DMat3::from_translation(dvec2(20.0, 0.0)));
        let mean = mean_edges(
            [((&found, 0.5), &None), ((&found, 0.5), &carry)].into_iter(),
            grid,
        );
        let field = EdgeField::new(&found, grid);
        for (edge, mean) in grid.edges.iter().zip(mean) {
            let [from, to] = edge.ends.map(|end| grid.vertices[end as usize]);
            let middle = 0.5 * dvec2((from[0] + to[0]) as f64, (from[1] + to[1]) as f64);
            let there = middle + dvec2(2.0, 0.0);
            if there.x < 15.5 {
                let expected = 0.5 * field.at(middle, edge.across) + 0.5 * field.at(there, edge.across);
                if middle.y > 0.6 && middle.y < 11.4 && middle.x > 0.6 {
                    assert!(mean.distance(expected) < 1e-9, "{middle}");
                }
            } else if there.x > 16.5 {
                assert!(mean.distance(field.at(middle, edge.across)) < 1e-9);
            }
        }
    }
}
