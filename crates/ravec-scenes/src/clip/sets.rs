//! Backgrounds that a person would film: a row of houses, a road from above, a wall with a poster, a landscape.
//!
//! Each is a picture on a plane. The houses are photographed from one place across the road: a camera that turns or zooms
//! there relates its frames by homographies whatever the depth of the scene, so the plane that carries the photo is exact.

use crate::clip::shape::Disc;
use crate::clip::world::{Line, Quad, World};
use crate::coverage::{above, bar, pulse};
use crate::facade::FLOOR;
use crate::furniture::{bicycle, lamp};
use crate::glyph;
use crate::greenery::{pot, tree};
use crate::paint::hex;
use crate::plane::leaf_shade;
use crate::props::Prop;
use crate::random::Seed;
use crate::shapes::landscape_painter;
use crate::stage::{HAZE, HAZE_LENGTH, Piece, Show, Stage, film};
use crate::street::{facade, flower_boxes, graded, left_row, right_row, street_painter};
use crate::stroke::{Stroke, Strokes};
use crate::texture::{brick, foliage, fractal, grass, smoothstep};
use glam::{DVec2, DVec3, Vec3};
use ravec_raster::Size;

/// A window of a set: where the picture lies, in meters of the set.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    /// Upper left corner; y up.
    pub corner: DVec2,
    /// World pixels per meter.
    pub px_per_m: f64,
    /// Extent in world pixels.
    pub extent: DVec2,
    /// Texels per world pixel: the largest zoom of the camera.
    pub texels_per_px: f64,
}

impl View {
    /// The world point of a point of the set.
    pub(crate) fn world(&self, x: f64, y: f64) -> DVec2 {
        self.px_per_m * DVec2::new(x - self.corner.x, self.corner.y - y)
    }

    fn line(&self, name: &str, from: (f64, f64), to: (f64, f64), width_px: f64) -> Line {
        Line {
            name: name.to_owned(),
            from: self.world(from.0, from.1),
            to: self.world(to.0, to.1),
            width_px,
        }
    }

    fn disc(&self, center: (f64, f64), radius_m: f64) -> Disc {
        Disc {
            center: self.world(center.0, center.1),
            radius_px: radius_m * self.px_per_m,
        }
    }
}

/// Eye height from which the row of houses is photographed: that of a first floor, across the road.
const EYE_HEIGHT: f64 = 4.2;
const EYE_DISTANCE: f64 = 42.0;
/// Length of the row.
const ROW: f64 = 108.0;

/// A row of houses behind trees, in the afternoon sun; x along the row from 0 to 108 m, y up from the pavement.
///
/// Known features: the windows of the upper floors, two wires before the fronts, round signs.
pub(crate) fn row(view: View, seed: Seed) -> World {
    let mut pieces = vec![row_ground(seed)];
    let mut left = 0.0;
    for (index, house) in left_row().into_iter().chain(right_row()).enumerate() {
        let origin = DVec3::new(left, 0.0, 0.0);
        left += house.width;
        pieces.push(facade(
            &house,
            origin,
            DVec3::X,
            seed.fork(200 + index as u64),
        ));
    }
    let boxes = flower_boxes(&pieces, seed);
    let windows = row_windows(&pieces, view);
    pieces.extend(boxes);
    pieces.extend(row_furniture(seed));
    let sun = DVec3::new(-0.50, 0.66, 0.56);
    let stage = Stage::new(pieces, sun, seed.fork(800));
    let eye = DVec3::new(
        view.corner.x + 0.5 * view.extent.x / view.px_per_m,
        EYE_HEIGHT,
        EYE_DISTANCE,
    );
    let haze = 0.8 * (1.0 - (-EYE_DISTANCE / HAZE_LENGTH).exp());
    let world = World::paint(view.extent, view.texels_per_px, |p, side| {
        let at = DVec3::new(
            view.corner.x + p.x / view.px_per_m,
            view.corner.y - p.y / view.px_per_m,
            0.0,
        );
        let spread = side / (view.px_per_m * EYE_DISTANCE);
        let direction = (at - eye) / EYE_DISTANCE;
        // a tele lens with a filter against the haze of the distance
        let light = stage.radiance(eye, direction, spread);
        let clear = (light - HAZE * haze as f32).max(Vec3::ZERO) / (1.0 - haze) as f32;
        graded(film(clear, 0.58))
    });
    let mut world = row_signs(world, view);
    world.features.quads = windows;
    world
}

