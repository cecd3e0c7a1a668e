//! The background plate: found beside the window, with strokes over what covers it most of the time.

use super::analysis::{output_ui, source_ui, state_ui};
use super::marker::{Marker, marks};
use super::{Desk, Gesture, Hand, Row, Tool, range_ui, with_params};
use crate::assistant::Assistant;
use crate::content::Kind;
use crate::document::{Document, Edit};
use crate::shown::Shown;
use egui::Ui;
use serde_json::{Map, Value, json};
use std::path::Path;
use std::sync::Arc;

/// Kind of the question about the picture of the plate.
const PICTURE: &str = "plate picture";

/// The plate as a canvas shows it.
struct PlatePicture {
    output: String,
    /// The picture that it shows.
    of: Arc<ravec_media::Picture>,
    shown: Arc<Shown>,
}

/// Makes a picture of the background.
#[derive(Default)]
pub(crate) struct Plate {
    marker: Marker,
}

impl Plate {
    /// Asks for the picture of the plate, if it is another one than before.
    fn ask(assistant: &Assistant, edit: &Edit) {
        let Some(output) = edit.output() else {
            return;
        };
        let Some(of) = assistant.analyses.view().picture(Path::new(output)) else {
            return;
        };
        let known = assistant.answer::<PlatePicture>(PICTURE);
        let same = known.is_some_and(|known| known.output == output && known.of.image == of.image);
        if same || assistant.is_asked(PICTURE) {
            return;
        }
        let output = output.to_owned();
        assistant.ask(PICTURE, move |_, _| {
            let shown = Arc::new(Shown::new(of.clone()));
            Some(PlatePicture { output, of, shown })
        });
    }
}

impl Tool for Plate {
    fn operation(&self) -> &'static str {
        "plate"
    }

    fn label(&self) -> &'static str {
        "Background plate"
    }

    fn hint(&self) -> &'static str {
        "Mark what covers the background most of the time: drag, X changes the side, [ and ] the tip"
    }

    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Clip]
    }

    fn start(&self, _size: [usize; 2]) -> Map<String, Value> {
        let mut fields = with_params(json!({}));
        fields.insert("output".to_owned(), "@plate".into());
        fields
    }

    fn start_in(&self, size: [usize; 2], document: &Document) -> Map<String, Value> {
        let mut fields = self.start(size);
        fields.insert("output".to_owned(), document.free_name("plate", "").into());
        if let Some(track) = document.last_analysis("track", None)
            && let Some(output) = track.output()
        {
            fields.insert("track".to_owned(), output.into());
        }
        fields
    }

    fn works_on_input(&self, _edit: &Edit) -> bool {
        true
    }

    fn hidden(&self) -> &'static [&'static str] {
        &["marks"]
    }

    fn beside(&self, assistant: &Assistant, edit: &Edit) -> Option<Arc<Shown>> {
        let known = assistant.answer::<PlatePicture>(PICTURE)?;
        (edit.output() == Some(&known.output)).then(|| known.shown.clone())
    }

    fn beside_name(&self) -> &'static str {
        "Plate"
    }

    fn canvas_ui(&mut self, hand: &Hand<'_>, edit: &Edit) -> Option<Gesture> {
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
        Self::ask(desk.assistant, edit);
        state_ui(ui, desk, edit, "The plate is there");
        let track = source_ui(ui, desk, edit, TRACK);
        let planes = planes_ui(ui, desk, edit);
        let marked = self.marker.panel_ui(ui, edit);
        let range = range_ui(ui, desk, edit);
        let output = output_ui(ui, edit, "@plate");
        track.or(planes).or(marked).or(range).or(output)
    }
}

/// A box that puts all planes of the track on the plate.
fn planes_ui(ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
    let mut has_all = edit.regions_output().is_some();
    if !has_all && edit.text_field("track").is_empty() {
        return None;
    }
    let help = "Each pixel lies on the plane of the track along which the frames agree best; \
                mattes and edits that take the map follow all planes";
    let changed = ui
        .checkbox(&mut has_all, "All planes of the track")
        .on_hover_text(help)
        .changed();
    changed.then(|| {
        let name = if has_all {
            desk.document.free_name("regions", "")
        } else {
            String::new()
        };
        Gesture::done(edit.with_text_field("regions", &name))
    })
}

/// The line of a track.
pub(super) const TRACK: (&str, &str, &str) = (
    "track",
    "Track",
    "The motion of the background; without one the camera stands still",
);
