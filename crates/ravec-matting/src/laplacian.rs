//! The matting Laplacian: in each window of 3×3 pixels alpha is nearly a linear function of the colors.
//!
//! Source: Levin et al., *A closed-form solution to natural image matting*, 2008. Rows of the matrix exist for unknown pixels only,
//! as 5×5 stencils, and the system is solved by conjugate gradients with the diagonal as preconditioner.

use crate::matte::{Colors, MattingError};
use crate::symmetric::{adjugate, product};
use ravec_progress::Progress;
use ravec_raster::{Plane, Size};
use rayon::prelude::*;

/// Cells of the stencil of a pixel: 5×5.
const CELLS: usize = 25;
/// Pixels beside a plane that a stencil reads.
const BORDER: usize = 2;
/// Variance that is added to the colors of a window: noise and rounding.
const WINDOW_VARIANCE: f64 = 3e-7;
/// Residual, relative to that of the start, at which the solution stands.
const MAX_RESIDUAL: f64 = 2e-3;

/// A run of unknown pixels in a row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    pub row: usize,
    pub col: usize,
    len: usize,
    /// Number of its first pixel among the unknown ones.
    start: usize,
}

/// Data term of the unknown pixels.
pub(crate) struct DataTerm {
    /// Alpha by its color alone.
    pub alpha: Vec<f32>,
    /// Weight against the windows.
    pub weight: Vec<f32>,
}

/// The unknown pixels of a picture, in the order of rows.
pub(crate) struct Unknowns {
    size: Size,
    spans: Vec<Span>,
    len: usize,
}

impl Unknowns {
    pub fn new(size: Size, unknown: impl Fn(usize, usize) -> bool) -> Self {
        let mut spans: Vec<Span> = Vec::new();
        let mut len = 0;
        for row in 0..size.height() {
            let mut open = false;
            for col in 0..size.width() {
                let is = unknown(col, row);
                match spans.last_mut() {
                    Some(span) if is && open => span.len += 1,
                    _ if is => spans.push(Span {
                        row,
                        col,
                        len: 1,
                        start: len,
                    }),
                    _ => {}
                }
                open = is;
                len += usize::from(is);
            }
        }
        Self { size, spans, len }
    }

    /// Number of unknown pixels.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Positions of the unknown pixels.
    pub fn positions(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.spans
            .iter()
            .flat_map(|span| (span.col..span.col + span.len).map(|col| (col, span.row)))
    }

    /// Calls `f` with each span and its part of `values`, of `cells` values a pixel.
    pub fn for_spans<T: Send>(
        &self,
        values: &mut [T],
        cells: usize,
        f: impl Fn(Span, &mut [T]) + Sync,
    ) {
        let mut rest = values;
        let mut parts = Vec::with_capacity(self.spans.len());
        for span in &self.spans {
            let (part, after) = std::mem::take(&mut rest).split_at_mut(cells * span.len);
            parts.push((*span, part));
            rest = after;
        }
        parts
            .into_par_iter()
            .with_min_len(16)
            .for_each(|(span, part)| f(span, part));
    }
}

/// Mean and inverse covariance of the colors of a window.
struct Window {
    mean: [f32; 3],
    /// Entries xx, yy, zz, xy, xz, yz.
    inverse: [f32; 6],
}

