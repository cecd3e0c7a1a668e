//! Booleans of several meshes: parts in an expression, each moved and turned by a handle or by numbers.
//!
//! The mesh of the document is the part `a`, files that are added are `b`, `c` and so on. All parts are drawn as a ghost at their
//! places, at once while the hand moves; the result follows.

mod handle;
mod scene;

use super::mesh::MeshTool;
use super::{Desk, Gesture, MeshHand, Tool, with_params};
use crate::assistant::Assistant;
use crate::content::Kind;
use crate::document::{Edit, EditId, INPUT_NAME};
use crate::view::mesh::ShownMesh;
use crate::view::panel::text_ui;
use egui::{
    Color32, DragValue, Key, Painter, PointerButton, Pos2, Rect, Sense, Stroke, TextEdit, Ui, Vec2,
};
use handle::{Grip, Handle};
use ravec::boolean::Expr;
use ravec_jobs::mesh::NamedFile;
use ravec_jobs::mesh::boolean::{Placement, names};
use scene::{Ghost, Library, NamedPart, Scene, SceneJob, hit, placement_of};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Kind of the questions about the meshes of an edit.
const SCENE: &str = "parts";
/// Kind of the questions about what is drawn of all parts.
const GHOST: &str = "parts ghost";
/// Kind of the questions about the part below a click.
const HIT: &str = "parts hit";

/// The color of the selected part.
const SELECTED: Color32 = Color32::from_rgb(250, 150, 30);

/// Side of the places with names on the canvas, in screen points.
const NAMED_SIDE: f32 = 12.0;

/// Operators for all parts, with their names.
const OPERATORS: [(&str, &str, &str); 4] = [
    ("Union", " | ", "All places in any part"),
    ("Difference", " - ", "The places of a in no other part"),
    ("Intersection", " & ", "The places in all parts"),
    (
        "Symmetric difference",
        " ^ ",
        "The places in an odd number of parts",
    ),
];

/// The selected part in the hand.
struct Held {
    edit: EditId,
    grip: Grip,
    handle: Handle,
    from: Pos2,
    start: Placement,
}

/// An answer to a click: its number, and the part below it.
struct Hit(u64, Option<String>);

/// The tool for Booleans of several meshes.
pub(crate) struct Parts {
    /// Verdict, defects and figures of the result.
    result: MeshTool,
    selected: String,
    held: Option<Held>,
    /// The scene and the places that were asked for last.
    asked: Option<SceneJob>,
    drawn: Option<(Arc<Scene>, Vec<Placement>)>,
    /// Number of the last click, while its answer is awaited.
    clicked: Option<u64>,
    clicks: u64,
    /// The path that is typed, while a mesh is being added.
    adding: Option<String>,
}

impl Default for Parts {
    fn default() -> Self {
        Self {
            result: MeshTool::new("boolean", "Boolean", "", Map::new),
            selected: INPUT_NAME.to_owned(),
            held: None,
            asked: None,
            drawn: None,
            clicked: None,
            clicks: 0,
            adding: None,
        }
    }
}

/// The files of an edit, without its input.
fn files(edit: &Edit) -> Vec<NamedFile> {
    let files = edit.fields.get("files").and_then(Value::as_array);
    let texts = files.into_iter().flatten().filter_map(Value::as_str);
    texts.map(|text| text.to_owned().into()).collect()
}

/// The names of all parts with their files; that of the input has none.
fn parts(edit: &Edit) -> Vec<(String, Option<PathBuf>)> {
    let own = NamedFile {
        name: Some(INPUT_NAME.to_owned()),
        path: PathBuf::new(),
    };
    let mut all = vec![own];
    all.extend(files(edit));
    // two of one name: the operation says so
    let names = names(&all).unwrap_or_default();
    let paths = all.into_iter().map(|file| file.path);
    let paths = paths.map(|path| (!path.as_os_str().is_empty()).then_some(path));
    names.into_iter().zip(paths).collect()
}

/// The expression of an edit.
fn expression(edit: &Edit) -> &str {
    edit.fields
        .get("expression")
        .and_then(Value::as_str)
        .unwrap_or_default()
}

fn with_expression(edit: &Edit, expression: &str) -> Edit {
    let mut edit = edit.clone();
    edit.fields
        .insert("expression".to_owned(), expression.into());
    edit
}

