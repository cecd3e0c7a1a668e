//! Writing pictures that are made row by row, so that they need not fit into memory.
//!
//! Guarantees: the file is whole or absent; memory is a few strips. Does not guarantee: anything but 8 bits in sRGB.

use crate::format::Format;
use crate::standard::SRGB;
use crate::write::{EncodeError, WriteError};
use ::tiff::encoder::colortype::RGB8;
use ::tiff::encoder::{TiffEncoder, TiffKind};
use ::tiff::tags::Tag;
use ::tiff::{TiffError, TiffResult};
use jpeg_encoder::{EncodingError, ImageBuffer, JpegColorType};
use ravec_files::write_atomically;
use ravec_raster::{Size, Srgb};
use std::cell::RefCell;
use std::io::{self, Seek, Write};
use std::ops::Range;
use std::path::Path;

/// Why a picture could not be written row by row.
#[derive(Debug, thiserror::Error)]
pub enum RowsError<E> {
    /// The file cannot be written.
    #[error(transparent)]
    Write(WriteError),
    /// The rows could not be made.
    #[error("{0}")]
    Fill(E),
}

enum Failure<E> {
    Encode(EncodeError),
    Fill(E),
}

impl<E> From<io::Error> for Failure<E> {
    fn from(error: io::Error) -> Self {
        Self::Encode(error.into())
    }
}

impl<E> From<png::EncodingError> for Failure<E> {
    fn from(error: png::EncodingError) -> Self {
        Self::Encode(match error {
            png::EncodingError::IoError(error) => error.into(),
            error => refused(Format::Png, &error),
        })
    }
}

impl<E> From<TiffError> for Failure<E> {
    fn from(error: TiffError) -> Self {
        Self::Encode(match error {
            TiffError::IoError(error) => error.into(),
            error => refused(Format::Tiff, &error),
        })
    }
}

impl<E> From<EncodingError> for Failure<E> {
    fn from(error: EncodingError) -> Self {
        Self::Encode(match error {
            EncodingError::IoError(error) => error.into(),
            error => refused(Format::Jpeg, &error),
        })
    }
}

fn refused(format: Format, reason: &dyn std::fmt::Display) -> EncodeError {
    EncodeError::Refused {
        format,
        reason: reason.to_string(),
    }
}

/// Bytes of pixels beyond which a TIFF file gets 64-bit offsets: what 32 bits can say, less room for the tables.
const MAX_CLASSIC_TIFF: u64 = (1 << 32) - (1 << 24);

/// Writes a picture of `size` as PNG, JPEG or TIFF, by the extension of `path`, whole or not at all. TIFF files of more than
/// 4 GiB become `BigTIFF`.
///
/// `fill(rows, pixels)` makes the pixels of some whole rows, `rows_at_once` or the rest, from the top. `quality` is that of
/// JPEG, 1 to 100.
///
/// # Errors
/// [`RowsError::Write`] if the format is another one, cannot hold the size, or the file cannot be written;
/// [`RowsError::Fill`] as soon as `fill` fails. The target is then as it was.
pub fn write_rows<E>(
    path: &Path,
    size: Size,
    quality: u8,
    rows_at_once: usize,
    fill: impl FnMut(Range<usize>, &mut [Srgb<u8>]) -> Result<(), E>,
) -> Result<(), RowsError<E>> {
    let attempt = || {
        let format =
            Format::from_extension(path).ok_or(Failure::Encode(EncodeError::UnknownExtension))?;
        let (limit, longest) = (format.max_side(), size.width().max(size.height()));
        if longest as u64 > limit {
            return Err(Failure::Encode(EncodeError::TooLarge {
                format,
                size,
                limit,
            }));
        }
        if format == Format::Jpeg && !(1..=100).contains(&quality) {
            return Err(Failure::Encode(EncodeError::Quality { quality }));
        }
        let rows = Rows {
            size,
            at_once: rows_at_once.clamp(1, size.height()),
            strip: Vec::new(),
            fill,
        };
        write_atomically(path, |writer| match format {
            Format::Png => as_png(writer, rows),
            Format::Jpeg => as_jpeg(writer, rows, quality),
            Format::Tiff if size.pixels() as u64 * 3 > MAX_CLASSIC_TIFF => {
                as_tiff(TiffEncoder::new_big(writer)?, rows)
            }
            Format::Tiff => as_tiff(TiffEncoder::new(writer)?, rows),
            format => Err(Failure::Encode(refused(
                format,
                &"only PNG, JPEG and TIFF are written row by row",
            ))),
        })
    };
    attempt().map_err(|failure| match failure {
        Failure::Encode(cause) => RowsError::Write(WriteError {
            path: path.to_path_buf(),
            cause,
        }),
        Failure::Fill(error) => RowsError::Fill(error),
    })
}

