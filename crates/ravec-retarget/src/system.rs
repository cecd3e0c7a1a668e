//! One axis of the deformation as a linear system, factored once.
//!
//! The energy is quadratic in the unknowns and linear in the new length W and the scale s₀, so that its minimum is
//! `W · z₁ + s₀ · z₂` with two vectors that are solved for in the analysis. The factor that is kept is that of the energy plus
//! ρ times the squared edges, which the bounds on edges need.
//!
//! Unknowns are the vertices that do not hang, and two numbers a run. Those on a border that is held stay in the system with a
//! row of their own, so that x and y have one pattern and one order of elimination.

use crate::forms::{Content, Forms};
use crate::params::{Borders, RetargetError};
use ravec_numeric::{EliminationPlan, SingleCholesky, SquareSum};

/// Position at which an unknown is fixed, if it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Anchor {
    Free,
    /// At 0.
    Near,
    /// At W.
    Far,
}

/// Linear map from the unknowns of an axis to its nodes.
#[derive(Debug, Clone)]
pub(crate) struct Unknowns {
    ends: Vec<usize>,
    parts: Vec<(u32, f64)>,
    anchors: Vec<Anchor>,
    /// For unknowns on a free border along the axis: whether it is the far one.
    border: Vec<Option<bool>>,
    positions: Vec<Option<[f64; 2]>>,
}

impl Unknowns {
    fn new(content: &Content<'_>, axis: usize, borders: Borders) -> Self {
        let grid = content.grid;
        let mut number = vec![u32::MAX; grid.vertices.len()];
        let (mut anchors, mut positions, mut border) = (Vec::new(), Vec::new(), Vec::new());
        // with symmetric borders a vertex on the far border across the axis is the one opposite
        let mut by_place = std::collections::BTreeMap::new();
        for (index, &at) in grid.vertices.iter().enumerate() {
            if grid.resolved(index as u32) != [(index as u32, 1.0)] {
                continue;
            }
            let across = 1 - axis;
            let on_border = at[across] == 0 || at[across] == grid.units[across];
            let opposite = (borders == Borders::Symmetric && on_border)
                .then(|| *by_place.entry(at[axis]).or_insert(anchors.len() as u32));
            number[index] = opposite.unwrap_or(anchors.len() as u32);
            if number[index] as usize != anchors.len() {
                continue;
            }
            let place = match at[axis] {
                0 => Anchor::Near,
                last if last == grid.units[axis] => Anchor::Far,
                _ => Anchor::Free,
            };
            if borders == Borders::Free {
                anchors.push(Anchor::Free);
                border.push((place != Anchor::Free).then_some(place == Anchor::Far));
            } else {
                anchors.push(place);
                border.push(None);
            }
            positions.push(Some([at[0] as f64, at[1] as f64]));
        }
        let (mut ends, mut parts) = (Vec::new(), Vec::new());
        for index in 0..grid.vertices.len() {
            let resolved = grid.resolved(index as u32);
            parts.extend(
                resolved
                    .into_iter()
                    .map(|(v, weight)| (number[v as usize], weight)),
            );
            ends.push(parts.len());
        }
        for _ in 0..2 * content.runs.len() {
            parts.push((anchors.len() as u32, 1.0));
            ends.push(parts.len());
            anchors.push(Anchor::Free);
            border.push(None);
            positions.push(None);
        }
        Self {
            ends,
            parts,
            anchors,
            border,
            positions,
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.anchors.len()
    }

    fn parts(&self, node: u32) -> &[(u32, f64)] {
        let node = node as usize;
        let start = if node == 0 { 0 } else { self.ends[node - 1] };
        &self.parts[start..self.ends[node]]
    }

    /// The value of a node.
    pub(crate) fn value(&self, z: &[f64], node: u32) -> f64 {
        let parts = self.parts(node).iter();
        parts
            .map(|&(unknown, weight)| weight * z[unknown as usize])
            .sum()
    }

    /// A form over nodes as one over unknowns.
    fn expand(&self, terms: &[(u32, f64)], into: &mut Vec<(usize, f64)>) {
        into.clear();
        for &(node, coefficient) in terms {
            for &(unknown, weight) in self.parts(node) {
                let value = coefficient * weight;
                match into
                    .iter_mut()
                    .find(|(known, _)| *known == unknown as usize)
                {
                    Some((_, sum)) => *sum += value,
                    None => into.push((unknown as usize, value)),
                }
            }
        }
    }

    /// Splits off the fixed unknowns: the form has 0 there afterwards, and the returned number times W is its value.
    fn take_fixed(&self, form: &mut [(usize, f64)]) -> f64 {
        let mut far = 0.0;
        for (unknown, coefficient) in form {
            if self.anchors[*unknown] == Anchor::Far {
                far += *coefficient;
            }
            if self.anchors[*unknown] != Anchor::Free {
                *coefficient = 0.0;
            }
        }
        far
    }
}

/// The edges of the grid as forms over the unknowns of an axis.
#[derive(Debug, Clone)]
pub(crate) struct EdgeForms {
    ends: Vec<usize>,
    terms: Vec<(u32, f64)>,
    /// Contribution of fixed unknowns, times W.
    far: Vec<f64>,
    /// After the edges, the unknowns on free borders along the axis, and whether it is the far one.
    pub(crate) borders: Vec<(u32, bool)>,
}

impl EdgeForms {
    /// Number of forms.
    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }

