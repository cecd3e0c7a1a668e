//! The things of the street as pieces of the set: awnings, lamps, a bicycle, signs, trees, pots, a church.

use crate::glyph;
use crate::paint::hex;
use crate::props::{Layer, Plant, Prop};
use crate::random::Seed;
use crate::stage::{Piece, Show};
use crate::stroke::Stroke;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

fn prop(origin: DVec3, right: DVec3, up: DVec3, size: DVec2, prop: Prop) -> Piece {
    Piece {
        origin,
        right: right.normalize(),
        up: up.normalize(),
        size,
        show: Show::Prop(Box::new(prop)),
    }
}

/// A piece that faces the camera, with `foot` at the middle of its lower border.
fn standing(foot: DVec3, size: DVec2, content: Prop) -> Piece {
    prop(
        foot - 0.5 * size.x * DVec3::X,
        DVec3::X,
        DVec3::Y,
        size,
        content,
    )
}

fn stroke(points: &[(f64, f64)], width: f64) -> Stroke {
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
    const IRON: u32 = 0x2a_2f_30;
    const SHINE: u32 = 0x6a_74_74;
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
            0xf7_e2_ac,
            &[
                (x - 0.13, 3.42),
                (x + 0.13, 3.42),
                (x + 0.25, 3.98),
                (x - 0.25, 3.98),
            ],
        )
        .glowing(0.28),
        Layer::disc(0xff_f1_c4, (x, 3.68), 0.075).glowing(0.9),
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
    let basket: Vec<Stroke> = (0..6)
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
        .collect();
    let layers = vec![
        Layer::strokes(0xa8_ab_ad, spokes(rear, 0.1).chain(spokes(front, 0.27))),
        Layer::strokes(
            0x1b_1b_1d,
            [circle(rear, RADIUS, 0.042), circle(front, RADIUS, 0.042)],
        ),
        Layer::strokes(
            0xb9_bc_be,
            [
                circle(rear, RADIUS - 0.03, 0.014),
                circle(front, RADIUS - 0.03, 0.014),
            ],
        ),
        Layer::strokes(
            0x8f_1f_22,
            [
                Stroke::arc(rear, RADIUS + 0.045, 0.35, 0.95 * PI, 0.022),
                Stroke::arc(front, RADIUS + 0.045, 0.1, 0.8 * PI, 0.022),
            ],
        ),
        Layer::strokes(
            0x3a_3a_3c,
            [
                circle(crank, 0.095, 0.02),
                line(rear, crank, 0.012),
                line(rear + DVec2::Y * 0.05, crank + DVec2::Y * 0.095, 0.01),
            ],
        ),
        Layer::strokes(
            0xb3_24_28,
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
            0xe8_6a_62,
            [line(
                crank + DVec2::new(0.02, 0.02),
                head - DVec2::new(0.01, 0.12),
                0.008,
            )],
        ),
        Layer::strokes(
            0xb9_bc_be,
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
        Layer::strokes(
            0x24_1c_18,
            [
                stroke(&[(0.56, 0.99), (0.72, 1.0), (0.84, 0.97)], 0.055),
                stroke(&[(1.12, 1.12), (1.04, 1.08)], 0.036),
                stroke(&[(0.89, 0.15), (0.99, 0.15)], 0.03),
            ],
        ),
        Layer::strokes(0x9a_6a_34, basket),
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
            0x22_22_24,
            [
                stroke(&[(0.0, 1.0), (right + 0.1, 1.0)], 0.04),
                stroke(&[(0.0, 1.34), (0.5, 1.3), (0.9, 1.02)], 0.025),
                stroke(&[(left + 0.2, top), (left + 0.2, 1.0)], 0.018),
                stroke(&[(right - 0.2, top), (right - 0.2, 1.0)], 0.018),
            ],
        ),
        Layer::fill(
            0xd9_b2_5a,
            &[(left, bottom), (right, bottom), (right, top), (left, top)],
        ),
        Layer::fill(
            0x7b_22_26,
            &[
                (left + 0.045, bottom + 0.045),
                (right - 0.045, bottom + 0.045),
                (right - 0.045, top - 0.045),
                (left + 0.045, top - 0.045),
            ],
        ),
        Layer::strokes(0xfb_ed_c6, letters),
    ];
    prop(
        at,
        DVec3::X,
        DVec3::Y,
        DVec2::new(right + 0.15, 1.4),
        Prop::Drawing(layers),
    )
}

