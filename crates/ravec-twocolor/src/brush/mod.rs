//! Brushes that do not cross edges.
//!
//! A [`Stroke`] is a polyline with a radius, a tool and a strength. Its effect on a pixel is the product of three things:
//!
//! 1. the *profile*: 1 within the hard core, falling to 0 at the radius, of the distance to the polyline. Distances, not
//!    dabs, so that overlaps do not multiply and nothing depends on how the stroke was cut into events (repeated and straight points
//!    are dropped first);
//!    strokes that accumulate use dabs at equal distances along the polyline instead.
//! 2. the *edge mask*: on the straight way from the nearest point of the polyline to the pixel, how far the color of the
//!    own side moves away from where the brush is. Own-side colors are even up to an edge and jump across it, so paint stops
//!    there.
//! 3. the strength.
//!
//! Source: dissertation, chapter 3. We differ in deciding by the colors along the way instead of one window around the
//! brush's center: a window as large as the brush has more than two colors.
//!
//! Guarantees: only pixels within the radius of a stroke change, all others keep their bits; a stroke gives the same bits
//! live ([`Brush`]) and replayed ([`replay`]), whole or cut, on any number of threads. Does not guarantee: that edges fainter
//! than the tolerance hold paint back.
//!
//! Cost: one exact fit a pixel under the stroke. Memory: two copies of the picture, and 44 bytes a pixel under the stroke;
//! live strokes that have ended keep the pixels that they changed, at most 256 MiB, so that they can be taken off again.

mod canvas;
mod cells;
mod history;
mod live;
mod path;
mod stroke;
mod tiles;
mod tool;

pub use live::Brush;
pub use stroke::{Stroke, StrokeError, Strokes, Tool};

use canvas::Canvas;
use cells::Cells;
use path::Path;
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Plane, Rect};
use tool::{Painter, Select};

/// The result of applying strokes to a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Painted {
    /// The picture.
    pub image: Image<LinearRgba>,
    /// The selection that mask strokes painted, 0 to 1; nothing if there was none.
    pub mask: Option<Plane>,
    /// For each stroke, the pixels that it could change: those within its radius and of positive effect.
    pub touched: Vec<u64>,
}

/// Applies strokes one after the other. Positions are scaled if the picture has another size than the one they were drawn
/// on. Undo is a replay without the last stroke.
///
/// # Errors
/// [`StrokeError`] for an invalid stroke, naming it; [`StrokeError::Cancelled`] soon after `progress` is.
pub fn replay(
    image: Image<LinearRgba>,
    strokes: &Strokes,
    progress: &Progress,
) -> Result<Painted, StrokeError> {
    let strokes = strokes.scaled_to(image.size())?;
    let mut canvas = Canvas::new(image);
    let mut mask = None;
    let mut touched = Vec::with_capacity(strokes.len());
    let phase = progress.phase("strokes", strokes.len() as u64);
    for stroke in &strokes {
        progress.check()?;
        touched.push(paint(&mut canvas, &mut mask, stroke, progress)?);
        canvas.settle();
        phase.advance(1);
    }
    Ok(Painted {
        image: canvas.image,
        mask,
        touched,
    })
}

/// One stroke, already in pixels of the picture; returns the number of pixels that it could change.
fn paint(
    canvas: &mut Canvas,
    mask: &mut Option<Plane>,
    stroke: &Stroke,
    progress: &Progress,
) -> Result<u64, StrokeError> {
    let path = Path::of(stroke);
    let size = canvas.image.size();
    let region = path.bounds().intersection(Rect::of(size));
    if region.is_empty() {
        return Ok(0);
    }
    let mut cells = Cells::new(size, stroke);
    cells.ensure(canvas, &path, region, progress)?;
    canvas.mark(region);
    if stroke.tool == Tool::Mask && mask.is_none() {
        *mask = Some(Plane::new(size, 0.0));
    }
    let painter = Painter {
        stroke,
        path: &path,
        first_segment: 0,
        replaced: None,
        cells: &cells,
        before: &canvas.before,
    };
    // selecting again does not select more
    let mask = mask.as_mut().map(|mask| (mask, f32::max as Select));
    Ok(painter.paint(region, &mut canvas.image, mask))
}