/// The operator that an expression has between all parts in turn, if it is as plain as that.
fn operator(expression: &str, names: &[String]) -> Option<&'static str> {
    let plain: String = expression.split_whitespace().collect();
    let mut operators = OPERATORS.iter().map(|(_, operator, _)| *operator);
    operators.find(|operator| names.join(operator.trim()) == plain)
}

/// The names of the parts that an expression uses; all if it makes no sense.
fn used(expression: &str, names: &[String]) -> Vec<String> {
    match Expr::parse_with(expression, names) {
        Ok(parsed) => parsed.meshes().iter().map(|&k| names[k].clone()).collect(),
        Err(_) => names.to_vec(),
    }
}

/// The places of the parts of an edit; those that make no sense are left out.
fn placements(edit: &Edit) -> Vec<Placement> {
    let places = edit.param("places").as_array();
    let texts = places.into_iter().flatten().filter_map(Value::as_str);
    texts.filter_map(|text| text.parse().ok()).collect()
}

/// The same edit with another place of a part.
fn with_placement(edit: &Edit, placement: &Placement) -> Edit {
    let mut all = placements(edit);
    match all.iter_mut().find(|other| other.name == placement.name) {
        Some(place) => *place = placement.clone(),
        None => all.push(placement.clone()),
    }
    with_placements(edit, all)
}

fn with_placements(edit: &Edit, mut all: Vec<Placement>) -> Edit {
    all.retain(|placement| !placement.is_identity());
    let texts = all.iter().map(|placement| placement.to_string().into());
    let texts: Vec<Value> = texts.collect();
    let value = if texts.is_empty() {
        Value::Null
    } else {
        texts.into()
    };
    edit.with_param("places", value)
}

/// The same edit with one more part, and its name. A plain expression takes it in.
fn with_part(edit: &Edit, path: &Path) -> (Edit, String) {
    let known: Vec<String> = parts(edit).into_iter().map(|(name, _)| name).collect();
    let letters = ('b'..='z').map(String::from);
    let numbers = (1..).map(|number| format!("part{number}"));
    let name = letters
        .chain(numbers)
        .find(|name| !known.contains(name))
        .expect("there are infinitely many");
    let mut files = files(edit);
    files.push(NamedFile {
        name: Some(name.clone()),
        path: path.to_path_buf(),
    });
    let joined = operator(expression(edit), &known)
        .map(|operator| format!("{}{operator}{name}", known.join(operator)));
    let edit = with_files(edit, files);
    let edit = joined.map_or(edit.clone(), |joined| with_expression(&edit, &joined));
    (edit, name)
}

/// The same edit without a part. A plain expression leaves it out.
fn without_part(edit: &Edit, index: usize) -> Edit {
    let mut known: Vec<String> = parts(edit).into_iter().map(|(name, _)| name).collect();
    let plain = operator(expression(edit), &known);
    let name = known.remove(index);
    let mut files = files(edit);
    files.remove(index - 1);
    // the others keep the names that they have without it
    for (file, name) in files.iter_mut().zip(&known[1..]) {
        file.name = Some(name.clone());
    }
    let mut all = placements(edit);
    all.retain(|placement| placement.name != name);
    let edit = with_placements(&with_files(edit, files), all);
    plain.map_or(edit.clone(), |operator| {
        with_expression(&edit, &known.join(operator))
    })
}

fn with_files(edit: &Edit, files: Vec<NamedFile>) -> Edit {
    let mut edit = edit.clone();
    let texts = files.into_iter().map(String::from).map(Value::from);
    edit.fields.insert("files".to_owned(), texts.collect());
    edit
}

impl Parts {
    /// The selected part; the last one if it is no part of this edit, such as one that is added in this frame.
    fn selected(&self, edit: &Edit) -> String {
        let parts = parts(edit);
        let is_there = parts.iter().any(|(name, _)| *name == self.selected);
        match parts.last() {
            Some((last, _)) if !is_there => last.clone(),
            _ => self.selected.clone(),
        }
    }