/// Pavement and roadway along the row.
fn row_ground(seed: Seed) -> Piece {
    const BEFORE: f64 = 60.0;
    Piece {
        origin: DVec3::new(-BEFORE, 0.0, 0.0),
        right: DVec3::Z,
        up: DVec3::X,
        size: DVec2::new(30.0, ROW + 2.0 * BEFORE),
        show: Show::Prop(Box::new(Prop::Ground {
            middle: 6.4,
            kerbs: [-3.1, 3.7],
            seed: seed.fork(100),
        })),
    }
}

fn row_furniture(seed: Seed) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for (index, x) in [13.6, 24.6, 42.5, 51.0, 67.0, 76.0, 90.0, 101.0]
        .into_iter()
        .enumerate()
    {
        pieces.push(tree(DVec3::new(x, 0.0, 2.6), seed.fork(400 + index as u64)));
    }
    for x in [9.2, 29.5, 46.8, 62.2, 80.5, 95.5] {
        pieces.push(lamp(DVec3::new(x, 0.0, 2.9)));
    }
    for x in [4.6, 37.4, 72.0] {
        pieces.push(bicycle(DVec3::new(x, 0.0, 0.7)));
    }
    for (index, (x, blossom)) in [
        (1.2, 0xd83246),
        (10.8, 0xf0c840),
        (16.2, 0xe8e2f0),
        (21.6, 0xd84a7a),
        (28.4, 0xd83246),
        (39.8, 0xf0c840),
        (56.8, 0xe8e2f0),
        (65.0, 0xd84a7a),
        (84.0, 0xd83246),
    ]
    .into_iter()
    .enumerate()
    {
        pieces.push(pot(
            DVec3::new(x, 0.0, 0.55),
            blossom,
            seed.fork(500 + index as u64),
        ));
    }
    pieces
}

fn row_windows(pieces: &[Piece], view: View) -> Vec<Quad> {
    let mut quads = Vec::new();
    for piece in pieces {
        let Show::Facade(facade) = &piece.show else {
            continue;
        };
        for window in facade.windows() {
            let at = |x: f64, y: f64| view.world(piece.origin.x + x, y);
            let (low, high) = (window.low, window.high);
            quads.push(Quad {
                name: format!("window {}", quads.len() + 1),
                corners: [
                    at(low.x, high.y),
                    at(high.x, high.y),
                    at(high.x, low.y),
                    at(low.x, low.y),
                ],
            });
        }
    }
    quads
}

fn row_signs(world: World, view: View) -> World {
    let thick = 0.055 * view.px_per_m;
    let upper = 4.9 + 1.9 * FLOOR;
    let mut world = world
        .with_line(
            view.line("upper wire", (0.0, upper), (ROW, upper - 1.6), thick),
            hex(0x1d1e22),
        )
        .with_line(
            view.line("lower wire", (0.0, 4.75), (ROW, 6.1), thick),
            hex(0x1d1e22),
        );
    for (index, (x, y)) in [
        (7.4, 3.62),
        (32.2, 3.7),
        (55.6, 3.66),
        (71.2, 3.7),
        (84.6, 3.64),
    ]
    .into_iter()
    .enumerate()
    {
        let disc = view.disc((x, y), 0.42);
        let (ground, ink) = [
            (hex(0xf0e8d2), hex(0x23303c)),
            (hex(0xc8402e), hex(0xf4ecd8)),
            (hex(0x2c5f8a), hex(0xf2e4b4)),
        ][index % 3];
        let face = move |q: DVec2| sign_color(q, ground, ink);
        world = world.with_disc(&format!("sign {}", index + 1), disc, face);
    }
    world
}

/// A round sign with a border and a cup, or the like, on it.
fn sign_color(q: DVec2, ground: Vec3, ink: Vec3) -> Vec3 {
    let ring = bar(q.length() - 0.84, 0.06, 0.06);
    let bowl = above(0.36, q.distance(DVec2::new(-0.05, -0.02)), 0.06) * above(q.y, -0.08, 0.06);
    let handle = bar(q.distance(DVec2::new(0.36, 0.1)) - 0.15, 0.05, 0.06);
    let plate = bar(q.y - 0.42, 0.05, 0.05) * above(0.5, q.x.abs(), 0.06);
    let mark = ring.max(bowl).max(handle).max(plate);
    ground.lerp(ink, mark as f32)
}

