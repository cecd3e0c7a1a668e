//! Retargeting: any side of the picture is dragged; areas are protected or give way.

use super::analysis::state_ui;
use super::outline::{self, Outline};
use super::small::small_copy;
use super::{Desk, DraftFn, DraftJob, DraftView, Gesture, Hand, Tool, with_params};
use crate::assistant::Memory;
use crate::content::{Kind, View};
use crate::document::Edit;
use crate::shown::Shown;
use egui::{Color32, CursorIcon, Pos2, Rect, Stroke, Ui, pos2};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Size, with_image};
use ravec::retarget::{Deformation, Painted, Retargeter, WarpFilter};
use ravec_jobs::retarget::Params;
use ravec_media::Picture;
use serde_json::{Map, Value, json};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Distance from a side within which it is taken, in screen points.
const REACH: f32 = 10.0;

/// The smallest share of the input that a side may have: less is refused by the operation.
const MIN_SHARE: f64 = 0.05;

/// Minimum and maximum longer side of a quick result in pixels.
const DRAFT_SIDES: [f64; 2] = [400.0, 1000.0];

/// Time that a quick result may take.
const DRAFT_TIME: Duration = Duration::from_millis(12);

/// Formats that one often wants.
const FORMATS: [(&str, f64, f64); 6] = [
    ("1:1", 1.0, 1.0),
    ("4:5", 4.0, 5.0),
    ("9:16", 9.0, 16.0),
    ("16:9", 16.0, 9.0),
    ("3:2", 3.0, 2.0),
    ("2:1", 2.0, 1.0),
];

/// Effect of gestures on the canvas.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Mode {
    /// Drags the sides of the frame.
    #[default]
    Frame,
    /// Draws areas that keep their shape.
    Protect,
    /// Draws areas that give way.
    GiveWay,
}

/// Sides in the hand, with the size and the position at the start.
struct Held {
    /// For columns and rows: 1 for the far side, -1 for the near one, 0 if it is not held.
    sides: [f64; 2],
    size: [f64; 2],
    from: Pos2,
}

/// Drags the sides of the frame, and draws areas.
pub(crate) struct Retarget {
    held: Option<Held>,
    mode: Mode,
    outline: Outline,
    shows_grid: bool,
}

impl Default for Retarget {
    fn default() -> Self {
        Self {
            held: None,
            mode: Mode::Frame,
            outline: Outline::with_radius(30.0),
            shows_grid: false,
        }
    }
}

/// The size that an edit asks for.
fn size_of(edit: &Edit, input: [usize; 2]) -> [f64; 2] {
    let text = edit
        .param("sizes")
        .get(0)
        .and_then(Value::as_str)
        .unwrap_or_default();
    let side = |text: &str, input: usize| match text.strip_suffix('%') {
        Some(percent) => percent
            .parse()
            .map_or(input as f64, |share: f64| 0.01 * share * input as f64),
        None => text.parse().unwrap_or(input as f64),
    };
    match text.split_once('x') {
        Some((width, height)) => [side(width, input[0]), side(height, input[1])],
        None => [side(text, input[0]), side(text, input[1])],
    }
}

/// The size of a format that keeps the longer side.
fn format_size(input: [usize; 2], aspect: f64) -> [f64; 2] {
    let [width, height] = input.map(|side| side as f64);
    if aspect < width / height {
        [height * aspect, height]
    } else {
        [width, width / aspect]
    }
}

fn with_size(edit: &Edit, size: [f64; 2], input: [usize; 2]) -> Edit {
    let size = [0, 1].map(|k| {
        let input = input[k] as f64;
        size[k]
            .clamp((MIN_SHARE * input).ceil(), 4.0 * input)
            .round()
    });
    edit.with_param("sizes", json!([format!("{}x{}", size[0], size[1])]))
}

