//! Ctrl-C and requests of the system to end: the work is asked to stop, and is left behind if it does not.
//!
//! Work looks for its cancellation many times a second, but not while it waits for a pipe, a terminal or a slow disk, nor
//! within a codec. So the program ends by itself soon after the signal: temporary files are removed, no output takes its
//! place any more, and what is still running ends with the process.

use crate::exit;
use anyhow::Context as _;
use ravec::progress::Progress;
use ravec_jobs::{JobError, abandon_outputs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError, mpsc};
use std::time::Duration;

/// Time for the work to stop by itself, so that the program ends within a tenth of a second.
const GRACE: Duration = Duration::from_millis(70);

/// Time for the last words, in case nobody reads standard error.
const LAST_WORDS: Duration = Duration::from_millis(20);

/// Set when the interruption is reported for the first time.
static REPORTED: AtomicBool = AtomicBool::new(false);

/// The work that Ctrl-C cancels.
static CURRENT: Mutex<Option<Progress>> = Mutex::new(None);

/// Result of the installation of the handler, which a process has only once.
static HANDLER: OnceLock<Result<(), String>> = OnceLock::new();

/// Cancels `progress`, in place of that of an earlier run, at the first Ctrl-C (or request of the system to end), and ends the
/// program if that has not ended it after a moment.
///
/// # Errors
/// If the system refuses the handler.
pub fn cancel_on_ctrl_c(progress: &Progress) -> anyhow::Result<()> {
    *CURRENT.lock().unwrap_or_else(PoisonError::into_inner) = Some(progress.clone());
    let installed = HANDLER.get_or_init(|| install().map_err(|error| error.to_string()));
    let installed = installed.clone().map_err(anyhow::Error::msg);
    installed.context("Ctrl-C cannot be caught")
}

fn install() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| {
        let current = CURRENT.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(progress) = &*current {
            progress.cancel();
        }
        drop(current);
        std::thread::sleep(GRACE);
        abandon_outputs();
        let (done, reported) = mpsc::channel();
        std::thread::spawn(move || {
            if report_once() {
                exit::say("error", &JobError::Cancelled.to_string());
            }
            // the receiver may have given up
            let _ = done.send(());
        });
        let _ = reported.recv_timeout(LAST_WORDS);
        end();
    })
}

/// True for the first caller, who is to report the interruption.
pub fn report_once() -> bool {
    !REPORTED.swap(true, Ordering::Relaxed)
}

#[expect(
    clippy::disallowed_methods,
    reason = "outputs are abandoned before, and the work may never return to main"
)]
fn end() -> ! {
    std::process::exit(i32::from(exit::INTERRUPTED))
}
