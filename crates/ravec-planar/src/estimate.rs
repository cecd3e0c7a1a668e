//! The homography that fits many pairs of points best.
//!
//! ```text
//! move and scale both sides to centroid 0 and mean distance √2
//! start: the smallest eigenvector of the 9 × 9 sum of the linear equations (dst × H·src = 0)
//! minimize Σ w (|dst − H·src|² + |src − H⁻¹·dst|²) over the 8 unknowns of H with h₃₃ = 1
//! ```
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers.
//!
//! Source: Hartley and Zisserman, *Multiple View Geometry*, algorithms 4.2 and 4.3 (symmetric transfer error).
//!
//! Guarantees: exact pairs give the exact map, to rounding; swapping the sides gives the inverse (up to the accuracy of the
//! minimum). Does not guarantee: anything with outliers among the pairs; see [`crate::estimate`].
//! Cost: linear in the pairs, a few passes.

use crate::homography::{Homography, HomographyError};
use glam::{DMat3, DVec2, DVec3};
use ravec_numeric::{Descent, NormalEquations, minimize, smallest_eigenvector};
use serde::{Deserialize, Serialize};

/// Two points that show the same thing, in pixels of their pictures, x right, y down, pixel centers at half-integers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PointPair {
    /// The point where the homography starts.
    pub src: DVec2,
    /// The point where it leads.
    pub dst: DVec2,
}

impl PointPair {
    /// A pair of points in pixels, x right, y down, pixel centers at half-integers.
    pub fn new(src: DVec2, dst: DVec2) -> Self {
        Self { src, dst }
    }

    /// The pair for the map back.
    pub fn swapped(self) -> Self {
        Self {
            src: self.dst,
            dst: self.src,
        }
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.src.is_finite() && self.dst.is_finite()
    }
}

/// The share of the largest eigenvalue below which the second smallest counts as zero: then more than one homography fits
/// the pairs. Singular values are its root. Exact collinear points come out at 1e-16 to 1e-17, five points of which four
/// are collinear up to 1e-3 of their extent above 1e-8.
const MIN_EIGEN_GAP: f64 = 1e-13;

/// The homography that maps the pairs' `src` to their `dst` with the least sum of squared distances on both sides.
///
/// Four pairs are reproduced exactly. All `src` lie in front of the horizon.
///
/// # Errors
/// [`HomographyError::TooFew`], [`HomographyError::Degenerate`] if more than one homography fits (collinear points),
/// [`HomographyError::HorizonCrosses`] if the best fit would put points behind the horizon, [`HomographyError::NonFinite`],
/// [`HomographyError::Singular`].
///
/// ```
/// use glam::dvec2;
/// use ravec_planar::{Homography, PointPair, estimate};
///
/// let truth = Homography::from_unit_square(
///     [dvec2(10.0, 10.0), dvec2(90.0, 25.0), dvec2(90.0, 75.0), dvec2(10.0, 95.0)])?;
/// let pairs: Vec<_> = [(0.1, 0.1), (0.9, 0.2), (0.8, 0.9), (0.2, 0.7), (0.5, 0.4)]
///     .iter()
///     .map(|&(x, y)| PointPair::new(dvec2(x, y), truth.apply(dvec2(x, y))))
///     .collect();
/// let found = estimate(&pairs)?;
/// assert!(found.apply(dvec2(1.0, 1.0)).distance(dvec2(90.0, 75.0)) < 1e-9);
/// # Ok::<(), ravec_planar::HomographyError>(())
/// ```
pub fn estimate(pairs: &[PointPair]) -> Result<Homography, HomographyError> {
    refine(&estimate_linear(pairs)?, pairs)
}

/// The homography of the linear equations alone: what [`estimate`] starts from. Cheaper, and good to a few per cent of the
/// noise's effect.
///
/// # Errors
/// As [`estimate`].
pub fn estimate_linear(pairs: &[PointPair]) -> Result<Homography, HomographyError> {
    let frames = Frames::of(pairs)?;
    let mut normal = [[0.0; 9]; 9];
    for pair in pairs {
        let PointPair { src, dst } = frames.normalized(pair);
        let p = src.extend(1.0).to_array();
        let mut add = |row: [f64; 9]| {
            for i in 0..9 {
                for j in 0..=i {
                    normal[i][j] += row[i] * row[j];
                }
            }
        };
        let [x, y, w] = p;
        add([x, y, w, 0.0, 0.0, 0.0, -dst.x * x, -dst.x * y, -dst.x * w]);
        add([0.0, 0.0, 0.0, x, y, w, -dst.y * x, -dst.y * y, -dst.y * w]);
    }
    let found = smallest_eigenvector(&normal).ok_or(HomographyError::NonFinite)?;
    if found.next <= MIN_EIGEN_GAP * found.largest {
        let ratio = (found.next.max(0.0) / found.largest).sqrt();
        return Err(HomographyError::Degenerate { ratio });
    }
    let matrix = DMat3::from_cols_array(&found.vector).transpose();
    // the centroid of src is (0, 0) there: it decides which side is the front
    let front = if matrix.z_axis.z < 0.0 {
        -matrix
    } else {
        matrix
    };
    let homography = Homography::from_matrix(frames.undo(front)).map_err(|error| match error {
        // a map onto a line: the points of one side are collinear
        HomographyError::Singular => HomographyError::Degenerate { ratio: 0.0 },
        other => other,
    })?;
    in_front(homography, pairs)
}

