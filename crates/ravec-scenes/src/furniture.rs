//! The things of the street as pieces of the set: awnings, lamps, a bicycle, signs, a church.

use crate::glyph;
use crate::paint::hex;
use crate::props::{Layer, Prop};
use crate::stage::{Piece, Show};
use crate::stroke::Stroke;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

pub(crate) fn prop(origin: DVec3, right: DVec3, up: DVec3, size: DVec2, prop: Prop) -> Piece {
    Piece {
        origin,
        right: right.normalize(),
        up: up.normalize(),
        size,
        show: Show::Prop(Box::new(prop)),
    }
}

/// A piece that faces the camera, with `foot` at the middle of its lower border.
pub(crate) fn standing(foot: DVec3, size: DVec2, content: Prop) -> Piece {
    prop(
        foot - 0.5 * size.x * DVec3::X,
        DVec3::X,
        DVec3::Y,
        size,
        content,
    )
}

pub(crate) fn stroke(points: &[(f64, f64)], width: f64) -> Stroke {
    Stroke {
        points: points.iter().map(|&p| p.into()).collect(),
        width,
    }
}

/// A striped awning with a scalloped border on the left wall; `at` is the near end of its upper border.
pub(crate) fn awning(at: DVec3, length: f64, colors: [u32; 2]) -> [Piece; 2] {
    const REACH: DVec2 = DVec2::new(1.25, 0.45);
    let colors = colors.map(hex);
    let slope = DVec3::new(-REACH.x, REACH.y, 0.0);
    let lower = at + DVec3::new(REACH.x, -REACH.y, 0.0);
    let hang = 0.26;
    [
        prop(
            lower,
            DVec3::NEG_Z,
            slope,
            DVec2::new(length, REACH.length()),
            Prop::Cloth {
                colors,
                stripe: 0.46,
                scallop: 0.0,
            },
        ),
        prop(
            lower - DVec3::Y * hang,
            DVec3::NEG_Z,
            DVec3::Y,
            DVec2::new(length, hang),
            Prop::Cloth {
                colors,
                stripe: 0.46,
                scallop: 0.11,
            },
        ),
    ]
}

/// A cast-iron lamp post with a lantern.
pub(crate) fn lamp(foot: DVec3) -> Piece {
    const IRON: u32 = 0x2a2f30;
    const SHINE: u32 = 0x6a7474;
    let x = 0.6;
    let layers = vec![
        Layer::fill(
            IRON,
            &[
                (x - 0.17, 0.0),
                (x + 0.17, 0.0),
                (x + 0.11, 0.55),
                (x - 0.11, 0.55),
            ],
        ),
        Layer::strokes(
            IRON,
            [
                stroke(&[(x, 0.5), (x, 3.35)], 0.105),
                stroke(&[(x - 0.13, 0.56), (x + 0.13, 0.56)], 0.07),
                stroke(&[(x - 0.09, 1.15), (x + 0.09, 1.15)], 0.06),
                stroke(&[(x - 0.36, 3.05), (x + 0.36, 3.05)], 0.035),
                stroke(&[(x - 0.09, 3.32), (x + 0.09, 3.32)], 0.07),
            ],
        ),
        Layer::strokes(
            SHINE,
            [stroke(&[(x + 0.022, 0.6), (x + 0.022, 3.3)], 0.022)],
        ),
        Layer::disc(IRON, (x - 0.37, 3.05), 0.045),
        Layer::disc(IRON, (x + 0.37, 3.05), 0.045),
        // the lantern: panes in an iron frame, a roof, a finial
        Layer::fill(
            0xf7e2ac,
            &[
                (x - 0.13, 3.42),
                (x + 0.13, 3.42),
                (x + 0.25, 3.98),
                (x - 0.25, 3.98),
            ],
        )
        .glowing(0.28),
        Layer::disc(0xfff1c4, (x, 3.68), 0.075).glowing(0.9),
        Layer::strokes(
            IRON,
            [
                stroke(
                    &[
                        (x - 0.13, 3.42),
                        (x + 0.13, 3.42),
                        (x + 0.25, 3.98),
                        (x - 0.25, 3.98),
                        (x - 0.13, 3.42),
                    ],
                    0.035,
                ),
                stroke(&[(x - 0.04, 3.42), (x - 0.085, 3.98)], 0.018),
                stroke(&[(x + 0.04, 3.42), (x + 0.085, 3.98)], 0.018),
                stroke(&[(x, 4.18), (x, 4.42)], 0.03),
            ],
        ),
        Layer::fill(
            IRON,
            &[
                (x - 0.31, 3.98),
                (x + 0.31, 3.98),
                (x + 0.08, 4.22),
                (x - 0.08, 4.22),
            ],
        ),
        Layer::disc(IRON, (x, 4.3), 0.05),
    ];
    standing(foot, DVec2::new(1.2, 4.5), Prop::Drawing(layers))
}

