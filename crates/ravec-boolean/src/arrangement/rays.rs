//! Rays from parts of the surface to the outside, clear of all edges.
//!
//! A ray starts in the largest piece of a part and goes along an axis. It is tried from some places on the grid of the input
//! first, which is fast; where all of them are below an edge, as in a piece no wider than some steps of the grid, from places that
//! no grid holds, in whole numbers of unlimited size.
//!
//! Guarantees: a ray that is counted met no edge, so that its order of pieces is that of the exact surfaces.

use glam::{DVec2, DVec3};
use ravec_mesh::{Aabb, CandidateTree, Sign};
use ravec_numeric::DisjointSets;
use ravec_progress::Progress;

use super::cells::{Side, node};
use super::contact::{flat, view};
use super::cut::Pieces;
use super::edges::{NONE, Turned};
use super::exact::{self, Exact};
use super::interval::Interval;
use super::point::{Definition, Point, orient2d};
use crate::params::BooleanError;

/// Weights of the corners for the places in a piece from which rays are tried, one after the other, where one meets an
/// edge. In general position the first does; the others are for grids.
const WEIGHTS: [[f64; 3]; 6] = [
    [0.371, 0.322, 0.307],
    [0.523, 0.231, 0.246],
    [0.219, 0.537, 0.244],
    [0.253, 0.219, 0.528],
    [0.437, 0.411, 0.152],
    [0.117, 0.443, 0.440],
];

/// Places that are tried exactly: on a parabola in the piece, which each line through edges meets at most twice. Parts of a prime
/// number are not what coordinates are multiples of.
const EXACT_PARTS: i64 = 1009;
const EXACT_SHARES: [i64; 24] = [
    505, 624, 383, 743, 264, 862, 145, 547, 426, 666, 307, 785, 188, 904, 69, 590, 469, 709, 350,
    828, 231, 947, 112, 519,
];

/// Number of pieces of a connected part that are compared for the largest, from which a ray is tried.
const MAX_TRIALS: u32 = 1000;

/// Rays that tie the parts of the surface to what is around them.
pub(super) struct Rays<'a> {
    pub pieces: &'a Pieces<'a>,
    pub tree: &'a CandidateTree,
    pub patch_of: &'a [Turned],
    /// The sides of patches that look into the same cell.
    pub sides: &'a mut DisjointSets,
}

