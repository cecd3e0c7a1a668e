//! Sound and subtitles beside the frames, and turns of frames.

use crate::scene::{
    ffmpeg, ffprobe, frames, has_encoder, has_ffmpeg, open, options, read_all, sink_format, text,
    yuv,
};
use ravec_raster::Size;
use ravec_video::{
    FfmpegSink, FramePicture, FrameSink, FrameSource, Rational, Rotation, SamplePlane, Subsampling,
    TrackExcerpt, TrackKind, assemble,
};
use std::path::Path;

fn part(path: &Path, extension: &str, count: i64) {
    let format = sink_format(
        Size::new(64, 48).unwrap(),
        yuv(Subsampling::S420, 8, false),
        Rational::new(1, 25).unwrap(),
    );
    let starts: Vec<i64> = (50..50 + count).collect();
    let mut sink =
        Box::new(FfmpegSink::create(path, extension, &format, &options("mpeg4", false)).unwrap());
    for frame in frames(&format, &starts) {
        sink.write(&frame).unwrap();
    }
    sink.finish().unwrap();
}

#[test]
fn sound_and_subtitles_are_copied_for_the_time_of_the_frames() {
    if !has_ffmpeg() || !has_encoder("aac") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(
        path("s.srt"),
        "1\n00:00:02,500 --> 00:00:03,000\nin\n\n2\n00:00:08,000 --> 00:00:09,000\nout\n",
    )
    .unwrap();
    ffmpeg(&[
        "-f",
        "lavfi",
        "-i",
        "testsrc=d=10:s=64x48:r=25",
        "-f",
        "lavfi",
        "-i",
        "sine=d=10",
        "-i",
        text(&path("s.srt")),
        "-map",
        "0",
        "-map",
        "1",
        "-map",
        "1",
        "-map",
        "2",
        "-c:v",
        "mpeg4",
        "-g",
        "125",
        "-c:a:0",
        "aac",
        "-c:a:1",
        "pcm_s16le",
        "-c:s",
        "subrip",
        "-metadata:s:a:0",
        "language=deu",
        text(&path("all.mkv")),
    ]);
    let source = open(&path("all.mkv")).unwrap();
    let kinds: Vec<_> = source
        .info()
        .other_tracks
        .iter()
        .map(|track| (track.kind, track.codec.as_str()))
        .collect();
    assert_eq!(
        kinds,
        [
            (TrackKind::Audio, "aac"),
            (TrackKind::Audio, "pcm_s16le"),
            (TrackKind::Subtitles, "subrip")
        ]
    );
    assert_eq!(
        source.info().other_tracks[0].language.as_deref(),
        Some("deu")
    );

    part(&path("part"), "mkv", 100);
    let whole = path("all.mkv");
    // 4 seconds from the second second
    let excerpt = TrackExcerpt {
        path: &whole,
        start_secs: 2.0,
        end_secs: Some(6.0),
    };
    let warnings = assemble(&[path("part")], Some(excerpt), &path("out.mkv"), "mkv").unwrap();
    assert_eq!(warnings, Vec::<String>::new());
    let times = |output: &Path, select: &str| -> Vec<f64> {
        let found = ffprobe(&[
            "-select_streams",
            select,
            "-show_entries",
            "packet=pts_time",
            "-of",
            "csv=p=0",
            text(output),
        ]);
        found
            .iter()
            .map(|time| time.trim_end_matches(',').parse().unwrap())
            .collect()
    };
    for select in ["a:0", "a:1"] {
        let times = times(&path("out.mkv"), select);
        let (first, last) = (times[0], times[times.len() - 1]);
        // a packet of sound has up to 0.1 seconds
        assert!(
            (-0.05..0.1).contains(&first) && (3.85..4.05).contains(&last),
            "{select}: {first} {last}"
        );
    }
    let subtitles = times(&path("out.mkv"), "s");
    assert_eq!(subtitles.len(), 1);
    // the priming of AAC moves the frames of the original by 23 milliseconds
    assert!((subtitles[0] - 0.5).abs() < 0.03, "{subtitles:?}");
    assert_eq!(times(&path("out.mkv"), "v").len(), 100);
    assert_eq!(read_all(&mut open(&path("out.mkv")).unwrap()).len(), 100);

    let warnings = assemble(&[path("part")], Some(excerpt), &path("out.mp4"), "mp4").unwrap();
    assert_eq!(
        warnings,
        [
            "the audio track 2 (pcm_s16le) was left out: .mp4 files cannot hold it",
            "the subtitle track 3 (subrip) was left out: .mp4 files cannot hold it"
        ]
    );
    let source = open(&path("out.mp4")).unwrap();
    assert_eq!(source.info().other_tracks.len(), 1);
    assert_eq!(
        source.info().other_tracks[0].language.as_deref(),
        Some("deu")
    );
}

#[test]
fn frames_are_turned_once_as_players_turn_them() {
    if !has_ffmpeg() || !has_encoder("libx264") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for layout in ["yuv420p", "yuv444p"] {
        let filter = format!("testsrc2=d=0.2:s=96x64:r=25,format={layout}");
        ffmpeg(&[
            "-f",
            "lavfi",
            "-i",
            &filter,
            "-c:v",
            "libx264",
            "-qp",
            "0",
            text(&path("plain.mp4")),
        ]);
        for (angle, rotation) in [
            ("90", Rotation::Counterclockwise),
            ("180", Rotation::Half),
            ("270", Rotation::Clockwise),
        ] {
            turn_copy(&path("plain.mp4"), &path("turned.mp4"), angle);
            let mut source = open(&path("turned.mp4")).unwrap();
            let quarter = angle != "180";
            let size = if quarter {
                Size::new(64, 96)
            } else {
                Size::new(96, 64)
            };
            assert_eq!(source.info().size, size.unwrap());
            // FFmpeg turns by itself when it converts to raw frames
            let truth = ffmpeg(&[
                "-i",
                text(&path("turned.mp4")),
                "-f",
                "rawvideo",
                "-pix_fmt",
                layout,
                "-",
            ]);
            let mut found: Vec<u8> = Vec::new();
            for frame in read_all(&mut source) {
                let FramePicture::Yuv(planes) = frame.picture else {
                    panic!("planes are expected");
                };
                for plane in planes.planes() {
                    let SamplePlane::U8(plane) = plane else {
                        panic!("8 bits are expected");
                    };
                    found.extend(plane.pixels());
                }
            }
            assert!(found == truth, "{layout} {angle}");
            // which way it is counted depends on the version of FFmpeg
            let opposite = match rotation {
                Rotation::Clockwise => Rotation::Counterclockwise,
                Rotation::Counterclockwise => Rotation::Clockwise,
                other => other,
            };
            assert!([rotation, opposite].contains(&source.info().rotation));
        }
    }
}

/// A copy with a display matrix, by the option of newer versions, or of older ones.
fn turn_copy(from: &Path, to: &Path, angle: &str) {
    let new = std::process::Command::new("ffmpeg")
        .args([
            "-nostdin",
            "-loglevel",
            "quiet",
            "-y",
            "-display_rotation",
            angle,
            "-i",
        ])
        .args([text(from), "-c", "copy", text(to)])
        .status()
        .unwrap();
    if !new.success() {
        ffmpeg(&[
            "-i",
            text(from),
            "-c",
            "copy",
            "-metadata:s:v:0",
            &format!("rotate={angle}"),
            text(to),
        ]);
    }
}
