//! Tracks with planted slides and lost spans, and the corrections that a user who knows the truth would make.

use super::*;
use crate::track::record::TrackedFrame;
use glam::{DMat3, dvec2};
use proptest::prelude::*;
use ravec_scenes::Seed;

const QUAD: [DVec2; 4] = [
    dvec2(100.0, 80.0),
    dvec2(400.0, 100.0),
    dvec2(390.0, 330.0),
    dvec2(110.0, 300.0),
];

/// Deviation of the measurements, in pixels.
const NOISE_PX: f64 = 0.02;

/// A camera that pans, turns, comes nearer and tilts a little.
fn truth(at: f64) -> Homography {
    let mut tilt = DMat3::IDENTITY;
    tilt.x_axis.z = 1e-4 * (at / 40.0).sin();
    let turn = DMat3::from_scale_angle_translation(
        DVec2::splat(1.0 + 0.003 * at),
        0.1 * (at / 50.0).sin(),
        dvec2(0.8 * at, 20.0 * (at / 30.0).sin()),
    );
    Homography::from_matrix(turn * tilt).unwrap()
}

fn true_corners(at: usize) -> [DVec2; 4] {
    QUAD.map(|p| truth(at as f64).apply(p))
}

/// A frame measured with an error, in pixels of the corners.
fn frame(at: usize, error: impl Fn(usize) -> DVec2) -> TrackedFrame {
    let mut index = 0;
    let corners = true_corners(at).map(|p| {
        index += 1;
        p + error(index - 1)
    });
    let pose = Homography::from_pairs(&QUAD, &corners).unwrap();
    let mut covariance = [[0.0; 8]; 8];
    for (k, row) in covariance.iter_mut().enumerate() {
        row[k] = NOISE_PX * NOISE_PX;
    }
    TrackedFrame {
        state: TrackState::Tracked,
        frame_from_reference: pose,
        corners,
        covariance,
        inlier_share: 0.9,
        visible: 1.0,
        residual: 0.01,
        gain: 1.0,
        bias: 0.0,
        keyframe: 0,
    }
}

/// A track from frame 0, the reference, measured with noise and a slide of the corners in pixels.
fn track(frames: usize, slide: impl Fn(usize, usize) -> DVec2) -> Track {
    let noise = |at: usize, k: usize| {
        let draw = |axis| Seed(8).gaussian(at as i64, k as i64, axis);
        dvec2(draw(0), draw(1)) * NOISE_PX
    };
    let mut found: Vec<TrackedFrame> = (0..frames)
        .map(|at| frame(at, |k| noise(at, k) + slide(at, k)))
        .collect();
    found[0] = frame(0, |_| DVec2::ZERO);
    found[0].covariance = [[0.0; 8]; 8];
    Track {
        width: 640,
        height: 480,
        quad: QUAD,
        reference: 0,
        first: 0,
        frames: found,
    }
}

fn lose(track: &mut Track, span: std::ops::Range<usize>) {
    let last = track.frames[span.start.saturating_sub(1)].clone();
    for at in span {
        track.frames[at] = TrackedFrame {
            state: TrackState::Lost,
            covariance: std::array::from_fn(|i| {
                std::array::from_fn(|j| if i == j { 1e4 } else { 0.0 })
            }),
            ..last.clone()
        };
    }
}

/// The correction of a user who knows the truth.
fn right(at: usize) -> Correction {
    Correction {
        frame: at as u64,
        corners: true_corners(at),
    }
}

/// Mean distance of the corners from the truth.
fn error(track: &Track, at: usize) -> f64 {
    let pairs = track.frames[at].corners.iter().zip(true_corners(at));
    0.25 * pairs.map(|(a, b)| a.distance(b)).sum::<f64>()
}

/// One direction for each corner, so that the slide is no mere shift.
fn direction(k: usize) -> DVec2 {
    [
        dvec2(1.0, 0.2),
        dvec2(0.8, -0.4),
        dvec2(1.1, 0.1),
        dvec2(0.9, 0.5),
    ][k]
}

