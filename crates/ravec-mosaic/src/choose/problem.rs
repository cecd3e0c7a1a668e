//! The tiles with their candidates.

use super::Photos;
use crate::by_hand::Hand;
use crate::search::{Near, PhotoIndex};
use crate::tiling::{Tile, Tiling};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// The tiles with their candidates, and the photos.
pub(crate) struct Problem<'a> {
    pub tiling: &'a Tiling,
    pub tiles: &'a [Tile],
    pub photos: &'a Photos,
    pub(super) queries: Vec<Vec<f32>>,
    pub hand: Hand,
    pub candidates: Vec<Vec<Near>>,
}

impl Problem<'_> {
    pub fn cost(&self, tile: usize, photo: u32) -> f32 {
        self.index(tile).distance_sq(&self.queries[tile], photo)
    }

    fn index(&self, tile: usize) -> &PhotoIndex {
        &self.photos.class(&self.tiles[tile]).index
    }

    /// The costs of all photos by their numbers.
    pub(super) fn costs(&self, tile: usize) -> Vec<f32> {
        self.index(tile).all(&self.queries[tile])
    }

    /// All groups that a tile may have by their nearest photo, the nearest first.
    pub fn everything(&self, tile: usize) -> Vec<Near> {
        self.nearest(tile, self.index(tile).len())
    }

    /// The `count` nearest photos that a tile may have, one of each group of near-duplicates.
    pub(super) fn nearest(&self, tile: usize, count: usize) -> Vec<Near> {
        let banned = self.photos.banned_at(&self.hand, tile);
        let near = self
            .index(tile)
            .nearest(&self.queries[tile], count.saturating_add(banned));
        self.allowed(tile, near, count)
    }

    /// The first `count` photos that a tile may have, one of each group of near-duplicates.
    pub(super) fn allowed(&self, tile: usize, mut near: Vec<Near>, count: usize) -> Vec<Near> {
        let (photos, hand) = (self.photos, &self.hand);
        near.retain(|near| !hand.bans(tile, photos.group(near.photo)));
        near.truncate(count);
        photos.one_of_each_group(near)
    }

    /// The `count` nearest photos that each tile may have.
    pub(super) fn candidates(
        &self,
        count: usize,
        progress: &Progress,
    ) -> Result<Vec<Vec<Near>>, Cancelled> {
        let phase = progress.phase("search", self.tiles.len() as u64);
        (0..self.tiles.len())
            .into_par_iter()
            .map(|tile| {
                progress.check()?;
                let near = self.nearest(tile, count);
                phase.advance(1);
                Ok(near)
            })
            .collect()
    }
}
