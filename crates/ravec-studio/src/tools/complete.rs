//! Completion: areas are drawn and filled, in perspective where planes are set; or fragments are set one by one.

use super::outline::{self, Outline};
use super::planes::PlaneAids;
use super::quad::{self, Corners, QuadHandle};
use super::{Desk, DraftFn, DraftJob, DraftView, Gesture, Hand, Tool, rectify, with_params};
use crate::assistant::{Assistant, Memory};
use crate::content::{Content, View};
use crate::document::Edit;
use crate::engine::EditInput;
use crate::shown::Shown;
use egui::{Color32, Key, Stroke, Ui};
use glam::DVec2;
use ravec::completion::{
    FragmentIndex, Retouch, RetouchState, SearchOptions, Sources, Step, Target,
};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Color, Image, Mask, Rect, Srgba, with_image};
use ravec_jobs::complete::{Complete as Operation, Corners as Polygon, RecordedSteps};
use ravec_media::Picture;
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Color of the area to fill.
const HOLE: Color32 = Color32::from_rgb(240, 90, 80);
/// Color of planes.
const PLANE: Color32 = Color32::from_rgb(90, 220, 120);

/// Fragments that are found for a position.
const MATCHES: usize = 12;

/// Effect of gestures on the canvas.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Mode {
    /// Draws the area to fill.
    #[default]
    Area,
    /// Sets planes.
    Planes,
    /// Sets fragments.
    Fragments,
    /// Shows the result.
    Result,
}

/// Draws areas, planes and fragments.
pub(crate) struct Complete {
    mode: Mode,
    outline: Outline,
    handle: QuadHandle,
    aids: PlaneAids,
    /// Radius of fragments in pixels.
    radius: u32,
    /// Number of the match that is shown.
    choice: usize,
    /// The search that was asked for last.
    asked: Option<Search>,
}

impl Default for Complete {
    fn default() -> Self {
        Self {
            mode: Mode::Area,
            outline: Outline::with_radius(20.0),
            handle: QuadHandle::default(),
            aids: PlaneAids::default(),
            radius: 24,
            choice: 0,
            asked: None,
        }
    }
}

/// A search for fragments.
#[derive(Debug, Clone, PartialEq)]
struct Search {
    key: Arc<str>,
    fields: Map<String, Value>,
    at: [i64; 2],
    radius: u32,
}

/// A step with the picture inside of the ring, and its place.
type Preview = (Step, Arc<Shown>, [f64; 4]);

/// Fragments that fit at a position, the best one first.
struct Found {
    search: Search,
    steps: Vec<Preview>,
    problem: Option<String>,
}

/// Kind of the questions about fragments.
const FRAGMENTS: &str = "fragments";

