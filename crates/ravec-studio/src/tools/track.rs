//! Tracking: a plane is drawn in a frame and followed through the clip while one watches; corners are corrected in any frame.

use super::analysis::file_ui;
use super::quad::{self, Corners, QuadHandle};
use super::{Desk, Gesture, Hand, Row, Tool, range_ui, with_params};
use crate::assistant::Assistant;
use crate::content::Kind;
use crate::document::{Document, Edit};
use crate::engine::lock;
use crate::shown::Shown;
use crate::view::panel::text_ui;
use crate::view::timeline::FrameState;
use egui::{Color32, Key, Stroke, Ui};
use ravec::planar::track::{Track as PlaneTrack, TrackState, TrackedFrame};
use ravec::planar::{Beyond, Homography, warp};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Average as _, Image, PremulLinearRgba, Size, Srgba};
use ravec_jobs::Step;
use ravec_jobs::track::{FrameQuad, Track as Operation};
use ravec_media::Picture;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Kinds of the questions about corrections and about the stabilized view.
const CORRECTED: &str = "corrected track";
const STABILIZED: &str = "stabilized plane";

/// Longer side of the stabilized view in pixels.
const STABLE_PX: f64 = 360.0;

/// Share of the plane's sides that the stabilized view shows around it.
const MARGIN: f64 = 0.25;

/// Files that other programs read: names for the panel, and ends of the names of files.
const EXPORTS: [(&str, &str); 5] = [
    ("Nuke", ".nk"),
    ("After Effects", ".aekf.txt"),
    ("Blender", ".py"),
    ("Table", ".csv"),
    ("Corners", ".txt"),
];

/// Files that are read: fields, names for the panel, and help.
const FILES: [(&str, &str, &str); 4] = [
    (
        "mask",
        "Mask of the plane",
        "A picture of the reference frame, white on black, in place of the inside of the corners",
    ),
    (
        "exclude",
        "Mask of what is never the plane",
        "A picture for all frames, or a clip of masks, white on black",
    ),
    (
        "strokes",
        "Strokes",
        "Pictures of single frames with their numbers in the names: white hides the plane, black is the plane, gray is unknown",
    ),
    (
        "photo",
        "Photo of the plane",
        "Its place on the plane is found, and the clip with the grid shows it there",
    ),
];

/// A track with the corrections of an edit.
struct Corrected {
    /// Measurement and corrections.
    key: (String, Value),
    track: Result<Arc<PlaneTrack>, String>,
}

/// The plane of a frame, seen from straight on.
struct Stabilized {
    /// The frame, and the corners in it.
    key: (Arc<str>, Corners),
    picture: Arc<Shown>,
}

/// Draws planes and corrects them.
pub(crate) struct Track {
    handle: QuadHandle,
    /// Corners that are set so far.
    drawn: Vec<[f64; 2]>,
    /// True if the playhead follows while a plane is tracked.
    follows: bool,
    /// True if the stabilized view is shown.
    stabilizes: bool,
    /// The frame that the panel has asked for.
    wanted: Option<u64>,
    /// The frame that the playhead followed to last.
    followed: Option<u64>,
}

impl Default for Track {
    fn default() -> Self {
        Self {
            handle: QuadHandle::default(),
            drawn: Vec::new(),
            follows: true,
            stabilizes: true,
            wanted: None,
            followed: None,
        }
    }
}

/// The edit as an operation on the source, or a sentence.
fn operation(edit: &Edit, document: &Document) -> Result<Operation, String> {
    let before = document
        .edits
        .iter()
        .take_while(|other| other.id != edit.id);
    if before
        .filter(|other| other.enabled && !other.is_analysis())
        .count()
        > 0
    {
        return Err(
            "The plane is shown in the clip as it was opened: move this edit before the others"
                .to_owned(),
        );
    }
    match edit.step(&document.source, Path::new(""))? {
        Step::Track(operation) => Ok(*operation),
        _ => Err("the edit is no track".to_owned()),
    }
}

