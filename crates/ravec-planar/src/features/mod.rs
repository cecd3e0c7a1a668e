//! Points that are found again in another picture of the same thing, and what surrounds them.
//!
//! ```text
//! blur the picture more and more; where the difference of two blurs is the largest or smallest among its 26 neighbors
//!     in place and scale, there is a point with a size
//! turn a window of that size to the strongest direction of its gradients
//! describe it by histograms of gradient directions in 4 × 4 fields
//! ```
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers.
//!
//! Sources: Lowe, "Distinctive image features from scale-invariant keypoints", 2004; Arandjelović and Zisserman, "Three
//! things everyone should know to improve object retrieval", 2012 (the square root of histograms). We differ in that the
//! picture is not doubled first, since what doubling adds is too fine to be seen in both of two photos, and in that windows
//! are sampled on one fixed grid in their own frame, so that a window costs the same at any size.
//!
//! Guarantees: equal pictures and parameters give equal bytes on any number of threads. Does not guarantee: points on
//! straight edges or in even areas; there are none.
//! Cost: about 25 blurred pictures' worth of arithmetic, and some microseconds a point; memory about 12 planes.

mod descriptor;
mod detect;
mod orientation;
mod scale_space;

pub use descriptor::Descriptor;

use crate::features::descriptor::describe;
use crate::features::detect::{Extremum, MARGIN, extrema};
use crate::features::orientation::orientations;
use crate::features::scale_space::ScaleSpace;
use glam::DVec2;
use ravec_progress::{Cancelled, Phase, Progress};
use ravec_raster::color::{luminance, srgb_from_linear};
use ravec_raster::{Color, Image, Plane};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The side below which a picture has no features: all of it is too near to the border.
pub(crate) const MIN_SIDE_PX: usize = 2 * MARGIN + 1;

/// Units of progress of [`Features::find`].
pub(crate) const STEPS: u64 = 3;

/// A point with a size and a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// Position in pixels, x right, y down, pixel centers at half-integers.
    pub at: DVec2,
    /// The blur at which it stands out most, a standard deviation in pixels: about 0.7 of the radius of a blob.
    pub sigma_px: f64,
    /// Its direction, from x towards y, 0 to 2π. 0 for upright features.
    pub angle_rad: f64,
    /// The height of the extremum, of a picture with values from 0 to 1. Positive for dark blobs on light ground.
    pub response: f64,
}

/// Parameters of feature detection.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FeatureParams {
    /// Features that are kept, the strongest first (default 2000). More find more pairs, and cost time in proportion, for
    /// matching in proportion to the square.
    pub max_features: usize,
    /// The least height of an extremum, for pictures with values from 0 to 1, at least 0 (default 0.004, one encoded step of
    /// 255). Smaller finds features in dark or hazy pictures, and in noise.
    pub contrast: f64,
    /// The largest ratio of the two curvatures, at least 1 (default 10). Larger keeps points that may slip along edges.
    pub edge_ratio: f64,
    /// `true` if all features point to the right instead of along their gradients (default false). Pictures that are
    /// known not to be turned match better so.
    pub upright: bool,
}

impl Default for FeatureParams {
    fn default() -> Self {
        Self {
            max_features: 2000,
            contrast: 0.004,
            edge_ratio: 10.0,
            upright: false,
        }
    }
}

/// The features of a picture, the strongest first, each with its descriptor.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Features {
    /// The points.
    pub points: Vec<Feature>,
    /// Descriptors of the keypoints, in the same order.
    pub descriptors: Vec<Descriptor>,
}

/// The encoded luminance of a picture, 0 to 1: what features are found in. Encoded, because dark parts hold as much
/// structure as light ones; transparent parts are as their color says.
pub fn encoded_luminance<P: Color>(image: &Image<P>) -> Plane {
    image.map(|pixel| srgb_from_linear(luminance(pixel.to_linear().rgb())))
}

impl Features {
    /// Finds features in a plane with values from 0 to 1, such as an [`encoded_luminance`]. A picture with numbers that are
    /// not finite has no features around them.
    ///
    /// # Errors
    /// [`Cancelled`].
    ///
    /// ```
    /// use ravec_planar::{FeatureParams, Features};
    /// use ravec_progress::Progress;
    /// use ravec_raster::{Plane, Size};
    ///
    /// // a dark blob at (40, 30) with a radius of about 6
    /// let blob = Plane::from_fn(Size::new(80, 60)?, |col, row| {
    ///     let (x, y) = (col as f32 - 39.5, row as f32 - 29.5);
    ///     1.0 - (-(x * x + y * y) / 32.0).exp()
    /// });
    /// let found = Features::detect(&blob, &FeatureParams::default(), &Progress::none())?;
    /// let strongest = found.points[0];
    /// assert!(strongest.at.distance((40.0, 30.0).into()) < 0.1);
    /// assert!(strongest.response > 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn detect(
        plane: &Plane,
        params: &FeatureParams,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let phase = progress.phase("features", STEPS);
        Self::find(plane, params, progress, &phase)
    }

    /// As [`Features::detect`], as [`STEPS`] units of a phase that has more of them.
    pub(crate) fn find(
        plane: &Plane,
        params: &FeatureParams,
        progress: &Progress,
        phase: &Phase,
    ) -> Result<Self, Cancelled> {
        if plane.width().min(plane.height()) < MIN_SIDE_PX {
            phase.advance(STEPS);
            return Ok(Self::default());
        }
        let space = ScaleSpace::new(plane, progress)?;
        phase.advance(1);
        let mut found: Vec<Extremum> = extrema(&space, params);
        // the strongest first; the order of equals is that of their places
        found.sort_by(|a, b| b.response.abs().total_cmp(&a.response.abs()));
        found.truncate(params.max_features);
        progress.check()?;
        phase.advance(1);
        let described: Vec<Vec<(Feature, Descriptor)>> = found
            .par_iter()
            .with_min_len(64)
            .map(|extremum| {
                let level = space.nearest(extremum);
                let angles = if params.upright {
                    vec![0.0]
                } else {
                    orientations(level, extremum)
                };
                let one =
                    |&angle: &f32| (extremum.feature(angle), describe(level, extremum, angle));
                angles.iter().map(one).collect()
            })
            .collect();
        phase.advance(1);
        let mut all = Self::default();
        for (point, descriptor) in described.into_iter().flatten().take(params.max_features) {
            all.points.push(point);
            all.descriptors.push(descriptor);
        }
        Ok(all)
    }

    /// Keeps the features whose places `keep` accepts, in their order.
    pub(crate) fn keep_places(&mut self, keep: &dyn Fn(DVec2) -> bool) {
        let kept: Vec<bool> = self.points.iter().map(|point| keep(point.at)).collect();
        let mut flags = kept.iter();
        self.points
            .retain(|_| flags.next().is_some_and(|&kept| kept));
        let mut flags = kept.iter();
        self.descriptors
            .retain(|_| flags.next().is_some_and(|&kept| kept));
    }

    /// Keeps the `count` strongest features, the strongest first; of equals those that come first.
    pub(crate) fn keep_strongest(&mut self, count: usize) {
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        let strength = |index: usize| self.points[index].response.abs();
        order.sort_by(|&a, &b| strength(b).total_cmp(&strength(a)));
        order.truncate(count);
        self.points = order.iter().map(|&index| self.points[index]).collect();
        self.descriptors = order.iter().map(|&index| self.descriptors[index]).collect();
    }
}
