//! The widget.

use super::ShownMesh;
use super::gpu::{MeshGpu, Pictures};
use super::legend::{paint_axes, paint_legend};
use super::look::{Style, Wanted};
use super::marks::paint_marks;
use super::measure::{self, Measured, Measuring};
use super::options::{self, Command, MeshOptions};
use super::orbit::{MeshView, OrbitCamera};
use super::picker::{self, Picked, Picker};
use super::renderer::{Drawn, Renderer};
use egui::{
    Align2, Color32, ColorImage, EventFilter, FontId, ImageData, Key, Painter, PointerButton, Pos2,
    Rect, Response, Sense, TextureHandle, TextureOptions, Ui, Vec2, pos2, vec2,
};
use glam::DVec3;
use ravec::mesh::Aabb;
use std::sync::Arc;

/// Points of the wheel for a zoom by e.
const WHEEL: f32 = 250.0;

/// Points that an arrow key turns or moves the view by.
const KEY_STEP: f32 = 37.5;

/// Zoom of the keys plus and minus.
const KEY_ZOOM: f64 = 1.25;

/// Room around a place that the view flies to, as a multiple of its radius.
const ROOM: f64 = 3.0;

/// Radius of a place without one, as a share of the diagonal of what is shown.
const SMALL: f64 = 0.02;

/// A movement of the hand that is going on.
#[derive(Debug, Clone, Copy)]
enum Gesture {
    /// The view turns; where the hand was last.
    Orbit(Pos2),
    /// The point of the surface that follows the hand.
    Pan(DVec3),
}

/// Pictures that are made while the hand rests.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum AtRest {
    /// Fine ones.
    #[default]
    Fine,
    /// Drafts, as while the hand moves: the mesh is about to be replaced.
    Drafts,
}

/// Frames that the GPU draws.
#[derive(Default)]
struct GpuFrames {
    pictures: Pictures,
    /// Number of the last request that was answered by a frame.
    request: u64,
    /// `true` if the last frame was drawn by the GPU.
    is_last: bool,
}

/// A canvas that shows a mesh.
///
/// | gesture | effect |
/// | --- | --- |
/// | drag | turns about the center |
/// | middle button, Shift or Space and drag | moves the view: the point of the surface stays below the cursor |
/// | wheel, pinch | zooms to the cursor |
/// | double click | centers on the surface below the cursor |
/// | arrow keys, with Shift | turn, move |
/// | plus, minus, F | zoom, show everything |
///
/// # Guarantees
/// - No call computes, waits or reads a file.
pub struct MeshCanvas {
    options: MeshOptions,
    camera: OrbitCamera,
    /// `true` once the view was moved by hand: it is no longer fit to the mesh.
    moved: bool,
    /// `true` if the hand held something in the last frame, or there are drafts at rest as well: then there are drafts only.
    held: bool,
    at_rest: AtRest,
    repaint: Arc<dyn Fn() + Send + Sync>,
    renderer: Renderer,
    gpu: Option<MeshGpu>,
    gpu_frames: GpuFrames,
    picker: Picker,
    shown: Option<Arc<ShownMesh>>,
    bounds: Aabb,
    /// Points that are about as large as everything that is shown.
    extremes: Vec<DVec3>,
    view: Option<MeshView>,
    /// The last request; `true` once a fine picture of it was requested.
    requested: Option<(Wanted, bool)>,
    drawn: Option<(Drawn, TextureHandle)>,
    gesture: Option<Gesture>,
    orbit_locked: bool,
    measuring: Measuring,
}

