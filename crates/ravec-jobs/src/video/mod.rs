//! `video info`, `video convert`, `video frames`, and clips as inputs and outputs of other operations.

mod clip;
mod conversion;
pub mod convert;
pub mod edit;
pub mod frames;
pub mod info;
mod map;
mod pace;
mod range;

pub(crate) use clip::{
    ClipOutput, OutputShape, check_clip_target, clip_folders, clip_outputs, folder_or_clip,
    is_clip, open_clip, read_error,
};
pub use conversion::{Conversion, FramePlace};
pub(crate) use convert::seek_start;
pub(crate) use map::{ClipFiles, check_no_encoding, key_of, map_clip};
pub use range::FrameRange;

use serde::{Deserialize, Serialize};

/// Encoding of a clip that is written.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Encoding {
    /// Codec of a clip, such as h264, hevc, vp9, av1, prores or ffv1 [default: the usual one of the format]. All but h264 in
    /// MP4 and MOV need `FFmpeg`
    #[cfg_attr(feature = "cli", arg(long, value_name = "NAME"))]
    pub codec: Option<String>,
    /// Quality of a lossy clip, 0 to 100 [default: 75]: higher is larger and closer to the frames
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(0..=100)))]
    pub video_quality: Option<u8>,
    /// Keep every sample of a clip exactly; refused for formats that cannot
    #[cfg_attr(feature = "cli", arg(long))]
    pub lossless: bool,
    /// Leave sound and subtitles out of a clip
    #[cfg_attr(feature = "cli", arg(long))]
    pub no_audio: bool,
    /// Go on from the whole chunks that an interrupted run of the same command has left
    #[cfg_attr(feature = "cli", arg(long))]
    pub resume: bool,
}
