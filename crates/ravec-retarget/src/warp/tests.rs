use super::*;
use crate::params::RetargetParams;
use crate::retargeter::{Painted, Retargeter};
use ravec_raster::{LinearRgb, PremulLinearRgba, ResizeFilter, Srgb, Srgba, resize};

fn ball(size: Size) -> Image<LinearRgb> {
    Image::from_fn(size, |col, row| {
        let (x, y) = (col as f64 + 0.5, row as f64 + 0.5);
        let wave = 0.5 + 0.4 * (0.9 * x).sin() as f32 * (0.4 * y).cos() as f32;
        let r = (x - 0.4 * size.width() as f64).hypot(y - 0.5 * size.height() as f64);
        let inside = r < 0.2 * size.height() as f64;
        LinearRgb(if inside {
            [0.9, 0.2, 0.1]
        } else {
            [0.3 * wave, 0.4 * wave, 0.2]
        })
    })
}

fn deformed(size: Size, to: Size, adaptive: bool) -> (Image<LinearRgb>, Deformation) {
    let image = ball(size);
    let params = RetargetParams {
        grid_cells: Some(20),
        adaptive,
        ..RetargetParams::default()
    };
    let none = Progress::none();
    let found = Retargeter::new(&image, Painted::default(), &params, &none).unwrap();
    (image, found.solve(to).unwrap())
}

fn size(width: usize, height: usize) -> Size {
    Size::new(width, height).unwrap()
}

#[test]
fn every_pixel_lies_in_one_cell() {
    for adaptive in [false, true] {
        for to in [size(53, 64), size(160, 40), size(97, 131)] {
            let (_, found) = deformed(size(96, 64), to, adaptive);
            for scale in [1.0, 0.37, 2.9] {
                let [width, height] =
                    [to.width(), to.height()].map(|v| (v as f64 * scale) as usize);
                let exact = dvec2(width as f64, height as f64)
                    / dvec2(to.width() as f64, to.height() as f64);
                let locator = Locator::new(&found, exact, width);
                let cells = locator.cells_in(0, height);
                let mut stretches = Vec::new();
                for row in 0..height {
                    locator.stretches(row, &cells, &mut stretches);
                    let mut times = vec![0; width];
                    for stretch in &stretches {
                        times[stretch.first..stretch.end]
                            .iter_mut()
                            .for_each(|n| *n += 1);
                    }
                    assert!(times.iter().all(|&n| n == 1), "{to} row {row}: {times:?}");
                }
            }
        }
    }
}

/// The plain definition: look every pixel up in every cell, then weigh all old pixels.
fn naive(found: &Deformation, image: &Image<LinearRgb>, at: DVec2) -> [f64; 3] {
    let kernel = |x: f64| {
        let x = x.abs();
        match x {
            _ if x < 1.0 => (1.5 * x - 2.5) * x * x + 1.0,
            _ if x < 2.0 => ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0,
            _ => 0.0,
        }
    };
    // Newton's method from the middle of the cell that holds the pixel
    let (mut best, mut source) = (f64::INFINITY, DVec2::ZERO);
    for cell in &found.grid.cells {
        let mut uv = DVec2::splat(0.5);
        let [a, b, c, d] = found.corners(cell);
        for _ in 0..30 {
            let here = a + uv.x * (b - a) + uv.y * (c - a) + uv.x * uv.y * (a - b - c + d) - at;
            let (e, f) = ((b - a).lerp(d - c, uv.y), (c - a).lerp(d - b, uv.x));
            uv -= dvec2(here.perp_dot(f), e.perp_dot(here)) / e.perp_dot(f);
        }
        let outside = (uv - uv.clamp(DVec2::ZERO, DVec2::ONE)).length();
        if outside < best {
            best = outside;
            let extent = found.grid.extent(cell).map(|v| v as f64);
            let first = cell.first.map(|v| v as f64);
            source =
                (DVec2::from_array(first) + uv * DVec2::from_array(extent)) * found.grid.unit_px();
        }
    }
    let step = 1e-4;
    let moved = |by: DVec2| {
        (found.target_from_source(source + by) - found.target_from_source(source)) / step
    };
    // away from the border of the cell, so that the differences are within it
    let (e, f) = (moved(dvec2(step, 0.0)), moved(dvec2(0.0, step)));
    let width = dvec2(f.length(), e.length()) / e.perp_dot(f);
    let width = width.max(DVec2::ONE);
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for row in -60..image.height() as isize + 60 {
        for col in -60..image.width() as isize + 60 {
            let by = (dvec2(col as f64 + 0.5, row as f64 + 0.5) - source) / width;
            let weight = kernel(by.x) * kernel(by.y);
            weights += weight;
            let pixel = image.clamped(col, row);
            for (sum, value) in sum.iter_mut().zip(pixel.0) {
                *sum += weight * f64::from(value);
            }
        }
    }
    sum.map(|v| v / weights)
}

