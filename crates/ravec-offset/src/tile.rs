//! Parts of the tree that are grown and cut into triangles on their own, and how what comes of them is put together.
//!
//! A tile is a cell of the tree; the polygons whose edges start in it are its own. Their corners lie in leaves that touch it,
//! and what is known of a leaf depends on the leaves around it; so a tile is grown as far as that [`Reach`]es. All that is
//! worked out there depends on leaves and their surroundings only, and so does the name of each vertex ([`VertexName`]):
//! tiles fit bit by bit, and no geometry is compared where they meet.
//!
//! Guarantees: the same surface, vertex by vertex and triangle by triangle, however space is cut into tiles.

use crate::proof::Proof;
use glam::DVec3;
use ravec_octree::{CellKey, CellSet, Corner, MAX_LEVEL, NodeId};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
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
    /// The proof of each triangle that has one, as long as triangles may have to be proved again.
    pub proofs: Vec<Option<Proof>>,
}

impl Patch {
    /// Puts other polygons in the place of those of which the leaves say that they are gone, without a copy of those that stay.
    /// Vertices of both parts are there twice where they meet, under the same name.
    ///
    /// After a cancellation nothing of it can be used.
    pub fn replace(
        &mut self,
        is_gone: impl Fn(&[NodeId; 4]) -> bool + Sync,
        fresh: Self,
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        let is_kept: Vec<bool> = (self.leaves.par_iter())
            .map(|leaves| !is_gone(leaves))
            .collect();
        progress.check()?;
        self.retain(&is_kept, progress)?;
        self.drop_unused_vertices();
        progress.check()?;
        self.insert(fresh, progress)
    }

    /// Drops polygons.
    fn retain(&mut self, is_kept: &[bool], progress: &Progress) -> Result<(), Cancelled> {
        let Some(first_gone) = is_kept.iter().position(|is_kept| !is_kept) else {
            return Ok(());
        };
        let mut start = (self.edge_of).partition_point(|&edge| (edge as usize) < first_gone);
        let (mut edges, mut triangles) = (first_gone, start);
        for (edge, &is_kept) in is_kept.iter().enumerate().skip(first_gone) {
            if edge.is_multiple_of(TRIANGLES_AT_ONCE as usize) {
                progress.check()?;
            }
            let of_edge = &self.edge_of[start..];
            let count = of_edge.iter().take_while(|&&e| e as usize == edge).count();
            let end = start + count;
            if is_kept {
                self.edges[edges] = self.edges[edge];
                self.leaves[edges] = self.leaves[edge];
                self.triangles.copy_within(start..end, triangles);
                self.proofs.copy_within(start..end, triangles);
                self.edge_of[triangles..triangles + count].fill(edges as u32);
                edges += 1;
                triangles += count;
            }
            start = end;
        }
        self.edges.truncate(edges);
        self.leaves.truncate(edges);
        self.triangles.truncate(triangles);
        self.proofs.truncate(triangles);
        self.edge_of.truncate(triangles);
        Ok(())
    }

    fn drop_unused_vertices(&mut self) {
        let mut numbers = vec![u32::MAX; self.positions.len()];
        for &v in self.triangles.iter().flatten() {
            numbers[v as usize] = 0;
        }
        let mut next = 0;
        for (v, number) in numbers.iter_mut().enumerate() {
            if *number == 0 {
                *number = next as u32;
                self.positions[next] = self.positions[v];
                self.names[next] = self.names[v];
                next += 1;
            }
        }
        self.positions.truncate(next);
        self.names.truncate(next);
        for corners in &mut self.triangles {
            *corners = corners.map(|v| numbers[v as usize]);
        }
    }

    /// Adds polygons around other edges, each at its place.
    fn insert(&mut self, fresh: Self, progress: &Progress) -> Result<(), Cancelled> {
        let first_new = self.positions.len() as u32;
        self.positions.extend(fresh.positions);
        self.names.extend(fresh.names);
        let mut kept = [self.edges.len(), self.triangles.len()];
        let mut new = [fresh.edges.len(), fresh.triangles.len()];
        // those after what is in place; the place of what moves is free, since it moves from the last on
        let mut at = [0, 1].map(|i| kept[i] + new[i]);
        self.edges.extend(&fresh.edges);
        self.leaves.extend(&fresh.leaves);
        self.triangles.extend(&fresh.triangles);
        self.proofs.extend(&fresh.proofs);
        self.edge_of.extend(&fresh.edge_of);
        while let Some(last_new) = new[0].checked_sub(1) {
            if at[0].is_multiple_of(TRIANGLES_AT_ONCE as usize) {
                progress.check()?;
            }
            at[0] -= 1;
            let is_later = |last: &usize| self.edges[*last].place() > fresh.edges[last_new].place();
            if let Some(last) = kept[0].checked_sub(1).filter(is_later) {
                self.edges[at[0]] = self.edges[last];
                self.leaves[at[0]] = self.leaves[last];
                while kept[1] > 0 && self.edge_of[kept[1] - 1] as usize == last {
                    let [from, to] = [kept[1] - 1, at[1] - 1];
                    self.triangles[to] = self.triangles[from];
                    self.proofs[to] = self.proofs[from];
                    self.edge_of[to] = at[0] as u32;
                    (kept[1], at[1]) = (from, to);
                }
                kept[0] = last;
            } else {
                self.edges[at[0]] = fresh.edges[last_new];
                self.leaves[at[0]] = fresh.leaves[last_new];
                while new[1] > 0 && fresh.edge_of[new[1] - 1] as usize == last_new {
                    let [from, to] = [new[1] - 1, at[1] - 1];
                    self.triangles[to] = fresh.triangles[from].map(|v| first_new + v);
                    self.proofs[to] = fresh.proofs[from];
                    self.edge_of[to] = at[0] as u32;
                    (new[1], at[1]) = (from, to);
                }
                new[0] = last_new;
            }
        }
        Ok(())
    }