/// Text that changes with what is measured, not with corrections and outputs.
pub(crate) fn measure_key(edit: &Edit) -> String {
    let measured = edit.with_param("corrections", Value::Null);
    // a photo is placed on a track that is there already
    let outputs = ["output", "exports", "show", "photo"];
    let fields = measured.fields.iter();
    let fields = fields.filter(|(name, _)| !outputs.contains(&name.as_str()));
    let fields: Map<String, Value> = fields
        .map(|(name, value)| (name.clone(), value.clone()))
        .collect();
    Value::Object(fields).to_string()
}

/// The corners in the reference frame.
fn plane(edit: &Edit) -> Option<Corners> {
    quad::read(edit.param("quads").get(0)?.as_str()?)
}

fn reference(edit: &Edit) -> u64 {
    edit.param("reference").as_u64().unwrap_or(0)
}

/// The corrections by hand, as far as they are well-formed.
fn corrections(edit: &Edit) -> Vec<FrameQuad> {
    let list = edit.param("corrections").as_array();
    let texts = list.into_iter().flatten().filter_map(Value::as_str);
    texts.filter_map(|text| text.parse().ok()).collect()
}

fn with_corrections(edit: &Edit, corrections: &[FrameQuad]) -> Edit {
    let texts: Vec<String> = corrections.iter().map(FrameQuad::to_string).collect();
    let value = if texts.is_empty() {
        Value::Null
    } else {
        texts.into()
    };
    edit.with_param("corrections", value)
}

/// The edit with these corners in a frame, in place of an earlier correction of it.
fn corrected_at(edit: &Edit, frame: u64, corners: &Corners) -> Edit {
    let mut list = corrections(edit);
    list.retain(|other| other.frame != frame);
    let text = format!("{frame}:{}", quad::text(corners));
    list.extend(text.parse::<FrameQuad>());
    list.sort_by_key(|other| other.frame);
    with_corrections(edit, &list)
}

/// The edit with these corners in the reference frame. A plane that is drawn anew has no corrections.
fn with_plane(edit: &Edit, corners: &Corners) -> Edit {
    edit.with_param("quads", json!([quad::text(corners)]))
}

/// A file beside the clip, by the end of its name.
fn beside(source: &Path, end: &str) -> PathBuf {
    let stem = source.file_stem().unwrap_or_default().to_string_lossy();
    // a pattern would be taken for one
    let stem = stem.replace('%', "");
    source.with_file_name(format!("{stem}-track{end}"))
}

/// The track that is known: with corrections, as measured, or as far as it has grown.
fn plane_at(assistant: &Assistant, edit: &Edit, frame: u64) -> Option<TrackedFrame> {
    let key = measure_key(edit);
    if !edit.param("corrections").is_null()
        && let Some(corrected) = assistant.answer::<Corrected>(CORRECTED)
        && corrected.key.0 == key
        && let Ok(track) = &corrected.track
    {
        return track.frame(frame).cloned();
    }
    let measurement = assistant.tracking.measurement(&key)?;
    lock(&measurement).frame(frame).cloned()
}

fn color_of(state: TrackState) -> Color32 {
    frame_state(state, false).color()
}

fn frame_state(state: TrackState, is_corrected: bool) -> FrameState {
    match state {
        _ if is_corrected => FrameState::Corrected,
        TrackState::Tracked => FrameState::Good,
        TrackState::Weak => FrameState::Weak,
        TrackState::Lost => FrameState::Lost,
    }
}

fn corners_of(frame: &TrackedFrame) -> Corners {
    frame.corners.map(|corner| [corner.x, corner.y])
}

