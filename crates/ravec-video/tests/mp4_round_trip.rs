//! MP4 files that are written and read again: colors, stamps, sizes, chunks.
#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]
#![cfg(feature = "h264")]

use proptest::prelude::*;
use ravec_progress::Progress;
use ravec_raster::{Image, Size};
use ravec_video::mp4::{CopiedTracks, Mp4Source, Mp4Writer, concatenate};
use ravec_video::{
    ColorInfo, EncodeOptions, Frame, FramePicture, FrameSink as _, FrameSource as _, FrameTime,
    Matrix, PixelKind, Range, Rational, SamplePlane, SinkFormat, Siting, VideoError, VideoLimits,
    YuvFormat, YuvImage,
};
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

fn format(width: usize, height: usize, color: ColorInfo) -> SinkFormat {
    SinkFormat {
        size: Size::new(width, height).unwrap(),
        pixels: PixelKind::Yuv {
            format: YuvFormat::YUV420P8,
            color,
        },
        time_base: Rational::new(1, 600).unwrap(),
        rate: Rational::new(25, 1),
        pixel_aspect: Rational::ONE,
    }
}

fn tagged(matrix: Matrix, range: Range) -> ColorInfo {
    ColorInfo {
        matrix,
        range,
        tagged: true,
        ..ColorInfo::guess(48)
    }
}

/// A frame from functions of column and row.
fn frame(
    format: &SinkFormat,
    start: i64,
    luma: impl Fn(usize, usize) -> u8,
    chroma: impl Fn(usize, usize) -> [u8; 2],
) -> Frame {
    let color = format.yuv_color();
    let sizes = YuvFormat::YUV420P8.plane_sizes(format.size);
    let planes = vec![
        SamplePlane::U8(Image::from_fn(sizes[0], &luma)),
        SamplePlane::U8(Image::from_fn(sizes[1], |col, row| chroma(col, row)[0])),
        SamplePlane::U8(Image::from_fn(sizes[1], |col, row| chroma(col, row)[1])),
    ];
    Frame {
        picture: FramePicture::Yuv(YuvImage::new(YuvFormat::YUV420P8, color, planes).unwrap()),
        time: FrameTime {
            start,
            duration: 24,
        },
    }
}

/// A gradient that moves, with a disc on it.
fn moving(format: &SinkFormat, number: usize, start: i64) -> Frame {
    let (width, height) = (format.size.width(), format.size.height());
    frame(
        format,
        start,
        |col, row| {
            let (x, y) = (
                col as f64 - (number * 2 % width) as f64,
                row as f64 - height as f64 / 2.0,
            );
            let disc = if x.hypot(y) < height as f64 / 5.0 {
                60
            } else {
                0
            };
            (40 + (col * 2 + row + number * 3) % 130 + disc) as u8
        },
        |col, row| [(100 + (col + number) % 50) as u8, (110 + row % 40) as u8],
    )
}

fn written(format: &SinkFormat, options: &EncodeOptions, frames: &[Frame]) -> Vec<u8> {
    let mut writer = Mp4Writer::new(Cursor::new(Vec::new()), format, options).unwrap();
    for frame in frames {
        writer.write(frame).unwrap();
    }
    writer.complete().unwrap().into_inner()
}

fn read(bytes: &[u8]) -> (Mp4Source, Vec<Frame>) {
    let mut source = Mp4Source::open(Cursor::new(bytes.to_vec()), &VideoLimits::default()).unwrap();
    let frames = std::iter::from_fn(|| source.next_frame().unwrap()).collect();
    assert_eq!(source.damage(), None);
    (source, frames)
}

fn planes(frame: &Frame) -> Vec<&Image<u8>> {
    let FramePicture::Yuv(picture) = &frame.picture else {
        panic!("planes");
    };
    picture.planes().iter().map(bytes).collect()
}

fn bytes(plane: &SamplePlane) -> &Image<u8> {
    match plane {
        SamplePlane::U8(plane) => plane,
        SamplePlane::U16(_) => panic!("8 bits"),
    }
}

