//! Controls that all analyses of a clip have: their state, the track they follow, and the files that they write.

use super::{Desk, Gesture};
use crate::analyses::AnalysisState;
use crate::document::{Document, Edit};
use crate::view::panel::text_ui;
use egui::{ProgressBar, RichText, Ui};
use serde_json::{Map, Value};

/// The state of an analysis, with buttons that stop it and start it again.
pub(super) fn state_ui(ui: &mut Ui, desk: &Desk<'_>, edit: &Edit, done: &str) {
    let analyses = &desk.assistant.analyses;
    match analyses.state(edit.id) {
        AnalysisState::Waiting => {
            ui.label(RichText::new("Waits for what it needs").italics());
        }
        AnalysisState::Running(phase, fraction) => {
            ui.horizontal(|ui| {
                let bar = ProgressBar::new(fraction as f32).desired_width(160.0);
                ui.add(bar.text(phase));
                if ui.button("Stop").clicked() {
                    analyses.stop();
                }
            });
        }
        AnalysisState::Done(warnings) => {
            ui.label(done);
            for warning in warnings {
                ui.colored_label(ui.visuals().warn_fg_color, warning);
            }
        }
        AnalysisState::Failed(reason) => {
            ui.colored_label(ui.visuals().error_fg_color, reason);
            if ui.button("Try again").clicked() {
                analyses.again();
            }
        }
    }
}

/// A line for what another edit of the document may give: its name, and a button that takes it.
pub(super) fn source_ui(
    ui: &mut Ui,
    desk: &Desk<'_>,
    edit: &Edit,
    line: (&str, &str, &str),
) -> Option<Gesture> {
    let known = desk.document.last_analysis(line.0, Some(edit.id));
    line_ui(ui, edit, line, known.and_then(|known| known.output()))
}

/// A line for the name of what another edit gives, and a button that takes `output`.
fn line_ui(
    ui: &mut Ui,
    edit: &Edit,
    (field, label, help): (&str, &str, &str),
    output: Option<&str>,
) -> Option<Gesture> {
    let text = edit.text_field(field);
    let mut changed = None;
    ui.horizontal(|ui| {
        let label = ui.label(label).on_hover_text(help);
        if let Some(path) = text_ui(ui, field, text, label.id) {
            changed = Some(edit.with_text_field(field, path.trim()));
        }
        if let Some(output) = output.filter(|output| *output != text)
            && ui
                .button("Take")
                .on_hover_text(format!("That of this project: {output}"))
                .clicked()
        {
            changed = Some(edit.with_text_field(field, output));
        }
    });
    changed.map(Gesture::done)
}

/// Takes the map of planes of the plate of a document, if it has one, with the track that the map numbers.
pub(super) fn take_regions(fields: &mut Map<String, Value>, document: &Document) {
    let plate = document.last_analysis("plate", None);
    if let Some(plate) = plate
        && let Some(regions) = plate.regions_output()
    {
        fields.insert("regions".to_owned(), regions.into());
        fields.insert("track".to_owned(), plate.text_field("track").into());
    }
}

/// A line for the map of planes of a plate: its name, and a button that takes that of this project.
pub(super) fn regions_ui(ui: &mut Ui, desk: &Desk<'_>, edit: &Edit) -> Option<Gesture> {
    let plate = desk.document.last_analysis("plate", Some(edit.id));
    let output = plate.and_then(|plate| plate.regions_output());
    let text = edit.text_field("regions");
    if output.is_none() && text.is_empty() {
        return None;
    }
    let help = "The map of a plate with several planes, along which the frame is followed";
    let mut gesture = line_ui(ui, edit, ("regions", "Planes", help), output)?;
    // the map numbers the planes of a track
    if let Some(plate) = plate
        && !gesture.edit.text_field("regions").is_empty()
        && gesture.edit.text_field("track").is_empty()
    {
        let track = plate.text_field("track");
        gesture.edit = gesture.edit.with_text_field("track", track);
    }
    Some(gesture)
}

/// A line for the name of a file; an empty one removes the field.
pub(super) fn file_ui(
    ui: &mut Ui,
    edit: &Edit,
    (field, label, help): (&str, &str, &str),
) -> Option<Gesture> {
    let mut changed = None;
    ui.horizontal(|ui| {
        let label = ui.label(label).on_hover_text(help);
        if let Some(path) = text_ui(ui, field, edit.text_field(field), label.id) {
            changed = Some(edit.with_text_field(field, path.trim()));
        }
    });
    changed.map(Gesture::done)
}

/// A line for the output of an analysis: a file, or an intermediate result of this name.
pub(super) fn output_ui(ui: &mut Ui, edit: &Edit, kept: &str) -> Option<Gesture> {
    let mut changed = None;
    let output = edit.output().unwrap_or_default();
    ui.horizontal(|ui| {
        let help = "A file is written by Export; a name with @ is kept for later edits only";
        let label = ui.label("Output").on_hover_text(help);
        if let Some(path) = text_ui(ui, "output", output, label.id) {
            let path = path.trim();
            let path = if path.is_empty() { kept } else { path };
            changed = Some(edit.with_text_field("output", path));
        }
    });
    changed.map(Gesture::done)
}
