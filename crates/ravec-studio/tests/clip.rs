//! Reading of clips beside the window, and the timeline, driven by clicks, drags and keys without a window.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

mod common;

use common::drag_through;
use egui::accesskit::Role;
use egui::{Key, Modifiers, Pos2, Vec2, pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use ravec::raster::{AnyImage, Image, Size, Srgb};
use ravec_studio::Shown;
use ravec_studio::clip::{ClipReader, FrameState, Scale, Timeline, TimelineAction, TimelineRow};
use ravec_video::{
    Clip, ClipWriter, CreateOptions, Frame, FramePicture, FrameSource as _, FrameTime, OpenOptions,
    PixelKind, Rational, SinkFormat,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn size() -> Size {
    Size::new(48, 32).unwrap()
}

/// The brightness of the left half of a frame.
fn level(at: u64) -> u8 {
    (40 + 5 * at % 200) as u8
}

/// A bar that moves over two halves, whose brightness is the number of the frame.
fn picture(at: u64) -> Image<Srgb<u8>> {
    Image::from_fn(size(), |col, row| {
        if col as u64 == at % 48 && row > 3 {
            Srgb([250, 20, 20])
        } else if col < 24 {
            Srgb([level(at); 3])
        } else {
            Srgb([(row * 7) as u8; 3])
        }
    })
}

/// Writes a clip at 25 frames a second, whose format is that of the name.
fn clip(folder: &Path, name: &str, frames: u64) -> PathBuf {
    let path = folder.join(name);
    let rate = Rational::new(25, 1).unwrap();
    let format = SinkFormat {
        size: size(),
        pixels: PixelKind::Rgb {
            depth: 8,
            alpha: false,
        },
        time_base: rate.recip(),
        rate: Some(rate),
        pixel_aspect: Rational::ONE,
    };
    let mut options = CreateOptions::default();
    options.encode.lossless = name.ends_with("y4m");
    let mut writer = ClipWriter::create(&path, &format, &options).unwrap();
    for at in 0..frames {
        let picture = FramePicture::Image(picture(at).into());
        let time = FrameTime {
            start: at as i64,
            duration: 1,
        };
        writer.write(&Frame { picture, time }).unwrap();
    }
    writer.finish().unwrap();
    path
}

/// A folder of PNG pictures.
fn folder_of_pictures(folder: &Path, frames: u64) -> PathBuf {
    let inner = folder.join("shot");
    std::fs::create_dir(&inner).unwrap();
    clip(&inner, "frame_%04d.png", frames);
    inner
}

fn open(path: &Path) -> ClipReader {
    ClipReader::open(path, Arc::new(|| {}))
}

/// The pictures of a clip as they are read one after the other.
fn in_order(path: &Path) -> Vec<AnyImage> {
    let mut clip = Clip::open(path, &OpenOptions::default()).unwrap();
    let mut images = Vec::new();
    while let Some(frame) = clip.next_frame().unwrap() {
        images.push(frame.picture.into_image());
    }
    images
}

/// The number of the frame that is shown after a request.
fn read(reader: &ClipReader, frame: u64) -> Option<u64> {
    reader.request(frame);
    reader.wait();
    reader.shown().map(|(number, ..)| number)
}

#[test]
fn frames_are_those_that_are_read_in_order_whatever_the_order_of_requests() {
    let folder = tempfile::tempdir().unwrap();
    let mut clips = vec![folder_of_pictures(folder.path(), 60)];
    for name in ["clip.y4m", "clip.apng", "clip.mp4", "clip.gif"] {
        clips.push(clip(folder.path(), name, 60));
    }
    // steps on and back, jumps both ways, the ends, and a walk that comes everywhere
    let mut order = vec![0, 1, 2, 3, 59, 58, 57, 20, 19, 18, 5, 30, 31, 31, 29, 0, 59];
    order.extend((0..60).map(|k| 37 * k % 60));
    for path in clips {
        let truth = in_order(&path);
        assert_eq!(truth.len(), 60);
        let reader = open(&path);
        for &number in &order {
            assert_eq!(read(&reader, number), Some(number), "{}", path.display());
            let (_, shown, picture) = reader.shown().unwrap();
            let expected = &truth[number as usize];
            assert!(picture.image == *expected, "{number} of {}", path.display());
            let expected = Shown::new(Arc::new(ravec_media::Picture::from_image(expected.clone())));
            assert!(shown.pixels() == expected.pixels());
            assert_eq!(reader.failure(), None);
            let (visible, _) = reader.visible().unwrap();
            assert_eq!(visible, number, "no other frame is shown once it is read");
        }
    }
}

#[test]
fn the_last_of_many_requests_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let reader = open(&clip(folder.path(), "clip.mp4", 50));
    // requests before the clip is open count too
    for number in [4, 40, 7, 12] {
        reader.request(number);
    }
    reader.wait();
    assert_eq!(reader.shown().unwrap().0, 12);
    for number in (0..50).rev().chain([33]) {
        reader.request(number);
    }
    reader.wait();
    assert_eq!(reader.shown().unwrap().0, 33);
    assert_eq!(reader.seconds_at(33), Some(33.0 / 25.0));
}

#[test]
fn facts_are_known_once_the_clip_is_open_and_frames_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["clip.mp4", "clip.y4m", "clip.gif", "clip.apng"] {
        let reader = open(&clip(folder.path(), name, 130));
        reader.wait();
        let facts = reader.info().unwrap();
        assert_eq!(facts.size, [48, 32], "{name}");
        reader.wait_for_thumbnails();
        let facts = reader.info().unwrap();
        assert_eq!((facts.frames, facts.is_exact), (130, true), "{name}");
        assert!(
            (facts.seconds_per_frame - 0.04).abs() < 1e-3,
            "{name}: {facts:?}"
        );
        assert_eq!(read(&reader, 129), Some(129), "{name}");
    }
}