/// A city bicycle with spokes, mudguards and a basket, turned a little towards the street.
pub(crate) fn bicycle(foot: DVec3) -> Piece {
    const RADIUS: f64 = 0.34;
    let (rear, front) = (
        DVec2::new(0.42, RADIUS + 0.01),
        DVec2::new(1.50, RADIUS + 0.01),
    );
    let circle =
        |center: DVec2, radius: f64, width: f64| Stroke::arc(center, radius, 0.0, TAU, width);
    let spokes = |hub: DVec2, turn: f64| {
        (0..14).map(move |i| {
            let angle = turn + f64::from(i) * TAU / 14.0;
            Stroke::straight(hub, hub + RADIUS * DVec2::from_angle(angle), 0.005)
        })
    };
    let (crank, seat, head) = (
        DVec2::new(0.86, 0.30),
        DVec2::new(0.70, 0.86),
        DVec2::new(1.32, 0.88),
    );
    let line = |a: DVec2, b: DVec2, width: f64| Stroke::straight(a, b, width);
    let layers = vec![
        Layer::strokes(0xa8abad, spokes(rear, 0.1).chain(spokes(front, 0.27))),
        Layer::strokes(
            0x1b1b1d,
            [circle(rear, RADIUS, 0.042), circle(front, RADIUS, 0.042)],
        ),
        Layer::strokes(
            0xb9bcbe,
            [
                circle(rear, RADIUS - 0.03, 0.014),
                circle(front, RADIUS - 0.03, 0.014),
            ],
        ),
        Layer::strokes(
            0x8f1f22,
            [
                Stroke::arc(rear, RADIUS + 0.045, 0.35, 0.95 * PI, 0.022),
                Stroke::arc(front, RADIUS + 0.045, 0.1, 0.8 * PI, 0.022),
            ],
        ),
        Layer::strokes(
            0x3a3a3c,
            [
                circle(crank, 0.095, 0.02),
                line(rear, crank, 0.012),
                line(rear + DVec2::Y * 0.05, crank + DVec2::Y * 0.095, 0.01),
            ],
        ),
        Layer::strokes(
            0xb32428,
            [
                line(rear, crank, 0.026),
                line(rear, seat - DVec2::new(-0.02, 0.08), 0.022),
                line(crank, seat, 0.034),
                line(crank, head - DVec2::new(0.0, 0.12), 0.036),
                line(
                    seat - DVec2::new(-0.03, 0.16),
                    head - DVec2::new(0.0, 0.05),
                    0.032,
                ),
                line(head + DVec2::new(-0.03, 0.1), DVec2::new(1.40, 0.62), 0.034),
                stroke(&[(1.40, 0.62), (1.46, 0.42), (1.50, 0.35)], 0.026),
            ],
        ),
        Layer::strokes(
            0xe86a62,
            [line(
                crank + DVec2::new(0.02, 0.02),
                head - DVec2::new(0.01, 0.12),
                0.008,
            )],
        ),
        Layer::strokes(
            0xb9bcbe,
            [
                line(seat, seat + DVec2::new(-0.025, 0.12), 0.026),
                line(
                    head + DVec2::new(-0.03, 0.1),
                    head + DVec2::new(-0.06, 0.22),
                    0.026,
                ),
                stroke(&[(1.26, 1.10), (1.16, 1.13), (1.08, 1.10)], 0.024),
                stroke(&[(0.86, 0.30), (0.93, 0.16)], 0.022),
            ],
        ),
        leather(),
        Layer::strokes(0x9a6a34, basket()),
    ];
    let angle = 28f64.to_radians();
    prop(
        foot,
        DVec3::new(angle.cos(), 0.0, -angle.sin()),
        DVec3::Y,
        DVec2::new(2.0, 1.3),
        Prop::Drawing(layers),
    )
}

/// The bicycle's saddle, handle and pedal.
fn leather() -> Layer {
    Layer::strokes(
        0x241c18,
        [
            stroke(&[(0.56, 0.99), (0.72, 1.0), (0.84, 0.97)], 0.055),
            stroke(&[(1.12, 1.12), (1.04, 1.08)], 0.036),
            stroke(&[(0.89, 0.15), (0.99, 0.15)], 0.03),
        ],
    )
}

/// The wires of the bicycle's basket.
fn basket() -> Vec<Stroke> {
    (0..6)
        .map(|i| {
            let t = f64::from(i) / 5.0;
            stroke(&[(1.46 + 0.26 * t, 0.82), (1.42 + 0.34 * t, 1.06)], 0.014)
        })
        .chain((0..4).map(|i| {
            let t = f64::from(i) / 3.0;
            stroke(
                &[
                    (1.46 - 0.04 * t, 0.82 + 0.24 * t),
                    (1.72 + 0.04 * t, 0.82 + 0.24 * t),
                ],
                0.016,
            )
        }))
        .collect()
}

