//! Corners as vectors of eight numbers, their covariances, and both carried between frames.

use crate::homography::Homography;
use crate::track::record::CornerCovariance;
use glam::{DMat2, DVec2, dvec2};
use nalgebra::{SMatrix, SVector};

/// Four points as x0, y0, x1, y1, x2, y2, x3, y3.
pub(super) type Vector = SVector<f64, 8>;

/// A square matrix over such vectors.
pub(super) type Matrix = SMatrix<f64, 8, 8>;

/// Four points as one vector.
pub(super) fn vector_of(points: &[DVec2; 4]) -> Vector {
    Vector::from_fn(|k, _| points[k / 2][k % 2])
}

/// The points of a vector.
pub(super) fn points_of(vector: &Vector) -> [DVec2; 4] {
    std::array::from_fn(|k| dvec2(vector[2 * k], vector[2 * k + 1]))
}

pub(super) fn matrix_of(covariance: &CornerCovariance) -> Matrix {
    Matrix::from_fn(|row, col| covariance[row][col])
}

pub(super) fn covariance_of(matrix: &Matrix) -> CornerCovariance {
    std::array::from_fn(|row| {
        std::array::from_fn(|col| 0.5 * (matrix[(row, col)] + matrix[(col, row)]))
    })
}

/// The matrix with four blocks of 2 × 2 on its diagonal.
fn diagonal(blocks: &[DMat2; 4]) -> Matrix {
    Matrix::from_fn(|row, col| {
        if row / 2 == col / 2 {
            blocks[row / 2].col(col % 2)[row % 2]
        } else {
            0.0
        }
    })
}

/// The derivatives of the images of four points by the points.
pub(super) fn jacobian(h: &Homography, points: &[DVec2; 4]) -> Matrix {
    diagonal(&points.map(|p| h.jacobian(p)))
}

/// The inverse of [`jacobian`]; nothing if a point lies on or behind the horizon, or if a number is not finite.
pub(super) fn inverse_jacobian(h: &Homography, points: &[DVec2; 4]) -> Option<Matrix> {
    if !h.is_in_front(points) {
        return None;
    }
    let inverse = diagonal(&points.map(|p| h.jacobian(p).inverse()));
    inverse.iter().all(|v| v.is_finite()).then_some(inverse)
}

/// `map` · `covariance` · `map`ᵀ.
pub(super) fn carried(map: &Matrix, covariance: &Matrix) -> Matrix {
    map * covariance * map.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strategies::homography;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn jacobians_agree_with_finite_differences_and_are_inverse(h in homography(), k in 0usize..8) {
            let points = [dvec2(10.0, 20.0), dvec2(800.0, 40.0), dvec2(900.0, 600.0), dvec2(30.0, 650.0)];
            let mut step = Vector::zeros();
            step[k] = 1e-3;
            let image = |p: Vector| vector_of(&points_of(&p).map(|p| h.apply(p)));
            let at = vector_of(&points);
            let slope = (image(at + step) - image(at - step)) / 2e-3;
            let derivatives = jacobian(&h, &points);
            prop_assert!((slope - derivatives.column(k)).norm() < 1e-6);
            let both = inverse_jacobian(&h, &points).unwrap() * derivatives;
            prop_assert!((both - Matrix::identity()).norm() < 1e-9);
        }
    }

    #[test]
    fn points_behind_the_horizon_have_no_inverse() {
        let mut tilt = glam::DMat3::IDENTITY;
        tilt.x_axis.z = -0.01;
        let h = Homography::from_matrix(tilt).unwrap();
        let beyond = [
            DVec2::ZERO,
            dvec2(150.0, 0.0),
            dvec2(150.0, 50.0),
            dvec2(0.0, 50.0),
        ];
        assert!(inverse_jacobian(&h, &beyond).is_none());
    }
}
