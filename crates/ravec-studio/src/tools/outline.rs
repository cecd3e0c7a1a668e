//! Areas under the hand: a lasso, a polygon by clicks, or a brush.

use super::Hand;
use crate::document::Edit;
use egui::{Color32, Key, Pos2, Shape, Stroke};
use serde_json::{Value, json};

/// Corners of a polygon, in pixels.
pub(crate) type Polygon = Vec<[f64; 2]>;

/// Corners of the half disc at each end of a brushed area.
const CAP_CORNERS: usize = 8;

/// Distance of a corner from the first one at which a click closes the polygon, in screen points.
const CLOSE: f32 = 10.0;

/// Maximum deviation of a drawn line from the hand, in screen points.
const SIMPLIFY: f64 = 0.7;

/// Way in which an area is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum OutlineMode {
    /// Along the border, in one motion.
    #[default]
    Lasso,
    /// Corner by corner.
    Polygon,
    /// As with a brush.
    Brush,
}

/// Follows the hand that draws an area.
#[derive(Default)]
pub(crate) struct Outline {
    pub mode: OutlineMode,
    /// Radius of the brush in pixels of the picture.
    pub radius: f64,
    points: Polygon,
}

impl Outline {
    /// Starts with a brush of this radius.
    pub fn with_radius(radius: f64) -> Self {
        Self {
            radius,
            ..Self::default()
        }
    }

    /// The controls of the way of drawing.
    pub fn ui(&mut self, ui: &mut egui::Ui) {
        ui.horizontal(|ui| {
            for (mode, name) in [
                (OutlineMode::Lasso, "Lasso"),
                (OutlineMode::Polygon, "Polygon"),
                (OutlineMode::Brush, "Area brush"),
            ] {
                if ui.selectable_label(self.mode == mode, name).clicked() {
                    self.mode = mode;
                    self.points.clear();
                }
            }
            if self.mode == OutlineMode::Brush {
                let radius = egui::DragValue::new(&mut self.radius).range(1.0..=2000.0);
                let label = ui.label("Radius");
                ui.add(radius.suffix(" px")).labelled_by(label.id);
            }
        });
    }

    /// The polygons of an area that the hand has finished in this frame. Draws what is unfinished.
    pub fn follow(&mut self, hand: &Hand<'_>, color: Color32) -> Option<Vec<Polygon>> {
        if hand.pans() {
            return None;
        }
        if self.mode == OutlineMode::Brush {
            self.resize(hand);
        }
        let finished = match self.mode {
            OutlineMode::Polygon => self.follow_clicks(hand),
            OutlineMode::Lasso | OutlineMode::Brush => self.follow_drag(hand),
        };
        if self.mode == OutlineMode::Brush
            && let Some(at) = hand.response.hover_pos()
        {
            let radius = self.radius as f32 * hand.view.zoom;
            hand.painter
                .circle_stroke(at, radius, Stroke::new(1.5, color));
        }
        let places: Vec<Pos2> = self
            .points
            .iter()
            .map(|at| hand.view.to_screen(at[0], at[1]))
            .collect();
        let width = match self.mode {
            OutlineMode::Brush => (2.0 * self.radius as f32 * hand.view.zoom).max(1.0),
            _ => 2.0,
        };
        let color = if self.mode == OutlineMode::Brush {
            color.gamma_multiply(0.4)
        } else {
            color
        };
        hand.painter
            .add(Shape::line(places, Stroke::new(width, color)));
        finished
    }

    fn resize(&mut self, hand: &Hand<'_>) {
        let factor = hand.ui.input(|input| {
            let key = |key, factor| if input.key_pressed(key) { factor } else { 1.0 };
            key(Key::OpenBracket, 0.85) * key(Key::CloseBracket, 1.18)
        });
        self.radius = (self.radius * factor).clamp(1.0, 2000.0);
    }

    fn follow_drag(&mut self, hand: &Hand<'_>) -> Option<Vec<Polygon>> {
        if let Some(from) = hand.pressed() {
            self.points = vec![from];
        }
        let tolerance = SIMPLIFY / f64::from(hand.view.zoom);
        if let Some(at) = hand.clicked()
            && self.mode == OutlineMode::Brush
        {
            self.points.clear();
            return Some(brushed(&[at], self.radius, tolerance));
        }
        if self.points.is_empty() {
            return None;
        }
        self.points.extend(hand.moves());
        if hand.response.dragged() {
            return None;
        }
        let points = std::mem::take(&mut self.points);
        if self.mode == OutlineMode::Brush {
            return Some(brushed(&points, self.radius, tolerance));
        }
        let points = simplified(&points, tolerance);
        (points.len() > 2).then(|| vec![points])
    }

