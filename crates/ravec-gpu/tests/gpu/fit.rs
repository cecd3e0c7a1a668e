//! Fields of the device are those of the CPU, bit for bit.

use crate::gpu;
use crate::pictures::{glass, scenes};
use ravec_gpu::{COARSE_TO_FINE_SIDES, FITTED_SIDES, GpuPixel, fit};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgb, LinearRgba, Size, Srgb, Srgba, with_image};
use ravec_twocolor::{FitMethod, FitParams, TwoColorField};

fn of_side(block_px: usize) -> FitParams {
    FitParams {
        block_px,
        ..FitParams::default()
    }
}

fn coarse_to_fine(block_px: usize) -> FitParams {
    FitParams {
        method: FitMethod::CoarseToFine,
        ..of_side(block_px)
    }
}

fn assert_identical<P: GpuPixel>(name: &str, image: &Image<P>, params: &FitParams) {
    let Some(gpu) = gpu() else { return };
    let on_cpu = TwoColorField::fit(image, params, &Progress::none()).unwrap();
    let on_gpu = fit(gpu, image, params, &Progress::none()).unwrap();
    assert!(!gpu.is_lost(), "{:?}", gpu.take_warnings());
    let pairs = on_cpu.blocks().iter().zip(on_gpu.blocks());
    let different = pairs.filter(|(cpu, gpu)| cpu != gpu).count();
    assert_eq!(
        different,
        0,
        "{name}, {} px: of {} blocks",
        params.block_px,
        on_cpu.blocks().len()
    );
    // sizes that are compared, too
    assert_eq!(on_cpu, on_gpu);
}

#[test]
fn all_scenes_in_blocks_of_all_sides() {
    for (name, image) in scenes(163, 117) {
        let image: Image<Srgb<u8>> = image.convert();
        for side in FITTED_SIDES {
            assert_identical(name, &image, &of_side(side));
        }
    }
}

#[test]
fn all_pixel_types() {
    let (_, street) = scenes(96, 72).next().unwrap();
    for side in [4, 8] {
        let params = of_side(side);
        assert_identical("8 bit", &street.convert::<Srgb<u8>>(), &params);
        assert_identical("16 bit", &street.convert::<Srgb<u16>>(), &params);
        assert_identical("floats", &street.convert::<LinearRgb>(), &params);
        let glass = glass(96, 72);
        assert_identical("8 bit with alpha", &glass.convert::<Srgba<u8>>(), &params);
        assert_identical("16 bit with alpha", &glass.convert::<Srgba<u16>>(), &params);
        assert_identical("floats with alpha", &glass.convert::<LinearRgba>(), &params);
    }
}

#[test]
fn all_remainders_of_the_size() {
    for (width, height) in [
        (1, 1),
        (1, 40),
        (3, 2),
        (7, 9),
        (8, 8),
        (9, 33),
        (40, 1),
        (65, 24),
    ] {
        let image = glass(width, height);
        for side in FITTED_SIDES {
            assert_identical("glass", &image, &of_side(side));
            assert_identical("opaque", &image.convert::<Srgb<u8>>(), &of_side(side));
        }
    }
}

#[test]
fn sprites_with_alpha_in_all_scenes() {
    for (name, image) in scenes(57, 40) {
        with_image!(&image, image => assert_identical(name, image, &of_side(16)));
    }
}

#[test]
fn values_that_are_no_numbers() {
    let mut image = glass(48, 48).convert::<LinearRgb>();
    let mut transparent = glass(48, 48);
    for (at, value) in [
        ((3, 4), f32::NAN),
        ((20, 9), f32::INFINITY),
        ((33, 40), f32::NEG_INFINITY),
        ((40, 12), 2e9),
        ((8, 30), -7.0),
    ] {
        image[at].0[1] = value;
        transparent[at].0[2] = value;
        transparent[(at.1, at.0)].0[3] = value;
    }
    for side in FITTED_SIDES {
        assert_identical("opaque", &image, &of_side(side));
        assert_identical("transparent", &transparent, &of_side(side));
    }
}

#[test]
fn flat_pictures_and_other_contrasts() {
    let flat = Image::new(Size::new(40, 24).unwrap(), Srgb([13u8, 200, 77]));
    assert_identical("flat", &flat, &of_side(8));
    let (_, street) = scenes(96, 72).next().unwrap();
    for flat_contrast in [0.0, 0.05, 1.0] {
        let params = FitParams {
            flat_contrast,
            ..of_side(8)
        };
        assert_identical("street", &street.convert::<Srgb<u8>>(), &params);
    }
}

#[test]
fn coarse_to_fine_in_all_scenes() {
    for (name, image) in scenes(139, 100) {
        for side in COARSE_TO_FINE_SIDES {
            with_image!(&image, image => assert_identical(name, image, &coarse_to_fine(side)));
        }
    }
}

#[test]
fn coarse_to_fine_at_borders_transparency_and_values_that_are_no_numbers() {
    for (width, height) in [(1, 1), (1, 130), (66, 3), (64, 64), (129, 65), (100, 40)] {
        let image = glass(width, height);
        for side in COARSE_TO_FINE_SIDES {
            assert_identical("glass", &image, &coarse_to_fine(side));
            let opaque = image.convert::<Srgb<u8>>();
            assert_identical("opaque", &opaque, &coarse_to_fine(side));
        }
    }
    let mut image = glass(150, 140);
    image[(30, 20)].0[0] = f32::NAN;
    image[(90, 100)].0[1] = 2e9;
    image[(100, 30)].0[3] = f32::INFINITY;
    for flat_contrast in [0.0, 0.2] {
        for side in COARSE_TO_FINE_SIDES {
            let params = FitParams {
                flat_contrast,
                ..coarse_to_fine(side)
            };
            assert_identical("no numbers", &image, &params);
        }
    }
}

#[test]
fn large_blocks_are_fitted_coarse_to_fine() {
    let Some(gpu) = gpu() else { return };
    let image = glass(256, 192);
    let auto = fit(gpu, &image, &of_side(32), &Progress::none()).unwrap();
    let chosen = fit(gpu, &image, &coarse_to_fine(32), &Progress::none()).unwrap();
    assert!(!gpu.is_lost(), "{:?}", gpu.take_warnings());
    assert_eq!(auto, chosen);
}

#[test]
fn ten_runs_are_equal() {
    let Some(gpu) = gpu() else { return };
    let image = glass(120, 90);
    let run = || fit(gpu, &image, &of_side(8), &Progress::none()).unwrap();
    let first = run();
    for _ in 1..10 {
        assert_eq!(run(), first);
    }
}

#[test]
fn a_picture_of_many_bands_is_fitted_band_by_band() {
    // 4.3 million pixels of 16 bytes take two bands of at most 64 MiB
    let small = glass(250, 200);
    let image = Image::from_fn(Size::new(2500, 1720).unwrap(), |col, row| {
        small[(col % 250, row % 200)]
    });
    assert_identical("bands", &image, &of_side(4));
    assert_identical("bands", &image, &of_side(64));
}
