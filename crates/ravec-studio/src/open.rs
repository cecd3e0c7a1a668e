//! A document that is open: its history, its results and its canvases.

use crate::assistant::Assistant;
use crate::clip::ClipReader;
use crate::content::{Kind, View};
use crate::document::{Document, Edit, EditId};
use crate::engine::{EditInput, Engine, Request, Snapshot, SourceFrame};
use crate::history::History;
use crate::project::Project;
use crate::tools::{DraftFn, DraftJob, Tool};
use crate::view::canvas::Canvas;
use crate::view::mesh::{MeshCanvas, MeshGpu, ShownMesh};
use crate::view::timeline::Timeline;
use egui::Ui;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Kind of the questions about quick results.
pub(crate) const DRAFT: &str = "draft";

/// Time for which a quick result that comes first has the processor alone. One that takes longer is no longer quick: the whole
/// result, which shows its progress and can be stopped, is computed beside it.
pub(crate) const DRAFT_ALONE: Duration = Duration::from_millis(500);

/// A quick result of an edit, in place of the one that is not there yet.
#[derive(Debug, Clone)]
pub(crate) struct Draft {
    /// The edit that it is a result of.
    pub edit: Edit,
    /// The result.
    pub view: View,
    /// Left and top, width and height as shares of the result if it is a part of it.
    pub place: Option<[f64; 4]>,
    /// A sentence about it.
    pub note: String,
}

/// The clip of a document.
pub(crate) struct ClipDesk {
    pub reader: ClipReader,
    pub timeline: Timeline,
}

/// A document that is open.
pub(crate) struct Open {
    pub number: u64,
    pub name: String,
    pub kind: Kind,
    pub history: History,
    pub engine: Engine,
    pub assistant: Assistant,
    pub canvas: Canvas,
    pub mesh_canvas: Option<MeshCanvas>,
    pub clip: Option<ClipDesk>,
    pub selected: Option<EditId>,
    /// File of the project, once it is saved.
    pub saved: Option<PathBuf>,
    /// The document as it was saved last.
    pub saved_document: Option<Document>,
    pub output: PathBuf,
    /// Stops by which pictures are shown brighter.
    pub exposure: f32,
    /// The request that the engine was asked for last.
    asked: Option<Request>,
    /// The edit and input for which a quick result was asked last, and `true` if it was a coarse one.
    drafted: Option<(Edit, Arc<str>, bool)>,
    /// Time of that question.
    drafted_at: Instant,
    /// Left and top, columns and rows of the picture that were seen last.
    pub seen: [f64; 4],
    /// The canvas of quick results in the panel.
    pub beside: Canvas,
}

impl Open {
    pub fn new(
        number: u64,
        project: Project,
        saved: Option<PathBuf>,
        kind: Kind,
        repaint: &Arc<dyn Fn() + Send + Sync>,
        gpu: Option<&MeshGpu>,
    ) -> Self {
        let Project { document, output } = project;
        let name = document.source.file_name().unwrap_or_default();
        let (for_engine, for_assistant) = (repaint.clone(), repaint.clone());
        let clip = (kind == Kind::Clip).then(|| ClipDesk {
            reader: ClipReader::open(&document.source, repaint.clone()),
            timeline: Timeline::default(),
        });
        Self {
            number,
            name: name.to_string_lossy().into_owned(),
            kind,
            engine: Engine::new(move || for_engine()),
            assistant: Assistant::new(move || for_assistant()),
            canvas: Canvas::default(),
            mesh_canvas: (kind == Kind::Mesh)
                .then(|| MeshCanvas::new(repaint.clone(), gpu.cloned())),
            clip,
            selected: document.edits.last().map(|edit| edit.id),
            saved_document: saved.is_some().then(|| document.clone()),
            history: History::new(document),
            saved,
            output,
            exposure: 0.0,
            asked: None,
            drafted: None,
            drafted_at: Instant::now(),
            seen: [0.0; 4],
            beside: Canvas::default(),
        }
    }

    /// True while results are computed or read.
    pub fn is_busy(&self) -> bool {
        let reads = self.clip.as_ref().is_some_and(|clip| clip.reader.is_busy());
        let draws = self.mesh_canvas.as_ref().is_some_and(MeshCanvas::is_busy);
        self.engine.is_busy() || reads || draws || self.assistant.is_busy() || self.canvas.is_busy()
    }

    /// True if nothing is lost without a copy: the document is saved as it is, or has no edits.
    pub fn is_saved(&self) -> bool {
        let document = self.history.document();
        document.edits.is_empty() || self.saved_document.as_ref() == Some(document)
    }

    pub fn project(&self) -> Project {
        Project {
            document: self.history.document().clone(),
            output: self.output.clone(),
        }
    }

    /// The selected edit.
    pub fn selected_edit(&self) -> Option<Arc<Edit>> {
        self.selected
            .and_then(|id| self.history.document().edit(id).cloned())
    }

    /// Columns and rows of what is shown; zeros for a mesh; `None` until there is something.
    pub fn result_size(&self) -> Option<[usize; 2]> {
        let snapshot = self.engine.snapshot();
        snapshot.result.map(|result| match result.view {
            View::Picture(shown) => shown.size(),
            View::Mesh(_) => [0, 0],
        })
    }

    /// Takes a changed edit.
    pub fn change(&mut self, edit: Edit, gesture: &str, goes_on: bool) {
        let mut document = self.history.document().clone();
        document.replace(edit);
        self.history.change(gesture, document);
        if !goes_on {
            self.history.end_gesture();
        }
    }

