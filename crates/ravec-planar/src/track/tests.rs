//! A plane with an analytic texture under planted motion, light, noise and occlusion.

use super::*;
use crate::homography::Homography;
use crate::random::SplitMix;
use glam::{DMat3, DVec2, dvec2};
use ravec_raster::{AnyImage, Image, LinearRgb, Mask, Size, Srgb};

const QUAD: [DVec2; 4] = [
    dvec2(60.0, 45.0),
    dvec2(250.0, 50.0),
    dvec2(255.0, 190.0),
    dvec2(65.0, 195.0),
];

/// A number from 0 to 1.
fn unit_of(random: &mut SplitMix) -> f64 {
    random.below(1 << 20) as f64 / f64::from(1 << 20)
}

fn size() -> Size {
    Size::new(320, 240).unwrap()
}

/// Waves of all directions and of lengths from 7 to 90 pixels: smooth, so that samples are exact, and without repetition.
#[derive(Clone)]
struct Texture(Vec<(DVec2, f64, f64)>);

impl Texture {
    fn new(seed: u64) -> Self {
        let mut random = SplitMix::new(seed);
        let mut unit = || unit_of(&mut random);
        let waves = (0..36).map(|_| {
            let length = 7.0 * 13.0f64.powf(unit());
            let angle = std::f64::consts::TAU * unit();
            let amplitude = 0.02 + 0.03 * (length / 90.0).sqrt();
            (
                DVec2::from_angle(angle) * std::f64::consts::TAU / length,
                std::f64::consts::TAU * unit(),
                amplitude,
            )
        });
        Self(waves.collect())
    }

    fn at(&self, p: DVec2) -> f64 {
        let sum: f64 = (self.0.iter())
            .map(|&(k, phase, amplitude)| amplitude * (k.dot(p) + phase).sin())
            .sum();
        (0.5 + sum).clamp(0.1, 0.9)
    }
}

/// A clip whose truth is known.
struct Scene {
    plane: Texture,
    /// Texture beyond the poster; none if the plane has no end.
    behind: Option<Texture>,
    noise: f64,
    gain: fn(usize) -> (f64, f64),
    /// True where the plane is hidden in a frame.
    hidden: fn(usize, DVec2) -> bool,
    pose: fn(usize) -> DMat3,
}

impl Scene {
    fn new(pose: fn(usize) -> DMat3) -> Self {
        Self {
            plane: Texture::new(1),
            behind: Some(Texture::new(2)),
            noise: 0.0,
            gain: |_| (1.0, 0.0),
            hidden: |_, _| false,
            pose,
        }
    }

    fn truth(&self, index: usize) -> Homography {
        let first = Homography::from_matrix((self.pose)(0)).unwrap();
        Homography::from_matrix((self.pose)(index)).unwrap() * first.inverse()
    }

    fn value(&self, index: usize, p: DVec2) -> f64 {
        let plane_from_frame = self.truth(index).inverse();
        let on_plane = plane_from_frame.apply(p);
        let inside =
            on_plane.cmpgt(dvec2(50.0, 35.0)).all() && on_plane.cmplt(dvec2(265.0, 205.0)).all();
        let (gain, bias) = (self.gain)(index);
        let value = match &self.behind {
            _ if (self.hidden)(index, p) => Texture::at(&self.plane, p * 1.3 + 500.0),
            Some(behind) if !inside => behind.at(p),
            _ => self.plane.at(on_plane),
        };
        gain * value + bias
    }

    fn frame(&self, index: usize) -> AnyImage {
        let mut random = SplitMix::new(77 + index as u64);
        let image = Image::from_fn(size(), |col, row| {
            let p = dvec2(col as f64 + 0.5, row as f64 + 0.5);
            let noise: f64 =
                (0..4).map(|_| unit_of(&mut random) - 0.5).sum::<f64>() * 3.0f64.sqrt();
            let value = 255.0 * self.value(index, p) + self.noise * noise;
            Srgb([value.round().clamp(0.0, 255.0) as u8; 3])
        });
        AnyImage::from(image)
    }

    fn error(&self, index: usize, tracked: &TrackedFrame) -> f64 {
        let truth = self.truth(index);
        let errors = QUAD
            .iter()
            .zip(tracked.corners)
            .map(|(&corner, found)| truth.apply(corner).distance(found));
        errors.sum::<f64>() / 4.0
    }

