//! Better facets for the same surface: vertices move and edges flip until facets lie as somebody wants them to.
//!
//! Simplification leaves facets that lie badly: across a crease that was too shallow to be noticed, or between vertices that
//! had to stay. What lies badly only the caller can say, as a number for each facet, its *fault*. Then, from the worst facet
//! on: of all flips of its edges and moves of its corners the one is taken that lowers the faults around it most. As every
//! step lowers the sum of all faults, the process ends.
//!
//! Guarantees: the number of vertices and of triangles, topology and orientation stay what they are; edges with one
//! triangle, or with more than two, and their vertices stay as they are; facets turn by less than a right angle at a time;
//! triangles that did not meet do not meet, exactly; the same result on any number of threads. Does not guarantee: the least
//! possible sum of faults; a distance to what was there before, unless the caller refuses steps.
//! Cost: one look at each facet; then for each facet with a fault six candidates, each of which costs a look at the facets
//! that it changes, until it is seen to be of no use, and a search for intersections for the best of them.
//!
//! Source: local steps as in Hoppe et al., "Mesh Optimization", 1993, without its collapses and splits.

mod steps;

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use crate::TriMesh;
use steps::{Fan, Step, Steps};

/// The share of the faults around it that a step must remove.
const LEAST_GAIN: f64 = 0.02;

/// How many steps there may be for each facet that has a fault at first. Far fewer are taken where they are of use.
const MOST_STEPS: usize = 8;

/// A facet as it is, or as it would be.
#[derive(Debug, Clone, Copy)]
pub struct Facet<L> {
    /// The names of its corners, by their index in the mesh.
    pub names: [u32; 3],
    /// Where these are.
    pub corners: [DVec3; 3],
    /// What the judge sees in it.
    pub look: L,
}

/// Who says what is wanted.
pub trait RelaxJudge: Sync {
    /// What a judge has to find out about a facet to judge it.
    type Look: Copy + Send + Sync;

    /// Looks at a facet with these corners; `like` is the look of one that was there, or nearby, if there was any.
    fn look(&self, corners: [DVec3; 3], like: Option<&Self::Look>) -> Self::Look;

    /// How badly a facet lies that looks like this: 0 if it may stay, else more than that, finite.
    fn fault(&self, look: &Self::Look) -> f64;

    /// Where the vertex `of` would better be; `around` are the facets that have it as a corner. `None` if it may stay.
    fn place(&self, of: u32, around: &[Facet<Self::Look>]) -> Option<DVec3>;

    /// Whether a step may be taken that lowers faults and lets no triangles meet; `after` are the facets that it makes.
    fn admits(&self, after: &[Facet<Self::Look>]) -> bool;
}

/// What became of a mesh.
#[derive(Debug, Clone)]
pub struct Relaxed {
    /// The mesh, with as many vertices and triangles as before.
    pub mesh: TriMesh,
    /// Edges that were flipped.
    pub flips: u64,
    /// Vertices that were moved.
    pub moves: u64,
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

/// Moves vertices and flips edges of `mesh` where `judge` finds fault.
///
/// # Errors
/// [`Cancelled`] if `progress` says so.
pub fn relax<J: RelaxJudge>(
    mesh: &TriMesh,
    judge: &J,
    progress: &Progress,
) -> Result<Relaxed, Cancelled> {
    progress.check()?;
    let looks: Vec<J::Look> = (0..mesh.triangles().len() as u32)
        .into_par_iter()
        .map(|t| {
            progress.check()?;
            Ok(judge.look(mesh.corners(t), None))
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut faults: Vec<f64> = looks.iter().map(|look| judge.fault(look)).collect();
    let before = faults.iter().sum();
    let mut queue: BinaryHeap<Waiting> = (0..)
        .zip(&faults)
        .filter(|(_, fault)| **fault > 0.0)
        .map(|(triangle, &fault)| Waiting { fault, triangle })
        .collect();
    let mut left = MOST_STEPS * queue.len();
    if left == 0 {
        return Ok(Relaxed {
            mesh: mesh.clone(),
            flips: 0,
            moves: 0,
            faults: [before, before],
        });
    }
    let mut steps = Steps::new(mesh, looks, judge, progress)?;
    let (mut flips, mut moves) = (0, 0);
    while let Some(Waiting { fault, triangle }) = queue.pop() {
        progress.check()?;
        // it was changed meanwhile, and waits elsewhere in the queue if that is of use
        if faults[triangle as usize].total_cmp(&fault) != Ordering::Equal {
            continue;
        }
        let Some((step, fan)) = best(&mut steps, &faults, triangle) else {
            continue;
        };
        match step {
            Step::Flip { .. } => flips += 1,
            Step::Move { .. } => moves += 1,
        }
        steps.take(step, &fan);
        for (&t, facet) in fan.triangles.iter().zip(&fan.after) {
            let fault = judge.fault(&facet.look);
            faults[t as usize] = fault;
            if fault > 0.0 {
                queue.push(Waiting { fault, triangle: t });
            }
        }
        left -= 1;
        if left == 0 {
            break;
        }
    }
    Ok(Relaxed {
        mesh: steps.into_mesh(),
        flips,
        moves,
        faults: [before, faults.iter().sum()],
    })
}

/// Of the steps that concern a facet, the one that lowers faults most and may be taken; with the facets that it makes.
fn best<J: RelaxJudge>(
    steps: &mut Steps<'_, J>,
    faults: &[f64],
    triangle: u32,
) -> Option<(Step, Fan<J::Look>)> {
    let mut candidates: Vec<(Step, Fan<J::Look>)> = (steps.of_triangle(triangle).into_iter())
        .filter_map(|step| Some((step, steps.fan(step, faults, LEAST_GAIN)?)))
        .collect();
    // the sort is stable: of equal gains the first candidate wins
    candidates.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain));
    candidates
        .into_iter()
        .find(|(_, fan)| steps.stay_apart(fan) && steps.judge.admits(&fan.after))
}
