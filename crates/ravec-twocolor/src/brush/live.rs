//! A stroke while it is being drawn.

use super::canvas::Canvas;
use super::cells::Cells;
use super::history::{Ended, History};
use super::path::Path;
use super::stroke::{Problem, Stroke, StrokeError, Tool};
use super::tool::{Painter, Select};
use glam::DVec2;
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
    /// The way of the stroke as far as it is painted.
    path: Option<Path>,
    canvas: Canvas,
    mask: Option<Plane>,
    cells: Cells,
    /// Windows of the picture with the stroke, where [`region`](Self::region) has looked: those of the next stroke.
    ahead: Option<Cells>,
    history: History,
    /// True if the noise of the picture was known before the stroke.
    noise_known: bool,
}

impl Brush {
    /// Puts the brush down: `stroke` holds its settings and the first point or points.
    ///
    /// # Errors
    /// [`StrokeError::Stroke`] (number 1) if the stroke is invalid, [`StrokeError::Cancelled`] soon after `progress` is.
    pub fn begin(
        image: Image<LinearRgba>,
        stroke: Stroke,
        progress: &Progress,
    ) -> Result<Self, StrokeError> {
        check(&stroke)?;
        let mut brush = Self {
            cells: Cells::new(image.size(), &stroke),
            mask: selection(&stroke, &image),
            canvas: Canvas::new(image),
            ahead: None,
            history: History::default(),
            noise_known: false,
            path: None,
            stroke,
        };
        brush.repaint(0, progress)?;
        Ok(brush)
    }

    /// Ends the stroke and puts the brush down again for another; returns the pixels that may have changed. Costs as much as
    /// the pixels that the two strokes reach, where [`begin`](Self::begin) copies the whole picture. The selection of a mask
    /// stroke is to be fetched before.
    ///
    /// # Errors
    /// As [`begin`](Self::begin). If `stroke` is invalid, the one before goes on; if cancelled, it has ended and the new
    /// one has begun without having painted.
    pub fn next_stroke(
        &mut self,
        stroke: Stroke,
        progress: &Progress,
    ) -> Result<Rect, StrokeError> {
        check(&stroke)?;
        let patch = self.canvas.patch();
        self.canvas.settle();
        let noise_known = self.canvas.knows_noise();
        let ended = self.put_down(stroke);
        self.history.push(Ended {
            stroke: ended,
            patch,
            noise_known: std::mem::replace(&mut self.noise_known, noise_known),
        });
        self.repaint(0, progress)
    }

    /// Takes the stroke off the picture and puts the brush down for another in its place; returns the pixels that may have
    /// changed.
    ///
    /// # Errors
    /// As [`begin`](Self::begin). If `stroke` is invalid, the one before goes on; if cancelled, the new one has begun without
    /// having painted.
    pub fn replace_stroke(
        &mut self,
        stroke: Stroke,
        progress: &Progress,
    ) -> Result<Rect, StrokeError> {
        check(&stroke)?;
        let changed = self.take_off();
        self.put_down(stroke);
        let painted = self.repaint(0, progress)?;
        Ok(changed.bounding(painted))
    }

    /// Takes the stroke off the picture and takes the one before in the hand again, as it was when it ended; returns the pixels
    /// that may have changed. Nothing, and no change, if there is none, or if it was too long ago: the strokes that are kept
    /// take at most 256 MiB. Mask strokes are not taken in the hand again.
    ///
    /// Costs as much as the pixels that the two strokes changed.
    pub fn undo_stroke(&mut self) -> Option<Rect> {
        let ended = self.history.pop()?;
        if ended.stroke.tool == Tool::Mask {
            self.history.push(ended);
            return None;
        }
        let changed = self.take_off();
        // it is begun again on the picture before it
        self.ahead = None;
        self.canvas.resume(&ended.patch);
        self.noise_known = ended.noise_known;
        self.put_down(ended.stroke);
        self.path = Some(Path::of(&self.stroke));
        Some(changed)
    }

    /// Takes the stroke off the picture, and what it has found out about it.
    fn take_off(&mut self) -> Rect {
        if !self.noise_known {
            self.canvas.forget_noise();
        }
        let changed = self.canvas.take_off();
        if let Some(ahead) = &mut self.ahead {
            ahead.forget(changed);
        }
        changed
    }

    /// Makes `stroke` the one in the hand, without painting it; returns the one that was.
    fn put_down(&mut self, stroke: Stroke) -> Stroke {
        let ahead = self.ahead.take().filter(|ahead| ahead.suit(&stroke));
        let cells = ahead.unwrap_or_else(|| Cells::new(self.canvas.image.size(), &stroke));
        let ended = std::mem::replace(&mut self.cells, cells);
        // those of a long stroke are a hundred megabytes, which the system takes its time to get back
        rayon::spawn(move || drop(ended));
        self.mask = selection(&stroke, &self.canvas.image);
        self.path = None;
        std::mem::replace(&mut self.stroke, stroke)
    }

    /// Moves the brush to a point; returns the pixels that may have changed.
    ///
    /// # Errors
    /// As [`begin`](Self::begin); the stroke is then as it was.
    pub fn extend(&mut self, point: [f64; 2], progress: &Progress) -> Result<Rect, StrokeError> {
        self.extend_together(&[point], progress)
    }

