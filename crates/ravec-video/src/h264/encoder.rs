//! Encoding of pictures at a constant quality.

use super::nal::{NalKind, annex_b_units};
use super::sps::Sps;
use super::vui::Vui;
use crate::color::ColorInfo;
use crate::error::VideoError;
use crate::time::Rational;
use crate::yuv::{SamplePlane, YuvImage};
use openh264::OpenH264API;
use openh264::encoder::{
    BitRate, Encoder, EncoderConfig, FrameRate, FrameType, IntraFramePeriod, QpRange,
    RateControlMode, UsageType,
};
use openh264::formats::YUVSlices;
use ravec_raster::Size;
use std::borrow::Cow;

/// Quantizer of quality 100: the encoder's smallest.
const BEST_QUANTIZER: u32 = 12;
/// Quantizer of quality 0: the coarsest of H.264.
const WORST_QUANTIZER: u32 = 51;
/// Quality if none is asked for.
const DEFAULT_QUALITY: u8 = 75;
/// Smallest side that the encoder takes; smaller frames are padded, and cropped by the parameter set.
const MIN_SIDE: usize = 16;
/// Longest and shortest side that the encoder takes.
const MAX_SIDES: (usize, usize) = (3840, 2160);

/// Choices of encoding that the whole track shares.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EncoderSettings {
    /// Size of the frames.
    pub(crate) size: Size,
    /// Meaning of the samples.
    pub(crate) color: ColorInfo,
    /// Width by height of a pixel.
    pub(crate) pixel_aspect: Rational,
    /// Frames a second, about.
    pub(crate) rate: f64,
    /// 0 to 100.
    pub(crate) quality: Option<u8>,
}

/// A picture as a sample of an MP4 file.
pub(crate) struct EncodedPicture<'a> {
    /// NAL units after lengths of 4 bytes, without parameter sets.
    pub(crate) sample: &'a [u8],
    /// True if decoding can start here.
    pub(crate) key: bool,
}

/// Encodes pictures. The same pictures give the same bytes, on any machine and with any number of threads.
pub(crate) struct AvcEncoder {
    encoder: Encoder,
    settings: EncoderSettings,
    /// Even, and not too small.
    coded: (usize, usize),
    sets: Option<(Vec<u8>, Vec<u8>)>,
    sample: Vec<u8>,
}

impl AvcEncoder {
    /// # Errors
    /// [`VideoError::Options`] for frames that are too large, or a quality above 100.
    pub(crate) fn new(settings: EncoderSettings) -> Result<Self, VideoError> {
        let (width, height) = (settings.size.width(), settings.size.height());
        let quality = settings.quality.unwrap_or(DEFAULT_QUALITY);
        if quality > 100 {
            return Err(VideoError::Options(format!(
                "`quality` is {quality}, and at most 100"
            )));
        }
        if width.max(height) > MAX_SIDES.0 || width.min(height) > MAX_SIDES.1 {
            return Err(VideoError::Options(format!(
                "H.264 is written up to {} x {} pixels, and the frames have {width} x {height}: make them smaller, or choose \
                 another codec",
                MAX_SIDES.0, MAX_SIDES.1,
            )));
        }
        let coded = (even(width), even(height));
        let quantizer = BEST_QUANTIZER
            + ((WORST_QUANTIZER - BEST_QUANTIZER) * u32::from(100 - quality) + 50) / 100;
        let quantizer = quantizer as u8;
        // the rate of bits only chooses the level: the quantizer is fixed
        let bits = (coded.0 * coded.1) as f64 * settings.rate.clamp(1.0, 120.0) / 10.0;
        let config = EncoderConfig::new()
            .bitrate(BitRate::from_bps(bits.clamp(64e3, 50e6) as u32))
            .max_frame_rate(FrameRate::from_hz(settings.rate.clamp(1.0, 60.0) as f32))
            .usage_type(UsageType::CameraVideoRealTime)
            .rate_control_mode(RateControlMode::Bufferbased)
            .qp(QpRange::new(quantizer, quantizer))
            .skip_frames(false)
            .scene_change_detect(false)
            .adaptive_quantization(false)
            .background_detection(false)
            .intra_frame_period(IntraFramePeriod::from_num_frames(0))
            .num_threads(1);
        let encoder =
            Encoder::with_api_config(OpenH264API::from_source(), config).map_err(encoder_failed)?;
        Ok(Self {
            encoder,
            settings,
            coded,
            sets: None,
            sample: Vec::new(),
        })
    }

