//! A still life: fruit, grapes and glossy balls on a striped cloth on a wooden table, by the light of a window.
//!
//! All things are ellipsoids, so that rays meet them in closed form and the outline of each in the picture is a conic
//! that is known exactly: `C = (P Q* Pᵀ)⁻¹` for the dual quadric `Q*` and the camera `P` (Hartley and Zisserman,
//! "Multiple View Geometry", 2003, section 8.3). Smooth shading, highlights, mirrors, soft shadows: the opposite of the
//! street.
//!
//! World: x to the right, y up, the table at y = 0, the camera looks along −z and a little down.

use crate::coverage::pulse;
use crate::ellipsoid::{Camera, Ellipsoid};
use crate::paint::{hex, paint_adaptive};
use crate::random::Seed;
use crate::stage::film;
use crate::texture::{cellular, fractal, gradient_noise, smoothstep, wood};
use glam::{DMat3, DVec2, DVec3, Vec3};
use ravec_raster::{Image, LinearRgb, Size};
use serde::{Deserialize, Serialize};

/// Places of the things of the still life in the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StillLifeTruth {
    /// The things, in no order of depth: one may hide a part of another.
    pub things: Vec<ThingTruth>,
    /// The table's far border: the row below which there is table, if seen.
    pub table_edge_row: f64,
}

/// One thing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ThingTruth {
    /// Name of the object.
    pub name: String,
    /// Image of its center.
    pub center_in_image: DVec2,
    /// Its outline: the points with `(x, y, 1) C (x, y, 1)ᵀ = 0`, negative inside. Serialized column by column.
    pub outline_conic: DMat3,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Skin {
    Orange,
    Lemon,
    Apple,
    Plum,
    Grape,
    Glazed(Vec3),
    Banded(Vec3),
    /// A ring around a dark opening.
    Lip(Vec3),
    Steel,
    Stem,
}

#[derive(Debug, Clone, Copy)]
struct Thing {
    name: &'static str,
    body: Ellipsoid,
    skin: Skin,
}

impl Thing {
    fn at(name: &'static str, center: DVec3, radii: DVec3, skin: Skin) -> Self {
        let body = Ellipsoid::new(center, radii);
        Self { name, body, skin }
    }

    /// On the table.
    fn upright(name: &'static str, x: f64, z: f64, radii: DVec3, skin: Skin) -> Self {
        Self::at(name, DVec3::new(x, radii.y, z), radii, skin)
    }

    fn ball(name: &'static str, x: f64, z: f64, radius: f64, skin: Skin) -> Self {
        Self::upright(name, x, z, DVec3::splat(radius), skin)
    }

    fn turned(self, angle_rad: f64) -> Self {
        Self {
            body: self.body.turned(angle_rad),
            ..self
        }
    }
}

/// The table's far border.
const TABLE_END: f64 = -2.6;
/// Direction to the middle of the window, and its half extent as tangents.
const WINDOW: DVec3 = DVec3::new(-0.68, 0.62, 0.39);
const WINDOW_SIZE: f64 = 0.30;

