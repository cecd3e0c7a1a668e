//! No fold-overs, ever: bounds on the edges.
//!
//! Let an edge along x have the components X and Y, each in units of the mean cell of the new format, and an edge along y
//! likewise. If `X − |Y| ≥ δ` for all edges along x and `Y − |X| ≥ δ` for all along y, then the cross product of any two edges
//! that meet at a corner of a cell is positive, so the Jacobian is positive at the corners, and in between, where it is a mean
//! of those. Plain scaling has X = 1, Y = 0: a solution exists whatever the energy is.
//!
//! ```text
//! the minimum of the energy, if it is within the bounds; else repeat:
//!     move each edge, less what it was moved before, to the nearest one within its bounds
//!     minimize the energy plus ρ times the squared distance of the edges from where they should be
//!     remember by how much the edges missed that
//! until all edges are within bounds half as tight, or for long enough; then blend with plain scaling until they are
//! ```
//!
//! A step's minimum differs from the last one by what another place of the edges makes, which is small: that difference is solved
//! for, in single precision.
//!
//! Source: S. Boyd et al., "Distributed optimization and statistical learning via the alternating direction method of
//! multipliers", 2011, with over-relaxation.
//!
//! Guarantees: every cell of the result has a positive Jacobian. Does not guarantee: the least energy within the bounds; what
//! is left of the way to it after the steps that are taken cannot be seen.

use crate::grid::Edge;
use crate::system::Axis;
use glam::{DVec2, Vec2Swizzles as _, dvec2};

/// Least share of its mean length that an edge keeps: δ. More keeps more of what is unimportant, and less of what is
/// not.
pub(crate) const MIN_LENGTH: f64 = 0.1;

/// The bound that is proved in the end. Between this and [`MIN_LENGTH`] the steps may stop.
pub(crate) const PROVED_LENGTH: f64 = 0.05;

/// Over-relaxation, 1 to 2. The usual value; less is slower, 2 may not converge.
const OVER_RELAXATION: f64 = 1.6;

/// Steps at least: after fewer the result still moves by visible amounts.
const MIN_STEPS: usize = 8;

/// Steps at most. Those that are still outside then differ by some hundredths, and are blended in.
const MAX_STEPS: usize = 24;

/// Steps of a solution that starts from one for a similar size.
const WARM_STEPS: usize = 4;

/// Targets of the edges and the amounts by which they were missed, for both axes, from which the solution for a similar size starts.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct State {
    wanted: [Vec<f64>; 2],
    missed: [Vec<f64>; 2],
    size: DVec2,
}

/// A deformation without folds.
pub(crate) struct Bounded {
    pub(crate) z: [Vec<f64>; 2],
    pub(crate) state: Option<State>,
    /// Edges that the minimum of the energy would shorten too much.
    pub(crate) active: usize,
    pub(crate) steps: usize,
    /// The share of plain scaling in the result.
    pub(crate) blend: f64,
}

/// The new format: its size, the scale of important content, and the length of mean units.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Format {
    pub(crate) size: DVec2,
    pub(crate) scale: f64,
    pub(crate) mean_unit: DVec2,
    /// Largest distance of vertices of free borders beyond the frame.
    pub(crate) overhang: DVec2,
}

/// Length of each edge of the grid, in units.
pub(crate) struct Edges<'a> {
    pub(crate) edges: &'a [Edge],
    pub(crate) lengths: &'a [f64],
}

impl Edges<'_> {
    /// `X − |Y|` of an edge along x, `Y − |X|` of one along y: by how much it is longer than it is oblique.
    fn slack(&self, index: usize, x: f64, y: f64, mean: DVec2) -> f64 {
        let (x, y) = (x / mean.x, y / mean.y);
        let slack = if self.edges[index].across {
            x - y.abs()
        } else {
            y - x.abs()
        };
        slack / self.lengths[index]
    }

    pub(crate) fn min_slack(&self, components: &[Vec<f64>; 2], mean: DVec2) -> f64 {
        (0..self.edges.len())
            .map(|k| self.slack(k, components[0][k], components[1][k], mean))
            .fold(f64::INFINITY, f64::min)
    }
}

