//! Assignment of photos to tiles.
//!
//! 1. *Candidates*: the nearest photos of each tile, one of each group of near-duplicates.
//! 2. *Start*: the photos that the tiling brings along, where the rules allow them. Where there are none, under limits on
//!    numbers alone, the cheapest assignment if the problem fits; else greedy, the cheapest pair of
//!    tile and photo first; if that leads into a dead end and the problem is small, by search (see the module `fill`).
//! 3. *Improvement* (see the module `improve`): photos change, and tiles swap, as long as the energy falls.
//!
//! Guarantees: the rules hold; the same choice on any number of threads; of small problems (a few hundred tiles and a
//! dozen photos, or the other way round) an answer if there is one, unless the search for it runs out of steps. Does
//! not guarantee: the optimum under a repeat distance, which is a hard problem, as is to find any answer if photos
//! hardly suffice; the distance of the cost from a lower bound is reported.

use crate::descriptor::{Descriptor, Weights};
use crate::fill::fill;
use crate::improve;
use crate::optimal::cheapest;
use crate::rules::{ChooseError, Placement, Rules};
use crate::search::{Near, PhotoIndex};
use crate::tiling::{Tile, Tiling};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Comparison of tiles through which an edge runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Features {
    /// The highest total degree that counts, 0 to [`MAX_DEGREE`](crate::MAX_DEGREE); all degrees count as much as color.
    pub degree: usize,
    /// Weight of such a tile against others, above 0. More keeps its structure where neighbors make up for one another,
    /// and gives it the photos that others want as well.
    pub weight: f64,
}

/// Parameters of the comparison and choice of photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChooseParams {
    /// Weight of each degree.
    pub weights: Weights,
    /// Comparison of tiles with an edge; `None` compares them as all others.
    pub features: Option<Features>,
    /// Strength with which neighboring tiles compensate one another when seen from afar, 0 to 1. More is nearer to the
    /// picture from a distance, and less near in each single tile.
    pub blend: f64,
    /// Candidates of each tile, at least 1. More find better choices under strict rules and cost time.
    pub candidates: usize,
    /// Rounds of improvement; they end earlier when nothing changes. 0 leaves the start as it is.
    pub rounds: usize,
    /// Passes over the picture in which tiles of several sizes give way to others. Each takes a twentieth of the time of 20, which
    /// gain nearly all that can be had; 0 leaves the first tiles as they are.
    pub tiling_rounds: usize,
}

impl Default for ChooseParams {
    fn default() -> Self {
        Self {
            weights: Weights {
                degree: 3,
                detail: 1.0,
            },
            features: None,
            blend: 0.3,
            candidates: 128,
            rounds: 8,
            tiling_rounds: 20,
        }
    }
}

/// Photos to choose from.
#[derive(Debug, Clone)]
pub struct Photos {
    /// For tiles without an edge, and for those with one if they are compared in another way.
    classes: Vec<Class>,
    quarters: Vec<[[f32; 3]; 4]>,
    groups: Vec<u32>,
    different: usize,
}

/// Photos as tiles of one kind see them.
#[derive(Debug, Clone)]
pub(crate) struct Class {
    weights: Weights,
    /// On the coefficients: the square root of the weight of the tile.
    factor: f32,
    pub index: PhotoIndex,
}

impl Class {
    fn new(descriptors: &[Descriptor], weights: Weights, weight: f64) -> Self {
        let mut class = Self {
            weights,
            factor: weight.sqrt() as f32,
            index: PhotoIndex::new(&[], 1),
        };
        let vectors: Vec<f32> = descriptors
            .iter()
            .flat_map(|descriptor| class.vector(descriptor))
            .collect();
        let dimensions = (vectors.len() / descriptors.len().max(1)).max(1);
        class.index = PhotoIndex::new(&vectors, dimensions);
        class
    }

    pub fn vector(&self, descriptor: &Descriptor) -> Vec<f32> {
        let mut vector = self.weights.vector(descriptor);
        for value in &mut vector {
            *value *= self.factor;
        }
        vector
    }
}

