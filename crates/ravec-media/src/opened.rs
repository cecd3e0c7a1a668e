//! A file between header and pixels: its decoder, its metadata, and the cost of decoding it.

use crate::format::Format;
use crate::jpeg::Jpeg;
use crate::limits::{Limits, over_budget};
use crate::orient;
use crate::picture::{Charge, Origin, Picture, SampleKind, Warning};
use crate::profile::{self, Profile};
use crate::read::{DecodeError, Probe};
use crate::samples::{self, Channels, Samples};
use crate::tiff::{Source, Tiff};
use ::tiff::TiffError;
use image::codecs::{bmp, hdr, openexr, png, webp};
use image::metadata::Orientation;
use image::{ColorType, ImageDecoder, ImageError, ImageResult};
use ravec_memory::Reservation;
use ravec_raster::Size;
use std::error::Error as _;
use std::io::{self, Read as _, SeekFrom};

/// A file whose header has been read.
pub(crate) struct Opened<'a> {
    format: Format,
    decoder: Decoder<'a>,
    width: u32,
    height: u32,
    channels: Channels,
    sample: SampleKind,
    /// `true` if colors are multiplied by alpha, as `OpenEXR` has it.
    premultiplied: bool,
    orientation: Orientation,
    icc: Option<Vec<u8>>,
    exif: Option<Vec<u8>>,
    warnings: Vec<Warning>,
    /// Bytes of the blocks that a decoder holds beside the picture.
    block_bytes: u64,
    /// Memory for the encoded data that are held here, and later for decoding.
    memory: Reservation,
    limits: Limits,
}

