//! Structural similarity of two luma planes.
//!
//! Source: Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to structural similarity",
//! 2004. Gaussian window of 11 × 11 pixels and σ = 1.5, K₁ = 0.01, K₂ = 0.03, range 1. At a pixel, with means μ,
//! variances σ² and covariance σxy under the window:
//!
//! ```text
//! ssim = (2 μx μy + C1)(2 σxy + C2) / (μx² + μy² + C1)(σx² + σy² + C2)
//! ```
//!
//! Sums are taken in `f32` about middle gray: variances are off by at most about 2e-7, and a pixel's similarity by at
//! most about 4e-4 where both planes are flat, far less elsewhere. Equal planes give exactly 1.

use crate::filter::{pad, weigh};

/// Distance from a pixel to the border of its window.
pub(crate) const REACH: usize = 5;

const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;

/// The window at distances 0 to 5, of sum 1 when both sides are counted.
fn window() -> [f32; REACH + 1] {
    let raw: [f64; REACH + 1] = std::array::from_fn(|i| (-((i * i) as f64) / 4.5).exp());
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    raw.map(|weight| (weight / sum) as f32)
}

/// A stretch of rows of both planes, with the rows above and below that their windows need.
pub(crate) struct Slab {
    width: usize,
    rows: usize,
    /// Means under the horizontal window of x, y, x², y², xy.
    wide: [Vec<f32>; 5],
    padded: Vec<f32>,
    products: Vec<f32>,
}

impl Slab {
    /// A slab without rows.
    pub(crate) fn new(width: usize) -> Self {
        Self {
            width,
            rows: 0,
            wide: std::array::from_fn(|_| Vec::new()),
            padded: Vec::new(),
            products: vec![0.0; width],
        }
    }

    /// Adds the next row below: encoded luma of both planes, 0 to 1.
    pub(crate) fn push(&mut self, x: &[f32], y: &[f32]) {
        let middle = |v: f32| v - 0.5;
        let product: [fn(f32, f32) -> f32; 5] =
            [|x, _| x, |_, y| y, |x, _| x * x, |_, y| y * y, |x, y| x * y];
        let kernel = window();
        let begin = self.rows * self.width;
        self.rows += 1;
        for (wide, product) in self.wide.iter_mut().zip(product) {
            for (value, (&x, &y)) in self.products.iter_mut().zip(x.iter().zip(y)) {
                *value = product(middle(x), middle(y));
            }
            pad(&self.products, REACH, &mut self.padded);
            wide.resize(begin + self.width, 0.0);
            let padded = &self.padded;
            let taps: [_; REACH + 1] =
                std::array::from_fn(|tap| (&padded[REACH - tap..], &padded[REACH + tap..]));
            weigh(&mut wide[begin..], &kernel, &taps);
        }
    }

    /// The similarity at each pixel of row `row` of the slab. Rows outside the slab read as its first or last one, so
    /// the slab must hold [`REACH`] rows on either side unless the picture ends there.
    pub(crate) fn similarity(&self, row: usize, out: &mut [f32]) {
        let kernel = window();
        let mut means: [Vec<f32>; 5] = std::array::from_fn(|_| vec![0.0; self.width]);
        for (mean, wide) in means.iter_mut().zip(&self.wide) {
            let line = |row: usize| &wide[row.min(self.rows - 1) * self.width..][..self.width];
            let taps: [_; REACH + 1] =
                std::array::from_fn(|tap| (line(row.saturating_sub(tap)), line(row + tap)));
            weigh(mean, &kernel, &taps);
        }
        let [x, y, xx, yy, xy] = &means;
        for (col, value) in out.iter_mut().enumerate() {
            let (mx, my) = (x[col], y[col]);
            let covariance = xy[col] - mx * my;
            let variances = (xx[col] - mx * mx) + (yy[col] - my * my);
            let (mx, my) = (mx + 0.5, my + 0.5);
            let likeness = (mx * my + mx * my + C1) * (covariance + covariance + C2);
            *value = likeness / ((mx * mx + my * my + C1) * (variances + C2));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;
    use crate::size::Size;
    use proptest::prelude::*;

    /// The definition, in double precision over the whole window.
    fn naive(a: &Plane, b: &Plane, col: usize, row: usize) -> f64 {
        let offsets = || (-5isize..=5).flat_map(|j| (-5isize..=5).map(move |i| (i, j)));
        let bell = |i: isize, j: isize| (-((i * i + j * j) as f64) / 4.5).exp();
        let total: f64 = offsets().map(|(i, j)| bell(i, j)).sum();
        let mean = |f: &dyn Fn(f64, f64) -> f64| {
            let at =
                |plane: &Plane, i, j| f64::from(plane.clamped(col as isize + i, row as isize + j));
            offsets()
                .map(|(i, j)| bell(i, j) * f(at(a, i, j), at(b, i, j)))
                .sum::<f64>()
                / total
        };
        let (mx, my) = (mean(&|x, _| x), mean(&|_, y| y));
        let vx = mean(&|x, _| (x - mx).powi(2));
        let vy = mean(&|_, y| (y - my).powi(2));
        let cov = mean(&|x, y| (x - mx) * (y - my));
        (2.0 * mx * my + 1e-4) * (2.0 * cov + 9e-4)
            / ((mx * mx + my * my + 1e-4) * (vx + vy + 9e-4))
    }

    fn slab(a: &Plane, b: &Plane) -> Slab {
        let mut slab = Slab::new(a.width());
        a.rows().zip(b.rows()).for_each(|(x, y)| slab.push(x, y));
        slab
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn the_similarity_agrees_with_the_definition(
            (w, h) in (1usize..20, 1usize..20), seed in 0u32..1000, contrast in 0.0f32..1.0
        ) {
            let size = Size::new(w, h).unwrap();
            let noise = |seed: u32| Plane::from_fn(size, |col, row| {
                let mixed = ((row * w + col) as u32 + seed).wrapping_mul(2_654_435_761);
                contrast * (mixed >> 8) as f32 / (1 << 24) as f32
            });
            let (a, b) = (noise(seed), noise(seed + 17));
            let slab = slab(&a, &b);
            let mut line = vec![0.0; w];
            for row in 0..h {
                slab.similarity(row, &mut line);
                for (col, &found) in line.iter().enumerate() {
                    let truth = naive(&a, &b, col, row);
                    prop_assert!((f64::from(found) - truth).abs() < 4e-4, "{found} {truth}");
                }
            }
        }
    }

    #[test]
    fn equal_planes_are_similar_by_exactly_one() {
        let plane = Plane::from_fn(Size::new(14, 13).unwrap(), |col, row| {
            ((col * row) as f32).sin().abs()
        });
        let slab = slab(&plane, &plane);
        let mut line = vec![0.0; 14];
        for row in 0..13 {
            slab.similarity(row, &mut line);
            assert!(line.iter().all(|&v| v == 1.0));
        }
    }
}
