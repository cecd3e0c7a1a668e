//! Measuring between two points of the surface.

use super::orbit::MeshView;
use egui::{Align2, Color32, FontId, Painter, Pos2, Stroke, vec2};
use glam::DVec3;

/// Distance in points up to which a click takes the corner of a triangle.
const SNAP: f32 = 8.0;

/// Digits of lengths.
const DIGITS: usize = 6;

const COLOR: Color32 = Color32::from_rgb(255, 190, 40);

/// The distance between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The point that was clicked first.
    pub from: DVec3,
    /// The point that was clicked last.
    pub to: DVec3,
}

impl Measured {
    /// From the first to the last point.
    pub fn delta(&self) -> DVec3 {
        self.to - self.from
    }

    /// The distance, in units of the file.
    pub fn distance(&self) -> f64 {
        self.delta().length()
    }
}

/// The points that were clicked.
#[derive(Debug, Clone, Default)]
pub(super) struct Measuring {
    points: Vec<DVec3>,
}

impl Measuring {
    /// Adds a point; after two it begins anew.
    pub fn add(&mut self, point: DVec3) {
        if self.points.len() == 2 {
            self.points.clear();
        }
        self.points.push(point);
    }

    pub fn clear(&mut self) {
        self.points.clear();
    }

    pub fn measured(&self) -> Option<Measured> {
        let &[from, to] = &self.points[..] else {
            return None;
        };
        Some(Measured { from, to })
    }

    /// Draws the points and the line; `next` is where a click would add one.
    pub fn paint(&self, painter: &Painter, view: &MeshView, next: Option<DVec3>) {
        let shade = Stroke::new(4.0, Color32::from_black_alpha(140));
        let line = Stroke::new(2.0, COLOR);
        let to = match self.points[..] {
            [_, to] => Some(to),
            [_] => next,
            _ => None,
        };
        if let (Some(&from), Some(to)) = (self.points.first(), to) {
            let ends = [view.project(from), view.project(to)];
            if let [Some(a), Some(b)] = ends {
                painter.line_segment([a, b], shade);
                painter.line_segment([a, b], line);
                paint_label(painter, [a, b], &Measured { from, to });
            }
        }
        for &point in self.points.iter().chain(&next) {
            if let Some(at) = view.project(point) {
                painter.circle(at, 4.0, COLOR, Stroke::new(1.0, Color32::BLACK));
            }
        }
    }
}

fn paint_label(painter: &Painter, [a, b]: [Pos2; 2], measured: &Measured) {
    let delta = measured.delta();
    let text = format!(
        "{}\ndx {}  dy {}  dz {}",
        number(measured.distance(), DIGITS),
        number(delta.x, DIGITS),
        number(delta.y, DIGITS),
        number(delta.z, DIGITS)
    );
    let text = painter.layout_no_wrap(text, FontId::proportional(13.0), Color32::WHITE);
    // beside the line, on the side that it does not go to
    let falls = (b - a).x * (b - a).y > 0.0;
    let (anchor, up) = if falls {
        (Align2::LEFT_BOTTOM, -8.0)
    } else {
        (Align2::LEFT_TOP, 8.0)
    };
    let place = anchor.anchor_size(a + 0.5 * (b - a) + vec2(10.0, up), text.size());
    // the label stays within the canvas
    let room = painter.clip_rect().shrink(6.0);
    let shift = vec2(
        (room.right() - place.right()).min(0.0),
        (room.bottom() - place.bottom()).min(0.0) + (room.top() - place.top()).max(0.0),
    );
    let place = place.translate(shift);
    painter.rect_filled(place.expand(4.0), 3.0, Color32::from_black_alpha(180));
    painter.galley(place.min, text, Color32::WHITE);
}

/// Places on the screen about the cursor, whose triangles may have a corner near it.
pub(super) fn around(at: Pos2) -> impl Iterator<Item = Pos2> {
    let reach = 0.75 * SNAP;
    let steps = [0.0, -reach, reach];
    steps
        .into_iter()
        .flat_map(move |x| steps.map(|y| at + vec2(x, y)))
}

/// The corner that is nearest to the cursor on the screen, if one is near.
pub(super) fn snapped(
    corners: impl Iterator<Item = DVec3>,
    view: &MeshView,
    at: Pos2,
) -> Option<DVec3> {
    let near = corners.filter_map(|corner| Some((view.project(corner)?.distance(at), corner)));
    let (distance, corner) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
    (distance <= SNAP).then_some(corner)
}

/// A number, rounded to a number of digits that count.
pub(super) fn number(x: f64, digits: usize) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    let power = x.abs().log10().floor();
    let decimals = digits.saturating_sub(1);
    if !(-4.0..9.0).contains(&power) {
        return format!("{x:.decimals$e}");
    }
    let decimals = (decimals as f64 - power).max(0.0) as usize;
    let text = format!("{x:.decimals$}");
    if decimals == 0 {
        return text;
    }
    let text = text.trim_end_matches('0').trim_end_matches('.');
    text.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_count() {
        for (x, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (-0.5, "-0.5"),
            (1.0 / 3.0, "0.333333"),
            (12_345.678, "12345.7"),
            (1e6, "1000000"),
            (1.5e-7, "1.50000e-7"),
            (2e12, "2.00000e12"),
        ] {
            assert_eq!(number(x, 6), text);
        }
        assert_eq!(number(-0.0069617, 3), "-0.00696");
        assert_eq!(number(1234.5, 1), "1234");
    }

    #[test]
    fn a_third_point_begins_anew() {
        let mut measuring = Measuring::default();
        assert_eq!(measuring.measured(), None);
        measuring.add(DVec3::ZERO);
        measuring.add(DVec3::new(3.0, 4.0, 0.0));
        let measured = measuring.measured().unwrap();
        assert_eq!(measured.distance(), 5.0);
        assert_eq!(measured.delta(), DVec3::new(3.0, 4.0, 0.0));
        measuring.add(DVec3::ONE);
        assert_eq!(measuring.measured(), None);
    }
}
