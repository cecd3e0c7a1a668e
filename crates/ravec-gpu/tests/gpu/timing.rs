//! Kernels whose times are compared find the same splits.

use crate::gpu;
use crate::pictures::{glass, scenes};
use ravec_gpu::GpuPixel;
use ravec_gpu::timing::{FitKernel, time_resident_fit, time_transfers};
use ravec_raster::{Image, Srgb, with_image};
use std::time::Duration;

fn assert_equal_splits<P: GpuPixel>(name: &str, image: &Image<P>) {
    let Some(gpu) = gpu() else { return };
    for side in [4, 8] {
        let splits = [FitKernel::Plane, FitKernel::Straightforward]
            .map(|kernel| time_resident_fit(gpu, image, side, kernel).unwrap().splits);
        assert_eq!(splits[0].len(), image.size().cells(side).pixels());
        assert_eq!(splits[0], splits[1], "{name}, {side} px");
    }
}

#[test]
fn both_kernels_find_the_same_splits() {
    let (name, image) = scenes(67, 50).next().unwrap();
    with_image!(&image, image => assert_equal_splits(name, image));
    let image = glass(70, 45);
    assert_equal_splits("glass", &image);
    assert_equal_splits("opaque", &image.convert::<Srgb<u8>>());
}

#[test]
fn transfers_take_time() {
    let Some(gpu) = gpu() else { return };
    let time = time_transfers(gpu, &glass(70, 45), 8).unwrap();
    assert!(time > Duration::ZERO);
}