impl Tool for Retarget {
    fn operation(&self) -> &'static str {
        "retarget"
    }

    fn label(&self) -> &'static str {
        "Retarget"
    }

    fn hint(&self) -> &'static str {
        match self.mode {
            Mode::Frame => "Drag a side or a corner of the frame",
            _ => "Draw the area on the picture",
        }
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Picture, Kind::Clip]
    }

    fn start(&self, [width, height]: [usize; 2]) -> Map<String, Value> {
        with_params(json!({"sizes": [format!("{width}x{height}")]}))
    }

    fn works_on_input(&self, _edit: &Edit) -> bool {
        self.mode != Mode::Frame
    }

    fn hidden(&self) -> &'static [&'static str] {
        &["protect_polygons", "give_way_polygons", "pixel_centers"]
    }

    fn draft(&self) -> Option<DraftFn> {
        (self.mode == Mode::Frame).then_some(draft as DraftFn)
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let (name, color) = match self.mode {
            Mode::Frame => {
                if self.shows_grid {
                    paint_grid(hand, edit);
                }
                return self.follow_frame(hand, edit);
            }
            Mode::Protect => ("protect_polygons", Color32::from_rgb(90, 220, 120)),
            Mode::GiveWay => ("give_way_polygons", Color32::from_rgb(240, 90, 80)),
        };
        outline::paint(hand, &outline::polygons(edit, name), color);
        let drawn = self.outline.follow(hand, color)?;
        Some(Gesture::done(outline::with_polygons(edit, name, &drawn)))
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        let input = desk.input?.content.size();
        let mut changed = None;
        if desk.snapshot.frame.is_some() {
            state_ui(ui, desk, edit, "Frames are those of the exported clip");
        }
        ui.horizontal_wrapped(|ui| {
            for (mode, name) in [
                (Mode::Frame, "Drag the frame"),
                (Mode::Protect, "Protect areas"),
                (Mode::GiveWay, "Let areas give way"),
            ] {
                if ui.selectable_label(self.mode == mode, name).clicked() {
                    self.mode = mode;
                }
            }
        });
        if self.mode == Mode::Frame {
            ui.checkbox(&mut self.shows_grid, "Show grid and lines");
            ui.horizontal_wrapped(|ui| {
                ui.label("Format");
                for (name, across, down) in FORMATS {
                    if ui
                        .button(name)
                        .on_hover_text("Keeps the longer side")
                        .clicked()
                    {
                        let size = format_size(input, across / down);
                        changed = Some(with_size(edit, size, input));
                    }
                }
            });
            ui.horizontal_wrapped(|ui| {
                ui.label("Export also");
                for (name, across, down) in FORMATS {
                    let [width, height] = format_size(input, across / down);
                    let size = format!("{}x{}", width.round(), height.round());
                    let mut on = edit.more_sizes.contains(&size);
                    let toggle = ui.checkbox(&mut on, name);
                    let name = format!("Export also as {name}");
                    toggle.widget_info(|| {
                        egui::WidgetInfo::selected(egui::Role::CheckBox, true, on, &name)
                    });
                    let hint = format!("{size} pixels, in a file of its own");
                    if toggle.on_hover_text(hint).changed() {
                        let mut edit = edit.clone();
                        edit.more_sizes.retain(|other| *other != size);
                        if on {
                            edit.more_sizes.push(size);
                        }
                        changed = Some(edit);
                    }
                }
            });
        } else {
            self.outline.ui(ui);
            let name = if self.mode == Mode::Protect {
                "protect_polygons"
            } else {
                "give_way_polygons"
            };
            let some = !edit.param(name).is_null();
            if ui
                .add_enabled(some, egui::Button::new("Remove areas"))
                .clicked()
            {
                changed = Some(edit.with_param(name, Value::Null));
            }
        }
        changed.map(Gesture::done)
    }
}

impl Retarget {
    fn follow_frame(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let [width, height] = size_of(edit, hand.input_size);
        let frame = Rect::from_min_max(
            hand.view.to_screen(0.0, 0.0),
            hand.view.to_screen(width, height),
        );
        paint_frame(hand, frame);
        let near = |at: Pos2| sides_at(frame, at);
        if let Some(sides) = hand.response.hover_pos().and_then(near) {
            hand.ui.ctx().set_cursor_icon(match sides {
                [across, down] if across * down > 0.0 => CursorIcon::ResizeNwSe,
                [across, down] if across * down < 0.0 => CursorIcon::ResizeNeSw,
                [0.0, _] => CursorIcon::ResizeVertical,
                _ => CursorIcon::ResizeHorizontal,
            });
        }
        if hand.response.drag_started_by(egui::PointerButton::Primary) && !hand.pans() {
            let origin = hand.ui.input(|input| input.pointer.press_origin());
            self.held = origin.and_then(|from| {
                let size = [width, height];
                near(from).map(|sides| Held { sides, size, from })
            });
        }
        let held = self.held.as_ref()?;
        let at = hand.response.interact_pointer_pos()?;
        let shift = (at - held.from) / hand.view.zoom;
        let moved = [f64::from(shift.x), f64::from(shift.y)];
        let size = [0, 1].map(|k| held.size[k] + held.sides[k] * moved[k]);
        let goes_on = hand.response.dragged();
        if !goes_on {
            self.held = None;
        }
        Some(Gesture {
            edit: with_size(edit, size, hand.input_size),
            goes_on,
        })
    }
}

