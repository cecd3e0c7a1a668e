//! Trimming: a range of a clip, in another size, rate or encoding.

use super::{Desk, Gesture, Tool, range_ui, with_params};
use crate::content::Kind;
use crate::document::Edit;
use egui::Ui;
use serde_json::{Map, Value, json};

/// Takes a range of a clip.
pub(crate) struct Trim;

impl Tool for Trim {
    fn operation(&self) -> &'static str {
        "video convert"
    }

    fn label(&self) -> &'static str {
        "Trim and encode"
    }

    fn hint(&self) -> &'static str {
        "Set the in and the out point with I and O, and take the range"
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Clip]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        with_params(json!({}))
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        ui.label("The frames of exports. The canvas shows the others too, without later edits.");
        range_ui(ui, desk, edit)
    }
}
