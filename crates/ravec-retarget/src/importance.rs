//! What must keep its shape: a weight for each unit of the grid.
//!
//! ```text
//! barrier  = minimum barrier distance to the border on a small reduction, opened, above its median, 0 to 1
//! contrast = that of the two-color pixels, without those along straight runs
//! weight   = 1 − (1 − barrier) (1 − contrast / 4)
//! ```
//!
//! Contrast alone is a poor measure: textured ground has it, the even inside of an object has none. The barrier alone loses
//! thin figures and what touches the border.

use crate::analysis::Analysis;
use crate::barrier::{barrier_distance, opened};
use crate::runs::Run;
use ravec_raster::{Image, LinearRgb, Oklab, Plane, ResizeFilter, Size, resize};
use rayon::prelude::*;

/// The longer side of the reduction for the barrier distance. Objects of a few of its pixels are opened away.
const BARRIER_SIDE: usize = 200;

/// Half the side of the square that an object must hold to count, in pixels of that reduction.
const OPENING: usize = 2;

/// The share of the largest barrier distance (without the upper 2 %) that counts as full. The median counts as nothing: it is
/// what the ground has. Less gives faint objects the importance of strong ones, more gives ground with texture some.
const FULL_BARRIER: f32 = 0.6;

/// The Oklab contrast that counts as full.
const FULL_CONTRAST: f32 = 0.25;

/// How much of contrast along a straight run counts: lines are held by themselves, and need no stiff cells.
const RUN_SHARE: f32 = 0.2;

/// How much contrast counts against the barrier. More keeps thin figures that the barrier loses, and textured ground.
const CONTRAST_SHARE: f64 = 0.25;

/// The importance of each unit, 0 to 1.
pub(crate) fn importance(analysis: &Analysis, runs: &[Run], saliency: f64) -> Vec<f64> {
    let contrast = contrast(analysis, runs);
    let barrier = if saliency > 0.0 {
        barrier(analysis)
    } else {
        vec![0.0; contrast.len()]
    };
    let mixed = barrier.iter().zip(contrast);
    mixed
        .map(|(b, c)| 1.0 - (1.0 - saliency * b) * (1.0 - CONTRAST_SHARE * f64::from(c)))
        .collect()
}

/// The mean contrast of the blocks of each unit, 0 to 1.
fn contrast(analysis: &Analysis, runs: &[Run]) -> Vec<f32> {
    let field = &analysis.field;
    let (blocks, side) = (field.grid_size(), field.block_px() as f64);
    let mut values: Vec<f32> = field
        .blocks()
        .iter()
        .map(|block| (block.contrast() / FULL_CONTRAST).min(1.0))
        .collect();
    let mut along_run = vec![false; values.len()];
    for run in runs {
        let steps = (run.length() / (0.5 * side)).ceil().max(1.0);
        for step in 0..=steps as usize {
            let at = run.ends[0].lerp(run.ends[1], step as f64 / steps) / side;
            let (col, row) = (at.x.max(0.0) as usize, at.y.max(0.0) as usize);
            if col < blocks.width() && row < blocks.height() {
                along_run[row * blocks.width() + col] = true;
            }
        }
    }
    for (value, _) in values
        .iter_mut()
        .zip(&along_run)
        .filter(|(_, along)| **along)
    {
        *value *= RUN_SHARE;
    }
    let [cols, rows] = analysis.units;
    // the blocks that a unit holds, or the one that holds it
    let within = |unit: usize| {
        let first = unit * analysis.unit_px / field.block_px();
        let end = ((unit + 1) * analysis.unit_px).div_ceil(field.block_px());
        first..end
    };
    (0..cols * rows)
        .map(|unit| {
            let places = within(unit / cols)
                .flat_map(|row| within(unit % cols).map(move |col| row * blocks.width() + col));
            let (mut sum, mut count) = (0.0, 0.0f32);
            for place in places {
                sum += values[place];
                count += 1.0;
            }
            sum / count
        })
        .collect()
}

/// The barrier distance of each unit, 0 to 1.
fn barrier(analysis: &Analysis) -> Vec<f64> {
    let image = &analysis.image;
    let longer = image.width().max(image.height());
    let side = |length: usize| (length * BARRIER_SIDE / longer.max(BARRIER_SIDE)).max(1);
    let Ok(size) = Size::new(side(image.width()), side(image.height())) else {
        return vec![0.0; analysis.units[0] * analysis.units[1]];
    };
    let small: Image<LinearRgb> = resize(image, size, ResizeFilter::Box);
    let lab = small.convert::<Oklab>();
    let channels: Vec<Plane> = (0..3usize)
        .into_par_iter()
        .map(|channel| barrier_distance(&lab.map(|pixel| pixel.0[channel])))
        .collect();
    let total = Plane::from_fn(size, |col, row| {
        channels.iter().map(|plane| plane[(col, row)]).sum()
    });
    let open = opened(&total, OPENING);
    let mut sorted = open.pixels().to_vec();
    sorted.sort_by(f32::total_cmp);
    let quantile = |percent: usize| sorted[(sorted.len() - 1) * percent / 100];
    let ground = quantile(50);
    let full = (FULL_BARRIER * quantile(98)).max(ground + 1e-6);
    let scaled = open.map(|value| ((value - ground) / (full - ground)).clamp(0.0, 1.0));
    per_unit(&scaled, analysis)
        .into_iter()
        .map(f64::from)
        .collect()
}

/// The mean of a plane over each unit.
fn per_unit(plane: &Plane, analysis: &Analysis) -> Vec<f32> {
    let [cols, rows] = analysis.units;
    Size::new(cols, rows).map_or_else(
        |_| Vec::new(),
        |size| resize(plane, size, ResizeFilter::Box).into_pixels(),
    )
}