    /// Every edge's component.
    pub(crate) fn apply(&self, z: &[f64], far_side: f64, into: &mut [f64]) {
        let mut start = 0;
        for ((out, &end), far) in into.iter_mut().zip(&self.ends).zip(&self.far) {
            let terms = &self.terms[start..end];
            *out = far * far_side + terms.iter().map(|&(k, c)| c * z[k as usize]).sum::<f64>();
            start = end;
        }
    }

    /// Adds `scale` times the transposed forms times `values`.
    fn add_transposed(&self, values: &[f64], scale: f64, right: &mut [f64]) {
        let mut start = 0;
        for (&value, &end) in values.iter().zip(&self.ends) {
            for &(unknown, coefficient) in &self.terms[start..end] {
                right[unknown as usize] += coefficient * scale * value;
            }
            start = end;
        }
    }
}

/// The energy of one axis.
#[derive(Debug, Clone)]
pub(crate) struct Axis {
    pub(crate) unknowns: Unknowns,
    pub(crate) edges: EdgeForms,
    /// The weight of squared edges in the factor.
    pub(crate) stiffness: f64,
    factor: SingleCholesky,
    /// The factor of the energy alone, if it was to be kept.
    energy_factor: Option<SingleCholesky>,
    /// The minimum, likewise.
    minimum: [Vec<f64>; 2],
    /// The energy of the minimum: coefficients of W², 2 W s₀ and s₀².
    energy: [f64; 3],
}

impl Axis {
    /// The systems of both axes. With `keep` they can [change edges](Self::change_edges).
    pub(crate) fn both(
        content: &Content<'_>,
        borders: Borders,
        keep: bool,
    ) -> Result<[Self; 2], RetargetError> {
        let (x, y) = rayon::join(
            || Assembly::new(content, 0, borders),
            || Assembly::new(content, 1, borders),
        );
        // hanging vertices and merged borders are the same for both, so that one plan serves where the patterns agree
        let plan = x.plan().ok_or(RetargetError::Singular)?;
        let (x, y) = rayon::join(
            || x.factor(&plan, keep),
            || match y.factor(&plan, keep) {
                None => y.plan().and_then(|plan| y.factor(&plan, keep)),
                found => found,
            },
        );
        Ok([
            x.ok_or(RetargetError::Singular)?,
            y.ok_or(RetargetError::Singular)?,
        ])
    }

    /// The unknowns that minimize the energy without regard to folds.
    pub(crate) fn unbounded(&self, length: f64, scale: f64) -> Vec<f64> {
        let [first, second] = &self.minimum;
        let pairs = first.iter().zip(second);
        pairs.map(|(a, b)| length * a + scale * b).collect()
    }

    /// The least energy.
    pub(crate) fn min_energy(&self, length: f64, scale: f64) -> f64 {
        let [ll, ls, ss] = self.energy;
        ll * length * length + 2.0 * ls * length * scale + ss * scale * scale
    }

    /// Moves `z`, which minimizes the energy plus `stiffness` times the squared distances of the edges from where they should
    /// be, to the minimum for edges that should be elsewhere by `change`.
    ///
    /// The minimum of the energy alone is that for edges that should be where they are.
    pub(crate) fn follow_edges(&self, change: &[f64], z: &mut [f64]) {
        let mut right = vec![0.0; z.len()];
        self.edges
            .add_transposed(change, self.stiffness, &mut right);
        let mut step: Vec<f32> = right.into_iter().map(|value| value as f32).collect();
        self.factor.solve_in_place(&mut step);
        // fixed unknowns have rows of their own, with nothing on the right
        for (z, step) in z.iter_mut().zip(step) {
            *z += f64::from(step);
        }
    }
}

impl Axis {
    /// Moves `z` so that its edges change as nearly by `change` as the energy lets them, in its own measure: `weights` are those
    /// of squared edges in it. Does nothing if the factor was not kept.
    pub(crate) fn change_edges(&self, change: &[f64], weights: &[f64], z: &mut [f64]) {
        let Some(factor) = &self.energy_factor else {
            return;
        };
        let weighed: Vec<f64> = change.iter().zip(weights).map(|(c, w)| c * w).collect();
        let mut right = vec![0.0; z.len()];
        self.edges.add_transposed(&weighed, 1.0, &mut right);
        let mut step: Vec<f32> = right.into_iter().map(|value| value as f32).collect();
        factor.solve_in_place(&mut step);
        for (z, step) in z.iter_mut().zip(step) {
            *z += f64::from(step);
        }
    }
}