#[test]
fn what_is_no_clip_gives_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("empty-folder")).unwrap();
    std::fs::write(path("empty.mp4"), []).unwrap();
    std::fs::write(path("text.mp4"), "no film").unwrap();
    std::fs::write(
        path("header.y4m"),
        "YUV4MPEG2 W0 H99999999999 F25:1\nFRAME\n",
    )
    .unwrap();
    std::fs::write(path("cut.gif"), b"GIF89a\x05").unwrap();
    let mp4 = std::fs::read(clip(folder.path(), "whole.mp4", 9)).unwrap();
    std::fs::write(path("cut.mp4"), &mp4[..mp4.len() / 3]).unwrap();
    let names = [
        "empty-folder",
        "empty.mp4",
        "text.mp4",
        "header.y4m",
        "cut.gif",
        "cut.mp4",
        "missing.mp4",
        "-",
    ];
    for name in names {
        let path = if name == "-" {
            PathBuf::from(name)
        } else {
            path(name)
        };
        let reader = open(&path);
        reader.thumbnails(10);
        assert_eq!(read(&reader, 3), None, "{name}");
        reader.wait_for_thumbnails();
        let failure = reader.failure().unwrap();
        assert!(
            failure.len() > 20 && !failure.contains('\n'),
            "{name}: {failure}"
        );
        assert!(reader.info().is_none() && !reader.is_busy(), "{name}");
    }
}

#[test]
fn the_good_part_of_a_damaged_clip_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["clip.y4m", "clip.mp4"] {
        let path = clip(folder.path(), name, 60);
        let bytes = std::fs::read(&path).unwrap();
        if name == "clip.mp4" {
            // nothing is readable where the last frames are
            let mut broken = bytes.clone();
            let (data, index) = (position(&bytes, b"mdat"), position(&bytes, b"moov"));
            let end = if index > data { index - 4 } else { bytes.len() };
            broken[usize::midpoint(data, end)..end].fill(0xff);
            std::fs::write(&path, broken).unwrap();
        } else {
            std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
        }
        let truth = in_order(&path);
        let good = truth.len() as u64;
        assert!((2..60).contains(&good), "{name}: {good}");
        let reader = open(&path);
        assert_eq!(read(&reader, good - 1), Some(good - 1), "{name}");
        assert!(reader.shown().unwrap().2.image == truth[good as usize - 1]);
        assert_eq!(read(&reader, good), Some(good - 1), "{name}");
        let failure = reader.failure().unwrap();
        assert!(
            failure.contains(&format!("frame {good}")),
            "{name}: {failure}"
        );
        assert_eq!(read(&reader, 1), Some(1), "{name}");
        assert!(reader.shown().unwrap().2.image == truth[1], "{name}");
        assert_eq!(reader.failure(), None);
    }
}

