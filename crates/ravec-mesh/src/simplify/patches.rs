//! Simplification in parallel.
//!
//! The triangles are cut into patches by halving them again and again across the longest side of the box of their middles.
//! Patches are simplified side by side, with the vertices they share held fast. Then the mesh is put together, and what
//! is around those vertices is simplified as a whole, so that no seam remains.
//!
//! Within a patch nothing is known of the others, and so triangles of two patches might come to meet. They are searched
//! for such; patches that are involved go back to what they were, and are simplified together with the seams.
//!
//! Guarantees: as for [`simplify`](super::simplify). The patches depend on the mesh alone.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::DVec3;
use ravec_progress::{Cancelled, Phase, Progress};
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use super::deviation::{Sample, samples};
use super::engine::{Engine, Start};
use super::judge::CollapseJudge;
use super::surface::edge_key;
use super::{Keep, Simplified, SimplifyError, SimplifyParams, SimplifyReport, validate};
use crate::adjacency::is_proper;
use crate::{Adjacency, Bvh, TriMesh, for_each_self_intersection};

/// Patches have no fewer triangles than half of this: below, seams would be all there is.
const FEWEST: usize = 4096;

/// Patches have no more triangles than this: above, little is gained from fewer seams, and memory is near no more.
const MOST: usize = 16_384;

/// As many patches are aimed at as this, between these limits: enough for as many threads, and then some.
const PATCHES: usize = 8;

/// How many rings of triangles around what was held fast are simplified in the end.
const RINGS: usize = 2;

/// In no patch.
const NONE: u32 = u32::MAX;

/// The mesh between the steps. Vertices keep the names of the original throughout.
struct Assembly {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// The triangle of the original whose name each one kept.
    origin: Vec<u32>,
    features: Vec<[u32; 2]>,
    samples: Vec<Sample>,
}

/// A patch before and after.
struct Patch {
    /// Its triangles in the mesh.
    triangles: Vec<u32>,
    after: Option<After>,
}

/// What became of a patch, with the names of the mesh.
struct After {
    moved: Vec<(u32, DVec3)>,
    triangles: Vec<[u32; 3]>,
    origin: Vec<u32>,
    features: Vec<[u32; 2]>,
    /// With triangles by their place in the list.
    samples: Vec<Sample>,
    report: SimplifyReport,
}

/// Simplifies `mesh` in the caller's thread pool, by patches and then along their seams.
///
/// `judge` makes the judge of a part of the mesh, and is handed that part; names in candidates are indices into it. Its
/// vertices are at their places in the mesh, or where they were moved by then. As fewer collapses compete with one
/// another, the result may have a few more triangles than that of [`simplify`](super::simplify).
///
/// # Errors
/// As for [`simplify`](super::simplify); and [`SimplifyError::BadParameter`] if a number of triangles is asked for, since
/// patches cannot know their share.
pub fn simplify_patches<J: CollapseJudge>(
    mesh: &TriMesh,
    params: &SimplifyParams,
    keep: &Keep<'_>,
    judge: impl Fn(&TriMesh) -> J + Sync,
    progress: &Progress,
) -> Result<Simplified, SimplifyError> {
    progress.check()?;
    validate(mesh, params, keep)?;
    if params.target_triangles > 0 {
        return Err(SimplifyError::BadParameter {
            name: "target_triangles",
            value: params.target_triangles as f64,
            range: "0 where patches are simplified",
        });
    }
    let limited = params.max_error < f64::INFINITY;
    let original = (limited && params.both_ways).then(|| Bvh::new(mesh));
    let adjacency = Adjacency::new(mesh);
    progress.check()?;
    let mut assembly = Assembly {
        positions: mesh.positions().to_vec(),
        triangles: mesh.triangles().to_vec(),
        origin: (0..mesh.triangles().len() as u32).collect(),
        features: keep.features.to_vec(),
        samples: if limited {
            samples(mesh, &adjacency)
        } else {
            Vec::new()
        },
    };
    for &[a, b] in keep.features {
        if adjacency.edge_between(a, b).is_none() {
            return Err(SimplifyError::NoSuchEdge { ends: [a, b] });
        }
    }
    drop(adjacency);
    let mut fixed = vec![false; mesh.positions().len()];
    for &v in keep.vertices {
        fixed[v as usize] = true;
    }
    let phase = progress.phase("simplify", mesh.triangles().len() as u64);
    let task = Task {
        params,
        original: original.as_ref(),
        phase: &phase,
        progress,
    };
    let mut report = SimplifyReport {
        triangles_before: mesh.triangles().len() as u64,
        ..SimplifyReport::default()
    };
    let mut held = None;
    let groups = cut(mesh);
    if groups.len() > 1 {
        held = Some(task.simplify_apart(&mut assembly, &fixed, groups, &judge, &mut report)?);
    }
    task.simplify_whole(&assembly, &fixed, held, judge, report)
}

