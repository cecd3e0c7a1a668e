//! Animated PNG.

use super::canvas::{Canvas, Dispose, Patch};
use crate::error::VideoError;
use crate::frame::{Frame, FramePicture};
use crate::info::{ClipInfo, Container, PixelKind, Rotation};
use crate::limits::VideoLimits;
use crate::sink::{FrameSink, SinkFormat};
use crate::source::{Damage, FrameSource};
use crate::time::{FrameTime, Rational};
use png::{
    BitDepth, BlendOp, ColorType, Decoder, DecodingError, DisposeOp, Encoder, Reader,
    Transformations, Writer,
};
use ravec_memory::Reservation;
use ravec_raster::{AnyImage, Image, Sample, Size, Srgb, Srgba};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom, Write};

/// Ticks a second that stamps are given in: the format allows any fraction.
const TICKS: u32 = 1_000_000_000;

/// Bytes in which the chunk of an animation must begin.
const MAX_PREFIX: u64 = 1 << 20;

/// True if a PNG file is animated. Reads the chunks before the first pixels.
///
/// # Errors
/// An error of the file system.
pub fn is_animated(file: &File) -> std::io::Result<bool> {
    let mut file = file;
    file.seek(SeekFrom::Start(0))?;
    let mut start = Vec::new();
    file.take(MAX_PREFIX).read_to_end(&mut start)?;
    let mut rest = start.get(8..).unwrap_or_default();
    while let Some((length, name)) = rest.get(..4).zip(rest.get(4..8)) {
        match name {
            b"acTL" => return Ok(true),
            b"IDAT" | b"IEND" => return Ok(false),
            _ => {}
        }
        let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]);
        rest = rest.get(12 + length as usize..).unwrap_or_default();
    }
    Ok(false)
}

/// The canvas in the samples of the file.
enum AnyCanvas {
    U8(Canvas<u8>),
    U16(Canvas<u16>),
}

/// Frames of an animated PNG file.
pub struct ApngSource {
    reader: Reader<BufReader<File>>,
    file: File,
    info: ClipInfo,
    limits: VideoLimits,
    canvas: AnyCanvas,
    buffer: Vec<u8>,
    next: u64,
    time: i64,
    ended: bool,
    damage: Option<Damage>,
    _memory: Reservation,
}

fn reader(file: &File, limits: &VideoLimits) -> Result<Reader<BufReader<File>>, VideoError> {
    let mut file = file.try_clone()?;
    file.seek(SeekFrom::Start(0))?;
    let mut decoder = Decoder::new_with_limits(
        BufReader::new(file),
        png::Limits {
            bytes: usize::try_from(limits.pictures.memory.limit()).unwrap_or(usize::MAX),
        },
    );
    decoder.set_transformations(Transformations::EXPAND | Transformations::ALPHA);
    let header = decoder.read_header_info().map_err(broken)?;
    limits.check_size(header.width.into(), header.height.into())?;
    decoder.read_info().map_err(broken)
}

fn broken(error: DecodingError) -> VideoError {
    match error {
        DecodingError::IoError(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
            error.into()
        }
        error => VideoError::Damaged {
            reason: error.to_string(),
        },
    }
}

fn new_canvas(depth: u32, size: Size) -> AnyCanvas {
    if depth > 8 {
        AnyCanvas::U16(Canvas::new(size))
    } else {
        AnyCanvas::U8(Canvas::new(size))
    }
}

impl ApngSource {
    /// Opens a file.
    ///
    /// # Errors
    /// [`VideoError`] for a file that is damaged before its first frame or breaks the limits.
    pub fn open(file: File, limits: &VideoLimits) -> Result<Self, VideoError> {
        let reader = reader(&file, limits)?;
        let header = reader.info();
        let size = limits.check_size(header.width.into(), header.height.into())?;
        let control = header.animation_control().copied();
        let separate_default = header.frame_control.is_none();
        let depth = if header.bit_depth == BitDepth::Sixteen {
            16
        } else {
            8
        };
        let alpha = matches!(
            header.color_type,
            ColorType::Rgba | ColorType::GrayscaleAlpha
        ) || header.trns.is_some();
        let bytes = size.pixels() as u64 * u64::from(depth / 8) * 4;
        // the canvas, what it was before, the stored frame and its colors
        let memory = limits.pictures.memory.reserve(4 * bytes)?;
        let buffer = vec![0; reader.output_buffer_size().unwrap_or(0)];
        let frames = control.map_or(1, |control| u64::from(control.num_frames));
        let info = ClipInfo {
            container: Container::Apng,
            codec: "png".to_owned(),
            size,
            rotation: Rotation::None,
            pixels: PixelKind::Rgb { depth, alpha },
            pixel_aspect: Rational::ONE,
            time_base: Rational::ticks(TICKS),
            rate: None,
            variable_rate: None,
            frames: Some(frames),
            duration: None,
            other_tracks: Vec::new(),
        };
        let mut source = Self {
            canvas: new_canvas(depth, size),
            reader,
            file,
            info,
            limits: limits.clone(),
            buffer,
            next: 0,
            time: 0,
            ended: false,
            damage: None,
            _memory: memory,
        };
        if separate_default && control.is_some() {
            // the picture for programs that know no animation
            let first = source.reader.next_frame(&mut source.buffer);
            first.map_err(broken)?;
        }
        Ok(source)
    }

