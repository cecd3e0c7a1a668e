//! Props of a street: paving, plants, awnings, flags, and things drawn with strokes and fills.

use crate::coverage::{above, bar, pulse};
use crate::facade::Surface;
use crate::paint::hex;
use crate::random::Seed;
use crate::stroke::Strokes;
use crate::texture::{Masonry, foliage, fractal, gradient_noise, smoothstep};
use glam::{DVec2, DVec3, Vec3};

/// A rectangle's content. Coordinates are meters from the lower left corner of the rectangle, y up.
pub(crate) enum Prop {
    /// An opaque plain surface.
    Panel(Vec3),
    /// The street: `middle` is the x of the axis, kerbs at both sides of it.
    Ground {
        middle: f64,
        kerbs: [f64; 2],
        seed: Seed,
    },
    /// Striped cloth; `scallop` is the depth of the lower border's waves.
    Cloth {
        colors: [Vec3; 2],
        stripe: f64,
        scallop: f64,
    },
    /// Strokes and fills, the first at the back.
    Drawing(Vec<Layer>),
    /// Leaves around blobs, over a drawing of the trunk or the pot.
    Plant(Plant),
    /// A wire with triangular flags.
    Bunting {
        span: f64,
        ends: [f64; 2],
        sag: f64,
        seed: Seed,
    },
    /// A bare wall of bricks.
    Bricks(Vec3, Seed),
}

/// A plant.
pub(crate) struct Plant {
    pub stem: Vec<Layer>,
    /// Centers and radii.
    pub blobs: Vec<(DVec2, f64)>,
    /// Length of a leaf.
    pub leaf: f64,
    /// Color of leaves in the shade and in the light.
    pub colors: [Vec3; 2],
    /// Color of blossoms and their share among the leaves.
    pub blossom: (Vec3, f64),
    pub seed: Seed,
}

/// A shape of one color.
pub(crate) struct Layer {
    pub shape: Shape,
    pub color: Vec3,
    /// Own light, as a multiple of the color.
    pub glow: f32,
}

pub(crate) enum Shape {
    Strokes(Strokes),
    /// A convex polygon, counter-clockwise (y up).
    Polygon(Vec<DVec2>),
    Disc(DVec2, f64),
}

impl Shape {
    fn coverage(&self, q: DVec2, footprint: f64) -> f64 {
        match self {
            Self::Strokes(strokes) => strokes.soft_coverage(q, footprint),
            Self::Disc(center, radius) => above(*radius, q.distance(*center), footprint),
            Self::Polygon(corners) => {
                let inside = |i: usize| {
                    let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                    (b - a).normalize_or_zero().perp_dot(q - a)
                };
                let nearest = (0..corners.len()).map(inside).fold(f64::INFINITY, f64::min);
                above(nearest, 0.0, footprint)
            }
        }
    }
}

impl Layer {
    pub(crate) fn fill(color: u32, corners: &[(f64, f64)]) -> Self {
        Self {
            shape: Shape::Polygon(corners.iter().map(|&p| p.into()).collect()),
            color: hex(color),
            glow: 0.0,
        }
    }

    pub(crate) fn disc(color: u32, center: (f64, f64), radius: f64) -> Self {
        Self {
            shape: Shape::Disc(center.into(), radius),
            color: hex(color),
            glow: 0.0,
        }
    }

    pub(crate) fn strokes(
        color: u32,
        strokes: impl IntoIterator<Item = crate::stroke::Stroke>,
    ) -> Self {
        Self {
            shape: Shape::Strokes(Strokes::new(strokes)),
            color: hex(color),
            glow: 0.0,
        }
    }

    pub(crate) fn glowing(self, glow: f32) -> Self {
        Self { glow, ..self }
    }
}

fn draw(layers: &[Layer], q: DVec2, footprint: f64) -> Surface {
    let mut surface = Surface::NOTHING;
    for layer in layers {
        let covered = layer.shape.coverage(q, footprint) as f32;
        if covered > 0.0 {
            let alpha = covered + surface.alpha * (1.0 - covered);
            // straight color of "over"
            let t = covered / alpha;
            surface.albedo = surface.albedo.lerp(layer.color, t);
            surface.glow = surface.glow.lerp(layer.color * layer.glow, t);
            surface.alpha = alpha;
        }
    }
    surface
}

