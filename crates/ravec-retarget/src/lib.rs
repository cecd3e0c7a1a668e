//! Content-aware retargeting: one picture in many formats, with objects in shape and lines straight.

mod analysis;
mod barrier;
mod bounds;
mod deformation;
mod forms;
mod grid;
mod importance;
mod locate;
mod params;
mod quadtree;
mod retargeter;
mod runs;
mod system;
mod warp;

pub use deformation::{Deformation, GridLine, SolveSummary};
pub use params::{Borders, RetargetError, RetargetParams};
pub use retargeter::{AnalysisSummary, Painted, Retargeter};
pub use warp::WarpFilter;
