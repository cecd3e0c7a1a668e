//! The plane drawn over the clip: a grid in the color of its state, or a cross where it is lost.

use super::Track;
use super::file::TrackFile;
use super::follow::Reader;
use super::photo::Photo;
use super::rewrite::{Target, rewrite};
use crate::context::Context;
use crate::error::JobError;
use crate::plane::overlay::{Color, draw_grid, draw_line, line_width};
use crate::report::Report;
use crate::video::{FrameRange, key_of, open_clip};
use glam::dvec2;
use ravec::planar::QuadGrid;
use ravec::planar::track::{TrackState, TrackedFrame};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Image, LinearRgba};
use std::path::Path;

/// Color of a grid whose pose is measured.
const TRACKED: Color = [0.0, 0.85, 0.25];
/// Color of a grid whose pose is uncertain.
const WEAK: Color = [1.0, 0.55, 0.0];
/// Color of the cross where the plane is lost.
const LOST: Color = [1.0, 0.02, 0.02];
/// Columns and rows of the grid.
const CELLS: u32 = 6;

/// Writes the tracked frames with the planes drawn over them.
///
/// # Errors
/// [`JobError::ReadClip`], [`JobError::WriteClip`], [`JobError::Cancelled`].
pub(super) fn show(
    operation: &Track,
    output: &Path,
    (file, photo): (&TrackFile, Option<&Photo>),
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    let input = operation.input.as_path();
    let range = file.range();
    // the clip is in the list of inputs already
    let clip = open_clip(input, None, &mut Report::new("track", &()), context)?;
    let mut reader = Reader::new(clip, input, FrameRange::between(&range))?;
    let target = Target {
        input,
        output,
        size: None,
        encoding: &operation.params.encoding,
        key: &key_of(operation),
        phase: ("show", Some(range.end - range.start)),
        pixels: None,
    };
    let start = std::time::Instant::now();
    let progress = context.progress.silent();
    let rewritten = rewrite(&target, &mut reader, report, context, |shot, done| {
        if done {
            return Ok(None);
        }
        let planes = file.planes.iter();
        let poses = planes.filter_map(|plane| plane.frame(shot.index));
        drawn(&shot.image, poses, photo, &progress).map(Some)
    })?;
    rewritten.finish(report)?;
    report.add_time("show", start);
    Ok(())
}

/// The frame with its planes.
fn drawn<'a>(
    frame: &AnyImage,
    planes: impl Iterator<Item = &'a TrackedFrame>,
    photo: Option<&Photo>,
    progress: &Progress,
) -> Result<AnyImage, JobError> {
    let mut image: Image<LinearRgba> = frame.convert();
    let width = line_width(frame.size());
    for pose in planes {
        if let Some(photo) = photo.filter(|_| pose.state != TrackState::Lost) {
            photo.draw(&mut image, &pose.frame_from_reference, progress)?;
        }
        let color = match pose.state {
            TrackState::Tracked => TRACKED,
            TrackState::Weak => WEAK,
            TrackState::Lost => {
                draw_cross(&mut image, 1.6 * width);
                continue;
            }
        };
        // corners that are no rectangle in perspective have no grid
        if let Ok(grid) = QuadGrid::new(pose.corners, CELLS, CELLS) {
            draw_grid(&mut image, &grid, width, color);
        }
    }
    Ok(frame.like(&image))
}

/// A cross in the middle of the frame.
fn draw_cross(image: &mut Image<LinearRgba>, width: f64) {
    let extent = dvec2(image.width() as f64, image.height() as f64);
    let (middle, arm) = (0.5 * extent, 0.1 * extent.min_element());
    for arm in [dvec2(arm, arm), dvec2(arm, -arm)] {
        draw_line(image, [middle - arm, middle + arm], width, LOST);
    }
}
