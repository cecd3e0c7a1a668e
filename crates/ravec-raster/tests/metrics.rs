//! The figures of a comparison against plain definitions in double precision.

use proptest::prelude::*;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{
    Image, LinearRgb, LinearRgba, MetricError, Size, Srgb, Srgba, compare, compare_with_progress,
    delta_e_map, psnr_db, ssim_map,
};

fn noise(width: usize, height: usize, seed: u32) -> Image<Srgb<u8>> {
    let value = |n: usize| ((n as u32 + seed).wrapping_mul(2_654_435_761) >> 24) as u8;
    Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
        Srgb([0, 1, 2].map(|channel| value(3 * (row * width + col) + channel)))
    })
}

/// A picture and one that differs from it by a few steps.
fn pair(width: usize, height: usize, seed: u32) -> (Image<Srgb<u8>>, Image<Srgb<u8>>) {
    let (a, b) = (noise(width, height, seed), noise(width, height, seed + 7));
    let near = Image::from_fn(a.size(), |col, row| {
        let (x, y) = (a[(col, row)].0, b[(col, row)].0);
        Srgb([0, 1, 2].map(|i| (f32::from(x[i]) * 0.9 + f32::from(y[i]) * 0.1) as u8))
    });
    (a, near)
}

/// 10 log10(255² / mean squared error) of the bytes.
fn psnr_naive(a: &Image<Srgb<u8>>, b: &Image<Srgb<u8>>) -> f64 {
    let differences = a.pixels().iter().zip(b.pixels());
    let squares: f64 = differences
        .flat_map(|(a, b)| a.0.into_iter().zip(b.0))
        .map(|(a, b)| (f64::from(a) - f64::from(b)).powi(2))
        .sum();
    10.0 * (255.0f64.powi(2) / (squares / (3 * a.pixels().len()) as f64)).log10()
}

/// Mean SSIM of the bytes' luma by the double loop, over all pixels whose windows lie in the picture if there are any.
fn ssim_naive(a: &Image<Srgb<u8>>, b: &Image<Srgb<u8>>) -> f64 {
    let luma = |image: &Image<Srgb<u8>>, col: isize, row: isize| {
        let [r, g, b] = image.clamped(col, row).0.map(f64::from);
        0.299 * r + 0.587 * g + 0.114 * b
    };
    let bell = |i: isize, j: isize| (-((i * i + j * j) as f64) / 4.5).exp();
    let (c1, c2) = ((0.01f64 * 255.0).powi(2), (0.03f64 * 255.0).powi(2));
    let (w, h) = (a.width() as isize, a.height() as isize);
    let margin = if w > 10 && h > 10 { 5 } else { 0 };
    let (mut sum, mut count) = (0.0, 0.0);
    for row in margin..h - margin {
        for col in margin..w - margin {
            let [mut n, mut mx, mut my, mut xx, mut yy, mut xy] = [0.0; 6];
            for (i, j) in (-5..=5).flat_map(|j| (-5..=5).map(move |i| (i, j))) {
                let (x, y) = (luma(a, col + i, row + j), luma(b, col + i, row + j));
                let weight = bell(i, j);
                n += weight;
                mx += weight * x;
                my += weight * y;
                xx += weight * x * x;
                yy += weight * y * y;
                xy += weight * x * y;
            }
            let [mx, my, xx, yy, xy] = [mx, my, xx, yy, xy].map(|v| v / n);
            sum += (2.0 * mx * my + c1) * (2.0 * (xy - mx * my) + c2)
                / ((mx * mx + my * my + c1) * (xx - mx * mx + yy - my * my + c2));
            count += 1.0;
        }
    }
    sum / count
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn psnr_and_ssim_agree_with_their_definitions((w, h) in (1usize..30, 1usize..30), seed in 0u32..1000) {
        let (a, b) = pair(w, h, seed);
        let found = compare(&a, &b).unwrap();
        if a == b {
            prop_assert!(found.identical && found.psnr_db == f64::INFINITY);
        } else {
            // encoded values come back from linear light within 3e-7, one step is 4e-3
            prop_assert_eq!(psnr_db(&a, &b).unwrap(), found.psnr_db);
            prop_assert!((found.psnr_db - psnr_naive(&a, &b)).abs() < 2e-3);
        }
        prop_assert!((found.ssim - ssim_naive(&a, &b)).abs() < 1e-4);
    }

    #[test]
    fn the_maps_hold_what_the_figures_sum_up((w, h) in (11usize..30, 11usize..90), seed in 0u32..1000) {
        let (a, b) = pair(w, h, seed);
        let found = compare(&a, &b).unwrap();
        let mut delta_e: Vec<f64> = delta_e_map(&a, &b).unwrap().pixels().iter().map(|&v| f64::from(v)).collect();
        let mean = delta_e.iter().sum::<f64>() / delta_e.len() as f64;
        // each entry of the map is rounded to f32
        prop_assert!((found.delta_e_mean - mean).abs() <= 1e-6 * mean);
        delta_e.sort_by(f64::total_cmp);
        prop_assert_eq!(found.delta_e_p95, delta_e[(delta_e.len() * 19).div_ceil(20) - 1]);
        prop_assert!((found.delta_e_max - delta_e[delta_e.len() - 1]).abs() <= 1e-6 * found.delta_e_max);
        let similarity = ssim_map(&a, &b).unwrap().crop(5, 5, Size::new(w - 10, h - 10).unwrap()).unwrap();
        let mean = similarity.pixels().iter().map(|&v| f64::from(v)).sum::<f64>() / similarity.pixels().len() as f64;
        prop_assert!((found.ssim - mean).abs() < 1e-12);
    }
}