fn position(bytes: &[u8], word: &[u8]) -> usize {
    let mut windows = bytes.windows(word.len());
    windows.position(|window| window == word).unwrap()
}

#[test]
fn a_picture_that_vanishes_is_missed_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder_of_pictures(folder.path(), 30);
    let truth = in_order(&path);
    let reader = open(&path);
    assert_eq!(read(&reader, 3), Some(3));
    std::fs::remove_file(path.join("frame_0020.png")).unwrap();
    assert_eq!(read(&reader, 20), Some(3));
    let failure = reader.failure().unwrap();
    assert!(failure.contains("frame 20"), "{failure}");
    // on the way from 19 to 22 lies the one that is missing
    for number in [21, 19, 22, 18, 23] {
        assert_eq!(read(&reader, number), Some(number));
        assert!(reader.shown().unwrap().2.image == truth[number as usize]);
    }
    assert_eq!(reader.failure(), None);
    // with its folder all are gone, and the last good one stays
    std::fs::remove_dir_all(&path).unwrap();
    assert_eq!(read(&reader, 9), Some(23));
    assert!(reader.failure().is_some());
    assert_eq!(read(&reader, 3), Some(3), "it is still in the cache");
}

#[test]
fn a_frame_beyond_the_end_gives_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["clip.y4m", "clip.mp4"] {
        let reader = open(&clip(folder.path(), name, 12));
        assert_eq!(read(&reader, 11), Some(11));
        for number in [12, 1000, u64::MAX] {
            assert_eq!(read(&reader, number), Some(11), "{name}");
            let failure = reader.failure().unwrap();
            assert!(failure.contains("no frame"), "{failure}");
        }
        assert_eq!(read(&reader, 10), Some(10));
    }
}

#[test]
fn thumbnails_show_their_frames_and_are_made_again_for_another_count() {
    let folder = tempfile::tempdir().unwrap();
    let reader = open(&clip(folder.path(), "clip.mp4", 40));
    let frames = |count: usize| {
        reader.thumbnails(count);
        reader.wait_for_thumbnails();
        let made = reader.thumbnails(count);
        for thumbnail in made.iter() {
            let level = &thumbnail.tile;
            assert_eq!((level.width, level.height), (48, 32));
            let pixel = level.pixels[48 + 12];
            let expected = self::level(thumbnail.frame);
            assert!(pixel[0].abs_diff(expected) < 12, "{pixel:?} {expected}");
        }
        made.iter()
            .map(|thumbnail| thumbnail.frame)
            .collect::<Vec<_>>()
    };
    assert_eq!(frames(4), [5, 15, 25, 35]);
    assert_eq!(frames(5), [5, 15, 25, 35], "a little more is not worth it");
    assert_eq!(frames(8), [2, 7, 12, 17, 22, 27, 32, 37]);
    assert_eq!(frames(1000).len(), 40);
}

#[test]
fn a_small_copy_of_the_frame_stands_in_until_it_is_decoded() {
    let folder = tempfile::tempdir().unwrap();
    let path = clip(folder.path(), "clip.mp4", 60);
    let reader = open(&path);
    assert_eq!(read(&reader, 0), Some(0));
    reader.thumbnails(4);
    reader.wait_for_thumbnails();
    reader.wait_for_proxies();
    // the copy or the frame: never another one, once one of them is there
    reader.request(47);
    let shown = loop {
        match reader.visible() {
            Some((47, shown)) => break shown,
            _ => std::thread::yield_now(),
        }
    };
    assert_eq!(shown.size(), [48, 32]);
    let found = shown.pixel(12, 16).unwrap();
    assert!(found[0].abs_diff(level(47)) < 12, "{found:?}");
    reader.wait();
    let (_, exact, _) = reader.shown().unwrap();
    assert!(exact.pixels() == reader.visible().unwrap().1.pixels());
}