    /// Moves the brush along points, with the same result as point by point; returns the pixels that may have changed. Points
    /// that lie close together are painted at once, for the cost of one.
    ///
    /// # Errors
    /// As [`extend`](Self::extend); the points before stay.
    pub fn extend_along(
        &mut self,
        points: &[[f64; 2]],
        progress: &Progress,
    ) -> Result<Rect, StrokeError> {
        let mut changed = Rect::default();
        let mut rest = points;
        while !rest.is_empty() {
            let (now, later) = rest.split_at(close(rest, 2.0 * self.stroke.radius_px));
            changed = changed.bounding(self.extend_together(now, progress)?);
            rest = later;
        }
        Ok(changed)
    }

    fn extend_together(
        &mut self,
        points: &[[f64; 2]],
        progress: &Progress,
    ) -> Result<Rect, StrokeError> {
        let before = self.stroke.points.len();
        self.stroke.points.extend_from_slice(points);
        if let Err(error) = check(&self.stroke) {
            self.stroke.points.truncate(before);
            return Err(error);
        }
        self.repaint(points.len(), progress)
    }

    /// The pixels that `stroke` would reach if it were painted on the picture so far, and its effect on each of them, 0 to 1: what a
    /// mask stroke would select. What is computed here is not computed again when the next stroke begins at the same place.
    ///
    /// # Errors
    /// As [`begin`](Self::begin); the picture and the stroke in the hand are as they were in any case.
    pub fn region(
        &mut self,
        stroke: &Stroke,
        progress: &Progress,
    ) -> Result<Option<(Rect, Plane)>, StrokeError> {
        let stroke = Stroke {
            tool: Tool::Mask,
            ..stroke.clone()
        };
        check(&stroke)?;
        let path = Path::of(&stroke);
        let region = path
            .bounds()
            .intersection(Rect::of(self.canvas.image.size()));
        let Some(size) = region.size() else {
            return Ok(None);
        };
        let ahead = self.ahead.take().filter(|ahead| ahead.suit(&stroke));
        let mut ahead = ahead.unwrap_or_else(|| Cells::new(self.canvas.image.size(), &stroke));
        ahead.fill(&self.canvas.image, &path, region, progress)?;
        let painter = Painter {
            stroke: &stroke,
            path: &path,
            first_segment: 0,
            replaced: None,
            cells: &ahead,
            before: &self.canvas.image,
        };
        let mut effect = Plane::new(size, 0.0);
        painter.effect(region, &mut effect);
        self.ahead = Some(ahead);
        Ok(Some((region, effect)))
    }

    /// The picture so far.
    pub fn image(&self) -> &Image<LinearRgba> {
        &self.canvas.image
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
        self.canvas.image
    }

    /// Paints what the last `added` points of the stroke have changed, or all of it.
    fn repaint(&mut self, added: usize, progress: &Progress) -> Result<Rect, StrokeError> {
        let path = Path::of(&self.stroke);
        let painted = self.path.take().filter(|_| added > 0);
        let region = match &painted {
            // the last corner may have gone, so the segment before the new ones counts as changed
            Some(_) => path.bounds_of_end(added + 1),
            None => path.bounds(),
        };
        let region = region.intersection(Rect::of(self.canvas.image.size()));
        if region.is_empty() {
            self.path = Some(path);
            return Ok(region);
        }
        self.cells
            .ensure(&mut self.canvas, &path, region, progress)?;
        self.canvas.mark(region);
        let first_segment = match &painted {
            Some(painted) if path.is_by_distance() => path.first_change(painted),
            _ => 0,
        };
        let painter = Painter {
            stroke: &self.stroke,
            path: &path,
            first_segment,
            replaced: painted.as_ref().filter(|painted| !path.continues(painted)),
            cells: &self.cells,
            before: &self.canvas.before,
        };
        // where the nearest point of the way has moved, paint may have to go again
        let replace: Select = |_, effect| effect;
        let mask = self.mask.as_mut().map(|mask| (mask, replace));
        painter.paint(region, &mut self.canvas.image, mask);
        self.path = Some(path);
        if let Some(ahead) = &mut self.ahead {
            ahead.forget(region);
        }
        Ok(region)
    }
}

fn check(stroke: &Stroke) -> Result<(), StrokeError> {
    let checked = stroke.check();
    checked.map_err(|Problem(problem)| StrokeError::Stroke { number: 1, problem })
}

/// Number of the first points, at least one, that lie within a square of this side.
fn close(points: &[[f64; 2]], side: f64) -> usize {
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let mut fits = |point: &&[f64; 2]| {
        low = low.min(DVec2::from_array(**point));
        high = high.max(DVec2::from_array(**point));
        (high - low).max_element() <= side
    };
    points.iter().take_while(|point| fits(point)).count().max(1)
}

/// The selection that a mask stroke begins with.
fn selection(stroke: &Stroke, image: &Image<LinearRgba>) -> Option<Plane> {
    (stroke.tool == Tool::Mask).then(|| Plane::new(image.size(), 0.0))
}
