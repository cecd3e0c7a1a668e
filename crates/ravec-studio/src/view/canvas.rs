//! The canvas: a picture that is zoomed and panned, uploaded in tiles as they are seen.

use super::tiler::Tiler;
use crate::shown::{Shown, TileIndex};
use egui::{Color32, Pos2, Rect, Response, Sense, Ui, Vec2, pos2, vec2};
use std::collections::HashMap;
use std::sync::Arc;

/// Range of the zoom, in screen pixels a pixel.
const ZOOM: [f32; 2] = [1.0 / 256.0, 64.0];

/// Zoom from which the values of pixels are written into them.
const VALUES_ZOOM: f32 = 48.0;

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

/// Comparison of a result with its source.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Comparison {
    /// The result alone.
    #[default]
    Off,
    /// The source on the left of a line, at this share of the width.
    Wipe(f32),
    /// Both beside one another, in one view.
    SideBySide,
}

/// Pictures of a canvas.
#[derive(Default)]
pub struct Layers<'a> {
    /// The result.
    pub shown: Option<&'a Arc<Shown>>,
    /// A quick result of a part of it: left, top, columns and rows.
    pub patch: Option<(&'a Arc<Shown>, [f64; 4])>,
    /// The source.
    pub before: Option<&'a Arc<Shown>>,
}

/// The state of a canvas.
#[derive(Default)]
pub struct Canvas {
    view: Option<View>,
    /// True once the view was moved by hand: it is no longer fit to the picture.
    moved: bool,
    /// The way in which the result is compared with its source.
    pub comparison: Comparison,
    /// True while the line of a wipe is held.
    wipes: bool,
    shown: Option<Arc<Shown>>,
    tiler: Tiler,
    /// Tiles that were seen in the last frame.
    seen: Vec<SeenTile>,
    /// Sizes of the last pictures, and the states of their tiles that were drawn last.
    drawn: [Drawn; 3],
}

/// A tile of a layer in the last frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenTile {
    /// Number of the layer: the result, the part that is drawn over it, the source.
    pub slot: usize,
    /// The tile.
    pub tile: TileIndex,
    /// True for one of the size that suits the zoom, false for a coarse one below.
    pub is_fine: bool,
    /// The state that is to be shown.
    pub wanted: u64,
    /// The state that was drawn.
    pub drawn: Option<u64>,
}

/// Tiles of a layer that were drawn last.
#[derive(Default)]
struct Drawn {
    size: [usize; 2],
    stamps: HashMap<TileIndex, u64>,
    /// Tiles of the last picture that was drawn whole, with their places as shares of it: they stand for a picture of another size
    /// whose tiles are not there yet.
    last: Vec<((u64, TileIndex), Rect)>,
    /// Size of that picture.
    last_size: [usize; 2],
}

/// A layer as it is painted.
struct Layer<'a> {
    slot: usize,
    shown: &'a Arc<Shown>,
    /// Screen rectangle of the whole picture.
    place: Rect,
    /// Part of the screen that it may paint.
    clip: Rect,
}

impl Canvas {
    /// The transform, once something is shown.
    pub fn view(&self) -> Option<View> {
        self.view
    }

    /// True while tiles are seen that are not there yet.
    pub fn is_busy(&self) -> bool {
        self.tiler.is_busy()
    }

