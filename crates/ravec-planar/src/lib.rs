//! Planes in pictures.
mod align;
mod estimate;
mod features;
mod homography;
mod magsac;
mod matching;
mod photos;
mod quad_grid;
mod random;
mod robust;
mod snap;
#[cfg(test)]
mod strategies;
mod tilt;
pub use estimate::{PointPair, estimate, estimate_linear, refine, symmetric_transfer_error};
pub use features::{Descriptor, Feature, FeatureParams, Features, encoded_luminance};
pub use homography::{Homography, HomographyError};
pub use matching::{FeatureMatch, match_features};
pub use photos::{MatchError, MatchParams, PhotoMatch, match_photos};
pub use quad_grid::{QuadGrid, Side};
pub use robust::{RobustFit, RobustParams, estimate_robust};
pub use snap::{SnapError, SnapParams, Snapped, snap, snap_counting};
