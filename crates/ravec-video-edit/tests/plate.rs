//! Plates of drawn shots with known backgrounds.

use glam::dvec2;
use ravec_planar::Homography;
use ravec_progress::Progress;
use ravec_raster::{Image, Mask, Size};
use ravec_video_edit::{Colors, Plate, PlateSamples, ShotFrame, VideoEditError};

const SIZE: (usize, usize) = (120, 90);
const PAD: usize = 12;

fn size() -> Size {
    Size::new(SIZE.0, SIZE.1).unwrap()
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

/// The background at a point of the reference frame.
fn background(x: f64, y: f64) -> [f32; 3] {
    let wave = 0.1 * (0.21 * x + 0.09 * y).sin() + 0.08 * (0.17 * y - 0.05 * x).cos();
    [0.5 + wave, 0.55 - wave, 0.45 + 0.5 * wave].map(|value| value as f32)
}

struct Shot {
    colors: Colors,
    map: Homography,
    foreground: Mask,
}

/// Frame `index` of a camera that pans by half a pixel a frame, in an exposure that drifts, with a square at `(left, top)` of the
/// reference frame.
fn shot(index: usize, left: f64, top: f64) -> Shot {
    let pan = dvec2(-0.5 * index as f64, 0.2 * index as f64);
    let gain = 1.0 + 0.05 * (0.3 * index as f32).sin();
    let inside =
        |x: f64, y: f64| (left..left + 24.0).contains(&x) && (top..top + 30.0).contains(&y);
    let at = |col: usize, row: usize| (col as f64 + 0.5 - pan.x, row as f64 + 0.5 - pan.y);
    let colors = Image::from_fn(size(), |col, row| {
        let (x, y) = at(col, row);
        let color = if inside(x, y) {
            [0.85, 0.2, 0.25]
        } else {
            background(x, y)
        };
        [0, 1, 2].map(|c| {
            let seed = (index * 100_000 + row * 1000 + 3 * col + c) as u32;
            gain * color[c] + 0.01 * noise(seed)
        })
    });
    let foreground = Mask::from_fn(size(), |col, row| {
        let (x, y) = at(col, row);
        inside(x, y)
    });
    Shot {
        colors,
        map: Homography::from_translation(pan).unwrap(),
        foreground,
    }
}

/// The plate of shots; `marked` says in which frames the foreground is marked by strokes.
fn plate(shots: &[Shot], marked: impl Fn(usize) -> bool) -> Plate {
    let frame = |index: usize| {
        let shot = &shots[index];
        let strokes = marked(index).then_some(&shot.foreground);
        ShotFrame {
            foreground: strokes,
            strokes,
            is_reference: index == 0,
            ..ShotFrame::new(&shot.colors, &shot.map)
        }
    };
    let mut samples = PlateSamples::new(size(), PAD, Some(shots.len() as u64)).unwrap();
    (0..shots.len()).for_each(|index| samples.add(&frame(index)).unwrap());
    let mut modes = samples.modes(&Progress::none()).unwrap();
    (0..shots.len()).for_each(|index| modes.add(&frame(index)).unwrap());
    modes.plate()
}

/// Root mean square difference to the background over pixels that were seen, and the largest one.
fn error(plate: &Plate) -> (f64, f32) {
    let (mut sum, mut count, mut largest) = (0.0, 0, 0.0f32);
    for row in 0..plate.colors.height() {
        for col in 0..plate.colors.width() {
            if plate.seen.at(col, row) == 0.0 {
                continue;
            }
            let truth = background(col as f64 + 0.5 - PAD as f64, row as f64 + 0.5 - PAD as f64);
            for (found, truth) in plate.colors[(col, row)].into_iter().zip(truth) {
                sum += f64::from((found - truth).powi(2));
                largest = largest.max((found - truth).abs());
                count += 1;
            }
        }
    }
    ((sum / f64::from(count)).sqrt(), largest)
}

#[test]
fn a_square_that_passes_is_left_out_and_the_exposure_followed() {
    let shots: Vec<Shot> = (0..40)
        .map(|k| shot(k, 24.0 + 2.0 * k as f64, 20.0))
        .collect();
    let found = plate(&shots, |_| false);
    let (rms, largest) = error(&found);
    assert!(rms < 0.004 && largest < 0.04, "{rms} {largest}");
    let seen = found.seen.area_px() / found.colors.size().pixels() as f64;
    assert!((0.7..0.95).contains(&seen), "{seen}");
    assert!(found.certainty[(60, 80)] > 0.8);
    assert_eq!(found.certainty[(0, PAD)], 0.0);
}

#[test]
fn what_stands_for_half_of_the_shot_is_there_as_a_whole_or_not_at_all() {
    // noise alone decides at each pixel whether the square is more frequent
    let shots: Vec<Shot> = (0..40)
        .map(|k| shot(k, if k % 2 == 0 { 40.0 } else { -100.0 }, 30.0))
        .collect();
    let found = plate(&shots, |_| false);
    let red = |col: usize, row: usize| found.colors[(PAD + col, PAD + row)][0] > 0.75;
    let inside = (43..61).flat_map(|col| (33..57).map(move |row| (col, row)));
    let count = inside.filter(|&(col, row)| red(col, row)).count();
    assert!(count == 0 || count == 18 * 24, "{count} of {}", 18 * 24);
}

#[test]
fn strokes_uncover_what_is_hidden_most_of_the_time() {
    // the square stays, and leaves its place in every fifth frame
    let shots: Vec<Shot> = (0..40)
        .map(|k| {
            shot(
                k,
                if k % 5 == 4 {
                    74.0
                } else {
                    40.0 + (k % 3) as f64
                },
                30.0,
            )
        })
        .collect();
    let (_, covered) = error(&plate(&shots, |_| false));
    assert!(
        covered > 0.2,
        "{covered}: the square should win without strokes"
    );
    let found = plate(&shots, |index| index % 13 == 0);
    let (rms, largest) = error(&found);
    assert!(rms < 0.01 && largest < 0.2, "{rms} {largest}");
    assert!(found.seen.at(PAD + 52, PAD + 45) > 0.0);
}

#[test]
fn what_is_hidden_always_is_not_seen() {
    let shots: Vec<Shot> = (0..24)
        .map(|k| shot(k, 40.0 + (k % 7) as f64, 30.0))
        .collect();
    let found = plate(&shots, |_| true);
    assert_eq!(found.seen.at(PAD + 53, PAD + 45), 0.0);
    assert_eq!(found.certainty[(PAD + 53, PAD + 45)], 0.0);
    // its colors continue those around it
    let color = found.colors[(PAD + 53, PAD + 45)];
    assert!(
        (color[0] - 0.5).abs() < 0.25 && color[0] < 0.75,
        "{color:?}"
    );
}

#[test]
fn threads_do_not_change_the_plate() {
    let shots: Vec<Shot> = (0..12).map(|k| shot(k, 6.0 * k as f64, 20.0)).collect();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| plate(&shots, |index| index == 3))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn long_shots_keep_a_part_of_their_frames() {
    let shots: Vec<Shot> = (0..6)
        .map(|k| shot(k, 10.0 + 12.0 * k as f64, 20.0))
        .collect();
    let mut samples = PlateSamples::new(size(), PAD, None).unwrap();
    for index in 0..400 {
        let shot = &shots[index % 6];
        samples
            .add(&ShotFrame::new(&shot.colors, &shot.map))
            .unwrap();
    }
    let modes = samples.modes(&Progress::none()).unwrap();
    let (rms, _) = error(&modes.plate());
    assert!(rms < 0.02, "{rms}");
}

#[test]
fn errors_and_broken_frames() {
    let one = shot(0, 10.0, 20.0);
    let mut samples = PlateSamples::new(size(), 0, None).unwrap();
    let other = Colors::new(Size::new(5, 5).unwrap(), [0.0; 3]);
    let refused = samples.add(&ShotFrame::new(&other, &one.map));
    assert!(matches!(refused, Err(VideoEditError::SizesDiffer { .. })));
    let empty = PlateSamples::new(size(), 0, None)
        .unwrap()
        .modes(&Progress::none());
    assert!(matches!(empty, Err(VideoEditError::NoFrames)));
    let large = PlateSamples::new(size(), usize::MAX / 2, None);
    assert!(matches!(large, Err(VideoEditError::PlateTooLarge { .. })));
    let broken = Colors::new(size(), [f32::NAN, 0.5, f32::INFINITY]);
    samples.add(&ShotFrame::new(&broken, &one.map)).unwrap();
    let modes = samples.modes(&Progress::none()).unwrap();
    let plate = modes.plate();
    assert!(plate.seen.is_empty());
    assert!(
        plate
            .colors
            .pixels()
            .iter()
            .flatten()
            .all(|value| value.is_finite())
    );
}
