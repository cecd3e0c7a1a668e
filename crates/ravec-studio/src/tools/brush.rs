//! The brush: strokes with the settings of the panel, painted as the hand moves.

use super::{Desk, DraftFn, DraftJob, DraftView, Gesture, Hand, Tool, with_params};
use crate::assistant::{Assistant, Memory};
use crate::content::{Content, View};
use crate::document::Edit;
use crate::engine::lock;
use crate::shown::Shown;
use egui::{Color32, Key, Stroke, Ui};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Image, Plane, Rect, Size, Srgba, with_image};
use ravec::twocolor::brush::{Stroke as Painted, Strokes, replay};
use ravec_media::Picture;
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Factors by which the keys change the radius.
const FINER: f64 = 0.85;
const COARSER: f64 = 1.0 / FINER;

/// Distance between recorded points as a share of the radius.
const SPACING: f64 = 0.08;

/// Maximum radius at which the region under the brush is shown, in pixels.
const MAX_REGION_RADIUS: f64 = 300.0;

/// Color of the region that a dab would touch.
const REGION: [u8; 3] = [255, 190, 60];

/// Paints strokes with the settings of the panel.
#[derive(Default)]
pub(crate) struct Brush {
    /// Points of the stroke that is being painted.
    points: Vec<[f64; 2]>,
    /// The edit before this stroke.
    base: Option<Edit>,
    /// The dab whose region was asked for last.
    asked: Option<Dab>,
}

/// A dab before the click.
#[derive(Debug, Clone, PartialEq)]
struct Dab {
    key: Arc<str>,
    at: [i64; 2],
    stroke: Value,
}

/// The region of a dab: a picture with alpha, and its place.
pub(crate) struct Region {
    pub shown: Arc<Shown>,
    pub place: [f64; 4],
}

/// Kind of the questions about regions.
const REGION_KIND: &str = "region";

fn number(edit: &Edit, name: &str, default: f64) -> f64 {
    edit.param(name).as_f64().unwrap_or(default)
}

/// The tool of a stroke by the settings of an edit.
fn tool(edit: &Edit) -> Value {
    let mode = edit.param("mode").as_str().unwrap_or("smooth");
    let color = match edit.param("color") {
        Value::Null => json!([192, 48, 32]),
        color => color.clone(),
    };
    match mode {
        "color" => json!({"color": {"rgb": color}}),
        "recolor" => json!({"recolor": {"rgb": color}}),
        "saturation" => json!({"saturation": {"amount": number(edit, "amount", 0.5)}}),
        "clone" => {
            let offset = match edit.param("offset") {
                Value::Null => json!([0, 0]),
                offset => offset.clone(),
            };
            json!({"clone": {"offset": offset}})
        }
        "dodge" | "burn" | "mask" => mode.into(),
        operator => {
            json!({"operator": {
                "mode": operator,
                "iterations": number(edit, "iterations", 1.0) as u32,
                "noise_sigma": edit.param("noise_sigma"),
            }})
        }
    }
}

/// A stroke with the settings of an edit.
fn stroke(edit: &Edit, tool: &Value, points: &[[f64; 2]]) -> Value {
    json!({
        "tool": tool,
        "points": points,
        "radius_px": number(edit, "radius", 32.0),
        "hardness": number(edit, "hardness", 0.5),
        "strength": number(edit, "strength", 1.0),
        "edge_aware": edit.param("across_edges") != true,
    })
}

