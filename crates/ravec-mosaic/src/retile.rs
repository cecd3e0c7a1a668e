//! A tiling gets better: tiles of a part of the picture give way to others, if that lowers the energy.
//!
//! The energy is that of the choice of photos (see the module `improve`), with a price for each tile. The cost of a
//! tile depends on the photos that its neighbors have taken, and on how they make up for one another from afar. So it
//! is not estimated: new tiles get photos, and tiles and photos are kept together or not at all.
//!
//! 1. *Window*: the tiles that lie within a square are taken out; their energy and price are to be beaten.
//! 2. *Plan*: the free units are covered by tiles of random sides, always from the first free one in the order of reading. A
//!    plan that leaves a gap of one unit is dropped.
//! 3. *Refill*: each tile takes the photo with the least energy beside what is there; when all are there, each looks again,
//!    unless the refill is far behind the best.
//! 4. *Choice*: the best of a few refills stays if it beats what was there.
//! 5. *Price*: it falls while there are fewer tiles than allowed, and rises when there are as many.
//!
//! Guarantees: each unit is covered once; not more tiles than allowed if there were not at first. Does not guarantee: the
//! least energy. Cost: each tile is tried anew some thousand times; each
//! time takes a few thousand products, and the photos near to it, which are remembered.

use crate::choose::{ChooseParams, Photos};
use crate::descriptor::Frame;
use crate::eye::{Eye, Modes, Pull, residual, tile_cost};
use crate::search::Near;
use crate::tiling::{Tile, Tiling};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Oklab};
use std::collections::HashMap;

/// Units along a side of a window.
const WINDOW: usize = 11;

/// Units from a window to the next.
const STRIDE: usize = 4;

/// Refills of a window.
const TRIES: usize = 24;

/// Sides of new tiles, the more often the likelier. Larger ones show more of a photo than of the picture.
const SIDES: [usize; 10] = [2, 2, 3, 3, 3, 3, 4, 4, 5, 6];

/// Units along a side of the largest tile.
const MAX_SIDE: usize = 6;

/// Photos that a new tile chooses from.
const CANDIDATES: usize = 128;

/// The price of a tile at first, in the mean energy of a tile: that of an energy which falls as the number of tiles rises.
const PRICE: f32 = 1.0;

/// The factor by which the price changes from window to window.
const PRICE_STEP: f32 = 1.0005;

/// Strength of the view from afar, relative to the choice of photos after it. On three photos 3 is 0.1 dB better than 1
/// after a blur by half a tile.
const STRENGTH: f64 = 3.0;

/// Largest gap of a refill to the best, as a share, at which its tiles search again.
const HOPE: f32 = 0.2;

/// The share of its energy that a window must gain.
const WORTH: f32 = 1e-4;

/// Places whose photos are remembered: some 60 MB.
const REMEMBERED: usize = 40_000;

/// Side, column and row of a tile, in units.
pub(crate) type Place = (usize, usize, usize);

/// A tiling with a photo for each tile.
pub(crate) struct Tiled {
    pub tiles: Vec<Tile>,
    pub photos: Vec<u32>,
}

/// Inputs from which tiles are made.
#[derive(Clone, Copy)]
pub(crate) struct Source<'a> {
    pub picture: &'a Image<Oklab>,
    pub frame: Frame,
    pub degree: usize,
    pub photos: &'a Photos,
}

/// Improves a cover of the units of `empty` by tiles at `places`, and returns at most `most` tiles with their photos, row by
/// row.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
#[expect(
    clippy::too_many_arguments,
    reason = "the rules of the choice come one by one"
)]
pub(crate) fn retile(
    source: Source<'_>,
    empty: &Tiling,
    places: &[Place],
    most: usize,
    repeat_distance: f64,
    params: &ChooseParams,
    seed: u64,
    progress: &Progress,
) -> Result<Tiled, Cancelled> {
    let (columns, rows) = (empty.columns, empty.rows);
    if source.photos.allowed() == 0 {
        // the choice of photos will say what is missing
        let tile = |&place| Tile::of(source.picture, empty, source.frame, place, source.degree);
        return Ok(Tiled {
            tiles: places.iter().map(tile).collect(),
            photos: Vec::new(),
        });
    }
    let phase = progress.phase("tiles", params.tiling_rounds as u64);
    let mut mosaic = Mosaic::new(source, empty, repeat_distance, params);
    let mut energy = 0.0;
    for &place in places {
        progress.check()?;
        energy += mosaic.put(place);
    }
    let mut random = Random(seed ^ 0x9e37_79b9_7f4a_7c15);
    let mut price = PRICE * energy / places.len().max(1) as f32;
    for _ in 0..params.tiling_rounds {
        let begins = |units: usize, first: usize| (first..units + WINDOW).step_by(STRIDE);
        let (left, top) = (random.below(STRIDE), random.below(STRIDE));
        for bottom in begins(rows, top + 1) {
            for right in begins(columns, left + 1) {
                progress.check()?;
                let window = Window {
                    left: right.saturating_sub(WINDOW),
                    top: bottom.saturating_sub(WINDOW),
                    right: right.min(columns),
                    bottom: bottom.min(rows),
                };
                mosaic.refill(window, price, most, &mut random);
                if mosaic.tiles.len() < most {
                    price /= PRICE_STEP;
                } else {
                    price *= PRICE_STEP;
                }
            }
        }
        phase.advance(1);
    }
    let mut tiles: Vec<(Tile, u32)> = mosaic.tiles.into_values().collect();
    tiles.sort_unstable_by_key(|(tile, _)| (tile.row, tile.col));
    let (tiles, photos) = tiles.into_iter().unzip();
    Ok(Tiled { tiles, photos })
}

