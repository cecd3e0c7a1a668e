//! The legend of colors that stand for numbers, and the axes of the view.

use super::measure::number;
use super::orbit::MeshView;
use egui::{Align2, Color32, FontId, Mesh, Painter, Rect, Stroke, Ui, pos2, vec2};
use glam::DVec3;
use ravec::mesh_render::Legend;

/// Steps of the bar of colors.
const STEPS: usize = 64;

/// Size of the bar of colors in points.
const BAR: [f32; 2] = [16.0, 180.0];

/// Digits of the values at the bar.
const DIGITS: usize = 4;

/// Length of the axes in points.
const AXIS: f32 = 26.0;

/// Draws the scale of colors at the right side of the canvas.
pub(super) fn paint_legend(ui: &Ui, painter: &Painter, area: Rect, title: &str, legend: Legend) {
    let height = BAR[1].min(area.height() - 64.0);
    if height < 24.0 || area.width() < 120.0 {
        return;
    }
    let color = ui.visuals().strong_text_color();
    let font = FontId::proportional(13.0);
    let middle = 0.5 * (legend.low + legend.high);
    let labels: Vec<_> = [legend.high, middle, legend.low]
        .map(|value| painter.layout_no_wrap(number(value, DIGITS), font.clone(), color))
        .into();
    let title = painter.layout(title.to_owned(), font, color, 0.5 * area.width());
    let widest = labels
        .iter()
        .map(|label| label.size().x)
        .fold(0.0, f32::max);
    let width = (BAR[0] + 8.0 + widest).max(title.size().x);
    let top = pos2(area.right() - width - 16.0, area.top() + 16.0);
    let bar = Rect::from_min_size(top + vec2(0.0, title.size().y + 14.0), vec2(BAR[0], height));
    let back = Rect::from_min_max(top, pos2(top.x + width, bar.bottom())).expand(8.0);
    let shade = ui.visuals().window_fill().gamma_multiply(0.8);
    painter.rect_filled(back, 4.0, shade);
    painter.galley(top, title, color);
    let mut colors = Mesh::default();
    for step in 0..=STEPS {
        let share = step as f32 / STEPS as f32;
        let [r, g, b] = legend.map.color(f64::from(share));
        let y = bar.bottom() - share * bar.height();
        for x in [bar.left(), bar.right()] {
            colors.colored_vertex(pos2(x, y), Color32::from_rgb(r, g, b));
        }
        if step > 0 {
            let first = 2 * step as u32 - 2;
            colors.add_triangle(first, first + 1, first + 2);
            colors.add_triangle(first + 1, first + 3, first + 2);
        }
    }
    painter.add(colors);
    for (label, share) in labels.into_iter().zip([0.0, 0.5, 1.0]) {
        let y = bar.top() + share * bar.height();
        let tick = [pos2(bar.right(), y), pos2(bar.right() + 4.0, y)];
        painter.line_segment(tick, Stroke::new(1.0, color));
        let at = pos2(bar.right() + 8.0, y - 0.5 * label.size().y);
        painter.galley(at, label, color);
    }
}

/// Draws the directions of the axes at the lower left of the canvas.
pub(super) fn paint_axes(painter: &Painter, area: Rect, view: &MeshView) {
    if area.width() < 160.0 || area.height() < 160.0 {
        return;
    }
    let center = area.left_bottom() + vec2(44.0, -44.0);
    let [right, up, toward] = view.axes();
    let mut axes = [
        (DVec3::X, "X", Color32::from_rgb(214, 66, 62)),
        (DVec3::Y, "Y", Color32::from_rgb(84, 160, 60)),
        (DVec3::Z, "Z", Color32::from_rgb(70, 120, 224)),
    ];
    // what points to the eye is drawn last
    axes.sort_by(|a, b| a.0.dot(toward).total_cmp(&b.0.dot(toward)));
    for (axis, name, color) in axes {
        let along = vec2(axis.dot(right) as f32, -axis.dot(up) as f32);
        painter.line_segment([center, center + AXIS * along], Stroke::new(2.5, color));
        let at = center + (AXIS + 9.0) * along;
        painter.text(
            at,
            Align2::CENTER_CENTER,
            name,
            FontId::proportional(12.0),
            color,
        );
    }
}
