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
use crate::eye::{Eye, Modes, Pull, residual, tile_cost};
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
    let mut round = Round {
        problem,
        cells,
        eye: Eye::new(
            2 * cells * tiling.columns,
            2 * cells * tiling.rows,
            cells * tiling.units,
            cells * tiles.iter().map(|tile| tile.side).max().unwrap_or(1),
            params.blend,
        ),
    };
    for tile in 0..tiles.len() {
        if let Some(photo) = placement.photo(tile) {
            round.show(tile, photo);
        }
    }
    let phase = progress.phase("improve", params.rounds as u64);
    let mut changes = 0;
    for _ in 0..params.rounds {
        let before = changes;
        for tile in 0..tiles.len() {
            progress.check()?;
            if placement.is_pinned(tile) {
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
    /// Cells along half a unit.
    cells: usize,
    eye: Eye,
}

impl Round<'_> {
    fn show(&mut self, tile: usize, photo: u32) {
        let tile = &self.problem.tiles[tile];
        let residual = residual(self.problem.photos.modes(photo), &tile.descriptor);
        self.eye.put(tile.footprint(self.cells), &residual);
    }

    /// The part of the energy that depends on the photo of a tile.
    fn energy(&self, tile: usize, photo: u32, cost: f32, pull: &Pull) -> f32 {
        let tile = &self.problem.tiles[tile];
        tile_cost(tile, self.problem.tiling.units, cost)
            + pull.energy(self.problem.photos.modes(photo))
    }

    fn lift(&mut self, tile: usize) -> Pull {
        let tile = &self.problem.tiles[tile];
        let wanted = Modes::of(&tile.descriptor.quarters);
        self.eye.lift(tile.footprint(self.cells), wanted)
    }

    /// Gives a tile a better photo, if there is one.
    fn visit(&mut self, tile: usize, placement: &mut Placement<'_>) -> bool {
        let Some(current) = placement.photo(tile) else {
            return false;
        };
        let pull = self.lift(tile);
        let now = self.energy(tile, current, self.problem.cost(tile, current), &pull);
        let limit = now - WORTH * now.abs();
        let mut better: Vec<(f32, u32)> = self.problem.candidates[tile]
            .iter()
            .map(|near| {
                (
                    self.energy(tile, near.photo, near.distance_sq, &pull),
                    near.photo,
                )
            })
            .filter(|&(energy, photo)| energy < limit && photo != current)
            .collect();
        better.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut tries = 0;
        for (energy, photo) in better {
            let own_group = placement.group(photo) == placement.group(current);
            if placement.allows(tile, photo) && (own_group || placement.releases(tile)) {
                placement.put(tile, Some(photo));
                self.show(tile, photo);
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
        self.show(tile, current);
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
        self.show(tile, photo);
        let pull = self.lift(other);
        let shown = self.energy(other, taken, self.problem.cost(other, taken), &pull);
        placement.put(other, None);
        placement.put(tile, None);
        let mut options: Vec<(f32, u32)> = self.problem.candidates[other]
            .iter()
            .map(|near| (near.distance_sq, near.photo))
            .collect();
        options.push((self.problem.cost(other, current), current));
        let mut options: Vec<(f32, u32)> = options
            .into_iter()
            .map(|(cost, photo)| (self.energy(other, photo, cost, &pull), photo))
            .collect();
        options.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
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
                self.show(other, option);
                return true;
            }
            placement.put(other, None);
        }
        placement.put(tile, Some(current));
        placement.put(other, Some(taken));
        self.show(other, taken);
        self.eye.put(
            self.problem.tiles[tile].footprint(self.cells),
            &[[0.0; 3]; 4],
        );
        false
    }
}
