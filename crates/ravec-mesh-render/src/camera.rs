//! The camera: the view of the mesh, and the projection of its points into the picture.

use glam::DVec3;
#[cfg(feature = "gpu")]
use glam::{DMat4, DVec4};

use super::screen_map::Sight;
use ravec_mesh::Aabb;

/// The axis that points upward.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum UpAxis {
    /// As in scans and games.
    ///
    /// The front is at the upper end of z.
    Y,
    /// As in construction and printing.
    ///
    /// The front is at the lower end of y.
    #[default]
    Z,
}

/// A direction of view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Degrees around the upward axis, counter-clockwise as seen from above: 0 is the front, 90 the right side.
    pub azimuth_deg: f64,
    /// Degrees above the horizon, -90 to 90.
    pub elevation_deg: f64,
}

impl View {
    /// From the front.
    pub const FRONT: Self = Self::new(0.0, 0.0);
    /// From the right.
    pub const RIGHT: Self = Self::new(90.0, 0.0);
    /// From the back.
    pub const BACK: Self = Self::new(180.0, 0.0);
    /// From the left.
    pub const LEFT: Self = Self::new(270.0, 0.0);
    /// From above, the front below.
    pub const TOP: Self = Self::new(0.0, 90.0);
    /// From below, the front above.
    pub const BOTTOM: Self = Self::new(0.0, -90.0);
    /// From the corner of front, right and top, all three axes equally long.
    pub const ISO: Self = Self::new(45.0, 35.264_389_682_754_654);

    /// The named views.
    pub const NAMED: [(&'static str, Self); 7] = [
        ("front", Self::FRONT),
        ("right", Self::RIGHT),
        ("back", Self::BACK),
        ("left", Self::LEFT),
        ("top", Self::TOP),
        ("bottom", Self::BOTTOM),
        ("iso", Self::ISO),
    ];

    /// From `azimuth_deg` around and `elevation_deg` up.
    pub const fn new(azimuth_deg: f64, elevation_deg: f64) -> Self {
        Self {
            azimuth_deg,
            elevation_deg,
        }
    }

    /// The view with this name in [`Self::NAMED`].
    pub fn from_name(name: &str) -> Option<Self> {
        let mut named = Self::NAMED.into_iter();
        named
            .find(|(known, _)| *known == name)
            .map(|(_, view)| view)
    }

    /// To the right, upward, and toward the eye.
    fn axes(self, up: UpAxis) -> [DVec3; 3] {
        let (sin_a, cos_a) = self.azimuth_deg.to_radians().sin_cos();
        let (sin_e, cos_e) = self.elevation_deg.clamp(-90.0, 90.0).to_radians().sin_cos();
        let axes = [
            DVec3::new(cos_a, sin_a, 0.0),
            DVec3::new(-sin_a * sin_e, cos_a * sin_e, cos_e),
            DVec3::new(sin_a * cos_e, -cos_a * cos_e, sin_e),
        ];
        match up {
            UpAxis::Z => axes,
            UpAxis::Y => axes.map(|axis| DVec3::new(axis.x, axis.z, -axis.y)),
        }
    }
}

/// Projection of depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Parallel lines stay parallel, and lengths can be compared.
    Orthographic,
    /// As seen by an eye or a camera from a distance at which the mesh fills the angle.
    Perspective {
        /// The larger of the angles that width and height of the picture take, 1 to 150 degrees. Larger shows more depth.
        field_of_view_deg: f64,
    },
}

/// View of the mesh. It is always framed whole, unless another frame is set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Direction of the view (default [`View::ISO`]).
    pub view: View,
    /// The axis that points upward (default z).
    pub up: UpAxis,
    /// Projection of depth (default orthographic).
    pub projection: Projection,
    /// Box that is framed: all of the mesh if not given (default). The same box frames different meshes alike.
    pub frame: Option<Aabb>,
    /// Magnification beyond that, about the middle of the frame, above 0 (default 1).
    pub zoom: f64,
    /// A place to view, in place of frame and zoom (default none): for views that are moved by hand.
    pub target: Option<Target>,
}

