//! Photos that are set by hand, by the names that the catalogue has for them.

use crate::error::CatalogueError;
use crate::layout::Layout;
use crate::mosaic::MosaicParams;
use crate::photo_set::PhotoSet;
use ravec_mosaic::{ByHand, TilePhoto};
use std::path::PathBuf;

/// A tile that has exactly this photo, whatever the limits on repeats say.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pin {
    /// Column of the tile in the grid, from 0.
    pub col: usize,
    /// Row of the tile in the grid, from 0.
    pub row: usize,
    /// The photo, by its path in the catalogue.
    pub photo: PathBuf,
}

/// A photo that is not used, nor a near-duplicate of it. Tiles to which they are pinned have them all the same.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ban {
    /// Column and row of the tile that must not have it; none for all tiles.
    pub tile: Option<[usize; 2]>,
    /// The photo, by its path in the catalogue.
    pub photo: PathBuf,
}

/// [`Pin`]s and [`Ban`]s by numbers.
#[derive(Debug, Default)]
pub(crate) struct Resolved {
    pub by_hand: ByHand,
    /// Photos that are banned everywhere.
    pub banned: Vec<u32>,
}

/// Finds the tiles and photos that are set by hand.
pub(crate) fn resolve(
    set: &PhotoSet,
    layout: &Layout,
    params: &MosaicParams,
) -> Result<Resolved, CatalogueError> {
    let of_tile = params.bans.iter().find(|ban| ban.tile.is_some());
    if params.adaptive.is_some() && (of_tile.is_some() || !params.pins.is_empty()) {
        return Err(CatalogueError::NoGrid);
    }
    let tile = |col: usize, row: usize| {
        if col < layout.columns && row < layout.rows {
            return Ok(row * layout.columns + col);
        }
        Err(CatalogueError::NoSuchTile {
            col,
            row,
            columns: layout.columns,
            rows: layout.rows,
        })
    };
    let mut found = Resolved::default();
    for (at, pin) in params.pins.iter().enumerate() {
        let (col, row) = (pin.col, pin.row);
        let tile = tile(col, row)?;
        let photo = set.find(&pin.photo)?.map_err(|reason| {
            let photo = pin.photo.clone();
            CatalogueError::CannotPin { photo, reason }
        })?;
        let earlier = &found.by_hand.pins[..at];
        if earlier
            .iter()
            .any(|other| other.tile == tile && other.photo != photo)
        {
            return Err(CatalogueError::PinnedTwice { col, row });
        }
        found.by_hand.pins.push(TilePhoto { tile, photo });
    }
    for ban in &params.bans {
        let at = ban.tile.map(|[col, row]| tile(col, row)).transpose()?;
        // a photo that cannot be used anyway need not be banned
        let Ok(photo) = set.find(&ban.photo)? else {
            continue;
        };
        let mut pins = found.by_hand.pins.iter();
        if pins.any(|pin| pin.photo == photo && at.is_none_or(|tile| tile == pin.tile)) {
            let photo = ban.photo.clone();
            return Err(CatalogueError::PinnedAndBanned { photo });
        }
        match at {
            Some(tile) => found.by_hand.bans.push(TilePhoto { tile, photo }),
            None => found.banned.push(photo),
        }
    }
    Ok(found)
}
