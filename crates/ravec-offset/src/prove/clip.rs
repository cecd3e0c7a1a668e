//! Upper bounds of the distance for facets far larger than the distance.
//!
//! A facet over a flat face spans many of its triangles, and halving it would end only at parts smaller than the distance. So it
//! is clipped instead, by the planes through the sides of the triangle nearest to its center, a little outside: the part over the
//! triangle is near to it, and the others are clipped by the triangles nearest to them.

use crate::domain::Field;
use glam::DVec3;
use ravec_mesh::distance_sq_to_triangle;

/// Bound on the parts of a facet.
const MAX_PARTS: usize = 600;

/// Share of the way by which a part may reach over the sides of its triangle.
const OVERHANG: f64 = 0.7;

/// Returns whether no point of a facet is farther than `most` from the triangles, if that can be shown by clipping.
pub(super) fn is_covered(field: &Field<'_>, facet: [DVec3; 3], most: f64, hint: u32) -> bool {
    let mut open: Vec<Vec<DVec3>> = vec![facet.to_vec()];
    let mut parts = 0;
    while let Some(mut part) = open.pop() {
        parts += 1;
        if parts > MAX_PARTS {
            return false;
        }
        let center = part.iter().sum::<DVec3>() / part.len() as f64;
        let near = field.near(center, hint);
        let triangle = field.bvh().corners(near.triangle);
        let is_near = |p: &DVec3| distance_sq_to_triangle(*p, triangle) <= most * most;
        if part.iter().all(is_near) {
            continue;
        }
        let normal = field.normal(near.triangle);
        let height = (center - triangle[0]).dot(normal).abs();
        if near.distance > most || height >= most {
            return false;
        }
        let overhang = OVERHANG * (most * most - height * height).sqrt();
        for i in 0..3 {
            let [from, to] = [triangle[i], triangle[(i + 1) % 3]];
            let outward = (to - from).cross(normal).normalize_or_zero();
            let [inside, outside] = split(&part, |p| (p - from).dot(outward) - overhang);
            if inside.len() < 3 {
                return false;
            }
            part = inside;
            if outside.len() >= 3 {
                open.push(outside);
            }
        }
        let is_near = |p: &DVec3| distance_sq_to_triangle(*p, triangle) <= most * most;
        if !part.iter().all(is_near) {
            return false;
        }
    }
    true
}

/// Splits a convex polygon into the parts where a linear function is at most zero, and at least.
fn split(polygon: &[DVec3], value: impl Fn(DVec3) -> f64) -> [Vec<DVec3>; 2] {
    let (mut inside, mut outside) = (Vec::new(), Vec::new());
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (at_p, at_q) = (value(p), value(q));
        if at_p <= 0.0 {
            inside.push(p);
        }
        if at_p >= 0.0 {
            outside.push(p);
        }
        if at_p * at_q < 0.0 {
            let crossing = p.lerp(q, at_p / (at_p - at_q));
            inside.push(crossing);
            outside.push(crossing);
        }
    }
    let is_inside_only = polygon.iter().all(|&p| value(p) <= 0.0);
    if is_inside_only {
        outside.clear();
    }
    [inside, outside]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Solid;
    use ravec_mesh::{Bvh, TriMesh};
    use ravec_progress::Progress;

    /// A flat sheet of narrow triangles, with or without one of them.
    fn sheet(left_out: Option<usize>) -> TriMesh {
        let n = 40;
        let positions = (0..=n).flat_map(|i| {
            let x = f64::from(i);
            [DVec3::new(x, 0.0, 0.0), DVec3::new(x, 30.0, 0.0)]
        });
        let mut triangles: Vec<[u32; 3]> = (0..n as u32)
            .flat_map(|i| {
                let [a, b, c, d] = [2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        if let Some(t) = left_out {
            triangles.remove(t);
        }
        TriMesh::new(positions.collect(), triangles).unwrap()
    }

    #[test]
    fn facets_over_many_triangles_are_near_to_them_unless_one_is_missing() {
        let facet = [[1.0, 1.0, 0.01], [39.0, 15.0, 0.01], [2.0, 29.0, 0.01]].map(DVec3::from);
        for (left_out, expected) in [(None, true), (Some(21), false)] {
            let mesh = sheet(left_out);
            let bvh = Bvh::new(&mesh);
            let field = Field::new(&bvh, Solid::No, 0.01, &Progress::none()).unwrap();
            assert_eq!(is_covered(&field, facet, 0.0105, 0), expected);
            assert!(!is_covered(&field, facet, 0.0099, 0));
        }
    }
}
