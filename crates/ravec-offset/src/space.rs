//! The surface while it is mended: all at once, or tile by tile in a storage; and the blocks that it becomes.

use crate::extract::CrossingPlaces;
use crate::judge::Bad;
use crate::params::OffsetError;
use crate::refine::{Refinement, Setting};
use crate::store::{Block, Bytes, Record, Scratch, Store, damaged, encoded};
use crate::tile::{Patch, Reach};
use ravec_mesh::Aabb;
use ravec_octree::CellKey;
use ravec_progress::Progress;
use rayon::prelude::*;

/// Polygons of a block. Of smaller ones more is border.
const MOST_POLYGONS: usize = 1000;

/// The surface as far as it is made.
pub(crate) enum Space<'a> {
    Nothing,
    /// All of it at once.
    Whole(Box<Grown<'a>>),
    /// Tile by tile, in the order of the curve.
    Cut(Scratch, Vec<Tile>),
}

/// A tile, or all of space, with its tree.
pub(crate) struct Grown<'a> {
    pub key: CellKey,
    pub refinement: Refinement<'a>,
    pub places: CrossingPlaces,
    pub bad: Bad,
    pub patch: Patch,
}

/// A tile that is in the storage.
pub(crate) struct Tile {
    pub key: CellKey,
    /// What it depends on.
    pub reach: Reach,
    pub tree: Record,
    pub patch: Record,
    pub bad: Bad,
    pub triangles: usize,
    leaves: u64,
    deepest_level: u8,
}

impl Space<'_> {
    pub fn triangles(&self) -> usize {
        match self {
            Self::Nothing => 0,
            Self::Whole(whole) => whole.patch.triangles.len(),
            Self::Cut(_, tiles) => tiles.iter().map(|tile| tile.triangles).sum(),
        }
    }

    pub fn tiles(&self) -> u64 {
        match self {
            Self::Nothing => 0,
            Self::Whole(_) => 1,
            Self::Cut(_, tiles) => tiles.len() as u64,
        }
    }

    /// How many leaves there are, and their finest level.
    pub fn counted(&self) -> (u64, u8) {
        match self {
            Self::Nothing => (0, 0),
            Self::Whole(whole) => whole.counted(),
            Self::Cut(_, tiles) => (
                tiles.iter().map(|tile| tile.leaves).sum(),
                (tiles.iter().map(|tile| tile.deepest_level).max()).unwrap_or(0),
            ),
        }
    }
}

impl Grown<'_> {
    /// What is left once the tree is not needed.
    pub fn without_tree(self) -> (CellKey, Bad, Patch) {
        (self.key, self.bad, self.patch)
    }

    /// How many leaves start in it, and their finest level.
    pub fn counted(&self) -> (u64, u8) {
        let tree = &self.refinement.tree;
        let keys = tree.leaves().map(|leaf| tree.key(leaf));
        keys.filter(|key| self.key.owns(key.at))
            .fold((0, 0), |(count, deepest), key| {
                (count + 1, key.level.max(deepest))
            })
    }
}

impl Tile {
    /// Puts a tile away, if that fits where its tree and its patch were before.
    pub fn put(
        grown: Grown<'_>,
        scratch: &Scratch,
        instead: Option<[Record; 2]>,
    ) -> Result<Self, OffsetError> {
        let [tree, patch] = [0, 1].map(|i| instead.map(|records| records[i]));
        let (leaves, deepest_level) = grown.counted();
        Ok(Self {
            key: grown.key,
            reach: grown.refinement.reach().clone(),
            tree: scratch.put(&grown.refinement.to_bytes(), tree)?,
            patch: scratch.put(&encoded(&grown.patch), patch)?,
            bad: grown.bad,
            triangles: grown.patch.triangles.len(),
            leaves,
            deepest_level,
        })
    }

    /// What was put away; the places of crossings, which are only remembered to save time, are not.
    pub fn get<'a>(
        self,
        setting: Setting<'a>,
        most_nodes: usize,
        scratch: &Scratch,
    ) -> Result<Grown<'a>, OffsetError> {
        Ok(Grown {
            key: self.key,
            refinement: self.refinement(setting, most_nodes, scratch)?,
            places: CrossingPlaces::default(),
            patch: scratch.patch(self.patch)?,
            bad: self.bad,
        })
    }

    pub fn refinement<'a>(
        &self,
        setting: Setting<'a>,
        most_nodes: usize,
        scratch: &Scratch,
    ) -> Result<Refinement<'a>, OffsetError> {
        let bytes = scratch.get(self.tree)?;
        let refinement = Refinement::from_bytes(setting, self.key, most_nodes, &mut Bytes(&bytes));
        refinement.ok_or_else(damaged)
    }
}

/// The blocks of a tile, in the order of the curve.
pub(crate) fn blocks(
    tile: CellKey,
    patch: &Patch,
    bad: &Bad,
    store: &Store,
    progress: &Progress,
) -> Result<Vec<Block>, OffsetError> {
    let mut blocks = patch
        .cells(tile, MOST_POLYGONS)
        .into_par_iter()
        .filter(|(_, edges)| !edges.is_empty())
        .map(|(cell, edges)| {
            progress.check()?;
            block(cell, patch.part(edges), store)
        })
        .collect::<Result<Vec<Block>, OffsetError>>()?;
    for &start in bad.starts.iter().filter(|&&start| tile.owns(start)) {
        let after = blocks.partition_point(|block| block.key.at.morton() <= start.morton());
        // where nothing starts there is no block
        if let Some(block) = blocks.get_mut(after.saturating_sub(1)) {
            block.is_proved = false;
        }
    }
    Ok(blocks)
}

/// A block with nothing wrong.
pub(crate) fn block(key: CellKey, patch: Patch, store: &Store) -> Result<Block, OffsetError> {
    let corners = patch.positions.iter().copied();
    Ok(Block {
        key,
        bounds: Aabb::around(corners),
        triangles: patch.triangles.len(),
        is_proved: true,
        patch: store.put(patch)?,
    })
}
