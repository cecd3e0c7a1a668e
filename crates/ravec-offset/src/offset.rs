//! The whole way from triangles to their offset surface.

use crate::certify::{keeps_distance, normal_deviation, tightened};
use crate::extract::{Extracted, extract};
use crate::field::Field;
use crate::params::{OffsetError, OffsetParams, OpenRule, Side};
use crate::refine::Refinement;
use crate::thicken::thicken;
use glam::DVec3;
use ravec_mesh::{
    Bvh, CheckParams, CollapseCandidate, Keep, SimplifyError, SimplifyParams, TriMesh, check,
    self_intersections, simplify,
};
use ravec_octree::{Frame, NodeId};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::{FxBuildHasher, FxHashMap, FxHashSet};
use std::hash::BuildHasher as _;

/// Rounds of mending after which what is left is reported.
const MOST_ROUNDS: u32 = 100;

/// The share of the tolerance by which the surface is moved off round numbers, at which sheets tend to touch exactly.
const OFF_ROUND: f64 = 0.0107;

/// What was done, and what holds for the result.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OffsetReport {
    /// Whether every facet is proved to keep the distance within the tolerance.
    pub certified: bool,
    /// Facets for which that proof failed.
    pub uncertified_facets: u64,
    /// Whether the surface is closed, manifold and consistently oriented.
    pub solid: bool,
    /// Pairs of triangles that meet where they should not.
    pub self_intersections: u64,
    /// Triangles of the result.
    pub triangles: u64,
    /// Triangles before simplification.
    pub extracted_triangles: u64,
    /// Cells of the tree, of all levels.
    pub cells: u64,
    /// The finest level of the tree that was used; the root is level 0.
    pub deepest_level: u8,
    /// How often cells were split to mend the surface.
    pub rounds: u32,
    /// Of a thickened sheet, whether its own triangles are one of the skins, unchanged but for their direction.
    pub sheet_kept: Option<bool>,
}

/// The share of the tolerance by which simplification may leave the surface that it started from, either way: so crests,
/// which the proof of the distance alone would let it cut, stay where they are.
const CREST_SHARE: f64 = 0.8;

/// An offset surface.
#[derive(Debug, Clone)]
pub struct Offset {
    /// The surface; triangles are counterclockwise seen from outside of the offset solid.
    pub mesh: TriMesh,
    /// What holds for it.
    pub report: OffsetReport,
}

/// The surface at a distance from the triangles of a mesh, which may be any triangles at all.
///
/// # Errors
/// [`OffsetError`]: no triangles, parameters out of range, a side that only closed meshes have, nothing that deep inside;
/// [`OffsetError::Cancelled`] soon after `progress` is.
pub fn offset(
    mesh: &TriMesh,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<Offset, OffsetError> {
    if mesh.triangles().is_empty() {
        return Err(OffsetError::NoTriangles);
    }
    if params.open == OpenRule::Thicken {
        return thicken(mesh, params, progress);
    }
    params.check(&mesh.bounds())?;
    surface(mesh, params, false, progress)
}

/// The surface, for parameters that were checked; with `wound`, around all that the triangles wind around, cavities too.
pub(crate) fn surface(
    mesh: &TriMesh,
    params: &OffsetParams,
    wound: bool,
    progress: &Progress,
) -> Result<Offset, OffsetError> {
    let bounds = mesh.bounds();
    let quick = CheckParams {
        self_intersections: false,
        list_limit: 0,
    };
    let boundary_edges = match params.side {
        Side::Both => 0,
        Side::Outer | Side::Inner | Side::Shell => {
            check(mesh, &quick, progress)?.boundary_edges.count
        }
    };
    let inward = matches!(params.side, Side::Inner | Side::Shell);
    if inward && boundary_edges > 0 {
        return Err(OffsetError::NotClosed { boundary_edges });
    }
    let bvh = Bvh::new(mesh);
    let is_solid = wound || inward || (params.side == Side::Outer && boundary_edges == 0);
    let level = if wound {
        0.0
    } else {
        params.distance + OFF_ROUND * params.tolerance
    };
    let field = Field::new(&bvh, is_solid, if inward { -level } else { level });
    let margin = if inward { 0.0 } else { params.distance } + 4.0 * params.tolerance;
    let mut job = Job {
        params,
        field: &field,
        proved: FxHashSet::default(),
    };
    let frame = frame_around(&bounds.grown(margin));
    let (extracted, refinement, rounds) = job.extract(frame, progress)?;
    if extracted.triangles.is_empty() {
        return Err(OffsetError::Empty {
            distance: params.distance,
        });
    }
    let deepest_level = refinement
        .tree
        .leaves()
        .map(|leaf| refinement.tree.key(leaf).level)
        .max()
        .unwrap_or(0);
    let cells = refinement.tree.len() as u64;
    drop(refinement);
    let extracted_triangles = extracted.triangles.len() as u64;
    let surface = compact(&extracted.positions, &extracted.triangles);
    let mut surface = if params.simplify {
        job.simplify(&surface, progress)?
    } else {
        surface
    };
    let uncertified_facets = job.unproved(&surface, progress)?;
    if params.side == Side::Shell {
        surface = shell(mesh, &surface);
    }
    let full = CheckParams {
        self_intersections: true,
        list_limit: 0,
    };
    let checked = check(&surface, &full, progress)?;
    Ok(Offset {
        report: OffsetReport {
            certified: uncertified_facets == 0,
            uncertified_facets,
            solid: checked.is_solid(),
            self_intersections: checked.self_intersections.map_or(0, |found| found.count),
            triangles: surface.triangles().len() as u64,
            extracted_triangles,
            cells,
            deepest_level,
            rounds,
            sheet_kept: None,
        },
        mesh: surface,
    })
}

/// A cube around a box, off its center, so that planes of symmetry do not lie in faces of cells.
fn frame_around(bounds: &ravec_mesh::Aabb) -> Frame {
    let extent = bounds.size().max_element();
    let side = 1.0713 * extent;
    let slack = 0.5 * (side - extent);
    let low = bounds.center() - DVec3::splat(0.5 * side);
    Frame {
        origin: low + slack * DVec3::new(0.137, -0.211, 0.317),
        side,
    }
}

struct Job<'a> {
    params: &'a OffsetParams,
    field: &'a Field<'a>,
    /// Facets that were proved, by a hash of their corners: all facets of the result are proved once more.
    proved: FxHashSet<u64>,
}

