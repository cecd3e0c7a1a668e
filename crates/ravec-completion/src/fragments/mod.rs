//! Completion by hand: fragments that are found by their surroundings and laid over the hole one by one.
//!
//! For a target the best sources are searched in all buffers ([`FragmentIndex`]): the picture, rectified views of planes,
//! other photos, each as it is and in the requested variants. One of them is laid over the target
//! ([`Retouch::apply`]), which makes the known part larger for the next one. Every step is logged and can be undone, changed
//! and done again; [`Retouch::fill`] takes the steps by itself.
//!
//! Source: Pavić, Schönefeld and Kobbelt, "Interactive image completion with perspective correction", 2006. We differ: the
//! search runs on blocks and from coarse to fine; whether a source is known is read from runs instead of a correlation;
//! seams are cuts; only original pixels are sources, so that nothing is copied twice.

mod blocks;
mod buffer;
mod direct;
mod energy;
mod fill;
mod index;
mod level;
mod minima;
#[cfg(test)]
mod naive;
mod paste;
mod pyramid;
mod retouch;
mod rim;
mod search;
mod target;
mod template;

pub use fill::{FillOptions, FillSummary};
pub use index::{FragmentIndex, Match, SearchOptions, Sources};
pub use retouch::{Retouch, RetouchState};
pub use target::{Shape, SourceFragment, Step, Target, Variant};
