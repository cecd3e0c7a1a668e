//! Poisson systems: values whose differences to their neighbors are, in the sense of least squares, the wanted ones, with known
//! neighbors as they are. Blending in the gradient domain is the common use: what is copied keeps its gradients, and its tone
//! is bent to that of the rim.
//!
//! Source: Pérez, Gangnet and Blake, "Poisson image editing", 2003. The system is solved by conjugate gradients, scaled by the
//! diagonal.
//!
//! Guarantees: the same bits on any number of threads; ends after at most 1000 iterations. Does not guarantee: a residual below
//! the tolerance by then.
//!
//! Cost: a step for each pair and iteration; iterations grow with the width of the region.

/// Unknowns of `C` channels, and the differences that they should have.
///
/// ```
/// use ravec_numeric::PoissonSystem;
///
/// // three values between 0 and 4 that should not differ
/// let mut system = PoissonSystem {
///     values: vec![[0.0]; 3],
///     pairs: vec![(1, 0, [0.0]), (2, 1, [0.0])],
///     anchors: vec![(0, [0.0], 1.0), (2, [4.0], 1.0)],
///     hold: 0.0,
/// };
/// system.solve(|| Ok::<(), ()>(()))?;
/// assert!(system.values.iter().zip([1.0, 2.0, 3.0]).all(|(found, truth)| (found[0] - truth).abs() < 1e-3));
/// # Ok::<(), ()>(())
/// ```
#[derive(Debug, Clone)]
pub struct PoissonSystem<const C: usize> {
    /// First guess, then the solution.
    pub values: Vec<[f32; C]>,
    /// Pairs of unknowns `(i, j)` with the wanted `value[i] − value[j]`.
    pub pairs: Vec<(u32, u32, [f32; C])>,
    /// Unknowns with what they should be because of a known neighbor: its value plus the wanted difference, and its weight
    /// against that of a pair.
    pub anchors: Vec<(u32, [f32; C], f32)>,
    /// Weight that holds values to their first guess, against one pair (default 0).
    pub hold: f32,
}

impl<const C: usize> Default for PoissonSystem<C> {
    fn default() -> Self {
        Self {
            values: Vec::new(),
            pairs: Vec::new(),
            anchors: Vec::new(),
            hold: 0.0,
        }
    }
}

/// Iterations at most.
const MAX_ITERATIONS: usize = 1000;

/// The residual at which iterations end, the root of the mean square: of values of 0 to 1, more change no 8-bit value.
const TOLERANCE: f64 = 1e-4;

impl<const C: usize> PoissonSystem<C> {
    /// The most times that [`PoissonSystem::solve`] calls `before_step`.
    pub const MAX_STEPS: usize = MAX_ITERATIONS;

