//! Mattes before a plate, on scenes with known alpha.

use ravec_matting::{
    Colors, Constraints, MattingError, PlateFrame, PlateLight, PlateMatte, PlateParams, Shadows,
    plate_matte, plate_matte_near,
};
use ravec_progress::Progress;
use ravec_raster::{BlurCovariance, Image, Plane, Rect, Size, elliptic_gaussian_blur};

/// A number from −1 to 1 that looks random.
fn noise(seed: u32) -> f32 {
    let mut x = seed.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^= x >> 16;
    x as f32 / u32::MAX as f32 * 2.0 - 1.0
}

/// A plate with texture in all directions.
fn plate(size: Size) -> Colors {
    Image::from_fn(size, |col, row| {
        let (x, y) = (col as f32, row as f32);
        let wave = 0.12 * (0.31 * x + 0.11 * y).sin() + 0.1 * (0.23 * y - 0.07 * x).cos();
        let grain = 0.05 * noise((row * 1000 + col) as u32 / 2);
        [0.5 + wave + grain, 0.55 - wave + grain, 0.45 + 0.5 * wave]
    })
}

/// A disc with a soft rim.
fn disc(size: Size) -> Plane {
    let (x, y) = (size.width() as f32 * 0.5, size.height() as f32 * 0.55);
    let radius = size.height() as f32 * 0.25;
    Image::from_fn(size, |col, row| {
        let distance = (col as f32 + 0.5 - x).hypot(row as f32 + 0.5 - y);
        ((radius - distance) / 6.0 + 0.5).clamp(0.0, 1.0)
    })
}

const FOREGROUND: [f32; 3] = [0.8, 0.2, 0.3];

/// Foreground over the plate in a light of 3 % more, with noise of about one percent.
fn composite(plate: &Colors, alpha: &Plane) -> Colors {
    Image::from_fn(plate.size(), |col, row| {
        let (a, below) = (alpha[(col, row)], plate[(col, row)]);
        [0, 1, 2].map(|c| {
            let grain = 0.012 * noise((3 * (row * plate.width() + col) + c) as u32 + 77);
            a * FOREGROUND[c] + (1.0 - a) * (1.03 * below[c] - 0.01) + grain
        })
    })
}

fn solve(input: &PlateFrame<'_>) -> PlateMatte {
    plate_matte(input, &PlateParams::default(), &Progress::none()).unwrap()
}

#[test]
fn alpha_and_colors_are_those_of_the_scene() {
    let size = Size::new(160, 120).unwrap();
    let (plate, truth) = (plate(size), disc(size));
    let frame = composite(&plate, &truth);
    let found = solve(&PlateFrame::new(&frame, &plate));
    let mut error = 0.0f64;
    let mut colors = 0.0f64;
    let mut composed = 0.0f64;
    for row in 0..size.height() {
        for col in 0..size.width() {
            let at = (col, row);
            let alpha = found.matte.alpha[at];
            error += f64::from((alpha - truth[at]).abs());
            for c in 0..3 {
                let color = found.matte.foreground[at][c];
                colors += f64::from((truth[at] * (color - FOREGROUND[c])).powi(2));
                let again = alpha * color + (1.0 - alpha) * found.background[at][c];
                composed += f64::from((again - frame[at][c]).powi(2));
            }
        }
    }
    let pixels = size.pixels() as f64;
    assert!(
        error / pixels < 0.004,
        "mean error of alpha {}",
        error / pixels
    );
    assert!(
        (colors / pixels / 3.0).sqrt() < 0.012,
        "colors {}",
        (colors / pixels / 3.0).sqrt()
    );
    // the noise of the scene has a standard deviation of 0.007
    assert!(
        (composed / pixels / 3.0).sqrt() < 0.009,
        "composite {}",
        (composed / pixels / 3.0).sqrt()
    );
    for (gain, offset) in found.light.gain.into_iter().zip(found.light.offset) {
        assert!(
            (gain - 1.03).abs() < 0.01 && (offset + 0.01).abs() < 0.006,
            "{:?}",
            found.light
        );
    }
}

#[test]
fn texture_that_shines_through_a_veil_gives_its_alpha() {
    let size = Size::new(200, 120).unwrap();
    let plate = plate(size);
    // opaque on the left, and a veil of half alpha beside it
    let truth = Plane::from_fn(size, |col, row| match col {
        _ if !(20..100).contains(&row) => 0.0,
        40..90 => 1.0,
        90..150 => 0.5,
        _ => 0.0,
    });
    let found = solve(&PlateFrame::new(&composite(&plate, &truth), &plate));
    let mean = |cols: std::ops::Range<usize>| {
        let count = (cols.len() * 60) as f32;
        let values = (30..90).flat_map(|row| cols.clone().map(move |col| (col, row)));
        values.map(|at| found.matte.alpha[at]).sum::<f32>() / count
    };
    assert!(mean(50..80) > 0.98, "{}", mean(50..80));
    assert!((mean(100..140) - 0.5).abs() < 0.06, "{}", mean(100..140));
}

