//! Fewer triangles for the surface, all of them proved.
//!
//! Edges are collapsed as far as the tolerance allows. A proof for each of a dozen facets that a collapse changes would cost
//! far more than the collapse; but nearly all that pass the cheap questions are proved, and nearly all are replaced by others
//! soon. So patches are simplified on trust at first, by the distance of the merged vertex, by the directions of the facets
//! around it, and by the distance of what was there before from these. Then what is left is proved, the little that is not
//! proved is undone, and there, as along the seams of patches, facets are proved before they come to be.
//!
//! Facets that lie badly then are turned (see `smooth`), which frees others to be merged: so what is whole is merged and turned
//! once more, with the error still counted from what was there first.

mod pieces;

pub(crate) use pieces::Simplified;

use crate::certify::{Tilt, likely_tilt, proved, tilt};
use crate::crest::spread;
use crate::field::{Field, Near};
use crate::grid::doubled;
use crate::params::{COARSE, Coordinates, OffsetParams};
use crate::smooth::{Facets, least_divided, smooth};
use glam::DVec3;
use ravec_mesh::{
    Adjacency, Bvh, CollapseCandidate, CollapseJudge, JudgeFactory, Keep, Simplified as Merged,
    SimplifyError, SimplifyParams, TriMesh, Trust, simplify_patches,
};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashSet;
use std::f64::consts::PI;
use std::sync::OnceLock;

/// The share of the tolerance by which simplification may leave the surface that it started from: so crests, which the
/// proof of the distance alone would let it cut, stay where they are.
const CREST_SHARE: f64 = 0.8;

/// Facets between whose corners the direction to what is nearest turns by more, as a cosine, are not trusted.
const TRUSTED_SPREAD: f64 = 0.7;

/// How much more facets may be off where the mesh is rough or many triangles would be left, relative to what they may be off
/// elsewhere.
const MOST_LEEWAY: f64 = 0.8;

/// How much a mesh bends nearly everywhere that is taken for a scan, in radians along a way as long as its diagonal. A ball bends
/// by 3.5; with three quarters of it rougher than that, a mesh is no plain shape.
const ROUGH: f64 = 4.0;

/// Where merging leaves more of the triangles than this, it is the limit of what facets are off that keeps them.
const MOST_LEFT: f64 = 1.0 / 6.0;

/// The angle from which on edges are kept as features when triangles are merged once more, in radians: by then crests end in so
/// few facets that the samples of the error may miss the tip of one.
const CREST_RAD: f64 = std::f64::consts::FRAC_PI_3;

/// How triangles are merged.
#[derive(Clone, Copy)]
pub(crate) struct Simplifier<'a> {
    proofs: Proofs<'a>,
    /// How far facets may be off wherever there is reason for leeway, in radians.
    widest_deviation: f64,
    /// How far simplification may leave what it starts from.
    max_error: f64,
    /// Whether somebody asks for a limit of what facets are off.
    has_limit: bool,
    /// Whether triangles are merged once more: where the tolerance is coarse, nothing is left to be merged.
    is_merged_twice: bool,
}

impl<'a> Simplifier<'a> {
    /// For the surface of a `mesh`, which keeps the distance between `limits`.
    pub fn new(
        field: &'a Field<'a>,
        params: &OffsetParams,
        limits: [f64; 2],
        mesh: &TriMesh,
        progress: &'a Progress,
    ) -> Result<Self, Cancelled> {
        let most_deviation = params.normal_deviation_deg().to_radians();
        progress.check()?;
        let has_limit = params.max_normal_deviation_deg.is_some();
        let widest_deviation = if has_limit {
            most_deviation
        } else {
            (1.0 + MOST_LEEWAY) * most_deviation
        };
        let is_rough = !has_limit && roughness(mesh) >= ROUGH;
        progress.check()?;
        Ok(Self {
            proofs: Proofs {
                field,
                coordinates: params.coordinates,
                limits,
                most_deviation: if is_rough {
                    widest_deviation
                } else {
                    most_deviation
                },
                progress,
            },
            widest_deviation,
            max_error: CREST_SHARE * params.tolerance,
            has_limit,
            is_merged_twice: has_limit || params.tolerance <= COARSE * params.distance,
        })
    }

