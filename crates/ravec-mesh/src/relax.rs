//! Better facets for the same surface: vertices move, edges flip and are divided until facets lie as somebody wants them to.
//!
//! Simplification leaves facets that lie badly: across a crease that was too shallow to be noticed, or between vertices
//! that had to stay. Only the caller can say which facets lie badly, by a number for each, its *fault*. Then, from the
//! worst facet on: of all flips of its edges and moves of its corners the one is taken that lowers the faults around it
//! most; if none does, an edge is divided, if the caller has a place for a new vertex. As every step lowers the sum of
//! all faults, the process ends.
//!
//! Facets are examined side by side, in batches of some of the worst whose surroundings lie apart, so that no step changes
//! what another one was chosen by. A step whose facets come near those of another one in the batch waits.
//!
//! Guarantees: vertices and triangles keep their numbers, new ones come behind them; topology and orientation stay what they
//! are; edges with one triangle, or with more than two, and their vertices stay as they are; facets turn by less than a right
//! angle at a time; triangles that did not meet do not meet, exactly; the same result on any number of threads. Does not
//! guarantee: the least possible sum of faults; a distance to what was there before, unless the caller refuses steps.
//! Cost: one description of each facet; then for each facet with a fault nine candidates, each of which costs a description of the facets
//! that it changes, until it is seen to be of no use, and a search for intersections for the best of them.
//!
//! Source: local steps as in Hoppe et al., "Mesh Optimization", 1993, without its collapses.

mod steps;

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use crate::{Aabb, TriMesh};
use steps::{Fan, Scratch, Step, Steps};

/// The share of the faults around it that a step must remove.
const MIN_GAIN: f64 = 0.02;

/// The share of the faults of two facets that dividing them must remove: what costs two triangles must be worth it.
const MIN_GAIN_OF_SPLIT: f64 = 0.1;

/// Bound on the number of steps for each facet that has a fault at first. Far fewer are taken where they are of use.
const MAX_STEPS: usize = 8;

/// Number of facets that are examined side by side. More keep more threads busy, but are farther from the order of the
/// worst first.
const BATCH: usize = 64;

/// Bound on the facets that are passed over for each batch because they are too close to others of it.
const MAX_PASSED_OVER: usize = 4 * BATCH;

/// The name of a vertex that does not exist yet, in the facets that have it.
pub const NEW_VERTEX: u32 = u32::MAX;

/// A facet as it is, or as it would be.
#[derive(Debug, Clone, Copy)]
pub struct Facet<L> {
    /// The names of its corners, by their index in the mesh, or [`NEW_VERTEX`].
    pub names: [u32; 3],
    /// Positions of its corners.
    pub corners: [DVec3; 3],
    /// The judge's description of it.
    pub descriptor: L,
}

impl<L> Facet<L> {
    /// Position of the corner with a name, if the facet has it.
    pub fn corner(&self, name: u32) -> Option<DVec3> {
        let at = self.names.iter().position(|&v| v == name)?;
        Some(self.corners[at])
    }
}

/// The judge of facets and of steps.
pub trait RelaxJudge: Sync {
    /// Description of a facet from which a judge computes its fault.
    type Descriptor: Copy + Send + Sync;

    /// Describes a facet with these corners; `like` describes one that was there, or nearby, if there was any.
    fn describe(&self, corners: [DVec3; 3], like: Option<&Self::Descriptor>) -> Self::Descriptor;

    /// Fault of a facet with this description: 0 if it may stay, else positive and finite.
    fn fault(&self, descriptor: &Self::Descriptor) -> f64;

    /// The better place of the vertex `of`; `around` are the facets that have it as a corner. `None` if it may stay. It
    /// may come to be there, or on the way there.
    fn place(&self, of: u32, around: &[Facet<Self::Descriptor>]) -> Option<DVec3>;

    /// Position of a new vertex that divides the edge between two vertices, and both facets beside it in two; the first of these is
    /// the one at fault. `None` (always, unless the judge says otherwise) if they should stay whole.
    fn between(&self, _ends: [u32; 2], _facets: &[Facet<Self::Descriptor>; 2]) -> Option<DVec3> {
        None
    }

    /// The nearest place that a vertex may have: any, unless the judge says otherwise.
    fn rounded(&self, place: DVec3) -> DVec3 {
        place
    }

    /// Returns `true` if a step may be taken that lowers faults and lets no triangles meet; `after` are the facets that
    /// it makes.
    fn admits(&self, after: &[Facet<Self::Descriptor>]) -> bool;
}

/// The result of relaxing a mesh.
#[derive(Debug, Clone)]
pub struct Relaxed {
    /// The mesh: what was there before, in the same order, then what was added.
    pub mesh: TriMesh,
    /// Edges that were flipped.
    pub flips: u64,
    /// Vertices that were moved.
    pub moves: u64,
    /// Edges that were divided, each by one new vertex, which makes two new triangles.
    pub splits: u64,
    /// The sum of all faults before and after.
    pub faults: [f64; 2],
}

/// A facet that waits, worst first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Waiting {
    fault: f64,
    triangle: u32,
}

