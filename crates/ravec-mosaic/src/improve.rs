//! Photos change and tiles swap as long as the energy falls.
//!
//! The energy is the sum of the squared distances of photos and tiles, and what the eye sees from afar (see the module `eye`).
//! Tiles are visited in order. Each looks at its candidates, the one with the least energy first, until none is better than
//! what it has. A photo that the rules allow is taken. If one other tile is in the way, that tile gets in return the photo
//! that is given up, or else the best of its own candidates, if both together lower the energy.
//!
//! Guarantees: the energy falls with each change, so this ends; rules that held before hold after. Does not guarantee: the
//! least energy.

use crate::choose::{ChooseParams, Problem};
use crate::eye::{Correlation, Modes, Pull, tile_cost};
use crate::rules::Placement;
use ravec_progress::{Cancelled, Progress};

/// Number of photos in use elsewhere that a tile tries to get in a round.
const TRIES: usize = 6;

/// Changes that lower the energy by less than this share of what a tile costs are not worth their while.
const WORTH: f32 = 1e-5;

/// Improves a placement in which all tiles have photos. Returns the number of changes.
pub(crate) fn improve(
    problem: &Problem<'_>,
    placement: &mut Placement<'_>,
    params: &ChooseParams,
    progress: &Progress,
) -> Result<usize, Cancelled> {
    let tiles = problem.tiles;
    let tiling = problem.tiling;
    // cells of half a tile are too coarse for a blur by a quarter of a tile, and cost 0.3 dB
    let cells = if tiling.units == 1 { 2 } else { 1 };
    let wanted: Vec<Modes> = (tiles.iter())
        .map(|tile| Modes::of(&tile.descriptor.quarters))
        .collect();
    let mut correlation = Correlation::new(tiling, cells, params.blend);
    let residuals: Vec<Modes> = (wanted.iter().enumerate())
        .map(|(tile, wanted)| match placement.photo(tile) {
            Some(photo) => problem.photos.modes(photo).less(wanted),
            None => wanted.less(wanted),
        })
        .collect();
    correlation.set(&residuals);
    let mut round = Round {
        problem,
        wanted,
        correlation,
        at_best: vec![false; tiles.len()],
    };
    let phase = progress.phase("improve", params.rounds as u64);
    let mut changes = 0;
    for _ in 0..params.rounds {
        let before = changes;
        for tile in 0..tiles.len() {
            progress.check()?;
            if placement.is_pinned(tile) || round.at_best[tile] {
                continue;
            }
            changes += usize::from(round.visit(tile, placement));
        }
        phase.advance(1);
        if changes == before {
            break;
        }
    }
    Ok(changes)
}

struct Round<'a> {
    problem: &'a Problem<'a>,
    /// The picture in each tile.
    wanted: Vec<Modes>,
    correlation: Correlation<'a>,
    /// Marks tiles that have no better candidate until a photo around them changes.
    at_best: Vec<bool>,
}

impl Round<'_> {
    /// The part of the energy that depends on the photo of a tile.
    fn energy(&self, tile: usize, photo: u32, cost: f32, pull: &Pull) -> f32 {
        let tile = &self.problem.tiles[tile];
        tile_cost(tile, self.problem.tiling.units, cost)
            + pull.energy(self.problem.photos.modes(photo))
    }

    /// Candidates of a tile with less energy than `limit`, in no order.
    fn below(&self, tile: usize, pull: &Pull, limit: f32) -> Vec<(f32, u32)> {
        let candidates = &self.problem.candidates[tile];
        // the nearest come first: from where the cost alone exceeds what the eye can make up for, none is below
        let highest = limit - pull.least();
        let units = self.problem.tiling.units;
        let end = candidates.partition_point(|near| {
            tile_cost(&self.problem.tiles[tile], units, near.distance_sq) <= highest
        });
        let energies = candidates[..end].iter().map(|near| {
            let energy = self.energy(tile, near.photo, near.distance_sq, pull);
            (energy, near.photo)
        });
        energies.filter(|&(energy, _)| energy < limit).collect()
    }

    /// The change of the residual where one photo takes the place of another.
    fn change(&self, from: u32, to: u32) -> Modes {
        let photos = self.problem.photos;
        photos.modes(to).less(photos.modes(from))
    }

    /// Shows another photo in a tile.
    fn show(&mut self, tile: usize, from: u32, to: u32) {
        let change = self.change(from, to);
        let at_best = &mut self.at_best;
        at_best[tile] = false;
        (self.correlation).change(tile, &change, |other| at_best[other] = false);
    }

    /// Gives a tile a better photo, if there is one.
    fn visit(&mut self, tile: usize, placement: &mut Placement<'_>) -> bool {
        let Some(current) = placement.photo(tile) else {
            return false;
        };
        let pull = self.correlation.pull(tile, self.wanted[tile]);
        let now = self.energy(tile, current, self.problem.cost(tile, current), &pull);
        let limit = now - WORTH * now.abs();
        let mut better = self.below(tile, &pull, limit);
        better.retain(|&(_, photo)| photo != current);
        if better.is_empty() {
            self.at_best[tile] = true;
            return false;
        }
        better.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut tries = 0;
        for (energy, photo) in better {
            let own_group = placement.group(photo) == placement.group(current);
            if placement.allows(tile, photo) && (own_group || placement.releases(tile)) {
                placement.put(tile, Some(photo));
                self.show(tile, current, photo);
                return true;
            }
            if tries == TRIES {
                continue;
            }
            tries += 1;
            for other in placement.in_the_way(tile, photo) {
                if self.exchange(tile, photo, other as usize, now - energy, placement) {
                    return true;
                }
            }
        }
        false
    }

    /// Takes `photo`, which lowers the energy by `gain`, for `tile`, and gives `other` something in return, if that lowers the
    /// energy altogether.
    fn exchange(
        &mut self,
        tile: usize,
        photo: u32,
        other: usize,
        gain: f32,
        placement: &mut Placement<'_>,
    ) -> bool {
        let (Some(current), Some(taken)) = (placement.photo(tile), placement.photo(other)) else {
            return false;
        };
        // the gain is that with the other tile as it is; from there on, what counts is how the other changes beside the new photo
        let change = self.change(current, photo);
        let pull = (self.correlation).pull_after(other, self.wanted[other], tile, &change);
        let shown = self.energy(other, taken, self.problem.cost(other, taken), &pull);
        placement.put(other, None);
        placement.put(tile, None);
        let mut options = self.below(other, &pull, shown + gain);
        let cost = self.problem.cost(other, current);
        options.push((self.energy(other, current, cost, &pull), current));
        options.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        placement.put(tile, Some(photo));
        for (energy, option) in options {
            if energy - shown >= gain {
                break;
            }
            if !placement.allows(other, option) {
                continue;
            }
            placement.put(other, Some(option));
            let used = |photo: u32| !placement.tiles_of(placement.group(photo)).is_empty();
            if !placement.rules.use_all || (used(current) && used(taken)) {
                self.show(tile, current, photo);
                self.show(other, taken, option);
                return true;
            }
            placement.put(other, None);
        }
        placement.put(tile, Some(current));
        placement.put(other, Some(taken));
        false
    }
}
