//! The tree: nodes in one list, children side by side.

use crate::key::{CellKey, MAX_LEVEL};

/// The index of a node; 0 is the root.
pub type NodeId = u32;

/// A cell with what its owner knows of it.
#[derive(Debug, Clone)]
struct Node<T> {
    key: CellKey,
    /// The first of eight children in a row; 0, which is the root and nobody's child, for a leaf.
    first_child: NodeId,
    data: T,
}

/// An octree that is as deep as its owner splits it; neighbours may differ by any number of levels.
#[derive(Debug, Clone)]
pub struct Octree<T> {
    nodes: Vec<Node<T>>,
}

impl<T> Octree<T> {
    /// A tree whose root is a leaf.
    pub fn new(root: T) -> Self {
        Self {
            nodes: vec![Node {
                key: CellKey::ROOT,
                first_child: 0,
                data: root,
            }],
        }
    }

    /// Gives a leaf eight children; returns the first, the others follow it in the order of their octants.
    ///
    /// # Panics
    /// If the node has children, or is of the finest level, or the tree has 2³² nodes.
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

    /// Whether the node has no children.
    #[inline]
    pub fn is_leaf(&self, node: NodeId) -> bool {
        self.nodes[node as usize].first_child == 0
    }

    /// The cell of a node.
    #[inline]
    pub fn key(&self, node: NodeId) -> CellKey {
        self.nodes[node as usize].key
    }

    /// What is known of a node.
    #[inline]
    pub fn data(&self, node: NodeId) -> &T {
        &self.nodes[node as usize].data
    }

    /// What is known of a node, to be changed.
    #[inline]
    pub fn data_mut(&mut self, node: NodeId) -> &mut T {
        &mut self.nodes[node as usize].data
    }

    /// The child in an octant, or the node itself if it is a leaf.
    #[inline]
    pub fn child_or_self(&self, node: NodeId, octant: usize) -> NodeId {
        match self.nodes[node as usize].first_child {
            0 => node,
            first => first + octant as NodeId,
        }
    }

    /// The cells that hold a node: from the root down to the node itself.
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

    /// Nodes of all levels.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Never: there is a root.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// All leaves, in the order in which they were made.
    pub fn leaves(&self) -> impl Iterator<Item = NodeId> + '_ {
        (0..self.nodes.len() as NodeId).filter(|&node| self.is_leaf(node))
    }
}
