//! Photos to choose from, with the indices that find the nearest ones.

use super::ChooseParams;
use crate::by_hand::{ByHand, Hand};
use crate::descriptor::{Descriptor, Weights};
use crate::eye::Modes;
use crate::rules::ChooseError;
use crate::search::{Near, PhotoIndex};
use crate::tiling::{Tile, Tiling};

/// Photos to choose from.
#[derive(Debug, Clone)]
pub struct Photos {
    /// For tiles without an edge, and for those with one if they are compared in another way.
    classes: Vec<Class>,
    modes: Vec<Modes>,
    pub(super) groups: Vec<u32>,
    pub(super) different: usize,
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
            modes: descriptors
                .iter()
                .map(|descriptor| Modes::of(&descriptor.quarters))
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

    pub(crate) fn modes(&self, photo: u32) -> &Modes {
        &self.modes[photo as usize]
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

    /// The `count` photos nearest to a tile, the nearest first, by the squared distances that [`choose()`](crate::choose()) compares. Of
    /// near-duplicates only the nearest is there, and none that is banned; there are fewer if not enough are left.
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

    /// The search for the candidates of each tile: the first step of [`choose_by_hand`](crate::choose_by_hand), which takes the answers from
    /// [`choose_found`](crate::choose_found).
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
    pub(super) fn banned_at(&self, hand: &Hand, tile: usize) -> usize {
        let banned_here = hand.banned_at(tile).map(|group| self.size_of(group));
        self.banned_count + banned_here.sum::<usize>()
    }

    /// Photos in the order of their distance, the nearest of each group only.
    pub(super) fn one_of_each_group(&self, mut near: Vec<Near>) -> Vec<Near> {
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
