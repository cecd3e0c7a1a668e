//! A grid that snaps to the edges below it.
//!
//! ```text
//! for the lines between columns, then for those between rows, twice, the second time nearer:
//!     read the picture across each line, everywhere along it; where its slope is steep there may be the edge
//!     try all moves of the four corners along the rows (the columns), coarsely, and keep the best
//!     halve the step and try the neighbors, until the step is below a pixel
//! move all eight coordinates so that the lines lie on the nearest slopes, by least squares
//! where lines lie on one edge of a joint, move them to its middle, and once more all coordinates
//! where little of the lines lies on edges, do so from that of the other good finds of the first round which lies on more, and keep
//!     what has most
//! ```
//!
//! Where inner lines lie depends on how much nearer one side is than the other, which is not known before both families
//! are found: it is tried as a fifth move, and forgotten afterwards.
//!
//! All moves can be tried because a small move of the corners shifts each place of a line by a fixed combination of the
//! moves, so that trying one is a sum over a table. That makes the search independent of where it starts, as long as the
//! edges are within reach.
//!
//! The search runs coarse to fine: at a level of the pyramid where the reach is one to two times [`COARSE_REACH_PX`], then with a
//! quarter of the reach at a finer level, down to the picture itself. The number of samples across a line therefore hardly grows
//! with the picture.
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers.
//!
//! Source: dissertation, section 6.2.1, whose blurred gradients are climbed from the start. We differ in that we search
//! before we climb: windows have parallel edges on all sides, and from three per cent off the nearest one is often wrong.
//!
//! Guarantees: equal pictures and parameters give equal bytes. Does not guarantee: that the edges found are those that were
//! meant, if others fit the grid as well; that a corner stays within the reach, which bounds the search along rows and
//! that along columns, each for itself, and not the second, nearer round.
//! Cost: some milliseconds; grows with the number of lines. Up to twice that where much is hidden. A pyramid of one level is
//! searched at its own size: then the cost grows with the length of the lines times the reach.

mod joint;
mod polish;
mod search;
mod sites;

use crate::homography::HomographyError;
use crate::quad_grid::QuadGrid;
use crate::snap::joint::centered;
use crate::snap::polish::{FINE, ROUGH, polish};
use crate::snap::search::{Evidence, best_moves};
use crate::snap::sites::{Family, Sites};
use glam::DVec2;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Plane, Pyramid};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Parameters of snapping.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SnapParams {
    /// Largest error of a corner that snapping corrects, as a share of the grid's longer diagonal, 0 to 0.2 (default
    /// 0.04). Larger forgives rougher quads, costs more, and finds other edges that fit; more than half a column or row
    /// is never needed.
    pub reach_rel: f64,
}

impl Default for SnapParams {
    fn default() -> Self {
        Self { reach_rel: 0.04 }
    }
}

/// A grid on edges.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapped {
    /// The moved grid.
    pub grid: QuadGrid,
    /// The share of its lines' length that lies on an edge, 0 to 1.
    pub support: f64,
}

/// Why a grid could not snap.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SnapError {
    /// Nothing of the grid lies in the picture.
    #[error("the grid lies outside the picture")]
    Outside,
    /// There are no edges near the lines.
    #[error(
        "there are no edges near the lines of the grid: place it closer to the lines of the picture"
    )]
    NoEdges,
    /// The edges would turn the grid inside out.
    #[error("the edges near the lines do not form a grid: {0}")]
    NoGrid(#[from] HomographyError),
    /// The work was cancelled.
    #[error("cancelled")]
    Cancelled,
}

impl From<Cancelled> for SnapError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

/// The reach of the second round, as a share of the first: what the straight-line picture of the first leaves open, and
/// what columns and rows take from each other.
const SECOND_REACH: f64 = 0.25;

/// Grids that are moved to edges, if the first is not clear.
const MAX_STARTS: usize = 3;

/// The support from which a grid is taken without trying others.
const CLEAR_SUPPORT: f64 = 0.9;

