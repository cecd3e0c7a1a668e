//! Keyframes of the effect *Corner Pin* of After Effects, as text for its clipboard: copy the text, select a layer of the size of
//! the clip, and paste.
//!
//! The text begins with `Adobe After Effects 8.0 Keyframe Data` and the rate and size of the clip; a block for each property has
//! its path (the match names `ADBE Corner Pin-0001` to `-0004`, which do not depend on the language of the program: upper left,
//! upper right, lower left, lower right), a line of column heads, and a line for each keyframe; columns are separated by tabs.
//! Points are in pixels from the upper left corner of the layer, y down, pixel centers at half-integers; frames are counted
//! from the time at which the text is pasted, which should be the start of the clip.
//!
//! Source: what After Effects itself copies, and the corner pins that Mocha exports for it.

use super::{Clip, found, short};
use ravec::planar::track::Track;
use std::fmt::Write as _;

/// Corners of ours in the order of the effect.
const ORDER: [usize; 4] = [0, 1, 3, 2];

/// The text.
pub fn corner_pin(track: &Track, clip: &Clip) -> String {
    let mut text = format!(
        "Adobe After Effects 8.0 Keyframe Data\r\n\r\n\tUnits Per Second\t{}\r\n\tSource Width\t{}\r\n\tSource Height\t{}\r\n\tSource Pixel Aspect Ratio\t{pixel}\r\n\tComp Pixel Aspect Ratio\t{pixel}\r\n",
        (clip.rate * 1e3).round() / 1e3,
        track.width,
        track.height,
        pixel = short(clip.pixel_aspect),
    );
    for (at, corner) in ORDER.into_iter().enumerate() {
        // writing to a string does not fail
        let _ = write!(
            text,
            "\r\nEffects\tADBE Corner Pin #1\tADBE Corner Pin-000{}\r\n\tFrame\tX pixels\tY pixels\t\r\n",
            at + 1
        );
        for (index, frame) in found(track) {
            let point = frame.corners[corner];
            let (x, y) = (short(point.x), short(point.y));
            let _ = write!(text, "\t{index}\t{x}\t{y}\t\r\n");
        }
    }
    text.push_str("\r\n\r\nEnd of Keyframe Data\r\n");
    text
}
