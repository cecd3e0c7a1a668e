//! Operations on planes in a picture: seen from straight on, with a grid that snaps, proposed from nothing.

pub mod overlay;
pub mod planes;
mod quad;
pub mod rectify;
pub mod snap;

pub(crate) use overlay::{draw_line, line_width};
pub use quad::{Focal, Grid, Quad, Ratio};

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::report::Report;
use ravec::raster::{Image, LinearRgba};
use ravec_media::{Picture, WriteOptions};
use std::path::Path;

/// Checks the paths of an input picture and an output, before any work is done.
fn check_paths(input: &Path, output: Option<&Path>, context: &Context) -> Result<(), JobError> {
    let outputs: Vec<&Path> = output.into_iter().collect();
    context.check_files(&[input], &outputs)?;
    let mut pictures = outputs.into_iter().filter(|path| !is_json(path));
    pictures.try_for_each(|path| files::check_target(path, context))
}

/// True for an output that gets the result as JSON, not as a picture.
fn is_json(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// Writes the result of the report as JSON or, if the output is a picture, as a drawing on `picture`.
fn write_result(
    path: &Path,
    picture: &Picture,
    draw: impl FnOnce(&mut Image<LinearRgba>) -> Result<(), JobError>,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    if is_json(path) {
        let text = report.result_json().unwrap_or_default();
        return files::write_output_text(path, "JSON", &text, report, context);
    }
    let mut image: Image<LinearRgba> = picture.convert();
    draw(&mut image)?;
    let drawn = picture.with_image(&image);
    files::write(path, &drawn, &WriteOptions::default(), report, context)
}
