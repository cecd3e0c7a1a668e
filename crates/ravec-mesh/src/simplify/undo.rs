//! Undoing of the collapses that left faults after a step of simplification.
//!
//! Clusters are restored: vertices that were merged are there again, where they were. That is easy, since a triangle is
//! there if and only if its corners were not merged with each other. Of what is at fault only as much is restored as
//! may be enough: what changed since the checkpoint, or else the smallest cluster. For restored triangles have others
//! beside them at fault, and what is restored from farther back spreads farther. The restored surface is examined
//! again, until nothing is at fault.

use std::sync::Mutex;

use glam::DVec3;
use ravec_progress::Cancelled;
use rayon::prelude::*;

use super::SimplifyError;
use super::deviation::Sample;
use super::judge::JudgeFactory;
use super::parts::Part;
use super::patches::{Assembly, Task};
use crate::adjacency::is_proper;
use crate::{Aabb, Adjacency, BoxTree, CandidateTree, TriMesh, for_each_self_intersection};

/// Earlier places and merges to which vertices may be restored.
pub(super) struct Checkpoint {
    positions: Vec<DVec3>,
    merged_into: Vec<u32>,
}

impl Checkpoint {
    pub fn new(assembly: &Assembly) -> Self {
        Self {
            positions: assembly.positions.clone(),
            merged_into: assembly.merged_into.clone(),
        }
    }
}

/// Vertices whose triangles have to be examined.
struct Suspects {
    vertices: Vec<bool>,
    /// `true` if other triangles may meet each other, too.
    may_all_meet: bool,
}

/// Vertices, by their names in the original, whose triangles must not stay, or not together.
type Fault = Vec<u32>;

/// History of each vertex.
struct History<'a> {
    /// The one that stood for it before anything was undone.
    merged: &'a [u32],
    /// The one that stood for it at the checkpoint.
    before: &'a [u32],
    /// Of those that stand for others, whether one of these was merged or moved since the checkpoint.
    is_new: Vec<bool>,
    /// Number of vertices that it stood for at the checkpoint.
    size: Vec<u32>,
    restored: Vec<bool>,
    /// `true` if it is restored to its original state.
    is_original: Vec<bool>,
}

impl<'a> History<'a> {
    fn new(merged: &'a [u32], checkpoint: Option<&'a Checkpoint>, positions: &[DVec3]) -> Self {
        let before = checkpoint.map_or(merged, |checkpoint| &checkpoint.merged_into);
        let mut is_new = vec![false; merged.len()];
        if let Some(checkpoint) = checkpoint {
            for (&now, &then) in merged.iter().zip(before) {
                let place = now as usize;
                let is_moved = positions[place] != checkpoint.positions[place];
                is_new[place] |= is_moved || then != now;
            }
        }
        let mut size = vec![0; merged.len()];
        for &v in before {
            size[v as usize] += 1;
        }
        Self {
            merged,
            before,
            is_new,
            size,
            restored: vec![false; merged.len()],
            is_original: vec![false; merged.len()],
        }
    }

    /// Returns `true` if a vertex can go back to what it was at the checkpoint.
    fn is_recent(&self, v: u32) -> bool {
        self.is_new[self.merged[v as usize] as usize] && !self.restored[v as usize]
    }

    /// Of how many a vertex was made until the checkpoint, if it can go back to what it was in the beginning.
    fn parts(&self, v: u32) -> Option<u32> {
        let size = self.size[self.before[v as usize] as usize];
        (size > 1 && !self.is_original[v as usize]).then_some(size)
    }
}

/// Clusters that are to be undone, by the vertices that stand for them.
struct Orders {
    to_checkpoint: Vec<bool>,
    to_original: Vec<bool>,
    are_any: bool,
}

