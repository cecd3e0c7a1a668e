//! Gestures of the tests.

use egui::Pos2;
use egui_kittest::Harness;

/// Presses the primary button at the first point and moves through the others, a frame each. The button stays down.
pub fn drag_through<S>(harness: &mut Harness<'_, S>, points: &[Pos2]) {
    harness.hover_at(points[0]);
    harness.step();
    harness.drag_at(points[0]);
    harness.step();
    for &point in &points[1..] {
        harness.hover_at(point);
        harness.step();
    }
}