impl Window {
    fn around(colors: &Colors, col: usize, row: usize) -> Self {
        let mut mean = [0.0f32; 3];
        for r in row - 1..=row + 1 {
            for color in &colors.row(r)[col - 1..=col + 1] {
                for (mean, value) in mean.iter_mut().zip(color) {
                    *mean += value / 9.0;
                }
            }
        }
        // covariances of windows on an edge have two tiny eigenvalues: single precision would lose them
        let [mut xx, mut yy, mut zz] = [WINDOW_VARIANCE; 3];
        let [mut xy, mut xz, mut yz] = [0.0f64; 3];
        for r in row - 1..=row + 1 {
            for color in &colors.row(r)[col - 1..=col + 1] {
                let [x, y, z] = [0, 1, 2].map(|c| f64::from(color[c] - mean[c]));
                xx += x * x / 9.0;
                yy += y * y / 9.0;
                zz += z * z / 9.0;
                xy += x * y / 9.0;
                xz += x * z / 9.0;
                yz += y * z / 9.0;
            }
        }
        let (cofactors, determinant) = adjugate([xx, yy, zz, xy, xz, yz]);
        Self {
            mean,
            inverse: cofactors.map(|value| (value / determinant) as f32),
        }
    }

    /// Inverse covariance times the difference of a color to the mean.
    fn whitened(&self, color: [f32; 3]) -> [f32; 3] {
        let difference = [0, 1, 2].map(|c| color[c] - self.mean[c]);
        product(&self.inverse, difference)
    }
}

/// The rows of the matting Laplacian for the unknown pixels, and a weight on the diagonal.
pub(crate) struct MattingLaplacian<'a> {
    unknowns: &'a Unknowns,
    /// For each span its cells, one after the other, each for all pixels of the span.
    stencils: Vec<f32>,
}

impl<'a> MattingLaplacian<'a> {
    pub fn new(colors: &Colors, unknowns: &'a Unknowns) -> Self {
        let mut stencils = vec![0.0f32; CELLS * unknowns.len];
        unknowns.for_spans(&mut stencils, CELLS, |span, cells| {
            assemble(colors, span, cells);
        });
        Self { unknowns, stencils }
    }

    /// Values of the product of the matrix and a padded plane.
    fn times(&self, plane: &Padded, out: &mut [f32]) {
        self.unknowns.for_spans(out, 1, |span, out| {
            out.fill(0.0);
            let stencils = &self.stencils[CELLS * span.start..][..CELLS * span.len];
            for (cell, factors) in stencils.chunks_exact(span.len).enumerate() {
                let from = (span.row + cell / 5) * plane.stride + span.col + cell % 5;
                let values = &plane.values[from..][..span.len];
                for ((out, factor), value) in out.iter_mut().zip(factors).zip(values) {
                    *out += factor * value;
                }
            }
        });
    }

    fn diagonal(&self) -> Vec<f32> {
        let mut diagonal = Vec::with_capacity(self.unknowns.len);
        for span in &self.unknowns.spans {
            let center = CELLS * span.start + (CELLS / 2) * span.len;
            diagonal.extend_from_slice(&self.stencils[center..][..span.len]);
        }
        diagonal
    }

