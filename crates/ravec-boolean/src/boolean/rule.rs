//! The rule that says what is inside a mesh.

use crate::arrangement::Cells;
use crate::params::Inside;

/// The places inside each mesh, cell by cell.
pub(super) struct Rule<'a> {
    pub cells: &'a Cells,
    pub inside: Inside,
    /// For each mesh the cells that it cuts off from the outside, where that counts.
    hulls: Vec<Vec<bool>>,
}

impl<'a> Rule<'a> {
    pub fn new(cells: &'a Cells, meshes: usize, inside: Inside) -> Self {
        let hulls = match inside {
            Inside::OuterHull => (0..meshes as u32).map(|m| cells.enclosed_by(m)).collect(),
            Inside::Positive | Inside::Nonzero => Vec::new(),
        };
        Self {
            cells,
            inside,
            hulls,
        }
    }

    /// Returns `true` if a cell is inside a mesh.
    pub fn holds(&self, mesh: usize, cell: u32) -> bool {
        match self.inside {
            Inside::Positive => self.cells.winding(cell)[mesh] > 0,
            Inside::Nonzero => self.cells.winding(cell)[mesh] != 0,
            Inside::OuterHull => self.hulls[mesh][cell as usize],
        }
    }
}
