//! The ground floor of a house: a shop with its sign and goods, or a door between two windows.

use crate::facade::{Facade, GROUND_FLOOR, Opening, Surface};
use crate::glyph;
use crate::paint::hex;
use crate::stroke::{Stroke, Strokes};
use crate::texture::{fractal, smoothstep};
use glam::{DVec2, DVec3, Vec3};

/// Kind of the ground floor.
#[derive(Debug, Clone)]
pub(crate) enum GroundFloor {
    /// A shop window with this paint and this lettering above it.
    Shop(Vec3, Strokes),
    /// A door and two windows.
    Door(Vec3),
}

impl GroundFloor {
    /// A shop with its name on the fascia of a house that is `width` wide.
    pub(crate) fn shop(paint: Vec3, name: &str, width: f64) -> Self {
        let scale = 0.40 / glyph::HEIGHT;
        let length = scale * glyph::text_width(name);
        let left = 0.5 * (width - length);
        let top = GROUND_FLOOR - 0.22;
        let stroke = |points: Vec<DVec2>| Stroke {
            points: points
                .iter()
                .map(|p| DVec2::new(left + scale * p.x, top - scale * p.y))
                .collect(),
            width: 0.062,
        };
        Self::Shop(
            paint,
            Strokes::new(glyph::polylines(name).into_iter().map(stroke)),
        )
    }
}

impl Facade {
    /// The facade below the first floor; arguments as in [`Facade::surface`].
    pub(crate) fn street_level(
        &self,
        q: DVec2,
        footprint: f64,
        view: DVec3,
        sun: DVec3,
    ) -> Surface {
        match &self.ground_floor {
            GroundFloor::Shop(paint, sign) => self.shop(*paint, sign, q, footprint, view, sun),
            GroundFloor::Door(paint) => self.door(*paint, q, footprint, view, sun),
        }
    }

    /// A shop front with a fascia, windows and a door between panels.
    fn shop(
        &self,
        paint: Vec3,
        sign: &Strokes,
        q: DVec2,
        footprint: f64,
        view: DVec3,
        sun: DVec3,
    ) -> Surface {
        let fascia = q.y > GROUND_FLOOR - 0.74;
        let panel = |shade: f64| {
            let grain = fractal(
                q * DVec2::new(3.0, 30.0),
                30.0 * footprint,
                2,
                self.seed.fork(8),
            );
            Surface::plain(paint * (shade + 0.05 * grain) as f32)
        };
        if fascia {
            let mut surface = panel(1.0);
            let edge = (q.y - (GROUND_FLOOR - 0.74)).min(GROUND_FLOOR - q.y);
            if edge < 0.06 || q.x < 0.1 || self.width - q.x < 0.1 {
                surface.albedo = surface.albedo.lerp(hex(0xd8b460), 0.8);
            }
            // letters in gilt, with a drop shadow
            let shadow = sign.soft_coverage(q + DVec2::new(-0.02, 0.025), footprint.max(0.01));
            surface.albedo *= 1.0 - 0.6 * shadow as f32;
            let ink = sign.soft_coverage(q, footprint) as f32;
            surface.albedo = surface.albedo.lerp(hex(0xf6e3a8), ink);
            return surface;
        }
        let bays = (self.width / 1.9).round().max(1.0);
        let pitch = self.width / bays;
        let bay = (q.x / pitch).floor();
        let door = bay == (0.5 * bays).floor();
        let opening = Opening {
            low: DVec2::new(bay * pitch + 0.12, if door { 0.12 } else { 0.75 }),
            high: DVec2::new((bay + 1.0) * pitch - 0.12, GROUND_FLOOR - 0.92),
        };
        if opening.contains(q) {
            let mut surface = self.glazing(q, footprint, view, sun, opening, 0.1);
            if surface.mirror > 0.0 {
                self.goods(q, footprint, opening, &mut surface);
            }
            return surface;
        }
        // panels below the windows
        let inset = (q - DVec2::new(bay * pitch + 0.2, 0.2))
            .min(DVec2::new((bay + 1.0) * pitch - 0.2, 0.66) - q);
        let line = inset.min_element();
        panel(if line > 0.0 && line < 0.03 {
            0.6
        } else if line > 0.0 {
            0.88
        } else {
            1.0
        })
    }

