//! Joint refinement of keyframes from measurements between pairs of them.
//!
//! ```text
//! unknown for each keyframe but the reference: how far four fixed points of it are from where they should be
//! residual of a tie: the images of its four points by keyframe_to · keyframe_from⁻¹, less those that were measured
//! minimize the sum of ρ(rᵀ C⁻¹ r) over the ties (Levenberg and Marquardt)
//! ```
//!
//! ρ grows without end but ever slower for ties beyond the 99 % quantile of χ² with eight degrees of freedom, first as a root and
//! then as a logarithm: one tie to the wrong window of a facade does not bend the others.
//!
//! Small motions of a picture's plane are eight fields: two shifts, four linear ones, (x², xy) and (xy, y²). Displacements of four
//! points determine their coefficients, and these the displacement of every other point.
//!
//! Guarantees: the reference stays; the cost does not rise; covariances are those of linear propagation. Does not guarantee:
//! calibrated covariances from ties whose own are not. Cost: O(n³) for n keyframes, with the dense matrix of 8 n unknowns: a
//! millisecond for ten, seconds for [`MAX_KEYFRAMES`].

use crate::homography::Homography;
use crate::track::offsets::{Matrix, Vector, covariance_of, matrix_of, points_of, vector_of};
use crate::track::record::CornerCovariance;
use glam::DVec2;
use nalgebra::{DMatrix, DVector, SMatrix};
use ravec_numeric::DisjointSets;

#[cfg(test)]
mod tests;

/// Largest number of keyframes: their matrix has 34 MB.
pub const MAX_KEYFRAMES: usize = 256;

/// The 99 % quantile of χ² with eight degrees of freedom.
const QUANTILE: f64 = 20.09;

/// Steps at most, and of these the first with the milder loss.
const MAX_STEPS: usize = 60;
const MILD_STEPS: usize = 12;

/// Settled when no point moves by more, in pixels.
const SETTLED_PX: f64 = 1e-7;

/// Deviation that is added to every tie, in pixels: covariances from few measurements have directions without variance.
const FLOOR_PX: f64 = 1e-3;

/// A measurement of one keyframe against another.
#[derive(Debug, Clone, PartialEq)]
pub struct Tie {
    /// Number of the keyframe where the measured map starts.
    pub from: usize,
    /// Number of the keyframe where it leads.
    pub to: usize,
    /// The measured map.
    pub to_from: Homography,
    /// Four points of the keyframe `from`, in pixels, no three of them on a line.
    pub points: [DVec2; 4],
    /// Covariance of their images in the keyframe `to`, in square pixels.
    pub covariance: CornerCovariance,
}

/// Keyframes that were refined together.
#[derive(Debug, Clone, PartialEq)]
pub struct TiedKeyframes {
    /// Maps from the reference, keyframe 0, to each keyframe. The first is the identity.
    pub keyframe_from_reference: Vec<Homography>,
    /// Weight of each tie, 0 to 1: below a half it contradicts the others.
    pub weights: Vec<f64>,
    /// The sum of rᵀ C⁻¹ r over all ties, each times its weight.
    pub chi_square: f64,
    /// Expected value of `chi_square`: eight for each tie less eight for each keyframe but the first.
    pub degrees_of_freedom: usize,
    basis: Basis,
    /// Covariance of the displacements of the basis' points in all keyframes but the first.
    joint: DMatrix<f64>,
}

/// Why keyframes cannot be refined.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TieError {
    /// No keyframe, or too many.
    #[error("{got} keyframes; from 1 to {MAX_KEYFRAMES} can be refined together")]
    Count {
        /// Number of keyframes.
        got: usize,
    },
    /// The corners do not determine a motion.
    #[error("the corners of the frame are no quadrilateral")]
    Corners,
    /// A tie that makes no sense.
    #[error(
        "tie {index} is no measurement: it must lead from one keyframe of {count} to another, map its four points to places in \
         front of the horizon, also by the present keyframes, and have a covariance that is positive"
    )]
    Tie {
        /// Number of the tie in the list.
        index: usize,
        /// Number of keyframes.
        count: usize,
    },
    /// No chain of ties leads from the reference to a keyframe.
    #[error("no chain of ties leads from the reference to keyframe {keyframe}")]
    Untied {
        /// Number of the keyframe.
        keyframe: usize,
    },
    /// The ties leave a keyframe free to move.
    #[error("the ties do not determine the keyframes: their points lie on a line")]
    Undetermined,
}