/// No tile.
const FREE: u32 = u32::MAX;

/// A part of the picture in units.
#[derive(Debug, Clone, Copy)]
struct Window {
    left: usize,
    top: usize,
    right: usize,
    bottom: usize,
}

impl Window {
    fn holds(&self, tile: &Tile) -> bool {
        self.left <= tile.col
            && self.top <= tile.row
            && tile.col + tile.side <= self.right
            && tile.row + tile.side <= self.bottom
    }
}

/// Tiles with photos, and what depends on them.
struct Mosaic<'a> {
    source: Source<'a>,
    empty: &'a Tiling,
    repeat_distance: f64,
    /// A tile for each place, and the photos near to it.
    known: HashMap<Place, (Tile, Vec<Near>)>,
    /// By their numbers.
    tiles: HashMap<u32, (Tile, u32)>,
    /// The number of the next tile.
    next: u32,
    /// The number of the tile on each unit.
    owner: Vec<u32>,
    /// The centers of the tiles that show a group of photos.
    shown: Vec<Vec<[f64; 2]>>,
    eye: Eye,
}

impl<'a> Mosaic<'a> {
    fn new(
        source: Source<'a>,
        empty: &'a Tiling,
        repeat_distance: f64,
        params: &ChooseParams,
    ) -> Self {
        let (columns, rows, units) = (empty.columns, empty.rows, empty.units);
        Self {
            source,
            empty,
            repeat_distance,
            known: HashMap::new(),
            tiles: HashMap::new(),
            next: 0,
            owner: vec![FREE; columns * rows],
            shown: vec![Vec::new(); source.photos.different()],
            eye: Eye::new(
                2 * columns,
                2 * rows,
                units,
                MAX_SIDE,
                STRENGTH * params.blend,
            ),
        }
    }

    /// Takes out the tiles of a window, and puts in others with less energy and price, or the same again.
    fn refill(&mut self, window: Window, price: f32, most: usize, random: &mut Random) {
        let mut numbers: Vec<u32> = (window.top..window.bottom)
            .flat_map(|row| &self.owner[row * self.empty.columns..][window.left..window.right])
            .copied()
            .collect();
        numbers.sort_unstable();
        numbers.dedup();
        numbers.retain(|number| window.holds(&self.tiles[number].0));
        let mut before = 0.0;
        let mut kept = Vec::with_capacity(numbers.len());
        for number in numbers {
            let (tile, photo, energy) = self.take(number);
            before += energy + price;
            kept.push((tile, photo));
        }
        let mut least = before - WORTH * before.abs();
        let allowed = kept.len().max(most.saturating_sub(self.tiles.len()));
        for _ in 0..TRIES {
            let Some(plan) = self.plan(window, random) else {
                continue;
            };
            if plan.len() > allowed {
                continue;
            }
            let mut energy = plan.len() as f32 * price;
            for &place in &plan {
                energy += self.put(place);
            }
            if energy < least + HOPE * least.abs() {
                for &place in &plan {
                    energy -= self.take(self.at(place)).2;
                    energy += self.put(place);
                }
            }
            let new: Vec<(Tile, u32)> = plan
                .iter()
                .map(|&place| {
                    let (tile, photo, _) = self.take(self.at(place));
                    (tile, photo)
                })
                .collect();
            if energy < least {
                least = energy;
                kept = new;
            }
        }
        for (tile, photo) in kept {
            self.insert(tile, photo);
        }
    }

    /// A cover of what is free in a window by tiles of random sides.
    fn plan(&self, window: Window, random: &mut Random) -> Option<Vec<Place>> {
        let (width, height) = (window.right - window.left, window.bottom - window.top);
        let mut free: Vec<bool> = (window.top..window.bottom)
            .flat_map(|row| &self.owner[row * self.empty.columns..][window.left..window.right])
            .map(|&owner| owner == FREE)
            .collect();
        let mut plan = Vec::new();
        while let Some(at) = free.iter().position(|&free| free) {
            let (col, row) = (at % width, at / width);
            let fits = |side: usize| {
                col + side <= width
                    && row + side <= height
                    && (row..row + side)
                        .all(|row| free[row * width + col..][..side].iter().all(|&free| free))
            };
            let drawn = SIDES[random.below(SIDES.len())];
            let side = (2..=drawn).rev().find(|&side| fits(side))?;
            for row in row..row + side {
                free[row * width + col..][..side].fill(false);
            }
            plan.push((side, window.left + col, window.top + row));
        }
        Some(plan)
    }

