//! Decisions of the caller of simplification.

use glam::DVec3;

use crate::TriMesh;

/// A collapse that is about to happen, for the caller to judge.
#[derive(Debug, Clone, Copy)]
pub struct CollapseCandidate<'a> {
    /// The vertices that are merged, by their index in the original mesh; the first one keeps its name.
    pub vertices: [u32; 2],
    /// Positions of these two.
    pub from: [DVec3; 2],
    /// Position of the merged vertex.
    pub position: DVec3,
    /// The triangles that will change, by their index in the original mesh.
    pub triangles: &'a [u32],
    /// Positions of the corners of `triangles`.
    pub before: &'a [[DVec3; 3]],
    /// The names of these corners, by their index in the original mesh.
    pub corners_before: &'a [[u32; 3]],
    /// Positions of the corners afterwards, in the same order.
    pub after: &'a [[DVec3; 3]],
    /// The names they will have, by their index in the original mesh.
    pub corners: &'a [[u32; 3]],
    /// The triangles that will vanish, by their index in the original mesh.
    pub vanishing: &'a [u32],
    /// The names of their corners, by their index in the original mesh.
    pub vanishing_corners: &'a [[u32; 3]],
    /// Positions of these corners.
    pub vanishing_at: &'a [[DVec3; 3]],
}

/// Judge that may refuse collapses. A closure that answers whether to refuse is one that is asked last.
///
/// Several collapses may be judged at the same time, and what is judged may not happen for other reasons, or be judged again
/// once its neighborhood has changed. So answers may depend only on the candidate and on the collapses around it that
/// [happened](Self::on_collapse).
pub trait CollapseJudge: Sync {
    /// Findings of a judgment, for the next question about the collapse and for its execution.
    type Findings: Default + Send;

    /// The allowed place of a merged vertex that would best be at `lowest` (default there): for vertices that may be in
    /// some places only. It is asked before all else, and not about a vertex that stays where it is.
    fn place(&self, lowest: DVec3) -> DVec3 {
        lowest
    }

    /// Returns `true` if to refuse a collapse whose new triangles have a good shape, while the distance from the
    /// original and intersections are not examined yet: for questions that are cheaper than these. The findings are
    /// those of another collapse, or new.
    fn refuses_early(
        &self,
        candidate: &CollapseCandidate<'_>,
        findings: &mut Self::Findings,
    ) -> bool {
        let _ = (candidate, findings);
        false
    }

    /// Returns `true` if to refuse a collapse that all other conditions allow.
    fn refuses(&self, candidate: &CollapseCandidate<'_>, findings: &mut Self::Findings) -> bool;

    /// A collapse that was not refused happens.
    fn on_collapse(&mut self, candidate: &CollapseCandidate<'_>, findings: &mut Self::Findings) {
        let _ = (candidate, findings);
    }
}

impl<F: Fn(&CollapseCandidate<'_>) -> bool + Sync> CollapseJudge for F {
    type Findings = ();

    fn refuses(&self, candidate: &CollapseCandidate<'_>, (): &mut ()) -> bool {
        self(candidate)
    }
}

/// Trust in the decisions of a judge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Trust {
    /// All triangles that changed are examined afterwards, by [`JudgeFactory::faults`], and what is at fault is undone: a judge may admit
    /// what is most probably right.
    Examined,
    /// Its admissions are final.
    Final,
}

/// Decisions of the caller of [`simplify_patches`](super::simplify_patches).
pub trait JudgeFactory: Sync {
    /// The kind of judges.
    type Judge: CollapseJudge;

    /// A judge for a part of the mesh. Names in candidates are indices into `part`, whose vertices are where they are by
    /// then.
    fn judge(&self, part: &TriMesh, trust: Trust) -> Self::Judge;

    /// Returns `true` if what the judges admit will hardly ever make triangles meet (default no). Then a judge that is
    /// [examined](Trust::Examined) is believed in that, too: what meets in the end is undone with what is at fault.
    /// That is cheaper than a search at each collapse, unless sheets do come close.
    fn keeps_apart(&self) -> bool {
        false
    }

    /// Those of `triangles`, which changed, that must not stay (default: none). The collapses that made them are undone, and tried again
    /// by a judge whose word is final.
    fn faults(&self, mesh: &TriMesh, triangles: &[u32]) -> Vec<u32> {
        let _ = (mesh, triangles);
        Vec::new()
    }
}