/// What all parts have in common.
struct Task<'a> {
    params: &'a SimplifyParams,
    original: Option<&'a Bvh>,
    phase: &'a Phase,
    progress: &'a Progress,
}

impl Task<'_> {
    /// Simplifies patches, and says of each vertex whether it was held fast or went back to what it was.
    fn simplify_apart<J: CollapseJudge>(
        &self,
        assembly: &mut Assembly,
        fixed: &[bool],
        groups: Vec<Vec<u32>>,
        judge: &(impl Fn(&TriMesh) -> J + Sync),
        report: &mut SimplifyReport,
    ) -> Result<Vec<bool>, SimplifyError> {
        let (patch_of, mut held) = borders(assembly, &groups);
        let mut samples_of = vec![Vec::new(); groups.len()];
        for sample in &assembly.samples {
            samples_of[patch_of[sample.triangle as usize] as usize].push(*sample);
        }
        let shared = &*assembly;
        let mut patches: Vec<Patch> = groups
            .into_par_iter()
            .zip(samples_of)
            .map(|(triangles, samples)| {
                let after = self.simplify_patch(shared, fixed, &held, &triangles, samples, judge)?;
                Ok(Patch {
                    triangles,
                    after: Some(after),
                })
            })
            .collect::<Result<_, SimplifyError>>()?;
        loop {
            let (next, of_patch) = assembly.with(&patches);
            let mut back = false;
            if self.params.avoid_intersections {
                let meeting = meeting(&next, &of_patch, patches.len(), self.progress)?;
                for (patch, _) in patches.iter_mut().zip(meeting).filter(|(_, meets)| *meets) {
                    back |= patch.after.take().is_some();
                }
            }
            if back {
                continue;
            }
            for patch in &patches {
                match &patch.after {
                    Some(after) => report.add(&after.report),
                    None => {
                        for &t in &patch.triangles {
                            for v in assembly.triangles[t as usize] {
                                held[v as usize] = true;
                            }
                        }
                    }
                }
            }
            *assembly = next;
            return Ok(held);
        }
    }

    fn simplify_patch<J: CollapseJudge>(
        &self,
        assembly: &Assembly,
        fixed: &[bool],
        held: &[bool],
        triangles: &[u32],
        mut samples: Vec<Sample>,
        judge: &impl Fn(&TriMesh) -> J,
    ) -> Result<After, SimplifyError> {
        let mut names: FxHashMap<u32, u32> = FxHashMap::default();
        let mut vertices = Vec::new();
        let corners: Vec<[u32; 3]> = triangles
            .iter()
            .map(|&t| {
                assembly.triangles[t as usize].map(|v| {
                    *names.entry(v).or_insert_with(|| {
                        vertices.push(v);
                        vertices.len() as u32 - 1
                    })
                })
            })
            .collect();
        let places: FxHashMap<u32, u32> = triangles.iter().copied().zip(0..).collect();
        for sample in &mut samples {
            sample.triangle = places[&sample.triangle];
        }
        let positions = vertices.iter().map(|&v| assembly.positions[v as usize]);
        let part = TriMesh::new(positions.collect(), corners).expect("names were just given");
        let kept: Vec<u32> = (0_u32..)
            .zip(&vertices)
            .filter(|&(_, &v)| fixed[v as usize] || held[v as usize])
            .map(|(local, _)| local)
            .collect();
        let edges: FxHashSet<u64> = part
            .triangles()
            .iter()
            .filter(|corners| is_proper(**corners))
            .flat_map(|&[a, b, c]| [edge_key(a, b), edge_key(b, c), edge_key(c, a)])
            .collect();
        let features: Vec<[u32; 2]> = assembly
            .features
            .iter()
            .filter_map(|[a, b]| Some([*names.get(a)?, *names.get(b)?]))
            .filter(|&[a, b]| edges.contains(&edge_key(a, b)))
            .collect();
        let start = Start {
            mesh: &part,
            params: self.params,
            keep: Keep {
                features: &features,
                vertices: &kept,
            },
            sealed: true,
            samples: Some(samples),
            original: self.original,
        };
        let mut engine = Engine::new(start, judge(&part), self.progress)?;
        engine.run(self.phase, self.progress)?;
        let (found, samples) = engine.finish();
        let global = |v: u32| vertices[found.vertex_origin[v as usize] as usize];
        let places = found.mesh.positions().iter();
        Ok(After {
            moved: (0_u32..).zip(places).map(|(v, p)| (global(v), *p)).collect(),
            triangles: (found.mesh.triangles().iter())
                .map(|corners| corners.map(global))
                .collect(),
            origin: (found.triangle_origin.iter())
                .map(|&t| assembly.origin[triangles[t as usize] as usize])
                .collect(),
            features: (found.features.iter())
                .map(|ends| ends.map(global))
                .collect(),
            samples,
            report: found.report,
        })
    }

    /// Simplifies what is put together, around what was `held`, or everywhere.
    fn simplify_whole<J: CollapseJudge>(
        &self,
        assembly: &Assembly,
        fixed: &[bool],
        held: Option<Vec<bool>>,
        judge: impl Fn(&TriMesh) -> J,
        mut report: SimplifyReport,
    ) -> Result<Simplified, SimplifyError> {
        let (whole, vertices) = assembly.compact();
        let mut names = vec![NONE; fixed.len()];
        for (name, &v) in (0_u32..).zip(&vertices) {
            names[v as usize] = name;
        }
        let was_apart = held.is_some();
        let free = held.map(|held| {
            let mut free: Vec<bool> = vertices.iter().map(|&v| held[v as usize]).collect();
            grow(&mut free, &whole, RINGS);
            free
        });
        let kept: Vec<u32> = (0_u32..)
            .zip(&vertices)
            .filter(|&(name, &v)| {
                fixed[v as usize] || free.as_ref().is_some_and(|free| !free[name as usize])
            })
            .map(|(name, _)| name)
            .collect();
        let features: Vec<[u32; 2]> = assembly
            .features
            .iter()
            .map(|ends| ends.map(|v| names[v as usize]))
            .collect();
        // features that are known by their angle have been found by then
        let feature_angle_rad = if was_apart {
            std::f64::consts::PI
        } else {
            self.params.feature_angle_rad
        };
        let params = SimplifyParams {
            feature_angle_rad,
            ..*self.params
        };
        let limited = self.params.max_error < f64::INFINITY;
        let start = Start {
            mesh: &whole,
            params: &params,
            keep: Keep {
                features: &features,
                vertices: &kept,
            },
            sealed: false,
            samples: limited.then(|| assembly.samples.clone()),
            original: self.original,
        };
        let mut engine = Engine::new(start, judge(&whole), self.progress)?;
        engine.run(self.phase, self.progress)?;
        let (mut found, _) = engine.finish();
        for v in &mut found.vertex_origin {
            *v = vertices[*v as usize];
        }
        for t in &mut found.triangle_origin {
            *t = assembly.origin[*t as usize];
        }
        report.add(&found.report);
        found.report = SimplifyReport {
            triangles_after: found.mesh.triangles().len() as u64,
            ..report
        };
        Ok(found)
    }
}

