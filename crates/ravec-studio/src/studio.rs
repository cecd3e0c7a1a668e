//! The window: documents, their edits, the canvas and the panels.

mod counts;
mod dialogs;
mod panels;
mod queue;
mod work;

use crate::autosave::Autosave;
use crate::background::{Background, Done, ExportState, is_project};
use crate::content::Kind;
use crate::device;
use crate::document::Document;
use crate::engine::Snapshot;
use crate::history::History;
use crate::open::Open;
use crate::project::Project;
use crate::settings::Form;
use crate::tools::{self, Tool};
use crate::view::canvas::Comparison;
use crate::view::mesh::MeshGpu;
#[cfg(test)]
pub(crate) use counts::Count;
pub(crate) use counts::{Counts, Source};
use dialogs::Dialog;
use eframe::egui_wgpu::RenderState;
use egui::{CentralPanel, Key, KeyboardShortcut, Modifiers, Panel, Ui};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const UNDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Z);
const REDO: KeyboardShortcut =
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
const SAVE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::S);
const EXPORT: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::E);
const OPEN: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::O);
const NEXT: KeyboardShortcut = KeyboardShortcut::new(Modifiers::CTRL, Key::Tab);
const CLOSE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::W);
const REOPEN: KeyboardShortcut =
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::T);
const PALETTE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::P);

/// The whole program.
pub struct Studio {
    open: Vec<Open>,
    active: usize,
    next_number: u64,
    tools: Vec<Box<dyn Tool>>,
    forms: HashMap<String, Form>,
    background: Background,
    autosave: Option<Autosave>,
    dialog: Option<Dialog>,
    palette: Option<String>,
    shows_shortcuts: bool,
    shows_queue: bool,
    /// Folder of the example.
    example: PathBuf,
    /// Documents that were closed, with the files of their projects.
    closed: Vec<(Project, Option<PathBuf>, Kind)>,
    /// The setting that was found by name, which the panel marks.
    highlighted: Option<String>,
    /// The last message for the user, and true if it is an error.
    message: Option<(String, bool)>,
    repaint: Arc<dyn Fn() + Send + Sync>,
    /// Draws meshes while the hand moves.
    gpu: Option<MeshGpu>,
}

impl Studio {
    /// A window without documents, or with those of runs that have ended without closing them, which are found in `folder`.
    pub fn new(context: &egui::Context, folder: Option<&Path>) -> Self {
        let own = context.clone();
        let repaint: Arc<dyn Fn() + Send + Sync> = Arc::new(move || own.request_repaint());
        let mut studio = Self {
            open: Vec::new(),
            active: 0,
            next_number: 1,
            tools: tools::all(),
            forms: HashMap::new(),
            background: Background::new(repaint.clone()),
            autosave: None,
            dialog: None,
            palette: None,
            shows_shortcuts: false,
            shows_queue: false,
            example: folder.map_or_else(
                || std::env::temp_dir().join("ravec-example"),
                |folder| folder.join("example"),
            ),
            closed: Vec::new(),
            highlighted: None,
            message: None,
            repaint,
            gpu: None,
        };
        if let Some(folder) = folder {
            studio.background.recover(folder);
        }
        studio
    }

    /// Lets the adapter of the window draw meshes that are opened from now on, if it is a hardware adapter or the one that
    /// [`choose_device`](crate::choose_device) was given by name.
    pub fn draw_meshes_on(&mut self, state: Option<&RenderState>) {
        let chosen = state.filter(|state| device::draws_meshes(&state.adapter.get_info()));
        self.gpu = chosen.and_then(MeshGpu::new);
    }

    /// Opens the example soon: it is drawn at the first time.
    pub fn open_example(&mut self) {
        self.background.open_example(&self.example);
        self.message = Some(("The example is being drawn".to_owned(), false));
    }

    /// Opens a picture or a project soon.
    pub fn open(&mut self, path: &Path) {
        self.background.open(path);
    }

    /// The document in front, if one is open.
    pub fn document(&self) -> Option<&Document> {
        self.open
            .get(self.active)
            .map(|open| open.history.document())
    }