/// The street towards its church, as in the scene of that name; the extent is that of the picture.
pub(crate) fn street_picture(extent: DVec2, texels_per_px: f64, seed: Seed) -> World {
    let size = Size::new(
        extent.x.ceil().max(1.0) as usize,
        extent.y.ceil().max(1.0) as usize,
    )
    .expect("the extent of a view is a few frames");
    World::paint(extent, texels_per_px, street_painter(size, seed))
}

/// A meadow before hills, with a cable and a flagpole; the extent is that of the picture.
pub(crate) fn meadow(extent: DVec2, texels_per_px: f64, seed: Seed) -> World {
    let unit = extent.y / 360.0;
    let at = |x: f64, y: f64| extent * DVec2::new(x, y);
    let line = |name: &str, from, to, width: f64| Line {
        name: name.to_owned(),
        from,
        to,
        width_px: width * unit,
    };
    World::paint(extent, texels_per_px, landscape_painter(extent, seed))
        .with_line(
            line("cable", at(0.03, 0.21), at(0.97, 0.13), 4.5),
            hex(0x2a2440),
        )
        .with_line(
            line("pole", at(0.71, 0.055), at(0.85, 0.955), 6.5),
            hex(0xf2ede0),
        )
}

/// Half widths of the road's parts, meters from its middle: lanes, then pavement.
const ROADWAY: f64 = 7.2;
const PAVEMENT: f64 = 9.6;

/// A straight road of four lanes along x, from above, between pavements and grass with trees; y up from its middle line.
///
/// Known features: the middle line, the lane borders at the sides, the kerbs, manhole covers.
pub(crate) fn road(view: View, seed: Seed) -> World {
    let meters = view.extent / view.px_per_m;
    let world = World::paint(view.extent, view.texels_per_px, |p, side| {
        let q = DVec2::new(
            view.corner.x + p.x / view.px_per_m,
            view.corner.y - p.y / view.px_per_m,
        );
        film(road_color(q, side / view.px_per_m, seed), 0.62)
    });
    let (west, east) = (view.corner.x, view.corner.x + meters.x);
    let white = hex(0xdcd8cc);
    let mut world = world;
    for (name, y, width_m, color) in [
        ("middle line", 0.0, 0.20, hex(0xe0b83c)),
        ("upper border line", ROADWAY - 0.45, 0.16, white),
        ("lower border line", 0.45 - ROADWAY, 0.16, white),
    ] {
        let line = view.line(name, (west, y), (east, y), width_m * view.px_per_m);
        world = world.with_line(line, color);
    }
    for index in 0..3 {
        let x = west + meters.x * (0.17 + 0.31 * f64::from(index));
        let y = [-1.8, 5.3, -5.2][index as usize];
        let cover = |q: DVec2| {
            let rim = bar(q.length() - 0.9, 0.07, 0.1);
            let ribs = pulse(q.x * 2.6, 0.5, 0.12) * pulse(q.y * 2.6, 0.5, 0.12);
            hex(0x2e2c2b).lerp(hex(0x6b6660), (0.75 * rim + 0.35 * ribs).min(1.0) as f32)
        };
        world = world.with_disc(
            &format!("manhole {}", index + 1),
            view.disc((x, y), 0.5),
            cover,
        );
    }
    world
}

const SUN: Vec3 = Vec3::new(1.9, 1.6, 1.2);
const SKY: Vec3 = Vec3::new(0.40, 0.50, 0.66);

