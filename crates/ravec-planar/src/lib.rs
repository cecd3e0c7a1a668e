//! Planes in pictures: how a flat thing looks from one camera and from another.
//!
//! Two photos of a plane differ by a [`Homography`]: eight numbers that say where each point goes. Here they are computed
//! from four points, from many, from many of which most are wrong, and from nothing but two photos; and grids in
//! perspective are laid on walls and snap to what is there.
//!
//! ```
//! use glam::dvec2;
//! use ravec_planar::{Homography, QuadGrid};
//!
//! // a wall of 4 × 3 panels, seen from the side
//! let corners = [dvec2(10.0, 10.0), dvec2(90.0, 25.0), dvec2(90.0, 75.0), dvec2(10.0, 95.0)];
//! let wall = QuadGrid::new(corners, 4, 3)?;
//!
//! // where the next column would be, and how the wall looks from straight on, 100 pixels a panel
//! let wider = wall.extended(0..=5, 0..=3)?;
//! let straight_from_image = Homography::from_scale(dvec2(100.0, 100.0))? * wall.image_from_grid().inverse();
//! assert!(straight_from_image.apply(wider.corners()[1]).distance(dvec2(500.0, 0.0)) < 1e-9);
//! # Ok::<(), ravec_planar::HomographyError>(())
//! ```
//!
//! # Conventions
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers: the first pixel's center is (0.5, 0.5). Maps are
//! named after where they lead, `dst_from_src`, and read from right to left. Points behind the horizon are in no picture;
//! a map knows which side is the front.
//!
//! # What is here
//!
//! | for | use |
//! | --- | --- |
//! | the map itself | [`Homography`] |
//! | the map from pairs of points | [`Homography::from_pairs`], [`estimate`](fn@estimate), [`estimate_robust`] |
//! | the map from two photos | [`match_photos`], [`Features`], [`match_features`] |
//! | grids in perspective | [`QuadGrid`], [`snap`](fn@snap), [`snap_counting`] |
//! | planes from edges | [`propose_planes`], [`vanishing_points`], [`Segment`] |
//! | a plane from straight on | [`proportions`], [`straight_view`] |
//! | pictures through a map | [`warp`](fn@warp), [`warp_frame`](fn@warp_frame) |
//! | the motion of a camera, and cuts | [`camera::CameraMotion`] |
//! | a plane through a clip | [`track::PlaneTracker`] |
//!
//! # Guarantees
//!
//! - Equal input, parameters and seed give equal bytes on any number of threads.
//! - No panic because of what numbers are; what cannot be computed has a typed error.
//!
//! # Not guaranteed
//!
//! - The same last bits on machines with other vector units or mathematics libraries.
//! - That a photo is free of lens distortion. A homography is for straight lines that are straight.
//!
//! # Words
//!
//! *Pair*: two points that show the same thing. *Inlier*: a pair that fits. *Horizon*: the line that a map sends to
//! infinity. *Patch*: a small square of pixels. *Family*: the lines between columns, or those between rows.
//!
//! # Current status
//!
//! Still pictures: homographies, robust estimation, matching of photos, grids and snapping, proposals, rectification, warping.
//! Clips: the motion of the camera; planes, tracked, corrected, with photos laid on them; smooth paths.
//! It finds no edges itself: segments for [`propose_planes`] come, for instance, from `line_segments` of `ravec-twocolor`.

mod align;
pub mod camera;
mod estimate;
mod features;
mod homography;
mod magsac;
mod matching;
mod photos;
mod proposals;
mod quad_grid;
mod random;
mod rectify;
mod robust;
mod snap;
#[cfg(test)]
mod strategies;
mod tilt;
pub mod track;
mod vanishing;
mod warp;
mod warp_frame;

pub use estimate::{PointPair, estimate, estimate_linear, refine, symmetric_transfer_error};
pub use features::{Descriptor, Feature, FeatureParams, Features, encoded_luminance};
pub use homography::{Homography, HomographyError};
pub use matching::{FeatureMatch, match_features};
pub use photos::{MatchError, MatchParams, PhotoMatch, match_photos};
pub use proposals::{PlaneProposal, Proposals, propose_planes};
pub use quad_grid::{QuadGrid, Side};
pub use rectify::{
    Known, Margin, ProportionError, Proportions, Straight, proportions, straight_view,
};
pub use robust::{RobustFit, RobustParams, estimate_robust};
pub use snap::{SnapError, SnapParams, Snapped, snap, snap_counting};
pub use vanishing::{VanishingPoint, focal_from_right_angles, vanishing_points};
pub use warp::{Beyond, WarpParts, warp};
pub use warp_frame::{Backdrop, warp_frame};

pub use ravec_raster::Segment;