    /// Tiles that were seen in the last frame.
    pub fn seen(&self) -> &[SeenTile] {
        &self.seen
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

    /// Draws the pictures, and moves them with the wheel and the middle button, or any button while space is held.
    pub fn ui(&mut self, ui: &mut Ui, layers: &Layers<'_>) -> Response {
        self.ui_named(ui, layers, "Canvas")
    }

    /// As [`ui`](Self::ui), with an accessible name of its own.
    pub fn ui_named(&mut self, ui: &mut Ui, layers: &Layers<'_>, name: &str) -> Response {
        let whole = ui.available_rect_before_wrap();
        let response = ui.allocate_rect(whole, Sense::click_and_drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, name));
        ui.painter_at(whole)
            .rect_filled(whole, 0.0, ui.visuals().extreme_bg_color);
        self.seen.clear();
        self.shown = layers.shown.cloned();
        let Some(shown) = layers.shown else {
            return response;
        };
        // the right half is the result, where both are beside one another
        let mut area = whole;
        if self.comparison == Comparison::SideBySide && layers.before.is_some() {
            area.min.x = whole.center().x;
        }
        let view = self.moved_view(ui, &response, shown.size(), area);
        self.view = Some(view);
        self.tiler.begin(ui.ctx());
        let place = |size: [usize; 2], shift: Vec2| {
            let size = vec2(size[0] as f32, size[1] as f32);
            Rect::from_min_size(view.origin + shift, view.zoom * size)
        };
        let clip = area;
        let own = place(shown.size(), Vec2::ZERO);
        self.paint(
            ui,
            &Layer {
                slot: 0,
                shown,
                place: own,
                clip,
            },
        );
        if let Some((patch, [x, y, width, height])) = layers.patch {
            let place =
                Rect::from_two_pos(view.to_screen(x, y), view.to_screen(x + width, y + height));
            self.paint(
                ui,
                &Layer {
                    slot: 1,
                    shown: patch,
                    place,
                    clip,
                },
            );
        }
        if let Some(before) = layers.before {
            let (shift, clip) = match self.comparison {
                Comparison::Off => (Vec2::ZERO, Rect::NOTHING),
                Comparison::SideBySide => {
                    let half = vec2(whole.center().x - whole.left(), 0.0);
                    (
                        -half,
                        Rect::from_min_max(whole.min, pos2(area.left(), whole.bottom())),
                    )
                }
                Comparison::Wipe(share) => {
                    let x = self.wiped(ui, &response, share);
                    (
                        Vec2::ZERO,
                        Rect::from_min_max(whole.min, pos2(x, whole.bottom())),
                    )
                }
            };
            if clip.is_positive() {
                let place = place(before.size(), shift);
                self.paint(
                    ui,
                    &Layer {
                        slot: 2,
                        shown: before,
                        place,
                        clip,
                    },
                );
                let line = egui::Stroke::new(1.0, Color32::WHITE);
                ui.painter_at(whole)
                    .vline(clip.right(), whole.y_range(), line);
            }
        }
        self.tiler.end(ui.ctx());
        let painter = ui.painter_at(area);
        if view.zoom >= GRID_ZOOM {
            paint_pixel_grid(&painter, shown, view, area);
        }
        if view.zoom >= VALUES_ZOOM {
            paint_values(&painter, shown, view, area);
        }
        response
    }