/// Refines `keyframe_from_reference`, all keyframes together; the first is the reference and becomes the identity, the others are
/// relative to it.
///
/// `corners` are four points in the pixels of a keyframe, such as the corners of the frame, all of which every tie's points lie
/// near: they are the unknowns.
///
/// # Errors
/// [`TieError`].
pub fn tie_keyframes(
    keyframe_from_reference: &[Homography],
    corners: &[DVec2; 4],
    ties: &[Tie],
) -> Result<TiedKeyframes, TieError> {
    let count = keyframe_from_reference.len();
    let first = keyframe_from_reference
        .first()
        .filter(|_| count <= MAX_KEYFRAMES)
        .ok_or(TieError::Count { got: count })?;
    let basis = Basis::new(corners).ok_or(TieError::Corners)?;
    let reference_from_first = first.inverse();
    let mut maps: Vec<Homography> = keyframe_from_reference
        .iter()
        .map(|&map| map * reference_from_first)
        .collect();
    maps[0] = Homography::IDENTITY;
    let whitened: Vec<Whitened> = ties
        .iter()
        .enumerate()
        .map(|(index, tie)| {
            Whitened::new(tie, count)
                .filter(|tie| tie.residual(&maps).is_some())
                .ok_or(TieError::Tie { index, count })
        })
        .collect::<Result<_, _>>()?;
    connected(count, ties)?;
    let problem = Problem {
        basis: &basis,
        ties: &whitened,
    };
    problem.minimize(&mut maps)?;
    let sum = problem
        .sum(&maps, Loss::Logarithm)
        .ok_or(TieError::Undetermined)?;
    let joint = invert(sum.matrix).ok_or(TieError::Undetermined)?;
    Ok(TiedKeyframes {
        keyframe_from_reference: maps,
        chi_square: sum.chi_square,
        weights: sum.weights,
        degrees_of_freedom: (8 * ties.len()).saturating_sub(8 * (count - 1)),
        basis,
        joint,
    })
}

impl TiedKeyframes {
    /// Covariance, in square pixels of keyframe `index`, of the images of four points of the reference; nothing if one of them
    /// lies behind the keyframe's horizon.
    ///
    /// # Panics
    /// If there is no such keyframe.
    pub fn covariance(&self, index: usize, points: &[DVec2; 4]) -> Option<CornerCovariance> {
        let map = self.keyframe_from_reference[index];
        if !map.is_in_front(points) {
            return None;
        }
        if index == 0 {
            return Some([[0.0; 8]; 8]);
        }
        let motion = self.basis.motion(&points.map(|p| map.apply(p)));
        let at = 8 * (index - 1);
        let block = self.joint.fixed_view::<8, 8>(at, at);
        Some(covariance_of(&(motion * block * motion.transpose())))
    }
}

/// Displacements of all points of a picture from those of four.
#[derive(Debug, Clone, PartialEq)]
struct Basis {
    corners: [DVec2; 4],
    center: DVec2,
    scale: f64,
    /// Coefficients of the fields from displacements of the four points.
    coefficients: Matrix,
}

impl Basis {
    fn new(corners: &[DVec2; 4]) -> Option<Self> {
        Homography::from_unit_square(*corners).ok()?;
        let center = 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
        let scale = corners
            .iter()
            .map(|p| p.distance(center))
            .fold(0.0, f64::max);
        let mut basis = Self {
            corners: *corners,
            center,
            scale,
            coefficients: Matrix::identity(),
        };
        basis.coefficients = basis.motion(corners).try_inverse()?;
        Some(basis)
    }

