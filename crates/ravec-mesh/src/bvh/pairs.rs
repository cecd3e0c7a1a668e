//! Pairs of triangles of one mesh whose boxes touch: the candidates for intersections.
//!
//! The tree is paired with itself: a node with itself gives its children, each with itself and with the ones after it; two
//! children whose boxes do not touch hold no pair. Boxes were rounded outward, so nothing is lost; what is left at the
//! leaves is decided on the boxes of the triangles in double precision.
//!
//! Guarantees: each pair is found once; the order of the pairs is the same each time and on any number of threads.
//! Does not guarantee: any particular order.
//! Cost: about half a second a million triangles of an ordinary surface and core; proportional to the pairs found where
//! they abound.

use std::ops::Range;

use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use super::BoxTree;
use super::frame::LocalBox;
use super::node::{Child, Node, lanes};
use crate::Aabb;

/// Pieces into which parallel work is cut: many more than cores, so that none waits for long.
const TASKS: usize = 1024;

/// Triangles that are still to be paired.
#[derive(Debug, Clone, Copy)]
enum Task {
    /// All pairs within.
    Within(Child),
    /// All pairs of one of the first and one of the second.
    Between([(Child, LocalBox); 2]),
}

impl BoxTree {
    /// Calls `visit` with each pair of triangles whose boxes touch, the lower index first.
    ///
    /// Neighbors in a mesh are such pairs.
    pub fn for_each_overlapping_pair(&self, mut visit: impl FnMut(u32, u32)) {
        if !self.is_empty() {
            let task = Task::Within(Child::Node(0));
            Pairing(&self.nodes).pair_up(task, &mut |slot, others| {
                self.pair_slots(slot, others, &mut visit);
            });
        }
    }

    /// Applies `keep` to the pairs of triangles whose boxes touch, in the caller's thread pool, and returns the results
    /// that it keeps. The lower index is handed over first.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn filter_overlapping_pairs<T: Send>(
        &self,
        progress: &Progress,
        keep: impl Fn(u32, u32) -> Option<T> + Sync,
    ) -> Result<Vec<T>, Cancelled> {
        Pairing(&self.nodes).filter(progress, |slot, others, kept| {
            self.pair_slots(slot, others, &mut |a, b| kept.extend(keep(a, b)));
        })
    }

    fn pair_slots(&self, slot: u32, others: Range<u32>, visit: &mut impl FnMut(u32, u32)) {
        let bounds = |slot: u32| Aabb::around(self.corners[slot as usize]);
        let here = bounds(slot);
        let triangle = self.triangle_of[slot as usize];
        for other in others {
            if here.touches(&bounds(other)) {
                let other = self.triangle_of[other as usize];
                visit(triangle.min(other), triangle.max(other));
            }
        }
    }
}

/// The nodes of a tree that is paired with itself.
pub(super) struct Pairing<'a>(pub &'a [Node]);

