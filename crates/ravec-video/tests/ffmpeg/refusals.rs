//! Files that are no clips, or more than is allowed.

use crate::scene::{ffmpeg, frames, has_ffmpeg, open, options, sink_format, text, write, yuv};
use ravec_raster::Size;
use ravec_video::{FfmpegSource, FrameSource, Rational, Subsampling, VideoError, VideoLimits};

#[test]
fn files_without_frames_are_named_for_what_they_are() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("empty.mkv"), "").unwrap();
    assert!(matches!(open(&path("empty.mkv")), Err(VideoError::Empty)));
    std::fs::write(path("text.mkv"), "no clip at all\n".repeat(100)).unwrap();
    let error = open(&path("text.mkv")).unwrap_err();
    assert!(
        matches!(
            error,
            VideoError::UnknownFormat | VideoError::Unsupported { .. }
        ),
        "{error}"
    );
    assert!(matches!(open(&path("absent.mkv")), Err(VideoError::Io(_))));
    ffmpeg(&[
        "-f",
        "lavfi",
        "-i",
        "sine=d=0.2",
        "-c:a",
        "flac",
        text(&path("sound.mkv")),
    ]);
    let message = open(&path("sound.mkv")).unwrap_err().to_string();
    assert_eq!(message, "the file has no video track (1 audio track)");
}

#[test]
fn lists_of_other_files_are_not_followed() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    ffmpeg(&[
        "-f",
        "lavfi",
        "-i",
        "testsrc=d=0.4:s=64x64",
        "-c:v",
        "mpeg2video",
        "-f",
        "mpegts",
        text(&path("a.ts")),
    ]);
    assert!(open(&path("a.ts")).is_ok());
    let ts = path("a.ts");
    let lists = [
        ("hls.m3u8", format!("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{}\n#EXT-X-ENDLIST\n", ts.display())),
        ("concat.ffconcat", format!("ffconcat version 1.0\nfile '{}'\n", ts.display())),
        ("text.txt", "plain text\n".repeat(50)),
        ("net.sdp", "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\n".to_owned()),
    ];
    for (name, content) in lists {
        std::fs::write(path(name), content).unwrap();
        let error = open(&path(name)).unwrap_err();
        assert!(
            matches!(
                error,
                VideoError::Unsupported { .. } | VideoError::UnknownFormat
            ),
            "{name}: {error}"
        );
    }
}

#[test]
fn limits_are_checked_before_frames_are_taken() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.mkv");
    let format = sink_format(
        Size::new(64, 48).unwrap(),
        yuv(Subsampling::S420, 8, false),
        Rational::new(1, 25).unwrap(),
    );
    write(
        &path,
        &format,
        &options("ffv1", true),
        &frames(&format, &[0, 1, 2, 3, 4]),
        9,
    )
    .unwrap();

    let mut limits = VideoLimits::default();
    limits.pictures.max_pixels = 64 * 48 - 1;
    let error = FfmpegSource::open(&path, "", &limits).unwrap_err();
    assert!(
        matches!(
            error,
            VideoError::TooManyPixels {
                width: 64,
                height: 48,
                ..
            }
        ),
        "{error}"
    );

    let limits = VideoLimits {
        max_frames: 3,
        ..VideoLimits::default()
    };
    let mut source = FfmpegSource::open(&path, "", &limits).unwrap();
    let mut given = 0;
    let error = loop {
        match source.next_frame() {
            Ok(Some(_)) => given += 1,
            Ok(None) => panic!("the limit is not seen"),
            Err(error) => break error,
        }
    };
    assert!(
        matches!(error, VideoError::TooManyFrames { limit: 3 }) && given <= 3,
        "{error}"
    );

    let mut limits = VideoLimits::default();
    limits.pictures.memory = ravec_memory::MemoryBudget::new(1000);
    let error = FfmpegSource::open(&path, "", &limits).unwrap_err();
    assert!(matches!(error, VideoError::OverBudget(_)), "{error}");
}

#[test]
fn the_wrong_size_and_no_frames_are_refused() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.mkv");
    let pixels = yuv(Subsampling::S420, 8, false);
    let clock = Rational::new(1, 25).unwrap();
    let (small, large) = (
        sink_format(Size::new(64, 48).unwrap(), pixels, clock),
        sink_format(Size::new(64, 50).unwrap(), pixels, clock),
    );
    let error = write(
        &path,
        &small,
        &options("ffv1", true),
        &frames(&large, &[0]),
        9,
    )
    .unwrap_err();
    assert!(
        matches!(error, VideoError::SizeChanged { frame: 0, .. }),
        "{error}"
    );
    // a codec that the container does not have is FFmpeg's own sentence
    let path = folder.path().join("out.webm");
    let error = write(
        &path,
        &small,
        &options("ffv1", true),
        &frames(&small, &[0, 1]),
        9,
    )
    .unwrap_err();
    let message = error.to_string();
    assert!(
        message.contains("WebM") || message.contains("webm"),
        "{message}"
    );
}