fn strokes(edit: &Edit) -> &[Value] {
    let strokes = edit
        .fields
        .get("strokes")
        .and_then(|strokes| strokes.get("strokes"));
    strokes.and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn with_strokes(edit: &Edit, list: Vec<Value>, [width, height]: [usize; 2]) -> Edit {
    let mut edit = edit.clone();
    let empty = || json!({"version": 1, "width": width, "height": height, "strokes": []});
    let strokes = edit.fields.entry("strokes").or_insert_with(empty);
    strokes["strokes"] = list.into();
    edit
}

/// An edit with one more stroke.
fn with_stroke(edit: &Edit, points: &[[f64; 2]], size: [usize; 2]) -> Edit {
    let mut list = strokes(edit).to_vec();
    list.push(stroke(edit, &tool(edit), points));
    with_strokes(edit, list, size)
}

impl Tool for Brush {
    fn operation(&self) -> &'static str {
        "brush"
    }

    fn label(&self) -> &'static str {
        "Brush"
    }

    fn hint(&self) -> &'static str {
        "Drag to paint, [ and ] for the size, Alt+click takes a color (for clone: the source)"
    }

    fn start(&self, [width, height]: [usize; 2]) -> Map<String, Value> {
        let mut fields = with_params(json!({"mode": "color"}));
        let strokes = json!({"version": 1, "width": width, "height": height, "strokes": []});
        fields.insert("strokes".to_owned(), strokes);
        fields
    }

    fn made(&self, edit: &Edit) -> bool {
        edit.operation == "brush" && edit.fields.contains_key("strokes")
    }

    /// Settings that strokes do not have: undo is that of the window.
    fn hidden(&self) -> &'static [&'static str] {
        &["undo", "pixel_centers", "seed", "scale", "window"]
    }

    fn draft(&self) -> Option<DraftFn> {
        Some(draft)
    }

    fn overlay(&self, assistant: &Assistant) -> Option<(Arc<Shown>, [f64; 4])> {
        if !self.points.is_empty() {
            return None;
        }
        self.asked.as_ref()?;
        let region = assistant.answer::<Region>(REGION_KIND)?;
        Some((region.shown.clone(), region.place))
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let radius = number(edit, "radius", 32.0);
        let ring = Stroke::new(1.5, Color32::WHITE);
        match hand.response.hover_pos() {
            Some(at) => {
                hand.painter
                    .circle_stroke(at, radius as f32 * hand.view.zoom, ring);
                self.ask_region(hand, edit, hand.view.to_picture(at), radius);
            }
            None => self.asked = None,
        }
        let factor = hand.ui.input(|input| {
            let key = |key, factor| if input.key_pressed(key) { factor } else { 1.0 };
            key(Key::OpenBracket, FINER) * key(Key::CloseBracket, COARSER)
        });
        if factor != 1.0 {
            let radius = (radius * factor).clamp(1.0, 4096.0);
            let radius = (10.0 * radius).round() / 10.0;
            return Some(Gesture::done(edit.with_param("radius", radius.into())));
        }
        if hand.pans() {
            return None;
        }
        if hand.ui.input(|input| input.modifiers.alt) {
            return hand.clicked().and_then(|at| picked(hand, edit, at));
        }
        // the first dab is painted under the hand, not when the button is released
        if let Some(from) = hand.touched() {
            self.points = vec![from];
            self.base = Some(edit.clone());
        }
        if self.points.is_empty() {
            return None;
        }
        for point in hand.moves() {
            let far = self.points.last().is_none_or(|last| {
                (last[0] - point[0]).hypot(last[1] - point[1]) >= (SPACING * radius).max(0.5)
            });
            if far {
                self.points.push(point);
            }
        }
        let base = self.base.as_ref().filter(|base| base.id == edit.id);
        let painted = with_stroke(base.unwrap_or(edit), &self.points, hand.input_size);
        let goes_on = hand.holds();
        if !goes_on {
            self.points.clear();
            self.base = None;
        }
        Some(Gesture {
            edit: painted,
            goes_on,
        })
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        let list = strokes(edit);
        let size = desk.input?.content.size();
        let mut changed = None;
        ui.horizontal(|ui| {
            ui.label(match list.len() {
                1 => "1 stroke".to_owned(),
                count => format!("{count} strokes"),
            });
            if ui
                .add_enabled(!list.is_empty(), egui::Button::new("Remove all strokes"))
                .clicked()
            {
                changed = Some(Vec::new());
            }
        });
        egui::CollapsingHeader::new("Strokes").show(ui, |ui| {
            egui::ScrollArea::vertical()
                .max_height(160.0)
                .show(ui, |ui| {
                    for (index, one) in list.iter().enumerate() {
                        ui.horizontal(|ui| {
                            let tool = &one["tool"];
                            let name = match tool.as_object().and_then(|tool| tool.iter().next()) {
                                Some((name, settings)) => {
                                    settings["mode"].as_str().unwrap_or(name).to_owned()
                                }
                                None => tool.as_str().unwrap_or_default().to_owned(),
                            };
                            ui.label(format!("{}: {name}", index + 1));
                            let remove = ui.small_button("x");
                            let label = format!("Remove stroke {}", index + 1);
                            remove.widget_info(|| {
                                egui::WidgetInfo::labeled(egui::Role::Button, true, &label)
                            });
                            let again = ui
                                .small_button("Set")
                                .on_hover_text("Give it the settings of the panel");
                            let label = format!("Set stroke {}", index + 1);
                            again.widget_info(|| {
                                egui::WidgetInfo::labeled(egui::Role::Button, true, &label)
                            });
                            if remove.clicked() {
                                let mut list = list.to_vec();
                                list.remove(index);
                                changed = Some(list);
                            } else if again.clicked() {
                                let points: Vec<[f64; 2]> =
                                    serde_json::from_value(one["points"].clone())
                                        .unwrap_or_default();
                                let mut list = list.to_vec();
                                list[index] = stroke(edit, &self::tool(edit), &points);
                                changed = Some(list);
                            }
                        });
                    }
                });
        });
        changed.map(|list| Gesture::done(with_strokes(edit, list, size)))
    }
}

