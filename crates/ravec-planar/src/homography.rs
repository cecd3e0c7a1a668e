//! The homography: how one picture of a plane maps to another.
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers. A map is named after where it leads:
//! `dst_from_src`, so that `c_from_b * b_from_a` is `c_from_a`.
//!
//! The matrix is kept with a determinant of 1 or −1 (−1 mirrors), by a factor that is never negative. Its overall sign
//! therefore means something: points for which the third coordinate comes out positive are *in front*, the line where it is
//! zero is the *horizon*, and what lies behind it is seen by no camera that sees the rest.
//!
//! Source: Hartley and Zisserman, *Multiple View Geometry in Computer Vision*, chapters 2 and 4.
//!
//! Guarantees: the matrix is finite and regular; the closed form from four pairs reproduces them to rounding. Does not
//! guarantee: that a region lies in front; ask [`Homography::is_in_front`].

use glam::{DMat2, DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// An invertible projective map of the plane.
///
/// ```
/// use glam::dvec2;
/// use ravec_planar::Homography;
///
/// // a unit square seen from the side
/// let quad = [dvec2(10.0, 10.0), dvec2(90.0, 25.0), dvec2(90.0, 75.0), dvec2(10.0, 95.0)];
/// let image_from_unit = Homography::from_unit_square(quad)?;
/// let middle = image_from_unit.apply(dvec2(0.5, 0.5));
/// // the middle of the square is where the diagonals of its picture meet, nearer to the far side
/// assert!(middle.x > 50.0);
/// assert!(image_from_unit.inverse().apply(middle).distance(dvec2(0.5, 0.5)) < 1e-12);
/// # Ok::<(), ravec_planar::HomographyError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "DMat3", into = "DMat3")]
pub struct Homography {
    matrix: DMat3,
}

/// Why there is no such homography.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HomographyError {
    /// Too few pairs of points.
    #[error("a homography needs at least 4 pairs of points, got {got}")]
    TooFew {
        /// Number of pairs.
        got: usize,
    },
    /// The points leave the map open, or would make it singular.
    #[error(
        "the points are (nearly) collinear or coincide: their spread is {ratio:.1e} of what it should be"
    )]
    Degenerate {
        /// Distance of the pairs from degeneracy, from 0 to 1.
        ratio: f64,
    },
    /// The matrix cannot be inverted.
    #[error("the matrix is singular")]
    Singular,
    /// A coordinate is infinite or not a number.
    #[error("a coordinate is infinite or not a number")]
    NonFinite,
    /// The horizon runs through the region, so that no picture shows all of it.
    #[error(
        "the horizon crosses the region: its corners are not a convex quadrilateral seen by one camera"
    )]
    HorizonCrosses,
    /// Contaminated pairs agree on nothing.
    #[error("the best homography fits {inliers} of {pairs} pairs, but {needed} are needed")]
    NoConsensus {
        /// Pairs that the best homography explains.
        inliers: usize,
        /// Pairs that were given.
        pairs: usize,
        /// Pairs that must be explained.
        needed: usize,
    },
}

/// Twice a triangle's area below this share of its longest side's square counts as none: the closed form would lose
/// ten of its sixteen digits. Larger refuses slivers that can still be computed with.
const MIN_SPREAD: f64 = 1e-10;

impl Homography {
    /// The map that leaves every point where it is.
    pub const IDENTITY: Self = Self {
        matrix: DMat3::IDENTITY,
    };

    /// The map of a matrix that acts on (x, y, 1), x right, y down, pixel centers at half-integers. Any positive factor
    /// gives the same map; a negative one turns front and back around.
    ///
    /// # Errors
    /// [`HomographyError::NonFinite`], and [`HomographyError::Singular`] if the determinant is lost in rounding.
    pub fn from_matrix(matrix: DMat3) -> Result<Self, HomographyError> {
        if !matrix.is_finite() {
            return Err(HomographyError::NonFinite);
        }
        // keeps the determinant of huge and tiny matrices in range
        let largest = matrix
            .to_cols_array()
            .into_iter()
            .fold(0.0, |a: f64, b| a.max(b.abs()));
        if largest == 0.0 {
            return Err(HomographyError::Singular);
        }
        let scaled = matrix * largest.recip();
        let determinant = scaled.determinant().abs();
        // the rounding of a determinant is a few ε times the product of its columns' lengths
        let size = scaled.x_axis.length() * scaled.y_axis.length() * scaled.z_axis.length();
        if determinant.is_nan() || determinant <= 16.0 * f64::EPSILON * size {
            return Err(HomographyError::Singular);
        }
        let matrix = scaled * determinant.cbrt().recip();
        if matrix.is_finite() {
            Ok(Self { matrix })
        } else {
            Err(HomographyError::Singular)
        }
    }

