//! How near and how far the finished surface is, proved facet by facet, and where it creases.
//!
//! The distance at corners and middles of facets is exact and says what the extremes are about. Then each facet is proved not
//! to go beyond them: downward by the exact distance of triangles, which is searched for where a facet does come closer, so
//! that the least distance is that of the surface; upward by the bound of `certify`, whose facets are cut until it is
//! strong enough, so that the most is a bound that a part of the tolerance separates from what was found.
//!
//! Guarantees: no point of the surface is nearer than `least` or farther than `most`. A facet that is counted as not proved
//! may be within the limits all the same. Cost: a search for each vertex; for each facet what its proof costs, but for what
//! mending proved already; and for each edge between facets that turn by more than the angle of a crease two searches.

use crate::certify::MOST_CUTS;
use crate::certify::keeps_distance;
use crate::field::Field;
use glam::DVec3;
use ravec_mesh::{Adjacency, TriMesh, distance_sq_to_triangle};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// How far below the surface the proved least distance may be, as a share of the tolerance.
const LEAST_SLACK: f64 = 1e-3;

/// How much farther than the farthest sample a facet may be proved to be without a closer look, as a share of the tolerance.
/// Halving it cuts facets on fine input once more, which costs four times as much there.
const MOST_SLACK: f64 = 0.25;

/// Edges where normals turn by more than this are creases. Facets are off by a few degrees, and a coarse input that is
/// meant to be smooth turns by less.
const CREASE_DEG: f64 = 20.0;

/// What was measured of a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured {
    /// Facets that are not proved to be within the limits.
    pub unproved: u64,
    /// No point is nearer to the triangles.
    pub least: f64,
    /// No point is farther from the triangles.
    pub most: f64,
    /// The largest distance of a corner or a middle of a facet.
    pub most_found: f64,
}

/// Facets that are known not to come nearer than a distance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ample<'a> {
    pub distance: f64,
    /// Of each facet whether it is one; empty if none are.
    pub facets: &'a [bool],
}

impl Ample<'_> {
    fn contains(&self, facet: u32) -> bool {
        self.facets.get(facet as usize) == Some(&true)
    }
}

impl Measured {
    /// What holds for two parts of a surface together.
    pub fn and(self, other: Self) -> Self {
        Self {
            unproved: self.unproved + other.unproved,
            least: self.least.min(other.least),
            most: self.most.max(other.most),
            most_found: self.most_found.max(other.most_found),
        }
    }
}

/// Proves that facets keep the distance within limits, and measures the extremes; what is known of `ample` facets is not proved
/// again.
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
            // that of an ample facet is of interest only where it is far
            let most_sq = most_at_corners * most_at_corners;
            let is_near = |&triangle: &u32| {
                distance_sq_to_triangle(middle, field.bvh().corners(triangle)) <= most_sq
            };
            let distance = if is_ample && hints(t).iter().any(is_near) {
                most_at_corners
            } else {
                field.near(middle, hints(t)[0]).distance
            };
            Ok((is_ample, distance))
        })
        .collect::<Result<_, Cancelled>>()?;
    let [least_found, most_found] = spanned(
        [least_at_corners, most_at_corners],
        middles.iter().map(|&(_, distance)| distance),
    );
    let half = 0.5 * (limits[1] - limits[0]);
    let least = (least_found - LEAST_SLACK * half).max(0.0);
    let enough = (most_found + MOST_SLACK * half).min(limits[1]);
    let phase = progress.phase("measure", u64::from(facets));
    let extremes = |t: u32| {
        progress.check()?;
        phase.advance(1);
        let facet = surface.corners(t);
        let nearest = if least <= ample.distance && middles[t as usize].0 {
            least
        } else {
            least_distance(field, facet, least, LEAST_SLACK * half)
        };
        let levels = [most_found, enough, limits[1]];
        let farthest = most_distance(field, facet, levels, hints(t), MOST_CUTS);
        if nearest >= limits[0] && farthest <= limits[1] {
            return Ok((0, nearest, farthest));
        }
        // the least distance is known up to a slack, and the search for a bound takes other ways than the proof does
        let is_proved = keeps_distance(field, facet, limits, hints(t));
        let farthest = if is_proved { limits[1] } else { farthest };
        Ok((u64::from(!is_proved), nearest, farthest))
    };
    let (unproved, least, most) = (0..facets).into_par_iter().map(extremes).try_reduce(
        || (0, least, most_found),
        |a, b| Ok((a.0 + b.0, a.1.min(b.1), a.2.max(b.2))),
    )?;
    Ok(Measured {
        unproved,
        least,
        most,
        most_found,
    })
}