/// Minimizes the energy of both axes within the bounds, starting from `warm` if there is such.
pub(crate) fn minimize(
    axes: &[Axis; 2],
    edges: &Edges<'_>,
    format: &Format,
    warm: Option<&State>,
) -> Bounded {
    let Format {
        size,
        scale,
        mean_unit,
        ..
    } = *format;
    let both = |f: &(dyn Fn(usize) -> Vec<f64> + Sync)| {
        let (x, y) = rayon::join(|| f(0), || f(1));
        [x, y]
    };
    let components = |z: &[Vec<f64>; 2]| {
        both(&|a| {
            let mut out = vec![0.0; axes[a].edges.len()];
            axes[a].edges.apply(&z[a], size[a], &mut out);
            out
        })
    };
    let mut z = both(&|a| axes[a].unbounded(size[a], scale));
    let mut now = components(&z);
    let active = (0..edges.edges.len())
        .filter(|&k| edges.slack(k, now[0][k], now[1][k], mean_unit) < MIN_LENGTH)
        .count();
    let outside = (0..2).any(|a| is_outside(&axes[a], &now[a][edges.edges.len()..], a, format));
    if active == 0 && !outside {
        return Bounded {
            z,
            state: None,
            active,
            steps: 0,
            blend: 0.0,
        };
    }
    // where the edges should be for z to be the minimum, as far as it is known
    let mut toward = now.clone();
    let mut follow = |state: &State, z: &mut [Vec<f64>; 2]| {
        let target = [0, 1].map(|a: usize| difference(&state.wanted[a], &state.missed[a]));
        let change = [0, 1].map(|a: usize| difference(&target[a], &toward[a]));
        let [x, y] = z;
        rayon::join(
            || axes[0].follow_edges(&change[0], x),
            || axes[1].follow_edges(&change[1], y),
        );
        toward = target;
    };
    let mut state = warm.map_or_else(
        || State {
            wanted: now.clone(),
            missed: now.clone().map(|values| vec![0.0; values.len()]),
            size,
        },
        |warm| warm.scaled(size),
    );
    let (least, most) = if warm.is_some() {
        (WARM_STEPS, WARM_STEPS)
    } else {
        (MIN_STEPS, MAX_STEPS)
    };
    if warm.is_some() {
        follow(&state, &mut z);
        now = components(&z);
    }
    let mut steps = 0;
    while steps < most {
        state.project(axes, edges, format, &now);
        follow(&state, &mut z);
        now = components(&z);
        steps += 1;
        if steps >= least && edges.min_slack(&now, mean_unit) >= PROVED_LENGTH {
            break;
        }
    }
    for a in 0..2 {
        for &(unknown, far) in &axes[a].edges.borders {
            let [low, high] = frame(far, size[a], format.overhang[a]);
            let at = &mut z[a][unknown as usize];
            *at = at.clamp(low, high);
        }
    }
    now = components(&z);
    // with q the slack and 1 that of plain scaling, (1 − t) q + t ≥ least; where the difference is tiny, rounding decides
    let slack = edges.min_slack(&now, mean_unit);
    let blend = if slack >= PROVED_LENGTH {
        0.0
    } else {
        ((PROVED_LENGTH - slack) / (1.0 - slack)).min(1.0)
    };
    Bounded {
        z,
        state: Some(state),
        active,
        steps,
        blend,
    }
}

/// True if a vertex of a free border, all of which are at `positions`, is out of its range.
fn is_outside(axis: &Axis, positions: &[f64], a: usize, format: &Format) -> bool {
    positions
        .iter()
        .zip(&axis.edges.borders)
        .any(|(&at, &(_, far))| {
            let [low, high] = frame(far, format.size[a], format.overhang[a]);
            !(low - 1e-9..=high + 1e-9).contains(&at)
        })
}

/// Range of a vertex on a free border.
fn frame(far: bool, length: f64, overhang: f64) -> [f64; 2] {
    if far {
        [length, length + overhang]
    } else {
        [-overhang, 0.0]
    }
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

impl State {
    /// The state for another size.
    fn scaled(&self, size: DVec2) -> Self {
        let factor = size / self.size;
        let scale = |values: &[Vec<f64>; 2]| {
            [0, 1].map(|a: usize| values[a].iter().map(|v| v * factor[a]).collect())
        };
        Self {
            wanted: scale(&self.wanted),
            missed: scale(&self.missed),
            size,
        }
    }

    /// The step of the edges: where they should be, given where they are.
    fn project(
        &mut self,
        axes: &[Axis; 2],
        edges: &Edges<'_>,
        format: &Format,
        now: &[Vec<f64>; 2],
    ) {
        let relaxed =
            |wanted: f64, now: f64| OVER_RELAXATION * now + (1.0 - OVER_RELAXATION) * wanted;
        let weights = dvec2(axes[0].stiffness, axes[1].stiffness);
        for (k, edge) in edges.edges.iter().enumerate() {
            let at = dvec2(
                relaxed(self.wanted[0][k], now[0][k]) + self.missed[0][k],
                relaxed(self.wanted[1][k], now[1][k]) + self.missed[1][k],
            );
            let unit = format.mean_unit * edges.lengths[k];
            let to = if edge.across {
                nearest_bounded(at / unit, weights * unit * unit)
            } else {
                nearest_bounded((at / unit).yx(), (weights * unit * unit).yx()).yx()
            } * unit;
            for a in 0..2 {
                self.wanted[a][k] = to[a];
                self.missed[a][k] = at[a] - to[a];
            }
        }
        for (a, axis) in axes.iter().enumerate() {
            for (index, &(_, far)) in axis.edges.borders.iter().enumerate() {
                let k = edges.edges.len() + index;
                let at = relaxed(self.wanted[a][k], now[a][k]) + self.missed[a][k];
                let [low, high] = frame(far, format.size[a], format.overhang[a]);
                self.wanted[a][k] = at.clamp(low, high);
                self.missed[a][k] = at - self.wanted[a][k];
            }
        }
    }
}

/// The point nearest to `at` with x − |y| ≥ δ, where differences along x and y are weighed by `weights`.
fn nearest_bounded(at: DVec2, weights: DVec2) -> DVec2 {
    if at.x - at.y.abs() >= MIN_LENGTH {
        return at;
    }
    // on the line x = |y| + δ, or at its corner
    let y = (weights.x * (at.x - MIN_LENGTH) + weights.y * at.y.abs()) / (weights.x + weights.y);
    let y = y.max(0.0);
    dvec2(y + MIN_LENGTH, y.copysign(at.y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_point_within_the_bounds_is_nearer(
            x in -2.0f64..2.0, y in -2.0f64..2.0, wx in 0.1f64..3.0, wy in 0.1f64..3.0,
            other_y in -3.0f64..3.0, beyond in 0.0f64..3.0,
        ) {
            let (at, weights) = (dvec2(x, y), dvec2(wx, wy));
            let distance = |to: DVec2| (weights * (to - at) * (to - at)).element_sum();
            let found = nearest_bounded(at, weights);
            prop_assert!(found.x - found.y.abs() >= MIN_LENGTH - 1e-12);
            let other = dvec2(other_y.abs() + MIN_LENGTH + beyond, other_y);
            prop_assert!(distance(found) <= distance(other) + 1e-12);
        }
    }
}
