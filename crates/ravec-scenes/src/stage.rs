//! A stage of flat pieces in space: traced rays, a sun with soft shadows, sky light, mirrors and haze.
//!
//! Like a theater set, everything is a rectangle with a frame of its own: walls and ground, but also trees, lamps or a
//! bicycle, which are cut out of their rectangle by their coverage. A ray meets the pieces from front to back; a ray to
//! the sun is dimmed by the coverage of what it meets, with a footprint that grows with the distance, which makes
//! penumbras. World: meters, x to the right, y up, the camera looks along −z.

use crate::facade::{Facade, Surface};
use crate::props::Prop;
use crate::random::Seed;
use crate::sky::sky;
use glam::{DMat3, DVec2, DVec3, Vec3};

/// Content of a rectangle.
pub(crate) enum Show {
    Facade(Box<Facade>),
    Prop(Box<Prop>),
}

/// A rectangle in space.
pub(crate) struct Piece {
    pub origin: DVec3,
    /// Unit vectors to the right and up within the rectangle, at right angles.
    pub right: DVec3,
    pub up: DVec3,
    pub size: DVec2,
    pub show: Show,
}

impl Piece {
    fn normal(&self) -> DVec3 {
        self.right.cross(self.up)
    }

    /// World from local coordinates.
    pub(crate) fn point(&self, q: DVec2) -> DVec3 {
        self.origin + q.x * self.right + q.y * self.up
    }

    fn local(&self, v: DVec3) -> DVec3 {
        DVec3::new(v.dot(self.right), v.dot(self.up), v.dot(self.normal()))
    }

    fn surface(&self, q: DVec2, footprint: f64, direction: DVec3, sun: DVec3) -> Surface {
        let (view, sun) = (self.local(direction), self.local(sun));
        match &self.show {
            Show::Facade(facade) => facade.surface(q, footprint, view, sun),
            Show::Prop(prop) => prop.surface(q, footprint, view, sun),
        }
    }

    fn opacity(&self, q: DVec2, footprint: f64) -> f32 {
        match &self.show {
            Show::Facade(facade) => f32::from(q.y < facade.top(q.x)),
            Show::Prop(prop) => prop.opacity(q, footprint),
        }
    }
}

/// A pinhole camera that looks along −z and keeps verticals vertical.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Camera {
    pub position: DVec3,
    /// Focal length in pixels.
    pub focal_px: f64,
    /// Image of the direction −z: the vanishing point of the street.
    pub vanishing_point: DVec2,
}

impl Camera {
    pub(crate) fn direction(&self, p: DVec2) -> DVec3 {
        let q = (p - self.vanishing_point) / self.focal_px;
        DVec3::new(q.x, -q.y, -1.0)
    }

    /// Image of a point in front of the camera.
    pub(crate) fn project(&self, point: DVec3) -> DVec2 {
        let q = point - self.position;
        self.vanishing_point + self.focal_px * DVec2::new(q.x, -q.y) / -q.z
    }

    /// Maps local coordinates of a piece (u, v, 1) to the image.
    pub(crate) fn image_from_piece(&self, piece: &Piece) -> DMat3 {
        let (f, c) = (self.focal_px, self.vanishing_point);
        let image_from_world = DMat3::from_cols(
            DVec3::new(f, 0.0, 0.0),
            DVec3::new(0.0, -f, 0.0),
            DVec3::new(-c.x, -c.y, -1.0),
        );
        image_from_world * DMat3::from_cols(piece.right, piece.up, piece.origin - self.position)
    }
}

/// A lit set.
pub(crate) struct Stage {
    pub pieces: Vec<Piece>,
    /// The rectangle of each piece, close together in memory: most rays miss most pieces.
    plates: Vec<Plate>,
    /// Unit vector towards the sun.
    sun: DVec3,
    seed: Seed,
}

/// A rectangle, prepared for rays.
struct Plate {
    /// Unit normal and the plane's distance from the origin along it.
    normal: DVec3,
    distance: f64,
    right: DVec3,
    up: DVec3,
    /// Coordinates of the piece's origin along `right` and `up`.
    low: DVec2,
    size: DVec2,
}

