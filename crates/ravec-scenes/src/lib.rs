//! Procedural pictures, clips and meshes with known truth, for tests, benchmarks and demonstrations.
//!
//! A method is judged by pictures whose answer is known beforehand. Here pictures are drawn from formulas: the position
//! of an edge, the homography of a wall or the outline of a disc is an input, so that truth never comes from code that
//! is under test. The larger scenes are drawn to look like something, since what fails on a picture that a person would
//! take is worth more than what fails on a test chart.
//!
//! ```
//! use ravec_raster::{LinearRgb, Size};
//! use ravec_scenes::edge::{EdgeTruth, TwoColors, edge};
//!
//! // an edge at 30 degrees, 64 of 255 encoded steps high, through the middle of a block
//! let colors = TwoColors::gray_step(128.0, 64.0);
//! let truth = EdgeTruth::from_angle(30f64.to_radians(), (4.0, 4.0).into(), colors);
//! let block = edge(Size::new(8, 8)?, &truth);
//! assert_eq!(block[(0, 0)], LinearRgb(colors.inside));
//! assert_eq!(block[(7, 7)], LinearRgb(colors.outside));
//! # Ok::<(), ravec_raster::SizeError>(())
//! ```
//!
//! Guarantees: equal size, parameters and seed give equal bytes on any number of threads; light is finite and between 0
//! and 1; truth is serializable. Non-guarantees: the same bytes across platforms whose mathematical library differs, or
//! across versions of this crate.
//!
//! Words: a *scene* is a picture with its *truth*; a *clip* is a sequence of frames with theirs; the *footprint* of a sample is the side of the square it stands for;
//! *damage* is what is done to a finished picture.

pub mod building;
pub mod catalog;
pub mod clip;
mod coverage;
pub mod damage;
pub mod edge;
mod ellipsoid;
mod facade;
mod furniture;
mod glyph;
mod greenery;
pub mod jpeg;
pub mod line_art;
pub mod occlusion;
mod paint;
pub mod plane;
pub mod portraits;
mod props;
mod random;
pub mod shapes;
mod shopfront;
mod sky;
pub mod solids;
pub mod sprite;
mod stage;
pub mod still_life;
pub mod street;
mod stroke;
pub mod swatches;
pub mod texture;

pub use coverage::{HalfPlane, disc_coverage, intersection_coverage};
pub use random::Seed;
pub use stroke::Stroke;
