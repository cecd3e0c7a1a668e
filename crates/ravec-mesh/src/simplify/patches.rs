//! Simplification in parallel.
//!
//! 1. The triangles are cut into patches, by halving them again and again across the longest side of the box of their
//!    middles. Patches are simplified side by side, with the vertices they share held fast.
//! 2. Put together, they are examined: within a patch nothing is known of the others, so triangles of two might meet, and
//!    those of one as well if the [`Overseer`] says that its judges keep them apart; and the caller may find triangles at
//!    fault. The vertices of such triangles are *restored*: all that was merged into them is what it was before. That is
//!    easy, since a triangle is there if and only if its corners were not merged with each other. What is restored is
//!    examined again, and more is restored until nothing is at fault.
//! 3. What is around vertices that were held or restored is simplified as a whole, so that no seam remains.
//!
//! Guarantees: as for [`simplify`](super::simplify); patches depend on the mesh alone. Does not guarantee: that the result
//! is the one of [`simplify`](super::simplify), since collapses happen in another order.

use std::sync::Mutex;

use glam::DVec3;
use ravec_progress::{Cancelled, Phase, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::deviation::{Sample, samples};
use super::engine::{Engine, Leftover, Start};
use super::judge::{Overseer, Trust};
use super::parts::{Part, cut, grow};
use super::surface::{GONE, creases};
use super::{Keep, Simplified, SimplifyError, SimplifyParams, SimplifyReport, validate};
use crate::adjacency::is_proper;
use crate::{Aabb, Adjacency, BoxTree, Bvh, CandidateTree, TriMesh, for_each_self_intersection};

/// How many rings of triangles around what was held or restored are simplified in the end.
const RINGS: usize = 2;

/// Simplifies `mesh` in the caller's thread pool, by patches and then along their seams.
///
/// # Errors
/// As for [`simplify`](super::simplify); and [`SimplifyError::BadParameter`] if a number of triangles is asked for, since
/// patches cannot know their share.
pub fn simplify_patches(
    mesh: &TriMesh,
    params: &SimplifyParams,
    keep: &Keep<'_>,
    overseer: &impl Overseer,
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
    let adjacency = Adjacency::new(mesh);
    let no_edge = |&&[a, b]: &&[u32; 2]| adjacency.edge_between(a, b).is_none();
    if let Some(&ends) = keep.features.iter().find(no_edge) {
        return Err(SimplifyError::NoSuchEdge { ends });
    }
    progress.check()?;
    let limited = params.max_error < f64::INFINITY;
    let original = if limited && params.both_ways {
        Some(Bvh::try_new(mesh, progress)?)
    } else {
        None
    };
    let known = limited.then(|| samples(mesh, &adjacency));
    progress.check()?;
    let mut features = creases(mesh, &adjacency, params.feature_angle_rad);
    features.extend(keep.features);
    drop(adjacency);
    progress.check()?;
    let mut fixed = vec![false; mesh.positions().len()];
    for &v in keep.vertices {
        fixed[v as usize] = true;
    }
    let task = Task {
        mesh,
        params: SimplifyParams {
            // creases are named from now on
            feature_angle_rad: std::f64::consts::PI,
            ..*params
        },
        original: original.as_ref(),
        features,
        fixed,
        overseer,
        phase: progress.phase("simplify", mesh.triangles().len() as u64),
        progress,
    };
    let mut assembly = Assembly {
        positions: mesh.positions().to_vec(),
        merged_into: (0..mesh.positions().len() as u32).collect(),
        samples: known.unwrap_or_default(),
        report: SimplifyReport::default(),
    };
    progress.check()?;
    let groups = cut(mesh);
    progress.check()?;
    let free = if groups.len() > 1 {
        Some(task.simplify_apart(&mut assembly, &groups)?)
    } else {
        None
    };
    task.simplify_whole(&mut assembly, free.as_deref(), Trust::Examined)?;
    let restored = task.restore(&mut assembly)?;
    if restored.contains(&true) {
        task.simplify_whole(&mut assembly, Some(&restored), Trust::Final)?;
    }
    progress.check()?;
    Ok(task.finish(assembly))
}

/// What all steps have in common.
struct Task<'a, O> {
    mesh: &'a TriMesh,
    params: SimplifyParams,
    original: Option<&'a Bvh>,
    /// All edges that are features.
    features: Vec<[u32; 2]>,
    fixed: Vec<bool>,
    overseer: &'a O,
    phase: Phase,
    progress: &'a Progress,
}

