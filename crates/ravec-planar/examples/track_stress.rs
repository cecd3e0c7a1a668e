//! Tracks drawn planes under stress, and prints the errors of the corners, their predicted deviations, and the time.
//!
//! ```sh
//! cargo run --release -p ravec-planar --example track_stress
//! ```
//!
//! A poster of a drawn street moves before another picture, 640 × 480, 100 frames, noise of 4 steps, exposed over half of the time
//! between frames. The truth is the mean over the exposure.

use glam::{DMat3, DVec2, dvec2};
use ravec_planar::track::{PlaneTracker, TrackParams, TrackRegion, TrackState};
use ravec_planar::{Homography, PointPair, encoded_luminance, estimate};
use ravec_raster::{AnyImage, Image, Plane, Size, Srgb, gaussian_blur, with_image};
use ravec_scenes::Seed;
use ravec_scenes::plane::facade;
use ravec_scenes::street::street;
use std::time::Instant;

const FRAMES: usize = 100;
const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const POSTER: DVec2 = dvec2(800.0, 640.0);

/// Moments of an exposure.
const MOMENTS: usize = 5;

/// Samples of a pixel to each side.
const SAMPLES: usize = 2;

/// Place of the middle of the poster, scale, turn and tilt at a time.
type Path = fn(f64) -> (DVec2, f64, f64, DVec2);

struct Case {
    name: &'static str,
    path: Path,
    shutter: f64,
    /// True for a place of a frame that something hides.
    hidden: fn(usize, DVec2) -> bool,
}

fn swaying(t: f64) -> (DVec2, f64, f64, DVec2) {
    (
        dvec2(20.0 * (t / 7.0).sin(), 15.0 * (t / 9.0).sin()),
        1.0 + 0.1 * (t / 11.0).sin(),
        0.1 * (t / 13.0).sin(),
        1e-4 * dvec2((t / 8.0).sin(), (t / 10.0).sin()),
    )
}

const CASES: &[Case] = &[
    Case {
        name: "swaying",
        path: swaying,
        shutter: 0.5,
        hidden: |_, _| false,
    },
    Case {
        name: "half hidden",
        path: swaying,
        shutter: 0.5,
        hidden: |index, p| index > 0 && p.x > 320.0 + 40.0 * (index as f64 / 10.0).sin(),
    },
    Case {
        name: "half outside",
        path: |t| {
            let (at, scale, turn, tilt) = swaying(t);
            (at + dvec2((6.0 * t).min(320.0), 0.0), scale, turn, tilt)
        },
        shutter: 0.5,
        hidden: |_, _| false,
    },
    Case {
        name: "30 pixels a frame",
        path: |t| {
            let at = dvec2(
                140.0 * (t * 30.0 / 140.0).sin(),
                60.0 * (t * 11.0 / 60.0).sin(),
            );
            (at, 1.0, 0.05 * (t / 9.0).sin(), DVec2::ZERO)
        },
        shutter: 0.5,
        hidden: |_, _| false,
    },
    Case {
        name: "60 pixels a frame",
        path: |t| {
            let at = dvec2(180.0, 60.0) * (t / 3.0).sin();
            (at, 1.0, 0.05 * (t / 9.0).sin(), DVec2::ZERO)
        },
        shutter: 0.5,
        hidden: |_, _| false,
    },
    Case {
        name: "away and back",
        path: |t| {
            let away = (t - 10.0).min(90.0 - t);
            let at = dvec2((40.0 * away).clamp(0.0, 900.0), 15.0 * (t / 9.0).sin());
            (at, 1.0, 0.0, DVec2::ZERO)
        },
        shutter: 0.5,
        hidden: |_, _| false,
    },
    Case {
        name: "jumps in turn and scale",
        path: |t| {
            let part = ((t + 0.5) / 34.0) as usize % 3;
            let (scale, turn) = [(1.0, 0.0), (0.6, 0.9), (1.3, -0.7)][part];
            (swaying(t).0, scale, turn, DVec2::ZERO)
        },
        shutter: 0.0,
        hidden: |_, _| false,
    },
    Case {
        name: "zoom by 0.37 to 2.7",
        path: |t| {
            let scale = (t / 16.0).sin().exp();
            (swaying(t).0, scale, 0.1 * (t / 13.0).sin(), DVec2::ZERO)
        },
        shutter: 0.5,
        hidden: |_, _| false,
    },
];

/// Pixels of the frame from those of the poster.
fn frame_from_poster(path: Path, t: f64) -> DMat3 {
    let (at, scale, turn, tilt) = path(t);
    let mut perspective = DMat3::IDENTITY;
    perspective.x_axis.z = tilt.x;
    perspective.y_axis.z = tilt.y;
    DMat3::from_translation(dvec2(320.0, 240.0) + at)
        * perspective
        * DMat3::from_scale_angle_translation(DVec2::splat(0.45 * scale), turn, DVec2::ZERO)
        * DMat3::from_translation(-0.5 * POSTER)
}

/// The maps at the moments of an exposure.
fn exposure(case: &Case, index: usize) -> Vec<DMat3> {
    let share = |k: usize| case.shutter * (k as f64 / (MOMENTS - 1) as f64 - 0.5);
    let times = (0..MOMENTS).map(|k| index as f64 + share(k));
    times.map(|t| frame_from_poster(case.path, t)).collect()
}

fn apply(m: &DMat3, p: DVec2) -> DVec2 {
    let image = *m * p.extend(1.0);
    image.truncate() / image.z
}

