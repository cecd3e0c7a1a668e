//! Planes: a quadrilateral on the picture, with the rectified view beside it.

use super::planes::PlaneAids;
use super::quad::{self, Corners, QuadHandle};
use super::small::small_copy;
use super::{Desk, DraftFn, DraftJob, DraftView, Gesture, Hand, Tool, with_params};
use crate::assistant::Memory;
use crate::content::{Content, View};
use crate::document::Edit;
use crate::engine::run_in_memory;
use crate::shown::Shown;
use egui::{Color32, Ui};
use ravec::progress::Progress;
use ravec_media::Picture;
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Width of the rectified view beside the picture, in pixels, and while the hand moves.
const BESIDE_PX: u32 = 320;
const MOVING_PX: u32 = BESIDE_PX / 2;

/// Drags the corners.
#[derive(Default)]
pub(crate) struct Rectify {
    handle: QuadHandle,
    aids: PlaneAids,
    shows_result: bool,
}

/// The corners of an edit.
fn corners(edit: &Edit) -> Option<Corners> {
    quad::read(edit.param("quad").as_str()?)
}

/// A quadrilateral in the middle of a picture.
pub(super) fn start_corners([width, height]: [usize; 2]) -> Corners {
    let (x, y) = (width as f64, height as f64);
    [
        [0.25 * x, 0.25 * y],
        [0.75 * x, 0.25 * y],
        [0.75 * x, 0.75 * y],
        [0.25 * x, 0.75 * y],
    ]
}

impl Tool for Rectify {
    fn operation(&self) -> &'static str {
        "rectify"
    }

    fn label(&self) -> &'static str {
        "Rectify"
    }

    fn hint(&self) -> &'static str {
        "Drag corners, sides or the inside; S snaps to edges"
    }

    fn start(&self, size: [usize; 2]) -> Map<String, Value> {
        with_params(json!({"quad": quad::text(&start_corners(size))}))
    }

    fn works_on_input(&self, _edit: &Edit) -> bool {
        !self.shows_result
    }

    fn draft(&self) -> Option<DraftFn> {
        Some(draft)
    }

    fn shows_draft_beside(&self) -> bool {
        !self.shows_result
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        if self.shows_result {
            return None;
        }
        let corners = corners(edit)?;
        let color = Color32::from_rgb(90, 220, 120);
        quad::paint(
            hand.painter,
            hand.view,
            &corners,
            self.aids.drawn_grid(),
            color,
            true,
        );
        let with = |corners: &Corners| edit.with_param("quad", quad::text(corners).into());
        if let Some(snapped) = self.aids.follow_snap(hand, &corners) {
            return Some(Gesture::done(with(&snapped)));
        }
        if !self.handle.holds()
            && let Some(taken) = self.aids.follow_proposals(hand, &[corners])
        {
            return Some(Gesture::done(with(&taken)));
        }
        let moved = self.handle.follow(hand, &[corners])?;
        Some(Gesture {
            edit: with(&moved.corners),
            goes_on: moved.goes_on,
        })
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, _edit: &Edit) -> Option<Gesture> {
        ui.checkbox(
            &mut self.shows_result,
            "Show the rectified picture on the canvas",
        );
        self.aids.ui(ui, desk);
        if let Some(note) = desk.note {
            ui.label(note);
        }
        None
    }
}

/// A copy with twice the pixels across that a view of this width needs, and its scale, where the picture has `scale` itself.
fn copy_for(picture: &Picture, width: u32, scale: [f64; 2]) -> (Arc<Picture>, [f64; 2]) {
    let (small, by) = small_copy(picture, 2.0 * f64::from(width));
    (Arc::new(small), [scale[0] * by[0], scale[1] * by[1]])
}

/// The edit of a copy that has another size, with a result of a width.
fn of_copy(edit: &Edit, scale: [f64; 2], width: u32) -> Option<Edit> {
    let corners = corners(edit)?.map(|[x, y]| [scale[0] * x, scale[1] * y]);
    let edit = edit.with_param("quad", quad::text(&corners).into());
    let edit = edit.with_param("height", Value::Null);
    let edit = edit.with_param("width", width.into());
    let focal = edit.param("focal").as_str().unwrap_or_default();
    let in_pixels = focal
        .strip_suffix("px")
        .and_then(|px| px.trim().parse::<f64>().ok());
    Some(match in_pixels {
        Some(px) => edit.with_param("focal", format!("{}px", scale[0] * px).into()),
        None => edit,
    })
}

/// The rectified view at the size of a thumbnail, with its proportions in words.
fn draft(job: &DraftJob, memory: &mut Memory, progress: &Progress) -> Option<DraftView> {
    let picture = job.input.content.picture()?;
    let key = &job.input.key;
    let small = memory.keep("small copy", key, || {
        Ok::<_, ()>(copy_for(picture, BESIDE_PX, [1.0; 2]))
    });
    let mut copy = small.ok()?.clone();
    if job.coarse {
        let smaller = memory.keep("smaller copy", key, || {
            Ok::<_, ()>(copy_for(&copy.0, MOVING_PX, copy.1))
        });
        copy = smaller.ok()?.clone();
    }
    let (small, scale) = copy;
    let width = if job.coarse { MOVING_PX } else { BESIDE_PX };
    let edit = of_copy(&job.edit, scale, width)?;
    let input = Content::Picture(small);
    let (output, report) = run_in_memory(&edit, &input, progress).ok()?;
    let result = report.result.unwrap_or_default();
    let from = match result["aspect_from"].as_str().unwrap_or_default() {
        "hand" => "set by hand",
        "focal" => "from the focal length",
        "exif" => "from the focal length in the EXIF data",
        _ => "from the right angles of the rectangle",
    };
    let aspect = result["aspect"].as_f64().unwrap_or_default();
    Some(DraftView {
        note: format!("Width by height {aspect:.3}, {from}"),
        ..DraftView::whole(View::Picture(Arc::new(Shown::new(
            output.picture()?.clone(),
        ))))
    })
}
