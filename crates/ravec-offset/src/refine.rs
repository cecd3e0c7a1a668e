//! The tree: cells that may hold the surface are split until a vertex can stand for what they hold.

mod kept;
mod look;

use crate::cell::{
    Cell, CornerValue, EdgeKey, Ends, Fit, ON_SURFACE, Roots, Sample, crossed_edges, inside_of,
    root,
};
use crate::enclosed::{Enclosed, Enclosure};
use crate::field::{Field, Place, Region};
use crate::grid::{Grid, LEVELS_BELOW_FLOOR, floor_level};
use crate::refine::look::Look;
use crate::tile::{Edge, Orders, RINGS, Reach};
use glam::DVec3;
use ravec_octree::{
    CellKey, Corner, Frame, MAX_LEVEL, MinimalEdge, NodeId, Octree, minimal_edges_near,
};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::{FxBuildHasher, FxHashMap, FxHashSet};
use std::num::NonZeroU32;

/// So many entries go into a table in a few milliseconds.
const AT_ONCE: usize = 1 << 14;

/// What is known of a cell.
#[derive(Debug, Clone, Copy)]
pub(crate) enum State {
    /// Nothing yet.
    New,
    /// It lies beyond what is looked at.
    Beyond,
    /// All of it lies on one side of the surface.
    Empty { is_inside: bool },
    /// It may hold the surface; with its vertex, if its corners have both signs, and a bit for each corner that lies inside.
    Full {
        vertex: Option<VertexNumber>,
        inside: u8,
    },
}

/// Where the vertex of a leaf stands in a list, counted from 1: with places in them, nodes would be half as large again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VertexNumber(NonZeroU32);

/// A node of the tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    /// A triangle close to it; of a leaf with a vertex, the one closest to that.
    pub hint: u32,
    pub region: Region,
    /// The signed distance of the triangles from its middle; before it was looked at, from that of its parent.
    pub middle: f64,
    pub state: State,
}

/// What a tree is grown for, and where.
#[derive(Clone, Copy)]
pub(crate) struct Setting<'a> {
    pub field: &'a Field<'a>,
    /// What need not be looked at.
    pub enclosed: &'a Enclosed,
    pub frame: Frame,
    pub grid: Grid,
    pub tolerance: f64,
}

impl Setting<'_> {
    /// Cells of this level are not split because of what they hold.
    pub fn floor(&self) -> u8 {
        let floor = floor_level(self.frame.side, self.tolerance);
        floor.min(MAX_LEVEL - 2).min(self.grid.deepest)
    }

    /// The finest level: cells of it are so small that the surface may go anywhere in them.
    pub fn limit(&self) -> u8 {
        (self.floor() + LEVELS_BELOW_FLOOR).min(self.grid.deepest)
    }
}

/// The tree, and all that was found on the way.
pub(crate) struct Refinement<'a> {
    pub setting: Setting<'a>,
    /// Cells of this level are not split because of what they hold.
    pub floor: u8,
    pub tree: Octree<Node>,
    /// The vertices of leaves, also of some that were split.
    vertices: Vec<DVec3>,
    corners: FxHashMap<u64, CornerValue>,
    /// Corners that count as inside though the field says otherwise: see [`Self::open_corners`].
    filled: FxHashSet<Corner>,
    /// Leaves that touch it are looked at.
    reach: Reach,
    most_nodes: usize,
}

/// Why a tree was not grown to its end.
pub(crate) enum Halt {
    Cancelled(Cancelled),
    /// It would have more nodes than allowed.
    TooLarge,
}

impl From<Cancelled> for Halt {
    fn from(cancelled: Cancelled) -> Self {
        Self::Cancelled(cancelled)
    }
}

