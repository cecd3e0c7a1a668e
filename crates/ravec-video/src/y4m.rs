//! YUV4MPEG2: uncompressed planes with a line of text before each frame.
//!
//! Reads and writes `C420jpeg`, `C420mpeg2`, `C420paldv`, `C422`, `C444`, `C440`, `C411` and `Cmono`, the deeper layouts that
//! FFmpeg names (`C420p10` to `C444p16`, `Cmono9` to `Cmono16`), and `C444alpha`. The range is `XCOLORRANGE`; matrix,
//! primaries and transfer have no place in the format and are taken as usual for the height.
//!
//! Guarantees: samples come back as they were, to the last bit; frames are found by arithmetic, so that seeking costs nothing
//! where no frame has parameters of its own. Does not guarantee: time stamps of a variable rate, which the format cannot hold.

mod header;
mod reader;
mod writer;

pub use reader::Y4mSource;
pub use writer::{Y4mSink, append_frames};
