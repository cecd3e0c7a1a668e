//! Clips that are cut, and programs that stop.

use crate::scene::{clips, frames, has_ffmpeg, open, options, read_all, sink_format, write, yuv};
use ravec_raster::Size;
use ravec_video::{FrameSource, Rational, Subsampling, VideoError};

#[test]
fn clips_that_are_cut_give_whole_frames_and_the_reason() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for path in clips() {
        let extension = path.extension().unwrap().to_owned();
        let bytes = std::fs::read(&path).unwrap();
        let cut = folder.path().join("cut").with_extension(&extension);
        std::fs::write(&cut, &bytes[..bytes.len() * 6 / 10]).unwrap();
        let name = path.file_name().unwrap().display();
        let mut source = match open(&cut) {
            Ok(source) => source,
            Err(VideoError::Damaged { .. } | VideoError::UnknownFormat) if extension == "mp4" => {
                continue;
            }
            Err(error) => panic!("{name}: {error}"),
        };
        let found = read_all(&mut source);
        let mut whole = open(&path).unwrap();
        for (number, found) in found.iter().enumerate() {
            let truth = whole
                .next_frame()
                .unwrap()
                .expect("the whole clip is longer");
            assert!(
                found.picture == truth.picture,
                "{name}: frame {number} is not whole"
            );
            assert_eq!(found.time.start, truth.time.start, "{name}: frame {number}");
        }
        let rest = read_all(&mut whole).len();
        assert!(
            found.len() > rest / 2 && rest > 0,
            "{name}: {} of {}",
            found.len(),
            found.len() + rest
        );
        let damage = source
            .damage()
            .unwrap_or_else(|| panic!("{name}: the cut is not noticed"));
        assert_eq!(damage.frames, found.len() as u64);
        assert!(
            !damage.reason.contains("file:") && !damage.reason.is_empty(),
            "{name}: {}",
            damage.reason
        );
        // the end stays where it is
        source.seek(damage.frames).unwrap();
        assert_eq!(source.next_frame().unwrap(), None);
        source.seek(found.len() as u64 / 2).unwrap();
        assert_eq!(
            source.next_frame().unwrap().as_ref(),
            found.get(found.len() / 2),
            "{name}"
        );
    }
}

#[test]
fn a_cut_at_any_place_makes_no_panic_and_no_wrong_frame() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let format = sink_format(
        Size::new(32, 16).unwrap(),
        yuv(Subsampling::S420, 8, false),
        Rational::new(1, 25).unwrap(),
    );
    let truth = frames(&format, &[0, 1, 2, 3, 4, 5, 6, 7]);
    for extension in ["mkv", "avi", "nut"] {
        let path = folder.path().join(format!("whole.{extension}"));
        write(&path, &format, &options("ffv1", true), &truth, 9).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let cut = folder.path().join(format!("cut.{extension}"));
        for part in 0..14 {
            std::fs::write(&cut, &bytes[..bytes.len() * part / 14]).unwrap();
            match open(&cut) {
                Ok(mut source) => {
                    for (found, truth) in read_all(&mut source).iter().zip(&truth) {
                        assert!(found.picture == truth.picture, "{extension} {part}");
                    }
                }
                Err(error) => {
                    let message = error.to_string();
                    assert!(!message.contains('\n') && message.len() < 300, "{message}");
                    assert_eq!(matches!(error, VideoError::Empty), part == 0, "{message}");
                }
            }
        }
    }
}

/// The bytes of a transport stream of `count` frames with two key frames.
fn transport_stream(folder: &std::path::Path, count: usize) -> Vec<u8> {
    let format = sink_format(
        Size::new(96, 64).unwrap(),
        yuv(Subsampling::S420, 8, false),
        Rational::new(1, 25).unwrap(),
    );
    let numbers: Vec<i64> = (0..count as i64).collect();
    let path = folder.join("part.ts");
    let truth = frames(&format, &numbers);
    write(&path, &format, &options("h264", false), &truth, count).unwrap();
    std::fs::read(&path).unwrap()
}

#[test]
fn joined_streams_give_the_frames_of_both() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let part = transport_stream(folder.path(), 25);
    let whole = read_all(&mut open(&folder.path().join("part.ts")).unwrap());
    let joined = folder.path().join("joined.ts");
    std::fs::write(&joined, [&part[..], &part[..]].concat()).unwrap();
    let mut source = open(&joined).unwrap();
    let found = read_all(&mut source);
    // the container calls the last frame of the first part damaged, and those that wait for it cannot be told apart
    let damage = source.damage().unwrap().clone();
    let lost = damage.lost.unwrap() as usize;
    assert!(lost <= 5 && found.len() + lost == 50, "{damage}");
    let first = damage.frames as usize;
    assert_eq!(first + lost, 25);
    for (found, truth) in found.iter().zip(whole[..first].iter().chain(&whole)) {
        assert!(found.picture == truth.picture);
    }
    assert!(found.is_sorted_by_key(|frame| frame.time.start));
    source.seek(40).unwrap();
    assert_eq!(source.next_frame().unwrap().as_ref(), found.get(40));
}

#[test]
fn frames_behind_damage_are_whole_and_lost_ones_are_counted() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let part = transport_stream(folder.path(), 25);
    let whole = read_all(&mut open(&folder.path().join("part.ts")).unwrap());
    let mut joined = [&part[..], &part[..], &part[..]].concat();
    // five packets of the second part are gone
    let packet = 188;
    let middle = (part.len() + part.len() / 2) / packet * packet;
    joined.drain(middle..middle + 5 * packet);
    let path = folder.path().join("joined.ts");
    std::fs::write(&path, joined).unwrap();
    let mut source = open(&path).unwrap();
    let found = read_all(&mut source);
    let truth: Vec<_> = whole.iter().chain(&whole).chain(&whole).collect();
    let damage = source.damage().unwrap().clone();
    // joints cost some frames before them
    let first = damage.frames as usize;
    assert!((20..25).contains(&first), "{damage}");
    for (found, truth) in found.iter().zip(&truth).take(first) {
        assert!(found.picture == truth.picture);
    }
    for (found, truth) in found.iter().rev().zip(truth.iter().rev()).take(25) {
        assert!(found.picture == truth.picture);
    }
    for frame in &found {
        assert!(whole.iter().any(|truth| truth.picture == frame.picture));
    }
    assert!((50..75).contains(&found.len()), "{}: {damage}", found.len());
    let lost = damage.lost.unwrap() as usize;
    assert!((74..=75).contains(&(found.len() + lost)), "{damage}");
}

#[test]
fn narrow_frames_of_10_bit_are_encoded() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (width, height) in [(16, 16), (36, 64), (48, 48), (48, 64), (64, 48)] {
        let format = sink_format(
            Size::new(width, height).unwrap(),
            yuv(Subsampling::S420, 10, false),
            Rational::new(1, 25).unwrap(),
        );
        let truth = frames(&format, &[0, 1, 2, 3, 4, 5, 6, 7]);
        let path = folder.path().join("narrow.mkv");
        write(&path, &format, &options("hevc", false), &truth, 8).unwrap();
        assert_eq!(read_all(&mut open(&path).unwrap()).len(), 8);
    }
}