fn drawn_opacity(layers: &[Layer], q: DVec2, footprint: f64) -> f64 {
    layers
        .iter()
        .map(|layer| layer.shape.coverage(q, footprint))
        .fold(0.0, f64::max)
}

impl Prop {
    /// The surface at `q`; `view` and `sun` in the local frame (right, up, out).
    pub(crate) fn surface(&self, q: DVec2, footprint: f64, view: DVec3, sun: DVec3) -> Surface {
        match self {
            Self::Panel(color) => Surface::plain(*color),
            Self::Bricks(color, seed) => {
                let stain = fractal(q * 0.6, 0.6 * footprint, 4, seed.fork(1));
                let mut surface = Surface::plain(
                    crate::texture::brick(q, footprint, *color, *seed) * (1.0 + 0.2 * stain) as f32,
                );
                surface.ambient = (0.5 + 0.5 * smoothstep(0.0, 4.0, q.y)) as f32;
                surface
            }
            Self::Ground {
                middle,
                kerbs,
                seed,
            } => ground(q, q.x - middle, *kerbs, footprint, *seed),
            Self::Cloth {
                colors,
                stripe,
                scallop,
            } => {
                let part = pulse(q.x / stripe, 0.5, footprint / stripe) as f32;
                let mut surface = Surface::plain(colors[0].lerp(colors[1], part));
                let wave = 0.5 - 0.5 * (q.x / stripe * std::f64::consts::TAU * 2.0).cos();
                surface.alpha = if *scallop > 0.0 {
                    above(q.y, scallop * (1.0 - wave.sqrt()), footprint) as f32
                } else {
                    1.0
                };
                // a soft sag between the ribs
                let sag = (q.x / (2.0 * stripe) * std::f64::consts::TAU).sin();
                surface.normal = DVec3::new(0.12 * sag, 0.0, 1.0).normalize();
                if view.z * sun.z > 0.0 {
                    // seen from the shaded side: light comes through
                    surface.glow = surface.albedo * Vec3::new(0.75, 0.56, 0.36) * 0.55;
                    surface.ambient = 0.6;
                }
                surface
            }
            Self::Drawing(layers) => draw(layers, q, footprint),
            Self::Plant(plant) => plant.surface(q, footprint, sun),
            Self::Bunting {
                span,
                ends,
                sag,
                seed,
            } => bunting(q, footprint, *span, *ends, *sag, *seed),
        }
    }

    /// Part of a soft ray of width `footprint` that is stopped at `q`.
    pub(crate) fn opacity(&self, q: DVec2, footprint: f64) -> f32 {
        match self {
            Self::Panel(_) | Self::Ground { .. } | Self::Bricks(..) => 1.0,
            Self::Cloth { scallop, .. } => {
                if q.y > 0.5 * scallop {
                    0.92
                } else {
                    0.0
                }
            }
            Self::Drawing(layers) => drawn_opacity(layers, q, footprint) as f32,
            Self::Plant(plant) => plant.opacity(q, footprint),
            Self::Bunting {
                span,
                ends,
                sag,
                seed,
            } => bunting(q, footprint, *span, *ends, *sag, *seed).alpha,
        }
    }
}

impl Plant {
    fn density(&self, p: DVec2) -> f64 {
        let mut best = -1.0f64;
        for &(center, radius) in &self.blobs {
            best = best.max(1.0 - p.distance(center) / radius);
        }
        if best < -0.6 {
            return best;
        }
        2.0 * best + 0.9 * gradient_noise(p / (5.0 * self.leaf), self.seed.fork(1))
    }

