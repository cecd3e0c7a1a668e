//! The map between space and picture, for picking, dragging and drawing over a picture.

use glam::DVec3;

use super::camera::{Camera, Projector};
use super::{RenderError, RenderParams};
use ravec_mesh::{Aabb, TriMesh};

/// The map between space and a picture, in pixels from its upper left corner; y points downward.
///
/// It is the one of [`render`](super::render) for the same camera, size and mesh. With a [`Target`](super::Target) whose bounds
/// contain the mesh it depends on no mesh.
#[derive(Debug, Clone, Copy)]
pub struct ScreenMap {
    projector: Projector,
}

/// A line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// A place on the line, in front of everything that is drawn; the eye if there is one.
    pub origin: DVec3,
    /// Away from the eye, of unit length.
    pub direction: DVec3,
}

impl ScreenMap {
    /// The map of a picture of `size` that shows a box, or a mesh that fills it.
    ///
    /// # Errors
    /// [`RenderError::Camera`] if the camera's numbers make no sense, or the size is not positive.
    pub fn new(camera: &Camera, bounds: Aabb, size: [f64; 2]) -> Result<Self, RenderError> {
        if !(camera.is_valid() && size.iter().all(|&side| side > 0.0 && side.is_finite())) {
            return Err(RenderError::Camera);
        }
        let corners: Vec<DVec3> = if bounds.is_empty() {
            Vec::new()
        } else {
            super::camera::corners(bounds).collect()
        };
        Ok(Self {
            projector: Projector::new(camera, &corners, bounds, size),
        })
    }

