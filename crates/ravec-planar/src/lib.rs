//! Planes in pictures.
mod estimate;
mod features;
mod homography;
mod magsac;
mod matching;
mod random;
mod robust;
#[cfg(test)]
mod strategies;
pub use estimate::{PointPair, estimate, estimate_linear, refine, symmetric_transfer_error};
pub use features::{Descriptor, Feature, FeatureParams, Features, encoded_luminance};
pub use homography::{Homography, HomographyError};
pub use matching::{FeatureMatch, match_features};
pub use robust::{RobustFit, RobustParams, estimate_robust};