impl Eq for Waiting {}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_fault = self.fault.total_cmp(&other.fault);
        by_fault.then(other.triangle.cmp(&self.triangle))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Moves vertices, flips and divides edges of `mesh` where `judge` finds fault.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn relax<J: RelaxJudge>(
    mesh: &TriMesh,
    judge: &J,
    progress: &Progress,
) -> Result<Relaxed, Cancelled> {
    progress.check()?;
    let descriptors: Vec<J::Descriptor> = (0..mesh.triangles().len() as u32)
        .into_par_iter()
        .map(|t| {
            progress.check()?;
            Ok(judge.describe(mesh.corners(t), None))
        })
        .collect::<Result<_, Cancelled>>()?;
    let faults: Vec<f64> = descriptors
        .iter()
        .map(|descriptor| judge.fault(descriptor))
        .collect();
    let before = faults.iter().sum();
    let mut relaxed = Relaxed {
        mesh: TriMesh::default(),
        flips: 0,
        moves: 0,
        splits: 0,
        faults: [before, before],
    };
    let mut queue = Queue::new(faults);
    let mut left = MAX_STEPS * queue.waiting.len();
    if left == 0 {
        relaxed.mesh = mesh.clone();
        return Ok(relaxed);
    }
    let mut steps = Steps::new(mesh, descriptors, judge, progress)?;
    while left > 0 {
        let batch = queue.next_batch(&steps);
        if batch.is_empty() {
            break;
        }
        progress.check()?;
        let found: Vec<Option<(Step, Fan<J::Descriptor>)>> = batch
            .par_iter()
            .map_init(Scratch::default, |scratch, waiting| {
                best(&steps, &queue.faults, waiting.triangle, scratch)
            })
            .collect();
        let mut taken: Vec<Aabb> = Vec::new();
        for (waiting, found) in batch.into_iter().zip(found) {
            let Some((step, fan)) = found else {
                continue;
            };
            let bounds = fan.bounds();
            if left == 0 || taken.iter().any(|other| other.touches(&bounds)) {
                queue.waiting.push(waiting);
                continue;
            }
            taken.push(bounds);
            match step {
                Step::Flip { .. } => relaxed.flips += 1,
                Step::Move { .. } => relaxed.moves += 1,
                Step::Split { .. } => relaxed.splits += 1,
            }
            let triangles = steps.take(step, &fan);
            for (t, facet) in triangles.into_iter().zip(&fan.after) {
                queue.put(t, judge.fault(&facet.descriptor));
            }
            left -= 1;
        }
    }
    relaxed.faults[1] = queue.faults.iter().sum();
    relaxed.mesh = steps.into_mesh();
    Ok(relaxed)
}

/// The facets at fault.
struct Queue {
    /// Fault of each triangle.
    faults: Vec<f64>,
    waiting: BinaryHeap<Waiting>,
}

impl Queue {
    fn new(faults: Vec<f64>) -> Self {
        let waiting = (0..)
            .zip(&faults)
            .filter(|(_, fault)| **fault > 0.0)
            .map(|(triangle, &fault)| Waiting { fault, triangle })
            .collect();
        Self { faults, waiting }
    }

    /// Notes the fault of a triangle, which may be the next new one.
    fn put(&mut self, triangle: u32, fault: f64) {
        let at = triangle as usize;
        self.faults.resize(self.faults.len().max(at + 1), 0.0);
        self.faults[at] = fault;
        if fault > 0.0 {
            self.waiting.push(Waiting { fault, triangle });
        }
    }

    /// The worst facets whose surroundings lie apart; empty if there are none.
    fn next_batch<J: RelaxJudge>(&mut self, steps: &Steps<'_, J>) -> Vec<Waiting> {
        let mut batch = Vec::with_capacity(BATCH);
        let mut boxes: Vec<Aabb> = Vec::with_capacity(BATCH);
        let mut passed_over = Vec::new();
        while batch.len() < BATCH && passed_over.len() < MAX_PASSED_OVER {
            let Some(waiting) = self.waiting.pop() else {
                break;
            };
            // it was changed meanwhile, and waits elsewhere in the queue if that is of use
            let now = self.faults[waiting.triangle as usize];
            if now.total_cmp(&waiting.fault) != Ordering::Equal {
                continue;
            }
            let bounds = steps.surroundings(waiting.triangle);
            if boxes.iter().any(|other| other.touches(&bounds)) {
                passed_over.push(waiting);
            } else {
                boxes.push(bounds);
                batch.push(waiting);
            }
        }
        self.waiting.extend(passed_over);
        batch
    }
}

/// Of the steps that concern a facet, the one that lowers faults most and may be taken; with the facets that it makes.
fn best<J: RelaxJudge>(
    steps: &Steps<'_, J>,
    faults: &[f64],
    triangle: u32,
    scratch: &mut Scratch,
) -> Option<(Step, Fan<J::Descriptor>)> {
    let mut of = |candidates: Vec<Step>, min_gain: f64| {
        let mut candidates: Vec<(Step, Fan<J::Descriptor>)> = (candidates.into_iter())
            .filter_map(|step| Some((step, steps.fan(step, faults, min_gain)?)))
            .collect();
        // the sort is stable: of equal gains the first candidate wins
        candidates.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain));
        (candidates.into_iter())
            .find(|(_, fan)| steps.stay_apart(fan, scratch) && steps.judge.admits(&fan.after))
    };
    of(steps.of_triangle(triangle), MIN_GAIN)
        .or_else(|| of(steps.splits_of(triangle), MIN_GAIN_OF_SPLIT))
}
