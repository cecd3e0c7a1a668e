//! Quadrilaterals under the hand: corners and sides are dragged, a grid in perspective is drawn.

use super::Hand;
use crate::view::canvas::{View, distance};
use egui::{Color32, Painter, Pos2, Stroke};
use ravec::planar::Homography;

/// Distance from a corner or side within which it is taken, in screen points.
const REACH: f32 = 14.0;

/// Four corners in turn, in pixels.
pub(crate) type Corners = [[f64; 2]; 4];

/// A part of a quadrilateral in the hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Grip {
    /// A corner.
    Corner(usize),
    /// The side from a corner to the next.
    Side(usize),
    /// All of it.
    Inside,
}

/// Follows the hand that moves quadrilaterals.
#[derive(Default)]
pub(crate) struct QuadHandle {
    held: Option<(usize, Grip, [f64; 2], Corners)>,
}

/// A quadrilateral that was moved.
pub(crate) struct Moved {
    pub index: usize,
    pub corners: Corners,
    pub goes_on: bool,
}

impl QuadHandle {
    /// Holds nothing.
    pub const EMPTY: Self = Self { held: None };

    /// True while something is held.
    pub fn holds(&self) -> bool {
        self.held.is_some()
    }

    /// The motion of one of the quadrilaterals in this frame.
    pub fn follow(&mut self, hand: &Hand<'_>, quads: &[Corners]) -> Option<Moved> {
        if hand.pans() {
            return None;
        }
        if let Some(from) = hand.pressed() {
            let at = hand.view.to_screen(from[0], from[1]);
            let found = quads.iter().enumerate().find_map(|(index, corners)| {
                Some((index, grip(hand.view, corners, at)?, from, *corners))
            });
            self.held = found;
        }
        let (index, grip, from, start) = self.held?;
        let at = hand.response.interact_pointer_pos()?;
        let goes_on = hand.response.dragged();
        if !goes_on {
            self.held = None;
        }
        let at = hand.view.to_picture(at);
        let shift = [at[0] - from[0], at[1] - from[1]];
        let mut corners = start;
        let moved: &[usize] = match grip {
            Grip::Corner(k) => &[k],
            Grip::Side(k) => &[k, (k + 1) % 4],
            Grip::Inside => &[0, 1, 2, 3],
        };
        for &k in moved {
            corners[k] = [start[k][0] + shift[0], start[k][1] + shift[1]];
        }
        Some(Moved {
            index,
            corners,
            goes_on,
        })
    }
}

/// The part of a quadrilateral at a screen position.
pub(crate) fn grip(view: View, corners: &Corners, at: Pos2) -> Option<Grip> {
    let places = corners.map(|[x, y]| view.to_screen(x, y));
    if let Some(k) = (0..4).find(|&k| distance(places[k], at) < REACH) {
        return Some(Grip::Corner(k));
    }
    let near = |k: usize| {
        let (a, b) = (places[k], places[(k + 1) % 4]);
        let along = b - a;
        let share = ((at - a).dot(along) / along.length_sq().max(1e-6)).clamp(0.0, 1.0);
        distance(a + share * along, at) < 0.5 * REACH
    };
    if let Some(k) = (0..4).find(|&k| near(k)) {
        return Some(Grip::Side(k));
    }
    contains(&places, at).then_some(Grip::Inside)
}

/// True if a point lies in a polygon.
pub(crate) fn contains(places: &[Pos2], at: Pos2) -> bool {
    let mut inside = false;
    for (k, a) in places.iter().enumerate() {
        let b = places[(k + 1) % places.len()];
        if (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x) {
            inside = !inside;
        }
    }
    inside
}

/// The corners as a homography maps them.
pub(crate) fn mapped(corners: &Corners, map: &Homography) -> Corners {
    corners.map(|corner| {
        let at = map.apply(corner.into());
        [at.x, at.y]
    })
}

/// Draws a quadrilateral with a grid of columns and rows, and its corners if it has handles.
pub(crate) fn paint(
    painter: &Painter,
    view: View,
    corners: &Corners,
    [columns, rows]: [u32; 2],
    color: Color32,
    handles: bool,
) {
    if let Ok(image_from_unit) = Homography::from_unit_square(corners.map(Into::into)) {
        let place = |x: f64, y: f64| {
            let point = image_from_unit.apply((x, y).into());
            view.to_screen(point.x, point.y)
        };
        let thin = Stroke::new(1.0, color.gamma_multiply(0.6));
        for k in 1..columns {
            let share = f64::from(k) / f64::from(columns);
            painter.line_segment([place(share, 0.0), place(share, 1.0)], thin);
        }
        for k in 1..rows {
            let share = f64::from(k) / f64::from(rows);
            painter.line_segment([place(0.0, share), place(1.0, share)], thin);
        }
    }
    let places = corners.map(|[x, y]| view.to_screen(x, y));
    for k in 0..4 {
        let side = [places[k], places[(k + 1) % 4]];
        painter.line_segment(side, Stroke::new(1.5, color));
        if handles {
            painter.circle_filled(places[k], 5.0, color);
        }
    }
}

/// Corners from the text of a parameter, such as `0,0,10,0,10,10,0,10`.
pub(crate) fn read(text: &str) -> Option<Corners> {
    let numbers = text.split(',').map(|number| number.trim().parse());
    let numbers: Vec<f64> = numbers.collect::<Result<_, _>>().ok()?;
    let numbers: [f64; 8] = numbers.try_into().ok()?;
    Some(std::array::from_fn(|k| {
        [numbers[2 * k], numbers[2 * k + 1]]
    }))
}

/// Corners as the text of a parameter.
pub(crate) fn text(corners: &Corners) -> String {
    let numbers = corners.iter().flatten();
    let numbers: Vec<String> = numbers.map(|number| format!("{number:.3}")).collect();
    numbers.join(",")
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::pos2;

    #[test]
    fn corners_come_before_sides_and_these_before_the_inside() {
        let view = View {
            zoom: 1.0,
            origin: pos2(0.0, 0.0),
        };
        let corners = [[0.0, 0.0], [100.0, 0.0], [100.0, 80.0], [0.0, 80.0]];
        let at = |x, y| grip(view, &corners, pos2(x, y));
        assert_eq!(at(98.0, 3.0), Some(Grip::Corner(1)));
        assert_eq!(at(50.0, 82.0), Some(Grip::Side(2)));
        assert_eq!(at(50.0, 40.0), Some(Grip::Inside));
        assert_eq!(at(150.0, 40.0), None);
    }

    #[test]
    fn corners_are_read_as_they_are_written() {
        let corners = [[0.5, 1.25], [100.0, 0.0], [100.0, -80.0], [0.0, 80.125]];
        assert_eq!(read(&text(&corners)), Some(corners));
        assert_eq!(read("1,2,3"), None);
    }
}
