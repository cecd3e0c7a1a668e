//! Procedural clips and shorthand for the tests.

#![allow(dead_code, reason = "each test uses its part")]

use ravec_raster::{AnyImage, Image, Sample, Size, Srgb, Srgba};
use ravec_video::{
    Clip, ClipWriter, CreateOptions, Frame, FramePicture, FrameSource as _, FrameTime, OpenOptions,
    PixelKind, Rational, SinkFormat, VideoError,
};
use std::path::Path;

/// A picture that differs from frame to frame.
pub fn picture(size: Size, at: u64) -> Image<Srgb<u8>> {
    Image::from_fn(size, |col, row| {
        let value = |step: usize| ((col * step + row * 7 + at as usize * 13) % 256) as u8;
        Srgb([value(5), value(11), value(3)])
    })
}

/// The same picture with alpha in sixteen bits.
pub fn deep_picture(size: Size, at: u64) -> Image<Srgba<u16>> {
    Image::from_fn(size, |col, row| {
        let value = |step: usize| ((col * step + row * 701 + at as usize * 1301) % 65536) as u16;
        Srgba([value(509), value(1103), value(307), value(2003)])
    })
}

pub fn frame(image: impl Into<AnyImage>, at: u64) -> Frame {
    Frame {
        picture: FramePicture::Image(image.into()),
        time: FrameTime {
            start: at as i64,
            duration: 1,
        },
    }
}

/// The format of frames that come from colors, 25 a second.
pub fn colors<T: Sample>(size: Size, alpha: bool) -> SinkFormat {
    let rate = Rational::new(25, 1).unwrap();
    SinkFormat {
        size,
        pixels: PixelKind::Rgb {
            depth: 8 * std::mem::size_of::<T>() as u32,
            alpha,
        },
        time_base: rate.recip(),
        rate: Some(rate),
        pixel_aspect: Rational::ONE,
    }
}

pub fn write(
    path: &Path,
    format: &SinkFormat,
    options: &CreateOptions,
    frames: impl IntoIterator<Item = Frame>,
) -> Result<(), VideoError> {
    let mut writer = ClipWriter::create(path, format, options)?;
    for frame in frames {
        writer.write(&frame)?;
    }
    writer.finish()?;
    Ok(())
}

pub fn open(path: &Path) -> Result<Clip, VideoError> {
    Clip::open(path, &OpenOptions::default())
}

/// All frames of a clip.
pub fn read(path: &Path) -> Vec<Frame> {
    let mut clip = open(path).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = clip.next_frame().unwrap() {
        frames.push(frame);
    }
    frames
}

/// Reads until the end or an error, whatever the file is.
pub fn read_anything(path: &Path) -> Result<u64, VideoError> {
    let mut clip = open(path)?;
    let mut frames = 0;
    while clip.next_frame()?.is_some() {
        frames += 1;
    }
    Ok(frames)
}
