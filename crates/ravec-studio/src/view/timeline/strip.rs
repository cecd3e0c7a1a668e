//! The part of the timeline that is drawn: thumbnails, ruler, graphs, and what the hand drags on them.

use super::rows::{ROW_HEIGHT, TimelineRow};
use super::scale::Scale;
use super::{LONG_STEP, Timeline};
use crate::clip::{ClipFacts, ClipReader, Thumbnail, Thumbnails};
use egui::{
    Align2, Color32, ColorImage, CursorIcon, FontId, Id, Painter, Rect, Response, Sense, Stroke,
    TextureHandle, TextureOptions, Ui, pos2, vec2,
};
use std::collections::HashMap;
use std::sync::Arc;

/// Height of the thumbnails in points.
const THUMBNAIL_HEIGHT: f32 = 54.0;

/// Height of the ruler in points.
const RULER_HEIGHT: f32 = 20.0;

/// Width of a handle of the range in points.
const HANDLE: f32 = 9.0;

/// Thumbnails that are brought to the screen in one frame: more would be felt.
const UPLOADS: usize = 4;

const PLAYHEAD: Color32 = Color32::from_rgb(230, 70, 60);
const RANGE: Color32 = Color32::from_rgb(70, 140, 230);

/// State of the strip between frames of the window.
#[derive(Default)]
pub(super) struct Strip {
    /// The widget that has the keys of the timeline when it is focused.
    pub id: Option<Id>,
}

/// Thumbnails on the screen.
#[derive(Default)]
pub(super) struct Textures(HashMap<u64, (Arc<Thumbnail>, TextureHandle)>);

impl Textures {
    /// The texture of a thumbnail, unless it has to wait for the next frame.
    fn of(
        &mut self,
        ui: &Ui,
        thumbnail: &Arc<Thumbnail>,
        uploads: &mut usize,
    ) -> Option<&TextureHandle> {
        let known = self.0.get(&thumbnail.frame);
        if !known.is_some_and(|(known, _)| Arc::ptr_eq(known, thumbnail)) {
            if *uploads == UPLOADS {
                ui.ctx().request_repaint();
                return None;
            }
            *uploads += 1;
            let texture = upload(ui, thumbnail);
            self.0.insert(thumbnail.frame, (thumbnail.clone(), texture));
        }
        self.0.get(&thumbnail.frame).map(|(_, texture)| texture)
    }

    /// Drops the textures of thumbnails that are no more.
    fn retain(&mut self, made: &Thumbnails) {
        self.0.retain(|frame, _| made.contains(*frame));
    }
}

fn upload(ui: &Ui, thumbnail: &Thumbnail) -> TextureHandle {
    let level = &thumbnail.tile;
    let colors = level
        .pixels
        .iter()
        .map(|&[r, g, b, a]| Color32::from_rgba_unmultiplied(r, g, b, a))
        .collect();
    let image = ColorImage::new([level.width, level.height], colors);
    let name = format!("thumbnail {}", thumbnail.frame);
    ui.ctx().load_texture(name, image, TextureOptions::LINEAR)
}

/// The parts of the strip, from the top down.
struct Parts {
    whole: Rect,
    ruler: Rect,
    thumbnails: Rect,
    rows: Vec<Rect>,
}

impl Parts {
    fn of(whole: Rect, rows: usize) -> Self {
        let part = |top: f32, height: f32| {
            Rect::from_min_size(pos2(whole.left(), top), vec2(whole.width(), height))
        };
        let ruler = part(whole.top(), RULER_HEIGHT);
        let thumbnails = part(ruler.bottom(), THUMBNAIL_HEIGHT);
        let row = |k: usize| {
            let top = thumbnails.bottom() + 2.0 + k as f32 * (ROW_HEIGHT + 2.0);
            part(top, ROW_HEIGHT)
        };
        Self {
            whole,
            ruler,
            thumbnails,
            rows: (0..rows).map(row).collect(),
        }
    }
}

