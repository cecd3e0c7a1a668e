//! What is written is read again.

use crate::scene::{
    ffprobe, frames, has_encoder, has_ffmpeg, open, options, read_all, sink_format, text, write,
    yuv,
};
use ravec_raster::{AnyImage, Image, Size, Srgb, Srgba};
use ravec_video::{
    ClipWriter, ColorInfo, CreateOptions, EncodeOptions, Frame, FramePicture, FrameSource,
    FrameTime, Matrix, PixelKind, Range, Rational, SinkFormat, Siting, Subsampling, YuvFormat,
};

/// Uneven times in milliseconds.
const STARTS: [i64; 9] = [0, 40, 41, 100, 133, 200, 1000, 1001, 1040];

fn milliseconds() -> Rational {
    Rational::new(1, 1000).unwrap()
}

fn rgb(depth: u32, alpha: bool) -> PixelKind {
    PixelKind::Rgb { depth, alpha }
}

/// Writes frames without loss, and demands the same samples and times, as one part and as three.
fn assert_exact(codec: &str, extension: &str, pixels: PixelKind, time_base: Rational, step: i64) {
    let folder = tempfile::tempdir().unwrap();
    // odd sides where chroma has no say, and more than one block of every codec
    let size = match pixels {
        PixelKind::Yuv { format, .. } if format.subsampling != Subsampling::S444 => {
            Size::new(96, 68)
        }
        _ => Size::new(97, 67),
    };
    let format = sink_format(size.unwrap(), pixels, time_base);
    let starts = STARTS.map(|start| start * step);
    let truth = frames(&format, &starts);
    for chunk in [100, 4] {
        let path = folder.path().join(format!("a'b {chunk}.{extension}"));
        write(&path, &format, &options(codec, true), &truth, chunk)
            .unwrap_or_else(|error| panic!("{codec} {pixels:?}: {error}"));
        let mut source = open(&path).unwrap();
        let found = read_all(&mut source);
        assert_eq!(found.len(), truth.len(), "{codec} {pixels:?}");
        assert_eq!(source.damage(), None);
        let clock = source.info().time_base;
        for (number, (found, truth)) in found.iter().zip(&truth).enumerate() {
            let start = ravec_video::rescale(found.time.start, clock, time_base);
            let exact = ravec_video::rescale(start, time_base, clock) == found.time.start;
            assert!(
                exact && start == truth.time.start,
                "{codec}: frame {number} at {start}, {clock}"
            );
            assert_same(
                &found.picture,
                &truth.picture,
                &format!("{codec} {pixels:?} {number}"),
            );
        }
    }
}

/// The same samples; tags that the file does not have may differ.
fn assert_same(found: &FramePicture, truth: &FramePicture, name: &str) {
    match (found, truth) {
        (FramePicture::Yuv(found), FramePicture::Yuv(truth)) => {
            if name.starts_with("h264") && truth.format().subsampling == Subsampling::Gray {
                // the decoder of FFmpeg adds chroma, which is neutral
                assert!(found.luma() == truth.luma(), "{name}: samples differ");
                return;
            }
            assert_eq!(found.format(), truth.format(), "{name}");
            assert!(found.planes() == truth.planes(), "{name}: samples differ");
            assert_eq!(found.color().range, truth.color().range, "{name}");
        }
        (found, truth) => assert!(found == truth, "{name}: colors differ"),
    }
}

#[test]
fn ffv1_keeps_all_samples_and_times() {
    if !has_ffmpeg() {
        return;
    }
    for subsampling in [Subsampling::S420, Subsampling::S422, Subsampling::S444] {
        for depth in [8, 9, 10, 12, 14, 16] {
            assert_exact(
                "ffv1",
                "mkv",
                yuv(subsampling, depth, false),
                milliseconds(),
                1,
            );
        }
        for depth in [8, 10, 16] {
            assert_exact(
                "ffv1",
                "mkv",
                yuv(subsampling, depth, true),
                milliseconds(),
                1,
            );
        }
    }
    for depth in [8, 10, 12, 16] {
        assert_exact(
            "ffv1",
            "mkv",
            yuv(Subsampling::Gray, depth, false),
            milliseconds(),
            1,
        );
    }
    assert_exact(
        "ffv1",
        "mkv",
        yuv(Subsampling::Gray, 8, true),
        milliseconds(),
        1,
    );
    assert_exact(
        "ffv1",
        "mkv",
        yuv(Subsampling::S440, 8, false),
        milliseconds(),
        1,
    );
    assert_exact(
        "ffv1",
        "mkv",
        yuv(Subsampling::S411, 8, false),
        milliseconds(),
        1,
    );
    for (depth, alpha) in [(8, false), (8, true), (16, false), (16, true)] {
        assert_exact("ffv1", "mkv", rgb(depth, alpha), milliseconds(), 1);
    }
}