impl Rays<'_> {
    /// One ray from each connected part.
    ///
    /// # Errors
    /// [`BooleanError::Undecided`] if every ray from a part meets an edge, [`BooleanError::Cancelled`] soon after
    /// `progress` is.
    pub fn cast(
        &mut self,
        parts: &mut DisjointSets,
        progress: &Progress,
    ) -> Result<(), BooleanError> {
        // the largest of the first pieces of each part, from which a ray has the best chances
        let mut largest: Vec<(f64, u32)> = vec![(-1.0, NONE); parts.len()];
        let mut tried = vec![0; parts.len()];
        for (piece, patch) in self.patch_of.iter().enumerate() {
            let Some(patch) = patch.number() else {
                continue;
            };
            let part = parts.root(patch) as usize;
            if tried[part] < MAX_TRIALS {
                tried[part] += 1;
                let [a, b, c] = self.rounded(piece as u32);
                let area = (b - a).cross(c - a).length_squared();
                if area > largest[part].0 {
                    largest[part] = (area, piece as u32);
                }
            }
        }
        for (_, piece) in largest {
            progress.check()?;
            if piece == NONE || self.shoot(piece) || self.shoot_exactly(piece) {
                continue;
            }
            let at = self.rounded(piece)[0].to_array();
            return Err(BooleanError::Undecided { at });
        }
        Ok(())
    }

    fn rounded(&self, piece: u32) -> [DVec3; 3] {
        let corners = self.pieces.corners(piece);
        corners.map(|name| self.pieces.places.rounded(name))
    }

    fn plane(&self, piece: u32) -> [DVec3; 3] {
        let (triangle, _) = self.pieces.first_cover(piece);
        self.pieces.soup.corners(triangle)
    }

    /// Sends a ray from a piece along an axis to the outside; `false` if it met an edge wherever it was tried.
    fn shoot(&mut self, piece: u32) -> bool {
        let axis = view(self.plane(piece));
        let corners = self.rounded(piece).map(|p| flat(p, axis));
        WEIGHTS.iter().any(|weights| {
            let at = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
            self.shoot_at(piece, axis, at)
        })
    }

    fn shoot_at(&mut self, piece: u32, axis: usize, at: DVec2) -> bool {
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let places = &self.pieces.places;
        let grid = places.grid();
        let bounds = self.tree.bounds();
        let mut line = [DVec3::ZERO; 2];
        for end in &mut line {
            end[i] = grid.snap(at.x);
            end[j] = grid.snap(at.y);
        }
        line[0][axis] = grid.snap(bounds.min[axis]);
        line[1][axis] = grid.snap(bounds.max[axis]);
        if line[0][axis] == line[1][axis] {
            line[1][axis] = if line[0][axis] == 0.0 { 1.0 } else { 0.0 };
        }
        let foot = Point::at(line[0]);
        let Some(Some(up)) = self.passes(piece, &foot, axis) else {
            return false;
        };
        let height = |piece: u32| {
            let definition = Definition::LinePlane(line, self.plane(piece));
            Point::defined(definition, places.max_width(), grid)
        };
        let start = height(piece);
        let mut hits = vec![(start, piece, up)];
        let mut tower = Aabb::around(line);
        tower.min[axis] = hits[0].0.near[axis].lo;
        tower.max[axis] = bounds.max[axis];
        for other in self.near(&tower, piece) {
            match self.passes(other, &foot, axis) {
                None => return false,
                Some(None) => {}
                Some(Some(up)) => {
                    let place = height(other);
                    if place.compare(&hits[0].0, axis, grid).is_gt() {
                        hits.push((place, other, up));
                    }
                }
            }
        }
        hits.sort_by(|a, b| a.0.compare(&b.0, axis, grid));
        self.join(hits.iter().map(|&(_, piece, up)| (piece, up)));
        true
    }

    /// Pieces other than `piece` that have an effect and may meet a box.
    fn near(&self, bounds: &Aabb, piece: u32) -> Vec<u32> {
        let mut candidates = Vec::new();
        self.tree.for_each_near(bounds, |triangle| {
            candidates.extend(self.pieces.of_triangle(triangle));
        });
        candidates.retain(|&other| other != piece && self.patch_of[other as usize] != Turned::NONE);
        candidates.sort_unstable();
        candidates.dedup();
        candidates
    }

    /// Joins the cells between successive pieces that a ray goes through, given with the sides that it comes out of; beyond the
    /// last is the outside.
    fn join(&mut self, hits: impl Iterator<Item = (u32, Side)>) {
        let mut above = None;
        for (piece, up) in hits {
            let patch = self.patch_of[piece as usize];
            if let Some(above) = above {
                self.sides.join(above, node(patch, up.other()));
            }
            above = Some(node(patch, up));
        }
        if let Some(last) = above {
            self.sides.join(last, 0);
        }
    }

    /// The same from places that no grid holds, in whole numbers; `false` only if all of them are below an edge.
    fn shoot_exactly(&mut self, piece: u32) -> bool {
        let axis = view(self.plane(piece));
        let corners = self.exact(piece);
        EXACT_SHARES.into_iter().any(|share| {
            let left = EXACT_PARTS - share;
            let foot = Exact::weighted(&corners, [left * left, 2 * share * left, share * share]);
            self.shoot_exactly_at(piece, axis, &foot)
        })
    }

    fn shoot_exactly_at(&mut self, piece: u32, axis: usize, foot: &Exact) -> bool {
        let grid = self.pieces.places.grid();
        let Some(Some(up)) = self.passes_exactly(piece, foot, axis) else {
            return false;
        };
        let height = |piece: u32| foot.on_plane(grid, &self.plane(piece), axis);
        let Some(start) = height(piece) else {
            return false;
        };
        let near: [Interval; 3] = std::array::from_fn(|k| start.rounded(grid, k));
        let mut tower = Aabb::new(
            DVec3::from_array(near.map(|i| i.lo)),
            DVec3::from_array(near.map(|i| i.hi)),
        );
        tower.max[axis] = self.tree.bounds().max[axis];
        let mut hits = vec![(start, piece, up)];
        for other in self.near(&tower, piece) {
            match self.passes_exactly(other, foot, axis) {
                None => return false,
                Some(None) => {}
                Some(Some(up)) => {
                    let Some(place) = height(other) else {
                        return false;
                    };
                    if place.compare(&hits[0].0, axis).is_gt() {
                        hits.push((place, other, up));
                    }
                }
            }
        }
        hits.sort_by(|a, b| a.0.compare(&b.0, axis));
        self.join(hits.iter().map(|&(_, piece, up)| (piece, up)));
        true
    }

    /// Corners of a piece in whole numbers.
    fn exact(&self, piece: u32) -> [Exact; 3] {
        let places = &self.pieces.places;
        let corners = self.pieces.corners(piece);
        corners.map(|name| match places.made(name) {
            Some(point) => point.exact(places.grid()).clone(),
            None => Exact::of_point(places.grid(), places.given()[name as usize]),
        })
    }

    /// The same as [`Self::passes`], for any foot.
    #[allow(
        clippy::option_option,
        reason = "three answers, of which one ends the search"
    )]
    fn passes_exactly(&self, piece: u32, foot: &Exact, axis: usize) -> Option<Option<Side>> {
        let points = self.exact(piece);
        let signs = std::array::from_fn(|k| {
            exact::orient2d([&points[k], &points[(k + 1) % 3], foot], axis)
        });
        passed(signs)
    }

    /// The side of a piece that a line along an axis comes out of, if it goes through the inside of the piece; `None` if
    /// it meets the border.
    #[allow(
        clippy::option_option,
        reason = "three answers, of which one ends the search"
    )]
    fn passes(&self, piece: u32, foot: &Point, axis: usize) -> Option<Option<Side>> {
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let places = &self.pieces.places;
        let corners = self.pieces.corners(piece);
        let points = corners.map(|name| match places.made(name) {
            Some(point) => point.clone(),
            None => Point::at(places.given()[name as usize]),
        });
        let clear = |k: usize| {
            let lo = points
                .iter()
                .map(|p| p.near[k].lo)
                .fold(f64::INFINITY, f64::min);
            let hi = points
                .iter()
                .map(|p| p.near[k].hi)
                .fold(f64::NEG_INFINITY, f64::max);
            foot.near[k].hi < lo || foot.near[k].lo > hi
        };
        if clear(i) || clear(j) {
            return Some(None);
        }
        let grid = places.grid();
        let signs: [Sign; 3] =
            std::array::from_fn(|k| orient2d(&points[k], &points[(k + 1) % 3], foot, axis, grid));
        passed(signs)
    }
}

/// The side that a line comes out of, by the sides of the borders of a piece that it is on; `None` on a border.
#[allow(
    clippy::option_option,
    reason = "three answers, of which one ends the search"
)]
fn passed(signs: [Sign; 3]) -> Option<Option<Side>> {
    if signs.contains(&Sign::Positive) && signs.contains(&Sign::Negative) {
        Some(None)
    } else if signs.contains(&Sign::Zero) {
        None
    } else if signs[0] == Sign::Positive {
        Some(Some(Side::Front))
    } else {
        Some(Some(Side::Back))
    }
}