    /// The state of the results of the document in front.
    pub fn snapshot(&self) -> Option<Snapshot> {
        self.open
            .get(self.active)
            .map(|open| open.engine.snapshot())
    }

    /// Number of open documents.
    pub fn documents(&self) -> usize {
        self.open.len()
    }

    /// The last message, and true if it is an error.
    pub fn message(&self) -> Option<(&str, bool)> {
        self.message
            .as_ref()
            .map(|(text, wrong)| (text.as_str(), *wrong))
    }

    /// True while files are read or written, or results are computed.
    pub fn is_busy(&self) -> bool {
        self.background.running > 0 || self.open.iter().any(Open::is_busy)
    }

    /// Shows a project as a document in front.
    fn take(&mut self, project: Project, saved: Option<PathBuf>, kind: Kind) {
        let number = self.next_number;
        self.next_number += 1;
        self.open.push(Open::new(
            number,
            project,
            saved,
            kind,
            &self.repaint,
            self.gpu.as_ref(),
        ));
        self.active = self.open.len() - 1;
        self.autosave();
    }

    /// Takes the ends of tasks on files.
    fn take_ended(&mut self) {
        for done in self.background.ended() {
            self.message = match done {
                Done::Opened(path, Ok((project, kind))) => {
                    let saved = is_project(&path).then_some(path);
                    self.take(project, saved, kind);
                    None
                }
                Done::Saved(number, path, Ok(document)) => {
                    let text = format!("{} is saved", path.display());
                    if let Some(open) = self.open.iter_mut().find(|open| open.number == number) {
                        open.saved = Some(path);
                        open.saved_document = Some(document);
                    }
                    Some((text, false))
                }
                Done::Recovered(projects, ended, session) => {
                    self.autosave = session.map(Autosave::new);
                    // files that were opened meanwhile
                    self.save_copies();
                    let count = projects.len();
                    for (project, kind) in projects {
                        self.take(project, None, kind);
                    }
                    if let Some(autosave) = &self.autosave {
                        autosave.discard(ended);
                    }
                    let text = format!("{count} documents that were not saved are open again");
                    (count > 0).then_some((text, false))
                }
                Done::Exported(_, Ok(paths)) => {
                    let paths: Vec<_> = paths
                        .iter()
                        .map(|path| path.display().to_string())
                        .collect();
                    Some((format!("Written: {}", paths.join(", ")), false))
                }
                Done::Opened(_, Err(reason))
                | Done::Saved(_, _, Err(reason))
                | Done::Exported(_, Err(reason)) => Some((reason, true)),
            };
        }
    }

    fn front(&mut self) -> Option<&mut Open> {
        self.open.get_mut(self.active)
    }

    fn autosave(&self) {
        if let (Some(autosave), Some(open)) = (&self.autosave, self.open.get(self.active)) {
            autosave.save(open.number, open.project());
        }
    }

    /// Saves copies of all documents.
    fn save_copies(&self) {
        if let Some(autosave) = &self.autosave {
            for open in &self.open {
                autosave.save(open.number, open.project());
            }
        }
    }

    fn add_edit(&mut self, tool: usize) {
        let Some(open) = self.open.get_mut(self.active) else {
            return;
        };
        let Some(size) = open.result_size() else {
            return;
        };
        let tool = &self.tools[tool];
        let mut document = open.history.document().clone();
        if open.kind == Kind::Clip {
            for need in tool.needs() {
                if document.last_analysis(need, None).is_none()
                    && let Some(other) = self.tools.iter().find(|tool| tool.operation() == *need)
                {
                    let fields = other.start_in(size, &document);
                    document.push(need, fields);
                }
            }
        }
        let id = document.push(tool.operation(), tool.start_in(size, &document));
        open.history.commit(document);
        open.selected = Some(id);
        self.autosave();
    }