    /// The shift by an offset in pixels.
    ///
    /// # Errors
    /// [`HomographyError::NonFinite`].
    pub fn from_translation(offset: DVec2) -> Result<Self, HomographyError> {
        Self::from_matrix(DMat3::from_translation(offset))
    }

    /// The scaling about (0, 0), the outer corner of the first pixel, by factors other than 0.
    ///
    /// # Errors
    /// [`HomographyError::NonFinite`], [`HomographyError::Singular`].
    pub fn from_scale(factors: DVec2) -> Result<Self, HomographyError> {
        Self::from_matrix(DMat3::from_scale(factors))
    }

    /// The map that takes four points to four others, in closed form. Points are in pixels, x right, y down, pixel centers
    /// at half-integers.
    ///
    /// The order of the points does not matter, as long as it is the same on both sides. All of them lie in front.
    ///
    /// # Errors
    /// [`HomographyError::Degenerate`] if three points of a side are collinear, [`HomographyError::HorizonCrosses`] if the
    /// map would tear the points apart (one side is a convex quadrilateral in this order, the other is not),
    /// [`HomographyError::NonFinite`].
    pub fn from_pairs(src: &[DVec2; 4], dst: &[DVec2; 4]) -> Result<Self, HomographyError> {
        let (from, to) = (weights(src)?, weights(dst)?);
        // the map of the projective frame (p0, p1, p2; p3): each of its points with the factor that makes them sum to p3
        let frame = |p: &[DVec2; 4], k: [f64; 3]| {
            let col = |i: usize| (p[i] - p[3]).extend(1.0) * k[i];
            DMat3::from_cols(col(0), col(1), col(2))
        };
        let ratio = [0, 1, 2].map(|i| to[i] / from[i]);
        if ratio.iter().any(|&r| r <= 0.0) {
            return Err(HomographyError::HorizonCrosses);
        }
        // p0 … p2 as corners of a triangle around the origin: its inverse is the one of barycentric coordinates
        let shifted = frame(dst, ratio) * barycentric(src);
        let matrix = DMat3::from_translation(dst[3]) * shifted * DMat3::from_translation(-src[3]);
        Self::from_matrix(matrix)
    }

    /// The map that takes the corners (0, 0), (1, 0), (1, 1), (0, 1) to those of a quadrilateral, in pixels, x right,
    /// y down, pixel centers at half-integers.
    ///
    /// # Errors
    /// As [`Homography::from_pairs`]; a quadrilateral that is not convex, or crosses itself, has the horizon in it.
    pub fn from_unit_square(quad: [DVec2; 4]) -> Result<Self, HomographyError> {
        Self::from_pairs(&[DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y], &quad)
    }

    /// The matrix, of determinant 1 or −1.
    pub fn matrix(&self) -> DMat3 {
        self.matrix
    }

    /// The matrix row by row, divided by its last element as is usual in files; undivided if that is 0.
    pub fn to_rows(&self) -> [f64; 9] {
        let rows = self.matrix.transpose().to_cols_array();
        if rows[8] == 0.0 {
            rows
        } else {
            rows.map(|v| v / rows[8])
        }
    }

    /// The image of a point, in pixels, x right, y down, pixel centers at half-integers. On the horizon it is infinite or
    /// not a number, behind the horizon it is where no camera sees it.
    #[inline]
    pub fn apply(&self, point: DVec2) -> DVec2 {
        let image = self.matrix * point.extend(1.0);
        image.truncate() / image.z
    }

