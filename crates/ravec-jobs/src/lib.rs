//! Named operations on files: parameters, progress, reports.
//!
//! An [`Operation`] is data: a struct with the paths of its files and its `params`, which have documented ranges and defaults.
//! It can be compared, stored as JSON and, with the feature `cli`, read from the command line. [`Operation::run`] reads the
//! inputs, works in the caller's thread pool, writes the outputs whole or not at all, and returns a [`Report`].
//!
//! ```
//! use ravec_jobs::{Context, Operation as _, compare::Compare, scenes};
//!
//! let folder = tempfile::tempdir()?;
//! let params = scenes::Params { width: Some(64), height: Some(48), ..scenes::Params::default() };
//! scenes::Scenes { out: folder.path().into(), params }.run(&Context::default())?;
//!
//! let disc = folder.path().join("disc.png");
//! let compare = Compare { a: disc.clone(), b: disc, plot: None, params: Default::default() };
//! let report = compare.run(&Context::default())?;
//! assert_eq!(report.figures["max_difference_steps"], 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`Recipe`] is a list of operations, each a [`Step`]; in it, outputs such as `@wide` stay in memory for later steps.
//!
//! Guarantees: nothing is printed and nothing is asked; a failed or cancelled run leaves its inputs as they were, and no
//! half-written file; parameters are checked before anything is read. Does not guarantee: that outputs which were
//! finished before a failure are removed.
//!
//! Words: the *context* of a run is its progress, its limits and its intermediate results; a *figure* is a measured number
//! with its unit in its name; a *verdict* is about the file that was written; a *finding* is a list of places, such as the boundary edges of a mesh.

pub mod brush;
pub mod catalogue;
pub mod compare;
pub mod complete;
mod context;
mod corners;
mod device;
mod error;
mod files;
mod frame_mark;
mod identity;
mod marks;
mod mask;
pub mod match_photos;
pub mod matte;
pub mod mesh;
pub mod mosaic;
mod operation;
mod pixel_centers;
pub mod plane;
pub mod plate;
pub mod recipe;
mod report;
pub mod retarget;
pub mod scenes;
mod shot;
pub mod stabilize;
mod step;
mod text;
pub mod track;
pub mod twocolor;
mod verdict;
pub mod video;

pub use context::Context;
pub use device::Device;
pub use error::{ErrorKind, JobError};
pub use files::{
    check_files, check_folder, make_folder, read as read_picture, write_output_text, write_text,
};
pub use frame_mark::{FrameMark, Side};
pub use operation::{AnyOperation, Operation};
pub use pixel_centers::PixelCenters;
pub use ravec_files::abandon_outputs;
pub use ravec_media::Limits;
pub use recipe::Recipe;
pub use report::{FileReport, Finding, Place, Report, Timing};
pub use step::Step;
pub use text::{escape_controls, escape_except};
pub use verdict::Verdict;
