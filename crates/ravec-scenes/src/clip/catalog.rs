//! Ready-made clips by name, at any size and length.

use crate::clip::camera::Camera;
use crate::clip::figure::Figure;
use crate::clip::light::Light;
use crate::clip::sets::{View, meadow, road, row, street_picture, wall};
use crate::clip::shape::{Body, Shape, ball, beach_ball, car, leaf, star, wooden_crate};
use crate::clip::track::Track;
use crate::clip::world::World;
use crate::clip::{Clip, RATE_HZ, Shot};
use crate::random::Seed;
use glam::DVec2;
use ravec_raster::Size;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use std::sync::Arc;

/// A clip of the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClipId {
    /// A ball that moves before a meadow with two straight lines; the camera stands still.
    StillDisc,
    /// A pan along a row of houses.
    PanStreet,
    /// A zoom towards a house.
    ZoomFacade,
    /// Hand-held before shop fronts.
    HandheldWall,
    /// A person with loose hair who walks past a shop.
    Walker,
    /// Cars on a road, from above.
    Cars,
    /// Three shots with different cameras.
    Cuts,
    /// A poster under strong perspective, that leaves the picture and comes back.
    Poster,
}

impl ClipId {
    /// All clips.
    pub const ALL: [Self; 8] = [
        Self::StillDisc,
        Self::PanStreet,
        Self::ZoomFacade,
        Self::HandheldWall,
        Self::Walker,
        Self::Cars,
        Self::Cuts,
        Self::Poster,
    ];

    fn entry(self) -> (&'static str, &'static str) {
        match self {
            Self::StillDisc => (
                "still-disc",
                "clip: a ball moves before a meadow with two straight lines",
            ),
            Self::PanStreet => ("pan-street", "clip: a pan along a row of houses"),
            Self::ZoomFacade => ("zoom-facade", "clip: a zoom towards a house front"),
            Self::HandheldWall => (
                "handheld-wall",
                "clip: shop fronts filmed from the hand, in changing light",
            ),
            Self::Walker => ("walker", "clip: a person with loose hair walks past a shop"),
            Self::Cars => ("cars", "clip: cars on a road from above"),
            Self::Cuts => ("cuts", "clip: three shots with different cameras"),
            Self::Poster => (
                "poster",
                "clip: a poster under strong perspective, gone for a while and hidden in part",
            ),
        }
    }

    /// The name that selects the clip.
    pub fn name(self) -> &'static str {
        self.entry().0
    }

    /// The clip of a name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|id| id.name() == name)
    }

    /// One line about the clip.
    pub fn description(self) -> &'static str {
        self.entry().1
    }

    /// The size at which the clip shows what it is for.
    ///
    /// # Panics
    /// Never: the size is valid.
    pub fn default_size(self) -> Size {
        Size::new(640, 360).expect("640 × 360 is small and not zero")
    }

    /// The number of frames of the clip in the documentation: two seconds.
    pub fn default_frames(self) -> usize {
        50
    }
}

/// Makes a clip of `frames` frames (at least 1) in the caller's thread pool: paints its planes, in seconds. Equal arguments
/// give equal frames.
pub fn clip(id: ClipId, size: Size, frames: usize, seed: Seed) -> Clip {
    let stage = Stage {
        size,
        extent: DVec2::new(size.width() as f64, size.height() as f64),
        frames: frames.max(1),
        seed,
    };
    let shots = match id {
        ClipId::StillDisc => vec![stage.still_disc()],
        ClipId::PanStreet => vec![stage.pan_street()],
        ClipId::ZoomFacade => vec![stage.zoom_facade()],
        ClipId::HandheldWall => vec![stage.handheld_wall()],
        ClipId::Walker => vec![stage.walker()],
        ClipId::Cars => vec![stage.cars()],
        ClipId::Cuts => stage.cuts(),
        ClipId::Poster => vec![stage.poster()],
    };
    Clip {
        name: id.name(),
        size,
        seed,
        shots,
        noise_sigma: 0.0,
        shutter: 0.0,
    }
}

/// Data that all shots of a clip share.
#[derive(Clone, Copy)]
struct Stage {
    size: Size,
    extent: DVec2,
    frames: usize,
    seed: Seed,
}

/// Texels a world pixel for cameras at zoom 1: a little finer than the frame, so that texture stays crisp.
const DENSITY: f64 = 1.3;

fn linear(from: f64, to: f64) -> Track {
    Track::Linear { from, to }
}

fn eased(from: f64, to: f64) -> Track {
    Track::Eased { from, to }
}

fn wave(mean: f64, amplitude: f64, period_secs: f64, phase_rad: f64) -> Track {
    Track::Wave {
        mean,
        amplitude,
        period_secs,
        phase_rad,
    }
}

