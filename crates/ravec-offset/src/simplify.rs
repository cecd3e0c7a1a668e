//! Fewer triangles for the surface, each change proved before it is made.
//!
//! Edges are collapsed as far as the tolerance allows. The questions of a collapse are put in the order of their cost: how
//! far the merged vertex is from the triangles (one search, and what it finds is kept for later); whether the facets around
//! it turn away from the surface they stand for (by what is closest to their corners, and a search only where that does not
//! do); then the ones of [`ravec_mesh::simplify`]; and the proof of the distance last.

use crate::certify::{keeps_distance, normal_deviation, tightened};
use crate::field::Field;
use crate::params::OffsetParams;
use glam::DVec3;
use ravec_mesh::{
    CollapseCandidate, CollapseJudge, Keep, SimplifyError, SimplifyParams, TriMesh,
    simplify_patches,
};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// The share of the tolerance by which simplification may leave the surface that it started from: so crests, which the
/// proof of the distance alone would let it cut, stay where they are.
const CREST_SHARE: f64 = 0.8;

/// Merges triangles of a surface that keeps the distance between `limits`.
pub(crate) fn simplify(
    field: &Field<'_>,
    params: &OffsetParams,
    limits: [f64; 2],
    surface: &TriMesh,
    progress: &Progress,
) -> Result<TriMesh, Cancelled> {
    let asked = SimplifyParams {
        max_error: CREST_SHARE * params.tolerance,
        both_ways: false,
        ..SimplifyParams::default()
    };
    let most_deviation = params.max_normal_deviation_deg.to_radians();
    let judge = |part: &TriMesh| Judge {
        field,
        limits,
        most_deviation,
        nearest: part
            .positions()
            .par_iter()
            .map_init(|| 0, |hint, &p| {
                *hint = field.near(p, *hint).triangle;
                *hint
            })
            .collect(),
        merged: 0,
    };
    match simplify_patches(surface, &asked, &Keep::default(), judge, progress) {
        Ok(simplified) => Ok(simplified.mesh),
        Err(SimplifyError::Cancelled(cancelled)) => Err(cancelled),
        // nothing else can be said against a surface of our own: keep it as it is
        Err(_) => Ok(surface.clone()),
    }
}

/// Whether collapses keep the distance and the directions.
struct Judge<'a> {
    field: &'a Field<'a>,
    limits: [f64; 2],
    most_deviation: f64,
    /// The triangle that each vertex is closest to.
    nearest: Vec<u32>,
    /// The one that the merged vertex is closest to.
    merged: u32,
}

impl Judge<'_> {
    /// By how much facets are off, beyond what is allowed, times their area.
    fn excess(&self, facet: [DVec3; 3], hints: [u32; 3]) -> f64 {
        let off = normal_deviation(self.field, facet, hints, self.most_deviation);
        if off <= self.most_deviation {
            return 0.0;
        }
        let [a, b, c] = facet;
        (off - self.most_deviation) * (b - a).cross(c - a).length()
    }

    /// The triangles that the corners of a facet will be closest to.
    fn hints(&self, candidate: &CollapseCandidate<'_>, corners: [u32; 3]) -> [u32; 3] {
        corners.map(|v| {
            if v == candidate.vertices[0] {
                self.merged
            } else {
                self.nearest[v as usize]
            }
        })
    }
}

impl CollapseJudge for Judge<'_> {
    fn refuses_early(&mut self, candidate: &CollapseCandidate<'_>) -> bool {
        let known = candidate.vertices.map(|v| self.nearest[v as usize]);
        let [p, q] = candidate
            .from
            .map(|p| p.distance_squared(candidate.position));
        let hint = if p <= q { known[0] } else { known[1] };
        let near = self.field.near(candidate.position, hint);
        if near.distance < self.limits[0] || near.distance > self.limits[1] {
            return true;
        }
        self.merged = near.triangle;
        // at creases facets may be off, but all together not more than they were
        let mut allowed = None;
        let mut excess = 0.0;
        for (&facet, &corners) in candidate.after.iter().zip(candidate.corners) {
            let worse = self.excess(facet, self.hints(candidate, corners));
            if worse > 0.0 {
                excess += worse;
                let allowed = *allowed.get_or_insert_with(|| {
                    candidate
                        .before
                        .iter()
                        .zip(candidate.corners)
                        .chain(candidate.vanishing_at.iter().zip(candidate.vanishing_corners))
                        .map(|(&facet, &corners)| {
                            self.excess(facet, self.hints(candidate, corners))
                        })
                        .sum::<f64>()
                });
                if excess > allowed {
                    return true;
                }
            }
        }
        false
    }

    fn refuses(&mut self, candidate: &CollapseCandidate<'_>) -> bool {
        let facets = candidate.after.iter().zip(candidate.corners);
        let refused = facets.into_iter().any(|(&facet, &corners)| {
            let hints = self.hints(candidate, corners);
            let limits = tightened(self.field, facet, self.limits, hints);
            !keeps_distance(self.field, facet, limits, hints)
        });
        if !refused {
            self.nearest[candidate.vertices[0] as usize] = self.merged;
        }
        refused
    }
}
