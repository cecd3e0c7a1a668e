//! Fourier transforms of planes of reals, for correlations.
//!
//! The plain idea: a correlation `c(u) = Σ a(x) · b(x + u)` over all shifts costs one product for each pair of pixels;
//! with transforms it is one product for each frequency, `conj(A) · B`.
//!
//! Departures from the textbook: rows are real, so half of their spectrum suffices; the spectrum is kept transposed, so
//! that both passes read memory in order; rows that are known to be zero are not transformed.
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
pub(crate) struct Fourier {
    width: usize,
    height: usize,
    rows: Arc<dyn RealToComplex<f32>>,
    rows_back: Arc<dyn ComplexToReal<f32>>,
    columns: Arc<dyn Fft<f32>>,
    columns_back: Arc<dyn Fft<f32>>,
}

/// The spectrum of a plane: one line of `height` values for each of the `width / 2 + 1` horizontal frequencies.
#[derive(Clone)]
pub(crate) struct Spectrum(Vec<Complex32>);

/// Lines that one task transposes at a time: a block of as many columns stays in the cache.
const BLOCK: usize = 16;

impl Fourier {
    /// Transforms of planes of at least this size.
    pub(crate) fn new(width: usize, height: usize) -> Self {
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
    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Rows of the planes.
    pub(crate) fn height(&self) -> usize {
        self.height
    }

    fn bins(&self) -> usize {
        self.width / 2 + 1
    }

    /// The spectrum of zero.
    pub(crate) fn zero(&self) -> Spectrum {
        Spectrum(vec![Complex32::ZERO; self.bins() * self.height])
    }

    /// The spectrum of a plane whose first rows are `rows` (each [`Fourier::width`] long) and whose other rows are 0.
    pub(crate) fn forward(&self, mut rows: Vec<f32>) -> Spectrum {
        let (bins, height) = (self.bins(), self.height);
        let given = rows.len() / self.width;
        let mut wide = vec![Complex32::ZERO; given * bins];
        wide.par_chunks_exact_mut(bins)
            .zip(rows.par_chunks_exact_mut(self.width))
            .with_min_len(8)
            .for_each_init(
                || self.rows.make_scratch_vec(),
                |scratch, (out, row)| {
                    self.rows
                        .process_with_scratch(row, out, scratch)
                        .expect("buffers have the lengths of the plan");
                },
            );
        let mut tall = vec![Complex32::ZERO; bins * height];
        tall.par_chunks_mut(height * BLOCK)
            .enumerate()
            .for_each_init(
                || vec![Complex32::ZERO; self.columns.get_inplace_scratch_len()],
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

    /// The plane of a spectrum, [`Fourier::width`] × [`Fourier::height`], scaled so that it inverts
    /// [`Fourier::forward`].
    pub(crate) fn inverse(&self, spectrum: Spectrum) -> Vec<f32> {
        let (bins, height, width) = (self.bins(), self.height, self.width);
        let mut tall = spectrum.0;
        tall.par_chunks_mut(height * BLOCK).for_each_init(
            || vec![Complex32::ZERO; self.columns_back.get_inplace_scratch_len()],
            |scratch, lines| self.columns_back.process_with_scratch(lines, scratch),
        );
        let scale = 1.0 / (width * height) as f32;
        let mut plane = vec![0.0; width * height];
        plane
            .par_chunks_mut(width * BLOCK)
            .enumerate()
            .for_each_init(
                || {
                    let wide = vec![Complex32::ZERO; bins * BLOCK];
                    (wide, self.rows_back.make_scratch_vec())
                },
                |(wide, scratch), (block, rows)| {
                    let count = rows.len() / width;
                    for (bin, column) in tall.chunks_exact(height).enumerate() {
                        for (row, &value) in column[block * BLOCK..][..count].iter().enumerate() {
                            wide[row * bins + bin] = scale * value;
                        }
                    }
                    for (row, line) in rows
                        .chunks_exact_mut(width)
                        .zip(wide.chunks_exact_mut(bins))
                    {
                        // real up to rounding, which the transform insists on
                        line[0].im = 0.0;
                        line[bins - 1].im = 0.0;
                        self.rows_back
                            .process_with_scratch(line, row, scratch)
                            .expect("the ends are real and buffers have the lengths of the plan");
                    }
                },
            );
        plane
    }
}

impl Spectrum {
    /// Adds `factor` times the spectrum of the correlation `u ↦ Σ a(x) · b(x + u)`.
    pub(crate) fn add_correlation(&mut self, a: &Self, b: &Self, factor: f32) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lengths_are_rounded_up_to_small_factors() {
        assert_eq!(
            [1, 7, 97, 641].map(|n| fast_len(n.max(2))),
            [2, 8, 100, 648]
        );
    }

    proptest! {
        #[test]
        fn a_correlation_is_its_definition(
            a in prop::collection::vec(-1f32..1.0, 12), b in prop::collection::vec(-1f32..1.0, 48)
        ) {
            let fourier = Fourier::new(8, 6);
            prop_assert_eq!((fourier.width(), fourier.height()), (8, 6));
            // three columns and four rows of `a`
            let mut small = vec![0.0; 4 * 8];
            for (at, &value) in a.iter().enumerate() {
                small[at / 3 * 8 + at % 3] = value;
            }
            let mut sum = fourier.zero();
            let (sa, sb) = (fourier.forward(small.clone()), fourier.forward(b.clone()));
            sum.add_correlation(&sa, &sb, 2.0);
            let found = fourier.inverse(sum);
            for v in 0..6 {
                for u in 0..8 {
                    let mut truth = 0.0;
                    for y in 0..4 {
                        for x in 0..8 {
                            truth += small[y * 8 + x] * b[(y + v) % 6 * 8 + (x + u) % 8];
                        }
                    }
                    // rounding of a transform of 48 values below 1
                    prop_assert!((found[v * 8 + u] - 2.0 * truth).abs() < 1e-4);
                }
            }
        }
    }
}
