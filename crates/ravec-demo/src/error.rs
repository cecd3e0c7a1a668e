//! Errors of operations whose inputs and parameters are constants of this crate.

use ravec_jobs::JobError;

/// Reports that an operation refused the constants of the page, which no user can change.
pub fn bug(name: &'static str, error: &impl std::fmt::Display) -> JobError {
    JobError::Parameter {
        field: name,
        value: error.to_string(),
        range: "possible",
    }
}
