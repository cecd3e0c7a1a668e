//! Edges in which pieces meet, and the order of the pieces around them.

use std::cmp::Ordering;

use glam::DVec3;
use ravec_mesh::Sign;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use super::cut::Pieces;
use super::exact::{self, Grid};
use super::point::{self, Point};

/// Pieces or vertices between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 16;

/// A piece at an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Use {
    pub piece: u32,
    /// `true` if the piece runs from the lower to the higher end of the edge.
    pub forward: bool,
}

/// The number of something, and whether it is turned against what names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Turned(u32);

impl Turned {
    /// Nothing.
    pub const NONE: Self = Self(u32::MAX);

    pub fn new(number: u32, is_turned: bool) -> Self {
        Self(number << 1 | u32::from(is_turned))
    }

    /// The number, unless it is that of nothing.
    #[inline]
    pub fn number(self) -> Option<u32> {
        (self != Self::NONE).then_some(self.0 >> 1)
    }

    /// Returns `true` if it is turned.
    #[inline]
    pub fn is_turned(self) -> bool {
        self.0 & 1 == 1
    }

    /// The same, turned once more if so asked.
    #[inline]
    pub fn turned(self, also: bool) -> Self {
        Self(self.0 ^ u32::from(also))
    }
}

/// The edges of all selected pieces.
pub(crate) struct Edges {
    /// For each piece the one over each side, if just two meet there; it is turned if both run through the edge in one
    /// direction. Sides begin at the corner of the same index.
    pub across: Vec<[Turned; 3]>,
    /// The other edges with more than one piece: their ends and their pieces, counter-clockwise as seen when looking
    /// from the higher end towards the lower.
    pub junctions: Vec<([u32; 2], Vec<Use>)>,
    /// Pieces with an edge that no other piece has, one for each such edge.
    pub free: Vec<u32>,
}

/// No number.
pub(crate) const NONE: u32 = u32::MAX;

impl Edges {
    /// The edges of those pieces for which `asked` is true.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is.
    pub fn of(
        pieces: &Pieces,
        asked: impl Fn(u32) -> bool,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let names = pieces.places.given().len() + pieces.places.made.len();
        let ends = |corners: [u32; 3], side: usize| (corners[side], corners[(side + 1) % 3]);
        // Sides are three times the piece plus the side. Those with the same lower end are in a list that starts here, and
        // goes on where later stands what is across.
        let (listed, next) = (Turned, |listed: Turned| listed.0);
        let mut starts = vec![NONE; names];
        let mut across = vec![[Turned::NONE; 3]; pieces.end() as usize];
        for (at, piece) in pieces.all().filter(|&piece| asked(piece)).enumerate() {
            if at % STRIDE == 0 {
                progress.check()?;
            }
            let corners = pieces.corners(piece);
            for (side, slot) in across[piece as usize].iter_mut().enumerate() {
                let (a, b) = ends(corners, side);
                let start = &mut starts[a.min(b) as usize];
                *slot = listed(std::mem::replace(start, 3 * piece + side as u32));
            }
        }
        let mut junctions = Vec::new();
        let mut free = Vec::new();
        // higher end, side, and whether it runs towards that end
        let mut here: Vec<(u32, u32, bool)> = Vec::new();
        for (lower, mut side) in (0_u32..).zip(starts) {
            if (lower as usize).is_multiple_of(STRIDE) {
                progress.check()?;
            }
            here.clear();
            while side != NONE {
                let (piece, k) = (side / 3, (side % 3) as usize);
                let (a, b) = ends(pieces.corners(piece), k);
                here.push((a.max(b), side, a == lower));
                side = next(std::mem::replace(
                    &mut across[piece as usize][k],
                    Turned::NONE,
                ));
            }
            here.sort_unstable();
            for group in here.chunk_by(|a, b| a.0 == b.0) {
                match group {
                    [(_, one, _)] => free.push(one / 3),
                    [(_, one, up), (_, other, other_up)] => {
                        for (one, other) in [(one, other), (other, one)] {
                            across[(one / 3) as usize][(one % 3) as usize] =
                                Turned::new(other / 3, up == other_up);
                        }
                    }
                    _ => {
                        let uses = group.iter().map(|&(_, side, forward)| Use {
                            piece: side / 3,
                            forward,
                        });
                        junctions.push(([lower, group[0].0], uses.collect()));
                    }
                }
            }
        }
        let mut edges = Self {
            across,
            junctions,
            free,
        };
        progress.check()?;
        edges.sort_around(pieces, progress)?;
        Ok(edges)
    }

    fn sort_around(&mut self, pieces: &Pieces, progress: &Progress) -> Result<(), Cancelled> {
        self.junctions.par_iter_mut().try_for_each(|(ends, uses)| {
            progress.check()?;
            Around::new(pieces, *ends).sort(uses);
            Ok(())
        })
    }
}

/// Half-planes around an edge, which are compared by their normals: seen along the edge, a half-plane turned by a quarter
/// is its normal, so that the order of the one is the order of the other. Normals are those of the triangles of the
/// input; as all are at right angles to the edge, the cross product of two is along it.
struct Around<'a> {
    pieces: &'a Pieces<'a>,
    /// An axis along which the ends differ, and whether the edge rises along it.
    axis: usize,
    rises: bool,
    grid: Grid,
}

