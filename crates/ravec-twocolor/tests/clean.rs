//! Noise that is found, pictures without noise, and compression that a file says.

use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Rect, Sample as _, Size, Srgb};
use ravec_twocolor::{
    BlockQuantization, CleanParams, NoiseLevel, clean, estimate_noise, estimate_noise_of_compressed,
};

/// Random numbers with a nearly normal distribution of deviation 1.
struct Random(u32);

impl Random {
    fn even(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 24) as f32
    }

    fn normal(&mut self) -> f32 {
        (0..12).map(|_| self.even()).sum::<f32>() - 6.0
    }
}

fn wave(col: usize, row: usize) -> f32 {
    let (x, y) = (col as f32, row as f32);
    125.0 + 45.0 * (0.031 * x).sin() + 30.0 * (0.023 * y + 0.01 * x).cos()
}

/// 1 on paper and 0 on the strokes of something like letters, with smooth edges.
fn letters(col: usize, row: usize) -> f32 {
    let (x, y) = (col as f32 % 9.0 - 4.0, row as f32 % 14.0 - 6.0);
    let kind = (col / 9 * 7 + row / 14 * 3) % 4;
    let bar = (x + 2.0).abs() - 0.6;
    let bow = ((x * x + y * y).sqrt() - 3.0).abs() - 0.6;
    let slash = (x - 0.4 * y).abs() - 0.5;
    let stroke = match kind {
        0 => bar.min(bow),
        1 => bow,
        2 => slash.min(bar),
        _ => 1.0,
    };
    if y.abs() > 5.0 {
        1.0
    } else {
        stroke.clamp(0.0, 1.0)
    }
}

fn eight_bit(size: [usize; 2], color: impl FnMut(usize, usize) -> [f32; 3]) -> Image<Srgb<u8>> {
    let mut color = color;
    Image::from_fn(Size::new(size[0], size[1]).unwrap(), |col, row| {
        Srgb(color(col, row).map(|v| u8::from_unit(v / 255.0)))
    })
}

fn noise_of(image: &Image<Srgb<u8>>) -> NoiseLevel {
    estimate_noise(image, &Progress::none()).unwrap()
}

fn cleaned(image: &Image<Srgb<u8>>) -> Image<Srgb<u8>> {
    let whole = Rect::of(image.size());
    let params = CleanParams::default();
    let cleaned: Image<LinearRgba> = clean(image, whole, &params, &Progress::none()).unwrap();
    cleaned.convert()
}

fn largest_difference(a: &Image<Srgb<u8>>, b: &Image<Srgb<u8>>) -> u8 {
    let pairs = a.pixels().iter().zip(b.pixels());
    pairs
        .flat_map(|(a, b)| (0..3).map(|c| a.0[c].abs_diff(b.0[c])))
        .max()
        .unwrap()
}

#[test]
fn text_without_noise_stays_as_it_is() {
    for (ink, paper) in [
        ([0.0; 3], [255.0; 3]),
        ([200.0, 30.0, 60.0], [250.0, 245.0, 230.0]),
    ] {
        for size in [[400, 300], [64, 64]] {
            let page = eight_bit(size, |col, row| {
                let share = letters(col, row);
                std::array::from_fn(|c| ink[c] + share * (paper[c] - ink[c]))
            });
            assert_eq!(noise_of(&page).typical(), 0.0);
            assert_eq!(cleaned(&page), page);
        }
    }
}

#[test]
fn text_over_a_gradient_stays_nearly_as_it_is() {
    let page = eight_bit([400, 300], |col, row| {
        let paper = 40.0 + 0.45 * col as f32;
        [paper, 0.8 * paper, 255.0 - paper].map(|v| v * letters(col, row))
    });
    assert!(noise_of(&page).typical() < 0.5);
    assert!(largest_difference(&cleaned(&page), &page) <= 3);
}

