//! The camera under the hand: it turns about a center, moves across the view, and zooms to the cursor.

use egui::{Pos2, Rect, Vec2, pos2};
use glam::DVec3;
use ravec::mesh::Aabb;
use ravec::mesh_render::{Camera, Projection, ScreenMap, Sight, Target, UpAxis, View};

/// The larger of the angles of a view in perspective.
const FIELD_OF_VIEW_DEG: f64 = 40.0;

/// The share of the canvas that a mesh fills when it is fit.
const FILL: f64 = 0.88;

/// Degrees that the view turns by for each point that the hand moves.
const DEG_PER_POINT: f64 = 0.4;

/// Range of the span, as shares of the diagonal of what is shown. Less is below what double precision resolves.
const SPAN: [f64; 2] = [1e-6, 1e3];

/// A camera that turns about a center.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrbitCamera {
    /// The point in the middle of the canvas.
    pub center: DVec3,
    /// Direction of the view.
    pub view: View,
    /// Length across the smaller side of the canvas at the depth of the center, above 0.
    pub span: f64,
    /// `true` in perspective, `false` if parallels stay parallel.
    pub perspective: bool,
    /// The axis that points upward.
    pub up: UpAxis,
}

impl Default for OrbitCamera {
    fn default() -> Self {
        Self {
            center: DVec3::ZERO,
            view: View::ISO,
            span: 2.0,
            perspective: true,
            up: UpAxis::Z,
        }
    }
}

impl OrbitCamera {
    /// The camera of the renderer, for everything within `bounds`.
    pub fn camera(&self, bounds: Aabb) -> Camera {
        Camera {
            view: self.view,
            up: self.up,
            projection: if self.perspective {
                Projection::Perspective {
                    field_of_view_deg: FIELD_OF_VIEW_DEG,
                }
            } else {
                Projection::Orthographic
            },
            target: Some(Target {
                center: self.center,
                span: self.span,
                bounds,
            }),
            ..Camera::default()
        }
    }

    /// The same camera, so that all of `points` fit a canvas of a size, and fill it. They are within `bounds`.
    #[must_use]
    pub fn fit(mut self, points: &[DVec3], bounds: Aabb, size: Vec2) -> Self {
        let area = Rect::from_min_size(Pos2::ZERO, size.max(Vec2::splat(1.0)));
        if bounds.is_empty() {
            self.center = DVec3::ZERO;
            self.span = 2.0;
            return self;
        }
        self.center = bounds.center();
        let diagonal = bounds.diagonal();
        self.span = if diagonal > 0.0 { diagonal } else { 1.0 };
        // in perspective the eye moves with the span: a few steps settle it
        for _ in 0..12 {
            let Some(view) = self.on(bounds, area) else {
                break;
            };
            let middle = area.center();
            let half = 0.5 * area.size();
            let reach = points
                .iter()
                .filter_map(|&point| view.project(point))
                .map(|at| ((at - middle) / half).abs().max_elem())
                .fold(0.0, f32::max);
            if !(reach > 0.0 && reach.is_finite()) {
                break;
            }
            self.span *= f64::from(reach) / FILL;
        }
        self.within_limits(bounds)
    }

    /// The camera over a part of the screen; `None` if the part is empty or numbers overflow.
    pub fn on(self, bounds: Aabb, area: Rect) -> Option<MeshView> {
        let size = [f64::from(area.width()), f64::from(area.height())];
        let map = ScreenMap::new(&self.camera(bounds), bounds, size).ok()?;
        Some(MeshView {
            camera: self,
            bounds,
            area,
            map,
        })
    }

    /// Turned about the center by a movement of the hand, which what is in front follows.
    #[must_use]
    pub fn orbited(mut self, delta: Vec2) -> Self {
        let azimuth = self.view.azimuth_deg - DEG_PER_POINT * f64::from(delta.x);
        let elevation = self.view.elevation_deg + DEG_PER_POINT * f64::from(delta.y);
        self.view = View::new(azimuth.rem_euclid(360.0), elevation.clamp(-90.0, 90.0));
        self
    }