    /// Minimizes αᵀLα + Σ wᵢ(αᵢ − aᵢ)² over the unknown pixels of `alpha`; the others stay as they are.
    ///
    /// # Errors
    /// [`MattingError::Cancelled`].
    pub fn solve(
        &self,
        data: &DataTerm,
        alpha: &mut Plane,
        max_steps: usize,
        progress: &Progress,
    ) -> Result<(), MattingError> {
        let unknowns = self.unknowns;
        if unknowns.len == 0 {
            return Ok(());
        }
        let mut plane = Padded::new(unknowns.size);
        plane.set(alpha);
        let mut solution: Vec<f32> = unknowns.positions().map(|at| alpha[at]).collect();
        let mut residual = vec![0.0f32; unknowns.len];
        self.times(&plane, &mut residual);
        for (at, residual) in residual.iter_mut().enumerate() {
            *residual = data.weight[at] * (data.alpha[at] - solution[at]) - *residual;
        }
        let inverse: Vec<f32> = self
            .diagonal()
            .iter()
            .zip(&data.weight)
            .map(|(diagonal, weight)| 1.0 / (diagonal + weight).max(1e-12))
            .collect();
        let mut direction: Vec<f32> = residual.iter().zip(&inverse).map(|(r, m)| r * m).collect();
        let mut power = dot(&residual, &direction);
        let enough = power * MAX_RESIDUAL * MAX_RESIDUAL;
        let mut product = vec![0.0f32; unknowns.len];
        plane.values.fill(0.0);
        for _ in 0..max_steps {
            progress.check()?;
            plane.scatter(unknowns, &direction);
            self.times(&plane, &mut product);
            for ((product, weight), direction) in
                product.iter_mut().zip(&data.weight).zip(&direction)
            {
                *product += weight * direction;
            }
            let curvature = dot(&direction, &product);
            if curvature <= 0.0 || !curvature.is_finite() {
                break;
            }
            let step = (power / curvature) as f32;
            for (((x, r), d), p) in solution
                .iter_mut()
                .zip(&mut residual)
                .zip(&direction)
                .zip(&product)
            {
                *x += step * d;
                *r -= step * p;
            }
            let next: f64 = residual
                .iter()
                .zip(&inverse)
                .map(|(r, m)| f64::from(r * r * m))
                .sum();
            if next <= enough {
                break;
            }
            let momentum = (next / power) as f32;
            power = next;
            for ((d, r), m) in direction.iter_mut().zip(&residual).zip(&inverse) {
                *d = r * m + momentum * *d;
            }
        }
        for (at, value) in unknowns.positions().zip(&solution) {
            alpha[at] = if value.is_finite() {
                value.clamp(0.0, 1.0)
            } else {
                0.0
            };
        }
        Ok(())
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum()
}

/// Adds the windows that contain the pixels of a span to its stencils.
fn assemble(colors: &Colors, span: Span, cells: &mut [f32]) {
    let (width, height) = (colors.width(), colors.height());
    for row in span.row.max(2) - 1..=span.row + 1 {
        if row + 1 >= height {
            continue;
        }
        for col in span.col.max(2) - 1..=span.col + span.len {
            if col + 1 >= width {
                continue;
            }
            let window = Window::around(colors, col, row);
            let first = (col - 1).max(span.col);
            let last = (col + 1).min(span.col + span.len - 1);
            for own in first..=last {
                let factors = window.whitened(colors[(own, span.row)]);
                for r in row - 1..=row + 1 {
                    for c in col - 1..=col + 1 {
                        let color = colors[(c, r)];
                        let product: f32 = (0..3)
                            .map(|k| factors[k] * (color[k] - window.mean[k]))
                            .sum();
                        let same = c == own && r == span.row;
                        let cell = (r + BORDER - span.row) * 5 + c + BORDER - own;
                        cells[cell * span.len + own - span.col] +=
                            if same { 1.0 } else { 0.0 } - (1.0 + product) / 9.0;
                    }
                }
            }
        }
    }
}

/// A plane with a border, so that stencils need no checks.
struct Padded {
    stride: usize,
    values: Vec<f32>,
}

impl Padded {
    fn new(size: Size) -> Self {
        let stride = size.width() + 2 * BORDER;
        Self {
            stride,
            values: vec![0.0; stride * (size.height() + 2 * BORDER)],
        }
    }

    fn set(&mut self, plane: &Plane) {
        for row in 0..plane.height() {
            let from = (row + BORDER) * self.stride + BORDER;
            self.values[from..][..plane.width()].copy_from_slice(plane.row(row));
        }
    }

