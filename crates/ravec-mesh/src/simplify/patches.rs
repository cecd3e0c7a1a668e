//! Simplification in parallel.
//!
//! 1. The triangles are cut into patches, by halving them again and again across the longest side of the box of their
//!    middles. Patches are simplified side by side, with the vertices they share held fast.
//! 2. Each is examined: triangles may meet if the [`JudgeFactory`] says that its judges keep them apart; and the caller may find
//!    triangles at fault. These are [undone](super::undo), and then what is there again is simplified with care.
//! 3. Patches are put together, and what is around the vertices that they share is simplified, so that no seam remains. This
//!    is cut into pieces, too, where it is sparse and so across seams; they are simplified side by side, and then what is
//!    around the few vertices that they share.
//! 4. All of that is examined. Triangles at fault now are restored as they were when patches were put together, and
//!    only if that was not enough, since triangles of two patches meet, as they were in the beginning.
//!
//! Guarantees: as for [`simplify`](super::simplify); patches depend on the mesh alone. Does not guarantee: that the result
//! is the one of [`simplify`](super::simplify), since collapses happen in another order.

use glam::DVec3;
use ravec_progress::{Phase, Progress};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::deviation::{Sample, known_samples, samples};
use super::engine::{Engine, Leftover, Start};
use super::judge::{JudgeFactory, Trust};
use super::parts::{Part, borders, by_group, cut, cut_sparsely};
use super::surface::{GONE, creases};
use super::undo::Checkpoint;
use super::{Keep, Simplified, SimplifyError, SimplifyParams, SimplifyReport, validate};
use crate::adjacency::is_proper;
use crate::keyed::KeyedMap;
use crate::{Adjacency, Bvh, TriMesh};

/// Number of rings of triangles around held or restored vertices that are simplified in the end.
const RINGS: usize = 2;

/// Simplifies `mesh` in the caller's thread pool, by patches and then along their seams.
///
/// # Errors
/// As for [`simplify`](super::simplify); and [`SimplifyError::BadParameter`] if a number of triangles is requested, since
/// patches cannot know their share.
pub fn simplify_patches(
    mesh: &TriMesh,
    params: &SimplifyParams,
    mut keep: Keep<'_>,
    judges: &impl JudgeFactory,
    progress: &Progress,
) -> Result<Simplified, SimplifyError> {
    progress.check()?;
    validate(mesh, params, &keep)?;
    if params.target_triangles > 0 {
        return Err(SimplifyError::BadParameter {
            name: "target_triangles",
            value: params.target_triangles as f64,
            range: "0 where patches are simplified",
        });
    }
    let adjacency = Adjacency::try_new(mesh, progress)?;
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
    let known = limited.then(|| match keep.samples.take() {
        Some(known) => known_samples(known),
        None => samples(mesh, &adjacency),
    });
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
        sealed: keep.sealed,
        reports_samples: keep.reports_samples,
        judges,
        waiting: &AtomicUsize::new(0),
        phase: &progress.phase("simplify", mesh.triangles().len() as u64),
        progress,
    };
    progress.check()?;
    let groups = cut(mesh);
    progress.check()?;
    let samples = known.unwrap_or_default();
    let assembly = if groups.len() > 1 {
        let (mut assembly, held) = task.simplify_apart(samples, &groups)?;
        task.simplify_seams(&mut assembly, &held)?;
        assembly
    } else {
        task.simplify_examined(samples)?
    };
    progress.check()?;
    Ok(task.finish(assembly))
}

/// Data common to all steps.
pub(super) struct Task<'a, O> {
    pub mesh: &'a TriMesh,
    pub params: SimplifyParams,
    original: Option<&'a Bvh>,
    /// All edges that are features.
    features: Vec<[u32; 2]>,
    fixed: Vec<bool>,
    /// `true` if what is fixed is that of other meshes, too.
    sealed: bool,
    reports_samples: bool,
    pub judges: &'a O,
    /// Number of patches or pieces that wait for a thread.
    waiting: &'a AtomicUsize,
    phase: &'a Phase,
    pub progress: &'a Progress,
}

/// The work of an engine.
struct Work<'a> {
    keep: Keep<'a>,
    trust: Trust,
    /// Those to keep that other triangles have, too.
    sealed: &'a [u32],
}

/// Bounds of pieces that are simplified side by side: a bit for each vertex of the original.
struct Bounds {
    kept: Vec<bool>,
    /// Those that other triangles have, too.
    sealed: Vec<bool>,
    /// Those that could go if pieces did not share them.
    left: Vec<bool>,
}

