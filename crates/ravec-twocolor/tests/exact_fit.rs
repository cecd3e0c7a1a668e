//! The exact fit against its definition: all splits by enumeration, plain sums in f64.

use fearless_simd::Level;
use glam::DVec2;
use proptest::prelude::*;
use ravec_progress::Progress;
use ravec_raster::color::oklab_from_linear;
use ravec_raster::{Image, LinearRgb, LinearRgba, Size};
use ravec_twocolor::{FitParams, TwoColorField, TwoColorPixel, split_count};
use std::collections::HashSet;
use std::sync::OnceLock;

fn center(pixel: usize, side: usize) -> DVec2 {
    let half = 0.5 * (side as f64 - 1.0);
    DVec2::new((pixel % side) as f64 - half, (pixel / side) as f64 - half)
}

/// Every split of the block by a line, as a bit mask, found without the sweep: between two neighboring critical
/// directions the order of the projections is fixed, and every prefix of it is a split.
fn all_splits(side: usize) -> &'static [u64] {
    static SPLITS: [OnceLock<Vec<u64>>; 9] = [const { OnceLock::new() }; 9];
    SPLITS[side].get_or_init(|| {
        let mut angles: Vec<f64> = (0..side * side)
            .flat_map(|p| (0..side * side).map(move |q| (p, q)))
            .filter(|(p, q)| p != q)
            .map(|(p, q)| (center(p, side) - center(q, side)).perp().to_angle())
            .collect();
        angles.sort_by(f64::total_cmp);
        angles.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        angles.push(angles[0] + std::f64::consts::TAU);
        let full = u64::MAX >> (64 - side * side);
        let mut splits = HashSet::new();
        for pair in angles.windows(2) {
            let normal = DVec2::from_angle(0.5 * (pair[0] + pair[1]));
            let mut order: Vec<usize> = (0..side * side).collect();
            order.sort_by(|&p, &q| {
                normal
                    .dot(center(p, side))
                    .total_cmp(&normal.dot(center(q, side)))
            });
            let mut mask = 0u64;
            for &pixel in &order[..side * side - 1] {
                mask |= 1 << pixel;
                splits.insert(mask.min(full ^ mask));
            }
        }
        let mut splits: Vec<u64> = splits.into_iter().collect();
        splits.sort_unstable();
        splits
    })
}

/// Color, color weight and alpha of each pixel that lies inside the image.
type Block = Vec<Option<([f64; 3], f64)>>;

/// The least error of any split, and of one color.
fn best_error_naive(block: &Block, side: usize) -> (f64, f64) {
    let error_of = |mask: u64| {
        let mut error = 0.0;
        for wanted in [0, 1] {
            let members = || {
                (0..block.len())
                    .filter(|p| mask >> p & 1 == wanted)
                    .filter_map(|p| block[p])
            };
            let weight: f64 = members().map(|(_, alpha)| alpha).sum();
            let count = members().count() as f64;
            for c in 0..3 {
                let mean = members()
                    .map(|(color, alpha)| alpha * color[c])
                    .sum::<f64>()
                    / weight.max(1e-12);
                error += members()
                    .map(|(color, alpha)| alpha * (color[c] - mean).powi(2))
                    .sum::<f64>();
            }
            error += members()
                .map(|(_, alpha)| (alpha - weight / count.max(1.0)).powi(2))
                .sum::<f64>();
        }
        error
    };
    let best = all_splits(side)
        .iter()
        .map(|&mask| error_of(mask))
        .fold(f64::MAX, f64::min);
    (best, error_of(0))
}

fn params(side: usize) -> FitParams {
    FitParams {
        block_px: side,
        flat_contrast: 0.0,
        ..FitParams::default()
    }
}

fn fit(image: &Image<LinearRgba>, side: usize) -> TwoColorField {
    TwoColorField::fit(image, &params(side), &Progress::none()).unwrap()
}