    /// Merges triangles, and turns those that lie badly; all of it once more, unless `keep` knows the error only in part.
    fn whole(&self, surface: TriMesh, keep: Keep<'_>) -> Result<TriMesh, Cancelled> {
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

    /// As this one, but where merging left much of a surface, facets may be off by more.
    fn eased(&self, surface: &TriMesh, merged: &TriMesh) -> Self {
        let [before, after] = [surface, merged].map(|mesh| mesh.triangles().len());
        let most_deviation = eased(
            self.proofs.most_deviation,
            self.widest_deviation,
            before,
            after,
        );
        Self {
            proofs: Proofs {
                most_deviation,
                ..self.proofs
            },
            ..*self
        }
    }

    /// Turns facets of what was merged, and merges them once more, with the error counted from what was there first. Of the
    /// vertices that are `sealed` none goes, and no facet is turned that has two of them.
    fn merged_again(&self, mut merged: Merged, sealed: &[bool]) -> Result<Merged, Cancelled> {
        let turned = self.turned(&merged.mesh, sealed, false)?;
        move_samples(&mut merged, &turned, self.proofs.progress)?;
        let held = indices(sealed);
        let keep = Keep {
            vertices: &held,
            sealed: !sealed.is_empty(),
            samples: Some(std::mem::take(&mut merged.samples)),
            reports_samples: !sealed.is_empty(),
            ..Keep::default()
        };
        let Some(mut again) = self.merged(&turned, keep, CREST_RAD)? else {
            // it could be merged before, so that this is not to be expected
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

    /// A surface with its facets turned before any are merged, if somebody asks for a limit: merging allows facets to be off by
    /// as much as they were before, all together. Vertices and triangles keep their numbers.
    fn prepared(&self, surface: &TriMesh, sealed: &[bool]) -> Result<Option<TriMesh>, Cancelled> {
        let turned = self.has_limit.then(|| self.turned(surface, sealed, false));
        turned.transpose()
    }

    /// Turns facets that lie badly, but none with two corners that are `sealed`; with vertices added where nothing else helps,
    /// or without.
    fn turned(
        &self,
        surface: &TriMesh,
        sealed: &[bool],
        adds_vertices: bool,
    ) -> Result<TriMesh, Cancelled> {
        let Proofs {
            field,
            coordinates,
            limits,
            most_deviation,
            progress,
        } = self.proofs;
        let facets = Facets {
            field,
            coordinates,
            limits,
            most_deviation,
            least_divided: if adds_vertices {
                least_divided(surface)
            } else {
                f64::INFINITY
            },
            sealed,
        };
        smooth(surface, &facets, progress)
    }

    /// Merges triangles, with edges at which they meet at a larger angle than this kept as features; `None` if that cannot be
    /// done.
    fn merged(
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
        match simplify_patches(surface, &asked, keep, &self.proofs, self.proofs.progress) {
            Ok(simplified) => Ok(Some(simplified)),
            Err(SimplifyError::Cancelled(cancelled)) => Err(cancelled),
            // nothing else can be said against a surface of our own: keep it as it is
            Err(_) => Ok(None),
        }
    }
}

/// How far facets may be off, up to the widest, when merging left so many triangles: the number of those that stand for an edge
/// that is rounded goes with the inverse of it.
fn eased(deviation: f64, widest: f64, before: usize, after: usize) -> f64 {
    let left = after as f64 / before as f64;
    (deviation * (left / MOST_LEFT).max(1.0)).min(widest)
}

/// Moves the samples of what was merged to the triangles that are nearest once its facets are turned.
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

/// The numbers of what is marked.
fn indices(marked: &[bool]) -> Vec<u32> {
    let all = (0u32..).zip(marked);
    all.filter(|(_, is_marked)| **is_marked)
        .map(|(i, _)| i)
        .collect()
}

/// How rough a mesh is: by how many radians it bends from triangle to triangle, along a way as long as its diagonal, where it
/// bends less than elsewhere, on a quarter of it.
///
/// On what was designed, more than that is flat or straight in some direction, so that it is next to nothing. What was scanned
/// bends nearly everywhere, the more the finer its triangles are; facets that follow its offset more closely follow noise.
fn roughness(mesh: &TriMesh) -> f64 {
    let adjacency = Adjacency::new(mesh);
    let normal = |triangle: u32| {
        let [a, b, c] = mesh.corners(triangle);
        (b - a).cross(c - a)
    };
    let diagonal = mesh.bounds().diagonal();
    let mut bends: Vec<(f64, f64)> = (0..adjacency.edges().len() as u32)
        .into_par_iter()
        .filter_map(|edge| {
            let [one, other] = adjacency.uses(edge) else {
                return None;
            };
            let (m, n) = (normal(one.triangle), normal(other.triangle));
            let area = m.length() + n.length();
            let lengths = m.length() * n.length();
            let cosine = (m.dot(n) / lengths).abs().min(1.0);
            let [a, b] = adjacency.edges()[edge as usize].map(|v| mesh.positions()[v as usize]);
            // from middle to middle
            let way = area / (3.0 * a.distance(b));
            let bend = cosine.acos() / way * diagonal;
            (lengths > 0.0).then_some((bend, area))
        })
        .collect();
    bends.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let quarter = 0.25 * bends.iter().map(|(_, area)| area).sum::<f64>();
    let mut below = 0.0;
    let reached = bends.iter().find(|(_, area)| {
        below += area;
        below >= quarter
    });
    reached.map_or(0.0, |(bend, _)| *bend)
}

/// What the facets must keep to.
#[derive(Clone, Copy)]
struct Proofs<'a> {
    field: &'a Field<'a>,
    coordinates: Coordinates,
    limits: [f64; 2],
    /// In radians.
    most_deviation: f64,
    progress: &'a Progress,
}

impl Proofs<'_> {
    /// What is closest to each vertex; anything after a cancellation.
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

impl<'a> JudgeFactory for Proofs<'a> {
    type Judge = Judge<'a>;

    fn judge(&self, part: &TriMesh, trust: Trust) -> Judge<'a> {
        let nearest = self.nearest(part);
        Judge {
            proofs: *self,
            trust,
            least_cosine: self.most_deviation.cos(),
            nearest,
            lies: vec![OnceLock::new(); part.triangles().len()],
        }
    }

    /// Facets stay within the tolerance and keep their directions: where sheets are not closer than that, they cannot meet.
    fn keeps_apart(&self) -> bool {
        true
    }

    fn faults(&self, mesh: &TriMesh, triangles: &[u32]) -> Vec<u32> {
        let nearest = self.nearest(mesh);
        // rounding may put two vertices in one place, where a search for intersections takes them for one
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

/// Whether collapses keep the distance and the directions.
struct Judge<'a> {
    proofs: Proofs<'a>,
    trust: Trust,
    /// The cosine of the most that facets may be off.
    least_cosine: f64,
    /// What is closest to each vertex.
    nearest: Vec<Near>,
    /// How facets lie, as far as is known.
    lies: Vec<OnceLock<Lie>>,
}

/// What is found out about a collapse.
#[derive(Default)]
struct Findings {
    /// What is closest to the merged vertex.
    merged: Option<Near>,
    /// How the facets around it will lie.
    lies: Vec<Lie>,
}

/// How a facet lies.
#[derive(Debug, Clone, Copy)]
struct Lie {
    /// By how much it is off, beyond what is allowed, times its area.
    excess: f64,
    /// The triangle closest to its middle, or nearly.
    triangle: u32,
}

impl Judge<'_> {
    /// How a facet lies that is tilted by so much.
    fn lie(&self, [a, b, c]: [DVec3; 3], tilt: Tilt) -> Lie {
        let excess = if tilt.cosine >= self.least_cosine {
            0.0
        } else {
            let angle = tilt.cosine.acos() - self.proofs.most_deviation;
            angle * (b - a).cross(c - a).length()
        };
        Lie {
            excess,
            triangle: tilt.triangle,
        }
    }

    /// How a facet lies, by what is nearest to its corners and a triangle that may be near to its middle, and by a search only
    /// if that is not good enough.
    fn looked_at(&self, facet: [DVec3; 3], likely: [u32; 4]) -> Lie {
        let field = self.proofs.field;
        let tilted = likely_tilt(field, facet, &likely);
        let lie = self.lie(facet, tilted);
        if lie.excess > 0.0 {
            self.lie(facet, tilt(field, facet, lie.triangle))
        } else {
            lie
        }
    }

    /// How a facet lies now.
    fn lie_now(&self, t: u32, facet: [DVec3; 3], corners: [u32; 3]) -> Lie {
        let look = || {
            let [a, b, c] = corners.map(|v| self.nearest[v as usize].triangle);
            self.looked_at(facet, [a, b, c, a])
        };
        *self.lies[t as usize].get_or_init(look)
    }

    /// What all facets around the edge together are off now.
    fn excess_before(&self, candidate: &CollapseCandidate<'_>) -> f64 {
        let triangles = candidate.triangles.iter().chain(candidate.vanishing);
        let facets = candidate.before.iter().chain(candidate.vanishing_at);
        let corners = (candidate.corners_before.iter()).chain(candidate.vanishing_corners);
        let lies = (triangles.zip(facets).zip(corners))
            .map(|((&t, &facet), &corners)| self.lie_now(t, facet, corners));
        lies.map(|lie| lie.excess).sum()
    }
}

impl CollapseJudge for Judge<'_> {
    type Findings = Findings;

