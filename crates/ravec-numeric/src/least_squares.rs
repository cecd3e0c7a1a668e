//! Non-linear least squares with few unknowns, by Levenberg and Marquardt.
//!
//! ```text
//! repeat: solve (JᵀWJ + λ diag(JᵀWJ)) d = −JᵀWr
//!         if the cost at x + d is lower: take the step, λ smaller; else: λ larger
//! ```
//!
//! Source: Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", 1963; the damping follows
//! Nielsen, "Damping parameter in Marquardt's method", 1999: it falls by how well the quadratic predicted the cost.
//!
//! Guarantees: the cost never rises; ends after [`Descent::max_steps`] evaluations. Does not guarantee: the global minimum.
//! Cost: one pass over the measurements and one factorization of N × N a step.

use crate::dense::solve_positive;

/// A weighted sum of squares at one point, with what is needed for a step: `JᵀWJ`, `JᵀWr` and `rᵀWr`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalEquations<const N: usize> {
    /// `JᵀWJ`, of which only the lower triangle is kept.
    pub matrix: [[f64; N]; N],
    /// `JᵀWr`, half of the gradient.
    pub gradient: [f64; N],
    /// `rᵀWr`.
    pub cost: f64,
}

impl<const N: usize> Default for NormalEquations<N> {
    fn default() -> Self {
        Self {
            matrix: [[0.0; N]; N],
            gradient: [0.0; N],
            cost: 0.0,
        }
    }
}

impl<const N: usize> NormalEquations<N> {
    /// Adds a measurement: its residual, the residual's derivatives by the unknowns, and its weight (at least 0).
    #[inline]
    pub fn add(&mut self, residual: f64, derivatives: &[f64; N], weight: f64) {
        self.cost += weight * residual * residual;
        for (row, &d) in derivatives.iter().enumerate() {
            let weighted = weight * d;
            self.gradient[row] += weighted * residual;
            for (sum, &other) in self.matrix[row][..=row].iter_mut().zip(derivatives) {
                *sum += weighted * other;
            }
        }
    }

    /// Adds another sum.
    pub fn merge(&mut self, other: &Self) {
        self.cost += other.cost;
        for row in 0..N {
            self.gradient[row] += other.gradient[row];
            for col in 0..=row {
                self.matrix[row][col] += other.matrix[row][col];
            }
        }
    }

    /// The step to the minimum of the quadratic, damped by `damping` times the diagonal (0: Gauss and Newton).
    ///
    /// `None` if an unknown has no influence, or if numbers are not finite.
    pub fn step(&self, damping: f64) -> Option<[f64; N]> {
        let mut matrix = self.matrix;
        for (index, row) in matrix.iter_mut().enumerate() {
            row[index] *= 1.0 + damping;
        }
        solve_positive(&matrix, &self.gradient.map(|g| -g))
    }

    /// Decrease of the cost along `step` by the quadratic model.
    fn predicted_fall(&self, step: &[f64; N]) -> f64 {
        let mut fall = 0.0;
        for row in 0..N {
            fall -= 2.0 * step[row] * self.gradient[row]
                + step[row] * step[row] * self.matrix[row][row];
            for col in 0..row {
                fall -= 2.0 * step[row] * step[col] * self.matrix[row][col];
            }
        }
        fall
    }
}

/// Stopping criteria.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Descent {
    /// Evaluations after the first, at least 0 (default 50). Fewer may stop short of the minimum.
    pub max_steps: usize,
    /// Relative fall of the cost below which the minimum counts as reached (default 1e-12). Larger stops earlier and less
    /// exactly; what noise leaves undetermined is not worth steps.
    pub min_fall_rel: f64,
}

impl Default for Descent {
    fn default() -> Self {
        Self {
            max_steps: 50,
            min_fall_rel: 1e-12,
        }
    }
}

/// The point at which a descent ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Minimum<const N: usize> {
    /// The unknowns.
    pub at: [f64; N],
    /// The sum there. Its matrix is, for residuals of variance 1, the inverse of the unknowns' covariance.
    /// `None` if the problem could not be evaluated where it started.
    pub sum: Option<NormalEquations<N>>,
    /// `true` if the fall went below [`Descent::min_fall_rel`] or the gradient vanished, rather than steps running out.
    pub converged: bool,
}

/// Damping of the first step: nearly the one of Gauss and Newton, which is right near a minimum; a wrong guess costs a few
/// evaluations.
const DAMPING_START: f64 = 1e-4;
/// Damping beyond which a step moves nothing: rounding has taken over.
const DAMPING_END: f64 = 1e12;

