//! Named operations on files: parameters, progress, reports.

mod report;

pub use report::{FileReport, Report, Timing};
