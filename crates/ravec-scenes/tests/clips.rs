//! Planted identities of every clip of the catalogue.

use glam::{DMat3, DVec2};
use ravec_raster::{Image, LinearRgb, Plane, Size};
use ravec_scenes::Seed;
use ravec_scenes::clip::{Clip, ClipId, ClipTruth, Frame, Line, clip, project};

fn size(width: usize, height: usize) -> Size {
    Size::new(width, height).unwrap()
}

fn small(id: ClipId, frames: usize) -> Clip {
    clip(id, size(128, 72), frames, Seed(3))
}

fn sum(plane: &Plane) -> f64 {
    plane.pixels().iter().map(|&v| f64::from(v)).sum()
}

/// Walks a frame: it is finite, and its picture is the composite of its parts.
fn walk(frame: &Frame) {
    let parts = frame.foreground.pixels().iter().zip(frame.plate.pixels());
    for ((picture, alpha), (front, back)) in frame
        .picture
        .pixels()
        .iter()
        .zip(frame.alpha.pixels())
        .zip(parts)
    {
        assert!((0.0..=1.0).contains(alpha));
        for c in 0..3 {
            let expected = alpha * front.0[c] + (1.0 - alpha) * back.0[c];
            assert_eq!(picture.0[c], expected, "frame {}", frame.index);
            assert!(expected.is_finite() && expected > -0.1 && expected < 1.3);
        }
    }
}

#[test]
fn a_frame_is_the_composite_of_its_foreground_and_its_plate() {
    for id in ClipId::ALL {
        let mut clip = small(id, 9);
        for shutter in [0.0, 0.5] {
            clip.shutter = shutter;
            for index in [0, 4, 8] {
                walk(&clip.frame(index));
            }
        }
    }
}

#[test]
fn alpha_of_all_shapes_is_that_of_each_over_the_others() {
    for id in ClipId::ALL {
        let clip = small(id, 9);
        for index in [1, 5] {
            let mut open = vec![1.0f32; clip.size().pixels()];
            for shape in 0..clip.shapes(index) {
                let alpha = clip.shape_alpha(index, shape).unwrap();
                for (open, alpha) in open.iter_mut().zip(alpha.pixels()) {
                    *open *= 1.0 - alpha;
                }
            }
            assert!(clip.shape_alpha(index, clip.shapes(index)).is_none());
            let frame = clip.frame(index);
            for (open, alpha) in open.iter().zip(frame.alpha.pixels()) {
                // parts over parts: a few roundings each
                assert!((1.0 - open - alpha).abs() < 1e-5, "{id:?} {open} {alpha}");
            }
        }
    }
}

#[test]
fn frames_do_not_depend_on_order_or_threads() {
    let pool = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
    };
    let (one, many) = (pool(1), pool(4));
    for id in ClipId::ALL {
        let draw = || clip(id, size(64, 40), 7, Seed(5));
        let mut first = one.install(draw);
        let mut second = many.install(draw);
        first.noise_sigma = 3.0;
        second.noise_sigma = 3.0;
        let forwards: Vec<Frame> = one.install(|| (0..7).map(|i| first.frame(i)).collect());
        let backwards: Vec<Frame> =
            many.install(|| (0..7).rev().map(|i| second.frame(i)).collect());
        for (a, b) in forwards.iter().zip(backwards.iter().rev()) {
            assert_eq!(a, b, "{id:?}");
            assert_eq!(a.stored(), b.stored());
        }
        assert_eq!(first.truth(), second.truth());
    }
}

#[test]
fn another_seed_gives_another_clip_and_each_frame_its_own_noise() {
    for id in ClipId::ALL {
        let of = |seed| clip(id, size(64, 40), 5, Seed(seed)).frame(2).picture;
        assert_ne!(of(1), of(2), "{id:?}");
    }
    let mut still = small(ClipId::Walker, 4);
    let clean = still.frame(0);
    still.noise_sigma = 5.0;
    assert_ne!(still.frame(0).stored(), clean.stored());
    // the background of two frames differs by noise alone
    let corner = |index: usize| still.frame(index).stored()[(120, 3)];
    assert!(corner(0) != corner(1) || corner(1) != corner(2));
}

