//! Inputs of a tree.

use crate::domain::{Enclosed, Field, Grid, LEVELS_BELOW_FLOOR, floor_level};
use ravec_octree::{Frame, MAX_LEVEL};

/// Inputs of a tree.
#[derive(Clone, Copy)]
pub(crate) struct Setting<'a> {
    pub field: &'a Field<'a>,
    /// Space that is ignored.
    pub enclosed: &'a Enclosed,
    pub frame: Frame,
    pub grid: Grid,
    pub tolerance: f64,
}

impl Setting<'_> {
    /// Finest level to which cells are split because of their content.
    pub fn floor(&self) -> u8 {
        let floor = floor_level(self.frame.side, self.tolerance);
        floor.min(MAX_LEVEL - 2).min(self.grid.deepest)
    }

    /// Finest level: cells are so small that the surface may pass anywhere in them.
    pub fn limit(&self) -> u8 {
        (self.floor() + LEVELS_BELOW_FLOOR).min(self.grid.deepest)
    }
}
