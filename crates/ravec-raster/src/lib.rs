//! Pixels in memory: images with typed colour, sampling, filters and metrics.

mod any;
mod average;
pub mod color;
mod coverage;
mod distance;
mod filter;
mod image;
mod integral;
mod mask;
mod pixel;
mod pyramid;
mod rect;
mod resize;
mod sample;
mod size;
mod strips;

pub use any::AnyImage;
pub use average::Average;
pub use distance::distance_to;
pub use filter::{Gradient, gaussian_blur};
pub use image::{Image, Plane};
pub use integral::Integral;
pub use mask::{Mask, MaskError};
pub use pixel::{
    Color, LinearRgb, LinearRgba, Oklab, Pixel, PremulLinearRgba, Sample, Srgb, Srgba,
};
pub use pyramid::{Pyramid, Reduction, halved};
pub use rect::{Rect, tiles};
pub use resize::{Resample, ResizeFilter, resize};
pub use sample::Interpolation;
pub use size::{Size, SizeError};
pub use strips::{for_each_strip, map_strips};
