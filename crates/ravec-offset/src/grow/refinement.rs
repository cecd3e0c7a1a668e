//! The refined octree: cells that may hold the surface are split until one vertex represents the surface in them.

use super::{Cell, CornerValue, Node, Setting, State};
use crate::domain::Region;
use crate::surface::{Edge, Edits, RINGS, Reach};
use glam::DVec3;
use ravec_octree::{CellKey, Corner, MinimalEdge, NodeId, Octree, minimal_edges_near};
use ravec_progress::{Cancelled, Progress};
use rustc_hash::{FxHashMap, FxHashSet};

/// The tree, with the values found on the way.
pub(crate) struct Refinement<'a> {
    pub setting: Setting<'a>,
    /// Finest level to which cells are split because of their content.
    pub floor: u8,
    pub tree: Octree<Node>,
    /// Vertices of leaves, including some that were split later.
    pub(super) vertices: Vec<DVec3>,
    pub(super) corners: FxHashMap<u64, CornerValue>,
    /// Corners that count as inside against the field: see [`Self::open_corners`].
    pub(super) filled: FxHashSet<Corner>,
    /// Leaves that touch it are examined.
    pub(super) reach: Reach,
    pub(super) max_nodes: usize,
}

/// Reason for which a tree is incomplete.
pub(crate) enum Halt {
    Cancelled(Cancelled),
    /// The tree exceeds its bound on nodes.
    TooLarge,
}

impl From<Cancelled> for Halt {
    fn from(cancelled: Cancelled) -> Self {
        Self::Cancelled(cancelled)
    }
}

impl<'a> Refinement<'a> {
    /// Grows the tree over a cube until every cell that a tile depends on is good, with the edits applied.
    pub fn grow(
        setting: Setting<'a>,
        tile: CellKey,
        edits: &Edits,
        max_nodes: usize,
        progress: &Progress,
    ) -> Result<Self, Halt> {
        let reach = Reach::of(tile);
        let mut refinement = Self {
            setting,
            floor: setting.floor(),
            tree: Octree::new(Node {
                hint: 0,
                region: Region::Unknown,
                middle: 0.0,
                state: State::New,
            }),
            vertices: Vec::new(),
            corners: FxHashMap::default(),
            filled: edits.filled.clone(),
            reach,
            max_nodes,
        };
        refinement.settle(vec![0], edits, progress)?;
        refinement.reach_far(tile, edits, progress)?;
        Ok(refinement)
    }

    /// Examines everything that a tile depends on.
    fn reach_far(&mut self, tile: CellKey, edits: &Edits, progress: &Progress) -> Result<(), Halt> {
        self.reach = Reach::of(tile);
        if tile != CellKey::ROOT {
            for _ in 0..RINGS {
                self.widen(edits, progress)?;
            }
        }
        Ok(())
    }

    /// Widens the reach by one ring and examines it.
    fn widen(&mut self, edits: &Edits, progress: &Progress) -> Result<(), Halt> {
        self.reach = self.widened(&self.reach, progress);
        progress.check()?;
        let is_beyond = |&leaf: &NodeId| !self.is_known(leaf);
        let beyond: Vec<NodeId> = self.tree.leaves().filter(is_beyond).collect();
        self.settle(beyond, edits, progress)
    }

    /// Returns the reach with the leaves around its edges that cross the surface.
    fn widened(&self, reach: &Reach, progress: &Progress) -> Reach {
        let crossed = minimal_edges_near(
            &self.tree,
            |node| reach.touches(self.tree.key(node)),
            |edge| {
                let is_near = reach.holds_between(edge.start, edge.end());
                let is_wanted = is_near && !progress.is_cancelled() && self.is_crossed(&edge);
                is_wanted.then_some(edge.cells)
            },
        );
        let mut wide = reach.clone();
        for leaf in crossed.into_iter().flatten() {
            wide.include(self.tree.key(leaf));
        }
        wide
    }

    /// Returns whether the surface crosses an edge whose leaves are examined.
    pub fn is_crossed(&self, edge: &MinimalEdge) -> bool {
        let is_inside = |corner| self.is_inside(edge.smallest, corner);
        edge.cells.iter().all(|&cell| self.is_known(cell))
            && is_inside(edge.start) != is_inside(edge.end())
    }

    /// Returns the domain that the tile depends on.
    pub fn reach(&self) -> &Reach {
        &self.reach
    }

    /// Returns whether all surroundings of a leaf are examined.
    pub fn is_core(&self, leaf: NodeId) -> bool {
        self.reach.contains(self.tree.key(leaf))
    }

