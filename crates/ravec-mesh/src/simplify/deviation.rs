//! How far the simplified surface is from the original one.
//!
//! From the original, by samples: its vertices and the middles of its edges are handed from triangle to triangle, and
//! after each collapse each is known to be within a distance of the triangle that has it. From the simplified surface, by
//! the distances of new vertices, and of the middles of new edges and triangles, to the triangles of the original.

use glam::DVec3;

use super::surface::Surface;
use crate::{Adjacency, Bvh, TriMesh, distance_sq_to_triangle};

const NONE: u32 = u32::MAX;

/// What is known about the deviation.
pub(super) struct Deviation {
    samples: Vec<DVec3>,
    /// The next sample of the same triangle.
    next: Vec<u32>,
    /// The first sample of each triangle.
    first: Vec<u32>,
    /// The triangles of the original.
    original: Bvh,
    /// The samples around the collapse under examination, with the place of their triangle among the new ones.
    moves: Vec<(u32, u32)>,
    pub largest: f64,
    /// The largest distance around the collapse under examination.
    here: f64,
}

impl Deviation {
    pub fn new(mesh: &TriMesh, surface: &Surface, adjacency: &Adjacency) -> Self {
        let positions = mesh.positions();
        let vertices = (0..positions.len() as u32)
            .filter_map(|v| Some((positions[v as usize], *adjacency.triangles_at(v).first()?)));
        let edges = (0_u32..).zip(adjacency.edges()).map(|(edge, &[a, b])| {
            let [p, q] = [a, b].map(|v| positions[v as usize]);
            (0.5 * p + 0.5 * q, adjacency.uses(edge)[0].triangle)
        });
        let mut first = vec![NONE; surface.triangles.len()];
        let (mut samples, mut next) = (Vec::new(), Vec::new());
        for (place, triangle) in vertices.chain(edges) {
            let sample = samples.len() as u32;
            samples.push(place);
            next.push(std::mem::replace(&mut first[triangle as usize], sample));
        }
        Self {
            samples,
            next,
            first,
            original: Bvh::new(mesh),
            moves: Vec::new(),
            largest: 0.0,
            here: 0.0,
        }
    }

    /// Whether the deviation stays within `limit` if the triangles `old` are replaced by those with corners at `new`, all
    /// of which have one at `merged`.
    pub fn stays_within(
        &mut self,
        limit: f64,
        old: &[&[u32]; 2],
        new: &[[DVec3; 3]],
        merged: DVec3,
    ) -> bool {
        let limit_sq = limit * limit;
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
        self.here = 0.0;
        for place in std::iter::once(merged).chain(middles) {
            match self.original.closest_within(place, limit) {
                Some(found) => self.here = self.here.max(found.distance_sq.sqrt()),
                None => return false,
            }
        }
        self.moves.clear();
        for &t in old.iter().copied().flatten() {
            let mut sample = self.first[t as usize];
            while sample != NONE {
                let place = self.samples[sample as usize];
                let mut best = (f64::INFINITY, 0);
                for (i, corners) in (0_u32..).zip(new) {
                    let distance_sq = distance_sq_to_triangle(place, *corners);
                    if distance_sq < best.0 {
                        best = (distance_sq, i);
                    }
                }
                if best.0 > limit_sq {
                    return false;
                }
                self.here = self.here.max(best.0.sqrt());
                self.moves.push((sample, best.1));
                sample = self.next[sample as usize];
            }
        }
        true
    }

    /// Hands the samples over, after the collapse that was examined last.
    pub fn accept(&mut self, old: &[&[u32]; 2], new: &[u32]) {
        self.largest = self.largest.max(self.here);
        for &t in old.iter().copied().flatten() {
            self.first[t as usize] = NONE;
        }
        for &(sample, i) in &self.moves {
            let first = &mut self.first[new[i as usize] as usize];
            self.next[sample as usize] = std::mem::replace(first, sample);
        }
    }
}