    /// The number of the tile at a place.
    fn at(&self, (_, col, row): Place) -> u32 {
        self.owner[row * self.empty.columns + col]
    }

    /// Puts a tile at a place that is free, with the photo of the least energy, and returns that.
    fn put(&mut self, place: Place) -> f32 {
        self.learn(place);
        let (tile, near) = &self.known[&place];
        let wanted = Modes::of(&tile.descriptor.quarters);
        let pull = self.eye.lift(tile.footprint(1), wanted);
        let center = self.empty.center(tile);
        let is_less = |a: (f32, u32), b: (f32, u32)| {
            let energies = a.0.total_cmp(&b.0);
            energies.then(a.1.cmp(&b.1)).is_lt()
        };
        let (mut least, mut allowed) = (None, None);
        let bound = pull.least();
        for near in near {
            // the nearest come first: from where the cost alone exceeds what the eye can make up for, none is better
            let cost = tile_cost(tile, self.empty.units, near.distance_sq);
            if allowed.is_some_and(|(energy, _)| cost + bound > energy) {
                break;
            }
            let energy = cost + pull.energy(self.source.photos.modes(near.photo));
            let option = (energy, near.photo);
            if least.is_none_or(|least| is_less(option, least)) {
                least = Some(option);
            }
            if allowed.is_none_or(|allowed| is_less(option, allowed))
                && self.allows(near.photo, center)
            {
                allowed = Some(option);
            }
        }
        // where all photos near the tile repeat, the rules are left to the choice that comes after
        let (energy, photo) = allowed.or(least).expect("not all photos are banned");
        let tile = tile.clone();
        self.insert(tile, photo);
        energy
    }

    /// Remembers what would be at a place.
    fn learn(&mut self, place: Place) {
        if self.known.contains_key(&place) {
            return;
        }
        if self.known.len() >= REMEMBERED {
            self.known.clear();
        }
        let Source {
            picture,
            frame,
            degree,
            photos,
        } = self.source;
        let tile = Tile::of(picture, self.empty, frame, place, degree);
        let near = photos.candidates(&tile, CANDIDATES);
        self.known.insert(place, (tile, near));
    }

    fn allows(&self, photo: u32, center: [f64; 2]) -> bool {
        let limit = self.repeat_distance * self.repeat_distance * (1.0 - 1e-9);
        let distance_sq =
            |other: &[f64; 2]| (other[0] - center[0]).powi(2) + (other[1] - center[1]).powi(2);
        self.shown[self.source.photos.group(photo)]
            .iter()
            .all(|other| distance_sq(other) >= limit)
    }

    fn energy(&self, tile: &Tile, photo: u32, distance_sq: f32, pull: &Pull) -> f32 {
        tile_cost(tile, self.empty.units, distance_sq)
            + pull.energy(self.source.photos.modes(photo))
    }

    fn insert(&mut self, tile: Tile, photo: u32) {
        let residual = residual(self.source.photos.modes(photo), &tile.descriptor);
        self.eye.put(tile.footprint(1), &residual);
        self.own(&tile, self.next);
        self.shown[self.source.photos.group(photo)].push(self.empty.center(&tile));
        self.tiles.insert(self.next, (tile, photo));
        self.next += 1;
    }

    /// Takes a tile out, and returns it with its photo and the energy that it had.
    fn take(&mut self, number: u32) -> (Tile, u32, f32) {
        let (tile, photo) = self
            .tiles
            .remove(&number)
            .expect("units are owned by tiles that are there");
        let wanted = Modes::of(&tile.descriptor.quarters);
        let pull = self.eye.lift(tile.footprint(1), wanted);
        let energy = self.energy(&tile, photo, self.source.photos.cost(&tile, photo), &pull);
        self.own(&tile, FREE);
        let center = self.empty.center(&tile);
        self.shown[self.source.photos.group(photo)].retain(|other| *other != center);
        (tile, photo, energy)
    }

    fn own(&mut self, tile: &Tile, number: u32) {
        for row in tile.row..tile.row + tile.side {
            self.owner[row * self.empty.columns + tile.col..][..tile.side].fill(number);
        }
    }
}

/// Random numbers by three shifts (Marsaglia, 2003).
struct Random(u64);

impl Random {
    fn below(&mut self, count: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 33) as usize % count
    }
}

#[cfg(test)]
mod tests;