impl Track {
    /// Sets the corners of a new plane, one by each click.
    fn draw(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let color = Color32::from_rgb(90, 220, 120);
        if hand.ui.input(|input| input.key_pressed(Key::Escape)) {
            self.drawn.clear();
        }
        if let Some(at) = hand.clicked() {
            self.drawn.push(at);
        }
        let places = self.drawn.iter();
        let mut places: Vec<_> = places.map(|at| hand.view.to_screen(at[0], at[1])).collect();
        for place in &places {
            hand.painter.circle_filled(*place, 5.0, color);
        }
        places.extend(hand.response.hover_pos());
        hand.painter
            .add(egui::Shape::line(places, Stroke::new(1.5, color)));
        let corners: Corners = self.drawn[..].try_into().ok()?;
        self.drawn.clear();
        let mut edit = with_plane(edit, &corners);
        edit = edit.with_param("corrections", Value::Null);
        edit = edit.with_param("reference", hand.frame.unwrap_or(0).into());
        if !edit.fields.contains_key("output") {
            let path = beside(&hand.document.source, ".json");
            let path = path.to_string_lossy().into_owned();
            edit.fields.insert("output".to_owned(), path.into());
        }
        Some(Gesture::done(edit))
    }

    /// Starts what is not known yet: the measurement, and the solution with corrections.
    fn ask(&self, assistant: &Assistant, document: &Document, edit: &Edit) {
        let Ok(operation) = operation(edit, document) else {
            return;
        };
        let key = measure_key(edit);
        if !self.handle.holds() || !edit.param("corrections").is_null() {
            assistant.tracking.measure(&key, operation.clone());
        }
        let given = edit.param("corrections").clone();
        let Some(measurement) = assistant.tracking.measurement(&key) else {
            return;
        };
        let measured = lock(&measurement).track().cloned();
        let (Some(measured), false) = (measured, given.is_null()) else {
            return;
        };
        let key = (key, given);
        let known = assistant.answer::<Corrected>(CORRECTED);
        if known.is_some_and(|known| known.key == key) {
            return;
        }
        assistant.ask(CORRECTED, move |_, _| {
            let track = operation.corrected(&measured).map(Arc::new);
            let track = track.map_err(|error| error.to_string());
            Some(Corrected { key, track })
        });
    }

    /// Asks for the plane of the frame that is shown, seen from straight on.
    fn ask_stabilized(&self, hand: &Hand<'_>, corners: &Corners) {
        if !self.stabilizes {
            return;
        }
        let key = (hand.input.key.clone(), *corners);
        let known = hand.assistant.answer::<Stabilized>(STABILIZED);
        if known.is_some_and(|known| known.key == key) || hand.assistant.is_asked(STABILIZED) {
            return;
        }
        let Some(picture) = hand.input.content.picture().cloned() else {
            return;
        };
        hand.assistant.ask(STABILIZED, move |_, progress| {
            let picture = stabilized(&picture, &key.1, progress)?;
            Some(Stabilized { key, picture })
        });
    }

    fn draw_plane(hand: &Hand<'_>, known: &TrackedFrame, corners: &Corners) {
        let color = color_of(known.state);
        quad::paint(hand.painter, hand.view, corners, [4, 4], color, true);
        // two standard deviations contain the error in most of the frames
        for (k, corner) in corners.iter().enumerate() {
            let variance = known.covariance[2 * k][2 * k] + known.covariance[2 * k + 1][2 * k + 1];
            let radius = 2.0 * (0.5 * variance).max(0.0).sqrt() as f32 * hand.view.zoom;
            if radius > 5.0 && radius.is_finite() {
                let place = hand.view.to_screen(corner[0], corner[1]);
                let radius = radius.min(1e4);
                hand.painter
                    .circle_stroke(place, radius, Stroke::new(1.0, color));
            }
        }
    }

