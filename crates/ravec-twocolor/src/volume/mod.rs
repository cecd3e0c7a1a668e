//! Two-color voxels: blocks of a video replaced by one plane and two colors.
//!
//! A video is a stack of frames of one size. It is cut into blocks of N × N pixels and M frames; in each, a plane in
//! (x, y, t) separates two constant colors. The plane's direction in time is the motion of the edge: a standing edge
//! has a plane parallel to time, a moving edge an inclined one, a scene cut one across time.
//!
//! ```
//! use ravec_progress::Progress;
//! use ravec_raster::{Image, LinearRgb, Size};
//! use ravec_twocolor::volume::{TwoColorVolume, VolumeParams};
//!
//! // a bright region whose border moves to the right by half a pixel a frame
//! let frames: Vec<Image<LinearRgb>> = (0..8)
//!     .map(|t| {
//!         Image::from_fn(Size::new(8, 8).unwrap(), |col, _| {
//!             LinearRgb([if (col as f64) < 1.8 + 0.5 * t as f64 { 0.8 } else { 0.1 }; 3])
//!         })
//!     })
//!     .collect();
//! let volume = TwoColorVolume::fit(&frames, &VolumeParams::default(), &Progress::none())?;
//! let velocity_px = volume.block(0, 0, 0).velocity_px().unwrap();
//! assert!((velocity_px - 0.5).abs() < 0.1);
//! # Ok::<(), ravec_twocolor::volume::VolumeError>(())
//! ```
//!
//! Source: the extension of two-color pixels to videos in the dissertation, chapter 4. We differ in how the plane is
//! found, in four steps for each block:
//!
//! 1. *Starts.* The exact two-color pixels of the frames and of their mean give lines; each line standing still, the
//!    planes through the lines of two frames, and their least-squares plane are starts. So is the best plane along each
//!    of a few dozen directions with small integer components, among them the scene cuts.
//! 2. *Choice.* All starts are scored exactly; the best few that differ are kept.
//! 3. *Line searches.* Each is improved along 13 one-parameter motions (shifts, tilts, tilts about an end; 49 in small
//!    blocks). Along a motion voxels change sides one after the other; visiting these events in order scores every split
//!    that the motion meets within reach. This goes on until no motion improves.
//! 4. *Centering.* Planes with equal splits have equal errors; the plane is put midway between the events at which its
//!    split would change. So the time component is good to a fraction of a pixel a frame.
//!
//! The time axis counts a frame as a pixel. This choice affects no fit: stretching time turns planes into planes, so the
//! splits are the same.
//!
//! Guarantees: the error is that of the split which the plane makes of the voxels' centers, with the best colors; with
//! one frame a block, blocks and errors are those of [`TwoColorField`](crate::TwoColorField); the same result on any
//! number of threads. Does not guarantee: the optimum. On random noise, where nothing guides the search, the error is on
//! average 1.0000 to 1.0016 times the least of any plane for 2 × 2 × 2 to 4 × 4 × 2 voxels (99th percentile 1.00 to 1.03;
//! tests enumerate all splits and assert 1.005 and 1.05); at 8 × 8 × 8 it is 1.0007 times that of a search from 16 starts.
//! Every split of up to 3 × 3 × 3 voxels is found when it is planted.
//!
//! Cost: O(N·M) a plane scored and O(N·M log N·M) a line search, times the starts; blocks below the flat threshold and
//! blocks that two colors explain to within it are cheap. On two cores about 15 million voxels a second where edges are
//! clean, 3 million where noise exceeds the threshold everywhere at edges. Memory: with [`VolumeBuilder`], the M frames of
//! one slab and the blocks.

mod block;
mod builder;
mod fit;
mod render;
mod search;
mod slab;
mod starts;
mod voxel;

pub use builder::VolumeBuilder;
pub use fit::{TwoColorVolume, VolumeError, VolumeParams};
pub use voxel::{TwoColorVoxel, VoxelPlane};
