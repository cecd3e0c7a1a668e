//! Clips whose motion is an input: a large still under a planted homography, with noise, light and moving objects.

use crate::camera::{
    CameraMotion, CameraMotionError, CameraMotionParams, FrameMotion, MotionModel,
};
use crate::features::encoded_luminance;
use crate::homography::Homography;
use glam::{DMat3, DVec2, dvec2};
use ravec_raster::{Image, LinearRgb, Plane, Size, Srgb, gaussian_blur};
use ravec_scenes::Seed;
use ravec_scenes::plane::facade;
use ravec_scenes::street::street;
use ravec_scenes::texture::{cellular, fractal};
use std::sync::LazyLock;

const WIDTH: usize = 640;
const HEIGHT: usize = 360;

fn size() -> Size {
    Size::new(WIDTH, HEIGHT).unwrap()
}

fn center() -> DVec2 {
    0.5 * dvec2(WIDTH as f64, HEIGHT as f64)
}

/// The world of the clips: frames see a part of it, about as large as they are.
fn world_size() -> Size {
    Size::new(1400, 800).unwrap()
}

static STREET: LazyLock<Plane> = LazyLock::new(|| luma(&street(world_size(), Seed(3)).0));
static FACADE: LazyLock<Plane> = LazyLock::new(|| luma(&facade(world_size(), Seed(5)).0));

fn luma(image: &Image<LinearRgb>) -> Plane {
    // what a camera sees is softer than what is painted
    gaussian_blur(&encoded_luminance(&image.convert::<Srgb<u8>>()), 0.6)
}

/// A view of the world: shifted from its middle, turned, zoomed and tilted.
#[derive(Clone, Copy, Default)]
struct View {
    shift: DVec2,
    turn: f64,
    zoom: f64,
    tilt: DVec2,
}

impl View {
    fn frame_from_world(&self) -> Homography {
        let middle = 0.5 * dvec2(world_size().width() as f64, world_size().height() as f64);
        let mut tilt = DMat3::IDENTITY;
        tilt.x_axis.z = self.tilt.x;
        tilt.y_axis.z = self.tilt.y;
        let zoom = DVec2::splat(1.0 + self.zoom);
        Homography::from_matrix(
            DMat3::from_translation(center())
                * tilt
                * DMat3::from_scale_angle_translation(zoom, self.turn, self.shift)
                * DMat3::from_translation(-middle),
        )
        .unwrap()
    }
}

/// Content of a frame besides the world.
#[derive(Clone, Copy)]
struct Damage {
    noise: f64,
    gain: f32,
    bias: f32,
    blur_px: f64,
    /// Center and half extents of a textured object that moves by itself.
    object: Option<(DVec2, DVec2)>,
}

const CLEAN: Damage = Damage {
    noise: 0.0,
    gain: 1.0,
    bias: 0.0,
    blur_px: 0.0,
    object: None,
};

fn frame(world: &Plane, view: &View, damage: &Damage, seed: u64) -> Plane {
    let world_from_frame = view.frame_from_world().inverse();
    let mut frame = Plane::from_fn(size(), |col, row| {
        let at = dvec2(col as f64 + 0.5, row as f64 + 0.5);
        if let Some((middle, half)) = damage.object
            && ((at - middle).abs() - half).max_element() < 0.0
        {
            let p = at - middle;
            let cell = cellular(p / 21.0, Seed(8)).tint;
            return (0.45 + 0.25 * fractal(p / 40.0, 0.02, 4, Seed(9)) + 0.1 * cell) as f32;
        }
        world.catmull_rom(world_from_frame.apply(at))
    });
    if damage.blur_px > 0.0 {
        frame = gaussian_blur(&frame, damage.blur_px);
    }
    let noise = Seed(seed);
    for (index, value) in (0i64..).zip(frame.pixels_mut()) {
        let grain = if damage.noise > 0.0 {
            damage.noise * noise.gaussian(index % 4096, index / 4096, 0)
        } else {
            0.0
        };
        let seen = damage.gain * *value + damage.bias + grain as f32;
        // 8 bits, as from a file
        *value = (seen * 255.0).round().clamp(0.0, 255.0) / 255.0;
    }
    frame
}

