//! Samples of the plane in the frame that others are aligned to.

use crate::track::picture::{Level, Picture};
use glam::{DMat3, DVec2, dvec2};

/// Normalized coordinates of the plane: the middle of the region is the origin, half its diagonal is 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Units {
    pub center: DVec2,
    /// Half the diagonal, in pixels.
    pub half: f64,
}

impl Units {
    pub fn pixels_from_units(self) -> DMat3 {
        DMat3::from_translation(self.center) * DMat3::from_scale(DVec2::splat(self.half))
    }
}

/// Samples in a row that lie in one block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Block {
    pub start: usize,
    pub end: usize,
    /// Number of the group of blocks of the dense samples that it lies in or is nearest to.
    pub group: usize,
}

/// Samples at one size of the picture, structure of arrays, sorted by blocks.
#[derive(Debug, Clone, Default)]
pub(super) struct Samples {
    /// Level of the picture.
    pub level: usize,
    /// Places in units.
    pub u: Vec<f32>,
    pub v: Vec<f32>,
    /// Value, less the mean of all.
    pub value: Vec<f32>,
    /// Derivatives by units.
    pub gx: Vec<f32>,
    pub gy: Vec<f32>,
    /// Second derivatives by pixels of the level: xx, xy, yy.
    pub second: [Vec<f32>; 3],
    pub blocks: Vec<Block>,
    /// Number of groups.
    pub groups: usize,
    pub mean: f32,
}

impl Samples {
    pub fn len(&self) -> usize {
        self.u.len()
    }

    pub fn place(&self, index: usize) -> DVec2 {
        dvec2(f64::from(self.u[index]), f64::from(self.v[index]))
    }
}

/// The plane in a frame.
#[derive(Debug, Clone)]
pub(super) struct Template {
    pub units: Units,
    /// A few samples of each level, finest first.
    pub levels: Vec<Samples>,
    /// Many samples of the finest levels.
    pub dense: Vec<Samples>,
}

/// Samples of a level but the dense ones.
const LEVEL_SAMPLES: usize = 2000;

/// Levels that have many samples.
const DENSE_LEVELS: usize = 4;

/// Coverage of the region from which a pixel belongs to it, at the finest level and at coarser ones: what lies beyond the border
/// moves otherwise, and the blur mixes it in.
const MIN_COVERAGE: [f32; 2] = [0.985, 0.8];

/// Groups that the covariance and the verdict are made from, at least, and their sides in pixels.
const GROUPS: f64 = 80.0;
const GROUP_PX: [f64; 2] = [8.0, 32.0];

/// Samples with a gradient of a step of 255 a pixel below which a plane cannot be tracked.
const MIN_SAMPLES: usize = 60;
const MIN_GRADIENT: f32 = 1.0 / 255.0;

impl Template {
    /// Samples of the part of a picture that `coverage`, at the sizes of the picture, covers. Nothing if there is too little.
    pub fn new(picture: &Picture, coverage: &[Vec<f32>], dense: usize) -> Option<Self> {
        let units = units(picture, &coverage[0])?;
        let area = coverage[0].iter().filter(|&&c| c > 0.5).count() as f64;
        let group = (area / GROUPS).sqrt().clamp(GROUP_PX[0], GROUP_PX[1]);
        let all = |level: usize, count: usize| {
            let side = if level == 0 {
                0.5 * group
            } else {
                8.0f64.min(0.5 * group)
            };
            select(picture, coverage, level, units, count, side)
        };
        let levels: Vec<Samples> = (0..picture.levels.len())
            .map(|level| all(level, LEVEL_SAMPLES))
            .take_while(|samples| samples.len() >= MIN_SAMPLES)
            .collect();
        let textured = |samples: &Samples| {
            let least = (f64::from(MIN_GRADIENT) * units.half) as f32;
            let steep = samples.gx.iter().zip(&samples.gy);
            steep.filter(|(gx, gy)| gx.hypot(**gy) >= least).count() >= MIN_SAMPLES
        };
        if !levels.first().is_some_and(textured) {
            return None;
        }
        let dense = (0..levels.len().min(DENSE_LEVELS)).map(|level| all(level, dense));
        let dense = dense.collect();
        let mut template = Self {
            units,
            levels,
            dense,
        };
        template.find_groups();
        Some(template)
    }
}

