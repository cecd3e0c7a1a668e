//! Portraits of rigid shapes on strong texture, and long straight lines: what must survive a change of format.
//!
//! A portrait is a disc above a square. Nothing covers anything but the square its line; ground is everywhere as rough
//! as shapes are distinct from it, so that contrast alone does not mark what matters.

use crate::coverage::HalfPlane;
use crate::paint::{center, hex};
use crate::random::Seed;
use crate::shapes::{Shape, ShapesTruth};
use crate::texture::fractal;
use glam::{DVec2, Vec3, dvec2};
use ravec_raster::{Image, LinearRgb, Size};

/// Colors that no ground has.
const PALETTE: [u32; 6] = [0xc8201e, 0x1f4fa8, 0x1d7a3c, 0x8b2a9b, 0x16181f, 0xb86a00];

/// One to three portraits and two lines, as the seed finds room.
pub fn portraits(size: Size, seed: Seed) -> (Image<LinearRgb>, ShapesTruth) {
    let truth = layout(size, seed);
    let scale = size.width().max(size.height()) as f64;
    let mut image = Image::new(size, LinearRgb([0.0; 3]));
    let ground = [hex(0xe8dcc6), hex(0xc9d6e2)];
    // grains of about a hundredth of the picture; those of half the size are half as strong
    let grain = seed.between(0, 0, 1, 60.0, 110.0);
    let roughness = seed.between(0, 0, 2, 0.25, 0.45);
    image.for_each_row(|row, pixels| {
        for (col, pixel) in pixels.iter_mut().enumerate() {
            let p = center(col, row);
            let q = p / scale;
            let rough = fractal(q * grain, grain / scale, 3, seed.fork(4));
            let share = (row as f32 + 0.5) / size.height() as f32;
            let light = (1.0 + roughness * rough).max(0.0) as f32;
            let mut color = (ground[1].lerp(ground[0], share) * light).min(Vec3::ONE);
            for shape in &truth.shapes {
                color = color.lerp(Vec3::from_array(shape.color()), shape.coverage(p) as f32);
            }
            *pixel = LinearRgb(color.to_array());
        }
    });
    (image, truth)
}

fn layout(size: Size, seed: Seed) -> ShapesTruth {
    let extent = dvec2(size.width() as f64, size.height() as f64);
    let unit = extent.min_element();
    let color = |i: i64| hex(PALETTE[(seed.bits(i, 0, 9) % 6) as usize]).to_array();
    let wanted = 1 + (seed.bits(0, 0, 3) % 3) as usize;
    let mut figures: Vec<(DVec2, f64)> = Vec::new();
    let mut shapes = Vec::new();
    for i in 0..60 {
        if figures.len() == wanted {
            break;
        }
        let head = unit * seed.between(i, 1, 0, 0.07, 0.12);
        // the figure is 4 heads high and 2 wide
        let reach = 2.3 * head;
        let at = reach + (extent - 2.0 * reach) * dvec2(seed.unit(i, 1, 1), seed.unit(i, 1, 2));
        if figures
            .iter()
            .any(|&(other, r)| other.distance(at) < 1.1 * (r + reach))
        {
            continue;
        }
        shapes.push(Shape::Disc {
            center: at - dvec2(0.0, head),
            radius_px: head,
            color: color(2 * i),
        });
        shapes.push(Shape::Square {
            center: at + dvec2(0.0, 1.05 * head),
            side_px: 1.9 * head,
            angle_rad: 0.0,
            color: color(2 * i + 1),
        });
        figures.push((at, reach));
    }
    let mut lines = Vec::new();
    for i in 0..80 {
        if lines.len() == 2 {
            break;
        }
        let through = extent
            * dvec2(
                seed.between(i, 2, 0, 0.1, 0.9),
                seed.between(i, 2, 1, 0.1, 0.9),
            );
        let angle = seed.between(i, 2, 2, 0.0, std::f64::consts::PI);
        let line = HalfPlane::from_angle(angle, through);
        if figures
            .iter()
            .all(|&(at, reach)| line.distance(at).abs() > reach)
        {
            lines.push(Shape::Line {
                normal: line.normal,
                offset_px: line.offset_px,
                width_px: unit * seed.between(i, 2, 3, 0.008, 0.016),
                color: color(200 + i),
            });
        }
    }
    lines.extend(shapes);
    ShapesTruth { shapes: lines }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_stand_apart_from_each_other_and_from_lines() {
        let size = Size::new(360, 240).unwrap();
        for seed in 0..12 {
            let (image, truth) = portraits(size, Seed(seed));
            let heads = truth
                .shapes
                .iter()
                .filter(|shape| matches!(shape, Shape::Disc { .. }));
            assert!((1..=3).contains(&heads.count()), "{seed}");
            for shape in &truth.shapes {
                if let Shape::Disc { center, color, .. } | Shape::Square { center, color, .. } =
                    *shape
                {
                    assert_eq!(image[(center.x as usize, center.y as usize)].0, color);
                    let others = truth.shapes.iter().filter(|other| *other != shape);
                    // areas of pixels under a shape are sums that cancel
                    assert!(
                        others
                            .map(|other| other.coverage(center).abs())
                            .sum::<f64>()
                            < 1e-9
                    );
                }
            }
        }
    }
}