/// The root mean square error at the frame's corners, and the largest, in pixels.
fn corner_error(found: &Homography, truth: &Homography) -> f64 {
    let (w, h) = (WIDTH as f64, HEIGHT as f64);
    let corners = [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)].map(|(x, y)| dvec2(x, y));
    let errors = corners.map(|p| found.apply(p).distance(truth.apply(p)));
    errors.iter().copied().fold(0.0, f64::max)
}

/// Errors of a clip at the corners, in pixels: the largest of a frame, the mean of the frames, and that of the way from the
/// first frame to the last.
#[derive(Debug)]
struct Errors {
    largest: f64,
    mean: f64,
    accumulated: f64,
    cuts: usize,
    unreliable: usize,
}

fn run(clip: &[(View, Damage)], world: &Plane) -> (Vec<FrameMotion>, Errors) {
    let mut camera = CameraMotion::new(size(), &CameraMotionParams::default()).unwrap();
    let motions: Vec<FrameMotion> = clip
        .iter()
        .enumerate()
        .map(|(t, (view, damage))| camera.push(&frame(world, view, damage, t as u64)))
        .collect();
    let from_world = |t: usize| clip[t].0.frame_from_world();
    let mut errors = Errors {
        largest: 0.0,
        mean: 0.0,
        accumulated: 0.0,
        cuts: motions[1..].iter().filter(|m| m.cut).count(),
        unreliable: motions.iter().filter(|m| !m.reliable).count(),
    };
    for (t, motion) in motions.iter().enumerate().skip(1) {
        let truth = from_world(t) * from_world(t - 1).inverse();
        let error = corner_error(&motion.frame_from_previous, &truth);
        errors.largest = errors.largest.max(error);
        errors.mean += error / (clip.len() - 1) as f64;
        let way = from_world(t) * from_world(0).inverse();
        errors.accumulated = errors
            .accumulated
            .max(corner_error(&motion.frame_from_shot, &way));
    }
    (motions, errors)
}

fn clip(count: usize, at: impl Fn(f64) -> (View, Damage)) -> Vec<(View, Damage)> {
    (0..count).map(|t| at(t as f64)).collect()
}

/// Hands: slow sway and a tremor, in all eight numbers.
fn hand_held(t: f64) -> View {
    let sway = |period: f64, phase: f64| (std::f64::consts::TAU * t / period + phase).sin();
    View {
        shift: dvec2(
            30.0 * sway(71.0, 0.0) + 3.0 * sway(11.3, 1.0),
            14.0 * sway(53.0, 1.0) + 2.5 * sway(9.1, 2.0),
        ),
        turn: 0.02 * sway(61.0, 0.5) + 0.003 * sway(8.7, 0.2),
        zoom: 0.02 * sway(83.0, 0.3),
        tilt: dvec2(4e-5 * sway(47.0, 0.1), 3e-5 * sway(59.0, 0.7)),
    }
}

#[test]
fn a_still_camera_has_no_motion_at_all_whatever_passes_through_the_picture() {
    let clip = clip(100, |t| {
        let damage = Damage {
            noise: 5.0 / 255.0,
            gain: 1.0 + 0.1 * (t / 17.0).sin() as f32,
            bias: 0.02 * (t / 29.0).sin() as f32,
            object: Some((dvec2(9.0 * t - 150.0, 200.0), dvec2(150.0, 130.0))),
            ..CLEAN
        };
        (View::default(), damage)
    });
    let (motions, errors) = run(&clip, &STREET);
    println!("still: {errors:?}");
    for motion in &motions[1..] {
        assert!(!motion.cut && motion.reliable);
        assert_eq!(motion.frame_from_previous.matrix(), DMat3::IDENTITY);
        assert_eq!(motion.frame_from_shot.matrix(), DMat3::IDENTITY);
    }
}

