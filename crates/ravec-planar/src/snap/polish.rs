//! The last fraction of a pixel: lines on slopes by least squares.

use crate::quad_grid::QuadGrid;
use crate::snap::joint::Joint;
use crate::snap::search::{edge_scale, edgeness, steepest};
use crate::snap::sites::{Family, Profile, Site, Sites};
use crate::snap::{SnapError, Snapped};
use glam::dvec2;
use ravec_numeric::NormalEquations;
use ravec_raster::Plane;
use rayon::prelude::*;

/// A step of the last fraction of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Round {
    /// Search radius for edges, in pixels: the search leaves about one pixel.
    reach: usize,
    /// One site in this number is examined, if there are plenty: far from the end the others say the same.
    every: usize,
    /// Corners that move by less, in pixels, need no further round of this reach.
    settled_px: f64,
}

const fn round(reach: usize, every: usize, settled_px: f64) -> Round {
    Round {
        reach,
        every,
        settled_px,
    }
}

/// From about two pixels off to a tenth.
pub(super) const ROUGH: [Round; 8] = [
    round(4, 3, 0.1),
    round(4, 3, 0.1),
    round(3, 3, 0.05),
    round(3, 3, 0.05),
    round(2, 3, 0.005),
    round(2, 3, 0.005),
    round(2, 3, 0.005),
    round(2, 3, 0.005),
];

/// The rest of the way.
pub(super) const FINE: [Round; 4] = [round(2, 1, 0.005); 4];

/// Sites that are enough to look at: fewer are not thinned out.
const ENOUGH_SITES: usize = 1000;

/// The blur across lines, in pixels: enough against the pixel grid and noise, without mixing neighboring edges.
const SIGMA_PX: f64 = 1.0;

/// Moves are held back by this share of the mean weight: a corner that no edge determines stays where it is.
const HOLD: f64 = 1e-4;

/// The grid with each line on the steepest slopes near it, or in the middle of the `joints` that lines between columns and
/// between rows are.
pub(super) fn polish(
    plane: &Plane,
    grid: &QuadGrid,
    joints: [Option<Joint>; 2],
    rounds: &[Round],
) -> Result<Snapped, SnapError> {
    let mut grid = grid.clone();
    let mut support = 0.0;
    let mut settled = 0;
    for &Round {
        reach,
        every,
        settled_px,
    } in rounds
    {
        if settled == reach {
            continue;
        }
        let all = Sites::new(&grid, None, plane.size());
        let sites = thinned(&all.sites, every);
        if sites.is_empty() {
            return Err(SnapError::Outside);
        }
        let slopes = seen(plane, &sites, reach, joints);
        let width = 2 * reach + 3;
        // noise is what lies away from the line; near it there is an edge nearly everywhere
        let away = slopes
            .chunks_exact(width)
            .flat_map(|s| [s[0], s[width - 1]]);
        let largest = steepest(slopes.iter().copied()).ok_or(SnapError::NoEdges)?;
        let scale = edge_scale(away, largest);
        let mut sum = NormalEquations::default();
        let (mut supported, mut weights) = (0.0, 0.0);
        for (site, slopes) in sites.iter().zip(slopes.chunks_exact(width)) {
            let Some((distance, slope)) = peak(slopes, reach) else {
                continue;
            };
            // Tukey's weight: what is further off counts less, at the end of the reach nothing
            let near = (1.0 - (distance / (reach as f64 + 1.0)).powi(2))
                .max(0.0)
                .powi(2);
            let weight = f64::from(edgeness(slope, scale)) * near;
            sum.add(-distance, &all.influence(site), weight);
            weights += weight;
            if weight > 0.25 {
                supported += 1.0;
            }
        }
        support = supported / sites.len() as f64;
        if weights <= 0.0 {
            return Err(SnapError::NoEdges);
        }
        for (k, row) in sum.matrix.iter_mut().enumerate() {
            row[k] += HOLD * weights;
        }
        let Some(step) = sum.step(0.0) else { break };
        let moved = grid.corners();
        let moved = std::array::from_fn(|k| moved[k] + dvec2(step[2 * k], step[2 * k + 1]));
        grid = QuadGrid::new(moved, grid.columns(), grid.rows())?;
        if step.iter().all(|s| s.abs() < settled_px) {
            settled = reach;
        }
    }
    Ok(Snapped { grid, support })
}

/// Every `every`-th site, or more of them if there are few.
pub(super) fn thinned(sites: &[Site], every: usize) -> Vec<&Site> {
    let every = every.min(sites.len() / ENOUGH_SITES).max(1);
    sites.iter().step_by(every).collect()
}

/// The slopes across the lines at all sites, or how much like the middle of a joint each place is: `2 · reach + 3` numbers
/// for each site.
fn seen(plane: &Plane, sites: &[&Site], reach: usize, joints: [Option<Joint>; 2]) -> Vec<f32> {
    let width = 2 * reach + 3;
    let joint = |site: &Site| joints[usize::from(site.family == Family::Rows)];
    let half = |site: &Site| joint(site).map_or(0.0, |joint| joint.half_px(site.cell_px));
    let widest = sites.iter().map(|site| half(site)).fold(0.0, f64::max);
    let new_profile = || Profile::new(reach + 1 + widest.ceil() as usize, SIGMA_PX);
    let mut seen = vec![0.0; width * sites.len()];
    seen.par_chunks_exact_mut(width)
        .zip(sites)
        .with_min_len(64)
        .for_each_init(new_profile, |profile, (seen, site)| {
            profile.read(plane, site.at, site.normal);
            if let Some(joint) = joint(site) {
                joint.respond(site, &profile.slopes, seen);
            } else {
                let first = (profile.slopes.len() - width) / 2;
                seen.copy_from_slice(&profile.slopes[first..][..width]);
            }
        });
    seen
}

/// The place and the height of the steepest slope within reach, preferring near ones; nothing at the ends.
fn peak(slopes: &[f32], reach: usize) -> Option<(f64, f32)> {
    let middle = slopes.len() / 2;
    let height = |k: usize| slopes[k].abs();
    let merit = |k: usize| height(k) * (1.0 - 0.5 * k.abs_diff(middle) as f32 / (reach + 1) as f32);
    let best = (middle - reach..=middle + reach).max_by(|&a, &b| merit(a).total_cmp(&merit(b)))?;
    let (before, here, after) = (height(best - 1), height(best), height(best + 1));
    if here.is_nan() || here < before || here < after || here == 0.0 {
        return None;
    }
    let bend = before - 2.0 * here + after;
    let off = if bend < 0.0 {
        0.5 * (before - after) / bend
    } else {
        0.0
    };
    Some((best as f64 - middle as f64 + f64::from(off), here))
}
