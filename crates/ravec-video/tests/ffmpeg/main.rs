//! Clips through FFmpeg. Without it, or without one of its encoders, a test says so and skips.

mod damage;
mod encoding;
mod real_clips;
mod refusals;
mod scene;
mod tracks;