    fn restart(&mut self) -> Result<(), VideoError> {
        *self = Self::open(self.file.try_clone()?, &self.limits)?;
        Ok(())
    }

    /// Ends reading: as an error before the first frame, as damage after it.
    fn stop(&mut self, error: DecodingError) -> Result<Option<Frame>, VideoError> {
        self.ended = true;
        let reason = match broken(error) {
            VideoError::Damaged { reason } => reason,
            error => return Err(error),
        };
        if self.next == 0 {
            return Err(VideoError::Damaged { reason });
        }
        self.damage = Some(Damage {
            frames: self.next,
            reason,
            lost: None,
        });
        Ok(None)
    }
}

/// Pixels of a stored frame from big-endian samples with alpha.
fn pixels<T: Sample>(bytes: &[u8], color: ColorType, sample: impl Fn(&[u8]) -> T) -> Vec<Srgba<T>> {
    let width = std::mem::size_of::<T>();
    let at = |pixel: &[u8], channel: usize| sample(&pixel[channel * width..][..width]);
    let channels = color.samples();
    let pixel = |pixel: &[u8]| match channels {
        1 => Srgba([at(pixel, 0), at(pixel, 0), at(pixel, 0), T::ONE]),
        2 => Srgba([at(pixel, 0), at(pixel, 0), at(pixel, 0), at(pixel, 1)]),
        3 => Srgba([at(pixel, 0), at(pixel, 1), at(pixel, 2), T::ONE]),
        _ => Srgba([at(pixel, 0), at(pixel, 1), at(pixel, 2), at(pixel, 3)]),
    };
    bytes.chunks_exact(channels * width).map(pixel).collect()
}

fn shown<T: Sample>(image: &Image<Srgba<T>>, alpha: bool) -> AnyImage
where
    AnyImage: From<Image<Srgba<T>>> + From<Image<Srgb<T>>>,
{
    if alpha {
        image.clone().into()
    } else {
        image
            .map(|pixel| Srgb([pixel.0[0], pixel.0[1], pixel.0[2]]))
            .into()
    }
}

impl FrameSource for ApngSource {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        let total = self.info.frames.unwrap_or(0);
        if self.ended || self.next >= total {
            self.ended = true;
            return Ok(None);
        }
        self.limits.check_frame(self.next)?;
        let output = match self.reader.next_frame(&mut self.buffer) {
            Ok(output) => output,
            Err(error) => return self.stop(error),
        };
        let control = self.reader.info().frame_control.unwrap_or_default();
        let bytes = &self.buffer[..output.buffer_size()];
        let at = (control.x_offset as usize, control.y_offset as usize);
        let width = output.width as usize;
        let over = control.blend_op == BlendOp::Over;
        let dispose = match control.dispose_op {
            DisposeOp::None => Dispose::Keep,
            DisposeOp::Background => Dispose::Clear,
            DisposeOp::Previous => Dispose::Restore,
        };
        let PixelKind::Rgb { alpha, .. } = self.info.pixels else {
            unreachable!("set when the file was opened");
        };
        let image = match &mut self.canvas {
            AnyCanvas::U8(canvas) => {
                let pixels = pixels(bytes, output.color_type, |sample| sample[0]);
                let pixels = pixels.as_slice();
                shown(
                    canvas.paint(&Patch {
                        at,
                        width,
                        pixels,
                        over,
                        dispose,
                    }),
                    alpha,
                )
            }
            AnyCanvas::U16(canvas) => {
                let sample = |sample: &[u8]| u16::from_be_bytes([sample[0], sample[1]]);
                let pixels = pixels(bytes, output.color_type, sample);
                let pixels = pixels.as_slice();
                shown(
                    canvas.paint(&Patch {
                        at,
                        width,
                        pixels,
                        over,
                        dispose,
                    }),
                    alpha,
                )
            }
        };
        // a denominator of 0 means 100; a delay of 0 is as fast as possible
        let den = if control.delay_den == 0 {
            100
        } else {
            control.delay_den
        };
        let duration = u64::from(control.delay_num) * u64::from(TICKS) / u64::from(den);
        let duration = duration.max(u64::from(TICKS / 100));
        let time = FrameTime {
            start: self.time,
            duration,
        };
        self.time = self.time.saturating_add_unsigned(duration);
        self.next += 1;
        Ok(Some(Frame {
            picture: FramePicture::Image(image),
            time,
        }))
    }

    fn seek(&mut self, index: u64) -> Result<(), VideoError> {
        if index < self.next || self.ended {
            self.restart()?;
        }
        while self.next < index && self.next_frame()?.is_some() {}
        Ok(())
    }

    fn damage(&self) -> Option<&Damage> {
        self.damage.as_ref()
    }
}

