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

/// How far edges are looked for, in pixels, round by round: the search leaves about one pixel.
const REACHES_PX: [usize; 8] = [4, 4, 3, 3, 2, 2, 2, 2];

/// The blur across lines, in pixels: enough against the pixel grid and noise, without mixing neighbouring edges.
const SIGMA_PX: f64 = 1.0;

/// Moves are held back by this share of the mean weight: a corner that no edge determines stays where it is.
const HOLD: f64 = 1e-4;

/// The grid with each line on the steepest slopes near it, or in the middle of the `joints` that lines between columns and
/// between rows are.
pub(super) fn polish(
    plane: &Plane,
    grid: &QuadGrid,
    joints: [Option<Joint>; 2],
) -> Result<Snapped, SnapError> {
    let joint = |site: &Site| joints[usize::from(site.family == Family::Rows)];
    let mut grid = grid.clone();
    let mut support = 0.0;
    for reach in REACHES_PX {
        let sites = Sites::new(&grid, None, plane.size());
        if sites.sites.is_empty() {
            return Err(SnapError::Outside);
        }
        let half = |site: &Site| joint(site).map_or(0.0, |joint| joint.half_px(site.cell_px));
        let widest = sites.sites.iter().map(half).fold(0.0, f64::max);
        let new_profile = || Profile::new(reach + 1 + widest.ceil() as usize, SIGMA_PX);
        let slopes: Vec<Vec<f32>> = sites
            .sites
            .par_iter()
            .with_min_len(64)
            .map_init(new_profile, |profile, site| {
                profile.read(plane, site.at, site.normal);
                let mut seen = vec![0.0; 2 * reach + 3];
                if let Some(joint) = joint(site) {
                    joint.respond(site, &profile.slopes, &mut seen);
                } else {
                    let first = (profile.slopes.len() - seen.len()) / 2;
                    seen.copy_from_slice(&profile.slopes[first..][..2 * reach + 3]);
                }
                seen
            })
            .collect();
        // noise is what lies away from the line; near it there is an edge nearly everywhere
        let away = slopes.iter().flat_map(|s| [s[0], s[s.len() - 1]]);
        let largest = steepest(slopes.iter().flatten().copied()).ok_or(SnapError::NoEdges)?;
        let scale = edge_scale(away, largest);
        let mut sum = NormalEquations::default();
        let (mut supported, mut weights) = (0.0, 0.0);
        for (site, slopes) in sites.sites.iter().zip(&slopes) {
            let Some((distance, slope)) = peak(slopes, reach) else {
                continue;
            };
            // Tukey's weight: what is further off counts less, at the end of the reach nothing
            let near = (1.0 - (distance / (reach as f64 + 1.0)).powi(2))
                .max(0.0)
                .powi(2);
            let weight = f64::from(edgeness(slope, scale)) * near;
            sum.add(-distance, &site.influence, weight);
            weights += weight;
            if weight > 0.25 {
                supported += 1.0;
            }
        }
        support = supported / sites.sites.len() as f64;
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
        if reach == REACHES_PX[REACHES_PX.len() - 1] && step.iter().all(|s| s.abs() < 0.005) {
            break;
        }
    }
    Ok(Snapped { grid, support })
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