/// Draws the deformed grid and the straight lines of the size of an edit.
fn paint_grid(hand: &Hand<'_>, edit: &Edit) {
    let wanted = size_of(edit, hand.input_size);
    let (input, edit) = (hand.input.clone(), edit.clone());
    let known = hand.assistant.answer::<Drawing>("grid");
    let current = known.as_ref().is_some_and(|drawing| drawing.edit == edit);
    if !current && !hand.assistant.is_asked("grid") {
        hand.assistant.ask("grid", move |memory, progress| {
            let prepared = prepare(&input, &edit, memory, progress)?;
            let deformation = prepared.solve(wanted)?;
            let lines = deformation.grid_lines();
            let lines = lines
                .map(|line| line.ends.map(|at| at.to_array()))
                .collect();
            let runs = deformation.straight_runs();
            let runs = runs
                .map(|run| run.iter().map(glam::DVec2::to_array).collect())
                .collect();
            Some(Drawing { edit, lines, runs })
        });
    }
    let Some(drawing) = known else {
        return;
    };
    let place = |at: &[f64; 2]| hand.view.to_screen(at[0], at[1]);
    let thin = Stroke::new(1.0, Color32::from_white_alpha(70));
    for line in &drawing.lines {
        hand.painter
            .line_segment([place(&line[0]), place(&line[1])], thin);
    }
    let strong = Stroke::new(2.0, Color32::from_rgb(80, 200, 255));
    for run in &drawing.runs {
        let line = egui::Shape::line(run.iter().map(place).collect(), strong);
        hand.painter.add(line);
    }
}

/// The grid of a size, and its straight lines.
struct Drawing {
    edit: Edit,
    lines: Vec<[[f64; 2]; 2]>,
    runs: Vec<Vec<[f64; 2]>>,
}

fn paint_frame(hand: &Hand<'_>, frame: Rect) {
    let stroke = Stroke::new(1.5, Color32::from_rgb(250, 170, 40));
    hand.painter
        .rect_stroke(frame, 0.0, stroke, egui::StrokeKind::Middle);
    let (middle, corner) = (frame.center(), frame.max);
    let handles = [
        pos2(corner.x, middle.y),
        pos2(middle.x, corner.y),
        pos2(frame.min.x, middle.y),
        pos2(middle.x, frame.min.y),
        corner,
    ];
    for handle in handles {
        hand.painter.circle_filled(handle, 5.0, stroke.color);
    }
}

/// The sides of a frame at a screen position: 1 for the right and the lower one, -1 for the left and the upper one.
fn sides_at(frame: Rect, at: Pos2) -> Option<[f64; 2]> {
    if !frame.expand(REACH).contains(at) {
        return None;
    }
    let side = |at: f32, low: f32, high: f32| {
        if (at - high).abs() < REACH {
            1.0
        } else if (at - low).abs() < REACH {
            -1.0
        } else {
            0.0
        }
    };
    let sides = [
        side(at.x, frame.min.x, frame.max.x),
        side(at.y, frame.min.y, frame.max.y),
    ];
    (sides != [0.0, 0.0]).then_some(sides)
}

/// An analyzed picture with a small copy of it.
struct Prepared {
    retargeter: Retargeter,
    small: Picture,
    /// The last deformation, from which the next one starts.
    last: Option<Deformation>,
    /// Longer side of the next quick result, going by the time of the last one.
    side: f64,
}

