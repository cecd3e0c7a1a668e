//! Clips through FFmpeg. Without it, or without one of its encoders, a test says so and skips.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

mod damage;
mod encoding;
mod real_clips;
mod refusals;
mod scene;
mod tracks;
