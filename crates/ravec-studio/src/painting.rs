//! The brush in the hand: strokes are painted as they grow, and the picture is kept from one to the next.

use crate::document::Edit;
use crate::engine::lock;
use crate::shown::Shown;
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Color, Image, LinearRgba, Plane, Rect, with_image};
use ravec::twocolor::brush::{Brush, Stroke, StrokeError, Strokes, Tool};
use ravec_media::Picture;
use std::sync::{Arc, Mutex, Weak};

/// A picture that is being painted.
///
/// Guarantees: the picture is the one that the operation `brush` gives for the strokes of the edit.
#[derive(Default)]
pub(crate) struct Painting {
    present: Option<Present>,
}

/// A picture with its strokes, and its view.
pub(crate) type Finished = (Arc<Picture>, Option<Arc<Shown>>);

struct Present {
    key: Arc<str>,
    brush: Brush,
    /// Strokes before the one in the hand.
    done: Vec<Stroke>,
    shown: Shown,
    /// The picture before the one that is shown, and where the two differ.
    spare: Option<(Arc<Picture>, Rect)>,
    ahead: Arc<Mutex<CopyAhead>>,
}

/// Maximum number of bytes of a picture that is copied ahead.
const MAX_COPY_BYTES: usize = 256 << 20;

/// A copy of the picture before the first stroke, made while the hand rests: the stroke is painted into it.
#[derive(Default)]
struct CopyAhead {
    of: Weak<Picture>,
    copy: Option<Arc<Picture>>,
}

impl CopyAhead {
    /// Begins to copy a picture, unless it is copied already.
    fn begin(ahead: &Arc<Mutex<Self>>, picture: &Arc<Picture>) {
        let bytes = with_image!(&picture.image, image => size_of_val(image.pixels()));
        let mut state = lock(ahead);
        if bytes > MAX_COPY_BYTES || state.is_of(picture) {
            return;
        }
        *state = Self {
            of: Arc::downgrade(picture),
            copy: None,
        };
        let (ahead, picture) = (ahead.clone(), picture.clone());
        rayon::spawn(move || {
            let copy = Arc::new(Picture::clone(&picture));
            let mut state = lock(&ahead);
            if state.is_of(&picture) {
                state.copy = Some(copy);
            }
        });
    }

    fn is_of(&self, picture: &Arc<Picture>) -> bool {
        std::ptr::eq(self.of.as_ptr(), Arc::as_ptr(picture))
    }

    /// The copy of a picture, if it is there.
    fn take(&mut self, picture: &Arc<Picture>) -> Option<Arc<Picture>> {
        let copy = self.copy.take().filter(|_| self.is_of(picture));
        *self = Self::default();
        copy
    }
}

/// Strokes of an edit that are in half-integer coordinates of a picture of this size; `None` for what the operation has to judge.
fn strokes_of(edit: &Edit, picture: &Picture) -> Option<Vec<Stroke>> {
    let own = |name: &str| edit.param(name).is_null();
    if edit.operation != "brush" || !own("undo") || !own("pixel_centers") || !own("scale") {
        return None;
    }
    let strokes: Strokes = serde_json::from_value(edit.fields.get("strokes")?.clone()).ok()?;
    let size = picture.image.size();
    let same_size = (strokes.width, strokes.height) == (size.width(), size.height());
    same_size.then_some(strokes.strokes)
}

impl Painting {
    /// The picture with the strokes of an edit, if these are the ones that were painted here, and its view where it is the one that
    /// was shown last.
    pub fn finished(&self, key: &str, edit: &Edit, input: &Picture) -> Option<Finished> {
        let present = self.present.as_ref()?;
        let strokes = strokes_of(edit, input)?;
        let (last, before) = strokes.split_last()?;
        let same = *present.key == *key && present.done == before && present.brush.stroke() == last;
        if !same {
            return None;
        }
        // gray pictures and those with alpha are judged as a whole
        if input.origin.gray || input.image.has_alpha() {
            let picture = input.with_image(present.brush.image());
            return Some((Arc::new(picture), None));
        }
        let shown = present.shown.clone();
        Some((shown.picture().clone(), Some(Arc::new(shown))))
    }

