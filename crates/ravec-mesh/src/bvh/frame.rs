//! The local coordinates of the boxes, and what rounding to `f32` costs.

use glam::DVec3;

use super::turned::GROWTH;
use crate::Aabb;

/// Coordinates in which the mesh is centered on the origin and has a half extent between 1 and 2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    origin: DVec3,
    /// A power of two: scaling loses no digit.
    scale: f64,
}

/// A point in the local frame, rounded to the precision of the boxes.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocalPoint {
    pub at: [f32; 3],
    /// No less than the distance by which rounding moved the point plus the errors of distances in double precision.
    pub slack: f64,
    /// These errors alone.
    rounding: f64,
}

/// Double precision errs by some 1e-16 of the larger of the mesh's size, about 2, and the distance to the point.
const ROUNDING: f64 = 1e-14;

/// A box in the local frame, rounded outward.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocalBox {
    pub min: [f32; 3],
    pub max: [f32; 3],
}

/// The largest `f32` that is not above `x`.
#[inline]
fn round_down(x: f64) -> f32 {
    let rounded = x as f32;
    if f64::from(rounded) > x {
        rounded.next_down()
    } else {
        rounded
    }
}

impl LocalBox {
    /// The smallest box that holds the given one.
    #[inline]
    pub fn around(min: DVec3, max: DVec3) -> Self {
        Self {
            min: min.to_array().map(round_down),
            max: max.to_array().map(|x| -round_down(-x)),
        }
    }

    /// Returns `true` if both share a point.
    #[inline]
    pub fn touches(&self, other: &Self) -> bool {
        // without branches, of which nobody could foretell the outcome
        (0..3).fold(true, |touches, axis| {
            let (below, above) = (
                self.min[axis] <= other.max[axis],
                other.min[axis] <= self.max[axis],
            );
            touches & below & above
        })
    }
}

impl Frame {
    pub fn around(bounds: Aabb) -> Self {
        let half = 0.5 * bounds.size().max_element();
        if bounds.is_empty() || half <= 0.0 {
            let origin = if bounds.is_empty() {
                DVec3::ZERO
            } else {
                bounds.min
            };
            return Self { origin, scale: 1.0 };
        }
        // 2^exponent <= half < 2^(exponent + 1); kept where the power and its inverse are ordinary numbers.
        let exponent = half.log2().floor().clamp(-1000.0, 1000.0);
        Self {
            origin: bounds.center(),
            scale: (-exponent).exp2(),
        }
    }

    #[inline]
    pub fn to_local(self, p: DVec3) -> DVec3 {
        (p - self.origin) * self.scale
    }

    #[inline]
    pub fn local_point(self, p: DVec3) -> LocalPoint {
        let exact = self.to_local(p);
        let at = [exact.x as f32, exact.y as f32, exact.z as f32];
        let moved = exact - DVec3::new(at[0].into(), at[1].into(), at[2].into());
        let rounding = ROUNDING * (2.0 + exact.abs().max_element());
        let slack = moved.length() + rounding;
        LocalPoint {
            at,
            slack,
            rounding,
        }
    }

    /// No less than what distances from the point are off in double precision.
    #[inline]
    pub fn rounding(self, point: &LocalPoint) -> f64 {
        point.rounding / self.scale
    }

    /// The box around the given points.
    #[inline]
    pub fn local_box(self, min: DVec3, max: DVec3) -> LocalBox {
        LocalBox::around(self.to_local(min), self.to_local(max))
    }

    /// A squared distance in the local frame that is exceeded only by boxes whose content is farther from the point
    /// than the given squared distance.
    #[inline]
    pub fn reach_sq(self, point: &LocalPoint, distance_sq: f64) -> f32 {
        self.widened_sq(distance_sq.sqrt(), point.slack)
    }

    /// Rounding error of the corners of something of the given size once they are turned: see [`GROWTH`].
    #[inline]
    pub fn turned_slack(self, size: f64) -> f64 {
        GROWTH * size * self.scale
    }

    /// As [`Self::reach_sq`], for distances from something whose corners are off by no more than `slack` in the local frame.
    #[inline]
    pub fn widened_sq(self, distance: f64, slack: f64) -> f32 {
        let distance = distance * self.scale + slack;
        // Of the squared distance of a box, six roundings of `f32` are 0.4e-6, axes that are rounded unit vectors make
        // 0.2e-6, and turning a point at that distance 0.9e-6.
        (distance * distance * (1.0 + 4e-6)) as f32
    }
}
