//! Distance of two surfaces: the Hausdorff distance with a proof, mean and root of the mean square.
//!
//! The largest distance from one surface to the other is enclosed. From below: every place that was examined is a
//! witness. From above: the distance to a single triangle is convex, so that over a piece it is largest at a corner, and
//!
//! > max over the piece of the distance <= min over triangles of max over the corners of the distance to that triangle,
//!
//! where the triangles tried are those closest to the corners. The piece with the highest bound is cut in four, until no
//! bound is above the best witness by more than the tolerance.
//!
//! Source: the enclosure by subdivision after Guthe, Borodin and Klein, *Fast and accurate Hausdorff distance calculation
//! between meshes*, 2005; the bound is our choice, since it is tight where both surfaces are flat.
//!
//! Guarantees: `lower` is the distance of `from` to the other surface; `upper` is no less than that of any place, up to a
//! few roundings of the size; they differ by the tolerance at most unless [`HausdorffParams::max_pieces`] was reached.
//! The same on any number of threads. Does not guarantee: a bound of the error of mean and root mean square, which are
//! taken from samples.
//! Cost: a closest-point query for each vertex and sample, and three to seven for each piece that is cut.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use crate::closest::distance_sq_to_triangle;
use crate::{Bvh, TriMesh};

/// Precision of the bounds on distances, and the work allowed for them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HausdorffParams {
    /// Largest difference between `upper` and `lower`, in units of the mesh, above 0 (default 1e-3). Work grows about
    /// linearly with its inverse where surfaces are curved in different ways, and not at all where they are flat.
    pub tolerance: f64,
    /// Samples for mean and root mean square, in each direction (default 100 000, 0 for none). More is more accurate:
    /// the error is about the spread of the distances over the root of their number.
    pub samples: u32,
    /// Most pieces to be examined in each direction (default 20 million), which bounds work and memory (150 bytes each)
    /// should the tolerance be out of reach.
    pub max_pieces: u64,
}

impl Default for HausdorffParams {
    fn default() -> Self {
        Self {
            tolerance: 1e-3,
            samples: 100_000,
            max_pieces: 20_000_000,
        }
    }
}

/// The distances of one surface's points to another surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OneSided {
    /// The distance of the farthest place that was found.
    pub lower: f64,
    /// No place is farther than this.
    pub upper: f64,
    /// The farthest place that was found.
    pub from: DVec3,
    /// The place of the other surface that is closest to it.
    pub to: DVec3,
    /// The mean distance over the area, from samples; 0 without samples.
    pub mean: f64,
    /// The root of the mean squared distance over the area, from samples; 0 without samples.
    pub rms: f64,
}

/// The distances between two surfaces, both ways.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hausdorff {
    /// From the first to the second.
    pub forward: OneSided,
    /// From the second to the first.
    pub backward: OneSided,
}

impl Hausdorff {
    /// The two-sided distance is no less than this.
    pub fn lower(&self) -> f64 {
        self.forward.lower.max(self.backward.lower)
    }

    /// The two-sided distance is no more than this.
    pub fn upper(&self) -> f64 {
        self.forward.upper.max(self.backward.upper)
    }
}

/// Why two surfaces have no distance.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HausdorffError {
    /// A mesh has no triangles.
    #[error("a mesh without triangles has no distance to another mesh")]
    Empty,
    /// The tolerance is not a positive length.
    #[error("the tolerance is {0}, but must be a positive length")]
    Tolerance(f64),
    /// The work was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// The distances between the surfaces `a` and `b`, both ways.
///
/// # Errors
/// [`HausdorffError::Empty`], [`HausdorffError::Tolerance`], and [`HausdorffError::Cancelled`] soon after `progress` is
/// cancelled.
pub fn hausdorff(
    a: &TriMesh,
    b: &TriMesh,
    params: &HausdorffParams,
    progress: &Progress,
) -> Result<Hausdorff, HausdorffError> {
    let forward = distances_to(a, &Bvh::try_new(b, progress)?, params, progress)?;
    let backward = distances_to(b, &Bvh::try_new(a, progress)?, params, progress)?;
    Ok(Hausdorff { forward, backward })
}

