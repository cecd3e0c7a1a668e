//! The samples of a picture to which later pictures are aligned, with their derivatives.

use crate::camera::picture::{Frame, Picture};
use glam::DVec2;
use ravec_raster::Plane;

/// Unknowns of an alignment: gain and bias of light, then the motion, each model a prefix of the next:
/// shift (2), turn and zoom (4), shear (6), perspective (8).
pub(super) const UNKNOWNS: usize = 10;

/// Unknowns of light.
pub(super) const LIGHT: usize = 2;

/// A row of derivatives, filled up with zeros to whole vectors.
pub(super) type Row = [f32; 12];

/// A gradient below this (in luma a pixel, 0.6 of 255 steps) may be noise after reduction and blur.
const MIN_GRADIENT: f32 = 0.0025;

/// Side of the blocks of the finest and of the other levels, and samples that each of their blocks gives: the steepest.
/// Samples from everywhere keep a textured foreground from outvoting a plain background.
const FINEST: Blocks = Blocks {
    side: 16,
    samples: 48,
};
const COARSER: Blocks = Blocks {
    side: 8,
    samples: 24,
};

#[derive(Debug, Clone, Copy)]
struct Blocks {
    side: usize,
    samples: usize,
}

/// A block: a range of samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    pub start: usize,
    pub end: usize,
}

/// One level of a template.
#[derive(Debug, Clone)]
pub(super) struct Level {
    /// The frame in pixels of the level.
    pub frame: Frame,
    /// Normalized positions.
    pub places: Vec<[f32; 2]>,
    /// Luma less its mean.
    pub values: Vec<f32>,
    /// The mean of the luma of all samples.
    pub mean: f32,
    /// Derivatives of the luma by the unknowns.
    pub rows: Vec<Row>,
    /// True if each block has a bias of its own, at the finest level: shadows and reflections move by themselves.
    pub local_bias: bool,
    /// Blocks with samples, in reading order.
    pub blocks: Vec<Block>,
    /// Blocks in all.
    pub block_count: usize,
}

/// Samples of all levels, finest first.
#[derive(Debug, Clone)]
pub(super) struct Template {
    pub levels: Vec<Level>,
}

impl Template {
    pub fn new(picture: &Picture) -> Self {
        let frame = picture.frame();
        let levels = picture.levels.iter().enumerate().map(|(index, plane)| {
            let blocks = if index == 0 { FINEST } else { COARSER };
            let mut level = Level::new(plane, frame.at_level(index), blocks);
            level.local_bias = index == 0;
            level
        });
        Self {
            levels: levels.collect(),
        }
    }
}

impl Level {
    fn new(plane: &Plane, frame: Frame, grid: Blocks) -> Self {
        let (width, height) = (plane.width(), plane.height());
        let mut level = Self {
            frame,
            places: Vec::new(),
            values: Vec::new(),
            mean: 0.0,
            rows: Vec::new(),
            local_bias: false,
            blocks: Vec::new(),
            block_count: width.div_ceil(grid.side) * height.div_ceil(grid.side),
        };
        let mut found = Vec::with_capacity(grid.side * grid.side);
        for top in (0..height).step_by(grid.side) {
            for left in (0..width).step_by(grid.side) {
                steepest(plane, left, top, grid, &mut found);
                let start = level.values.len();
                for &(_, at) in &found {
                    level.push(plane, at as usize);
                }
                let end = level.values.len();
                if end > start {
                    level.blocks.push(Block { start, end });
                }
            }
        }
        let count = level.values.len().max(1) as f32;
        level.mean = level.values.iter().sum::<f32>() / count;
        for (value, row) in level.values.iter_mut().zip(&mut level.rows) {
            *value -= level.mean;
            row[0] = *value;
        }
        level
    }