impl SimplifyReport {
    fn add(&mut self, other: &Self) {
        self.collapses += other.collapses;
        self.vetoes += other.vetoes;
        self.largest_error = match (self.largest_error, other.largest_error) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        };
    }
}

impl Assembly {
    /// The mesh with what became of patches in their places, and the patch of each triangle, if it became anything.
    fn with(&self, patches: &[Patch]) -> (Self, Vec<u32>) {
        let mut next = Self {
            positions: self.positions.clone(),
            triangles: Vec::new(),
            origin: Vec::new(),
            features: Vec::new(),
            samples: Vec::new(),
        };
        let mut of_patch = Vec::new();
        let mut now = vec![NONE; self.triangles.len()];
        for (p, patch) in (0_u32..).zip(patches) {
            let first = next.triangles.len() as u32;
            if let Some(after) = &patch.after {
                for &(v, place) in &after.moved {
                    next.positions[v as usize] = place;
                }
                next.triangles.extend(&after.triangles);
                next.origin.extend(&after.origin);
                next.features.extend(&after.features);
                next.samples.extend(after.samples.iter().map(|s| Sample {
                    triangle: first + s.triangle,
                    ..*s
                }));
            } else {
                for &t in &patch.triangles {
                    now[t as usize] = next.triangles.len() as u32;
                    next.triangles.push(self.triangles[t as usize]);
                    next.origin.push(self.origin[t as usize]);
                }
            }
            of_patch.resize(next.triangles.len(), p);
        }
        let back = self.samples.iter().filter_map(|s| {
            let triangle = now[s.triangle as usize];
            (triangle != NONE).then_some(Sample { triangle, ..*s })
        });
        next.samples.extend(back);
        let edges: FxHashSet<u64> = next
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [edge_key(a, b), edge_key(b, c), edge_key(c, a)])
            .collect();
        next.features.extend(&self.features);
        for ends in &mut next.features {
            ends.sort_unstable();
        }
        next.features.sort_unstable();
        next.features.dedup();
        next.features.retain(|&[a, b]| edges.contains(&edge_key(a, b)));
        (next, of_patch)
    }

    /// The mesh without vertices that no triangle uses, and the names of those it has.
    fn compact(&self) -> (TriMesh, Vec<u32>) {
        let mut names = vec![NONE; self.positions.len()];
        for &v in self.triangles.iter().flatten() {
            names[v as usize] = 0;
        }
        let vertices: Vec<u32> = (0..names.len() as u32)
            .filter(|&v| names[v as usize] == 0)
            .collect();
        for (name, &v) in (0_u32..).zip(&vertices) {
            names[v as usize] = name;
        }
        let positions = vertices.iter().map(|&v| self.positions[v as usize]);
        let triangles = (self.triangles.iter()).map(|t| t.map(|v| names[v as usize]));
        let mesh = TriMesh::new(positions.collect(), triangles.collect())
            .expect("all vertices that are used have names");
        (mesh, vertices)
    }
}

