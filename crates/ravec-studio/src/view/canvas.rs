//! The canvas: a picture that is zoomed and panned, uploaded in tiles as they are seen.

use crate::shown::{Shown, ShownLevel};
use egui::{
    Color32, ColorImage, Pos2, Rect, Response, Sense, TextureHandle, TextureOptions, Ui, Vec2,
    pos2, vec2,
};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

/// Side of a tile in pixels.
const TILE: usize = 512;

/// Tiles that are uploaded in one frame: more would be felt.
const UPLOADS: usize = 6;

/// Range of the zoom, in screen pixels a pixel.
const ZOOM: [f32; 2] = [1.0 / 256.0, 64.0];

/// Zoom from which the borders of pixels are drawn.
const GRID_ZOOM: f32 = 12.0;

/// Transform between the picture and the screen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Screen points a pixel of the picture.
    pub zoom: f32,
    /// Screen position of the upper left corner of the picture.
    pub origin: Pos2,
}

impl View {
    /// The screen position of a point of the picture.
    pub fn to_screen(self, x: f64, y: f64) -> Pos2 {
        self.origin + vec2(x as f32, y as f32) * self.zoom
    }

    /// The point of the picture at a screen position.
    pub fn to_picture(self, at: Pos2) -> [f64; 2] {
        let place = (at - self.origin) / self.zoom;
        [f64::from(place.x), f64::from(place.y)]
    }

    /// The same view, zoomed by a factor so that the point below `at` stays.
    #[must_use]
    pub fn zoomed(self, factor: f32, at: Pos2) -> Self {
        let zoom = (self.zoom * factor).clamp(ZOOM[0], ZOOM[1]);
        let origin = at + (self.origin - at) * (zoom / self.zoom);
        Self { zoom, origin }
    }

    /// The view that shows a whole picture in a part of the screen.
    pub fn fit(size: [usize; 2], area: Rect) -> Self {
        let size = vec2(size[0] as f32, size[1] as f32);
        let zoom = (area.size() / size).min_elem().clamp(ZOOM[0], ZOOM[1]) * 0.96;
        Self {
            zoom,
            origin: area.center() - 0.5 * zoom * size,
        }
    }
}

/// The state of a canvas.
#[derive(Default)]
pub struct Canvas {
    view: Option<View>,
    /// True once the view was moved by hand: it is no longer fit to the picture.
    moved: bool,
    shown: Option<Arc<Shown>>,
    tiles: HashMap<(usize, usize, usize), TextureHandle>,
}

impl Canvas {
    /// The transform, once something is shown.
    pub fn view(&self) -> Option<View> {
        self.view
    }

    /// Shows the whole picture again.
    pub fn fit(&mut self) {
        self.moved = false;
    }

    /// Shows one pixel of the picture as one of the screen, about the middle of what is seen.
    pub fn one_to_one(&mut self, area: Rect) {
        if let Some(view) = self.view {
            self.view = Some(view.zoomed(1.0 / view.zoom, area.center()));
            self.moved = true;
        }
    }

    /// Draws the picture, and moves it with the wheel and the middle button, or any button while space is held.
    pub fn ui(&mut self, ui: &mut Ui, shown: Option<&Arc<Shown>>) -> Response {
        let area = ui.available_rect_before_wrap();
        let response = ui.allocate_rect(area, Sense::click_and_drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Canvas"));
        let painter = ui.painter_at(area);
        painter.rect_filled(area, 0.0, ui.visuals().extreme_bg_color);
        self.take(shown);
        let Some(shown) = self.shown.clone() else {
            return response;
        };
        // nothing moves under a hand that holds something
        let held = ui.input(|input| input.pointer.any_down() || input.pointer.any_released());
        let fit = View::fit(shown.size(), area);
        let mut view = match self.view {
            Some(view) if self.moved || held => view,
            _ => fit,
        };
        let space = ui.input(|input| input.key_down(egui::Key::Space));
        let middle = response.dragged_by(egui::PointerButton::Middle);
        if middle || (space && response.dragged()) {
            view.origin += response.drag_delta();
            self.moved = true;
        }
        if let Some(at) = response.hover_pos() {
            let (scroll, pinch) =
                ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
            let factor = pinch * (scroll * 0.004).exp();
            if factor != 1.0 {
                view = view.zoomed(factor, at);
                self.moved = true;
            }
        }
        self.view = Some(view);
        self.paint(ui, &painter, &shown, view, area);
        response
    }

    /// Drops the tiles of another picture.
    fn take(&mut self, shown: Option<&Arc<Shown>>) {
        let same = match (&self.shown, shown) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => true,
            _ => false,
        };
        if !same {
            self.tiles.clear();
            self.shown = shown.cloned();
        }
    }

