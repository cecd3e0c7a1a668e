//! Errors of completion, and the checks that return them.

use glam::DVec2;
use ravec_planar::{Homography, HomographyError};
use ravec_progress::Cancelled;
use ravec_raster::{Mask, Size, distance_to};

/// Why a hole cannot be filled.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CompleteError {
    /// Picture and mask must be of one size.
    #[error("the mask has {mask} pixels, but the picture {image}: make both the same size")]
    MaskSize {
        /// Size of the picture.
        image: Size,
        /// Size of the mask.
        mask: Size,
    },
    /// Nothing is left from which the hole could be filled.
    #[error(
        "the mask leaves nothing to copy from: the largest disc of known pixels has a radius of {largest_radius_px:.1} \
         pixels, and more than 3 are needed"
    )]
    NoSource {
        /// Radius of the largest disc of known pixels.
        largest_radius_px: f64,
    },
    /// Another mask, such as that of features, must be of the picture's size as well.
    #[error(
        "the mask of features has {mask} pixels, but the picture {image}: make both the same size"
    )]
    FeatureSize {
        /// Size of the picture.
        image: Size,
        /// Size of the mask.
        mask: Size,
    },
    /// No fragment of that radius is known as a whole.
    #[error(
        "no source has a radius of {radius_px} pixels: the largest usable radius is {largest_radius_px}"
    )]
    Radius {
        /// The requested radius.
        radius_px: u32,
        /// The largest for which there is a source; 0 if there is none at all.
        largest_radius_px: u32,
    },
    /// A target, a source or a variant is invalid.
    #[error("{what}")]
    Fragment {
        /// Description of the defect.
        what: String,
    },
    /// The outline of a plane crosses itself.
    #[error("the outline of plane {plane} crosses itself: give its corners in order around it")]
    QuadCrosses {
        /// Number of the plane, from 1.
        plane: usize,
    },
    /// A plane cannot be seen like that.
    #[error("plane {plane} cannot be used: {cause}")]
    Plane {
        /// Number of the plane, from 1.
        plane: usize,
        /// Why not.
        cause: HomographyError,
    },
    /// A plane that is not in the picture.
    #[error("plane {plane} lies outside the picture: move its corners into it")]
    PlaneOutside {
        /// Number of the plane, from 1.
        plane: usize,
    },
    /// The caller cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// The map from the unit square to a plane's quadrilateral, if that can be used.
pub(crate) fn plane_map(
    quad: &[DVec2; 4],
    size: Size,
    plane: usize,
) -> Result<Homography, CompleteError> {
    let crosses = |a: DVec2, b: DVec2, c: DVec2, d: DVec2| {
        let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
        side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0
    };
    let [a, b, c, d] = *quad;
    if crosses(a, b, c, d) || crosses(b, c, d, a) {
        return Err(CompleteError::QuadCrosses { plane });
    }
    let map = Homography::from_unit_square(*quad)
        .map_err(|cause| CompleteError::Plane { plane, cause })?;
    let (low, high) = quad
        .iter()
        .fold((a, a), |(low, high), &p| (low.min(p), high.max(p)));
    let end = DVec2::new(size.width() as f64, size.height() as f64);
    if low.cmpge(end).any() || high.cmple(DVec2::ZERO).any() {
        return Err(CompleteError::PlaneOutside { plane });
    }
    Ok(map)
}

/// The radius of the largest disc of pixels that the mask does not cover.
pub(crate) fn largest_radius(hole: &Mask) -> f64 {
    let (width, height) = (hole.size().width(), hole.size().height());
    let distance = distance_to(hole.size(), |col, row| hole.at(col, row) > 0.0);
    let mut largest = 0.0f64;
    for row in 0..height {
        for col in 0..width {
            // the border of the picture limits discs as well
            let border = (col + 1).min(width - col).min(row + 1).min(height - row) as f64;
            largest = largest.max(f64::from(distance[(col, row)]).min(border));
        }
    }
    largest
}