/// The corners, by the homography through the mean places of a grid of points.
fn truth(case: &Case, index: usize) -> [DVec2; 4] {
    let moments = exposure(case, index);
    let mut pairs = Vec::new();
    for k in 0..81 {
        let p = POSTER * dvec2(f64::from(k % 9), f64::from(k / 9)) / 8.0;
        let sum: DVec2 = moments.iter().map(|m| apply(m, p)).sum();
        pairs.push(PointPair::new(p, sum / moments.len() as f64));
    }
    let map: Homography = estimate(&pairs).expect("a grid determines a homography");
    let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    corners.map(|(x, y)| map.apply(POSTER * dvec2(x, y)))
}

fn bilinear(plane: &Plane, p: DVec2) -> Option<f64> {
    let (x, y) = (p.x - 0.5, p.y - 0.5);
    let (right, bottom) = (plane.width() as f64 - 1.0, plane.height() as f64 - 1.0);
    if !((0.0..right).contains(&x) && (0.0..bottom).contains(&y)) {
        return None;
    }
    let (col, row) = (x as usize, y as usize);
    let (tx, ty) = (x - col as f64, y - row as f64);
    let at = |dx: usize, dy: usize| f64::from(plane[(col + dx, row + dy)]);
    let upper = at(0, 0) + tx * (at(1, 0) - at(0, 0));
    let lower = at(0, 1) + tx * (at(1, 1) - at(0, 1));
    Some(upper + ty * (lower - upper))
}

/// The next number from 0 to 1 (the generator `SplitMix64`).
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

fn frame(case: &Case, index: usize, poster: &Plane, behind: &Plane) -> AnyImage {
    let moments: Vec<DMat3> = exposure(case, index).iter().map(DMat3::inverse).collect();
    let mut state = index as u64;
    let size = Size::new(WIDTH, HEIGHT).expect("a frame is not empty");
    let image = Image::from_fn(size, |col, row| {
        let corner = dvec2(col as f64, row as f64);
        let mut sum = 0.0;
        for m in &moments {
            for k in 0..SAMPLES * SAMPLES {
                let part = dvec2((k % SAMPLES) as f64, (k / SAMPLES) as f64) + 0.5;
                let p = corner + part / SAMPLES as f64;
                let seen = (!(case.hidden)(index, p)).then(|| bilinear(poster, apply(m, p)));
                let other = || bilinear(behind, p).unwrap_or(0.5);
                sum += seen.flatten().unwrap_or_else(other);
            }
        }
        let value = 255.0 * sum / (moments.len() * SAMPLES * SAMPLES) as f64;
        let noise = (0..4).map(|_| random(&mut state) - 0.5).sum::<f64>() * 3.0f64.sqrt() * 4.0;
        Srgb([(value + noise).round().clamp(0.0, 255.0) as u8; 3])
    });
    AnyImage::from(image)
}

/// Counts of the frames of a case.
#[derive(Default)]
struct Counts {
    tracked: usize,
    weak: usize,
    lost: usize,
    within: usize,
    over_five: usize,
    over_two_px: usize,
}

fn run(case: &Case, poster: &Plane, behind: &Plane) {
    let quad = truth(case, 0);
    let first = frame(case, 0, poster, behind);
    let params = TrackParams::default();
    let mut tracker = PlaneTracker::new(&first, quad, &TrackRegion::Quad, None, &params)
        .expect("the poster has texture");
    let (mut errors, mut counts, mut spent) = (Vec::new(), Counts::default(), 0.0);
    for index in 1..FRAMES {
        let frame = frame(case, index, poster, behind);
        let start = Instant::now();
        let tracked = tracker.push(&frame, None);
        spent += start.elapsed().as_secs_f64();
        let pairs = truth(case, index).into_iter().zip(tracked.corners);
        let error = pairs.map(|(a, b)| a.distance(b)).sum::<f64>() / 4.0;
        let sigma = tracked.sigma_px();
        match tracked.state {
            TrackState::Tracked => {
                counts.tracked += 1;
                counts.within += usize::from(error <= 2.0 * sigma);
                counts.over_five += usize::from(error > 5.0 * sigma);
                counts.over_two_px += usize::from(error > 2.0);
            }
            TrackState::Weak => counts.weak += 1,
            TrackState::Lost => counts.lost += 1,
        }
        if tracked.state != TrackState::Lost {
            errors.push(error);
        }
    }
    let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    let last = &errors[errors.len().saturating_sub(20)..];
    println!(
        "| {} | {:.4} | {:.4} | {:.3} | {}, {}, {} | {} | {} | {} | {:.1} |",
        case.name,
        mean(&errors),
        mean(last),
        errors.iter().copied().fold(0.0, f64::max),
        counts.tracked,
        counts.weak,
        counts.lost,
        counts.within,
        counts.over_five,
        counts.over_two_px,
        1000.0 * spent / (FRAMES - 1) as f64
    );
}

fn main() {
    let size = |width, height| Size::new(width, height).expect("a picture is not empty");
    let luma = |image: &AnyImage| with_image!(image, image => encoded_luminance(image));
    // no pixel is clipped
    let within = |plane: Plane| plane.map(|value| 0.05 + 0.9 * value);
    let poster = luma(&AnyImage::from(street(size(800, 640), Seed(3)).0));
    let poster = within(gaussian_blur(&poster, 0.8));
    let behind = within(luma(&AnyImage::from(
        facade(size(WIDTH, HEIGHT), Seed(5)).0,
    )));
    println!(
        "| case | mean px | last 20 | max | tracked, weak, lost | within 2 sigma | over 5 | over 2 px | ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for case in CASES {
        run(case, &poster, &behind);
    }
}
