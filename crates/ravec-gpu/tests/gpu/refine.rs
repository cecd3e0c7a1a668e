//! Refined lines of the device and of the CPU.

use crate::gpu;
use crate::pictures::{glass, scenes};
use glam::DVec2;
use ravec_gpu::{GpuPixel, refine_lines};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgb, Srgb};
use ravec_twocolor::{FitParams, TwoColorField, render_to};

fn both<P: GpuPixel>(image: &Image<P>, block_px: usize) -> Option<[TwoColorField; 2]> {
    let gpu = gpu()?;
    let params = FitParams {
        block_px,
        ..FitParams::default()
    };
    let fitted = TwoColorField::fit(image, &params, &Progress::none()).unwrap();
    let (mut on_cpu, mut on_gpu) = (fitted.clone(), fitted);
    on_cpu.refine_lines(image, &Progress::none()).unwrap();
    refine_lines(gpu, &mut on_gpu, image, &Progress::none()).unwrap();
    assert!(!gpu.is_lost(), "{:?}", gpu.take_warnings());
    Some([on_cpu, on_gpu])
}

/// The largest distance between the lines within the block, for blocks with lines.
fn distances([a, b]: &[TwoColorField; 2]) -> Vec<f64> {
    let reach = 0.5 * a.block_px() as f64;
    let mut distances: Vec<f64> = a
        .blocks()
        .iter()
        .zip(b.blocks())
        .filter_map(|(a, b)| {
            assert_eq!(a.is_flat(), b.is_flat());
            let (a, b) = (a.line?, b.line?);
            // where the line is in the block
            let along = a.normal.perp() * reach;
            let foot = a.normal * a.offset_px;
            let ends: [DVec2; 2] = [foot + along, foot - along];
            Some(
                ends.into_iter()
                    .map(|end| b.signed_distance(end).abs())
                    .fold(0.0, f64::max),
            )
        })
        .collect();
    distances.sort_by(f64::total_cmp);
    distances
}

#[test]
fn lines_of_all_scenes_are_those_of_the_cpu() {
    let mut all = Vec::new();
    let mut errors = [0.0; 2];
    for (_, image) in scenes(163, 117) {
        let image: Image<Srgb<u8>> = image.convert();
        for side in [4, 8, 16] {
            let Some(fields) = both(&image, side) else {
                return;
            };
            all.extend(distances(&fields));
            for (error, field) in errors.iter_mut().zip(&fields) {
                let drawn = render_to(field, image.size(), &Progress::none()).unwrap();
                let light: Image<LinearRgb> = image.convert();
                for (a, b) in drawn.pixels().iter().zip(light.pixels()) {
                    *error += (0..3)
                        .map(|c| f64::from((a.0[c] - b.0[c]).powi(2)))
                        .sum::<f64>();
                }
            }
        }
    }
    all.sort_by(f64::total_cmp);
    let at = |share: f64| all[((all.len() - 1) as f64 * share) as usize];
    assert!(
        at(0.5) < 1e-5 && at(0.98) < 0.01,
        "{} {}",
        at(0.5),
        at(0.98)
    );
    assert!((errors[1] / errors[0] - 1.0).abs() < 1e-3, "{errors:?}");
}

#[test]
fn transparency_borders_and_values_that_are_no_numbers() {
    let mut image = glass(101, 67);
    let Some(fields) = both(&image, 8) else {
        return;
    };
    let found = distances(&fields);
    assert!(found[found.len() * 95 / 100] < 0.01, "{found:?}");
    image[(30, 30)].0[0] = f32::NAN;
    image[(50, 12)].0[1] = f32::INFINITY;
    let fields = both(&image, 8).unwrap();
    let block = |field: &TwoColorField| format!("{:?}", field.block(30 / 8, 30 / 8));
    assert_eq!(block(&fields[0]), block(&fields[1]));
}