impl Brush {
    /// Asks for the region that a dab at a position would touch, if the hand or the brush has changed.
    fn ask_region(&mut self, hand: &Hand<'_>, edit: &Edit, at: [f64; 2], radius: f64) {
        let edge_aware = edit.param("across_edges") != true;
        if !edge_aware || radius > MAX_REGION_RADIUS || !self.points.is_empty() {
            self.asked = None;
            return;
        }
        let Some(Content::Picture(picture)) =
            hand.snapshot.result.as_ref().map(|result| &result.content)
        else {
            return;
        };
        let dab = Dab {
            key: format!("{} {}", hand.input.key, hand.snapshot.serial).into(),
            at: at.map(|value| value.floor() as i64),
            stroke: stroke(edit, &"mask".into(), &[at]),
        };
        if self.asked.as_ref() == Some(&dab) {
            return;
        }
        let (picture, stroke) = (picture.clone(), dab.stroke.clone());
        let (painting, input, edit) = (hand.painting.clone(), hand.input.clone(), edit.clone());
        hand.assistant.ask(REGION_KIND, move |_, progress| {
            let stroke: Painted = serde_json::from_value(stroke).ok()?;
            let painted = input.content.picture().and_then(|before| {
                lock(&painting).region(&input.key, &edit, before, &stroke, progress)
            });
            match painted {
                Some((place, effect)) => Some(Region::new(place, &effect)),
                None => region(&picture, stroke, at, radius, progress),
            }
        });
        self.asked = Some(dab);
    }
}

impl Region {
    fn new(place: Rect, effect: &Plane) -> Self {
        let tint: Image<Srgba<u8>> = effect.map(|coverage| {
            let [r, g, b] = REGION;
            Srgba([r, g, b, (110.0 * coverage) as u8])
        });
        let tint = Arc::new(Picture::from_image(AnyImage::from(tint)));
        Self {
            shown: Arc::new(Shown::new(tint)),
            place: [place.col, place.row, place.width, place.height].map(|value| value as f64),
        }
    }
}

/// The region that a dab touches on a picture that was not painted here.
fn region(
    picture: &Picture,
    mut dab: Painted,
    at: [f64; 2],
    radius: f64,
    progress: &Progress,
) -> Option<Region> {
    let reach = radius.ceil() + 16.0;
    let size = picture.image.size();
    let first = at.map(|value| (value - reach).max(0.0).floor() as usize);
    let end = |k: usize, length: usize| ((at[k] + reach).max(0.0).ceil() as usize).min(length);
    let (right, bottom) = (end(0, size.width()), end(1, size.height()));
    let cut = Size::new(right.checked_sub(first[0])?, bottom.checked_sub(first[1])?).ok()?;
    let image = with_image!(&picture.image, image => image.crop(first[0], first[1], cut).map(|image| image.convert())).ok()?;
    dab.points = vec![[at[0] - first[0] as f64, at[1] - first[1] as f64]];
    let mut strokes = Strokes::new(cut);
    strokes.strokes.push(dab);
    let mask = replay(image, &strokes, progress).ok()?.mask?;
    let place = Rect::new(first[0], first[1], cut.width(), cut.height());
    Some(Region::new(place, &mask))
}

