//! Frames of clips in and out: formats, colors, time stamps and limits.

mod color;
mod convert;
mod error;
mod ffmpeg;
mod frame;
mod info;
mod limits;
mod sink;
mod source;
mod time;
mod yuv;

pub use color::{ColorInfo, Matrix, Range, Siting, SitingAxis, Subsampling, UNSPECIFIED};
pub use convert::{image_from_yuv, yuv_from_image};
pub use error::VideoError;
pub use ffmpeg::{FfmpegSink, FfmpegSource, TrackExcerpt, assemble};
pub use frame::{Frame, FramePicture};
pub use info::{ClipInfo, Container, OtherTrack, PixelKind, Rotation, TrackKind};
pub use limits::VideoLimits;
pub use sink::{EncodeOptions, FrameSink, SinkFormat};
pub use source::{Damage, FrameSource};
pub use time::{FrameTime, ParseRationalError, Rational, rescale};
pub use yuv::{PlaneMismatch, SamplePlane, YuvFormat, YuvImage};
