//! Measurements in a window, on the adapter at hand.

use super::script::Script;
use super::session::Session;
use super::{Measurement, measurement};
use crate::Studio;
use crate::engine::lock;
use egui::{Context, RawInput, Ui, ViewportCommand};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Result of the window when it is closed.
type Outcome = Arc<Mutex<Option<Result<Measurement, String>>>>;

/// A window whose input comes from a script.
struct Player {
    script: Script,
    session: Option<Session>,
    drawn_by: String,
    outcome: Outcome,
    /// True once a frame has begun: the next one sees its end.
    runs: bool,
}

impl Player {
    fn end(&mut self, context: &Context, outcome: Result<(), String>) {
        let Some(session) = self.session.take() else {
            return;
        };
        let found = outcome.map(|()| measurement(&self.script, session, self.drawn_by.clone()));
        *lock(&self.outcome) = Some(found);
        context.send_viewport_cmd(ViewportCommand::Close);
    }
}

impl eframe::App for Player {
    /// A frame is on the screen when the next one begins.
    fn raw_input_hook(&mut self, context: &Context, input: &mut RawInput) {
        let Some(session) = &mut self.session else {
            return;
        };
        if self.runs {
            let ended = session.end_frame(context, Instant::now());
            if ended.is_err() || session.has_ended() {
                self.end(context, ended);
                return;
            }
        }
        self.runs = true;
        // the hand of the script is the only one
        input.events = session.begin_frame(context);
        input.focused = true;
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        if let Some(session) = &mut self.session {
            if let Some(seconds) = frame.info().cpu_usage {
                session.frame_took(Duration::from_secs_f32(seconds));
            }
            session.studio.window_ui(ui);
        }
        ui.ctx().request_repaint();
    }
}

pub(super) fn measure(
    script: &Script,
    file: &Path,
    pictures: Option<PathBuf>,
) -> Result<Measurement, String> {
    let outcome = Outcome::default();
    let (for_player, script, file) = (outcome.clone(), script.clone(), file.to_path_buf());
    let [width, height] = script.window.map(|side| side as f32);
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Ravec Studio")
            .with_inner_size([width, height]),
        ..eframe::NativeOptions::default()
    };
    let run = eframe::run_native(
        "ravec-studio-measure",
        options,
        Box::new(move |context| {
            let adapter = context.wgpu_render_state.as_ref();
            let drawn_by = adapter.map_or("an unknown adapter".to_owned(), |state| {
                let info = state.adapter.get_info();
                format!("{} ({})", info.name, info.backend)
            });
            let mut studio = Studio::new(&context.egui_ctx, None);
            studio.draw_meshes_on(adapter);
            studio.open(&file);
            let session = Session::new(&context.egui_ctx, studio, &script, pictures);
            Ok(Box::new(Player {
                script,
                session: Some(session),
                drawn_by,
                outcome: for_player,
                runs: false,
            }))
        }),
    );
    run.map_err(|error| format!("there is no window: {error}"))?;
    let found = lock(&outcome).take();
    found.unwrap_or_else(|| Err("the window was closed before the end of the script".to_owned()))
}
