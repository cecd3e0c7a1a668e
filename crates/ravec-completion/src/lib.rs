//! Image completion: holes filled from the rest of a picture, in perspective where planes are known.
mod canvas;
mod complete;
mod compose;
mod cut;
mod fourier;
mod guidance;
mod max_flow;
mod parts;
mod poisson;
mod proposals;
mod rectified;
mod sheet;
mod subpixel;
mod thin;

pub use complete::{CompleteError, CompleteParams, CompleteSummary, Completed, complete};
