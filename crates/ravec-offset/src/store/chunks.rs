//! The surface in blocks, processed in chunks that fit in memory.
//!
//! Whole-surface queries are answered chunk by chunk; where the answer depends on neighbors, a chunk comes with the triangles
//! of other chunks near it. Vertices of different blocks are the same if their names are equal.

use super::outermost::{reachable, reachable_in_blocks};
use super::{Block, PatchHandle, Record, Scratch, Store, damaged, failed};
use crate::params::OffsetError;
use crate::surface::{Patch, TRIANGLES_AT_ONCE, VertexName};
use crate::surface::{border, doubled, intersecting_pairs};
use glam::DVec3;
use ravec_mesh::{Aabb, Adjacency, ErrorSample, TriMesh};
use ravec_progress::Progress;
use rustc_hash::{FxHashMap, FxHashSet};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::OnceLock;

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
    /// Number under which other processes know it.
    pub published: OnceLock<u64>,
}

/// A surface as data, without its store.
#[derive(Serialize, Deserialize)]
struct ListedSurface {
    blocks: Vec<Block>,
    ranges: Vec<Range<usize>>,
    seen: Vec<(usize, Vec<bool>)>,
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
            published: OnceLock::new(),
        };
        if visibility == Visibility::Reachable {
            chunks.seen = chunks.reachable(progress)?;
        }
        Ok(chunks)
    }

    /// Encodes the surface for other processes, which share its store.
    pub fn to_bytes(&self) -> Result<Vec<u8>, OffsetError> {
        let mut seen: Vec<(usize, Vec<bool>)> = (self.seen.iter())
            .map(|(&at, seen)| (at, seen.clone()))
            .collect();
        seen.sort_unstable_by_key(|&(at, _)| at);
        let listed = ListedSurface {
            blocks: self.blocks.clone(),
            ranges: self.ranges.clone(),
            seen,
        };
        ravec_pieces::to_bytes(&listed).map_err(failed)
    }

    /// Decodes the bytes of [`Self::to_bytes`].
    pub fn from_bytes(bytes: &[u8], scratch: Scratch) -> Result<Self, OffsetError> {
        let listed: ListedSurface = ravec_pieces::from_bytes(bytes).map_err(failed)?;
        let blocks = listed.blocks.len();
        let is_inside = |range: &Range<usize>| range.start < range.end && range.end <= blocks;
        if !listed.ranges.iter().all(is_inside) {
            return Err(damaged());
        }
        Ok(Self {
            store: Store::Storage(scratch),
            blocks: listed.blocks,
            ranges: listed.ranges,
            seen: listed.seen.into_iter().collect(),
            published: OnceLock::new(),
        })
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

    /// Loads the error samples of blocks.
    pub fn samples(&self, records: &[Record]) -> Result<Vec<Vec<ErrorSample>>, OffsetError> {
        let records = records.iter();
        records.map(|&record| self.store.samples(record)).collect()
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

    /// Returns pairs of triangles that intersect, at least one of them in a chunk, each by its block and its number there.
    pub fn pairs_in(
        &self,
        chunk: usize,
        progress: &Progress,
    ) -> Result<Vec<[[u32; 2]; 2]>, OffsetError> {
        self.chunk_with_neighbors(chunk, progress)?.pairs(progress)
    }

    /// Returns the triangles of a chunk that have corners at the position of another vertex, and all that intersect one of its
    /// triangles, each by its block and its number there.
    pub fn defects_in(
        &self,
        chunk: usize,
        progress: &Progress,
    ) -> Result<Vec<[u32; 2]>, OffsetError> {
        let chunk = self.chunk_with_neighbors(chunk, progress)?;
        let mut bad = chunk.pairs(progress)?.concat();
        bad.extend(chunk.doubled());
        Ok(bad)
    }
}

/// Merges pairs of triangles of chunks; those of two chunks are found twice.
pub(crate) fn merged_pairs(found: &[Vec<[[u32; 2]; 2]>]) -> Vec<[[u32; 2]; 2]> {
    let mut found = found.concat();
    found.sort_unstable();
    found.dedup();
    found
}

impl Chunk {
    /// Returns pairs of triangles that intersect, at least one of them its own, each by its block and its number there.
    pub fn pairs(&self, progress: &Progress) -> Result<Vec<[[u32; 2]; 2]>, OffsetError> {
        let pairs = intersecting_pairs(self.mesh.positions(), self.mesh.triangles(), progress)?;
        let is_own = |pair: &[u32; 2]| pair.iter().any(|&t| (t as usize) < self.own);
        let named = pairs.into_iter().filter(is_own).map(|pair| {
            let [a, b] = pair.map(|t| self.origin[t as usize]);
            [a.min(b), a.max(b)]
        });
        Ok(named.collect())
    }

    /// Returns its own triangles with a corner at the position of another vertex.
    fn doubled(&self) -> Vec<[u32; 2]> {
        let doubled = doubled(self.mesh.positions());
        let is_doubled = |t: &[u32; 3]| t.iter().any(|v| doubled.contains(v));
        let own = self.mesh.triangles()[..self.own].iter();
        let bad = own.zip(&self.origin).filter(|(t, _)| is_doubled(t));
        bad.map(|(_, &origin)| origin).collect()
    }

    /// Returns whether the surface is closed, manifold and oriented at its own triangles, and none of their corners shares its
    /// position with another vertex. The chunk must have its neighbors.
    pub fn is_closed_manifold(&self, progress: &Progress) -> Result<bool, OffsetError> {
        if !self.doubled().is_empty() {
            return Ok(false);
        }
        let adjacency = Adjacency::new(&self.mesh);
        progress.check()?;
        let is_own = |t: u32| (t as usize) < self.own;
        let edges = 0..adjacency.edges().len() as u32;
        let is_good = edges
            .map(|edge| adjacency.uses(edge))
            .all(|uses| match uses {
                [one, other] => one.forward != other.forward,
                several => !several.iter().any(|side| is_own(side.triangle)),
            });
        let own = self.mesh.triangles()[..self.own].iter();
        let corners: FxHashSet<u32> = own.flatten().copied().collect();
        progress.check()?;
        let pinched = adjacency.pinched_vertices(&self.mesh);
        Ok(is_good && !pinched.iter().any(|v| corners.contains(v)))
    }

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
