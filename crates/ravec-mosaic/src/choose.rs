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

use crate::by_hand::{ByHand, Hand};
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
    /// The groups that are banned.
    banned: Vec<bool>,
    /// Photos in these groups.
    banned_count: usize,
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
        let different = groups.iter().max().map_or(0, |&group| group as usize + 1);
        Self {
            classes: std::iter::once(Class::new(descriptors, params.weights, 1.0))
                .chain(features)
                .collect(),
            quarters: descriptors
                .iter()
                .map(|descriptor| descriptor.quarters)
                .collect(),
            different,
            groups,
            banned: vec![false; different],
            banned_count: 0,
        }
    }

    /// Takes a photo and its near-duplicates out of the choice. Only tiles that are pinned may still have them.
    ///
    /// # Panics
    /// If there is no such photo.
    pub fn ban(&mut self, photo: u32) {
        let group = self.group(photo);
        if !std::mem::replace(&mut self.banned[group], true) {
            self.banned_count += self.size_of(group);
        }
    }

    /// Number of photos, with those that are banned.
    pub fn len(&self) -> usize {
        self.groups.len()
    }

    /// Returns `true` if there is no photo.
    pub fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }

    pub(crate) fn banned_groups(&self) -> &[bool] {
        &self.banned
    }

    /// Groups that are not banned.
    pub(crate) fn allowed(&self) -> usize {
        self.banned.iter().filter(|&&banned| !banned).count()
    }

    /// Photos of a group.
    fn size_of(&self, group: usize) -> usize {
        let groups = self.groups.iter();
        groups.filter(|&&other| other as usize == group).count()
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

    /// The `count` photos nearest to a tile that are not banned, one of each group.
    pub(crate) fn candidates(&self, tile: &Tile, count: usize) -> Vec<Near> {
        let class = self.class(tile);
        let query = class.vector(&tile.descriptor);
        let mut near = class.index.nearest(&query, count + self.banned_count);
        near.retain(|near| !self.banned[self.group(near.photo)]);
        near.truncate(count);
        self.one_of_each_group(near)
    }

    /// The `count` photos nearest to a tile, the nearest first, by the squared distances that [`choose()`] compares. Of
    /// near-duplicates only the nearest is there, and none that is banned; there are fewer if there are not so many.
    pub fn nearest(&self, tile: &Tile, count: usize) -> Vec<Near> {
        let mut asked = count;
        loop {
            let mut near = self.candidates(tile, asked);
            if near.len() >= count || asked >= self.len() {
                near.truncate(count);
                return near;
            }
            asked = (2 * asked).min(self.len());
        }
    }

    /// The search for the candidates of each tile: the first step of [`choose_by_hand`], which takes the answers from
    /// [`choose_found`].
    ///
    /// # Errors
    /// [`ChooseError`] if what is set by hand makes no sense.
    pub fn searches(
        &self,
        tiling: &Tiling,
        by_hand: &ByHand,
        params: &ChooseParams,
    ) -> Result<Vec<TileSearch>, ChooseError> {
        let hand = Hand::new(by_hand, tiling.tiles.len(), self)?;
        let tiles = tiling.tiles.iter().enumerate();
        let searches = tiles.map(|(at, tile)| {
            let count = params.candidates.max(1) + self.banned_at(&hand, at);
            TileSearch {
                index: self.class_of(tile),
                query: self.class(tile).vector(&tile.descriptor),
                count: count.min(self.len()),
            }
        });
        Ok(searches.collect())
    }

    /// The indices in which tiles are searched, by [`TileSearch::index`].
    pub fn indices(&self) -> impl Iterator<Item = &PhotoIndex> {
        self.classes.iter().map(|class| &class.index)
    }

    /// Number of photos that a tile may not have.
    fn banned_at(&self, hand: &Hand, tile: usize) -> usize {
        let banned_here = hand.banned_at(tile).map(|group| self.size_of(group));
        self.banned_count + banned_here.sum::<usize>()
    }

    /// Photos in the order of their distance, the nearest of each group only.
    fn one_of_each_group(&self, mut near: Vec<Near>) -> Vec<Near> {
        let mut seen = Seen::new(self.different);
        near.retain(|near| seen.first(self.groups[near.photo as usize]));
        near
    }
}

/// The search for the candidates of a tile.
#[derive(Debug, Clone, PartialEq)]
pub struct TileSearch {
    /// Number of the index, as [`Photos::indices`] lists them.
    pub index: usize,
    /// Query vector.
    pub query: Vec<f32>,
    /// Number of the nearest photos to find.
    pub count: usize,
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
    fn costs(&self, tile: usize) -> Vec<f32> {
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
/// by [`PhotoIndex::nearest`].
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
    let queries: Vec<Vec<f32>> = tiles
        .iter()
        .map(|tile| photos.class(tile).vector(&tile.descriptor))
        .collect();
    let mut problem = Problem {
        tiling,
        tiles,
        photos,
        queries,
        hand,
        candidates: Vec::new(),
    };
    let count = params.candidates.max(1);
    problem.candidates = match found {
        None => problem.candidates(count, progress)?,
        Some(found) => {
            assert_eq!(found.len(), tiles.len(), "each tile has an answer");
            let found = found.into_par_iter().enumerate();
            found
                .map(|(tile, near)| problem.allowed(tile, near, count))
                .collect()
        }
    };
    let hand = problem.hand.clone();
    let without = (0..tiles.len())
        .find(|&tile| hand.pinned(tile).is_none() && problem.candidates[tile].is_empty());
    if let Some(tile) = without {
        return Err(ChooseError::NothingLeft { tile });
    }
    let centers = tiling.centers();
    let mut placement = Placement::new(*rules, &centers, &photos.groups, different).with(&hand);
    for (tile, photo) in hand.pins() {
        placement.put(tile, Some(photo));
    }
    let nearest_sum: f64 = problem
        .candidates
        .iter()
        .enumerate()
        .filter_map(|(tile, near)| match hand.pinned(tile) {
            Some(photo) => Some(problem.cost(tile, photo)),
            None => near.first().map(|near| near.distance_sq),
        })
        .map(f64::from)
        .sum();
    let counted = rules.max_uses.is_some() || rules.use_all;
    let spread = rules.min_repeat_distance > 1.0;
    let mut bound = nearest_sum;
    if counted && tiles.len().saturating_mul(different) <= MAX_COSTS {
        let best = cheapest_of_groups(&problem, &placement, progress)?;
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
            // a photo may be banned at the tiles that were left for it
            Ok(()) if rules.use_all && unused(&placement).next().is_some() => {
                if !fill(&problem, &mut placement, progress)? {
                    return Err(ChooseError::NotAllUsed);
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

/// The groups that are not banned and that no tile has.
fn unused<'a>(placement: &'a Placement<'_>) -> impl Iterator<Item = usize> + 'a {
    (0..placement.different()).filter(|&group| {
        placement.tiles_of(group).is_empty() && !placement.is_banned_everywhere(group)
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

/// The cheapest assignment under limits on numbers alone, around the tiles that are pinned.
fn cheapest_of_groups(
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

#[cfg(test)]
pub(crate) mod tests;
