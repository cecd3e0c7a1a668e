use super::*;
use crate::FrameSink as _;
use crate::ffmpeg::FfmpegSink;
use crate::{ColorInfo, EncodeOptions, PixelKind, SinkFormat, YuvFormat, YuvImage};
use ravec_raster::Size;

const FRAMES: u64 = 40;

fn frame(format: &SinkFormat, number: u64) -> Frame {
    let PixelKind::Yuv {
        format: planes,
        color,
    } = format.pixels
    else {
        panic!("planes are expected");
    };
    let sizes = planes.plane_sizes(format.size);
    let samples = sizes
        .iter()
        .map(|size| crate::SamplePlane::new(*size, 8, number as u16));
    Frame {
        picture: FramePicture::Yuv(YuvImage::new(planes, color, samples.collect()).unwrap()),
        time: FrameTime {
            start: number as i64,
            duration: 1,
        },
    }
}

/// A sink for large frames, which fill the pipes; `None` without FFmpeg, which the test says.
fn sink(path: &Path) -> Option<(SinkFormat, FfmpegSink)> {
    let format = SinkFormat {
        size: Size::new(640, 480).unwrap(),
        pixels: PixelKind::Yuv {
            format: YuvFormat::YUV420P8,
            color: ColorInfo::guess(480),
        },
        time_base: Rational::new(1, 25).unwrap(),
        rate: Rational::new(25, 1),
        pixel_aspect: Rational::ONE,
    };
    let options = EncodeOptions {
        codec: Some("ffv1".to_owned()),
        ..EncodeOptions::default()
    };
    match FfmpegSink::create(path, "mkv", &format, &options) {
        Ok(sink) => Some((format, sink)),
        Err(VideoError::FfmpegMissing { .. }) => {
            eprintln!("skipped: FFmpeg is not installed");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn a_decoder_that_is_killed_is_an_error_and_does_not_hang() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part");
    let Some((format, mut sink)) = sink(&path) else {
        return;
    };
    for number in 0..FRAMES {
        sink.write(&frame(&format, number)).unwrap();
    }
    Box::new(sink).finish().unwrap();

    let mut source = FfmpegSource::open(&path, "", &VideoLimits::default()).unwrap();
    assert!(source.next_frame().unwrap().is_some());
    source.run.as_mut().unwrap().process.kill();
    let error = loop {
        match source.next_frame() {
            Ok(Some(_)) => {}
            Ok(None) => panic!("the end is not the end of the clip"),
            Err(error) => break error,
        }
    };
    let message = error.to_string();
    assert!(message.contains("was stopped at frame"), "{message}");
    // the source can be used again
    source.seek(3).unwrap();
    let found = source.next_frame().unwrap().unwrap();
    assert!(found.picture == frame(&format, 3).picture);
    let start = rescale(found.time.start, source.info().time_base, format.time_base);
    assert_eq!(start, 3);
    let count = std::iter::from_fn(|| source.next_frame().unwrap()).count() as u64;
    assert_eq!(count, FRAMES - 4);
    assert_eq!(source.damage(), None);
}

#[test]
fn an_encoder_that_is_killed_is_an_error_and_does_not_hang() {
    let folder = tempfile::tempdir().unwrap();
    let Some((format, mut sink)) = sink(&folder.path().join("part")) else {
        return;
    };
    sink.write(&frame(&format, 0)).unwrap();
    sink.kill_child();
    // the pipe holds less than these frames
    let error = (1..FRAMES).find_map(|number| sink.write(&frame(&format, number)).err());
    let message = error.unwrap().to_string();
    assert!(message.starts_with("FFmpeg failed: "), "{message}");
    assert!(sink.write(&frame(&format, FRAMES)).is_err());
}