    fn state_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        let key = measure_key(edit);
        let measurement = desk.assistant.tracking.measurement(&key);
        if let Some(measurement) = &measurement {
            let state = lock(measurement);
            if state.runs() {
                ui.horizontal(|ui| {
                    ui.label(format!("Tracking: {} frames", state.growing.len()));
                    if ui.button("Stop tracking").clicked() {
                        desk.assistant.tracking.stop();
                    }
                });
            }
            if let Some(Err(reason)) = &state.end {
                ui.colored_label(ui.visuals().error_fg_color, reason);
                if ui.button("Track again").clicked() {
                    desk.assistant.tracking.forget();
                }
            }
        }
        let corrected = desk.assistant.answer::<Corrected>(CORRECTED);
        if let Some(corrected) = corrected
            && corrected.key == (key, edit.param("corrections").clone())
            && let Err(reason) = &corrected.track
        {
            ui.colored_label(ui.visuals().error_fg_color, reason);
        }
        let states = self.states(desk.assistant, edit);
        if !states.is_empty() {
            let count = |wanted: &[FrameState]| {
                let found = states.iter().filter(|state| wanted.contains(state));
                found.count()
            };
            ui.label(format!(
                "{} tracked, {} weak, {} lost",
                count(&[FrameState::Good, FrameState::Corrected]),
                count(&[FrameState::Weak]),
                count(&[FrameState::Lost]),
            ));
        }
        ui.checkbox(&mut self.follows, "Show the frame that is tracked");
        ui.checkbox(&mut self.stabilizes, "Stabilized view");
        if ui
            .button("Draw the plane again")
            .on_hover_text("Four corners by clicks, in the frame that is shown")
            .clicked()
        {
            self.drawn.clear();
            let empty = edit.with_param("quads", Value::Null);
            let empty = empty.with_param("corrections", Value::Null);
            return Some(Gesture::done(empty.with_param("reference", Value::Null)));
        }
        self.corrections_ui(ui, edit)
    }

    /// The states of all frames from the first one of the clip.
    fn states(&self, assistant: &Assistant, edit: &Edit) -> Vec<FrameState> {
        self.rows(assistant, edit)
            .into_iter()
            .next()
            .map_or_else(Vec::new, |row| row.states)
            .into_iter()
            .filter(|state| *state != FrameState::Unknown)
            .collect()
    }

    fn corrections_ui(&mut self, ui: &mut Ui, edit: &Edit) -> Option<Gesture> {
        let list = corrections(edit);
        let mut removed = None;
        for correction in &list {
            let frame = correction.frame;
            ui.horizontal(|ui| {
                if ui.button(format!("Corrected in frame {frame}")).clicked() {
                    self.wanted = Some(frame);
                }
                let remove = ui.small_button("×");
                let name = format!("Remove the correction of frame {frame}");
                remove.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &name));
                if remove.on_hover_text(&name).clicked() {
                    removed = Some(frame);
                }
            });
        }
        let frame = removed?;
        let kept = list.into_iter().filter(|other| other.frame != frame);
        let kept: Vec<_> = kept.collect();
        Some(Gesture::done(with_corrections(edit, &kept)))
    }

    /// Files that are written when the document is exported.
    fn files_ui(ui: &mut Ui, document: &Document, edit: &Edit) -> Option<Gesture> {
        let mut changed = None;
        ui.label("Written by Export:");
        let label = ui.label("Track");
        let output = edit.fields.get("output").and_then(Value::as_str);
        let output = output.unwrap_or_default();
        if let Some(path) = text_ui(ui, "output", output, label.id) {
            changed = Some(with_field(edit, "output", false, path.into()));
        }
        let exports = edit.fields.get("exports").and_then(Value::as_array);
        let exports: Vec<String> = exports
            .into_iter()
            .flatten()
            .filter_map(|path| path.as_str().map(str::to_owned))
            .collect();
        for (name, end) in EXPORTS {
            // .txt is the end of .aekf.txt as well
            let is_it = |path: &String| match end {
                ".txt" => path.ends_with(end) && !path.ends_with(".aekf.txt"),
                _ => path.ends_with(end),
            };
            let mut on = exports.iter().any(is_it);
            if ui.checkbox(&mut on, format!("{name} ({end})")).changed() {
                let mut list: Vec<String> = exports
                    .iter()
                    .filter(|path| !is_it(path))
                    .cloned()
                    .collect();
                if on {
                    list.push(beside(&document.source, end).to_string_lossy().into_owned());
                }
                changed = Some(with_field(edit, "exports", list.is_empty(), list.into()));
            }
        }
        let mut shows = edit.fields.contains_key("show");
        if ui
            .checkbox(&mut shows, "Clip with the grid drawn on it (.mp4)")
            .changed()
        {
            let path = beside(&document.source, "-grid.mp4");
            let path = path.to_string_lossy().into_owned();
            changed = Some(with_field(edit, "show", !shows, path.into()));
        }
        let read = FILES.into_iter().filter_map(|file| file_ui(ui, edit, file));
        // all lines are drawn, whichever has changed
        let read = read.reduce(|first, _| first);
        changed.map(Gesture::done).or(read)
    }
}

