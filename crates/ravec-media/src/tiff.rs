//! TIFF decoding with access to ink amounts, single float channels and the kind of alpha, which the general decoder
//! interface does not have.

use crate::picture::SampleKind;
use crate::samples::{Channels, Samples};
use image::metadata::Orientation;
use std::io::{self, BufRead, Seek, SeekFrom};
use tiff::decoder::{Decoder, Limits};
use tiff::tags::{SampleFormat, Tag};
use tiff::{ColorType, TiffError, TiffUnsupportedError};

/// Source of any type from which a decoder can be made.
pub(crate) trait Source: BufRead + Seek {}
impl<T: BufRead + Seek> Source for T {}

/// A TIFF file whose first directory has been read.
pub(crate) struct Tiff<'a> {
    decoder: Decoder<&'a mut dyn Source>,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) channels: Channels,
    pub(crate) sample: SampleKind,
    pub(crate) icc: Option<Vec<u8>>,
    pub(crate) orientation: Orientation,
    /// `true` if colors are multiplied by alpha.
    pub(crate) premultiplied: bool,
    /// Bits of one stored sample: 1, 2 and 4 are spread to 8.
    bits: u8,
    /// Bytes that the decoder fills.
    stored_bytes: usize,
    planes: usize,
}

/// Bytes that the decoder takes for one value of a directory entry.
const VALUE_BYTES: u64 = 32;

impl<'a> Tiff<'a> {
    pub(crate) fn open(
        input: &'a mut dyn Source,
        length: u64,
        max_bytes: u64,
    ) -> Result<Self, TiffError> {
        check_directory(input, length, max_bytes)?;
        input.seek(SeekFrom::Start(0))?;
        let bound = usize::try_from(max_bytes).unwrap_or(usize::MAX);
        let mut limits = Limits::default();
        limits.decoding_buffer_size = bound;
        limits.intermediate_buffer_size = bound;
        limits.ifd_value_size = bound;
        let mut decoder = Decoder::new(input)?.with_limits(limits);

        let (width, height) = decoder.dimensions()?;
        let color = decoder.colortype()?;
        let layout = decoder.image_buffer_layout()?;
        let (channels, bits) = match color {
            ColorType::Gray(bits) => (Channels::Gray, bits),
            ColorType::GrayA(bits)
            | ColorType::Multiband {
                bit_depth: bits,
                num_samples: 2,
            } => (Channels::GrayAlpha, bits),
            ColorType::RGB(bits) => (Channels::Rgb, bits),
            ColorType::RGBA(bits) => (Channels::Rgba, bits),
            ColorType::CMYK(bits) => (Channels::Cmyk, bits),
            color => return Err(unsupported(color)),
        };
        let sample = match (layout.sample_format, bits) {
            (SampleFormat::Uint, 1 | 2 | 4) if channels == Channels::Gray => SampleKind::U8,
            (SampleFormat::Uint, 8) => SampleKind::U8,
            (SampleFormat::Uint, 16) => SampleKind::U16,
            (SampleFormat::IEEEFP, 32) if channels != Channels::Cmyk => SampleKind::F32,
            _ => return Err(unsupported(color)),
        };
        let stored = usize::from(
            decoder
                .find_tag_unsigned(Tag::SamplesPerPixel)?
                .unwrap_or(1u16),
        );
        if stored != channels.count() {
            return Err(unsupported(color));
        }
        // 1 is alpha that colors are multiplied by; 2 is straight
        let extra = decoder.find_tag_unsigned_vec::<u16>(Tag::ExtraSamples)?;
        let orientation = decoder
            .find_tag_unsigned::<u8>(Tag::Orientation)
            .ok()
            .flatten();
        Ok(Self {
            width,
            height,
            channels,
            sample,
            icc: decoder.get_tag_u8_vec(Tag::IccProfile).ok(),
            orientation: orientation
                .and_then(Orientation::from_exif)
                .unwrap_or(Orientation::NoTransforms),
            premultiplied: channels.has_alpha()
                && extra.is_some_and(|kinds| kinds.first() == Some(&1)),
            bits,
            stored_bytes: layout.complete_len,
            planes: layout.planes.max(1),
            decoder,
        })
    }

    /// Returns `true` if other pages follow the first one.
    pub(crate) fn has_more_pages(&self) -> bool {
        self.decoder.more_images()
    }

    /// Returns `true` if samples lie in the file as they do in memory.
    fn is_plain(&self) -> bool {
        self.planes == 1 && self.bits >= 8
    }

