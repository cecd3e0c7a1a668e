//! Renderings of the device and of the CPU.

use crate::gpu;
use crate::pictures::{glass, scenes};
use ravec_gpu::{RenderStyle, render_field};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Size, Srgb};
use ravec_twocolor::{FitParams, TwoColorField, render_mosaic, render_to};

fn field(image: &Image<LinearRgba>, block_px: usize) -> TwoColorField {
    let params = FitParams {
        block_px,
        ..FitParams::default()
    };
    let mut field = TwoColorField::fit(image, &params, &Progress::none()).unwrap();
    field.refine_lines(image, &Progress::none()).unwrap();
    field
}

fn assert_near(name: &str, field: &TwoColorField, size: Size) {
    let Some(gpu) = gpu() else { return };
    for style in [RenderStyle::TwoColors, RenderStyle::Mosaic] {
        let on_gpu = render_field(gpu, field, size, style, &Progress::none()).unwrap();
        assert!(!gpu.is_lost(), "{:?}", gpu.take_warnings());
        let on_cpu = match style {
            RenderStyle::TwoColors => render_to(field, size, &Progress::none()),
            RenderStyle::Mosaic => render_mosaic(field, size, &Progress::none()),
        }
        .unwrap();
        for (at, (a, b)) in on_cpu.pixels().iter().zip(on_gpu.pixels()).enumerate() {
            let [alpha_a, alpha_b] = [a, b].map(|pixel| pixel.0[3]);
            assert!(
                (alpha_a - alpha_b).abs() <= 1e-5,
                "{name} {size} {at}: {a:?} {b:?}"
            );
            for c in 0..3 {
                // light counts as much as it is seen
                let difference = (a.0[c] * alpha_a - b.0[c] * alpha_b).abs();
                assert!(
                    difference <= 1e-5 * a.0[c].abs().max(1.0),
                    "{name} {size} {at}: {a:?} {b:?}"
                );
            }
        }
    }
}

#[test]
fn scenes_at_many_sizes() {
    let sizes = [
        (163, 117),
        (326, 234),
        (500, 20),
        (1, 1),
        (40, 29),
        (17, 300),
    ];
    for (name, image) in scenes(163, 117).take(6) {
        let field = field(&image.convert(), 8);
        for (width, height) in sizes {
            assert_near(name, &field, Size::new(width, height).unwrap());
        }
    }
}

#[test]
fn blocks_of_all_sides_and_transparency() {
    let image = glass(101, 67);
    for side in [2, 5, 16, 40] {
        let field = field(&image, side);
        for (width, height) in [(101, 67), (257, 170), (60, 40)] {
            assert_near("glass", &field, Size::new(width, height).unwrap());
        }
    }
}

#[test]
fn edges_far_from_the_corner_are_as_exact_as_near_ones() {
    let Some(gpu) = gpu() else { return };
    // one long row of equal blocks
    let image = Image::from_fn(Size::new(40_000, 8).unwrap(), |col, row| {
        let side = (col % 8) * 2 + row > 9;
        Srgb([if side { 220u8 } else { 30 }; 3])
    });
    let field = field(&image.convert(), 8);
    let size = Size::new(60_000, 12).unwrap();
    let on_gpu =
        render_field(gpu, &field, size, RenderStyle::TwoColors, &Progress::none()).unwrap();
    let blocks = 60_000 / 12;
    for row in 0..12 {
        for col in 0..12 {
            let first = on_gpu[(col + 12, row)];
            let last = on_gpu[(col + 12 * (blocks - 2), row)];
            assert!((first.0[0] - last.0[0]).abs() < 1e-6, "{col} {row}");
        }
    }
}
