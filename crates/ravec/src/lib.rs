//! Raster and vector views of images that work together: all libraries of Ravec under one name.
//!
//! Pixels are robust and easy to search; lines and polygons are exact and easy to edit. Ravec holds both views of the same
//! data and moves between them.
//!
//! | module | what is in it |
//! | --- | --- |
//! | [`raster`] | images with typed colors, sampling, filters, metrics |
//! | [`progress`] | progress and cancellation of long work |
//!
//! Everything here works on pixels in memory. Files are read and written by the crate `ravec-media`, which is not part of
//! this one, so that a program which has its pixels already does not compile codecs.
//!
//! # Images say what their pixels mean
//!
//! The pixel type carries color space, sample kind and alpha, so that a wrong mixture does not compile. Averaging belongs
//! in linear light, and the difference is not small: the mean of black and white is a much lighter grey than the mean of
//! their encoded values.
//!
//! ```
//! use ravec::raster::{Color, Image, LinearRgb, Size, Srgb};
//!
//! let stripes = Image::from_fn(Size::new(64, 64)?, |col, _| Srgb([255 * (col % 2) as u8; 3]));
//! let linear = stripes.convert::<LinearRgb>();
//! let mean = linear.pixels().iter().map(|pixel| pixel.0[0]).sum::<f32>() / 4096.0;
//! let grey = Srgb::<u8>::from_linear(LinearRgb([mean; 3]).to_linear());
//! assert_eq!(grey, Srgb([188; 3]));
//! # Ok::<(), ravec::raster::SizeError>(())
//! ```
//!
//! # Long work can be watched and stopped
//!
//! Whatever may take longer than a moment takes a [`progress::Progress`]. It is the caller who decides what becomes of it.
//!
//! ```
//! use ravec::progress::{Cancelled, Progress};
//!
//! let progress = Progress::new(|update| eprintln!("{}: {:.0} %", update.phase, 100.0 * update.fraction()));
//! let phase = progress.phase("rows", 2);
//! phase.advance(1);
//! progress.cancel();
//! assert_eq!(progress.check(), Err(Cancelled));
//! ```
//!
//! # Conventions
//!
//! - y points down; the center of pixel `(col, row)` is at `(col + 0.5, row + 0.5)`.
//! - `(col, row)` are integers, `(x, y)` are reals; sizes are width × height.
//! - Samples are `f32`, geometry is `f64`, vectors are those of `glam`.
//! - Colors are in linear light with sRGB primaries unless their type says otherwise.
//! - Straight and premultiplied alpha are different types; only premultiplied pixels are averaged.
//! - Same input, parameters and seed give the same bytes, on any number of threads.

pub use ravec_progress as progress;
pub use ravec_raster as raster;