/// The half-plane of a piece at an edge.
struct HalfPlane {
    /// The triangle of the soup whose plane it is in.
    triangle: u32,
    /// `true` if the normal of that triangle is the half-plane turned by a quarter; else the opposite is.
    with: bool,
    /// Points of the plane, turned accordingly.
    plane: [DVec3; 3],
    /// The normal, rounded: each component is wrong by 8 roundings of half an ulp of `scale` at most, and at most twice that
    /// number.
    normal: DVec3,
    scale: f64,
}

/// The rounding of a product of two components of normals less another one, and of the sum of three products, relative to the
/// product of their scales: 80 and 132 roundings of half an ulp. Smaller is wrong, larger asks intervals more often.
const CROSS_FILTER: f64 = 1e-14;
const DOT_FILTER: f64 = 2e-14;

/// Products below this may have lost digits to underflow.
const TINY: f64 = 1e-290;

/// The sign of a number that is wrong by no more than `bound`, if that is clear.
fn sign_beyond(x: f64, bound: f64) -> Option<Sign> {
    (x.abs() > bound.max(TINY)).then(|| Sign::of(x))
}

impl<'a> Around<'a> {
    fn new(pieces: &'a Pieces<'a>, [a, b]: [u32; 2]) -> Self {
        let grid = pieces.places.grid();
        let way = (pieces.places.rounded(b) - pieces.places.rounded(a)).abs();
        let mut axes = [0, 1, 2];
        axes.sort_by(|&i, &j| way[j].total_cmp(&way[i]));
        let given = [a, b].map(|name| Point::at(pieces.places.rounded(name)));
        let a = pieces.places.made(a).unwrap_or(&given[0]);
        let b = pieces.places.made(b).unwrap_or(&given[1]);
        let (axis, order) = axes
            .into_iter()
            .map(|axis| (axis, a.compare(b, axis, grid)))
            .find(|(_, order)| order.is_ne())
            .expect("the ends of an edge are two places");
        Self {
            pieces,
            axis,
            rises: order == Ordering::Less,
            grid,
        }
    }

    /// The half-plane of a piece.
    fn half_plane(&self, one: Use) -> HalfPlane {
        let (triangle, same) = self.pieces.first_cover(one.piece);
        let with = same == one.forward;
        let [a, b, c] = self.pieces.soup.corners(triangle);
        let plane = if with { [a, b, c] } else { [a, c, b] };
        let (e, f) = (plane[1] - plane[0], plane[2] - plane[0]);
        HalfPlane {
            triangle,
            with,
            plane,
            normal: e.cross(f),
            scale: e.abs().max_element() * f.abs().max_element(),
        }
    }

    /// The sign of the turn from one half-plane to another, zero if they are the same or opposite.
    fn turn(&self, one: &HalfPlane, other: &HalfPlane) -> Sign {
        if one.triangle == other.triangle {
            return Sign::Zero;
        }
        let (i, j) = ((self.axis + 1) % 3, (self.axis + 2) % 3);
        let (m, n) = (one.normal, other.normal);
        let bound = CROSS_FILTER * one.scale * other.scale;
        let rounded = sign_beyond(m[i] * n[j] - m[j] * n[i], bound);
        let nearly = || {
            let [m, n] = [one, other].map(|half| point::normal(&half.plane));
            (m[i] * n[j] - m[j] * n[i]).sign()
        };
        let sign = rounded.or_else(nearly).unwrap_or_else(|| {
            let (m, n) = self.exact_normals(one, other);
            exact::sign(&exact::cross(&m, &n)[self.axis])
        });
        if self.rises { sign } else { -sign }
    }

    /// Returns `true` if two half-planes of one plane are the same.
    fn agree(&self, one: &HalfPlane, other: &HalfPlane) -> bool {
        if one.triangle == other.triangle {
            return one.with == other.with;
        }
        let bound = DOT_FILTER * one.scale * other.scale;
        let rounded = sign_beyond(one.normal.dot(other.normal), bound);
        let nearly = || {
            let [m, n] = [one, other].map(|half| point::normal(&half.plane));
            (m[0] * n[0] + m[1] * n[1] + m[2] * n[2]).sign()
        };
        let sign = rounded.or_else(nearly).unwrap_or_else(|| {
            let (m, n) = self.exact_normals(one, other);
            exact::sign(&exact::dot(&m, &n))
        });
        sign == Sign::Positive
    }

    fn exact_normals(&self, one: &HalfPlane, other: &HalfPlane) -> (exact::Vector, exact::Vector) {
        let normal = |half: &HalfPlane| exact::plane(self.grid, &half.plane).0;
        (normal(one), normal(other))
    }

    fn sort(&self, uses: &mut [Use]) {
        let first = self.half_plane(uses[0]);
        // 0 for the first itself, 1 for the half turn that follows, 2 opposite of it, 3 for the rest
        let mut placed: Vec<(u8, HalfPlane, Use)> = uses
            .iter()
            .map(|&one| {
                let half = self.half_plane(one);
                let part = match self.turn(&first, &half) {
                    Sign::Positive => 1,
                    Sign::Negative => 3,
                    Sign::Zero if self.agree(&first, &half) => 0,
                    Sign::Zero => 2,
                };
                (part, half, one)
            })
            .collect();
        placed.sort_by(|(p, one, a), (q, other, b)| {
            p.cmp(q)
                .then_with(|| match self.turn(one, other) {
                    Sign::Positive => Ordering::Less,
                    Sign::Negative => Ordering::Greater,
                    Sign::Zero => Ordering::Equal,
                })
                .then_with(|| a.piece.cmp(&b.piece))
        });
        for (slot, (_, _, one)) in uses.iter_mut().zip(placed) {
            *slot = one;
        }
    }
}
