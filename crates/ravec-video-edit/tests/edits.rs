//! Edits of frames whose parts are known.

use glam::dvec2;
use ravec_planar::Homography;
use ravec_progress::Progress;
use ravec_raster::{Image, Plane, ResizeFilter, Size, resize};
use ravec_video_edit::{Colors, Enhancement, Layer, Removal, Tone, VideoEditError, contact_shadow};

fn size() -> Size {
    Size::new(120, 90).unwrap()
}

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

fn background(x: f32, y: f32) -> [f32; 3] {
    let wave = 0.15 * (0.3 * x).sin() * (0.25 * y).cos();
    [0.5 + wave, 0.5 - wave, 0.4]
}

struct Scene {
    frame: Colors,
    alpha: Plane,
    background: Colors,
    known: Plane,
}

/// A disc with a soft rim before a wall, with noise of `strength`.
fn scene(strength: f32) -> Scene {
    let alpha = Plane::from_fn(size(), |col, row| {
        let distance = (col as f32 - 60.0).hypot(row as f32 - 45.0);
        ((18.0 - distance) / 5.0 + 0.5).clamp(0.0, 1.0)
    });
    let background = Image::from_fn(size(), |col, row| background(col as f32, row as f32));
    let frame = Image::from_fn(size(), |col, row| {
        let at = (col, row);
        [0, 1, 2].map(|c| {
            let front = [0.8, 0.15, 0.2][c];
            let grain = strength * noise((3 * (row * 120 + col) + c) as u32);
            alpha[at] * front + (1.0 - alpha[at]) * background[at][c] + grain
        })
    });
    Scene {
        frame,
        alpha,
        background,
        known: Plane::new(size(), 1.0),
    }
}

fn removed(scene: &Scene, grain: Option<u64>) -> Colors {
    let removal = Removal {
        frame: &scene.frame,
        alpha: &scene.alpha,
        background: &scene.background,
        known: &scene.known,
        grain,
    };
    removal.result().unwrap()
}

/// Standard deviation of the difference to the background where alpha is 1, in the first channel.
fn deviation(scene: &Scene, found: &Colors) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (at, alpha) in scene.alpha.pixels().iter().enumerate() {
        if *alpha == 1.0 {
            let apart = found.pixels()[at][0] - scene.background.pixels()[at][0];
            sum += f64::from(apart * apart);
            count += 1;
        }
    }
    (sum / f64::from(count)).sqrt()
}

#[test]
fn a_layer_over_its_own_background_is_the_frame() {
    let scene = scene(0.0);
    let layer = Layer::new(&scene.frame, &scene.alpha, &scene.background).unwrap();
    let again = layer.over(&scene.background).unwrap();
    for (found, truth) in again.pixels().iter().zip(scene.frame.pixels()) {
        assert!((0..3).all(|c| (found[c] - truth[c]).abs() < 1e-5));
    }
    let moved = layer
        .warped(
            &Homography::from_translation(dvec2(-10.0, 5.0)).unwrap(),
            size(),
            &Progress::none(),
        )
        .unwrap();
    assert_eq!(moved.pixels()[(70, 40)], layer.pixels()[(60, 45)]);
    assert_eq!(moved.pixels()[(2, 2)], [0.0; 4]);
    let front = Plane::from_fn(size(), |col, _| f32::from(u8::from(col < 60)));
    let half = layer.behind(&front).unwrap();
    assert_eq!(half.pixels()[(55, 45)], [0.0; 4]);
    assert_eq!(half.pixels()[(65, 45)], layer.pixels()[(65, 45)]);
}

#[test]
fn removal_shows_the_plate_and_keeps_what_is_far() {
    let scene = scene(0.02);
    let clean = removed(&scene, None);
    assert!(deviation(&scene, &clean) < 1e-6);
    for row in 0..90 {
        for col in 0..120 {
            let distance = (col as f32 - 60.0).hypot(row as f32 - 45.0);
            if distance > 18.0 + 2.5 + 8.0 {
                assert_eq!(clean[(col, row)], scene.frame[(col, row)]);
            }
        }
    }
}

#[test]
fn grain_is_that_of_the_frame_and_differs_between_frames() {
    let scene = scene(0.02);
    let first = removed(&scene, Some(7));
    // noise that is even from −1 to 1 has a deviation of 1/√3
    let ratio = deviation(&scene, &first) / (0.02 / 3.0f64.sqrt());
    assert!((0.85..1.15).contains(&ratio), "{ratio}");
    assert_eq!(first, removed(&scene, Some(7)));
    assert_ne!(first, removed(&scene, Some(8)));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    assert_eq!(first, pool.unwrap().install(|| removed(&scene, Some(7))));
}

