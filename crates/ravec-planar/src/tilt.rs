//! A picture as seen from other sides.
//!
//! Features know turns and sizes, but not that a circle becomes an ellipse when a plane is seen at a slant. So the slant is
//! simulated: the picture is narrowed along some directions, as if the camera had moved around it, and features are found
//! there as well.
//!
//! Source: Morel and Yu, "ASIFT: a new framework for fully affine invariant image comparison", 2009.
//!
//! Cost: the area of all views, as many times the cost of features.

use crate::features::{FeatureParams, Features};
use glam::{DMat2, DVec2, dvec2};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Plane, Size};
use rayon::prelude::*;

/// A slanted view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct View {
    /// By how much the picture is narrower, at least 1.
    tilt: f64,
    /// The direction along which it is narrowed, in eighths of a full turn from x towards y.
    eighths: i32,
}

impl View {
    /// Narrowed by two along four directions. Together with features' own tolerance of slants (about two as well) in both
    /// pictures, it covers relative slants up to eight or so.
    pub(crate) const TILTS: &'static [Self] = &[
        Self {
            tilt: 2.0,
            eighths: 0,
        },
        Self {
            tilt: 2.0,
            eighths: 1,
        },
        Self {
            tilt: 2.0,
            eighths: 2,
        },
        Self {
            tilt: 2.0,
            eighths: 3,
        },
    ];

    /// The picture from this side, and how to get back: a point p of the view is at `linear` · p + `offset`.
    fn of(self, plane: &Plane) -> (Plane, DMat2, DVec2) {
        let angle = f64::from(self.eighths) * std::f64::consts::FRAC_PI_4;
        let (along, across) = (DVec2::from_angle(angle), DVec2::from_angle(angle).perp());
        let extent = dvec2(plane.width() as f64, plane.height() as f64);
        // the picture's extent along and across
        let (long, wide) = (along.abs().dot(extent), across.abs().dot(extent));
        let cells = |length: f64| (length.ceil() as usize).max(1);
        let size = Size::new(cells(long / self.tilt), cells(wide))
            .expect("narrower than the picture's diagonal");
        let linear = DMat2::from_cols(along * self.tilt, across);
        let half = 0.5 * dvec2(size.width() as f64, size.height() as f64);
        let offset = 0.5 * extent - linear * half;
        // a Gaussian along the narrowed direction, of the deviation that makes up for the coarser pixels
        let sigma = 0.8 * (self.tilt * self.tilt - 1.0).sqrt();
        let reach = (2.5 * sigma).ceil() as i32;
        let taps: Vec<(DVec2, f32)> = (-reach..=reach)
            .map(|k| {
                (
                    along * f64::from(k),
                    (-0.5 * (f64::from(k) / sigma).powi(2)).exp() as f32,
                )
            })
            .collect();
        let sum: f32 = taps.iter().map(|tap| tap.1).sum();
        let mut view = Plane::new(size, 0.0);
        view.par_rows_mut().enumerate().for_each(|(row, line)| {
            for (col, out) in line.iter_mut().enumerate() {
                let at = linear * dvec2(col as f64 + 0.5, row as f64 + 0.5) + offset;
                // beyond the corners of a turned picture there is its border, which has no features
                let total: f32 = taps
                    .iter()
                    .map(|(step, weight)| weight * plane.bilinear(at + *step))
                    .sum();
                *out = total / sum;
            }
        });
        (view, linear, offset)
    }
}

/// The features of a picture together with those of its views, all in the picture's pixels.
pub(crate) fn features_of_views(
    plane: &Plane,
    mut features: Features,
    views: &[View],
    params: &FeatureParams,
    progress: &Progress,
) -> Result<Features, Cancelled> {
    for view in views {
        let (seen, linear, offset) = view.of(plane);
        let found = Features::detect(&seen, params, progress)?;
        let scale = linear.determinant().abs().sqrt();
        for (mut point, descriptor) in found.points.into_iter().zip(found.descriptors) {
            let direction = linear * DVec2::from_angle(point.angle_rad);
            point.at = linear * point.at + offset;
            point.sigma_px *= scale;
            point.angle_rad = direction.to_angle().rem_euclid(std::f64::consts::TAU);
            let inside = point.at.cmpge(DVec2::ZERO).all()
                && point.at.x <= plane.width() as f64
                && point.at.y <= plane.height() as f64;
            if inside {
                features.points.push(point);
                features.descriptors.push(descriptor);
            }
        }
    }
    Ok(features)
}
