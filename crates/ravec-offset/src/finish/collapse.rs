//! Rules for facets that edge collapses make.

use crate::domain::{Field, Near};
use crate::params::Coordinates;
use crate::prove::{Tilt, likely_tilt, proved, spread, tilt};
use crate::surface::doubled;
use glam::DVec3;
use ravec_mesh::{CollapseCandidate, CollapseJudge, JudgeFactory, TriMesh, Trust};
use ravec_progress::Progress;
use rayon::prelude::*;
use rustc_hash::FxHashSet;
use std::sync::OnceLock;

/// Smallest cosine between directions at the corners of a facet that is trusted without a proof.
const TRUSTED_SPREAD: f64 = 0.7;

/// Rules that facets must keep.
#[derive(Clone, Copy)]
pub(super) struct FacetRules<'a> {
    pub field: &'a Field<'a>,
    pub coordinates: Coordinates,
    pub limits: [f64; 2],
    /// In radians.
    pub max_deviation: f64,
    pub progress: &'a Progress,
}

impl FacetRules<'_> {
    /// Returns the closest point to each vertex; after a cancellation, any point.
    fn nearest(&self, mesh: &TriMesh) -> Vec<Near> {
        mesh.positions()
            .par_chunks(256)
            .flat_map_iter(|places| {
                let is_cancelled = self.progress.is_cancelled();
                let mut hint = 0;
                places.iter().map(move |&place| {
                    let near = if is_cancelled {
                        self.field.near_of(place, 0)
                    } else {
                        self.field.near(place, hint)
                    };
                    hint = near.triangle;
                    near
                })
            })
            .collect()
    }
}

impl<'a> JudgeFactory for FacetRules<'a> {
    type Judge = CollapseProver<'a>;

    fn judge(&self, part: &TriMesh, trust: Trust) -> CollapseProver<'a> {
        let nearest = self.nearest(part);
        CollapseProver {
            rules: *self,
            trust,
            min_cosine: self.max_deviation.cos(),
            nearest,
            tilts: vec![OnceLock::new(); part.triangles().len()],
        }
    }

    /// Facets stay within the tolerance and keep their directions: sheets farther apart cannot intersect.
    fn keeps_apart(&self) -> bool {
        true
    }

    fn faults(&self, mesh: &TriMesh, triangles: &[u32]) -> Vec<u32> {
        let nearest = self.nearest(mesh);
        // rounding may place two vertices at one position, which a search for intersections takes for one vertex
        let doubled = match self.coordinates {
            Coordinates::Double => FxHashSet::default(),
            Coordinates::Single => doubled(mesh.positions()),
        };
        let is_doubled = |v: u32| !doubled.is_empty() && doubled.contains(&v);
        triangles
            .par_iter()
            .copied()
            .filter(|&t| {
                if mesh.triangles()[t as usize].into_iter().any(is_doubled) {
                    return true;
                }
                let near = mesh.triangles()[t as usize].map(|v| nearest[v as usize]);
                !self.progress.is_cancelled()
                    && !proved(self.field, mesh.corners(t), self.limits, near)
            })
            .collect()
    }
}

/// Judge of collapses by distance and direction.
pub(super) struct CollapseProver<'a> {
    rules: FacetRules<'a>,
    trust: Trust,
    /// Cosine of the limit of the tilt.
    min_cosine: f64,
    /// Closest point to each vertex.
    nearest: Vec<Near>,
    /// Tilt of facets, as far as known.
    tilts: Vec<OnceLock<TiltExcess>>,
}

/// Findings about a collapse.
#[derive(Default)]
pub(super) struct Findings {
    /// Closest point to the merged vertex.
    merged: Option<Near>,
    /// Tilt of the facets around it after the collapse.
    tilts: Vec<TiltExcess>,
}

/// Tilt of a facet beyond the limit.
#[derive(Debug, Clone, Copy)]
struct TiltExcess {
    /// Excess of the angle times the area.
    excess: f64,
    /// Triangle closest to the center, or nearly.
    triangle: u32,
}