enum Decoder<'a> {
    General(Box<dyn ImageDecoder + 'a>),
    Jpeg(Jpeg),
    Tiff(Box<Tiff<'a>>),
}

impl<'a> Opened<'a> {
    pub(crate) fn new(
        format: Format,
        input: &'a mut dyn Source,
        limits: &Limits,
    ) -> Result<Self, DecodeError> {
        let length = input.seek(SeekFrom::End(0))?;
        input.seek(SeekFrom::Start(0))?;
        let mut opened = match format {
            Format::Jpeg => Self::open_jpeg(input, length, limits)?,
            Format::Tiff => Self::open_tiff(input, length, limits)?,
            Format::WebP => Self::open_webp(input, length, limits)?,
            Format::OpenExr => Self::open_exr(input, limits)?,
            _ => Self::open_general(format, input, limits, true)
                .map_err(|error| decode_error(format, error, limits))?,
        };
        limits.check_pixels(opened.width.into(), opened.height.into())?;
        if let Some(exif) = opened.exif.take() {
            opened.take_exif(exif);
        }
        Ok(opened)
    }

    fn open_jpeg(
        input: &mut dyn Source,
        length: u64,
        limits: &Limits,
    ) -> Result<Self, DecodeError> {
        let memory = limits.memory.reserve(length);
        let memory = memory.map_err(|over| over_budget(over, 0))?;
        let mut data = Vec::with_capacity(length as usize);
        input.take(length).read_to_end(&mut data)?;
        let mut jpeg = Jpeg::open(data).map_err(|error| jpeg_error(&error))?;
        let mut warnings = Vec::new();
        if jpeg.is_truncated() {
            warnings.push(Warning::Truncated);
        }
        Ok(Self {
            format: Format::Jpeg,
            width: jpeg.width,
            height: jpeg.height,
            channels: jpeg.channels(),
            sample: SampleKind::U8,
            premultiplied: false,
            orientation: Orientation::NoTransforms,
            icc: jpeg.icc.take(),
            exif: jpeg.exif.take(),
            decoder: Decoder::Jpeg(jpeg),
            warnings,
            block_bytes: 0,
            memory,
            limits: limits.clone(),
        })
    }

    fn open_tiff(
        input: &'a mut dyn Source,
        length: u64,
        limits: &Limits,
    ) -> Result<Self, DecodeError> {
        let mut tiff = Tiff::open(input, length, limits.memory.available())
            .map_err(|error| tiff_error(error, limits))?;
        let mut warnings = Vec::new();
        if tiff.has_more_pages() {
            warnings.push(Warning::OnlyFirstPage);
        }
        Ok(Self {
            format: Format::Tiff,
            width: tiff.width,
            height: tiff.height,
            channels: tiff.channels,
            sample: tiff.sample,
            premultiplied: tiff.premultiplied,
            orientation: tiff.orientation,
            icc: tiff.icc.take(),
            exif: None,
            decoder: Decoder::Tiff(Box::new(tiff)),
            warnings,
            block_bytes: 0,
            memory: limits.memory.reserve_nothing(),
            limits: limits.clone(),
        })
    }

    fn open_webp(
        mut input: &'a mut dyn Source,
        length: u64,
        limits: &Limits,
    ) -> Result<Self, DecodeError> {
        let format = Format::WebP;
        let claims = crate::webp::claims(&mut input, length)?;
        if !claims.frames_fit {
            return Err(DecodeError::Damaged {
                format,
                reason: "a frame is larger than the picture".into(),
            });
        }
        let mut opened = Self::open_general(format, input, limits, claims.metadata_is_whole)
            .map_err(|error| decode_error(format, error, limits))?;
        if !claims.metadata_is_whole {
            opened.warnings.push(Warning::Truncated);
        }
        Ok(opened)
    }

    fn open_exr(mut input: &'a mut dyn Source, limits: &Limits) -> Result<Self, DecodeError> {
        let format = Format::OpenExr;
        let claims = crate::exr::claims(&mut input)?;
        limits.check_pixels(claims.width, claims.height)?;
        // a block before and after its decompression
        let block_bytes = claims.block_bytes.saturating_mul(2);
        if !claims.has_colors && !claims.channels.is_empty() {
            const MAX_NAMED: usize = 8;
            let mut names = claims.channels;
            let more = if names.len() > MAX_NAMED { ", …" } else { "" };
            names.truncate(MAX_NAMED);
            return Err(DecodeError::Unsupported {
                format,
                reason: format!(
                    "it has the channels {}{more}, and a picture needs R, G and B",
                    one_line(&names.join(", "))
                ),
            });
        }
        let blocks = limits.memory.reserve(block_bytes);
        drop(blocks.map_err(|over| over_budget(over, 0))?);
        let mut opened = Self::open_general(format, input, limits, true)
            .map_err(|error| decode_error(format, error, limits))?;
        opened.block_bytes = block_bytes;
        if claims.other_primaries {
            let what = "primaries of its own".to_owned();
            opened.warnings.push(Warning::ColorsTakenAsSrgb { what });
        }
        Ok(opened)
    }

    /// Without `metadata` neither profile nor EXIF block are read.
    fn open_general(
        format: Format,
        input: &'a mut dyn Source,
        limits: &Limits,
        metadata: bool,
    ) -> ImageResult<Self> {
        let mut bounds = image::Limits::no_limits();
        bounds.max_alloc = Some(limits.memory.available());
        let mut warnings = Vec::new();
        let mut decoder: Box<dyn ImageDecoder + 'a> = match format {
            Format::Png => {
                if let Some(what) = crate::png::other_colors(input)? {
                    warnings.push(Warning::ColorsTakenAsSrgb { what });
                }
                let decoder = png::PngDecoder::with_limits(input, bounds.clone())?;
                if decoder.is_apng()? {
                    warnings.push(Warning::OnlyFirstFrame);
                }
                Box::new(decoder)
            }
            Format::WebP => {
                let decoder = webp::WebPDecoder::new(input)?;
                if decoder.has_animation() {
                    warnings.push(Warning::OnlyFirstFrame);
                }
                Box::new(decoder)
            }
            Format::Bmp => Box::new(bmp::BmpDecoder::new(input)?),
            Format::OpenExr => Box::new(openexr::OpenExrDecoder::new(input)?),
            // the strict decoder insists on one of the two names of the format
            _ => Box::new(hdr::HdrDecoder::new_nonstrict(input)?),
        };
        decoder.set_limits(bounds)?;
        let (width, height) = decoder.dimensions();
        let (channels, sample) = layout(decoder.color_type());
        let (mut orientation, mut icc, mut exif) = (Orientation::NoTransforms, None, None);
        if metadata {
            orientation = decoder.orientation().unwrap_or(orientation);
            icc = decoder.icc_profile().ok().flatten();
            exif = decoder.exif_metadata().ok().flatten();
        }
        Ok(Self {
            format,
            width,
            height,
            channels,
            sample,
            premultiplied: format == Format::OpenExr,
            orientation,
            icc,
            exif,
            decoder: Decoder::General(decoder),
            warnings,
            block_bytes: 0,
            memory: limits.memory.reserve_nothing(),
            limits: limits.clone(),
        })
    }

    /// Keeps an EXIF block that begins as one must, and moves its orientation from there to here.
    fn take_exif(&mut self, mut exif: Vec<u8>) {
        if exif.starts_with(b"Exif\0\0") {
            exif.drain(..6);
        }
        if exif.starts_with(b"II*\0") || exif.starts_with(b"MM\0*") {
            if let Some(orientation) = Orientation::remove_from_exif_chunk(&mut exif) {
                self.orientation = orientation;
            }
            self.exif = Some(exif);
        }
    }

    pub(crate) fn probe(&self) -> Result<Probe, DecodeError> {
        let size = Size::new(self.width as usize, self.height as usize)?;
        Ok(Probe {
            format: self.format,
            size: if orient::transposes(self.orientation) {
                size.transposed()
            } else {
                size
            },
            sample: self.sample,
            gray: self.channels.is_gray(),
            alpha: self.channels.has_alpha(),
            orientation: self.orientation.to_exif(),
            profile: self
                .icc
                .as_deref()
                .map(|icc| profile::description(icc).unwrap_or_default()),
        })
    }

    /// Charges what holds the encoded data to this file.
    pub(crate) fn charge_input(&mut self, kept: Reservation) {
        self.memory.absorb(kept);
    }

    /// Decodes a JPEG file at a fraction of its size, if its shorter side has then still `min_side` pixels.
    pub(crate) fn reduce(&mut self, min_side: u32) {
        if let Decoder::Jpeg(jpeg) = &mut self.decoder
            && let Some(plan) = jpeg.reduction(min_side)
            // a plan above the limit here exceeds it when the picture is decoded whole, which is reported then
            && self.memory.grow(plan.bytes).is_ok()
        {
            let encoded = self.memory.bytes() - plan.bytes;
            jpeg.reduce(&plan);
            (self.width, self.height) = (jpeg.width, jpeg.height);
            self.memory.shrink_to(encoded + jpeg.reduced_bytes());
        }
    }

    /// Bytes that will be reserved at the peak, if the picture is decoded at a fraction of its size down to `min_side`
    /// where that is possible.
    pub(crate) fn need(mut self, min_side: Option<u32>) -> u64 {
        let (mut reducing, mut held) = (0, self.memory.bytes());
        if let (Some(min_side), Decoder::Jpeg(jpeg)) = (min_side, &mut self.decoder)
            && let Some(plan) = jpeg.reduction(min_side)
        {
            reducing = held + plan.bytes;
            held += plan.samples;
            (self.width, self.height) = (plan.width, plan.height);
            jpeg.expect_reduced(&plan);
        }
        let profile = self.profile();
        let active = self.active(profile.as_ref());
        reducing.max(held + self.memory_to_decode(active))
    }

    /// The profile, if colors must be converted by it.
    fn active<'p>(&self, profile: Option<&'p Profile>) -> Option<&'p Profile> {
        // sRGB is what integers are, and its light what floats are
        profile.filter(|profile| match self.sample {
            SampleKind::F32 => !profile.is_linear_srgb(),
            _ => !matches!(profile, Profile::Srgb),
        })
    }

    pub(crate) fn decode(mut self) -> Result<Picture, DecodeError> {
        let size = Size::new(self.width as usize, self.height as usize)?;
        let profile = self.profile();
        let active = self.active(profile.as_ref());
        let needed = self.memory_to_decode(active);
        let mut memory = self.memory;
        memory
            .grow(needed)
            .map_err(|over| over_budget(over, memory.bytes()))?;
        let limits = &self.limits;
        let count = size.pixels() * self.channels.count();
        let mut samples = Samples::zeroed(self.sample, count)
            .map_err(|_| DecodeError::OutOfMemory { bytes: needed })?;

        let quantization = match &self.decoder {
            Decoder::Jpeg(jpeg) => jpeg
                .quantization()
                .map(|stored| stored.upright(self.orientation, size.width(), size.height())),
            _ => None,
        };
        match self.decoder {
            Decoder::General(decoder) => decoder
                .read_image_boxed(samples.as_bytes_mut())
                .map_err(|error| decode_error(self.format, error, limits))?,
            Decoder::Jpeg(jpeg) => jpeg
                .decode(samples.as_bytes_mut())
                .map_err(|error| jpeg_error(&error))?,
            Decoder::Tiff(tiff) => tiff
                .decode(&mut samples)
                .map_err(|error| tiff_error(error, limits))?,
        }
        self.warnings.extend(samples.make_finite());
        if self.premultiplied && self.channels.has_alpha() {
            self.warnings.extend(samples.unmultiply(self.channels));
        }

        let mut channels = self.channels;
        if channels == Channels::Cmyk && profile.is_none() {
            samples = samples.into_plain_colors();
            channels = Channels::Rgb;
            self.warnings.push(Warning::CmykWithoutProfile);
        }
        let mut image = samples
            .into_image(channels, size, active)
            .map_err(|reason| DecodeError::Unsupported {
                format: self.format,
                reason,
            })?;
        samples::bound(&mut image);
        let image = orient::upright(image, self.orientation);
        memory.shrink_to(samples::bytes(&image));
        Ok(Picture {
            image,
            charge: Charge::new(memory),
            origin: Origin {
                format: Some(self.format),
                sample: self.sample,
                gray: self.channels.is_gray(),
                icc: self.icc.map(Into::into),
                exif: self.exif.map(Into::into),
                quantization,
            },
            warnings: self.warnings,
        })
    }

    /// The embedded profile, if it can be used; else it is dropped with a warning.
    fn profile(&mut self) -> Option<Profile> {
        let icc = self.icc.as_ref()?;
        let colors = self.channels.count() - usize::from(self.channels.has_alpha());
        let reason = match Profile::parse(icc) {
            Ok(profile) if profile.suits(colors) => return Some(profile),
            Ok(_) => "it is for another number of channels".into(),
            Err(reason) => reason,
        };
        self.icc = None;
        self.warnings.push(Warning::ProfileIgnored { reason });
        None
    }

    /// Bytes that decoding holds at its peak, at most, beside the encoded data.
    fn memory_to_decode(&self, profile: Option<&Profile>) -> u64 {
        let pixels = u64::from(self.width) * u64::from(self.height);
        let channels = self.channels.count() as u64;
        let decoded = pixels * channels * self.sample.bytes() as u64;
        // blocks at the border are whole
        let padded = (u64::from(self.width) + 64) * (u64::from(self.height) + 64);
        let decoder = match (&self.decoder, self.format) {
            // progressive files: a 16-bit coefficient for each sample
            (Decoder::Jpeg(jpeg), _) if jpeg.is_reduced() => 0,
            (Decoder::Jpeg(_), _) => 2 * channels * padded,
            // planes of a lossy frame, its alpha, a canvas of an animation
            (_, Format::WebP) => 12 * padded,
            (Decoder::Tiff(tiff), _) => tiff.working_bytes(decoded),
            // a buffer of its own, and a block before its decompression
            (_, Format::OpenExr) => (decoded + decoded / 2).saturating_add(self.block_bytes),
            _ => 64 * u64::from(self.width),
        };
        let image_channels = 3 + u64::from(self.channels.has_alpha());
        let image = match profile {
            Some(_) => pixels * image_channels * 4,
            None => pixels * image_channels * self.sample.bytes() as u64,
        };
        let conversion = match profile {
            // tables go through a second image, with alpha
            Some(Profile::Table(_)) => image + pixels * 16,
            Some(_) => image,
            None if self.channels.is_gray() => image,
            None => 0,
        };
        let turned = if orient::transposes(self.orientation) {
            image
        } else {
            0
        };
        decoded
            .saturating_add(decoder.max(conversion))
            .max(image + turned)
    }
}

