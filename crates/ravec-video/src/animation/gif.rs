//! Animated GIF.

use super::canvas::{Canvas, Dispose, Patch};
use crate::error::VideoError;
use crate::frame::{Frame, FramePicture};
use crate::info::{ClipInfo, Container, PixelKind, Rotation};
use crate::limits::VideoLimits;
use crate::sink::{FrameSink, SinkFormat};
use crate::source::{Damage, FrameSource};
use crate::time::{FrameTime, Rational, rescale};
use gif::{
    ColorOutput, DecodeOptions, Decoder, DecodingError, DisposalMethod, Encoder, MemoryLimit,
    Repeat,
};
use ravec_memory::Reservation;
use ravec_raster::{Image, Size, Srgba};
use std::fs::File;
use std::io::{BufReader, Seek, SeekFrom, Write};
use std::num::NonZeroU64;

/// The format counts hundredths of a second.
const TIME_BASE: Rational = Rational::ticks(100);

/// Duration that players give to frames whose delay is 0 or 1, in ticks.
const DEFAULT_DELAY: u16 = 10;

/// Frames of a GIF file.
pub struct GifSource {
    decoder: Decoder<BufReader<File>>,
    file: File,
    info: ClipInfo,
    limits: VideoLimits,
    canvas: Canvas<u8>,
    next: u64,
    time: i64,
    ended: bool,
    damage: Option<Damage>,
    _memory: Reservation,
}

fn decoder(file: &File, bytes: u64) -> Result<Decoder<BufReader<File>>, VideoError> {
    let mut file = file.try_clone()?;
    file.seek(SeekFrom::Start(0))?;
    let mut options = DecodeOptions::new();
    options.set_color_output(ColorOutput::RGBA);
    options.set_memory_limit(MemoryLimit::Bytes(NonZeroU64::MIN.saturating_add(bytes)));
    options.check_frame_consistency(false);
    options.read_info(BufReader::new(file)).map_err(broken)
}

fn broken(error: DecodingError) -> VideoError {
    match error {
        DecodingError::Io(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
            error.into()
        }
        error => VideoError::Damaged {
            reason: error.to_string(),
        },
    }
}

impl GifSource {
    /// Opens a file.
    ///
    /// # Errors
    /// [`VideoError`] for a file that is damaged before its first frame or breaks the limits.
    pub fn open(file: File, limits: &VideoLimits) -> Result<Self, VideoError> {
        // codes and palette of a frame beside its pixels
        let most = limits.pictures.max_pixels.saturating_mul(8);
        let decoder = decoder(&file, most)?;
        let size = limits.check_size(decoder.width().into(), decoder.height().into())?;
        // the canvas, what it was before, and the frame that is decoded
        let memory = limits.pictures.memory.reserve(12 * size.pixels() as u64)?;
        let info = ClipInfo {
            container: Container::Gif,
            codec: "gif".to_owned(),
            size,
            rotation: Rotation::None,
            pixels: PixelKind::Rgb {
                depth: 8,
                alpha: true,
            },
            pixel_aspect: Rational::ONE,
            time_base: TIME_BASE,
            rate: None,
            variable_rate: None,
            frames: None,
            duration: None,
            other_tracks: Vec::new(),
        };
        Ok(Self {
            decoder,
            file,
            info,
            limits: limits.clone(),
            canvas: Canvas::new(size),
            next: 0,
            time: 0,
            ended: false,
            damage: None,
            _memory: memory,
        })
    }

    fn restart(&mut self) -> Result<(), VideoError> {
        let most = self.limits.pictures.max_pixels.saturating_mul(8);
        self.decoder = decoder(&self.file, most)?;
        self.canvas = Canvas::new(self.info.size);
        (self.next, self.time, self.ended, self.damage) = (0, 0, false, None);
        Ok(())
    }
}

