//! Fourier transforms of planes of reals, for correlations.
//!
//! The plain idea: a correlation `c(u) = Σ a(x) · b(x + u)` over all shifts costs one product for each pair of pixels;
//! with transforms it is one product for each frequency, `conj(A) · B`.
//!
//! Departures from the textbook: rows are real, so half of their spectrum suffices; the spectrum is kept transposed, so
//! that both passes read memory in order; rows that are known to be zero are not transformed.
//!
//! [`Fourier::forward`] and [`Fourier::inverse`] serve large planes and share the work among threads;
//! [`Fourier::forward_with`] and [`Fourier::inverse_with`] serve many small ones, which threads take whole.
//!
//! Guarantees: the same bits on any number of threads. Does not guarantee: the same last bits on machines with other
//! vector units. Correlations are cyclic: who wants none of that pads.
//!
//! Cost: O(n log n) in single precision. Sizes are rounded up to products of 2, 3 and 5.

use rayon::prelude::*;
use realfft::num_complex::Complex32;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::sync::Arc;

/// The transforms of planes of one size.
///
/// ```
/// use ravec_numeric::Fourier;
///
/// // where a row of three values lies in a plane: the largest correlation
/// let fourier = Fourier::new(8, 4);
/// let mut plane = vec![0.0; fourier.width() * fourier.height()];
/// plane[fourier.width() + 5..][..3].copy_from_slice(&[1.0, -2.0, 3.0]);
/// let mut row = vec![0.0; fourier.width()];
/// row[..3].copy_from_slice(&[1.0, -2.0, 3.0]);
/// let mut sum = fourier.zero();
/// sum.add_correlation(&fourier.forward(row), &fourier.forward(plane), 1.0);
/// let found = fourier.inverse(sum);
/// assert!((found[fourier.width() + 5] - 14.0).abs() < 1e-4);
/// ```
pub struct Fourier {
    width: usize,
    height: usize,
    rows: Arc<dyn RealToComplex<f32>>,
    rows_back: Arc<dyn ComplexToReal<f32>>,
    columns: Arc<dyn Fft<f32>>,
    columns_back: Arc<dyn Fft<f32>>,
}

/// The spectrum of a plane: one line of `height` values for each of the `width / 2 + 1` horizontal frequencies.
#[derive(Clone)]
pub struct Spectrum(Vec<Complex32>);

impl Spectrum {
    /// The values, line after line.
    pub fn values(&self) -> &[Complex32] {
        &self.0
    }
}

/// Memory that a thread uses for one transform after another.
pub struct FourierScratch {
    /// Spectra of [`BLOCK`] rows.
    wide: Vec<Complex32>,
    /// Of the transforms of single lines.
    lines: Vec<Complex32>,
}

/// Lines that are transposed at a time: a block of as many columns stays in the cache.
const BLOCK: usize = 16;

impl Fourier {
    /// Transforms of planes of at least this size: both sides are rounded up to even products of 2, 3 and 5.
    pub fn new(width: usize, height: usize) -> Self {
        let (width, height) = (fast_len(width.max(2)), fast_len(height.max(2)));
        let (mut real, mut complex) = (RealFftPlanner::new(), FftPlanner::new());
        Self {
            width,
            height,
            rows: real.plan_fft_forward(width),
            rows_back: real.plan_fft_inverse(width),
            columns: complex.plan_fft_forward(height),
            columns_back: complex.plan_fft_inverse(height),
        }
    }

    /// Columns of the planes, even.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of the planes, even.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Horizontal frequencies of a spectrum: `width / 2 + 1`.
    pub fn bins(&self) -> usize {
        self.width / 2 + 1
    }

    /// The spectrum of zero.
    pub fn zero(&self) -> Spectrum {
        Spectrum(vec![Complex32::ZERO; self.bins() * self.height])
    }

    /// Memory for [`Fourier::forward_with`] and [`Fourier::inverse_with`].
    pub fn scratch(&self) -> FourierScratch {
        FourierScratch {
            wide: vec![Complex32::ZERO; BLOCK * self.bins()],
            lines: self.line_scratch(),
        }
    }

    fn line_scratch(&self) -> Vec<Complex32> {
        let longest = [
            self.rows.get_scratch_len(),
            self.rows_back.get_scratch_len(),
            self.columns.get_inplace_scratch_len(),
            self.columns_back.get_inplace_scratch_len(),
        ];
        vec![Complex32::ZERO; longest.into_iter().fold(0, usize::max)]
    }

    /// The spectrum of a plane whose first rows are `rows` (each [`Fourier::width`] long) and whose other rows are 0, on all
    /// threads of the pool.
    pub fn forward(&self, mut rows: Vec<f32>) -> Spectrum {
        let (bins, height) = (self.bins(), self.height);
        let given = rows.len() / self.width;
        let mut wide = vec![Complex32::ZERO; given * bins];
        wide.par_chunks_exact_mut(bins)
            .zip(rows.par_chunks_exact_mut(self.width))
            .with_min_len(8)
            .for_each_init(
                || self.line_scratch(),
                |scratch, (out, row)| self.row_forward(row, out, scratch),
            );
        let mut tall = vec![Complex32::ZERO; bins * height];
        tall.par_chunks_mut(height * BLOCK)
            .enumerate()
            .for_each_init(
                || self.line_scratch(),
                |scratch, (block, lines)| {
                    for (row, line) in wide.chunks_exact(bins).enumerate() {
                        let values = &line[block * BLOCK..];
                        for (column, &value) in lines.chunks_exact_mut(height).zip(values) {
                            column[row] = value;
                        }
                    }
                    self.columns.process_with_scratch(lines, scratch);
                },
            );
        Spectrum(tall)
    }

