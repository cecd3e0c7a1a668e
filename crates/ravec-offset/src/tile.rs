//! Parts of the tree that are grown and cut into triangles on their own, and how what comes of them is put together.
//!
//! A tile is a cell of the tree; the polygons whose edges start in it are its own. Their corners lie in leaves that touch it,
//! and what is known of a leaf depends on the leaves around it; so a tile is grown as far as that [`Reach`]es. All that is
//! worked out there depends on leaves and their surroundings only, and so does the name of each vertex ([`VertexName`]):
//! tiles fit bit by bit, and no geometry is compared where they meet.
//!
//! Guarantees: the same surface, vertex by vertex and triangle by triangle, however space is cut into tiles.

use glam::DVec3;
use ravec_octree::{CellKey, Corner, NodeId};
use ravec_progress::{Cancelled, Progress};
use rustc_hash::{FxHashMap, FxHashSet};
use std::ops::Range;

/// How often a reach is widened by the leaves around its edges on which the surface lies. Polygons of a tile have corners in
/// leaves that are reached at once; triangles that may meet them near a crowded leaf have theirs up to two leaves farther.
pub(crate) const RINGS: usize = 3;

/// So many triangles are put in place in a few milliseconds.
pub(crate) const TRIANGLES_AT_ONCE: u32 = 1 << 15;

/// A box of the lattice, with its border.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Reach {
    low: Corner,
    high: Corner,
}

impl Reach {
    pub fn of(cell: CellKey) -> Self {
        Self {
            low: cell.corner(0),
            high: cell.corner(7),
        }
    }

    /// Whether a cell shares a point with it.
    pub fn touches(&self, cell: CellKey) -> bool {
        self.holds_between(cell.corner(0), cell.corner(7))
    }

    /// Whether a point is in it.
    pub fn holds(&self, point: Corner) -> bool {
        self.holds_between(point, point)
    }

    /// Whether all of a cell is in it.
    pub fn contains(&self, cell: CellKey) -> bool {
        let (low, high) = (cell.corner(0), cell.corner(7));
        (0..3).all(|axis| self.low.0[axis] <= low.0[axis] && high.0[axis] <= self.high.0[axis])
    }

    /// Whether a part of the box between two points is in it.
    pub fn holds_between(&self, low: Corner, high: Corner) -> bool {
        (0..3).all(|axis| low.0[axis] <= self.high.0[axis] && high.0[axis] >= self.low.0[axis])
    }

    pub fn include(&mut self, cell: CellKey) {
        let (low, high) = (cell.corner(0), cell.corner(7));
        for axis in 0..3 {
            self.low.0[axis] = self.low.0[axis].min(low.0[axis]);
            self.high.0[axis] = self.high.0[axis].max(high.0[axis]);
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
#[derive(Debug, Default)]
pub(crate) struct Patch {
    pub positions: Vec<DVec3>,
    pub names: Vec<VertexName>,
    pub triangles: Vec<[u32; 3]>,
    /// The number in `edges` of each triangle.
    pub edge_of: Vec<u32>,
    /// In the order of the curve through their starts (Morton), and of their axes.
    pub edges: Vec<Edge>,
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

/// The surface of all tiles.
#[derive(Debug, Default)]
pub(crate) struct Assembled {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// The tile of each triangle and its number there.
    pub origin: Vec<[u32; 2]>,
}

/// Puts patches together, in their order: that of the curve through their cells.
pub(crate) fn assemble<'a>(
    patches: impl Iterator<Item = &'a Patch>,
    progress: &Progress,
) -> Result<Assembled, Cancelled> {
    let mut whole = Assembled::default();
    let mut number_of: FxHashMap<VertexName, u32> = FxHashMap::default();
    for (tile, patch) in (0u32..).zip(patches) {
        let mut numbers = vec![u32::MAX; patch.positions.len()];
        for (t, triangle) in (0u32..).zip(&patch.triangles) {
            if t.is_multiple_of(TRIANGLES_AT_ONCE) {
                progress.check()?;
            }
            let triangle = triangle.map(|v| {
                let number = &mut numbers[v as usize];
                if *number == u32::MAX {
                    let next = whole.positions.len() as u32;
                    *number = *number_of.entry(patch.names[v as usize]).or_insert(next);
                    if *number == next {
                        whole.positions.push(patch.positions[v as usize]);
                    }
                }
                *number
            });
            whole.triangles.push(triangle);
            whole.origin.push([tile, t]);
        }
    }
    Ok(whole)
}

impl Assembled {
    /// Only some of the triangles.
    pub fn retain(
        self,
        keep: impl Fn(usize) -> bool,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let mut numbers = vec![u32::MAX; self.positions.len()];
        let mut kept = Self::default();
        for (t, (triangle, origin)) in self.triangles.into_iter().zip(self.origin).enumerate() {
            if t.is_multiple_of(TRIANGLES_AT_ONCE as usize) {
                progress.check()?;
            }
            if !keep(t) {
                continue;
            }
            kept.triangles.push(triangle.map(|v| {
                let number = &mut numbers[v as usize];
                if *number == u32::MAX {
                    *number = kept.positions.len() as u32;
                    kept.positions.push(self.positions[v as usize]);
                }
                *number
            }));
            kept.origin.push(origin);
        }
        Ok(kept)
    }
}
