//! The proof that facets keep the distance.
//!
//! The distance to one triangle is a convex function, so over a facet its largest value is at a corner: no point of the
//! facet is farther from the mesh than the least, over some triangles, of the largest distance of its corners to them. Where
//! that bound is too weak the facet is cut. The smallest distance is that between facet and triangles, by exact distances.

use crate::field::Field;
use glam::DVec3;

/// How often a facet may be halved each way until the bound is strong enough.
const MOST_CUTS: u32 = 5;

/// Whether no point of a facet is nearer to the triangles than `least` or farther than `most`; `hints` are triangles near its
/// corners.
pub(crate) fn keeps_distance(
    field: &Field<'_>,
    facet: [DVec3; 3],
    [least, most]: [f64; 2],
    hint: u32,
) -> bool {
    is_within(field, facet, most, hint, MOST_CUTS) && !field.bvh().comes_within(facet, least)
}

fn is_within(field: &Field<'_>, facet: [DVec3; 3], most: f64, hint: u32, cuts: u32) -> bool {
    let middle = (facet[0] + facet[1] + facet[2]) / 3.0;
    let center = field.near(middle, hint);
    let distance_to = |triangle: u32| {
        let corners = field.bvh().corners(triangle);
        facet
            .iter()
            .map(|&p| ravec_mesh::distance_sq_to_triangle(p, corners))
            .fold(0.0, f64::max)
            .sqrt()
    };
    if center.distance > most {
        return false;
    }
    if distance_to(center.triangle) <= most {
        return true;
    }
    let near = facet.map(|p| field.near(p, center.triangle));
    if near.iter().any(|near| near.distance > most) {
        return false;
    }
    if near.iter().any(|near| distance_to(near.triangle) <= most) {
        return true;
    }
    if cuts == 0 {
        return false;
    }
    let [a, b, c] = facet;
    let [ab, bc, ca] = [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0];
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        .into_iter()
        .all(|part| is_within(field, part, most, center.triangle, cuts - 1))
}
