//! A frame: a picture and its time.

use crate::convert::{image_from_yuv, yuv_from_image};
use crate::time::FrameTime;
use crate::yuv::YuvImage;
use ravec_raster::{AnyImage, Size};
use std::borrow::Cow;

/// Pixels of a frame, as the source holds them.
#[derive(Debug, Clone, PartialEq)]
pub enum FramePicture {
    /// Planes of a codec. Conversions to a sink of the same layout do not touch the samples.
    Yuv(YuvImage),
    /// Colors.
    Image(AnyImage),
}

impl FramePicture {
    /// Columns and rows.
    pub fn size(&self) -> Size {
        match self {
            Self::Yuv(planes) => planes.size(),
            Self::Image(image) => image.size(),
        }
    }

    /// The colors: encoded sRGB of 8 bits, or of 16 bits for deeper planes; images as they are.
    pub fn to_image(&self) -> Cow<'_, AnyImage> {
        match self {
            Self::Yuv(planes) => Cow::Owned(image_from_yuv(planes)),
            Self::Image(image) => Cow::Borrowed(image),
        }
    }

    /// As [`to_image`](Self::to_image), without a copy of an image.
    pub fn into_image(self) -> AnyImage {
        match self {
            Self::Yuv(planes) => image_from_yuv(&planes),
            Self::Image(image) => image,
        }
    }

    /// Planes of that layout and meaning: the same samples if they have it already.
    pub fn to_yuv(&self, format: crate::YuvFormat, color: crate::ColorInfo) -> Cow<'_, YuvImage> {
        match self {
            Self::Yuv(planes) if planes.format() == format && planes.color().same_codes(&color) => {
                Cow::Borrowed(planes)
            }
            Self::Yuv(planes) => Cow::Owned(yuv_from_image(&image_from_yuv(planes), format, color)),
            Self::Image(image) => Cow::Owned(yuv_from_image(image, format, color)),
        }
    }
}

/// A picture with its time.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The pixels, upright.
    pub picture: FramePicture,
    /// Time stamp and duration in ticks of the time base of the clip.
    pub time: FrameTime,
}

impl crate::ColorInfo {
    /// True if the same samples have the same colors at the same places.
    pub fn same_codes(&self, other: &Self) -> bool {
        (self.matrix, self.range, self.siting) == (other.matrix, other.range, other.siting)
    }
}
