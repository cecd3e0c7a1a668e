//! `matte` on pictures and clips whose alpha is known.

use super::*;
use crate::ErrorKind;
use ravec::raster::Size;
use ravec_media::Limits;

const SIZE: (usize, usize) = (96, 72);

fn size() -> Size {
    Size::new(SIZE.0, SIZE.1).unwrap()
}

/// A wall with a pattern, `shift` pixels to the left, under `pad` pixels more on each side.
fn wall(shift: f64, pad: usize) -> Image<Srgb<u8>> {
    let size = Size::new(SIZE.0 + 2 * pad, SIZE.1 + 2 * pad).unwrap();
    Image::from_fn(size, |col, row| {
        let (x, y) = (col as f64 - pad as f64 + shift, row as f64 - pad as f64);
        let wave = 40.0 * (0.4 * x).sin() * (0.3 * y).cos() + 25.0 * (0.9 * y + 0.2 * x).sin();
        Srgb([
            (140.0 + wave) as u8,
            (130.0 - wave) as u8,
            (120.0 + 0.5 * wave) as u8,
        ])
    })
}

/// True in the square before the wall.
fn inside(frame: usize, col: usize, row: usize) -> bool {
    (20 + frame..40 + frame).contains(&col) && (20..50).contains(&row)
}

/// A frame: a square that moves before the wall.
fn frame(index: usize, shift: f64) -> Image<Srgb<u8>> {
    let wall = wall(shift, 0);
    Image::from_fn(size(), |col, row| {
        if inside(index, col, row) {
            Srgb([220, 40, 60])
        } else {
            wall[(col, row)]
        }
    })
}

fn save(path: &Path, image: Image<Srgb<u8>>) {
    let picture = Picture::from_image(AnyImage::from(image));
    ravec_media::write(path, &picture, &WriteOptions::default()).unwrap();
}

fn operation(folder: &Path, input: &str, output: &str) -> Matte {
    Matte {
        input: folder.join(input),
        output: folder.join(output),
        plate: Some(folder.join("plate.png")),
        trimap: None,
        track: None,
        regions: None,
        strokes: None,
        params: Params::default(),
    }
}

fn alpha(path: &Path) -> Image<Srgb<u8>> {
    ravec_media::read(path, &Limits::default())
        .unwrap()
        .convert()
}

/// Asserts that alpha is that of the square, but for pixels at its border.
fn assert_square(found: &Image<Srgb<u8>>, index: usize) {
    let mut wrong = 0;
    for row in 0..SIZE.1 {
        for col in 0..SIZE.0 {
            let expected = if inside(index, col, row) { 255 } else { 0 };
            wrong += usize::from(found[(col, row)].0[0].abs_diff(expected) > 25);
        }
    }
    assert!(wrong < 20, "{wrong} pixels of frame {index} are wrong");
}

#[test]
fn a_picture_and_its_foreground() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    save(&at("plate.png"), wall(0.0, 0));
    save(&at("a.png"), frame(0, 0.0));
    let mut matte = operation(folder.path(), "a.png", "alpha.png");
    let report = matte.run(&Context::default()).unwrap();
    assert_square(&alpha(&at("alpha.png")), 0);
    let share = 100.0 * 600.0 / (SIZE.0 * SIZE.1) as f64;
    assert!((report.figures["foreground_percent"] - share).abs() < 0.3);
    matte.params.content = Content::Foreground;
    matte.output = at("cut.png");
    matte.run(&Context::default()).unwrap();
    let cut: Image<Srgba<u8>> = ravec_media::read(at("cut.png"), &Limits::default())
        .unwrap()
        .convert();
    assert_eq!(cut[(30, 30)].0[3], 255);
    assert!(cut[(30, 30)].0[0].abs_diff(220) < 4);
    assert_eq!(cut[(80, 10)].0[3], 0);
}

