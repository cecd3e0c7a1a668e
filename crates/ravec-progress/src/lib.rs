//! Progress and cancellation of long work.
//!
//! A function that may run for more than a moment takes a [`Progress`]. It announces its *phases*, advances them as
//! units of work are done, and asks [`Progress::check`] often enough to stop within 50 ms of a cancellation. The caller
//! decides what becomes of the updates: a progress bar, a status line, or nothing.
//!
//! ```
//! use ravec_progress::{Cancelled, Progress};
//!
//! fn sum(rows: &[Vec<u64>], progress: &Progress) -> Result<u64, Cancelled> {
//!     let phase = progress.phase("sum", rows.len() as u64);
//!     let mut total = 0;
//!     for row in rows {
//!         progress.check()?;
//!         total += row.iter().sum::<u64>();
//!         phase.advance(1);
//!     }
//!     Ok(total)
//! }
//!
//! assert_eq!(sum(&[vec![1, 2], vec![3]], &Progress::none()), Ok(6));
//!
//! let progress = Progress::none();
//! progress.cancel();
//! assert_eq!(sum(&[vec![1]], &progress), Err(Cancelled));
//! ```
//!
//! Guarantees: a `Progress` and its clones share one cancellation; updates of one phase never run backwards as seen by
//! one thread, and the last one carries the whole count when all units were advanced. Does not guarantee: one update for
//! each [`Phase::advance`]; updates are thinned to about one in a thousand of the phase's units.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The work was cancelled by its caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// Progress of one phase of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Update {
    /// Name of the phase, in one or two words.
    pub phase: &'static str,
    /// Units done.
    pub done: u64,
    /// Units in the whole phase, at least 1.
    pub total: u64,
}

impl Update {
    /// The share that is done, 0 to 1.
    pub fn fraction(&self) -> f64 {
        self.done as f64 / self.total as f64
    }
}

type Sink = dyn Fn(Update) + Send + Sync;

#[derive(Default)]
struct Shared {
    cancelled: AtomicBool,
    sink: Option<Box<Sink>>,
    /// Number of checks left until the cancellation that a test has scheduled.
    checks_left: Option<AtomicU64>,
}

/// Channel through which long work reports its progress and learns that it is cancelled. Clones are handles of the same
/// thing.
#[derive(Clone, Default)]
pub struct Progress {
    shared: Arc<Shared>,
    /// True for a handle whose updates go nowhere.
    silent: bool,
}

impl std::fmt::Debug for Progress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Progress")
            .field("cancelled", &self.is_cancelled())
            .field("listening", &self.shared.sink.is_some())
            .finish_non_exhaustive()
    }
}

impl Progress {
    /// A progress that nobody watches. It can still be cancelled.
    pub fn none() -> Self {
        Self::default()
    }

    /// A progress that hands its updates to `sink`, which is called from whichever thread does the work.
    pub fn new(sink: impl Fn(Update) + Send + Sync + 'static) -> Self {
        Self {
            shared: Arc::new(Shared {
                sink: Some(Box::new(sink)),
                ..Shared::default()
            }),
            silent: false,
        }
    }

    /// A progress that cancels itself at the `check`-th check for cancellation (from 1): to test that
    /// work stops wherever it is interrupted, without a clock.
    ///
    /// ```
    /// # use ravec_progress::{Cancelled, Progress};
    /// let progress = Progress::cancelled_at(2);
    /// assert_eq!(progress.check(), Ok(()));
    /// assert_eq!(progress.check(), Err(Cancelled));
    /// ```
    pub fn cancelled_at(check: u64) -> Self {
        Self {
            shared: Arc::new(Shared {
                checks_left: Some(AtomicU64::new(check)),
                ..Shared::default()
            }),
            silent: false,
        }
    }

    /// A handle that shares the cancellation, and whose updates go nowhere: for a step of work whose whole is announced
    /// already, such as a frame of a clip.
    #[must_use]
    pub fn silent(&self) -> Self {
        Self {
            silent: true,
            ..self.clone()
        }
    }

    /// Asks the work to stop. Takes effect at its next [`check`](Self::check).
    pub fn cancel(&self) {
        self.shared.cancelled.store(true, Ordering::Relaxed);
    }

