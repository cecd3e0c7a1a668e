//! Random walks of offsets between frames that are fixed, and the choice of where they begin and end.

use crate::track::offsets::{Matrix, Vector};
use crate::track::solve::{Knot, Node};

/// Frames that a correction reaches into measurements that contradict it, at most. A second of video: slides rarely begin or
/// end faster; with more, good frames around a slide would be spoiled, with less, the picture would visibly snap back.
const REACH_FRAMES: f64 = 30.0;

/// Frames and the steps between them.
pub(super) struct Walk<'a> {
    pub nodes: &'a [Option<Node>],
    /// Covariance of the step from each frame to the next, beyond that of the measurements.
    pub steps: &'a [Matrix],
}

/// An end of a slide.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct End {
    pub at: usize,
    pub offset: Vector,
    pub covariance: Matrix,
}

/// Frames whose offsets walk from one end to the other, in any direction.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Slide {
    pub from: End,
    /// The other end; nothing if the walk goes on, without aim, up to the frame `last`.
    pub to: Option<End>,
    /// The last frame of the walk, or the place of the other end.
    pub last: usize,
    pub stiffness: f64,
}

impl Slide {
    fn between(from: End, to: End, stiffness: f64) -> Self {
        Self {
            last: to.at,
            from,
            to: Some(to),
            stiffness,
        }
    }
}

/// A return to the measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Return {
    cost: f64,
    at: Option<usize>,
}

impl Knot {
    fn end(&self) -> End {
        End {
            at: self.at,
            offset: self.offset,
            covariance: self.covariance,
        }
    }
}

