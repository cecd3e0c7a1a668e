//! The middle of the window: canvases, and the tools on them.

use super::Studio;
use crate::open::{Open, input_of, mesh_of};
use crate::tools::{Hand, MeshHand};
use crate::view::canvas::{Comparison, Layers};
use egui::{Key, Ui};

impl Studio {
    /// The canvas of the document in front.
    pub(super) fn canvas_ui(&mut self, ui: &mut Ui) {
        let Some(open) = self.open.get_mut(self.active) else {
            ui.centered_and_justified(|ui| {
                ui.label("Open a picture, a mesh, a clip or a project, or drop one here.")
            });
            return;
        };
        let tools = &mut self.tools;
        let edit = open.selected_edit();
        let tool = edit.as_ref().and_then(|edit| {
            let position = tools.iter().position(|tool| tool.made(edit))?;
            edit.enabled.then_some(position)
        });
        let on_input = match (&edit, tool) {
            (Some(edit), Some(tool)) => tools[tool].works_on_input(edit),
            _ => false,
        };
        let drafts = tool.and_then(|tool| tools[tool].draft());
        // while the hand moves, a quick result takes the place of the whole one
        if drafts.is_none() || on_input || !open.history.in_gesture() {
            open.ask(on_input);
        }
        let snapshot = open.engine.snapshot();
        let beside = tool.is_some_and(|tool| tools[tool].shows_draft_beside());
        if let (Some(edit), Some(draft)) = (&edit, drafts)
            && (beside || open.history.in_gesture())
        {
            open.ask_draft(edit, draft, &snapshot, on_input);
        }
        let draft = edit.as_ref().and_then(|edit| open.draft(edit));
        let stands = draft
            .filter(|_| !beside && !on_input && (open.history.in_gesture() || snapshot.is_stale));
        if open.mesh_canvas.is_some() {
            let input = edit
                .as_ref()
                .and_then(|edit| input_of(edit.id, &snapshot, on_input));
            let result = snapshot.result.as_ref().map(|result| &result.view);
            let shown = stands.as_ref().map(|draft| &draft.view).or(result);
            let shown = mesh_of(shown).cloned();
            let ghost = mesh_of(snapshot.before.as_ref()).cloned();
            let changed = open.history.document().links().next().is_some();
            let ghost = ghost.filter(|_| changed && tool.is_some());
            let marked =
                tool.and_then(|tool| tools[tool].shown_mesh(&open.assistant, shown.as_ref()));
            let shown = marked.or(shown);
            let Some(canvas) = &mut open.mesh_canvas else {
                return;
            };
            canvas.ui(ui, shown.as_ref(), ghost.as_ref());
            if let (Some(edit), Some(tool)) = (edit, tool) {
                let hand = MeshHand {
                    canvas,
                    input: input.as_ref(),
                    snapshot: &snapshot,
                    assistant: &open.assistant,
                };
                if let Some(gesture) = tools[tool].mesh_ui(hand, &edit) {
                    let name = format!("{} canvas", edit.id);
                    open.change(gesture.edit, &name, gesture.goes_on);
                    if !gesture.goes_on {
                        self.autosave();
                    }
                }
            }
            return;
        }
        let typing = ui.ctx().egui_wants_keyboard_input();
        let before = snapshot
            .before
            .as_ref()
            .and_then(|view| view.picture())
            .cloned();
        if !typing && ui.input(|input| input.key_down(Key::B)) && before.is_some() {
            let layers = Layers {
                shown: before.as_ref(),
                ..Layers::default()
            };
            open.canvas.ui(ui, &layers);
            return;
        }
        let played = open.clip.as_ref().and_then(|clip| clip.reader.visible());
        let plain = open.history.document().links().next().is_none() && open.exposure == 0.0;
        let mut shown = snapshot.shown().cloned();
        if plain && let Some((_, frame)) = played {
            shown = Some(frame);
        }
        let mut patch = tool.and_then(|tool| tools[tool].overlay(&open.assistant));
        let whole = stands.as_ref().and_then(|draft| {
            let picture = draft.view.picture()?.clone();
            match draft.place {
                None => Some(picture),
                Some(place) => {
                    patch = Some((picture, place));
                    None
                }
            }
        });
        let shown = whole.or(shown);
        let compares = open.canvas.comparison != Comparison::Off;
        let layers = Layers {
            shown: shown.as_ref(),
            patch: patch.as_ref().map(|(shown, place)| (shown, *place)),
            before: before.as_ref().filter(|_| compares),
        };
        let response = open.canvas.ui(ui, &layers);
        let Some(view) = open.canvas.view() else {
            return;
        };
        let [left, top] = view.to_picture(response.rect.min);
        let [right, bottom] = view.to_picture(response.rect.max);
        open.seen = [left, top, right - left, bottom - top];
        let (Some(edit), Some(tool)) = (edit, tool) else {
            return;
        };
        if beside {
            show_beside(ui, open, &edit);
        }
        if open.canvas.is_held() {
            return;
        }
        let Some(input) = input_of(edit.id, &snapshot, on_input) else {
            return;
        };
        let painter = ui.painter_at(response.rect);
        let hand = Hand {
            ui,
            response: &response,
            painter: &painter,
            view,
            input_size: input.content.size(),
            input: &input,
            snapshot: &snapshot,
            assistant: &open.assistant,
        };
        let gesture = tools[tool].canvas_ui(&hand, &edit);
        if let Some(gesture) = gesture {
            let name = format!("{} canvas", edit.id);
            if let Some(draft) = drafts
                && !on_input
            {
                open.ask_draft(&gesture.edit, draft, &snapshot, on_input);
            }
            open.change(gesture.edit, &name, gesture.goes_on);
            if !gesture.goes_on {
                self.autosave();
            }
        }
    }

    /// The timeline of a clip.
    pub(super) fn timeline_ui(&mut self, ui: &mut Ui) {
        let Some(open) = self.open.get_mut(self.active) else {
            return;
        };
        let edit = open.selected_edit();
        let tool = edit
            .as_ref()
            .and_then(|edit| self.tools.iter().find(|tool| tool.made(edit)));
        let rows = match (tool, &edit) {
            (Some(tool), Some(edit)) => tool.rows(&open.assistant, edit),
            _ => Vec::new(),
        };
        let rows: Vec<_> = rows.iter().map(crate::tools::Row::as_row).collect();
        if let Some(clip) = &mut open.clip {
            clip.timeline.ui(ui, &clip.reader, &rows);
        }
    }
}

/// The quick result in a window over the canvas.
fn show_beside(ui: &Ui, open: &mut Open, edit: &crate::document::Edit) {
    let Some(draft) = open.draft(edit) else {
        return;
    };
    let Some(picture) = draft.view.picture() else {
        return;
    };
    let canvas = &mut open.beside;
    egui::Window::new("Rectified")
        .default_size([260.0, 220.0])
        .default_pos(ui.max_rect().right_top() + egui::vec2(-290.0, 20.0))
        .show(ui.ctx(), |ui| {
            let layers = Layers {
                shown: Some(picture),
                ..Layers::default()
            };
            canvas.ui_named(ui, &layers, "Rectified view");
        });
}
