//! Mattes: strokes answer on the frame at once, and are carried through the shot beside the window.

use super::analysis::{output_ui, source_ui, state_ui};
use super::marker::{Marker, marks};
use super::plate::TRACK;
use super::{Desk, Gesture, Hand, Row, Tool, with_params};
use crate::analyses::AnalysisView;
use crate::assistant::Assistant;
use crate::content::Kind;
use crate::document::{Document, Edit};
use crate::shown::Shown;
use egui::Ui;
use ravec::matting::Matte as Solution;
use ravec::raster::{AnyImage, Image, Srgba};
use ravec_jobs::Context;
use ravec_jobs::matte::FrameMattes;
use ravec_media::Picture;
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

/// What an answer depends on.
#[derive(Clone, PartialEq)]
struct Key {
    frame: Arc<str>,
    marks: Value,
    look: Look,
    /// Key of the mattes that it was solved with.
    mattes: Arc<str>,
}

/// Separates foreground and background.
pub(crate) struct Matte {
    marker: Marker,
    look: Look,
    /// The mattes that were there last, their key, and the strokes that they hold.
    mattes: Option<(u64, FrameMattes, Arc<str>)>,
    /// Columns and rows of the frame that is shown.
    size: [f64; 2],
}

impl Default for Matte {
    fn default() -> Self {
        Self {
            marker: Marker::default(),
            look: Look::Veil,
            mattes: None,
            size: [0.0; 2],
        }
    }
}

/// True for a matte of a still picture.
fn is_still(document: &Document) -> bool {
    Kind::of(&document.source) == Kind::Picture
}

impl Matte {
    /// Asks for the matte of the frame that is shown. Until strokes are carried through the shot, those of the frame hold.
    fn ask(&mut self, hand: &Hand<'_>, edit: &Edit) {
        let view = hand.assistant.analyses.view();
        let carried = view.mattes(edit);
        if let Some((mattes, key)) = carried {
            self.mattes = Some((edit.id, mattes.clone(), key.clone()));
        }
        let Some((id, mattes, mattes_key)) = &self.mattes else {
            return;
        };
        let (Some(picture), Some(frame)) = (hand.input.content.picture().cloned(), hand.frame)
        else {
            return;
        };
        if *id != edit.id || self.look == Look::Off {
            return;
        }
        let is_whole =
            carried.is_some() && !self.marker.holds() && !hand.assistant.analyses.is_busy();
        let key = Key {
            frame: hand.input.key.clone(),
            marks: edit.param("marks").clone(),
            look: self.look,
            mattes: if is_whole {
                mattes_key.clone()
            } else {
                "".into()
            },
        };
        let known = hand.assistant.answer::<Answer>(FRAME);
        if known.is_some_and(|known| known.key == key) || hand.assistant.is_asked(FRAME) {
            return;
        }
        let (mattes, given, look) = (mattes.clone(), marks(edit), self.look);
        hand.assistant.ask(FRAME, move |_, progress| {
            let mattes = if is_whole {
                mattes
            } else {
                mattes.with_marks(&given).ok()?
            };
            let context: Context = AnalysisView::default().context(progress);
            let found = mattes
                .solve(frame, &picture.image, progress, &context)
                .ok()?;
            let shown = drawn(&found, &picture.image, look);
            let shown = Arc::new(Shown::new(Arc::new(Picture::from_image(shown))));
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

/// A matte as the canvas shows it.
fn drawn(found: &Solution, frame: &AnyImage, look: Look) -> AnyImage {
    let colors: Image<Srgba<f32>> = frame.convert();
    let image: Image<Srgba<f32>> = Image::from_fn(found.alpha.size(), |col, row| {
        let alpha = found.alpha[(col, row)];
        let [r, g, b, _] = colors[(col, row)].0;
        let mixed = |share: f32, a: [f32; 3], b: [f32; 3]| {
            [0, 1, 2].map(|k| share * a[k] + (1.0 - share) * b[k])
        };
        let [r, g, b] = match look {
            Look::Alpha => [alpha; 3],
            Look::Foreground => mixed(alpha, found.foreground[(col, row)], [BACKDROP; 3]),
            Look::Veil | Look::Off => mixed(VEIL_SHARE * (1.0 - alpha), VEIL, [r, g, b]),
        };
        Srgba([r, g, b, 1.0])
    });
    AnyImage::from(image.convert::<Srgba<u8>>())
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
        let [width, height] = self.size;
        Some((answer.shown.clone(), [0.0, 0.0, width, height]))
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
        self.size = hand.input_size.map(|side| side as f64);
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
        marked.or(plate).or(track).or(changed).or(output)
    }
}
