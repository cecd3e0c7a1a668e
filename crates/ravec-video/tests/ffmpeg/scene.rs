//! Frames with known samples, and the programs that the tests call by themselves.

use ravec_raster::{AnyImage, Image, Size, Srgb, Srgba};
use ravec_video::{
    ColorInfo, EncodeOptions, FfmpegSink, FfmpegSource, Frame, FramePicture, FrameSink,
    FrameSource, FrameTime, PixelKind, Rational, SamplePlane, SinkFormat, VideoError, VideoLimits,
    YuvFormat, YuvImage, assemble,
};
use std::path::{Path, PathBuf};
use std::process::Command;

/// True if FFmpeg is installed; else the test says that it skips.
pub fn has_ffmpeg() -> bool {
    let found = ["ffmpeg", "ffprobe"].iter().all(|name| {
        Command::new(name)
            .arg("-version")
            .output()
            .is_ok_and(|output| output.status.success())
    });
    if !found {
        eprintln!("skipped: FFmpeg is not installed");
    }
    found
}

/// True if this FFmpeg has the encoder; else the test says that it skips this part.
pub fn has_encoder(name: &str) -> bool {
    let output = Command::new("ffmpeg")
        .args(["-hide_banner", "-encoders"])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let found = text.split_whitespace().any(|word| word == name);
    if !found {
        eprintln!("skipped in part: this FFmpeg has no encoder {name}");
    }
    found
}

/// Runs `ffmpeg`, which must succeed.
pub fn ffmpeg(arguments: &[&str]) -> Vec<u8> {
    let output = Command::new("ffmpeg")
        .args(["-nostdin", "-hide_banner", "-loglevel", "error", "-y"])
        .args(arguments)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    output.stdout
}

/// The answer of `ffprobe` as lines.
pub fn ffprobe(arguments: &[&str]) -> Vec<String> {
    let output = Command::new("ffprobe")
        .args(["-loglevel", "error"])
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{arguments:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines()
        .map(|line| line.trim_end_matches(',').to_owned())
        .filter(|line| !line.is_empty())
        .collect()
}

pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A number that looks random, from a place, a time and a plane.
fn noise(col: usize, row: usize, frame: usize, plane: usize) -> u32 {
    let mut value = (col * 7919 + row * 104_729 + frame * 1_299_709 + plane * 15_485_863) as u32;
    value ^= value >> 15;
    value = value.wrapping_mul(0x2C1B_3C6D);
    value ^ value >> 12
}

/// A moving ramp with noise, so that no sample is like its neighbor.
fn sample(col: usize, row: usize, frame: usize, plane: usize, depth: u32) -> u16 {
    let ramp = (3 * col + 5 * row + 11 * frame) as u32 * (1 << (depth - 8)) / 4;
    ((ramp + noise(col, row, frame, plane) % (1 << (depth - 3))) % (1 << depth)) as u16
}

/// A frame of any samples.
pub fn picture(size: Size, pixels: PixelKind, frame: usize) -> FramePicture {
    match pixels {
        PixelKind::Yuv { format, color } => {
            let planes = format
                .plane_sizes(size)
                .into_iter()
                .enumerate()
                .map(|(plane, size)| {
                    let at = |col, row| sample(col, row, frame, plane, format.depth);
                    if format.depth > 8 {
                        SamplePlane::U16(Image::from_fn(size, at))
                    } else {
                        SamplePlane::U8(Image::from_fn(size, |col, row| at(col, row) as u8))
                    }
                });
            FramePicture::Yuv(YuvImage::new(format, color, planes.collect()).unwrap())
        }
        PixelKind::Rgb { depth, alpha } => {
            let at = |col, row, plane| sample(col, row, frame, plane, depth);
            let byte = |col, row, plane| at(col, row, plane) as u8;
            FramePicture::Image(match (depth, alpha) {
                (8, false) => {
                    Image::from_fn(size, |x, y| Srgb([0, 1, 2].map(|c| byte(x, y, c)))).into()
                }
                (8, true) => {
                    Image::from_fn(size, |x, y| Srgba([0, 1, 2, 3].map(|c| byte(x, y, c)))).into()
                }
                (16, false) => {
                    Image::from_fn(size, |x, y| Srgb([0, 1, 2].map(|c| at(x, y, c)))).into()
                }
                (_, _) => AnyImage::from(Image::from_fn(size, |x, y| {
                    Srgba([0, 1, 2, 3].map(|c| at(x, y, c)))
                })),
            })
        }
    }
}

pub fn yuv(subsampling: ravec_video::Subsampling, depth: u32, alpha: bool) -> PixelKind {
    let format = YuvFormat {
        subsampling,
        depth,
        alpha,
    };
    PixelKind::Yuv {
        format,
        color: ColorInfo::guess(48),
    }
}

pub fn sink_format(size: Size, pixels: PixelKind, time_base: Rational) -> SinkFormat {
    SinkFormat {
        size,
        pixels,
        time_base,
        rate: None,
        pixel_aspect: Rational::ONE,
    }
}

/// Frames at uneven times.
pub fn frames(format: &SinkFormat, starts: &[i64]) -> Vec<Frame> {
    let frame = |(number, start): (usize, &i64)| Frame {
        picture: picture(format.size, format.pixels, number),
        time: FrameTime {
            start: *start,
            duration: starts
                .get(number + 1)
                .map_or(1, |next| (next - start) as u64),
        },
    };
    starts.iter().enumerate().map(frame).collect()
}

/// Encodes frames in parts of `chunk` frames and joins them.
pub fn write(
    output: &Path,
    format: &SinkFormat,
    options: &EncodeOptions,
    frames: &[Frame],
    chunk: usize,
) -> Result<(), VideoError> {
    let extension = output.extension().unwrap().to_str().unwrap();
    let mut parts: Vec<PathBuf> = Vec::new();
    for (number, chunk) in frames.chunks(chunk).enumerate() {
        let part = output.with_extension(format!("part-{number}"));
        let mut sink = Box::new(FfmpegSink::create(&part, extension, format, options)?);
        for frame in chunk {
            sink.write(frame)?;
        }
        sink.finish()?;
        parts.push(part);
    }
    let warnings = assemble(&parts, None, output, extension)?;
    assert_eq!(warnings, Vec::<String>::new());
    Ok(())
}

pub fn open(path: &Path) -> Result<FfmpegSource, VideoError> {
    FfmpegSource::open(path, "this test", &VideoLimits::default())
}

pub fn read_all(source: &mut impl FrameSource) -> Vec<Frame> {
    std::iter::from_fn(|| source.next_frame().unwrap()).collect()
}

pub fn options(codec: &str, lossless: bool) -> EncodeOptions {
    EncodeOptions {
        codec: Some(codec.to_owned()),
        quality: None,
        lossless,
    }
}

/// The folder of clips for development, if there is one.
pub fn clips() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let data = std::env::var_os("RAVEC_DATA").map_or(root, PathBuf::from);
    let Ok(entries) = std::fs::read_dir(data.join("video")) else {
        eprintln!("skipped: there are no clips in {}", data.display());
        return Vec::new();
    };
    let extensions = ["avi", "mkv", "mp4"].map(|name| Some(std::ffi::OsString::from(name)));
    let mut clips: Vec<PathBuf> = entries
        .map(|entry| entry.unwrap().path())
        .filter(|path| extensions.contains(&path.extension().map(ToOwned::to_owned)))
        .collect();
    clips.sort();
    clips
}