#[test]
fn other_codecs_are_lossless_on_request() {
    if !has_ffmpeg() {
        return;
    }
    let clock = Rational::new(1, 12800).unwrap();
    let film = Rational::new(1001, 30000).unwrap();
    for (encoder, codec, pixels) in [
        ("libx264", "h264", yuv(Subsampling::S420, 8, false)),
        ("libx264", "h264", yuv(Subsampling::S422, 10, false)),
        ("libx264", "h264", yuv(Subsampling::S444, 8, false)),
        ("libx264", "h264", yuv(Subsampling::Gray, 8, false)),
        ("libx264rgb", "h264", rgb(8, false)),
        ("libx265", "hevc", yuv(Subsampling::S420, 8, false)),
        ("libx265", "hevc", yuv(Subsampling::S444, 10, false)),
        ("libx265", "hevc", rgb(8, false)),
        ("libvpx-vp9", "vp9", yuv(Subsampling::S420, 8, false)),
        ("libvpx-vp9", "vp9", yuv(Subsampling::S444, 12, false)),
        ("libaom-av1", "av1", yuv(Subsampling::S420, 10, false)),
    ] {
        if !has_encoder(encoder) {
            continue;
        }
        assert_exact(codec, "mp4", pixels, clock, 7);
        assert_exact(codec, "mkv", pixels, milliseconds(), 1);
        assert_exact(codec, "nut", pixels, film, 3);
    }
    for (codec, pixels) in [
        ("ffvhuff", yuv(Subsampling::S422, 10, false)),
        ("utvideo", yuv(Subsampling::S420, 8, false)),
        ("utvideo", rgb(8, true)),
        ("png", rgb(16, false)),
    ] {
        assert_exact(codec, "mov", pixels, clock, 7);
    }
}

#[test]
fn what_cannot_be_lossless_is_refused_with_a_way_out() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let size = Size::new(64, 64).unwrap();
    let refuse = |codec: &str, pixels| {
        let format = sink_format(size, pixels, milliseconds());
        let path = folder.path().join("out.mkv");
        let error = write(
            &path,
            &format,
            &options(codec, true),
            &frames(&format, &[0]),
            9,
        )
        .unwrap_err();
        error.to_string()
    };
    for (codec, pixels) in [
        ("mpeg4", yuv(Subsampling::S420, 8, false)),
        ("prores", yuv(Subsampling::S422, 10, false)),
        ("h264", yuv(Subsampling::S420, 16, false)),
        ("h264", yuv(Subsampling::S420, 8, true)),
    ] {
        let message = refuse(codec, pixels);
        assert!(
            message.contains("cannot keep these samples exactly: choose the codec ffv1"),
            "{message}"
        );
    }
    assert!(refuse("nosuch", rgb(8, false)).starts_with("no codec is called `nosuch`: h264, hevc"));
}

/// A flat field of that color.
fn flat(size: Size, color: [u8; 3], count: i64) -> Vec<Frame> {
    let frame = |number| Frame {
        picture: FramePicture::Image(Image::new(size, Srgb(color)).into()),
        time: FrameTime {
            start: number,
            duration: 1,
        },
    };
    (0..count).map(frame).collect()
}

