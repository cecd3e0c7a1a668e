//! Strokes from files.

use super::Params;
use crate::context::Context;
use crate::error::{JobError, plain};
use crate::files;
use crate::pixel_centers::PixelCenters;
use ravec::raster::Size;
use ravec::twocolor::brush::{Stroke, Strokes};
use std::path::Path;

/// The largest file of strokes that is read.
const MAX_STROKES_BYTES: u64 = 256 << 20;

/// The strokes of a file, with pixel centers at half-integers.
pub(super) fn read(
    path: &Path,
    size: Size,
    params: &Params,
    context: &Context,
) -> Result<Strokes, JobError> {
    let strokes = parse(path, size, params, context)?;
    Ok(at_half(strokes, params.pixel_centers))
}

/// Strokes that are given in a convention, with pixel centers at half-integers.
pub(super) fn at_half(mut strokes: Strokes, centers: PixelCenters) -> Strokes {
    let points = strokes.strokes.iter_mut();
    for point in points.flat_map(|stroke| &mut stroke.points) {
        *point = centers.read((*point).into()).into();
    }
    strokes
}

fn parse(path: &Path, size: Size, params: &Params, context: &Context) -> Result<Strokes, JobError> {
    let unreadable = |reason: String| JobError::Strokes {
        path: path.to_path_buf(),
        reason,
    };
    let text = files::read_text_in(path, MAX_STROKES_BYTES, context)
        .map_err(|error| unreadable(plain(&error)))?;
    let list = text.trim_start().strip_prefix('[');
    if list.is_some_and(|rest| rest.trim_start().starts_with('{')) {
        let list: Vec<Stroke> = serde_json::from_str(&text)
            .map_err(|error| unreadable(format!("it is no list of strokes: {error}")))?;
        let mut strokes = Strokes::new(size);
        strokes.strokes = list;
        return Ok(strokes);
    }
    if list.is_some() {
        let points: Vec<[f64; 2]> = serde_json::from_str(&text).map_err(|error| {
            unreadable(format!("it is no list of points [[x, y], ...]: {error}"))
        })?;
        let mut strokes = Strokes::new(size);
        strokes.strokes.push(params.stroke(points));
        return Ok(strokes);
    }
    serde_json::from_str(&text)
        .map_err(|error| unreadable(format!("they are not in the form of strokes: {error}")))
}
