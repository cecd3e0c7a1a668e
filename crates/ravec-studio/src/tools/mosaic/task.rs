//! Long tasks of the panel that write files: a catalogue of a folder, and a page that zooms.

use crate::assistant::Assistant;
use crate::document::EditId;
use crate::engine::lock;
use egui::Ui;
use ravec::progress::{Progress, Update};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Kind of the questions.
const KIND: &str = "mosaic task";

/// The file that a task has written, with a sentence about it, or why there is none.
pub(super) type Outcome = Result<(PathBuf, String), String>;

/// The end of a task.
pub(super) struct Ended {
    number: u64,
    /// The edit for which it was started.
    pub edit: EditId,
    /// True for a catalogue, false for a page.
    pub is_catalogue: bool,
    pub outcome: Outcome,
}

/// A task that is going on.
pub(super) struct Task {
    number: u64,
    progress: Progress,
    update: Arc<Mutex<Option<Update>>>,
}

impl Task {
    /// Starts a task beside the window.
    pub fn start(
        ui: &Ui,
        assistant: &Assistant,
        edit: EditId,
        is_catalogue: bool,
        job: impl FnOnce(&Progress) -> Outcome + Send + 'static,
    ) -> Self {
        static NUMBERS: AtomicU64 = AtomicU64::new(1);
        let number = NUMBERS.fetch_add(1, Ordering::Relaxed);
        let update = Arc::new(Mutex::new(None));
        let (own, context) = (update.clone(), ui.ctx().clone());
        // that of the assistant, which is cancelled when the document is closed, and that of the task, while it runs
        let running: Arc<Mutex<Option<[Progress; 2]>>> = Arc::default();
        let seen = running.clone();
        let progress = Progress::new(move |update| {
            *lock(&own) = Some(update);
            context.request_repaint();
            if let Some([document, task]) = &*lock(&seen)
                && document.is_cancelled()
            {
                task.cancel();
            }
        });
        let working = progress.clone();
        assistant.ask(KIND, move |_, of_assistant| {
            *lock(&running) = Some([of_assistant.clone(), working.clone()]);
            let outcome = job(&working);
            *lock(&running) = None;
            Some(Ended {
                number,
                edit,
                is_catalogue,
                outcome,
            })
        });
        Self {
            number,
            progress,
            update,
        }
    }

    /// The end, once it is there.
    pub fn ended(&self, assistant: &Assistant) -> Option<Arc<Ended>> {
        let ended = assistant.answer::<Ended>(KIND);
        ended.filter(|ended| ended.number == self.number)
    }

    /// Draws the progress of the task, and a button that stops it.
    pub fn ui(&self, ui: &mut Ui) {
        let update = *lock(&self.update);
        ui.horizontal(|ui| {
            let fraction = update.map_or(0.0, |update| update.fraction());
            let bar = egui::ProgressBar::new(fraction as f32).desired_width(160.0);
            ui.add(bar.text(update.map_or("", |update| update.phase)));
            if ui
                .button("Stop")
                .on_hover_text("What was written before stays")
                .clicked()
            {
                self.progress.cancel();
            }
        });
    }
}
