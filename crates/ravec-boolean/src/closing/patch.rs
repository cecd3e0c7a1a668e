//! A surface of least area in a loop.
//!
//! All triangulations of a polygon in space are compared by dynamic programming: the best for the corners from `i` to `j` is
//! some triangle `i k j` with the best on its two other sides. Longer polygons are first drawn with fewer corners, and what
//! is between those and the polygon is filled in the same way.
//!
//! Source: Barequet and Sharir, *Filling Gaps in the Boundary of a Polyhedron*, 1995. We differ in: only the area counts, since
//! the surface where a mesh with a hole winds a half is nearly one of least area; and in the treatment of long polygons.
//!
//! Guarantees: the boundary of the triangles is the loop, whatever its corners. Does not guarantee: no self-intersection.
//! Cost: corners · 100² / 6 steps of 10 ns.

use glam::DVec3;

/// The most corners of which all triangulations are compared. The cost of a corner grows with the square, and drawing a
/// smooth loop by a hundred chords leaves out a thousandth of its area.
const MAX_CORNERS: usize = 100;

/// Cost of a unit of length of a side, as a share of the polygon's length: among equal areas, as in a plane, shorter
/// sides are chosen. More would avoid long thin triangles at the cost of area.
const LENGTH_WEIGHT: f64 = 1e-7;

/// A triangulated polygon.
#[derive(Debug, Clone, Default)]
pub(super) struct Patch {
    /// Corners of the triangles, as indices into the polygon; they run as the polygon does.
    pub triangles: Vec<[u32; 3]>,
    /// Their area.
    pub area: f64,
}

/// Fills a closed polygon. There are no triangles if it has less than three corners.
pub(super) fn fill(polygon: &[DVec3]) -> Patch {
    let mut patch = Patch::default();
    let corners: Vec<u32> = (0..polygon.len() as u32).collect();
    fill_part(polygon, &corners, &mut patch);
    patch
}

fn fill_part(polygon: &[DVec3], corners: &[u32], patch: &mut Patch) {
    let n = corners.len();
    if n <= MAX_CORNERS {
        triangulate_min_area(polygon, corners, patch);
        return;
    }
    let drawn: Vec<usize> = (0..MAX_CORNERS).map(|i| i * n / MAX_CORNERS).collect();
    for (i, &begin) in drawn.iter().enumerate() {
        let end = drawn.get(i + 1).copied().unwrap_or(n);
        // from one corner that is drawn to the next, both included, and back along the chord
        let mut part = corners[begin..end].to_vec();
        part.push(corners[end % n]);
        fill_part(polygon, &part, patch);
    }
    let drawn: Vec<u32> = drawn.into_iter().map(|i| corners[i]).collect();
    triangulate_min_area(polygon, &drawn, patch);
}

fn triangulate_min_area(polygon: &[DVec3], corners: &[u32], patch: &mut Patch) {
    let n = corners.len();
    if n < 3 {
        return;
    }
    let at: Vec<DVec3> = corners.iter().map(|&c| polygon[c as usize]).collect();
    let next = |i: usize| at[(i + 1) % n];
    let around: f64 = (0..n).map(|i| at[i].distance(next(i))).sum();
    let per_length = LENGTH_WEIGHT * around;
    // by the first and last corner of a part: what it costs, and the third corner at that side
    let mut cost = vec![0.0_f64; n * n];
    let mut third = vec![0_usize; n * n];
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            let side = at[j] - at[i];
            let mut best = (f64::INFINITY, i + 1);
            for k in i + 1..j {
                let area = 0.5 * side.cross(at[k] - at[i]).length();
                let total = cost[i * n + k] + cost[k * n + j] + area;
                if total < best.0 {
                    best = (total, k);
                }
            }
            cost[i * n + j] = best.0 + per_length * side.length();
            third[i * n + j] = best.1;
        }
    }
    let mut open = vec![(0, n - 1)];
    while let Some((i, j)) = open.pop() {
        if j - i < 2 {
            continue;
        }
        let k = third[i * n + j];
        patch.area += 0.5 * (at[j] - at[i]).cross(at[k] - at[i]).length();
        patch.triangles.push([i, k, j].map(|i| corners[i]));
        open.extend([(i, k), (k, j)]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::TAU;

    /// All triangulations, one after the other: the judge.
    fn triangulate_min_area_naive(polygon: &[DVec3]) -> f64 {
        let n = polygon.len();
        if n < 3 {
            return 0.0;
        }
        let parts = (1..n - 1).map(|k| {
            let triangle = 0.5
                * (polygon[n - 1] - polygon[0])
                    .cross(polygon[k] - polygon[0])
                    .length();
            triangle
                + triangulate_min_area_naive(&polygon[..=k])
                + triangulate_min_area_naive(&polygon[k..])
        });
        parts.fold(f64::INFINITY, f64::min)
    }

    /// The sides that are not used as often backward as forward.
    fn boundary(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
        let sides = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        let all: Vec<_> = triangles.iter().flat_map(sides).collect();
        let mut left: Vec<_> = all
            .iter()
            .filter(|[a, b]| !all.contains(&[*b, *a]))
            .copied()
            .collect();
        left.sort_unstable();
        left
    }

    proptest! {
        #[test]
        fn no_triangulation_has_less_area(
            places in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 3..9)
        ) {
            let polygon: Vec<_> = places.into_iter().map(DVec3::from_array).collect();
            let patch = fill(&polygon);
            prop_assert_eq!(patch.triangles.len(), polygon.len() - 2);
            // the weight of lengths may cost that much: at most 5 chords of 2·√3 in 8 sides of that
            let allowed = LENGTH_WEIGHT * 5.0 * 8.0 * 12.0;
            prop_assert!(patch.area <= triangulate_min_area_naive(&polygon) + allowed);
        }
    }

    #[test]
    fn a_long_loop_is_filled_like_a_short_one() {
        for n in [3, 100, 101, 150, 1000, 12345] {
            let polygon: Vec<_> = (0..n)
                .map(|i| {
                    DVec3::new(
                        (TAU * i as f64 / n as f64).cos(),
                        (TAU * i as f64 / n as f64).sin(),
                        0.0,
                    )
                })
                .collect();
            let patch = fill(&polygon);
            let mut sides: Vec<_> = (0..n as u32).map(|i| [i, (i + 1) % n as u32]).collect();
            sides.sort_unstable();
            assert_eq!(boundary(&patch.triangles), sides);
            let area = 0.5 * n as f64 * (TAU / n as f64).sin();
            assert!(
                (patch.area - area).abs() < 1e-9,
                "{n}: {} and not {area}",
                patch.area
            );
        }
    }
}