#[test]
fn a_clip_along_a_track_with_strokes_and_again_on_one_thread() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    save(&at("plate.png"), wall(0.0, 8));
    let mut maps = Vec::new();
    for index in 0..4 {
        let shift = 1.5 * index as f64;
        save(&at(&format!("f_{index}.png")), frame(index, shift));
        maps.push([1.0, 0.0, -shift, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    }
    let track = serde_json::json!({ "frame_from_reference": maps });
    crate::files::write_text(&at("track.json"), &track.to_string()).unwrap();
    let stroke = Image::from_fn(size(), |col, row| match (col, row) {
        (2..6, 2..6) => Srgb([255u8; 3]),
        (30..34, 30..34) => Srgb([0; 3]),
        _ => Srgb([128; 3]),
    });
    save(&at("stroke_0002.png"), stroke);
    for name in ["out", "again"] {
        crate::make_folder(&at(name)).unwrap();
        let mut matte = operation(folder.path(), "f_%d.png", name);
        matte.track = Some(at("track.json"));
        matte.strokes = Some(at("stroke_%04d.png"));
        matte.params.pad = 8;
        matte.params.carry = Some(0);
        let threads = if name == "out" { 2 } else { 1 };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let report = pool.install(|| matte.run(&Context::default())).unwrap();
        assert_eq!(report.figures["frames"], 4.0);
    }
    for index in 0..4 {
        let name = format!("frame_{index:04}.png");
        let bytes = |folder: &str| std::fs::read(at(folder).join(&name)).unwrap();
        assert_eq!(bytes("out"), bytes("again"));
        let found = alpha(&at("out").join(&name));
        if index == 2 {
            assert_eq!(found[(3, 3)].0[0], 255);
            assert_eq!(found[(31, 31)].0[0], 0);
        } else {
            assert_square(&found, index);
        }
    }
}

/// A red frame that moves before a plain wall, through which the wall is seen: in truth a pane of its color. A lamp on the wall
/// glows in all frames but not on the plate.
fn camouflaged(index: usize) -> Image<Srgb<u8>> {
    let left = 10 + 4 * index;
    Image::from_fn(size(), |col, row| match (col.wrapping_sub(left), row) {
        (5..20, 25..40) => Srgb([90, 120, 130]),
        (0..25, 20..45) => Srgb([220, 40, 60]),
        _ if (70..80).contains(&col) && (5..12).contains(&row) => Srgb([200, 190, 120]),
        _ => Srgb([90, 120, 130]),
    })
}

#[test]
fn strokes_of_one_frame_hold_in_all() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    save(&at("plate.png"), Image::new(size(), Srgb([90, 120, 130])));
    for index in 0..8 {
        save(&at(&format!("f_{index}.png")), camouflaged(index));
    }
    let run = |marks: &[&str], carry: Option<u64>, name: &str| -> Vec<Image<Srgb<u8>>> {
        crate::make_folder(&at(name)).unwrap();
        let mut matte = operation(folder.path(), "f_%d.png", name);
        matte.params.marks = marks.iter().map(|mark| mark.parse().unwrap()).collect();
        matte.params.carry = carry;
        matte.run(&Context::default()).unwrap();
        let frames = 0..8;
        frames
            .map(|index| alpha(&at(name).join(format!("frame_{index:04}.png"))))
            .collect()
    };
    let pane = |found: &Image<Srgb<u8>>, index: usize| found[(10 + 4 * index + 12, 32)].0[0];
    let lamp = |found: &Image<Srgb<u8>>| found[(75, 8)].0[0];
    let plain = run(&[], None, "plain");
    assert_eq!((pane(&plain[6], 6), lamp(&plain[6])), (0, 255));
    // one over the pane and a part of its border, in the middle; one over the lamp, which ends on the wall
    let marks = ["3:foreground:9:34,32,35,33", "3:background:6:72,8,78,8"];
    let marked = run(&marks, None, "marked");
    for (index, found) in marked.iter().enumerate() {
        assert_eq!(pane(found, index), 255, "frame {index}");
        assert_eq!(lamp(found), 0, "frame {index}");
    }
    let near = run(&marks, Some(1), "near");
    let panes: Vec<u8> = (0..8).map(|index| pane(&near[index], index)).collect();
    assert_eq!(panes, [0, 0, 255, 255, 255, 0, 0, 0]);
    let mut matte = operation(folder.path(), "f_%d.png", "plain");
    matte.params.marks = vec!["8:foreground:2:5,5".parse().unwrap()];
    let error = matte.run(&Context::default()).unwrap_err().to_string();
    assert!(error.contains("frame 8"), "{error}");
}

#[test]
fn wrong_sizes_tracks_and_parameters_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    save(&at("plate.png"), wall(0.0, 4));
    save(&at("a.png"), frame(0, 0.0));
    save(&at("f_0.png"), frame(0, 0.0));
    let run = |matte: &Matte| matte.run(&Context::default()).unwrap_err();
    let matte = operation(folder.path(), "a.png", "o.png");
    assert!(matches!(run(&matte), JobError::SizesDiffer { .. }));
    let mut other = matte.clone();
    other.params.matte.snap = 0.4;
    assert_eq!(run(&other).kind(), ErrorKind::Request);
    let mut other = operation(folder.path(), "f_%d.png", "o_%d.png");
    other.params.pad = 4;
    for (text, part) in [
        ("{}", "format"),
        ("{\"frame_from_reference\": []}", "no frames"),
        (
            "{\"frame_from_reference\": [[0,0,0,0,0,0,0,0,0]]}",
            "no map",
        ),
        ("nonsense", "form of a track"),
    ] {
        crate::files::write_text(&at("track.json"), text).unwrap();
        other.track = Some(at("track.json"));
        let error = run(&other).to_string();
        assert!(error.contains(part), "{error}");
    }
    assert!(!at("o.png").exists() && !at("o_0.png").exists());
}