/// A place that the camera views, and the size of what it shows of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// The point in the middle of the picture.
    pub center: DVec3,
    /// Length across the smaller side of the picture at the depth of the center, above 0.
    pub span: f64,
    /// Box that a perspective camera stays in front of, besides the mesh: it moves back, and its angle narrows. Meshes that are
    /// drawn with the same box around all of them are projected alike. May be empty.
    pub bounds: Aabb,
}

impl Target {
    fn is_valid(&self) -> bool {
        let is_box =
            self.bounds.is_empty() || self.bounds.min.is_finite() && self.bounds.max.is_finite();
        self.center.is_finite() && self.span > 0.0 && self.span.is_finite() && is_box
    }
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            view: View::ISO,
            up: UpAxis::Z,
            projection: Projection::Orthographic,
            frame: None,
            zoom: 1.0,
            target: None,
        }
    }
}

impl Camera {
    /// Returns `true` if all numbers make sense.
    pub(super) fn is_valid(&self) -> bool {
        let angle = match self.projection {
            Projection::Orthographic => true,
            Projection::Perspective { field_of_view_deg } => {
                (1.0..=150.0).contains(&field_of_view_deg)
            }
        };
        let frame = self.frame.is_none_or(|frame| {
            frame.min.is_finite() && frame.max.is_finite() && !frame.is_empty()
        });
        let view = self.view.azimuth_deg.is_finite() && self.view.elevation_deg.is_finite();
        let target = self.target.is_none_or(|target| target.is_valid());
        angle && frame && view && target && self.zoom > 0.0 && self.zoom.is_finite()
    }
}

/// A point as it is projected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Projected {
    /// In samples from the left.
    pub x: f64,
    /// In samples from the top.
    pub y: f64,
    /// From 0 at the farthest to 1 at the nearest; linear along lines in the picture.
    pub key: f64,
    /// One over the distance along the axis of sight; 1 if orthographic.
    pub inverse_w: f64,
}

/// The share of the picture that the frame fills.
const FILL: f64 = 0.92;

/// Room between an eye with a target and what is in front of it, as a share of the diagonal of that. Less distorts what is near
/// the eye, more flattens what is viewed from near.
const ROOM: f64 = 0.02;

/// The corners of a box.
pub(super) fn corners(bounds: Aabb) -> impl Iterator<Item = DVec3> {
    (0..8).map(move |i| {
        let pick = |axis: usize| {
            if i >> axis & 1 == 0 {
                bounds.min[axis]
            } else {
                bounds.max[axis]
            }
        };
        DVec3::new(pick(0), pick(1), pick(2))
    })
}

/// From space to samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projector {
    /// To the right, upward, and toward the eye.
    pub axes: [DVec3; 3],
    /// The origin of the coordinates of the view, so that few digits are lost.
    origin: DVec3,
    /// The eye in those; `None` if infinitely far.
    eye: Option<DVec3>,
    /// Samples per unit of the image plane, and the samples of its origin.
    scale: f64,
    shift: [f64; 2],
    /// Beyond what is nearest, in the coordinates of the view.
    front: f64,
    /// Offset that is taken off from the depth, and the factor that it is then multiplied by.
    depth: [f64; 2],
}

