//! A marker for foreground and background: strokes in frames, as plates and mattes take them.

use super::{Gesture, Hand};
use crate::document::Edit;
use egui::{Color32, Event, Key, PointerButton, Slider, Stroke, Ui};
use ravec_jobs::{FrameMark, Side};
use serde_json::Value;

/// Factor by which keys change the radius.
const COARSER: f64 = 1.2;
/// Radii in pixels.
const RADII: std::ops::RangeInclusive<f64> = 0.5..=300.0;
/// Distance between points of a stroke as a share of the radius.
const SPACING: f64 = 0.3;

/// Marks foreground and background by strokes.
pub(super) struct Marker {
    side: Side,
    radius_px: f64,
    /// The edit before the stroke in the hand, and its points.
    held: Option<(Edit, Vec<[f64; 2]>)>,
    /// The frame that the panel has asked for.
    pub wanted: Option<u64>,
}

impl Default for Marker {
    fn default() -> Self {
        Self {
            side: Side::Foreground,
            radius_px: 8.0,
            held: None,
            wanted: None,
        }
    }
}

/// The strokes of an edit, as far as they are well-formed.
pub(super) fn marks(edit: &Edit) -> Vec<FrameMark> {
    let list = edit.param("marks").as_array();
    let texts = list.into_iter().flatten().filter_map(Value::as_str);
    texts.filter_map(|text| text.parse().ok()).collect()
}

fn with_marks(edit: &Edit, marks: &[FrameMark]) -> Edit {
    let texts: Vec<String> = marks.iter().map(FrameMark::to_string).collect();
    let value = if texts.is_empty() {
        Value::Null
    } else {
        texts.into()
    };
    edit.with_param("marks", value)
}

