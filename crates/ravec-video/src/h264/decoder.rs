//! Decoding of samples, one picture each.

use super::nal::{AvcConfig, NalKind, nal_units};
use super::sps::Sps;
use crate::color::ColorInfo;
use crate::yuv::{SamplePlane, YuvFormat, YuvImage};
use openh264::OpenH264API;
use openh264::decoder::{DecodedYUV, Decoder, DecoderConfig, Flush};
use openh264::formats::YUVSource as _;
use ravec_raster::Image;

/// Start code of a NAL unit.
const START: [u8; 4] = [0, 0, 0, 1];

/// The part of a coded frame that is shown; columns and rows are even.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Crop {
    /// First column.
    pub(crate) col: usize,
    /// First row.
    pub(crate) row: usize,
    /// Columns.
    pub(crate) width: usize,
    /// Rows.
    pub(crate) height: usize,
}

/// Memory that a decoder takes for frames of this coded size: its pool of references with their borders, and motion.
pub(crate) fn decoder_bytes(width: u32, height: u32) -> u64 {
    let padded = (u64::from(width) + 64) * (u64::from(height) + 64);
    // 17 references and the current picture, 3/2 samples and about 2 bytes of motion a pixel; 8 MiB for buffers of the stream
    padded * 18 * 7 / 2 + (8 << 20)
}

/// Decodes the samples of an AVC track.
pub(crate) struct AvcDecoder {
    decoder: Decoder,
    length_size: usize,
    sps: Sps,
    /// Parameter sets that the decoder has not got yet, with start codes.
    sets: Vec<u8>,
    /// A sample with start codes.
    stream: Vec<u8>,
}

impl AvcDecoder {
    /// A decoder for samples of a configuration whose first set is `sps`.
    pub(crate) fn new(config: &AvcConfig, sps: &Sps) -> Result<Self, String> {
        let options = DecoderConfig::new().flush_after_decode(Flush::NoFlush);
        let decoder = Decoder::with_api_config(OpenH264API::from_source(), options)
            .map_err(|error| error.to_string())?;
        let mut sets = Vec::new();
        for set in &config.sps {
            let set = Sps::parse(set).ok_or("a sequence parameter set is damaged")?;
            push_unit(&mut sets, &set.for_decoder());
        }
        for set in &config.pps {
            push_unit(&mut sets, set);
        }
        Ok(Self {
            decoder,
            length_size: config.length_size,
            sps: sps.clone(),
            sets,
            stream: Vec::new(),
        })
    }

    /// Decodes a sample. Its picture is returned if `crop` says which part of it is wanted.
    ///
    /// `Err` is the reason why the sample, and what depends on it, cannot be decoded.
    pub(crate) fn decode(
        &mut self,
        sample: &[u8],
        wanted: Option<(Crop, ColorInfo)>,
    ) -> Result<Option<YuvImage>, String> {
        self.stream.clear();
        self.stream.append(&mut self.sets);
        for nal in nal_units(sample, self.length_size) {
            let nal = nal.map_err(|()| "the lengths of its units do not fit")?;
            match NalKind::of(nal) {
                NalKind::Sps => {
                    let sps = Sps::parse(nal).ok_or("a sequence parameter set is damaged")?;
                    if let Some(feature) = sps.unsupported() {
                        return Err(format!("the clip goes on with {feature}"));
                    }
                    if !sps.same_pictures(&self.sps) {
                        return Err("the size of the frames changes".to_owned());
                    }
                    push_unit(&mut self.stream, &sps.for_decoder());
                }
                NalKind::Slice | NalKind::IdrSlice | NalKind::Pps => {
                    push_unit(&mut self.stream, nal);
                }
                NalKind::Partition => return Err("it is in data partitions".to_owned()),
                NalKind::Other => {}
            }
        }
        let decoded = self
            .decoder
            .decode(&self.stream)
            .map_err(|_| "its data are damaged or refer to missing frames")?
            .ok_or("it has no picture")?;
        let size = self.sps.coded_size();
        if decoded.dimensions() != (size.0 as usize, size.1 as usize) {
            return Err("the size of the frames changes".to_owned());
        }
        Ok(wanted.map(|(crop, color)| cut(&decoded, crop, color)))
    }
}

fn push_unit(stream: &mut Vec<u8>, unit: &[u8]) {
    stream.extend(START);
    stream.extend(unit);
}

/// True if decoding can start at the sample.
pub(super) fn starts_at(sample: &[u8], length_size: usize) -> bool {
    nal_units(sample, length_size)
        .any(|nal| nal.is_ok_and(|nal| NalKind::of(nal) == NalKind::IdrSlice))
}

impl AvcConfig {
    /// True if decoding can start at the sample.
    pub(crate) fn starts_at(&self, sample: &[u8]) -> bool {
        starts_at(sample, self.length_size)
    }
}

/// The wanted part of a decoded picture.
fn cut(decoded: &DecodedYUV, crop: Crop, color: ColorInfo) -> YuvImage {
    let strides = decoded.strides();
    let plane = |samples: &[u8], stride: usize, step: usize| {
        let (col, row) = (crop.col / step, crop.row / step);
        let (width, height) = (crop.width.div_ceil(step), crop.height.div_ceil(step));
        let mut pixels = Vec::with_capacity(width * height);
        for line in samples.chunks(stride).skip(row).take(height) {
            pixels.extend_from_slice(&line[col..col + width]);
        }
        SamplePlane::U8(Image::from_vec(width, pixels).expect("the crop lies in the frame"))
    };
    let planes = vec![
        plane(decoded.y(), strides.0, 1),
        plane(decoded.u(), strides.1, 2),
        plane(decoded.v(), strides.2, 2),
    ];
    YuvImage::new(YuvFormat::YUV420P8, color, planes).expect("planes of one crop")
}
