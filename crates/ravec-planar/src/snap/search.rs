//! The moves of four corners that bring lines onto edges, tried all.

use crate::snap::SnapError;
use crate::snap::sites::{Profile, Sites};
use glam::DVec2;
use ravec_raster::Plane;
use rayon::prelude::*;

/// Pieces of a line that are told apart. The ends of a line move differently; within a piece the difference is a fraction
/// of the coarsest step.
const PIECES: usize = 16;

/// Moves of one corner to each side in the coarsest search: (2 · 4 + 1)⁴ moves of all corners are tried.
const HALF_MOVES: i32 = 4;

/// How much of the evidence the largest moves must bring more than none, to be preferred: a tie goes to the nearer one.
const NEARNESS: f64 = 0.02;

/// How likely there is an edge at each distance from each piece of each line.
pub(super) struct Evidence {
    /// `lines` × [`PIECES`] rows of 2 · `reach` + 1 values from 0 to 1, or empty rows for pieces outside the picture.
    rows: Vec<Vec<f32>>,
    influences: Vec<[f64; 8]>,
    lines: usize,
    reach: usize,
    /// What a line at any place finds.
    mean: f64,
}

impl Evidence {
    pub(super) fn gather(plane: &Plane, sites: &Sites, reach_px: f64) -> Result<Self, SnapError> {
        if sites.sites.is_empty() {
            return Err(SnapError::Outside);
        }
        let reach = reach_px.ceil() as usize;
        let slopes: Vec<Vec<f32>> = sites
            .sites
            .par_iter()
            .with_min_len(64)
            .map_init(
                || Profile::new(reach),
                |profile, site| {
                    profile.read(plane, site.at, site.normal);
                    profile.slopes.clone()
                },
            )
            .collect();
        let scale = edge_scale(slopes.iter().flatten().copied()).ok_or(SnapError::NoEdges)?;
        let mut rows = vec![Vec::new(); sites.lines * PIECES];
        let mut counts = vec![0usize; rows.len()];
        let mut influences = vec![[0.0; 8]; rows.len()];
        for (site, slopes) in sites.sites.iter().zip(&slopes) {
            let piece = ((site.along * PIECES as f64) as usize).min(PIECES - 1);
            let index = site.line * PIECES + piece;
            let row: &mut Vec<f32> = &mut rows[index];
            row.resize(2 * reach + 1, 0.0);
            for (sum, slope) in row.iter_mut().zip(slopes) {
                *sum += edgeness(*slope, scale);
            }
            for (sum, value) in influences[index].iter_mut().zip(site.influence) {
                *sum += value;
            }
            counts[index] += 1;
        }
        for ((row, influence), &count) in rows.iter_mut().zip(&mut influences).zip(&counts) {
            row.iter_mut().for_each(|value| *value /= count as f32);
            influence
                .iter_mut()
                .for_each(|value| *value /= count.max(1) as f64);
        }
        let filled: Vec<f32> = rows.iter().flatten().copied().collect();
        Ok(Self {
            mean: filled.iter().map(|&v| f64::from(v)).sum::<f64>() / filled.len() as f64,
            rows,
            influences,
            lines: sites.lines,
            reach,
        })
    }
}

/// How surely a slope is an edge, 0 to 1: one half at `scale`. It saturates, so that strong edges do not outvote many.
#[inline]
pub(super) fn edgeness(slope: f32, scale: f32) -> f32 {
    let square = slope * slope;
    square / (square + scale * scale)
}

/// The slope that counts half: three times the usual one, which is noise and texture, as most places are no edges. Nothing
/// if the picture is even or not finite everywhere.
pub(super) fn edge_scale(slopes: impl Iterator<Item = f32>) -> Option<f32> {
    let mut heights: Vec<f32> = slopes
        .map(f32::abs)
        .filter(|slope| slope.is_finite())
        .collect();
    let largest = heights.iter().fold(0.0f32, |a, &b| a.max(b));
    // a tenth of an encoded step of 255
    if heights.is_empty() || largest < 4e-4 {
        return None;
    }
    let middle = heights.len() / 2;
    let (_, median, _) = heights.select_nth_unstable_by(middle, f32::total_cmp);
    // a picture without noise has a median of 0
    Some((3.0 * *median).max(0.05 * largest))
}

/// The best moves.
pub(super) struct Moves {
    /// Of each corner along its direction, in pixels.
    pub by_px: [f64; 4],
    /// The evidence of all lines above what lines at any place find, less a share of the best line's for each.
    pub excess: f64,
}

/// A row of evidence with the influence of the four moves on it.
struct Row<'a> {
    weights: [f32; 4],
    values: &'a [f32],
}

