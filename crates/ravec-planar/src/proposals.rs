//! Planes that a picture shows, before anybody has drawn anything.
//!
//! ```text
//! find vanishing points
//! for each pair of them, mark where segments of both lie close together: there is a plane with these two directions
//! where several pairs compete, the one whose weaker direction is the strongest wins
//! each connected place is bounded by the outermost segments of both directions
//! ```
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers.
//!
//! Source: dissertation, section 6.2; the votes of pairs follow Huang et al., "Image completion using planar structure
//! guidance", 2014. We differ in that regions are connected and bounded, so that they can be offered as quadrilaterals.
//!
//! Guarantees: every quadrilateral is one that a camera sees of a rectangle; equal segments give equal bytes. Does not
//! guarantee: that it is one; proposals are there to be chosen from and to snap.
//! Cost: that of vanishing points, and some milliseconds.

use crate::homography::Homography;
use crate::vanishing::{VanishingPoint, cosine, focal_from_right_angles, vanishing_points};
use glam::{DMat3, DVec2, DVec3, dvec2};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::Segment;

/// A quadrilateral that may be a rectangle on a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneProposal {
    /// Its corners in turn, clockwise in the picture from the upper left one, in pixels, x right, y down, pixel centers at
    /// half-integers. They may lie a little outside the picture.
    pub quad: [DVec2; 4],
    /// The numbers of its vanishing points: of the sides from corner 0 to 1, and from 1 to 2.
    pub vanishing: [usize; 2],
    /// The length in pixels of the segments in it that go along the sides, of the direction that has less.
    pub support_px: f64,
    /// `Some(true)` if its sides are at right angles for the focal length that is known or was found; `None` if there
    /// is no focal length.
    pub right_angles: Option<bool>,
}

/// Planes and vanishing points found in a picture's segments.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposals {
    /// Vanishing points, those of most length first.
    pub vanishing_points: Vec<VanishingPoint>,
    /// The focal length in pixels: the one given, or the one for which the points are at right angles.
    pub focal_px: Option<f64>,
    /// Planes, the best first.
    pub planes: Vec<PlaneProposal>,
}

/// The side of a cell, as a share of the picture's diagonal. Smaller follows outlines and loses walls with few windows.
const CELL: f64 = 1.0 / 48.0;

/// Radius of a segment's influence, in cells: the distance of windows.
const SPREAD: usize = 3;

/// Least density of either direction around a cell, in cells' sides: a window has two of each.
const MIN_DENSITY: f64 = 1.5;

/// The fewest cells of a plane.
const MIN_CELLS: usize = 12;

/// The least area of a plane, as a share of that of its cells, which reach beyond its segments.
const MIN_FILL: f64 = 0.2;

/// The share of the length that may lie beyond either end of a plane: what belongs to something else.
const TAIL: f64 = 0.02;

/// The greatest cosine of directions that count as being at right angles: 6 degrees, as points are not exact.
const MAX_COSINE: f64 = 0.1;

/// Planes at most.
const MAX_PLANES: usize = 12;

/// Finds planes from the segments of a picture of `picture` width and height, with the focal length in pixels if it is known.
///
/// Without a focal length every pair of directions may be a plane. With one, pairs that are not at right angles are left out,
/// as no rectangle lies along them.
///
/// Segments may come from any detector; `line_segments` of `ravec-twocolor` is one. The tour of the crate `ravec` leads from a
/// picture to its planes.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn propose_planes(
    segments: &[Segment],
    picture: DVec2,
    focal_px: Option<f64>,
    progress: &Progress,
) -> Result<Proposals, Cancelled> {
    let points = vanishing_points(segments, picture, progress)?;
    let known = focal_px.filter(|&focal| focal > 0.0 && focal.is_finite());
    let focal_px = known.or_else(|| focal_from_right_angles(&points, picture));
    let cells = Cells::new(picture);
    let densities: Vec<Vec<f64>> = points
        .iter()
        .map(|point| cells.density(point.segments.iter().map(|&k| &segments[k])))
        .collect();
    let mut pairs: Vec<Pair> = Vec::new();
    for a in 0..points.len() {
        for b in a + 1..points.len() {
            let right_angles =
                focal_px.map(|focal| cosine(&points[a], &points[b], picture, focal) < MAX_COSINE);
            if known.is_some() && right_angles == Some(false) {
                continue;
            }
            let horizon = points[a].at.cross(points[b].at);
            pairs.extend(horizon.try_normalize().map(|horizon| Pair {
                points: [a, b],
                horizon,
                right_angles,
            }));
        }
    }
    let owners = cells.owners(&pairs, &densities);
    let mut planes: Vec<PlaneProposal> = Vec::new();
    for region in cells.regions(&owners) {
        progress.check()?;
        let pair = &pairs[region.pair];
        planes.extend(plane(&region, pair, &points, segments, &cells));
    }
    // what is at right angles is likelier to be a wall
    let rank = |plane: &PlaneProposal| {
        plane.support_px
            * if plane.right_angles == Some(false) {
                0.5
            } else {
                1.0
            }
    };
    planes.sort_by(|a, b| rank(b).total_cmp(&rank(a)));
    planes.truncate(MAX_PLANES);
    Ok(Proposals {
        vanishing_points: points,
        focal_px,
        planes,
    })
}