    fn tracker(&self, region: &TrackRegion) -> PlaneTracker {
        let params = TrackParams::default();
        PlaneTracker::new(&self.frame(0), QUAD, region, None, &params).unwrap()
    }
}

/// A hand that turns, zooms and tilts a poster a little.
fn waving(index: usize) -> DMat3 {
    let t = index as f64;
    let middle = dvec2(160.0, 120.0);
    let mut tilt = DMat3::IDENTITY;
    tilt.x_axis.z = 4e-4 * (t / 7.0).sin();
    tilt.y_axis.z = 3e-4 * (t / 9.0).sin();
    let shift = dvec2(14.0 * (t / 6.0).sin(), 9.0 * (t / 5.0).sin());
    DMat3::from_translation(middle)
        * tilt
        * DMat3::from_scale_angle_translation(
            DVec2::splat(1.0 + 0.06 * (t / 8.0).sin()),
            0.08 * (t / 10.0).sin(),
            shift,
        )
        * DMat3::from_translation(-middle)
}

#[test]
fn equal_frames_give_the_identity() {
    let scene = Scene::new(|_| DMat3::IDENTITY);
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    for _ in 0..3 {
        let tracked = tracker.push(&scene.frame(0), None);
        assert_eq!(tracked.state, TrackState::Tracked);
        assert!(scene.error(0, &tracked) < 1e-3);
        assert!((tracked.gain - 1.0).abs() < 1e-3 && tracked.bias.abs() < 1e-3);
    }
}

#[test]
fn planted_motion_is_found_within_its_predicted_deviation() {
    let scene = Scene {
        noise: 4.0,
        ..Scene::new(waving)
    };
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    let (mut sum, mut within, count) = (0.0, 0, 40);
    for index in 1..=count {
        let tracked = tracker.push(&scene.frame(index), None);
        assert_eq!(tracked.state, TrackState::Tracked, "{index}");
        let error = scene.error(index, &tracked);
        sum += error;
        within += usize::from(error <= 2.0 * tracked.sigma_px());
        assert!(tracked.sigma_px() < 0.1, "{}", tracked.sigma_px());
    }
    assert!(sum / (count as f64) < 0.03, "{}", sum / count as f64);
    assert!(within * 10 >= count * 9, "{within} of {count}");
}

#[test]
fn light_is_found() {
    let scene = Scene {
        gain: |index| if index == 0 { (1.0, 0.0) } else { (0.7, 0.08) },
        ..Scene::new(waving)
    };
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    let tracked = tracker.push(&scene.frame(1), None);
    assert!(scene.error(1, &tracked) < 0.01);
    assert!((tracked.gain - 0.7).abs() < 5e-3, "{}", tracked.gain);
    assert!((tracked.bias - 0.08).abs() < 5e-3, "{}", tracked.bias);
}

#[test]
fn what_hides_the_plane_is_left_out() {
    let scene = Scene {
        noise: 3.0,
        hidden: |index, p| index > 0 && p.x < 150.0 && p.y > 40.0,
        ..Scene::new(waving)
    };
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    for index in 1..20 {
        let tracked = tracker.push(&scene.frame(index), None);
        let error = scene.error(index, &tracked);
        assert_ne!(tracked.state, TrackState::Lost);
        assert!(error < 0.1, "{index}: {error}");
        assert!(tracked.visible < 0.75, "{}", tracked.visible);
    }
}

#[test]
fn excluded_pixels_have_no_say() {
    // all but a corner of the plane is hidden by something that stands still
    let hidden = |index: usize, p: DVec2| index > 0 && (p.x > 150.0 || p.y > 150.0);
    let scene = Scene {
        noise: 2.0,
        hidden,
        ..Scene::new(waving)
    };
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    let exclude = Mask::from_fn(size(), |col, row| hidden(1, dvec2(col as f64, row as f64)));
    for index in 1..12 {
        let tracked = tracker.push(&scene.frame(index), Some(&exclude));
        let error = scene.error(index, &tracked);
        assert!(error < 3.0 * tracked.sigma_px() + 0.05, "{index}: {error}");
        assert!(tracked.inlier_share > 0.8, "{}", tracked.inlier_share);
    }
}