/// Writes an animated PNG file. The number of frames is put into the header at the end.
pub struct ApngSink {
    writer: Option<Writer<File>>,
    file: File,
    size: Size,
    time_base: Rational,
    depth: u32,
    alpha: bool,
    frames: u32,
}

fn failed(error: png::EncodingError) -> VideoError {
    match error {
        png::EncodingError::IoError(error) => error.into(),
        error => VideoError::Io(std::io::Error::other(error.to_string())),
    }
}

impl ApngSink {
    /// Writes the header into an empty file.
    ///
    /// # Errors
    /// An error of the file system.
    pub fn new(file: &File, clip: &SinkFormat) -> Result<Self, VideoError> {
        let (depth, alpha) = match clip.pixels {
            PixelKind::Rgb { depth, alpha } => (depth, alpha),
            PixelKind::Yuv { format, .. } => (format.depth, format.alpha),
        };
        let depth = if depth > 8 { 16 } else { 8 };
        let size = clip.size;
        let mut encoder =
            Encoder::new(file.try_clone()?, size.width() as u32, size.height() as u32);
        encoder.set_color(if alpha {
            ColorType::Rgba
        } else {
            ColorType::Rgb
        });
        encoder.set_depth(if depth > 8 {
            BitDepth::Sixteen
        } else {
            BitDepth::Eight
        });
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_animated(PLACEHOLDER, 0).map_err(failed)?;
        Ok(Self {
            writer: Some(encoder.write_header().map_err(failed)?),
            file: file.try_clone()?,
            size,
            time_base: clip.time_base,
            depth,
            alpha,
            frames: 0,
        })
    }
}

/// Number of frames until it is known.
const PLACEHOLDER: u32 = 0x7fff_ffff;

impl FrameSink for ApngSink {
    fn write(&mut self, frame: &Frame) -> Result<(), VideoError> {
        if frame.picture.size() != self.size {
            return Err(VideoError::SizeChanged {
                frame: self.frames.into(),
                found: frame.picture.size(),
                expected: self.size,
            });
        }
        let image = frame.picture.to_image();
        let bytes = match (self.depth > 8, self.alpha) {
            (false, false) => bytemuck::cast_slice(image.convert::<Srgb<u8>>().pixels()).to_vec(),
            (false, true) => bytemuck::cast_slice(image.convert::<Srgba<u8>>().pixels()).to_vec(),
            (true, false) => {
                big_endian(bytemuck::cast_slice(image.convert::<Srgb<u16>>().pixels()))
            }
            (true, true) => {
                big_endian(bytemuck::cast_slice(image.convert::<Srgba<u16>>().pixels()))
            }
        };
        let seconds = frame.time.duration as f64 * self.time_base.to_f64();
        let writer = self.writer.as_mut().expect("taken only by `finish`");
        // the format has 16 bits for each part
        let delay = Rational::nearest(seconds, 65535).filter(|delay| delay.num() <= 65535);
        let (num, den) = delay.map_or((65535, 1), |delay| (delay.num() as u16, delay.den() as u16));
        writer.set_frame_delay(num, den).map_err(failed)?;
        writer.write_image_data(&bytes).map_err(failed)?;
        self.frames += 1;
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<(), VideoError> {
        if let Some(writer) = self.writer.take() {
            writer.finish().map_err(failed)?;
        }
        set_frame_count(&mut self.file, self.frames)?;
        Ok(())
    }
}

fn big_endian(samples: &[u16]) -> Vec<u8> {
    samples
        .iter()
        .flat_map(|sample| sample.to_be_bytes())
        .collect()
}

/// Replaces the number of frames in the header, with its checksum.
fn set_frame_count(file: &mut File, frames: u32) -> std::io::Result<()> {
    file.seek(SeekFrom::Start(0))?;
    let mut start = [0; 512];
    let mut filled = 0;
    while filled < start.len() {
        match file.read(&mut start[filled..])? {
            0 => break,
            read => filled += read,
        }
    }
    let name = start.windows(4).position(|name| name == b"acTL");
    let name =
        name.ok_or_else(|| std::io::Error::other("the header of an animation is missing"))?;
    let mut chunk = start[name..name + 12].to_vec();
    chunk[4..8].copy_from_slice(&frames.to_be_bytes());
    let mut crc = flate2::Crc::new();
    crc.update(&chunk);
    chunk.extend(crc.sum().to_be_bytes());
    file.seek(SeekFrom::Start(name as u64))?;
    file.write_all(&chunk)?;
    file.seek(SeekFrom::End(0))?;
    Ok(())
}
