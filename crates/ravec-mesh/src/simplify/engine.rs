//! The queue of edges, and what happens to them.
//!
//! Edges collapse one after the other, but where threads are idle the next ones are examined at once. Most examinations end with
//! a veto, and few collapses change anything around the edges that wait, so that most verdicts still hold when it is their turn.
//! The result is the same, bit for bit.

use glam::DVec3;
use ravec_progress::{Cancelled, Phase, Progress};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use super::deviation::{Deviation, Sample, samples};
use super::examine::{Examiner, Limits, Marks, Plan, Veto};
use super::judge::CollapseJudge;
use super::quadric::Quadric;
use super::queue::{Entry, Queue};
use super::state::{Collapse, Frame, State, planned};
use super::surface::{GONE, Surface};
use super::{ErrorSample, Keep, Simplified, SimplifyError, SimplifyParams, SimplifyReport};
use crate::loose_octree::LooseOctree;
use crate::par_collect::par_collect;
use crate::{Aabb, Adjacency, Bvh, TriMesh};

/// The weight of the planes across boundaries and features, relative to the square of the edge. Smaller lets curves
/// shrink where they bend, larger freezes their bends.
const CURVE_WEIGHT: f64 = 3.0;

/// Number of rounds in which vetoed collapses are tried again. Later rounds find next to nothing.
const ROUNDS: u32 = 3;

/// Number of edges that are examined at once where threads are idle: the least and the most. The more, the rarer
/// threads wait for one another, and the more examinations are in vain, since something changed meanwhile.
const AHEAD: [usize; 2] = [16, 256];

/// If of the edges that were examined at once a larger share than the second was examined in vain, there are half as many the
/// next time, and if a smaller share than the first, twice as many.
const IN_VAIN: [f64; 2] = [1.0 / 32.0, 1.0 / 8.0];

/// If even the fewest were too many, number of edges that are examined one after the other before that is tried again.
const PAUSE: usize = 256;

/// Largest number of parts in which they are examined, since each needs an examiner, which has a number for each vertex.
const MAX_PARTS: usize = 8;

/// Initial state of an engine.
pub(super) struct Start<'a> {
    pub mesh: &'a TriMesh,
    pub params: &'a SimplifyParams,
    pub keep: Keep<'a>,
    /// The vertices to keep that are also those of other triangles, elsewhere: no edge between two of them may come to be,
    /// since there might be one elsewhere.
    pub sealed: &'a [u32],
    /// Samples of the original, if this is not the first engine at work.
    pub samples: Option<Vec<Sample>>,
    /// The original, if the distance from it is limited.
    pub original: Option<&'a Bvh>,
    /// Number of other engines that wait for a thread: while there are any, this one examines one edge after the other.
    pub waiting: &'a AtomicUsize,
}

/// Number of edges or triangles that are processed between two checks for cancellation while the work begins.
const AT_ONCE: u32 = 1 << 14;

/// The same of edges that were vetoed, around each of which one has to look for changes.
const VETOED_AT_ONCE: usize = 1 << 10;

pub(super) struct Engine<'a, J: CollapseJudge> {
    state: State<'a, J>,
    /// Number of other engines that wait for a thread.
    waiting: &'a AtomicUsize,
    /// Grows with each change of a vertex.
    stamps: Vec<u32>,
    /// The vertex into which each vertex that is gone was merged.
    merged_into: Vec<u32>,
    /// When the triangles at a vertex last changed, as a number of collapses.
    touched: Vec<u32>,
    target: u64,
    queue: Queue,
    /// Vetoed collapses, each with the number of collapses before it.
    vetoed: Vec<(Entry, u32)>,
    marks: Marks,
    examiner: Examiner,
    /// Those of other threads, while they are not at work.
    examiners: Mutex<Vec<Examiner>>,
    /// The last examination, and those made ahead; kept for their lists.
    last: Collapse<J::Findings>,
    ahead: Vec<Collapse<J::Findings>>,
    /// Boxes of triangles that have changed since a batch was examined, if there is one and triangles must not meet.
    changed_boxes: Option<Vec<Aabb>>,
    /// Number of edges that are examined at once the next time, and number examined one after the other before that.
    reach: usize,
    pause: usize,
    report: SimplifyReport,
}

