//! Procedural pictures with known truth, for tests, benchmarks and demonstrations.

mod coverage;
pub mod edge;
mod facade;
mod furniture;
mod glyph;
pub mod line_art;
mod paint;
mod props;
mod random;
mod sky;
mod stage;
pub mod street;
mod stroke;
pub mod texture;

pub use coverage::{HalfPlane, disc_coverage, intersection_coverage};
pub use random::Seed;
pub use stroke::Stroke;