impl Timeline {
    /// Draws the strip; true while the hand drags something on it.
    pub(super) fn strip_ui(
        &mut self,
        ui: &mut Ui,
        reader: &ClipReader,
        facts: &ClipFacts,
        rows: &[TimelineRow<'_>],
    ) -> bool {
        let height = RULER_HEIGHT + THUMBNAIL_HEIGHT + rows.len() as f32 * (ROW_HEIGHT + 2.0) + 2.0;
        let size = vec2(ui.available_width().max(1.0), height);
        let (whole, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
        self.strip.id = Some(response.id);
        let parts = Parts::of(whole, rows.len());
        let mut scale = self.scale(whole, facts.frames, &response, ui);
        let drags_range = self.range_handles_ui(ui, &parts, &scale, facts.frames);
        self.drag_playhead(ui, &response, &scale);
        self.obey_screen_reader(ui, &response, facts);
        if !response.dragged() && !ui.input(|input| input.pointer.any_down()) {
            scale = self.keep_in_sight(scale);
        }
        if ui.is_rect_visible(whole) {
            self.paint(ui, reader, facts, rows, &parts, &scale);
        }
        let current = self.current;
        response.widget_info(|| {
            egui::WidgetInfo::slider(true, current as f64, "Playhead of the timeline")
        });
        let response = response.on_hover_cursor(CursorIcon::Default);
        let is_dragging = response.dragged() || drags_range;
        if let Some(at) = response.hover_pos().filter(|_| !is_dragging) {
            let frame = scale.frame_at(at.x);
            response.on_hover_ui_at_pointer(|ui| {
                ui.label(format!("Frame {frame}, {:.3} s", facts.seconds_at(frame)));
                for row in rows {
                    ui.label(row.describe(frame));
                }
            });
        }
        is_dragging
    }

    /// The scale, after the wheel.
    fn scale(&mut self, area: Rect, frames: u64, response: &Response, ui: &Ui) -> Scale {
        let mut scale = Scale::whole(area.left(), area.width(), frames);
        if let Some([first, seen]) = self.view {
            scale.seen = seen.clamp(1.0, frames as f64);
            scale = scale.from(first);
        }
        if let Some(at) = response.hover_pos() {
            let (scroll, pinch) =
                ui.input(|input| (input.smooth_scroll_delta(), input.zoom_delta()));
            let factor = f64::from(pinch * (scroll.y * 0.006).exp());
            if factor != 1.0 && factor.is_finite() {
                scale = scale.zoomed(factor, at.x);
            }
            if scroll.x != 0.0 {
                scale = scale.from(scale.first - f64::from(scroll.x) / scale.cell());
            }
        }
        self.remember(&scale);
        scale
    }

    fn remember(&mut self, scale: &Scale) {
        let whole = scale.seen >= scale.frames as f64;
        self.view = (!whole).then_some([scale.first, scale.seen]);
    }

    /// Scrolls to the playhead when it has moved out of sight.
    fn keep_in_sight(&mut self, scale: Scale) -> Scale {
        if self.asked == Some(self.current) {
            return scale;
        }
        let scale = scale.showing(self.current);
        self.remember(&scale);
        scale
    }

    /// The two ends of the range; true while one is dragged.
    fn range_handles_ui(&mut self, ui: &Ui, parts: &Parts, scale: &Scale, frames: u64) -> bool {
        let mut drags = false;
        for (is_end, name) in [(false, "In point"), (true, "Out point")] {
            let range = self.selection(frames);
            let (border, side) = if is_end {
                (range.end, 0.0)
            } else {
                (range.start, -HANDLE)
            };
            let x = scale.x_of(border as f64);
            if x < parts.whole.left() - 1.0 || x > parts.whole.right() + 1.0 {
                continue;
            }
            // handles at the ends of the strip stay in it
            let left = (x + side).clamp(parts.ruler.left(), parts.ruler.right() - HANDLE);
            let place =
                Rect::from_min_size(pos2(left, parts.ruler.top()), vec2(HANDLE, RULER_HEIGHT));
            let id = self.strip.id.unwrap_or(Id::NULL).with(name);
            let handle = ui
                .interact(place, id, Sense::click_and_drag())
                .on_hover_and_drag_cursor(CursorIcon::ResizeHorizontal);
            handle.widget_info(|| egui::WidgetInfo::slider(true, border as f64, name));
            if handle.dragged()
                && let Some(at) = handle.interact_pointer_pos()
            {
                drags = true;
                let border = scale.border_at(at.x);
                let range = if is_end {
                    range.start..border.max(range.start + 1)
                } else {
                    border.min(range.end.saturating_sub(1))..range.end
                };
                self.set_range(range, frames);
            }
        }
        drags
    }

    fn drag_playhead(&mut self, ui: &Ui, response: &Response, scale: &Scale) {
        let primary =
            response.is_pointer_button_down_on() && ui.input(|input| input.pointer.primary_down());
        let held = primary || response.clicked() || response.drag_stopped();
        if let Some(at) = response.interact_pointer_pos().filter(|_| held) {
            self.current = scale.frame_at(at.x);
            response.request_focus();
        }
        if response.has_focus() {
            // the arrows move the playhead, not the focus
            let filter = egui::EventFilter {
                horizontal_arrows: true,
                ..egui::EventFilter::default()
            };
            ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, filter));
        }
    }

    fn obey_screen_reader(&mut self, ui: &Ui, response: &Response, facts: &ClipFacts) {
        use egui::accesskit::{Action, ActionData};
        let (up, down, set) = ui.input(|input| {
            let count = |action| input.num_accesskit_action_requests(response.id, action) as u64;
            let set = input
                .accesskit_action_requests(response.id, Action::SetValue)
                .filter_map(|request| match request.data {
                    Some(ActionData::NumericValue(value)) => Some(value),
                    _ => None,
                })
                .last();
            (count(Action::Increment), count(Action::Decrement), set)
        });
        if up + down > 0 {
            self.current = self.current.saturating_add(up).min(facts.last());
            self.current = self.current.saturating_sub(down);
        }
        if let Some(value) = set {
            self.current = (value.max(0.0) as u64).min(facts.last());
        }
    }