/// A small street tree.
pub(crate) fn tree(foot: DVec3, seed: Seed) -> Piece {
    let size = DVec2::new(4.6, 6.6);
    let x = 0.5 * size.x;
    let mut blobs = vec![(DVec2::new(x, 4.5), 1.25)];
    for i in 0..11 {
        let angle = f64::from(i) / 11.0 * TAU;
        let reach = seed.between(i64::from(i), 0, 0, 0.75, 1.2);
        let center = DVec2::new(
            x + 1.05 * reach * angle.cos(),
            4.45 + 1.05 * reach * angle.sin(),
        );
        blobs.push((center, seed.between(i64::from(i), 0, 1, 0.5, 0.85)));
    }
    let bark = 0x57_45_36;
    let stem = vec![
        Layer::fill(
            bark,
            &[
                (x - 0.13, 0.0),
                (x + 0.13, 0.0),
                (x + 0.08, 2.9),
                (x - 0.08, 2.9),
            ],
        ),
        Layer::strokes(
            bark,
            [
                stroke(&[(x, 2.7), (x - 0.5, 3.6), (x - 0.8, 4.5)], 0.09),
                stroke(&[(x, 2.7), (x + 0.35, 3.5), (x + 0.9, 4.2)], 0.08),
                stroke(&[(x, 2.7), (x + 0.05, 4.9)], 0.09),
            ],
        ),
        Layer::fill(
            0x86_6e_56,
            &[
                (x + 0.02, 0.0),
                (x + 0.09, 0.0),
                (x + 0.055, 2.9),
                (x + 0.01, 2.9),
            ],
        ),
    ];
    let plant = Plant {
        stem,
        blobs,
        leaf: 0.15,
        colors: [hex(0x24_3d_1c), hex(0x9d_b1_3e)],
        blossom: (hex(0xc9_b3_3c), 0.06),
        seed: seed.fork(2),
    };
    standing(foot, size, Prop::Plant(plant))
}

/// A pot with flowers.
pub(crate) fn pot(foot: DVec3, blossom: u32, seed: Seed) -> Piece {
    let size = DVec2::new(1.2, 1.35);
    let stem = vec![
        Layer::fill(
            0xb0_5e_3a,
            &[(0.39, 0.0), (0.81, 0.0), (0.90, 0.50), (0.30, 0.50)],
        ),
        Layer::fill(
            0xc8_76_4c,
            &[(0.62, 0.0), (0.74, 0.0), (0.80, 0.46), (0.64, 0.46)],
        ),
        Layer::fill(
            0xbd_69_43,
            &[(0.26, 0.46), (0.94, 0.46), (0.95, 0.57), (0.25, 0.57)],
        ),
    ];
    let blobs = vec![
        (DVec2::new(0.60, 0.86), 0.36),
        (DVec2::new(0.36, 0.76), 0.24),
        (DVec2::new(0.84, 0.78), 0.25),
        (DVec2::new(0.60, 1.08), 0.20),
    ];
    let plant = Plant {
        stem,
        blobs,
        leaf: 0.085,
        colors: [hex(0x25_42_20), hex(0x7f_a3_45)],
        blossom: (hex(blossom), 0.32),
        seed,
    };
    standing(foot, size, Prop::Plant(plant))
}

/// A box of geraniums in front of a wall, below a window whose sill's middle is at `sill`.
pub(crate) fn flower_box(sill: DVec3, right: DVec3, seed: Seed) -> Piece {
    let size = DVec2::new(1.3, 0.72);
    let stem = vec![
        Layer::fill(
            0x6b_4a_33,
            &[(0.15, 0.12), (1.15, 0.12), (1.15, 0.34), (0.15, 0.34)],
        ),
        Layer::fill(
            0x84_60_44,
            &[(0.15, 0.31), (1.15, 0.31), (1.15, 0.34), (0.15, 0.34)],
        ),
    ];
    let blobs = (0..6)
        .map(|i| {
            let x = 0.22 + 0.172 * f64::from(i);
            (
                DVec2::new(x, seed.between(i64::from(i), 0, 0, 0.33, 0.44)),
                seed.between(i64::from(i), 0, 1, 0.13, 0.2),
            )
        })
        .collect();
    let red = [0xd4_26_34, 0xe0_4a_6a, 0xe8_7a_2c][(seed.bits(0, 0, 2) % 3) as usize];
    let plant = Plant {
        stem,
        blobs,
        leaf: 0.07,
        colors: [hex(0x22_40_1e), hex(0x78_9e_40)],
        blossom: (hex(red), 0.45),
        seed: seed.fork(1),
    };
    let out = right.cross(DVec3::Y);
    prop(
        sill - 0.5 * size.x * right + 0.17 * out - DVec3::Y * 0.34,
        right,
        DVec3::Y,
        size,
        Prop::Plant(plant),
    )
}

