//! The workspace of repair: all of space at once, or tiles in a storage.

use crate::extract::CrossingCache;
use crate::grow::{Refinement, Setting};
use crate::params::OffsetError;
use crate::prove::Defects;
use crate::store::{Record, Scratch, StoredTile, damaged, encoded};
use crate::surface::{Bytes, Patch};
use ravec_octree::CellKey;

/// The tiles under repair.
pub(crate) enum Workspace<'a> {
    Empty,
    /// All of space as one tile in memory.
    Whole(Box<GrownTile<'a>>),
    /// Tiles in a storage, in Morton order.
    Tiled(Scratch, Vec<StoredTile>),
}

/// A tile in memory with its tree.
pub(crate) struct GrownTile<'a> {
    pub key: CellKey,
    pub refinement: Refinement<'a>,
    pub places: CrossingCache,
    pub defects: Defects,
    pub patch: Patch,
}

impl Workspace<'_> {
    pub fn triangles(&self) -> usize {
        match self {
            Self::Empty => 0,
            Self::Whole(whole) => whole.patch.triangles.len(),
            Self::Tiled(_, tiles) => tiles.iter().map(|tile| tile.triangles as usize).sum(),
        }
    }

    pub fn tiles(&self) -> u64 {
        match self {
            Self::Empty => 0,
            Self::Whole(_) => 1,
            Self::Tiled(_, tiles) => tiles.len() as u64,
        }
    }

    /// Returns the number of leaves and their finest level.
    pub fn leaf_count_and_depth(&self) -> (u64, u8) {
        match self {
            Self::Empty => (0, 0),
            Self::Whole(whole) => whole.leaf_count_and_depth(),
            Self::Tiled(_, tiles) => (
                tiles.iter().map(|tile| tile.leaves).sum(),
                (tiles.iter().map(|tile| tile.deepest_level).max()).unwrap_or(0),
            ),
        }
    }
}

impl GrownTile<'_> {
    /// Drops the tree.
    pub fn without_tree(self) -> (CellKey, Defects, Patch) {
        (self.key, self.defects, self.patch)
    }

    /// Returns the number of leaves that start in the tile and their finest level.
    pub fn leaf_count_and_depth(&self) -> (u64, u8) {
        let tree = &self.refinement.tree;
        let keys = tree.leaves().map(|leaf| tree.key(leaf));
        keys.filter(|key| self.key.owns(key.at))
            .fold((0, 0), |(count, deepest), key| {
                (count + 1, key.level.max(deepest))
            })
    }
}

impl StoredTile {
    /// Stores a tile, in the place of its earlier records if it fits.
    pub fn put(
        grown: GrownTile<'_>,
        scratch: &Scratch,
        instead: Option<[Record; 2]>,
    ) -> Result<Self, OffsetError> {
        let [tree, patch] = [0, 1].map(|i| instead.map(|records| records[i]));
        let (leaves, deepest_level) = grown.leaf_count_and_depth();
        Ok(Self {
            key: grown.key,
            reach: grown.refinement.reach().clone(),
            tree: scratch.put(&grown.refinement.to_bytes(), tree)?,
            patch: scratch.put(&encoded(&grown.patch), patch)?,
            defects: grown.defects,
            triangles: grown.patch.triangles.len() as u64,
            leaves,
            deepest_level,
        })
    }

    /// Loads a tile; the cache of crossings starts empty.
    pub fn get<'a>(
        self,
        setting: Setting<'a>,
        max_nodes: usize,
        scratch: &Scratch,
    ) -> Result<GrownTile<'a>, OffsetError> {
        Ok(GrownTile {
            key: self.key,
            refinement: self.refinement(setting, max_nodes, scratch)?,
            places: CrossingCache::default(),
            patch: scratch.patch(self.patch)?,
            defects: self.defects,
        })
    }

    pub fn refinement<'a>(
        &self,
        setting: Setting<'a>,
        max_nodes: usize,
        scratch: &Scratch,
    ) -> Result<Refinement<'a>, OffsetError> {
        let bytes = scratch.get(self.tree)?;
        let refinement = Refinement::from_bytes(setting, self.key, max_nodes, &mut Bytes(&bytes));
        refinement.ok_or_else(damaged)
    }
}