fn road_color(q: DVec2, footprint: f64, seed: Seed) -> Vec3 {
    let aside = q.y.abs();
    let dirt = fractal(q * DVec2::new(0.12, 0.5), 0.5 * footprint, 5, seed.fork(1));
    let mut light = 1.0;
    let mut color = if aside < ROADWAY {
        let grain = fractal(q / 0.05, footprint / 0.05, 4, seed.fork(2));
        let lane = (q.y / 3.6).rem_euclid(1.0) * 3.6 - 1.8;
        let wheel = smoothstep(0.55, 0.1, (lane.abs() - 0.85).abs());
        let patch = smoothstep(
            0.28,
            0.34,
            fractal(
                q * DVec2::new(0.10, 0.28),
                0.28 * footprint,
                3,
                seed.fork(3),
            ),
        );
        let crack = smoothstep(
            0.02,
            0.0,
            fractal(q * 0.35, 0.35 * footprint, 5, seed.fork(4)).abs(),
        ) * smoothstep(0.0, 0.3, dirt);
        let tone = 1.0 + 0.20 * grain + 0.16 * dirt - 0.10 * wheel - 0.22 * patch - 0.4 * crack;
        let asphalt = hex(0x5f6064) * tone.max(0.2) as f32;
        // the dashed lines between lanes of one direction
        let dash = pulse(q.x / 6.0, 0.5, footprint / 6.0) * bar(aside - 3.6, 0.07, footprint);
        let worn = 0.85 + 0.3 * fractal(q / 0.12, footprint / 0.12, 3, seed.fork(5));
        asphalt.lerp(hex(0xd8d4c8) * worn as f32, 0.9 * dash as f32)
    } else if aside < PAVEMENT {
        let slabs = crate::texture::Masonry {
            length: 0.6,
            height: 0.6,
            joint: 0.02,
            shift: 0.5,
        };
        let stone = slabs.at(q, footprint, seed.fork(6));
        let grain = fractal(q / 0.08, footprint / 0.08, 3, seed.fork(7));
        let kerb = aside < ROADWAY + 0.22;
        let tone = if kerb {
            1.12 * (0.75 + 0.25 * pulse(q.x / 1.0, 0.97, footprint))
        } else {
            (0.72 + 0.28 * stone.face) * (1.0 + 0.09 * stone.tint)
        };
        // the kerb stands above the roadway
        light *= if kerb { 1.05 } else { 1.0 };
        hex(0x98928a) * (tone * (1.0 + 0.08 * grain + 0.12 * dirt)) as f32
    } else {
        // grass() is lit for a low sun on a meadow
        grass(q * 0.9, 0.9 * footprint, seed.fork(8)) * (0.85 + 0.25 * dirt) as f32
    };
    let crown = tree_from_above(q, footprint, seed);
    light *= crown.1;
    color *= SKY + SUN * light as f32;
    if let Some(leaves) = crown.0 {
        color = color.lerp(leaves, 1.0);
    }
    color
}

/// The crown of a tree at a place, and the share of the sun that reaches the ground there.
fn tree_from_above(q: DVec2, footprint: f64, seed: Seed) -> (Option<Vec3>, f64) {
    const PITCH: f64 = 9.5;
    let side = if q.y > 0.0 { 1.0 } else { -1.0 };
    let mut best = (None, 1.0);
    // crowns of 2 m; shadows reach 2.5 m
    let column = (q.x / PITCH).round();
    for step in -1..=1 {
        let index = column as i64 + step;
        let stream = if side > 0.0 { 40 } else { 41 };
        let shift = DVec2::new(
            seed.fork(stream).between(index, 0, 0, -2.2, 2.2),
            seed.fork(stream).between(index, 0, 1, 0.0, 1.2),
        );
        let center = DVec2::new(index as f64 * PITCH + shift.x, side * (11.6 + shift.y));
        let reach = seed.fork(stream).between(index, 0, 2, 1.3, 2.1);
        let density = |p: DVec2| 1.2 * (1.0 - p.distance(center) / reach);
        let fallen = q - DVec2::new(1.5, -1.1);
        let shade = smoothstep(
            -0.05,
            0.25,
            density(fallen) + 0.25 * fractal(fallen, footprint, 3, seed.fork(42)),
        );
        best.1 = f64::min(best.1, 1.0 - 0.85 * shade);
        let leaves = foliage(q, footprint, 0.34, density, seed.fork(43));
        if leaves.cover > 0.5 {
            let lit = 0.35 + 0.75 * leaves.height
                - 0.10 * (q - center).dot(DVec2::new(0.8, -0.6)) / reach;
            let green = hex(0x2f5a22).lerp(hex(0xa3b63c), (0.2 + 0.6 * leaves.tint) as f32);
            best.0 = Some(green * (1.5 * lit.max(0.1)) as f32);
        }
    }
    best
}

