//! Planes seen from straight on, with their true proportions.
//!
//! A quadrilateral in a picture is a rectangle on a plane, but of which proportions? With the focal length the rays
//! through its corners are known, and with them the ratio of its sides. Without it, the sides themselves determine it:
//! the points where opposite sides meet are the pictures of two directions, and if these are at right angles there is
//! one focal length for which they are. Or somebody knows the ratio.
//!
//! ```text
//! image_from_unit = [h₁ h₂ h₃], the principal point in the origin
//! a side's direction is K⁻¹h, with K = diag(f, f, 1):   width / height = |K⁻¹h₁| / |K⁻¹h₂|
//! at right angles:                                      (K⁻¹h₁)·(K⁻¹h₂) = 0, so f² = −(h₁ₓh₂ₓ + h₁ᵧh₂ᵧ) / (h₁₂h₂₂)
//! ```
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers. The principal point, which the axis of the lens goes
//! through, is where the caller says: the middle of a picture that was not cropped.
//!
//! Source: Zhang and He, "Whiteboard scanning and image enhancement", 2007; Hartley and Zisserman, *Multiple View Geometry*,
//! section 8.8.
//!
//! Guarantees: exact for exact corners. Does not guarantee: that what was marked is a rectangle; how far it is from one is in
//! [`Proportions::angle_rad`] where the focal length is known. Cost: none to speak of.

use crate::homography::{Homography, HomographyError};
use glam::{DMat3, DVec2, DVec3, dvec2};
use serde::{Deserialize, Serialize};

/// Prior knowledge of the view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Known {
    /// The ratio width / height, positive.
    Ratio(f64),
    /// The focal length in pixels, positive.
    Focal(f64),
    /// That the sides are at right angles.
    RightAngles,
}

/// The proportions of a rectangle in perspective.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Proportions {
    /// Width / height: the side from corner 0 to corner 1 by the one from 1 to 2.
    pub ratio: f64,
    /// The standard deviation of the ratio, as a share of it, if each coordinate of a corner has one of 1 pixel. 0 for a
    /// ratio that was given.
    pub ratio_sigma_rel: f64,
    /// The focal length in pixels: the one that was given, or the one that makes right angles. None if the ratio was given, or
    /// if every focal length gives the same, because the plane is seen from straight on.
    pub focal_px: Option<f64>,
    /// The angle between the sides, π / 2 if it was taken for granted.
    pub angle_rad: f64,
}

/// Why the proportions are not known.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ProportionError {
    /// The corners make no quadrilateral that a camera sees.
    #[error(transparent)]
    NoPlane(#[from] HomographyError),
    /// A given value is not a positive number.
    #[error("the {what} is {value}, but must be a positive number")]
    Value {
        /// Name of the value.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// One pair of sides is (nearly) parallel in the picture, so that right angles say nothing about the focal length.
    #[error(
        "one pair of sides is parallel in the picture, or nearly, which leaves the proportions open: give the focal length or \
         the ratio of width and height"
    )]
    ParallelSides,
    /// No focal length makes right angles.
    #[error(
        "no camera with its axis through the given point sees right angles there: the picture may be cropped or the corners \
         be off; give the focal length or the ratio of width and height"
    )]
    NotRectangular,
}

/// Step of a corner for a derivative, in pixels: anything between rounding and curvature.
const STEP_PX: f64 = 1e-3;

/// Sides whose directions turn by less than this on the picture count as parallel, in radians: the corners of a quadrilateral
/// of 500 pixels known to a hundredth of a pixel say no more.
const MIN_CONVERGENCE: f64 = 2e-5;

/// The standard deviation of the ratio beyond which it counts as open: at one half, a square may be a double square.
const MAX_SIGMA_REL: f64 = 0.5;