/// The edit with the color at a position, or with it as the source of clone strokes.
fn picked(hand: &Hand<'_>, edit: &Edit, at: [f64; 2]) -> Option<Gesture> {
    if edit.param("mode") == "clone" {
        // from the middle of the last dab on, as one sets a source first and paints then
        let from = strokes(edit).last().and_then(|stroke| {
            let points: Vec<[f64; 2]> = serde_json::from_value(stroke["points"].clone()).ok()?;
            points.last().copied()
        });
        let from = from.unwrap_or([
            0.5 * hand.input_size[0] as f64,
            0.5 * hand.input_size[1] as f64,
        ]);
        let offset = [0, 1].map(|k| (at[k] - from[k]).round() as i64);
        return Some(Gesture::done(edit.with_param("offset", json!(offset))));
    }
    let [r, g, b, _] = hand
        .snapshot
        .shown()?
        .pixel(at[0] as usize, at[1] as usize)?;
    Some(Gesture::done(edit.with_param("color", json!([r, g, b]))))
}

/// The picture with all strokes, of which the last one may go on.
fn draft(job: &DraftJob, _memory: &mut Memory, progress: &Progress) -> Option<DraftView> {
    let picture = job.input.content.picture()?;
    let followed = lock(&job.painting).follow(&job.input.key, &job.edit, picture, progress);
    followed
        .ok()?
        .map(|shown| DraftView::whole(View::Picture(shown)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_have_the_settings_of_the_panel() {
        let start = Edit {
            id: 1,
            operation: "brush".to_owned(),
            fields: Brush::default().start([64, 48]),
            more_sizes: Vec::new(),
            enabled: true,
        };
        let modes = [
            "color",
            "recolor",
            "saturation",
            "dodge",
            "burn",
            "mask",
            "clone",
            "smooth",
            "sharpen",
        ];
        for mode in modes {
            let edit = start
                .with_param("mode", mode.into())
                .with_param("radius", 7.5.into());
            let edit = with_stroke(&edit, &[[10.0, 12.0], [20.0, 12.0]], [64, 48]);
            let step = edit.step("a.png".as_ref(), "b.png".as_ref()).unwrap();
            let ravec_jobs::Step::Brush(brush) = step else {
                panic!("an edit of the brush is a step of the brush");
            };
            let strokes = &brush.strokes.unwrap().strokes;
            assert_eq!((strokes.len(), strokes[0].radius_px), (1, 7.5), "{mode}");
        }
    }

    #[test]
    fn the_region_of_a_dab_stops_at_an_edge() {
        let image = Image::from_fn(Size::new(120, 80).unwrap(), |col, _| {
            ravec::raster::Srgb(if col < 60 {
                [230u8, 230, 230]
            } else {
                [20, 20, 90]
            })
        });
        let picture = Picture::from_image(AnyImage::from(image));
        let start = Edit {
            id: 1,
            operation: "brush".to_owned(),
            fields: Brush::default().start([120, 80]),
            more_sizes: Vec::new(),
            enabled: true,
        };
        let at = [50.0, 40.0];
        let stroke = stroke(
            &start.with_param("radius", 20.0.into()),
            &"mask".into(),
            &[at],
        );
        let stroke = serde_json::from_value(stroke).unwrap();
        let region = region(&picture, stroke, at, 20.0, &Progress::none()).unwrap();
        let alpha = |col: f64, row: f64| {
            let [left, top, ..] = region.place;
            region
                .shown
                .pixel((col - left) as usize, (row - top) as usize)
                .unwrap()[3]
        };
        assert!(alpha(52.0, 40.0) > 60 && alpha(64.0, 40.0) == 0);
    }
}