fn color_of(side: Side) -> Color32 {
    match side {
        Side::Foreground => Color32::from_rgb(90, 220, 120),
        Side::Background => Color32::from_rgb(255, 110, 90),
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// A coordinate as it is written: a hundredth of a pixel is enough.
fn rounded(value: f64) -> f64 {
    (100.0 * value).round() / 100.0
}

impl Marker {
    /// Draws the strokes of the frame and the tip, and follows the hand.
    pub fn follow(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        self.obey_keys(hand);
        let frame = hand.frame.unwrap_or(0);
        for mark in marks(edit).iter().filter(|mark| mark.frame == frame) {
            paint(hand, mark);
        }
        self.paint_tip(hand);
        if hand.pans() {
            return None;
        }
        self.draw(hand, edit, frame)
    }

    /// Goes through the events of the pointer one by one: where frames of the window are slow, a whole stroke lies within one.
    fn draw(&mut self, hand: &Hand<'_>, edit: &Edit, frame: u64) -> Option<Gesture> {
        let spacing = SPACING * self.radius_px;
        let events = hand.ui.input(|input| input.events.clone());
        let mut ended = None;
        for event in events {
            match event {
                Event::PointerButton {
                    pos,
                    button: PointerButton::Primary,
                    pressed: true,
                    ..
                } if hand.response.contains_pointer() || hand.response.dragged() => {
                    let at = hand.view.to_picture(pos);
                    self.held = Some((edit.clone(), vec![at]));
                }
                Event::PointerMoved(pos) => {
                    let at = hand.view.to_picture(pos);
                    if let Some((_, points)) = &mut self.held
                        && points
                            .last()
                            .is_none_or(|last| distance(*last, at) > spacing)
                    {
                        points.push(at);
                    }
                }
                Event::PointerButton {
                    button: PointerButton::Primary,
                    pressed: false,
                    ..
                }
                | Event::WindowFocused(false) => ended = self.held.take().or(ended),
                _ => {}
            }
        }
        let (stroke, goes_on) = match ended {
            Some(stroke) => (stroke, false),
            None => (self.held.clone()?, true),
        };
        let (base, points) = stroke;
        Some(Gesture {
            edit: self.with_stroke(&base, frame, &points),
            goes_on,
        })
    }

    fn with_stroke(&self, edit: &Edit, frame: u64, points: &[[f64; 2]]) -> Edit {
        let mut list = marks(edit);
        list.push(FrameMark {
            frame,
            side: self.side,
            radius_px: rounded(self.radius_px),
            points: (points.iter())
                .map(|[x, y]| [rounded(*x), rounded(*y)])
                .collect(),
        });
        with_marks(edit, &list)
    }

    fn obey_keys(&mut self, hand: &Hand<'_>) {
        if hand.ui.ctx().egui_wants_keyboard_input() {
            return;
        }
        let pressed = |key| hand.ui.input(|input| input.key_pressed(key));
        if pressed(Key::OpenBracket) {
            self.radius_px /= COARSER;
        }
        if pressed(Key::CloseBracket) {
            self.radius_px *= COARSER;
        }
        if hand.wheel() != 0.0 {
            self.radius_px *= COARSER.powf(f64::from(hand.wheel()));
        }
        self.radius_px = self.radius_px.clamp(*RADII.start(), *RADII.end());
        if pressed(Key::X) {
            self.side = match self.side {
                Side::Foreground => Side::Background,
                Side::Background => Side::Foreground,
            };
        }
    }

    fn paint_tip(&self, hand: &Hand<'_>) {
        if let Some(at) = hand.response.hover_pos() {
            let radius = self.radius_px as f32 * hand.view.zoom;
            let line = Stroke::new(1.5, color_of(self.side));
            hand.painter.circle_stroke(at, radius, line);
        }
    }

    /// The controls of the tip, and the strokes of the edit.
    pub fn panel_ui(&mut self, ui: &mut Ui, edit: &Edit) -> Option<Gesture> {
        ui.horizontal(|ui| {
            for (side, name) in [
                (Side::Foreground, "Mark foreground"),
                (Side::Background, "Mark background"),
            ] {
                ui.radio_value(&mut self.side, side, name)
                    .on_hover_text("X changes the side");
            }
        });
        ui.horizontal(|ui| {
            let label = ui.label("Tip").on_hover_text("Radius in pixels, [ and ]");
            let slider = Slider::new(&mut self.radius_px, RADII)
                .logarithmic(true)
                .max_decimals(1);
            ui.add(slider.suffix(" px")).labelled_by(label.id);
        });
        let list = marks(edit);
        let mut removed = None;
        for (index, mark) in list.iter().enumerate() {
            ui.horizontal(|ui| {
                let name = format!("Stroke {} in frame {}", index + 1, mark.frame);
                let text = egui::RichText::new(&name).color(color_of(mark.side));
                if ui.button(text).clicked() {
                    self.wanted = Some(mark.frame);
                }
                let remove = ui.small_button("×");
                let name = format!("Remove stroke {}", index + 1);
                remove.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
                if remove.on_hover_text(&name).clicked() {
                    removed = Some(index);
                }
            });
        }
        let mut kept = list;
        kept.remove(removed?);
        Some(Gesture::done(with_marks(edit, &kept)))
    }
}

/// Draws a stroke: its middle line, and its tip at both ends.
fn paint(hand: &Hand<'_>, mark: &FrameMark) {
    let color = color_of(mark.side);
    let places: Vec<_> = (mark.points.iter())
        .map(|[x, y]| hand.view.to_screen(*x, *y))
        .collect();
    let radius = mark.radius_px as f32 * hand.view.zoom;
    let ends = [places.first(), places.last()];
    for place in ends.into_iter().flatten() {
        let line = Stroke::new(1.0, color.gamma_multiply(0.7));
        hand.painter.circle_stroke(*place, radius, line);
    }
    let line = Stroke::new(2.0, color);
    hand.painter.add(egui::Shape::line(places, line));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;
    use serde_json::Map;

    #[test]
    fn strokes_are_parameters_that_the_operation_reads() {
        let mut document = Document::new("clip.y4m");
        let id = document.push("matte", Map::new());
        let edit = document.edit(id).unwrap();
        let marker = Marker::default();
        let once = marker.with_stroke(edit, 7, &[[1.004, 2.0], [3.0, -4.5]]);
        let twice = marker.with_stroke(&once, 9, &[[5.0, 6.0]]);
        let expected = ["7:foreground:8:1,2,3,-4.5", "9:foreground:8:5,6"];
        assert_eq!(*twice.param("marks"), serde_json::json!(expected));
        assert_eq!(marks(&twice).len(), 2);
        let none = with_marks(&twice, &[]);
        assert!(none.param("marks").is_null());
        let step = twice.step("a.y4m".as_ref(), "b.y4m".as_ref());
        assert!(step.is_ok(), "{step:?}");
    }
}