impl Plate {
    fn new(piece: &Piece) -> Self {
        let normal = piece.normal();
        Self {
            normal,
            distance: piece.origin.dot(normal),
            right: piece.right,
            up: piece.up,
            low: DVec2::new(piece.origin.dot(piece.right), piece.origin.dot(piece.up)),
            size: piece.size,
        }
    }

    /// Ray parameter and local coordinates of the hit, if any.
    #[inline(always)]
    fn hit(&self, from: DVec3, direction: DVec3) -> Option<(f64, DVec2)> {
        let t = (self.distance - from.dot(self.normal)) / direction.dot(self.normal);
        // also refuses NaN and infinity, for rays within the plane
        if !(t > 1e-6 && t < 1e6) {
            return None;
        }
        let p = from + t * direction;
        let x = p.dot(self.right) - self.low.x;
        if !(0.0..=self.size.x).contains(&x) {
            return None;
        }
        let y = p.dot(self.up) - self.low.y;
        (0.0..=self.size.y)
            .contains(&y)
            .then_some((t, DVec2::new(x, y)))
    }
}

const SUN_LIGHT: Vec3 = Vec3::new(3.0, 2.36, 1.62);
const SKY_LIGHT: Vec3 = Vec3::new(0.42, 0.56, 0.80);
const BOUNCE_LIGHT: Vec3 = Vec3::new(0.36, 0.27, 0.18);
pub(crate) const HAZE: Vec3 = Vec3::new(0.86, 0.78, 0.70);
/// Distance in meters over which haze takes all but a third.
pub(crate) const HAZE_LENGTH: f64 = 260.0;
/// Angle of the sun's disc, made larger than in nature (0.0093) for softer shadows.
const SUN_ANGLE: f64 = 0.018;

impl Stage {
    pub(crate) fn new(pieces: Vec<Piece>, sun: DVec3, seed: Seed) -> Self {
        Self {
            plates: pieces.iter().map(Plate::new).collect(),
            pieces,
            sun: sun.normalize(),
            seed,
        }
    }

    /// Radiance that arrives at `from` along −`direction`; `spread` is the width of the ray at distance 1.
    pub(crate) fn radiance(&self, from: DVec3, direction: DVec3, spread: f64) -> Vec3 {
        self.trace(from, direction.normalize(), spread / direction.length(), 1)
    }

    fn trace(&self, from: DVec3, direction: DVec3, spread: f64, bounces: u32) -> Vec3 {
        // most rays meet few pieces: an insertion sort into a short list
        const MAX_HITS: usize = 24;
        let mut hits = [(f64::INFINITY, 0usize, DVec2::ZERO); MAX_HITS];
        let mut count = 0;
        for (index, plate) in self.plates.iter().enumerate() {
            if let Some((t, q)) = plate.hit(from, direction)
                && count < MAX_HITS
            {
                let mut slot = count;
                while slot > 0 && hits[slot - 1].0 > t {
                    hits[slot] = hits[slot - 1];
                    slot -= 1;
                }
                hits[slot] = (t, index, q);
                count += 1;
            }
        }
        let mut light = Vec3::ZERO;
        let mut left = 1.0f32;
        for &(t, index, q) in &hits[..count] {
            let piece = &self.pieces[index];
            let normal = piece.normal();
            // geometric mean of the footprint's two axes
            let slant = direction.dot(normal).abs().max(0.04).sqrt();
            let footprint = spread * t / slant;
            let surface = piece.surface(q, footprint, direction, self.sun);
            if surface.alpha <= 0.0 {
                continue;
            }
            let color = self.shade(
                piece,
                &surface,
                from + t * direction,
                direction,
                spread * t,
                bounces,
            );
            let haze = 1.0 - (-t / HAZE_LENGTH).exp();
            light += left * surface.alpha * color.lerp(HAZE, haze as f32);
            left *= 1.0 - surface.alpha;
            if left < 0.004 {
                return light;
            }
        }
        light + left * sky(direction, spread, self.sun, self.seed)
    }

