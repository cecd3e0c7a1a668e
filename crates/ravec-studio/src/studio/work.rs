//! The middle of the window: canvases, and the tools on them.

use super::Studio;
use crate::document::{Document, Edit};
use crate::engine::Snapshot;
use crate::open::{DRAFT_ALONE, Draft, Open, input_of, label_of, mesh_of};
use crate::shown::Shown;
use crate::tools::{Gesture, Hand, MeshHand, Row, Tool};
use crate::view::canvas::{Comparison, Layers};
use crate::view::mesh::{AtRest, ShownMesh};
use crate::view::timeline::FrameState;
use egui::{Key, Ui};
use ravec_jobs::video::FrameRange;
use std::sync::Arc;

/// The selected edit with its tool, and the state of its results in this frame.
struct Scene<'a> {
    edit: Option<Arc<Edit>>,
    tool: Option<&'a mut Box<dyn Tool>>,
    /// True if the input of the edit is shown instead of the result.
    on_input: bool,
    snapshot: Snapshot,
    /// The quick result that takes the place of the one that is not there yet.
    draft: Option<Arc<Draft>>,
}

impl Studio {
    /// The canvas of the document in front.
    pub(super) fn canvas_ui(&mut self, ui: &mut Ui) {
        let Some(open) = self.open.get_mut(self.active) else {
            let mut example = false;
            ui.vertical_centered(|ui| {
                ui.add_space(0.4 * ui.available_height());
                ui.label("Open a picture, a mesh, a clip or a project, or drop one here.");
                example = ui
                    .button("Open the example")
                    .on_hover_text("A drawn shot: a person is put before another street")
                    .clicked();
            });
            if example {
                self.open_example();
            }
            return;
        };
        let mut scene = scene(open, &mut self.tools);
        if (scene.edit.as_ref()).is_some_and(|edit| open.is_drafting(edit)) {
            ui.ctx().request_repaint_after(DRAFT_ALONE);
        }
        let gesture = if open.mesh_canvas.is_some() {
            mesh_canvas_ui(ui, open, &mut scene)
        } else {
            picture_canvas_ui(ui, open, &mut scene)
        };
        let Some(gesture) = gesture else {
            return;
        };
        if let Some(draft) = scene.tool.and_then(|tool| tool.draft())
            && !scene.on_input
        {
            open.ask_draft(&gesture.edit, draft, &scene.snapshot, false, false);
        }
        let name = format!("{} canvas", gesture.edit.id);
        open.change(gesture.edit, &name, gesture.goes_on);
        if !gesture.goes_on {
            self.autosave();
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
            .and_then(|edit| self.tools.iter_mut().find(|tool| tool.made(edit)));
        let (rows, wanted) = match (tool, &edit) {
            (Some(tool), Some(edit)) => (
                tool.rows(&open.assistant, edit),
                tool.wanted_frame(&open.assistant, edit),
            ),
            _ => (Vec::new(), None),
        };
        let frames = open.clip.as_ref().and_then(|clip| clip.reader.info());
        let frames = frames.map_or(0, |facts| facts.frames);
        let layers = layers(open.history.document(), &self.tools, frames);
        let rows: Vec<_> = (rows.iter().chain(&layers))
            .map(crate::tools::Row::as_row)
            .collect();
        if let Some(clip) = &mut open.clip {
            if let Some(wanted) = wanted {
                clip.timeline.current = wanted;
            }
            clip.timeline.ui(ui, &clip.reader, &rows);
        }
    }
}

/// Maximum number of frames of a clip whose layers are drawn over the timeline.
const MAX_LAYER_FRAMES: u64 = 20_000;

/// Rows of the timeline for the layers of a shot, the upper ones first: the frames in which they are seen.
fn layers(document: &Document, tools: &[Box<dyn Tool>], frames: u64) -> Vec<Row> {
    let edits = document.enabled();
    let layers = edits.filter(|edit| edit.operation.starts_with("video ") && !edit.is_conversion());
    let mut rows: Vec<Row> = layers
        .map(|edit| {
            let range = edit.param("frames").as_str().unwrap_or_default();
            let range = range.parse::<FrameRange>().unwrap_or_default();
            let state = |frame| match range.contains(frame) {
                Some(false) => FrameState::Unknown,
                _ => FrameState::Good,
            };
            Row {
                label: label_of(tools, edit),
                states: (0..frames.min(MAX_LAYER_FRAMES)).map(state).collect(),
                ..Row::default()
            }
        })
        .collect();
    rows.reverse();
    rows
}

/// Asks for the results that this frame shows, whole or quick.
fn scene<'a>(open: &mut Open, tools: &'a mut [Box<dyn Tool>]) -> Scene<'a> {
    let edit = open.selected_edit();
    let tool = edit.as_ref().and_then(|edit| {
        let tool = tools.iter_mut().find(|tool| tool.made(edit));
        tool.filter(|_| edit.enabled)
    });
    let on_input = match (&edit, &tool) {
        (Some(edit), Some(tool)) => tool.works_on_input(edit),
        _ => false,
    };
    let drafts = tool.as_ref().and_then(|tool| tool.draft());
    let moving = open.history.in_gesture();
    let beside = tool.as_ref().is_some_and(|tool| tool.shows_draft_beside());
    let first = tool.as_ref().is_some_and(|tool| tool.drafts_first()) && !on_input;
    let takes_place = |open: &Open| {
        // while the hand moves, a quick result takes the place of the whole one; one that comes first has the processor alone
        let drafting = |edit: &Arc<Edit>| moving || (first && open.is_drafting(edit));
        drafts.is_some() && !on_input && edit.as_ref().is_some_and(drafting)
    };
    if !takes_place(open) {
        open.ask(on_input);
    }
    let snapshot = open.engine.snapshot();
    if let (Some(edit), Some(draft)) = (&edit, drafts)
        && (beside || moving || (first && snapshot.is_stale))
    {
        open.ask_draft(edit, draft, &snapshot, on_input, beside && moving);
    }
    if let Some(edit) = &edit
        && takes_place(open)
    {
        open.pause_engine(edit, &snapshot);
    }
    let draft = edit.as_ref().and_then(|edit| open.draft(edit));
    let stands = !beside && !on_input && (moving || snapshot.is_stale);
    Scene {
        edit,
        tool,
        on_input,
        snapshot,
        draft: draft.filter(|_| stands),
    }
}

