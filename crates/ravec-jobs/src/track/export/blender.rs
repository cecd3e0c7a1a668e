//! A plane track of Blender, as a script: run it in the text editor after the clip was opened in the movie clip editor.
//!
//! The script adds four point tracks, one at each corner, and the plane track over them, whose corners have a marker in each
//! frame. No camera is solved, and none is needed: the node *Plane Track Deform* lays a picture on the plane.
//!
//! Blender counts frames of a clip from 1, and points as shares of the frame's width and height from its lower left corner, y up;
//! corners of a plane go from the lower left one counterclockwise. Where the plane is lost, its marker is muted.
//!
//! Source: Blender Python API, `bpy.types.MovieTrackingTracks`, `MovieTrackingPlaneMarkers.insert_frame` and
//! `MovieTrackingPlaneMarker.corners`; a plane track itself is made by the operator `clip.create_plane_track` only, which works
//! on selected tracks in a movie clip editor.

use super::{short, upward};
use ravec::planar::track::{Track, TrackState};
use std::fmt::Write as _;

/// Corners of ours in the order of Blender: lower left, lower right, upper right, upper left.
const ORDER: [usize; 4] = [3, 2, 1, 0];

/// Part of the script that uses its frames.
const BODY: &str = r#"
import bpy


def clip_of(context):
    for area in context.window.screen.areas:
        if area.type == "CLIP_EDITOR" and area.spaces.active.clip:
            return area.spaces.active.clip
    for clip in bpy.data.movieclips:
        if tuple(clip.size) == SIZE:
            return clip
    raise RuntimeError("open the clip in a movie clip editor first")


def add_plane(context):
    clip = clip_of(context)
    if tuple(clip.size) != SIZE:
        raise RuntimeError("the track is of a clip of %d x %d pixels" % SIZE)
    tracking = clip.tracking.objects.active
    for track in tracking.tracks:
        track.select = False
    seen = [entry for entry in FRAMES if entry[1]]
    for corner in range(4):
        track = tracking.tracks.new(name="%s corner %d" % (NAME, corner + 1), frame=seen[0][0])
        for frame, _, corners in seen:
            track.markers.insert_frame(frame, co=corners[corner])
        track.select = True
    before = set(plane.name for plane in tracking.plane_tracks)
    area = context.window.screen.areas[0]
    kind = area.type
    try:
        area.type = "CLIP_EDITOR"
        area.spaces.active.clip = clip
        region = [region for region in area.regions if region.type == "WINDOW"][0]
        with context.temp_override(window=context.window, area=area, region=region):
            bpy.ops.clip.create_plane_track()
    finally:
        area.type = kind
    plane = [plane for plane in tracking.plane_tracks if plane.name not in before][0]
    plane.name = NAME
    for frame, good, corners in FRAMES:
        marker = plane.markers.insert_frame(frame)
        marker.corners = corners
        marker.mute = not good


add_plane(bpy.context)
"#;

/// The script.
pub fn script(track: &Track, number: usize) -> String {
    let mut text = format!(
        "# Plane track for Blender 3.2 or newer: open the clip in a movie clip editor, then run this script.\n\nNAME = \"Ravec plane {number}\"\nSIZE = ({}, {})\n# frame, found, corners from the lower left one counterclockwise\nFRAMES = [\n",
        track.width, track.height
    );
    for (index, frame) in (track.first..).zip(&track.frames) {
        let good = if frame.state == TrackState::Lost {
            "False"
        } else {
            "True"
        };
        let corners = ORDER.map(|corner| {
            let point = upward(frame.corners[corner], track.height);
            let (x, y) = (point.x / track.width as f64, point.y / track.height as f64);
            // a share of 1e-9 is a millionth of a pixel
            format!("({:?}, {:?})", short(x * 1e3) / 1e3, short(y * 1e3) / 1e3)
        });
        // writing to a string does not fail
        let _ = writeln!(
            text,
            "    ({}, {good}, ({})),",
            index + 1,
            corners.join(", ")
        );
    }
    text.push_str("]\n");
    text.push_str(BODY);
    text
}