    fn shade(
        &self,
        piece: &Piece,
        surface: &Surface,
        at: DVec3,
        direction: DVec3,
        width: f64,
        bounces: u32,
    ) -> Vec3 {
        let n = surface.normal;
        let face = piece.normal();
        let mut normal = n.x * piece.right + n.y * piece.up + n.z * face;
        // cut-outs are seen and lit from both sides
        if direction.dot(face) > 0.0 {
            normal = normal - 2.0 * normal.dot(face) * face;
        }
        let facing = normal.dot(self.sun).max(0.0) as f32;
        let direct = facing * surface.sun;
        let sun = if direct > 0.002 {
            direct * self.sunlight(at + 2e-3 * normal)
        } else {
            0.0
        };
        let up = normal.y as f32;
        let ambient = SKY_LIGHT * (0.62 + 0.38 * up) + BOUNCE_LIGHT * (0.55 - 0.35 * up);
        let mut color =
            surface.albedo * (SUN_LIGHT * sun + ambient * surface.ambient) + surface.glow;
        if surface.mirror > 0.0 && bounces > 0 {
            let mirrored = direction - 2.0 * direction.dot(normal) * normal;
            let seen = self.trace(
                at + 1e-3 * normal,
                mirrored,
                (width / 4.0).max(0.004),
                bounces - 1,
            );
            color = color.lerp(seen, surface.mirror);
        }
        color
    }

    /// Share of the sun that is seen from a point.
    fn sunlight(&self, at: DVec3) -> f32 {
        let mut light = 1.0f32;
        for (plate, piece) in self.plates.iter().zip(&self.pieces) {
            if let Some((t, q)) = plate.hit(at, self.sun)
                && t > 0.02
            {
                light *= 1.0 - piece.opacity(q, (SUN_ANGLE * t).max(0.004));
                if light < 0.004 {
                    return 0.0;
                }
            }
        }
        light
    }
}

/// Compresses radiance into 0 to 1, as film would: nearly linear in the middle, soft at the top.
///
/// Source: K. Narkowicz, "ACES filmic tone mapping curve", 2015.
pub(crate) fn film(radiance: Vec3, exposure: f32) -> Vec3 {
    let x = (radiance * exposure).max(Vec3::ZERO);
    let y = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
    y.clamp(Vec3::ZERO, Vec3::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::props::Prop;

    #[test]
    fn the_homography_of_a_piece_is_the_projection_of_its_points() {
        let camera = Camera {
            position: DVec3::new(0.7, 1.7, 0.3),
            focal_px: 700.0,
            vanishing_point: DVec2::new(310.0, 220.0),
        };
        let piece = Piece {
            origin: DVec3::new(-4.0, 0.2, -6.0),
            right: DVec3::new(0.6, 0.0, -0.8),
            up: DVec3::Y,
            size: DVec2::new(5.0, 3.0),
            show: Show::Prop(Box::new(Prop::Panel(Vec3::ONE))),
        };
        let image_from_piece = camera.image_from_piece(&piece);
        for q in [DVec2::ZERO, DVec2::new(5.0, 0.0), DVec2::new(1.3, 2.9)] {
            let mapped = image_from_piece * q.extend(1.0);
            let expected = camera.project(piece.point(q));
            assert!((mapped.truncate() / mapped.z).distance(expected) < 1e-9);
            // and the ray through that pixel meets the piece there
            let (_, found) = Plate::new(&piece)
                .hit(camera.position, camera.direction(expected))
                .unwrap_or((0.0, DVec2::NAN));
            assert!(
                found.distance(q) < 1e-9 || q.min_element() == 0.0,
                "{found} {q}"
            );
        }
    }

    #[test]
    fn film_is_monotone_and_within_range() {
        let mut last = -1.0;
        for i in 0..400 {
            let y = film(Vec3::splat(0.05 * i as f32), 1.0).x;
            assert!((0.0..=1.0).contains(&y) && y >= last);
            last = y;
        }
    }
}
