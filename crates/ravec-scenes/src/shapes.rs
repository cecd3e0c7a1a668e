//! Discs, squares and long straight lines on a landscape: shapes that must stay what they are.
//!
//! A method that changes the format of a picture may squeeze the meadow, but a disc should stay round and a line
//! straight. Shapes do not overlap, except that lines lie under discs and squares; each is a flat color with exact
//! coverage.

use crate::coverage::{HalfPlane, disc_coverage, intersection_coverage};
use crate::paint::{hex, paint_adaptive};
use crate::random::Seed;
use crate::sky::sky;
use crate::stage::film;
use crate::texture::{fractal, grass, smoothstep};
use glam::{DVec2, DVec3, Vec3};
use ravec_raster::{Image, LinearRgb, Size};
use serde::{Deserialize, Serialize};

/// One shape; lengths in pixels, colors in linear light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "shape", rename_all = "snake_case")]
pub enum Shape {
    /// A disc.
    Disc {
        /// Its center.
        center: DVec2,
        /// Its radius.
        radius_px: f64,
        /// Its color.
        color: [f32; 3],
    },
    /// A square.
    Square {
        /// Its center.
        center: DVec2,
        /// Length of a side.
        side_px: f64,
        /// Angle of its sides against the image axes.
        angle_rad: f64,
        /// Its color.
        color: [f32; 3],
    },
    /// A line through the whole picture: `normal·p = offset_px`.
    Line {
        /// Unit normal.
        normal: DVec2,
        /// Distance of the line's middle from the origin.
        offset_px: f64,
        /// Full width.
        width_px: f64,
        /// Its color.
        color: [f32; 3],
    },
}

impl Shape {
    /// The area of the shape within the pixel around `p`, exact.
    pub fn coverage(&self, p: DVec2) -> f64 {
        match *self {
            Self::Disc {
                center, radius_px, ..
            } => disc_coverage(center, radius_px, p),
            Self::Square {
                center,
                side_px,
                angle_rad,
                ..
            } => {
                // far pixels need no clipping
                if p.distance(center) > 0.71 * (side_px + 1.0) {
                    return 0.0;
                }
                let axis = DVec2::from_angle(angle_rad);
                let side = |normal: DVec2| HalfPlane {
                    normal,
                    offset_px: normal.dot(center) + 0.5 * side_px,
                };
                intersection_coverage(
                    &[
                        side(axis),
                        side(-axis),
                        side(axis.perp()),
                        side(-axis.perp()),
                    ],
                    p,
                )
            }
            Self::Line {
                normal,
                offset_px,
                width_px,
                ..
            } => {
                let border = |shift: f64| HalfPlane {
                    normal,
                    offset_px: offset_px + shift * width_px,
                };
                border(0.5).coverage(p) - border(-0.5).coverage(p)
            }
        }
    }

    pub(crate) fn color(&self) -> [f32; 3] {
        match *self {
            Self::Disc { color, .. } | Self::Square { color, .. } | Self::Line { color, .. } => {
                color
            }
        }
    }
}

/// Shapes on the landscape, the first at the back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShapesTruth {
    /// All shapes.
    pub shapes: Vec<Shape>,
}

/// A landscape with three lines, and as many discs and squares as the seed finds room for (at most 5 of each).
pub fn shapes(size: Size, seed: Seed) -> (Image<LinearRgb>, ShapesTruth) {
    let truth = layout(size, seed);
    let mut image = landscape(size, seed.fork(50));
    let shapes = &truth.shapes;
    image.for_each_row(|row, pixels| {
        for (col, pixel) in pixels.iter_mut().enumerate() {
            let p = crate::paint::center(col, row);
            let mut color = Vec3::from_array(pixel.0);
            for shape in shapes {
                color = color.lerp(Vec3::from_array(shape.color()), shape.coverage(p) as f32);
            }
            *pixel = LinearRgb(color.to_array());
        }
    });
    (image, truth)
}

fn layout(size: Size, seed: Seed) -> ShapesTruth {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let unit = extent.min_element();
    let palette = [
        0xd83a2e, 0xf0b82c, 0x2463a8, 0xf4f1ea, 0x23242c, 0x3f8f5a, 0xb05293,
    ];
    let color = |i: i64| hex(palette[(seed.bits(i, 0, 9) % 7) as usize]).to_array();
    let mut shapes = Vec::new();
    for i in 0..3 {
        let through = extent
            * DVec2::new(
                seed.between(i, 0, 0, 0.25, 0.75),
                seed.between(i, 0, 1, 0.25, 0.75),
            );
        let line = HalfPlane::from_angle(seed.between(i, 0, 2, 0.0, std::f64::consts::PI), through);
        shapes.push(Shape::Line {
            normal: line.normal,
            offset_px: line.offset_px,
            width_px: unit * seed.between(i, 0, 3, 0.006, 0.018),
            color: color(i),
        });
    }
    // darts that hit occupied ground are thrown away
    let mut taken: Vec<(DVec2, f64)> = Vec::new();
    for i in 0..60 {
        if taken.len() >= 10 {
            break;
        }
        let reach = unit * seed.between(i, 1, 0, 0.05, 0.14);
        let room = extent - 2.0 * reach;
        let center = reach + room * DVec2::new(seed.unit(i, 1, 1), seed.unit(i, 1, 2));
        if taken
            .iter()
            .any(|&(other, r)| other.distance(center) < 1.15 * (r + reach))
        {
            continue;
        }
        let color = color(10 + i);
        shapes.push(if taken.len().is_multiple_of(2) {
            Shape::Disc {
                center,
                radius_px: reach,
                color,
            }
        } else {
            Shape::Square {
                center,
                side_px: reach * std::f64::consts::SQRT_2,
                angle_rad: seed.between(i, 1, 3, 0.0, std::f64::consts::FRAC_PI_2),
                color,
            }
        });
        taken.push((center, reach));
    }
    ShapesTruth { shapes }
}

