//! Edits of a drawn shot: a camera that pans over a wall, and a square before it.

mod planes;

use super::enhance::Enhance;
use super::overlay::{self, Blend, Overlay};
use super::paste::Paste;
use super::remove::{Grain, Remove};
use super::replace::Replace;
use super::*;
use crate::matte::{Matte, Spread};
use crate::{ErrorKind, Step};
use ravec::raster::Image;
use ravec::raster::Srgba;
use ravec_media::{Limits, Picture, WriteOptions};

const SIZE: (usize, usize) = (96, 72);
const PAD: usize = 8;
const FRAMES: usize = 5;

fn size() -> Size {
    Size::new(SIZE.0, SIZE.1).unwrap()
}

/// The wall at a point of the reference frame.
fn wall(x: f64, y: f64) -> [f64; 3] {
    let wave = 35.0 * (0.4 * x).sin() * (0.3 * y).cos() + 20.0 * (0.17 * y + 0.23 * x).sin();
    [140.0 + wave, 130.0 - wave, 120.0 + 0.5 * wave]
}

fn shift(index: usize) -> f64 {
    1.5 * index as f64
}

fn inside(index: usize, col: usize, row: usize) -> bool {
    (20 + 3 * index..36 + 3 * index).contains(&col) && (24..52).contains(&row)
}

fn drawn_wall(index: usize, col: usize, row: usize) -> [f64; 3] {
    wall(col as f64 + shift(index), row as f64)
}

fn picture(
    size: Size,
    mut color: impl FnMut(usize, usize) -> [f64; 3] + Sync + Send + Copy,
) -> Image<Srgb<u8>> {
    let mut image = Image::new(size, Srgb([0u8; 3]));
    for row in 0..size.height() {
        for col in 0..size.width() {
            image[(col, row)] = Srgb(color(col, row).map(|value| value.round() as u8));
        }
    }
    image
}

struct Shot {
    folder: tempfile::TempDir,
}

