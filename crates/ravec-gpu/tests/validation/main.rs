//! The validation layers of Vulkan stay silent while every kernel runs. Needs the software driver and the layers (Debian's
//! mesa-vulkan-drivers and vulkan-validationlayers); without them nothing is tested, and a line says so.

#[path = "../gpu/pictures.rs"]
mod pictures;

use glam::dvec2;
use ravec_gpu::{
    DeviceChoice, Gpu, GpuError, OpenOptions, RenderStyle, clean, fit, operate_on, refine_lines,
    render_field, warp_deformed, warp_homography,
};
use ravec_planar::{Beyond, Homography};
use ravec_progress::Progress;
use ravec_raster::{Image, PremulLinearRgba, Rect, Size, Srgb, Srgba};
use ravec_retarget::{Painted, RetargetParams, Retargeter};
use ravec_twocolor::{CleanParams, FitParams, Mode, NoiseLevel, OperatorParams};
use std::sync::Mutex;

/// Messages of drivers and layers.
static MESSAGES: Mutex<Vec<String>> = Mutex::new(Vec::new());

struct Catcher;

impl log::Log for Catcher {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.level() <= log::Level::Warn
    }

    fn log(&self, record: &log::Record<'_>) {
        if self.enabled(record.metadata()) {
            let text = format!("{} {}: {}", record.level(), record.target(), record.args());
            MESSAGES.lock().unwrap().push(text);
        }
    }

    fn flush(&self) {}
}

#[test]
fn every_kernel_is_valid() {
    log::set_logger(&Catcher).unwrap();
    log::set_max_level(log::LevelFilter::Warn);
    let options = OpenOptions { validation: true };
    let gpu = match Gpu::open(&DeviceChoice::Named("llvmpipe".to_owned()), options) {
        Ok(Some(gpu)) => gpu,
        Ok(None) | Err(GpuError::NoAdapter { .. }) => {
            eprintln!("SKIPPED: no software driver for Vulkan; install mesa-vulkan-drivers");
            return;
        }
        Err(error) => panic!("{error}"),
    };
    if MESSAGES
        .lock()
        .unwrap()
        .iter()
        .any(|text| text.contains("unable to find layer"))
    {
        eprintln!("SKIPPED: no validation layers; install vulkan-validationlayers");
        return;
    }
    let none = Progress::none();
    let glass = pictures::glass(61, 43);
    let street = pictures::scenes(61, 43)
        .next()
        .map(|(_, street)| street)
        .unwrap();
    let image: Image<Srgb<u8>> = street.convert();
    let with_alpha: Image<Srgba<u16>> = glass.convert();

    let mut field = fit(&gpu, &with_alpha, &FitParams::default(), &none).unwrap();
    refine_lines(&gpu, &mut field, &with_alpha, &none).unwrap();
    let large = FitParams {
        block_px: 32,
        ..FitParams::default()
    };
    fit(&gpu, &with_alpha, &large, &none).unwrap();
    let whole = Rect::of(image.size());
    let noise = NoiseLevel::uniform(5.0);
    clean(&gpu, &image, whole, &noise, &CleanParams::default(), &none).unwrap();
    for style in [RenderStyle::TwoColors, RenderStyle::Mosaic] {
        render_field(&gpu, &field, Size::new(90, 50).unwrap(), style, &none).unwrap();
    }
    let operator = OperatorParams {
        mode: Mode::Smooth,
        window_px: 5,
        ..OperatorParams::default()
    };
    operate_on(&gpu, &image, whole, &operator, &none).unwrap();
    let retargeter = Retargeter::new(
        &image,
        Painted::default(),
        &RetargetParams::default(),
        &none,
    )
    .unwrap();
    let deformation = retargeter.solve(Size::new(40, 43).unwrap()).unwrap();
    warp_deformed(&gpu, &deformation, &image, &none).unwrap();
    let light: Image<PremulLinearRgba> = glass.convert();
    let map = Homography::from_scale(dvec2(9.0, 7.0)).unwrap();
    warp_homography(
        &gpu,
        &light,
        &map,
        Size::new(20, 20).unwrap(),
        Beyond::Border,
        &none,
    )
    .unwrap();

    assert_eq!(gpu.take_warnings(), Vec::<String>::new());
    let messages = MESSAGES.lock().unwrap();
    let from_layers: Vec<_> = messages
        .iter()
        .filter(|text| text.contains("VALIDATION"))
        .collect();
    assert!(from_layers.is_empty(), "{from_layers:#?}");
}
