//! The best places for a template, coarse to fine.
//!
//! The plain idea: the mismatch at all positions of all buffers, and its lowest values that keep apart.
//!
//! Departures: 1. All positions are examined on a reduced level only, where a transform is small. 2. The few hundred
//! best minima there, and as many of the lowest positions that are not minima (in a valley along an edge the minimum of
//! the finer level may lie anywhere), are followed down the levels by direct sums around each of them. 3. Sums end as
//! soon as they exceed the worst match that is wanted. 4. On levels between, every other row is summed, and of what is
//! found there some are followed for each of the matches that are wanted. 5. Of buffers larger than some 150 megapixels
//! only what is nearest to the target is examined. The full search does the first step on the finest level itself, and
//! everywhere.
//!
//! Guarantees: what is returned is valid, and its mismatch is the direct sum. The same on any number of threads. Does not
//! guarantee: that coarse to fine finds what the full search finds; on photos it nearly always does (see the measurements).

use super::blocks::{Blocks, Scratch, Transform};
use super::buffer::{Buffer, MAX_LEVEL};
use super::direct::{Rows, mismatch};
use super::minima::{Low, Valid, bottom, minima};
use super::template::Template;
use fearless_simd::Level as Vectors;
use glam::{DVec2, IVec2};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashSet;

/// Minima that are followed from one level to the next.
const MINIMA: usize = 200;
/// Positions besides minima: this number divided by the radius, within limits. Small fragments need more, as there is
/// less in them that distinguishes places; with a quarter of it one query in a hundred ends elsewhere.
const SLOPES: usize = 16_000;
const SLOPE_LIMITS: [usize; 2] = [250, 1000];
/// Places that are followed from a level between, on which large fragments are known well, and how many of each group of
/// near ones: those of one valley would take the place of all others.
const BEST: usize = 64;
const BEST_OF_GROUP: usize = 5;
/// Places that are followed without a bound, and from which the search goes on by single pixels.
const FIRST: usize = 24;
/// Largest final move of a place, in pixels.
const MOVES: usize = 4;
/// Blocks of a buffer that are examined, the nearest to the target: those of 150 megapixels on the level that is half as
/// wide. So the cost of a fragment is bounded, and that of a hole grows with the hole, not with hole times picture.
const MAX_BLOCKS: usize = 1024;

/// A place of the template's corner on a level of a buffer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) buffer: usize,
    pub(super) corner: IVec2,
    pub(super) score: f32,
}

/// Query of a search.
pub(super) struct Hunt<'a> {
    pub(super) buffers: &'a [Buffer],
    /// Templates for the levels, the finest first.
    pub(super) templates: &'a [Template],
    /// The transforms for kept spectra.
    pub(super) kept: &'a Transform,
    /// Number of places, and their least distance.
    pub(super) count: usize,
    pub(super) apart_px: f64,
    /// Position of the target in the picture, around which large buffers are searched; none for searches of all blocks.
    pub(super) around: Option<DVec2>,
}

