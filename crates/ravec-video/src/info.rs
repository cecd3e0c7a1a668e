//! Properties of a clip.

use crate::color::ColorInfo;
use crate::time::Rational;
use crate::yuv::YuvFormat;
use ravec_raster::Size;
use serde::{Serialize, Serializer};

/// Files and folders that hold clips.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Container {
    /// MP4 and QuickTime.
    Mp4,
    /// Uncompressed YUV4MPEG2.
    Y4m,
    /// Numbered pictures.
    Pictures,
    /// Animated GIF.
    Gif,
    /// Animated PNG.
    Apng,
    /// Anything that FFmpeg reads or writes.
    Ffmpeg,
}

/// Quarter turns clockwise by which stored frames are turned for display.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize)]
pub enum Rotation {
    /// Upright as stored.
    #[default]
    #[serde(rename = "0")]
    None,
    /// By 90 degrees clockwise.
    #[serde(rename = "90")]
    Clockwise,
    /// By 180 degrees.
    #[serde(rename = "180")]
    Half,
    /// By 90 degrees counterclockwise.
    #[serde(rename = "270")]
    Counterclockwise,
}

/// Samples of the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PixelKind {
    /// Planes of luma and chroma.
    Yuv {
        /// Layout.
        format: YuvFormat,
        /// Meaning.
        color: ColorInfo,
    },
    /// Red, green and blue.
    Rgb {
        /// Bits a sample: 8, 16, or 32 for floats in linear light.
        depth: u32,
        /// True if alpha is stored.
        alpha: bool,
    },
}

impl PixelKind {
    /// True if alpha is stored.
    pub fn has_alpha(self) -> bool {
        match self {
            Self::Yuv { format, .. } => format.alpha,
            Self::Rgb { alpha, .. } => alpha,
        }
    }
}

/// A track beside the frames.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct OtherTrack {
    /// Kind of the track.
    pub kind: TrackKind,
    /// Name of the codec, such as `aac`.
    pub codec: String,
    /// Language by ISO 639, if stated.
    pub language: Option<String>,
}

/// Kind of a track beside the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TrackKind {
    /// Sound.
    Audio,
    /// Subtitles.
    Subtitles,
    /// Anything else, such as a track of time codes.
    Data,
}

/// Properties of a clip that are known before its frames are read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClipInfo {
    /// The kind of file.
    pub container: Container,
    /// Name of the codec, such as `h264`, `rawvideo` or `png`.
    pub codec: String,
    /// Size of the frames, upright.
    #[serde(serialize_with = "serialize_size")]
    pub size: Size,
    /// Turn that was applied to the stored frames.
    pub rotation: Rotation,
    /// Samples of the frames.
    pub pixels: PixelKind,
    /// Width by height of a pixel.
    pub pixel_aspect: Rational,
    /// Seconds a tick.
    pub time_base: Rational,
    /// Frames a second; the mean for a variable rate, `None` if it is not known.
    pub rate: Option<Rational>,
    /// True if the stamps are not evenly spaced; `None` if that is not known before all frames are read.
    pub variable_rate: Option<bool>,
    /// Number of frames, as far as the file states it. What comes may differ in damaged files.
    pub frames: Option<u64>,
    /// Ticks from the first frame to the end of the last one, as far as known.
    pub duration: Option<u64>,
    /// Sound, subtitles and others.
    pub other_tracks: Vec<OtherTrack>,
}

impl ClipInfo {
    /// Seconds from the first frame to the end of the last one, as far as known.
    pub fn duration_secs(&self) -> Option<f64> {
        self.duration
            .map(|ticks| ticks as f64 * self.time_base.to_f64())
    }
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "the signature that serde calls"
)]
fn serialize_size<S: Serializer>(size: &Size, serializer: S) -> Result<S::Ok, S::Error> {
    [size.width(), size.height()].serialize(serializer)
}
