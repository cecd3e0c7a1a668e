//! Edits of a shot: removal, replacement, enhancement and paste. All show their result on the frame at the playhead as soon as plate
//! and matte are there.

use super::analysis::{file_ui, regions_ui, source_ui, take_regions};
use super::plate::TRACK;
use super::{Desk, Gesture, Tool, with_params};
use crate::analyses::AnalysisState;
use crate::content::Kind;
use crate::document::{Document, Edit};
use egui::{RichText, Ui};
use serde_json::{Map, Value, json};

/// Name, label and help of a field.
type Field = (&'static str, &'static str, &'static str);

/// An edit of a shot.
pub(crate) struct ShotTool {
    operation: &'static str,
    label: &'static str,
    hint: &'static str,
    /// Files that only this edit has. The first one has to be given.
    files: &'static [Field],
    /// True if it can take the corners of the tracked plane.
    has_quad: bool,
}

impl ShotTool {
    /// The foreground is removed.
    pub const REMOVE: Self = Self {
        operation: "video remove",
        label: "Remove the foreground",
        hint: "The plate shows through, with the grain of the clip",
        files: &[],
        has_quad: false,
    };

    /// The background is replaced.
    pub const REPLACE: Self = Self {
        operation: "video replace",
        label: "Replace the background",
        hint: "Another picture or clip behind the foreground, or on the tracked plane",
        files: &[("image", "New background", "A picture or a clip")],
        has_quad: true,
    };

    /// The plane gets the detail of a photo.
    pub const ENHANCE: Self = Self {
        operation: "video enhance",
        label: "Enhance by a photo",
        hint: "A sharp photo of the plane replaces the plane, at twice the size",
        files: &[("photo", "Photo", "A sharp photo of the plane")],
        has_quad: true,
    };

    /// The foreground is put into another clip.
    pub const PASTE: Self = Self {
        operation: "video paste",
        label: "Paste into a clip",
        hint: "The foreground goes into another clip, in its perspective",
        files: &[
            (
                "into",
                "Into",
                "The clip or the picture that gets the foreground",
            ),
            ("into_track", "Its track", "The motion of the plane in it"),
            (
                "into_matte",
                "In front",
                "Matte of what stays in front of the foreground",
            ),
        ],
        has_quad: true,
    };
}

/// The corners of the plane that a document tracks.
pub(super) fn tracked_plane<'a>(document: &'a Document, edit: &Edit) -> Option<&'a Value> {
    let track = document.last_analysis("track", Some(edit.id))?;
    track.param("quads").get(0)
}

impl Tool for ShotTool {
    fn operation(&self) -> &'static str {
        self.operation
    }

    fn label(&self) -> &'static str {
        self.label
    }

    fn hint(&self) -> &'static str {
        self.hint
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Clip]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        let mut fields = with_params(json!({}));
        for name in ["plate", "matte"] {
            fields.insert(name.to_owned(), format!("@{name}").into());
        }
        if let Some((name, ..)) = self.files.first() {
            fields.insert((*name).to_owned(), "".into());
        }
        fields
    }

    fn start_in(&self, size: [usize; 2], document: &Document) -> Map<String, Value> {
        let mut fields = self.start(size);
        for name in ["plate", "matte", "track"] {
            if let Some(known) = document.last_analysis(name, None)
                && let Some(output) = known.output()
            {
                fields.insert(name.to_owned(), output.into());
            }
        }
        take_regions(&mut fields, document);
        fields
    }

    fn needs(&self) -> &'static [&'static str] {
        &["plate", "matte"]
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        self.wait_ui(ui, desk, edit);
        let mut changed = None;
        for (index, field) in self.files.iter().enumerate() {
            let line = file_ui(ui, edit, *field);
            // the first one stays in the edit, for it has to be given
            changed = changed.or(line.map(|gesture| match index {
                0 if !gesture.edit.fields.contains_key(field.0) => {
                    let mut edit = gesture.edit;
                    edit.fields.insert(field.0.to_owned(), "".into());
                    Gesture::done(edit)
                }
                _ => gesture,
            }));
        }
        if self.has_quad
            && let Some(corners) = tracked_plane(desk.document, edit)
        {
            let mut on_plane = edit.param("quad") == corners;
            if ui
                .checkbox(&mut on_plane, "On the tracked plane")
                .on_hover_text("Takes the corners of the track")
                .changed()
            {
                let value = if on_plane {
                    corners.clone()
                } else {
                    Value::Null
                };
                changed = Some(Gesture::done(edit.with_param("quad", value)));
            }
        }
        for field in [
            ("plate", "Plate", "The background without foreground"),
            ("matte", "Matte", "Alpha of the foreground"),
            TRACK,
        ] {
            changed = changed.or(source_ui(ui, desk, edit, field));
        }
        changed.or(regions_ui(ui, desk, edit))
    }
}

impl ShotTool {
    /// Says what the edit waits for.
    fn wait_ui(&self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) {
        if let Some((name, label, _)) = self.files.first()
            && edit.text_field(name).is_empty()
        {
            ui.label(RichText::new(format!("Give the file: {label}")).strong());
        }
        for (name, label) in [("track", "track"), ("plate", "plate"), ("matte", "matte")] {
            let Some(known) = desk.document.last_analysis(name, Some(edit.id)) else {
                continue;
            };
            if known.output() != Some(edit.text_field(name)) {
                continue;
            }
            match desk.assistant.analyses.state(known.id) {
                AnalysisState::Done => {}
                AnalysisState::Waiting => {
                    ui.label(RichText::new(format!("The {label} is not there yet")).italics());
                }
                AnalysisState::Running(phase, fraction) => {
                    let bar = egui::ProgressBar::new(fraction as f32).desired_width(200.0);
                    ui.add(bar.text(format!("The {label} is made: {phase}")));
                }
                AnalysisState::Failed(reason) => {
                    let text = format!("The {label} cannot be made: {reason}");
                    ui.colored_label(ui.visuals().error_fg_color, text);
                }
            }
        }
    }
}