/// Rows in the making.
struct Rows<F> {
    size: Size,
    at_once: usize,
    strip: Vec<Srgb<u8>>,
    fill: F,
}

impl<F> Rows<F> {
    /// Makes the strip that begins at `first`, and returns its samples.
    fn strip<E>(&mut self, first: usize) -> Result<&[u8], Failure<E>>
    where
        F: FnMut(Range<usize>, &mut [Srgb<u8>]) -> Result<(), E>,
    {
        let last = (first + self.at_once).min(self.size.height());
        self.strip
            .resize((last - first) * self.size.width(), Srgb([0; 3]));
        (self.fill)(first..last, &mut self.strip).map_err(Failure::Fill)?;
        Ok(bytemuck::cast_slice(&self.strip))
    }

    fn firsts(&self) -> impl Iterator<Item = usize> + use<F> {
        (0..self.size.height()).step_by(self.at_once)
    }
}

fn as_png<E, F>(writer: impl Write, mut rows: Rows<F>) -> Result<(), Failure<E>>
where
    F: FnMut(Range<usize>, &mut [Srgb<u8>]) -> Result<(), E>,
{
    let mut info = png::Info::with_size(rows.size.width() as u32, rows.size.height() as u32);
    info.icc_profile = Some(SRGB.as_slice().into());
    let mut encoder = png::Encoder::with_info(writer, info)?;
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let mut header = encoder.write_header()?;
    let mut stream = header.stream_writer_with_size(1 << 16)?;
    for first in rows.firsts() {
        stream.write_all(rows.strip(first)?)?;
    }
    stream.finish()?;
    header.finish()?;
    Ok(())
}

fn as_tiff<E, F, W: Write + Seek, K: TiffKind>(
    mut encoder: TiffEncoder<W, K>,
    mut rows: Rows<F>,
) -> Result<(), Failure<E>>
where
    F: FnMut(Range<usize>, &mut [Srgb<u8>]) -> Result<(), E>,
{
    let (width, height) = (rows.size.width() as u32, rows.size.height() as u32);
    let mut image = encoder.new_image::<RGB8>(width, height)?;
    image.rows_per_strip(rows.at_once as u32)?;
    let written: TiffResult<()> = image.encoder().write_tag(Tag::IccProfile, SRGB.as_slice());
    written?;
    for first in rows.firsts() {
        image.write_strip(rows.strip(first)?)?;
    }
    image.finish()?;
    Ok(())
}

/// Rows as the JPEG encoder asks for them: one by one, from the top, the last one more than once.
struct Pulled<F, E> {
    width: u16,
    height: u16,
    state: RefCell<Pulling<F, E>>,
}

struct Pulling<F, E> {
    rows: Rows<F>,
    /// The first row of the strip that is there.
    first: Option<usize>,
    failure: Option<Failure<E>>,
}