impl MeshCanvas {
    /// A canvas that shows nothing yet. `repaint` is called, from other threads, when there is something new to show.
    ///
    /// With `gpu` the window draws meshes itself while the hand moves.
    pub fn new(repaint: Arc<dyn Fn() + Send + Sync>, gpu: Option<MeshGpu>) -> Self {
        Self {
            options: MeshOptions::default(),
            camera: OrbitCamera::default(),
            moved: false,
            held: false,
            at_rest: AtRest::default(),
            renderer: Renderer::new(repaint.clone(), gpu.clone()),
            gpu,
            gpu_frames: GpuFrames::default(),
            repaint,
            picker: Picker::default(),
            shown: None,
            bounds: Aabb::EMPTY,
            extremes: Vec::new(),
            view: None,
            requested: None,
            drawn: None,
            gesture: None,
            orbit_locked: false,
            measuring: Measuring::default(),
        }
    }

    /// Display options.
    pub fn options(&self) -> &MeshOptions {
        &self.options
    }

    /// The same, to be changed.
    pub fn options_mut(&mut self) -> &mut MeshOptions {
        &mut self.options
    }

    /// The camera.
    pub fn camera(&self) -> &OrbitCamera {
        &self.camera
    }

    /// Sets the camera; the view is no longer fit to the mesh.
    pub fn set_camera(&mut self, camera: OrbitCamera) {
        self.options.perspective = camera.perspective;
        self.options.up = camera.up;
        self.camera = camera;
        self.moved = true;
    }

    /// Shows all of the mesh again.
    pub fn fit(&mut self) {
        self.moved = false;
    }

    /// Shows a place and what is around it within a radius; a small part of the mesh if the radius is not positive.
    pub fn fly_to(&mut self, center: DVec3, radius: f64) {
        if !center.is_finite() {
            return;
        }
        let diagonal = self.bounds.diagonal();
        let small = if diagonal > 0.0 {
            SMALL * diagonal
        } else {
            1.0
        };
        let radius = if radius > 0.0 && radius.is_finite() {
            radius
        } else {
            small
        };
        self.camera.center = center;
        self.camera.span = 2.0 * ROOM * radius;
        self.moved = true;
    }

    /// Stops the left button from turning the view, for a tool that drags a handle.
    pub fn lock_orbit(&mut self, locked: bool) {
        self.orbit_locked = locked;
    }

    /// Selects the pictures that are made while the hand rests.
    pub fn set_at_rest(&mut self, at_rest: AtRest) {
        self.at_rest = at_rest;
    }

    /// The view that was drawn last.
    pub fn view(&self) -> Option<&MeshView> {
        self.view.as_ref()
    }

    /// The line of sight through a place on the screen: a point in front of everything, and the unit direction away from the
    /// eye.
    pub fn ray(&self, at: Pos2) -> Option<(DVec3, DVec3)> {
        let sight = self.view.as_ref()?.sight(at);
        Some((sight.origin, sight.direction))
    }

    /// The place of a point on the screen; `None` if it is not in front of the eye.
    pub fn project(&self, point: DVec3) -> Option<Pos2> {
        self.view.as_ref()?.project(point)
    }

    /// The nearest point of the surface below a place on the screen. `None` where there is none, and before
    /// [`Self::is_ready_to_pick`].
    pub fn pick(&self, at: Pos2) -> Option<Picked> {
        let view = self.view.as_ref()?;
        if !view.area.contains(at) {
            return None;
        }
        let mesh = &self.shown.as_ref()?.mesh;
        let bvh = self.picker.bvh(mesh)?;
        let section = self.options.section(self.bounds);
        picker::pick(bvh, mesh, section.as_ref(), view.sight(at))
    }

    /// `true` once points of the mesh can be picked.
    pub fn is_ready_to_pick(&self) -> bool {
        let shown = self.shown.as_ref();
        shown.is_some_and(|shown| self.picker.bvh(&shown.mesh).is_some())
    }

    /// The distance between the last two points that were clicked.
    pub fn measured(&self) -> Option<Measured> {
        self.measuring.measured()
    }

