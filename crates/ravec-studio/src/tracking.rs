//! A plane that is tracked through a clip beside the window, frame by frame while one watches.
//!
//! A document has one measurement at a time: a new one cancels the one that is running. The frames that are tracked so far can be
//! seen at any time.

use crate::engine::lock;
use ravec::planar::track::{Track as PlaneTrack, TrackedFrame};
use ravec::progress::Progress;
use ravec_jobs::Context;
use ravec_jobs::track::Track;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

/// The state of a measurement.
#[derive(Default)]
pub(crate) struct Measurement {
    /// Text that changes with what is measured.
    pub key: String,
    /// The frames that are tracked so far, not refined.
    pub growing: BTreeMap<u64, TrackedFrame>,
    /// The frame that was tracked last.
    pub latest: Option<u64>,
    /// The end, or a sentence.
    pub end: Option<Result<Arc<PlaneTrack>, String>>,
}

impl Measurement {
    /// The plane in a frame, if it is tracked.
    pub fn frame(&self, number: u64) -> Option<&TrackedFrame> {
        match &self.end {
            Some(Ok(track)) => track.frame(number),
            _ => self.growing.get(&number),
        }
    }

    /// The whole track.
    pub fn track(&self) -> Option<&Arc<PlaneTrack>> {
        self.end.as_ref()?.as_ref().ok()
    }

    /// True while frames are tracked.
    pub fn runs(&self) -> bool {
        self.end.is_none() && !self.key.is_empty()
    }
}

/// A measurement with the thread that makes it.
struct Running {
    state: Arc<Mutex<Measurement>>,
    progress: Progress,
    worker: Option<JoinHandle<()>>,
}

/// Measures the plane of one document.
pub(crate) struct Tracking {
    running: Mutex<Option<Running>>,
    repaint: Arc<dyn Fn() + Send + Sync>,
}

impl Tracking {
    /// Idle. `repaint` is called, from another thread, when a frame is tracked.
    pub fn new(repaint: Arc<dyn Fn() + Send + Sync>) -> Self {
        Self {
            running: Mutex::default(),
            repaint,
        }
    }

    /// Measures what `operation` tracks, without its corrections, in place of all else. Does nothing if that is measured already;
    /// `key` tells.
    pub fn measure(&self, key: &str, operation: Track) {
        let mut running = lock(&self.running);
        if let Some(known) = &*running {
            if lock(&known.state).key == key {
                return;
            }
            known.progress.cancel();
        }
        let state = Arc::new(Mutex::new(Measurement {
            key: key.to_owned(),
            ..Measurement::default()
        }));
        let progress = Progress::new(|_| {});
        let (own, context, repaint) =
            (state.clone(), Context::new(&progress), self.repaint.clone());
        let worker = std::thread::Builder::new().name("tracker".to_owned());
        let worker = worker.spawn(move || {
            let watch = |number: u64, planes: &[TrackedFrame]| {
                let mut state = lock(&own);
                if let Some(plane) = planes.first() {
                    state.growing.insert(number, plane.clone());
                }
                state.latest = Some(number);
                drop(state);
                repaint();
            };
            let end = operation.measure(&watch, &context);
            let end = end
                .map_err(|error| error.to_string())
                .and_then(|planes| planes.into_iter().next().ok_or_else(String::new));
            lock(&own).end = Some(end.map(Arc::new));
            repaint();
        });
        *running = Some(Running {
            state,
            progress,
            worker: worker.ok(),
        });
    }

    /// Stops the measurement that is going on. What is tracked stays.
    pub fn stop(&self) {
        if let Some(running) = &*lock(&self.running) {
            running.progress.cancel();
        }
    }

    /// Forgets the measurement, so that it is made again.
    pub fn forget(&self) {
        self.stop();
        *lock(&self.running) = None;
    }

    /// The measurement with this key.
    pub fn measurement(&self, key: &str) -> Option<Arc<Mutex<Measurement>>> {
        let running = lock(&self.running);
        let state = &running.as_ref()?.state;
        (lock(state).key == key).then(|| state.clone())
    }

    /// True while a plane is tracked.
    pub fn is_busy(&self) -> bool {
        let running = lock(&self.running);
        running
            .as_ref()
            .is_some_and(|running| lock(&running.state).runs())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.progress.cancel();
    }
}

impl Drop for Tracking {
    fn drop(&mut self) {
        self.stop();
        let running = lock(&self.running).take();
        if let Some(worker) = running.and_then(|mut running| running.worker.take()) {
            // a panic of the worker was reported where it happened
            let _ = worker.join();
        }
    }
}
