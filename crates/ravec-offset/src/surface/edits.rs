//! Edits of the tree that repair the surface.

use super::Reach;
use ravec_octree::{CellKey, Corner};
use rustc_hash::FxHashSet;

/// Edits of the tree.
#[derive(Debug, Clone, Default)]
pub(crate) struct Edits {
    /// Leaves to split, whatever they hold.
    pub split: FxHashSet<CellKey>,
    /// Corners to count as inside.
    pub filled: FxHashSet<Corner>,
}

impl Edits {
    pub fn is_empty(&self) -> bool {
        self.split.is_empty() && self.filled.is_empty()
    }

    /// Adds all of `other`.
    pub fn extend(&mut self, other: &Self) {
        self.split.extend(&other.split);
        self.filled.extend(&other.filled);
    }

    /// Returns whether an edit changes something within a reach.
    pub fn affect(&self, reach: &Reach) -> bool {
        self.split.iter().any(|&cell| reach.touches(cell))
            || self.filled.iter().any(|&corner| reach.holds(corner))
    }
}
