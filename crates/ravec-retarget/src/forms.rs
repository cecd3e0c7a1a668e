//! The energies, as squares of linear forms: `Σ weight · (Σ coefficient · node − far · W − shift · s₀)²`.
//!
//! A *node* is a vertex of the grid, or one of the two numbers that describe a straight run after the deformation. x and y have
//! forms of their own and do not meet. W is the new width (for y the new height), s₀ the scale that important content gets.
//!
//! | energy | form, for each | weight |
//! | --- | --- | --- |
//! | deformation | edge of a cell: new edge − s₀ · old edge | importance |
//! | lines | sample of a run: its new place − (middle + t · half run) | [`LINE`] |
//! | directions | run along an axis: the half run across it − s₀ · the old one | [`LINE`] |
//! | relaxation | vertex between two edges in line: difference of their stretch | [`RELAXATION`] |
//! | pull | vertex on a free border: new place − the frame's border | [`PULL`] · importance |
//!
//! All are divided by the squared length of an edge, and large cells count as often as the units that they hold, so that an
//! adaptive grid has the energy of the regular one.
//!
//! If both sides of the picture change by one factor, which is s₀ then, plain scaling makes every form 0.
//!
//! Source: D. Pavić and L. Kobbelt, "Two-Colored Pixels", Eurographics 2010. We differ in the deformation energy, which has one
//! scale for all cells instead of a free one for each (objects keep their relative sizes), and in the lines, which are held to
//! a common straight line of any place, direction and length instead of neighbor to neighbor: a long soft bow costs nothing
//! between neighbors.

use crate::grid::Grid;
use crate::runs::Run;
use glam::DVec2;
use std::ops::Range;

/// The importance of what may give way. Less gives way more and folds sooner.
pub(crate) const GIVING: f64 = 0.025;

/// The weight of a sample of a line, against at most 1 of a cell. Less lets lines bend where objects push, more costs nothing
/// but digits.
const LINE: f64 = 40.0;

/// The weight of a difference of stretch. More spreads the change over important cells as well, less leaves kinks.
const RELAXATION: f64 = 0.01;

/// The weight of a free border's pull to the frame.
const PULL: f64 = 0.1;

/// A run that deviates by less than this from an axis keeps its direction.
const ALONG_AXIS_RAD: f64 = 0.035;

/// Term of a form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Deformation,
    Line,
    Direction,
    Relaxation,
    Pull,
}

#[derive(Debug, Clone, PartialEq)]
struct Form {
    end: usize,
    #[cfg(test)]
    kind: Kind,
    far: f64,
    shift: f64,
    weight: f64,
}

/// The forms of one axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Forms {
    terms: Vec<(u32, f64)>,
    forms: Vec<Form>,
}

/// A form as others see it.
pub(crate) struct FormView<'a> {
    #[cfg(test)]
    pub(crate) kind: Kind,
    pub(crate) terms: &'a [(u32, f64)],
    pub(crate) far: f64,
    pub(crate) shift: f64,
    pub(crate) weight: f64,
}

/// A straight run in units of the grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GridRun {
    pub(crate) ends: [DVec2; 2],
    /// Factor of its weight, 0 to 1.
    pub(crate) strength: f64,
}

/// Overshoot of runs beyond their ends, in units: strokes have round ends, and the last block is seldom whole.
const OVERSHOOT: f64 = 1.0;

impl GridRun {
    /// A run of the reduction that has `unit_px` pixels a unit, a little longer, within a grid of `units`.
    pub(crate) fn new(run: &Run, unit_px: f64, units: [usize; 2]) -> Self {
        let overshoot = OVERSHOOT * run.direction();
        let from = run.ends[0] / unit_px - overshoot;
        let along = run.ends[1] / unit_px + overshoot - from;
        // cut along the line, so that it stays where it is
        let (mut first, mut last) = (0.0f64, 1.0f64);
        for axis in 0..2 {
            let (a, b) = (
                -from[axis] / along[axis],
                (units[axis] as f64 - from[axis]) / along[axis],
            );
            // a run along the border is not cut by it
            if a.is_finite() && b.is_finite() {
                first = first.max(a.min(b));
                last = last.min(a.max(b));
            }
        }
        Self {
            ends: [first, last.max(first)].map(|t| from + t * along),
            strength: 1.0,
        }
    }

    /// The samples: where they are, and their place on the run, −1 to 1.
    pub(crate) fn samples(&self) -> impl Iterator<Item = (DVec2, f64)> {
        let [from, to] = self.ends;
        let count = from.distance(to).ceil().max(2.0);
        (0..=count as usize).map(move |k| {
            let share = k as f64 / count;
            (from.lerp(to, share), 2.0 * share - 1.0)
        })
    }
}

/// Content from which the forms are made.
pub(crate) struct Content<'a> {
    pub(crate) grid: &'a Grid,
    /// The weight of each cell.
    pub(crate) weights: &'a [f64],
    pub(crate) runs: &'a [GridRun],
    pub(crate) line_strength: f64,
    pub(crate) free_borders: bool,
}

