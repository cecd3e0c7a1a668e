//! The matting Laplacian: in each window of 3×3 pixels alpha is nearly a linear function of the colors.
//!
//! Source: Levin et al., *A closed-form solution to natural image matting*, 2008. Rows of the matrix exist for unknown pixels only,
//! as 5×5 stencils, and the system is solved by conjugate gradients with the diagonal as preconditioner.

use crate::matte::{Colors, MattingError};
use crate::symmetric::{adjugate, product};
use fearless_simd::{Level as Vectors, Simd, dispatch};
use ravec_progress::Progress;
use ravec_raster::{Plane, Size};
use rayon::prelude::*;

/// Cells of the stencil of a pixel: 5×5.
const CELLS: usize = 25;
/// Pixels beside a plane that a stencil reads.
const BORDER: usize = 2;
/// Pixels of a window: 3×3.
const WINDOW_PIXELS: f64 = 9.0;
/// Variance that is added to the colors of a window: noise and rounding.
const WINDOW_VARIANCE: f64 = 3e-7;
/// Residual, relative to that of the start, at which the solution stands.
const MAX_RESIDUAL: f64 = 2e-3;

/// A run of unknown pixels in a row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    pub row: usize,
    pub col: usize,
    pub len: usize,
    /// Number of its first pixel among the unknown ones.
    pub start: usize,
}

/// Data term of the unknown pixels.
pub(crate) struct DataTerm {
    /// Alpha by its color alone.
    pub alpha: Vec<f32>,
    /// Weight against the windows.
    pub weight: Vec<f32>,
}

impl DataTerm {
    /// Averages for the unknown pixels at half the size.
    pub fn halved(&self, unknowns: &Unknowns, half: &Unknowns) -> Self {
        let mut weight = Plane::new(half.size, 0.0);
        let mut weighted = Plane::new(half.size, 0.0);
        let terms = self.alpha.iter().zip(&self.weight);
        for ((col, row), (alpha, factor)) in unknowns.positions().zip(terms) {
            let at = (col / 2, row / 2);
            weight[at] += factor;
            weighted[at] += factor * alpha;
        }
        Self {
            alpha: half
                .positions()
                .map(|at| weighted[at] / weight[at].max(f32::MIN_POSITIVE))
                .collect(),
            weight: half.positions().map(|at| 0.25 * weight[at]).collect(),
        }
    }
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

    /// The pixels at half the size all of whose pixels at full size are unknown.
    pub fn halved(&self) -> Self {
        let half = self.size.cells(2);
        let mut counts = Plane::new(half, 0.0);
        for (col, row) in self.positions() {
            counts[(col / 2, row / 2)] += 1.0;
        }
        Self::new(half, |col, row| counts[(col, row)] == 4.0)
    }

    /// Number of unknown pixels.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The runs of unknown pixels.
    pub fn spans(&self) -> &[Span] {
        &self.spans
    }

    /// Positions of the unknown pixels.
    pub fn positions(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.spans
            .iter()
            .flat_map(|span| (span.col..span.col + span.len).map(|col| (col, span.row)))
    }

    /// Calls `f` with each span and its part of `values`, of `cells` values a pixel, and with scratch space.
    pub fn for_spans<T: Send, R>(
        &self,
        values: &mut [T],
        cells: usize,
        scratch: impl Fn() -> R + Sync + Send,
        f: impl Fn(&mut R, Span, &mut [T]) + Sync + Send,
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
            .for_each_init(scratch, |scratch, (span, part)| f(scratch, span, part));
    }
}

/// The channels of three rows of a picture around a span, with two columns more on each side. Beyond the picture its last
/// column stands again.
#[derive(Default)]
struct Neighborhood {
    lines: [[Vec<f32>; 3]; 3],
}

impl Neighborhood {
    fn fill(&mut self, colors: &Colors, row: usize, span: Span) {
        let last = colors.width() - 1;
        for (channels, row) in self.lines.iter_mut().zip(row - 1..) {
            let colors = colors.row(row);
            for (channel, line) in channels.iter_mut().enumerate() {
                line.clear();
                line.extend((0..span.len + 2 * BORDER).map(|offset| {
                    let col = (span.col + offset).saturating_sub(BORDER).min(last);
                    colors[col][channel]
                }));
            }
        }
    }
}

