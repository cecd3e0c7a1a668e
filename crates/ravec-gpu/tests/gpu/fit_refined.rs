//! Fields that are fitted and refined with one upload are those of both steps.

use crate::pictures::{glass, scenes};
use crate::{gpu, open};
use ravec_gpu::{FITTED_SIDES, Gpu, GpuPixel, fit, fit_refined, refine_lines};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgb, Size, Srgb, with_image};
use ravec_twocolor::{FitError, FitMethod, FitParams, TwoColorField};

fn of_side(block_px: usize) -> FitParams {
    FitParams {
        block_px,
        ..FitParams::default()
    }
}

fn one_after_the_other<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    params: &FitParams,
) -> TwoColorField {
    let mut field = fit(gpu, image, params, &Progress::none()).unwrap();
    refine_lines(gpu, &mut field, image, &Progress::none()).unwrap();
    field
}

fn assert_equal<P: GpuPixel>(name: &str, image: &Image<P>, params: &FitParams) {
    let Some(gpu) = gpu() else { return };
    let expected = one_after_the_other(gpu, image, params);
    let found = fit_refined(gpu, image, params, &Progress::none()).unwrap();
    assert!(!gpu.is_lost(), "{:?}", gpu.take_warnings());
    assert!(found == expected, "{name}, {} px", params.block_px);
}

#[test]
fn all_scenes_and_methods() {
    for (name, image) in scenes(99, 70) {
        let image: Image<Srgb<u8>> = image.convert();
        assert_equal(name, &image, &of_side(8));
    }
    let (name, image) = scenes(96, 72).next().unwrap();
    let coarse = FitParams {
        method: FitMethod::CoarseToFine,
        ..of_side(8)
    };
    with_image!(&image, image => assert_equal(name, image, &coarse));
    for side in FITTED_SIDES.into_iter().chain([32]) {
        with_image!(&image, image => assert_equal(name, image, &of_side(side)));
    }
}

#[test]
fn transparency_borders_and_values_that_are_no_numbers() {
    for (width, height) in [(1, 1), (3, 2), (7, 9), (65, 24), (101, 67)] {
        let mut image = glass(width, height);
        assert_equal("glass", &image, &of_side(8));
        image[(width / 2, height / 2)].0[0] = f32::NAN;
        assert_equal("no number", &image, &of_side(8));
        assert_equal("opaque", &image.convert::<LinearRgb>(), &of_side(4));
    }
}

#[test]
fn bands_are_joined() {
    let small = glass(250, 200).convert::<Srgb<u8>>();
    // more than 4 million pixels
    let image = Image::from_fn(Size::new(2500, 1800).unwrap(), |col, row| {
        small[(col % 250, row % 200)]
    });
    assert_equal("bands", &image, &of_side(4));
}

#[test]
fn a_lost_device_leaves_the_rest_to_the_cpu() {
    let Some(gpu) = open() else { return };
    gpu.destroy();
    let image = glass(120, 90);
    let params = of_side(8);
    let mut expected = TwoColorField::fit(&image, &params, &Progress::none()).unwrap();
    expected.refine_lines(&image, &Progress::none()).unwrap();
    let found = fit_refined(&gpu, &image, &params, &Progress::none()).unwrap();
    assert_eq!(found, expected);
}

#[test]
fn a_device_that_is_lost_in_the_middle_leaves_whole_bands_to_the_cpu() {
    let Some(gpu) = open() else { return };
    let image = Image::from_fn(Size::new(2600, 2600).unwrap(), |col, row| {
        Srgb([(col * 7) as u8, (row * 5) as u8, (col + row) as u8])
    });
    let params = of_side(4);
    let mut on_cpu = TwoColorField::fit(&image, &params, &Progress::none()).unwrap();
    on_cpu.refine_lines(&image, &Progress::none()).unwrap();
    let found = std::thread::scope(|scope| {
        let work = scope.spawn(|| fit_refined(&gpu, &image, &params, &Progress::none()));
        std::thread::sleep(std::time::Duration::from_millis(300));
        gpu.destroy();
        work.join().unwrap().unwrap()
    });
    // bands of the device have lines that differ by what single precision leaves
    let pairs = on_cpu.blocks().iter().zip(found.blocks());
    let far = pairs.filter(|(cpu, gpu)| match (cpu.line, gpu.line) {
        (Some(cpu), Some(gpu)) => (cpu.offset_px - gpu.offset_px).abs() > 0.01,
        (cpu, gpu) => cpu.is_some() != gpu.is_some(),
    });
    assert!(far.count() < on_cpu.blocks().len() / 25);
}

#[test]
fn cancelled_work_stops() {
    let Some(gpu) = gpu() else { return };
    let progress = Progress::none();
    progress.cancel();
    let found = fit_refined(gpu, &glass(64, 48), &of_side(8), &progress);
    assert!(matches!(found, Err(FitError::Cancelled(_))));
}
