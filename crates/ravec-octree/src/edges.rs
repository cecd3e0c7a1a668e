//! The minimal edges of a tree: edges of leaves that contain no shorter one.
//!
//! Source: Ju, Losasso, Schaefer and Warren, *Dual Contouring of Hermite Data*, SIGGRAPH 2002: three mutual recursions over
//! cells, faces between two cells and edges between four.
//!
//! Guarantees: every minimal edge inside the root once, in an order that depends on the tree only. Does not guarantee: edges on
//! the border of the root. Cost: linear in the nodes.

use crate::key::Corner;
use crate::tree::{NodeId, Octree};
use rayon::prelude::*;

/// An edge and the leaves around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MinimalEdge {
    /// Direction: 0 for x, 1 for y, 2 for z.
    pub axis: usize,
    /// End with the lower coordinate.
    pub start: Corner,
    /// Length on the lattice.
    pub length: u32,
    /// The leaves around the edge, counterclockwise seen against the axis. A leaf on whose face the edge lies occurs twice in a
    /// row.
    pub cells: [NodeId; 4],
    /// The smallest of these leaves: the one that has the edge.
    pub smallest: NodeId,
}

impl MinimalEdge {
    /// Returns the end with the higher coordinate.
    #[inline]
    pub fn end(&self) -> Corner {
        self.start.moved(self.axis, self.length)
    }
}

/// Visits the minimal edges of a tree.
pub fn for_each_minimal_edge<T>(tree: &Octree<T>, mut visit: impl FnMut(MinimalEdge)) {
    Walk {
        tree,
        is_near: |_| true,
        visit: &mut visit,
    }
    .cell(0);
}

/// Returns the selected minimal edges of a tree in the order of [`for_each_minimal_edge`], using all threads.
pub fn minimal_edges<T: Sync, R: Send>(
    tree: &Octree<T>,
    select: impl Fn(MinimalEdge) -> Option<R> + Sync,
) -> Vec<R> {
    minimal_edges_near(tree, |_| true, select)
}

/// Returns the selected minimal edges beside some leaves, as [`minimal_edges`] does: `is_near` holds for these leaves and for
/// all cells that contain one ([`Octree::path_to`]). Cost: linear in these nodes and their neighbors.
pub fn minimal_edges_near<T: Sync, R: Send>(
    tree: &Octree<T>,
    is_near: impl Fn(NodeId) -> bool + Sync,
    select: impl Fn(MinimalEdge) -> Option<R> + Sync,
) -> Vec<R> {
    let mut tasks = Vec::new();
    tasks_of(tree, 0, PARALLEL_LEVELS, &is_near, &mut tasks);
    let found: Vec<Vec<R>> = tasks
        .into_par_iter()
        .map(|task| {
            let mut found = Vec::new();
            let mut visit = |edge| found.extend(select(edge));
            let mut walk = Walk {
                tree,
                is_near: &is_near,
                visit: &mut visit,
            };
            match task {
                WalkTask::Cell(node) => walk.cell(node),
                WalkTask::Between(node) => walk.between(node),
            }
            found
        })
        .collect();
    found.into_iter().flatten().collect()
}

/// Levels of the tree above the cells that one thread walks.
const PARALLEL_LEVELS: u32 = 4;

/// A task of the walk: a cell with its content, or only the space between its children.
enum WalkTask {
    Cell(NodeId),
    Between(NodeId),
}

fn tasks_of<T>(
    tree: &Octree<T>,
    node: NodeId,
    levels: u32,
    is_near: &impl Fn(NodeId) -> bool,
    tasks: &mut Vec<WalkTask>,
) {
    if !is_near(node) {
        return;
    }
    if levels == 0 || tree.is_leaf(node) {
        tasks.push(WalkTask::Cell(node));
        return;
    }
    for octant in 0..8 {
        tasks_of(
            tree,
            tree.child_or_self(node, octant),
            levels - 1,
            is_near,
            tasks,
        );
    }
    tasks.push(WalkTask::Between(node));
}

struct Walk<'a, T, N, V> {
    tree: &'a Octree<T>,
    /// Cells that are neither near nor adjacent to such are not entered.
    is_near: N,
    visit: &'a mut V,
}