#[test]
fn a_hand_held_shot_of_100_frames_does_not_drift() {
    for (world, noise) in [(&*STREET, 2.0), (&*FACADE, 5.0)] {
        let clip = clip(100, |t| {
            let damage = Damage {
                noise: noise / 255.0,
                gain: 1.0 + 0.15 * (t / 20.0).sin() as f32,
                ..CLEAN
            };
            (hand_held(t), damage)
        });
        let (_, errors) = run(&clip, world);
        println!("hand-held: {errors:?}");
        assert!(errors.cuts == 0 && errors.unreliable == 0);
        assert!(errors.accumulated < 1.0 && errors.mean < 0.2 && errors.largest < 0.7);
    }
}

#[test]
fn an_object_over_two_fifths_of_the_picture_does_not_pull() {
    // it enters from the left, moves against the camera, and leaves
    let clip = clip(50, |t| {
        let half = dvec2(0.4 * WIDTH as f64 / 2.0, HEIGHT as f64);
        let damage = Damage {
            noise: 2.0 / 255.0,
            object: Some((dvec2(22.0 * t - 140.0, 180.0), half)),
            ..CLEAN
        };
        (hand_held(t), damage)
    });
    let (_, errors) = run(&clip, &STREET);
    println!("object: {errors:?}");
    assert!(errors.cuts == 0);
    // the corners behind the object are extrapolated, and key frames that are replaced meanwhile add up their errors
    assert!(errors.accumulated < 4.0 && errors.mean < 0.5 && errors.largest < 2.0);
}

#[test]
fn a_fast_pan_with_blur_is_followed() {
    // up to 15 % of the width a frame, and back
    for speed in [20.0, 60.0, 96.0] {
        let clip = clip(14, |t| {
            let way = if t < 7.0 { t - 3.0 } else { 10.0 - t };
            let view = View {
                shift: dvec2(speed * way, 0.1 * speed * way),
                ..View::default()
            };
            let damage = Damage {
                noise: 3.0 / 255.0,
                blur_px: 1.5,
                ..CLEAN
            };
            (view, damage)
        });
        let (_, errors) = run(&clip, &STREET);
        println!("pan of {speed}: {errors:?}");
        assert!(errors.cuts == 0 && errors.unreliable == 0);
        assert!(errors.largest < 1.0 && errors.mean < 0.4);
    }
}

#[test]
fn a_camera_that_moves_and_stops_is_still_afterwards() {
    let clip = clip(40, |t| {
        let view = View {
            shift: dvec2(2.5 * t.min(20.0), 0.0),
            ..View::default()
        };
        let damage = Damage {
            noise: 3.0 / 255.0,
            ..CLEAN
        };
        (view, damage)
    });
    let (motions, errors) = run(&clip, &FACADE);
    println!("stop: {errors:?}");
    assert!(errors.accumulated < 0.3, "{errors:?}");
    for motion in &motions[24..] {
        assert_eq!(motion.frame_from_previous.matrix(), DMat3::IDENTITY);
    }
}

#[test]
fn slow_pans_are_followed_though_each_step_is_below_the_noise() {
    let clip = clip(60, |t| {
        let view = View {
            shift: dvec2(0.05 * t, 0.02 * t),
            ..View::default()
        };
        let damage = Damage {
            noise: 4.0 / 255.0,
            ..CLEAN
        };
        (view, damage)
    });
    let (_, errors) = run(&clip, &STREET);
    println!("slow: {errors:?}");
    assert!(errors.accumulated < 0.3);
}

#[test]
fn steps_of_light_and_flashes_are_no_cuts() {
    let clip = clip(30, |t| {
        let (gain, bias) = match t as usize {
            5..=9 => (1.35, 0.05),
            14..=16 => (0.5, 0.0),
            // white
            20 | 21 => (0.02, 0.97),
            25 => (1.8, 0.25),
            _ => (1.0, 0.0),
        };
        let damage = Damage {
            noise: 2.0 / 255.0,
            gain,
            bias,
            ..CLEAN
        };
        (hand_held(t), damage)
    });
    let (motions, errors) = run(&clip, &STREET);
    println!("light: {errors:?}");
    let cuts: Vec<usize> = (1..30).filter(|&t| motions[t].cut).collect();
    assert!(cuts.is_empty(), "{cuts:?}");
    // the white frames themselves are not known
    assert!(!motions[20].reliable && !motions[21].reliable);
    assert!(errors.accumulated < 30.0);
    let way = clip[29].0.frame_from_world() * clip[0].0.frame_from_world().inverse();
    assert!(corner_error(&motions[29].frame_from_shot, &way) < 1.0);
}

