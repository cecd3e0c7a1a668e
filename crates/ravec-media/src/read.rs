//! Reading pictures.

use crate::format::{self, Format};
use crate::limits::{Limits, display_bytes, over_budget};
use crate::opened::Opened;
use crate::picture::{Picture, SampleKind};
use crate::tiff::Source;
use ravec_files::is_stream;
use ravec_memory::Reservation;
use ravec_raster::{Size, SizeError};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Why a picture could not be decoded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The data cannot be read at all.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// There is no data.
    #[error("the file is empty")]
    Empty,
    /// The content is not a picture in a supported format.
    #[error("not a picture in a known format{}; known are {}", .looks_like.map(|name| format!(" (it looks like {name})")).unwrap_or_default(), format::known_names())]
    UnknownFormat {
        /// The name of the format, if it is known but not read.
        looks_like: Option<&'static str>,
    },
    /// The picture has more pixels than allowed.
    #[error(
        "the picture has {width} x {height} pixels, more than the limit of {limit} (raise `max_pixels`)"
    )]
    TooManyPixels {
        /// Columns by the header.
        width: u64,
        /// Rows by the header.
        height: u64,
        /// [`Limits::max_pixels`].
        limit: u64,
    },
    /// Reading would need more memory than allowed.
    #[error("reading the picture needs {}, more than the limit of {}{} (raise `max_bytes`)", .bytes.map_or("more memory".into(), display_bytes), display_bytes(*.limit), in_use(*.others))]
    TooManyBytes {
        /// Bytes needed; none if the decoder stopped on the way.
        bytes: Option<u64>,
        /// Bytes that other pictures hold.
        others: u64,
        /// The limit of [`Limits::memory`].
        limit: u64,
    },
    /// The machine has not enough memory.
    #[error("not enough memory for the picture: {} are needed", display_bytes(*.bytes))]
    OutOfMemory {
        /// Bytes needed.
        bytes: u64,
    },
    /// The content is broken.
    #[error("the {format} data is damaged: {reason}")]
    Damaged {
        /// The format by its first bytes.
        format: Format,
        /// Message of the decoder.
        reason: String,
    },
    /// A variant of the format that is not read.
    #[error("this kind of {format} file is not supported: {reason}")]
    Unsupported {
        /// The format by its first bytes.
        format: Format,
        /// Message of the decoder.
        reason: String,
    },
    /// A size that no image can have.
    #[error("{0}")]
    Size(#[from] SizeError),
}

/// The part of a budget that others use, for a sentence.
fn in_use(bytes: u64) -> String {
    match bytes {
        0 => String::new(),
        bytes => format!(" of which {} are in use", display_bytes(bytes)),
    }
}

/// Why a file could not be read as a picture.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", display_path(.path))]
pub struct ReadError {
    /// The file; `-` is standard input.
    pub path: PathBuf,
    /// Cause of the failure.
    pub cause: DecodeError,
}

pub(crate) fn display_path(path: &Path) -> String {
    if is_stream(path) {
        "standard input or output".into()
    } else {
        path.display().to_string()
    }
}

/// Picture properties declared by the header of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Probe {
    /// The format, by content.
    pub format: Format,
    /// Columns and rows of the upright picture.
    pub size: Size,
    /// Sample kind.
    pub sample: SampleKind,
    /// `true` if there is one color channel.
    pub gray: bool,
    /// `true` if there is an alpha channel.
    pub alpha: bool,
    /// Orientation of the stored picture, 1 to 8 as in EXIF; 1 is upright.
    pub orientation: u8,
    /// The description of the embedded color profile; empty if it has none.
    pub profile: Option<String>,
}

/// Reads a picture from a file, or from standard input if the path is `-`.
///
/// See [`decode`] for what is done to it. Files of any length are read; standard input and pipes as far as half of
/// [`Limits::memory`] holds them, after reading their first bytes.
///
/// # Errors
/// [`ReadError`] with the path and a [`DecodeError`].
pub fn read(path: impl AsRef<Path>, limits: &Limits) -> Result<Picture, ReadError> {
    with_file(path.as_ref(), limits, |input, kept| {
        contain_panics(input, limits, |mut opened| {
            opened.charge_input(kept);
            opened.decode()
        })
    })
}

