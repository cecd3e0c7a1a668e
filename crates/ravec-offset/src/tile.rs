//! Parts of the tree that are grown and cut into triangles on their own, and how what comes of them is put together.
//!
//! A tile is a cell of the tree; the polygons whose edges start in it are its own. Their corners lie in leaves that touch it,
//! and what is known of a leaf depends on the leaves around it; so a tile is grown as far as that [`Reach`]es. All that is
//! worked out there depends on leaves and their surroundings only, and so does the name of each vertex ([`VertexName`]):
//! tiles fit bit by bit, and no geometry is compared where they meet.
//!
//! Guarantees: the same surface, vertex by vertex and triangle by triangle, however space is cut into tiles.

use glam::DVec3;
use ravec_octree::{CellKey, CellSet, Corner, MAX_LEVEL, NodeId};
use ravec_progress::{Cancelled, Progress};
use rustc_hash::{FxHashMap, FxHashSet};
use std::ops::Range;

/// How often a reach is widened by the leaves around its edges on which the surface lies. Polygons of a tile have corners in
/// leaves that are reached at once; triangles that may meet them near a crowded leaf have theirs up to two leaves farther.
pub(crate) const RINGS: usize = 3;

/// So many triangles are put in place in a few milliseconds.
pub(crate) const TRIANGLES_AT_ONCE: u32 = 1 << 15;

/// A tile and leaves around it, with their borders.
#[derive(Debug, Clone)]
pub(crate) struct Reach {
    tile: CellKey,
    leaves: CellSet,
}

impl Reach {
    pub fn of(tile: CellKey) -> Self {
        Self {
            tile,
            leaves: CellSet::default(),
        }
    }

    /// The leaves that are not in the tile.
    pub fn leaves(&self) -> Vec<CellKey> {
        self.leaves.members()
    }

    /// Whether a cell shares a point with it.
    pub fn touches(&self, cell: CellKey) -> bool {
        self.holds_between(cell.corner(0), cell.corner(7))
    }

    /// Whether a point is in it.
    pub fn holds(&self, point: Corner) -> bool {
        self.holds_between(point, point)
    }

    /// Whether all of a cell is in the tile, or in one of the leaves.
    pub fn contains(&self, cell: CellKey) -> bool {
        self.is_in_tile(cell) || self.leaves.contains(cell)
    }

    fn is_in_tile(&self, cell: CellKey) -> bool {
        self.tile.level <= cell.level && self.tile.owns(cell.at)
    }

    /// Whether a part of the box between two points is in it.
    pub fn holds_between(&self, low: Corner, high: Corner) -> bool {
        let (first, last) = (self.tile.corner(0), self.tile.corner(7));
        let is_at_tile =
            (0..3).all(|axis| low.0[axis] <= last.0[axis] && high.0[axis] >= first.0[axis]);
        is_at_tile || self.leaves.touches([low, high])
    }

    pub fn include(&mut self, leaf: CellKey) {
        if !self.is_in_tile(leaf) {
            self.leaves.insert(leaf);
        }
    }
}

/// What is to be changed to mend the surface.
#[derive(Debug, Clone, Default)]
pub(crate) struct Orders {
    /// Leaves that are to be split, whatever they hold.
    pub split: FxHashSet<CellKey>,
    /// Corners that are to count as inside.
    pub filled: FxHashSet<Corner>,
}

impl Orders {
    pub fn is_empty(&self) -> bool {
        self.split.is_empty() && self.filled.is_empty()
    }

    /// Adds all of `other`.
    pub fn extend(&mut self, other: &Self) {
        self.split.extend(&other.split);
        self.filled.extend(&other.filled);
    }

    /// Whether any of them changes something within a reach.
    pub fn concern(&self, reach: &Reach) -> bool {
        self.split.iter().any(|&cell| reach.touches(cell))
            || self.filled.iter().any(|&corner| reach.holds(corner))
    }
}

/// What a vertex is called, in whatever tile it is met.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum VertexName {
    /// The vertex of a sheet in a leaf.
    Sheet { leaf: Corner, number: u32 },
    /// The vertex on one side of the polygon around an edge.
    InFace { start: Corner, axis: u8, side: u8 },
    /// The vertex on an edge.
    OnEdge { start: Corner, axis: u8 },
}

/// The edge of a polygon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Edge {
    pub start: Corner,
    pub length: u32,
    pub axis: u8,
}

impl Edge {
    /// What edges are sorted by.
    fn place(&self) -> (u64, u8) {
        (self.start.morton(), self.axis)
    }
}

/// The surface in a tile.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Patch {
    pub positions: Vec<DVec3>,
    pub names: Vec<VertexName>,
    pub triangles: Vec<[u32; 3]>,
    /// The number in `edges` of each triangle.
    pub edge_of: Vec<u32>,
    /// In the order of the curve through their starts (Morton), and of their axes.
    pub edges: Vec<Edge>,
    /// Of each triangle whether ample room below it was proved; empty if that is not known of any.
    pub ample: Vec<bool>,
    /// The leaves around each edge, as long as the tree is kept that they are leaves of.
    pub leaves: Vec<[NodeId; 4]>,
}

