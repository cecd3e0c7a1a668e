//! Corner pin of Nuke.
//!
//! A script with one node `CornerPin2D` whose `to1` to `to4` are animated, to be pasted into a node graph or imported. Its
//! `from1` to `from4` are the corners in the reference frame, so that what lies in the reference frame follows the plane; the
//! button *Set to input* of the node lays a whole picture on it instead, and `invert` stabilizes.
//!
//! Nuke counts pixels from the lower left corner of the picture, y up, pixel centers at half-integers, and the corners from the
//! lower left one counterclockwise. Frames are those of numbered pictures, else counted from 1.
//!
//! Source: scripts that Nuke itself saves, and Foundry, *Nuke Reference Guide*, "`CornerPin`"; curves are lists of `x` with the
//! frame and the value.

use super::{Clip, found, short, upward};
use ravec::planar::track::Track;
use std::fmt::Write as _;

/// Corners of ours in the order of Nuke: lower left, lower right, upper right, upper left.
const ORDER: [usize; 4] = [3, 2, 1, 0];

/// The script.
pub fn corner_pin(track: &Track, clip: &Clip, number: usize) -> String {
    let mut text = String::from(
        "set cut_paste_input [stack 0]\nversion 12.0 v1\npush $cut_paste_input\nCornerPin2D {\n",
    );
    for (at, corner) in ORDER.into_iter().enumerate() {
        let mut curves = [String::from("curve"), String::from("curve")];
        for (index, frame) in found(track) {
            let point = upward(frame.corners[corner], track.height);
            let frame = index + clip.first_number;
            for (curve, value) in curves.iter_mut().zip(point.to_array()) {
                // writing to a string does not fail
                let _ = write!(curve, " x{frame} {}", short(value));
            }
        }
        let [x, y] = curves;
        let _ = writeln!(text, " to{} {{{{{x}}} {{{y}}}}}", at + 1);
    }
    for (at, corner) in ORDER.into_iter().enumerate() {
        let point = upward(track.quad[corner], track.height);
        let (x, y) = (short(point.x), short(point.y));
        let _ = writeln!(text, " from{} {{{x} {y}}}", at + 1);
    }
    let _ = writeln!(
        text,
        " name RavecCornerPin{number}\n label \"reference frame {}\"\n selected true\n}}",
        track.reference + clip.first_number
    );
    text
}
