//! MP4 files against what FFmpeg reads from them, and against themselves: order, stamps, seeking, damage.
#![cfg(feature = "h264")]

use proptest::prelude::*;
use ravec_video::mp4::Mp4Source;
use ravec_video::{
    ClipInfo, Frame, FramePicture, FrameSource, Matrix, PixelKind, Range, Rational, Rotation,
    SamplePlane, Siting, TrackKind, VideoError, VideoLimits,
};
use std::fs::{self, File};
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Clips that are read, of which `expected.txt` says what is in them.
const READ: [&str; 8] = [
    "bframes.mp4",
    "long-group.mp4",
    "open-groups.mp4",
    "rotated.mp4",
    "vfr.mp4",
    "fragments.mp4",
    "tagged.mov",
    "cut.mp4",
];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures")
        .join(name)
}

fn open_bytes(bytes: Vec<u8>) -> Result<Mp4Source, VideoError> {
    Mp4Source::open(Cursor::new(bytes), &VideoLimits::default())
}

fn open(path: &Path) -> Mp4Source {
    Mp4Source::open(File::open(path).unwrap(), &VideoLimits::default()).unwrap()
}

/// All frames up to the end or the damage.
fn all(source: &mut Mp4Source) -> Vec<Frame> {
    std::iter::from_fn(|| source.next_frame().unwrap()).collect()
}

fn info(name: &str) -> ClipInfo {
    open(&fixture(name)).info().clone()
}

