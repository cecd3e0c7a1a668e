//! Tools without gestures: their panel is all.

use super::Tool;
use crate::document::Edit;
use serde_json::{Map, Value};

/// A tool that only has settings.
pub(crate) struct Plain {
    pub operation: &'static str,
    pub label: &'static str,
    pub fields: fn() -> Map<String, Value>,
}

impl Tool for Plain {
    fn operation(&self) -> &'static str {
        self.operation
    }

    fn label(&self) -> &'static str {
        self.label
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        (self.fields)()
    }

    fn made(&self, edit: &Edit) -> bool {
        edit.operation == self.operation && !edit.fields.contains_key("strokes")
    }
}
