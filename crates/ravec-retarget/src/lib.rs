//! Content-aware retargeting: one picture in many formats, with objects in shape and lines straight.
//!
//! A magazine, a phone and a social network ask for different formats of one photo. Scaling squeezes what is in it, cropping
//! loses it. Here a grid is laid over the picture and its vertices are moved: cells that matter keep their shape, straight
//! lines stay straight, and the rest absorbs the change.
//!
//! ```
//! use ravec_progress::Progress;
//! use ravec_raster::{Image, Size, Srgb};
//! use ravec_retarget::{Painted, RetargetParams, Retargeter};
//!
//! // a dark disc of radius 30 on a light ground
//! let photo = Image::from_fn(Size::new(240, 160)?, |col, row| {
//!     let r = (col as f64 - 119.5).hypot(row as f64 - 79.5);
//!     if r < 30.0 { Srgb([40u8, 40, 60]) } else { Srgb([230, 220, 200]) }
//! });
//! let params = RetargetParams { grid_cells: Some(40), ..RetargetParams::default() };
//! let retargeter = Retargeter::new(&photo, Painted::default(), &params, &Progress::none())?;
//!
//! // two thirds of the width: the disc stays round
//! let deformation = retargeter.solve(Size::new(160, 160)?)?;
//! let narrow = deformation.warp(&photo, &Progress::none())?;
//! let dark = |col: usize, row: usize| narrow[(col, row)].0[0] < 135;
//! let width = (0..160).filter(|&col| dark(col, 80)).count();
//! let height = (0..160).filter(|&row| dark(80, row)).count();
//! assert!(width.abs_diff(height) <= 3 && width > 54);
//!
//! // a further size is a further solution, without another analysis
//! assert_eq!(retargeter.solve(Size::new(240, 100)?)?.warp(&photo, &Progress::none())?.height(), 100);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # How
//!
//! 1. The picture is analyzed on a reduction: two-color pixels give contrast, those of 64 pixels' length straight lines, the
//!    barrier distance gives closed regions that stand out, masks give what the user knows better.
//! 2. Energies that are quadratic in the positions of the vertices are factored, for x and for y.
//! 3. For each size the minimum is a sum of two known vectors; where cells would fold, bounds on edges are met by a few
//!    solutions more.
//! 4. Each new pixel is looked up in the old picture and filtered once, in linear light.
//!
//! # Guarantees
//!
//! - No cell folds, whatever the picture and the size: the map is one to one.
//! - If both sides change by one factor, the result is plain scaling.
//! - Every pixel of the result is written once; a size that does not change gives the picture bit for bit.
//! - The same bytes on any number of threads.
//!
//! # Not guaranteed
//!
//! - That what you care for is found: a figure that touches the border or is as rough as its ground may count as ground.
//!   Paint it.
//! - That objects keep their shape where there is no room for them: at a quarter of the width something must give.
//! - Curves: only straight lines are held, those of a thirteenth of the longer side and more. Of a curve each cell keeps its shape as well as its weight allows.
//! - The same last bits on machines with other vector units.
//!
//! # Words
//!
//! *Unit*: the smallest cell of the grid. *Run*: a straight line of the picture. *Weight*: how much a cell resists.
//! *Bounded edge*: one that had to be kept from folding.
//!
//! Source: D. Pavić and L. Kobbelt, "Two-Colored Pixels", Eurographics 2010.
//!
//! # Current status
//!
//! Pictures, and frames of clips in memory: see [`clip`]. Files of clips are read and written elsewhere.

mod analysis;
mod barrier;
mod bounds;
pub mod clip;
mod deformation;
mod forms;
mod grid;
mod importance;
mod locate;
mod overlay;
mod params;
mod quadtree;
mod retargeter;
mod runs;
mod strips;
mod system;
mod trace;
mod warp;

pub use deformation::{Deformation, GridLine, SolveSummary};
pub use params::{Borders, RetargetError, RetargetParams};
pub use retargeter::{AnalysisSummary, Painted, Retargeter};
pub use warp::{WarpCell, WarpFilter, WarpPlan, WarpSpan};