fn things(seed: Seed) -> Vec<Thing> {
    let mut things = vec![
        Thing::ball("orange", -1.30, 0.15, 0.47, Skin::Orange),
        Thing::ball("orange", -0.62, -0.75, 0.46, Skin::Orange),
        Thing::upright(
            "apple",
            0.28,
            -0.35,
            DVec3::new(0.50, 0.45, 0.50),
            Skin::Apple,
        ),
        Thing::ball("steel ball", -0.28, 0.95, 0.36, Skin::Steel),
        Thing::upright(
            "vase",
            1.28,
            -1.25,
            DVec3::new(0.62, 0.78, 0.62),
            Skin::Banded(hex(0x1f4f78)),
        ),
        Thing::ball(
            "glazed ball",
            1.95,
            -0.05,
            0.34,
            Skin::Glazed(hex(0x2f7d5c)),
        ),
        Thing::upright("plum", 0.62, 1.05, DVec3::new(0.30, 0.27, 0.27), Skin::Plum),
        Thing::at(
            "stem",
            DVec3::new(0.28, 0.98, -0.35),
            DVec3::new(0.026, 0.16, 0.026),
            Skin::Stem,
        ),
        Thing::upright(
            "lemon",
            -1.95,
            -0.95,
            DVec3::new(0.50, 0.36, 0.36),
            Skin::Lemon,
        )
        .turned(0.5),
        Thing::at(
            "neck",
            DVec3::new(1.28, 1.58, -1.25),
            DVec3::new(0.26, 0.26, 0.26),
            Skin::Glazed(hex(0x1f4f78)),
        ),
        Thing::at(
            "lip",
            DVec3::new(1.28, 1.84, -1.25),
            DVec3::new(0.36, 0.06, 0.36),
            Skin::Lip(hex(0x1f4f78)),
        ),
        Thing::ball("pearl", -1.75, 1.15, 0.13, Skin::Glazed(hex(0xe9e2d8))),
    ];
    // a bunch of grapes: a heap of two layers
    for i in 0..15 {
        let layer = if i < 9 { 0.0 } else { 1.0 };
        let k = f64::from(if i < 9 { i } else { i - 9 });
        let count = if i < 9 { 9.0 } else { 6.0 };
        let angle = k / count * std::f64::consts::TAU + 0.4 * layer;
        let ring = (if i % 2 == 0 { 0.36 } else { 0.17 }) * (1.0 - 0.35 * layer);
        let radius = 0.148 + 0.012 * seed.unit(i64::from(i), 0, 0);
        let center = DVec3::new(
            1.32 + 1.35 * ring * angle.cos(),
            radius + 0.21 * layer,
            0.72 + ring * angle.sin(),
        );
        things.push(Thing::at(
            "grape",
            center,
            DVec3::splat(radius),
            Skin::Grape,
        ));
    }
    things
}

struct Studio {
    things: Vec<Thing>,
    light: DVec3,
    seed: Seed,
}

/// The still life at any size. The seed moves grain, spots and folds; the things stay.
pub fn still_life(size: Size, seed: Seed) -> (Image<LinearRgb>, StillLifeTruth) {
    let camera = Camera::new(size);
    let studio = Studio {
        things: things(seed),
        light: WINDOW.normalize(),
        seed,
    };
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let spread = 1.0 / (1.28 * extent.x.min(1.5 * extent.y));
    let image = paint_adaptive(size, 4, |p, side| {
        let light = studio.radiance(camera.position, camera.direction(p), spread * side, 1);
        let off = (p - 0.5 * extent).length() / (0.5 * extent.length());
        film(light * (1.0 - 0.45 * off.powi(2)) as f32, 0.80)
    });
    let truth = StillLifeTruth {
        things: studio
            .things
            .iter()
            .map(|thing| ThingTruth {
                name: thing.name.to_owned(),
                center_in_image: camera.project(thing.body.center),
                outline_conic: thing.body.outline(&camera),
            })
            .collect(),
        table_edge_row: camera.project(DVec3::new(0.0, 0.0, TABLE_END)).y,
    };
    (image, truth)
}

impl Studio {
    fn radiance(&self, from: DVec3, direction: DVec3, spread: f64, bounces: u32) -> Vec3 {
        let mut nearest = f64::INFINITY;
        let mut found = None;
        for thing in &self.things {
            if let Some(t) = thing.body.hit(from, direction)
                && t < nearest
            {
                (nearest, found) = (t, Some(thing));
            }
        }
        if let Some(thing) = found {
            return self.thing(
                thing,
                from + nearest * direction,
                direction,
                spread * nearest,
                bounces,
            );
        }
        let t = -from.y / direction.y;
        let at = from + t * direction;
        if t > 0.0 && at.z > TABLE_END {
            let footprint = spread * t / direction.y.abs().max(0.05).sqrt();
            return self.table(at, direction, footprint, bounces);
        }
        self.room(direction, spread)
    }