/// Quadrics of the corners at each vertex, and of walls along the special edges.
fn vertex_quadrics(
    mesh: &TriMesh,
    adjacency: &Adjacency,
    surface: &Surface,
    frame: Frame,
    progress: &Progress,
) -> Result<Vec<Quadric>, Cancelled> {
    let local = |v: u32| frame.to_local(mesh.positions()[v as usize]);
    let mut quadrics = par_collect(mesh.positions().len(), progress, |v| {
        let corners = surface.star(v).map(|(_, t)| Quadric::corner(t.map(local)));
        [corners.fold(Quadric::default(), |sum, corner| sum + corner)]
    })?;
    for (edge, &ends) in (0_u32..).zip(adjacency.edges()) {
        if edge.is_multiple_of(AT_ONCE) {
            progress.check()?;
        }
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
    Ok(quadrics)
}

/// The triangles by place, for the search for intersections.
fn triangle_tree(
    surface: &Surface,
    bounds: Aabb,
    progress: &Progress,
) -> Result<LooseOctree, Cancelled> {
    let mut tree = LooseOctree::new(bounds, surface.triangles.len());
    for (t, corners) in (0_u32..).zip(&surface.triangles) {
        if t.is_multiple_of(AT_ONCE) {
            progress.check()?;
        }
        if *corners != GONE {
            tree.insert(t, &Aabb::around(surface.corners(t)));
        }
    }
    Ok(tree)
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
            waiting,
        } = start;
        let adjacency = Adjacency::try_new(mesh, progress)?;
        let surface = Surface::new(mesh, &adjacency, params, &keep, progress)?;
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
        let quadrics = vertex_quadrics(mesh, &adjacency, &surface, frame, progress)?;
        let mut is_sealed = vec![false; if sealed.is_empty() { 0 } else { vertices }];
        for &v in sealed {
            is_sealed[v as usize] = true;
        }
        let limits = Limits::new(params);
        let planned: Vec<Result<Entry, Veto>> =
            par_collect(adjacency.edges().len(), progress, |edge| {
                let ends = adjacency.edges()[edge as usize];
                let planned = planned(&surface, &quadrics, frame, ends, limits.max_error);
                [planned.map(|(_, cost)| Entry::new(cost, ends, 0))]
            })?;
        let mut report = SimplifyReport {
            triangles_before: mesh.triangles().len() as u64,
            ..SimplifyReport::default()
        };
        let mut queue = Queue::new();
        for (edge, planned) in (0_u32..).zip(planned) {
            if edge.is_multiple_of(AT_ONCE) {
                progress.check()?;
            }
            match planned {
                Ok(entry) => queue.push(entry),
                Err(veto) => report.vetoes.count(veto),
            }
        }
        progress.check()?;
        let tree = if params.avoid_intersections {
            Some(triangle_tree(&surface, bounds, progress)?)
        } else {
            None
        };
        let limited = params.max_error < f64::INFINITY;
        let deviation = limited.then(|| {
            let known = known.unwrap_or_else(|| samples(mesh, &adjacency));
            Deviation::new(known, surface.triangles.len(), original)
        });
        Ok(Self {
            state: State {
                surface,
                quadrics,
                deviation,
                frame,
                limits,
                tree,
                sealed: is_sealed,
                judge,
            },
            waiting,
            stamps: vec![0; vertices],
            merged_into: (0..vertices as u32).collect(),
            touched: vec![0; vertices],
            target: params.target_triangles,
            queue,
            vetoed: Vec::new(),
            marks: Marks::new(vertices),
            examiner: Examiner::new(vertices),
            examiners: Mutex::default(),
            last: Collapse::default(),
            ahead: Vec::new(),
            changed_boxes: None,
            reach: AHEAD[0],
            pause: 0,
            report,
        })
    }

    /// Collapses edges until the target is reached or nothing more is allowed.
    pub fn run(&mut self, phase: &Phase, progress: &Progress) -> Result<(), Cancelled> {
        for _ in 0..ROUNDS {
            let before = self.report.collapses;
            while !self.is_done() {
                let many = self.max_ahead();
                let batch = self.next(many);
                match batch.as_slice() {
                    [] => break,
                    [entry] => self.try_collapse(*entry, phase, progress)?,
                    _ => self.examine_ahead(&batch, phase, progress)?,
                }
            }
            if self.is_done() || self.report.collapses == before {
                break;
            }
            for (i, (entry, when)) in std::mem::take(&mut self.vetoed).into_iter().enumerate() {
                if i % VETOED_AT_ONCE == 0 {
                    progress.check()?;
                }
                if !self.is_current(&entry) {
                    continue;
                }
                if self.has_changed(&entry, when) {
                    self.queue.push(entry);
                } else {
                    self.vetoed.push((entry, when));
                }
            }
        }
        Ok(())
    }

    fn is_done(&self) -> bool {
        self.state.surface.alive <= self.target
    }

    #[inline]
    fn stamp(&self, [a, b]: [u32; 2]) -> u32 {
        self.stamps[a as usize].wrapping_add(self.stamps[b as usize])
    }

    /// Returns `true` if neither end was merged since the edge was put into the queue.
    #[inline]
    fn is_current(&self, entry: &Entry) -> bool {
        self.stamp(entry.ends) == entry.stamp
    }

    /// Returns `true` if triangles at either end have changed since the given number of collapses.
    #[inline]
    fn has_changed(&self, entry: &Entry, when: u32) -> bool {
        let mut touched = entry.ends.into_iter().map(|v| self.touched[v as usize]);
        touched.any(|touched| touched > when)
    }

    /// Number of edges to examine at once: one if all threads have work.
    fn max_ahead(&mut self) -> usize {
        let is_last = self.waiting.load(Ordering::Relaxed) == 0;
        if self.pause > 0 || !is_last || rayon::current_num_threads() == 1 {
            self.pause = self.pause.saturating_sub(1);
            1
        } else {
            self.reach
        }
    }

    /// Looks ahead the farther the fewer of `all` edges were examined in vain.
    fn adapt(&mut self, in_vain: usize, all: usize) {
        let [least, most] = AHEAD;
        let share = in_vain as f64 / all as f64;
        if share < IN_VAIN[0] {
            self.reach = (2 * self.reach).min(most);
        } else if share > IN_VAIN[1] {
            self.pause = if self.reach == least { PAUSE } else { 0 };
            self.reach = (self.reach / 2).max(least);
        }
    }

    /// The next edges, at most so `many`.
    fn next(&mut self, many: usize) -> Vec<Entry> {
        let mut batch = Vec::with_capacity(many);
        while batch.len() < many
            && let Some(entry) = self.queue.pop()
        {
            if self.is_current(&entry) {
                batch.push(entry);
            }
        }
        batch
    }

    /// Examines all of a batch at once, as if each were next, and lets those collapse that may. The result is that of
    /// examining them one after the other: edges that come to be meanwhile have their turn, and where something has
    /// changed since around an edge, it is examined again.
    fn examine_ahead(
        &mut self,
        batch: &[Entry],
        phase: &Phase,
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        let mut ahead = std::mem::take(&mut self.ahead);
        if ahead.len() < batch.len() {
            ahead.resize_with(batch.len(), Collapse::default);
        }
        self.examine_all(batch, &mut ahead, progress)?;
        let since = self.report.collapses as u32;
        // what is still in the bucket of the last one comes after it
        let last = batch.last().map_or(0, |entry| entry.bucket);
        let after_last = self.queue.count_in(last);
        self.changed_boxes = self.state.tree.is_some().then(Vec::new);
        let mut in_vain = 0;
        for (entry, collapse) in batch.iter().zip(&mut ahead) {
            let old = if entry.bucket == last { after_last } else { 0 };
            while !self.is_done()
                && let Some(cheaper) = self.queue.pop_up_to(entry.bucket, old)
            {
                if self.is_current(&cheaper) {
                    self.try_collapse(cheaper, phase, progress)?;
                }
            }
            if self.is_done() {
                break;
            }
            if !self.is_current(entry) {
                in_vain += 1;
                continue;
            }
            let bounds = collapse.change.bounds();
            let mut changed_boxes = self.changed_boxes.iter().flatten();
            if self.has_changed(entry, since) || changed_boxes.any(|b| b.touches(&bounds)) {
                in_vain += 1;
                self.try_collapse(*entry, phase, progress)?;
            } else {
                self.decide(*entry, collapse, phase);
            }
        }
        self.ahead = ahead;
        self.changed_boxes = None;
        self.adapt(in_vain, batch.len());
        Ok(())
    }

    /// Examines all of a batch, side by side.
    fn examine_all(
        &self,
        batch: &[Entry],
        ahead: &mut [Collapse<J::Findings>],
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        // not locked during the examination: a judge with parallel work of its own may make this thread take up another part
        let (state, examiners, vertices) = (&self.state, &self.examiners, self.stamps.len());
        let idle = || examiners.lock().unwrap_or_else(PoisonError::into_inner);
        let part = batch.len().div_ceil(MAX_PARTS);
        let parts = batch.par_chunks(part).zip(ahead.par_chunks_mut(part));
        parts.try_for_each(|(entries, collapses)| {
            let examiner = idle().pop();
            let mut examiner = examiner.unwrap_or_else(|| Examiner::new(vertices));
            for (entry, collapse) in entries.iter().zip(collapses) {
                progress.check()?;
                state.examine(entry.ends, &mut examiner, collapse);
            }
            idle().push(examiner);
            Ok(())
        })
    }

    /// Examines an edge, and lets it collapse if it may.
    fn try_collapse(
        &mut self,
        entry: Entry,
        phase: &Phase,
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        progress.check()?;
        let mut collapse = std::mem::take(&mut self.last);
        (self.state).examine(entry.ends, &mut self.examiner, &mut collapse);
        self.decide(entry, &mut collapse, phase);
        self.last = collapse;
        Ok(())
    }

    /// Lets an edge collapse, or puts it away for the next round.
    fn decide(&mut self, entry: Entry, collapse: &mut Collapse<J::Findings>, phase: &Phase) {
        match collapse.verdict {
            Ok(()) => {
                self.collapse(collapse);
                phase.advance(collapse.change.vanishing.len() as u64);
            }
            Err(veto) => {
                self.report.vetoes.count(veto);
                self.vetoed.push((entry, self.report.collapses as u32));
            }
        }
    }

    fn collapse(&mut self, collapse: &mut Collapse<J::Findings>) {
        let Plan { kept, removed, .. } = collapse.plan;
        self.report.collapses += 1;
        self.state.collapse(collapse);
        if let Some(boxes) = &mut self.changed_boxes {
            boxes.push(collapse.change.bounds_of_all());
        }
        self.merged_into[removed as usize] = kept;
        for v in [kept, removed] {
            self.stamps[v as usize] = self.stamps[v as usize].wrapping_add(1);
        }
        // the edges of the merged vertex
        let mark = self.marks.next();
        self.marks.is_new(kept, mark);
        let now = self.report.collapses as u32;
        self.touched[kept as usize] = now;
        for &t in &collapse.change.changed {
            for w in self.state.surface.triangles[t as usize] {
                if !self.marks.is_new(w, mark) {
                    continue;
                }
                self.touched[w as usize] = now;
                let ends = [kept, w];
                match self.state.cost(ends) {
                    Ok(cost) => self.queue.push(Entry::new(cost, ends, self.stamp(ends))),
                    Err(veto) => self.report.vetoes.count(veto),
                }
            }
        }
    }

    /// Number of triangles that may still go.
    pub fn max_to_do(&self) -> u64 {
        self.state.surface.alive.saturating_sub(self.target)
    }

    /// Takes what is left, in the names of the mesh that was given.
    pub fn take_apart(self) -> Leftover {
        let Self {
            state,
            mut merged_into,
            mut report,
            ..
        } = self;
        let State {
            surface, deviation, ..
        } = state;
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
            features: surface.features(),
            positions: surface.positions,
            triangles: surface.triangles,
            merged_into,
            report,
        }
    }
}

/// The result of an engine, in the names of the mesh it was given.
pub(super) struct Leftover {
    /// Positions of the vertices that are still there.
    pub positions: Vec<DVec3>,
    /// The corners of the triangles that are still there.
    pub triangles: Vec<[u32; 3]>,
    /// The vertex that stands for each vertex.
    pub merged_into: Vec<u32>,
    pub features: Vec<[u32; 2]>,
    pub samples: Vec<Sample>,
    pub report: SimplifyReport,
}

impl Leftover {
    /// The mesh of what is still there, with its samples if requested.
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
            // by value, so that they take the place of what they are made of: there may be more of them than of all else
            let moved = self.samples.into_iter().map(|sample| ErrorSample {
                place: sample.place,
                triangle: number[sample.triangle as usize],
            });
            samples = moved.collect();
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