impl Template {
    /// Gives each block of the levels the nearest group of the dense samples.
    fn find_groups(&mut self) {
        let finest = &self.dense[0];
        let mut sums = vec![(dvec2(0.0, 0.0), 0.0f64); finest.groups];
        for block in &finest.blocks {
            for i in block.start..block.end {
                let sum = &mut sums[block.group];
                sum.0 += finest.place(i);
                sum.1 += 1.0;
            }
        }
        let groups = finest.groups;
        let centers: Vec<DVec2> = sums.iter().map(|&(sum, n)| sum / n.max(1.0)).collect();
        for samples in self.levels.iter_mut().chain(&mut self.dense[1..]) {
            for index in 0..samples.blocks.len() {
                let block = samples.blocks[index];
                let middle = samples.place(usize::midpoint(block.start, block.end));
                let distance = |&i: &usize| centers[i].distance_squared(middle);
                let nearest = (0..centers.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
                samples.blocks[index].group = nearest.unwrap_or(0);
            }
            samples.groups = groups;
        }
    }
}

/// Units of the box around the covered pixels.
fn units(picture: &Picture, coverage: &[f32]) -> Option<Units> {
    let level = &picture.levels[0];
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for (row, line) in coverage.chunks_exact(level.width).enumerate() {
        let covered = |&c: &f32| c > 0.5;
        if let (Some(first), Some(last)) = (
            line.iter().position(covered),
            line.iter().rposition(covered),
        ) {
            let y = (level.top + row) as f64;
            low = low.min(dvec2((level.left + first) as f64, y));
            high = high.max(dvec2((level.left + last + 1) as f64, y + 1.0));
        }
    }
    (low.x < high.x).then(|| Units {
        center: 0.5 * (low + high),
        half: 0.5 * (high - low).length(),
    })
}

/// A pixel that may become a sample.
#[derive(Clone, Copy)]
struct Candidate {
    energy: f32,
    at: u32,
    block: u32,
}

/// Half of the samples are the steepest pixels of each cell, the others the steepest of all.
fn select(
    picture: &Picture,
    coverage: &[Vec<f32>],
    index: usize,
    units: Units,
    count: usize,
    block_px: f64,
) -> Samples {
    let level = &picture.levels[index];
    let side = (block_px.round() as usize).max(4);
    let columns = level.width.div_ceil(side);
    let mut candidates = candidates(level, &coverage[index], index, side);
    // steepest first within a block; the order of equals is that of their places
    candidates.sort_unstable_by(|a, b| {
        (a.block.cmp(&b.block))
            .then(b.energy.total_cmp(&a.energy))
            .then(a.at.cmp(&b.at))
    });
    let blocks = candidates.chunk_by(|a, b| a.block == b.block).count();
    let each = (count / 2).div_ceil(blocks.max(1));
    let mut taken: Vec<Candidate> = Vec::with_capacity(count);
    let mut others: Vec<Candidate> = Vec::new();
    for block in candidates.chunk_by(|a, b| a.block == b.block) {
        let (first, rest) = block.split_at(each.min(block.len()));
        taken.extend(first);
        others.extend(rest);
    }
    let left = count.saturating_sub(taken.len()).min(others.len());
    if left > 0 && left < others.len() {
        others.select_nth_unstable_by(left, |a, b| {
            b.energy.total_cmp(&a.energy).then(a.at.cmp(&b.at))
        });
    }
    taken.extend(&others[..left]);
    // in the order of blocks, and in a block in that of places, which is that of memory
    taken.sort_unstable_by_key(|c| (c.block, c.at));
    gather(level, index, units, &taken, columns)
}

fn candidates(level: &Level, coverage: &[f32], index: usize, side: usize) -> Vec<Candidate> {
    let (width, height) = (level.width, level.height);
    let columns = width.div_ceil(side);
    let min_coverage = MIN_COVERAGE[usize::from(index > 0)];
    let values = &level.values;
    let mut found = Vec::new();
    for row in 1..height.saturating_sub(1) {
        for col in 1..width.saturating_sub(1) {
            let at = row * width + col;
            if coverage[at] < min_coverage {
                continue;
            }
            let gx = 0.5 * (values[at + 1] - values[at - 1]);
            let gy = 0.5 * (values[at + width] - values[at - width]);
            let energy = gx * gx + gy * gy;
            let corners = values[at - width - 1]
                + values[at - width + 1]
                + values[at + width - 1]
                + values[at + width + 1]
                + values[at];
            // refuses what is not a number among the neighbors
            if energy.is_finite() && corners.is_finite() {
                found.push(Candidate {
                    energy,
                    at: at as u32,
                    block: (row / side * columns + col / side) as u32,
                });
            }
        }
    }
    found
}

fn gather(
    level: &Level,
    index: usize,
    units: Units,
    taken: &[Candidate],
    columns: usize,
) -> Samples {
    let scale = f64::from(1u32 << index);
    let (width, values) = (level.width, &level.values);
    // units to pixels of the level
    let per_unit = (units.half / scale) as f32;
    let mut samples = Samples {
        level: index,
        ..Samples::default()
    };
    let group_columns = columns.div_ceil(2);
    let mut groups: Vec<usize> = Vec::new();
    for block in taken.chunk_by(|a, b| a.block == b.block) {
        let start = samples.len();
        for candidate in block {
            let at = candidate.at as usize;
            let place = dvec2(
                (level.left + at % width) as f64 + 0.5,
                (level.top + at / width) as f64 + 0.5,
            ) * scale;
            let place = ((place - units.center) / units.half).as_vec2();
            samples.u.push(place.x);
            samples.v.push(place.y);
            samples.value.push(values[at]);
            samples
                .gx
                .push(0.5 * (values[at + 1] - values[at - 1]) * per_unit);
            samples
                .gy
                .push(0.5 * (values[at + width] - values[at - width]) * per_unit);
            samples.second[0].push(values[at + 1] - 2.0 * values[at] + values[at - 1]);
            samples.second[1].push(
                0.25 * (values[at + width + 1] - values[at + width - 1] - values[at - width + 1]
                    + values[at - width - 1]),
            );
            samples.second[2].push(values[at + width] - 2.0 * values[at] + values[at - width]);
        }
        let number = block[0].block as usize;
        let (row, col) = (number / columns, number % columns);
        groups.push(row / 2 * group_columns + col / 2);
        samples.blocks.push(Block {
            start,
            end: samples.len(),
            group: 0,
        });
    }
    let mut numbers = groups.clone();
    numbers.sort_unstable();
    numbers.dedup();
    for (block, group) in samples.blocks.iter_mut().zip(groups) {
        block.group = numbers.partition_point(|&number| number < group);
    }
    samples.groups = numbers.len();
    let sum: f64 = samples.value.iter().map(|&v| f64::from(v)).sum();
    samples.mean = (sum / samples.len().max(1) as f64) as f32;
    for value in &mut samples.value {
        *value -= samples.mean;
    }
    samples
}
