//! Textured planes in perspective: a house front and a tiled floor under a known homography.
//!
//! The plane's content is a function of its own coordinates, and each sample of the picture is mapped back to the plane
//! by the inverse homography, so the truth is the matrix that made the picture. The light is textured on purpose (shade
//! of leaves, sun through windows): a method that takes shadows for structure shows it here.
//!
//! Plane coordinates: meters, x to the right; y up on a front, away from the viewer on a floor.

use crate::facade::{Facade, Gable, Wall};
use crate::paint::{hex, paint_adaptive};
use crate::random::Seed;
use crate::shopfront::GroundFloor;
use crate::sky::sky;
use crate::stage::film;
use crate::texture::{Masonry, fractal, marble, smoothstep, tiles};
use glam::{DMat3, DVec2, DVec3, Vec3};
use ravec_raster::{Image, LinearRgb, Size};
use serde::{Deserialize, Serialize};

/// Place of a plane, and of the things on it, in the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlaneTruth {
    /// Maps (x, y, 1) on the plane to the image; serialized column by column.
    pub image_from_plane: DMat3,
    /// Extent of the textured rectangle, which begins at (0, 0).
    pub size: DVec2,
    /// Images of its corners: (0, 0), (width, 0), (width, height), (0, height).
    pub corners_in_image: [DVec2; 4],
    /// Images of the corners of its features in the same order: windows of a front, marked tiles of a floor.
    pub features_in_image: Vec<[DVec2; 4]>,
}

impl PlaneTruth {
    fn new(corners: [DVec2; 4], size: DVec2, features: impl Iterator<Item = [DVec2; 4]>) -> Self {
        let image_from_plane = image_from_unit_square(corners) * DMat3::from_scale(size.recip());
        Self {
            image_from_plane,
            size,
            corners_in_image: corners,
            features_in_image: features
                .map(|quad| quad.map(|q| map(&image_from_plane, q)))
                .collect(),
        }
    }
}

fn map(m: &DMat3, q: DVec2) -> DVec2 {
    let h = *m * q.extend(1.0);
    h.truncate() / h.z
}

/// The homography that maps (0, 0), (1, 0), (1, 1), (0, 1) to four points, no three of them on a line.
///
/// Source: Heckbert, "Fundamentals of texture mapping and image warping", 1989, section 2.2.3.
pub fn image_from_unit_square(corners: [DVec2; 4]) -> DMat3 {
    let [p0, p1, p2, p3] = corners;
    let (d1, d2, sum) = (p1 - p2, p3 - p2, p0 - p1 + p2 - p3);
    let determinant = d1.perp_dot(d2);
    let g = sum.perp_dot(d2) / determinant;
    let h = d1.perp_dot(sum) / determinant;
    DMat3::from_cols(
        (p1 - p0 + g * p1).extend(g),
        (p3 - p0 + h * p3).extend(h),
        p0.extend(1.0),
    )
}

/// The plane point under an image point, and the side of the square on the plane that `side` pixels there stand for.
fn plane_sample(plane_from_image: &DMat3, p: DVec2, side: f64) -> Option<(DVec2, f64)> {
    let h = *plane_from_image * p.extend(1.0);
    let along = |step: DVec2| {
        let next = *plane_from_image * (p + step).extend(1.0);
        next.truncate() / next.z
    };
    let q = h.truncate() / h.z;
    let (dx, dy) = (along(DVec2::X * side) - q, along(DVec2::Y * side) - q);
    // the geometric mean of the footprint's axes is the root of its area
    let footprint = dx.perp_dot(dy).abs().sqrt();
    (q.is_finite() && footprint.is_finite()).then_some((q, footprint))
}

/// Corners given as fractions of the picture, moved a little by the seed.
fn placed(size: Size, corners: [(f64, f64); 4], seed: Seed) -> [DVec2; 4] {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let mut index = 0;
    corners.map(|(x, y)| {
        index += 1;
        let jitter = DVec2::new(seed.unit(index, 0, 0), seed.unit(index, 0, 1)) - 0.5;
        extent * (DVec2::new(x, y) + 0.03 * jitter)
    })
}