impl<F, E> ImageBuffer for &Pulled<F, E>
where
    F: FnMut(Range<usize>, &mut [Srgb<u8>]) -> Result<(), E>,
{
    fn get_jpeg_color_type(&self) -> JpegColorType {
        JpegColorType::Ycbcr
    }

    fn width(&self) -> u16 {
        self.width
    }

    fn height(&self) -> u16 {
        self.height
    }

    fn fill_buffers(&self, y: u16, buffers: &mut [Vec<u8>; 4]) {
        let mut state = self.state.borrow_mut();
        let Pulling {
            rows,
            first,
            failure,
        } = &mut *state;
        let wanted = usize::from(y) / rows.at_once * rows.at_once;
        if *first != Some(wanted) && failure.is_none() {
            *failure = rows.strip(wanted).err();
            *first = Some(wanted);
        }
        // after a failure, rows of anything: the file is thrown away
        let width = usize::from(self.width);
        let row = rows.strip.chunks_exact(width).nth(usize::from(y) - wanted);
        let black = vec![Srgb([0; 3]); width];
        for pixel in row.unwrap_or(&black) {
            let [r, g, b] = pixel.0;
            let (luma, blue, red) = jpeg_encoder::rgb_to_ycbcr(r, g, b);
            buffers[0].push(luma);
            buffers[1].push(blue);
            buffers[2].push(red);
        }
    }
}

fn as_jpeg<E, F>(writer: impl Write, rows: Rows<F>, quality: u8) -> Result<(), Failure<E>>
where
    F: FnMut(Range<usize>, &mut [Srgb<u8>]) -> Result<(), E>,
{
    let mut encoder = jpeg_encoder::Encoder::new(writer, quality);
    encoder.add_icc_profile(&SRGB)?;
    let pulled = Pulled {
        width: rows.size.width() as u16,
        height: rows.size.height() as u16,
        state: RefCell::new(Pulling {
            rows,
            first: None,
            failure: None,
        }),
    };
    let written = encoder.encode_image(&pulled);
    match pulled.state.into_inner().failure {
        Some(failure) => Err(failure),
        None => Ok(written?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::Limits;
    use crate::read::read;
    use ravec_raster::{Image, compare};

    fn pixel(col: usize, row: usize) -> Srgb<u8> {
        Srgb([(col * 3) as u8, (row * 5) as u8, (col + row) as u8])
    }

    fn put(path: &Path, size: Size, at_once: usize) -> Result<(), RowsError<&'static str>> {
        write_rows(path, size, 95, at_once, |rows, pixels| {
            for (row, line) in rows.zip(pixels.chunks_exact_mut(size.width())) {
                for (col, into) in line.iter_mut().enumerate() {
                    *into = pixel(col, row);
                }
            }
            Ok(())
        })
    }

    #[test]
    fn what_was_written_in_strips_is_read_as_one_picture() {
        let folder = tempfile::tempdir().unwrap();
        let size = Size::new(41, 37).unwrap();
        let truth = Image::from_fn(size, pixel);
        for name in ["a.png", "a.tif", "a.jpg"] {
            let path = folder.path().join(name);
            for at_once in [1, 10, 37, 99] {
                put(&path, size, at_once).unwrap();
                let picture = read(&path, &Limits::default()).unwrap();
                assert!(
                    picture.warnings.is_empty() && picture.origin.icc.is_some(),
                    "{name}"
                );
                let image = picture.convert::<Srgb<u8>>();
                if name == "a.jpg" {
                    assert!(compare(&image, &truth).unwrap().psnr_db > 30.0);
                } else {
                    assert_eq!(image, truth, "{name} {at_once}");
                }
            }
        }
    }

    #[test]
    fn a_failure_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let size = Size::new(8, 64).unwrap();
        for name in ["a.png", "a.tif", "a.jpg"] {
            let path = folder.path().join(name);
            let result = write_rows(&path, size, 90, 8, |rows, _| {
                if rows.start >= 32 {
                    Err("no more")
                } else {
                    Ok(())
                }
            });
            assert!(matches!(result, Err(RowsError::Fill("no more"))), "{name}");
        }
        for name in ["a.webp", "a.txt", "a"] {
            let result = put(&folder.path().join(name), size, 8);
            assert!(matches!(result, Err(RowsError::Write(_))), "{name}");
        }
        let wide = Size::new(70_000, 1).unwrap();
        let result = put(&folder.path().join("a.jpg"), wide, 1);
        assert!(result.unwrap_err().to_string().contains("at most 65535"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