impl Walk<'_> {
    /// The covariance of the step from frame `at` to the next.
    fn step(&self, at: usize, stiffness: f64) -> Matrix {
        let spread = |at: usize| {
            self.nodes[at]
                .as_ref()
                .map_or(Matrix::zeros(), |node| node.spread)
        };
        let mean = match (self.is_measured(at), self.is_measured(at + 1)) {
            (true, true) => (spread(at) + spread(at + 1)) * 0.5,
            _ => spread(at) + spread(at + 1),
        };
        mean * stiffness + self.steps[at]
    }

    /// The factor of the steps around frame `at` for an `offset` there: the more it contradicts the measurements, the wider the
    /// steps, so that a slide to it takes no more frames than it may.
    pub fn stiffness(&self, at: usize, offset: &Vector) -> f64 {
        let reach = REACH_FRAMES as usize / 2;
        let around = at.saturating_sub(reach)..(at + reach + 1).min(self.nodes.len());
        let (mut sum, mut count) = (Matrix::zeros(), 0.0);
        for node in self.nodes[around].iter().flatten().filter(|n| n.measured) {
            sum += node.spread;
            count += 1.0;
        }
        let contradiction = (sum / count)
            .cholesky()
            .map_or(0.0, |factor| offset.dot(&factor.solve(offset)));
        (contradiction / (REACH_FRAMES * REACH_FRAMES)).max(1.0)
    }

    fn is_measured(&self, at: usize) -> bool {
        self.nodes[at].as_ref().is_some_and(|node| node.measured)
    }

    fn price(&self, at: usize) -> f64 {
        self.nodes[at].as_ref().map_or(0.0, |node| node.price)
    }

    /// The frame of the measurements, as an end.
    fn measured_end(&self, at: usize) -> End {
        End {
            at,
            offset: Vector::zeros(),
            covariance: self.nodes[at]
                .as_ref()
                .map_or(Matrix::zeros(), |node| node.noise),
        }
    }

    /// The frames after `at` in a direction that a walk can pass, `limit` excluded.
    fn run(&self, at: usize, limit: Option<usize>, forward: bool) -> Vec<usize> {
        let passable = |&k: &usize| self.nodes[k].is_some();
        if forward {
            let end = limit.unwrap_or(self.nodes.len());
            (at + 1..end).take_while(passable).collect()
        } else {
            let start = limit.map_or(0, |limit| limit + 1);
            (start..at).rev().take_while(passable).collect()
        }
    }

    /// The costs of sliding from `knot` to the measurement of each frame of a run; infinite where there is none.
    fn costs(&self, knot: &Knot, run: &[usize]) -> Vec<f64> {
        let mut sum = Matrix::zeros();
        let (mut paid, mut least) = (0.0, f64::INFINITY);
        let mut costs = Vec::with_capacity(run.len());
        for &at in run {
            let step = if at > knot.at { at - 1 } else { at };
            sum += self.step(step, knot.stiffness);
            let cost = if self.is_measured(at) {
                paid + energy(&sum, &knot.offset)
            } else {
                f64::INFINITY
            };
            costs.push(cost);
            least = least.min(cost);
            paid += self.price(at);
            // prices only grow
            if paid > least {
                break;
            }
        }
        costs.resize(run.len(), f64::INFINITY);
        costs
    }

    /// The slides around all knots.
    pub fn plan(&self, knots: &[Knot]) -> Vec<Slide> {
        let mut slides = Vec::new();
        if let Some(first) = knots.first() {
            slides.extend(self.leave(first, None, false));
        }
        for pair in knots.windows(2) {
            self.plan_between(&pair[0], &pair[1], &mut slides);
        }
        if let Some(last) = knots.last() {
            slides.extend(self.leave(last, None, true));
        }
        slides
    }

    /// The slide on the side of a knot where no other one is in reach, up to `limit`.
    fn leave(&self, knot: &Knot, limit: Option<usize>, forward: bool) -> Option<Slide> {
        let run = self.run(knot.at, limit, forward);
        let last = *run.last()?;
        let costs = self.costs(knot, &run);
        let open: f64 = run.iter().map(|&at| self.price(at)).sum();
        let best = least(&costs, &run);
        Some(match best.at.filter(|_| best.cost <= open) {
            Some(at) => Slide::between(knot.end(), self.measured_end(at), knot.stiffness),
            None => Slide {
                from: knot.end(),
                to: None,
                last,
                stiffness: knot.stiffness,
            },
        })
    }

    /// The slides between two knots.
    fn plan_between(&self, left: &Knot, right: &Knot, slides: &mut Vec<Slide>) {
        let run = self.run(left.at, Some(right.at), true);
        if run.len() + 1 < right.at - left.at {
            slides.extend(self.leave(left, Some(right.at), true));
            slides.extend(self.leave(right, Some(left.at), false));
            return;
        }
        // corrections that agree speak for a slide that stays as it is
        let way = right.offset - left.offset;
        let stiffness = self
            .stiffness(left.at, &way)
            .max(self.stiffness(right.at, &way));
        let sum: Matrix = (left.at..right.at).map(|at| self.step(at, stiffness)).sum();
        let prices: f64 = run.iter().map(|&at| self.price(at)).sum();
        let joined = energy(&sum, &way) + prices;
        let leaving = self.costs(left, &run);
        let backward: Vec<usize> = run.iter().rev().copied().collect();
        let mut coming = self.costs(right, &backward);
        coming.reverse();
        // the cheapest return up to each frame, and from there the cheapest departure
        let mut best = (joined, None);
        let mut until = Return {
            cost: f64::INFINITY,
            at: None,
        };
        for (index, &at) in run.iter().enumerate() {
            if leaving[index] < until.cost {
                until = Return {
                    cost: leaving[index],
                    at: Some(at),
                };
            }
            if let Some(back) = until.at
                && until.cost + coming[index] < best.0
            {
                best = (until.cost + coming[index], Some((back, at)));
            }
        }
        match best.1 {
            None => slides.push(Slide::between(left.end(), right.end(), stiffness)),
            Some((back, away)) => {
                slides.push(Slide::between(
                    left.end(),
                    self.measured_end(back),
                    left.stiffness,
                ));
                slides.push(Slide::between(
                    self.measured_end(away),
                    right.end(),
                    right.stiffness,
                ));
            }
        }
    }
}

/// vᵀ S⁻¹ v.
fn energy(sum: &Matrix, v: &Vector) -> f64 {
    if v.amax() == 0.0 {
        return 0.0;
    }
    sum.cholesky()
        .map_or(f64::INFINITY, |factor| v.dot(&factor.solve(v)))
}

/// The least cost, of equals the nearest.
fn least(costs: &[f64], run: &[usize]) -> Return {
    let mut best = Return {
        cost: f64::INFINITY,
        at: None,
    };
    for (&cost, &at) in costs.iter().zip(run) {
        if cost < best.cost {
            best = Return { cost, at: Some(at) };
        }
    }
    best
}

