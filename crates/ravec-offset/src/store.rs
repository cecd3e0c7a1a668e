//! Step 5, store: the surface without its tree, as blocks in memory or in a storage of the caller.
//!
//! During repair, tiles go to the storage with their trees and return when a round concerns them. The repaired surface is kept
//! as blocks in the order of the Morton curve through their cells; the polygons of consecutive blocks are in the order of the curve
//! through their edges.
//!
//! Guarantees: data read from the storage equals the data written, bit for bit.

mod blocks;
mod chunks;
mod codec;
mod components;
mod outermost;
mod rows;
mod storage;
mod tile;

pub(crate) use blocks::{Block, Store, put_block, put_blocks};
pub(crate) use chunks::{Chunk, ChunkedSurface, Visibility, merged_pairs};
pub(crate) use codec::{encoded, encoded_samples};
pub use rows::OffsetSurface;
pub(crate) use rows::StoredSurface;
pub use storage::{NewStorage, Storage};
pub(crate) use storage::{PART, Record, Scratch, damaged, failed, in_memory, part_name};
pub(crate) use tile::StoredTile;

use blocks::PatchHandle;
