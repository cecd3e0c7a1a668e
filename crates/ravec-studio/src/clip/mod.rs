//! Clips: frames that are read beside the window, and their playing.
//!
//! A [`ClipReader`] reads the frame that is asked for last, with a cache, and [`Thumbnail`]s of the whole clip by a source of their
//! own. A [`Player`] gives the frame that is due at a time. No call waits for a file.

mod facts;
mod player;
mod preview;
mod proxies;
mod reader;
mod state;
mod thumbnails;

pub use crate::view::timeline::{FrameState, Scale, Timeline, TimelineAction, TimelineRow};
pub use facts::ClipFacts;
pub use player::{Player, SPEEDS};
pub use reader::ClipReader;
pub use thumbnails::{Thumbnail, Thumbnails};
