//! Triangles that fit nowhere: what scans, exports and downloads are made of.

use glam::DVec3;

use super::Solid;
use super::shape::Shape;
use crate::Seed;

/// Planted defects of a soup, by index of triangle.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Planted {
    /// Triangles that repeat another one, with the same orientation.
    pub repeated: Vec<u32>,
    /// Triangles that repeat another one, flipped.
    pub flipped: Vec<u32>,
    /// Triangles without area that are segments.
    pub segments: Vec<u32>,
    /// Triangles without area that are points.
    pub points: Vec<u32>,
}

/// About `triangles` random triangles within the cube from -1 to 1, of which some share corners and edges, and one in
/// eight each is repeated, repeated and flipped, a segment, or a point. Corners are multiples of 1/64, so that exact ties
/// are common, and segments are straight to the last bit.
pub fn soup(triangles: u32, seed: Seed) -> (Solid, Planted) {
    let mut positions: Vec<DVec3> = Vec::new();
    let mut list: Vec<[u32; 3]> = Vec::new();
    let mut planted = Planted::default();
    let grid = |i: i64, c: u64| (seed.between(i, 0, c, -64.0, 64.0)).round() / 64.0;
    for i in 0..i64::from(triangles) {
        let pick = |c: u64, below: usize| (seed.bits(i, 1, c) % below as u64) as usize;
        let name = list.len() as u32;
        let kind = if list.is_empty() { 7 } else { pick(0, 8) };
        match kind {
            0 | 1 => {
                // only those with three vertices, so that it is clear what is wrong
                let [a, b, c] = list[pick(1, list.len())];
                if kind == 0 {
                    planted.repeated.push(name);
                    list.push([b, c, a]);
                } else {
                    planted.flipped.push(name);
                    list.push([a, c, b]);
                }
            }
            2 => {
                // halving and adding multiples of 1/64 is exact
                let (p, q) = (pick(1, positions.len()), pick(2, positions.len()));
                let middle = 0.5 * (positions[p] + positions[q]);
                planted.segments.push(name);
                list.push([p as u32, q as u32, positions.len() as u32]);
                positions.push(middle);
            }
            3 => {
                let p = pick(1, positions.len()) as u32;
                planted.points.push(name);
                list.push([p; 3]);
            }
            _ => {
                // one or two corners in common with what is there
                let old = if positions.is_empty() { 0 } else { pick(3, 3) };
                let mut corners = [0; 3];
                for (k, corner) in corners.iter_mut().enumerate() {
                    if k < old {
                        *corner = pick(4 + k as u64, positions.len()) as u32;
                    } else {
                        *corner = positions.len() as u32;
                        let c = 3 * k as u64;
                        positions.push(DVec3::new(grid(i, c), grid(i, c + 1), grid(i, c + 2)));
                    }
                }
                list.push(corners);
            }
        }
    }
    let shape = list.iter().map(|t| t.map(|v| positions[v as usize]));
    let shape = Shape::Triangles(shape.collect());
    (Solid::new("soup", (positions, list), shape), planted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_planted_is_there() {
        let (soup, planted) = soup(400, Seed(3));
        let triangles = soup.mesh.triangles();
        let sorted = |t: u32| {
            let mut corners = triangles[t as usize];
            corners.sort_unstable();
            corners
        };
        assert!(planted.repeated.len() > 20 && planted.flipped.len() > 20);
        assert!(planted.segments.len() > 20 && planted.points.len() > 20);
        for &t in planted.repeated.iter().chain(&planted.flipped) {
            assert!((0..t).any(|other| sorted(other) == sorted(t)));
        }
        for &t in planted.segments.iter().chain(&planted.points) {
            let [a, b, c] = soup.mesh.corners(t);
            assert_eq!((b - a).cross(c - a), DVec3::ZERO);
        }
    }
}