    fn shortcuts(&mut self, ui: &Ui) {
        let pressed =
            |shortcut: &KeyboardShortcut| ui.input_mut(|input| input.consume_shortcut(shortcut));
        // the longer shortcut first: it contains the other
        if pressed(&REDO) {
            self.walk(History::redo);
        }
        if pressed(&UNDO) {
            self.walk(History::undo);
        }
        if pressed(&OPEN) {
            self.dialog = Some(Dialog::Open(String::new()));
        }
        if pressed(&SAVE) {
            self.save();
        }
        if pressed(&EXPORT) {
            self.ask_export();
        }
        if pressed(&PALETTE) {
            self.palette = Some(String::new());
        }
        if pressed(&NEXT) && !self.open.is_empty() {
            self.active = (self.active + 1) % self.open.len();
        }
        if pressed(&CLOSE) {
            self.close(self.active);
        }
        if pressed(&REOPEN)
            && let Some((project, saved, kind)) = self.closed.pop()
        {
            self.take(project, saved, kind);
        }
        if ui.input(|input| input.key_pressed(Key::F1)) {
            self.shows_shortcuts = !self.shows_shortcuts;
        }
        if !ui.ctx().egui_wants_keyboard_input() {
            self.view_keys(ui);
        }
        let dropped = ui.input(|input| input.raw.dropped_files.clone());
        for file in dropped {
            self.open(file.path());
        }
    }

    fn walk(&mut self, step: fn(&mut History)) {
        if let Some(open) = self.front() {
            step(&mut open.history);
            self.autosave();
        }
    }

    fn save(&mut self) {
        let Some(open) = self.open.get(self.active) else {
            return;
        };
        if let Some(path) = open.saved.clone() {
            self.background.save(open.number, open.project(), path);
        } else {
            let path = open.history.document().source.with_extension("ravec.json");
            self.dialog = Some(Dialog::Save(path.display().to_string()));
        }
    }

    fn ask_export(&mut self) {
        if let Some(open) = self.open.get(self.active) {
            let document = open.history.document();
            if document.has_analyses_only() {
                // the files are those of the edits
                if !document.writes_files() {
                    let text = "Nothing would be written: give a track, a plate or a matte the name of a file, or add an edit";
                    self.message = Some((text.to_owned(), true));
                    return;
                }
                self.background
                    .export(document.clone(), open.output.clone());
                return;
            }
            self.dialog = Some(Dialog::Export(open.output.display().to_string()));
        }
    }

    fn menu_ui(&mut self, ui: &mut Ui) {
        ui.horizontal_wrapped(|ui| {
            if ui.button("Open…").on_hover_text("Ctrl+O").clicked() {
                self.dialog = Some(Dialog::Open(String::new()));
            }
            let some = self.open.get(self.active).is_some();
            ui.add_enabled_ui(some, |ui| {
                if ui.button("Save").on_hover_text("Ctrl+S").clicked() {
                    self.save();
                }
                if ui.button("Export…").on_hover_text("Ctrl+E").clicked() {
                    self.ask_export();
                }
                ui.separator();
                let (undo, redo) = self.open.get(self.active).map_or((false, false), |open| {
                    (open.history.can_undo(), open.history.can_redo())
                });
                if ui
                    .add_enabled(undo, egui::Button::new("Undo"))
                    .on_hover_text("Ctrl+Z")
                    .clicked()
                {
                    self.walk(History::undo);
                }
                if ui
                    .add_enabled(redo, egui::Button::new("Redo"))
                    .on_hover_text("Ctrl+Shift+Z")
                    .clicked()
                {
                    self.walk(History::redo);
                }
                ui.separator();
                if ui
                    .button("Fit")
                    .on_hover_text("Show the whole picture")
                    .clicked()
                    && let Some(open) = self.front()
                {
                    open.canvas.fit();
                }
                if ui
                    .button("1:1")
                    .on_hover_text("A pixel of the picture is a pixel of the screen")
                    .clicked()
                {
                    let area = ui.ctx().content_rect();
                    if let Some(open) = self.front() {
                        open.canvas.one_to_one(area);
                    }
                }
            });
            if ui
                .button("Find…")
                .on_hover_text("All tools and settings by name, Ctrl+P")
                .clicked()
            {
                self.palette = Some(String::new());
            }
            let open = self.background.exports.iter().filter(|export| {
                matches!(export.state, ExportState::Waiting | ExportState::Running)
            });
            if ui
                .button(format!("Render queue ({})", open.count()))
                .on_hover_text("Exports that wait, run and have ended")
                .clicked()
            {
                self.shows_queue = !self.shows_queue;
            }
            let dark = ui.visuals().dark_mode;
            let (name, theme) = if dark {
                ("Light", egui::Theme::Light)
            } else {
                ("Dark", egui::Theme::Dark)
            };
            if ui
                .button(name)
                .on_hover_text("Colors of the window")
                .clicked()
            {
                ui.ctx().set_theme(theme);
            }
        });
        if self.open.len() > 1 {
            self.tabs_ui(ui);
        }
    }

