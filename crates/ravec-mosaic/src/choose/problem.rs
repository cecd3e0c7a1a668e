//! The tiles with their candidates.

use super::Photos;
use crate::by_hand::Hand;
use crate::rules::ChooseError;
use crate::search::{Near, PhotoIndex};
use crate::tiling::{Tile, Tiling};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// The tiles with their candidates, and the photos.
pub(crate) struct Problem<'a> {
    pub tiling: &'a Tiling,
    pub tiles: &'a [Tile],
    pub photos: &'a Photos,
    queries: Vec<Vec<f32>>,
    pub hand: Hand,
    pub candidates: Vec<Vec<Near>>,
}

impl<'a> Problem<'a> {
    /// Tiles without candidates yet.
    pub(super) fn new(tiling: &'a Tiling, photos: &'a Photos, hand: Hand) -> Self {
        let tiles = &tiling.tiles[..];
        let queries = tiles
            .iter()
            .map(|tile| photos.class(tile).vector(&tile.descriptor))
            .collect();
        Self {
            tiling,
            tiles,
            photos,
            queries,
            hand,
            candidates: Vec::new(),
        }
    }

    /// Finds the `count` nearest photos that each tile may have, or takes those that were found.
    pub(super) fn find_candidates(
        &mut self,
        found: Option<Vec<Vec<Near>>>,
        count: usize,
        progress: &Progress,
    ) -> Result<(), ChooseError> {
        self.candidates = match found {
            None => self.candidates(count, progress)?,
            Some(found) => {
                assert_eq!(found.len(), self.tiles.len(), "each tile has an answer");
                let found = found.into_par_iter().enumerate();
                found
                    .map(|(tile, near)| self.allowed(tile, near, count))
                    .collect()
            }
        };
        let without = (0..self.tiles.len())
            .find(|&tile| self.hand.pinned(tile).is_none() && self.candidates[tile].is_empty());
        match without {
            Some(tile) => Err(ChooseError::NothingLeft { tile }),
            None => Ok(()),
        }
    }

    /// The sum of the costs of the photos of all tiles.
    pub(super) fn cost_of(&self, photos: &[u32]) -> f64 {
        let costs = photos.iter().enumerate();
        costs
            .map(|(tile, &photo)| f64::from(self.cost(tile, photo)))
            .sum()
    }

    /// The sum of the costs of the nearest candidates, and of the photos that are pinned.
    pub(super) fn least_cost(&self) -> f64 {
        let tiles = self.candidates.iter().enumerate();
        let costs = tiles.filter_map(|(tile, near)| match self.hand.pinned(tile) {
            Some(photo) => Some(self.cost(tile, photo)),
            None => near.first().map(|near| near.distance_sq),
        });
        costs.map(f64::from).sum()
    }

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
    fn nearest(&self, tile: usize, count: usize) -> Vec<Near> {
        let banned = self.photos.banned_at(&self.hand, tile);
        let near = self
            .index(tile)
            .nearest(&self.queries[tile], count.saturating_add(banned));
        self.allowed(tile, near, count)
    }

    /// The first `count` photos that a tile may have, one of each group of near-duplicates.
    fn allowed(&self, tile: usize, mut near: Vec<Near>, count: usize) -> Vec<Near> {
        let (photos, hand) = (self.photos, &self.hand);
        near.retain(|near| !hand.bans(tile, photos.group(near.photo)));
        near.truncate(count);
        photos.one_of_each_group(near)
    }

    /// The `count` nearest photos that each tile may have.
    fn candidates(&self, count: usize, progress: &Progress) -> Result<Vec<Vec<Near>>, Cancelled> {
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