/// Returns the two axes after `axis`, in right-handed order.
#[inline]
fn others(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

impl<T, N: Fn(NodeId) -> bool, V: FnMut(MinimalEdge)> Walk<'_, T, N, V> {
    /// Visits the edges inside a cell.
    fn cell(&mut self, node: NodeId) {
        if self.tree.is_leaf(node) || !(self.is_near)(node) {
            return;
        }
        for octant in 0..8 {
            self.cell(self.tree.child_or_self(node, octant));
        }
        self.between(node);
    }

    /// Visits the edges between the children of a cell.
    fn between(&mut self, node: NodeId) {
        let child = |octant| self.tree.child_or_self(node, octant);
        let children: [NodeId; 8] = std::array::from_fn(child);
        for axis in 0..3 {
            let [u, v] = others(axis);
            for part in 0..4 {
                let low = (part & 1) << u | (part >> 1) << v;
                self.face(axis, [children[low], children[low | 1 << axis]]);
            }
            for half in 0..2 {
                let around = |k: usize| children[half << axis | (k & 1) << u | (k >> 1) << v];
                self.edge(axis, std::array::from_fn(around));
            }
        }
    }

    /// Visits the edges inside the face between two cells, of which the first is lower along `axis`.
    fn face(&mut self, axis: usize, cells: [NodeId; 2]) {
        let is_whole = cells.iter().all(|&cell| self.tree.is_leaf(cell));
        if is_whole || !cells.iter().any(|&cell| (self.is_near)(cell)) {
            return;
        }
        // the part of a cell that touches the face: its upper half for the lower cell
        let part = |side: usize, octant: usize| {
            self.tree
                .child_or_self(cells[side], octant | (1 - side) << axis)
        };
        let [u, v] = others(axis);
        let quarters: [[NodeId; 2]; 4] = std::array::from_fn(|k| {
            let octant = (k & 1) << u | (k >> 1) << v;
            [part(0, octant), part(1, octant)]
        });
        // edges along u and along v, in the middle of the face
        let mut edges = [(0, [0; 4]); 4];
        for (i, (along, across)) in [(u, v), (v, u)].into_iter().enumerate() {
            for half in 0..2 {
                let [first, _] = others(along);
                let around: [NodeId; 4] = std::array::from_fn(|k| {
                    let [low, high] = [k & 1, k >> 1];
                    let (side, other) = if first == axis {
                        (low, high)
                    } else {
                        (high, low)
                    };
                    part(side, half << along | other << across)
                });
                edges[2 * i + half] = (along, around);
            }
        }
        for quarter in quarters {
            self.face(axis, quarter);
        }
        for (along, around) in edges {
            self.edge(along, around);
        }
    }

    /// Visits the edges on the line between four cells. Bit 0 of the place of a cell is its side along the next axis, bit 1
    /// along the one after that.
    fn edge(&mut self, axis: usize, cells: [NodeId; 4]) {
        if !cells.iter().any(|&cell| (self.is_near)(cell)) {
            return;
        }
        let [u, v] = others(axis);
        if cells.iter().all(|&cell| self.tree.is_leaf(cell)) {
            let mut place = 0;
            for k in 1..4 {
                if self.tree.key(cells[k]).level > self.tree.key(cells[place]).level {
                    place = k;
                }
            }
            let key = self.tree.key(cells[place]);
            let toward = |k: usize| (1 - (k & 1)) << u | (1 - (k >> 1)) << v;
            let [a, b, c, d] = cells;
            (self.visit)(MinimalEdge {
                axis,
                start: key.corner(toward(place)),
                length: key.side(),
                cells: [a, b, d, c],
                smallest: cells[place],
            });
            return;
        }
        for half in 0..2 {
            let part = |k: usize| {
                let octant = half << axis | (1 - (k & 1)) << u | (1 - (k >> 1)) << v;
                self.tree.child_or_self(cells[k], octant)
            };
            self.edge(axis, std::array::from_fn(part));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::key::{CellKey, MAX_LEVEL};
    use std::collections::BTreeSet;

    /// A tree split at random places.
    fn random_tree(seed: u64, splits: usize) -> Octree<()> {
        let mut tree = Octree::new(());
        let mut state = seed;
        let mut leaves = vec![0];
        for _ in 0..splits {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let at = (state >> 33) as usize % leaves.len();
            if tree.key(leaves[at]).level >= 5 {
                continue;
            }
            let first = tree.split(leaves.swap_remove(at), |_, ()| ());
            leaves.extend(first..first + 8);
        }
        tree
    }

    /// The leaf that holds a point given in half steps of the lattice, so that it lies on no face.
    fn leaf_at(tree: &Octree<()>, doubled: [i64; 3]) -> NodeId {
        let mut node = 0;
        while !tree.is_leaf(node) {
            let key = tree.key(node);
            let middle = key.side() / 2;
            let octant = (0..3)
                .filter(|&axis| doubled[axis] > 2 * i64::from(key.at.0[axis] + middle))
                .map(|axis| 1 << axis)
                .sum();
            node = tree.child_or_self(node, octant);
        }
        node
    }

    /// All minimal edges from their definition: edges of leaves, inside the root, that hold no shorter edge.
    fn naive(tree: &Octree<()>) -> BTreeSet<(usize, Corner, u32)> {
        let mut edges = BTreeSet::new();
        for leaf in tree.leaves() {
            let key = tree.key(leaf);
            for axis in 0..3 {
                for octant in (0..8).filter(|octant| octant >> axis & 1 == 0) {
                    edges.insert((axis, key.corner(octant), key.side()));
                }
            }
        }
        let inside = |(axis, start, _): &(usize, Corner, u32)| {
            others(*axis)
                .iter()
                .all(|&other| (1..1 << MAX_LEVEL).contains(&start.0[other]))
        };
        let all: Vec<_> = edges.iter().copied().filter(inside).collect();
        all.iter()
            .copied()
            .filter(|&(axis, start, length)| {
                !all.iter().any(|&(axis2, start2, length2)| {
                    let on_line = others(axis).iter().all(|&o| start.0[o] == start2.0[o]);
                    axis == axis2
                        && on_line
                        && length2 < length
                        && start2.0[axis] >= start.0[axis]
                        && start2.0[axis] + length2 <= start.0[axis] + length
                })
            })
            .collect()
    }

    #[test]
    fn each_minimal_edge_is_visited_once_with_the_leaves_around_it() {
        for seed in 0..12 {
            let tree = random_tree(seed, 14);
            let mut found = BTreeSet::new();
            for_each_minimal_edge(&tree, |edge| {
                assert!(found.insert((edge.axis, edge.start, edge.length)));
                let [u, v] = others(edge.axis);
                for (cell, [du, dv]) in
                    edge.cells
                        .into_iter()
                        .zip([[-1, -1], [1, -1], [1, 1], [-1, 1]])
                {
                    let mut beside = edge.start.0.map(|x| 2 * i64::from(x));
                    beside[edge.axis] += i64::from(edge.length);
                    beside[u] += du;
                    beside[v] += dv;
                    assert_eq!(cell, leaf_at(&tree, beside));
                }
                assert_eq!(tree.key(edge.smallest).side(), edge.length);
            });
            assert_eq!(found, naive(&tree));
            let mut in_order = Vec::new();
            for_each_minimal_edge(&tree, |edge| in_order.push(edge));
            assert_eq!(minimal_edges(&tree, Some), in_order);
        }
    }

    #[test]
    fn edges_near_some_leaves_are_those_beside_them() {
        for seed in 0..12 {
            let tree = random_tree(seed, 14);
            let wanted: BTreeSet<NodeId> = tree
                .leaves()
                .filter(|leaf| (leaf + seed as NodeId).is_multiple_of(9))
                .collect();
            let near: BTreeSet<NodeId> =
                wanted.iter().flat_map(|&leaf| tree.path_to(leaf)).collect();
            let found = minimal_edges_near(&tree, |node| near.contains(&node), Some);
            let beside = |edge: &MinimalEdge| edge.cells.iter().any(|cell| wanted.contains(cell));
            let mut expected = minimal_edges(&tree, Some);
            expected.retain(beside);
            assert_eq!(found, expected);
            assert!(!found.is_empty());
        }
    }

    #[test]
    fn a_tree_without_children_has_no_inner_edge() {
        let tree = Octree::new(());
        for_each_minimal_edge(&tree, |edge| panic!("{edge:?}"));
        assert_eq!(tree.key(0), CellKey::ROOT);
    }
}
