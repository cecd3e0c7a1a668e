//! Corners as plain numbers.

use crate::pixel_centers::PixelCenters;
use ravec::planar::track::{Track, TrackState, TrackedFrame};
use std::fmt::Write as _;

/// Corners of a frame as numbers x0, y0, ..., y3.
fn numbers(frame: &TrackedFrame, centers: PixelCenters) -> Vec<String> {
    let corners = centers.write_all(frame.corners);
    corners
        .iter()
        .flat_map(|corner| [corner.x.to_string(), corner.y.to_string()])
        .collect()
}

/// A line of eight numbers for each frame. Lost frames repeat the last pose.
pub fn corners(track: &Track, centers: PixelCenters) -> String {
    let lines = track.frames.iter();
    lines
        .map(|frame| numbers(frame, centers).join(" ") + "\n")
        .collect()
}

/// Frame, state, corners and sigma, separated by commas, with a header.
pub fn csv(track: &Track, centers: PixelCenters) -> String {
    let mut text = String::from("frame,state,x0,y0,x1,y1,x2,y2,x3,y3,sigma_px\n");
    for (index, frame) in (track.first..).zip(&track.frames) {
        let state = match frame.state {
            TrackState::Tracked => "tracked",
            TrackState::Weak => "weak",
            TrackState::Lost => "lost",
        };
        let corners = numbers(frame, centers).join(",");
        // writing to a string does not fail
        let _ = writeln!(text, "{index},{state},{corners},{}", frame.sigma_px());
    }
    text
}