#[test]
fn pixels_are_those_of_the_plain_definition() {
    for (adaptive, to) in [
        (false, size(40, 48)),
        (true, size(90, 30)),
        (false, size(24, 40)),
    ] {
        let (image, found) = deformed(size(64, 48), to, adaptive);
        let warped = found.warp(&image, &Progress::none()).unwrap();
        for k in 0..60 {
            let (col, row) = (k * 17 % to.width(), k * 29 % to.height());
            let expected = naive(&found, &image, dvec2(col as f64 + 0.5, row as f64 + 0.5));
            for (a, b) in warped[(col, row)].0.into_iter().zip(expected) {
                // what is seen is interpolated along a stretch, and changes by some per cent across a cell
                assert!(
                    (f64::from(a) - b).abs() < 0.012,
                    "{to} ({col}, {row}): {a} {b}"
                );
            }
        }
    }
}

#[test]
fn plain_scaling_is_a_resize() {
    let (image, found) = deformed(size(96, 64), size(72, 48), false);
    let warped = found.warp(&image, &Progress::none()).unwrap();
    let resized = resize(&image, size(72, 48), ResizeFilter::CatmullRom);
    for (a, b) in warped.pixels().iter().zip(resized.pixels()) {
        for (a, b) in a.0.into_iter().zip(b.0) {
            // single precision, and at the border weights of what is beyond count once more
            assert!((a - b).abs() < 0.02, "{a} {b}");
        }
    }
}

#[test]
fn what_does_not_change_comes_back_bit_for_bit_and_constants_stay() {
    let (image, found) = deformed(size(96, 64), size(96, 64), false);
    assert_eq!(found.warp(&image, &Progress::none()).unwrap(), image);
    let (_, found) = deformed(size(96, 64), size(50, 90), true);
    let gray = Image::new(size(96, 64), Srgb([201u16 * 257, 3000, 65535]));
    let warped = found.warp(&gray, &Progress::none()).unwrap();
    assert!(warped.pixels().iter().all(|&pixel| pixel == gray[(0, 0)]));
}

#[test]
fn transparent_colors_do_not_bleed() {
    let (_, found) = deformed(size(96, 64), size(50, 64), false);
    let image = Image::from_fn(size(96, 64), |col, _| {
        if col < 48 {
            Srgba([200u8, 100, 50, 255])
        } else {
            Srgba([0, 255, 0, 0])
        }
    });
    let warped = found.warp(&image, &Progress::none()).unwrap();
    for pixel in warped.pixels().iter().filter(|pixel| pixel.0[3] > 8) {
        // rounding of eight bits, spread by the division by alpha
        assert!(
            pixel.0[0].abs_diff(200) <= 8 && pixel.0[1].abs_diff(100) <= 8,
            "{pixel:?}"
        );
    }
    let light = image.convert::<PremulLinearRgba>();
    let same = found
        .warp(&light, &Progress::none())
        .unwrap()
        .convert::<Srgba<u8>>();
    for (a, b) in same
        .pixels()
        .iter()
        .zip(warped.pixels())
        .filter(|(a, _)| a.0[3] > 8)
    {
        assert!(a.0[3].abs_diff(b.0[3]) <= 1);
    }
}

#[test]
fn a_preview_is_the_picture_in_small() {
    let (image, found) = deformed(size(240, 160), size(150, 160), false);
    let full = found.warp(&image, &Progress::none()).unwrap();
    let small = resize(&image, size(120, 80), ResizeFilter::Box);
    let preview = found
        .warp_to(&small, size(75, 80), WarpFilter::Preview, &Progress::none())
        .unwrap();
    let expected = resize(&full, size(75, 80), ResizeFilter::Box);
    let pairs = preview.pixels().iter().zip(expected.pixels());
    let error: f32 = pairs.map(|(a, b)| (a.0[0] - b.0[0]).abs()).sum::<f32>() / 6000.0;
    assert!(error < 0.03, "{error}");
    let tall = Image::new(size(80, 120), LinearRgb([0.0; 3]));
    let refused = found.warp_to(&tall, size(75, 80), WarpFilter::Full, &Progress::none());
    assert!(matches!(refused, Err(RetargetError::OtherShape { .. })));
    assert!(matches!(
        found.warp(&small, &Progress::none()),
        Err(RetargetError::OtherShape { .. })
    ));
}

#[test]
fn the_number_of_threads_does_not_show() {
    let (image, found) = deformed(size(300, 200), size(420, 170), false);
    let pool = |threads: usize| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
    };
    let one = pool(1).install(|| found.warp(&image, &Progress::none()).unwrap());
    let many = pool(5).install(|| found.warp(&image, &Progress::none()).unwrap());
    assert_eq!(one, many);
}

#[test]
fn the_width_of_vectors_does_not_show() {
    let (image, found) = deformed(size(150, 100), size(80, 110), true);
    let at = |level: Level| {
        let mut warp = found
            .prepare(&image, found.size(), WarpFilter::Full)
            .unwrap();
        warp.simd = level;
        warp.run(&Progress::none()).unwrap()
    };
    assert_eq!(at(Level::baseline()), at(Level::new()));
}
