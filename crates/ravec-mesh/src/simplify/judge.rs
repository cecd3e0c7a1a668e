//! What the caller of simplification has a say in.

use glam::DVec3;

/// A collapse that is about to happen, for the caller to judge.
#[derive(Debug, Clone, Copy)]
pub struct CollapseCandidate<'a> {
    /// The vertices that are merged, by their index in the original mesh; the first one keeps its name.
    pub vertices: [u32; 2],
    /// Where these two are.
    pub from: [DVec3; 2],
    /// Where the merged vertex will be.
    pub position: DVec3,
    /// The triangles that will change, by their index in the original mesh.
    pub triangles: &'a [u32],
    /// Where the corners of `triangles` are.
    pub before: &'a [[DVec3; 3]],
    /// Where they will be, in the same order.
    pub after: &'a [[DVec3; 3]],
    /// The names they will have, by their index in the original mesh.
    pub corners: &'a [[u32; 3]],
    /// The triangles that will vanish, by their index in the original mesh.
    pub vanishing: &'a [u32],
    /// The names of their corners, by their index in the original mesh.
    pub vanishing_corners: &'a [[u32; 3]],
    /// Where these are.
    pub vanishing_at: &'a [[DVec3; 3]],
}

/// Who may refuse collapses. A closure that answers whether to refuse is one that is asked last.
pub trait CollapseJudge {
    /// Whether to refuse a collapse whose new triangles have a good shape, while the distance from the original and
    /// intersections are not examined yet: for questions that are cheaper than these.
    fn refuses_early(&mut self, candidate: &CollapseCandidate<'_>) -> bool {
        let _ = candidate;
        false
    }

    /// Whether to refuse a collapse that all other conditions allow. If not, it happens.
    fn refuses(&mut self, candidate: &CollapseCandidate<'_>) -> bool;
}

impl<F: FnMut(&CollapseCandidate<'_>) -> bool> CollapseJudge for F {
    fn refuses(&mut self, candidate: &CollapseCandidate<'_>) -> bool {
        self(candidate)
    }
}
