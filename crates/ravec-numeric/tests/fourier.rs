//! Transforms of planes against their definition.

#![cfg(feature = "fourier")]

use proptest::prelude::*;
use ravec_numeric::{Complex32, Fourier};

#[test]
fn lengths_are_rounded_up_to_even_products_of_small_factors() {
    let sides = |width, height| {
        let fourier = Fourier::new(width, height);
        (fourier.width(), fourier.height())
    };
    assert_eq!(sides(1, 7), (2, 8));
    assert_eq!(sides(97, 641), (100, 648));
}

proptest! {
    #[test]
    fn one_thread_and_many_transform_alike(values in prop::collection::vec(-1f32..1.0, 20 * 36)) {
        let fourier = Fourier::new(36, 40);
        let mut scratch = fourier.scratch();
        let mut spectrum = vec![Complex32::ZERO; fourier.bins() * fourier.height()];
        fourier.forward_with(&mut values.clone(), &mut spectrum, &mut scratch);
        let parallel = fourier.forward(values.clone());
        prop_assert_eq!(&spectrum, parallel.values());
        let mut rows = vec![0.0; 20 * 36];
        fourier.inverse_with(&mut spectrum, &mut rows, &mut scratch);
        let plane = fourier.inverse(parallel);
        for ((row, plane), value) in rows.iter().zip(&plane).zip(&values) {
            prop_assert!((row / 1440.0 - value).abs() < 1e-5 && (plane - value).abs() < 1e-5);
        }
    }

    #[test]
    fn a_correlation_is_its_definition(
        a in prop::collection::vec(-1f32..1.0, 12), b in prop::collection::vec(-1f32..1.0, 48)
    ) {
        let fourier = Fourier::new(8, 6);
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
