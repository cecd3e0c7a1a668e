//! Writing pictures.

use crate::format::{self, Format};
use crate::picture::{Picture, SampleKind, Warning};
use crate::raster::Raster;
use crate::read::display_path;
use image::codecs::{bmp, hdr, jpeg, openexr, png, tiff, webp};
use image::{ImageEncoder, ImageError};
use ravec_files::{is_stream, write_atomically};
use ravec_raster::{Size, Srgb};
use std::io::{self, BufWriter, Cursor, Seek, Write};
use std::path::{Path, PathBuf};

/// Options for writing a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteOptions {
    /// The format (default: by the target's extension; for standard output the source's format, else PNG).
    pub format: Option<Format>,
    /// Sample kind (default: that of the source). The format's nearest kind is taken; without a choice, float pictures
    /// go into integer formats with 16 bit where there are 16 bit.
    pub sample: Option<SampleKind>,
    /// Quality of JPEG, 1 to 100 (default 92). Higher is larger and closer to the picture.
    pub quality: u8,
    /// The color space of the file (default: the source's).
    pub profile: ProfileChoice,
    /// Background under transparent parts in formats without alpha (default white).
    pub background: Srgb<u8>,
}

impl Default for WriteOptions {
    fn default() -> Self {
        Self {
            format: None,
            sample: None,
            quality: 92,
            profile: ProfileChoice::Keep,
            background: Srgb([255; 3]),
        }
    }
}

/// The color space that a file is written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ProfileChoice {
    /// That of the source, if it has a profile that can be computed backwards (curves and a matrix, or one curve for
    /// gray) and the target format can say so; otherwise sRGB.
    #[default]
    Keep,
    /// sRGB.
    Srgb,
}

/// Why a picture could not be encoded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The target cannot be written.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The target's extension does not say a format that is written.
    #[error(
        "its extension does not name a picture format; known are {}",
        format::known_extensions()
    )]
    UnknownExtension,
    /// The format cannot hold a picture of this size.
    #[error("a {format} file can have at most {limit} pixels on a side, the picture has {size}")]
    TooLarge {
        /// The format.
        format: Format,
        /// The picture's size.
        size: Size,
        /// The longest possible side.
        limit: u64,
    },
    /// Out of the range of JPEG qualities.
    #[error("JPEG quality is 1 to 100, not {quality}")]
    Quality {
        /// Requested value.
        quality: u8,
    },
    /// The encoder refuses the picture.
    #[error("the picture cannot be stored as {format}: {reason}")]
    Refused {
        /// The format.
        format: Format,
        /// Message of the encoder.
        reason: String,
    },
}

/// Why a picture could not be written to a file.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", display_path(.path))]
pub struct WriteError {
    /// The file; `-` is standard output.
    pub path: PathBuf,
    /// Cause of the failure.
    pub cause: EncodeError,
}

/// Writes a picture to a file, whole or not at all (see [`write_atomically`]), or to standard output if the path is `-`.
///
/// Integer pictures whose color space and sample kind the target shares are stored exactly as they are. Returns what
/// the target could not hold.
///
/// # Errors
/// [`WriteError`] with the path and an [`EncodeError`]; the target is then as it was.
pub fn write(
    path: impl AsRef<Path>,
    picture: &Picture,
    options: &WriteOptions,
) -> Result<Vec<Warning>, WriteError> {
    let path = path.as_ref();
    let attempt = || {
        if is_stream(path) {
            let format = options.format.or(picture.origin.format);
            let format = format.unwrap_or(Format::Png);
            // some encoders go back in what they wrote
            let mut encoded = Cursor::new(Vec::new());
            let warnings = encode(&mut encoded, format, picture, options)?;
            let mut out = io::stdout().lock();
            out.write_all(encoded.get_ref())?;
            out.flush()?;
            return Ok(warnings);
        }
        let format = options.format.or_else(|| Format::from_extension(path));
        let format = format.ok_or(EncodeError::UnknownExtension)?;
        write_atomically(path, |writer| encode(writer, format, picture, options))
    };
    attempt().map_err(|cause| WriteError {
        path: path.to_path_buf(),
        cause,
    })
}