/// The proportions of the rectangle whose corners appear as `quad`, in turn: the first side is the width. Corners and
/// `principal` point in pixels, x right, y down, pixel centers at half-integers.
///
/// ```
/// use glam::dvec2;
/// use ravec_planar::{Known, proportions};
///
/// // a sheet of DIN A4, 297 × 210 mm, on 1000 × 750 pixels
/// let quad = [dvec2(224.81, 224.77), dvec2(743.40, 168.00), dvec2(797.13, 537.21), dvec2(352.85, 500.15)];
/// let middle = dvec2(500.0, 375.0);
/// let known = proportions(quad, middle, Known::Focal(900.0))?;
/// let right = proportions(quad, middle, Known::RightAngles)?;
/// assert!((known.ratio - 297.0 / 210.0).abs() < 1e-3 && (right.ratio - 297.0 / 210.0).abs() < 1e-3);
/// assert!((right.focal_px.unwrap() - 900.0).abs() < 1.0);
/// # Ok::<(), ravec_planar::ProportionError>(())
/// ```
///
/// # Errors
/// [`ProportionError`]; right angles say nothing if one pair of sides is parallel in the picture and the other is not, as of a
/// floor seen by a level camera that looks straight ahead. If both are, the plane is seen from straight on and all is known.
pub fn proportions(
    quad: [DVec2; 4],
    principal: DVec2,
    known: Known,
) -> Result<Proportions, ProportionError> {
    if let Known::Ratio(value) | Known::Focal(value) = known
        && !(value > 0.0 && value.is_finite())
    {
        let what = if matches!(known, Known::Ratio(_)) {
            "ratio of width and height"
        } else {
            "focal length"
        };
        return Err(ProportionError::Value { what, value });
    }
    let mut found = at_corners(quad, principal, known)?;
    let mut variance = 0.0;
    for corner in 0..4 {
        for axis in [DVec2::X, DVec2::Y] {
            let moved = |by: f64| {
                let mut quad = quad;
                quad[corner] += axis * by;
                at_corners(quad, principal, known).map(|found| found.ratio.ln())
            };
            // a corner that cannot move leaves everything open
            let (Ok(ahead), Ok(back)) = (moved(STEP_PX), moved(-STEP_PX)) else {
                return Err(ProportionError::ParallelSides);
            };
            variance += ((ahead - back) / (2.0 * STEP_PX)).powi(2);
        }
    }
    found.ratio_sigma_rel = variance.sqrt();
    if found.ratio_sigma_rel > MAX_SIGMA_REL && known == Known::RightAngles {
        return Err(ProportionError::ParallelSides);
    }
    Ok(found)
}

fn at_corners(
    quad: [DVec2; 4],
    principal: DVec2,
    known: Known,
) -> Result<Proportions, ProportionError> {
    let centered = quad.map(|corner| corner - principal);
    let map = Homography::from_unit_square(centered)?.matrix();
    let (across, down) = (map.x_axis, map.y_axis);
    let by_focal = |focal: f64| {
        let ray = |h: DVec3| DVec3::new(h.x / focal, h.y / focal, h.z);
        let (across, down) = (ray(across), ray(down));
        (across.length() / down.length(), across.angle_between(down))
    };
    let result = |ratio, focal_px, angle_rad| Proportions {
        ratio,
        ratio_sigma_rel: 0.0,
        focal_px,
        angle_rad,
    };
    match known {
        Known::Ratio(ratio) => Ok(result(ratio, None, std::f64::consts::FRAC_PI_2)),
        Known::Focal(focal) => {
            let (ratio, angle) = by_focal(focal);
            Ok(result(ratio, Some(focal), angle))
        }
        Known::RightAngles => {
            // how far a side turns along the other one: its length on the picture by the distance of the point where it meets
            // the opposite one
            let turns = |h: DVec3| h.z.abs() / map.z_axis.z.abs();
            let parallel = |h: DVec3| turns(h) < MIN_CONVERGENCE;
            match (parallel(across), parallel(down)) {
                (true, true) => {
                    let (across, down) = (across.truncate(), down.truncate());
                    let ratio = across.length() / down.length();
                    Ok(result(ratio, None, across.angle_to(down).abs()))
                }
                (false, false) => {
                    let product = across.truncate().dot(down.truncate());
                    let square = -product / (across.z * down.z);
                    if square.is_nan() || square <= 0.0 {
                        return Err(ProportionError::NotRectangular);
                    }
                    let focal = square.sqrt();
                    Ok(result(
                        by_focal(focal).0,
                        Some(focal),
                        std::f64::consts::FRAC_PI_2,
                    ))
                }
                _ => Err(ProportionError::ParallelSides),
            }
        }
    }
}

