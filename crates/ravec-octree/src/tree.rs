//! The tree: nodes in one list, with siblings adjacent.

use crate::key::{CellKey, MAX_LEVEL};

/// Index of a node; 0 is the root.
pub type NodeId = u32;

/// A cell with the data of its owner.
#[derive(Debug, Clone)]
struct Node<T> {
    key: CellKey,
    /// First of eight consecutive children; 0, the root, for a leaf.
    first_child: NodeId,
    data: T,
}

/// An octree whose owner splits it as deep as needed; the levels of neighbors may differ by any number.
#[derive(Debug, Clone)]
pub struct Octree<T> {
    nodes: Vec<Node<T>>,
}

impl<T> Octree<T> {
    /// Creates a tree whose root is a leaf.
    pub fn new(root: T) -> Self {
        Self {
            nodes: vec![Node {
                key: CellKey::ROOT,
                first_child: 0,
                data: root,
            }],
        }
    }

    /// Rebuilds a tree from its nodes in order, each with its first child as returned by [`Self::first_child`]; returns `None`
    /// if the nodes do not form a tree.
    pub fn from_nodes(nodes: Vec<(NodeId, T)>) -> Option<Self> {
        let mut keys = vec![None; nodes.len()];
        *keys.first_mut()? = Some(CellKey::ROOT);
        let mut tree = Self {
            nodes: Vec::with_capacity(nodes.len()),
        };
        for (at, (first_child, data)) in nodes.into_iter().enumerate() {
            let key = keys[at]?;
            if first_child != 0 {
                let first = first_child as usize;
                let children = keys.get_mut(first..first.checked_add(8)?)?;
                if first <= at || key.level == MAX_LEVEL || children.iter().any(Option::is_some) {
                    return None;
                }
                for (octant, child) in children.iter_mut().enumerate() {
                    *child = Some(key.child(octant));
                }
            }
            tree.nodes.push(Node {
                key,
                first_child,
                data,
            });
        }
        Some(tree)
    }

    /// Splits a leaf into eight children; returns the first, which the others follow in the order of their octants.
    ///
    /// # Panics
    /// If the node has children or is of the finest level, or if the tree has 2³² nodes.
    pub fn split(&mut self, leaf: NodeId, mut data: impl FnMut(usize, &T) -> T) -> NodeId {
        assert!(self.is_leaf(leaf), "node {leaf} has children");
        let first = NodeId::try_from(self.nodes.len()).expect("fewer than 2^32 nodes");
        let key = self.key(leaf);
        for octant in 0..8 {
            let data = data(octant, &self.nodes[leaf as usize].data);
            self.nodes.push(Node {
                key: key.child(octant),
                first_child: 0,
                data,
            });
        }
        self.nodes[leaf as usize].first_child = first;
        first
    }

    /// Returns the first of eight consecutive children; 0 for a leaf.
    #[inline]
    pub fn first_child(&self, node: NodeId) -> NodeId {
        self.nodes[node as usize].first_child
    }

    /// Returns whether the node has no children.
    #[inline]
    pub fn is_leaf(&self, node: NodeId) -> bool {
        self.nodes[node as usize].first_child == 0
    }

    /// Returns the cell of a node.
    #[inline]
    pub fn key(&self, node: NodeId) -> CellKey {
        self.nodes[node as usize].key
    }

    /// Returns the data of a node.
    #[inline]
    pub fn data(&self, node: NodeId) -> &T {
        &self.nodes[node as usize].data
    }

    /// Returns the data of a node, mutable.
    #[inline]
    pub fn data_mut(&mut self, node: NodeId) -> &mut T {
        &mut self.nodes[node as usize].data
    }

    /// Returns the child in an octant, or the node itself if it is a leaf.
    #[inline]
    pub fn child_or_self(&self, node: NodeId, octant: usize) -> NodeId {
        match self.nodes[node as usize].first_child {
            0 => node,
            first => first + octant as NodeId,
        }
    }

    /// Returns the path from the root down to a node, inclusive.
    pub fn path_to(&self, node: NodeId) -> impl Iterator<Item = NodeId> + '_ {
        let key = self.key(node);
        std::iter::successors(Some(0), move |&at| {
            let level = self.key(at).level;
            (level < key.level).then(|| {
                let half = MAX_LEVEL - 1 - level;
                let octant = (0..3).map(|axis| (key.at.0[axis] >> half & 1) << axis);
                self.child_or_self(at, octant.sum::<u32>() as usize)
            })
        })
    }

    /// Returns the number of nodes of all levels.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Returns `false`: there is always a root.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Returns all leaves in order of creation.
    pub fn leaves(&self) -> impl Iterator<Item = NodeId> + '_ {
        (0..self.nodes.len() as NodeId).filter(|&node| self.is_leaf(node))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(tree: &Octree<u32>) -> Vec<(NodeId, u32)> {
        let nodes = 0..tree.len() as NodeId;
        nodes
            .map(|node| (tree.first_child(node), *tree.data(node)))
            .collect()
    }

    #[test]
    fn a_tree_can_be_made_again_from_its_nodes() {
        let mut tree = Octree::new(7);
        let first = tree.split(0, |octant, _| octant as u32);
        // not in the order of their parents
        let last = tree.split(first + 6, |octant, &of| 10 * of + octant as u32);
        tree.split(first + 2, |_, &of| of);
        tree.split(last, |_, &of| of);
        let again = Octree::from_nodes(rows(&tree)).unwrap();
        assert_eq!(rows(&again), rows(&tree));
        assert!((0..tree.len() as NodeId).all(|node| again.key(node) == tree.key(node)));
    }

    #[test]
    fn nodes_that_form_no_tree_are_refused() {
        let mut tree = Octree::new(0);
        let first = tree.split(0, |_, _| 0);
        tree.split(first, |_, _| 0);
        let good = rows(&tree);
        assert!(Octree::from_nodes(good.clone()).is_some());
        assert!(Octree::from_nodes(good[..16].to_vec()).is_none());
        assert!(Octree::<u32>::from_nodes(vec![]).is_none());
        for (node, child) in [(1, 1), (1, 0), (2, 9), (2, u32::MAX), (9, 1)] {
            let mut bad = good.clone();
            bad[node].0 = child;
            assert!(Octree::from_nodes(bad).is_none(), "{child} of {node}");
        }
    }
}
