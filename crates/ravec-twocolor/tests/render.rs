//! Rendering against its definition: the mean of many points of the two-color image under each pixel.

use glam::DVec2;
use proptest::prelude::*;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::color::linear_from_oklab;
use ravec_raster::{Image, LinearRgba, Size};
use ravec_twocolor::{
    BlockField, FitParams, PlacedBlock, RenderError, TwoColorField, render, render_mosaic,
    render_to,
};

fn size(width: usize, height: usize) -> Size {
    Size::new(width, height).unwrap()
}

/// Edges, texture and transparency, so that blocks have lines in all directions.
fn picture(size: Size, seed: usize) -> Image<LinearRgba> {
    Image::from_fn(size, |col, row| {
        let noise =
            |k: usize| ((col * 37 + row * 91 + col * row * k + seed * 53) % 101) as f32 / 400.0;
        let (x, y) = (col as f32 - 7.3, row as f32 - seed as f32 % 13.0);
        let bright = if x * x + y * y < 90.0 { 0.7 } else { 0.1 };
        let alpha = if col > row + seed % 9 { 1.0 } else { 0.3 };
        LinearRgba([bright + noise(3), bright + noise(5), 0.4 + noise(7), alpha])
    })
}

fn fitted(image: &Image<LinearRgba>, block_px: usize) -> TwoColorField {
    let params = FitParams {
        block_px,
        ..FitParams::default()
    };
    TwoColorField::fit(image, &params, &Progress::none()).unwrap()
}

fn premultiplied(block: &PlacedBlock, side: usize) -> [f64; 4] {
    let alpha = f64::from(block.pixel.alphas[side]);
    let [r, g, b] = linear_from_oklab(block.pixel.colors[side].0).map(|v| f64::from(v) * alpha);
    [r, g, b, alpha]
}

/// The definition: each pixel is the mean of 32 × 32 points, in premultiplied linear light.
fn render_naive(field: &TwoColorField, to: Size) -> Image<LinearRgba> {
    let (from, n) = (field.image_size(), 32);
    let step = DVec2::new(
        from.width() as f64 / to.width() as f64,
        from.height() as f64 / to.height() as f64,
    );
    let blocks: Vec<PlacedBlock> = field.placed_blocks().collect();
    Image::from_fn(to, |col, row| {
        let mut sum = [0.0; 4];
        for i in 0..n * n {
            let cell = DVec2::new((i % n) as f64 + 0.5, (i / n) as f64 + 0.5) / n as f64;
            let p = (DVec2::new(col as f64, row as f64) + cell) * step;
            let (c, r) = (
                p.x as usize / field.block_px(),
                p.y as usize / field.block_px(),
            );
            let block = &blocks[r * field.grid_size().width() + c];
            let side = block
                .line_in_image()
                .is_some_and(|line| line.signed_distance(p) >= 0.0);
            for (sum, value) in sum.iter_mut().zip(premultiplied(block, usize::from(side))) {
                *sum += value / (n * n) as f64;
            }
        }
        LinearRgba(sum.map(|v| v as f32))
    })
}

fn largest_difference(found: &Image<LinearRgba>, naive: &Image<LinearRgba>) -> f32 {
    assert_eq!(found.size(), naive.size());
    let premultiplied = |[r, g, b, a]: [f32; 4]| [r * a, g * a, b * a, a];
    found
        .pixels()
        .iter()
        .zip(naive.pixels())
        .flat_map(|(f, n)| premultiplied(f.0).into_iter().zip(n.0))
        .map(|(f, n)| (f - n).abs())
        .fold(0.0, f32::max)
}

#[test]
fn every_scale_agrees_with_32_by_32_points_a_pixel() {
    for (of, block_px) in [
        (size(37, 26), 8),
        (size(16, 16), 5),
        (size(3, 40), 16),
        (size(1, 1), 2),
    ] {
        let field = fitted(&picture(of, 4), block_px);
        for scale in [0.3, 1.0, 2.0, 4.0, 7.5] {
            let found = render(&field, scale, &Progress::none()).unwrap();
            let naive = render_naive(&field, found.size());
            // each of the lines and borders in a pixel crosses at most 64 of its 1024 cells, and a cell that is crossed is
            // half wrong on average; a pixel at scale 0.3 holds pieces of at most four blocks
            let lines = if scale < 1.0 { 4.0 } else { 1.0 };
            let difference = largest_difference(&found, &naive);
            assert!(
                difference < 0.03 * lines,
                "{of} in blocks of {block_px} at {scale}: {difference}"
            );
        }
    }
}

#[test]
fn the_picture_fills_any_size() {
    let field = fitted(&picture(size(29, 17), 1), 8);
    for to in [
        size(1, 1),
        size(29, 1),
        size(3, 50),
        size(100, 5),
        size(61, 17),
    ] {
        let found = render_to(&field, to, &Progress::none()).unwrap();
        // a pixel of the smallest sizes holds dozens of lines whose sampling errors have either sign
        assert!(
            largest_difference(&found, &render_naive(&field, to)) < 0.06,
            "{to}"
        );
    }
}