    /// The room around: a dim wall behind, a bright window with bars at the left.
    fn room(&self, direction: DVec3, spread: f64) -> Vec3 {
        let side = self.light.cross(DVec3::Y).normalize();
        let up = side.cross(self.light);
        let ahead = direction.dot(self.light);
        if ahead > 0.0 {
            let q = DVec2::new(direction.dot(side), direction.dot(up)) / ahead;
            let inner = (WINDOW_SIZE - q.abs().max_element()).min(q.abs().min_element() - 0.02);
            let seen = smoothstep(-0.006, 0.006, inner) as f32;
            if seen > 0.0 {
                return Vec3::new(5.2, 5.4, 5.8) * seen;
            }
        }
        let wall = DVec2::new(direction.x / (-direction.z).max(0.2), direction.y);
        let cloud = fractal(wall * 2.2, 2.2 * spread, 5, self.seed.fork(1));
        let pool = smoothstep(1.1, 0.0, wall.distance(DVec2::new(-0.25, 0.10)));
        let tone = hex(0x3c3a34).lerp(hex(0xb4a080), pool as f32);
        tone * (0.55 + 0.12 * cloud) as f32
    }

    fn lit(&self, at: DVec3, normal: DVec3, skip: Option<&Thing>) -> (f32, f32) {
        let mut direct = smoothstep(-0.12, 1.0, normal.dot(self.light));
        let mut open = 1.0;
        for thing in &self.things {
            if skip.is_some_and(|own| std::ptr::eq(own, thing)) {
                continue;
            }
            if direct > 0.0 {
                direct *= thing.body.lets_through(at, self.light, 0.26);
            }
            open *= 1.0 - thing.body.occlusion(at, normal).min(0.92);
        }
        (direct as f32, open as f32)
    }

    fn shaded(&self, albedo: Vec3, at: DVec3, normal: DVec3, skip: Option<&Thing>) -> Vec3 {
        let (direct, open) = self.lit(at, normal, skip);
        let sky = (0.6 + 0.4 * normal.y) as f32;
        // warm light comes back from the table
        let bounce = (0.5 - 0.5 * normal.y) as f32;
        albedo
            * (Vec3::new(2.7, 2.5, 2.2) * direct
                + Vec3::new(0.26, 0.27, 0.31) * sky * open
                + Vec3::new(0.30, 0.21, 0.13) * bounce * open)
    }

    fn table(&self, at: DVec3, direction: DVec3, footprint: f64, bounces: u32) -> Vec3 {
        let q = DVec2::new(at.x, at.z);
        let mut normal = DVec3::Y;
        let (albedo, gloss) = if let Some((color, slope)) = self.cloth(q, footprint) {
            normal = DVec3::new(slope.x, 1.0, slope.y).normalize();
            (color, 0.0)
        } else {
            // planks of an old table run from left to right; the texture's meter is a third of ours
            let color = wood(q * 0.36, 0.36 * footprint, hex(0x8f5a30), self.seed.fork(2));
            let near_cloth = self.cloth(q + DVec2::new(-0.05, 0.03), footprint).is_some();
            (color * if near_cloth { 0.6 } else { 1.0 }, 0.32)
        };
        let mut color = self.shaded(albedo, at, normal, None);
        if bounces > 0 && gloss > 0.0 {
            let grazing = (1.0 - direction.y.abs()).powi(4);
            let mirrored = DVec3::new(direction.x, -direction.y, direction.z);
            let blur = 0.02 * gradient_noise(q * 40.0, self.seed.fork(3));
            let seen = self.radiance(
                at + DVec3::Y * 1e-4,
                (mirrored + blur * DVec3::X).normalize(),
                0.02,
                bounces - 1,
            );
            color = color.lerp(
                seen.min(Vec3::splat(1.5)),
                (gloss * (0.12 + 0.88 * grazing)) as f32,
            );
        }
        color
    }

