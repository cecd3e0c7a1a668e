//! Moving shapes: an outline with a surface, and a path over the time of a shot.
//!
//! A shape is a stack of parts, each a polygon in the shape's own coordinates; the first lies at the back. The shape moves
//! over the world plane, so that a camera that moves or turns sees it as it sees the background.

use crate::clip::camera::project;
use crate::clip::coat::Coat;
use crate::clip::figure::Figure;
use crate::clip::ring::disc_ring;
use crate::clip::track::{Moment, Track};
use crate::paint::hex;
use crate::random::Seed;
use glam::{DMat3, DVec2, Vec3};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// One polygon of a shape.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// Corners in the shape's coordinates.
    pub ring: Vec<DVec2>,
    pub coat: Coat,
    /// Alpha where the polygon covers a pixel.
    pub opacity: f64,
    /// False for shadows and hair, which the outline of the shape leaves out.
    pub outline: bool,
}

impl Part {
    pub(crate) fn solid(ring: Vec<DVec2>, coat: Coat) -> Self {
        Self {
            ring,
            coat,
            opacity: 1.0,
            outline: true,
        }
    }

    pub(crate) fn flat(ring: Vec<DVec2>, color: u32) -> Self {
        Self::solid(ring, Coat::Flat(hex(color)))
    }

    /// Drawn on top of other parts of the same shape: it adds nothing to the outline.
    pub(crate) fn detail(self) -> Self {
        Self {
            outline: false,
            ..self
        }
    }

    pub(crate) fn faint(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }
}

/// The parts of a shape.
#[derive(Debug, Clone)]
pub(crate) enum Body {
    /// A disc around the origin: its radius and its surface.
    Disc(f64, Vec<Part>),
    /// Parts that keep their places.
    Rigid(Vec<Part>),
    /// A person who walks.
    Figure(Box<Figure>),
}

/// A shape over the time of a shot.
#[derive(Debug, Clone)]
pub(crate) struct Shape {
    pub name: String,
    pub body: Body,
    /// World point of the shape's origin.
    pub position: [Track; 2],
    /// Turn about the origin, clockwise.
    pub angle_rad: Track,
    /// World pixels per unit of the shape's coordinates.
    pub scale: Track,
}

impl Shape {
    /// A shape that stands at a place of the world, unturned, at scale 1.
    pub(crate) fn at(name: &str, body: Body, place: DVec2) -> Self {
        Self {
            name: name.to_owned(),
            body,
            position: [Track::Constant(place.x), Track::Constant(place.y)],
            angle_rad: Track::Constant(0.0),
            scale: Track::Constant(1.0),
        }
    }

    pub(crate) fn moving(self, x: Track, y: Track) -> Self {
        Self {
            position: [x, y],
            ..self
        }
    }

    pub(crate) fn turning(self, angle_rad: Track) -> Self {
        Self { angle_rad, ..self }
    }

    pub(crate) fn world_from_shape(&self, moment: Moment) -> DMat3 {
        let place = DVec2::new(self.position[0].at(moment), self.position[1].at(moment));
        DMat3::from_scale_angle_translation(
            DVec2::splat(self.scale.at(moment)),
            self.angle_rad.at(moment),
            place,
        )
    }

    pub(crate) fn parts(&self, moment: Moment) -> Cow<'_, [Part]> {
        match &self.body {
            Body::Disc(_, parts) | Body::Rigid(parts) => Cow::Borrowed(parts),
            Body::Figure(figure) => Cow::Owned(figure.parts(moment.secs)),
        }
    }

    pub(crate) fn truth(&self, frame_from_world: &DMat3, moment: Moment) -> ShapeTruth {
        let frame_from_shape = *frame_from_world * self.world_from_shape(moment);
        let outlines = self
            .parts(moment)
            .iter()
            .filter(|part| part.outline)
            .filter_map(|part| ring_in_frame(&frame_from_shape, &part.ring))
            .collect();
        let disc = match self.body {
            Body::Disc(radius, _) => disc_in_frame(&frame_from_shape, DVec2::ZERO, radius),
            _ => None,
        };
        ShapeTruth {
            name: self.name.clone(),
            frame_from_shape,
            disc,
            outlines,
        }
    }
}

/// The place of a moving shape in a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShapeTruth {
    /// Its name, the same in all frames.
    pub name: String,
    /// Maps (x, y, 1) in the shape's own coordinates to the frame; serialized column by column.
    pub frame_from_shape: DMat3,
    /// Center and radius, for a disc whose image is a disc.
    pub disc: Option<Disc>,
    /// Polygons in frame coordinates whose union is the shape, without shadows and loose hair. Parts behind the camera are
    /// left out; parts outside the frame are not.
    pub outlines: Vec<Vec<DVec2>>,
}

/// A disc.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Disc {
    /// Its center.
    pub center: DVec2,
    /// Its radius.
    pub radius_px: f64,
}