    /// Displacement of a point by those of the four.
    fn field(&self, point: DVec2) -> SMatrix<f64, 2, 8> {
        let DVec2 { x, y } = (point - self.center) / self.scale;
        let fields = SMatrix::<f64, 2, 8>::from_row_slice(&[
            1.0,
            0.0,
            x,
            y,
            0.0,
            0.0,
            x * x,
            x * y, //
            0.0,
            1.0,
            0.0,
            0.0,
            x,
            y,
            x * y,
            y * y,
        ]);
        fields * self.coefficients
    }

    /// The same for four points.
    fn motion(&self, points: &[DVec2; 4]) -> Matrix {
        let mut motion = Matrix::zeros();
        for (k, &point) in points.iter().enumerate() {
            motion
                .fixed_rows_mut::<2>(2 * k)
                .copy_from(&self.field(point));
        }
        motion
    }

    /// The map that displaces the four points so.
    fn displaced(&self, displacement: &Vector) -> Option<Homography> {
        let moved = points_of(&(vector_of(&self.corners) + displacement));
        Homography::from_pairs(&self.corners, &moved).ok()
    }
}

/// A tie whose residuals have unit covariance.
#[derive(Debug)]
struct Whitened<'a> {
    tie: &'a Tie,
    measured: Vector,
    /// Inverse of the lower Cholesky factor of the covariance.
    whitening: Matrix,
}

impl<'a> Whitened<'a> {
    fn new(tie: &'a Tie, count: usize) -> Option<Self> {
        let known = tie.from < count && tie.to < count && tie.from != tie.to;
        if !known || !tie.to_from.is_in_front(&tie.points) {
            return None;
        }
        Homography::from_unit_square(tie.points).ok()?;
        let covariance = matrix_of(&tie.covariance) + Matrix::identity() * (FLOOR_PX * FLOOR_PX);
        let whitening = covariance.cholesky()?.l().try_inverse()?;
        whitening.iter().all(|v| v.is_finite()).then(|| Self {
            tie,
            measured: vector_of(&tie.points.map(|p| tie.to_from.apply(p))),
            whitening,
        })
    }

    fn map(&self, maps: &[Homography]) -> Homography {
        maps[self.tie.to] * maps[self.tie.from].inverse()
    }

    /// The whitened residual; nothing behind the horizon.
    fn residual(&self, maps: &[Homography]) -> Option<Vector> {
        let map = self.map(maps);
        map.is_in_front(&self.tie.points).then(|| {
            let images = self.tie.points.map(|p| map.apply(p));
            self.whitening * (vector_of(&images) - self.measured)
        })
    }

    /// Derivatives of the whitened residual by the displacements in the keyframes `from` and `to`.
    fn derivatives(&self, basis: &Basis, maps: &[Homography]) -> [Matrix; 2] {
        let map = self.map(maps);
        let mut by_from = Matrix::zeros();
        for (k, &p) in self.tie.points.iter().enumerate() {
            let local = map.jacobian(p);
            let local = SMatrix::<f64, 2, 2>::from_fn(|row, col| local.col(col)[row]);
            let block = -(local * basis.field(p));
            by_from.fixed_rows_mut::<2>(2 * k).copy_from(&block);
        }
        let by_to = basis.motion(&self.tie.points.map(|p| map.apply(p)));
        [self.whitening * by_from, self.whitening * by_to]
    }
}

/// Loss of a tie beyond the quantile.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Loss {
    Root,
    Logarithm,
}

impl Loss {
    /// The loss of a squared residual, and its derivative, the weight.
    fn of(self, square: f64) -> (f64, f64) {
        if square <= QUANTILE {
            return (square, 1.0);
        }
        let ratio = square / QUANTILE;
        match self {
            Self::Root => (QUANTILE * (2.0 * ratio.sqrt() - 1.0), ratio.sqrt().recip()),
            Self::Logarithm => (QUANTILE * (1.0 + ratio.ln()), ratio.recip()),
        }
    }
}

struct Problem<'a> {
    basis: &'a Basis,
    ties: &'a [Whitened<'a>],
}

