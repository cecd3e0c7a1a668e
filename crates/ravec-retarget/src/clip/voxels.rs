//! Two-color voxels of a slab of time: where an edge moves against the camera's motion, and how strong it is.
//!
//! ```text
//! carry the samples of the slab to one frame
//! a cell whose colors stay within the noise is one voxel as deep as the slab, which its two-color pixel in one frame shows
//! the others are fitted: a plane in space and time, twice with half the depth where one plane explains too little
//! the speed of an edge is the slope of its plane
//! ```
//!
//! Cells that stand cost one comparison a voxel; only the others are fitted.

use super::options::mapped;
use super::sample::Sample;
use super::world::Carry;
use crate::importance::FULL_CONTRAST;
use crate::params::RetargetError;
use ravec_progress::Progress;
use ravec_raster::{Image, Oklab, Size};
use ravec_twocolor::volume::{TwoColorVolume, TwoColorVoxel, VolumeError, VolumeParams};
use rayon::prelude::*;

/// The side of a voxel in pixels of the reduction, which is that of a cell of the default grid. Smaller ones hold too few
/// pixels for a plane, larger ones hold more than one edge.
const SIDE: usize = 6;

/// A cell moves if its temporal variance exceeds that of the quietest quarter of all cells by this factor, which noise alone
/// does in one of many thousand cells.
const ABOVE_NOISE: f32 = 8.0;

/// Variance that no eye sees move, in Oklab squared.
const LEAST_VARIANCE: f32 = 2e-5;

/// The share of a cell's variance that one plane may leave; beyond, voxels of half the depth are fitted.
const UNEXPLAINED: f32 = 0.3;

/// Contrast across a moving edge from which on it counts, and from which on it counts in full.
const MOVING_CONTRAST: [f64; 2] = [0.03, 0.1];

/// Speed of a moving edge, in pixels of the reduction a frame, likewise: less is
/// leaves in the wind and drift of the estimated camera.
const MOVING_SPEED: [f64; 2] = [0.25, 0.75];

/// Share of moving cells up to which motion stands out, and from which on it does not: then the camera's motion is not known,
/// or all of the scene moves.
const MOVING_SHARE: [f64; 2] = [0.35, 0.6];

/// Measurements on the voxels of a slab.
pub(super) struct SlabMotion {
    /// The contrast of moving edges in each unit, 0 to 1.
    pub(super) contrast: Vec<f64>,
    /// For each sample how much each unit stands out by its motion, 0 to 1.
    pub(super) motion: Vec<Vec<f64>>,
    /// Cells that were fitted as moving, and all.
    pub(super) moving: usize,
    pub(super) cells: usize,
}

/// Measures a slab. `carries` map points of the frame of reference to the frame of each sample, in pixels of the frame.
pub(super) fn slab_motion(
    samples: &[Sample],
    carries: &[Carry],
    frame_size: Size,
    units: [usize; 2],
    sample_frames: usize,
    progress: &Progress,
) -> Result<SlabMotion, RetargetError> {
    let none = SlabMotion {
        contrast: vec![0.0; units[0] * units[1]],
        motion: vec![vec![0.0; units[0] * units[1]]; samples.len()],
        moving: 0,
        cells: 0,
    };
    let small = samples[0].small.size();
    let cells = [small.width() / SIDE, small.height() / SIDE];
    if samples.len() < 2 || cells.contains(&0) {
        return Ok(none);
    }
    let carried: Vec<Option<Image<Oklab>>> = samples
        .par_iter()
        .zip(carries)
        .map(|(sample, carry)| {
            let matrix = (*carry)?;
            Some(carried(&sample.small, &matrix, frame_size))
        })
        .collect();
    let images: Vec<&Image<Oklab>> = carried
        .iter()
        .zip(samples)
        .map(|(carried, sample)| carried.as_ref().unwrap_or(&sample.small))
        .collect();
    let variances: Vec<f32> = (0..cells[0] * cells[1])
        .into_par_iter()
        .map(|cell| variance(&images, cell % cells[0], cell / cells[0]))
        .collect();
    let mut sorted: Vec<f32> = variances.iter().copied().filter(|v| !v.is_nan()).collect();
    if sorted.is_empty() {
        return Ok(none);
    }
    sorted.sort_by(f32::total_cmp);
    let least = (ABOVE_NOISE * sorted[sorted.len() / 4]).max(LEAST_VARIANCE);
    let moving: Vec<usize> = (0..variances.len())
        .filter(|&cell| variances[cell] > least)
        .collect();
    progress.check()?;
    let edges = fitted(&images, &moving, cells[0], &variances, progress)?;
    let share = moving.len() as f64 / variances.len() as f64;
    let stands_out = 1.0 - ramp(share, MOVING_SHARE);
    let mut contrast = vec![0.0f64; variances.len()];
    let mut motion = vec![vec![0.0f64; variances.len()]; samples.len()];
    for (&cell, edge) in moving.iter().zip(&edges) {
        contrast[cell] = (edge.contrast / f64::from(FULL_CONTRAST)).min(1.0);
        let speed = edge.speed / sample_frames as f64;
        let value = stands_out * ramp(edge.contrast, MOVING_CONTRAST) * ramp(speed, MOVING_SPEED);
        if value > 0.0 {
            let active = activity(&images, cell % cells[0], cell / cells[0]);
            for (motion, active) in motion.iter_mut().zip(active) {
                motion[cell] = if active { value } else { 0.0 };
            }
        }
    }
    Ok(SlabMotion {
        contrast: per_unit(&contrast, cells, small, units),
        motion: motion
            .iter()
            .map(|motion| per_unit(motion, cells, small, units))
            .collect(),
        moving: moving.len(),
        cells: variances.len(),
    })
}