impl FrameSource for GifSource {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        if self.ended {
            return Ok(None);
        }
        let stored = match self.decoder.read_next_frame() {
            Ok(Some(stored)) => stored,
            Ok(None) => {
                self.ended = true;
                return Ok(None);
            }
            Err(error) => {
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
                return Ok(None);
            }
        };
        self.limits.check_frame(self.next)?;
        let pixels: &[Srgba<u8>] = bytemuck::cast_slice(&stored.buffer);
        let image = self.canvas.paint(&Patch {
            at: (stored.left.into(), stored.top.into()),
            width: stored.width.into(),
            pixels,
            over: true,
            dispose: match stored.dispose {
                DisposalMethod::Background => Dispose::Clear,
                DisposalMethod::Previous => Dispose::Restore,
                DisposalMethod::Any | DisposalMethod::Keep => Dispose::Keep,
            },
        });
        let delay = if stored.delay < 2 {
            DEFAULT_DELAY
        } else {
            stored.delay
        };
        let time = FrameTime {
            start: self.time,
            duration: delay.into(),
        };
        self.time += i64::from(delay);
        self.next += 1;
        Ok(Some(Frame {
            picture: FramePicture::Image(image.clone().into()),
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

/// Writes a GIF file.
pub struct GifSink<W: Write + Send> {
    encoder: Encoder<W>,
    size: Size,
    time_base: Rational,
    /// End of the last frame, in ticks of the format.
    end: Option<i64>,
    speed: i32,
    frames: u64,
}

impl<W: Write + Send> GifSink<W> {
    /// Writes the header. `quality` from 0 to 100 selects how thoroughly the 256 colors of each frame are chosen.
    ///
    /// # Errors
    /// [`VideoError::Options`] for frames of more than 65535 columns or rows; an error of the file system.
    pub fn new(output: W, clip: &SinkFormat, quality: u8) -> Result<Self, VideoError> {
        let sides = u16::try_from(clip.size.width())
            .ok()
            .zip(u16::try_from(clip.size.height()).ok());
        let (width, height) = sides.ok_or_else(|| {
            VideoError::Options(format!(
                "GIF holds no frames of {}: at most 65535 columns and rows",
                clip.size
            ))
        })?;
        let mut encoder = Encoder::new(output, width, height, &[]).map_err(failed)?;
        encoder.set_repeat(Repeat::Infinite).map_err(failed)?;
        Ok(Self {
            encoder,
            size: clip.size,
            time_base: clip.time_base,
            end: None,
            // 1 is the slowest, 30 the fastest
            speed: 30 - (29 * i32::from(quality.min(100))) / 100,
            frames: 0,
        })
    }
}

fn failed(error: gif::EncodingError) -> VideoError {
    match error {
        gif::EncodingError::Io(error) => error.into(),
        error => VideoError::Io(std::io::Error::other(error.to_string())),
    }
}

impl<W: Write + Send> FrameSink for GifSink<W> {
    fn write(&mut self, frame: &Frame) -> Result<(), VideoError> {
        if frame.picture.size() != self.size {
            return Err(VideoError::SizeChanged {
                frame: self.frames,
                found: frame.picture.size(),
                expected: self.size,
            });
        }
        let mut image: Image<Srgba<u8>> = frame.picture.to_image().convert();
        let start = rescale(frame.time.start, self.time_base, TIME_BASE);
        let end = frame
            .time
            .start
            .saturating_add_unsigned(frame.time.duration);
        let end = rescale(end, self.time_base, TIME_BASE);
        // ends are rounded, not durations, so that errors do not add up; players slow down delays below 2
        let delay = (end - self.end.unwrap_or(start)).clamp(2, 65535);
        self.end = Some(self.end.unwrap_or(start) + delay);
        let (width, height) = (self.size.width() as u16, self.size.height() as u16);
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(image.pixels_mut());
        let mut stored = gif::Frame::from_rgba_speed(width, height, bytes, self.speed);
        stored.delay = delay as u16;
        stored.dispose = DisposalMethod::Background;
        self.encoder.write_frame(&stored).map_err(failed)?;
        self.frames += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), VideoError> {
        self.encoder.into_inner().map_err(failed)?.flush()?;
        Ok(())
    }
}