/// The least and the most of two limits and some values.
fn spanned(limits: [f64; 2], values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold(limits, |[least, most], value| {
        [least.min(value), most.max(value)]
    })
}

/// The distance of each vertex, and what is closest to it.
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

/// The least distance of a facet up to `slack`, or `enough` if it is not less than that.
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

/// A bound for the distance of all points of a facet. It is searched for until it is no more than `enough`, and given up
/// where a point is beyond `hopeless`; one up to `found` is as good as any. `hints` are triangles that may be close to the corners.
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

/// The number of edges where the surface creases: there, both the facets and the normals of the true surface beside the edge
/// turn by more than 20°. `reach` is how far beside: about as far as the surface may be off. Only edges between triangles that are
/// counted, are.
pub(crate) fn creases(
    field: &Field<'_>,
    surface: &TriMesh,
    reach: f64,
    is_counted: impl Fn([u32; 2]) -> bool + Sync,
    progress: &Progress,
) -> Result<u64, Cancelled> {
    progress.check()?;
    let adjacency = Adjacency::new(surface);
    progress.check()?;
    let most_alike = CREASE_DEG.to_radians().cos();
    let turns = |a: DVec3, b: DVec3| a.dot(b) < most_alike * a.length() * b.length();
    (0..adjacency.edges().len() as u32)
        .into_par_iter()
        .map(|edge| {
            progress.check()?;
            let &[left, right] = adjacency.uses(edge) else {
                return Ok(0);
            };
            if !is_counted([left.triangle, right.triangle]) {
                return Ok(0);
            }
            let sides = [left, right].map(|side| surface.corners(side.triangle));
            let [m, n] = sides.map(|[a, b, c]| (b - a).cross(c - a));
            if !turns(m, n) {
                return Ok(0);
            }
            let ends = adjacency.edges()[edge as usize].map(|v| surface.positions()[v as usize]);
            let middle = 0.5 * (ends[0] + ends[1]);
            let [p, q] = sides.map(|[a, b, c]| {
                let inward = (a + b + c) / 3.0 - middle;
                let along = (ends[1] - ends[0]).normalize_or_zero();
                let across = (inward - inward.dot(along) * along).length();
                // within the facet, whatever its shape
                middle + (reach / across).min(1.0) * inward
            });
            let [p, q] = [p, q].map(|p| field.near(p, 0).away);
            Ok(u64::from(turns(p, q)))
        })
        .try_reduce(|| 0, |a, b| Ok(a + b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::Solid;
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
        assert!(found.least <= 1.0 && found.least >= 1.0 - LEAST_SLACK * half);
        assert!((found.most_found - 3f64.sqrt()).abs() < 1e-12);
        assert!(found.most >= found.most_found && found.most <= limits[1]);
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
        assert!((inner.least - 0.1).abs() <= LEAST_SLACK, "{}", inner.least);
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
    fn edges_are_creases_only_where_the_true_surface_has_one() {
        let (small, large) = (cube(2.0), cube(4.0));
        for (inner, expected) in [(true, 12), (false, 0)] {
            let (mesh, surface) = if inner {
                (&large, &small)
            } else {
                (&small, &large)
            };
            let bvh = Bvh::new(mesh);
            let field = Field::new(
                &bvh,
                Solid::Closed,
                if inner { -1.0 } else { 1.0 },
                &Progress::none(),
            )
            .unwrap();
            // outside, cylinders and spheres round what is an edge here
            let found = creases(&field, surface, 0.02, |_| true, &Progress::none()).unwrap();
            assert_eq!(found, expected, "inner: {inner}");
        }
    }

    #[test]
    fn nothing_is_measured_after_a_cancellation() {
        let progress = Progress::none();
        progress.cancel();
        let bvh = Bvh::new(&cube(2.0));
        let field = Field::new(&bvh, Solid::Closed, 1.0, &Progress::none()).unwrap();
        assert!(measure(&field, &cube(4.0), [0.9, 1.8], NOTHING, &progress).is_err());
        assert!(creases(&field, &cube(4.0), 0.1, |_| true, &progress).is_err());
    }
}
