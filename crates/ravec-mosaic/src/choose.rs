//! Assignment of photos to tiles.
//!
//! 1. *Candidates*: the nearest photos of each tile, one of each group of near-duplicates.
//! 2. *Start*: the photos that the tiling brings along, where the rules allow them. Where there are none, under limits on
//!    numbers alone, the cheapest assignment if the problem fits; else greedy, the cheapest pair of
//!    tile and photo first; if that leads into a dead end and the problem is small, by search (see the module `fill`).
//! 3. *Improvement* (see the module `improve`): photos change, and tiles swap, as long as the energy falls.
//!
//! Tiles that are pinned have their photo from the start and keep it; photos that are banned are no candidates.
//!
//! Guarantees: the rules hold for all tiles that are not pinned; the same choice on any number of threads; of small problems (a few hundred tiles and a
//! dozen photos, or the other way round) an answer if there is one, unless the search for it runs out of steps. Does
//! not guarantee: the optimum under a repeat distance, which is a hard problem, as is to find any answer if photos
//! hardly suffice; the distance of the cost from a lower bound is reported.

mod params;
mod photos;
mod problem;
mod start;

pub use params::{ChooseParams, Features};
pub use photos::{Photos, TileSearch};
pub(crate) use problem::Problem;

use crate::by_hand::{ByHand, Hand};
use crate::improve;
use crate::rules::{ChooseError, Placement, Rules};
use crate::search::Near;
use crate::tiling::Tiling;
use ravec_progress::Progress;
use start::{cheapest_of_groups, place_rest};

/// Assignment of photos to tiles, and its cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The photo of each tile.
    pub photos: Vec<u32>,
    /// The sum over tiles of the squared distances of photo and tile.
    pub cost: f64,
    /// A number that no choice under the rules can be below: the least cost without the repeat distance.
    pub bound: f64,
    /// Photos that changed and swaps that were made by the improvement.
    pub changes: usize,
}

/// The most costs that are held at once for the cheapest assignment: 64 MB.
const MAX_COSTS: usize = 16_000_000;

/// Chooses a photo for each tile.
///
/// # Errors
/// [`ChooseError`] if the rules cannot be kept, or were not found to be possible to keep.
pub fn choose(
    tiling: &Tiling,
    photos: &Photos,
    rules: &Rules,
    params: &ChooseParams,
    progress: &Progress,
) -> Result<Choice, ChooseError> {
    choose_by_hand(tiling, photos, rules, &ByHand::default(), params, progress)
}

/// Chooses a photo for each tile around those that are set by hand.
///
/// Tiles that are pinned have their photo, whatever the rules say. For all others the rules hold, also towards pinned tiles.
/// Without anything set by hand the choice is that of [`choose()`].
///
/// # Errors
/// [`ChooseError`] if what is set by hand makes no sense, or the rules cannot be kept or were not found to be possible to keep.
pub fn choose_by_hand(
    tiling: &Tiling,
    photos: &Photos,
    rules: &Rules,
    by_hand: &ByHand,
    params: &ChooseParams,
    progress: &Progress,
) -> Result<Choice, ChooseError> {
    choose_found(tiling, photos, rules, by_hand, params, None, progress)
}

/// Chooses as [`choose_by_hand`] does, with the answers to [`Photos::searches`] if they are known: the nearest photos of each tile
/// by [`PhotoIndex::nearest`](crate::PhotoIndex::nearest).
///
/// # Errors
/// As [`choose_by_hand`].
///
/// # Panics
/// If there are not as many answers as tiles.
pub fn choose_found(
    tiling: &Tiling,
    photos: &Photos,
    rules: &Rules,
    by_hand: &ByHand,
    params: &ChooseParams,
    found: Option<Vec<Vec<Near>>>,
    progress: &Progress,
) -> Result<Choice, ChooseError> {
    let tiles = &tiling.tiles[..];
    let different = photos.different;
    if photos.is_empty() {
        return Err(ChooseError::NoPhotos);
    }
    let hand = Hand::new(by_hand, tiles.len(), photos)?;
    check_counts(tiles.len(), photos, rules, &hand)?;
    if tiles.is_empty() {
        return Ok(Choice {
            photos: Vec::new(),
            cost: 0.0,
            bound: 0.0,
            changes: 0,
        });
    }
    let count = params.candidates.max(1);
    let mut problem = Problem::new(tiling, photos, hand);
    problem.find_candidates(found, count, progress)?;
    let hand = problem.hand.clone();
    let centers = tiling.centers();
    let mut placement = Placement::new(*rules, &centers, &photos.groups, different).with(&hand);
    for (tile, photo) in hand.pins() {
        placement.put(tile, Some(photo));
    }
    let counted = rules.max_uses.is_some() || rules.use_all;
    let spread = rules.min_repeat_distance > 1.0;
    let mut bound = problem.least_cost();
    if counted && tiles.len().saturating_mul(different) <= MAX_COSTS {
        let best = cheapest_of_groups(&problem, &placement, progress)?;
        bound = problem.cost_of(&best);
        if !spread {
            for (tile, &photo) in best.iter().enumerate() {
                placement.put(tile, Some(photo));
            }
        }
    }
    if !rules.use_all {
        for (tile, &photo) in tiling.start.iter().enumerate() {
            if placement.photo(tile).is_none() && placement.allows(tile, photo) {
                placement.put(tile, Some(photo));
            }
        }
    }
    let unplaced = (0..tiles.len()).any(|tile| placement.photo(tile).is_none());
    if unplaced {
        place_rest(&mut problem, &mut placement, progress)?;
    }
    let settled = counted && !spread && !unplaced && params.blend <= 0.0;
    let changes = if settled {
        0
    } else {
        improve::improve(&problem, &mut placement, params, progress)?
    };
    // every tile has a photo: greedy gives one or fails, and improvement exchanges
    let chosen: Vec<u32> = (0..tiles.len())
        .filter_map(|tile| placement.photo(tile))
        .collect();
    Ok(Choice {
        cost: problem.cost_of(&chosen),
        photos: chosen,
        bound,
        changes,
    })
}

/// Checks that there are as many photos as the rules ask for.
fn check_counts(
    tiles: usize,
    photos: &Photos,
    rules: &Rules,
    hand: &Hand,
) -> Result<(), ChooseError> {
    let allowed = photos.allowed();
    let mut pinned = vec![0usize; photos.different];
    for (_, photo) in hand.pins() {
        pinned[photos.group(photo)] += 1;
    }
    let free = tiles - hand.pins().count();
    let groups = || (0..photos.different).filter(|&group| !hand.bans_everywhere(group));
    if let Some(max_uses) = rules.max_uses {
        let left = groups().map(|group| (max_uses as usize).saturating_sub(pinned[group]));
        if left.fold(0, usize::saturating_add) < free {
            return Err(ChooseError::TooFew {
                tiles,
                different: allowed,
                max_uses,
            });
        }
    }
    if rules.use_all && groups().filter(|&group| pinned[group] == 0).count() > free {
        return Err(ChooseError::TooMany {
            tiles,
            different: allowed,
        });
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests;
