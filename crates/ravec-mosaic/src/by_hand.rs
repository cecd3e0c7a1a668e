//! Photos of single tiles that are set by hand.

use crate::choose::Photos;
use crate::rules::ChooseError;
use std::collections::HashSet;

/// A photo at a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TilePhoto {
    /// Number of the tile in the tiling.
    pub tile: usize,
    /// Number of the photo.
    pub photo: u32,
}

/// Photos that are set by hand.
///
/// Photos that are banned everywhere belong to the photos (see [`Photos::ban`]).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ByHand {
    /// Tiles that have exactly this photo, also a banned one. They keep no limits among themselves, and count for those of all
    /// other tiles.
    pub pins: Vec<TilePhoto>,
    /// Tiles that have neither this photo nor a near-duplicate of it.
    pub bans: Vec<TilePhoto>,
}

/// The decisions of [`ByHand`] by tiles and groups of near-duplicates.
#[derive(Debug, Clone)]
pub(crate) struct Hand {
    /// The photo that is pinned to each tile; empty without pins.
    pinned: Vec<Option<u32>>,
    /// Tiles with the groups that they do not have.
    banned: HashSet<(usize, usize)>,
    /// The groups that no tile has unless it is pinned.
    banned_everywhere: Vec<bool>,
}

impl Hand {
    /// # Errors
    /// [`ChooseError::NoSuchTile`], [`ChooseError::NoSuchPhoto`], [`ChooseError::PinnedTwice`], [`ChooseError::PinnedAndBanned`].
    pub fn new(by_hand: &ByHand, tiles: usize, photos: &Photos) -> Result<Self, ChooseError> {
        for &TilePhoto { tile, photo } in by_hand.pins.iter().chain(&by_hand.bans) {
            if tile >= tiles {
                return Err(ChooseError::NoSuchTile { tile, tiles });
            }
            if photo as usize >= photos.len() {
                let photos = photos.len();
                return Err(ChooseError::NoSuchPhoto { photo, photos });
            }
        }
        let bans = by_hand.bans.iter();
        let banned: HashSet<(usize, usize)> = bans
            .map(|ban| (ban.tile, photos.group(ban.photo)))
            .collect();
        let mut pinned = Vec::new();
        for &pin in &by_hand.pins {
            pinned.resize(tiles, None);
            let TilePhoto { tile, photo } = pin;
            if pinned[tile].is_some_and(|other| other != photo) {
                return Err(ChooseError::PinnedTwice { tile });
            }
            if by_hand.bans.contains(&pin) {
                return Err(ChooseError::PinnedAndBanned { tile });
            }
            pinned[tile] = Some(photo);
        }
        Ok(Self {
            pinned,
            banned,
            banned_everywhere: photos.banned_groups().to_vec(),
        })
    }

    /// Nothing is set by hand.
    pub fn nothing(groups: usize) -> Self {
        Self {
            pinned: Vec::new(),
            banned: HashSet::new(),
            banned_everywhere: vec![false; groups],
        }
    }

    pub fn pinned(&self, tile: usize) -> Option<u32> {
        self.pinned.get(tile).copied().flatten()
    }

    /// The tiles that are pinned, with their photos.
    pub fn pins(&self) -> impl Iterator<Item = (usize, u32)> + '_ {
        let tiles = self.pinned.iter().enumerate();
        tiles.filter_map(|(tile, photo)| Some((tile, (*photo)?)))
    }

    /// Returns `true` if a tile that is not pinned must not have a photo of a group.
    pub fn bans(&self, tile: usize, group: usize) -> bool {
        self.banned_everywhere[group] || self.banned.contains(&(tile, group))
    }

    /// The groups that are banned at a tile, without those that are banned everywhere.
    pub fn banned_at(&self, tile: usize) -> impl Iterator<Item = usize> + '_ {
        let here = self.banned.iter().filter(move |(at, _)| *at == tile);
        here.map(|&(_, group)| group)
            .filter(|&group| !self.banned_everywhere[group])
    }

    /// Returns `true` if no tile has a photo of a group unless it is pinned.
    pub fn bans_everywhere(&self, group: usize) -> bool {
        self.banned_everywhere[group]
    }

    /// Returns `true` if some photo is banned at single tiles.
    pub fn has_bans_of_tiles(&self) -> bool {
        !self.banned.is_empty()
    }
}

#[cfg(test)]
mod tests;
