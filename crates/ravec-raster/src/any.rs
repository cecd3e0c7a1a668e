//! An image whose pixel type is known only at run time: what a file holds.

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

    /// Whether the pixel type stores alpha (it may still be 1 everywhere).
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
