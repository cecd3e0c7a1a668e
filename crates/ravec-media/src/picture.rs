//! A picture together with what is needed to write a result like its source.

use crate::format::Format;
use crate::quantization::Quantization;
use ravec_memory::Reservation;
use ravec_raster::{AnyImage, Color, Image, LinearRgb, LinearRgba, Srgb, Srgba};
use std::sync::Arc;

/// Kind of number in which a file stores samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SampleKind {
    /// 8-bit integers.
    U8,
    /// 16-bit integers.
    U16,
    /// 32-bit floats in linear light.
    F32,
}

impl SampleKind {
    /// Bytes of one sample.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::F32 => 4,
        }
    }
}

/// Properties of a source file, from which a result can be written alike.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// The source's format; none for a picture that was made, not read.
    pub format: Option<Format>,
    /// Sample kind of the source. May differ from the image's pixel type: 8-bit pixels in another color space than sRGB
    /// are held as floats.
    pub sample: SampleKind,
    /// `true` if the source had one color channel.
    pub gray: bool,
    /// The color profile that the source embedded, if it could be understood.
    pub icc: Option<Arc<[u8]>>,
    /// The EXIF block, its orientation set to upright.
    pub exif: Option<Arc<[u8]>>,
    /// Quantization of the luma of a JPEG file, whose pixels the image has. Results of work do not have it.
    pub quantization: Option<Quantization>,
}

/// Something that was lost, guessed or changed without making the result useless.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Warning {
    /// The embedded color profile cannot be used.
    #[error("the color profile cannot be used ({reason}); the picture is taken as sRGB")]
    ProfileIgnored {
        /// Description of the defect.
        reason: String,
    },
    /// Ink amounts were turned into colors by the plain formula.
    #[error("the picture is CMYK without a usable color profile; its colors are approximate")]
    CmykWithoutProfile,
    /// Numbers that are not finite were replaced.
    #[error("{nan} NaN samples were set to 0 and {infinite} infinite samples to 1e30")]
    NotFinite {
        /// Samples that were NaN and became 0.
        nan: u64,
        /// Samples that were infinite and became ±10³⁰.
        infinite: u64,
    },
    /// Pixels of an `OpenEXR` file that shine without covering have no straight color.
    #[error("{pixels} fully transparent pixels with light of their own became empty")]
    GlowLost {
        /// Number of pixels.
        pixels: u64,
    },
    /// The file has several frames.
    #[error("the file is an animation; only its first frame is used")]
    OnlyFirstFrame,
    /// The file has several pages.
    #[error("the file has several pages or versions of the picture; only the first one is used")]
    OnlyFirstPage,
    /// The file says how its colors are meant, and this is not applied.
    #[error("the colors are taken as those of sRGB, though the file states {what}")]
    ColorsTakenAsSrgb {
        /// The statement.
        what: String,
    },
    /// The file ends before the picture does.
    #[error("the file ends early; the missing part of the picture is filled in")]
    Truncated,
    /// The target format has no alpha.
    #[error("{format} has no transparency; the picture was put on a plain background")]
    AlphaFlattened {
        /// The target format.
        format: Format,
    },
    /// The EXIF block cannot be stored in the target.
    #[error("the EXIF data of the source cannot be stored in this {format} file and was left out")]
    ExifDropped {
        /// The target format.
        format: Format,
    },
}

/// Kind of a [`Warning`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WarningKind {
    /// Something was guessed.
    Assumed,
    /// Samples were changed.
    Changed,
    /// Something was lost.
    Dropped,
}

impl Warning {
    /// Kind of the warning.
    pub fn kind(&self) -> WarningKind {
        match self {
            Self::ProfileIgnored { .. }
            | Self::CmykWithoutProfile
            | Self::ColorsTakenAsSrgb { .. } => WarningKind::Assumed,
            Self::NotFinite { .. } | Self::GlowLost { .. } | Self::Truncated => {
                WarningKind::Changed
            }
            Self::OnlyFirstFrame
            | Self::OnlyFirstPage
            | Self::AlphaFlattened { .. }
            | Self::ExifDropped { .. } => WarningKind::Dropped,
        }
    }
}

/// An image with its origin. Its pixels are upright and their colors are sRGB, encoded (integers) or linear (floats),
/// whatever the source's color space was.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The pixels.
    pub image: AnyImage,
    /// Properties of the source.
    pub origin: Origin,
    /// Losses and guesses of reading.
    pub warnings: Vec<Warning>,
    /// The share of the memory budget that the pixels take, given back with the picture and its clones.
    pub(crate) charge: Charge,
}

/// Memory that is given back with the last clone. All charges compare equal: the memory that a picture holds is not a
/// part of its value.
#[derive(Debug, Clone, Default)]
pub(crate) struct Charge {
    _memory: Option<Arc<Reservation>>,
}

impl Charge {
    pub(crate) fn new(memory: Reservation) -> Self {
        Self {
            _memory: Some(Arc::new(memory)),
        }
    }
}