fn layout(color: ColorType) -> (Channels, SampleKind) {
    match color {
        ColorType::L8 => (Channels::Gray, SampleKind::U8),
        ColorType::La8 => (Channels::GrayAlpha, SampleKind::U8),
        ColorType::Rgb8 => (Channels::Rgb, SampleKind::U8),
        ColorType::Rgba8 => (Channels::Rgba, SampleKind::U8),
        ColorType::L16 => (Channels::Gray, SampleKind::U16),
        ColorType::La16 => (Channels::GrayAlpha, SampleKind::U16),
        ColorType::Rgb16 => (Channels::Rgb, SampleKind::U16),
        ColorType::Rgba16 => (Channels::Rgba, SampleKind::U16),
        ColorType::Rgb32F => (Channels::Rgb, SampleKind::F32),
        // the enum is open; a new type would fail the length check of its decoder
        _ => (Channels::Rgba, SampleKind::F32),
    }
}

fn decode_error(format: Format, error: ImageError, limits: &Limits) -> DecodeError {
    match error {
        ImageError::Unsupported(error) => DecodeError::Unsupported {
            format,
            reason: error.to_string(),
        },
        ImageError::Limits(_) => too_much_on_the_way(limits),
        ImageError::IoError(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
            DecodeError::Damaged {
                format,
                reason: "it ends early".into(),
            }
        }
        ImageError::IoError(error) if error.raw_os_error().is_some() => DecodeError::Io(error),
        error => {
            // the outer error names the format, as ours does
            let reason = error
                .source()
                .map_or_else(|| error.to_string(), ToString::to_string);
            DecodeError::Damaged {
                format,
                reason: one_line(&reason),
            }
        }
    }
}