impl Stage {
    fn shot(&self, world: World, camera: Camera, shapes: Vec<Shape>) -> Shot {
        Shot {
            first: 0,
            frames: self.frames,
            world: Arc::new(world),
            camera,
            shapes,
            light: Light::default(),
        }
    }

    /// A point given as shares of the frame.
    fn at(&self, x: f64, y: f64) -> DVec2 {
        self.extent * DVec2::new(x, y)
    }

    fn secs(&self) -> f64 {
        self.frames as f64 / RATE_HZ
    }

    /// A view of a set whose frame is `meters` high at zoom 1; `frames` is the extent in frames.
    fn view(&self, corner: (f64, f64), meters: f64, frames: DVec2, density: f64) -> View {
        View {
            corner: corner.into(),
            px_per_m: self.extent.y / meters,
            extent: self.extent * frames,
            texels_per_px: density,
        }
    }

    /// The motion of a hand; `strength` 1 is a calm one.
    fn hand(&self, deviation: f64, stream: u64) -> Track {
        Track::Shake {
            deviation,
            low_hz: 0.4,
            high_hz: 3.5,
            seed: self.seed.fork(900 + stream),
        }
    }

    fn handheld(&self, look: DVec2, strength: f64) -> Camera {
        let add = |value: f64, deviation: f64, stream: u64| {
            Track::Constant(value).plus(self.hand(strength * deviation, stream))
        };
        Camera {
            look: [
                add(look.x, 0.011 * self.extent.x, 0),
                add(look.y, 0.011 * self.extent.y, 1),
            ],
            zoom: add(1.0, 0.008, 2),
            roll_rad: self.hand(0.008 * strength, 3),
            pitch_rad: self.hand(0.022 * strength, 4),
            yaw_rad: self.hand(0.030 * strength, 5),
            ..Camera::still(look, self.size)
        }
    }

    fn person(&self, stride_secs: f64, coat: u32, hair: u32) -> Body {
        Body::Figure(Box::new(Figure {
            stride_secs,
            coat,
            trousers: 0x2c3446,
            hair,
            seed: self.seed.fork(70),
        }))
    }

    fn still_disc(&self) -> Shot {
        let world = meadow(self.extent, DENSITY, self.seed);
        let radius = 0.14 * self.extent.y;
        let path = (self.at(0.17, 0.56), self.at(0.52, 0.56));
        let disc = Shape::at("ball", ball(radius, 0xd02c22), path.0)
            .moving(linear(path.0.x, path.1.x), Track::Constant(path.0.y));
        self.shot(
            world,
            Camera::still(self.at(0.5, 0.5), self.size),
            vec![disc],
        )
    }

    fn pan_street(&self) -> Shot {
        let view = self.view((3.0, 10.1), 11.0, DVec2::new(3.0, 1.0), DENSITY);
        let world = row(view, self.seed);
        let mut camera = Camera::still(self.at(0.5, 0.5), self.size);
        camera.look[0] = eased(0.5 * self.extent.x, 2.5 * self.extent.x);
        let walk = |name: &str, body: Body, from: f64, to: f64| {
            let (start, end) = (view.world(from, -0.42), view.world(to, -0.42));
            let shape = Shape::at(name, body, start);
            Shape {
                scale: Track::Constant(1.74 * view.px_per_m),
                ..shape.moving(linear(start.x, end.x), Track::Constant(start.y))
            }
        };
        let people = vec![
            walk(
                "first walker",
                self.person(1.05, 0x9c3b34, 0x3a2415),
                8.0,
                14.0,
            ),
            walk(
                "second walker",
                self.person(0.95, 0x2f6f78, 0xa8742c),
                30.0,
                37.0,
            ),
            walk(
                "third walker",
                self.person(1.0, 0xc09a48, 0x241a16),
                46.0,
                52.0,
            ),
        ];
        self.shot(world, camera, people)
    }

    fn zoom_facade(&self) -> Shot {
        const ZOOM: f64 = 2.4;
        let view = self.view((16.0, 10.3), 11.2, DVec2::ONE, ZOOM);
        let world = row(view, self.seed);
        let mut camera = Camera::still(self.at(0.5, 0.5), self.size);
        camera.zoom = eased(1.0, ZOOM);
        let target = self.at(0.56, 0.52);
        camera.look = [
            eased(0.5 * self.extent.x, target.x),
            eased(0.5 * self.extent.y, target.y),
        ];
        self.shot(world, camera, Vec::new())
    }

