//! The queue of edges, and what happens to them.

use glam::DVec3;
use ravec_progress::{Cancelled, Phase, Progress};
use rayon::prelude::*;

use super::deviation::{Deviation, Sample, samples};
use super::examine::{Examiner, Freedom, Limits, Plan, Veto, freedom};
use super::judge::CollapseJudge;
use super::quadric::Quadric;
use super::queue::{Entry, Queue};
use super::surface::{GONE, Surface};
use super::{ErrorSample, Keep, Simplified, SimplifyError, SimplifyParams, SimplifyReport};
use crate::loose_octree::LooseOctree;
use crate::{Aabb, Adjacency, Bvh, TriMesh};

/// The share of the squared length of an edge that is added to its cost, for the area it stands for.
///
/// It orders the edges of flat parts, whose quadrics are rounding: short ones first, which keeps triangles in shape. A
/// larger share would prefer short edges also where the surface is curved.
const LENGTH_SHARE: f64 = 1e-9;

/// The weight of the planes across boundaries and features, relative to the square of the edge. Smaller lets curves
/// shrink where they bend, larger freezes their bends.
const CURVE_WEIGHT: f64 = 3.0;

/// How often what was vetoed may be tried again. Later rounds find next to nothing.
const ROUNDS: u32 = 3;

/// Coordinates in which the mesh has a diagonal of 1, so that squares neither overflow nor vanish in `f32`.
#[derive(Debug, Clone, Copy)]
struct Frame {
    origin: DVec3,
    scale: f64,
}

impl Frame {
    #[inline]
    fn to_local(self, p: DVec3) -> DVec3 {
        (p - self.origin) * self.scale
    }
}

/// What an engine starts from.
pub(super) struct Start<'a> {
    pub mesh: &'a TriMesh,
    pub params: &'a SimplifyParams,
    pub keep: Keep<'a>,
    /// The vertices to keep that are also those of other triangles, elsewhere: no edge between two of them may come to be,
    /// since there might be one elsewhere.
    pub sealed: &'a [u32],
    /// What is known of the original, if this is not the first engine at work.
    pub samples: Option<Vec<Sample>>,
    /// The original, if the distance from it is limited.
    pub original: Option<&'a Bvh>,
}

pub(super) struct Engine<'a, J> {
    surface: Surface,
    quadrics: Vec<Quadric>,
    /// Only if the error is limited.
    deviation: Option<Deviation<'a>>,
    /// Grows with each change of a vertex.
    stamps: Vec<u32>,
    /// Of each vertex that is gone, the one it was merged into.
    merged_into: Vec<u32>,
    /// When the triangles at a vertex last changed, as a number of collapses.
    touched: Vec<u32>,
    frame: Frame,
    limits: Limits,
    target: u64,
    tree: Option<LooseOctree>,
    queue: Queue,
    /// What was vetoed, and after how many collapses.
    vetoed: Vec<(Entry, u32)>,
    examiner: Examiner,
    /// Of each vertex, whether other triangles have it; empty if there are none.
    sealed: Vec<bool>,
    report: SimplifyReport,
    judge: J,
}

/// The collapse of an edge and its cost, if its ends allow any.
#[inline]
fn planned(
    surface: &Surface,
    quadrics: &[Quadric],
    frame: Frame,
    [a, b]: [u32; 2],
    max_error: f64,
) -> Result<(Plan, f64), Veto> {
    let freedom = freedom(surface, a, b).ok_or(Veto::Features)?;
    let quadric = quadrics[a as usize] + quadrics[b as usize];
    let [p, q] = [a, b].map(|v| surface.positions[v as usize]);
    let (kept, removed, position, value) = match freedom {
        Freedom::To([kept, removed]) => {
            let position = surface.positions[kept as usize];
            let value = quadric.at(frame.to_local(position));
            (kept, removed, position, value)
        }
        Freedom::Between([kept, removed]) => {
            let (local_p, local_q) = (frame.to_local(p), frame.to_local(q));
            let middle = 0.5 * (local_p + local_q);
            let lowest = quadric.lowest(middle);
            let position = frame.origin + lowest / frame.scale;
            // a point far away is the meeting of nearly parallel planes
            let near = lowest.distance_squared(middle) <= local_p.distance_squared(local_q);
            let (value, position) = if near && position.is_finite() {
                (quadric.at(lowest), position)
            } else {
                let others = [(local_p, p), (local_q, q), (middle, 0.5 * p + 0.5 * q)];
                let valued = others.map(|(local, place)| (quadric.at(local), place));
                let [first, rest @ ..] = valued;
                rest.into_iter().fold(
                    first,
                    |best, other| if other.0 < best.0 { other } else { best },
                )
            };
            (kept, removed, position, value)
        }
    };
    let allowed = max_error * frame.scale;
    // spares the measurement of what is hopeless
    if value > allowed * allowed * quadric.weight + quadric.rounding() && quadric.weight > 0.0 {
        return Err(Veto::Error);
    }
    let length_sq = p.distance_squared(q) * frame.scale * frame.scale;
    let cost = value + LENGTH_SHARE * length_sq * quadric.weight;
    let plan = Plan {
        kept,
        removed,
        position,
    };
    Ok((plan, cost))
}

