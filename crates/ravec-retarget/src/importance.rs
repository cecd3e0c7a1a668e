//! Importance: the weight with which each unit of the grid keeps its shape.
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
pub(crate) const FULL_CONTRAST: f32 = 0.25;

/// Share of contrast along a straight run that counts: lines are held by themselves, and need no stiff cells.
const RUN_SHARE: f32 = 0.2;

/// Weight of contrast against the barrier. More keeps thin figures that the barrier loses, and textured ground.
const CONTRAST_SHARE: f64 = 0.25;

/// The importance of each unit, 0 to 1.
pub(crate) fn importance(analysis: &Analysis, runs: &[Run], saliency: f64) -> Vec<f64> {
    let contrast = contrast(analysis, runs);
    let barrier = if saliency > 0.0 {
        barrier(analysis)
    } else {
        vec![0.0; contrast.len()]
    };
    let mixed = barrier.into_iter().zip(contrast);
    mixed
        .map(|(b, c)| mixed_importance(b, f64::from(c), saliency))
        .collect()
}

/// The importance of a unit from its barrier distance and its contrast.
pub(crate) fn mixed_importance(barrier: f64, contrast: f64, saliency: f64) -> f64 {
    1.0 - (1.0 - saliency * barrier) * (1.0 - CONTRAST_SHARE * contrast)
}

