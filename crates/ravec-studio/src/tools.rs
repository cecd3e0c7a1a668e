//! Tools: edits that are made and changed by gestures on the canvas.
//!
//! A tool is one file with a type that implements [`Tool`], and a line in [`all`].

mod analysis;
mod brush;
mod complete;
mod marker;
mod matte;
mod mesh;
mod mosaic;
mod outline;
mod overlay;
mod parts;
mod plain;
mod planes;
mod plate;
mod quad;
mod rectify;
mod retarget;
mod shot;
mod small;
mod track;
mod trim;
mod twocolor;

use crate::assistant::{Assistant, Memory};
use crate::content::{Kind, View as Shape};
use crate::document::{Document, Edit};
use crate::engine::{EditInput, Snapshot};
use crate::painting::Painting;
use crate::shown::Shown;
use crate::view::canvas::View;
use crate::view::mesh::{MeshCanvas, ShownMesh};
use crate::view::timeline::{FrameState, TimelineRow};
use egui::{Painter, Response, Ui};
use ravec::progress::Progress;
use ravec::raster::{Rect, Size};
use serde_json::{Map, Value, json};
use std::sync::{Arc, Mutex};

/// State of the window for a tool for pictures, in one frame.
pub(crate) struct Hand<'a> {
    pub ui: &'a Ui,
    /// The canvas.
    pub response: &'a Response,
    pub painter: &'a Painter,
    pub view: View,
    /// The input of the edit.
    pub input: &'a EditInput,
    /// Columns and rows of the picture that the edit gets.
    pub input_size: [usize; 2],
    /// The results, of which the last good one is shown.
    pub snapshot: &'a Snapshot,
    /// The frame of a clip that is shown.
    pub frame: Option<u64>,
    /// The document that the edit belongs to.
    pub document: &'a Document,
    /// Answers questions beside the window.
    pub assistant: &'a Assistant,
    /// The picture that the brush paints.
    pub painting: &'a Arc<Mutex<Painting>>,
}

/// State of the window for a tool for meshes, in one frame.
pub(crate) struct MeshHand<'a> {
    pub ui: &'a Ui,
    /// The canvas as a widget.
    pub response: &'a Response,
    pub canvas: &'a mut MeshCanvas,
    /// The input of the edit, once it is known.
    pub input: Option<&'a EditInput>,
    /// The results, of which the last good one is shown.
    pub snapshot: &'a Snapshot,
    /// Answers questions beside the window.
    pub assistant: &'a Assistant,
}

/// A row below the timeline.
#[derive(Debug, Clone, Default)]
pub(crate) struct Row {
    pub label: String,
    pub states: Vec<FrameState>,
    pub values: Vec<Option<f32>>,
    pub marks: Vec<u64>,
}

impl Row {
    /// The row as the timeline takes it.
    pub fn as_row(&self) -> TimelineRow<'_> {
        TimelineRow {
            label: &self.label,
            states: &self.states,
            values: &self.values,
            marks: &self.marks,
        }
    }
}