/// The edit with another value of a field, or without it.
fn with_field(edit: &Edit, name: &str, is_absent: bool, value: Value) -> Edit {
    let mut edit = edit.clone();
    if is_absent {
        edit.fields.remove(name);
    } else {
        edit.fields.insert(name.to_owned(), value);
    }
    edit
}

/// The plane between corners of a picture, seen from straight on, with its surroundings.
fn stabilized(picture: &Picture, corners: &Corners, progress: &Progress) -> Option<Arc<Shown>> {
    let side = |a: usize, b: usize| {
        let [a, b] = [corners[a], corners[b]];
        (a[0] - b[0]).hypot(a[1] - b[1])
    };
    let width = 0.5 * (side(0, 1) + side(2, 3));
    let height = 0.5 * (side(1, 2) + side(3, 0));
    let scale = STABLE_PX / width.max(height).max(1e-6);
    let pixels = |length: f64| (scale * length).clamp(8.0, STABLE_PX).round() as usize;
    let size = Size::new(pixels(width), pixels(height)).ok()?;
    // the plane is the middle part of the view
    let share = 1.0 + 2.0 * MARGIN;
    let unit_from_output = Homography::from_pairs(
        &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]: [f64; 2]| [x * size.width() as f64, y * size.height() as f64].into()),
        &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .map(|[x, y]: [f64; 2]| [x * share - MARGIN, y * share - MARGIN].into()),
    )
    .ok()?;
    let image_from_unit = Homography::from_unit_square(corners.map(Into::into)).ok()?;
    let map = Homography::from_matrix(image_from_unit.matrix() * unit_from_output.matrix()).ok()?;
    let image: Image<PremulLinearRgba> = picture.convert();
    let beyond = Beyond::Pixel(PremulLinearRgba::ZERO);
    let view = warp(&image, &map, size, beyond, progress).ok()?;
    let view = AnyImage::from(view.convert::<Srgba<u8>>());
    Some(Arc::new(Shown::new(Arc::new(Picture::from_image(view)))))
}