impl Projector {
    /// The projection of a mesh with vertices `points` to a picture of `size` samples.
    pub fn new(camera: &Camera, points: &[DVec3], bounds: Aabb, size: [f64; 2]) -> Self {
        let framed: Vec<DVec3> = match camera.frame {
            _ if camera.target.is_some() => Vec::new(),
            Some(frame) => corners(frame).collect(),
            None => points.to_vec(),
        };
        let bounds = if bounds.is_empty() {
            Aabb::new(DVec3::ZERO, DVec3::ZERO)
        } else {
            bounds
        };
        let bounds = match camera.target {
            Some(target) => bounds.union(target.bounds),
            None => bounds,
        };
        let mut projector = Self {
            axes: camera.view.axes(camera.up),
            origin: camera.frame.unwrap_or(bounds).center(),
            eye: None,
            scale: 1.0,
            shift: [0.0; 2],
            front: 0.0,
            depth: [0.0, 1.0],
        };
        let beyond = corners(bounds).map(|p| projector.local(p).z);
        projector.front = beyond.fold(f64::NEG_INFINITY, f64::max) + ROOM * bounds.diagonal();
        if let Some(target) = camera.target {
            projector.aim(target, camera.projection, size);
            projector.scale_depth(points);
            return projector;
        }
        if let Projection::Perspective { field_of_view_deg } = camera.projection {
            projector.place_eye(&framed, field_of_view_deg, size);
            projector.step_back(corners(bounds), bounds.diagonal());
        }
        projector.frame(&framed, size, camera.zoom);
        projector.scale_depth(points);
        projector
    }

    /// Places the eye so that the target's center is in the middle of the picture.
    fn aim(&mut self, target: Target, projection: Projection, size: [f64; 2]) {
        self.front += (self.origin - target.center).dot(self.axes[2]);
        self.origin = target.center;
        self.shift = size.map(|size| 0.5 * size);
        let smaller = size[0].min(size[1]);
        self.scale = smaller / target.span;
        if let Projection::Perspective { field_of_view_deg } = projection {
            let larger = size[0].max(size[1]);
            let tangent = (0.5 * field_of_view_deg).to_radians().tan();
            let distance = 0.5 * target.span * larger / smaller / tangent;
            let distance = distance.max(self.front);
            self.eye = Some(DVec3::new(0.0, 0.0, distance));
            self.scale *= distance;
        }
    }

    /// Moves the eye to where all of `points` fit into the angle.
    fn place_eye(&mut self, points: &[DVec3], field_of_view_deg: f64, size: [f64; 2]) {
        let tangent = (0.5 * field_of_view_deg).to_radians().tan();
        let larger = size[0].max(size[1]);
        let mut eye = DVec3::new(0.0, 0.0, f64::NEG_INFINITY);
        for axis in 0..2 {
            // Points are within if their offset is at most slope times their distance, on either side.
            let slope = tangent * size[axis] / larger;
            let reach = |side: f64| {
                let over = points.iter().map(|&p| {
                    let local = self.local(p);
                    side * local[axis] + slope * local.z
                });
                over.fold(f64::NEG_INFINITY, f64::max)
            };
            let (above, below) = (reach(1.0), reach(-1.0));
            if above.is_finite() {
                eye[axis] = 0.5 * (above - below);
                eye.z = eye.z.max(0.5 * (above + below) / slope);
            }
        }
        if !eye.z.is_finite() {
            eye.z = 1.0;
        }
        self.eye = Some(eye);
    }

    /// Moves the eye back to where nothing is beside or behind it.
    fn step_back(&mut self, corners: impl Iterator<Item = DVec3>, size: f64) {
        let nearest = corners
            .map(|p| self.local(p).z)
            .fold(f64::NEG_INFINITY, f64::max);
        if let Some(eye) = &mut self.eye {
            eye.z = eye
                .z
                .max(nearest + 1e-3 * size)
                .max(nearest + f64::MIN_POSITIVE);
        }
    }