    fn surface(&self, q: DVec2, footprint: f64, sun: DVec3) -> Surface {
        let leaves = foliage(q, footprint, self.leaf, |p| self.density(p), self.seed);
        let mut stem = draw(&self.stem, q, footprint);
        if leaves.cover <= 0.0 {
            // the shade of the crown lies on the stem
            stem.ambient = 0.6;
            return stem;
        }
        // the blob in front gives the leaf its place in the light
        let mut toward = DVec3::Z;
        let mut best = -1.0;
        for &(center, radius) in &self.blobs {
            let d = (q - center) / radius;
            let depth = 1.0 - d.length_squared();
            if depth > best {
                best = depth;
                toward = DVec3::new(d.x, d.y, depth.max(0.04).sqrt());
            }
        }
        let exposed = smoothstep(-0.55, 0.75, toward.normalize().dot(sun));
        let t = leaves.height;
        let mut surface = Surface::plain(self.colors[0].lerp(
            self.colors[1],
            (0.15 + 0.85 * t * exposed + 0.25 * (leaves.tint - 0.5)).clamp(0.0, 1.0) as f32,
        ));
        if leaves.tint < self.blossom.1 && t > 0.35 {
            surface.albedo = self.blossom.0 * (0.7 + 0.5 * t) as f32;
        }
        let tilt = 1.6 * (leaves.tint - 0.5);
        surface.normal = (toward + DVec3::new(0.5 * tilt, 0.35 + 0.4 * tilt, 0.2)).normalize();
        surface.sun = (exposed * smoothstep(0.0, 0.75, t)) as f32;
        surface.ambient = (0.22 + 0.6 * t * (0.5 + 0.5 * exposed)) as f32;
        let cover = leaves.cover as f32;
        surface.alpha = cover + stem.alpha * (1.0 - cover);
        surface.albedo = stem.albedo.lerp(surface.albedo, cover / surface.alpha);
        surface
    }

    fn opacity(&self, q: DVec2, footprint: f64) -> f32 {
        let density = self.density(q);
        let stem = drawn_opacity(&self.stem, q, footprint);
        // gaps between the leaves let flecks of sun through
        let holes = gradient_noise(q / (2.2 * self.leaf), self.seed.fork(2));
        let soft = 0.25 + footprint / self.leaf;
        let leaves = smoothstep(-0.3 * soft, 0.9 * soft, density + 0.55 * holes - 0.05);
        stem.max(0.96 * leaves) as f32
    }
}