/// The exact integral of the two-color image: the area of each side by clipping the block's rectangle.
fn integral(field: &impl BlockField) -> [f64; 4] {
    let mut total = [0.0; 4];
    for block in field.placed_blocks() {
        let rect = block.rect(field.image_size());
        let [x0, y0, x1, y1] = [rect.col, rect.row, rect.right(), rect.bottom()].map(|v| v as f64);
        let corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(DVec2::from);
        let area_0 = block.line_in_image().map_or(rect.pixels() as f64, |line| {
            let mut inside = Vec::new();
            for (i, &p) in corners.iter().enumerate() {
                let q = corners[(i + 1) % 4];
                let (dp, dq) = (line.signed_distance(p), line.signed_distance(q));
                if dp < 0.0 {
                    inside.push(p);
                }
                if (dp < 0.0) != (dq < 0.0) {
                    inside.push(p.lerp(q, dp / (dp - dq)));
                }
            }
            let doubled: f64 = (0..inside.len())
                .map(|i| inside[i].perp_dot(inside[(i + 1) % inside.len()]))
                .sum();
            0.5 * doubled
        });
        let area_1 = rect.pixels() as f64 - area_0;
        for (c, total) in total.iter_mut().enumerate() {
            *total += area_0 * premultiplied(&block, 0)[c] + area_1 * premultiplied(&block, 1)[c];
        }
    }
    total
}

proptest! {
    #[test]
    fn no_light_is_lost_or_made_at_any_size(
        w in 1usize..40, h in 1usize..40, block_px in 2usize..12, seed in 0usize..100, tw in 1usize..60, th in 1usize..60,
    ) {
        let field = fitted(&picture(size(w, h), seed), block_px);
        let truth = integral(&field);
        for to in [size(w, h), size(tw, th)] {
            let found = render_to(&field, to, &Progress::none()).unwrap();
            for (c, truth) in truth.iter().enumerate() {
                let sum: f64 = found.pixels().iter().map(|p| {
                    let alpha = f64::from(p.0[3]);
                    if c == 3 { alpha } else { f64::from(p.0[c]) * alpha }
                }).sum();
                // pixels are rounded to f32, and values are of size 1
                let (found, truth) = (sum / to.pixels() as f64, truth / (w * h) as f64);
                prop_assert!((found - truth).abs() < 1e-6, "{c}: {found} {truth}");
            }
        }
    }
}

#[test]
fn a_constant_field_renders_exactly_constant() {
    for color in [
        LinearRgba([0.3, 0.7, 0.1, 1.0]),
        LinearRgba([0.9, 0.02, 0.5, 0.35]),
    ] {
        // whole blocks only: those clipped by a border divide by another count, which moves the last digit of a mean
        let field = fitted(&Image::new(size(24, 16), color), 8);
        let block = field.block(0, 0);
        assert!(field.blocks().iter().all(|other| other == block));
        let [r, g, b] = linear_from_oklab(block.colors[0].0);
        let flat = LinearRgba([r, g, b, block.alphas[0]]);
        for scale in [0.05, 0.3, 1.0, 1.7, 4.0, 7.5] {
            let found = render(&field, scale, &Progress::none()).unwrap();
            assert!(
                found.pixels().iter().all(|&pixel| pixel == flat),
                "scale {scale}"
            );
        }
    }
}

#[test]
fn fully_transparent_pictures_stay_so() {
    let field = fitted(&Image::new(size(9, 9), LinearRgba([0.5, 0.2, 0.1, 0.0])), 4);
    let found = render(&field, 2.3, &Progress::none()).unwrap();
    assert!(
        found
            .pixels()
            .iter()
            .all(|&pixel| pixel == LinearRgba([0.0; 4]))
    );
}

#[test]
fn the_mosaic_has_one_color_a_block_and_is_no_better_than_two() {
    let image = picture(size(32, 24), 2).map(|p| LinearRgba([p.0[0], p.0[1], p.0[2], 1.0]));
    let field = fitted(&image, 8);
    let mosaic = render_mosaic(&field, image.size(), &Progress::none()).unwrap();
    for (col, row) in (0..24).flat_map(|row| (0..32).map(move |col| (col, row))) {
        assert_eq!(mosaic[(col, row)], mosaic[(col / 8 * 8, row / 8 * 8)]);
    }
    let two = render(&field, 1.0, &Progress::none()).unwrap();
    let error = |found: &Image<LinearRgba>| -> f32 {
        found
            .pixels()
            .iter()
            .zip(image.pixels())
            .flat_map(|(f, i)| f.0.into_iter().zip(i.0))
            .map(|(f, i)| (f - i) * (f - i))
            .sum()
    };
    assert!(error(&two) < error(&mosaic));
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let field = fitted(&picture(size(61, 47), 3), 6);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| render(&field, 3.3, &Progress::none()).unwrap())
    };
    assert_eq!(on(1), on(4));
}

#[test]
fn senseless_scales_and_cancelled_work_are_errors() {
    let field = fitted(&picture(size(20, 20), 0), 8);
    for got in [0.0, -1.0, f64::INFINITY] {
        assert_eq!(
            render(&field, got, &Progress::none()),
            Err(RenderError::Scale { got })
        );
    }
    let nan = render(&field, f64::NAN, &Progress::none());
    assert!(matches!(nan, Err(RenderError::Scale { .. })));
    let huge = render(&field, 1e9, &Progress::none());
    assert!(matches!(huge, Err(RenderError::Size(_))));
    let progress = Progress::none();
    progress.cancel();
    assert_eq!(
        render(&field, 1.0, &progress),
        Err(RenderError::Cancelled(Cancelled))
    );
}

#[test]
fn tiny_scales_give_at_least_one_pixel() {
    let field = fitted(&picture(size(20, 7), 0), 8);
    let found = render(&field, 1e-6, &Progress::none()).unwrap();
    assert_eq!(found.size(), size(1, 1));
}