/// Encodes a picture in a given format. Returns what the format could not hold.
///
/// # Errors
/// [`EncodeError`]; part of the data may then have been written.
pub fn encode(
    mut writer: impl Write + Seek,
    format: Format,
    picture: &Picture,
    options: &WriteOptions,
) -> Result<Vec<Warning>, EncodeError> {
    encode_to(&mut writer, format, picture, options)
}

/// Target of any type. With it, encoders are compiled once and not in each crate that encodes.
trait Sink: Write + Seek {}
impl<T: Write + Seek> Sink for T {}

fn encode_to(
    writer: &mut dyn Sink,
    format: Format,
    picture: &Picture,
    options: &WriteOptions,
) -> Result<Vec<Warning>, EncodeError> {
    let size = picture.image.size();
    let (limit, longest) = (format.max_side(), size.width().max(size.height()));
    if longest as u64 > limit {
        return Err(EncodeError::TooLarge {
            format,
            size,
            limit,
        });
    }
    if format == Format::Jpeg && !(1..=100).contains(&options.quality) {
        return Err(EncodeError::Quality {
            quality: options.quality,
        });
    }
    let mut warnings = Vec::new();
    let raster = Raster::new(picture, format, options, &mut warnings);
    let exif = picture.origin.exif.as_deref().filter(|exif| {
        let fits = format.has_exif() && (format != Format::Jpeg || exif.len() <= MAX_JPEG_EXIF);
        if !fits {
            warnings.push(Warning::ExifDropped { format });
        }
        fits
    });
    encode_raster(writer, format, &raster, exif, options.quality).map_err(|error| match error {
        ImageError::IoError(error) => EncodeError::Io(error),
        error => EncodeError::Refused {
            format,
            reason: error.to_string(),
        },
    })?;
    Ok(warnings)
}

/// A JPEG segment has a 16-bit length, which counts itself and the six bytes before the block.
const MAX_JPEG_EXIF: usize = 65_535 - 2 - 6;

fn encode_raster(
    writer: &mut dyn Sink,
    format: Format,
    raster: &Raster<'_>,
    exif: Option<&[u8]>,
    quality: u8,
) -> Result<(), ImageError> {
    // some encoders write byte by byte
    let mut buffered = BufWriter::with_capacity(1 << 16, writer);
    let writer = &mut buffered;
    match format {
        Format::Png => put(png::PngEncoder::new(writer), raster, exif),
        Format::Jpeg => {
            let encoder = jpeg::JpegEncoder::new_with_quality(writer, quality);
            put(encoder, raster, exif)
        }
        Format::WebP => put(webp::WebPEncoder::new_lossless(writer), raster, exif),
        Format::Tiff => put(tiff::TiffEncoder::new(writer), raster, exif),
        Format::Bmp => put(bmp::BmpEncoder::new(writer), raster, exif),
        Format::OpenExr => put(openexr::OpenExrEncoder::new(writer), raster, exif),
        Format::Hdr => put(hdr::HdrEncoder::new(writer), raster, exif),
    }?;
    Ok(buffered.flush()?)
}

fn put(
    mut encoder: impl ImageEncoder,
    raster: &Raster<'_>,
    exif: Option<&[u8]>,
) -> Result<(), ImageError> {
    if let Some(icc) = &raster.icc {
        encoder
            .set_icc_profile(icc.to_vec())
            .map_err(ImageError::Unsupported)?;
    }
    if let Some(exif) = exif {
        encoder
            .set_exif_metadata(exif.to_vec())
            .map_err(ImageError::Unsupported)?;
    }
    let (width, height) = (raster.size.width() as u32, raster.size.height() as u32);
    encoder.write_image(raster.bytes(), width, height, raster.color)
}