    fn handheld_wall(&self) -> Shot {
        let view = self.view((1.6, 6.9), 6.0, DVec2::splat(1.32), DENSITY);
        let world = row(view, self.seed);
        let middle = 0.66 * self.extent;
        let radius = 0.26 * view.px_per_m;
        let from = view.world(2.4, 0.6);
        let to = view.world(14.0, 0.6);
        let hop = wave(from.y, 0.9 * view.px_per_m, 1.3, 0.5 * PI);
        let toy = Shape::at("beach ball", beach_ball(radius), from)
            .moving(linear(from.x, to.x), hop)
            .turning(linear(0.0, 0.5 * (to.x - from.x) / radius));
        let mut shot = self.shot(world, self.handheld(middle, 1.0), vec![toy]);
        shot.light.gain = wave(0.94, 0.06, 3.0, 0.0).plus(wave(0.0, 0.012, 0.17, 0.0));
        shot.light.offset = wave(0.003, 0.003, 2.3, 1.0);
        shot
    }

    fn walker(&self) -> Shot {
        let view = self.view((10.6, 2.98), 2.9, DVec2::ONE, DENSITY);
        let world = row(view, self.seed);
        let scale = 1.13 * self.extent.y;
        let (from, to) = (-0.02 * self.extent.x, 1.04 * self.extent.x);
        // two steps carry the person four fifths of the height
        let strides = (to - from) / (0.8 * scale);
        let stride_secs = (self.secs() / strides).clamp(0.7, 1.8);
        let person = Shape::at(
            "walker",
            self.person(stride_secs, 0x2d5f8c, 0x6a3c1c),
            DVec2::ZERO,
        )
        .moving(linear(from, to), Track::Constant(1.165 * self.extent.y));
        let person = Shape {
            scale: Track::Constant(scale),
            ..person
        };
        self.shot(
            world,
            Camera::still(self.at(0.5, 0.5), self.size),
            vec![person],
        )
    }

    fn cars(&self) -> Shot {
        const HEIGHT_M: f64 = 25.0;
        let view = self.view((0.0, 0.5 * HEIGHT_M), HEIGHT_M, DVec2::ONE, DENSITY);
        let world = road(view, self.seed);
        let wide = self.extent.x;
        // lane, color, path, and whether the car comes from the right
        let traffic = [
            (
                "red car",
                -1.8,
                0xb02a24,
                linear(0.10 * wide, 0.72 * wide),
                false,
            ),
            (
                "white car",
                -5.4,
                0xd9d8d2,
                Track::Accelerated {
                    from: 0.30 * wide,
                    to: 1.15 * wide,
                },
                false,
            ),
            (
                "blue car",
                -5.4,
                0x28508c,
                eased(-0.12 * wide, 0.36 * wide),
                false,
            ),
            (
                "yellow car",
                1.8,
                0xd8a526,
                linear(0.95 * wide, 0.05 * wide),
                true,
            ),
            (
                "green car",
                5.4,
                0x3c6e4c,
                eased(0.62 * wide, 0.30 * wide),
                true,
            ),
            (
                "gray car",
                5.4,
                0x6c7076,
                Track::Accelerated {
                    from: 1.12 * wide,
                    to: 0.74 * wide,
                },
                true,
            ),
        ];
        let cars = traffic.map(|(name, lane, color, x, back)| {
            let y = view.world(0.0, lane).y;
            let half = view.px_per_m * DVec2::new(2.25, 0.93);
            let fall = view.px_per_m * DVec2::new(0.38, 0.30);
            let shadow = if back { -fall } else { fall };
            let shape = Shape::at(name, car(half, color, shadow), DVec2::ZERO)
                .moving(x, wave(y, 0.12 * view.px_per_m, 2.9, lane));
            shape.turning(Track::Constant(if back { PI } else { 0.0 }))
        });
        self.shot(
            world,
            Camera::still(self.at(0.5, 0.5), self.size),
            cars.into(),
        )
    }

    fn cuts(&self) -> Vec<Shot> {
        // thirds; a shot without a frame is left out
        let borders: Vec<usize> = (0..=3).map(|i| i * self.frames / 3).collect();
        let mut shots = Vec::new();
        for (number, pair) in borders.windows(2).enumerate() {
            let part = Self {
                frames: pair[1] - pair[0],
                ..*self
            };
            if part.frames == 0 {
                continue;
            }
            let mut shot = match number {
                0 => part.cut_pan(),
                1 => part.cut_zoom(),
                _ => part.cut_handheld(),
            };
            shot.first = pair[0];
            shots.push(shot);
        }
        shots
    }

    fn cut_pan(&self) -> Shot {
        let view = self.view((40.0, 9.0), 9.8, DVec2::new(1.5, 1.0), DENSITY);
        let mut camera = Camera::still(self.at(0.5, 0.5), self.size);
        camera.look[0] = linear(self.extent.x, 0.5 * self.extent.x);
        let mut shot = self.shot(row(view, self.seed), camera, Vec::new());
        shot.light.fade_in = self.frames / 4;
        shot
    }