    fn push(&mut self, plane: &Plane, at: usize) {
        let (col, row) = (at % plane.width(), at / plane.width());
        let center = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
        let place = ((center - self.frame.center) / self.frame.half).as_vec2();
        let half = self.frame.half as f32;
        let [gx, gy] = gradient(plane, at).map(|g| g * half);
        let (u, v) = (place.x, place.y);
        let radial = gx * u + gy * v;
        self.places.push([u, v]);
        self.values.push(plane.pixels()[at]);
        self.rows.push([
            0.0,
            1.0,
            gx,
            gy,
            gy * u - gx * v,
            radial,
            gx * u - gy * v,
            gx * v + gy * u,
            radial * u,
            radial * v,
            0.0,
            0.0,
        ]);
    }
}

/// Central differences at a pixel that is not on the border.
fn gradient(plane: &Plane, at: usize) -> [f32; 2] {
    let (pixels, width) = (plane.pixels(), plane.width());
    [
        0.5 * (pixels[at + 1] - pixels[at - 1]),
        0.5 * (pixels[at + width] - pixels[at - width]),
    ]
}

/// The steepest pixels of a block with their squared gradients, in reading order.
fn steepest(plane: &Plane, left: usize, top: usize, grid: Blocks, found: &mut Vec<(f32, u32)>) {
    let (width, height) = (plane.width(), plane.height());
    found.clear();
    for row in top.max(1)..(top + grid.side).min(height.saturating_sub(1)) {
        for col in left.max(1)..(left + grid.side).min(width.saturating_sub(1)) {
            let at = row * width + col;
            let [gx, gy] = gradient(plane, at);
            let square = gx * gx + gy * gy;
            if square >= MIN_GRADIENT * MIN_GRADIENT {
                found.push((square, at as u32));
            }
        }
    }
    if found.len() > grid.samples {
        // the order of equals is that of their places
        found.select_nth_unstable_by(grid.samples, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        found.truncate(grid.samples);
        found.sort_unstable_by_key(|&(_, at)| at);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::align::increment;
    use glam::DMat3;
    use ravec_raster::Size;

    #[test]
    fn derivatives_agree_with_finite_differences() {
        // a quadratic picture: central differences and bilinear slopes are exact
        let at = |p: DVec2| 0.001 * (p.x * p.x - 2.0 * p.x * p.y + 30.0 * p.y);
        let size = Size::new(48, 32).unwrap();
        let plane = Plane::from_fn(size, |col, row| {
            at(DVec2::new(col as f64 + 0.5, row as f64 + 0.5)) as f32
        });
        let frame = Frame::new(48, 32);
        let level = Level::new(&plane, frame, FINEST);
        assert!(!level.values.is_empty());
        for k in 0..UNKNOWNS - LIGHT {
            let mut step = [0.0; UNKNOWNS];
            step[LIGHT + k] = 1e-5;
            let moved = increment(&step);
            let value = |m: &DMat3, place: DVec2| {
                let image = *m * place.extend(1.0);
                at(image.truncate() / image.z * frame.half + frame.center)
            };
            for (place, row) in level.places.iter().zip(&level.rows) {
                let place = DVec2::new(f64::from(place[0]), f64::from(place[1]));
                let slope = (value(&moved, place) - value(&DMat3::IDENTITY, place)) / 1e-5;
                assert!((slope - f64::from(row[LIGHT + k])).abs() < 2e-3, "{k}");
            }
        }
    }

    #[test]
    fn every_block_gives_its_steepest_pixels_only() {
        let size = Size::new(64, 48).unwrap();
        let plane = Plane::from_fn(size, |col, row| ((col * 7 + row * 13) % 32) as f32 / 32.0);
        let level = Level::new(&plane, Frame::new(64, 48), FINEST);
        assert_eq!(level.block_count, 12);
        assert!(
            level
                .blocks
                .iter()
                .all(|b| b.end - b.start <= FINEST.samples)
        );
        assert_eq!(level.blocks.last().map(|b| b.end), Some(level.values.len()));
    }

    #[test]
    fn a_flat_picture_has_no_samples() {
        for (width, height) in [(1, 1), (2, 2), (40, 30)] {
            let plane = Plane::new(Size::new(width, height).unwrap(), 0.4);
            let level = Level::new(&plane, Frame::new(width, height), FINEST);
            assert!(level.values.is_empty() && level.blocks.is_empty());
        }
    }
}