fn ramp(value: f64, [low, high]: [f64; 2]) -> f64 {
    ((value - low) / (high - low)).clamp(0.0, 1.0)
}

/// A reduction as seen from the frame of reference; NaN where that sees more.
fn carried(small: &Image<Oklab>, sample_from_reference: &glam::DMat3, frame: Size) -> Image<Oklab> {
    let (width, height) = (small.width() as f64, small.height() as f64);
    let scale = glam::dvec2(frame.width() as f64 / width, frame.height() as f64 / height);
    let mut result = small.clone();
    result.for_each_row(|row, out| {
        for (col, out) in out.iter_mut().enumerate() {
            let middle = glam::dvec2(col as f64 + 0.5, row as f64 + 0.5);
            let at = mapped(sample_from_reference, middle * scale).map(|at| at / scale);
            *out = match at
                .filter(|at| at.x >= 0.0 && at.y >= 0.0 && at.x <= width && at.y <= height)
            {
                Some(at) => small.bilinear(at),
                None => Oklab([f32::NAN; 3]),
            };
        }
    });
    result
}

/// The mean squared distance of the colors of a cell's pixels from their means over time; NaN where a sample lacks some.
fn variance(images: &[&Image<Oklab>], col: usize, row: usize) -> f32 {
    let share = 1.0 / images.len() as f32;
    let mut sum = 0.0;
    for y in row * SIDE..(row + 1) * SIDE {
        for x in col * SIDE..(col + 1) * SIDE {
            for channel in 0..3 {
                // from the first color on, so that colors that stay have no variance
                let first = images[0][(x, y)].0[channel];
                let (mut total, mut squares) = (0.0, 0.0);
                for image in images {
                    let away = image[(x, y)].0[channel] - first;
                    total += away;
                    squares += away * away;
                }
                sum += share * (squares - share * total * total);
            }
        }
    }
    sum / (SIDE * SIDE) as f32
}

/// The share of the largest change from sample to sample that an edge in a cell makes at least.
const ACTIVE: f32 = 0.25;