impl Patch {
    /// The same with other polygons in the place of those of which the leaves say that they are gone. Vertices of both parts are
    /// there twice where they meet, under the same name.
    pub fn replaced(
        &self,
        is_gone: impl Fn(&[NodeId; 4]) -> bool,
        fresh: &Self,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let mut kept = self.polygons().peekable();
        let mut new = fresh.polygons().peekable();
        let mut whole = Self::default();
        let mut numbers = [self, fresh].map(|patch| vec![u32::MAX; patch.positions.len()]);
        loop {
            if whole.edges.len().is_multiple_of(TRIANGLES_AT_ONCE as usize) {
                progress.check()?;
            }
            while kept
                .next_if(|(edge, _)| is_gone(&self.leaves[*edge]))
                .is_some()
            {}
            let place = |patch: &Self, next: Option<&(usize, Range<usize>)>| {
                next.map(|&(edge, _)| patch.edges[edge].place())
            };
            let is_kept = match (place(self, kept.peek()), place(fresh, new.peek())) {
                (Some(a), Some(b)) => a < b,
                (first, _) => first.is_some(),
            };
            let (from, next, numbers) = if is_kept {
                (self, kept.next(), &mut numbers[0])
            } else {
                (fresh, new.next(), &mut numbers[1])
            };
            let Some((edge, triangles)) = next else {
                return Ok(whole);
            };
            whole.edges.push(from.edges[edge]);
            whole.leaves.push(from.leaves[edge]);
            whole.ample.extend(&from.ample[triangles.clone()]);
            for triangle in &from.triangles[triangles] {
                whole.edge_of.push(whole.edges.len() as u32 - 1);
                whole.triangles.push(triangle.map(|v| {
                    let number = &mut numbers[v as usize];
                    if *number == u32::MAX {
                        *number = whole.positions.len() as u32;
                        whole.positions.push(from.positions[v as usize]);
                        whole.names.push(from.names[v as usize]);
                    }
                    *number
                }));
            }
        }
    }

    /// The same with one vertex for each name.
    pub fn united(self) -> Self {
        let mut number_of: FxHashMap<VertexName, u32> = FxHashMap::default();
        let mut numbers = vec![u32::MAX; self.positions.len()];
        let (mut positions, mut names) = (Vec::new(), Vec::new());
        let mut unite = |v: u32| {
            let number = &mut numbers[v as usize];
            if *number == u32::MAX {
                let next = positions.len() as u32;
                let name = self.names[v as usize];
                *number = *number_of.entry(name).or_insert(next);
                if *number == next {
                    positions.push(self.positions[v as usize]);
                    names.push(name);
                }
            }
            *number
        };
        let triangles = self.triangles.iter();
        let triangles = triangles.map(|corners| corners.map(&mut unite)).collect();
        Self {
            positions,
            names,
            triangles,
            ..self
        }
    }

    /// The cells that a cell has to be cut into for each to own the starts of few edges only, in the order of the curve, with the
    /// numbers of these.
    pub fn cells(&self, whole: CellKey, most_edges: usize) -> Vec<(CellKey, Range<usize>)> {
        let mut cells = Vec::new();
        let mut to_cut = vec![(whole, 0..self.edges.len())];
        while let Some((cell, edges)) = to_cut.pop() {
            if edges.len() <= most_edges || cell.level == MAX_LEVEL {
                cells.push((cell, edges));
                continue;
            }
            let mut end = edges.end;
            for child in (0..8).rev().map(|octant| cell.child(octant)) {
                let first = child.at.morton();
                let of_cell = &self.edges[edges.start..end];
                let start =
                    edges.start + of_cell.partition_point(|edge| edge.start.morton() < first);
                to_cut.push((child, start..end));
                end = start;
            }
        }
        cells
    }

    /// The polygons around some of the edges, without leaves.
    pub fn part(&self, edges: Range<usize>) -> Self {
        let first = |edge: usize| self.edge_of.partition_point(|&e| (e as usize) < edge);
        let triangles = first(edges.start)..first(edges.end);
        let mut part = Self {
            edges: self.edges[edges.clone()].to_vec(),
            ample: self
                .ample
                .get(triangles.clone())
                .unwrap_or_default()
                .to_vec(),
            ..Self::default()
        };
        let mut numbers = FxHashMap::default();
        for t in triangles {
            part.edge_of.push(self.edge_of[t] - edges.start as u32);
            part.triangles.push(self.triangles[t].map(|v| {
                *numbers.entry(v).or_insert_with(|| {
                    part.positions.push(self.positions[v as usize]);
                    part.names.push(self.names[v as usize]);
                    part.positions.len() as u32 - 1
                })
            }));
        }
        part
    }

    /// The edges by their numbers, with their triangles.
    fn polygons(&self) -> impl Iterator<Item = (usize, Range<usize>)> {
        let mut end = 0;
        self.edge_of.chunk_by(|a, b| a == b).map(move |of_edge| {
            let start = end;
            end += of_edge.len();
            (of_edge[0] as usize, start..end)
        })
    }
}

/// Of each vertex whether an edge with only one of the triangles ends in it. Of a part of a closed surface these are the vertices
/// that other parts have, too.
pub(crate) fn border<'a>(
    vertices: usize,
    triangles: impl Iterator<Item = &'a [u32; 3]>,
) -> Vec<bool> {
    let mut open: FxHashSet<[u32; 2]> = FxHashSet::default();
    for &[a, b, c] in triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            if !open.remove(&[to, from]) {
                open.insert([from, to]);
            }
        }
    }
    let mut border = vec![false; vertices];
    for v in open.into_iter().flatten() {
        border[v as usize] = true;
    }
    border
}
