//! The surface in blocks, processed in chunks that fit in memory.
//!
//! Whole-surface queries are answered chunk by chunk; where the answer depends on neighbors, a chunk comes with the triangles
//! of other chunks near it. Vertices of different blocks are the same if their names are equal.

use super::outermost::{reachable, reachable_in_blocks};
use super::{Block, PatchHandle, Store};
use crate::params::OffsetError;
use crate::surface::{Patch, TRIANGLES_AT_ONCE, VertexName};
use crate::surface::{border, doubled, intersecting_pairs};
use glam::DVec3;
use ravec_mesh::{Aabb, Adjacency, TriMesh};
use ravec_progress::Progress;
use rustc_hash::{FxHashMap, FxHashSet};
use std::borrow::Cow;
use std::ops::Range;

/// Visible part of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Visibility {
    All,
    /// The components that can be reached from far away.
    Reachable,
}

/// Blocks, of which some triangles are visible.
#[derive(Debug)]
pub(crate) struct ChunkedSurface {
    store: Store,
    blocks: Vec<Block>,
    /// The blocks of each chunk.
    ranges: Vec<Range<usize>>,
    /// For each block that is partly visible, whether each triangle is visible.
    seen: FxHashMap<usize, Vec<bool>>,
}

/// Consecutive blocks as one mesh.
#[derive(Debug, Default)]
pub(crate) struct Chunk {
    pub mesh: TriMesh,
    /// Names of the vertices; empty if the chunk is the whole surface.
    pub names: Vec<VertexName>,
    /// Number of triangles of the chunk itself; those after them belong to other chunks.
    pub own: usize,
    /// The block of each triangle, and its number there.
    pub origin: Vec<[u32; 2]>,
    /// For each triangle, whether ample room below it is proved.
    pub ample: Vec<bool>,
}

/// A chunk under construction.
#[derive(Default)]
struct Assembly {
    positions: Vec<DVec3>,
    names: Vec<VertexName>,
    number_of: FxHashMap<VertexName, u32>,
    triangles: Vec<[u32; 3]>,
    origin: Vec<[u32; 2]>,
    ample: Vec<bool>,
}

impl ChunkedSurface {
    /// Divides blocks into chunks of at most `max_triangles` triangles, or of one block.
    pub fn new(
        store: Store,
        blocks: Vec<Block>,
        max_triangles: usize,
        visibility: Visibility,
        progress: &Progress,
    ) -> Result<Self, OffsetError> {
        let mut ranges: Vec<Range<usize>> = vec![];
        let mut triangles = 0;
        for (at, block) in blocks.iter().enumerate() {
            triangles += block.triangles;
            match ranges.last_mut() {
                Some(range) if triangles <= max_triangles => range.end = at + 1,
                _ => {
                    triangles = block.triangles;
                    ranges.push(at..at + 1);
                }
            }
        }
        let mut chunks = Self {
            store,
            blocks,
            ranges,
            seen: FxHashMap::default(),
        };
        if visibility == Visibility::Reachable {
            chunks.seen = chunks.reachable(progress)?;
        }
        Ok(chunks)
    }

    fn reachable(&self, progress: &Progress) -> Result<FxHashMap<usize, Vec<bool>>, OffsetError> {
        if let [block] = &self.blocks[..] {
            let patch = self.store.get(&block.patch)?;
            let seen = reachable(&patch.positions, &patch.triangles, progress)?;
            let some = seen.contains(&false).then_some((0, seen));
            return Ok(some.into_iter().collect());
        }
        let patch = |at| self.patch(at);
        reachable_in_blocks(self.blocks.len(), patch, progress)
    }

    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    pub fn into_blocks(self) -> (Store, Vec<Block>) {
        (self.store, self.blocks)
    }

    /// Returns the numbers of the blocks of a chunk.
    pub fn blocks_of(&self, chunk: usize) -> Range<usize> {
        self.ranges[chunk].clone()
    }

    /// Returns the number of chunks.
    pub fn count(&self) -> usize {
        self.ranges.len()
    }

    /// Returns the number of visible triangles.
    pub fn triangles(&self) -> usize {
        let of_block = |(at, block): (usize, &Block)| match self.seen.get(&at) {
            Some(seen) => seen.iter().filter(|&&seen| seen).count(),
            None => block.triangles,
        };
        self.blocks.iter().enumerate().map(of_block).sum()
    }