/// What an engine is to do.
#[derive(Clone, Copy)]
struct Work<'a> {
    keep: Keep<'a>,
    trust: Trust,
    sealed: bool,
}

/// The mesh between the steps, in the names of the original.
struct Assembly {
    positions: Vec<DVec3>,
    /// Of each vertex, the one that stands for it.
    merged_into: Vec<u32>,
    samples: Vec<Sample>,
    report: SimplifyReport,
}

impl<O: Overseer> Task<'_, O> {
    /// Simplifies patches, and says which vertices were held fast.
    fn simplify_apart(
        &self,
        assembly: &mut Assembly,
        groups: &[Vec<u32>],
    ) -> Result<Vec<bool>, SimplifyError> {
        let (patch_of, held) = self.borders(groups);
        self.progress.check()?;
        let mut samples_of = vec![Vec::new(); groups.len()];
        for sample in assembly.samples.drain(..) {
            samples_of[patch_of[sample.triangle as usize] as usize].push(sample);
        }
        let shared = &*assembly;
        let found: Vec<(Part, Leftover)> = groups
            .par_iter()
            .zip(samples_of)
            .map(|(group, samples)| {
                self.progress.check()?;
                let part = Part::new(self.mesh, shared.now(), group.iter().copied());
                let is_kept = |v: u32| held[v as usize] || self.fixed[v as usize];
                let named = (0_u32..).zip(&part.vertices);
                let keep = named.filter(|&(_, &v)| is_kept(v)).map(|(name, _)| name);
                let work = Work {
                    keep: Keep {
                        features: &part.features(&self.features, &shared.merged_into),
                        vertices: &keep.collect::<Vec<u32>>(),
                    },
                    trust: Trust::Examined,
                    sealed: true,
                };
                let leftover = self.run(&part, samples, work)?;
                Ok((part, leftover))
            })
            .collect::<Result<_, SimplifyError>>()?;
        for (part, leftover) in found {
            self.progress.check()?;
            assembly.take(&part, leftover);
        }
        assembly.resolve();
        self.progress.check()?;
        Ok(held)
    }

    /// Lets an engine work on a part.
    fn run(
        &self,
        part: &Part,
        mut samples: Vec<Sample>,
        work: Work<'_>,
    ) -> Result<Leftover, SimplifyError> {
        let names: FxHashMap<u32, u32> = part.triangles.iter().copied().zip(0..).collect();
        for sample in &mut samples {
            sample.triangle = names[&sample.triangle];
        }
        drop(names);
        self.progress.check()?;
        let is_believed = work.trust == Trust::Examined && self.overseer.keeps_apart();
        let params = SimplifyParams {
            avoid_intersections: self.params.avoid_intersections && !is_believed,
            ..self.params
        };
        let start = Start {
            mesh: &part.mesh,
            params: &params,
            keep: work.keep,
            sealed: work.sealed,
            samples: Some(samples),
            original: self.original,
        };
        let judge = self.overseer.judge(&part.mesh, work.trust);
        self.progress.check()?;
        let mut engine = Engine::new(start, judge, self.progress)?;
        engine.run(&self.phase, self.progress)?;
        Ok(engine.take_apart())
    }

    /// Undoes what is at fault, and says which vertices are what they were.
    fn restore(&self, assembly: &mut Assembly) -> Result<Vec<bool>, SimplifyError> {
        let merged: Vec<u32> = assembly.merged_into.clone();
        let all = 0..self.mesh.triangles().len() as u32;
        let mut restored = vec![false; merged.len()];
        let mut suspects: Option<Vec<bool>> = None;
        loop {
            self.progress.check()?;
            let part = Part::new(self.mesh, assembly.now(), all.clone());
            self.progress.check()?;
            let faults = self.faults(&part, suspects.as_deref(), &restored)?;
            // whole clusters are restored
            let mut chosen = vec![false; merged.len()];
            let mut any = false;
            for v in faults {
                let place = merged[v as usize] as usize;
                any |= !std::mem::replace(&mut chosen[place], true) && !restored[place];
            }
            if !any {
                return Ok(restored);
            }
            let mut fresh = vec![false; merged.len()];
            for (v, &into) in merged.iter().enumerate() {
                if chosen[into as usize] && !restored[v] {
                    restored[v] = true;
                    fresh[v] = true;
                    assembly.merged_into[v] = v as u32;
                    assembly.positions[v] = self.mesh.positions()[v];
                }
            }
            for sample in &mut assembly.samples {
                let corners = self.mesh.triangles()[sample.original as usize];
                let now = corners.map(|v| assembly.merged_into[v as usize]);
                if now.iter().any(|&v| fresh[v as usize]) && is_proper(now) {
                    sample.triangle = sample.original;
                }
            }
            suspects = Some(fresh);
        }
    }

    /// The vertices of triangles that must not stay; of all, or of those at `suspects`.
    fn faults(
        &self,
        part: &Part,
        suspects: Option<&[bool]>,
        restored: &[bool],
    ) -> Result<Vec<u32>, Cancelled> {
        let corners = |t: u32| part.mesh.triangles()[t as usize];
        let name = |v: u32| part.vertices[v as usize];
        let suspicious: Vec<u32> = (0..part.mesh.triangles().len() as u32)
            .filter(|&t| {
                let mut names = corners(t).into_iter().map(name);
                suspects.is_none_or(|suspects| names.any(|v| suspects[v as usize]))
            })
            .collect();
        self.progress.check()?;
        let mut bad = self.overseer.faults(&part.mesh, &suspicious);
        self.progress.check()?;
        // the others were examined before
        let around = match suspects {
            Some(_) => Some(self.touched(&part.mesh, &suspicious)?),
            None => None,
        };
        let (mesh, number): (&TriMesh, &dyn Fn(u32) -> u32) = match &around {
            Some((mesh, numbers)) => (mesh, &|t| numbers[t as usize]),
            None => (&part.mesh, &|t| t),
        };
        if suspects.is_some() {
            // neighbors of what is restored may have come to be so twice
            let adjacency = Adjacency::new(mesh);
            for (edge, ends) in (0_u32..).zip(adjacency.edges()) {
                let uses = adjacency.uses(edge);
                if uses.len() > 2 && ends.iter().any(|&v| restored[name(v) as usize]) {
                    bad.extend(uses.iter().map(|at| number(at.triangle)));
                }
            }
        }
        if self.params.avoid_intersections && !mesh.triangles().is_empty() {
            let tree = BoxTree::try_new(mesh, self.progress)?;
            let pairs = Mutex::new(Vec::new());
            for_each_self_intersection(&tree, self.progress, |pair| {
                if let Ok(mut pairs) = pairs.lock() {
                    pairs.extend([pair.first, pair.second]);
                }
            })?;
            bad.extend(
                pairs
                    .into_inner()
                    .unwrap_or_default()
                    .into_iter()
                    .map(number),
            );
        }
        Ok(bad.into_iter().flat_map(|t| corners(t).map(name)).collect())
    }

    /// The triangles whose boxes touch that of one of `suspicious`, these among them, with the names of the vertices as they are;
    /// and the number of each.
    fn touched(
        &self,
        mesh: &TriMesh,
        suspicious: &[u32],
    ) -> Result<(TriMesh, Vec<u32>), Cancelled> {
        let boxes = CandidateTree::try_new(
            mesh.bounds(),
            suspicious.len(),
            |i| mesh.corners(suspicious[i as usize]),
            self.progress,
        )?;
        let numbers: Vec<u32> = (0..mesh.triangles().len() as u32)
            .into_par_iter()
            .filter(|&t| {
                let mut is_near = false;
                boxes.for_each_near(&Aabb::around(mesh.corners(t)), |_| is_near = true);
                is_near
            })
            .collect();
        self.progress.check()?;
        let triangles = numbers.iter().map(|&t| mesh.triangles()[t as usize]);
        let touched = TriMesh::new(mesh.positions().to_vec(), triangles.collect());
        Ok((touched.expect("they are triangles of a mesh"), numbers))
    }

    /// Simplifies what is put together, around vertices that are `free`, or everywhere.
    fn simplify_whole(
        &self,
        assembly: &mut Assembly,
        free: Option<&[bool]>,
        trust: Trust,
    ) -> Result<(), SimplifyError> {
        let all = 0..self.mesh.triangles().len() as u32;
        let part = Part::new(self.mesh, assembly.now(), all);
        self.progress.check()?;
        let free = free.map(|free| {
            let mut here: Vec<bool> = part.vertices.iter().map(|&v| free[v as usize]).collect();
            grow(&mut here, &part.mesh, RINGS);
            here
        });
        let keep: Vec<u32> = (0_u32..)
            .zip(&part.vertices)
            .filter(|&(name, &v)| {
                self.fixed[v as usize] || free.as_ref().is_some_and(|free| !free[name as usize])
            })
            .map(|(name, _)| name)
            .collect();
        self.progress.check()?;
        let work = Work {
            keep: Keep {
                features: &part.features(&self.features, &assembly.merged_into),
                vertices: &keep,
            },
            trust,
            sealed: false,
        };
        let samples = std::mem::take(&mut assembly.samples);
        let leftover = self.run(&part, samples, work)?;
        assembly.take(&part, leftover);
        assembly.resolve();
        Ok(())
    }

    /// The mesh of what is still there.
    fn finish(&self, assembly: Assembly) -> Simplified {
        let now = |v: u32| assembly.merged_into[v as usize];
        let corners = self.mesh.triangles().iter().map(|t| t.map(now));
        let triangles: Vec<[u32; 3]> = corners
            .map(|corners| if is_proper(corners) { corners } else { GONE })
            .collect();
        let left = triangles.iter().filter(|t| **t != GONE).count() as u64;
        let ends = self.features.iter().map(|ends| ends.map(now));
        let mut features: Vec<[u32; 2]> = ends
            .filter(|[a, b]| a != b)
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        features.sort_unstable();
        features.dedup();
        let report = SimplifyReport {
            triangles_before: self.mesh.triangles().len() as u64,
            triangles_after: left,
            target_reached: left == 0,
            ..assembly.report
        };
        Leftover {
            positions: assembly.positions,
            triangles,
            merged_into: assembly.merged_into,
            features,
            samples: Vec::new(),
            report,
        }
        .into_simplified()
    }

    /// The patch of each triangle, and whether triangles of several patches share a vertex.
    fn borders(&self, groups: &[Vec<u32>]) -> (Vec<u32>, Vec<bool>) {
        let mut patch_of = vec![0; self.mesh.triangles().len()];
        let mut last = vec![None; self.mesh.positions().len()];
        let mut held = vec![false; last.len()];
        for (p, group) in (0_u32..).zip(groups) {
            for &t in group {
                patch_of[t as usize] = p;
                for v in self.mesh.triangles()[t as usize] {
                    let before = last[v as usize].replace(p);
                    held[v as usize] |= before.is_some_and(|before| before != p);
                }
            }
        }
        (patch_of, held)
    }
}

impl Assembly {
    /// Which vertices stand for which, and where they are.
    fn now(&self) -> (&[u32], &[DVec3]) {
        (&self.merged_into, &self.positions)
    }

    /// Takes over what became of a part.
    fn take(&mut self, part: &Part, leftover: Leftover) {
        let name = |v: u32| part.vertices[v as usize];
        for (v, &into) in (0_u32..).zip(&leftover.merged_into) {
            self.merged_into[name(v) as usize] = name(into);
            if v == into {
                self.positions[name(v) as usize] = leftover.positions[v as usize];
            }
        }
        let samples = leftover.samples.into_iter();
        self.samples.extend(samples.map(|sample| Sample {
            triangle: part.triangles[sample.triangle as usize],
            ..sample
        }));
        self.report.add(&leftover.report);
    }
}

impl Assembly {
    /// Lets each vertex know the one that stands for it in the end.
    fn resolve(&mut self) {
        for v in 0..self.merged_into.len() {
            let mut end = self.merged_into[v];
            while self.merged_into[end as usize] != end {
                end = self.merged_into[end as usize];
            }
            self.merged_into[v] = end;
        }
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
