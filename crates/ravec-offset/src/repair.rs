//! Step 6, repair: rounds of growing, extracting and proving until no defect is left.

mod rounds;
mod separation;
mod workspace;

pub(crate) use rounds::{Budget, Repair, Repaired, Round, children, divide_tile};

use workspace::{GrownTile, Workspace};