    /// Loads the patch of a block.
    pub fn patch(&self, block: usize) -> Result<Cow<'_, Patch>, OffsetError> {
        self.store.get(&self.blocks[block].patch)
    }

    /// Loads the patch of a block, with the numbers of its visible triangles.
    pub fn visible(
        &self,
        block: usize,
    ) -> Result<(Cow<'_, Patch>, impl Iterator<Item = u32> + use<'_>), OffsetError> {
        let patch = self.patch(block)?;
        let seen = self.seen.get(&block);
        let numbers = 0..patch.triangles.len() as u32;
        let numbers = numbers.filter(move |&t| seen.is_none_or(|seen| seen[t as usize]));
        Ok((patch, numbers))
    }

    /// Loads a chunk without its neighbors.
    pub fn chunk(&self, chunk: usize, progress: &Progress) -> Result<Chunk, OffsetError> {
        Ok(self.own(chunk, progress)?.finished())
    }

    /// Loads a chunk with the triangles of others near it: all that intersect its triangles, and all around their corners.
    pub fn chunk_with_neighbors(
        &self,
        chunk: usize,
        progress: &Progress,
    ) -> Result<Chunk, OffsetError> {
        let mut assembly = self.own(chunk, progress)?;
        let own = assembly.triangles.len();
        let range = &self.ranges[chunk];
        // block by block: bounds of the whole chunk may contain most of the surface
        let blocks = self.blocks[range.clone()].iter();
        let bounds: Vec<Aabb> = blocks.map(|block| block.bounds).collect();
        for (at, block) in self.blocks.iter().enumerate() {
            progress.check()?;
            if range.contains(&at) || block.triangles == 0 {
                continue;
            }
            let beside = |bounds: &&Aabb| block.bounds.touches(bounds);
            let beside: Vec<&Aabb> = bounds.iter().filter(beside).collect();
            if beside.is_empty() {
                continue;
            }
            let (patch, numbers) = self.visible(at)?;
            let is_near = |&t: &u32| {
                let corners = patch.triangles[t as usize].map(|v| patch.positions[v as usize]);
                let around = Aabb::around(corners);
                beside.iter().any(|bounds| bounds.touches(&around))
            };
            assembly.add(at, &patch, numbers.filter(is_near), progress)?;
        }
        Ok(Chunk {
            own,
            ..assembly.finished()
        })
    }

    fn own(&self, chunk: usize, progress: &Progress) -> Result<Assembly, OffsetError> {
        self.assembled(self.ranges[chunk].clone(), progress)
    }

    fn assembled(
        &self,
        blocks: Range<usize>,
        progress: &Progress,
    ) -> Result<Assembly, OffsetError> {
        let mut assembly = Assembly::default();
        for at in blocks {
            let (patch, numbers) = self.visible(at)?;
            if self.blocks.len() == 1 {
                assembly.add_alone(&patch, numbers);
            } else {
                assembly.add(at, &patch, numbers, progress)?;
            }
        }
        Ok(assembly)
    }

    /// Loads the whole surface.
    pub fn into_mesh(mut self, progress: &Progress) -> Result<TriMesh, OffsetError> {
        let is_all = self.seen.is_empty();
        if let ([Block { patch, .. }], true) = (&mut self.blocks[..], is_all)
            && let PatchHandle::Resident(patch) = patch
        {
            let Patch {
                positions,
                triangles,
                ..
            } = std::mem::take(patch);
            return Ok(mesh(positions, triangles));
        }
        Ok(self
            .assembled(0..self.blocks.len(), progress)?
            .finished()
            .mesh)
    }

    /// Returns pairs of triangles that intersect, each by its block and its number there.
    pub fn intersecting_pairs(
        &self,
        progress: &Progress,
    ) -> Result<Vec<[[u32; 2]; 2]>, OffsetError> {
        let mut found = Vec::new();
        for at in 0..self.count() {
            let chunk = self.chunk_with_neighbors(at, progress)?;
            let pairs =
                intersecting_pairs(chunk.mesh.positions(), chunk.mesh.triangles(), progress)?;
            let is_own = |pair: &[u32; 2]| pair.iter().any(|&t| (t as usize) < chunk.own);
            found.extend(pairs.into_iter().filter(is_own).map(|pair| {
                let [a, b] = pair.map(|t| chunk.origin[t as usize]);
                [a.min(b), a.max(b)]
            }));
        }
        found.sort_unstable();
        // pairs of two chunks are found twice
        found.dedup();
        Ok(found)
    }

    /// Returns the triangles that intersect others, or have corners at the position of another vertex, each by its block and
    /// its number there, sorted.
    pub fn defects(&self, progress: &Progress) -> Result<Vec<[u32; 2]>, OffsetError> {
        let mut bad = self.intersecting_pairs(progress)?.concat();
        bad.extend(self.doubled(progress)?);
        bad.sort_unstable();
        bad.dedup();
        Ok(bad)
    }

    /// Returns the triangles with a corner at the position of another vertex.
    fn doubled(&self, progress: &Progress) -> Result<Vec<[u32; 2]>, OffsetError> {
        let mut found = Vec::new();
        for at in 0..self.count() {
            let chunk = self.chunk_with_neighbors(at, progress)?;
            let doubled = doubled(chunk.mesh.positions());
            let is_doubled = |t: &[u32; 3]| t.iter().any(|v| doubled.contains(v));
            let own = chunk.mesh.triangles()[..chunk.own].iter();
            let bad = own.zip(&chunk.origin).filter(|(t, _)| is_doubled(t));
            found.extend(bad.map(|(_, &origin)| origin));
        }
        Ok(found)
    }

    /// Returns whether the surface is closed, manifold and oriented, and no two vertices share a position.
    pub fn is_closed_manifold(&self, progress: &Progress) -> Result<bool, OffsetError> {
        if !self.doubled(progress)?.is_empty() {
            return Ok(false);
        }
        for at in 0..self.count() {
            let chunk = self.chunk_with_neighbors(at, progress)?;
            let adjacency = Adjacency::new(&chunk.mesh);
            progress.check()?;
            let is_own = |t: u32| (t as usize) < chunk.own;
            let edges = 0..adjacency.edges().len() as u32;
            let is_good = edges
                .map(|edge| adjacency.uses(edge))
                .all(|uses| match uses {
                    [one, other] => one.forward != other.forward,
                    several => !several.iter().any(|side| is_own(side.triangle)),
                });
            let own = chunk.mesh.triangles()[..chunk.own].iter();
            let corners: FxHashSet<u32> = own.flatten().copied().collect();
            progress.check()?;
            let pinched = adjacency.pinched_vertices(&chunk.mesh);
            if !is_good || pinched.iter().any(|v| corners.contains(v)) {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

impl Chunk {
    /// Returns, by vertex, whether triangles of other chunks share it, if the surface is closed.
    pub fn border(&self) -> Vec<bool> {
        border(self.mesh.positions().len(), self.mesh.triangles().iter())
    }
}

impl Assembly {
    /// Adds triangles of a block.
    fn add(
        &mut self,
        block: usize,
        patch: &Patch,
        numbers: impl Iterator<Item = u32>,
        progress: &Progress,
    ) -> Result<(), OffsetError> {
        let mut known = vec![u32::MAX; patch.positions.len()];
        for t in numbers {
            if t.is_multiple_of(TRIANGLES_AT_ONCE) {
                progress.check()?;
            }
            let corners = patch.triangles[t as usize].map(|v| {
                let number = &mut known[v as usize];
                if *number == u32::MAX {
                    let next = self.positions.len() as u32;
                    let name = patch.names[v as usize];
                    *number = *self.number_of.entry(name).or_insert(next);
                    if *number == next {
                        self.positions.push(patch.positions[v as usize]);
                        self.names.push(name);
                    }
                }
                *number
            });
            self.triangles.push(corners);
            self.origin.push([block as u32, t]);
            self.ample.push(patch.ample[t as usize]);
        }
        Ok(())
    }

    /// Adds triangles of the only block.
    fn add_alone(&mut self, patch: &Patch, numbers: impl Iterator<Item = u32>) {
        let mut known = vec![u32::MAX; patch.positions.len()];
        for t in numbers {
            self.triangles.push(patch.triangles[t as usize].map(|v| {
                let number = &mut known[v as usize];
                if *number == u32::MAX {
                    *number = self.positions.len() as u32;
                    self.positions.push(patch.positions[v as usize]);
                }
                *number
            }));
            self.origin.push([0, t]);
            self.ample.push(patch.ample[t as usize]);
        }
    }

    fn finished(self) -> Chunk {
        Chunk {
            own: self.triangles.len(),
            mesh: mesh(self.positions, self.triangles),
            names: self.names,
            origin: self.origin,
            ample: self.ample,
        }
    }
}

fn mesh(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> TriMesh {
    TriMesh::new(positions, triangles).expect("corners are finite and have numbers")
}