/// A system before it is factored.
struct Assembly {
    unknowns: Unknowns,
    forms: Forms,
    edges: EdgeForms,
    energy: SquareSum,
    right: [Vec<f64>; 2],
}

/// The stiffness of edges against the mean of the diagonal of the energy. Less lets the bounds be reached in more steps, more
/// moves the unknowns less a step.
const STIFFNESS: f64 = 0.25;

impl Assembly {
    fn new(content: &Content<'_>, axis: usize, borders: Borders) -> Self {
        let unknowns = Unknowns::new(content, axis, borders);
        let forms = content.forms(axis);
        let mut energy = SquareSum::new(unknowns.count());
        let mut right = [vec![0.0; unknowns.count()], vec![0.0; unknowns.count()]];
        let mut form = Vec::new();
        for view in forms.iter() {
            unknowns.expand(view.terms, &mut form);
            let far = view.far - unknowns.take_fixed(&mut form);
            energy.add(&form, view.weight);
            for &(unknown, coefficient) in &form {
                right[0][unknown] += view.weight * coefficient * far;
                right[1][unknown] += view.weight * coefficient * view.shift;
            }
        }
        // of the size of the other rows
        let own = content.grid.unit_px()[axis].powi(-2);
        for (unknown, &anchor) in unknowns.anchors.iter().enumerate() {
            if anchor != Anchor::Free {
                energy.add(&[(unknown, 1.0)], own);
            }
            if anchor == Anchor::Far {
                right[0][unknown] = own;
            }
        }
        let mut edges = EdgeForms {
            ends: Vec::new(),
            terms: Vec::new(),
            far: Vec::new(),
            borders: Vec::new(),
        };
        for edge in &content.grid.edges {
            unknowns.expand(&[(edge.ends[1], 1.0), (edge.ends[0], -1.0)], &mut form);
            edges.far.push(unknowns.take_fixed(&mut form));
            edges
                .terms
                .extend(form.iter().map(|&(unknown, c)| (unknown as u32, c)));
            edges.ends.push(edges.terms.len());
        }
        let mut borders = Vec::new();
        for (unknown, &place) in unknowns.border.iter().enumerate() {
            if let Some(far) = place {
                edges.far.push(0.0);
                edges.terms.push((unknown as u32, 1.0));
                edges.ends.push(edges.terms.len());
                borders.push((unknown as u32, far));
            }
        }
        edges.borders = borders;
        Self {
            unknowns,
            forms,
            edges,
            energy,
            right,
        }
    }

    fn plan(&self) -> Option<EliminationPlan> {
        EliminationPlan::new(&self.energy.matrix(), &self.unknowns.positions)
    }

    fn factor(&self, plan: &EliminationPlan, keep: bool) -> Option<Axis> {
        let matrix = self.energy.matrix();
        let stiffness = STIFFNESS * matrix.mean_diagonal();
        let (minimum, factor) = rayon::join(
            || {
                let factor = plan.factor(&matrix)?;
                let minimum = self.right.clone().map(|mut right| {
                    factor.solve_in_place(&mut right);
                    right
                });
                Some((minimum, keep.then(|| factor.single_precision())))
            },
            || {
                let mut sum = self.energy.clone();
                let mut start = 0;
                for &end in &self.edges.ends {
                    let terms = self.edges.terms[start..end].iter();
                    let form: Vec<(usize, f64)> = terms.map(|&(k, c)| (k as usize, c)).collect();
                    sum.add(&form, stiffness);
                    start = end;
                }
                plan.factor(&sum.matrix())
            },
        );
        let ((minimum, energy_factor), factor) = (minimum?, factor?);
        let mut energy = [0.0; 3];
        for form in self.forms.iter() {
            let value = |z: &[f64], far: f64, shift: f64| {
                let terms = form.terms.iter();
                let sum: f64 = terms
                    .map(|&(node, c)| c * self.unknowns.value(z, node))
                    .sum();
                sum - far - shift
            };
            let (a, b) = (
                value(&minimum[0], form.far, 0.0),
                value(&minimum[1], 0.0, form.shift),
            );
            energy[0] += form.weight * a * a;
            energy[1] += form.weight * a * b;
            energy[2] += form.weight * b * b;
        }
        Some(Axis {
            unknowns: self.unknowns.clone(),
            edges: self.edges.clone(),
            stiffness,
            factor: factor.single_precision(),
            energy_factor,
            minimum,
            energy,
        })
    }
}

#[cfg(test)]
mod tests;
