//! Still, panning and shaken cameras, with cuts, lost frames and limits.

use super::*;
use glam::DMat3;
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use ravec_scenes::Seed;

const FPS: f64 = 25.0;

fn size() -> Size {
    Size::new(640, 480).unwrap()
}

fn smooth(frames: &[PathFrame]) -> SmoothPath {
    smooth_path(frames, size(), FPS, &SmoothParams::default()).unwrap()
}

fn known(maps: impl IntoIterator<Item = DMat3>) -> Vec<PathFrame> {
    maps.into_iter()
        .map(|map| PathFrame {
            frame_from_reference: Some(Homography::from_matrix(map).unwrap()),
            cut: false,
        })
        .collect()
}

/// A constant motion about the middle of the frame: a pan that turns and comes nearer.
fn steady(frames: usize) -> Vec<DMat3> {
    let center = dvec2(320.0, 240.0);
    let step = DMat3::from_translation(center + dvec2(3.0, -1.0))
        * DMat3::from_scale_angle_translation(DVec2::splat(1.002), 0.004, DVec2::ZERO)
        * DMat3::from_translation(-center);
    let mut map = DMat3::IDENTITY;
    (0..frames)
        .map(|_| {
            let now = map;
            map = step * map;
            now
        })
        .collect()
}

/// A jerk of the camera: shift, turn and tilt, in pixels at the rim.
fn jerk(at: usize, px: f64) -> DMat3 {
    let draw = |axis| Seed(5).gaussian(at as i64, 0, axis) * px;
    let center = dvec2(320.0, 240.0);
    let mut tilt = DMat3::IDENTITY;
    tilt.x_axis.z = draw(3) / 320.0 / 320.0;
    DMat3::from_translation(center + dvec2(draw(0), draw(1)))
        * DMat3::from_angle(draw(2) / 320.0)
        * tilt
        * DMat3::from_translation(-center)
}

fn shaken(frames: usize, px: f64) -> Vec<PathFrame> {
    let maps = steady(frames).into_iter().enumerate();
    known(maps.map(|(at, map)| jerk(at, px) * map))
}

fn largest_motion(map: &Homography) -> f64 {
    Frame::new(size()).motion(map).unwrap().amax()
}

/// The corners of the cropped output, seen in every frame, lie in the frame.
fn assert_covered(path: &SmoothPath) {
    let (w, h) = (640.0, 480.0);
    for (index, map) in path.output_from_frame.iter().enumerate() {
        for corner in Frame::new(size()).corners {
            let center = dvec2(320.0, 240.0);
            let inner = center + (corner - center) * (1.0 - 2.0 * path.crop);
            let seen = map.inverse().try_apply(inner).unwrap();
            assert!(seen.cmpge(DVec2::splat(-1e-6)).all(), "{index} {seen}");
            assert!(seen.x <= w + 1e-6 && seen.y <= h + 1e-6, "{index} {seen}");
            let filled = path.filling(index).inverse().apply(corner);
            assert!(filled.distance(seen) < 1e-6);
        }
    }
}

#[test]
fn a_still_clip_stays_as_it_is() {
    let path = smooth(&known(vec![DMat3::IDENTITY; 60]));
    assert_eq!(path.output_from_frame, vec![Homography::IDENTITY; 60]);
    assert_eq!(
        [path.crop, path.jitter_before_px, path.jitter_after_px],
        [0.0; 3]
    );
}

#[test]
fn a_constant_motion_stays_as_it_is() {
    let path = smooth(&known(steady(120)));
    for map in &path.output_from_frame {
        assert!(largest_motion(map) < 1e-6, "{}", largest_motion(map));
    }
    assert!(path.crop < 1e-6 && path.limited == 0);
}