#[test]
fn clips_draw_at_any_small_size_and_length() {
    for id in ClipId::ALL {
        for (width, height) in [(1, 1), (16, 90), (90, 16)] {
            for frames in [0, 1, 2] {
                let clip = clip(id, size(width, height), frames, Seed(1));
                assert_eq!(clip.frames(), frames.max(1));
                walk(&clip.frame(0));
                // beyond the end the last shot goes on
                walk(&clip.frame(frames + 3));
            }
        }
    }
}

#[test]
fn truth_survives_as_data() {
    for id in ClipId::ALL {
        let truth = small(id, 4).truth();
        let text = serde_json::to_string(&truth).unwrap();
        let back: ClipTruth = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&back).unwrap(), text, "{id:?}");
        assert_eq!(truth.frames.len(), 4);
    }
}

#[test]
fn cuts_begin_shots_and_homographies_do_not_cross_them() {
    let clip = small(ClipId::Cuts, 120);
    assert_eq!(clip.cuts(), [40, 80]);
    let truth = clip.truth();
    assert_eq!(truth.cuts, [40, 80]);
    for frame in &truth.frames {
        assert_eq!(frame.shot, frame.index / 40);
    }
    let difference = |a: usize, b: usize| -> f64 {
        let (a, b) = (clip.frame(a).plate, clip.frame(b).plate);
        let pairs = a.pixels().iter().zip(b.pixels());
        pairs.map(|(a, b)| f64::from((a.0[1] - b.0[1]).abs())).sum()
    };
    for cut in [40, 80] {
        // the picture changes at a cut as it does nowhere near it
        let at = difference(cut - 1, cut);
        let before = difference(cut - 3, cut - 2);
        let after = difference(cut + 1, cut + 2);
        assert!(
            at > 1.5 * before && at > 1.5 * after,
            "{cut}: {before} {at} {after}"
        );
        assert!(clip.frame_from_frame(cut - 1, cut).is_none());
    }
    let there_and_back =
        clip.frame_from_frame(41, 57).unwrap() * clip.frame_from_frame(57, 41).unwrap();
    let scaled = there_and_back * (1.0 / there_and_back.z_axis.z);
    assert!(
        (scaled - DMat3::IDENTITY)
            .to_cols_array()
            .iter()
            .all(|v| v.abs() < 1e-9)
    );
    for id in ClipId::ALL.into_iter().filter(|id| *id != ClipId::Cuts) {
        assert!(small(id, 6).cuts().is_empty());
    }
}