/// The mesh between the steps, in the names of the original.
pub(super) struct Assembly {
    pub positions: Vec<DVec3>,
    /// The vertex that stands for each vertex.
    pub merged_into: Vec<u32>,
    pub samples: Vec<Sample>,
    report: SimplifyReport,
}

impl<O: JudgeFactory> Task<'_, O> {
    /// Simplifies all of the mesh, and undoes what is at fault.
    fn simplify_examined(&self, samples: Vec<Sample>) -> Result<Assembly, SimplifyError> {
        let mut assembly = Assembly::new(self.mesh, samples);
        self.simplify_whole(&mut assembly, None, Trust::Examined)?;
        let restored = self.restore(&mut assembly, None)?;
        if restored.contains(&true) {
            self.simplify_whole(&mut assembly, Some(&restored), Trust::Final)?;
        }
        Ok(assembly)
    }

    /// Simplifies patches, each as if it were all of the mesh, and says which vertices were held fast.
    fn simplify_apart(
        &self,
        mut samples: Vec<Sample>,
        groups: &[Vec<u32>],
    ) -> Result<(Assembly, Vec<bool>), SimplifyError> {
        let (patch_of, held) = borders(self.mesh, groups);
        self.progress.check()?;
        let samples_of = by_group(&mut samples, groups.len(), |t| patch_of[t as usize]);
        drop(samples);
        let untouched = Assembly::new(self.mesh, vec![]);
        self.waiting.store(groups.len(), Ordering::Relaxed);
        let found: Vec<(Part, Assembly)> = groups
            .par_iter()
            .zip(samples_of)
            .map(|(group, mut samples)| {
                self.waiting.fetch_sub(1, Ordering::Relaxed);
                self.progress.check()?;
                let part = Part::new(self.mesh, untouched.now(), group.iter().copied());
                part.rename(&mut samples);
                let is_kept = |&v: &u32| held[v as usize] || self.fixed[v as usize];
                let patch = Task {
                    mesh: &part.mesh,
                    features: part.features(&self.features, &untouched.merged_into),
                    fixed: part.vertices.iter().map(is_kept).collect(),
                    sealed: true,
                    ..*self
                };
                let assembly = patch.simplify_examined(samples)?;
                Ok((part, assembly))
            })
            .collect::<Result<_, SimplifyError>>()?;
        let mut assembly = untouched;
        for (part, of_patch) in found {
            self.progress.check()?;
            assembly.take_patch(&part, of_patch);
        }
        Ok((assembly, held))
    }

    /// Simplifies what is around vertices that were held fast, and undoes what is at fault.
    fn simplify_seams(&self, assembly: &mut Assembly, held: &[bool]) -> Result<(), SimplifyError> {
        let checkpoint = Checkpoint::new(assembly);
        let left = self.simplify_around(assembly, held, true)?;
        self.simplify_around(assembly, &left, false)?;
        let restored = self.restore(assembly, Some(&checkpoint))?;
        if restored.contains(&true) {
            self.simplify_whole(assembly, Some(&restored), Trust::Final)?;
        }
        Ok(())
    }

    /// Simplifies what is around vertices that were `held`, in pieces side by side or in one, and says which vertices could not
    /// go because pieces share them.
    fn simplify_around(
        &self,
        assembly: &mut Assembly,
        held: &[bool],
        is_cut: bool,
    ) -> Result<Vec<bool>, SimplifyError> {
        let all = 0..self.mesh.triangles().len() as u32;
        let whole = Part::new(self.mesh, assembly.now(), all);
        self.progress.check()?;
        let free = whole.around(held, RINGS);
        let near = whole.triangles_at(&free);
        self.progress.check()?;
        let pieces = match (near.is_empty(), is_cut) {
            (true, _) => vec![],
            (false, true) => cut_sparsely(&whole.mesh, near),
            (false, false) => vec![near],
        };
        let (piece_of, shared) = borders(&whole.mesh, &pieces);
        self.progress.check()?;
        let numbers: KeyedMap<u32, u32> = whole.triangles.iter().copied().zip(0..).collect();
        let piece_at = |t: u32| piece_of[numbers[&t] as usize];
        let samples_of = by_group(&mut assembly.samples, pieces.len(), piece_at);
        drop(numbers);
        self.progress.check()?;
        let bounds = self.bounds(&whole, &free, &shared);
        self.progress.check()?;
        self.waiting.store(pieces.len(), Ordering::Relaxed);
        let found: Vec<(Part, Leftover)> = pieces
            .par_iter()
            .zip(samples_of)
            .map(|(piece, samples)| {
                self.waiting.fetch_sub(1, Ordering::Relaxed);
                self.progress.check()?;
                let triangles = piece.iter().map(|&t| whole.triangles[t as usize]);
                let part = Part::new(self.mesh, assembly.now(), triangles);
                let work = Work {
                    keep: Keep {
                        features: &part.features(&self.features, &assembly.merged_into),
                        vertices: &part.vertices_in(&bounds.kept),
                        ..Keep::default()
                    },
                    trust: Trust::Examined,
                    sealed: &part.vertices_in(&bounds.sealed),
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
        Ok(bounds.left)
    }

    /// Bounds of the pieces of a `whole`, of whose vertices some are `free`, and some `shared` by pieces.
    fn bounds(&self, whole: &Part, free: &[bool], shared: &[bool]) -> Bounds {
        let mut bounds = Bounds {
            kept: self.fixed.clone(),
            sealed: vec![false; self.fixed.len()],
            left: vec![false; self.fixed.len()],
        };
        for (v, &name) in whole.vertices.iter().enumerate() {
            let name = name as usize;
            bounds.kept[name] |= !free[v] || shared[v];
            bounds.sealed[name] = shared[v] || self.sealed && self.fixed[name];
            bounds.left[name] = free[v] && shared[v] && !self.fixed[name];
        }
        bounds
    }

    /// Lets an engine work on a part.
    fn run(
        &self,
        part: &Part,
        mut samples: Vec<Sample>,
        work: Work<'_>,
    ) -> Result<Leftover, SimplifyError> {
        let names: KeyedMap<u32, u32> = part.triangles.iter().copied().zip(0..).collect();
        for sample in &mut samples {
            sample.triangle = names[&sample.triangle];
        }
        drop(names);
        self.progress.check()?;
        let is_believed = work.trust == Trust::Examined && self.judges.keeps_apart();
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
            waiting: self.waiting,
        };
        let judge = self.judges.judge(&part.mesh, work.trust);
        self.progress.check()?;
        let mut engine = Engine::new(start, judge, self.progress)?;
        engine.run(self.phase, self.progress)?;
        Ok(engine.take_apart())
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
        let free = free.map(|free| part.around(free, RINGS));
        let keep: Vec<u32> = (0_u32..)
            .zip(&part.vertices)
            .filter(|&(name, &v)| {
                self.fixed[v as usize] || free.as_ref().is_some_and(|free| !free[name as usize])
            })
            .map(|(name, _)| name)
            .collect();
        let sealed = if self.sealed {
            part.vertices_in(&self.fixed)
        } else {
            vec![]
        };
        self.progress.check()?;
        let work = Work {
            keep: Keep {
                features: &part.features(&self.features, &assembly.merged_into),
                vertices: &keep,
                ..Keep::default()
            },
            trust,
            sealed: &sealed,
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
            samples: assembly.samples,
            report,
        }
        .into_simplified(self.reports_samples)
    }
}

impl Assembly {
    /// Nothing is merged yet.
    fn new(mesh: &TriMesh, samples: Vec<Sample>) -> Self {
        Self {
            positions: mesh.positions().to_vec(),
            merged_into: (0..mesh.positions().len() as u32).collect(),
            samples,
            report: SimplifyReport::default(),
        }
    }

    /// Takes over what became of a patch.
    fn take_patch(&mut self, part: &Part, of_patch: Self) {
        let name = |v: u32| part.vertices[v as usize];
        for (v, &into) in (0_u32..).zip(&of_patch.merged_into) {
            self.merged_into[name(v) as usize] = name(into);
            self.positions[name(v) as usize] = of_patch.positions[v as usize];
        }
        // exactly, since all of the patches together are many
        self.samples.reserve_exact(of_patch.samples.len());
        self.samples
            .extend(of_patch.samples.into_iter().map(|sample| {
                let triangle = part.triangles[sample.triangle as usize];
                Sample {
                    place: sample.place,
                    original: part.triangles[sample.original as usize],
                    settled: triangle,
                    triangle,
                }
            }));
        self.report.add(&of_patch.report);
    }

    /// The vertex that stands for each vertex, and the positions.
    pub fn now(&self) -> (&[u32], &[DVec3]) {
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
        let mut samples = leftover.samples;
        for sample in &mut samples {
            sample.triangle = part.triangles[sample.triangle as usize];
        }
        if self.samples.is_empty() {
            self.samples = samples;
        } else {
            self.samples.append(&mut samples);
        }
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
