//! Cells and corners as integers on the lattice of the finest level, and their position in space.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Finest level: a side of the root has 2²⁰ of its cells, and a corner fits 63 bits.
pub const MAX_LEVEL: u8 = 20;

/// A point of the lattice, 0 to 2²⁰ in each direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Corner(pub [u32; 3]);

impl Corner {
    /// Returns a unique code.
    #[inline]
    pub fn code(self) -> u64 {
        let [x, y, z] = self.0.map(u64::from);
        x | y << 21 | z << 42
    }

    /// Returns the Morton code, the position on a curve that visits all points of any cell consecutively (Morton, 1966).
    #[inline]
    pub fn morton(self) -> u64 {
        let [x, y, z] = self.0.map(spread);
        x | y << 1 | z << 2
    }

    /// Returns the corner with a Morton code.
    #[inline]
    pub fn at_morton(place: u64) -> Self {
        Self([0, 1, 2].map(|axis| gathered(place >> axis)))
    }

    /// Returns the corner moved by `by` along an axis.
    #[inline]
    #[must_use]
    pub fn moved(mut self, axis: usize, by: u32) -> Self {
        self.0[axis] += by;
        self
    }
}

/// Spreads the lowest 21 bits, each with two zeros above it.
#[inline]
fn spread(x: u32) -> u64 {
    let mut x = u64::from(x);
    for (by, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        x = (x | x << by) & mask;
    }
    x
}

/// Gathers every third bit, the inverse of [`spread`].
#[inline]
fn gathered(x: u64) -> u32 {
    let mut x = x & 0x1249_2492_4924_9249;
    for (by, mask) in [
        (2, 0x10c3_0c30_c30c_30c3),
        (4, 0x100f_00f0_0f00_f00f),
        (8, 0x001f_0000_ff00_00ff),
        (16, 0x001f_0000_0000_ffff),
        (32, 0x001f_ffff),
    ] {
        x = (x | x >> by) & mask;
    }
    x as u32
}

/// A cell: its lowest corner and its level, 0 for the root.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct CellKey {
    /// The corner with the smallest coordinates.
    pub at: Corner,
    /// Number of halvings of the root, at most [`MAX_LEVEL`].
    pub level: u8,
}

impl CellKey {
    /// The cell that contains all others.
    pub const ROOT: Self = Self {
        at: Corner([0; 3]),
        level: 0,
    };

    /// Returns the side on the lattice.
    #[inline]
    pub fn side(self) -> u32 {
        1 << (MAX_LEVEL - self.level)
    }

    /// Returns the child in an octant: bit 0 of `octant` for x, 1 for y, 2 for z.
    ///
    /// # Panics
    /// On the finest level.
    #[must_use]
    pub fn child(self, octant: usize) -> Self {
        assert!(
            self.level < MAX_LEVEL,
            "a cell of the finest level has no children"
        );
        let half = self.side() / 2;
        let place = |axis: usize| self.at.0[axis] + half * (octant >> axis & 1) as u32;
        Self {
            at: Corner([0, 1, 2].map(place)),
            level: self.level + 1,
        }
    }

    /// Returns whether a point is in the cell or on one of its lower faces, so that each point has one owner per level.
    #[inline]
    pub fn owns(self, point: Corner) -> bool {
        (0..3).all(|axis| point.0[axis].wrapping_sub(self.at.0[axis]) < self.side())
    }

    /// Returns the corner in an octant.
    #[inline]
    pub fn corner(self, octant: usize) -> Corner {
        let place = |axis: usize| self.at.0[axis] + self.side() * (octant >> axis & 1) as u32;
        Corner([0, 1, 2].map(place))
    }
}

/// Position of the lattice in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Lowest corner of the root.
    pub origin: DVec3,
    /// Side of the root.
    pub side: f64,
}

impl Frame {
    /// Returns the position of a corner.
    #[inline]
    pub fn point(&self, corner: Corner) -> DVec3 {
        let step = self.side / f64::from(1u32 << MAX_LEVEL);
        let [x, y, z] = corner.0.map(f64::from);
        self.origin + step * DVec3::new(x, y, z)
    }

    /// Returns the lowest and the highest corner of a cell.
    #[inline]
    pub fn bounds(&self, cell: CellKey) -> [DVec3; 2] {
        [self.point(cell.corner(0)), self.point(cell.corner(7))]
    }

    /// Returns the side of the cells of a level.
    #[inline]
    pub fn side_at(&self, level: u8) -> f64 {
        self.side / f64::from(1u32 << level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_fill_their_parent_and_share_its_corners() {
        let parent = CellKey::ROOT.child(5).child(2);
        for octant in 0..8 {
            let child = parent.child(octant);
            assert_eq!(child.corner(octant), parent.corner(octant));
            assert_eq!(2 * child.side(), parent.side());
            // all of them meet in the middle
            assert_eq!(child.corner(7 - octant), parent.child(0).corner(7));
        }
    }

    #[test]
    fn codes_of_corners_are_unique() {
        let end = 1 << MAX_LEVEL;
        let mut codes: Vec<u64> = [0, 1, end - 1, end]
            .into_iter()
            .flat_map(|x| [0, 1, end].map(|y| [x, y]))
            .flat_map(|[x, y]| [0, 1, end].map(|z| Corner([x, y, z]).code()))
            .collect();
        codes.sort_unstable();
        codes.dedup();
        assert_eq!(codes.len(), 36);
    }

    #[test]
    fn the_curve_goes_through_cells_one_after_the_other() {
        let bit_by_bit = |corner: Corner| -> u64 {
            let bits = (0..=MAX_LEVEL).flat_map(|bit| (0..3).map(move |axis| (bit, axis)));
            bits.map(|(bit, axis)| {
                u64::from(corner.0[axis] >> bit & 1) << (3 * u32::from(bit) + axis as u32)
            })
            .sum()
        };
        let mut x = 1u32;
        for _ in 0..200 {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let corner = Corner([x >> 12, x >> 11 & 0xf_ffff, x & 0xf_ffff]);
            assert_eq!(corner.morton(), bit_by_bit(corner));
            assert_eq!(Corner::at_morton(corner.morton()), corner);
        }
        let end = Corner([1 << MAX_LEVEL; 3]);
        assert_eq!(end.morton(), bit_by_bit(end));
        assert_eq!(Corner::at_morton(end.morton()), end);
    }

    #[test]
    fn a_point_is_owned_by_one_child() {
        let parent = CellKey::ROOT.child(3);
        let m = parent.at.0[0] + parent.side() / 2;
        for point in [
            parent.at,
            Corner([m, parent.at.0[1], m - 1]),
            Corner([m; 3]),
        ] {
            let owners = (0..8).filter(|&octant| parent.child(octant).owns(point));
            assert_eq!(owners.count(), usize::from(parent.owns(point)));
        }
        assert!(!parent.owns(parent.corner(7)));
    }

    #[test]
    fn the_frame_bounds_the_root() {
        let frame = Frame {
            origin: DVec3::new(1.0, 2.0, 3.0),
            side: 8.0,
        };
        let [low, high] = frame.bounds(CellKey::ROOT);
        assert_eq!(low, frame.origin);
        assert_eq!(high, frame.origin + DVec3::splat(8.0));
        let [low, high] = frame.bounds(CellKey::ROOT.child(7));
        assert_eq!(high - low, DVec3::splat(frame.side_at(1)));
    }
}
