//! The grid: positions that vertices may have.
//!
//! Rounding to 32-bit floats after the proofs could let triangles that were apart intersect. So for files of 32-bit floats
//! every vertex is placed on representable numbers before anything is decided about its triangles, and cells are laid such that
//! all corners have representable coordinates. Rounding then leaves a vertex in its cell, face or edge, and the arguments that
//! keep triangles apart in exact numbers hold here as well.

use crate::params::OffsetError;
use glam::DVec3;
use ravec_mesh::{Coordinates, TriMesh};
use ravec_octree::{Frame, MAX_LEVEL};

/// Levels below the floor, where cells are as small as the tolerance, to which cells may be split.
pub(crate) const LEVELS_BELOW_FLOOR: u8 = 2;

/// Smallest size of cells in steps, so that cells, faces and edges have positions in their interior.
const MIN_STEPS: f64 = 4.0;

/// Share of the way to their samples by which several vertices in a cell move apart. At 0, triangles at creases are coplanar
/// and intersect; values from 0.02 to 0.3 differ little.
const SEPARATION: f64 = 0.05;

/// Smallest tolerance in steps: cells of the floor, at least half the tolerance over √3 wide, are then larger than
/// [`MIN_STEPS`].
const MIN_TOLERANCE: f64 = 16.0;

/// The positions of vertices in the cells of a tree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    coordinates: Coordinates,
    /// Corners of cells are multiples of this apart; 0 if positions are not restricted.
    step: f64,
    /// Finest level whose corners are on the grid.
    pub deepest: u8,
}

impl Grid {
    /// Fits the grid to the tree over a cube, which is moved slightly.
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
            let least = MIN_TOLERANCE * step;
            if tolerance < least {
                return Err(OffsetError::SinglePrecision {
                    got: tolerance,
                    least,
                });
            }
            let wanted = floor_level(frame.side, tolerance) + LEVELS_BELOW_FLOOR;
            let possible = (frame.side / (MIN_STEPS * step)).log2().floor();
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

    /// Returns whether positions are restricted.
    pub fn is_coarse(&self) -> bool {
        self.step > 0.0
    }

    /// Rounds to the nearest position.
    #[inline]
    pub fn nearest(&self, p: DVec3) -> DVec3 {
        self.coordinates.nearest(p)
    }

    /// Returns the position of one of several vertices in a cell, each with samples of its own.
    ///
    /// At a crease, several vertices are placed at one position except for rounding. In single precision they would often be
    /// exactly coplanar, and their triangles would intersect; moved towards their own samples, they separate.
    pub fn apart(&self, p: DVec3, samples: impl ExactSizeIterator<Item = DVec3>) -> DVec3 {
        if !self.is_coarse() {
            return p;
        }
        let count = samples.len() as f64;
        self.nearest(p.lerp(samples.sum::<DVec3>() / count, SEPARATION))
    }

    /// Share of its size that a vertex keeps from the border of its cell, face or edge: at least `share`, and enough for
    /// rounding to leave it inside.
    #[inline]
    pub fn margin(&self, share: f64, size: f64) -> f64 {
        share.max(self.step / size)
    }
}

/// Rounds the vertices of a mesh to representable coordinates; returns the mesh and the largest displacement, or `None` if a
/// coordinate is out of range.
pub(crate) fn rounded(mesh: &TriMesh, coordinates: Coordinates) -> Option<(TriMesh, f64)> {
    let nearest = |&p: &DVec3| coordinates.nearest(p);
    let positions: Vec<DVec3> = mesh.positions().iter().map(nearest).collect();
    let moves = positions.iter().zip(mesh.positions());
    let moved = moves.map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
    let rounded = TriMesh::new(positions, mesh.triangles().to_vec());
    Some((rounded.ok()?, moved))
}

/// Returns the level at which any two points of a cell are within the tolerance of each other.
pub(crate) fn floor_level(side: f64, tolerance: f64) -> u8 {
    let floor_side = tolerance / 3f64.sqrt();
    (side / floor_side).log2().ceil().max(0.0) as u8
}

/// Largest absolute coordinate of the corners of a cube.
fn farthest(frame: &Frame) -> f64 {
    let ends = [frame.origin, frame.origin + DVec3::splat(frame.side)];
    ends[0].abs().max(ends[1].abs()).max_element()
}

/// Upper bound of the gap between 32-bit floats below a positive number.
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
                prop_assert!(tolerance < 2.0 * MIN_TOLERANCE * step_at(farthest(&asked)));
                return Ok(());
            };
            // the cube hardly changes, and its cells become as small as needed
            let moved = (frame.origin - asked.origin).abs().max_element();
            prop_assert!(moved <= grid.step && (asked.side..=1.25 * asked.side).contains(&frame.side));
            prop_assert!(frame.side_at(grid.deepest) >= MIN_STEPS * grid.step);
            prop_assert!(grid.deepest >= floor_level(frame.side, tolerance));
            let coarse = at.map(|x| x >> (MAX_LEVEL - grid.deepest) << (MAX_LEVEL - grid.deepest));
            let corner = frame.point(Corner(coarse));
            prop_assert_eq!(grid.nearest(corner), corner);
        }
    }

    #[test]
    fn coordinates_beyond_32_bit_floats_are_refused() {
        let mut frame = Frame {
            origin: DVec3::ZERO,
            side: 1e39,
        };
        let error = Grid::fit(Coordinates::Single, &mut frame, 1e37).unwrap_err();
        assert_eq!(error, OffsetError::BeyondSinglePrecision);
        assert!(Grid::fit(Coordinates::Double, &mut frame, 1e37).is_ok());
    }
}
