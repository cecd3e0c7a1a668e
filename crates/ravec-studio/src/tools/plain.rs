//! Tools without gestures: their panel is all.

use super::{DraftFn, DraftJob, DraftView, Tool};
use crate::assistant::Memory;
use crate::content::{Content, Kind, View};
use crate::document::Edit;
use crate::engine::run_in_memory;
use crate::shown::Shown;
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Rect, with_image};
use serde_json::{Map, Value};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Maximum number of pixels of a quick result.
pub(super) const MAX_DRAFT_PX: f64 = 1e6;

/// Minimum number of pixels of a quick result: less is not worth a look.
const MIN_DRAFT_PX: f64 = 1.5e5;

/// Time that a quick result may take.
const DRAFT_TIME: Duration = Duration::from_millis(60);

/// Borders of the seen part lie on multiples of this, so that blocks of pixels stay where they are in the whole.
const GRID_PX: usize = 64;

/// A tool that only has settings.
pub(crate) struct Plain {
    pub operation: &'static str,
    pub label: &'static str,
    pub kinds: &'static [Kind],
    pub fields: fn() -> Map<String, Value>,
}

impl Tool for Plain {
    fn operation(&self) -> &'static str {
        self.operation
    }

    fn label(&self) -> &'static str {
        self.label
    }

    fn kinds(&self) -> &'static [Kind] {
        self.kinds
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        (self.fields)()
    }

    fn made(&self, edit: &Edit) -> bool {
        edit.operation == self.operation && !edit.fields.contains_key("strokes")
    }

    fn draft(&self) -> Option<DraftFn> {
        Some(draft)
    }

    fn drafts_first(&self) -> bool {
        true
    }
}

/// The result of the part that is seen, or of as much of its middle as the operation does in [`DRAFT_TIME`], going by the last time.
pub(super) fn draft(job: &DraftJob, memory: &mut Memory, progress: &Progress) -> Option<DraftView> {
    let start = Instant::now();
    let picture = job.input.content.picture()?;
    let size = picture.image.size();
    let affordable = memory.keep("draft pixels", &method(&job.edit), || {
        Ok::<_, ()>(MIN_DRAFT_PX)
    });
    let affordable = affordable.ok()?;
    let part = seen_part(job.seen, [size.width(), size.height()], *affordable)?;
    let cut = part.size()?;
    let cut = with_image!(&picture.image, image => image.crop(part.col, part.row, cut).map(AnyImage::from));
    let input = Content::Picture(Arc::new(picture.with_pixels(cut.ok()?)));
    let (output, _) = run_in_memory(&job.edit, &input, progress).ok()?;
    let shown = Arc::new(Shown::new(output.picture()?.clone()));
    let share = start.elapsed().div_duration_f64(DRAFT_TIME);
    *affordable = (part.pixels() as f64 / share.max(1e-6)).clamp(MIN_DRAFT_PX, MAX_DRAFT_PX);
    Some(DraftView::part(View::Picture(shown), part, size))
}

/// Text that changes with the method of an edit, whose cost a pixel is about the same: the operation, and what is no number.
fn method(edit: &Edit) -> Arc<str> {
    let params = edit.fields.get("params").and_then(Value::as_object);
    let choices = params
        .into_iter()
        .flatten()
        .filter(|(_, value)| !value.is_number());
    let choices: Vec<_> = choices.collect();
    format!("{} {choices:?}", edit.operation).into()
}

/// The part of a picture of this size that is seen, or its middle of `max_px` pixels, on a grid of blocks.
pub(super) fn seen_part(seen: [f64; 4], [width, height]: [usize; 2], max_px: f64) -> Option<Rect> {
    let [left, top, columns, rows] = seen;
    let shrink = (max_px / (columns * rows).max(1.0)).sqrt().min(1.0);
    let range = |low: f64, length: f64, end: usize| {
        let margin = 0.5 * length * (1.0 - shrink);
        let first = (low + margin).max(0.0) as usize / GRID_PX * GRID_PX;
        let last = (low + length - margin).clamp(0.0, end as f64).ceil() as usize;
        let last = last.next_multiple_of(GRID_PX).min(end);
        (first < last).then(|| (first, last - first))
    };
    let (left, columns) = range(left, columns, width)?;
    let (top, rows) = range(top, rows, height)?;
    Some(Rect::new(left, top, columns, rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::EditInput;
    use ravec::raster::{Image, Size, Srgb};
    use ravec_media::Picture;
    use serde_json::json;

    #[test]
    fn a_draft_that_is_enlarged_shows_the_part_that_was_seen() {
        let image = Image::from_fn(Size::new(256, 128).unwrap(), |col, row| {
            Srgb([col as u8, row as u8, 80])
        });
        let content = Content::Picture(Arc::new(Picture::from_image(AnyImage::from(image))));
        let fields = super::super::with_params(json!({"mode": "antialias", "scale": 2}));
        let job = DraftJob {
            edit: Edit {
                id: 1,
                operation: "brush".to_owned(),
                fields: fields
                    .into_iter()
                    .chain([("everywhere".to_owned(), true.into())])
                    .collect(),
                more_sizes: Vec::new(),
                enabled: true,
            },
            input: EditInput {
                key: "photo".into(),
                content,
            },
            painting: Arc::default(),
            coarse: false,
            seen: [128.0, 0.0, 128.0, 64.0],
        };
        let found = draft(&job, &mut Memory::default(), &Progress::none()).unwrap();
        assert_eq!(found.place, Some([0.5, 0.0, 0.5, 0.5]));
        let View::Picture(shown) = found.shape else {
            panic!("a picture becomes a picture");
        };
        assert_eq!(shown.size(), [256, 128]);
        // the colors of the right half
        assert!(shown.pixel(100, 60).unwrap()[0].abs_diff(178) < 4);
    }

    #[test]
    fn a_draft_covers_what_is_seen_within_its_limit() {
        let part = seen_part([-50.0, 10.0, 400.0, 300.0], [1000, 800], 1e6).unwrap();
        assert_eq!(part, Rect::new(0, 0, 384, 320));
        let large = seen_part([0.0, 0.0, 8000.0, 6000.0], [8000, 6000], 1e6).unwrap();
        assert!(large.pixels() < 1_400_000 && large.contains(4000, 3000));
        assert!(seen_part([2000.0, 0.0, 50.0, 50.0], [1000, 800], 1e6).is_none());
    }
}
