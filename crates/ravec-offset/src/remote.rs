//! Interface between the steps 6 and 7 and other processes.
//!
//! Repair and finish divide their work into tiles and chunks, which this process handles one after the other. With a [`Remote`],
//! other processes run the same functions on them, and keep trees and surfaces in parts that all of them share. Both ways give
//! the same bytes.

use crate::params::OffsetError;
use crate::prove::EditRequests;
use crate::report::ChunkFacts;
use crate::store::{Block, ChunkedSurface, Record, Scratch, StoredTile};
use crate::surface::Edits;
use ravec_mesh::Aabb;
use ravec_octree::CellKey;
use ravec_progress::Progress;
use serde::{Deserialize, Serialize};

/// Task for a tile in a round of repair.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) enum TileTask {
    /// Grow the tree.
    Grow(CellKey),
    /// Apply the latest edits.
    Repair(Box<StoredTile>),
}

impl TileTask {
    pub fn key(&self) -> CellKey {
        match self {
            Self::Grow(key) => *key,
            Self::Repair(tile) => tile.key,
        }
    }
}

/// Result of the task for a tile.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) enum TileOutcome {
    Done(Box<StoredTile>, EditRequests),
    /// The tree exceeds the budget: the tile must be divided into eight.
    TooLarge,
}

/// Task to simplify a chunk.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct ChunkTask {
    pub chunk: usize,
    /// Boxes in which vertices are fixed: triangles intersected there.
    pub places: Vec<Aabb>,
    /// The chunk is not simplified.
    pub is_kept: bool,
    /// The error samples of its blocks, in the store of the surface, for the pass that simplifies seams.
    pub samples: Option<Vec<Record>>,
}

/// A simplified chunk, as one block.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct SimplifiedChunk {
    pub block: Block,
    /// Error samples near its border, in the store of the block.
    pub samples: Record,
}

/// Runs steps in other processes. Results are in the order of the tasks.
pub(crate) trait Remote: Sync {
    /// Returns the parts, for reading.
    fn parts(&self) -> Scratch;

    /// Advances tiles by a round with new edits; tiles that are too large are divided. The resulting tiles have no order.
    fn advance(
        &self,
        tasks: Vec<TileTask>,
        latest: &Edits,
        levels: u8,
        progress: &Progress,
    ) -> Result<Vec<(StoredTile, EditRequests)>, OffsetError>;

    /// Divides tiles into blocks.
    fn divide(
        &self,
        tiles: &[StoredTile],
        progress: &Progress,
    ) -> Result<Vec<Vec<Block>>, OffsetError>;

    /// Finds the triangles of chunks that intersect others or have doubled corners.
    fn defects(
        &self,
        surface: &ChunkedSurface,
        progress: &Progress,
    ) -> Result<Vec<Vec<[u32; 2]>>, OffsetError>;

    /// Simplifies chunks.
    fn simplify(
        &self,
        surface: &ChunkedSurface,
        tasks: Vec<ChunkTask>,
        progress: &Progress,
    ) -> Result<Vec<SimplifiedChunk>, OffsetError>;

    /// Finds the pairs of triangles that intersect, at least one of them in the chunk.
    fn pairs(
        &self,
        surface: &ChunkedSurface,
        progress: &Progress,
    ) -> Result<Vec<Vec<[[u32; 2]; 2]>>, OffsetError>;

    /// Measures and checks chunks.
    fn facts(
        &self,
        surface: &ChunkedSurface,
        ample_distance: f64,
        progress: &Progress,
    ) -> Result<Vec<ChunkFacts>, OffsetError>;
}