/// A house front with 3 × 5 windows, shutters, a door and ledges, in the shade of a tree, before the sky.
pub fn facade(size: Size, seed: Seed) -> (Image<LinearRgb>, PlaneTruth) {
    let walls = [
        Wall::Plaster(hex(0xe2b884)),
        Wall::Brick(hex(0xa5573e)),
        Wall::Plaster(hex(0xc9d0c4)),
    ];
    let front = Facade {
        width: 13.0,
        height: 12.7,
        gable: Gable::None,
        wall: walls[(seed.bits(0, 0, 7) % 3) as usize],
        trim: hex(0xeee6d6),
        shutters: Some(hex(0x3f6670)),
        bays: 5,
        ground_floor: GroundFloor::Door(hex(0x7a2d24)),
        seed: seed.fork(1),
    };
    let extent = DVec2::new(front.width, front.height);
    let corners = placed(
        size,
        [(0.07, 1.02), (0.97, 0.90), (0.94, 0.24), (0.10, 0.05)],
        seed.fork(2),
    );
    let windows = front.windows().map(|w| {
        [
            w.low,
            DVec2::new(w.high.x, w.low.y),
            w.high,
            DVec2::new(w.low.x, w.high.y),
        ]
    });
    let truth = PlaneTruth::new(corners, extent, windows);
    let plane_from_image = truth.image_from_plane.inverse();
    let sun = DVec3::new(-0.45, 0.62, 0.64).normalize();
    let center = 0.5 * DVec2::new(size.width() as f64, size.height() as f64);
    let image = paint_adaptive(size, 4, |p, side| {
        let found = plane_sample(&plane_from_image, p, side);
        if let Some((q, footprint)) = found
            && q.cmpge(DVec2::ZERO).all()
            && q.cmple(extent).all()
        {
            // seen straight on: the picture is a pure function of the plane
            let surface = front.surface(q, footprint, DVec3::NEG_Z, sun);
            let shade = leaf_shade(q, footprint, seed.fork(3));
            let facing = surface.normal.dot(sun).max(0.0) as f32;
            let light = Vec3::new(2.6, 2.1, 1.5) * facing * surface.sun * shade as f32
                + Vec3::new(0.42, 0.52, 0.68) * surface.ambient;
            let mirrored = Vec3::new(0.55, 0.72, 0.95) * (0.7 + 0.3 * (q.y / extent.y) as f32);
            let color = (surface.albedo * light + surface.glow).lerp(mirrored, surface.mirror);
            return film(color, 0.62);
        }
        let below = found.is_some_and(|(q, _)| q.y < 0.0);
        let off = (p - center) / center.length();
        if below {
            let grain = fractal(p / (0.02 * center.length()), 0.1, 3, seed.fork(4));
            return film(
                Vec3::splat(0.55 + 0.08 * grain as f32) * Vec3::new(1.0, 0.94, 0.86),
                0.62,
            );
        }
        let direction = DVec3::new(off.x, 0.55 - off.y, -1.0).normalize();
        film(
            sky(direction, 0.7 * side / center.length(), sun, seed.fork(5)),
            0.62,
        )
    });
    (image, truth)
}

/// Sun that comes through a tree at the left: 0 in full shade, 1 in the open.
pub(crate) fn leaf_shade(q: DVec2, footprint: f64, seed: Seed) -> f64 {
    let crown = 1.25 - q.distance(DVec2::new(1.2, 8.0)) / 5.6;
    let leaves = fractal(q * 1.1, 1.1 * footprint, 5, seed);
    let shade = smoothstep(-0.15, 0.25, crown - 0.25 + 0.9 * leaves);
    1.0 - 0.9 * shade * smoothstep(0.0, 0.3, crown)
}

/// A floor of marble and stone tiles in a hall; the sun falls through windows that are not in the picture.
pub fn floor(size: Size, seed: Seed) -> (Image<LinearRgb>, PlaneTruth) {
    const TILE: f64 = 0.5;
    let extent = DVec2::new(6.0, 12.0);
    let corners = placed(
        size,
        [(-0.42, 1.03), (1.36, 1.06), (0.74, 0.36), (0.29, 0.34)],
        seed.fork(1),
    );
    // tiles with a dark border, known to the last corner
    let marks: Vec<DVec2> = (0..6)
        .map(|i| {
            let at = |range: u64, k| (seed.fork(2).bits(i, 0, k) % range) as f64;
            TILE * DVec2::new(3.0 + at(6, 0), 1.0 + at(16, 1))
        })
        .collect();
    let quads = marks.iter().map(|&low| {
        [
            low,
            low + DVec2::X * TILE,
            low + DVec2::splat(TILE),
            low + DVec2::Y * TILE,
        ]
    });
    let truth = PlaneTruth::new(corners, extent, quads);
    let plane_from_image = truth.image_from_plane.inverse();
    // the horizontal line through the far end of the floor, beyond which the wall begins
    let far = map(
        &truth.image_from_plane,
        DVec2::new(0.5 * extent.x, extent.y),
    );
    let scale = size.width() as f64;
    let image = paint_adaptive(size, 4, |p, side| {
        match plane_sample(&plane_from_image, p, side) {
            Some((q, footprint)) if q.y <= extent.y && q.y > -2.0 => {
                let color = floor_color(q, footprint, &marks, TILE, seed);
                // a dim hall, darker at its far end, and warm patches of sun
                let sun = window_light(q, footprint);
                let dim = 1.0 - 0.45 * smoothstep(5.0, 12.0, q.y);
                let wall = 1.0 - 0.5 * smoothstep(0.7, 0.0, (extent.y - q.y).min(6.0));
                film(
                    color
                        * (Vec3::new(0.42, 0.47, 0.56) * (dim * wall) as f32
                            + Vec3::new(2.5, 1.95, 1.25) * sun as f32),
                    0.7,
                )
            }
            _ => {
                // a paneled wall behind
                let q = (p - far) / scale;
                let skirting = q.y > -0.035;
                let panel = ((q.x / 0.14).rem_euclid(1.0) - 0.5).abs() < 0.4
                    && (0.07..0.30).contains(&-q.y);
                let grain = fractal(q * 30.0, 30.0 * side / scale, 4, seed.fork(9));
                let base = if skirting {
                    hex(0xe6ddce)
                } else if panel {
                    hex(0x8c9a94)
                } else {
                    hex(0x9daaa2)
                };
                let light = 0.55 - 0.5 * q.length();
                film(base * (light.max(0.08) * (1.0 + 0.06 * grain)) as f32, 1.1)
            }
        }
    });
    (image, truth)
}

