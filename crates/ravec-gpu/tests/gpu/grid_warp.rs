//! Retargeted pictures of the device and of the CPU.

use crate::gpu;
use crate::pictures::{glass, scenes};
use ravec_gpu::{GpuPixel, warp_deformed};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgb, Resample, Size, Srgb, Srgba};
use ravec_retarget::{Deformation, Painted, RetargetParams, Retargeter};

fn deformation<P: GpuPixel + Resample>(image: &Image<P>, to: (usize, usize)) -> Deformation {
    let params = RetargetParams {
        grid_cells: Some(20),
        ..RetargetParams::default()
    };
    let retargeter =
        Retargeter::new(image, Painted::default(), &params, &Progress::none()).unwrap();
    retargeter.solve(Size::new(to.0, to.1).unwrap()).unwrap()
}

fn both<P: GpuPixel + Resample>(image: &Image<P>, to: (usize, usize)) -> Option<[Image<P>; 2]> {
    let gpu = gpu()?;
    let found = deformation(image, to);
    let on_cpu = found.warp(image, &Progress::none()).unwrap();
    let on_gpu = warp_deformed(gpu, &found, image, &Progress::none()).unwrap();
    assert!(!gpu.is_lost(), "{:?}", gpu.take_warnings());
    assert_eq!(on_cpu.size(), on_gpu.size());
    Some([on_cpu, on_gpu])
}

const SIZES: [(usize, usize); 5] = [(120, 117), (300, 117), (163, 60), (80, 58), (326, 234)];

#[test]
fn light_of_scenes_is_that_of_the_cpu() {
    for (name, image) in scenes(163, 117).take(4) {
        let image: Image<LinearRgb> = image.convert();
        for to in SIZES {
            let Some([a, b]) = both(&image, to) else {
                return;
            };
            let pairs = a.pixels().iter().zip(b.pixels());
            let most = pairs
                .flat_map(|(a, b)| (0..3).map(|c| (a.0[c] - b.0[c]).abs()))
                .fold(0.0, f32::max);
            assert!(most < 1e-3, "{name} {to:?}: {most}");
        }
    }
}

#[test]
fn samples_differ_by_one_step_at_most() {
    let (_, image) = scenes(163, 117).next().unwrap();
    let image: Image<Srgb<u8>> = image.convert();
    let glass: Image<Srgba<u8>> = glass(163, 117).convert();
    for to in SIZES {
        let Some([a, b]) = both(&image, to) else {
            return;
        };
        for (a, b) in a.pixels().iter().zip(b.pixels()) {
            assert!(
                (0..3).all(|c| a.0[c].abs_diff(b.0[c]) <= 1),
                "{to:?}: {a:?} {b:?}"
            );
        }
        let [a, b] = both(&glass, to).unwrap();
        for (a, b) in a.pixels().iter().zip(b.pixels()) {
            assert!(a.0[3].abs_diff(b.0[3]) <= 1, "{to:?}: {a:?} {b:?}");
            // colors that hardly show are found from small numbers
            let shown = a.0[3] > 8;
            assert!(
                !shown || (0..3).all(|c| a.0[c].abs_diff(b.0[c]) <= 2),
                "{to:?}: {a:?} {b:?}"
            );
        }
    }
}

#[test]
fn a_picture_that_does_not_change_comes_back_bit_for_bit() {
    let image = glass(64, 40);
    if let Some([a, b]) = both(&image, (64, 40)) {
        assert_eq!(a, image);
        assert_eq!(b, image);
    }
}