/// Writes the offsets of a slide with their covariances, those of the measurements included.
pub(super) fn fill(walk: &Walk, slide: &Slide, offsets: &mut [Option<(Vector, Matrix)>]) {
    let noise = |at: usize| {
        walk.nodes[at]
            .as_ref()
            .map_or(Matrix::zeros(), |node| node.noise)
    };
    let Slide {
        from,
        last,
        stiffness,
        ..
    } = slide;
    let Some(to) = &slide.to else {
        let frames: Vec<usize> = if *last > from.at {
            (from.at + 1..=*last).collect()
        } else {
            (*last..from.at).rev().collect()
        };
        let mut sum = from.covariance;
        for at in frames {
            let step = if at > from.at { at - 1 } else { at };
            sum += walk.step(step, *stiffness);
            offsets[at] = Some((from.offset, sum + noise(at)));
        }
        return;
    };
    let (from, to) = if from.at < to.at {
        (from, to)
    } else {
        (to, from)
    };
    let steps: Vec<Matrix> = (from.at..to.at)
        .map(|at| walk.step(at, *stiffness))
        .collect();
    for (index, (offset, covariance)) in between(&steps, from, to).into_iter().enumerate() {
        let at = from.at + 1 + index;
        offsets[at] = Some((offset, covariance + noise(at)));
    }
}

