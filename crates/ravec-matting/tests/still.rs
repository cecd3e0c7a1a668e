//! Mattes by a trimap, on scenes with known alpha.

use ravec_matting::{Colors, Constraints, MattingError, StillMatte, still_matte};
use ravec_progress::Progress;
use ravec_raster::{Image, Plane, Size};

/// A number from −1 to 1 that looks random.
fn noise(seed: u32) -> f32 {
    let mut x = seed.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x as f32 / u32::MAX as f32 * 2.0 - 1.0
}

struct Scene {
    alpha: Plane,
    foreground: Colors,
    background: Colors,
    picture: Colors,
    trimap: Constraints,
}

/// A disc with a soft rim and shaded colors before a smooth background, with noise of the last bit.
fn scene(size: Size) -> Scene {
    let (x, y) = (size.width() as f32 * 0.5, size.height() as f32 * 0.5);
    let radius = size.height() as f32 * 0.28;
    let distance = |col: usize, row: usize| (col as f32 + 0.5 - x).hypot(row as f32 + 0.5 - y);
    let alpha = Plane::from_fn(size, |col, row| {
        ((radius - distance(col, row)) / 10.0 + 0.5).clamp(0.0, 1.0)
    });
    let foreground = Image::from_fn(size, |col, row| {
        let wave = 0.1 * (0.05 * col as f32 + 0.09 * row as f32).sin();
        [0.8 + wave, 0.3 - wave, 0.25]
    });
    let background = Image::from_fn(size, |col, row| {
        let wave = 0.1 * (0.07 * row as f32 - 0.04 * col as f32).cos();
        [0.3 - wave, 0.5 + wave, 0.65 + wave]
    });
    let picture = Image::from_fn(size, |col, row| {
        let at = (col, row);
        let a = alpha[at];
        [0, 1, 2].map(|c| {
            let grain = 0.004 * noise((3 * (row * size.width() + col) + c) as u32);
            a * foreground[at][c] + (1.0 - a) * background[at][c] + grain
        })
    });
    let trimap = Image::from_fn(size, |col, row| match distance(col, row) - radius {
        d if d > 9.0 => 0,
        d if d < -9.0 => 255,
        _ => 128,
    });
    Scene {
        alpha,
        foreground,
        background,
        picture,
        trimap,
    }
}

fn solve(scene: &Scene) -> StillMatte {
    still_matte(&scene.picture, &scene.trimap, &Progress::none()).unwrap()
}

/// Mean over the unknown pixels.
fn mean(scene: &Scene, f: impl Fn((usize, usize)) -> f32) -> f32 {
    let (mut sum, mut count) = (0.0, 0);
    for row in 0..scene.alpha.height() {
        for col in 0..scene.alpha.width() {
            if scene.trimap[(col, row)] == 128 {
                sum += f((col, row));
                count += 1;
            }
        }
    }
    sum / count as f32
}

fn apart(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max)
}

#[test]
fn alpha_and_colors_are_those_of_the_scene() {
    let scene = scene(Size::new(160, 120).unwrap());
    let found = solve(&scene);
    let alpha = mean(&scene, |at| (found.matte.alpha[at] - scene.alpha[at]).abs());
    assert!(alpha < 0.02, "alpha differs by {alpha}");
    let foreground = mean(&scene, |at| {
        scene.alpha[at] * apart(found.matte.foreground[at], scene.foreground[at])
    });
    let background = mean(&scene, |at| {
        (1.0 - scene.alpha[at]) * apart(found.background[at], scene.background[at])
    });
    assert!(
        foreground < 0.02 && background < 0.02,
        "{foreground} {background}"
    );
    let composed = mean(&scene, |at| {
        let a = found.matte.alpha[at];
        let [front, back] = [found.matte.foreground[at], found.background[at]];
        apart(
            [0, 1, 2].map(|c| a * front[c] + (1.0 - a) * back[c]),
            scene.picture[at],
        )
    });
    assert!(composed < 1e-5, "composites differ by {composed}");
}

#[test]
fn marked_pixels_keep_their_alpha_and_colors() {
    let scene = scene(Size::new(97, 71).unwrap());
    let found = solve(&scene);
    for (at, mark) in scene.trimap.pixels().iter().enumerate() {
        let color = scene.picture.pixels()[at];
        let alpha = found.matte.alpha.pixels()[at];
        match mark {
            255 => assert!(alpha == 1.0 && found.matte.foreground.pixels()[at] == color),
            0 => assert!(alpha == 0.0 && found.background.pixels()[at] == color),
            _ => assert!((0.0..=1.0).contains(&alpha)),
        }
    }
}

#[test]
fn few_strokes_find_the_disc() {
    let mut scene = scene(Size::new(160, 120).unwrap());
    scene.trimap = Image::from_fn(scene.alpha.size(), |col, row| {
        let front = (70..90).contains(&col) && (58..62).contains(&row);
        let back = (4..8).contains(&col) || (110..114).contains(&row);
        if front {
            255
        } else if back {
            0
        } else {
            128
        }
    });
    let found = solve(&scene);
    let error = mean(&scene, |at| (found.matte.alpha[at] - scene.alpha[at]).abs());
    assert!(error < 0.02, "alpha differs by {error}");
}

#[test]
fn the_same_bytes_on_any_number_of_threads() {
    let scene = scene(Size::new(120, 90).unwrap());
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| solve(&scene))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn tiny_pictures_and_values_that_are_not_numbers() {
    for (width, height) in [(2, 1), (1, 2), (3, 3), (5, 2)] {
        let size = Size::new(width, height).unwrap();
        let mut trimap = Constraints::new(size, 128);
        trimap.pixels_mut()[0] = 255;
        *trimap.pixels_mut().last_mut().unwrap() = 0;
        let colors = [f32::NAN, f32::INFINITY, -1e30, 0.5];
        let picture = Image::from_fn(size, |col, row| [colors[(col + 2 * row) % 4], 0.5, 0.25]);
        let found = still_matte(&picture, &trimap, &Progress::none()).unwrap();
        let alpha = found.matte.alpha.pixels();
        assert!(alpha.iter().all(|alpha| (0.0..=1.0).contains(alpha)));
        let colors = found.matte.foreground.pixels().iter().flatten();
        assert!(
            colors
                .chain(found.background.pixels().iter().flatten())
                .all(|v| !v.is_nan())
        );
    }
}

#[test]
fn wrong_sizes_missing_sides_and_cancellation() {
    let scene = scene(Size::new(64, 48).unwrap());
    let run = |trimap: &Constraints, progress: &Progress| {
        still_matte(&scene.picture, trimap, progress).unwrap_err()
    };
    let other = Constraints::new(Size::new(64, 47).unwrap(), 0);
    assert!(matches!(
        run(&other, &Progress::none()),
        MattingError::SizesDiffer { .. }
    ));
    let black = Constraints::new(scene.alpha.size(), 0);
    assert_eq!(
        run(&black, &Progress::none()),
        MattingError::Unmarked("foreground")
    );
    let gray = Constraints::from_fn(scene.alpha.size(), |col, _| if col < 9 { 255 } else { 128 });
    assert_eq!(
        run(&gray, &Progress::none()),
        MattingError::Unmarked("background")
    );
    let progress = Progress::none();
    progress.cancel();
    assert!(matches!(
        run(&scene.trimap, &progress),
        MattingError::Cancelled(_)
    ));
}
