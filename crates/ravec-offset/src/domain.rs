//! Step 1, the domain: the distance field, the grid of coordinates, and space that is enclosed.

mod enclosed;
mod field;
mod grid;

pub(crate) use enclosed::{Enclosed, Enclosure};
pub(crate) use field::{Field, Near, Place, Region, Solid};
pub(crate) use grid::{Grid, LEVELS_BELOW_FLOOR, floor_level, rounded};
