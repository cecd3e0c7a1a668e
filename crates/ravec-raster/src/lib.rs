//! Pixels in memory: images with typed colour, sampling, filters and metrics.

mod any;
pub mod color;
mod image;
mod pixel;
mod size;

pub use any::AnyImage;
pub use image::{Image, Plane};
pub use pixel::{
    Color, LinearRgb, LinearRgba, Oklab, Pixel, PremulLinearRgba, Sample, Srgb, Srgba,
};
pub use size::{Size, SizeError};