impl<'a> Job<'a> {
    /// The least and the largest distance that a point of the result may have.
    fn limits(&self) -> [f64; 2] {
        let &OffsetParams {
            distance,
            tolerance,
            ..
        } = self.params;
        [distance - tolerance, distance + tolerance]
    }

    /// Grows the tree and mends it until its surface is proved and does not meet itself.
    fn extract(
        &mut self,
        frame: Frame,
        progress: &Progress,
    ) -> Result<(Extracted, Refinement<'a>, u32), Cancelled> {
        let outer = self.params.side == Side::Outer;
        let mut refinement = Refinement::grow(self.field, frame, self.params.tolerance, progress)?;
        let mut rounds = 0;
        loop {
            progress.check()?;
            let extracted = extract(&refinement, outer, progress)?;
            let unproved = self.unproved_cells(&refinement, &extracted, progress)?;
            let meeting = meeting_cells(&extracted, unproved.is_empty(), progress)?;
            if rounds == MOST_ROUNDS {
                return Ok((extracted, refinement, rounds));
            }
            // what cannot be split any more is filled where triangles meet; a proof needs no second try
            let limit = refinement.limit();
            let is_coarse = |&leaf: &NodeId| refinement.tree.key(leaf).level < limit;
            let mut coarse: Vec<NodeId> = unproved.into_iter().filter(is_coarse).collect();
            let (split, finest): (Vec<NodeId>, Vec<NodeId>) =
                meeting.into_iter().partition(is_coarse);
            coarse.extend(split);
            coarse.sort_unstable();
            coarse.dedup();
            let filled = refinement.fill(&finest);
            if coarse.is_empty() && !filled {
                return Ok((extracted, refinement, rounds));
            }
            refinement.split(&coarse, progress)?;
            rounds += 1;
        }
    }

    /// The leaves of facets that are not proved.
    fn unproved_cells(
        &mut self,
        refinement: &Refinement<'_>,
        extracted: &Extracted,
        progress: &Progress,
    ) -> Result<Vec<NodeId>, Cancelled> {
        let mut bad = Vec::new();
        let facet =
            |t: usize| extracted.triangles[t].map(|corner| extracted.positions[corner as usize]);
        let limits = self.limits();
        let fresh: Vec<(usize, u64)> = (0..extracted.triangles.len())
            .map(|t| (t, hash(facet(t))))
            .filter(|(_, hash)| !self.proved.contains(hash))
            .collect();
        let phase = progress.phase("prove", fresh.len() as u64);
        let held: Vec<bool> = fresh
            .par_iter()
            .map(|&(t, _)| {
                let cells = extracted.cells_of(t);
                let hints = [0, 1, 2].map(|i| refinement.tree.data(cells[i]).hint);
                progress.check()?;
                phase.advance(1);
                let limits = tightened(self.field, facet(t), limits, hints);
                Ok(keeps_distance(self.field, facet(t), limits, hints))
            })
            .collect::<Result<_, Cancelled>>()?;
        for ((t, hash), held) in fresh.into_iter().zip(held) {
            if held {
                self.proved.insert(hash);
            } else {
                bad.extend(extracted.cells_of(t));
            }
        }
        Ok(bad)
    }