/// For each sample whether the cell changes before or after it.
fn activity(images: &[&Image<Oklab>], col: usize, row: usize) -> Vec<bool> {
    let changes: Vec<f32> = images
        .windows(2)
        .map(|pair| {
            let mut sum = 0.0;
            for y in row * SIDE..(row + 1) * SIDE {
                for x in col * SIDE..(col + 1) * SIDE {
                    let [a, b] = [0, 1].map(|k: usize| pair[k][(x, y)].0);
                    sum += (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>();
                }
            }
            sum
        })
        .collect();
    let least = ACTIVE * changes.iter().copied().fold(0.0, f32::max);
    (0..images.len())
        .map(|k| {
            let around = k.saturating_sub(1)..(k + 1).min(changes.len());
            changes[around].iter().any(|&change| change >= least)
        })
        .collect()
}

/// The edge of a moving cell.
#[derive(Debug, Clone, Copy, Default)]
struct MovingEdge {
    contrast: f64,
    /// In pixels of the reduction a sample.
    speed: f64,
}

/// Fits the `moving` cells of a grid of `cols` columns.
fn fitted(
    images: &[&Image<Oklab>],
    moving: &[usize],
    cols: usize,
    variances: &[f32],
    progress: &Progress,
) -> Result<Vec<MovingEdge>, RetargetError> {
    let whole = fit(images, moving, cols, progress)?;
    let mut edges: Vec<MovingEdge> = whole.iter().map(MovingEdge::of).collect();
    let half = images.len() / 2;
    let again: Vec<usize> = (0..moving.len())
        .filter(|&k| half >= 2 && whole[k].error > UNEXPLAINED * variances[moving[k]])
        .collect();
    let cells: Vec<usize> = again.iter().map(|&k| moving[k]).collect();
    for part in [&images[..half], &images[half..]] {
        if again.is_empty() {
            break;
        }
        for (&k, voxel) in again.iter().zip(fit(part, &cells, cols, progress)?) {
            let edge = MovingEdge::of(&voxel);
            edges[k].contrast = edges[k].contrast.max(edge.contrast);
            edges[k].speed = edges[k].speed.max(edge.speed);
        }
    }
    Ok(edges)
}

impl MovingEdge {
    fn of(voxel: &TwoColorVoxel) -> Self {
        if voxel.is_flat() {
            return Self::default();
        }
        let [a, b] = voxel.colors.map(|color| color.0);
        let squares = [0, 1, 2].map(|k: usize| f64::from(a[k] - b[k]).powi(2));
        Self {
            contrast: squares.iter().sum::<f64>().sqrt(),
            // what is here in one sample and gone in the next is faster than a cell a sample
            speed: voxel.velocity_px().map_or(SIDE as f64, f64::abs),
        }
    }
}

/// One voxel for each of `cells`, as deep as there are images.
fn fit(
    images: &[&Image<Oklab>],
    cells: &[usize],
    cols: usize,
    progress: &Progress,
) -> Result<Vec<TwoColorVoxel>, RetargetError> {
    let Ok(size) = Size::new(cells.len() * SIDE, SIDE) else {
        return Ok(Vec::new());
    };
    // voxels do not know their neighbors: the cells are put side by side
    let strips: Vec<Image<Oklab>> = images
        .iter()
        .map(|image| {
            Image::from_fn(size, |x, y| {
                let cell = cells[x / SIDE];
                image[(cell % cols * SIDE + x % SIDE, cell / cols * SIDE + y)]
            })
        })
        .collect();
    let params = VolumeParams {
        block_px: SIDE,
        block_frames: images.len(),
        // of the plainest edges, which are those that count, one start is enough
        starts: 1,
        ..VolumeParams::default()
    };
    match TwoColorVolume::fit(&strips, &params, progress) {
        Ok(volume) => Ok((0..cells.len())
            .map(|col| *volume.block(col, 0, 0))
            .collect()),
        Err(VolumeError::Cancelled(cancelled)) => Err(cancelled.into()),
        // the parameters are in range and all strips have one size
        Err(_) => Err(RetargetError::Singular),
    }
}

/// The largest value of the cells that meet each unit.
fn per_unit(values: &[f64], cells: [usize; 2], small: Size, [cols, rows]: [usize; 2]) -> Vec<f64> {
    let meets = |k: usize, units: usize, length: usize, count: usize| {
        let first = k * length / units / SIDE;
        let end = ((k + 1) * length).div_ceil(units).div_ceil(SIDE);
        first.min(count - 1)..end.min(count).max(first.min(count - 1) + 1)
    };
    (0..cols * rows)
        .map(|unit| {
            let across = meets(unit % cols, cols, small.width(), cells[0]);
            meets(unit / cols, rows, small.height(), cells[1])
                .flat_map(|row| across.clone().map(move |col| row * cells[0] + col))
                .map(|cell| values[cell])
                .fold(0.0, f64::max)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [200, 112];
    const UNITS: [usize; 2] = [32, 18];

    /// Samples of a disc that moves by `speed` pixels a sample over a ground, with noise.
    fn samples(count: usize, speed: f64, noise: f32) -> Vec<Sample> {
        (0..count)
            .map(|frame| Sample {
                frame,
                small: Image::from_fn(Size::new(SIZE[0], SIZE[1]).unwrap(), |col, row| {
                    let x = 60.0 + speed * frame as f64;
                    let inside = (col as f64 - x).hypot(row as f64 - 56.0) < 16.0;
                    let mixed = (col * 7919 + row * 104_729 + frame * 15_485_863) as u32;
                    let random = (mixed.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
                    let ground = if col > 150 { 0.6 } else { 0.8 };
                    let light = if inside { 0.4 } else { ground };
                    Oklab([light + noise * (random - 0.5), 0.0, 0.0])
                }),
            })
            .collect()
    }

    fn measured(samples: &[Sample]) -> SlabMotion {
        let frame = Size::new(SIZE[0], SIZE[1]).unwrap();
        let carries = vec![None; samples.len()];
        slab_motion(samples, &carries, frame, UNITS, 1, &Progress::none()).unwrap()
    }

    #[test]
    fn only_the_rim_of_a_moving_disc_moves() {
        let found = measured(&samples(8, 1.0, 0.02));
        let largest: Vec<f64> = (0..UNITS[0] * UNITS[1])
            .map(|unit| found.motion.iter().map(|m| m[unit]).fold(0.0, f64::max))
            .collect();
        for (unit, (&motion, &contrast)) in largest.iter().zip(&found.contrast).enumerate() {
            let at = [(unit % 32) as f64 + 0.5, (unit / 32) as f64 + 0.5];
            let (x, y) = (at[0] * 200.0 / 32.0, at[1] * 112.0 / 18.0);
            // from the first to the last place of the center
            let away = ((x - x.clamp(60.0, 67.0)).hypot(y - 56.0) - 16.0).abs();
            if away > 14.0 && (x - 63.5).hypot(y - 56.0) > 16.0 {
                assert_eq!((motion, contrast), (0.0, 0.0), "{x} {y}");
            }
        }
        let front = 9 * 32 + 13;
        assert!(largest[front] > 0.9 && found.contrast[front] > 0.9);
        assert!(found.moving > 10 && found.moving < 120 && found.cells == 33 * 18);
    }

    #[test]
    fn a_place_stands_out_while_the_edge_passes() {
        // the front of the disc passes from 76 to 132, a cell in three samples
        let found = measured(&samples(16, 4.0, 0.0));
        let row = 9 * UNITS[0];
        for (sample, motion) in found.motion.iter().enumerate() {
            for (col, &value) in motion[row..row + UNITS[0]].iter().enumerate() {
                let x = (col as f64 + 0.5) * 200.0 / 32.0;
                let center = 60.0 + 4.0 * sample as f64;
                let away = ((x - center).abs() - 16.0).abs();
                if away > 20.0 {
                    assert_eq!(value, 0.0, "sample {sample}, {x}");
                } else if away < 1.0 {
                    assert!(value > 0.9, "sample {sample}, {x}: {value}");
                }
            }
        }
    }

    #[test]
    fn what_stands_has_no_voxel_to_fit() {
        let found = measured(&samples(8, 0.0, 0.02));
        assert_eq!(found.moving, 0);
        assert!(found.motion.iter().flatten().all(|&v| v == 0.0));
    }

    #[test]
    fn what_the_camera_moves_stands() {
        // the camera follows the disc: content moves by 2 pixels to the left in each frame
        let frame = Size::new(SIZE[0], SIZE[1]).unwrap();
        let moved: Vec<Sample> = (0..6)
            .map(|frame| Sample {
                frame,
                small: Image::from_fn(Size::new(SIZE[0], SIZE[1]).unwrap(), |col, row| {
                    let x = (col + 2 * frame) as f64;
                    let inside = (x - 90.0).hypot(row as f64 - 56.0) < 16.0;
                    Oklab([if inside { 0.4 } else { 0.8 }, 0.0, 0.0])
                }),
            })
            .collect();
        let carries: Vec<Carry> = (0..6)
            .map(|k| {
                Some(glam::DMat3::from_translation(glam::dvec2(
                    -2.0 * f64::from(k),
                    0.0,
                )))
            })
            .collect();
        let none = Progress::none();
        let found = slab_motion(&moved, &carries, frame, UNITS, 1, &none).unwrap();
        assert_eq!(found.moving, 0);
        let without = slab_motion(&moved, &[None; 6], frame, UNITS, 1, &none).unwrap();
        assert!(without.moving > 20, "{}", without.moving);
    }

    #[test]
    fn a_scene_that_moves_as_a_whole_has_nothing_that_stands_out() {
        let all: Vec<Sample> = (0..6)
            .map(|frame| Sample {
                frame,
                small: Image::from_fn(Size::new(SIZE[0], SIZE[1]).unwrap(), |col, row| {
                    let stripe = (col + row + 2 * frame) / 6 % 2 == 0;
                    Oklab([if stripe { 0.4 } else { 0.8 }, 0.0, 0.0])
                }),
            })
            .collect();
        let found = measured(&all);
        assert!(found.motion.iter().flatten().all(|&v| v == 0.0));
    }
}
