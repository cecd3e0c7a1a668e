//! The homography between two photos of a plane, from nothing but their pixels.
//!
//! ```text
//! features of both, matched; the homography that the matches agree on
//! if there is none: features of both as seen from other sides, matched; again
//! patches around features, aligned under the homography; the homography of the aligned patches, twice
//! ```
//!
//! Source: Morel and Yu, "ASIFT", 2009, for the views from other sides.
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers.
//!
//! Guarantees: equal photos and parameters give equal bytes on any number of threads. Does not guarantee: that the plane
//! with the most features is the one that was meant, or that what repeats (windows, bricks) is matched without a shift.

use crate::align::{Sizes, align_patches};
use crate::estimate::PointPair;
use crate::features::{FeatureParams, Features};
use crate::homography::{Homography, HomographyError};
use crate::matching::match_features;
use crate::robust::{RobustFit, RobustParams, estimate_robust};
use crate::tilt::{View, features_of_views};
use glam::DVec2;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::Plane;
use serde::{Deserialize, Serialize};

/// Parameters of photo matching.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MatchParams {
    /// Parameters of feature detection.
    pub features: FeatureParams,
    /// The ratio of distances below which two features match, 0 to 1 (default 0.8). Larger finds more matches and more
    /// wrong ones.
    pub max_ratio: f64,
    /// Parameters of the separation of wrong matches from right ones.
    pub robust: RobustParams,
    /// `true` if photos that do not match are tried as seen from other sides (default true). It takes about five times
    /// as long.
    pub try_tilts: bool,
    /// `true` if the homography is refined by the pixels around the features (default true).
    pub refine: bool,
}

impl Default for MatchParams {
    fn default() -> Self {
        Self {
            features: FeatureParams::default(),
            max_ratio: 0.8,
            robust: RobustParams::default(),
            try_tilts: true,
            refine: true,
        }
    }
}

/// The match of two photos of a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoMatch {
    /// The homography.
    pub second_from_first: Homography,
    /// Matched features.
    pub matches: usize,
    /// Those that agree with the homography.
    pub inliers: usize,
    /// Patches that were aligned for the refinement; 0 without one.
    pub patches: usize,
    /// The standard deviation of the points' noise, in pixels.
    pub sigma_px: f64,
    /// `true` if it took views from other sides.
    pub tilted: bool,
}

/// Why two photos could not be laid on each other.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MatchError {
    /// Too little in the photos looks alike.
    #[error("only {matches} features of the photos match, too few to trust")]
    TooFewMatches {
        /// Number of similar features.
        matches: usize,
    },
    /// The matching features do not lie on one plane.
    #[error("the matching features do not lie on one plane: {0}")]
    NoPlane(#[from] HomographyError),
    /// The work was cancelled.
    #[error("cancelled")]
    Cancelled,
}

impl From<Cancelled> for MatchError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

/// Agreeing matches below which other views are tried as well: chance does not make as many, but a wrong repetition may.
const SURE_INLIERS: usize = 20;

/// Patches are taken from cells of this side, the strongest features first, so that they are spread over the picture.
const CELL_PX: f64 = 32.0;
const PATCHES_PER_CELL: usize = 2;

/// Largest move of a patch, in pixels of the coarser picture, in the first and in the second round of refinement.
const REACH_PX: [f64; 2] = [4.0, 1.5];

/// Lays one photo on another, both as planes of encoded luminance from 0 to 1 (see [`crate::encoded_luminance`]).
///
/// # Errors
/// [`MatchError::TooFewMatches`], [`MatchError::NoPlane`], [`MatchError::Cancelled`].
pub fn match_photos(
    first: &Plane,
    second: &Plane,
    params: &MatchParams,
    progress: &Progress,
) -> Result<PhotoMatch, MatchError> {
    match_where(first, second, &|_| true, params, progress)
}