    /// Asks for the meshes of an edit.
    fn ask_scene(&mut self, hand: &MeshHand<'_>, edit: &Edit) {
        let parts = parts(edit);
        let names: Vec<String> = parts.iter().map(|(name, _)| name.clone()).collect();
        let unit = edit.param("unit").clone();
        let job = SceneJob {
            edit: edit.id,
            input: (
                INPUT_NAME.to_owned(),
                hand.input
                    .map_or_else(|| "".into(), |input| input.key.clone()),
            ),
            used: used(expression(edit), &names),
            files: parts
                .into_iter()
                .filter_map(|(name, path)| Some((name, path?)))
                .collect(),
            unit: serde_json::from_value(unit).unwrap_or_default(),
        };
        let known = hand.assistant.answer::<Scene>(SCENE);
        let coming = self.asked.as_ref() == Some(&job) && hand.assistant.is_asked(SCENE);
        if coming || known.is_some_and(|scene| scene.job == job) {
            return;
        }
        self.asked = Some(job.clone());
        let input = hand.input.map(|input| input.content.clone());
        hand.assistant.ask(SCENE, move |memory, progress| {
            let library = memory
                .keep(SCENE, &"".into(), || Ok::<_, ()>(Library::default()))
                .ok()?;
            library.scene(&job, input.as_ref(), progress)
        });
    }

    /// Asks for what is drawn of the parts at their places.
    fn ask_ghost(&mut self, assistant: &Assistant, scene: &Arc<Scene>, placements: &[Placement]) {
        let known = self
            .drawn
            .as_ref()
            .is_some_and(|(known, places)| Arc::ptr_eq(known, scene) && places == placements);
        if known {
            return;
        }
        self.drawn = Some((scene.clone(), placements.to_vec()));
        let (scene, placements) = (scene.clone(), placements.to_vec());
        assistant.ask(GHOST, move |_, _| Ghost::new(&scene, &placements));
    }

    /// Selects the part below a click, once it is known.
    fn select_below(&mut self, hand: &MeshHand<'_>, scene: &Arc<Scene>, placements: &[Placement]) {
        if let Some(number) = self.clicked
            && let Some(answer) = hand.assistant.answer::<Hit>(HIT)
            && answer.0 == number
        {
            self.clicked = None;
            if let Some(name) = &answer.1 {
                self.selected.clone_from(name);
            }
        }
        let at = hand.response.interact_pointer_pos();
        let at = at.filter(|_| hand.response.clicked() && !hand.canvas.options().measure);
        if let Some(at) = at
            && let Some(view) = hand.canvas.view()
        {
            self.clicks += 1;
            self.clicked = Some(self.clicks);
            let (number, sight) = (self.clicks, view.sight(at));
            let (scene, placements) = (scene.clone(), placements.to_vec());
            hand.assistant.ask(HIT, move |_, _| {
                Some(Hit(number, hit(&scene, &placements, sight)))
            });
        }
    }

    /// Follows the hand on the handle of a part.
    fn follow(
        &mut self,
        hand: &MeshHand<'_>,
        edit: &Edit,
        handle: &Handle,
        placement: &Placement,
    ) -> Option<Gesture> {
        let response = hand.response;
        let (origin, pans, coarse) = hand.ui.input(|input| {
            let pans = input.modifiers.shift || input.key_down(Key::Space);
            let origin = input.pointer.press_origin();
            (origin, pans, input.modifiers.command)
        });
        if response.drag_started_by(PointerButton::Primary)
            && !pans
            && let Some(from) = origin
            && let Some(grip) = handle.grip(from)
        {
            self.held = Some(Held {
                edit: edit.id,
                grip,
                handle: handle.clone(),
                from,
                start: placement.clone(),
            });
        }
        let held = self.held.as_ref()?;
        let goes_on = response.dragged_by(PointerButton::Primary);
        let at = response.interact_pointer_pos();
        let moved = at.filter(|_| held.edit == edit.id).and_then(|at| {
            let way = [held.from, at];
            held.handle.dragged(held.grip, &held.start, way, coarse)
        });
        if !goes_on {
            self.held = None;
        }
        moved.map(|placement| Gesture {
            edit: with_placement(edit, &placement),
            goes_on,
        })
    }