/// A decoder found on its way that the memory does not suffice.
fn too_much_on_the_way(limits: &Limits) -> DecodeError {
    DecodeError::TooManyBytes {
        bytes: None,
        others: 0,
        limit: limits.memory.limit(),
    }
}

fn tiff_error(error: TiffError, limits: &Limits) -> DecodeError {
    let format = Format::Tiff;
    match error {
        TiffError::IoError(error) => decode_error(format, ImageError::IoError(error), limits),
        TiffError::UnsupportedError(what) => DecodeError::Unsupported {
            format,
            reason: what.to_string(),
        },
        TiffError::LimitsExceeded => too_much_on_the_way(limits),
        error => DecodeError::Damaged {
            format,
            reason: one_line(&error.to_string()),
        },
    }
}

fn jpeg_error(error: &zune_jpeg::errors::DecodeErrors) -> DecodeError {
    use zune_jpeg::errors::DecodeErrors;
    let format = Format::Jpeg;
    match error {
        DecodeErrors::Unsupported(what) => DecodeError::Unsupported {
            format,
            reason: format!("{what:?}"),
        },
        DecodeErrors::IoErrors(_) | DecodeErrors::ExhaustedData => DecodeError::Damaged {
            format,
            reason: "it ends early".into(),
        },
        error => DecodeError::Damaged {
            format,
            reason: one_line(&error.to_string()),
        },
    }
}

/// The words of a decoder as part of a sentence. Decoders quote the file, so that control characters are escaped and the end
/// of a long text is left out.
fn one_line(text: &str) -> String {
    const MAX_CHARS: usize = 200;
    let words: Vec<_> = text.split_whitespace().collect();
    let line = words.join(" ");
    let line = line.trim_end_matches('.');
    let escaped = |c: char| {
        let control = c.is_control().then(|| c.escape_default());
        control.map_or_else(|| c.to_string(), |escape| escape.to_string())
    };
    let mut text: String = line.chars().take(MAX_CHARS).map(escaped).collect();
    if line.chars().nth(MAX_CHARS).is_some() {
        text.push('…');
    }
    text
}
