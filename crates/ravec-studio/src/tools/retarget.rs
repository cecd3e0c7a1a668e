//! Retargeting: the right and the lower side of the picture are dragged.

use super::{Gesture, Hand, Tool, with_params};
use crate::document::Edit;
use egui::{Color32, CursorIcon, Rect, Stroke, pos2};
use serde_json::{Map, Value, json};

/// Distance from a side within which it is taken, in screen points.
const REACH: f32 = 10.0;

/// The smallest share of the input that a side may have: less is refused by the operation.
const MIN_SHARE: f64 = 0.05;

/// Drags the sides of the frame.
#[derive(Default)]
pub(crate) struct Retarget {
    /// Sides that are held: the right one, the lower one.
    held: Option<[bool; 2]>,
}

/// The size that an edit asks for.
fn size_of(edit: &Edit, input: [usize; 2]) -> [f64; 2] {
    let text = edit
        .param("sizes")
        .get(0)
        .and_then(Value::as_str)
        .unwrap_or_default();
    let side = |text: &str, input: usize| match text.strip_suffix('%') {
        Some(percent) => percent
            .parse()
            .map_or(input as f64, |share: f64| 0.01 * share * input as f64),
        None => text.parse().unwrap_or(input as f64),
    };
    match text.split_once('x') {
        Some((width, height)) => [side(width, input[0]), side(height, input[1])],
        None => [side(text, input[0]), side(text, input[1])],
    }
}

impl Tool for Retarget {
    fn operation(&self) -> &'static str {
        "retarget"
    }

    fn label(&self) -> &'static str {
        "Retarget"
    }

    fn start(&self, [width, height]: [usize; 2]) -> Map<String, Value> {
        with_params(json!({"sizes": [format!("{width}x{height}")]}))
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let [width, height] = size_of(edit, hand.input_size);
        let corner = hand.view.to_screen(width, height);
        let frame = Rect::from_min_max(hand.view.to_screen(0.0, 0.0), corner);
        let stroke = Stroke::new(1.5, Color32::from_rgb(250, 170, 40));
        hand.painter
            .rect_stroke(frame, 0.0, stroke, egui::StrokeKind::Middle);
        for handle in [
            pos2(corner.x, frame.center().y),
            pos2(frame.center().x, corner.y),
            corner,
        ] {
            hand.painter.circle_filled(handle, 5.0, stroke.color);
        }
        let near = |at: egui::Pos2| {
            let right = (at.x - corner.x).abs() < REACH && at.y < corner.y + REACH;
            let lower = (at.y - corner.y).abs() < REACH && at.x < corner.x + REACH;
            (right || lower).then_some([right, lower])
        };
        if let Some(sides) = hand.response.hover_pos().and_then(near) {
            hand.ui.ctx().set_cursor_icon(match sides {
                [true, true] => CursorIcon::ResizeNwSe,
                [true, false] => CursorIcon::ResizeHorizontal,
                _ => CursorIcon::ResizeVertical,
            });
        }
        if hand.response.drag_started_by(egui::PointerButton::Primary) {
            let origin = hand.ui.input(|input| input.pointer.press_origin());
            self.held = origin.and_then(near);
        }
        let sides = self.held?;
        let at = hand.response.interact_pointer_pos()?;
        let goes_on = hand.response.dragged();
        if !goes_on {
            self.held = None;
        }
        let place = hand.view.to_picture(at);
        let mut size = [width, height];
        for k in 0..2 {
            if sides[k] {
                let input = hand.input_size[k] as f64;
                size[k] = place[k]
                    .clamp((MIN_SHARE * input).ceil(), 4.0 * input)
                    .round();
            }
        }
        let text = format!("{}x{}", size[0], size[1]);
        Some(Gesture {
            edit: edit.with_param("sizes", json!([text])),
            goes_on,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_the_command_line_does() {
        let edit = |text: &str| Edit {
            id: 1,
            operation: "retarget".to_owned(),
            fields: with_params(json!({"sizes": [text]})),
            enabled: true,
        };
        assert_eq!(size_of(&edit("50%x100%"), [200, 80]), [100.0, 80.0]);
        assert_eq!(size_of(&edit("120x90"), [200, 80]), [120.0, 90.0]);
        assert_eq!(size_of(&edit("50%"), [200, 80]), [100.0, 40.0]);
        assert_eq!(size_of(&edit("120x"), [200, 80]), [120.0, 80.0]);
    }
}