fn floor_color(q: DVec2, footprint: f64, marks: &[DVec2], tile: f64, seed: Seed) -> Vec3 {
    let plain = tiles(
        q,
        footprint,
        tile,
        [hex(0xd8cbb6), hex(0x5a3d36)],
        seed.fork(3),
    );
    let stone = marble(q * 1.3, 1.3 * footprint, seed.fork(4));
    let grid = Masonry {
        length: tile,
        height: tile,
        joint: 0.02 * tile,
        shift: 0.0,
    };
    let face = grid.at(q, footprint, seed.fork(3)).face as f32;
    let light_tile = smoothstep(0.25, 0.5, plain.y as f64) as f32;
    let mut color = plain.lerp(plain * stone * 1.15, 0.8 * light_tile * face);
    for &low in marks {
        let p = q - low;
        let border = p.min_element().min(tile - p.max_element());
        if border > 0.0 {
            let rim = smoothstep(0.075 + 0.5 * footprint, 0.075 - 0.5 * footprint, border) as f32;
            color = hex(0xc48a3a).lerp(hex(0x1d222b), rim);
        }
    }
    color
}

/// Sun through three windows with bars at the right side of the hall.
fn window_light(q: DVec2, footprint: f64) -> f64 {
    // along the light's slant a window is an axis-parallel rectangle
    let s = q.y - 1.6 + 0.35 * (q.x - 5.0);
    let period = 3.4;
    let t = s - period * (s / period).floor();
    let u = q.x - 1.6;
    // the sun's disc blurs what is farther from the window
    let blur = (0.03 + 0.025 * (5.5 - q.x).max(0.0)).max(footprint);
    let within = |x: f64, low: f64, high: f64| {
        smoothstep(low - blur, low + blur, x) * smoothstep(high + blur, high - blur, x)
    };
    let bar = |x: f64, at: f64| 1.0 - within(x, at - 0.045, at + 0.045);
    within(t, 0.3, 1.7) * within(u, 0.0, 2.9) * bar(t, 1.0) * bar(u, 0.97) * bar(u, 1.93)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_homography_maps_the_square_to_its_corners() {
        for seed in 0..20 {
            let base = [(0.0, 0.0), (90.0, 5.0), (80.0, 70.0), (4.0, 95.0)];
            let mut k = 0;
            let corners = base.map(|(x, y)| {
                k += 1;
                DVec2::new(x, y)
                    + 20.0 * DVec2::new(Seed(seed).unit(k, 0, 0), Seed(seed).unit(k, 1, 0))
            });
            let m = image_from_unit_square(corners);
            let unit = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
            for (corner, q) in corners.into_iter().zip(unit) {
                assert!(map(&m, q.into()).distance(corner) < 1e-9);
            }
            // and lines to lines: the diagonals meet in the image of the middle
            let middle = map(&m, DVec2::splat(0.5));
            assert!(
                (middle - corners[0])
                    .perp_dot(corners[2] - corners[0])
                    .abs()
                    < 1e-6
            );
            assert!(
                (middle - corners[1])
                    .perp_dot(corners[3] - corners[1])
                    .abs()
                    < 1e-6
            );
        }
    }

    #[test]
    fn truth_maps_the_corners_of_the_planes() {
        let size = Size::new(40, 30).unwrap();
        for (_, truth) in [facade(size, Seed(1)), floor(size, Seed(2))] {
            let [w, h] = truth.size.to_array();
            let plane = [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)];
            for (corner, q) in truth.corners_in_image.into_iter().zip(plane) {
                assert!(map(&truth.image_from_plane, q.into()).distance(corner) < 1e-9);
            }
            assert!(truth.features_in_image.len() >= 6);
        }
    }

    #[test]
    fn marked_tiles_have_their_color_in_their_middle() {
        let size = Size::new(300, 220).unwrap();
        let (image, truth) = floor(size, Seed(3));
        for quad in &truth.features_in_image {
            let plane_from_image = truth.image_from_plane.inverse();
            let middle = (map(&plane_from_image, quad[0]) + map(&plane_from_image, quad[2])) / 2.0;
            let p = map(&truth.image_from_plane, middle);
            if let Some(LinearRgb([r, _, b])) = image.get(p.x as usize, p.y as usize) {
                // gold in any light; no other tile is so much redder than blue
                assert!(r > 2.5 * b, "{r} {b}");
            }
        }
    }
}
