//! Pixels in memory: images whose type says what their numbers mean, and what one does with them before anything
//! clever.
//!
//! It is the vocabulary of all other crates: they pass [`Image`], [`Mask`] and [`Rect`] to one another, and rely on the
//! same sampling, filters and measures.
//!
//! ```
//! use glam::dvec2;
//! use ravec_raster::{
//!     Image, LinearRgb, Mask, ResizeFilter, Size, Srgb, compare, gaussian_blur, resize,
//! };
//!
//! // a picture as a file holds it: a dark left half, a bright right half
//! let photo = Image::from_fn(Size::new(64, 48)?, |col, _| {
//!     Srgb(if col < 32 { [40u8, 40, 60] } else { [230, 220, 200] })
//! });
//!
//! // soften it in linear light, but only within a disc
//! let light = photo.convert::<LinearRgb>();
//! let soft = gaussian_blur(&light, 2.0);
//! let disc = Mask::from_disc(photo.size(), dvec2(32.0, 24.0), 10.0)?;
//! let mixed = Image::from_fn(photo.size(), |col, row| {
//!     let (share, at) = (disc.at(col, row), (col, row));
//!     LinearRgb([0, 1, 2].map(|i| light[at].0[i] + share * (soft[at].0[i] - light[at].0[i])))
//! });
//! let edited = mixed.convert::<Srgb<u8>>();
//!
//! // how much that shows, where it does, and a thumbnail
//! let found = compare(&photo, &edited)?;
//! assert!(found.psnr_db > 25.0 && found.ssim > 0.9);
//! assert_eq!(edited[(32, 2)], photo[(32, 2)]);
//! assert_ne!(edited[(32, 24)], photo[(32, 24)]);
//! let thumbnail = resize(&edited, Size::new(16, 12)?, ResizeFilter::Lanczos3);
//! assert_eq!(thumbnail.width(), 16);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Conventions
//!
//! - `(col, row)` are integers, `(x, y)` reals; y goes down. The center of pixel `(col, row)` is at
//!   `(col + 0.5, row + 0.5)`, and an image of `w` × `h` pixels spans `0..w` × `0..h`.
//! - Linear light is the default. Encoded values are another type ([`Srgb`], [`Srgba`]), straight and premultiplied
//!   alpha are different types, and only types that [`Average`] allows can be averaged, filtered or sampled.
//! - Samples are `f32`, positions and sums `f64`. Lengths are in pixels unless the name says otherwise.
//! - Beyond its border an image goes on with its border pixels.
//! - An image has at least one pixel ([`Size`]). A [`Rect`] may be empty.
//!
//! # What is here
//!
//! | for | use |
//! | --- | --- |
//! | holding pixels | [`Image`], [`Plane`], [`AnyImage`], [`Size`], [`Rect`], the pixel types |
//! | values between pixels | [`Image::sample`] and [`Interpolation`], [`Image::area_average`] |
//! | other sizes | [`resize()`], [`Pyramid`], [`halved`] |
//! | neighborhoods | [`gaussian_blur`], [`elliptic_gaussian_blur`], [`Gradient`], [`Integral`], [`distance_to`] |
//! | regions | [`Mask`] |
//! | edges | [`Segment`] |
//! | differences | [`compare`], [`psnr_db`], [`ssim_map`], [`delta_e_map`], [`ciede2000`] |
//! | long work | [`for_each_strip`], [`map_strips`], [`tiles`] |
//!
//! # Guarantees
//!
//! - The same input gives the same bytes on any number of threads; work runs in the caller's `rayon` pool.
//! - 8- and 16-bit values survive the way through linear light and back.
//! - No function panics because of what the numbers of a picture are; NaN goes where its documentation says. Panics on
//!   an index outside an image, or a strip of 0 rows, are documented at the function.
//!
//! # Not guaranteed
//!
//! - The same last bits on machines with other vector units or mathematics libraries, for resizing and for CIEDE2000.
//! - Anything about colors beyond sRGB primaries: wider gamuts live as values below 0 or above 1.
//! - Cancellation within a single filter or resize; only [`compare_with_progress`] and work cut into strips have it.
//!
//! # Words
//!
//! *Plane*: an image of one real channel. *Coverage*: the share of a pixel's area, 0 to 1. *Encoded*: sRGB values as
//! files and screens use them. *Strip*: some whole rows. *Tile*: a square of pixels. *Halo*: the rows around a strip that
//! its filters look at.
//!
//! # Current status
//!
//! Complete for two-colored pixels and what builds on them. Vectors come from the compiler at the build's target; only
//! resizing chooses them at run time. There are no files here: see `ravec-media`.

mod any;
mod average;
mod chunks;
pub mod color;
mod coverage;
mod delta_e;
mod distance;
mod elliptic;
mod filter;
mod image;
mod integral;
mod mask;
mod metrics;
mod pixel;
mod pyramid;
mod rect;
mod resize;
mod rows;
mod sample;
mod segment;
mod size;
mod ssim;
mod strips;

pub use any::AnyImage;
pub use average::Average;
pub use delta_e::{ciede2000, delta_e_oklab, lab_from_linear};
pub use distance::distance_to;
pub use elliptic::{BlurCovariance, elliptic_gaussian_blur};
pub use filter::{Gradient, gaussian_blur};
pub use image::{Image, Plane};
pub use integral::Integral;
pub use mask::{Mask, MaskError};
pub use metrics::{
    Comparison, MetricError, compare, compare_with_progress, delta_e_map, psnr_db, ssim_map,
};
pub use pixel::{
    Color, LinearRgb, LinearRgba, Oklab, Pixel, PremulLinearRgba, Sample, Srgb, Srgba,
};
pub use pyramid::{Pyramid, Reduction, halved};
pub use rect::{Rect, tiles};
pub use resize::{Resample, ResizeFilter, resize};
pub use rows::LinearRows;
pub use sample::Interpolation;
pub use segment::Segment;
pub use size::{Size, SizeError};
pub use strips::{for_each_strip, map_strips};