/// Tries all moves of the four corners along their directions.
pub(super) fn best_moves(evidence: &Evidence, directions: &[DVec2; 4]) -> Moves {
    let weights: Vec<[f32; 4]> = evidence
        .influences
        .iter()
        .map(|influence| {
            std::array::from_fn(|k| {
                (influence[2 * k] * directions[k].x + influence[2 * k + 1] * directions[k].y) as f32
            })
        })
        .collect();
    let mut step = evidence.reach as f32 / HALF_MOVES as f32;
    let mut at = [0.0f32; 4];
    let mut half_moves = HALF_MOVES;
    loop {
        // peaks as wide as the step, so that none is stepped over
        let soft: Vec<Vec<f32>> = evidence
            .rows
            .iter()
            .map(|row| softened(row, 0.5 * step))
            .collect();
        let rows: Vec<Row<'_>> = soft
            .iter()
            .zip(&weights)
            .filter(|(values, _)| !values.is_empty())
            .map(|(values, &weights)| Row { weights, values })
            .collect();
        let penalty =
            NEARNESS as f32 * rows.len() as f32 / (evidence.reach * evidence.reach) as f32;
        // the coarse search covers everything; finer ones walk uphill
        for _ in 0..8 {
            let best = best_of_neighbours(&rows, evidence.reach, at, step, half_moves, penalty);
            let settled = best == at;
            at = best;
            if settled || half_moves > 1 {
                break;
            }
        }
        half_moves = 1;
        if step <= 1.0 {
            break;
        }
        step *= 0.5;
    }
    Moves {
        by_px: at.map(f64::from),
        excess: excess(evidence, &weights, at),
    }
}

/// The best of the (2 · half + 1)⁴ moves around `center`; `center` itself among equals.
fn best_of_neighbours(
    rows: &[Row<'_>],
    reach: usize,
    center: [f32; 4],
    step: f32,
    half: i32,
    penalty: f32,
) -> [f32; 4] {
    let choices: Vec<f32> = (-half..=half).map(|k| k as f32 * step).collect();
    let outer: Vec<(f32, f32)> = choices
        .iter()
        .flat_map(|&a| choices.iter().map(move |&b| (a, b)))
        .collect();
    let middle = reach as f32 + 0.5;
    let score = |moves: [f32; 4]| -> f32 {
        let sum: f32 = rows
            .iter()
            .map(|row| {
                let w = row.weights;
                let shift = w[0] * moves[0] + w[1] * moves[1] + w[2] * moves[2] + w[3] * moves[3];
                // casts saturate: places out of reach find the ends of the row, or nothing
                row.values
                    .get((shift + middle) as usize)
                    .copied()
                    .unwrap_or(0.0)
            })
            .sum();
        sum - penalty * moves.iter().map(|m| 0.25 * m * m).sum::<f32>()
    };
    let here = (score(center), center);
    outer
        .par_iter()
        .with_min_len(8)
        .map(|&(a, b)| {
            let mut best = here;
            for &(c, d) in &outer {
                let moves = [center[0] + a, center[1] + b, center[2] + c, center[3] + d];
                if moves.iter().any(|m| m.abs() > reach as f32) {
                    continue;
                }
                let found = score(moves);
                if found > best.0 {
                    best = (found, moves);
                }
            }
            best
        })
        .collect::<Vec<_>>()
        .into_iter()
        .fold(
            here,
            |best, found| if found.0 > best.0 { found } else { best },
        )
        .1
}

/// The mean over `radius` pixels to each side.
fn softened(row: &[f32], radius: f32) -> Vec<f32> {
    let radius = radius.round() as usize;
    if row.is_empty() || radius == 0 {
        return row.to_vec();
    }
    let mut sums = vec![0.0f32];
    for value in row {
        sums.push(sums[sums.len() - 1] + value);
    }
    (0..row.len())
        .map(|k| {
            let (low, high) = (k.saturating_sub(radius), (k + radius + 1).min(row.len()));
            (sums[high] - sums[low]) / (2 * radius + 1) as f32
        })
        .collect()
}

/// See [`Moves::excess`].
fn excess(evidence: &Evidence, weights: &[[f32; 4]], moves: [f32; 4]) -> f64 {
    let lines: Vec<f64> = (0..evidence.lines)
        .map(|line| {
            let mut sum = 0.0;
            for index in line * PIECES..(line + 1) * PIECES {
                let shift: f32 = weights[index].iter().zip(moves).map(|(w, m)| w * m).sum();
                let row = softened(&evidence.rows[index], 1.0);
                let at = (shift + evidence.reach as f32 + 0.5) as usize;
                sum += row.get(at).map_or(0.0, |&v| f64::from(v) - evidence.mean);
            }
            sum / PIECES as f64
        })
        .collect();
    let best = lines.iter().fold(0.0f64, |a, &b| a.max(b));
    // a line that finds less than a third of what the best one finds speaks against the count
    lines.iter().map(|line| line - best / 3.0).sum()
}
