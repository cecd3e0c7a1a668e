//! A camera in front of a plane: where it looks, how near it is, and how it is turned.
//!
//! The background of a shot is one plane, measured in world pixels (x to the right, y down): pixels of the frame as long
//! as the camera stands straight before the plane at zoom 1. The camera orbits the point that it looks at, which stays in
//! the middle of the frame: a turn by `yaw` and `pitch` foreshortens the plane and moves that point nowhere.

use crate::clip::track::{Moment, Track};
use glam::{DMat3, DVec2, DVec3};
use ravec_raster::Size;
use serde::{Deserialize, Serialize};

/// A camera over the time of a shot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// The world point in the middle of the frame: x and y, world pixels.
    pub look: [Track; 2],
    /// Frame pixels per world pixel at the point that the camera looks at, above 0.
    pub zoom: Track,
    /// Turn of the picture about the viewing axis, clockwise, radians.
    pub roll_rad: Track,
    /// Tilt about the horizontal axis: positive moves the upper part of the plane away.
    pub pitch_rad: Track,
    /// Turn about the vertical axis: positive moves the right part of the plane away.
    pub yaw_rad: Track,
    /// Focal length in frame pixels, above 0: smaller gives a stronger perspective for the same turn.
    pub focal_px: f64,
}

impl Camera {
    /// A camera that stands still straight before a point, at zoom 1 and a normal focal length for the frame.
    pub fn still(look: DVec2, size: Size) -> Self {
        Self {
            look: [Track::Constant(look.x), Track::Constant(look.y)],
            zoom: Track::Constant(1.0),
            roll_rad: Track::Constant(0.0),
            pitch_rad: Track::Constant(0.0),
            yaw_rad: Track::Constant(0.0),
            focal_px: 1.1 * size.width().max(size.height()) as f64,
        }
    }

    /// Maps (x, y, 1) in the world to the frame, at a moment.
    ///
    /// Its third row is 1 at the point that the camera looks at, and positive in front of the camera.
    pub fn frame_from_world(&self, moment: Moment, size: Size) -> DMat3 {
        let value = |track: &Track| track.at(moment);
        let turn = DMat3::from_rotation_z(value(&self.roll_rad))
            * DMat3::from_rotation_y(-value(&self.yaw_rad))
            * DMat3::from_rotation_x(-value(&self.pitch_rad));
        let zoom = value(&self.zoom);
        // the plane's axes in the camera's frame, at the distance that gives the zoom
        let axis = |column: DVec3| {
            DVec3::new(
                zoom * column.x,
                zoom * column.y,
                zoom * column.z / self.focal_px,
            )
        };
        let plane = DMat3::from_cols(axis(turn.x_axis), axis(turn.y_axis), DVec3::Z);
        let center = 0.5 * DVec2::new(size.width() as f64, size.height() as f64);
        let look = DVec2::new(value(&self.look[0]), value(&self.look[1]));
        DMat3::from_translation(center) * plane * DMat3::from_translation(-look)
    }
}

/// The image of a point under a homography, if it lies in front.
pub fn project(m: &DMat3, p: DVec2) -> Option<DVec2> {
    let h = *m * p.extend(1.0);
    // nearer to the horizon than this, coordinates lose their meaning
    (h.z > 1e-6).then(|| h.truncate() / h.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Moment = Moment {
        share: 0.0,
        secs: 0.0,
    };

    fn size() -> Size {
        Size::new(640, 360).unwrap()
    }

    #[test]
    fn a_still_camera_shifts_the_world() {
        let camera = Camera::still(DVec2::new(500.0, 200.0), size());
        let m = camera.frame_from_world(START, size());
        let p = project(&m, DVec2::new(510.0, 195.0)).unwrap();
        assert!(p.distance(DVec2::new(330.0, 175.0)) < 1e-9);
    }

    #[test]
    fn turns_keep_the_point_that_the_camera_looks_at_and_shrink_the_far_side() {
        let look = DVec2::new(500.0, 200.0);
        let mut camera = Camera::still(look, size());
        camera.yaw_rad = Track::Constant(0.5);
        camera.zoom = Track::Constant(1.5);
        let m = camera.frame_from_world(START, size());
        let middle = project(&m, look).unwrap();
        assert!(middle.distance(DVec2::new(320.0, 180.0)) < 1e-9);
        let reach = |dx: f64| (project(&m, look + DVec2::new(dx, 0.0)).unwrap().x - 320.0).abs();
        assert!(reach(100.0) < reach(-100.0));
        // the scale at the middle is the zoom, foreshortened across
        assert!((reach(1e-4) / 1e-4 - 1.5 * 0.5f64.cos()).abs() < 1e-3);
        camera.pitch_rad = Track::Constant(0.4);
        camera.yaw_rad = Track::Constant(0.0);
        let m = camera.frame_from_world(START, size());
        let wide = |dy: f64| {
            let end = |dx: f64| project(&m, look + DVec2::new(dx, dy)).unwrap();
            end(50.0).x - end(-50.0).x
        };
        assert!(wide(-80.0) < wide(80.0));
    }

    #[test]
    fn points_behind_the_camera_have_no_image() {
        let mut camera = Camera::still(DVec2::ZERO, size());
        camera.yaw_rad = Track::Constant(1.2);
        let m = camera.frame_from_world(START, size());
        assert!(project(&m, DVec2::new(-5000.0, 0.0)).is_none());
        assert!(project(&m, DVec2::new(5000.0, 0.0)).is_some());
    }
}
