//! The surface without any tree: blocks, and pieces of as many of them as fit in memory.
//!
//! What is asked of all of the surface is asked of one piece after the other; where that depends on neighbors, a piece comes with
//! the triangles of others near it. Vertices of several blocks are the same if they have the same name.

use crate::grid::doubled;
use crate::judge::meeting_pairs;
use crate::outermost::{reachable, reachable_in_blocks};
use crate::params::OffsetError;
use crate::store::{Block, Kept, Store};
use crate::tile::{Patch, TRIANGLES_AT_ONCE, VertexName, border};
use glam::DVec3;
use ravec_mesh::{Aabb, Adjacency, TriMesh};
use ravec_progress::Progress;
use rustc_hash::{FxHashMap, FxHashSet};
use std::borrow::Cow;
use std::ops::Range;

/// What of the surface is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Visibility {
    All,
    /// What can be reached from far away.
    Reachable,
}

/// Blocks, and what of them is asked for.
#[derive(Debug)]
pub(crate) struct Pieces {
    store: Store,
    blocks: Vec<Block>,
    /// The blocks of each piece.
    ranges: Vec<Range<usize>>,
    /// Of the triangles of blocks that are not asked for as a whole, which are.
    seen: FxHashMap<usize, Vec<bool>>,
}

/// A part of the surface.
#[derive(Debug, Default)]
pub(crate) struct Piece {
    pub mesh: TriMesh,
    /// The names of its vertices; none if it is all of the surface.
    pub names: Vec<VertexName>,
    /// So many triangles are its own; those after them are of other pieces.
    pub own: usize,
    /// The block of each triangle, and its number there.
    pub origin: Vec<[u32; 2]>,
    /// Of each triangle whether ample room below it was proved.
    pub ample: Vec<bool>,
}

/// A piece that is put together.
#[derive(Default)]
struct Assembly {
    positions: Vec<DVec3>,
    names: Vec<VertexName>,
    number_of: FxHashMap<VertexName, u32>,
    triangles: Vec<[u32; 3]>,
    origin: Vec<[u32; 2]>,
    ample: Vec<bool>,
}

impl Pieces {
    /// Pieces of at most so many triangles, if blocks are not larger.
    pub fn new(
        store: Store,
        blocks: Vec<Block>,
        most_triangles: usize,
        visibility: Visibility,
        progress: &Progress,
    ) -> Result<Self, OffsetError> {
        let mut ranges: Vec<Range<usize>> = vec![];
        let mut triangles = 0;
        for (at, block) in blocks.iter().enumerate() {
            triangles += block.triangles;
            match ranges.last_mut() {
                Some(range) if triangles <= most_triangles => range.end = at + 1,
                _ => {
                    triangles = block.triangles;
                    ranges.push(at..at + 1);
                }
            }
        }
        let mut pieces = Self {
            store,
            blocks,
            ranges,
            seen: FxHashMap::default(),
        };
        if visibility == Visibility::Reachable {
            pieces.seen = pieces.reachable(progress)?;
        }
        Ok(pieces)
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

    /// The numbers of the blocks of a piece.
    pub fn blocks_of(&self, piece: usize) -> Range<usize> {
        self.ranges[piece].clone()
    }

    /// How many pieces there are.
    pub fn count(&self) -> usize {
        self.ranges.len()
    }

    /// How many triangles are asked for.
    pub fn triangles(&self) -> usize {
        let of_block = |(at, block): (usize, &Block)| match self.seen.get(&at) {
            Some(seen) => seen.iter().filter(|&&seen| seen).count(),
            None => block.triangles,
        };
        self.blocks.iter().enumerate().map(of_block).sum()
    }

    /// All that was made in a block.
    pub fn patch(&self, block: usize) -> Result<Cow<'_, Patch>, OffsetError> {
        self.store.get(&self.blocks[block].patch)
    }

    /// What of a block is asked for: its patch, and the numbers of these triangles.
    pub fn part(
        &self,
        block: usize,
    ) -> Result<(Cow<'_, Patch>, impl Iterator<Item = u32> + use<'_>), OffsetError> {
        let patch = self.patch(block)?;
        let seen = self.seen.get(&block);
        let numbers = 0..patch.triangles.len() as u32;
        let numbers = numbers.filter(move |&t| seen.is_none_or(|seen| seen[t as usize]));
        Ok((patch, numbers))
    }

    /// A piece without what is around it.
    pub fn piece(&self, piece: usize, progress: &Progress) -> Result<Piece, OffsetError> {
        Ok(self.own(piece, progress)?.finished())
    }