/// The distances of the points of `surface` to the triangles of `other`.
///
/// # Errors
/// As [`hausdorff`].
pub fn distances_to(
    surface: &TriMesh,
    other: &Bvh,
    params: &HausdorffParams,
    progress: &Progress,
) -> Result<OneSided, HausdorffError> {
    if !(params.tolerance > 0.0 && params.tolerance.is_finite()) {
        return Err(HausdorffError::Tolerance(params.tolerance));
    }
    if surface.triangles().is_empty() || other.is_empty() {
        return Err(HausdorffError::Empty);
    }
    let vertices = nearest_of_vertices(surface, other, progress)?;
    let corners = surface.triangles().iter().flatten();
    let mut farthest = Farthest::default();
    for &vertex in corners {
        farthest.offer(
            surface.positions()[vertex as usize],
            vertices[vertex as usize],
        );
    }
    let (mean, rms) = sampled(surface, other, params.samples, &mut farthest, progress)?;
    let upper = enclosed(surface, other, params, &vertices, &mut farthest, progress)?;
    let to = other.closest_with_hint(farthest.at, farthest.near.triangle);
    Ok(OneSided {
        lower: farthest.near.distance,
        upper,
        from: farthest.at,
        to: to.map_or(farthest.at, |closest| closest.point),
        mean,
        rms,
    })
}

/// The distance of each vertex of `mesh` to the closest triangle of `other`, as for coloring; not a number if `other` has
/// no triangles.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn vertex_distances(
    mesh: &TriMesh,
    other: &Bvh,
    progress: &Progress,
) -> Result<Vec<f64>, Cancelled> {
    if other.is_empty() {
        return Ok(vec![f64::NAN; mesh.positions().len()]);
    }
    let nearest = nearest_of_vertices(mesh, other, progress)?;
    Ok(nearest.into_iter().map(|near| near.distance).collect())
}

/// A triangle of the other surface, and its distance.
#[derive(Debug, Clone, Copy)]
struct Near {
    triangle: u32,
    distance: f64,
}

/// Queries between two checks for cancellation: some milliseconds of work.
const CHUNK: usize = 1024;

/// The point closest to `p`; the other surface is not empty and `p` finite.
#[inline]
fn near(other: &Bvh, p: DVec3, hint: u32) -> Near {
    match other.closest_with_hint(p, hint) {
        Some(closest) => Near {
            triangle: closest.triangle,
            distance: closest.distance_sq.sqrt(),
        },
        None => Near {
            triangle: hint,
            distance: distance_sq_to_triangle(p, other.corners(hint)).sqrt(),
        },
    }
}

fn nearest_of_vertices(
    mesh: &TriMesh,
    other: &Bvh,
    progress: &Progress,
) -> Result<Vec<Near>, Cancelled> {
    let positions = mesh.positions();
    let phase = progress.phase("vertices", positions.len() as u64);
    let chunks: Vec<Vec<Near>> = positions
        .par_chunks(CHUNK)
        .map(|chunk| {
            progress.check()?;
            // Neighbors in the list tend to be neighbors in space.
            let mut hint = 0;
            let found = chunk.iter().map(|&p| {
                let near = near(other, p, hint);
                hint = near.triangle;
                near
            });
            let found = found.collect();
            phase.advance(chunk.len() as u64);
            Ok(found)
        })
        .collect::<Result<_, Cancelled>>()?;
    Ok(chunks.into_iter().flatten().collect())
}

/// The farthest place so far.
#[derive(Debug, Clone, Copy)]
struct Farthest {
    at: DVec3,
    near: Near,
}

impl Default for Farthest {
    fn default() -> Self {
        Self {
            at: DVec3::ZERO,
            near: Near {
                triangle: 0,
                distance: -1.0,
            },
        }
    }
}

impl Farthest {
    /// The first of equally far ones stays.
    fn offer(&mut self, at: DVec3, near: Near) {
        if near.distance > self.near.distance {
            *self = Self { at, near };
        }
    }
}

