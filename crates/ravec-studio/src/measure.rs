//! Times under the hand: recorded gestures, from the event to the picture that shows what it has caused.
//!
//! A [`Script`] opens a file or a scene and says what the hand does. [`measure`] plays it by the real clock, either without a window,
//! where the time of the window's thread is that of its own work, or in a window, where that of the adapter comes to it. Steps do not
//! wait for one another's pictures within a gesture: motions come at the rate of a mouse, whatever the studio does.
//!
//! A time is that from the moment at which an event is due to the end of the first frame that shows its picture: a result, a quick
//! result or an answer that was asked for because of this event or a later one. What waits for the screen's next refresh is not
//! counted without a window.

mod figures;
mod script;
mod session;
mod source;
mod watch;
mod window;

pub use figures::{GestureFigures, Measurement};
pub use script::{Opened, Script, Step, Way};

use crate::Studio;
use egui::{Context, RawInput, Rect, Vec2, pos2};
use session::Session;
use source::{Folder, prepare};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Place in which a script is played.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Stage {
    /// Without a window.
    Nowhere,
    /// In a window on the adapter at hand; pictures of it are written into the folder, if there is one.
    Window(Option<PathBuf>),
}

/// Plays a script and measures. `base` is the folder of the script.
///
/// # Errors
/// One sentence if the input cannot be opened, or a step finds no control of its name.
pub fn measure(script: &Script, base: &Path, stage: Stage) -> Result<Measurement, String> {
    let folder = Folder::create()?;
    let file = prepare(&script.open, base, &folder)?;
    match stage {
        Stage::Nowhere => measure_without_window(script, &file),
        Stage::Window(pictures) => window::measure(script, &file, pictures),
    }
}

/// The figures of a session that has ended.
fn measurement(script: &Script, session: Session, drawn_by: String) -> Measurement {
    Measurement {
        about: script.about.clone(),
        size: session.size,
        drawn_by,
        threads: rayon::current_num_threads(),
        gestures: session
            .into_records()
            .iter()
            .map(figures::Record::figures)
            .collect(),
    }
}

/// The moment at which the window wants to be drawn again.
#[derive(Default)]
struct Alarm {
    at: Mutex<Option<Instant>>,
    wake: Condvar,
}

impl Alarm {
    fn set(&self, delay: Duration) {
        // what is never due has no moment
        let Some(wanted) = Instant::now().checked_add(delay) else {
            return;
        };
        let mut at = self.at.lock().unwrap_or_else(PoisonError::into_inner);
        *at = Some(at.map_or(wanted, |at| at.min(wanted)));
        self.wake.notify_all();
    }

    /// Waits until a moment or until the window wants to be drawn.
    fn wait_until(&self, moment: Instant) {
        let mut at = self.at.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let next = at.map_or(moment, |at| at.min(moment));
            let pause = next.saturating_duration_since(Instant::now());
            if pause.is_zero() {
                *at = None;
                return;
            }
            let woken = self.wake.wait_timeout(at, pause);
            at = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

fn measure_without_window(script: &Script, file: &Path) -> Result<Measurement, String> {
    let context = Context::default();
    let alarm = Arc::new(Alarm::default());
    let ring = alarm.clone();
    context.set_request_repaint_callback(move |info| ring.set(info.delay));
    let mut studio = Studio::new(&context, None);
    studio.open(file);
    let mut session = Session::new(&context, studio, script, None);
    let start = Instant::now();
    let size = Vec2::new(script.window[0] as f32, script.window[1] as f32);
    while !session.has_ended() {
        alarm.wait_until(session.next_frame(Instant::now()));
        let input = RawInput {
            screen_rect: Some(Rect::from_min_size(pos2(0.0, 0.0), size)),
            time: Some(start.elapsed().as_secs_f64()),
            focused: true,
            events: session.begin_frame(&context),
            ..RawInput::default()
        };
        let begin = Instant::now();
        let mut output = context.run_ui(input, |ui| session.studio.window_ui(ui));
        let triangles = context.tessellate(output.shapes, output.pixels_per_point);
        let end = Instant::now();
        // an adapter would take them
        drop(triangles);
        output.textures_delta.clear();
        session.frame_took(end - begin);
        session.end_frame(&context, end)?;
    }
    Ok(measurement(script, session, "no window".to_owned()))
}