    /// Bytes needed besides the samples.
    pub(crate) fn working_bytes(&self, decoded: u64) -> u64 {
        // a strip before its decompression, and the picture once more if it must be rearranged
        decoded / 2
            + if self.is_plain() {
                0
            } else {
                self.stored_bytes as u64
            }
    }

    pub(crate) fn decode(mut self, samples: &mut Samples) -> Result<(), TiffError> {
        let bytes = samples.as_bytes_mut();
        if self.is_plain() {
            return self.decoder.read_image_bytes(bytes);
        }
        let mut stored = vec![0; self.stored_bytes];
        self.decoder.read_image_bytes(&mut stored)?;
        if self.bits < 8 {
            spread(&stored, bytes, self.bits, self.width as usize);
        } else {
            interleave(&stored, bytes, self.planes, self.sample.bytes());
        }
        Ok(())
    }
}

fn unsupported(color: ColorType) -> TiffError {
    TiffError::UnsupportedError(TiffUnsupportedError::UnsupportedColorType(color))
}

/// Whole bytes from samples of 1, 2 or 4 bits, packed from the high bit in rows of whole bytes.
fn spread(packed: &[u8], bytes: &mut [u8], bits: u8, width: usize) {
    let per_byte = usize::from(8 / bits);
    let largest = (1u8 << bits) - 1;
    let rows = bytes.chunks_exact_mut(width);
    for (row, packed) in rows.zip(packed.chunks_exact(width.div_ceil(per_byte))) {
        for (col, byte) in row.iter_mut().enumerate() {
            let shift = 8 - bits * (1 + (col % per_byte) as u8);
            *byte = (packed[col / per_byte] >> shift & largest) * (255 / largest);
        }
    }
}

/// Pixel by pixel from plane by plane.
fn interleave(planar: &[u8], bytes: &mut [u8], planes: usize, sample_bytes: usize) {
    let plane_bytes = planar.len() / planes;
    for (plane, planar) in planar.chunks_exact(plane_bytes).enumerate() {
        let places = bytes
            .chunks_exact_mut(sample_bytes)
            .skip(plane)
            .step_by(planes);
        for (place, sample) in places.zip(planar.chunks_exact(sample_bytes)) {
            place.copy_from_slice(sample);
        }
    }
}

/// Refuses a first directory with an entry that claims more values than the file can hold or the limit allows: the
/// decoder makes room for all of them first.
fn check_directory(input: &mut dyn Source, length: u64, max_bytes: u64) -> Result<(), TiffError> {
    let mut order = [0; 4];
    input.read_exact(&mut order)?;
    let little = order[0] == b'I';
    let big = order[if little { 2 } else { 3 }] == 43;
    let number = |input: &mut dyn Source, bytes: usize| -> io::Result<u64> {
        let mut value = [0; 8];
        input.read_exact(&mut value[..bytes])?;
        if little {
            Ok(u64::from_le_bytes(value))
        } else {
            value[..bytes].reverse();
            Ok(u64::from_le_bytes(value))
        }
    };
    // (offset of the directory, its count, an entry's count and value) have these widths
    let (wide, count_bytes) = if big { (8, 8) } else { (4, 2) };
    if big {
        number(input, 4)?;
    }
    let directory = number(input, wide)?;
    input.seek(SeekFrom::Start(directory))?;
    let entries = number(input, count_bytes)?;
    for _ in 0..entries.min(length) {
        let _tag = number(input, 2)?;
        let kind = number(input, 2)?;
        let count = number(input, wide)?;
        let _value = number(input, wide)?;
        let value_bytes = match kind {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16 | 17 | 18 => 8,
            _ => 1,
        };
        if count.saturating_mul(value_bytes) > length {
            return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
        }
        if count.saturating_mul(VALUE_BYTES) > max_bytes / 4 {
            return Err(TiffError::LimitsExceeded);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_samples_fill_the_range_of_a_byte() {
        let mut bytes = [0; 6];
        spread(&[0b1010_0000, 0b0110_0000], &mut bytes, 1, 3);
        assert_eq!(bytes, [255, 0, 255, 0, 255, 255]);
        let mut bytes = [0; 3];
        spread(&[0x0f, 0x50], &mut bytes, 4, 3);
        assert_eq!(bytes, [0, 255, 85]);
        spread(&[0b0001_1000], &mut bytes, 2, 3);
        assert_eq!(bytes, [0, 85, 170]);
    }

    #[test]
    fn planes_are_interleaved() {
        let mut bytes = [0; 8];
        interleave(&[1, 2, 3, 4, 5, 6, 7, 8], &mut bytes, 2, 2);
        assert_eq!(bytes, [1, 2, 5, 6, 3, 4, 7, 8]);
    }
}
