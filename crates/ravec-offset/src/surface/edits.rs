//! Edits of the tree that repair the surface.

use super::Reach;
use ravec_octree::{CellKey, Corner};
use rustc_hash::FxHashSet;
use serde::{Deserialize, Serialize};

/// Edits of the tree.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "ListedEdits", into = "ListedEdits")]
pub(crate) struct Edits {
    /// Leaves to split, whatever they hold.
    pub split: FxHashSet<CellKey>,
    /// Corners to count as inside.
    pub filled: FxHashSet<Corner>,
}

/// Edits as data: both sets in order.
#[derive(Serialize, Deserialize)]
struct ListedEdits {
    split: Vec<CellKey>,
    filled: Vec<Corner>,
}

impl From<Edits> for ListedEdits {
    fn from(edits: Edits) -> Self {
        let mut split: Vec<CellKey> = edits.split.into_iter().collect();
        let mut filled: Vec<Corner> = edits.filled.into_iter().collect();
        split.sort_unstable();
        filled.sort_unstable();
        Self { split, filled }
    }
}

impl From<ListedEdits> for Edits {
    fn from(listed: ListedEdits) -> Self {
        Self {
            split: listed.split.into_iter().collect(),
            filled: listed.filled.into_iter().collect(),
        }
    }
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
