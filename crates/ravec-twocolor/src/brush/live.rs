//! A stroke while it is being drawn.

use super::cells::Cells;
use super::path::Path;
use super::stroke::{Problem, Stroke, StrokeError, Tool};
use super::tool::Painter;
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Plane, Rect};

/// A stroke in the hand: every new point repaints only what it reaches.
///
/// The picture after [`finish`](Self::finish) has the bits that [`replay`](super::replay) of the finished stroke gives.
///
/// ```
/// use ravec_progress::Progress;
/// use ravec_raster::{Image, LinearRgba, Size};
/// use ravec_twocolor::Mode;
/// use ravec_twocolor::brush::{Brush, Stroke, Tool};
///
/// let image = Image::new(Size::new(64, 48)?, LinearRgba([0.2, 0.3, 0.4, 1.0]));
/// let stroke = Stroke::new(Tool::Dodge, vec![[10.0, 10.0]], 8.0);
/// let mut brush = Brush::begin(image, stroke, &Progress::none())?;
/// let changed = brush.extend([30.0, 12.0], &Progress::none())?;
/// assert!(changed.contains(30, 12) && !changed.contains(30, 40));
/// let painted = brush.finish();
/// assert!(painted[(20, 11)].0[0] > 0.2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Brush {
    stroke: Stroke,
    before: Image<LinearRgba>,
    image: Image<LinearRgba>,
    mask: Option<Plane>,
    cells: Cells,
}

impl Brush {
    /// Puts the brush down: `stroke` holds its settings and the first point or points.
    ///
    /// # Errors
    /// [`StrokeError::Stroke`] (number 1) if the stroke makes no sense, [`StrokeError::Cancelled`] soon after `progress` is.
    pub fn begin(
        image: Image<LinearRgba>,
        stroke: Stroke,
        progress: &Progress,
    ) -> Result<Self, StrokeError> {
        stroke
            .check()
            .map_err(|Problem(problem)| StrokeError::Stroke { number: 1, problem })?;
        let mask = (stroke.tool == Tool::Mask).then(|| Plane::new(image.size(), 0.0));
        let mut brush = Self {
            cells: Cells::new(image.size(), &stroke),
            before: image.clone(),
            image,
            mask,
            stroke,
        };
        let path = Path::of(&brush.stroke);
        brush.repaint(&path, path.bounds(), progress)?;
        Ok(brush)
    }

    /// Moves the brush to a point; returns the pixels that may have changed.
    ///
    /// # Errors
    /// As [`begin`](Self::begin); the stroke is then as it was.
    pub fn extend(&mut self, point: [f64; 2], progress: &Progress) -> Result<Rect, StrokeError> {
        self.stroke.points.push(point);
        if let Err(Problem(problem)) = self.stroke.check() {
            self.stroke.points.pop();
            return Err(StrokeError::Stroke { number: 1, problem });
        }
        let path = Path::of(&self.stroke);
        // the last corner may have gone, so the segment before the new one counts as changed
        let region = path.bounds_of_end(2);
        self.repaint(&path, region, progress)
    }

    /// The picture so far.
    pub fn image(&self) -> &Image<LinearRgba> {
        &self.image
    }

    /// The selection so far, of a mask stroke.
    pub fn mask(&self) -> Option<&Plane> {
        self.mask.as_ref()
    }

    /// The stroke as it can be stored and replayed.
    pub fn stroke(&self) -> &Stroke {
        &self.stroke
    }

    /// Lifts the brush.
    pub fn finish(self) -> Image<LinearRgba> {
        self.image
    }

    fn repaint(
        &mut self,
        path: &Path,
        region: Rect,
        progress: &Progress,
    ) -> Result<Rect, StrokeError> {
        let region = region.intersection(Rect::of(self.image.size()));
        if region.is_empty() {
            return Ok(region);
        }
        self.cells.ensure(&self.before, path, region, progress)?;
        // where the nearest point of the way has moved, paint may have to go again
        let columns = region.col..region.right();
        for row in region.row..region.bottom() {
            self.image.row_mut(row)[columns.clone()]
                .copy_from_slice(&self.before.row(row)[columns.clone()]);
            if let Some(mask) = &mut self.mask {
                mask.row_mut(row)[columns.clone()].fill(0.0);
            }
        }
        let painter = Painter {
            stroke: &self.stroke,
            path,
            cells: &self.cells,
            before: &self.before,
        };
        painter.paint(region, &mut self.image, self.mask.as_mut());
        Ok(region)
    }
}
