//! Ctrl-C: the first asks the work to stop, the second stops the program.

use crate::exit;
use anyhow::Context as _;
use ravec::progress::Progress;

/// Cancels `progress` at the first Ctrl-C (or request of the system to end), and ends the program at the second.
///
/// # Errors
/// If the system refuses the handler.
pub fn cancel_on_ctrl_c(progress: &Progress) -> anyhow::Result<()> {
    let progress = progress.clone();
    ctrlc::set_handler(move || {
        if progress.is_cancelled() {
            kill();
        }
        progress.cancel();
    })
    .context("Ctrl-C cannot be caught")
}

#[expect(
    clippy::disallowed_methods,
    reason = "the user has asked twice; a temporary file that stays behind is the lesser evil"
)]
fn kill() -> ! {
    std::process::exit(i32::from(exit::INTERRUPTED))
}
