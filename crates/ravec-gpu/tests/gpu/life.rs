//! Devices that are lost, refused, shared, cancelled or watched.

use crate::pictures::glass;
use crate::{ADAPTER, gpu, open};
use ravec_gpu::{
    DeviceChoice, Gpu, GpuError, OpenOptions, RenderStyle, adapters, clean, fit, render_field,
};
use ravec_progress::Progress;
use ravec_raster::{Image, Rect, Size, Srgb};
use ravec_twocolor::{
    CleanParams, FitError, FitParams, NoiseLevel, TwoColorField, clean_with, render_to,
};

#[test]
fn a_lost_device_leaves_the_rest_to_the_cpu() {
    let Some(gpu) = open() else { return };
    let image = Image::from_fn(Size::new(2600, 2600).unwrap(), |col, row| {
        Srgb([(col * 7) as u8, (row * 5) as u8, (col + row) as u8])
    });
    let params = FitParams {
        block_px: 4,
        ..FitParams::default()
    };
    let expected = TwoColorField::fit(&image, &params, &Progress::none()).unwrap();
    // the device is destroyed by another thread, at some moment of the work
    let found = std::thread::scope(|scope| {
        let work = scope.spawn(|| fit(&gpu, &image, &params, &Progress::none()));
        std::thread::sleep(std::time::Duration::from_millis(150));
        gpu.destroy();
        work.join().unwrap().unwrap()
    });
    assert_eq!(found, expected);
    assert!(gpu.is_lost());
    // before, during or after the work: what is asked next is done as well
    gpu.take_warnings();
    let small = glass(40, 40);
    let expected = TwoColorField::fit(&small, &params, &Progress::none()).unwrap();
    assert_eq!(
        fit(&gpu, &small, &params, &Progress::none()).unwrap(),
        expected
    );
}

#[test]
fn a_device_that_is_lost_while_it_cleans_leaves_the_rest_to_the_cpu() {
    let Some(gpu) = open() else { return };
    let image = Image::from_fn(Size::new(450, 900).unwrap(), |col, row| {
        Srgb([(col * 7) as u8, (row * 5) as u8, (col + row) as u8])
    });
    let whole = Rect::of(image.size());
    let (noise, params) = (NoiseLevel::uniform(8.0), CleanParams::default());
    let none = Progress::none();
    let expected = clean_with(&image, whole, &noise, &params, &none).unwrap();
    let found = std::thread::scope(|scope| {
        let work = scope.spawn(|| clean(&gpu, &image, whole, &noise, &params, &none));
        std::thread::sleep(std::time::Duration::from_millis(150));
        gpu.destroy();
        work.join().unwrap().unwrap()
    });
    assert!(found == expected);
}

#[test]
fn a_device_that_is_lost_before_the_work_starts_causes_no_error() {
    let Some(gpu) = open() else { return };
    gpu.destroy();
    let image = glass(64, 48);
    let expected = TwoColorField::fit(&image, &FitParams::default(), &Progress::none()).unwrap();
    let found = fit(&gpu, &image, &FitParams::default(), &Progress::none()).unwrap();
    assert_eq!(found, expected);
}

#[test]
fn cancelled_work_stops() {
    let Some(gpu) = gpu() else { return };
    let progress = Progress::none();
    progress.cancel();
    let found = fit(gpu, &glass(64, 48), &FitParams::default(), &progress);
    assert!(matches!(found, Err(FitError::Cancelled(_))));
    // and the next work is not disturbed
    assert!(
        fit(
            gpu,
            &glass(64, 48),
            &FitParams::default(),
            &Progress::none()
        )
        .is_ok()
    );
}

#[test]
fn threads_share_a_device() {
    let Some(gpu) = gpu() else { return };
    let fields: Vec<TwoColorField> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..4)
            .map(|k| {
                scope.spawn(move || {
                    let image = glass(60 + k, 50);
                    fit(gpu, &image, &FitParams::default(), &Progress::none()).unwrap()
                })
            })
            .collect();
        workers
            .into_iter()
            .map(|worker| worker.join().unwrap())
            .collect()
    });
    for (k, field) in fields.iter().enumerate() {
        let image = glass(60 + k, 50);
        let expected = TwoColorField::fit(&image, &FitParams::default(), &Progress::none());
        assert_eq!(*field, expected.unwrap());
    }
}

#[test]
fn software_is_never_taken_without_its_name() {
    let found = adapters();
    assert!(
        Gpu::open(&DeviceChoice::Cpu, OpenOptions::default())
            .unwrap()
            .is_none()
    );
    let error = Gpu::open(
        &DeviceChoice::Named("no such adapter".to_owned()),
        OpenOptions::default(),
    );
    assert!(matches!(error, Err(GpuError::NoAdapter { .. })));
    if found.iter().all(|adapter| adapter.is_software) {
        assert!(
            Gpu::open(&DeviceChoice::Auto, OpenOptions::default())
                .unwrap()
                .is_none()
        );
        let error = Gpu::open(&DeviceChoice::Gpu, OpenOptions::default()).unwrap_err();
        let text = error.to_string();
        assert!(
            found.iter().all(|adapter| text.contains(&adapter.name)),
            "{text}"
        );
    }
    if let Some(gpu) = gpu() {
        assert!(gpu.adapter().is_software && gpu.adapter().name.contains(ADAPTER));
    }
}

#[test]
fn what_does_not_fit_the_device_is_done_by_the_cpu() {
    let Some(gpu) = open() else { return };
    // one pixel of the rendering needs all blocks, more than a binding holds
    let size = Size::new(3600, 3600).unwrap();
    let image = Image::from_fn(size, |col, row| {
        Srgb([(col / 3) as u8, (row / 5) as u8, 90])
    });
    let params = FitParams {
        block_px: 2,
        ..FitParams::default()
    };
    let field = TwoColorField::fit(&image, &params, &Progress::none()).unwrap();
    let one = Size::new(1, 1).unwrap();
    let found = render_field(&gpu, &field, one, RenderStyle::TwoColors, &Progress::none());
    let expected = render_to(&field, one, &Progress::none());
    assert_eq!(found.unwrap(), expected.unwrap());
    let warnings = gpu.take_warnings();
    assert!(
        warnings.len() == 1 && warnings[0].contains("memory"),
        "{warnings:?}"
    );
    // the device is still good for what fits
    assert!(!gpu.is_lost());
    let small = render_field(
        &gpu,
        &field,
        size,
        RenderStyle::TwoColors,
        &Progress::none(),
    );
    assert!(small.is_ok() && gpu.take_warnings().is_empty());
}