#[test]
fn lossy_codecs_keep_the_mean_color_of_a_flat_field_within_one_step() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let size = Size::new(128, 96).unwrap();
    for (encoder, codec, extension) in [
        ("libx264", "h264", "mkv"),
        ("libx265", "hevc", "mp4"),
        ("libvpx-vp9", "vp9", "webm"),
        ("libvpx", "vp8", "webm"),
        ("libsvtav1", "av1", "mkv"),
        ("prores_ks", "prores", "mov"),
        ("mjpeg", "mjpeg", "avi"),
        ("mpeg4", "mpeg4", "avi"),
        ("mpeg2video", "mpeg2video", "ts"),
    ] {
        if !has_encoder(encoder) {
            continue;
        }
        for color in [[200u8, 60, 30], [128, 128, 128], [20, 90, 160]] {
            let format = SinkFormat {
                rate: Rational::new(25, 1),
                ..sink_format(size, rgb(8, false), Rational::new(1, 25).unwrap())
            };
            let path = folder.path().join(format!("flat.{extension}"));
            write(
                &path,
                &format,
                &options(codec, false),
                &flat(size, color, 5),
                3,
            )
            .unwrap();
            let found = read_all(&mut open(&path).unwrap());
            assert_eq!(found.len(), 5, "{codec}");
            for (number, frame) in found.iter().enumerate() {
                let image: Image<Srgb<u8>> = frame.picture.to_image().convert();
                for (channel, truth) in color.iter().enumerate() {
                    let sum: f64 = image
                        .pixels()
                        .iter()
                        .map(|pixel| f64::from(pixel.0[channel]))
                        .sum();
                    let mean = sum / size.pixels() as f64;
                    // one step of luma or chroma in limited range is up to 2.1 steps of a color
                    let bound = 2.1;
                    assert!(
                        (mean - f64::from(*truth)).abs() <= bound,
                        "{codec} {color:?} {number}: {mean}"
                    );
                }
            }
        }
    }
}

#[test]
fn tags_and_the_shape_of_pixels_come_back() {
    if !has_ffmpeg() || !has_encoder("libx264") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (matrix, range, siting, primaries, transfer) in [
        (Matrix::Bt601, Range::Limited, Siting::LEFT, 6, 6),
        (Matrix::Bt709, Range::Full, Siting::CENTER, 1, 13),
        (Matrix::Bt2020, Range::Limited, Siting::TOP_LEFT, 9, 16),
    ] {
        let color = ColorInfo {
            matrix,
            range,
            siting,
            primaries,
            transfer,
            tagged: true,
        };
        let pixels = PixelKind::Yuv {
            format: YuvFormat::YUV420P8,
            color,
        };
        let size = Size::new(64, 48).unwrap();
        let format = SinkFormat {
            pixel_aspect: Rational::new(4, 3).unwrap(),
            ..sink_format(size, pixels, milliseconds())
        };
        for extension in ["mkv", "mp4"] {
            let path = folder.path().join(format!("tags.{extension}"));
            write(
                &path,
                &format,
                &options("h264", true),
                &frames(&format, &[0, 40, 80]),
                2,
            )
            .unwrap();
            let source = open(&path).unwrap();
            assert_eq!(source.info().pixels, pixels, "{extension}");
            assert_eq!(source.info().pixel_aspect, Rational::new(4, 3).unwrap());
            assert_eq!(source.info().codec, "h264");
        }
    }
}

#[test]
fn webm_has_alpha() {
    if !has_ffmpeg() || !has_encoder("libvpx-vp9") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let pixels = yuv(Subsampling::S420, 8, true);
    let format = sink_format(Size::new(96, 68).unwrap(), pixels, milliseconds());
    let path = folder.path().join("alpha.webm");
    let truth = frames(&format, &STARTS);
    write(&path, &format, &options("vp9", true), &truth, 4).unwrap();
    let found = read_all(&mut open(&path).unwrap());
    assert_eq!(found.len(), truth.len());
    for (found, truth) in found.iter().zip(&truth) {
        assert_eq!(found.time.start, truth.time.start);
        assert_same(&found.picture, &truth.picture, "vp9 with alpha");
    }
}

