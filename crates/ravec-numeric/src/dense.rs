//! Symmetric matrices of a few rows.

use nalgebra::{Cholesky, DMatrix, SMatrix, SVector, SymmetricEigen};

/// The eigenvector of the smallest eigenvalue of a symmetric matrix, and what surrounds it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smallest<const N: usize> {
    /// The eigenvector, of length 1. Its sign is arbitrary.
    pub vector: [f64; N],
    /// The smallest eigenvalue.
    pub value: f64,
    /// The one after it. If it is as small, the vector is any of a plane of them.
    pub next: f64,
    /// The largest eigenvalue.
    pub largest: f64,
}

/// Rotations of the iteration for eigenvalues at most, far more than the two or three that one takes: without an end, a
/// matrix beyond rounding could hang.
const MAX_SWEEPS: usize = 1000;

/// The eigenvector of the smallest eigenvalue of the symmetric `matrix`, of which the lower triangle is read.
///
/// `None` if a number is not finite, or if `N` is below 2.
pub fn smallest_eigenvector<const N: usize>(matrix: &[[f64; N]; N]) -> Option<Smallest<N>> {
    if N < 2 || !matrix.iter().flatten().all(|value| value.is_finite()) {
        return None;
    }
    let matrix = DMatrix::from_fn(N, N, |row, col| matrix[row.max(col)][row.min(col)]);
    let eigen = SymmetricEigen::try_new(matrix, 4.0 * f64::EPSILON, MAX_SWEEPS)?;
    let mut order: Vec<usize> = (0..N).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    Some(Smallest {
        vector: std::array::from_fn(|row| eigen.eigenvectors[(row, order[0])]),
        value: eigen.eigenvalues[order[0]],
        next: eigen.eigenvalues[order[1]],
        largest: eigen.eigenvalues[order[N - 1]],
    })
}

/// The `x` with `matrix` · `x` = `right`, for a symmetric positive definite `matrix`, of which the lower triangle is read.
///
/// `None` if the matrix is not positive definite, or if a number is not finite.
pub fn solve_positive<const N: usize>(
    matrix: &[[f64; N]; N],
    right: &[f64; N],
) -> Option<[f64; N]> {
    let matrix = SMatrix::<f64, N, N>::from_fn(|row, col| matrix[row.max(col)][row.min(col)]);
    let x = Cholesky::new(matrix)?.solve(&SVector::from(*right));
    x.iter().all(|value| value.is_finite()).then(|| x.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn times<const N: usize>(m: &[[f64; N]; N], x: &[f64; N]) -> [f64; N] {
        std::array::from_fn(|row| (0..N).map(|col| m[row][col] * x[col]).sum())
    }

    /// A random square plus a tenth, positive definite with eigenvalues from 0.1 to 0.1 + 5 · 5.
    fn positive() -> impl Strategy<Value = [[f64; 5]; 5]> {
        prop::array::uniform5(prop::array::uniform5(-1.0..1.0)).prop_map(|a: [[f64; 5]; 5]| {
            std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let sum: f64 = (0..5).map(|k| a[k][i] * a[k][j]).sum();
                    sum + if i == j { 0.1 } else { 0.0 }
                })
            })
        })
    }

    proptest! {
        #[test]
        fn the_solution_solves(matrix in positive(), x in prop::array::uniform5(-10.0..10.0)) {
            let found = solve_positive(&matrix, &times(&matrix, &x)).unwrap();
            for (a, b) in found.iter().zip(x) {
                // condition at most 250, values up to 10, a few roundings each
                prop_assert!((a - b).abs() < 1e-10, "{a} {b}");
            }
        }

        #[test]
        fn the_smallest_eigenvector_is_one_and_no_other_direction_is_shorter(
            matrix in positive(), x in prop::array::uniform5(-1.0..1.0)
        ) {
            let found = smallest_eigenvector(&matrix).unwrap();
            let image = times(&matrix, &found.vector);
            for (a, b) in image.iter().zip(found.vector) {
                prop_assert!((a - found.value * b).abs() < 1e-12);
            }
            let quadratic: f64 = times(&matrix, &x).iter().zip(x).map(|(a, b)| a * b).sum();
            let square: f64 = x.iter().map(|v| v * v).sum();
            prop_assert!(quadratic >= (found.value - 1e-12) * square);
            prop_assert!(quadratic <= (found.largest + 1e-12) * square);
            prop_assert!(found.value <= found.next && found.next <= found.largest);
        }
    }

    #[test]
    fn what_is_not_positive_or_not_finite_has_no_solution() {
        assert_eq!(
            solve_positive(&[[1.0, 0.0], [0.0, -1.0]], &[1.0, 1.0]),
            None
        );
        assert_eq!(solve_positive(&[[0.0, 0.0], [0.0, 0.0]], &[1.0, 1.0]), None);
        assert_eq!(
            solve_positive(&[[1.0, 0.0], [0.0, 1.0]], &[f64::NAN, 1.0]),
            None
        );
        assert_eq!(
            solve_positive(&[[f64::NAN, 0.0], [0.0, 1.0]], &[1.0, 1.0]),
            None
        );
        assert_eq!(
            smallest_eigenvector(&[[f64::INFINITY, 0.0], [0.0, 1.0]]),
            None
        );
        assert_eq!(smallest_eigenvector(&[[1.0]]), None);
    }
}
