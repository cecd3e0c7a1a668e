//! Judges of clips, on procedural frames whose shapes and motions are known.

use super::*;
use crate::{Deformation, Retargeter};
use glam::{DMat3, DVec2, dvec2};
use ravec_raster::{AnyImage, Image, LinearRgba, Mask, Srgb, with_image};

const WIDTH: usize = 240;
const HEIGHT: usize = 136;

fn size() -> Size {
    Size::new(WIDTH, HEIGHT).unwrap()
}

fn target(percent: usize) -> Size {
    Size::new(WIDTH * percent / 100, HEIGHT).unwrap()
}

/// Cheaper than the default, and as good for what is judged here.
fn options(look_ahead: usize) -> ClipOptions {
    ClipOptions {
        grid_cells: 24,
        look_ahead,
        voxel_frames: 8,
        ..ClipOptions::default()
    }
}

fn noise(x: i64, y: i64, seed: u64) -> f32 {
    let mut h = seed
        ^ (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (y as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (h >> 40) as f32 / (1u64 << 24) as f32
}

/// A scene: an even sky, a rough strip below, two lines, and discs.
#[derive(Debug, Clone)]
struct Scene {
    discs: Vec<(DVec2, f64)>,
    lines: Vec<[DVec2; 2]>,
    grain: f32,
}

impl Scene {
    fn with_discs(discs: &[(DVec2, f64)]) -> Self {
        Self {
            discs: discs.to_vec(),
            lines: vec![
                [dvec2(165.0, 8.0), dvec2(200.0, 128.0)],
                [dvec2(10.0, 30.0), dvec2(230.0, 20.0)],
            ],
            grain: 0.015,
        }
    }

    /// The scene as seen by a camera whose frame has its origin at `from`.
    fn frame(&self, from: DVec2, seed: u64) -> AnyImage {
        Image::from_fn(size(), |col, row| {
            let at = dvec2(col as f64 + 0.5, row as f64 + 0.5) + from;
            let below = at.y > 100.0;
            let cell = (at / 3.0).floor();
            let rough = if below {
                0.2 * (noise(cell.x as i64, cell.y as i64, 7) - 0.5)
            } else {
                0.0
            };
            let mut color = [0.75 + rough, 0.78 + rough, 0.8 + rough];
            for (k, line) in self.lines.iter().enumerate() {
                let along = (line[1] - line[0]).normalize();
                let t = (at - line[0]).dot(along);
                let away = (at - line[0]).perp_dot(along).abs();
                if (0.0..(line[1] - line[0]).length()).contains(&t) {
                    let share = (2.5 - away).clamp(0.0, 1.0) as f32;
                    let ink = if k == 0 {
                        [0.7, 0.05, 0.05]
                    } else {
                        [0.5, 0.05, 0.5]
                    };
                    for c in 0..3 {
                        color[c] += share * (ink[c] - color[c]);
                    }
                }
            }
            for &(center, radius) in &self.discs {
                let share = (radius + 0.5 - at.distance(center)).clamp(0.0, 1.0) as f32;
                for (value, ink) in color.iter_mut().zip([0.05, 0.1, 0.6]) {
                    *value += share * (ink - *value);
                }
            }
            let grain = self.grain * (noise(col as i64, row as i64, seed + 100) - 0.5);
            Srgb(color.map(|v| ((v + grain).clamp(0.0, 1.0) * 255.0 + 0.5) as u8))
        })
        .into()
    }
}

/// Runs a clip with motions.
fn run(
    frames: Vec<(AnyImage, FrameMotion)>,
    targets: &[Size],
    options: &ClipOptions,
) -> (Vec<Settled>, ClipReport) {
    let none = Progress::none();
    let count = frames.len();
    let mut clip = ClipRetargeter::new(size(), targets, options).unwrap();
    let mut settled = Vec::new();
    for (image, motion) in frames {
        settled.extend(clip.push(ClipFrame::new(image, motion), &none).unwrap());
    }
    settled.extend(clip.finish(&none).unwrap());
    let numbers: Vec<usize> = settled.iter().map(|s| s.frame).collect();
    assert_eq!(numbers, (0..count).collect::<Vec<_>>());
    for frame in &settled {
        assert_eq!(frame.deformations.len(), targets.len());
        frame.deformations.iter().for_each(assert_one_to_one);
    }
    (settled, clip.report().clone())
}

fn still(frames: impl IntoIterator<Item = AnyImage>) -> Vec<(AnyImage, FrameMotion)> {
    frames
        .into_iter()
        .map(|image| (image, FrameMotion::STILL))
        .collect()
}

/// The walker over all cells: every corner turns the right way.
fn assert_one_to_one(found: &Deformation) {
    for (corners, _) in found.cells() {
        for k in 0..4 {
            let [before, here, after] = [k + 3, k, k + 1].map(|k: usize| corners[k % 4]);
            assert!((after - here).perp_dot(before - here) > 0.0, "{corners:?}");
        }
    }
}

fn vertices(found: &Deformation) -> &[DVec2] {
    &found.vertices
}

/// The largest distance of equal vertices.
fn apart(a: &Deformation, b: &Deformation) -> f64 {
    let pairs = vertices(a).iter().zip(vertices(b));
    pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
}

/// Width over height of what a disc has become, or its inverse.
fn squeezed(found: &Deformation, center: DVec2, radius: f64) -> f64 {
    let rim: Vec<DVec2> = (0..90)
        .map(|k| {
            let on = DVec2::from_angle(f64::from(k).to_radians() * 4.0);
            found.target_from_source(center + radius * on)
        })
        .collect();
    let extent = |axis: usize| {
        let values = || rim.iter().map(|p| p[axis]);
        values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min)
    };
    let aspect = extent(0) / extent(1);
    aspect.max(1.0 / aspect)
}

/// Places on a line in the new frame.
fn along(found: &Deformation, line: [DVec2; 2]) -> Vec<DVec2> {
    (0..=40)
        .map(|k| found.target_from_source(line[0].lerp(line[1], f64::from(k) / 40.0)))
        .collect()
}

/// The root mean square distance of points from the straight line nearest to them.
fn bent(points: &[DVec2]) -> f64 {
    let n = points.len() as f64;
    let mean = points.iter().sum::<DVec2>() / n;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = *p - mean;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    let least = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
    (least.max(0.0) / n).sqrt()
}

/// A disc that crosses the frame, 4 pixels a frame.
fn crossing(count: usize) -> Vec<AnyImage> {
    (0..count)
        .map(|t| {
            let center = dvec2(40.0 + 4.0 * t as f64, 72.0);
            Scene::with_discs(&[(center, 17.0)]).frame(DVec2::ZERO, t as u64)
        })
        .collect()
}

#[test]
fn equal_frames_have_the_deformation_of_the_still_picture() {
    let image = Scene::with_discs(&[(dvec2(80.0, 70.0), 20.0)]).frame(DVec2::ZERO, 1);
    let options = options(6);
    let targets = [target(60), target(130)];
    let stills: Vec<Deformation> = with_image!(&image, image => {
        let params = options.still_params();
        let found =
            Retargeter::new(image, Painted::default(), &params, &Progress::none()).unwrap();
        targets.iter().map(|&t| found.solve(t).unwrap()).collect()
    });
    let frames = still((0..21).map(|_| image.clone()));
    let (settled, report) = run(frames, &targets, &options);
    for frame in &settled {
        for (found, still) in frame.deformations.iter().zip(&stills) {
            assert_eq!(vertices(found), vertices(still), "frame {}", frame.frame);
            assert_eq!(found.summary(), still.summary());
        }
        assert_eq!(frame.image, image);
    }
    assert_eq!(report.keys_solved, 1);
    assert_eq!(report.max_second_difference_px, 0.0);
    assert_eq!(report.moving_voxels, 0);
}

#[test]
fn equal_frames_with_equal_masks_have_the_deformation_of_the_painted_picture() {
    let image = Scene::with_discs(&[(dvec2(80.0, 70.0), 20.0)]).frame(DVec2::ZERO, 1);
    let protect = Mask::from_disc(size(), dvec2(190.0, 60.0), 16.0).unwrap();
    let give_way = Mask::from_disc(size(), dvec2(80.0, 70.0), 20.0).unwrap();
    let options = options(6);
    let painted = Painted {
        protect: Some(&protect),
        give_way: Some(&give_way),
    };
    let none = Progress::none();
    let found = with_image!(&image, image => {
        Retargeter::new(image, painted, &options.still_params(), &none).unwrap()
    });
    let expected = found.solve(target(60)).unwrap();
    let mut clip = ClipRetargeter::new(size(), &[target(60)], &options).unwrap();
    let mut settled = Vec::new();
    for _ in 0..9 {
        let frame = ClipFrame {
            protect: Some(&protect),
            give_way: Some(&give_way),
            ..ClipFrame::new(image.clone(), FrameMotion::STILL)
        };
        settled.extend(clip.push(frame, &none).unwrap());
    }
    settled.extend(clip.finish(&none).unwrap());
    assert_eq!(settled.len(), 9);
    for frame in settled {
        assert!(apart(&frame.deformations[0], &expected) < 1e-9);
    }
}

#[test]
fn a_moving_disc_stays_round_and_fixed_lines_straight_and_in_place() {
    let scene = Scene::with_discs(&[]);
    for (percent, round) in [(75, 1.06), (50, 1.14)] {
        let (settled, report) = run(still(crossing(20)), &[target(percent)], &options(25));
        let deformations: Vec<&Deformation> = settled.iter().map(|s| &s.deformations[0]).collect();
        let mut aspects = Vec::new();
        for (t, found) in deformations.iter().enumerate() {
            aspects.push(squeezed(found, dvec2(40.0 + 4.0 * t as f64, 72.0), 17.0));
            for line in &scene.lines {
                let bend = bent(&along(found, *line));
                assert!(bend < 0.15, "{percent} %, frame {t}: {bend}");
            }
        }
        let mean = aspects.iter().sum::<f64>() / aspects.len() as f64;
        assert!(mean <= round, "{percent} %: {mean}, {aspects:?}");
        // most of the clip counts in full for each frame
        for pair in deformations.windows(2) {
            let jitter = scene
                .lines
                .iter()
                .flat_map(|&line| along(pair[0], line).into_iter().zip(along(pair[1], line)))
                .map(|(a, b)| a.distance(b))
                .fold(0.0, f64::max);
            assert!(jitter <= 0.05, "{percent} %: {jitter}");
        }
        assert!(report.least_area > 0.0);
        if percent == 50 {
            assert!(report.min_object_scale < 1.0, "{report:?}");
        }
    }
}

#[test]
fn a_reversed_clip_has_nearly_the_reversed_deformations() {
    let frames = crossing(33);
    let options = options(9);
    let (forward, _) = run(still(frames.clone()), &[target(60)], &options);
    let (backward, _) = run(still(frames.into_iter().rev()), &[target(60)], &options);
    for (a, b) in forward.iter().zip(backward.iter().rev()) {
        let apart = apart(&a.deformations[0], &b.deformations[0]);
        // slabs begin at the other end: less than half a cell
        assert!(apart < 4.0, "frame {}: {apart}", a.frame);
    }
}

#[test]
fn windows_of_any_length_that_hold_the_clip_agree_and_shorter_ones_nearly() {
    let count = 20;
    let scenes = crossing(count);
    let (long, _) = run(still(scenes.clone()), &[target(75)], &options(200));
    let (longer, _) = run(still(scenes.clone()), &[target(75)], &options(500));
    for (a, b) in long.iter().zip(&longer) {
        assert_eq!(vertices(&a.deformations[0]), vertices(&b.deformations[0]));
    }
    let (short, _) = run(still(scenes), &[target(75)], &options(8));
    for (a, b) in long.iter().zip(&short) {
        let apart = apart(&a.deformations[0], &b.deformations[0]);
        // a cell has 10 pixels
        assert!(apart < 10.0, "frame {}: {apart}", a.frame);
    }
}

#[test]
fn nothing_crosses_a_cut() {
    let first = crossing(14);
    let second: Vec<AnyImage> = (0..12)
        .map(|t| {
            let center = dvec2(150.0 - 5.0 * f64::from(t), 50.0);
            Scene::with_discs(&[(center, 22.0)]).frame(dvec2(13.0, -9.0), 40 + t as u64)
        })
        .collect();
    let options = options(10);
    let (alone, _) = run(still(second.clone()), &[target(70)], &options);
    let (before, _) = run(still(first.clone()), &[target(70)], &options);
    let mut frames = still(first);
    frames.extend(still(second));
    frames[14].1 = FrameMotion::CUT;
    let (both, report) = run(frames, &[target(70)], &options);
    assert_eq!(report.cuts, [14]);
    for (found, expected) in both.iter().zip(before.iter().chain(&alone)) {
        assert_eq!(
            vertices(&found.deformations[0]),
            vertices(&expected.deformations[0])
        );
    }
}

#[test]
fn frames_are_held_no_longer_than_promised() {
    let small = Size::new(48, 32).unwrap();
    for (look_ahead, voxel_frames, sample_frames, count) in [
        (10, 8, 2, 60),
        (10, 8, 2, 600),
        (1, 2, 8, 90),
        (25, 16, 2, 150),
        (40, 64, 4, 300),
    ] {
        let options = ClipOptions {
            grid_cells: 8,
            saliency: 0.0,
            line_strength: 0.0,
            look_ahead,
            voxel_frames,
            sample_frames,
            ..ClipOptions::default()
        };
        let most = 2 * look_ahead + voxel_frames.max(sample_frames) + 24;
        let mut clip = ClipRetargeter::new(small, &[Size::new(30, 32).unwrap()], &options).unwrap();
        let mut settled = 0;
        for t in 0..count {
            let image = Image::from_fn(small, |col, row| {
                Srgb([((col + t) % 16 * 16) as u8, (row * 8) as u8, 90])
            });
            // sometimes the camera stands
            let speed = if t / 50 % 2 == 0 { -1.0 } else { 0.0 };
            let motion = FrameMotion {
                frame_from_previous: DMat3::from_translation(dvec2(speed, 0.0)),
                cut: false,
            };
            let frame = ClipFrame::new(image.into(), motion);
            let found = clip.push(frame, &Progress::none()).unwrap();
            for frame in &found {
                assert_eq!(frame.frame, settled);
                settled += 1;
            }
            assert!(t + 1 - settled <= most, "{t} {settled}: {most}");
        }
        assert!(clip.report().max_frames_held <= most + 1);
        settled += clip.finish(&Progress::none()).unwrap().len();
        assert_eq!(settled, count);
    }
}

/// A shot of a camera that moves by `path`: frames with known motion.
fn moved(scene: &Scene, path: &[DVec2]) -> Vec<(AnyImage, FrameMotion)> {
    path.iter()
        .enumerate()
        .map(|(t, &from)| {
            let before = path[t.saturating_sub(1)];
            let motion = FrameMotion {
                frame_from_previous: DMat3::from_translation(before - from),
                cut: false,
            };
            (scene.frame(from, t as u64), motion)
        })
        .collect()
}

/// The second temporal differences of points of the scene in the new frames, less those of the camera's own motion at plain
/// scaling: their mean and the largest.
fn jitter(settled: &[Settled], path: &[DVec2], points: &[DVec2]) -> [f64; 2] {
    let new = settled[0].deformations[0].size();
    let factor = dvec2(
        new.width() as f64 / WIDTH as f64,
        new.height() as f64 / HEIGHT as f64,
    );
    let mut all = Vec::new();
    for &point in points {
        let places: Vec<DVec2> = settled
            .iter()
            .zip(path)
            .map(|(frame, &from)| {
                let found = &frame.deformations[0];
                found.target_from_source(point - from) - factor * (point - from)
            })
            .collect();
        let second = places
            .windows(3)
            .map(|p| (p[0] - 2.0 * p[1] + p[2]).length());
        all.extend(second);
    }
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    [mean, all.iter().copied().fold(0.0, f64::max)]
}

/// Runs a shot of a standing disc and judges its shape and its jitter.
fn assert_steady(path: &[DVec2], percent: usize) {
    let disc = (dvec2(120.0, 60.0), 18.0);
    let scene = Scene::with_discs(&[disc]);
    let options = ClipOptions {
        grid_cells: 32,
        ..options(20)
    };
    let (settled, report) = run(moved(&scene, path), &[target(percent)], &options);
    let aspects: Vec<f64> = settled
        .iter()
        .zip(path)
        .map(|(frame, &from)| squeezed(&frame.deformations[0], disc.0 - from, disc.1))
        .collect();
    let most = aspects.iter().copied().fold(0.0, f64::max);
    let least = aspects.iter().copied().fold(f64::MAX, f64::min);
    let rim: Vec<DVec2> = (0..8)
        .map(|k| disc.0 + disc.1 * DVec2::from_angle(f64::from(k)))
        .collect();
    let [mean, largest] = jitter(&settled, path, &rim);
    println!("aspect {least:.4} to {most:.4}, jitter {mean:.4} {largest:.4}, {report:?}");
    assert!(most / least <= 1.03, "{aspects:?}");
    assert!(mean <= 0.05 && largest <= 0.15, "{mean} {largest}");
}

#[test]
fn a_standing_disc_keeps_its_shape_while_the_camera_pans() {
    let path: Vec<DVec2> = (0..40)
        .map(|t| dvec2(-50.0 + 2.0 * f64::from(t), 0.0))
        .collect();
    assert_steady(&path, 75);
}

#[test]
fn a_standing_disc_keeps_its_shape_while_the_camera_is_held_by_hand() {
    let path: Vec<DVec2> = (0..40)
        .map(|t| {
            let slow = dvec2((0.13 * f64::from(t)).sin(), (0.17 * f64::from(t)).cos());
            let fast = [11, 12].map(|seed| f64::from(noise(i64::from(t), 3, seed)) - 0.5);
            8.0 * slow + 1.5 * DVec2::from_array(fast)
        })
        .collect();
    assert_steady(&path, 60);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let frames = still(crossing(18));
    let runs = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| run(frames.clone(), &[target(60)], &options(8)))
    });
    let [(a, first), (b, second)] = runs;
    assert_eq!(first, second);
    for (a, b) in a.iter().zip(&b) {
        assert_eq!(vertices(&a.deformations[0]), vertices(&b.deformations[0]));
        let none = Progress::none();
        assert_eq!(a.warp(0, &none).unwrap(), b.warp(0, &none).unwrap());
    }
}

