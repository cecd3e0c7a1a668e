//! Overlays: a picture or clip over a clip, whose corners are dragged onto a plane.

use super::analysis::{file_ui, source_ui};
use super::plate::TRACK;
use super::quad::{self, Corners, QuadHandle};
use super::shot::tracked_plane;
use super::{Desk, Gesture, Hand, Tool, range_ui, with_params};
use crate::content::Kind;
use crate::document::{Document, Edit};
use egui::{Color32, RichText, Ui};
use serde_json::{Map, Value, json};

/// Lays pictures over a clip.
#[derive(Default)]
pub(crate) struct Overlay {
    handle: QuadHandle,
}

/// The corners of the place of the picture.
fn place(edit: &Edit) -> Option<Corners> {
    quad::read(edit.param("quad").as_str()?)
}

/// The frame in which the corners are given: the reference frame of the track, or any.
fn frame_of_corners(document: &Document, edit: &Edit) -> Option<u64> {
    let track = edit.text_field("track");
    let known = document.last_analysis("track", Some(edit.id))?;
    (known.output() == Some(track)).then(|| known.param("reference").as_u64().unwrap_or(0))
}

impl Tool for Overlay {
    fn operation(&self) -> &'static str {
        "video overlay"
    }

    fn label(&self) -> &'static str {
        "Overlay a picture"
    }

    fn hint(&self) -> &'static str {
        "A picture or clip over the clip; drag its corners onto a plane"
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Clip]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        let mut fields = with_params(json!({}));
        fields.insert("image".to_owned(), "".into());
        fields
    }

    fn start_in(&self, size: [usize; 2], document: &Document) -> Map<String, Value> {
        let mut fields = self.start(size);
        if let Some(track) = document.last_analysis("track", None)
            && let (Some(output), Some(corners)) = (track.output(), track.param("quads").get(0))
        {
            fields.insert("track".to_owned(), output.into());
            fields.insert("params".to_owned(), json!({ "quad": corners }));
        }
        fields
    }

    fn hidden(&self) -> &'static [&'static str] {
        &["quad"]
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let corners = place(edit)?;
        let given = frame_of_corners(hand.document, edit);
        if given.is_some() && given != hand.frame {
            return None;
        }
        let color = Color32::from_rgb(120, 190, 255);
        quad::paint(hand.painter, hand.view, &corners, [1, 1], color, true);
        let moved = self.handle.follow(hand, &[corners])?;
        Some(Gesture {
            edit: edit.with_param("quad", quad::text(&moved.corners).into()),
            goes_on: moved.goes_on,
        })
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        if edit.text_field("image").is_empty() {
            ui.label(RichText::new("Give the file: Picture").strong());
        }
        let image = (
            "image",
            "Picture",
            "A picture or a clip; its alpha is obeyed",
        );
        let mut changed = file_ui(ui, edit, image).map(|gesture| {
            // it has to be given, so it stays in the edit
            let mut edit = gesture.edit;
            edit.fields
                .entry("image".to_owned())
                .or_insert_with(|| "".into());
            Gesture::done(edit)
        });
        if let Some(frame) = frame_of_corners(desk.document, edit) {
            ui.label(format!("Its corners are given in frame {frame}"));
        }
        ui.horizontal(|ui| {
            let size = desk.input.map(|input| input.content.size());
            if let Some([width, height]) = size
                && ui
                    .button("Place by corners")
                    .on_hover_text("In the middle of the frame, to be dragged")
                    .clicked()
            {
                let (x, y) = (width as f64 / 4.0, height as f64 / 4.0);
                let corners = [[x, y], [3.0 * x, y], [3.0 * x, 3.0 * y], [x, 3.0 * y]];
                let text = quad::text(&corners);
                changed = Some(Gesture::done(edit.with_param("quad", text.into())));
            }
            if ui
                .button("Fit to the frame")
                .on_hover_text("As large as its shape allows")
                .clicked()
            {
                changed = Some(Gesture::done(edit.with_param("quad", Value::Null)));
            }
            if let Some(corners) = tracked_plane(desk.document, edit)
                && ui
                    .button("Take the tracked plane")
                    .on_hover_text("The corners of the track")
                    .clicked()
            {
                changed = Some(Gesture::done(edit.with_param("quad", corners.clone())));
            }
        });
        let front = (
            "matte",
            "In front",
            "Matte of what stays in front of the picture",
        );
        changed = changed
            .or(source_ui(ui, desk, edit, TRACK))
            .or(source_ui(ui, desk, edit, front));
        changed.or(range_ui(ui, desk, edit))
    }
}
