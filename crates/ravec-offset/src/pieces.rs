//! Offsets whose steps run in other processes: this one plans pieces and merges the answers.
//!
//! The coordinator writes the mesh, the edits of each round and the list of blocks as parts. Workers write the other parts: a tile
//! with its tree, the blocks of a tile, or a simplified chunk. A piece names the parts that it needs.
//!
//! | step | a piece | its answer | merged |
//! | --- | --- | --- | --- |
//! | round of repair | a tile | the edits that repair its defects, or that it is too large | edits of all tiles; tiles that are too large become eight |
//! | division | a tile | its blocks | the surface in chunks, and its components |
//! | search | a chunk | triangles that intersect | edits of the last rounds |
//! | simplification | a chunk | a smaller block | chunks of fewer triangles; those that met others are simplified again |
//! | facts | a chunk | extremes of the distance, checks | the report |
//!
//! Guarantees: the same surface and report as [`offset_stored`](crate::offset_stored), byte by byte, for the same parameters,
//! whatever the number of workers and the order in which they answer. Lost parts are recomputed.

mod coordinator;
mod piece;
mod worker;

pub use coordinator::offset_in_pieces;
pub use worker::OffsetWorker;

pub(crate) use coordinator::Coordinator;

use piece::{Answer, Input, Piece, Work};