/// Reads the header of a file without decoding the picture. `-` is standard input.
///
/// # Errors
/// As for [`read`], except for damage in the part that is not examined.
pub fn probe(path: impl AsRef<Path>, limits: &Limits) -> Result<Probe, ReadError> {
    with_file(path.as_ref(), limits, |input, _kept| {
        contain_panics(input, limits, |opened| opened.probe())
    })
}

/// Decodes a picture whose format is found from its content.
///
/// * EXIF orientation is applied.
/// * Colors become sRGB by the embedded profile. If that profile *is* sRGB, or there is none, integer samples are kept
///   exactly; otherwise pixels are floats in linear light, not clipped to sRGB.
/// * Float files are linear light; NaN becomes 0 and infinities ±10³⁰, with a warning.
/// * Alpha is straight.
///
/// Panics of the decoders on hostile data are caught here and reported as damage.
///
/// # Errors
/// [`DecodeError`] for data that is not a picture, damaged, unsupported or above a limit.
pub fn decode(mut input: impl BufRead + Seek, limits: &Limits) -> Result<Picture, DecodeError> {
    contain_panics(&mut input, limits, decode_opened)
}

/// Like [`decode`], for when the picture is wanted small: JPEG files are decoded at a half, a quarter or an eighth of their
/// size, as long as the shorter side has at least `min_side` pixels, which takes half the time and less memory. Other
/// formats are decoded whole. Returns what the header says as well, with the size of the whole picture.
///
/// # Errors
/// As for [`decode`].
pub fn decode_reduced(
    mut input: impl BufRead + Seek,
    min_side: u32,
    limits: &Limits,
) -> Result<(Probe, Picture), DecodeError> {
    contain_panics(&mut input, limits, |mut opened| {
        let probe = opened.probe()?;
        opened.reduce(min_side.max(1));
        Ok((probe, opened.decode()?))
    })
}

/// Bytes that [`decode`], or [`decode_reduced`] with `min_side`, reserves at its peak for this data, by its header. The
/// encoded data of the caller are not among them.
///
/// A caller that decodes several pictures at once reserves this first (see
/// [`MemoryBudget::reserve_when_free`](ravec_memory::MemoryBudget::reserve_when_free)), so that a picture waits for others
/// instead of being refused because of them.
///
/// # Errors
/// As for [`probe_data`].
pub fn memory_to_decode(
    mut input: impl BufRead + Seek,
    min_side: Option<u32>,
    limits: &Limits,
) -> Result<u64, DecodeError> {
    contain_panics(&mut input, limits, |opened| {
        Ok(opened.need(min_side.map(|side| side.max(1))))
    })
}

/// Reads the header of encoded data without decoding the picture.
///
/// # Errors
/// As for [`decode`], except for damage in the part that is not examined.
pub fn probe_data(mut input: impl BufRead + Seek, limits: &Limits) -> Result<Probe, DecodeError> {
    contain_panics(&mut input, limits, |opened| opened.probe())
}

fn with_file<T>(
    path: &Path,
    limits: &Limits,
    work: impl FnOnce(&mut dyn Source, Reservation) -> Result<T, DecodeError>,
) -> Result<T, ReadError> {
    let open = || -> Result<(Box<dyn Source>, Reservation), DecodeError> {
        if is_stream(path) {
            let (data, kept) = read_all(io::stdin().lock(), limits)?;
            return Ok((Box::new(Cursor::new(data)), kept));
        }
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        if metadata.is_dir() {
            return Err(io::Error::from(io::ErrorKind::IsADirectory).into());
        }
        if metadata.is_file() {
            let input = BufReader::with_capacity(1 << 16, file);
            Ok((Box::new(input), limits.memory.reserve_nothing()))
        } else {
            // pipes cannot be searched
            let (data, kept) = read_all(file, limits)?;
            Ok((Box::new(Cursor::new(data)), kept))
        }
    };
    open()
        .and_then(|(mut input, kept)| work(&mut *input, kept))
        .map_err(|cause| ReadError {
            path: path.to_path_buf(),
            cause,
        })
}

