//! The reach of a tile: the tile and the leaves that its surface depends on.
//!
//! A tile owns the polygons whose edges start in it. Their corners lie in leaves that touch it, and these leaves depend on the
//! leaves around them; so the tree of a tile is grown over its reach. All results depend on leaves and their surroundings only,
//! and so do the names of vertices ([`VertexName`](super::VertexName)): tiles fit bit by bit, without geometric comparison
//! where they meet.
//!
//! Guarantees: the same surface, vertex by vertex and triangle by triangle, for any division into tiles.

use ravec_octree::{CellKey, CellSet, Corner};
use serde::{Deserialize, Serialize};

/// Number of times a reach is widened by the leaves around its crossed edges. Polygons of a tile have corners in leaves of the
/// first ring; triangles that may intersect them near a crowded leaf have corners up to two leaves farther.
pub(crate) const RINGS: usize = 3;

/// A tile and leaves around it, closed sets.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(from = "ListedReach", into = "ListedReach")]
pub(crate) struct Reach {
    tile: CellKey,
    leaves: CellSet,
}

/// A reach as data: the tile and the leaves.
#[derive(Serialize, Deserialize)]
struct ListedReach(CellKey, Vec<CellKey>);

impl From<Reach> for ListedReach {
    fn from(reach: Reach) -> Self {
        Self(reach.tile, reach.leaves())
    }
}

impl From<ListedReach> for Reach {
    fn from(ListedReach(tile, leaves): ListedReach) -> Self {
        let mut reach = Self::of(tile);
        for leaf in leaves {
            reach.include(leaf);
        }
        reach
    }
}

impl Reach {
    pub fn of(tile: CellKey) -> Self {
        Self {
            tile,
            leaves: CellSet::default(),
        }
    }

    /// Returns the leaves outside the tile.
    pub fn leaves(&self) -> Vec<CellKey> {
        self.leaves.members()
    }

    /// Returns whether a cell shares a point with the reach.
    pub fn touches(&self, cell: CellKey) -> bool {
        self.holds_between(cell.corner(0), cell.corner(7))
    }

    /// Returns whether a point is in the reach.
    pub fn holds(&self, point: Corner) -> bool {
        self.holds_between(point, point)
    }

    /// Returns whether all of a cell is in the tile or in one of the leaves.
    pub fn contains(&self, cell: CellKey) -> bool {
        self.is_in_tile(cell) || self.leaves.contains(cell)
    }

    fn is_in_tile(&self, cell: CellKey) -> bool {
        self.tile.level <= cell.level && self.tile.owns(cell.at)
    }

    /// Returns whether the box between two points touches the reach.
    pub fn holds_between(&self, low: Corner, high: Corner) -> bool {
        let (first, last) = (self.tile.corner(0), self.tile.corner(7));
        let is_at_tile =
            (0..3).all(|axis| low.0[axis] <= last.0[axis] && high.0[axis] >= first.0[axis]);
        is_at_tile || self.leaves.touches([low, high])
    }

    pub fn include(&mut self, leaf: CellKey) {
        if !self.is_in_tile(leaf) {
            self.leaves.insert(leaf);
        }
    }
}