#[test]
fn a_picture_with_a_trimap_and_strokes_needs_no_plate() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    save(&at("a.png"), frame(0, 0.0));
    // unknown: a frame of 5 pixels on both sides of the border
    let trimap = |inner: u8| {
        Image::from_fn(size(), |col, row| {
            let near = (15..45).contains(&col) && (15..55).contains(&row);
            let deep = (25..35).contains(&col) && (25..45).contains(&row);
            Srgb(
                [if deep {
                    inner
                } else if near {
                    128
                } else {
                    0
                }; 3],
            )
        })
    };
    save(&at("trimap.png"), trimap(255));
    save(&at("empty.png"), trimap(128));
    let stroke = Image::from_fn(size(), |col, row| {
        Srgb(
            [if (28..32).contains(&col) && (26..44).contains(&row) {
                255
            } else {
                128
            }; 3],
        )
    });
    save(&at("stroke.png"), stroke);
    let mut matte = operation(folder.path(), "a.png", "alpha.png");
    matte.plate = None;
    matte.trimap = Some(at("trimap.png"));
    matte.run(&Context::default()).unwrap();
    assert_square(&alpha(&at("alpha.png")), 0);
    matte.trimap = Some(at("empty.png"));
    let error = matte.run(&Context::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Request);
    assert!(error.to_string().contains("without foreground"), "{error}");
    matte.strokes = Some(at("stroke.png"));
    matte.run(&Context::default()).unwrap();
    assert_square(&alpha(&at("alpha.png")), 0);
}

#[test]
fn what_is_needed_differs_between_pictures_and_clips() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    save(&at("plate.png"), wall(0.0, 0));
    save(&at("a.png"), frame(0, 0.0));
    save(&at("f_0.png"), frame(0, 0.0));
    let picture = operation(folder.path(), "a.png", "o.png");
    let clip = operation(folder.path(), "f_%d.png", "o_%d.png");
    let without = |matte: &Matte| Matte {
        plate: None,
        ..matte.clone()
    };
    let trimap = Matte {
        trimap: Some(at("a.png")),
        ..clip.clone()
    };
    let track = Matte {
        track: Some(at("track.json")),
        regions: None,
        ..picture.clone()
    };
    for (matte, field) in [
        (without(&picture), "plate"),
        (without(&clip), "plate"),
        (trimap, "trimap"),
        (track, "track"),
    ] {
        let error = matte.run(&Context::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Request);
        assert!(error.to_string().contains(field), "{error}");
    }
}

#[test]
fn strokes_under_the_hand_are_solved_near_them() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    save(&at("plate.png"), Image::new(size(), Srgb([90, 120, 130])));
    for index in 0..4 {
        save(&at(&format!("f_{index}.png")), camouflaged(index));
    }
    let mut matte = operation(folder.path(), "f_%d.png", "out");
    let pane = |solution: &Solution| solution.alpha[(10 + 4 * 3 + 12, 32)];
    let image = AnyImage::from(camouflaged(3));
    let (context, progress) = (Context::default(), Context::default().progress);
    let open = |matte: &Matte| {
        let mut report = Report::new("matte", &());
        FrameMattes::open(matte, size(), Spread::Clip, &mut report, &context).unwrap()
    };
    let mut live = open(&matte)
        .live(3, &image, &[], &progress, &context)
        .unwrap()
        .unwrap();
    assert_eq!(pane(live.solution()), 0.0);
    let before = live.solution().clone();
    let marks: Vec<FrameMark> = ["3:foreground:5:30,32,33,32", "1:foreground:5:20,32"]
        .map(|mark| mark.parse().unwrap())
        .to_vec();
    let region = live.set_marks(&marks[..1], &progress).unwrap().unwrap();
    assert!(region.contains(31, 32) && region.width < 90, "{region:?}");
    assert_eq!(pane(live.solution()), 1.0);
    matte.params.marks = marks[..1].to_vec();
    let whole = open(&matte).solve(3, &image, &progress, &context).unwrap();
    let pairs = live
        .solution()
        .alpha
        .pixels()
        .iter()
        .zip(whole.alpha.pixels());
    let sum: f32 = pairs.map(|(a, b)| (a - b).abs()).sum();
    // the pane has nothing but the stroke to tell it from the wall
    assert!(sum / (size().pixels() as f32) < 0.04, "{sum}");
    // strokes of other frames change nothing here, and without strokes it is as it was
    assert_eq!(live.set_marks(&marks, &progress).unwrap(), None);
    live.set_marks(&[], &progress).unwrap().unwrap();
    let pairs = live
        .solution()
        .alpha
        .pixels()
        .iter()
        .zip(before.alpha.pixels());
    let sum: f32 = pairs.map(|(a, b)| (a - b).abs()).sum();
    assert!(sum / (size().pixels() as f32) < 0.02, "{sum}");
    // without a plate there is nothing to work before
    matte.plate = None;
    assert!(
        open(&matte)
            .live(3, &image, &[], &progress, &context)
            .unwrap()
            .is_none()
    );
}