    /// Applies the `latest` of all edits and continues until every cell that the tile depends on is good again. Returns the
    /// leaves that are new or have a newly filled corner.
    pub fn apply_edits(
        &mut self,
        tile: CellKey,
        edits: &Edits,
        latest: &Edits,
        progress: &Progress,
    ) -> Result<Vec<NodeId>, Halt> {
        let first_new = self.tree.len() as NodeId;
        let filled: Vec<Corner> = edits.filled.difference(&self.filled).copied().collect();
        self.filled.extend(&filled);
        let mut leaves: Vec<NodeId> = latest
            .split
            .iter()
            .filter_map(|&key| self.leaf_of(key))
            .collect();
        leaves.sort_unstable();
        let children = self.split_all(&leaves);
        // edits may name children of what they split
        self.settle(children, edits, progress)?;
        self.reach_far(tile, edits, progress)?;
        let leaves = first_new..self.tree.len() as NodeId;
        let around_filled = filled.iter().flat_map(|&corner| self.leaves_at(corner));
        Ok(leaves.chain(around_filled).collect())
    }

    /// Returns the leaf of a cell, if it is examined.
    fn leaf_of(&self, key: CellKey) -> Option<NodeId> {
        let leaf = self.leaf_at(key.at.0.map(|x| 2 * x + 1));
        let is_known = !matches!(self.tree.data(leaf).state, State::Beyond);
        (is_known && self.tree.key(leaf) == key).then_some(leaf)
    }

    /// Returns the leaf that holds a point, given in half steps of the lattice.
    fn leaf_at(&self, doubled: [u32; 3]) -> NodeId {
        let mut node = 0;
        while !self.tree.is_leaf(node) {
            let key = self.tree.key(node);
            let octant = (0..3)
                .filter(|&axis| doubled[axis] > 2 * key.at.0[axis] + key.side())
                .map(|axis| 1 << axis)
                .sum();
            node = self.tree.child_or_self(node, octant);
        }
        node
    }

    /// Returns the leaves around a corner inside the root.
    pub fn leaves_at(&self, corner: Corner) -> [NodeId; 8] {
        std::array::from_fn(|octant| {
            let beside = |axis: usize| 2 * corner.0[axis] - 1 + 2 * (octant >> axis & 1) as u32;
            self.leaf_at([0, 1, 2].map(beside))
        })
    }

    /// Returns the leaves around an edge.
    pub fn leaves_around(&self, edge: Edge) -> Vec<NodeId> {
        let mut middle = edge.start.0.map(|x| 2 * x);
        let axis = usize::from(edge.axis);
        middle[axis] += edge.length;
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let mut leaves: Vec<NodeId> = (0..4)
            .map(|k| {
                let mut beside = middle;
                beside[u] = beside[u] + 2 * (k & 1) - 1;
                beside[v] = beside[v] + (k & 2) - 1;
                self.leaf_at(beside)
            })
            .collect();
        leaves.sort_unstable();
        leaves.dedup();
        leaves
    }

    /// Returns the corners of a leaf that lie outside. Where sheets are closer than cells can separate, the corners of cells of
    /// the finest level are filled, that is, count as inside: the surface passes through such a cell, so this moves it by less
    /// than the diagonal, a quarter of the tolerance.
    pub fn open_corners(&self, leaf: NodeId) -> impl Iterator<Item = Corner> + '_ {
        let key = self.tree.key(leaf);
        let corners = (0..8).map(move |octant| key.corner(octant));
        corners.filter(move |&corner| !self.is_inside(leaf, corner))
    }

    /// Returns a cell, to fit a vertex in it.
    pub fn cell(&self, key: CellKey) -> Cell<'_> {
        Cell {
            setting: &self.setting,
            key,
        }
    }

    /// Returns the value at a corner of a leaf that may hold the surface.
    pub fn corner(&self, corner: Corner) -> Option<&CornerValue> {
        self.corners.get(&corner.code())
    }

    /// Returns whether a corner of a leaf lies inside the offset solid.
    pub fn is_inside(&self, leaf: NodeId, corner: Corner) -> bool {
        if !self.filled.is_empty() && self.filled.contains(&corner) {
            return true;
        }
        match self.tree.data(leaf).state {
            State::Empty { is_inside } => is_inside,
            State::Full { inside, .. } => {
                let low = self.tree.key(leaf).at;
                let bit = |axis: usize| u32::from(corner.0[axis] != low.0[axis]) << axis;
                inside >> (bit(0) | bit(1) | bit(2)) & 1 == 1
            }
            State::New | State::Beyond => self.corners[&corner.code()].value < 0.0,
        }
    }

    /// Returns whether a leaf is examined.
    pub fn is_known(&self, leaf: NodeId) -> bool {
        !matches!(self.tree.data(leaf).state, State::Beyond)
    }

    pub fn leaf_vertex(&self, leaf: NodeId) -> Option<DVec3> {
        match self.tree.data(leaf).state {
            State::Full { vertex, .. } => vertex.map(|vertex| vertex.place(&self.vertices)),
            State::New | State::Beyond | State::Empty { .. } => None,
        }
    }
}