/// The FNV-1a hash of all planes.
fn hash(frame: &Frame) -> u64 {
    let FramePicture::Yuv(picture) = &frame.picture else {
        panic!("a decoder gives planes");
    };
    let mut value = 0xcbf2_9ce4_8422_2325u64;
    for plane in picture.planes() {
        let SamplePlane::U8(plane) = plane else {
            panic!("of 8 bits");
        };
        for &sample in plane.pixels() {
            value = (value ^ u64::from(sample)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    value
}

#[test]
fn frames_and_stamps_are_those_that_ffmpeg_reads() {
    let expected = fs::read_to_string(fixture("expected.txt")).unwrap();
    for name in READ {
        if name == "cut.mp4" {
            // FFmpeg drops the frame that is on at the start, and moves the others
            continue;
        }
        let mut source = open(&fixture(name));
        let found: Vec<String> = all(&mut source)
            .iter()
            .map(|frame| format!("{name} {} {:016x}", frame.time.start, hash(frame)))
            .collect();
        let wanted: Vec<&str> = expected
            .lines()
            .filter(|line| line.split(' ').next() == Some(name))
            .collect();
        assert!(!wanted.is_empty(), "{name}");
        assert_eq!(found, wanted, "{name}");
        assert_eq!(source.damage(), None, "{name}");
    }
}

#[test]
fn an_edit_list_that_starts_inside_a_frame_shows_the_rest_of_it() {
    let whole = all(&mut open(&fixture("bframes.mp4")));
    let cut = all(&mut open(&fixture("cut.mp4")));
    // the cut at 0.3 s falls into the eighth frame, which begins a group of pictures
    let start = 3 * i64::from(info("cut.mp4").time_base.den()) / 10;
    assert_eq!(cut.len(), whole.len() - 7);
    for (cut, whole) in cut.iter().zip(&whole[7..]) {
        assert_eq!(cut.picture, whole.picture);
        assert_eq!(cut.time.start, (whole.time.start - start).max(0));
    }
    assert_eq!(cut[0].time.duration, cut[1].time.start as u64);
}

#[test]
fn durations_reach_from_one_frame_to_the_next() {
    for name in READ {
        let mut source = open(&fixture(name));
        let frames = all(&mut source);
        for pair in frames.windows(2) {
            let gap = pair[1].time.start - pair[0].time.start;
            assert_eq!(pair[0].time.duration, gap as u64, "{name}");
        }
        let (first, last) = (frames.first().unwrap().time, frames.last().unwrap().time);
        let length = (last.start - first.start) as u64 + last.duration;
        assert_eq!(source.info().duration, Some(length), "{name}");
        assert_eq!(source.info().frames, Some(frames.len() as u64), "{name}");
    }
}

#[test]
fn the_properties_of_a_clip_are_read() {
    let plain = info("bframes.mp4");
    assert_eq!((plain.size.width(), plain.size.height()), (60, 44));
    assert_eq!(plain.rate, Rational::new(25, 1));
    assert_eq!(plain.variable_rate, Some(false));
    assert_eq!(plain.rotation, Rotation::None);
    assert!(plain.other_tracks.is_empty());

    let turned = info("rotated.mp4");
    assert_eq!((turned.size.width(), turned.size.height()), (44, 60));
    assert!(matches!(
        turned.rotation,
        Rotation::Clockwise | Rotation::Counterclockwise
    ));

    let vfr = info("vfr.mp4");
    assert_eq!(vfr.variable_rate, Some(true));
    assert_eq!(vfr.other_tracks.len(), 1);
    assert_eq!(vfr.other_tracks[0].kind, TrackKind::Audio);
    assert_eq!(vfr.other_tracks[0].codec, "aac");

    let tagged = info("tagged.mov");
    assert_eq!(tagged.pixel_aspect, Rational::new(4, 3).unwrap());
    let PixelKind::Yuv { color, .. } = tagged.pixels else {
        panic!("planes");
    };
    assert_eq!((color.matrix, color.range), (Matrix::Bt709, Range::Full));
    assert_eq!(color.siting, Siting::CENTER);
    assert!(color.tagged);
    assert_eq!((color.primaries, color.transfer), (1, 13));
}

#[test]
fn what_is_left_to_ffmpeg_is_named() {
    for (name, feature) in [
        ("ten-bits.mp4", "10 bits"),
        ("chroma-444.mp4", "4:4:4"),
        ("interlaced.mp4", "interlaced"),
        ("hevc.mp4", "hevc"),
    ] {
        let error = Mp4Source::open(File::open(fixture(name)).unwrap(), &VideoLimits::default())
            .err()
            .unwrap();
        assert!(matches!(error, VideoError::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains(feature), "{error}");
    }
}

#[test]
fn files_without_frames_are_refused_in_a_sentence() {
    let error = |bytes: &[u8]| open_bytes(bytes.to_vec()).err().unwrap().to_string();
    assert_eq!(error(b""), "the file is empty");
    let sound = fs::read(fixture("sound.m4a")).unwrap();
    assert_eq!(error(&sound), "the file has no video track (1 audio track)");
    assert!(error(b"\0\0\0\x10ftypisom\0\0\0\0").contains("no index"));
    assert!(matches!(
        open_bytes(b"GIF89a and more bytes".to_vec()),
        Err(VideoError::UnknownFormat)
    ));
}

#[test]
fn limits_are_checked() {
    let bytes = fs::read(fixture("bframes.mp4")).unwrap();
    let few_frames = VideoLimits {
        max_frames: 5,
        ..VideoLimits::default()
    };
    let error = Mp4Source::open(Cursor::new(bytes.clone()), &few_frames).err();
    assert!(matches!(
        error,
        Some(VideoError::TooManyFrames { limit: 5 })
    ));
    let mut small = VideoLimits::default();
    small.pictures.max_pixels = 1000;
    let error = Mp4Source::open(Cursor::new(bytes), &small).err();
    assert!(matches!(error, Some(VideoError::TooManyPixels { .. })));
}

/// Reads frames at indices in an order that jumps forth and back, and some frames after each.
fn check_seeking(path: &Path, indices: impl Iterator<Item = u64>) {
    let mut straight = open(path);
    let hashes: Vec<(i64, u64)> = std::iter::from_fn(|| straight.next_frame().unwrap())
        .map(|frame| (frame.time.start, hash(&frame)))
        .collect();
    let mut source = open(path);
    for index in indices {
        source.seek(index).unwrap();
        for wanted in hashes.iter().skip(index as usize).take(2) {
            let frame = source.next_frame().unwrap().unwrap();
            assert_eq!(
                (frame.time.start, hash(&frame)),
                *wanted,
                "{} at {index}",
                path.display()
            );
        }
    }
    source.seek(hashes.len() as u64).unwrap();
    assert!(source.next_frame().unwrap().is_none());
    source.seek(u64::MAX).unwrap();
    assert!(source.next_frame().unwrap().is_none());
}

#[test]
fn seeking_gives_the_frames_of_reading_from_the_start() {
    for name in READ {
        let count = info(name).frames.unwrap();
        // a step that is prime to all counts visits every frame, forth and back
        let scattered = (0..count).map(|number| number * 17 % count);
        check_seeking(&fixture(name), scattered.chain(0..count));
    }
}

#[test]
fn seeking_is_exact_in_the_clips_of_the_data_folder() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/video");
    let folder =
        std::env::var_os("RAVEC_DATA").map_or(folder, |data| Path::new(&data).join("video"));
    let Ok(entries) = fs::read_dir(&folder) else {
        eprintln!("SKIPPED: there are no clips in {}", folder.display());
        return;
    };
    let mut clips = 0;
    for entry in entries {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "mp4") {
            continue;
        }
        match Mp4Source::open(File::open(&path).unwrap(), &VideoLimits::default()) {
            Ok(source) => {
                let count = source.info().frames.unwrap();
                check_seeking(&path, (0..9).map(|number| (number * 5 + 3) % 9 * count / 9));
                clips += 1;
            }
            Err(VideoError::Unsupported { feature, .. }) => {
                eprintln!("{} is left to FFmpeg: {feature}", path.display());
            }
            Err(error) => panic!("{}: {error}", path.display()),
        }
    }
    assert!(clips > 0, "no clip in {} is read", folder.display());
}

#[test]
fn a_file_that_is_cut_anywhere_gives_the_frames_before_the_cut() {
    // the index of the first comes first; the second is in fragments; that of the third comes last
    for (name, step) in [
        ("tagged.mov", 7),
        ("fragments.mp4", 61),
        ("bframes.mp4", 13),
    ] {
        let bytes = fs::read(fixture(name)).unwrap();
        let mut whole = open_bytes(bytes.clone()).unwrap();
        let frames = all(&mut whole);
        let mut partial = 0;
        for end in (0..bytes.len()).step_by(step) {
            let Ok(mut source) = open_bytes(bytes[..end].to_vec()) else {
                continue;
            };
            let found = all(&mut source);
            assert!(found.len() <= frames.len(), "{name} {end}");
            for (found, whole) in found.iter().zip(&frames) {
                assert_eq!(found.picture, whole.picture, "{name} {end}");
                assert_eq!(found.time.start, whole.time.start, "{name} {end}");
            }
            let lost = source.info().frames.unwrap() > found.len() as u64;
            assert_eq!(source.damage().is_some(), lost, "{name} {end}");
            if let Some(damage) = source.damage() {
                assert_eq!(damage.frames, found.len() as u64);
                partial += usize::from(!found.is_empty());
            }
        }
        if name == "tagged.mov" {
            assert!(partial > 0, "{name}");
        }
    }
}

#[test]
fn a_broken_sample_ends_the_clip_after_the_frames_before_it() {
    let bytes = fs::read(fixture("bframes.mp4")).unwrap();
    let frames = all(&mut open_bytes(bytes.clone()).unwrap());
    let samples = bytes.windows(4).position(|four| four == b"mdat").unwrap() + 4;
    let index = bytes.windows(4).position(|four| four == b"moov").unwrap();
    let mut ends = 0;
    for at in samples..index - 8 {
        let mut broken = bytes.clone();
        broken[at..at + 4].fill(0xff);
        let Ok(mut source) = open_bytes(broken) else {
            continue;
        };
        let found = all(&mut source);
        let Some(damage) = source.damage() else {
            continue;
        };
        assert_eq!(damage.frames, found.len() as u64);
        // where the lengths are broken, nothing before was touched
        if damage.reason.contains("lengths") && !found.is_empty() {
            ends += 1;
            for (found, whole) in found.iter().zip(&frames) {
                assert_eq!(found.time.start, whole.time.start, "{at}");
            }
            let same = found
                .iter()
                .zip(&frames)
                .filter(|(a, b)| a.picture == b.picture)
                .count();
            assert!(same + 1 >= found.len(), "{at}: {same} of {}", found.len());
        }
        assert!(source.next_frame().unwrap().is_none());
    }
    assert!(ends > 4, "{ends}");
}

/// Opens and reads whatever it is, forth and with a jump.
fn exercise(bytes: Vec<u8>) {
    let mut limits = VideoLimits::default();
    limits.pictures.max_pixels = 1 << 16;
    let Ok(mut source) = Mp4Source::open(Cursor::new(bytes), &limits) else {
        return;
    };
    let mut last = i64::MIN;
    while let Ok(Some(frame)) = source.next_frame() {
        assert!(frame.time.start >= last);
        last = frame.time.start;
    }
    if source.seek(3).is_ok() {
        let _ = source.next_frame();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn damaged_bytes_never_panic(
        name in prop::sample::select(READ.to_vec()),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = fs::read(fixture(name)).unwrap();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        exercise(bytes);
    }

    #[test]
    fn lying_numbers_in_the_index_never_panic(
        name in prop::sample::select(READ.to_vec()),
        places in prop::collection::vec(any::<prop::sample::Index>(), 1..4),
        number in prop::sample::select(vec![0u32, 1, 2, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0xffff, 0x1_0000]),
    ) {
        let mut bytes = fs::read(fixture(name)).unwrap();
        let index = bytes.windows(4).position(|four| four == b"moov").unwrap();
        for place in places {
            let at = index + place.index((bytes.len() - index - 4).min(1200));
            bytes[at..at + 4].copy_from_slice(&number.to_be_bytes());
        }
        exercise(bytes);
    }
}
