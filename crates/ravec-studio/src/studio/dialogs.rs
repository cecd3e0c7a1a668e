//! Windows in front: paths, the palette and the shortcuts.

use super::Studio;
use crate::open::Open;
use egui::{Key, Ui};
use std::path::PathBuf;

/// A dialog that asks for a path.
pub(super) enum Dialog {
    Open(String),
    Save(String),
    Export(String),
}

/// Keys and what they do.
const SHORTCUTS: [(&str, &str); 20] = [
    ("Ctrl+O", "Open"),
    ("Ctrl+S", "Save the project"),
    ("Ctrl+E", "Export the result"),
    ("Ctrl+Z, Ctrl+Shift+Z", "Undo, redo"),
    ("Ctrl+P", "Find a tool or a setting"),
    ("Ctrl+Tab", "Next document"),
    ("Ctrl+W, Ctrl+Shift+T", "Close the document, open it again"),
    ("F1", "This list"),
    ("B (hold)", "Show the source"),
    ("Space (hold)", "Pan"),
    ("Wheel", "Zoom at the cursor"),
    ("0, 1", "Whole picture, one pixel as one"),
    ("W, V", "Wipe, side by side with the source"),
    ("[ and ]", "Size of the brush or of fragments"),
    ("S", "Snap a plane to edges"),
    (
        "Shift+wheel, Alt+wheel",
        "Columns and rows; next best fragment",
    ),
    ("Left, Right, Home, End", "Frames of a clip"),
    ("P", "Play and pause"),
    ("I, O", "In and out point"),
    ("Enter, Esc", "Close or drop a polygon"),
];

impl Studio {
    pub(super) fn dialog_ui(&mut self, ui: &Ui) {
        let Some(dialog) = &mut self.dialog else {
            return;
        };
        let (title, action, path) = match dialog {
            Dialog::Open(path) => ("Open a picture, a mesh, a clip or a project", "Open", path),
            Dialog::Save(path) => ("Save the project", "Save", path),
            Dialog::Export(path) => ("Export the result", "Export", path),
        };
        let mut decided = None;
        egui::Modal::new(egui::Id::unique("path")).show(ui.ctx(), |ui| {
            ui.heading(title);
            let label = ui.label("File");
            let field = ui
                .add(egui::TextEdit::singleline(path).desired_width(420.0))
                .labelled_by(label.id);
            if !field.has_focus() && !field.lost_focus() {
                field.request_focus();
            }
            let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
            ui.horizontal(|ui| {
                let button = ui.button(action);
                let name = format!("{title}: {action}");
                button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
                if button.clicked() || entered {
                    decided = Some(true);
                }
                if ui.button("Cancel").clicked() || ui.input(|input| input.key_pressed(Key::Escape))
                {
                    decided = Some(false);
                }
            });
        });
        match decided {
            Some(true) => self.decide(),
            Some(false) => self.dialog = None,
            None => {}
        }
    }

    /// Does what a dialog has asked for.
    fn decide(&mut self) {
        let Some(dialog) = self.dialog.take() else {
            return;
        };
        let path = |text: &str| PathBuf::from(text.trim());
        match dialog {
            Dialog::Open(text) => self.open(&path(&text)),
            Dialog::Save(text) => {
                if let Some(open) = self.open.get(self.active) {
                    self.background
                        .save(open.number, open.project(), path(&text));
                }
            }
            Dialog::Export(text) => {
                if let Some(open) = self.open.get_mut(self.active) {
                    open.output = path(&text);
                    let document = open.history.document().clone();
                    self.background.export(document, path(&text));
                }
            }
        }
    }

    /// Finds tools and settings by name.
    pub(super) fn palette_ui(&mut self, ui: &Ui) {
        let Some(text) = self.palette.clone() else {
            return;
        };
        let mut text = text;
        let mut tool = None;
        let mut setting = None;
        let mut closes = false;
        let kind = self.open.get(self.active).map(|open| open.kind);
        let edit = self.open.get(self.active).and_then(Open::selected_edit);
        let form = edit.and_then(|edit| self.forms.get(&edit.operation));
        let tools = &self.tools;
        egui::Modal::new(egui::Id::unique("palette")).show(ui.ctx(), |ui| {
            let label = ui.label("Find a tool or a setting");
            let field = ui.text_edit_singleline(&mut text).labelled_by(label.id);
            field.request_focus();
            let wanted = text.to_lowercase();
            let entered = ui.input(|input| input.key_pressed(Key::Enter));
            let mut first = true;
            let mut choose = |ui: &mut Ui, name: String| {
                let clicked = ui.button(name).clicked() || (entered && first);
                first = false;
                clicked
            };
            let usable = |tool: &dyn crate::tools::Tool| {
                kind.is_none_or(|kind| tool.kinds().contains(&kind))
            };
            let matching = tools.iter().enumerate().filter(|(_, tool)| {
                usable(tool.as_ref()) && tool.label().to_lowercase().contains(&wanted)
            });
            for (index, found) in matching {
                if choose(ui, format!("Add {}", found.label())) {
                    tool = Some(index);
                }
            }
            let settings = form.iter().flat_map(|form| &form.settings);
            let settings = settings.filter(|setting| {
                !wanted.is_empty()
                    && (setting.label.to_lowercase().contains(&wanted)
                        || setting.help.to_lowercase().contains(&wanted))
            });
            for found in settings.take(8) {
                if choose(ui, format!("Setting: {}", found.label)) {
                    setting = Some(found.name.clone());
                }
            }
            closes = ui.input(|input| input.key_pressed(Key::Escape));
        });
        self.palette = Some(text);
        if let Some(index) = tool {
            self.add_edit(index);
        }
        if setting.is_some() {
            self.highlighted.clone_from(&setting);
        }
        if closes || tool.is_some() || setting.is_some() {
            self.palette = None;
        }
    }

    /// Lists the shortcuts.
    pub(super) fn shortcuts_ui(&mut self, ui: &Ui) {
        let mut open = self.shows_shortcuts;
        egui::Window::new("Shortcuts")
            .open(&mut open)
            .show(ui.ctx(), |ui| {
                egui::Grid::new("shortcuts")
                    .num_columns(2)
                    .striped(true)
                    .show(ui, |ui| {
                        for (keys, action) in SHORTCUTS {
                            ui.monospace(keys);
                            ui.label(action);
                            ui.end_row();
                        }
                    });
            });
        self.shows_shortcuts = open;
    }
}