    /// A piece with the triangles of others that are near it: all that meet its triangles, and all around their corners.
    pub fn piece_with_neighbors(
        &self,
        piece: usize,
        progress: &Progress,
    ) -> Result<Piece, OffsetError> {
        let mut assembly = self.own(piece, progress)?;
        let own = assembly.triangles.len();
        let range = &self.ranges[piece];
        // block by block: a box around all of the piece may hold most of the surface
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
            let (patch, numbers) = self.part(at)?;
            let is_near = |&t: &u32| {
                let corners = patch.triangles[t as usize].map(|v| patch.positions[v as usize]);
                let around = Aabb::around(corners);
                beside.iter().any(|bounds| bounds.touches(&around))
            };
            assembly.add(at, &patch, numbers.filter(is_near), progress)?;
        }
        Ok(Piece {
            own,
            ..assembly.finished()
        })
    }

    fn own(&self, piece: usize, progress: &Progress) -> Result<Assembly, OffsetError> {
        self.assembled(self.ranges[piece].clone(), progress)
    }

    fn assembled(
        &self,
        blocks: Range<usize>,
        progress: &Progress,
    ) -> Result<Assembly, OffsetError> {
        let mut assembly = Assembly::default();
        for at in blocks {
            let (patch, numbers) = self.part(at)?;
            if self.blocks.len() == 1 {
                assembly.add_alone(&patch, numbers);
            } else {
                assembly.add(at, &patch, numbers, progress)?;
            }
        }
        Ok(assembly)
    }

    /// All of the surface.
    pub fn into_mesh(mut self, progress: &Progress) -> Result<TriMesh, OffsetError> {
        let is_all = self.seen.is_empty();
        if let ([Block { patch, .. }], true) = (&mut self.blocks[..], is_all)
            && let Kept::Here(patch) = patch
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

    /// Pairs of triangles that meet where they should not, each by its block and its number there.
    pub fn meeting_pairs(&self, progress: &Progress) -> Result<Vec<[[u32; 2]; 2]>, OffsetError> {
        let mut found = Vec::new();
        for at in 0..self.count() {
            let piece = self.piece_with_neighbors(at, progress)?;
            let pairs = meeting_pairs(piece.mesh.positions(), piece.mesh.triangles(), progress)?;
            let is_own = |pair: &[u32; 2]| pair.iter().any(|&t| (t as usize) < piece.own);
            found.extend(pairs.into_iter().filter(is_own).map(|pair| {
                let [a, b] = pair.map(|t| piece.origin[t as usize]);
                [a.min(b), a.max(b)]
            }));
        }
        found.sort_unstable();
        // those of two pieces were found twice
        found.dedup();
        Ok(found)
    }

    /// The triangles that meet others, or have corners in one place with others, each by its block and its number there, in order.
    pub fn meeting(&self, progress: &Progress) -> Result<Vec<[u32; 2]>, OffsetError> {
        let mut bad = self.meeting_pairs(progress)?.concat();
        bad.extend(self.doubled(progress)?);
        bad.sort_unstable();
        bad.dedup();
        Ok(bad)
    }

    /// The triangles with a corner that has the place of another vertex.
    fn doubled(&self, progress: &Progress) -> Result<Vec<[u32; 2]>, OffsetError> {
        let mut found = Vec::new();
        for at in 0..self.count() {
            let piece = self.piece_with_neighbors(at, progress)?;
            let doubled = doubled(piece.mesh.positions());
            let is_doubled = |t: &[u32; 3]| t.iter().any(|v| doubled.contains(v));
            let own = piece.mesh.triangles()[..piece.own].iter();
            let bad = own.zip(&piece.origin).filter(|(t, _)| is_doubled(t));
            found.extend(bad.map(|(_, &origin)| origin));
        }
        Ok(found)
    }

    /// Whether the surface is closed, manifold and oriented, and no two vertices are in one place.
    pub fn is_closed_manifold(&self, progress: &Progress) -> Result<bool, OffsetError> {
        if !self.doubled(progress)?.is_empty() {
            return Ok(false);
        }
        for at in 0..self.count() {
            let piece = self.piece_with_neighbors(at, progress)?;
            let adjacency = Adjacency::new(&piece.mesh);
            progress.check()?;
            let is_own = |t: u32| (t as usize) < piece.own;
            let edges = 0..adjacency.edges().len() as u32;
            let is_good = edges
                .map(|edge| adjacency.uses(edge))
                .all(|uses| match uses {
                    [one, other] => one.forward != other.forward,
                    several => !several.iter().any(|side| is_own(side.triangle)),
                });
            let own = piece.mesh.triangles()[..piece.own].iter();
            let corners: FxHashSet<u32> = own.flatten().copied().collect();
            progress.check()?;
            let pinched = adjacency.pinched_vertices(&piece.mesh);
            if !is_good || pinched.iter().any(|v| corners.contains(v)) {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

impl Piece {
    /// Of each vertex whether triangles of other pieces have it, too, if the surface is closed.
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

    fn finished(self) -> Piece {
        Piece {
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