/// Moves `start` to the least sum of squared distances of the pairs on both sides.
///
/// # Errors
/// As [`estimate`]; [`HomographyError::HorizonCrosses`] also if `start` puts points behind the horizon.
pub fn refine(start: &Homography, pairs: &[PointPair]) -> Result<Homography, HomographyError> {
    let frames = Frames::of(pairs)?;
    let start = in_front(*start, pairs)?;
    let matrix = frames.apply(&start.matrix());
    // the centroid lies in front like all points around it, so its third coordinate is not 0
    let unknowns = unknowns_of(&(matrix * matrix.z_axis.z.recip()));
    let normalized: Vec<PointPair> = pairs.iter().map(|pair| frames.normalized(pair)).collect();
    let found = minimize(unknowns, &Descent::default(), |unknowns| {
        symmetric_sum(&matrix_of(unknowns), &normalized)
    });
    if found.sum.is_none() {
        return Err(HomographyError::Singular);
    }
    in_front(
        Homography::from_matrix(frames.undo(matrix_of(&found.at)))?,
        pairs,
    )
}

/// The squared distances |dst − H·src|² + |src − H⁻¹·dst|² in pixels². Infinite if a point lies behind the horizon.
pub fn symmetric_transfer_error(dst_from_src: &Homography, pair: &PointPair) -> f64 {
    let there = dst_from_src.try_apply(pair.src);
    let back = dst_from_src.inverse().try_apply(pair.dst);
    match (there, back) {
        (Some(there), Some(back)) => {
            there.distance_squared(pair.dst) + back.distance_squared(pair.src)
        }
        _ => f64::INFINITY,
    }
}

fn in_front(homography: Homography, pairs: &[PointPair]) -> Result<Homography, HomographyError> {
    if pairs
        .iter()
        .all(|pair| homography.try_apply(pair.src).is_some())
    {
        Ok(homography)
    } else {
        Err(HomographyError::HorizonCrosses)
    }
}

/// The sum of the symmetric transfer error and its derivatives; nothing if a point falls behind the horizon.
fn symmetric_sum(matrix: &DMat3, pairs: &[PointPair]) -> Option<NormalEquations<8>> {
    let inverse = matrix.inverse();
    if !inverse.is_finite() {
        return None;
    }
    let mut sum = NormalEquations::default();
    let back_rows = inverse.transpose();
    for pair in pairs {
        let there = *matrix * pair.src.extend(1.0);
        let back = inverse * pair.dst.extend(1.0);
        if there.z <= 0.0 || back.z <= 0.0 {
            return None;
        }
        let mapped = there.truncate() / there.z;
        let [x, y, w] = (pair.src.extend(1.0) / there.z).to_array();
        let (u, v) = (mapped.x, mapped.y);
        sum.add(
            u - pair.dst.x,
            &[x, y, w, 0.0, 0.0, 0.0, -u * x, -u * y],
            1.0,
        );
        sum.add(
            v - pair.dst.y,
            &[0.0, 0.0, 0.0, x, y, w, -v * x, -v * y],
            1.0,
        );
        // b = G·dst with G = H⁻¹, so db = −G·dH·b, and dH of unknown (i, j) is 1 there: db = −G·eᵢ bⱼ; scaled to b₃ = 1
        let mapped = back.truncate() / back.z;
        let b = [mapped.x, mapped.y, 1.0];
        for (axis, residual) in [mapped.x - pair.src.x, mapped.y - pair.src.y]
            .into_iter()
            .enumerate()
        {
            let row = if axis == 0 {
                back_rows.x_axis
            } else {
                back_rows.y_axis
            };
            let change: DVec3 = b[axis] * back_rows.z_axis - row;
            let change = change.to_array();
            let derivatives: [f64; 8] = std::array::from_fn(|k| change[k / 3] * b[k % 3]);
            sum.add(residual, &derivatives, 1.0);
        }
    }
    Some(sum)
}