    /// Scales and shifts the image plane so that `points` fill the picture.
    fn frame(&mut self, points: &[DVec3], size: [f64; 2], zoom: f64) {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &point in points {
            let (at, _) = self.on_plane(point);
            for axis in 0..2 {
                low[axis] = low[axis].min(at[axis]);
                high[axis] = high[axis].max(at[axis]);
            }
        }
        if low[0] > high[0] {
            (low, high) = ([0.0; 2], [0.0; 2]);
        }
        let fits = [0, 1].map(|axis| FILL * size[axis] / (high[axis] - low[axis]));
        // A single point is shown at any scale.
        let scale = fits[0].min(fits[1]);
        self.scale = zoom * if scale.is_finite() { scale } else { 1.0 };
        self.shift = [0, 1].map(|axis| {
            let sign = if axis == 0 { 1.0 } else { -1.0 };
            0.5 * size[axis] - sign * self.scale * 0.5 * (low[axis] + high[axis])
        });
    }

    fn scale_depth(&mut self, points: &[DVec3]) {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for &point in points {
            let depth = self.raw_depth(point);
            (low, high) = (low.min(depth), high.max(depth));
        }
        if low < high {
            self.depth = [low, 1.0 / (high - low)];
        }
    }

    /// In the coordinates of the view.
    fn local(&self, p: DVec3) -> DVec3 {
        let offset = p - self.origin;
        DVec3::from_array(self.axes.map(|axis| axis.dot(offset)))
    }

    /// The place in the image plane at unit distance, and one over the distance.
    #[inline]
    fn on_plane(&self, p: DVec3) -> ([f64; 2], f64) {
        let local = self.local(p);
        match self.eye {
            None => ([local.x, local.y], 1.0),
            Some(eye) => {
                let inverse = 1.0 / (eye.z - local.z).max(f64::MIN_POSITIVE);
                (
                    [(local.x - eye.x) * inverse, (local.y - eye.y) * inverse],
                    inverse,
                )
            }
        }
    }

    #[inline]
    fn raw_depth(&self, p: DVec3) -> f64 {
        if self.eye.is_none() {
            self.local(p).z
        } else {
            self.on_plane(p).1
        }
    }

    /// The projection of `p`.
    #[inline]
    pub fn project(&self, p: DVec3) -> Projected {
        let (at, inverse_w) = self.on_plane(p);
        Projected {
            x: self.shift[0] + self.scale * at[0],
            y: self.shift[1] - self.scale * at[1],
            key: (self.raw_depth(p) - self.depth[0]) * self.depth[1],
            inverse_w,
        }
    }

    /// The eye; `None` if infinitely far.
    #[cfg(feature = "gpu")]
    pub fn eye_in_space(&self) -> Option<DVec3> {
        let [right, up, toward] = self.axes;
        self.eye
            .map(|eye| self.origin + eye.x * right + eye.y * up + eye.z * toward)
    }

    /// Samples per unit of length at unit distance, and depth per unit of what [`Self::raw_depth`] has.
    #[cfg(feature = "gpu")]
    pub fn scales(&self) -> [f64; 2] {
        [self.scale, self.depth[1]]
    }

    /// The matrix, column by column, from places relative to `origin` to clip coordinates: y points upward, depth grows from 0
    /// to 1 at the nearest place, with a little room at both ends, and the last coordinate is the distance.
    #[cfg(feature = "gpu")]
    pub fn clip(&self, origin: DVec3, size: [f64; 2]) -> [[f32; 4]; 4] {
        const ROOM_AT_ENDS: f64 = 2e-3;
        let local = DMat4::from_cols(
            DVec3::from_array(self.axes.map(|axis| axis.x)).extend(0.0),
            DVec3::from_array(self.axes.map(|axis| axis.y)).extend(0.0),
            DVec3::from_array(self.axes.map(|axis| axis.z)).extend(0.0),
            self.local(origin).extend(1.0),
        );
        let eye = self.eye.unwrap_or(DVec3::ZERO);
        // rows of the projection of local coordinates
        let distance = match self.eye {
            Some(eye) => DVec4::new(0.0, 0.0, -1.0, eye.z),
            None => DVec4::W,
        };
        let [low, per_unit] = self.depth;
        let depth = match self.eye {
            Some(_) => per_unit * DVec4::W - low * per_unit * distance,
            None => per_unit * (DVec4::Z - low * DVec4::W),
        };
        let depth = ROOM_AT_ENDS * distance + (1.0 - 2.0 * ROOM_AT_ENDS) * depth;
        let middle = [
            2.0 * self.shift[0] / size[0] - 1.0,
            1.0 - 2.0 * self.shift[1] / size[1],
        ];
        let scale = size.map(|size| 2.0 * self.scale / size);
        let x = scale[0] * (DVec4::X - eye.x * DVec4::W) + middle[0] * distance;
        let y = scale[1] * (DVec4::Y - eye.y * DVec4::W) + middle[1] * distance;
        let projection = DMat4::from_cols(x, y, depth, distance).transpose();
        (projection * local).as_mat4().to_cols_array_2d()
    }

