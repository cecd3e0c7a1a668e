//! The corner of a building seen by a camera whose lens is known: three vanishing points and two walls.
//!
//! The walls carry windows in a regular grid and courses of stone, the ground is paved. Light is flat on purpose: the scene
//! is about lines.
//!
//! World coordinates: meters, the foot of the corner in the origin, x along the right wall, z along the left one, y up.

use crate::paint::{hex, paint_adaptive};
use crate::random::Seed;
use crate::texture::fractal;
use glam::{DMat3, DVec2, DVec3, Vec3};
use ravec_raster::{Image, LinearRgb, Size};
use serde::{Deserialize, Serialize};

/// The camera, where its lines meet, and the walls.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BuildingTruth {
    /// The focal length in pixels. The axis of the lens goes through the middle of the picture.
    pub focal_px: f64,
    /// Vanishing points of lines along x, y and z, as homogeneous points of the picture.
    pub vanishing_points: [DVec3; 3],
    /// Images of the corners of the right and of the left wall: lower left, lower right, upper right, upper left.
    pub walls_in_image: [[DVec2; 4]; 2],
    /// Width by height of both walls.
    pub wall_ratios: [f64; 2],
}

/// Columns and rows of windows of the right wall, and columns of the left one.
const BAYS: [f64; 3] = [5.0, 4.0, 4.0];
/// Width and height of a bay in meters.
const BAY: DVec2 = DVec2::new(2.4, 3.0);

struct Camera {
    world_from_view: DMat3,
    position: DVec3,
    focal_px: f64,
    middle: DVec2,
}

impl Camera {
    fn image_of(&self, at: DVec3) -> DVec3 {
        self.image_of_direction(at - self.position)
    }

    /// A homogeneous point of the picture.
    fn image_of_direction(&self, direction: DVec3) -> DVec3 {
        let seen = self.world_from_view.transpose() * direction;
        (self.focal_px * seen.truncate() + seen.z * self.middle).extend(seen.z)
    }
}

/// The corner of a building with `focal` times the picture's diagonal as focal length, 0.5 to 3; the seed turns the camera and
/// moves stains.
pub fn building(size: Size, focal: f64, seed: Seed) -> (Image<LinearRgb>, BuildingTruth) {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let focal_px = focal * extent.length();
    let turn = |channel, low, high| seed.between(0, 0, channel, low, high);
    // towards the corner, from the side and from below, farther away with a longer lens
    let target = DVec3::new(1.2, 5.6, 1.0);
    let (side, eye) = (turn(1, 0.62, 0.95), turn(2, 0.7, 2.2));
    let away = 22.0 * focal / 0.8;
    let position = DVec3::new(
        target.x - away * side.cos(),
        eye,
        target.z - away * side.sin(),
    );
    let back = (position - target).normalize();
    let forward = -back;
    // x, y and z are a left-handed system, as x goes to the right and z away
    let right = DVec3::Y.cross(forward).normalize();
    let down = right.cross(forward);
    let roll = turn(3, -0.03, 0.03);
    let (sin, cos) = f64::sin_cos(roll);
    let camera = Camera {
        world_from_view: DMat3::from_cols(
            right * cos + down * sin,
            down * cos - right * sin,
            forward,
        ),
        position,
        focal_px,
        middle: 0.5 * extent,
    };
    let height = BAYS[1] * BAY.y;
    let widths = [BAYS[0] * BAY.x, BAYS[2] * BAY.x];
    let color = |p: DVec2, side_px: f64| {
        let ray = camera.world_from_view * ((p - camera.middle) / focal_px).extend(1.0);
        // distances to the right wall, the left wall and the ground along the ray
        let hits = [
            -position.z / ray.z,
            -position.x / ray.x,
            -position.y / ray.y,
        ];
        let mut nearest = (f64::INFINITY, sky_color(ray.normalize().y));
        for (wall, &distance) in hits.iter().enumerate() {
            let at = position + distance * ray;
            let footprint = side_px * distance / focal_px;
            let on_wall = |along: f64, width: f64| {
                (0.0..=width).contains(&along) && (0.0..=height).contains(&at.y)
            };
            let seen = match wall {
                0 => on_wall(at.x, widths[0])
                    .then(|| wall_color(DVec2::new(at.x, at.y), 1.0, footprint, seed)),
                1 => on_wall(at.z, widths[1])
                    .then(|| wall_color(DVec2::new(at.z, at.y), 0.62, footprint, seed.fork(1))),
                _ => Some(ground_color(DVec2::new(at.x, at.z), footprint)),
            };
            if let Some(seen) = seen
                && distance > 0.0
                && distance < nearest.0
            {
                nearest = (distance, seen);
            }
        }
        nearest.1
    };
    let image = paint_adaptive(size, 4, color);
    let corner = |x: f64, y: f64, z: f64| {
        let seen = camera.image_of(DVec3::new(x, y, z));
        seen.truncate() / seen.z
    };
    let truth = BuildingTruth {
        focal_px,
        vanishing_points: [DVec3::X, DVec3::Y, DVec3::Z]
            .map(|axis| camera.image_of_direction(axis)),
        walls_in_image: [
            [
                corner(0.0, 0.0, 0.0),
                corner(widths[0], 0.0, 0.0),
                corner(widths[0], height, 0.0),
                corner(0.0, height, 0.0),
            ],
            [
                corner(0.0, 0.0, widths[1]),
                corner(0.0, 0.0, 0.0),
                corner(0.0, height, 0.0),
                corner(0.0, height, widths[1]),
            ],
        ],
        wall_ratios: widths.map(|width| width / height),
    };
    (image, truth)
}