    /// The list of parts; a change.
    fn list_ui(&mut self, ui: &mut Ui, edit: &Edit, scene: Option<&Scene>) -> Option<Gesture> {
        let mut gesture = None;
        let selected = self.selected(edit);
        for (index, (name, path)) in parts(edit).into_iter().enumerate() {
            let file = path.as_deref().and_then(Path::file_name);
            let file = file.map_or_else(|| "this mesh".into(), |file| file.to_string_lossy());
            ui.horizontal(|ui| {
                let label = ui.selectable_label(name == selected, format!("{name}: {file}"));
                if label.clicked() {
                    self.selected.clone_from(&name);
                }
                let Some(path) = &path else {
                    return;
                };
                label.on_hover_text(path.display().to_string());
                let text = format!("Remove part {name}");
                let remove = ui.small_button("×").on_hover_text(&text);
                remove.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &text));
                if remove.clicked() {
                    gesture = Some(Gesture::done(without_part(edit, index)));
                }
            });
            let found = scene.and_then(|scene| scene.parts.iter().find(|part| part.name == name));
            if let Some(Err(reason)) = found.map(|part| &part.part) {
                ui.colored_label(ui.visuals().error_fg_color, reason);
            }
        }
        if ui
            .button("Add a mesh…")
            .on_hover_text("A file as one more part")
            .clicked()
        {
            self.adding = Some(String::new());
        }
        self.adding_ui(ui, edit).or(gesture)
    }

    /// Asks for the file of a new part.
    fn adding_ui(&mut self, ui: &Ui, edit: &Edit) -> Option<Gesture> {
        let path = self.adding.as_mut()?;
        let mut decided = None;
        egui::Modal::new(egui::Id::unique("part")).show(ui.ctx(), |ui| {
            ui.heading("Add a mesh");
            let label = ui.label("File");
            let field = ui
                .add(TextEdit::singleline(path).desired_width(420.0))
                .labelled_by(label.id);
            if !field.has_focus() && !field.lost_focus() {
                field.request_focus();
            }
            let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
            ui.horizontal(|ui| {
                let button = ui.button("Add");
                let name = "Add a mesh: Add";
                button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, name));
                if button.clicked() || entered {
                    decided = Some(true);
                }
                if ui.button("Cancel").clicked() || ui.input(|input| input.key_pressed(Key::Escape))
                {
                    decided = Some(false);
                }
            });
        });
        let added = decided?;
        let typed = self.adding.take()?;
        let path = Path::new(typed.trim());
        if !added || path.as_os_str().is_empty() {
            return None;
        }
        // what is no mesh is refused by the operation
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
        let (edit, name) = with_part(edit, &path);
        self.selected = name;
        Some(Gesture::done(edit))
    }

    /// The expression, and buttons for those that are common; a change.
    fn expression_ui(ui: &mut Ui, edit: &Edit) -> Option<Gesture> {
        let mut gesture = None;
        let present = expression(edit);
        ui.horizontal(|ui| {
            let label = ui.label("Expression").on_hover_text(
                "| is union, & intersection, - difference, ^ symmetric difference; & comes before the others",
            );
            if let Some(typed) = text_ui(ui, "expression", present, label.id) {
                gesture = Some(Gesture::done(with_expression(edit, typed.trim())));
            }
        });
        let names: Vec<String> = parts(edit).into_iter().map(|(name, _)| name).collect();
        ui.horizontal_wrapped(|ui| {
            for (label, operator, help) in OPERATORS {
                if ui.button(label).on_hover_text(help).clicked() {
                    gesture = Some(Gesture::done(with_expression(edit, &names.join(operator))));
                }
            }
        });
        gesture
    }

    /// The numbers of the selected part; a change.
    fn numbers_ui(&mut self, ui: &mut Ui, edit: &Edit, scene: Option<&Scene>) -> Option<Gesture> {
        let name = self.selected(edit);
        let mut placement = placement_of(&placements(edit), &name);
        let before = placement.clone();
        let part = scene.and_then(|scene| scene.parts.iter().find(|part| part.name == name));
        let diagonal = part.map_or(1.0, NamedPart::diagonal);
        let mut goes_on = false;
        let mut number = |ui: &mut Ui, label: &str, help: &str, value: DragValue<'_>| {
            ui.horizontal(|ui| {
                let label = ui.label(label).on_hover_text(help);
                let field = ui.add(value.update_while_editing(false));
                goes_on |= field.labelled_by(label.id).dragged();
            });
        };
        let speed = if diagonal > 0.0 {
            0.005 * diagonal
        } else {
            0.01
        };
        let names = ["x", "y", "z"];
        for (axis, value) in placement.shift.iter_mut().enumerate() {
            let label = format!("Move {}", names[axis]);
            let value = DragValue::new(value).speed(speed).max_decimals(6);
            number(ui, &label, "In units of the file of the first mesh", value);
        }
        for (axis, value) in placement.turn_deg.iter_mut().enumerate() {
            let label = format!("Turn {}", names[axis]);
            let value = DragValue::new(value).speed(0.5).max_decimals(4).suffix("°");
            let help = "In degrees, about the middle of the part: first about x, then y, then z";
            number(ui, &label, help, value);
        }
        let value = DragValue::new(&mut placement.scale)
            .speed(0.005)
            .range(1e-6..=1e6)
            // what a project says stays until it is changed by hand
            .clamp_existing_to_range(false)
            .max_decimals(6);
        number(ui, "Scale", "About the middle of the part", value);
        if !before.is_identity() && ui.button("Back to its place in the file").clicked() {
            placement = Placement::new(name);
        }
        let finite = placement.shift.iter().chain(&placement.turn_deg);
        let finite = finite.chain([&placement.scale]).all(|n| n.is_finite());
        (finite && placement != before).then(|| Gesture {
            edit: with_placement(edit, &placement),
            goes_on,
        })
    }
}