#[test]
fn a_reader_is_dropped_while_it_reads() {
    let folder = tempfile::tempdir().unwrap();
    let path = clip(folder.path(), "clip.mp4", 60);
    for number in 0..20 {
        let reader = open(&path);
        reader.thumbnails(30);
        reader.request(59 - number);
    }
    // the threads of all of them have ended, and the next one reads as ever
    let reader = open(&path);
    assert_eq!(read(&reader, 59), Some(59));
}

/// A window with a timeline alone.
struct App {
    reader: ClipReader,
    timeline: Timeline,
    states: Vec<FrameState>,
    values: Vec<Option<f32>>,
    moves: Vec<u64>,
    last: TimelineAction,
    text: String,
}

const FRAMES: u64 = 100;

fn app() -> (tempfile::TempDir, Harness<'static, App>) {
    let folder = tempfile::tempdir().unwrap();
    let reader = open(&clip(folder.path(), "clip.mp4", FRAMES));
    let states = [
        FrameState::Good,
        FrameState::Weak,
        FrameState::Lost,
        FrameState::Corrected,
    ];
    let app = App {
        reader,
        timeline: Timeline::default(),
        states: (0..90).map(|at| states[at / 7 % 4]).collect(),
        values: (0..90)
            .map(|at| (at % 9 != 0).then_some((at % 13) as f32))
            .collect(),
        moves: Vec::new(),
        last: TimelineAction::default(),
        text: String::new(),
    };
    let mut harness = Harness::builder()
        .with_size(Vec2::new(900.0, 300.0))
        .with_step_dt(0.02)
        .build_ui_state(
            |ui, app: &mut App| {
                let label = ui.label("Remark");
                ui.text_edit_singleline(&mut app.text).labelled_by(label.id);
                let row = TimelineRow {
                    label: "Predicted error",
                    states: &app.states,
                    values: &app.values,
                    marks: &[11, 95],
                };
                app.last = app.timeline.ui(ui, &app.reader, &[row]);
                app.moves.extend(app.last.moved);
            },
            app,
        );
    settle(&mut harness);
    (folder, harness)
}

/// Lets all reading end, and draws what is new.
fn settle(harness: &mut Harness<'_, App>) {
    for _ in 0..3 {
        harness.step();
        harness.state().reader.wait();
        harness.state().reader.wait_for_thumbnails();
    }
}

/// The place of a frame in the thumbnails.
fn place(harness: &Harness<'_, App>, frame: u64) -> Pos2 {
    let strip = harness.get_by_label("Playhead of the timeline").rect();
    let scale = Scale::whole(strip.left(), strip.width(), FRAMES);
    pos2(scale.middle_of(frame), strip.top() + 40.0)
}

fn drag(harness: &mut Harness<'_, App>, points: &[Pos2]) {
    drag_through(harness, points);
    assert!(harness.state().last.is_dragging);
    harness.drop_at(points[points.len() - 1]);
    settle(harness);
    assert!(!harness.state().last.is_dragging);
}

/// The frames at the playhead and in the reader, which are the same once all is read.
fn current(harness: &mut Harness<'_, App>) -> u64 {
    settle(harness);
    let current = harness.state().timeline.current;
    let (shown, ..) = harness.state().reader.shown().unwrap();
    assert_eq!(shown, current);
    current
}

fn press(harness: &mut Harness<'_, App>, key: Key) -> u64 {
    harness.key_press(key);
    current(harness)
}

