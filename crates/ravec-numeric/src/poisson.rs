//! Blending in the gradient domain: what is copied keeps its gradients, and its tone is bent to that of the rim.
//!
//! The plain idea: find the values whose differences to their neighbors are, in the sense of least squares, the wanted
//! ones, with known pixels as they are.
//!
//! Source: Pérez, Gangnet and Blake, "Poisson image editing", 2003. The system is solved by conjugate gradients.
//!
//! Cost: a step for each pixel and iteration; iterations grow with the width of the region.

use ravec_progress::{Cancelled, Progress};

/// Pixels whose values are wanted, and the differences that they should have.
#[derive(Default)]
pub(crate) struct Blend {
    /// First guess, then the solution.
    pub(crate) values: Vec<[f32; 4]>,
    /// Pairs of unknowns `(i, j)` with the wanted `value[i] − value[j]`.
    pub(crate) pairs: Vec<(u32, u32, [f32; 4])>,
    /// Unknowns with what they should be because of a known neighbor: its value plus the wanted difference.
    pub(crate) anchors: Vec<(u32, [f32; 4], f32)>,
    /// How strongly values are held to their first guess, against one neighbor.
    pub(crate) hold: f32,
}

/// Further iterations change no 8-bit value.
const TOLERANCE: f64 = 1e-4;

impl Blend {
    /// Solves for the values. Parts without an anchor keep the mean of their first guess.
    pub(crate) fn solve(&mut self, progress: &Progress) -> Result<(), Cancelled> {
        let n = self.values.len();
        let mut degree = vec![0f32; n];
        let mut residual = vec![[0f32; 4]; n];
        for &(i, j, wanted) in &self.pairs {
            let (i, j) = (i as usize, j as usize);
            degree[i] += 1.0;
            degree[j] += 1.0;
            for c in 0..4 {
                let error = wanted[c] - (self.values[i][c] - self.values[j][c]);
                residual[i][c] += error;
                residual[j][c] -= error;
            }
        }
        let mut anchored = vec![self.hold; n];
        for &(i, wanted, weight) in &self.anchors {
            let i = i as usize;
            anchored[i] += weight;
            for c in 0..4 {
                residual[i][c] += weight * (wanted[c] - self.values[i][c]);
            }
        }
        for (degree, anchored) in degree.iter_mut().zip(&anchored) {
            *degree += anchored;
        }
        let scaled = |residual: &[[f32; 4]]| -> Vec<[f32; 4]> {
            residual
                .iter()
                .zip(&degree)
                .map(|(r, d)| r.map(|v| v / d.max(1e-6)))
                .collect()
        };
        let dot = |a: &[[f32; 4]], b: &[[f32; 4]]| -> [f64; 4] {
            let mut sum = [0f64; 4];
            for (a, b) in a.iter().zip(b) {
                for c in 0..4 {
                    sum[c] += f64::from(a[c] * b[c]);
                }
            }
            sum
        };
        let mut direction = scaled(&residual);
        let mut energy = dot(&residual, &direction);
        let enough = n as f64 * TOLERANCE * TOLERANCE;
        let phase = progress.phase("blend", 1000);
        for _ in 0..1000 {
            if energy.iter().all(|&e| e <= enough) {
                break;
            }
            progress.check()?;
            phase.advance(1);
            let mut applied: Vec<[f32; 4]> = direction
                .iter()
                .zip(&anchored)
                .map(|(d, a)| d.map(|v| v * a))
                .collect();
            for &(i, j, _) in &self.pairs {
                let (i, j) = (i as usize, j as usize);
                for c in 0..4 {
                    let difference = direction[i][c] - direction[j][c];
                    applied[i][c] += difference;
                    applied[j][c] -= difference;
                }
            }
            let curvature = dot(&direction, &applied);
            let step: [f32; 4] = std::array::from_fn(|c| {
                if curvature[c] > 0.0 {
                    (energy[c] / curvature[c]) as f32
                } else {
                    0.0
                }
            });
            for i in 0..n {
                for c in 0..4 {
                    self.values[i][c] += step[c] * direction[i][c];
                    residual[i][c] -= step[c] * applied[i][c];
                }
            }
            let better = scaled(&residual);
            let next = dot(&residual, &better);
            for c in 0..4 {
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
        let mut blend = Blend {
            values: vec![[0.0; 4]; SIDE * SIDE],
            ..Blend::default()
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
        blend.solve(&Progress::none()).unwrap();
        for (index, value) in blend.values.iter().enumerate() {
            let wanted = truth((index % SIDE) as i32, (index / SIDE) as i32);
            for c in 0..4 {
                // ten times what the residual is left at, for the smallest eigenvalue of the grid
                assert!((value[c] - wanted[c]).abs() < 5e-3, "{index} {c}");
            }
        }
    }
}
