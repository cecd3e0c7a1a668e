//! Steps of a mosaic that run in other processes: the search for candidates, decoding and scaling of photos, and painting of rows.
//!
//! Most of the time of a mosaic goes into decoding the photos that were chosen, and most of the rest into the search for the photos
//! nearest to each tile. With a cluster, its workers search for some tiles at a time in an index that each of them makes once;
//! decode and scale some photos at a time into parts; and paint strips of the mosaic from these parts into others, which the
//! coordinator writes one after the other. Photos are read by their paths, which all machines must see.
//!
//! The search divides the tiles and not the photos: a search among half of the photos takes far more than half of the time.
//!
//! Guarantees: the same mosaic as without a cluster, as far as each worker has the memory for each photo: one that takes more than a
//! worker has is replaced by another, as one that takes more than the budget is without a cluster. Lost parts are recomputed.
//!
//! Memory: of a worker, the photos that are scaled at once, or some painted rows: at most 16 MiB, or one row if that is more, beside
//! the index and 16 MiB of parts. At most 128 parts with painted rows wait in the store.

mod coordinator;
mod parts;
mod worker;

pub(crate) use coordinator::{ClusterTasks, PaintedStrips};
pub use worker::MosaicWorker;

use crate::error::CatalogueError;
use ravec_mosaic::Crop;
use serde::{Deserialize, Serialize};
use std::io::{Error, ErrorKind};
use std::ops::Range;
use std::path::PathBuf;

/// A photo and the size in which it is wanted.
type Wanted = (PathBuf, [u32; 2]);

/// For each photo of a piece, why it cannot be read, if so.
type Flaws = Vec<Option<String>>;

/// A piece of the work.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Piece {
    /// Number of the part that it writes.
    part: u64,
    work: Work,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
enum Work {
    /// Photos to scale.
    Scale {
        crop: Crop,
        max_pixels: u64,
        photos: Vec<Wanted>,
    },
    /// Tiles to search for.
    Search {
        /// Number of the index.
        index: u64,
        /// For each tile, the query and the number of photos.
        queries: Vec<(Vec<f32>, u32)>,
    },
    /// Rows of the mosaic to paint.
    Paint {
        /// Columns of the mosaic.
        width: u32,
        rows: Range<u32>,
        tiles: Vec<Scaled>,
    },
}

/// A photo as it stands in a tile, and its place in a part.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Scaled {
    part: u64,
    /// Bytes of the whole part.
    part_bytes: u64,
    /// First byte of the photo.
    at: u64,
    /// First column and row of the tile in the mosaic.
    origin: [u32; 2],
    size: [u32; 2],
}

#[derive(Debug, Clone, Serialize, Deserialize)]
enum Answer {
    /// The part is written; a piece without photos to scale has no flaws.
    Done(Flaws),
    /// These parts are not there.
    Lost(Vec<u64>),
}

fn part_name(part: u64) -> String {
    format!("part-{part}")
}

/// Returns the name of the vectors of an index.
fn index_name(index: u64) -> String {
    format!("index-{index}")
}

fn bytes_of([width, height]: [u32; 2]) -> u64 {
    3 * u64::from(width) * u64::from(height)
}

fn is_lost(error: &Error) -> bool {
    matches!(error.kind(), ErrorKind::NotFound | ErrorKind::UnexpectedEof)
}

fn damaged() -> Error {
    Error::new(
        ErrorKind::InvalidData,
        "its content is not what was written",
    )
}

/// Error of the store, or of bytes that no coordinator wrote.
#[expect(
    clippy::needless_pass_by_value,
    reason = "taken as it comes from a result"
)]
fn broken(error: Error) -> CatalogueError {
    CatalogueError::Piece {
        reason: error.to_string(),
    }
}