#[test]
fn a_frame_of_something_else_is_lost_and_the_plane_is_found_again() {
    let scene = Scene {
        noise: 3.0,
        hidden: |index, _| (5..8).contains(&index),
        ..Scene::new(waving)
    };
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    for index in 1..14 {
        let tracked = tracker.push(&scene.frame(index), None);
        if (5..8).contains(&index) {
            assert_eq!(tracked.state, TrackState::Lost, "{index}");
            assert!(tracked.sigma_px() > 100.0);
        } else {
            let again = index == 8;
            let expected = if again {
                TrackState::Weak
            } else {
                TrackState::Tracked
            };
            assert_eq!(tracked.state, expected, "{index}");
            assert!(scene.error(index, &tracked) < 0.1, "{index}");
        }
    }
}

#[test]
fn jumps_in_rotation_and_scale_are_found_by_features() {
    let scene = Scene {
        noise: 2.0,
        ..Scene::new(|index| {
            let middle = dvec2(160.0, 120.0);
            let (zoom, turn) = if index < 3 { (1.0, 0.0) } else { (0.7, 0.9) };
            DMat3::from_translation(middle)
                * DMat3::from_scale_angle_translation(DVec2::splat(zoom), turn, DVec2::ZERO)
                * DMat3::from_translation(-middle)
        })
    };
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    for index in 1..6 {
        let tracked = tracker.push(&scene.frame(index), None);
        assert!(
            scene.error(index, &tracked) < 0.1,
            "{index}: {:?}",
            tracked.state
        );
    }
}

#[test]
fn backward_from_the_end_agrees_with_forward_from_the_start() {
    let scene = Scene {
        noise: 4.0,
        ..Scene::new(waving)
    };
    let last = 12;
    let mut forward = scene.tracker(&TrackRegion::Quad);
    let mut there = forward.reference_frame();
    for index in 1..=last {
        there = forward.push(&scene.frame(index), None);
    }
    let params = TrackParams::default();
    let quad = there.corners;
    let mut backward =
        PlaneTracker::new(&scene.frame(last), quad, &TrackRegion::Quad, None, &params).unwrap();
    let mut back = backward.reference_frame();
    for index in (0..last).rev() {
        back = backward.push(&scene.frame(index), None);
    }
    for (corner, found) in QUAD.iter().zip(back.corners) {
        let bound = 3.0 * (there.sigma_px() + back.sigma_px());
        assert!(
            corner.distance(found) < bound,
            "{} {bound}",
            corner.distance(found)
        );
    }
}

#[test]
fn rewinding_starts_again_from_the_reference() {
    let scene = Scene::new(waving);
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    let first = tracker.push(&scene.frame(1), None);
    for index in 2..6 {
        tracker.push(&scene.frame(index), None);
    }
    tracker.rewind();
    assert_eq!(tracker.push(&scene.frame(1), None), first);
}

#[test]
fn a_pan_beyond_the_reference_and_back_comes_home() {
    let scene = Scene {
        behind: None,
        noise: 4.0,
        ..Scene::new(|index| {
            let t = index as f64 / 30.0 * std::f64::consts::PI;
            DMat3::from_translation(dvec2(-420.0 * t.sin(), 60.0 * (2.0 * t).sin()))
        })
    };
    let mut tracker = scene.tracker(&TrackRegion::Frame);
    let mut frames = vec![tracker.reference_frame()];
    for index in 1..=30 {
        frames.push(tracker.push(&scene.frame(index), None));
        let f = &frames[index];
        eprintln!(
            "{index} {:?} {} {} key {} vis {}",
            f.state,
            scene.error(index, f),
            f.sigma_px(),
            f.keyframe,
            f.visible
        );
    }
    assert!(frames.iter().any(|frame| frame.keyframe > 1));
    assert_eq!(frames[30].keyframe, 0);
    assert!(scene.error(30, &frames[30]) < 0.05);
    let mean = |frames: &[TrackedFrame]| {
        let errors = frames
            .iter()
            .enumerate()
            .map(|(index, frame)| scene.error(index, frame));
        errors.sum::<f64>() / frames.len() as f64
    };
    let before = mean(&frames);
    assert!(tracker.refine(&mut frames));
    let after = mean(&frames);
    assert!(after < before.min(0.3), "{before} {after}");
    let calibrated = (frames.iter().enumerate())
        .filter(|(index, frame)| scene.error(*index, frame) <= 2.0 * frame.sigma_px() + 1e-9);
    assert!(calibrated.count() >= 28);
}

