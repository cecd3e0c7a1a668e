//! House fronts: windows with frames, curtains and shutters, ledges, doors, shops, gables.
//!
//! A facade lives in its own plane: `u` to the right along the wall in meters from its left end, `v` up from the
//! ground. Depth is faked where a camera would see it: windows are set back by [`RECESS`], so a slanted ray sees the
//! reveal, and ledges, shutters and lintels cast the shadows that a sun at a given direction would.

use crate::coverage::above;
use crate::paint::hex;
use crate::random::Seed;
use crate::shopfront::GroundFloor;
use crate::texture::{brick, fractal, smoothstep, wood};
use glam::{DVec2, DVec3, Vec3};

/// Recess of windows and doors, in meters.
pub(crate) const RECESS: f64 = 0.16;
/// Height of the ground floor, where shops and doors are.
pub(crate) const GROUND_FLOOR: f64 = 3.35;
/// Height of the other floors.
pub(crate) const FLOOR: f64 = 2.85;

/// Optical properties of a surface at a point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Surface {
    /// Share of the footprint that the surface covers.
    pub alpha: f32,
    /// Diffuse reflectance.
    pub albedo: Vec3,
    /// Share of the sun that the relief of the surface itself lets through.
    pub sun: f32,
    /// Share of the sky's light that reaches it.
    pub ambient: f32,
    /// Mirroring part of the light.
    pub mirror: f32,
    /// Own light.
    pub glow: Vec3,
    /// Normal in the local frame (right, up, out).
    pub normal: DVec3,
}

impl Surface {
    pub(crate) fn plain(albedo: Vec3) -> Self {
        Self {
            alpha: 1.0,
            albedo,
            sun: 1.0,
            ambient: 1.0,
            mirror: 0.0,
            glow: Vec3::ZERO,
            normal: DVec3::Z,
        }
    }

    pub(crate) const NOTHING: Self = Self {
        alpha: 0.0,
        albedo: Vec3::ZERO,
        sun: 1.0,
        ambient: 1.0,
        mirror: 0.0,
        glow: Vec3::ZERO,
        normal: DVec3::Z,
    };
}

/// Material of a wall.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Wall {
    /// Painted plaster.
    Plaster(Vec3),
    /// Bare bricks.
    Brick(Vec3),
    /// Plaster between dark beams.
    Timber(Vec3),
}

/// The upper outline.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Gable {
    /// A level cornice.
    None,
    /// A triangle of this height.
    Pointed(f64),
    /// Steps up to this height.
    Stepped(f64),
}

/// One house front.
#[derive(Debug, Clone)]
pub(crate) struct Facade {
    /// Width and height to the eaves, meters.
    pub width: f64,
    pub height: f64,
    pub gable: Gable,
    pub wall: Wall,
    /// Color of frames, ledges and cornice.
    pub trim: Vec3,
    pub shutters: Option<Vec3>,
    /// Windows side by side.
    pub bays: usize,
    pub ground_floor: GroundFloor,
    pub seed: Seed,
}

/// A rectangle on a facade: lower left and upper right corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Opening {
    pub low: DVec2,
    pub high: DVec2,
}

impl Opening {
    pub(crate) fn grown(self, by: f64) -> Self {
        Self {
            low: self.low - by,
            high: self.high + by,
        }
    }

    #[inline]
    pub(crate) fn contains(&self, q: DVec2) -> bool {
        q.cmpge(self.low).all() && q.cmple(self.high).all()
    }
}

impl Facade {
    /// Height of the outline at `u`.
    pub(crate) fn top(&self, u: f64) -> f64 {
        let t = 1.0 - (2.0 * u / self.width - 1.0).abs();
        match self.gable {
            Gable::None => self.height,
            Gable::Pointed(h) => self.height + h * t,
            Gable::Stepped(h) => self.height + h * (t * 4.0).floor().min(3.0) / 3.0,
        }
    }

    /// The highest point of the outline.
    pub(crate) fn peak(&self) -> f64 {
        match self.gable {
            Gable::None => self.height,
            Gable::Pointed(h) | Gable::Stepped(h) => self.height + h,
        }
    }

    fn floors(&self) -> usize {
        ((self.height - GROUND_FLOOR - 0.4) / FLOOR)
            .floor()
            .max(0.0) as usize
    }

    /// The window of bay `bay` in upper floor `floor`, both counted from 0 at the lower left.
    pub(crate) fn window(&self, bay: usize, floor: usize) -> Opening {
        let pitch = self.width / self.bays as f64;
        let middle = (bay as f64 + 0.5) * pitch;
        let half = (0.5 * pitch - 0.2).clamp(0.2, 0.5);
        let sill = GROUND_FLOOR + floor as f64 * FLOOR + 0.75;
        Opening {
            low: DVec2::new(middle - half, sill),
            high: DVec2::new(middle + half, sill + 1.6),
        }
    }

