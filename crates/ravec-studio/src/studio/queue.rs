//! The render queue: exports that are written one after the other.

use super::Studio;
use crate::background::{Export, ExportState};
use egui::{ProgressBar, Ui};

/// Request of the hand.
enum Wish {
    Stop,
    Again,
    Earlier,
    Drop,
}

impl Studio {
    /// The list of exports, if it is shown.
    pub(super) fn queue_ui(&mut self, ui: &Ui) {
        let mut open = self.shows_queue;
        let mut wish = None;
        egui::Window::new("Render queue")
            .open(&mut open)
            .default_width(420.0)
            .show(ui.ctx(), |ui| {
                if self.background.exports.is_empty() {
                    ui.label("Exports appear here and are written one after the other.");
                }
                for export in &self.background.exports {
                    if let Some(wanted) = export_ui(ui, export) {
                        wish = Some((export.number, wanted));
                    }
                    ui.separator();
                }
            });
        self.shows_queue = open;
        match wish {
            Some((number, Wish::Stop)) => self.background.stop(number),
            Some((number, Wish::Again)) => self.background.again(number),
            Some((number, Wish::Earlier)) => self.background.earlier(number),
            Some((number, Wish::Drop)) => self.background.drop_export(number),
            None => {}
        }
    }
}

/// An export with its state and its buttons.
fn export_ui(ui: &mut Ui, export: &Export) -> Option<Wish> {
    let mut wish = None;
    let name = export.path.display().to_string();
    ui.label(&name);
    ui.horizontal(|ui| {
        let mut button = |ui: &mut Ui, text: &str, wanted: Wish| {
            let button = ui.button(text);
            let label = format!("{text}: {name}");
            button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &label));
            if button.clicked() {
                wish = Some(wanted);
            }
        };
        match &export.state {
            ExportState::Waiting => {
                ui.label("Waits");
                button(ui, "Earlier", Wish::Earlier);
                button(ui, "Drop", Wish::Drop);
            }
            ExportState::Running => {
                let (phase, fraction) = export.phase();
                let bar = ProgressBar::new(fraction as f32).desired_width(180.0);
                ui.add(bar.text(phase));
                button(ui, "Stop", Wish::Stop);
            }
            ExportState::Done(paths) => {
                ui.label(format!("Written: {} files", paths.len()));
                button(ui, "Again", Wish::Again);
                button(ui, "Drop", Wish::Drop);
            }
            ExportState::Failed(reason) => {
                ui.colored_label(ui.visuals().error_fg_color, reason);
                button(ui, "Again", Wish::Again);
                button(ui, "Drop", Wish::Drop);
            }
            ExportState::Stopped => {
                ui.label("Stopped");
                button(ui, "Again", Wish::Again);
                button(ui, "Drop", Wish::Drop);
            }
        }
    });
    wish
}
