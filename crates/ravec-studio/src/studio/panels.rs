//! The panels: tools, edits, settings and the state of the work.

use super::Studio;
use crate::content::Kind;
use crate::document::Edit;
use crate::open::{input_of, label_of};
use crate::settings::{self, Form};
use crate::shown::Shown;
use crate::tools::{Desk, Gesture};
use crate::view::canvas::{Canvas, Layers};
use crate::view::panel::{Change, panel_ui};
use egui::{RichText, Ui};
use std::sync::Arc;
use std::time::Duration;

/// Time after which work shows its progress and a button that stops it.
const PATIENCE: Duration = Duration::from_millis(300);

/// Height of the picture of a quick result in the panel, in points.
const BESIDE_HEIGHT: f32 = 200.0;

/// The form of the settings of an edit; an empty one if the operation has none.
fn form_of(edit: &Edit) -> Form {
    settings::form(&edit.operation).unwrap_or(Form {
        about: String::new(),
        settings: Vec::new(),
    })
}

/// Shows a picture in the panel.
fn beside_ui(ui: &mut Ui, canvas: &mut Canvas, picture: &Arc<Shown>, name: &str) {
    let size = egui::vec2(ui.available_width(), BESIDE_HEIGHT);
    let layers = Layers {
        shown: Some(picture),
        ..Layers::default()
    };
    ui.allocate_ui(size, |ui| {
        ui.set_max_height(BESIDE_HEIGHT);
        canvas.ui_named(ui, &layers, name);
    });
}

impl Studio {
    /// Tools and edits.
    pub(super) fn edits_ui(&mut self, ui: &mut Ui) {
        egui::ScrollArea::vertical().show(ui, |ui| {
            ui.heading("Tools");
            let open = self.open.get(self.active);
            let ready = open.is_some_and(|open| open.result_size().is_some());
            let kind = open.map_or(Kind::Picture, |open| open.kind);
            let mut chosen = None;
            for (index, tool) in self.tools.iter().enumerate() {
                if tool.kinds().contains(&kind)
                    && ui
                        .add_enabled(ready, egui::Button::new(tool.label()))
                        .on_hover_text(tool.hint())
                        .clicked()
                {
                    chosen = Some(index);
                }
            }
            if let Some(index) = chosen {
                self.add_edit(index);
            }
            ui.separator();
            ui.heading("Edits");
            let tools = &self.tools;
            let Some(open) = self.open.get_mut(self.active) else {
                ui.label("Open a picture, a mesh or a clip, or drop one here.");
                return;
            };
            if open.list_ui(ui, tools) {
                self.autosave();
            }
        });
    }

    /// The settings of the selected edit.
    pub(super) fn settings_ui(&mut self, ui: &mut Ui) {
        let Some(open) = self.open.get_mut(self.active) else {
            return;
        };
        if let Some(canvas) = &mut open.mesh_canvas {
            egui::CollapsingHeader::new("View")
                .default_open(open.selected.is_none())
                .show(ui, |ui| {
                    canvas.options_ui(ui);
                });
        }
        let Some(edit) = open.selected_edit() else {
            ui.label("Choose a tool, or an edit of the list.");
            return;
        };
        let form = self.forms.entry(edit.operation.clone());
        let form = form.or_insert_with(|| form_of(&edit));
        ui.heading(label_of(&self.tools, &edit));
        ui.label(RichText::new(&form.about).weak());
        let snapshot = open.engine.snapshot();
        if let Some(failure) = &snapshot.failure
            && failure.edit == Some(edit.id)
        {
            ui.colored_label(ui.visuals().error_fg_color, &failure.message);
        }
        ui.separator();
        let tool = self.tools.iter_mut().find(|tool| tool.made(&edit));
        let on_input = tool.as_ref().is_some_and(|tool| tool.works_on_input(&edit));
        let input = input_of(edit.id, &snapshot, on_input);
        let draft = open.draft(&edit);
        let document = open.history.document().clone();
        let range = open.clip.as_ref().and_then(|clip| {
            let range = clip.timeline.range.clone();
            (!range.is_empty()).then_some(range)
        });
        let desk = Desk {
            input: input.as_ref(),
            note: draft
                .as_ref()
                .map(|draft| draft.note.as_str())
                .filter(|note| !note.is_empty()),
            document: &document,
            range: range.clone(),
            snapshot: &snapshot,
            assistant: &open.assistant,
        };
        let own = tool
            .as_ref()
            .and_then(|tool| tool.beside(&open.assistant, &edit));
        let beside = tool
            .as_ref()
            .filter(|tool| tool.shows_draft_beside())
            .and(draft.as_ref())
            .and_then(|draft| draft.view.picture())
            .or(own.as_ref());
        if let Some(picture) = beside {
            let name = tool.as_ref().map_or("", |tool| tool.beside_name());
            beside_ui(ui, &mut open.beside, picture, name);
        }
        let highlighted = self.highlighted.as_deref();
        let (gesture, change) = egui::ScrollArea::vertical()
            .show(ui, |ui| {
                let mut gesture = None;
                let mut hidden: &[&str] = &[];
                if let Some(tool) = tool {
                    gesture = tool.panel_ui(ui, &desk, &edit);
                    hidden = tool.hidden();
                    ui.separator();
                }
                let is_clip = open.kind == Kind::Clip;
                (
                    gesture,
                    panel_ui(ui, form, &edit, hidden, is_clip, highlighted),
                )
            })
            .inner;
        self.apply(ui, &edit, gesture, change);
    }