/// From 0 at `from` to 1 at `to`.
fn ramp(at: usize, from: f64, to: f64) -> f64 {
    ((at as f64 - from) / (to - from)).clamp(0.0, 1.0)
}

fn changed(before: &Track, after: &Track) -> Vec<usize> {
    (0..before.frames.len())
        .filter(|&at| before.frames[at] != after.frames[at])
        .collect()
}

#[test]
fn without_corrections_nothing_changes() {
    let mut track = track(40, |_, _| DVec2::ZERO);
    lose(&mut track, 10..20);
    assert_eq!(track.corrected(&[]), Ok(track.clone()));
}

#[test]
fn corrections_equal_to_the_present_corners_change_nothing() {
    let track = track(120, |at, k| direction(k) * 4.0 * ramp(at, 30.0, 60.0));
    let same = |at: usize| Correction {
        frame: at as u64,
        corners: track.frames[at].corners,
    };
    for corrections in [vec![same(50)], vec![same(20), same(90), same(0)]] {
        assert_eq!(track.corrected(&corrections), Ok(track.clone()));
    }
}

#[test]
fn corrected_frames_have_exactly_the_given_corners_and_the_reference_stays() {
    let track = track(120, |at, k| direction(k) * 4.0 * ramp(at, 30.0, 60.0));
    let corrections = [right(100), right(45), right(60)];
    let solved = track.corrected(&corrections).unwrap();
    for correction in corrections {
        let frame = solved.frame(correction.frame).unwrap();
        assert_eq!(frame.corners, correction.corners);
        assert_eq!(frame.state, TrackState::Tracked);
        assert!((frame.sigma_px() - HAND_PX * 2f64.sqrt()).abs() < 1e-12);
        for (p, q) in QUAD.iter().zip(correction.corners) {
            assert!(frame.frame_from_reference.apply(*p).distance(q) < 1e-9);
        }
    }
    assert_eq!(solved.frames[0], track.frames[0]);
    // all corners agree with the poses
    for frame in &solved.frames {
        for (p, q) in QUAD.iter().zip(frame.corners) {
            assert!(frame.frame_from_reference.apply(*p).distance(q) < 1e-9);
        }
    }
}

#[test]
fn a_slide_that_comes_and_goes_gives_way_around_its_correction() {
    let slide = |at: usize, k: usize| {
        direction(k) * 5.0 * ramp(at, 40.0, 80.0) * (1.0 - ramp(at, 80.0, 120.0))
    };
    let track = track(200, slide);
    let solved = track.corrected(&[right(80)]).unwrap();
    assert!(error(&solved, 80) == 0.0);
    // near the correction most of the error is gone, and it does not snap back
    for at in 65..96 {
        assert!(
            error(&solved, at) < 0.3 * error(&track, at) + 0.05,
            "{at}: {}",
            error(&solved, at)
        );
    }
    let total = |track: &Track| (0..200).map(|at| error(track, at)).sum::<f64>();
    assert!(
        total(&solved) < 0.35 * total(&track),
        "{} {}",
        total(&solved),
        total(&track)
    );
    // and far away nothing changes
    let changed = changed(&track, &solved);
    assert!(
        changed.iter().all(|at| (45..116).contains(at)),
        "{changed:?}"
    );
    // two more corrections where the user sees what is left
    let solved = track
        .corrected(&[right(40), right(80), right(120)])
        .unwrap();
    for at in 0..200 {
        assert!(error(&solved, at) < 0.1, "{at}: {}", error(&solved, at));
    }
}

#[test]
fn a_slide_that_stays_is_corrected_between_corrections_that_agree() {
    // constant on the plane, while the camera comes nearer
    let slide =
        |at: usize, k: usize| direction(k) * (4.0 + 0.012 * at as f64) * ramp(at, 40.0, 80.0);
    let track = track(200, slide);
    let solved = track
        .corrected(&[right(40), right(80), right(170)])
        .unwrap();
    for at in 0..171 {
        assert!(error(&solved, at) < 0.3, "{at}: {}", error(&solved, at));
    }
    // the relative motion of the measurements is kept: a constant slide is corrected to a part of itself
    assert!((90..160).all(|at| solved.frames[at].state == TrackState::Tracked));
}