    /// `true` while the picture that is shown is not the one of the present view at full quality, or as a draft while the hand holds
    /// something.
    pub fn is_busy(&self) -> bool {
        let Some((wanted, _)) = &self.requested else {
            return false;
        };
        if self.held && self.gpu_frames.is_last {
            return false;
        }
        let is_there = |drawn: &Drawn| (drawn.fine || self.held) && drawn.wanted == *wanted;
        let drawn = self.drawn.as_ref();
        !drawn.is_some_and(|(drawn, _)| is_there(drawn)) && self.renderer.failure(wanted).is_none()
    }

    /// Number of the last request for a picture, and of the one that is shown.
    pub(crate) fn counts(&self) -> [u64; 2] {
        let shown = self.drawn.as_ref().map_or(0, |(drawn, _)| drawn.request);
        [self.renderer.requests(), shown.max(self.gpu_frames.request)]
    }

    /// `true` if the GPU has drawn the last frame; else it shows a picture of the CPU.
    pub fn is_drawn_by_gpu(&self) -> bool {
        self.gpu_frames.is_last
    }

    /// Number of pictures that were made.
    pub fn pictures(&self) -> u64 {
        self.renderer.pictures()
    }

    /// The picture that is shown.
    pub fn picture(&self) -> Option<&Arc<ColorImage>> {
        self.drawn.as_ref().map(|(drawn, _)| &drawn.image)
    }

    /// Draws the controls.
    pub fn options_ui(&mut self, ui: &mut Ui) {
        match options::options_ui(ui, &mut self.options, self.bounds) {
            Some(Command::View(view)) => self.camera.view = view,
            Some(Command::Fit) => self.fit(),
            None => {}
        }
        if !self.options.measure {
            self.measuring.clear();
        }
    }

    /// Draws a mesh, and a translucent one over it, and follows the hand.
    pub fn ui(
        &mut self,
        ui: &mut Ui,
        shown: Option<&Arc<ShownMesh>>,
        ghost: Option<&Arc<ShownMesh>>,
    ) -> Response {
        let area = ui.available_rect_before_wrap();
        let response = ui.allocate_rect(area, Sense::click_and_drag());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Mesh canvas"));
        let painter = ui.painter_at(area);
        let background = background(ui);
        let [r, g, b] = background;
        painter.rect_filled(area, 0.0, Color32::from_rgb(r, g, b));
        self.shown = shown.cloned();
        let Some(shown) = shown else {
            self.forget();
            return response;
        };
        self.bounds = shown.bounds();
        self.extremes = shown.extremes.to_vec();
        if let Some(ghost) = ghost {
            self.bounds = self.bounds.union(ghost.bounds());
            self.extremes.extend_from_slice(&ghost.extremes);
        }
        self.place_camera(ui, area);
        self.follow(ui, &response, area);
        self.view = self.camera.on(self.bounds, area);
        let Some(view) = self.view else {
            return response;
        };
        let pixels_per_point = ui.ctx().pixels_per_point();
        let wanted = Wanted {
            shown: shown.clone(),
            ghost: ghost.filter(|_| self.options.ghost).cloned(),
            camera: self.camera.camera(self.bounds),
            size: [area.width(), area.height()]
                .map(|side| (side * pixels_per_point).round().max(1.0) as u32),
            style: self.style(background, pixels_per_point),
        };
        let failure = self.renderer.failure(&wanted);
        let gpu = self.gpu.as_ref().filter(|gpu| gpu.is_usable());
        let layers = gpu.and_then(|_| self.renderer.layers(&wanted));
        self.request(ui, wanted, layers.is_some());
        self.take(ui);
        self.want_picker(shown);
        let is_fine = self.shows_fine_picture();
        let layers = layers.filter(|_| !is_fine);
        self.gpu_frames.is_last = layers.is_some();
        match (&self.gpu, layers) {
            (Some(gpu), Some(layers)) => {
                painter.add(gpu.shape(&self.gpu_frames.pictures, area, layers));
            }
            _ => self.paint_picture(&painter, &view),
        }
        self.paint_overlay(ui, &painter, &response, &view, shown);
        if let Some(failure) = failure {
            self.picker.want(&shown.mesh, &self.repaint);
            let color = ui.visuals().error_fg_color;
            let font = FontId::proportional(14.0);
            painter.text(area.center(), Align2::CENTER_CENTER, failure, font, color);
        }
        response
    }