    fn within_limits(mut self, bounds: Aabb) -> Self {
        let diagonal = bounds.diagonal();
        let unit = if diagonal > 0.0 { diagonal } else { 1.0 };
        self.span = self.span.clamp(SPAN[0] * unit, SPAN[1] * unit);
        self
    }
}

/// A camera over a part of the screen.
#[derive(Debug, Clone, Copy)]
pub struct MeshView {
    /// The camera.
    pub camera: OrbitCamera,
    /// The box around everything that is shown.
    pub bounds: Aabb,
    /// The part of the screen, in points.
    pub area: Rect,
    map: ScreenMap,
}

impl MeshView {
    /// The place of a point on the screen; `None` if it is not in front of the eye.
    pub fn project(&self, point: DVec3) -> Option<Pos2> {
        let [x, y] = self.map.project(point)?;
        let offset = self.area.min.to_vec2();
        Some(pos2(x as f32, y as f32) + offset)
    }

    /// The line of sight through a place on the screen.
    pub fn sight(&self, at: Pos2) -> Sight {
        self.map.sight(self.local(at))
    }

    /// The point below `at` that is as far away as `other`.
    pub fn at_depth_of(&self, at: Pos2, other: DVec3) -> DVec3 {
        self.map.at_depth_of(self.local(at), other)
    }

    /// To the right, upward, and toward the eye.
    pub fn axes(&self) -> [DVec3; 3] {
        self.map.axes()
    }

    /// Points of the screen per unit of length at the depth of `point`.
    pub fn points_per_unit(&self, point: DVec3) -> f64 {
        self.map.pixels_per_unit(point)
    }

    /// The camera moved across the view so that `anchor` is below `at`.
    #[must_use]
    pub fn panned(&self, anchor: DVec3, at: Pos2) -> OrbitCamera {
        let mut camera = self.camera;
        let shift = anchor - self.at_depth_of(at, anchor);
        if shift.is_finite() {
            camera.center += shift;
        }
        camera
    }

    /// The camera nearer to `anchor` by a factor, so that `anchor` stays where it is on the screen.
    #[must_use]
    pub fn zoomed(&self, factor: f64, anchor: DVec3) -> OrbitCamera {
        let Some(at) = self.project(anchor) else {
            return self.camera;
        };
        let wanted = OrbitCamera {
            span: self.camera.span / factor,
            ..self.camera
        };
        let mut camera = wanted.within_limits(self.bounds);
        let factor = self.camera.span / camera.span;
        camera.center = anchor + (camera.center - anchor) / factor;
        // the eye keeps out of the mesh, and so may not come as near as the factor says
        match camera.on(self.bounds, self.area) {
            Some(view) => view.panned(anchor, at),
            None => self.camera,
        }
    }