/// Setts in arcs between the kerbs, slabs beside them, a gutter, a puddle.
fn ground(q: DVec2, x: f64, kerbs: [f64; 2], footprint: f64, seed: Seed) -> Surface {
    let dirt = fractal(q * 0.45, 0.45 * footprint, 5, seed.fork(1));
    let grain = fractal(q * 22.0, 22.0 * footprint, 3, seed.fork(2));
    let [left, right] = kerbs;
    if x < left || x > right {
        let from_kerb = if x < left { left - x } else { x - right };
        if from_kerb < 0.16 {
            let along = pulse(q.y / 0.9, 0.985, footprint / 0.9);
            let edge = smoothstep(0.0, 0.03, from_kerb);
            let shade = (0.75 + 0.25 * edge) * (0.5 + 0.5 * along) * (1.0 + 0.12 * grain);
            return Surface::plain(hex(0xbdb4a6) * shade as f32);
        }
        let slabs = Masonry {
            length: 0.62,
            height: 0.42,
            joint: 0.014,
            shift: 0.5,
        };
        let stone = slabs.at(q, footprint, seed.fork(3));
        let shade =
            (0.62 + 0.38 * stone.face) * (1.0 + 0.13 * stone.tint + 0.10 * grain + 0.14 * dirt);
        let mut surface = Surface::plain(hex(0xafa493) * shade as f32);
        // walls shade the pavement's inner part from the sky
        surface.ambient = (1.0 - 0.35 * smoothstep(0.8, 1.9, from_kerb)) as f32;
        return surface;
    }
    let gutter = (x - left).min(right - x);
    if gutter < 0.22 {
        let along = pulse(q.y / 0.5, 0.97, footprint / 0.5);
        let shade =
            (0.55 + 0.3 * gutter / 0.22) * (0.6 + 0.4 * along) * (1.0 + 0.15 * grain + 0.2 * dirt);
        return Surface::plain(hex(0x8d867c) * shade as f32);
    }
    // each arc spans a lane
    let lanes = 5.0;
    let lane_width = (right - left) / lanes;
    let t = (x - left) / lane_width;
    let t = t - t.floor() - 0.5;
    let arched = DVec2::new(
        x,
        q.y + 1.3 * t * t * lane_width + 0.03 * gradient_noise(q * 1.7, seed.fork(4)),
    );
    let setts = Masonry {
        length: 0.145,
        height: 0.125,
        joint: 0.024,
        shift: 0.5,
    };
    let stone = setts.at(arched, footprint, seed.fork(5));
    let wheel = smoothstep(0.5, 0.1, ((x - 0.5 * (left + right)).abs() - 1.0).abs());
    let tone = 1.0 + 0.30 * stone.tint + 0.14 * grain + 0.20 * dirt + 0.10 * wheel;
    let face = hex(0x9b938c).lerp(hex(0xa88b76), (0.5 + 0.5 * stone.tint) as f32);
    let mut surface = Surface::plain(hex(0x4b453e).lerp(face * tone as f32, stone.face as f32));
    // rounded heads: they turn a little towards and away from the viewer
    surface.normal = DVec3::new(0.12 * (stone.tint), 0.30 * stone.relief, 1.0).normalize();
    surface.ambient = (0.7 + 0.3 * stone.face) as f32;
    // a puddle where the paving has sunk, darker at its wet rim
    let sunk = |center: DVec2, extent: DVec2| {
        let d = (DVec2::new(x, q.y) - center) / extent;
        1.0 - d.length() + 0.28 * fractal(q * 1.3, footprint, 4, seed.fork(6))
    };
    let depth = sunk(DVec2::new(-1.25, 10.6), DVec2::new(1.5, 1.25))
        .max(sunk(DVec2::new(1.9, 14.5), DVec2::new(1.0, 1.8)));
    let wet = smoothstep(-0.22, 0.04, depth) as f32;
    surface.albedo *= 1.0 - 0.5 * wet;
    let water = smoothstep(0.0, 0.10, depth) as f32;
    if water > 0.0 {
        surface.mirror = 0.62 * water;
        let ripple = |k: f64| 0.006 * gradient_noise(q * DVec2::new(7.0, 5.0) + k, seed.fork(7));
        let calm = DVec3::new(ripple(0.0), ripple(31.0), 1.0).normalize();
        surface.normal = surface.normal.lerp(calm, water as f64).normalize();
    }
    surface
}

fn bunting(q: DVec2, footprint: f64, span: f64, ends: [f64; 2], sag: f64, seed: Seed) -> Surface {
    const PITCH: f64 = 0.52;
    const FLAG: DVec2 = DVec2::new(0.19, 0.42);
    let wire = |x: f64| {
        let t = (x / span).clamp(0.0, 1.0);
        ends[0] + (ends[1] - ends[0]) * t - 4.0 * sag * t * (1.0 - t)
    };
    let mut surface = Surface::NOTHING;
    let index = (q.x / PITCH).floor();
    let middle = (index + 0.5) * PITCH;
    let sway = 0.12 * (seed.unit(index as i64, 0, 1) - 0.5);
    let drop = wire(middle) - q.y;
    let aside = (q.x - middle - sway * drop).abs();
    let half = FLAG.x * (1.0 - drop / FLAG.y);
    let covered = bar(aside, half.max(0.0), footprint) * above(wire(q.x) - q.y, 0.0, footprint);
    if covered > 0.0 && middle < span - 0.2 && middle > 0.2 {
        let palette = [0xd93f2e, 0xf2c13d, 0x2f7f8f, 0xf4eee0, 0x4d8a4a, 0xe37835];
        surface = Surface::plain(hex(palette[(seed.bits(index as i64, 0, 2) % 6) as usize]));
        surface.glow = surface.albedo * 0.16;
        surface.alpha = covered as f32;
        surface.normal = DVec3::new(0.9 * sway * 10.0 * 0.3, 0.1, 1.0).normalize();
    }
    let thread = bar(q.y - wire(q.x), 0.008, footprint) as f32;
    if thread > 0.0 {
        surface.albedo = surface.albedo.lerp(hex(0x2b2826), thread);
        surface.alpha = surface.alpha.max(thread);
    }
    surface
}