/// Mean and covariance of a random walk with fixed ends, before each step but the first.
fn between(steps: &[Matrix], from: &End, to: &End) -> Vec<(Vector, Matrix)> {
    let all: Matrix = steps.iter().sum();
    let Some(factor) = all.cholesky() else {
        return Vec::new();
    };
    let mut sum = Matrix::zeros();
    steps[..steps.len().saturating_sub(1)]
        .iter()
        .map(|step| {
            sum += step;
            // S Σ⁻¹ is the transpose of Σ⁻¹ S
            let share = factor.solve(&sum).transpose();
            let rest = Matrix::identity() - share;
            let offset = from.offset + share * (to.offset - from.offset);
            let covariance = sum - share * sum
                + share * to.covariance * share.transpose()
                + rest * from.covariance * rest.transpose();
            (offset, covariance)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::homography::Homography;
    use nalgebra::{DMatrix, DVector};
    use ravec_scenes::Seed;

    fn positive(seed: Seed, at: usize) -> Matrix {
        let root = Matrix::from_fn(|i, j| seed.gaussian(i as i64, j as i64, at as u64));
        root * root.transpose() * 0.1 + Matrix::identity() * 0.05
    }

    fn vector(seed: Seed, size: f64) -> Vector {
        Vector::from_fn(|k, _| size * seed.gaussian(k as i64, 77, 0))
    }

    fn node(spread: &Matrix, price: f64) -> Node {
        Node {
            base: Homography::IDENTITY,
            noise: *spread,
            spread: *spread,
            measured: true,
            price,
        }
    }

    fn knot(at: usize, offset: Vector) -> Knot {
        Knot {
            at,
            offset,
            covariance: Matrix::identity() * 1e-4,
            stiffness: 1.3,
        }
    }

    /// All frames of a walk as one Gaussian, its information summed step by step.
    #[test]
    fn the_closed_form_agrees_with_the_dense_solution() {
        const STEPS: usize = 6;
        let steps: Vec<Matrix> = (0..STEPS).map(|at| positive(Seed(3), at)).collect();
        let end = |at: usize, seed: u64| End {
            at,
            offset: vector(Seed(seed), 2.0),
            covariance: positive(Seed(seed), 9) * 0.3,
        };
        let (from, to) = (end(0, 5), end(STEPS, 6));
        let size = 8 * (STEPS + 1);
        let mut information = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        let mut add = |i: usize, j: usize, block: Matrix| {
            let mut view = information.view_mut((8 * i, 8 * j), (8, 8));
            view += block;
        };
        for (k, step) in steps.iter().enumerate() {
            let inverse = step.try_inverse().unwrap();
            add(k, k, inverse);
            add(k + 1, k + 1, inverse);
            add(k, k + 1, -inverse);
            add(k + 1, k, -inverse);
        }
        // fixed ends: given as the ends of a walk, so uncertain ends only shift it
        for (at, fixed) in [(0, &from), (STEPS, &to)] {
            add(at, at, Matrix::identity() * 1e9);
            let mut part = right.rows_mut(8 * at, 8);
            part += fixed.offset * 1e9;
        }
        let covariance = information.try_inverse().unwrap();
        let mean = &covariance * right;
        let found = between(&steps, &from, &to);
        assert_eq!(found.len(), STEPS - 1);
        let sharp = |end: &End| End {
            covariance: Matrix::zeros(),
            ..end.clone()
        };
        let sharply = between(&steps, &sharp(&from), &sharp(&to));
        for k in 1..STEPS {
            let dense = covariance.view((8 * k, 8 * k), (8, 8)).into_owned();
            let dense = Matrix::from_fn(|i, j| dense[(i, j)]);
            let place = Vector::from_fn(|i, _| mean[8 * k + i]);
            assert!((found[k - 1].0 - place).norm() < 1e-5, "{k}");
            assert!((sharply[k - 1].1 - dense).norm() < 1e-5, "{k}");
            // ends that are drawn by their own covariances move the frame by their shares
            let share = (0..2).map(|side| {
                let at = 8 * STEPS * side;
                let part = covariance.view((8 * k, at), (8, 8)).into_owned() * 1e9;
                let part = Matrix::from_fn(|i, j| part[(i, j)]);
                let end = [&from, &to][side];
                part * end.covariance * part.transpose()
            });
            let expected = dense + share.sum::<Matrix>();
            assert!((found[k - 1].1 - expected).norm() < 1e-4, "{k}");
        }
    }

    /// The cheapest of all pairs of a return and a departure, by trying all.
    #[test]
    fn the_plan_is_the_cheapest_of_all() {
        let mut kinds = [0; 2];
        for trial in 0..60 {
            let seed = Seed(100 + trial);
            let frames = 14;
            let nodes: Vec<Option<Node>> = (0..frames)
                .map(|at| {
                    let price = seed.between(at as i64, 1, 1, 0.1, 2.0);
                    Some(node(&positive(seed, at), price))
                })
                .collect();
            let steps = vec![Matrix::zeros(); frames];
            let walk = Walk {
                nodes: &nodes,
                steps: &steps,
            };
            let size = seed.between(0, 0, 2, 0.1, 3.0);
            let left = knot(0, vector(seed, size));
            let other = vector(seed.fork(1), size);
            // half of them agree
            let right = knot(
                13,
                if trial % 2 == 0 {
                    left.offset * 1.05
                } else {
                    other
                },
            );
            let way = right.offset - left.offset;
            let joint = walk.stiffness(0, &way).max(walk.stiffness(13, &way));
            let ramp = |from: usize, to: usize, v: Vector, stiffness: f64| {
                let sum: Matrix = (from..to).map(|at| walk.step(at, stiffness)).sum();
                let paid: f64 = (from + 1..to).map(|at| walk.price(at)).sum();
                v.dot(&(sum.try_inverse().unwrap() * v)) + paid
            };
            let joined = ramp(0, 13, way, joint);
            let mut best = (joined, None);
            for back in 1..13 {
                for away in back..13 {
                    let cost = ramp(0, back, left.offset, 1.3) + ramp(away, 13, right.offset, 1.3);
                    if cost < best.0 {
                        best = (cost, Some((back, away)));
                    }
                }
            }
            let plan = walk.plan(&[left, right]);
            let ends: Vec<(usize, usize)> = plan
                .iter()
                .map(|slide| (slide.from.at, slide.last))
                .collect();
            match best.1 {
                None => assert_eq!(ends, [(0, 13)], "{trial}"),
                Some((back, away)) => assert_eq!(ends, [(0, back), (away, 13)], "{trial}"),
            }
            kinds[usize::from(best.1.is_some())] += 1;
        }
        assert!(kinds.iter().all(|&count| count > 5), "{kinds:?}");
    }

    #[test]
    fn frames_without_a_pose_end_a_slide_that_goes_on_until_there() {
        let spread = Matrix::identity() * 0.01;
        let mut nodes: Vec<Option<Node>> = (0..20).map(|_| Some(node(&spread, 1.0))).collect();
        nodes[14] = None;
        let steps = vec![Matrix::zeros(); 20];
        let walk = Walk {
            nodes: &nodes,
            steps: &steps,
        };
        // four frames cost less than any ramp
        let far = knot(10, Vector::repeat(1.0));
        let plan = walk.plan(std::slice::from_ref(&far));
        assert!(plan[1].to.is_none() && plan[1].last == 13, "{plan:?}");
        let mut offsets = vec![None; 20];
        fill(&walk, &plan[1], &mut offsets);
        assert!(offsets[14..].iter().all(Option::is_none));
        let (held, covariance) = offsets[13].unwrap();
        assert_eq!(held, far.offset);
        // three steps of 0.013, the hand and the measurement
        assert!((covariance[(0, 0)] - (3.0 * 0.013 + 1e-4 + 0.01)).abs() < 1e-12);
    }
}
