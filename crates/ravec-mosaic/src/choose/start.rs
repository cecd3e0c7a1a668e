//! A first photo for each tile, which the improvement starts from.

use super::Problem;
use crate::fill::fill;
use crate::optimal::cheapest;
use crate::rules::{ChooseError, Placement};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Places a photo on each tile that has none.
pub(super) fn place_rest(
    problem: &mut Problem<'_>,
    placement: &mut Placement<'_>,
    progress: &Progress,
) -> Result<(), ChooseError> {
    let use_all = placement.rules.use_all;
    if use_all {
        use_each_once(problem, placement, progress)?;
    }
    match greedy(problem, placement, progress) {
        Err(error @ ChooseError::TooNear { .. }) => {
            if fill(problem, placement, progress)? {
                Ok(())
            } else {
                Err(error)
            }
        }
        // a photo may be banned at the tiles that were left for it
        Ok(()) if use_all && unused(placement).next().is_some() => {
            if fill(problem, placement, progress)? {
                Ok(())
            } else {
                Err(ChooseError::NotAllUsed)
            }
        }
        done => done,
    }
}

/// The groups that are not banned and that no tile has.
fn unused<'a>(placement: &'a Placement<'_>) -> impl Iterator<Item = usize> + 'a {
    (0..placement.different()).filter(|&group| {
        placement.tiles_of(group).is_empty() && !placement.is_banned_everywhere(group)
    })
}

/// The cheapest assignment under limits on numbers alone, around the tiles that are pinned.
pub(super) fn cheapest_of_groups(
    problem: &Problem<'_>,
    placement: &Placement<'_>,
    progress: &Progress,
) -> Result<Vec<u32>, ChooseError> {
    let (photos, hand, rules) = (problem.photos, &problem.hand, placement.rules);
    let groups: Vec<usize> = (0..photos.different)
        .filter(|&group| !hand.bans_everywhere(group))
        .collect();
    let mut column = vec![None; photos.different];
    for (number, &group) in groups.iter().enumerate() {
        column[group] = Some(number);
    }
    let free: Vec<usize> = (0..problem.tiles.len())
        .filter(|&tile| hand.pinned(tile).is_none())
        .collect();
    let mut chosen: Vec<u32> = (0..problem.tiles.len())
        .map(|tile| hand.pinned(tile).unwrap_or(0))
        .collect();
    if free.is_empty() {
        return Ok(chosen);
    }
    // a free tile has a candidate, and so there is a group
    let columns = groups.len();
    let mut costs = vec![f32::INFINITY; free.len() * columns];
    let mut best = vec![0u32; free.len() * columns];
    costs
        .par_chunks_exact_mut(columns)
        .zip(best.par_chunks_exact_mut(columns))
        .zip(&free)
        .try_for_each(|((costs, best), &tile)| {
            progress.check()?;
            for (photo, cost) in problem.costs(tile).into_iter().enumerate() {
                let Some(column) = column[photos.groups[photo] as usize] else {
                    continue;
                };
                if cost < costs[column] {
                    costs[column] = cost;
                    best[column] = photo as u32;
                }
            }
            Ok::<(), Cancelled>(())
        })?;
    if hand.has_bans_of_tiles() {
        // more than all other costs together, so that it is paid only where nothing else is left
        let largest = costs.iter().fold(0.0f32, |most, &cost| most.max(cost));
        let forbidden = (largest + 1.0) * (free.len() + 1) as f32;
        for (costs, &tile) in costs.chunks_exact_mut(columns).zip(&free) {
            for (cost, &group) in costs.iter_mut().zip(&groups) {
                if hand.bans(tile, group) {
                    *cost = forbidden;
                }
            }
        }
    }
    let most = rules.max_uses.unwrap_or(u32::MAX);
    let uses = |&group: &usize| placement.tiles_of(group).len() as u32;
    let capacity: Vec<u32> = groups
        .iter()
        .map(|group| most.saturating_sub(uses(group)).min(free.len() as u32))
        .collect();
    let required: Vec<bool> = groups
        .iter()
        .map(|group| rules.use_all && uses(group) == 0)
        .collect();
    let found = cheapest(&costs, &capacity, &required, progress)?;
    for (row, (&tile, &number)) in free.iter().zip(&found).enumerate() {
        if hand.bans(tile, groups[number as usize]) {
            return Err(if rules.use_all {
                ChooseError::NotAllUsed
            } else {
                ChooseError::NothingLeft { tile }
            });
        }
        chosen[tile] = best[row * columns + number as usize];
    }
    Ok(chosen)
}

