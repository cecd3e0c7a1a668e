//! Edits of a shot: removal, replacement, enhancement and paste. All show their result on the frame at the playhead as soon as plate
//! and matte are there.

use super::analysis::{file_ui, regions_ui, source_ui, take_regions};
use super::plate::TRACK;
use super::quad::{self, Corners, QuadHandle};
use super::{Desk, Gesture, Hand, Tool, with_params};
use crate::analyses::AnalysisState;
use crate::assistant::Assistant;
use crate::content::Kind;
use crate::document::{Document, Edit};
use egui::{Color32, RichText, Ui};
use ravec::progress::Progress;
use ravec_jobs::video::edit::paste::SceneMotion;
use ravec_jobs::{Context, Step};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Kind of the question about the motion of the clip that gets the foreground.
const INTO_MOTION: &str = "motion of the second clip";

/// Name, label and help of a field.
type Field = (&'static str, &'static str, &'static str);

/// An edit of a shot.
pub(crate) struct ShotTool {
    operation: &'static str,
    label: &'static str,
    hint: &'static str,
    /// Files that only this edit has. The first one has to be given.
    files: &'static [Field],
    /// True if it can take the corners of the tracked plane.
    has_quad: bool,
    /// True if its result lies in another clip, in which the corners of its place are dragged.
    is_elsewhere: bool,
    handle: QuadHandle,
}

/// The motion of the plane in the clip that gets the foreground.
struct Motion {
    /// The file of its track.
    track: String,
    /// `None` if the file cannot be read; the result says why.
    motion: Option<SceneMotion>,
}

impl ShotTool {
    /// The foreground is removed.
    pub const REMOVE: Self = Self {
        operation: "video remove",
        label: "Remove the foreground",
        hint: "The plate shows through, with the grain of the clip",
        files: &[],
        has_quad: false,
        is_elsewhere: false,
        handle: QuadHandle::EMPTY,
    };

    /// The background is replaced.
    pub const REPLACE: Self = Self {
        operation: "video replace",
        label: "Replace the background",
        hint: "Another picture or clip behind the foreground, or on the tracked plane",
        files: &[("image", "New background", "A picture or a clip")],
        has_quad: true,
        is_elsewhere: false,
        handle: QuadHandle::EMPTY,
    };

    /// The plane gets the detail of a photo.
    pub const ENHANCE: Self = Self {
        operation: "video enhance",
        label: "Enhance by a photo",
        hint: "A sharp photo of the plane replaces the plane, at twice the size",
        files: &[("photo", "Photo", "A sharp photo of the plane")],
        has_quad: true,
        is_elsewhere: false,
        handle: QuadHandle::EMPTY,
    };

    /// The foreground is put into another clip.
    pub const PASTE: Self = Self {
        operation: "video paste",
        label: "Paste into a clip",
        hint: "The foreground goes into another clip, in its perspective; drag its corners there",
        files: &[
            (
                "into",
                "Into",
                "The clip or the picture that gets the foreground",
            ),
            ("into_track", "Its track", "The motion of the plane in it"),
            (
                "into_matte",
                "In front",
                "Matte of what stays in front of the foreground",
            ),
        ],
        has_quad: true,
        is_elsewhere: true,
        handle: QuadHandle::EMPTY,
    };
}

/// The corners of the plane that a document tracks.
pub(super) fn tracked_plane<'a>(document: &'a Document, edit: &Edit) -> Option<&'a Value> {
    let track = document.last_analysis("track", Some(edit.id))?;
    track.param("quads").get(0)
}