impl Orders {
    /// The vertices to restore in order to repair faults.
    fn new(faults: &[Fault], history: &History<'_>) -> Self {
        let vertices = history.merged.len();
        let mut orders = Self {
            to_checkpoint: vec![false; vertices],
            to_original: vec![false; vertices],
            are_any: false,
        };
        for fault in faults {
            let recent = fault.iter().filter(|&&v| history.is_recent(v));
            let mut is_repaired = false;
            for &v in recent {
                orders.to_checkpoint[history.merged[v as usize] as usize] = true;
                is_repaired = true;
            }
            // what was there at the checkpoint is to blame only if nothing else is
            if !is_repaired {
                let parts = fault.iter().filter_map(|&v| Some((history.parts(v)?, v)));
                if let Some((_, v)) = parts.min() {
                    orders.to_original[history.before[v as usize] as usize] = true;
                    is_repaired = true;
                }
            }
            orders.are_any |= is_repaired;
        }
        orders
    }
}

impl<O: JudgeFactory> Task<'_, O> {
    /// Undoes what is at fault, if there was a checkpoint back to that, and says of which vertices something was undone.
    pub(super) fn restore(
        &self,
        assembly: &mut Assembly,
        checkpoint: Option<&Checkpoint>,
    ) -> Result<Vec<bool>, SimplifyError> {
        let merged: Vec<u32> = assembly.merged_into.clone();
        let mut history = History::new(&merged, checkpoint, &assembly.positions);
        let all = 0..self.mesh.triangles().len() as u32;
        let mut suspects = checkpoint.map(|_| Suspects {
            vertices: merged.iter().map(|&v| history.is_new[v as usize]).collect(),
            may_all_meet: true,
        });
        loop {
            self.progress.check()?;
            let part = Part::new(self.mesh, assembly.now(), all.clone());
            self.progress.check()?;
            let faults = self.faults(&part, suspects.as_ref(), &history.restored)?;
            let orders = Orders::new(&faults, &history);
            if !orders.are_any {
                return Ok(history.restored);
            }
            let fresh = self.undo(&orders, &mut history, assembly, checkpoint);
            suspects = Some(Suspects {
                vertices: fresh,
                may_all_meet: false,
            });
        }
    }

    /// Restores clusters, with the samples that go back to their triangles, and says which vertices they are.
    fn undo(
        &self,
        orders: &Orders,
        history: &mut History<'_>,
        assembly: &mut Assembly,
        checkpoint: Option<&Checkpoint>,
    ) -> Vec<bool> {
        let mut fresh = vec![false; history.merged.len()];
        for v in 0..fresh.len() {
            let [merged, before] = [history.merged, history.before].map(|names| names[v] as usize);
            if orders.to_original[before] && !history.is_original[v] {
                history.is_original[v] = true;
                assembly.merged_into[v] = v as u32;
                assembly.positions[v] = self.mesh.positions()[v];
            } else if orders.to_checkpoint[merged] && !history.restored[v] {
                assembly.merged_into[v] = history.before[v];
                if let Some(checkpoint) = checkpoint {
                    assembly.positions[v] = checkpoint.positions[v];
                }
            } else {
                continue;
            }
            history.restored[v] = true;
            fresh[v] = true;
        }
        let is_one = |triangle: u32, of: &[bool]| {
            let corners = self.mesh.triangles()[triangle as usize];
            let corners = corners.map(|v| assembly.merged_into[v as usize]);
            is_proper(corners) && corners.iter().any(|&v| of[v as usize])
        };
        let back = |sample: &Sample| {
            if is_one(sample.original, &history.is_original) {
                sample.original
            } else if is_one(sample.settled, &fresh) {
                sample.settled
            } else {
                sample.triangle
            }
        };
        for sample in &mut assembly.samples {
            sample.triangle = back(sample);
        }
        fresh
    }

    /// The faults of all triangles, or of those at `suspects`.
    fn faults(
        &self,
        part: &Part,
        suspects: Option<&Suspects>,
        restored: &[bool],
    ) -> Result<Vec<Fault>, Cancelled> {
        let corners = |t: u32| part.mesh.triangles()[t as usize];
        let name = |v: u32| part.vertices[v as usize];
        let suspicious: Vec<u32> = (0..part.mesh.triangles().len() as u32)
            .filter(|&t| {
                let mut names = corners(t).into_iter().map(name);
                suspects.is_none_or(|suspects| names.any(|v| suspects.vertices[v as usize]))
            })
            .collect();
        self.progress.check()?;
        // what is as it was before is as good as it was
        let is_changed =
            |&t: &u32| part.mesh.corners(t) != self.mesh.corners(part.triangles[t as usize]);
        let changed: Vec<u32> = suspicious.iter().copied().filter(is_changed).collect();
        let bad = self.judges.faults(&part.mesh, &changed);
        let of = |triangles: &[u32]| -> Fault {
            let corners = triangles.iter().flat_map(|&t| corners(t));
            corners.map(name).collect()
        };
        let mut faults: Vec<Fault> = bad.iter().map(|&t| of(&[t])).collect();
        self.progress.check()?;
        // the others were examined before
        let around = match suspects {
            Some(suspects) if !suspects.may_all_meet => {
                Some(self.touched(&part.mesh, &suspicious)?)
            }
            Some(_) | None => None,
        };
        let (mesh, number): (&TriMesh, &dyn Fn(u32) -> u32) = match &around {
            Some((mesh, numbers)) => (mesh, &|t| numbers[t as usize]),
            None => (&part.mesh, &|t| t),
        };
        if around.is_some() {
            // neighbors of what is restored may have come to be so twice
            let adjacency = Adjacency::try_new(mesh, self.progress)?;
            for (edge, ends) in (0_u32..).zip(adjacency.edges()) {
                let uses = adjacency.uses(edge);
                if uses.len() > 2 && ends.iter().any(|&v| restored[name(v) as usize]) {
                    let triangles: Vec<u32> = uses.iter().map(|at| number(at.triangle)).collect();
                    faults.push(of(&triangles));
                }
            }
        }
        if self.params.avoid_intersections && !mesh.triangles().is_empty() {
            let tree = BoxTree::try_new(mesh, self.progress)?;
            let pairs = Mutex::new(Vec::new());
            for_each_self_intersection(&tree, self.progress, |pair| {
                if let Ok(mut pairs) = pairs.lock() {
                    pairs.push([pair.first, pair.second]);
                }
            })?;
            let pairs = pairs.into_inner().unwrap_or_default();
            faults.extend(pairs.into_iter().map(|pair| of(&pair.map(number))));
        }
        Ok(faults)
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
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The vertices restored for a fault, where vertices 0 to 5 stand for clusters and 1 and 2 were merged since the
    /// checkpoint.
    fn undone(fault: &[u32], restored: &[usize]) -> (Vec<usize>, Vec<usize>) {
        let checkpoint = Checkpoint {
            positions: vec![DVec3::ZERO; 10],
            merged_into: vec![0, 1, 2, 3, 4, 5, 3, 4, 4, 2],
        };
        let merged = [0, 1, 1, 3, 4, 5, 3, 4, 4, 1];
        let mut history = History::new(&merged, Some(&checkpoint), &checkpoint.positions);
        for &v in restored {
            history.restored[v] = true;
        }
        let orders = Orders::new(&[fault.to_vec()], &history);
        let chosen = |of: &[bool]| (0..10).filter(|&v| of[v]).collect::<Vec<_>>();
        let [to_checkpoint, to_original] =
            [&orders.to_checkpoint, &orders.to_original].map(|of| chosen(of));
        assert_eq!(orders.are_any, to_checkpoint.len() + to_original.len() > 0);
        (to_checkpoint, to_original)
    }

    #[test]
    fn what_changed_since_the_checkpoint_is_undone_and_else_the_smallest_cluster() {
        assert_eq!(undone(&[0, 1, 4], &[]), (vec![1], vec![]));
        assert_eq!(undone(&[0, 4, 3], &[]), (vec![], vec![3]));
        // once it is restored, it is one of the others
        assert_eq!(undone(&[0, 2, 4], &[1, 2, 9]), (vec![], vec![2]));
        // what was never merged is as it was
        assert_eq!(undone(&[0, 5, 1], &[1, 2, 9]), (vec![], vec![]));
    }
}