impl Tool for Complete {
    fn operation(&self) -> &'static str {
        "complete"
    }

    fn label(&self) -> &'static str {
        "Complete"
    }

    fn hint(&self) -> &'static str {
        match self.mode {
            Mode::Area => "Draw around what is to go, then fill",
            Mode::Planes => "Drag corners; S snaps to edges",
            Mode::Fragments => {
                "Click sets the fragment; Shift+wheel for the next best, [ and ] for the size"
            }
            Mode::Result => "",
        }
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        with_params(json!({}))
    }

    fn works_on_input(&self, edit: &Edit) -> bool {
        match self.mode {
            Mode::Area | Mode::Planes => true,
            // without an area there is nothing to run
            Mode::Result => edit.param("polygons").is_null(),
            // without fragments the area would be filled as a whole
            Mode::Fragments => count_of_fragments(edit) == 0,
        }
    }

    fn draft(&self) -> Option<DraftFn> {
        (self.mode == Mode::Fragments).then_some(draft as DraftFn)
    }

    fn drafts_first(&self) -> bool {
        true
    }

    fn hidden(&self) -> &'static [&'static str] {
        &["planes", "polygons", "targets", "pixel_centers", "undo"]
    }

    fn overlay(&self, assistant: &Assistant) -> Option<(Arc<Shown>, [f64; 4])> {
        if self.mode != Mode::Fragments {
            return None;
        }
        let found = assistant.answer::<Found>(FRAGMENTS)?;
        let asked = self.asked.as_ref()?;
        // the picture may lag behind the hand, but not behind the edit
        if found.search.fields != asked.fields || found.steps.is_empty() {
            return None;
        }
        let (_, shown, place) = &found.steps[self.choice % found.steps.len()];
        Some((shown.clone(), *place))
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        if self.mode == Mode::Result {
            return None;
        }
        let holes = outline::polygons(edit, "polygons");
        let planes: Vec<Corners> =
            serde_json::from_value(edit.param("planes").clone()).unwrap_or_default();
        outline::paint(
            hand,
            &holes,
            HOLE.gamma_multiply(if self.mode == Mode::Area { 1.0 } else { 0.4 }),
        );
        for plane in &planes {
            let handles = self.mode == Mode::Planes;
            quad::paint(
                hand.painter,
                hand.view,
                plane,
                self.aids.drawn_grid(),
                PLANE,
                handles,
            );
        }
        match self.mode {
            Mode::Area => {
                let drawn = self.outline.follow(hand, HOLE)?;
                // the steps are about the old area
                let mut edit = outline::with_polygons(edit, "polygons", &drawn);
                edit.fields.remove("recorded");
                Some(Gesture::done(edit))
            }
            Mode::Planes => self.follow_planes(hand, edit, planes),
            Mode::Fragments => self.follow_fragments(hand, edit),
            Mode::Result => None,
        }
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        let mut changed = None;
        ui.horizontal_wrapped(|ui| {
            for (mode, name) in [
                (Mode::Area, "Area"),
                (Mode::Planes, "Planes"),
                (Mode::Fragments, "Fragments"),
                (Mode::Result, "Fill"),
            ] {
                if ui.selectable_label(self.mode == mode, name).clicked() {
                    self.mode = mode;
                }
            }
        });
        match self.mode {
            Mode::Area => {
                self.outline.ui(ui);
                let some = !edit.param("polygons").is_null();
                if ui
                    .add_enabled(some, egui::Button::new("Remove the area"))
                    .clicked()
                {
                    let mut edit = edit.with_param("polygons", Value::Null);
                    edit.fields.remove("recorded");
                    changed = Some(edit);
                }
            }
            Mode::Planes => {
                self.aids.ui(ui, desk);
                ui.horizontal(|ui| {
                    let size = desk.input.map(|input| input.content.size());
                    if ui.button("Add a plane").clicked()
                        && let Some(size) = size
                    {
                        changed = Some(with_plane(edit, rectify::start_corners(size)));
                    }
                    let some = !edit.param("planes").is_null();
                    if ui
                        .add_enabled(some, egui::Button::new("Remove planes"))
                        .clicked()
                    {
                        changed = Some(edit.with_param("planes", Value::Null));
                    }
                });
            }
            Mode::Fragments => {
                ui.horizontal(|ui| {
                    let label = ui.label("Fragment radius");
                    let value = egui::DragValue::new(&mut self.radius)
                        .range(4..=124)
                        .suffix(" px");
                    ui.add(value).labelled_by(label.id);
                });
                let count = count_of_fragments(edit);
                ui.horizontal(|ui| {
                    ui.label(format!("{count} fragments set"));
                    if ui
                        .add_enabled(count > 0, egui::Button::new("Remove fragments"))
                        .clicked()
                    {
                        let mut edit = edit.clone();
                        edit.fields.remove("recorded");
                        changed = Some(edit);
                    }
                });
                if let Some(found) = desk.assistant.answer::<Found>(FRAGMENTS) {
                    match &found.problem {
                        Some(problem) => ui.label(problem),
                        None => ui.label(format!(
                            "Match {} of {}",
                            self.choice % found.steps.len().max(1) + 1,
                            found.steps.len()
                        )),
                    };
                }
            }
            Mode::Result => {}
        }
        changed.map(Gesture::done)
    }
}

/// Number of the fragments that were set by hand.
fn count_of_fragments(edit: &Edit) -> usize {
    let recorded = edit.fields.get("recorded");
    let steps = recorded.and_then(|recorded| recorded["steps"].as_array());
    steps.map_or(0, Vec::len)
}

fn with_plane(edit: &Edit, corners: Corners) -> Edit {
    let mut planes: Vec<Corners> =
        serde_json::from_value(edit.param("planes").clone()).unwrap_or_default();
    planes.push(corners);
    edit.with_param("planes", json!(planes))
}