/// The image of a polygon, unless a corner lies behind the camera.
pub(crate) fn ring_in_frame(m: &DMat3, ring: &[DVec2]) -> Option<Vec<DVec2>> {
    ring.iter().map(|&p| project(m, p)).collect()
}

/// The image of a disc, if it is a disc: under a similarity.
pub(crate) fn disc_in_frame(m: &DMat3, center: DVec2, radius: f64) -> Option<Disc> {
    let (x, y) = (m.x_axis / m.z_axis.z, m.y_axis / m.z_axis.z);
    let (right, down) = (x.truncate(), y.truncate());
    let scale = right.length();
    let bent = radius * (x.z.abs() + y.z.abs());
    let skewed = (right.perp() - down).length() / scale;
    // a thousandth of a pixel at a radius of 1000
    (bent < 1e-9 && skewed < 1e-6).then_some(())?;
    Some(Disc {
        center: project(m, center)?,
        radius_px: radius * scale,
    })
}

/// A rounded rectangle around the origin: `|x/a|⁴ + |y/b|⁴ = 1`.
pub(crate) fn rounded_box(half: DVec2) -> Vec<DVec2> {
    const CORNERS: usize = 48;
    (0..CORNERS)
        .map(|i| {
            let d = DVec2::from_angle(std::f64::consts::TAU * i as f64 / CORNERS as f64);
            half * DVec2::new(
                d.x.abs().sqrt().copysign(d.x),
                d.y.abs().sqrt().copysign(d.y),
            )
        })
        .collect()
}

/// A rectangle by its lower and upper corner.
pub(crate) fn rectangle(low: DVec2, high: DVec2) -> Vec<DVec2> {
    vec![
        low,
        DVec2::new(high.x, low.y),
        high,
        DVec2::new(low.x, high.y),
    ]
}

/// A ball.
pub(crate) fn ball(radius: f64, color: u32) -> Body {
    let coat = Coat::Ball {
        color: hex(color),
        radius,
    };
    Body::Disc(
        radius,
        vec![Part::solid(disc_ring(DVec2::ZERO, radius), coat)],
    )
}

/// A beach ball, whose panels show how it turns.
pub(crate) fn beach_ball(radius: f64) -> Body {
    let coat = Coat::Panels {
        colors: [hex(0xd8382c), hex(0xf3c33b), hex(0x2a6fb0)],
        radius,
    };
    Body::Disc(
        radius,
        vec![Part::solid(disc_ring(DVec2::ZERO, radius), coat)],
    )
}

/// A wooden crate.
pub(crate) fn wooden_crate(half: DVec2, seed: Seed) -> Body {
    Body::Rigid(vec![Part::solid(
        rectangle(-half, half),
        Coat::Crate { half, seed },
    )])
}

/// A star with five points.
pub(crate) fn star(radius: f64, color: u32) -> Body {
    let turn = std::f64::consts::TAU / 10.0;
    let ring = (0..10)
        .map(|i| {
            let reach = if i % 2 == 0 { radius } else { 0.46 * radius };
            reach * DVec2::from_angle(turn * f64::from(i) - 0.25 * std::f64::consts::TAU)
        })
        .collect();
    let coat = Coat::Ball {
        color: hex(color),
        radius: 1.3 * radius,
    };
    Body::Rigid(vec![Part::solid(ring, coat)])
}

/// A leaf: the intersection of two discs, along x.
pub(crate) fn leaf(half_length: f64, seed: Seed) -> Body {
    const HALF: i32 = 24;
    let reach = 0.36 * half_length;
    let side = |sign: f64| {
        (0..HALF).map(move |i| {
            let x = 1.0 - 2.0 * f64::from(i) / f64::from(HALF);
            half_length * DVec2::new(sign * x, 0.0) + DVec2::new(0.0, sign * reach * (1.0 - x * x))
        })
    };
    let ring = side(1.0).chain(side(-1.0)).collect();
    let stalk = rectangle(
        DVec2::new(-1.35 * half_length, -0.022 * half_length),
        DVec2::new(-0.9 * half_length, 0.022 * half_length),
    );
    Body::Rigid(vec![
        Part::flat(stalk, 0x7d6a34),
        Part::solid(ring, Coat::Leaf { half_length, seed }),
    ])
}

