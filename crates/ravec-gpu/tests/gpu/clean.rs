//! Cleaned pictures of the device are those of the CPU, bit for bit.

use crate::gpu;
use crate::pictures::{glass, scenes};
use ravec_gpu::{GpuPixel, clean};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Rect, Srgb, with_image};
use ravec_twocolor::{CleanParams, NoiseLevel, clean_with, estimate_noise};

fn assert_identical<P: GpuPixel>(
    name: &str,
    image: &Image<P>,
    region: Rect,
    noise: &NoiseLevel,
    params: &CleanParams,
) {
    let Some(gpu) = gpu() else { return };
    let progress = Progress::none();
    let on_cpu = clean_with(image, region, noise, params, &progress).unwrap();
    let on_gpu = clean(gpu, image, region, noise, params, &progress).unwrap();
    assert!(!gpu.is_lost(), "{:?}", gpu.take_warnings());
    assert_eq!(on_cpu.size(), on_gpu.size(), "{name}");
    let bits = |image: &Image<LinearRgba>| -> Vec<u32> {
        let samples = image.pixels().iter().flat_map(|pixel| pixel.0);
        samples.map(f32::to_bits).collect()
    };
    let pairs = bits(&on_cpu).into_iter().zip(bits(&on_gpu));
    let different = pairs.filter(|(cpu, gpu)| cpu != gpu).count();
    assert_eq!(different, 0, "{name}, {params:?}: samples that differ");
}

/// Adds what a sensor or a codec would, so that there is something to clean.
fn noisy(image: &Image<Srgb<u8>>) -> Image<Srgb<u8>> {
    Image::from_fn(image.size(), |col, row| {
        let noise = |c: usize| ((col * 7919 + row * 104_729 + col * row * 31 + c * 57) % 31) as i32;
        let pixel = image[(col, row)].0;
        Srgb(std::array::from_fn(|c| {
            (i32::from(pixel[c]) + noise(c) - 15).clamp(0, 255) as u8
        }))
    })
}

#[test]
fn all_scenes_with_their_own_noise() {
    for (name, image) in scenes(97, 70) {
        let image = noisy(&image.convert());
        let noise = estimate_noise(&image, &Progress::none()).unwrap();
        let whole = Rect::of(image.size());
        assert_identical(name, &image, whole, &noise, &CleanParams::default());
    }
}

#[test]
fn windows_strides_and_noise_of_all_kinds() {
    let image = glass(61, 45);
    for (window_px, stride_px) in [(4, 1), (4, 3), (8, 1), (8, 3), (8, 8), (16, 5)] {
        let params = CleanParams {
            window_px,
            stride_px,
            ..CleanParams::default()
        };
        for sigma in [0.0, 0.5, 12.0, 255.0] {
            let noise = NoiseLevel::uniform(sigma);
            assert_identical("glass", &image, Rect::of(image.size()), &noise, &params);
        }
    }
}

#[test]
fn parts_small_pictures_and_values_that_are_no_numbers() {
    let noise = NoiseLevel::uniform(9.0);
    let params = CleanParams::default();
    for (width, height) in [(1, 1), (2, 30), (40, 1), (9, 8)] {
        let image = glass(width, height);
        assert_identical("small", &image, Rect::of(image.size()), &noise, &params);
    }
    let mut image = glass(70, 60);
    image[(10, 11)].0[0] = f32::NAN;
    image[(40, 30)].0[2] = 2e9;
    for region in [
        Rect::new(0, 0, 70, 60),
        Rect::new(13, 7, 31, 40),
        Rect::new(69, 59, 1, 1),
    ] {
        assert_identical("part", &image, region, &noise, &params);
    }
}

#[test]
fn traces_of_compression_are_bounded_as_on_the_cpu() {
    let (_, scene) = scenes(160, 120).next().unwrap();
    // blocks of 8 with one value each are the traces of the strongest compression
    let image: Image<Srgb<u8>> = scene.convert();
    let blocky = Image::from_fn(image.size(), |col, row| image[(col / 8 * 8, row / 8 * 8)]);
    let noise = estimate_noise(&blocky, &Progress::none()).unwrap();
    let whole = Rect::of(image.size());
    with_image!(&scene, scene => {
        assert_identical("scene", scene, whole, &noise, &CleanParams::default());
    });
    assert_identical("blocky", &blocky, whole, &noise, &CleanParams::default());
}