    /// The distance of `p` along the axis of sight: from the eye, or from the origin of the view if that is infinitely far.
    pub fn depth(&self, p: DVec3) -> f64 {
        self.eye.map_or(0.0, |eye| eye.z) - self.local(p).z
    }

    /// The place at `sample` at a distance along the axis of sight, as [`Self::depth`] has it.
    pub fn place(&self, sample: [f64; 2], depth: f64) -> DVec3 {
        let x = (sample[0] - self.shift[0]) / self.scale;
        let y = (self.shift[1] - sample[1]) / self.scale;
        let local = match self.eye {
            None => DVec3::new(x, y, -depth),
            Some(eye) => eye + depth * DVec3::new(x, y, -1.0),
        };
        let [right, up, toward] = self.axes;
        self.origin + local.x * right + local.y * up + local.z * toward
    }

    /// The direction toward the eye as seen from a place at `sample`, of unit length, in the coordinates of the view.
    #[inline]
    pub fn toward_eye(&self, sample: [f64; 2]) -> DVec3 {
        if self.eye.is_none() {
            return DVec3::Z;
        }
        let x = (sample[0] - self.shift[0]) / self.scale;
        let y = (self.shift[1] - sample[1]) / self.scale;
        DVec3::new(-x, -y, 1.0).normalize()
    }

    /// Returns `true` if `p` is in front of the eye.
    pub fn is_in_front(&self, p: DVec3) -> bool {
        self.eye.is_none() || self.depth(p) > 0.0
    }

    /// The line of sight through `sample`.
    pub fn sight(&self, sample: [f64; 2]) -> Sight {
        match self.eye {
            Some(_) => Sight {
                origin: self.place(sample, 0.0),
                direction: (self.place(sample, 1.0) - self.place(sample, 0.0)).normalize(),
            },
            None => Sight {
                origin: self.place(sample, -self.front),
                direction: -self.axes[2],
            },
        }
    }

    /// Samples per unit of length at the depth of `p`.
    pub fn samples_per_unit(&self, p: DVec3) -> f64 {
        let distance = if self.eye.is_some() {
            self.depth(p)
        } else {
            1.0
        };
        self.scale / distance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube_corners() -> Vec<DVec3> {
        (0..8)
            .map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * 4.0)
            .collect()
    }

    fn projector(camera: &Camera) -> Projector {
        let corners = cube_corners();
        let bounds = Aabb::around(corners.iter().copied());
        Projector::new(camera, &corners, bounds, [200.0, 100.0])
    }

