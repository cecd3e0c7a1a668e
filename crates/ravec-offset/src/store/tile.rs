//! Tiles in the storage.

use super::Record;
use crate::prove::Defects;
use crate::surface::Reach;
use ravec_octree::CellKey;
use serde::{Deserialize, Serialize};

/// A tile in the storage, with its tree and its surface.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct StoredTile {
    pub key: CellKey,
    /// The domain that the tile depends on.
    pub reach: Reach,
    pub tree: Record,
    pub patch: Record,
    pub defects: Defects,
    pub triangles: u64,
    pub leaves: u64,
    pub deepest_level: u8,
}