#[test]
fn a_slide_ends_where_the_measurement_jumps() {
    let slide = |at: usize, k: usize| {
        if at < 90 {
            direction(k) * 5.0 * ramp(at, 50.0, 70.0)
        } else {
            DVec2::ZERO
        }
    };
    let track = track(200, slide);
    let solved = track.corrected(&[right(75)]).unwrap();
    for at in 75..90 {
        assert!(error(&solved, at) < 0.4, "{at}: {}", error(&solved, at));
    }
    assert_eq!(solved.frames[91..], track.frames[91..]);
}

#[test]
fn small_corrections_stay_near() {
    let track = track(100, |_, _| DVec2::ZERO);
    let mut correction = right(50);
    correction.corners = track.frames[50].corners.map(|p| p + dvec2(0.06, 0.0));
    let changed = changed(&track, &track.corrected(&[correction]).unwrap());
    // three of √2 standard deviations at four corners
    assert!(changed.iter().all(|&at| at.abs_diff(50) < 8), "{changed:?}");
}

#[test]
fn lost_frames_between_corrections_and_found_ones_come_back() {
    let mut track = track(120, |_, _| DVec2::ZERO);
    lose(&mut track, 50..72);
    let solved = track.corrected(&[right(61)]).unwrap();
    for at in 50..72 {
        let frame = &solved.frames[at];
        let state = if at == 61 {
            TrackState::Tracked
        } else {
            TrackState::Weak
        };
        assert_eq!(frame.state, state, "{at}");
        assert!(error(&solved, at) < 1.0, "{at}: {}", error(&solved, at));
        assert!(error(&solved, at) <= 3.0 * frame.sigma_px(), "{at}");
    }
    let unchanged = |at: &usize| !(50..72).contains(at);
    assert!(!changed(&track, &solved).iter().any(unchanged));
    // the middle of a gap is the least certain
    assert!(solved.frames[55].sigma_px() > solved.frames[50].sigma_px());
    assert!(solved.frames[55].sigma_px() > solved.frames[60].sigma_px());
}

#[test]
fn lost_frames_beyond_all_knots_and_spans_without_correction_stay_lost() {
    let mut track = track(120, |_, _| DVec2::ZERO);
    lose(&mut track, 30..40);
    lose(&mut track, 90..120);
    let solved = track.corrected(&[right(96)]).unwrap();
    assert_eq!(solved.frames[30..40], track.frames[30..40]);
    assert!((90..96).all(|at| solved.frames[at].state == TrackState::Weak));
    assert_eq!(solved.frames[97..], track.frames[97..]);
    for at in 90..97 {
        assert!(error(&solved, at) < 1.0, "{at}: {}", error(&solved, at));
    }
}

/// A second of jerks without a measurement says nothing of the frames in between.
#[test]
fn bridges_that_could_be_anywhere_stay_lost() {
    let shake = |at: usize, _: usize| {
        dvec2(
            Seed(3).gaussian(at as i64, 0, 0),
            Seed(3).gaussian(at as i64, 0, 1),
        ) * 20.0
    };
    let mut track = track(200, shake);
    lose(&mut track, 60..150);
    let solved = track.corrected(&[right(149)]).unwrap();
    assert_eq!(solved.frames[149].state, TrackState::Tracked);
    assert_eq!(solved.frames[100].state, TrackState::Lost);
    assert_eq!(solved.frames[100], track.frames[100]);
}