impl Tool for Parts {
    fn operation(&self) -> &'static str {
        "boolean"
    }

    fn label(&self) -> &'static str {
        "Boolean"
    }

    fn hint(&self) -> &'static str {
        "Click a part, drag arrows to move it and rings to turn it; Ctrl: in larger steps"
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Mesh]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        let mut fields = with_params(json!({}));
        fields.insert("expression".to_owned(), INPUT_NAME.into());
        fields.insert("files".to_owned(), json!([]));
        fields
    }

    fn made(&self, edit: &Edit) -> bool {
        edit.operation == self.operation() && edit.fields.contains_key("files")
    }

    fn hidden(&self) -> &'static [&'static str] {
        &["places"]
    }

    fn shown_mesh(
        &self,
        assistant: &Assistant,
        shown: Option<&Arc<ShownMesh>>,
    ) -> Option<Arc<ShownMesh>> {
        self.result.shown_mesh(assistant, shown)
    }

    fn ghost(&self, assistant: &Assistant, edit: &Edit) -> Option<Arc<ShownMesh>> {
        let ghost = assistant.answer::<Ghost>(GHOST)?;
        (ghost.edit == edit.id).then(|| ghost.mesh.clone())
    }

    fn mesh_ui(&mut self, mut hand: MeshHand<'_>, edit: &Edit) -> Option<Gesture> {
        self.ask_scene(&hand, edit);
        let gesture = self.handle_ui(&mut hand, edit);
        self.result.mesh_ui(hand, edit);
        gesture
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        let scene = desk.assistant.answer::<Scene>(SCENE);
        let scene = scene.as_deref().filter(|scene| scene.job.edit == edit.id);
        let list = self.list_ui(ui, edit, scene);
        let expression = Self::expression_ui(ui, edit);
        let numbers = self.numbers_ui(ui, edit, scene);
        ui.separator();
        self.result.panel_ui(ui, desk, edit);
        list.or(expression).or(numbers)
    }
}

impl Parts {
    /// The outline and the handle of the selected part; what the hand has changed.
    fn handle_ui(&mut self, hand: &mut MeshHand<'_>, edit: &Edit) -> Option<Gesture> {
        let scene = hand.assistant.answer::<Scene>(SCENE)?;
        if scene.job.edit != edit.id {
            return None;
        }
        let placements = placements(edit);
        self.ask_ghost(hand.assistant, &scene, &placements);
        let view = *hand.canvas.view()?;
        let name = self.selected(edit);
        let part = scene.parts.iter().find(|part| part.name == name)?;
        let placement = placement_of(&placements, &name);
        let painter = hand.ui.painter_at(hand.response.rect);
        for line in part.outline(&placement) {
            if let [Some(a), Some(b)] = line.map(|end| view.project(end)) {
                painter.line_segment([a, b], Stroke::new(1.0, SELECTED));
            }
        }
        let handle = Handle::new(&view, part.center(&placement)?)?;
        let gesture = self.follow(hand, edit, &handle, &placement);
        let hovered = hand.response.hover_pos().and_then(|at| handle.grip(at));
        let held = self.held.as_ref().map(|held| held.grip);
        hand.canvas.lock_orbit(held.or(hovered).is_some());
        handle.paint(&painter, held.or(hovered));
        let grips = Grip::ALL.map(|grip| (grip.name(&name), handle.place(grip)));
        let centers = scene.parts.iter().map(|part| {
            let center = part.center(&placement_of(&placements, &part.name));
            let at = center.and_then(|center| view.project(center));
            (format!("Part {}", part.name), at)
        });
        name_places(hand.ui, &painter, grips.into_iter().chain(centers));
        if hovered.is_none() {
            self.select_below(hand, &scene, &placements);
        }
        gesture
    }
}

