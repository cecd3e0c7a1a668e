//! Proofs that facets keep the distance, and the tilt of facets.
//!
//! The distance to one triangle is convex, so over a facet it is largest at a corner: no point of the facet is farther from the
//! mesh than the minimum, over some triangles, of the maximum distance of the corners. Where this bound is too weak the facet
//! is divided. The minimum distance is that between facet and triangles, computed exactly.

use super::clip::is_covered;
use super::tightened;
use crate::domain::{Field, Near};
use crate::surface::Room;
use glam::DVec3;
use ravec_mesh::distance_sq_to_triangle;

/// Bound on the halvings of a facet.
pub(crate) const MAX_CUTS: u32 = 8;

/// Returns whether no point of a facet is nearer to the triangles than the first limit or farther than the second; `hints` are
/// triangles that may be close to its corners.
pub(crate) fn keeps_distance(
    field: &Field<'_>,
    facet: [DVec3; 3],
    limits: [f64; 2],
    hints: [u32; 3],
) -> bool {
    room_kept(field, facet, limits, limits[0], hints).is_some()
}

/// As [`keeps_distance`], with the room below the facet: ample if no point is nearer than `ample` either.
pub(crate) fn room_kept(
    field: &Field<'_>,
    facet: [DVec3; 3],
    [least, most]: [f64; 2],
    ample: f64,
    hints: [u32; 3],
) -> Option<Room> {
    if !stays_near(field, facet, most, hints) {
        None
    } else if !field.bvh().comes_within(facet, ample.max(least)) {
        Some(Room::Ample)
    } else if ample > least && !field.bvh().comes_within(facet, least) {
        Some(Room::Enough)
    } else {
        None
    }
}

/// As [`keeps_distance`], with the stricter limits of [`tightened`], for a facet with known closest points of its corners.
pub(crate) fn proved(
    field: &Field<'_>,
    facet: [DVec3; 3],
    limits: [f64; 2],
    near: [Near; 3],
) -> bool {
    let [least, most] = tightened(field, facet, near, limits);
    let triangles = near.map(|near| near.triangle);
    near.iter().all(|near| near.distance <= most)
        && is_near_everywhere(field, facet, most, triangles)
        && !field.bvh().comes_within(facet, least)
}

fn stays_near(field: &Field<'_>, facet: [DVec3; 3], most: f64, hints: [u32; 3]) -> bool {
    // most often no search is needed
    if any_near_enough(field, facet, most, hints) {
        return true;
    }
    let center = field.near((facet[0] + facet[1] + facet[2]) / 3.0, hints[0]);
    if center.distance > most {
        return false;
    }
    if any_near_enough(field, facet, most, [center.triangle; 3]) {
        return true;
    }
    let near = [0, 1, 2].map(|i| field.near(facet[i], hints[i]));
    near.iter().all(|near| near.distance <= most)
        && is_near_everywhere(field, facet, most, near.map(|near| near.triangle))
}

/// As [`is_within`], by clipping first if the field asks for that.
fn is_near_everywhere(field: &Field<'_>, facet: [DVec3; 3], most: f64, near: [u32; 3]) -> bool {
    any_near_enough(field, facet, most, near)
        || field.has_large_facets && is_covered(field, facet, most, near[0])
        || is_within(field, facet, most, near, MAX_CUTS)
}

/// Returns whether no point of a facet is farther than `most`; `near` are the triangles closest to its corners, which are near
/// enough.
fn is_within(field: &Field<'_>, facet: [DVec3; 3], most: f64, near: [u32; 3], cuts: u32) -> bool {
    if any_near_enough(field, facet, most, near) {
        return true;
    }
    let [a, b, c] = facet;
    let center = field.near((a + b + c) / 3.0, near[0]);
    if center.distance > most {
        return false;
    }
    if is_near_enough(field, facet, most, center.triangle) {
        return true;
    }
    if cuts == 0 {
        return false;
    }
    let [ab, bc, ca] = [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0];
    let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
    // most parts are near enough to the triangle closest to their outer corner, or to the center
    let [ta, tb, tc] = near;
    let likely = [ta, tb, tc, center.triangle];
    let is_open: [bool; 4] =
        std::array::from_fn(|i| !is_near_enough(field, parts[i], most, likely[i]));
    let mut found = [center.triangle; 3];
    for (k, place) in [ab, bc, ca].into_iter().enumerate() {
        if is_open[3] || is_open[k] || is_open[(k + 1) % 3] {
            let near = field.near(place, near[k]);
            if near.distance > most {
                return false;
            }
            found[k] = near.triangle;
        }
    }
    let [tab, tbc, tca] = found;
    let near = [
        [ta, tab, tca],
        [tab, tb, tbc],
        [tca, tbc, tc],
        [tab, tbc, tca],
    ];
    (0..4)
        .filter(|&i| is_open[i])
        .all(|i| is_within(field, parts[i], most, near[i], cuts - 1))
}

/// Returns whether one of three triangles is near enough to all corners.
fn any_near_enough(field: &Field<'_>, facet: [DVec3; 3], most: f64, [r, s, t]: [u32; 3]) -> bool {
    let is_near = |triangle: u32| is_near_enough(field, facet, most, triangle);
    is_near(r) || (s != r && is_near(s)) || (t != s && t != r && is_near(t))
}

fn is_near_enough(field: &Field<'_>, facet: [DVec3; 3], most: f64, triangle: u32) -> bool {
    let corners = field.bvh().corners(triangle);
    (facet.iter()).all(|&p| distance_sq_to_triangle(p, corners) <= most * most)
}

/// Tilt of a facet against the surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tilt {
    /// Cosine of the angle between the facet and the surface that it represents, at the center of the facet; -1 if either has
    /// no direction.
    pub cosine: f64,
    /// Triangle closest to the center.
    pub triangle: u32,
}

/// Computes the tilt of a facet by a search from a triangle near its center.
pub(crate) fn tilt(field: &Field<'_>, facet: [DVec3; 3], hint: u32) -> Tilt {
    tilt_from(field, facet, |middle| field.near(middle, hint))
}

/// Estimates the tilt of a facet, assuming that one of the `likely` triangles is closest to its center.
pub(crate) fn likely_tilt(field: &Field<'_>, facet: [DVec3; 3], likely: &[u32]) -> Tilt {
    tilt_from(field, facet, |middle| field.nearest_of(middle, likely))
}

#[inline]
fn tilt_from(field: &Field<'_>, [a, b, c]: [DVec3; 3], near: impl Fn(DVec3) -> Near) -> Tilt {
    let normal = (b - a).cross(c - a);
    let Near { triangle, away, .. } = near((a + b + c) / 3.0);
    // the surface inside a solid faces its triangles
    let outward = if field.level < 0.0 { -away } else { away };
    let length = normal.length() * away.length();
    let cosine = if length > 0.0 {
        (normal.dot(outward) / length).clamp(-1.0, 1.0)
    } else {
        -1.0
    };
    Tilt { cosine, triangle }
}