fn psnr(found: &Frame, wanted: &Frame) -> f64 {
    let (found, wanted) = (planes(found)[0], planes(wanted)[0]);
    let squares = found.pixels().iter().zip(wanted.pixels());
    let sum: f64 = squares
        .map(|(&a, &b)| f64::from(i32::from(a) - i32::from(b)).powi(2))
        .sum();
    10.0 * (255.0f64.powi(2) / (sum / found.pixels().len() as f64)).log10()
}

#[test]
fn the_mean_of_a_flat_field_stays_within_one_step() {
    for matrix in [Matrix::Bt601, Matrix::Bt709, Matrix::Bt2020] {
        for range in [Range::Limited, Range::Full] {
            for code in [
                [16, 128, 128],
                [235, 128, 128],
                [81, 90, 240],
                [145, 54, 34],
                [41, 240, 110],
                [120, 117, 139],
            ] {
                let format = format(64, 48, tagged(matrix, range));
                let flat = |start| frame(&format, start, |_, _| code[0], |_, _| [code[1], code[2]]);
                let frames: Vec<Frame> = (0..5).map(|number| flat(number * 24)).collect();
                let (source, found) = read(&written(&format, &EncodeOptions::default(), &frames));
                assert_eq!(source.info().pixels, format.pixels);
                for frame in &found {
                    for (plane, code) in planes(frame).iter().zip(code) {
                        let sum: u64 = plane.pixels().iter().map(|&sample| u64::from(sample)).sum();
                        let mean = sum as f64 / plane.pixels().len() as f64;
                        assert!(
                            (mean - f64::from(code)).abs() <= 1.0,
                            "{matrix:?} {range:?} {code}: {mean}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn a_moving_gradient_keeps_its_samples() {
    let format = format(160, 120, tagged(Matrix::Bt709, Range::Limited));
    let frames: Vec<Frame> = (0..30)
        .map(|number| moving(&format, number, 24 * number as i64))
        .collect();
    let worst = |quality| {
        let options = EncodeOptions {
            quality,
            ..EncodeOptions::default()
        };
        let bytes = written(&format, &options, &frames);
        let (_, found) = read(&bytes);
        assert_eq!(found.len(), frames.len());
        let worst = found
            .iter()
            .zip(&frames)
            .map(|(found, wanted)| psnr(found, wanted))
            .fold(f64::MAX, f64::min);
        (worst, bytes.len())
    };
    let (usual, usual_bytes) = worst(None);
    // a quantizer of 22 has steps of 8: errors of at most about 4, and 40 dB with margin
    assert!(usual >= 40.0, "{usual}");
    let (best, best_bytes) = worst(Some(100));
    assert!(best >= 46.0 && best > usual, "{best}");
    let (poor, poor_bytes) = worst(Some(20));
    assert!(poor < usual, "{poor}");
    assert!(poor_bytes < usual_bytes && usual_bytes < best_bytes);
}

#[test]
fn all_sizes_come_back() {
    for (width, height) in [
        (1, 1),
        (2, 2),
        (15, 17),
        (16, 16),
        (17, 33),
        (63, 48),
        (64, 47),
        (61, 45),
        (130, 2),
    ] {
        let format = format(width, height, tagged(Matrix::Bt709, Range::Limited));
        let frames: Vec<Frame> = (0..3)
            .map(|number| moving(&format, number, 24 * number as i64))
            .collect();
        let (source, found) = read(&written(&format, &EncodeOptions::default(), &frames));
        assert_eq!(source.info().size, format.size);
        for (found, wanted) in found.iter().zip(&frames) {
            assert_eq!(found.picture.size(), format.size);
            assert!(
                psnr(found, wanted) > 34.0,
                "{width} x {height}: {}",
                psnr(found, wanted)
            );
        }
        assert_eq!(found.len(), 3);
    }
}

#[test]
fn tags_and_aspect_come_back() {
    for siting in [Siting::LEFT, Siting::CENTER, Siting::TOP_LEFT] {
        let color = ColorInfo {
            siting,
            primaries: 9,
            transfer: 14,
            ..tagged(Matrix::Bt2020, Range::Full)
        };
        let format = SinkFormat {
            pixel_aspect: Rational::new(16, 11).unwrap(),
            ..format(64, 48, color)
        };
        let (source, _) = read(&written(
            &format,
            &EncodeOptions::default(),
            &[moving(&format, 0, 0)],
        ));
        assert_eq!(source.info().pixels, format.pixels);
        assert_eq!(source.info().pixel_aspect, format.pixel_aspect);
    }
}

#[test]
fn key_frames_come_every_two_seconds() {
    let format = format(32, 32, tagged(Matrix::Bt709, Range::Limited));
    let frames: Vec<Frame> = (0..120)
        .map(|number| moving(&format, number, 24 * number as i64))
        .collect();
    let bytes = written(&format, &EncodeOptions::default(), &frames);
    let at = bytes.windows(4).position(|four| four == b"stss").unwrap();
    let word = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    let syncs: Vec<u32> = (0..word(at + 8))
        .map(|number| word(at + 12 + 4 * number as usize))
        .collect();
    assert_eq!(syncs, [1, 51, 101]);
}

#[test]
fn the_same_frames_give_the_same_bytes() {
    let format = format(96, 80, tagged(Matrix::Bt709, Range::Limited));
    let frames: Vec<Frame> = (0..20)
        .map(|number| moving(&format, number, 24 * number as i64))
        .collect();
    let bytes = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| written(&format, &EncodeOptions::default(), &frames))
    };
    assert_eq!(bytes(1), bytes(4));
}

#[test]
fn what_cannot_be_written_is_refused() {
    let refused = |format: &SinkFormat, options: &EncodeOptions| match Mp4Writer::new(
        Cursor::new(Vec::new()),
        format,
        options,
    ) {
        Err(VideoError::Options(message)) => message,
        other => panic!("{:?}", other.err()),
    };
    let small = format(64, 48, ColorInfo::guess(48));
    let options = EncodeOptions::default();
    assert!(
        refused(
            &small,
            &EncodeOptions {
                lossless: true,
                ..options.clone()
            }
        )
        .contains("Y4M")
    );
    let hevc = EncodeOptions {
        codec: Some("hevc".to_owned()),
        ..options.clone()
    };
    assert!(refused(&small, &hevc).contains("FFmpeg"));
    assert!(
        refused(
            &small,
            &EncodeOptions {
                quality: Some(101),
                ..options.clone()
            }
        )
        .contains("100")
    );
    let large = format(4000, 48, ColorInfo::guess(48));
    assert!(refused(&large, &options).contains("3840"));

    let mut writer = Mp4Writer::new(Cursor::new(Vec::new()), &small, &options).unwrap();
    assert!(matches!(
        writer.write(&moving(&format(32, 48, ColorInfo::guess(48)), 0, 0)),
        Err(VideoError::SizeChanged { frame: 0, .. })
    ));
    writer.write(&moving(&small, 0, 100)).unwrap();
    assert!(matches!(
        writer.write(&moving(&small, 0, 99)),
        Err(VideoError::Options(_))
    ));
    let empty = Mp4Writer::new(Cursor::new(Vec::new()), &small, &options).unwrap();
    assert!(matches!(empty.complete(), Err(VideoError::Options(_))));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn uneven_stamps_come_back_to_the_tick(
        first in prop_oneof![Just(0i64), 0..1_000_000i64],
        gaps in prop::collection::vec(0..5000i64, 1..12),
        num in 1..4u32,
        den in 1..100_000u32,
    ) {
        let base = Rational::new(num, den).unwrap();
        let format = SinkFormat { time_base: base, ..format(16, 16, tagged(Matrix::Bt709, Range::Limited)) };
        let mut start = first;
        let frames: Vec<Frame> = gaps.iter().enumerate().map(|(number, gap)| {
            let frame = moving(&format, number, start);
            start += gap;
            frame
        }).collect();
        let (source, found) = read(&written(&format, &EncodeOptions::default(), &frames));
        prop_assert_eq!(source.info().time_base, Rational::new(1, den).unwrap());
        let ticks = |frames: &[Frame], scale: i64| -> Vec<i64> {
            frames.iter().map(|frame| frame.time.start * scale).collect()
        };
        prop_assert_eq!(ticks(&found, 1), ticks(&frames, i64::from(num)));
        prop_assert_eq!(found.last().unwrap().time.duration, 24 * u64::from(num));
    }
}

/// Chunks of a clip in files of a folder.
fn chunks(folder: &Path, format: &SinkFormat, frames: &[Frame], length: usize) -> Vec<PathBuf> {
    frames
        .chunks(length)
        .enumerate()
        .map(|(number, frames)| {
            let path = folder.join(format!("{number}.mp4"));
            fs::write(&path, written(format, &EncodeOptions::default(), frames)).unwrap();
            path
        })
        .collect()
}

fn join(chunks: &[PathBuf], copied: Option<CopiedTracks>) -> Result<Vec<u8>, VideoError> {
    let output = Cursor::new(Vec::new());
    let limits = VideoLimits::default();
    concatenate(chunks, output, copied, &limits, &Progress::none()).map(Cursor::into_inner)
}

#[test]
fn chunks_are_joined_without_a_change() {
    let format = format(64, 48, tagged(Matrix::Bt709, Range::Limited));
    let starts = |number: usize| (number * 24 + number / 3) as i64 + 50;
    let frames: Vec<Frame> = (0..47)
        .map(|number| moving(&format, number, starts(number)))
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let files = chunks(folder.path(), &format, &frames, 10);
    let joined = join(&files, None).unwrap();
    assert_eq!(joined, join(&files, None).unwrap());
    let (_, found) = read(&joined);
    let parts: Vec<Frame> = files
        .iter()
        .flat_map(|file| read(&fs::read(file).unwrap()).1)
        .collect();
    assert_eq!(found.len(), frames.len());
    for ((found, part), frame) in found.iter().zip(&parts).zip(&frames) {
        assert_eq!(found.picture, part.picture);
        assert_eq!(found.time.start, frame.time.start);
    }
    let alone = chunks(folder.path(), &format, &frames, 1000);
    assert_eq!(join(&alone, None).unwrap(), fs::read(&alone[0]).unwrap());
}

#[test]
fn chunks_that_do_not_fit_are_refused() {
    let format = format(64, 48, tagged(Matrix::Bt709, Range::Limited));
    let frames: Vec<Frame> = (0..6)
        .map(|number| moving(&format, number, number as i64))
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let files = chunks(folder.path(), &format, &frames, 3);
    let other = SinkFormat {
        pixel_aspect: Rational::new(4, 3).unwrap(),
        ..format.clone()
    };
    fs::write(
        &files[1],
        written(&other, &EncodeOptions::default(), &frames),
    )
    .unwrap();
    assert!(matches!(join(&files, None), Err(VideoError::Options(_))));
    let whole = fs::read(&files[0]).unwrap();
    for end in [0, 10, 40, whole.len() / 2, whole.len() - 1] {
        fs::write(&files[1], &whole[..end]).unwrap();
        let error = join(&files, None).unwrap_err();
        assert!(matches!(error, VideoError::Damaged { .. }), "{error}");
        assert!(error.to_string().contains("1.mp4"), "{error}");
    }
    assert!(matches!(join(&[], None), Err(VideoError::Options(_))));
    let progress = Progress::none();
    progress.cancel();
    let result = concatenate(
        &files[..1],
        Cursor::new(Vec::new()),
        None,
        &VideoLimits::default(),
        &progress,
    );
    assert!(matches!(result, Err(VideoError::Cancelled(_))));
}
