//! A sheet of all textures side by side: noise, cells, wood, marble, brick, tiles, grass, leaves.

use crate::paint::{hex, paint};
use crate::random::Seed;
use crate::texture::{brick, cellular, foliage, fractal, grass, marble, tiles, value_noise, wood};
use glam::{DVec2, Vec3};
use ravec_raster::{Image, LinearRgb, Size};
use serde::{Deserialize, Serialize};

/// Fields of the textures, of equal size and without gaps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SwatchesTruth {
    /// The fields, row by row.
    pub fields: Vec<Field>,
}

/// One field of the sheet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Field {
    /// Name of the texture.
    pub texture: String,
    /// Upper left corner in the image.
    pub low: DVec2,
    /// Lower right corner in the image.
    pub high: DVec2,
}

const COLUMNS: usize = 4;
const NAMES: [&str; 8] = [
    "fractal noise",
    "cells",
    "wood",
    "marble",
    "brick",
    "tiles",
    "grass",
    "leaves",
];

/// The sheet: four columns and two rows of fields, each about as wide as 1.6 meters of its material.
pub fn swatches(size: Size, seed: Seed) -> (Image<LinearRgb>, SwatchesTruth) {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let cell = extent / DVec2::new(COLUMNS as f64, 2.0);
    let corner = |i: usize| cell * DVec2::new((i % COLUMNS) as f64, (i / COLUMNS) as f64);
    let fields = NAMES.iter().enumerate().map(|(i, name)| Field {
        texture: (*name).to_owned(),
        low: corner(i),
        high: corner(i) + cell,
    });
    let truth = SwatchesTruth {
        fields: fields.collect(),
    };
    let meter = 1.6 / cell.max_element();
    let image = paint(size, |p| {
        let field = (p / cell)
            .floor()
            .min(DVec2::new(COLUMNS as f64 - 1.0, 1.0));
        let index = field.x as usize + COLUMNS * field.y as usize;
        let q = (p - corner(index)) * meter;
        swatch(index, q, meter, seed).clamp(Vec3::ZERO, Vec3::ONE)
    });
    (image, truth)
}

fn swatch(index: usize, q: DVec2, footprint: f64, seed: Seed) -> Vec3 {
    match index {
        0 => Vec3::splat((0.4 + 0.3 * fractal(q * 3.0, 3.0 * footprint, 7, seed)) as f32),
        1 => {
            let cell = cellular(q * 7.0, seed);
            let tint = hex(0x6d849c).lerp(hex(0xc9a274), cell.tint as f32);
            tint * ((cell.second - cell.nearest) * 6.0).clamp(0.12, 1.0) as f32
        }
        2 => wood(q * 0.6, 0.6 * footprint, hex(0xa87140), seed),
        3 => marble(q, footprint, seed),
        4 => {
            brick(q, footprint, hex(0xa34f38), seed)
                * (0.85 + 0.3 * value_noise(q * 2.0, seed)) as f32
        }
        5 => tiles(q, footprint, 0.25, [hex(0xd6c8ae), hex(0x4f6a72)], seed),
        6 => grass(q * 1.2, 1.2 * footprint, seed),
        _ => {
            let leaves = foliage(q, footprint, 0.16, |_| 1.0, seed);
            let green = hex(0x1d3516).lerp(hex(0x8fb03e), leaves.height as f32);
            green * (0.75 + 0.5 * leaves.tint) as f32 * (0.3 + 0.7 * leaves.cover) as f32
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_tile_the_picture() {
        let size = Size::new(83, 41).unwrap();
        let (_, truth) = swatches(size, Seed(1));
        let area: f64 = truth
            .fields
            .iter()
            .map(|f| (f.high - f.low).element_product())
            .sum();
        assert!((area - 83.0 * 41.0).abs() < 1e-9);
    }
}
