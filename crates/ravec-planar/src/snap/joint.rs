//! Lines that are joints: narrow stripes with an edge on each side.
//!
//! A grid laid on tiles or bricks is meant to run along the middle of the joints, but the steepest slopes are at their
//! edges. Two edges mark a joint, which rise and fall by much the same: where all lines of a family have such a partner
//! at the same distance, counted in columns or rows, the middle is taken.

use crate::quad_grid::QuadGrid;
use crate::snap::SnapError;
use crate::snap::polish::thinned;
use crate::snap::sites::{Family, Profile, Site, Sites};
use glam::{DVec2, dvec2};
use ravec_raster::Plane;
use rayon::prelude::*;

/// The width of joints at most, in columns or rows. Windows have two edges, too, but farther apart.
const MAX_WIDTH: f64 = 0.15;

/// Widths that are distinguished, to each side.
const WIDTHS: usize = 75;

/// The correlation of both edges from which they are a joint. The edges of a row of windows and of what stands beside them
/// reach one third by chance, those of joints two thirds on rough bricks.
const MIN_CORRELATION: f64 = 0.45;

/// Largest ratio of the stronger edge to the weaker one: joints lie in the shade of what is above, but frames of
/// windows have an edge that matters and one that does not.
const MAX_IMBALANCE: f64 = 3.0;

/// The blur across lines, in pixels.
const SIGMA_PX: f64 = 1.0;

/// Lines of a family are joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Joint {
    /// Distance of the two edges in columns or rows.
    width: f64,
    /// 1 if joints are brighter than what they part, −1 if darker, 0 if now the one, now the other.
    brighter: f64,
}

impl Joint {
    /// Half the width where a line moves by `cell_px` pixels a column or row, in pixels.
    pub(super) fn half_px(&self, cell_px: f64) -> f64 {
        0.5 * self.width * cell_px.abs()
    }

    /// Similarity of each place to the middle of a joint, from the slopes across the line: the rise on one side and the
    /// fall on the other. The `responses` are as many as the places around the middle of the slopes.
    pub(super) fn respond(&self, site: &Site, slopes: &[f32], responses: &mut [f32]) {
        let half = self.half_px(site.cell_px);
        let first = (slopes.len() as f64 - responses.len() as f64) / 2.0;
        for (k, response) in responses.iter_mut().enumerate() {
            let at = first + k as f64;
            let difference = 0.5 * (between(slopes, at - half) - between(slopes, at + half));
            *response = if self.brighter == 0.0 {
                difference.abs()
            } else {
                (self.brighter * difference).max(0.0)
            } as f32;
        }
    }
}

/// The slope between two whole pixels; 0 beyond the ends.
fn between(slopes: &[f32], at: f64) -> f64 {
    if at <= -1.0 {
        return 0.0;
    }
    // a cast rounds down what is positive, without the call that `floor` is on machines of the base level
    let after = (at + 1.0) as usize;
    let share = at + 1.0 - after as f64;
    let value = |k: Option<usize>| k.and_then(|k| slopes.get(k)).map_or(0.0, |&v| f64::from(v));
    if share == 0.0 {
        return value(after.checked_sub(1));
    }
    (1.0 - share) * value(after.checked_sub(1)) + share * value(Some(after))
}

/// Partners of the edges below a family.
#[derive(Clone)]
struct Partners {
    /// −Σ of the slope on the line times the one at each distance.
    product: Vec<f64>,
    /// Σ of the squared slope at each distance.
    square: Vec<f64>,
    /// Σ of the squared slope on the line, of it and of its height.
    own_square: f64,
    own: f64,
    own_height: f64,
}

impl Partners {
    fn none() -> Self {
        Self {
            product: vec![0.0; 2 * WIDTHS + 1],
            square: vec![0.0; 2 * WIDTHS + 1],
            own_square: 0.0,
            own: 0.0,
            own_height: 0.0,
        }
    }

    fn add(&mut self, other: &Self) {
        let sums = self.product.iter_mut().chain(&mut self.square);
        for (sum, value) in sums.zip(other.product.iter().chain(&other.square)) {
            *sum += value;
        }
        self.own_square += other.own_square;
        self.own += other.own;
        self.own_height += other.own_height;
    }
}

/// One site in this number is searched for partners, if there are plenty.
const THINNED: usize = 3;

/// Sites that are examined together, in a fixed order.
const CHUNK: usize = 128;