    /// The image of a point in front of the horizon, or nothing. Points are in pixels, x right, y down, pixel centers at
    /// half-integers.
    #[inline]
    pub fn try_apply(&self, point: DVec2) -> Option<DVec2> {
        let image = self.matrix * point.extend(1.0);
        let mapped = image.truncate() / image.z;
        (image.z > 0.0 && mapped.is_finite()).then_some(mapped)
    }

    /// The image of a homogeneous point: (x, y, 1) in pixels, x right, y down, pixel centers at half-integers, or
    /// (dx, dy, 0) for the infinitely far end of a direction, whose image is its vanishing point.
    #[inline]
    pub fn apply_homogeneous(&self, point: DVec3) -> DVec3 {
        self.matrix * point
    }

    /// The image of a direction that starts at a point (in pixels, x right, y down, pixel centers at half-integers): how
    /// the image of the point moves when the point moves that way.
    #[inline]
    pub fn apply_direction(&self, at: DVec2, direction: DVec2) -> DVec2 {
        self.jacobian(at) * direction
    }

    /// The derivatives of the image of a point by its coordinates, in pixels, x right, y down, pixel centers at
    /// half-integers. Column 0 is by x.
    #[inline]
    pub fn jacobian(&self, at: DVec2) -> DMat2 {
        let m = &self.matrix;
        let image = *m * at.extend(1.0);
        let mapped = image.truncate() / image.z;
        DMat2::from_cols(
            (m.x_axis.truncate() - mapped * m.x_axis.z) / image.z,
            (m.y_axis.truncate() - mapped * m.y_axis.z) / image.z,
        )
    }

    /// The largest factor by which the map stretches small lengths around a point, in pixels, x right, y down, pixel centers at
    /// half-integers: the larger singular value of its derivatives.
    ///
    /// ```
    /// use glam::dvec2;
    /// use ravec_planar::Homography;
    ///
    /// let map = Homography::from_scale(dvec2(2.0, 3.0))?;
    /// assert!((map.largest_stretch(dvec2(5.0, 7.0)) - 3.0).abs() < 1e-12);
    /// # Ok::<(), ravec_planar::HomographyError>(())
    /// ```
    pub fn largest_stretch(&self, at: DVec2) -> f64 {
        let derivatives = self.jacobian(at);
        let (x, y) = (derivatives.x_axis, derivatives.y_axis);
        let mean = 0.5 * (x.length_squared() + y.length_squared());
        let half = 0.5 * (x.length_squared() - y.length_squared());
        (mean + half.hypot(x.dot(y))).sqrt()
    }

    /// The map back.
    pub fn inverse(&self) -> Self {
        // the determinant is ±1, so the inverse is finite whenever the matrix is; its sign keeps the same points in front:
        // G·(H·p) = p has third coordinate 1 for both signs of the determinant
        Self {
            matrix: self.matrix.inverse(),
        }
    }

    /// Returns `true` if all `points` (in pixels, x right, y down, pixel centers at half-integers) lie in front of the
    /// horizon. Then so does everything between them.
    pub fn is_in_front(&self, points: &[DVec2]) -> bool {
        points.iter().all(|&point| self.try_apply(point).is_some())
    }

    /// The same map, with `point` (in pixels, x right, y down, pixel centers at half-integers) in front of the horizon.
    pub fn facing(&self, point: DVec2) -> Self {
        if (self.matrix * point.extend(1.0)).z < 0.0 {
            Self {
                matrix: -self.matrix,
            }
        } else {
            *self
        }
    }
}

/// First `right`, then `left`: `c_from_b * b_from_a` is `c_from_a`.
impl std::ops::Mul for Homography {
    type Output = Self;

    fn mul(self, right: Self) -> Self {
        // the determinant drifts by rounding only
        let matrix = self.matrix * right.matrix;
        let factor = matrix.determinant().abs().cbrt().recip();
        Self {
            matrix: if factor.is_finite() {
                matrix * factor
            } else {
                matrix
            },
        }
    }
}

impl TryFrom<DMat3> for Homography {
    type Error = HomographyError;