#[test]
fn bad_input_is_refused_with_a_sentence() {
    let none = Progress::none();
    let image = Scene::with_discs(&[]).frame(DVec2::ZERO, 0);
    let options = options(5);
    assert!(matches!(
        ClipRetargeter::new(size(), &[], &options),
        Err(RetargetError::NoTarget)
    ));
    assert!(matches!(
        ClipRetargeter::new(size(), &[Size::new(5000, 5).unwrap()], &options),
        Err(RetargetError::Factor { .. })
    ));
    let wrong = ClipOptions {
        look_ahead: 0,
        ..options.clone()
    };
    assert!(matches!(
        ClipRetargeter::new(size(), &[target(50)], &wrong),
        Err(RetargetError::Parameter { .. })
    ));
    let mut clip = ClipRetargeter::new(size(), &[target(50)], &options).unwrap();
    let other: AnyImage = Image::new(Size::new(9, 9).unwrap(), Srgb([0u8; 3])).into();
    let error = clip
        .push(ClipFrame::new(other, FrameMotion::STILL), &none)
        .unwrap_err();
    assert!(error.to_string().contains("9 x 9"), "{error}");
    let mask = Mask::empty(Size::new(9, 9).unwrap());
    let frame = ClipFrame {
        protect: Some(&mask),
        ..ClipFrame::new(image.clone(), FrameMotion::STILL)
    };
    assert!(matches!(
        clip.push(frame, &none),
        Err(RetargetError::MaskSize { .. })
    ));
    clip.push(ClipFrame::new(image.clone(), FrameMotion::STILL), &none)
        .unwrap();
    for matrix in [
        DMat3::ZERO,
        DMat3::from_cols_array(&[f64::NAN; 9]),
        DMat3::from_translation(dvec2(1e9, 0.0)),
    ] {
        let motion = FrameMotion {
            frame_from_previous: matrix,
            cut: false,
        };
        let error = clip
            .push(ClipFrame::new(image.clone(), motion), &none)
            .unwrap_err();
        assert_eq!(error, RetargetError::Motion { frame: 1 });
    }
    let settled = clip.finish(&none).unwrap();
    assert!(matches!(
        settled[0].warp(1, &none),
        Err(RetargetError::NoTarget)
    ));
}

