//! Features of two pictures that look alike.
//!
//! ```text
//! for each feature of the first picture: the two most similar ones of the second
//! a match if the best is clearly better than the next one, and if it thinks the same the other way round
//! ```
//!
//! Dark and light blobs are compared among themselves only, which halves the work.
//!
//! Source: Lowe, 2004, section 7.1 (ratio test).
//!
//! Guarantees: integers throughout, so equal bytes everywhere. Cost: features × features / 2 × 128 multiplications.

use crate::features::{Descriptor, Feature, Features};
use fearless_simd::{Level, dispatch, prelude::*};
use glam::DVec2;
use rayon::prelude::*;

/// Two features that look alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeatureMatch {
    /// Index of the feature in the first picture.
    pub first: usize,
    /// Index of the feature in the second picture.
    pub second: usize,
    /// The distance of the descriptors divided by that to the next best one, 0 to 1; smaller is surer.
    pub ratio: f64,
}

/// Features within this many blurs of each other may be one thing: it must not be its own rival in the ratio test.
const NEAR_SIGMAS: f64 = 1.5;

/// The mutual matches whose ratio is below `max_ratio` (0 to 1; 0.8 is usual, larger accepts more wrong ones), the surest
/// first.
pub fn match_features(first: &Features, second: &Features, max_ratio: f64) -> Vec<FeatureMatch> {
    let mut matches = Vec::new();
    for dark in [true, false] {
        let pick = |features: &Features| -> (Vec<usize>, Vec<Entry>) {
            (0..features.points.len())
                .filter(|&i| (features.points[i].response > 0.0) == dark)
                .map(|i| (i, Entry::new(&features.points[i], &features.descriptors[i])))
                .unzip()
        };
        let ((first_index, first), (second_index, second)) = (pick(first), pick(second));
        let there = nearest_two(&first, &second);
        let back = nearest_two(&second, &first);
        for (i, found) in there.iter().enumerate() {
            let Some(found) = found else { continue };
            let mutual = back[found.best].is_some_and(|back| first[back.best].is_near(&first[i]));
            let ratio =
                (f64::from(found.best_distance) / f64::from(found.next_distance.max(1))).sqrt();
            if mutual && ratio < max_ratio {
                matches.push(FeatureMatch {
                    first: first_index[i],
                    second: second_index[found.best],
                    ratio,
                });
            }
        }
    }
    matches.sort_by(|a, b| a.ratio.total_cmp(&b.ratio).then(a.first.cmp(&b.first)));
    matches
}

/// A descriptor ready to be multiplied, its squared length, and where it is.
struct Entry {
    values: [i16; 128],
    square: i32,
    at: DVec2,
    near_sq: f64,
}

impl Entry {
    fn new(point: &Feature, descriptor: &Descriptor) -> Self {
        let values = descriptor.0.map(i16::from);
        Self {
            square: dot(&values, &values),
            values,
            at: point.at,
            near_sq: (NEAR_SIGMAS * point.sigma_px).powi(2),
        }
    }

    /// Returns `true` if both are the same thing: one point with two directions, or seen from two sides.
    fn is_near(&self, other: &Self) -> bool {
        self.at.distance_squared(other.at) < self.near_sq.max(other.near_sq)
    }
}

/// The nearest and the next nearest.
#[derive(Clone, Copy)]
struct NearestTwo {
    best: usize,
    best_distance: i32,
    next_distance: i32,
}

/// Products of 128 numbers of at most 255 sum to at most 8.3 million.
#[inline(always)]
fn dot(a: &[i16; 128], b: &[i16; 128]) -> i32 {
    a.iter()
        .zip(b)
        .map(|(&a, &b)| i32::from(a) * i32::from(b))
        .sum()
}

/// For each of `queries` its nearest two among `entries`; the first of equals.
fn nearest_two(queries: &[Entry], entries: &[Entry]) -> Vec<Option<NearestTwo>> {
    let level = Level::new();
    queries
        .par_iter()
        .with_min_len(32)
        .map(|query| dispatch!(level, simd => nearest_two_of(simd, query, entries)))
        .collect()
}

#[inline(always)]
fn nearest_two_of<S: Simd>(_simd: S, query: &Entry, entries: &[Entry]) -> Option<NearestTwo> {
    let mut found = NearestTwo {
        best: usize::MAX,
        best_distance: i32::MAX,
        next_distance: i32::MAX,
    };
    for (index, entry) in entries.iter().enumerate() {
        let distance = query.square + entry.square - 2 * dot(&query.values, &entry.values);
        if distance >= found.next_distance {
            continue;
        }
        let same_thing = found.best != usize::MAX && entry.is_near(&entries[found.best]);
        if distance < found.best_distance {
            if !same_thing {
                found.next_distance = found.best_distance;
            }
            found.best_distance = distance;
            found.best = index;
        } else if !same_thing {
            found.next_distance = distance;
        }
    }
    (found.best != usize::MAX).then_some(found)
}