    fn follow_clicks(&mut self, hand: &Hand<'_>) -> Option<Vec<Polygon>> {
        let (enter, escape) = hand.ui.input(|input| {
            (
                input.key_pressed(Key::Enter),
                input.key_pressed(Key::Escape),
            )
        });
        if escape {
            self.points.clear();
        }
        let clicked = hand.clicked();
        let closes = clicked.is_some_and(|at| {
            self.points.first().is_some_and(|first| {
                let apart = (first[0] - at[0]).hypot(first[1] - at[1]);
                apart as f32 * hand.view.zoom < CLOSE
            })
        });
        let closes = closes || hand.response.double_clicked() || enter;
        if closes && self.points.len() > 2 {
            return Some(vec![std::mem::take(&mut self.points)]);
        }
        if let Some(at) = clicked.filter(|_| !closes) {
            self.points.push(at);
        }
        if let (Some(last), Some(at)) = (self.points.last(), hand.response.hover_pos()) {
            let line = [hand.view.to_screen(last[0], last[1]), at];
            hand.painter
                .line_segment(line, Stroke::new(1.0, Color32::WHITE));
        }
        None
    }
}

/// A line with the corners that it needs to stay within a tolerance of the given one.
fn simplified(points: &[[f64; 2]], tolerance: f64) -> Polygon {
    let (Some(&first), Some(&last)) = (points.first(), points.last()) else {
        return Vec::new();
    };
    let (dx, dy) = (last[0] - first[0], last[1] - first[1]);
    let length = dx.hypot(dy);
    let off = |at: &[f64; 2]| {
        let (x, y) = (at[0] - first[0], at[1] - first[1]);
        if length < 1e-9 {
            x.hypot(y)
        } else {
            (x * dy - y * dx).abs() / length
        }
    };
    let far = (1..points.len().saturating_sub(1))
        .max_by(|&a, &b| off(&points[a]).total_cmp(&off(&points[b])));
    match far {
        Some(k) if off(&points[k]) > tolerance => {
            let mut line = simplified(&points[..=k], tolerance);
            line.pop();
            line.extend(simplified(&points[k..], tolerance));
            line
        }
        _ if points.len() == 1 => vec![first],
        _ => vec![first, last],
    }
}

/// The area of a brush as convex polygons, one a segment of its way.
fn brushed(points: &[[f64; 2]], radius: f64, tolerance: f64) -> Vec<Polygon> {
    let way = simplified(points, tolerance.max(0.05 * radius));
    let ends = match way.as_slice() {
        [only] => vec![(*only, *only)],
        way => way.windows(2).map(|pair| (pair[0], pair[1])).collect(),
    };
    let capsule = |(a, b): ([f64; 2], [f64; 2])| {
        let along = (b[1] - a[1]).atan2(b[0] - a[0]);
        let cap = |center: [f64; 2], start: f64| {
            (0..=CAP_CORNERS).map(move |k| {
                let angle = start + std::f64::consts::PI * k as f64 / CAP_CORNERS as f64;
                let round = |value: f64| (100.0 * value).round() / 100.0;
                [
                    round(center[0] + radius * angle.cos()),
                    round(center[1] + radius * angle.sin()),
                ]
            })
        };
        let quarter = std::f64::consts::FRAC_PI_2;
        cap(b, along - quarter)
            .chain(cap(a, along + quarter))
            .collect()
    };
    ends.into_iter().map(capsule).collect()
}

/// The polygons of a parameter.
pub(crate) fn polygons(edit: &Edit, name: &str) -> Vec<Polygon> {
    serde_json::from_value(edit.param(name).clone()).unwrap_or_default()
}

/// An edit with more polygons in a parameter.
pub(crate) fn with_polygons(edit: &Edit, name: &str, more: &[Polygon]) -> Edit {
    let mut all = polygons(edit, name);
    all.extend(more.iter().cloned());
    let value = if all.is_empty() {
        Value::Null
    } else {
        json!(all)
    };
    edit.with_param(name, value)
}

/// Draws polygons in a color.
pub(crate) fn paint(hand: &Hand<'_>, polygons: &[Polygon], color: Color32) {
    for polygon in polygons {
        let places = polygon.iter().map(|at| hand.view.to_screen(at[0], at[1]));
        let line = Stroke::new(1.5, color);
        hand.painter.add(Shape::closed_line(places.collect(), line));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simplified_lines_keep_corners_and_drop_what_lies_between() {
        let line: Polygon = (0..=20)
            .map(|k| [f64::from(k), 0.0])
            .chain((1..=10).map(|k| [20.0, f64::from(k)]))
            .collect();
        assert_eq!(
            simplified(&line, 0.5),
            [[0.0, 0.0], [20.0, 0.0], [20.0, 10.0]]
        );
        assert_eq!(simplified(&[[3.0, 4.0]], 0.5), [[3.0, 4.0]]);
    }

    #[test]
    fn brushed_areas_hold_the_disc_around_each_point() {
        let points = [[10.0, 10.0], [30.0, 10.0], [30.0, 40.0]];
        let polygons = brushed(&points, 5.0, 0.5);
        assert_eq!(polygons.len(), 2);
        let inside = |at: [f64; 2]| {
            polygons.iter().any(|polygon| {
                let places: Vec<Pos2> = polygon
                    .iter()
                    .map(|at| egui::pos2(at[0] as f32, at[1] as f32))
                    .collect();
                super::super::quad::contains(&places, egui::pos2(at[0] as f32, at[1] as f32))
            })
        };
        assert!(inside([20.0, 14.5]) && inside([34.4, 25.0]) && inside([30.0, 44.5]));
        assert!(!inside([20.0, 16.0]) && !inside([30.0, 46.0]));
    }
}
