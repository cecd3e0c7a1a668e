//! The brush: strokes on the picture, which stay editable.

use super::{Gesture, Hand, Tool, with_params};
use crate::document::Edit;
use egui::{Color32, Key, Stroke};
use serde_json::{Map, Value, json};

/// Steps of the radius by the bracket keys.
const FINER: f64 = 1.0 / 1.15;
const COARSER: f64 = 1.15;

/// Points of a stroke are at least so far apart, as a share of the radius.
const SPACING: f64 = 0.08;

/// Paints strokes with the settings of the panel.
#[derive(Default)]
pub(crate) struct Brush {
    /// Points of the stroke that is being painted.
    points: Vec<[f64; 2]>,
}

fn number(edit: &Edit, name: &str, default: f64) -> f64 {
    edit.param(name).as_f64().unwrap_or(default)
}

/// The tool of a stroke by the settings of an edit.
fn tool(edit: &Edit) -> Value {
    let mode = edit.param("mode").as_str().unwrap_or("smooth");
    let color = edit.param("color").clone();
    let color = if color.is_null() {
        json!([192, 48, 32])
    } else {
        color
    };
    match mode {
        "color" => json!({"color": {"rgb": color}}),
        "recolor" => json!({"recolor": {"rgb": color}}),
        "saturation" => json!({"saturation": {"amount": number(edit, "amount", 0.5)}}),
        "dodge" | "burn" | "mask" => mode.into(),
        operator => {
            json!({"operator": {"mode": operator, "iterations": number(edit, "iterations", 1.0) as u32, "noise_sigma": null}})
        }
    }
}

/// An edit with one more stroke.
fn with_stroke(edit: &Edit, points: &[[f64; 2]], size: [usize; 2]) -> Edit {
    let mut edit = edit.clone();
    let stroke = json!({
        "tool": tool(&edit),
        "points": points,
        "radius_px": number(&edit, "radius", 32.0),
        "hardness": number(&edit, "hardness", 0.5),
        "strength": number(&edit, "strength", 1.0),
        "edge_aware": edit.param("across_edges") != true,
    });
    let empty = || json!({"version": 1, "width": size[0], "height": size[1], "strokes": []});
    let strokes = edit.fields.entry("strokes").or_insert_with(empty);
    if let Some(list) = strokes.get_mut("strokes").and_then(Value::as_array_mut) {
        list.push(stroke);
    }
    edit
}

impl Tool for Brush {
    fn operation(&self) -> &'static str {
        "brush"
    }

    fn label(&self) -> &'static str {
        "Brush"
    }

    fn start(&self, [width, height]: [usize; 2]) -> Map<String, Value> {
        let mut fields = with_params(json!({"mode": "color"}));
        let strokes = json!({"version": 1, "width": width, "height": height, "strokes": []});
        fields.insert("strokes".to_owned(), strokes);
        fields
    }

    fn made(&self, edit: &Edit) -> bool {
        edit.operation == "brush" && edit.fields.contains_key("strokes")
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let radius = number(edit, "radius", 32.0);
        let ring = Stroke::new(1.5, Color32::WHITE);
        if let Some(at) = hand.response.hover_pos() {
            hand.painter
                .circle_stroke(at, radius as f32 * hand.view.zoom, ring);
        }
        let factor = hand.ui.input(|input| {
            let key = |key, factor| if input.key_pressed(key) { factor } else { 1.0 };
            key(Key::OpenBracket, FINER) * key(Key::CloseBracket, COARSER)
        });
        if factor != 1.0 {
            let radius = (radius * factor).clamp(1.0, 4096.0);
            return Some(Gesture {
                edit: edit.with_param("radius", radius.into()),
                goes_on: false,
            });
        }
        let space = hand.ui.input(|input| input.key_down(Key::Space));
        if space {
            return None;
        }
        if hand.response.drag_started_by(egui::PointerButton::Primary) {
            self.points.clear();
            let origin = hand.ui.input(|input| input.pointer.press_origin());
            self.points
                .extend(origin.map(|at| hand.view.to_picture(at)));
        }
        if hand.response.clicked()
            && let Some(at) = hand.response.interact_pointer_pos()
        {
            let dab = [hand.view.to_picture(at)];
            return Some(Gesture {
                edit: with_stroke(edit, &dab, hand.input_size),
                goes_on: false,
            });
        }
        if self.points.is_empty() {
            return None;
        }
        // every motion of the frame, not only the last: a fast stroke has corners otherwise
        let moves: Vec<_> = hand.ui.input(|input| {
            let moves = input.events.iter().filter_map(|event| match event {
                egui::Event::PointerMoved(at) => Some(*at),
                _ => None,
            });
            moves.collect()
        });
        for at in moves {
            let point = hand.view.to_picture(at);
            let far = self.points.last().is_none_or(|last| {
                (last[0] - point[0]).hypot(last[1] - point[1]) >= (SPACING * radius).max(0.5)
            });
            if far {
                self.points.push(point);
            }
        }
        for pair in self.points.windows(2) {
            let ends = [0, 1].map(|k| hand.view.to_screen(pair[k][0], pair[k][1]));
            hand.painter
                .line_segment(ends, Stroke::new(2.0, Color32::WHITE));
        }
        if hand.response.dragged() {
            return None;
        }
        let points = std::mem::take(&mut self.points);
        Some(Gesture {
            edit: with_stroke(edit, &points, hand.input_size),
            goes_on: false,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_have_the_settings_of_the_panel() {
        let start = Edit {
            id: 1,
            operation: "brush".to_owned(),
            fields: Brush::default().start([64, 48]),
            enabled: true,
        };
        let modes = [
            "color",
            "recolor",
            "saturation",
            "dodge",
            "burn",
            "mask",
            "smooth",
            "sharpen",
        ];
        for mode in modes {
            let edit = start
                .with_param("mode", mode.into())
                .with_param("radius", 7.5.into());
            let edit = with_stroke(&edit, &[[10.0, 12.0], [20.0, 12.0]], [64, 48]);
            let step = edit.step("a.png".as_ref(), "b.png".as_ref()).unwrap();
            let ravec_jobs::Step::Brush(brush) = step else {
                panic!("an edit of the brush is a step of the brush");
            };
            let strokes = &brush.strokes.unwrap().strokes;
            assert_eq!((strokes.len(), strokes[0].radius_px), (1, 7.5), "{mode}");
        }
    }
}