/// The church and the roofs that close the street.
pub(crate) fn church(origin: DVec3) -> [Piece; 1] {
    let x = 8.3;
    let mut layers = vec![
        // roofs of the next quarter
        Layer::fill(
            0xa9_6a_52,
            &[
                (-1.0, 0.0),
                (7.0, 0.0),
                (7.0, 8.0),
                (3.0, 11.5),
                (-1.0, 8.0),
            ],
        ),
        Layer::fill(
            0xd8_c4_a4,
            &[(-1.0, 0.0), (6.0, 0.0), (6.0, 8.0), (-1.0, 8.0)],
        ),
        Layer::fill(
            0x96_5a_48,
            &[
                (11.0, 0.0),
                (22.0, 0.0),
                (22.0, 9.0),
                (16.0, 12.5),
                (11.0, 9.0),
            ],
        ),
        Layer::fill(
            0xcd_b0_90,
            &[(11.0, 0.0), (22.0, 0.0), (22.0, 8.0), (11.0, 8.0)],
        ),
        // nave
        Layer::fill(
            0xc9_b8_9c,
            &[(4.0, 0.0), (13.5, 0.0), (13.5, 9.0), (4.0, 9.0)],
        ),
        Layer::fill(
            0x7c_50_48,
            &[(3.6, 9.0), (13.9, 9.0), (12.0, 13.5), (5.5, 13.5)],
        ),
        // tower with its shaded side, belfry and spire
        Layer::fill(
            0xd9_c7_a6,
            &[
                (x - 2.2, 0.0),
                (x + 2.2, 0.0),
                (x + 2.2, 19.0),
                (x - 2.2, 19.0),
            ],
        ),
        Layer::fill(
            0xb5_a3_8a,
            &[
                (x - 2.2, 0.0),
                (x - 1.3, 0.0),
                (x - 1.3, 19.0),
                (x - 2.2, 19.0),
            ],
        ),
        Layer::fill(
            0xee_dd_bd,
            &[
                (x - 2.5, 18.6),
                (x + 2.5, 18.6),
                (x + 2.5, 19.2),
                (x - 2.5, 19.2),
            ],
        ),
        Layer::fill(0x4f_6e_66, &[(x - 2.4, 19.2), (x + 2.4, 19.2), (x, 30.0)]),
        Layer::fill(0x6f_90_84, &[(x + 0.2, 19.2), (x + 2.4, 19.2), (x, 30.0)]),
        Layer::strokes(
            0x3c_3a_36,
            [
                stroke(&[(x, 29.6), (x, 31.6)], 0.12),
                stroke(&[(x - 0.5, 30.9), (x + 0.5, 30.9)], 0.12),
            ],
        ),
    ];
    for side in [-0.95, 0.95] {
        let c = x + side;
        layers.push(Layer::fill(
            0x3b_38_3a,
            &[
                (c - 0.45, 14.6),
                (c + 0.45, 14.6),
                (c + 0.45, 16.9),
                (c, 17.7),
                (c - 0.45, 16.9),
            ],
        ));
    }
    layers.push(Layer::disc(0x35_3a_44, (x, 12.2), 1.25));
    layers.push(Layer::disc(0xf4_ea_d2, (x, 12.2), 1.08));
    layers.push(Layer::strokes(
        0x2a_2a_2e,
        [
            stroke(&[(x, 12.2), (x + 0.5, 12.75)], 0.14),
            stroke(&[(x, 12.2), (x - 0.1, 13.1)], 0.1),
        ],
    ));
    [prop(
        origin,
        DVec3::X,
        DVec3::Y,
        DVec2::new(22.0, 32.0),
        Prop::Drawing(layers),
    )]
}