impl<'a> Refinement<'a> {
    /// Grows the tree over a cube until every cell that a tile depends on is good, with cells split and corners filled as
    /// ordered.
    pub fn grow(
        setting: Setting<'a>,
        tile: CellKey,
        orders: &Orders,
        most_nodes: usize,
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
            filled: orders.filled.clone(),
            reach,
            most_nodes,
        };
        refinement.settle(vec![0], orders, progress)?;
        refinement.reach_far(tile, orders, progress)?;
        Ok(refinement)
    }

    /// Looks at all that a tile depends on.
    fn reach_far(
        &mut self,
        tile: CellKey,
        orders: &Orders,
        progress: &Progress,
    ) -> Result<(), Halt> {
        self.reach = Reach::of(tile);
        if tile != CellKey::ROOT {
            for _ in 0..RINGS {
                self.widen(orders, progress)?;
            }
        }
        Ok(())
    }

    /// Reaches one step farther, and looks at all that is there.
    fn widen(&mut self, orders: &Orders, progress: &Progress) -> Result<(), Halt> {
        self.reach = self.widened(&self.reach, progress);
        progress.check()?;
        let is_beyond = |&leaf: &NodeId| !self.is_known(leaf);
        let beyond: Vec<NodeId> = self.tree.leaves().filter(is_beyond).collect();
        self.settle(beyond, orders, progress)
    }

    /// A reach with the leaves around edges in it that go through the surface.
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

    /// Whether the surface goes through an edge, as far as what is around it was looked at.
    pub fn is_crossed(&self, edge: &MinimalEdge) -> bool {
        let is_inside = |corner| self.is_inside(edge.smallest, corner);
        edge.cells.iter().all(|&cell| self.is_known(cell))
            && is_inside(edge.start) != is_inside(edge.end())
    }

    /// What the tile depends on.
    pub fn reach(&self) -> &Reach {
        &self.reach
    }

    /// Whether all around a leaf was looked at.
    pub fn is_core(&self, leaf: NodeId) -> bool {
        self.reach.contains(self.tree.key(leaf))
    }

    /// Does the `latest` of all orders, and goes on until every cell that the tile depends on is good again. Returns the leaves that
    /// are new or have a corner that was filled.
    pub fn mend(
        &mut self,
        tile: CellKey,
        orders: &Orders,
        latest: &Orders,
        progress: &Progress,
    ) -> Result<Vec<NodeId>, Halt> {
        let first_new = self.tree.len() as NodeId;
        let filled: Vec<Corner> = orders.filled.difference(&self.filled).copied().collect();
        self.filled.extend(&filled);
        let mut leaves: Vec<NodeId> = latest
            .split
            .iter()
            .filter_map(|&key| self.leaf_of(key))
            .collect();
        leaves.sort_unstable();
        let children = self.split_all(&leaves);
        // orders may name children of what they split
        self.settle(children, orders, progress)?;
        self.reach_far(tile, orders, progress)?;
        let leaves = first_new..self.tree.len() as NodeId;
        let around_filled = filled.iter().flat_map(|&corner| self.leaves_at(corner));
        Ok(leaves.chain(around_filled).collect())
    }

    /// The leaf that is a cell, if it was looked at.
    fn leaf_of(&self, key: CellKey) -> Option<NodeId> {
        let leaf = self.leaf_at(key.at.0.map(|x| 2 * x + 1));
        let is_known = !matches!(self.tree.data(leaf).state, State::Beyond);
        (is_known && self.tree.key(leaf) == key).then_some(leaf)
    }

    /// The leaf that holds a point, given in half steps of the lattice.
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

    /// The leaves around a corner inside the root.
    pub fn leaves_at(&self, corner: Corner) -> [NodeId; 8] {
        std::array::from_fn(|octant| {
            let beside = |axis: usize| 2 * corner.0[axis] - 1 + 2 * (octant >> axis & 1) as u32;
            self.leaf_at([0, 1, 2].map(beside))
        })
    }

    /// The leaves around an edge.
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

    /// The corners of a leaf that lie outside. Where sheets come closer than cells can tell apart, those of cells of the finest level
    /// are to count as inside: the surface goes through such a cell, so that moves it by less than its diagonal, a quarter of the
    /// tolerance.
    pub fn open_corners(&self, leaf: NodeId) -> impl Iterator<Item = Corner> + '_ {
        let key = self.tree.key(leaf);
        let corners = (0..8).map(move |octant| key.corner(octant));
        corners.filter(move |&corner| !self.is_inside(leaf, corner))
    }

    fn split_all(&mut self, leaves: &[NodeId]) -> Vec<NodeId> {
        let mut children = Vec::with_capacity(8 * leaves.len());
        for &leaf in leaves {
            let first = self.tree.split(leaf, |_, &parent| Node {
                state: State::New,
                ..parent
            });
            children.extend(first..first + 8);
        }
        children
    }

    /// Looks at new leaves, level by level.
    fn settle(
        &mut self,
        mut front: Vec<NodeId>,
        orders: &Orders,
        progress: &Progress,
    ) -> Result<(), Halt> {
        while !front.is_empty() {
            progress.check()?;
            if self.tree.len() > self.most_nodes {
                return Err(Halt::TooLarge);
            }
            front.retain(|&node| {
                let key = self.tree.key(node);
                let known = if !self.reach.touches(key) {
                    Some(State::Beyond)
                } else if self.setting.enclosed.of(key) == Some(Enclosure::Whole) {
                    // as if it were filled, since what lies in it is not asked for
                    Some(State::Empty { is_inside: true })
                } else {
                    None
                };
                if let Some(state) = known {
                    self.tree.data_mut(node).state = state;
                }
                known.is_none()
            });
            let phase = progress.phase("refine", front.len() as u64);
            let looks: Vec<Look> = front
                .par_iter()
                .map(|&node| {
                    progress.check()?;
                    phase.advance(1);
                    Ok(self.look(node))
                })
                .collect::<Result<_, Cancelled>>()?;
            let mut coarse = Vec::new();
            let mut full: Vec<(NodeId, Look)> = Vec::new();
            for (&node, look) in front.iter().zip(looks) {
                progress.check()?;
                let data = self.tree.data_mut(node);
                data.hint = look.near.triangle;
                data.region = look.region;
                data.middle = look.middle.signed_distance();
                let is_ordered = orders.split.contains(&self.tree.key(node));
                if let Some(is_inside) = look.empty {
                    self.tree.data_mut(node).state = State::Empty { is_inside };
                    if is_ordered {
                        coarse.push(node);
                    }
                } else if self.must_split(node, &look) {
                    coarse.push(node);
                } else {
                    full.push((node, look));
                }
            }
            self.evaluate_corners(&full, progress)?;
            let corners: Vec<[CornerValue; 8]> = full
                .par_iter()
                .map(|&(node, _)| {
                    progress.check()?;
                    Ok(self.corners_of(self.tree.key(node)))
                })
                .collect::<Result<_, Cancelled>>()?;
            let inside: Vec<u8> = corners.par_iter().map(inside_of).collect();
            let roots = self.roots(&full, &inside, progress)?;
            let fits: Vec<Fit> = full
                .par_iter()
                .zip(&corners)
                .map(|((node, look), corners)| {
                    progress.check()?;
                    let cell = self.cell(self.tree.key(*node));
                    let regions = [look.region, look.middle.region];
                    Ok(cell.fit(look.near, regions, corners, &roots))
                })
                .collect::<Result<_, Cancelled>>()?;
            drop(corners);
            for (((node, _), inside), fit) in full.into_iter().zip(inside).zip(fits) {
                let key = self.tree.key(node);
                let is_done = fit.is_good || key.level >= self.floor;
                if is_done && !orders.split.contains(&key) {
                    let vertex = fit
                        .vertex
                        .map(|place| VertexNumber::add(&mut self.vertices, place));
                    let data = self.tree.data_mut(node);
                    data.state = State::Full { vertex, inside };
                    data.hint = fit.nearest;
                } else {
                    coarse.push(node);
                }
            }
            drop(roots);
            progress.check()?;
            front = self.split_all(&coarse);
        }
        Ok(())
    }

    fn evaluate_corners(
        &mut self,
        cells: &[(NodeId, Look)],
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        // by their places on the curve, so that those nearby follow one another; of each corner first the cells that know the side
        let mut missing: Vec<(u64, u32)> = cells
            .par_iter()
            .enumerate()
            .flat_map_iter(|(at, (node, look))| {
                let (key, unknown) = (self.tree.key(*node), look.region == Region::Unknown);
                (0..8)
                    .map(move |octant| key.corner(octant))
                    .filter(|corner| {
                        !progress.is_cancelled() && !self.corners.contains_key(&corner.code())
                    })
                    .map(move |corner| (corner.morton() << 1 | u64::from(unknown), at as u32))
            })
            .collect();
        progress.check()?;
        missing.par_sort_unstable();
        progress.check()?;
        missing.dedup_by_key(|&mut (place, _)| place >> 1);
        let values: Vec<(u64, CornerValue)> = missing
            .into_par_iter()
            .map(|(place, at)| {
                progress.check()?;
                let corner = Corner::at_morton(place >> 1);
                Ok((corner.code(), self.evaluate(corner, &cells[at as usize].1)))
            })
            .collect::<Result<_, Cancelled>>()?;
        self.corners.reserve(values.len());
        for some in values.chunks(AT_ONCE) {
            progress.check()?;
            self.corners.extend(some.iter().copied());
        }
        progress.check()
    }

    /// Where the surface goes through the edges of some cells, given with the corners of each that lie inside. Up to four cells share
    /// an edge, so each is looked at once.
    fn roots(
        &self,
        cells: &[(NodeId, Look)],
        inside: &[u8],
        progress: &Progress,
    ) -> Result<Roots, Cancelled> {
        let mut edges: Vec<EdgeKey> = cells
            .par_iter()
            .zip(inside)
            .flat_map_iter(|((node, _), &inside)| crossed_edges(self.tree.key(*node), inside))
            .collect();
        progress.check()?;
        edges.par_sort_unstable();
        progress.check()?;
        edges.dedup();
        progress.check()?;
        let found: Vec<(EdgeKey, Sample)> = edges
            .into_par_iter()
            .map(|edge| {
                progress.check()?;
                let ends = edge.ends();
                let points = ends.map(|end| self.setting.frame.point(end));
                let values = ends.map(|end| self.corners[&end.code()]);
                let enough = ON_SURFACE * self.setting.tolerance;
                let place =
                    |i: usize| Place::new(points[i], values[i].value + self.setting.field.level);
                let known = [place(0), place(1)];
                // not by the cells around it: which of these are known differs from tile to tile
                let region = self.setting.field.region_between(&known);
                let ends = Ends {
                    points,
                    values,
                    known: &known,
                };
                Ok((edge, root(self.setting.field, region, ends, enough)))
            })
            .collect::<Result<_, Cancelled>>()?;
        let mut roots = Roots::with_capacity_and_hasher(found.len(), FxBuildHasher);
        for some in found.chunks(AT_ONCE) {
            progress.check()?;
            roots.extend(some.iter().copied());
        }
        Ok(roots)
    }

    /// The field at a corner of a cell that was looked at.
    fn evaluate(&self, corner: Corner, look: &Look) -> CornerValue {
        let p = self.setting.frame.point(corner);
        let near = self.setting.field.near(p, look.near.triangle);
        let region = match look.region {
            Region::Unknown => (self.setting.field).region_beside(p, near.distance, &[look.middle]),
            known => known,
        };
        CornerValue {
            triangle: near.triangle,
            value: self.setting.field.value(near.distance, region),
        }
    }

    fn corners_of(&self, key: CellKey) -> [CornerValue; 8] {
        std::array::from_fn(|octant| self.corners[&key.corner(octant).code()])
    }

    /// A cell, to fit a vertex in it.
    pub fn cell(&self, key: CellKey) -> Cell<'_> {
        Cell {
            setting: &self.setting,
            key,
        }
    }

    /// What is known of a corner of a leaf that may hold the surface.
    pub fn corner(&self, corner: Corner) -> Option<&CornerValue> {
        self.corners.get(&corner.code())
    }

    /// Whether a corner of a leaf lies inside the offset solid.
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

    /// Whether a leaf was looked at.
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

impl VertexNumber {
    fn add(vertices: &mut Vec<DVec3>, place: DVec3) -> Self {
        vertices.push(place);
        let count = u32::try_from(vertices.len()).ok();
        Self(
            count
                .and_then(NonZeroU32::new)
                .expect("fewer than 2^32 vertices"),
        )
    }

    fn place(self, vertices: &[DVec3]) -> DVec3 {
        vertices[self.0.get() as usize - 1]
    }
}