/// The first eight elements, row by row.
pub(crate) fn unknowns_of(matrix: &DMat3) -> [f64; 8] {
    let rows = matrix.transpose().to_cols_array();
    std::array::from_fn(|k| rows[k])
}

/// The matrix of eight elements, row by row, and a one.
pub(crate) fn matrix_of(unknowns: &[f64; 8]) -> DMat3 {
    let mut rows = [1.0; 9];
    rows[..8].copy_from_slice(unknowns);
    DMat3::from_cols_array(&rows).transpose()
}

/// The two frames in which points have centroid 0 and mean distance √2.
pub(crate) struct Frames {
    src: Frame,
    dst: Frame,
}

#[derive(Clone, Copy)]
struct Frame {
    center: DVec2,
    scale: f64,
}

impl Frame {
    fn of(points: impl Iterator<Item = DVec2> + Clone, n: f64) -> Result<Self, HomographyError> {
        let center = points.clone().sum::<DVec2>() / n;
        let mean = points.map(|p| p.distance(center)).sum::<f64>() / n;
        let scale = std::f64::consts::SQRT_2 / mean;
        if scale.is_finite() && center.is_finite() && scale > 0.0 {
            Ok(Self { center, scale })
        } else {
            Err(HomographyError::Degenerate { ratio: 0.0 })
        }
    }

    fn matrix(self) -> DMat3 {
        DMat3::from_scale(DVec2::splat(self.scale)) * DMat3::from_translation(-self.center)
    }

    fn inverse(self) -> DMat3 {
        DMat3::from_translation(self.center) * DMat3::from_scale(DVec2::splat(self.scale.recip()))
    }
}

impl Frames {
    /// The frames of at least four finite pairs that do not all coincide.
    pub(crate) fn of(pairs: &[PointPair]) -> Result<Self, HomographyError> {
        if pairs.len() < 4 {
            return Err(HomographyError::TooFew { got: pairs.len() });
        }
        if !pairs.iter().all(PointPair::is_finite) {
            return Err(HomographyError::NonFinite);
        }
        let n = pairs.len() as f64;
        Ok(Self {
            src: Frame::of(pairs.iter().map(|pair| pair.src), n)?,
            dst: Frame::of(pairs.iter().map(|pair| pair.dst), n)?,
        })
    }

    pub(crate) fn normalized(&self, pair: &PointPair) -> PointPair {
        PointPair {
            src: (pair.src - self.src.center) * self.src.scale,
            dst: (pair.dst - self.dst.center) * self.dst.scale,
        }
    }

    /// The variance of equal noise in pixels within the frame of `dst`, when it is 1 within that of `src`.
    pub(crate) fn noise_ratio_sq(&self) -> f64 {
        (self.dst.scale / self.src.scale).powi(2)
    }

    /// A map between pixels as one between the frames.
    pub(crate) fn apply(&self, dst_from_src: &DMat3) -> DMat3 {
        self.dst.matrix() * *dst_from_src * self.src.inverse()
    }