    /// A door between two windows, above a plinth.
    fn door(&self, paint: Vec3, q: DVec2, footprint: f64, view: DVec3, sun: DVec3) -> Surface {
        let middle = 0.5 * self.width;
        let door = Opening {
            low: DVec2::new(middle - 0.55, 0.15),
            high: DVec2::new(middle + 0.55, 2.55),
        };
        if door.contains(q) {
            let mut surface = self.glazing(q, footprint, view, sun, door, 0.0);
            let p = q - door.low;
            if surface.mirror > 0.0 && p.y < 1.95 {
                let panel = ((p.x / 0.55).fract() - 0.5).abs() < 0.34
                    && ((p.y / 0.65).fract() - 0.5).abs() < 0.36;
                let grain = fractal(
                    q * DVec2::new(40.0, 4.0),
                    40.0 * footprint,
                    2,
                    self.seed.fork(9),
                );
                surface.albedo = paint * (if panel { 0.85 } else { 1.05 } + 0.08 * grain) as f32;
                surface.mirror = 0.0;
                surface.glow = Vec3::ZERO;
                if p.distance(DVec2::new(0.98, 0.98)) < 0.035 {
                    surface.albedo = hex(0xd9b050);
                }
            }
            return surface;
        }
        for side in [-1.0, 1.0] {
            let center = middle + side * 0.29 * self.width;
            let window = Opening {
                low: DVec2::new(center - 0.5, 0.95),
                high: DVec2::new(center + 0.5, 2.55),
            };
            if window.contains(q) {
                return self.glazing(q, footprint, view, sun, window, 0.6 + 0.2 * side);
            }
            if window.grown(0.1).contains(q) {
                return Surface::plain(self.trim);
            }
        }
        if door.grown(0.14).contains(q) {
            return Surface::plain(self.trim * 0.95);
        }
        if q.y < 0.7 {
            // a plinth of rough stone
            let stone = crate::texture::Masonry {
                length: 0.7,
                height: 0.35,
                joint: 0.015,
                shift: 0.5,
            };
            let at = stone.at(q, footprint, self.seed.fork(10));
            let grain = fractal(q * 10.0, 10.0 * footprint, 4, self.seed.fork(11));
            return Surface::plain(
                hex(0x9a9082) * (0.55 + 0.4 * at.face + 0.1 * at.tint + 0.12 * grain) as f32,
            );
        }
        self.wall(q, footprint)
    }

    /// Loaves, books or pots on the shelves of a shop window, under a warm lamp.
    fn goods(&self, q: DVec2, footprint: f64, opening: Opening, glass: &mut Surface) {
        let p = q - opening.low;
        let shelf = (p.y / 0.42).floor();
        let on_shelf = p.y - 0.42 * shelf;
        let column = (p.x / 0.17).floor();
        let tall = 0.10 + 0.22 * self.seed.fork(12).unit(column as i64, shelf as i64, 0);
        let hue = self.seed.fork(12).unit(column as i64, shelf as i64, 1);
        let light = 0.35 + 0.65 * smoothstep(0.0, 2.0, p.y);
        let back = Vec3::new(0.34, 0.20, 0.09) * light as f32;
        let visible = (1.5 - 10.0 * footprint).clamp(0.0, 1.0) as f32;
        let thing = if on_shelf < 0.03 {
            hex(0x5a3a22) * 0.6
        } else if on_shelf < tall && (p.x - (column + 0.5) * 0.17).abs() < 0.075 && shelf < 4.0 {
            let palette = [0xc98a42, 0x9c3d2c, 0xd9c28f, 0x3f606b, 0x7a5a34];
            hex(palette[(hue * 5.0) as usize % 5]) * 0.55 * light as f32
        } else {
            back
        };
        glass.glow = back.lerp(thing, visible) * 0.8;
    }
}