/// Lowers a sum of squares from `start`.
///
/// `sum_at` gives the sum at a point, or `None` where the point makes no sense (a step there is taken back).
pub fn minimize<const N: usize>(
    start: [f64; N],
    descent: &Descent,
    mut sum_at: impl FnMut(&[f64; N]) -> Option<NormalEquations<N>>,
) -> Minimum<N> {
    let mut evaluate = |at: &[f64; N]| sum_at(at).filter(|sum| sum.cost.is_finite());
    let Some(mut sum) = evaluate(&start) else {
        return Minimum {
            at: start,
            sum: None,
            converged: false,
        };
    };
    let mut at = start;
    let mut damping = DAMPING_START;
    let mut growth = 2.0;
    let mut converged = sum.cost == 0.0;
    for _ in 0..descent.max_steps {
        if converged || damping > DAMPING_END {
            break;
        }
        let tried = sum.step(damping).and_then(|step| {
            let next = std::array::from_fn(|i| at[i] + step[i]);
            let predicted = sum.predicted_fall(&step);
            // where even the prediction promises nothing, there is nothing to win
            if predicted <= descent.min_fall_rel * sum.cost {
                converged = true;
                return None;
            }
            let next_sum = evaluate(&next)?;
            Some((next, next_sum, predicted))
        });
        match tried {
            Some((next, next_sum, predicted)) if next_sum.cost < sum.cost => {
                let fall = sum.cost - next_sum.cost;
                let quality = fall / predicted;
                damping *= (1.0 - (2.0 * quality - 1.0).powi(3)).max(1.0 / 10.0);
                growth = 2.0;
                converged = fall <= descent.min_fall_rel * sum.cost || next_sum.cost == 0.0;
                (at, sum) = (next, next_sum);
            }
            _ => {
                damping *= growth;
                growth *= 2.0;
            }
        }
    }
    Minimum {
        at,
        sum: Some(sum),
        converged,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_line_through_points_agrees_with_the_closed_formula(
            ys in prop::collection::vec(-5.0..5.0f64, 3..20), start in prop::array::uniform2(-9.0..9.0f64)
        ) {
            let found = minimize(start, &Descent::default(), |[a, b]| {
                let mut sum = NormalEquations::default();
                for (x, y) in ys.iter().enumerate() {
                    sum.add(a + b * x as f64 - y, &[1.0, x as f64], 1.0);
                }
                Some(sum)
            });
            let n = ys.len() as f64;
            let mean_x = 0.5 * (n - 1.0);
            let mean_y = ys.iter().sum::<f64>() / n;
            let xy: f64 = ys.iter().enumerate().map(|(x, y)| (x as f64 - mean_x) * (y - mean_y)).sum();
            let xx: f64 = (0..ys.len()).map(|x| (x as f64 - mean_x).powi(2)).sum();
            let slope = xy / xx;
            // the cost is flat at its minimum: 1e-12 of it is 1e-6 in the unknowns
            prop_assert!((found.at[1] - slope).abs() < 1e-5, "{} {slope}", found.at[1]);
            prop_assert!((found.at[0] - (mean_y - slope * mean_x)).abs() < 1e-4);
            prop_assert!(found.converged);
        }
    }

    #[test]
    fn a_bent_valley_is_followed_to_its_end() {
        // Rosenbrock's function, from its usual start
        let found = minimize([-1.2, 1.0], &Descent::default(), |&[x, y]| {
            let mut sum = NormalEquations::default();
            sum.add(10.0 * (y - x * x), &[-20.0 * x, 10.0], 1.0);
            sum.add(1.0 - x, &[-1.0, 0.0], 1.0);
            Some(sum)
        });
        assert!((found.at[0] - 1.0).abs() < 1e-6 && (found.at[1] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn steps_to_where_the_problem_makes_no_sense_are_taken_back() {
        // √x = 0.1 from x = 4: the full step would leave the domain
        let found = minimize([4.0], &Descent::default(), |&[x]: &[f64; 1]| {
            let mut sum = NormalEquations::default();
            sum.add(x.sqrt() - 0.1, &[0.5 / x.sqrt()], 1.0);
            (x > 0.0).then_some(sum)
        });
        assert!((found.at[0] - 0.01).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn a_problem_that_cannot_be_evaluated_stays_where_it_started() {
        let none = minimize([1.0, 2.0], &Descent::default(), |_| None);
        assert_eq!(
            (none.at, none.sum, none.converged),
            ([1.0, 2.0], None, false)
        );
        let nan = minimize([1.0], &Descent::default(), |_| {
            let mut sum = NormalEquations::default();
            sum.add(f64::NAN, &[1.0], 1.0);
            Some(sum)
        });
        assert_eq!(nan.sum, None);
    }

    #[test]
    fn merged_sums_are_the_sum_of_all_measurements() {
        let add =
            |sum: &mut NormalEquations<2>, k: i32| sum.add(f64::from(k), &[1.0, f64::from(k)], 0.5);
        let (mut whole, mut left, mut right) = Default::default();
        (0..7).for_each(|k| add(&mut whole, k));
        (0..3).for_each(|k| add(&mut left, k));
        (3..7).for_each(|k| add(&mut right, k));
        left.merge(&right);
        assert_eq!(left, whole);
    }

    #[test]
    fn an_unknown_without_influence_stops_nothing_and_breaks_nothing() {
        let found = minimize([3.0, 7.0], &Descent::default(), |&[x, _]| {
            let mut sum = NormalEquations::default();
            sum.add(x - 1.0, &[1.0, 0.0], 1.0);
            Some(sum)
        });
        assert!(found.at[1] == 7.0 && !found.converged);
    }
}
