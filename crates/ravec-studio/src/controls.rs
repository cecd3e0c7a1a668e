//! The controls of the window by their accessible names, for programs that press them: measurements, and tests of the real window.

use egui::accesskit::{Node, NodeId, Role, TreeUpdate};
use egui::{Context, FullOutput, Plugin, Rect, pos2};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};

/// Name and role of the pointer among the controls.
const POINTER: &str = "Pointer";

/// A control of the window.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Control {
    /// Accessible name.
    pub name: String,
    /// Role, such as `Button`.
    pub role: String,
    /// Left, top, right and bottom in points of the window.
    pub place: [f32; 4],
    /// The text or the number that it shows, if it has one.
    pub value: Option<String>,
    /// False if it cannot be used now.
    pub enabled: bool,
    /// True if keys go to it.
    pub focused: bool,
}

impl Control {
    /// The rectangle in points of the window.
    pub fn rect(&self) -> Rect {
        let [left, top, right, bottom] = self.place;
        Rect::from_min_max(pos2(left, top), pos2(right, bottom))
    }
}

/// The controls of the last frame that was drawn with accessible names, in the order in which a reader meets them.
#[derive(Debug, Clone, Default)]
pub struct Controls {
    list: Arc<Mutex<Vec<Control>>>,
}

impl Controls {
    /// Follows the frames of a window, and writes the controls to a file as JSON whenever they change, if there is one.
    pub fn watch(context: &Context, file: Option<PathBuf>) -> Self {
        let controls = Self::default();
        context.add_plugin(Watcher {
            controls: controls.clone(),
            writer: file.map(writer),
        });
        context.enable_accesskit();
        controls
    }

    /// All of them.
    pub fn all(&self) -> Vec<Control> {
        crate::engine::lock(&self.list).clone()
    }

    /// The first control of a name: one that can be used if there is one, else a text.
    pub fn find(&self, name: &str) -> Option<Control> {
        let all = self.all();
        let named = || all.iter().filter(|control| control.name == name);
        let usable = named().find(|control| control.enabled && control.role != "Label");
        usable.or_else(|| named().next()).cloned()
    }

    /// The field in which the number of a control is typed: the control itself, or the one beside it.
    pub fn find_number(&self, name: &str) -> Option<Control> {
        let all = self.all();
        let at = all
            .iter()
            .position(|control| control.name == name && control.role != "Label")?;
        let field = all[at..].iter().find(|control| {
            control.role == "SpinButton"
                && (control.rect().center().y - all[at].rect().center().y).abs() < 8.0
        });
        field.cloned()
    }
}

/// Reads the controls from what each frame tells screen readers.
struct Watcher {
    controls: Controls,
    writer: Option<Sender<Vec<Control>>>,
}

impl Plugin for Watcher {
    fn debug_name(&self) -> &'static str {
        "controls"
    }

    fn output_hook(&mut self, context: &Context, output: &mut FullOutput) {
        let Some(update) = &output.platform_output.accesskit_update else {
            return;
        };
        let mut found = controls(update);
        found.extend(pointer(context));
        let mut list = crate::engine::lock(&self.controls.list);
        if *list == found {
            return;
        }
        if let Some(writer) = &self.writer {
            // without the thread there is no file, and the window still works
            let _ = writer.send(found.clone());
        }
        *list = found;
    }
}

/// The thread that writes the file: the window writes none.
fn writer(file: PathBuf) -> Sender<Vec<Control>> {
    let (sender, receiver): (_, Receiver<Vec<Control>>) = channel();
    std::thread::spawn(move || {
        while let Ok(first) = receiver.recv() {
            let last = receiver.try_iter().last().unwrap_or(first);
            let written = serde_json::to_vec_pretty(&last).map(|text| {
                ravec_files::write_atomically(&file, |out| {
                    use std::io::Write as _;
                    out.write_all(&text)
                })
            });
            if let Ok(Err(error)) = written {
                eprintln!("{}: {error}", file.display());
            }
        }
    });
    sender
}

/// The pointer as a control of the name and role `Pointer`, with the value `down` while its first button is pressed: what a hand has done
/// is in a frame before it does the next thing.
fn pointer(context: &Context) -> Option<Control> {
    let (at, is_down) = context.input(|input| {
        let pointer = &input.pointer;
        (pointer.latest_pos(), pointer.primary_down())
    });
    at.map(|at| Control {
        name: POINTER.to_owned(),
        role: POINTER.to_owned(),
        place: [at.x, at.y, at.x, at.y],
        value: Some(if is_down { "down" } else { "up" }.to_owned()),
        enabled: true,
        focused: false,
    })
}

/// The named controls of a frame.
fn controls(update: &TreeUpdate) -> Vec<Control> {
    let nodes: HashMap<NodeId, &Node> = update.nodes.iter().map(|(id, node)| (*id, node)).collect();
    let mut found = Vec::new();
    let root = update.tree.as_ref().map(|tree| tree.root);
    let mut open: Vec<NodeId> = root.into_iter().collect();
    while let Some(id) = open.pop() {
        let Some(node) = nodes.get(&id) else {
            continue;
        };
        open.extend(node.children().iter().rev());
        let name = name_of(node, &nodes);
        let unnamed_number = name.is_empty() && node.role() == Role::SpinButton;
        if let Some(place) = node.bounds()
            && (!name.is_empty() || unnamed_number)
        {
            let number = node.numeric_value().map(|value| value.to_string());
            found.push(Control {
                name,
                role: format!("{:?}", node.role()),
                place: [place.x0, place.y0, place.x1, place.y1].map(|value| value as f32),
                value: node.value().map(str::to_owned).or(number),
                enabled: !node.is_disabled(),
                focused: id == update.focus,
            });
        }
    }
    found
}

/// The name that a screen reader says.
fn name_of(node: &Node, nodes: &HashMap<NodeId, &Node>) -> String {
    if let Some(label) = node.label() {
        return label.to_owned();
    }
    let labels = node.labelled_by().iter().filter_map(|id| nodes.get(id));
    let texts: Vec<&str> = labels
        .filter_map(|label| label.value().or_else(|| label.label()))
        .collect();
    if texts.is_empty() && node.role() == Role::Label {
        return node.value().unwrap_or_default().to_owned();
    }
    texts.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::RawInput;

    #[test]
    fn controls_have_the_names_and_places_that_are_drawn() {
        let context = Context::default();
        let controls = Controls::watch(&context, None);
        let mut number = 7.0;
        let mut place = Rect::NOTHING;
        let mut output = context.run_ui(RawInput::default(), |ui| {
            place = ui.button("Fill").rect;
            ui.horizontal(|ui| {
                let label = ui.label("Radius");
                ui.add(egui::Slider::new(&mut number, 0.0..=10.0))
                    .labelled_by(label.id);
            });
            ui.add_enabled(false, egui::Button::new("Undo"));
        });
        output.textures_delta.clear();
        assert_eq!(controls.find("Fill").unwrap().rect(), place);
        assert!(!controls.find("Undo").unwrap().enabled);
        let slider = controls.find("Radius").unwrap();
        assert_eq!(slider.role, "Slider");
        let field = controls.find_number("Radius").unwrap();
        assert!(field.rect().left() > slider.rect().left());
        assert!(controls.find("Nothing").is_none());
    }
}
