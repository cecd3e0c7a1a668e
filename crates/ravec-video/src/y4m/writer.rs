//! Writing of Y4M files.

use super::header::{MAGIC, nearest, siting_of};
use super::reader::FRAME;
use crate::color::{ColorInfo, Range, Subsampling};
use crate::error::VideoError;
use crate::frame::Frame;
use crate::info::PixelKind;
use crate::sink::{FrameSink, SinkFormat};
use crate::time::Rational;
use crate::yuv::{SamplePlane, YuvFormat};
use ravec_raster::Size;
use std::io::{self, BufRead, Write};

/// Takes frames and writes them to a stream, one after the other.
pub struct Y4mSink<W: Write + Send> {
    output: W,
    size: Size,
    format: YuvFormat,
    color: ColorInfo,
    frames: u64,
}

/// The layout for colors: the common one, or one that holds them exactly.
fn layout_for_colors(depth: u32, alpha: bool, lossless: bool) -> Result<YuvFormat, VideoError> {
    if !lossless {
        let subsampling = if alpha {
            Subsampling::S444
        } else {
            Subsampling::S420
        };
        return Ok(YuvFormat {
            subsampling,
            depth: 8,
            alpha,
        });
    }
    if depth > 8 || alpha {
        let text = "Y4M holds colors of at most 8 bits without loss, and no alpha beside them: write numbered pictures instead";
        return Err(VideoError::Options(text.to_owned()));
    }
    // 8-bit colors come back exactly from 10-bit planes
    Ok(YuvFormat {
        subsampling: Subsampling::S444,
        depth: 10,
        alpha: false,
    })
}

impl<W: Write + Send> Y4mSink<W> {
    /// Writes the header.
    ///
    /// # Errors
    /// [`VideoError::Options`] if `lossless` is asked of frames that Y4M does not hold exactly; an error of the file system.
    pub fn new(mut output: W, clip: &SinkFormat, lossless: bool) -> Result<Self, VideoError> {
        let wanted = match clip.pixels {
            PixelKind::Yuv { format, .. } => format,
            PixelKind::Rgb { depth, alpha } => layout_for_colors(depth, alpha, lossless)?,
        };
        let mut color = clip.yuv_color();
        let (name, format) = nearest(wanted, color.siting);
        if lossless && format != wanted {
            let text = "Y4M does not hold this layout with alpha without loss";
            return Err(VideoError::Options(text.to_owned()));
        }
        // samples keep their places; layouts without a name for their siting say the nearest
        if matches!(clip.pixels, PixelKind::Rgb { .. }) {
            color.siting = siting_of(&name);
        }
        let rate = clip.rate.unwrap_or_else(|| clip.time_base.recip());
        let range = match color.range {
            Range::Full => "FULL",
            Range::Limited => "LIMITED",
        };
        let colon = |ratio: Rational| format!("{}:{}", ratio.num(), ratio.den());
        output.write_all(MAGIC)?;
        writeln!(
            output,
            " W{} H{} F{} Ip A{} C{name} XCOLORRANGE={range}",
            clip.size.width(),
            clip.size.height(),
            colon(rate),
            colon(clip.pixel_aspect)
        )?;
        Ok(Self {
            output,
            size: clip.size,
            format,
            color,
            frames: 0,
        })
    }
}

impl<W: Write + Send> FrameSink for Y4mSink<W> {
    fn write(&mut self, frame: &Frame) -> Result<(), VideoError> {
        if frame.picture.size() != self.size {
            return Err(VideoError::SizeChanged {
                frame: self.frames,
                found: frame.picture.size(),
                expected: self.size,
            });
        }
        let planes = frame.picture.to_yuv(self.format, self.color);
        self.output.write_all(FRAME)?;
        self.output.write_all(b"\n")?;
        for plane in planes.planes() {
            match plane {
                SamplePlane::U8(plane) => self.output.write_all(plane.pixels())?,
                SamplePlane::U16(plane) => {
                    for row in plane.rows() {
                        let bytes: Vec<u8> = row.iter().flat_map(|v| v.to_le_bytes()).collect();
                        self.output.write_all(&bytes)?;
                    }
                }
            }
        }
        self.frames += 1;
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<(), VideoError> {
        self.output.flush()?;
        Ok(())
    }
}

/// Appends the frames of a whole Y4M file, without its header unless it is the first, to `output`.
///
/// # Errors
/// An error of either file.
pub fn append_frames(
    mut input: impl BufRead,
    first: bool,
    output: &mut impl Write,
) -> io::Result<()> {
    let mut header = Vec::new();
    input.read_until(b'\n', &mut header)?;
    if first {
        output.write_all(&header)?;
    }
    io::copy(&mut input, output)?;
    Ok(())
}
