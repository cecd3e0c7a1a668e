//! The file formats, distinguished by what a file holds and, for writing, by the target's extension.

use crate::picture::SampleKind;
use std::path::Path;

/// A picture file format that is read and written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// Portable Network Graphics: 8 and 16 bit, gray, alpha, lossless.
    Png,
    /// JPEG: 8 bit, gray or color, lossy. CMYK is read.
    Jpeg,
    /// WebP: 8 bit with alpha. Lossy files are read, lossless ones written.
    WebP,
    /// TIFF: 8 and 16 bit and float, gray, alpha, lossless. CMYK is read.
    Tiff,
    /// Windows bitmap: 8 bit with alpha, lossless.
    Bmp,
    /// `OpenEXR`: float in linear light with alpha.
    OpenExr,
    /// Radiance HDR: linear light with a shared 8-bit exponent, no alpha.
    Hdr,
}

impl Format {
    /// All formats, the most used first.
    pub const ALL: [Self; 7] = [
        Self::Png,
        Self::Jpeg,
        Self::WebP,
        Self::Tiff,
        Self::Bmp,
        Self::OpenExr,
        Self::Hdr,
    ];

    /// The name people use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::WebP => "WebP",
            Self::Tiff => "TIFF",
            Self::Bmp => "BMP",
            Self::OpenExr => "OpenEXR",
            Self::Hdr => "Radiance HDR",
        }
    }

    /// The extensions that mean the format, lower case, without the dot, the usual one first.
    pub fn extensions(self) -> &'static [&'static str] {
        match self {
            Self::Png => &["png"],
            Self::Jpeg => &["jpg", "jpeg"],
            Self::WebP => &["webp"],
            Self::Tiff => &["tif", "tiff"],
            Self::Bmp => &["bmp"],
            Self::OpenExr => &["exr"],
            Self::Hdr => &["hdr"],
        }
    }

    /// The format that a path's extension means, upper or lower case.
    pub fn from_extension(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Self::ALL
            .into_iter()
            .find(|format| format.extensions().contains(&extension.as_str()))
    }

    /// The format of a file by its first bytes ([`Format::SNIFFED_BYTES`] are enough).
    pub fn from_content(start: &[u8]) -> Option<Self> {
        let starts = |magic: &[u8]| start.starts_with(magic);
        if starts(b"\x89PNG\r\n\x1a\n") {
            Some(Self::Png)
        } else if starts(b"\xff\xd8\xff") {
            Some(Self::Jpeg)
        } else if starts(b"RIFF") && start.get(8..12) == Some(b"WEBP") {
            Some(Self::WebP)
        } else if [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"]
            .iter()
            .any(|m| starts(*m))
        {
            Some(Self::Tiff)
        } else if starts(b"\x76\x2f\x31\x01") {
            Some(Self::OpenExr)
        } else if starts(b"#?RADIANCE") || starts(b"#?RGBE") {
            Some(Self::Hdr)
        } else if starts(b"BM") && start.get(14).is_some_and(|&n| BMP_HEADERS.contains(&n)) {
            // "BM" alone also begins many a text
            Some(Self::Bmp)
        } else {
            None
        }
    }

    /// Number of bytes of a file that [`from_content`](Self::from_content) inspects.
    pub const SNIFFED_BYTES: usize = 32;

    /// Returns `true` if the format stores alpha.
    pub fn has_alpha(self) -> bool {
        !matches!(self, Self::Jpeg | Self::Hdr)
    }

    /// Returns `true` if files of the format that we write say their color space by an embedded profile.
    pub fn has_profile(self) -> bool {
        matches!(self, Self::Png | Self::Jpeg | Self::WebP | Self::Tiff)
    }

    /// Returns `true` if an EXIF block is written.
    pub(crate) fn has_exif(self) -> bool {
        matches!(self, Self::Png | Self::Jpeg | Self::WebP)
    }

    /// Returns `true` if one channel is enough for a gray picture, without and with alpha.
    pub(crate) fn has_gray(self, alpha: bool) -> bool {
        match self {
            Self::Png | Self::WebP => true,
            Self::Jpeg | Self::Tiff | Self::Bmp => !alpha,
            Self::OpenExr | Self::Hdr => false,
        }
    }

    /// The longest side that a picture in the format can have, in pixels.
    pub fn max_side(self) -> u64 {
        match self {
            Self::WebP => 16_384,
            Self::Jpeg => 65_535,
            _ => i32::MAX as u64,
        }
    }

    /// The kind of sample that comes nearest to `wanted`.
    pub fn nearest_sample(self, wanted: SampleKind) -> SampleKind {
        match (self, wanted) {
            (Self::Png, SampleKind::F32) => SampleKind::U16,
            (Self::Png | Self::Tiff, kind) => kind,
            (Self::Jpeg | Self::WebP | Self::Bmp, _) => SampleKind::U8,
            (Self::OpenExr | Self::Hdr, _) => SampleKind::F32,
        }
    }
}

/// Sizes of the second header of a bitmap, by which its versions are distinguished.
const BMP_HEADERS: [u8; 8] = [12, 16, 40, 52, 56, 64, 108, 124];

impl std::fmt::Display for Format {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// The common name of an unsupported kind of file, for the error message.
pub(crate) fn name_of_stranger(start: &[u8]) -> Option<&'static str> {
    let brand = start.get(4..12).unwrap_or_default();
    if start.starts_with(b"GIF8") {
        Some("GIF")
    } else if brand.starts_with(b"ftypavi") {
        Some("AVIF")
    } else if brand.starts_with(b"ftyphe") || brand == b"ftypmif1" {
        Some("HEIC")
    } else if start.starts_with(b"\xff\x0a") || start.get(4..8) == Some(b"JXL ") {
        Some("JPEG XL")
    } else if start.starts_with(b"8BPS") {
        Some("Photoshop")
    } else if start.starts_with(b"%PDF") {
        Some("PDF")
    } else {
        None
    }
}

/// The names of all formats, for messages.
pub(crate) fn known_names() -> String {
    Format::ALL.map(Format::name).join(", ")
}

/// The extensions of all formats, for messages.
pub(crate) fn known_extensions() -> String {
    let all: Vec<_> = Format::ALL
        .iter()
        .flat_map(|format| format.extensions())
        .map(|extension| format!(".{extension}"))
        .collect();
    all.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_are_understood_in_any_case() {
        for format in Format::ALL {
            for extension in format.extensions() {
                for name in [
                    format!("a.{extension}"),
                    format!("a.b.{}", extension.to_uppercase()),
                ] {
                    assert_eq!(Format::from_extension(Path::new(&name)), Some(format));
                }
            }
        }
        assert_eq!(Format::from_extension(Path::new("png")), None);
        assert_eq!(Format::from_extension(Path::new("a.gif")), None);
    }

    #[test]
    fn a_text_that_begins_like_a_bitmap_is_none() {
        assert_eq!(Format::from_content(b"BMW makes cars, and more"), None);
        assert_eq!(Format::from_content(b""), None);
        assert_eq!(Format::from_content(b"RIFF....WAVE"), None);
    }
}
