//! A leaf with a soft edge on nothing: a picture with transparency.

use crate::coverage::above;
use crate::paint::{center, hex};
use crate::random::Seed;
use crate::texture::{fractal, smoothstep};
use glam::{DVec2, Vec3};
use ravec_raster::{Image, LinearRgba, Size};
use serde::{Deserialize, Serialize};

/// The outline of the leaf: the intersection of two discs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SpriteTruth {
    /// Centers of the two discs, image coordinates.
    pub centers: [DVec2; 2],
    /// Radius of both.
    pub radius_px: f64,
    /// Width over which alpha falls from 1 to 0, linearly in the distance from the outline, half of it on each side.
    pub softness_px: f64,
}

impl SpriteTruth {
    /// Distance from the nearer of the two circles, negative inside the leaf.
    pub fn distance(&self, p: DVec2) -> f64 {
        self.centers[0].distance(p).max(self.centers[1].distance(p)) - self.radius_px
    }

    /// Alpha at a position.
    pub fn alpha(&self, p: DVec2) -> f64 {
        above(-self.distance(p), 0.0, self.softness_px)
    }
}

/// A leaf with veins; outside it the pixels are fully transparent black.
pub fn sprite(size: Size, seed: Seed) -> (Image<LinearRgba>, SpriteTruth) {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let unit = extent.min_element();
    let angle = seed.between(0, 0, 0, -1.1, -0.5);
    let axis = DVec2::from_angle(angle);
    let middle = 0.5 * extent;
    let truth = SpriteTruth {
        centers: [
            middle + 0.30 * unit * axis.perp(),
            middle - 0.30 * unit * axis.perp(),
        ],
        radius_px: 0.53 * unit,
        softness_px: (0.02 * unit).max(1.0),
    };
    let mut image = Image::new(size, LinearRgba([0.0; 4]));
    image.for_each_row(|row, pixels| {
        for (col, pixel) in pixels.iter_mut().enumerate() {
            let p = center(col, row);
            let alpha = truth.alpha(p);
            if alpha > 0.0 {
                let offset = (p - middle) / unit;
                let q = DVec2::new(offset.dot(axis), offset.dot(axis.perp()));
                *pixel =
                    LinearRgba::from_rgb_alpha(leaf(q, 1.0 / unit, seed).to_array(), alpha as f32);
            }
        }
    });
    (image, truth)
}

/// The leaf's color; `q` along and across it, in units of the picture's smaller side.
fn leaf(q: DVec2, footprint: f64, seed: Seed) -> Vec3 {
    let cloud = fractal(q * 6.0, 6.0 * footprint, 5, seed.fork(1));
    let autumn = smoothstep(-0.4, 0.6, q.x + 0.4 * cloud);
    let mut color = hex(0x3f7d2a).lerp(hex(0xd8a02c), autumn as f32) * (1.0 + 0.18 * cloud) as f32;
    // side veins leave the middle one at a slant, in turns
    let side = q.x - 1.1 * q.y.abs() + if q.y > 0.0 { 0.04 } else { 0.0 };
    let t = (side / 0.08).rem_euclid(1.0) - 0.5;
    let vein = smoothstep(0.006, 0.002, t.abs() * 0.08 - 0.5 * footprint).max(smoothstep(
        0.009,
        0.004,
        q.y.abs() - 0.5 * footprint,
    ));
    // light falls across the blade between the veins
    color *= (1.0 + 0.35 * t * q.y.signum() + 0.5 * q.y) as f32;
    color
        .lerp(hex(0xe6dc8c), 0.75 * vein as f32)
        .max(Vec3::splat(0.002))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alpha_is_full_in_the_middle_half_on_the_outline_and_nothing_outside() {
        let size = Size::new(80, 60).unwrap();
        let (image, truth) = sprite(size, Seed(1));
        assert_eq!(image[(40, 30)].alpha(), 1.0);
        assert_eq!(image[(0, 0)], LinearRgba([0.0; 4]));
        let on =
            truth.centers[0] + truth.radius_px * (truth.centers[1] - truth.centers[0]).normalize();
        assert!((truth.alpha(on) - 0.5).abs() < 1e-9);
    }
}
