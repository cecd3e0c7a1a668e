//! The proof that facets keep the distance, and how far their normals are off.
//!
//! The distance to one triangle is a convex function, so over a facet its largest value is at a corner: no point of the
//! facet is farther from the mesh than the least, over some triangles, of the largest distance of its corners to them. Where
//! that bound is too weak the facet is cut. The smallest distance is that between facet and triangles, by exact distances.

use crate::field::Field;
use glam::DVec3;
use ravec_mesh::distance_sq_to_triangle;

/// How often a facet may be halved each way until the bound is strong enough.
const MOST_CUTS: u32 = 5;

/// Crests that are more acute than about 10° are not followed to their end.
const LEAST_SHARE: f64 = 0.08;

/// Whether no point of a facet is nearer to the triangles than `least` or farther than `most`; `hints` are triangles that
/// may be close to its corners.
pub(crate) fn keeps_distance(
    field: &Field<'_>,
    facet: [DVec3; 3],
    [least, most]: [f64; 2],
    hints: [u32; 3],
) -> bool {
    is_within(field, facet, most, hints, MOST_CUTS) && !field.bvh().comes_within(facet, least)
}

fn is_within(field: &Field<'_>, facet: [DVec3; 3], most: f64, hints: [u32; 3], cuts: u32) -> bool {
    let holds = |triangle: u32| {
        let corners = field.bvh().corners(triangle);
        facet
            .iter()
            .all(|&p| distance_sq_to_triangle(p, corners) <= most * most)
    };
    // most often no search is needed
    if holds(hints[0])
        || (hints[1] != hints[0] && holds(hints[1]))
        || (hints[2] != hints[1] && hints[2] != hints[0] && holds(hints[2]))
    {
        return true;
    }
    let middle = (facet[0] + facet[1] + facet[2]) / 3.0;
    let center = field.near(middle, hints[0]);
    if center.distance > most {
        return false;
    }
    if holds(center.triangle) {
        return true;
    }
    let near = [0, 1, 2].map(|i| field.near(facet[i], hints[i]));
    if near.iter().any(|near| near.distance > most) {
        return false;
    }
    if near.iter().any(|near| holds(near.triangle)) {
        return true;
    }
    if cuts == 0 {
        return false;
    }
    let [a, b, c] = facet;
    let [ab, bc, ca] = [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0];
    let [ta, tb, tc] = near.map(|near| near.triangle);
    let t = center.triangle;
    [
        ([a, ab, ca], [ta, t, t]),
        ([ab, b, bc], [t, tb, t]),
        ([ca, bc, c], [t, t, tc]),
        ([ab, bc, ca], [t, t, t]),
    ]
    .into_iter()
    .all(|(part, hints)| is_within(field, part, most, hints, cuts - 1))
}

/// Limits for a facet that may cut a crest. Where two sheets meet at an angle α, the distance grows by sin(α/2) only on the
/// way from the crest, so that a facet across it must keep the distance that much better.
pub(crate) fn tightened(
    field: &Field<'_>,
    facet: [DVec3; 3],
    [least, most]: [f64; 2],
    hints: [u32; 3],
) -> [f64; 2] {
    let away = [0, 1, 2].map(|i| field.near_of(facet[i], hints[i]).away);
    let most_apart = away[0]
        .dot(away[1])
        .min(away[1].dot(away[2]))
        .min(away[2].dot(away[0]));
    let half_opening_sine = (0.5 * (1.0 + most_apart)).max(0.0).sqrt();
    let share = half_opening_sine.clamp(LEAST_SHARE, 1.0);
    let (middle, half) = (0.5 * (least + most), 0.5 * (most - least));
    [middle - share * half, middle + share * half]
}

/// The angle in radians between a facet and the surface that it stands for, at the facet's middle; `hints` are triangles
/// that may be close to its corners.
pub(crate) fn normal_deviation(
    field: &Field<'_>,
    facet: [DVec3; 3],
    hints: [u32; 3],
    enough: f64,
) -> f64 {
    let [a, b, c] = facet;
    let normal = (b - a).cross(c - a);
    let middle = (a + b + c) / 3.0;
    let off = |away: DVec3| {
        // the surface inside a solid faces its triangles
        let outward = if field.level < 0.0 { -away } else { away };
        let length = normal.length() * away.length();
        if length > 0.0 {
            (normal.dot(outward) / length).clamp(-1.0, 1.0).acos()
        } else {
            std::f64::consts::PI
        }
    };
    // a guess from what is known, and a search only if that is not good enough
    let guess = hints
        .map(|triangle| field.near_of(middle, triangle))
        .into_iter()
        .min_by(|a, b| a.distance.total_cmp(&b.distance));
    if let Some(guess) = guess {
        let deviation = off(guess.away);
        if deviation <= enough {
            return deviation;
        }
    }
    off(field.near(middle, hints[0]).away)
}