    /// What was proved of a facet of the polygon around an edge.
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

    /// The same with one vertex for each name, without what is only known while triangles are mended.
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

    /// The polygons around some of the edges of what is finished.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::certify::Room;
    use crate::proof::Given;
    use proptest::prelude::*;

    /// The corners of a facet, and what was proved of it.
    type Facet = ([(DVec3, VertexName); 3], Option<Proof>);

    /// A polygon, by what it is whatever numbers its vertices have.
    #[derive(Debug, Clone, PartialEq)]
    struct Plain {
        edge: Edge,
        leaves: [NodeId; 4],
        facets: Vec<Facet>,
    }

    fn plain(patch: &Patch) -> Vec<Plain> {
        let of_edge = patch.edge_of.chunk_by(|a, b| a == b);
        let counts: Vec<usize> = of_edge.map(<[u32]>::len).collect();
        assert_eq!(counts.len(), patch.edges.len());
        let mut t = 0;
        counts
            .into_iter()
            .enumerate()
            .map(|(edge, count)| {
                assert!(
                    patch.edge_of[t..t + count]
                        .iter()
                        .all(|&e| e as usize == edge)
                );
                t += count;
                let vertex = |v: u32| (patch.positions[v as usize], patch.names[v as usize]);
                let facets =
                    (t - count..t).map(|t| (patch.triangles[t].map(vertex), patch.proofs[t]));
                Plain {
                    edge: patch.edges[edge],
                    leaves: patch.leaves[edge],
                    facets: facets.collect(),
                }
            })
            .collect()
    }

    /// Polygons around edges at places on a line, each given with its leaf and its number of triangles.
    fn patch(polygons: &[(u32, NodeId, usize)], height: f64) -> Patch {
        let mut patch = Patch::default();
        for &(place, leaf, count) in polygons {
            let start = Corner([place, 0, 0]);
            let axis = (place % 3) as u8;
            let edge = patch.edges.len() as u32;
            patch.edges.push(Edge {
                start,
                length: 1,
                axis,
            });
            patch.leaves.push([leaf, leaf + 1, leaf, leaf]);
            for k in 0..count {
                // some vertices are those of the polygon before
                let first = (patch.positions.len() as u32).saturating_sub(k as u32 % 3);
                for v in patch.positions.len() as u32..first + 3 {
                    let at = DVec3::new(f64::from(place), f64::from(v), height);
                    patch.positions.push(at);
                    patch.names.push(VertexName::OnEdge { start, axis });
                }
                patch.triangles.push([first, first + 1, first + 2]);
                patch.edge_of.push(edge);
                let given = Given {
                    hints: [leaf, k as u32, 0, 0],
                    is_last: false,
                };
                let proof = (k != 1).then(|| Proof::new(Room::Enough, &given));
                patch.proofs.push(proof);
            }
        }
        patch
    }

    fn polygons() -> impl Strategy<Value = Vec<(u32, NodeId, usize)>> {
        let polygon = (0..60u32, (0..8u32, 1..5usize));
        prop::collection::btree_map(polygon.0, polygon.1, 0..30).prop_map(|all| {
            let all = all.into_iter();
            all.map(|(place, (leaf, count))| (place, leaf, count))
                .collect()
        })
    }

    proptest! {
        #[test]
        fn polygons_are_replaced_as_in_sorted_lists(before in polygons(), fresh in polygons(), gone in 0..9u32) {
            let is_gone = |leaves: &[NodeId; 4]| leaves[0] >= gone;
            let left = before.iter().filter(|polygon| polygon.1 < gone);
            let places: Vec<u32> = left.map(|polygon| polygon.0).collect();
            let mut fresh = fresh;
            fresh.retain(|polygon| !places.contains(&polygon.0));
            let (mut replaced, new) = (patch(&before, 0.0), patch(&fresh, 1.0));
            let mut expected = plain(&replaced);
            expected.retain(|polygon| !is_gone(&polygon.leaves));
            expected.extend(plain(&new));
            expected.sort_by_key(|polygon| polygon.edge.place());
            replaced.replace(is_gone, new, &Progress::none()).unwrap();
            let found = plain(&replaced);
            prop_assert_eq!(&found, &expected);
            // no vertex is left that no triangle has
            let mut used: Vec<u32> = replaced.triangles.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            prop_assert_eq!(used.len(), replaced.positions.len());
            prop_assert_eq!(replaced.names.len(), replaced.positions.len());
            for polygon in found {
                for (facet, proof) in &polygon.facets {
                    let known = replaced.proof_of(&polygon.edge, facet.map(|(at, _)| at));
                    prop_assert_eq!(known, *proof);
                }
                prop_assert_eq!(replaced.proof_of(&polygon.edge, [DVec3::NAN; 3]), None);
            }
        }
    }
}