    /// Drops what belongs to a mesh that is no longer shown.
    fn forget(&mut self) {
        if self.requested.take().is_some() {
            self.renderer.stop();
        }
        self.drawn = None;
        self.view = None;
        self.gesture = None;
        self.bounds = Aabb::EMPTY;
    }

    fn place_camera(&mut self, ui: &Ui, area: Rect) {
        let held = ui.input(|input| input.pointer.any_down() || input.pointer.any_released());
        let before = (self.camera.perspective, self.camera.up);
        self.camera.perspective = self.options.perspective;
        self.camera.up = self.options.up;
        let changed = before != (self.camera.perspective, self.camera.up);
        // nothing moves under a hand that holds something
        if !self.moved && (!held || changed || self.view.is_none()) {
            self.fit_now(area);
        }
    }

    fn fit_now(&mut self, area: Rect) {
        self.camera = self.camera.fit(&self.extremes, self.bounds, area.size());
    }

    /// Moves the camera with the hand.
    fn follow(&mut self, ui: &Ui, response: &Response, area: Rect) {
        self.view = self.camera.on(self.bounds, area);
        let Some(view) = self.view else {
            return;
        };
        // the key Space clicks what has the focus, too
        let clicked = response.clicked_by(PointerButton::Primary);
        if clicked {
            response.request_focus();
        }
        self.drag(ui, response, &view);
        if let Some(at) = response.hover_pos() {
            let (scroll, pinch) =
                ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
            let factor = pinch * (scroll / WHEEL).exp();
            if factor != 1.0 {
                let anchor = self.anchor(&view, at);
                self.move_to(view.zoomed(f64::from(factor), anchor));
            }
        }
        let clicked = response.interact_pointer_pos().filter(|_| clicked);
        if self.options.measure {
            if let Some(point) = clicked.and_then(|at| self.measured_point(&view, at)) {
                self.measuring.add(point);
            }
        } else if response.double_clicked()
            && let Some(at) = response.interact_pointer_pos()
            && let Some(picked) = self.pick(at)
        {
            self.move_to(OrbitCamera {
                center: picked.point,
                ..self.camera
            });
        }
        self.follow_keys(ui, response, area);
    }

    /// The point of the surface below the cursor; beside the surface, as far away as the center.
    fn anchor(&self, view: &MeshView, at: Pos2) -> DVec3 {
        match self.pick(at) {
            Some(picked) => picked.point,
            None => view.at_depth_of(at, self.camera.center),
        }
    }

    /// The point that a click measures: a corner of a triangle if one is near, else the surface below the cursor.
    fn measured_point(&self, view: &MeshView, at: Pos2) -> Option<DVec3> {
        let shown = self.shown.as_ref()?;
        let around = measure::around(at).filter_map(|at| self.pick(at));
        let corners = around
            .filter(|picked| !picked.on_cap)
            .filter_map(|picked| shown.corners(picked.triangle))
            .flatten();
        let section = self.options.section(self.bounds);
        let is_kept = |corner: &DVec3| {
            section.is_none_or(|section| section.normal.dot(*corner) <= section.offset)
        };
        measure::snapped(corners.filter(is_kept), view, at)
            .or_else(|| self.pick(at).map(|picked| picked.point))
    }

    fn move_to(&mut self, camera: OrbitCamera) {
        self.moved |= camera != self.camera;
        self.camera = camera;
    }