#[test]
fn cuts_are_found_where_they_are() {
    let worlds = [&*STREET, &*FACADE];
    let mut camera = CameraMotion::new(size(), &CameraMotionParams::default()).unwrap();
    let damage = Damage {
        noise: 3.0 / 255.0,
        ..CLEAN
    };
    for t in 0..48usize {
        // another world, or another part of the same one, every 12 frames
        let mut view = hand_held(t as f64);
        if (t / 12) % 4 >= 2 {
            view.shift += dvec2(-330.0, 190.0);
            view.zoom += 0.3;
        }
        let world = worlds[(t / 12) % 2];
        let motion = camera.push(&frame(world, &view, &damage, t as u64));
        assert_eq!(motion.cut, t % 12 == 0, "{t}: {motion:?}");
        if motion.cut {
            assert_eq!(motion.frame_from_previous.matrix(), DMat3::IDENTITY);
        }
    }
}

#[test]
fn an_object_that_passes_close_is_no_cut() {
    // it covers everything for some frames
    let clip = clip(30, |t| {
        let half = dvec2(420.0, HEIGHT as f64);
        let damage = Damage {
            noise: 2.0 / 255.0,
            blur_px: 1.0,
            object: Some((dvec2(60.0 * t - 500.0, 180.0), half)),
            ..CLEAN
        };
        (hand_held(t), damage)
    });
    let (_, errors) = run(&clip, &STREET);
    println!("close: {errors:?}");
    assert_eq!(errors.cuts, 0);
}

#[test]
fn without_texture_there_is_no_motion_and_no_trust() {
    let mut camera = CameraMotion::new(size(), &CameraMotionParams::default()).unwrap();
    for t in 0..8u64 {
        let noise = Seed(t);
        let flat = Plane::from_fn(size(), |col, row| {
            let slope = (col + row) as f32 / 4000.0;
            0.4 + slope + 0.012 * noise.gaussian(col as i64, row as i64, 0) as f32
        });
        let motion = camera.push(&flat);
        assert_eq!(motion.cut, t == 0);
        assert_eq!(motion.frame_from_previous.matrix(), DMat3::IDENTITY);
        assert_eq!(motion.reliable, t == 0);
    }
}

#[test]
fn little_texture_gives_a_simple_motion() {
    // a few soft blobs on a plain wall
    let blobs = |shift: DVec2| {
        let mut pixels = Plane::from_fn(size(), |col, row| {
            let p = dvec2(col as f64, row as f64) - shift;
            let sum: f64 = [
                (210.0, 150.0),
                (300.0, 240.0),
                (390.0, 130.0),
                (420.0, 220.0),
            ]
            .iter()
            .map(|&(x, y)| (-(p - dvec2(x, y)).length_squared() / 300.0).exp())
            .sum();
            (0.6 - 0.3 * sum) as f32
        });
        let noise = Seed((shift.x * 16.0) as u64);
        for (index, value) in (0i64..).zip(pixels.pixels_mut()) {
            *value += 0.01 * noise.gaussian(index % 640, index / 640, 1) as f32;
        }
        pixels
    };
    let mut camera = CameraMotion::new(size(), &CameraMotionParams::default()).unwrap();
    camera.push(&blobs(DVec2::ZERO));
    for t in 1..20 {
        let motion = camera.push(&blobs(dvec2(4.0, -1.5) * f64::from(t)));
        let truth = Homography::from_translation(dvec2(4.0, -1.5)).unwrap();
        let error = corner_error(&motion.frame_from_previous, &truth);
        assert!(!motion.cut && error < 1.5, "{t}: {error} {motion:?}");
    }
}