fn decode_opened(opened: Opened<'_>) -> Result<Picture, DecodeError> {
    opened.decode()
}

/// All data of a stream, with the memory that they take, unless they exceed the limit or begin like no picture.
fn read_all(mut input: impl Read, limits: &Limits) -> Result<(Vec<u8>, Reservation), DecodeError> {
    let mut data = Vec::new();
    let first = Format::SNIFFED_BYTES as u64;
    input.by_ref().take(first).read_to_end(&mut data)?;
    recognize(&data)?;
    let mut kept = limits.memory.reserve_nothing();
    loop {
        // a growing buffer is copied into one of twice the size
        let (old, new) = (
            data.capacity() as u64,
            2 * data.capacity().max(1 << 15) as u64,
        );
        kept.grow_to(old + new)
            .map_err(|over| over_budget(over, kept.bytes()))?;
        data.reserve_exact(new as usize - data.len());
        kept.shrink_to(new);
        let room = (data.capacity() - data.len()) as u64;
        let read = input.by_ref().take(room).read_to_end(&mut data)?;
        if (read as u64) < room {
            return Ok((data, kept));
        }
    }
}

/// A hostile file may trip an assertion in a decoder. Decoders share no state between files, so unwinding out of one is
/// safe. The type of the input is erased, so that decoders are compiled once and not in each crate that decodes.
fn contain_panics<T>(
    input: &mut dyn Source,
    limits: &Limits,
    work: impl FnOnce(Opened<'_>) -> Result<T, DecodeError>,
) -> Result<T, DecodeError> {
    let format = sniff(input)?;
    let attempt = std::panic::AssertUnwindSafe(|| work(Opened::new(format, input, limits)?));
    std::panic::catch_unwind(attempt).unwrap_or_else(|_| {
        Err(DecodeError::Damaged {
            format,
            reason: "the decoder gave up".into(),
        })
    })
}

fn sniff(input: &mut dyn Source) -> Result<Format, DecodeError> {
    let start = input.stream_position()?;
    let mut first = Vec::new();
    let mut beginning = Read::take(&mut *input, Format::SNIFFED_BYTES as u64);
    beginning.read_to_end(&mut first)?;
    input.seek(SeekFrom::Start(start))?;
    recognize(&first)
}

/// The format of a file that begins with `first`.
fn recognize(first: &[u8]) -> Result<Format, DecodeError> {
    if first.is_empty() {
        return Err(DecodeError::Empty);
    }
    Format::from_content(first).ok_or_else(|| DecodeError::UnknownFormat {
        looks_like: format::name_of_stranger(first),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Picture;
    use crate::write::{WriteOptions, encode};
    use ravec_raster::{Image, ResizeFilter, Srgb, compare, resize};

    #[test]
    fn a_reduced_jpeg_is_the_picture_made_smaller() {
        let size = Size::new(203, 131).unwrap();
        let picture = Image::from_fn(size, |col, row| {
            let wave = |x: usize, period: f64| 127.0 + 100.0 * (x as f64 / period).sin();
            Srgb([
                wave(col, 19.0) as u8,
                wave(row, 23.0) as u8,
                wave(col + row, 31.0) as u8,
            ])
        });
        let mut data = Cursor::new(Vec::new());
        let options = WriteOptions::default();
        encode(
            &mut data,
            Format::Jpeg,
            &Picture::from_image(picture.clone()),
            &options,
        )
        .unwrap();
        let data = data.into_inner();
        for (least, factor) in [(200, 1), (60, 2), (30, 4), (16, 8), (1, 8)] {
            let (probe, reduced) =
                decode_reduced(Cursor::new(&data), least, &Limits::default()).unwrap();
            assert_eq!(probe.size, size);
            let small = reduced.convert::<Srgb<u8>>();
            assert_eq!(small.size(), size.cells(factor), "{least}");
            if factor > 1 {
                let truth = resize(&picture, small.size(), ResizeFilter::Box);
                // blocks are reduced in encoded values and end beyond the picture; shifts of less than a pixel remain
                assert!(compare(&truth, &small).unwrap().psnr_db > 25.0, "{factor}");
            }
        }
    }
}