fn sky_color(up: f64) -> Vec3 {
    hex(0xa9c4e2).lerp(hex(0x5c86c0), up.clamp(0.0, 1.0) as f32)
}

/// Plaster with stains, windows with a bar, a ledge below each row.
fn wall_color(q: DVec2, light: f32, footprint: f64, seed: Seed) -> Vec3 {
    let bay = (q / BAY).fract();
    let in_window = (bay - DVec2::new(0.5, 0.56)).abs();
    let stain = 1.0 + 0.05 * fractal(q * 0.7, 0.7 * footprint, 4, seed) as f32;
    let color = if in_window.x < 0.24 && in_window.y < 0.28 {
        let frame = in_window.x > 0.21 || in_window.y > 0.255 || in_window.x < 0.012;
        if frame { hex(0xefe9dc) } else { hex(0x2c3a4a) }
    } else if bay.y < 0.06 {
        hex(0xc9bba0)
    } else {
        hex(0xb98f63) * stain
    };
    color * light
}

/// Slabs of two meters with joints.
fn ground_color(q: DVec2, footprint: f64) -> Vec3 {
    let slab = (q / 2.0).fract();
    let edge = slab.min(DVec2::ONE - slab).abs().min_element() * 2.0;
    // far joints fade instead of breaking up
    let joint = (0.05 / footprint.max(0.05)).min(1.0);
    let share = if edge < 0.03_f64.max(0.5 * footprint) {
        joint
    } else {
        0.0
    };
    hex(0x8d8a84).lerp(hex(0x55524e), share as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parallel_borders_meet_in_the_vanishing_points() {
        for seed in 0..6 {
            let (image, truth) = building(Size::new(160, 120).unwrap(), 0.9, Seed(seed));
            assert!(
                image
                    .pixels()
                    .iter()
                    .all(|p| p.0.iter().all(|v| (0.0..=1.0).contains(v)))
            );
            let line = |a: DVec2, b: DVec2| a.extend(1.0).cross(b.extend(1.0)).normalize();
            for (wall, axis) in truth.walls_in_image.iter().zip([0, 2]) {
                for (ends, axis) in [([0, 1], axis), ([3, 2], axis), ([0, 3], 1), ([1, 2], 1)] {
                    let line = line(wall[ends[0]], wall[ends[1]]);
                    let point = truth.vanishing_points[axis].normalize();
                    assert!(line.dot(point).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn the_vanishing_points_are_at_right_angles_for_the_focal_length() {
        let size = Size::new(160, 120).unwrap();
        let (_, truth) = building(size, 1.3, Seed(4));
        let ray = |v: DVec3| DVec3::new(v.x - 80.0 * v.z, v.y - 60.0 * v.z, truth.focal_px * v.z);
        let rays = truth.vanishing_points.map(|v| ray(v).normalize());
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            assert!(rays[a].dot(rays[b]).abs() < 1e-9);
        }
    }

    #[test]
    fn walls_are_where_they_are_said_to_be() {
        for seed in 0..8 {
            let (image, truth) = building(Size::new(320, 240).unwrap(), 0.8, Seed(seed));
            for wall in truth.walls_in_image {
                for corner in wall {
                    let inside = corner.cmpgt(DVec2::ZERO).all()
                        && corner.cmplt(DVec2::new(320.0, 240.0)).all();
                    assert!(inside, "{seed}: {corner}");
                }
                // on the wall there is no sky, and plaster and stone are warmer than the ground
                let middle = (wall[0] + wall[1] + wall[2] + wall[3]) / 4.0;
                let LinearRgb([r, _, b]) = image[(middle.x as usize, middle.y as usize)];
                assert!(b < 0.55 && r < 0.9);
            }
        }
    }
}
