//! An image whose pixel type is known only at run time, as one read from a file.

use crate::image::Image;
use crate::pixel::{Color, LinearRgb, LinearRgba, Srgb, Srgba};
use crate::size::Size;

/// An image in one of the pixel types that files have.
#[derive(Debug, Clone, PartialEq)]
pub enum AnyImage {
    /// 8 bit, opaque.
    Srgb8(Image<Srgb<u8>>),
    /// 8 bit with straight alpha.
    Srgba8(Image<Srgba<u8>>),
    /// 16 bit, opaque.
    Srgb16(Image<Srgb<u16>>),
    /// 16 bit with straight alpha.
    Srgba16(Image<Srgba<u16>>),
    /// Floats in linear light, opaque.
    Linear(Image<LinearRgb>),
    /// Floats in linear light with straight alpha.
    LinearAlpha(Image<LinearRgba>),
}

/// Runs the same generic code on whichever image is inside.
#[macro_export]
macro_rules! with_image {
    ($any:expr, $image:ident => $body:expr) => {
        match $any {
            $crate::AnyImage::Srgb8($image) => $body,
            $crate::AnyImage::Srgba8($image) => $body,
            $crate::AnyImage::Srgb16($image) => $body,
            $crate::AnyImage::Srgba16($image) => $body,
            $crate::AnyImage::Linear($image) => $body,
            $crate::AnyImage::LinearAlpha($image) => $body,
        }
    };
}

impl AnyImage {
    /// Columns and rows.
    pub fn size(&self) -> Size {
        with_image!(self, image => image.size())
    }

    /// Returns `true` if the pixel type stores alpha (it may still be 1 everywhere).
    pub fn has_alpha(&self) -> bool {
        matches!(
            self,
            Self::Srgba8(_) | Self::Srgba16(_) | Self::LinearAlpha(_)
        )
    }

    /// The picture in a given pixel type.
    pub fn convert<P: Color>(&self) -> Image<P> {
        with_image!(self, image => image.convert())
    }

    /// Converts another picture to the pixel type of this one, in which an edited picture should be stored. Integer
    /// types clip to their range.
    ///
    /// If this one has no alpha and the picture is not opaque, the type with alpha of the same kind is taken, so that
    /// transparency is never lost.
    #[must_use]
    pub fn like(&self, image: &Image<LinearRgba>) -> Self {
        let alpha = self.has_alpha() || !image.is_opaque();
        match (self, alpha) {
            (Self::Srgb8(_) | Self::Srgba8(_), false) => Self::Srgb8(image.convert()),
            (Self::Srgb8(_) | Self::Srgba8(_), true) => Self::Srgba8(image.convert()),
            (Self::Srgb16(_) | Self::Srgba16(_), false) => Self::Srgb16(image.convert()),
            (Self::Srgb16(_) | Self::Srgba16(_), true) => Self::Srgba16(image.convert()),
            (Self::Linear(_) | Self::LinearAlpha(_), false) => Self::Linear(image.convert()),
            (Self::Linear(_) | Self::LinearAlpha(_), true) => Self::LinearAlpha(image.clone()),
        }
    }
}

impl From<Image<Srgb<u8>>> for AnyImage {
    fn from(image: Image<Srgb<u8>>) -> Self {
        Self::Srgb8(image)
    }
}

impl From<Image<Srgba<u8>>> for AnyImage {
    fn from(image: Image<Srgba<u8>>) -> Self {
        Self::Srgba8(image)
    }
}

impl From<Image<Srgb<u16>>> for AnyImage {
    fn from(image: Image<Srgb<u16>>) -> Self {
        Self::Srgb16(image)
    }
}

impl From<Image<Srgba<u16>>> for AnyImage {
    fn from(image: Image<Srgba<u16>>) -> Self {
        Self::Srgba16(image)
    }
}

impl From<Image<LinearRgb>> for AnyImage {
    fn from(image: Image<LinearRgb>) -> Self {
        Self::Linear(image)
    }
}

impl From<Image<LinearRgba>> for AnyImage {
    fn from(image: Image<LinearRgba>) -> Self {
        Self::LinearAlpha(image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One pixel in each of the six types.
    fn all() -> [AnyImage; 6] {
        let size = Size::new(1, 1).unwrap();
        let pixel = LinearRgba([0.25, 0.5, 1.0, 1.0]);
        let image = Image::new(size, pixel);
        [
            image.convert::<Srgb<u8>>().into(),
            image.convert::<Srgba<u8>>().into(),
            image.convert::<Srgb<u16>>().into(),
            image.convert::<Srgba<u16>>().into(),
            image.convert::<LinearRgb>().into(),
            image.into(),
        ]
    }

    #[test]
    fn a_picture_comes_back_in_the_type_it_had() {
        for any in all() {
            assert_eq!(any.like(&any.convert()), any);
        }
    }

    #[test]
    fn a_transparent_picture_gets_a_type_with_alpha_of_the_same_kind() {
        let glass = Image::new(Size::new(1, 1).unwrap(), LinearRgba([0.25, 0.5, 1.0, 0.5]));
        for pair in all().chunks_exact(2) {
            let found = pair.iter().map(|any| any.like(&glass));
            for any in found {
                assert!(any.has_alpha());
                assert_eq!(
                    std::mem::discriminant(&any),
                    std::mem::discriminant(&pair[1])
                );
            }
        }
    }
}