#[test]
fn drift_of_whole_blocks_is_no_foreground() {
    let size = Size::new(240, 160).unwrap();
    let plate = plate(size);
    let truth = disc(size);
    let drifted = |frame: &Colors| {
        Image::from_fn(size, |col, row| {
            let step = 0.016 * noise((row / 8 * 100 + col / 8) as u32);
            frame[(col, row)].map(|value| value + step)
        })
    };
    let nothing = Plane::new(size, 0.0);
    let empty = drifted(&composite(&plate, &nothing));
    let found = solve(&PlateFrame::new(&empty, &plate));
    assert!(found.matte.alpha.pixels().iter().all(|alpha| *alpha == 0.0));
    let found = solve(&PlateFrame::new(
        &drifted(&composite(&plate, &truth)),
        &plate,
    ));
    let pairs = found.matte.alpha.pixels().iter().zip(truth.pixels());
    let error = pairs.map(|(a, b)| (a - b).abs()).sum::<f32>() / size.pixels() as f32;
    assert!(error < 0.01, "{error}");
}

#[test]
fn a_frame_without_foreground_has_an_empty_matte() {
    let size = Size::new(120, 90).unwrap();
    let plate = plate(size);
    let frame = composite(&plate, &Plane::new(size, 0.0));
    let found = solve(&PlateFrame::new(&frame, &plate));
    assert!(found.matte.alpha.pixels().iter().all(|alpha| *alpha == 0.0));
}

#[test]
fn the_blur_of_a_camera_in_motion_is_followed() {
    let size = Size::new(160, 120).unwrap();
    let (below, truth) = (plate(size), disc(size));
    for blur in [
        BlurCovariance {
            xx: 6.0,
            xy: 0.0,
            yy: 0.3,
        },
        BlurCovariance {
            xx: 3.0,
            xy: 2.0,
            yy: 3.0,
        },
    ] {
        let blurred = elliptic_gaussian_blur(&below, blur);
        let frame = composite(&blurred, &Plane::new(size, 0.0));
        let light = PlateLight::fit(&frame, &below, None);
        let found = light.total_blur();
        let pairs = [
            (found.xx, blur.xx),
            (found.xy, blur.xy),
            (found.yy, blur.yy),
        ];
        for (found, expected) in pairs {
            assert!((found - expected).abs() < 0.5, "{found} for {expected}");
        }
        // the plate is shown as blurred as the frame
        let (shown, _) = light.relit(&below);
        let middle = (20..100).flat_map(|row| (20..140).map(move |col| (col, row)));
        let square = |at: (usize, usize)| {
            let expected = 1.03 * blurred[at][1] - 0.01;
            (shown[at][1] - expected).powi(2)
        };
        let rms = (middle.map(square).sum::<f32>() / (80.0 * 120.0)).sqrt();
        assert!(rms < 0.005, "{rms}");
        let empty = solve(&PlateFrame::new(&frame, &below));
        assert!(empty.matte.alpha.pixels().iter().all(|alpha| *alpha == 0.0));
        // and foreground stays what it is
        let frame = composite(&blurred, &truth);
        let found = solve(&PlateFrame::new(&frame, &below));
        let (left, right) = (found.matte.alpha.pixels(), truth.pixels());
        let sad: f32 = left.iter().zip(right).map(|(a, b)| (a - b).abs()).sum();
        assert!(sad < 120.0, "{sad}");
    }
    // a sharp frame has no blur before its derivatives
    let frame = composite(&below, &truth);
    let light = PlateLight::fit(&frame, &below, None);
    assert_eq!(light.blur, BlurCovariance::default());
}

#[test]
fn strokes_hold_exactly_and_a_shift_of_the_plate_is_found() {
    let size = Size::new(140, 100).unwrap();
    let (below, truth) = (plate(size), disc(size));
    let frame = composite(&below, &truth);
    let strokes = Constraints::from_fn(size, |col, row| match (col, row) {
        (70..80, 50..56) => 0,
        (5..12, 5..9) => 255,
        _ => 128,
    });
    let found = solve(&PlateFrame {
        strokes: Some(&strokes),
        ..PlateFrame::new(&frame, &below)
    });
    for row in 0..size.height() {
        for col in 0..size.width() {
            let alpha = found.matte.alpha[(col, row)];
            match strokes[(col, row)] {
                0 => assert_eq!(alpha, 0.0),
                255 => assert_eq!(alpha, 1.0),
                _ => assert!((0.0..=1.0).contains(&alpha)),
            }
        }
    }
}