/// The offset of a line from where truth says it is, at a place along it, in pixels across it: the centroid of what differs
/// from the ground beside the line. Nothing where the ground is uneven or the place is near the border.
fn offset_of(plate: &Image<LinearRgb>, line: &Line, along: f64) -> Option<f64> {
    let axis = (line.to - line.from).normalize();
    let middle = line.from.lerp(line.to, along);
    let reach = 0.5 * line.width_px + 1.5;
    let (columns, rows) = (plate.width() as f64, plate.height() as f64);
    let margin = reach + 12.0;
    if middle.min(DVec2::new(columns, rows) - middle).min_element() < margin {
        return None;
    }
    // a smooth window along the line, so that pixels enter and leave it gradually
    let near = |p: DVec2| {
        let t = p.dot(axis) / 8.0;
        (t.abs() < 1.0).then(|| {
            (
                0.5 + 0.5 * (std::f64::consts::PI * t).cos(),
                p.dot(axis.perp()),
            )
        })
    };
    let samples: Vec<(f64, f64, f64)> = plate
        .pixels()
        .iter()
        .enumerate()
        .filter_map(|(i, pixel)| {
            let p = DVec2::new(
                (i % plate.width()) as f64 + 0.5,
                (i / plate.width()) as f64 + 0.5,
            );
            let (window, across) = near(p - middle)?;
            Some((window, across, f64::from(pixel.0[1])))
        })
        .collect();
    let beside: Vec<&(f64, f64, f64)> = samples
        .iter()
        .filter(|(_, across, _)| (reach..reach + 2.5).contains(&across.abs()))
        .collect();
    let mean = |side: f64| {
        let own = || beside.iter().filter(|s| s.1 * side > 0.0);
        own().map(|s| s.2).sum::<f64>() / own().count() as f64
    };
    // the ground goes on evenly below the line
    let slope = 0.5 * (mean(1.0) - mean(-1.0)) / (reach + 1.25);
    let ground = |across: f64| 0.5 * (mean(-1.0) + mean(1.0)) + slope * across;
    let (level, tilt) = (ground(0.0), ground(1.0) - ground(0.0));
    let (mut weight, mut moment, mut windows) = (0.0, 0.0, 0.0);
    for (window, across, value) in samples.iter().filter(|s| s.1.abs() < reach) {
        let line = window * (value - level - tilt * across);
        weight += line;
        moment += line * across;
        windows += window;
    }
    let contrast = (weight / windows).abs() * 2.0 * reach / line.width_px;
    let rough = |s: &&(f64, f64, f64)| (s.2 - level - tilt * s.1).abs();
    let uneven = beside.iter().map(rough).fold(0.0, f64::max);
    (uneven < 0.03 * contrast).then(|| moment / weight)
}

#[test]
fn lines_are_drawn_where_the_homography_says() {
    // skies are even enough to measure on: a still camera, and one in a hand
    for (id, frames, least) in [(ClipId::StillDisc, 2, 3), (ClipId::Cuts, 45, 3)] {
        let clip = clip(id, size(400, 225), frames, Seed(4));
        let mut measured = 0;
        for index in (0..frames).step_by(3) {
            let plate = clip.frame(index).plate;
            for line in &clip.frame_truth(index).features.lines {
                for step in 1..100 {
                    if let Some(offset) = offset_of(&plate, line, 0.01 * f64::from(step)) {
                        assert!(
                            offset.abs() < 0.05,
                            "{id:?} frame {index} {} at {step} %: {offset}",
                            line.name
                        );
                        measured += 1;
                    }
                }
            }
        }
        assert!(measured >= least, "{id:?} {measured}");
    }
}

#[test]
fn outlines_enclose_the_area_of_alpha() {
    let still = clip(ClipId::StillDisc, size(200, 112), 12, Seed(1));
    for index in 0..12 {
        let shape = &still.frame_truth(index).shapes[0];
        let disc = shape.disc.unwrap();
        let alpha = sum(&still.shape_alpha(index, 0).unwrap());
        let area = std::f64::consts::PI * disc.radius_px * disc.radius_px;
        assert!((alpha - area).abs() < 1e-4 * area, "{alpha} {area}");
        assert!((polygon_area(&shape.outlines[0]) - area).abs() < 1e-6 * area);
    }
    // a star and a crate under a camera in motion, and a spinning leaf
    let cuts = clip(ClipId::Cuts, size(200, 112), 30, Seed(1));
    for index in 20..30 {
        let truth = cuts.frame_truth(index);
        for (number, shape) in truth.shapes.iter().enumerate() {
            let alpha = sum(&cuts.shape_alpha(index, number).unwrap());
            let area: f64 = shape.outlines.iter().map(|ring| polygon_area(ring)).sum();
            assert!(
                (alpha - area).abs() < 1e-4 * area,
                "{}: {alpha} {area}",
                shape.name
            );
        }
    }
}

fn polygon_area(ring: &[DVec2]) -> f64 {
    let turned = ring.iter().skip(1).chain(ring.first());
    let twice: f64 = ring.iter().zip(turned).map(|(a, b)| a.perp_dot(*b)).sum();
    0.5 * twice.abs()
}