    fn tabs_ui(&mut self, ui: &mut Ui) {
        let mut closed = None;
        ui.horizontal_wrapped(|ui| {
            for (index, open) in self.open.iter().enumerate() {
                if ui
                    .selectable_label(index == self.active, &open.name)
                    .clicked()
                {
                    self.active = index;
                }
                if ui
                    .small_button("×")
                    .on_hover_text(format!("Close {}", open.name))
                    .clicked()
                {
                    closed = Some(index);
                }
            }
        });
        if let Some(index) = closed {
            self.close(index);
        }
    }

    /// Closes a document, which can be opened again until the program ends.
    fn close(&mut self, index: usize) {
        if index >= self.open.len() {
            return;
        }
        let open = self.open.remove(index);
        if let Some(autosave) = &self.autosave {
            autosave.forget(open.number);
        }
        self.closed
            .push((open.project(), open.saved.clone(), open.kind));
        self.active = self.active.min(self.open.len().saturating_sub(1));
    }

    /// Keys that change the view.
    fn view_keys(&mut self, ui: &Ui) {
        let pressed = |key| ui.input(|input| input.modifiers.is_none() && input.key_pressed(key));
        let area = ui.ctx().content_rect();
        let Some(open) = self.open.get_mut(self.active) else {
            return;
        };
        let toggle = |to: Comparison, now: Comparison| {
            if std::mem::discriminant(&to) == std::mem::discriminant(&now) {
                Comparison::Off
            } else {
                to
            }
        };
        let now = open.canvas.comparison;
        if pressed(Key::Num0) {
            open.canvas.fit();
        } else if pressed(Key::Num1) {
            open.canvas.one_to_one(area);
        } else if pressed(Key::W) {
            open.canvas.comparison = toggle(Comparison::Wipe(0.5), now);
        } else if pressed(Key::V) {
            open.canvas.comparison = toggle(Comparison::SideBySide, now);
        }
    }
}

impl Studio {
    /// Draws the window, and follows the input of a frame. Without a window of the system, such as in measurements, it is called
    /// with an interface of its own.
    pub fn window_ui(&mut self, ui: &mut Ui) {
        self.take_ended();
        self.shortcuts(ui);
        Panel::top("menu").show(ui, |ui| self.menu_ui(ui));
        Panel::bottom("status").show(ui, |ui| self.status_ui(ui));
        Panel::left("edits").default_size(260.0).show(ui, |ui| {
            // what is in a panel does not change its width, so that the canvas stays where it is
            ui.set_min_width(ui.available_width());
            self.edits_ui(ui);
        });
        Panel::right("settings").default_size(320.0).show(ui, |ui| {
            ui.set_min_width(ui.available_width());
            self.settings_ui(ui);
        });
        if let Some(open) = self.open.get(self.active)
            && open.clip.is_some()
        {
            Panel::bottom("timeline")
                .default_size(150.0)
                .show(ui, |ui| self.timeline_ui(ui));
        }
        CentralPanel::default().show(ui, |ui| self.canvas_ui(ui));
        self.dialog_ui(ui);
        self.palette_ui(ui);
        self.shortcuts_ui(ui);
        self.queue_ui(ui);
    }
}

impl eframe::App for Studio {
    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        self.window_ui(ui);
    }

    /// Drops the copies of documents that are saved; the others are open again at the next start.
    fn on_exit(&mut self) {
        let Some(autosave) = self.autosave.take() else {
            return;
        };
        let (saved, unsaved): (Vec<&Open>, Vec<&Open>) =
            self.open.iter().partition(|open| open.is_saved());
        for open in saved {
            autosave.forget(open.number);
        }
        let session = autosave.finish();
        if unsaved.is_empty()
            && let Some(session) = session
        {
            session.end();
        }
    }
}