#[test]
fn unknown_parts_of_the_plate_are_no_foreground_by_themselves() {
    let size = Size::new(120, 90).unwrap();
    let below = plate(size);
    let frame = composite(&below, &Plane::new(size, 0.0));
    let known = Plane::from_fn(size, |col, row| {
        if (40..70).contains(&col) && (30..60).contains(&row) {
            0.0
        } else {
            1.0
        }
    });
    let mut wrong = below.clone();
    for row in 30..60 {
        wrong.row_mut(row)[40..70].fill([1.0, 0.0, 1.0]);
    }
    let found = solve(&PlateFrame {
        known: Some(&known),
        ..PlateFrame::new(&frame, &wrong)
    });
    assert!(found.matte.alpha.pixels().iter().all(|alpha| *alpha == 0.0));
}

#[test]
fn beyond_the_plate_there_is_no_foreground_but_what_is_connected_to_it() {
    let size = Size::new(160, 120).unwrap();
    let (below, truth) = (plate(size), disc(size));
    let frame = composite(&below, &truth);
    // the plate ends before the frame does, and in the disc
    let known = Plane::from_fn(size, |col, row| {
        let rim = col >= 148 || row >= 112;
        let inside = (76..84).contains(&col) && (62..70).contains(&row);
        if rim || inside { 0.0 } else { 1.0 }
    });
    let cut = Colors::from_fn(size, |col, row| {
        if known[(col, row)] > 0.0 {
            below[(col, row)]
        } else {
            [0.0; 3]
        }
    });
    let found = solve(&PlateFrame {
        known: Some(&known),
        ..PlateFrame::new(&frame, &cut)
    });
    for row in 0..size.height() {
        for col in 0..size.width() {
            let alpha = found.matte.alpha[(col, row)];
            if col >= 140 || row >= 104 {
                assert_eq!(alpha, 0.0, "{col} {row}");
            }
        }
    }
    assert!(found.matte.alpha[(80, 66)] > 0.9);
}

#[test]
fn threads_do_not_change_the_result() {
    let size = Size::new(101, 77).unwrap();
    let below = plate(size);
    let frame = composite(&below, &disc(size));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| solve(&PlateFrame::new(&frame, &below)).matte)
    };
    assert_eq!(on(1), on(4));
}

#[test]
fn small_and_broken_pictures_have_mattes() {
    for (width, height) in [(1, 1), (1, 40), (40, 1), (3, 2), (17, 9)] {
        let size = Size::new(width, height).unwrap();
        let below = plate(size);
        let mut frame = below.map(|[r, g, b]| [1.0 - r, g, 1.0 - b]);
        frame[(width / 2, height / 2)] = [f32::NAN, f32::INFINITY, -3.0];
        let found = solve(&PlateFrame::new(&frame, &below));
        assert!(
            found
                .matte
                .alpha
                .pixels()
                .iter()
                .all(|alpha| (0.0..=1.0).contains(alpha))
        );
    }
}

#[test]
fn other_sizes_and_parameters_out_of_range_are_errors() {
    let frame = plate(Size::new(8, 8).unwrap());
    let other = plate(Size::new(9, 8).unwrap());
    let error = plate_matte(
        &PlateFrame::new(&frame, &other),
        &PlateParams::default(),
        &Progress::none(),
    );
    assert!(matches!(
        error,
        Err(MattingError::SizesDiffer { what: "plate", .. })
    ));
    let error = plate_matte(
        &PlateFrame::new(&frame, &frame),
        &PlateParams {
            snap: 0.3,
            ..PlateParams::default()
        },
        &Progress::none(),
    );
    assert!(matches!(
        error,
        Err(MattingError::Parameter { field: "snap", .. })
    ));
    let progress = Progress::none();
    progress.cancel();
    let error = plate_matte(
        &PlateFrame::new(&frame, &frame),
        &PlateParams::default(),
        &progress,
    );
    assert!(matches!(error, Err(MattingError::Cancelled(_))));
}

/// Factor of a shadow beside the disc: 0.6 in its middle, with a penumbra.
fn shade(size: Size) -> Plane {
    Image::from_fn(size, |col, row| {
        let (x, y) = (
            col as f32 - 0.78 * size.width() as f32,
            row as f32 - 0.8 * size.height() as f32,
        );
        let distance = (x / 2.0).hypot(y);
        1.0 - 0.4 * ((9.0 - distance) / 3.0 + 0.5).clamp(0.0, 1.0)
    })
}

