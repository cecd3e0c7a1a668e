//! Reading of Y4M files and streams.

use super::header::{Header, MAGIC, MAX_LINE};
use crate::color::ColorInfo;
use crate::error::VideoError;
use crate::frame::{Frame, FramePicture};
use crate::info::{ClipInfo, Container, PixelKind, Rotation};
use crate::limits::VideoLimits;
use crate::source::{Damage, FrameSource};
use crate::time::{FrameTime, Rational};
use crate::yuv::{SamplePlane, YuvFormat, YuvImage};
use ravec_raster::{Image, Size};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};

/// Rate of files that name none.
const DEFAULT_RATE: u32 = 25;

/// Start of each frame.
pub(super) const FRAME: &[u8] = b"FRAME";

/// Input that may be able to seek.
enum Input {
    File(BufReader<File>),
    Stream(Box<dyn BufRead + Send>),
}

impl Input {
    fn reader(&mut self) -> &mut dyn BufRead {
        match self {
            Self::File(file) => file,
            Self::Stream(stream) => stream,
        }
    }
}

/// Frames of a Y4M file or stream.
pub struct Y4mSource {
    input: Input,
    info: ClipInfo,
    limits: VideoLimits,
    size: Size,
    format: YuvFormat,
    color: ColorInfo,
    /// Bytes before the first frame.
    start: u64,
    /// Number of the next frame.
    next: u64,
    ended: bool,
    damage: Option<Damage>,
}

impl Y4mSource {
    /// Opens a file.
    ///
    /// # Errors
    /// [`VideoError`] for a header that is damaged or breaks the limits.
    pub fn open(file: File, limits: &VideoLimits) -> Result<Self, VideoError> {
        let bytes = file.metadata()?.len();
        let mut source = Self::new(Input::File(BufReader::with_capacity(1 << 16, file)), limits)?;
        let frame = source.frame_bytes();
        source.info.frames = Some(bytes.saturating_sub(source.start) / frame);
        source.info.duration = source.info.frames;
        Ok(source)
    }

    /// Reads a stream, which cannot seek backwards.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn stream(
        stream: impl Read + Send + 'static,
        limits: &VideoLimits,
    ) -> Result<Self, VideoError> {
        Self::new(Input::Stream(Box::new(BufReader::new(stream))), limits)
    }

    fn new(mut input: Input, limits: &VideoLimits) -> Result<Self, VideoError> {
        let line = read_line(input.reader())?.ok_or(VideoError::Empty)?;
        if !line.starts_with(MAGIC) {
            return Err(VideoError::UnknownFormat);
        }
        let text = String::from_utf8_lossy(&line);
        let header = Header::parse(&text)?;
        let size = limits.check_size(header.width, header.height)?;
        let rate = header.rate.unwrap_or_else(|| {
            Rational::new(DEFAULT_RATE, 1).expect("the default rate is positive")
        });
        let color = header.color(size.height());
        let info = ClipInfo {
            container: Container::Y4m,
            codec: "rawvideo".to_owned(),
            size,
            rotation: Rotation::None,
            pixels: PixelKind::Yuv {
                format: header.format,
                color,
            },
            pixel_aspect: header.pixel_aspect,
            time_base: rate.recip(),
            rate: Some(rate),
            variable_rate: Some(false),
            frames: None,
            duration: None,
            other_tracks: Vec::new(),
        };
        Ok(Self {
            input,
            info,
            limits: limits.clone(),
            size,
            format: header.format,
            color,
            start: line.len() as u64 + 1,
            next: 0,
            ended: false,
            damage: None,
        })
    }

    /// Bytes of a frame whose line has no parameters.
    fn frame_bytes(&self) -> u64 {
        FRAME.len() as u64 + 1 + self.format.frame_bytes(self.size)
    }

    fn damaged(&mut self, reason: &str) {
        self.ended = true;
        self.damage = Some(Damage {
            frames: self.next,
            reason: reason.to_owned(),
            lost: None,
        });
    }

    /// Reads the line of a frame. False at the end.
    fn read_frame_line(&mut self) -> Result<bool, VideoError> {
        match read_line(self.input.reader()) {
            Ok(None) => {
                self.ended = true;
                Ok(false)
            }
            Ok(Some(line)) if line.starts_with(FRAME) => Ok(true),
            Ok(Some(_)) | Err(VideoError::Damaged { .. }) => {
                self.damaged("a frame does not begin where it should");
                Ok(false)
            }
            Err(error) => Err(error),
        }
    }

    fn read_planes(&mut self) -> Result<Option<YuvImage>, VideoError> {
        let mut planes = Vec::new();
        for size in self.format.plane_sizes(self.size) {
            let wide = self.format.depth > 8;
            let Some(plane) = read_plane(self.input.reader(), size, wide)? else {
                self.damaged("the file ends within a frame");
                return Ok(None);
            };
            planes.push(plane);
        }
        let planes = YuvImage::new(self.format, self.color, planes);
        Ok(Some(planes.expect("the planes were read in this layout")))
    }

    /// Goes to a frame by reading over all frames before it.
    fn skip_to(&mut self, index: u64) -> Result<(), VideoError> {
        let bytes = self.format.frame_bytes(self.size);
        while self.next < index && !self.ended && self.read_frame_line()? {
            let skipped = std::io::copy(
                &mut Read::take(self.input.reader(), bytes),
                &mut std::io::sink(),
            )?;
            if skipped < bytes {
                self.damaged("the file ends within a frame");
                break;
            }
            self.next += 1;
        }
        Ok(())
    }
}

