//! Orthonormal Legendre polynomials, integrated over pixels.
//!
//! On a side of a tile, which is mapped to [−1, 1], the functions are `sqrt(2k + 1) P_k`: orthonormal for the mean over the
//! side. A picture is constant on each of its pixels, so the coefficient of a function is the sum of the pixels' values, each
//! times the integral of the function over the pixel; that integral has a closed form, `(P_{k+1} − P_{k−1}) / (2k + 1)`.
//! Nothing is resampled, and a side may begin and end within a pixel.
//!
//! Guarantees: coefficients are exact projections up to rounding. Cost: pixels × functions for each side.

/// The weights of the pixels along one side of a tile, for a few functions.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Axis {
    /// The first pixel that the side touches.
    pub first: usize,
    /// Functions.
    pub functions: usize,
    /// For each pixel the weights of all functions.
    weights: Vec<f32>,
}

impl Axis {
    /// Polynomials up to `degree` and then the means of `count` equal parts, of the side from `begin` to `end`, in pixels of
    /// a picture with `pixels` of them.
    pub fn polynomials_and_parts(
        (begin, end): (f64, f64),
        pixels: usize,
        degree: usize,
        count: usize,
    ) -> Self {
        Self::integrated(begin, end, pixels, degree + 1 + count, |t, into| {
            let (polynomials, parts) = into.split_at_mut(degree + 1);
            integrals(t, polynomials);
            means(t, parts);
        })
    }

    /// The means of `count` equal parts of the side.
    pub fn parts(begin: f64, end: f64, pixels: usize, count: usize) -> Self {
        Self::integrated(begin, end, pixels, count, means)
    }

    fn integrated(
        begin: f64,
        end: f64,
        pixels: usize,
        functions: usize,
        antiderivative: impl Fn(f64, &mut [f64]),
    ) -> Self {
        let first = (begin.max(0.0).floor() as usize).min(pixels - 1);
        let last = (end.ceil() as usize).clamp(first + 1, pixels);
        let side = end - begin;
        let mut weights = Vec::with_capacity((last - first) * functions);
        let (mut from, mut to) = (vec![0.0; functions], vec![0.0; functions]);
        antiderivative(-1.0, &mut from);
        for pixel in first..last {
            // the border pixels go on to the ends of the side, whatever rounding made of these
            let t = if pixel + 1 == last {
                1.0
            } else {
                (2.0 * ((pixel + 1) as f64 - begin) / side - 1.0).clamp(-1.0, 1.0)
            };
            antiderivative(t, &mut to);
            weights.extend(
                to.iter()
                    .zip(&from)
                    .map(|(to, from)| ((to - from) / 2.0) as f32),
            );
            std::mem::swap(&mut from, &mut to);
        }
        Self {
            first,
            functions,
            weights,
        }
    }

    /// The weights of each pixel from [`first`](Self::first) on, where the number of functions is known in advance.
    ///
    /// # Panics
    /// If there are not as many functions.
    pub fn pixels_of<const FUNCTIONS: usize>(&self) -> &[[f32; FUNCTIONS]] {
        assert_eq!(self.functions, FUNCTIONS, "functions of this axis");
        self.weights.as_chunks().0
    }

    /// The weights of each pixel from [`first`](Self::first) on.
    pub fn pixels(&self) -> impl ExactSizeIterator<Item = &[f32]> {
        self.weights.chunks_exact(self.functions)
    }
}

/// The antiderivatives at `t` of what gives the mean of each of some equal parts.
fn means(t: f64, into: &mut [f64]) {
    let count = into.len() as f64;
    let border = |part: usize| 2.0 * part as f64 / count - 1.0;
    for (part, into) in into.iter_mut().enumerate() {
        *into = count * t.clamp(border(part), border(part + 1));
    }
}

/// The antiderivatives of the normalized polynomials at `t`, one for each place of `into`.
fn integrals(t: f64, into: &mut [f64]) {
    // P_{k-1} and P_k, by the recurrence of Bonnet
    let (mut before, mut here) = (1.0, t);
    for (k, integral) in into.iter_mut().enumerate() {
        let k = k as f64;
        if k == 0.0 {
            *integral = t;
            continue;
        }
        let next = ((2.0 * k + 1.0) * t * here - k * before) / (k + 1.0);
        *integral = (2.0 * k + 1.0).sqrt() * (next - before) / (2.0 * k + 1.0);
        (before, here) = (here, next);
    }
}

/// Number of products of two polynomials with a total degree of at most `degree`.
pub(crate) fn products(degree: usize) -> usize {
    (degree + 1) * (degree + 2) / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_functions_are_orthonormal_on_fine_pixels() {
        let axis = Axis::polynomials_and_parts((3.25, 1003.25), 1010, 6, 0);
        for a in 0..=6 {
            for b in 0..=6 {
                let product: f64 = axis
                    .pixels()
                    .map(|weights| 1000.0 * f64::from(weights[a]) * f64::from(weights[b]))
                    .sum();
                let truth = f64::from(u8::from(a == b));
                // within a pixel of a thousandth the polynomials are averaged, and they are steep at the ends
                assert!((product - truth).abs() < 5e-3, "{a} {b}: {product}");
            }
        }
    }

    #[test]
    fn a_side_within_one_pixel_has_a_mean_and_nothing_else() {
        let axis = Axis::polynomials_and_parts((4.25, 4.5), 9, 3, 0);
        let weights: Vec<_> = axis.pixels().collect();
        assert_eq!((axis.first, weights.len()), (4, 1));
        assert_eq!(weights[0][0], 1.0);
        assert!(weights[0][1..].iter().all(|weight| weight.abs() < 1e-7));
    }

    #[test]
    fn halves_share_the_pixel_in_the_middle() {
        let axis = Axis::parts(0.0, 3.0, 3, 2);
        let weights: Vec<f32> = axis.pixels().flatten().copied().collect();
        let third = 1.0 / 3.0;
        for (found, truth) in weights
            .iter()
            .zip([2.0 * third, 0.0, third, third, 0.0, 2.0 * third])
        {
            assert!((found - truth).abs() < 1e-6, "{weights:?}");
        }
    }
}
