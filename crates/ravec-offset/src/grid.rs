//! The places that vertices may have.
//!
//! What a file cannot hold is rounded when it is written, and slivers that were apart may meet then. So, for a file of 32-bit
//! floats, every vertex is put on such numbers as soon as it comes to be, before anything is decided about its triangles; and
//! cells are laid so that all their corners have such coordinates. Rounding then leaves a vertex in its cell, in its face or
//! on its edge, and what keeps triangles apart in exact numbers keeps them apart here.

use crate::params::{Coordinates, OffsetError};
use glam::DVec3;
use ravec_mesh::TriMesh;
use ravec_octree::{Frame, MAX_LEVEL};
use rayon::prelude::*;
use rustc_hash::FxHashSet;

/// How many levels below the floor, where cells are as small as the tolerance, cells may have to be split.
pub(crate) const LEVELS_BELOW_FLOOR: u8 = 3;

/// Cells measure at least this many steps, so that there are places inside them, and inside their faces and edges.
const LEAST_STEPS: f64 = 4.0;

/// The share of the way to their samples by which several vertices in a cell part. From 0.02 to 0.3 it makes little
/// difference; at 0, a designed part took twice as many rounds of mending.
const PART: f64 = 0.05;

/// The least tolerance in steps: cells of the floor, which are half as small as the tolerance over √3 or larger, are then
/// larger than [`LEAST_STEPS`].
const LEAST_TOLERANCE: f64 = 16.0;

/// The places of vertices in the cells of a tree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    coordinates: Coordinates,
    /// Corners of cells are this far apart, or a multiple of it; 0 if they may be anywhere.
    step: f64,
    /// Cells of levels below have corners that are not on the grid.
    pub deepest: u8,
}

impl Grid {
    /// The grid for the tree over a cube, which is moved a little to fit it.
    pub fn fit(
        coordinates: Coordinates,
        frame: &mut Frame,
        tolerance: f64,
    ) -> Result<Self, OffsetError> {
        if coordinates == Coordinates::Double {
            return Ok(Self {
                coordinates,
                step: 0.0,
                deepest: MAX_LEVEL,
            });
        }
        let mut step = step_at(farthest(frame));
        loop {
            let least = LEAST_TOLERANCE * step;
            if tolerance < least {
                return Err(OffsetError::SinglePrecision {
                    got: tolerance,
                    least,
                });
            }
            let wanted = floor_level(frame.side, tolerance) + LEVELS_BELOW_FLOOR;
            let possible = (frame.side / (LEAST_STEPS * step)).log2().floor();
            let deepest = wanted.min(possible as u8).min(MAX_LEVEL);
            let steps = (frame.side / step / f64::from(1u32 << deepest)).ceil();
            let fitted = Frame {
                origin: step * (frame.origin / step).floor(),
                side: steps * step * f64::from(1u32 << deepest),
            };
            // beyond this, numbers are two steps apart
            if farthest(&fitted) <= step * f64::from(1u32 << f32::MANTISSA_DIGITS) {
                *frame = fitted;
                return Ok(Self {
                    coordinates,
                    step,
                    deepest,
                });
            }
            step *= 2.0;
        }
    }

    /// Whether vertices may be in some places only.
    pub fn is_coarse(&self) -> bool {
        self.step > 0.0
    }

    /// The place nearest to `p` that a vertex may have.
    #[inline]
    pub fn nearest(&self, p: DVec3) -> DVec3 {
        self.coordinates.nearest(p)
    }

    /// The place for one of several vertices in a cell, each of which has samples of its own.
    ///
    /// At a crease several of them are put in one place, but for rounding. In single precision they would often be in one
    /// plane exactly, and their triangles meet; towards their own samples they part.
    pub fn apart(&self, p: DVec3, samples: impl ExactSizeIterator<Item = DVec3>) -> DVec3 {
        if !self.is_coarse() {
            return p;
        }
        let count = samples.len() as f64;
        self.nearest(p.lerp(samples.sum::<DVec3>() / count, PART))
    }

    /// The share of its size that a vertex keeps away from the border of its cell, face or edge: at least `share`, and
    /// enough for rounding to leave it inside.
    #[inline]
    pub fn margin(&self, share: f64, size: f64) -> f64 {
        share.max(self.step / size)
    }
}

impl Coordinates {
    /// The place nearest to `p` that has such coordinates.
    #[inline]
    pub(crate) fn nearest(self, p: DVec3) -> DVec3 {
        match self {
            Self::Double => p,
            Self::Single => p.as_vec3().as_dvec3(),
        }
    }
}

/// A mesh with its vertices at places that such coordinates hold, and how far one of them is moved at most; nothing if one is
/// beyond all of them.
pub(crate) fn rounded(mesh: &TriMesh, coordinates: Coordinates) -> Option<(TriMesh, f64)> {
    let nearest = |&p: &DVec3| coordinates.nearest(p);
    let positions: Vec<DVec3> = mesh.positions().iter().map(nearest).collect();
    let moves = positions.iter().zip(mesh.positions());
    let moved = moves.map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
    let rounded = TriMesh::new(positions, mesh.triangles().to_vec());
    Some((rounded.ok()?, moved))
}

/// The vertices that are where another one is.
pub(crate) fn doubled(positions: &[DVec3]) -> FxHashSet<u32> {
    let mut by_place: Vec<([u64; 3], u32)> = positions
        .iter()
        // of the two zeros, one
        .map(|&p| (p + DVec3::ZERO).to_array().map(f64::to_bits))
        .zip(0..)
        .collect();
    by_place.par_sort_unstable();
    by_place
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|group| group.len() > 1)
        .flatten()
        .map(|&(_, v)| v)
        .collect()
}

/// The level at which cells of a tree are so small that any place in them is within the tolerance of any other.
pub(crate) fn floor_level(side: f64, tolerance: f64) -> u8 {
    let floor_side = tolerance / 3f64.sqrt();
    (side / floor_side).log2().ceil().max(0.0) as u8
}

/// The largest coordinate, but for its sign, of a cube's corners.
fn farthest(frame: &Frame) -> f64 {
    let ends = [frame.origin, frame.origin + DVec3::splat(frame.side)];
    ends[0].abs().max(ends[1].abs()).max_element()
}

/// The gap between 32-bit floats just below a positive number, or more.
fn step_at(number: f64) -> f64 {
    let exponent = number.log2().ceil() as i32;
    // the smallest numbers are equally far apart
    2f64.powi(exponent.max(f32::MIN_EXP) - f32::MANTISSA_DIGITS as i32)
}