    /// The same on the calling thread: `spectrum`, of [`Fourier::bins`] × [`Fourier::height`] values in lines of a frequency,
    /// becomes that of the plane. `rows` is destroyed.
    pub fn forward_with(
        &self,
        rows: &mut [f32],
        spectrum: &mut [Complex32],
        scratch: &mut FourierScratch,
    ) {
        let (bins, height) = (self.bins(), self.height);
        let FourierScratch { wide, lines } = scratch;
        spectrum.fill(Complex32::ZERO);
        for (block, rows) in rows.chunks_mut(self.width * BLOCK).enumerate() {
            for (row, out) in rows
                .chunks_exact_mut(self.width)
                .zip(wide.chunks_exact_mut(bins))
            {
                self.row_forward(row, out, lines);
            }
            let count = rows.len() / self.width;
            for (bin, column) in spectrum.chunks_exact_mut(height).enumerate() {
                for (row, value) in column[block * BLOCK..][..count].iter_mut().enumerate() {
                    *value = wide[row * bins + bin];
                }
            }
        }
        self.columns.process_with_scratch(spectrum, lines);
    }

    /// The plane of a spectrum, [`Fourier::width`] × [`Fourier::height`], scaled so that it inverts [`Fourier::forward`], on
    /// all threads of the pool.
    pub fn inverse(&self, spectrum: Spectrum) -> Vec<f32> {
        let (height, width) = (self.height, self.width);
        let mut tall = spectrum.0;
        tall.par_chunks_mut(height * BLOCK).for_each_init(
            || self.line_scratch(),
            |scratch, lines| self.columns_back.process_with_scratch(lines, scratch),
        );
        let scale = 1.0 / (width * height) as f32;
        let mut plane = vec![0.0; width * height];
        plane
            .par_chunks_mut(width * BLOCK)
            .enumerate()
            .for_each_init(
                || self.scratch(),
                |scratch, (block, rows)| self.rows_inverse(&tall, block, rows, scale, scratch),
            );
        plane
    }

    /// The first rows of the plane of a spectrum on the calling thread, as many as `rows` holds. They are those of
    /// [`Fourier::inverse`] times the number of pixels: the caller scales. `spectrum` is destroyed.
    pub fn inverse_with(
        &self,
        spectrum: &mut [Complex32],
        rows: &mut [f32],
        scratch: &mut FourierScratch,
    ) {
        self.columns_back
            .process_with_scratch(spectrum, &mut scratch.lines);
        for (block, rows) in rows.chunks_mut(self.width * BLOCK).enumerate() {
            self.rows_inverse(spectrum, block, rows, 1.0, scratch);
        }
    }

    fn row_forward(&self, row: &mut [f32], out: &mut [Complex32], scratch: &mut [Complex32]) {
        self.rows
            .process_with_scratch(row, out, scratch)
            .expect("buffers have the lengths of the plan");
    }

    /// A block of rows from columns that are transformed, times `scale`.
    fn rows_inverse(
        &self,
        tall: &[Complex32],
        block: usize,
        rows: &mut [f32],
        scale: f32,
        scratch: &mut FourierScratch,
    ) {
        let bins = self.bins();
        let count = rows.len() / self.width;
        let FourierScratch { wide, lines } = scratch;
        for (bin, column) in tall.chunks_exact(self.height).enumerate() {
            for (row, &value) in column[block * BLOCK..][..count].iter().enumerate() {
                wide[row * bins + bin] = scale * value;
            }
        }
        for (row, line) in rows
            .chunks_exact_mut(self.width)
            .zip(wide.chunks_exact_mut(bins))
        {
            // real up to rounding, which the transform insists on
            line[0].im = 0.0;
            line[bins - 1].im = 0.0;
            self.rows_back
                .process_with_scratch(line, row, lines)
                .expect("the ends are real and buffers have the lengths of the plan");
        }
    }
}

impl Spectrum {
    /// Adds `factor` times the spectrum of the correlation `u ↦ Σ a(x) · b(x + u)`.
    pub fn add_correlation(&mut self, a: &Self, b: &Self, factor: f32) {
        self.0
            .par_iter_mut()
            .zip(&a.0)
            .zip(&b.0)
            .with_min_len(1 << 14)
            .for_each(|((sum, a), b)| *sum += a.conj() * b * factor);
    }
}

/// The smallest even product of 2, 3 and 5 that is at least `n`.
fn fast_len(n: usize) -> usize {
    let smooth = |mut m: usize| {
        for factor in [2, 3, 5] {
            while m.is_multiple_of(factor) {
                m /= factor;
            }
        }
        m == 1
    };
    (n.next_multiple_of(2)..)
        .step_by(2)
        .find(|&m| smooth(m))
        .expect("a power of two comes sooner or later")
}
