//! Operations on planes in a picture: seen from straight on, with a grid that snaps, proposed from nothing.

mod overlay;
pub mod planes;
mod quad;
pub mod rectify;
mod segments;
mod showcase;
pub mod snap;

pub use quad::{Focal, Grid, Quad, Ratio};
pub(crate) use showcase::show;
