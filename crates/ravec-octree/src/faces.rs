//! The minimal faces of a tree: faces of leaves that contain no smaller one.
//!
//! Source: as for edges, the recursions of Ju, Losasso, Schaefer and Warren, *Dual Contouring of Hermite Data*, SIGGRAPH 2002.

use crate::tree::{NodeId, Octree};

/// Visits each pair of leaves that share a face, or a part of one, once; the leaf that is lower along the axis across the face
/// comes first. Cost: linear in the nodes.
pub fn for_each_minimal_face<T>(tree: &Octree<T>, mut visit: impl FnMut([NodeId; 2])) {
    cell(tree, 0, &mut visit);
}

fn cell<T>(tree: &Octree<T>, node: NodeId, visit: &mut impl FnMut([NodeId; 2])) {
    if tree.is_leaf(node) {
        return;
    }
    for octant in 0..8 {
        cell(tree, tree.child_or_self(node, octant), visit);
        for axis in (0..3).filter(|axis| octant >> axis & 1 == 0) {
            let pair = [octant, octant | 1 << axis].map(|octant| tree.child_or_self(node, octant));
            face(tree, axis, pair, visit);
        }
    }
}

fn face<T>(tree: &Octree<T>, axis: usize, cells: [NodeId; 2], visit: &mut impl FnMut([NodeId; 2])) {
    if cells.iter().all(|&cell| tree.is_leaf(cell)) {
        visit(cells);
        return;
    }
    for low in (0..8).filter(|octant| octant >> axis & 1 == 0) {
        // the upper half of the lower cell touches the lower half of the other
        let [a, b] = cells;
        let quarter = [
            tree.child_or_self(a, low | 1 << axis),
            tree.child_or_self(b, low),
        ];
        face(tree, axis, quarter, visit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::key::CellKey;
    use std::collections::BTreeSet;

    /// The axis across the face that two cells share, if they share one, and which of them is lower.
    fn shared(a: CellKey, b: CellKey) -> Option<[CellKey; 2]> {
        let overlap = |axis: usize| {
            let ends = [a, b].map(|cell| cell.at.0[axis] + cell.side());
            i64::from(ends[0].min(ends[1])) - i64::from(a.at.0[axis].max(b.at.0[axis]))
        };
        let overlaps = [0, 1, 2].map(overlap);
        let across = (0..3).find(|&axis| overlaps[axis] == 0)?;
        let is_shared = (0..3).all(|axis| axis == across || overlaps[axis] > 0);
        let is_lower = a.at.0[across] < b.at.0[across];
        is_shared.then_some(if is_lower { [a, b] } else { [b, a] })
    }

    #[test]
    fn each_pair_of_leaves_with_a_common_face_is_visited_once() {
        let mut tree = Octree::new(());
        let mut state = 7_usize;
        for _ in 0..30 {
            let leaves: Vec<NodeId> = tree.leaves().collect();
            state = state.wrapping_mul(2_862_933_555_777_941_757) + 3;
            tree.split(leaves[(state >> 33) % leaves.len()], |_, ()| ());
        }
        let mut found = BTreeSet::new();
        for_each_minimal_face(&tree, |pair| {
            assert!(found.insert(pair.map(|leaf| tree.key(leaf))), "twice");
        });
        let leaves: Vec<CellKey> = tree.leaves().map(|leaf| tree.key(leaf)).collect();
        let pairs = (1..leaves.len()).flat_map(|i| leaves[..i].iter().map(move |a| (i, a)));
        let naive: BTreeSet<_> = pairs.filter_map(|(i, &a)| shared(a, leaves[i])).collect();
        assert_eq!(found, naive);
    }
}