impl<'a, J: CollapseJudge> Engine<'a, J> {
    pub fn new(start: Start<'a>, judge: J, progress: &Progress) -> Result<Self, SimplifyError> {
        let Start {
            mesh,
            params,
            keep,
            sealed,
            samples: known,
            original,
        } = start;
        let adjacency = Adjacency::new(mesh);
        progress.check()?;
        let surface = Surface::new(mesh, &adjacency, params, &keep)?;
        progress.check()?;
        let bounds = mesh.bounds();
        let diagonal = bounds.diagonal();
        let frame = Frame {
            origin: if bounds.is_empty() {
                DVec3::ZERO
            } else {
                bounds.center()
            },
            scale: if diagonal > 0.0 { 1.0 / diagonal } else { 1.0 },
        };
        let vertices = mesh.positions().len();
        let local = |v: u32| frame.to_local(mesh.positions()[v as usize]);
        let mut quadrics: Vec<Quadric> = (0..vertices as u32)
            .into_par_iter()
            .map(|v| {
                surface.star(v).fold(Quadric::default(), |sum, (_, t)| {
                    sum + Quadric::corner(t.map(local))
                })
            })
            .collect();
        for (edge, &ends) in (0_u32..).zip(adjacency.edges()) {
            if !surface.is_special(ends[0], ends[1]) {
                continue;
            }
            let [p, q] = ends.map(local);
            for at in adjacency.uses(edge) {
                let [a, b, c] = mesh.triangles()[at.triangle as usize].map(local);
                let across = (q - p).cross((b - a).cross(c - a));
                if let Some(n) = across.try_normalize() {
                    let wall = Quadric::plane(n, p, CURVE_WEIGHT * p.distance_squared(q));
                    for v in ends {
                        quadrics[v as usize] += wall;
                    }
                }
            }
        }
        progress.check()?;
        let mut is_sealed = vec![false; if sealed.is_empty() { 0 } else { vertices }];
        for &v in sealed {
            is_sealed[v as usize] = true;
        }
        let limits = Limits::new(params);
        let planned: Vec<Result<Entry, Veto>> = adjacency
            .edges()
            .par_iter()
            .map(|&[a, b]| {
                let planned = planned(&surface, &quadrics, frame, [a, b], limits.max_error);
                planned.map(|(_, cost)| Entry::new(cost, [a, b], 0))
            })
            .collect();
        let mut report = SimplifyReport {
            triangles_before: mesh.triangles().len() as u64,
            ..SimplifyReport::default()
        };
        let mut queue = Queue::new();
        for planned in planned {
            match planned {
                Ok(entry) => queue.push(entry),
                Err(veto) => report.vetoes.count(veto),
            }
        }
        progress.check()?;
        let tree = params.avoid_intersections.then(|| {
            let mut tree = LooseOctree::new(bounds, surface.triangles.len());
            for (t, corners) in (0_u32..).zip(&surface.triangles) {
                if *corners != GONE {
                    tree.insert(t, &Aabb::around(surface.corners(t)));
                }
            }
            tree
        });
        let limited = params.max_error < f64::INFINITY;
        let deviation = limited.then(|| {
            let known = known.unwrap_or_else(|| samples(mesh, &adjacency));
            Deviation::new(known, surface.triangles.len(), original)
        });
        Ok(Self {
            surface,
            quadrics,
            deviation,
            stamps: vec![0; vertices],
            merged_into: (0..vertices as u32).collect(),
            touched: vec![0; vertices],
            frame,
            limits,
            target: params.target_triangles,
            tree,
            queue,
            vetoed: Vec::new(),
            examiner: Examiner::new(vertices),
            sealed: is_sealed,
            report,
            judge,
        })
    }

