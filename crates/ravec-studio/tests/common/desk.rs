//! A studio without a window, driven by clicks and drags.

use egui::{Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use ravec_studio::Studio;
use std::time::{Duration, Instant};

/// A bound on the time that background work may take, far beyond what it takes.
pub const HANG: Duration = Duration::from_mins(1);

/// Lets the studio run until nothing is going on.
pub fn settle(harness: &mut Harness<'_, Studio>) {
    let start = Instant::now();
    let mut quiet = 0;
    while quiet < 4 {
        harness.step();
        if harness.state().is_busy() {
            quiet = 0;
            std::thread::sleep(Duration::from_millis(5));
        } else {
            quiet += 1;
        }
        assert!(start.elapsed() < HANG, "the studio hangs");
    }
}

pub fn click(harness: &mut Harness<'_, Studio>, label: &str) {
    harness.get_by_label(label).click();
    settle(harness);
}

pub fn drag(harness: &mut Harness<'_, Studio>, points: &[Pos2]) {
    super::common::drag_through(harness, points);
    harness.drop_at(points[points.len() - 1]);
    settle(harness);
}

/// The screen position of a point of a picture that is fit into the canvas.
pub fn on_screen(harness: &Harness<'_, Studio>, x: f32, y: f32) -> Pos2 {
    let area = harness.get_by_label("Canvas").rect();
    let size = size(harness);
    let size = Vec2::new(size[0] as f32, size[1] as f32);
    let zoom = (area.size() / size).min_elem() * 0.96;
    area.center() + zoom * (Vec2::new(x, y) - 0.5 * size)
}

pub fn size(harness: &Harness<'_, Studio>) -> [usize; 2] {
    harness
        .state()
        .snapshot()
        .unwrap()
        .shown()
        .unwrap()
        .clone()
        .size()
}