/// Means and inverse covariances of the colors of the windows along a row.
#[derive(Default)]
struct Windows {
    mean: [Vec<f32>; 3],
    /// Entries xx, yy, zz, xy, xz, yz.
    inverse: [Vec<f32>; 6],
    /// 1 for a window that lies in the picture, 0 for others.
    is_inside: Vec<f32>,
}

impl Windows {
    /// The windows around the middle row of the lines, whose first and last column are the neighbors of the span.
    fn fill(&mut self, around: &Neighborhood, span: Span, width: usize) {
        let count = span.len + 2;
        for line in self.mean.iter_mut().chain(&mut self.inverse) {
            line.clear();
            line.resize(count, 0.0);
        }
        self.is_inside.clear();
        self.is_inside.extend((0..count).map(|offset| {
            let col = span.col + offset;
            // `col` is one more than the column of the window
            f32::from(u8::from(col >= 2 && col < width))
        }));
        dispatch!(Vectors::new(), simd => self.compute(simd, around));
    }

    #[inline(always)]
    fn compute<S: Simd>(&mut self, _simd: S, around: &Neighborhood) {
        let count = self.is_inside.len();
        let [xs, ys, zs] = [0, 1, 2]
            .map(|channel| [0, 1, 2].map(|row: usize| &around.lines[row][channel][..count + 2]));
        let [mx, my, mz] = &mut self.mean;
        let (mx, my, mz) = (&mut mx[..count], &mut my[..count], &mut mz[..count]);
        let [ixx, iyy, izz, ixy, ixz, iyz] = self.inverse.each_mut().map(|line| &mut line[..count]);
        for at in 0..count {
            let mut mean = [0.0f32; 3];
            for row in 0..3 {
                for col in at..at + 3 {
                    mean[0] += xs[row][col];
                    mean[1] += ys[row][col];
                    mean[2] += zs[row][col];
                }
            }
            for mean in &mut mean {
                *mean *= 1.0 / WINDOW_PIXELS as f32;
            }
            [mx[at], my[at], mz[at]] = mean;
            // covariances of windows on an edge have two tiny eigenvalues: single precision would lose them
            let [mut xx, mut yy, mut zz] = [0.0f64; 3];
            let [mut xy, mut xz, mut yz] = [0.0f64; 3];
            for row in 0..3 {
                for col in at..at + 3 {
                    let x = f64::from(xs[row][col] - mean[0]);
                    let y = f64::from(ys[row][col] - mean[1]);
                    let z = f64::from(zs[row][col] - mean[2]);
                    xx += x * x;
                    yy += y * y;
                    zz += z * z;
                    xy += x * y;
                    xz += x * z;
                    yz += y * z;
                }
            }
            let share = 1.0 / WINDOW_PIXELS;
            let (cofactors, determinant) = adjugate([
                xx * share + WINDOW_VARIANCE,
                yy * share + WINDOW_VARIANCE,
                zz * share + WINDOW_VARIANCE,
                xy * share,
                xz * share,
                yz * share,
            ]);
            let scale = 1.0 / determinant;
            ixx[at] = (cofactors[0] * scale) as f32;
            iyy[at] = (cofactors[1] * scale) as f32;
            izz[at] = (cofactors[2] * scale) as f32;
            ixy[at] = (cofactors[3] * scale) as f32;
            ixz[at] = (cofactors[4] * scale) as f32;
            iyz[at] = (cofactors[5] * scale) as f32;
        }
    }
}

/// The rows of the matting Laplacian for the unknown pixels, and a weight on the diagonal.
pub(crate) struct MattingLaplacian {
    unknowns: Unknowns,
    /// For each span its cells, one after the other, each for all pixels of the span.
    stencils: Vec<f32>,
}

impl MattingLaplacian {
    pub fn new(colors: &Colors, unknowns: Unknowns) -> Self {
        let mut stencils = vec![0.0f32; CELLS * unknowns.len];
        unknowns.for_spans(
            &mut stencils,
            CELLS,
            Assembly::default,
            |scratch, span, cells| scratch.assemble(colors, span, cells),
        );
        Self { unknowns, stencils }
    }

    /// The unknown pixels.
    pub fn unknowns(&self) -> &Unknowns {
        &self.unknowns
    }

