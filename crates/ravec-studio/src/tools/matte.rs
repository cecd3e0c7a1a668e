//! Mattes: strokes answer on the frame at once, and are carried through the shot beside the window.

use super::analysis::{output_ui, regions_ui, source_ui, state_ui, take_regions};
use super::marker::{Marker, marks};
use super::plate::TRACK;
use super::{Desk, Gesture, Hand, Row, Tool, with_params};
use crate::analyses::AnalysisView;
use crate::assistant::Assistant;
use crate::content::Kind;
use crate::document::{Document, Edit, EditId};
use crate::shown::Shown;
use egui::Ui;
use ravec::matting::Matte as Solution;
use ravec::raster::{AnyImage, Image, Rect, Size, Srgba, with_image};
use ravec_jobs::Context;
use ravec_jobs::matte::{FrameMattes, LiveMatte};
use ravec_media::Picture;
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Kind of the question about the matte of the frame.
const FRAME: &str = "matte of the frame";

/// Color over the background, and its share.
const VEIL: [f32; 3] = [0.85, 0.1, 0.1];
const VEIL_SHARE: f32 = 0.6;
/// Gray behind the foreground by itself.
const BACKDROP: f32 = 0.5;

/// Ways to show a matte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Look {
    /// The frame, with a veil over the background.
    Veil,
    /// Alpha as gray.
    Alpha,
    /// The foreground over gray.
    Foreground,
    /// The frame alone.
    Off,
}

/// The matte of a frame as the canvas shows it.
struct Answer {
    key: Key,
    shown: Arc<Shown>,
}

/// Inputs of an answer.
#[derive(Clone, PartialEq)]
struct Key {
    frame: Arc<str>,
    marks: Value,
    look: Look,
    /// Parameters of the mattes without strokes.
    unmarked: Arc<str>,
}

/// The frame under the hand, and its matte as it was shown last.
struct Held {
    live: LiveMatte,
    drawn: Option<(Look, Image<Srgba<u8>>, Shown)>,
}

impl Held {
    /// The matte as the canvas shows it, drawn anew in a region only if the rest is there.
    fn shown(&mut self, frame: &AnyImage, look: Look, region: Option<Rect>) -> Arc<Shown> {
        let found = self.live.solution();
        let size = found.alpha.size();
        let known = self.drawn.take().filter(|(of, ..)| *of == look);
        let (image, shown) = if let Some((_, mut image, shown)) = known {
            let Some(region) = region else {
                let kept = Arc::new(shown.clone());
                self.drawn = Some((look, image, shown));
                return kept;
            };
            draw(&mut image, found, frame, look, region);
            let picture = Arc::new(Picture::from_image(AnyImage::from(image.clone())));
            let shown = shown.changed(picture, region);
            (image, shown)
        } else {
            let mut image = Image::new(size, Srgba([0u8; 4]));
            draw(&mut image, found, frame, look, Rect::of(size));
            let picture = Picture::from_image(AnyImage::from(image.clone()));
            (image, Shown::new(Arc::new(picture)))
        };
        let kept = Arc::new(shown.clone());
        self.drawn = Some((look, image, shown));
        kept
    }
}

/// Separates foreground and background.
pub(crate) struct Matte {
    marker: Marker,
    look: Look,
    /// The mattes that were there last, of which edit, and what they were made with.
    mattes: Option<(EditId, FrameMattes, Arc<str>)>,
    /// Key of the frame that is shown, its columns and rows.
    frame: (Arc<str>, [f64; 2]),
}

impl Default for Matte {
    fn default() -> Self {
        Self {
            marker: Marker::default(),
            look: Look::Veil,
            mattes: None,
            frame: ("".into(), [0.0; 2]),
        }
    }
}

/// True for a matte of a still picture.
fn is_still(document: &Document) -> bool {
    Kind::of(&document.source) == Kind::Picture
}

impl Matte {
    /// Asks for the matte of the frame that is shown. Strokes of other frames hold as far as they have been carried here.
    fn ask(&mut self, hand: &Hand<'_>, edit: &Edit) {
        if let Some(found) = hand.assistant.analyses.view().found(edit)
            && let Some(mattes) = &found.mattes
        {
            self.mattes = Some((edit.id, mattes.clone(), found.unmarked.clone()));
        }
        let Some((id, mattes, unmarked)) = &self.mattes else {
            return;
        };
        let (Some(picture), Some(frame)) = (hand.input.content.picture().cloned(), hand.frame)
        else {
            return;
        };
        if *id != edit.id || self.look == Look::Off {
            return;
        }
        let key = Key {
            frame: hand.input.key.clone(),
            marks: edit.param("marks").clone(),
            look: self.look,
            unmarked: unmarked.clone(),
        };
        let known = hand.assistant.answer::<Answer>(FRAME);
        if known.is_some_and(|known| known.key == key) || hand.assistant.is_asked(FRAME) {
            return;
        }
        let (mattes, given, look) = (mattes.clone(), marks(edit), self.look);
        hand.assistant.ask(FRAME, move |memory, progress| {
            let context: Context = AnalysisView::default().context(progress);
            let open: Arc<str> = format!("{}\n{}", key.frame, key.unmarked).into();
            let held = memory.keep(FRAME, &open, || {
                let live = mattes.live(frame, &picture.image, &given, progress, &context);
                let live = live.ok().flatten().ok_or(())?;
                Ok::<Held, ()>(Held { live, drawn: None })
            });
            let held = held.ok()?;
            let region = held.live.set_marks(&given, progress).ok()?;
            let shown = held.shown(&picture.image, look, region);
            Some(Answer { key, shown })
        });
    }

