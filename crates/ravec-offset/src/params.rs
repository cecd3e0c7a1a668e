//! Parameters of an offset.

mod error;

pub use error::OffsetError;
pub use ravec_mesh::Coordinates;

use ravec_mesh::Aabb;
use serde::{Deserialize, Serialize};

/// Part of the surface at the distance.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// All that is at the distance, whatever the triangles are.
    ///
    /// The surface has points on every side of every triangle.
    #[default]
    Both,
    /// The part reachable from outside: the mesh grows, and its cavities are filled.
    Outer,
    /// Inside a closed mesh: it shrinks.
    Inner,
    /// The closed mesh, hollowed: its walls are as thick as the distance.
    ///
    /// The result has the triangles of the mesh and the surface inside them.
    Shell,
}

impl Side {
    /// True if the surface is inside the solid that the triangles enclose, which must be closed.
    pub fn is_inward(self) -> bool {
        matches!(self, Self::Inner | Self::Shell)
    }
}

/// Treatment of a mesh that is not closed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum OpenRule {
    /// Refuse it where a side needs an inside.
    #[default]
    Refuse,
    /// Take it for a sheet, which becomes as thick as the distance on the side that its triangles face.
    ///
    /// The sheet may be open or closed; its triangles face the side from which they are counterclockwise. The sheet is one
    /// skin of the result, the other skin is at the distance, and upright walls stand along the boundary. Parts of the sheet
    /// that are nearer to each other than the distance share one solid.
    Thicken,
}

/// Parameters of an offset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OffsetParams {
    /// Distance, in units of the mesh, above 0 (default 1). With [`OpenRule::Thicken`] it may be negative: the sheet is
    /// thickened on its other side.
    pub distance: f64,
    /// Largest error of the distance of any point of the result, in units of the mesh, above 0 and below half the distance
    /// (default 0.01). Smaller tolerances cost more cells and triangles.
    pub tolerance: f64,
    /// Side of the surface (default both).
    pub side: Side,
    /// Treatment of a mesh that is not closed (default refuse). Thickening requires side both.
    pub open: OpenRule,
    /// Merge triangles as far as the tolerance allows, and improve those that are tilted afterwards (default true).
    pub simplify: bool,
    /// Largest angle, in degrees, by which simplification may tilt a triangle against the surface that it represents, above 0
    /// and at most 90 (default: [`Self::normal_deviation_deg`]). Triangles at creases that are tilted more from the start may
    /// remain so. Smaller values keep more triangles.
    ///
    /// Without an explicit limit, triangles may be tilted by up to 80 % more in two cases: where the mesh is rough, as scans
    /// are (three quarters of it bend from triangle to triangle by at least 4 radians along a path as long as its diagonal);
    /// and, in proportion, where more than a sixth of the triangles would remain. With an explicit limit, tilted triangles are
    /// also improved before merging, which takes memory beyond [`Self::memory_bytes`].
    pub max_normal_deviation_deg: Option<f64>,
    /// Precision of the coordinates of the result (default double). Single precision requires a tolerance of at least about 20
    /// times the gap between 32-bit floats there; the vertices of a mesh that becomes part of the result, as in a
    /// [`Side::Shell`], are rounded first.
    pub coordinates: Coordinates,
    /// Memory limit in bytes (default none). Smaller limits divide space into more tiles, which takes longer, and keep a large
    /// surface in a [`Storage`](crate::Storage); the surface before simplification is the same.
    ///
    /// The limit rests on estimates, and some data stays in memory regardless, so limits below about 200 MB may be exceeded by
    /// half.
    pub memory_bytes: Option<u64>,
}

impl Default for OffsetParams {
    fn default() -> Self {
        Self {
            distance: 1.0,
            tolerance: 0.01,
            side: Side::default(),
            open: OpenRule::default(),
            simplify: true,
            max_normal_deviation_deg: None,
            coordinates: Coordinates::default(),
            memory_bytes: None,
        }
    }
}

/// Bound on the cells along a side of the root that a tolerance may require: the lattice has 2²⁰.
const MAX_CELLS: f64 = 1_048_576.0;

/// Smallest tolerance relative to the coordinates: about 2000 roundings.
const FINEST: f64 = 4e-13;

