//! Deviation of the simplified surface from the original one.
//!
//! From the original, by samples: its vertices and the middles of its edges are handed from triangle to triangle, and
//! after each collapse each is known to be within a distance of the triangle that has it. From the simplified surface, by
//! the distances of new vertices, and of the middles of new edges and triangles, to the triangles of the original: first
//! to that of the nearest sample, and only if that is too far are all searched.

use glam::DVec3;

use super::ErrorSample;
use super::surface::Surface;
use crate::{Adjacency, Bvh, TriMesh, distance_sq_to_triangle};

const NONE: u32 = u32::MAX;

/// A sample that is that much closer to a triangle than allowed, as a share of the squares, is left there, or goes there. Its
/// distance to another might be less still, but that is not worth the search.
const NEAR_SHARE: f64 = 1.0 / 16.0;

/// Number of samples that are moved before memory is given back.
const AT_ONCE: usize = 1 << 16;

/// A place of the original.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub place: DVec3,
    /// The triangle of the original it is on.
    pub original: u32,
    /// The triangle that it was near to when patches were put together.
    pub settled: u32,
    /// The triangle of the simplified surface it is near to.
    pub triangle: u32,
}

/// Samples that are near triangles of a mesh as it is.
pub(super) fn known_samples(mut samples: Vec<ErrorSample>) -> Vec<Sample> {
    let mut known = Vec::with_capacity(samples.len());
    take_from_end(&mut samples, |ErrorSample { place, triangle }| {
        known.push(Sample {
            place,
            original: triangle,
            settled: triangle,
            triangle,
        });
    });
    known.reverse();
    known
}

/// Takes elements out, the last one first, and gives memory back on the way: there may be more samples than of all else.
pub(super) fn take_from_end<T>(list: &mut Vec<T>, mut each: impl FnMut(T)) {
    while !list.is_empty() {
        let first = list.len().saturating_sub(AT_ONCE);
        list.drain(first..).rev().for_each(&mut each);
        list.shrink_to_fit();
    }
}

/// The samples of a mesh that is not simplified yet.
pub(super) fn samples(mesh: &TriMesh, adjacency: &Adjacency) -> Vec<Sample> {
    let positions = mesh.positions();
    let sample = |place: DVec3, triangle: u32| Sample {
        place,
        original: triangle,
        settled: triangle,
        triangle,
    };
    let vertices = (0..positions.len() as u32).filter_map(|v| {
        let triangle = *adjacency.triangles_at(v).first()?;
        Some(sample(positions[v as usize], triangle))
    });
    let edges = (0_u32..).zip(adjacency.edges()).map(|(edge, &[a, b])| {
        let [p, q] = [a, b].map(|v| positions[v as usize]);
        sample(0.5 * p + 0.5 * q, adjacency.uses(edge)[0].triangle)
    });
    vertices.chain(edges).collect()
}

/// Bookkeeping of the deviation.
pub(super) struct Deviation<'a> {
    samples: Vec<Sample>,
    /// The next sample of the same triangle.
    next: Vec<u32>,
    /// The first sample of each triangle.
    first: Vec<u32>,
    /// The triangles of the original, if the distance to them is limited, too.
    original: Option<&'a Bvh>,
    pub largest: f64,
}

/// Moves of the samples around a collapse. The list is kept for the next one.
#[derive(Default)]
pub(super) struct Moves {
    /// The samples, each with the place of its triangle among the new ones.
    samples: Vec<(u32, u32)>,
    /// The largest distance.
    largest: f64,
}

impl<'a> Deviation<'a> {
    pub fn new(samples: Vec<Sample>, triangles: usize, original: Option<&'a Bvh>) -> Self {
        let mut first = vec![NONE; triangles];
        let next = (0_u32..)
            .zip(&samples)
            .map(|(i, sample)| std::mem::replace(&mut first[sample.triangle as usize], i))
            .collect();
        Self {
            samples,
            next,
            first,
            original,
            largest: 0.0,
        }
    }

    /// Returns `true` if the deviation stays within `limit` if the triangles `old` are replaced by those with corners
    /// at `new`, all of which have one at `merged`. The first of `old` are those that change into `new`, in the same
    /// order.
    pub fn stays_within(
        &self,
        limit: f64,
        old: &[&[u32]; 2],
        new: &[[DVec3; 3]],
        merged: DVec3,
        moves: &mut Moves,
    ) -> bool {
        let limit_sq = limit * limit;
        moves.largest = 0.0;
        moves.samples.clear();
        for (k, &t) in old.iter().copied().flatten().enumerate() {
            let mut i = self.first[t as usize];
            while i != NONE {
                let place = self.samples[i as usize].place;
                let mut best = (f64::INFINITY, 0);
                if let Some(corners) = new.get(k) {
                    best = (distance_sq_to_triangle(place, corners), k as u32);
                }
                if best.0 > NEAR_SHARE * limit_sq {
                    for (other, corners) in (0_u32..).zip(new) {
                        let distance_sq = distance_sq_to_triangle(place, corners);
                        if distance_sq < best.0 {
                            best = (distance_sq, other);
                            if distance_sq <= NEAR_SHARE * limit_sq {
                                break;
                            }
                        }
                    }
                    if best.0 > limit_sq {
                        return false;
                    }
                }
                moves.largest = moves.largest.max(best.0);
                moves.samples.push((i, best.1));
                i = self.next[i as usize];
            }
        }
        moves.largest = moves.largest.sqrt();
        let Some(original) = self.original else {
            return true;
        };
        let middles = new.iter().flat_map(|corners| {
            let [a, b, c] = *corners;
            let next = if a == merged {
                b
            } else if b == merged {
                c
            } else {
                a
            };
            [(a + b + c) / 3.0, 0.5 * (merged + next)]
        });
        for place in std::iter::once(merged).chain(middles) {
            let Some(distance) = self.distance_to(original, place, limit, moves) else {
                return false;
            };
            moves.largest = moves.largest.max(distance);
        }
        true
    }

    /// Largest distance of a place from the original, unless that is more than the limit.
    fn distance_to(&self, original: &Bvh, place: DVec3, limit: f64, moves: &Moves) -> Option<f64> {
        let near = (moves.samples.iter())
            .map(|&(i, _)| &self.samples[i as usize])
            .map(|sample| (sample.place.distance_squared(place), sample.original))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let guess = near.map_or(f64::INFINITY, |(_, triangle)| {
            distance_sq_to_triangle(place, original.corners(triangle))
        });
        if guess <= limit * limit {
            return Some(guess.sqrt());
        }
        let found = original.closest_within(place, limit)?;
        Some(found.distance_sq.sqrt())
    }

    /// Hands the samples over.
    pub fn accept(&mut self, old: &[&[u32]; 2], new: &[u32], moves: &Moves) {
        self.largest = self.largest.max(moves.largest);
        for &t in old.iter().copied().flatten() {
            self.first[t as usize] = NONE;
        }
        for &(sample, i) in &moves.samples {
            let first = &mut self.first[new[i as usize] as usize];
            self.next[sample as usize] = std::mem::replace(first, sample);
        }
    }

    /// The samples, each with the triangle that has it now.
    pub fn into_samples(mut self, surface: &Surface) -> Vec<Sample> {
        for t in 0..surface.triangles.len() as u32 {
            let mut i = self.first[t as usize];
            while i != NONE {
                self.samples[i as usize].triangle = t;
                i = self.next[i as usize];
            }
        }
        self.samples
    }
}
