//! Rules of a mosaic, and the record of the photos in use that enforces them.

use crate::by_hand::Hand;
use std::borrow::Cow;

/// Limits on how often and how near to each other a photo may be used.
///
/// They hold for groups of near-duplicates: two photos that cannot be distinguished are one photo to the eye.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// The most uses of a photo, at least 1; none for any number.
    pub max_uses: Option<u32>,
    /// The least distance between the centers of two tiles with the same photo, in tile sides; 0 and 1 forbid nothing.
    pub min_repeat_distance: f64,
    /// Every photo is used at least once.
    pub use_all: bool,
}

impl Default for Rules {
    /// Any number of uses, repeats at least 5 tiles apart, no photo that must be used.
    fn default() -> Self {
        Self {
            max_uses: None,
            min_repeat_distance: 5.0,
            use_all: false,
        }
    }
}

/// Why photos cannot be put into tiles.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ChooseError {
    /// There is no photo.
    #[error("there is no photo to choose from")]
    NoPhotos,
    /// All uses of all photos together are fewer than the tiles.
    #[error(
        "{tiles} tiles need more than {different} different photos used at most {max_uses} times each: allow more uses, or ask \
         for fewer tiles"
    )]
    TooFew {
        /// Tiles to be filled.
        tiles: usize,
        /// Groups of near-duplicates.
        different: usize,
        /// [`Rules::max_uses`].
        max_uses: u32,
    },
    /// There are more photos that must be used than tiles.
    #[error("{different} different photos cannot all be used in {tiles} tiles: ask for more tiles")]
    TooMany {
        /// Tiles to be filled.
        tiles: usize,
        /// Groups of near-duplicates.
        different: usize,
    },
    /// Some tile has no photo left that is far enough from its repeats.
    #[error(
        "too few photos ({different} that differ) to keep repeats {distance} tiles apart: lower the distance, or add photos"
    )]
    TooNear {
        /// Groups of near-duplicates.
        different: usize,
        /// [`Rules::min_repeat_distance`].
        distance: f64,
    },
    /// No photo is left for a tile.
    #[error("no photo is left for tile {tile} beside those that are banned or used up: lift a ban")]
    NothingLeft {
        /// Number of the tile.
        tile: usize,
    },
    /// Bans leave no way to use all photos.
    #[error("not all photos can be used under these bans: lift a ban, or do not use all photos")]
    NotAllUsed,
    /// A photo is set by hand for a tile that does not exist.
    #[error("there is no tile {tile}: there are {tiles}, counted from 0")]
    NoSuchTile {
        /// Number of the tile.
        tile: usize,
        /// Tiles in all.
        tiles: usize,
    },
    /// A photo that does not exist is set by hand.
    #[error("there is no photo {photo}: there are {photos}, counted from 0")]
    NoSuchPhoto {
        /// Number of the photo.
        photo: u32,
        /// Photos in all.
        photos: usize,
    },
    /// Two photos are pinned to one tile.
    #[error("two photos are pinned to tile {tile}: remove one of the pins")]
    PinnedTwice {
        /// Number of the tile.
        tile: usize,
    },
    /// A photo is pinned to a tile at which it is banned.
    #[error("one photo is both pinned to tile {tile} and banned there: remove the pin or the ban")]
    PinnedAndBanned {
        /// Number of the tile.
        tile: usize,
    },
    /// The caller cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] ravec_progress::Cancelled),
}

/// The photo in each tile, and the tiles of each group of photos.
#[derive(Debug, Clone)]
pub(crate) struct Placement<'a> {
    pub rules: Rules,
    centers: &'a [[f64; 2]],
    groups: &'a [u32],
    photos: Vec<Option<u32>>,
    /// The tiles of each group.
    tiles: Vec<Vec<u32>>,
    hand: Cow<'a, Hand>,
}

impl<'a> Placement<'a> {
    pub fn new(rules: Rules, centers: &'a [[f64; 2]], groups: &'a [u32], different: usize) -> Self {
        Self {
            rules,
            centers,
            groups,
            photos: vec![None; centers.len()],
            tiles: vec![Vec::new(); different],
            hand: Cow::Owned(Hand::nothing(different)),
        }
    }

    /// The same placement, in which photos that are banned are not allowed, and pinned tiles do not give up their photos.
    pub fn with(self, hand: &'a Hand) -> Self {
        Self {
            hand: Cow::Borrowed(hand),
            ..self
        }
    }

    pub fn different(&self) -> usize {
        self.tiles.len()
    }

    pub fn is_pinned(&self, tile: usize) -> bool {
        self.hand.pinned(tile).is_some()
    }