/// A meadow in perspective, hills in the haze, and a sky.
pub fn landscape(size: Size, seed: Seed) -> Image<LinearRgb> {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    paint_adaptive(size, 3, landscape_painter(extent, seed))
}

/// The landscape as a function of the position in a picture of an extent, and of the side of the sample.
pub(crate) fn landscape_painter(extent: DVec2, seed: Seed) -> impl Fn(DVec2, f64) -> Vec3 + Sync {
    let scale = extent.max_element();
    let sun = DVec3::new(-0.5, 0.55, -0.3).normalize();
    move |p, side| {
        let q = (p - extent * DVec2::new(0.5, 0.52)) / scale;
        let footprint = side / scale;
        // three ridges, each nearer, greener and lower
        for ridge in (0..3).rev() {
            let k = f64::from(ridge);
            let height = 0.115 - 0.045 * k;
            let outline = height
                * (0.55
                    + 0.6
                        * fractal(
                            DVec2::new(q.x * (2.0 + 1.5 * k) + 9.0 * k, k),
                            0.0,
                            5,
                            seed.fork(ridge as u64),
                        ));
            let last = ridge == 2;
            if last && q.y > -0.01 + 0.02 * (4.0 * q.x).sin() {
                break;
            }
            if !last && -q.y < outline - 0.01 * (2.0 - k) && -q.y > -0.05 {
                // nearer ridges were handled by the loop's order
                let woods = fractal(q * 60.0, 60.0 * footprint, 4, seed.fork(7 + ridge as u64));
                let near = hex(0x3d5a38) * (1.0 + 0.35 * woods) as f32;
                let haze = hex(0xb4c6d8);
                return film(near.lerp(haze, 0.72 - 0.34 * k as f32), 1.25);
            }
        }
        let horizon = -0.01 + 0.02 * (4.0 * q.x).sin();
        if q.y > horizon {
            // the meadow's distance grows towards the horizon
            let depth = 0.35 / (q.y - horizon + 0.012);
            let ground = DVec2::new(q.x * depth * 2.0, depth * 1.6);
            let width = footprint * depth * (2.0 * depth).max(2.0).sqrt();
            let tuft = grass(ground, width, seed.fork(20));
            let shade = 0.75 + 0.35 * fractal(ground * 0.25, 0.25 * width, 4, seed.fork(21));
            let warm = Vec3::new(1.9, 1.75, 1.2) * shade as f32;
            return film(
                (tuft * warm).lerp(hex(0xa8baa8), smoothstep(3.0, 30.0, depth) as f32 * 0.6),
                0.9,
            );
        }
        let direction = DVec3::new(q.x, 0.05 - q.y, -0.75).normalize();
        film(sky(direction, 1.3 * footprint, sun, seed.fork(30)), 0.75)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_each_shape_has_its_color() {
        let size = Size::new(300, 200).unwrap();
        for seed in 0..4 {
            let (image, truth) = shapes(size, Seed(seed));
            assert!(truth.shapes.len() >= 9);
            for shape in &truth.shapes {
                if let Shape::Disc { center, color, .. } | Shape::Square { center, color, .. } =
                    *shape
                {
                    assert_eq!(image[(center.x as usize, center.y as usize)].0, color);
                }
            }
        }
    }

    #[test]
    fn covered_pixels_add_up_to_the_areas() {
        let size = Size::new(200, 150).unwrap();
        for shape in &layout(size, Seed(5)).shapes {
            let sum: f64 = (0..200 * 150)
                .map(|i| shape.coverage(crate::paint::center(i % 200, i / 200)))
                .sum();
            match *shape {
                Shape::Disc { radius_px, .. } => {
                    assert!((sum - std::f64::consts::PI * radius_px * radius_px).abs() < 1e-6);
                }
                Shape::Square { side_px, .. } => assert!((sum - side_px * side_px).abs() < 1e-6),
                Shape::Line { .. } => assert!(sum > 0.0),
            }
        }
    }
}