/// Counts of lines that are sought once more when the other family lies on its edges.
const MAX_COUNTS: usize = 6;

/// Finds whose corners are nearer to each other after the second search come to the same place in the end, in pixels.
const SAME_PX: f64 = 1.5;

/// The smallest reach in pixels: below it a search says nothing that the last step does not say better.
const MIN_REACH_PX: f64 = 4.0;

/// Reach in pixels of a reduced picture from which the next coarser one is taken, at twice that: fewer pixels blur edges that lie
/// side by side.
const COARSE_REACH_PX: f64 = 24.0;

/// Moves the corners of `grid` so that its lines fall on edges of `picture`, with values from 0 to 1 such as those of an
/// [`crate::encoded_luminance`], and its reductions.
///
/// # Errors
/// [`SnapError::Outside`], [`SnapError::NoEdges`], [`SnapError::NoGrid`], [`SnapError::Cancelled`].
///
/// ```
/// use glam::dvec2;
/// use ravec_planar::{QuadGrid, SnapParams, snap};
/// use ravec_progress::Progress;
/// use ravec_raster::{Plane, Pyramid, Reduction, Size};
///
/// // fields of 20 × 20 pixels from (30, 30) on
/// let checks = Plane::from_fn(Size::new(160, 140)?, |col, row| {
///     let field = |v: usize| (v + 70) / 20;
///     if (30..130).contains(&col) && (30..110).contains(&row) && (field(col) + field(row)) % 2 == 0 { 0.8 } else { 0.4 }
/// });
/// let rough = [dvec2(27.0, 32.0), dvec2(133.0, 28.0), dvec2(131.0, 113.0), dvec2(28.0, 107.0)];
/// let picture = Pyramid::new(checks, Reduction::Area);
/// let snapped = snap(&picture, &QuadGrid::new(rough, 5, 4)?, &SnapParams::default(), &Progress::none())?;
/// assert!(snapped.grid.corners()[2].distance(dvec2(130.0, 110.0)) < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn snap(
    picture: &Pyramid<f32>,
    grid: &QuadGrid,
    params: &SnapParams,
    progress: &Progress,
) -> Result<Snapped, SnapError> {
    let reach = reach_px(grid, params);
    let phase = progress.phase("snap", 3);
    let plane = picture.level(0);
    let mut starts = starts(picture, grid, reach, progress)?.into_iter();
    phase.advance(1);
    let rough = |start: QuadGrid| {
        let grid = nearer(picture, start, second_reach(reach), progress)?;
        on_edges(plane, &grid, progress)
    };
    let support = |of: &Result<Snapped, SnapError>| of.as_ref().map_or(-1.0, |of| of.support);
    let first = starts.next().map_or(Err(SnapError::NoEdges), rough);
    let mut best = (first.clone()).and_then(|first| settled(plane, &first.grid, progress));
    phase.advance(1);
    if support(&best) < CLEAR_SUPPORT {
        let others: Vec<QuadGrid> = starts.collect();
        let others: Vec<_> = others.into_par_iter().map(rough).collect();
        phase.advance(1);
        // the last steps cost most: they are taken from the one that lies best on edges so far
        let better = others
            .into_iter()
            .flatten()
            .filter(|other| other.support > support(&first))
            .reduce(|a, b| if b.support > a.support { b } else { a });
        let is_first = |other: &Snapped| {
            let first = first.as_ref();
            first.is_ok_and(|first| farthest(&first.grid, &other.grid) < SAME_PX)
        };
        if let Some(other) = better.filter(|other| !is_first(other)) {
            let found = settled(plane, &other.grid, progress);
            if best.is_err() || support(&found) > support(&best) {
                best = found;
            }
        }
    }
    progress.check()?;
    best
}

/// The largest distance of two corners, in pixels.
fn farthest(a: &QuadGrid, b: &QuadGrid) -> f64 {
    let pairs = a.corners().into_iter().zip(b.corners());
    pairs.map(|(a, b)| a.distance(b)).fold(0.0, f64::max)
}