    pub fn is_banned_everywhere(&self, group: usize) -> bool {
        self.hand.bans_everywhere(group)
    }

    pub fn group(&self, photo: u32) -> usize {
        self.groups[photo as usize] as usize
    }

    pub fn photo(&self, tile: usize) -> Option<u32> {
        self.photos[tile]
    }

    pub fn tiles_of(&self, group: usize) -> &[u32] {
        &self.tiles[group]
    }

    /// Puts a photo into a tile, or takes it out.
    pub fn put(&mut self, tile: usize, photo: Option<u32>) {
        if let Some(old) = self.photos[tile] {
            let group = self.group(old);
            self.tiles[group].retain(|&other| other as usize != tile);
        }
        if let Some(new) = photo {
            let group = self.group(new);
            self.tiles[group].push(tile as u32);
        }
        self.photos[tile] = photo;
    }

    pub fn too_near(&self, a: usize, b: usize) -> bool {
        let [p, q] = [self.centers[a], self.centers[b]];
        let limit = self.rules.min_repeat_distance;
        // centers of a grid have exact distances; the slack is for those that are not
        (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) < limit * limit * (1.0 - 1e-9)
    }

    /// Returns `true` if a photo may be put into a tile, in place of what is there.
    pub fn allows(&self, tile: usize, photo: u32) -> bool {
        let group = self.group(photo);
        if self.is_pinned(tile) || self.hand.bans(tile, group) {
            return false;
        }
        let others = || {
            self.tiles[group]
                .iter()
                .filter(|&&other| other as usize != tile)
        };
        self.rules
            .max_uses
            .is_none_or(|most| others().count() < most as usize)
            && others().all(|&other| !self.too_near(tile, other as usize))
    }

    /// Returns `true` if the photo of a tile may be taken away.
    pub fn releases(&self, tile: usize) -> bool {
        !self.rules.use_all
            || self.photos[tile].is_none_or(|photo| self.tiles[self.group(photo)].len() > 1)
    }

    /// The tiles that would have to give up a photo of this group, if `tile` had it: none if there are too many ways, or if one
    /// that is pinned is in the way.
    pub fn in_the_way(&self, tile: usize, photo: u32) -> Vec<u32> {
        let tiles = &self.tiles[self.group(photo)];
        let others = || {
            tiles
                .iter()
                .copied()
                .filter(|&other| other as usize != tile)
        };
        let near: Vec<u32> = others()
            .filter(|&other| self.too_near(tile, other as usize))
            .collect();
        let mut found = match near.len() {
            0 if others().count() <= 4 => others().collect(),
            1 => near,
            _ => Vec::new(),
        };
        found.retain(|&other| !self.is_pinned(other as usize));
        found
    }
}

/// The places where a mosaic does not keep to its rules: pairs of tiles that are too near for their photos, and groups that
/// are used too often or not at all. `groups` has the group of each photo, from 0 without gaps.
pub fn violations(
    rules: &Rules,
    centers: &[[f64; 2]],
    photos: &[u32],
    groups: &[u32],
) -> Vec<String> {
    let different = groups.iter().max().map_or(0, |&group| group as usize + 1);
    let mut placement = Placement::new(*rules, centers, groups, different);
    for (tile, &photo) in photos.iter().enumerate() {
        placement.put(tile, Some(photo));
    }
    let mut found = Vec::new();
    for group in 0..different {
        let tiles = placement.tiles_of(group);
        let uses = tiles.len();
        if rules.max_uses.is_some_and(|most| uses > most as usize) {
            found.push(format!("group {group} is used {uses} times"));
        }
        if rules.use_all && uses == 0 {
            found.push(format!("group {group} is not used"));
        }
        for (at, &a) in tiles.iter().enumerate() {
            for &b in &tiles[..at] {
                if placement.too_near(a as usize, b as usize) {
                    found.push(format!("tiles {a} and {b} are too near"));
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_broken_rule_is_named() {
        let centers = [[0.0, 0.0], [3.0, 4.0], [9.0, 0.0]];
        let rules = Rules {
            max_uses: Some(2),
            min_repeat_distance: 5.0,
            use_all: true,
        };
        // photos 0 and 2 are near-duplicates
        let groups = [0, 1, 0];
        assert_eq!(violations(&rules, &centers, &[0, 2, 1], &groups), [""; 0]);
        assert_eq!(
            violations(&rules, &centers, &[0, 2, 0], &groups),
            ["group 0 is used 3 times", "group 1 is not used"]
        );
        let wider = Rules {
            min_repeat_distance: 5.1,
            ..rules
        };
        assert_eq!(
            violations(&wider, &centers, &[0, 2, 1], &groups),
            ["tiles 1 and 0 are too near"]
        );
    }
}