#[test]
fn a_shaken_motion_loses_its_shake() {
    let frames = shaken(150, 4.0);
    let path = smooth(&frames);
    assert!(path.jitter_before_px > 10.0);
    assert!(
        path.jitter_after_px < 0.005 * path.jitter_before_px,
        "{} {}",
        path.jitter_before_px,
        path.jitter_after_px
    );
    assert_eq!(path.limited, 0);
    assert_covered(&path);
    // the output of a camera's motion is the same
    let motions: Vec<PathFrame> = frames
        .iter()
        .map(|frame| {
            PathFrame::from(&FrameMotion {
                frame_from_previous: Homography::IDENTITY,
                frame_from_shot: frame.frame_from_reference.unwrap(),
                cut: false,
                inlier_share: 1.0,
                residual: 0.0,
                corner_sigma_px: 0.0,
                reliable: true,
            })
        })
        .collect();
    assert_eq!(motions, frames);
    // of the pan nothing is lost: the output moves as the steady camera, but for what the shake seems to say of slow motion
    let steady = steady(150);
    for at in 20..129 {
        let speed = |maps: [DMat3; 2]| {
            let map = Homography::from_matrix(maps[1] * maps[0].inverse()).unwrap();
            Frame::new(size()).motion(&map).unwrap()
        };
        let output = [at, at + 1].map(|k| {
            let frame = frames[k].frame_from_reference.unwrap();
            (path.output_from_frame[k] * frame).matrix()
        });
        let off = speed(output) - speed([steady[at], steady[at + 1]]);
        assert!(off.amax() < 0.6, "{at} {off}");
    }
}

#[test]
fn the_crop_is_the_least_that_all_frames_cover() {
    let path = smooth(&shaken(100, 3.0));
    assert_covered(&path);
    // a crop that is less by a thousandth shows a border in some frame
    let share = 1.0 - 2.0 * path.crop + 0.002;
    let shows = path.output_from_frame.iter().any(|map| {
        Frame::new(size()).corners.iter().any(|&corner| {
            let center = dvec2(320.0, 240.0);
            let seen = map.inverse().apply(center + (corner - center) * share);
            !(seen.cmpge(DVec2::ZERO).all() && seen.x <= 640.0 && seen.y <= 480.0)
        })
    });
    assert!(shows && path.crop > 0.0);
}

#[test]
fn a_path_beyond_the_crop_is_pulled_back() {
    // a whip pan between two still views, and jerks that the crop does not allow
    let pan = |at: usize| 900.0 / (1.0 + (-(at as f64 - 60.0) / 3.0).exp());
    let maps = (0..120).map(|at| jerk(at, 25.0) * DMat3::from_translation(dvec2(pan(at), 0.0)));
    let frames = known(maps);
    for max_crop in [0.0, 0.03, 0.1, 0.25] {
        let params = SmoothParams {
            max_crop,
            ..Default::default()
        };
        let path = smooth_path(&frames, size(), FPS, &params).unwrap();
        assert!(
            path.crop <= max_crop + 1e-9 && path.limited > 0,
            "{}",
            path.crop
        );
        assert_covered(&path);
        assert!(path.jitter_after_px <= path.jitter_before_px);
        if max_crop == 0.25 {
            assert!(
                path.jitter_after_px < 0.35 * path.jitter_before_px,
                "{}",
                path.jitter_after_px
            );
        }
    }
}

#[test]
fn shots_are_smoothed_by_themselves() {
    let (first, second) = (shaken(50, 3.0), shaken(130, 2.0)[60..].to_vec());
    let mut both = [first.clone(), second.clone()].concat();
    both[50].cut = true;
    let path = smooth(&both);
    assert_eq!(
        path.output_from_frame[..50],
        smooth(&first).output_from_frame
    );
    assert_eq!(
        path.output_from_frame[50..],
        smooth(&second).output_from_frame
    );
}

#[test]
fn lost_frames_go_along_with_their_neighbors() {
    let mut frames = shaken(100, 3.0);
    for at in (0..4).chain(40..52).chain(95..100) {
        frames[at].frame_from_reference = None;
    }
    let path = smooth(&frames);
    assert_covered(&path);
    let shift = |at: usize| {
        Frame::new(size())
            .motion(&path.output_from_frame[at])
            .unwrap()
    };
    for at in 40..52 {
        let t = (at - 39) as f64 / 13.0;
        let straight = shift(39) * (1.0 - t) + shift(52) * t;
        assert!((shift(at) - straight).amax() < 1e-6);
    }
    assert!((0..4).all(|at| shift(at) == shift(4)));
    assert!((95..100).all(|at| shift(at) == shift(94)));
    // nothing known at all
    let path = smooth(&vec![PathFrame::default(); 5]);
    assert_eq!(path.output_from_frame, vec![Homography::IDENTITY; 5]);
    assert!(smooth(&[]).output_from_frame.is_empty());
}