    /// Solves for the values. Parts without an anchor keep the mean of their first guess. `before_step` is called before each
    /// iteration.
    ///
    /// # Errors
    /// That of `before_step`, which ends the work; values are then those of the last iteration.
    ///
    /// # Panics
    /// If a pair or an anchor names an unknown that does not exist.
    pub fn solve<E>(&mut self, mut before_step: impl FnMut() -> Result<(), E>) -> Result<(), E> {
        let n = self.values.len();
        let mut degree = vec![0f32; n];
        let mut residual = vec![[0f32; C]; n];
        for &(i, j, wanted) in &self.pairs {
            let (i, j) = (i as usize, j as usize);
            degree[i] += 1.0;
            degree[j] += 1.0;
            for c in 0..C {
                let error = wanted[c] - (self.values[i][c] - self.values[j][c]);
                residual[i][c] += error;
                residual[j][c] -= error;
            }
        }
        let mut anchored = vec![self.hold; n];
        for &(i, wanted, weight) in &self.anchors {
            let i = i as usize;
            anchored[i] += weight;
            for c in 0..C {
                residual[i][c] += weight * (wanted[c] - self.values[i][c]);
            }
        }
        for (degree, anchored) in degree.iter_mut().zip(&anchored) {
            *degree += anchored;
        }
        let scaled = |residual: &[[f32; C]]| -> Vec<[f32; C]> {
            residual
                .iter()
                .zip(&degree)
                .map(|(r, d)| r.map(|v| v / d.max(1e-6)))
                .collect()
        };
        let dot = |a: &[[f32; C]], b: &[[f32; C]]| -> [f64; C] {
            let mut sum = [0f64; C];
            for (a, b) in a.iter().zip(b) {
                for c in 0..C {
                    sum[c] += f64::from(a[c] * b[c]);
                }
            }
            sum
        };
        let mut direction = scaled(&residual);
        let mut energy = dot(&residual, &direction);
        let enough = n as f64 * TOLERANCE * TOLERANCE;
        for _ in 0..MAX_ITERATIONS {
            if energy.iter().all(|&e| e <= enough) {
                break;
            }
            before_step()?;
            let mut applied: Vec<[f32; C]> = direction
                .iter()
                .zip(&anchored)
                .map(|(d, a)| d.map(|v| v * a))
                .collect();
            for &(i, j, _) in &self.pairs {
                let (i, j) = (i as usize, j as usize);
                for c in 0..C {
                    let difference = direction[i][c] - direction[j][c];
                    applied[i][c] += difference;
                    applied[j][c] -= difference;
                }
            }
            let curvature = dot(&direction, &applied);
            let step: [f32; C] = std::array::from_fn(|c| {
                if curvature[c] > 0.0 {
                    (energy[c] / curvature[c]) as f32
                } else {
                    0.0
                }
            });
            for i in 0..n {
                for c in 0..C {
                    self.values[i][c] += step[c] * direction[i][c];
                    residual[i][c] -= step[c] * applied[i][c];
                }
            }
            let better = scaled(&residual);
            let next = dot(&residual, &better);
            for c in 0..C {
                let ratio = if energy[c] > 0.0 {
                    (next[c] / energy[c]) as f32
                } else {
                    0.0
                };
                for (d, b) in direction.iter_mut().zip(&better) {
                    d[c] = b[c] + ratio * d[c];
                }
            }
            energy = next;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_of_a_surface_and_its_rim_give_the_surface_back() {
        const SIDE: usize = 12;
        let truth = |x: i32, y: i32| {
            let (x, y) = (f64::from(x), f64::from(y));
            [0.1 * x - 0.05 * y, (0.3 * x).sin(), 0.01 * x * y, 1.0].map(|v| v as f32)
        };
        let mut blend = PoissonSystem {
            values: vec![[0.0; 4]; SIDE * SIDE],
            ..PoissonSystem::default()
        };
        for index in 0..SIDE * SIDE {
            let (x, y) = ((index % SIDE) as i32, (index / SIDE) as i32);
            for (dx, dy) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
                let (a, b) = (truth(x, y), truth(x + dx, y + dy));
                let inside =
                    (0..SIDE as i32).contains(&(x + dx)) && (0..SIDE as i32).contains(&(y + dy));
                if !inside {
                    blend.anchors.push((index as u32, a, 1.0));
                } else if dx + dy > 0 {
                    let other = index + if dx == 1 { 1 } else { SIDE };
                    let wanted = std::array::from_fn(|c| a[c] - b[c]);
                    blend.pairs.push((index as u32, other as u32, wanted));
                }
            }
        }
        blend.solve(|| Ok::<(), ()>(())).unwrap();
        for (index, value) in blend.values.iter().enumerate() {
            let wanted = truth((index % SIDE) as i32, (index / SIDE) as i32);
            for c in 0..4 {
                // ten times what the residual is left at, for the smallest eigenvalue of the grid
                assert!((value[c] - wanted[c]).abs() < 5e-3, "{index} {c}");
            }
        }
    }
}
