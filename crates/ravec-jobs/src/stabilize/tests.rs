//! `stabilize` on clips whose motion is known.

use super::*;
use crate::ErrorKind;
use crate::plane::Quad;
use crate::track;
use crate::track::tests::{FRAMES, Wall, noise, wall_size};
use ravec::raster::{Image, Srgb};

fn operation(wall: &Wall, output: &str) -> Stabilize {
    Stabilize {
        input: wall.clip(),
        output: wall.at(output),
        track: None,
        params: Params::default(),
    }
}

fn frame(wall: &Wall, name: &str) -> Image<Srgb<u8>> {
    let picture = ravec_media::read(wall.at(name), &ravec_media::Limits::default());
    picture.unwrap().convert()
}

/// Mean difference of the middle of two pictures, in 8-bit steps.
fn difference(a: &Image<Srgb<u8>>, b: &Image<Srgb<u8>>) -> f64 {
    let (width, height) = (a.width(), a.height());
    let mut sum = 0.0;
    let mut count = 0.0;
    for row in height / 4..height * 3 / 4 {
        for col in width / 4..width * 3 / 4 {
            for k in 0..3 {
                sum += f64::from(a[(col, row)].0[k].abs_diff(b[(col, row)].0[k]));
                count += 1.0;
            }
        }
    }
    sum / count
}

#[test]
fn the_whole_picture_stands_still_as_in_the_first_frame() {
    let wall = Wall::new();
    let report = operation(&wall, "s_%04d.png")
        .run(&Context::default())
        .unwrap();
    assert_eq!(report.figures["frames"], FRAMES as f64);
    assert_eq!(report.figures["lost"], 0.0);
    let first = frame(&wall, "f_0000.png");
    for index in 1..FRAMES {
        let moved = difference(&first, &frame(&wall, &format!("f_{index:04}.png")));
        let still = difference(&first, &frame(&wall, &format!("s_{index:04}.png")));
        // noise and the change of light stay
        assert!(
            still < 5.0 && still < 0.8 * moved,
            "frame {index}: {moved} {still}"
        );
    }
}

#[test]
fn a_track_holds_its_plane_still_in_its_frames() {
    let wall = Wall::new();
    let corners = [
        dvec2(60.0, 40.0),
        dvec2(260.0, 40.0),
        dvec2(260.0, 200.0),
        dvec2(60.0, 200.0),
    ];
    let tracked = track::Track {
        input: wall.clip(),
        output: Some(wall.at("track.json").to_str().unwrap().parse().unwrap()),
        exports: Vec::new(),
        show: None,
        track: None,
        mask: None,
        exclude: None,
        strokes: None,
        photo: None,
        params: track::Params {
            quads: vec![Quad(corners)],
            reference: Some(4),
            frames: "2..8".parse().ok(),
            ..track::Params::default()
        },
    };
    tracked.run(&Context::default()).unwrap();
    let mut operation = operation(&wall, "s_%04d.png");
    operation.track = Some(wall.at("track.json"));
    let report = operation.run(&Context::default()).unwrap();
    assert_eq!(report.figures["frames"], 6.0);
    let reference = frame(&wall, "f_0004.png");
    for (output, input) in [(0, 2), (2, 4), (5, 7)] {
        let still = difference(&reference, &frame(&wall, &format!("s_{output:04}.png")));
        let moved = difference(&reference, &frame(&wall, &format!("f_{input:04}.png")));
        assert!(
            still < 4.0 && still <= moved,
            "frame {input}: {moved} {still}"
        );
    }
    operation.params.plane = 2;
    let error = operation.run(&Context::default()).unwrap_err();
    assert!(
        error.kind() == ErrorKind::Request && error.to_string().contains("the track has 1"),
        "{error}"
    );
}

#[test]
fn smooth_motion_has_a_stated_crop() {
    let wall = Wall::new();
    let mut operation = operation(&wall, "s_%04d.png");
    operation.params.mode = Mode::Smooth;
    operation.params.strength = 1.0;
    let report = operation.run(&Context::default()).unwrap();
    let figure = |name| report.figures[name];
    assert!(figure("crop_percent") > 0.0 && figure("crop_percent") <= 10.0);
    assert!(figure("jitter_after_px") < 0.5 * figure("jitter_before_px"));
    let cropped = frame(&wall, "s_0004.png");
    // nothing black comes in
    let corner = |col: usize, row: usize| cropped[(col, row)] != Srgb([0; 3]);
    let (right, low) = (wall_size().width() - 1, wall_size().height() - 1);
    assert!(corner(0, 0) && corner(right, 0) && corner(0, low) && corner(right, low));
}