impl PartialEq for Charge {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Picture {
    /// A picture that was made, not read: written in sRGB with the samples it has.
    pub fn from_image(image: impl Into<AnyImage>) -> Self {
        let image = image.into();
        let sample = match image {
            AnyImage::Srgb8(_) | AnyImage::Srgba8(_) => SampleKind::U8,
            AnyImage::Srgb16(_) | AnyImage::Srgba16(_) => SampleKind::U16,
            AnyImage::Linear(_) | AnyImage::LinearAlpha(_) => SampleKind::F32,
        };
        Self {
            image,
            origin: Origin {
                format: None,
                sample,
                gray: false,
                icc: None,
                exif: None,
                quantization: None,
            },
            warnings: Vec::new(),
            charge: Charge::default(),
        }
    }

    /// A result of work on this picture: its pixels are `image`, and it is written like this one.
    ///
    /// Pixels get the type that this picture's have, with alpha only if some pixel is not opaque. A gray source stays
    /// gray as long as every pixel is gray, which is checked when writing; channels that differ by no more than the rounding
    /// of a color space count as equal there. Warnings are not inherited.
    pub fn with_image(&self, image: &Image<LinearRgba>) -> Self {
        let neutral = self.origin.gray.then(|| image.map(without_rounding));
        let image = neutral.as_ref().unwrap_or(image);
        let opaque = image.is_opaque();
        let image: AnyImage = match (&self.image, opaque) {
            (AnyImage::Srgb8(_) | AnyImage::Srgba8(_), true) => image.convert::<Srgb<u8>>().into(),
            (AnyImage::Srgb8(_) | AnyImage::Srgba8(_), false) => {
                image.convert::<Srgba<u8>>().into()
            }
            (AnyImage::Srgb16(_) | AnyImage::Srgba16(_), true) => {
                image.convert::<Srgb<u16>>().into()
            }
            (AnyImage::Srgb16(_) | AnyImage::Srgba16(_), false) => {
                image.convert::<Srgba<u16>>().into()
            }
            (_, true) => image.convert::<LinearRgb>().into(),
            (_, false) => image.clone().into(),
        };
        self.with_pixels(image)
    }

    /// Like [`with_image`](Self::with_image) for pixels that are to be kept exactly as they are.
    pub fn with_pixels(&self, image: impl Into<AnyImage>) -> Self {
        Self {
            image: image.into(),
            origin: Origin {
                quantization: None,
                ..self.origin.clone()
            },
            warnings: Vec::new(),
            charge: Charge::default(),
        }
    }

    /// The pixels in a given type.
    pub fn convert<P: Color>(&self) -> Image<P> {
        self.image.convert()
    }
}

/// Differences between the channels of a gray that come from rounding: a few units of single precision on the way through
/// Oklab, in linear light.
const ROUNDING: f32 = 4e-6;

/// A nearly gray pixel made gray.
fn without_rounding(pixel: LinearRgba) -> LinearRgba {
    let [r, g, b, alpha] = pixel.0;
    if (r - g).abs() <= ROUNDING && (b - g).abs() <= ROUNDING {
        LinearRgba([g, g, g, alpha])
    } else {
        pixel
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    #[test]
    fn a_result_has_the_pixel_type_of_its_source_and_alpha_only_if_needed() {
        let size = Size::new(2, 1).unwrap();
        let source = Picture::from_image(Image::new(size, Srgba([9u8, 8, 7, 6])));
        let mut work = Image::new(size, LinearRgba([0.5, 0.5, 0.5, 1.0]));
        assert!(matches!(source.with_image(&work).image, AnyImage::Srgb8(_)));
        work[(1, 0)] = LinearRgba([0.0, 0.0, 0.0, 0.25]);
        assert!(matches!(
            source.with_image(&work).image,
            AnyImage::Srgba8(_)
        ));

        let deep = Picture::from_image(Image::new(size, Srgb([1u16; 3])));
        assert!(matches!(deep.with_image(&work).image, AnyImage::Srgba16(_)));
        let float = Picture::from_image(Image::new(size, LinearRgb([0.1; 3])));
        assert!(matches!(
            float.with_image(&work).image,
            AnyImage::LinearAlpha(_)
        ));
        assert_eq!(float.origin.sample, SampleKind::F32);
    }

    #[test]
    fn rounding_does_not_color_a_gray() {
        let size = Size::new(2, 1).unwrap();
        let mut gray = Picture::from_image(Image::new(size, Srgb([9u8; 3])));
        // half a step of 8 bit lies between these two
        let between = ravec_raster::color::linear_from_srgb(100.5 / 255.0);
        let nearly = LinearRgba([between - 1e-6, between + 1e-6, between, 1.0]);
        let work = Image::new(size, nearly);
        let channels_differ = |picture: &Picture| match &picture.image {
            AnyImage::Srgb8(image) => image[(0, 0)].0[0] != image[(0, 0)].0[1],
            _ => panic!("another type"),
        };
        assert!(channels_differ(&gray.with_image(&work)));
        gray.origin.gray = true;
        assert!(!channels_differ(&gray.with_image(&work)));
    }
}