    /// Merges triangles; each change is proved before it is made.
    fn simplify(&self, surface: &TriMesh, progress: &Progress) -> Result<TriMesh, Cancelled> {
        let limits = self.limits();
        let params = SimplifyParams {
            target_triangles: 0,
            max_error: CREST_SHARE * self.params.tolerance,
            ..SimplifyParams::default()
        };
        let most_deviation = self.params.max_normal_deviation_deg.to_radians();
        // what the corners are closest to
        let mut nearest: FxHashMap<[u64; 3], u32> = FxHashMap::default();
        let mut hint = 0;
        let veto = |candidate: &CollapseCandidate<'_>| {
            let near = self.field.near(candidate.position, hint);
            hint = near.triangle;
            if near.distance < limits[0] || near.distance > limits[1] {
                return true;
            }
            nearest.insert(candidate.position.to_array().map(f64::to_bits), hint);
            let mut hints_of = |facet: [DVec3; 3]| {
                facet.map(|p| {
                    let key = p.to_array().map(f64::to_bits);
                    let known = nearest.entry(key);
                    *known.or_insert_with(|| self.field.near(p, hint).triangle)
                })
            };
            let deviation = |facet: [DVec3; 3], hints: [u32; 3]| {
                normal_deviation(self.field, facet, hints, most_deviation)
            };
            // at creases facets may be off, but not more than they were
            let mut allowed = None;
            for &facet in candidate.after {
                let worse = deviation(facet, hints_of(facet));
                if worse <= most_deviation {
                    continue;
                }
                let allowed = *allowed.get_or_insert_with(|| {
                    let before = candidate.before.iter();
                    before
                        .map(|&facet| deviation(facet, hints_of(facet)))
                        .fold(0.0, f64::max)
                });
                if worse > allowed {
                    return true;
                }
            }
            candidate.after.iter().any(|&facet| {
                let hints = hints_of(facet);
                let limits = tightened(self.field, facet, limits, hints);
                !keeps_distance(self.field, facet, limits, hints)
            })
        };
        match simplify(surface, &params, &Keep::default(), veto, progress) {
            Ok(simplified) => Ok(simplified.mesh),
            Err(SimplifyError::Cancelled(cancelled)) => Err(cancelled),
            // nothing else can be said against a surface of our own: keep it as it is
            Err(_) => Ok(surface.clone()),
        }
    }

    /// How many facets are not proved to keep the distance.
    fn unproved(&self, surface: &TriMesh, progress: &Progress) -> Result<u64, Cancelled> {
        let limits = self.limits();
        (0..surface.triangles().len() as u32)
            .into_par_iter()
            .map(|t| {
                progress.check()?;
                Ok(u64::from(!keeps_distance(
                    self.field,
                    surface.corners(t),
                    limits,
                    [0; 3],
                )))
            })
            .try_reduce(|| 0, |a, b| Ok(a + b))
    }
}

/// The cells of triangles that meet where they should not. Only cells with several sheets let them, so what is near these
/// is searched first; all is searched only if nothing was found and `thoroughly`.
fn meeting_cells(
    extracted: &Extracted,
    thoroughly: bool,
    progress: &Progress,
) -> Result<Vec<NodeId>, Cancelled> {
    let mut near = meeting_cells_of(extracted, &extracted.near_crowded_cells(), progress)?;
    near.extend(extracted.cells_with_equal_vertices());
    if !near.is_empty() || !thoroughly {
        return Ok(near);
    }
    let all: Vec<u32> = (0..extracted.triangles.len() as u32).collect();
    meeting_cells_of(extracted, &all, progress)
}

fn meeting_cells_of(
    extracted: &Extracted,
    triangles: &[u32],
    progress: &Progress,
) -> Result<Vec<NodeId>, Cancelled> {
    let chosen: Vec<[u32; 3]> = triangles
        .iter()
        .map(|&t| extracted.triangles[t as usize])
        .collect();
    let bvh = Bvh::new(&compact(&extracted.positions, &chosen));
    let pairs = self_intersections(&bvh, usize::MAX, progress)?.pairs;
    let mut cells: Vec<NodeId> = pairs
        .iter()
        .flat_map(|pair| [pair.first, pair.second])
        .flat_map(|t| extracted.cells_of(triangles[t as usize] as usize))
        .copied()
        .collect();
    cells.sort_unstable();
    cells.dedup();
    Ok(cells)
}

fn hash(facet: [DVec3; 3]) -> u64 {
    FxBuildHasher.hash_one(facet.map(|p| p.to_array().map(f64::to_bits)))
}

/// The mesh without vertices that no triangle uses.
pub(crate) fn compact(positions: &[DVec3], triangles: &[[u32; 3]]) -> TriMesh {
    let mut numbers = vec![u32::MAX; positions.len()];
    let mut used = Vec::new();
    let triangles = triangles
        .iter()
        .map(|triangle| {
            triangle.map(|corner| {
                let number = &mut numbers[corner as usize];
                if *number == u32::MAX {
                    *number = used.len() as u32;
                    used.push(positions[corner as usize]);
                }
                *number
            })
        })
        .collect();
    TriMesh::new(used, triangles).expect("corners are finite and have numbers")
}

/// The mesh with the surface inside it, turned so that the space between them is inside.
fn shell(mesh: &TriMesh, inner: &TriMesh) -> TriMesh {
    let mut positions = mesh.positions().to_vec();
    let first = positions.len() as u32;
    positions.extend(inner.positions());
    let mut triangles = mesh.triangles().to_vec();
    let turned = inner
        .triangles()
        .iter()
        .map(|&[a, b, c]| [a, c, b].map(|v| v + first));
    triangles.extend(turned);
    TriMesh::new(positions, triangles).expect("corners of both have numbers")
}
