//! JPEG decoding with access to ink amounts, which the general decoder interface hides.
//!
//! Pictures that are wanted small are decoded at a half, a quarter or an eighth of their size by another decoder, which takes
//! the low frequencies of each block alone; what that one refuses is decoded whole.
//!
//! CMYK files store ink amounts inverted (255 = no ink), as Adobe's programs began to and all others follow.

use crate::quantization::Quantization;
use crate::samples::Channels;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// A JPEG file whose header has been read.
pub(crate) struct Jpeg {
    input: Vec<u8>,
    stored: ColorSpace,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) icc: Option<Vec<u8>>,
    pub(crate) exif: Option<Vec<u8>>,
    /// The picture in less than its size.
    reduced: Option<Vec<u8>>,
}

/// A smaller size in which a picture can be decoded.
pub(crate) struct Reduction {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// Bytes that this takes at its peak, beside the encoded data.
    pub(crate) bytes: u64,
    /// Bytes of the reduced samples, which stay.
    pub(crate) samples: u64,
}

impl Jpeg {
    pub(crate) fn open(input: Vec<u8>) -> Result<Self, DecodeErrors> {
        let mut decoder = decoder(&input, options());
        decoder.decode_headers()?;
        let (width, height) = decoder.dimensions().unwrap_or_default();
        let stored = decoder.input_colorspace().unwrap_or(ColorSpace::RGB);
        let icc = decoder.icc_profile();
        let exif = decoder.exif().cloned();
        drop(decoder);
        Ok(Self {
            stored,
            width: width as u32,
            height: height as u32,
            icc,
            exif,
            input,
            reduced: None,
        })
    }

    pub(crate) fn channels(&self) -> Channels {
        match self.stored {
            ColorSpace::Luma => Channels::Gray,
            ColorSpace::CMYK | ColorSpace::YCCK => Channels::Cmyk,
            _ => Channels::Rgb,
        }
    }

    /// Quantization of the luma, if the file has one and is decoded at its size.
    pub(crate) fn quantization(&self) -> Option<Quantization> {
        let has_luma = matches!(self.stored, ColorSpace::Luma | ColorSpace::YCbCr);
        let is_whole = self.reduced.is_none();
        (has_luma && is_whole)
            .then(|| Quantization::of_jpeg(&self.input))
            .flatten()
    }

    /// Returns `true` if no marker ends the picture. The decoder then fills the missing part with gray.
    pub(crate) fn is_truncated(&self) -> bool {
        !self.input.windows(2).rev().any(|pair| pair == [0xff, 0xd9])
    }

    /// A plan to decode at the least size whose shorter side has still `min_side` pixels, if there is such a size below
    /// the whole one.
    pub(crate) fn reduction(&self, min_side: u32) -> Option<Reduction> {
        let shorter = self.width.min(self.height);
        let factor = [8, 4, 2]
            .into_iter()
            .find(|factor| shorter / factor >= min_side)?;
        let wanted = match self.channels() {
            Channels::Gray => jpeg_decoder::PixelFormat::L8,
            Channels::Rgb => jpeg_decoder::PixelFormat::RGB24,
            _ => return None,
        };
        let mut decoder = jpeg_decoder::Decoder::new(self.input.as_slice());
        // sides of JPEG files have 16 bits
        let side = |pixels: u32| pixels.div_ceil(factor) as u16;
        let (width, height) = decoder.scale(side(self.width), side(self.height)).ok()?;
        let format = decoder.info()?.pixel_format;
        let (width, height) = (u32::from(width), u32::from(height));
        if format != wanted || width >= self.width {
            return None;
        }
        let channels = self.channels().count() as u64;
        let pixels = u64::from(width) * u64::from(height);
        // progressive files keep all coefficients until the last scan, others as many as wait for their transform
        let coefficients = 2 * (u64::from(self.width) + 64) * (u64::from(self.height) + 64);
        Some(Reduction {
            width,
            height,
            // planes of the channels, with whole blocks, and the interleaved samples
            bytes: channels
                * (coefficients + (u64::from(width) + 64) * (u64::from(height) + 64) + pixels),
            samples: channels * pixels,
        })
    }