    /// Color and slope of the cloth where it lies: a rectangle turned against the table, stripes along it, soft folds,
    /// fringes at its ends.
    fn cloth(&self, q: DVec2, footprint: f64) -> Option<(Vec3, DVec2)> {
        let turned = DVec2::from_angle(0.24).rotate(q - DVec2::new(0.25, 0.30));
        let wave = |p: DVec2| {
            0.085
                * fractal(
                    p * DVec2::new(0.9, 0.55),
                    0.9 * footprint,
                    2,
                    self.seed.fork(4),
                )
        };
        let bent = turned + DVec2::splat(wave(turned));
        let half = DVec2::new(2.05, 1.28);
        let over = bent.abs() - half;
        if over.y > 0.0 || over.x > 0.14 {
            return None;
        }
        if over.x > 0.0 && pulse(bent.y / 0.045, 0.45, footprint / 0.045) < 0.5 {
            return None;
        }
        let step = 0.02;
        let slope = |axis: DVec2| {
            2.2 * (wave(turned + step * axis) - wave(turned - step * axis)) / (2.0 * step)
        };
        let band = |offset: f64, duty: f64, period: f64| {
            pulse((bent.y + offset) / period, duty, footprint / period) as f32
        };
        let linen = hex(0xeae2d0);
        let mut color = linen;
        color = color.lerp(hex(0x2d4f7c), band(0.0, 0.30, 0.52));
        color = color.lerp(hex(0xb83b32), band(-0.36, 0.06, 0.52));
        color = color.lerp(hex(0xb83b32), band(-0.46, 0.04, 0.52) * 0.9);
        // threads of the weave
        let fine = (1.5 - 120.0 * footprint).clamp(0.0, 1.0);
        let weave = (bent.x * 420.0).sin() * (bent.y * 420.0).sin();
        let grain = fractal(bent * 18.0, 18.0 * footprint, 3, self.seed.fork(5));
        color *= (1.0 + 0.10 * fine * weave + 0.07 * grain) as f32;
        if over.x > 0.0 {
            color = linen * 0.9;
        }
        let back = DVec2::from_angle(-0.24);
        Some((
            color,
            -back.rotate(DVec2::new(slope(DVec2::X), slope(DVec2::Y))),
        ))
    }

    fn thing(
        &self,
        thing: &Thing,
        at: DVec3,
        direction: DVec3,
        footprint: f64,
        bounces: u32,
    ) -> Vec3 {
        let Finish {
            normal,
            albedo,
            polish,
            grazing,
        } = self.finish(thing, at, footprint);
        let mut color = self.shaded(albedo, at, normal, Some(thing));
        if matches!(thing.skin, Skin::Grape | Skin::Plum) {
            // light passes through the rim
            let rim = (1.0 + normal.dot(direction)).max(0.0).powi(3) as f32;
            color += hex(0x7a223a) * rim * 0.5;
        }
        if polish > 0.0 {
            let facing = (-normal.dot(direction)).clamp(0.0, 1.0);
            let mirror = polish + grazing * (1.0 - facing).powi(5);
            let mirrored = direction - 2.0 * direction.dot(normal) * normal;
            let seen = if bounces > 0 {
                self.radiance(
                    at + 1e-4 * normal,
                    mirrored,
                    (footprint / 0.3).max(0.01),
                    bounces - 1,
                )
            } else {
                self.room(mirrored, 0.05)
            };
            // the window is far brighter than what the sum of diffuse light needs
            color = color * (1.0 - mirror as f32)
                + seen * mirror as f32 * if thing.skin == Skin::Steel { 1.0 } else { 1.6 };
        }
        color
    }

