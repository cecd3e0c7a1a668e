//! Minimum and maximum distance of the finished surface, proved facet by facet.
//!
//! The distance at corners and centers of facets is exact and estimates the extremes. Then each facet is proved to stay between
//! them: from below by the exact distance of triangles, with a search where a facet comes closer, so the minimum is that of the
//! surface; from above by the bound of [`keeps_distance`], for which facets are divided, so the maximum is a bound within a
//! share of the tolerance.
//!
//! Guarantees: no point of the surface is nearer than `least` or farther than `most`. A facet that counts as unproved may still
//! be within the limits. Cost: a search per vertex, a proof per facet unless repair proved it already.

use crate::domain::Field;
use crate::prove::{MAX_CUTS, keeps_distance};
use crate::report::Measured;
use glam::DVec3;
use ravec_mesh::{TriMesh, distance_sq_to_triangle};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Gap between the proved minimum distance and the surface, as a share of the tolerance.
const MIN_SLACK: f64 = 1e-3;

/// Gap between the farthest sample and the bound of a facet that is accepted without division, as a share of the tolerance.
/// Halving it divides facets on fine input once more, at four times the cost.
const MAX_SLACK: f64 = 0.25;

/// Facets known to keep a distance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ample<'a> {
    pub distance: f64,
    /// For each facet, whether it is one; empty if none is.
    pub facets: &'a [bool],
}

impl Ample<'_> {
    fn contains(&self, facet: u32) -> bool {
        self.facets.get(facet as usize) == Some(&true)
    }
}

/// Proves that facets keep the distance within limits, and measures the extremes; `ample` facets are not proved again.
pub(crate) fn measure(
    field: &Field<'_>,
    surface: &TriMesh,
    limits: [f64; 2],
    ample: Ample<'_>,
    progress: &Progress,
) -> Result<Measured, Cancelled> {
    let corners = nearest_of_vertices(field, surface, progress)?;
    let hints = |t: u32| surface.triangles()[t as usize].map(|v| corners[v as usize].1);
    let facets = surface.triangles().len() as u32;
    let found = corners.iter().map(|&(distance, _)| distance);
    let [least_at_corners, most_at_corners] = spanned([f64::INFINITY, 0.0], found);
    let middles: Vec<(bool, f64)> = (0..facets)
        .into_par_iter()
        .map(|t| {
            progress.check()?;
            let corners = surface.corners(t);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let is_ample = ample.contains(t);
            // the distance of an ample facet matters only if it is large
            let max_sq = most_at_corners * most_at_corners;
            let is_near = |&triangle: &u32| {
                distance_sq_to_triangle(middle, field.bvh().corners(triangle)) <= max_sq
            };
            let distance = if is_ample && hints(t).iter().any(is_near) {
                most_at_corners
            } else {
                field.near(middle, hints(t)[0]).distance
            };
            Ok((is_ample, distance))
        })
        .collect::<Result<_, Cancelled>>()?;
    let [least_found, max_found] = spanned(
        [least_at_corners, most_at_corners],
        middles.iter().map(|&(_, distance)| distance),
    );
    let half = 0.5 * (limits[1] - limits[0]);
    let least = (least_found - MIN_SLACK * half).max(0.0);
    let enough = (max_found + MAX_SLACK * half).min(limits[1]);
    let phase = progress.phase("measure", u64::from(facets));
    let extremes = |t: u32| {
        progress.check()?;
        phase.advance(1);
        let facet = surface.corners(t);
        let nearest = if least <= ample.distance && middles[t as usize].0 {
            least
        } else {
            least_distance(field, facet, least, MIN_SLACK * half)
        };
        let levels = [max_found, enough, limits[1]];
        let farthest = most_distance(field, facet, levels, hints(t), MAX_CUTS);
        if nearest >= limits[0] && farthest <= limits[1] {
            return Ok((0, nearest, farthest));
        }
        // the minimum is known up to a slack, and the search for a bound differs from the proof
        let is_proved = keeps_distance(field, facet, limits, hints(t));
        let farthest = if is_proved { limits[1] } else { farthest };
        Ok((u64::from(!is_proved), nearest, farthest))
    };
    let (unproved, least, most) = (0..facets).into_par_iter().map(extremes).try_reduce(
        || (0, least, max_found),
        |a, b| Ok((a.0 + b.0, a.1.min(b.1), a.2.max(b.2))),
    )?;
    Ok(Measured {
        unproved,
        least,
        most,
        max_found,
    })
}

/// Extends a range by values.
fn spanned(limits: [f64; 2], values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold(limits, |[least, most], value| {
        [least.min(value), most.max(value)]
    })
}

/// Returns the distance and the closest triangle of each vertex.
fn nearest_of_vertices(
    field: &Field<'_>,
    surface: &TriMesh,
    progress: &Progress,
) -> Result<Vec<(f64, u32)>, Cancelled> {
    // neighbors in the list are most often neighbors in space
    surface
        .positions()
        .par_chunks(64)
        .map(|places| {
            progress.check()?;
            let mut hint = 0;
            let nearest = places.iter().map(|&p| {
                let near = field.near(p, hint);
                hint = near.triangle;
                (near.distance, hint)
            });
            Ok(nearest.collect::<Vec<_>>())
        })
        .collect::<Result<Vec<_>, Cancelled>>()
        .map(|chunks| chunks.concat())
}