    /// A map between the frames as one between pixels.
    pub(crate) fn undo(&self, between_frames: DMat3) -> DMat3 {
        self.dst.inverse() * between_frames * self.src.matrix()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strategies::{homography, noisy_pairs, point};
    use glam::dvec2;
    use proptest::prelude::*;
    use ravec_scenes::Seed;

    const CORNERS: [DVec2; 4] = [
        DVec2::ZERO,
        DVec2::new(1000.0, 0.0),
        DVec2::new(1000.0, 700.0),
        DVec2::new(0.0, 700.0),
    ];

    fn cost(h: &Homography, pairs: &[PointPair]) -> f64 {
        pairs
            .iter()
            .map(|pair| symmetric_transfer_error(h, pair))
            .sum()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn exact_pairs_give_the_planted_map(h in homography(), seed in 0u64..1000, count in 5i64..40) {
            let pairs = noisy_pairs(&h, count, 0.0, Seed(seed));
            let found = estimate(&pairs).unwrap();
            for corner in CORNERS {
                // five random points may lie badly; 1e-6 px is what their condition leaves of 1e-16
                prop_assert!(found.apply(corner).distance(h.apply(corner)) < 1e-5);
            }
        }

        #[test]
        fn no_small_change_makes_the_fit_better(h in homography(), seed in 0u64..1000, entry in 0usize..8, up in any::<bool>()) {
            let pairs = noisy_pairs(&h, 30, 1.0, Seed(seed));
            let found = estimate(&pairs).unwrap();
            let best = cost(&found, &pairs);
            let frames = Frames::of(&pairs).unwrap();
            let matrix = frames.apply(&found.matrix());
            let mut unknowns = unknowns_of(&(matrix * matrix.z_axis.z.recip()));
            unknowns[entry] += if up { 1e-4 } else { -1e-4 };
            let moved = Homography::from_matrix(frames.undo(matrix_of(&unknowns))).unwrap();
            // weights of the two sides differ between pixels and frames when the map scales: compare within the frames
            let in_frames = |h: &Homography| {
                let between = Homography::from_matrix(frames.apply(&h.matrix())).unwrap();
                pairs.iter().map(|p| symmetric_transfer_error(&between, &frames.normalized(p))).sum::<f64>()
            };
            prop_assert!(in_frames(&moved) >= in_frames(&found) * (1.0 - 1e-9));
            prop_assert!(best <= cost(&estimate_linear(&pairs).unwrap(), &pairs) * 1.05);
        }

        #[test]
        fn the_derivatives_agree_with_finite_differences(h in homography(), seed in 0u64..1000, entry in 0usize..8) {
            const STEP: f64 = 1e-6;
            let pairs = noisy_pairs(&h, 6, 2.0, Seed(seed));
            let frames = Frames::of(&pairs).unwrap();
            let pairs: Vec<_> = pairs.iter().map(|p| frames.normalized(p)).collect();
            let matrix = frames.apply(&h.matrix());
            let unknowns = unknowns_of(&(matrix * matrix.z_axis.z.recip()));
            let at = |step: f64| {
                let mut moved = unknowns;
                moved[entry] += step;
                symmetric_sum(&matrix_of(&moved), &pairs).unwrap()
            };
            let truth = (at(STEP).cost - at(-STEP).cost) / (2.0 * STEP);
            let found = 2.0 * at(0.0).gradient[entry];
            prop_assert!((found - truth).abs() < 1e-7 * (1.0 + truth.abs()), "{found} {truth}");
        }

        #[test]
        fn points_on_a_line_are_refused(a in point(), b in point(), seed in 0u64..1000, count in 4i64..12) {
            prop_assume!(a.distance(b) > 1.0);
            let pairs: Vec<_> = (0..count).map(|i| {
                let src = a.lerp(b, Seed(seed).unit(i, 0, 0));
                PointPair::new(src, 2.0 * src)
            }).collect();
            let refused = estimate(&pairs);
            prop_assert!(matches!(refused, Err(HomographyError::Degenerate { .. })), "{refused:?}");
        }
    }

    #[test]
    fn more_pairs_with_noise_give_a_better_map() {
        let h = Homography::from_unit_square([
            dvec2(0.0, 0.0),
            dvec2(1.1, 0.1),
            dvec2(0.9, 1.2),
            dvec2(0.1, 0.8),
        ])
        .unwrap();
        let scale = Homography::from_scale(dvec2(1000.0, 700.0)).unwrap();
        let h = scale * h * scale.inverse();
        let error = |count| {
            let square: f64 = (0..20)
                .map(|k| {
                    let found = estimate(&noisy_pairs(&h, count, 1.0, Seed(k))).unwrap();
                    CORNERS
                        .iter()
                        .map(|&c| found.apply(c).distance_squared(h.apply(c)))
                        .sum::<f64>()
                })
                .sum();
            square.sqrt()
        };
        // the root of 16, give or take what 20 rounds leave open
        let ratio = error(25) / error(400);
        assert!((2.5..6.5).contains(&ratio), "{ratio}");
    }

    #[test]
    fn bad_pairs_are_refused() {
        let pair = |x: f64, y: f64| PointPair::new(dvec2(x, y), dvec2(x, y));
        assert_eq!(
            estimate(&[pair(0.0, 0.0); 3]),
            Err(HomographyError::TooFew { got: 3 })
        );
        assert!(matches!(
            estimate(&[pair(1.0, 2.0); 9]),
            Err(HomographyError::Degenerate { .. })
        ));
        let mut pairs = [
            pair(0.0, 0.0),
            pair(1.0, 0.0),
            pair(1.0, 1.0),
            pair(0.0, 1.0),
            pair(0.5, 0.2),
        ];
        pairs[3].dst.x = f64::INFINITY;
        assert_eq!(estimate(&pairs), Err(HomographyError::NonFinite));
        // two corners swapped: no camera sees both sides
        let (a, b) = (dvec2(0.0, 1.0), dvec2(1.0, 1.0));
        pairs[2].dst = a;
        pairs[3].dst = b;
        assert_eq!(estimate(&pairs[..4]), Err(HomographyError::HorizonCrosses));
        // three of four points on a line
        let line = [
            pair(0.0, 0.0),
            pair(1.0, 0.0),
            pair(2.0, 0.0),
            pair(0.0, 1.0),
        ];
        assert!(matches!(
            estimate(&line),
            Err(HomographyError::Degenerate { .. })
        ));
    }
}
