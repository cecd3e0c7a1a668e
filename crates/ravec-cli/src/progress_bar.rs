//! A progress bar on standard error, if that is a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use ravec::progress::{Progress, Update};
use std::sync::{Mutex, PoisonError};

/// Template of the bar: phase, bar, share and elapsed time.
const STYLE: &str = "{msg:>12} [{bar:32}] {percent:>3} % {elapsed}";

/// Template for the frames of a clip, which also shows their rate and the time that is left.
const FRAMES_STYLE: &str = "{msg:>12} [{bar:32}] {pos}/{len} {per_sec} {elapsed}, {eta} left";

/// Phase whose units are frames.
const FRAMES: &str = "frames";

/// A progress whose updates are drawn, and the bar to clear when all is done.
pub fn drawn() -> (Progress, ProgressBar) {
    let bar = ProgressBar::with_draw_target(Some(1), ProgressDrawTarget::stderr_with_hz(15));
    bar.set_style(style(STYLE));
    let phase = Mutex::new("");
    let sink = {
        let bar = bar.clone();
        move |update: Update| {
            let mut shown = phase.lock().unwrap_or_else(PoisonError::into_inner);
            if *shown != update.phase {
                *shown = update.phase;
                if update.phase == FRAMES {
                    bar.set_style(style(FRAMES_STYLE));
                    bar.reset();
                } else {
                    bar.set_style(style(STYLE));
                }
                bar.set_length(update.total);
                bar.set_message(update.phase);
            }
            bar.set_position(update.done);
        }
    };
    (Progress::new(sink), bar)
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template)
        .expect("the templates are constants that a test has seen")
        .progress_chars("=> ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_follows_the_phases() {
        let (progress, bar) = drawn();
        bar.set_draw_target(ProgressDrawTarget::hidden());
        progress.phase("read", 4).advance(3);
        assert_eq!((bar.position(), bar.length()), (3, Some(4)));
        progress.phase("fit", 9).advance(9);
        assert_eq!((bar.position(), bar.length()), (9, Some(9)));
        assert_eq!(bar.message(), "fit");
        progress.phase(FRAMES, 7).advance(2);
        assert_eq!((bar.position(), bar.length()), (2, Some(7)));
    }
}