/// A brick wall in the shade of a tree, with posters; x to the right, y up, meters.
///
/// Known features: the corners of the posters, a pipe and a cable.
pub(crate) fn wall(view: View, posters: &[(DVec2, DVec2)], seed: Seed) -> World {
    let arts: Vec<Art> = posters
        .iter()
        .enumerate()
        .map(|(index, &(low, high))| Art::new(index, low, high, seed.fork(60 + index as u64)))
        .collect();
    let shade_from = view.corner - DVec2::new(0.0, view.extent.y / view.px_per_m);
    let world = World::paint(view.extent, view.texels_per_px, |p, side| {
        let q = DVec2::new(
            view.corner.x + p.x / view.px_per_m,
            view.corner.y - p.y / view.px_per_m,
        );
        let footprint = side / view.px_per_m;
        let found = arts.iter().rev().find(|art| art.contains(q));
        let color = found.map_or_else(
            || {
                let stain = fractal(q * 0.5, 0.5 * footprint, 5, seed.fork(2));
                brick(q, footprint, hex(0x8e4c3c), seed.fork(3)) * (1.0 + 0.22 * stain) as f32
            },
            |art| art.color(q, footprint),
        );
        let near = arts.iter().map(|art| art.shadow(q)).fold(1.0, f64::min);
        let sun = near
            * (0.25
                + 0.75 * leaf_shade((q - shade_from) * 0.8 + 1.5, 0.8 * footprint, seed.fork(4)));
        film(color * (SUN * sun as f32 * 0.8 + SKY), 0.66)
    });
    let meters = view.extent / view.px_per_m;
    let (left, top) = (view.corner.x, view.corner.y);
    let right = left + meters.x;
    let thick = 0.035 * view.px_per_m;
    let cable = view.line(
        "cable",
        (left, top - 0.10 * meters.y),
        (right, top - 0.05 * meters.y),
        thick,
    );
    let pipe = view.line(
        "pipe",
        (left, top - 0.94 * meters.y),
        (right, top - 0.94 * meters.y),
        2.2 * thick,
    );
    let mut world = world
        .with_line(cable, hex(0x1b1b1f))
        .with_line(pipe, hex(0x8f9698));
    for art in &arts {
        world.features.quads.push(Quad {
            name: format!("poster {}", art.index + 1),
            corners: [
                view.world(art.low.x, art.high.y),
                view.world(art.high.x, art.high.y),
                view.world(art.high.x, art.low.y),
                view.world(art.low.x, art.low.y),
            ],
        });
    }
    world
}

/// A printed poster.
struct Art {
    index: usize,
    low: DVec2,
    high: DVec2,
    letters: Strokes,
    seed: Seed,
}

impl Art {
    fn new(index: usize, low: DVec2, high: DVec2, seed: Seed) -> Self {
        let text = ["RAVEC", "JAZZ", "EXPO 26", "CIRCUS"][index % 4];
        let extent = high - low;
        let scale =
            (0.72 * extent.x / glyph::text_width(text)).min(0.14 * extent.y / glyph::HEIGHT);
        let left = low.x + 0.5 * (extent.x - scale * glyph::text_width(text));
        let base = low.y + 0.075 * extent.y + scale * glyph::HEIGHT;
        let strokes = glyph::polylines(text).into_iter().map(|points| Stroke {
            points: points
                .iter()
                .map(|p| DVec2::new(left + scale * p.x, base - scale * p.y))
                .collect(),
            width: 0.95 * scale,
        });
        Self {
            index,
            low,
            high,
            letters: Strokes::new(strokes),
            seed,
        }
    }

    fn contains(&self, q: DVec2) -> bool {
        q.cmpge(self.low).all() && q.cmple(self.high).all()
    }

    /// Share of the sun beside the poster, which stands a little off the wall.
    fn shadow(&self, q: DVec2) -> f64 {
        if self.contains(q) {
            return 1.0;
        }
        let outside = (self.low - q).max(q - self.high).max(DVec2::ZERO).length();
        1.0 - 0.45 * smoothstep(0.05, 0.0, outside)
    }