#[test]
fn the_usual_codecs_of_colors_with_alpha_keep_it() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let size = Size::new(96, 68).unwrap();
    let format = SinkFormat {
        rate: Rational::new(25, 1),
        ..sink_format(size, rgb(8, true), Rational::new(1, 25).unwrap())
    };
    // a ramp of alpha
    let image: Image<Srgba<u8>> =
        Image::from_fn(size, |col, _| Srgba([200, 60, 30, 2 * col as u8]));
    for (encoder, codec, extension) in [
        ("prores_ks", "prores", "mov"),
        ("libvpx-vp9", "vp9", "webm"),
        ("ffv1", "ffv1", "mkv"),
    ] {
        if !has_encoder(encoder) {
            continue;
        }
        let path = folder.path().join(format!("alpha.{extension}"));
        let options = CreateOptions {
            encode: EncodeOptions::default(),
            ..CreateOptions::default()
        };
        let mut writer = ClipWriter::create(&path, &format, &options).unwrap();
        for number in 0..3 {
            let frame = Frame {
                picture: FramePicture::Image(AnyImage::from(image.clone())),
                time: FrameTime {
                    start: number,
                    duration: 1,
                },
            };
            writer.write(&frame).unwrap();
        }
        writer.finish().unwrap();
        let mut source = open(&path).unwrap();
        assert_eq!(source.info().codec, codec);
        let found = read_all(&mut source);
        assert_eq!(found.len(), 3, "{codec}");
        for frame in &found {
            let found: Image<Srgba<u8>> = frame.picture.to_image().convert();
            for col in 0..size.width() {
                let (found, truth) = (found[(col, 30)].0[3], image[(col, 30)].0[3]);
                assert!(
                    found.abs_diff(truth) <= 4,
                    "{codec}, column {col}: {found}, not {truth}"
                );
            }
        }
    }
}

#[test]
fn equal_frames_make_equal_bytes() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let format = sink_format(
        Size::new(192, 160).unwrap(),
        yuv(Subsampling::S420, 8, false),
        milliseconds(),
    );
    let truth = frames(&format, &STARTS);
    for (encoder, codec, extension) in [
        ("libx264", "h264", "mp4"),
        ("libx265", "hevc", "mkv"),
        ("libvpx-vp9", "vp9", "webm"),
        ("libsvtav1", "av1", "mp4"),
        ("ffv1", "ffv1", "mkv"),
    ] {
        if !has_encoder(encoder) {
            continue;
        }
        let path = folder.path().join(format!("out.{extension}"));
        let bytes = [0, 1].map(|_| {
            write(&path, &format, &options(codec, codec == "ffv1"), &truth, 5).unwrap();
            std::fs::read(&path).unwrap()
        });
        assert!(bytes[0] == bytes[1], "{codec}");
    }
}

#[test]
fn containers_have_usual_codecs_and_even_rates() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let rate = Rational::new(30000, 1001).unwrap();
    let format = SinkFormat {
        rate: Some(rate),
        ..sink_format(
            Size::new(128, 96).unwrap(),
            yuv(Subsampling::S420, 8, false),
            rate.recip(),
        )
    };
    let truth = frames(&format, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
    for (extension, encoder, codec) in [
        ("mkv", "libx264", "h264"),
        ("mov", "libx264", "h264"),
        ("webm", "libvpx-vp9", "vp9"),
        ("avi", "mpeg4", "mpeg4"),
        ("ts", "libx264", "h264"),
        ("mpg", "mpeg2video", "mpeg2video"),
        ("ogv", "libtheora", "theora"),
    ] {
        if !has_encoder(encoder) {
            continue;
        }
        let path = folder.path().join(format!("usual.{extension}"));
        write(&path, &format, &EncodeOptions::default(), &truth, 6).unwrap();
        let mut source = open(&path).unwrap();
        assert_eq!(source.info().codec, codec);
        let clock = source.info().time_base;
        let found = read_all(&mut source);
        assert_eq!(found.len(), truth.len(), "{extension}");
        for (number, frame) in found.iter().enumerate() {
            let seconds = frame.time.start as f64 * clock.to_f64();
            let exact = number as f64 * 1001.0 / 30000.0;
            assert!(
                (seconds - exact).abs() <= clock.to_f64(),
                "{extension} {number}: {seconds}"
            );
        }
        let rates = ffprobe(&[
            "-select_streams",
            "v",
            "-show_entries",
            "stream=r_frame_rate",
            "-of",
            "csv=p=0",
            text(&path),
        ]);
        assert_eq!(
            rates.first().map(String::as_str),
            Some("30000/1001"),
            "{extension}"
        );
    }
}