    fn scatter(&mut self, unknowns: &Unknowns, values: &[f32]) {
        for span in &unknowns.spans {
            let from = (span.row + BORDER) * self.stride + BORDER + span.col;
            self.values[from..][..span.len].copy_from_slice(&values[span.start..][..span.len]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Image;

    fn scene(size: Size) -> (Colors, Plane) {
        let alpha = Plane::from_fn(size, |col, _| {
            (col as f32 / (size.width() - 1) as f32 * 1.6 - 0.3).clamp(0.0, 1.0)
        });
        let colors = Image::from_fn(size, |col, row| {
            let a = alpha[(col, row)];
            [0.2 + 0.6 * a, 0.7 - 0.5 * a, 0.1 + 0.3 * a]
        });
        (colors, alpha)
    }

    #[test]
    fn the_product_agrees_with_sums_over_windows() {
        let size = Size::new(9, 7).unwrap();
        let colors: Colors = Image::from_fn(size, |col, row| {
            let x = (row * 9 + col) as f32;
            [
                0.5 + 0.4 * (1.3 * x).sin(),
                0.5 + 0.3 * (2.1 * x).cos(),
                0.4 + 0.2 * (0.7 * x).sin(),
            ]
        });
        let unknowns = Unknowns::new(size, |col, row| (col + row) % 4 != 0);
        let laplacian = MattingLaplacian::new(&colors, &unknowns);
        let p = Plane::from_fn(size, |col, row| ((3 * col + 5 * row) % 7) as f32 / 7.0);
        let mut padded = Padded::new(size);
        padded.set(&p);
        let mut product = vec![0.0; unknowns.len()];
        laplacian.times(&padded, &mut product);
        // the definition: in each window, what a linear function of the colors leaves of p
        let mut truth = vec![0.0f64; size.pixels()];
        for row in 1..size.height() - 1 {
            for col in 1..size.width() - 1 {
                let window = Window::around(&colors, col, row);
                let cells: Vec<(usize, usize)> = (row - 1..=row + 1)
                    .flat_map(|r| (col - 1..=col + 1).map(move |c| (c, r)))
                    .collect();
                for i in &cells {
                    let whitened = window.whitened(colors[*i]);
                    for j in &cells {
                        let product: f32 = (0..3)
                            .map(|c| whitened[c] * (colors[*j][c] - window.mean[c]))
                            .sum();
                        let entry = f64::from(u8::from(i == j)) - f64::from(1.0 + product) / 9.0;
                        truth[i.1 * 9 + i.0] += entry * f64::from(p[*j]);
                    }
                }
            }
        }
        for (at, found) in unknowns.positions().zip(&product) {
            assert!((f64::from(*found) - truth[at.1 * 9 + at.0]).abs() < 1e-3);
        }
    }

    #[test]
    fn alpha_that_is_linear_in_the_colors_is_found_from_the_ends() {
        let size = Size::new(24, 12).unwrap();
        let (colors, truth) = scene(size);
        let unknowns = Unknowns::new(size, |col, _| (4..20).contains(&col));
        let mut alpha = Plane::from_fn(size, |col, row| {
            if (4..20).contains(&col) {
                0.5
            } else {
                truth[(col, row)]
            }
        });
        let data = DataTerm {
            alpha: vec![0.5; unknowns.len()],
            weight: vec![1e-9; unknowns.len()],
        };
        let laplacian = MattingLaplacian::new(&colors, &unknowns);
        laplacian
            .solve(&data, &mut alpha, 2000, &Progress::none())
            .unwrap();
        for (found, truth) in alpha.pixels().iter().zip(truth.pixels()) {
            assert!((found - truth).abs() < 0.02, "{found} {truth}");
        }
    }

    #[test]
    fn pictures_smaller_than_a_window_keep_their_data() {
        for (width, height) in [(1, 1), (2, 5), (5, 2)] {
            let size = Size::new(width, height).unwrap();
            let unknowns = Unknowns::new(size, |_, _| true);
            let colors = Image::new(size, [0.5; 3]);
            let data = DataTerm {
                alpha: vec![0.25; size.pixels()],
                weight: vec![1.0; size.pixels()],
            };
            let mut alpha = Plane::new(size, 0.0);
            MattingLaplacian::new(&colors, &unknowns)
                .solve(&data, &mut alpha, 10, &Progress::none())
                .unwrap();
            assert!(
                alpha
                    .pixels()
                    .iter()
                    .all(|value| (value - 0.25).abs() < 1e-6)
            );
        }
    }
}
