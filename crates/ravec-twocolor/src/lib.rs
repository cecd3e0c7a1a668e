//! Two-color pixels: blocks of an image replaced by one line and two colors, and what they are good for.
//!
//! A block of N × N pixels rarely needs N² colors: a line through it and a color on each side come close, keep edges sharp
//! at any scale, and say on which side of an edge a pixel lies. That makes them a vector view of a picture, and the ground
//! of filters and brushes that do not cross edges.
//!
//! ```
//! use ravec_progress::Progress;
//! use ravec_raster::{Image, Size, Srgb};
//! use ravec_twocolor::{FitParams, TwoColorField};
//!
//! // a dark disc on a light ground
//! let disc = Image::from_fn(Size::new(64, 64)?, |col, row| {
//!     let (x, y) = (col as f64 - 31.5, row as f64 - 31.5);
//!     if x.hypot(y) < 20.0 { Srgb([40u8, 40, 60]) } else { Srgb([230, 220, 200]) }
//! });
//! let mut field = TwoColorField::fit(&disc, &FitParams::default(), &Progress::none())?;
//! field.refine_lines(&disc, &Progress::none())?;
//!
//! let rim = field.block(1, 3);
//! let line = rim.line.expect("the disc's rim crosses this block");
//! assert!(line.normal.x.abs() > 0.9, "the rim is upright there");
//! assert!(field.block(3, 3).is_flat(), "the disc's middle has one color");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Words
//!
//! - *Block*: a square of N × N pixels of the regular grid; the last column and row may reach beyond the image.
//! - *Window*: such a square anywhere, usually centered at a pixel.
//! - *Split*: the pixels of a block on each side of a line. Many lines make the same split.
//! - *Gain*: by how much a split lowers the squared error below that of one color.
//! - *Flat*: a block whose best gain is too small to earn a line.
//! - *Side 0*, *side 1*: where `n·p < d`, and the rest.
//!
//! # Guarantees
//!
//! - Up to N = 16 (32 on request) the split is the best of *all* splits of the block by a line, with transparency and at
//!   borders too; ties go to the first in the order of the sweep. Held to plain enumeration by tests.
//! - The same bits on every instruction set and any number of threads.
//! - Any image size from 1 × 1 on; fully transparent pixels never influence a color.
//!
//! # Non-guarantees
//!
//! - Larger blocks are fitted coarse to fine: the error is on average 1.008 times the best (see `docs/measurements.md`).
//! - Colors are fitted in Oklab, so errors are near perceived ones, not least squares of encoded values.
//! - A pixel that is not finite makes its own block flat, with a meaningless color.
//!
//! Source: D. Pavić and L. Kobbelt, "Two-Colored Pixels", Eurographics 2010; known in signal processing as wedgelets
//! (D. Donoho, "Wedgelets: nearly minimax estimation of edges", 1999).

mod adaptive;
pub mod brush;
mod clean;
mod coarse_to_fine;
mod dense;
mod enlarge;
mod field;
mod filter_error;
mod fit;
mod line;
mod operator;
mod pixel;
mod placed;
mod pointwise;
mod render;
mod segments;
mod split_sums;
mod split_table;
mod stamp;
mod subpixel;
mod svg;
mod sweep;
pub mod volume;

pub use adaptive::{AdaptiveField, AdaptiveParams, Leaf};
pub use clean::{
    BlockQuantization, CleanParams, CleanStrip, NoiseLevel, WindowShrinkage, clean, clean_by,
    clean_with, estimate_noise, estimate_noise_of_compressed,
};
pub use coarse_to_fine::RefinedSplit;
pub use dense::{CenteredWindow, WindowParams, map_windows};
pub use enlarge::{EnlargeError, enlarge};
pub use field::{FitError, FitMethod, FitParams, TwoColorField};
pub use filter_error::FilterError;
pub use line::Line;
pub use operator::{Mode, OperatorParams, operate};
pub use pixel::TwoColorPixel;
pub use placed::{BlockField, PlacedBlock};
pub use render::{RenderError, render, render_mosaic, render_to};
pub use segments::line_segments;
pub use split_sums::{MAX_FITTED_LIGHT, MIN_FITTED_WEIGHT, SplitSums, SweepTable};
pub use split_table::{MAX_EXACT_SIDE, split_count};
pub use subpixel::refine_line;
pub use svg::{MAX_SVG_SIDE, SvgParams, write_svg};
