//! Pixels in memory: images with typed colour, sampling, filters and metrics.

mod any;
mod average;
pub mod color;
mod coverage;
mod delta_e;
mod distance;
mod filter;
mod image;
mod integral;
mod mask;
mod metrics;
mod pixel;
mod pyramid;
mod rect;
mod resize;
mod sample;
mod size;
mod ssim;
mod strips;

pub use any::AnyImage;
pub use average::Average;
pub use delta_e::{ciede2000, delta_e_oklab, lab_from_linear};
pub use distance::distance_to;
pub use filter::{Gradient, gaussian_blur};
pub use image::{Image, Plane};
pub use integral::Integral;
pub use mask::{Mask, MaskError};
pub use metrics::{Comparison, MetricError, compare, compare_with_progress, delta_e_map, ssim_map};
pub use pixel::{
    Color, LinearRgb, LinearRgba, Oklab, Pixel, PremulLinearRgba, Sample, Srgb, Srgba,
};
pub use pyramid::{Pyramid, Reduction, halved};
pub use rect::{Rect, tiles};
pub use resize::{Resample, ResizeFilter, resize};
pub use sample::Interpolation;
pub use size::{Size, SizeError};
pub use strips::{for_each_strip, map_strips};
