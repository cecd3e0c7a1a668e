//! Operations as data: a struct with paths and parameters that can be stored, compared and run.

use crate::context::Context;
use crate::error::JobError;
use crate::report::Report;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// An operation with its files and parameters.
///
/// A new operation is a struct in a file of its own that implements this trait, a `mod` line, and a line in the list of
/// [`Step`](crate::Step): the command line, recipes and reports follow from these.
///
/// The struct has its paths as fields, and its other parameters in a field `params`. With the feature `cli` its fields are
/// the flags of the command line, and its documentation is the help.
pub trait Operation: Serialize {
    /// The name, as it is called on the command line and in recipes; two words for an operation of a group.
    const NAME: &'static str;

    /// True if the result is data, which a program prints, rather than a file.
    const PRINTS_RESULT: bool = false;

    /// The files and folders that are read; `-` is standard input.
    fn inputs(&self) -> Vec<&Path>;

    /// The files that are written, without those in [`folders`](Self::folders); `-` is standard output.
    fn outputs(&self) -> Vec<&Path>;

    /// The folders that are filled. They are created if they are missing.
    fn folders(&self) -> Vec<&Path> {
        Vec::new()
    }

    /// More files that no output of this or another operation may replace while this one runs.
    fn side_files(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// Checks the parameters and files, reads the inputs, works in the caller's thread pool and writes the outputs, each whole
    /// or not at all. Nothing is read before parameters and files are checked.
    ///
    /// # Errors
    /// [`JobError::Parameter`], what [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`], and what
    /// the operation documents.
    fn run(&self, context: &Context) -> Result<Report, JobError>;
}

/// An [`Operation`] whose type is known only when the program runs.
pub trait AnyOperation: Sync {
    /// See [`Operation::NAME`].
    fn name(&self) -> &'static str;
    /// See [`Operation::PRINTS_RESULT`].
    fn prints_result(&self) -> bool;
    /// See [`Operation::inputs`].
    fn inputs(&self) -> Vec<&Path>;
    /// See [`Operation::outputs`].
    fn outputs(&self) -> Vec<&Path>;
    /// See [`Operation::folders`].
    fn folders(&self) -> Vec<&Path>;
    /// See [`Operation::side_files`].
    fn side_files(&self) -> Vec<PathBuf>;
    /// See [`Operation::run`].
    ///
    /// # Errors
    /// Those of the operation.
    fn run(&self, context: &Context) -> Result<Report, JobError>;
}

impl<O: Operation + Sync> AnyOperation for O {
    fn name(&self) -> &'static str {
        O::NAME
    }

    fn prints_result(&self) -> bool {
        O::PRINTS_RESULT
    }

    fn inputs(&self) -> Vec<&Path> {
        Operation::inputs(self)
    }

    fn outputs(&self) -> Vec<&Path> {
        Operation::outputs(self)
    }

    fn folders(&self) -> Vec<&Path> {
        Operation::folders(self)
    }

    fn side_files(&self) -> Vec<PathBuf> {
        Operation::side_files(self)
    }

    fn run(&self, context: &Context) -> Result<Report, JobError> {
        Operation::run(self, context)
    }
}

/// The paths of required and optional files, in one list.
pub(crate) fn paths<'a>(
    first: &'a Path,
    more: impl IntoIterator<Item = &'a Option<PathBuf>>,
) -> Vec<&'a Path> {
    let more = more.into_iter().filter_map(Option::as_deref);
    std::iter::once(first).chain(more).collect()
}