    /// The pixels that a stroke would reach after those of an edit, and its effect on each, 0 to 1; `None` if these strokes are not
    /// the ones that were painted here. The stroke itself is painted the faster for it.
    pub fn region(
        &mut self,
        key: &str,
        edit: &Edit,
        input: &Picture,
        stroke: &Stroke,
        progress: &Progress,
    ) -> Option<(Rect, Plane)> {
        let present = self.present.as_mut()?;
        let strokes = strokes_of(edit, input)?;
        let idle = idle();
        let (last, before) = strokes.split_last().unwrap_or((&idle, &[]));
        if *present.key != *key || present.done != before || present.brush.stroke() != last {
            return None;
        }
        present.brush.region(stroke, progress).ok()?
    }

    /// Paints what is new in the strokes of an edit; cancellation stops the painting of all strokes anew only. Gives the picture as a
    /// screen shows it, or `None` if there is no stroke that can be painted here.
    ///
    /// # Errors
    /// Those of the strokes.
    pub fn follow(
        &mut self,
        key: &Arc<str>,
        edit: &Edit,
        input: &Picture,
        progress: &Progress,
    ) -> Result<Option<Arc<Shown>>, StrokeError> {
        let Some(mut strokes) = strokes_of(edit, input) else {
            return Ok(None);
        };
        let is_blank = strokes.is_empty();
        if is_blank {
            // the first stroke need not wait for the picture
            strokes.push(idle());
        }
        let Some((last, before)) = strokes.split_last() else {
            return Ok(None);
        };
        let known = self.present.take().filter(|present| present.key == *key);
        let (mut present, region) = match known.map(|present| present.advance(before, last)) {
            Some(Ok(Some(advanced))) => advanced,
            Some(Err(error)) => return Err(error),
            Some(Ok(None)) | None => {
                let present = Present::new(key, input, &strokes, progress)?;
                (present, Rect::default())
            }
        };
        if !region.is_empty() {
            let before = present.shown.picture().clone();
            let spare = present.spare.take();
            let spare = spare.filter(|(spare, _)| Arc::strong_count(spare) == 1);
            let spare = spare.or_else(|| {
                let copy = lock(&present.ahead).take(&before);
                copy.map(|copy| (copy, Rect::default()))
            });
            let picture = patched(spare, &before, present.brush.image(), region);
            present.shown = present.shown.changed(picture, region);
            present.spare = Some((before, region));
        }
        let shown = Arc::new(present.shown.clone());
        if is_blank {
            CopyAhead::begin(&present.ahead, shown.picture());
        }
        self.present = Some(present);
        Ok((!is_blank).then_some(shown))
    }
}

/// A stroke that reaches no picture: the brush is not put down yet.
fn idle() -> Stroke {
    Stroke::new(Tool::Dodge, vec![[-1e6, -1e6]], 1.0)
}

impl Present {
    /// Paints strokes, one at least, one by one, so that each can be taken off again.
    fn new(
        key: &Arc<str>,
        input: &Picture,
        strokes: &[Stroke],
        progress: &Progress,
    ) -> Result<Self, StrokeError> {
        let mut brush = Brush::begin(input.convert(), strokes[0].clone(), progress)?;
        for (number, stroke) in strokes.iter().enumerate().skip(1) {
            let painted = brush.next_stroke(stroke.clone(), progress);
            painted.map_err(|error| numbered(error, number + 1))?;
        }
        let picture = input.with_image(brush.image());
        Ok(Self {
            key: key.clone(),
            brush,
            done: strokes[..strokes.len() - 1].to_vec(),
            shown: Shown::new(Arc::new(picture)),
            spare: None,
            ahead: Arc::default(),
        })
    }