/// Gives places of the canvas names for those who do not see them.
fn name_places(ui: &Ui, painter: &Painter, places: impl Iterator<Item = (String, Option<Pos2>)>) {
    for (name, at) in places {
        let Some(at) = at.filter(|at| painter.clip_rect().contains(*at)) else {
            continue;
        };
        let place = Rect::from_center_size(at, Vec2::splat(NAMED_SIDE));
        let response = ui.interact(place, egui::Id::unique(("part", &name)), Sense::hover());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Label, true, &name));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start() -> Edit {
        Edit {
            id: 1,
            operation: "boolean".to_owned(),
            fields: Parts::default().start([0, 0]),
            more_sizes: Vec::new(),
            enabled: true,
        }
    }

    fn names_of(edit: &Edit) -> Vec<String> {
        parts(edit).into_iter().map(|(name, _)| name).collect()
    }

    #[test]
    fn parts_are_named_in_turn_and_taken_into_plain_expressions() {
        let (edit, name) = with_part(&start(), Path::new("/x/one.ply"));
        assert_eq!((name.as_str(), expression(&edit)), ("b", "a | b"));
        let edit = with_expression(&edit, "a -b");
        let (edit, name) = with_part(&edit, Path::new("/x/two.ply"));
        assert_eq!((name.as_str(), expression(&edit)), ("c", "a - b - c"));
        assert_eq!(
            edit.fields["files"],
            json!(["b=/x/one.ply", "c=/x/two.ply"])
        );
        let other = with_expression(&edit, "a - (b | c)");
        let (other, name) = with_part(&other, Path::new("/x/three.ply"));
        assert_eq!((name.as_str(), expression(&other)), ("d", "a - (b | c)"));
        let edit = with_placement(&edit, &"b:1,0,0".parse().unwrap());
        let edit = with_placement(&edit, &"c:0,2,0".parse().unwrap());
        let less = without_part(&edit, 1);
        assert_eq!(
            (names_of(&less).join(" ").as_str(), expression(&less)),
            ("a c", "a - c")
        );
        assert_eq!(*less.param("places"), json!(["c:0,2,0"]));
        assert_eq!(with_part(&less, Path::new("/x/four.ply")).1, "b");
    }

    #[test]
    fn places_are_those_of_the_operation() {
        let (edit, _) = with_part(&start(), Path::new("/x/one.ply"));
        let edit = with_placement(&edit, &"b:1,2.5,0,0,0,90".parse().unwrap());
        let step = edit
            .step(Path::new("in.ply"), Path::new("out.ply"))
            .unwrap();
        let fields = serde_json::to_value(&step).unwrap();
        assert_eq!(fields["params"]["places"], json!(["b:1,2.5,0,0,0,90"]));
        assert_eq!(fields["files"], json!(["a=in.ply", "b=/x/one.ply"]));
        // where it was is no parameter
        assert!(
            with_placement(&edit, &Placement::new("b"))
                .param("places")
                .is_null()
        );
    }

    #[test]
    fn parts_without_a_name_have_those_of_the_operation() {
        let files = ["x.ply", "b=y.ply", "z.ply"].map(|text| text.to_owned().into());
        let edit = with_files(&start(), files.into());
        assert_eq!(names_of(&edit), ["a", "c", "b", "d"]);
        assert_eq!(used("c - d", &names_of(&edit)), ["c", "d"]);
        // they keep them when another is removed
        let less = without_part(&edit, 2);
        assert_eq!(names_of(&less), ["a", "c", "d"]);
    }
}
