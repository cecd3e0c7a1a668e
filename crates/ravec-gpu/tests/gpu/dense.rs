//! The operator on the device and on the CPU.

use crate::gpu;
use crate::pictures::{glass, scenes};
use ravec_gpu::{GpuPixel, operate_on};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgb, LinearRgba, Rect, Srgb, Srgba};
use ravec_twocolor::{Mode, OperatorParams, operate};

const MODES: [Mode; 4] = [Mode::Abstract, Mode::Smooth, Mode::Sharpen, Mode::Antialias];

fn of(mode: Mode, window_px: usize) -> OperatorParams {
    OperatorParams {
        mode,
        window_px,
        ..OperatorParams::default()
    }
}

/// Number of pixels that are not the same bits, and the largest difference of the rest.
fn differences(a: &Image<LinearRgba>, b: &Image<LinearRgba>) -> (usize, f32) {
    assert_eq!(a.size(), b.size());
    let pairs = || a.pixels().iter().zip(b.pixels());
    let bits = |pixel: &LinearRgba| pixel.0.map(f32::to_bits);
    let different = pairs().filter(|(a, b)| bits(a) != bits(b)).count();
    let largest =
        pairs()
            .flat_map(|(a, b)| a.0.into_iter().zip(b.0))
            .fold(0.0f32, |most, (a, b)| {
                // what is no number must be none on both
                assert_eq!(a.is_finite(), b.is_finite());
                if a.is_finite() {
                    most.max((a - b).abs())
                } else {
                    most
                }
            });
    (different, largest)
}

fn compare<P: GpuPixel>(image: &Image<P>, region: Rect, params: &OperatorParams) -> (usize, f32) {
    let Some(gpu) = gpu() else { return (0, 0.0) };
    let on_cpu = operate(image, region, params, &Progress::none()).unwrap();
    let on_gpu = operate_on(gpu, image, region, params, &Progress::none()).unwrap();
    assert!(!gpu.is_lost(), "{:?}", gpu.take_warnings());
    differences(&on_cpu, &on_gpu)
}

#[test]
fn all_modes_keep_their_bounds_on_all_scenes() {
    for (name, image) in scenes(57, 43) {
        let image: Image<Srgb<u8>> = image.convert();
        for mode in MODES {
            let (different, largest) = compare(&image, Rect::of(image.size()), &of(mode, 5));
            let bound = if matches!(mode, Mode::Abstract | Mode::Smooth) {
                0.0
            } else {
                1e-4
            };
            assert!(
                largest <= bound,
                "{name} {mode:?}: {different} by up to {largest}"
            );
        }
    }
}

#[test]
fn windows_of_nine_and_regions() {
    let (_, street) = scenes(120, 90).next().unwrap();
    let image: Image<Srgb<u16>> = street.convert();
    for region in [
        Rect::of(image.size()),
        Rect::new(13, 7, 50, 31),
        Rect::new(100, 80, 90, 90),
    ] {
        for mode in [Mode::Abstract, Mode::Smooth] {
            let found = compare(&image, region, &of(mode, 9));
            assert!(found.1 <= 1e-5, "{mode:?} {region:?}: {found:?}");
        }
    }
}

#[test]
fn transparency_strength_and_iterations() {
    let image = glass(70, 50);
    let whole = Rect::of(image.size());
    for mode in MODES {
        let params = OperatorParams {
            strength: 0.6,
            iterations: 3,
            ..of(mode, 5)
        };
        let found = compare(&image, whole, &params);
        // differences of one iteration may move the splits of the next
        let bound = if matches!(mode, Mode::Abstract | Mode::Smooth) {
            1e-5
        } else {
            5e-3
        };
        assert!(found.1 <= bound, "{mode:?}: {found:?}");
        let rgba: Image<Srgba<u8>> = image.convert();
        let found = compare(&rgba, Rect::new(20, 11, 33, 21), &of(mode, 5));
        assert!(found.1 <= 1e-4, "{mode:?}: {found:?}");
    }
}

#[test]
fn values_that_are_no_numbers_stay() {
    let mut image = glass(40, 30).convert::<LinearRgb>();
    image[(12, 9)].0[0] = f32::NAN;
    image[(30, 20)].0[1] = f32::INFINITY;
    let found = compare(&image, Rect::of(image.size()), &of(Mode::Smooth, 5));
    assert!(found.1 <= 1e-5, "{found:?}");
}