impl Pairing<'_> {
    /// Runs `keep` in parallel on each slot and a run of others, for all pairs of slots whose leaves touch, and
    /// collects the results that it puts into a list.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn filter<T: Send>(
        &self,
        progress: &Progress,
        keep: impl Fn(u32, Range<u32>, &mut Vec<T>) + Sync,
    ) -> Result<Vec<T>, Cancelled> {
        progress.check()?;
        let tasks = self.tasks();
        let phase = progress.phase("pairs", tasks.len() as u64);
        let kept: Vec<Vec<T>> = tasks
            .into_par_iter()
            .map(|task| {
                progress.check()?;
                let mut kept = Vec::new();
                self.pair_up(task, &mut |slot, others| keep(slot, others, &mut kept));
                phase.advance(1);
                Ok(kept)
            })
            .collect::<Result<_, _>>()?;
        Ok(kept.into_iter().flatten().collect())
    }

    /// All pairs as a list of independent tasks.
    fn tasks(&self) -> Vec<Task> {
        let mut tasks = Vec::new();
        if !self.0.is_empty() {
            tasks.push(Task::Within(Child::Node(0)));
        }
        loop {
            let before = tasks.len();
            let mut finer = Vec::new();
            let mut divided = false;
            for &task in &tasks {
                if task.is_elementary() {
                    finer.push(task);
                } else {
                    divided = true;
                    self.divide(task, &mut finer);
                }
            }
            tasks = finer;
            // Numbers grow from level to level unless the tree is at its end.
            if !divided || tasks.len() >= TASKS.max(before) {
                return tasks;
            }
        }
    }

    fn pair_up(&self, task: Task, visit: &mut impl FnMut(u32, Range<u32>)) {
        let mut stack = vec![task];
        while let Some(task) = stack.pop() {
            match task {
                Task::Within(Child::Leaf { first, count }) => {
                    for slot in first..first + count {
                        visit(slot, slot + 1..first + count);
                    }
                }
                Task::Between(
                    [
                        (Child::Leaf { first, count }, _),
                        (
                            Child::Leaf {
                                first: second,
                                count: others,
                            },
                            _,
                        ),
                    ],
                ) => {
                    for slot in first..first + count {
                        visit(slot, second..second + others);
                    }
                }
                task => self.divide(task, &mut stack),
            }
        }
    }

    /// Appends the parts of a task that is not elementary.
    fn divide(&self, task: Task, parts: &mut Vec<Task>) {
        match task {
            Task::Within(Child::Node(node)) => {
                let node = &self.0[node as usize];
                for lane in 0..node.len() {
                    parts.push(Task::Within(node.child(lane)));
                    let side = (node.child(lane), node.bounds(lane));
                    pair_with_lanes(side, node, lane + 1, parts);
                }
            }
            Task::Between([(Child::Node(a), _), (Child::Node(b), around)]) => {
                let (a, b) = (&self.0[a as usize], &self.0[b as usize]);
                for lane in lanes(a.touching(&around)) {
                    pair_with_lanes((a.child(lane), a.bounds(lane)), b, 0, parts);
                }
            }
            Task::Between([side, (Child::Node(node), _)] | [(Child::Node(node), _), side]) => {
                pair_with_lanes(side, &self.0[node as usize], 0, parts);
            }
            elementary => parts.push(elementary),
        }
    }
}

impl Task {
    /// Returns `true` if only leaves are left.
    fn is_elementary(&self) -> bool {
        let is_leaf = |child: &Child| matches!(child, Child::Leaf { .. });
        match self {
            Self::Within(child) => is_leaf(child),
            Self::Between(sides) => sides.iter().all(|(child, _)| is_leaf(child)),
        }
    }
}

/// Appends the pairs of `side` and the children of `node` from lane `from` on.
#[inline]
fn pair_with_lanes(side: (Child, LocalBox), node: &Node, from: usize, parts: &mut Vec<Task>) {
    for lane in lanes(node.touching(&side.1) >> from << from) {
        let other = (node.child(lane), node.bounds(lane));
        parts.push(Task::Between([side, other]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bvh;
    use crate::TriMesh;
    use crate::bvh::tests::soup;
    use proptest::prelude::*;

    /// The plain definition.
    fn pairs_naive(mesh: &TriMesh) -> Vec<(u32, u32)> {
        let count = mesh.triangles().len() as u32;
        let bounds = |t| Aabb::around(mesh.corners(t));
        (0..count)
            .flat_map(|a| (a + 1..count).map(move |b| (a, b)))
            .filter(|&(a, b)| bounds(a).touches(&bounds(b)))
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn each_pair_of_touching_boxes_is_found_once(mesh in soup(150)) {
            let (bvh, progress) = (Bvh::new(&mesh), Progress::none());
            let expected = pairs_naive(&mesh);
            for boxes in [&*bvh, &BoxTree::try_new(&mesh, &progress).unwrap()] {
                let mut found = Vec::new();
                boxes.for_each_overlapping_pair(|a, b| found.push((a, b)));
                let mut filtered = boxes
                    .filter_overlapping_pairs(&progress, |a, b| Some((a, b)))
                    .unwrap();
                found.sort_unstable();
                filtered.sort_unstable();
                prop_assert_eq!(&found, &expected);
                prop_assert_eq!(&filtered, &expected);
            }
        }
    }

    #[test]
    fn an_empty_mesh_has_no_pairs_and_a_cancelled_search_stops() {
        let bvh = Bvh::new(&TriMesh::default());
        bvh.for_each_overlapping_pair(|_, _| panic!("there are no triangles"));
        let progress = Progress::none();
        assert_eq!(
            bvh.filter_overlapping_pairs(&progress, |a, b| Some((a, b))),
            Ok(Vec::new())
        );
        progress.cancel();
        assert_eq!(
            bvh.filter_overlapping_pairs(&progress, |a, b| Some((a, b))),
            Err(Cancelled)
        );
    }
}