/// Two directions that may span a plane.
struct Pair {
    points: [usize; 2],
    /// The plane's horizon: a point p lies on it if horizon · p = 0.
    horizon: DVec3,
    right_angles: Option<bool>,
}

/// A connected place where a pair is the strongest.
struct Region {
    pair: usize,
    /// For each cell, whether it belongs.
    cells: Vec<bool>,
    count: usize,
}

/// A coarse raster over the picture.
struct Cells {
    side: f64,
    columns: usize,
    rows: usize,
}

impl Cells {
    fn new(picture: DVec2) -> Self {
        let side = (CELL * picture.length()).max(1.0);
        Self {
            side,
            columns: (picture.x / side).ceil().max(1.0) as usize,
            rows: (picture.y / side).ceil().max(1.0) as usize,
        }
    }

    fn index(&self, at: DVec2) -> usize {
        // casts saturate
        let col = ((at.x / self.side) as usize).min(self.columns - 1);
        let row = ((at.y / self.side) as usize).min(self.rows - 1);
        row * self.columns + col
    }

    fn center(&self, cell: usize) -> DVec2 {
        let (col, row) = (cell % self.columns, cell / self.columns);
        (dvec2(col as f64, row as f64) + 0.5) * self.side
    }

    /// The length of segments around each cell, in sides of cells.
    fn density<'a>(&self, segments: impl Iterator<Item = &'a Segment>) -> Vec<f64> {
        let mut length = vec![0.0; self.columns * self.rows];
        for segment in segments {
            // places a quarter of a cell apart
            let steps = (4.0 * segment.length_px() / self.side).ceil().max(1.0);
            let share = segment.length_px() / (self.side * steps);
            for k in 0..steps as usize {
                let at = segment.ends[0].lerp(segment.ends[1], (k as f64 + 0.5) / steps);
                length[self.index(at)] += share;
            }
        }
        let rows = summed(&length, 1, self.columns, self.columns, self.rows);
        summed(&rows, self.columns, self.rows, 1, self.columns)
    }

    /// The pair that is strongest in each cell, if any is strong enough.
    fn owners(&self, pairs: &[Pair], densities: &[Vec<f64>]) -> Vec<Option<usize>> {
        (0..self.columns * self.rows)
            .map(|cell| {
                let strength = |pair: &Pair| {
                    let [a, b] = pair.points.map(|point| densities[point][cell]);
                    a.min(b)
                };
                let reach = SPREAD as f64 * self.side;
                let off_horizon = |pair: &Pair| {
                    let slope = pair.horizon.truncate().length();
                    pair.horizon.dot(self.center(cell).extend(1.0)).abs() > reach * slope
                };
                (0..pairs.len())
                    .filter(|&k| strength(&pairs[k]) >= MIN_DENSITY && off_horizon(&pairs[k]))
                    .max_by(|&a, &b| {
                        strength(&pairs[a])
                            .total_cmp(&strength(&pairs[b]))
                            .then(b.cmp(&a))
                    })
            })
            .collect()
    }

    /// The connected places of each pair, each on one side of its horizon.
    fn regions(&self, owners: &[Option<usize>]) -> Vec<Region> {
        let mut seen = vec![false; owners.len()];
        let mut regions = Vec::new();
        for start in 0..owners.len() {
            let Some(pair) = owners[start].filter(|_| !seen[start]) else {
                continue;
            };
            let mut region = Region {
                pair,
                cells: vec![false; owners.len()],
                count: 0,
            };
            let mut open = vec![start];
            seen[start] = true;
            while let Some(cell) = open.pop() {
                region.cells[cell] = true;
                region.count += 1;
                let (col, row) = (cell % self.columns, cell / self.columns);
                let beside = [
                    (col > 0).then(|| cell - 1),
                    (col + 1 < self.columns).then(|| cell + 1),
                    (row > 0).then(|| cell - self.columns),
                    (row + 1 < self.rows).then(|| cell + self.columns),
                ];
                for next in beside.into_iter().flatten() {
                    if !seen[next] && owners[next] == Some(pair) {
                        seen[next] = true;
                        open.push(next);
                    }
                }
            }
            if region.count >= MIN_CELLS {
                regions.push(region);
            }
        }
        regions
    }
}