/// A sign on an iron arm on the left wall, facing down the street; `at` is the arm's foot.
pub(crate) fn hanging_sign(at: DVec3, text: &str) -> Piece {
    let (width, height) = (1.35, 0.74);
    let (left, bottom) = (0.22, 0.0);
    let scale = 0.34 / glyph::HEIGHT;
    let start = left + 0.5 * (width - scale * glyph::text_width(text));
    let letters = glyph::polylines(text).into_iter().map(|line| Stroke {
        points: line
            .iter()
            .map(|p| DVec2::new(start + scale * p.x, bottom + 0.54 - scale * p.y))
            .collect(),
        width: 0.062,
    });
    let (right, top) = (left + width, bottom + height);
    let layers = vec![
        Layer::strokes(
            0x222224,
            [
                stroke(&[(0.0, 1.0), (right + 0.1, 1.0)], 0.04),
                stroke(&[(0.0, 1.34), (0.5, 1.3), (0.9, 1.02)], 0.025),
                stroke(&[(left + 0.2, top), (left + 0.2, 1.0)], 0.018),
                stroke(&[(right - 0.2, top), (right - 0.2, 1.0)], 0.018),
            ],
        ),
        Layer::fill(
            0xd9b25a,
            &[(left, bottom), (right, bottom), (right, top), (left, top)],
        ),
        Layer::fill(
            0x7b2226,
            &[
                (left + 0.045, bottom + 0.045),
                (right - 0.045, bottom + 0.045),
                (right - 0.045, top - 0.045),
                (left + 0.045, top - 0.045),
            ],
        ),
        Layer::strokes(0xfbedc6, letters),
    ];
    prop(
        at,
        DVec3::X,
        DVec3::Y,
        DVec2::new(right + 0.15, 1.4),
        Prop::Drawing(layers),
    )
}

/// The church and the roofs that close the street.
pub(crate) fn church(origin: DVec3) -> [Piece; 1] {
    let mut layers = vec![
        // roofs of the next quarter
        Layer::fill(
            0xa96a52,
            &[
                (-1.0, 0.0),
                (7.0, 0.0),
                (7.0, 8.0),
                (3.0, 11.5),
                (-1.0, 8.0),
            ],
        ),
        Layer::fill(
            0xd8c4a4,
            &[(-1.0, 0.0), (6.0, 0.0), (6.0, 8.0), (-1.0, 8.0)],
        ),
        Layer::fill(
            0x965a48,
            &[
                (11.0, 0.0),
                (22.0, 0.0),
                (22.0, 9.0),
                (16.0, 12.5),
                (11.0, 9.0),
            ],
        ),
        Layer::fill(
            0xcdb090,
            &[(11.0, 0.0), (22.0, 0.0), (22.0, 8.0), (11.0, 8.0)],
        ),
        // nave
        Layer::fill(
            0xc9b89c,
            &[(4.0, 0.0), (13.5, 0.0), (13.5, 9.0), (4.0, 9.0)],
        ),
        Layer::fill(
            0x7c5048,
            &[(3.6, 9.0), (13.9, 9.0), (12.0, 13.5), (5.5, 13.5)],
        ),
    ];
    layers.extend(tower(8.3));
    [prop(
        origin,
        DVec3::X,
        DVec3::Y,
        DVec2::new(22.0, 32.0),
        Prop::Drawing(layers),
    )]
}

/// The church's tower around `x`, with its shaded side, belfry, spire and clock.
fn tower(x: f64) -> Vec<Layer> {
    let mut layers = vec![
        Layer::fill(
            0xd9c7a6,
            &[
                (x - 2.2, 0.0),
                (x + 2.2, 0.0),
                (x + 2.2, 19.0),
                (x - 2.2, 19.0),
            ],
        ),
        Layer::fill(
            0xb5a38a,
            &[
                (x - 2.2, 0.0),
                (x - 1.3, 0.0),
                (x - 1.3, 19.0),
                (x - 2.2, 19.0),
            ],
        ),
        Layer::fill(
            0xeeddbd,
            &[
                (x - 2.5, 18.6),
                (x + 2.5, 18.6),
                (x + 2.5, 19.2),
                (x - 2.5, 19.2),
            ],
        ),
        Layer::fill(0x4f6e66, &[(x - 2.4, 19.2), (x + 2.4, 19.2), (x, 30.0)]),
        Layer::fill(0x6f9084, &[(x + 0.2, 19.2), (x + 2.4, 19.2), (x, 30.0)]),
        Layer::strokes(
            0x3c3a36,
            [
                stroke(&[(x, 29.6), (x, 31.6)], 0.12),
                stroke(&[(x - 0.5, 30.9), (x + 0.5, 30.9)], 0.12),
            ],
        ),
    ];
    for side in [-0.95, 0.95] {
        let c = x + side;
        layers.push(Layer::fill(
            0x3b383a,
            &[
                (c - 0.45, 14.6),
                (c + 0.45, 14.6),
                (c + 0.45, 16.9),
                (c, 17.7),
                (c - 0.45, 16.9),
            ],
        ));
    }
    layers.push(Layer::disc(0x353a44, (x, 12.2), 1.25));
    layers.push(Layer::disc(0xf4ead2, (x, 12.2), 1.08));
    layers.push(Layer::strokes(
        0x2a2a2e,
        [
            stroke(&[(x, 12.2), (x + 0.5, 12.75)], 0.14),
            stroke(&[(x, 12.2), (x - 0.1, 13.1)], 0.1),
        ],
    ));
    layers
}