    /// The view after the motions of this frame.
    fn moved_view(&mut self, ui: &Ui, response: &Response, size: [usize; 2], area: Rect) -> View {
        // nothing moves under a hand that holds something
        let held = ui.input(|input| input.pointer.any_down() || input.pointer.any_released());
        let fit = View::fit(size, area);
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
            let (scroll, pinch) = ui.input(|input| {
                // the wheel with a key belongs to the tools
                let plain = input.modifiers.is_none() || input.modifiers.command;
                let scroll = if plain {
                    input.smooth_scroll_delta().y
                } else {
                    0.0
                };
                (scroll, input.zoom_delta())
            });
            let factor = pinch * (scroll * 0.004).exp();
            if factor != 1.0 {
                view = view.zoomed(factor, at);
                self.moved = true;
            }
        }
        view
    }

    /// The screen column of the line of a wipe, which is dragged.
    fn wiped(&mut self, ui: &Ui, response: &Response, share: f32) -> f32 {
        let area = response.rect;
        let mut x = area.left() + share * area.width();
        let near = |at: Pos2| (at.x - x).abs() < 8.0;
        if response.hover_pos().is_some_and(near) {
            ui.ctx().set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
        }
        if response.drag_started() {
            let origin = ui.input(|input| input.pointer.press_origin());
            self.wipes = origin.is_some_and(near);
        }
        if self.wipes
            && let Some(at) = response.interact_pointer_pos()
        {
            x = at.x.clamp(area.left(), area.right());
            self.comparison = Comparison::Wipe((x - area.left()) / area.width().max(1.0));
            self.wipes = response.dragged();
        }
        x
    }

    /// True while the hand holds the line of a wipe: tools rest.
    pub fn is_held(&self) -> bool {
        self.wipes
    }

    fn paint(&mut self, ui: &Ui, layer: &Layer<'_>) {
        let Layer {
            slot,
            shown,
            place,
            clip,
        } = *layer;
        let painter = ui.painter_at(clip);
        let zoom = place.width() / shown.size()[0] as f32;
        let fine = shown.level_for(zoom * ui.ctx().pixels_per_point());
        if self.drawn[slot].size != shown.level_size(0) {
            self.drawn[slot].size = shown.level_size(0);
            self.drawn[slot].stamps.clear();
        }
        // the coarsest size lies below, for what is not there yet
        let coarse = shown.levels() - 1;
        let mut drawn = Vec::new();
        let mut is_whole = true;
        for level in [coarse, fine] {
            if level == fine {
                self.paint_last(&painter, slot, place);
            }
            let [width, height] = shown.level_size(level);
            let scale = place.size() / vec2(width as f32, height as f32);
            let [columns, rows] = shown.tiles(level);
            for (row, col) in (0..rows).flat_map(|row| (0..columns).map(move |col| (row, col))) {
                let tile = TileIndex { level, col, row };
                let [left, top, width, height] = shown.place(tile).map(|value| value as f32);
                let place = Rect::from_min_size(
                    place.min + scale * vec2(left, top),
                    scale * vec2(width, height),
                );
                if !place.intersects(clip) {
                    continue;
                }
                let stamps = &mut self.drawn[slot].stamps;
                let wanted = shown.stamp(tile);
                let texture = match self.tiler.texture(shown, tile) {
                    Some(texture) => {
                        stamps.insert(tile, wanted);
                        Some((texture, wanted))
                    }
                    None => stamps.get(&tile).and_then(|&stamp| {
                        self.tiler
                            .known((stamp, tile))
                            .map(|texture| (texture, stamp))
                    }),
                };
                self.seen.push(SeenTile {
                    slot,
                    tile,
                    is_fine: level == fine,
                    wanted,
                    drawn: texture.map(|(_, stamp)| stamp),
                });
                match texture {
                    Some((texture, stamp)) => {
                        painter.image(texture, place, WHOLE, Color32::WHITE);
                        drawn.push(((stamp, tile), shares(place, layer.place)));
                    }
                    None => is_whole &= level != fine,
                }
            }
            if coarse == fine {
                break;
            }
        }
        if is_whole {
            self.drawn[slot].last = drawn;
            self.drawn[slot].last_size = shown.level_size(0);
        }
    }

    /// Paints the last whole picture in the place of one of another size, whose tiles are not there yet.
    fn paint_last(&mut self, painter: &egui::Painter, slot: usize, place: Rect) {
        let drawn = &self.drawn[slot];
        if drawn.last_size == drawn.size {
            return;
        }
        for &((stamp, tile), shares) in &drawn.last {
            if let Some(texture) = self.tiler.known((stamp, tile)) {
                let at = |share: Pos2| place.min + share.to_vec2() * place.size();
                let place = Rect::from_min_max(at(shares.min), at(shares.max));
                painter.image(texture, place, WHOLE, Color32::WHITE);
                self.seen.push(SeenTile {
                    slot,
                    tile,
                    is_fine: false,
                    wanted: stamp,
                    drawn: Some(stamp),
                });
            }
        }
    }
}

/// All of a texture.
const WHOLE: Rect = Rect {
    min: pos2(0.0, 0.0),
    max: pos2(1.0, 1.0),
};

/// A part of a rectangle in shares of it.
fn shares(part: Rect, whole: Rect) -> Rect {
    let at = |corner: Pos2| ((corner - whole.min) / whole.size()).to_pos2();
    Rect::from_min_max(at(part.min), at(part.max))
}

/// The stored values of the pixels.
fn paint_values(painter: &egui::Painter, shown: &Shown, view: View, area: Rect) {
    let low = view.to_picture(area.min);
    let high = view.to_picture(area.max);
    let [width, height] = shown.size();
    let cols = low[0].max(0.0) as usize..(high[0].max(0.0).ceil() as usize).min(width);
    let font = egui::FontId::monospace(view.zoom / 7.0);
    for row in low[1].max(0.0) as usize..(high[1].max(0.0).ceil() as usize).min(height) {
        for col in cols.clone() {
            let (Some(values), Some([r, g, b, _])) =
                (shown.values(col, row), shown.pixel(col, row))
            else {
                continue;
            };
            let bright = 2 * u32::from(r) + 5 * u32::from(g) + u32::from(b) > 1000;
            let color = if bright {
                Color32::BLACK
            } else {
                Color32::WHITE
            };
            let at = view.to_screen(col as f64 + 0.5, row as f64 + 0.5);
            let text = values.replace(' ', "\n");
            painter.text(at, egui::Align2::CENTER_CENTER, text, font.clone(), color);
        }
    }
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
    fn shares_of_a_rectangle_are_those_of_its_sides() {
        let whole = Rect::from_min_max(pos2(10.0, 20.0), pos2(210.0, 120.0));
        let part = Rect::from_min_max(pos2(60.0, 20.0), pos2(110.0, 70.0));
        let expected = Rect::from_min_max(pos2(0.25, 0.0), pos2(0.5, 0.5));
        assert_eq!(shares(part, whole), expected);
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
