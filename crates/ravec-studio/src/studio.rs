//! The window: documents, their edits, the canvas and the panels.

use crate::autosave::{Autosave, Session, recover};
use crate::background::{Background, Done, is_project};
use crate::document::{Document, Edit, EditId};
use crate::engine::{Engine, Snapshot};
use crate::history::History;
use crate::project::Project;
use crate::settings::{self, Form};
use crate::tools::{self, Hand, Tool};
use crate::view::canvas::Canvas;
use crate::view::panel::panel_ui;
use egui::{CentralPanel, Key, KeyboardShortcut, Modifiers, Panel, RichText, Ui};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Time after which work shows its progress and a button that stops it.
const PATIENCE: Duration = Duration::from_millis(300);

const UNDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Z);
const REDO: KeyboardShortcut =
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
const SAVE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::S);
const EXPORT: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::E);
const OPEN: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::O);
const PALETTE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::P);

/// A document that is open.
struct Open {
    number: u64,
    name: String,
    history: History,
    engine: Engine,
    canvas: Canvas,
    selected: Option<EditId>,
    /// Where the project is saved, once it was.
    saved: Option<PathBuf>,
    output: PathBuf,
    /// The document that the engine was asked for last.
    asked: Option<Document>,
}

/// A dialog that asks for a path.
enum Dialog {
    Open(String),
    Save(String),
    Export(String),
}

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
    /// The last message for the user, and true if it is an error.
    message: Option<(String, bool)>,
    repaint: Arc<dyn Fn() + Send + Sync>,
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
            message: None,
            repaint,
        };
        if let Some(folder) = folder {
            let recovered = recover(folder);
            studio.autosave = Session::create(folder).ok().map(Autosave::new);
            let count = recovered.len();
            for project in recovered {
                studio.take(project, None);
            }
            if count > 0 {
                let text =
                    format!("{count} documents of a run that was interrupted are open again");
                studio.message = Some((text, false));
            }
        }
        studio
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
        let computes = |open: &Open| {
            let snapshot = open.engine.snapshot();
            snapshot.busy.is_some() || (snapshot.is_stale && snapshot.failure.is_none())
        };
        self.background.running > 0 || self.open.iter().any(computes)
    }

    /// Shows a project as a document in front.
    fn take(&mut self, project: Project, saved: Option<PathBuf>) {
        let name = project.document.source.file_name().unwrap_or_default();
        let repaint = self.repaint.clone();
        let number = self.next_number;
        self.next_number += 1;
        let selected = project.document.edits.last().map(|edit| edit.id);
        self.open.push(Open {
            number,
            name: name.to_string_lossy().into_owned(),
            history: History::new(project.document),
            engine: Engine::new(move || repaint()),
            canvas: Canvas::default(),
            selected,
            saved,
            output: project.output,
            asked: None,
        });
        self.active = self.open.len() - 1;
        self.autosave();
    }

    /// Takes the ends of tasks on files.
    fn take_ended(&mut self) {
        for done in self.background.ended() {
            self.message = match done {
                Done::Opened(path, Ok(project)) => {
                    let saved = is_project(&path).then_some(path);
                    self.take(project, saved);
                    None
                }
                Done::Saved(path, Ok(())) => {
                    let text = format!("{} is saved", path.display());
                    if let Some(open) = self.open.get_mut(self.active) {
                        open.saved = Some(path);
                    }
                    Some((text, false))
                }
                Done::Exported(path, Ok(())) => {
                    Some((format!("{} is written", path.display()), false))
                }
                Done::Opened(_, Err(reason))
                | Done::Saved(_, Err(reason))
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

    fn add_edit(&mut self, tool: usize) {
        let Some(open) = self.open.get_mut(self.active) else {
            return;
        };
        let Some(size) = open.result_size() else {
            return;
        };
        let tool = &self.tools[tool];
        let mut document = open.history.document().clone();
        let id = document.push(tool.operation(), tool.start(size));
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
            self.background.save(open.project(), path);
        } else {
            let path = open.history.document().source.with_extension("ravec.json");
            self.dialog = Some(Dialog::Save(path.display().to_string()));
        }
    }

    fn ask_export(&mut self) {
        if let Some(open) = self.open.get(self.active) {
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
            let open = self.open.remove(index);
            if let Some(autosave) = &self.autosave {
                autosave.forget(open.number);
            }
            self.active = self.active.min(self.open.len().saturating_sub(1));
        }
    }

    /// Tools and edits.
    fn edits_ui(&mut self, ui: &mut Ui) {
        ui.heading("Tools");
        let ready = self
            .open
            .get(self.active)
            .is_some_and(|open| open.result_size().is_some());
        let mut chosen = None;
        for (index, tool) in self.tools.iter().enumerate() {
            if ui
                .add_enabled(ready, egui::Button::new(tool.label()))
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
            ui.label("Open a picture, or drop one here.");
            return;
        };
        if open.list_ui(ui, tools) {
            self.autosave();
        }
    }

    /// The settings of the selected edit.
    fn settings_ui(&mut self, ui: &mut Ui) {
        let Some(open) = self.open.get_mut(self.active) else {
            return;
        };
        let Some(edit) = open
            .selected
            .and_then(|id| open.history.document().edit(id).cloned())
        else {
            ui.label("Choose a tool, or an edit of the list.");
            return;
        };
        let form = self.forms.entry(edit.operation.clone()).or_insert_with(|| {
            settings::form(&edit.operation).unwrap_or(Form {
                about: String::new(),
                settings: Vec::new(),
            })
        });
        ui.heading(label_of(&self.tools, &edit));
        ui.label(RichText::new(&form.about).weak());
        let snapshot = open.engine.snapshot();
        if let Some(failure) = snapshot
            .failure
            .filter(|failure| failure.edit == Some(edit.id))
        {
            ui.colored_label(ui.visuals().error_fg_color, failure.message);
        }
        ui.separator();
        let change = egui::ScrollArea::vertical()
            .show(ui, |ui| panel_ui(ui, form, &edit))
            .inner;
        if let Some(change) = change {
            let gesture = format!("{} {}", edit.id, change.name);
            open.change(
                edit.with_param(&change.name, change.value),
                &gesture,
                change.goes_on,
            );
            if !change.goes_on {
                self.autosave();
            }
        } else if open.history.in_gesture() && !ui.input(|input| input.pointer.any_down()) {
            open.history.end_gesture();
            self.autosave();
        }
    }

    fn status_ui(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if let Some(open) = self.open.get(self.active) {
                let snapshot = open.engine.snapshot();
                if let Some(shown) = &snapshot.shown {
                    let [width, height] = shown.size();
                    ui.label(format!("{width} × {height}"));
                }
                if let Some(view) = open.canvas.view() {
                    ui.label(format!("{:.0} %", 100.0 * view.zoom));
                    ui.weak("hold B to see the source, Space to pan");
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
            if let Some((text, wrong)) = &self.message {
                if *wrong {
                    ui.colored_label(ui.visuals().error_fg_color, text);
                } else {
                    ui.label(text);
                }
            }
        });
    }

    fn canvas_ui(&mut self, ui: &mut Ui) {
        let Some(open) = self.open.get_mut(self.active) else {
            ui.centered_and_justified(|ui| {
                ui.label("Open a picture or a project, or drop one here.")
            });
            return;
        };
        let tools = &mut self.tools;
        let edit = open
            .selected
            .and_then(|id| open.history.document().edit(id).cloned());
        let tool = edit.as_ref().and_then(|edit| {
            let position = tools.iter().position(|tool| tool.made(edit))?;
            edit.enabled.then_some(position)
        });
        let on_input = tool.is_some_and(|tool| tools[tool].works_on_input());
        open.ask(on_input);
        let snapshot = open.engine.snapshot();
        let typing = ui.ctx().egui_wants_keyboard_input();
        if !typing && ui.input(|input| input.key_down(Key::B)) && snapshot.before.is_some() {
            open.canvas.ui(ui, snapshot.before.as_ref());
            return;
        }
        let response = open.canvas.ui(ui, snapshot.shown.as_ref());
        let (Some(edit), Some(tool), Some(view)) = (edit, tool, open.canvas.view()) else {
            return;
        };
        let shown = snapshot.shown.map(|shown| shown.size());
        let own = snapshot.input_sizes.get(&edit.id).copied();
        let Some(input_size) = own.or(shown.filter(|_| on_input)) else {
            return;
        };
        let painter = ui.painter_at(response.rect);
        let hand = Hand {
            ui,
            response: &response,
            painter: &painter,
            view,
            input_size,
        };
        if let Some(gesture) = tools[tool].canvas_ui(&hand, &edit) {
            let name = format!("{} canvas", edit.id);
            open.change(gesture.edit, &name, gesture.goes_on);
            if !gesture.goes_on {
                self.autosave();
            }
        }
    }

    fn dialog_ui(&mut self, ui: &Ui) {
        let Some(dialog) = &mut self.dialog else {
            return;
        };
        let (title, action, path) = match dialog {
            Dialog::Open(path) => ("Open a picture or a project", "Open", path),
            Dialog::Save(path) => ("Save the project", "Save", path),
            Dialog::Export(path) => ("Export the picture", "Export", path),
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
                    self.background.save(open.project(), path(&text));
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

    /// Finds tools by name.
    fn palette_ui(&mut self, ui: &Ui) {
        let Some(text) = &mut self.palette else {
            return;
        };
        let mut chosen = None;
        let mut closes = false;
        let tools = &self.tools;
        egui::Modal::new(egui::Id::unique("palette")).show(ui.ctx(), |ui| {
            let label = ui.label("Find a tool");
            let field = ui.text_edit_singleline(text).labelled_by(label.id);
            field.request_focus();
            let wanted = text.to_lowercase();
            let matching = tools
                .iter()
                .enumerate()
                .filter(|(_, tool)| tool.label().to_lowercase().contains(&wanted));
            for (index, tool) in matching {
                if ui.button(format!("Add {}", tool.label())).clicked() {
                    chosen = Some(index);
                }
            }
            closes = ui.input(|input| input.key_pressed(Key::Escape));
        });
        if let Some(index) = chosen {
            self.add_edit(index);
        }
        if closes || chosen.is_some() {
            self.palette = None;
        }
    }
}

/// The name of the tool that makes such an edit.
fn label_of(tools: &[Box<dyn Tool>], edit: &Edit) -> String {
    let tool = tools.iter().find(|tool| tool.made(edit));
    tool.map_or_else(|| edit.operation.clone(), |tool| tool.label().to_owned())
}

impl Open {
    fn project(&self) -> Project {
        Project {
            document: self.history.document().clone(),
            output: self.output.clone(),
        }
    }

    /// The size of what is shown.
    fn result_size(&self) -> Option<[usize; 2]> {
        self.engine.snapshot().shown.map(|shown| shown.size())
    }

    /// Takes a changed edit.
    fn change(&mut self, edit: Edit, gesture: &str, goes_on: bool) {
        let mut document = self.history.document().clone();
        document.replace(edit);
        self.history.change(gesture, document);
        if !goes_on {
            self.history.end_gesture();
        }
    }

    /// Asks the engine for what is to be seen: the whole document, or the input of the selected edit.
    fn ask(&mut self, on_input: bool) {
        let mut wanted = self.history.document().clone();
        if on_input && let Some(id) = self.selected {
            let end = wanted.edits.iter().position(|edit| edit.id == id);
            wanted.edits.truncate(end.unwrap_or(wanted.edits.len()));
        }
        if self.asked.as_ref() != Some(&wanted) {
            self.engine.request(wanted.clone());
            self.asked = Some(wanted);
        }
    }

    /// The list of edits; true if it was changed.
    fn list_ui(&mut self, ui: &mut Ui, tools: &[Box<dyn Tool>]) -> bool {
        let document = self.history.document().clone();
        let failure = self.engine.snapshot().failure;
        let mut changed = document.clone();
        if ui
            .selectable_label(self.selected.is_none(), &self.name)
            .clicked()
        {
            self.selected = None;
        }
        for edit in &document.edits {
            let label = label_of(tools, edit);
            ui.horizontal(|ui| {
                let mut enabled = edit.enabled;
                let toggle = ui
                    .checkbox(&mut enabled, "")
                    .on_hover_text(format!("Use {label}"));
                toggle.widget_info(|| {
                    egui::WidgetInfo::selected(
                        egui::Role::CheckBox,
                        true,
                        enabled,
                        format!("Use {label}"),
                    )
                });
                if toggle.changed() {
                    changed.replace(Edit {
                        enabled,
                        ..Edit::clone(edit)
                    });
                }
                let failed = failure
                    .as_ref()
                    .is_some_and(|failure| failure.edit == Some(edit.id));
                let name = if failed {
                    format!("{label} (failed)")
                } else {
                    label.clone()
                };
                if ui
                    .selectable_label(self.selected == Some(edit.id), name)
                    .clicked()
                {
                    self.selected = Some(edit.id);
                }
                for (sign, places, verb) in [("Up", -1, "Earlier"), ("Down", 1, "Later")] {
                    let name = format!("{verb}: {label}");
                    let button = ui.small_button(sign).on_hover_text(&name);
                    button
                        .widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
                    if button.clicked() {
                        changed.shift(edit.id, places);
                    }
                }
                let remove = ui
                    .small_button("×")
                    .on_hover_text(format!("Remove {label}"));
                let name = format!("Remove {label}");
                remove.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
                if remove.clicked() {
                    changed.remove(edit.id);
                }
            });
        }
        let differs = changed != document;
        if differs {
            if self.selected.is_some_and(|id| changed.edit(id).is_none()) {
                self.selected = changed.edits.last().map(|edit| edit.id);
            }
            self.history.commit(changed);
        }
        differs
    }
}

impl eframe::App for Studio {
    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        self.take_ended();
        self.shortcuts(ui);
        Panel::top("menu").show(ui, |ui| self.menu_ui(ui));
        Panel::bottom("status").show(ui, |ui| self.status_ui(ui));
        Panel::left("edits")
            .default_size(200.0)
            .show(ui, |ui| self.edits_ui(ui));
        Panel::right("settings")
            .default_size(320.0)
            .show(ui, |ui| self.settings_ui(ui));
        CentralPanel::default().show(ui, |ui| self.canvas_ui(ui));
        self.dialog_ui(ui);
        self.palette_ui(ui);
    }

    fn on_exit(&mut self) {
        if let Some(session) = self.autosave.take().and_then(Autosave::finish) {
            session.end();
        }
    }
}
