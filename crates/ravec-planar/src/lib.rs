//! Planes in pictures.
mod estimate;
mod homography;
#[cfg(test)]
mod strategies;
pub use estimate::{PointPair, estimate, estimate_linear, refine, symmetric_transfer_error};
pub use homography::{Homography, HomographyError};