impl Complete {
    fn follow_planes(
        &mut self,
        hand: &Hand<'_>,
        edit: &Edit,
        mut planes: Vec<Corners>,
    ) -> Option<Gesture> {
        let with = |planes: &[Corners]| edit.with_param("planes", json!(planes));
        if let Some(last) = planes.last().copied()
            && let Some(snapped) = self.aids.follow_snap(hand, &last)
        {
            *planes.last_mut()? = snapped;
            return Some(Gesture::done(with(&planes)));
        }
        if !self.handle.holds()
            && let Some(taken) = self.aids.follow_proposals(hand, &planes)
        {
            planes.push(taken);
            return Some(Gesture::done(with(&planes)));
        }
        let moved = self.handle.follow(hand, &planes)?;
        planes[moved.index] = moved.corners;
        Some(Gesture {
            edit: with(&planes),
            goes_on: moved.goes_on,
        })
    }

    fn follow_fragments(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let (finer, coarser) = hand.ui.input(|input| {
            (
                input.key_pressed(Key::OpenBracket),
                input.key_pressed(Key::CloseBracket),
            )
        });
        if finer || coarser {
            let factor = if finer { 0.85 } else { 1.18 };
            self.radius = ((f64::from(self.radius) * factor).round() as u32).clamp(4, 124);
        }
        let turned = hand.wheel();
        if turned != 0.0 {
            self.choice = (self.choice as f32 - turned).rem_euclid(MATCHES as f32) as usize;
        }
        let at = hand.response.hover_pos()?;
        let ring = self.radius as f32 * hand.view.zoom;
        hand.painter
            .circle_stroke(at, ring, Stroke::new(1.5, Color32::WHITE));
        let [x, y] = hand.view.to_picture(at);
        let search = Search {
            key: hand.input.key.clone(),
            fields: edit.fields.clone(),
            at: [x.floor() as i64, y.floor() as i64],
            radius: self.radius,
        };
        if self.asked.as_ref() != Some(&search) {
            if self
                .asked
                .as_ref()
                .is_none_or(|asked| asked.at != search.at)
            {
                self.choice = 0;
            }
            let (input, edit, asked) = (hand.input.clone(), edit.clone(), search.clone());
            hand.assistant.ask(FRAGMENTS, move |memory, progress| {
                let found = with_retouch(&input, &edit, memory, progress, |retouch, picture| {
                    fragments(retouch, picture, &asked, progress)
                });
                let (steps, problem) = match found {
                    Ok(steps) => (steps, None),
                    Err(problem) => (Vec::new(), Some(problem)),
                };
                Some(Found {
                    search: asked,
                    steps,
                    problem,
                })
            });
            self.asked = Some(search.clone());
        }
        hand.clicked()?;
        let found = hand.assistant.answer::<Found>(FRAGMENTS)?;
        if found.search != search || found.steps.is_empty() {
            return None;
        }
        let step = found.steps[self.choice % found.steps.len()].0;
        let mut edit = edit.clone();
        let [width, height] = hand.input_size;
        let empty = || json!({"width": width, "height": height, "steps": []});
        let recorded = edit.fields.entry("recorded").or_insert_with(empty);
        if let Some(steps) = recorded["steps"].as_array_mut() {
            steps.push(serde_json::to_value(step).ok()?);
        }
        Some(Gesture::done(edit))
    }
}

/// The area after the steps of an edit.
fn draft(job: &DraftJob, memory: &mut Memory, progress: &Progress) -> Option<DraftView> {
    let area = |retouch: &mut Retouch<'_>, picture: &Picture| {
        let whole = Rect::of(picture.image.size());
        let bounds = retouch.index().hole().bounding_box();
        let part = bounds.unwrap_or(whole).intersection(whole);
        let pixels = with_image!(&picture.image, image => {
            retouch.picture_in(image, part).map(AnyImage::from)
        });
        let shown = Shown::new(Arc::new(picture.with_pixels(pixels.ok_or("no area")?)));
        let size = picture.image.size();
        Ok(DraftView::part(View::Picture(Arc::new(shown)), part, size))
    };
    with_retouch(&job.input, &job.edit, memory, progress, area).ok()
}