impl CollapseProver<'_> {
    /// Returns the excess of a facet with a tilt.
    fn excess(&self, [a, b, c]: [DVec3; 3], tilt: Tilt) -> TiltExcess {
        let excess = if tilt.cosine >= self.min_cosine {
            0.0
        } else {
            let angle = tilt.cosine.acos() - self.rules.max_deviation;
            angle * (b - a).cross(c - a).length()
        };
        TiltExcess {
            excess,
            triangle: tilt.triangle,
        }
    }

    /// Returns the excess of a facet by the closest triangles of its corners and one near its center; searches only if that is
    /// not good enough.
    fn tilt_near(&self, facet: [DVec3; 3], likely: [u32; 4]) -> TiltExcess {
        let field = self.rules.field;
        let tilted = likely_tilt(field, facet, &likely);
        let found = self.excess(facet, tilted);
        if found.excess > 0.0 {
            self.excess(facet, tilt(field, facet, found.triangle))
        } else {
            found
        }
    }

    /// Returns the current excess of a facet.
    fn current_tilt(&self, t: u32, facet: [DVec3; 3], corners: [u32; 3]) -> TiltExcess {
        let compute = || {
            let [a, b, c] = corners.map(|v| self.nearest[v as usize].triangle);
            self.tilt_near(facet, [a, b, c, a])
        };
        *self.tilts[t as usize].get_or_init(compute)
    }

    /// Returns the total current excess of the facets around the edge.
    fn excess_before(&self, candidate: &CollapseCandidate<'_>) -> f64 {
        let triangles = candidate.triangles.iter().chain(candidate.vanishing);
        let facets = candidate.before.iter().chain(candidate.vanishing_at);
        let corners = (candidate.corners_before.iter()).chain(candidate.vanishing_corners);
        let tilts = (triangles.zip(facets).zip(corners))
            .map(|((&t, &facet), &corners)| self.current_tilt(t, facet, corners));
        tilts.map(|found| found.excess).sum()
    }
}

impl CollapseJudge for CollapseProver<'_> {
    type Findings = Findings;

    fn place(&self, lowest: DVec3) -> DVec3 {
        self.rules.coordinates.nearest(lowest)
    }

    fn refuses_early(&self, candidate: &CollapseCandidate<'_>, findings: &mut Findings) -> bool {
        let FacetRules { field, limits, .. } = self.rules;
        let [kept, removed] = candidate.vertices;
        let ends = [kept, removed].map(|v| self.nearest[v as usize].triangle);
        let merged = field.nearest_of(candidate.position, &ends).triangle;
        // at creases, the total excess must not grow
        let mut excess = 0.0;
        let mut allowed = None;
        findings.tilts.clear();
        for (i, (&facet, &corners)) in candidate.after.iter().zip(candidate.corners).enumerate() {
            let [a, b, c] = corners.map(|v| {
                if v == kept {
                    merged
                } else {
                    self.nearest[v as usize].triangle
                }
            });
            let now = self.current_tilt(
                candidate.triangles[i],
                candidate.before[i],
                candidate.corners_before[i],
            );
            let found = self.tilt_near(facet, [a, b, c, now.triangle]);
            findings.tilts.push(found);
            if found.excess > 0.0 {
                excess += found.excess;
                if excess > *allowed.get_or_insert_with(|| self.excess_before(candidate)) {
                    return true;
                }
            }
        }
        let merged = field.near(candidate.position, merged);
        findings.merged = Some(merged);
        let [least, most] = limits;
        merged.distance < least || merged.distance > most
    }

    fn refuses(&self, candidate: &CollapseCandidate<'_>, findings: &mut Findings) -> bool {
        let FacetRules { field, limits, .. } = self.rules;
        let kept = candidate.vertices[0];
        let near_now = |v: u32| self.nearest[v as usize];
        let near = |v: u32| match findings.merged {
            Some(merged) if v == kept => merged,
            _ => near_now(v),
        };
        let mut facets = candidate.after.iter().zip(candidate.corners);
        facets.any(|(&facet, corners)| {
            let near = corners.map(near);
            (self.trust == Trust::Final || spread(&near) < TRUSTED_SPREAD)
                && !proved(field, facet, limits, near)
        })
    }

    fn on_collapse(&mut self, candidate: &CollapseCandidate<'_>, findings: &mut Findings) {
        for (&t, &found) in candidate.triangles.iter().zip(&findings.tilts) {
            self.tilts[t as usize] = OnceLock::from(found);
        }
        if let Some(merged) = findings.merged {
            self.nearest[candidate.vertices[0] as usize] = merged;
        }
    }
}