/// Candidates for the grid, from a search within the whole reach, the likeliest first.
fn starts(
    picture: &Pyramid<f32>,
    grid: &QuadGrid,
    reach: f64,
    progress: &Progress,
) -> Result<Vec<QuadGrid>, SnapError> {
    progress.check()?;
    let columns = search(picture, grid, Family::Columns, reach)?;
    let moved = &columns[0].grid;
    progress.check()?;
    let rows = search(picture, moved, Family::Rows, reach)?;
    let mut pairs: Vec<(usize, usize)> = (0..columns.len())
        .flat_map(|column| (0..rows.len()).map(move |row| (column, row)))
        .collect();
    pairs.sort_by_key(|&(column, row)| column + row);
    let mut starts = Vec::new();
    for (column, row) in pairs.into_iter().take(MAX_STARTS) {
        // rows were sought with the best columns; their moves are much the same with the others
        let (to, by) = (columns[column].grid.corners(), rows[row].grid.corners());
        let corners = std::array::from_fn(|k| to[k] + by[k] - moved.corners()[k]);
        starts.extend(QuadGrid::new(corners, grid.columns(), grid.rows()));
    }
    Ok(starts)
}

/// The grid on what the second, nearer search finds, and those after it until one reads the picture itself.
fn nearer(
    picture: &Pyramid<f32>,
    mut grid: QuadGrid,
    mut reach: f64,
    progress: &Progress,
) -> Result<QuadGrid, SnapError> {
    loop {
        for family in [Family::Columns, Family::Rows] {
            progress.check()?;
            grid = search(picture, &grid, family, reach)?.swap_remove(0).grid;
        }
        if level_for(picture, reach) == 0 {
            return Ok(grid);
        }
        reach = second_reach(reach);
    }
}

/// The level of a picture in which a search with a reach is made.
fn level_for(picture: &Pyramid<f32>, reach_px: f64) -> usize {
    let level = (reach_px / COARSE_REACH_PX).log2().floor().max(0.0);
    (level as usize).min(picture.levels().len() - 1)
}

/// The grid on the edges near its lines, roughly.
fn on_edges(plane: &Plane, grid: &QuadGrid, progress: &Progress) -> Result<Snapped, SnapError> {
    progress.check()?;
    polish(plane, grid, [None; 2], &ROUGH)
}

/// A grid on edges, moved to the middle of the joints that these edges are sides of, and to the last fraction of a pixel.
fn settled(plane: &Plane, on_edges: &QuadGrid, progress: &Progress) -> Result<Snapped, SnapError> {
    let mut grid = on_edges.clone();
    let mut joints = [None; 2];
    for (joint, family) in joints.iter_mut().zip([Family::Columns, Family::Rows]) {
        progress.check()?;
        (grid, *joint) = centered(plane, &grid, family)?;
    }
    if grid != *on_edges {
        grid = polish(plane, &grid, joints, &ROUGH)?.grid;
    }
    polish(plane, &grid, joints, &FINE)
}