    fn color(&self, q: DVec2, footprint: f64) -> Vec3 {
        let extent = self.high - self.low;
        let unit = extent.min_element();
        let border = (q - self.low).min(self.high - q).min_element();
        let p = (q - 0.5 * (self.low + self.high)) / unit;
        let fp = footprint / unit;
        let tall = 0.5 * extent.y / unit;
        let print = match self.index % 3 {
            0 => mountains(p, fp, tall, self.seed),
            1 => records(p, fp, self.seed),
            _ => rays(p, fp, self.seed),
        };
        let paper = hex(0xf1ebdc) * (1.0 + 0.03 * fractal(p * 9.0, 9.0 * fp, 3, self.seed)) as f32;
        let panel = above(self.low.y + 0.27 * extent.y, q.y, footprint);
        let print = print.lerp(paper, panel as f32);
        let ink = self.letters.soft_coverage(q, footprint);
        let print = print.lerp(hex(0x1f2a3a), ink as f32);
        paper.lerp(print, above(border, 0.045 * unit, footprint) as f32)
    }
}

/// Ridges before a low sun, and their mirror image in a lake.
fn mountains(p: DVec2, fp: f64, tall: f64, seed: Seed) -> Vec3 {
    let shore = -0.12 * tall;
    let up = (p.y - shore).abs();
    let sun = DVec2::new(0.12, 0.32);
    let reach = DVec2::new(p.x, up).distance(sun);
    let ring = pulse(reach / 0.075, 0.6, fp / 0.075);
    let glow = hex(0xf6c66a).lerp(hex(0x2c7f8c), smoothstep(0.0, 0.75, up) as f32);
    let mut color = glow.lerp(glow * 1.25, (0.5 * ring * above(0.5, reach, fp)) as f32);
    color = color.lerp(hex(0xfbe9b0), above(0.14, reach, fp) as f32);
    for ridge in 0..4 {
        let k = f64::from(ridge);
        let profile = fractal(
            DVec2::new(p.x * (2.2 + 1.1 * k), 7.0 * k),
            fp,
            6,
            seed.fork(ridge as u64),
        );
        let height = 0.36 - 0.095 * k + 0.16 * profile;
        let tone = [0x8c5a76, 0x5d4a72, 0x3a3c62, 0x222d48][ridge as usize];
        color = color.lerp(hex(tone), above(height, up, fp) as f32);
    }
    if p.y < shore {
        let ripple = pulse((p.y + 0.01 * (23.0 * p.x).sin()) / 0.034, 0.5, fp / 0.034);
        color *= (0.72 + 0.2 * ripple) as f32;
    }
    color
}

/// A record with its grooves.
fn records(p: DVec2, fp: f64, seed: Seed) -> Vec3 {
    let center = DVec2::new(0.05, 0.18);
    let reach = p.distance(center);
    let turn = (p - center).to_angle();
    let shine = 0.5 + 0.5 * (2.0 * turn + 0.6).cos();
    let groove = pulse(reach / 0.022, 0.5, fp / 0.022);
    let vinyl = hex(0x23232b) * (1.0 + 0.9 * shine.powi(3) + 0.4 * groove) as f32;
    let speck = fractal(p * 11.0, 11.0 * fp, 4, seed);
    let ground = hex(0xe3ae3a) * (1.0 + 0.10 * speck) as f32;
    let stripe = pulse((p.x + p.y) / 0.17, 0.5, fp / 0.17);
    let ground = ground.lerp(hex(0xc9562e), stripe as f32);
    let color = ground.lerp(vinyl, above(0.36, reach, fp) as f32);
    let label = hex(0xc33a34).lerp(hex(0xf0e6cc), bar(reach - 0.09, 0.012, fp) as f32);
    let color = color.lerp(label, above(0.13, reach, fp) as f32);
    color.lerp(hex(0x1a1a1e), above(0.02, reach, fp) as f32)
}

/// Rays around a star.
fn rays(p: DVec2, fp: f64, seed: Seed) -> Vec3 {
    let center = DVec2::new(0.0, 0.15);
    let reach = p.distance(center).max(1e-6);
    let turn = (p - center).to_angle() / std::f64::consts::TAU * 14.0;
    let ray = pulse(turn, 0.5, 14.0 * fp / (reach * std::f64::consts::TAU));
    let cloud = fractal(p * 5.0, 5.0 * fp, 4, seed);
    let color = hex(0x1f6f78).lerp(hex(0xe9dcb8), ray as f32) * (1.0 + 0.1 * cloud) as f32;
    let wave = 0.22 + 0.03 * (turn * std::f64::consts::TAU * 8.0 / 14.0).sin();
    let color = color.lerp(hex(0xc23b2e), above(wave, reach, fp) as f32);
    color.lerp(hex(0xf4e6b0), above(0.12, reach, fp) as f32)
}