/// A pair of tile and photo; the cheapest is the greatest, as heaps have it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pair {
    cost: f32,
    tile: usize,
    rank: usize,
}

impl Eq for Pair {}

impl PartialOrd for Pair {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Pair {
    fn cmp(&self, other: &Self) -> Ordering {
        let cost = other.cost.total_cmp(&self.cost);
        cost.then((other.tile, other.rank).cmp(&(self.tile, self.rank)))
    }
}

/// Fills the empty tiles, the cheapest pair of tile and photo first.
fn greedy(
    problem: &mut Problem<'_>,
    placement: &mut Placement<'_>,
    progress: &Progress,
) -> Result<(), ChooseError> {
    let mut heap: BinaryHeap<Pair> = (0..problem.tiles.len())
        .filter(|&tile| placement.photo(tile).is_none())
        .filter_map(|tile| {
            problem.candidates[tile].first().map(|near| Pair {
                cost: near.distance_sq,
                tile,
                rank: 0,
            })
        })
        .collect();
    while let Some(Pair { tile, rank, .. }) = heap.pop() {
        progress.check()?;
        let photo = problem.candidates[tile][rank].photo;
        if placement.allows(tile, photo) {
            placement.put(tile, Some(photo));
            continue;
        }
        if rank + 1 == problem.candidates[tile].len() {
            let all = problem.everything(tile);
            if all.len() <= rank + 1 {
                return Err(ChooseError::TooNear {
                    different: problem.photos.different,
                    distance: placement.rules.min_repeat_distance,
                });
            }
            problem.candidates[tile] = all;
            // the longer list may have another photo of a group first: begin anew
            heap.push(Pair {
                cost: problem.candidates[tile][0].distance_sq,
                tile,
                rank: 0,
            });
            continue;
        }
        heap.push(Pair {
            cost: problem.candidates[tile][rank + 1].distance_sq,
            tile,
            rank: rank + 1,
        });
    }
    Ok(())
}

/// Gives each group of photos one tile, the cheapest pair first.
fn use_each_once(
    problem: &Problem<'_>,
    placement: &mut Placement<'_>,
    progress: &Progress,
) -> Result<(), ChooseError> {
    /// Cheapest tiles that are remembered for each group; a group whose tiles are all taken looks at all that are free.
    const REMEMBERED: usize = 8;
    let photos = problem.photos;
    let mut wanted: Vec<Vec<(f32, u32, u32)>> = vec![Vec::new(); photos.different];
    for tile in 0..problem.tiles.len() {
        progress.check()?;
        if placement.is_pinned(tile) {
            continue;
        }
        for (photo, cost) in problem.costs(tile).into_iter().enumerate() {
            let group = photos.groups[photo] as usize;
            if problem.hand.bans(tile, group) {
                continue;
            }
            let list = &mut wanted[group];
            if list.len() == REMEMBERED && list.last().is_some_and(|last| last.0 <= cost) {
                continue;
            }
            list.truncate(REMEMBERED - 1);
            let place = list.partition_point(|other| other.0 <= cost);
            list.insert(place, (cost, tile as u32, photo as u32));
        }
    }
    let mut pairs: Vec<(f32, u32, u32)> = wanted.into_iter().flatten().collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    for (_, tile, photo) in pairs {
        let unused = placement.tiles_of(placement.group(photo)).is_empty();
        if unused && placement.photo(tile as usize).is_none() {
            placement.put(tile as usize, Some(photo));
        }
    }
    for photo in 0..photos.groups.len() as u32 {
        let group = placement.group(photo);
        if !placement.tiles_of(group).is_empty() {
            continue;
        }
        progress.check()?;
        let free = (0..problem.tiles.len())
            .filter(|&tile| placement.photo(tile).is_none() && !problem.hand.bans(tile, group));
        let best = free
            .map(|tile| (problem.cost(tile, photo), tile))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // there are at least as many tiles as groups, which the caller has checked, but bans may leave none
        if let Some((_, tile)) = best {
            placement.put(tile, Some(photo));
        }
    }
    Ok(())
}
