//! Writing frames one after the other.

use crate::color::ColorInfo;
use crate::error::VideoError;
use crate::frame::Frame;
use crate::info::PixelKind;
use crate::time::Rational;
use ravec_raster::Size;

/// Takes the frames of a clip in the order in which they are shown.
pub trait FrameSink: Send {
    /// Appends a frame. Its size is that of the [`SinkFormat`]; its time is in the time base of the format and not before the
    /// last one.
    ///
    /// # Errors
    /// [`VideoError::SizeChanged`] for another size, [`VideoError`] for an encoder or a file system that fails.
    fn write(&mut self, frame: &Frame) -> Result<(), VideoError>;

    /// Completes the clip. A sink that is dropped instead leaves nothing behind.
    ///
    /// # Errors
    /// [`VideoError`] for an encoder or a file system that fails.
    fn finish(self: Box<Self>) -> Result<(), VideoError>;
}

/// Properties of the clip that a sink gets.
#[derive(Debug, Clone, PartialEq)]
pub struct SinkFormat {
    /// Size of all frames.
    pub size: Size,
    /// Samples that the frames come in. A sink that cannot store them takes the nearest that it can.
    pub pixels: PixelKind,
    /// Seconds a tick of the time stamps.
    pub time_base: Rational,
    /// Frames a second, if they are evenly spaced.
    pub rate: Option<Rational>,
    /// Width by height of a pixel.
    pub pixel_aspect: Rational,
}

/// Choices of encoding.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EncodeOptions {
    /// Name of the codec, such as `h264`, `hevc`, `ffv1`; the usual one of the container if `None`.
    pub codec: Option<String>,
    /// Quality from 0 to 100 (default 75). More is larger and closer to the original.
    pub quality: Option<u8>,
    /// True for the exact samples; refused for codecs that cannot.
    pub lossless: bool,
}

impl SinkFormat {
    /// Meaning of samples for a sink that stores planes: that of the source, or BT.709 or BT.601 by height for colors.
    pub fn yuv_color(&self) -> ColorInfo {
        match self.pixels {
            PixelKind::Yuv { color, .. } => color,
            PixelKind::Rgb { .. } => ColorInfo {
                tagged: true,
                ..ColorInfo::guess(self.size.height())
            },
        }
    }
}