/// A plane seen from straight on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Straight {
    /// Leads from pixels of the new picture to those of the old one.
    pub image_from_straight: Homography,
    /// Width and height of the new picture in pixels, at least 1 each, as whole numbers.
    pub size: DVec2,
}

/// Margin of the plane beyond the quadrilateral that is shown, as a multiple of its sides to each side, 0 to 100
/// (default 0). Only as much as the picture shows is taken.
pub type Margin = f64;

/// The quadrilateral as a rectangle of the given `ratio` (width / height), with as many pixels as it has in the picture; or
/// `scale` times as many in each direction. With a `margin`, the plane around it as well, as far as a picture of
/// `picture` width and height shows it. Corners in pixels, x right, y down, pixel centers at half-integers.
///
/// # Errors
/// As [`Homography::from_unit_square`].
pub fn straight_view(
    quad: [DVec2; 4],
    ratio: f64,
    scale: f64,
    margin: Margin,
    picture: DVec2,
) -> Result<Straight, HomographyError> {
    let image_from_unit = Homography::from_unit_square(quad)?;
    let area = 0.5 * (quad[2] - quad[0]).perp_dot(quad[3] - quad[1]).abs();
    // the sides of a rectangle of this area and ratio
    let sides = scale * dvec2((area * ratio).sqrt(), (area / ratio).sqrt());
    let (low, high) = seen_of_plane(&image_from_unit, margin, picture);
    let size = (sides * (high - low)).round().max(DVec2::ONE);
    // whole pixels: the scale gives way by less than one
    let unit_from_straight = DMat3::from_translation(low) * DMat3::from_scale((high - low) / size);
    let unit_from_straight = Homography::from_matrix(unit_from_straight)?;
    Ok(Straight {
        image_from_straight: image_from_unit * unit_from_straight,
        size,
    })
}