    /// Asks the engine for what is to be seen: the whole document, or the input of the selected edit.
    pub fn ask(&mut self, on_input: bool) {
        let mut wanted = self.history.document().clone();
        if on_input && let Some(id) = self.selected {
            let end = wanted.edits.iter().position(|edit| edit.id == id);
            // the edit itself stays, switched off, so that its input is known
            let end = end.unwrap_or(wanted.edits.len());
            wanted.edits.truncate(end);
        }
        let frame = match &self.clip {
            None => None,
            Some(clip) => match clip.reader.frame() {
                Some((place, picture)) => Some(SourceFrame { place, picture }),
                // nothing to compute before the first frame
                None => return,
            },
        };
        if self.clip.is_some() && !self.history.in_gesture() {
            self.assistant.analyses.update(self.history.document());
        }
        let request = Request {
            document: wanted,
            frame,
            exposure: self.exposure,
            analyses: self.assistant.analyses.view(),
        };
        if self.asked.as_ref() != Some(&request) {
            self.engine.request(request.clone());
            self.asked = Some(request);
        }
    }

    /// Stops the engine while quick results of an edit take the place of its results.
    pub fn pause_engine(&mut self, edit: &Edit, snapshot: &Snapshot) {
        // without its input there would be nothing to make quick results of
        if snapshot.inputs.contains_key(&edit.id) && self.asked.take().is_some() {
            self.engine.cancel();
        }
    }

    /// Asks for a quick result of an edit, if it has changed; a `coarse` one while the hand moves.
    pub fn ask_draft(
        &mut self,
        edit: &Edit,
        draft: DraftFn,
        snapshot: &Snapshot,
        on_input: bool,
        coarse: bool,
    ) {
        let Some(input) = input_of(edit.id, snapshot, on_input) else {
            return;
        };
        let wanted = (edit.clone(), input.key.clone(), coarse);
        if self.drafted.as_ref() == Some(&wanted) {
            return;
        }
        self.drafted = Some(wanted);
        self.drafted_at = Instant::now();
        let [width, height] = input.content.size();
        // what is shown may have another scale than the input
        let [shown_width, shown_height] = snapshot.size().unwrap_or([width, height]);
        let across = width as f64 / shown_width.max(1) as f64;
        let down = height as f64 / shown_height.max(1) as f64;
        let [left, top, columns, rows] = self.seen;
        let job = DraftJob {
            edit: edit.clone(),
            input,
            painting: self.engine.painting(),
            coarse,
            seen: [across * left, down * top, across * columns, down * rows],
        };
        self.assistant.ask(DRAFT, move |memory, progress| {
            let found = draft(&job, memory, progress)?;
            Some(Draft {
                edit: job.edit,
                view: found.shape,
                place: found.place,
                note: found.note,
            })
        });
    }

    /// True while the quick result of an edit is being made, for at most [`DRAFT_ALONE`].
    pub fn is_drafting(&self, edit: &Edit) -> bool {
        let drafted = self.drafted.as_ref();
        drafted.is_some_and(|(drafted, ..)| drafted == edit)
            && self.drafted_at.elapsed() < DRAFT_ALONE
            && self.assistant.is_asked(DRAFT)
    }

    /// The quick result that stands for the result of an edit, which is not there yet.
    pub fn draft(&self, edit: &Edit) -> Option<Arc<Draft>> {
        let draft = self.assistant.answer::<Draft>(DRAFT)?;
        let moving = self.history.in_gesture() && draft.edit.id == edit.id;
        (moving || draft.edit == *edit).then_some(draft)
    }

    /// The list of edits; true if it was changed.
    pub fn list_ui(&mut self, ui: &mut Ui, tools: &[Box<dyn Tool>]) -> bool {
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
            let failed = failure
                .as_ref()
                .is_some_and(|failure| failure.edit == Some(edit.id));
            ui.horizontal(|ui| self.edit_ui(ui, tools, edit, failed, &mut changed));
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

    fn edit_ui(
        &mut self,
        ui: &mut Ui,
        tools: &[Box<dyn Tool>],
        edit: &Arc<Edit>,
        failed: bool,
        changed: &mut Document,
    ) {
        let label = label_of(tools, edit);
        let mut enabled = edit.enabled;
        let toggle = ui
            .checkbox(&mut enabled, "")
            .on_hover_text(format!("Use {label}"));
        toggle.widget_info(|| {
            let name = format!("Use {label}");
            egui::WidgetInfo::selected(egui::Role::CheckBox, true, enabled, name)
        });
        if toggle.changed() {
            changed.replace(Edit {
                enabled,
                ..Edit::clone(edit)
            });
        }
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
            button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
            if button.clicked() {
                changed.shift(edit.id, places);
            }
        }
        let name = format!("Remove {label}");
        let remove = ui.small_button("×").on_hover_text(&name);
        remove.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
        if remove.clicked() {
            changed.remove(edit.id);
        }
    }
}

/// The input of an edit: as it was for the last result, or the result itself where the input is shown.
pub(crate) fn input_of(id: EditId, snapshot: &Snapshot, on_input: bool) -> Option<EditInput> {
    if on_input && !snapshot.is_stale {
        let content = snapshot.result.as_ref()?.content.clone();
        return Some(EditInput {
            key: snapshot.key.clone(),
            content,
        });
    }
    snapshot.inputs.get(&id).cloned()
}

/// The name of the tool that makes such an edit.
pub(crate) fn label_of(tools: &[Box<dyn Tool>], edit: &Edit) -> String {
    let tool = tools.iter().find(|tool| tool.made(edit));
    tool.map_or_else(|| edit.operation.clone(), |tool| tool.label().to_owned())
}

/// The mesh of a view.
pub(crate) fn mesh_of(view: Option<&View>) -> Option<&Arc<ShownMesh>> {
    view.and_then(View::mesh)
}