    /// Values of the product of the matrix and a padded plane.
    fn times(&self, plane: &Padded, out: &mut [f32]) {
        self.unknowns.for_spans(
            out,
            1,
            || (),
            |(), span, out| {
                let stencils = &self.stencils[CELLS * span.start..][..CELLS * span.len];
                dispatch!(Vectors::new(), simd => apply(simd, stencils, span, plane, out));
            },
        );
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
        let unknowns = &self.unknowns;
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
        let mut scaled = vec![0.0f32; unknowns.len];
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
            for ((scaled, r), m) in scaled.iter_mut().zip(&residual).zip(&inverse) {
                *scaled = r * m;
            }
            let next = dot(&residual, &scaled);
            if next <= enough {
                break;
            }
            let momentum = (next / power) as f32;
            power = next;
            for (d, scaled) in direction.iter_mut().zip(&scaled) {
                *d = scaled + momentum * *d;
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

/// Sums that are independent of each other, for vectors; their number does not depend on the machine.
const PARTS: usize = 8;

fn dot(a: &[f32], b: &[f32]) -> f64 {
    let (a, b) = (a.as_chunks::<PARTS>(), b.as_chunks::<PARTS>());
    let mut sums = [0.0f64; PARTS];
    for (a, b) in a.0.iter().zip(b.0) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += f64::from(a * b);
        }
    }
    let rest: f64 = a.1.iter().zip(b.1).map(|(a, b)| f64::from(a * b)).sum();
    sums.iter().sum::<f64>() + rest
}

/// Pixels whose sums stay in registers.
const LANES: usize = 16;

/// The product of the stencils of a span and a plane.
#[inline(always)]
fn apply<S: Simd>(_simd: S, stencils: &[f32], span: Span, plane: &Padded, out: &mut [f32]) {
    let line = |cell: usize| {
        let from = (span.row + cell / 5) * plane.stride + span.col + cell % 5;
        let factors = &stencils[cell * span.len..][..span.len];
        (factors, &plane.values[from..][..span.len])
    };
    let whole = span.len / LANES * LANES;
    for start in (0..whole).step_by(LANES) {
        let mut sums = [0.0f32; LANES];
        for cell in 0..CELLS {
            let (factors, values) = line(cell);
            let (factors, values) = (&factors[start..][..LANES], &values[start..][..LANES]);
            for (sum, (factor, value)) in sums.iter_mut().zip(factors.iter().zip(values)) {
                *sum += factor * value;
            }
        }
        out[start..][..LANES].copy_from_slice(&sums);
    }
    let rest = &mut out[whole..];
    rest.fill(0.0);
    for cell in 0..CELLS {
        let (factors, values) = line(cell);
        let products = factors[whole..].iter().zip(&values[whole..]);
        for (out, (factor, value)) in rest.iter_mut().zip(products) {
            *out += factor * value;
        }
    }
}

/// Scratch space for the stencils of a span.
#[derive(Default)]
struct Assembly {
    around: Neighborhood,
    windows: Windows,
    factors: [Vec<f32>; 3],
}

impl Assembly {
    /// Adds the windows that contain the pixels of a span to its stencils.
    fn assemble(&mut self, colors: &Colors, span: Span, cells: &mut [f32]) {
        for line in &mut self.factors {
            line.resize(span.len.max(line.len()), 0.0);
        }
        for row in span.row.max(2) - 1..=span.row + 1 {
            if row + 1 >= colors.height() {
                continue;
            }
            self.around.fill(colors, row, span);
            self.windows.fill(&self.around, span, colors.width());
            // rows of the pixels of the window, relative to the first one of the stencil
            let first = row + BORDER - 1 - span.row;
            dispatch!(Vectors::new(), simd => self.add(simd, span, first, cells));
        }
    }