#[test]
fn frames_stay_where_the_plate_is_unknown_or_nothing_is_in_front() {
    let mut unknown = scene(0.01);
    unknown.known = Plane::new(size(), 0.0);
    assert_eq!(removed(&unknown, Some(1)), unknown.frame);
    let mut empty = scene(0.01);
    empty.alpha = Plane::new(size(), 0.0);
    assert_eq!(removed(&empty, Some(1)), empty.frame);
    let mut all = scene(0.01);
    all.alpha = Plane::new(size(), 1.0);
    // there is no place from which grain could come
    assert_eq!(removed(&all, Some(1)), all.background);
}

#[test]
fn a_tone_is_found_and_a_photo_sharpens_the_background() {
    let double = Size::new(240, 180).unwrap();
    let sharp = Image::from_fn(double, |col, row| {
        let (x, y) = ((col as f32 - 0.5) / 2.0, (row as f32 - 0.5) / 2.0);
        let detail = 0.05 * (2.6 * x + 0.7 * y).sin();
        background(x, y).map(|value| value + detail)
    });
    let curve = |value: f32| 0.05 + 0.8 * value + 0.1 * value * value;
    let darker = sharp.map(|color| color.map(|value| (value - 0.05) / 0.85));
    let tone = Tone::fit(
        &sharp,
        &sharp.map(|color| color.map(curve)),
        &Plane::new(double, 1.0),
    );
    let tone = tone.unwrap();
    for value in [0.3, 0.5, 0.7] {
        assert!((tone.applied([value; 3])[1] - curve(value)).abs() < 0.003);
    }
    // the frame: the photo in other light, half as large, behind a disc
    let plain = scene(0.0);
    let small = |channel: usize| {
        resize(
            &sharp.map(|color| color[channel]),
            size(),
            ResizeFilter::Box,
        )
    };
    let small = [0, 1, 2].map(small);
    let frame = Image::from_fn(size(), |col, row| {
        let at = (col, row);
        let alpha = plain.alpha[at];
        [0, 1, 2].map(|c| alpha * [0.8, 0.15, 0.2][c] + (1.0 - alpha) * small[c][at])
    });
    let enhancement = Enhancement {
        frame: &frame,
        alpha: &plain.alpha,
        photo: Image::from_fn(double, |col, row| {
            let [r, g, b] = darker[(col, row)];
            [r, g, b, f32::from(u8::from(col < 200))]
        }),
    };
    let found = enhancement.result().unwrap();
    let mut largest = 0.0f32;
    for row in 2..178 {
        for col in 2..195 {
            let distance = (col as f32 / 2.0 - 60.0).hypot(row as f32 / 2.0 - 45.0);
            if distance > 24.0 {
                for c in 0..3 {
                    largest = largest.max((found[(col, row)][c] - sharp[(col, row)][c]).abs());
                }
            }
        }
    }
    assert!(largest < 0.01, "{largest}");
    // in front, the foreground
    assert!((found[(120, 90)][0] - 0.8).abs() < 0.02);
}

#[test]
fn a_contact_shadow_lies_at_the_foot() {
    let scene = scene(0.0);
    let layer = Layer::new(&scene.frame, &scene.alpha, &scene.background).unwrap();
    let light = contact_shadow(&layer, 0.15, 2.0, 0.5);
    assert!(light[(60, 60)] < 0.7, "{}", light[(60, 60)]);
    assert!(light[(60, 20)] > 0.99 && light[(5, 60)] > 0.99);
    let nothing = Layer::new(
        &scene.background,
        &Plane::new(size(), 0.0),
        &scene.background,
    );
    let light = contact_shadow(&nothing.unwrap(), 0.15, 2.0, 0.5);
    assert!(light.pixels().iter().all(|share| *share == 1.0));
}

#[test]
fn other_sizes_are_errors() {
    let scene = scene(0.0);
    let other = Plane::new(Size::new(3, 3).unwrap(), 0.0);
    let refused = Layer::new(&scene.frame, &other, &scene.background);
    assert!(matches!(refused, Err(VideoEditError::SizesDiffer { .. })));
    let removal = Removal {
        frame: &scene.frame,
        alpha: &other,
        background: &scene.background,
        known: &scene.known,
        grain: None,
    };
    assert!(removal.result().is_err());
    let enhancement = Enhancement {
        frame: &scene.frame,
        alpha: &scene.alpha,
        photo: scene.frame.map(|[r, g, b]| [r, g, b, 1.0]),
    };
    assert!(enhancement.result().is_err());
}
