//! Offset surfaces of any triangles, within a tolerance that is proved.

mod cell;
mod certify;
mod extract;
mod field;
mod offset;
mod params;
mod refine;
mod regions;

pub use offset::{Offset, OffsetReport, offset};
pub use params::{OffsetError, OffsetParams, Side};
