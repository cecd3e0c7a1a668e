//! Rectification: the corners of a quadrilateral are dragged on the picture, with a grid in perspective.

use super::{Gesture, Hand, Tool, with_params};
use crate::document::Edit;
use crate::view::canvas::distance;
use egui::{Color32, Pos2, Stroke};
use ravec::planar::Homography;
use serde_json::{Map, Value, json};

/// Distance from a corner within which it is taken, in screen points.
const REACH: f32 = 14.0;

/// Columns and rows of the grid that is drawn.
const GRID: usize = 6;

/// Drags the corners.
#[derive(Default)]
pub(crate) struct Rectify {
    held: Option<usize>,
}

/// The corners of an edit.
fn corners(edit: &Edit) -> Option<[[f64; 2]; 4]> {
    let numbers: Vec<f64> = (edit.param("quad").as_str()?.split(','))
        .map(|number| number.trim().parse())
        .collect::<Result<_, _>>()
        .ok()?;
    let numbers: [f64; 8] = numbers.try_into().ok()?;
    Some(std::array::from_fn(|k| {
        [numbers[2 * k], numbers[2 * k + 1]]
    }))
}

fn text(corners: &[[f64; 2]; 4]) -> String {
    let numbers: Vec<String> = corners
        .iter()
        .flatten()
        .map(|number| format!("{number:.2}"))
        .collect();
    numbers.join(",")
}

impl Tool for Rectify {
    fn operation(&self) -> &'static str {
        "rectify"
    }

    fn label(&self) -> &'static str {
        "Rectify"
    }

    fn start(&self, [width, height]: [usize; 2]) -> Map<String, Value> {
        let (x, y) = (width as f64, height as f64);
        let quad = [
            [0.25 * x, 0.25 * y],
            [0.75 * x, 0.25 * y],
            [0.75 * x, 0.75 * y],
            [0.25 * x, 0.75 * y],
        ];
        with_params(json!({"quad": text(&quad)}))
    }

    fn works_on_input(&self) -> bool {
        true
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let mut corners = corners(edit)?;
        let places = corners.map(|[x, y]| hand.view.to_screen(x, y));
        paint(hand, &corners, &places);
        let near = |at: Pos2| (0..4).find(|&k| distance(places[k], at) < REACH);
        if hand.response.drag_started_by(egui::PointerButton::Primary) {
            let origin = hand.ui.input(|input| input.pointer.press_origin());
            self.held = origin.and_then(near);
        }
        let held = self.held?;
        let at = hand.response.interact_pointer_pos()?;
        let goes_on = hand.response.dragged();
        if !goes_on {
            self.held = None;
        }
        corners[held] = hand.view.to_picture(at);
        Some(Gesture {
            edit: edit.with_param("quad", text(&corners).into()),
            goes_on,
        })
    }
}

fn paint(hand: &Hand<'_>, corners: &[[f64; 2]; 4], places: &[Pos2; 4]) {
    let color = Color32::from_rgb(90, 220, 120);
    let quad = corners.map(Into::into);
    if let Ok(image_from_unit) = Homography::from_unit_square(quad) {
        let place = |x: f64, y: f64| {
            let point = image_from_unit.apply((x, y).into());
            hand.view.to_screen(point.x, point.y)
        };
        for k in 1..GRID {
            let share = k as f64 / GRID as f64;
            let thin = Stroke::new(1.0, color.gamma_multiply(0.6));
            hand.painter
                .line_segment([place(share, 0.0), place(share, 1.0)], thin);
            hand.painter
                .line_segment([place(0.0, share), place(1.0, share)], thin);
        }
    }
    for k in 0..4 {
        let side = [places[k], places[(k + 1) % 4]];
        hand.painter.line_segment(side, Stroke::new(1.5, color));
        hand.painter.circle_filled(places[k], 5.0, color);
    }
}