    fn try_from(matrix: DMat3) -> Result<Self, HomographyError> {
        Self::from_matrix(matrix)
    }
}

impl From<Homography> for DMat3 {
    fn from(homography: Homography) -> Self {
        homography.matrix
    }
}

/// The barycentric coordinates of the fourth point in the triangle of the others: they sum to 1, and none is 0 if no
/// three points are collinear.
fn weights(p: &[DVec2; 4]) -> Result<[f64; 3], HomographyError> {
    if !p.iter().all(|p| p.is_finite()) {
        return Err(HomographyError::NonFinite);
    }
    let [a, b, c] = [p[0] - p[3], p[1] - p[3], p[2] - p[3]];
    // twice the areas of the triangles between the fourth point and two others, and of the three others
    let areas = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
    let whole = (b - a).perp_dot(c - a);
    let longest = [a, b, c, b - a, c - b, a - c]
        .iter()
        .fold(0.0, |l: f64, d| l.max(d.length_squared()));
    let smallest = areas.iter().fold(whole.abs(), |s, area| s.min(area.abs()));
    let ratio = smallest / longest;
    if ratio.is_nan() || ratio < MIN_SPREAD {
        return Err(HomographyError::Degenerate {
            ratio: if ratio.is_nan() { 0.0 } else { ratio },
        });
    }
    Ok(areas.map(|area| area / whole))
}