impl Photos {
    /// Photos by their descriptors, with the group of near-duplicates of each, from 0 without gaps. Of `params`, the weights and the
    /// features matter.
    ///
    /// # Panics
    /// If there are not as many groups as descriptors.
    pub fn new(descriptors: &[Descriptor], groups: Vec<u32>, params: &ChooseParams) -> Self {
        assert_eq!(descriptors.len(), groups.len(), "each photo has a group");
        let features = params.features.map(|features| {
            let weights = Weights {
                degree: features.degree,
                detail: 1.0,
            };
            Class::new(descriptors, weights, features.weight)
        });
        Self {
            classes: std::iter::once(Class::new(descriptors, params.weights, 1.0))
                .chain(features)
                .collect(),
            quarters: descriptors
                .iter()
                .map(|descriptor| descriptor.quarters)
                .collect(),
            different: groups.iter().max().map_or(0, |&group| group as usize + 1),
            groups,
        }
    }

    fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }

    fn class_of(&self, tile: &Tile) -> usize {
        usize::from(tile.feature).min(self.classes.len() - 1)
    }

    pub(crate) fn class(&self, tile: &Tile) -> &Class {
        &self.classes[self.class_of(tile)]
    }

    /// Groups of near-duplicates.
    pub fn different(&self) -> usize {
        self.different
    }

    pub(crate) fn quarters(&self, photo: u32) -> &[[f32; 3]; 4] {
        &self.quarters[photo as usize]
    }

    pub(crate) fn group(&self, photo: u32) -> usize {
        self.groups[photo as usize] as usize
    }

    /// The squared distance of a photo from a tile.
    pub(crate) fn cost(&self, tile: &Tile, photo: u32) -> f32 {
        let class = self.class(tile);
        class
            .index
            .distance_sq(&class.vector(&tile.descriptor), photo)
    }

    /// The `count` photos nearest to a tile, one of each group.
    pub(crate) fn candidates(&self, tile: &Tile, count: usize) -> Vec<Near> {
        let class = self.class(tile);
        self.one_of_each_group(class.index.nearest(&class.vector(&tile.descriptor), count))
    }

    /// Photos in the order of their distance, the nearest of each group only.
    fn one_of_each_group(&self, mut near: Vec<Near>) -> Vec<Near> {
        let mut seen = Seen::new(self.different);
        near.retain(|near| seen.first(self.groups[near.photo as usize]));
        near
    }
}

/// A set of small numbers.
struct Seen(Vec<u64>);

impl Seen {
    fn new(count: usize) -> Self {
        Self(vec![0; count.div_ceil(64)])
    }

    /// Takes a number in, and says whether it was new.
    fn first(&mut self, number: u32) -> bool {
        let (word, bit) = (&mut self.0[number as usize / 64], 1 << (number % 64));
        let first = *word & bit == 0;
        *word |= bit;
        first
    }
}

/// The tiles with their candidates, and the photos.
pub(crate) struct Problem<'a> {
    pub tiling: &'a Tiling,
    pub tiles: &'a [Tile],
    pub photos: &'a Photos,
    queries: Vec<Vec<f32>>,
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
    fn costs(&self, tile: usize) -> Vec<f32> {
        self.index(tile).all(&self.queries[tile])
    }

    /// All groups by their nearest photo, the nearest first.
    pub fn everything(&self, tile: usize) -> Vec<Near> {
        let index = self.index(tile);
        let all = index.nearest(&self.queries[tile], index.len());
        self.photos.one_of_each_group(all)
    }
}