/// Range of sizes whose squares and cubes are representable.
const SIZES: std::ops::Range<f64> = 1e-40..1e40;

/// Rounds a positive number up to three digits, by at most the factor [`MAX_RAISED`], so that a printed limit is one that a
/// user can type.
fn rounded_up(number: f64) -> f64 {
    // half a unit of the third digit is at most half a percent
    let digits = format!("{:.2e}", 1.005 * number);
    digits.parse().unwrap_or(number)
}

/// Bound on the factor of [`rounded_up`].
const MAX_RAISED: f64 = 1.011;

/// Default limit of the tilt of a triangle, in degrees, for tolerances up to [`COARSE`].
const NORMAL_DEVIATION_DEG: f64 = 4.0;

/// Tolerance, relative to the distance, above which the default limit of the tilt grows.
pub(crate) const COARSE: f64 = 0.05;

impl OffsetParams {
    /// Limit of the tilt of triangles in degrees: the explicit limit, or 4, and for tolerances ε above a twentieth of the
    /// distance δ 4 √(20 ε/δ).
    ///
    /// A chord of a rounded edge, whose radius is the distance, reaches the tolerance at an angle that grows as √(ε/δ). A limit
    /// that did not grow with it would keep many more triangles than the tolerance requires.
    pub fn normal_deviation_deg(&self) -> f64 {
        self.max_normal_deviation_deg.unwrap_or_else(|| {
            let coarseness = self.tolerance / (COARSE * self.distance);
            NORMAL_DEVIATION_DEG * coarseness.max(1.0).sqrt()
        })
    }

    /// Checks the ranges of the parameters that do not depend on the mesh.
    ///
    /// # Errors
    /// [`OffsetError::NormalDeviation`].
    pub fn check_ranges(&self) -> Result<(), OffsetError> {
        match self.max_normal_deviation_deg {
            Some(got) if !(got > 0.0 && got <= 90.0) => Err(OffsetError::NormalDeviation { got }),
            _ => Ok(()),
        }
    }

    /// Checks the parameters for a mesh with these bounds.
    pub(crate) fn check(&self, bounds: &Aabb) -> Result<(), OffsetError> {
        let diagonal = bounds.diagonal();
        if diagonal > 0.0 && !SIZES.contains(&diagonal) {
            return Err(OffsetError::Size { diagonal });
        }
        let distance = self.distance;
        let reach = diagonal + 4.0 * distance;
        if !(distance.is_finite() && distance > 0.0) {
            return Err(OffsetError::Distance { got: distance });
        }
        if !SIZES.contains(&reach) {
            return Err(OffsetError::DistanceSize { got: distance });
        }
        // the lattice must be fine enough, and points far from the origin must still differ
        let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
        let of_numbers = rounded_up(farthest * FINEST);
        let least = rounded_up(reach * 3f64.sqrt() / MAX_CELLS).max(of_numbers);
        let most = 0.5 * distance;
        if least >= most {
            // the distance at which both bounds are equal, before rounding
            let of_lattice = 2.0 * 3f64.sqrt() * diagonal / (MAX_CELLS - 8.0 * 3f64.sqrt());
            let of_lattice = MAX_RAISED * of_lattice;
            return Err(OffsetError::DistanceTooSmall {
                got: distance,
                least: rounded_up(of_lattice).max(2.0 * of_numbers),
            });
        }
        let got = self.tolerance;
        if !(got.is_finite() && got >= least && got < most) {
            return Err(OffsetError::Tolerance { got, least, most });
        }
        self.check_ranges()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_may_be_turned_by_more_where_the_tolerance_is_coarse() {
        let of = |tolerance, max_normal_deviation_deg| {
            let params = OffsetParams {
                distance: 2.0,
                tolerance,
                max_normal_deviation_deg,
                ..OffsetParams::default()
            };
            params.normal_deviation_deg()
        };
        assert!((of(0.001, None) - 4.0).abs() < 1e-12);
        assert!((of(0.1, None) - 4.0).abs() < 1e-12);
        assert!((of(0.4, None) - 8.0).abs() < 1e-12);
        assert!((of(0.4, Some(3.0)) - 3.0).abs() < 1e-12);
    }
}