/// As [`snap`], with the columns and rows sought as well, within the given ranges (1 to some 40).
///
/// The counts are those whose lines find the most edges, where a line without one counts against them.
///
/// # Errors
/// As [`snap`]; [`SnapError::NoEdges`] also for an empty range.
pub fn snap_counting(
    picture: &Pyramid<f32>,
    grid: &QuadGrid,
    columns: RangeInclusive<u32>,
    rows: RangeInclusive<u32>,
    params: &SnapParams,
    progress: &Progress,
) -> Result<Snapped, SnapError> {
    let reach = reach_px(grid, params);
    let mut found = grid.clone();
    let mut counts = [columns, rows].map(Iterator::collect::<Vec<u32>>);
    // each family is moved by what was found for the other before, or its lines would end in the wrong places
    for reach in [reach, second_reach(reach)] {
        for (family, counts) in [Family::Columns, Family::Rows].into_iter().zip(&mut counts) {
            let mut sought = Vec::new();
            for &count in counts.iter() {
                progress.check()?;
                let divided = match family {
                    Family::Columns => found.divided(count, found.rows())?,
                    Family::Rows => found.divided(found.columns(), count)?,
                };
                sought.push(search(picture, &divided, family, reach)?.swap_remove(0));
            }
            let mut order: Vec<usize> = (0..sought.len()).collect();
            order.sort_by(|&a, &b| sought[b].excess.total_cmp(&sought[a].excess));
            order.truncate(MAX_COUNTS);
            *counts = order.iter().map(|&index| counts[index]).collect();
            let best = order.first().ok_or(SnapError::NoEdges)?;
            found = sought.swap_remove(*best).grid;
        }
    }
    snap(
        picture,
        &found,
        &SnapParams {
            reach_rel: SECOND_REACH * params.reach_rel,
        },
        progress,
    )
}

fn reach_px(grid: &QuadGrid, params: &SnapParams) -> f64 {
    (params.reach_rel.clamp(0.0, 0.2) * grid.diagonal_px()).max(MIN_REACH_PX)
}

/// The reach of the second search, in pixels.
fn second_reach(reach_px: f64) -> f64 {
    (SECOND_REACH * reach_px).max(MIN_REACH_PX)
}

/// A grid on edges of one family, and by how much these exceed what any line would find.
struct Sought {
    grid: QuadGrid,
    excess: f64,
}

/// The grid with its corners moved along the rows (for lines between columns; else along the columns) to where the lines
/// of the family find the most edges: a few places, the best first.
fn search(
    picture: &Pyramid<f32>,
    grid: &QuadGrid,
    family: Family,
    reach_px: f64,
) -> Result<Vec<Sought>, SnapError> {
    let level = level_for(picture, reach_px);
    let plane = picture.level(level);
    let reduction = (1_u64 << level) as f64;
    let corners = grid.corners().map(|at| at / reduction);
    let grid = &QuadGrid::new(corners, grid.columns(), grid.rows())?;
    let reach_px = reach_px / reduction;
    let sites = Sites::new(grid, Some(family), plane.size());
    let reach_px = sites.reach_within(plane.size(), reach_px).max(MIN_REACH_PX);
    let evidence = Evidence::gather(plane, &sites, reach_px)?;
    let (along, across) = (directions(grid, family), directions(grid, family.other()));
    let mut modes = [[0.0; 8]; 5];
    for corner in 0..4 {
        modes[corner][2 * corner] = along[corner].x;
        modes[corner][2 * corner + 1] = along[corner].y;
        // one side longer, the opposite one shorter: the lines between shift towards the shorter one
        let longer = if corner % 2 == 0 {
            -across[corner]
        } else {
            across[corner]
        };
        modes[4][2 * corner] = longer.x;
        modes[4][2 * corner + 1] = longer.y;
    }
    let mut found = Vec::new();
    for moves in best_moves(&evidence, &modes, second_reach(reach_px)) {
        let corners = grid.corners();
        let corners = std::array::from_fn(|k| (corners[k] + along[k] * moves.by_px[k]) * reduction);
        match QuadGrid::new(corners, grid.columns(), grid.rows()) {
            Ok(grid) => found.push(Sought {
                grid,
                excess: moves.excess,
            }),
            Err(error) if found.is_empty() => return Err(error.into()),
            Err(_) => {}
        }
    }
    Ok(found)
}

/// Along which direction each corner moves: its row for lines between columns, its column for lines between rows.
fn directions(grid: &QuadGrid, family: Family) -> [DVec2; 4] {
    let [a, b, c, d] = grid.corners();
    match family {
        Family::Columns => [b - a, b - a, c - d, c - d],
        Family::Rows => [d - a, c - b, c - b, d - a],
    }
    .map(DVec2::normalize_or_zero)
}