impl Tool for Track {
    fn operation(&self) -> &'static str {
        "track"
    }

    fn label(&self) -> &'static str {
        "Track a plane"
    }

    fn hint(&self) -> &'static str {
        "Click the four corners of a plane; drag a corner in any frame to correct it"
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Clip]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        with_params(json!({}))
    }

    fn start_in(&self, size: [usize; 2], document: &Document) -> Map<String, Value> {
        let mut fields = self.start(size);
        // a name by which other edits find it, drawn or not
        let path = beside(&document.source, ".json");
        let path = path.to_string_lossy().into_owned();
        let is_taken = (document.edits.iter()).any(|edit| edit.output() == Some(&path));
        let path = if is_taken {
            document.free_name("track", ".json")
        } else {
            path
        };
        fields.insert("output".to_owned(), path.into());
        fields
    }

    fn works_on_input(&self, _edit: &Edit) -> bool {
        true
    }

    fn beside_name(&self) -> &'static str {
        "Stabilized plane"
    }

    fn hidden(&self) -> &'static [&'static str] {
        &[
            "quads",
            "reference",
            "corrections",
            "exports",
            "show",
            "track",
            "mask",
            "exclude",
            "strokes",
            "photo",
        ]
    }

    fn beside(&self, assistant: &Assistant, edit: &Edit) -> Option<Arc<Shown>> {
        plane(edit).filter(|_| self.stabilizes)?;
        let known = assistant.answer::<Stabilized>(STABILIZED)?;
        Some(known.picture.clone())
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let Some(start) = plane(edit) else {
            return self.draw(hand, edit);
        };
        self.ask(hand.assistant, hand.document, edit);
        let frame = hand.frame?;
        if frame == reference(edit) {
            let known = plane_at(hand.assistant, edit, frame);
            let color = known.map_or(Color32::from_rgb(90, 220, 120), |known| {
                color_of(known.state)
            });
            quad::paint(hand.painter, hand.view, &start, [4, 4], color, true);
            self.ask_stabilized(hand, &start);
            let moved = self.handle.follow(hand, &[start])?;
            return Some(Gesture {
                edit: with_plane(edit, &moved.corners),
                goes_on: moved.goes_on,
            });
        }
        let known = plane_at(hand.assistant, edit, frame)?;
        let given = corrections(edit);
        let given = given.iter().find(|given| given.frame == frame);
        let corners = match given {
            Some(given) => given.quad.0.map(|corner| [corner.x, corner.y]),
            None => corners_of(&known),
        };
        Self::draw_plane(hand, &known, &corners);
        self.ask_stabilized(hand, &corners);
        let measurement = hand.assistant.tracking.measurement(&measure_key(edit))?;
        // corrections are of a whole track
        lock(&measurement).track()?;
        let moved = self.handle.follow(hand, &[corners])?;
        Some(Gesture {
            edit: corrected_at(edit, frame, &moved.corners),
            goes_on: moved.goes_on,
        })
    }

    fn rows(&self, assistant: &Assistant, edit: &Edit) -> Vec<Row> {
        if plane(edit).is_none() {
            return Vec::new();
        }
        let given = corrections(edit);
        let mut row = Row {
            label: "Predicted error, px".to_owned(),
            marks: given.iter().map(|given| given.frame).collect(),
            ..Row::default()
        };
        row.marks.push(reference(edit));
        let mut put = |number: u64, frame: &TrackedFrame| {
            let index = number as usize;
            if row.states.len() <= index {
                row.states.resize(index + 1, FrameState::Unknown);
                row.values.resize(index + 1, None);
            }
            let is_corrected = given.iter().any(|given| given.frame == number);
            row.states[index] = frame_state(frame.state, is_corrected);
            row.values[index] = (frame.state != TrackState::Lost).then(|| frame.sigma_px() as f32);
        };
        let key = measure_key(edit);
        let corrected = assistant.answer::<Corrected>(CORRECTED);
        let corrected = corrected.filter(|corrected| corrected.key.0 == key && !given.is_empty());
        let corrected = corrected.and_then(|corrected| corrected.track.clone().ok());
        let measurement = assistant.tracking.measurement(&key);
        let whole = |track: &PlaneTrack, put: &mut dyn FnMut(u64, &TrackedFrame)| {
            for (number, frame) in (track.first..).zip(&track.frames) {
                put(number, frame);
            }
        };
        if let Some(track) = corrected {
            whole(&track, &mut put);
        } else if let Some(measurement) = measurement {
            let state = lock(&measurement);
            match state.track() {
                Some(track) => whole(track, &mut put),
                None => state
                    .growing
                    .iter()
                    .for_each(|(number, frame)| put(*number, frame)),
            }
        }
        vec![row]
    }

    fn wanted_frame(&mut self, assistant: &Assistant, edit: &Edit) -> Option<u64> {
        let wanted = self.wanted.take();
        let measurement = assistant.tracking.measurement(&measure_key(edit));
        let latest = measurement.and_then(|measurement| {
            let state = lock(&measurement);
            state.latest.filter(|_| state.runs())
        });
        let latest = latest.filter(|_| self.follows && !self.handle.holds());
        let is_new = latest.is_some() && latest != self.followed;
        self.followed = latest;
        wanted.or(latest.filter(|_| is_new))
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        if plane(edit).is_none() {
            let count = self.drawn.len();
            ui.label(format!(
                "Click the corners of a rectangle on the plane, in turn from the upper left one clockwise: {count} of 4"
            ));
            return None;
        }
        if let Err(reason) = operation(edit, desk.document) {
            ui.colored_label(ui.visuals().error_fg_color, reason);
        }
        let gesture = self.state_ui(ui, desk, edit);
        let range = range_ui(ui, desk, edit);
        let files = Self::files_ui(ui, desk.document, edit);
        gesture.or(range).or(files)
    }
}