#[test]
fn a_period_of_the_strength_is_halved() {
    // 2 seconds are 50 frames
    for (period, kept) in [(50.0, 0.5), (25.0, 1.0 / 17.0), (100.0, 16.0 / 17.0)] {
        let x = |at: usize| 8.0 * (std::f64::consts::TAU * at as f64 / period).sin();
        let maps = (0..600).map(|at| DMat3::from_translation(dvec2(x(at), 0.0)));
        let path = smooth(&known(maps));
        for at in 250..350 {
            let shift = Frame::new(size())
                .motion(&path.output_from_frame[at])
                .unwrap();
            assert!(
                (x(at) + shift[0] - kept * x(at)).abs() < 0.05,
                "{period} {at}"
            );
        }
    }
}

#[test]
fn the_banded_solution_agrees_with_the_dense_one() {
    const N: usize = 23;
    let lambda = 37.0;
    let seed = Seed(9);
    let weights: Vec<f64> = (0..N)
        .map(|at| {
            if at % 5 == 3 {
                0.0
            } else {
                seed.between(at as i64, 0, 1, 0.3, 4.0)
            }
        })
        .collect();
    let values: Vec<Option<Vector>> = (0..N)
        .map(|at| {
            let value = Vector::from_fn(|k, _| seed.gaussian(at as i64, k as i64, 2));
            (weights[at] > 0.0).then_some(value)
        })
        .collect();
    let mut matrix = DMatrix::<f64>::zeros(N, N);
    for at in 0..N {
        matrix[(at, at)] += weights[at];
        if at >= 2 {
            let mut row = DVector::<f64>::zeros(N);
            (row[at - 2], row[at - 1], row[at]) = (1.0, -2.0, 1.0);
            matrix += &row * row.transpose() * lambda;
        }
    }
    let inverse = matrix.try_inverse().unwrap();
    for (at, found) in whittaker(&values, &weights, lambda).iter().enumerate() {
        let mut expected = Vector::zeros();
        for (k, value) in values.iter().enumerate() {
            if let Some(value) = value {
                expected += value * weights[k] * inverse[(at, k)];
            }
        }
        assert!((found - expected).norm() < 1e-9, "{at}");
    }
}

#[test]
fn no_strength_changes_nothing() {
    let params = SmoothParams {
        strength_secs: 0.0,
        ..Default::default()
    };
    let path = smooth_path(&shaken(40, 3.0), size(), FPS, &params).unwrap();
    assert_eq!(path.output_from_frame, vec![Homography::IDENTITY; 40]);
    assert_eq!(path.jitter_before_px, path.jitter_after_px);
}

#[test]
fn parameters_out_of_range_are_refused() {
    let with = |fps: f64, strength_secs: f64, max_crop: f64| {
        let params = SmoothParams {
            strength_secs,
            max_crop,
        };
        smooth_path(&[], size(), fps, &params)
    };
    for fps in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            with(fps, 1.0, 0.1),
            Err(SmoothError::FrameRate { .. })
        ));
    }
    for strength in [-1.0, 61.0, f64::NAN] {
        assert!(matches!(
            with(25.0, strength, 0.1),
            Err(SmoothError::Strength { .. })
        ));
    }
    for crop in [-0.1, 0.5, f64::NAN] {
        assert!(matches!(
            with(25.0, 1.0, crop),
            Err(SmoothError::Crop { .. })
        ));
    }
}

proptest! {
    #[test]
    fn any_maps_give_a_covered_path(
        maps in prop::collection::vec(prop::option::of(prop::array::uniform9(-2.0..2.0f64)), 0..40),
        cuts in prop::collection::vec(any::<bool>(), 40),
        scale in prop_oneof![Just(1e-3), Just(1.0), Just(300.0)],
    ) {
        let frames: Vec<PathFrame> = maps.iter().zip(cuts).map(|(map, cut)| {
            let map = map.and_then(|m| {
                let mut matrix = DMat3::from_cols_array(&m);
                matrix.z_axis.x *= scale;
                Homography::from_matrix(matrix).ok()
            });
            PathFrame { frame_from_reference: map, cut }
        }).collect();
        let path = smooth(&frames);
        prop_assert!(path.crop <= 0.1 + 1e-9);
        prop_assert_eq!(path.output_from_frame.len(), frames.len());
        assert_covered(&path);
    }
}