    /// Collapses edges until the target is reached or nothing more is allowed.
    pub fn run(&mut self, phase: &Phase, progress: &Progress) -> Result<(), Cancelled> {
        for _ in 0..ROUNDS {
            let before = self.report.collapses;
            while self.surface.alive > self.target {
                let Some(entry) = self.queue.pop() else {
                    break;
                };
                let ([a, b], stamp) = (entry.ends, entry.stamp);
                if self.stamp(a, b) != stamp {
                    continue;
                }
                progress.check()?;
                match self.try_collapse(a, b) {
                    Ok(()) => phase.advance(self.examiner.vanishing.len() as u64),
                    Err(veto) => {
                        self.report.vetoes.count(veto);
                        self.vetoed.push((entry, self.report.collapses as u32));
                    }
                }
            }
            if self.surface.alive <= self.target || self.report.collapses == before {
                break;
            }
            for (entry, when) in std::mem::take(&mut self.vetoed) {
                let ([a, b], stamp) = (entry.ends, entry.stamp);
                let changed = self.touched[a as usize].max(self.touched[b as usize]) > when;
                if changed && self.stamp(a, b) == stamp {
                    self.queue.push(entry);
                } else if self.stamp(a, b) == stamp {
                    self.vetoed.push((entry, when));
                }
            }
        }
        Ok(())
    }

    #[inline]
    fn stamp(&self, a: u32, b: u32) -> u32 {
        self.stamps[a as usize].wrapping_add(self.stamps[b as usize])
    }

    fn try_collapse(&mut self, a: u32, b: u32) -> Result<(), Veto> {
        let max_error = self.limits.max_error;
        let (mut plan, _) = planned(&self.surface, &self.quadrics, self.frame, [a, b], max_error)?;
        if plan.position != self.surface.positions[plan.kept as usize] {
            plan.position = self.judge.place(plan.position);
        }
        let (surface, examiner) = (&self.surface, &mut self.examiner);
        examiner.gather(surface, &plan)?;
        if !self.sealed.is_empty() {
            examiner.examine_seal(surface, &plan, &self.sealed)?;
        }
        examiner.examine_shape(surface, &plan, &self.limits)?;
        if self
            .judge
            .refuses_early(&examiner.candidate(surface, &plan))
        {
            return Err(Veto::Caller);
        }
        if let Some(deviation) = &mut self.deviation {
            examiner.examine_deviation(&plan, deviation, &self.limits)?;
        }
        if let Some(tree) = &self.tree {
            examiner.examine_intersections(surface, &plan, tree)?;
        }
        if self.judge.refuses(&examiner.candidate(surface, &plan)) {
            return Err(Veto::Caller);
        }
        self.collapse(&plan);
        Ok(())
    }

    fn collapse(&mut self, plan: &Plan) {
        let Plan {
            kept,
            removed,
            position,
        } = *plan;
        let examiner = &mut self.examiner;
        self.report.collapses += 1;
        if let Some(deviation) = &mut self.deviation {
            deviation.accept(&examiner.old(), &examiner.changed);
        }
        self.merged_into[removed as usize] = kept;
        let quadric = self.quadrics[removed as usize];
        self.quadrics[kept as usize] += quadric;
        for v in [kept, removed] {
            self.stamps[v as usize] = self.stamps[v as usize].wrapping_add(1);
        }
        if let Some(tree) = &mut self.tree {
            for &t in &examiner.vanishing {
                tree.remove(t);
            }
            for (&t, corners) in examiner.changed.iter().zip(&examiner.after) {
                tree.update(t, &Aabb::around(*corners));
            }
        }
        let ends = [kept, removed];
        self.surface
            .merge(ends, position, &examiner.changed, &examiner.vanishing);
        // the edges of the merged vertex
        let mark = examiner.next_mark();
        examiner.is_new(kept, mark);
        let now = self.report.collapses as u32;
        self.touched[kept as usize] = now;
        for i in 0..examiner.changed.len() {
            for w in self.surface.triangles[examiner.changed[i] as usize] {
                if !examiner.is_new(w, mark) {
                    continue;
                }
                self.touched[w as usize] = now;
                let ends = [kept, w];
                let limit = self.limits.max_error;
                match planned(&self.surface, &self.quadrics, self.frame, ends, limit) {
                    Ok((_, cost)) => {
                        let stamp =
                            self.stamps[kept as usize].wrapping_add(self.stamps[w as usize]);
                        let entry = Entry::new(cost, ends, stamp);
                        self.queue.push(entry);
                    }
                    Err(veto) => self.report.vetoes.count(veto),
                }
            }
        }
    }