/// Works on the picture of an edit after its steps, which is kept from question to question.
fn with_retouch<T>(
    input: &EditInput,
    edit: &Edit,
    memory: &mut Memory,
    progress: &Progress,
    work: impl FnOnce(&mut Retouch<'_>, &Picture) -> Result<T, String>,
) -> Result<T, String> {
    let Content::Picture(picture) = &input.content else {
        return Err("fragments are for pictures".to_owned());
    };
    let step = edit.step("in.png".as_ref(), "out.png".as_ref())?;
    let ravec_jobs::Step::Complete(operation) = step else {
        return Err("no completion".to_owned());
    };
    if operation.params.polygons.is_empty() {
        return Err("draw an area first".to_owned());
    }
    let geometry = json!([edit.param("polygons"), edit.param("planes")]);
    let key = format!("{} {geometry}", input.key).into();
    let (index, state) = memory.keep("fragment index", &key, || {
        let index = index(picture, &operation, progress)?;
        Ok::<_, String>((index, None::<RetouchState>))
    })?;
    let resumed = state.take().and_then(|state| Retouch::resume(index, state));
    let mut retouch = resumed.unwrap_or_else(|| Retouch::new(index));
    let recorded = operation.recorded.as_ref();
    let steps = recorded.map_or(&[][..], |RecordedSteps { steps, .. }| steps);
    let followed = retouch.follow(steps, progress);
    let done = followed
        .map_err(|error| error.to_string())
        .and_then(|()| work(&mut retouch, picture));
    *state = Some(retouch.suspend());
    done
}

/// The fragments that fit at a position.
fn fragments(
    retouch: &mut Retouch<'_>,
    picture: &Picture,
    search: &Search,
    progress: &Progress,
) -> Result<Vec<Preview>, String> {
    let words = |error: &dyn std::fmt::Display| error.to_string();
    let at = DVec2::new(search.at[0] as f64 + 0.5, search.at[1] as f64 + 0.5);
    let plane = retouch.index().plane_at(at);
    let target = Target {
        plane,
        ..Target::new(at, search.radius)
    };
    let options = SearchOptions {
        count: MATCHES,
        along_plane: plane.map(Some),
        ..SearchOptions::default()
    };
    let matches = retouch
        .best(&target, &options, progress)
        .map_err(|error| words(&error))?;
    let mut steps = Vec::new();
    for found in &matches {
        let step = retouch.step(&target, found);
        if retouch.apply(&step, progress).is_ok() {
            let (shown, place) =
                with_image!(&picture.image, image => ring(retouch, image, at, search.radius))
                    .ok_or("outside of the picture")?;
            steps.push((step, shown, place));
            retouch.undo();
        }
    }
    Ok(steps)
}

/// The fragments of a picture.
fn index(
    picture: &Picture,
    operation: &Operation,
    progress: &Progress,
) -> Result<FragmentIndex, String> {
    let size = picture.image.size();
    let mut hole = Mask::empty(size);
    for Polygon(corners) in &operation.params.polygons {
        let polygon = Mask::from_polygon(size, corners).map_err(|error| error.to_string())?;
        hole = hole.union(&polygon).map_err(|error| error.to_string())?;
    }
    let planes = operation.params.planes.iter();
    let planes: Vec<[DVec2; 4]> = planes
        .filter_map(|plane| plane.0.as_slice().try_into().ok())
        .collect();
    with_image!(&picture.image, image => {
        let sources = Sources {
            planes: &planes,
            ..Sources::new(image, &hole)
        };
        FragmentIndex::new(&sources, progress)
    })
    .map_err(|error| error.to_string())
}

/// The picture inside of a ring after the steps so far, and its place.
fn ring<P: Color>(
    retouch: &Retouch<'_>,
    image: &Image<P>,
    at: DVec2,
    radius: u32,
) -> Option<(Arc<Shown>, [f64; 4])> {
    let reach = f64::from(radius);
    let first = (at - reach).max(DVec2::ZERO).floor();
    let end = (at + reach).ceil();
    let part = Rect::new(
        first.x as usize,
        first.y as usize,
        (end.x as usize)
            .min(image.width())
            .checked_sub(first.x as usize)?,
        (end.y as usize)
            .min(image.height())
            .checked_sub(first.y as usize)?,
    );
    let cut = part.size()?;
    let filled = retouch.picture_in(image, part)?;
    let filled: Image<Srgba<u8>> = filled.convert();
    let round = Image::from_fn(cut, |col, row| {
        let place = DVec2::new(first.x + col as f64 + 0.5, first.y + row as f64 + 0.5);
        let Srgba([r, g, b, alpha]) = filled[(col, row)];
        Srgba([
            r,
            g,
            b,
            if place.distance(at) <= reach {
                alpha
            } else {
                0
            },
        ])
    });
    let shown = Shown::new(Arc::new(Picture::from_image(AnyImage::from(round))));
    let place = [first.x, first.y, cut.width() as f64, cut.height() as f64];
    Some((Arc::new(shown), place))
}