impl Hand<'_> {
    /// The position in the picture where the primary button was pressed in this frame.
    pub fn pressed(&self) -> Option<[f64; 2]> {
        let started = self.response.drag_started_by(egui::PointerButton::Primary);
        let origin = started.then(|| self.ui.input(|input| input.pointer.press_origin()))?;
        origin.map(|at| self.view.to_picture(at))
    }

    /// The position in the picture where the primary button went down in this frame, before it is known whether the hand drags or
    /// clicks.
    pub fn touched(&self) -> Option<[f64; 2]> {
        let at = self.ui.input(|input| {
            let pointer = &input.pointer;
            let at = pointer.press_origin().or(pointer.interact_pos());
            at.filter(|_| pointer.primary_pressed())
        })?;
        self.response
            .contains_pointer()
            .then(|| self.view.to_picture(at))
    }

    /// `true` while the primary button is held that went down on the canvas.
    pub fn holds(&self) -> bool {
        let is_down = self.ui.input(|input| input.pointer.primary_down());
        is_down && self.response.is_pointer_button_down_on()
    }

    /// The positions of all motions of this frame in the picture, not only of the last: a fast stroke has corners otherwise.
    pub fn moves(&self) -> Vec<[f64; 2]> {
        self.ui.input(|input| {
            let moves = input.events.iter().filter_map(|event| match event {
                egui::Event::PointerMoved(at) => Some(self.view.to_picture(*at)),
                _ => None,
            });
            moves.collect()
        })
    }

    /// The position of a click of this frame in the picture.
    pub fn clicked(&self) -> Option<[f64; 2]> {
        let at = self.response.interact_pointer_pos();
        at.filter(|_| self.response.clicked())
            .map(|at| self.view.to_picture(at))
    }

    /// Turns of the wheel in this frame while a key is held that keeps it from zooming, up positive.
    pub fn wheel(&self) -> f32 {
        self.ui.input(|input| {
            let turned = input.events.iter().map(|event| match event {
                egui::Event::MouseWheel {
                    delta, modifiers, ..
                } if modifiers.shift || modifiers.alt => {
                    // a wheel with Shift turns sideways
                    (delta.y + delta.x).signum()
                }
                _ => 0.0,
            });
            turned.sum()
        })
    }

    /// True while the hand moves the canvas.
    pub fn pans(&self) -> bool {
        self.ui.input(|input| input.key_down(egui::Key::Space))
    }
}

/// An edit that a gesture has changed.
pub(crate) struct Gesture {
    pub edit: Edit,
    /// True until the button is released.
    pub goes_on: bool,
}

impl Gesture {
    /// A gesture that has ended.
    pub fn done(edit: Edit) -> Self {
        Self {
            edit,
            goes_on: false,
        }
    }
}

/// An edit whose result is wanted quickly.
pub(crate) struct DraftJob {
    pub edit: Edit,
    pub input: EditInput,
    pub painting: Arc<Mutex<Painting>>,
    /// `true` while the hand moves, for results beside the canvas: a finer one is asked for when it rests.
    pub coarse: bool,
    /// Left and top, columns and rows of the input that are seen.
    pub seen: [f64; 4],
}

/// A quick result.
pub(crate) struct DraftView {
    pub shape: Shape,
    /// Left and top, width and height as shares of the whole if it is a part.
    pub place: Option<[f64; 4]>,
    /// A sentence about it, for the panel.
    pub note: String,
}

impl DraftView {
    /// A quick result of a part of a picture of this size, which shows the same part of the result at any scale.
    pub fn part(shape: Shape, part: Rect, size: Size) -> Self {
        let (width, height) = (size.width() as f64, size.height() as f64);
        let share = |length: usize, whole: f64| length as f64 / whole;
        Self {
            place: Some([
                share(part.col, width),
                share(part.row, height),
                share(part.width, width),
                share(part.height, height),
            ]),
            ..Self::whole(shape)
        }
    }

    /// A quick result of the whole.
    pub fn whole(shape: Shape) -> Self {
        Self {
            shape,
            place: None,
            note: String::new(),
        }
    }
}

/// Computes a quick result.
pub(crate) type DraftFn = fn(&DraftJob, &mut Memory, &Progress) -> Option<DraftView>;

/// Gestures for an operation.
pub(crate) trait Tool {
    /// Name of the operation.
    fn operation(&self) -> &'static str;

    /// Name of the tool, in words.
    fn label(&self) -> &'static str;

