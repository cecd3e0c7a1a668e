//! Writing frames of a file.

use super::copy::CopiedTracks;
use super::mux::{Muxer, VideoHeader};
use crate::color::{ColorInfo, SitingAxis};
use crate::error::VideoError;
use crate::frame::Frame;
use crate::h264::{AvcConfig, AvcEncoder, EncoderSettings};
use crate::sink::{EncodeOptions, FrameSink, SinkFormat};
use crate::time::{FrameTime, Rational};
use crate::yuv::YuvFormat;
use std::io::{Seek, Write};

/// Seconds after which a frame is coded without reference to others, so that players can start there.
const KEY_FRAME_SECONDS: f64 = 2.0;

/// Writes an MP4 file with H.264, of 8 bits and 4:2:0.
///
/// Stamps are written as they are, in ticks of the time base (times its numerator, where that is not one). A first frame
/// before zero becomes the start. Sizes may be odd: the last column or row is coded twice and cropped by the atom `clap`,
/// which [`Mp4Source`](super::Mp4Source) honors; players that do not know it show it. The index comes last.
///
/// The same frames and options give the same bytes on any number of threads. Quality 100 is the quantizer 12, quality 0
/// is 51, quality 75, the default, is 22.
///
/// Does not guarantee: a rate of bits; pictures that are identical to those written.
pub struct Mp4Writer<W: Write + Seek + Send> {
    muxer: Muxer<W>,
    encoder: AvcEncoder,
    format: SinkFormat,
    color: ColorInfo,
    frames: u64,
    last_key: i64,
    last: Option<FrameTime>,
}

impl<W: Write + Seek + Send> Mp4Writer<W> {
    /// Begins a file. Nothing but `output` is touched; what is in it without [`complete`](Self::complete) is no clip.
    ///
    /// # Errors
    /// [`VideoError::Options`] for a codec other than `h264`, for lossless frames, a quality above 100, frames that are too
    /// large, or a time base finer than 2^-32 seconds.
    pub fn new(
        output: W,
        format: &SinkFormat,
        options: &EncodeOptions,
    ) -> Result<Self, VideoError> {
        if let Some(codec) = options.codec.as_deref().filter(|&codec| codec != "h264") {
            return Err(VideoError::Options(format!(
                "an MP4 file with the codec {codec} needs FFmpeg; without it, `h264` can be written"
            )));
        }
        if options.lossless {
            return Err(VideoError::Options(
                "H.264 in 4:2:0 cannot be lossless: write Y4M, numbered PNG or TIFF files, or a codec such as ffv1 by FFmpeg"
                    .to_owned(),
            ));
        }
        let mut color = format.yuv_color();
        if color.siting.x == SitingAxis::Last {
            // chroma on the right of its luma has no code: it is moved
            color.siting.x = SitingAxis::First;
        }
        let encoder = AvcEncoder::new(EncoderSettings {
            size: format.size,
            color,
            pixel_aspect: format.pixel_aspect,
            rate: format.rate.map_or(25.0, Rational::to_f64),
            quality: options.quality,
        })?;
        Ok(Self {
            muxer: Muxer::new(output, format.time_base.den())?,
            encoder,
            format: format.clone(),
            color,
            frames: 0,
            last_key: 0,
            last: None,
        })
    }

    /// Brings sound and subtitles along. They are written beside the frames that follow.
    pub fn copy_tracks(&mut self, tracks: CopiedTracks) {
        self.muxer.copy_tracks(tracks);
    }

    /// Writes the index and returns the output.
    ///
    /// # Errors
    /// [`VideoError::Options`] without any frame, [`VideoError::Io`].
    pub fn complete(self) -> Result<W, VideoError> {
        let (Some(last), Some((sps, pps))) = (self.last, self.encoder.sets()) else {
            return Err(VideoError::Options(
                "a clip needs at least one frame".to_owned(),
            ));
        };
        let config = AvcConfig {
            length_size: 4,
            sps: vec![sps.to_vec()],
            pps: vec![pps.to_vec()],
        };
        let header = VideoHeader::new(
            &config,
            self.format.size,
            self.color,
            self.format.pixel_aspect,
        );
        let duration = last
            .duration
            .saturating_mul(u64::from(self.format.time_base.num()));
        self.muxer.finish(&header, duration)
    }
}

impl<W: Write + Seek + Send> FrameSink for Mp4Writer<W> {
    fn write(&mut self, frame: &Frame) -> Result<(), VideoError> {
        let found = frame.picture.size();
        if found != self.format.size {
            return Err(VideoError::SizeChanged {
                frame: self.frames,
                found,
                expected: self.format.size,
            });
        }
        let base = self.format.time_base;
        let start = frame
            .time
            .start
            .checked_mul(i64::from(base.num()))
            .ok_or_else(|| {
                VideoError::Options(format!(
                    "the time stamp {} is out of range",
                    frame.time.start
                ))
            })?;
        let since_key = start.saturating_sub(self.last_key) as f64 / f64::from(base.den());
        let key = self.frames == 0 || since_key >= KEY_FRAME_SECONDS;
        let picture = frame.picture.to_yuv(YuvFormat::YUV420P8, self.color);
        let coded = self.encoder.encode(&picture, key)?;
        if coded.key {
            self.last_key = start;
        }
        self.muxer.push(coded.sample, start, coded.key)?;
        self.frames += 1;
        self.last = Some(frame.time);
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), VideoError> {
        self.complete().map(drop)
    }
}