/// Sums of up to 2 · `SPREAD` + 1 values along lines of `count` values that are `step` apart; `others` lines, `stride`
/// apart.
fn summed(values: &[f64], step: usize, count: usize, stride: usize, others: usize) -> Vec<f64> {
    let mut sums = vec![0.0; values.len()];
    for line in 0..others {
        for k in 0..count {
            let near = k.saturating_sub(SPREAD)..(k + SPREAD + 1).min(count);
            sums[line * stride + k * step] =
                near.map(|near| values[line * stride + near * step]).sum();
        }
    }
    sums
}

/// The rectangle around the segments of a place.
fn plane(
    region: &Region,
    pair: &Pair,
    points: &[VanishingPoint],
    segments: &[Segment],
    cells: &Cells,
) -> Option<PlaneProposal> {
    let members = (0..region.cells.len()).filter(|&cell| region.cells[cell]);
    let middle = members.map(|cell| cells.center(cell)).sum::<DVec2>() / region.count as f64;
    // the direction that is more level there makes the first side
    let level = |point: usize| {
        let at = points[point].at;
        (at.truncate() - at.z * middle).normalize_or_zero().x.abs()
    };
    let [mut across, mut down] = pair.points;
    if level(across) < level(down) {
        (across, down) = (down, across);
    }
    // lines through the first point become level, those through the second upright, the horizon goes to infinity
    let center = middle.extend(1.0);
    let horizon = if pair.horizon.dot(center) < 0.0 {
        -pair.horizon
    } else {
        pair.horizon
    };
    let rows = [
        points[down].at.cross(center),
        points[across].at.cross(center),
        horizon,
    ];
    let upright_from_image =
        Homography::from_matrix(DMat3::from_cols(rows[0], rows[1], rows[2]).transpose()).ok()?;
    let upright_from_image = upright_from_image.facing(middle);
    let inside = |segment: &Segment| {
        region.cells[cells.index(segment.middle())] && upright_from_image.is_in_front(&segment.ends)
    };
    // where the segments of a direction lie across it, with their lengths
    let places = |point: usize, axis: usize| -> Vec<(f64, f64)> {
        let along = points[point].segments.iter().map(|&k| &segments[k]);
        let mut places: Vec<_> = along
            .filter(|segment| inside(segment))
            .map(|segment| {
                let at = upright_from_image.apply(segment.middle());
                (at[axis], segment.length_px())
            })
            .collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        places
    };
    let (upright, level) = (places(down, 0), places(across, 1));
    let (left, right) = bounds(&upright)?;
    let (top, bottom) = bounds(&level)?;
    let image_from_upright = upright_from_image.inverse();
    let corner = |x: f64, y: f64| image_from_upright.try_apply(dvec2(x, y));
    let quad = [
        corner(left, top)?,
        corner(right, top)?,
        corner(right, bottom)?,
        corner(left, bottom)?,
    ];
    let quad = in_turn(quad, middle);
    Homography::from_unit_square(quad).ok()?;
    // two crossing lines alone are not evidence of a plane
    let area = 0.5 * (quad[2] - quad[0]).perp_dot(quad[3] - quad[1]).abs();
    if area < MIN_FILL * region.count as f64 * cells.side.powi(2) {
        return None;
    }
    let length = |places: &[(f64, f64)]| places.iter().map(|place| place.1).sum::<f64>();
    Some(PlaneProposal {
        quad,
        vanishing: [across, down],
        support_px: length(&upright).min(length(&level)),
        right_angles: pair.right_angles,
    })
}