    /// The gestures, in one line.
    fn hint(&self) -> &'static str {
        ""
    }

    /// Kinds of the documents that it works on.
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Picture]
    }

    /// Fields of a new edit for a picture of this size.
    fn start(&self, size: [usize; 2]) -> Map<String, Value>;

    /// Fields of a new edit for a picture of this size in a document, whose other edits it may name.
    fn start_in(&self, size: [usize; 2], _document: &Document) -> Map<String, Value> {
        self.start(size)
    }

    /// Analyses that a clip needs before such an edit. Those that a document lacks are added along with it.
    fn needs(&self) -> &'static [&'static str] {
        &[]
    }

    /// True if the fields of an edit of the operation are those of this tool.
    fn made(&self, edit: &Edit) -> bool {
        edit.operation == self.operation()
    }

    /// True if the hand works on the input of the edit, which is shown instead of the result.
    fn works_on_input(&self, _edit: &Edit) -> bool {
        false
    }

    /// Computes a quick result while the hand moves; without it the whole result is asked for at each motion.
    fn draft(&self) -> Option<DraftFn> {
        None
    }

    /// True if a quick result is shown first after every change, until the whole one is there.
    fn drafts_first(&self) -> bool {
        false
    }

    /// True if the quick result is shown in the panel, beside the input.
    fn shows_draft_beside(&self) -> bool {
        false
    }

    /// A picture over the canvas, and its place in pixels.
    fn overlay(&self, _assistant: &Assistant) -> Option<(Arc<Shown>, [f64; 4])> {
        None
    }

    /// Parameters that the hand sets, which the panel leaves out.
    fn hidden(&self) -> &'static [&'static str] {
        &[]
    }

    /// Draws the handles of an edit and follows the hand.
    fn canvas_ui(&mut self, _hand: &Hand<'_>, _edit: &Edit) -> Option<Gesture> {
        None
    }

    /// Draws the handles of an edit of a mesh and follows the hand.
    fn mesh_ui(&mut self, _hand: MeshHand<'_>, _edit: &Edit) -> Option<Gesture> {
        None
    }

    /// The mesh that is shown in place of the result, such as one with marks or colors.
    fn shown_mesh(
        &self,
        _assistant: &Assistant,
        _shown: Option<&Arc<ShownMesh>>,
    ) -> Option<Arc<ShownMesh>> {
        None
    }

    /// A picture of its own in the panel, beside the input.
    fn beside(&self, _assistant: &Assistant, _edit: &Edit) -> Option<Arc<Shown>> {
        None
    }

    /// Name of the picture in the panel.
    fn beside_name(&self) -> &'static str {
        "Rectified view"
    }

    /// The frame of a clip that the playhead is to move to.
    fn wanted_frame(&mut self, _assistant: &Assistant, _edit: &Edit) -> Option<u64> {
        None
    }

    /// The translucent mesh over the result, in place of the source.
    fn ghost(&self, _assistant: &Assistant, _edit: &Edit) -> Option<Arc<ShownMesh>> {
        None
    }

    /// Rows below the timeline of a clip.
    fn rows(&self, _assistant: &Assistant, _edit: &Edit) -> Vec<Row> {
        Vec::new()
    }

    /// Draws controls of its own above the settings.
    fn panel_ui(&mut self, _ui: &mut Ui, _desk: &Desk<'_>, _edit: &Edit) -> Option<Gesture> {
        None
    }
}

/// State of the window for the panel of a tool.
pub(crate) struct Desk<'a> {
    /// The input of the edit, once it is known.
    pub input: Option<&'a EditInput>,
    /// The frames between the in and the out point of a clip, if they are set.
    pub range: Option<std::ops::Range<u64>>,
    /// The sentence about the quick result.
    pub note: Option<&'a str>,
    /// The document that the edit belongs to.
    pub document: &'a Document,
    /// The results.
    pub snapshot: &'a Snapshot,
    /// Answers questions beside the window.
    pub assistant: &'a Assistant,
}

pub(crate) use track::measure_key;

