//! State of a simplification: read by the examination of a collapse, changed by the collapse.

use glam::DVec3;

use super::deviation::{Deviation, Moves};
use super::examine::{Change, Examiner, Freedom, Limits, Plan, Veto, freedom};
use super::judge::CollapseJudge;
use super::quadric::Quadric;
use super::surface::Surface;
use crate::Aabb;
use crate::loose_octree::LooseOctree;

/// The share of the squared length of an edge that is added to its cost, for the area it stands for.
///
/// It orders the edges of flat parts, whose quadrics are rounding: short ones first, which keeps triangles in shape. A
/// larger share would prefer short edges also where the surface is curved.
const LENGTH_SHARE: f64 = 1e-9;

/// Coordinates in which the mesh has a diagonal of 1, so that squares neither overflow nor vanish in `f32`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub origin: DVec3,
    pub scale: f64,
}

impl Frame {
    #[inline]
    pub fn to_local(self, p: DVec3) -> DVec3 {
        (p - self.origin) * self.scale
    }
}

/// A collapse that was examined, for when it happens. It is kept for the next one.
pub(super) struct Collapse<F> {
    /// The permission, or the veto. If not, what else is here may be of an earlier one.
    pub verdict: Result<(), Veto>,
    pub plan: Plan,
    pub change: Change,
    moves: Moves,
    findings: F,
}

impl<F: Default> Default for Collapse<F> {
    fn default() -> Self {
        Self {
            verdict: Ok(()),
            plan: Plan {
                kept: 0,
                removed: 0,
                position: DVec3::ZERO,
            },
            change: Change::default(),
            moves: Moves::default(),
            findings: F::default(),
        }
    }
}

/// The surface and all that is known about it. An examination of an edge depends on what is at the triangles of its ends, and,
/// if there is a tree, on the triangles in the box of those that change.
pub(super) struct State<'a, J> {
    pub surface: Surface,
    pub quadrics: Vec<Quadric>,
    /// Only if the error is limited.
    pub deviation: Option<Deviation<'a>>,
    pub frame: Frame,
    pub limits: Limits,
    /// Only if triangles must not meet.
    pub tree: Option<LooseOctree>,
    /// `true` for each vertex that other triangles have; empty if there are none.
    pub sealed: Vec<bool>,
    pub judge: J,
}

impl<J: CollapseJudge> State<'_, J> {
    /// The cost of the collapse of an edge.
    #[inline]
    pub fn cost(&self, ends: [u32; 2]) -> Result<f64, Veto> {
        let planned = planned(
            &self.surface,
            &self.quadrics,
            self.frame,
            ends,
            self.limits.max_error,
        );
        planned.map(|(_, cost)| cost)
    }

    /// Examines whether an edge may collapse, and how.
    pub fn examine(
        &self,
        ends: [u32; 2],
        examiner: &mut Examiner,
        collapse: &mut Collapse<J::Findings>,
    ) {
        collapse.verdict = self.verdict(ends, examiner, collapse);
    }

    fn verdict(
        &self,
        ends: [u32; 2],
        examiner: &mut Examiner,
        collapse: &mut Collapse<J::Findings>,
    ) -> Result<(), Veto> {
        let Self {
            surface, limits, ..
        } = self;
        let Collapse {
            plan,
            change,
            moves,
            findings,
            ..
        } = collapse;
        let max_error = limits.max_error;
        (*plan, _) = planned(surface, &self.quadrics, self.frame, ends, max_error)?;
        if plan.position != surface.positions[plan.kept as usize] {
            plan.position = self.judge.place(plan.position);
        }
        examiner.gather(surface, plan, change)?;
        if !self.sealed.is_empty() {
            examiner.examine_seal(surface, plan, &self.sealed)?;
        }
        change.examine_shape(surface, plan, limits)?;
        if (self.judge).refuses_early(&change.candidate(surface, plan), findings) {
            return Err(Veto::Caller);
        }
        if let Some(deviation) = &self.deviation
            && !deviation.stays_within(
                max_error,
                &change.old(),
                &change.after,
                plan.position,
                moves,
            )
        {
            return Err(Veto::Error);
        }
        if let Some(tree) = &self.tree {
            examiner.examine_intersections(surface, plan, change, tree)?;
        }
        if (self.judge).refuses(&change.candidate(surface, plan), findings) {
            return Err(Veto::Caller);
        }
        Ok(())
    }

    /// Lets an edge collapse that was examined, since when nothing changed around it.
    pub fn collapse(&mut self, collapse: &mut Collapse<J::Findings>) {
        let (plan, change) = (collapse.plan, &collapse.change);
        let [kept, removed] = [plan.kept, plan.removed];
        let candidate = change.candidate(&self.surface, &plan);
        self.judge.on_collapse(&candidate, &mut collapse.findings);
        if let Some(deviation) = &mut self.deviation {
            deviation.accept(&change.old(), &change.changed, &collapse.moves);
        }
        let quadric = self.quadrics[removed as usize];
        self.quadrics[kept as usize] += quadric;
        if let Some(tree) = &mut self.tree {
            for &t in &change.vanishing {
                tree.remove(t);
            }
            for (&t, corners) in change.changed.iter().zip(&change.after) {
                tree.update(t, &Aabb::around(*corners));
            }
        }
        self.surface.merge(
            [kept, removed],
            plan.position,
            &change.changed,
            &change.vanishing,
        );
    }
}

/// The collapse of an edge and its cost, if its ends allow any.
#[inline]
pub(super) fn planned(
    surface: &Surface,
    quadrics: &[Quadric],
    frame: Frame,
    [a, b]: [u32; 2],
    max_error: f64,
) -> Result<(Plan, f64), Veto> {
    let freedom = freedom(surface, a, b).ok_or(Veto::Features)?;
    let quadric = quadrics[a as usize] + quadrics[b as usize];
    let [p, q] = [a, b].map(|v| surface.positions[v as usize]);
    let (kept, removed, position, value) = match freedom {
        Freedom::To([kept, removed]) => {
            let position = surface.positions[kept as usize];
            let value = quadric.at(frame.to_local(position));
            (kept, removed, position, value)
        }
        Freedom::Between([kept, removed]) => {
            let (local_p, local_q) = (frame.to_local(p), frame.to_local(q));
            let middle = 0.5 * (local_p + local_q);
            let lowest = quadric.lowest(middle);
            let position = frame.origin + lowest / frame.scale;
            // a point far away is the meeting of nearly parallel planes
            let near = lowest.distance_squared(middle) <= local_p.distance_squared(local_q);
            let (value, position) = if near && position.is_finite() {
                (quadric.at(lowest), position)
            } else {
                let others = [(local_p, p), (local_q, q), (middle, 0.5 * p + 0.5 * q)];
                let valued = others.map(|(local, place)| (quadric.at(local), place));
                let [first, rest @ ..] = valued;
                rest.into_iter().fold(
                    first,
                    |best, other| if other.0 < best.0 { other } else { best },
                )
            };
            (kept, removed, position, value)
        }
    };
    let allowed = max_error * frame.scale;
    // spares the measurement of what is hopeless
    if value > allowed * allowed * quadric.weight + quadric.rounding() && quadric.weight > 0.0 {
        return Err(Veto::Error);
    }
    let length_sq = p.distance_squared(q) * frame.scale * frame.scale;
    let cost = value + LENGTH_SHARE * length_sq * quadric.weight;
    let plan = Plan {
        kept,
        removed,
        position,
    };
    Ok((plan, cost))
}