/// The nearest photos of each tile, one of each group of near-duplicates.
fn candidates(
    tiles: &[Tile],
    queries: &[Vec<f32>],
    photos: &Photos,
    count: usize,
    progress: &Progress,
) -> Result<Vec<Vec<Near>>, Cancelled> {
    let phase = progress.phase("search", tiles.len() as u64);
    tiles
        .par_iter()
        .zip(queries)
        .map(|(tile, query)| {
            progress.check()?;
            let near = photos.class(tile).index.nearest(query, count);
            phase.advance(1);
            Ok(photos.one_of_each_group(near))
        })
        .collect()
}

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
    let tiles = &tiling.tiles[..];
    let different = photos.different;
    check_counts(tiles.len(), photos, rules)?;
    if tiles.is_empty() {
        return Ok(Choice {
            photos: Vec::new(),
            cost: 0.0,
            bound: 0.0,
            changes: 0,
        });
    }
    let queries: Vec<Vec<f32>> = tiles
        .iter()
        .map(|tile| photos.class(tile).vector(&tile.descriptor))
        .collect();
    let candidates = candidates(tiles, &queries, photos, params.candidates.max(1), progress)?;
    let mut problem = Problem {
        tiling,
        tiles,
        photos,
        queries,
        candidates,
    };
    let centers = tiling.centers();
    let mut placement = Placement::new(*rules, &centers, &photos.groups, different);
    let nearest_sum: f64 = problem
        .candidates
        .iter()
        .filter_map(|near| near.first())
        .map(|near| f64::from(near.distance_sq))
        .sum();
    let counted = rules.max_uses.is_some() || rules.use_all;
    let spread = rules.min_repeat_distance > 1.0;
    let mut bound = nearest_sum;
    if counted && tiles.len().saturating_mul(different) <= MAX_COSTS {
        let best = cheapest_of_groups(&problem, rules, progress)?;
        bound = best
            .iter()
            .enumerate()
            .map(|(tile, &photo)| f64::from(problem.cost(tile, photo)))
            .sum();
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
        if rules.use_all {
            use_each_once(&problem, &mut placement, progress)?;
        }
        match greedy(&mut problem, &mut placement, progress) {
            Err(error @ ChooseError::TooNear { .. }) => {
                if !fill(&problem, &mut placement, progress)? {
                    return Err(error);
                }
            }
            done => done?,
        }
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
    let cost = chosen
        .iter()
        .enumerate()
        .map(|(tile, &photo)| f64::from(problem.cost(tile, photo)))
        .sum();
    Ok(Choice {
        photos: chosen,
        cost,
        bound,
        changes,
    })
}

/// Checks that there are as many photos as the rules ask for.
fn check_counts(tiles: usize, photos: &Photos, rules: &Rules) -> Result<(), ChooseError> {
    let different = photos.different;
    if photos.is_empty() {
        return Err(ChooseError::NoPhotos);
    }
    if let Some(max_uses) = rules.max_uses
        && (max_uses as usize).saturating_mul(different) < tiles
    {
        return Err(ChooseError::TooFew {
            tiles,
            different,
            max_uses,
        });
    }
    if rules.use_all && different > tiles {
        return Err(ChooseError::TooMany { tiles, different });
    }
    Ok(())
}

/// The cheapest assignment under limits on numbers alone.
fn cheapest_of_groups(
    problem: &Problem<'_>,
    rules: &Rules,
    progress: &Progress,
) -> Result<Vec<u32>, Cancelled> {
    let photos = problem.photos;
    let (tiles, different) = (problem.tiles.len(), photos.different);
    let mut costs = vec![f32::INFINITY; tiles * different];
    let mut best = vec![0u32; tiles * different];
    costs
        .par_chunks_exact_mut(different)
        .zip(best.par_chunks_exact_mut(different))
        .enumerate()
        .try_for_each(|(tile, (costs, best))| {
            progress.check()?;
            for (photo, cost) in problem.costs(tile).into_iter().enumerate() {
                let group = photos.groups[photo] as usize;
                if cost < costs[group] {
                    costs[group] = cost;
                    best[group] = photo as u32;
                }
            }
            Ok::<(), Cancelled>(())
        })?;
    let most = rules.max_uses.unwrap_or(u32::MAX).min(tiles as u32);
    let found = cheapest(&costs, &vec![most; different], rules.use_all, progress)?;
    Ok(found
        .iter()
        .enumerate()
        .map(|(tile, &group)| best[tile * different + group as usize])
        .collect())
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
        for (photo, cost) in problem.costs(tile).into_iter().enumerate() {
            let list = &mut wanted[photos.groups[photo] as usize];
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
        if !placement.tiles_of(placement.group(photo)).is_empty() {
            continue;
        }
        progress.check()?;
        let free = (0..problem.tiles.len()).filter(|&tile| placement.photo(tile).is_none());
        let best = free
            .map(|tile| (problem.cost(tile, photo), tile))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // there are at least as many tiles as groups, which the caller has checked
        if let Some((_, tile)) = best {
            placement.put(tile, Some(photo));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
