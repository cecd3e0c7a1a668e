//! Animated pictures: GIF and APNG, whose frames are painted over one another.
//!
//! Guarantees: frames come out whole, as they are shown; 16-bit APNG keeps its bits; durations are kept to the tick of the
//! format (a hundredth of a second for GIF). Does not guarantee: colors of GIF files that are written, which have 256 a frame;
//! color profiles, which are not applied. Seeking backwards reads from the start.

mod apng;
mod canvas;
mod gif;

pub use self::gif::{GifSink, GifSource};
pub use apng::{ApngSink, ApngSource, is_animated};