/// The grid with the lines of a family, which lie on edges, moved to where they belong: onto the middle of joints, or onto
/// the stronger one of two edges.
pub(super) fn centered(
    plane: &Plane,
    grid: &QuadGrid,
    family: Family,
) -> Result<(QuadGrid, Option<Joint>), SnapError> {
    let all = Sites::new(grid, Some(family), plane.size()).sites;
    let sites = thinned(&all, THINNED);
    let cell_px = sites.iter().map(|site| site.cell_px.abs()).sum::<f64>() / sites.len() as f64;
    let reach = |site: &&Site| (MAX_WIDTH * site.cell_px.abs()).ceil() as usize + 1;
    let widest = sites.iter().map(reach).max().unwrap_or(1);
    let slopes = |site: &Site, profile: &mut Profile| {
        profile.read(plane, site.at, site.normal);
        let middle = (profile.slopes.len() / 2) as f64;
        let at = |cells: f64| between(&profile.slopes, middle + cells * site.cell_px);
        let own = at(0.0) * site.cell_px.signum();
        let others: Vec<f64> = (0..=2 * WIDTHS)
            .map(|k| at(cells(k as f64)) * site.cell_px.signum())
            .collect();
        (own, others)
    };
    let chunks: Vec<Partners> = sites
        .par_chunks(CHUNK)
        .map(|sites| {
            let mut profile = Profile::new(widest, SIGMA_PX);
            let mut sums = Partners::none();
            for site in sites {
                let (own, others) = slopes(site, &mut profile);
                if !own.is_finite() || others.iter().any(|other| !other.is_finite()) {
                    continue;
                }
                for ((product, square), other) in
                    sums.product.iter_mut().zip(&mut sums.square).zip(others)
                {
                    *product -= own * other;
                    *square += other * other;
                }
                sums.own_square += own * own;
                sums.own += own;
                sums.own_height += own.abs();
            }
            sums
        })
        .collect();
    let mut sums = Partners::none();
    for chunk in &chunks {
        sums.add(chunk);
    }
    // nearer than two pixels there are the flanks of the edge itself
    let apart = |k: usize| (cells(k as f64) * cell_px).abs() >= 1.5;
    // what only rises towards the end of the range is the flank of an edge beyond it
    let is_peak =
        |k: usize| sums.product[k] >= sums.product[k - 1] && sums.product[k] >= sums.product[k + 1];
    let best = (1..2 * WIDTHS)
        .filter(|&k| apart(k) && is_peak(k))
        .max_by(|&a, &b| sums.product[a].total_cmp(&sums.product[b]));
    let Some(best) = best.filter(|&k| sums.product[k] > 0.0) else {
        return Ok((grid.clone(), None));
    };
    let correlation = sums.product[best] / (sums.own_square * sums.square[best]).sqrt();
    let imbalance = sums.product[best] / sums.own_square;
    if correlation.is_nan() || correlation < MIN_CORRELATION || imbalance < MAX_IMBALANCE.recip() {
        return Ok((grid.clone(), None));
    }
    let [before, here, after] = [best - 1, best, best + 1].map(|k| sums.product[k]);
    let bend = before - 2.0 * here + after;
    let off = if bend < 0.0 {
        (0.5 * (before - after) / bend).clamp(-1.0, 1.0)
    } else {
        0.0
    };
    let partner = cells(best as f64 + off);
    let (by, joint) = if imbalance > MAX_IMBALANCE {
        (partner, None)
    } else {
        // the first edge of a brighter stripe rises
        let brighter = if sums.own.abs() < 0.5 * sums.own_height {
            0.0
        } else {
            sums.own.signum() * partner.signum()
        };
        let width = partner.abs();
        (0.5 * partner, Some(Joint { width, brighter }))
    };
    let by = match family {
        Family::Columns => dvec2(by, 0.0),
        Family::Rows => dvec2(0.0, by),
    };
    let (columns, rows) = (f64::from(grid.columns()), f64::from(grid.rows()));
    let corners = [(0.0, 0.0), (columns, 0.0), (columns, rows), (0.0, rows)];
    let corners = corners.map(|corner| grid.image_from_grid().apply(DVec2::from(corner) + by));
    let moved = QuadGrid::new(corners, grid.columns(), grid.rows())?;
    Ok((moved, joint))
}

/// The distance number `k` from the line, in columns or rows.
fn cells(k: f64) -> f64 {
    (k / WIDTHS as f64 - 1.0) * MAX_WIDTH
}