/// As [`match_photos`], with those features of the second photo alone whose places `keep` accepts.
pub(crate) fn match_where(
    first: &Plane,
    second: &Plane,
    keep: &dyn Fn(DVec2) -> bool,
    params: &MatchParams,
    progress: &Progress,
) -> Result<PhotoMatch, MatchError> {
    let in_first = Features::detect(first, &params.features, progress)?;
    let mut in_second = Features::detect(second, &params.features, progress)?;
    in_second.keep_places(keep);
    progress.check()?;
    let (mut matches, mut fit) = agree(&in_first, &in_second, params);
    let mut tilted = false;
    let weak = fit
        .as_ref()
        .map_or(true, |fit| fit.inlier_count < SURE_INLIERS);
    if weak && params.try_tilts {
        let views = View::TILTS;
        let in_first =
            features_of_views(first, in_first.clone(), views, &params.features, progress)?;
        let mut in_second =
            features_of_views(second, in_second, views, &params.features, progress)?;
        in_second.keep_places(keep);
        let (more, other) = agree(&in_first, &in_second, params);
        let count = |fit: &Result<RobustFit, HomographyError>| {
            fit.as_ref().map_or(0, |fit| fit.inlier_count)
        };
        if count(&other) > count(&fit) {
            (matches, fit, tilted) = (more, other, true);
        }
    }
    let needed = params.robust.min_inliers.max(4);
    if matches < needed {
        return Err(MatchError::TooFewMatches { matches });
    }
    let fit = fit?;
    let mut found = PhotoMatch {
        second_from_first: fit.dst_from_src,
        matches,
        inliers: fit.inlier_count,
        patches: 0,
        sigma_px: fit.sigma_px,
        tilted,
    };
    if params.refine {
        refine_by_patches(&mut found, first, second, &in_first, params, progress)?;
    }
    Ok(found)
}

/// The matches of two sets of features, how many there are, and what they agree on.
fn agree(
    first: &Features,
    second: &Features,
    params: &MatchParams,
) -> (usize, Result<RobustFit, HomographyError>) {
    let matches = match_features(first, second, params.max_ratio);
    let pairs: Vec<PointPair> = matches
        .iter()
        .map(|found| PointPair::new(first.points[found.first].at, second.points[found.second].at))
        .collect();
    (pairs.len(), estimate_robust(&pairs, &params.robust))
}

/// Replaces the homography by that of aligned patches, if enough of them agree.
fn refine_by_patches(
    found: &mut PhotoMatch,
    first: &Plane,
    second: &Plane,
    in_first: &Features,
    params: &MatchParams,
    progress: &Progress,
) -> Result<(), Cancelled> {
    let phase = progress.phase("refinement", REACH_PX.len() as u64);
    let (first_sizes, second_sizes) = (Sizes::new(first), Sizes::new(second));
    let points = spread(in_first, first);
    for reach_px in REACH_PX {
        progress.check()?;
        let pairs = align_patches(
            &first_sizes,
            &second_sizes,
            &found.second_from_first,
            &points,
            reach_px,
        );
        // a refinement with few patches would be worse than what the features agree on
        let better = estimate_robust(&pairs, &params.robust)
            .ok()
            .filter(|fit| fit.inlier_count >= SURE_INLIERS);
        if let Some(fit) = better {
            found.second_from_first = fit.dst_from_src;
            found.patches = fit.inlier_count;
            found.sigma_px = fit.sigma_px;
        }
        phase.advance(1);
    }
    Ok(())
}

/// The strongest features of each cell.
fn spread(features: &Features, plane: &Plane) -> Vec<DVec2> {
    let columns = (plane.width() as f64 / CELL_PX).ceil() as usize;
    let rows = (plane.height() as f64 / CELL_PX).ceil() as usize;
    let mut taken = vec![0; columns * rows];
    let mut points: Vec<DVec2> = Vec::new();
    for point in &features.points {
        let cell = (point.at / CELL_PX).floor();
        let index = (cell.y as usize).min(rows - 1) * columns + (cell.x as usize).min(columns - 1);
        // one feature with two directions is one point
        if taken[index] < PATCHES_PER_CELL && points.last() != Some(&point.at) {
            taken[index] += 1;
            points.push(point.at);
        }
    }
    points
}