/// The mean contrast of the blocks of each unit, 0 to 1.
pub(crate) fn contrast(analysis: &Analysis, runs: &[Run]) -> Vec<f32> {
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
pub(crate) fn barrier(analysis: &Analysis) -> Vec<f64> {
    let image = &analysis.image;
    let Some(size) = barrier_size(image.size()) else {
        return vec![0.0; analysis.units[0] * analysis.units[1]];
    };
    let small: Image<LinearRgb> = resize(image, size, ResizeFilter::Box);
    barrier_of(&small.convert::<Oklab>(), analysis.units)
}

/// The size of the reduction for the barrier distance.
pub(crate) fn barrier_size(size: Size) -> Option<Size> {
    let longer = size.width().max(size.height());
    let side = |length: usize| (length * BARRIER_SIDE / longer.max(BARRIER_SIDE)).max(1);
    Size::new(side(size.width()), side(size.height())).ok()
}

/// The barrier distance of each of `units` from the reduction of a picture, 0 to 1.
pub(crate) fn barrier_of(lab: &Image<Oklab>, units: [usize; 2]) -> Vec<f64> {
    let channels: Vec<Plane> = (0..3usize)
        .into_par_iter()
        .map(|channel| barrier_distance(&lab.map(|pixel| pixel.0[channel])))
        .collect();
    let total = Plane::from_fn(lab.size(), |col, row| {
        channels.iter().map(|plane| plane[(col, row)]).sum()
    });
    let open = opened(&total, OPENING);
    let mut values = open.pixels().to_vec();
    let mut quantile = |percent: usize| {
        let place = (values.len() - 1) * percent / 100;
        *values.select_nth_unstable_by(place, f32::total_cmp).1
    };
    let ground = quantile(50);
    let full = (FULL_BARRIER * quantile(98)).max(ground + 1e-6);
    let scaled = open.map(|value| ((value - ground) / (full - ground)).clamp(0.0, 1.0));
    per_unit(&scaled, units).into_iter().map(f64::from).collect()
}

/// The mean of a plane over each of `units`.
fn per_unit(plane: &Plane, [cols, rows]: [usize; 2]) -> Vec<f32> {
    Size::new(cols, rows).map_or_else(
        |_| Vec::new(),
        |size| resize(plane, size, ResizeFilter::Box).into_pixels(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec2;
    use ravec_progress::Progress;

    const UNITS: [usize; 2] = [60, 40];

    /// A picture of 960 × 640 pixels, 16 a unit, in Oklab as seen at the middle of each pixel.
    fn analyzed(color: impl Fn(f64, f64) -> [f32; 3]) -> Analysis {
        let size = Size::new(960, 640).unwrap();
        let drawn = Image::from_fn(size, |col, row| {
            Oklab(color(col as f64 + 0.5, row as f64 + 0.5))
        });
        Analysis::new(&drawn.convert::<LinearRgb>(), UNITS, &Progress::none()).unwrap()
    }

    const GROUND: [f32; 3] = [0.8, 0.0, 0.0];
    const FIGURE: [f32; 3] = [0.5, 0.15, 0.1];

    /// A disc in the left half, away from the border, and how far the middle of a unit is outside of it.
    fn disc(x: f64, y: f64) -> f64 {
        (x - 320.0).hypot(y - 320.0) - 150.0
    }

    fn beyond(unit: usize) -> f64 {
        let at = [unit % UNITS[0], unit / UNITS[0]].map(|k| 16.0 * k as f64 + 8.0);
        disc(at[0], at[1])
    }

    fn scene() -> Analysis {
        analyzed(|x, y| if disc(x, y) < 0.0 { FIGURE } else { GROUND })
    }

    #[test]
    fn a_figure_counts_inside_as_well_as_at_its_rim_and_the_ground_does_not() {
        let found = importance(&scene(), &[], 1.0);
        assert_eq!(found.len(), UNITS[0] * UNITS[1]);
        for (unit, &value) in found.iter().enumerate() {
            assert!((0.0..=1.0).contains(&value));
            // the opening and the reduction round the rim off, over two units
            if beyond(unit) < -32.0 {
                assert!(value > 0.95, "inside, unit {unit}: {value}");
            } else if beyond(unit) > 48.0 {
                assert!(value < 0.02, "outside, unit {unit}: {value}");
            }
        }
    }

    #[test]
    fn without_saliency_only_contrast_counts() {
        for (unit, value) in importance(&scene(), &[], 0.0).into_iter().enumerate() {
            assert!(value <= CONTRAST_SHARE);
            if beyond(unit).abs() > 24.0 {
                assert!(value < 0.005, "away from the rim, unit {unit}: {value}");
            }
        }
    }

    #[test]
    fn half_the_saliency_is_half_the_importance_of_an_even_inside() {
        let analysis = scene();
        let inside = (0..UNITS[0] * UNITS[1]).filter(|&unit| beyond(unit) < -48.0);
        let (half, full) = (
            importance(&analysis, &[], 0.5),
            importance(&analysis, &[], 1.0),
        );
        for unit in inside {
            // the contrast of an even inside is that of rounding
            assert!((half[unit] - 0.5 * full[unit]).abs() < 0.005, "unit {unit}");
        }
    }

    #[test]
    fn contrast_along_a_run_counts_a_fifth() {
        let analysis = analyzed(|_, y| if y < 325.0 { FIGURE } else { GROUND });
        let y = 325.0 * analysis.image.height() as f64 / 640.0;
        let run = Run {
            ends: [dvec2(0.0, y), dvec2(0.5 * analysis.image.width() as f64, y)],
        };
        let [free, held] = [&[][..], &[run]].map(|runs| importance(&analysis, runs, 0.0));
        let row = 20 * UNITS[0];
        for col in 0..UNITS[0] {
            let (free, held) = (free[row + col], held[row + col]);
            assert!(free > 0.05, "column {col}: {free}");
            if col < 29 {
                assert!(
                    (held - f64::from(RUN_SHARE) * free).abs() < 1e-6,
                    "column {col}: {held} of {free}"
                );
            } else if col > 31 {
                assert_eq!(held, free, "column {col}");
            }
        }
    }

    #[test]
    fn an_even_picture_has_nothing_that_matters() {
        let found = importance(&analyzed(|_, _| GROUND), &[], 1.0);
        assert!(found.iter().all(|&value| value < 1e-3), "{found:?}");
    }
}