#[test]
fn the_playhead_is_dragged_and_clicked_to_the_exact_frame() {
    let (_folder, mut harness) = app();
    assert_eq!(current(&mut harness), 0);
    let way = [10, 30, 71, 64].map(|frame| place(&harness, frame));
    drag(&mut harness, &way);
    assert_eq!(current(&mut harness), 64);
    assert_eq!(harness.state().moves, [10, 30, 71, 64]);
    let there = place(&harness, 17);
    harness.hover_at(there);
    harness.drag_at(there);
    harness.drop_at(there);
    assert_eq!(current(&mut harness), 17);
    // far beside the strip are the ends of the clip
    let way = [place(&harness, 50), pos2(5000.0, 0.0)];
    drag(&mut harness, &way);
    assert_eq!(current(&mut harness), FRAMES - 1);
}

#[test]
fn keys_and_buttons_step() {
    let (_folder, mut harness) = app();
    assert_eq!(press(&mut harness, Key::ArrowLeft), 0);
    assert_eq!(press(&mut harness, Key::ArrowRight), 1);
    assert_eq!(press(&mut harness, Key::ArrowRight), 2);
    assert_eq!(press(&mut harness, Key::ArrowLeft), 1);
    assert_eq!(press(&mut harness, Key::End), FRAMES - 1);
    assert_eq!(press(&mut harness, Key::ArrowRight), FRAMES - 1);
    harness.key_press_modifiers(Modifiers::SHIFT, Key::ArrowLeft);
    assert_eq!(current(&mut harness), FRAMES - 11);
    assert_eq!(press(&mut harness, Key::Home), 0);
    for (label, frame) in [
        ("Next frame", 1),
        ("Next frame", 2),
        ("Previous frame", 1),
        ("Last frame", 99),
        ("First frame", 0),
    ] {
        harness.get_by_label(label).click();
        assert_eq!(current(&mut harness), frame, "{label}");
    }
    // after a click on the strip the arrows still move the playhead and not the focus
    let there = place(&harness, 40);
    harness.hover_at(there);
    harness.drag_at(there);
    harness.drop_at(there);
    assert_eq!(current(&mut harness), 40);
    assert_eq!(press(&mut harness, Key::ArrowRight), 41);
    assert_eq!(press(&mut harness, Key::ArrowRight), 42);
    // combinations belong to the window
    harness.key_press_modifiers(Modifiers::COMMAND, Key::P);
    settle(&mut harness);
    assert!(!harness.state().timeline.player.is_playing());
}

#[test]
fn a_text_that_is_typed_moves_nothing() {
    let (_folder, mut harness) = app();
    harness.get_by_role(Role::TextInput).focus();
    settle(&mut harness);
    for key in [Key::P, Key::I, Key::O, Key::ArrowRight, Key::End] {
        assert_eq!(press(&mut harness, key), 0);
    }
    let timeline = &harness.state().timeline;
    assert!(timeline.range.is_empty() && !timeline.player.is_playing());
}

#[test]
fn a_range_is_set_by_keys_and_handles_and_cleared() {
    let (_folder, mut harness) = app();
    harness.state_mut().timeline.current = 20;
    assert_eq!(press(&mut harness, Key::I), 20);
    harness.state_mut().timeline.current = 59;
    assert_eq!(press(&mut harness, Key::O), 59);
    assert_eq!(harness.state().timeline.range, 20..60);
    // the handles move the ends and leave the playhead
    let from = harness.get_by_label("Out point").rect().center();
    let to = pos2(place(&harness, 79).x + 5.0, from.y);
    drag(&mut harness, &[from, from.lerp(to, 0.5), to]);
    assert_eq!(harness.state().timeline.range, 20..80);
    let from = harness.get_by_label("In point").rect().center();
    let to = pos2(place(&harness, 90).x, from.y);
    drag(&mut harness, &[from, from.lerp(to, 0.5), to]);
    assert_eq!(
        harness.state().timeline.range,
        79..80,
        "an end stops at the other one"
    );
    assert_eq!(current(&mut harness), 59);
    harness.get_by_label("Clear range").click();
    settle(&mut harness);
    assert!(harness.state().timeline.range.is_empty());
    assert!(harness.query_by_label("Clear range").is_none());
    harness.get_by_label("Set in").click();
    settle(&mut harness);
    assert_eq!(harness.state().timeline.selection(FRAMES), 59..100);
}