    /// Decodes by a plan of [`reduction`](Self::reduction). Width and height are then those of the reduced picture; what the
    /// decoder refuses stays as it is.
    pub(crate) fn reduce(&mut self, plan: &Reduction) {
        let mut decoder = jpeg_decoder::Decoder::new(self.input.as_slice());
        let most = usize::try_from(plan.bytes).unwrap_or(usize::MAX);
        decoder.set_max_decoding_buffer_size(most);
        let side = |pixels: u32| pixels as u16;
        if decoder.scale(side(plan.width), side(plan.height)).is_err() {
            return;
        }
        if let Ok(samples) = decoder.decode()
            && samples.len() as u64 == plan.samples
        {
            self.reduced = Some(samples);
            (self.width, self.height) = (plan.width, plan.height);
        }
    }

    /// Takes the picture for reduced, to find out what decoding it needs.
    pub(crate) fn expect_reduced(&mut self, plan: &Reduction) {
        self.reduced = Some(Vec::new());
        (self.width, self.height) = (plan.width, plan.height);
    }

    pub(crate) fn is_reduced(&self) -> bool {
        self.reduced.is_some()
    }

    pub(crate) fn reduced_bytes(&self) -> u64 {
        self.reduced
            .as_ref()
            .map_or(0, |samples| samples.len() as u64)
    }

    /// Fills `samples` with one byte a channel.
    pub(crate) fn decode(&self, samples: &mut [u8]) -> Result<(), DecodeErrors> {
        if let Some(reduced) = &self.reduced {
            samples.copy_from_slice(reduced);
            return Ok(());
        }
        let wanted = match (self.channels(), self.stored) {
            (Channels::Gray, _) => ColorSpace::Luma,
            (Channels::Cmyk, stored) => stored,
            _ => ColorSpace::RGB,
        };
        decoder(&self.input, options().jpeg_set_out_colorspace(wanted)).decode_into(samples)?;
        if self.channels() == Channels::Cmyk {
            ink_amounts(samples, self.stored == ColorSpace::YCCK);
        }
        Ok(())
    }
}

fn options() -> DecoderOptions {
    DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(usize::MAX)
        .set_max_height(usize::MAX)
}

fn decoder(input: &[u8], options: DecoderOptions) -> JpegDecoder<ZCursor<&[u8]>> {
    JpegDecoder::new_with_options(ZCursor::new(input), options)
}

/// Ink amounts (255 = all ink) from what the file stores: inverted ones, or their YCbCr transform and inverted black.
fn ink_amounts(samples: &mut [u8], ycck: bool) {
    for pixel in samples.chunks_exact_mut(4) {
        if ycck {
            // the transform is that of JFIF, applied to inks as if they were colors
            let [y, cb, cr] = [pixel[0], pixel[1], pixel[2]].map(f32::from);
            let (cb, cr) = (cb - 128.0, cr - 128.0);
            pixel[0] = (y + 1.402 * cr + 0.5) as u8;
            pixel[1] = (y - 0.344_136 * cb - 0.714_136 * cr + 0.5) as u8;
            pixel[2] = (y + 1.772 * cb + 0.5) as u8;
            pixel[3] = 255 - pixel[3];
        } else {
            for sample in pixel {
                *sample = 255 - *sample;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inks_are_recovered_from_both_ways_of_storing() {
        let mut plain = vec![255, 155, 55, 0];
        ink_amounts(&mut plain, false);
        assert_eq!(plain, [0, 100, 200, 255]);
        // gray inks have no chroma
        let mut transformed = vec![77, 128, 128, 200];
        ink_amounts(&mut transformed, true);
        assert_eq!(transformed, [77, 77, 77, 55]);
    }
}
