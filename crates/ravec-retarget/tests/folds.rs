//! Nothing folds, whatever the picture, the size and the parameters are.

use proptest::prelude::*;
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgb, Mask, Rect, Size, Srgb};
use ravec_retarget::{Borders, Deformation, Painted, RetargetError, RetargetParams, Retargeter};

/// Blocks and stripes of random colors: strong edges everywhere, many of them straight.
fn picture(width: usize, height: usize, seed: u64) -> Image<LinearRgb> {
    let noise = |x: usize, y: usize| {
        let mut h = seed
            ^ (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
            ^ (y as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
        h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (h >> 40) as f32 / (1u64 << 24) as f32
    };
    let (block, slope) = (3 + seed as usize % 23, 1 + seed as usize / 23 % 5);
    Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
        let stripe = (col + slope * row) / 31 % 3 == 0;
        let value = if stripe {
            0.9
        } else {
            noise(col / block, row / block)
        };
        LinearRgb([value, noise(row / 7, 3), 0.3])
    })
}

fn assert_one_to_one(found: &Deformation) {
    for (corners, _) in found.cells() {
        for k in 0..4 {
            let [before, here, after] = [k + 3, k, k + 1].map(|k: usize| corners[k % 4]);
            assert!(
                (after - here).perp_dot(before - here) > 0.0,
                "{corners:?} {:?}",
                found.summary()
            );
        }
    }
    assert!(found.summary().least_area > 0.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn no_cell_is_inverted(
        (width, height) in (1usize..150, 1usize..150),
        (fx, fy) in (0.25f64..3.0, 0.25f64..3.0),
        seed in any::<u64>(),
        cells in 2usize..40,
        (adaptive, borders) in (any::<bool>(), 0usize..3),
        (crop, saliency, scale) in (0.0f64..0.5, 0.0f64..1.0, 0.25f64..4.0),
    ) {
        let image = picture(width, height, seed);
        let params = RetargetParams {
            grid_cells: Some(cells),
            adaptive,
            borders: [Borders::Slide, Borders::Symmetric, Borders::Free][borders],
            max_crop: if seed % 2 == 0 { crop } else { 0.0 },
            saliency,
            object_scale: scale,
            ..RetargetParams::default()
        };
        let rect = Rect::new(width / 3, height / 3, width / 3, height / 4);
        let mask = Mask::from_rect(image.size(), rect);
        let painted = match seed % 3 {
            0 => Painted { protect: Some(&mask), give_way: None },
            1 => Painted { protect: None, give_way: Some(&mask) },
            _ => Painted::default(),
        };
        let retargeter = Retargeter::new(&image, painted, &params, &Progress::none()).unwrap();
        let side = |length: usize, factor: f64| ((length as f64 * factor).round() as usize).max(1);
        let size = Size::new(side(width, fx), side(height, fy)).unwrap();
        let found = retargeter.solve(size).unwrap();
        assert_one_to_one(&found);
        let near = Size::new(size.width() + 3, size.height()).unwrap();
        if let Ok(dragged) = retargeter.solve_near(near, &found) {
            assert_one_to_one(&dragged);
            let warped = dragged.warp(&image, &Progress::none()).unwrap();
            prop_assert_eq!(warped.size(), near);
            prop_assert!(warped.pixels().iter().all(|p| p.0.iter().all(|v| v.is_finite())));
        }
    }
}

fn retargeter(image: &Image<LinearRgb>, params: &RetargetParams) -> Retargeter {
    Retargeter::new(image, Painted::default(), params, &Progress::none()).unwrap()
}

#[test]
fn identity_and_uniform_scaling_are_exact() {
    let image = picture(140, 100, 11);
    for adaptive in [false, true] {
        for borders in [Borders::Slide, Borders::Symmetric, Borders::Free] {
            let params = RetargetParams {
                grid_cells: Some(30),
                adaptive,
                borders,
                max_crop: 0.2,
                ..RetargetParams::default()
            };
            let found = retargeter(&image, &params);
            for factor in [1.0, 0.5, 2.0, 0.25] {
                let size = Size::new((140.0 * factor) as usize, (100.0 * factor) as usize).unwrap();
                let deformation = found.solve(size).unwrap();
                for k in 0..50 {
                    let at = glam::dvec2(f64::from(k) * 2.8, f64::from(k * 37 % 100));
                    assert!(deformation.target_from_source(at).distance(factor * at) < 1e-6);
                }
                assert_eq!(deformation.summary().bounded_edges, 0);
            }
            assert!(found.solve(image.size()).unwrap().is_identity());
        }
    }
}

#[test]
fn bad_input_is_refused_with_a_sentence() {
    let image = picture(40, 30, 3);
    let params = RetargetParams::default();
    let mask = Mask::empty(Size::new(30, 40).unwrap());
    let painted = Painted {
        protect: None,
        give_way: Some(&mask),
    };
    let error = Retargeter::new(&image, painted, &params, &Progress::none()).unwrap_err();
    assert!(
        error.to_string().contains("give-way mask has 30 x 40"),
        "{error}"
    );
    let found = retargeter(&image, &params);
    for (width, height) in [(1, 30), (40, 1), (4000, 30), (40, 601)] {
        let error = found.solve(Size::new(width, height).unwrap()).unwrap_err();
        assert!(matches!(error, RetargetError::Factor { .. }), "{error}");
    }
    assert!(matches!(
        Retargeter::new(
            &image,
            Painted::default(),
            &RetargetParams {
                max_crop: 0.6,
                ..params
            },
            &Progress::none()
        ),
        Err(RetargetError::Parameter { .. })
    ));
}

#[test]
fn pictures_that_are_not_numbers_are_only_pictures() {
    let mut image = picture(60, 40, 5);
    for k in 0..300 {
        image[(k * 7 % 60, k * 11 % 40)] = LinearRgb([f32::NAN, f32::INFINITY, -1e30]);
    }
    let found = retargeter(&image, &RetargetParams::default())
        .solve(Size::new(33, 40).unwrap())
        .unwrap();
    assert_one_to_one(&found);
    assert_eq!(found.warp(&image, &Progress::none()).unwrap().width(), 33);
}

#[test]
fn work_stops_wherever_it_is_cancelled() {
    let image = picture(200, 150, 7).convert::<Srgb<u8>>();
    let params = RetargetParams {
        adaptive: true,
        ..RetargetParams::default()
    };
    for look in [1, 2, 3, 5, 8, 20] {
        let stopped = Retargeter::new(
            &image,
            Painted::default(),
            &params,
            &Progress::cancelled_at(look),
        );
        assert!(
            matches!(stopped, Err(RetargetError::Cancelled(_))),
            "{look}"
        );
    }
    let found = Retargeter::new(&image, Painted::default(), &params, &Progress::none()).unwrap();
    let deformation = found.solve(Size::new(120, 150).unwrap()).unwrap();
    for look in [1, 3, 4] {
        let stopped = deformation.warp(&image, &Progress::cancelled_at(look));
        assert!(matches!(stopped, Err(RetargetError::Cancelled(_))));
    }
}

#[test]
fn symmetric_borders_move_alike_and_free_ones_stay_outside() {
    let image = picture(160, 120, 19);
    for adaptive in [false, true] {
        let params = |borders| RetargetParams {
            grid_cells: Some(24),
            adaptive,
            borders,
            ..RetargetParams::default()
        };
        let size = Size::new(100, 120).unwrap();
        let symmetric = retargeter(&image, &params(Borders::Symmetric))
            .solve(size)
            .unwrap();
        for k in 0..=24 {
            let y = f64::from(k) * 5.0;
            let [left, right] =
                [0.0, 160.0].map(|x| symmetric.target_from_source(glam::dvec2(x, y)));
            assert!(
                (left.y - right.y).abs() < 1e-9
                    && left.x.abs() < 1e-9
                    && (right.x - 100.0).abs() < 1e-9
            );
        }
        let free = retargeter(&image, &params(Borders::Free))
            .solve(size)
            .unwrap();
        assert_one_to_one(&free);
        for k in 0..=24 {
            let y = f64::from(k) * 5.0;
            let [left, right] = [0.0, 160.0].map(|x| free.target_from_source(glam::dvec2(x, y)));
            assert!(left.x <= 1e-9 && right.x >= 100.0 - 1e-9, "{left} {right}");
        }
        let warped = free.warp(&image, &Progress::none()).unwrap();
        assert_eq!(warped.size(), size);
    }
}

#[test]
fn cropping_leaves_more_room_and_never_exceeds_its_share() {
    // the same importance everywhere: half of the width squeezes all of it, unless a part goes
    let image = picture(240, 120, 29);
    let params = |max_crop| RetargetParams {
        grid_cells: Some(40),
        max_crop,
        ..RetargetParams::default()
    };
    let size = Size::new(120, 120).unwrap();
    let width = |found: &Deformation| {
        let at = |x: f64| found.target_from_source(glam::dvec2(x, 60.0)).x;
        at(240.0) - at(0.0)
    };
    let whole = retargeter(&image, &params(0.0)).solve(size).unwrap();
    assert_eq!(whole.summary().cropped, 0.0);
    assert!((width(&whole) - 120.0).abs() < 1e-6);
    let cropped = retargeter(&image, &params(0.3)).solve(size).unwrap();
    let share = cropped.summary().cropped;
    assert!(share > 0.0 && share <= 0.3 + 1e-9, "{share}");
    assert!((width(&cropped) - 120.0 / (1.0 - share)).abs() < 1e-6);
    assert_one_to_one(&cropped);
}