    /// Goes on to these strokes and says where the picture has changed; `None` if they are no continuation.
    fn advance(
        mut self,
        before: &[Stroke],
        last: &Stroke,
    ) -> Result<Option<(Self, Rect)>, StrokeError> {
        // half of a stroke would be of no use, and the whole is soon there
        let progress = &Progress::none();
        let mut region = Rect::default();
        let shared = before.len().min(self.done.len());
        if before[..shared] != self.done[..shared] {
            return Ok(None);
        }
        // strokes that were undone
        while self.done.len() > before.len() {
            let Some(changed) = self.brush.undo_stroke() else {
                return Ok(None);
            };
            region = region.bounding(changed);
            self.done.pop();
        }
        // strokes that follow the one in the hand
        if before.len() > self.done.len() && before[self.done.len()] != *self.brush.stroke() {
            return Ok(None);
        }
        while self.done.len() < before.len() {
            let ended = self.brush.stroke().clone();
            let next = before.get(self.done.len() + 1);
            let next = next.cloned().unwrap_or_else(|| begun(last));
            let painted = self.brush.next_stroke(next, progress);
            region = region.bounding(painted.map_err(|error| numbered(error, before.len() + 1))?);
            self.done.push(ended);
        }
        let stroke = self.brush.stroke();
        let count = stroke.points.len();
        let grows = last.points.len() >= count && last.points[..count] == stroke.points[..];
        let same_settings = Stroke {
            points: last.points.clone(),
            ..stroke.clone()
        } == *last;
        if !grows || !same_settings {
            // another stroke in the place of the one in the hand
            let painted = self.brush.replace_stroke(begun(last), progress);
            region = region.bounding(painted.map_err(|error| numbered(error, before.len() + 1))?);
        }
        let count = self.brush.stroke().points.len();
        let extended = self.brush.extend_along(&last.points[count..], progress);
        region = region.bounding(extended?);
        Ok(Some((self, region)))
    }
}

/// A stroke with its first point.
fn begun(stroke: &Stroke) -> Stroke {
    Stroke {
        points: stroke.points.iter().take(1).copied().collect(),
        ..stroke.clone()
    }
}

/// An error of a single stroke as that of stroke `number` of an edit.
fn numbered(error: StrokeError, number: usize) -> StrokeError {
    match error {
        StrokeError::Stroke { problem, .. } => StrokeError::Stroke { number, problem },
        other => other,
    }
}

/// A picture with a region of it taken from a painted one, in the type of the picture.
///
/// A spare picture that nobody shows any more takes the region, and where it differs from the picture, without a copy of the rest.
fn patched(
    spare: Option<(Arc<Picture>, Rect)>,
    picture: &Picture,
    painted: &Image<LinearRgba>,
    region: Rect,
) -> Arc<Picture> {
    if let Some((mut spare, stale)) = spare
        && let Some(unused) = Arc::get_mut(&mut spare)
    {
        take_region(&mut unused.image, painted, region.bounding(stale));
        return spare;
    }
    let mut image = picture.image.clone();
    take_region(&mut image, painted, region);
    Arc::new(picture.with_pixels(image))
}