#[test]
fn clean_text_over_a_noisy_picture_stays_while_the_noise_goes() {
    let mut random = Random(5);
    let is_page = |col: usize, row: usize| (60..340).contains(&col) && (50..190).contains(&row);
    let picture = eight_bit([480, 400], |col, row| {
        let noisy: [f32; 3] = std::array::from_fn(|_| wave(col, row) + 6.0 * random.normal());
        if is_page(col, row) {
            noisy.map(|v| v * letters(col, row))
        } else {
            noisy
        }
    });
    let noise = noise_of(&picture).typical();
    assert!((5.0..7.5).contains(&noise), "{noise}");
    let result = cleaned(&picture);
    let (mut strokes, mut error, mut pixels) = (0u8, 0.0, 0);
    for row in 0..400 {
        for col in 0..480 {
            let value = result[(col, row)].0[1];
            if is_page(col, row) && letters(col, row) == 0.0 {
                strokes = strokes.max(value);
            } else if !is_page(col, row) {
                error += (f32::from(value) - wave(col, row)).powi(2);
                pixels += 1;
            }
        }
    }
    assert!(strokes < 40, "{strokes}");
    let error = (error / pixels as f32).sqrt();
    assert!(error < 2.0, "{error}");
}

#[test]
fn the_noise_of_a_sample_is_found_in_gray_and_in_color() {
    for sigma in [5.0, 20.0] {
        let mut random = Random(1);
        let gray = eight_bit([512, 384], |col, row| {
            [wave(col, row) + sigma * random.normal(); 3]
        });
        let color = eight_bit([512, 384], |col, row| {
            std::array::from_fn(|_| wave(col, row) + sigma * random.normal())
        });
        for image in [gray, color] {
            let found = noise_of(&image).typical();
            assert!((found / sigma - 1.0).abs() < 0.06, "{found} of {sigma}");
        }
    }
}

#[test]
fn the_compression_that_a_file_says_is_believed_if_it_matters() {
    // nothing in these pixels shows a compression
    let mut random = Random(3);
    let image = eight_bit([200, 160], |col, row| {
        [wave(col, row) + 2.0 * random.normal(); 3]
    });
    assert!(!noise_of(&image).is_compressed());
    for (step, matters) in [(2, false), (10, true), (90, true)] {
        let known = BlockQuantization {
            steps: [[step; 8]; 8],
            grid: [3, 0],
        };
        let noise = estimate_noise_of_compressed(&image, &known, &Progress::none()).unwrap();
        assert_eq!(noise.is_compressed(), matters, "{step}");
    }
}

#[test]
fn regions_of_thin_and_of_wide_pictures_have_the_bits_of_the_whole() {
    let params = CleanParams {
        noise_sigma: Some(9.0),
        ..CleanParams::default()
    };
    let mut random = Random(7);
    for size in [
        [70_000, 1],
        [1, 5_000],
        [40_000, 2],
        [2, 3_000],
        [40_000, 5],
        [7, 900],
    ] {
        let image = eight_bit(size, |col, row| {
            std::array::from_fn(|_| wave(col, row) + 9.0 * random.normal())
        });
        let of = |region| clean(&image, region, &params, &Progress::none()).unwrap();
        let whole = of(Rect::of(image.size()));
        let part = Rect::new(
            size[0] / 3,
            size[1] / 3,
            size[0].div_ceil(2),
            size[1].div_ceil(2),
        );
        let found = of(part);
        for row in 0..found.height() {
            for col in 0..found.width() {
                let expected = whole[(part.col + col, part.row + row)];
                assert_eq!(found[(col, row)], expected, "{size:?}");
            }
        }
        // and they are cleaned
        let error = |image: &Image<LinearRgba>| -> f32 {
            let pixels = image.convert::<Srgb<u8>>();
            let width = pixels.width();
            let errors =
                pixels.pixels().iter().enumerate().map(|(at, pixel)| {
                    (f32::from(pixel.0[0]) - wave(at % width, at / width)).powi(2)
                });
            errors.sum::<f32>() / pixels.pixels().len() as f32
        };
        assert!(error(&whole) < 0.6 * 81.0, "{size:?}: {}", error(&whole));
    }
}