#[test]
fn discs_on_the_plane_lie_where_truth_says() {
    // manhole covers are darker than the road around them
    let cars = clip(ClipId::Cars, size(480, 270), 2, Seed(2));
    let truth = cars.frame_truth(0);
    assert!(truth.features.discs.len() >= 2);
    let plate = cars.frame(0).plate;
    let mean = |center: DVec2, low: f64, high: f64| {
        let inside = |i: &usize| {
            let p = DVec2::new((i % 480) as f64 + 0.5, (i / 480) as f64 + 0.5);
            (low..high).contains(&p.distance(center))
        };
        let found: Vec<f64> = (0..480 * 270)
            .filter(inside)
            .map(|i| f64::from(plate.pixels()[i].0[1]))
            .collect();
        found.iter().sum::<f64>() / found.len() as f64
    };
    for disc in &truth.features.discs {
        let disc = disc.disc.unwrap();
        let r = disc.radius_px;
        assert!(mean(disc.center, 0.0, r - 0.7) < 0.6 * mean(disc.center, r + 0.7, r + 4.0));
    }
}

#[test]
fn a_still_camera_shows_the_same_plate_in_all_frames() {
    for id in [ClipId::StillDisc, ClipId::Walker, ClipId::Cars] {
        let clip = small(id, 10);
        let first = clip.frame(0).plate;
        assert!(
            (1..10).all(|index| clip.frame(index).plate == first),
            "{id:?}"
        );
    }
}

#[test]
fn a_shutter_smears_a_moving_shape_along_its_way_and_keeps_its_area() {
    let mut clip = clip(ClipId::StillDisc, size(200, 112), 6, Seed(1));
    let sharp = clip.frame(3).alpha;
    clip.shutter = 1.0;
    let blurred = clip.frame(3).alpha;
    assert!((sum(&sharp) - sum(&blurred)).abs() < 1e-3 * sum(&sharp));
    let partial = |plane: &Plane| {
        plane
            .pixels()
            .iter()
            .filter(|a| **a > 0.01 && **a < 0.99)
            .count()
    };
    assert!(partial(&blurred) > 3 * partial(&sharp));
}

#[test]
fn the_light_of_a_frame_is_what_truth_says() {
    let clip = small(ClipId::HandheldWall, 40);
    let gains: Vec<f64> = (0..40).map(|i| clip.frame_truth(i).light.gain).collect();
    let (low, high) = gains
        .iter()
        .fold((f64::INFINITY, 0.0f64), |(l, h), &g| (l.min(g), h.max(g)));
    assert!(high - low > 0.05);
    let cuts = small(ClipId::Cuts, 30);
    // the first shot appears from black, the last one goes to black
    for index in [0, 29] {
        assert_eq!(cuts.frame_truth(index).light.gain, 0.0);
        assert!(
            cuts.frame(index)
                .picture
                .pixels()
                .iter()
                .all(|p| p.0.iter().all(|v| *v == 0.0))
        );
    }
}

#[test]
fn posters_leave_the_frame_and_come_back() {
    let clip = small(ClipId::Poster, 60);
    let seen = |index: usize| {
        let quads = clip.frame_truth(index).features.quads;
        quads.iter().any(|quad| quad.name == "poster 1")
    };
    assert!(seen(0) && !seen(30) && seen(59));
    // perspective is strong: opposite sides of the poster differ by a fifth in some frame
    let skew = |index: usize| {
        let truth = clip.frame_truth(index);
        truth
            .features
            .quads
            .iter()
            .find(|q| q.name == "poster 1")
            .map_or(1.0, |quad| {
                let c = quad.corners;
                let (left, right) = (c[0].distance(c[3]), c[1].distance(c[2]));
                left.max(right) / left.min(right)
            })
    };
    assert!((0..60).map(skew).fold(0.0, f64::max) > 1.2);
    let m = clip.frame_from_frame(5, 2).unwrap();
    let corners = |index: usize| clip.frame_truth(index).features.quads[0].corners;
    for (from, to) in corners(2).into_iter().zip(corners(5)) {
        assert!(project(&m, from).unwrap().distance(to) < 1e-6);
    }
}