    /// How many triangles may go.
    pub fn most_to_do(&self) -> u64 {
        self.surface.alive.saturating_sub(self.target)
    }

    /// Takes what is left, in the names of the mesh that was given.
    pub fn take_apart(self) -> Leftover {
        let Self {
            surface,
            deviation,
            mut merged_into,
            mut report,
            ..
        } = self;
        for v in 0..merged_into.len() {
            let mut end = merged_into[v];
            while merged_into[end as usize] != end {
                end = merged_into[end as usize];
            }
            merged_into[v] = end;
        }
        report.triangles_after = surface.alive;
        report.largest_error = deviation.as_ref().map(|deviation| deviation.largest);
        report.target_reached = surface.alive <= self.target;
        Leftover {
            samples: deviation.map_or_else(Vec::new, |known| known.into_samples(&surface)),
            features: surface.features().collect(),
            positions: surface.positions,
            triangles: surface.triangles,
            merged_into,
            report,
        }
    }
}

/// What an engine leaves, in the names of the mesh it was given.
pub(super) struct Leftover {
    /// Where the vertices are that are still there.
    pub positions: Vec<DVec3>,
    /// The corners of the triangles that are still there.
    pub triangles: Vec<[u32; 3]>,
    /// Of each vertex, the one that stands for it.
    pub merged_into: Vec<u32>,
    pub features: Vec<[u32; 2]>,
    pub samples: Vec<Sample>,
    pub report: SimplifyReport,
}

impl Leftover {
    /// The mesh of what is still there, with its samples if asked for.
    pub fn into_simplified(self, with_samples: bool) -> Simplified {
        let mut name = vec![u32::MAX; self.positions.len()];
        for &v in self.triangles.iter().filter(|t| **t != GONE).flatten() {
            name[v as usize] = 0;
        }
        let mut positions = Vec::new();
        let mut vertex_origin = Vec::new();
        for (v, name) in (0_u32..).zip(&mut name).filter(|(_, name)| **name == 0) {
            *name = positions.len() as u32;
            positions.push(self.positions[v as usize]);
            vertex_origin.push(v);
        }
        let mut triangles = Vec::new();
        let mut triangle_origin = Vec::new();
        for (t, corners) in (0_u32..).zip(&self.triangles) {
            if *corners != GONE {
                triangles.push(corners.map(|v| name[v as usize]));
                triangle_origin.push(t);
            }
        }
        let mut features: Vec<[u32; 2]> = self
            .features
            .iter()
            .map(|ends| {
                let [a, b] = ends.map(|v| name[v as usize]);
                [a.min(b), a.max(b)]
            })
            .collect();
        features.sort_unstable();
        let mut samples = Vec::new();
        if with_samples {
            let mut number = vec![u32::MAX; self.triangles.len()];
            for (at, &t) in (0_u32..).zip(&triangle_origin) {
                number[t as usize] = at;
            }
            samples.extend(self.samples.iter().map(|sample| ErrorSample {
                place: sample.place,
                triangle: number[sample.triangle as usize],
            }));
        }
        Simplified {
            mesh: TriMesh::new(positions, triangles).expect(
                "places were checked to be finite, and names are of vertices that were counted",
            ),
            vertex_origin,
            triangle_origin,
            features,
            samples,
            report: self.report,
        }
    }
}
