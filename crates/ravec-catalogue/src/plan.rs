//! Division of the memory of a run among the parts of a mosaic.

use crate::deep_zoom::bytes_of_page;
use crate::error::CatalogueError;
use crate::layout::Layout;
use crate::mosaic::{MosaicParams, Outputs};
use crate::painter::Room;
use ravec_media::Limits;
use ravec_memory::{MemoryBudget, Reservation};

/// Bytes of a photo that can be chosen, beside those of its entry: its look, and its place in the index of looks.
const PHOTO_BYTES: u64 = 1500;

/// Bytes of a tile while photos are chosen: its look and its candidates.
const TILE_BYTES: u64 = 3000;

/// The same for tiles off the grid, of which more are examined than are used.
const ADAPTIVE_TILE_BYTES: u64 = 30_000;

/// Strips in which a tile is painted, at most: its photo may be decoded again for each.
const MAX_STRIPS_PER_TILE: u64 = 16;

/// The memory for painting.
pub(crate) struct Plan {
    /// Rows that are painted at once: those of a tile, or fewer.
    pub strip_px: usize,
    /// For scaled photos that are kept.
    pub room: Room,
    /// For the photos that are being scaled.
    pub photos: Limits,
    _fixed: Reservation,
}

/// Reserves memory for the choice of photos.
pub(crate) fn reserve_choice(
    layout: &Layout,
    params: &MosaicParams,
    photos: usize,
    memory: &MemoryBudget,
) -> Result<Reservation, CatalogueError> {
    let tiles = layout.columns.saturating_mul(layout.rows) as u64;
    let of_tile = if params.adaptive.is_some() {
        ADAPTIVE_TILE_BYTES
    } else {
        TILE_BYTES
    };
    let bytes = tiles
        .saturating_mul(of_tile)
        .saturating_add(photos as u64 * PHOTO_BYTES);
    reserve(memory, bytes, "the choice of photos")
}

/// Reserves memory for the looks of photos that are kept from one choice to the next.
pub(crate) fn reserve_photos(
    photos: usize,
    memory: &MemoryBudget,
) -> Result<Reservation, CatalogueError> {
    reserve(memory, photos as u64 * PHOTO_BYTES, "the looks of photos")
}

/// Reserves `bytes`, or says that the mosaic needs them for a purpose.
pub(crate) fn reserve(
    memory: &MemoryBudget,
    bytes: u64,
    purpose: &'static str,
) -> Result<Reservation, CatalogueError> {
    memory
        .reserve(bytes)
        .map_err(|over| CatalogueError::MosaicMemory {
            purpose,
            needed: over.needed,
            limit: over.limit,
        })
}

impl Plan {
    /// Divides what is left of the memory: at most half for the strip that is painted, unless that is too low a strip, a quarter
    /// of the rest for photos that are kept, and the others for those that are being scaled.
    pub fn new(
        layout: &Layout,
        outputs: &Outputs<'_>,
        params: &MosaicParams,
        limits: &Limits,
    ) -> Result<Self, CatalogueError> {
        let memory = &limits.memory;
        let row = 3 * layout.size.width() as u64;
        let page = match outputs.deep_zoom {
            Some(_) => bytes_of_page(layout.size, layout.columns.saturating_mul(layout.rows)),
            None => 0,
        };
        // the strip, and what an encoder has of it
        let left = memory.available().saturating_sub(page);
        let tile_px = layout.tile_px() as u64;
        let min_px = tile_px.div_ceil(MAX_STRIPS_PER_TILE);
        let strip_px = (left / 2 / (2 * row)).clamp(min_px, tile_px);
        let purpose = "the rows that are painted at once";
        let mut fixed = reserve(memory, page.saturating_add(2 * row * strip_px), purpose)?;

        let of_tiles = row.saturating_mul(tile_px);
        let wanted = (params.kept_bytes as u64).max(2 * of_tiles);
        let all = wanted.min(memory.available() / 4);
        fixed.absorb(reserve(memory, all, "photos that are kept")?);
        let rest = reserve(memory, memory.available(), "photos")?;
        Ok(Self {
            strip_px: strip_px as usize,
            room: Room {
                all: all as usize,
                for_later: params.kept_bytes.min(all as usize),
            },
            photos: Limits {
                memory: rest.into_budget(),
                ..limits.clone()
            },
            _fixed: fixed,
        })
    }
}
