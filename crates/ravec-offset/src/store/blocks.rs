//! Blocks: the unit in which a finished surface is kept.

use super::codec::decoded_samples;
use super::{Record, Scratch, damaged, encoded};
use crate::params::OffsetError;
use crate::surface::Patch;
use ravec_mesh::{Aabb, ErrorSample};
use ravec_octree::{CellKey, Corner};
use ravec_progress::Progress;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Bound on the polygons of a block; smaller blocks have a larger share of shared vertices.
const MAX_POLYGONS: usize = 1000;

/// Number of blocks that are made before they are stored.
const BLOCKS_AT_ONCE: usize = 64;

/// A part of the surface: the polygons whose edges start in a cell.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Block {
    pub key: CellKey,
    pub patch: PatchHandle,
    /// Bounds of the triangles.
    pub bounds: Aabb,
    pub triangles: usize,
    /// The patch has no defect.
    pub is_proved: bool,
}

/// A patch in memory, or its record in the storage.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) enum PatchHandle {
    /// Not sent to other processes, unless it is empty.
    Resident(#[serde(skip)] Patch),
    Stored(Record),
}

/// Storage of the patches of blocks.
#[derive(Debug)]
pub(crate) enum Store {
    Memory,
    Storage(Scratch),
}

impl Store {
    /// Stores a patch.
    pub fn put(&self, patch: Patch) -> Result<PatchHandle, OffsetError> {
        match self {
            Self::Storage(scratch) if !patch.triangles.is_empty() => {
                Ok(PatchHandle::Stored(scratch.put(&encoded(&patch), None)?))
            }
            Self::Storage(_) | Self::Memory => Ok(PatchHandle::Resident(patch)),
        }
    }

    /// Writes the part with the patches that were put, if they are in one.
    pub fn write(&self) -> Result<(), OffsetError> {
        match self {
            Self::Storage(scratch) => scratch.write(),
            Self::Memory => Ok(()),
        }
    }

    /// Stores bytes; only a storage can.
    pub fn put_bytes(&self, bytes: &[u8]) -> Result<Record, OffsetError> {
        match self {
            Self::Storage(scratch) => scratch.put(bytes, None),
            Self::Memory => unreachable!("memory holds patches only"),
        }
    }

    /// Loads error samples.
    pub fn samples(&self, record: Record) -> Result<Vec<ErrorSample>, OffsetError> {
        match self {
            Self::Storage(scratch) => decoded_samples(&scratch.get(record)?).ok_or_else(damaged),
            Self::Memory => unreachable!("memory holds patches only"),
        }
    }

    /// Loads a patch.
    pub fn get<'a>(&self, kept: &'a PatchHandle) -> Result<Cow<'a, Patch>, OffsetError> {
        match (self, kept) {
            (_, PatchHandle::Resident(patch)) => Ok(Cow::Borrowed(patch)),
            (Self::Storage(scratch), &PatchHandle::Stored(record)) => {
                Ok(Cow::Owned(scratch.patch(record)?))
            }
            (Self::Memory, PatchHandle::Stored(_)) => unreachable!("memory puts nothing elsewhere"),
        }
    }
}

/// Stores a tile as blocks, in Morton order; `defects` are starts of edges.
pub(crate) fn put_blocks(
    tile: CellKey,
    patch: &Patch,
    defects: &[Corner],
    store: &Store,
    progress: &Progress,
) -> Result<Vec<Block>, OffsetError> {
    let mut blocks = vec![];
    let divided = patch.divided(tile, MAX_POLYGONS);
    let filled: Vec<_> = divided
        .into_iter()
        .filter(|(_, edges)| !edges.is_empty())
        .collect();
    // stored in order, so that the bytes of a part do not depend on threads
    for cells in filled.chunks(BLOCKS_AT_ONCE) {
        let patches = cells.par_iter().map(|(cell, edges)| {
            progress.check()?;
            Ok((*cell, patch.subset(edges.clone())))
        });
        for (cell, patch) in patches.collect::<Result<Vec<_>, OffsetError>>()? {
            blocks.push(put_block(cell, patch, store)?);
        }
    }
    for &start in defects.iter().filter(|&&start| tile.owns(start)) {
        let after = blocks.partition_point(|block| block.key.at.morton() <= start.morton());
        // where nothing starts there is no block
        if let Some(block) = blocks.get_mut(after.saturating_sub(1)) {
            block.is_proved = false;
        }
    }
    Ok(blocks)
}

/// Stores a block without defects.
pub(crate) fn put_block(key: CellKey, patch: Patch, store: &Store) -> Result<Block, OffsetError> {
    let corners = patch.positions.iter().copied();
    Ok(Block {
        key,
        bounds: Aabb::around(corners),
        triangles: patch.triangles.len(),
        is_proved: true,
        patch: store.put(patch)?,
    })
}