#[test]
fn work_stops_wherever_it_is_cancelled() {
    let frames = crossing(10);
    for check in [1, 2, 4, 8, 16, 24] {
        let progress = Progress::cancelled_at(check);
        let mut clip = ClipRetargeter::new(size(), &[target(60)], &options(3)).unwrap();
        let mut result = Ok(Vec::new());
        for image in frames.clone() {
            result = clip.push(ClipFrame::new(image, FrameMotion::STILL), &progress);
            if result.is_err() {
                break;
            }
        }
        if result.is_ok() {
            result = clip.finish(&progress);
        }
        assert!(
            matches!(result, Err(RetargetError::Cancelled(_))),
            "{check}"
        );
    }
}

#[test]
fn frames_that_are_not_numbers_are_only_frames() {
    let frames = (0..6).map(|t| {
        let image = Image::from_fn(size(), |col, row| {
            if (col + row + t) % 13 == 0 {
                LinearRgba([f32::NAN, f32::INFINITY, -1e30, 0.5])
            } else {
                LinearRgba([0.2, 0.4, 0.1, 1.0])
            }
        });
        image.into()
    });
    let (settled, report) = run(still(frames), &[target(60)], &options(3));
    assert!(report.least_area > 0.0);
    let warped = settled[3].warp(0, &Progress::none()).unwrap();
    assert_eq!(warped.size(), target(60));
}

#[test]
fn clips_of_one_and_two_frames_are_clips() {
    for count in 1..=3 {
        let (settled, report) = run(still(crossing(count)), &[target(60)], &options(5));
        assert_eq!((settled.len(), report.frames), (count, count));
    }
    let mut none = ClipRetargeter::new(size(), &[target(60)], &options(5)).unwrap();
    assert!(none.finish(&Progress::none()).unwrap().is_empty());
}