fn take_region(image: &mut AnyImage, painted: &Image<LinearRgba>, region: Rect) {
    let rows = region.row..region.bottom();
    let columns = region.col..region.right();
    with_image!(image, image => image.for_each_row(|row, pixels| {
        if rows.contains(&row) {
            let painted = &painted.row(row)[columns.clone()];
            for (pixel, &color) in pixels[columns.clone()].iter_mut().zip(painted) {
                *pixel = Color::from_linear(color);
            }
        }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::content::Content;
    use crate::engine::run_in_memory;
    use ravec::raster::{AnyImage, Size, Srgb};
    use serde_json::{Value, json};

    fn picture() -> Arc<Picture> {
        let size = Size::new(96, 80).unwrap();
        let image = Image::from_fn(size, |col, row| {
            let noise = ((col * 7919 + row * 104_729) % 23) as u8;
            let bright = if col + row / 2 > 60 { 150 } else { 40 };
            Srgb([bright + noise, bright, 90 + noise])
        });
        Arc::new(Picture::from_image(AnyImage::from(image)))
    }

    fn edit(strokes: &Value) -> Edit {
        let strokes = json!({"version": 1, "width": 96, "height": 80, "strokes": strokes});
        Edit {
            id: 1,
            operation: "brush".to_owned(),
            fields: [("strokes".to_owned(), strokes)].into_iter().collect(),
            more_sizes: Vec::new(),
            enabled: true,
        }
    }

    fn stroke(tool: &Value, points: &[[f64; 2]]) -> Value {
        json!({
            "tool": tool, "points": points, "radius_px": 9.0, "hardness": 0.4, "strength": 0.8,
            "edge_aware": true,
        })
    }

    #[test]
    fn strokes_that_grow_give_the_picture_of_the_operation() {
        let input = picture();
        let key: Arc<str> = "photo".into();
        let operator =
            |mode: &str| json!({"operator": {"mode": mode, "iterations": 1, "noise_sigma": null}});
        let tools = [
            operator("smooth"),
            operator("clean"),
            json!({"color": {"rgb": [200, 30, 20]}}),
            json!("dodge"),
        ];
        let points = [[20.0, 20.0], [35.0, 30.0], [50.0, 32.0], [70.0, 60.0]];
        let mut painting = Painting::default();
        let mut strokes = Vec::new();
        for tool in &tools {
            for count in [1, 2, points.len()] {
                let mut now = strokes.clone();
                now.push(stroke(tool, &points[..count]));
                let edit = edit(&Value::Array(now));
                let shown = painting.follow(&key, &edit, &input, &Progress::none());
                let shown = shown.unwrap().unwrap();
                let content = Content::Picture(input.clone());
                let (expected, _) = run_in_memory(&edit, &content, &Progress::none())
                    .unwrap_or_else(|_| panic!("{tool} paints"));
                let expected = expected.picture().unwrap().clone();
                assert_eq!(
                    shown.pixels(),
                    Shown::new(expected.clone()).pixels(),
                    "{tool}"
                );
                let (finished, view) = painting.finished(&key, &edit, &input).unwrap();
                assert_eq!(finished.image, expected.image);
                assert_eq!(view.unwrap().pixels(), shown.pixels());
            }
            strokes.push(stroke(tool, &points));
        }
        // strokes that are undone, several at once, and others in their place, also of the first one
        let other = stroke(&tools[2], &[[60.0, 10.0], [30.0, 60.0]]);
        let mut kept = strokes.clone();
        for (left, then) in [(3, true), (1, true), (2, false), (0, true), (1, false)] {
            kept.truncate(left);
            if then {
                kept.push(other.clone());
            }
            let edit = edit(&Value::Array(kept.clone()));
            let shown = painting.follow(&key, &edit, &input, &Progress::none());
            let content = Content::Picture(input.clone());
            let (expected, _) = run_in_memory(&edit, &content, &Progress::none())
                .unwrap_or_else(|_| panic!("{left} paints"));
            let expected = Shown::new(expected.picture().unwrap().clone());
            assert_eq!(
                shown.unwrap().unwrap().pixels(),
                expected.pixels(),
                "{left} {then}"
            );
        }
        // an undone stroke is painted away, and another picture begins anew
        let undone = edit(&Value::Array(strokes[..2].to_vec()));
        assert!(painting.finished(&key, &undone, &input).is_none());
        painting
            .follow(&key, &undone, &input, &Progress::none())
            .unwrap()
            .unwrap();
        assert!(painting.finished(&key, &undone, &input).is_some());
        assert!(painting.finished("other", &undone, &input).is_none());
    }
}
