//! Marked places, drawn over the picture so that those behind the surface are found, too.

use super::orbit::MeshView;
use super::{MarkedPlace, ShownMesh};
use egui::{Color32, Painter, Stroke};
use glam::DVec3;

/// Places that are drawn: more would hide the mesh, and be felt.
const MAX_DRAWN: usize = 2000;

const COLOR: Color32 = Color32::from_rgb(226, 32, 44);

/// Draws the marked places of a mesh: points as rings, and the rest as faint lines.
pub(super) fn paint_marks(painter: &Painter, view: &MeshView, shown: &ShownMesh) {
    let faint = Stroke::new(1.0, COLOR.gamma_multiply(0.5));
    let strong = Stroke::new(2.0, COLOR);
    let line = |ends: [DVec3; 2], stroke: Stroke| {
        if let [Some(a), Some(b)] = ends.map(|end| view.project(end)) {
            painter.line_segment([a, b], stroke);
        }
    };
    let positions = shown.mesh.positions();
    for place in shown.marked.iter().take(MAX_DRAWN) {
        match *place {
            MarkedPlace::Point(point) => {
                if let Some(at) = view.project(point) {
                    painter.circle_stroke(at, 6.0, strong);
                }
            }
            MarkedPlace::Segment(ends) => line(ends, strong),
            MarkedPlace::Edge(edge) => {
                let ends = edge.map(|vertex| positions.get(vertex as usize).copied());
                if let [Some(a), Some(b)] = ends {
                    line([a, b], faint);
                }
            }
            MarkedPlace::Triangle(triangle) => {
                if let Some([a, b, c]) = shown.corners(triangle) {
                    for ends in [[a, b], [b, c], [c, a]] {
                        line(ends, faint);
                    }
                }
            }
        }
    }
}