/// The matrix that takes (p − p₃, 1) to barycentric coordinates in the triangle of p₀ − p₃, p₁ − p₃, p₂ − p₃.
fn barycentric(p: &[DVec2; 4]) -> DMat3 {
    let [a, b, c] = [p[0] - p[3], p[1] - p[3], p[2] - p[3]];
    let whole = (b - a).perp_dot(c - a);
    // the share of a corner falls from 1 to 0 towards the opposite edge
    let row = |b: DVec2, c: DVec2| DVec3::new(b.y - c.y, c.x - b.x, b.perp_dot(c)) / whole;
    DMat3::from_cols(row(b, c), row(c, a), row(a, b)).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strategies::{homography, point};
    use glam::dvec2;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn four_pairs_are_reproduced(h in homography(), quad in prop::array::uniform4(point())) {
            let image = quad.map(|p| h.apply(p));
            match Homography::from_pairs(&quad, &image) {
                Ok(found) => for (p, q) in quad.iter().zip(image) {
                    prop_assert!(found.apply(*p).distance(q) < 1e-5);
                },
                // random points may be nearly collinear
                Err(error) => prop_assert!(matches!(error, HomographyError::Degenerate { .. }), "{error}"),
            }
        }

        #[test]
        fn the_map_of_well_spread_pairs_is_the_planted_one(h in homography(), p in point()) {
            let quad = [dvec2(0.0, 0.0), dvec2(900.0, 30.0), dvec2(1000.0, 700.0), dvec2(-20.0, 650.0)];
            let found = Homography::from_pairs(&quad, &quad.map(|p| h.apply(p))).unwrap();
            prop_assert!(found.apply(p).distance(h.apply(p)) < 1e-8);
        }

        #[test]
        fn the_inverse_leads_back_and_the_product_leads_on(a in homography(), b in homography(), p in point()) {
            prop_assert!(a.inverse().apply(a.apply(p)).distance(p) < 1e-8);
            prop_assert!(a.inverse().try_apply(a.apply(p)).is_some());
            prop_assert!((a * a.inverse()).matrix().abs_diff_eq(DMat3::IDENTITY, 1e-7));
            let (two, one) = (b.apply(a.apply(p)), (b * a).apply(p));
            prop_assert!(two.distance(one) < 1e-7 * (1.0 + two.length()));
            prop_assert!(((b * a).matrix().determinant().abs() - 1.0).abs() < 1e-9);
        }

        #[test]
        fn the_jacobian_agrees_with_finite_differences(h in homography(), p in point()) {
            const STEP: f64 = 1e-3;
            let jacobian = h.jacobian(p);
            for axis in [DVec2::X, DVec2::Y] {
                let truth = (h.apply(p + STEP * axis) - h.apply(p - STEP * axis)) / (2.0 * STEP);
                // third derivatives are below 1e-4, rounding below 1e-12 / STEP
                prop_assert!((jacobian * axis - truth).length() < 1e-7);
                prop_assert!((h.apply_direction(p, axis) - truth).length() < 1e-7);
            }
        }

        #[test]
        fn the_sign_of_the_matrix_is_kept(h in homography(), p in point(), factor in 0.01f64..100.0) {
            let same = Homography::from_matrix(h.matrix() * factor).unwrap();
            prop_assert!(same.matrix().abs_diff_eq(h.matrix(), 1e-9 * h.matrix().to_cols_array()[6].abs().max(1.0)));
            let turned = Homography::from_matrix(h.matrix() * -factor).unwrap();
            prop_assert!(turned.try_apply(p).is_none() && turned.apply(p).distance(h.apply(p)) < 1e-9);
            prop_assert!(turned.facing(p).try_apply(p).is_some());
        }
    }

    #[test]
    fn a_vanishing_point_is_where_parallels_meet() {
        let quad = [
            dvec2(0.0, 0.0),
            dvec2(100.0, 20.0),
            dvec2(100.0, 80.0),
            dvec2(0.0, 100.0),
        ];
        let h = Homography::from_unit_square(quad).unwrap();
        let far = h.apply_homogeneous(DVec3::X);
        // y = 0.2 x and y = 100 − 0.2 x
        assert!((far.truncate() / far.z).distance(dvec2(250.0, 50.0)) < 1e-9);
    }

    #[test]
    fn a_mirror_has_a_negative_determinant_and_all_in_front() {
        let mirror = Homography::from_scale(dvec2(-1.0, 1.0)).unwrap();
        assert!(mirror.matrix().determinant() < 0.0);
        assert!(mirror.is_in_front(&[dvec2(5.0, 5.0), dvec2(-5.0, 5.0)]));
        assert!(mirror.inverse().is_in_front(&[dvec2(-5.0, 5.0)]));
    }

    #[test]
    fn each_kind_of_bad_quad_has_its_own_error() {
        let square = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let with = |i: usize, p: DVec2| {
            let mut quad = square;
            quad[i] = p;
            Homography::from_unit_square(quad)
        };
        assert!(matches!(
            with(2, dvec2(0.5, 0.5)),
            Err(HomographyError::Degenerate { .. })
        ));
        assert!(matches!(
            with(1, DVec2::ZERO),
            Err(HomographyError::Degenerate { .. })
        ));
        // concave, and crossing itself
        assert_eq!(
            with(2, dvec2(0.2, 0.2)),
            Err(HomographyError::HorizonCrosses)
        );
        let crossed = [square[0], square[2], square[1], square[3]];
        assert_eq!(
            Homography::from_unit_square(crossed),
            Err(HomographyError::HorizonCrosses)
        );
        assert_eq!(
            with(0, dvec2(f64::NAN, 0.0)),
            Err(HomographyError::NonFinite)
        );
        let same = [DVec2::ONE; 4];
        assert!(matches!(
            Homography::from_unit_square(same),
            Err(HomographyError::Degenerate { ratio: 0.0 })
        ));
    }

    #[test]
    fn singular_and_infinite_matrices_are_refused() {
        let from = |m: [f64; 9]| Homography::from_matrix(DMat3::from_cols_array(&m));
        assert_eq!(from([0.0; 9]), Err(HomographyError::Singular));
        assert_eq!(
            from([1.0, 2.0, 3.0, 2.0, 4.0, 6.0, 0.0, 0.0, 1.0]),
            Err(HomographyError::Singular)
        );
        assert_eq!(from([f64::INFINITY; 9]), Err(HomographyError::NonFinite));
        assert!(from([1e-200, 0.0, 0.0, 0.0, 1e-200, 0.0, 0.0, 0.0, 1e-200]).is_ok());
    }

    #[test]
    fn the_matrix_that_is_stored_comes_back() {
        let h = Homography::from_translation(dvec2(3.0, 4.0)).unwrap();
        assert_eq!(Homography::try_from(DMat3::from(h)), Ok(h));
    }
}