#[test]
fn playing_shows_the_frames_that_are_due() {
    let (_folder, mut harness) = app();
    harness.state_mut().timeline.range = 30..34;
    harness.state_mut().timeline.current = 31;
    settle(&mut harness);
    harness.state_mut().moves.clear();
    harness.key_press(Key::P);
    // at least 20 steps of half a frame, the first of which is the key
    for _ in 0..20 {
        harness.step();
    }
    assert!(harness.state().timeline.player.is_playing());
    let truth = [32, 33, 30, 31, 32, 33, 30, 31, 32, 33, 30];
    let moves = &harness.state().moves;
    assert!(moves.len() >= 9 && truth.starts_with(moves), "{moves:?}");
    harness.get_by_label("Pause").click();
    let at = current(&mut harness);
    for _ in 0..20 {
        harness.step();
    }
    assert_eq!(current(&mut harness), at);
    // a step while it plays stops it
    harness.get_by_label("Play").click();
    settle(&mut harness);
    let before = harness.state().timeline.current;
    harness.key_press(Key::ArrowLeft);
    current(&mut harness);
    assert!(!harness.state().timeline.player.is_playing());
    assert!(harness.state().timeline.current <= before || before == 30);
}

#[test]
fn the_wheel_zooms_and_the_playhead_stays_in_sight() {
    let (_folder, mut harness) = app();
    let at = place(&harness, 50);
    harness.hover_at(at);
    harness.step();
    harness.event(egui::Event::MouseWheel {
        unit: egui::MouseWheelUnit::Point,
        delta: Vec2::new(0.0, 400.0),
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Wheel,
        modifiers: Modifiers::NONE,
    });
    for _ in 0..60 {
        harness.step();
    }
    // frames are wider than before: a point to the right is not where it was
    let right = place(&harness, 90);
    harness.hover_at(right);
    harness.drag_at(right);
    harness.drop_at(right);
    let found = current(&mut harness);
    assert!((51..70).contains(&found), "{found}");
    assert_eq!(press(&mut harness, Key::Home), 0);
    let left = place(&harness, 0);
    harness.hover_at(left);
    harness.drag_at(left);
    harness.drop_at(left);
    assert_eq!(
        current(&mut harness),
        0,
        "the strip has scrolled to the playhead"
    );
}

#[test]
fn a_screen_reader_names_the_controls_and_moves_the_playhead() {
    let (_folder, mut harness) = app();
    for label in [
        "Play",
        "First frame",
        "Previous frame",
        "Next frame",
        "Last frame",
        "Set in",
        "Set out",
        "Loop",
        "In point",
        "Out point",
        "Playhead of the timeline",
    ] {
        assert!(harness.query_by_label(label).is_some(), "{label}");
    }
    let frame = harness.get_by_role_and_label(Role::SpinButton, "Frame");
    assert_eq!(frame.accesskit_node().numeric_value(), Some(0.0));
    harness.get_by_role_and_label(Role::ComboBox, "Speed");
    harness
        .get_by_label("Playhead of the timeline")
        .set_value_accesskit(33.0);
    assert_eq!(current(&mut harness), 33);
    harness
        .get_by_label("Playhead of the timeline")
        .increment_accesskit();
    assert_eq!(current(&mut harness), 34);
}

#[test]
fn a_clip_that_cannot_be_opened_is_a_sentence_in_the_window() {
    let reader = open(Path::new("no/such.mp4"));
    reader.wait();
    let mut timeline = Timeline::default();
    let harness = Harness::new_ui(move |ui| {
        timeline.ui(ui, &reader, &[]);
    });
    let message = harness.get_by_label_contains("such.mp4");
    assert!(
        message.accesskit_node().value().is_some() || message.accesskit_node().label().is_some()
    );
}