    fn cut_zoom(&self) -> Shot {
        let world = street_picture(self.extent, 1.6, self.seed);
        let mut camera = Camera::still(self.at(0.5, 0.5), self.size);
        camera.zoom = linear(1.0, 1.5);
        camera.look[1] = linear(0.5 * self.extent.y, 0.54 * self.extent.y);
        let place = self.at(0.40, 0.99);
        let walker = Shape {
            scale: Track::Constant(0.46 * self.extent.y),
            ..Shape::at("walker", self.person(1.0, 0xb8862e, 0x2c1c14), place).moving(
                linear(place.x, 0.62 * self.extent.x),
                Track::Constant(place.y - 0.05 * self.extent.y),
            )
        };
        let mut shot = self.shot(world, camera, vec![walker]);
        shot.light.gain = wave(0.95, 0.05, 1.4, 0.0);
        shot
    }

    fn cut_handheld(&self) -> Shot {
        let frames = DVec2::splat(1.3);
        let world = meadow(self.extent * frames, DENSITY, self.seed.fork(3));
        let middle = 0.5 * frames * self.extent;
        let place = middle + self.at(-0.1, 0.16);
        let crate_half = self.extent.y * DVec2::new(0.11, 0.09);
        let crate_ = Shape::at("crate", wooden_crate(crate_half, self.seed.fork(4)), place);
        let radius = 0.10 * self.extent.y;
        let kite = Shape::at("star", star(radius, 0xe0a82c), DVec2::ZERO)
            .moving(
                linear(
                    middle.x + 0.34 * self.extent.x,
                    middle.x - 0.2 * self.extent.x,
                ),
                wave(
                    middle.y - 0.2 * self.extent.y,
                    0.06 * self.extent.y,
                    1.6,
                    0.0,
                ),
            )
            .turning(wave(0.0, 0.6, 1.9, 0.0));
        let mut shot = self.shot(world, self.handheld(middle, 1.0), vec![crate_, kite]);
        shot.light.fade_out = self.frames / 4;
        shot
    }

    fn poster(&self) -> Shot {
        const HEIGHT_M: f64 = 2.6;
        let frames = DVec2::new(4.0, 2.9);
        let top = 0.5 * frames.y * HEIGHT_M;
        let view = self.view((0.0, top), HEIGHT_M, frames, DENSITY);
        let meters = view.extent / view.px_per_m;
        let middle = DVec2::new(0.36 * meters.x, 0.0);
        let on_wall = |x: f64, y: f64, half: DVec2| {
            let center = middle + DVec2::new(x, y);
            (center - half, center + half)
        };
        let posters = [
            on_wall(0.0, 0.0, DVec2::new(1.08, 0.76)),
            on_wall(-2.0, 0.15, DVec2::new(0.42, 0.58)),
            on_wall(4.4, -0.1, DVec2::new(0.5, 0.7)),
        ];
        let world = wall(view, &posters, self.seed);
        let look = view.world(middle.x, middle.y);
        let turn = |amplitude: f64, period_secs: f64, phase_rad: f64| {
            wave(0.0, amplitude, period_secs, phase_rad)
        };
        let camera = Camera {
            look: [
                Track::Excursion {
                    rest: look.x,
                    away: look.x + 1.3 * self.extent.x,
                },
                Track::Constant(look.y),
            ],
            zoom: wave(0.98, 0.10, 2.6, 1.0),
            roll_rad: turn(0.10, 3.1, 0.3),
            pitch_rad: turn(0.26, 2.3, 0.0),
            yaw_rad: turn(0.46, 1.9, 2.6),
            ..Camera::still(look, self.size)
        };
        let start = view.world(middle.x - 1.9, -1.32);
        let end = view.world(middle.x + 1.7, -1.32);
        let passer = Shape {
            scale: Track::Constant(1.72 * view.px_per_m),
            ..Shape::at("passer-by", self.person(1.0, 0x56744a, 0x2a1a12), start)
                .moving(linear(start.x, end.x), Track::Constant(start.y))
        };
        let size = 0.16 * view.px_per_m;
        let from = view.world(middle.x + 0.9, 1.0);
        let falling = Shape::at("leaf", leaf(size, self.seed.fork(5)), from)
            .moving(
                linear(from.x, from.x - 1.2 * view.px_per_m),
                linear(from.y, from.y + 1.9 * view.px_per_m),
            )
            .turning(linear(0.0, 7.0));
        self.shot(world, camera, vec![passer, falling])
    }
}

#[cfg(test)]
mod tests;
