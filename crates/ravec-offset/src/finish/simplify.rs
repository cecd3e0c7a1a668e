//! Simplification: fewer triangles, all of them proved.
//!
//! Edges are collapsed as far as the tolerance allows. Proving the dozen facets that a collapse changes would cost far more
//! than the collapse, while nearly all candidates that pass the cheap tests are provable and soon replaced. So patches are
//! simplified on trust first, by the distance of the merged vertex, the directions of the facets around it and the distance of
//! the earlier surface. Then the remaining facets are proved, the few failures are undone, and there, as along seams of
//! patches, facets are proved before a collapse.
//!
//! Tilted facets are improved afterwards (see `smooth`), which enables further collapses: so surfaces in memory are merged and
//! improved once more, with the error still counted from the original surface.

use super::{FacetRules, Facets, min_divided_area, roughness, smooth};
use crate::domain::Field;
use crate::params::{COARSE, OffsetParams};
use ravec_mesh::{
    Bvh, Keep, Simplified as Merged, SimplifyError, SimplifyParams, TriMesh, simplify_patches,
};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Share of the tolerance by which simplification may leave the original surface. The proof of the distance alone would let it
/// cut crests.
const CREST_SHARE: f64 = 0.8;

/// Relative increase of the limit of the tilt where the mesh is rough or many triangles would remain.
const MAX_LEEWAY: f64 = 0.8;

/// Roughness above which a mesh counts as a scan, in radians along a path as long as its diagonal. A ball has 3.5.
const ROUGH: f64 = 4.0;

/// Share of remaining triangles above which the limit of the tilt is what keeps them.
const MAX_LEFT: f64 = 1.0 / 6.0;

/// Angle above which edges are features in the second merge, in radians: crests then end in so few facets that the error
/// samples may miss the tip of one.
const CREST_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// Parameters of simplification.
#[derive(Clone, Copy)]
pub(crate) struct Simplifier<'a> {
    pub(super) rules: FacetRules<'a>,
    /// Limit of the tilt with leeway, in radians.
    widest_deviation: f64,
    /// Bound on the distance from the original surface.
    max_error: f64,
    /// The caller limits the tilt.
    has_limit: bool,
    /// Triangles are merged twice; with a coarse tolerance, the second merge finds nothing.
    pub(super) is_merged_twice: bool,
}

/// Returns whether facets may be tilted more because the mesh is rough.
pub(crate) fn is_rough(mesh: &TriMesh, params: &OffsetParams) -> bool {
    params.max_normal_deviation_deg.is_none() && roughness(mesh) >= ROUGH
}

impl<'a> Simplifier<'a> {
    /// Prepares simplification of the surface of a mesh, rough or not, which keeps the distance between `limits`.
    pub fn new(
        field: &'a Field<'a>,
        params: &OffsetParams,
        limits: [f64; 2],
        is_rough: bool,
        progress: &'a Progress,
    ) -> Self {
        let max_deviation = params.normal_deviation_deg().to_radians();
        let has_limit = params.max_normal_deviation_deg.is_some();
        let widest_deviation = if has_limit {
            max_deviation
        } else {
            (1.0 + MAX_LEEWAY) * max_deviation
        };
        Self {
            rules: FacetRules {
                field,
                coordinates: params.coordinates,
                limits,
                max_deviation: if is_rough {
                    widest_deviation
                } else {
                    max_deviation
                },
                progress,
            },
            widest_deviation,
            max_error: CREST_SHARE * params.tolerance,
            has_limit,
            is_merged_twice: has_limit || params.tolerance <= COARSE * params.distance,
        }
    }

    /// Merges triangles and improves tilted ones, twice unless `keep` knows the error only in part.
    pub(super) fn whole(&self, surface: TriMesh, keep: Keep<'_>) -> Result<TriMesh, Cancelled> {
        let surface = match self.prepared(&surface, &[])? {
            Some(prepared) => prepared,
            None => surface,
        };
        let is_merged_twice = self.is_merged_twice && keep.samples.is_none();
        let keep = Keep {
            reports_samples: is_merged_twice,
            ..keep
        };
        let Some(mut merged) = self.merged(&surface, keep, PI)? else {
            return Ok(surface);
        };
        if !is_merged_twice {
            drop(surface);
            return self.turned(&merged.mesh, &[], true);
        }
        let eased = self.eased(&surface, &merged.mesh);
        drop(surface);
        merged = eased.merged_again(merged, &[])?;
        eased.turned(&merged.mesh, &[], true)
    }

    /// Returns the parameters with a wider limit of the tilt where merging left much of a surface.
    pub(super) fn eased(&self, surface: &TriMesh, merged: &TriMesh) -> Self {
        let [before, after] = [surface, merged].map(|mesh| mesh.triangles().len());
        let max_deviation = eased(
            self.rules.max_deviation,
            self.widest_deviation,
            before,
            after,
        );
        Self {
            rules: FacetRules {
                max_deviation,
                ..self.rules
            },
            ..*self
        }
    }