    /// Changes the document as a panel says, and saves it once the gesture has ended.
    fn apply(&mut self, ui: &Ui, edit: &Edit, gesture: Option<Gesture>, change: Option<Change>) {
        let Some(open) = self.open.get_mut(self.active) else {
            return;
        };
        let goes_on = if let Some(gesture) = gesture {
            let name = format!("{} panel", edit.id);
            open.change(gesture.edit, &name, gesture.goes_on);
            gesture.goes_on
        } else if let Some(change) = change {
            let name = format!("{} {}", edit.id, change.name);
            open.change(
                edit.with_param(&change.name, change.value),
                &name,
                change.goes_on,
            );
            change.goes_on
        } else if open.history.in_gesture() && !ui.input(|input| input.pointer.any_down()) {
            open.history.end_gesture();
            false
        } else {
            return;
        };
        if !goes_on {
            self.autosave();
        }
    }

    /// The state of the work.
    pub(super) fn status_ui(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if let Some(open) = self.open.get_mut(self.active) {
                let snapshot = open.engine.snapshot();
                if let Some(mesh) = snapshot
                    .result
                    .as_ref()
                    .and_then(|result| result.content.mesh())
                {
                    ui.label(format!("{} triangles", mesh.mesh.triangles().len()));
                }
                if let Some([width, height]) = snapshot.size() {
                    ui.label(format!("{width} × {height}"));
                    if let Some(view) = open.canvas.view() {
                        ui.label(format!("{:.0} %", 100.0 * view.zoom));
                    }
                    let label = ui.label("Exposure");
                    ui.add(
                        egui::DragValue::new(&mut open.exposure)
                            .range(-10.0..=10.0)
                            .speed(0.05)
                            .suffix(" stops"),
                    )
                    .labelled_by(label.id);
                }
                let edit = open.selected_edit();
                let tool = edit.and_then(|edit| self.tools.iter().find(|tool| tool.made(&edit)));
                if let Some(tool) = tool {
                    ui.weak(tool.hint());
                }
                if let Some(busy) = &snapshot.busy {
                    if busy.elapsed > PATIENCE {
                        let bar = egui::ProgressBar::new(busy.fraction as f32).desired_width(140.0);
                        ui.add(bar.text(busy.phase));
                        if ui.button("Stop").clicked() {
                            open.engine.cancel();
                        }
                    }
                    ui.ctx().request_repaint_after(Duration::from_millis(50));
                }
                if snapshot.is_stale {
                    ui.label(RichText::new("older result").italics());
                }
                if let Some(failure) = snapshot.failure.filter(|failure| failure.edit.is_none()) {
                    ui.colored_label(ui.visuals().error_fg_color, failure.message);
                }
            }
            let mut stopped = None;
            for export in &self.background.exports {
                if !export.is_running() {
                    continue;
                }
                if export.elapsed() > PATIENCE {
                    let (phase, fraction) = export.phase();
                    let bar = egui::ProgressBar::new(fraction as f32).desired_width(140.0);
                    ui.add(bar.text(format!("Export: {phase}")));
                    if ui.button("Stop export").clicked() {
                        stopped = Some(export.number);
                    }
                }
                ui.ctx().request_repaint_after(Duration::from_millis(50));
            }
            if let Some(number) = stopped {
                self.background.stop(number);
            }
            if let Some((text, wrong)) = &self.message {
                if *wrong {
                    ui.colored_label(ui.visuals().error_fg_color, text);
                } else {
                    ui.label(text);
                }
            }
        });
    }
}