/// Cuts the triangles into patches.
fn cut(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let middles: Vec<DVec3> = (0..mesh.triangles().len() as u32)
        .map(|t| mesh.corners(t).into_iter().sum())
        .collect();
    let most = (middles.len() / PATCHES).clamp(FEWEST, MOST);
    let mut patches = Vec::new();
    let mut to_cut = vec![(0..middles.len() as u32).collect::<Vec<u32>>()];
    while let Some(mut triangles) = to_cut.pop() {
        if triangles.len() <= most + most / 8 {
            triangles.sort_unstable();
            patches.push(triangles);
            continue;
        }
        let places = triangles.iter().map(|&t| middles[t as usize]);
        let size = crate::Aabb::around(places).size();
        let axis = (0..3)
            .max_by(|&a, &b| size[a].total_cmp(&size[b]))
            .unwrap_or(0);
        let half = triangles.len() / 2;
        triangles.select_nth_unstable_by(half, |&s, &t| {
            let [x, y] = [s, t].map(|t| middles[t as usize][axis]);
            x.total_cmp(&y).then(s.cmp(&t))
        });
        to_cut.push(triangles.split_off(half));
        to_cut.push(triangles);
    }
    patches
}

/// The patch of each triangle, and whether triangles of several patches share a vertex.
fn borders(assembly: &Assembly, groups: &[Vec<u32>]) -> (Vec<u32>, Vec<bool>) {
    let mut patch_of = vec![NONE; assembly.triangles.len()];
    let mut first = vec![NONE; assembly.positions.len()];
    let mut held = vec![false; assembly.positions.len()];
    for (p, group) in (0_u32..).zip(groups) {
        for &t in group {
            patch_of[t as usize] = p;
            for v in assembly.triangles[t as usize] {
                let known = &mut first[v as usize];
                held[v as usize] |= *known != NONE && *known != p;
                *known = p;
            }
        }
    }
    (patch_of, held)
}

/// Of each patch, whether its triangles meet those of others where they should not.
fn meeting(
    assembly: &Assembly,
    of_patch: &[u32],
    patches: usize,
    progress: &Progress,
) -> Result<Vec<bool>, Cancelled> {
    let (mesh, _) = assembly.compact();
    let bvh = Bvh::new(&mesh);
    let meets: Vec<AtomicBool> = (0..patches).map(|_| AtomicBool::new(false)).collect();
    for_each_self_intersection(&bvh, progress, |pair| {
        let [p, q] = [pair.first, pair.second].map(|t| of_patch[t as usize]);
        if p != q {
            meets[p as usize].store(true, Ordering::Relaxed);
            meets[q as usize].store(true, Ordering::Relaxed);
        }
    })?;
    Ok(meets.into_iter().map(AtomicBool::into_inner).collect())
}

/// Adds rings of neighbors.
fn grow(chosen: &mut [bool], mesh: &TriMesh, rings: usize) {
    for _ in 0..rings {
        let before = chosen.to_vec();
        for corners in mesh.triangles() {
            if corners.iter().any(|&v| before[v as usize]) {
                for &v in corners {
                    chosen[v as usize] = true;
                }
            }
        }
    }
}