    /// Improves a merged surface and merges it once more, with the error counted from the original surface. No `sealed` vertex
    /// is removed, and no facet with two of them changes.
    pub(super) fn merged_again(
        &self,
        mut merged: Merged,
        sealed: &[bool],
    ) -> Result<Merged, Cancelled> {
        let turned = self.turned(&merged.mesh, sealed, false)?;
        move_samples(&mut merged, &turned, self.rules.progress)?;
        let pinned = indices(sealed);
        let keep = Keep {
            vertices: &pinned,
            sealed: !sealed.is_empty(),
            samples: Some(std::mem::take(&mut merged.samples)),
            reports_samples: !sealed.is_empty(),
            ..Keep::default()
        };
        let Some(mut again) = self.merged(&turned, keep, CREST_RAD)? else {
            // unexpected, since the first merge succeeded
            return Ok(Merged {
                mesh: turned,
                ..merged
            });
        };
        for v in &mut again.vertex_origin {
            *v = merged.vertex_origin[*v as usize];
        }
        Ok(again)
    }

    /// Improves the facets before merging if the caller limits the tilt: merging lets facets be off by as much as they were
    /// before, in total. Vertices and triangles keep their numbers.
    pub(super) fn prepared(
        &self,
        surface: &TriMesh,
        sealed: &[bool],
    ) -> Result<Option<TriMesh>, Cancelled> {
        let turned = self.has_limit.then(|| self.turned(surface, sealed, false));
        turned.transpose()
    }

    /// Improves tilted facets except those with two `sealed` corners, and adds vertices where nothing else helps if
    /// `adds_vertices`.
    pub(super) fn turned(
        &self,
        surface: &TriMesh,
        sealed: &[bool],
        adds_vertices: bool,
    ) -> Result<TriMesh, Cancelled> {
        let FacetRules {
            field,
            coordinates,
            limits,
            max_deviation,
            progress,
        } = self.rules;
        let facets = Facets {
            field,
            coordinates,
            limits,
            max_deviation,
            min_divided_area: if adds_vertices {
                min_divided_area(surface)
            } else {
                f64::INFINITY
            },
            sealed,
        };
        smooth(surface, &facets, progress)
    }

    /// Merges triangles, with edges above an angle kept as features; returns `None` if that is impossible.
    pub(super) fn merged(
        &self,
        surface: &TriMesh,
        keep: Keep<'_>,
        feature_angle_rad: f64,
    ) -> Result<Option<Merged>, Cancelled> {
        let asked = SimplifyParams {
            max_error: self.max_error,
            both_ways: false,
            feature_angle_rad,
            ..SimplifyParams::default()
        };
        match simplify_patches(surface, &asked, keep, &self.rules, self.rules.progress) {
            Ok(simplified) => Ok(Some(simplified)),
            Err(SimplifyError::Cancelled(cancelled)) => Err(cancelled),
            // no other error applies to a surface of this crate: keep it unchanged
            Err(_) => Ok(None),
        }
    }
}

/// Limit of the tilt by the share of remaining triangles: the number of triangles along a rounded edge is inversely
/// proportional to it.
fn eased(deviation: f64, widest: f64, before: usize, after: usize) -> f64 {
    let left = after as f64 / before as f64;
    (deviation * (left / MAX_LEFT).max(1.0)).min(widest)
}

/// Assigns error samples to the nearest triangles after facets are improved.
fn move_samples(
    merged: &mut Merged,
    turned: &TriMesh,
    progress: &Progress,
) -> Result<(), Cancelled> {
    let Merged { mesh, samples, .. } = merged;
    let bvh = Bvh::try_new(turned, progress)?;
    samples.par_iter_mut().try_for_each(|sample| {
        progress.check()?;
        if mesh.corners(sample.triangle) != turned.corners(sample.triangle) {
            let closest = bvh.closest_with_hint(sample.place, sample.triangle);
            sample.triangle = closest.map_or(sample.triangle, |found| found.triangle);
        }
        Ok(())
    })
}

/// Returns the indices of marked elements.
pub(super) fn indices(marked: &[bool]) -> Vec<u32> {
    let all = (0u32..).zip(marked);
    all.filter(|(_, is_marked)| **is_marked)
        .map(|(i, _)| i)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::eased;

    #[test]
    fn facets_may_be_off_by_more_where_more_than_a_sixth_is_left() {
        let of = |after| eased(4.0, 7.0, 600, after);
        assert_eq!((of(0), of(60), of(100)), (4.0, 4.0, 4.0));
        assert!((of(125) - 5.0).abs() < 1e-12);
        assert_eq!((of(200), of(600)), (7.0, 7.0));
    }
}