    fn drag(&mut self, ui: &Ui, response: &Response, view: &MeshView) {
        if !response.dragged() {
            self.gesture = None;
            return;
        }
        let Some(at) = response.interact_pointer_pos() else {
            return;
        };
        let (origin, shift, space) = ui.input(|input| {
            let origin = input.pointer.press_origin().unwrap_or(at);
            (origin, input.modifiers.shift, input.key_down(Key::Space))
        });
        let primary = response.dragged_by(PointerButton::Primary);
        let pans = response.dragged_by(PointerButton::Middle) || primary && (shift || space);
        let gesture = match self.gesture {
            Some(gesture) => gesture,
            None if pans => Gesture::Pan(self.anchor(view, origin)),
            None if primary && !self.orbit_locked => Gesture::Orbit(origin),
            None => return,
        };
        match gesture {
            Gesture::Orbit(last) => {
                self.move_to(self.camera.orbited(at - last));
                self.gesture = Some(Gesture::Orbit(at));
            }
            Gesture::Pan(anchor) => {
                self.move_to(view.panned(anchor, at));
                self.gesture = Some(gesture);
            }
        }
    }

    fn follow_keys(&mut self, ui: &Ui, response: &Response, area: Rect) {
        if !response.has_focus() {
            return;
        }
        let arrows = EventFilter {
            horizontal_arrows: true,
            vertical_arrows: true,
            ..EventFilter::default()
        };
        ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, arrows));
        let pressed =
            |key: Key| ui.input(|input| !input.modifiers.command && input.key_pressed(key));
        let mut step = Vec2::ZERO;
        for (key, by) in [
            (Key::ArrowLeft, vec2(-1.0, 0.0)),
            (Key::ArrowRight, vec2(1.0, 0.0)),
            (Key::ArrowUp, vec2(0.0, -1.0)),
            (Key::ArrowDown, vec2(0.0, 1.0)),
        ] {
            if pressed(key) {
                step += KEY_STEP * by;
            }
        }
        if step != Vec2::ZERO {
            let shift = ui.input(|input| input.modifiers.shift);
            let moved = match self.view {
                Some(view) if shift => view.panned(self.camera.center, area.center() + step),
                _ => self.camera.orbited(step),
            };
            self.move_to(moved);
        }
        let zoom = if pressed(Key::Plus) || pressed(Key::Equals) {
            KEY_ZOOM
        } else if pressed(Key::Minus) {
            1.0 / KEY_ZOOM
        } else {
            1.0
        };
        if zoom != 1.0
            && let Some(view) = self.camera.on(self.bounds, area)
        {
            self.move_to(view.zoomed(zoom, self.camera.center));
        }
        if pressed(Key::F) {
            self.fit_now(area);
            self.fit();
        }
    }

    fn style(&self, background: [u8; 3], pixels_per_point: f32) -> Style {
        let options = &self.options;
        Style {
            background,
            shaded: options.shaded,
            smooth: options.smooth,
            all_edges: options.all_edges,
            features: options.feature_edges.then_some(options.feature_angle_deg),
            colors: options.colors,
            marks: options.marks,
            section: options.section(self.bounds),
            pixels_per_point,
        }
    }

    /// Asks for a draft of what is new, unless the GPU draws it, and for a fine picture once the hand rests.
    fn request(&mut self, ui: &Ui, wanted: Wanted, has_layers: bool) {
        let is_down = ui.input(|input| input.pointer.any_down());
        self.held = self.at_rest == AtRest::Drafts || is_down;
        let is_resized =
            (self.requested.as_ref()).is_some_and(|(known, _)| known.is_resized(&wanted));
        if is_resized && self.at_rest == AtRest::Drafts && !is_down {
            // the mesh that is about to take the place of this one has the processor
            return;
        }
        let known = self.requested.take();
        let fine = match known {
            Some((known, fine)) if known == wanted => {
                if !fine && !self.held {
                    self.renderer.request_fine(wanted.clone());
                }
                fine || !self.held
            }
            _ => {
                if has_layers {
                    self.gpu_frames.request = self.renderer.request_gpu();
                } else {
                    self.renderer.request_draft(wanted.clone());
                }
                // the next frame sees that nothing moved any more
                ui.ctx().request_repaint();
                false
            }
        };
        self.requested = Some((wanted, fine));
    }

    /// Takes the last picture.
    fn take(&mut self, ui: &Ui) {
        let known = self.drawn.as_ref().map(|(drawn, _)| drawn.serial);
        let Some(drawn) = self.renderer.drawn() else {
            return;
        };
        // what was drawn before there was nothing to show belongs to another mesh
        let stale = known.is_none()
            && !self
                .shown
                .as_ref()
                .is_some_and(|shown| Arc::ptr_eq(shown, &drawn.wanted.shown));
        if known == Some(drawn.serial) || stale {
            return;
        }
        let data = ImageData::Color(drawn.image.clone());
        let texture = ui.ctx().load_texture("mesh", data, TextureOptions::LINEAR);
        self.drawn = Some((drawn, texture));
    }

    /// `true` if the last picture is that of the present view at full quality.
    fn shows_fine_picture(&self) -> bool {
        let wanted = self.requested.as_ref().map(|(wanted, _)| wanted);
        let drawn = self.drawn.as_ref();
        drawn.is_some_and(|(drawn, _)| drawn.fine && Some(&drawn.wanted) == wanted)
    }

    /// Prepares for picking once the mesh is seen.
    fn want_picker(&mut self, shown: &ShownMesh) {
        let drawn = self
            .drawn
            .as_ref()
            .map(|(drawn, _)| &drawn.wanted.shown.mesh);
        if self.gpu_frames.is_last || drawn.is_some_and(|mesh| Arc::ptr_eq(mesh, &shown.mesh)) {
            self.picker.want(&shown.mesh, &self.repaint);
        }
    }

    /// Draws the last picture where it belongs in the present view.
    fn paint_picture(&self, painter: &Painter, view: &MeshView) {
        let Some((drawn, texture)) = &self.drawn else {
            let color = Color32::from_gray(128);
            let font = FontId::proportional(14.0);
            let at = view.area.center();
            painter.text(at, Align2::CENTER_CENTER, "Drawing...", font, color);
            return;
        };
        let size = drawn.image.size.map(|side| side as f64);
        let Some(target) = drawn.wanted.camera.target else {
            return;
        };
        let pixels_per_unit = size[0].min(size[1]) / target.span;
        let scale = view.points_per_unit(target.center) / pixels_per_unit;
        let Some(center) = view.project(target.center).filter(|_| scale.is_finite()) else {
            return;
        };
        let size = vec2((scale * size[0]) as f32, (scale * size[1]) as f32);
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        let place = Rect::from_center_size(center, size);
        painter.image(texture.id(), place, whole, Color32::WHITE);
    }

    fn paint_overlay(
        &self,
        ui: &Ui,
        painter: &Painter,
        response: &Response,
        view: &MeshView,
        shown: &ShownMesh,
    ) {
        if self.options.marks {
            paint_marks(painter, view, shown);
        }
        paint_axes(painter, view.area, view);
        if self.options.colors
            && let Some(values) = &shown.values
            && let Some((drawn, _)) = &self.drawn
            && let Some(legend) = drawn.legend
        {
            paint_legend(ui, painter, view.area, &values.title, legend);
        }
        if self.options.measure {
            let at = response.hover_pos().filter(|_| self.gesture.is_none());
            let next = at.and_then(|at| self.measured_point(view, at));
            self.measuring.paint(painter, view, next);
        }
    }
}

/// The color behind the mesh.
fn background(ui: &Ui) -> [u8; 3] {
    if ui.visuals().dark_mode {
        [44, 47, 52]
    } else {
        [243, 245, 248]
    }
}