/// The canvas of a mesh; what the tool has changed.
fn mesh_canvas_ui(ui: &mut Ui, open: &mut Open, scene: &mut Scene<'_>) -> Option<Gesture> {
    let snapshot = &scene.snapshot;
    let result = snapshot.result.as_ref().map(|result| &result.view);
    let shown = scene.draft.as_ref().map(|draft| &draft.view).or(result);
    let mut shown = mesh_of(shown).cloned();
    let changed = open.history.document().links().next().is_some();
    let ghost = mesh_of(snapshot.before.as_ref()).cloned();
    let ghost = ghost.filter(|_| changed && scene.tool.is_some());
    let marked = scene
        .tool
        .as_ref()
        .and_then(|tool| tool.shown_mesh(&open.assistant, shown.as_ref()));
    shown = marked.or(shown);
    let own = match (&scene.edit, &scene.tool) {
        (Some(edit), Some(tool)) => tool.ghost(&open.assistant, edit),
        _ => None,
    };
    let ghost = own.or(ghost);
    // a mesh has no ghost of itself
    let is_itself = |ghost: &Arc<ShownMesh>| {
        let shown = shown.as_ref();
        shown.is_some_and(|shown| Arc::ptr_eq(&shown.mesh, &ghost.mesh))
    };
    let ghost = ghost.filter(|ghost| !is_itself(ghost));
    // what is about to be replaced needs no fine picture
    let at_rest = match &scene.edit {
        Some(edit) if open.is_drafting(edit) => AtRest::Drafts,
        _ => AtRest::Fine,
    };
    let canvas = open.mesh_canvas.as_mut()?;
    canvas.set_at_rest(at_rest);
    let response = canvas.ui(ui, shown.as_ref(), ghost.as_ref());
    // a tool locks it anew while the hand is on one of its handles
    canvas.lock_orbit(false);
    let (Some(edit), Some(tool)) = (&scene.edit, &mut scene.tool) else {
        return None;
    };
    let input = input_of(edit.id, snapshot, scene.on_input);
    let hand = MeshHand {
        ui,
        response: &response,
        canvas,
        input: input.as_ref(),
        snapshot,
        assistant: &open.assistant,
    };
    tool.mesh_ui(hand, edit)
}