impl Shot {
    fn new() -> Self {
        let shot = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        let mut maps = Vec::new();
        for index in 0..FRAMES {
            let frame = picture(size(), |col, row| {
                if inside(index, col, row) {
                    [220.0, 40.0, 60.0]
                } else {
                    drawn_wall(index, col, row)
                }
            });
            shot.save(&format!("f_{index}.png"), frame);
            let alpha = picture(size(), |col, row| {
                [if inside(index, col, row) { 255.0 } else { 0.0 }; 3]
            });
            shot.save(&format!("a_{index}.png"), alpha);
            maps.push([1.0, 0.0, -shift(index), 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        }
        let padded = Size::new(SIZE.0 + 2 * PAD, SIZE.1 + 2 * PAD).unwrap();
        let plate = picture(padded, |col, row| {
            wall(col as f64 - PAD as f64, row as f64 - PAD as f64)
        });
        shot.save("plate.png", plate);
        let track = serde_json::json!({ "frame_from_reference": maps });
        crate::files::write_text(&shot.at("track.json"), &track.to_string()).unwrap();
        shot
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn save(&self, name: &str, image: Image<Srgb<u8>>) {
        let picture = Picture::from_image(AnyImage::from(image));
        ravec_media::write(self.at(name), &picture, &WriteOptions::default()).unwrap();
    }

    fn read(&self, name: &str) -> Image<Srgb<u8>> {
        ravec_media::read(self.at(name), &Limits::default())
            .unwrap()
            .convert()
    }

    fn params() -> ShotParams {
        ShotParams {
            pad: PAD,
            ..ShotParams::default()
        }
    }

    fn removal(&self, output: &str) -> Remove {
        Remove {
            input: self.at("f_%d.png"),
            output: self.at(output),
            plate: self.at("plate.png"),
            matte: self.at("a_%d.png"),
            track: Some(self.at("track.json")),
            regions: None,
            params: remove::Params {
                shot: Self::params(),
                ..remove::Params::default()
            },
        }
    }
}

fn run(operation: &impl Operation) -> Report {
    operation.run(&Context::default()).unwrap()
}

fn refused(operation: &impl Operation) -> JobError {
    operation.run(&Context::default()).unwrap_err()
}

/// The largest difference of a frame to colors, over the pixels that `looked_at` selects.
fn largest(
    found: &Image<Srgb<u8>>,
    truth: impl Fn(usize, usize) -> [f64; 3],
    looked_at: impl Fn(usize, usize) -> bool,
) -> f64 {
    let mut largest = 0.0f64;
    for row in 0..found.height() {
        for col in 0..found.width() {
            if looked_at(col, row) {
                let pairs = found[(col, row)].0.into_iter().zip(truth(col, row));
                largest = pairs.fold(largest, |largest, (a, b)| {
                    largest.max((f64::from(a) - b).abs())
                });
            }
        }
    }
    largest
}

#[test]
fn the_square_is_removed_along_the_track_on_any_number_of_threads() {
    let shot = Shot::new();
    for (folder, threads) in [("one", 1), ("two", 3)] {
        crate::make_folder(&shot.at(folder)).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let report = pool.unwrap().install(|| run(&shot.removal(folder)));
        assert_eq!(report.figures["frames"], FRAMES as f64);
    }
    for index in 0..FRAMES {
        let name = format!("frame_{index:04}.png");
        let bytes = |folder: &str| std::fs::read(shot.at(folder).join(&name)).unwrap();
        assert_eq!(bytes("one"), bytes("two"));
        let found = shot.read(&format!("one/{name}"));
        let wrong = largest(&found, |col, row| drawn_wall(index, col, row), |_, _| true);
        assert!(wrong < 6.0, "{wrong} in frame {index}");
    }
    let mut clean = shot.removal("c_%d.png");
    clean.params.grain = Grain::None;
    run(&clean);
    assert!(shot.at("c_4.png").exists());
}

#[test]
fn a_new_background_moves_with_the_plane_or_stands_still() {
    let shot = Shot::new();
    let image = picture(Size::new(64, 48).unwrap(), |col, row| {
        [60.0 + col as f64, 80.0 + 2.0 * row as f64, 200.0]
    });
    shot.save("new.png", image);
    let mut replace = Replace {
        input: shot.at("f_%d.png"),
        output: shot.at("n_%d.png"),
        plate: shot.at("plate.png"),
        matte: shot.at("a_%d.png"),
        image: shot.at("new.png"),
        track: Some(shot.at("track.json")),
        regions: None,
        params: replace::Params {
            shot: Shot::params(),
            quad: Some("16,12,80,12,80,60,16,60".parse().unwrap()),
            ..replace::Params::default()
        },
    };
    run(&replace);
    let index = 2;
    let truth = |col: usize, row: usize| {
        if inside(index, col, row) {
            return [220.0, 40.0, 60.0];
        }
        let (x, y) = (col as f64 + shift(index) - 16.0, row as f64 - 12.0);
        [60.0 + x, 80.0 + 2.0 * y, 200.0]
    };
    let on_image = |col: usize, row: usize| (18..72).contains(&col) && (14..58).contains(&row);
    let wrong = largest(&shot.read("n_2.png"), truth, on_image);
    assert!(wrong < 4.0, "{wrong}");
    replace.params.quad = None;
    run(&replace);
    let still = [0, 3].map(|index| shot.read(&format!("n_{index}.png"))[(4, 4)]);
    assert_eq!(still[0], still[1]);
}

#[test]
fn a_paste_follows_both_planes_and_stays_behind_what_is_in_front() {
    let shot = Shot::new();
    let into = picture(Size::new(120, 80).unwrap(), |_, _| [30.0, 60.0, 90.0]);
    shot.save("into.png", into);
    let front = picture(Size::new(120, 80).unwrap(), |_, row| {
        [if row >= 60 { 255.0 } else { 0.0 }; 3]
    });
    shot.save("front.png", front);
    let paste = Paste {
        input: shot.at("f_%d.png"),
        output: shot.at("p_%d.png"),
        into: shot.at("into.png"),
        into_track: None,
        into_matte: Some(shot.at("front.png")),
        plate: shot.at("plate.png"),
        matte: shot.at("a_%d.png"),
        track: Some(shot.at("track.json")),
        regions: None,
        params: paste::Params {
            shot: Shot::params(),
            // 10 pixels to the right and 12 down
            quad: Some("0,0,80,0,80,60,0,60".parse().unwrap()),
            into_quad: Some("10,12,90,12,90,72,10,72".parse().unwrap()),
            ..paste::Params::default()
        },
    };
    run(&paste);
    // in the reference frame the square begins at column 20 + 3 · 4 + 6
    let found = shot.read("p_4.png");
    assert_eq!(found.size(), Size::new(120, 80).unwrap());
    let square = |col: usize, row: usize| (48..64).contains(&col) && (36..60).contains(&row);
    let truth = |col: usize, row: usize| {
        if square(col, row) {
            [220.0, 40.0, 60.0]
        } else {
            [30.0, 60.0, 90.0]
        }
    };
    let away_from_rims = |col: usize, row: usize| {
        square(col + 1, row) == square(col - 1, row) && square(col, row + 1) == square(col, row - 1)
    };
    let looked_at = |col: usize, row: usize| col > 0 && row > 0 && away_from_rims(col, row);
    let wrong = largest(&found, truth, looked_at);
    assert!(wrong < 8.0, "{wrong}");
    // into a clip: its frames, and as many of them
    for index in 0..3 {
        let into = picture(Size::new(120, 80).unwrap(), |_, _| {
            [30.0 + 20.0 * index as f64, 60.0, 90.0]
        });
        shot.save(&format!("i_{index}.png"), into);
    }
    let mut clip = paste.clone();
    clip.into = shot.at("i_%d.png");
    clip.output = shot.at("q_%d.png");
    clip.params.shadow = 0.5;
    assert_eq!(run(&clip).figures["frames"], 3.0);
    let found = shot.read("q_2.png");
    assert_eq!(found[(5, 5)], Srgb([70, 60, 90]));
    // in front of everything, and not shaded
    assert_eq!(found[(50, 70)], Srgb([70, 60, 90]));
    assert!(found[(45, 50)].0[0] > 200);
    let mut one = paste.clone();
    one.params.into_quad = None;
    assert_eq!(refused(&one).kind(), ErrorKind::Request);
    one.params.shadow = 2.0;
    assert_eq!(refused(&one).kind(), ErrorKind::Request);
}

#[test]
fn a_photo_sharpens_the_wall_at_twice_the_size() {
    use ravec_scenes::{Seed, texture::fractal};
    let shot = Shot {
        folder: tempfile::tempdir().unwrap(),
    };
    let size = Size::new(160, 120).unwrap();
    let color = |x: f64, y: f64| {
        let at = glam::dvec2(x, y) / 20.0;
        let value = 128.0 + 90.0 * fractal(at, 0.01, 6, Seed(3));
        [value, 0.9 * value, 0.8 * value + 20.0].map(|value| value.clamp(5.0, 250.0))
    };
    let plate = picture(size, |col, row| color(col as f64 + 0.5, row as f64 + 0.5));
    shot.save("plate.png", plate.clone());
    shot.save("f_0.png", plate.clone());
    shot.save(
        "f_1.png",
        picture(size, |col, row| {
            let [r, g, b] = color(col as f64 + 0.5, row as f64 + 0.5);
            [0.9 * r, 0.9 * g, 0.9 * b]
        }),
    );
    shot.save("none.png", picture(size, |_, _| [0.0; 3]));
    // twice as many pixels, in another tone
    shot.save(
        "photo.png",
        picture(Size::new(320, 240).unwrap(), |col, row| {
            let (x, y) = (0.5 * col as f64 + 0.25, 0.5 * row as f64 + 0.25);
            let [r, g, b] = color(x, y);
            [0.8 * r + 10.0, 0.95 * g, 0.9 * b + 5.0]
        }),
    );
    let enhance = Enhance {
        input: shot.at("f_%d.png"),
        output: shot.at("e_%d.png"),
        photo: shot.at("photo.png"),
        plate: shot.at("plate.png"),
        matte: shot.at("none.png"),
        track: None,
        regions: None,
        params: enhance::Params::default(),
    };
    let report = run(&enhance);
    assert!(report.figures["photo_inliers"] > 20.0);
    for (index, gain) in [(0, 1.0), (1, 0.9)] {
        let found = shot.read(&format!("e_{index}.png"));
        assert_eq!(found.size(), Size::new(320, 240).unwrap());
        let mut sum = 0.0;
        for row in 10..230 {
            for col in 10..310 {
                let truth = color(0.5 * col as f64 + 0.25, 0.5 * row as f64 + 0.25);
                sum += (f64::from(found[(col, row)].0[0]) - gain * truth[0]).powi(2);
            }
        }
        let rms = (sum / (220.0 * 300.0)).sqrt();
        assert!(rms < 4.0, "{rms} in frame {index}");
    }
}

#[test]
fn an_enhanced_frame_of_a_camera_in_motion_stays_blurred_where_asked() {
    use ravec_scenes::{Seed, texture::fractal};
    let shot = Shot {
        folder: tempfile::tempdir().unwrap(),
    };
    let size = Size::new(160, 120).unwrap();
    // `blur` is the length of the motion along rows
    let color = |x: f64, y: f64, blur: f64| {
        let steps = 15;
        let value = (0..steps)
            .map(|step| {
                let moved = x + blur * ((f64::from(step) + 0.5) / f64::from(steps) - 0.5);
                128.0 + 90.0 * fractal(glam::dvec2(moved, y) / 20.0, 0.01, 6, Seed(3))
            })
            .sum::<f64>()
            / f64::from(steps);
        [value, 0.9 * value, 0.8 * value + 20.0].map(|value| value.clamp(5.0, 250.0))
    };
    let half = |at: usize| 0.5 * at as f64 + 0.25;
    let at = |blur: f64| {
        picture(size, move |col, row| {
            color(col as f64 + 0.5, row as f64 + 0.5, blur)
        })
    };
    shot.save("plate.png", at(0.0));
    shot.save("f_0.png", at(0.0));
    shot.save("f_1.png", at(8.0));
    shot.save("none.png", picture(size, |_, _| [0.0; 3]));
    let double = Size::new(320, 240).unwrap();
    shot.save(
        "photo.png",
        picture(double, |col, row| color(half(col), half(row), 0.0)),
    );
    let enhance = |output: &str, blur| Enhance {
        input: shot.at("f_%d.png"),
        output: shot.at(output),
        photo: shot.at("photo.png"),
        plate: shot.at("plate.png"),
        matte: shot.at("none.png"),
        track: None,
        regions: None,
        params: enhance::Params {
            blur,
            ..enhance::Params::default()
        },
    };
    run(&enhance("s_%d.png", enhance::PhotoBlur::None));
    run(&enhance("b_%d.png", enhance::PhotoBlur::Matched));
    let rms = |name: &str, blur: f64| {
        let found = shot.read(name);
        let mut sum = 0.0;
        for row in 20..220 {
            for col in 30..290 {
                let truth = color(half(col), half(row), blur)[0];
                sum += (f64::from(found[(col, row)].0[0]) - truth).powi(2);
            }
        }
        (sum / (200.0 * 260.0)).sqrt()
    };
    assert_eq!(shot.read("s_0.png"), shot.read("b_0.png"));
    assert!(rms("s_1.png", 0.0) < 4.0);
    // twice as near to the blurred truth as a sharp frame would be
    let (matched, sharp) = (rms("b_1.png", 8.0), rms("s_1.png", 8.0));
    assert!(matched < 0.5 * sharp, "{matched} against {sharp}");
}

#[test]
fn short_mattes_wrong_plates_and_the_own_folder_are_refused() {
    let shot = Shot::new();
    std::fs::remove_file(shot.at("a_4.png")).unwrap();
    let error = refused(&shot.removal("o_%d.png"));
    assert!(
        matches!(error, JobError::ClipTooShort { frame: 4, .. }),
        "{error}"
    );
    assert_eq!(error.kind(), ErrorKind::Input);
    let mut plate = shot.removal("o_%d.png");
    plate.params.shot.pad = 3;
    assert!(matches!(refused(&plate), JobError::SizesDiffer { .. }));
    let mut folder = shot.removal("o_%d.png");
    folder.input = shot.folder.path().to_path_buf();
    folder.output = shot.folder.path().to_path_buf();
    assert!(matches!(refused(&folder), JobError::OverwritesInput { .. }));
    let mut track = shot.removal("o_%d.png");
    crate::files::write_text(
        &shot.at("short.json"),
        "{\"frame_from_reference\": [[1,0,0,0,1,0,0,0,1]]}",
    )
    .unwrap();
    track.track = Some(shot.at("short.json"));
    assert!(refused(&track).to_string().contains("lacks frame 1"));
}

#[test]
fn where_the_plate_is_transparent_frames_stay() {
    let shot = Shot::new();
    let padded = Size::new(SIZE.0 + 2 * PAD, SIZE.1 + 2 * PAD).unwrap();
    let clear: Image<Srgba<u8>> = Image::new(padded, Srgba([0, 0, 0, 0]));
    let picture = Picture::from_image(AnyImage::from(clear));
    ravec_media::write(shot.at("plate.png"), &picture, &WriteOptions::default()).unwrap();
    run(&shot.removal("o_%d.png"));
    assert_eq!(shot.read("o_2.png"), shot.read("f_2.png"));
}

/// The previews of frames, in the order of `indices`.
fn previews(
    step: &Step,
    live: Option<FrameMattes>,
    indices: &[usize],
    shot: &Shot,
) -> Vec<AnyImage> {
    let context = Context::default();
    let preview = ShotPreview::open(step, live, size(), &context).unwrap();
    let mut preview = preview.unwrap();
    let frames = indices.iter().map(|index| {
        let frame = AnyImage::from(shot.read(&format!("f_{index}.png")));
        preview.frame(*index as u64, &frame, &context).unwrap()
    });
    frames.collect()
}

#[test]
fn previews_in_any_order_are_the_frames_that_are_written() {
    let shot = Shot::new();
    let image = picture(Size::new(64, 48).unwrap(), |col, row| {
        [60.0 + col as f64, 80.0 + 2.0 * row as f64, 200.0]
    });
    shot.save("new.png", image);
    let removal = shot.removal("r_%d.png");
    let replace = Replace {
        input: shot.at("f_%d.png"),
        output: shot.at("r_%d.png"),
        plate: shot.at("plate.png"),
        matte: shot.at("a_%d.png"),
        image: shot.at("new.png"),
        track: Some(shot.at("track.json")),
        regions: None,
        params: replace::Params {
            shot: Shot::params(),
            ..replace::Params::default()
        },
    };
    let paste = Paste {
        input: shot.at("f_%d.png"),
        output: shot.at("r_%d.png"),
        into: shot.at("f_%d.png"),
        into_track: Some(shot.at("track.json")),
        into_matte: None,
        plate: shot.at("plate.png"),
        matte: shot.at("a_%d.png"),
        track: Some(shot.at("track.json")),
        regions: None,
        params: paste::Params {
            shot: Shot::params(),
            ..paste::Params::default()
        },
    };
    for step in [Step::from(removal), replace.into(), paste.into()] {
        assert!(ShotPreview::exists_for(&step));
        let order = [3, 0, 4, 1];
        let found = previews(&step, None, &order, &shot);
        step.operation().run(&Context::default()).unwrap();
        for (index, found) in order.into_iter().zip(found) {
            let name = step.operation().name();
            let written = shot.read(&format!("r_{index}.png"));
            assert!(found == AnyImage::from(written), "{name}, frame {index}");
        }
    }
    let other = Step::from(crate::compare::Compare {
        a: shot.at("a_0.png"),
        b: shot.at("a_1.png"),
        plot: None,
        params: crate::compare::Params::default(),
    });
    assert!(!ShotPreview::exists_for(&other));
    let none = ShotPreview::open(&other, None, size(), &Context::default());
    assert!(none.unwrap().is_none());
}

#[test]
fn a_preview_without_a_matte_of_the_clip_solves_that_of_the_frame() {
    let shot = Shot::new();
    let mut removal = shot.removal("r_%d.png");
    let matte = Matte {
        input: shot.at("f_%d.png"),
        output: shot.at("m_%d.png"),
        plate: Some(shot.at("plate.png")),
        trimap: None,
        track: Some(shot.at("track.json")),
        regions: None,
        strokes: None,
        params: crate::matte::Params {
            pad: PAD,
            ..crate::matte::Params::default()
        },
    };
    removal.matte = shot.at("m_%d.png");
    let step = Step::from(removal);
    let context = Context::default();
    let mut report = Report::new("matte", &());
    let live = FrameMattes::open(&matte, size(), Spread::Clip, &mut report, &context).unwrap();
    let found = previews(&step, Some(live), &[2], &shot);
    // the file of the matte has 8 bits
    run(&matte);
    step.operation().run(&Context::default()).unwrap();
    let written = shot.read("r_2.png");
    let AnyImage::Srgb8(found) = &found[0] else {
        panic!("a frame of 8 bits has a preview of 8 bits");
    };
    let truth = |col: usize, row: usize| written[(col, row)].0.map(f64::from);
    let wrong = largest(found, truth, |_, _| true);
    assert!(wrong <= 3.0, "{wrong}");
}

fn overlay(shot: &Shot) -> Overlay {
    Overlay {
        input: shot.at("f_%d.png"),
        output: shot.at("o_%d.png"),
        image: shot.at("logo.png"),
        track: Some(shot.at("track.json")),
        matte: Some(shot.at("a_%d.png")),
        params: overlay::Params {
            quad: Some("16,20,56,20,56,60,16,60".parse().unwrap()),
            frames: Some("1..4".parse().unwrap()),
            ..overlay::Params::default()
        },
    }
}

#[test]
fn an_overlay_lies_on_the_plane_behind_the_foreground() {
    let shot = Shot::new();
    // red on the left, nothing on the right
    let logo: Image<Srgba<u8>> = Image::from_fn(Size::new(20, 20).unwrap(), |col, _| {
        Srgba([200, 30, 20, if col < 10 { 255 } else { 0 }])
    });
    let picture_of_logo = Picture::from_image(AnyImage::from(logo));
    ravec_media::write(
        shot.at("logo.png"),
        &picture_of_logo,
        &WriteOptions::default(),
    )
    .unwrap();
    let mut operation = overlay(&shot);
    run(&operation);
    for index in 0..FRAMES {
        let on_logo = |col: usize, row: usize| {
            let x = col as f64 + 0.5 + shift(index);
            (18.0..34.0).contains(&x) && (22..58).contains(&row)
        };
        let beside = |col: usize, row: usize| {
            let x = col as f64 + 0.5 + shift(index);
            !(14.0..38.0).contains(&x) || !(18..62).contains(&row)
        };
        let below = |col: usize, row: usize| {
            if inside(index, col, row) {
                [220.0, 40.0, 60.0]
            } else {
                drawn_wall(index, col, row)
            }
        };
        let shown = (1..4).contains(&index);
        let truth = |col: usize, row: usize| {
            if shown && on_logo(col, row) && !inside(index, col, row) {
                [200.0, 30.0, 20.0]
            } else {
                below(col, row)
            }
        };
        let found = shot.read(&format!("o_{index}.png"));
        let wrong = largest(&found, truth, |col, row| {
            on_logo(col, row) || beside(col, row)
        });
        assert!(wrong < 1.5, "{wrong} in frame {index}");
    }
    operation.params.blend = Blend::Multiply;
    operation.params.opacity = 0.5;
    operation.matte = None;
    run(&operation);
    let found = shot.read("o_2.png");
    let truth = |col: usize, row: usize| {
        let below = if inside(2, col, row) {
            [220.0, 40.0, 60.0]
        } else {
            drawn_wall(2, col, row)
        };
        let above = [200.0, 30.0, 20.0];
        [0, 1, 2].map(|k| below[k] * (0.5 + 0.5 * above[k] / 255.0))
    };
    let wrong = largest(&found, truth, |col, row| {
        (16..30).contains(&col) && (24..56).contains(&row)
    });
    assert!(wrong < 1.5, "{wrong}");
}

#[test]
fn an_overlay_refuses_what_makes_no_sense_and_has_previews() {
    let shot = Shot::new();
    shot.save(
        "logo.png",
        picture(Size::new(20, 10).unwrap(), |_, _| [9.0; 3]),
    );
    let mut wrong = overlay(&shot);
    wrong.params.opacity = 1.5;
    assert_eq!(refused(&wrong).kind(), ErrorKind::Request);
    let mut wrong = overlay(&shot);
    wrong.params.frames = Some("1s..2s".parse().unwrap());
    assert_eq!(refused(&wrong).kind(), ErrorKind::Request);
    let mut wrong = overlay(&shot);
    wrong.params.quad = Some("1,1,1,1,1,1,1,1".parse().unwrap());
    assert_eq!(refused(&wrong).kind(), ErrorKind::Request);
    // without a place it is in the middle, as large as it can be
    let mut operation = overlay(&shot);
    operation.params.quad = None;
    operation.track = None;
    operation.matte = None;
    let step = Step::from(operation.clone());
    let found = previews(&step, None, &[3, 1], &shot);
    run(&operation);
    let written = shot.read("o_1.png");
    assert!(found[1] == AnyImage::from(written.clone()));
    let black = |row: usize| written[(40, row)].0 == [9; 3];
    let rows: Vec<usize> = (0..SIZE.1).filter(|row| black(*row)).collect();
    assert_eq!((rows[0], rows.len()), (12, 48));
}