impl FrameSource for Y4mSource {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        if self.ended || !self.read_frame_line()? {
            return Ok(None);
        }
        self.limits.check_frame(self.next)?;
        let Some(planes) = self.read_planes()? else {
            return Ok(None);
        };
        let time = FrameTime {
            start: self.next as i64,
            duration: 1,
        };
        self.next += 1;
        Ok(Some(Frame {
            picture: FramePicture::Yuv(planes),
            time,
        }))
    }

    fn seek(&mut self, index: u64) -> Result<(), VideoError> {
        let (start, bytes) = (self.start, self.frame_bytes());
        if let Input::File(file) = &mut self.input {
            self.damage = None;
            self.ended = false;
            // the line before shows whether arithmetic leads to a frame
            let place = index
                .checked_mul(bytes)
                .and_then(|offset| offset.checked_add(start));
            let len = file.get_ref().metadata()?.len();
            if let Some(place) = place.filter(|place| *place < len) {
                file.seek(SeekFrom::Start(place))?;
                let expected = [FRAME, b"\n"].concat();
                if file.fill_buf()?.starts_with(&expected) {
                    self.next = index;
                    return Ok(());
                }
            }
            file.seek(SeekFrom::Start(start))?;
            self.next = 0;
            return self.skip_to(index);
        }
        if index < self.next {
            return Err(VideoError::Unsupported {
                feature: "going back in a stream".to_owned(),
                hint: Some("write it to a file first".to_owned()),
            });
        }
        self.skip_to(index)
    }

    fn damage(&self) -> Option<&Damage> {
        self.damage.as_ref()
    }
}

/// A line without its end; `None` at the end of the input.
fn read_line(input: &mut dyn BufRead) -> Result<Option<Vec<u8>>, VideoError> {
    let mut line = Vec::new();
    Read::take(input, MAX_LINE as u64).read_until(b'\n', &mut line)?;
    match line.pop() {
        None => Ok(None),
        Some(b'\n') => Ok(Some(line)),
        Some(_) => Err(VideoError::Damaged {
            reason: "a line of text does not end".to_owned(),
        }),
    }
}

/// A plane, or `None` if the input ends within it.
///
/// Memory is taken as data arrive, so that a header that lies about the size costs no more than the file has.
fn read_plane(
    input: &mut dyn BufRead,
    size: Size,
    wide: bool,
) -> Result<Option<SamplePlane>, VideoError> {
    let bytes = size.pixels() * if wide { 2 } else { 1 };
    let mut data = Vec::new();
    Read::take(input, bytes as u64).read_to_end(&mut data)?;
    if data.len() < bytes {
        return Ok(None);
    }
    let plane = if wide {
        let samples = data.chunks_exact(2);
        let samples = samples.map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
        SamplePlane::U16(Image::from_vec(size.width(), samples.collect()).expect("rows are whole"))
    } else {
        SamplePlane::U8(Image::from_vec(size.width(), data).expect("rows are whole"))
    };
    Ok(Some(plane))
}