    fn paint(
        &mut self,
        ui: &Ui,
        reader: &ClipReader,
        facts: &ClipFacts,
        rows: &[TimelineRow<'_>],
        parts: &Parts,
        scale: &Scale,
    ) {
        let painter = ui.painter_at(parts.whole);
        let visuals = ui.visuals();
        painter.rect_filled(parts.whole, 0.0, visuals.faint_bg_color);
        self.paint_thumbnails(ui, &painter, reader, facts, parts.thumbnails, scale);
        paint_ruler(ui, &painter, facts, parts.ruler, scale);
        for (row, area) in rows.iter().zip(&parts.rows) {
            row.paint(&painter, *area, scale, visuals);
        }
        let range = self.selection(facts.frames);
        let ends = [range.start, range.end].map(|end| scale.x_of(end as f64));
        let shade = Color32::from_black_alpha(120);
        let outside = [
            [parts.whole.left(), ends[0]],
            [ends[1], parts.whole.right()],
        ];
        for [left, right] in outside {
            if right > left {
                let area = Rect::from_x_y_ranges(left..=right, parts.whole.y_range());
                painter.rect_filled(area, 0.0, shade);
            }
        }
        for (x, side) in [(ends[0], -HANDLE), (ends[1], 0.0)] {
            let left = (x + side).clamp(parts.ruler.left(), parts.ruler.right() - HANDLE);
            let place =
                Rect::from_min_size(pos2(left, parts.ruler.top()), vec2(HANDLE, RULER_HEIGHT));
            painter.rect_filled(place, 2.0, RANGE);
            painter.vline(x, parts.whole.y_range(), Stroke::new(1.0, RANGE));
        }
        let x = scale.middle_of(self.current);
        if scale.cell() >= 4.0 {
            let cell = scale.x_of(self.current as f64)..=scale.x_of(self.current as f64 + 1.0);
            let cell = Rect::from_x_y_ranges(cell, parts.whole.y_range());
            painter.rect_filled(cell, 0.0, PLAYHEAD.gamma_multiply(0.25));
        }
        painter.vline(x, parts.whole.y_range(), Stroke::new(2.0, PLAYHEAD));
    }

    fn paint_thumbnails(
        &mut self,
        ui: &Ui,
        painter: &Painter,
        reader: &ClipReader,
        facts: &ClipFacts,
        area: Rect,
        scale: &Scale,
    ) {
        let [width, height] = facts.size.map(|side| side.max(1) as f32);
        let aspect = (width / height * facts.pixel_aspect.to_f64() as f32).clamp(0.25, 8.0);
        let slot = area.height() * aspect;
        let slots = (area.width() / slot).ceil().max(1.0);
        // places over the whole clip as dense as they are seen
        let zoom = (facts.frames as f64 / scale.seen).min(64.0);
        let made = reader.thumbnails((f64::from(slots) * zoom).ceil() as usize);
        self.textures.retain(&made);
        let mut uploads = 0;
        for k in 0..slots as usize {
            let left = area.left() + k as f32 * slot;
            let place = Rect::from_min_size(pos2(left, area.top()), vec2(slot, area.height()));
            let frame = scale.frame_at(place.center().x.min(area.right()));
            let Some(thumbnail) = made.nearest(frame) else {
                continue;
            };
            if let Some(texture) = self.textures.of(ui, thumbnail, &mut uploads) {
                let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
                painter.image(
                    texture.id(),
                    place.shrink2(vec2(0.5, 0.0)),
                    whole,
                    Color32::WHITE,
                );
            }
        }
    }
}

/// Labels in frames and seconds, and lines between them.
fn paint_ruler(ui: &Ui, painter: &Painter, facts: &ClipFacts, area: Rect, scale: &Scale) {
    let visuals = ui.visuals();
    painter.rect_filled(area, 0.0, visuals.extreme_bg_color);
    let step = scale.label_step();
    let visible = scale.visible();
    let color = visuals.text_color();
    let minor = if step.is_multiple_of(LONG_STEP) {
        step / LONG_STEP
    } else {
        1
    };
    let first = visible.start - visible.start % step;
    for frame in (first..visible.end).step_by(minor as usize) {
        let x = scale.x_of(frame as f64);
        let is_label = frame % step == 0;
        let top = area.bottom() - if is_label { 8.0 } else { 4.0 };
        painter.vline(
            x,
            top..=area.bottom(),
            Stroke::new(1.0, color.gamma_multiply(0.6)),
        );
        if is_label {
            let text = format!("{frame}  {:.2} s", facts.seconds_at(frame));
            let corner = pos2(x + 3.0, area.top() + 1.0);
            painter.text(
                corner,
                Align2::LEFT_TOP,
                text,
                FontId::proportional(10.5),
                color,
            );
        }
    }
}