    fn place(&self, lowest: DVec3) -> DVec3 {
        self.proofs.coordinates.nearest(lowest)
    }

    fn refuses_early(&self, candidate: &CollapseCandidate<'_>, findings: &mut Findings) -> bool {
        let Proofs { field, limits, .. } = self.proofs;
        let [kept, removed] = candidate.vertices;
        let ends = [kept, removed].map(|v| self.nearest[v as usize].triangle);
        let merged = field.nearest_of(candidate.position, &ends).triangle;
        // at creases facets may be off, but all together no more than they were
        let mut excess = 0.0;
        let mut allowed = None;
        findings.lies.clear();
        for (i, (&facet, &corners)) in candidate.after.iter().zip(candidate.corners).enumerate() {
            let [a, b, c] = corners.map(|v| {
                if v == kept {
                    merged
                } else {
                    self.nearest[v as usize].triangle
                }
            });
            let now = self.lie_now(
                candidate.triangles[i],
                candidate.before[i],
                candidate.corners_before[i],
            );
            let lie = self.looked_at(facet, [a, b, c, now.triangle]);
            findings.lies.push(lie);
            if lie.excess > 0.0 {
                excess += lie.excess;
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
        let Proofs { field, limits, .. } = self.proofs;
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
        for (&t, &lie) in candidate.triangles.iter().zip(&findings.lies) {
            self.lies[t as usize] = OnceLock::from(lie);
        }
        if let Some(merged) = findings.merged {
            self.nearest[candidate.vertices[0] as usize] = merged;
        }
    }
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