/// All tools.
pub(crate) fn all() -> Vec<Box<dyn Tool>> {
    vec![
        Box::new(twocolor::TwoColor::default()),
        Box::new(brush::Brush::default()),
        Box::new(plain::Plain {
            operation: "brush",
            label: "Filter",
            kinds: &[Kind::Picture, Kind::Clip],
            fields: || {
                let mut fields = with_params(json!({"mode": "clean"}));
                fields.insert("everywhere".to_owned(), true.into());
                fields
            },
        }),
        Box::new(retarget::Retarget::default()),
        Box::new(rectify::Rectify::default()),
        Box::new(complete::Complete::default()),
        Box::new(track::Track::default()),
        Box::new(plate::Plate::default()),
        Box::new(matte::Matte::default()),
        Box::new(shot::ShotTool::REMOVE),
        Box::new(shot::ShotTool::REPLACE),
        Box::new(shot::ShotTool::ENHANCE),
        Box::new(shot::ShotTool::PASTE),
        Box::new(overlay::Overlay::default()),
        Box::new(trim::Trim),
        Box::new(mosaic::Mosaic::default()),
        Box::new(mesh::MeshTool {
            draft: Some(mesh::draft_of_offset),
            ..mesh::MeshTool::new(
                "offset",
                "Offset",
                "Set the distance, such as 0.5, 2% or 2mm",
                || with_params(json!({"distance": "2%"})),
            )
        }),
        Box::new(mesh::MeshTool::new(
            "mesh simplify",
            "Simplify",
            "Set the number of triangles or the largest error",
            || with_params(json!({"error": "0.1%"})),
        )),
        Box::new(parts::Parts::default()),
        Box::new(mesh::MeshTool {
            made: is_repair,
            ..mesh::MeshTool::new(
                "boolean",
                "Repair to a solid",
                "Makes one closed surface of overlapping parts",
                || {
                    let mut fields = with_params(json!({}));
                    fields.insert("expression".to_owned(), "a".into());
                    fields
                },
            )
        }),
    ]
}

/// True for a Boolean of the document's mesh alone.
fn is_repair(edit: &Edit) -> bool {
    !edit.fields.contains_key("files")
}

/// A button that makes the range of the timeline the frames of an edit.
pub(crate) fn range_ui(ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
    let button = egui::Button::new("Take the range of the timeline");
    let button = ui.add_enabled(desk.range.is_some(), button);
    let range = desk.range.as_ref().filter(|_| button.clicked())?;
    let text = format!("{}..{}", range.start, range.end);
    Some(Gesture::done(edit.with_param("frames", text.into())))
}

/// Fields of an edit with these parameters.
pub(crate) fn with_params(params: Value) -> Map<String, Value> {
    let mut fields = Map::new();
    fields.insert("params".to_owned(), params);
    fields
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;
    use crate::settings::{Kind as SettingKind, form, to_json};
    use std::path::Path;

    /// Settings that are shown have their place in the operation, whatever group they belong to.
    #[test]
    fn every_setting_of_every_tool_is_a_parameter_of_its_operation() {
        let mut count = 0;
        for tool in all() {
            let mut document = Document::new("input");
            let id = document.push(tool.operation(), tool.start([640, 480]));
            let edit = document.edit(id).unwrap();
            let settings = form(tool.operation()).unwrap().settings;
            let shown = settings
                .iter()
                .filter(|setting| !tool.hidden().contains(&setting.name.as_str()));
            for setting in shown {
                count += 1;
                let text = match &setting.kind {
                    SettingKind::Switch => "true",
                    SettingKind::Choice(values) => &values[0].name,
                    _ if setting.default.is_empty() => "1",
                    _ => &setting.default,
                };
                let value = to_json(&setting.kind, text);
                let changed = edit.with_param(&setting.name, value);
                assert_ne!(changed.param(&setting.name), &Value::Null);
                if let Err(reason) = changed.step(Path::new("@1"), Path::new("@2")) {
                    let name = &setting.name;
                    assert!(
                        !reason.contains("unknown field"),
                        "{}, {name}: {reason}",
                        tool.label()
                    );
                }
            }
        }
        assert!(count > 50);
    }
}
