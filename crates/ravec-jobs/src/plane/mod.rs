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

use crate::error::JobError;
use crate::files::{self, Source};
use std::path::Path;

/// Whether one picture can be read and another, if any, be written: said before anything is worked out.
fn check_paths(input: &Source, output: Option<&Path>) -> Result<(), JobError> {
    let outputs: Vec<&Path> = output.into_iter().collect();
    files::check_files(&[&input.path], &outputs)?;
    outputs.into_iter().try_for_each(files::check_target)
}
