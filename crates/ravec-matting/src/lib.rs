//! Alpha matting: the share of foreground in each pixel, and its colors without those of the background.
//!
//! A pixel of a picture is `alpha · foreground + (1 − alpha) · background`. With a known background, the *plate*,
//! three of the seven unknowns of a pixel are given, and alpha can be found even in hair and veils ([`plate_matte`]). Without one, a
//! trimap or strokes mark pixels of both sides ([`still_matte`]).
//!
//! ```
//! use ravec_matting::{Colors, PlateFrame, PlateParams, plate_matte};
//! use ravec_progress::Progress;
//! use ravec_raster::{Image, Size};
//!
//! // a wall with a pattern, and a red square before it
//! let size = Size::new(64, 48)?;
//! let plate: Colors = Image::from_fn(size, |col, row| {
//!     let wave = 0.2 * (0.5 * col as f32).sin() * (0.4 * row as f32).cos();
//!     [0.5 + wave, 0.5 - wave, 0.4]
//! });
//! let mut frame = plate.clone();
//! for row in 12..30 {
//!     frame.row_mut(row)[20..40].fill([0.9, 0.1, 0.1]);
//! }
//! let found = plate_matte(&PlateFrame::new(&frame, &plate), &PlateParams::default(), &Progress::none())?;
//! assert!(found.matte.alpha[(30, 20)] > 0.95 && found.matte.alpha[(5, 5)] == 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Conventions
//!
//! - Colors are sRGB-encoded, 0 to 1 ([`Colors`]): noise is about even there.
//! - Internally they are in units of the noise of each channel.
//! - Lengths are in pixels of the picture; what is smooth is computed at half its size.
//!
//! # Guarantees
//!
//! - Alpha is exactly 0 and 1 where strokes say so.
//! - A frame that differs from its plate only by light and noise has an empty matte.
//! - The same input gives the same bytes on any number of threads; work runs in the caller's `rayon` pool.
//! - No function panics because of what the numbers of a picture are.
//!
//! # Not guaranteed
//!
//! - Alpha where foreground has the colors of the plate and neither has texture: strokes help.
//! - Shadows are foreground unless [`Shadows`] says otherwise.
//! - Foreground that differs from the plate by as little as compression does is taken for noise.
//! - A shift of the plate above about a pixel is not found: align the plate first.

mod approximate;
mod detect;
mod field;
mod half;
mod laplacian;
mod levels;
mod light;
mod matte;
mod mixture;
mod plate;
mod posterior;
mod region;
mod shadow;
mod speckles;
mod still;
mod symmetric;
mod texture;
mod window;

pub use light::PlateLight;
pub use matte::{Colors, Constraint, Constraints, Matte, MattingError};
pub use plate::{NEAR_PX, PlateFrame, PlateMatte, PlateParams, plate_matte, plate_matte_near};
pub use shadow::Shadows;
pub use still::{StillMatte, still_matte};