/// A car seen from above, its front towards x; `shadow` is where its shadow falls, in its own coordinates.
pub(crate) fn car(half: DVec2, color: u32, shadow: DVec2) -> Body {
    let (l, w) = (half.x, half.y);
    let mut parts: Vec<Part> = (0..5)
        .map(|i| {
            let grown = half * (1.0 + 0.035 * (2.0 - f64::from(i)));
            let ring = rounded_box(grown).iter().map(|p| *p + shadow).collect();
            Part::flat(ring, 0x0c0e14).detail().faint(0.17)
        })
        .collect();
    let wheel = |x: f64, y: f64| {
        let c = DVec2::new(x * l, y * w);
        Part::flat(
            rectangle(c - 0.1 * DVec2::new(l, w), c + 0.1 * DVec2::new(l, w)),
            0x15161a,
        )
    };
    for (x, y) in [(0.6, -0.93), (0.6, 0.93), (-0.6, -0.93), (-0.6, 0.93)] {
        parts.push(wheel(x, y));
    }
    let paint = |color: u32| Coat::Paint {
        color: hex(color),
        half_width: w,
    };
    parts.push(Part::solid(rounded_box(half), paint(color)));
    let quad = |points: [(f64, f64); 4]| points.map(|(x, y)| DVec2::new(x * l, y * w)).to_vec();
    let glass = 0x1b2630;
    let detail = |points, color| Part::flat(quad(points), color).detail();
    parts.extend([
        // windscreen, rear window, side windows
        detail(
            [(0.40, -0.74), (0.40, 0.74), (0.14, 0.62), (0.14, -0.62)],
            glass,
        ),
        detail(
            [(-0.52, -0.60), (-0.52, 0.60), (-0.74, 0.70), (-0.74, -0.70)],
            glass,
        ),
        detail(
            [(0.32, -0.82), (0.10, -0.70), (-0.50, -0.70), (-0.66, -0.82)],
            0x26323c,
        ),
        detail(
            [(0.32, 0.82), (0.10, 0.70), (-0.50, 0.70), (-0.66, 0.82)],
            0x26323c,
        ),
        detail(
            [(0.37, -0.60), (0.37, -0.20), (0.17, -0.16), (0.17, -0.50)],
            0x4c6474,
        ),
        // head lamps, tail lamps
        detail(
            [(0.97, -0.80), (0.97, -0.48), (0.88, -0.46), (0.86, -0.84)],
            0xf4f0dc,
        ),
        detail(
            [(0.97, 0.80), (0.97, 0.48), (0.88, 0.46), (0.86, 0.84)],
            0xf4f0dc,
        ),
        detail(
            [
                (-0.96, -0.82),
                (-0.96, -0.50),
                (-0.91, -0.50),
                (-0.89, -0.84),
            ],
            0xb01c1c,
        ),
        detail(
            [(-0.96, 0.82), (-0.96, 0.50), (-0.91, 0.50), (-0.89, 0.84)],
            0xb01c1c,
        ),
        // the seam of the hood
        detail(
            [(0.44, -0.80), (0.455, -0.80), (0.455, 0.80), (0.44, 0.80)],
            0x30343a,
        )
        .faint(0.5),
    ]);
    let roof = rounded_box(DVec2::new(0.30 * l, 0.60 * w))
        .iter()
        .map(|p| *p - DVec2::new(0.19 * l, 0.0))
        .collect();
    let lighter = Coat::Paint {
        color: hex(color) * 1.12 + Vec3::splat(0.01),
        half_width: 0.8 * w,
    };
    parts.push(Part::solid(roof, lighter).detail());
    Body::Rigid(parts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::ring::area;

    #[test]
    fn discs_stay_discs_under_similarities_alone() {
        let turn =
            DMat3::from_scale_angle_translation(DVec2::splat(1.7), 0.4, DVec2::new(5.0, 9.0));
        let disc = disc_in_frame(&turn, DVec2::new(2.0, -1.0), 6.0).unwrap();
        assert!((disc.radius_px - 10.2).abs() < 1e-9);
        assert!(
            disc.center
                .distance(project(&turn, DVec2::new(2.0, -1.0)).unwrap())
                < 1e-12
        );
        let squeezed = DMat3::from_scale(DVec2::new(1.0, 0.9));
        assert!(disc_in_frame(&squeezed, DVec2::ZERO, 6.0).is_none());
        let mut bent = DMat3::IDENTITY;
        bent.x_axis.z = 1e-4;
        assert!(disc_in_frame(&bent, DVec2::ZERO, 6.0).is_none());
    }

    #[test]
    fn outlines_move_with_the_shape() {
        let shape = Shape::at("star", star(10.0, 0xf0c040), DVec2::new(30.0, 20.0))
            .turning(Track::Linear { from: 0.0, to: 1.0 });
        let moment = |share| Moment { share, secs: 0.0 };
        let first = shape.truth(&DMat3::IDENTITY, moment(0.0));
        let last = shape.truth(&DMat3::IDENTITY, moment(1.0));
        assert_eq!(first.outlines[0].len(), 10);
        let around = |p: DVec2| p - DVec2::new(30.0, 20.0);
        let turned = DVec2::from_angle(1.0).rotate(around(first.outlines[0][0]));
        assert!(turned.distance(around(last.outlines[0][0])) < 1e-9);
        assert!((area(&first.outlines[0]) - area(&last.outlines[0])).abs() < 1e-9);
    }
}
