//! Errors as exceptions, each with the sentence of the library.

use pyo3::PyErr;
use pyo3::exceptions::{
    PyException, PyFileNotFoundError, PyKeyboardInterrupt, PyMemoryError, PyOSError,
    PyPermissionError, PyValueError,
};
use ravec_jobs::{ErrorKind, JobError};
use std::io;

pyo3::create_exception!(
    ravec,
    Error,
    PyException,
    "The work has no result: an input that is broken or exceeds a limit, or a task without a solution."
);

/// The exception of an error of an operation.
pub fn of_job(error: &JobError) -> PyErr {
    let sentence = error.to_string();
    // what came as an argument is a request, too
    let is_argument = matches!(
        error,
        JobError::SizesDiffer { .. } | JobError::Strokes { .. } | JobError::NoIntermediate { .. }
    );
    match (error.kind(), error.io_kind()) {
        (ErrorKind::Cancelled, _) => PyKeyboardInterrupt::new_err(sentence),
        (ErrorKind::Request, _) => PyValueError::new_err(sentence),
        (_, Some(io::ErrorKind::NotFound)) => PyFileNotFoundError::new_err(sentence),
        (_, Some(io::ErrorKind::PermissionDenied)) => PyPermissionError::new_err(sentence),
        (_, Some(io::ErrorKind::OutOfMemory)) => PyMemoryError::new_err(sentence),
        (ErrorKind::Output, Some(_)) => PyOSError::new_err(sentence),
        _ if is_argument => PyValueError::new_err(sentence),
        _ => Error::new_err(sentence),
    }
}

/// The exception of an error about what was asked for.
pub fn of_request(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The exception of an error of a library, which is about the task unless it is a cancellation.
pub fn of_task(error: impl std::fmt::Display) -> PyErr {
    let sentence = error.to_string();
    if sentence == ravec::progress::Cancelled.to_string() {
        return PyKeyboardInterrupt::new_err(sentence);
    }
    Error::new_err(sentence)
}