#[test]
fn a_quadrilateral_beyond_the_border_is_tracked_by_what_is_seen() {
    let scene = Scene {
        noise: 3.0,
        ..Scene::new(|index| DMat3::from_translation(dvec2(-12.0 * index as f64, 0.0)))
    };
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    for index in 1..14 {
        let tracked = tracker.push(&scene.frame(index), None);
        let error = scene.error(index, &tracked);
        assert!(error < 0.1 + 3.0 * tracked.sigma_px(), "{index}: {error}");
    }
}

#[test]
fn kinds_of_pixels_agree() {
    let scene = Scene::new(waving);
    let (first, second) = (scene.frame(0), scene.frame(3));
    let params = TrackParams::default();
    let run = |first: &AnyImage, second: &AnyImage| {
        let mut tracker =
            PlaneTracker::new(first, QUAD, &TrackRegion::Quad, None, &params).unwrap();
        tracker.push(second, None).corners
    };
    let eight = run(&first, &second);
    let deep = |image: &AnyImage| AnyImage::from(image.convert::<Srgb<u16>>());
    let linear = |image: &AnyImage| AnyImage::from(image.convert::<LinearRgb>());
    for other in [
        run(&deep(&first), &deep(&second)),
        run(&linear(&first), &linear(&second)),
    ] {
        for (a, b) in eight.iter().zip(other) {
            assert!(a.distance(b) < 1e-3, "{a} {b}");
        }
    }
}

#[test]
fn what_cannot_be_tracked_is_refused() {
    let params = TrackParams::default();
    let region = TrackRegion::Quad;
    let even = AnyImage::from(Image::new(size(), Srgb([90u8; 3])));
    let new = |frame: &AnyImage, quad, region: &TrackRegion| {
        PlaneTracker::new(frame, quad, region, None, &params).err()
    };
    assert_eq!(new(&even, QUAD, &region), Some(TrackError::Plain));
    let scene = Scene::new(waving);
    let frame = scene.frame(0);
    let crossed = [QUAD[0], QUAD[2], QUAD[1], QUAD[3]];
    assert!(matches!(
        new(&frame, crossed, &region),
        Some(TrackError::Quad(_))
    ));
    let beside = QUAD.map(|p| p + 1000.0);
    assert_eq!(new(&frame, beside, &region), Some(TrackError::Plain));
    let mask = Mask::full(Size::new(10, 10).unwrap());
    assert!(matches!(
        new(&frame, QUAD, &TrackRegion::Mask(mask)),
        Some(TrackError::MaskSize { .. })
    ));
}

#[test]
fn strange_pictures_do_no_harm() {
    let params = TrackParams::default();
    for (width, height) in [(1, 1), (3, 40), (40, 3), (17, 19)] {
        let size = Size::new(width, height).unwrap();
        let mut random = SplitMix::new(3);
        let image = Image::from_fn(size, |_, _| {
            let value = unit_of(&mut random) as f32;
            LinearRgb([if value < 0.1 { f32::NAN } else { value }; 3])
        });
        let frame = AnyImage::from(image);
        let (x, y) = (width as f64, height as f64);
        let quad = [DVec2::ZERO, dvec2(x, 0.0), dvec2(x, y), dvec2(0.0, y)];
        if let Ok(mut tracker) = PlaneTracker::new(&frame, quad, &TrackRegion::Frame, None, &params)
        {
            let _ = tracker.push(&frame, None);
        }
    }
    // a frame of numbers that are none, between good ones
    let scene = Scene::new(waving);
    let mut tracker = scene.tracker(&TrackRegion::Quad);
    let none = AnyImage::from(Image::new(size(), LinearRgb([f32::NAN; 3])));
    assert_eq!(tracker.push(&none, None).state, TrackState::Lost);
    let tracked = tracker.push(&scene.frame(2), None);
    assert!(scene.error(2, &tracked) < 0.02);
}