    /// The map of the picture of a mesh.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of(mesh: &TriMesh, params: &RenderParams) -> Result<Self, RenderError> {
        if !params.camera.is_valid() {
            return Err(RenderError::Camera);
        }
        let size = [params.width, params.height].map(f64::from);
        let points = super::used_positions(mesh);
        Ok(Self {
            projector: Projector::new(&params.camera, &points, mesh.bounds(), size),
        })
    }

    /// To the right, upward and toward the eye, of unit length.
    pub fn axes(&self) -> [DVec3; 3] {
        self.projector.axes
    }

    /// The place of `point` in the picture; `None` if it is not in front of the eye.
    pub fn project(&self, point: DVec3) -> Option<[f64; 2]> {
        if !self.projector.is_in_front(point) {
            return None;
        }
        let at = self.projector.project(point);
        (at.x.is_finite() && at.y.is_finite()).then_some([at.x, at.y])
    }

    /// The point below `at` that is as far from the eye, along the axis of sight, as `other`.
    pub fn at_depth_of(&self, at: [f64; 2], other: DVec3) -> DVec3 {
        self.projector.place(at, self.projector.depth(other))
    }

    /// The line of sight through `at`.
    pub fn sight(&self, at: [f64; 2]) -> Sight {
        self.projector.sight(at)
    }

    /// Pixels per unit of length at the depth of `point`.
    pub fn pixels_per_unit(&self, point: DVec3) -> f64 {
        self.projector.samples_per_unit(point)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Paint, Projection, Target, View, render};
    use super::*;
    use ravec_progress::Progress;

    fn cameras() -> Vec<Camera> {
        let perspective = Projection::Perspective {
            field_of_view_deg: 40.0,
        };
        let bounds = Aabb::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(5.0, 4.0, 4.0));
        let targets = [0.3, 4.0, 90.0].map(|span| {
            Some(Target {
                center: DVec3::new(1.5, 2.5, 3.9),
                span,
                bounds,
            })
        });
        let mut cameras = Vec::new();
        for projection in [Projection::Orthographic, perspective] {
            for view in [View::FRONT, View::ISO, View::new(200.0, -50.0)] {
                for target in [None].into_iter().chain(targets) {
                    cameras.push(Camera {
                        view,
                        projection,
                        target,
                        ..Camera::default()
                    });
                }
            }
        }
        cameras
    }

    fn map(camera: &Camera) -> ScreenMap {
        let bounds = Aabb::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(5.0, 4.0, 4.0));
        ScreenMap::new(camera, bounds, [300.0, 200.0]).unwrap()
    }

    #[test]
    fn a_target_is_in_the_middle_and_its_span_across_the_smaller_side() {
        for camera in cameras() {
            let Some(target) = camera.target else {
                continue;
            };
            let map = map(&camera);
            let [right, up, _] = map.axes();
            let at = map.project(target.center).unwrap();
            assert!((at[0] - 150.0).abs() < 1e-9 && (at[1] - 100.0).abs() < 1e-9);
            let top = map.project(target.center + 0.5 * target.span * up).unwrap();
            assert!(top[1].abs() < 1e-9, "{camera:?} {top:?}");
            let side = map.project(target.center + 0.75 * target.span * right);
            assert!((side.unwrap()[0] - 300.0).abs() < 1e-9);
            let per_unit = map.pixels_per_unit(target.center);
            assert!((per_unit * target.span / 200.0 - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn places_and_sights_project_to_where_they_come_from() {
        for camera in cameras() {
            let map = map(&camera);
            for at in [[0.0, 0.0], [10.0, 190.0], [150.0, 100.0], [299.0, 3.0]] {
                for other in [DVec3::new(1.0, 2.0, 3.0), DVec3::new(5.0, 4.0, 4.0)] {
                    let place = map.at_depth_of(at, other);
                    let found = map.project(place).unwrap();
                    let error = (found[0] - at[0]).hypot(found[1] - at[1]);
                    assert!(error < 1e-7, "{camera:?} {at:?} {found:?}");
                    let toward = map.axes()[2];
                    assert!((place - other).dot(toward).abs() < 1e-9);
                    let sight = map.sight(at);
                    let along = (place - sight.origin).dot(sight.direction);
                    let beside = place - sight.origin - along * sight.direction;
                    assert!(beside.length() < 1e-9 * (1.0 + along), "{camera:?}");
                    assert!(along > 0.0, "everything is in front of the origin");
                }
            }
        }
    }

    #[test]
    fn the_map_is_that_of_the_picture() {
        // a tiny triangle far from the middle is drawn where the map says, among others
        let corners = [[1.0, 2.0, 3.0], [5.0, 4.0, 4.0], [4.0, 2.2, 3.9]].map(DVec3::from_array);
        let mut positions = corners.to_vec();
        let mut triangles = Vec::new();
        for corner in corners {
            let first = positions.len() as u32;
            let away = [
                DVec3::ZERO,
                DVec3::new(0.04, 0.03, 0.0),
                DVec3::new(0.0, 0.03, 0.05),
            ];
            positions.extend(away.map(|away| corner + away));
            triangles.push([first, first + 1, first + 2]);
        }
        let mesh = TriMesh::new(positions, triangles).unwrap();
        for camera in cameras() {
            let params = RenderParams {
                width: 300,
                height: 200,
                samples_per_side: 2,
                camera,
                features: None,
                background: None,
                ..RenderParams::default()
            };
            let picture = render(&mesh, &Paint::Plain, &params, &Progress::none())
                .unwrap()
                .picture;
            let map = ScreenMap::of(&mesh, &params).unwrap();
            for corners in mesh.triangles() {
                let corners = corners.map(|v| mesh.positions()[v as usize]);
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                let [x, y] = map.project(middle).unwrap();
                let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let shown = area.dot(map.axes()[2]).abs() * map.pixels_per_unit(middle).powi(2);
                let inside = (0.0..300.0).contains(&x) && (0.0..200.0).contains(&y);
                if inside && shown > 20.0 {
                    let start = 4 * (y as usize * 300 + x as usize);
                    assert_eq!(picture.pixels[start + 3], 255, "{camera:?} {x} {y}");
                }
            }
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        let bounds = Aabb::new(DVec3::ZERO, DVec3::ONE);
        let camera = Camera::default();
        for size in [[0.0, 1.0], [1.0, f64::NAN], [-1.0, 1.0]] {
            assert_eq!(
                ScreenMap::new(&camera, bounds, size).err(),
                Some(RenderError::Camera)
            );
        }
        let empty = ScreenMap::new(&camera, Aabb::EMPTY, [3.0, 2.0]).unwrap();
        assert!(empty.project(DVec3::ZERO).is_some());
    }
}