    fn local(&self, at: Pos2) -> [f64; 2] {
        let at = at - self.area.min;
        [f64::from(at.x), f64::from(at.y)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui::vec2;

    fn bounds() -> Aabb {
        Aabb::new(DVec3::new(10.0, -2.0, 0.0), DVec3::new(16.0, 3.0, 2.0))
    }

    fn corners(bounds: Aabb) -> impl Iterator<Item = DVec3> {
        let ends = [bounds.min, bounds.max];
        (0..8).map(move |i| DVec3::new(ends[i & 1].x, ends[i >> 1 & 1].y, ends[i >> 2].z))
    }

    fn fit(camera: OrbitCamera, bounds: Aabb, size: Vec2) -> OrbitCamera {
        let corners: Vec<DVec3> = corners(bounds).collect();
        camera.fit(&corners, bounds, size)
    }

    fn area() -> Rect {
        Rect::from_min_size(pos2(120.0, 40.0), vec2(640.0, 480.0))
    }

    fn views() -> Vec<MeshView> {
        let mut views = Vec::new();
        for perspective in [false, true] {
            for view in [View::FRONT, View::ISO, View::TOP, View::new(211.0, -37.0)] {
                let camera = OrbitCamera {
                    view,
                    perspective,
                    ..OrbitCamera::default()
                };
                let camera = fit(camera, bounds(), area().size());
                views.push(camera.on(bounds(), area()).unwrap());
            }
        }
        views
    }

    #[test]
    fn a_fit_shows_everything_and_fills_the_canvas() {
        for view in views() {
            let reach = corners(bounds())
                .map(|corner| view.project(corner).unwrap() - area().center())
                .map(|off| (off / (0.5 * area().size())).abs().max_elem())
                .fold(0.0, f32::max);
            assert!((f64::from(reach) - FILL).abs() < 0.01, "{reach}");
        }
    }

    #[test]
    fn an_orbit_keeps_the_place_of_the_center() {
        for view in views() {
            let center = view.camera.center;
            let before = view.project(center).unwrap();
            for delta in [vec2(50.0, 0.0), vec2(-900.0, 30.0), vec2(0.0, 2000.0)] {
                let turned = view.camera.orbited(delta);
                let stops = view.camera.view == View::TOP && delta.y > 0.0;
                assert!(stops || turned.view != view.camera.view);
                let after = turned
                    .on(bounds(), area())
                    .unwrap()
                    .project(center)
                    .unwrap();
                assert!(after.distance(before) < 1e-2);
            }
        }
    }

    #[test]
    fn what_is_in_front_follows_the_hand_that_turns() {
        for view in views() {
            let [_, _, toward] = view.axes();
            if toward.z.abs() > 0.99 {
                continue;
            }
            let front = view.camera.center + toward;
            let before = view.project(front).unwrap();
            for delta in [vec2(5.0, 0.0), vec2(0.0, 5.0), vec2(-5.0, 0.0)] {
                let turned = view.camera.orbited(delta).on(bounds(), area()).unwrap();
                let moved = turned.project(front).unwrap() - before;
                assert!(moved.dot(delta) > 0.0, "{delta} {moved}");
            }
        }
    }

    #[test]
    fn a_point_of_the_surface_follows_the_hand_that_pans() {
        for view in views() {
            for anchor in [bounds().min, bounds().max, bounds().center()] {
                let to = pos2(300.0, 100.0);
                let panned = view.panned(anchor, to).on(bounds(), area()).unwrap();
                assert!(panned.project(anchor).unwrap().distance(to) < 1e-2);
                assert_eq!(panned.camera.view, view.camera.view);
                assert_eq!(panned.camera.span, view.camera.span);
            }
        }
    }

    #[test]
    fn a_zoom_keeps_the_point_below_the_cursor() {
        for view in views() {
            for anchor in [bounds().min, bounds().max, bounds().center()] {
                let before = view.project(anchor).unwrap();
                let mut zoomed = view;
                for factor in [2.0, 30.0, 30.0, 0.1, 0.001] {
                    let scale = zoomed.points_per_unit(anchor);
                    zoomed = zoomed.zoomed(factor, anchor).on(bounds(), area()).unwrap();
                    let after = zoomed.project(anchor).unwrap();
                    assert!(after.distance(before) < 0.05, "{before} {after}");
                    let grown = zoomed.points_per_unit(anchor) / scale;
                    assert!((grown > 1.0) == (factor > 1.0), "{grown} {factor}");
                }
            }
        }
    }

    #[test]
    fn boxes_without_size_are_shown_too() {
        let point = Aabb::new(DVec3::ONE, DVec3::ONE);
        let line = Aabb::new(DVec3::ZERO, DVec3::new(0.0, 0.0, 1e-9));
        for bounds in [Aabb::EMPTY, point, line] {
            for size in [vec2(1.0, 1.0), vec2(3000.0, 2.0), vec2(0.0, 0.0)] {
                let camera = fit(OrbitCamera::default(), bounds, size);
                assert!(camera.span > 0.0 && camera.span.is_finite());
                assert!(camera.center.is_finite());
            }
        }
        let nowhere = Rect::from_min_size(Pos2::ZERO, Vec2::ZERO);
        assert!(OrbitCamera::default().on(bounds(), nowhere).is_none());
    }
}
