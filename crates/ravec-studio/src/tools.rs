//! Tools: edits that are made and changed by gestures on the canvas.
//!
//! A tool is one file with a type that implements [`Tool`], and a line in [`all`].

mod brush;
mod plain;
mod rectify;
mod retarget;

use crate::document::Edit;
use crate::view::canvas::View;
use egui::{Painter, Response, Ui};
use serde_json::{Map, Value, json};

/// What a tool sees of a frame.
pub(crate) struct Hand<'a> {
    pub ui: &'a Ui,
    /// The canvas.
    pub response: &'a Response,
    pub painter: &'a Painter,
    pub view: View,
    /// Columns and rows of the picture that the edit gets.
    pub input_size: [usize; 2],
}

/// An edit that a gesture has changed.
pub(crate) struct Gesture {
    pub edit: Edit,
    /// True until the button is released.
    pub goes_on: bool,
}

/// Gestures for an operation.
pub(crate) trait Tool {
    /// Name of the operation.
    fn operation(&self) -> &'static str;

    /// Name of the tool, in words.
    fn label(&self) -> &'static str;

    /// Fields of a new edit for a picture of this size.
    fn start(&self, size: [usize; 2]) -> Map<String, Value>;

    /// True if the fields of an edit of the operation are those of this tool.
    fn made(&self, edit: &Edit) -> bool {
        edit.operation == self.operation()
    }

    /// True if the hand works on the input of the edit, which is shown instead of the result.
    fn works_on_input(&self) -> bool {
        false
    }

    /// Draws the handles of an edit and follows the hand.
    fn canvas_ui(&mut self, _hand: &Hand<'_>, _edit: &Edit) -> Option<Gesture> {
        None
    }
}

/// All tools.
pub(crate) fn all() -> Vec<Box<dyn Tool>> {
    vec![
        Box::new(plain::Plain {
            operation: "twocolor",
            label: "Two-color view",
            fields: || with_params(json!({})),
        }),
        Box::new(brush::Brush::default()),
        Box::new(plain::Plain {
            operation: "brush",
            label: "Filter",
            fields: || {
                let mut fields = with_params(json!({"mode": "clean"}));
                fields.insert("everywhere".to_owned(), true.into());
                fields
            },
        }),
        Box::new(retarget::Retarget::default()),
        Box::new(rectify::Rectify::default()),
    ]
}

/// Fields of an operation with these parameters.
fn with_params(params: Value) -> Map<String, Value> {
    let mut fields = Map::new();
    fields.insert("params".to_owned(), params);
    fields
}
