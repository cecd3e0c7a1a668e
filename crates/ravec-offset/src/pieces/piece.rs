//! Pieces and answers.

use crate::params::{OffsetError, OffsetParams};
use crate::remote::{ChunkTask, SimplifiedChunk, TileOutcome, TileTask};
use crate::report::ChunkFacts;
use crate::store::{Block, StoredTile, damaged, failed};
use crate::surface::Bytes;
use bytemuck::cast_slice;
use glam::DVec3;
use ravec_mesh::TriMesh;
use serde::{Deserialize, Serialize};

/// A piece of the work.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Piece {
    /// Number of the part that it writes.
    pub part: u64,
    pub work: Work,
}

/// Task of a piece.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) enum Work {
    /// A tile in the round after a number of rounds with edits.
    Tile {
        task: TileTask,
        rounds: u32,
        levels: u8,
        /// The tile is known to fit.
        fits: bool,
    },
    /// A tile to divide into blocks.
    Divide(Box<StoredTile>),
    /// A chunk of a published surface.
    Defects {
        surface: u64,
        chunk: usize,
    },
    Simplify {
        surface: u64,
        task: ChunkTask,
    },
    Pairs {
        surface: u64,
        chunk: usize,
    },
    Facts {
        surface: u64,
        chunk: usize,
        ample_distance: f64,
    },
}

/// The answer to a piece.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Answer {
    Tile(TileOutcome),
    Blocks(Vec<Block>),
    Defects(Vec<[u32; 2]>),
    Simplified(Box<SimplifiedChunk>),
    Pairs(Vec<[[u32; 2]; 2]>),
    Facts(ChunkFacts),
    /// A part that it needs is lost.
    Missing(u64),
}

impl Work {
    /// Returns the tile that it loads.
    pub fn tile_mut(&mut self) -> Option<&mut Box<StoredTile>> {
        match self {
            Self::Tile {
                task: TileTask::Repair(tile),
                ..
            }
            | Self::Divide(tile) => Some(tile),
            _ => None,
        }
    }
}

/// Name of the part with the mesh and the parameters.
pub(super) const INPUT: &str = "input";

/// Returns the name of the edits of a round.
pub(super) fn edits_name(round: u32) -> String {
    format!("edits-{round}")
}

/// Returns the name of a published surface.
pub(super) fn surface_name(surface: u64) -> String {
    format!("surface-{surface}")
}

/// The mesh and the parameters of the work.
pub(super) struct Input {
    pub mesh: TriMesh,
    pub params: OffsetParams,
}

impl Input {
    /// Encodes an input: lengths, parameters, positions, triangles.
    pub fn encoded(mesh: &TriMesh, params: &OffsetParams) -> Result<Vec<u8>, OffsetError> {
        let params = ravec_pieces::to_bytes(params).map_err(failed)?;
        let positions: Vec<[f64; 3]> = mesh.positions().iter().map(DVec3::to_array).collect();
        let lengths = [params.len(), positions.len(), mesh.triangles().len()];
        Ok([
            cast_slice(&lengths.map(|length| length as u64)),
            &params[..],
            cast_slice(&positions),
            cast_slice(mesh.triangles()),
        ]
        .concat())
    }

    pub fn decoded(bytes: &[u8]) -> Result<Self, OffsetError> {
        let read = |bytes: &mut Bytes<'_>| {
            let lengths: Vec<u64> = bytes.take(3)?;
            let params: Vec<u8> = bytes.take(lengths[0])?;
            let positions: Vec<[f64; 3]> = bytes.take(lengths[1])?;
            let positions = positions.into_iter().map(DVec3::from).collect();
            let mesh = TriMesh::new(positions, bytes.take(lengths[2])?).ok()?;
            let params = ravec_pieces::from_bytes(&params).ok()?;
            Some(Self { mesh, params })
        };
        read(&mut Bytes(bytes)).ok_or_else(damaged)
    }
}