#[test]
fn the_model_is_as_general_as_asked_for() {
    let views = [hand_held(3.0), hand_held(9.0)];
    for (model, parts) in [(MotionModel::Translation, 2), (MotionModel::Affine, 6)] {
        let params = CameraMotionParams {
            model,
            ..CameraMotionParams::default()
        };
        let mut camera = CameraMotion::new(size(), &params).unwrap();
        camera.push(&frame(&STREET, &views[0], &CLEAN, 0));
        let rows = camera
            .push(&frame(&STREET, &views[1], &CLEAN, 1))
            .frame_from_previous
            .to_rows();
        assert!(rows[6].abs() < 1e-12 && rows[7].abs() < 1e-12);
        if parts == 2 {
            assert!((rows[0] - 1.0).abs() < 1e-9 && rows[1].abs() < 1e-9);
        }
        assert!(rows[2].abs() > 1.0);
    }
}

#[test]
fn any_number_of_threads_gives_the_same_motions() {
    let frames: Vec<Plane> = (0..6)
        .map(|t| frame(&STREET, &hand_held(f64::from(t)), &CLEAN, 0))
        .collect();
    let on = |threads: usize| -> Vec<FrameMotion> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut camera = CameraMotion::new(size(), &CameraMotionParams::default()).unwrap();
            frames.iter().map(|frame| camera.push(frame)).collect()
        })
    };
    assert_eq!(on(1), on(3));
}

/// The motion of the second of two frames.
fn last<P: crate::camera::LumaPixel>(frames: &[Image<P>; 2]) -> Homography {
    let mut camera = CameraMotion::new(size(), &CameraMotionParams::default()).unwrap();
    camera.push(&frames[0]);
    camera.push(&frames[1]).frame_from_previous
}

#[test]
fn all_kinds_of_frames_give_nearly_the_same_motion() {
    let planes = [0.0, 2.0].map(|t| frame(&STREET, &hand_held(t), &CLEAN, 0));
    let from_luma = last(&planes);
    let bytes = planes
        .clone()
        .map(|p| p.map(|v| Srgb([(v * 255.0).round() as u8; 3])));
    let deep = planes.map(|p| p.map(|v| Srgb([(v * 65535.0).round() as u16; 3])));
    let light = bytes.clone().map(|b| b.convert::<LinearRgb>());
    for (found, tolerance) in [
        (last(&bytes), 0.01),
        (last(&deep), 0.01),
        (last(&light), 0.2),
    ] {
        assert!(corner_error(&found, &from_luma) < tolerance);
    }
}

#[test]
fn no_frame_makes_it_panic() {
    for (width, height) in [(1, 1), (2, 300), (300, 2), (7, 5), (40, 40), (1, 2000)] {
        let size = Size::new(width, height).unwrap();
        for working_px in [32, 240, 1024] {
            let params = CameraMotionParams {
                working_px,
                ..CameraMotionParams::default()
            };
            let mut camera = CameraMotion::new(size, &params).unwrap();
            for t in 0..5u64 {
                let plane = Plane::from_fn(size, |col, row| match (t, (col + row) % 3) {
                    (1, 0) => f32::NAN,
                    (2, 1) => f32::INFINITY,
                    (3, _) => -1e30,
                    _ => Seed(t).unit(col as i64, row as i64, 0) as f32,
                });
                let motion = camera.push(&plane);
                assert!(motion.frame_from_previous.matrix().is_finite());
            }
        }
    }
}

#[test]
fn parameters_out_of_range_are_refused() {
    let with = |working_px, cut_sensitivity| {
        let params = CameraMotionParams {
            working_px,
            cut_sensitivity,
            ..CameraMotionParams::default()
        };
        CameraMotion::new(size(), &params).map(|_| ())
    };
    assert_eq!(with(240, 1.0), Ok(()));
    assert_eq!(
        with(31, 0.5),
        Err(CameraMotionError::WorkingSize { got: 31 })
    );
    assert_eq!(
        with(1025, 0.5),
        Err(CameraMotionError::WorkingSize { got: 1025 })
    );
    assert_eq!(
        with(240, 1.5),
        Err(CameraMotionError::CutSensitivity { got: 1.5 })
    );
    assert!(with(240, f64::NAN).is_err());
}