/// The picture that a canvas shows, and a part of it that is drawn over.
#[derive(Default)]
struct Pictures {
    shown: Option<Arc<Shown>>,
    patch: Option<(Arc<Shown>, [f64; 4])>,
    /// The frame of a clip that it is.
    frame: Option<u64>,
}

/// The last good picture or what takes its place: a frame that is played, or a quick result.
fn pictures(open: &Open, scene: &Scene<'_>) -> Pictures {
    let tool = scene.tool.as_ref();
    let mut pictures = Pictures {
        shown: scene.snapshot.shown().cloned(),
        patch: tool.and_then(|tool| tool.overlay(&open.assistant)),
        frame: scene.snapshot.frame,
    };
    let keeps_pixels = open
        .history
        .document()
        .links()
        .all(|edit| edit.keeps_pixels());
    let plain = keeps_pixels && open.exposure == 0.0;
    let played = open.clip.as_ref().and_then(|clip| clip.reader.visible());
    if plain && let Some((number, frame)) = played {
        pictures.frame = Some(number);
        pictures.shown = Some(frame);
    }
    if let Some(draft) = &scene.draft
        && let Some(picture) = draft.view.picture()
    {
        match draft.place {
            None => pictures.shown = Some(picture.clone()),
            Some([left, top, width, height]) => {
                // the picture below may have another scale than the result to come
                let below = pictures.shown.as_ref().map_or([0, 0], |shown| shown.size());
                let [columns, rows] = below.map(|side| side as f64);
                let place = [columns * left, rows * top, columns * width, rows * height];
                pictures.patch = Some((picture.clone(), place));
            }
        }
    }
    pictures
}

/// The canvas of a picture or of a frame; what the tool has changed.
fn picture_canvas_ui(ui: &mut Ui, open: &mut Open, scene: &mut Scene<'_>) -> Option<Gesture> {
    let typing = ui.ctx().egui_wants_keyboard_input();
    let before = scene.snapshot.before.as_ref();
    let before = before.and_then(|view| view.picture()).cloned();
    if !typing && ui.input(|input| input.key_down(Key::B)) && before.is_some() {
        let layers = Layers {
            shown: before.as_ref(),
            ..Layers::default()
        };
        open.canvas.ui(ui, &layers);
        return None;
    }
    let pictures = pictures(open, scene);
    let compares = open.canvas.comparison != Comparison::Off;
    let layers = Layers {
        shown: pictures.shown.as_ref(),
        patch: pictures
            .patch
            .as_ref()
            .map(|(shown, place)| (shown, *place)),
        before: before.as_ref().filter(|_| compares),
    };
    let response = open.canvas.ui(ui, &layers);
    let view = open.canvas.view()?;
    let [left, top] = view.to_picture(response.rect.min);
    let [right, bottom] = view.to_picture(response.rect.max);
    open.seen = [left, top, right - left, bottom - top];
    let edit = scene.edit.as_ref()?;
    let tool = scene.tool.as_mut()?;
    if open.canvas.is_held() {
        return None;
    }
    let input = input_of(edit.id, &scene.snapshot, scene.on_input)?;
    let painter = ui.painter_at(response.rect);
    let painting = open.engine.painting();
    let hand = Hand {
        ui,
        response: &response,
        painter: &painter,
        view,
        input_size: input.content.size(),
        input: &input,
        snapshot: &scene.snapshot,
        frame: pictures.frame,
        document: open.history.document(),
        assistant: &open.assistant,
        painting: &painting,
    };
    tool.canvas_ui(&hand, edit)
}