/// Mean and root mean square over places that are spread evenly over the area.
///
/// The area is cut in equal shares, triangle after triangle, with one place in each; where in its triangle follows the
/// sequence of Roberts (multiples of the inverse powers of 1.3247), which leaves no gaps and needs no random numbers.
fn sampled(
    surface: &TriMesh,
    other: &Bvh,
    samples: u32,
    farthest: &mut Farthest,
    progress: &Progress,
) -> Result<(f64, f64), Cancelled> {
    let triangles = 0..surface.triangles().len() as u32;
    let mut total = 0.0;
    let mut area_before = Vec::with_capacity(triangles.len());
    for triangle in triangles {
        if triangle.is_multiple_of(1 << 16) {
            progress.check()?;
        }
        let [a, b, c] = surface.corners(triangle);
        area_before.push(total);
        total += 0.5 * (b - a).cross(c - a).length();
    }
    if samples == 0 || total <= 0.0 {
        return Ok((0.0, 0.0));
    }
    let place = |sample: u32| {
        let area = (f64::from(sample) + 0.5) / f64::from(samples) * total;
        let triangle = area_before.partition_point(|&before| before <= area) - 1;
        let [a, b, c] = surface.corners(triangle as u32);
        let along = |step: f64| (0.5 + f64::from(sample) * step).fract();
        let (mut s, mut t) = (
            along(0.754_877_666_246_692_8),
            along(0.569_840_290_998_053_2),
        );
        if s + t > 1.0 {
            (s, t) = (1.0 - s, 1.0 - t);
        }
        a + (b - a) * s + (c - a) * t
    };
    let phase = progress.phase("samples", samples.into());
    let step = CHUNK as u32;
    let chunks: Vec<(f64, f64, Farthest)> = (0..samples.div_ceil(step))
        .into_par_iter()
        .map(|chunk| {
            progress.check()?;
            let chunk = chunk * step..(chunk * step).saturating_add(step).min(samples);
            let (mut sum, mut squares, mut farthest) = (0.0, 0.0, Farthest::default());
            let (count, mut hint) = (chunk.len() as u64, 0);
            for sample in chunk {
                let at = place(sample);
                let near = near(other, at, hint);
                hint = near.triangle;
                sum += near.distance;
                squares += near.distance * near.distance;
                farthest.offer(at, near);
            }
            phase.advance(count);
            Ok((sum, squares, farthest))
        })
        .collect::<Result<_, Cancelled>>()?;
    let (mut sum, mut squares) = (0.0, 0.0);
    for chunk in chunks {
        sum += chunk.0;
        squares += chunk.1;
        farthest.offer(chunk.2.at, chunk.2.near);
    }
    let count = f64::from(samples);
    Ok((sum / count, (squares / count).sqrt()))
}

/// A part of a triangle, with what is closest to its corners.
#[derive(Debug, Clone, Copy)]
struct Piece {
    corners: [DVec3; 3],
    near: [Near; 3],
    /// The point closest to its middle, if that was searched.
    middle: Option<Near>,
    /// No point of the piece is farther from the other surface.
    upper: f64,
    /// Order of creation; the older of two equal ones goes first.
    order: u64,
}

impl Piece {
    /// The piece with these corners. Its bound is made no lower than it takes to fall to `enough`.
    fn new(other: &Bvh, corners: [DVec3; 3], near: [Near; 3], enough: f64) -> Self {
        // No point is farther from the nearest corner than the longest edge over the root of 3.
        let edge_sq = |i: usize| corners[i].distance_squared(corners[(i + 1) % 3]);
        let reach = (edge_sq(0).max(edge_sq(1)).max(edge_sq(2)) / 3.0).sqrt();
        let farthest = near
            .iter()
            .fold(0.0_f64, |most, near| most.max(near.distance));
        let mut piece = Self {
            corners,
            near,
            middle: None,
            upper: farthest + reach,
            order: 0,
        };
        for (i, &Near { triangle, .. }) in near.iter().enumerate() {
            if !near[..i].iter().any(|near| near.triangle == triangle) {
                piece.bound_by(other, triangle);
            }
        }
        // At corners many triangles are equally close, often others than the one below the piece.
        if piece.upper > enough {
            let middle = near_middle(other, &piece);
            piece.middle = Some(middle);
            piece.bound_by(other, middle.triangle);
        }
        piece.upper = piece.upper.max(farthest);
        piece
    }

    fn middle(&self) -> DVec3 {
        (self.corners[0] + self.corners[1] + self.corners[2]) / 3.0
    }

    fn bound_by(&mut self, other: &Bvh, triangle: u32) {
        let triangle = other.corners(triangle);
        let over_sq = self
            .corners
            .map(|corner| distance_sq_to_triangle(corner, triangle))
            .into_iter()
            .fold(0.0, f64::max);
        self.upper = self.upper.min(over_sq.sqrt());
    }