#[test]
fn shadows_are_kept_softened_and_dropped() {
    let size = Size::new(200, 140).unwrap();
    let (plate, truth, shade) = (plate(size), disc(size), shade(size));
    let shaded = Image::from_fn(size, |col, row| {
        plate[(col, row)].map(|value| value * shade[(col, row)])
    });
    let frame = composite(&shaded, &truth);
    let run = |shadows: Shadows| {
        let params = PlateParams {
            shadows,
            ..PlateParams::default()
        };
        plate_matte(&PlateFrame::new(&frame, &plate), &params, &Progress::none()).unwrap()
    };
    // the middle of the shadow, away from the disc and from the penumbra
    let middle: Vec<(usize, usize)> = (0..size.height())
        .flat_map(|row| (0..size.width()).map(move |col| (col, row)))
        .filter(|&at| shade[at] < 0.61 && truth[at] <= 0.0)
        .collect();
    assert!(middle.len() > 150);
    let mean = |found: &PlateMatte| {
        let sum: f32 = middle.iter().map(|&at| found.matte.alpha[at]).sum();
        sum / middle.len() as f32
    };
    assert!(mean(&run(Shadows::Foreground)) > 0.3);
    let kept = run(Shadows::Keep);
    assert!((mean(&kept) - 0.4).abs() < 0.04, "{}", mean(&kept));
    for &at in &middle {
        let again = [0, 1, 2].map(|c| {
            let alpha = kept.matte.alpha[at];
            alpha * kept.matte.foreground[at][c] + (1.0 - alpha) * kept.background[at][c]
        });
        for c in 0..3 {
            assert!((again[c] - frame[at][c]).abs() < 0.08, "{at:?}");
        }
    }
    let softened = run(Shadows::Soften);
    assert!((mean(&softened) - 0.2).abs() < 0.02, "{}", mean(&softened));
    let dropped = run(Shadows::Drop);
    assert!(mean(&dropped) < 0.01, "{}", mean(&dropped));
    // the disc stays
    for row in 0..size.height() {
        for col in 0..size.width() {
            if truth[(col, row)] >= 1.0 {
                assert!(dropped.matte.alpha[(col, row)] > 0.9, "{col} {row}");
            }
        }
    }
}

#[test]
fn a_stroke_is_solved_near_it_as_in_the_whole_frame() {
    let size = Size::new(320, 240).unwrap();
    let (plate, truth) = (plate(size), disc(size));
    let frame = composite(&plate, &truth);
    let mut near = solve(&PlateFrame::new(&frame, &plate));
    let before = near.clone();
    // background over a part of the rim, foreground beside the disc
    let region = Rect::new(180, 90, 60, 50);
    let strokes: Constraints = Image::from_fn(size, |col, row| match (col, row) {
        (190..205, 100..115) => 0,
        (225..235, 120..130) => 255,
        _ => 128,
    });
    let input = PlateFrame {
        strokes: Some(&strokes),
        ..PlateFrame::new(&frame, &plate)
    };
    plate_matte_near(
        &input,
        &PlateParams::default(),
        &mut near,
        region,
        &Progress::none(),
    )
    .unwrap();
    let whole = solve(&input);
    let mut error = 0.0;
    for row in 0..size.height() {
        for col in 0..size.width() {
            let at = (col, row);
            if region.contains(col, row) {
                error += (near.matte.alpha[at] - whole.matte.alpha[at]).abs();
            } else {
                assert!(near.matte.alpha[at] == before.matte.alpha[at]);
            }
        }
    }
    let error = error / region.pixels() as f32;
    assert!(error < 0.02, "mean difference of alpha {error}");
    assert_eq!(near.matte.alpha[(195, 105)], 0.0);
    assert_eq!(near.matte.alpha[(230, 125)], 1.0);
    // a region outside changes nothing, one of another size is refused
    let copy = near.clone();
    let outside = Rect::new(900, 900, 10, 10);
    plate_matte_near(
        &input,
        &PlateParams::default(),
        &mut near,
        outside,
        &Progress::none(),
    )
    .unwrap();
    assert!(near.matte == copy.matte);
    let small = Colors::new(Size::new(8, 8).unwrap(), [0.0; 3]);
    let other = PlateFrame::new(&small, &small);
    let refused = plate_matte_near(
        &other,
        &PlateParams::default(),
        &mut near,
        region,
        &Progress::none(),
    );
    assert!(matches!(refused, Err(MattingError::SizesDiffer { .. })));
}
