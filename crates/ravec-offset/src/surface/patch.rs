//! Patches: the surface in a tile or a block.

use super::Proof;
use glam::DVec3;
use ravec_octree::{CellKey, Corner, MAX_LEVEL, NodeId};
use rustc_hash::FxHashMap;
use std::ops::Range;

/// Batch size between cancellation checks: a few milliseconds of work.
pub(crate) const TRIANGLES_AT_ONCE: u32 = 1 << 15;

/// Name of a vertex, the same in all tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum VertexName {
    /// The vertex of a sheet in a leaf.
    Sheet { leaf: Corner, number: u32 },
    /// The vertex on one side of the polygon around an edge.
    InFace { start: Corner, axis: u8, side: u8 },
    /// The vertex on an edge.
    OnEdge { start: Corner, axis: u8 },
}

/// The edge of the tree to which a polygon is dual.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Edge {
    pub start: Corner,
    pub length: u32,
    pub axis: u8,
}

impl Edge {
    /// Sort key of edges.
    pub(super) fn place(&self) -> (u64, u8) {
        (self.start.morton(), self.axis)
    }
}

/// Polygons and triangles of the surface in a tile or a block.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Patch {
    pub positions: Vec<DVec3>,
    pub names: Vec<VertexName>,
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle, the index of its edge in `edges`.
    pub edge_of: Vec<u32>,
    /// Sorted by the Morton order of their starts, then by axis.
    pub edges: Vec<Edge>,
    /// For each triangle, whether ample room below it is proved; empty if unknown for all.
    pub ample: Vec<bool>,
    /// The leaves around each edge, while the tree of these leaves is kept.
    pub leaves: Vec<[NodeId; 4]>,
    /// The proof of each triangle, while triangles may have to be proved again.
    pub proofs: Vec<Option<Proof>>,
}

impl Patch {
    /// Returns the proof of a facet of the polygon around an edge.
    pub fn proof_of(&self, edge: &Edge, facet: [DVec3; 3]) -> Option<Proof> {
        let known = |known: &Edge| known.place().cmp(&edge.place());
        let edge = self.edges.binary_search_by(known).ok()?;
        let first = self.edge_of.partition_point(|&e| (e as usize) < edge);
        let of_edge = self.edge_of[first..].iter().zip(first..);
        let mut triangles = of_edge.take_while(|(e, _)| **e as usize == edge);
        let corners = |t: usize| self.triangles[t].map(|v| self.positions[v as usize]);
        let (_, t) = triangles.find(|&(_, t)| corners(t) == facet)?;
        self.proofs[t]
    }

    /// Merges vertices of equal names and drops the data of repair.
    pub fn finished(self) -> Self {
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
        let mut triangles = self.triangles;
        for corners in &mut triangles {
            *corners = corners.map(&mut unite);
        }
        let is_ample = |proof: &Option<Proof>| proof.is_some_and(Proof::is_ample);
        Self {
            positions,
            names,
            triangles,
            edge_of: self.edge_of,
            edges: self.edges,
            ample: self.proofs.iter().map(is_ample).collect(),
            leaves: vec![],
            proofs: vec![],
        }
    }

    /// Divides a cell until each part owns the starts of at most `max_edges` edges; returns the parts in Morton order with the
    /// ranges of their edges.
    pub fn divided(&self, whole: CellKey, max_edges: usize) -> Vec<(CellKey, Range<usize>)> {
        let mut cells = Vec::new();
        let mut to_cut = vec![(whole, 0..self.edges.len())];
        while let Some((cell, edges)) = to_cut.pop() {
            if edges.len() <= max_edges || cell.level == MAX_LEVEL {
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

    /// Returns the polygons around a range of edges of a finished patch.
    pub fn subset(&self, edges: Range<usize>) -> Self {
        let first = |edge: usize| self.edge_of.partition_point(|&e| (e as usize) < edge);
        let triangles = first(edges.start)..first(edges.end);
        let mut subset = Self {
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
            subset.edge_of.push(self.edge_of[t] - edges.start as u32);
            subset.triangles.push(self.triangles[t].map(|v| {
                *numbers.entry(v).or_insert_with(|| {
                    subset.positions.push(self.positions[v as usize]);
                    subset.names.push(self.names[v as usize]);
                    subset.positions.len() as u32 - 1
                })
            }));
        }
        subset
    }
}