    /// Four pieces, cut at the middles of the edges.
    fn cut(&self, other: &Bvh, enough: f64) -> [Self; 4] {
        let [a, b, c] = self.corners;
        let [na, nb, nc] = self.near;
        let middle = |i: usize| {
            let at = 0.5 * (self.corners[i] + self.corners[(i + 1) % 3]);
            (at, near(other, at, self.near[i].triangle))
        };
        let [(ab, nab), (bc, nbc), (ca, nca)] = [0, 1, 2].map(middle);
        [
            Self::new(other, [a, ab, ca], [na, nab, nca], enough),
            Self::new(other, [b, bc, ab], [nb, nbc, nab], enough),
            Self::new(other, [c, ca, bc], [nc, nca, nbc], enough),
            Self::new(other, [ab, bc, ca], [nab, nbc, nca], enough),
        ]
    }

    /// The places of a piece that was examined.
    fn offer_to(&self, farthest: &mut Farthest) {
        for (&at, &near) in self.corners.iter().zip(&self.near) {
            farthest.offer(at, near);
        }
        if let Some(near) = self.middle {
            farthest.offer(self.middle(), near);
        }
    }
}

fn near_middle(other: &Bvh, piece: &Piece) -> Near {
    near(other, piece.middle(), piece.near[0].triangle)
}

impl Ord for Piece {
    fn cmp(&self, other: &Self) -> Ordering {
        self.upper
            .total_cmp(&other.upper)
            .then(other.order.cmp(&self.order))
    }
}

impl PartialOrd for Piece {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Piece {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Piece {}

/// Pieces that are cut at the same time. More uses many cores better, fewer cuts less in vain.
const ROUND: usize = 4096;

/// A distance that no point of `surface` exceeds; raises `farthest` on the way.
fn enclosed(
    surface: &TriMesh,
    other: &Bvh,
    params: &HausdorffParams,
    vertices: &[Near],
    farthest: &mut Farthest,
    progress: &Progress,
) -> Result<f64, Cancelled> {
    let enough = farthest.near.distance + params.tolerance;
    let chunks: Vec<(Vec<Piece>, f64)> = surface
        .triangles()
        .par_chunks(CHUNK)
        .map(|chunk| {
            progress.check()?;
            let (mut pieces, mut upper) = (Vec::new(), 0.0_f64);
            for &corners in chunk {
                let near = corners.map(|vertex| vertices[vertex as usize]);
                let corners = corners.map(|vertex| surface.positions()[vertex as usize]);
                let piece = Piece::new(other, corners, near, enough);
                if piece.upper <= enough {
                    upper = upper.max(piece.upper);
                } else {
                    pieces.push(piece);
                }
            }
            Ok((pieces, upper))
        })
        .collect::<Result<_, Cancelled>>()?;
    // The largest bound among pieces that were put away.
    let mut upper = 0.0_f64;
    let mut heap = BinaryHeap::new();
    let mut order = 0;
    for (pieces, most) in chunks {
        progress.check()?;
        upper = upper.max(most);
        for piece in pieces {
            piece.offer_to(farthest);
            heap.push(Piece { order, ..piece });
            order += 1;
        }
    }
    let phase = progress.phase("bounds", params.max_pieces);
    while order < params.max_pieces {
        let enough = farthest.near.distance + params.tolerance;
        let mut round = Vec::new();
        while round.len() < ROUND && heap.peek().is_some_and(|piece| piece.upper > enough) {
            round.extend(heap.pop());
        }
        if round.is_empty() {
            break;
        }
        let cut: Vec<[Piece; 4]> = round
            .par_iter()
            .map(|piece| {
                progress.check()?;
                Ok(piece.cut(other, enough))
            })
            .collect::<Result<_, Cancelled>>()?;
        for piece in cut.iter().flatten() {
            piece.offer_to(farthest);
        }
        let enough = farthest.near.distance + params.tolerance;
        for (parent, pieces) in round.iter().zip(cut) {
            for piece in pieces {
                // A bound of the whole holds for its parts.
                let piece = Piece {
                    upper: piece.upper.min(parent.upper),
                    order,
                    ..piece
                };
                order += 1;
                if piece.upper <= enough {
                    upper = upper.max(piece.upper);
                } else {
                    heap.push(piece);
                }
            }
        }
        phase.advance(4 * round.len() as u64);
    }
    let left = heap.peek().map_or(0.0, |piece| piece.upper);
    Ok(upper.max(left).max(farthest.near.distance))
}

#[cfg(test)]
mod tests;