    /// All windows of the upper floors.
    pub(crate) fn windows(&self) -> impl Iterator<Item = Opening> + '_ {
        (0..self.floors())
            .flat_map(move |floor| (0..self.bays).map(move |bay| self.window(bay, floor)))
    }

    fn nearest_window(&self, q: DVec2) -> Option<(Opening, usize, usize)> {
        let bay = (q.x / self.width * self.bays as f64).floor();
        let floor = ((q.y - GROUND_FLOOR) / FLOOR).floor();
        let valid = bay >= 0.0
            && (bay as usize) < self.bays
            && floor >= 0.0
            && (floor as usize) < self.floors();
        valid.then(|| {
            (
                self.window(bay as usize, floor as usize),
                bay as usize,
                floor as usize,
            )
        })
    }

    /// The facade at `q`, seen along `view` and lit from `sun` (both in the local frame right, up, out; `view` goes
    /// towards the wall, `sun` towards the sun).
    pub(crate) fn surface(&self, q: DVec2, footprint: f64, view: DVec3, sun: DVec3) -> Surface {
        let top = self.top(q.x);
        let alpha = above(top, q.y, footprint) as f32;
        if alpha == 0.0 || q.x < 0.0 || q.x > self.width {
            return Surface::NOTHING;
        }
        let mut surface = if q.y < GROUND_FLOOR {
            self.street_level(q, footprint, view, sun)
        } else {
            self.upper_floors(q, footprint, view, sun)
        };
        self.ledges(q, footprint, sun, &mut surface);
        // dirt from the ground and the darkness of the canyon's bottom
        surface.ambient *= (0.55 + 0.45 * smoothstep(0.0, 5.0, q.y)) as f32;
        // neighbors meet in a dark joint
        let joint = q.x.min(self.width - q.x);
        surface.albedo *= 1.0 - 0.5 * smoothstep(0.05, 0.0, joint) as f32;
        surface.alpha = alpha;
        surface
    }

    pub(crate) fn wall(&self, q: DVec2, footprint: f64) -> Surface {
        let stain = fractal(q * DVec2::new(0.7, 0.35), footprint, 4, self.seed.fork(1));
        let streaks = fractal(
            q * DVec2::new(5.0, 0.4),
            5.0 * footprint,
            3,
            self.seed.fork(2),
        );
        let weather = (1.0 + 0.10 * stain + 0.025 * streaks) as f32;
        let rough = |color: Vec3| {
            let grain = fractal(q * 14.0, 14.0 * footprint, 3, self.seed.fork(3));
            let patch = smoothstep(
                0.55,
                0.75,
                fractal(q * 0.9, footprint, 4, self.seed.fork(4)) + 0.25,
            );
            let bare = hex(0xb8a992) * (1.0 + 0.1 * grain) as f32;
            (color * (1.0 + 0.07 * grain) as f32).lerp(bare, 0.35 * patch as f32)
        };
        let mut surface = Surface::plain(match self.wall {
            Wall::Plaster(color) | Wall::Timber(color) => rough(color) * weather,
            Wall::Brick(color) => brick(q, footprint, color, self.seed.fork(5)) * weather,
        });
        if let Wall::Timber(_) = self.wall {
            let beams = self.beams(q, footprint);
            let dark = wood(
                DVec2::new(q.y, q.x),
                footprint,
                hex(0x4a3322),
                self.seed.fork(6),
            );
            surface.albedo = surface.albedo.lerp(dark, beams as f32);
        }
        surface
    }

    /// Coverage of the timber frame: posts, rails and crossed braces.
    fn beams(&self, q: DVec2, footprint: f64) -> f64 {
        if q.y < GROUND_FLOOR {
            return 0.0;
        }
        let pitch = self.width / self.bays as f64;
        let floor = ((q.y - GROUND_FLOOR) / FLOOR).floor();
        let w = q.y - GROUND_FLOOR - floor * FLOOR;
        let bay = (q.x / pitch).floor();
        let x = q.x - (bay + 0.5) * pitch;
        let beam = |distance: f64, half: f64| crate::coverage::bar(distance, half, footprint);
        let mut covered = beam(w, 0.11)
            .max(beam(w - FLOOR, 0.11))
            .max(beam(w - 0.68, 0.06));
        covered = covered
            .max(beam(x.abs() - 0.5 * pitch, 0.09))
            .max(beam(x.abs() - 0.58, 0.06));
        if w < 0.68 {
            // a cross below each window
            let (sin, cos) = (0.68f64.atan2(1.1)).sin_cos();
            let cross = (x.abs() * sin - (w - 0.34).abs() * cos).abs();
            if x.abs() < 0.55 {
                covered = covered.max(beam(cross, 0.05));
            }
        } else {
            // braces from the posts' feet towards the windows
            let brace = ((0.5 * pitch - x.abs()) * 0.94 - (w - 0.68) * 0.34).abs();
            if x.abs() > 0.6 {
                covered = covered.max(beam(brace, 0.055));
            }
        }
        covered
    }

    fn upper_floors(&self, q: DVec2, footprint: f64, view: DVec3, sun: DVec3) -> Surface {
        let Some((window, bay, floor)) = self.nearest_window(q) else {
            return self.wall(q, footprint);
        };
        if window.contains(q) {
            let tag = self.seed.fork(20).unit(bay as i64, floor as i64, 0);
            return self.glazing(q, footprint, view, sun, window, tag);
        }
        // surround and sill
        let frame = 0.11;
        let outside = (window.low - q).max(q - window.high).max_element();
        if let Some(color) = self.shutters
            && let Some(surface) = self.shutter(q, footprint, window, color, bay, floor)
        {
            return surface;
        }
        let mut surface = self.wall(q, footprint);
        let sill = q.y < window.low.y
            && q.y > window.low.y - 0.12
            && (q.x - 0.5 * (window.low.x + window.high.x)).abs() < 0.62;
        let timber = matches!(self.wall, Wall::Timber(_));
        if sill || (outside < frame && !timber) {
            let grain = fractal(q * 9.0, 9.0 * footprint, 3, self.seed.fork(7));
            surface.albedo = self.trim * (0.95 + 0.07 * grain) as f32;
            if sill {
                surface.albedo *= 1.08;
            }
        }
        // shadow below the sill, and of the shutters, which stand out by 5 cm
        if sun.z > 0.05 {
            let drop = 0.11 * sun.y / sun.z;
            let below = window.low.y - 0.12 - q.y;
            let slide = q.x + below / sun.y * sun.x - 0.5 * (window.low.x + window.high.x);
            if below > 0.0 && below < drop && slide.abs() < 0.62 {
                surface.sun *= 0.1;
            }
            if let Some(color) = self.shutters {
                let toward = q + 0.05 * DVec2::new(sun.x, sun.y) / sun.z;
                if self
                    .shutter(toward, footprint, window, color, bay, floor)
                    .is_some()
                {
                    surface.sun *= 0.1;
                }
            }
        }
        let below = window.low.y - 0.12 - q.y;
        if (0.0..0.5).contains(&below) && (q.x - 0.5 * (window.low.x + window.high.x)).abs() < 0.62
        {
            surface.ambient *= (0.75 + 0.5 * below) as f32;
        }
        surface
    }

    fn shutter(
        &self,
        q: DVec2,
        footprint: f64,
        window: Opening,
        color: Vec3,
        bay: usize,
        floor: usize,
    ) -> Option<Surface> {
        let width = 0.5 * (window.high.x - window.low.x) - 0.02;
        let left = window.low.x - 0.04 - q.x;
        let right = q.x - window.high.x - 0.04;
        let across = if left > 0.0 { left } else { right };
        if q.y < window.low.y || q.y > window.high.y || across <= 0.0 || across > width {
            return None;
        }
        let border = across
            .min(width - across)
            .min(q.y - window.low.y)
            .min(window.high.y - q.y);
        let middle = (q.y - 0.5 * (window.low.y + window.high.y)).abs();
        let age = self
            .seed
            .fork(21)
            .between(bay as i64, floor as i64, 0, 0.85, 1.1);
        let mut surface = Surface::plain(color * age as f32);
        if border > 0.05 && middle > 0.04 {
            // slats: light on their upper side, dark beneath; their mean where they are too fine
            let period = 0.055;
            let t = q.y / period - (q.y / period).floor();
            let visible = (1.5 - 2.5 * footprint / period).clamp(0.0, 1.0);
            surface.albedo *= (0.82 + visible * 0.36 * (t - 0.5)) as f32;
            surface.normal = DVec3::new(0.0, 0.35 * visible, 1.0).normalize();
        } else if border < 0.012 {
            surface.albedo *= 0.6;
        }
        Some(surface)
    }

    /// The inside of an opening: reveal, frame, bars, curtains and glass.
    pub(crate) fn glazing(
        &self,
        q: DVec2,
        footprint: f64,
        view: DVec3,
        sun: DVec3,
        opening: Opening,
        tag: f64,
    ) -> Surface {
        // where the ray meets the plane of the glass
        let slant = DVec2::new(view.x, view.y) / (-view.z).max(0.03);
        let g = q + RECESS * slant;
        if !opening.contains(g) {
            let mut reveal = Surface::plain(self.trim * 0.85);
            // the side, the lintel or the sill of the hole
            reveal.normal = if g.x < opening.low.x {
                DVec3::X
            } else if g.x > opening.high.x {
                DVec3::NEG_X
            } else if g.y > opening.high.y {
                DVec3::NEG_Y
            } else {
                DVec3::Y
            };
            reveal.ambient = 0.6;
            return reveal;
        }
        let lit = if sun.z > 0.05 {
            let toward = g + RECESS * DVec2::new(sun.x, sun.y) / sun.z;
            f32::from(opening.contains(toward))
        } else {
            1.0
        };
        let extent = opening.high - opening.low;
        let p = (g - opening.low) / extent;
        let border = (g - opening.low).min(opening.high - g).min_element();
        let bar = 0.022 + 0.1 * footprint;
        let on_bar = border < 0.055
            || (p.x - 0.5).abs() * extent.x < 0.03
            || ((p.y - 0.68).abs() * extent.y < bar)
            || ((p.y - 0.34).abs() * extent.y < 0.6 * bar);
        if on_bar {
            let mut frame = Surface::plain(hex(0xe9e3d6));
            frame.sun = lit;
            frame.ambient = 0.75;
            return frame;
        }
        // a dim room behind, curtains at the sides, sometimes a lamp
        let side = (p.x - 0.5).abs() * 2.0;
        let hem = 0.55 + 0.25 * p.y + 0.06 * tag;
        let folds = ((p.x * extent.x) * 55.0 + 3.0 * (p.y * 4.0 + tag * 9.0).sin()).sin();
        let mut glass = Surface::plain(hex(0x1a1c22));
        if tag > 0.25 && side > hem {
            let cloth = if tag > 0.7 {
                hex(0xd9ccb4)
            } else {
                hex(0xc48f6a)
            };
            let visible = (1.4 - 25.0 * footprint).clamp(0.0, 1.0);
            glass.albedo = cloth * (0.55 + 0.18 * visible * folds) as f32;
        } else if tag > 0.78 && (p.y < 0.9) {
            let warm = smoothstep(0.9, 0.0, p.distance(DVec2::new(0.5, 0.75)));
            glass.glow = Vec3::new(0.55, 0.30, 0.10) * (0.25 + 0.9 * warm) as f32;
        }
        glass.sun = lit * 0.7;
        glass.ambient = 0.55;
        let facing = (-view.z).clamp(0.0, 1.0);
        glass.mirror = (0.22 + 0.6 * (1.0 - facing).powi(4)) as f32;
        // old panes are not quite flat
        let pane = (p * DVec2::new(2.0, 3.0)).floor();
        let wobble = |axis: u64| {
            0.03 * (self.seed.fork(23).unit(
                (pane.x + 10.0 * tag * 50.0) as i64,
                pane.y as i64,
                axis,
            ) - 0.5)
        };
        glass.normal = DVec3::new(wobble(0), wobble(1), 1.0).normalize();
        glass
    }

    /// String courses between floors and the cornice, with their shadows.
    fn ledges(&self, q: DVec2, footprint: f64, sun: DVec3, surface: &mut Surface) {
        let mut ledge = |bottom: f64, thickness: f64, depth: f64| {
            let w = q.y - bottom;
            if (0.0..thickness).contains(&w) {
                let t = w / thickness;
                let grain = fractal(q * 8.0, 8.0 * footprint, 3, self.seed.fork(13));
                // a rounded profile: bright above, dark below
                let shade =
                    0.72 + 0.32 * smoothstep(0.15, 0.75, t) - 0.10 * smoothstep(0.8, 1.0, t);
                *surface = Surface::plain(self.trim * (shade + 0.05 * grain) as f32);
                surface.normal = DVec3::new(0.0, 0.5 * (t - 0.4), 1.0).normalize();
            } else if w < 0.0 {
                if sun.z > 0.05 {
                    let reach = depth * sun.y / sun.z;
                    surface.sun *=
                        1.0 - 0.95 * above(w, -reach, (0.02 * reach).max(footprint)) as f32;
                }
                surface.ambient *= (1.0 - 0.45 * smoothstep(-4.0 * depth, 0.0, w)) as f32;
            }
        };
        if !matches!(self.ground_floor, GroundFloor::Shop(..)) || q.y > GROUND_FLOOR - 0.02 {
            ledge(GROUND_FLOOR, 0.2, 0.14);
        }
        if !matches!(self.wall, Wall::Timber(_)) {
            for floor in 1..self.floors() {
                ledge(GROUND_FLOOR + FLOOR * floor as f64, 0.13, 0.07);
            }
        }
        if matches!(self.gable, Gable::None) {
            ledge(self.height - 0.42, 0.42, 0.38);
            // dentils under the cornice
            let below = self.height - 0.42 - q.y;
            if (0.0..0.16).contains(&below) {
                let on = crate::coverage::pulse(q.x / 0.26, 0.55, footprint / 0.26) as f32;
                surface.albedo = surface.albedo.lerp(self.trim * 0.9, on);
                surface.ambient *= 0.7 + 0.3 * on;
            }
        }
    }
}