/// Returns the minimum distance of a facet up to `slack`, or `enough` if it is not less.
fn least_distance(field: &Field<'_>, facet: [DVec3; 3], enough: f64, slack: f64) -> f64 {
    let comes_within = |distance: f64| field.bvh().comes_within(facet, distance);
    if !comes_within(enough) {
        return enough;
    }
    let (mut low, mut high) = (0.0, enough);
    while high - low > slack {
        let middle = 0.5 * (low + high);
        if comes_within(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    low
}

/// Returns an upper bound of the distance of a facet. The search ends at a bound of `enough`, or at a point beyond `hopeless`;
/// a bound up to `found` is final at once. `hints` are triangles that may be close to the corners.
fn most_distance(
    field: &Field<'_>,
    facet: [DVec3; 3],
    [found, enough, hopeless]: [f64; 3],
    hints: [u32; 3],
    cuts: u32,
) -> f64 {
    // the distance to one triangle is convex
    let bound_by = |triangle: u32| {
        let corners = field.bvh().corners(triangle);
        facet
            .map(|p| distance_sq_to_triangle(p, corners))
            .into_iter()
            .fold(0.0, f64::max)
            .sqrt()
    };
    let mut bound = f64::INFINITY;
    for hint in hints {
        bound = bound.min(bound_by(hint));
        if bound <= found {
            return bound;
        }
    }
    if bound <= enough {
        return bound;
    }
    let [a, b, c] = facet;
    let center = field.near((a + b + c) / 3.0, hints[0]);
    bound = bound.min(bound_by(center.triangle));
    if bound <= enough || center.distance > hopeless || cuts == 0 {
        return bound;
    }
    let [ab, bc, ca] = [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0];
    let [tab, tbc, tca] = [ab, bc, ca].map(|p| field.near(p, center.triangle).triangle);
    let [ta, tb, tc] = hints;
    let parts = [
        ([a, ab, ca], [ta, tab, tca]),
        ([ab, b, bc], [tab, tb, tbc]),
        ([ca, bc, c], [tca, tbc, tc]),
        ([ab, bc, ca], [tab, tbc, tca]),
    ];
    let mut most: f64 = 0.0;
    for (part, hints) in parts {
        most = most.max(most_distance(
            field,
            part,
            [found, enough, hopeless],
            hints,
            cuts - 1,
        ));
        if most > hopeless {
            break;
        }
    }
    if most > hopeless {
        bound
    } else {
        bound.min(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Solid;
    use ravec_mesh::Bvh;
    use ravec_scenes::solids::cuboid;

    const NOTHING: Ample<'_> = Ample {
        distance: 0.0,
        facets: &[],
    };

    fn cube(side: f64) -> TriMesh {
        cuboid(DVec3::splat(side)).mesh
    }

    /// A cube of side 4 around one of side 2: 1 apart at the faces, the root of 3 at the corners.
    fn measured(limits: [f64; 2]) -> Measured {
        let bvh = Bvh::new(&cube(2.0));
        let field = Field::new(&bvh, Solid::Closed, 1.0, &Progress::none()).unwrap();
        measure(&field, &cube(4.0), limits, NOTHING, &Progress::none()).unwrap()
    }

    #[test]
    fn the_extremes_are_those_of_the_surface_and_not_only_of_its_corners() {
        let limits = [0.9, 1.8];
        let found = measured(limits);
        let half = 0.5 * (limits[1] - limits[0]);
        assert_eq!(found.unproved, 0);
        assert!(found.least <= 1.0 && found.least >= 1.0 - MIN_SLACK * half);
        assert!((found.max_found - 3f64.sqrt()).abs() < 1e-12);
        assert!(found.most >= found.max_found && found.most <= limits[1]);
        // a facet through the middle of a cube, with one corner close to a face
        let bvh = Bvh::new(&cube(4.0));
        let field = Field::new(&bvh, Solid::Closed, -1.0, &Progress::none()).unwrap();
        let tilted = TriMesh::new(
            vec![
                DVec3::new(-1.0, -1.0, 0.0),
                DVec3::new(1.0, -1.0, 0.0),
                DVec3::new(0.0, 1.9, 0.0),
            ],
            vec![[0, 1, 2]],
        );
        let inner = measure(
            &field,
            &tilted.unwrap(),
            [0.0, 2.0],
            NOTHING,
            &Progress::none(),
        )
        .unwrap();
        assert!((inner.least - 0.1).abs() <= MIN_SLACK, "{}", inner.least);
    }

    #[test]
    fn facets_beyond_a_limit_are_counted_and_the_extremes_still_hold() {
        // every facet reaches a corner
        let far = measured([0.9, 1.1]);
        assert_eq!(far.unproved, 12);
        assert!(far.most >= 3f64.sqrt());
        let near = measured([1.01, 1.8]);
        assert_eq!(near.unproved, 12);
        assert!(near.least <= 1.0 && near.least > 0.99);
    }

    #[test]
    fn nothing_is_measured_after_a_cancellation() {
        let progress = Progress::none();
        progress.cancel();
        let bvh = Bvh::new(&cube(2.0));
        let field = Field::new(&bvh, Solid::Closed, 1.0, &Progress::none()).unwrap();
        assert!(measure(&field, &cube(4.0), [0.9, 1.8], NOTHING, &progress).is_err());
    }
}