fn block_of(image: &Image<LinearRgba>, side: usize, col: usize, row: usize) -> Block {
    (0..side * side)
        .map(|p| image.get(col * side + p % side, row * side + p / side))
        .map(|pixel| {
            pixel.map(|c| {
                (
                    oklab_from_linear(c.rgb()).map(f64::from),
                    f64::from(c.alpha()),
                )
            })
        })
        .collect()
}

/// The error of a two-color pixel, recomputed from its line and colors.
fn error_of(pixel: &TwoColorPixel, block: &Block, side: usize) -> f64 {
    let mut error = 0.0;
    for (p, member) in block.iter().enumerate() {
        let Some((color, alpha)) = member else {
            continue;
        };
        let on_1 = pixel
            .line
            .is_some_and(|line| line.signed_distance(center(p, side)) > 0.0);
        let (mean, mean_alpha) = (
            pixel.colors[usize::from(on_1)].0,
            pixel.alphas[usize::from(on_1)],
        );
        error += (0..3)
            .map(|c| alpha * (color[c] - f64::from(mean[c])).powi(2))
            .sum::<f64>();
        error += (alpha - f64::from(mean_alpha)).powi(2);
    }
    error
}

/// Every block of the image has the error of the best split, and its line and colors really give that error.
fn assert_exact(image: &Image<LinearRgba>, side: usize) {
    let field = fit(image, side);
    for row in 0..field.grid_size().height() {
        for col in 0..field.grid_size().width() {
            let block = block_of(image, side, col, row);
            let (best, one_color) = best_error_naive(&block, side);
            let inside = block.iter().flatten().count() as f64;
            let pixel = field.block(col, row);
            // the running sums of the sweep lose a few units in the last place of the block's whole energy, and taking
            // off the mean loses one of the largest value in each pixel
            let largest = block
                .iter()
                .flatten()
                .map(|(color, _)| color[0].abs())
                .fold(0.0, f64::max);
            let eps = f64::from(f32::EPSILON);
            let tolerance =
                4e-6 * one_color + 4.0 * eps * largest * (inside * one_color).sqrt() + 1e-9;
            let reported = f64::from(pixel.error) * inside;
            assert!(
                (reported - best).abs() <= tolerance,
                "N = {side}, ({col}, {row}): {reported} for {best}"
            );
            let actual = error_of(pixel, &block, side);
            assert!(
                (actual - best).abs() <= tolerance,
                "N = {side}, ({col}, {row}): {actual} for {best}"
            );
        }
    }
}

fn opaque(side: usize, linear: impl Fn(usize) -> [f32; 3]) -> Image<LinearRgba> {
    Image::from_fn(Size::new(side, side).unwrap(), |col, row| {
        LinearRgba::from_rgb_alpha(linear(row * side + col), 1.0)
    })
}

#[test]
fn enumeration_and_sweep_count_the_same_splits() {
    for side in 2..=8 {
        assert_eq!(all_splits(side).len(), split_count(side), "N = {side}");
    }
}

#[test]
fn constant_tied_and_adversarial_blocks_are_fitted_exactly() {
    for side in 2..=8 {
        let n = side * side;
        assert_exact(&opaque(side, |_| [0.3, 0.6, 0.1]), side);
        // checkerboard: every line is equally bad in many ways
        assert_exact(
            &opaque(side, |p| [((p % side + p / side) % 2) as f32; 3]),
            side,
        );
        // a single odd pixel, everywhere
        for odd in 0..n {
            assert_exact(
                &opaque(side, |p| [if p == odd { 0.9 } else { 0.2 }; 3]),
                side,
            );
        }
        // a ramp: all splits along one direction nearly tie
        assert_exact(
            &opaque(side, |p| [(p % side) as f32 / side as f32, 0.5, 0.5]),
            side,
        );
        // the three channels want different lines
        assert_exact(
            &opaque(side, |p| {
                [
                    (p % side >= side / 2) as u8 as f32,
                    (p / side >= side / 2) as u8 as f32,
                    0.5,
                ]
            }),
            side,
        );
        // values far beyond white
        assert_exact(
            &opaque(side, |p| [if p * 7 % 5 > 2 { 1000.0 } else { 900.0 }; 3]),
            side,
        );
    }
}

