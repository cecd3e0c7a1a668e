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
pub(crate) const LEVELS_BELOW_FLOOR: u8 = 2;

/// Cells measure at least this many steps, so that there are places inside them, and inside their faces and edges.
const LEAST_STEPS: f64 = 4.0;

/// The share of the way to their samples by which several vertices in a cell part. From 0.02 to 0.3 it makes little
/// difference; at 0, hundreds of corners had to be filled on a designed part to keep triangles apart.
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
            let largest = farthest(frame);
            if largest >= f64::from(f32::MAX) {
                return Err(OffsetError::BeyondSinglePrecision);
            }
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use ravec_octree::Corner;

    proptest! {
        #[test]
        fn corners_of_all_cells_are_numbers_of_32_bits(
            origin in [-1.0..1.0, -1.0..1.0, -1.0..1.0],
            (place, size) in (-3..4, -3..4),
            share in 1.5e-6..0.1,
            at in [0..=1_u32 << 20, 0..=1_u32 << 20, 0..=1_u32 << 20],
        ) {
            let asked = Frame {
                origin: 10f64.powi(place) * DVec3::from_array(origin),
                side: 10f64.powi(size),
            };
            let mut frame = asked;
            let tolerance = share * farthest(&asked).max(asked.side);
            let Ok(grid) = Grid::fit(Coordinates::Single, &mut frame, tolerance) else {
                prop_assert!(tolerance < 2.0 * LEAST_TOLERANCE * step_at(farthest(&asked)));
                return Ok(());
            };
            // it is hardly another cube, and its cells become as small as is needed
            let moved = (frame.origin - asked.origin).abs().max_element();
            prop_assert!(moved <= grid.step && (asked.side..=1.25 * asked.side).contains(&frame.side));
            prop_assert!(frame.side_at(grid.deepest) >= LEAST_STEPS * grid.step);
            prop_assert!(grid.deepest >= floor_level(frame.side, tolerance));
            let coarse = at.map(|x| x >> (MAX_LEVEL - grid.deepest) << (MAX_LEVEL - grid.deepest));
            let corner = frame.point(Corner(coarse));
            prop_assert_eq!(grid.nearest(corner), corner);
        }
    }

    #[test]
    fn what_is_beyond_all_numbers_of_32_bits_is_refused() {
        let mut frame = Frame {
            origin: DVec3::ZERO,
            side: 1e39,
        };
        let error = Grid::fit(Coordinates::Single, &mut frame, 1e37).unwrap_err();
        assert_eq!(error, OffsetError::BeyondSinglePrecision);
        assert!(Grid::fit(Coordinates::Double, &mut frame, 1e37).is_ok());
    }

    #[test]
    fn vertices_in_one_place_are_found_whatever_the_sign_of_zero() {
        let places = [DVec3::ZERO, DVec3::X, DVec3::new(-0.0, 0.0, -0.0)];
        let mut found: Vec<u32> = doubled(&places).into_iter().collect();
        found.sort_unstable();
        assert_eq!(found, [0, 2]);
    }
}
