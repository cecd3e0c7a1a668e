//! The plants of the street as pieces of the set: trees, pots and flower boxes.

use crate::furniture::{prop, standing, stroke};
use crate::paint::hex;
use crate::props::{Layer, Plant, Prop};
use crate::random::Seed;
use crate::stage::Piece;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

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
    let bark = 0x574536;
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
            0x866e56,
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
        colors: [hex(0x243d1c), hex(0x9db13e)],
        blossom: (hex(0xc9b33c), 0.06),
        seed: seed.fork(2),
    };
    standing(foot, size, Prop::Plant(plant))
}

/// A pot with flowers.
pub(crate) fn pot(foot: DVec3, blossom: u32, seed: Seed) -> Piece {
    let size = DVec2::new(1.2, 1.35);
    let stem = vec![
        Layer::fill(
            0xb05e3a,
            &[(0.39, 0.0), (0.81, 0.0), (0.90, 0.50), (0.30, 0.50)],
        ),
        Layer::fill(
            0xc8764c,
            &[(0.62, 0.0), (0.74, 0.0), (0.80, 0.46), (0.64, 0.46)],
        ),
        Layer::fill(
            0xbd6943,
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
        colors: [hex(0x254220), hex(0x7fa345)],
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
            0x6b4a33,
            &[(0.15, 0.12), (1.15, 0.12), (1.15, 0.34), (0.15, 0.34)],
        ),
        Layer::fill(
            0x846044,
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
    let red = [0xd42634, 0xe04a6a, 0xe87a2c][(seed.bits(0, 0, 2) % 3) as usize];
    let plant = Plant {
        stem,
        blobs,
        leaf: 0.07,
        colors: [hex(0x22401e), hex(0x789e40)],
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
