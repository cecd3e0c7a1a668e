//! Small numerical tools that several crates share: symmetric systems, dense and sparse, eigenvectors, non-linear least
//! squares, Poisson systems, Fourier transforms, disjoint sets.
//!
//! Geometry from measurements ends in a handful of unknowns and a sum of squares over many measurements. Here the sum is
//! kept as its normal equations, so that memory does not depend on the number of measurements, and minimized with damping.
//!
//! ```
//! use ravec_numeric::{Descent, NormalEquations, minimize};
//!
//! // a decay a·exp(−b·t) through samples of 3·exp(−0.5·t)
//! let samples: Vec<(f64, f64)> = (0..8).map(|t| (t as f64, 3.0 * (-0.5 * t as f64).exp())).collect();
//! let found = minimize([1.0, 1.0], &Descent::default(), |[a, b]| {
//!     let mut sum = NormalEquations::default();
//!     for &(t, y) in &samples {
//!         let decay = (-b * t).exp();
//!         sum.add(a * decay - y, &[decay, -a * t * decay], 1.0);
//!     }
//!     Some(sum)
//! });
//! assert!((found.at[0] - 3.0).abs() < 1e-9 && (found.at[1] - 0.5).abs() < 1e-9);
//! ```
//!
//! Guarantees: no panic and no endless loop, whatever the numbers are; a problem that cannot be solved gives `None` or
//! stays where it started. Does not guarantee: the same last bits on machines with other vector units.
//!
//! # Current status
//!
//! The numerics of all systems of Ravec. The factorizations are those of `nalgebra` and `nalgebra-sparse`, transforms of lines those
//! of `rustfft`. Sparse systems ([`SquareSum`], [`EliminationPlan`], [`SparseCholesky`]) come with the order in which few
//! entries appear; [`SingleCholesky`] is for corrections by half the digits.
//!
//! # Features
//!
//! Both are on by default; who needs [`DisjointSets`] or [`PoissonSystem`] alone compiles no foreign crate.
//!
//! - `linear`: systems, eigenvectors and least squares.
//! - `fourier`: [`Fourier`].

#[cfg(feature = "linear")]
mod dense;
mod disjoint_sets;
// transforms take half a minute to compile: their tests link the library rather than compile it again
#[cfg(all(feature = "fourier", not(test)))]
mod fourier;
#[cfg(feature = "linear")]
mod least_squares;
#[cfg(feature = "linear")]
mod panels;
mod poisson;
#[cfg(feature = "linear")]
mod sparse;

#[cfg(feature = "linear")]
pub use dense::{Smallest, smallest_eigenvector, solve_positive};
pub use disjoint_sets::DisjointSets;
#[cfg(all(feature = "fourier", not(test)))]
pub use fourier::{Fourier, FourierScratch, Spectrum};
#[cfg(feature = "linear")]
pub use least_squares::{Descent, Minimum, NormalEquations, minimize};
pub use poisson::PoissonSystem;
#[cfg(feature = "fourier")]
pub use realfft::num_complex::Complex32;
#[cfg(feature = "linear")]
pub use sparse::{EliminationPlan, SingleCholesky, SparseCholesky, SparseSymmetric, SquareSum};