impl Hunt<'_> {
    /// The best places on level 0, the best first, starting from all positions of a level of each buffer that is searched.
    pub(super) fn best(
        &self,
        start: impl Fn(&Buffer) -> Option<usize>,
        progress: &Progress,
    ) -> Result<Vec<Place>, Cancelled> {
        let mut lows: Vec<Vec<Low>> = vec![Vec::new(); MAX_LEVEL + 1];
        for (index, buffer) in self.buffers.iter().enumerate() {
            if let Some(level) = start(buffer) {
                lows[level].extend(self.scan(index, level, progress)?);
            }
        }
        let mut found = Vec::new();
        for level in (1..=MAX_LEVEL).rev() {
            let lows_here = self.kept_lows(std::mem::take(&mut lows[level]));
            let places = self.followed(level - 1, &lows_here, 2, progress)?;
            if level == 1 {
                found = places;
            } else {
                let next = self.spread(&places, level - 1);
                lows[level - 1].extend(next.into_iter().map(Low::from));
            }
        }
        // a full search comes here with sums from transforms
        let finest = self.kept_lows(std::mem::take(&mut lows[0]));
        found.extend(self.followed(0, &finest, 1, progress)?);
        Ok(self.apart(found))
    }

    /// Number of positions followed that are not minima.
    fn slopes(&self) -> usize {
        let radius = self.templates[0].middle.x.max(1) as usize;
        (SLOPES / radius).clamp(SLOPE_LIMITS[0], SLOPE_LIMITS[1])
    }

    /// The best of all buffers, minima and others apart; the best first.
    fn kept_lows(&self, mut lows: Vec<Low>) -> Vec<Low> {
        lows.sort_by(|a, b| order(&a.place, &b.place));
        let (mut minima, mut slopes) = (MINIMA, self.slopes());
        lows.retain(|low| {
            let left = if low.minimum {
                &mut minima
            } else {
                &mut slopes
            };
            let keep = *left > 0;
            *left = left.saturating_sub(1);
            keep
        });
        lows
    }

    /// The lowest among all positions of a level of a buffer.
    fn scan(&self, index: usize, level: usize, progress: &Progress) -> Result<Vec<Low>, Cancelled> {
        let (buffer, template) = (&self.buffers[index], &self.templates[level]);
        let side = template.width.max(template.height);
        let (fourier, blocks);
        let kept = buffer.blocks(level).filter(|_| side <= self.kept.longest());
        let (fourier, blocks) = if let Some(blocks) = kept {
            (self.kept, blocks)
        } else {
            fourier = Transform::with_longest(side);
            let level = &buffer.levels[level];
            blocks = Blocks::new(level, template.channels, &fourier, 0.0, progress)?;
            (&fourier, &blocks)
        };
        let query = blocks.query(template, fourier);
        let counts = [MINIMA, self.slopes()];
        let middle = self.around.map(|at| buffer.nearest(at, level));
        let middle = middle.map(|at| at - template.middle);
        let found: Vec<Vec<Low>> = blocks
            .nearest(middle, MAX_BLOCKS)
            .into_par_iter()
            .map_init(
                || (fourier.scratch(), Valid::default()),
                |(scratch, valid): &mut (Scratch, Valid), block| {
                    if progress.is_cancelled() {
                        return Vec::new();
                    }
                    let level = &buffer.levels[level];
                    let first = blocks.first(block);
                    if !valid.find(template, level, first, fourier.field()) {
                        return Vec::new();
                    }
                    let field =
                        blocks.field(level, &query, template.channels, fourier, scratch, block);
                    minima(&field, valid, counts, index, first)
                },
            )
            .collect();
        progress.check()?;
        Ok(self.kept_lows(found.concat()))
    }

    /// The best place of a buffer at most this many pixels from one.
    pub(super) fn near(
        &self,
        buffer: usize,
        corner: IVec2,
        reach: i32,
        progress: &Progress,
    ) -> Result<Option<Place>, Cancelled> {
        let side = 2 * reach + 1;
        let places: Vec<_> = (0..side * side)
            .map(|k| (buffer, corner + IVec2::new(k % side, k / side) - reach))
            .collect();
        let found = self.sums(0, &places, f32::INFINITY, progress)?;
        Ok(found.into_iter().min_by(order))
    }

    /// Offset of the least mismatch around a place between pixels, −½ to ½.
    pub(super) fn between(&self, place: &Place) -> DVec2 {
        let (template, vectors) = (&self.templates[0], Vectors::new());
        let planes = &self.buffers[place.buffer].levels[0];
        let at = |step: IVec2| {
            let corner = place.corner + step;
            if template.valid(planes, corner) {
                mismatch(vectors, template, planes, corner, Rows::All, f32::INFINITY)
            } else {
                f32::INFINITY
            }
        };
        let along = |step: IVec2| bottom(at(-step), place.score, at(step)).1;
        DVec2::new(along(IVec2::X), along(IVec2::Y))
    }

    /// The places on a level at and around what was found on one that is `factor` times smaller; the best first.
    fn followed(
        &self,
        level: usize,
        lows: &[Low],
        factor: i32,
        progress: &Progress,
    ) -> Result<Vec<Place>, Cancelled> {
        progress.check()?;
        let mut seen = FxHashSet::default();
        let mut fresh = |buffer: usize, middle: IVec2| -> Vec<(usize, IVec2)> {
            (0..9)
                .map(|k| (buffer, middle + IVec2::new(k % 3 - 1, k / 3 - 1)))
                .filter(|&place| seen.insert(place))
                .collect()
        };
        let mut around = |lows: &[Low]| -> Vec<(usize, IVec2)> {
            let middle = |low: &Low| {
                factor * low.place.corner + (f64::from(factor) * low.between).round().as_ivec2()
            };
            lows.iter()
                .flat_map(|low| fresh(low.place.buffer, middle(low)))
                .collect()
        };
        let first = lows.len().min(FIRST);
        let (begin, rest) = (around(&lows[..first]), around(&lows[first..]));
        let mut found = self.sums(level, &begin, f32::INFINITY, progress)?;
        let bound = self.bound(level, &found);
        found.extend(self.sums(level, &rest, bound, progress)?);
        if level == 0 {
            for _ in 0..MOVES {
                found.sort_by(order);
                let bound = self.bound(level, &found);
                let next: Vec<_> = found
                    .iter()
                    .take(FIRST)
                    .flat_map(|place| fresh(place.buffer, place.corner))
                    .collect();
                if next.is_empty() {
                    break;
                }
                found.extend(self.sums(level, &next, bound, progress)?);
            }
        }
        found.sort_by(order);
        Ok(found)
    }

    /// The score from which a place is of no more use: on the finest level that of the last one that is wanted.
    fn bound(&self, level: usize, found: &[Place]) -> f32 {
        if level > 0 {
            return f32::INFINITY;
        }
        let best = self.apart(found.to_vec());
        best.get(self.count - 1)
            .map_or(f32::INFINITY, |worst| worst.score)
    }

    /// The direct sums at valid places, as far as they are below a bound.
    fn sums(
        &self,
        level: usize,
        places: &[(usize, IVec2)],
        bound: f32,
        progress: &Progress,
    ) -> Result<Vec<Place>, Cancelled> {
        let (template, vectors) = (&self.templates[level], Vectors::new());
        // on levels between, sums only say where to go on
        let rows = if level > 0 {
            Rows::EvenTwice
        } else {
            Rows::All
        };
        let found = places
            .par_iter()
            .with_min_len(16)
            .filter_map(|&(buffer, corner)| {
                let planes = &self.buffers[buffer].levels[level];
                if progress.is_cancelled() || !template.valid(planes, corner) {
                    return None;
                }
                let score = mismatch(vectors, template, planes, corner, rows, bound);
                score.is_finite().then_some(Place {
                    buffer,
                    corner,
                    score,
                })
            })
            .collect();
        progress.check()?;
        Ok(found)
    }

    /// The places of a level that are followed, from all that were examined, the best first: the best, and some of each
    /// group of near ones.
    fn spread(&self, places: &[Place], level: usize) -> Vec<Place> {
        let apart_px = self.apart_px / f64::from(1 << level);
        // the order of groups may change on the next level
        let max_groups = self.count + self.count / 2;
        let mut groups: Vec<(Place, usize)> = Vec::new();
        let mut chosen = Vec::new();
        for (rank, place) in places.iter().enumerate() {
            let near = |(first, _): &&mut (Place, usize)| {
                first.buffer == place.buffer
                    && (first.corner - place.corner).as_dvec2().length() < apart_px
            };
            let mut is_followed = rank < BEST;
            if let Some((_, members)) = groups.iter_mut().find(near) {
                *members += 1;
                is_followed |= *members <= BEST_OF_GROUP;
            } else if groups.len() < max_groups {
                groups.push((*place, 1));
                is_followed = true;
            }
            if is_followed {
                chosen.push(*place);
            }
        }
        chosen
    }

    /// The best places that keep apart.
    fn apart(&self, mut places: Vec<Place>) -> Vec<Place> {
        places.sort_by(order);
        let mut kept: Vec<Place> = Vec::new();
        for place in places {
            let near = |other: &Place| {
                other.buffer == place.buffer
                    && (other.corner - place.corner).as_dvec2().length() < self.apart_px
            };
            if !kept.iter().any(near) {
                kept.push(place);
            }
            if kept.len() == self.count {
                break;
            }
        }
        kept
    }
}

/// The best first; among equals that of the earlier buffer, the upper, the left one.
fn order(a: &Place, b: &Place) -> std::cmp::Ordering {
    let key = |place: &Place| (place.buffer, place.corner.y, place.corner.x);
    a.score.total_cmp(&b.score).then(key(a).cmp(&key(b)))
}