    /// The surface of a thing at a point.
    fn finish(&self, thing: &Thing, at: DVec3, footprint: f64) -> Finish {
        let mut normal = thing.body.normal(at);
        let own = thing.body.turn.transpose() * (at - thing.body.center);
        let unit = own / thing.body.radii;
        // a map of the surface without a seam towards the viewer
        let map = DVec2::new(unit.x.atan2(unit.z.abs() + 0.3), unit.y);
        let seed = self
            .seed
            .fork(40_u64.wrapping_add_signed((thing.body.center.x * 100.0) as i64));
        let bump = |normal: &mut DVec3, scale: f64, height: f64| {
            *normal = dented(*normal, own, scale, footprint, height, seed);
        };
        let (albedo, polish, grazing) = match thing.skin {
            Skin::Orange => {
                bump(&mut normal, 44.0, 0.11);
                let spots = cellular(map * 22.0, seed);
                let pores = smoothstep(0.12, 0.32, spots.nearest) as f32;
                (hex(0xf08212) * (0.86 + 0.14 * pores), 0.035, 0.35)
            }
            Skin::Lemon => {
                bump(&mut normal, 30.0, 0.09);
                let green = smoothstep(0.6, 1.0, unit.x.abs());
                (
                    hex(0xf4cf2a).lerp(hex(0xb9b030), 0.7 * green as f32),
                    0.035,
                    0.35,
                )
            }
            Skin::Apple => {
                let streak = fractal(
                    DVec2::new(map.x * 14.0, map.y * 1.6),
                    footprint * 28.0,
                    4,
                    seed,
                );
                let blush =
                    smoothstep(-0.5, 0.6, streak * 0.7 + unit.x * 0.5 - 0.15 + 0.4 * unit.z);
                let dots = smoothstep(0.10, 0.05, cellular(map * 13.0, seed.fork(1)).nearest);
                let skin = hex(0xd8b63e).lerp(hex(0xa8161c), (0.25 + 0.75 * blush) as f32);
                let hollow = smoothstep(0.80, 1.0, unit.y) as f32;
                (
                    skin.lerp(hex(0x7d8436), hollow)
                        .lerp(hex(0xe2b888), 0.5 * dots as f32),
                    0.05,
                    0.6,
                )
            }
            Skin::Plum => {
                let bloom = smoothstep(
                    -0.3,
                    0.5,
                    fractal(map * 3.0, footprint * 6.0, 4, seed) + 0.5 * unit.y,
                );
                (
                    hex(0x2c1230).lerp(hex(0x5a5074), 0.35 * bloom as f32),
                    0.04,
                    0.35,
                )
            }
            Skin::Grape => {
                let bloom = smoothstep(
                    -0.2,
                    0.6,
                    fractal(map * 3.0, footprint * 12.0, 3, seed) + 0.4 * unit.y,
                );
                (
                    hex(0x4b1b3c).lerp(hex(0x7a5a7c), 0.3 * bloom as f32),
                    0.05,
                    0.45,
                )
            }
            Skin::Glazed(color) => {
                let craze = fractal(map * 4.0, footprint * 8.0, 4, seed);
                (color * (1.0 + 0.12 * craze) as f32, 0.07, 0.85)
            }
            Skin::Banded(color) => {
                let craze = fractal(map * 4.0, footprint * 8.0, 4, seed);
                let distance = (3.0 * unit.y - (3.0 * unit.y).floor() - 0.5).abs();
                let band = smoothstep(0.07, 0.04, distance) as f32;
                let painted = color.lerp(hex(0xd9cfb8), band);
                (painted * (1.0 + 0.12 * craze) as f32, 0.07, 0.85)
            }
            Skin::Lip(color) => {
                let hole = f32::from(unit.y > 0.0 && unit.x.hypot(unit.z) < 0.80);
                (
                    color.lerp(hex(0x08090c), hole),
                    0.07 * (1.0 - f64::from(hole)),
                    0.5,
                )
            }
            Skin::Steel => (Vec3::splat(0.03), 0.72, 0.28),
            Skin::Stem => (hex(0x4a321c), 0.0, 0.0),
        };
        Finish {
            normal,
            albedo,
            polish,
            grazing,
        }
    }
}

/// The normal of a skin with dents, `scale` of them a meter, which fade where they are too small to be seen.
fn dented(normal: DVec3, own: DVec3, scale: f64, footprint: f64, height: f64, seed: Seed) -> DVec3 {
    let p = DVec2::new(own.x + 0.7 * own.z, own.y - 0.4 * own.z) * scale;
    let visible = (1.5 - 2.5 * footprint * scale).clamp(0.0, 1.0) * height;
    (normal
        + visible
            * DVec3::new(
                gradient_noise(p, seed),
                gradient_noise(p + 40.0, seed),
                gradient_noise(p + 80.0, seed),
            ))
    .normalize()
}

/// The surface of a thing at a point.
struct Finish {
    normal: DVec3,
    /// Its reflectance.
    albedo: Vec3,
    /// The share of light that it mirrors at right angles.
    polish: f64,
    /// Growth of that share at grazing angles.
    grazing: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outline_conic_separates_rays_that_hit_from_rays_that_miss() {
        let size = Size::new(96, 64).unwrap();
        let camera = Camera::new(size);
        for thing in things(Seed(1)) {
            let conic = thing.body.outline(&camera);
            let center = camera.project(thing.body.center);
            for i in 0..400 {
                let step = DVec2::new(f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5);
                let p = center + step * (1.5 * thing.body.radii.x);
                let value = p.extend(1.0).dot(conic * p.extend(1.0));
                let hit = thing
                    .body
                    .hit(camera.position, camera.direction(p))
                    .is_some();
                assert_eq!(hit, value < 0.0, "{} at {p}", thing.name);
            }
        }
    }
}
