//! Named operations on files: parameters, progress, reports.
//!
//! An operation is what a user asks for by one name. Here each has a module with its `Params` (data with documented
//! ranges and defaults; with the feature `cli` also the flags of the command line) and a `run`, which reads its inputs,
//! works in the caller's thread pool, writes its outputs whole or not at all, and returns a [`Report`].
//!
//! ```
//! use ravec::progress::Progress;
//! use ravec_jobs::{Source, compare, scenes};
//!
//! let folder = tempfile::tempdir()?;
//! let params = scenes::Params { width: Some(64), height: Some(48), ..scenes::Params::default() };
//! scenes::run(folder.path(), &params, &Progress::none())?;
//!
//! let disc = Source::new(folder.path().join("disc.png"));
//! let report = compare::run(&disc, &disc, &compare::Params::default(), &Progress::none())?;
//! assert_eq!(report.figures["max_difference_steps"], 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Guarantees: nothing is printed and nothing is asked; a failed or cancelled run leaves its inputs as they were, and no
//! half-written file; parameters are checked before anything is read. Does not guarantee: that outputs which were
//! finished before a failure are removed.
//!
//! Words: a *source* is a file to be read and what that may cost; a *figure* is a measured number with its unit in its
//! name.

pub mod brush;
pub mod catalogue;
pub mod compare;
pub mod complete;
pub mod demo;
mod error;
mod files;
mod gallery;
mod identity;
mod mask;
pub mod match_photos;
pub mod mesh;
pub mod mosaic;
pub mod plane;
mod report;
pub mod retarget;
pub mod scenes;
mod text;
pub mod twocolor;

pub use error::JobError;
pub use files::{Source, check_files, check_folder, write_text};
pub use ravec_media::{Limits, abandon_outputs};
pub use report::{FileReport, Finding, Place, Report, Timing};
pub use text::{escape_controls, escape_except};