#[test]
fn borders_are_black_repeated_or_those_of_the_last_frame() {
    let wall = Wall::new();
    let run = |border: Border, name: &str| {
        let mut operation = operation(&wall, name);
        operation.params.border = border;
        operation.run(&Context::default()).unwrap();
    };
    run(Border::Black, "b_%04d.png");
    run(Border::Repeat, "r_%04d.png");
    run(Border::Last, "l_%04d.png");
    let black = Srgb([0u8; 3]);
    let mut outside = 0;
    for index in 1..FRAMES {
        let names = ["b", "r", "l"].map(|name| format!("{name}_{index:04}.png"));
        let [b, r, l] = names.map(|name| frame(&wall, &name));
        let before = frame(&wall, &format!("l_{:04}.png", index - 1));
        for (at, pixel) in b.pixels().iter().enumerate() {
            if *pixel == black && r.pixels()[at] != black {
                outside += 1;
                assert_eq!(l.pixels()[at], before.pixels()[at], "frame {index}");
            }
        }
    }
    assert!(outside > 50, "the camera moves: {outside}");
}

#[test]
fn lost_frames_keep_the_last_pose_and_are_named() {
    let wall = Wall::with(|index, image| if index == 5 { noise(5) } else { image });
    let report = operation(&wall, "s_%04d.png")
        .run(&Context::default())
        .unwrap();
    assert_eq!(
        report.warnings,
        ["the last known pose is kept where the plane is lost: frames 5"]
    );
    assert_eq!(report.outputs[0].frames, Some(FRAMES as u64));
    let hopeless = Wall::with(|index, image| if index > 0 { noise(index) } else { image });
    let clip = Stabilize {
        output: hopeless.at("s.y4m"),
        ..operation(&hopeless, "")
    };
    let error = clip.run(&Context::default()).unwrap_err();
    assert!(matches!(error, JobError::TrackLost { .. }), "{error}");
    assert!(!hopeless.at("s.y4m").exists());
}

#[test]
fn parameters_out_of_range_are_refused() {
    let wall = Wall::new();
    let refused = |change: &dyn Fn(&mut Stabilize), part: &str| {
        let mut operation = operation(&wall, "s_%04d.png");
        change(&mut operation);
        let error = operation.run(&Context::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Request, "{error}");
        assert!(error.to_string().contains(part), "{error}");
    };
    refused(&|o| o.params.strength = f64::NAN, "`strength`");
    refused(&|o| o.params.max_crop = 0.5, "`max_crop`");
    refused(&|o| o.params.plane = 0, "`plane`");
    refused(&|o| o.output = wall.at("s.doc"), "s.doc");
    refused(&|o| o.output = wall.at("f_%04d.png"), "it is an input");
}

#[test]
fn each_shot_stands_still_against_its_own_first_frame() {
    let cut = FRAMES / 2;
    // the second shot sees the same motion of other things
    let wall = Wall::with(|index, image| {
        if index < cut {
            return image;
        }
        let (width, height) = (image.width(), image.height());
        Image::from_fn(image.size(), |col, row| {
            let Srgb([r, g, b]) = image[(width - 1 - col, height - 1 - row)];
            Srgb([b, 255 - r, g])
        })
    });
    for mode in [Mode::Plane, Mode::Smooth] {
        let mut operation = operation(&wall, "s_%04d.png");
        operation.params.mode = mode;
        let report = operation.run(&Context::default()).unwrap();
        assert_eq!(report.figures["cuts"], 1.0);
        assert_eq!(report.figures["lost"], 0.0);
        assert!(
            report.warnings[0].ends_with(&format!("at frame 0 and at {cut}")),
            "{:?}",
            report.warnings
        );
    }
    let mut operation = operation(&wall, "s_%04d.png");
    operation.params.mode = Mode::Plane;
    operation.run(&Context::default()).unwrap();
    for (first, range) in [(0, 1..cut), (cut, cut + 1..FRAMES)] {
        let reference = frame(&wall, &format!("f_{first:04}.png"));
        for index in range {
            let moved = difference(&reference, &frame(&wall, &format!("f_{index:04}.png")));
            let still = difference(&reference, &frame(&wall, &format!("s_{index:04}.png")));
            assert!(
                still < 5.0 && still < 0.8 * moved,
                "frame {index}: {moved} {still}"
            );
        }
    }
}