/// The corners of the rectangle around what the picture shows of the plane in front of the horizon, in units of the
/// quadrilateral, from −`margin` to 1 + `margin`.
fn seen_of_plane(image_from_unit: &Homography, margin: Margin, picture: DVec2) -> (DVec2, DVec2) {
    if margin.is_nan() || margin <= 0.0 {
        return (DVec2::ZERO, DVec2::ONE);
    }
    let margin = margin.min(100.0);
    // the plane's square, cut by the borders of the picture and by the horizon: a point x is inside if line · H x ≥ 0
    let matrix = image_from_unit.matrix();
    let lines = [
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(-1.0, 0.0, picture.x),
        DVec3::new(0.0, 1.0, 0.0),
        DVec3::new(0.0, -1.0, picture.y),
        DVec3::new(0.0, 0.0, 1.0),
    ];
    let (near, far) = (-margin, 1.0 + margin);
    let mut polygon = vec![
        dvec2(near, near),
        dvec2(far, near),
        dvec2(far, far),
        dvec2(near, far),
    ];
    for line in lines {
        let inside = |at: DVec2| line.dot(matrix * at.extend(1.0));
        let mut cut = Vec::new();
        for (index, &at) in polygon.iter().enumerate() {
            let next = polygon[(index + 1) % polygon.len()];
            let (here, there) = (inside(at), inside(next));
            if here >= 0.0 {
                cut.push(at);
            }
            if (here >= 0.0) != (there >= 0.0) {
                cut.push(at.lerp(next, here / (here - there)));
            }
        }
        polygon = cut;
    }
    let low = polygon.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = polygon
        .iter()
        .copied()
        .fold(DVec2::NEG_INFINITY, DVec2::max);
    // of a quadrilateral beside the picture there may be nothing
    if (high - low).cmpgt(DVec2::ZERO).all() {
        (low, high)
    } else {
        (DVec2::ZERO, DVec2::ONE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, EulerRot};
    use proptest::prelude::*;

    const PRINCIPAL: DVec2 = dvec2(800.0, 600.0);

    /// The corners of a rectangle of `sides` at a distance of 5, turned about all axes, seen with `focal` pixels.
    fn seen(sides: DVec2, angles: [f64; 3], focal: f64) -> [DVec2; 4] {
        let turn = DQuat::from_euler(EulerRot::YXZ, angles[0], angles[1], angles[2]);
        let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)];
        corners.map(|(x, y)| {
            let at = turn * (dvec2(x, y) * sides).extend(0.0) + DVec3::new(0.3, -0.2, 5.0);
            PRINCIPAL + focal * at.truncate() / at.z
        })
    }

    proptest! {
        #[test]
        fn the_focal_length_gives_the_ratio(
            width in 0.5..3.0, height in 0.5..3.0, yaw in -1.0..1.0, pitch in -1.0..1.0, roll in -3.0..3.0,
            focal in 500.0..3000.0
        ) {
            let quad = seen(dvec2(width, height), [yaw, pitch, roll], focal);
            let found = proportions(quad, PRINCIPAL, Known::Focal(focal)).unwrap();
            prop_assert!((found.ratio * height / width - 1.0).abs() < 1e-9);
            prop_assert!((found.angle_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-8);
        }

        #[test]
        fn right_angles_give_focal_length_and_ratio(
            width in 0.5..3.0, height in 0.5..3.0, yaw in 0.2..1.0, pitch in 0.2..1.0, roll in -0.3..0.3,
            focal in 500.0..3000.0
        ) {
            let quad = seen(dvec2(width, height), [yaw, pitch, roll], focal);
            if let Ok(found) = proportions(quad, PRINCIPAL, Known::RightAngles) {
                prop_assert!((found.ratio * height / width - 1.0).abs() < 1e-6, "{found:?}");
                prop_assert!((found.focal_px.unwrap() / focal - 1.0).abs() < 1e-5, "{found:?}");
            } else {
                // only where a roll undoes what yaw and pitch do
                let known = proportions(quad, PRINCIPAL, Known::Focal(focal)).unwrap();
                prop_assert!(roll.abs() > 0.02 || known.ratio_sigma_rel > 0.5);
            }
        }
    }

    #[test]
    fn the_stated_deviation_is_that_of_corners_that_are_a_pixel_off() {
        let quad = seen(dvec2(2.0, 1.5), [0.6, 0.4, 0.1], 1500.0);
        let known = Known::RightAngles;
        let found = proportions(quad, PRINCIPAL, known).unwrap();
        let mut random = crate::random::SplitMix::new(3);
        let mut squares = 0.0;
        for _ in 0..400 {
            // the sum of 12 even numbers has a variance of 1
            let mut normal = || {
                (0..12)
                    .map(|_| random.below(1 << 20) as f64 / f64::from(1 << 20))
                    .sum::<f64>()
                    - 6.0
            };
            let moved = quad.map(|corner| corner + dvec2(normal(), normal()));
            let ratio = at_corners(moved, PRINCIPAL, known).unwrap().ratio;
            squares += (ratio / found.ratio).ln().powi(2);
        }
        let sigma = (squares / 400.0f64).sqrt();
        // 400 draws know a deviation to 3.5 %; the rest is curvature
        assert!(
            (sigma / found.ratio_sigma_rel - 1.0).abs() < 0.15,
            "{sigma} {found:?}"
        );
    }

    #[test]
    fn a_plane_seen_from_straight_on_needs_no_focal_length() {
        let quad = seen(dvec2(3.0, 2.0), [0.0, 0.0, 0.3], 1000.0);
        let found = proportions(quad, PRINCIPAL, Known::RightAngles).unwrap();
        assert!((found.ratio - 1.5).abs() < 1e-9 && found.focal_px.is_none());
    }

    #[test]
    fn what_leaves_the_ratio_open_is_refused() {
        // turned about one axis only: upper and lower side meet, the others are parallel
        let quad = seen(dvec2(3.0, 2.0), [0.7, 0.0, 0.0], 1000.0);
        assert_eq!(
            proportions(quad, PRINCIPAL, Known::RightAngles),
            Err(ProportionError::ParallelSides)
        );
        // cropped so far that the axis went through a point beyond both vanishing points
        let quad = seen(dvec2(3.0, 2.0), [0.6, 0.5, 0.1], 1000.0);
        assert_eq!(
            proportions(quad, DVec2::splat(2e4), Known::RightAngles),
            Err(ProportionError::NotRectangular)
        );
        for known in [
            Known::Focal(0.0),
            Known::Ratio(f64::NAN),
            Known::Ratio(-1.0),
        ] {
            let error = proportions(quad, PRINCIPAL, known).unwrap_err();
            assert!(matches!(error, ProportionError::Value { .. }), "{error}");
        }
        let line = [
            DVec2::ZERO,
            dvec2(1.0, 1.0),
            dvec2(2.0, 2.0),
            dvec2(9.0, 0.0),
        ];
        let error = proportions(line, PRINCIPAL, Known::Ratio(1.0)).unwrap_err();
        assert!(matches!(error, ProportionError::NoPlane(_)), "{error}");
    }

    #[test]
    fn the_straight_view_has_the_ratio_the_area_and_the_corners() {
        let quad = seen(dvec2(2.0, 1.0), [0.5, 0.3, 0.0], 1500.0);
        let view = straight_view(quad, 2.0, 1.0, 0.0, 2.0 * PRINCIPAL).unwrap();
        assert!((view.size.x / view.size.y - 2.0).abs() < 0.01);
        let area = 0.5 * (quad[2] - quad[0]).perp_dot(quad[3] - quad[1]);
        assert!((view.size.x * view.size.y / area - 1.0).abs() < 0.01);
        assert!(
            view.image_from_straight
                .apply(DVec2::ZERO)
                .distance(quad[0])
                < 1e-9
        );
        assert!(view.image_from_straight.apply(view.size).distance(quad[2]) < 1e-9);
    }

    #[test]
    fn a_margin_shows_what_the_picture_shows_and_no_more() {
        // from straight on: half a picture to each side
        let quad = [
            (400.0, 300.0),
            (1200.0, 300.0),
            (1200.0, 900.0),
            (400.0, 900.0),
        ];
        let quad = quad.map(DVec2::from);
        let view = straight_view(quad, 4.0 / 3.0, 1.0, 9.0, 2.0 * PRINCIPAL).unwrap();
        assert_eq!(view.size, dvec2(1600.0, 1200.0));
        assert!(view.image_from_straight.apply(DVec2::ZERO).length() < 1e-9);
        let view = straight_view(quad, 4.0 / 3.0, 0.5, 0.25, 2.0 * PRINCIPAL).unwrap();
        assert_eq!(view.size, dvec2(600.0, 450.0));
        // a floor towards its horizon ends where the margin does
        let floor = [
            (700.0, 620.0),
            (900.0, 620.0),
            (1500.0, 1100.0),
            (100.0, 1100.0),
        ];
        let view = straight_view(floor.map(DVec2::from), 0.5, 1.0, 2.0, 2.0 * PRINCIPAL).unwrap();
        assert!(
            view.size.is_finite() && view.size.y < 5000.0,
            "{}",
            view.size
        );
    }
}