    /// Returns `true` if [`cancel`](Self::cancel) was called on this progress or a clone of it.
    pub fn is_cancelled(&self) -> bool {
        if let Some(left) = &self.shared.checks_left
            && left.fetch_sub(1, Ordering::Relaxed) == 1
        {
            self.cancel();
        }
        self.shared.cancelled.load(Ordering::Relaxed)
    }

    /// Fails if the work was cancelled.
    ///
    /// # Errors
    /// [`Cancelled`] after [`cancel`](Self::cancel).
    pub fn check(&self) -> Result<(), Cancelled> {
        if self.is_cancelled() {
            Err(Cancelled)
        } else {
            Ok(())
        }
    }

    /// Starts a phase of `total` units (0 is taken as 1). Phases of one progress follow one another.
    pub fn phase(&self, name: &'static str, total: u64) -> Phase {
        let phase = Phase {
            progress: self.clone(),
            name,
            total: total.max(1),
            done: AtomicU64::new(0),
        };
        phase.send(0);
        phase
    }
}

/// A phase that has started. May be advanced from several threads.
#[derive(Debug)]
pub struct Phase {
    progress: Progress,
    name: &'static str,
    total: u64,
    done: AtomicU64,
}

impl Phase {
    /// Records that `units` more are done.
    pub fn advance(&self, units: u64) {
        let before = self.done.fetch_add(units, Ordering::Relaxed);
        let after = (before + units).min(self.total);
        let step = (self.total / 1000).max(1);
        if after / step != before / step || after == self.total {
            self.send(after);
        }
    }

    fn send(&self, done: u64) {
        let sink = self.progress.shared.sink.as_ref();
        if let Some(sink) = sink.filter(|_| !self.progress.silent) {
            sink(Update {
                phase: self.name,
                done,
                total: self.total,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    fn recorded(work: impl FnOnce(&Progress)) -> Vec<Update> {
        let seen = Arc::new(Mutex::new(Vec::new()));
        let sink = Arc::clone(&seen);
        work(&Progress::new(move |update| {
            sink.lock().unwrap().push(update);
        }));
        seen.lock().unwrap().clone()
    }

    #[test]
    fn a_phase_starts_at_zero_and_ends_at_its_total() {
        let seen = recorded(|progress| {
            let phase = progress.phase("count", 7);
            (0..7).for_each(|_| phase.advance(1));
        });
        assert_eq!(seen.first().map(Update::fraction), Some(0.0));
        assert_eq!(seen.last().map(Update::fraction), Some(1.0));
        assert!(seen.windows(2).all(|pair| pair[0].done <= pair[1].done));
    }

    #[test]
    fn a_long_phase_sends_about_a_thousand_updates() {
        let seen = recorded(|progress| {
            let phase = progress.phase("count", 1_000_000);
            (0..1_000_000).for_each(|_| phase.advance(1));
        });
        assert!((900..=1100).contains(&seen.len()), "{} updates", seen.len());
    }

    #[test]
    fn an_empty_phase_has_a_total_of_one_and_an_overrun_stays_within_it() {
        let seen = recorded(|progress| progress.phase("nothing", 0).advance(5));
        assert!(
            seen.iter()
                .all(|update| update.total == 1 && update.done <= 1)
        );
    }

    #[test]
    fn a_cancellation_that_comes_by_itself_comes_at_its_look_and_stays() {
        let progress = Progress::cancelled_at(3);
        let looks: Vec<bool> = (0..5).map(|_| progress.is_cancelled()).collect();
        assert_eq!(looks, [false, false, true, true, true]);
    }

    #[test]
    fn a_silent_handle_shares_the_cancellation_and_sends_nothing() {
        let seen = recorded(|progress| progress.silent().phase("step", 2).advance(1));
        assert!(seen.is_empty());
        let progress = Progress::none();
        progress.silent().cancel();
        assert_eq!(progress.check(), Err(Cancelled));
    }

    #[test]
    fn a_clone_shares_the_cancellation() {
        let progress = Progress::none();
        let clone = progress.clone();
        assert_eq!(clone.check(), Ok(()));
        progress.cancel();
        assert_eq!(clone.check(), Err(Cancelled));
    }
}
