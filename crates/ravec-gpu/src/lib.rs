//! Two-color pixels, renderings and warps on a GPU, beside their twins on the CPU.
//!
//! ```no_run
//! use ravec_gpu::{DeviceChoice, Gpu, OpenOptions, fit};
//! use ravec_progress::Progress;
//! use ravec_raster::{Image, Size, Srgb};
//! use ravec_twocolor::{FitParams, TwoColorField};
//!
//! let image = Image::from_fn(Size::new(640, 480)?, |col, row| Srgb([col as u8, row as u8, 0u8]));
//! let (params, progress) = (FitParams::default(), Progress::none());
//! let field = match Gpu::open(&DeviceChoice::Auto, OpenOptions::default())? {
//!     Some(gpu) => fit(&gpu, &image, &params, &progress)?,
//!     None => TwoColorField::fit(&image, &params, &progress)?,
//! };
//! # let _ = field;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | function | its twin | result |
//! | --- | --- | --- |
//! | [`fit()`] | [`TwoColorField::fit`](ravec_twocolor::TwoColorField::fit) | the same bits: exact in blocks of 2, 4, 8 and 16 pixels, coarse to fine in blocks of 8, 16, 32 and 64 |
//! | [`refine_lines`] | [`TwoColorField::refine_lines`](ravec_twocolor::TwoColorField::refine_lines) | 98 of 100 lines within 0.01 pixels |
//! | [`fit_refined`] | both, one after the other | that of both, with one upload of the picture |
//! | [`render_field`] | [`render_to`](ravec_twocolor::render_to), [`render_mosaic`](ravec_twocolor::render_mosaic) | light within 1e-5 |
//! | [`operate_on`] | [`operate`](ravec_twocolor::operate) | abstract and smooth: the same bits, within 1e-5 at transparency and borders; sharpen and antialias: light within 1e-4 |
//! | [`clean()`] | [`clean_with`](ravec_twocolor::clean_with) | the same bits, windows of 4, 8 and 16 pixels |
//! | [`warp_deformed`] | [`Deformation::warp`](ravec_retarget::Deformation::warp) | light within 1e-3, samples of 8 bit within a step |
//! | [`warp_homography`] | [`warp`](fn@ravec_planar::warp) | light within 2e-3 |
//!
//! The modules of the functions state the bounds in full; tests hold the kernels to them on a software driver.
//!
//! # The same bits
//!
//! Sums, differences and products of floats are rounded correctly on every device; quotients are not, and a compiler may
//! contract a product and a sum to one operation with one rounding. Kernels that promise bits hide their products from the
//! compiler and correct their quotients in integers (`exact.wgsl`). [`Gpu::open`] fits a small picture on the device and on the
//! CPU, and refuses a device whose field differs.
//!
//! # Guarantees
//!
//! - No function fails because of the device: what a lost device or an exhausted memory leaves is computed on the CPU, and
//!   [`Gpu::take_warnings`] says so.
//! - Software drivers are used by name only.
//! - Pictures of any size: they go in bands, several in flight, within the default limits of WebGPU.
//! - Cancellation within a band, which takes a fraction of a second.
//!
//! # Non-guarantees
//!
//! - Floats in linear light below 1e-38 may be taken as 0.
//! - Blocks of other sides, windows above 17 pixels and blocks of several sizes stay on the CPU, without a warning.
//! - That the GPU is faster: a small picture takes longer than on the CPU, for the way there and back.

mod clean;
mod coarse_to_fine;
mod dense;
mod device;
mod error;
mod fit;
mod fit_refined;
mod grid_warp;
mod homography_warp;
mod plane;
mod probe;
mod refine;
mod render;
pub mod timing;
mod upload;
mod work;

pub use clean::clean;
pub use coarse_to_fine::COARSE_TO_FINE_SIDES;
pub use dense::{MAX_WINDOW_PX, operate_on};
pub use device::{AdapterInfo, DeviceChoice, Gpu, OpenOptions, adapters};
pub use error::GpuError;
pub use fit::{FITTED_SIDES, fit};
pub use fit_refined::fit_refined;
pub use grid_warp::warp_deformed;
pub use homography_warp::warp_homography;
pub use refine::refine_lines;
pub use render::{RenderStyle, render_field};
pub use upload::GpuPixel;