    #[test]
    fn axes_point_where_the_names_of_the_views_say() {
        for (view, right, up, toward) in [
            (View::FRONT, DVec3::X, DVec3::Z, -DVec3::Y),
            (View::RIGHT, DVec3::Y, DVec3::Z, DVec3::X),
            (View::BACK, -DVec3::X, DVec3::Z, DVec3::Y),
            (View::LEFT, -DVec3::Y, DVec3::Z, -DVec3::X),
            (View::TOP, DVec3::X, DVec3::Y, DVec3::Z),
            (View::BOTTOM, DVec3::X, -DVec3::Y, -DVec3::Z),
        ] {
            for (found, expected) in view.axes(UpAxis::Z).into_iter().zip([right, up, toward]) {
                assert!(found.distance(expected) < 1e-15, "{view:?}: {found}");
            }
        }
        let [right, up, toward] = View::FRONT.axes(UpAxis::Y);
        assert_eq!([right, up, toward], [DVec3::X, DVec3::Y, DVec3::Z]);
        let [_, _, toward] = View::ISO.axes(UpAxis::Z);
        assert!(toward.distance(DVec3::new(1.0, -1.0, 1.0).normalize()) < 1e-15);
        assert_eq!(View::from_name("top"), Some(View::TOP));
        assert_eq!(View::from_name("inside"), None);
    }

    #[test]
    fn everything_fits_and_touches_the_margin_in_every_view() {
        for (_, view) in View::NAMED {
            for projection in [
                Projection::Orthographic,
                Projection::Perspective {
                    field_of_view_deg: 60.0,
                },
            ] {
                let camera = Camera {
                    view,
                    projection,
                    ..Default::default()
                };
                let projector = projector(&camera);
                let at: Vec<Projected> = cube_corners()
                    .iter()
                    .map(|&p| projector.project(p))
                    .collect();
                let most = |f: &dyn Fn(&Projected) -> f64| {
                    at.iter().map(f).fold(f64::NEG_INFINITY, f64::max)
                };
                let width = most(&|p| (p.x - 100.0).abs()) / 100.0;
                let height = most(&|p| (p.y - 50.0).abs()) / 50.0;
                assert!(
                    (width.max(height) - FILL).abs() < 1e-9,
                    "{view:?} {width} {height}"
                );
                assert!((most(&|p| p.key) - 1.0).abs() < 1e-9 && most(&|p| -p.key).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn nearer_things_are_larger_in_perspective_only() {
        let width = |projection, y: f64| {
            let camera = Camera {
                view: View::FRONT,
                projection,
                ..Default::default()
            };
            let projector = projector(&camera);
            projector.project(DVec3::new(4.0, y, 0.0)).x
                - projector.project(DVec3::new(0.0, y, 0.0)).x
        };
        let wide = Projection::Perspective {
            field_of_view_deg: 90.0,
        };
        assert_eq!(
            width(Projection::Orthographic, 0.0),
            width(Projection::Orthographic, 4.0)
        );
        // The height is the smaller angle: its tangent is ½, so that the front is 4 from the eye and the back 8.
        assert!((width(wide, 0.0) / width(wide, 4.0) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn nothing_is_behind_the_eye_even_if_only_a_part_is_framed() {
        let camera = Camera {
            projection: Projection::Perspective {
                field_of_view_deg: 30.0,
            },
            frame: Some(Aabb::new(DVec3::splat(1.9), DVec3::splat(2.1))),
            ..Default::default()
        };
        let projector = projector(&camera);
        for corner in cube_corners() {
            let at = projector.project(corner);
            assert!(at.inverse_w.is_finite() && at.inverse_w > 0.0);
        }
    }

    #[test]
    fn cameras_that_make_no_sense_are_told() {
        let bad = |change: fn(&mut Camera)| {
            let mut camera = Camera::default();
            change(&mut camera);
            assert!(!camera.is_valid(), "{camera:?}");
        };
        assert!(Camera::default().is_valid());
        bad(|camera| camera.zoom = 0.0);
        bad(|camera| camera.view.azimuth_deg = f64::NAN);
        bad(|camera| camera.frame = Some(Aabb::EMPTY));
        bad(|camera| {
            camera.target = Some(Target {
                center: DVec3::ZERO,
                span: 0.0,
                bounds: Aabb::EMPTY,
            });
        });
        bad(|camera| {
            camera.projection = Projection::Perspective {
                field_of_view_deg: 180.0,
            };
        });
    }
}
