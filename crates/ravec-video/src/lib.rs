//! Frames of clips in and out: formats, colors, time stamps and limits.
//!
//! A [`Clip`] gives the frames of a file, of numbered pictures or of a stream, one after the other or from any place on; a
//! [`ClipWriter`] takes them. Both hold a bounded number of frames, whatever the length of the clip.
//!
//! ```
//! use ravec_raster::{Image, Size, Srgb};
//! use ravec_video::{Clip, ClipWriter, CreateOptions, Frame, FramePicture, FrameSource as _, FrameTime, OpenOptions};
//! use ravec_video::{PixelKind, Rational, SinkFormat};
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("fade.y4m");
//! let rate = Rational::new(25, 1).ok_or("a rate is positive")?;
//! let format = SinkFormat {
//!     size: Size::new(64, 48)?,
//!     pixels: PixelKind::Rgb { depth: 8, alpha: false },
//!     time_base: rate.recip(),
//!     rate: Some(rate),
//!     pixel_aspect: Rational::ONE,
//! };
//! let mut writer = ClipWriter::create(&path, &format, &CreateOptions::default())?;
//! for at in 0..10 {
//!     let image = Image::new(format.size, Srgb([20 * at as u8; 3]));
//!     let time = FrameTime { start: at, duration: 1 };
//!     writer.write(&Frame { picture: FramePicture::Image(image.into()), time })?;
//! }
//! writer.finish()?;
//!
//! let mut clip = Clip::open(&path, &OpenOptions::default())?;
//! clip.seek(7)?;
//! let frame = clip.next_frame()?.ok_or("the clip has ten frames")?;
//! assert_eq!(frame.time.start, 7);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Frames keep the planes of their codec ([`YuvImage`]) until somebody asks for colors, so that what is only copied is not
//! changed.
//!
//! Guarantees: samples come back to the last bit from Y4M, numbered PNG, TIFF and EXR pictures and animated PNG; time stamps of
//! formats that have them are kept; [`FrameSource::seek`] is exact to the frame; limits are checked before memory is taken; no
//! panic on any bytes; an output is whole or absent. Does not guarantee: colors of wide gamuts and high dynamic range, whose
//! codes are passed on but shown as if they were sRGB.
//!
//! Words: a *clip* is a sequence of frames with time stamps; a *tick* is the unit of its time stamps, and the *time base* its
//! length in seconds; a *source* gives frames and a *sink* takes them; the *siting* of chroma is its place among the luma
//! samples; a *chunk* is a part of an output that is encoded by itself.

mod animation;
mod color;
mod convert;
mod create;
mod error;
mod ffmpeg;
mod frame;
#[cfg(feature = "h264")]
mod h264;
mod info;
mod limits;
#[cfg(feature = "h264")]
pub mod mp4;
mod open;
mod parts;
mod pictures;
mod random_access;
mod scratch;
mod sink;
mod source;
mod time;
mod turn;
mod y4m;
mod yuv;

pub use animation::{ApngSink, ApngSource, GifSink, GifSource};
pub use color::{ColorInfo, Matrix, Range, Siting, SitingAxis, Subsampling, UNSPECIFIED};
pub use convert::{image_from_yuv, yuv_from_image};
pub use create::{ClipWriter, CopiedTracks, CreateOptions, DEFAULT_QUALITY, container_for};
pub use error::VideoError;
pub use ffmpeg::{FfmpegSink, FfmpegSource, TrackExcerpt, assemble};
pub use frame::{Frame, FramePicture};
pub use info::{ClipInfo, Container, OtherTrack, PixelKind, Rotation, TrackKind};
pub use limits::VideoLimits;
pub use open::{Clip, OpenOptions, is_clip_name};
pub use parts::CHUNK_FRAMES;
pub use pictures::{Pattern, PictureSink, PictureSource};
pub use random_access::RandomAccess;
pub use scratch::{ScratchClip, ScratchWriter};
pub use sink::{EncodeOptions, FrameSink, SinkFormat};
pub use source::{Damage, FrameSource};
pub use time::{FrameTime, ParseRationalError, Rational, rescale};
pub use y4m::{Y4mSink, Y4mSource};
pub use yuv::{PlaneMismatch, SamplePlane, YuvFormat, YuvImage};