impl Content<'_> {
    /// Vertices and numbers of runs.
    #[cfg(test)]
    pub(crate) fn node_count(&self) -> usize {
        self.grid.vertices.len() + 2 * self.runs.len()
    }

    /// The nodes of the middle and the half of a run.
    pub(crate) fn run_nodes(&self, run: usize) -> Range<u32> {
        let first = (self.grid.vertices.len() + 2 * run) as u32;
        first..first + 2
    }

    /// The forms along `axis`, 0 for x.
    pub(crate) fn forms(&self, axis: usize) -> Forms {
        let mut forms = Forms::default();
        self.deformation(axis, &mut forms);
        self.lines(axis, &mut forms);
        self.relaxation(&mut forms);
        if self.free_borders {
            self.pull(axis, &mut forms);
        }
        forms
    }

    fn deformation(&self, axis: usize, forms: &mut Forms) {
        let unit_px = self.grid.unit_px();
        for (cell, &weight) in self.grid.cells.iter().zip(self.weights) {
            let extent = self.grid.extent(cell);
            let units = (extent[0] * extent[1]) as f64;
            let [a, b, c, d] = cell.corners;
            for (side, along) in [([a, b], 0), ([c, d], 0), ([a, c], 1), ([b, d], 1)] {
                let length = extent[along] as f64 * unit_px[along];
                let shift = if along == axis { length } else { 0.0 };
                let terms = [(side[1], 1.0), (side[0], -1.0)];
                let weight = weight * units / (length * length);
                forms.add(Kind::Deformation, &terms, 0.0, shift, weight);
            }
        }
    }

    fn lines(&self, axis: usize, forms: &mut Forms) {
        let unit_px = self.grid.unit_px();
        let full = self.line_strength * LINE / (unit_px[axis] * unit_px[axis]);
        for (index, run) in self.runs.iter().enumerate() {
            let weight = full * run.strength;
            let nodes = self.run_nodes(index);
            let mut samples = 0.0;
            for (at, t) in run.samples() {
                let mut terms = [(nodes.start, -1.0); 6];
                terms[..4].copy_from_slice(&self.grid.weights_at(at));
                terms[5] = (nodes.start + 1, -t);
                forms.add(Kind::Line, &terms, 0.0, 0.0, weight);
                samples += 1.0;
            }
            let half = 0.5 * (run.ends[1] - run.ends[0]) * unit_px;
            if half[axis].abs() < ALONG_AXIS_RAD * half[1 - axis].abs() {
                // the mean square of t is a third
                let weight = weight * samples / 3.0;
                forms.add(
                    Kind::Direction,
                    &[(nodes.start + 1, 1.0)],
                    0.0,
                    half[axis],
                    weight,
                );
            }
        }
    }

    fn relaxation(&self, forms: &mut Forms) {
        const NONE: u32 = u32::MAX;
        let grid = self.grid;
        // for each vertex the edge that ends at it and the one that begins, along x and along y
        let mut around = vec![[[NONE; 2]; 2]; grid.vertices.len()];
        for edge in &grid.edges {
            let direction = usize::from(!edge.across);
            around[edge.ends[1] as usize][direction][0] = edge.ends[0];
            around[edge.ends[0] as usize][direction][1] = edge.ends[1];
        }
        for (vertex, neighbors) in around.iter().enumerate() {
            for (direction, &[before, after]) in neighbors.iter().enumerate() {
                if before == NONE || after == NONE {
                    continue;
                }
                let at = |v: u32| grid.vertices[v as usize][direction] as f64;
                let here = vertex as u32;
                let (low, high) = (at(here) - at(before), at(after) - at(here));
                let mean = 0.5 * (low + high);
                let terms = [
                    (before, mean / low),
                    (here, -mean / low - mean / high),
                    (after, mean / high),
                ];
                let unit = grid.unit_px()[direction];
                // the difference grows with the square of the length, and there are fewer of them
                let weight = RELAXATION / (unit * unit) / (mean * mean);
                forms.add(Kind::Relaxation, &terms, 0.0, 0.0, weight);
            }
        }
    }

    fn pull(&self, axis: usize, forms: &mut Forms) {
        let grid = self.grid;
        let unit = grid.unit_px()[axis];
        for (cell, &weight) in grid.cells.iter().zip(self.weights) {
            for &corner in &cell.corners {
                let at = grid.vertices[corner as usize][axis];
                let far = at == grid.units[axis];
                if at == 0 || far {
                    let far = f64::from(u8::from(far));
                    let weight = PULL * weight * cell.span as f64 / (unit * unit);
                    forms.add(Kind::Pull, &[(corner, 1.0)], far, 0.0, weight);
                }
            }
        }
    }
}

impl Forms {
    #[cfg_attr(
        not(test),
        expect(unused_variables, reason = "the tests look at one energy at a time")
    )]
    fn add(&mut self, kind: Kind, terms: &[(u32, f64)], far: f64, shift: f64, weight: f64) {
        self.terms.extend_from_slice(terms);
        self.forms.push(Form {
            end: self.terms.len(),
            #[cfg(test)]
            kind,
            far,
            shift,
            weight,
        });
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = FormView<'_>> {
        let mut start = 0;
        self.forms.iter().map(move |form| {
            let terms = &self.terms[start..form.end];
            start = form.end;
            FormView {
                #[cfg(test)]
                kind: form.kind,
                terms,
                far: form.far,
                shift: form.shift,
                weight: form.weight,
            }
        })
    }
}