#[test]
fn every_split_is_recovered_from_the_block_it_makes() {
    for side in 2..=8 {
        for &mask in all_splits(side) {
            let image = opaque(side, |p| {
                if mask >> p & 1 == 1 {
                    [0.8, 0.1, 0.1]
                } else {
                    [0.1, 0.1, 0.5]
                }
            });
            let pixel = *fit(&image, side).block(0, 0);
            let line = pixel.line.unwrap();
            let found: u64 = (0..side * side)
                .map(|p| u64::from(line.signed_distance(center(p, side)) < 0.0) << p)
                .sum();
            let full = u64::MAX >> (64 - side * side);
            assert_eq!(found.min(found ^ full), mask, "N = {side}");
            // the difference of two energies in f32
            assert!(pixel.error < 4e-6 * pixel.contrast().powi(2));
        }
    }
}

#[test]
fn all_instruction_sets_give_the_same_bits_on_any_number_of_threads() {
    let mut state = 1u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let image = Image::from_fn(Size::new(150, 37).unwrap(), |_, _| {
        LinearRgb([random(), random(), random()])
    });
    for side in [2, 5, 8, 16] {
        let reference =
            TwoColorField::fit_with(Level::baseline(), &image, &params(side), &Progress::none())
                .unwrap();
        let best = TwoColorField::fit_with(Level::new(), &image, &params(side), &Progress::none())
            .unwrap();
        assert_eq!(best, reference);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .unwrap();
        let single =
            pool.install(|| TwoColorField::fit(&image, &params(side), &Progress::none()).unwrap());
        assert_eq!(single, reference);
    }
}

#[test]
fn a_transparent_side_keeps_its_alpha_and_the_other_its_color() {
    let image = Image::from_fn(Size::new(8, 8).unwrap(), |col, _| {
        if col < 3 {
            LinearRgba([0.9, 0.1, 0.1, 1.0])
        } else {
            LinearRgba([0.0, 1.0, 0.0, 0.0])
        }
    });
    let pixel = *fit(&image, 8).block(0, 0);
    let mut alphas = pixel.alphas;
    alphas.sort_by(f32::total_cmp);
    assert_eq!(alphas, [0.0, 1.0]);
    let visible = usize::from(pixel.alphas[1] > 0.5);
    for (found, planted) in pixel.colors[visible]
        .0
        .into_iter()
        .zip(oklab_from_linear([0.9, 0.1, 0.1]))
    {
        assert!((found - planted).abs() < 1e-5);
    }
}

#[test]
fn a_fully_transparent_picture_is_flat_and_invisible() {
    let image = Image::new(Size::new(9, 5).unwrap(), LinearRgba([0.3, 0.2, 0.1, 0.0]));
    for pixel in fit(&image, 4).blocks() {
        assert!(pixel.is_flat());
        assert_eq!(pixel.alphas, [0.0; 2]);
        assert_eq!(pixel.error, 0.0);
    }
}

#[test]
fn a_block_larger_than_the_picture_holds_the_picture() {
    let image = Image::from_fn(Size::new(3, 2).unwrap(), |col, row| {
        LinearRgba([(col + row) as f32 / 3.0, 0.2, 0.2, 1.0])
    });
    assert_exact(&image, 8);
    assert_exact(
        &Image::new(Size::new(1, 1).unwrap(), LinearRgba([0.5, 0.4, 0.3, 1.0])),
        8,
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn random_pictures_are_fitted_exactly(
        side in 2usize..=8,
        width in 1usize..20,
        height in 1usize..20,
        levels in 1u32..64,
        transparent in any::<bool>(),
        seed in any::<u32>(),
    ) {
        let mut state = seed | 1;
        let mut random = || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            // few levels make many ties
            (state % (levels + 1)) as f32 / levels as f32
        };
        let image = Image::from_fn(Size::new(width, height).unwrap(), |_, _| {
            LinearRgba([random(), random(), random(), if transparent { random() } else { 1.0 }])
        });
        assert_exact(&image, side);
    }
}