/// The corners of the plane in the clip itself: those of the edit, the tracked ones, or those of its frames.
fn own_corners(desk: &Desk<'_>, edit: &Edit) -> Option<Corners> {
    let given = edit.param("quad").as_str();
    let tracked = || tracked_plane(desk.document, edit)?.as_str();
    if let Some(corners) = given.or_else(tracked).and_then(quad::read) {
        return Some(corners);
    }
    let [width, height] = desk.input?.content.size().map(|side| side as f64);
    Some([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
}

impl Tool for ShotTool {
    fn operation(&self) -> &'static str {
        self.operation
    }

    fn label(&self) -> &'static str {
        self.label
    }

    fn hint(&self) -> &'static str {
        self.hint
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Clip]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        let mut fields = with_params(json!({}));
        for name in ["plate", "matte"] {
            fields.insert(name.to_owned(), format!("@{name}").into());
        }
        if let Some((name, ..)) = self.files.first() {
            fields.insert((*name).to_owned(), "".into());
        }
        fields
    }

    fn start_in(&self, size: [usize; 2], document: &Document) -> Map<String, Value> {
        let mut fields = self.start(size);
        for name in ["plate", "matte", "track"] {
            if let Some(known) = document.last_analysis(name, None)
                && let Some(output) = known.output()
            {
                fields.insert(name.to_owned(), output.into());
            }
        }
        take_regions(&mut fields, document);
        fields
    }

    fn needs(&self) -> &'static [&'static str] {
        &["plate", "matte"]
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        if !self.is_elsewhere || !self.shows_result(hand, edit) {
            return None;
        }
        let corners = quad::read(edit.param("into_quad").as_str()?)?;
        let frame = hand.frame?;
        let motion = Self::motion(hand.assistant, edit)?;
        let map = motion.motion.as_ref()?.frame_from_reference(frame)?;
        let shown = quad::mapped(&corners, &map);
        let color = Color32::from_rgb(120, 190, 255);
        quad::paint(hand.painter, hand.view, &shown, [4, 4], color, true);
        let moved = self.handle.follow(hand, &[shown])?;
        let corners = quad::mapped(&moved.corners, &map.inverse());
        Some(Gesture {
            edit: edit.with_param("into_quad", quad::text(&corners).into()),
            goes_on: moved.goes_on,
        })
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        self.wait_ui(ui, desk, edit);
        let mut changed = None;
        for (index, field) in self.files.iter().enumerate() {
            let line = file_ui(ui, edit, *field);
            // the first one stays in the edit, for it has to be given
            changed = changed.or(line.map(|gesture| match index {
                0 if !gesture.edit.fields.contains_key(field.0) => {
                    let mut edit = gesture.edit;
                    edit.fields.insert(field.0.to_owned(), "".into());
                    Gesture::done(edit)
                }
                _ => gesture,
            }));
        }
        if self.has_quad
            && let Some(corners) = tracked_plane(desk.document, edit)
        {
            let mut on_plane = edit.param("quad") == corners;
            if ui
                .checkbox(&mut on_plane, "On the tracked plane")
                .on_hover_text("Takes the corners of the track")
                .changed()
            {
                let value = if on_plane {
                    corners.clone()
                } else {
                    Value::Null
                };
                changed = Some(Gesture::done(edit.with_param("quad", value)));
            }
        }
        if self.is_elsewhere {
            changed = changed.or(Self::place_ui(ui, desk, edit));
        }
        for field in [
            ("plate", "Plate", "The background without foreground"),
            ("matte", "Matte", "Alpha of the foreground"),
            TRACK,
        ] {
            changed = changed.or(source_ui(ui, desk, edit, field));
        }
        changed.or(regions_ui(ui, desk, edit))
    }
}

impl ShotTool {
    /// Buttons for the place in the other clip.
    fn place_ui(ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        let mut changed = None;
        ui.horizontal(|ui| {
            if ui
                .button("Place by corners")
                .on_hover_text("The corners of the plane, to be dragged in the other clip")
                .clicked()
                && let Some(corners) = own_corners(desk, edit)
            {
                let text = Value::from(quad::text(&corners));
                let placed = edit.with_param("quad", text.clone());
                changed = Some(Gesture::done(placed.with_param("into_quad", text)));
            }
            if ui
                .button("Same place")
                .on_hover_text("Where it is in this clip")
                .clicked()
            {
                let same = edit.with_param("quad", Value::Null);
                changed = Some(Gesture::done(same.with_param("into_quad", Value::Null)));
            }
        });
        changed
    }

    /// True if the result is there, rather than the frame that waits for a plate or a matte.
    fn shows_result(&self, hand: &Hand<'_>, edit: &Edit) -> bool {
        let is_given = |(name, ..): &Field| !edit.text_field(name).is_empty();
        let needed = ["track", "plate", "matte"].into_iter().filter_map(|name| {
            let known = hand.document.last_analysis(name, Some(edit.id))?;
            (known.output() == Some(edit.text_field(name))).then_some(known)
        });
        let mut states = needed.map(|known| hand.assistant.analyses.state(known.id));
        self.files.first().is_none_or(is_given)
            && states.all(|state| matches!(state, AnalysisState::Done(_)))
            && hand.snapshot.failure.is_none()
    }

    /// The motion of the plane in the other clip, once its track is read.
    fn motion(assistant: &Assistant, edit: &Edit) -> Option<std::sync::Arc<Motion>> {
        let track = edit.text_field("into_track").to_owned();
        let known = assistant.answer::<Motion>(INTO_MOTION);
        let known = known.filter(|known| known.track == track);
        if known.is_none() && !assistant.is_asked(INTO_MOTION) {
            let step = edit.step(Path::new("@input"), Path::new("@output")).ok()?;
            assistant.ask(INTO_MOTION, move |_, progress: &Progress| {
                let Step::VideoPaste(paste) = step else {
                    return None;
                };
                let motion = paste.scene_motion(&Context::new(progress)).ok();
                Some(Motion { track, motion })
            });
        }
        known
    }

    /// Says what the edit waits for.
    fn wait_ui(&self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) {
        if let Some((name, label, _)) = self.files.first()
            && edit.text_field(name).is_empty()
        {
            ui.label(RichText::new(format!("Give the file: {label}")).strong());
        }
        for (name, label) in [("track", "track"), ("plate", "plate"), ("matte", "matte")] {
            let Some(known) = desk.document.last_analysis(name, Some(edit.id)) else {
                continue;
            };
            if known.output() != Some(edit.text_field(name)) {
                continue;
            }
            match desk.assistant.analyses.state(known.id) {
                AnalysisState::Done(_) => {}
                AnalysisState::Waiting => {
                    ui.label(RichText::new(format!("The {label} is not there yet")).italics());
                }
                AnalysisState::Running(phase, fraction) => {
                    let bar = egui::ProgressBar::new(fraction as f32).desired_width(200.0);
                    ui.add(bar.text(format!("The {label} is made: {phase}")));
                }
                AnalysisState::Failed(reason) => {
                    let text = format!("The {label} cannot be made: {reason}");
                    ui.colored_label(ui.visuals().error_fg_color, text);
                }
            }
        }
    }
}