    fn paint(&mut self, ui: &Ui, painter: &egui::Painter, shown: &Shown, view: View, area: Rect) {
        let pixels = ui.ctx().pixels_per_point();
        let index = shown.level_for(view.zoom * pixels);
        let level = &shown.levels[index];
        let scale = view.zoom * (1u32 << index) as f32;
        let mut uploads = 0;
        for top in (0..level.height).step_by(TILE) {
            for left in (0..level.width).step_by(TILE) {
                let width = TILE.min(level.width - left);
                let height = TILE.min(level.height - top);
                let place = Rect::from_min_size(
                    view.origin + scale * vec2(left as f32, top as f32),
                    scale * vec2(width as f32, height as f32),
                );
                if !place.intersects(area) {
                    continue;
                }
                let key = (index, left, top);
                let tile = match self.tiles.entry(key) {
                    Entry::Occupied(tile) => tile.into_mut(),
                    Entry::Vacant(_) if uploads == UPLOADS => {
                        ui.ctx().request_repaint();
                        continue;
                    }
                    Entry::Vacant(tile) => {
                        uploads += 1;
                        tile.insert(upload(ui, level, key, [width, height]))
                    }
                };
                let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
                painter.image(tile.id(), place, whole, Color32::WHITE);
            }
        }
        if view.zoom >= GRID_ZOOM {
            paint_pixel_grid(painter, shown, view, area);
        }
    }
}

/// Brings a tile of a level to the screen.
fn upload(
    ui: &Ui,
    level: &ShownLevel,
    (index, left, top): (usize, usize, usize),
    [width, height]: [usize; 2],
) -> TextureHandle {
    let mut colors = Vec::with_capacity(width * height);
    for row in top..top + height {
        let row = &level.pixels[row * level.width + left..][..width];
        colors.extend(
            row.iter()
                .map(|&[r, g, b, a]| Color32::from_rgba_unmultiplied(r, g, b, a)),
        );
    }
    let options = TextureOptions {
        magnification: egui::TextureFilter::Nearest,
        ..TextureOptions::LINEAR
    };
    let name = format!("tile {index} {left} {top}");
    let image = ColorImage::new([width, height], colors);
    ui.ctx().load_texture(name, image, options)
}

/// Lines between the pixels.
fn paint_pixel_grid(painter: &egui::Painter, shown: &Shown, view: View, area: Rect) {
    let [width, height] = shown.size();
    let stroke = egui::Stroke::new(1.0, Color32::from_black_alpha(60));
    let low = view.to_picture(area.min);
    let high = view.to_picture(area.max);
    let range = |low: f64, high: f64, end: usize| {
        (low.max(0.0) as usize)..=(high.max(0.0).ceil() as usize).min(end)
    };
    let picture = Rect::from_two_pos(
        view.to_screen(0.0, 0.0),
        view.to_screen(width as f64, height as f64),
    );
    for col in range(low[0], high[0], width) {
        let x = view.to_screen(col as f64, 0.0).x;
        painter.vline(x, picture.y_range(), stroke);
    }
    for row in range(low[1], high[1], height) {
        let y = view.to_screen(0.0, row as f64).y;
        painter.hline(picture.x_range(), y, stroke);
    }
}

/// The distance between two screen positions.
pub fn distance(a: Pos2, b: Pos2) -> f32 {
    Vec2::length(a - b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zooming_keeps_the_point_below_the_cursor() {
        let view = View {
            zoom: 0.5,
            origin: pos2(10.0, 20.0),
        };
        let at = pos2(110.0, 70.0);
        let before = view.to_picture(at);
        let after = view.zoomed(3.0, at);
        assert!((after.zoom - 1.5).abs() < 1e-6);
        let found = after.to_picture(at);
        assert!((found[0] - before[0]).abs() < 1e-3 && (found[1] - before[1]).abs() < 1e-3);
    }

    #[test]
    fn a_fit_shows_the_whole_picture() {
        let area = Rect::from_min_max(pos2(100.0, 50.0), pos2(500.0, 350.0));
        let view = View::fit([4000, 3000], area);
        assert!(
            area.contains(view.to_screen(0.0, 0.0))
                && area.contains(view.to_screen(4000.0, 3000.0))
        );
    }
}