impl Prepared {
    fn solve(&mut self, size: [f64; 2]) -> Option<&Deformation> {
        let size = Size::new(size[0].round() as usize, size[1].round() as usize).ok()?;
        let solved = match &self.last {
            Some(similar) => self.retargeter.solve_near(size, similar),
            None => self.retargeter.solve(size),
        };
        self.last = Some(solved.ok()?);
        self.last.as_ref()
    }
}

/// The analysis of the input of an edit, kept as long as nothing but the size changes.
fn prepare<'a>(
    input: &crate::engine::EditInput,
    edit: &Edit,
    memory: &'a mut Memory,
    progress: &Progress,
) -> Option<&'a mut Prepared> {
    let picture = input.content.picture()?;
    let settings = edit.with_param("sizes", Value::Null);
    let key = format!(
        "{} {}",
        input.key,
        serde_json::to_string(&settings.fields).ok()?
    );
    let prepared = memory.keep("retargeter", &key.into(), || -> Result<_, ()> {
        let params = edit
            .fields
            .get("params")
            .cloned()
            .unwrap_or_else(|| json!({}));
        let params: Params = serde_json::from_value(params).map_err(|_| ())?;
        let size = picture.image.size();
        let masks = params.with_polygons(None, None, size).map_err(|_| ())?;
        let painted = Painted {
            protect: masks.0.as_ref(),
            give_way: masks.1.as_ref(),
        };
        let retargeter = with_image!(&picture.image, image => {
            Retargeter::new(image, painted, &params.options(), progress)
        });
        Ok(Prepared {
            retargeter: retargeter.map_err(|_| ())?,
            small: small_copy(picture, DRAFT_SIDES[1]).0,
            last: None,
            side: DRAFT_SIDES[0],
        })
    });
    prepared.ok()
}

/// The picture at the size of an edit, with the pixels of the screen.
fn draft(job: &DraftJob, memory: &mut Memory, progress: &Progress) -> Option<DraftView> {
    let wanted = size_of(&job.edit, job.input.content.size());
    let prepared = prepare(&job.input, &job.edit, memory, progress)?;
    let start = Instant::now();
    prepared.solve(wanted)?;
    let deformation = prepared.last.as_ref()?;
    let scale = (prepared.side / wanted[0].max(wanted[1])).min(1.0);
    let side = |k: usize| (scale * wanted[k]).round().max(1.0) as usize;
    let size = Size::new(side(0), side(1)).ok()?;
    let warped: AnyImage = with_image!(&prepared.small.image, image => {
        deformation.warp_to(image, size, WarpFilter::Preview, progress).ok()?.into()
    });
    let full = wanted.map(|side| side.round() as usize);
    let shown = Shown::new(Arc::new(prepared.small.with_pixels(warped))).stretched(full);
    let share = start.elapsed().div_duration_f64(DRAFT_TIME);
    let [low, high] = DRAFT_SIDES;
    prepared.side = (prepared.side / share.max(1e-6).sqrt()).clamp(low, high);
    Some(DraftView::whole(View::Picture(Arc::new(shown))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_the_command_line_does() {
        let edit = |text: &str| Edit {
            id: 1,
            operation: "retarget".to_owned(),
            fields: with_params(json!({"sizes": [text]})),
            more_sizes: Vec::new(),
            enabled: true,
        };
        assert_eq!(size_of(&edit("50%x100%"), [200, 80]), [100.0, 80.0]);
        assert_eq!(size_of(&edit("120x90"), [200, 80]), [120.0, 90.0]);
        assert_eq!(size_of(&edit("50%"), [200, 80]), [100.0, 40.0]);
        assert_eq!(size_of(&edit("120x"), [200, 80]), [120.0, 80.0]);
    }

    #[test]
    fn all_sides_and_corners_are_taken() {
        let frame = Rect::from_min_max(pos2(10.0, 10.0), pos2(210.0, 110.0));
        let at = |x, y| sides_at(frame, pos2(x, y));
        assert_eq!(at(208.0, 60.0), Some([1.0, 0.0]));
        assert_eq!(at(12.0, 60.0), Some([-1.0, 0.0]));
        assert_eq!(at(100.0, 5.0), Some([0.0, -1.0]));
        assert_eq!(at(212.0, 112.0), Some([1.0, 1.0]));
        assert_eq!(at(100.0, 60.0), None);
        assert_eq!(at(300.0, 60.0), None);
    }
}