    /// Adds the windows of a row; the stencils hold its pixels from row `first`.
    #[inline(always)]
    fn add<S: Simd>(&mut self, _simd: S, span: Span, first: usize, cells: &mut [f32]) {
        let len = span.len;
        let own_row = BORDER - first;
        for shift in 0..3 {
            // the window around the pixel to the left, at, and to the right of the own one
            let mean = self
                .windows
                .mean
                .each_ref()
                .map(|line| &line[shift..][..len]);
            let inverse = self
                .windows
                .inverse
                .each_ref()
                .map(|line| &line[shift..][..len]);
            let is_inside = &self.windows.is_inside[shift..][..len];
            let own = self.around.lines[own_row]
                .each_ref()
                .map(|line| &line[BORDER..][..len]);
            let [fx, fy, fz] = self.factors.each_mut().map(|line| &mut line[..len]);
            for at in 0..len {
                let inverse = [
                    inverse[0][at],
                    inverse[1][at],
                    inverse[2][at],
                    inverse[3][at],
                    inverse[4][at],
                    inverse[5][at],
                ];
                let difference = [
                    own[0][at] - mean[0][at],
                    own[1][at] - mean[1][at],
                    own[2][at] - mean[2][at],
                ];
                let [x, y, z] = product(&inverse, difference);
                let scale = is_inside[at] * (1.0 / WINDOW_PIXELS as f32);
                [fx[at], fy[at], fz[at]] = [x * scale, y * scale, z * scale];
            }
            for row in 0..3 {
                for col in shift..shift + 3 {
                    let cell = (first + row) * 5 + col;
                    let is_own = row == own_row && col == BORDER;
                    let constant = if is_own { 1.0 } else { 0.0 } - 1.0 / 9.0;
                    let other = self.around.lines[row]
                        .each_ref()
                        .map(|line| &line[col..][..len]);
                    let out = &mut cells[cell * len..][..len];
                    for at in 0..len {
                        let product = fx[at] * (other[0][at] - mean[0][at])
                            + fy[at] * (other[1][at] - mean[1][at])
                            + fz[at] * (other[2][at] - mean[2][at]);
                        out[at] += constant * is_inside[at] - product;
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

    /// Mean and inverse covariance of the colors of a window.
    fn window(colors: &Colors, cells: &[(usize, usize)]) -> ([f64; 3], [f64; 6]) {
        let color = |at: (usize, usize)| colors[at].map(f64::from);
        let mean = [0, 1, 2].map(|c| cells.iter().map(|at| color(*at)[c] / 9.0).sum::<f64>());
        let entries = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|(a, b)| {
            let sum: f64 = cells
                .iter()
                .map(|at| (color(*at)[a] - mean[a]) * (color(*at)[b] - mean[b]) / 9.0)
                .sum();
            sum + if a == b { WINDOW_VARIANCE } else { 0.0 }
        });
        let (cofactors, determinant) = adjugate(entries);
        (mean, cofactors.map(|value| value / determinant))
    }

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
        let laplacian = MattingLaplacian::new(&colors, unknowns);
        let p = Plane::from_fn(size, |col, row| ((3 * col + 5 * row) % 7) as f32 / 7.0);
        let mut padded = Padded::new(size);
        padded.set(&p);
        let mut product = vec![0.0; laplacian.unknowns.len()];
        laplacian.times(&padded, &mut product);
        // the definition: in each window, what a linear function of the colors leaves of p
        let mut truth = vec![0.0f64; size.pixels()];
        for row in 1..size.height() - 1 {
            for col in 1..size.width() - 1 {
                let cells: Vec<(usize, usize)> = (row - 1..=row + 1)
                    .flat_map(|r| (col - 1..=col + 1).map(move |c| (c, r)))
                    .collect();
                let (mean, [xx, yy, zz, xy, xz, yz]) = window(&colors, &cells);
                let off =
                    |at: (usize, usize)| [0, 1, 2].map(|c| f64::from(colors[at][c]) - mean[c]);
                for i in &cells {
                    let [x, y, z] = off(*i);
                    let whitened = [
                        xx * x + xy * y + xz * z,
                        xy * x + yy * y + yz * z,
                        xz * x + yz * y + zz * z,
                    ];
                    for j in &cells {
                        let other = off(*j);
                        let product: f64 = (0..3).map(|c| whitened[c] * other[c]).sum();
                        let entry = f64::from(u8::from(i == j)) - (1.0 + product) / 9.0;
                        truth[i.1 * 9 + i.0] += entry * f64::from(p[*j]);
                    }
                }
            }
        }
        for (at, found) in laplacian.unknowns.positions().zip(&product) {
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
        let laplacian = MattingLaplacian::new(&colors, unknowns);
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
            MattingLaplacian::new(&colors, unknowns)
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
