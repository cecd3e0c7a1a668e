//! Threads beside the window.

use std::thread::{Builder, JoinHandle};

/// A thread that is joined when this is dropped; its owner asks it to end before.
///
/// If the system has no thread left, the work is not done, and the window still works.
pub(crate) struct Worker(Option<JoinHandle<()>>);

impl Worker {
    /// Starts a thread with a name that debuggers show.
    pub fn start(name: &str, work: impl FnOnce() + Send + 'static) -> Self {
        Self(Builder::new().name(name.to_owned()).spawn(work).ok())
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        if let Some(thread) = self.0.take() {
            // a panic of the thread was reported where it happened
            let _ = thread.join();
        }
    }
}
