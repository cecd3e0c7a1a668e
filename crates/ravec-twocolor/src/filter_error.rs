//! Errors of operators on windows: filters, cleaning, stamps and enlargement.

use crate::field::FitError;
use ravec_progress::Cancelled;

/// Why a filter was not applied.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FilterError {
    /// The side of the windows is out of range.
    #[error("the window is {got} pixels a side: choose {expected}")]
    Window {
        /// The requested side.
        got: usize,
        /// Supported sides.
        expected: &'static str,
    },
    /// A strength is out of range.
    #[error("the strength is {got}: choose 0 to 1")]
    Strength {
        /// The requested strength.
        got: f32,
    },
    /// A number of iterations is out of range.
    #[error("the number of iterations is {got}: choose 1 to 16")]
    Iterations {
        /// The requested number.
        got: u32,
    },
    /// The region holds no pixel of the image.
    #[error("the region lies outside the image")]
    EmptyRegion,
    /// The spacing of the windows does not fit their side.
    #[error("the spacing of windows of {side} pixels is {got}: choose 1 to {side}")]
    Stride {
        /// The requested spacing.
        got: usize,
        /// The window's side.
        side: usize,
    },
    /// The noise level is out of range.
    #[error("the noise level is {got}: choose 0 to 255")]
    Noise {
        /// The requested noise level.
        got: f32,
    },
    /// The two-color pixels of a filter cannot be fitted.
    #[error(transparent)]
    Fit(FitError),
    /// The caller cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<FitError> for FilterError {
    fn from(error: FitError) -> Self {
        match error {
            FitError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Fit(other),
        }
    }
}