struct Sum {
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
    cost: f64,
    chi_square: f64,
    weights: Vec<f64>,
}

impl Problem<'_> {
    fn cost(&self, maps: &[Homography], loss: Loss) -> Option<f64> {
        self.ties
            .iter()
            .map(|tie| Some(loss.of(tie.residual(maps)?.norm_squared()).0))
            .sum()
    }

    /// The weighted normal equations.
    fn sum(&self, maps: &[Homography], loss: Loss) -> Option<Sum> {
        let size = 8 * (maps.len() - 1);
        let mut sum = Sum {
            matrix: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
            cost: 0.0,
            chi_square: 0.0,
            weights: Vec::with_capacity(self.ties.len()),
        };
        for tie in self.ties {
            let residual = tie.residual(maps)?;
            let square = residual.norm_squared();
            let (cost, weight) = loss.of(square);
            sum.cost += cost;
            sum.chi_square += weight * square;
            sum.weights.push(weight);
            let derivatives = tie.derivatives(self.basis, maps);
            let ends = [tie.tie.from, tie.tie.to];
            for (a, da) in ends.iter().zip(&derivatives) {
                let Some(row) = a.checked_sub(1) else {
                    continue;
                };
                let mut part = sum.gradient.fixed_rows_mut::<8>(8 * row);
                part += da.transpose() * residual * weight;
                for (b, db) in ends.iter().zip(&derivatives) {
                    let Some(col) = b.checked_sub(1) else {
                        continue;
                    };
                    let mut block = sum.matrix.fixed_view_mut::<8, 8>(8 * row, 8 * col);
                    block += da.transpose() * db * weight;
                }
            }
        }
        Some(sum)
    }

    fn minimize(&self, maps: &mut Vec<Homography>) -> Result<(), TieError> {
        if maps.len() == 1 {
            return Ok(());
        }
        let mut damping = 1e-4;
        for step in 0..MAX_STEPS {
            let loss = if step < MILD_STEPS {
                Loss::Root
            } else {
                Loss::Logarithm
            };
            let sum = self.sum(maps, loss).ok_or(TieError::Undetermined)?;
            let mut matrix = sum.matrix;
            for k in 0..matrix.nrows() {
                matrix[(k, k)] *= 1.0 + damping;
            }
            let solved = matrix.cholesky().ok_or(TieError::Undetermined)?;
            let displacement = -solved.solve(&sum.gradient);
            let moved = self
                .moved(maps, &displacement)
                .filter(|moved| self.cost(moved, loss).is_some_and(|cost| cost <= sum.cost));
            let settled = displacement.amax() < SETTLED_PX;
            match moved {
                Some(moved) => {
                    *maps = moved;
                    damping = (damping * 0.1).max(1e-9);
                }
                None => damping *= 10.0,
            }
            // rounding may keep the cost from falling any further
            if settled && loss == Loss::Logarithm {
                break;
            }
        }
        Ok(())
    }

    fn moved(&self, maps: &[Homography], displacement: &DVector<f64>) -> Option<Vec<Homography>> {
        maps.iter()
            .enumerate()
            .map(|(index, map)| match index.checked_sub(1) {
                None => Some(*map),
                Some(row) => {
                    let by = displacement.fixed_rows::<8>(8 * row).into_owned();
                    Some(self.basis.displaced(&by)? * *map)
                }
            })
            .collect()
    }
}

/// The inverse of a symmetric positive definite matrix.
fn invert(matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let inverse = matrix.cholesky()?.inverse();
    inverse.iter().all(|v| v.is_finite()).then_some(inverse)
}

/// Refuses keyframes that no chain of ties connects with the reference.
fn connected(count: usize, ties: &[Tie]) -> Result<(), TieError> {
    let mut sets = DisjointSets::new(count);
    for tie in ties {
        sets.join(tie.from as u32, tie.to as u32);
    }
    let reference = sets.root(0);
    match (1..count).find(|&keyframe| sets.root(keyframe as u32) != reference) {
        Some(keyframe) => Err(TieError::Untied { keyframe }),
        None => Ok(()),
    }
}