    fn look_ui(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            let label = ui.label("Show");
            for (look, name) in [
                (Look::Veil, "Veil"),
                (Look::Alpha, "Alpha"),
                (Look::Foreground, "Foreground"),
                (Look::Off, "Frame"),
            ] {
                ui.radio_value(&mut self.look, look, name)
                    .labelled_by(label.id);
            }
        });
    }
}

/// Draws a region of a matte as the canvas shows it.
fn draw(
    image: &mut Image<Srgba<u8>>,
    found: &Solution,
    frame: &AnyImage,
    look: Look,
    region: Rect,
) {
    let (Ok(size), col, row) = (
        Size::new(region.width, region.height),
        region.col,
        region.row,
    ) else {
        return;
    };
    let colors: Option<Image<Srgba<f32>>> =
        with_image!(frame, frame => frame.crop(col, row, size).ok().map(|part| part.convert()));
    let Some(colors) = colors else {
        return;
    };
    let rows = image.par_rows_mut().skip(row).take(region.height);
    rows.enumerate().for_each(|(line, out)| {
        for (step, out) in out[col..region.right()].iter_mut().enumerate() {
            let at = (col + step, row + line);
            let alpha = found.alpha[at];
            let [r, g, b, _] = colors[(step, line)].0;
            let mixed = |share: f32, a: [f32; 3], b: [f32; 3]| {
                [0, 1, 2].map(|k| share * a[k] + (1.0 - share) * b[k])
            };
            let color = match look {
                Look::Alpha => [alpha; 3],
                Look::Foreground => mixed(alpha, found.foreground[at], [BACKDROP; 3]),
                Look::Veil | Look::Off => mixed(VEIL_SHARE * (1.0 - alpha), VEIL, [r, g, b]),
            };
            let [r, g, b] = color.map(|value| (255.0 * value.clamp(0.0, 1.0)).round() as u8);
            *out = Srgba([r, g, b, u8::MAX]);
        }
    });
}

impl Tool for Matte {
    fn operation(&self) -> &'static str {
        "matte"
    }

    fn label(&self) -> &'static str {
        "Matte"
    }

    fn hint(&self) -> &'static str {
        "Drag over foreground or background, X changes the side, [ and ] the tip"
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Clip, Kind::Picture]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        with_params(json!({"content": "foreground"}))
    }

    fn start_in(&self, size: [usize; 2], document: &Document) -> Map<String, Value> {
        if is_still(document) {
            return self.start(size);
        }
        let mut fields = with_params(json!({}));
        fields.insert("output".to_owned(), document.free_name("matte", "").into());
        for field in ["plate", "track"] {
            if let Some(known) = document.last_analysis(field, None)
                && let Some(output) = known.output()
            {
                fields.insert(field.to_owned(), output.into());
            }
        }
        take_regions(&mut fields, document);
        fields
    }

    fn needs(&self) -> &'static [&'static str] {
        &["plate"]
    }

    fn works_on_input(&self, edit: &Edit) -> bool {
        edit.is_analysis()
    }

    fn hidden(&self) -> &'static [&'static str] {
        &["marks", "content"]
    }

    fn overlay(&self, assistant: &Assistant) -> Option<(Arc<Shown>, [f64; 4])> {
        if self.look == Look::Off {
            return None;
        }
        let answer = assistant.answer::<Answer>(FRAME)?;
        let (frame, [width, height]) = &self.frame;
        // not over another frame
        (answer.key.frame == *frame).then(|| (answer.shown.clone(), [0.0, 0.0, *width, *height]))
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        let size = hand.input_size.map(|side| side as f64);
        self.frame = (hand.input.key.clone(), size);
        self.ask(hand, edit);
        self.marker.follow(hand, edit)
    }

    fn rows(&self, _assistant: &Assistant, edit: &Edit) -> Vec<Row> {
        vec![Row {
            label: "Strokes".to_owned(),
            marks: marks(edit).iter().map(|mark| mark.frame).collect(),
            ..Row::default()
        }]
    }

    fn wanted_frame(&mut self, _assistant: &Assistant, _edit: &Edit) -> Option<u64> {
        self.marker.wanted.take()
    }

    fn panel_ui(&mut self, ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
        if is_still(desk.document) {
            ui.label("Mark foreground and background with a few strokes");
            return self.marker.panel_ui(ui, edit);
        }
        state_ui(ui, desk, edit, "Strokes hold in the whole shot");
        self.look_ui(ui);
        let marked = self.marker.panel_ui(ui, edit);
        let plate = source_ui(
            ui,
            desk,
            edit,
            ("plate", "Plate", "The background without foreground"),
        );
        let track = source_ui(ui, desk, edit, TRACK);
        let planes = regions_ui(ui, desk, edit);
        let mut is_result = !edit.is_analysis();
        let mut changed = None;
        if ui
            .checkbox(&mut is_result, "The result is the foreground")
            .on_hover_text("With alpha, instead of a matte for later edits")
            .changed()
        {
            let output = desk.document.free_name("matte", "");
            changed = Some(if is_result {
                let edit = edit.with_text_field("output", "");
                edit.with_param("content", "foreground".into())
            } else {
                let edit = edit.with_text_field("output", &output);
                edit.with_param("content", Value::Null)
            });
        }
        let output = if is_result {
            None
        } else {
            output_ui(ui, edit, "@matte")
        };
        let changed = changed.map(Gesture::done);
        marked.or(plate).or(track).or(planes).or(changed).or(output)
    }
}
