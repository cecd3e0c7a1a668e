//! Stricter limits for facets across crests and tips of the surface.
//!
//! The distance of a facet from the triangles bounds its distance from the surface only where the field grows at unit rate.
//! From a crest where two sheets meet at an angle α it grows by sin(α/2), and from a tip of three sheets by less. A crest that
//! a facet cuts off at a height h of the field is h / sin(α/2) away.
//!
//! Does not guarantee: to see all sheets; they are sampled at the corners of a facet, at its center and one step above that.
//! Crests more acute than 5° are not followed to their ends.

use crate::domain::{Field, Near};
use crate::grow::ON_SURFACE;
use glam::DVec3;

/// Largest cosine between directions that are examined more closely; smaller spreads tighten the limits by at most an eighth.
const SPREAD_OF_CREST: f64 = 0.5;

/// Distance from the surface, as a share of the tolerance, beyond which corners may be closer to triangles that are not known.
const OFF_SURFACE: f64 = 0.1;

/// Smallest share of the limits: crests more acute than about 5° are not followed to their ends.
const MIN_SHARE: f64 = 0.04;

/// [`MIN_SHARE`] where the surface consists of the triangles themselves: crests more acute than a right angle count as right
/// angles. Overlapping solids make crests of any angle at every fold of a rough sheet, which would require cells below the
/// smallest; right angles are those between walls and skins.
const MIN_SHARE_OF_SURFACE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Returns the limits for a facet that may cut a crest or a tip, with known closest points of its corners.
pub(crate) fn tightened(
    field: &Field<'_>,
    facet: [DVec3; 3],
    near: [Near; 3],
    limits: [f64; 2],
) -> [f64; 2] {
    let [least, most] = limits;
    let of_corners = spread(&near);
    let growth = if of_corners >= SPREAD_OF_CREST {
        growth_between(of_corners)
    } else if field.level == 0.0 {
        growth_between(spread_of_border(field, near, limits)).max(MIN_SHARE_OF_SURFACE)
    } else {
        growth_beside(field, facet, near, most - least)
    };
    let share = growth.clamp(MIN_SHARE, 1.0);
    let (middle, half) = (0.5 * (least + most), 0.5 * (most - least));
    [middle - share * half, middle + share * half]
}

/// Growth rate of the distance from a crest between two sheets, by the cosine of the directions away from them.
fn growth_between(cosine: f64) -> f64 {
    (0.5 * (1.0 + cosine)).max(0.0).sqrt()
}

/// [`growth_between`] for a facet that cuts a crest where another sheet may end it at a right angle.
fn growth_beside(field: &Field<'_>, facet: [DVec3; 3], near: [Near; 3], range: f64) -> f64 {
    // a corner where three sheets meet shows only one of them; where two are equally near, a step off one reaches the other
    let middle = (facet[0] + facet[1] + facet[2]) / 3.0;
    let of_middle = field.near(middle, near[0].triangle);
    let beyond = field.near(middle + 0.25 * range * of_middle.away, of_middle.triangle);
    let [a, b, c] = near.map(|near| near.away);
    let growth = nearest_of_hull(&[a, b, c, of_middle.away, beyond.away]).length();
    growth / growth.hypot(1.0)
}

/// Returns the point of the convex hull of unit vectors that is nearest to zero, if it lies on an edge or a face.
fn nearest_of_hull(vectors: &[DVec3]) -> DVec3 {
    let mut nearest = vectors[0];
    let mut offer = |p: DVec3| {
        if p.length_squared() < nearest.length_squared() {
            nearest = p;
        }
    };
    for (i, &a) in vectors.iter().enumerate() {
        for (j, &b) in vectors[..i].iter().enumerate() {
            offer(0.5 * (a + b));
            for &c in &vectors[..j] {
                let normal = (b - a).cross(c - a);
                let foot = normal * (a.dot(normal) / normal.length_squared());
                let is_left = |p: DVec3, q: DVec3| (q - p).cross(foot - p).dot(normal) >= 0.0;
                if is_left(a, b) && is_left(b, c) && is_left(c, a) {
                    offer(foot);
                }
            }
        }
    }
    nearest
}

/// Returns the closest point to a corner of a facet among some triangles near it; among all, if these are farther than the
/// surface.
pub(crate) fn near_corner(
    field: &Field<'_>,
    corner: DVec3,
    hints: &[u32],
    [least, most]: [f64; 2],
) -> Near {
    let guess = field.nearest_of(corner, hints);
    let (middle, half) = (0.5 * (least + most), 0.5 * (most - least));
    if guess.distance <= middle + OFF_SURFACE * half {
        guess
    } else {
        field.near(corner, guess.triangle)
    }
}

/// [`spread`] of the border only, where the surface consists of the triangles themselves: other triangles end at the border
/// from within, at any angle, without a crest.
fn spread_of_border(field: &Field<'_>, near: [Near; 3], [least, most]: [f64; 2]) -> f64 {
    let step = ON_SURFACE * 0.5 * (most - least);
    let is_border = near.map(|near| field.is_border(near.point, near.away, step));
    let pairs = [(0, 1), (1, 2), (2, 0)].into_iter();
    pairs
        .filter(|&(i, j)| is_border[i] && is_border[j])
        .map(|(i, j)| near[i].away.dot(near[j].away))
        .fold(1.0, f64::min)
}

/// Smallest cosine between two of the directions away from the closest points.
pub(crate) fn spread(near: &[Near]) -> f64 {
    let pairs = (near.iter().enumerate()).flat_map(|(i, a)| near[..i].iter().map(move |b| (a, b)));
    pairs.map(|(a, b)| a.away.dot(b.away)).fold(1.0, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_grow_as_slowly_as_sheets_meet_acutely() {
        let [x, y, z] = DVec3::AXES;
        let growth = |aways: &[DVec3]| nearest_of_hull(aways).length();
        assert!((growth(&[x, x]) - 1.0).abs() < 1e-15);
        assert!((growth(&[x, y]) - 0.5f64.sqrt()).abs() < 1e-15);
        // the tip of a cube
        assert!((growth(&[x, y, z]) - (1.0f64 / 3.0).sqrt()).abs() < 1e-15);
        // of an acute crest, that a third sheet which leans the same way does not end
        let [a, b] = [1.0, -1.0].map(|side: f64| DVec3::new(side, 0.2, 0.0).normalize());
        assert!((growth(&[a, y, b]) - growth(&[a, b])).abs() < 1e-15);
        assert!((growth(&[a, b]) - growth_between(a.dot(b))).abs() < 1e-15);
    }
}