    /// Encodes the next picture, one of 8 bits and 4:2:0 with the size of the settings; `key` asks for one from which decoding
    /// can start. The first picture always is one.
    pub(crate) fn encode(
        &mut self,
        picture: &YuvImage,
        key: bool,
    ) -> Result<EncodedPicture<'_>, VideoError> {
        let [Some(y), Some(u), Some(v)] =
            [0, 1, 2].map(|at| picture.planes().get(at).and_then(samples))
        else {
            return Err(VideoError::Options(
                "H.264 takes samples of 8 bits in 4:2:0".to_owned(),
            ));
        };
        let (width, height) = self.coded;
        let y = padded(y, width, height);
        let (u, v) = (
            padded(u, width / 2, height / 2),
            padded(v, width / 2, height / 2),
        );
        let slices = YUVSlices::new((&y, &u, &v), self.coded, (width, width / 2, width / 2));
        if key {
            self.encoder.force_intra_frame();
        }
        let stream = self.encoder.encode(&slices).map_err(encoder_failed)?;
        let key = stream.frame_type() == FrameType::IDR;
        let stream = stream.to_vec();
        self.sample.clear();
        for unit in annex_b_units(&stream) {
            match NalKind::of(unit) {
                NalKind::Sps => {
                    let sps = Sps::parse(unit)
                        .ok_or_else(|| encoder_failed("an unreadable parameter set"))?;
                    self.set_of_kind(true, self.described(sps).to_nal())?;
                }
                NalKind::Pps => self.set_of_kind(false, unit.to_vec())?,
                NalKind::Slice | NalKind::IdrSlice => {
                    self.sample.extend((unit.len() as u32).to_be_bytes());
                    self.sample.extend(unit);
                }
                NalKind::Partition | NalKind::Other => {}
            }
        }
        if self.sample.is_empty() {
            return Err(encoder_failed("no picture"));
        }
        Ok(EncodedPicture {
            sample: &self.sample,
            key,
        })
    }

    /// The parameter sets, after the first picture.
    pub(crate) fn sets(&self) -> Option<(&[u8], &[u8])> {
        let (sps, pps) = self.sets.as_ref()?;
        Some((sps, pps))
    }

    /// Keeps a set, which is the same for all pictures.
    fn set_of_kind(&mut self, sequence: bool, unit: Vec<u8>) -> Result<(), VideoError> {
        let (sps, pps) = self.sets.get_or_insert_default();
        let kept = if sequence { sps } else { pps };
        if kept.is_empty() {
            *kept = unit;
        } else if *kept != unit {
            return Err(encoder_failed("parameter sets that change"));
        }
        Ok(())
    }

    /// The set with cropping to the even part of the size, and the meaning of the samples.
    fn described(&self, mut sps: Sps) -> Sps {
        let (width, height) = sps.coded_size();
        let shown = |side: usize| side.next_multiple_of(2) as u32;
        sps.crop = [
            0,
            (width - shown(self.settings.size.width())) / 2,
            0,
            (height - shown(self.settings.size.height())) / 2,
        ];
        sps.vui = Some(Vui::of(self.settings.color, self.settings.pixel_aspect));
        sps
    }
}

fn encoder_failed(reason: impl std::fmt::Display) -> VideoError {
    VideoError::Io(std::io::Error::other(format!(
        "the H.264 encoder fails: {reason}"
    )))
}

fn even(side: usize) -> usize {
    side.next_multiple_of(2).max(MIN_SIDE)
}

fn samples(plane: &SamplePlane) -> Option<&ravec_raster::Image<u8>> {
    match plane {
        SamplePlane::U8(plane) => Some(plane),
        SamplePlane::U16(_) => None,
    }
}

/// The samples of a plane, with its last column and row repeated up to a size.
fn padded(plane: &ravec_raster::Image<u8>, width: usize, height: usize) -> Cow<'_, [u8]> {
    if (plane.width(), plane.height()) == (width, height) {
        return Cow::Borrowed(plane.pixels());
    }
    let mut samples = Vec::with_capacity(width * height);
    for row in 0..height {
        let line = plane.row(row.min(plane.height() - 1));
        samples.extend_from_slice(line);
        let last = line.last().copied().unwrap_or_default();
        samples.resize((row + 1) * width, last);
    }
    Cow::Owned(samples)
}
