//! Moved faces that turned over, and the flips of edges that turn them back.
//!
//! A flat face of a mesh is often cut into slivers, such as those from a corner of a plate to the rim of a hole. Where the rim
//! moves by more than a sliver is wide, the moved sliver is turned over and covers its neighbors, although the face as a
//! whole is as it should be. A flip of the edge between two such triangles covers the same place without the fold.
//!
//! Guarantees: only triangles that came from triangles in about one plane are changed, and no point. Does not guarantee that
//! none stays turned over: the surface is proved and searched for intersections afterwards.

use super::assembly::Moved;
use glam::DVec3;
use rustc_hash::FxHashMap;

/// Smallest cosine between the normals of two triangles that count as parts of one flat face.
const IN_PLANE: f64 = 1.0 - 1e-9;

/// Bound on the flips, by triangle that is turned over.
const MAX_FLIPS: usize = 16;

/// Flips edges between the triangles from `first` on, which came from triangles with these normals, until none is turned over
/// or no flip helps.
pub(super) fn unfold(moved: &mut Moved, first: usize, normals: &[DVec3]) {
    let mut faces = Faces {
        positions: &moved.positions,
        triangles: &mut moved.triangles[first..],
        normals,
        left_of: FxHashMap::default(),
    };
    let mut folded: Vec<usize> = (0..normals.len())
        .filter(|&t| faces.area(faces.triangles[t], t) <= 0.0)
        .collect();
    if folded.is_empty() {
        return;
    }
    for t in 0..normals.len() {
        faces.enter(t);
    }
    let mut flips = MAX_FLIPS * folded.len();
    while let Some(t) = folded.pop() {
        if flips == 0 {
            return;
        }
        if faces.area(faces.triangles[t], t) > 0.0 {
            continue;
        }
        if let Some(other) = faces.flip_best(t) {
            flips -= 1;
            folded.extend([t, other]);
        }
    }
}

/// Moved triangles and what they came from.
struct Faces<'a> {
    positions: &'a [DVec3],
    triangles: &'a mut [[u32; 3]],
    normals: &'a [DVec3],
    /// The triangle on the left of each side.
    left_of: FxHashMap<[u32; 2], usize>,
}

/// A flip of the edge between two triangles.
struct Flip {
    other: usize,
    /// The triangles after it.
    pair: [[u32; 3]; 2],
    /// The smaller of their areas.
    area: f64,
}

impl Faces<'_> {
    /// Twice the area of a triangle as seen along the normal of face `t`; negative if it is turned over.
    fn area(&self, triangle: [u32; 3], t: usize) -> f64 {
        let [a, b, c] = triangle.map(|v| self.positions[v as usize]);
        (b - a).cross(c - a).dot(self.normals[t])
    }

    fn enter(&mut self, t: usize) {
        let [a, b, c] = self.triangles[t];
        for side in [[a, b], [b, c], [c, a]] {
            self.left_of.insert(side, t);
        }
    }

    /// Flips the edge of face `t` after which the smaller of both areas is largest, if it grows; gives the face across.
    fn flip_best(&mut self, t: usize) -> Option<usize> {
        let flips = (0..3).filter_map(|i| self.flip(t, i));
        let best = flips.max_by(|a, b| a.area.total_cmp(&b.area))?;
        for side in [t, best.other].map(|t| self.triangles[t]) {
            let [a, b, c] = side;
            for side in [[a, b], [b, c], [c, a]] {
                self.left_of.remove(&side);
            }
        }
        [self.triangles[t], self.triangles[best.other]] = best.pair;
        self.enter(t);
        self.enter(best.other);
        Some(best.other)
    }

    /// The flip of one side of face `t`, if it is possible and an improvement.
    fn flip(&self, t: usize, side: usize) -> Option<Flip> {
        let [a, b, c] = [0, 1, 2].map(|k| self.triangles[t][(side + k) % 3]);
        let &other = self.left_of.get(&[b, a])?;
        if self.normals[t].dot(self.normals[other]) < IN_PLANE {
            return None;
        }
        let d = (self.triangles[other].into_iter()).find(|&v| v != a && v != b)?;
        let is_taken = |side: [u32; 2]| self.left_of.contains_key(&side);
        if c == d || is_taken([c, d]) || is_taken([d, c]) {
            return None;
        }
        let pair = [[a, d, c], [d, b, c]];
        let least = |pair: [[u32; 3]; 2]| self.area(pair[0], t).min(self.area(pair[1], t));
        let before = least([self.triangles[t], self.triangles[other]]);
        let area = least(pair);
        (area > before).then_some(Flip { other, pair, area })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sliver_that_turned_over_is_unfolded() {
        // a fan from the origin over a rim, whose second point has moved beyond the line to the next one
        let positions = [
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 1.0],
            [9.0, 0.89],
            [9.0, 3.0],
        ];
        let mut moved = Moved {
            positions: positions.map(|[x, y]| DVec3::new(x, y, 1.0)).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3], [0, 3, 4]],
            bases: vec![0, 1, 2],
        };
        let before = moved.triangles.clone();
        let area = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| moved.positions[v as usize]);
            (b - a).cross(c - a).z
        };
        assert!(area(before[1]) < 0.0);
        let sum: f64 = before.iter().map(|&t| area(t)).sum();
        let mut flat = Moved {
            positions: moved.positions.clone(),
            ..std::mem::take(&mut moved)
        };
        unfold(&mut flat, 0, &[DVec3::Z; 3]);
        let area = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| flat.positions[v as usize]);
            (b - a).cross(c - a).z
        };
        assert!(flat.triangles.iter().all(|&t| area(t) > 0.0));
        let after: f64 = flat.triangles.iter().map(|&t| area(t)).sum();
        assert!((after - sum).abs() < 1e-12);
    }

    #[test]
    fn edges_between_planes_stay() {
        let mut moved = Moved {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, -DVec3::Y],
            triangles: vec![[0, 2, 1], [0, 1, 3]],
            bases: vec![0, 1],
        };
        let before = moved.triangles.clone();
        unfold(&mut moved, 0, &[DVec3::Z, DVec3::Y]);
        assert_eq!(moved.triangles, before);
    }
}