/// The least and the greatest place, but for a small share of the length at either end.
fn bounds(places: &[(f64, f64)]) -> Option<(f64, f64)> {
    let total: f64 = places.iter().map(|place| place.1).sum();
    let quantile = |share: f64| {
        let mut sum = 0.0;
        places
            .iter()
            .find(|place| {
                sum += place.1;
                sum >= share * total
            })
            .map(|place| place.0)
    };
    let (low, high) = (quantile(TAIL)?, quantile(1.0 - TAIL)?);
    (low < high).then_some((low, high))
}

/// Corners clockwise in the picture from the upper left one, sides 0–1 and 2–3 being the level ones as before.
fn in_turn(quad: [DVec2; 4], middle: DVec2) -> [DVec2; 4] {
    let [mut a, mut b, mut c, mut d] = quad;
    // the axes of the upright view may be mirrored or turned
    if (a + d).x > (b + c).x {
        (a, b, c, d) = (b, a, d, c);
    }
    if (a + b).y > 2.0 * middle.y.max((c + d).y * 0.5) || (a + b).y > (c + d).y {
        (a, b, c, d) = (d, c, b, a);
    }
    [a, b, c, d]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lines of a grid of 9 × 7 in a quadrilateral, as segments between its nodes.
    fn grid(quad: [DVec2; 4]) -> Vec<Segment> {
        let map = Homography::from_unit_square(quad).unwrap();
        let at = |col: i32, row: i32| map.apply(dvec2(f64::from(col) / 8.0, f64::from(row) / 6.0));
        let mut segments = Vec::new();
        for row in 0..=6 {
            for col in 0..=8 {
                if col < 8 {
                    segments.push(Segment {
                        ends: [at(col, row), at(col + 1, row)],
                    });
                }
                if row < 6 {
                    segments.push(Segment {
                        ends: [at(col, row), at(col, row + 1)],
                    });
                }
            }
        }
        segments
    }

    #[test]
    fn a_grid_is_proposed_as_it_is() {
        let quad = [
            (150.0, 120.0),
            (820.0, 220.0),
            (800.0, 560.0),
            (180.0, 690.0),
        ]
        .map(DVec2::from);
        let found =
            propose_planes(&grid(quad), dvec2(1000.0, 800.0), None, &Progress::none()).unwrap();
        assert_eq!(found.planes.len(), 1);
        for (corner, truth) in found.planes[0].quad.iter().zip(quad) {
            // its outermost lines are 1/9 and 1/7 of the length of theirs: no tail reaches the second ones
            assert!(corner.distance(truth) < 2.0, "{:?}", found.planes[0]);
        }
        let [across, down] = found.planes[0].vanishing;
        assert!(across != down && found.planes[0].support_px > 1000.0);
    }

    #[test]
    fn with_a_focal_length_only_right_angles_are_planes() {
        let quad = [
            (150.0, 120.0),
            (820.0, 220.0),
            (800.0, 560.0),
            (180.0, 690.0),
        ]
        .map(DVec2::from);
        let picture = dvec2(1000.0, 800.0);
        let free = propose_planes(&grid(quad), picture, None, &Progress::none()).unwrap();
        let focal = free.focal_px.unwrap();
        let right = propose_planes(&grid(quad), picture, Some(focal), &Progress::none()).unwrap();
        assert_eq!(right.planes.len(), 1);
        assert_eq!(right.planes[0].right_angles, Some(true));
        let wrong =
            propose_planes(&grid(quad), picture, Some(4.0 * focal), &Progress::none()).unwrap();
        assert!(wrong.planes.is_empty());
    }

    #[test]
    fn nothing_is_proposed_from_nothing() {
        let found =
            propose_planes(&[], dvec2(10.0, 10.0), Some(f64::NAN), &Progress::none()).unwrap();
        assert_eq!(
            (
                found.planes.len(),
                found.vanishing_points.len(),
                found.focal_px
            ),
            (0, 0, None)
        );
    }
}