#[test]
fn time_has_no_direction() {
    let slide = |at: usize, k: usize| {
        direction(k) * 5.0 * ramp(at, 40.0, 80.0) * (1.0 - ramp(at, 80.0, 120.0))
    };
    let mut forward = track(161, slide);
    lose(&mut forward, 100..110);
    forward.reference = 30;
    let corrections = [right(70), right(85), right(104)];
    let mut backward = forward.clone();
    backward.frames.reverse();
    backward.reference = 130;
    let mirrored = corrections.map(|correction| Correction {
        frame: 160 - correction.frame,
        ..correction
    });
    let forward = forward.corrected(&corrections).unwrap();
    let backward = backward.corrected(&mirrored).unwrap();
    for (a, b) in forward.frames.iter().zip(backward.frames.iter().rev()) {
        assert_eq!(a.state, b.state);
        for (p, q) in a.corners.iter().zip(b.corners) {
            assert!(p.distance(q) < 1e-8);
        }
        assert!((a.sigma_px() - b.sigma_px()).abs() < 1e-8);
    }
}

#[test]
fn the_result_can_be_corrected_again_with_the_same() {
    let track = track(120, |at, k| direction(k) * 4.0 * ramp(at, 30.0, 60.0));
    let corrections = [right(60), right(90)];
    let once = track.corrected(&corrections).unwrap();
    assert_eq!(once.corrected(&corrections), Ok(once));
}

#[test]
fn each_kind_of_bad_correction_has_its_own_error() {
    let mut track = track(20, |_, _| DVec2::ZERO);
    track.first = 100;
    track.reference = 105;
    let at = |frame: u64| Correction {
        frame,
        corners: true_corners(3).map(|p| p + 1.0),
    };
    for frame in [0, 99, 120, u64::MAX] {
        let error = CorrectError::OutOfRange {
            frame,
            first: 100,
            last: 119,
        };
        assert_eq!(track.corrected(&[at(frame)]), Err(error));
    }
    assert_eq!(
        track.corrected(&[at(105)]),
        Err(CorrectError::Reference { frame: 105 })
    );
    assert_eq!(
        track.corrected(&[at(110), at(103), at(110)]),
        Err(CorrectError::Repeated { frame: 110 })
    );
    for corners in [[DVec2::ZERO; 4], [dvec2(f64::NAN, 0.0); 4]] {
        let bad = Correction {
            frame: 107,
            corners,
        };
        let found = track.corrected(&[bad]);
        assert!(
            matches!(found, Err(CorrectError::Quad { frame: 107, .. })),
            "{found:?}"
        );
    }
    // upside down and back within two frames: halfway the quadrilateral is a point
    lose(&mut track, 8..15);
    let mut turned = at(111);
    turned.corners = {
        let c = track.frames[7].corners;
        [c[2], c[3], c[0], c[1]]
    };
    let found = track.corrected(&[turned]);
    assert!(
        matches!(found, Err(CorrectError::Folded { .. })),
        "{found:?}"
    );
    let mut empty = track.clone();
    empty.frames.clear();
    assert!(empty.corrected(&[at(100)]).is_err());
}

proptest! {
    #[test]
    fn no_record_makes_it_panic(
        states in prop::collection::vec(0u8..8, 12),
        values in prop::collection::vec(prop_oneof![-1e3..1e3f64, Just(f64::NAN), Just(f64::INFINITY), Just(0.0), Just(1e300)], 12),
        frames in prop::collection::vec(0u64..14, 0..5),
    ) {
        let mut track = track(12, |_, _| DVec2::ZERO);
        for (at, (&state, &value)) in states.iter().zip(&values).enumerate() {
            match state {
                0 => lose(&mut track, at..at + 1),
                1 => track.frames[at].covariance[3][3] = value,
                2 => track.frames[at].corners[1].x = value,
                3 => track.frames[at].covariance = [[value; 8]; 8],
                4 => track.frames[at].frame_from_reference = truth(if value.is_finite() { value.clamp(-300.0, 1e3) } else { 0.5 }),
                _ => {}
            }
        }
        let corrections: Vec<Correction> = frames.iter().map(|&frame| right(frame as usize)).collect();
        let _ = track.corrected(&corrections);
    }
}