#[test]
fn a_picture_does_not_differ_from_itself() {
    for image in [noise(1, 1, 0), noise(40, 70, 1)] {
        let found = compare(&image, &image).unwrap();
        assert!(found.identical);
        assert_eq!((found.psnr_db, found.ssim), (f64::INFINITY, 1.0));
        assert_eq!(
            (found.delta_e_max, found.max_abs, found.alpha_max_abs),
            (0.0, 0.0, 0.0)
        );
        // the same picture in another pixel type is the same picture
        assert!(
            compare(&image, &image.convert::<LinearRgb>())
                .unwrap()
                .identical
        );
    }
}

#[test]
fn one_pixel_in_a_thousand_shows_in_the_maximum_and_not_in_the_95th_percentile() {
    let black = Image::new(Size::new(40, 25).unwrap(), Srgb([0u8; 3]));
    let mut spot = black.clone();
    spot[(20, 12)] = Srgb([255; 3]);
    let found = compare(&black, &spot).unwrap();
    assert_eq!(found.delta_e_p95, 0.0);
    // single precision Lab of white
    assert!((found.delta_e_max - 100.0).abs() < 1e-3);
    assert!((found.delta_e_mean - 0.1).abs() < 1e-6);
    assert!((found.max_abs - 1.0).abs() < 1e-6);
    // one of a thousand pixels is off by the whole range
    assert!((found.psnr_db - 30.0).abs() < 1e-4);
}

#[test]
fn transparency_is_compared_in_front_of_middle_gray_and_reported() {
    let size = Size::new(12, 12).unwrap();
    let white = Image::new(size, Srgba([255u8, 255, 255, 255]));
    let glass = Image::new(size, Srgba([255u8, 255, 255, 0]));
    let found = compare(&white, &glass).unwrap();
    assert_eq!(found.alpha_max_abs, 1.0);
    assert!((found.max_abs - 0.5).abs() < 1e-6);
    // the color of what is not seen does not count as a difference that is seen
    let other = Image::new(size, Srgba([0u8, 99, 0, 0]));
    let found = compare(&glass, &other).unwrap();
    assert_eq!((found.psnr_db, found.identical), (f64::INFINITY, false));
}

#[test]
fn what_is_no_number_or_beyond_white_still_gives_figures() {
    let size = Size::new(12, 12).unwrap();
    let odd = Image::new(size, LinearRgba([f32::NAN, f32::INFINITY, -3.0, f32::NAN]));
    let plain = Image::new(size, LinearRgba([0.0, 1.0, 0.0, 0.0]));
    let found = compare(&odd, &plain).unwrap();
    assert_eq!(
        (found.psnr_db, found.ssim, found.identical),
        (f64::INFINITY, 1.0, false)
    );
    assert!(compare(&odd, &odd).unwrap().identical);
}

#[test]
fn pictures_of_different_sizes_are_refused() {
    let (a, b) = (noise(3, 4, 0), noise(4, 3, 0));
    let error = MetricError::Sizes {
        left: a.size(),
        right: b.size(),
    };
    assert_eq!(compare(&a, &b), Err(error));
    assert_eq!(ssim_map(&a, &b), Err(error));
    assert_eq!(delta_e_map(&a, &b), Err(error));
    assert_eq!(
        error.to_string(),
        "pictures of 3 x 4 and 4 x 3 pixels cannot be compared: resize or crop one of them"
    );
}

#[test]
fn a_cancelled_comparison_says_so() {
    let progress = Progress::none();
    progress.cancel();
    let image = noise(20, 20, 0);
    let found = compare_with_progress(&image, &image, &progress);
    assert_eq!(found, Err(MetricError::Cancelled(Cancelled)));
}

#[test]
fn one_thread_and_many_give_the_same_bits() {
    let (a, b) = pair(37, 300, 5);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| compare(&a, &b).unwrap())
    };
    assert_eq!(on(1), on(4));
}
