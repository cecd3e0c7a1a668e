//! The two-color view: blocks with a line and two colors, their lines over the picture, and the drawing as SVG.

use super::plain::{MAX_DRAFT_PX, draft, seen_part};
use super::{Desk, DraftFn, Gesture, Hand, Tool, with_params};
use crate::content::Kind;
use crate::device::edit_context;
use crate::document::Edit;
use egui::{Color32, Stroke, Ui};
use ravec::raster::{AnyImage, with_image};
use ravec_jobs::twocolor::{Params, lines};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Kind of the questions about lines.
const LINES: &str = "two-color lines";

/// The zoom below which lines would cover the picture.
const MIN_ZOOM: f32 = 0.75;

/// Shows the two-color pixels of a picture.
#[derive(Default)]
pub(crate) struct TwoColor {
    shows_lines: bool,
}

/// Lines of a part of the picture.
struct Lines {
    key: (Arc<str>, Value, [usize; 4]),
    segments: Vec<[[f64; 2]; 2]>,
}

impl TwoColor {
    /// Draws the lines of what is seen, and asks for those that are not known.
    fn lines_ui(hand: &Hand<'_>, edit: &Edit) {
        let view = hand.view;
        let corner = |at| view.to_picture(at);
        let [left, top] = corner(hand.response.rect.min);
        let [right, bottom] = corner(hand.response.rect.max);
        let seen = [left, top, right - left, bottom - top];
        let params = edit.fields.get("params").cloned().unwrap_or(json!({}));
        let Some(part) = seen_part(seen, hand.input_size, MAX_DRAFT_PX) else {
            return;
        };
        let place = [part.col, part.row, part.width, part.height];
        let key = (hand.input.key.clone(), params.clone(), place);
        let known = hand.assistant.answer::<Lines>(LINES);
        if let Some(known) = &known
            && (&known.key.0, &known.key.1) == (&key.0, &key.1)
        {
            let [col, row] = [known.key.2[0] as f64, known.key.2[1] as f64];
            let stroke = Stroke::new(1.0, Color32::from_rgb(255, 60, 200));
            for ends in &known.segments {
                let ends = ends.map(|[x, y]| view.to_screen(col + x, row + y));
                hand.painter.line_segment(ends, stroke);
            }
        }
        let wanted = known.is_none_or(|known| known.key != key);
        if !wanted || hand.assistant.is_asked(LINES) {
            return;
        }
        let (Ok(params), Some(picture)) = (
            serde_json::from_value::<Params>(params),
            hand.input.content.picture().cloned(),
        ) else {
            return;
        };
        hand.assistant.ask(LINES, move |_, progress| {
            let size = part.size()?;
            let cut = with_image!(&picture.image, image => {
                image.crop(part.col, part.row, size).map(AnyImage::from)
            });
            let segments = lines(&cut.ok()?, &params, &edit_context(progress)).ok()?;
            Some(Lines { key, segments })
        });
    }
}

impl Tool for TwoColor {
    fn operation(&self) -> &'static str {
        "twocolor"
    }

    fn label(&self) -> &'static str {
        "Two-color view"
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Picture, Kind::Clip]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        with_params(json!({}))
    }

    fn draft(&self) -> Option<DraftFn> {
        Some(draft)
    }

    fn drafts_first(&self) -> bool {
        true
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let scale = edit.param("scale").as_f64().unwrap_or(1.0);
        if self.shows_lines && scale == 1.0 && hand.view.zoom >= MIN_ZOOM {
            Self::lines_ui(hand, edit);
        }
        None
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        ui.checkbox(&mut self.shows_lines, "Show lines").on_hover_text(
            "The line of each block over the picture, from 75 % on, where a pixel of the result is one of the input",
        );
        let mut draws = edit.fields.contains_key("svg");
        let toggle = ui
            .checkbox(&mut draws, "Export the drawing also (.svg)")
            .on_hover_text("Beside the source");
        if !toggle.changed() {
            return None;
        }
        let mut edit = edit.clone();
        edit.fields.remove("svg");
        if draws {
            let path = desk.document.source.with_extension("svg");
            let path = path.to_string_lossy().into_owned();
            edit.fields.insert("svg".to_owned(), path.into());
        }
        Some(Gesture::done(edit))
    }
}
