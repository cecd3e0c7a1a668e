//! Values at the corners of cells, and the edges between them.

use glam::DVec3;
use ravec_octree::{CellKey, Corner};
use rustc_hash::FxHashMap;

/// A point of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sample {
    pub point: DVec3,
    /// Unit vector away from the triangles: the normal of the surface except for its sign.
    pub away: DVec3,
    pub triangle: u32,
}

/// The field at a corner of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CornerValue {
    /// The closest triangle.
    pub triangle: u32,
    /// Value of the field: negative inside the offset solid.
    pub value: f64,
}

/// An edge of a cell: its lower end, level and direction, sorted in Morton order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct EdgeKey {
    /// Morton code of the lower end.
    start: u64,
    level: u8,
    axis: u8,
}

impl EdgeKey {
    /// Returns the ends, the lower one first.
    pub fn ends(self) -> [Corner; 2] {
        let start = Corner::at_morton(self.start);
        let level = CellKey {
            at: start,
            level: self.level,
        };
        [start, start.moved(self.axis.into(), level.side())]
    }
}

/// Points at which the surface crosses edges.
pub(crate) type Roots = FxHashMap<EdgeKey, Sample>;

/// Returns a bit for each corner that lies inside.
pub(crate) fn inside_of(corners: &[CornerValue; 8]) -> u8 {
    (0..8)
        .filter(|&octant| corners[octant].value < 0.0)
        .map(|octant| 1 << octant)
        .sum()
}

/// Returns the edges of a cell whose ends have different signs.
pub(crate) fn crossed_edges(key: CellKey, inside: u8) -> impl Iterator<Item = EdgeKey> {
    (0..24).filter_map(move |i| {
        let (octant, axis) = (i % 8, i / 8);
        let is_lower = octant >> axis & 1 == 0;
        let differs = (inside >> octant ^ inside >> (octant | 1 << axis)) & 1 == 1;
        (is_lower && differs).then(|| EdgeKey {
            start: key.corner(octant).morton(),
            level: key.level,
            axis: axis as u8,
        })
    })
}
